"""Naive cut-cell rules: an octree of boxes, then tetrahedra cut by planes."""

from itertools import permutations

import numpy as np

CORNERS = np.array([(i, j, k) for i in (0, 1) for j in (0, 1) for k in (0, 1)], float)


def _kuhn():
    """Corners of the six tetrahedra of a cube along its diagonal."""
    out = []
    for order in permutations(range(3)):
        path = [np.zeros(3, int)]
        for axis in order:
            step = path[-1].copy()
            step[axis] = 1
            path.append(step)
        out.append([int(p @ [4, 2, 1]) for p in path])
    return np.array(out)


TETRAHEDRA = _kuhn()


def measure(f, lo, hi, depth, lipschitz):
    """Volume of {f < 0} and area of {f = 0} in a box.

    Boxes without a sign change, by the Lipschitz constant, are full or empty; the others are
    halved `depth` times in all directions, then f is taken as linear on six tetrahedra each.
    """
    lo, hi = np.asarray(lo, float), np.asarray(hi, float)
    boxes, size = lo[None], hi - lo
    volume = 0.0
    for level in range(depth + 1):
        middle = f(boxes + 0.5 * size)
        reach = lipschitz * 0.5 * np.linalg.norm(size)
        volume += (middle <= -reach).sum() * size.prod()
        boxes = boxes[np.abs(middle) < reach]
        if level < depth:
            size = 0.5 * size
            boxes = (boxes[:, None] + CORNERS * size).reshape(-1, 3)
    points = boxes[:, None] + CORNERS * size
    values = f(points.reshape(-1, 3)).reshape(-1, 8)
    v, a = _tetrahedra(
        points[:, TETRAHEDRA].reshape(-1, 4, 3), values[:, TETRAHEDRA].reshape(-1, 4)
    )
    return volume + v, a


def richardson(f, lo, hi, depth, lipschitz):
    """`measure` extrapolated from two depths, for errors of second order."""
    coarse = np.array(measure(f, lo, hi, depth - 1, lipschitz))
    fine = np.array(measure(f, lo, hi, depth, lipschitz))
    return fine + (fine - coarse) / 3.0


def _tetrahedra(p, f):
    """Volume and area of linear functions with values f (n, 4) at corners p (n, 4, 3)."""
    order = np.argsort(f, axis=1)
    f = np.take_along_axis(f, order, axis=1)
    p = np.take_along_axis(p, order[..., None], axis=1)
    negative = (f < 0).sum(axis=1)
    volume = _size(p[negative == 4]).sum()
    area = 0.0
    for count in (1, 2, 3):
        q, g = p[negative == count], f[negative == count]

        def on(i, j, q=q, g=g):
            t = g[:, i] / (g[:, i] - g[:, j])
            return q[:, i] + t[:, None] * (q[:, j] - q[:, i])

        if count == 1:
            a, b, c = on(0, 1), on(0, 2), on(0, 3)
            volume += _size(np.stack([q[:, 0], a, b, c], 1)).sum()
            area += _triangle(a, b, c)
        elif count == 3:
            a, b, c = on(0, 3), on(1, 3), on(2, 3)
            volume += (_size(q) - _size(np.stack([q[:, 3], a, b, c], 1))).sum()
            area += _triangle(a, b, c)
        else:
            ac, ad, bc, bd = on(0, 2), on(0, 3), on(1, 2), on(1, 3)
            for part in ((q[:, 0], ac, ad, bd), (q[:, 0], ac, bc, bd), (q[:, 0], q[:, 1], bc, bd)):
                volume += _size(np.stack(part, 1)).sum()
            area += _triangle(ac, ad, bd) + _triangle(ac, bc, bd)
    return volume, area


def _size(p):
    return np.abs(np.linalg.det(p[:, 1:] - p[:, :1])) / 6.0


def _triangle(a, b, c):
    return 0.5 * np.linalg.norm(np.cross(b - a, c - a), axis=1).sum()
