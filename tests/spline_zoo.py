"""Splines of every kind that a file may hold, and how to compare them."""

import numpy as np

from ilattice.bspline import BSpline


def clamped_knots(n: int, k: int, rng: np.random.Generator) -> np.ndarray:
    inner = np.sort(rng.uniform(0.1, 2.9, n - k - 1))
    return np.concatenate([np.zeros(k + 1), inner, np.full(k + 1, 3.0)])


def periodic_knots(spans: int, k: int, rng: np.random.Generator) -> np.ndarray:
    base = np.sort(rng.uniform(0.0, 2.0, spans))
    i = np.arange(-k, spans + k + 1)
    return base[i % spans] + 2.0 * (i // spans)


def make(
    k: tuple[int, ...],
    n: tuple[int, ...],
    m: int,
    *,
    rational: bool = False,
    periodic: tuple[bool, ...] = (False, False, False),
    seed: int = 0,
) -> BSpline:
    """Deformed block; `n` counts the wrapped copies of periodic directions."""
    rng = np.random.default_rng(seed)
    knots = [
        periodic_knots(n[i] - k[i], k[i], rng) if periodic[i] else clamped_knots(n[i], k[i], rng)
        for i in range(len(k))
    ]
    grid = np.stack(np.meshgrid(*[np.arange(i, dtype=float) for i in n], indexing="ij"), -1)
    c = np.concatenate([grid, rng.normal(size=(*n, max(m - len(n), 0)))], -1)[..., : max(m, 1)]
    c = c + rng.normal(scale=0.1, size=c.shape)
    w = rng.uniform(0.5, 2.0, n) if rational else None
    for axis in range(len(k)):
        if periodic[axis]:
            around = np.arange(n[axis]) % (n[axis] - k[axis])
            c = np.take(c, around, axis)
            w = None if w is None else np.take(w, around, axis)
    return BSpline(knots, c if m else c[..., 0], k, periodic=periodic[: len(k)], weights=w)


def repeated_knots() -> BSpline:
    t = [np.array([0, 0, 0, 1, 1, 2, 2, 2.0]), np.array([0, 0, 0.5, 0.5, 1, 1]), [0, 0, 1, 1]]
    c = np.random.default_rng(5).normal(size=(5, 4, 2, 3))
    return BSpline(t, c, (2, 1, 1))


def unclamped() -> BSpline:
    t = [np.array([-1.0, 0.3, 1, 2, 3.7, 4, 6]), [0, 0, 1, 1], np.arange(8.0)]
    c = np.random.default_rng(6).normal(size=(4, 2, 4, 3))
    return BSpline(t, c, (2, 1, 3))


def left_handed() -> BSpline:
    s = make((2, 1, 1), (4, 3, 2), 3, seed=7)
    return BSpline(s.t, s.c[..., [1, 0, 2]], s.k)


#: Volumes in space, with the names of their extra coordinates.
ZOO = {
    "trilinear": (make((1, 1, 1), (2, 2, 2), 3), ()),
    "mixed degrees": (make((3, 1, 2), (6, 3, 5), 3, seed=1), ()),
    "degree 8": (make((8, 1, 1), (10, 2, 2), 3, seed=2), ()),
    "rational": (make((2, 1, 3), (4, 2, 6), 3, rational=True, seed=3), ()),
    "closed": (make((3, 1, 1), (8, 3, 2), 3, periodic=(True, False, False), seed=4), ()),
    "closed rational": (
        make((2, 1, 3), (7, 3, 8), 3, rational=True, periodic=(True, False, True), seed=5),
        (),
    ),
    "closed linear": (make((1, 2, 1), (5, 4, 2), 3, periodic=(True, True, False), seed=9), ()),
    "colour and thickness": (make((2, 2, 1), (4, 3, 2), 7, seed=6), ("r", "g", "b", "d")),
    "rational material": (make((1, 2, 1), (3, 3, 2), 4, rational=True, seed=8), ("material",)),
    "left-handed": (left_handed(), ()),
    "repeated knots": (repeated_knots(), ()),
    "unclamped": (unclamped(), ()),
}


def sites(s: BSpline, count: int = 60) -> np.ndarray:
    """Parameters inside the domain, its corners included."""
    lo, hi = s.domain
    u = np.random.default_rng(11).uniform(lo, hi, (count, s.ndim))
    corners = np.stack(np.meshgrid(*[[a, b] for a, b in zip(lo, hi, strict=True)]), -1)
    return np.concatenate([u, corners.reshape(-1, s.ndim)])
