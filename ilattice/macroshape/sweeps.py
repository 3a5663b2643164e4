"""Spline volumes made from surfaces: extruded, ruled, revolved, lofted.

Surfaces are `BSpline` objects with two parameters and three components (two: in the plane
z = 0); further components are carried along.

Guarantees: the given surfaces lie exactly in the volume; revolving is exact (rational).
Non-guarantees: what comes out is not certified here; a surface on the wrong side of its
direction gives a left-handed volume, which works and can be turned by `fix_orientation`.
"""

from collections.abc import Sequence
from itertools import pairwise
from typing import Any

import numpy as np
from scipy.interpolate import make_interp_spline

from ilattice._typing import ArrayLike, FloatArray, IntArray
from ilattice._validate import as_array, as_flag, as_items, as_positive, as_triple
from ilattice.bspline import BSpline
from ilattice.errors import GeometryError, InputError
from ilattice.macroshape.maps import SplineMap

__all__ = ["clamped", "extrude", "loft", "revolve", "ruled"]

_LINE = np.array([0.0, 0.0, 1.0, 1.0])


def clamped(n: int, k: int) -> FloatArray:
    """Clamped uniform knots on [0, 1].

    Parameters
    ----------
    n : int
        Number of coefficients.
    k : int
        Degree.

    Returns
    -------
    ndarray, shape (n + k + 1,)
        Knots.
    """
    return np.concatenate([np.zeros(k), np.linspace(0, 1, n - k + 1), np.ones(k)])


def extrude(surface: BSpline, vector: ArrayLike = (0.0, 0.0, 1.0)) -> SplineMap:
    """Volume swept by a surface along a straight line.

    Parameters
    ----------
    surface : BSpline
        Two parameters.
    vector : array_like, shape (3,)
        Where the line leads; must not lie in the surface.

    Returns
    -------
    SplineMap
        Parameters of the surface first, then the line (linear).

    Raises
    ------
    InputError
        If the surface is none, or the vector is zero.
    """
    s = _surface("surface", surface)
    v = as_triple("vector", vector)
    if not v.any():
        raise InputError("vector must not be zero")
    moved = s.c + np.concatenate([v, np.zeros(s.m - 3)])
    return _stack([s, _replace(s, moved)], _LINE, 1)


def ruled(first: BSpline, second: BSpline) -> SplineMap:
    """Volume of the straight lines between two surfaces.

    Parameters
    ----------
    first, second : BSpline
        Surfaces of any degree and knots. The domain of the second is mapped to that of the
        first.

    Returns
    -------
    SplineMap
        Parameters of the surfaces first, then the lines (linear) from `first` to `second`.

    Raises
    ------
    InputError
        If a surface is none, or the numbers of components differ.

    Notes
    -----
    Between rational surfaces the lines are straight, but run through at uneven speed where
    the weights differ.
    """
    return _stack(_unified({"first": first, "second": second}), _LINE, 1)


def loft(
    sections: Sequence[BSpline],
    *,
    degree: int = 3,
    at: ArrayLike | None = None,
    closed: bool = False,
) -> SplineMap:
    """Volume through a sequence of surfaces.

    Parameters
    ----------
    sections : sequence of BSpline
        At least two surfaces of any degree and knots.
    degree : int
        Degree of the third direction; less if there are too few sections.
    at : array_like, shape (n,), optional
        Increasing parameters of the sections, and of the return to the first one if `closed`
        (n + 1 of them); by default their mean distances, scaled to [0, 1].
    closed : bool
        Whether to come back to the first section, as smoothly as the degree allows.

    Returns
    -------
    SplineMap
        Parameters of the surfaces first, then the one from section to section.

    Raises
    ------
    InputError
        If a section is no surface, there are too few, or `at` does not increase.
    GeometryError
        If two neighbours coincide, or interpolated weights do not stay positive.
    """
    if len(as_items("sections", sections)) < 2 + as_flag("closed", closed):
        raise InputError(f"sections must hold at least {2 + closed} surfaces, got {len(sections)}")
    parts = _unified({f"sections[{i}]": s for i, s in enumerate(sections)})
    if not isinstance(degree, int | np.integer) or not 1 <= degree <= 8:
        raise InputError(f"degree must be a whole number from 1 to 8, got {degree!r}")
    ring = [*parts, parts[0]] if closed else parts
    where = _stations(ring) if at is None else as_array("at", at, ndim=1)
    if len(where) != len(ring) or (np.diff(where) <= 0).any():
        raise InputError(f"at must hold {len(ring)} increasing parameters, got {at!r:.80}")
    values = np.stack([_homogeneous(s) for s in ring])
    k = min(int(degree), len(ring) - 1)
    curve = make_interp_spline(where, values, k=k, bc_type="periodic" if closed else None)
    rows = [_from_homogeneous(parts[0], np.asarray(c)) for c in curve.c]
    return _stack(rows, curve.t, k, closed=closed)


def revolve(
    surface: BSpline,
    axis: ArrayLike = (0.0, 0.0, 1.0),
    angle: float = 2 * np.pi,
    *,
    center: ArrayLike = 0.0,
) -> SplineMap:
    """Volume swept by a surface around an axis, exactly.

    Parameters
    ----------
    surface : BSpline
        Two parameters; must not cross the axis. Where it touches it, det J is zero.
    axis : array_like, shape (3,)
        Direction of the axis; positive angles turn counterclockwise seen against it.
    angle : float
        In radians, up to a full turn.
    center : array_like, shape (3,)
        A point of the axis.

    Returns
    -------
    SplineMap
        Angle first (rational quadratic arcs of up to a quarter turn), then the parameters of
        the surface. A full turn is closed along u.

    Raises
    ------
    InputError
        If the surface is none, the axis has no direction, or the angle is not above 0 and
        at most 2π.
    """
    s = _surface("surface", surface)
    a, p = as_triple("axis", axis), as_triple("center", center)
    turn = as_positive("angle", angle)
    if not a.any():
        raise InputError("axis must not be zero")
    if turn > 2 * np.pi * (1 + 1e-12):
        raise InputError(f"angle must be at most 2π, got {angle}")
    a = a / np.linalg.norm(a)
    arcs = max(1, int(np.ceil(turn / (0.5 * np.pi) - 1e-9)))
    half = 0.5 * turn / arcs
    arm = s.c[..., :3] - p
    along = (arm @ a)[..., None] * a
    out = arm - along
    side = np.cross(a, out)
    rings, full = [], arcs * half >= np.pi * (1 - 1e-12)
    for i in range(2 * arcs + 1):
        phi = 0.0 if full and i == 2 * arcs else i * half
        stretch = 1 / np.cos(half) if i % 2 else 1.0
        point = p + along + stretch * (np.cos(phi) * out + np.sin(phi) * side)
        weights = np.ones(s.shape) if s.weights is None else s.weights
        c = np.concatenate([point, s.c[..., 3:]], axis=-1)
        rings.append(BSpline(s.t, c, s.k, periodic=s.periodic, weights=weights / stretch))
    t = np.repeat(np.linspace(0, 1, arcs + 1), [3, *[2] * (arcs - 1), 3])
    return _stack(rings, t, 2).permuted((2, 0, 1))


# -------------------------------------------------------------------- parts


def _surface(name: str, s: Any) -> BSpline:
    """`s`, in space, or `InputError`."""
    if not isinstance(s, BSpline) or s.ndim != 2 or s.m < 2:
        raise InputError(
            f"{name} must be a BSpline with 2 parameters and at least 2 components, got {s!r:.80}"
        )
    if s.m > 2:
        return s
    return _replace(s, np.concatenate([s.c, np.zeros((*s.shape, 1))], axis=-1))


def _replace(s: BSpline, c: FloatArray) -> BSpline:
    return BSpline(s.t, c, s.k, periodic=s.periodic, weights=s.weights)


def _stack(rows: Sequence[BSpline], t: FloatArray, k: int, *, closed: bool = False) -> SplineMap:
    """Volume whose coefficients along the third direction are those of the surfaces."""
    s = rows[0]
    c = np.stack([r.c for r in rows], axis=2)
    w = None
    if any(r.weights is not None for r in rows):
        ones = np.ones(s.shape)
        w = np.stack([ones if r.weights is None else r.weights for r in rows], axis=2)
    wrap = (*s.periodic, closed)
    return SplineMap(BSpline([*s.t, t], c, (*s.k, k), periodic=wrap, weights=w))


def _homogeneous(s: BSpline) -> FloatArray:
    if s.weights is None:
        return s.c
    w = s.weights[..., None]
    return np.concatenate([s.c * w, w], axis=-1)


def _from_homogeneous(like: BSpline, c: FloatArray) -> BSpline:
    if like.weights is None:
        return _replace(like, c)
    w = c[..., -1]
    if w.min() <= 0:
        raise GeometryError(
            f"sections: interpolated weights come down to {w.min():.3g}; "
            "use a lower degree, or sections with equal weights"
        )
    return BSpline(like.t, c[..., :-1] / w[..., None], like.k, periodic=like.periodic, weights=w)


def _stations(rows: Sequence[BSpline]) -> FloatArray:
    """Accumulated mean distances of the control nets, from 0 to 1."""
    gaps = [
        float(np.linalg.norm(b.c[..., :3] - a.c[..., :3], axis=-1).mean())
        for a, b in pairwise(rows)
    ]
    if min(gaps) == 0:
        i = int(np.argmin(gaps))
        raise GeometryError(f"sections[{i}] and the next one coincide; leave one out")
    total = np.concatenate([[0.0], np.cumsum(gaps)])
    return total / total[-1]


def _unified(surfaces: dict[str, Any]) -> list[BSpline]:
    """The surfaces on common knots, degrees and kind of weights."""
    rows = [_surface(name, s) for name, s in surfaces.items()]
    if len({s.m for s in rows}) > 1:
        sizes = {name: s.m for name, s in zip(surfaces, rows, strict=True)}
        raise InputError(f"surfaces must have the same number of components, got {sizes}")
    if any(s.weights is not None for s in rows):
        rows = [
            BSpline(s.t, s.c, s.k, periodic=s.periodic, weights=np.ones(s.shape))
            if s.weights is None
            else s
            for s in rows
        ]
    for axis in range(2):
        rows = _unified_along(axis, [_shifted(s, axis, rows[0].domain[:, axis]) for s in rows])
    return rows


def _shifted(s: BSpline, axis: int, domain: FloatArray) -> BSpline:
    """`s` with the domain of one parameter mapped to the given one."""
    lo, hi = s.domain[:, axis]
    if (lo, hi) == tuple(domain):
        return s
    t = list(s.t)
    t[axis] = domain[0] + (s.t[axis] - lo) * ((domain[1] - domain[0]) / (hi - lo))
    return BSpline(t, s.c, s.k, periodic=s.periodic, weights=s.weights)


def _unified_along(axis: int, rows: list[BSpline]) -> list[BSpline]:
    """Raise degrees and insert knots until all agree along one parameter."""
    first = rows[0]
    if all(
        s.k == first.k
        and s.periodic == first.periodic
        and len(s.t[axis]) == len(first.t[axis])
        and np.abs(s.t[axis] - first.t[axis]).max() <= 1e-12 * np.ptp(first.domain[:, axis])
        for s in rows
    ):
        return rows
    degree = max(s.k[axis] for s in rows)
    rows = [_clamped_along(s, axis) for s in rows]
    rows = [s.elevate(axis, degree - s.k[axis]) if s.k[axis] < degree else s for s in rows]
    common, counts = _common_knots([s.t[axis] for s in rows])
    return [_refined(s, axis, common, counts) for s in rows]


def _clamped_along(s: BSpline, axis: int) -> BSpline:
    """Same surface with k + 1 knots at both ends of one parameter."""
    k = s.k[axis]
    for end in s.domain[:, axis]:
        missing = k - int(np.count_nonzero(s.t[axis] == end))
        if missing > 0:
            s = s.insert_knots(axis, np.full(missing, end))
    t = s.t[axis]
    lo, hi = s.domain[:, axis]
    first = max(int(np.searchsorted(t, lo, side="left")) - 1, 0)
    last = min(int(np.searchsorted(t, hi, side="right")) + 1, len(t))
    kept = t[first:last].copy()
    kept[0], kept[-1] = lo, hi
    knots, wrap, part = list(s.t), list(s.periodic), [slice(None)] * 2
    knots[axis], wrap[axis], part[axis] = kept, False, slice(first, last - k - 1)
    w = None if s.weights is None else s.weights[tuple(part)]
    return BSpline(knots, s.c[tuple(part)], s.k, periodic=wrap, weights=w)


def _common_knots(vectors: list[FloatArray]) -> tuple[FloatArray, IntArray]:
    """Distinct knots of all vectors with their largest multiplicity; near ones count as one."""
    every = np.unique(np.concatenate(vectors))
    near = 1e-9 * (every[-1] - every[0])
    common = every[np.concatenate([[True], np.diff(every) > near])]
    counts = [np.bincount(_nearest(common, t), minlength=len(common)) for t in vectors]
    return common, np.max(counts, axis=0)


def _nearest(common: FloatArray, t: FloatArray) -> IntArray:
    return np.abs(t[:, None] - common).argmin(axis=1).astype(np.int64)


def _refined(s: BSpline, axis: int, common: FloatArray, counts: IntArray) -> BSpline:
    """`s` with each common knot as often as counted."""
    own = _nearest(common, s.t[axis])
    missing = counts - np.bincount(own, minlength=len(common))
    t = list(s.t)
    t[axis] = common[own]
    s = BSpline(t, s.c, s.k, periodic=s.periodic, weights=s.weights)
    return s.insert_knots(axis, np.repeat(common, missing)) if missing.any() else s
