"""Which function writes or reads what: by the kind of the object and the ending of the file name.

Guarantees: an unknown ending or option is refused before anything is written; the message lists
what is known. Modules of formats are loaded when they are first used.
"""

import inspect
import os
from collections.abc import Callable
from importlib import import_module
from typing import Any

from ilattice._files import as_path
from ilattice.errors import FormatError, InputError
from ilattice.io._kinds import kind_of
from ilattice.io._mesh import MeshArrays

_SPLINE: dict[str, Any] = dict.fromkeys((".xml", ".mesh", ".itd", ".npz", ".json"), "splines:save")

#: A function of an object and a path, or "module:function" below `ilattice.io`, loaded when used.
Writer = Callable[..., None] | str
#: Kind -> ending -> writer.
WRITERS: dict[str, dict[str, Writer]] = {
    "mesh": {
        ".stl": "stl:write_stl",
        ".ply": "ply:write_ply",
        ".obj": "obj:write_obj",
        ".off": "off:write_off",
        ".3mf": "threemf:write_3mf",
        ".vtp": "vtk:write_vtp",
        ".png": "png:write_png",
    },
    "map": {".vtu": "vtk:save_bezier_vtu", **_SPLINE},
    "spline": _SPLINE,
    "beams": {
        ".3mf": "threemf_beams:write_3mf_beams",
        ".vtp": "vtk_lines:write_vtp_lines",
        ".vtu": "vtk_lines:write_vtu_lines",
    },
    "elements": {".inp": "solids:write_inp", ".vtu": "solids:write_vtu_solid"},
    "patches": {
        ".vtu": "patches_out:write_vtu_patches",
        ".itd": "patches_out:write_irit_patches",
    },
    "slices": {
        ".cli": "common_layer:write_cli",
        ".svg": "svg:write_svg",
        ".3mf": "threemf_slices:write_3mf_slices",
    },
}

#: Ending -> "module:function" below `ilattice.io` that reads a mesh from a path.
READERS = {
    ".stl": "stl:read_stl",
    ".ply": "ply_reader:read_ply",
    ".obj": "obj:read_obj",
    ".off": "off:read_off",
}


def save(
    obj: Any, path: str | os.PathLike[str], *, format: str | None = None, **options: Any
) -> None:
    """Write an object to a file.

    Parameters
    ----------
    obj : SurfaceMesh, SolidMesh, SplineMap, BSpline, Beams, Pipes, SliceStack or another
        What to write; see below for what others need.
    path : path-like
        File to create; an old one is replaced as a whole or left alone.
    format : str, optional
        Ending that names the format, by default that of `path`.
    **options
        Passed to the writer of the format, for example ``unit="inch"`` for 3MF.

    Raises
    ------
    InputError
        An object that has no file format, or an option that the format does not have.
    FormatError
        Unknown ending, or the file cannot be written.

    Notes
    -----
    A class, also one of yours, says by its attribute ``file_kind`` what its objects are to
    writers, which ask for no more than these attributes:

    ============  ============================================================================
    ``mesh``      arrays ``vertices`` (V, 3), ``faces`` (F, 3); ``point_data``, ``cell_data``
    ``elements``  all that an `ilattice.mesh.SolidMesh` has
    ``map``       ``spline``, a `BSpline` of three parameters, and ``names`` of further components
    ``spline``    all that a `BSpline` has
    ``beams``     arrays ``vertices`` (n, 3), ``pairs`` (e, 2), ``radii`` (e, 2)
    ``patches``   arrays ``quads`` (q, 3, 3, 3), ``triangles`` (t, 6, 3)
    ``slices``    all that an `ilattice.slicing.SliceStack` has
    ============  ============================================================================
    """
    writer = writer_of(obj, path, format)
    _check_options(writer, options, path)
    writer(obj, path, **options)


def read_mesh(path: str | os.PathLike[str], *, format: str | None = None) -> MeshArrays:
    """Read a triangle mesh from an STL, PLY, OBJ or OFF file.

    Parameters
    ----------
    path : path-like
        The file.
    format : str, optional
        Ending that names the format, by default that of `path`.

    Returns
    -------
    MeshArrays
        Vertices and triangles; polygons are cut into fans.

    Raises
    ------
    FormatError
        Unknown ending, or the file cannot be read as that format.

    Warns
    -----
    PrecisionWarning
        If triangles with two equal corners were dropped.
    """
    suffix = _suffix(path, format)
    if suffix.lower() not in READERS:
        raise FormatError(
            f"{str(path)!r}: no mesh can be read from the ending {suffix!r}; "
            f"choose one of {', '.join(sorted(READERS))}"
        )
    mesh: MeshArrays = _loaded(READERS[suffix.lower()])(path)
    return mesh


def endings(obj: Any) -> list[str]:
    """Endings of the formats that can hold an object.

    Parameters
    ----------
    obj : object
        What to write.

    Returns
    -------
    list of str
        Such as ``[".3mf", ".obj", ...]``, sorted; empty if there are none.
    """
    return sorted(_formats(obj))


def writer_of(
    obj: Any, path: str | os.PathLike[str], format: str | None = None
) -> Callable[..., None]:
    """The function that writes an object to a file of this name.

    Parameters
    ----------
    obj : object
        What to write.
    path : path-like
        File name.
    format : str, optional
        Ending that names the format, by default that of `path`.

    Returns
    -------
    callable
        Takes the object, the path and the options of the format.
    """
    formats = _formats(obj)
    if not formats:
        declared = f"has the file_kind {kind_of(obj)!r}" if kind_of(obj) else "has no file_kind"
        raise InputError(
            f"a {type(obj).__name__} cannot be saved: its class {declared}; "
            f"what can be is one of {', '.join(sorted(WRITERS))}"
        )
    suffix = _suffix(path, format)
    if suffix.lower() not in formats:
        raise FormatError(
            f"{str(path)!r}: a {type(obj).__name__} cannot be written with the ending {suffix!r}; "
            f"choose one of {', '.join(sorted(formats))}"
        )
    return _loaded(formats[suffix.lower()])


def _loaded(row: Any) -> Any:
    """The function of a row of `WRITERS` or `READERS`."""
    if callable(row):
        return row
    module, function = row.split(":")
    return getattr(import_module(f"ilattice.io.{module}"), function)


def _suffix(path: str | os.PathLike[str], format: str | None) -> str:
    """The ending that names the format."""
    if format is None:
        return as_path("path", path).suffix
    if not isinstance(format, str):
        raise InputError(f"format must be an ending such as '.stl', got {format!r:.80}")
    return "." + format.lstrip(".")


def _formats(obj: Any) -> dict[str, Writer]:
    """Endings and writers of the kind of an object."""
    return WRITERS.get(kind_of(obj), {})


def _check_options(
    writer: Callable[..., None], options: dict[str, Any], path: str | os.PathLike[str]
) -> None:
    known = inspect.signature(writer).parameters.values()
    if any(p.kind is p.VAR_KEYWORD for p in known):
        return
    names = [p.name for p in known if p.kind is p.KEYWORD_ONLY]
    for name in options:
        if name not in names:
            raise InputError(
                f"option {name!r} is unknown for {str(path)!r}; known: {', '.join(names) or 'none'}"
            )
