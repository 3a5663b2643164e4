"""Removal of slivers: made on purpose, by snapping to creases, and by the polishing of walls."""

from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from meshes import joined, sphere, torus
from naive_crossings import crossings

import ilattice as il
from ilattice.errors import ConvergenceError, PrecisionWarning
from ilattice.mesh import SurfaceMesh, _projecting, uncrossing, wall_mesh
from ilattice.mesh import _kernels_repair as kernels
from ilattice.mesh.contouring import ON_CAP, contour_arrays, split_quads
from ilattice.mesh.repair import QUALITY, Repair, remove_slivers
from ilattice.offsets.polish import polish

SIX = (0, 1, 2, 3, 4, 5)


# --- helpers ------------------------------------------------------------------------------------


def split_edge(x, faces, kind, a, b, t):
    """A new vertex on the edge a b, at a + t (b - a), on the surfaces that its triangles share."""
    v = len(x)
    x = np.vstack([x, x[a] + t * (x[b] - x[a])])
    at = [f for f in faces if a in f and b in f]
    labels = [np.bitwise_and.reduce(kind[f]) & 63 for f in at]
    bits = labels[0] | labels[1]
    kind = np.append(kind, np.uint8(bits | (ON_CAP if all(labels) else 0)))
    rest = [f for f in faces if not (a in f and b in f)]
    halves = [[v if w == old else w for w in f] for f in at for old in (a, b)]
    return x, np.array([*rest, *halves]), kind


def split_face(x, faces, kind, f, weights):
    """A new vertex inside a triangle."""
    a, b, c = faces[f]
    label = np.bitwise_and.reduce(kind[faces[f]]) & 63
    v = len(x)
    x = np.vstack([x, weights @ x[faces[f]]])
    kind = np.append(kind, np.uint8(label | ON_CAP if label else 0))
    faces = np.vstack([np.delete(faces, f, axis=0), [[a, b, v], [b, c, v], [c, a, v]]])
    return x, faces, kind


def spoilt(x, faces, kind, rng, count, worst=-9.0):
    """The mesh with `count` edges and faces split in bad places."""
    for _ in range(count):
        t = 10.0 ** rng.uniform(worst, -1.0)
        f = rng.integers(len(faces))
        if rng.random() < 0.5:
            a, b = rng.permutation(faces[f])[:2]
            x, faces, kind = split_edge(x, faces, kind, a, b, t)
        else:
            s = rng.uniform(0.3, 0.7)
            weights = rng.permutation([s * (1 - t), (1 - s) * (1 - t), t])
            x, faces, kind = split_face(x, faces, kind, f, weights)
    return x, faces, kind


def free(x):
    return np.zeros(len(x), np.uint8)


def box(n):
    """A box of n cells with the kinds of its vertices; every face is a cap."""
    axes = [np.linspace(0.0, 1.0, n + 1)] * 3
    c = contour_arrays(lambda p: np.full(len(p), -1.0), axes)
    return c.vertices, c.faces.astype(np.int64), c.kind


def lens(n=24, snap=0.7):
    """Two balls cut by each other and by a box, with the vertices near the crease snapped to it."""
    axes = [np.linspace(-0.6, 0.6, n + 1), np.linspace(-1.0, 1.0, n + 1), np.linspace(0.0, 0.9, n)]
    centres = np.array([[-0.4, 0.0, 0.0], [0.4, 0.0, 0.0]])

    def field(p):
        return np.linalg.norm(p[:, None] - centres, axis=2).max(axis=1) - 1.0

    c = contour_arrays(field, axes)
    x, h = c.vertices, 2.0 / n
    near = (np.abs(x[:, 0]) < snap * h) & (c.kind & ON_CAP == 0)
    radius = np.sqrt(1.0 - 0.4**2)
    x[near, 0] = 0.0
    x[near, 1:] *= radius / np.linalg.norm(x[near, 1:], axis=1)[:, None]
    on_floor = near & (c.kind & 16 != 0)
    x[on_floor, 1] = np.sign(x[on_floor, 1]) * radius
    split_quads(x, c.faces)
    return x, c.faces, c.kind


def repaired(x, faces, kind=None, **options):
    """`remove_slivers`, with the promises that hold for every mesh; the new mesh and the report."""
    given = faces.copy()
    r = remove_slivers(x, faces, kind, **options)
    assert np.array_equal(faces, given)
    assert r.faces.dtype == faces.dtype
    assert (np.diff(r.vertices) > 0).all()
    assert (np.diff(r.rows) > 0).all()
    assert len(r.rows) == len(r.faces)
    old, new = SurfaceMesh(x, faces), SurfaceMesh(x[r.vertices], r.faces)
    assert np.array_equal(np.unique(new.faces), np.arange(len(r.vertices)))
    for name in ("open_edges", "nonmanifold_edges", "nonmanifold_vertices", "euler", "components"):
        assert getattr(new, name) == getattr(old, name), name
    assert new.is_oriented
    quality = options.get("quality", QUALITY)
    assert r.left == (new.quality < quality).sum()
    assert new.quality.min() >= min(old.quality.min(), quality)
    assert len(old.vertices) - len(new.vertices) == r.collapses
    assert 2 * r.collapses == len(faces) - len(r.faces)
    return new, r


def feature_edges(faces, kind):
    """Edges between two surfaces, with the surfaces on both sides, as a naive set."""
    sides = {}
    for f in faces.tolist():
        label = int(np.bitwise_and.reduce(kind[f]) & 63)
        for a, b in zip(f, f[1:] + f[:1], strict=True):
            sides.setdefault(frozenset((a, b)), []).append(label)
    return {e: tuple(sorted(s)) for e, s in sides.items() if s[0] != s[1]}


# --- slivers made on purpose ---------------------------------------------------------------------


def test_good_mesh_is_left_alone():
    x, faces = sphere(3)
    r = remove_slivers(x, faces)
    assert r.faces is faces
    assert np.array_equal(r.vertices, np.arange(len(x)))
    assert (r.collapses, r.flips, r.left) == (0, 0, 0)


@pytest.mark.parametrize("dtype", [np.int32, np.int64])
@pytest.mark.parametrize("t", [0.0, 1e-12, 1e-4])
def test_short_edges_are_collapsed(t, dtype):
    x, faces = sphere(3)
    volume = SurfaceMesh(x, faces).volume
    kind, rng = free(x), np.random.default_rng(0)
    for _ in range(20):
        a, b = faces[rng.integers(len(faces))][:2]
        x, faces, kind = split_edge(x, faces, kind, a, b, t)
    new, r = repaired(x, faces.astype(dtype))
    assert r.left == 0
    assert r.collapses == 20
    assert new.quality.min() > 0.3
    assert new.volume == pytest.approx(volume, rel=1e-5)


@pytest.mark.parametrize("pinned", [False, True])
def test_triangles_in_a_row_are_flipped(pinned):
    """A vertex that lies on an opposite edge goes; where all vertices are needed, the edge does."""
    x, faces = sphere(3)
    volume = SurfaceMesh(x, faces).volume
    for f in range(0, 400, 40):  # faces are appended at the end, the one in question goes
        weights = np.array([0.5, 0.499999, 1e-6])
        x, faces, _ = split_face(x, faces, free(x), f, weights)
    kind = np.full(len(x), 5 if pinned else 0, np.uint8)
    new, r = repaired(x, faces, kind)
    assert r.left == 0
    assert (r.flips, r.collapses) == ((10, 0) if pinned else (0, 10))
    assert new.quality.min() > 0.3
    assert new.volume == pytest.approx(volume, rel=1e-3)


def test_faces_far_from_slivers_are_untouched():
    x, faces = sphere(4)
    x, spoilt_faces, kind = split_edge(x, faces, free(x), *faces[0, :2], 1e-5)
    new, r = repaired(x, spoilt_faces, kind)
    assert r.collapses == 1
    before = {tuple(f) for f in x[spoilt_faces].reshape(-1, 9).tolist()}
    after = {tuple(f) for f in new.vertices[new.faces].reshape(-1, 9).tolist()}
    assert len(before - after) < 15
    assert (spoilt_faces[r.rows] == r.vertices[r.faces]).all(axis=1).sum() > len(faces) - 15


@pytest.mark.parametrize("seed", range(6))
def test_box_keeps_its_shape_exactly(seed):
    x, faces, kind = spoilt(*box(5), np.random.default_rng(seed), 60)
    new, r = repaired(x, faces, kind)
    kept = kind[r.vertices]
    assert r.collapses > 20
    assert r.left == 0
    assert new.volume == pytest.approx(1.0, abs=1e-12)
    assert new.area == pytest.approx(6.0, abs=1e-11)
    for s in SIX:
        assert np.abs(new.vertices[kept >> s & 1 == 1, s // 2] - s % 2).max() < 1e-15
    corner = np.isin(new.vertices, (0.0, 1.0)).all(axis=1)  # none was added, none may go
    assert corner.sum() == 8
    edges = feature_edges(new.faces, kept)
    assert len(set(edges.values())) == 12
    length = sum(np.linalg.norm(np.subtract(*new.vertices[list(e)])) for e in edges)
    assert length == pytest.approx(12.0, abs=1e-11)


def test_constraints_are_needed_for_that():
    """The test above can fail: without kinds, vertices slip off the edges of the box."""
    x, faces, kind = spoilt(*box(3), np.random.default_rng(1), 60)
    r = remove_slivers(x, faces, free(x), quality=0.4)
    assert abs(SurfaceMesh(x[r.vertices], r.faces).volume - 1.0) > 1e-6
    r = remove_slivers(x, faces, kind, quality=0.4)
    assert abs(SurfaceMesh(x[r.vertices], r.faces).volume - 1.0) < 1e-12


def test_rims_between_wall_and_caps_stay():
    x, faces, kind = lens(16, snap=0.0)
    before = SurfaceMesh(x, faces)
    rng = np.random.default_rng(3)
    rim = [tuple(e) for e in feature_edges(faces, kind)]
    faces = faces.astype(np.int64)
    for i in rng.permutation(len(rim))[:25]:
        x, faces, kind = split_edge(x, faces, kind, *rim[i], 10.0 ** rng.uniform(-9, -4))
    new, r = repaired(x, faces, kind, quality=0.02)
    assert r.left == 0
    assert r.collapses >= 20
    assert new.volume == pytest.approx(before.volume, rel=1e-5)
    old_labels = set(feature_edges(faces, kind).values())
    kept = kind[r.vertices]
    edges = feature_edges(new.faces, kept)
    assert set(edges.values()) == old_labels
    for edge, (low, high) in edges.items():  # a curve runs through vertices that lie on both
        for v in edge:
            assert kept[v] & low == low
            assert kept[v] & high == high
            assert low > 0 or not kept[v] & ON_CAP


@settings(max_examples=50)
@given(
    seed=st.integers(0, 10**6),
    shape=st.sampled_from(["sphere", "torus", "box", "two"]),
    quality=st.sampled_from([0.005, 0.02, 0.1, 0.3]),
)
def test_promises_hold_for_random_slivers(seed, shape, quality):
    rng = np.random.default_rng(seed)
    if shape == "box":
        x, faces, kind = box(3)
    else:
        x, faces = {"sphere": sphere(2), "torus": torus(12, 8), "two": joined(
            sphere(1), (sphere(1)[0] + 3.0, sphere(1)[1])
        )}[shape]  # fmt: skip
        kind = free(x)
    x, faces, kind = spoilt(x, faces, kind, rng, 25)
    volume = SurfaceMesh(x, faces).volume
    new, r = repaired(x, faces, kind, quality=quality)
    if shape == "box":
        assert new.volume == pytest.approx(1.0, abs=1e-12)
    else:
        assert new.volume == pytest.approx(volume, rel=0.05 if quality < 0.2 else 0.3)
    again = remove_slivers(x, faces.astype(np.int32), kind, quality=quality)
    assert np.array_equal(again.faces, r.faces)
    assert np.array_equal(again.vertices, r.vertices)


@pytest.mark.parametrize("seed", range(20))
def test_only_changes_nearby_make_a_second_try_worthwhile(seed, monkeypatch):
    x, faces, kind = spoilt(*box(3), np.random.default_rng(seed), 60)
    r, once = remove_slivers(x, faces, kind), kernels.repair

    def always(*args):
        *_, tried, _ = args
        tried[:] = -1
        once(*args)

    monkeypatch.setattr(kernels, "repair", always)
    again = remove_slivers(x, faces, kind)
    assert (r.collapses, r.flips, r.left) == (again.collapses, again.flips, again.left)
    assert np.array_equal(r.faces, again.faces)


# --- what must not happen ------------------------------------------------------------------------


def test_tetrahedron_stays():
    x = np.array([[0.0, 0, 0], [1, 0, 0], [1e-9, 1e-9, 0], [0, 0, 1]])
    faces = np.array([[0, 2, 1], [0, 1, 3], [1, 2, 3], [2, 0, 3]])
    new, r = repaired(x, faces)
    assert len(new.faces) == 4
    assert r.left > 0


@pytest.mark.parametrize("n", [3, 9])
def test_thin_tubes_do_not_close(n):
    """Cross-sections of three vertices: every edge around is short, and no triangle fills it.

    A collapse that ignores this would leave a sphere, or edges of four triangles.
    """
    x, faces = torus(n, 3, major=1.0, minor=1e-3)
    new, r = repaired(x, faces)
    assert new.genus == 1
    assert r.left > 0


@pytest.mark.parametrize("pinned", [False, True])
def test_open_boundaries_stay(pinned):
    """Also where the vertices next to them cannot go."""
    x, faces = sphere(3)
    faces = faces[x[faces][:, :, 2].min(axis=1) >= 0]
    rim = np.unique(SurfaceMesh(x, faces).faulty_edges())
    kind, count = free(x), len(x)
    rng = np.random.default_rng(5)
    for _ in range(30):
        a, b = rng.permutation(faces[rng.integers(len(faces))])[:2]
        if not {a, b} <= set(rim.tolist()):
            x, faces, kind = split_edge(x, faces, kind, a, b, 1e-5)
    kind[count:] = 5 if pinned else 0
    used = np.unique(faces)
    x, kind = x[used], kind[used]
    faces = np.searchsorted(used, faces)
    loop = x[np.unique(SurfaceMesh(x, faces).faulty_edges())]
    new, r = repaired(x, faces, kind)
    if pinned:
        left = {tuple(p) for p in new.vertices}
        assert all(tuple(p) in left for p in x[kind == 5])
    else:
        assert r.collapses >= 20
        assert r.left == 0
    assert np.array_equal(new.vertices[np.unique(new.faulty_edges())], loop)


def test_pits_in_caps_are_not_filled():
    """A wall vertex just inside a cap, over a triangle of rims: merged, it would become a cap."""
    x, faces, kind = box(3)
    floor = np.flatnonzero((kind[faces] & 63 == 16).all(axis=1))[0]
    rim = faces[floor]
    kind[rim] = 16
    apex = np.array([0.0, 0.0, 1e-4]) + [0.998, 0.001, 0.001] @ x[rim]
    x, kind = np.vstack([x, apex]), np.append(kind, np.uint8(0))
    tent = [[*np.roll(rim, -i)[:2], len(x) - 1] for i in range(3)]
    faces = np.vstack([np.delete(faces, floor, axis=0), tent])
    new, r = repaired(x, faces, kind)
    assert r.left == 2
    assert np.array_equal(new.faces, faces)


def test_vertices_of_different_surfaces_are_not_merged():
    x, faces = sphere(3)
    a, b = faces[7, :2]
    kind = free(x)
    x, faces, kind = split_edge(x, faces, kind, a, b, 1e-5)
    kind[a] = ON_CAP | 16
    _, r = repaired(x, faces, kind)
    assert a in r.vertices
    kind[-1] = 5
    _, r = repaired(x, faces, kind)
    assert r.left == 2
    assert r.collapses == 0


def test_no_chords_across_caps():
    """Two vertices on one face of the domain, far from each other, with walls in between."""
    x, faces = sphere(2)
    a = 40
    ring = sorted(set(faces[(faces == a).any(axis=1)].ravel()) - {a})
    b = ring[0]
    p = ring[np.argmax(np.linalg.norm(x[ring] - x[b], axis=1))]
    x[a] = x[b] + 1e-4 * (x[a] - x[b])
    kind = free(x)
    kind[[b, p]] = 16
    new, r = repaired(x, faces, kind)
    b, p = np.searchsorted(r.vertices, [b, p])
    assert not ((new.faces == b).any(axis=1) & (new.faces == p).any(axis=1)).any()


def test_no_flips_to_chords_across_caps():
    x, faces = sphere(2)
    x, faces, _ = split_face(x, faces, free(x), 0, np.array([0.5, 0.499999, 1e-6]))
    a, b, v = faces[-3]
    (other,) = (f for f in faces if {a, b} <= set(f) and v not in f)
    (d,) = set(other) - {a, b}
    kind = np.full(len(x), 5, np.uint8)
    assert repaired(x, faces, kind)[1].flips == 1
    kind[[v, d]] |= 16
    assert repaired(x, faces, kind)[1].flips == 0


def test_triangles_do_not_turn_over():
    """A sliver on the edge of a cube without constraints: no face may turn by 90 degrees."""
    x, faces, _ = box(2)
    kind = free(x)
    for e in list(feature_edges(faces, box(2)[2]))[:10]:
        x, faces, kind = split_edge(x, faces, kind, *e, 1e-3)
    new, r = repaired(x, faces, kind)
    assert r.collapses > 0
    p = new.vertices[new.faces]
    normal = np.cross(p[:, 1] - p[:, 0], p[:, 2] - p[:, 0])
    assert np.einsum("ij,ij->i", normal, p.mean(axis=1) - 0.5).min() > 0
    assert len(crossings(new.vertices, new.faces)) == 0


# --- slivers as they come about ------------------------------------------------------------------


@pytest.mark.parametrize("snap", [0.6, 0.9])
def test_vertices_snapped_to_a_crease(snap):
    x, faces, kind = lens(snap=snap)
    old = SurfaceMesh(x, faces)
    assert (old.quality < 1e-3).sum() > 20
    new, r = repaired(x, faces, kind)
    assert new.quality.min() > 0.01
    assert new.volume == pytest.approx(old.volume, rel=1e-3)
    assert len(crossings(new.vertices, new.faces)) <= len(crossings(x, faces))
    flat = np.isclose(new.vertices[:, 2], 0.0, atol=1e-12)
    assert np.array_equal(flat, kind[r.vertices] & 16 != 0)


def wall_of(name, d):
    if name == "gyroid torus":
        return il.Lattice(
            il.tiles["gyroid"], through=il.macroshape.torus(), repeat=(8, 1, 1)
        ).offset(d)
    return il.Lattice(il.tiles[name], through=il.macroshape.box(), repeat=(1, 1, 1)).offset(d)


def none_cross(*arrays, **_):
    return 0, np.zeros(len(arrays[1]), bool)


def untouched(x, faces, _, *, spared):
    assert not spared.any()
    return Repair(np.arange(len(x)), faces, np.arange(len(faces)), 0, 0, 0)


@pytest.mark.filterwarnings("ignore:the mesh with h=")  # coarse
@pytest.mark.parametrize(
    ("name", "d", "h"),
    [("gyroid torus", 0.2, 0.12), ("p_j", 0.05, 0.02), ("s", 0.1, 0.02), ("d_prime", 0.05, 0.03)],
)
def test_walls_have_no_slivers(name, d, h, monkeypatch):
    wall = wall_of(name, d)
    mesh = wall.mesh(h)
    monkeypatch.setattr(uncrossing, "remove_slivers", untouched)
    monkeypatch.setattr(uncrossing, "self_intersections", none_cross)
    before = wall.mesh(h)  # slivers may cross: that does not move vertices here
    assert mesh.quality.min() >= min(QUALITY, 0.01)
    assert mesh.is_watertight
    assert mesh.is_oriented
    assert mesh.nonmanifold_vertices == 0
    assert mesh.euler == before.euler
    assert mesh.volume == pytest.approx(before.volume, rel=1e-5)
    data = mesh.point_data
    u = np.stack([data[k] for k in "uvw"], axis=1)
    x = wall.lattice.through.x(u)
    assert np.abs(x - mesh.vertices).max() < 1e-12
    single = mesh.vertices.astype(np.float32)[mesh.faces]
    assert all((single[:, i] != single[:, i - 1]).any(axis=1).all() for i in range(3))


def test_repair_of_a_wall_makes_no_crossings():
    wall = wall_of("q_star", 0.1)
    mesh = wall.mesh(0.03)
    assert mesh.quality.min() > 0.01
    assert len(crossings(mesh.vertices, mesh.faces)) == 0


# --- vertices that stray -------------------------------------------------------------------------


@pytest.mark.filterwarnings("ignore:the mesh with h=")  # coarse
def test_feet_that_a_spline_tells_lead_to_the_same_places():
    wall = wall_of("gyroid", 0.05)
    raw = wall.mesh(0.06, polish=False)
    u = np.stack([raw.point_data[k] for k in "uvw"], axis=1)
    side = raw.point_data["side"].astype(float)
    for sign in (1.0, -1.0):
        at = np.flatnonzero(side == sign)
        given = wall.lattice, u[at], np.zeros((len(at), 3), bool), side[at]
        alone, off = polish(*given, wall.thickness.side(sign))
        told, left = polish(*given, wall.thickness.side(sign), None, wall.distance)
        fine = off < 1e-8
        assert fine.mean() > 0.99
        assert (left[fine] < 1e-8).all()
        apart = np.abs(told - alone)[fine].max(axis=1)
        assert np.minimum(apart, 1.0 - apart).max() < 1e-6


def test_vertices_that_stray_keep_their_place(monkeypatch):
    """Far moves, misses and lost vertices are undone and counted; others are kept."""
    wall = wall_of("gyroid", 0.05)
    raw = wall.mesh(0.05, polish=False)
    u = np.stack([raw.point_data[k] for k in "uvw"], axis=1)
    side = raw.point_data["side"].astype(float)
    kind = np.zeros(len(u), np.uint8)
    axes = (np.linspace(0, 1, 21),) * 3
    out = np.flatnonzero(side > 0)

    def moved(_, u, fixed, side, *thickness):
        assert fixed.shape == u.shape
        assert len(thickness) == 3
        new, residual = u + 0.01, np.zeros(len(u))
        if side[0] > 0:
            new[0, 1] += 0.3
            residual[1] = 6e-6
            residual[2] = np.inf
            residual[3] = 4e-6
        return new, residual

    monkeypatch.setattr(_projecting, "polish", moved)
    new, lost = _projecting.projected(wall, axes, u, kind, side, exactly=False)
    assert np.array_equal(np.flatnonzero(lost), out[:3])
    assert np.array_equal(new[out[:3]], u[out[:3]])
    rest = np.setdiff1d(np.flatnonzero(side), out[:3])
    assert np.abs(new[rest] - u[rest] - 0.01).max() < 1e-12


def test_held_vertices_are_marked_and_counted(monkeypatch):
    """Those that are off the offset; more than a few and a thousandth are refused."""
    wall = wall_of("gyroid", 0.05)
    projected = wall_mesh.projected

    def some(wall, axes, u, kind, side, *, exactly):
        new, lost = projected(wall, axes, u, kind, side, exactly=exactly)
        half = len(u) // 2
        lost[half : half + many] = True  # of these some are off, and some are not
        new[half : half + many // 2] = 0.998 * new[half : half + many // 2] + 0.001
        return new, lost

    monkeypatch.setattr(wall_mesh, "projected", some)
    many = 20
    mesh = wall.mesh(0.05)
    u = np.stack([mesh.point_data[k] for k in "uvw"], axis=1)
    side, unconverged = mesh.point_data["side"] != 0, mesh.point_data["unconverged"] != 0
    off = np.zeros(len(u), bool)
    off[side] = np.abs(np.abs(wall.lattice.distance(u[side])) - 0.05) > 1e-4 * 0.05
    assert 0 < off.sum() == unconverged.sum() <= 10
    assert np.array_equal(off, unconverged)
    many = 60
    with pytest.raises(ConvergenceError, match=f" of {len(u)} vertices are off the offset"):
        wall.mesh(0.05)
    with (
        pytest.warns(PrecisionWarning, match="vertices could not be moved"),
        pytest.raises(ConvergenceError, match="vertices are off the offset"),
    ):
        list(wall_mesh.wall_pieces(wall, 0.05, polish=True, progress=None))


def test_far_is_measured_in_cells_and_spans_and_across_seams():
    spline = SimpleNamespace(breaks=lambda axis: np.linspace(0.0, 1.0, [51, 6, 51][axis]))
    through = SimpleNamespace(closed=(True, False, False))
    lattice = SimpleNamespace(domain=np.array([[0.0] * 3, [1.0] * 3]), through=through)
    wall = SimpleNamespace(distance=spline, lattice=lattice)
    graded = np.concatenate([np.linspace(0.0, 0.1, 11), np.linspace(0.2, 1.0, 9)])
    axes = (np.linspace(0, 1, 101), np.linspace(0, 1, 101), graded)
    u = np.full((7, 3), 0.5)
    u[:, 2] = 0.05
    moved = u.copy()
    moved[1, 0] += 0.06  # six cells
    moved[2, 1] += 0.06  # six cells, but less than a span
    moved[3, 1] -= 0.25
    moved[4, 2] += 0.06
    u[5, 2], moved[5, 2] = 0.95, 0.89  # less than a cell of there
    u[6, 0], moved[6, 0] = 0.005, 0.995  # across the seam
    far = _projecting.strayed(wall, axes, u, moved)
    assert far.tolist() == [False, True, False, True, True, False, False]
