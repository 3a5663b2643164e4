"""Patches, fields, points, rigid connections and turns, by equilibrium, Saint-Venant and beams."""

import numpy as np
import pytest

import ilattice as il
from ilattice.cutfem.places import Motion
from ilattice.errors import GeometryError, InputError

pytestmark = pytest.mark.filterwarnings("ignore::ilattice.errors.PrecisionWarning")

LENGTH, SHEAR = 2.93, 40.0
AXIS = np.array([0.013, -0.021, 0.0])


@pytest.fixture(scope="module")
def rod():
    """A round rod of radius 0.5 along z, between planes of the grid, off its middle."""
    rod = il.fields.translate(il.fields.cylinder(0.5), AXIS)
    grid = il.cutfem.cut(rod, (6, 6, 6), domain=[[-0.57, -0.59, 0], [0.6, 0.55, LENGTH]])
    return il.cutfem.Elasticity(grid, young=2.6 * SHEAR, poisson=0.3, strength=3.0).clamp("w=0")


@pytest.fixture(scope="module")
def bar():
    """A bar of 4 x 1 x 1, cut by no grid plane, of which Euler and Bernoulli are right."""
    body = il.fields.translate(il.fields.box((2.0, 0.5, 0.5)), (2.03, 0.48, 0.51))
    grid = il.cutfem.cut(body, (14, 5, 5), domain=[[-0.2, -0.2, -0.2], [4.3, 1.2, 1.2]])
    return il.cutfem.Elasticity(grid, young=100.0, poisson=0.0).clamp("x < 0.030001")


@pytest.fixture(scope="module")
def wall():
    through = il.macroshape.torus(major=3.0, width=1.4)
    lattice = il.Lattice("schwarz_p", through=through, repeat=(8, 1, 1), spans_per_tile=6)
    return lattice.offset(0.12)


def sums(problem, about=0.0):
    """Force and moment of the loads."""
    f, x = problem.forces(), problem.assembly.coordinates - about
    return f.sum(axis=0), np.cross(x, f).sum(axis=0)


@pytest.mark.parametrize("on", ["w=1", "z > 2.9299999"])
def test_turned_rods_need_the_torque_of_saint_venant(rod, on):
    """Also if the end is free to move and is turned by that torque, held exactly or weakly."""
    angle, middle = 0.07, np.array([*AXIS[:2], LENGTH])
    torque = SHEAR * np.pi * 0.5**4 / 2 * angle / LENGTH
    turned = rod.clamp(on, rotation=(0, 0, angle), about=middle).solve()
    assert 2 * turned.energy == pytest.approx(torque * angle, rel=2e-3)
    free = rod.rigid(on, moment=(0, 0, torque)).solve()
    (motion,) = free.motions
    np.testing.assert_allclose(motion.rotation, [0, 0, angle], atol=2e-3 * angle)
    np.testing.assert_allclose(motion.translation, 0.0, atol=2e-3 * angle)
    np.testing.assert_allclose(motion.about, middle, atol=2e-3)
    assert free.compliance == pytest.approx(torque * angle, rel=2e-3)
    assert 2 * free.energy == pytest.approx(free.compliance, rel=2e-3)


def test_rigid_ends_of_beams_sink_and_turn(bar):
    force, arm = 0.3, 0.7
    problem = bar.rigid("x > 4.029999", force=(0, 0, -force), about=(4.03 + arm, 0.48, 0.51))
    solved = problem.solve()
    (motion,) = solved.motions
    stiff, moment = 100 / 12, force * arm  # the force acts on a rigid arm
    turn = force * 16 / (2 * stiff) + moment * 4 / stiff
    sag = force * 64 / (3 * stiff) + moment * 16 / (2 * stiff) + force * 4 / (50 * 5 / 6)
    assert motion.rotation[1] == pytest.approx(turn, rel=1e-3)
    assert motion.translation[2] == pytest.approx(-sag - turn * arm, rel=3e-3)
    np.testing.assert_allclose(solved.reactions["x > 4.029999"], [0, 0, -force], atol=1e-8)
    assert solved.equilibrium < 1e-8
    assert solved.compliance == pytest.approx(2 * solved.energy, rel=1e-3)


def test_two_bars_are_joined_by_a_rigid_place():
    """A second bar on the same axis that nothing else holds: it hangs on the first."""
    other = il.fields.translate(il.fields.box((0.9, 0.5, 0.5)), (5.33, 0.48, 0.51))
    both = il.fields.union(il.fields.translate(il.fields.box((2.0, 0.5, 0.5)), (2.03, 0.48, 0.51)),
                           other)  # fmt: skip
    grid = il.cutfem.cut(both, (22, 5, 5), domain=[[-0.2, -0.2, -0.2], [6.5, 1.2, 1.2]])
    problem = il.cutfem.Elasticity(grid, young=100.0, poisson=0.0).clamp("x < 0.030001")
    solved = (
        problem.rigid([[4.0299, -9, -9], [4.4301, 9, 9]])
        .load(force=(0, 0, -0.1), on="x > 6.2299")
        .solve()
    )
    (motion,) = solved.motions
    arm, stiff = 6.23 - 4.03, 100 / 12
    assert motion.rotation[1] == pytest.approx(0.1 * (8 + 4 * arm) / stiff, rel=2e-3)
    np.testing.assert_allclose(sum(solved.reactions.values()), [0, 0, 0.1], atol=1e-7)


@pytest.mark.parametrize("seed", range(2))
def test_rigid_places_of_curved_walls_get_what_is_asked(wall, seed):
    """Random places, forces and moments: work on the motion is twice the energy, by Clapeyron."""
    rng = np.random.default_rng(seed)
    a, force, moment, point = rng.normal(size=(4, 3))
    problem = il.cutfem.Elasticity(wall, (24, 4, 4), degree=1)
    low, high = np.quantile(problem.domain.boundary("surface").points @ a, [0.2, 0.75])
    problem = problem.clamp(lambda x: x @ a < low)

    def place(x):
        return x @ a > high

    solved = problem.rigid(place, force=force, moment=moment, about=point).solve()
    (motion,) = solved.motions
    work = force @ motion.translation + moment @ motion.rotation
    assert solved.compliance == pytest.approx(work, rel=1e-12)
    on = solved.problem.connections[0].on
    rule = solved.problem.domain.boundary(on)
    moved = solved.displacement(rule.parameters) - motion(rule.points)
    held = np.sqrt(rule.weights @ (moved**2).sum(axis=1) / rule.weights.sum())
    assert held < 0.03 * np.abs(motion(rule.points)).max()
    np.testing.assert_allclose(solved.reactions[str(on)], force, atol=1e-6 * np.abs(force).max())
    other = problem.rigid(place, about=point + 1.0, force=force,
                          moment=moment - np.cross(np.ones(3), force)).solve()  # fmt: skip
    np.testing.assert_allclose(other.motions[0].rotation, motion.rotation, rtol=1e-5, atol=1e-9)


def test_forces_at_points_have_their_lines_of_action(bar, wall):
    force, at = np.array([0.02, -0.05, -0.3]), np.array([3.91, 0.37, 0.66])
    problem = bar.load(force=force, at=at)
    f, m = sums(problem)
    np.testing.assert_allclose(f, force, atol=1e-12)
    np.testing.assert_allclose(m, np.cross(at, force), atol=1e-11)
    far = problem.solve().at([[2.03, 0.48, 0.51]]).displacement[0, 2]
    x = 2.0
    sag = 0.3 * x**2 * (3 * (at[0] - 0.03) - x) / (6 * 100 / 12) + 0.3 * x / (50 * 5 / 6)
    bend = -0.02 * (at[2] - 0.51) * x**2 / (2 * 100 / 12)
    assert far == pytest.approx(-sag + bend, rel=2e-3)
    curved = il.cutfem.Elasticity(wall, (24, 4, 4), degree=1).clamp("w=0")
    point = curved.domain.volume.in_space().points[1234]
    np.testing.assert_allclose(curved.load(force=force, at=point).forces().sum(axis=0), force)


@pytest.mark.parametrize("seed", range(3))
def test_patches_of_meshes_are_places(seed):
    """Faces of a ball that look one way: their area, and a pressure on them."""
    rng = np.random.default_rng(seed)
    way = rng.normal(size=3)
    way /= np.linalg.norm(way)
    ball = il.fields.translate(il.fields.sphere(0.9), (0.03, -0.02, 0.05))
    problem = il.cutfem.Elasticity(ball, 9, domain=[[-1.0] * 3, [1.1] * 3], degree=1)
    mesh = il.sdf.mesh(ball, 0.1)
    middle = mesh.vertices[mesh.faces].mean(axis=1) - (0.03, -0.02, 0.05)
    patch = mesh.select(middle @ way > rng.uniform(0.2, 0.5))
    loaded = problem.load(force=(0, 0, 1.0), on=patch)
    place = loaded.loads[0].on
    rule = loaded.domain.boundary(place)
    assert rule.weights.sum() == pytest.approx(patch.area, rel=0.03)
    middle = mesh.vertices[mesh.faces].mean(axis=1)
    level = ((patch.vertices - (0.03, -0.02, 0.05)) @ way).min()
    assert ((rule.points - (0.03, -0.02, 0.05)) @ way).min() > level - 0.03
    np.testing.assert_allclose(sums(loaded.clamp("z < -0.5"))[0], [0, 0, 1.0], atol=1e-9)


def test_thin_walls_behind_patches_do_not_belong_to_them():
    """A shell of 0.015 whose outer side is given by triangles with edges of 0.1."""
    centre = (0.03, -0.02, 0.05)
    outer, inner = (il.fields.translate(il.fields.sphere(r), centre) for r in (0.9, 0.885))
    shell = il.fields.intersection(outer, il.fields.complement(inner))
    problem = il.cutfem.Elasticity(shell, 7, domain=[[-1.0] * 3, [1.1] * 3], degree=1)
    mesh = il.sdf.mesh(outer, 0.1)
    middle = mesh.vertices[mesh.faces].mean(axis=1) - centre
    patch = mesh.select(middle @ (0.48, -0.6, 0.64) > 0.31)
    place = problem.load(pressure=1.0, on=patch).loads[0].on
    assert problem.domain.boundary(place).weights.sum() == pytest.approx(patch.area, rel=0.05)


def test_flat_patches_end_at_their_rim(bar):
    """Of sides that stand on the patch nothing belongs to it."""
    rng = np.random.default_rng(3)
    corners = np.array([[4.03, -0.02, 0.01], [4.03, 0.98, 0.01], [4.03, 0.98, 0.6],
                        [4.03, -0.02, 0.6]])  # fmt: skip
    patch = il.SurfaceMesh(corners + 1e-7 * rng.normal(size=(4, 3)), [[0, 1, 2], [0, 2, 3]])
    rule = bar.domain.boundary(bar.load(force=(1, 0, 0), on=patch).loads[0].on)
    np.testing.assert_allclose(rule.points[:, 0], 4.03, atol=1e-6)
    assert rule.points[:, 2].max() < 0.6
    assert rule.weights.sum() == pytest.approx(0.59, rel=0.1)  # cells at its edge are not divided


def test_fields_are_places(bar):
    ball = il.fields.translate(il.fields.sphere(0.41), (2.2, 0.45, 1.01))
    problem = bar.load(force=(0, 0, -1.0), on=ball)
    rule = bar.domain.boundary(problem.loads[0].on)
    told = bar.domain.area_error(problem.loads[0].on)  # its edge passes through cells
    assert rule.weights.sum() == pytest.approx(np.pi * 0.41**2, rel=2 * told)
    assert told < 0.1
    heat = il.cutfem.Heat(bar.domain, conductivity=2.0).fix(ball, 1.0).fix("x < 0.030001", 0.0)
    assert 0.0 < heat.solve().at([[1.2, 0.5, 0.5]]).temperature[0] < 1.0


def test_results_along_lines_and_margins(rod, tmp_path):
    """Stress grows with the radius, and yields where it passes the strength."""
    from PIL import Image

    torque = 2 * 3.0 / np.sqrt(3) * np.pi * 0.5**3 / 2  # twice what makes the rim yield
    solved = rod.rigid("w=1", moment=(0, 0, torque)).solve()
    line = solved.along(np.array([0, 0, 1.4]) + AXIS, np.array([0.9, 0, 1.4]) + AXIS, n=91)
    r = np.linspace(0.0, 0.9, 91)
    np.testing.assert_allclose(line.distance, r, atol=1e-12)
    assert (np.flatnonzero(line.inside) == np.arange(line.inside.sum())).all()
    assert r[line.inside].max() == pytest.approx(0.5, abs=0.03)
    inside = (r > 0.05) & (r < 0.5)
    np.testing.assert_allclose(line.von_mises[inside], 12.0 * r[inside], rtol=0.02)
    np.testing.assert_allclose(line.margin[inside], 0.25 / r[inside] - 1, atol=0.08)
    lines = line.plot("stress").axes[0].lines
    assert len(lines) == 6
    np.testing.assert_allclose(lines[3].get_ydata(), line.stress[:, 3])
    solved.plot(scalars="margin", scale=0.0, view="top", occlusion=False, size=(260, 200),
                screenshot=tmp_path / "a.png")  # fmt: skip
    p = np.asarray(Image.open(tmp_path / "a.png"))[..., :3].astype(int)[:, :215]
    red, blue = p[..., 0] > p[..., 2] + 40, p[..., 2] > p[..., 0] + 40
    there = p.sum(axis=2) < 740
    assert red.sum() > 0.5 * there.sum()  # outside of half the radius
    assert blue.sum() > 0.08 * there.sum()


@pytest.mark.parametrize(
    ("act", "error", "match"),
    [
        (lambda p: p.load(force=(1, 0, 0), at=(9, 0, 0)), GeometryError, "surface is 4.97 away"),
        (lambda p: p.load(force=(1, 0, 0), at=(9, 0)), InputError, "at must be a point"),
        (lambda p: p.load(moment=(1, 0, 0), at=(1, 0.5, 0.5)), InputError, "at is the point of"),
        (lambda p: p.load(force=(1, 0, 0), at=(1, 0.5, 0.5), on="x > 4"), InputError, "neither on"),
        (lambda p: p.load(force=(1, 0, 0),
                          on=il.fields.translate(il.fields.sphere(0.2), (9, 9, 9))),
         GeometryError, "no surface there; the nearest is .* away"),
        (lambda p: p.load(force=(1, 0, 0), on=il.SurfaceMesh([[9, 0, 0], [9, 1, 0], [9, 0, 1]],
                                                             [[0, 1, 2]])),
         GeometryError, "no surface there; the nearest is 4.97 away"),
        (lambda p: p.clamp("x > 4", about=(0, 0, 0)), InputError, "rotation"),
        (lambda p: p.clamp("x > 4", rotation=1.0), InputError, "rotation must be a vector"),
        (lambda p: p.clamp("x > 4", rotation=(0, 0, 1), value=lambda x: x), InputError,
         "value is a"),
        (lambda p: p.rigid("x > 4", force=1.0), InputError, "force must be a vector"),
        (lambda p: p.rigid("x > 4", about="here"), InputError, "about"),
        (lambda p: p.rigid("x > 9"), GeometryError, "no surface there"),
        (lambda p: il.cutfem.Elasticity(p.domain).rigid("x > 4", force=(1, 0, 0)).solve(),
         InputError, "free to move"),
    ],
)  # fmt: skip
def test_what_makes_no_sense_is_refused(bar, act, error, match):
    with pytest.raises(error, match=match):
        act(bar)


def test_reports_tell_of_motions(rod, tmp_path):
    solved = rod.rigid("w=1", moment=(0, 0, 1e-3)).solve()
    solved.report(tmp_path / "a.html", pictures=False)
    text = (tmp_path / "a.html").read_text(encoding="utf-8")
    assert "rigid at w=1" in text
    assert "and a turn by" in text
    assert isinstance(solved.motions[0], Motion)
