"""From entities to the pieces that compiled code measures distances to.

Entities of one kind become pieces together.

Guarantee: the pieces of an entity are the entity itself, with the radius as a polynomial on each;
a continuation past an open face is straight and starts with the tangent at the end.
"""

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from typing import Any, NamedTuple

import numpy as np

from ilattice._typing import FloatArray
from ilattice._validate import as_positive
from ilattice.bspline import BSpline
from ilattice.errors import InputError
from ilattice.tiles._kernels_skeleton import ARC, BALL, TRIANGLE
from ilattice.tiles._piece_arrays import (
    Outward,
    Pieces,
    alike,
    continued,
    polygons,
    segments,
)
from ilattice.tiles._piece_splines import of_curve, of_surface
from ilattice.tiles._radii import as_radius
from ilattice.tiles.entities import (
    TINY,
    Arc,
    Ball,
    Curve,
    Patch,
    Polyline,
    Segments,
    Surface,
    Triangles,
)


class Part(NamedTuple):
    """An entity that is no group.

    Attributes
    ----------
    entity : Single
        The entity.
    radius : float, callable, BSpline or array
        Its radius.
    group : int or array
        Its group in the smooth union, or those of its segments.
    name : str
        Name for messages.
    """

    entity: Any
    radius: Any
    group: Any
    name: str


def pieces_of(parts: Sequence[Part], outward: Outward, far: float) -> Pieces:
    """Pieces of entities and of their continuations past open faces.

    Parameters
    ----------
    parts : sequence of Part
        At least one.
    outward : callable
        Whether directions leave the tile through an open or closed face at points.
    far : float
        Length of continuations.

    Returns
    -------
    Pieces
        The pieces.

    Raises
    ------
    InputError
        If a radius is missing, not positive or of another shape.
    """
    kinds: dict[Any, list[Part]] = {}
    for part in parts:
        if part.radius is None:
            raise InputError(f"{part.name}: radius must be given: for all entities, or for each")
        kinds.setdefault(type(part.entity), []).append(part)
    out: list[Pieces] = []
    for kind, makers in _MAKERS.items():
        if kind in kinds:
            out += makers(kinds[kind], outward, far)
    return Pieces.of([p for p in out if len(p.rows)])


@contextmanager
def _named(part: Part) -> Iterator[None]:
    """Errors that begin with the name of an entity."""
    try:
        yield
    except InputError as error:
        raise InputError(f"{part.name}: {error}") from error


def _varies(radius: Any) -> bool:
    """Whether a radius is a function."""
    return callable(radius) or isinstance(radius, BSpline)


def _column(parts: Sequence[Part], name: str) -> FloatArray:
    """An attribute of all entities, one row each."""
    return np.array([getattr(part.entity, name) for part in parts])


def _groups(parts: Sequence[Part]) -> Any:
    return np.array([part.group for part in parts])


def _constant(parts: Sequence[Part]) -> FloatArray:
    """Radii that must be numbers."""
    out = np.empty(len(parts))
    for i, part in enumerate(parts):
        with _named(part):
            out[i] = as_positive("radius", part.radius)
    return out


# ------------------------------------------------------------------------------ straight


def _of_segments(parts: Sequence[Part], outward: Outward, far: float) -> Iterator[Pieces]:
    for part in parts:
        ends = part.entity.points
        r = part.entity.at_ends(part.radius)
        yield segments(part.group, ends, r)
        group = np.repeat(np.broadcast_to(part.group, len(ends)), 2)
        away = (ends - ends[:, ::-1]).reshape(-1, 3)
        yield continued(group, ends.reshape(-1, 3), away, r.ravel(), outward, far)


def _of_polylines(parts: Sequence[Part], outward: Outward, far: float) -> Iterator[Pieces]:
    for part in parts:
        if _varies(part.radius):
            with _named(part):
                yield from _of_varying_polyline(part, outward, far)
    parts = [part for part in parts if not _varies(part.radius)]
    if not parts:
        return
    p = np.concatenate([part.entity.points for part in parts])
    r = np.concatenate([_at_corners(part) for part in parts])
    owner = np.repeat(np.arange(len(parts)), [len(part.entity.points) for part in parts])
    keep = _apart(p, owner)
    p, r, owner = p[keep], r[keep], owner[keep]
    group, at = _groups(parts)[owner], np.flatnonzero(owner[1:] == owner[:-1])
    yield segments(group[at], np.stack([p[at], p[at + 1]], axis=1), np.stack([r[at], r[at + 1]], 1))
    ends = np.cumsum(np.bincount(owner))
    loose = np.array([not part.entity.closed for part in parts])
    for end, step in ((np.append(0, ends[:-1])[loose], 1), (ends[loose] - 1, -1)):
        yield continued(group[end], p[end], p[end] - p[end + step], r[end], outward, far)


def _apart(p: FloatArray, owner: Any) -> Any:
    """Which corners of polylines are not where the one before is."""
    far = np.abs(np.diff(p, axis=0)).max(axis=1) > TINY
    return np.append(True, far | (owner[1:] != owner[:-1]))


def _of_varying_polyline(part: Part, outward: Outward, far: float) -> list[Pieces]:
    """As a spline of degree 1, with the radius as a function of the share of the length."""
    p = part.entity.points
    p = p[_apart(p, np.zeros(len(p), np.int64))]
    length = np.linalg.norm(np.diff(p, axis=0), axis=1).cumsum()
    t = np.concatenate([[0.0, 0.0], length / length[-1], [1.0]])
    return of_curve(Curve(BSpline([t], p, 1)), part.radius, part.group, outward, far)


def _at_corners(part: Part) -> FloatArray:
    """Radii at the corners of a polyline, that of the first again at the end if it is closed."""
    e, r = part.entity, np.asarray(part.radius, np.float64)
    count = len(e.points) - e.closed
    if r.ndim and r.shape != (count,):
        raise InputError(
            f"{part.name}: radius must be one number or one per corner ({count}), got {r.shape}"
        )
    if not r.ndim:
        return np.full(len(e.points), r)
    return np.append(r, r[0]) if e.closed else r


def _of_balls(parts: Sequence[Part], *_: Any) -> Iterator[Pieces]:
    centre, r = _column(parts, "centre"), _constant(parts)[:, None]
    yield alike(BALL, _groups(parts), np.hstack([r, centre]), centre[:, None], r)


# ------------------------------------------------------------------------------ arcs


def _of_arcs(parts: Sequence[Part], outward: Outward, far: float) -> Iterator[Pieces]:
    for part in parts:
        if _varies(part.radius):
            with _named(part):
                yield from _of_varying_arc(part, outward, far)
    parts = [part for part in parts if not _varies(part.radius)]
    if not parts:
        return
    centre, u, v = (_column(parts, name) for name in ("centre", "u", "v"))
    r, angle, group = _constant(parts), _column(parts, "angle"), _groups(parts)
    size = np.linalg.norm(u, axis=1)[:, None]
    data = np.hstack([r[:, None], size, angle[:, None], centre, u / size, v / size])
    extent = np.hypot(u, v)
    box = np.stack([centre - extent, centre + extent], axis=1)
    yield alike(ARC, group, data, box, r[:, None])
    for at, sign in ((np.zeros_like(angle), -1.0), (angle, 1.0)):
        c, s = np.cos(at)[:, None], np.sin(at)[:, None]
        p, way = centre + c * u + s * v, sign * (c * v - s * u)
        cut = angle < 2.0 * np.pi
        yield continued(group[cut], p[cut], way[cut], r[cut], outward, far)


def _of_varying_arc(part: Part, outward: Outward, far: float) -> list[Pieces]:
    """As rational quadratic arcs, with the radius as a function of their parameter."""
    e = part.entity
    radius: Any = as_radius("radius", part.radius, np.array([[0.0], [e.angle]]))
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

    return of_curve(Curve(spline), of_parameter, part.group, outward, far)


# ------------------------------------------------------------------------------ curves, surfaces


def _of_curves(parts: Sequence[Part], outward: Outward, far: float) -> Iterator[Pieces]:
    for part in parts:
        with _named(part):
            yield from of_curve(part.entity, part.radius, part.group, outward, far)


def _of_surfaces(parts: Sequence[Part], outward: Outward, far: float) -> Iterator[Pieces]:
    for part in parts:
        with _named(part):
            yield from of_surface(part.entity, part.radius, part.group, outward, far)


def _of_patches(parts: Sequence[Part], outward: Outward, far: float) -> Iterator[Pieces]:
    for part in parts:
        if _varies(part.radius):
            raise InputError(
                f"{part.name}: radius of a Patch must be a number; a Surface can have a varying one"
            )
    sizes = np.array([len(part.entity.corners) for part in parts])
    for size in np.unique(sizes):
        some = [part for part, own in zip(parts, sizes, strict=True) if own == size]
        group, p, r = _groups(some), _column(some, "corners"), _constant(some)
        plates = polygons(group, p, r)
        yield plates
        normal = plates.data.reshape(len(p), -1)[:, None, 2:5]
        following = np.roll(p, -1, axis=1)
        area = (normal * np.cross(p, following)).sum(axis=(1, 2))
        side = np.cross(following - p, normal) * np.sign(area)[:, None, None]
        length = np.linalg.norm(side, axis=2)
        row, k = np.nonzero(length > TINY)
        a, b, d = p[row, k], following[row, k], side[row, k] / length[row, k, None]
        out = outward(a, d) & outward(b, d) & outward(0.5 * (a + b), d)
        row, a, b, d = row[out], a[out], b[out], d[out]
        beyond = np.stack([a, b, b + far * d, a + far * d], axis=1)
        yield polygons(group[row], beyond, r[row])


def _of_triangles(parts: Sequence[Part], *_: Any) -> Iterator[Pieces]:
    for part in parts:
        e = part.entity
        p = e.vertices[e.faces]
        r = np.broadcast_to(np.asarray(part.radius, np.float64), len(e.vertices))[e.faces]
        first, second = p[:, 1] - p[:, 0], p[:, 2] - p[:, 0]
        normal = np.cross(first, second)
        # The slope of the radius is in the plane: products with two edges say which it is.
        a, b, c = ((u * v).sum(1) for u, v in ((first, first), (first, second), (second, second)))
        x, y, det = r[:, 1] - r[:, 0], r[:, 2] - r[:, 0], a * c - b * b
        slope = ((c * x - b * y) / det)[:, None] * first + ((a * y - b * x) / det)[:, None] * second
        normal /= np.linalg.norm(normal, axis=1, keepdims=True)
        data = np.hstack([r, r[:, :1], normal, slope, p.reshape(-1, 9)])
        yield alike(TRIANGLE, part.group, data, p, r)


_MAKERS: dict[Any, Any] = {
    Segments: _of_segments, Polyline: _of_polylines, Arc: _of_arcs, Patch: _of_patches,
    Curve: _of_curves, Surface: _of_surfaces, Triangles: _of_triangles, Ball: _of_balls,
}  # fmt: skip
