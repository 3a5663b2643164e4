"""Solids of graphs against the catalogue, exact distances and each other."""

from dataclasses import replace

import numpy as np
import pytest
from graphs import HEXAGON, loop, schwarz_p, strut
from scipy.interpolate import CubicSpline
from scipy.optimize import brentq

import ilattice as il
from ilattice.errors import GraphError, InputError, PrecisionWarning
from ilattice.graph.curves import curve_of
from ilattice.minimal.disc import Disc, vertex_normals
from ilattice.tiles.cells import CELLS, make

g = il.graph
RNG = np.random.default_rng(5)
POINTS = RNG.random((4000, 3))
ROWS = {row.name: row for row in CELLS}


@pytest.mark.parametrize(
    ("name", "cell", "radius"),
    [
        ("octet", "octet", 0.03),
        ("bcc", "bcc_struts", 0.05),
        ("simple_cubic", "sc_struts", 0.06),
        ("kelvin", "kelvin", 0.04),
        ("fcc", "fcc_struts", 0.04),
        ("auxetic3d", "re_entrant", 0.04),
    ],
)
def test_trusses_are_those_of_the_catalogue(name, cell, radius):
    graph = g.library[name]
    want = make(ROWS[cell], radius=radius, blend=0.0).field(POINTS)
    assert np.abs(graph.body.field(POINTS) - want).max() < 1e-12


@pytest.mark.parametrize("name", sorted(g.library))
def test_the_library_is_valid_and_repeats(name):
    graph = g.library[name]
    assert graph.name == name
    assert graph.about["status"] in ("exact", "reconstructed", "known")
    assert graph.count >= 9
    if "paper" in graph.about and graph.about["status"] == "exact":
        assert graph.count <= int(graph.about["paper"].split()[0])


def test_counts_of_the_paper():
    for name, count in (("schwarz_p", 13), ("schoen_iwp", 14), ("schwarz_d", 12), ("octet", 12)):
        assert g.library[name].count == count
    with pytest.raises(InputError, match="cannot be reconstructed"):
        g.library["chen_alpha_delta"]
    assert len(set(g.library) - {"bcc", "fcc", "kelvin", "simple_cubic"}) == 24
    assert len(g.library.missing) == 7
    with pytest.raises(InputError, match="'schwartz_p'; the nearest are schwarz_p, "):
        g.library["schwartz_p"]


def clp_area():
    """Area of CLP in the cell of schwarz_clp, from w² = t⁸ - 2 cos(a) t⁴ + 1.

    Edges along the axis of order 4, and across it, are integrals along arcs of the Gauss sphere; a
    is that for which they are equal.
    """
    x, w = np.polynomial.legendre.leggauss(200)
    x, w = 0.5 * (x + 1.0), 0.5 * w

    def edges(a):
        s = 0.5 * np.pi * x
        turn = np.cos(s) / np.sqrt(2.0 * (np.cos(a * np.sin(s)) - np.cos(a)))
        across = (1.0 + x * x) / np.sqrt(x**8 - 2.0 * np.cos(a) * x**4 + 1.0)
        return w @ across, 0.5 * np.pi * a * (w @ turn)

    a = brentq(lambda a: np.subtract(*edges(a)), 0.1, 3.0)
    total = 0.0
    for sign, length in ((-1, a / 4), (1, (np.pi - a) / 4)):  # about the branch point
        r, phi = 1.0 - x[:, None] ** 2, a / 4 + sign * length * x**2
        t = r**4 * np.exp(4j * phi)
        f = 4 * r * (1 + r * r) ** 2 / np.abs(t * t - 2 * np.cos(a) * t + 1)
        total += length * w @ (f * np.outer(x, x)) @ w
    return 4 * 4 * total * (0.5 / edges(a)[0]) ** 2


#: Euler number and area per cell, from the Weierstrass representations.
SURFACES = {
    "schwarz_p": (-4, 2.34511), "neovius": (-16, 3.51048), "schoen_iwp": (-12, 3.46410),
    "gyroid": (-8, 3.09141), "schwarz_d": (-2, 1.91889), "schwarz_clp": (-2, clp_area()),
}  # fmt: skip
#: Cells that repeat in the unit cube, and the genus in each.
GENERA = {
    "wei_genus_4": (1, 4), "schoen_s_s": (2, 4), "deformed_schoen_s_s": (8, 4),
    "schoen_r2": (3, 9), "deformed_h": (4, 3),
}  # fmt: skip


@pytest.mark.parametrize("name", sorted(SURFACES))
def test_surfaces_have_their_genus_and_area(name):
    surface = g.library[name].body.surface
    euler, area = SURFACES[name]
    assert surface.euler == euler
    assert surface.area == pytest.approx(area, rel=1.2e-3)
    assert surface.is_closed
    assert surface.separates == (name not in ("schwarz_d", "schwarz_clp"))


@pytest.mark.parametrize("name", sorted(GENERA))
def test_surfaces_of_families_have_their_genus(name):
    surface = g.library[name].body.surface
    copies, genus = GENERA[name]
    assert surface.euler == copies * (2 - 2 * genus)
    assert surface.components == 1
    assert surface.separates
    patch = g.library[name].patches()[0]
    assert patch.report.residual < 1e-8
    bent = np.abs(patch.mean_curvature[: patch.disc.boundary])
    assert np.median(bent) * np.linalg.norm(np.ptp(patch.vertices, axis=0)) < 0.05


def test_stessmanns_surface_is_isometric_to_schoens_iwp():
    film = g.library["steffmann"].patches()[0]
    partner = g.library["schoen_iwp"].patches()[0]
    known = 3.46410 / 16  # of the area of its cell
    edge = partner.report.lengths[0]
    assert film.area == pytest.approx(known * (0.5 / edge) ** 2, rel=4e-3)
    sides = np.linalg.norm(film.corners - np.roll(film.corners, -1, axis=0), axis=1)
    assert np.allclose(sides / sides[0], partner.report.lengths / edge, rtol=1e-3)


def test_lines_have_a_linear_radius_along_their_length():
    v = [g.vertex(p) for p in ((0.1, 0.5, 0.5), (0.4, 0.5, 0.5), (0.4, 0.9, 0.5))]
    line = g.line(g.chain(v), thickness=[(0, 0.05), (0.5, 0.1), (1, 0.05)])
    struts = g.Graph(g.object(line)).shape.struts
    ends = struts[:, :, [0, 1, 3]].reshape(-1, 3)
    assert np.abs(ends - (0.4, 0.55, 0.05)).max(axis=1).min() < 1e-12  # half of the way
    assert ends[:, 2].max() == pytest.approx(0.05)
    third = [end for s in struts for end in s if np.allclose(end[:3], v[1].position)]
    assert np.allclose([t[3] for t in third], 0.025 * (1 + 0.3 / 0.35))


def test_smooth_chains_are_cubic_splines():
    p = RNG.random((5, 3))
    v = [g.vertex(q) for q in p]
    t = np.concatenate([[0], np.cumsum(np.linalg.norm(np.diff(p, axis=0), axis=1))])
    s = np.linspace(0, t[-1], 50)
    want = CubicSpline(t, p, bc_type="natural")(s)
    assert np.abs(curve_of(g.chain(v, smooth=True))(s) - want).max() < 1e-12
    ring = curve_of(g.chain(v, smooth=True, closed=True))
    ends = ring.domain.ravel()
    _, d, dd = ring.jet(ends, 2)
    assert np.abs(d[0] - d[1]).max() < 1e-12
    assert np.abs(dd[0] - dd[1]).max() < 1e-10
    three = curve_of(g.chain(v[:3], smooth=True))
    assert three.k == (2,)
    assert np.abs(three([0.0, 0.5, 1.0]) - p[:3]).max() < 1e-15
    across = [g.vertex(q) for q in ((0, 0.5, 0.5), (0.3, 0.6, 0.5), (0.7, 0.3, 0.5), (1, 0.5, 0.5))]
    wave = curve_of(g.chain(across, smooth=True))
    ends = wave.domain.ravel()
    _, d, dd = wave.jet(ends, 2)
    assert np.abs(d[0] - d[1]).max() < 1e-12
    assert np.abs(dd[0] - dd[1]).max() < 1e-10


def test_radii_of_bent_beams_follow_their_length():
    v = [g.vertex(p) for p in ((0.1, 0.1, 0.5), (0.8, 0.2, 0.5), (0.9, 0.9, 0.6), (0.2, 0.7, 0.5))]
    profile = [(0, 0.1), (0.3, 0.2), (1, 0.1)]
    bend = g.Graph(g.object(g.line(g.chain(v, smooth=True), thickness=profile))).shape.bends[0]
    t = np.linspace(*bend.spline.domain.ravel(), 20_001)
    steps = np.linalg.norm(np.diff(bend.spline(t), axis=0), axis=1)
    s = np.concatenate([[0], np.cumsum(steps)]) / steps.sum()
    want = 0.5 * np.interp(s, *np.array(profile).T)
    assert np.abs(bend.radius(t) - want).max() < 1.1e-3 * want.max()


def test_a_line_without_length_is_a_ball():
    graph = g.Graph(g.object(strut((0.2, 0.3, 0.4), (0.2, 0.3, 0.4), 0.5)))
    off = POINTS - (0.2, 0.3, 0.4)
    off -= np.rint(off)
    assert np.abs(graph.body.field(POINTS) - (np.linalg.norm(off, axis=1) - 0.25)).max() < 1e-15


def way(*points, **options):
    return g.chain([g.vertex(p) for p in points], **options)


CONE = [(0.0, 0.05), (1.0, 0.25)]
ARCH = ((0.2, 0.1, 0.5), (0.5, 0.3, 0.5), (0.8, 0.1, 0.5))
TILTED = way((0.3, 0.3, 0.3), (0.7, 0.3, 0.7), (0.7, 0.7, 0.7), (0.3, 0.7, 0.3), closed=True)
COUPLES = {
    "an arch and its image": g.line(way(*ARCH, smooth=True), thickness=CONE).mirrored("x"),
    "sheets that cross": g.surface(TILTED, thickness=0.03, edges=3).mirrored("z"),
    "a sheet in two thicknesses": g.group(
        [g.surface(TILTED, thickness=t, edges=3) for t in (0.03, 0.12)]
    ),
}


@pytest.mark.parametrize("name", COUPLES)
def test_what_is_alike_but_not_the_same_is_all_there(name):
    both = COUPLES[name]
    if isinstance(both, g.Group):
        parts = both.skeletons
    else:
        parts = (both.skeleton, replace(both, copy=False))
    fields = [g.Graph(g.object(k)).body.field for k in (both, *parts)]
    whole, one, two = (field(POINTS[:500]) for field in fields)
    assert np.abs(one - two).max() > 1e-3
    assert np.abs(whole - np.minimum(one, two)).max() < 1e-12


def test_a_ball_has_the_largest_thickness_of_its_line():
    ball = g.line(way((0.3, 0.4, 0.5), (0.3, 0.4, 0.5)), thickness=CONE)
    field = g.Graph(g.object(ball)).body.field
    assert field([[0.3, 0.4, 0.5]])[0] == pytest.approx(-0.125)


def test_booleans_are_those_of_signs():
    balls = [(RNG.random(3), RNG.uniform(0.3, 0.9)) for _ in range(3)]
    objects = [g.object(strut(c, c, d)) for c, d in balls]
    inside = []
    for c, d in balls:
        off = POINTS - c
        off -= np.rint(off)
        inside.append(np.linalg.norm(off, axis=1) < 0.5 * d)
    a, b, c = inside
    for made, want in (
        (g.union(*objects), a | b | c),
        (g.intersection(*objects[:2]), a & b),
        (g.difference(*objects), a & ~b & ~c),
        (g.difference(objects[0], g.intersection(*objects[1:])), a & ~(b & c)),
    ):
        body = g.Graph(made).body
        assert ((body.field(POINTS) < 0) == want).all()
        assert ((body.field.up_to(1e-9, POINTS) < 0) == want).all()
        box = body.field.range(POINTS - 0.01, POINTS + 0.01)
        value = body.field(POINTS)
        assert (box[:, 0] <= value).all()
        assert (value <= box[:, 1]).all()


def test_voxels_repeat_and_are_written(tmp_path):
    graph = g.Graph(g.voxel(g.object(strut(b=(1, 1, 1), thickness=0.3)), young=3.0))
    solid = graph.voxels(16)
    a = (np.arange(16) + 0.5) / 16
    u = np.stack(np.meshgrid(a, a, a, indexing="ij"), axis=-1).reshape(-1, 3)
    assert (solid.ravel() == (graph.body.field(u) < 0)).all()
    faces = RNG.random((500, 3))
    for axis in range(3):
        low, high = faces.copy(), faces.copy()
        low[:, axis], high[:, axis] = 0.0, 1.0
        assert np.abs(graph.body.field(low) - graph.body.field(high)).max() < 1e-15
    graph.save_voxels(tmp_path / "v.vti", 16)
    want = il.homogenize.voxels(solid, young=1.0, estimate=False)
    assert il.homogenize.voxels(tmp_path / "v.vti", estimate=False).density == want.density


@pytest.mark.parametrize("name", ["schwarz_p", "bcc_6_hole", "assembled3", "fcc_solid"])
@pytest.mark.parametrize("count", [5, 37])
def test_blocks_of_voxels_tell_the_sign_of_each(name, count):
    body = g.library[name].thickened(factor=1.7).body
    a = (np.arange(count) + 0.5) / count
    u = np.stack(np.meshgrid(a, a, a, indexing="ij"), axis=-1).reshape(-1, 3)
    assert (body.voxels(count).ravel() == (body.field(u) < 0)).all()


def test_copies_turn_as_they_should():
    turned = strut((0.5, 0.5, 0), (1, 0.5, 0)).moved(
        angle=np.pi / 2, axis="z", origin=(0.5, 0.5, 0)
    )
    ends = g.Graph(g.object(turned)).shape.struts[0, :, :3]
    assert np.allclose(np.sort(ends, axis=0), [[0.5, 0.5, 0], [0.5, 1, 0]])
    both = strut((0, 0, 0), (0.5, 0, 0)).mirrored("x").mirrored((1, -1, 0))
    shape = g.Graph(g.object(both)).shape
    assert len(shape.struts) == 4
    square = g.surface(loop([(0, 0, 0.5), (0.5, 0, 0.5), (0.5, 0.5, 0.5), (0, 0.5, 0.5)]), edges=4)
    body = g.Graph(g.object(square.mirrored("x").mirrored("y"))).body
    assert np.abs(body.field(POINTS) - (np.abs(POINTS[:, 2] - 0.5) - 0.01)).max() < 1e-12
    assert body.surface.is_closed


def test_a_tetrahedron_completes_to_48_images():
    random = strut((0.1, 0.05, 0.02), (0.4, 0.3, 0.2)).completed(g.tetrahedron())
    assert len(g.Graph(g.object(random)).shape.struts) == 48
    with pytest.raises(GraphError, match="completed needs"):
        strut().completed(g.tetrahedron(192))


def test_tiles_have_two_sides_or_are_solids():
    graph = schwarz_p(thickness=0.1)
    tile = graph.tile()
    assert tile.name == "graph"
    body = graph.body
    assert body.half_thickness == pytest.approx(0.05)
    u = POINTS[:500]
    near = np.abs(tile(u)) < 0.04
    assert np.abs(np.abs(tile(u)) - 0.05 - body.field(u))[near].max() < 8e-3  # facets of n = 4
    film = g.surface(loop(HEXAGON), thickness=0.2, edges=4)
    solid = g.Graph(g.object(film)).tile()
    assert type(solid.field).__name__ == "SkeletonField"
    assert ((solid(u) < 0).mean() > 0.01) & ((solid(u) > 0).mean() > 0.5)


def test_the_tile_of_schwarz_p_is_that_of_its_region():
    faces = il.minimal.cuboid().faces("x+ z- y+ x- z+ y-")
    want = il.minimal.conjugate(faces, 8).completed().tile()
    tile = schwarz_p().tile()
    assert np.abs(np.abs(tile(POINTS)) - np.abs(want(POINTS))).max() < 1e-4
    assert schwarz_p().body.surface.euler == -4


def test_thickness_over_a_surface_is_met_at_its_places():
    places = [((0.0, 0.0), 0.3), ((1.0, 0.0), 0.1), ((-0.5, 0.0), 0.2)]
    film = g.surface(loop(HEXAGON), kind="conjugate", thickness=places, edges=8)
    sheet = g.Graph(g.object(film), within=g.cuboid()).evaluate("s1").sheets[0]
    assert sheet.radius[0] == pytest.approx(0.15)
    assert sheet.radius.min() >= 0.05 - 1e-12
    assert sheet.radius.max() <= 0.15 + 1e-12


def test_extrusion_along_normals_is_refused_where_it_differs():
    patch = g.surface(loop(HEXAGON), kind="conjugate", edges=4, thickness=0.05)
    whole = patch.completed(g.cuboid())
    body = g.Graph(g.object(whole, extrusion="normal"), within=g.cuboid()).body
    same = g.Graph(g.object(whole), within=g.cuboid()).body
    assert (body.field(POINTS[:200]) == same.field(POINTS[:200])).all()
    for skeleton in (strut(), patch):
        with pytest.raises(GraphError, match="spherical") as e:
            _ = g.Graph(g.object(skeleton, extrusion="normal"), within=g.cuboid()).body
        assert e.value.node == "object 'obj1'"


def test_homogenized_by_voxels_and_cells():
    graph = g.library["bcc"].thickened(0.3)
    voxel = graph.homogenize(24, method="voxels", estimate=False)
    assert voxel.symmetry == "cubic"
    assert voxel.C[0, 0] > 0
    assert graph.count == g.library["bcc"].count
    solid = g.Graph(
        g.stiffness(g.voxel(g.object(strut(b=(1, 1, 1), thickness=0.6), resolution=12)))
    )
    with pytest.warns(PrecisionWarning, match="the voxels are too coarse"):
        again = solid.homogenize(12, method="voxels")
    with pytest.warns(PrecisionWarning, match="the voxels are too coarse"):
        own = solid.stiffness()
    assert np.abs(own.C - again.C).max() < 1e-12
    with pytest.raises(GraphError, match="needs a material matrix"):
        graph.stiffness()
    with pytest.raises(GraphError, match="needs a phononic"):
        graph.bandgap()


def test_ways_and_random_graphs():
    tetrahedron = g.ways(g.tetrahedron(), 4)
    assert len(tetrahedron) == 3  # P, Neovius, I-WP
    six = g.ways(g.cuboid(), 6)
    assert any(set(w.numbers) == set(range(6)) for w in six)
    for kind in ("truss", "direct", "asymmetric"):
        for seed in range(3):
            graph = g.random_graph(kind, seed, thickness=0.05)
            assert graph.digest == g.random_graph(kind, seed, thickness=0.05).digest
            assert 0 < graph.voxels(12).mean() < 1
    surfaces = [g.random_graph("conjugate", s) for s in range(2)]
    assert surfaces[0].digest != surfaces[1].digest


def test_there_are_1205_topologies_and_their_images_keep_the_rules():
    many = g.topologies()
    assert len(many) == len(set(many)) == 1205  # as counted by Panetta et al.
    for number in RNG.integers(0, 1205, 12):
        ends = g.truss(int(number)).shape.struts[:, :, :3]
        keys = np.rint(np.mod(ends + 1e-9, 1.0) * 240).astype(int) % 240
        nodes, row = np.unique(keys.reshape(-1, 3), axis=0, return_inverse=True)
        valence = np.bincount(row.ravel())
        assert 2 <= valence.min() <= valence.max() <= 7
        links = row.reshape(-1, 2)
        label = np.arange(len(nodes))
        for _ in range(len(nodes)):
            low = np.minimum(label[links[:, 0]], label[links[:, 1]])
            np.minimum.at(label, links[:, 0], low)
            np.minimum.at(label, links[:, 1], low)
        assert len(np.unique(label)) == 1


@pytest.mark.filterwarnings("ignore:the solid does not go on")
@pytest.mark.filterwarnings("ignore:the voxels are too coarse")
def test_exploration_goes_on_where_it_was(tmp_path):
    file = tmp_path / "t.csv"
    first = g.explore("truss", [1, 2], thickness=0.2, cells=8, table=file)
    again = g.explore("truss", [1, 2, 5], thickness=0.2, cells=8, table=file)
    assert len(again) == 3
    assert (first["density"] == again["density"][:2]).all()
    want = g.random_graph("truss", 5, thickness=0.2).voxels(8).mean()
    assert again["density"][2] == pytest.approx(want)


def test_pictures_are_drawn(tmp_path):
    graph = g.Graph(g.object(strut(b=(1, 1, 1), thickness=0.3)))
    figure = graph.plot()
    assert len(figure.axes) == 4
    figure.savefig(tmp_path / "g.png", dpi=40)
    assert len(graph.plot(stages=False).axes) == 1
    thin = schwarz_p(thickness=0.02).plot().axes[3]
    assert not thin.texts  # of why there is no picture
    assert len(thin.collections) == 1
    assert len(g.contact_sheet([graph] * 3, columns=2).axes) == 3


def test_meshes_are_closed():
    mesh = g.Graph(g.object(strut(b=(1, 1, 1), thickness=0.3))).mesh(0.05)
    assert mesh.is_watertight
    assert np.ptp(mesh.vertices, axis=0).max() <= 1.0 + 1e-9


def test_commands(tmp_path, capsys):
    from ilattice.cli import main
    from ilattice.graph.job import run

    graph = g.Graph(g.object(strut(b=(1, 1, 1), thickness=0.4)), name="bar")
    graph.save(tmp_path / "bar.json")
    told = run("validate", str(tmp_path / "bar.json"))
    assert told["digest"] == graph.digest
    told = run("run", str(tmp_path / "bar.json"), output=[tmp_path / "bar.vti"], cells=8)
    assert (tmp_path / "bar.vti").exists()
    assert run("run", str(tmp_path / "bar.json"), cells=8)["density"] == graph.voxels(8).mean()
    for action, file, output in (
        ("fly", "octet", []), ("validate", "octet", ["a.stl"]), ("plot", "octet", []),
        ("explore", "octet", []), ("run", "nothing.json", []), ("run", "octet", ["a.xyz"]),
    ):  # fmt: skip
        with pytest.raises(il.errors.IlatticeError):
            run(action, file, output=output)
    with pytest.raises(InputError, match="the nearest are octet"):
        run("validate", "octett")
    assert main(["graph", "validate", "octet"]) == 0
    assert "12" in capsys.readouterr().out
    (tmp_path / "bad.json").write_text("{}")
    assert main(["graph", "validate", str(tmp_path / "bad.json")]) == 1
    assert "schema" in capsys.readouterr().err


def box_graph(size, way_of_faces, edges):
    """A conjugate surface in a box of mirrors, completed."""
    region = g.cuboid(size)
    numbers = region.faces(way_of_faces).numbers
    ends = [region.edge(a, b) for a, b in zip((numbers[-1], *numbers), numbers, strict=False)]
    film = g.surface(loop([0.5 * e.sum(axis=0) for e in ends]), kind="conjugate", edges=edges)
    return g.Graph(g.object(film.completed(region)), region)


def test_solids_of_surfaces_in_long_boxes_tell_how_far_they_are_off():
    long = box_graph((0.5, 0.5, 0.125), "x- y- z- x+ y+ z+", 8)
    fine = box_graph((0.5, 0.5, 0.125), "x- y- z- x+ y+ z+", 32).patches()[0]
    coarse = long.patches()[0]
    rows = fine.disc.nested[Disc(6, 16).nested]
    normals = vertex_normals(coarse.vertices, coarse.disc.faces)
    true = np.abs(np.einsum("vc,vc->v", fine.vertices[rows] - coarse.vertices, normals)).max()
    assert true > 1e-3
    for made in (long.solid, lambda: long.voxels(100)):
        with pytest.warns(PrecisionWarning, match="off the smooth surface by up to") as told:
            made()
        number = float(str(told[0].message).split("up to ")[1].split()[0])
        assert 0.3 * true < number < 2.0 * true
    assert box_graph(0.5, "x- y- z- x+ y+ z+", 16).solid()


def test_voxels_without_a_solid_are_told():
    ball = [g.object(g.line(way((0.3,) * 3, (0.3,) * 3), thickness=t)) for t in (0.2, 0.3)]
    with pytest.warns(PrecisionWarning, match="no voxel of 12 per edge"):
        assert not g.Graph(g.difference(*ball)).voxels(12).any()
