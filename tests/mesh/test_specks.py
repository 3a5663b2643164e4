"""Closed surfaces much smaller than a cell: left out of meshes, all others as they were."""

import warnings

import combinations as cb
import numpy as np
import pytest

import ilattice as il
from ilattice.mesh.repair import Repair
from ilattice.mesh.specks import SPECK, without_specks

OCTAHEDRON = np.concatenate([np.eye(3), -np.eye(3)])
SIDES = [[a, b, c] if np.linalg.det(OCTAHEDRON[[a, b, c]]) > 0 else [a, c, b]
         for a in (0, 3) for b in (1, 4) for c in (2, 5)]  # fmt: skip


def bodies(rng, part):
    """A ball and octahedra, turned at random, of `part` of the volume of a cell of 0.2."""
    ball = il.sdf.mesh(il.fields.sphere(1.0), 0.2)
    x, faces = [rng.random((5, 3)), ball.vertices], [ball.faces + 5]  # some vertices of no face
    for k, p in enumerate(part):
        turn, _ = np.linalg.qr(rng.standard_normal((3, 3)))
        stretch = np.exp(rng.uniform(-1, 1, 3))
        corners = OCTAHEDRON * stretch / stretch.prod() ** (1 / 3) @ turn
        size = (0.75 * p * 0.2**3) ** (1 / 3)
        n = sum(map(len, x))
        turned = np.linalg.det(turn) * rng.choice([-1, 1]) > 0
        faces.append(np.array(SIDES)[:, :: 1 if turned else -1] + n)
        x.append(corners * size + [3.0 + k, *rng.random(2)])
    return np.concatenate(x), np.concatenate(faces)


@pytest.mark.parametrize("seed", range(5))
def test_only_specks_are_left_out(seed):
    rng = np.random.default_rng(seed)
    part = SPECK * np.exp(rng.uniform(-3, 3, 30))
    x, faces = bodies(rng, part)
    order = rng.permutation(len(faces))
    left = np.arange(5, len(x))
    old = Repair(left, (faces - 5)[order].astype(np.int32), np.arange(len(faces)) * 2, 0, 0, 0)
    seen = []
    new = without_specks(x, old, lambda at: seen.append(at) or np.full(len(at), 0.2**3))
    mesh = il.SurfaceMesh(x[new.vertices], new.faces)
    assert mesh.components == 1 + (part > SPECK).sum()
    kept = np.repeat(part > SPECK, 8)
    expected = np.concatenate([faces[: -8 * len(part)], faces[-8 * len(part) :][kept]])
    found = new.vertices[new.faces]
    assert set(map(tuple, found)) == set(map(tuple, expected))
    assert len(found) == len(expected)
    np.testing.assert_array_equal(new.vertices, np.unique(found))
    np.testing.assert_array_equal(old.vertices[old.faces[new.rows // 2]], found)
    assert new.faces.dtype == np.int32
    assert (np.concatenate(seen) >= 5).all()


def test_a_mesh_of_specks_keeps_one_and_a_mesh_of_one_part_is_left_alone():
    x, faces = OCTAHEDRON, np.array(SIDES)
    one = Repair(np.arange(6), faces, np.arange(8), 0, 0, 0)
    assert without_specks(x, one, lambda at: np.full(len(at), 1e9)) is one
    two = Repair(np.arange(12), np.concatenate([faces, faces + 6]), np.arange(16), 0, 0, 0)
    new = without_specks(np.concatenate([x, x + 3.0]), two, lambda at: np.full(len(at), 1e9))
    assert len(new.faces) == 8


def test_pores_that_close_leave_no_chips():
    """Four of them used to be counted as islands: pores turned inside out."""
    combo = cb.combination(400046, most=4000)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        warnings.filterwarnings("ignore", ".* is far from .* of the surfaces")  # narrow pores
        mesh = combo.lattice().offset(combo.thickness()).mesh()
    assert cb.solid_parts(mesh) == 1
    assert mesh.is_watertight
    assert mesh.self_intersections == 0
