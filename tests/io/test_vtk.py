"""VTK files: exact Bezier volumes, cells and grids, read and evaluated by VTK itself."""

import numpy as np
import pytest
import pyvista as pv
from vtkmodules.vtkCommonCore import reference
from vtkmodules.vtkCommonDataModel import vtkHigherOrderHexahedron

from ilattice import io
from ilattice.bspline import BSpline
from ilattice.errors import FormatError, InputError
from ilattice.io.bezier_cells import bezier_nodes, vtk_order
from ilattice.macroshape import SplineMap

DEGREES = [(1, 1, 1), (2, 2, 2), (3, 2, 4), (4, 3, 2), (3, 1, 1), (1, 3, 2), (1, 1, 4), (5, 5, 5)]


def clamped(spans, k):
    return np.concatenate([np.zeros(k), np.linspace(0, 1, spans + 1), np.ones(k)])


def quarter_annulus(inner=1.0, outer=2.0):
    """Exact quarter of a tube: rational, degrees (2, 1, 1); the radius is a further coordinate."""
    arc = np.array([[1.0, 0.0], [1.0, 1.0], [0.0, 1.0]])
    c = np.zeros((3, 2, 2, 4))
    for j, radius in enumerate((inner, outer)):
        c[:, j, :, :2] = radius * arc[:, None]
        c[:, j, :, 3] = radius
    c[..., 1, 2] = 1.0
    weights = np.broadcast_to(np.array([1, np.sqrt(0.5), 1])[:, None, None], (3, 2, 2))
    return SplineMap(
        BSpline([clamped(1, 2), clamped(1, 1), clamped(1, 1)], c, (2, 1, 1), weights=weights),
        names=("radius",),
    )


def random_map(degrees, spans, *, rational, seed=0):
    rng = np.random.default_rng(seed)
    t = [clamped(s, k) for s, k in zip(spans, degrees, strict=True)]
    shape = [s + k for s, k in zip(spans, degrees, strict=True)]
    weights = rng.uniform(0.5, 2.0, shape) if rational else None
    c = rng.normal(size=(*shape, 5))
    return SplineMap(BSpline(t, c, degrees, weights=weights), names=("r", "hardness"))


def closed_ring(spans=5):
    """Periodic quadratic ring with a square section."""
    n = spans + 2
    angle = 2 * np.pi * np.arange(n) / spans
    c = np.zeros((n, 2, 2, 3))
    for j, radius in enumerate((2.0, 3.0)):
        c[:, j, :, 0] = (radius * np.cos(angle))[:, None]
        c[:, j, :, 1] = (radius * np.sin(angle))[:, None]
    c[..., 1, 2] = 1.0
    t = (np.arange(-2, n + 1) / spans, clamped(1, 1), clamped(1, 1))
    return SplineMap(BSpline(t, c, (2, 1, 1), periodic=(True, False, False)))


# --- numbering --------------------------------------------------------------------------------


@pytest.mark.parametrize("degrees", DEGREES)
def test_node_order_is_that_of_vtk(degrees):
    place = vtk_order(*degrees)
    order = np.array([*degrees, np.prod(np.add(degrees, 1))], np.int32)
    for i, j, k in np.ndindex(place.shape):
        assert place[i, j, k] == vtkHigherOrderHexahedron.PointIndexFromIJK(i, j, k, order)


def test_elements_share_the_nodes_of_their_faces():
    nodes = bezier_nodes(random_map((2, 3, 1), (3, 2, 4), rational=True).spline.to_bezier())
    assert nodes.cells.shape == (24, 3 * 4 * 2)
    assert len(nodes.values) == (3 * 2 + 1) * (2 * 3 + 1) * (4 * 1 + 1)
    assert len(nodes.weights) == len(nodes.values)
    np.testing.assert_array_equal(np.unique(nodes.cells), np.arange(len(nodes.values)))


def test_a_closed_direction_shares_its_seam():
    nodes = bezier_nodes(closed_ring(5).spline.to_bezier())
    assert len(nodes.values) == 5 * 2 * 2 * 2
    assert nodes.cells.max() == len(nodes.values) - 1


def test_elements_stay_apart_where_the_spline_jumps():
    t = (np.array([0, 0, 0.5, 0.5, 1, 1]), clamped(1, 1), clamped(1, 1))
    c = np.random.default_rng(0).normal(size=(4, 2, 2, 3))
    apart = bezier_nodes(BSpline(t, c, 1).to_bezier())
    assert len(apart.values) == 16
    c[2] = c[1]
    assert len(bezier_nodes(BSpline(t, c, 1).to_bezier()).values) == 12


def test_degree_zero_is_refused():
    spline = BSpline(
        [clamped(2, 0), clamped(1, 1), clamped(1, 1)], np.zeros((2, 2, 2, 3)), (0, 1, 1)
    )
    with pytest.raises(FormatError, match=r"degrees \(0, 1, 1\); elevate"):
        bezier_nodes(spline.to_bezier())


# --- Bezier volumes ---------------------------------------------------------------------------


def evaluate(grid, cell, r):
    """Points and data of VTK's own evaluation of a cell at parameters r in [0, 1]^3."""
    c = grid.GetCell(cell)
    x, weights = np.zeros(3), np.zeros(c.GetNumberOfPoints())
    c.EvaluateLocation(reference(0), r, x, weights)
    ids = [c.GetPointId(i) for i in range(c.GetNumberOfPoints())]
    data = {name: weights @ a[ids] for name, a in grid.point_data.items()}
    return x, data


@pytest.mark.parametrize("rational", [False, True])
@pytest.mark.parametrize("degrees", DEGREES[:-1])
def test_vtk_evaluates_the_map_exactly(tmp_path, degrees, rational):
    spans = (2, 1, 3)
    volume = random_map(degrees, spans, rational=rational)
    io.save(volume, tmp_path / "a.vtu")
    grid = pv.read(tmp_path / "a.vtu")
    assert grid.n_cells == 6
    assert set(grid.celltypes) == {79}
    assert (grid.GetPointData().GetRationalWeights() is not None) == rational
    degrees_read = grid.GetCellData().GetHigherOrderDegrees()
    assert degrees_read.GetTuple(5) == degrees
    rng = np.random.default_rng(1)
    for cell, index in enumerate(np.ndindex(spans)):
        r = rng.uniform(size=3)
        u = ((np.array(index) + r) / spans)[None]
        x, data = evaluate(grid, cell, r)
        np.testing.assert_allclose(x, volume.x(u)[0], rtol=1e-12, atol=1e-12)
        expected = volume.extra(u)[0]
        found = [data["r"], data["hardness"]]
        np.testing.assert_allclose(found, expected, rtol=1e-12, atol=1e-12)


def test_a_rational_tube_is_round_after_tessellation(tmp_path):
    io.save(quarter_annulus(), tmp_path / "a.vtu")
    surface = pv.read(tmp_path / "a.vtu").extract_surface(
        nonlinear_subdivision=4, algorithm="dataset_surface"
    )
    radius = np.hypot(*surface.points[:, :2].T)
    assert surface.n_points > 500
    assert radius.max() == pytest.approx(2.0, abs=1e-6)
    assert radius.min() == pytest.approx(1.0, abs=1e-6)
    np.testing.assert_allclose(surface.point_data["radius"], radius, atol=1e-6)


def test_the_surface_of_a_closed_ring_has_no_inner_faces(tmp_path):
    io.save(closed_ring(), tmp_path / "a.vtu")
    grid = pv.read(tmp_path / "a.vtu")
    faces = grid.extract_surface(nonlinear_subdivision=0, algorithm="dataset_surface")
    assert faces.n_open_edges == 0


def test_bezier_files_are_atomic_too(tmp_path):
    (tmp_path / "a.vtu").write_text("old")
    with pytest.raises(InputError, match="no directory"):
        io.save(quarter_annulus(), tmp_path / "none" / "a.vtu")
    io.save(quarter_annulus(), tmp_path / "a.vtu", compress=True)
    assert pv.read(tmp_path / "a.vtu").n_cells == 1
    assert len(list(tmp_path.iterdir())) == 1


# --- cells and grids --------------------------------------------------------------------------


def test_cells_keep_their_data(tmp_path):
    points = np.array([[i, j, k] for k in (0, 1) for j in (0, 1) for i in (0, 1, 3)], float)
    cells = np.array([[0, 1, 4, 3, 6, 7, 10, 9], [1, 2, 5, 4, 7, 8, 11, 10]])
    stress = np.random.default_rng(0).normal(size=(2, 3, 3))
    io.write_vtu(
        tmp_path / "a.vtu",
        points,
        cells,
        12,
        point_data={"displacement": 2 * points, "inside": points[:, 0] > 0.5},
        cell_data={"stress": stress},
    )
    grid = pv.read(tmp_path / "a.vtu")
    np.testing.assert_allclose(grid.compute_cell_sizes().cell_data["Volume"], [1.0, 2.0])
    np.testing.assert_array_equal(grid.point_data["displacement"], 2 * points)
    np.testing.assert_array_equal(grid.point_data["inside"], points[:, 0] > 0.5)
    np.testing.assert_array_equal(grid.cell_data["stress"], stress.reshape(2, 9))


@pytest.mark.parametrize(
    ("cells", "data", "message"),
    [
        ([[0, 1, 2, 4]], {}, "below 4"),
        ([[0.0, 1, 2, 3]], {}, "integers"),
        ([[0, 1, 2, 3]], {"a": np.zeros(3)}, r"point_data\['a'\]"),
    ],
)
def test_bad_cells_are_refused(tmp_path, cells, data, message):
    with pytest.raises(InputError, match=message):
        io.write_vtu(tmp_path / "a.vtu", np.eye(4, 3), cells, 10, point_data=data)


def test_a_series_is_read_in_order_and_moves_as_a_whole(tmp_path):
    (tmp_path / "a & b").mkdir()
    files = [tmp_path / "a & b" / f"{k}.vtu" for k in range(3)]
    for k, file in enumerate(files):
        data = {"step": float(k), "axis": [1.0, 2.0, 3.0]}
        io.write_vtu(file, np.eye(4, 3) + k, [[0, 1, 2, 3]], 10, field_data=data)
    io.write_pvd(tmp_path / "all.pvd", files, [0.0, 0.1, 1e6])
    moved = tmp_path.rename(tmp_path.with_name(tmp_path.name + "_moved"))
    reader = pv.get_reader(moved / "all.pvd")
    assert reader.time_values == [0.0, 0.1, 1e6]
    for k in range(3):
        reader.set_active_time_point(k)
        grid = reader.read()[0]
        np.testing.assert_array_equal(grid.points, np.eye(4, 3) + k)
        assert grid.field_data["step"] == [k]
        np.testing.assert_array_equal(grid.field_data["axis"], [1, 2, 3])


@pytest.mark.parametrize(
    ("name", "files", "times", "kind", "match"),
    [
        ("a.pvd", ["a.vtu"], [0.0, 1.0], InputError, "times"),
        ("a.pvd", [], [], InputError, "at least one"),
        ("a.pvd", ["a.vtu", "b.vtu"], [1.0, 0.0], InputError, "decrease"),
        ("a.pvd", ["../a.vtu"], [0.0], InputError, "not in the folder"),
        ("a.vtu", ["b.vtu"], [0.0], FormatError, "pvd"),
        ("none/a.pvd", ["none/a.vtu"], [0.0], InputError, "none"),
    ],
)
def test_bad_series_are_refused(tmp_path, name, files, times, kind, match):
    with pytest.raises(kind, match=match):
        io.write_pvd(tmp_path / name, [tmp_path / f for f in files], times)
    assert not list(tmp_path.iterdir())


AXES = (np.linspace(0, 1, 4), np.linspace(-1, 1, 3), np.linspace(2, 4, 6))


def fields(axes):
    u, v, w = np.meshgrid(*axes, indexing="ij")
    return {"f": u + 10 * v + 100 * w, "g": np.stack([u, v, w], axis=-1)}


def test_image_data_hold_the_field_at_the_right_places(tmp_path):
    io.save_grid(tmp_path / "a.vti", AXES, fields(AXES))
    grid = pv.read(tmp_path / "a.vti")
    assert grid.dimensions == (4, 3, 6)
    np.testing.assert_allclose(grid.points, grid.point_data["g"], atol=1e-12)
    np.testing.assert_allclose(grid.point_data["f"], grid.points @ [1, 10, 100], atol=1e-12)


def test_structured_grids_pass_through_the_map(tmp_path):
    volume = quarter_annulus()
    axes = (np.array([0, 0.2, 0.7, 1.0]), np.linspace(0, 1, 3), np.linspace(0, 1, 2))
    io.save_grid(tmp_path / "a.vts", axes, fields(axes), through=volume)
    grid = pv.read(tmp_path / "a.vts")
    np.testing.assert_allclose(grid.points, volume.x(grid.point_data["g"]), atol=1e-14)
    assert np.hypot(*grid.points[:, :2].T).max() == pytest.approx(2.0)


def test_bad_grids_are_refused(tmp_path):
    uneven = (np.array([0, 0.2, 1.0]), *AXES[1:])
    with pytest.raises(InputError, match=r"axes\[0\] must be equidistant"):
        io.save_grid(tmp_path / "a.vti", uneven, {})
    with pytest.raises(InputError, match="increasing"):
        io.save_grid(tmp_path / "a.vts", (AXES[0][::-1], *AXES[1:]), {})
    with pytest.raises(InputError, match="increasing"):
        io.save_grid(tmp_path / "a.vts", AXES[:2], {})
    with pytest.raises(InputError, match=r"point_data\['f'\].*\(4, 3, 6\)"):
        io.save_grid(tmp_path / "a.vti", AXES, {"f": np.zeros((6, 3, 4))})
    with pytest.raises(FormatError, match=r"not as '\.vti'"):
        io.save_grid(tmp_path / "a.vti", AXES, {}, through=quarter_annulus())
    with pytest.raises(FormatError, match=r"not as '\.vtk'"):
        io.save_grid(tmp_path / "a.vtk", AXES, {})
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("kind", [np.bool_, np.int8, np.uint16, np.int64, np.float16, np.float32])
def test_all_kinds_of_numbers_are_written(tmp_path, kind):
    values = np.arange(72).reshape(4, 3, 6).astype(kind)
    io.save_grid(tmp_path / "a.vti", AXES, {"f": values})
    found = pv.read(tmp_path / "a.vti").point_data["f"]
    np.testing.assert_array_equal(found, values.ravel(order="F").astype(float))
