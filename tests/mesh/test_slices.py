"""Slices against exact cross-sections, the inverse of the map, a mesh, and their own identities."""

import tracemalloc
from collections import Counter
from functools import cache
from itertools import combinations, pairwise

import numba
import numpy as np
import pytest
import shapely

import ilattice as il
from ilattice.errors import GeometryError, InputError, PrecisionWarning
from ilattice.slicing import _kernels_slices as kernels
from ilattice.slicing._loops import _between, crossing
from ilattice.slicing._section import edges_of, halved
from ilattice.slicing._slicer import extent
from ilattice.tiles.trig import TrigField

PLANES = TrigField([1.0], [[1, 0, 0]])  # cos(2 pi x): planes at 1/4 and 3/4


@cache
def wall(name):
    box, shapes = il.macroshape.box, il.macroshape
    lattice, d = {
        "box": (il.Lattice("schwarz_p", through=box()), 0.1),
        "flipped": (il.Lattice("gyroid", through=box((1, 2, 1)).flipped(), repeat=(1, 2, 1)), 0.08),
        "torus": (il.Lattice("gyroid", through=shapes.torus(2, 1.5), repeat=(5, 1, 1)), 0.12),
        "tapered": (
            il.Lattice("diamond", through=shapes.tapered(), repeat=(1, 1, 1)),
            lambda u: 0.05 + 0.02 * u[:, 0],
        ),
        "shell": (
            il.Lattice("schwarz_p", through=shapes.cylinder_shell(), repeat=(8, 1, 1)),
            (0.0, 0.1),
        ),
        "duck": (il.Lattice("gyroid", through=shapes.duck(), repeat=(4, 2, 2)), 0.06),
    }[name]
    return lattice.offset(d)


WALLS = ("box", "flipped", "torus", "tapered", "shell", "duck")


def heights(w, count):
    low, high = extent(il.bspline.BSpline(*parts(w)))
    return low + (high - low) * (np.arange(count) + 0.5) / count


def parts(w):
    s = w.lattice.through.geometry
    return s.t, s.c[..., 2], s.k


def inside(points, loops):
    """Naive: even number of crossings of a ray to the right, for all contours at once."""
    odd = np.zeros(len(points), bool)
    for a in loops:
        b = np.roll(a, -1, axis=0)
        edge, at = np.nonzero((a[:, 1:] > points[:, 1]) != (b[:, 1:] > points[:, 1]))
        part = (points[at, 1] - a[edge, 1]) / (b[edge, 1] - a[edge, 1])
        crossed = points[at, 0] < a[edge, 0] + part * (b[edge, 0] - a[edge, 0])
        odd ^= np.bincount(at[crossed], minlength=len(points)) % 2 == 1
    return odd


def near(points, loops, reach):
    ends = np.concatenate([p for loop in loops for p in (loop, 0.5 * (loop + np.roll(loop, 1, 0)))])
    return np.array([np.hypot(*(ends - p).T).min() < reach for p in points])


def shoelace(p):
    x, y = p.T
    return 0.5 * float(x @ np.roll(y, -1) - y @ np.roll(x, -1))


# --- exact cross-sections ---


def test_slabs_are_cut_into_rectangles_with_exact_corners():
    lattice = il.Lattice(il.Tile(PLANES), through=il.macroshape.box((2.0, 1.0, 1.0)))
    section = lattice.offset(0.1).slices([0.37], h=0.1)[0]
    assert len(section.polygons) == 2
    assert section.holes == 0
    assert section.area == pytest.approx(0.4, abs=1e-9)
    assert section.perimeter == pytest.approx(2 * 2.4, abs=1e-9)
    for outer, _ in section.polygons:
        middle = 0.5 if outer[:, 0].mean() < 1 else 1.5
        for corner in ([middle - 0.1, 0], [middle + 0.1, 0], [middle - 0.1, 1], [middle + 0.1, 1]):
            assert np.abs(outer - corner).max(axis=1).min() < 1e-9


def test_cylinders_are_cut_into_rings():
    """The tile's planes become circles of radius 0.35 and 0.65; areas are short by the chords."""
    through = il.macroshape.cylinder_shell(0.2, 0.8, 0.6)
    radial = next(a for a in range(3) if np.ptp(np.hypot(*radii(through, a).T)) > 0.5)
    factor = np.zeros((1, 3), np.int64)
    factor[0, radial] = 1
    w = il.Lattice(il.Tile(TrigField([1.0], factor)), through=through).offset(0.05)
    error = []
    for h in (0.05, 0.025, 0.0125):
        section = w.slices([0.2], h=h)[0]
        assert len(section.polygons) == section.holes == 2
        for outer, (hole,) in section.polygons:
            r = 0.4 if np.hypot(*outer[0]) < 0.5 else 0.7
            assert np.abs(np.hypot(*outer.T) - r).max() < 1e-6
            assert np.abs(np.hypot(*hole.T) - r + 0.1).max() < 1e-6
        error.append(abs(section.area / (np.pi * (0.4**2 - 0.3**2 + 0.7**2 - 0.6**2)) - 1))
    assert max(error) < 6e-5  # however wide the grid: bent contours get points in between


def radii(through, axis):
    u = np.full((9, 3), 0.37)
    u[:, axis] = np.linspace(*through.domain[:, axis], 9)
    return through.x(u)[:, :2]


# --- the inverse of the map as a reference ---


@pytest.mark.parametrize("name", WALLS)
def test_points_are_inside_where_the_field_at_their_parameters_is_negative(name):
    w = wall(name)
    rng = np.random.default_rng(3)
    h = 0.35 * w.thickness.extremes[0]
    checked = 0
    for z in heights(w, 3):
        section = w.slices([z], h=h, polish=False)[0]
        lo, hi = w.lattice.through.bounds[:, :2]
        p = lo + (hi - lo) * rng.random((500, 2))
        u = w.lattice.through.inverse(np.column_stack([p, np.full(len(p), z)]))
        there = np.isfinite(u[:, 0])
        expected = np.zeros(len(p), bool)
        expected[there] = w.field(u[there]) < 0
        wrong = inside(p, section.loops) != expected
        assert not wrong[~near(p, section.loops, 0.5 * h)].any()
        checked += expected.sum()
    assert checked > 30


@pytest.mark.parametrize("name", WALLS)
def test_points_of_contours_lie_on_the_wall_or_on_a_face_and_in_the_plane(name):
    w = wall(name)
    z = heights(w, 3)[1]
    section = w.slices([z], h=0.35 * w.thickness.extremes[0], polish=False)[0]
    points = np.concatenate(section.loops)
    u = w.lattice.through.inverse(section.to_space(points), tol=1e-6)
    assert np.isfinite(u).all()
    lo, hi = w.lattice.domain
    ends = np.minimum(u - lo, hi - u) / (hi - lo)
    ends[:, np.array(w.lattice.through.closed)] = 1.0
    off = np.minimum(np.abs(w.field(u)), ends.min(axis=1))
    assert np.quantile(off, 0.98) < 1e-6
    assert off.max() < 0.1 * w.thickness.extremes[0]


def test_polished_contours_keep_the_exact_distance():
    w = wall("box")
    section = w.slices([0.3], h=0.05)[0]
    u = section.to_space(np.concatenate(section.loops))
    free = (np.minimum(u, 1 - u)[:, :2] > 1e-9).all(axis=1)
    error = np.abs(np.abs(w.lattice.distance(u[free])) - 0.1)
    assert free.sum() > 50
    assert np.quantile(error, 0.95) < 1e-6
    rough = w.slices([0.3], h=0.05, polish=False)[0]
    u = rough.to_space(np.concatenate(rough.loops))
    assert np.abs(np.abs(w.lattice.distance(u[:, :])) - 0.1).mean() > 1e-6


@pytest.mark.parametrize(("name", "d"), [("gyroid", 0.15), ("diamond", 0.1)])
def test_polished_contours_hold_the_area_of_exact_distances(name, d):
    """Thick walls, whose distance spline is off by more than that: so are unpolished ones."""
    lattice = il.Lattice(name, through=il.macroshape.box())
    z, w = 0.4806, lattice.offset(d)

    def field(p):
        return np.abs(lattice.distance(np.column_stack([p, np.full(len(p), z)]))) - d

    exact = area_by_lines(field, lines=250, samples=120)
    polished, rough = (w.slices([z], polish=p)[0].area for p in (True, False))
    assert polished == pytest.approx(exact, rel=3e-4)
    assert abs(rough / exact - 1) > 1e-3


def test_first_order_walls_are_not_moved_onto_the_exact_offset():
    w = wall("box").lattice.offset(0.1, space="parametric")
    exact, rough = (w.slices([0.3], h=0.05, polish=p)[0].area for p in (True, False))
    assert exact == rough
    assert abs(rough / wall("box").slices([0.3], h=0.05)[0].area - 1) > 1e-4


# --- identities ---


@pytest.mark.parametrize("name", WALLS)
def test_contours_are_oriented_and_nested(name):
    w = wall(name)
    holes = 0
    for section in w.slices(heights(w, 4), h=0.4 * w.thickness.extremes[0], polish=False):
        holes += section.holes
        for outer, inner in section.polygons:
            assert shoelace(outer) > 0
            for hole in inner:
                assert shoelace(hole) < 0
                assert inside(hole, [outer]).mean() > 0.99
        assert section.area == pytest.approx(sum(map(shoelace, section.loops)), rel=1e-9)
        steps = [np.hypot(*(p - np.roll(p, 1, axis=0)).T) for p in section.loops]
        assert all(s.min() > 0 for s in steps)
    assert (holes > 0) == (name != "flipped")  # which is cut where pores are open


@pytest.mark.parametrize("name", ["box", "torus"])
def test_sections_are_those_of_the_mesh(name):
    w = wall(name)
    h = (0.1 if name == "box" else 0.25) * w.thickness.extremes[0]
    z = heights(w, 5)[1]
    section = w.slices([z], h=h)[0]
    cut = w.mesh(h=h).to_trimesh().section([0, 0, 1], [0, 0, z]).to_2D()[0]
    assert len(section.polygons) == len(cut.polygons_full)
    assert section.holes == sum(len(p.interiors) for p in cut.polygons_full)
    assert section.area == pytest.approx(cut.area, rel=1e-2)


def test_volume_converges_with_the_layers():
    w = wall("box")
    layers = (4, 16, 96)
    v = [w.slices(thickness=1 / n, h=0.08, polish=False).volume() for n in layers]
    coarse, finer = (abs(x / v[-1] - 1) for x in v[:2])
    assert finer < 6e-3
    assert coarse > 4 * finer


def test_volume_is_that_of_the_mesh():
    w = wall("box")
    exact = (4 * w.mesh(0.02).volume - w.mesh(0.04).volume) / 3
    assert w.slices(thickness=0.02, h=0.03).volume() == pytest.approx(exact, rel=1e-3)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["tapered", "flipped"])
def test_four_hundred_slices_hold_the_volume(name):
    """That of the same spline wall, by a rule of degree 5 on its cut cells."""
    w = wall(name)
    exact = il.cutfem.quadrature(w, q=3).integrate()
    low, high = extent(il.bspline.BSpline(*parts(w)))
    v = w.slices(thickness=(high - low) / 400, polish=False).volume()
    assert v == pytest.approx(exact, rel=5e-4)


@pytest.mark.parametrize("z", [0.13, 0.3, 0.47])
def test_chords_cut_off_little_of_bent_contours(z):
    """Against lines whose crossings are bisected, at the default h and at a quarter of it."""
    w = wall("box")
    exact = area_by_lines(lambda p: w.field(np.column_stack([p, np.full(len(p), z)])))
    error = [abs(w.slices([z], h=h, polish=False)[0].area / exact - 1) for h in (0.05, 0.0125)]
    assert error[0] < 3e-4
    assert error[1] < 1e-4


@pytest.mark.parametrize("z", [0.22, 0.4806, 0.72, 0.97])
def test_contours_that_turn_back_within_a_cell_keep_their_area(z):
    """A thick gyroid: chords across blunt ends of its pores, with half a circle beside them."""
    w = il.Lattice("gyroid", through=il.macroshape.box()).offset(0.17)
    exact = area_by_lines(lambda p: w.field(np.column_stack([p, np.full(len(p), z)])), lines=2000)
    assert w.slices([z], polish=False)[0].area == pytest.approx(exact, rel=1e-4)


def test_small_tiles_get_as_many_points_as_large_ones():
    """A cross in tiles of 0.07 to 0.43: arms are a few cells thick, the smallest less than h."""
    c = np.stack(np.meshgrid([0.0, 0.05, 1.0], [0.0, 1.0], [0.0, 1.0], indexing="ij"), axis=-1)
    through = il.SplineMap(
        il.BSpline([[0, 0, 0, 1, 1, 1], [0, 0, 1, 1], [0, 0, 1, 1]], c, (2, 1, 1))
    )
    lattice = il.Lattice("cross", through=through, repeat=(4, 4, 4))
    w = lattice.offset((np.inf, 0.0), space="parametric")

    def field(p):
        u = (np.sqrt(0.01 + 3.6 * p[:, 0]) - 0.1) / 1.8
        return w.field(np.column_stack([u, p[:, 1], np.full(len(p), 0.46)]))

    area = w.slices([0.46])[0].area
    assert area == pytest.approx(area_by_lines(field, lines=4000), rel=5e-4)


def two_cylinders(gap):
    """A solid of two cylinders along z in the unit cube, whose centres are 0.5 apart."""

    def field(u):
        away = np.abs(u[:, 0] - 0.5) - 0.25
        return np.hypot(away, u[:, 1] - 0.5) - 0.25 + 0.5 * gap

    spline = il.bspline.fit.fit(field, degree=3, spans=64, method="interpolate")
    lattice = il.Lattice(il.Tile(spline, name="two"), through=il.macroshape.box())
    return lattice.offset((np.inf, 0.0), space="parametric")


@pytest.mark.parametrize("gap", [0.03, 0.012])
def test_gaps_finer_than_the_grid_are_seen(gap):
    """At the default h of 0.0625, and at twice that: where cylinders almost touch."""
    w = two_cylinders(gap)
    for h in (0.0625, 0.125):
        section = w.slices([0.52], h=h)[0]
        exact = area_by_lines(lambda p: w.field(np.column_stack([p, np.full(len(p), 0.52)])))
        assert len(section.polygons) == 2
        assert section.area == pytest.approx(exact, rel=3e-4)
        assert section.unresolved_area == 0.0


def test_gaps_that_are_too_fine_are_counted_and_warned_of():
    """A slot of width 0.002 that widens, at h = 0.15."""

    def field(u):
        return 1e-6 + 0.02 * u[:, 1] ** 8 - (u[:, 0] - 0.53) ** 2

    spline = il.bspline.fit.fit(field, degree=8, spans=1, method="interpolate")
    lattice = il.Lattice(il.Tile(spline, name="slot"), through=il.macroshape.box())
    w = lattice.offset((np.inf, 0.0), space="parametric")
    with pytest.warns(PrecisionWarning, match=r"Slice\.unresolved_area"):
        section = w.slices([0.52], h=0.15)[0]
    assert 0.005 * section.area < section.unresolved_area < 0.05
    assert len(w.slices([0.52], h=0.01)[0].polygons) == 2


CREASED = {
    "gyroid": lambda: il.Lattice("gyroid", through=il.macroshape.box()).offset(0.2),
    "octet": lambda: il.Lattice("octet", through=il.macroshape.box()).offset((np.inf, 0.02)),
    "arms": lambda: il.Lattice(
        il.tiles["ten_arms"], through=il.macroshape.box()
    ).offset((np.inf, 0.05), space="parametric"),
    "torus": lambda: il.Lattice(
        "gyroid", through=il.macroshape.torus(2, 1.5), repeat=(8, 1, 1)
    ).offset(0.15),
}  # fmt: skip


@pytest.mark.parametrize("name", CREASED)
@pytest.mark.parametrize("polish", [True, False])
def test_contours_of_creased_walls_are_simple(name, polish):
    """By an independent library: none crosses itself or another one, and holes lie within."""
    w = CREASED[name]()
    sections = list(w.slices(heights(w, 7), polish=polish))
    polygons = [shapely.Polygon(outer, holes) for s in sections for outer, holes in s.polygons]
    assert len(polygons) > 6
    assert all(p.is_valid for p in polygons)
    for s in sections:
        parts = shapely.union_all([shapely.Polygon(*p) for p in s.polygons])
        assert parts.area == pytest.approx(s.area, rel=1e-9)  # they do not overlap


def area_by_lines(f, lines=1000, samples=200):
    """Area of the unit square where f < 0."""
    y, x = (np.arange(lines) + 0.5) / lines, np.linspace(0.0, 1.0, samples + 1)
    grid = np.stack(np.meshgrid(x, y, indexing="ij"), axis=-1).reshape(-1, 2)
    within = f(grid).reshape(samples + 1, lines) < 0
    i, j = np.nonzero(within[:-1] != within[1:])
    first, a, b = within[i, j], x[i].copy(), x[i + 1].copy()
    for _ in range(20):
        middle = 0.5 * (a + b)
        same = (f(np.column_stack([middle, y[j]])) < 0) == first
        a, b = np.where(same, middle, a), np.where(same, b, middle)
    part = np.where(first, a - x[i], x[i + 1] - a).sum()
    return ((within[:-1] & within[1:]).sum() / samples + part) / lines


def test_slices_along_another_normal_are_those_of_the_turned_part():
    w = wall("box")
    up, across = w.slices([0.3], h=0.05)[0], w.slices([0.3], h=0.05, normal=(1, 0, 0))[0]
    assert across.area == pytest.approx(up.area, rel=2e-3)  # the tile is symmetric
    x = across.to_space(np.concatenate(across.loops))
    assert np.abs(x[:, 0] - 0.3).max() < 1e-9
    assert np.linalg.det(across.frame) == pytest.approx(1.0)
    slanted = w.slices(thickness=0.1, h=0.05, normal=(1, 1, 1))
    assert slanted.volume() == pytest.approx(w.slices(thickness=0.1, h=0.05).volume(), rel=2e-2)
    assert slanted.tops[-1] == pytest.approx(np.sqrt(3), abs=1e-6)


def test_there_are_slices_at_both_ends_and_none_beyond():
    w = wall("box")
    stack = w.slices([-0.1, 0.0, 1e-5, 1.0 - 1e-5, 1.0, 1.0 + 1e-5], h=0.08, polish=False)
    areas = [s.area for s in stack]
    assert areas[0] == areas[5] == 0.0
    np.testing.assert_allclose(areas[1:5], areas[1], rtol=1e-4)
    assert areas[1] > 0.1
    assert len(stack[0].loops) == len(stack[5].loops) == 0


def test_planes_of_the_grid_are_cut_like_their_neighbours():
    """Heights that are those of grid vertices leave no gap and no spike."""
    w = wall("box")
    at = w.slices([0.25, 0.5], h=0.08, polish=False)
    beside = w.slices([0.25 + 1e-7, 0.5 + 1e-7], h=0.08, polish=False)
    for a, b in zip(at, beside, strict=True):
        assert a.area == pytest.approx(b.area, rel=1e-4)
        assert a.perimeter == pytest.approx(b.perimeter, rel=1e-3)


def test_layers_touch_and_cover_the_part():
    stack = wall("torus").slices(thickness=0.2, h=0.1, polish=False)
    assert stack.bottom == pytest.approx(-0.75, abs=1e-6)
    assert stack.tops[-1] == pytest.approx(0.75, abs=1e-6)
    np.testing.assert_allclose(np.diff(stack.tops), [0.2] * 6 + [0.1], atol=1e-6)
    np.testing.assert_allclose(stack.heights, stack.tops - np.array([0.1] * 7 + [0.05]), atol=1e-6)
    section = stack[-3]
    assert section.bottom == pytest.approx(stack[-4].top)
    assert [s.height for s in stack[1:3]] == [stack.heights[1], stack.heights[2]]


# Midpoints are exact for both: the section of a slab is constant, that of a wedge linear.
LAYERS = [(50.0, [0.5]), (1.5, [0.5]), (1 - 1e-4, [0.5]), (0.7, [0.35, 0.85]), (0.5, [0.25, 0.75])]


def check_layers(stack, cuts, volume):
    np.testing.assert_allclose(stack.heights, cuts, atol=1e-4)
    assert stack.tops[-1] == stack[-1].top == pytest.approx(1.0, abs=1e-9)
    assert stack.bounds[1, 2] == stack.tops[-1]
    assert stack.volume() == pytest.approx(volume, rel=1e-6)


@pytest.mark.parametrize(("thickness", "cuts"), LAYERS)
def test_the_last_layer_of_a_wall_is_what_is_left(thickness, cuts):
    tile = il.Tile(lambda u: u[:, 1] - 0.5, name="slab")
    lattice = il.Lattice(tile, through=il.macroshape.box((2, 1, 1)), repeat=(2, 1, 1))
    stack = lattice.offset(0.1).slices(thickness=thickness, polish=False)
    check_layers(stack, cuts, 0.4)


@pytest.mark.parametrize(("thickness", "cuts"), LAYERS)
def test_the_last_layer_of_a_mesh_is_what_is_left(thickness, cuts):
    wedge = il.SurfaceMesh(*prism([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]]))
    check_layers(wedge.slices(thickness=thickness, normal=(0, 1, 0)), cuts, 0.5)


def test_heights_outside_of_the_part_are_refused():
    wedge = il.SurfaceMesh(*prism([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]]))
    for z in ([-1.0], [1.1, 2.0], [-1.0, 1.5]):
        with pytest.raises(InputError, match=r"within the part, from 0 to 1 along"):
            wedge.slices(z)
    assert [len(s.polygons) for s in wedge.slices([-1.0, 0.5, 2.0])] == [0, 1, 0]
    assert [s.area for s in wedge.slices([0.0, 1.0])] == pytest.approx([0.5, 0.5], rel=1e-5)


def test_memory_does_not_grow_with_the_number_of_slices(tmp_path):
    peak = {}
    for count in (8, 64):
        z = np.linspace(0.3, 0.301, count)  # slices of one size
        stack = wall("box").slices(z, h=0.08, polish=False)
        peak[count] = np.inf
        for _ in range(4):  # the first fills caches; what else is collected varies
            tracemalloc.start()
            stack.save(tmp_path / "a.cli")
            peak[count] = min(peak[count], tracemalloc.get_traced_memory()[1])
            tracemalloc.stop()
    assert peak[64] < 1.05 * peak[8]


@pytest.mark.threads
def test_threads_do_not_change_anything():
    before = numba.get_num_threads()
    loops = []
    try:
        for threads in (1, before):
            numba.set_num_threads(threads)
            loops.append(np.concatenate(wall("torus").slices([0.1], h=0.1)[0].loops))
    finally:
        numba.set_num_threads(before)
    assert np.array_equal(*loops)


# --- combinatorics ---


def noise_sheet(seed, turn=1, wrap=False):
    """Sheet of random heights on a small grid; names of its vertices, triangles, grid size."""
    n = 4
    rng = np.random.default_rng(seed)
    z = rng.normal(size=(n + 1,) * 3)
    planes = np.full(3, n + 1)
    if wrap:
        z[-1], planes[0] = z[0], n
    cells = np.indices((n,) * 3).reshape(3, -1).T.copy()
    corner = np.stack(
        [z[tuple((cells + np.array([c >> 2, c >> 1 & 1, c & 1])).T)] for c in range(8)], axis=1
    )
    edges, ends = np.empty((12 * len(cells), 3), np.int64), np.empty((12 * len(cells), 3, 2))
    count = kernels.section(cells, corner, 0.0, planes, turn, edges, ends)
    assert (np.sign(ends[:count, :, 0]) != np.sign(ends[:count, :, 1])).all()
    names, triangles = np.unique(edges[:count], return_inverse=True)
    return names, triangles.reshape(-1, 3), planes, rng


def rim(names, planes, wrap):
    low = np.stack(np.unravel_index(names // 8, planes), axis=1)
    step = np.stack([names >> 2 & 1, names >> 1 & 1, names & 1], axis=1)
    faces = np.zeros(len(names), np.int64)
    for k in range(1 if wrap else 0, 3):
        faces |= ((step[:, k] == 0) & (low[:, k] == 0)) * (1 << 2 * k)
        faces |= ((step[:, k] == 0) & (low[:, k] == planes[k] - 1)) * (2 << 2 * k)
    return faces


@pytest.mark.parametrize("wrap", [False, True])
@pytest.mark.parametrize("turn", [1, -1])
def test_a_sheet_of_noise_is_an_oriented_surface_that_ends_on_the_faces(wrap, turn):
    names, triangles, planes, _ = noise_sheet(5, turn, wrap)
    assert len(triangles) > 300
    faces = rim(names, planes, wrap)
    directed = Counter((t[i], t[(i + 1) % 3]) for t in triangles.tolist() for i in range(3))
    assert set(directed.values()) == {1}
    for a, b in directed:
        assert ((b, a) in directed) != bool(faces[a] & faces[b])


def test_the_sheet_looks_up():
    """Heights x + y + z: all triangles turn counter-clockwise about (1, 1, 1)."""
    cells = np.zeros((1, 3), np.int64)
    z = np.array([[bin(c).count("1") for c in range(8)]], float)
    edges, ends = np.empty((12, 3), np.int64), np.empty((12, 3, 2))
    for level in (0.4, 1.5, 2.7):
        n = kernels.section(cells, z, level, np.array([2, 2, 2]), 1, edges, ends)
        low = np.stack(np.unravel_index(edges[:n] // 8, (2, 2, 2)), axis=-1).astype(float)
        step = np.stack([edges[:n] >> 2 & 1, edges[:n] >> 1 & 1, edges[:n] & 1], axis=-1)
        t = (level - ends[:n, :, 0]) / (ends[:n, :, 1] - ends[:n, :, 0])
        p = low + t[..., None] * step
        normal = np.cross(p[:, 1] - p[:, 0], p[:, 2] - p[:, 0])
        assert n >= 3
        assert (normal @ [1, 1, 1] > 0).all()


@pytest.mark.parametrize("part", [0.1, 0.6, 1.0])
def test_halved_triangles_are_the_same_surface(part):
    """Same rim, same area, and twice as fine where all edges are halved."""
    names, triangles, _, rng = noise_sheet(5)
    marked = np.zeros(triangles.shape, bool)
    directed = {(a, b): rng.random() < part for a, b in edge_set(triangles) if a < b}
    for t, v in np.ndindex(*triangles.shape):
        a, b = triangles[t, v], triangles[t, (v + 1) % 3]
        marked[t, v] = directed.get((min(a, b), max(a, b)), False)
    ends, edge = edges_of(triangles, marked, len(names))
    new = halved(triangles, np.where(edge < 0, -1, len(names) + edge))
    assert len(new) == len(triangles) + marked.sum()
    x = rng.random((len(names), 3))
    y = np.concatenate([x, 0.5 * (x[ends[:, 0]] + x[ends[:, 1]])])
    np.testing.assert_allclose(cross_sum(y, new), cross_sum(x, triangles), atol=1e-10)
    before, after = edge_set(triangles), edge_set(new)
    assert len(after) == 3 * len(new)  # oriented: no edge runs twice in one direction
    more = sum(((a, b) in before) != ((b, a) in before) for a, b in ends.tolist())
    assert len(rim_of(after)) == len(rim_of(before)) + more


def rim_of(edges):
    return {(a, b) for a, b in edges if (b, a) not in edges}


def edge_set(triangles):
    return {(t[i], t[(i + 1) % 3]) for t in triangles.tolist() for i in range(3)}


def cross_sum(x, triangles):
    p = x[triangles]
    return np.cross(p[:, 1] - p[:, 0], p[:, 2] - p[:, 0]).sum(axis=0)


def test_nodes_next_to_crossing_edges_are_found_across_the_end_of_a_loop():
    """Two loops of four first nodes; of the first one 0 and 2 are left, and points in between."""
    place, start = np.array([0.0, 1.0, 2.0, 2.5, 4.0, 5.0, 6.0, 7.0, 7.5]), np.array([0, 4, 9])
    first = np.array([0, 4, 8])
    for edge, nodes in ((0, [0, 1]), (1, [1, 2]), (2, [2, 3]), (3, [0, 2, 3]), (4, [4, 5]),
                        (7, [4, 7]), (8, [4, 7])):  # fmt: skip
        found = _between(place, start, np.arange(9) == edge, first)
        assert np.flatnonzero(found).tolist() == nodes


def test_edges_that_cross_are_those_of_a_naive_search():
    rng = np.random.default_rng(4)
    angle = np.sort(2.0 * np.pi * rng.random((30, 5)), axis=1)
    circle = np.stack([np.cos(angle), np.sin(angle)], axis=-1)
    points = (rng.random((30, 1, 2)) + 0.08 * circle).reshape(-1, 2)
    start = 5 * np.arange(31)
    loops = [points[a:b] for a, b in pairwise(start)]
    edges = [shapely.LineString(e) for p in loops for e in zip(p, np.roll(p, -1, 0), strict=True)]
    expected = np.zeros(len(edges), bool)
    for i, j in combinations(range(len(edges)), 2):
        shared = set(edges[i].coords) & set(edges[j].coords)
        if edges[i].crosses(edges[j]) and not shared:
            expected[[i, j]] = True
    found = crossing(points, start)
    assert 0 < expected.sum() < len(edges)
    assert np.array_equal(found, expected)
    back = np.array([[0.0, 0.0], [2.0, 0.0], [1.0, 0.0], [1.0, 1.0]])  # runs back on itself
    assert crossing(back, np.array([0, 4])).tolist() == [True, True, True, False]


@pytest.mark.parametrize("wrap", [False, True])
def test_outlines_on_a_sheet_of_noise_close(wrap):
    names, triangles, planes, rng = noise_sheet(7, 1, wrap)
    side = rng.integers(-1, 2, len(names))
    out = np.empty((5 * len(triangles), 2), np.int64)
    n = kernels.march(triangles, side, rim(names, planes, wrap), out)
    assert n > 300
    assert len(set(out[:n, 0].tolist())) == n
    assert set(out[:n, 0].tolist()) == set(out[:n, 1].tolist())


def test_cycles_of_a_permutation():
    following = np.array([2, 1, 4, 5, 0, 3])
    order, start = np.empty(6, np.int64), np.empty(7, np.int64)
    assert kernels.chain(following, order, start) == 3
    assert order.tolist() == [0, 2, 4, 1, 3, 5]
    assert start[:4].tolist() == [0, 3, 4, 6]


def test_near_points_merge_but_sharp_ones_stay():
    p = np.array([[0, 0], [1, 0], [1.01, 0], [2, 0], [2.01, 0.01], [2, 1], [0.01, 0.01]])
    keep, near = np.zeros(7, bool), np.full(7, 0.1)
    kernels.thin_out(p, np.array([0, 7]), near, np.zeros(7, bool), keep)
    assert keep.tolist() == [True, True, False, True, False, True, False]
    sharp = np.arange(7) == 4
    kernels.thin_out(p, np.array([0, 7]), near, sharp, keep)
    assert keep.tolist() == [True, True, False, False, True, True, False]
    near[2:4] = 0.001, 2.0  # what counts is the distance that the later one asks for
    kernels.thin_out(p, np.array([0, 7]), near, np.zeros(7, bool), keep)
    assert keep.tolist() == [True, True, True, False, True, True, False]


# --- bad input ---


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({}, "either z"),
        ({"z": 0.5, "thickness": 0.1}, "either z"),
        ({"z": [0.5, 0.4]}, "increasing"),
        ({"z": [[0.5]]}, "increasing"),
        ({"z": np.nan}, "finite"),
        ({"thickness": 0.0}, "thickness"),
        ({"thickness": 1e-9}, "layers"),
        ({"z": [1.2, 1.3]}, "from 0 to 1 along"),
        ({"z": 0.5, "h": -1}, "h must be"),
        ({"z": 0.5, "normal": (0, 0, 0)}, "normal"),
    ],
)
def test_bad_input_is_named(arguments, message):
    with pytest.raises(InputError, match=message):
        wall("box").slices(**arguments)


def test_points_of_a_plane_have_two_coordinates():
    with pytest.raises(InputError, match="points"):
        wall("box").slices(0.5, h=0.1)[0].to_space([[0.0, 0.0, 0.0]])


def test_slices_of_a_mesh_have_its_volume_and_holes():
    solid = il.fields.difference(il.fields.sphere(1.0), il.fields.cylinder(0.4))
    mesh = il.mesh.contour(solid, [np.linspace(-1.1, 1.1, 60)] * 3)
    stack = mesh.slices(thickness=0.02)
    assert stack.volume() == pytest.approx(mesh.volume, rel=1e-3)
    middle = stack[len(stack) // 2]
    assert (len(middle.polygons), middle.holes) == (1, 1)
    assert middle.area == pytest.approx(np.pi * (1.0 - 0.4**2), rel=5e-3)
    assert mesh.slices(z=[0.0])[0].area == pytest.approx(middle.area, rel=1e-2)
    assert not mesh.slices(z=[0.0, 2.0])[1].polygons


def prism(outline):
    """From z = 0 to 1 over a polygon (n, 2), star-shaped about the mean of its corners."""
    n = len(outline)
    flat = np.vstack([outline, np.mean(outline, axis=0)])
    x = np.vstack([np.insert(flat, 2, z, axis=1) for z in (0.0, 1.0)])
    i, j, m = np.arange(n), (np.arange(n) + 1) % n, n + 1
    bottom, top = np.stack([j, i, 0 * i + n], 1), np.stack([i, j, 0 * i + n], 1) + m
    sides = np.vstack([np.stack([i, j, j + m], 1), np.stack([i, j + m, i + m], 1)])
    return x, np.vstack([bottom, top, sides])


def test_points_of_a_mesh_do_not_merge_across_another_contour():
    """Below a step of 0.3 per mille of the edges ends a wedge, half as high as the step."""
    step = 3e-4
    above = [[-1, 0], [0, 0], [0, step], [1, step], [1, 1], [-1, 1]]
    below = [[0.6, -1], [0.1, 0.5 * step], [-0.4, -1]]
    (x, f), (y, g) = prism(above), prism(below)
    mesh = il.SurfaceMesh(np.vstack([x, y]), np.vstack([f, g + len(x)]))
    (section,) = mesh.slices([0.5])
    polygons = [shapely.Polygon(outer, holes) for outer, holes in section.polygons]
    assert len(polygons) == 2
    assert not polygons[0].intersects(polygons[1])
    assert sum(p.area for p in polygons) == pytest.approx(2.0 - step + 0.5 * (1 + 0.5 * step))


def test_slices_of_a_mesh_along_a_normal():
    mesh = il.mesh.contour(il.fields.box((0.5, 0.6, 0.7)), [np.linspace(-0.8, 0.8, 33)] * 3)
    piece = mesh.slices(z=[0.1], normal=(1, 0, 0))[0]
    lo, hi = piece.bounds
    assert piece.area == pytest.approx(1.2 * 1.4, rel=2e-2)
    np.testing.assert_allclose(np.sort(hi - lo), [1.2, 1.4], rtol=2e-2)


def test_open_meshes_have_no_slices():
    mesh = il.SurfaceMesh(np.eye(3), [[0, 1, 2]])
    with pytest.raises(GeometryError):
        mesh.slices(thickness=0.1)


@pytest.mark.parametrize("low", [-2.25, 15.5])
def test_slices_at_the_ends_of_a_part_are_what_it_ends_with(low):
    """The faces of a cell of Schwarz P, which are all alike, against slices a little inside."""
    through = il.macroshape.box(lo=(3.0, 7.0, low), hi=(12.0, 16.0, low + 9.0))
    wall = il.Lattice("schwarz_p", through=through).offset(0.7)
    ends, near = [low, low + 9.0], [low + 1e-3, low + 9.0 - 1e-3]
    for part in (wall, wall.mesh(0.6)):
        areas = [s.area for s in part.slices(z=ends)]
        np.testing.assert_allclose(areas, [s.area for s in part.slices(z=near)], rtol=2e-4)
    block = il.mesh.slice_field(il.fields.box((1.0, 2.0, 3.0)), [-3.0, 3.0], h=0.2)
    np.testing.assert_allclose([s.area for s in block], 8.0, rtol=1e-4)
