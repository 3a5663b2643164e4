"""Flips of simplices that share a vertex, and whether simplices overlap.

Guarantees: a flip that is refused changes nothing; two simplices are called apart only if an axis
separates them.
"""

import math
from typing import Any

import numpy as np

from ilattice._kernels import inner, outer


@outer()
def swap(s: Any, vt: Any, v: Any, a: Any, b: Any) -> bool:
    """Exchange vertex a of the first simplex of v with vertex b of its second one.

    False, and nothing is done, if v has one simplex only, a and b are not these, or one of the new
    simplices would share two vertices with another one.
    """
    A, B = vt[v, 0], vt[v, 1]
    if B < 0 or a == v or b == v:
        return False
    pa = pb = -1
    for i in range(s.shape[1]):
        if s[A, i] == a:
            pa = i
        if s[B, i] == b:
            pb = i
    if pa < 0 or pb < 0:
        return False
    if _meets(s, vt, b, B, A, a) or _meets(s, vt, a, A, B, b):
        return False
    s[A, pa], s[B, pb] = b, a
    for c, old, new in ((a, A, B), (b, B, A)):
        if vt[c, 0] == old:
            vt[c, 0] = new
        else:
            vt[c, 1] = new
        if vt[c, 1] >= 0 and vt[c, 0] > vt[c, 1]:
            vt[c, 0], vt[c, 1] = vt[c, 1], vt[c, 0]
    return True


@inner()
def _meets(s: Any, vt: Any, b: int, B: int, A: int, a: int) -> bool:
    """Whether the other simplex of b shares a vertex, but for a, with A."""
    other = vt[b, 1] if vt[b, 0] == B else vt[b, 0]
    if other < 0:
        return False
    if other == A:
        return True
    for i in range(s.shape[1]):
        for j in range(s.shape[1]):
            if s[other, i] == s[A, j] and s[A, j] != a:
                return True
    return False


@inner()
def _apart(x: Any, p: Any, q: Any, axis: Any, least: float) -> bool:
    """Whether two simplices overlap by no more than `least` along an axis of any length."""
    d = x.shape[1]
    size = 0.0
    for k in range(d):
        size += axis[k] * axis[k]
    if size < 1e-24:
        return False
    size = math.sqrt(size)
    plow = qlow = np.inf
    phigh = qhigh = -np.inf
    for i in range(len(p)):
        f = g = 0.0
        for k in range(d):
            f += axis[k] * x[p[i], k]
            g += axis[k] * x[q[i], k]
        plow, phigh = min(plow, f), max(phigh, f)
        qlow, qhigh = min(qlow, g), max(qhigh, g)
    return min(phigh, qhigh) - max(plow, qlow) <= least * size


@inner()
def _cross(a: Any, b: Any, out: Any) -> None:
    out[0] = a[1] * b[2] - a[2] * b[1]
    out[1] = a[2] * b[0] - a[0] * b[2]
    out[2] = a[0] * b[1] - a[1] * b[0]


@inner(owning=True)
def overlap(x: Any, p: Any, q: Any, eps: float) -> bool:
    """Whether two simplices overlap by more than eps times their longest edge, along all axes."""
    d = x.shape[1]
    longest = 0.0
    for t in (p, q):
        for i in range(d + 1):
            for j in range(i):
                e = 0.0
                for k in range(d):
                    e += (x[t[i], k] - x[t[j], k]) ** 2
                longest = max(longest, e)
    longest = math.sqrt(longest)
    least = eps * longest
    axis, u, w = np.zeros(d), np.zeros(d), np.zeros(d)
    for t in (p, q):
        for i in range(d + 1):
            for j in range(i):
                for k in range(d):
                    u[k] = (x[t[i], k] - x[t[j], k]) / longest
                if d == 2:
                    axis[0], axis[1] = -u[1], u[0]
                    if _apart(x, p, q, axis, least):
                        return False
                    continue
                for m in range(j):
                    for k in range(d):
                        w[k] = (x[t[i], k] - x[t[m], k]) / longest
                    _cross(u, w, axis)
                    if _apart(x, p, q, axis, least):
                        return False
    if d == 3:
        for i in range(4):
            for j in range(i):
                for k in range(3):
                    u[k] = (x[p[i], k] - x[p[j], k]) / longest
                for m in range(4):
                    for n in range(m):
                        for k in range(3):
                            w[k] = (x[q[m], k] - x[q[n], k]) / longest
                        _cross(u, w, axis)
                        if _apart(x, p, q, axis, least):
                            return False
    return True


@outer()
def overlaps(x: Any, s: Any, pairs: Any, eps: Any, out: Any) -> None:
    """Which pairs of simplices overlap."""
    for i in range(len(pairs)):
        out[i] = overlap(x, s[pairs[i, 0]], s[pairs[i, 1]], eps)


@inner(owning=True)
def _flat(x: Any, p: Any, eps: float) -> bool:
    """Whether a simplex has no volume to speak of."""
    d = x.shape[1]
    m = np.zeros((d, d))
    size = 0.0
    for i in range(d):
        for k in range(d):
            m[i, k] = x[p[i + 1], k] - x[p[0], k]
            size = max(size, abs(m[i, k]))
    if d == 2:
        return abs(m[0, 0] * m[1, 1] - m[0, 1] * m[1, 0]) <= eps * size * size
    v = (
        m[0, 0] * (m[1, 1] * m[2, 2] - m[1, 2] * m[2, 1])
        - m[0, 1] * (m[1, 0] * m[2, 2] - m[1, 2] * m[2, 0])
        + m[0, 2] * (m[1, 0] * m[2, 1] - m[1, 1] * m[2, 0])
    )
    return abs(v) <= eps * size * size * size


@outer()
def overlaps_any(x: Any, s: Any, one: Any, eps: Any) -> bool:
    """Whether a simplex is flat or overlaps any other one; boxes are compared first."""
    d = x.shape[1]
    if _flat(x, s[one], eps):
        return True
    for t in range(len(s)):
        if t == one:
            continue
        away = False
        for k in range(d):
            plow = qlow = np.inf
            phigh = qhigh = -np.inf
            for i in range(d + 1):
                plow, phigh = min(plow, x[s[one, i], k]), max(phigh, x[s[one, i], k])
                qlow, qhigh = min(qlow, x[s[t, i], k]), max(qhigh, x[s[t, i], k])
            away |= phigh <= qlow or qhigh <= plow
        if not away and overlap(x, s[one], s[t], eps):
            return True
    return False
