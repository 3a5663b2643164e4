"""Spline volumes from files and to files; the ending of the name tells the format.

=========  =============================================  ====================================
ending     format                                         what it cannot keep
=========  =============================================  ====================================
``.xml``   G+Smo geometries                               periodic directions (made clamped)
``.mesh``  MFEM NURBS mesh                                periodic directions, degree 0
``.itd``   IRIT text data                                 more than nine coordinates
``.npz``   native, binary                                 nothing
``.json``  native, text                                   nothing
=========  =============================================  ====================================

Patches are the volumes of a file, numbered from 0 in its order. ``FILE#2`` names patch 2 of FILE,
``FILE#wing`` the one patch of the name "wing"; an id does not choose a patch, since several
geometries of a file may share one.

Guarantees: what cannot be read as a spline is a `FormatError` with the path and, in text files,
the line; a file of several patches is never read without a choice. Memory is in proportion to
the size of the file.
Not guaranteed: orientation and validity of the map; ask its ``certificate``.
"""

import os
import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NoReturn

from ilattice._files import as_path
from ilattice._validate import near_names
from ilattice.bspline import BSpline
from ilattice.errors import FormatError, InputError
from ilattice.io import gismo, irit, mfem, native
from ilattice.io._kinds import kind_of
from ilattice.io._patches import Patch

__all__ = ["FORMATS", "Patch", "SplineFormat", "list_patches", "read_patch", "read_patches", "save"]

Reader = Callable[[str | os.PathLike[str]], tuple[list[Patch], list[str]]]
Writer = Callable[[BSpline, str | os.PathLike[str], tuple[str, ...]], None]
#: Items that a message lists.
_LISTED = 8


@dataclass(frozen=True)
class SplineFormat:
    """One file format.

    Parameters
    ----------
    name : str
        Name for messages.
    read : callable
        Takes a path; returns all patches, and descriptions of what was skipped.
    write : callable
        Takes a spline, a path and the names of extra coordinates.
    """

    name: str
    read: Reader
    write: Writer


#: Formats by the ending of the file name.
FORMATS = {
    ".xml": SplineFormat("G+Smo XML", gismo.read, gismo.write),
    ".mesh": SplineFormat("MFEM NURBS mesh", mfem.read, mfem.write),
    ".itd": SplineFormat("IRIT text data", irit.read, irit.write),
    ".npz": SplineFormat("native npz", native.read_npz, native.write_npz),
    ".json": SplineFormat("native JSON", native.read_json, native.write_json),
}


def list_patches(path: str | os.PathLike[str]) -> list[Patch]:
    """All splines of a file: volumes, surfaces and curves.

    Parameters
    ----------
    path : path-like
        The file.

    Returns
    -------
    list of Patch
        In the order of the file; only volumes have an ``index``. ``str(patch)`` describes one.

    Raises
    ------
    FormatError
        If the ending is unknown, or the file cannot be read.
    """
    return _format_of(path).read(path)[0]


def read_patches(path: str | os.PathLike[str]) -> list[Patch]:
    """All volumes of a file.

    Parameters
    ----------
    path : path-like
        The file.

    Returns
    -------
    list of Patch
        ``read_patches(path)[i].index == i``.

    Raises
    ------
    FormatError
        If the ending is unknown, the file cannot be read, or holds no volume.
    """
    everything, skipped = _format_of(path).read(path)
    volumes = [p for p in everything if p.index is not None]
    if not volumes:
        others = [str(p) for p in everything] + [f"{s} (not supported)" for s in skipped]
        raise FormatError(f"{path}: holds no spline volume; it holds:{_listed(others)}")
    return volumes


def read_patch(path: str | os.PathLike[str], patch: int | str | None = None) -> Patch:
    """One volume of a file.

    Parameters
    ----------
    path : path-like
        The file; ``FILE#patch`` chooses a patch too, unless a file of that very name exists.
    patch : int or str, optional
        Index or name of the patch; not needed if the file holds one volume.

    Returns
    -------
    Patch
        The volume, with the names of extra coordinates that the file gives.

    Raises
    ------
    InputError
        If the file holds several volumes and none, or none that exists, was chosen.
    FormatError
        If the file cannot be read, or holds no volume.
    """
    path, patch = _split_choice(path, patch)
    return _choose(path, read_patches(path), patch)


def save(obj: Any, path: str | os.PathLike[str]) -> None:
    """Write a map or a spline.

    Parameters
    ----------
    obj : SplineMap or BSpline
        What to write.
    path : path-like
        The file; an old one is replaced as a whole or left alone.

    Raises
    ------
    InputError
        If the object, or the spline in this format, cannot be written.
    FormatError
        If the ending is unknown, or the file cannot be written.
    """
    kind = kind_of(obj)
    if kind == "spline":
        _format_of(path).write(obj, path, ())
    elif kind == "map":
        _format_of(path).write(obj.spline, path, obj.names)
    else:
        raise InputError(f"obj must be a SplineMap or a BSpline, got {type(obj).__name__}")


def _format_of(path: str | os.PathLike[str]) -> SplineFormat:
    suffix = as_path("path", path).suffix
    if suffix.lower() not in FORMATS:
        raise FormatError(
            f"{str(path)!r}: no spline format has the ending {suffix!r}; "
            + ", ".join(f"{k} is {f.name}" for k, f in FORMATS.items())
        )
    return FORMATS[suffix.lower()]


def _split_choice(
    path: str | os.PathLike[str], patch: int | str | None
) -> tuple[Path, int | str | None]:
    """Path and patch of ``FILE#patch``."""
    whole = as_path("path", path)
    file, mark, choice = str(whole).rpartition("#")
    if not mark or patch is not None or whole.suffix.lower() in FORMATS:
        return whole, patch
    return as_path("path", file), choice


def _choose(path: Path, patches: Sequence[Patch], patch: int | str | None) -> Patch:
    """The patch of that index or name."""

    def refuse(message: str) -> NoReturn:
        raise InputError(f"{path}: {message}; it holds:{_listed([str(p) for p in patches])}")

    if patch is None:
        if len(patches) > 1:
            refuse(f"{len(patches)} volumes, choose one by patch=, or as {path.name}#0")
        return patches[0]
    if isinstance(patch, str) and not re.fullmatch("[0-9]{1,9}", patch):
        named = [p for p in patches if p.name == patch]
        if len(named) != 1:
            near = near_names(patch, [p.name for p in patches if p.name])
            refuse(f"{len(named)} patches have the name {patch!r:.60} (near: {near or 'none'})")
        return named[0]
    if isinstance(patch, bool) or not isinstance(patch, int | str):
        raise InputError(f"patch must be an index or a name, got {patch!r:.60}")
    if not 0 <= int(patch) < len(patches):
        refuse(f"patch must be an index from 0 to {len(patches) - 1} or a name, got {patch!r:.60}")
    return patches[int(patch)]


def _listed(items: Sequence[str]) -> str:
    """Items in one line, the first `_LISTED` of them."""
    more = [f"and {len(items) - _LISTED} more"] if len(items) > _LISTED else []
    return " " + ("; ".join([*items[:_LISTED], *more]) or "nothing")
