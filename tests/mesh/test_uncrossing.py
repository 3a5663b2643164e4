"""Self-intersections: found as an independent library finds them, and removed from walls."""

from functools import cache

import numba
import numpy as np
import pytest
from meshes import joined, sphere, torus

import ilattice as il
from ilattice._geometry import between
from ilattice.errors import PrecisionWarning
from ilattice.mesh import SurfaceMesh, _windows, uncrossing, wall_mesh
from ilattice.mesh._own_cells import in_own_cells
from ilattice.mesh.contouring import contour_arrays
from ilattice.mesh.measure import self_intersections
from ilattice.offsets.polish import shortest
from ilattice.tiles.tpms import ROWS

cgal = pytest.importorskip("igl.copyleft.cgal")


def by_libigl(x, faces):
    """Numbers of the faces in pairs that intersect, exactly."""
    x, faces = np.array(x, np.float64), np.array(faces, np.int64)
    return np.unique(cgal.remesh_self_intersections(x, faces, detect_only=True)[2])


def found(x, faces, active=None, *, touching=False):
    pairs, marked = self_intersections(np.asarray(x), np.asarray(faces), active, touching=touching)
    return pairs, np.flatnonzero(marked)


# --- the search ---------------------------------------------------------------------------------


@pytest.mark.parametrize("shift", [0.3, 1.7, 2.5])
def test_two_spheres(shift):
    x, faces = sphere(3)
    x, faces = joined((x, faces), (x @ np.linalg.qr(np.ones((3, 3)) + np.eye(3))[0] + shift, faces))
    pairs, at = found(x, faces)
    assert (pairs > 0) == (shift < 2 / np.sqrt(3))
    assert np.array_equal(at, by_libigl(x, faces))


@pytest.mark.parametrize("seed", range(4))
def test_random_triangles_with_and_without_common_vertices(seed):
    rng = np.random.default_rng(seed)
    x = rng.random((60 if seed < 2 else 600, 3))
    near = np.linalg.norm(x[None] - rng.random((200, 1, 3)), axis=2).argsort(axis=1)[:, :9]
    faces = np.unique(np.sort([rng.permutation(n)[:3] for n in near]), axis=0)
    pairs, at = found(x, faces)
    assert pairs > 20
    assert np.array_equal(at, by_libigl(x, faces))


def test_overlaps_in_one_plane_and_touching_neighbours():
    x = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [1, 1, 0], [0.2, 0.2, 0], [2, 0, 0.0]])
    turned = np.linalg.qr(np.arange(9.0).reshape(3, 3) + np.eye(3))[0]
    for faces, pairs in (
        ([[0, 1, 2], [1, 3, 2]], 0),  # a square
        ([[0, 1, 2], [2, 1, 4]], 1),  # folded over an edge
        ([[0, 1, 2], [4, 5, 3]], 1),  # no vertex in common
        ([[0, 1, 2], [1, 5, 3]], 0),  # one in common
    ):
        assert (len(by_libigl(x, faces)) > 0) == (pairs > 0)
        assert found(x, faces)[0] == found(x @ turned, faces)[0] == pairs
    assert found(x, [[0, 1, 2], [0, 3, 4]])[0] == 1  # libigl does not look at these


@pytest.mark.parametrize("seed", range(8))
def test_corners_that_touch_triangles_are_found(seed):
    """Vertices that changed places on an edge of a body, and tips that end on a face."""
    rng = np.random.default_rng(seed)
    first, last = np.sort(rng.uniform(0.1, 0.9, 2))
    base = np.array([[0, 0, 0], [1, 0, 0], [rng.uniform(), 1, 0]])
    tip = rng.dirichlet([2, 2, 2]) @ base + [[0, 0, 0], rng.uniform(0.1, 1, 3), [0.2, 0.1, 0.9]]
    along = [[first, 0, 0], [last, 0, 0], [0.5, 0.3, 1.0]]
    turn = np.linalg.qr(rng.normal(size=(3, 3)))[0] * 10.0 ** rng.uniform(-6, 6)
    apart = tip + np.array([0.0, 0.0, 1e-6])
    for other, pairs in ((tip, 1), (along, 1), (apart, 0)):
        x = np.concatenate([base, other]) @ turn
        for faces in ([[0, 1, 2], [3, 4, 5]], [[5, 3, 4], [2, 1, 0]]):
            assert found(x, faces, touching=True)[0] == pairs
            assert found(x, faces)[0] == 0


def test_good_and_empty_meshes_have_none():
    assert SurfaceMesh(*sphere(3)).self_intersections == 0
    assert SurfaceMesh(*torus(12, 8)).self_intersections == 0
    assert SurfaceMesh(np.zeros((0, 3)), np.zeros((0, 3), int)).self_intersections == 0
    assert SurfaceMesh(*torus(12, 8, major=1.0, minor=1.4)).self_intersections > 0


def test_only_pairs_with_active_faces_are_compared():
    x, faces = sphere(3)
    x, faces = joined((x, faces), (x + 1.0, faces))
    pairs, at = found(x, faces)
    active = np.zeros(len(faces), bool)
    active[: len(faces) // 2] = True
    assert found(x, faces, active) == (pairs, pytest.approx(at))
    active[:] = False
    assert found(x, faces, active)[0] == 0
    active[at[0]] = True
    some, marked = found(x, faces, active)
    assert 0 < some < pairs
    assert at[0] in marked


# --- walls --------------------------------------------------------------------------------------


@cache
def wall_of(name, d=0.05):
    return il.Lattice(il.tiles[name], through=il.macroshape.box(), repeat=(1, 1, 1)).offset(d)


def as_polished(lattice, start, moved, faces, kind, *_):
    """What came before: repaired, but not uncrossed."""
    s = uncrossing._Surface(lattice, start, moved, faces, kind)
    return uncrossing.Uncrossed(s.u, s.x, s.repair, np.zeros(len(start), bool), s.pairs)


@pytest.mark.filterwarnings("ignore:the mesh with h=")  # coarse
def test_vertices_move_along_the_offset_until_nothing_crosses(monkeypatch):
    wall = wall_of("c_s")
    mesh = wall.mesh(0.03)
    assert len(by_libigl(mesh.vertices, mesh.faces)) == 0
    assert mesh.self_intersections == 0
    assert mesh.is_watertight
    assert mesh.is_oriented
    assert np.percentile(mesh.quality, 1) >= 0.3
    assert mesh.point_data["unconverged"].sum() == 0
    assert wall.thickness_error(mesh).relative_max <= 1e-5
    monkeypatch.setattr(wall_mesh, "uncrossed", as_polished)
    with pytest.warns(PrecisionWarning, match="pairs of triangles pass through each other"):
        before = wall.mesh(0.03)
    assert len(by_libigl(before.vertices, before.faces)) > 20
    assert before.self_intersections > 20
    assert mesh.euler == before.euler
    assert mesh.volume == pytest.approx(before.volume, rel=1e-3)


def is_exact(name, h):
    """All vertices on the offset of 0.05, no triangles that cross, closed, of good shape."""
    mesh = wall_of(name).mesh(h)
    assert mesh.point_data["unconverged"].sum() == 0
    assert wall_of(name).thickness_error(mesh).relative_max < 1e-6
    assert len(by_libigl(mesh.vertices, mesh.faces)) == 0
    assert mesh.is_watertight
    assert mesh.is_oriented
    assert np.percentile(mesh.quality, 1) >= 0.3


@pytest.mark.filterwarnings("ignore:the mesh with h=")  # coarse
@pytest.mark.parametrize("name", ["neovius", "c_s", "lidinoid"])
def test_walls_with_narrow_pores_are_exact(name):
    is_exact(name, 0.02)


@pytest.mark.filterwarnings("ignore:the mesh with h=")  # coarse
@pytest.mark.slow
@pytest.mark.parametrize("name", [row.name for row in ROWS if not row.singular_at_zero][1::2])
def test_walls_of_the_catalogue_are_exact(name):
    """Every other one; the ones between are counted in `test_topology`."""
    is_exact(name, 0.02)


@pytest.mark.filterwarnings("ignore:the mesh with h=")  # coarse
def test_a_wall_whose_pores_close_along_a_torus_is_on_the_offset():
    along = np.array([0.1, 0.28, 0.1])[:, None, None]
    d = il.BSpline([[0.0, 0.0, 0.5, 1.0, 1.0], [0, 1], [0, 1]], along, (1, 0, 0))
    through = il.macroshape.torus(major=4.0, width=2.0)
    wall = il.Lattice("diamond", through=through, repeat=(16, 2, 2)).offset(d)
    with pytest.warns(PrecisionWarning, match="vertices could not be moved onto the offset"):
        mesh = wall.mesh(0.12)
    assert wall.thickness_error(mesh).relative < 1e-6
    assert mesh.point_data["unconverged"].mean() < 5e-3
    assert len(by_libigl(mesh.vertices, mesh.faces)) == 0
    assert mesh.is_watertight


def test_roots_along_segments_are_those_of_a_cubic():
    a, b = np.zeros((5, 3)), np.ones((5, 3)) * np.arange(1.0, 6.0)[:, None]
    f = lambda p: p[:, 0] ** 3 - 0.5  # noqa: E731
    t = between(f, a, b, np.stack([f(a), f(b)], axis=1), 12)
    np.testing.assert_allclose(t * np.arange(1.0, 6.0), 0.5 ** (1 / 3), atol=1e-12)


def test_points_in_own_cells_are_on_the_offset_and_do_not_leave_fixed_coordinates():
    wall = wall_of("gyroid")
    axes = (np.linspace(0.0, 1.0, 26),) * 3
    raw = contour_arrays(wall.distance, axes, level=(-0.05, 0.05), place="linear")
    side = np.where(raw.kind & 64, 0.0, wall.field.side(raw.vertices))
    at = np.flatnonzero(side)
    fixed = np.stack([(raw.kind[at] >> (2 * a)) & 3 for a in range(3)], axis=1) != 0
    size = np.full(len(at), 0.05)
    u, found = in_own_cells(wall, axes, raw.vertices[at], fixed, side[at], size)
    assert found.mean() > 0.98
    assert np.abs(np.abs(wall.lattice.distance(u[found])) - 0.05).max() < 1e-7
    assert (np.floor(25 * u + 1e-9) - np.floor(25 * raw.vertices[at]) <= 1e-9)[found].all()
    assert (u[fixed] == raw.vertices[at][fixed]).all()
    assert (u[~found] == raw.vertices[at][~found]).all()


@pytest.mark.filterwarnings("ignore:the mesh with h=")  # coarse
def test_vertices_are_held_back_where_nothing_else_helps(monkeypatch):
    """And marked, with their error; all others are exact."""
    wall = wall_of("c_s")
    monkeypatch.setattr(uncrossing, "SLIDES", 0)
    monkeypatch.setattr(wall_mesh, "MAX_OFF", 0.03)
    monkeypatch.setattr(
        wall_mesh, "in_own_cells", lambda *args: (args[2], np.zeros(len(args[2]), bool))
    )
    with pytest.warns(PrecisionWarning, match="vertices could not be moved onto the offset"):
        mesh = wall.mesh(0.03)
    assert len(by_libigl(mesh.vertices, mesh.faces)) == 0
    unconverged = mesh.point_data["unconverged"] != 0
    assert 0 < unconverged.sum() < 0.03 * len(unconverged)
    u, side = (np.stack([mesh.point_data[k] for k in "uvw"], axis=1), mesh.point_data["side"])
    assert (side[unconverged] != 0).all()
    error = np.abs(np.abs(wall.lattice.distance(u)) - 0.05)
    assert error[unconverged].max() > 1e-4
    assert error[~unconverged & (side != 0)].max() < 5e-6


@pytest.mark.filterwarnings("ignore:the mesh with h=")  # coarse
@pytest.mark.threads
def test_meshes_do_not_depend_on_the_number_of_threads():
    wall = wall_of("c_s")
    threads = numba.get_num_threads()
    out = []
    try:
        for n in (1, threads):
            numba.set_num_threads(n)
            mesh = wall.mesh(0.03)
            data = [mesh.point_data[name].tobytes() for name in mesh.point_data]
            out.append([mesh.vertices.tobytes(), mesh.faces.tobytes(), *data])
    finally:
        numba.set_num_threads(threads)

    assert out[0] == out[1]


def test_closed_directions_are_crossed_the_short_way():
    lattice = il.Lattice("gyroid", through=il.macroshape.torus(), repeat=(4, 1, 1))
    way = np.array([[0.9, 0.9, -0.9], [-0.9, 0.1, 0.0], [0.3, 0.0, 0.0]])
    short = shortest(lattice, way)
    np.testing.assert_allclose(short, [[-0.1, 0.9, -0.9], [0.1, 0.1, 0.0], [0.3, 0.0, 0.0]])


@pytest.mark.parametrize("apart", [0.0, 2e-15])
def test_vertices_that_end_in_one_place_are_moved_apart(apart):
    """Tips of two tents, one above the other; saved meshes would be joined there."""
    lattice = il.Lattice("gyroid", through=il.macroshape.box((1.3, 0.9, 1.1)))
    x, y = np.meshgrid(*[np.linspace(0.21, 0.74, 7)] * 2, indexing="ij")
    flat = np.stack([x, y, np.full_like(x, 0.3)], axis=-1).reshape(-1, 3)
    start = np.concatenate([flat, flat + np.array([0.0, 0.0, 0.4])])
    corner = np.arange(49).reshape(7, 7)
    a, b, c, d = (corner[i : 6 + i, j : 6 + j].ravel() for i, j in ((0, 0), (1, 0), (1, 1), (0, 1)))
    quads = np.stack([a, b, c, a, c, d], axis=1).reshape(-1, 3)
    faces = np.concatenate([quads, quads[:, ::-1] + 49]).astype(np.int32)
    moved = start.copy()
    moved[[24, 73], 2] = 0.5, 0.5 + apart

    def stays(_u, at):
        return moved[at], np.zeros(len(at), bool)

    def lost(u, at):
        return u, np.ones(len(at), bool)

    kind = np.zeros(98, np.uint8)
    out = uncrossing.uncrossed(lattice, start, moved, faces, kind, stays, lost)
    assert out.left == 0
    assert out.x[73, 2] - out.x[24, 2] > 0.02
    assert out.unconverged[[24, 73]].all()
    kept = out.repair.vertices
    assert len(by_libigl(out.x[kept], out.repair.faces)) == 0
    together = uncrossing.uncrossed(lattice, moved, moved, faces, kind, stays, lost)
    assert not together.unconverged.any()  # as where an edge of the map is a point


# --- only around what crosses -------------------------------------------------------------------


def disturbed(seed):
    """A surface in a map without symmetries, and its vertices, of which some moved at random."""
    rng = np.random.default_rng(seed)
    control = np.stack(np.meshgrid(*[np.linspace(0.0, 1.0, 4)] * 3, indexing="ij"), axis=-1)
    control = (control + rng.uniform(-0.06, 0.06, control.shape)) * [1.3, 0.9, 1.1]
    through = il.SplineMap(il.BSpline([[0.0] * 4 + [1.0] * 4] * 3, control, 3))
    axes = [np.linspace(0.0, 1.0, 49) for _ in range(3)]
    for axis in axes:  # for slivers
        axis[1:-1] += rng.uniform(-0.009, 0.009, 47)

    def gyroid(u):
        a, b, c = 4.0 * np.pi * u.T
        return np.sin(a) * np.cos(b) + np.sin(b) * np.cos(c) + np.sin(c) * np.cos(a)

    raw = contour_arrays(gyroid, axes, level=0.3)
    u, free = raw.vertices, raw.kind == 0
    middle = u[rng.choice(np.flatnonzero(free), 3, replace=False)]
    away = np.linalg.norm(u[:, None] - middle, axis=2).min(axis=1)
    at = free & (away < 0.03)
    moved = u.copy()
    moved[at] = np.clip(u[at] + rng.normal(scale=0.02, size=(at.sum(), 3)), 0.01, 0.99)
    return il.Lattice("gyroid", through=through), raw, moved, away


@pytest.mark.parametrize("seed", range(2))
@pytest.mark.parametrize("motion", ["slides", "stuck", "jumps"])
def test_what_is_done_in_windows_is_what_would_be_done_to_the_whole(seed, motion, monkeypatch):
    lattice, raw, moved, away = disturbed(seed)
    real, sizes = _windows.around, []

    def around(*args):
        window = real(*args)
        sizes.append(len(window.rows))
        return window

    def uncrossed():
        rng = np.random.default_rng(seed)

        def project(u, at):
            out = moved[at] if motion == "stuck" else u.copy()
            if motion == "jumps":
                out[:2] = rng.uniform(0.01, 0.99, out[:2].shape)
            return out, np.zeros(len(at), bool)

        def lost(u, at):
            return u, np.ones(len(at), bool)

        return uncrossing.uncrossed(
            lattice, raw.vertices, moved, raw.faces, raw.kind, project, lost
        )  # fmt: skip

    monkeypatch.setattr(uncrossing, "around", around)
    out = uncrossed()
    assert 0 < sizes[0] < 0.5 * len(raw.faces)
    mesh = SurfaceMesh(out.x[out.repair.vertices], out.repair.faces)
    assert found(mesh.vertices, mesh.faces, touching=True)[0] == out.left == 0
    assert mesh.is_watertight
    assert mesh.euler == SurfaceMesh(raw.vertices, raw.faces).euler
    assert out.unconverged.any() == (motion != "slides")
    far = away > 0.3
    assert far.any()
    still = (out.x[far] == lattice.through.x(raw.vertices[far])).all()
    assert still == (motion != "jumps")  # into triangles far away, which move, too
    monkeypatch.setattr(
        uncrossing, "around", lambda x, rows, grid, *_: _windows.whole(rows, len(x), grid)
    )
    same = uncrossed()
    for a, b in ((out.u, same.u), (out.repair.faces, same.repair.faces)):
        np.testing.assert_array_equal(a, b)
    assert (out.unconverged == same.unconverged).all()


@pytest.mark.parametrize("seed", range(3))
def test_triangles_at_free_vertices_of_a_window_are_all_in_it(seed):
    lattice, raw, moved, _ = disturbed(seed)
    s = uncrossing._Surface(lattice, raw.vertices, moved, raw.faces, raw.kind)
    rng = np.random.default_rng(seed)
    mask = np.zeros((s.grid.n,) * 3, bool)
    mask[tuple(rng.integers(0, s.grid.n, (3, 40)))] = True
    near = np.zeros(len(s.x), bool)
    near[rng.integers(0, len(near), 20)] = True
    w = _windows.around(s.x, s.rows, s.grid, mask, near)
    assert 0 < len(w.rows) < len(raw.faces)
    inside = np.zeros(len(raw.faces), bool)
    inside[w.rows] = True
    now = s.rows.faces[s.rows.faces[:, 0] >= 0]
    held = inside[s.rows.faces[:, 0] >= 0]
    free = np.zeros(len(s.x), bool)
    free[w.vertices[~w.fixed]] = True
    assert held[free[now].any(axis=1)].all()
    assert inside[free[raw.faces].any(axis=1)].all()
    voxel = np.clip((s.x[now].mean(axis=1) - s.grid.low) * s.grid.scale, 0, s.grid.n - 1)
    assert held[mask[tuple(voxel.astype(int).T)]].all()
    frozen = s.rows.changed & ~np.isin(np.arange(len(inside)), w.rows[~w.frozen])
    both = np.concatenate([raw.faces[frozen], s.rows.faces[frozen]]).ravel()
    assert not free[both[both >= 0]].any()
