"""Constants of compiled code that decide feet: a small case of each fails with a useless value.

Kernels are run as Python, see `as_python`. Surfaces are polynomials on simple maps, of which feet
are known. `LEFT_OUT` says of the other constants why they are not here.
"""

import re
from functools import partial

import numpy as np
import pytest
from as_python import constants, results_of, write
from scipy.optimize import minimize_scalar

from ilattice.bspline.fit import fit
from ilattice.offsets import _kernels as search
from ilattice.offsets import _kernels_jets as jets
from ilattice.offsets import _kernels_newton as newton
from ilattice.offsets import _kernels_patches as patches
from ilattice.offsets import _kernels_sweep as sweep
from ilattice.offsets.seeding import Seeds

INF = np.inf
BOX = np.array([[0.0] * 3, [1.0] * 3])
NOTHING = newton.Known((0.0, 0.0, 0.0), INF, 0.0, 1.0)


# ---------------------------------------------------------------- surfaces, seeds and feet


def space_of(f, degree, shape=lambda p: p, map_degree=1, ends=1.0):
    """The surface f = 0 on the unit cube, one tile in which the map is a polynomial, for kernels.

    It ends with the cube, or goes on behind it.
    """
    tile = fit(f, degree=degree, spans=1)
    through = fit(shape, degree=map_degree, spans=1)
    geom = np.array(
        [0, 0, 0, 1, 1, 1, 0, 0, 0, 1, 1, 1, 0, jets.LATTICE_SPLINE, 0] + [ends] * 3, float
    )
    trig = np.zeros(1), np.zeros((1, 3), np.int64), np.ones(3)
    return jets.Space._make((*through.generic_kernel_args, geom, *trig, *tile.generic_kernel_args))


def plane(p):
    return p[:, 2] - 0.5


def ellipsoid(p):
    """Half-axes 0.1, 0.2 and 0.4."""
    return (((p - 0.5) / (0.1, 0.2, 0.4)) ** 2).sum(axis=1) - 1.0


def parabola(p):
    """A gutter that is seen from the inside, of radius 0.25 at its bottom."""
    return p[:, 2] - 0.3 - 2.0 * (p[:, 0] - 0.5) ** 2


def foot_of(space, x, start, known=NOTHING, h=0.1):
    """Where `newton` ends: (foot, distance, iterations, status)."""
    work = jets.scratch(space)
    p, y, _, _, n, status = newton.newton(
        space, tuple(x), tuple(start), known, False, h, 1e-7, work
    )
    return p, np.linalg.norm(np.subtract(x, y)), n, status


def seeds_of(space, points, h, bent=0.0):
    """Seeds on the surface at points, of spacing h."""
    work, normal = jets.scratch(space), np.zeros((len(points), 5))
    image = np.empty((len(points), 3))
    for i, p in enumerate(points):
        jets.map_jet(space, tuple(p), 1, work.basis, work.map)
        jets.tile_jet(space, tuple(p), work.basis, work.tile, work.table)
        v, _ = jets.cofactor_normal(work.map, tuple(work.tile[1:4]))
        normal[i, :3] = v / np.linalg.norm(v)
        image[i] = work.map[:3, 0]
    normal[:, patches.BENT] = bent
    return Seeds(np.array(points, float), image, normal, np.full(len(points), h))


def feet_from(space, seeds, x, q=None):
    """Distances of the two nearest feet that starts from seeds, in their order, lead to."""
    feet, seconds = np.zeros((1, 8)), np.zeros((1, 8))
    idx, q = np.arange(len(seeds.points))[None], x if q is None else q
    search.multi_start(
        space, seeds, tuple(x), tuple(q), idx, 0, BOX, 1.0, 1e-7, feet, seconds,
        newton.FALLBACK, jets.scratch(space),
    )  # fmt: skip
    return feet[0, patches.DISTANCE], seconds[0, patches.DISTANCE]


def graph_foot(g, x, lo, hi):
    """Least distance of (x, z) from the graph of g between two places."""
    far = lambda s: np.hypot(s - x[0], g(s) - x[1])  # noqa: E731
    return minimize_scalar(far, bounds=(lo, hi), method="bounded", options={"xatol": 1e-12}).fun


def same(found, exact):
    assert abs(found - exact) < 1e-8, f"{found} is not {exact}"


def two_wells(a, deep):
    """A query that sees two wells from below, at ±a, and is a bit nearer to the left one.

    Returns the space, the query, and the distances of both feet, the nearer one first.
    """
    steep = 3.0 / (deep * a**2)
    g = lambda s: 0.5 + steep * ((s - 0.5) ** 2 - a**2) ** 2  # noqa: E731
    x = (0.5 - 0.1 * a, 0.5, 0.5 - deep)
    near, far = (graph_foot(g, x[::2], 0.5 + s, 0.5 + s + a) for s in (-1.5 * a, 0.5 * a))
    return space_of(lambda p: p[:, 2] - g(p[:, 0]), (4, 1, 1)), x, near, far


def wells_are_told_apart(a, deep, h, bent=0.0):
    """Seeds next to both feet, the farther first: both feet are found."""
    space, x, near, far = two_wells(a, deep)
    seeds = seeds_of(space, [(0.5 + a, 0.5, 0.5), (0.5 - a, 0.5, 0.5)], h, bent)
    found = feet_from(space, seeds, x)
    same(found[0], near)
    same(found[1], far)


wells_next_to_each_other_are_told_apart = partial(wells_are_told_apart, 0.05, 0.3, 0.03)
narrow_wells_are_told_apart = partial(wells_are_told_apart, 0.05, 0.1, 0.22, bent=5.0)
small_wells_are_told_apart = partial(wells_are_told_apart, 0.05, 0.3, 0.075)


# ---------------------------------------------------------------- iterations


def feet_are_reached():
    space = space_of(ellipsoid, 2)
    _, distance, n, status = foot_of(space, (0.9, 0.5, 0.5), (0.55, 0.6, 0.75))
    assert status == newton.OK, f"status {status} after {n}"
    same(distance, 0.3)


def saddles_are_left():
    """From the middle, the end of the longest half-axis is stationary: the shortest one is 0.1."""
    space = space_of(ellipsoid, 2)
    _, distance, n, status = foot_of(space, (0.5, 0.5, 0.5), (0.5, 0.5, 0.9))
    assert status == newton.OK, f"status {status} after {n}"
    same(distance, 0.1)


def deep_curvature_throws_no_steps_off():
    """From beyond all centres of curvature, steps are as if the surface were nearly flat."""
    space = space_of(parabola, 2)
    _, distance, n, status = foot_of(space, (0.5, 0.5, 0.9), (0.52, 0.5, 0.3008))
    assert status == newton.OK, f"status {status} after {n}"
    exact = graph_foot(lambda s: 0.3 + 2.0 * (s - 0.5) ** 2, (0.5, 0.9), 0.6, 1.5)
    same(distance, exact)


def edges_are_reached_from_around_them():
    """Feet on the rounded edge of a bar whose field levels off, from both faces: most are found."""

    def bar(p):
        q = np.abs(p[:, [0, 2]] - 0.5) - 0.2
        far = np.linalg.norm(np.maximum(q, 0.0), axis=1) + np.minimum(q.max(axis=1), 0.0) - 0.05
        return np.tanh(far / 0.03)

    tile = fit(bar, degree=2, spans=(24, 1, 24)).generic_kernel_args
    space = space_of(plane, 1)
    space = space._make((*space[: -len(tile)], *tile))
    found = []
    for angle in np.linspace(0.1, 1.47, 6):
        n = np.array([np.cos(angle), 0.0, np.sin(angle)])
        for away in (0.05, 0.15, 0.3):
            for start in ((0.66, 0.5, 0.75), (0.75, 0.5, 0.62)):
                x = (0.7, 0.5, 0.7) + (0.05 + away) * n
                _, distance, _, status = foot_of(space, x, start, h=0.125)
                found.append(status == newton.OK and abs(distance - away) < 0.01)
    assert np.mean(found) > 0.6, f"{sum(found)} of {len(found)} found"


def feet_are_where_singular_maps_lead():
    """Behind the plane in which a map folds, steps are long in tiles: ends are on the surface."""
    space = space_of(plane, 1, lambda p: np.column_stack([p[:, 0] ** 2, p[:, 1:]]), 2)
    work = jets.scratch(space)
    p, y, _, _, _, status = newton.newton(
        space, (-1e-3, 0.5, 0.8), (0.1, 0.5, 0.5), NOTHING, False, 0.1, 1e-7, work
    )
    assert status == newton.OK
    same(p[0] ** 2, y[0])


def feet_next_to_a_known_one_are_reached():
    """Two wells at 0.05, the farther one known."""
    for h, a, deep in ((0.05, 0.05, 0.3), (1.0, 0.02, 0.02), (0.3, 0.05, 0.2)):
        space, x, near, far = two_wells(a, deep)
        known = newton.Known((0.5 + a, 0.5, 0.5), far, -1.0, 1.0)
        _, distance, _, status = foot_of(space, x, (0.5 - 0.8 * a, 0.5, 0.5), known, h=h)
        assert status == newton.OK, f"status {status}"
        same(distance, near)


def corners_beside_the_query_are_no_feet():
    """The lower face of the cube is the surface, up to rounding of its gradient."""
    jet = np.array([0.0, 1e-17, 1e-17, 1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0])
    found, _ = newton.vertex_foot((0.0, 0.0, 0.0), BOX, (-0.3, -0.2, 0.4), jet)
    assert not found, "a corner is taken for a foot"


def starts_at_the_tip(count=25):
    """Points of the ellipsoid around the end of its longest half-axis."""
    rng = np.random.default_rng(0)
    t, f = rng.uniform((0.0, 0.0), (0.6, 6.0), (count, 2)).T
    way = np.stack([np.sin(t) * np.cos(f), np.sin(t) * np.sin(f), np.cos(t)], axis=1)
    return 0.5 + way * (0.1, 0.2, 0.4)


def feet_are_sharp():
    space, off = space_of(ellipsoid, 2), []
    for start in starts_at_the_tip():
        p, _, _, status = foot_of(space, (0.5, 0.5, 1.2), start)
        off += [np.linalg.norm(np.subtract(p, (0.5, 0.5, 0.9)))] * (status == newton.OK)
    assert max(off) < 1e-9, f"off by {max(off)}"


def short_distances_are_sharp():
    space, off = space_of(ellipsoid, 2), []
    for start in starts_at_the_tip():
        _, distance, _, status = foot_of(space, (0.5, 0.5, 0.9 + 1e-8), start)
        off += [abs(distance / 1e-8 - 1.0)] * (status == newton.OK)
    assert max(off) < 3e-4, f"off by {max(off)}"


def the_last_step_of_all_is_short():
    """Neither long in space nor, however short there, through a third of a squeezed tile."""
    ends = partial(newton.converged, dist=0.1, it=newton.MAX_ITERATIONS - 1, h=0.1, tol=1e-7)
    assert ends(1e-6, 1e-6, (0.0, 0.0, 1e-5))
    assert not ends(1e-3, 1e-3, (0.0, 0.0, 1e-4)), "long in space"
    assert not ends(1e-6, 1e-6, (0.0, 0.0, 0.3)), "long in tiles"


# ---------------------------------------------------------------- several starts


def shallow_wells_are_told_apart():
    """The farther one from its flank, as starts are alike otherwise."""
    a, deep = 0.05, 0.02
    space, x, near, _ = two_wells(a, deep)
    z = 0.5 + 3.0 / (deep * a**2) * (0.045**2 - a**2) ** 2
    found = feet_from(space, seeds_of(space, [(0.545, 0.5, z), (0.45, 0.5, 0.5)], 1.0), x)
    same(found[0], near)


def sheets_of_squeezed_tiles_are_told_apart():
    """Those at 0.2 and 0.8 of a tile of height 0.01 face alike."""
    sheets = lambda p: (p[:, 2] - 0.2) * (p[:, 2] - 0.5) * (p[:, 2] - 0.8)  # noqa: E731
    space = space_of(sheets, 3, lambda p: p * (1.0, 1.0, 0.01))
    seeds = seeds_of(space, [(0.5, 0.5, 0.2), (0.5, 0.5, 0.8)], 0.125)
    found = feet_from(space, seeds, (0.5, 0.5, 0.0095), (0.5, 0.5, 0.95))
    same(found[0], 0.0015)


def both_sides_of_a_corner_are_searched():
    """Inside the branch of a hyperbola, next to its asymptotes, with one cell for all of it."""
    space = space_of(lambda p: p[:, 0] * p[:, 1] - 3e-5, 1)
    seeds = seeds_of(space, [(1e-4, 0.3, 0.5), (0.3, 1e-4, 0.5)], 1.0)
    found = feet_from(space, seeds, (0.3, 0.2, 0.5))
    same(found[0], graph_foot(lambda s: 3e-5 / s, (0.3, 0.2), 0.2, 0.5))


def gutter(over, aside):
    """From above the centre of curvature by a part, a seed on the farther side of a gutter."""
    space = space_of(parabola, 2)
    x = (0.5 + aside, 0.5, 0.3 + 0.25 * (1.0 + over))
    seeds = seeds_of(space, [(0.5 - 0.25 * np.sqrt(2.0 * over), 0.5, 0.3 + 0.25 * over)], 1.0)
    found = feet_from(space, seeds, x)
    near = graph_foot(lambda s: 0.3 + 2.0 * (s - 0.5) ** 2, (x[0], x[2]), 0.5, 0.8)
    same(found[0], near)


loose_feet_have_neighbours = partial(gutter, 0.1, 0.0025)
loose_feet_have_near_neighbours = partial(gutter, 0.01, 0.000075)


def feet_without_a_seed_are_found_from_the_query():
    space = space_of(lambda p: (p[:, 2] - 0.2) * (p[:, 2] - 0.8), 2)
    seeds = seeds_of(space, [(0.5, 0.5, 0.8)], 0.1)
    feet, seconds = np.zeros((1, 8)), np.zeros((1, 8))
    x, status = np.array([[0.5, 0.5, 0.25]]), np.array([newton.FALLBACK])
    search.closest(
        1, space, seeds, x, x, np.zeros((1, 1), np.int64), BOX, 1.0, 1e-7, feet, seconds,
        np.zeros((1, 2), np.int64), status,
    )  # fmt: skip
    same(abs(feet[0, patches.DISTANCE]), 0.05)


# ---------------------------------------------------------------- seeds that may be left out


def pieces_end_below_the_next_tile():
    """Where tiles meet in creases, the upper bound of a start in one is still in that."""
    geom, room = space_of(plane, 1).geom.copy(), np.empty((2, 3))
    geom[jets.TILES : jets.RATIONAL] = 3.0
    patches.piece(geom, (0.2, 1.5, 2.9), room)
    tiles = [patches.tile_index(geom, a, room[1, a]) for a in range(3)]
    assert tiles == [0.0, 1.0, 2.0], f"in the tile {tiles}"


def is_unlikely(seed, normal, x, h, best):
    """Whether a seed, with what its row of normals tells, is ruled out for a query."""
    return patches.unlikely(tuple(x), np.array([seed]), normal[None], 0, h, best * (1 + 1e-9))


def patches_with_the_foot_are_searched():
    """Within half a diagonal of a cell from seeds of spheres, seen from both sides."""
    rng, h = np.random.default_rng(1), 0.1
    for bent in (0.01, 0.3, 0.7):
        R, normal = h / bent, np.array([0.0, 0.0, 1.0, bent, 0.0])
        for _ in range(200):
            t, f = 0.87 * bent * np.sqrt(rng.random()), 7.0 * rng.random()
            n = np.array([np.sin(t) * np.cos(f), np.sin(t) * np.sin(f), np.cos(t)])
            best = rng.choice([0.01, 0.1, 1.0]) * R
            for side in (1.0, -1.0) if best < R else (1.0,):
                x = (R + side * best) * n
                assert not is_unlikely((0, 0, R), normal, x, h, best), f"lost at bent {bent}"


def small_balls_are_searched():
    """Spheres smaller than a cell, from a seed that may be on the far side."""
    rng, h, bent = np.random.default_rng(1), 0.1, 4.0
    R, normal = h / bent, np.array([0.0, 0.0, 1.0, bent, 0.0])
    for _ in range(200):
        n = rng.normal(size=3)
        x = (R + 0.05) * n / np.linalg.norm(n)
        assert not is_unlikely((0, 0, R), normal, x, h, 0.05), "lost"


def squeezed(h, *, guide):
    """A row of normals of a plane, with cells h long and h / 20 wide; they may be no guide."""
    normal = np.zeros(patches.SQUEEZED_TOO)
    normal[2], normal[patches.BULGED] = 1.0, INF
    if guide:
        normal[patches.PLAIN :][[0, 4, 8]] = 1.0 / h, 20.0 / h, 20.0 / h
    return normal


def squeezed_cells_with_the_foot_are_searched():
    rng, h = np.random.default_rng(1), 0.1
    normal = squeezed(h, guide=True)
    for _ in range(200):
        best = rng.choice([0.01, 0.1])
        x = (*(rng.uniform(-0.8, 0.8, 2) * (h, h / 20.0)), best)
        assert not is_unlikely((0, 0, 0), normal, x, h, best), "lost"


def cells_that_are_no_guide_are_searched():
    rng, h = np.random.default_rng(1), 0.1
    normal = squeezed(h, guide=False)
    for _ in range(200):
        best = rng.choice([0.01, 0.1])
        x = (*(rng.uniform(-0.5, 0.5, 2) * (h, h / 20.0)), best)
        lost = sweep.away_from(normal[None], np.array([h]), 0, np.linalg.norm(x), best)
        assert not lost, "lost"


# ---------------------------------------------------------------- continuations


def counts(shape, degree, p, away=1.0, orient=1.0):
    """Whether the continuation of a map counts at p."""
    space = space_of(plane, 1, shape, degree, ends=0.0)
    work = jets.scratch(space)
    jets.map_jet(space, p, 1, work.basis, work.map)
    y = tuple(work.map[:3, 0])
    return jets.upright(space, orient, p, y, away, work.basis, work.map)


def bends(x):
    """A map that is another one along the first direction."""
    return lambda p: np.column_stack([x(p[:, 0]), p[:, 1:]])


def folded_continuations_do_not_count():
    once = bends(lambda s: s + 0.5 * s**2)
    assert counts(once, 2, (-0.5, 0.5, 0.5))
    assert not counts(once, 2, (-1.2, 0.5, 0.5)), "what is folded counts"


def continuations_that_were_folded_do_not_count():
    twice = bends(lambda s: 4.0 * (s + 0.5) ** 3 / 3.0 - 0.3 * s)
    assert not counts(twice, 3, (-1.0, 0.5, 0.5)), "what was folded counts"


def continuations_over_the_domain_do_not_count():
    """A ring of 6 radians: points of the domain are next to its continuation."""

    def ring(p):
        angle, r = 6.0 * p[:, 0], 1.0 + 0.2 * p[:, 1]
        return np.column_stack([r * np.cos(angle), r * np.sin(angle), p[:, 2]])

    assert counts(ring, 8, (-0.06, 0.5, 0.5), 0.3, -1.0)
    assert not counts(ring, 8, (-0.06, 0.5, 0.5), 0.02, -1.0), "what has come back counts"


CASES = [
    ("_kernels_newton", "MAX_ITERATIONS", 2, feet_are_reached, "status"),
    ("_kernels_newton", "ASTRAY", INF, edges_are_reached_from_around_them, "of 36 found"),
    ("_kernels_newton", "MIN_STEP", INF, edges_are_reached_from_around_them, "of 36 found"),
    ("_kernels_newton", "LONGEST", 1e-3, feet_are_reached, "status"),
    ("_kernels_newton", "SADDLE", -INF, saddles_are_left, "is not 0.1"),
    ("_kernels_newton", "LEAP", 0.0, saddles_are_left, "status"),
    ("_kernels_newton", "FLOORS", (0.0,) * 3, deep_curvature_throws_no_steps_off, "status"),
    ("_kernels_newton", "PATIENCE", -1, feet_next_to_a_known_one_are_reached, "status"),
    ("_kernels_newton", "CLOSE", INF, feet_next_to_a_known_one_are_reached, "status"),
    ("_kernels_newton", "PART", INF, feet_next_to_a_known_one_are_reached, "status"),
    ("_kernels_newton", "STEPS_LEFT", -INF, feet_next_to_a_known_one_are_reached, "status"),
    ("_kernels_newton", "FARTHER", -1.0, feet_next_to_a_known_one_are_reached, "status"),
    ("_kernels_newton", "ROUNDING", 0.0, corners_beside_the_query_are_no_feet, "corner"),
    ("_kernels_newton", "AT_END", INF, the_last_step_of_all_is_short, "long in space"),
    ("_kernels_newton", "AT_END_SQUARE", INF, the_last_step_of_all_is_short, "long in tiles"),
    ("_kernels_newton", "ROUGH", INF, feet_are_sharp, "off by"),
    ("_kernels_newton", "ROUGH_SQUARE", INF, feet_are_where_singular_maps_lead, "is not"),
    ("_kernels_newton", "USUAL", INF, short_distances_are_sharp, "off by"),
    ("_kernels_newton", "SHARPEST", 1.0, short_distances_are_sharp, "off by"),
    ("_kernels_patches", "APART", INF, sheets_of_squeezed_tiles_are_told_apart, "is not"),
    ("_kernels_patches", "ALIKE", -2.0, both_sides_of_a_corner_are_searched, "is not"),
    ("_kernels_patches", "TURN", INF, narrow_wells_are_told_apart, "is not"),
    ("_kernels_patches", "MIN_ALIKE", 1.0, narrow_wells_are_told_apart, "is not"),
    ("_kernels_patches", "SHARP", INF, small_balls_are_searched, "lost"),
    ("_kernels_patches", "AROUND", 0.0, squeezed_cells_with_the_foot_are_searched, "lost"),
    ("_kernels_patches", "BULGE", 0.0, patches_with_the_foot_are_searched, "lost"),
    ("_kernels_patches", "ACROSS", 0.0, patches_with_the_foot_are_searched, "lost"),
    ("_kernels_patches", "BESIDE", INF, wells_next_to_each_other_are_told_apart, "is not"),
    ("_kernels_patches", "BESIDE_FAR", INF, shallow_wells_are_told_apart, "is not"),
    ("_kernels_patches", "WIDE", INF, small_wells_are_told_apart, "is not"),
    ("_kernels_patches", "PLANE", INF, small_wells_are_told_apart, "is not"),
    ("_kernels_patches", "ALONG", -1.0, shallow_wells_are_told_apart, "is not"),
    ("_kernels_patches", "BELOW", 0.0, pieces_end_below_the_next_tile, "in the tile"),
    ("_kernels", "LOOSE", -INF, loose_feet_have_neighbours, "is not"),
    ("_kernels", "ASIDE", 0.0, loose_feet_have_neighbours, "is not"),
    ("_kernels", "LOOSER", 1.0, loose_feet_have_near_neighbours, "is not"),
    ("_kernels", "SAME", INF, wells_next_to_each_other_are_told_apart, "is not"),
    ("_kernels", "PASSED", 0.0, feet_without_a_seed_are_found_from_the_query, "is not"),
    ("_kernels_sweep", "ACROSS", 0.0, cells_that_are_no_guide_are_searched, "lost"),
    ("_kernels_jets", "UPRIGHT", -INF, folded_continuations_do_not_count, "folded"),
    ("_kernels_jets", "STEPS", 1, continuations_that_were_folded_do_not_count, "folded"),
    ("_kernels_jets", "BESIDE", 0.0, continuations_over_the_domain_do_not_count, "come back"),
]  # fmt: skip


#: What is not above, and why: places and names can have any values that differ.
LEFT_OUT = {
    "_kernels_newton": {
        "CLEAR_SADDLE NEARLY": "speed: a saddle is left where iterations end, too",
        "SMALL SMALLEST": "no case known: multipliers are looked at again by themselves",
        "TANGENT": "no case known: edges that are tangent but for rounding",
        "ERRATIC": "speed: what still goes back and forth after so long hardly ends at a foot",
        "SETTLING": "no case known: what is too far to be nearer is told by STEPS_LEFT and FARTHER",
        "FLOORED LATE LINEAR": "speed: distances are flat where convergence is linear",
        "OK BOUNDARY FALLBACK FAILED WORSE STUCK": "names",
    },
    "_kernels_patches": {
        "IMAGE DISTANCE MULTIPLIER BENT CLEAR SAGITTA BULGED PLAIN SQUEEZED_TOO": "places",
    },
    "_kernels": {
        "CHUNK": "speed",
        "SQUEEZED": "no case known: another start, on the face through which one has left",
    },
    "_kernels_sweep": {
        "LEAF FAN BEGIN END": "places: boxes are made with them, too",
        "CHUNK MAX_GATHERED": "speed and memory: of more seeds the farther ones are dropped",
    },
    "_kernels_jets": {
        "ORIGIN STEP CLOSED TILES RATIONAL KIND CREASED ENDS": "places",
        "TRIGONOMETRIC TILE_SPLINE LATTICE_SPLINE": "names",
    },
    "_kernels_seeds": {"BEND_MARGIN": "no case known: cells that bend by what they are wide"},
}


@pytest.mark.parametrize("module", LEFT_OUT)
def test_no_constant_of_kernels_is_forgotten(module):
    left_out = {name for names in LEFT_OUT[module] for name in names.split()}
    held = {name for of, name, *_ in CASES if of == module}
    assert not left_out & held
    assert left_out | held == constants(f"offsets.{module}")


@pytest.fixture(scope="module")
def results():
    return results_of(__file__)


@pytest.mark.parametrize("row", range(len(CASES)), ids=lambda i: ".".join(CASES[i][:2]))
def test_a_useless_constant_of_kernels_is_noticed(row, results):
    right, other = results[row]
    assert right == ""
    assert re.search(CASES[row][-1], other)


if __name__ == "__main__":
    write("offsets", CASES)
