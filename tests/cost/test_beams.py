"""Beams as fields, meshes, slices and files; structures that are never stored; the command."""

import subprocess
import sys
import xml.etree.ElementTree as ET
import zipfile

import numpy as np
import pytest

import ilattice as il
from ilattice.cost import Beams, counting, slicing
from ilattice.errors import GeometryError, InputError, PrecisionWarning


def naive(b, p):
    """The least over all beams, one by one."""
    out = np.full(len(p), np.inf)
    for (i, j), (ra, rb) in zip(b.pairs, b.radii, strict=True):
        x, d = b.vertices[i], b.vertices[j] - b.vertices[i]
        length = np.linalg.norm(d)
        s = (rb - ra) / length
        t = (p - x) @ d / length**2
        off = np.linalg.norm(p - x - t[:, None] * d, axis=1) / length
        t = np.clip(t + s * off / np.sqrt(1.0 - s * s), 0.0, 1.0)
        out = np.minimum(out, np.linalg.norm(p - x - t[:, None] * d, axis=1) - ra - t * (rb - ra))
    return out


@pytest.fixture(scope="module")
def solid():
    k = il.cost.kagome(4).stiffened()
    return k.beams(np.random.default_rng(0).uniform(0.01, 0.03, len(k.positions)))


def test_values_are_those_of_all_beams_one_by_one(solid):
    rng = np.random.default_rng(1)
    p = np.concatenate([rng.uniform(-0.5, 1.5, (3000, 3)), rng.uniform(-50, 50, (200, 3))])
    np.testing.assert_allclose(solid(p), naive(solid, p), atol=1e-12, rtol=1e-14)
    far = Beams(solid.vertices + 1e4, solid.pairs, solid.radii)
    np.testing.assert_allclose(far(p + 1e4), solid(p), atol=1e-10)


def test_derivatives_are_those_of_differences(solid):
    p = np.random.default_rng(2).uniform(-0.2, 1.2, (300, 3))
    f, g, h = solid.jet(p)
    np.testing.assert_allclose(np.linalg.norm(g, axis=1), 1.0, atol=1e-12)
    e = 1e-5
    G = np.stack([(solid(p + e * v) - solid(p - e * v)) / (2 * e) for v in np.eye(3)], 1)
    H = np.stack([(solid.jet(p + e * v, 1)[1] - solid.jet(p - e * v, 1)[1]) / (2 * e)
                  for v in np.eye(3)], 1)  # fmt: skip
    off = np.abs(g - G).max(axis=1)
    assert np.percentile(off, 97) < 1e-6
    off = np.abs(h - H).max(axis=(1, 2)) / (1.0 + np.abs(h).max(axis=(1, 2)))
    assert np.percentile(off, 90) < 1e-5
    axis = Beams([(0, 0, 0), (1, 0, 0)], [(0, 1)], [(0.1, 0.1)])
    f, g, _ = axis.jet([(0.4, 0.0, 0.0)])
    assert f[0] == pytest.approx(-0.1)
    assert np.linalg.norm(g) == pytest.approx(1.0)


def test_ranges_hold_all_values(solid):
    rng = np.random.default_rng(3)
    lo = rng.uniform(-0.3, 1.2, (60, 3))
    hi = lo + rng.uniform(0.0, 0.4, (60, 3))
    r = solid.range(lo, hi)
    for a, b, (low, high) in zip(lo, hi, r, strict=True):
        f = solid(rng.uniform(a, b, (100, 3)))
        assert low <= f.min()
        assert f.max() <= high


@pytest.mark.threads
def test_bits_do_not_depend_on_threads_or_company(solid):
    import numba

    p = np.random.default_rng(4).uniform(-0.2, 1.2, (5000, 3))
    whole = solid(p)
    assert np.array_equal(whole[::7], solid(p[::7]))
    before = numba.get_num_threads()
    try:
        numba.set_num_threads(1)
        assert np.array_equal(whole, solid(p))
    finally:
        numba.set_num_threads(before)


def cone_volume(length, ra, rb):
    s = (ra - rb) / length
    z, p, q = length + (rb - ra) * s, ra * np.sqrt(1 - s * s), rb * np.sqrt(1 - s * s)

    def cap(r, h):
        return np.pi * h * h * (3 * r - h) / 3

    return np.pi * z / 3 * (p * p + p * q + q * q) + cap(ra, ra + ra * s) + cap(rb, rb - rb * s)


def test_meshes_and_slices_of_one_beam_have_the_volume_of_a_round_cone():
    x = np.array([(0.1, 0.2, -0.3), (1.0, 0.9, 0.4)])
    b = Beams(x, [(0, 1)], [(0.3, 0.15)])
    exact = cone_volume(np.linalg.norm(x[1] - x[0]), 0.3, 0.15)
    mesh = b.mesh(0.03)
    assert mesh.is_watertight
    assert mesh.volume == pytest.approx(exact, rel=5e-3)
    stack = b.slices(thickness=0.01, h=0.05)
    assert stack.volume() == pytest.approx(exact, rel=2e-3)
    turned = b.slices(thickness=0.01, h=0.05, normal=(1.0, -0.4, 0.7))
    assert turned.volume() == pytest.approx(exact, rel=2e-3)
    section = stack[len(stack) // 2]
    p = section.to_space(np.concatenate(section.loops))
    assert np.abs(b(p)).max() < 1e-9


def test_slices_of_fields_are_nested_and_closed():
    ring = il.fields.torus(1.0, 0.4)
    stack = il.mesh.slice_field(ring, [-0.39, 0.0, 0.2], h=0.07)
    for s, area in zip(stack, (None, np.pi * (1.4**2 - 0.6**2), None), strict=True):
        ((_, holes),) = s.polygons
        assert len(holes) == 1
        if area:
            assert s.area == pytest.approx(area, rel=3e-3)
    cut = il.fields.difference(ring, il.fields.half_space((1.0, 0.0, 0.0), 0.2))
    assert len(il.mesh.slice_field(cut, [0.0], h=0.05)[0].polygons) == 1
    with pytest.raises(InputError, match="the solid has no end"):
        il.mesh.slice_field(il.fields.half_space(), [0.0], h=0.1)
    thin = il.fields.box((1.0, 0.004, 1.0))
    assert il.mesh.slice_field(thin, [0.1], h=0.05)[0].area == pytest.approx(0.016, rel=2e-3)


def test_analyses_do_not_smear_creases():
    x = np.array([(0.0, 0, 0), (1.0, 0, 0), (0.5, -0.5, 0.0), (0.5, 0.5, 0.0)])
    b = Beams(x, [(0, 1), (2, 3)], np.full((2, 2), 0.2))
    domain = np.array([(-0.3, -0.75, -0.25), (1.3, 0.75, 0.25)])
    grid = il.cutfem.cut(b, (8, 8, 3), domain=domain)
    volume = grid.volume(3).weights.sum()
    exact = 2 * cone_volume(1.0, 0.2, 0.2) - 16 / 3 * 0.2**3  # less that of Steinmetz
    assert grid.error < 1e-3
    assert volume == pytest.approx(exact, rel=max(3e-4, 3 * grid.error))


def test_beams_go_with_other_fields(solid):
    half = il.fields.intersection(solid, il.fields.half_space((0.0, 0.0, 1.0), 0.5))
    p = np.random.default_rng(5).uniform(0, 1, (500, 3))
    np.testing.assert_array_equal(half(p), np.maximum(solid(p), p[:, 2] - 0.5))
    assert half.bounds[1, 2] == 0.5


def test_radii_of_all_kinds():
    k = il.cost.kagome(3)
    by_vertex = k.beams(0.01 + 0.01 * k.positions[:, 2])
    by_place = k.beams(lambda x: 0.01 + 0.01 * x[:, 2])
    assert np.allclose(by_vertex.radii, by_place.radii)
    by_edge = k.beams(np.linspace(0.01, 0.02, len(k.edges)))
    assert np.array_equal(by_edge.radii[:, 0], by_edge.radii[:, 1])
    with pytest.warns(PrecisionWarning, match="in the middle of edges is off by up to"):
        k.beams(lambda x: 0.02 + 0.01 * np.sin(60 * x[:, 0]))
    with pytest.raises(GeometryError, match=r"beams close all faces of simplex 0 \[.*\]"):
        k.beams(0.07)
    radii = np.full(len(k.positions), 0.01)
    radii[5] = 0.3
    edge = int(np.flatnonzero((k.edges == 5).any(axis=1))[0])
    with pytest.raises(GeometryError, match=f"the ball at one end of edge {edge} "):
        k.beams(radii)
    with pytest.raises(InputError, match=r"radii\[0\] is \[0\.0, 0\.0\]"):
        k.beams(0.0)


# ------------------------------------------------------------------------------ files


def test_beam_lattices_come_back_from_3mf(tmp_path, solid):
    solid.save(tmp_path / "a.3mf", unit="inch")
    with zipfile.ZipFile(tmp_path / "a.3mf") as package:
        root = ET.fromstring(package.read("3D/3dmodel.model"))
    assert root.attrib["requiredextensions"] == "b"
    core = "{http://schemas.microsoft.com/3dmanufacturing/core/2015/02}"
    beam = "{http://schemas.microsoft.com/3dmanufacturing/beamlattice/2017/02}"
    x = np.array([[float(v.attrib[a]) for a in "xyz"] for v in root.iter(f"{core}vertex")])
    rows = list(root.iter(f"{beam}beam"))
    pairs = np.array([[int(v.attrib[a]) for a in ("v1", "v2")] for v in rows])
    radii = np.array([[float(v.attrib[a]) for a in ("r1", "r2")] for v in rows])
    assert np.array_equal(pairs, solid.pairs)
    np.testing.assert_allclose(x, solid.vertices, atol=1e-8)
    np.testing.assert_allclose(radii, solid.radii, atol=1e-8)


def test_lib3mf_reads_beam_lattices(tmp_path, solid):
    lib3mf = pytest.importorskip("lib3mf")
    solid.save(tmp_path / "a.3mf")
    model = lib3mf.get_wrapper().CreateModel()
    reader = model.QueryReader("3mf")
    reader.SetStrictModeActive(True)
    reader.ReadFromFile(str(tmp_path / "a.3mf"))
    objects = model.GetMeshObjects()
    assert objects.MoveNext()
    part = objects.GetCurrentMeshObject()
    assert part.BeamLattice().GetBeamCount() == len(solid.pairs)
    last = part.BeamLattice().GetBeam(len(solid.pairs) - 1)
    assert list(last.Radii) == pytest.approx(solid.radii[-1].tolist(), abs=1e-7)
    assert reader.GetWarningCount() == 0


@pytest.mark.parametrize("ending", ["vtp", "vtu"])
def test_lines_come_back_with_radii(tmp_path, solid, ending):
    import pyvista

    force = np.arange(len(solid.pairs), dtype=float)
    solid.save(tmp_path / f"a.{ending}", cell_data={"force": force})
    found = pyvista.read(tmp_path / f"a.{ending}")
    assert found.n_cells == len(solid.pairs)
    assert np.array_equal(found.points, solid.vertices[solid.pairs].reshape(-1, 3))
    assert np.array_equal(found.point_data["radius"], solid.radii.ravel())
    assert np.array_equal(found.cell_data["force"], force)


def test_slices_of_beams_are_written(tmp_path, solid):
    stack = solid.slices([0.28, 0.385], h=0.01)
    for ending in ("cli", "svg", "3mf"):
        stack.save(tmp_path / f"a.{ending}")
        assert (tmp_path / f"a.{ending}").stat().st_size > 500


# ------------------------------------------------------------------------------ blocks


def edge_set(ends):
    """Edges as sets of rounded points."""
    return {frozenset(map(tuple, np.round(e, 7).tolist())) for e in ends}


@pytest.mark.parametrize("through", [None, "duck"])
def test_blocks_give_all_edges_at_a_height_and_each_once(through):
    k = il.cost.kagome(11)
    blocks = il.cost.Blocks(11, size=4)
    volume = None if through is None else il.macroshape.duck()
    x = k.positions if volume is None else volume.x(k.positions)
    z = x[k.edges][:, :, 2]
    for height in (np.quantile(x[:, 2], 0.13), np.quantile(x[:, 2], 0.61)):
        hit = (z.min(axis=1) <= height + 0.01) & (z.max(axis=1) >= height - 0.01)
        found = list(slicing.crossings(blocks, height, through=volume, margin=0.01))
        assert sum(map(len, found)) == hit.sum()
        assert edge_set(np.concatenate(found)) == edge_set(x[k.edges[hit]])
        if volume is None:
            assert len(found) < len(list(blocks))


def test_sections_are_slices_of_the_whole():
    k = il.cost.kagome(5)
    part = slicing.section(il.cost.Blocks(5, size=2), 0.4, 0.02)
    whole = k.beams(0.02).slices([0.4])[0]
    assert part.area == pytest.approx(whole.area, rel=1e-3)
    assert len(part.polygons) == len(whole.polygons)


MEMORY = """
import resource, sys
from ilattice.cost import Blocks, slicing
n = sum(len(e) for e in slicing.crossings(Blocks(int(sys.argv[1])), 0.37))
print(n, resource.getrusage(resource.RUSAGE_SELF).ru_maxrss)
"""


@pytest.mark.slow
def test_memory_does_not_grow_with_the_structure():
    used = []
    for level in (53, 114):
        command = [sys.executable, "-c", MEMORY, str(level)]
        done = subprocess.run(command, capture_output=True, text=True, check=True)
        used.append(int(done.stdout.split()[1]))
    assert used[1] < 1.2 * used[0]


# ------------------------------------------------------------------------------ the program


def test_the_program_of_the_first_page(tmp_path):
    x, tets = il.cost.divided_box(1)
    x = 0.1 + 0.8 * x + np.random.default_rng(1).uniform(-0.05, 0.05, x.shape)
    k = il.cost.fill(x, tets, resolution=3).joined().stiffened()
    assert k.rigidity().minimal
    k = k.mapped(il.macroshape.duck())
    assert k.is_rigid()
    loads = il.cost.stress.balanced(k, np.random.default_rng(0).standard_normal(k.positions.shape))
    assert k.stress(loads).bars.shape == (len(k.edges),)
    beams = k.beams(lambda p: 0.025 + 0.005 * p[:, 2])
    h = 0.7 * beams.radii.min()
    assert beams.mesh(h).is_watertight
    with pytest.raises(GeometryError, match="too coarse for beams of radius"):
        beams.mesh(4.0 * h)
    beams.save(tmp_path / "duck.3mf")
    assert counting.necessary(k)


def test_a_hanging_beam_stretches_as_it_must():
    """Held at one end, which the face of the box cuts: the other end moves by rho g L² / 2E."""
    b = Beams([(0.0, 0, 0), (0.0, 0, 1.0)], [(0, 1)], [(0.1, 0.1)])
    np.testing.assert_allclose(b.analysis_box, [(-0.1, -0.1, 0.0), (0.1, 0.1, 1.0)])
    problem = il.cutfem.Elasticity(b, (3, 3, 6), young=10.0, poisson=0.0, density=2.0, degree=2)
    solution = problem.clamp("w=0").load(gravity=(0, 0, 3.0)).solve()
    assert solution.compliance == pytest.approx(np.pi * 0.01 * 36.0 / 30.0, rel=2e-3)


def test_the_command_makes_files_and_says_what_is_wrong(tmp_path, capfd):
    from ilattice.cli import main

    words = ["cost", "kagome", "--resolution", "3", "--through", "duck", "--stiffen"]
    files = [str(tmp_path / name) for name in ("a.3mf", "a.vtp")]
    report = str(tmp_path / "r.json")
    assert main([*words, "-o", *files, "--report", report]) == 0
    told = capfd.readouterr().out
    assert "78" in told
    assert all((tmp_path / name).stat().st_size > 500 for name in ("a.3mf", "a.vtp", "r.json"))
    assert main(["cost", "kagome", "--resolution", "1", "-o", files[0]]) == 2
    assert "resolution must be a whole number from 2" in capfd.readouterr().err
    assert main(["cost", "kagome", "--resolution", "3", "-o", str(tmp_path / "a.doc")]) == 1
    assert "has none of the endings" in capfd.readouterr().err


def test_mesh_files_need_meshio(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "meshio", None)
    with pytest.raises(il.errors.FormatError, match=r"pip install .ilattice\[files\]"):
        il.cost.load(tmp_path / "a.msh")


@pytest.mark.parametrize("ending", ["vtu", "msh"])
def test_mesh_files_are_read_as_they_were_written(tmp_path, ending):
    meshio = pytest.importorskip("meshio")
    x, tets = il.cost.divided_box((2, 1, 1))
    x = x @ np.array([[1.3, 0.2, 0.1], [-0.1, 0.7, 0.3], [0.2, 0.1, 0.9]])
    turned = tets.copy()
    turned[::3] = turned[::3][:, [1, 0, 2, 3]]
    unused = np.vstack([[[9.0, 9.0, 9.0]], x])
    meshio.write_points_cells(tmp_path / f"a.{ending}", unused, [("tetra", turned + 1)])
    points, cells = il.cost.load(tmp_path / f"a.{ending}")
    np.testing.assert_array_equal(points, x)
    np.testing.assert_array_equal(np.sort(cells, axis=1), np.sort(tets, axis=1))
    ours, theirs = (il.cost.fill(*m, resolution=3).joined() for m in ((points, cells), (x, tets)))
    assert ours.mass == pytest.approx(theirs.mass, rel=1e-12)
    assert len(ours.positions) == len(theirs.positions)


def test_beams_less_than_a_cell_apart_do_not_cross():
    """Six beams that meet at acute angles: vertices on both sides of slits move past each other."""
    first = [[1.52, 3.36, 0.41], [2.58, 3.18, 1.9], [0.66, 0.38, 1.15], [3.82, 3.13, 4.16],
             [4.51, 3.27, 5.88], [2.74, 0.1, 4.7]]  # fmt: skip
    last = [[-8.99, 6.63, 7.71], [-8.47, 6.53, 8.29], [-9.4, 5.41, 8.06], [-7.44, 6.47, 10.18],
            [-7.23, 6.55, 10.94], [-7.98, 5.23, 10.45]]  # fmt: skip
    ends = np.arange(12).reshape(2, 6).T
    b = il.cost.Beams(first + last, ends, np.full((6, 2), 1.1))
    with pytest.warns(PrecisionWarning):
        m = b.mesh(1.0)
    assert m.is_watertight
    assert m.self_intersections == 0
