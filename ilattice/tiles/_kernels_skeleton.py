"""Kernels of skeletons: nearest point among many pieces, smooth union, derivatives.

The tree is that of `ilattice.fields._kernels_boxes`, with the largest radius in each node; pieces
lie in the order of its leaves. A point starts from what the point before it knows: distances
change by no more than the step between them.

Guarantees: a piece is passed over only if its box proves it farther than needed; nothing is
allocated per point; results do not depend on the number of threads.
"""

import math
from typing import Any, NamedTuple

import numpy as np
from numba import njit

from ilattice._kernels import in_ranges, inner, outer
from ilattice._kernels_tuples import borrowed
from ilattice.fields._kernels_boxes import STACK
from ilattice.tiles._kernels_closest import (
    AT,
    DEPTH,
    FAST,
    FOOT,
    F,
    casteljau,
    closest_on_curve,
    closest_on_surface,
    surface_jet,
)

#: Points that a thread takes at once.
CHUNK = 256
#: Kinds of pieces, and how many there are.
SEGMENT, ARC, POLYGON, CURVE, SURFACE, TRIANGLE, BALL, KINDS = 0, 1, 2, 3, 4, 5, 6, 7
#: Columns of `piece`: kind, group, start, degree or count, second degree, plain.
KIND, GROUP, START, DEGREE, OTHER, PLAIN = 0, 1, 2, 3, 4, 5
#: Columns of the nodes of the tree: right child, first piece and number of pieces.
RIGHT, BEGIN, COUNT = 0, 1, 2
#: Columns of their boxes: lower and upper corner, and largest radius within.
LO, HI, WIDEST = 0, 3, 6
#: Numbers of a hit; behind those of `_kernels_closest`: piece, feature (0 a point, 1 inside, 2 +
#: edge).
HIT, PIECE, FEATURE = 8, 6, 7
#: Numbers of a homogeneous Bézier point, and the place of the weight among them.
POINT, W = 5, 4
#: Places in jets of such points, behind the value: of curves.
T, TT = 5, 10
#: The same of surfaces, by their parameters.
JU, JV, JUU, JUV, JVV = 5, 10, 15, 20, 25
#: Places of derivatives, each of a point and its radius, which is at R: of curves.
FIRST, SECOND, R = 0, 4, 3
#: The same of surfaces.
U, V, UU, UV, VV = 0, 4, 8, 12, 16
#: Places in the scratch of derivatives, behind that of `casteljau`: a jet, the way from a foot, the
#: sum of such ways, derivatives of a piece, another jet, and scratch of `surface_jet`.
CURVE_JET, AWAY, TOTAL, SLOPES, SURFACE_JET, REST = 200, 230, 233, 240, 264, 294
#: Rounding of bounds from boxes.
SLACK = 1e-12


class Tree(NamedTuple):
    """Pieces, and a tree of boxes over them.

    Attributes
    ----------
    link, box
        Right child, first piece and number of pieces, (m, 3), see there; boxes and largest radius,
        (m, 7).
    piece, piece_box, data
        Pieces (see the top of the module), their boxes, and their numbers.
    groups, width, turns
        Number of groups, most Bézier points of a piece, and 2 if there are surfaces, else 1.
    """

    link: Any
    box: Any
    piece: Any
    piece_box: Any
    data: Any
    groups: int
    width: int
    turns: int


@njit(cache=True, fastmath=FAST, inline="always")
def _box_distance(box: Any, i: int, x: float, y: float, z: float) -> float:
    """Distance to box i minus the largest radius in it."""
    dx = max(box[i, LO] - x, x - box[i, HI], 0.0)
    dy = max(box[i, LO + 1] - y, y - box[i, HI + 1], 0.0)
    dz = max(box[i, LO + 2] - z, z - box[i, HI + 2], 0.0)
    return math.sqrt(dx * dx + dy * dy + dz * dz) - box[i, WIDEST]


@inner(fastmath=FAST)
def _farthest(box: Any, x: float, y: float, z: float) -> float:
    """Distance to the farthest corner of all boxes: no point of a piece is farther."""
    dx = max(x - box[0, LO], box[0, HI] - x)
    dy = max(y - box[0, LO + 1], box[0, HI + 1] - y)
    dz = max(z - box[0, LO + 2], box[0, HI + 2] - z)
    return math.sqrt(dx * dx + dy * dy + dz * dz)


@inner(fastmath=FAST)
def _offer(
    hit: Any, x: float, y: float, z: float, fx: float, fy: float, fz: float, r: float, feature: int
) -> None:
    """Keep a foot if it is nearer."""
    dx, dy, dz = x - fx, y - fy, z - fz
    f = math.sqrt(dx * dx + dy * dy + dz * dz) - r
    if f < hit[F]:
        hit[F], hit[FOOT], hit[FOOT + 1], hit[FOOT + 2], hit[FEATURE] = f, fx, fy, fz, feature


@inner(fastmath=FAST)
def _segment(
    d: Any, s: int, m: int, k: int, x: float, y: float, z: float, hit: Any, feature: int
) -> None:
    """Segment between points at offsets m and k; radii at s and s + 1 change linearly."""
    ax, ay, az = d[m], d[m + 1], d[m + 2]
    tx, ty, tz = d[k] - ax, d[k + 1] - ay, d[k + 2] - az
    ra, rb = d[s], d[s + 1]
    length2 = tx * tx + ty * ty + tz * tz
    t = ((x - ax) * tx + (y - ay) * ty + (z - az) * tz) / length2
    if ra != rb:
        slope = (rb - ra) / math.sqrt(length2)
        if abs(slope) >= 1.0:
            t = 1.0 if slope > 0.0 else 0.0
        else:
            hx, hy, hz = x - ax - t * tx, y - ay - t * ty, z - az - t * tz
            h = math.sqrt((hx * hx + hy * hy + hz * hz) / length2)
            t += slope * h / math.sqrt(1.0 - slope * slope)
    kind = feature
    if not 0.0 < t < 1.0:
        t = 0.0 if t <= 0.0 else 1.0
        kind = 0
    r = ra + t * (rb - ra)
    if t == 1.0:
        _offer(hit, x, y, z, d[k], d[k + 1], d[k + 2], r, kind)
    else:
        _offer(hit, x, y, z, ax + t * tx, ay + t * ty, az + t * tz, r, kind)


@inner(fastmath=FAST)
def _arc(d: Any, s: int, x: float, y: float, z: float, hit: Any) -> None:
    """Arc: radius, size, angle, centre (3), unit vectors of angle 0 and pi/2 (3 + 3)."""
    r, size, angle = d[s], d[s + 1], d[s + 2]
    px, py, pz = x - d[s + 3], y - d[s + 4], z - d[s + 5]
    u = px * d[s + 6] + py * d[s + 7] + pz * d[s + 8]
    v = px * d[s + 9] + py * d[s + 10] + pz * d[s + 11]
    turn = math.atan2(v, u)
    if turn < 0.0:
        turn += 2.0 * math.pi
    if turn <= angle:
        norm = math.sqrt(u * u + v * v)
        c, w = (size * u / norm, size * v / norm) if norm > 0.0 else (size, 0.0)
        fx = d[s + 3] + c * d[s + 6] + w * d[s + 9]
        fy = d[s + 4] + c * d[s + 7] + w * d[s + 10]
        fz = d[s + 5] + c * d[s + 8] + w * d[s + 11]
        _offer(hit, x, y, z, fx, fy, fz, r, 1)
    if angle < 2.0 * math.pi:
        for end in (0.0, angle):
            c, w = size * math.cos(end), size * math.sin(end)
            fx = d[s + 3] + c * d[s + 6] + w * d[s + 9]
            fy = d[s + 4] + c * d[s + 7] + w * d[s + 10]
            fz = d[s + 5] + c * d[s + 8] + w * d[s + 11]
            _offer(hit, x, y, z, fx, fy, fz, r, 0)


@inner(fastmath=FAST)
def _polygon(d: Any, s: int, m: int, x: float, y: float, z: float, hit: Any) -> None:
    """Plane polygon: radius twice, unit normal, first and second axis (3 each), m corners."""
    c = s + 11
    px, py, pz = x - d[c], y - d[c + 1], z - d[c + 2]
    h = px * d[s + 2] + py * d[s + 3] + pz * d[s + 4]
    u = px * d[s + 5] + py * d[s + 6] + pz * d[s + 7]
    v = px * d[s + 8] + py * d[s + 9] + pz * d[s + 10]
    inside = False
    for i in range(m):
        a, b = c + 3 * i, c + 3 * ((i + 1) % m)
        va = _along(d, s + 8, a, c)
        vb = _along(d, s + 8, b, c)
        if (va > v) != (vb > v):
            ua, ub = _along(d, s + 5, a, c), _along(d, s + 5, b, c)
            if u < ua + (v - va) / (vb - va) * (ub - ua):
                inside = not inside
    if inside:
        _offer(hit, x, y, z, x - h * d[s + 2], y - h * d[s + 3], z - h * d[s + 4], d[s], 1)
    for i in range(m):
        _segment(d, s, c + 3 * i, c + 3 * ((i + 1) % m), x, y, z, hit, 2 + i)


@inner(fastmath=FAST)
def _triangle(d: Any, s: int, x: float, y: float, z: float, hit: Any) -> None:
    """Triangle: radii of its corners and the first again, normal, slope of the radius, corners.

    Where |x - p| - r(p) is least in the plane, the radius grows away from the foot of the
    perpendicular as fast as the distance does; the function is convex, so that a least point of
    the plane that is outside the triangle leaves the edges only.
    """
    c = s + 10
    h = (x - d[c]) * d[s + 4] + (y - d[c + 1]) * d[s + 5] + (z - d[c + 2]) * d[s + 6]
    if abs(h) - max(d[s], d[s + 1], d[s + 2]) >= hit[F]:
        return
    g2 = d[s + 7] * d[s + 7] + d[s + 8] * d[s + 8] + d[s + 9] * d[s + 9]
    if g2 < 1.0:
        lift = abs(h) / math.sqrt(1.0 - g2)
        fx = x - h * d[s + 4] + lift * d[s + 7]
        fy = y - h * d[s + 5] + lift * d[s + 8]
        fz = z - h * d[s + 6] + lift * d[s + 9]
        inside = True
        for i in range(3):
            a, b = c + 3 * i, c + 3 * ((i + 1) % 3)
            ex, ey, ez = d[b] - d[a], d[b + 1] - d[a + 1], d[b + 2] - d[a + 2]
            qx, qy, qz = fx - d[a], fy - d[a + 1], fz - d[a + 2]
            side = (
                d[s + 4] * (ey * qz - ez * qy)
                + d[s + 5] * (ez * qx - ex * qz)
                + d[s + 6] * (ex * qy - ey * qx)
            )
            if side <= 0.0:
                inside = False
        if inside:
            r = d[s] + (
                d[s + 7] * (fx - d[c]) + d[s + 8] * (fy - d[c + 1]) + d[s + 9] * (fz - d[c + 2])
            )
            _offer(hit, x, y, z, fx, fy, fz, r, 1)
            return
    for i in range(3):
        _segment(d, s + i, c + 3 * i, c + 3 * ((i + 1) % 3), x, y, z, hit, 2 + i)


@njit(cache=True, fastmath=FAST, inline="always")
def _along(d: Any, axis: int, a: int, c: int) -> float:
    """Coordinate of corner a relative to corner c along an axis."""
    return (
        (d[a] - d[c]) * d[axis]
        + (d[a + 1] - d[c + 1]) * d[axis + 1]
        + (d[a + 2] - d[c + 2]) * d[axis + 2]
    )


@inner()
def _closest_on_piece(
    piece: Any, i: int, d: Any, x: float, y: float, z: float, hit: Any, stack: Any, span: Any,
    work: Any,
) -> None:  # fmt: skip
    """Nearest point of piece i, if it is nearer than ``hit[F]``."""
    kind, s = piece[i, KIND], piece[i, START]
    before = hit[F]
    if kind == SEGMENT:
        _segment(d, s, s + 2, s + 5, x, y, z, hit, 1)
    elif kind == ARC:
        _arc(d, s, x, y, z, hit)
    elif kind == POLYGON:
        _polygon(d, s, piece[i, DEGREE], x, y, z, hit)
    elif kind == CURVE:
        closest_on_curve(
            d, s, 5, piece[i, DEGREE], piece[i, PLAIN], x, y, z, hit, stack, span, work
        )
    elif kind == TRIANGLE:
        _triangle(d, s, x, y, z, hit)
    elif kind == BALL:
        _offer(hit, x, y, z, d[s + 1], d[s + 2], d[s + 3], d[s], 0)
    else:
        p, r = piece[i, DEGREE], piece[i, OTHER]
        closest_on_surface(d, s, p, r, piece[i, PLAIN], x, y, z, hit, stack, span, work)
    if hit[F] < before:
        hit[PIECE] = i


@inner()
def _nearest(
    x: float, y: float, z: float, bound: float, blend: float, tree: Any, hits: Any, touched: Any,
    stack: Any, span: Any, work: Any, path: Any,
) -> Any:  # fmt: skip
    """Nearest points of all groups that are within `blend` of the least; their number, least.

    Surfaces come after all else: without a bound by their edges, which are pieces of their own, a
    search goes on for long beside a least point on one.
    """
    link, box, piece, piece_box = tree.link, tree.box, tree.piece, tree.piece_box
    least, found = bound, 0
    for turn in range(tree.turns):
        path[0] = 0
        top = 1
        while top > 0:
            top -= 1
            i = path[top]
            if _box_distance(box, i, x, y, z) - SLACK >= least + blend:
                continue
            if link[i, COUNT] == 0:
                a, b = i + 1, link[i, RIGHT]
                if _box_distance(box, a, x, y, z) < _box_distance(box, b, x, y, z):
                    a, b = b, a
                path[top], path[top + 1] = a, b
                top += 2
                continue
            for j in range(link[i, BEGIN], link[i, BEGIN] + link[i, COUNT]):
                if (piece[j, KIND] == SURFACE) != (turn == 1):
                    continue
                hit = hits[piece[j, GROUP]]
                cut = min(hit[F], least + blend + SLACK)
                if _box_distance(piece_box, j, x, y, z) - SLACK >= cut:
                    continue
                new = hit[F] == np.inf
                hit[F] = cut
                _closest_on_piece(piece, j, tree.data, x, y, z, hit, stack, span, work)
                if new:
                    if hit[F] < cut:
                        touched[found] = piece[j, GROUP]
                        found += 1
                    else:
                        hit[F] = np.inf
                least = min(least, hit[F])
    return found, least


@inner()
def _union(hits: Any, touched: Any, found: int, least: float, blend: float, weight: Any) -> Any:
    """Value, and groups with weights: sorted to the front of `touched`; resets the hits."""
    count = 0
    for i in range(found):
        g = touched[i]
        if hits[g, F] < least + blend or hits[g, F] == least:
            j = count
            while j > 0 and (
                hits[touched[j - 1], F] > hits[g, F]
                or (hits[touched[j - 1], F] == hits[g, F] and touched[j - 1] > g)
            ):
                j -= 1
            for m in range(i, j, -1):
                touched[m] = touched[m - 1]
            touched[j] = g
            count += 1
    if blend <= 0.0 or count == 0:
        weight[0] = 1.0
        return least, count
    # The weights w minimise sum w_i a_i + blend/2 (sum w_i² - 1) over the unit simplex.
    total, theta, size = 0.0, 0.0, 0
    for j in range(count):
        total += hits[touched[j], F]
        new = (blend + total) / (j + 1)
        if hits[touched[j], F] < new or j == 0:
            theta, size = new, j + 1
    if size == 1:
        weight[0] = 1.0
        return least, 1
    value, squares = 0.0, 0.0
    for j in range(size):
        weight[j] = (theta - hits[touched[j], F]) / blend
        value += weight[j] * (hits[touched[j], F] - least)
        squares += weight[j] * weight[j]
    return least + value + 0.5 * blend * (squares - 1.0), size


@inner()
def _curve_derivatives(d: Any, s: int, p: int, t: float, work: Any, out: Any) -> None:
    """First and second derivatives of point and radius of a rational curve: 4 + 4 numbers."""
    jet = work[CURVE_JET:AWAY]
    casteljau(d, s, POINT, p, t, work, jet)
    w, w1, w2 = jet[W], jet[T + W], jet[TT + W]
    for m in range(4):
        out[FIRST + m] = (jet[T + m] - jet[m] / w * w1) / w
        out[SECOND + m] = (jet[TT + m] - 2.0 * out[FIRST + m] * w1 - jet[m] / w * w2) / w


@inner()
def _add_point(n: Any, dist: float, weight: float, h: Any) -> None:
    """Second derivatives of the distance to a fixed point."""
    for i in range(3):
        for j in range(3):
            h[i, j] += weight * ((1.0 if i == j else 0.0) - n[i] * n[j]) / dist


@inner()
def _add_curve(n: Any, dist: float, weight: float, c: Any, c1: int, c2: int, h: Any) -> None:
    """Second derivatives of the distance to a curve with derivatives at c[c1:], c[c2:]."""
    speed = along = bend = 0.0
    for i in range(3):
        speed += c[c1 + i] ** 2
        along += n[i] * c[c1 + i]
        bend += n[i] * c[c2 + i]
    _add_point(n, dist, weight, h)
    slope = c[c1 + R]
    if abs(along + slope) > 1e-7 * math.sqrt(speed):
        return
    tt = (speed - along * along) / dist - bend - c[c2 + R]
    if not tt > 0.0:
        return
    for i in range(3):
        a = (c[c1 + i] - n[i] * along) / dist
        for j in range(3):
            h[i, j] -= weight * a * (c[c1 + j] - n[j] * along) / dist / tt


@inner()
def _add_surface(n: Any, dist: float, weight: float, c: Any, h: Any) -> None:
    """As `_add_curve` for a surface with derivatives u, v, uu, uv, vv of (point, radius) in c."""
    nu = n[0] * c[U] + n[1] * c[U + 1] + n[2] * c[U + 2]
    nv = n[0] * c[V] + n[1] * c[V + 1] + n[2] * c[V + 2]
    # A foot on the boundary is free to move along it only.
    free_u = abs(nu + c[U + R]) <= 1e-7 * math.sqrt(c[U] ** 2 + c[U + 1] ** 2 + c[U + 2] ** 2)
    free_v = abs(nv + c[V + R]) <= 1e-7 * math.sqrt(c[V] ** 2 + c[V + 1] ** 2 + c[V + 2] ** 2)
    if not (free_u and free_v):
        _add_curve(n, dist, weight, c, V if free_v else U, VV if free_v else UU, h)
        return
    _add_point(n, dist, weight, h)
    uu = (c[U] ** 2 + c[U + 1] ** 2 + c[U + 2] ** 2 - nu * nu) / dist
    uv = (c[U] * c[V] + c[U + 1] * c[V + 1] + c[U + 2] * c[V + 2] - nu * nv) / dist
    vv = (c[V] ** 2 + c[V + 1] ** 2 + c[V + 2] ** 2 - nv * nv) / dist
    uu -= n[0] * c[UU] + n[1] * c[UU + 1] + n[2] * c[UU + 2] + c[UU + R]
    uv -= n[0] * c[UV] + n[1] * c[UV + 1] + n[2] * c[UV + 2] + c[UV + R]
    vv -= n[0] * c[VV] + n[1] * c[VV + 1] + n[2] * c[VV + 2] + c[VV + R]
    det = uu * vv - uv * uv
    if not (det > 0.0 and uu > 0.0):
        return
    for i in range(3):
        ai, bi = (c[U + i] - n[i] * nu) / dist, (c[V + i] - n[i] * nv) / dist
        for j in range(3):
            aj, bj = (c[U + j] - n[j] * nu) / dist, (c[V + j] - n[j] * nv) / dist
            h[i, j] -= weight * (vv * ai * aj - uv * (ai * bj + bi * aj) + uu * bi * bj) / det


@inner()
def _add_hessian(
    hit: Any, n: Any, dist: float, weight: float, piece: Any, d: Any, work: Any, h: Any
) -> None:
    """Second derivatives of F at one foot, times a weight."""
    i = int(hit[PIECE])
    kind, s, feature = piece[i, KIND], piece[i, START], int(hit[FEATURE])
    c = work[SLOPES:SURFACE_JET]
    c[:] = 0.0
    if kind == CURVE:
        _curve_derivatives(d, s, piece[i, DEGREE], hit[AT], work, c)
        _add_curve(n, dist, weight, c, FIRST, SECOND, h)
    elif kind == SURFACE:
        _surface_derivatives(d, s, piece[i, DEGREE], piece[i, OTHER], hit[AT], hit[AT + 1], work, c)
        _add_surface(n, dist, weight, c, h)
    elif feature == 0:
        _add_point(n, dist, weight, h)
    elif kind == ARC:
        for m in range(3):
            c[SECOND + m] = d[s + 3 + m] - hit[FOOT + m]
        for m in range(3):
            c[FIRST + m] = _arc_tangent(d, s, c[SECOND], c[SECOND + 1], c[SECOND + 2], m)
        _add_curve(n, dist, weight, c, FIRST, SECOND, h)
    elif kind == SEGMENT or feature >= 2:
        a, b, r = s + 2, s + 5, s
        if kind == POLYGON:
            m = piece[i, DEGREE]
            a, b = s + 11 + 3 * (feature - 2), s + 11 + 3 * ((feature - 1) % m)
        elif kind == TRIANGLE:
            r = s + feature - 2
            a, b = s + 10 + 3 * (feature - 2), s + 10 + 3 * ((feature - 1) % 3)
        for m in range(3):
            c[FIRST + m] = d[b + m] - d[a + m]
        c[FIRST + R] = d[r + 1] - d[r]
        _add_curve(n, dist, weight, c, FIRST, SECOND, h)


@inner()
def _arc_tangent(d: Any, s: int, x: float, y: float, z: float, m: int) -> float:
    """Component m of the tangent where (x, y, z) points to the centre."""
    u = -(x * d[s + 6] + y * d[s + 7] + z * d[s + 8])
    v = -(x * d[s + 9] + y * d[s + 10] + z * d[s + 11])
    return u * d[s + 9 + m] - v * d[s + 6 + m]


@inner()
def _surface_derivatives(
    d: Any, s: int, p: int, r: int, u: float, v: float, work: Any, out: Any
) -> None:
    """Derivatives u, v, uu, uv, vv of point and radius of a rational surface: 20 numbers."""
    jet = work[SURFACE_JET:REST]
    surface_jet(d, s, p, r, u, v, work[REST:], jet)
    w = jet[W]
    for m in range(4):
        f = jet[m] / w
        fu, fv = (jet[JU + m] - f * jet[JU + W]) / w, (jet[JV + m] - f * jet[JV + W]) / w
        out[U + m], out[V + m] = fu, fv
        out[UU + m] = (jet[JUU + m] - 2.0 * fu * jet[JU + W] - f * jet[JUU + W]) / w
        out[UV + m] = (jet[JUV + m] - fu * jet[JV + W] - fv * jet[JU + W] - f * jet[JUV + W]) / w
        out[VV + m] = (jet[JVV + m] - 2.0 * fv * jet[JV + W] - f * jet[JVV + W]) / w


@inner()
def _derivatives(
    x: float, y: float, z: float, order: int, blend: float, hits: Any, touched: Any, weight: Any,
    size: int, piece: Any, d: Any, work: Any, g: Any, h: Any,
) -> None:  # fmt: skip
    """Gradient, and second derivatives for order 2, of the union at one point."""
    n, total = work[AWAY:TOTAL], work[TOTAL:SLOPES]
    for i in range(3):
        total[i] = g[i] = 0.0
        for j in range(3 if order > 1 else 0):
            h[i, j] = 0.0
    for k in range(size):
        hit = hits[touched[k]]
        n[0], n[1], n[2] = x - hit[FOOT], y - hit[FOOT + 1], z - hit[FOOT + 2]
        dist = math.sqrt(n[0] * n[0] + n[1] * n[1] + n[2] * n[2])
        for i in range(3):
            n[i] = n[i] / dist if dist > 0.0 else 0.0
            g[i] += weight[k] * n[i]
            total[i] += n[i]
        if order < 2:
            continue
        if dist > 0.0:
            _add_hessian(hit, n, dist, weight[k], piece, d, work, h)
        if size > 1:
            for i in range(3):
                for j in range(3):
                    h[i, j] -= n[i] * n[j] / blend
    if order == 2 and size > 1:
        for i in range(3):
            for j in range(3):
                h[i, j] += total[i] * total[j] / (blend * size)


@inner()
def _cut(
    x: float, y: float, z: float, plane: Any, order: int, value: float, g: Any, h: Any
) -> float:
    """Intersection with half-spaces ``plane[:3] . x <= plane[3]``."""
    for i in range(plane.shape[0]):
        f = plane[i, 0] * x + plane[i, 1] * y + plane[i, 2] * z - plane[i, 3]
        if f > value:
            value = f
            for j in range(3 if order > 0 else 0):
                g[j] = plane[i, j]
                for k in range(3 if order > 1 else 0):
                    h[j, k] = 0.0
    return value


@inner(owning=True)
def _chunk(
    points: Any, start: int, stop: int, order: int, blend: float, limit: float, tree: Any,
    plane: Any, f: Any, g: Any, h: Any,
) -> None:  # fmt: skip
    """Value and derivatives at points start to stop, with scratch of its own."""
    tree = borrowed(tree)
    hits = np.full((tree.groups, HIT), np.inf)
    touched = np.empty(tree.groups, np.int64)
    weight = np.empty(tree.groups)
    stack = np.empty((DEPTH, 5 * tree.width))
    span = np.empty((DEPTH, 4))
    work = np.empty(1000 + 60 * tree.width)
    path = np.empty(STACK, np.int64)
    no_g, no_h = np.empty(3), np.empty((3, 3))
    least = 0.0
    for i in range(start, stop):
        x, y, z = points[i, 0], points[i, 1], points[i, 2]
        if i == start:
            bound = _farthest(tree.box, x, y, z) + SLACK
        else:
            dx, dy, dz = x - points[i - 1, 0], y - points[i - 1, 1], z - points[i - 1, 2]
            bound = least + math.sqrt(dx * dx + dy * dy + dz * dz) + SLACK
        found, least = _nearest(
            x, y, z, min(bound, limit), blend, tree, hits, touched, stack, span, work, path
        )
        value, size = _union(hits, touched, found, least, blend, weight)
        gi = g[i] if order > 0 else no_g
        hi = h[i] if order > 1 else no_h
        if order > 0:
            _derivatives(
                x, y, z, order, blend, hits, touched, weight, size, tree.piece, tree.data, work,
                gi, hi,
            )  # fmt: skip
        f[i] = _cut(x, y, z, plane, order, value, gi, hi)
        for k in range(found):
            hits[touched[k], F] = np.inf


@in_ranges(CHUNK)
@outer(nogil=True)
def skeleton_jets(
    first: int, last: int, points: Any, order: int, blend: float, limit: float, tree: Any,
    plane: Any, f: Any, g: Any, h: Any,
) -> None:  # fmt: skip
    """Value and derivatives of a skeleton at points.

    Parameters
    ----------
    first, last
        Which points.
    points
        (n, 3).
    order
        Highest derivative.
    blend
        Width of the smooth union.
    limit
        Where all pieces are farther, this is the value before half-spaces are cut, and the
        gradient is zero.
    tree
        The pieces.
    plane
        Half-spaces that limit the solid, (k, 4).
    f, g, h
        Results, (n,), (n, 3), (n, 3, 3); `g` and `h` are used as far as `order` asks.
    """
    for start in range(first, last, CHUNK):
        _chunk(points, start, min(last, start + CHUNK), order, blend, limit, tree, plane, f, g, h)
