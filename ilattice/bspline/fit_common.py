"""What all fits share: sample sites per direction, the door for samples and knots.

Guarantee: for every method the sites of `sites` make the fit of that method well posed on the
knots it accepts. Non-guarantee: sites other than these are checked by the fits only as far as
their equations can be solved.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from ilattice._typing import ArrayLike, FloatArray
from ilattice._validate import as_array, as_flag, per_direction
from ilattice.bspline.knots import as_degree, as_knot_vector, breaks, greville, wrap
from ilattice.bspline.spline import BSpline
from ilattice.errors import InputError

METHODS = ("least-squares", "interpolate", "greville", "uniform-sampling", "lspia", "quasi")


@dataclass(frozen=True)
class Direction:
    """Knots, degree, wrap-around and sample sites of one parameter."""

    t: FloatArray
    k: int
    periodic: bool
    sites: FloatArray

    @property
    def n(self) -> int:
        """Number of distinct coefficients, without wrapped copies."""
        return len(self.t) - self.k - 1 - (self.k if self.periodic else 0)

    def stored(self, c: FloatArray, axis: int) -> FloatArray:
        """Coefficients with the wrapped copies appended along an axis."""
        if not self.periodic or self.k == 0:
            return c
        return np.take(c, np.arange(self.n + self.k) % self.n, axis=axis)


def is_uniform(t: FloatArray, k: int) -> bool:
    """Whether the knots are those of `uniform_knots`: equal spans and simple inner knots."""
    inner = np.diff(t[k : len(t) - k])
    return bool(np.ptp(inner) <= 1e-9 * inner.mean())


def sites(
    t: ArrayLike, k: int, method: str = "least-squares", periodic: bool = False
) -> FloatArray:
    """Sample sites of one direction, ascending.

    Parameters
    ----------
    t : array_like, shape (n + k + 1,)
        Knots.
    k : int
        Degree, 0 to 8.
    method : str
        One of

        - "interpolate", "greville": Greville abscissae; periodic: wrapped (for equal spans:
          midway between knots for even degrees, at knots for odd ones). Where the spline
          may jump, "interpolate" moves one of the two equal sites away from the knot.
        - "least-squares", "lspia": two per coefficient: midpoints of 2n equal cells, or,
          where the knots are not equally spaced, a quarter to both sides of each Greville
          abscissa.
        - "uniform-sampling": i / (n - 1) of the domain.
        - "quasi": midpoints of the spans, and both ends, for even degrees; knots for odd ones.
    periodic : bool
        Whether the direction is periodic; n is then the number of distinct coefficients and
        the right end is left out.

    Returns
    -------
    ndarray, shape (N,)
        Sites in the domain.

    Raises
    ------
    InputError
        If the method is unknown, or the knots are not fit for it.
    """
    k = as_degree("k", k)
    t = as_knot_vector("t", t, k, periodic=periodic)
    if not isinstance(method, str) or method not in METHODS:
        raise InputError(f"method must be one of {', '.join(METHODS)}, got {method!r}")
    n = len(t) - k - 1 - (k if periodic else 0)
    a, b = t[k], t[len(t) - k - 1]
    if method == "uniform-sampling":
        return a + np.arange(n) / (n if periodic else max(n - 1, 1)) * (b - a)
    if method == "quasi":
        return quasi_sites(t, k, periodic)
    if method in ("interpolate", "greville"):
        g = greville(t, k)[:n]
        if periodic:
            return _wrapped_sites(g, t, k)
        return _separated(np.clip(g, a, b)) if method == "interpolate" else np.clip(g, a, b)
    if is_uniform(t, k):
        return a + (np.arange(2 * n) + 0.5) / (2 * n) * (b - a)
    return _quarter_sites(t, k, n, periodic)


def _wrapped_sites(x: FloatArray, t: FloatArray, k: int) -> FloatArray:
    """Ascending sites in the half-open period; what misses the seam by rounding is put on it."""
    a, b = t[k], t[len(t) - k - 1]
    x = wrap(x, t, k)
    return np.sort(np.where(b - x <= 1e-12 * (b - a), a, x))


def _separated(x: FloatArray) -> FloatArray:
    """Sites with the left one of an equal pair, at a jump of the spline, moved halfway back."""
    equal = np.flatnonzero(np.diff(x) == 0)
    x[equal] = 0.5 * (x[equal - 1] + x[equal])
    return x


def _quarter_sites(t: FloatArray, k: int, n: int, periodic: bool) -> FloatArray:
    """Two sites per coefficient, a quarter of the way to the neighbouring Greville sites."""
    if k == 0:
        h = np.diff(t)
        return np.sort(np.concatenate([t[:-1] + 0.25 * h, t[:-1] + 0.75 * h]))
    g = greville(t, k)
    index = (np.arange(2 * n) + 0.5) / 2 - 0.5 + (1 if periodic else 0)
    if periodic:  # one more abscissa on each side, from the neighbouring periods
        period = t[len(t) - k - 1] - t[k]
        g = np.concatenate([g[n - 1 : n] - period, g[:n], g[:1] + period])
    x = np.interp(index, np.arange(len(g)), g)
    return _wrapped_sites(x, t, k) if periodic else np.clip(x, t[k], t[len(t) - k - 1])


def quasi_sites(t: FloatArray, k: int, periodic: bool) -> FloatArray:
    """Sites of the quasi-interpolants: span midpoints and both ends, or knots."""
    x = breaks(t, k)
    if k % 2 == 0:
        mid = 0.5 * (x[1:] + x[:-1])
        return mid if periodic else np.concatenate([x[:1], mid, x[-1:]])
    return x[:-1] if periodic else x


def directions(
    t: Any, k: int | Sequence[int], periodic: bool | Sequence[bool], method: str, at: Any
) -> tuple[Direction, ...]:
    """Checked directions of a fit; `at` replaces the sites of the method."""
    knots = [t] if np.ndim(t[0]) == 0 else list(t)
    nd = len(knots)
    if not 1 <= nd <= 3:
        raise InputError(f"t must hold 1 to 3 knot vectors, got {nd}")
    degree = [as_degree("k", v) for v in per_direction("k", k, nd)]
    wraps = [as_flag("periodic", v) for v in per_direction("periodic", periodic, nd)]
    own = [None] * nd if at is None else [at] if np.ndim(at[0]) == 0 else list(at)
    if len(own) != nd:
        raise InputError(f"at must hold {nd} arrays of sites, got {len(own)}")
    out = []
    for i in range(nd):
        v = as_knot_vector(f"t[{i}]", knots[i], degree[i], periodic=wraps[i])
        x = (
            sites(v, degree[i], method, wraps[i])
            if own[i] is None
            else as_sites(i, own[i], v, degree[i])
        )
        out.append(Direction(v, degree[i], wraps[i], x))
    return tuple(out)


def as_sites(i: int, value: Any, t: FloatArray, k: int) -> FloatArray:
    """Ascending sites inside the domain, or `InputError`."""
    x = as_array(f"at[{i}]", value, ndim=1)
    a, b = t[k], t[len(t) - k - 1]
    if len(x) == 0 or x[0] < a or x[-1] > b or (np.diff(x) <= 0).any():
        raise InputError(f"at[{i}] must hold ascending sites inside [{a}, {b}]")
    return x


def as_samples(values: ArrayLike, dirs: Sequence[Direction], counts: Sequence[int]) -> FloatArray:
    """Finite sample tensor with `counts` samples per direction, scalar or vector."""
    f = as_array("values", values)
    nd = len(dirs)
    if f.ndim not in (nd, nd + 1) or f.shape[:nd] != tuple(counts):
        raise InputError(
            f"values must have shape {tuple(counts)}, or one more axis for vectors, "
            f"got {np.shape(values)}"
        )
    return f


def to_spline(c: FloatArray, dirs: Sequence[Direction]) -> BSpline:
    """Spline from distinct coefficients: the wrapped copies are appended."""
    for axis, d in enumerate(dirs):
        c = d.stored(c, axis)
    return BSpline([d.t for d in dirs], c, [d.k for d in dirs], periodic=[d.periodic for d in dirs])
