"""Surfaces in the octant and cells of them, against exact surfaces and identities."""

import sys
import warnings
from pathlib import Path

import numpy as np
import pytest
import trimesh
from scipy.interpolate import CubicSpline

import ilattice as il
from ilattice.errors import ConvergenceError, GeometryError, InputError, PrecisionWarning
from ilattice.minimal.disc import opposite_edges
from ilattice.shells.boundary import Boundary
from ilattice.shells.octant import boundary_loops, coloured, evened, harmonic, zero_set

sys.path.insert(0, str(Path(__file__).parents[1]))
import exact_schwarz


class ExactP(Boundary):
    """The boundary of Schwarz P in the octant, from conjugation, which is exact to 1e-5."""

    def points(self, count=65):
        patch = PATCH
        out = []
        for s in self.topology.segments:
            row = patch.disc.side_rows[SIDES.index("xyz"[s.face // 2] + "-+"[s.face % 2])]
            line = 4.0 * patch.vertices[row] - 1.0
            steps = np.linalg.norm(np.diff(line, axis=0), axis=1)
            at = np.concatenate([[0.0], np.cumsum(steps)]) / steps.sum()
            line = CubicSpline(at, line)(np.linspace(0.0, 1.0, count))
            node = self.nodes[self.topology.nodes.index(s.edges[0])]
            out.append(line if np.linalg.norm(line[0] - node) < 0.5 else line[::-1])
        return np.array(out)


SIDES = ["x+", "z-", "y+", "x-", "z+", "y-"]
PATCH = il.minimal.conjugate(il.minimal.cuboid().faces(" ".join(SIDES)), n=32)


def schwarz_p():
    t = il.shells.topology("topo_19")
    return ExactP(t, np.zeros(6), np.ones((6, 2)))


def test_over_the_curves_of_schwarz_p_there_is_schwarz_p_and_the_layer_does_nothing():
    curves = schwarz_p()
    free = il.shells.surface(curves, n=26, layer=0.0)
    smooth = il.shells.surface(curves, n=26)
    assert 1400 < len(free.vertices) < 1600
    for s in (free, smooth):
        assert exact_schwarz.distances(s.vertices - 0.5).max() < 1e-3
        assert abs(s.area - 2.34511) < 2e-3 * 2.34511
        assert s.curvature_quantile() < 0.05
    own = smooth.vertices[: len(free.vertices)]  # those along the boundary come after them
    assert np.abs(free.vertices - own).max() < 2e-3
    assert smooth.curvature_quantile(0.99) < 0.5  # of curvatures up to 7


def test_harmonic_functions_are_solutions_and_maxima_are_on_the_boundary():
    for name in ("topo_1", "c13"):
        curves = il.shells.boundary(name, 0.05, 1.1)
        u, faces = harmonic(curves, 16), coloured(curves, 16)
        inner = u[1:-1, 1:-1, 1:-1]
        star = sum(np.roll(u, k, a)[1:-1, 1:-1, 1:-1] for a in range(3) for k in (-1, 1))
        assert np.abs(star - 6.0 * inner).max() < 1e-12
        u[1:-1, 1:-1, 1:-1] = 0.0
        assert (u == faces).all()
        corners = faces[::16, ::16, ::16]
        assert (np.sign(corners) == curves.topology.colours).all()


def test_the_annulus_is_kept_and_the_least_surface_collapses():
    curves = il.shells.boundary("topo_18", 0.45, 3.0)
    shell = il.shells.surface(curves, n=20)
    assert shell.mesh.euler == 0
    assert shell.completed().genus == 7  # Euler number -12, as Schoen's I-WP
    with pytest.raises(GeometryError, match=r"collapses: it has 2 pieces .* has 1 .*harmonic"):
        il.shells.surface(curves, n=20, method="currents")


def test_least_gradient_finds_the_same_surface_where_there_is_one():
    curves = il.shells.boundary("topo_19", 0.1, 1.5)
    a, b = (il.shells.surface(curves, n=12, method=m) for m in ("harmonic", "currents"))
    assert a.area == pytest.approx(b.area, rel=1e-3)


@pytest.mark.parametrize(
    ("name", "position", "derivative"),
    [
        ("topo_19", 0.1, 1.5),
        ("topo_19", (0.1, 0.3, -0.2, 0.05, -0.1, 0.25), 1.37),
        ("topo_18", 0.6, 3.0),
        ("topo_1", (0.2, 0.2, 0.0), 1.5),
        ("topo_19", -0.31, 1.8),
    ],
)
def test_layers_make_surfaces_meet_mirrors_at_right_angles(name, position, derivative):
    curves = il.shells.boundary(name, position, derivative)
    free, smooth = il.shells.surface(curves, layer=0.0), il.shells.surface(curves)
    assert smooth.slope < free.slope / 5.0
    assert free.area < smooth.area < 1.02 * free.area
    assert smooth.residual < 1e-6
    assert smooth.curvature_quantile() < 0.05


@pytest.mark.parametrize(
    ("name", "position", "derivative"),
    [
        ("topo_18", 0.8, 3.9),
        ("topo_18", 0.46, 2.1),
        ("topo_18", 0.75, 2.26),
        ("topo_1", (0.21, -0.35, -0.1), 1.52),
        ("topo_1", (-0.19, 0.13, 0.18), 1.29),
    ],
)
def test_half_of_the_area_is_of_a_minimal_surface_where_creases_are_strong(
    name, position, derivative
):
    curves = il.shells.boundary(name, position, derivative)
    s, thick = il.shells.surface(curves), il.shells.surface(curves, layer=0.02)
    assert s.layer < 0.01
    assert s.curvature_quantile() < 0.05 < thick.curvature_quantile()
    free = il.shells.surface(curves, layer=0.0)
    assert s.slope < free.slope / 5.0
    assert free.area < s.area < thick.area


def test_a_shell_that_tears_before_it_is_minimal_is_told():
    curves = il.shells.boundary("topo_1", (-0.45, 0.45, 0.45), 1.5)
    with pytest.warns(PrecisionWarning, match="on half of its area.*necks are too long"):
        s = il.shells.surface(curves, n=16)
    assert s.residual < 1e-6


def test_evening_keeps_vertices_on_their_surface():
    rng = np.random.default_rng(8)
    sphere = trimesh.creation.icosphere(subdivisions=4)
    v = sphere.vertices + 0.01 * rng.standard_normal(sphere.vertices.shape)
    v /= np.linalg.norm(v, axis=1)[:, None]
    fixed = v[:, 2] < -0.5
    even = evened(v, sphere.faces, fixed, 20)
    assert (even[fixed] == v[fixed]).all()
    assert np.abs(np.linalg.norm(even, axis=1) - 1.0).max() < 2e-3
    moved = ~fixed[sphere.faces].any(axis=1)
    worst = [il.SurfaceMesh(x, sphere.faces[moved]).quality.min() for x in (v, even)]
    assert worst[1] > worst[0] + 0.2


def test_triangles_get_smaller_towards_the_boundary_and_keep_it():
    for name, symmetry in (("topo_18", "rrr"), ("topo_1", "ttt")):
        curves = il.shells.boundary(name, 0.6 if name == "topo_18" else 0.0, 1.3)
        s = il.shells.surface(curves, symmetry, n=12)
        assert boundary_loops(s.faces) == len(curves.topology.loops)
        cube, rim = 4.0 * s.vertices - 3.0, s.on.any(axis=1)
        lines = curves.points(2001)
        for row in np.flatnonzero(rim)[::7]:
            assert np.linalg.norm(lines - cube[row], axis=-1).min() < 1e-3
        assert (cube[s.on != 0] == s.on[s.on != 0]).all()
        e = np.linalg.norm(opposite_edges(s.vertices, s.faces), axis=2)
        at = rim[s.faces].any(axis=1)
        assert np.median(e[at]) < 0.006  # of a layer of 0.01
        assert e.max() > 8.0 * np.median(e[at])
        half = il.shells.surface(curves, symmetry, n=12, layer=0.0)
        assert s.mesh.euler == half.mesh.euler


def test_mean_curvatures_die_out_like_the_layer():
    curves = il.shells.boundary("topo_18", 0.6, 3.0)
    s = il.shells.surface(curves, n=24, layer=0.03)
    depth = np.abs(s.vertices - np.where(s.vertices > 0.75, 1.0, 0.5)).min(axis=1)
    inner = np.flatnonzero((depth > 0.02) & (depth < 0.1))
    rate = np.polyfit(depth[inner], np.log(s.mean_curvature[inner] + 1e-12), 1)[0]
    assert -1.6 / 0.03 < rate < -0.3 / 0.03  # faces are not the boundary: a rate within factors


@pytest.mark.parametrize(
    ("name", "genus"), [("topo_19_rrr", 3), ("topo_1_rrr", 9), ("topo_1_ttt", 9), ("topo_1_rtr", 9)]
)
def test_cells_are_closed_and_have_the_genus_of_what_they_are_like(name, genus):
    s = il.shells.surface(il.shells.boundary(name, 0.0, 1.2), name[-3:], n=16)
    whole = s.completed()
    assert whole.is_closed
    assert whole.is_orientable
    assert whole.separates
    assert whole.genus == genus
    assert whole.area == pytest.approx(s.area, rel=1e-9)


def test_translations_need_faces_that_fit():
    with pytest.raises(GeometryError, match=r"t along x: .* coloured differently"):
        il.shells.cell("topo_19_trr")
    with pytest.raises(GeometryError, match=r"t along y: .* other positions or derivatives"):
        il.shells.cell("topo_1_rtr", position=0.1)


def test_bubbles_are_told():
    with pytest.raises(GeometryError, match=r"3 of 3 pieces .* are bubbles"):
        il.shells.cell("topo_14_rrr", n=12)
    assert il.shells.cell("topo_14_rrr", n=12, bubbles=True).surface.bubbles == 3


@pytest.mark.parametrize(
    "bad",
    [{"n": 3}, {"n": 2.5}, {"method": "neural"}, {"layer": -1.0}, {"spans": 7}, {"bubbles": 2}],
)
def test_bad_options(bad):
    with pytest.raises(InputError, match=next(iter(bad))):
        il.shells.cell("topo_19_rrr", **bad)


def test_loops_too_fine_for_the_grid_are_refused():
    with pytest.raises(ConvergenceError, match=r"with 8 cells per edge .* larger n"):
        il.shells.cell("topo_1_rrr", derivative=3.9, n=8)  # the arcs touch at 4


@pytest.fixture(scope="module")
def shells():
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        found = [
            il.shells.cell(name, position=p, derivative=d, n=20)
            for name, p, d in (
                ("topo_19_rrr", 0.1, 1.5),
                ("topo_18_rrr", 0.6, 3.0),
                ("topo_1_rtt", 0.0, 1.2),
            )
        ]
        for shell in found:
            assert shell.tile_error < 1e-3
    return found


def test_tiles_have_the_symmetry_of_the_cell(shells):
    u = np.random.default_rng(1).random((500, 3))
    for shell in shells:
        for axis, kind in enumerate(shell.surface.symmetry):
            other = u.copy()
            other[:, axis] = 1.0 - u[:, axis] if kind == "r" else (u[:, axis] + 0.5) % 1.0
            sign = shell.surface.signs[axis]
            assert np.abs(shell.tile(u) - sign * shell.tile(other)).max() < 1e-14


def test_tiles_are_smooth_across_faces(shells):
    u = np.random.default_rng(2).random((500, 3))
    for shell in shells:
        for axis in range(3):
            ends = []
            for face in (0.0, 1.0, 0.5 - 1e-15, 0.5):
                u[:, axis] = face
                ends.append(np.column_stack(shell.tile.jet(u, order=1)))
            assert np.abs(ends[0] - ends[1]).max() < 1e-6  # gradients are about 1
            assert np.abs(ends[2] - ends[3]).max() < 1e-6
            if shell.surface.symmetry[axis] == "r":
                assert np.abs(ends[0][:, 1 + axis]).max() < 1e-12


def test_tiles_are_signed_distances_with_the_sides_of_the_colours(shells):
    for shell in shells:
        v, n = shell.periodic.mesh.vertices, shell.surface.completed().mesh
        rows = np.random.default_rng(3).integers(0, len(v), 400)
        value, gradient = shell.tile.jet(np.mod(v[rows], 1.0), order=1)
        assert np.abs(value).max() < 1e-3
        assert np.abs(np.linalg.norm(gradient, axis=1) - 1.0).max() < 0.1
        corners = 0.5 + 0.5 * np.indices((2, 2, 2)).reshape(3, -1).T
        inside = np.clip(corners, 0.51, 0.99)
        assert (np.sign(shell.tile(inside)) == shell.topology.colours.ravel()).all()
        assert n.is_oriented


def test_relative_densities_are_met(shells):
    for shell in shells:
        wall = il.Lattice(shell.tile, through=il.macroshape.cell(), repeat=1).offset(
            relative_density=0.3
        )
        rule = il.cutfem.quadrature(wall)
        assert float(rule.integrate(lambda x: np.ones(len(x)))) == pytest.approx(0.3, abs=1e-3)


def test_topologies_of_the_paper_repeat():
    shell = il.shells.cell("topo_6_ttt", derivative=1.2, n=12)
    assert shell.periodic.is_closed
    assert shell.surface.signs == (1, -1, -1)


def test_surfaces_along_a_mirror_are_completed_without_loss():
    """Next to a mirror a surface and its image come closer than vertices are apart."""
    positions = [0.48, 0.21, -0.08, 0.11, 0.12, -0.0, 0.24, -0.47]
    derivatives = [2.99, 2.33, 1.73, 2.01, 0.76, 1.79, 2.51, 1.23]
    curves = il.shells.boundary("c12", positions, derivatives)
    octant = il.shells.surface(curves, "rrr", n=12, layer=0.0)
    inside = ~octant.on.any(axis=1)
    assert octant.vertices[inside, 1].min() < 0.5 + 1e-3  # it does run along y = 1/2
    whole = octant.completed()
    assert whole.is_closed
    assert whole.is_orientable
    assert len(whole.faces) == 8 * len(octant.faces)
    assert whole.area == pytest.approx(octant.area, rel=1e-12)


def test_quantiles_and_layers_out_of_range_are_told():
    curves = il.shells.boundary("topo_19", 0.1, 1.5)
    octant = il.shells.surface(curves, n=8, layer=0.05)
    assert octant.curvature_quantile(1) == octant.mean_curvature.max()
    for wrong in (-0.1, 1.1, np.nan, "a", None):
        with pytest.raises(InputError, match="q must be"):
            octant.curvature_quantile(wrong)
    for wrong in (-0.1, 1.5, 1e9):
        with pytest.raises(InputError, match="layer must be"):
            il.shells.surface(curves, n=8, layer=wrong)
    with pytest.raises(InputError, match="spans must be even"):
        il.shells.cell("topo_19_rrr", n=8, layer=0.05, spans=11)
    with pytest.raises(InputError, match="spans must be even"):
        il.shells.family("topo_1_rrr", outer=(0.2, 1.5), spans=35)


def test_triangles_agree_on_faces_that_are_one():
    """Whatever is between them: the harmonic function inside is not the same next to both."""
    rng = np.random.default_rng(5)
    for name, n in (("topo_3", 8), ("c3", 8), ("topo_1", 12)):
        axis = 0 if name == "c3" else 1
        found = il.shells.boundary(name).nodes
        found = np.where(np.abs(found) < 1.0, 0.0, found)
        turn = np.where(found.sum(axis=1) == 2.0, -1.0, 1.0)
        low = np.where(np.arange(3) == axis, -np.abs(found), found)
        low = np.unique(low, axis=0, return_inverse=True)[1].ravel()
        for _ in range(40):
            free = rng.uniform(-0.4, 0.4, len(found)), rng.uniform(0.6, 1.6, (len(found), 2))
            curves = il.shells.boundary(name, turn * free[0][low], free[1][low])
            assert curves.congruent(axis)
            glued = tuple(a == axis for a in range(3))
            t = zero_set(harmonic(curves, 48), curves, n, glued)
            ends = [t.vertices[t.on[:, axis] == side] for side in (-1, 1)]
            flat = [np.delete(v, axis, axis=1) for v in ends]
            np.testing.assert_array_equal(*(v[np.lexsort(v.T)] for v in flat))
