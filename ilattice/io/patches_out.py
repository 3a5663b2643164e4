"""Surfaces of Bezier patches: VTU with Bezier cells, IRIT with one object per patch.

Guarantees: exact controls, 17 digits in text. Not guaranteed: that readers of IRIT files other than
IRIT itself know triangular surfaces (``TRISRF``).
"""

import os

import numpy as np

from ilattice._files import atomic_write
from ilattice.io._mesh import PatchArrays
from ilattice.io._patches import to_text
from ilattice.io.vtk import write_mixed_vtu

#: Cell types of VTK.
_BEZIER_TRIANGLE, _BEZIER_QUADRILATERAL = 76, 77
#: Controls (3, 3) of a quadrilateral in VTK's order: corners, sides, middle.
_QUAD = [(0, 0), (2, 0), (2, 2), (0, 2), (1, 0), (2, 1), (1, 2), (0, 1), (1, 1)]
#: Controls of a triangle in IRIT's order, row by row from its first corner.
_ROWS = [0, 3, 1, 5, 4, 2]


def write_vtu_patches(
    patches: PatchArrays, path: str | os.PathLike[str], *, compress: bool = False
) -> None:
    """Write patches as Bezier quadrilaterals and triangles of degree 2.

    Parameters
    ----------
    patches : Pipes
        The patches.
    path : path-like
        File to create or to replace.
    compress : bool
        Compress with zlib.

    Raises
    ------
    FormatError
        If the file cannot be written.

    Notes
    -----
    In ParaView raise "Nonlinear Subdivision Level" to see the curvature.
    """
    quads = np.stack([patches.quads[:, i, j] for i, j in _QUAD], axis=1)
    parts = [(_BEZIER_QUADRILATERAL, quads), (_BEZIER_TRIANGLE, patches.triangles)]
    write_mixed_vtu(path, parts, degree=2, compress=compress)


def write_irit_patches(patches: PatchArrays, path: str | os.PathLike[str]) -> None:
    """Write patches as IRIT surfaces: ``SURFACE BEZIER`` and ``TRISRF BEZIER``.

    Parameters
    ----------
    patches : Pipes
        The patches.
    path : path-like
        File to create or to replace.

    Raises
    ------
    FormatError
        If the file cannot be written.
    """
    with atomic_write(path, text=True) as file:
        file.write("[OBJECT ILATTICE\n")
        for kind, numbers, nets in (
            ("SURFACE", "3 3", np.swapaxes(patches.quads, 1, 2).reshape(-1, 9, 3)),
            ("TRISRF", "3", patches.triangles[:, _ROWS]),
        ):
            for i, net in enumerate(nets):
                file.write(f"  [OBJECT {kind}{i}\n    [{kind} BEZIER {numbers} E3\n")
                file.write(to_text(net, "\t[", "]") + "\n    ]\n  ]\n")
        file.write("]\n")
