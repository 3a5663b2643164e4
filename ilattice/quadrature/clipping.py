"""The solid of cut cells as tetrahedra, for pictures: in parameters, with vertices on its surface.

Cells are divided into boxes, boxes into six tetrahedra along their main diagonals (H. Freudenthal,
H. Kuhn), and these are clipped by one level set after the other, so that edges where two meet are
kept. Vertices on the surface are zeros of the level sets, not interpolated.

Guarantees: faces of neighbours agree, all tetrahedra have positive volume, and the volume is right
to second order in the size of boxes. Non-guarantee: a box that a level set enters without changing
its sign at a corner is taken as if it did not.
"""

import math
from collections.abc import Callable

import numpy as np

from ilattice._geometry import between, grid_points
from ilattice._memory import need
from ilattice._typing import AnyArray, FloatArray, IntArray
from ilattice.errors import InputError
from ilattice.quadrature._kernels_kuhn import KUHN
from ilattice.quadrature.grid import Grid

#: Number of tetrahedra, before clipping, above which a picture is refused.
MAX_TETRAHEDRA = 50_000_000
PER_PIECE = 400  # bytes of memory per tetrahedron
#: Part of a volume by which pictures may be off before boxes are halved, unless there would be more
#: than ENOUGH tetrahedra before clipping: chords across beams that are about as thick as boxes look
#: like pits.
DENTED, ENOUGH = 0.005, 1_500_000
STEPS = 8  # of the search for zeros on edges
FLAT = 1e-9  # volumes below this, in units of a tetrahedron, are left out
#: By the number of corners inside, which come first: edges that are cut; tetrahedra of what is
#: inside, with corners from 0 and cuts from 4 on. Diagonals start at the corner of least number.
CASES: dict[int, tuple[tuple[tuple[int, int], ...], tuple[tuple[int, ...], ...]]] = {
    1: (((0, 1), (0, 2), (0, 3)), ((0, 4, 5, 6),)),
    2: (((0, 2), (0, 3), (1, 2), (1, 3)), ((0, 1, 6, 7), (0, 4, 6, 7), (0, 4, 5, 7))),
    3: (((0, 3), (1, 3), (2, 3)), ((0, 1, 2, 6), (0, 1, 5, 6), (0, 4, 5, 6))),
}


def clipped(
    grid: Grid, ijk: IntArray, pieces: tuple[int, int, int],
    sets: Callable[[FloatArray], FloatArray],
) -> tuple[FloatArray, IntArray]:  # fmt: skip
    """Tetrahedra of the part of some cells where all level sets are negative.

    Parameters
    ----------
    grid : Grid
        The cells.
    ijk : ndarray, shape (cells, 3)
        Index of the cells per direction.
    pieces : tuple of int
        Boxes per cell and direction.
    sets : callable
        Takes parameters (n, 3), returns values (n, sets).

    Returns
    -------
    tuple of ndarray
        Parameters (points, 3) and tetrahedra (t, 4), positively oriented.

    Raises
    ------
    InputError
        If there would be more than `MAX_TETRAHEDRA` tetrahedra.
    """
    count = float(len(KUHN) * len(ijk)) * math.prod(pieces)
    if count > MAX_TETRAHEDRA:
        raise InputError(
            f"h: {count:.2g} tetrahedra are more than {MAX_TETRAHEDRA:.2g}; take a larger h"
        )
    need(PER_PIECE * count, f"h: {count:.2g} tetrahedra", "take a larger h")
    u, cells = _boxes(grid, ijk, pieces)
    for k in range(sets(u[:1]).shape[1]):
        u, cells = _clip(u, cells, lambda p, k=k: sets(p)[:, k])  # type: ignore[misc]
    edges = u[cells[:, 1:]] - u[cells[:, :1]]
    volume = np.linalg.det(edges)
    flip = volume < 0
    cells[flip] = cells[flip][:, [0, 1, 3, 2]]
    box = np.prod([np.diff(x).min() / n for x, n in zip(grid.axes, pieces, strict=True)])
    used, cells = np.unique(cells[np.abs(volume) > FLAT * box], return_inverse=True)
    return u[used], cells.reshape(-1, 4)


def smooth(
    grid: Grid, ijk: IntArray, pieces: tuple[int, int, int],
    sets: Callable[[FloatArray], FloatArray], volume: float,
) -> tuple[FloatArray, IntArray]:  # fmt: skip
    """`clipped`, with boxes halved until the volume is nearly right.

    Parameters
    ----------
    grid, ijk, pieces, sets : Grid, ndarray, tuple, callable
        As for `clipped`.
    volume : float
        That of the solid in these cells, in parameters.

    Returns
    -------
    tuple of ndarray
        As of `clipped`; with as few boxes as asked for where more do not help, or are too many.
    """
    u, cells = clipped(grid, ijk, pieces, sets)
    off = _off(u, cells, volume)
    while off > DENTED:
        i, j, k = pieces = (2 * pieces[0], 2 * pieces[1], 2 * pieces[2])
        if len(KUHN) * len(ijk) * i * j * k > ENOUGH:
            break
        finer = clipped(grid, ijk, pieces, sets)
        before, off = off, _off(*finer, volume)
        if off > 0.9 * before:
            break
        u, cells = finer
    return u, cells


def _off(u: FloatArray, cells: IntArray, volume: float) -> float:
    """Relative error of the volume of tetrahedra."""
    edges = u[cells[:, 1:]] - u[cells[:, :1]]
    return abs(float(np.abs(np.linalg.det(edges)).sum()) / 6.0 / volume - 1.0)


def lattice(
    grid: Grid, ijk: IntArray, pieces: tuple[int, int, int], steps: AnyArray
) -> tuple[FloatArray, IntArray]:
    """Points at some steps from the first corner of cells, each once.

    Parameters
    ----------
    grid : Grid
        The cells.
    ijk : ndarray, shape (cells, 3)
        Index of the cells per direction.
    pieces : tuple of int
        Steps per cell and direction.
    steps : ndarray of int, shape (m, 3)
        Which points of every cell.

    Returns
    -------
    tuple of ndarray
        Parameters (n, 3) and the points (cells, m) of cells.
    """
    axes = [
        np.append(x[:-1, None] + np.diff(x)[:, None] * (np.arange(n) / n), x[-1])
        for x, n in zip(grid.axes, pieces, strict=True)
    ]
    at = (ijk * np.array(pieces))[:, None, :] + steps
    flat = np.ravel_multi_index(tuple(np.moveaxis(at, 2, 0)), tuple(len(x) for x in axes))
    used, cells = np.unique(flat, return_inverse=True)
    index = np.unravel_index(used, tuple(len(x) for x in axes))
    u = np.stack([x[i] for x, i in zip(axes, index, strict=True)], axis=1)
    return u, cells.reshape(flat.shape)


def _boxes(grid: Grid, ijk: IntArray, pieces: tuple[int, int, int]) -> tuple[FloatArray, IntArray]:
    """Six tetrahedra per box."""
    first = grid_points(*(np.arange(n) for n in pieces))
    steps = first[:, None] + KUHN.reshape(1, -1, 3)
    u, cells = lattice(grid, ijk, pieces, steps.reshape(-1, 3))
    return u, cells.reshape(-1, 4)


def _clip(
    u: FloatArray, cells: IntArray, f: Callable[[FloatArray], FloatArray]
) -> tuple[FloatArray, IntArray]:
    """The part of tetrahedra where f is negative; points are added."""
    values = f(u)
    inside = values < 0
    count = inside[cells].sum(axis=1)
    groups = {k: _inside_first(cells[count == k], inside) for k in CASES}
    keys = [
        corners[:, i] * len(u) + corners[:, j]
        for k, corners in groups.items() for i, j in CASES[k][0]
    ]  # fmt: skip
    edges, numbers = np.unique(np.concatenate(keys), return_inverse=True)
    cuts = _zeros(f, u, values, *np.divmod(edges, len(u)))
    split = iter(np.split(numbers + len(u), np.cumsum([len(key) for key in keys])[:-1]))
    out = [cells[count == 4]]
    for k, corners in groups.items():
        pairs, parts = CASES[k]
        nodes = np.column_stack([corners, *(next(split) for _ in pairs)])
        out.append(nodes[:, np.array(parts)].reshape(-1, 4))
    return np.concatenate([u, cuts]), np.concatenate(out)


def _inside_first(cells: IntArray, inside: AnyArray) -> IntArray:
    """Corners of tetrahedra, those inside first, then by number."""
    order = np.argsort(cells + np.where(inside[cells], 0, len(inside)), axis=1)
    return np.take_along_axis(cells, order, axis=1)


def _zeros(
    f: Callable[[FloatArray], FloatArray], u: FloatArray, values: FloatArray, low: IntArray,
    high: IntArray,
) -> FloatArray:  # fmt: skip
    """Zeros of f on edges from negative to other values."""
    p, q = u[low], u[high]
    if not len(p):
        return p
    t = between(f, p, q, np.stack([values[low], values[high]], axis=1), STEPS)
    return p + t[:, None] * (q - p)
