"""The same solid on cells twice as long: splines that are among those of a space.

Cells are joined two by two in every direction, of an odd number three in the middle. The coarse
splines are combinations of the fine ones, so that nothing is integrated again: with the matrix P of
these combinations, coefficients c on the coarse cells are P c on the fine ones.

Guarantees: exact, for every degree and smoothness, in closed directions too; what is apart in the
fine space is apart in the coarse one, so that gaps stay open. Non-guarantee: closed directions of
too few cells for the degree are left as they are.
"""

from typing import Any

import numpy as np
from scipy.sparse import coo_array, csr_array
from scipy.sparse.csgraph import connected_components

from ilattice._typing import AnyArray, FloatArray, IntArray
from ilattice._validate import read_only
from ilattice.cutfem.space import SplineSpace
from ilattice.quadrature.grid import DividedGrid

#: Entries of P below this are rounding, and so are those below as many roundings of coordinates, in
#: lengths of cells: far from the origin they would tie nodes to each other that have nothing in
#: common.
NONE, ROUNDINGS = 1e-12, 64.0


def coarser(space: SplineSpace) -> tuple[SplineSpace, Any] | None:
    """The space on cells twice as long, and the matrix of its functions in those of the space.

    Parameters
    ----------
    space : SplineSpace
        With links.

    Returns
    -------
    tuple of SplineSpace and csr_array, or None
        The space, and P of shape (functions, coarse functions); None if no cells can be joined.
    """
    joined = [_joined(space, a) for a in range(3)]
    shape = tuple(int(j[-1]) + 1 for j in joined)
    if shape == space.grid.shape:
        return None
    axes = tuple(_planes(x, j) for x, j in zip(space.grid.axes, joined, strict=True))
    coarse, owner = _coarse_space(space, axes, joined)
    return coarse, _combinations(space, coarse, joined, owner)


def _joined(space: SplineSpace, axis: int) -> IntArray:
    """Joined cell of each layer of cells in a direction."""
    n = space.grid.shape[axis]
    sizes = np.full(max(n // 2, 1), 2)
    sizes[len(sizes) // 2] += n - sizes.sum()
    short = space.step * len(sizes) < space.degree + 1
    if space.grid.closed[axis] and short:
        return np.arange(n)
    return np.repeat(np.arange(len(sizes)), sizes)


def _planes(x: FloatArray, joined: IntArray) -> FloatArray:
    """Planes between joined cells."""
    return x[np.append(np.flatnonzero(np.diff(joined, prepend=-1)), len(joined))]


def _coarse_space(
    space: SplineSpace, axes: Any, joined: list[IntArray]
) -> tuple[SplineSpace, IntArray]:
    """The coarse space, and its element, by position, of each active element of the fine one."""
    assert space.links is not None
    cells, n = space.cells, len(space.cells)
    shape = tuple(len(x) - 1 for x in axes)
    ijk = tuple(j[i] for j, i in zip(joined, space.cell_indices.T, strict=True))
    home = np.ravel_multi_index(ijk, shape)
    low, high = space.links
    keep = np.isin(low, cells) & np.isin(high, cells)
    low, high = (np.searchsorted(cells, c[keep]) for c in (low, high))
    inner = home[low] == home[high]
    pairs = (low[inner], high[inner])
    count, piece = connected_components(coo_array((np.ones(len(pairs[0])), pairs), (n, n)), False)
    numbers, parents = _numbers(home, piece, count, int(np.prod(shape)))
    element = numbers[piece]
    most = int(numbers.max()) + 1
    links = np.divmod(np.unique(element[low[~inner]] * most + element[high[~inner]]), most)
    grid = DividedGrid(axes, space.grid.closed, parents=read_only(parents))
    coarse = SplineSpace(grid, space.degree, element, space.smoothness, links)
    return coarse, np.searchsorted(coarse.cells, element)


def _numbers(home: IntArray, piece: AnyArray, count: int, cells: int) -> tuple[IntArray, IntArray]:
    """Number of each piece: that of its cell for the first one there, and parents of all others."""
    parent = np.zeros(count, np.int64)
    parent[piece] = home
    order = np.argsort(parent, kind="stable")
    first = np.append(True, np.diff(parent[order]) != 0)
    numbers = np.empty(count, np.int64)
    numbers[order[first]] = parent[order[first]]
    numbers[order[~first]] = cells + np.arange(np.count_nonzero(~first))
    return numbers, parent[order[~first]]


def _combinations(
    space: SplineSpace, coarse: SplineSpace, joined: list[IntArray], owner: IntArray
) -> Any:
    """The matrix P, a row per function from any one of the elements that have it."""
    p, n = space.degree, len(space)
    m = (p + 1) ** 3
    element, local = np.empty(n, np.int64), np.empty(n, np.int64)
    element[space.dofs.ravel()] = np.repeat(np.arange(len(space.cells)), m)
    local[space.dofs.ravel()] = np.tile(np.arange(m), len(space.cells))
    index = np.unravel_index(local, (p + 1,) * 3)
    rows = [
        _restrictions(space, coarse, joined[a], a)[space.cell_indices[element, a], index[a]]
        for a in range(3)
    ]
    entries = np.einsum("ni,nj,nk->nijk", *rows).ravel()
    coordinates = [np.abs(x).max() / np.diff(x).min() for x in space.grid.axes]
    noise = ROUNDINGS * np.finfo(np.float64).eps * max(coordinates)
    entries[np.abs(entries) < max(NONE, noise)] = 0.0
    columns = coarse.dofs[owner[element]].ravel()
    P = csr_array((entries, columns, m * np.arange(n + 1)), shape=(n, len(coarse)))
    P.eliminate_zeros()
    P.sort_indices()
    return P


def _restrictions(
    space: SplineSpace, coarse: SplineSpace, joined: IntArray, axis: int
) -> FloatArray:
    """Coefficients (cells, p + 1, p + 1) of coarse functions in those of each cell of an axis."""
    k = np.arange(space.degree + 1)
    x, y = space.grid.axes[axis], coarse.grid.axes[axis]
    t = (k + 0.5) / len(k)
    u = x[:-1, None] + np.diff(x)[:, None] * t
    middle, length = 0.5 * (y[joined] + y[joined + 1]), np.diff(y)[joined]
    there = ((u - middle[:, None]) / length[:, None])[..., None] ** k
    fine = (t - 0.5)[:, None] ** k @ space.tables[axis].transpose(0, 2, 1)
    rows = there @ coarse.tables[axis][joined].transpose(0, 2, 1)
    return np.asarray(np.linalg.solve(fine, rows), np.float64)
