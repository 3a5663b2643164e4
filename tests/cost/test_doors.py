"""What is refused at the door, and told; and digits of files far from the origin."""

import re
import zipfile

import numpy as np
import pytest
import trimesh

import ilattice as il
from ilattice.cost import boxspline, counting, flips, mapping, refinement, rigidity, slicing
from ilattice.cost.drawing import drawn
from ilattice.errors import GeometryError, IlatticeError, InputError, PrecisionWarning

CORNERS = np.array([(0, 0, 0), (1, 0.1, 0), (0.3, 0.9, 0.1), (0.2, 0.3, 0.8)])


@pytest.mark.parametrize(("shift", "size"), [(1e6, 1.0), (1e4, 1e-3), (0.0, 1e-6), (3.0, 1e5)])
def test_radii_in_3mf_keep_their_digits(tmp_path, shift, size):
    k = il.cost.kagome(2, corners=size * CORNERS)
    k = k.moved(k.positions + shift)
    r = size * np.random.default_rng(0).uniform(0.003, 0.02, len(k.positions))
    far = 2.0**-24 * k.positions.max() / r.min() > 1e-3
    b = k.beams(r)
    if far:
        with pytest.warns(PrecisionWarning, match=r"single precision move their ends by .* %"):
            b.save(tmp_path / "f.3mf")
    else:
        b.save(tmp_path / "f.3mf")
    text = zipfile.ZipFile(tmp_path / "f.3mf").read("3D/3dmodel.model").decode()
    found = np.array(re.findall(r'r1="([^"]*)" r2="([^"]*)"', text), float)
    np.testing.assert_allclose(found, b.radii, rtol=1e-8)
    x = np.array(re.findall(r'x="([^"]*)" y="([^"]*)" z="([^"]*)"', text), float)
    assert np.abs(x - b.vertices).max() < max(1e-5 * r.min(), 1e-15 * abs(shift))


def test_flips_make_no_edge_where_a_bar_is():
    for dim in (2, 3):
        k = il.cost.kagome(4, dim=dim).perturbed(0.1, seed=3).stiffened()
        f = flips.randomised(k, 400, seed=1, kind="graph")
        f.check()
        assert len(np.unique(np.sort(f.edges, axis=1), axis=0)) == len(k.edges)
        assert (np.sort(f.simplices) != np.sort(k.simplices)).any()


def test_masks_are_masks():
    k = il.cost.kagome(3)
    every = refinement.substituted(k, np.ones(len(k.simplices), bool), 3)
    some = refinement.substituted(k, np.arange(len(k.simplices)), 3)
    assert len(every.simplices) == len(some.simplices)
    still = flips.randomised(k, 200, fixed=np.ones(len(k.positions), bool))
    assert (still.simplices == k.simplices).all()
    with pytest.raises(InputError, match="mask of shape"):
        flips.randomised(k, 5, fixed=np.ones(3, bool))


@pytest.mark.parametrize("dim", [2, 3])
def test_samples_are_the_field_up_to_the_border(dim):
    k = il.cost.kagome(3, dim=dim)
    steps = 3
    got = boxspline.samples(k, steps)
    wide = np.pad(boxspline.control(k), 6, constant_values=-1.0)
    for _ in range(steps):
        wide = boxspline.subdivided(wide)
    cut = tuple(slice(6 << steps, (6 << steps) + n) for n in got.shape)
    np.testing.assert_allclose(got, wide[cut], atol=1e-14)
    total = int(k.origin.integers[0].sum())
    corners = CORNERS[: dim + 1, :dim] @ np.eye(dim)
    field = boxspline.field(il.cost.kagome(3, dim=dim, corners=corners))
    at = np.stack(np.meshgrid(*[np.arange(n) for n in got.shape], indexing="ij"), -1)
    at = at.reshape(-1, dim) / (total * 2.0**steps)
    x = np.pad(corners[dim] + at @ (corners[:dim] - corners[dim]), ((0, 0), (0, 3 - dim)))
    np.testing.assert_allclose(got.ravel(), -field(x), atol=0.02)


def test_a_section_is_refused_where_beams_would_be_lost():
    blocks = il.cost.Blocks(3)
    with pytest.raises(GeometryError, match="would be lost"):
        slicing.section(blocks, 0.3, 0.02, h=0.1)
    with pytest.warns(PrecisionWarning, match="too coarse"):
        slicing.section(blocks, 0.3, 0.02, h=0.03)


def test_radii_are_refused_only_where_all_faces_of_a_simplex_are_closed():
    rng = np.random.default_rng(5)
    inner = rng.dirichlet(np.ones(3), 4000)
    refused = 0
    for _ in range(12):
        c = rng.normal(size=(4, 3))
        if np.linalg.det(c[1:] - c[0]) < 0.0:
            c[[0, 1]] = c[[1, 0]]
        k = il.cost.CornerSharing(c, [[0, 1, 2, 3]])
        for r in np.linspace(0.05, 0.45, 9) * k.lengths.min():
            closed = [
                (k.beams(r, check=False)(inner @ np.delete(c, j, axis=0)) < 0.0).mean()
                for j in range(4)
            ]
            try:
                k.beams(r)
                assert min(closed) < 1.0
            except GeometryError:
                refused += 1
                assert min(closed) > 0.98
    assert refused


def test_what_cannot_be_has_a_name():
    k = il.cost.kagome(3)
    with pytest.raises(GeometryError, match="both ends at one place"):
        il.cost.CornerSharing(np.zeros((4, 3)), [[0, 1, 2, 3]]).rank  # noqa: B018
    with pytest.raises(InputError, match="conductance must be one number"):
        counting.resistance(k, conductance=[1.0, 2.0])
    with pytest.raises(GeometryError, match="flat along axis 2"):
        il.cost.CornerSharing(CORNERS * (1, 1, 0), [[0, 1, 2, 3]]).fitted([[0] * 3, [1] * 3])
    with pytest.raises(InputError, match="cells"):
        il.cost.divided_box((10**5, 10**5, 10**5))
    with pytest.raises(InputError, match="must not be flat"):
        mapping.BernsteinSimplex(1, CORNERS, np.zeros((4, 3)))
    with pytest.raises(InputError, match="must not be flat"):
        il.cost.Blocks(4, corners=CORNERS * (1, 1, 0))
    with pytest.raises(GeometryError, match="close all faces"):
        k.pipes(0.3)
    with pytest.raises(InputError, match="zero everywhere"):
        rigidity.swung(k, np.zeros((len(k.positions), 3)), 0.1)
    flat = il.cost.kagome(3, dim=2)
    with pytest.raises(InputError, match="two vertices"):
        flips.flipped(flat, 8, (1,))
    with pytest.raises(InputError, match="one per gap"):
        il.cost.stacked(flat, np.zeros((3, len(flat.positions), 3)), [None])


def test_cells_that_are_twice_there_or_apart_are_not_joined():
    with pytest.raises(GeometryError):
        il.cost.fill(CORNERS, [[0, 1, 2, 3], [0, 1, 2, 3]], resolution=3).joined()
    x, t = il.cost.divided_box((1, 1, 1))
    k = il.cost.fill(x, t, resolution=3)
    k.joined().check()
    with pytest.raises(GeometryError, match="apart: join cells first"):
        k.perturbed(0.1, seed=1).joined()


def test_surfaces_of_beams_have_no_other_options(tmp_path):
    with pytest.raises(InputError, match="no option 'foo'"):
        il.cost.kagome(2).beams(0.05).save(tmp_path / "x.stl", foo=1)


def test_a_tolerance_does_not_lose_thin_beams():
    x = [[0, 0, 0], [3, 0.1, 0.2], [0, 2, 0], [3, 2.2, 0.1]]
    b = il.cost.Beams(x, [[0, 1], [2, 3]], [[0.03, 0.03], [0.3, 0.3]])
    m = b.mesh(tol=0.02)
    parts = sorted(part.volume for part in trimesh.Trimesh(m.vertices, m.faces).split())
    lengths = np.linalg.norm(np.diff(np.array(x)[[[0, 1], [2, 3]]], axis=1), axis=2).ravel()
    exact = [np.pi * r * r * (n + 4.0 / 3.0 * r) for r, n in zip((0.03, 0.3), lengths, strict=True)]
    assert len(parts) == 2
    assert (np.abs(np.array(parts) / exact - 1.0) < (0.2, 0.02)).all()


@pytest.mark.parametrize("resolution", [15, 20])
def test_bars_from_inside_where_those_between_outer_vertices_do_not_reach(resolution):
    k = il.cost.kagome(resolution, dim=2).stiffened()
    reach = np.linalg.norm(np.diff(k.positions[k.bars], axis=1)[:, 0], axis=1) / k.lengths.mean()
    assert reach.max() < 12.5
    assert np.linalg.matrix_rank(il.cost.rigidity.matrix(k).toarray()) == k.positions.size - 3
    assert k.deficit == 0


def test_structures_of_nothing_are_refused():
    with pytest.raises(InputError, match="one row or more"):
        il.cost.CornerSharing(np.zeros((0, 3)), np.zeros((0, 4)))
    points = il.cost.CornerSharing(np.random.default_rng(0).random((5, 3)), np.zeros((0, 4), int))
    for ask in (
        lambda: points.rank,
        points.perturbed,
        points.stiffened,
        lambda: points.pipes(0.1),
        lambda: points.beams(0.1),
        points.plot,
    ):
        with pytest.raises(IlatticeError, match=r"no edges|no beam"):
            ask()


@pytest.mark.parametrize("size", [1e200, 1e-200])
def test_loads_without_squares_are_refused(size):
    k = il.cost.kagome(3).stiffened()
    f = il.cost.stress.balanced(k, np.random.default_rng(0).normal(size=k.positions.shape))
    with pytest.raises(InputError, match="change units"):
        k.stress(size * f)
    assert np.allclose(k.stress(1e120 * f).bars, 1e120 * k.stress(f).bars, rtol=1e-9)


@pytest.mark.parametrize("dim", [2, 3])
def test_pictures_tell_tension_from_compression(dim):
    k = il.cost.kagome(3, dim=dim).stiffened()
    f = il.cost.stress.balanced(k, np.random.default_rng(1).normal(size=k.positions.shape))
    scene = drawn(k, values=k.stress(f).bars)
    values = np.concatenate([x.data.cell_data["force"] for x in scene.layers])
    assert len(np.unique(values)) == len(k.edges)
    limits = {tuple(x.style["clim"]) for x in scene.layers}
    assert limits == {(-np.abs(values).max(), np.abs(values).max())}
    picture = scene.image().astype(int)
    red = (picture[..., 0] > picture[..., 2] + 40).mean()
    blue = (picture[..., 2] > picture[..., 0] + 40).mean()
    assert red > 0.005
    assert blue > 0.005
    with pytest.raises(InputError, match="bogus"):
        k.plot(bogus=1)
    with pytest.raises(InputError, match="radius"):
        k.plot(radius=-1.0)
