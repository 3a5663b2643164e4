"""From chains to beams: straight lines, parabolas, cubic splines, and radii along them.

Guarantees: smooth chains are twice continuously differentiable, closed ones and those that end
whole cells from where they start all around. Radii are linear in the length of the way; of curved
beams within `RADIUS_TOL` of that, as a part of the largest.
"""

from typing import Any

import numpy as np
from scipy.interpolate import CubicSpline

from ilattice._typing import FloatArray
from ilattice.bspline import BSpline
from ilattice.errors import InputError
from ilattice.graph.nodes import EdgeChain
from ilattice.graph.shapes import SAME, Bend, Shape
from ilattice.graph.skeletons import Line

#: Part of the largest radius by which linear pieces of a profile may be off it.
RADIUS_TOL = 1e-3
_GAUSS = np.polynomial.legendre.leggauss(12)
_MAX_PARTS = 64


def curve_of(chain: EdgeChain) -> BSpline:
    """The curve of a smooth chain, one Bézier piece between neighbouring vertices.

    Parameters
    ----------
    chain : EdgeChain
        Vertices at different places.

    Returns
    -------
    BSpline
        Of degree 1, 2 or 3.

    Raises
    ------
    InputError
        If neighbours are at one place.
    """
    p = chain.points
    steps = np.linalg.norm(np.diff(p, axis=0), axis=1)
    if not steps.min() > SAME:
        raise InputError("chain: neighbours of smooth chains must be at different places")
    jump = p[-1] - p[0]
    whole = np.abs(jump - np.rint(jump)).max() < SAME
    t = np.concatenate([[0.0], np.cumsum(steps)])
    if len(p) == 2:
        return BSpline([[0.0, 0.0, 1.0, 1.0]], p, 1)
    if len(p) == 3 and not whole:
        middle = 2.0 * p[1] - 0.5 * (p[0] + p[2])
        return BSpline([[0.0] * 3 + [1.0] * 3], np.stack([p[0], middle, p[2]]), 2)
    tilt = np.rint(jump) / t[-1] if whole else np.zeros(3)
    flat = p - np.outer(t, tilt)
    if whole:
        flat[-1] = flat[0]
    cubic = CubicSpline(t, flat, bc_type="periodic" if whole else "natural")
    slopes = cubic(t, 1) + tilt
    third = (steps / 3.0)[:, None]
    inner = np.stack([p[:-1] + third * slopes[:-1], p[1:] - third * slopes[1:]], axis=1)
    control = np.concatenate([np.concatenate([p[:-1, None], inner], axis=1).reshape(-1, 3), p[-1:]])
    knots = np.concatenate([[t[0]], np.repeat(t, 3), [t[-1]]])
    return BSpline([knots], control, 3)


def shape_of(line: Line) -> Shape:
    """The beams of a line.

    Parameters
    ----------
    line : Line
        The node.

    Returns
    -------
    Shape
        Struts and bends, or one ball where the line has no length.
    """
    parts: list[Any] = []
    for chain, back in line.steps:
        if chain.smooth and len(chain.order) > 2 and np.ptp(chain.points, axis=0).max() > SAME:
            spline = curve_of(chain)
            parts.append(_reversed(spline) if back else spline)
        else:
            parts.append(chain.points[::-1] if back else chain.points)
    lengths = np.array([_length(part) for part in parts])
    total = float(lengths.sum())
    at = np.concatenate([[0.0], np.cumsum(lengths)])
    if total <= SAME:
        first = line.steps[0][0].points[0]
        one = line.thickness
        radius = 0.5 * (one if isinstance(one, float) else max(d for _, d in one))
        return Shape(balls=np.concatenate([first, [radius]])[None])
    out = Shape()
    for part, start, end in zip(parts, at[:-1] / total, at[1:] / total, strict=True):
        out = out + _beam(part, float(start), float(end), line.thickness)
    return out


def _beam(part: Any, start: float, end: float, thickness: Any) -> Shape:
    """One part of a way, which covers a share of its length from start to end."""
    if isinstance(part, BSpline):
        if isinstance(thickness, float):
            return Shape(bends=(Bend(part, 0.5 * thickness),))
        return Shape(bends=(Bend(part, _radius_along(part, start, end, thickness)),))
    steps = np.linalg.norm(np.diff(part, axis=0), axis=1)
    keep = np.concatenate([[True], steps > SAME])
    p, steps = part[keep], steps[steps > SAME]
    if len(p) < 2:
        return Shape()
    s = np.concatenate([[0.0], np.cumsum(steps)])
    s = start + (end - start) * s / s[-1]
    inner = [t for t, _ in thickness] if not isinstance(thickness, float) else []
    breaks = np.union1d(s, [t for t in inner if s[0] < t < s[-1]])
    breaks = breaks[np.concatenate([[True], np.diff(breaks) > 1e-12])]
    points = np.stack([np.interp(breaks, s, c) for c in p.T], axis=1)
    rows = np.column_stack([points, 0.5 * _profile_at(thickness, breaks)])
    return Shape(struts=np.stack([rows[:-1], rows[1:]], axis=1))


def _profile_at(thickness: Any, s: FloatArray) -> FloatArray:
    if isinstance(thickness, float):
        return np.full(len(s), thickness)
    t, d = np.array(thickness, np.float64).T
    return np.asarray(np.interp(s, t, d), np.float64)


def _radius_along(curve: BSpline, start: float, end: float, thickness: Any) -> BSpline:
    """Radius as a piecewise linear function of the parameter of a curve."""
    ends = curve.breaks(0)
    parts = 4
    while True:
        a = np.linspace(0.0, 1.0, 4 * parts + 1)[:-1]
        t = np.append((ends[:-1, None] + np.diff(ends)[:, None] * a).ravel(), ends[-1])
        s = np.concatenate([[0.0], np.cumsum(_arc_lengths(curve, t))])
        s = start + (end - start) * s / s[-1]
        kinks = [np.interp(k, s, t) for k, _ in thickness if s[0] < k < s[-1]]
        knots = np.union1d(t[::4], kinks)
        knots = knots[np.concatenate([[True], np.diff(knots) > 1e-9 * t[-1]])]
        knots[-1] = t[-1]
        r = 0.5 * _profile_at(thickness, np.interp(knots, t, s))
        off = np.abs(np.interp(t, knots, r) - 0.5 * _profile_at(thickness, s)).max()
        if off <= RADIUS_TOL * r.max() or parts >= _MAX_PARTS:
            return BSpline([np.concatenate([knots[:1], knots, knots[-1:]])], r, 1)
        parts *= 2


def _arc_lengths(curve: BSpline, t: FloatArray) -> FloatArray:
    """Lengths between parameters."""
    x, w = _GAUSS
    half = 0.5 * np.diff(t)[:, None]
    at = 0.5 * (t[1:] + t[:-1])[:, None] + half * x
    speed = np.linalg.norm(curve.jet(at.ravel(), 1)[1].reshape(-1, 3), axis=1)
    lengths: FloatArray = (speed.reshape(at.shape) * w * half).sum(axis=1)
    return lengths


def _length(part: Any) -> float:
    if isinstance(part, BSpline):
        return float(_arc_lengths(part, part.breaks(0)).sum())
    return float(np.linalg.norm(np.diff(part, axis=0), axis=1).sum())


def _reversed(spline: BSpline) -> BSpline:
    """The curve run through backwards."""
    (t,) = spline.t
    return BSpline([t[0] + t[-1] - t[::-1]], spline.c[::-1], spline.k)
