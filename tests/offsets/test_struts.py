"""Graphs of struts as they are: meshed, sliced and integrated without distances.

The oracle is the union of the balls along the axes, by closed formulae or dense sampling in NumPy.
"""

import numpy as np
import pytest

import ilattice as il
from ilattice.errors import ConvergenceError, InputError, PrecisionWarning

NODES = np.array(
    [(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0), (0.5, 0.47, 0.9), (0.53, 0.5, 0.4)], float
)
EDGES = [(0, 1), (1, 2), (2, 3), (3, 0), (0, 4), (1, 4), (2, 4), (3, 4), (4, 5)]
STRUTS = [NODES[list(e)] for e in EDGES]
FREE = np.array([(7.1, -3, 2), (9, -2.6, 2.2), (8.8, -1, 2.4), (7, -1.2, 1.9), (8, -2, 3.7)])
RADIUS = 0.05
RING = [(0, 1), (1, 2), (2, 3), (3, 0), (0, 4), (1, 4), (2, 4), (3, 4)]


def balls(x, nodes, edges, radii, steps=400):
    """Least of |x - p| - r over the balls of all struts, radii (m, 2) linear along them."""
    out = np.full(len(x), np.inf)
    for (a, b), (ra, rb) in zip(edges, radii, strict=True):
        p, q = nodes[a], nodes[b]
        t = np.linspace(0, 1, steps)
        if ra == rb:  # the nearest ball is that of the foot
            t = np.clip((x - p) @ (q - p) / ((q - p) @ (q - p)), 0, 1)
            ball = np.linalg.norm(x - p - t[:, None] * (q - p), axis=1) - ra
        else:
            ways = np.linalg.norm(x[:, None] - p - t[:, None] * (q - p), axis=2)
            ball = (ways - (ra + t * (rb - ra))).min(axis=1)
        out = np.minimum(out, ball)
    return out


def cube(n, repeat=(1, 1, 1)):
    axes = [(np.arange(n * r) + 0.5) / n for r in repeat]
    return np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)


@pytest.mark.filterwarnings("ignore:the mesh with h=")  # coarse
@pytest.mark.parametrize("faces", ["open", "closed"])
def test_struts_between_nodes_on_faces_edges_and_corners_are_meshed(faces):
    tile = il.tiles.skeleton(STRUTS, radius=0.05, faces=faces)
    wall = il.Lattice(tile, through=il.macroshape.box((1, 1, 1))).offset((np.inf, 0))
    mesh = wall.mesh(h=0.02)
    assert mesh.is_watertight
    assert mesh.self_intersections == 0
    assert (mesh.components, mesh.genus) == (1, 4)  # 9 edges - 6 nodes + 1
    radii = np.full((9, 2), 0.05)
    exact = float((balls(cube(120), NODES, EDGES, radii) < 0).mean())
    assert mesh.volume == pytest.approx(exact, rel=0.025)
    assert wall.volume() == pytest.approx(exact, rel=0.015)
    assert wall.slices(thickness=0.02).volume() == pytest.approx(exact, rel=0.015)
    outside = mesh.vertices[mesh.point_data["side"] != 0]
    off = np.abs(balls(outside, NODES, EDGES, radii))
    assert np.percentile(off, 99) < 1e-9
    assert wall.thickness_error(mesh).relative < 1e-6


@pytest.mark.filterwarnings("ignore:the mesh with h=")  # coarse
@pytest.mark.filterwarnings("ignore:neighbouring tiles do not meet")  # of other radii
def test_varying_radii_and_blends_of_repeated_cells_through_a_bent_map():
    rng = np.random.default_rng(8)
    radii = rng.uniform(0.04, 0.08, (9, 2))
    tile = il.tiles.struts(NODES, EDGES, radii, faces="open", blend=0.03)
    corners = [(0, 0, 0), (2, 0, 0.1), (2, 2.1, 0), (0, 2, 0.1), (0.2, 0, 1), (2.2, 0.1, 1),
               (2, 2.2, 1.2), (0.1, 2, 1.1)]  # fmt: skip
    through = il.macroshape.hexahedron(corners)
    lattice = il.Lattice(tile, through=through, repeat=(2, 2, 1))
    mesh = lattice.offset((np.inf, 0)).mesh(h=0.04)
    assert mesh.is_watertight
    assert mesh.self_intersections == 0
    assert mesh.components == 1
    data = mesh.point_data
    u = np.stack([data[k] for k in "uvw"], axis=1)[data["side"] != 0]
    at = u * [2, 2, 1]
    bottom = np.minimum(np.floor(at), [1, 1, 0])
    f = balls(at - bottom, NODES, EDGES, radii)
    # a smooth union of at most n struts adds up to k / 2 (1 - 1 / n)
    assert f.min() > -1e-4
    assert f.max() < 0.5 * 0.03 * (1 - 1 / 9) + 1e-9
    assert np.mean(np.abs(f) < 1e-4) > 0.3


@pytest.mark.parametrize("per", ["node", "edge", "end"])
def test_a_graph_in_space_is_meshed_sliced_and_integrated(per):
    rng = np.random.default_rng(5)
    radii = {
        "node": rng.uniform(0.1, 0.2, 5), "edge": rng.uniform(0.1, 0.2, 8),
        "end": rng.uniform(0.1, 0.2, (8, 2)),
    }[per]  # fmt: skip
    ends = {
        "node": lambda r: r[np.array(RING)], "edge": lambda r: np.stack([r, r], 1),
        "end": lambda r: r,
    }[per](radii)  # fmt: skip
    wall = il.Lattice.from_struts(FREE, RING, radii).offset((np.inf, 0))
    mesh = wall.mesh()
    assert mesh.is_watertight
    assert mesh.self_intersections == 0
    assert (mesh.components, mesh.genus) == (1, 4)
    x = mesh.vertices[rng.choice(len(mesh.vertices), 500)]
    assert np.percentile(np.abs(balls(x, FREE, RING, ends, 2000)), 99) < 2e-5
    assert (mesh.point_data["side"] == 1).all()  # nothing ends at the box around it
    p = rng.uniform(*mesh.bounds, (60_000, 3))
    inside = balls(p, FREE, RING, ends, 60) < 0
    exact = inside.mean() * np.prod(np.ptp(mesh.bounds, axis=0))
    noise = 4 * np.sqrt(exact * np.prod(np.ptp(mesh.bounds, axis=0)) / len(p))
    assert abs(wall.volume() - exact) < noise
    assert mesh.volume == pytest.approx(wall.volume(), rel=0.03)
    assert wall.slices(thickness=0.06).volume() == pytest.approx(wall.volume(), rel=0.01)


def test_a_bar_in_space_is_as_stiff_as_a_bar():
    length, r = 6.0, 0.5
    wall = il.Lattice.from_struts([(0, 0, 0), (length, 0, 0)], [(0, 1)], r).offset((np.inf, 0))
    lo, hi = wall.lattice.through.bounds
    assert lo[0] < -r
    assert hi[0] > length + r
    mass = il.cutfem.quadrature(wall).integrate(lambda x: np.ones(len(x)))
    assert mass == pytest.approx(np.pi * r**2 * length + 4 / 3 * np.pi * r**3, rel=2e-3)


def test_solids_of_other_tiles_need_no_distances_either():
    lattice = il.Lattice("gyroid", through=il.macroshape.torus(), repeat=(9, 2, 2))
    wall = lattice.offset((np.inf, 0))
    mesh = wall.mesh(h=0.1)
    assert lattice.statistics.queries == 0
    assert mesh.is_watertight
    u = np.stack([mesh.point_data[k] for k in "uvw"], axis=1)[mesh.point_data["side"] != 0]
    assert np.abs(lattice.distance(u[::50])).max() < 1e-6
    assert wall.relative_density() == pytest.approx(0.5, abs=0.01)


def test_a_tolerance_refines_the_spline_or_says_that_it_cannot(monkeypatch):
    monkeypatch.setattr("ilattice.offsets.solid.MAX_IN_TOTAL", 1 << 16)
    tile = il.tiles.struts(NODES, EDGES, 0.08, blend=0.01)  # others are cut as they are
    lattice = il.Lattice(tile, through=il.macroshape.box((1, 1, 1)))
    wall = lattice.offset((np.inf, 0), tol=4e-3)
    wall.volume()
    assert wall.distance.error < 4e-3
    with pytest.raises(ConvergenceError, match="spans per tile"):
        lattice.offset((np.inf, 0), tol=1e-9).volume()


@pytest.mark.parametrize("through", ["box", "hexahedron"])
def test_lattices_of_crossing_bars_are_integrated_as_they_are(through):
    """3 pi r^2 - 8 sqrt(2) r^3 in every tile, where a spline is off by 2e-3 or more."""
    r, ends = 0.15, [(x, y, z) for x in (0, 1) for y in (0, 1) for z in (0, 1)]
    middle = [(0.5, 0.5, 0.5), *(np.insert([0.5, 0.5], a, e) for a in range(3) for e in (0, 1))]
    tile = il.tiles.struts(middle, [(0, i) for i in range(1, 7)], r)
    exact = 3 * np.pi * r**2 - 8 * np.sqrt(2) * r**3
    corners = np.array(ends) @ np.array([[2.0, 0.3, 0.0], [0.0, 1.0, 0.2], [0.1, 0.0, 1.0]])
    maps = {
        "box": il.macroshape.box((2, 1, 1)),
        "hexahedron": il.macroshape.hexahedron(corners.reshape(2, 2, 2, 3)),
    }
    wall = il.Lattice(tile, through=maps[through], repeat=(2, 1, 1)).offset((np.inf, 0))
    density = wall.relative_density(per_cell=True).ravel()
    np.testing.assert_allclose(density, exact, rtol=3e-4)
    error = abs(wall.volume() - exact * maps[through].volume())
    assert error < 2.0 * wall.volume_error < 1e-3 * wall.volume()
    problem = il.cutfem.Elasticity(wall, (12, 6, 6), young=1.0, poisson=0.3)
    assert problem.domain.cut.sets.fields  # no spline
    assert problem.domain.volume.integrate() == pytest.approx(exact, rel=1e-4)


def test_a_spline_that_has_lost_the_struts_is_refused():
    """With 6 spans per tile it held 0.04 of the volume 0.10."""
    box = il.macroshape.box((1.3, 0.7, 2.0))
    lattice = il.Lattice("kagome", through=box, spans_per_tile=6)
    with pytest.raises(ConvergenceError, match="little of it is left"):
        lattice.offset((np.inf, 0.0)).volume()


@pytest.mark.parametrize(("spans", "told"), [(16, None), (32, "quadrature and analysis")])
def test_a_spline_that_is_too_coarse_is_told_or_refused(spans, told):
    """With 16 spans per tile it holds 0.36 of the volume, which was but told."""
    tile = il.tiles.struts(NODES, EDGES, 0.02, blend=0.005)
    lattice = il.Lattice(tile, through=il.macroshape.box((1, 1, 1)), spans_per_tile=spans)
    wall = lattice.offset((np.inf, 0))
    if told is None:
        with pytest.raises(ConvergenceError, match=r"6\d(\.\d)? % less volume.*10 % are the most"):
            wall.volume()
    else:
        with pytest.warns(PrecisionWarning, match=told):
            wall.volume()


@pytest.mark.parametrize("repeat", [1, 2])
def test_thin_struts_that_are_splines(repeat):
    """Radii that differ take a spline; its loss is told, and meshes are not blamed for it.

    Two tiles, of which the spline holds 0.6, and a random point of 30,000 was in the strut.
    """
    r, way = 0.004, np.array([0.35, 0.41, 1.0])
    nodes = [(0.22, 0.31, 0), (0.57, 0.72, 1)]
    tile = il.tiles.struts(nodes, [(0, 1)], [[r, 1.0001 * r]], faces="open")
    box = il.macroshape.box((repeat, repeat, 1))
    wall = il.Lattice(tile, through=box, repeat=(repeat, repeat, 1)).offset((np.inf, 0))
    exact = repeat**2 * np.pi * r**2 * np.linalg.norm(way)
    assert wall.distance.filled == pytest.approx(exact, rel=0.03)
    if repeat == 2:
        with pytest.raises(ConvergenceError, match=r"4\d(\.\d)? % less volume"):
            wall.volume()
    else:
        with pytest.warns(PrecisionWarning, match=r"(9|10|9\.\d\d?) % less volume"):
            volume = wall.volume()
        assert volume + wall.volume_error > exact
        assert volume / (1.0 - wall.distance.lost) == pytest.approx(exact, rel=0.02)
    with pytest.warns(PrecisionWarning, match=r"[23](\.\d)? % less than the wall"):
        mesh = wall.mesh(r / 2)
    assert mesh.volume == pytest.approx(exact, rel=0.04)


@pytest.mark.parametrize(
    ("nodes", "edges", "radii", "match"),
    [
        (FREE, [(0, 7)], 0.1, r"edges\[0\] is \[0.0, 7.0\]: it must name nodes"),
        (FREE, [(0, 1.5)], 0.1, "must name nodes by numbers from 0 to 4"),
        (FREE, [(0, 1), (2, 2)], 0.1, r"edges\[1\] .* joins a node with itself"),
        (FREE, [*RING, (1, 0)], 0.1, r"edges\[8\] .* is there twice"),
        (FREE, RING[:3], 0.1, r"nodes\[4\] has no edge"),
        (FREE[[0, 0, 1]], [(0, 1), (1, 2)], 0.1, "two nodes at the same place"),
        (FREE, RING, -0.1, "radii must be positive"),
        (FREE, RING, np.full(6, 0.1), r"one per node \(5,\), one per edge \(8,\)"),
        (FREE, [*RING[:4], (0, 4)], np.full(5, 0.1), "5 nodes or of the 5 edges"),
        (FREE, [0, 1], 0.1, r"shape \(m, 2\)"),
    ],
)
def test_what_is_no_graph_is_refused_by_name(nodes, edges, radii, match):
    with pytest.raises(InputError, match=match):
        il.Lattice.from_struts(nodes, edges, radii)


def far_from(x, matrix):
    """Least distances from points to the images of `STRUTS` in a cell and its neighbours.

    A strut is convex, and so is what an affine map makes of it: the nearest point is found by
    projected gradients over the place along the axis and the way from there, a vector no longer
    than the radius.
    """
    steps = np.stack(np.meshgrid(*[[-1, 0, 1]] * 3, indexing="ij"), axis=-1).reshape(-1, 3)
    a, b = (np.array([NODES[e[i]] for e in EDGES]) for i in (0, 1))
    a, way = (a[:, None] + steps).reshape(-1, 3), np.repeat(b - a, len(steps), axis=0)
    row, col = np.indices((len(x), len(a))).reshape(2, -1)
    base, along = x[row] - a[col] @ matrix.T, way[col] @ matrix.T
    most = max(np.linalg.norm(matrix, 2) ** 2 * ((way**2).sum(axis=1).max() + 1.0), 1e-300)
    t, v = np.full(len(row), 0.5), np.zeros((len(row), 3))
    t1, v1, k = t, v, 1.0
    for _ in range(600):
        r = base - t1[:, None] * along - v1 @ matrix.T
        new_t = np.clip(t1 + (r * along).sum(axis=1) / most, 0.0, 1.0)
        new_v = v1 + r @ matrix / most
        new_v *= np.minimum(1.0, RADIUS / np.maximum(np.linalg.norm(new_v, axis=1), 1e-300))[
            :, None
        ]
        k, m = 0.5 * (1 + np.sqrt(1 + 4 * k * k)), k - 1
        t1, v1 = new_t + m / k * (new_t - t), new_v + m / k * (new_v - v)
        t, v = new_t, new_v
    out = np.linalg.norm(base - t[:, None] * along - v @ matrix.T, axis=1)
    return out.reshape(len(x), -1).min(axis=1)


@pytest.mark.filterwarnings("ignore:the spline approximation")
def test_distances_from_struts_are_those_of_the_struts_and_not_of_a_spline():
    """They used to be a hundredth of the radius off, and more next to nodes."""
    rng = np.random.default_rng(11)
    tile = il.tiles.skeleton(STRUTS, radius=RADIUS, faces="periodic")
    matrix = np.array([[1.7, 0.3, 0.1], [-0.2, 0.9, 0.25], [0.1, -0.15, 1.2]])
    corners = np.moveaxis(np.indices((2, 2, 2)), 0, -1)
    lattice = il.Lattice(tile, through=il.macroshape.hexahedron(corners @ matrix.T))
    u = rng.random((4000, 3))
    u = u[np.abs(tile(u) - RADIUS) < RADIUS][:60]
    found = lattice.closest(u)
    exact = far_from(u @ matrix.T, matrix)
    np.testing.assert_allclose(found.distance, exact, atol=1e-5 * RADIUS)
    assert np.abs(tile(found.u % 1.0)).max() < 1e-5 * RADIUS  # feet are on the struts
    near = rng.random((20_000, 3))
    near = near[np.abs(tile(near)) < 0.003 * RADIUS]
    np.testing.assert_array_equal(np.sign(lattice.distance(near)), np.sign(tile(near)))
    assert len(near) > 5
