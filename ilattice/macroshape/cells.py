"""Cells of periodic media: affine maps of which what is inside goes on at the opposite face.

Guarantees: distances to mid-surfaces, splines of them, grids and functions of an analysis on them
go on over the faces as if copies of the cell were around, to the bit. Non-guarantee: in space the
opposite faces are two places: meshes of a cell have caps, and its map is not closed.
"""

from dataclasses import dataclass

import numpy as np

from ilattice._typing import ArrayLike
from ilattice._validate import as_array
from ilattice.bspline import BSpline
from ilattice.errors import InputError
from ilattice.macroshape.maps import SplineMap
from ilattice.macroshape.primitives import affine

__all__ = ["CellMap", "cell"]


@dataclass(frozen=True, eq=False, repr=False, init=False)
class CellMap(SplineMap):
    """Affine map of the unit cube to a cell that repeats; made by `cell`.

    Parameters
    ----------
    spline : BSpline
        Trilinear, 2×2×2, with parallel edges.
    names : sequence of str, keyword-only
        As in `SplineMap`.

    Raises
    ------
    InputError
        If the map is not affine.
    """

    def __init__(self, spline: BSpline, *, names: tuple[str, ...] = ()) -> None:
        super().__init__(spline, names=names)
        c = self.spline.c[..., :3]
        bent = max(np.abs(np.diff(np.diff(c, axis=a), axis=b)).max() for a, b in _PAIRS)
        if self.spline.shape != (2, 2, 2) or bent > 1e-12 * np.abs(c).max():
            raise InputError("spline must be affine for a cell that repeats; see macroshape.cell")

    @property
    def wraps(self) -> tuple[bool, bool, bool]:
        """All directions."""
        return True, True, True


#: Pairs of directions.
_PAIRS = ((0, 1), (0, 2), (1, 2))


def cell(edges: ArrayLike = 1.0) -> CellMap:
    """A cell that repeats in all three directions, for `ilattice.homogenize`.

    Parameters
    ----------
    edges : array_like, shape (3, 3), or (3,), or float
        Edges of the cell as columns, ``x = edges @ u``, as `Tile.cell` has them; or the lengths of
        those along x, y, z.

    Returns
    -------
    CellMap
        Trilinear, 2×2×2. Walls of lattices through it repeat over its faces,
        unless they have ``boundary="clip"``.

    Raises
    ------
    InputError
        If the edges are of another shape, or in a plane.

    Examples
    --------
    >>> import ilattice as il
    >>> through = il.macroshape.cell((2.0, 1.0, 1.0))
    >>> through.closed, through.wraps
    ((False, False, False), (True, True, True))
    """
    a = as_array("edges", edges)
    if np.shape(edges) not in ((), (3,), (3, 3)):
        raise InputError(
            f"edges must be a matrix of columns, shape (3, 3), three lengths or one, got shape "
            f"{np.shape(edges)}"
        )
    if np.ndim(edges) < 2 and not (a > 0).all():
        raise InputError(f"edges must be of positive length, got {edges!r:.80}")
    matrix = a if np.ndim(edges) == 2 else np.diag(np.broadcast_to(a.ravel(), (3,)))
    try:
        return CellMap(affine(matrix).spline)
    except InputError as e:
        raise InputError(f"edges: {e}") from e
