"""The implicit function of a lattice of different tiles: blended exactly, then fitted.

Points are tile coordinates: cell (i, j, k) is the box from (i, j, k) to (i+1, j+1, k+1). Beyond
the open ends of the lattice the outermost cells are repeated and weights go on by point reflection.

Guarantees: the blend of tiles is at least C1; the spline is C2, periodic in closed directions.
Non-guarantee: the error of the spline is measured at quasi-random points, not bounded.
"""

import warnings
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

from ilattice._field import Field
from ilattice._geometry import grid_points, spread_points
from ilattice._typing import AnyArray, ArrayLike, FloatArray, IntArray
from ilattice._validate import as_array, asked
from ilattice.bspline import BSpline
from ilattice.bspline.fit import fit_report, jump
from ilattice.errors import InputError, PrecisionWarning
from ilattice.tiles.tile import Tile
from ilattice.tiles.trig import TrigField

#: Degree of the splines of mixed cells.
DEGREE = 3
#: Spans per tile edge that the fit starts with, and at most.
MIN_SPANS, MAX_SPANS = 8, 32
#: Points at which the error of the fit is measured: per tile, at least, and at most.
CHECKS_PER_TILE, MIN_CHECKS, MAX_CHECKS = 32, 1 << 12, 1 << 16
#: Samples of a tile per edge, and how many are taken to lie at its zero set in any case.
SAMPLES, FEW = 24, 16


@dataclass(frozen=True, eq=False)
class MixedField(Field):
    """The implicit function of a whole lattice in tile coordinates, a spline.

    Attributes
    ----------
    spline : BSpline
        Cubic; over the tiles and, in open directions, a layer of tiles around them.
    fields : tuple of TrigField or BSpline
        Fields of the tiles in it.
    error : float
        Largest deviation from the exact blend that was measured, in tile edges.
    spans : tuple of int
        Spans per tile edge.
    """

    spline: BSpline
    fields: tuple[TrigField | BSpline, ...]
    error: float
    spans: tuple[int, int, int]

    @property
    def bounds(self) -> FloatArray:
        """The tiles, shape (2, 3)."""
        return self.spline.domain

    @property
    def creased(self) -> bool:
        """Whether the gradient may jump at the faces of tiles: where neighbours share them only."""
        inner = [np.unique(t[k + 1 : -k - 1], return_counts=True)[1] for t, k in self._knots]
        return any((repeats >= k).any() for repeats, k in zip(inner, self.spline.k, strict=True))

    @property
    def _knots(self) -> Iterator[tuple[AnyArray, int]]:
        return zip(self.spline.t, self.spline.k, strict=True)

    @property
    def nbytes(self) -> int:
        """Memory of the coefficients."""
        return int(self.spline.c.nbytes)

    def __call__(self, p: ArrayLike, /) -> FloatArray:
        """Values (n,) at tile coordinates (n, 3)."""
        return self.spline(p, extrapolate="extend")

    def jet(self, p: ArrayLike, order: int = 2) -> tuple[FloatArray, ...]:
        """Value and derivatives in tile coordinates.

        Parameters
        ----------
        p : ndarray, shape (n, 3)
            Tile coordinates.
        order : int
            Highest derivative: 0, 1 or 2.

        Returns
        -------
        tuple of ndarray
            Values (n,), gradients (n, 3), Hessians (n, 3, 3): the first ``order + 1`` of them.
        """
        return self.spline.jet(p, order, extrapolate="extend")


@dataclass(frozen=True, eq=False)
class Component:
    """A tile, scaled, continued beyond its cube.

    Attributes
    ----------
    field : TrigField or BSpline
        Its field.
    periodic : ndarray of bool, shape (3,)
        Directions in which it repeats smoothly.
    slope : float
        Mean length of the gradient on the zero set.
    """

    field: TrigField | BSpline
    periodic: AnyArray
    slope: float

    @classmethod
    def of(cls, tile: Tile) -> "Component":
        """Component of a tile."""
        return cls(tile.kernel_field, np.array(tile.periodic), mean_slope(tile.kernel_field))

    def __call__(self, q: FloatArray) -> FloatArray:
        """Scaled values (n,) at coordinates (n, 3) within a cell or next to it."""
        q = np.where(self.periodic, q - np.floor(q), q)
        lo, hi = np.where(self.periodic, -np.inf, 0.0), np.where(self.periodic, np.inf, 1.0)
        return continued(self.field, q, lo, hi) / self.slope


@dataclass(frozen=True, eq=False)
class Blend:
    """The exact blend.

    Attributes
    ----------
    tiles : tuple of Component
        Tiles.
    cells : ndarray of int or None
        Number of the tile of every cell.
    weight : callable or None
        Weights as a function of the parameters, instead of `cells`.
    width : float
        Width of the zone about a face.
    repeat : tuple of int
        Number of cells.
    domain : ndarray, shape (2, 3)
        Parameter box.
    closed : ndarray of bool, shape (3,)
        Directions that wrap.
    """

    tiles: tuple[Component, ...]
    cells: IntArray | None
    weight: Callable[[FloatArray], Any] | None
    width: float
    repeat: tuple[int, int, int]
    domain: FloatArray
    closed: AnyArray

    def __call__(self, p: FloatArray) -> FloatArray:
        """Values (n,) at tile coordinates (n, 3)."""
        shares = self.shares(p)
        corners = list(self._corners(p))
        out = np.zeros(len(p))
        for number, tile in enumerate(self.tiles):
            parts = [(cell, w * self._part(number, cell, shares)) for cell, w in corners]
            if tile.periodic.all():  # the cells it is continued from do not matter
                parts = [(np.floor(p), np.sum([w for _, w in parts], axis=0))]
            for cell, w in parts:
                at = np.flatnonzero(w)
                out[at] += w[at] * tile(p[at] - cell[at])
        return out

    def weights(self, p: FloatArray) -> FloatArray:
        """Weights (n, m) of the tiles at tile coordinates (n, 3): they sum to one."""
        shares = self.shares(p)
        if shares is not None:
            return shares
        out = np.zeros((len(p), len(self.tiles)))
        for cell, w in self._corners(p):
            for number in range(len(self.tiles)):
                out[:, number] += w * self._part(number, cell, None)
        return out

    def shares(self, p: FloatArray) -> FloatArray | None:
        """Weights (n, m) of the tiles at tile coordinates; None if cells are chosen."""
        if self.weight is None:
            return None
        count = np.array(self.repeat, np.float64)
        p = np.where(self.closed, np.mod(p, count), p)
        out: FloatArray = continued(self._weights, p, 0.0 * count, count)
        return out

    def _weights(self, p: FloatArray) -> FloatArray:
        """Checked weights (n, m) inside the domain."""
        lo, hi = self.domain
        u = np.minimum(lo + p / np.array(self.repeat) * (hi - lo), hi)
        assert self.weight is not None
        return normalized(asked("weight", self.weight, u), u, len(self.tiles))

    def _part(self, number: int, cell: FloatArray, shares: FloatArray | None) -> FloatArray:
        """Part of a tile in the weight of cells."""
        if shares is not None:
            return shares[:, number]
        assert self.cells is not None
        i = [
            np.mod(c, n) if wraps else np.clip(c, 0, n - 1)
            for c, n, wraps in zip(cell.T.astype(np.int64), self.repeat, self.closed, strict=True)
        ]
        out: FloatArray = (self.cells[tuple(i)] == number).astype(np.float64)
        return out

    def _corners(self, p: FloatArray) -> Iterator[tuple[FloatArray, FloatArray]]:
        """The cells (n, 3) that a point draws from, and their weights (n,), which sum to one."""
        base = np.floor(p - 0.5)
        upper = smooth_step((p - base - 1.0) / max(self.width, 1e-12) + 0.5)
        for corner in np.ndindex(2, 2, 2):
            yield base + corner, np.where(corner, upper, 1.0 - upper).prod(axis=1)

    def check_seams(self) -> None:
        """Refuse weights that differ on the two ends of a closed direction."""
        if self.weight is None:
            return
        p = spread_points(64) * np.array(self.repeat)
        for axis in np.flatnonzero(self.closed):
            ends = []
            for face in (0.0, float(self.repeat[axis])):
                p[:, axis] = face
                ends.append(self._weights(p))
            gap = float(np.abs(ends[1] - ends[0]).max())
            if gap > 1e-9:
                raise InputError(
                    f"weight must agree on both ends of direction {axis}, which is closed; it "
                    f"differs by {gap:.3g} there"
                )


def smooth_step(t: FloatArray) -> FloatArray:
    """C2 step of fifth degree from 0 for t <= 0 to 1 for t >= 1."""
    t = np.clip(t, 0.0, 1.0)
    return t * t * t * (10.0 + t * (6.0 * t - 15.0))


def continued(
    f: Callable[[FloatArray], FloatArray], p: FloatArray, lo: FloatArray, hi: FloatArray,
    axis: int = 0,
) -> FloatArray:  # fmt: skip
    """Values of f inside a box; beyond it by point reflection in its faces, which keeps f C1."""
    if axis == 3:
        return f(p)
    inside = p.copy()
    inside[:, axis] = np.clip(p[:, axis], lo[axis], hi[axis])
    out = continued(f, inside, lo, hi, axis + 1)
    beyond = np.flatnonzero(inside[:, axis] != p[:, axis])
    if len(beyond):
        mirror = inside[beyond]
        mirror[:, axis] += mirror[:, axis] - p[beyond, axis]
        out[beyond] = 2.0 * out[beyond] - continued(f, mirror, lo, hi, axis + 1)
    return out


def normalized(weights: Any, u: FloatArray, count: int) -> FloatArray:
    """Weights (n, count) that add up to one, from those of a user."""
    w = as_array("weights", weights, finite=False)
    n = len(u)
    if w.shape == (n,) and count == 2:
        w = np.stack([1.0 - w, w], axis=1)
    if w.shape != (n, count):
        share = f", or shares of the second one, shape ({n},)" if count == 2 else ""
        raise InputError(
            f"weight must return one column per tile, shape ({n}, {count}){share}; got {w.shape}"
        )
    total = w.sum(axis=1)
    bad = np.flatnonzero(~(np.isfinite(total) & (w >= 0.0).all(axis=1) & (total > 0.0)))
    if len(bad):
        raise InputError(
            "weight must return finite weights, none negative (shares between 0 and 1), that do "
            f"not all vanish; at u = {u[bad[0]].tolist()} they are {w[bad[0]].tolist()}"
        )
    return w / total[:, None]


def mean_slope(field: TrigField | BSpline) -> float:
    """Mean length of the gradient of a tile's field near its zero set, per tile edge.

    Parameters
    ----------
    field : TrigField or BSpline
        On the unit cube.

    Returns
    -------
    float
        Mean over those of 24³ points that are next to the zero set by a Newton step, after that
        step.
    """
    a = (np.arange(SAMPLES) + 0.5) / SAMPLES
    p = grid_points(a, a, a)
    f, g = field.jet(p, 1)
    with np.errstate(divide="ignore", invalid="ignore"):
        step = np.nan_to_num(np.abs(f) / np.linalg.norm(g, axis=1), nan=np.inf)
    near = step <= max(0.5 / SAMPLES, float(np.partition(step, FEW)[FEW]))
    near &= np.isfinite(step)
    move = f[near, None] * g[near] / (g[near] ** 2).sum(axis=1, keepdims=True)
    return float(np.linalg.norm(field.jet(np.clip(p[near] - move, 0.0, 1.0), 1)[1], axis=1).mean())


def fitted(blend: Blend, tol: float) -> MixedField:
    """Cubic spline for a blend, refined until its error is below the tolerance.

    Parameters
    ----------
    blend : Blend
        The exact field.
    tol : float
        Largest deviation.

    Returns
    -------
    MixedField
        The spline with the error that it reached.
    """
    count, closed = np.array(blend.repeat), blend.closed
    box = np.array([np.where(closed, 0.0, -1.0), np.where(closed, count, count + 1.0)])
    layers = (box[1] - box[0]).astype(np.int64)
    checks = int(np.clip(CHECKS_PER_TILE * layers.prod(), MIN_CHECKS, MAX_CHECKS))
    spans = np.full(3, MIN_SPANS)
    while True:
        spline, report = fit_report(
            blend, domain=box, degree=DEGREE, spans=(spans * layers).tolist(),
            method="interpolate", periodic=closed.tolist(), checks=checks,
        )  # fmt: skip
        jumps = np.array([jump(spline, axis) for axis in range(3)])
        finer = (jumps >= 0.1 * jumps.max()) & (spans < MAX_SPANS)
        if report.error <= tol or not finer.any():
            break
        spans = np.where(finer, 2 * spans, spans)
    if report.error > tol:
        warnings.warn(
            f"the spline of the mixture deviates by {report.error:.3g} tile edges from the blended "
            f"tiles (tol asks for {tol:.3g}) with {MAX_SPANS} spans per tile: are they smooth?",
            PrecisionWarning,
            stacklevel=4,
        )
    x, y, z = (int(s) for s in spans)
    return MixedField(spline, tuple(t.field for t in blend.tiles), report.error, (x, y, z))
