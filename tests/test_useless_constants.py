"""Constants that decide what is right: a small case of each fails with a useless value.

Every row is a module, a constant, a value of no use, a case that holds with the right one, and how
it fails with the other. Both are tried. Constants of compiled code, which are part of it, are in
`offsets/test_kernel_constants.py` and `cutfem/test_kernel_constants.py`.
"""

import importlib
import re
import warnings
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.optimize import brentq

import ilattice as il
from ilattice.bspline import BSpline
from ilattice.cutfem import Elasticity, Heat
from ilattice.errors import GeometryError, InputError, PrecisionWarning
from ilattice.linalg._krylov import conjugate_gradients
from ilattice.mesh import SurfaceMesh, _own_cells
from ilattice.mesh.contouring import contour_arrays
from ilattice.mesh.creases import sharpened
from ilattice.mesh.repair import Repair
from ilattice.mesh.specks import without_specks
from ilattice.offsets.polish import polish

BAR = [[0, 0, 0], [1, 1, 3]]
CUBE = [[-1.1] * 3, [1.1] * 3]


def full(u):
    return -np.ones(len(u))


def ball(u):
    return (u**2).sum(axis=1) - 1.0


def refused(kind, match, do, *args, **options):
    """That a call ends in an error, or in a warning where these are errors, that says why."""
    said = ""
    try:
        do(*args, **options)
    except kind as error:
        said = str(error)
    assert re.search(match, said), f"not said: {match}"


# ---------------------------------------------------------------- analysis


def what_can_move_along_an_oblique_axis_is_not_held():
    def rod(u):
        return (u**2).sum(axis=1) - u.sum(axis=1) ** 2 / 3.0 - 0.36

    problem = Elasticity(rod, 4, domain=CUBE).clamp("surface", components="n")
    assert dict(problem.free_modes) == {0: (2, 6)}  # along the axis and about it
    refused(InputError, "2 of 6 rigid-body modes", problem.check_held)


def bodies_that_only_move_store_nothing():
    problem = Elasticity(ball, 4, domain=CUBE, degree=1).clamp("surface", value=(1.0, 2.0, 3.0))
    problem.solve()  # errors of nothing are no errors


def weak_supports_hold():
    exact = lambda x: x @ [1.0, 2.0, 3.0]  # noqa: E731
    solution = Heat(ball, 4, domain=CUBE).fix("surface", exact).solve(method="superlu")
    u = [[0.3, 0.2, -0.4], [-0.9, 0.1, 0.0]]
    np.testing.assert_allclose(solution.evaluate(u), exact(np.array(u)), atol=1e-4)


def supports_that_overlap_hold_once():
    exact = lambda x: x[:, :1] * [1.0, 0.0, 0.0]  # noqa: E731
    problem = Elasticity(full, 3, domain=BAR, poisson=0.0)
    problem = problem.clamp("u=0", value=exact, method="nitsche")
    problem = problem.clamp("boundary", value=exact)
    found = problem.solve().evaluate([[0.5, 0.5, 1.0], [0.9, 0.1, 2.0]])
    np.testing.assert_allclose(found, [[0.5, 0, 0], [0.9, 0, 0]], atol=1e-7)


def supports_that_contradict_are_refused():
    problem = Heat(full, 2, domain=BAR).fix("u=0", 0.0).fix("w=0", 1.0)
    refused(InputError, "contradict", problem.solve)


def rough_regions_are_told():
    problem = Heat(ball, 3, domain=CUBE)
    refused(PrecisionWarning, "its area is off", problem.fix, lambda x: x[:, 0] > 0.45, 0.0)


def planes_with_a_rim_are_told():
    """A region that has the flat end of a cap, and a bit of the ball beside it."""

    normal = np.array([0.6, 0.0, 0.8])
    flat = il.fields.half_space(normal, 0.3)
    problem = Elasticity(il.fields.intersection(il.fields.sphere(1.0), flat), 4, domain=CUBE)
    wide = lambda x: x @ [0.6, 0.0, 0.8] > 0.2  # noqa: E731
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", "on=")
        refused(PrecisionWarning, "not in the plane", problem.clamp, wide, components="n")


def nearly_incompressible_solids_do_not_lock():
    problem = Elasticity(full, (2, 2, 6), domain=[[0, 0, 0], [1, 1, 6]], degree=1, poisson=0.4999)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        solution = problem.clamp("w=0").load(traction=(1e-3, 0, 0), on="w=1").solve()
    beam = 1e-3 * 6.0**3 / (3.0 / 12.0)
    assert solution.evaluate([[0.5, 0.5, 6.0]])[0, 0] > 0.6 * beam


def coarse_cells_are_told():
    problem = Elasticity(full, (4, 4, 12), domain=BAR, degree=1).clamp("w=0")
    refused(PrecisionWarning, "too coarse", problem.load(body=(1, 0, 0)).solve)


def loads_between_points_are_refused():
    narrow = lambda x: 50.0 * (np.abs(x[:, 2] - 1.5) < 1e-2)  # noqa: E731
    problem = Heat(full, (1, 1, 3), domain=BAR).fix("w=0", 0.0).source(narrow)
    refused(InputError, "source", problem.solve)


def loads_on_what_nothing_holds_are_told():
    both = lambda u: np.abs(np.abs(u[:, 2] - 1.5) - 1.0) - 0.4  # noqa: E731
    problem = Heat(both, (1, 1, 30), domain=BAR, islands="drop").fix("z < 0.1", 0.0)
    problem = problem.flux("boundary", 1.0)
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", "left out")
        warnings.filterwarnings("ignore", "on=")
        refused(PrecisionWarning, "parts that were left out", problem.forces)


def recovered_fluxes_are_bounded_in_slivers():
    """A plane that leaves a millionth of the last cell."""
    bar = lambda u: u[:, 2] - 2.000001  # noqa: E731
    problem = Heat(bar, (1, 1, 3), domain=BAR).fix("w=0", 0.0)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        solution = problem.source(lambda x: np.sin(3.0 * x[:, 2])).solve(method="superlu")
    assert np.abs(solution.recovered().projected).max() < 10.0


def jumps_within_cells_are_told():
    problem = Heat(full, 3, domain=BAR, conductivity=lambda x: 1.0 + 9.0 * (x[:, 2] > 1.3))
    refused(PrecisionWarning, "jumps or waves", problem.fix("w=0", 0.0).fix("w=1", 1.0).solve)


def stiffnesses_that_are_not_symmetric_are_refused():
    C = np.array(il.cutfem.orthotropic(young=1.0, poisson=0.3))
    C[0, 1] *= 1.5
    refused(InputError, "symmetric", Elasticity, full, 2, domain=BAR, stiffness=C)


def slivers_are_held():
    """A corner that leaves a thousandth of the last cell."""
    end, corner = 0.775, il.fields.intersection
    corner = corner(*(il.fields.half_space(axis, end) for axis in np.eye(3)))
    K = Heat(corner, 4, domain=[[0] * 3, [1] * 3], degree=3).fix("u=0", 0.0).system.K.toarray()
    d = 1.0 / np.sqrt(np.diag(K))
    assert np.linalg.cond(d[:, None] * K * d) < 3e3


def necks_that_hold_nothing_do_not_join():
    """Two cones of which the tips overlap by a circle of radius 3e-5, in cells of 0.25."""
    cones = lambda u: ((u[:, 1:] - 0.5) ** 2).sum(axis=1) - (u[:, 0] - 0.5) ** 2 - 1e-9  # noqa: E731
    problem = Heat(cones, 4, domain=[[0] * 3, [1] * 3], islands="refuse").fix("u=0", 0.0)
    refused(GeometryError, "nothing holds 1 part", lambda: problem.assembly)


def residuals_that_still_fall_are_not_laid_to_rounding():
    """Products that are off by 1e-6, then 1e-7, then nothing, in a direction that is stiff."""
    stiff, off = np.array([1e8, 1.0]), [0.0, 1e-6, 0.0, 1e-7, 0.0, 0.0]
    b, left = np.array([[0.0, 1.0]]), np.array([[1e-9, 0.0]])
    run = conjugate_gradients(
        lambda x: x * stiff + [off.pop(0), 0.0], lambda r: r / stiff, b, 1e-8, 100, None,
        lambda *_: left.copy(),
    )[0]  # fmt: skip
    assert not run.trouble
    assert not run.rounded
    assert run.residual <= 1e-8


# ---------------------------------------------------------------- cells that repeat


def strains_without_resistance_are_counted():
    plate = lambda u: np.abs(u[:, 2] - 0.5) - 0.2  # noqa: E731
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        cell = il.homogenize.ElasticCell(plate, 5, domain=[[0] * 3, [1] * 3])
        assert cell.homogenized().mechanisms == 3


def stresses_that_are_not_borne_are_refused():
    plate = lambda u: np.abs(u[:, 2] - 0.5) - 0.2  # noqa: E731
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        cell = il.homogenize.ElasticCell(plate, 5, domain=[[0] * 3, [1] * 3])
        refused(InputError, "bears nothing", cell.under, [0, 0, 1.0, 0, 0, 0])


# ---------------------------------------------------------------- closest points


def other_feet_that_are_as_near_are_met():
    """Along radii and the axis of a cylinder, which are straight: feet are where tiles vanish."""
    bent = il.macroshape.cylinder_shell(2.0, 3.0, 1.0, angle=0.4)
    for name, axis in (("iwp", 0.5), ("frd", 0.0)):
        along = lambda t, tile=il.tiles[name], v=axis: tile([[0.5, v, 0.5 + t]])[0]  # noqa: E731
        away = brentq(along, 0.2, 0.4, xtol=1e-14)
        found = il.Lattice(name, through=bent).closest([[0.5, axis, 0.5]])
        assert abs(found.distance[0]) == pytest.approx(away, rel=1e-9)
        assert abs(found.second_distance[0]) == pytest.approx(away, rel=1e-9)


def points_at_creases_are_put_onto_both_sheets():
    """Where walls are thicker than four fifths of all points are far: 17 of 577 were missed."""
    bent = il.macroshape.cylinder_shell(2.0, 3.0, 1.0, angle=0.4)
    lattice = il.Lattice("frd", through=bent)
    lo, hi = lattice.domain
    u = lo + np.random.default_rng(0).random((4000, 3)) * (hi - lo)
    distance = lattice.closest(u).distance
    d = np.quantile(np.abs(distance), 0.8)
    near = np.abs(np.abs(distance) - d) < 0.15 * d
    asked = BSpline([(a, b) for a, b in zip(lo, hi, strict=True)], np.full((1, 1, 1), d), 0)
    fixed = np.zeros((near.sum(), 3), bool)
    out, residual = polish(lattice, u[near], fixed, np.sign(distance[near]), asked)
    on = residual < 1e-6 * d
    assert on.mean() > 0.99
    assert np.abs(np.abs(lattice.distance(out[on])) - d).max() < 1e-5 * d


# ---------------------------------------------------------------- cut cells and walls


def volumes_that_are_not_known_are_told():
    wild = lambda u: np.sin(25.0 * u[:, 0] + 7.0 * u[:, 2]) - 0.3  # noqa: E731
    where = {"domain": [[0] * 3, [1] * 3]}
    refused(PrecisionWarning, "is known to", il.cutfem.cut, wild, 1, **where)


def densities_are_those_that_were_asked_for():
    lattice = il.Lattice("gyroid", through=il.macroshape.cell(), repeat=1)
    wall = lattice.offset(relative_density=0.3)
    assert wall.relative_density() == pytest.approx(0.3, rel=2e-3)


def thickness_that_splines_do_not_follow_is_refused():
    lattice = il.Lattice("schwarz_p", through=il.macroshape.cell(), repeat=1)
    fine = lambda u: 0.05 + 0.04 * np.abs(np.sin(40.0 * u.sum(axis=1)))  # noqa: E731
    refused(InputError, "too fast for a spline", lattice.offset, fine)


def specks_are_left_out():
    """Beside a tetrahedron as large as a cell, one of a hundredth of its size."""
    corners, faces = np.eye(4, 3), np.array([[0, 2, 1], [0, 1, 3], [1, 2, 3], [0, 3, 2]])
    x = np.concatenate([corners, 2.0 + 0.01 * corners])
    both = np.concatenate([faces, faces + 4])
    given = Repair(np.arange(8), both, np.arange(8), 0, 0, 0)
    found = without_specks(x, given, lambda vertices: np.ones(len(vertices)))
    assert len(found.faces) == 4


def walls_may_end_where_the_distance_jumps():
    """By 0.02 and 0.005 of the half-thickness; where it is just steep, there is an offset."""
    axes, d = (np.linspace(0.0, 1.0, 11),) * 3, 0.1
    u, free = np.array([[0.51, 0.55, 0.55]]), np.zeros((1, 3), bool)
    for step, steep, told in ((0.02, 0.0, True), (0.005, 0.0, False), (0.0, 1e4, False)):

        def query(u, step=step, steep=steep, **_):
            x = u[:, 0] - 0.53
            far = d * (1.0 + 0.5 * step * np.where(x > 0.0, 1.0, -1.0) + steep * x)
            return SimpleNamespace(distance=far, status=np.zeros(len(u), int))

        lattice = SimpleNamespace(
            domain=np.array([[0.0] * 3, [1.0] * 3]),
            through=SimpleNamespace(closed=(False,) * 3),
            search=SimpleNamespace(query=query),
        )
        clearance = lambda _, side, s: side * s - d  # noqa: E731
        wall = SimpleNamespace(lattice=lattice, thickness=SimpleNamespace(clearance=clearance))
        found = _own_cells.at_jumps(wall, axes, u, free, np.ones(1), np.full(1, d))
        assert found.tolist() == [told]


def edges_are_sharp():
    box = il.fields.rotate(il.fields.box(0.6), 0.7, (1.0, 2.0, 0.5))
    axes = (np.linspace(-1.13, 1.13, 24),) * 3
    found = sharpened(contour_arrays(box, axes), box, axes, None)
    assert SurfaceMesh(found.vertices, found.faces).volume == pytest.approx(1.2**3, rel=1e-3)


CASES = [
    ("cutfem.problem", "FREE", 1e-30, what_can_move_along_an_oblique_axis_is_not_held,
     AssertionError, r"assert {.*} == {0: \(2, 6\)}"),
    ("cutfem.problem", "AT_REST", 0.0, bodies_that_only_move_store_nothing,
     PrecisionWarning, r"the strain energy is off by"),
    ("cutfem.weak", "NITSCHE", 1e-3, weak_supports_hold,
     InputError, r"K must have a positive diagonal"),
    ("cutfem.overlaps", "MIN_REST", 3.0, supports_that_overlap_hold_once,
     AssertionError, r"\[0, 0\]: 0\.0 \(ACTUAL\), 0\.5 \(DESIRED\)"),
    ("cutfem.constraints", "SAME", 1e300, supports_that_contradict_are_refused,
     AssertionError, r"not said: contradict"),
    ("cutfem.posed", "ROUGH", np.inf, rough_regions_are_told,
     AssertionError, r"not said: its area is off"),
    ("cutfem.posed", "RIM", 1.0, planes_with_a_rim_are_told,
     AssertionError, r"not said: not in the plane"),
    ("cutfem.operators", "FROM", 1.0, nearly_incompressible_solids_do_not_lock,
     AssertionError, r"0\.047\d+\) > \(0\.6"),
    ("cutfem.discretization", "WARNED", np.inf, coarse_cells_are_told,
     AssertionError, r"not said: too coarse"),
    ("cutfem.sampling", "USELESS", np.inf, loads_between_points_are_refused,
     PrecisionWarning, r"source jumps or waves between the points"),
    ("cutfem.watching", "LOST", np.inf, loads_on_what_nothing_holds_are_told,
     AssertionError, r"not said: parts that were left out"),
    ("cutfem.recovery", "WEIGHTS", {2: 0.0}, recovered_fluxes_are_bounded_in_slivers,
     AssertionError, r"\) < 10\.0"),
    ("cutfem.jumps", "STEEP", np.inf, jumps_within_cells_are_told,
     AssertionError, r"not said: jumps or waves"),
    ("cutfem.anisotropic", "ODD", np.inf, stiffnesses_that_are_not_symmetric_are_refused,
     AssertionError, r"not said: symmetric"),
    ("cutfem.domain", "GHOST", {(3, 2): 0.0}, slivers_are_held,
     AssertionError, r"\) < 3000\.0"),
    ("cutfem.connectivity", "MIN_NECK", 0.0, necks_that_hold_nothing_do_not_join,
     AssertionError, r"not said: nothing holds 1 part"),
    ("linalg._krylov", "STALLED", 0.0, residuals_that_still_fall_are_not_laid_to_rounding,
     AssertionError, r"True = Run\(.*\)\.rounded"),
    ("homogenize.effective", "SOFT", 0.9, strains_without_resistance_are_counted,
     AssertionError, r"assert 5 == 3"),
    ("homogenize.local", "BORNE", np.inf, stresses_that_are_not_borne_are_refused,
     AssertionError, r"not said: bears nothing"),
    ("quadrature.cutting", "TOLD", np.inf, volumes_that_are_not_known_are_told,
     AssertionError, r"not said: is known to"),
    ("offsets.retrying", "RIVAL", 0.0, other_feet_that_are_as_near_are_met,
     AssertionError, r"0\.28631\d+\) == 0\.28607"),
    ("offsets.polish", "APART", 1.0, points_at_creases_are_put_onto_both_sheets,
     AssertionError, r"0\.97\d+\) > 0\.99"),
    ("offsets.density", "TOLERANCE", 1.0, densities_are_those_that_were_asked_for,
     AssertionError, r"0\.424\d+ == 0\.3 "),
    ("offsets.thickness", "REFUSE", np.inf, thickness_that_splines_do_not_follow_is_refused,
     PrecisionWarning, r"the spline that stands for d is off by 29 %"),
    ("mesh._own_cells", "JUMP", 1e300, walls_may_end_where_the_distance_jumps,
     AssertionError, r"assert \[False\] == \[True\]"),
    ("mesh._own_cells", "JUMP", 0.0, walls_may_end_where_the_distance_jumps,
     AssertionError, r"assert \[True\] == \[False\]"),
    ("mesh.creases", "TURNS", 0, edges_are_sharp,
     AssertionError, r"assert 1\.7[01]\d+ == 1\.72"),
    ("mesh.specks", "SPECK", 0.0, specks_are_left_out,
     AssertionError, r"assert 8 == 4"),
]  # fmt: skip


@pytest.mark.parametrize(("module", "name", "useless", "case", "kind", "match"), CASES)
def test_a_useless_constant_is_noticed(module, name, useless, case, kind, match, monkeypatch):
    module = importlib.import_module(f"ilattice.{module}")
    assert name in vars(module)
    case()
    monkeypatch.setattr(module, name, useless)
    with pytest.raises(kind, match=match):
        case()
