"""Beams as lines with radii, for ParaView: VTP and VTU.

Guarantees: coordinates and radii in double precision; every beam has its own two points, since the
radii at a vertex may differ from beam to beam, so that ParaView's Tube filter (vary radius "By
Absolute Scalar") shows the cones.
"""

import os
from collections.abc import Mapping
from typing import Any

import numpy as np

from ilattice._typing import ArrayLike
from ilattice.io._mesh import BeamArrays
from ilattice.io.vtk import write_lines, write_vtu


def _lines(beams: BeamArrays) -> tuple[Any, Any, dict[str, Any]]:
    """Points (2 e, 3), lines (e, 2) and data on the points."""
    points = beams.vertices[beams.pairs].reshape(-1, 3)
    lines = np.arange(len(points)).reshape(-1, 2)
    return points, lines, {"radius": beams.radii.ravel(), "vertex": beams.pairs.ravel()}


def write_vtp_lines(
    beams: BeamArrays, path: str | os.PathLike[str], *,
    cell_data: Mapping[str, ArrayLike] | None = None, compress: bool = False,
) -> None:  # fmt: skip
    """Write beams as lines of a surface file.

    Parameters
    ----------
    beams : Beams
        The beams; ``radius`` and the number of the ``vertex`` are data on the points.
    path : path-like
        File to create or to replace.
    cell_data : mapping of str to (e, ...) array, optional
        Data on the beams, such as forces.
    compress : bool
        Compress with zlib.

    Raises
    ------
    FormatError
        If the file cannot be written.
    """
    points, lines, data = _lines(beams)
    write_lines(path, points, lines, point_data=data, cell_data=cell_data, compress=compress)


def write_vtu_lines(
    beams: BeamArrays, path: str | os.PathLike[str], *,
    cell_data: Mapping[str, ArrayLike] | None = None, compress: bool = False,
) -> None:  # fmt: skip
    """Write beams as line cells.

    Parameters
    ----------
    beams : Beams
        The beams; ``radius`` and the number of the ``vertex`` are data on the points.
    path : path-like
        File to create or to replace.
    cell_data : mapping of str to (e, ...) array, optional
        Data on the beams, such as forces.
    compress : bool
        Compress with zlib.

    Raises
    ------
    FormatError
        If the file cannot be written.
    """
    points, lines, data = _lines(beams)
    write_vtu(path, points, lines, 3, point_data=data, cell_data=cell_data, compress=compress)
