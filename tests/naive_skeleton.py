"""Dense oracles for least distances: sample, take every local minimum, refine each by bisection.

Written against `ilattice.tiles.skeleton`, with nothing shared but `BSpline` evaluation.
"""

from itertools import pairwise

import numpy as np


def curve_minimum(points, curve, radius=lambda t: 0.0 * t, samples=400):
    """Least |x - C(t)| - r(t): dense samples per span, then thirds of the brackets."""
    breaks = curve.breaks(0)
    best = np.full(len(points), np.inf)
    for a, b in pairwise(breaks):
        t = np.linspace(a, b, samples)
        q, r = curve(t), radius(t)
        f = np.linalg.norm(points[:, None] - q[None], axis=2) - r
        best = np.minimum(best, f.min(axis=1))
        inner = np.ones_like(f, dtype=bool)
        inner[:, 1:] &= f[:, 1:] <= f[:, :-1]
        inner[:, :-1] &= f[:, :-1] <= f[:, 1:]
        row, col = np.nonzero(inner)
        low, high = t[np.maximum(col - 1, 0)], t[np.minimum(col + 1, samples - 1)]

        def value(s, row=row):
            return np.linalg.norm(points[row] - curve(s), axis=1) - radius(s)

        for _ in range(45):
            one, two = low + (high - low) / 3, high - (high - low) / 3
            left = value(one) < value(two)
            low, high = np.where(left, low, one), np.where(left, two, high)
        np.minimum.at(best, row, np.minimum(value(low), value(high)))
    return best


def surface_minimum(points, surface, samples=41):
    """Least |x - S(u, v)|: dense samples per element, then a shrinking pattern search of each."""
    best = np.full(len(points), np.inf)
    edges = [surface.breaks(axis) for axis in range(2)]
    for ua, ub in pairwise(edges[0]):
        for va, vb in pairwise(edges[1]):
            np.minimum(best, _element(points, surface, (ua, va), (ub, vb), samples), out=best)
    return best


def _element(points, surface, low, high, samples):
    low, high = np.array(low), np.array(high)
    s = np.linspace(0.0, 1.0, samples)
    grid = low + np.stack(np.meshgrid(s, s, indexing="ij"), axis=-1) * (high - low)
    q = surface(grid.reshape(-1, 2))
    f = np.linalg.norm(points[:, None] - q[None], axis=2).reshape(-1, samples, samples)
    wide = np.pad(f, [(0, 0), (1, 1), (1, 1)], constant_values=np.inf)
    least = np.ones_like(f, dtype=bool)
    for i in range(3):
        for j in range(3):
            least &= f <= wide[:, i : i + samples, j : j + samples]
    row, iu, iv = np.nonzero(least)
    u = grid[iu, iv]
    for _ in range(60):
        u = np.clip(u + _newton(points[row], surface, u, low, high), low, high)
    value = np.linalg.norm(points[row] - surface(u), axis=1)
    best = f.reshape(len(points), -1).min(axis=1)
    np.minimum.at(best, row, value)
    return best


def _newton(points, surface, u, low, high):
    """Damped Newton step of |x - S|²/2 in the box; coordinates pressed onto an end stay there."""
    q, g, h = surface.jet(u, 2)
    d = q - points
    slope = np.einsum("nm,nmi->ni", d, g)
    bend = np.einsum("nmi,nmj->nij", g, g) + np.einsum("nm,nmij->nij", d, h)
    held = ((u <= low) & (slope >= 0)) | ((u >= high) & (slope <= 0))
    slope = np.where(held, 0.0, slope)
    bend = np.where(held[:, :, None] | held[:, None, :], np.eye(2), bend)
    good = (np.linalg.det(bend) > 0) & (bend[:, 0, 0] > 0)
    gauss = np.einsum("nmi,nmj->nij", g, g)
    gauss = np.where(held[:, :, None] | held[:, None, :], np.eye(2), gauss)
    bend = np.where(good[:, None, None], bend, gauss + 1e-12 * np.eye(2))
    step = -np.linalg.solve(bend, slope[:, :, None])[:, :, 0]
    size = np.abs(step).max(axis=1, keepdims=True)
    return step * np.minimum(1.0, 0.05 / np.maximum(size, 1e-300))
