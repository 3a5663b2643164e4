"""Unions of round cones: the nearest one of many, in a tree of boxes.

A beam is a row of eight numbers: radii at both ends, then both ends.

Guarantees: a beam is passed over only if a box proves it farther than needed; values do not depend
on the number of threads or on the points before; nothing is allocated per point.
"""

import math
from typing import Any

import numpy as np
from numba import njit

from ilattice._kernels import in_ranges, inner, outer
from ilattice.tiles._kernels_closest import FAST
from ilattice.tiles._kernels_skeleton import _add_curve, _add_point, _segment

#: Nodes of a tree that wait at most, far more than it is deep; lengths that rounding may be off.
STACK = 128
SLACK = 1e-12


@njit(cache=True, fastmath=FAST, inline="always")
def _least(box: Any, wide: Any, i: int, x: float, y: float, z: float) -> float:
    """No beam in node i is nearer."""
    u = max(max(box[i, 0] - x, x - box[i, 3]), 0.0)
    v = max(max(box[i, 1] - y, y - box[i, 4]), 0.0)
    w = max(max(box[i, 2] - z, z - box[i, 5]), 0.0)
    return math.sqrt(u * u + v * v + w * w) - wide[i]


@inner(fastmath=FAST)
def _nearest(
    x: float, y: float, z: float, bound: float, box: Any, wide: Any, link: Any, beam: Any,
    flat: Any, hit: Any, nodes: Any, least: Any,
) -> None:  # fmt: skip
    """Nearest beam to a point, if it is nearer than a bound: see columns of `_kernels_skeleton`."""
    hit[0] = bound
    nodes[0], least[0] = 0, _least(box, wide, 0, x, y, z)
    top = 1
    while top > 0:
        top -= 1
        if least[top] - SLACK > hit[0]:
            continue
        node = nodes[top]
        while link[node, 2] == 0:
            a, b = node + 1, link[node, 0]
            da, db = _least(box, wide, a, x, y, z), _least(box, wide, b, x, y, z)
            if db < da:
                a, b, da, db = b, a, db, da
            if db - SLACK <= hit[0]:
                nodes[top], least[top] = b, db
                top += 1
            node = a
            if da - SLACK > hit[0]:
                break
        for i in range(link[node, 1], link[node, 1] + link[node, 2]):
            before = hit[0]
            s = 8 * i
            _segment(flat, s, s + 2, s + 5, x, y, z, hit, 1)
            if hit[0] < before:
                hit[6] = i


@in_ranges(1024)
@outer(nogil=True, fastmath=FAST)
def values(
    first: int, last: int, points: Any, box: Any, wide: Any, link: Any, beam: Any, out: Any
) -> None:
    """Values at points (n, 3); each starts from what the point before it knows."""
    nodes, least, hit = np.empty(STACK, np.int64), np.empty(STACK), np.zeros(8)
    flat = beam.reshape(-1)
    bound = np.inf
    px = py = pz = 0.0
    for i in range(first, last):
        x, y, z = points[i, 0], points[i, 1], points[i, 2]
        step = math.sqrt((x - px) ** 2 + (y - py) ** 2 + (z - pz) ** 2)
        size = abs(x) + abs(y) + abs(z) + abs(px) + abs(py) + abs(pz)
        start = bound + step * (1.0 + 1e-12) + SLACK * (1.0 + size + abs(bound))
        _nearest(x, y, z, start, box, wide, link, beam, flat, hit, nodes, least)
        out[i] = bound = hit[0]
        px, py, pz = x, y, z


@in_ranges(512)
@outer(nogil=True, fastmath=FAST)
def jets(
    first: int, last: int, points: Any, box: Any, wide: Any, link: Any, beam: Any, order: Any,
    value: Any, gradient: Any, hessian: Any,
) -> None:  # fmt: skip
    """Values, gradients, and Hessians if `order` is 2, of the nearest beam."""
    nodes, least, hit = np.empty(STACK, np.int64), np.empty(STACK), np.zeros(8)
    flat, c, n, h = beam.reshape(-1), np.zeros(8), np.zeros(3), np.zeros((3, 3))
    for i in range(first, last):
        x, y, z = points[i, 0], points[i, 1], points[i, 2]
        _nearest(x, y, z, np.inf, box, wide, link, beam, flat, hit, nodes, least)
        value[i] = hit[0]
        n[0], n[1], n[2] = x - hit[1], y - hit[2], z - hit[3]
        dist = math.sqrt(n[0] * n[0] + n[1] * n[1] + n[2] * n[2])
        s = 8 * int(hit[6])
        if dist == 0.0:  # on the axis: any direction across it
            _across(flat, s, n)
        else:
            for a in range(3):
                n[a] /= dist
        gradient[i, 0], gradient[i, 1], gradient[i, 2] = n[0], n[1], n[2]
        if order < 2:
            continue
        h[:] = 0.0
        if dist > 0.0:
            if hit[7] == 0.0:
                _add_point(n, dist, 1.0, h)
            else:
                for a in range(3):
                    c[a] = flat[s + 5 + a] - flat[s + 2 + a]
                c[3] = flat[s + 1] - flat[s]
                _add_curve(n, dist, 1.0, c, 0, 4, h)
        for a in range(3):
            for b in range(3):
                hessian[i, a, b] = h[a, b]


@inner(owning=True)
def _across(flat: Any, s: int, n: Any) -> None:
    """A unit vector across a beam."""
    small = 0
    d = np.empty(3)
    for a in range(3):
        d[a] = flat[s + 5 + a] - flat[s + 2 + a]
    for a in range(1, 3):
        if abs(d[a]) < abs(d[small]):
            small = a
    n[:] = 0.0
    n[small] = 1.0
    square = d[0] * d[0] + d[1] * d[1] + d[2] * d[2]
    part = d[small] / square
    size = 0.0
    for a in range(3):
        n[a] -= part * d[a]
        size += n[a] * n[a]
    for a in range(3):
        n[a] /= math.sqrt(size)


@in_ranges(256)
@outer(nogil=True, fastmath=FAST)
def among(
    first: int, last: int, points: Any, reach: Any, box: Any, wide: Any, link: Any, beam: Any,
    out: Any, count: Any,
) -> None:  # fmt: skip
    """Beams whose values at points are within `reach` of the least, in rising order.

    `out` (n, most) takes as many as it has room for, `count` (n,) how many there are.
    """
    nodes, least = np.empty(STACK, np.int64), np.empty(STACK)
    hit, one = np.zeros(8), np.zeros(8)
    flat, most = beam.reshape(-1), out.shape[1]
    for i in range(first, last):
        x, y, z = points[i, 0], points[i, 1], points[i, 2]
        _nearest(x, y, z, np.inf, box, wide, link, beam, flat, hit, nodes, least)
        bound = hit[0] + reach[i]
        found, top = 0, 1
        nodes[0] = 0
        while top > 0:
            top -= 1
            node = nodes[top]
            if _least(box, wide, node, x, y, z) - SLACK > bound:
                continue
            if link[node, 2] == 0:
                nodes[top], nodes[top + 1] = link[node, 0], node + 1
                top += 2
                continue
            for j in range(link[node, 1], link[node, 1] + link[node, 2]):
                one[0] = np.inf
                s = 8 * j
                _segment(flat, s, s + 2, s + 5, x, y, z, one, 1)
                if one[0] <= bound + SLACK:
                    if found < most:
                        out[i, found] = j
                    found += 1
        count[i] = found
