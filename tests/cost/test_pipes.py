"""Pipes of Bezier patches: closed, smooth along beams, exact in files; surfaces in slabs."""

import numpy as np
import pytest

import ilattice as il
from ilattice.cost import Beams, Pipes
from ilattice.errors import GeometryError, InputError


def structures():
    plain = il.cost.kagome(3)
    corners = np.array([(0, 0, 0), (2.0, 0.1, 0), (0.3, 1.8, 0.2), (0.2, 0.4, 1.7)])
    return {
        "regular": plain,
        "moved": plain.perturbed(0.1, seed=4),
        "small": il.cost.kagome(2, corners=1e-4 * corners),
        "one": il.cost.CornerSharing(np.vstack([np.zeros(3), np.eye(3)]), [[0, 1, 2, 3]]),
    }


@pytest.mark.parametrize("name", ["regular", "moved", "small", "one"])
def test_pipes_are_closed_and_as_thick_as_beams(name):
    k = structures()[name]
    r = 0.06 * k.lengths.min()
    p = k.pipes(r)
    assert len(p.quads) >= 8 * len(k.edges)
    mesh = p.mesh(6)
    assert mesh.is_watertight
    assert mesh.volume > 0.0  # oriented outwards
    assert mesh.genus == len(k.edges) - len(np.unique(k.edges)) + 1
    assert mesh.volume == pytest.approx(np.pi * r**2 * k.lengths.sum(), rel=0.2)
    assert mesh.self_intersections == 0


def test_pipes_have_the_radius_of_beams_in_their_middle():
    k = il.cost.kagome(4).perturbed(0.1, seed=1)
    r = np.random.default_rng(2).uniform(0.01, 0.02, len(k.positions))
    p = k.pipes(r)
    e = len(k.edges)
    middle = p.quads[: 4 * e].reshape(e, 4, 3, 3, 3)[:, :, 0]  # of halves that were turned round
    t = np.linspace(0.0, 1.0, 7)
    b = np.stack([(1 - t) ** 2, 2 * t * (1 - t), t**2], axis=1)
    x = np.einsum("tj,eqjx->eqtx", b, middle).reshape(e, -1, 3)
    ends = k.positions[k.edges]
    way = ends[:, 1] - ends[:, 0]
    way /= np.linalg.norm(way, axis=1)[:, None]
    from_axis = x - ends.mean(axis=1)[:, None]
    np.testing.assert_allclose(np.einsum("etx,ex->et", from_axis, way), 0.0, atol=1e-12)
    off = np.linalg.norm(from_axis, axis=2) / r[k.edges].mean(axis=1)[:, None]
    assert off.max() < 1.031
    assert off.min() > 0.969


def test_pipes_are_smooth_around_and_along_beams():
    k = il.cost.kagome(3).perturbed(0.1, seed=2)
    p = k.pipes(0.01)
    e = len(k.edges)
    halves = p.quads.reshape(-1, 4, 3, 3, 3)[: 2 * e]
    around = halves[:, :, :, 2] - halves[:, :, :, 1]
    after = np.roll(halves, -1, axis=1)
    np.testing.assert_allclose(after[:, :, :, 0], halves[:, :, :, 2], atol=1e-14)
    np.testing.assert_allclose(after[:, :, :, 1] - after[:, :, :, 0], around, atol=1e-14)
    first, last = halves[:e, :, ::-1], halves[e:]
    np.testing.assert_allclose(first[:, :, 2], last[:, :, 2], atol=1e-14)
    np.testing.assert_allclose(first[:, :, 2] - first[:, :, 1],
                               last[:, :, 1] - last[:, :, 2], atol=1e-14)  # fmt: skip


def test_files_hold_the_patches(tmp_path):
    pv = pytest.importorskip("pyvista")
    p = il.cost.kagome(2).pipes(0.04)
    p.save(tmp_path / "p.vtu")
    grid = pv.read(tmp_path / "p.vtu")
    assert grid.n_cells == len(p.quads) + len(p.triangles)
    surface = (
        grid.extract_surface(nonlinear_subdivision=3, algorithm="dataset_surface")
        .triangulate()
        .clean()
    )
    assert surface.volume == pytest.approx(p.mesh(8).volume, rel=1e-6)  # VTK's own evaluation
    p.save(tmp_path / "p.itd")
    text = (tmp_path / "p.itd").read_text()
    assert text.count("SURFACE BEZIER 3 3 E3") == len(p.quads)
    assert text.count("TRISRF BEZIER 3 E3") == len(p.triangles)
    assert text.count("[") == text.count("]")
    first = p.quads[0, 0, 0].tolist()
    assert " ".join(map(repr, first)) in text
    with pytest.raises(il.errors.FormatError, match="ending"):
        p.save(tmp_path / "p.stl")


def test_odd_arguments_of_pipes():
    k = il.cost.kagome(3)
    with pytest.raises(InputError, match="in space"):
        il.cost.kagome(3, dim=2).pipes(0.1)
    with pytest.raises(InputError, match="positive"):
        k.pipes(0.0)
    star = il.cost.CornerSharing(
        np.random.default_rng(0).random((8, 3)), np.empty((0, 4), int)
    ).with_bars([(0, i) for i in range(1, 8)])
    with pytest.raises(InputError, match="at most 6"):
        star.pipes(0.01)
    with pytest.raises(GeometryError, match="balanced"):
        k.refined().pipes(0.005)
    with pytest.raises(InputError, match="quads"):
        Pipes(np.zeros((1, 3, 3)), np.zeros((0, 6, 3)))
    with pytest.raises(GeometryError, match="do not meet"):
        Pipes(k.pipes(0.02).quads[1:], k.pipes(0.02).triangles).mesh()


@pytest.mark.parametrize("ending", [".stl", ".ply"])
def test_surfaces_in_slabs_are_those_at_once(tmp_path, ending):
    rng = np.random.default_rng(6)
    x = rng.uniform(-1, 1, (7, 3)) * (0.3, 2.0, 0.5)  # longest along y: axes are turned
    beams = Beams(x, [(i, i + 1) for i in range(6)], rng.uniform(0.1, 0.15, (6, 2)))
    path = tmp_path / f"beams{ending}"
    beams.save(path, h=0.04)
    mesh = il.SurfaceMesh.load(path)
    assert mesh.is_watertight
    whole = beams.mesh(0.04)
    assert mesh.volume == pytest.approx(whole.volume, rel=0.01)
    assert np.percentile(np.abs(beams(mesh.vertices)), 95) < 1e-4  # but along creases
    np.testing.assert_allclose(mesh.bounds, whole.bounds, atol=0.01)
    with pytest.raises(GeometryError, match="lost"):
        beams.save(path, h=0.3)
    with pytest.raises(InputError):
        beams.save(path, h=-1.0)
    assert il.SurfaceMesh.load(path).volume == mesh.volume  # the old file stays
