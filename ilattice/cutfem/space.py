"""Tensor B-splines on a background grid: the functions that matter.

A `SplineSpace` has the functions whose support meets an active cell: one in or cut, and not
dropped. Planes between cells are knots of which each repetition takes one continuous derivative: by
default there is one, and p - 1 derivatives of degree p are continuous; with p of them, smoothness
0, the functions span those of finite elements. Open directions have end knots repeated p + 1 times,
so that on an end face the functions of the first layer alone are not zero; closed directions wrap.
Degree 1 are the trilinear functions of Hong et al. 2025, section 4.

Guarantees: the functions add up to one in every active cell, and reproduce polynomials of their
degree in parameters; a map in the space of all functions has exact rigid modes. With `links` the
solid in the support of a function is connected: where it falls apart, as across a gap, every part
has a copy of the function (P. Hansbo and M. Larson, 2004, did so for cracks). Non-guarantee:
outside the active cells the field of the nearest one is continued, by at most one cell.
"""

from collections.abc import Callable
from dataclasses import dataclass, fields
from functools import cached_property
from typing import Any

import numpy as np
from scipy.ndimage import distance_transform_edt

from ilattice._geometry import cells_at, grid_points, within, wrapped
from ilattice._typing import AnyArray, ArrayLike, FloatArray, IntArray
from ilattice._validate import (
    Frozen,
    as_array,
    as_axis,
    as_choice,
    as_kind,
    as_points,
    as_whole,
    asked,
    read_only,
    seen,
)
from ilattice.bspline import _kernels_basis as kernels
from ilattice.bspline._kernels import monomial_table
from ilattice.bspline.knots import design_matrix, greville, wrapped_knots
from ilattice.cutfem._kernels_copies import components
from ilattice.errors import InputError
from ilattice.quadrature.grid import DividedGrid, Grid

#: Degrees of the spaces.
DEGREES = (1, 2, 3)
CHUNKS = 16  # of functions, each with scratch for all cells
IDENTITY = read_only(np.eye(3)[None])


@dataclass(frozen=True, eq=False)
class SplineSpace(Frozen):
    """B-splines on the active cells of a grid.

    Attributes
    ----------
    grid : Grid
        The cells.
    degree : int
        1, 2 or 3 in every direction.
    cells : ndarray, shape (cells,)
        Numbers of the active cells, or elements, increasing.
    smoothness : int
        Number of derivatives that are continuous across the faces of cells, 0 to degree - 1.
    links : tuple of ndarray, shape (n,), or None
        Pairs of elements that hang together through a face. A function is copied for every
        connected part of its support; without links none is.
    """

    grid: Grid
    degree: int
    cells: IntArray
    smoothness: int
    links: tuple[IntArray, IntArray] | None = None

    def __post_init__(self) -> None:
        p = as_degree_and_smoothness(self.degree, self.smoothness)[0]
        as_kind("grid", self.grid, "Grid")
        for a in range(3):
            if self.grid.closed[a] and self.step * self.grid.shape[a] < p + 1:
                raise InputError(
                    f"cells: the domain is closed in direction {'uvw'[a]} and needs at least "
                    f"{-(-(p + 1) // self.step)} cells there for degree {p} and smoothness "
                    f"{self.smoothness}, got {self.grid.shape[a]}"
                )
        given = as_array("cells", self.cells)
        whole = (given == np.rint(given)) & (given >= 0) & (given < self.grid.count + self._beyond)
        if not given.size or not whole.all():
            raise InputError("cells must name one or more cells of the grid")
        cells = np.unique(given.astype(np.int64))
        object.__setattr__(self, "cells", read_only(cells))
        super().__post_init__()

    def __getstate__(self) -> dict[str, Any]:
        """For `pickle` and `copy.deepcopy`, without what is made again when needed."""
        return {f.name: getattr(self, f.name) for f in fields(self)}

    def __len__(self) -> int:
        return len(self.functions)

    def __repr__(self) -> str:
        kind = f"degree {self.degree}, smoothness {self.smoothness}"
        return f"SplineSpace({kind}, {len(self)} functions, {len(self.cells)} cells)"

    # ---------------------------------------------------------------- numbering

    @property
    def step(self) -> int:
        """Functions that each further cell brings in a direction: repetitions of its knot."""
        return self.degree - self.smoothness

    @property
    def shape(self) -> tuple[int, int, int]:
        """Number of functions per direction, active or not."""
        p, m = self.degree, self.step
        cells, closed = self.grid.shape, self.grid.closed
        a, b, c = (m * n if w else m * (n - 1) + p + 1 for n, w in zip(cells, closed, strict=True))
        return a, b, c

    @cached_property
    def knots(self) -> tuple[FloatArray, ...]:
        """Knots per direction; the first cell is behind knot p, and each further one `step` on."""
        p, m = self.degree, self.step
        out = []
        for x, closed in zip(self.grid.axes, self.grid.closed, strict=True):
            inner = np.repeat(x[1:-1], m)
            if closed:
                base = np.concatenate([x[:1], inner, np.full(m - 1, x[-1])])
                out.append(wrapped_knots(base, p, float(x[-1])))
            else:
                out.append(np.concatenate([np.full(p + 1, x[0]), inner, np.full(p + 1, x[-1])]))
        return tuple(map(read_only, out))

    @property
    def tables(self) -> tuple[FloatArray, ...]:
        """Per direction the centred monomial coefficients (cells, p + 1, p + 1) of functions."""
        return tuple(map(seen, self._tables))

    @property
    def cell_indices(self) -> IntArray:
        """Index (cells, 3) of the active cells per direction."""
        return seen(self._ijk)

    @property
    def boxes(self) -> FloatArray:
        """Lower corner and extent (cells, 6) of the active cells."""
        return seen(self._boxes)

    @cached_property  # this and the next two are for compiled code: not read-only
    def _tables(self) -> tuple[FloatArray, ...]:
        p = self.degree
        return tuple(
            monomial_table(np.array(t), p, p + self.step * np.arange(n))
            for t, n in zip(self.knots, self.grid.shape, strict=True)
        )

    @cached_property
    def _ijk(self) -> IntArray:
        return self.grid.cell_indices(self.cells)

    @cached_property
    def _boxes(self) -> FloatArray:
        return self.grid.boxes(self.cells)

    @cached_property
    def homes(self) -> tuple[IntArray, IntArray]:
        """Index (n, 3) per direction of the cells of the grid, and the one of each active cell."""
        cells, at = np.unique(self.grid.home(self.cells), return_inverse=True)
        ijk = np.stack(np.unravel_index(cells, self.grid.shape), axis=1)
        return read_only(ijk), read_only(at.ravel())

    @property
    def _beyond(self) -> int:
        """Number of elements beyond one per cell."""
        return len(self.grid.parents) if isinstance(self.grid, DividedGrid) else 0

    def _numbers(self, ijk: IntArray, layers: tuple[int, int, int]) -> IntArray:
        """Numbers (n, product of layers), among all functions, from the first of each cell on."""
        i, j, k = (
            (self.step * ijk[:, a, None] + np.arange(layers[a])) % self.shape[a]
            for a in range(3)
        )  # fmt: skip
        flat = (i[:, :, None, None] * self.shape[1] + j[:, None, :, None]) * self.shape[2]
        return (flat + k[:, None, None, :]).reshape(len(ijk), layers[0] * layers[1] * layers[2])

    @cached_property
    def _numbered(self) -> tuple[IntArray, AnyArray]:
        """Numbers of the active functions among all, and those of each active cell."""
        numbers = self._numbers(self.cell_indices, (self.degree + 1,) * 3)
        active = np.zeros(int(np.prod(self.shape)), bool)
        active[numbers] = True
        functions = np.flatnonzero(active)
        first = np.full(len(active), -1, np.int32)
        first[functions] = np.arange(len(functions))
        if self.links is None:
            return read_only(functions), read_only(first[numbers])
        part, copies = self._components(functions)
        first[functions] = np.append(0, np.cumsum(copies)[:-1])
        return read_only(np.repeat(functions, copies)), read_only(first[numbers] + part)

    def _components(self, functions: IntArray) -> tuple[AnyArray, IntArray]:
        """Connected part of the support to which each function of each cell belongs.

        And the number of these parts per function.
        """
        assert self.links is not None
        n = len(self.cells)
        home = self.grid.home(self.cells)
        first, after = np.full(self.grid.count, -1, np.int64), np.full(n, -1, np.int64)
        first[home[::-1]] = np.arange(n)[::-1]
        more = np.argsort(home, kind="stable")
        same = home[more[1:]] == home[more[:-1]]
        after[more[:-1][same]] = more[1:][same]
        low, high = self.links
        keep = np.isin(low, self.cells) & np.isin(high, self.cells)
        low, high = (np.searchsorted(self.cells, c[keep]) for c in (low, high))
        order = np.argsort(low, kind="stable")
        begin = np.append(0, np.cumsum(np.bincount(low, minlength=n)))
        out = np.zeros((n, (self.degree + 1) ** 3), np.int32)
        copies = np.ones(len(functions), np.int64)
        components(
            CHUNKS, np.array(self.grid.shape), np.array(self.shape), self.step, self.degree,
            functions, np.array(self.grid.closed), first, after, begin, high[order], CHUNKS, out,
            copies,
        )  # fmt: skip
        return out, copies

    @property
    def functions(self) -> IntArray:
        """Numbers (n,) of the active functions among all, increasing; copies have the same."""
        return self._numbered[0]

    @property
    def dofs(self) -> AnyArray:
        """Active functions (cells, (p + 1)³) of each active cell, int32."""
        return self._numbered[1]

    # ---------------------------------------------------------------- fields

    def locate(self, u: FloatArray) -> IntArray:
        """Active cell of points.

        Parameters
        ----------
        u : ndarray, shape (n, 3)
            Parameters.

        Returns
        -------
        ndarray, shape (n,)
            Positions in `cells`; -1 where no active cell is nearer than one cell.
        """
        u = as_points("u", u, finite=False)
        lo, hi = np.array([(2 * x[0] - x[1], 2 * x[-1] - x[-2]) for x in self.grid.axes]).T
        near = ((u >= lo) & (u <= hi) | self.grid.closed).all(axis=1)
        first, last = self.grid.domain
        inside = wrapped(u, first, last, self.grid.closed)
        out = np.where(near, self._nearest[tuple(cells_at(self.grid.axes, inside).T)], -1)
        return self._among_several(out, inside)

    def _among_several(self, found: IntArray, u: FloatArray) -> IntArray:
        """Of cells with several elements, the one in which points are; -1 if it is not active."""
        grid = self.grid
        if not isinstance(grid, DividedGrid) or not len(grid.several):
            return found
        home = grid.home(self.cells)[found]
        mine = np.flatnonzero((found >= 0) & np.isin(home, grid.several))
        element = grid.element_at(u[mine], home[mine])
        at = np.minimum(np.searchsorted(self.cells, element), len(self.cells) - 1)
        found[mine] = np.where(self.cells[at] == element, at, -1)
        return found

    @cached_property
    def _nearest(self) -> IntArray:
        """Position in `cells` of the nearest active cell of all cells, -1 if far away."""
        active = np.full(self.grid.shape, -1, np.int64)
        active.ravel()[self.grid.home(self.cells)] = np.arange(len(self.cells))
        pad = [(1, 1) if closed else (0, 0) for closed in self.grid.closed]
        inner = tuple(slice(1, -1) if closed else slice(None) for closed in self.grid.closed)
        wide = np.pad(active, pad, mode="wrap")
        far, index = distance_transform_edt(wide < 0, return_indices=True)
        return np.where(far < 1.8, wide[tuple(index)], -1)[inner]

    def evaluate(
        self, c: FloatArray, u: ArrayLike, J: FloatArray = IDENTITY
    ) -> tuple[FloatArray, FloatArray]:
        """Values and gradients of a field.

        Parameters
        ----------
        c : ndarray, shape (functions, m)
            Coefficients of the active functions.
        u : array_like, shape (n, 3)
            Parameters.
        J : ndarray, shape (n, 3, 3) or (1, 3, 3)
            Jacobians of the map; by default gradients are those in parameters.

        Returns
        -------
        tuple of ndarray
            Values (n, m) and gradients (n, m, 3); NaN where no active cell is near.
        """
        u, c = as_points("u", u), as_array("c", c, ndim=2, finite=False)
        if len(c) != len(self):
            raise InputError(f"c must have {len(self)} rows, one per function, got {len(c)}")
        J = as_array("J", J, ndim=3, finite=False)
        if J.shape not in ((1, 3, 3), (len(u), 3, 3)):
            raise InputError(f"J must have shape (1, 3, 3) or ({len(u)}, 3, 3), got {J.shape}")
        owner = self.locate(u)
        at = np.maximum(owner, 0)
        wrapped = u.copy()
        for a in np.flatnonzero(self.grid.closed):  # the cell may be on the other side of the seam
            x = self.grid.axes[a]
            middle = self.boxes[at, a] + 0.5 * self.boxes[at, 3 + a]
            period = x[-1] - x[0]
            wrapped[:, a] -= period * np.rint((u[:, a] - middle) / period)
        value = np.empty((len(u), c.shape[1]))
        gradient = np.empty((len(u), c.shape[1], 3))
        kernels.fields(
            len(u), *self._tables, self._ijk, self._boxes, self.dofs, owner, wrapped,
            J, c, value, gradient,
        )  # fmt: skip
        return value, gradient

    @cached_property
    def sites(self) -> tuple[FloatArray, ...]:
        """Greville abscissae per direction, inside the domain."""
        out = []
        for a in range(3):
            x = greville(self.knots[a], self.degree)[: self.shape[a]]
            lo, hi = self.grid.axes[a][[0, -1]]
            out.append(within(x, lo, hi, self.grid.closed[a]))
        return tuple(map(read_only, out))

    def interpolate(
        self, f: Callable[[FloatArray], Any], *, fixed: dict[int, int] | None = None
    ) -> FloatArray:
        """Coefficients of all functions that interpolate at the Greville abscissae.

        Parameters
        ----------
        f : callable
            Takes parameters (n, 3), returns values (n, m).
        fixed : dict of int to int, optional
            Direction to number of the one layer of functions that is wanted: on an end face.

        Returns
        -------
        ndarray, shape (n0, n1, n2, m)
            Coefficients; polynomials of the degree of the space are reproduced.
        """
        fixed = {} if fixed is None else fixed
        if not isinstance(fixed, dict):
            raise InputError(f"fixed must be a dict of directions to layers, got {fixed!r:.80}")
        for a, layer in fixed.items():
            as_whole(f"fixed[{a}]", layer, 0, self.shape[as_axis("fixed", a)] - 1)
        sites = [x[[fixed[a]]] if a in fixed else x for a, x in enumerate(self.sites)]
        u = grid_points(*sites)
        c = as_array("f", asked("f", f, u), finite=False).reshape(*(len(x) for x in sites), -1)
        for a in range(3):
            if a not in fixed and self.degree > 1:
                periodic = bool(self.grid.closed[a])
                A = design_matrix(self.knots[a], self.degree, sites[a], periodic=periodic)
                rows = np.moveaxis(c, a, 0)
                solved = np.linalg.solve(A.toarray(), rows.reshape(len(sites[a]), -1))
                c = np.moveaxis(solved.reshape(rows.shape), 0, a)
        return c


def as_degree_and_smoothness(degree: Any, smoothness: Any) -> tuple[int, int]:
    """Degree 1, 2 or 3, and smoothness from 0 to degree - 1, or `InputError`.

    Without a smoothness it is the greatest.
    """
    as_choice("degree", degree, DEGREES)
    r = degree - 1 if smoothness is None else smoothness
    if not isinstance(r, (int, np.integer)) or isinstance(r, bool) or r not in range(degree):
        raise InputError(
            f"smoothness must be a whole number from 0 to degree - 1 = {degree - 1}, got {r!r}"
        )
    return int(degree), int(r)
