"""Volumes whose faces collapse into edges or points: the map is singular there."""

import numpy as np
import pytest

import ilattice as il
from ilattice.errors import PrecisionWarning
from ilattice.offsets._small import solved


def collapsed(kind):
    """A block whose upper face is an edge, or a point."""
    c = np.stack(np.meshgrid(*[[0.0, 1.0]] * 3, indexing="ij"), axis=-1) * [1.03, 0.97, 1.21]
    c[:, :, 1, : 1 if kind == "wedge" else 2] = 0.47
    return il.SplineMap(il.BSpline([[0.0, 0.0, 1.0, 1.0]] * 3, c, 1))


@pytest.mark.parametrize(("kind", "d"), [("wedge", 0.053), ("pyramid", (np.inf, -0.041))])
def test_walls_reach_into_collapsed_faces(kind, d):
    with pytest.warns(PrecisionWarning, match="det J comes down to 0"):
        lattice = il.Lattice("gyroid", through=collapsed(kind))
    wall = lattice.offset(d)
    mesh = wall.mesh(0.06)
    assert mesh.is_watertight
    assert mesh.nonmanifold_edges == mesh.self_intersections == 0
    u = np.random.default_rng(4).random((60_000, 3))
    weight = np.abs(np.linalg.det(lattice.through.jacobian(u)))
    s = lattice.distance(u)
    inside = s < d[1] if isinstance(d, tuple) else np.abs(s) < d
    assert mesh.volume == pytest.approx((weight * inside).mean(), rel=0.03)
    assert wall.thickness_error(mesh).relative < 1e-3


def test_singular_systems_have_no_solution_and_others_theirs():
    rng = np.random.default_rng(2)
    a, b = rng.standard_normal((50, 3, 3)), rng.standard_normal((50, 3, 2))
    a[::7, 1] = 0.0
    x = solved(a, b)
    lost = np.arange(50) % 7 == 0
    assert np.isnan(x[lost]).all()
    np.testing.assert_allclose(a[~lost] @ x[~lost], b[~lost], atol=1e-9)
    assert solved(a, rng.standard_normal((50, 3, 1))).shape == (50, 3, 1)
