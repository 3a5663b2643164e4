"""Frames against a textbook's, trusses and solids: which of them is right for which radius."""

import numpy as np
import pytest
from naive_frames import displacements

import ilattice as il
from ilattice.cost.frames import frame
from ilattice.errors import GeometryError, InputError

BASE = np.array([(0, 0, 0), (1, 0.05, 0), (0.45, 0.9, 0), (0.48, 0.32, 0.85)])


def tower():
    """A stiffened Kagome structure that stands on a face, and a force on its top."""
    k = il.cost.kagome(3, corners=BASE).stiffened()
    loads = np.zeros_like(k.positions)
    loads[np.argmax(k.positions[:, 2])] = 0.0, 0.0, -1.0
    return k, loads, k.positions[:, 2] < 1e-9


@pytest.mark.parametrize("dim", [2, 3])
def test_frames_are_those_of_the_textbook(dim):
    rng = np.random.default_rng(dim)
    k = il.cost.kagome(3, dim=dim).perturbed(0.2, seed=1).stiffened()
    n = len(k.positions)
    flat = ((0, 0), (0, 3 - dim))
    r, f = rng.uniform(0.003, 0.03, len(k.edges)), rng.standard_normal((n, dim))
    held = rng.choice(n, 4, replace=False)
    found = frame(k, f, supports=held, radius=r, young=3.0, poisson=0.2)
    u = displacements(np.pad(k.positions, flat), k.edges, r, np.pad(f, flat), held,
                      young=3.0, poisson=0.2)  # fmt: skip
    np.testing.assert_allclose(np.pad(found.motion, flat), u, atol=1e-10 * np.abs(u).max())
    assert found.compliance == pytest.approx((f * u[:, :dim]).sum())
    way = k.positions[k.edges[:, 1]] - k.positions[k.edges[:, 0]]
    stretch = ((u[k.edges[:, 1]] - u[k.edges[:, 0]])[:, :dim] * way).sum(axis=1) / k.lengths
    np.testing.assert_allclose(found.bars, 3.0 * np.pi * r**2 * stretch / k.lengths, atol=1e-9)
    truss = k.stress(f, supports=held, stiffness=3.0 * np.pi * r**2)
    assert 0.01 < found.bending < 1.0
    assert found.compliance < (1.0 - found.bending) * truss.compliance * (1.0 + 1e-9)


def test_a_cantilever_bends_as_it_must():
    x = [(0.0, 0, 0), (0.9, 0, 0), (2.0, 0, 0), (2.0, 1.0, 0)]
    k = il.cost.CornerSharing(x, np.zeros((0, 4), int), [(0, 1), (1, 2), (2, 3)])
    f = np.zeros((4, 3))
    f[3, 2] = 0.01
    r, E, nu = 0.1, 50.0, 0.25
    found = frame(k, f, supports=[0], radius=r, young=E, poisson=nu)
    inertia = np.pi * r**4 / 4
    bends = 0.01 * (2.0**3 + 1.0**3) / (3 * E * inertia)
    twists = 0.01 * 1.0 * 2.0 / (E / (2 * (1 + nu)) * 2 * inertia)
    assert found.motion[3, 2] == pytest.approx(bends + twists)
    assert found.bending == pytest.approx(1.0)
    assert found.turn[2, 0] == pytest.approx(twists)


def test_frames_tend_to_trusses_with_the_square_of_the_radius():
    """And how fast follows from the motion of the truss: what bending takes of its energy."""
    k, loads, held = tower()
    ratio, share = [], []
    parts = np.array([0.01, 0.005, 0.0025, 0.00125])  # radii over the mean length
    for part in parts:
        r = part * k.lengths.mean()
        truss = k.stress(loads, supports=held, stiffness=np.pi * r * r)
        found = frame(k, loads, supports=held, radius=r)
        ratio.append(found.compliance / truss.compliance)
        share.append(found.bending)
        assert ratio[-1] < 1.0 - share[-1]
    short = 1.0 - np.array(ratio)
    order = np.log2(short[:-1] / short[1:])
    assert (np.diff(order) > 0.0).all()
    assert order[-1] == pytest.approx(2.0, abs=0.03)
    np.testing.assert_allclose(share[-1], short[-1], rtol=0.02)


def test_odd_arguments_of_frames():
    k, loads, held = tower()
    for bad, told in (
        ({"radius": 0.0}, "radius must be one positive"),
        ({"radius": [0.1, 0.2]}, r"one per edge \(78,\)"),
        ({"poisson": 0.5}, "poisson"),
        ({"young": -1.0}, "young"),
        ({"loads": loads[1:]}, "loads must have shape"),
        ({"supports": [99]}, "supports"),
    ):
        with pytest.raises(InputError, match=told):
            frame(k, **({"loads": loads, "supports": held, "radius": 0.01} | bad))
    with pytest.raises(GeometryError, match="free to move"):
        frame(k, loads, supports=[], radius=0.01)
    two = il.cost.CornerSharing(
        np.concatenate([k.positions, k.positions + 5.0]),
        np.concatenate([k.simplices, k.simplices + len(k.positions)]),
    )
    with pytest.raises(GeometryError, match="free to move"):
        frame(two, np.concatenate([loads, loads]), supports=np.flatnonzero(held), radius=0.01)


@pytest.mark.parametrize("size", [1e-9, 1e12, 1e60])
def test_frames_do_not_know_units(size):
    k, f, low = tower()
    one = frame(k, f, supports=low, radius=0.01)
    other = frame(
        k.moved(size * k.positions), 1e-30 * f, supports=low, radius=0.01 * size, young=7.0
    )
    factor = 1e-30 / (7.0 * size)
    np.testing.assert_allclose(other.motion, factor * one.motion, rtol=1e-9, atol=1e-12 * factor)
    np.testing.assert_allclose(other.turn, factor / size * one.turn, rtol=1e-8)
    np.testing.assert_allclose(other.bars, 1e-30 * one.bars, rtol=1e-8)
    assert other.bending == pytest.approx(one.bending, rel=1e-10)
    assert other.residual < 1e-11


def test_numbers_beyond_squares_are_refused():
    k, f, low = tower()
    for change in ({"loads": 1e160 * f}, {"radius": 1e200}, {"young": 1e-320}, {"radius": 1e-30}):
        given = {"loads": f, "radius": 0.01, **change}
        with pytest.raises(InputError, match="must be from"):
            frame(k, given.pop("loads"), supports=low, **given)
