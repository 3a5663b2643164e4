"""Reference implementation of distances to meshes: extended precision, an exact inside."""

from fractions import Fraction

import numpy as np

BITS = 220  # coordinates are multiples of 2**-BITS


def distance(points, vertices, faces):
    """Unsigned distance by brute force in extended precision, shape (n,), and a nearest face."""
    p = np.asarray(points, np.longdouble)[:, None]
    a, b, c = np.moveaxis(np.asarray(vertices, np.longdouble)[faces], 1, 0)
    square = np.minimum(to_segments(p, a, b), to_segments(p, b, c))
    square = np.minimum(square, to_segments(p, c, a))
    normal = np.cross(b - a, c - a)
    size = (normal**2).sum(-1)
    ok = size > 0
    height = ((p - a) * normal).sum(-1)
    inside = np.ones(square.shape, bool)
    for s, e in ((a, b), (b, c), (c, a)):
        inside &= (np.cross(e - s, p - s) * normal).sum(-1) > 0
    flat = height**2 / np.where(ok, size, 1)
    square = np.where(inside & ok, np.minimum(square, flat), square)
    return np.sqrt(square.min(axis=1)).astype(float), square.argmin(axis=1)


def to_segments(p, a, b):
    """Squared distances of points (n, 1, 3) to segments (f, 3)."""
    e = b - a
    length = (e * e).sum(-1)
    t = np.clip(((p - a) * e).sum(-1) / np.where(length > 0, length, 1), 0, 1)
    return ((p - a - t[..., None] * e) ** 2).sum(-1)


def inside(points, vertices, faces):
    """Whether points lie in a closed polyhedron, in whole numbers: parity of crossed faces.

    A ray that meets an edge is an error: choose other points.
    """
    v, p = integers(vertices), integers(points)
    a, b, c = (v[faces[:, i]] for i in range(3))
    far = np.array([3141592653, 2718281828, 1618033988], object) << (BITS + 8)
    out = np.zeros(len(p), bool)
    for i, q in enumerate(p):
        up, down = volume(a, b, c, q), volume(a, b, c, q + far)
        sides = np.sign([volume(s, e, q, q + far) for s, e in ((a, b), (b, c), (c, a))])
        opposite = np.sign(up) * np.sign(down) < 0
        hit = opposite & (np.abs(sides.sum(axis=0)) == 3)
        assert not (opposite & (sides == 0).any(axis=0) & (np.abs(sides.sum(axis=0)) == 2)).any()
        out[i] = hit.sum() % 2 == 1
    return out


def integers(a):
    """Coordinates times 2**BITS as whole numbers of any length."""
    values = [Fraction(x) * 2**BITS for x in np.asarray(a, float).ravel().tolist()]
    assert all(x.denominator == 1 for x in values)
    return np.array([int(x) for x in values], object).reshape(np.shape(a))


def volume(a, b, c, d):
    """Six times the volume of tetrahedra."""
    (u0, u1, u2), (v0, v1, v2), (w0, w1, w2) = ((x - d).T for x in np.broadcast_arrays(a, b, c))
    return u0 * (v1 * w2 - v2 * w1) + u1 * (v2 * w0 - v0 * w2) + u2 * (v0 * w1 - v1 * w0)
