"""Fields as programs on blocks: the same mesh as that of the field asked point by point."""

import numpy as np
import pytest

import ilattice as il
from ilattice.errors import GeometryError
from ilattice.mesh._grid import Grid
from ilattice.mesh._samplers import ProgramSampler, sampler_for

F = il.fields
AXES = (np.linspace(-1.0, 1.0, 31), np.linspace(-1.1, 1.0, 37), np.linspace(-0.9, 1.2, 23))


def many(count, rng):
    parts = [F.sphere, F.box, F.torus, lambda: F.capsule((-0.6, 0, 0), (0.6, 0, 0), 0.4)]
    solids = []
    for k in range(count):
        part = F.rotate(F.scale(parts[k % 4](), rng.uniform(0.1, 0.2, 3)), k, (1, 2, k))
        solids.append(F.translate(part, rng.uniform(-0.8, 0.8, 3)))
    return F.union(*solids)


FIELDS = {
    "sphere": F.sphere(0.9),
    "many": many(60, np.random.default_rng(1)),
    "gyroid": F.intersection(F.shell(F.from_callable(il.tiles["gyroid"]), 0.4), F.sphere(0.95)),
    "equation": F.equation("max(x^2 + y*z - 0.3, sin(5*x)*cos(4*y) + z)"),
    "axis": F.equation("x - 0.1"),
    "plane": F.equation("y^2 + z^2 - 0.4"),
    "smooth": F.twist(F.union(F.box(0.5), F.torus(0.7, 0.2), radius=0.2), 1.0),
}


@pytest.mark.parametrize("level", [0.0, (-0.05, 0.1)])
@pytest.mark.parametrize("name", FIELDS)
def test_meshes_are_those_of_values_at_points(name, level):
    node = FIELDS[name]
    sampler = sampler_for(node, Grid.checked(AXES, False), (-np.inf, 0.0), None)
    assert isinstance(sampler, ProgramSampler)
    ours = il.mesh.contour(node, AXES, level=level, place="linear")
    plain = il.mesh.contour(lambda p: node(p), AXES, level=level, place="linear")
    np.testing.assert_array_equal(ours.vertices, plain.vertices)
    np.testing.assert_array_equal(ours.faces, plain.faces)


def test_wrapped_directions():
    axes = [np.linspace(0.0, 1.0, 25)] * 3
    node = F.intersection(F.from_callable(il.tiles["gyroid"]), F.equation("sin(tau*x) - 0.3"))
    mesh = il.mesh.contour(node, axes, wrap=True)
    assert mesh.is_watertight


def test_few_blocks_of_a_large_tree_are_looked_at():
    """The bounds of large boxes decide for all blocks in them, rigorously."""
    node = FIELDS["many"]
    grid = Grid.checked([np.linspace(-1, 1, 97)] * 3, False)
    sampler = sampler_for(node, grid, (-np.inf, 0.0), None)
    active = sampler.active(0, grid.blocks[0])
    assert 0.02 < active.mean() < 0.45
    inside = np.pad(node(np.stack([a.ravel() for a in np.meshgrid(*grid.axes, indexing="ij")], 1))
                    .reshape(97, 97, 97) < 0, 1)  # fmt: skip
    cells = np.zeros((98,) * 3, int)
    for i, j, k in np.ndindex(2, 2, 2):
        cells += inside[i : 98 + i, j : 98 + j, k : 98 + k]
    crossed = (cells > 0) & (cells < 8)
    for block in np.argwhere(~active):
        x, y, z = (slice(8 * b, 8 * b + 8) for b in block)
        assert not crossed[x, y, z].any()


def test_not_a_number_is_refused_with_its_place():
    with pytest.raises(GeometryError, match="NaN near"):
        il.mesh.contour(F.equation("x + sqrt(y)"), AXES)
