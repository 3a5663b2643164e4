"""What keeps badly cut cells harmless: a guard weight on the void, and ghost penalties.

For degree 1 diagonal scaling alone bounds the condition number, and a weight of 4e-9 on the void
part of cut cells guards against cells with too few points. From degree 2 on, and with Nitsche's
method, jumps across interior facets at cut cells are penalised: of the p-th normal derivative, and
of all others that are not continuous. Functions are the same polynomial of degree p on both sides
exactly if these vanish, so the penalty is consistent with smooth solutions to the order of the
space. What a face gets is set by its emptier cell: the square of the part that is missing to what
holds a cell, so that most cells are spared, and `FALL` per cell that it is away from solid. Of
equal weights everywhere those at a corner of slivers are felt more than the solid that they hang
on, and degree 3 is conditioned worse the more it is stabilised. A part of few cells, none of them
well filled, has no full cell to lean on: what is beyond linear in its whole cells is penalised a
little. Sources:
Burman, Ghost penalty, 2010; Burman, Hansbo, Larson, Massing, Cut finite element methods, 2015; Hong
et al. 2025, Remark A.2, for the stiffness on the void, which with weight 1 makes thin lattices 2 to
6 times too stiff.

Guarantees: the penalty is that of derivatives in the unit of cells, scaled with the height of the
cells in space and the stiffness at hand, so it depends on neither unit nor size. Non-guarantee:
through curved maps a polynomial of degree p in space is no polynomial in parameters, and is
penalised by the order of the space.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from math import factorial, perm

import numpy as np

from ilattice._geometry import grid_points
from ilattice._typing import AnyArray, FloatArray, IntArray
from ilattice._validate import Frozen, read_only
from ilattice.cutfem._kernels_ghost import ghost_matrices
from ilattice.cutfem.space import SplineSpace
from ilattice.quadrature._filling import gauss
from ilattice.quadrature.cutting import CutGrid
from ilattice.quadrature.grid import CUT
from ilattice.quadrature.rules import Quadrature

#: Factor of penalties per cell away from solid, and number of cells for which it counts.
FALL, FAR = 0.1, 3

#: Parts of at most so many cells, none of them filled by more than a part, are lone, and get this
#: factor, times that part, of what is beyond linear. At degree 3 the smallest eigenvalues, after
#: scaling, of tips of balls 0.02 to 0.2 cells high go from what is left of rounding to 3e-11 and
#: more; a sheet of a hundredth of a cell that is clamped at a side bends less by 6e-4 of it.
LONE_CELLS, LONE_FILL, LONE = 8, 0.4, 1e-6
#: Fill below which the factor is taken of the whole cell: crumbs of opaque solids, on which every
#: function of the cell is nearly the same. Of what is beyond this degree it always is, since specks
#: of a thousandth of a cell have next to none of it.
CRUMB, HIGH = 1e-4, 3

#: Legendre's polynomials, of unit size for |t| < 1/2: column k has the coefficients of degree k.
LEGENDRE = read_only(
    np.array([[1, 0, -0.5, 0], [0, 1, 0, -3], [0, 0, 6, 0], [0, 0, 0, 20]])
    * np.sqrt([1.0, 12.0, 5.0, 7.0])
)

#: Takes parameters (n, 3) and the elements (n,) that they belong to, returns values (n,) or (1,).
Stiffness = Callable[[FloatArray, IntArray], FloatArray]


@dataclass(frozen=True, eq=False)
class GhostFaces(Frozen):
    """Faces between active cells, of which one or both are cut.

    Attributes
    ----------
    lower, upper : tuple of ndarray, shape (faces,)
        Per direction the cells on both sides.
    weights : tuple of ndarray, shape (faces,)
        Per direction the factors of the penalty.
    """

    lower: tuple[IntArray, IntArray, IntArray]
    upper: tuple[IntArray, IntArray, IntArray]
    weights: tuple[FloatArray, FloatArray, FloatArray]

    def dofs(self, space: SplineSpace) -> list[AnyArray]:
        """Per direction the active functions (faces, n) of the two cells at faces."""
        out = []
        for axis in range(3):
            low, high = (
                space.dofs[np.searchsorted(space.cells, cells)].reshape(
                    -1, *(space.degree + 1,) * 3
                )
                for cells in (self.lower[axis], self.upper[axis])
            )
            last = np.arange(space.degree + 1 - space.step, space.degree + 1)
            both = np.concatenate([low, high.take(last, axis + 1)], axis=axis + 1)
            out.append(both.reshape(len(low), int(np.prod(both.shape[1:]))))
        return out

    def matrices(
        self,
        space: SplineSpace,
        jacobians: Callable[[FloatArray], FloatArray],
        stiffness: Stiffness | None,
        room: int,
    ) -> Iterator[tuple[IntArray, FloatArray]]:
        """Numbers of faces, all directions counted on, and their matrices, in batches.

        Without a stiffness they are those for a matrix of masses, which falls with the square of
        the height of cells.
        """
        p = space.degree
        n = (p + 1 + space.step) * (p + 1) ** 2
        size = max(room // (8 * n * n), 64)
        first = 0
        for axis in range(3):
            count = len(self.lower[axis])
            b, c = (a for a in range(3) if a != axis)
            for i in range(0, count, size):
                part = slice(i, min(i + size, count))
                lower, upper = self.lower[axis][part], self.upper[axis][part]
                at = space.grid.cell_indices(lower)
                A = np.empty((len(lower), n, n))
                ghost_matrices(
                    len(at), axis, space._tables[b], space._tables[c], at[:, [b, c]],
                    gauss(p + 1)[0],
                    self._scales(space, axis, part, jacobians, stiffness),
                    _products(space, axis, lower, upper), A,
                )  # fmt: skip
                yield first + np.arange(part.start, part.stop), A
            first += count

    def _scales(
        self, space: SplineSpace, axis: int, part: slice,
        jacobians: Callable[[FloatArray], FloatArray],
        stiffness: Stiffness | None,
    ) -> FloatArray:  # fmt: skip
        """Weights (faces, q, q): stiffness times area over height, or area times height."""
        p = space.degree
        x, w = gauss(p + 1)
        q = len(x)
        lower, upper = self.lower[axis][part], self.upper[axis][part]
        box, other = space.grid.boxes(lower), space.grid.boxes(upper)
        b, c = (a for a in range(3) if a != axis)
        sites = np.empty((len(lower), q, q, 3))
        sites[..., axis] = (box[:, axis] + box[:, 3 + axis])[:, None, None]
        sites[..., b] = (box[:, b, None] + box[:, 3 + b, None] * x)[:, :, None]
        sites[..., c] = (box[:, c, None] + box[:, 3 + c, None] * x)[:, None, :]
        u = sites.reshape(-1, 3)
        J = jacobians(u)
        scale = np.repeat(0.5 * (box[:, 3 + axis] + other[:, 3 + axis]), q * q)
        scale *= np.abs(np.linalg.det(J))
        if stiffness is not None:
            cofactor = np.cross(J[:, :, b], J[:, :, c])
            scale = np.einsum("nc,nc->n", cofactor, cofactor) / scale
            scale *= stiffness(u, np.repeat(lower, q * q))
        local = np.outer(w, w) * (box[:, 3 + b] * box[:, 3 + c])[:, None, None]
        return self.weights[axis][part][:, None, None] * local * scale.reshape(-1, q, q)


@dataclass(frozen=True, eq=False)
class LoneCells(Frozen):
    """Cells of parts that no well-filled cell holds.

    Attributes
    ----------
    cells : ndarray, shape (n,)
        Their numbers.
    weights : ndarray, shape (n,)
        Factors of the penalty.
    """

    cells: IntArray
    weights: FloatArray

    def matrices(
        self,
        space: SplineSpace,
        jacobians: Callable[[FloatArray], FloatArray],
        stiffness: Stiffness | None,
    ) -> tuple[IntArray, FloatArray]:
        """Positions in the space, and matrices (n, nb, nb) of what is beyond linear in cells.

        What is beyond degree `HIGH` counts with the factor of whole cells. Without a stiffness they
        are those for a matrix of masses.
        """
        at = np.searchsorted(space.cells, self.cells)
        box = space.grid.boxes(self.cells)
        middle = box[:, :3] + 0.5 * box[:, 3:]
        volume = np.abs(np.linalg.det(jacobians(middle))) * box[:, 3:].prod(axis=1)
        scale = volume if stiffness is None else volume ** (1 / 3) * stiffness(middle, self.cells)
        low, high = scale * self.weights, scale * (LONE - self.weights)
        A = low[:, None, None] * _beyond(1, space, self.cells)
        return at, A + high[:, None, None] * _beyond(HIGH, space, self.cells)


def lone_cells(solid: Quadrature, labels: IntArray, parts: IntArray) -> LoneCells:
    """Cells of the parts that are small, and that no cell holds well.

    Parameters
    ----------
    solid : Quadrature
        Rule on the solid, in parameters.
    labels : ndarray, shape (cells,)
        Part of each of its cells.
    parts : ndarray
        Parts to look at.

    Returns
    -------
    LoneCells
        The cells, increasing.
    """
    boxes = solid.grid.boxes(solid.cells)
    full = solid.integrate_cells() / boxes[:, 3:].prod(axis=1)
    best = np.zeros(int(labels.max()) + 1)
    np.maximum.at(best, labels, full)
    lone = (np.bincount(labels) <= LONE_CELLS) & (best < LONE_FILL)
    mine = lone[labels] & np.isin(labels, parts)
    fill = np.maximum(best[labels[mine]], 0.0)
    weights = LONE * np.where(fill < CRUMB, 1.0, fill)
    return LoneCells(read_only(solid.cells[mine]), read_only(weights))


def _beyond(degree: int, space: SplineSpace, cells: IntArray) -> FloatArray:
    """Products (cells, nb, nb) of functions on unit cells, without their parts up to a degree."""
    p, n = space.degree, len(cells)
    powers = np.arange(p + 1)
    sums = powers[:, None] + powers
    even = np.where(sums % 2, 0.0, 0.5**sums / (sums + 1))  # integrals of t^i t^j, |t| < 1/2
    along = even @ LEGENDRE[: p + 1, : p + 1]
    parts = [
        space.tables[axis][at][:, :, : p + 1] @ along
        for axis, at in enumerate(space.grid.cell_indices(cells).T)
    ]
    whole = np.einsum("nia,njb,nkc->nijkabc", *parts).reshape(n, (p + 1) ** 3, -1)
    high = whole[:, :, (sums[:, :, None] + powers).ravel() > degree]
    return np.asarray(high @ high.swapaxes(1, 2))


def _products(space: SplineSpace, axis: int, lower: IntArray, upper: IntArray) -> FloatArray:
    """Products (faces, m, m) of the jumps of the m functions across, summed over derivatives.

    Derivatives are in the mean height of the two cells, and those of order k weigh what they do in
    the energy of a Taylor series.
    """
    p, step = space.degree, space.step
    i, j = (space.grid.cell_indices(c)[:, axis] for c in (lower, upper))
    length, table = np.diff(space.grid.axes[axis]), space.tables[axis]
    h = 0.5 * (length[i] + length[j])
    out = np.zeros((len(lower), p + 1 + step, p + 1 + step))
    for k in range(space.smoothness + 1, p + 1):
        jump = np.zeros((len(lower), p + 1 + step))
        for cell, side, mine in ((i, -1.0, slice(0, p + 1)), (j, 1.0, slice(step, None))):
            factors = [perm(e, k) * (-0.5 * side) ** (e - k) for e in range(k, p + 1)]
            scale = side * (h / length[cell]) ** k
            jump[:, mine] += scale[:, None] * (table[cell][:, :, k:] @ factors)
        out += jump[:, :, None] * jump[:, None, :] / (factorial(k - 1) ** 2 * (2 * k - 1))
    return out


def ghost_faces(
    status: AnyArray,
    facets: tuple[Quadrature, ...],
    cells: IntArray,
    weight: float,
    solid: Quadrature | None = None,
    enough: float = 1.0,
) -> GhostFaces:
    """Interior facets between active cells at cut cells, as far as these need them.

    Parameters
    ----------
    status : ndarray
        Of the cells of the grid, as in `CutGrid.status`.
    facets : tuple of Quadrature
        Rules on the interior facets in the three directions.
    cells : ndarray
        Active cells.
    weight : float
        Factor of the penalty at slivers next to solid.
    solid : Quadrature, optional
        Rule on the solid, in parameters, that tells what is one; without it, all cells count so.
    enough : float
        Part of a cell that holds it if it is filled: no penalty is needed then.

    Returns
    -------
    GhostFaces
        The faces.
    """
    grid = facets[0].grid
    listed = [c for r in facets for c in (r.cells, r.neighbours) if c is not None and len(c)]
    count = 1 + max(int(c.max()) for c in [cells, *listed])
    active = np.zeros(count, bool)
    active[cells] = True
    is_cut = status.ravel()[grid.home(np.arange(count))] == CUT
    sides = []
    for rule in facets:
        assert rule.neighbours is not None
        low, high = rule.cells, rule.neighbours
        keep = active[low] & active[high] & (is_cut[low] | is_cut[high]) & (low != high)
        sides.append((low[keep], high[keep]))
    needs = [np.ones(len(low)) for low, _ in sides]
    if solid is not None:
        full = np.zeros(max(count, int(solid.cells.max(initial=0)) + 1))
        boxes = solid.grid.boxes(solid.cells)
        full[solid.cells] = solid.integrate_cells() / boxes[:, 3:].prod(axis=1)
        need = np.maximum(1.0 - full / enough, 0.0) ** 2 * _nearness(full, sides)
        needs = [need[np.where(full[i] < full[j], i, j)] for i, j in sides]
    a, b, c = (low[need > 0] for (low, _), need in zip(sides, needs, strict=True))
    d, e, f = (high[need > 0] for (_, high), need in zip(sides, needs, strict=True))
    x, y, z = (weight * need[need > 0] for need in needs)
    return GhostFaces((a, b, c), (d, e, f), (x, y, z))


def _nearness(full: FloatArray, sides: list[tuple[IntArray, IntArray]]) -> FloatArray:
    """Per cell of the grid, 1 in and next to solid, and `FALL` times that per cell farther away.

    A cell of which a part of `FALL` is filled counts like one next to a full cell.
    """
    near = full.copy()
    for _ in range(FAR):
        for low, high in sides:
            np.maximum.at(near, low, FALL * near[high])
            np.maximum.at(near, high, FALL * near[low])
    return np.clip(near / FALL, FALL ** (FAR - 1), 1.0)


def void_rule(cut: CutGrid, rule: Quadrature, q: int, weight: float, solid: float) -> Quadrature:
    """A rule on the solid and the weighted whole of cut cells.

    Parameters
    ----------
    cut : CutGrid
        Level sets on the grid.
    rule : Quadrature
        Rule on the solid in active cells, in parameters.
    q : int
        Gauss points per direction on whole cells.
    weight : float
        Of whole cells that are cut.
    solid : float
        Factor of the rule in these.

    Returns
    -------
    Quadrature
        In cut cells `solid` times the rule, then `weight` times that of the whole cell.
    """
    is_cut = cut.status.ravel()[rule.grid.home(rule.cells)] == CUT
    counts = np.diff(rule.offsets)
    x, w = gauss(q)
    offsets = np.append(0, np.cumsum(counts + np.where(is_cut, q**3, 0)))
    points, weights = np.empty((offsets[-1], 3)), np.empty(offsets[-1])
    kept = np.arange(len(rule)) + np.repeat(offsets[:-1] - rule.offsets[:-1], counts)
    points[kept] = rule.points
    weights[kept] = rule.weights * np.repeat(np.where(is_cut, solid, 1.0), counts)
    box = rule.grid.boxes(rule.cells[is_cut])
    unit = grid_points(x, x, x)
    product = (w[:, None, None] * w[:, None] * w).ravel()
    rows = offsets[1:][is_cut][:, None] - q**3 + np.arange(q**3)
    points[rows] = box[:, None, :3] + box[:, None, 3:] * unit
    weights[rows] = weight * box[:, 3:].prod(axis=1)[:, None] * product
    return replace(
        rule, points=read_only(points), weights=read_only(weights), offsets=read_only(offsets)
    )
