"""Fields split at their kinks: the formula has the sign of the field in every box."""

import numpy as np
import pytest

import ilattice as il
from ilattice import fields
from ilattice.fields._formula import Splitter
from ilattice.fields._logic import MAX_ACTIVE

GYROID = fields.from_callable(il.tiles["gyroid"])
TREES = {
    "slab": fields.equation("abs(z - 0.1) - 0.05"),
    "ball": fields.sphere(0.3),
    "rounded box": fields.dilate(fields.box(0.5), 0.2),
    "box": fields.box(0.5),
    "two spheres": fields.shell(fields.sphere(0.5), 0.1),
    "sheet in a box": fields.intersection(fields.box(1.0), fields.shell(GYROID, 0.6)),
    "capsule": fields.capsule((-0.5, -0.3, 0), (0.5, 0.4, 0.3), 0.2),
    "cone": fields.cone(0.7, 1.0),
    "rounded cone": fields.dilate(fields.cone(0.5, 1.0), 0.1),
    "balls": fields.repeat(fields.sphere(0.3), 0.7),
    "twisted": fields.twist(fields.box((0.3, 0.4, 0.9)), 1.0),
    "mixed": fields.mix(fields.box(0.5), fields.sphere(0.6), fields.equation("x + 0.3")),
    "onion": fields.shell(fields.shell(fields.sphere(0.6), 0.3), 0.1),
    "blend": fields.union(
        fields.sphere(0.4), fields.translate(fields.box(0.3), (0.4, 0.3, 0.2)), radius=0.2
    ),
    "normalised": fields.normalize(fields.shell(GYROID, 0.6)),
    "products": fields.equation("max(abs(x), abs(y)) * abs(z) - 0.1"),
    "steps": fields.equation("floor(3*x) + sign(y)*0.5 + mod(z, 0.3) - 0.2"),
    "ceiling": fields.equation("ceil(2*x)*0.3 - exp(abs(y)) + 1.2 + min(z, 0.1)^2"),
    "drilled": fields.difference(
        fields.rotate(fields.box(0.7), 0.4, (1, 2, 3)), fields.cylinder(0.3)
    ),
    "eroded": fields.erode(
        fields.union(fields.box(0.6), fields.translate(fields.cone(), (0.2, 0.1, 0.3))), 0.05
    ),
    "nothing": fields.equation("max(x, 0) * 0 - min(abs(y), 0)"),
    "outside": fields.complement(
        fields.intersection(fields.box(0.5), fields.equation("max(x, 0)"))
    ),
}


def holds(e, leaves):
    """An expression at points, for signs of its fields there."""
    if isinstance(e, bool):
        return e
    if e[0] == "leaf":
        return leaves[e[1]]
    if e[0] == "not":
        return ~np.asarray(holds(e[1], leaves), bool)
    return holds(e[1], leaves) & holds(e[2], leaves)


def in_table(leaves, table, negative):
    place = sum(negative[leaf].astype(int) << k for k, leaf in enumerate(leaves))
    return np.array([table >> int(p) & 1 for p in np.broadcast_to(place, 100)], bool)


@pytest.mark.parametrize("name", TREES)
def test_a_formula_has_the_sign_of_the_field(name):
    field, rng = TREES[name], np.random.default_rng([4, *name.encode()])
    splitter = Splitter([field])
    found = 0
    for size in (2.0, 0.5, 0.1):
        lo = rng.uniform(-1, 1 - size, (40, 3)) if size < 2 else np.full((1, 3), -1.0)
        bounds, states = splitter.decided(lo, lo + size)
        for corner, bound, state in zip(lo, bounds, states, strict=True):
            formula = splitter.formula(state)
            u = rng.uniform(corner, corner + size, (100, 3))
            value = field(u)
            assert (value >= bound[0]).all()
            assert (value <= bound[1]).all()
            if formula is None:  # to be halved
                continue
            negative = {k: splitter.leaves[k].values(u) < 0 for k in formula.leaves}
            sure = np.abs(value) > 1e-12
            inside = np.broadcast_to(holds(formula.expression, negative), 100)
            np.testing.assert_array_equal(inside[sure], (value < 0)[sure])
            constant = [
                1 - 2 * int(negative[k].all()) if negative[k].all() or not negative[k].any() else 0
                for k in formula.leaves
            ]
            left = formula.restricted(constant)
            if left is not None:
                assert len(left[0]) <= MAX_ACTIVE
                np.testing.assert_array_equal(in_table(*left, negative)[sure], (value < 0)[sure])
            found += 1
    assert found > 40


def test_distances_become_polynomials():
    """Spheres, cylinders and boxes, with offsets and shells, have no root left to interpolate."""
    for field, count in (
        (fields.sphere(0.3), 1),
        (fields.shell(fields.cylinder(0.5), 0.1), 2),
        (fields.dilate(fields.sphere(0.3), 0.1), 1),
        (fields.box(0.4), 6),
        (fields.normalize(fields.equation("x*y - 0.1")), 1),
    ):
        splitter = Splitter([field])
        _, states = splitter.decided(np.full((1, 3), -1.0), np.full((1, 3), 1.0))
        formula = splitter.formula(states[0])
        assert len(formula.leaves) == count
        u = np.random.default_rng(0).uniform(-1, 1, (50, 3))
        x = np.column_stack([np.ones(50), u, u**2, u[:, 0] * u[:, 1]])
        for k in formula.leaves:
            f = splitter.leaves[k].values(u)
            off = x @ np.linalg.lstsq(x, f, rcond=None)[0] - f
            assert np.abs(off).max() < 1e-12


def test_levels_where_a_field_is_constant_count_as_fields_do():
    """max(f, 0) is never below 0, but its complement is where f is positive."""
    u = np.random.default_rng(1).uniform(-1, 1, (100, 3))
    for field in (
        fields.equation("-max(x, 0)"),
        fields.equation("abs(x) + x"),
        fields.equation("-(abs(x) + x)"),
    ):
        splitter = Splitter([field])
        _, states = splitter.decided(np.full((1, 3), -1.0), np.full((1, 3), 1.0))
        formula = splitter.formula(states[0])
        negative = {k: splitter.leaves[k].values(u) < 0 for k in formula.leaves}
        inside = np.broadcast_to(holds(formula.expression, negative), 100)
        np.testing.assert_array_equal(inside, field(u) < 0)


def test_fields_of_a_pair_have_owners():
    splitter = Splitter([fields.sphere(0.5), fields.shell(fields.half_space(), 0.1)])
    _, states = splitter.decided(np.full((1, 3), -1.0), np.full((1, 3), 1.0))
    assert len(splitter.formula(states[0]).leaves) == 3
    assert splitter.owners == [0, 1, 1]
