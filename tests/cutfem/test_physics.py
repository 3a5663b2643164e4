"""Laws: what follows from a tensor alone is what known laws do better, and solutions are exact."""

import numpy as np
import pytest

import ilattice as il
from ilattice.cutfem import Elasticity, FieldSolution, Heat, Law, Physics
from ilattice.cutfem._voigt import isotropic, tensor
from ilattice.errors import InputError, PrecisionWarning

CUBE = [[-1.1] * 3, [1.1] * 3]
BAR = [[0, 0, 0], [1, 1, 3]]
RNG = np.random.default_rng(5)


def ball(u):
    return (u**2).sum(axis=1) - 1.0


def full(u):
    return -np.ones(len(u))


class Plain(Law):
    """A scalar law with one matrix."""

    def __init__(self, k):
        self.k = np.array(k, float)

    def tangent(self, asm, u):  # noqa: ARG002
        return self.k[None, None, :, None, :]


class Along(Law):
    """Five times as much flows along circles about z as across."""

    def tangent(self, asm, u):
        x = asm.x(u)
        t = np.stack([-x[:, 1], x[:, 0], 0.0 * x[:, 0]], axis=1)
        t /= np.linalg.norm(t, axis=1, keepdims=True)
        return (np.eye(3) + 4.0 * t[:, :, None] * t[:, None, :])[:, None, :, None, :]


class Both(Law):
    """Two substances, each of which flows by the gradient of the other, too."""

    m = 2
    D = np.array([[2.0, 0.5], [0.5, 1.0]])

    def tangent(self, asm, u):  # noqa: ARG002
        return np.einsum("ij,kl->ikjl", self.D, np.eye(3))[None]


class Layers(Law):
    """Two phases."""

    @property
    def phases(self):
        return Plain(np.eye(3)), Plain(np.diag([1.0, 2.0, 5.0]))

    def tangent(self, asm, u):  # noqa: ARG002
        raise AssertionError("each phase has its own")


def integral(solution, exact):
    """Root mean square of the error over the solid."""
    rule = solution.problem.domain.solid(solution.problem.assembly)
    off = solution.evaluate(rule.parameters) - exact(rule.points)
    return np.sqrt(rule.integrate((off.reshape(len(off), -1) ** 2).sum(axis=1)))


@pytest.mark.filterwarnings("ignore:the cells are too coarse")
def test_fluxes_on_rules_are_those_of_a_linear_solution():
    K, g = np.array([[3.0, 0.5, 0.0], [0.5, 1.0, 0.0], [0.0, 0.0, 2.0]]), np.array([1.0, -2.0, 0.5])
    problem = Physics(ball, 4, domain=CUBE, law=Plain(K))
    solution = problem.hold("surface", lambda x: x @ g).solve()
    rule = problem.domain.cut.volume(2)
    flux = solution.flux_on(rule)
    np.testing.assert_allclose(flux, np.tile(K @ g, (len(rule), 1)), atol=2e-4)
    np.testing.assert_allclose(flux, solution.flux(rule.points), atol=1e-12)
    with pytest.raises(InputError, match="rule must be a Quadrature"):
        solution.flux_on(rule.points)


@pytest.mark.filterwarnings("ignore:the cells are too coarse")
def test_a_law_by_its_tensor_alone_does_what_heat_does():
    k = [[3.0, 0.5, 0.0], [0.5, 1.0, 0.0], [0.0, 0.0, 2.0]]
    heat = Heat(ball, 4, domain=CUBE, conductivity=np.array(k))
    mine = Physics(heat.domain, law=Plain(k))
    hot = lambda x: x[:, 0] ** 2  # noqa: E731
    heat = heat.fix("z < 0", hot).convection("z > 0.55", 2.0, around=1.0).source(1.0)
    mine = mine.hold("z < 0", hot).exchange("z > 0.55", 2.0, around=1.0).load(body=1.0)
    heat, mine = heat.flux("surface", 0.1), mine.load(surface=0.1, on="surface")
    a, b = heat.solve(), mine.solve()
    assert isinstance(b, FieldSolution)
    np.testing.assert_allclose(b.coefficients, a.coefficients, atol=1e-9)
    u = [[0.1, 0.2, 0.3], [-0.5, 0.0, 0.4]]
    np.testing.assert_allclose(b.flux(u), -a.heat_flux(u), atol=1e-8)
    np.testing.assert_allclose(b.recovered().flux(u), -a.recovered().heat_flux(u), atol=1e-7)
    assert b.error_estimate().total == pytest.approx(a.error_estimate().total, rel=1e-6)
    assert a.inflow.keys() == b.inflow.keys()
    for on, flow in a.inflow.items():
        assert b.inflow[on][0] == pytest.approx(flow, abs=1e-8)


@pytest.mark.filterwarnings("ignore:the cells are too coarse")
def test_a_law_by_its_tensor_alone_does_what_elasticity_does():
    """On full cells, where no penalty depends on the material."""

    class Elastic(Law):
        m = 3

        def tangent(self, asm, u):  # noqa: ARG002
            return tensor(isotropic(0.4, 0.6))[None]

    E, nu = 0.6 * (3 * 0.4 + 2 * 0.6) / (0.4 + 0.6), 0.4 / (2 * (0.4 + 0.6))
    known = Elasticity(full, (2, 2, 3), domain=BAR, young=E, poisson=nu)
    mine = Physics(known.domain, law=Elastic())
    a = known.clamp("w=0").load(body=(0.0, 1.0, 0.5)).solve()
    b = mine.hold("w=0").load(body=(0.0, 1.0, 0.5)).solve()
    np.testing.assert_allclose(b.coefficients, a.coefficients, atol=1e-7)
    assert b.energy == pytest.approx(a.energy, rel=1e-7)


@pytest.mark.parametrize("kind", ["number", "matrix", "isotropic", "anisotropic"])
def test_laws_that_know_more_agree_with_their_tensor(kind):
    heat = Heat(full, 2, domain=BAR, conductivity=2.0 if kind == "number" else np.diag([1, 2, 3]))
    C = il.cutfem.orthotropic(young=(3.0, 2.0, 1.0), poisson=0.2, shear=(1.0, 0.8, 0.6))
    solids = {"isotropic": {"young": 2.0, "poisson": 0.2}, "anisotropic": {"stiffness": C}}
    problem = Elasticity(heat.domain, **solids[kind]) if kind in solids else heat
    law, asm = problem.law, problem.assembly
    u, n = RNG.random((7, 3)), RNG.standard_normal((7, 3))
    n /= np.linalg.norm(n, axis=1, keepdims=True)
    gradient = RNG.standard_normal((7, law.m, 3))
    flux = law.flux(asm, u, gradient)
    assert flux.shape == (7, law.entries)
    np.testing.assert_allclose(law.components(flux).reshape(7, -1), Law.flux(law, asm, u, gradient))
    through = np.einsum("qijl,qjl->qi", law.normal(asm, u, n), gradient)
    np.testing.assert_allclose(through, law.through(flux, n), atol=1e-12)
    np.testing.assert_allclose(law.normal(asm, u, n), Law.normal(law, asm, u, n), atol=1e-12)
    stored = (law.components(flux) * gradient).sum(axis=(1, 2))
    np.testing.assert_allclose(law.stored(asm, u, flux), stored)
    # tractions squared, in the inverse of the penalty, are no more than what is stored
    work = np.einsum(
        "qi,qi->q", through, np.linalg.solve(law.penalty(asm, u, n), through[..., None])[..., 0]
    )
    assert (work <= (1 + 1e-12) * stored).all()


def test_fluxes_along_curved_fibres_are_exact():
    """r² has no gradient along circles: div(A grad r²) is 4 whatever flows along them."""
    ring = lambda u: (np.hypot(u[:, 0], u[:, 1]) - 1.5) ** 2 + u[:, 2] ** 2 - 0.25  # noqa: E731
    box = [[-2.1, -2.1, -0.6], [2.1, 2.1, 0.6]]
    exact = lambda x: x[:, 0] ** 2 + x[:, 1] ** 2  # noqa: E731
    problem = Physics(ring, (10, 10, 3), law=Along(), domain=box)
    solution = problem.hold("surface", exact).load(body=-4.0).solve()
    assert integral(solution, exact) < 2e-4
    x = np.array([[1.5, 0.1, 0.0]])
    np.testing.assert_allclose(solution.flux(x), [[3.0, 0.2, 0.0]], atol=5e-3)
    volume = solution.problem.domain.solid(solution.problem.assembly).integrate()
    assert solution.inflow["surface"][0] == pytest.approx(4.0 * volume, rel=1e-6)


def test_two_unknowns_that_couple_are_exact():
    exact = lambda x: np.stack([x[:, 0] ** 2 + x[:, 1], x[:, 2] ** 2 - x[:, 0]], axis=1)  # noqa: E731
    problem = Physics(ball, 6, law=Both(), domain=CUBE)
    solution = problem.hold("surface", exact).load(body=-Both.D @ [2.0, 2.0]).solve()
    assert integral(solution, exact) < 5e-5
    volume = solution.problem.domain.solid(solution.problem.assembly).integrate()
    np.testing.assert_allclose(solution.inflow["surface"], Both.D @ [2, 2] * volume, rtol=1e-6)
    uncoupled = problem.hold("surface", exact).load(body=-2.0 * np.diag(Both.D)).solve()
    assert integral(uncoupled, exact) > 1e-2  # the coupling counts


def test_one_unknown_of_several_may_be_held():
    problem = Physics(full, (2, 2, 2), law=Both(), domain=BAR)
    problem = problem.hold("w=0").hold("w=1", (0.0, 3.0), components=(1,)).solve()
    # the first one is free at the end: nothing of it flows there
    np.testing.assert_allclose(problem.evaluate([[0.5, 0.5, 3.0]]), [[-0.75, 3.0]], atol=1e-9)


def test_each_phase_has_its_own_law():
    problem = Physics(full, (2, 2, 5), law=Layers(), domain=BAR, phases=lambda x: x[:, 2] - 1.37)
    solution = problem.hold("w=0").hold("w=1", 1.0).solve()
    flow = 1.0 / (1.37 + 1.63 / 5.0)
    np.testing.assert_allclose(solution.flux([[0.3, 0.4, 0.5], [0.6, 0.2, 2.5]])[:, 2], flow)
    np.testing.assert_allclose(solution.evaluate([[0.3, 0.4, 1.37]]), 1.37 * flow)


@pytest.mark.filterwarnings("ignore:the cells are too coarse")
@pytest.mark.parametrize("heat", [False, True])
def test_what_comes_in_is_that_of_the_solution_when_fluxes_are_recovered(heat):
    if heat:
        problem = Heat(ball, 4, domain=CUBE).fix("z < 0", 1.0).source(1.0)
        solution = problem.solve()
        assert solution.recovered().inflow == pytest.approx(dict(solution.inflow))
    else:
        problem = Elasticity(ball, 4, domain=CUBE).clamp("z < 0").load(body=(1, 0, 0))
        solution = problem.solve()
        found = solution.recovered().reactions["z < 0"]
        np.testing.assert_allclose(found, solution.reactions["z < 0"], atol=1e-12)
        volume = problem.domain.volume.integrate()
        np.testing.assert_allclose(found, [-volume, 0, 0], atol=1e-6)


def test_results_of_any_law_are_written_and_told(tmp_path):
    import pyvista as pv

    solution = Physics(full, 2, law=Both(), domain=BAR).hold("w=0").hold("w=1", 1.0).solve()
    solution.save(tmp_path / "both.vtu")
    data = pv.read(tmp_path / "both.vtu").point_data
    assert data["value"].shape[1] == 2
    assert data["flux"].shape[1] == 6
    solution.report(tmp_path / "both.html", pictures=False)
    assert "Physics" in (tmp_path / "both.html").read_text(encoding="utf-8")
    assert repr(solution).startswith("FieldSolution(")


def test_what_is_no_law_or_no_load_is_refused():
    with pytest.raises(InputError, match="law must be a Law"):
        Physics(full, 2, law=3.0, domain=BAR)
    with pytest.raises(InputError, match="of a class with a tangent"):
        Physics(full, 2, law=Law(), domain=BAR)
    problem = Physics(full, 2, law=Both(), domain=BAR)
    with pytest.raises(InputError, match="nothing holds the field"):
        problem.load(body=1.0).solve()
    with pytest.raises(InputError, match="needs a place"):
        problem.load(surface=1.0)
    with pytest.raises(InputError, match="body or surface"):
        problem.load()
    with pytest.raises(InputError, match="one number or 2"):
        problem.load(body=(1.0, 2.0, 3.0))


def test_tensors_of_a_wrong_shape_are_refused():
    class Wrong(Law):
        def tangent(self, asm, u):  # noqa: ARG002
            return np.eye(3)[None]

    with pytest.raises(InputError, match=r"shape \(1, 1, 3, 1, 3\) at one point, got \(1, 3, 3\)"):
        Physics(full, 2, law=Wrong(), domain=BAR).hold("w=0").solve()


@pytest.mark.parametrize(("k", "what"), [
    ([[2.0, 1.0, 0.0], [-1.0, 2.0, 0.0], [0.0, 0.0, 1.0]], "not symmetric at u="),
    (np.diag([1.0, -0.1, 2.0]), "not positive at u="),
    (np.diag([1.0, np.nan, 2.0]), "must be finite"),
    (np.zeros((3, 3)), "zero for an unknown"),
])  # fmt: skip
def test_tensors_without_an_energy_are_refused(k, what):
    """They were solved without a word, by the symmetric part of the matrix."""
    problem = Physics(full, 2, law=Plain(k), domain=BAR).hold("w=0")
    with pytest.raises(InputError, match=what):
        problem.load(body=1.0).solve()


def test_tensors_that_have_no_energy_somewhere_are_refused():
    class Falling(Law):
        def tangent(self, asm, u):
            return (0.7 - asm.x(u)[:, :1, None, None, None]) * np.eye(3)[None, None, :, None, :]

    problem = Physics(full, 4, law=Falling(), domain=BAR).hold("w=0").load(body=1.0)
    with pytest.raises(InputError, match="not positive at u="):
        problem.solve()


def turned(x):
    """Ten times as much flows along y below z = 0.53, and along z above."""
    k = np.where((x[:, 2] < 0.53)[:, None], [1.0, 1.0, 10.0], [1.0, 10.0, 1.0])
    return k[:, :, None] * np.eye(3)


@pytest.mark.parametrize("kind", ["law", "heat"])
def test_tensors_that_turn_within_cells_are_told(kind):
    """Their mean does not jump: 6 % off, without a word."""

    class Turned(Law):
        def tangent(self, asm, u):
            return turned(asm.x(u))[:, None, :, None, :]

    cube = {"domain": [[0, 0, 0], [1, 1, 1]], "degree": 1}
    if kind == "law":
        problem = Physics(full, (2, 2, 4), law=Turned(), **cube).hold("w=0").hold("w=1", 1.0)
    else:
        problem = Heat(full, (2, 2, 4), conductivity=turned, **cube).fix("w=0", 0.0).fix("w=1", 1.0)
    with pytest.warns(PrecisionWarning, match="jumps or waves by a factor of 10 within a cell"):
        problem.solve()


def test_one_unknown_of_two_that_jumps_is_told():
    """Beside another one that is a thousand times as stiff."""

    class Two(Law):
        m = 2

        def tangent(self, asm, u):
            k = np.where(asm.x(u)[:, 2] < 0.53, 1.0, 20.0)
            D = np.stack([np.full(len(u), 1e4), k], axis=1)
            return np.einsum("qi,ij,kl->qikjl", D, np.eye(2), np.eye(3))

    problem = Physics(full, (2, 2, 4), law=Two(), domain=[[0, 0, 0], [1, 1, 1]], degree=1)
    with pytest.warns(PrecisionWarning, match="jumps or waves by a factor of 20 within a cell"):
        problem.hold("w=0").hold("w=1", 1.0).solve()


@pytest.mark.filterwarnings("ignore:the cells are too coarse")
@pytest.mark.parametrize("seed", range(3))
def test_estimates_of_laws_that_rotations_cost_nothing(seed):
    """Singular tensors were inverted: NaN, errors of NumPy, or thirty times too much."""
    rng = np.random.default_rng(seed)
    turn = np.linalg.qr(rng.standard_normal((3, 3)))[0]
    C = np.diag([1.5, 1.5, 1.5, 0.0, 0.0, 0.0]) + isotropic(0.58, 0.38)
    A = np.einsum("ai,bk,cj,dl,ikjl->abcd", *[turn] * 4, tensor(C))

    class Crystal(Law):
        m = 3

        def tangent(self, asm, u):  # noqa: ARG002
            return A[None]

    pairs = ((0, 0), (1, 1), (2, 2), (1, 2), (0, 2), (0, 1))
    voigt = np.array([[A[i, j, k, m] for k, m in pairs] for i, j in pairs])
    how = {"domain": CUBE, "degree": 2}
    mine = Physics(ball, 4, law=Crystal(), **how).hold("z < 0").load(body=(0.0, 1.0, 2.0))
    known = Elasticity(ball, 4, stiffness=voigt, **how).clamp("z < 0").load(body=(0.0, 1.0, 2.0))
    a, b = mine.solve().error_estimate().relative, known.solve().error_estimate().relative
    assert a == pytest.approx(b, rel=0.15)


def test_a_law_that_changes_later_changes_nothing():
    law = Plain(np.eye(3))
    problem = Physics(full, 2, law=law, domain=BAR).hold("w=0").load(body=1.0)
    before = problem.solve()
    law.k *= 2.0
    after = problem.solve()
    np.testing.assert_array_equal(after.coefficients, before.coefficients)
    np.testing.assert_array_equal(after.flux([[0.5, 0.5, 1.0]]), before.flux([[0.5, 0.5, 1.0]]))
    assert repr(problem).startswith("Physics(Plain, ")


def test_unknowns_and_phases_that_are_none_are_refused():
    for m in (0, -1, 1.5, True, "2"):
        law = type("Odd", (Plain,), {"m": m})(np.eye(3))
        with pytest.raises(InputError, match=r"law\.m must be"):
            Physics(full, 2, law=law, domain=BAR)
    for phases in ((), (Plain(np.eye(3)),), (1, 2), (Plain(np.eye(3)), Both())):
        law = type("Odd", (Plain,), {"phases": phases})(np.eye(3))
        with pytest.raises(InputError, match=r"law\.phases must be"):
            Physics(full, 2, law=law, domain=BAR)
    with pytest.raises(InputError, match="numbers of unknowns, from 0 to 1"):
        Physics(full, 2, law=Both(), domain=BAR).hold("surface", components="n")
    law = Plain(np.eye(3))
    law.k = 1j * np.eye(3)
    with pytest.raises(InputError, match="real numbers"):
        Physics(full, 2, law=law, domain=BAR).hold("w=0").solve()


def test_one_row_of_a_tensor_that_varies_is_refused():
    class Short(Law):
        def tangent(self, asm, u):
            return (1.0 + 5.0 * asm.x(u)[:1, 2]) * np.eye(3)[None, None, :, None, :]

    with pytest.raises(InputError, match=r"one row for \d+ points"):
        Physics(full, 3, law=Short(), domain=BAR).hold("w=0").solve()
