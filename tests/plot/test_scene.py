"""Pictures by what must be seen in them: never by stored pixels."""

import base64
import io
from pathlib import Path

import meshes
import numpy as np
import pytest
import pyvista as pv
from PIL import Image

import ilattice as il
from ilattice._conditions import as_planes
from ilattice._field import Field
from ilattice.errors import FormatError, InputError
from ilattice.mesh import SurfaceMesh
from ilattice.plot import Panels, Scene, animate
from ilattice.plot.clips import clipped

SIZE = (260, 200)


@pytest.fixture(scope="module")
def ball():
    axis = np.linspace(-1.2, 1.2, 25)
    return il.mesh.contour(lambda x: (x**2).sum(axis=1) - 1.0, [axis] * 3)


def shown(picture):
    """Rows and columns from the first to the last pixel that is not white, and their share."""
    inside = (picture.astype(int).sum(axis=2) < 3 * 250).nonzero()
    return [(int(a.min()), int(a.max())) for a in inside]


def near(picture, colour, by=40):
    return (np.abs(picture.astype(int) - np.array(colour)).max(axis=2) < by).mean()


@pytest.mark.parametrize("parallel", [False, True])
@pytest.mark.parametrize("view", ["front", "top", (-60.0, 30.0), (17.0, -41.0), (200.0, 80.0)])
def test_parts_fill_the_picture_and_are_in_the_middle(view, parallel):
    """A slender body far from the origin, in perspective off its axes."""
    vertices, faces = meshes.cube()
    body = SurfaceMesh(vertices * [3.0, 0.4, 0.7] + [50.0, -20.0, 7.0], faces)
    picture = Scene(size=SIZE, view=view, parallel=parallel).add(body).image()
    (top, bottom), (left, right) = shown(picture)
    margins = np.array([top, 199 - bottom, left, 259 - right])
    assert margins.min() >= 2
    fill = max((bottom - top) / 200, (right - left) / 260)
    assert fill > 0.88
    assert abs(margins[0] - margins[1]) <= 4
    assert abs(margins[2] - margins[3]) <= 4


def test_clips_show_the_inside_in_another_colour(ball):
    scene = Scene(size=SIZE, view="front", occlusion=False).add(ball, color="white", cap="red")
    whole, half = scene.image(), scene.clipped("y > 0.2").image()
    red = [
        ((p[..., 0] > 1.7 * p[..., 1]) & (p[..., 0] > 90)).mean() for p in map(wide, (whole, half))
    ]
    assert red[0] == 0.0
    (top, bottom), (left, right) = shown(half)
    disc = np.pi / 4 * (bottom - top) * (right - left) / (200 * 260)
    assert red[1] == pytest.approx(disc, rel=0.1)


def wide(picture):
    return picture.astype(float)


@pytest.mark.parametrize("seed", range(6))
def test_what_is_clipped_is_closed_and_has_its_volume(ball, seed):
    """Caps of a ball of triangles in half-spaces, against volumes of the same by random points."""
    rng = np.random.default_rng(seed)
    normal, at = rng.normal(size=3), rng.uniform(-0.6, 0.6)
    a, b, c = normal
    words = f"{a:.17g}*x + {b:.17g}*y + ({c:.17g})*z > {at:.17g}"
    kept, caps = clipped(ball.to_pyvista(), as_planes(words))
    assert kept.merge(caps).clean(tolerance=1e-9).n_open_edges == 0
    height = at / np.linalg.norm(normal)
    exact = np.pi * (1 - height) ** 2 * (2 + height) / 3
    both = kept.merge(caps).extract_surface(algorithm=None)
    assert both.volume == pytest.approx(exact, rel=0.02)
    assert caps.area == pytest.approx(np.pi * (1 - height**2), rel=0.02)
    x = np.asarray(kept.points) @ normal
    assert x.min() >= at - 1e-5


def test_boxes_and_joined_conditions_keep_the_same(ball):
    box = clipped(ball.to_pyvista(), as_planes([[0, -0.3, -5], [5, 0.4, 0.2]]))
    words = "0 < x < 5 and y > -0.3 and 0.4 >= y and -5 <= z and z <= 1/5"
    told = clipped(ball.to_pyvista(), as_planes(words))
    for a, b in zip(box, told, strict=True):
        assert a.area == pytest.approx(b.area, rel=1e-9)


@pytest.mark.parametrize(
    "clip",
    ["y", "y >", "y == 1", "1 > 0", "x*x > 1", "x*y > 0", "w > 0", "x > 0 or y > 0", "abs(x) > 1",
     "__import__('os') > 0", "x/0 > 1", [[0, 0, 0], [1, 0, 1]], [1, 2, 3], None, 3.0, "x > 'a'"],
)  # fmt: skip
def test_clips_that_cannot_be_read_are_refused(clip):
    with pytest.raises(InputError, match="clip"):
        as_planes(clip)


def test_conditions_tell_what_they_may_contain():
    with pytest.raises(InputError, match=r"'w<0.3' may contain only numbers, x, y, z, \+, -"):
        as_planes("w<0.3")


def test_parts_have_their_own_colours(ball):
    half = (ball.vertices[:, 0] > 0).astype(float)
    mesh = SurfaceMesh(ball.vertices, ball.faces, {"r": half, "g": 0 * half, "b": 1 - half})
    picture = Scene(size=SIZE, view="front").add(mesh).image().astype(int)
    red, blue = (picture[..., a] > 3 * picture[..., b] + 60 for a, b in ((0, 2), (2, 0)))
    assert red.mean() > 0.05
    assert blue.mean() > 0.05
    assert np.nonzero(red)[1].mean() > np.nonzero(blue)[1].mean()  # x points to the right


def test_panels_share_a_colour_bar_and_its_limits(ball):
    """The same number has the same colour in both, though one has larger numbers."""
    scenes = []
    for most in (1.0, 2.0):
        data = {"t": np.where(ball.vertices[:, 2] > 0.9, most, 1.0 if most == 1.0 else 0.0)}
        mesh = SurfaceMesh(ball.vertices, ball.faces, data)
        scenes.append(Scene(view="front", occlusion=False).add(mesh, scalars="t", cmap="gray"))
    picture = Panels(tuple(scenes), size=(520, 200)).image().astype(int)
    left, right = picture[100, 110], picture[100, 340]
    assert 80 < left.mean() < 200  # 1 of 0 to 2
    assert right.mean() < 60  # 0
    bars = [
        (picture[:, a:b].std(axis=1).max(axis=1) > 0).sum() for a, b in ((225, 258), (480, 518))
    ]
    assert bars[0] < 0.5 * bars[1]


def test_ghosts_lines_and_insets_are_seen(ball):
    plain = Scene(size=SIZE, view="front", occlusion=False).add(ball, color="white")
    boxed = plain.lines([[-2, -2, -2], [2, 2, 2]], color="red")
    assert near(boxed.image(), (255, 0, 0), 90) > 0.001
    assert near(plain.image(), (255, 0, 0), 90) == 0.0
    ghost = Scene(size=SIZE, view="front").ghost(ball).image()
    assert (ghost.sum(axis=2) < 3 * 250).mean() > 0.1
    assert ghost.min() > 90
    with_inset = plain.inset(Scene().add(ball, color="blue"), (0.7, 0.7, 0.28, 0.28)).image()
    assert near(with_inset[:60, 182:], (0, 0, 255), 120) > 0.1
    framed = plain.framed([[-4, -4, -4], [4, 4, 4]])
    assert (framed.image().sum(axis=2) < 700).mean() < 0.3 * (
        plain.image().sum(axis=2) < 700
    ).mean()


def test_scale_bars_and_titles_do_not_cover_the_part(ball):
    plain = Scene(size=(400, 400), view="front", parallel=True).add(ball)
    scene = Scene(size=(400, 400), view="front", parallel=True, scale_bar=True, title="a ball",
                  unit="mm").add(ball)  # fmt: skip
    (top, _), _ = shown(scene.image())
    assert top < 25  # the title
    brass = [near(s.image(), (240, 200, 150), 60) for s in (plain, scene)]
    assert 0.4 * brass[0] < brass[1] < 0.95 * brass[0]


def test_files(ball, tmp_path):
    scene = Scene(size=(80, 60)).add(ball)
    for name in ("a.png", "a.jpg", "a.gltf"):
        scene.save(tmp_path / name)
        assert (tmp_path / name).stat().st_size > 100
    animate(scene.turntable(3), tmp_path / "a.gif")
    from PIL import Image

    with Image.open(tmp_path / "a.gif") as film:
        assert film.n_frames == 3
    for name in ("a.bmp", "a"):
        with pytest.raises(FormatError):
            scene.save(tmp_path / name)
    with pytest.raises(FormatError, match="gif"):
        animate([scene], tmp_path / "a.avi")
    with pytest.raises(InputError, match="empty"):
        animate([], tmp_path / "b.gif")
    assert sorted(p.name for p in tmp_path.iterdir()) == ["a.gif", "a.gltf", "a.jpg", "a.png"]


@pytest.mark.parametrize(
    ("make", "match"),
    [
        (lambda _: Scene(size=(0, 3)), "size"),
        (lambda _: Scene(background="nonsense"), "background"),
        (lambda b: Scene().add(b, color="nonsense"), "color"),
        (lambda b: Scene().add(b, scalars="t"), "scalars"),
        (lambda _: Scene().add(3.0), "cannot be drawn"),
        (lambda _: Scene().add([[1.0, 2.0]]), "shape"),
        (lambda _: Scene().image(), "empty"),
        (lambda b: Scene().add(b).clipped("x > 5").image(), "clipped away"),
        (lambda _: Scene().framed([[1, 1, 1], [0, 0, 0]]), "box"),
        (lambda b: Scene().add(b).inset(Scene(), (0.9, 0, 0.3, 0.3)), "place"),
        (lambda _: Panels(()), "scenes"),
        (lambda b: Panels((b,)), "scenes"),
    ],
)
def test_what_cannot_be_shown_is_refused(ball, make, match):
    with pytest.raises(InputError, match=match):
        make(ball)


# --- films ------------------------------------------------------------------------------------


@pytest.mark.filterwarnings("ignore::ilattice.errors.PrecisionWarning")
def test_series_are_films(tmp_path):
    wall = il.Lattice("schwarz_p", through=il.macroshape.box(), spans_per_tile=6).offset(0.15)
    problem = il.cutfem.Elasticity(wall, 4, density=1.0, degree=1).clamp("u=0")
    il.cutfem.natural_modes(problem, 2).animate(tmp_path / "modes.gif", size=(80, 60))
    assert Path(tmp_path / "modes.gif").stat().st_size > 500


def test_slices_are_drawn_and_become_films(tmp_path):
    """The contour of a ball at a height is a circle; empty layers are refused."""
    stack = il.mesh.slice_field(il.fields.sphere(0.93), [-0.37, 0.41, 2.0], h=0.05)
    data = stack[1].to_pyvista()
    radius = np.linalg.norm(data.points[:, :2], axis=1)
    assert radius == pytest.approx(np.sqrt(0.93**2 - 0.41**2), abs=2e-3)
    assert sorted(set(stack.to_pyvista()["height"])) == pytest.approx([-0.37, 0.41])
    scenes = [Scene(size=(80, 60)).add(layer, color="black") for layer in (stack[0], stack[1])]
    animate(scenes, tmp_path / "a.gif")
    assert (tmp_path / "a.gif").stat().st_size > 200
    with pytest.raises(il.errors.GeometryError, match="empty"):
        Scene().add(stack[2])


# --- heat maps --------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("plane", "side"),
    [("z = 0.25", 2), ("x = 0.25", 0), ("0.5 == 2*y", 1), ("x + 2*y - z = 0.3", -1)],
)
def test_heat_maps_show_signs_and_the_line_between_them(plane, side):
    """A ball at a plane is a blue disc of known area, of a known part of what is shown."""
    field, box = il.fields.sphere(0.9), np.array([[-1.2] * 3, [1.2] * 3])
    scene = il.plot.heat_map(field, plane, box=box, size=(500, 400), label="", title="",
                             clim=(-1e-9, 1e-9))  # fmt: skip
    picture = scene.image().astype(int)
    blue = (picture[..., 2] - picture[..., 0] > 12).sum()
    red = (picture[..., 0] - picture[..., 2] > 12).sum()
    black = (picture.max(axis=2) < 90).sum()
    away = 0.25 if side >= 0 else 0.3 / np.sqrt(6)
    disc = np.pi * (0.81 - away**2)
    assert black > 300
    if side >= 0:
        (top, bottom), (left, right) = shown(picture)
        share = (blue + black / 2) / ((bottom - top + 1) * (right - left + 1))
        assert share == pytest.approx(disc / 2.4**2, rel=0.08)
    else:
        assert 1.0 < red / blue < 3.0
    data, line = (layer.data for layer in scene.layers)
    radius = np.linalg.norm(line.points, axis=1)
    assert radius == pytest.approx(0.9, abs=5e-3)
    x = np.asarray(data.points, float)
    assert data["value"] == pytest.approx(field(x), abs=1e-6)
    assert x.min() == pytest.approx(-1.2, abs=1e-6)


def test_heat_maps_take_splines_tiles_walls_and_callables():
    wall = il.Lattice("gyroid", through=il.macroshape.box((2.0, 1.0, 1.0))).offset(0.1)
    for field in (wall.field, wall.distance, il.tiles.get("gyroid").field):
        scene = il.plot.heat_map(field, "y = 0.4", n=30)
        assert len(scene.layers) == 2
    part = il.plot.heat_map(lambda x: np.where(x[:, 0] > 0.5, np.nan, x[:, 1]), "z = 0",
                            box=[[0, -1, -1], [1, 1, 1]], n=30, size=SIZE)  # fmt: skip
    assert near(part.image(), (215, 215, 215), 12) > 0.1  # where there is no value


def test_heat_maps_show_room_about_solids_and_all_of_other_fields():
    def extent(field):
        data = il.plot.heat_map(field, "z = 0.1", n=20).layers[0].data
        return np.asarray(data.points, float)[:, 0].min(), np.asarray(data.points)[:, 0].max()

    class Sheet(Field):
        bounds = np.array([[-1.0, -1, -1], [2, 1, 1]])

        def __call__(self, p):
            return p[:, 2] - 0.2

    class Node(Sheet):
        """It only has the name of a solid."""

    def slab(p):
        return p[:, 2] - 0.2

    slab.bounds = Sheet.bounds
    assert extent(slab) == pytest.approx((-1.0, 2.0), abs=1e-6)
    slab.bounds = lambda: Sheet.bounds
    with pytest.raises(InputError, match="does not say where it is"):
        extent(slab)
    assert extent(il.fields.sphere(1.0)) == pytest.approx((-1.2, 1.2), abs=1e-6)
    assert extent(Sheet()) == extent(Node()) == pytest.approx((-1.0, 2.0), abs=1e-6)


@pytest.mark.parametrize(
    ("field", "plane", "options", "said"),
    [
        (il.fields.sphere(1.0), "z", {}, "is no equation; write it like"),
        (il.fields.sphere(1.0), 3, {}, "is no equation"),
        (il.fields.sphere(1.0), "z = x*y", {}, "is not linear"),
        (il.fields.sphere(1.0), "1 = 2", {}, "without x, y or z"),
        (il.fields.sphere(1.0), "z =", {}, "cannot be read"),
        (il.fields.sphere(1.0), "z = 5", {}, "misses the box"),
        (il.fields.sphere(1.0), "z = 0", {"box": [1, 2]}, "box must be"),
        (il.fields.sphere(1.0), "z = 0", {"n": 1}, "n must be"),
        (il.fields.half_space((0, 0, 1), 0.0), "z = 0", {}, "does not say where it is"),
        (lambda x: x, "z = 0", {"box": [[-1] * 3, [1] * 3]}, "one number per point"),
        (lambda x: np.nan * x[:, 0], "z = 0", {"box": [[-1] * 3, [1] * 3]}, "no finite value"),
        (3, "z = 0", {}, "field must take points"),
    ],
)
def test_heat_maps_that_make_no_sense_are_refused(field, plane, options, said):
    with pytest.raises(InputError, match=said):
        il.plot.heat_map(field, plane, **options)


# --- notebooks --------------------------------------------------------------------------------


@pytest.mark.filterwarnings("ignore:the cells are too coarse")
def test_notebooks_show_numbers_and_a_picture(ball):
    wall = il.Lattice("gyroid", through=il.macroshape.box((2.0, 1.0, 1.0))).offset(0.1)
    problem = il.cutfem.Elasticity(
        il.fields.box(1.0), 4, domain=[[-1.1, -1.1, -0.5], [1.1] * 3], young=1.0
    )
    solution = problem.clamp("w=0").load(gravity=(0, 0, -1e-3)).solve()
    things = {
        il.tiles.get("gyroid"): ("gyroid", "TrigField"), wall.lattice: ("1 x 1 x 1", "2 x 1 x 1"),
        wall: ("total thickness", "0.2"), ball: ("volume", f"{ball.volume:.5g}"),
        solution: ("functions", "estimated error of the energy"),
    }  # fmt: skip
    for thing, words in things.items():
        text = thing._repr_html_()
        assert f"<b>{type(thing).__name__}</b>" in text
        assert all(word in text for word in words), text[-400:]
        png = base64.b64decode(text.split("base64,")[1].split("'")[0])
        picture = np.asarray(Image.open(io.BytesIO(png)))
        assert picture.shape[:2] == (270, 360)
        assert (picture[..., :3].sum(axis=2) < 700).mean() > 0.1


@pytest.mark.filterwarnings("ignore::ilattice.errors.PrecisionWarning")
@pytest.mark.parametrize("on", ["cells", "solid", "surface"])
def test_solutions_whose_islands_are_left_out_are_seen(on):
    """A corner of the solid that hangs on nothing shares cells with what is solved."""
    block = il.macroshape.box((3.0, 1.0, 1.0))
    wall = il.Lattice("gyroid", through=block, repeat=(3, 1, 1)).offset(0.1)
    problem = il.cutfem.Elasticity(wall, (18, 6, 6), young=1.0).clamp("u=0")
    solution = problem.load(force=(0, 0, 1e-4), on="u=1").solve()
    assert np.isfinite(solution.to_pyvista(on, scale="auto").points).all()


def test_points_that_are_not_finite_are_refused():
    with pytest.raises(InputError, match="1 of 2 points"):
        Scene().add(pv.PolyData(np.array([[0.0, 0.0, np.nan], [1.0, 1.0, 1.0]])))


def test_what_cannot_be_drawn_is_shown_without_a_picture(monkeypatch):
    mesh = SurfaceMesh(*meshes.cube())
    monkeypatch.setattr(SurfaceMesh, "plot", lambda *_, **__: 1 / 0)
    assert "<img" not in mesh._repr_html_()
    assert "volume" in mesh._repr_html_()
    odd = il.Tile(lambda u: u[:, 0] - 0.5, name="<script>")
    assert "<script>" not in odd._repr_html_()


def test_bars_about_names_are_drawn():
    ball = pv.Sphere()
    ball["|H|"], ball["H"] = ball.points[:, 0], ball.points[:, 0]
    pictures = [il.plot.Scene(size=(900, 720)).add(ball, scalars=s).image() for s in ("|H|", "H")]
    beside = [(p[:, 720:].min(axis=2) < 160).sum() for p in pictures]  # the title and its numbers
    assert beside[0] > beside[1]


# --- what a stranger found ----------------------------------------------------------------------


@pytest.mark.parametrize("by", [1e-3, 1e-6, 1e3])
def test_clips_of_parts_of_any_size_are_the_same(ball, by):
    """Parts in metres: what VTK takes for equal is an absolute length."""
    far = np.array([0.3, -2.0, 1.1])
    areas = []
    for scale, shift in ((1.0, 0.0), (by, 0.0), (by, 7.0 * by)):
        mesh = SurfaceMesh(ball.vertices * scale + shift * far, ball.faces)
        y, both = 0.2 * scale + shift * far[1], scale + shift * far[[0, 2]].sum()
        words = f"y > {y!r} and x + z < {both!r}"
        kept, caps = clipped(mesh.to_pyvista(), as_planes(words))
        areas.append((kept.area / scale**2, caps.area / scale**2))
    assert areas[1] == pytest.approx(areas[0], rel=1e-5)
    assert areas[2] == pytest.approx(areas[0], rel=1e-5)


def test_entries_of_vectors_and_matrices_have_names(ball):
    stress = np.tile([-2.0, 0, 0, 0, 0, 1.5], (len(ball.vertices), 1))
    stress[:, 2] = ball.vertices[:, 2]
    data = ball.to_pyvista()
    data["stress"], data["displacement"] = stress, ball.vertices * [1, 2, 3]
    for name, values in (("stress_zz", stress[:, 2]), ("displacement_y", 2 * ball.vertices[:, 1])):
        layer = Scene().add(data, scalars=name).layers[0]
        np.testing.assert_allclose(layer.data[name], values)
    with pytest.raises(InputError, match="six entries: take one of stress_xx, stress_yy"):
        Scene().add(data, scalars="stress")
    with pytest.raises(InputError, match="'nope' are not in the data; there is"):
        Scene().add(data, scalars="nope")
    with pytest.raises(InputError, match="stress_ww"):
        Scene().add(data, scalars="stress_ww")


def test_rounding_is_no_pattern(ball):
    """One to fifteen digits is one colour, as in the bar's middle."""
    rng = np.random.default_rng(0)
    data = ball.to_pyvista()
    data["t"] = 1.0 + 1e-15 * rng.normal(size=data.n_points)
    picture = Scene(size=SIZE, occlusion=False).add(data, scalars="t", flat=True, label="").image()
    part = picture[80:120, 110:150].reshape(-1, 3).astype(int)
    assert np.ptp(part, axis=0).max() <= 4


def test_colours_of_data_are_those_of_the_bar():
    """Nearly everywhere; and exactly without shade."""
    from matplotlib import colormaps

    box = pv.Box().triangulate().subdivide(3)
    box["t"] = np.asarray(box.points[:, 0] > 0.999, float)
    right = np.array(colormaps["viridis"](1.0)[:3]) * 255
    for flat, by in ((True, 3.0), (None, 0.16 * 255)):
        picture = Scene(size=SIZE, view=(0.0, 0.0), occlusion=False)
        picture = picture.add(box, scalars="t", flat=flat, label="").image()
        assert np.abs(picture[100, 130] - right).max() <= by


@pytest.mark.parametrize(
    ("options", "said"),
    [({"cmap": "nope", "scalars": "t"}, "cmap 'nope' is no map of colours"),
     ({"opacity": 3}, "opacity must be from 0"), ({"colour": "red"}, "near it are color"),
     ({"foo": 1}, "foo is no option")],
)  # fmt: skip
def test_options_that_nobody_knows_are_refused(options, said):
    data = pv.Sphere()
    data["t"] = data.points[:, 0]
    with pytest.raises(InputError, match=said):
        Scene().add(data, **options)


@pytest.mark.parametrize("size", [(400, 300), (320, 240)])
def test_bars_of_small_pictures_are_whole(size):
    """Nothing of titles or numbers touches the right side of the picture."""
    data = pv.Sphere()
    data["von_mises"] = -4.93e-7 * data.points[:, 0]
    picture = Scene(size=size).add(data, scalars="von_mises", unit="MPa").image()
    assert picture[:, -1:].min() > 245
    beside = picture[:, int(0.93 * size[0]) :].min(axis=2) < 160
    assert beside.sum() > 10


def test_stages_of_pictures_are_told(ball, tmp_path):
    seen = []
    ball.plot(screenshot=tmp_path / "a.png", size=SIZE, progress=lambda name, *_: seen.append(name))
    assert seen == ["scene", "picture"]
