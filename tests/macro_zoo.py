"""Maps of every kind: built in, swept, rational, left-handed, perturbed."""

import numpy as np

from ilattice import macroshape as ms
from ilattice.bspline import BSpline
from ilattice.bspline.knots import greville, uniform_knots
from ilattice.macroshape import SplineMap


def perturbed(
    n: tuple[int, int, int],
    k: tuple[int, int, int],
    amount: float,
    *,
    seed: int = 0,
    rational: bool = False,
) -> SplineMap:
    """The unit cube with control points moved at random by about `amount` of their spacing."""
    rng = np.random.default_rng(seed)
    t = [uniform_knots(a - b, b) for a, b in zip(n, k, strict=True)]
    sites = [greville(a, b) for a, b in zip(t, k, strict=True)]
    c = np.stack(np.meshgrid(*sites, indexing="ij"), axis=-1)
    c += amount / max(n) * rng.standard_normal(c.shape)
    w = np.exp(0.3 * rng.standard_normal(n)) if rational else None
    return SplineMap(BSpline(t, c, k, weights=w))


def parameters(volume: SplineMap, count: int, seed: int = 0) -> np.ndarray:
    """Random parameters, and the corners of the domain."""
    lo, hi = volume.domain
    corners = np.array(list(np.ndindex(2, 2, 2)), dtype=float)
    u = np.concatenate([corners, np.random.default_rng(seed).random((count, 3))])
    return lo + u * (hi - lo)


def patch() -> BSpline:
    """Biquadratic surface over the unit square, gently bent."""
    x, y = np.meshgrid(np.linspace(0, 1, 4), np.linspace(0, 1, 3), indexing="ij")
    c = np.stack([x, y, 0.2 * np.sin(3 * x) * np.cos(2 * y)], axis=-1)
    return BSpline([uniform_knots(2, 2), uniform_knots(1, 2)], c, 2)


ZOO = {
    "identity": ms.identity(),
    "affine": ms.affine([[1, 0.5, 0], [0, 1, 0.2], [0.1, 0, 2]], (1, 2, 3)),
    "box": ms.box((1, 2, 3)),
    "tapered": ms.tapered(),
    "torus": ms.torus(),
    "torus arcs": ms.torus(form="arcs"),
    "torus exact": ms.torus(form="exact"),
    "shell": ms.cylinder_shell(angle=2.0),
    "duck": ms.duck(),
    "wing": ms.wing(),
    "extruded": ms.extrude(patch()),
    "revolved": ms.revolve(patch(), axis=(0, 1, 0), angle=1.0, center=(-1, 0, 0)).fix_orientation(),
    "perturbed": perturbed((5, 4, 3), (3, 2, 1), 0.1),
    "perturbed rational": perturbed((4, 4, 4), (2, 2, 2), 0.1, rational=True),
    "left-handed": ms.duck().flipped(1),
    "seven coordinates": ms.torus().with_extra(r=0.1, g=lambda u: u[:, 1], b=1.0, d=0.05),
}
