"""Schwarz P from the Weierstrass representation, in the octant [0, 1/2]³ of the unit cell.

About the branch point w0 = (√3 - 1)/√2 of w⁸ - 14 w⁴ + 1 the surface is a smooth function of s with
w = w0 + s²: the integral over ds has no singularity. Shares no code with `ilattice.minimal`.
"""

import numpy as np

W0 = (np.sqrt(3.0) - 1.0) / np.sqrt(2.0)
ROOTS = np.roots([1, 0, 0, 0, -14, 0, 0, 0, 1])
OTHERS = ROOTS[np.abs(ROOTS - W0) > 1e-6]
NODES, WEIGHTS = np.polynomial.legendre.leggauss(60)
#: Half the edge of the octant at the scale of the representation.
HALF = 1.0782578 / 2.0


def slope(s):
    """Complex derivative of the position by s, shape (n, 3)."""
    w = W0 + s * s
    root = np.ones_like(w)
    for r in OTHERS:
        root = root * np.sqrt((w - r) / (W0 - r)) * np.sqrt(W0 - r + 0j)
    phi = np.stack([1.0 - w * w, 1j * (1.0 + w * w), 2.0 * w], axis=-1)
    return 2.0 * np.exp(0.5j * np.pi) * phi / root[..., None]


def position(s):
    """Points, shape (n, 3), at the scale of the representation, from the flat point."""
    t = 0.5 * (NODES + 1.0)
    return np.einsum("k,nkc->nc", 0.5 * WEIGHTS, slope(s[:, None] * t) * s[:, None, None]).real


def placed(s):
    """Points in the octant of the unit cell, shape (n, 3)."""
    x, c = position(s), np.sqrt(0.5)
    turned = np.stack([c * (x[:, 0] - x[:, 1]), c * (x[:, 0] + x[:, 1]), -x[:, 2]], axis=1)
    return 0.25 + 0.25 / HALF * turned


def normal(s):
    """Unit normals, shape (n, 3)."""
    w, c = W0 + s * s, np.sqrt(0.5)
    n = np.stack([2.0 * w.real, 2.0 * w.imag, np.abs(w) ** 2 - 1.0], axis=1)
    n /= 1.0 + np.abs(w[:, None]) ** 2
    return np.stack([c * (n[:, 0] - n[:, 1]), c * (n[:, 0] + n[:, 1]), -n[:, 2]], axis=1)


def distances(x):
    """Distance, shape (n,), of points next to the octant's patch from the exact surface."""
    r, a = np.meshgrid(np.linspace(0.0, 0.85, 40), np.linspace(0.0, 2 * np.pi, 97)[:-1])
    start = (r * np.exp(1j * a)).ravel()
    known = placed(start)
    s = start[((x[:, None] - known[None]) ** 2).sum(axis=2).argmin(axis=1)]
    for _ in range(8):
        dx, c = slope(s), np.sqrt(0.5)
        dx = np.stack([c * (dx[:, 0] - dx[:, 1]), c * (dx[:, 0] + dx[:, 1]), -dx[:, 2]], axis=1)
        dx *= 0.25 / HALF
        off = x - placed(s)
        square = (np.abs(dx) ** 2).sum(axis=1) / 2.0
        step = (off * dx.conj()).sum(axis=1) / np.maximum(square, 1e-12)
        s = s + step
    return np.linalg.norm(x - placed(s), axis=1)
