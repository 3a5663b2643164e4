"""Results as meshes and files, read and evaluated by VTK itself."""

import numpy as np
import pytest
import pyvista as pv
from vtkmodules.vtkCommonCore import reference

import ilattice as il
from ilattice.cutfem import (
    Buckling,
    EigenReport,
    Elasticity,
    Heat,
    HeatHistory,
    HeatSolution,
    Modes,
    Solution,
)
from ilattice.errors import FormatError, InputError, PrecisionWarning
from ilattice.quadrature.cutting import cut

#: Numbers on coarse grids are what is tested here.
pytestmark = pytest.mark.filterwarnings("ignore:the cells are too coarse")

CUBE = [[-1.0] * 3, [1.0] * 3]
HOLLOW = (lambda u: (u**2).sum(axis=1) - 0.64, lambda u: 0.09 - (u**2).sum(axis=1))


def some(problem, seed=0):
    """A solution with any coefficients; nothing is solved."""
    c = np.random.default_rng(seed).normal(size=(len(problem.assembly.space), problem.m))
    return (Solution if problem.m == 3 else HeatSolution)(problem, c, None)


@pytest.fixture(scope="module")
def ball():
    return some(Elasticity(cut(HOLLOW, 5, domain=CUBE, degree=2)))


def stretched(problem, *, by=(0.3, 0.0, 0.0)):
    """A solution with the displacement x * by."""
    return Solution(problem, problem.assembly.coordinates * np.array(by), None)


def test_stresses_have_named_components(tmp_path, ball):
    """Uniaxial stretch along each axis and each shear: what ParaView names is what there is."""
    names = {"XX": (0, 0), "YY": (1, 1), "ZZ": (2, 2), "YZ": (1, 2), "XZ": (0, 2), "XY": (0, 1)}
    problem = ball.problem
    for name, (i, j) in names.items():
        A = np.zeros((3, 3))
        A[i, j] = 0.1
        solution = Solution(problem, problem.assembly.coordinates @ A.T, None)
        solution.save(tmp_path / "a.vtu", on="solid")
        read = pv.read(tmp_path / "a.vtu").GetPointData().GetAbstractArray("stress")
        shown = solution.to_pyvista("solid").GetPointData().GetAbstractArray("stress")
        for array in (read, shown):
            column = [array.GetComponentName(k) for k in range(6)].index(name)
            values = np.abs(pv.wrap(array)).mean(axis=0)
            assert values.argmax() == column


@pytest.mark.filterwarnings("ignore:the mesh with h=")  # coarse
def test_the_surface_of_a_wall_is_a_surface_file(tmp_path):
    wall = il.Lattice("primitive", through=il.macroshape.box((1.0, 1.2, 0.9))).offset(0.17)
    solution = stretched(Elasticity(wall, 9, degree=1, young=2.0))
    solution.save(tmp_path / "a.vtp", h=0.15, scale=2.0)
    mesh = pv.read(tmp_path / "a.vtp")
    u = np.column_stack([mesh[name] for name in "uvw"])
    np.testing.assert_allclose(mesh["displacement"], solution.evaluate(u), atol=1e-12)
    assert mesh.GetPointData().GetAbstractArray("stress").GetComponentName(3) == "YZ"
    with pytest.raises(FormatError, match="vtp"):
        solution.save(tmp_path / "b.vtp", on="solid")


# ------------------------------------------------------------------------------ shapes


@pytest.mark.parametrize(("p", "r"), [(1, 0), (2, 1), (2, 0), (3, 2)])
def test_cells_hold_the_splines_themselves(tmp_path, p, r):
    """Displacement and a curved map at random places in cells, as VTK evaluates them."""
    t = [0.0] * (min(p, 2) + 1) + [1.0] * (min(p, 2) + 1)
    c = np.stack(np.meshgrid(*[np.linspace(0, 1, min(p, 2) + 1)] * 3, indexing="ij"), -1)
    c = c + np.random.default_rng(2).uniform(-0.1, 0.1, c.shape)
    bent = il.macroshape.SplineMap(il.bspline.BSpline([t] * 3, c, min(p, 2)))
    field = cut(lambda u: ((u - 0.5) ** 2).sum(axis=1) - 0.2, (3, 4, 3), degree=2, through=bent,
                domain=[[0.0] * 3, [1.0] * 3])  # fmt: skip
    solution = some(Elasticity(field, degree=p, smoothness=r))
    solution.save(tmp_path / "a.vtu", on="cells")
    grid = pv.read(tmp_path / "a.vtu")
    space = solution.problem.assembly.space
    assert grid.n_cells == len(space.cells)
    assert set(grid.point_data) == {"displacement", "stress", "von_mises", "level_set"}
    rng = np.random.default_rng(1)
    for number in range(0, grid.n_cells, 5):
        local, cell = rng.random(3), grid.GetCell(number)
        place, weights = np.zeros(3), np.zeros(cell.GetNumberOfPoints())
        cell.EvaluateLocation(reference(0), local, place, weights)
        u = (space.boxes[number, :3] + local * space.boxes[number, 3:])[None]
        nodes = [cell.GetPointId(i) for i in range(len(weights))]
        np.testing.assert_allclose(place, bent.x(u)[0], atol=1e-12)
        np.testing.assert_allclose(weights @ np.array(grid["displacement"])[nodes],
                                   solution.evaluate(u)[0], atol=1e-10)  # fmt: skip
    assert grid["level_set"].min() < 0 < grid["level_set"].max()


def test_the_solid_is_closed_and_converges():
    exact, errors = 4 / 3 * np.pi * (0.8**3 - 0.3**3), []
    for n in (4, 8, 16):
        problem = Elasticity(cut(HOLLOW, n, domain=CUBE, degree=2), degree=1)
        grid = stretched(problem).to_pyvista("solid", h=1 / n)
        errors.append(exact - grid.volume)
        assert grid.compute_cell_sizes()["Volume"].min() > 0
        skin = grid.extract_surface(algorithm="dataset_surface")
        assert skin.n_open_edges == 0
        assert skin.is_manifold
        sets = problem.domain.cut.sets(np.array(skin.points))
        np.testing.assert_allclose(sets.max(axis=1), 0, atol=1e-12)
    assert -np.polyfit(np.log([4, 8, 16]), np.log(errors), 1)[0] == pytest.approx(2, abs=0.2)
    assert errors[-1] < 2e-3 * exact


def test_fields_are_those_of_the_splines_on_a_stretched_solid(ball):
    for scale in (0.0, 0.01):
        grid = ball.to_pyvista("solid", scale=scale)
        u = np.array(grid.points) - scale * np.array(grid["displacement"])
        np.testing.assert_allclose(grid["displacement"], ball.evaluate(u), atol=1e-9)
        np.testing.assert_allclose(grid["von_mises"], ball.von_mises(u), rtol=1e-6)
    fine, coarse = (ball.to_pyvista("solid", h=h).n_points for h in (0.1, 0.2))
    assert fine > 2 * coarse


def test_pictures_move_by_a_tenth_of_the_size(ball):
    solution = stretched(ball.problem)
    rest, grid = (solution.to_pyvista("cells", scale=s) for s in (0.0, "auto"))
    far = np.linalg.norm(np.array(grid.points) - np.array(rest.points), axis=1).max()
    assert far == pytest.approx(0.1 * np.ptp(np.array(rest.points), axis=0).max())
    still = Solution(ball.problem, 0 * solution.coefficients, None)
    np.testing.assert_array_equal(still.to_pyvista("cells", scale="auto").points, rest.points)


def test_parts_that_were_left_out_are_not_shown():
    two = lambda u: 0.35 - np.abs(u[:, 2])  # noqa: E731
    problem = Elasticity(cut(two, 8, domain=CUBE), degree=1).clamp("w=0")
    with pytest.warns(PrecisionWarning, match="left out"):
        grid = stretched(problem).to_pyvista("solid")
    assert grid.volume == pytest.approx(2 * 2 * 0.65, rel=1e-9)
    assert grid.bounds[4:] == pytest.approx((-1.0, -0.35))


def test_a_wall_is_shown_by_its_surface_or_as_a_solid(tmp_path):
    lattice = il.Lattice("schwarz_p", through=il.macroshape.box((2.0, 1.0, 1.0)), spans_per_tile=6)
    solution = some(Heat(lattice.offset(0.15), 6))
    surface = solution.surface(0.15)
    assert {"temperature", "heat_flux", "thickness"} <= set(surface.point_data)
    assert solution.to_pyvista(h=0.15).n_cells == len(surface.faces)
    solid = solution.to_pyvista("solid", h=0.05)
    assert solid.volume == pytest.approx(solution.problem.domain.volume.in_space().integrate(),
                                         rel=2e-2)  # fmt: skip
    solution.plot(on="solid", off_screen=True, screenshot=tmp_path / "a.png", window_size=(99, 99))
    assert (tmp_path / "a.png").stat().st_size > 0


# ------------------------------------------------------------------------------ series


def test_modes_are_a_sequence_and_one_file(tmp_path, ball):
    problem = ball.problem
    vectors = np.stack([some(problem, seed).coefficients for seed in range(3)])
    report = EigenReport("superlu", 0.0, 0.0, 0.0)
    modes = Modes(problem, 2 * np.pi * np.array([1.0, 1.0, 2.5]), vectors, report)
    assert len(modes) == 3
    assert [m.number for m in modes] == pytest.approx([1.0, 1.0, 2.5])
    assert modes[-1].number == pytest.approx(2.5)
    assert len(modes[1:]) == 2
    told = []
    modes.save(tmp_path / "modes.pvd", on="cells", progress=lambda *a: told.append(a))
    assert told == [("save", k, 3) for k in (1, 2, 3)]
    reader = pv.get_reader(tmp_path / "modes.pvd")
    assert reader.time_values == [0.0, 1.0, 2.0]  # not frequencies: equal ones would be one frame
    for k, mode in enumerate(modes):
        reader.set_active_time_point(k)
        grid = reader.read()[0]
        assert grid.field_data["frequency"] == pytest.approx(mode.number)
        np.testing.assert_allclose(grid["displacement"], mode.evaluate(np.array(grid.points)))
    assert repr(modes[2]) == "Mode(frequency 2.5)"
    found = Buckling(problem, np.array([4.0, 5.0, 6.0]), vectors, report)
    assert found[1].to_pyvista("cells").field_data["factor"] == pytest.approx(5.0)


def test_temperatures_in_time_are_one_file(tmp_path):
    start = some(Heat(cut(HOLLOW, 4, domain=CUBE)))
    later = [HeatSolution(start.problem, k * start.coefficients, None, time=0.25 * k)
             for k in range(3)]  # fmt: skip
    history = HeatHistory(tuple(later))
    history.save(tmp_path / "cooling.pvd")
    reader = pv.get_reader(tmp_path / "cooling.pvd")
    assert reader.time_values == [0.0, 0.25, 0.5]
    reader.set_active_time_value(0.5)
    grid = reader.read()[0]
    assert grid.field_data["time"] == pytest.approx(0.5)
    u = np.array(grid.points)
    np.testing.assert_allclose(grid["temperature"], 2 * start.evaluate(u), atol=1e-9)
    assert sorted(f.name for f in (tmp_path / "cooling").iterdir()) == [
        f"cooling_{k:04d}.vtu" for k in range(3)
    ]


# ------------------------------------------------------------------------------ strength


def test_utilization_and_safety():
    """Stretched along x with no contraction: von Mises stress 2 μ · 0.3 for Poisson's ratio 0."""
    field = cut(HOLLOW, 4, domain=CUBE)
    problem = Elasticity(field, young=2.0, poisson=0.0, strength=lambda x: 3.0 + x[:, 2])
    solution = stretched(problem)
    u = np.array([[0.5, 0.0, 0.1], [0.0, 0.4, -0.4]])
    np.testing.assert_allclose(solution.utilization(u), 0.6 / (3 + u[:, 2]))
    assert solution.safety_factor == pytest.approx((3 - 0.8) / 0.6, rel=0.02)
    assert (solution.to_pyvista("solid")["utilization"] > 0.599 / 3.8).all()
    bare = stretched(Elasticity(field))
    assert "utilization" not in bare.point_data(u)
    for call in (lambda: bare.utilization(u), lambda: bare.safety_factor):
        with pytest.raises(InputError, match="strength"):
            call()
    with pytest.raises(InputError, match="strength must be above 0"):
        Elasticity(field, strength=0.0)


# ------------------------------------------------------------------------------ bad input


def test_bad_output_is_refused(tmp_path, ball):
    modes = Modes(ball.problem, np.ones(1), ball.coefficients[None], EigenReport("", 0.0, 0.0, 0.0))
    for call, kind, match in (
        (lambda: ball.to_pyvista("walls"), InputError, "on must be"),
        (lambda: ball.to_pyvista("surface"), InputError, "only walls"),
        (lambda: ball.to_pyvista("solid", h=0.0), InputError, "h must"),
        (lambda: ball.to_pyvista("solid", h=1e-4), InputError, "larger h"),
        (lambda: ball.to_pyvista("cells", scale="much"), InputError, "scale"),
        (lambda: ball.save(tmp_path / "a.vtk"), FormatError, "vtu"),
        (lambda: modes.save(tmp_path / "a.vtu"), FormatError, "pvd"),
        (lambda: modes.save(tmp_path / "none" / "a.pvd"), FormatError, "cannot be made"),
    ):
        with pytest.raises(kind, match=match):
            call()
    assert not list(tmp_path.iterdir())


@pytest.mark.filterwarnings("ignore:the cells are too coarse")
@pytest.mark.parametrize("degree", [1, 2])
def test_beams_as_thick_as_cells_are_drawn_without_pits(degree):
    rng = np.random.default_rng(5)
    x = np.array([[0, 0, 0], [1, 0.1, 0.05], [0.4, 0.9, 0.1], [0.45, 0.3, 0.8]])
    x[1:] += rng.uniform(-0.05, 0.05, (3, 3))
    beams = il.cost.Beams(
        x, [[0, 1], [0, 2], [1, 2], [0, 3], [1, 3], [2, 3]], np.full((6, 2), 0.06)
    )
    problem = Elasticity(beams, (8, 7, 9), degree=degree)
    drawn = problem.clamp("w=0").load(gravity=(0, 0, -1)).solve().to_pyvista(scale=0.0)
    assert drawn.volume == pytest.approx(problem.domain.volume.integrate(), rel=0.01)
