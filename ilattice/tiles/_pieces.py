"""From entities to the pieces that compiled code measures distances to.

Guarantee: the pieces of an entity are the entity itself, with the radius as a polynomial on each;
a continuation past an open face is straight and starts with the tangent at the end.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from math import comb
from typing import Any

import numpy as np

from ilattice._typing import FloatArray, IntArray
from ilattice.bspline import BSpline
from ilattice.errors import InputError
from ilattice.tiles._kernels_closest import MAX_DEGREE
from ilattice.tiles._kernels_skeleton import (
    ARC,
    BALL,
    CURVE,
    POLYGON,
    SEGMENT,
    SURFACE,
    TRIANGLE,
)
from ilattice.tiles.entities import (
    TINY,
    Arc,
    Ball,
    Curve,
    Entity,
    Group,
    Patch,
    Polyline,
    Surface,
    Triangles,
    as_radius,
)

#: Parts that a Bézier curve is cut into: smaller boxes are passed over more often.
PARTS = 4
Outward = Callable[[FloatArray, FloatArray], bool]


@dataclass(frozen=True, eq=False)
class Piece:
    """One piece: what kind, of which group, its numbers, its box and its radii."""

    kind: int
    group: int
    data: FloatArray
    points: FloatArray  # their box holds the piece
    radii: tuple[float, float]
    degree: tuple[int, int] = (0, 0)
    plain: bool = True

    @property
    def box(self) -> FloatArray:
        """Lower corner, upper corner, largest radius: 7 numbers."""
        return np.concatenate([self.points.min(axis=0), self.points.max(axis=0), self.radii[1:]])

    @property
    def lift(self) -> FloatArray:
        """By how much each number changes where the piece is moved by one."""
        out = np.zeros_like(self.data)
        if self.kind in (CURVE, SURFACE):
            rows = self.data.reshape(-1, 5)
            out.reshape(-1, 5)[:, :3] = rows[:, 4:]
        else:
            first = FIRST[self.kind]
            out[first : 6 if self.kind == ARC else len(out)] = 1.0
        return out


@dataclass(frozen=True, eq=False)
class Pieces:
    """Many pieces as arrays.

    Attributes
    ----------
    rows : (n, 6) array
        Kind, group, first of its numbers, degrees, plain: as the kernels take them.
    boxes : (n, 7) array
        See `Piece.box`.
    data, lift : (m,) arrays
        Numbers of all pieces, and by how much they change where these are moved by one.
    axis : (m,) array
        Axis along which that is.
    least : float
        A lower bound of all radii.
    """

    rows: IntArray
    boxes: FloatArray
    data: FloatArray
    lift: FloatArray
    axis: IntArray
    least: float

    @classmethod
    def of(cls, pieces: "Sequence[Piece | Pieces]") -> "Pieces":
        """Join pieces in their order."""
        parts = [p if isinstance(p, Pieces) else cls._one(p) for p in pieces]
        counts = np.cumsum([0] + [len(p.data) for p in parts])
        rows = [p.rows + n * (np.arange(6) == 2) for p, n in zip(parts, counts, strict=False)]
        boxes, data, lift, axis = (np.concatenate([getattr(p, k) for p in parts]) for k in FLAT)
        return cls(np.concatenate(rows), boxes, data, lift, axis, min(p.least for p in parts))

    @classmethod
    def _one(cls, p: Piece) -> "Pieces":
        row = [p.kind, p.group, 0, *p.degree, int(p.plain)]
        turn = np.arange(len(p.data)) - FIRST.get(p.kind, 0)
        axis = turn % 5 if p.kind in (CURVE, SURFACE) else turn % 3
        return cls(
            np.array([row], np.int64), p.box[None], p.data, p.lift, np.minimum(axis, 2), p.radii[0]
        )

    def chosen(self, rows: IntArray, by: FloatArray | None = None) -> "Pieces":
        """Some of the pieces, each translated by a row of `by`."""
        sizes = np.diff(np.append(self.rows[:, 2], len(self.data)))
        taken = sizes[rows]
        starts = np.cumsum(taken) - taken
        if len(rows) and (taken == taken[0]).all() and (sizes == taken[0]).all():
            at: Any = rows  # of pieces with as many numbers each
            flat = {k: getattr(self, k).reshape(len(sizes), -1)[at] for k in FLAT[1:]}
        else:
            at = np.arange(int(taken.sum())) - np.repeat(starts - self.rows[rows, 2], taken)
            flat = {k: getattr(self, k)[at] for k in FLAT[1:]}
        out, boxes = self.rows[rows], self.boxes[rows]
        out[:, 2] = starts
        if by is not None:
            boxes[:, :3] += by
            boxes[:, 3:6] += by
            axis = flat["axis"]
            owner = (
                np.arange(len(rows))[:, None]
                if axis.ndim == 2
                else np.repeat(np.arange(len(rows)), taken)
            )
            flat["data"] = flat["data"] + flat["lift"] * by[owner, axis]
        data, lift, axis = (flat[k].ravel() for k in FLAT[1:])
        return Pieces(out, boxes, data, lift, axis, self.least)


#: Where coordinates begin among the numbers of a piece.
FIRST = {SEGMENT: 2, ARC: 3, POLYGON: 11, TRIANGLE: 10, BALL: 1}
FLAT = ("boxes", "data", "lift", "axis")


# ------------------------------------------------------------------------------ Bernstein form


def _elevated(c: FloatArray, degree: Sequence[int]) -> FloatArray:
    """Bernstein coefficients for higher degrees along the leading axes."""
    for axis, n in enumerate(degree):
        while c.shape[axis] <= n:
            p = c.shape[axis] - 1
            a = np.moveaxis(c, axis, 0)
            t = (np.arange(p + 2) / (p + 1)).reshape(-1, *(1,) * (a.ndim - 1))
            pad = [(1, 1)] + [(0, 0)] * (a.ndim - 1)
            a = np.pad(a, pad)
            c = np.moveaxis(t * a[:-1] + (1.0 - t) * a[1:], 0, axis)
    return c


def _product(a: FloatArray, b: FloatArray) -> FloatArray:
    """Bernstein coefficients of a product of two scalar polynomials."""
    out = np.zeros(tuple(m + n - 1 for m, n in zip(a.shape, b.shape, strict=True)))
    scale = np.zeros_like(out)
    for i in np.ndindex(a.shape):
        for j in np.ndindex(b.shape):
            k = tuple(x + y for x, y in zip(i, j, strict=True))
            f = 1.0
            for x, m, y, n in zip(i, a.shape, j, b.shape, strict=True):
                f *= comb(m - 1, x) * comb(n - 1, y)
            out[k] += f * a[i] * b[j]
            scale[k] += f
    return out / scale


def _homogeneous(points: FloatArray, weights: FloatArray | None, radius: FloatArray) -> FloatArray:
    """Rows (x w, y w, z w, r w, w) of one Bézier element, of a common degree."""
    w = np.ones(points.shape[:-1]) if weights is None else weights
    rw = radius if weights is None else _product(radius, w)
    top = [max(m, n) - 1 for m, n in zip(rw.shape, w.shape, strict=True)]
    parts = [points * w[..., None], rw[..., None], w[..., None]]
    return np.concatenate([_elevated(a, top) for a in parts], axis=-1)


def _elements(spline: BSpline, radius: float | BSpline) -> Iterator[tuple[Any, FloatArray]]:
    """Index and homogeneous Bézier points of each element on the common breaks."""
    if isinstance(radius, BSpline):
        for axis in range(spline.ndim):
            mine, theirs = spline.breaks(axis), radius.breaks(axis)
            spline = spline.insert_knots(axis, _missing(theirs, mine))
            radius = radius.insert_knots(axis, _missing(mine, theirs))
    if spline.ndim == 1 and spline.k[0] > 1:
        b = spline.breaks(0)
        cuts = (b[:-1, None] + np.diff(b)[:, None] * np.arange(1, PARTS) / PARTS).ravel()
        spline = spline.insert_knots(0, cuts)
        if isinstance(radius, BSpline):
            radius = radius.insert_knots(0, cuts)
    cells = spline.to_bezier()
    radii = radius.to_bezier().coefficients if isinstance(radius, BSpline) else None
    for e in np.ndindex(cells.shape):
        r = np.full((1,) * spline.ndim, radius) if radii is None else radii[e]
        w = None if cells.weights is None else cells.weights[e]
        if w is not None and np.ptp(w) <= 1e-14 * w.max():
            w = None
        yield e, _homogeneous(cells.coefficients[e], w, r)


def _missing(new: FloatArray, old: FloatArray) -> FloatArray:
    """Breaks that are new, up to rounding."""
    gap = np.abs(new[:, None] - old[None, :]).min(axis=1)
    return new[gap > 1e-12 * np.ptp(old)]


# ------------------------------------------------------------------------------ pieces


def segment(group: int, a: FloatArray, b: FloatArray, ra: float, rb: float) -> Piece:
    """Straight piece with linear radius."""
    data = np.concatenate([[ra, rb], a, b])
    return Piece(SEGMENT, group, data, np.stack([a, b]), (min(ra, rb), max(ra, rb)))


def polygon(group: int, corners: FloatArray, radius: float) -> Piece:
    """Plane polygon."""
    _, _, axes = np.linalg.svd(corners - corners.mean(axis=0))
    e1, e2 = axes[0], axes[1]
    head = [[radius, radius], np.cross(e1, e2), e1, e2]
    data = np.concatenate([*head, corners.ravel()])
    return Piece(POLYGON, group, data, corners, (radius, radius), (len(corners), 0))


def _curve(group: int, h: FloatArray) -> Piece:
    """Bézier curve; a straight one with equal weights as a segment."""
    w = h[:, 4]
    points, radius = h[:, :3] / w[:, None], h[:, 3] / w
    even = bool(np.ptp(w) == 0.0)
    if len(h) == 2 and even and np.ptp(points, axis=0).max() > TINY:
        return segment(group, points[0], points[1], radius[0], radius[1])
    if len(h) - 1 > MAX_DEGREE:
        raise InputError(
            f"radius: curve and radius together have degree {len(h) - 1}, more than {MAX_DEGREE}; "
            "lower the degree of the radius"
        )
    radii = (float(radius.min()), float(radius.max()))
    plain = even and radii[0] == radii[1]
    return Piece(CURVE, group, h.ravel(), points, radii, (len(h) - 1, 0), plain)


def _surface(group: int, h: FloatArray) -> Piece:
    """Bézier surface, without its boundary."""
    w = h[..., 4]
    points, radius = h[..., :3] / w[..., None], h[..., 3] / w
    radii = (float(radius.min()), float(radius.max()))
    plain = bool(np.ptp(w) == 0.0) and radii[0] == radii[1]
    degree = (h.shape[0] - 1, h.shape[1] - 1)
    if max(degree) > MAX_DEGREE:
        raise InputError(
            f"radius: surface and radius together have degrees {degree}, more than {MAX_DEGREE}; "
            "lower the degree of the radius"
        )
    return Piece(SURFACE, group, h.ravel(), points.reshape(-1, 3), radii, degree, plain)


def pieces_of(
    entity: Entity, group: int, default: Any, outward: Outward, far: float
) -> "list[Piece | Pieces]":
    """Pieces of one entity and of its continuations past open faces.

    Parameters
    ----------
    entity : Entity
        The entity.
    group : int
        Its group in the smooth union.
    default : float or None
        Radius of entities that have none.
    outward : callable
        Whether a direction leaves the tile through an open or closed face at a point.
    far : float
        Length of continuations.

    Returns
    -------
    list of Piece or Pieces
        The pieces.
    """
    if isinstance(entity, Group):
        parts = [pieces_of(m, group, default, outward, far) for m in entity.members]
        return [piece for part in parts for piece in part]
    radius = default if entity.radius is None else entity.radius
    if radius is None:
        raise InputError("radius must be given: for all entities, or for each")
    maker: Any = {
        Polyline: _of_polyline, Arc: _of_arc, Patch: _of_patch, Curve: _of_curve,
        Surface: _of_surface, Triangles: _of_triangles, Ball: _of_ball,
    }[type(entity)]  # fmt: skip
    out: list[Piece | Pieces] = maker(entity, radius, group, outward, far)
    return out


def _of_polyline(e: Polyline, radius: Any, group: int, outward: Outward, far: float) -> list[Piece]:
    p = e.points
    keep = np.concatenate([[True], np.abs(np.diff(p, axis=0)).max(axis=1) > TINY])
    if callable(radius) or isinstance(radius, BSpline):
        p = p[keep]
        length = np.linalg.norm(np.diff(p, axis=0), axis=1).cumsum()
        t = np.concatenate([[0.0, 0.0], length / length[-1], [1.0]])
        return _of_curve(Curve(BSpline([t], p, 1)), radius, group, outward, far)
    r = np.asarray(radius, np.float64)
    count = len(p) - e.closed
    if r.ndim and r.shape != (count,):
        raise InputError(f"radius must be one number or one per corner ({count}), got {r.shape}")
    if not (np.isfinite(r).all() and (r > 0).all()):
        raise InputError(f"radius must be positive, got {radius!r:.80}")
    r = np.broadcast_to(r, count) if not e.closed else np.resize(r, len(p))
    p, r = p[keep], np.asarray(r)[keep]
    out = [segment(group, *p[i : i + 2], *r[i : i + 2]) for i in range(len(p) - 1)]
    if not e.closed:
        ends = ((p[0], p[0] - p[1], r[0]), (p[-1], p[-1] - p[-2], r[-1]))
        out += [s for end in ends for s in _continued(group, *end, outward, far)]
    return out


def _continued(
    group: int, p: FloatArray, direction: FloatArray, r: float, outward: Outward, far: float
) -> list[Piece]:
    """Straight continuation from an end that is on an open face."""
    d = direction / np.linalg.norm(direction)
    return [segment(group, p, p + far * d, r, r)] if outward(p, d) else []


def _of_arc(e: Arc, radius: Any, group: int, outward: Outward, far: float) -> list[Piece]:
    domain = np.array([[0.0], [e.angle]])
    r = as_radius("radius", radius, domain)
    if isinstance(r, BSpline):
        return _of_varying_arc(e, r, group, outward, far)
    size = float(np.linalg.norm(e.u))
    data = np.concatenate([[r, size, e.angle], e.centre, e.u / size, e.v / size])
    extent = np.hypot(e.u, e.v)
    box = np.stack([e.centre - extent, e.centre + extent])
    out = [Piece(ARC, group, data, box, (r, r))]
    if e.angle < 2.0 * np.pi:
        a, b = e.at([0.0, e.angle])
        end = -np.sin(e.angle) * e.u + np.cos(e.angle) * e.v
        out += _continued(group, a, -e.v, r, outward, far)
        out += _continued(group, b, end, r, outward, far)
    return out


def _of_varying_arc(
    e: Arc, radius: BSpline, group: int, outward: Outward, far: float
) -> list[Piece]:
    """As rational quadratic arcs, with the radius as a function of their parameter."""
    n = int(np.ceil(e.angle / (0.5 * np.pi)))
    half = 0.5 * e.angle / n
    knots = np.repeat(np.arange(n + 1) / n, 2)
    t = np.concatenate([[0.0], knots, [1.0]])
    w = np.ones(2 * n + 1)
    w[1::2] = np.cos(half)
    c = e.at(np.arange(2 * n + 1) * half)
    c[1::2] = e.centre + (c[1::2] - e.centre) / np.cos(half)
    spline = BSpline([t], c, 2, weights=w)
    e1, e2 = (v / (v @ v) for v in (e.u, e.v))

    def of_parameter(s: FloatArray) -> FloatArray:
        p = spline(s) - e.centre
        turn = np.mod(np.arctan2(p @ e2, p @ e1), 2.0 * np.pi)
        turn = np.where(np.abs(turn - s * e.angle) > np.pi, turn - 2.0 * np.pi, turn)
        turn = np.where(turn - s * e.angle < -np.pi, turn + 2.0 * np.pi, turn)
        return radius(np.clip(turn, 0.0, e.angle))

    return _of_curve(Curve(spline), of_parameter, group, outward, far)


def _of_curve(e: Curve, radius: Any, group: int, outward: Outward, far: float) -> list[Piece]:
    r = as_radius("radius", radius, e.spline.domain)
    rows = [h for _, h in _elements(e.spline, r)]
    rows = [h for h in rows if np.ptp(h[:, :3] / h[:, 4:], axis=0).max() > TINY]
    out = [_curve(group, h) for h in rows]
    if not e.spline.periodic[0]:
        for h in (rows[0], rows[-1][::-1]):
            p, thick = h[:, :3] / h[:, 4:], h[0, 3] / h[0, 4]
            other = p[np.argmax(np.abs(p - p[0]).max(axis=1) > TINY)]
            out += _continued(group, p[0], p[0] - other, thick, outward, far)
    return out


def _of_patch(e: Patch, radius: Any, group: int, outward: Outward, far: float) -> list[Piece]:
    if callable(radius):
        raise InputError("radius of a Patch must be a number; a Surface can have a varying one")
    r = float(as_radius("radius", radius, np.array([[0.0], [1.0]])))  # type: ignore[arg-type]
    p = e.corners
    main = polygon(group, p, r)
    out = [main]
    normal = main.data[2:5]
    area = sum(normal @ np.cross(a, b) for a, b in zip(p, np.roll(p, -1, axis=0), strict=True))
    for a, b in zip(p, np.roll(p, -1, axis=0), strict=True):
        side = np.cross(b - a, normal) * np.sign(area)
        length = np.linalg.norm(side)
        if length > TINY:
            d = side / length
            if outward(a, d) and outward(b, d) and outward(0.5 * (a + b), d):
                out.append(polygon(group, np.stack([a, b, b + far * d, a + far * d]), r))
    return out


def _of_surface(e: Surface, radius: Any, group: int, outward: Outward, far: float) -> list[Piece]:
    r = as_radius("radius", radius, e.spline.domain)
    elements = dict(_elements(e.spline, r))
    last = tuple(max(i[a] for i in elements) for a in range(2))
    grids = list(elements.values())
    for i, h in elements.items():
        for axis in range(2):
            if e.spline.periodic[axis]:
                continue
            along = np.moveaxis(h, axis, 0)
            if i[axis] == 0:
                grids += _strip(along, outward, far)
            if i[axis] == last[axis]:
                grids += _strip(along[::-1], outward, far)
    out = [_surface(group, h) for h in grids]
    edges: dict[bytes, Piece] = {}
    for h in grids:
        for edge in (h[0], h[-1], h[:, 0], h[:, -1]):
            key = (np.round(edge, 13) + 0.0).tobytes()
            edges.setdefault(key, _curve(group, edge))
    return out + list(edges.values())


def _strip(h: FloatArray, outward: Outward, far: float) -> list[FloatArray]:
    """Ruled continuation past the first row of control points, if that is on an open face."""
    w = h[..., 4:]
    p, q = h[0, :, :3] / w[0], h[1, :, :3] / w[1]
    step = p - q
    size = np.linalg.norm(step, axis=1).max()
    if size <= TINY or not all(outward(a, d / size) for a, d in zip(p, step, strict=True)):
        return []
    new = h[0].copy()
    new[:, :3] = (p + far / size * step) * w[0]
    return [np.stack([h[0], new])]


def _of_ball(e: Ball, radius: Any, group: int, *_: Any) -> list[Piece]:
    r = float(as_radius("radius", radius, np.array([[0.0], [1.0]])))  # type: ignore[arg-type]
    return [Piece(BALL, group, np.concatenate([[r], e.centre]), e.centre[None], (r, r))]


def _of_triangles(e: Triangles, radius: Any, group: int, *_: Any) -> list[Pieces]:
    p = e.vertices[e.faces]
    r = np.broadcast_to(np.asarray(radius, np.float64), len(e.vertices))[e.faces]
    first, second = p[:, 1] - p[:, 0], p[:, 2] - p[:, 0]
    normal = np.cross(first, second)
    # The slope of the radius is in the plane: products with two edges say which it is.
    a, b, c = ((u * v).sum(1) for u, v in ((first, first), (first, second), (second, second)))
    x, y = r[:, 1] - r[:, 0], r[:, 2] - r[:, 0]
    det = a * c - b * b
    slope = ((c * x - b * y) / det)[:, None] * first + ((a * y - b * x) / det)[:, None] * second
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    data = np.concatenate([r, r[:, :1], normal, slope, p.reshape(-1, 9)], axis=1)
    m, width = data.shape
    rows = np.zeros((m, 6), np.int64)
    rows[:, 0], rows[:, 1], rows[:, 2], rows[:, 5] = TRIANGLE, group, width * np.arange(m), 1
    boxes = np.concatenate([p.min(axis=1), p.max(axis=1), r.max(axis=1, keepdims=True)], axis=1)
    turn = np.arange(width) - FIRST[TRIANGLE]
    lift, axis = np.tile(turn >= 0, m).astype(np.float64), np.tile(turn % 3, m)
    return [Pieces(rows, boxes, data.ravel(), lift, axis, float(r.min()))]
