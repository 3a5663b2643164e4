"""Cut cells and voxels of the same geometry: after extrapolation they agree."""

import numpy as np
import pytest

import ilattice as il
from ilattice.homogenize import elastic, voxels

CORNERS = [(x, y, z) for x in (0, 1) for y in (0, 1) for z in (0, 1)]
#: Where the middles of the eighths of a voxel are, in quarters of its edges.
PARTS = 2 * np.array(list(np.ndindex(2, 2, 2))) - 1


def sheet(u):
    """A Schwarz-P sheet, and about the distance from it."""
    f, slope = np.cos(2 * np.pi * u).sum(axis=1), np.sin(2 * np.pi * u)
    steep = 2 * np.pi * np.sqrt((slope**2).sum(axis=1))
    return np.abs(f) - 0.5, (np.abs(f) - 0.5) / np.maximum(steep, 2.0)


def filled(distance, n):
    """Parts of n³ voxels that a solid fills, from distances in the middles of their eighths."""
    x = (np.arange(n) + 0.5) / n
    u = np.stack(np.meshgrid(x, x, x, indexing="ij"), -1).reshape(-1, 3)
    eighths = [np.clip(0.5 - 2 * n * distance(u + 0.25 / n * s), 0.0, 1.0) for s in PARTS]
    return np.rint(256 * np.mean(eighths, axis=0)).reshape(n, n, n) / 256  # few phases


def struts():
    """Body-centred struts that are joined smoothly."""
    nodes = [(0.5, 0.5, 0.5), *CORNERS]
    return il.tiles.struts(nodes, [(0, i) for i in range(1, 9)], 0.16, blend=0.24)


@pytest.mark.parametrize(
    ("solid", "distance"),
    [(lambda u: sheet(u)[0], lambda u: sheet(u)[1]), (struts(), struts())],
    ids=["sheet", "struts"],
)
def test_both_routes_have_one_limit(solid, distance):
    """Within 1 %; each has its own density, which tends to that of the other."""
    cut = [elastic(solid, n, estimate=False, tol=1e-6) for n in (8, 12)]
    of = [voxels(filled(distance, n), young=(1e-6, 1.0), estimate=False) for n in (18, 36)]
    assert of[1].density == pytest.approx(cut[1].density, rel=1e-3)
    assert of[1].density != cut[1].density
    a = cut[1].C - (cut[0].C - cut[1].C) / (1.5**3 - 1.0)
    b = of[1].C - (of[0].C - of[1].C) / (2.0**2 - 1.0)
    there = np.abs(a) > 1e-3 * a[0, 0]
    assert there.sum() == 12
    np.testing.assert_allclose(b[there], a[there], rtol=0.01)
    np.testing.assert_allclose(b, a, atol=0.005 * a[0, 0])
