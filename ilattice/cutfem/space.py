"""Tensor B-splines on a background grid: the functions that matter.

A `SplineSpace` has the functions whose support meets an active cell: one in or cut, and not
dropped. Planes between cells are knots of which each repetition takes one continuous derivative: by
default there is one, and p - 1 derivatives of degree p are continuous; with p of them, smoothness
0, the functions span those of finite elements. Open directions have end knots repeated p + 1 times,
so that on an end face the functions of the first layer alone are not zero; closed directions wrap.
Degree 1 are the trilinear functions of Hong et al. 2025, section 4.

Guarantees: the functions add up to one in every active cell, and reproduce polynomials of their
degree in parameters; a map in the space of all functions has exact rigid modes. Non-guarantee:
outside the active cells the field of the nearest one is continued, by at most one cell.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from ilattice._typing import AnyArray, ArrayLike, FloatArray, IntArray
from ilattice._validate import as_points, read_only
from ilattice.bspline._kernels import monomial_table
from ilattice.bspline.knots import design_matrix, greville, wrapped_knots
from ilattice.cutfem import _kernels_basis as kernels
from ilattice.cutfem.grid import Grid
from ilattice.errors import InputError

DEGREES = (1, 2, 3)
IDENTITY = read_only(np.eye(3)[None])


@dataclass(frozen=True, eq=False)
class SplineSpace:
    """B-splines on the active cells of a grid.

    Attributes
    ----------
    grid : Grid
        The cells.
    degree : int
        1, 2 or 3 in every direction.
    cells : ndarray, shape (cells,)
        Numbers of the active cells, increasing.
    smoothness : int
        Number of derivatives that are continuous across the faces of cells, 0 to degree - 1.
    """

    grid: Grid
    degree: int
    cells: IntArray
    smoothness: int

    def __post_init__(self) -> None:
        p = as_degree_and_smoothness(self.degree, self.smoothness)[0]
        for a in range(3):
            if self.grid.closed[a] and self.step * self.grid.shape[a] < p + 1:
                raise InputError(
                    f"cells: the domain is closed in direction {'uvw'[a]} and needs at least "
                    f"{-(-(p + 1) // self.step)} cells there for degree {p} and smoothness "
                    f"{self.smoothness}, got {self.grid.shape[a]}"
                )
        cells = np.unique(np.asarray(self.cells, np.int64))
        if not len(cells) or cells[0] < 0 or cells[-1] >= np.prod(self.grid.shape):
            raise InputError("cells must name one or more cells of the grid")
        object.__setattr__(self, "cells", read_only(cells))

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
        return tuple(out)

    @cached_property
    def tables(self) -> tuple[FloatArray, ...]:
        """Per direction the centred monomial coefficients (cells, p + 1, p + 1) of functions."""
        p = self.degree
        return tuple(
            monomial_table(np.array(t), p, p + self.step * np.arange(n))
            for t, n in zip(self.knots, self.grid.shape, strict=True)
        )

    @cached_property
    def places(self) -> IntArray:
        """Index (cells, 3) of the active cells per direction."""
        return np.stack(np.unravel_index(self.cells, self.grid.shape), axis=1)

    @cached_property
    def boxes(self) -> FloatArray:
        """Lower corner and extent (cells, 6) of the active cells."""
        return self.grid.boxes(self.cells)

    def numbers(self, places: IntArray, layers: tuple[int, int, int]) -> IntArray:
        """Numbers, among all functions, of those from the first one of each cell on.

        Parameters
        ----------
        places : ndarray, shape (n, 3)
            Index of cells per direction.
        layers : tuple of int
            How many functions per direction.

        Returns
        -------
        ndarray, shape (n, product of layers)
            The last direction runs fastest.
        """
        i, j, k = (
            (self.step * places[:, a, None] + np.arange(layers[a])) % self.shape[a]
            for a in range(3)
        )  # fmt: skip
        flat = (i[:, :, None, None] * self.shape[1] + j[:, None, :, None]) * self.shape[2]
        return (flat + k[:, None, None, :]).reshape(len(places), layers[0] * layers[1] * layers[2])

    @cached_property
    def functions(self) -> IntArray:
        """Numbers (n,) of the active functions among all, increasing."""
        active = np.zeros(int(np.prod(self.shape)), bool)
        active[self.numbers(self.places, (self.degree + 1,) * 3)] = True
        return read_only(np.flatnonzero(active))

    @cached_property
    def position(self) -> AnyArray:
        """Place of each function among the active ones, or -1; int32."""
        out = np.full(int(np.prod(self.shape)), -1, np.int32)
        out[self.functions] = np.arange(len(self.functions))
        return read_only(out)

    @cached_property
    def dofs(self) -> AnyArray:
        """Active functions (cells, (p + 1)³) of each active cell, int32."""
        return read_only(self.position[self.numbers(self.places, (self.degree + 1,) * 3)])

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
        at = np.empty((len(u), 3), np.int64)
        far = np.zeros(len(u), bool)
        for a, x in enumerate(self.grid.axes):
            at[:, a] = np.clip(np.searchsorted(x, u[:, a], side="right") - 1, 0, len(x) - 2)
            if not self.grid.closed[a]:
                far |= (u[:, a] < 2.0 * x[0] - x[1]) | (u[:, a] > 2.0 * x[-1] - x[-2])
        return np.where(far, -1, self._nearest[tuple(at.T)])

    @cached_property
    def _nearest(self) -> IntArray:
        """Position in `cells` of the nearest active cell of all cells, -1 if far away."""
        from scipy.ndimage import distance_transform_edt

        active = np.full(self.grid.shape, -1, np.int64)
        active.ravel()[self.cells] = np.arange(len(self.cells))
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
        u = as_points("u", u)
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
            *self.tables, self.places, self.boxes, self.dofs, owner, wrapped,
            np.ascontiguousarray(J), np.ascontiguousarray(c), value, gradient,
        )  # fmt: skip
        return value, gradient

    @cached_property
    def sites(self) -> tuple[FloatArray, ...]:
        """Greville abscissae per direction, inside the domain."""
        out = []
        for a in range(3):
            x = greville(self.knots[a], self.degree)[: self.shape[a]]
            lo, hi = self.grid.axes[a][[0, -1]]
            out.append(lo + np.mod(x - lo, hi - lo) if self.grid.closed[a] else np.clip(x, lo, hi))
        return tuple(out)

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
        fixed = fixed or {}
        sites = [x[[fixed[a]]] if a in fixed else x for a, x in enumerate(self.sites)]
        u = np.stack(np.meshgrid(*sites, indexing="ij"), -1).reshape(-1, 3)
        c = np.asarray(f(u), np.float64).reshape(*(len(x) for x in sites), -1)
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
    if isinstance(degree, bool) or degree not in DEGREES:
        raise InputError(f"degree must be 1, 2 or 3, got {degree!r}")
    r = degree - 1 if smoothness is None else smoothness
    if isinstance(r, bool) or r not in range(degree):
        raise InputError(
            f"smoothness must be a whole number from 0 to degree - 1 = {degree - 1}, got {r!r}"
        )
    return int(degree), int(r)
