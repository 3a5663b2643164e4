"""Macro-shapes: maps of the parameter box to space, made, loaded, certified, inverted.

=================  =========================================================================
maps               `SplineMap`; `load` reads one from a file
primitives         `identity`, `affine`, `box`, `hexahedron`, `tapered`, `cylinder_shell`,
                   `torus`, `duck`, `wing`
periodic media     `cell`: edges of a cell that repeats; `CellMap`
from surfaces      `extrude`, `ruled`, `revolve`, `loft`
graded cells       `regrade`: the same volume, run through at another pace
certificate        `certify`, `check_map`, `Certificate`, `Status`
placement          `Tiling`: tiles, repeated through a map
=================  =========================================================================
"""

from os import PathLike

from ilattice.errors import FormatError, InputError
from ilattice.io.splines import read_patch
from ilattice.macroshape.cells import CellMap, cell
from ilattice.macroshape.certify import Certificate, Status, certify, check_map
from ilattice.macroshape.grading import regrade
from ilattice.macroshape.inverse import Located
from ilattice.macroshape.maps import SplineMap
from ilattice.macroshape.primitives import (
    affine,
    box,
    cylinder_shell,
    duck,
    hexahedron,
    identity,
    tapered,
    torus,
    wing,
)
from ilattice.macroshape.sweeps import extrude, loft, revolve, ruled
from ilattice.macroshape.tiling import Tiling

__all__ = [
    "CellMap",
    "Certificate",
    "Located",
    "SplineMap",
    "Status",
    "Tiling",
    "affine",
    "box",
    "cell",
    "certify",
    "check_map",
    "cylinder_shell",
    "duck",
    "extrude",
    "hexahedron",
    "identity",
    "load",
    "loft",
    "regrade",
    "revolve",
    "ruled",
    "tapered",
    "torus",
    "wing",
]


def load(path: str | PathLike[str], patch: int | str | None = None) -> SplineMap:
    """Read a spline volume from a file: G+Smo, MFEM, IRIT or native.

    Parameters
    ----------
    path : path-like
        File; ``FILE#patch`` chooses a patch too.
    patch : int or str, optional
        Index or name of a patch; not needed if the file holds one volume.

    Returns
    -------
    SplineMap
        The volume.

    Raises
    ------
    InputError
        If the file holds several volumes and none, or none that exists, was chosen.
    FormatError
        If the file cannot be read as a spline volume, or its volume is no map to space.
    """
    chosen = read_patch(path, patch)
    try:
        return SplineMap(chosen.spline, names=chosen.names)
    except InputError as e:
        raise FormatError(f"{path}: {chosen}: cannot be a map to space ({e})") from e
