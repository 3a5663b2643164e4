"""Fits: from samples on a tensor grid, or from a field, to a `BSpline`.

`fit` samples a field itself and, given a tolerance, refines until an error measured at fresh
points is below it. The functions for given samples are collected here by name; `sites` says
where they want their samples.

Guarantees: `fit` with a tolerance returns a spline whose error at quasi-random points that no fit
has seen, those on the faces of the domain included, is below it, or raises. Non-guarantee: the
error between those points.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from ilattice._field import owns
from ilattice._geometry import grid_points
from ilattice._shown import Shown
from ilattice._typing import ArrayLike, FloatArray
from ilattice._validate import (
    as_array,
    as_flag,
    as_positive,
    as_whole,
    asked,
    check_finite,
    per_direction,
)
from ilattice.bspline.fit_common import (
    METHODS,
    Direction,
    directions,
    sites,
    to_spline,
)
from ilattice.bspline.fit_direct import (
    fit_greville,
    fit_interpolate,
    fit_least_squares,
    fit_uniform_sampling,
    greville_operator,
    interpolation_operator,
    least_squares_operator,
)
from ilattice.bspline.fit_lspia import fit_lspia
from ilattice.bspline.knots import as_degree, uniform_knots
from ilattice.bspline.lines import LineOperator, apply_all, identity_operator
from ilattice.bspline.quasi import fit_quasi, quasi_operator
from ilattice.bspline.spline import BSpline
from ilattice.errors import ConvergenceError, InputError

__all__ = [
    "METHODS",
    "FitReport",
    "fit",
    "fit_greville",
    "fit_interpolate",
    "fit_least_squares",
    "fit_lspia",
    "fit_quasi",
    "fit_report",
    "fit_uniform_sampling",
    "sites",
]

#: Most spans per direction that `fit` refines to, for one, two and three parameters.
MAX_SPANS = {1: 4096, 2: 512, 3: 128}
#: Most spans per direction, and most checks of the error, that may be asked for: bounds for
#: mistakes.
MAX_ASKED_SPANS, MAX_CHECKS = 1 << 20, 10_000_000
#: Sites that are evaluated at once: this limits the memory.
SLAB_POINTS = 1 << 18

_OPERATORS: dict[str, Callable[[Direction], LineOperator]] = {
    "least-squares": least_squares_operator,
    "interpolate": interpolation_operator,
    "greville": greville_operator,
    "uniform-sampling": lambda d: identity_operator(d.n),
    "quasi": quasi_operator,
}


@dataclass(frozen=True)
class FitReport(Shown):
    """What a fit reached.

    Attributes
    ----------
    error : float
        Largest deviation from the field at the check points, over all components.
    rms : float
        Root mean square of the deviations.
    spans : tuple of int
        Spans per direction.
    evaluations : int
        Number of points at which the field was evaluated, checks included.
    history : tuple
        Pairs of spans and error, one per refinement.
    """

    error: float
    rms: float
    spans: tuple[int, ...]
    evaluations: int
    history: tuple[tuple[tuple[int, ...], float], ...]


def fit(
    field: Any,
    *,
    domain: ArrayLike = ((0.0, 0.0, 0.0), (1.0, 1.0, 1.0)),
    degree: int | Sequence[int] = 2,
    spans: int | Sequence[int] = 8,
    method: str = "least-squares",
    periodic: bool | Sequence[bool] = False,
    tol: float | None = None,
    max_spans: int | None = None,
    checks: int = 4096,
) -> BSpline:
    """Spline that approximates a field.

    Parameters
    ----------
    field : callable
        Takes points (n, nd), returns values (n,) or (n, m). If it has ``grid(axes)``, that
        is used for the samples.
    domain : array_like, shape (2, nd)
        Lower and upper corner.
    degree : int or sequence of int
        Degrees, 0 to 8.
    spans : int or sequence of int
        Equal knot spans per direction; with `tol`, to start with.
    method : str
        One of `METHODS`.
    periodic : bool or sequence of bool
        Periodic directions.
    tol : float, optional
        Largest deviation allowed at the check points. The spans of the directions with the
        largest jumps of the highest derivative are doubled until it is met.
    max_spans : int, optional
        Most spans per direction; default 4096, 512, 128 for one, two, three parameters.
    checks : int
        Number of check points, new ones after every refinement.

    Returns
    -------
    BSpline
        The spline; `fit_report` also says how good it is.

    Raises
    ------
    InputError
        If an argument is wrong, or the field returns wrong shapes or values that are not finite.
    ConvergenceError
        If `tol` is not met within `max_spans`; the message says what was reached.
    """
    setup, counts = _as_setup(field, domain, degree, spans, method, periodic)
    if tol is None:
        return setup.spline(counts)[0]
    return _refine(setup, counts, tol, max_spans, checks)[0]


def fit_report(
    field: Any,
    *,
    domain: ArrayLike = ((0.0, 0.0, 0.0), (1.0, 1.0, 1.0)),
    degree: int | Sequence[int] = 2,
    spans: int | Sequence[int] = 8,
    method: str = "least-squares",
    periodic: bool | Sequence[bool] = False,
    tol: float | None = None,
    max_spans: int | None = None,
    checks: int = 4096,
) -> tuple[BSpline, FitReport]:
    """As `fit`, with the error that was reached; without `tol` it is measured, not bounded.

    Parameters
    ----------
    field : callable
        As in `fit`, like all other arguments.
    domain : array_like, shape (2, nd)
        Lower and upper corner.
    degree : int or sequence of int
        Degrees.
    spans : int or sequence of int
        Spans per direction.
    method : str
        One of `METHODS`.
    periodic : bool or sequence of bool
        Periodic directions.
    tol : float, optional
        Largest deviation allowed.
    max_spans : int, optional
        Most spans per direction.
    checks : int
        Number of check points.

    Returns
    -------
    spline : BSpline
        The spline.
    report : FitReport
        Error, spans and evaluations.
    """
    setup, counts = _as_setup(field, domain, degree, spans, method, periodic)
    return _refine(setup, counts, tol, max_spans, checks)


def _as_setup(
    field: Any, domain: Any, degree: Any, spans: Any, method: str, periodic: Any
) -> tuple["_Setup", tuple[int, ...]]:
    """Checked arguments of `fit`."""
    box = as_array("domain", domain, ndim=2)
    nd = box.shape[1]
    if box.shape[0] != 2 or not 1 <= nd <= 3 or not (box[0] < box[1]).all():
        raise InputError(
            "domain must hold a lower and an upper corner, shape (2, 1 to 3), lower < upper, "
            f"got {domain!r:.80}"
        )
    degrees = tuple(as_degree("degree", v) for v in per_direction("degree", degree, nd))
    wraps = tuple(as_flag("periodic", v) for v in per_direction("periodic", periodic, nd))
    counts = tuple(per_direction("spans", spans, nd))
    return _Setup(field, box, degrees, wraps, method), counts


def _refine(
    setup: "_Setup", counts: tuple[int, ...], tol: float | None, max_spans: int | None, checks: int
) -> tuple[BSpline, FitReport]:
    """Fit, measure, double spans, until the error is below the tolerance."""
    bound = np.inf if tol is None else as_positive("tol", tol)
    nd = setup.box.shape[1]
    limit = (
        MAX_SPANS[nd] if max_spans is None else as_whole("max_spans", max_spans, 1, MAX_ASKED_SPANS)
    )
    checks = as_whole("checks", checks, 1, MAX_CHECKS)
    history: list[tuple[tuple[int, ...], float]] = []
    evaluations = 0
    while True:
        spline, used = setup.spline(counts)
        error, rms = setup.deviation(spline, checks, len(history))
        history.append((counts, error))
        evaluations += used + checks
        if error <= bound:
            return spline, FitReport(error, rms, counts, evaluations, tuple(history))
        counts = _refined(spline, counts, limit, error, bound)


@dataclass(frozen=True)
class _Setup:
    """A field, where and how to fit it."""

    field: Any
    box: FloatArray
    degree: tuple[int, ...]
    periodic: tuple[bool, ...]
    method: str

    def spline(self, counts: Sequence[int]) -> tuple[BSpline, int]:
        """Fit with the given spans; also the number of samples taken."""
        t = [
            uniform_knots(s, k, ends, p)
            for s, k, ends, p in zip(counts, self.degree, self.box.T, self.periodic, strict=True)
        ]
        dirs = directions(t, self.degree, self.periodic, self.method, None)
        size = int(np.prod([len(d.sites) for d in dirs]))
        if self.method == "lspia":
            f = np.concatenate(list(self.slabs(dirs)))
            return fit_lspia(f, t, self.degree, periodic=self.periodic), size
        operators = [_OPERATORS[self.method](d) for d in dirs]
        parts = [apply_all(operators, f, first=1) for f in self.slabs(dirs)]
        return to_spline(operators[0].along(np.concatenate(parts), 0), dirs), size

    def slabs(self, dirs: Sequence[Direction]) -> Any:
        """Samples on the sites, slab by slab of the first direction."""
        axes = [d.sites for d in dirs]
        rest = int(np.prod([len(x) for x in axes[1:]]))
        step = max(1, SLAB_POINTS // rest)
        for i in range(0, len(axes[0]), step):
            yield self.sample([axes[0][i : i + step], *axes[1:]])

    def sample(self, axes: list[FloatArray]) -> FloatArray:
        """Values of the field on a tensor grid."""
        shape = tuple(len(x) for x in axes)
        if owns(self.field, "grid"):
            return self.checked(asked("grid of field", self.field.grid, tuple(axes)), shape)
        points = grid_points(*axes)
        values = self.checked(asked("field", self.field, points), (len(points),))
        return values.reshape(shape + values.shape[1:])

    def checked(self, values: Any, shape: tuple[int, ...]) -> FloatArray:
        """Values of the right shape, finite."""
        f = as_array("values", values, finite=False)
        if f.shape[: len(shape)] != shape or f.ndim > len(shape) + 1:
            raise InputError(
                f"field must return values of shape {shape} or {(*shape, 'm')}, got {f.shape}"
            )
        return check_finite("values of field", f)

    def deviation(self, spline: BSpline, checks: int, turn: int) -> tuple[float, float]:
        """Largest and rms deviation at quasi-random points, other ones every turn."""
        u = check_points(self.box, checks, turn)
        f = self.checked(asked("field", self.field, u), (len(u),))
        d = spline(u, extrapolate="clamp") - f
        return float(np.abs(d).max()), float(np.sqrt(np.mean(d * d)))


def check_points(box: FloatArray, count: int, turn: int = 0) -> FloatArray:
    """Quasi-random points of a box, shape (count, nd), some of them on its faces.

    A Kronecker sequence with the powers of the generalised golden ratio (Roberts 2018),
    stretched by 5 % and clipped. Turns take successive stretches of one sequence.
    """
    nd = box.shape[1]
    ratio = 1.0
    for _ in range(60):
        ratio = (1.0 + ratio) ** (1.0 / (nd + 1))
    i = np.arange(1 + turn * count, 1 + (turn + 1) * count)[:, None]
    s = np.mod(0.5 + i * ratio ** -np.arange(1.0, nd + 1), 1.0)
    return box[0] + np.clip(1.05 * s - 0.025, 0.0, 1.0) * (box[1] - box[0])


def _refined(
    spline: BSpline, counts: tuple[int, ...], limit: int, error: float, tol: float
) -> tuple[int, ...]:
    """Doubled spans where the highest derivative jumps most, or `ConvergenceError`."""
    jumps = np.array([jump(spline, axis) for axis in range(spline.ndim)])
    wanted = jumps >= 0.1 * jumps.max()
    out = tuple(2 * s if w and 2 * s <= limit else s for s, w in zip(counts, wanted, strict=True))
    if out == counts:
        raise ConvergenceError(
            f"the fit reached an error of {error:.3g} with {counts} spans, tol asks for {tol:.3g}; "
            f"raise max_spans (now {limit}) or tol, or fit a smoother field"
        )
    return out


def jump(spline: BSpline, axis: int) -> float:
    """Scaled jump of the k-th derivative along an axis: as the error, of order h**(k + 1)."""
    k, h = spline.k[axis], np.diff(spline.breaks(axis)).mean()
    for _ in range(k):
        spline = spline.derivative(axis)
    c = np.diff(spline.c, axis=axis) if spline.c.shape[axis] > 1 else spline.c
    return float(np.abs(c).max() * h**k)
