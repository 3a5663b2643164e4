"""Quadrature on cut cells: volumes, the surfaces that bound them, and the faces between cells.

`quadrature(wall)` integrates anything over a wall in space::

    rule = il.cutfem.quadrature(wall, q=3)
    mass = rule.integrate(density)

Rules are made cell by cell from Bernstein coefficients (see `_kernels_rules`), one pass into room
that is used again and again, then copied to their place. Sources: Saye, High-order quadrature
methods for implicitly defined surfaces and volumes in hyperrectangles, 2015, for the recursion;
Hong et al. 2025, section 4, for what it is used for.

Guarantees: all weights are positive (those of `Quadrature.compressed` excepted); points lie in
their cells; results have the same bits for any number of threads. Full cells get a Gauss rule, and
so do boxes of full pieces in cut cells; through a curved map both are as exact as `q` makes them.
Polyhedra are exact up to rounding.
Non-guarantee: on a surface that is nearly tangent to all directions of a box of depth
`tangent_depth`, at cones and where curved edges end, the order drops; finer cells, or a larger
depth, help.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from ilattice._typing import AnyArray, FloatArray, IntArray
from ilattice._validate import Frozen, among, as_array, as_kind, asked, read_only
from ilattice.bspline._kernels_basis import determinants
from ilattice.errors import InputError
from ilattice.macroshape.maps import SplineMap
from ilattice.quadrature._filling import MAX_POINTS, gauss
from ilattice.quadrature._kernels_compress import project
from ilattice.quadrature.grid import Grid

AT_ONCE = 1 << 18  # points that are mapped to space
NAMES = ("u=0", "u=1", "v=0", "v=1", "w=0", "w=1")

Integrand = Callable[[FloatArray], Any] | float | AnyArray


@dataclass(frozen=True, eq=False)
class Quadrature(Frozen):
    """Points and weights, cell after cell.

    Attributes
    ----------
    points : ndarray, shape (n, 3)
        Where to evaluate.
    weights : ndarray, shape (n,)
        What to multiply with.
    offsets : ndarray, shape (cells + 1,)
        The points of the i-th listed cell are those from offsets[i] to offsets[i + 1].
    cells : ndarray, shape (cells,)
        Numbers of the listed cells in `grid`.
    exact_to : int
        Degree per direction of polynomials that are integrated exactly where cells are full or
        cut by planes along the grid.
    grid : Grid
        The cells.
    through : SplineMap or None
        The map to space, if there is one.
    normals : ndarray, shape (n, 3), or None
        Outward unit normals, on surfaces and faces.
    sets : ndarray, shape (n,), int8, or None
        On surfaces, which level set vanishes.
    neighbours : ndarray, shape (cells,), or None
        On faces between cells, the cells on the upper side.
    parameters : ndarray, shape (n, 3), or None
        For a rule in space, the parameters of its points; None for a rule in parameters.
    """

    points: FloatArray
    weights: FloatArray
    offsets: IntArray
    cells: IntArray
    exact_to: int
    grid: Grid
    through: SplineMap | None = None
    normals: FloatArray | None = None
    sets: AnyArray | None = None
    neighbours: IntArray | None = None
    parameters: FloatArray | None = None

    def __len__(self) -> int:
        return len(self.weights)

    def __repr__(self) -> str:
        place = "parameters" if self.parameters is None else "space"
        return f"Quadrature({len(self)} points in {place}, {len(self.cells)} cells)"

    def integrate(self, f: Integrand = 1.0) -> Any:
        """Integral of a function.

        Parameters
        ----------
        f : callable, float, or array_like of shape (n,) or (n, ...)
            Takes points (n, 3) and returns one value per point, or those values, or a constant.

        Returns
        -------
        float or ndarray
            The integral; of shape (...) for values of shape (n, ...).

        Raises
        ------
        InputError
            If there is not one value per point.
        """
        total = self._products(f).sum(axis=0)
        return float(total) if np.ndim(total) == 0 else total

    def integrate_cells(self, f: Integrand = 1.0) -> FloatArray:
        """Integral over each listed cell.

        Parameters
        ----------
        f : callable, float, or array_like
            As in `integrate`.

        Returns
        -------
        ndarray, shape (cells,) or (cells, ...)
            One integral per cell.
        """
        values = self._products(f)
        padded = np.concatenate([values, np.zeros((1, *values.shape[1:]))])
        out = np.add.reduceat(padded, self.offsets[:-1], axis=0) if len(self.cells) else values[:0]
        out[np.diff(self.offsets) == 0] = 0.0
        return out

    def flux(self, f: Callable[[FloatArray], Any] | AnyArray) -> float:
        """Integral of a vector field times the normal.

        Parameters
        ----------
        f : callable or array_like, shape (n, 3)
            Takes points (n, 3) and returns vectors (n, 3), or these vectors.

        Returns
        -------
        float
            The flux.

        Raises
        ------
        InputError
            If the rule has no normals, or there is not one vector per point.
        """
        if self.normals is None:
            raise InputError("flux needs the normals of a surface or face rule")
        vectors = as_array("f", asked("f", f, self.points) if callable(f) else f, finite=False)
        if vectors.shape != self.points.shape:
            raise InputError(
                f"f must give vectors of shape {self.points.shape}, got {vectors.shape}"
            )
        return float(self.weights @ np.einsum("ij,ij->i", vectors, self.normals))

    def in_space(self, through: SplineMap | None = None) -> "Quadrature":
        """The same rule in space: points mapped, weights times the local volume or area.

        Parameters
        ----------
        through : SplineMap, optional
            The map; by default that of the wall.

        Returns
        -------
        Quadrature
            With `parameters`. Volumes are scaled by |det J|; areas and normals by the cofactors
            of J (Nanson's formula), so that normals stay outward for left-handed maps too.

        Raises
        ------
        InputError
            If the rule is in space already, or there is no map.
        """
        if self.parameters is not None:
            raise InputError("the rule is in space already")
        space = as_kind("through", through, "SplineMap") if through is not None else self.through
        if space is None:
            raise InputError("through is needed: the rule knows no map")
        x, scale = np.empty_like(self.points), np.empty_like(self.weights)
        normals = None if self.normals is None else np.empty_like(self.normals)
        for i in range(0, len(self), AT_ONCE):
            part = slice(i, i + AT_ONCE)
            x[part], J = space.jet(self.points[part], 1)
            determinants(len(J), J, scale[part])
            if normals is not None:
                assert self.normals is not None
                n = _cofactors(J, self.normals[part]) * np.sign(scale[part])[:, None]
                scale[part] = np.linalg.norm(n, axis=1)
                normals[part] = n / np.maximum(scale[part], 1e-300)[:, None]
        return replace(
            self,
            points=read_only(x),
            weights=read_only(self.weights * np.abs(scale)),
            normals=None if normals is None else read_only(normals),
            through=space,
            parameters=self.points,
        )

    def compressed(self, degree: int = 2) -> "Quadrature":
        """Rule with (degree + 1)³ Gauss points per cell and the same moments.

        Parameters
        ----------
        degree : int
            Per direction, of the polynomials whose integrals stay the same, 0 to 9.

        Returns
        -------
        Quadrature
            Points are the Gauss points of whole cells, the same in every cell. Weights may be
            negative, and points outside the solid.

        Raises
        ------
        InputError
            If it is no volume rule in parameters.
        """
        if self.normals is not None or self.parameters is not None:
            raise InputError("only volume rules in parameters can be compressed")
        if not among(degree, range(MAX_POINTS)):
            raise InputError(f"degree must be a whole number from 0 to 9, got {degree!r}")
        points, weights = compressed_cells(self, slice(None), degree)
        return replace(
            self,
            points=read_only(points.reshape(-1, 3)),
            weights=read_only(weights.ravel()),
            offsets=read_only(np.arange(len(self.cells) + 1) * (degree + 1) ** 3),
            exact_to=degree,
        )

    @cached_property
    def owners(self) -> IntArray:
        """Position in `cells` of the cell of each point, shape (n,)."""
        return read_only(np.repeat(np.arange(len(self.cells)), np.diff(self.offsets)))

    def _products(self, f: Integrand) -> FloatArray:
        given = asked("f", f, self.points) if callable(f) else f
        values = as_array("f", given, finite=False).reshape(np.shape(given))
        if values.ndim and len(values) != len(self):
            raise InputError(
                f"f must give one value for each of {len(self)} points, got {values.shape}"
            )
        if values.ndim == 0:
            return self.weights * values
        return values * self.weights.reshape(-1, *(1,) * (values.ndim - 1))


def compressed_cells(rule: Quadrature, which: Any, degree: int) -> tuple[FloatArray, FloatArray]:
    """Points and weights of `Quadrature.compressed` in some cells.

    Parameters
    ----------
    rule : Quadrature
        On a volume, in parameters.
    which : index
        Which of its cells.
    degree : int
        See `Quadrature.compressed`.

    Returns
    -------
    points, weights : ndarray, shape (cells, (degree + 1)³, 3) and (cells, (degree + 1)³)
        Gauss points of whole cells, and what they weigh.
    """
    n = degree + 1
    x, boxes = gauss(n)[0], rule.grid.boxes(rule.cells[which])
    weights = np.zeros((len(boxes), n, n, n))
    starts, ends = (np.ascontiguousarray(a[which]) for a in (rule.offsets[:-1], rule.offsets[1:]))
    project(len(boxes), rule.points, rule.weights, starts, ends, boxes, x, weights)
    points = np.empty((len(boxes), n, n, n, 3))
    for a in range(3):
        shape = [len(boxes), 1, 1, 1]
        shape[1 + a] = n
        points[..., a] = (boxes[:, a, None] + boxes[:, 3 + a, None] * x).reshape(shape)
    return points.reshape(len(boxes), -1, 3), weights.reshape(len(boxes), -1)


def united(rules: Sequence[Quadrature]) -> Quadrature:
    """Surface rules of one grid as one, with the points of each cell together."""
    cell = np.concatenate([r.cells[r.owners] for r in rules])
    order = np.argsort(cell, kind="stable")
    cells, counts = np.unique(cell, return_counts=True)

    def all_of(name: str) -> Any:
        return np.concatenate([getattr(r, name) for r in rules])[order]

    return replace(
        rules[0], points=all_of("points"), weights=all_of("weights"), normals=all_of("normals"),
        parameters=all_of("parameters"), cells=cells, offsets=np.append(0, np.cumsum(counts)),
        sets=None, exact_to=min(r.exact_to for r in rules),
    )  # fmt: skip


def on_cells(rule: Quadrature, cells: IntArray) -> Quadrature:
    """The part of a rule in some cells, given increasing."""
    return kept(rule, np.isin(rule.cells, cells))


def kept(rule: Quadrature, keep: AnyArray) -> Quadrature:
    """The part of a rule in the listed cells that are marked."""
    if keep.all():
        return rule
    rows = np.repeat(keep, np.diff(rule.offsets))

    def part(a: Any) -> Any:
        return None if a is None else read_only(a[rows])

    offsets = np.append(0, np.cumsum(np.diff(rule.offsets)[keep]))
    return replace(
        rule,
        points=part(rule.points),
        weights=part(rule.weights),
        normals=part(rule.normals),
        sets=part(rule.sets),
        parameters=part(rule.parameters),
        cells=read_only(rule.cells[keep]),
        neighbours=None if rule.neighbours is None else read_only(rule.neighbours[keep]),
        offsets=read_only(offsets),
    )


def sums_of_cells(rule: Quadrature) -> Quadrature:
    """A rule with one point in each cell, the first one, and the sum of the weights there."""
    first = rule.offsets[:-1]

    def part(a: Any) -> Any:
        return None if a is None else read_only(a[first])

    return replace(
        rule,
        points=part(rule.points),
        weights=read_only(rule.integrate_cells()),
        normals=part(rule.normals),
        sets=part(rule.sets),
        parameters=part(rule.parameters),
        offsets=read_only(np.arange(len(rule.offsets))),
    )


def some_cells(rule: Quadrature, which: slice) -> Quadrature:
    """The part of a rule in some cells, given by position: a view, which takes no memory."""
    begin, end = rule.offsets[which.start], rule.offsets[which.stop]

    def part(a: Any) -> Any:
        return None if a is None else a[begin:end]

    return replace(
        rule,
        points=part(rule.points),
        weights=part(rule.weights),
        normals=part(rule.normals),
        sets=part(rule.sets),
        parameters=part(rule.parameters),
        cells=rule.cells[which],
        neighbours=None if rule.neighbours is None else rule.neighbours[which],
        offsets=rule.offsets[which.start : which.stop + 1] - begin,
    )


def in_space(rule: Quadrature) -> Quadrature:
    """A rule in space, with `parameters` also if there is no map; one that is there already."""
    if rule.parameters is not None:
        return rule
    return replace(rule, parameters=rule.points) if rule.through is None else rule.in_space()


def _cofactors(J: FloatArray, n: FloatArray) -> FloatArray:
    """Cofactor matrices of J (n, 3, 3) times vectors (n, 3)."""
    columns = [np.cross(J[:, :, (k + 1) % 3], J[:, :, (k + 2) % 3]) for k in range(3)]
    return np.asarray(np.einsum("nck,nk->nc", np.stack(columns, axis=2), n))
