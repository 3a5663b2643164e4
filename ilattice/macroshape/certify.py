"""The Jacobian certificate: whether a spline volume is a proper map, and where it is worst.

On every Bézier element det J is a polynomial; its Bernstein coefficients enclose its values.
Elements are halved where the enclosure does not yet tell the sign, or the least value.

Guarantees: VALID is a proof, rounding allowed for, that det J keeps one strict sign; INVALID
comes with a place where det J has the wrong sign. Exactly doubled control points give exact
zeros: such a map, and any that touches zero, is UNDECIDED, with the places.
Non-guarantees: VALID says that the map is locally one-to-one; it may still overlap itself from
far away (a helix that is too tight). The scaled Jacobian is sampled, not bounded.
"""

import logging
import warnings
from dataclasses import dataclass, field
from enum import StrEnum
from typing import Protocol

import numpy as np

from ilattice._geometry import CORNERS, grid_points
from ilattice._shown import one_line
from ilattice._typing import FloatArray, IntArray
from ilattice._validate import Frozen, as_kind, as_not_negative, as_whole, check_lengths, read_only
from ilattice.bspline import BSpline
from ilattice.errors import GeometryError, InputError, PrecisionWarning
from ilattice.macroshape import _bernstein as bern

__all__ = ["Certificate", "Status", "certify", "check_map"]

_log = logging.getLogger("ilattice")
_EPS = float(np.finfo(np.float64).eps)
#: Bernstein coefficients handled at once, and kept at most while searching.
_BATCH, _KEPT = 1 << 18, 1 << 21
#: Halvings after which elements are as small as rounding.
DEEPEST = 50


class Status(StrEnum):
    """What a certificate says."""

    VALID = "VALID"
    INVALID = "INVALID"
    UNDECIDED = "UNDECIDED"


@dataclass(frozen=True, eq=False)
class Certificate(Frozen):
    """What `certify` found out.

    Attributes
    ----------
    status : Status
        VALID: det J keeps one strict sign. INVALID: it takes both signs, or vanishes everywhere.
        UNDECIDED: it touches zero, or comes closer to it than the depth allows to tell.
    orientation : int
        Sign of the integral of det J: +1 right-handed, -1 left-handed, 0 flat.
    worst_u, worst_x : ndarray, shape (3,)
        Place of the least ``orientation * det J`` found, parameter and point.
    worst_det : float
        det J there, with its own sign.
    bound : float
        Rigorous lower bound of ``orientation * det J``.
    largest : float
        Rigorous upper bound of ``orientation * det J``.
    scaled : float
        Least scaled Jacobian, ``orientation * det J / (|x_u| |x_v| |x_w|)``, of those sampled.
    singular_u : ndarray, shape (q, 3)
        Places where det J is zero, at most 32.
    elements, depth : int
        Bézier elements, and how often the worst of them was halved.
    """

    status: Status
    orientation: int
    worst_u: FloatArray = field(repr=False)
    worst_x: FloatArray = field(repr=False)
    worst_det: float
    bound: float
    largest: float
    scaled: float
    singular_u: FloatArray = field(repr=False)
    elements: int
    depth: int

    def __repr__(self) -> str:
        return one_line(f"Certificate({self})")

    def __str__(self) -> str:
        hand = {1: "right-handed", -1: "left-handed", 0: "flat"}[self.orientation]
        return f"{self.status}, {hand}: least det J {self.worst_det:.6g} at {self.place}"

    @property
    def place(self) -> str:
        """The worst place in words."""
        return f"u = {_numbers(self.worst_u)}, x = {_numbers(self.worst_x)}"


class _Volume(Protocol):
    """What is looked at of a `SplineMap`."""

    @property
    def spline(self) -> BSpline: ...


class _Certified(_Volume, Protocol):
    """A volume that keeps its certificate."""

    @property
    def geometry(self) -> BSpline: ...
    @property
    def certificate(self) -> Certificate: ...


def certify(volume: _Volume | BSpline, *, depth: int = 16, tol: float = 1e-9) -> Certificate:
    """Certify the sign of det J of a spline volume.

    Parameters
    ----------
    volume : SplineMap or BSpline
        Three parameters, at least three components, degrees of at least 1; rational or not.
    depth : int
        How often an element is halved at most.
    tol : float
        Values of det J below `tol` times its largest are taken for zero.

    Returns
    -------
    Certificate
        Status, orientation, worst place, bounds.

    Raises
    ------
    InputError
        If an argument is wrong.

    Notes
    -----
    det J of degree (p, q, r) is of degree (3p - 1, 3q - 1, 3r - 1) on an element. Of a rational
    volume, det J = N / w⁴ with N the 4×4 determinant of the homogeneous point and its derivatives;
    with N and w⁴ in one Bernstein basis, the quotients of the coefficients enclose det J.
    """
    depth, tol = as_whole("depth", depth, 0, DEEPEST), as_not_negative("tol", tol)
    if tol >= 1.0:
        raise InputError(f"tol must be below 1, got {tol:g}: it is a part of the largest det J")
    spline = (
        volume if isinstance(volume, BSpline) else as_kind("volume", volume, "SplineMap").spline
    )
    elements = _Elements(spline)
    low, high, mean, corners = elements.scan()
    noise = elements.noise
    size = float(max(abs(low.min()), abs(high.max())))
    sign = _sign(mean, elements.volume) if size > noise else 0
    if sign < 0:
        low, high, corners = -high, -low, -corners + 0.0
    search = _Search(elements, sign or 1, tol=max(tol * size, noise), noise=noise)
    reached = search.run(low, corners, depth)
    status = _status(search, sign)
    if status is Status.VALID:
        search.singular.clear()
    u = elements.clip(search.worst_u)
    return Certificate(
        status=status,
        orientation=sign,
        worst_u=read_only(u),
        worst_x=read_only(spline(u[None])[0, :3].copy()),
        worst_det=(sign or 1) * search.worst + 0.0,
        bound=search.bound + 0.0,
        largest=float(high.max()),
        scaled=elements.scaled_jacobian(sign or 1),
        singular_u=read_only(search.places()),
        elements=elements.count,
        depth=reached,
    )


def check_map(volume: _Certified, *, name: str = "through") -> Certificate:
    """Refuse a folded map; warn of places where det J vanishes.

    Parameters
    ----------
    volume : SplineMap
        The map.
    name : str
        The argument that messages name.

    Returns
    -------
    Certificate
        That of the map. A left-handed map passes: see ``orientation``.

    Raises
    ------
    InputError
        If the map is so large or small that volumes overflow or vanish.
    GeometryError
        If det J takes both signs, or vanishes everywhere, or the volume is torn at a knot of
        full multiplicity; the message names the place.

    Warns
    -----
    PrecisionWarning
        If det J touches zero, or its sign could not be told; the message names the places.
    """
    _check_size(as_kind("volume", volume, "SplineMap").geometry, name)
    c = volume.certificate
    _check_torn(volume.geometry, name)
    if c.orientation == 0:
        raise GeometryError(f"{name} is flat: det J vanishes everywhere; give it three dimensions")
    if c.status is Status.INVALID:
        raise GeometryError(
            f"{name} is folded: det J takes both signs, {c.worst_det:.6g} at {c.place}; "
            "move the control points near that place"
        )
    if c.status is Status.UNDECIDED:
        where = "; ".join(f"u = {_numbers(u)}" for u in c.singular_u[:4])
        more = f" and {len(c.singular_u) - 4} more" if len(c.singular_u) > 4 else ""
        warnings.warn(
            f"{name}: det J comes down to {c.worst_det:.3g} at {c.place}"
            + (f"; it vanishes at {where}{more}" if where else "")
            + "; distances are less accurate there",
            PrecisionWarning,
            stacklevel=3,
        )
    if c.orientation < 0:
        _log.info("%s is left-handed; fix_orientation() turns it round", name)
    return c


def _check_size(spline: BSpline, name: str) -> None:
    """Refuse coefficients with which det J would overflow, or vanish by its units alone."""
    far = float(np.abs(spline.c).max())
    size = float(np.ptp(spline.c.reshape(-1, spline.m) / far, axis=0).max() * far) if far else 0.0
    check_lengths(name, size, far)


def _check_torn(spline: BSpline, name: str) -> None:
    """Refuse jumps, which only knots of multiplicity k + 1 inside the domain allow."""
    size = float(np.abs(spline.c).max())
    for axis, (t, k) in enumerate(zip(spline.t, spline.k, strict=True)):
        lo, hi = spline.domain[:, axis]
        full = np.flatnonzero(t[: len(t) - k] == t[k:])
        for i in full[(t[full] > lo) & (t[full] < hi)]:
            sides = np.take(spline.c, [i - 1, i], axis=axis)
            if np.abs(np.diff(sides, axis=axis)).max() > 1e-9 * size:
                raise GeometryError(
                    f"{name} is torn at {'uvw'[axis]} = {t[i]:.6g}: the two sides of that knot "
                    "differ; use the parts as volumes of their own"
                )


def _numbers(a: FloatArray) -> str:
    return "(" + ", ".join(f"{v:.6g}" for v in a) + ")"


def _sign(mean: FloatArray, volume: FloatArray) -> int:
    total = float(mean @ volume)
    return 1 if total >= 0 else -1


def _status(search: "_Search", sign: int) -> Status:
    if sign == 0 or search.worst < -search.tol:
        return Status.INVALID
    return Status.VALID if search.bound > search.noise else Status.UNDECIDED


class _Elements:
    """det J on the Bézier elements of a volume, a batch at a time.

    The net is moved and scaled to unit half diagonal, so that rounding has one scale.
    """

    def __init__(self, spline: BSpline) -> None:
        cells = spline.to_bezier()
        net = cells.coefficients[..., :3]
        self.shape: tuple[int, ...] = net.shape[:3]
        self.count = int(np.prod(self.shape))
        self.orders: tuple[int, int, int] = net.shape[3:6]
        lo, hi = net.min(axis=tuple(range(6))), net.max(axis=tuple(range(6)))
        self.radius = max(0.5 * float(np.linalg.norm(hi - lo)), np.finfo(float).tiny ** 0.25)
        unit = (net - 0.5 * (lo + hi)) / self.radius
        self.rounding = _EPS * (1 + float(np.abs(net).max()) / self.radius)
        points = np.moveaxis(unit.reshape(self.count, *self.orders, 3), -1, 1)
        w = cells.weights
        self.weights = None if w is None else w.reshape(self.count, 1, *self.orders)
        if self.weights is not None:
            points = np.concatenate([self.weights, self.weights * points], axis=1)
        self.points = np.ascontiguousarray(points)
        steps = [np.diff(b) for b in cells.breaks]
        starts = [b[:-1] for b in cells.breaks]
        self.step = grid_points(*steps)
        self.start = grid_points(*starts)
        self.ends = np.array([[b[0] for b in cells.breaks], [b[-1] for b in cells.breaks]])
        self.volume = np.prod(self.step, axis=1)
        self.factor = self.radius**3 / self.volume
        rational = self.weights is not None
        self.size = int(np.prod([(4 if rational else 3) * (n - 1) + rational for n in self.orders]))
        self.noise = self._noise()

    def clip(self, u: FloatArray) -> FloatArray:
        return np.clip(u, self.ends[0], self.ends[1])

    def _noise(self) -> float:
        """Bound of the rounding error of any coefficient of det J."""
        rows = [bern.difference(self.points, axis) for axis in range(3)]
        spread = (2, 3, 4)
        norms = [np.sqrt((r**2).sum(axis=1, keepdims=True)).max(axis=spread) for r in rows]
        norms = [n + self.rounding * o for n, o in zip(norms, self.orders, strict=True)]
        if self.weights is not None:
            least = self.weights.min(axis=spread)
            norms.append(np.sqrt((self.points**2).sum(axis=1, keepdims=True)).max(axis=spread))
            norms.append(1 / least**4)
        bound = np.prod(norms, axis=0)[:, 0] * self.factor
        return 64 * self.rounding * sum(self.orders) * float(bound.max())

    def polynomials(self, index: IntArray) -> tuple[FloatArray, FloatArray | None]:
        """Bernstein coefficients of numerator and denominator of det J, (E, i, j, k)."""
        points, factor = self.points[index], self.factor[index, None, None, None]
        if self.weights is None:
            return bern.determinant(points) * factor, None
        upper = bern.elevated(bern.homogeneous_determinant(points))
        lower = bern.fourth_power(self.weights[index, 0])
        return bern.plain(upper) * factor, bern.plain(lower)

    def scan(self) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
        """Least, greatest and mean coefficient of each element, and its corner values."""
        batch = max(1, _BATCH // self.size)
        parts = []
        for i in range(0, self.count, batch):
            c = _quotient(*self.polynomials(np.arange(i, min(i + batch, self.count))))
            axes = (1, 2, 3)
            corners = c[:, :: c.shape[1] - 1, :: c.shape[2] - 1, :: c.shape[3] - 1]
            parts.append((c.min(axis=axes), c.max(axis=axes), c.mean(axis=axes), corners))
        low, high, mean, corners = (np.concatenate(p) for p in zip(*parts, strict=True))
        return low, high, mean, corners.reshape(self.count, 8)

    def scaled_jacobian(self, sign: int) -> float:
        """Least scaled Jacobian on a grid of each element, ends included."""
        i, j, k = (2 * n - 1 for n in self.orders)
        batch = max(1, _BATCH // (16 * i * j * k))
        least = [np.inf]
        for first in range(0, self.count, batch):
            p = self.points[first : first + batch]
            rows = [bern.sampled(p, (i, j, k))]
            rows += [bern.sampled(bern.difference(p, axis), (i, j, k)) for axis in range(3)]
            if self.weights is not None:
                w = rows[0][:, :1]
                x = rows[0][:, 1:] / w
                rows = [x, *((r[:, 1:] - r[:, :1] * x) / w for r in rows[1:])]
            a, b, c = rows[1:]
            det = sign * (a * np.cross(b, c, axis=1)).sum(axis=1)
            norm = np.prod([np.sqrt((r**2).sum(axis=1)) for r in (a, b, c)], axis=0)
            least.append(float(np.divide(det, norm, out=np.zeros_like(det), where=norm > 0).min()))
        return min(least)


def _quotient(upper: FloatArray, lower: FloatArray | None) -> FloatArray:
    return upper if lower is None else upper / lower


class _Search:
    """Branch and bound for the least value of ``sign * det J``."""

    def __init__(self, elements: _Elements, sign: int, *, tol: float, noise: float) -> None:
        self.elements, self.sign, self.tol, self.noise = elements, sign, tol, noise
        self.worst = np.inf
        self.worst_u = elements.ends[0]
        self.bound = np.inf
        self.singular: list[FloatArray] = []
        self.most = max(64, min(4096, _KEPT // elements.size))

    def run(self, low: FloatArray, corners: FloatArray, depth: int) -> int:
        """Search, and the depth that was reached."""
        e = self.elements
        self._note(corners, e.start, e.step)
        keep = self._open(low)
        if not 0 < len(keep) <= self.most:
            self.bound = min(self.bound, float(low[keep].min(initial=np.inf)))
            return 0
        upper, lower = e.polynomials(keep)
        upper, start, step = self.sign * upper, e.start[keep], e.step[keep]
        for level in range(depth):
            if not 0 < len(upper) <= self.most:
                depth = level
                break
            upper = bern.halves(upper)
            lower = None if lower is None else bern.halves(lower)
            step = np.repeat(0.5 * step, 8, axis=0)
            start = np.repeat(start, 8, axis=0) + np.tile(CORNERS, (len(start), 1)) * step
            c = _quotient(upper, lower)
            ends = c[:, :: c.shape[1] - 1, :: c.shape[2] - 1, :: c.shape[3] - 1]
            self._note(ends.reshape(-1, 8), start, step)
            keep = self._open(c.min(axis=(1, 2, 3)))
            upper, start, step = upper[keep], start[keep], step[keep]
            lower = None if lower is None else lower[keep]
        self._close(upper, lower)
        return depth

    def _open(self, low: FloatArray) -> IntArray:
        """Indices of the cells that may hold a lower value; the bound of the others counts."""
        gap = max(1e-3 * abs(self.worst), self.noise if self.worst > self.tol else self.tol)
        maybe = low < self.worst - gap
        if maybe.sum() > self.most:  # too many: those whose sign is told can wait
            maybe &= low <= self.noise
        if not maybe.all():
            self.bound = min(self.bound, float(low[~maybe].min()))
        return np.flatnonzero(maybe)

    def _close(self, upper: FloatArray, lower: FloatArray | None) -> None:
        if len(upper):
            self.bound = min(self.bound, float(_quotient(upper, lower).min()))

    def _note(self, corners: FloatArray, start: FloatArray, step: FloatArray) -> None:
        """Remember the least of the corner values, which are values of det J, and the zeros."""
        i, j = np.unravel_index(int(corners.argmin()), corners.shape)
        if corners[i, j] < self.worst:
            self.worst = float(corners[i, j])
            self.worst_u = start[i] + CORNERS[j] * step[i]
        rows, which = np.nonzero(np.abs(corners) <= self.tol)
        self.singular.extend(start[rows[:256]] + CORNERS[which[:256]] * step[rows[:256]])

    def places(self) -> FloatArray:
        """The zeros, each once, at most 32."""
        if not self.singular:
            return np.empty((0, 3))
        found = np.round(self.elements.clip(np.array(self.singular)), 12)
        return np.unique(found, axis=0)[:32] + 0.0
