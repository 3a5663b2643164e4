"""Areas, Euler numbers and places of minimal surfaces against what is known of them exactly."""

import exact_schwarz as exact
import numpy as np
import pytest

import ilattice as il
from ilattice.errors import ConvergenceError, GeometryError, InputError
from ilattice.minimal.closing import conjugated
from ilattice.minimal.disc import Disc, area, area_hessian, cotangents, vertex_areas

M = il.minimal
OCTANT = "X+ z- Y+ x- Z+ y-"
PETRIE = np.array([(1, 0, 0), (1, 1, 0), (0, 1, 0), (0, 1, 1), (0, 0, 1), (1, 0, 1)])
GYROID = np.deg2rad(38.0147740)
#: Region, faces, area and Euler number of the unit cell.
KNOWN = {
    "P": (M.cuboid, OCTANT, 2.345103, -4),
    "P in a tetrahedron": (M.tetrahedron, "z=0 x=1/2 y=z x=y", 2.345103, -4),
    "Neovius": (M.tetrahedron, "z=0 x=1/2 x=y y=z", 3.51048, -16),
    "I-WP": (M.tetrahedron, "z=0 x=y x=1/2 y=z", 3.46416, -12),
    "I-WP in a prism": (M.prism, "z=0, x=y, x=1/2, z=1/2, x=y, y=0", 3.46416, -12),
    "F-RD": (lambda: M.tetrahedron(192), "z=0 x+y=1/2 x=y y=z", 4.76999, -40),
}


def extrapolated(make, n=8):
    """Value for n -> oo of something of second order."""
    coarse, fine = make(n), make(2 * n)
    return (4.0 * fine - coarse) / 3.0


@pytest.mark.parametrize("name", KNOWN)
def test_areas_and_euler_numbers_are_the_known_ones(name):
    region, text, known, euler = KNOWN[name]
    faces = region().faces(text)
    copies = len(faces.region.group)
    n = 16 if copies < 192 else 12
    value = extrapolated(lambda k: copies * M.conjugate(faces, k).area, n)
    assert value == pytest.approx(known, abs=2e-4)
    patch = M.conjugate(faces, 4)
    surface = patch.completed()
    assert surface.area == pytest.approx(copies * patch.area, rel=1e-12)
    assert (surface.euler, surface.components) == (euler, 1)
    assert surface.is_closed
    assert surface.separates
    assert surface.genus == 1 - euler // 2


def test_four_faces_need_no_search():
    for name in ("P in a tetrahedron", "Neovius", "I-WP", "F-RD"):
        region, text, *_ = KNOWN[name]
        report = M.conjugate(region().faces(text), 8).report
        assert report.evaluations == 1
        assert report.factorizations <= 8


def test_schwarz_p_is_that_of_weierstrass():
    errors = []
    for n in (8, 16):
        patch = M.conjugate(M.cuboid().faces(OCTANT), n)
        errors.append(exact.distances(patch.vertices).max())
        assert patch.report.residual < 1e-8
        assert np.abs(patch.vertices[patch.disc.side_rows[0], 0] - 0.5).max() < 1e-15
    assert errors[1] < 1e-4
    assert np.log2(errors[0] / errors[1]) == pytest.approx(2.0, abs=0.15)
    assert np.median(np.abs(patch.mean_curvature)) < 1e-3


def test_tetragonal_p_is_also_the_one_with_free_sides():
    box = M.cuboid((0.5, 0.5, 0.4))
    faces = box.faces(OCTANT)
    corners = M.conjugate(faces, 4).corners
    slides = faces.names
    found = extrapolated(lambda n: 8 * M.conjugate(faces, n).area)
    free = extrapolated(lambda n: 8 * M.mixed(box, corners, slides, n).area)
    assert found == pytest.approx(1.97342, abs=2e-4)
    assert free == pytest.approx(found, abs=3e-4)


def test_schwarz_d_over_the_petrie_hexagon():
    assert extrapolated(lambda n: 4 * M.direct(PETRIE / 2, n).area) == pytest.approx(
        1.91889, abs=5e-5
    )
    film = M.direct(PETRIE / 4, 4, cell=1.0)
    whole = film.completed()
    assert (whole.euler, whole.genus, whole.separates) == (-16, 9, True)
    half = M.direct(PETRIE / 2, 4, cell=1.0).completed()
    assert (half.euler, half.is_orientable) == (-2, False)
    assert "twice as large" in half.objection
    with pytest.raises(GeometryError, match="twice as large"):
        half.tile()
    with pytest.raises(GeometryError, match="one-sided"):
        _ = half.genus


def gyroid(n):
    """The gyroid of the associate family of D: patch and edge of its cell."""
    patch = M.direct(PETRIE / 4, n).associate(GYROID)
    middle = patch.vertices[patch.disc.side_rows[:, n // 2]]
    step = 2.0 * (middle[3] - middle[0])
    axis = np.sqrt(0.5) * np.array([1.0, 0.0, 1.0])
    step -= (step @ axis) * axis  # between parallel axes: half a diagonal of the cell
    return patch, float(np.linalg.norm(step)) * 2.0 / np.sqrt(3.0)


#: Polygons in sixteenths over which triangles fold where steps along the sides are equal.
SKEW = [
    [(7, 5, 1), (8, 1, 3), (6, 1, 7), (2, 5, 8), (7, 1, 3), (2, 8, 7)],
    [(1, 4, 3), (7, 5, 1), (4, 1, 4), (5, 4, 4), (0, 7, 6), (6, 3, 1)],
    [(3, 8, 0), (6, 8, 6), (8, 2, 8), (1, 2, 1), (6, 2, 3), (5, 5, 7)],
]


@pytest.mark.parametrize("polygon", SKEW)
def test_skew_polygons_are_spanned(polygon):
    p = np.array(polygon) / 16
    films = [M.direct(p, n) for n in (8, 12)]
    assert films[0].area == pytest.approx(films[1].area, rel=0.02)
    corners = np.stack([np.broadcast_to(p.mean(axis=0), p.shape), p, np.roll(p, -1, axis=0)], 1)
    cone = 0.5 * np.linalg.norm(np.cross(*(corners[:, k] - corners[:, 0] for k in (1, 2))), axis=1)
    for film in films:
        assert film.report.residual < 1e-7
        assert film.area < 0.95 * cone.sum()
        for row, a, b in zip(film.disc.side_rows, p, np.roll(p, -1, axis=0), strict=True):
            t = (film.vertices[row] - a) @ (b - a) / ((b - a) @ (b - a))
            assert (np.diff(t) > 0).all()
            assert np.abs(film.vertices[row] - a - np.outer(t, b - a)).max() < 1e-12


def test_the_gyroid_is_an_associate_of_d():
    def cell_area(n):
        patch, edge = gyroid(n)
        return 16.0 * patch.area / edge**2

    assert extrapolated(cell_area) == pytest.approx(3.0914, abs=2e-4)
    patch, edge = gyroid(8)
    turns = [M.half_turn(edge / 8 * np.array(p), a) for p, a in AXES]
    surface = patch.completed(M.generated(turns, edge))
    assert (surface.euler, surface.is_closed, surface.separates) == (-8, True, True)


#: Half turns about normals of the gyroid: points in eighths of the cell, and directions.
AXES = [((1, 0, -1), (1, 0, 1)), ((-1, 1, 0), (1, 1, 0)), ((0, -1, 1), (0, 1, 1))]
AXES += [((2, 1, -1), (0, 1, 1)), ((-1, 2, 1), (1, 0, 1)), ((1, -1, 2), (1, 1, 0))]


def test_the_dual_of_the_dual_is_the_surface_itself():
    patch = M.direct(PETRIE / 2, 8)
    again = -conjugated(conjugated(patch.vertices, patch.disc), patch.disc)
    shift = patch.vertices[0] - again[0]
    assert np.abs(again + shift - patch.vertices).max() < 1e-2
    assert patch.dual.area == pytest.approx(patch.area, rel=5e-3)
    assert np.abs(patch.dual.dual.vertices + patch.vertices).max() == 0.0
    assert patch.associate(0.0).area == pytest.approx(patch.area, rel=1e-15)


def test_gradient_and_hessian_of_the_area_are_its_derivatives():
    rng = np.random.default_rng(3)
    disc = Disc(5, 3)
    v = disc.flat + 0.1 * rng.normal(size=disc.flat.shape)
    d, w = rng.normal(size=v.shape), rng.normal(size=len(v))
    slope = lambda x: np.einsum("vc,vc->v", d, cotangents(x, disc.faces) @ x)  # noqa: E731
    h = 1e-5
    up, down = v + h * w[:, None] * d, v - h * w[:, None] * d
    assert (area(up, disc.faces) - area(down, disc.faces)) / (2 * h) == pytest.approx(
        w @ slope(v), rel=1e-6
    )
    found = area_hessian(v, disc.faces, d) @ w
    assert np.abs(found - (slope(up) - slope(down)) / (2 * h)).max() < 1e-4


def test_a_flat_film_is_flat_and_a_shell_bends_less():
    square = np.array([(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0.0)])
    assert M.direct(square, 6).area == pytest.approx(1.0, rel=1e-14)
    t = np.linspace(0.0, 2.0 * np.pi / 3.0, 30)
    ring = [
        np.stack([np.cos(a + t), np.sin(a + t), 0.4 * np.cos(2 * (a + t))], axis=1)
        for a in 2.0 * np.pi / 3.0 * np.arange(3)
    ]
    for i, side in enumerate(ring):
        side[-1] = ring[(i + 1) % 3][0]
    areas = [M.direct(ring, 8, alpha=alpha).area for alpha in (0.0, 0.01, 0.1, 1.0)]
    assert areas == sorted(areas)
    assert areas[-1] - areas[0] > 1e-4


def random_loops(count, seed=0, most=9):
    """Closed ways along faces of the regions, as text of numbers; those that are refused go."""
    rng = np.random.default_rng(seed)
    regions = [M.cuboid(), M.cuboid((0.5, 0.4, 0.45)), M.prism(), M.tetrahedron()]
    while count:
        region = regions[rng.integers(len(regions))]
        size = rng.integers(4, most)
        numbers = tuple(int(k) for k in rng.integers(len(region.normals), size=size))
        try:
            loop = M.FaceLoop(region, numbers)
        except InputError:
            continue
        count -= 1
        yield loop


def judged(loop, n=8):
    """Whether a surface was found; nothing that is found may be wrong."""
    try:
        patch = M.conjugate(loop, n)
    except (ConvergenceError, GeometryError) as e:
        return len(str(e)) < 40
    region, rows = loop.region, patch.disc.side_rows
    for side, m, d in zip(rows, loop.normals, loop.offsets, strict=True):
        assert np.abs(patch.vertices[side] @ m - d).max() < 1e-12
    assert (patch.vertices @ region.normals.T - region.offsets).max() < 0.05 * region.size
    assert patch.report.residual < 1e-7
    bent = np.abs(patch.mean_curvature[: patch.disc.boundary])
    weight = vertex_areas(patch.vertices, patch.disc.faces)[: patch.disc.boundary]
    assert weight @ bent / weight.sum() * region.size < 0.6
    return True


def test_random_ways_are_solved_or_refused_with_a_reason():
    assert sum(judged(loop) for loop in random_loops(6, most=7)) >= 4


@pytest.mark.parametrize(
    ("copies", "text"),
    [
        (48, "z=0 x=y y=z x=1/2 z=0 x=1/2"),
        (48, "z=0 x=y y=z x=y y=z x=1/2"),
        (192, "z=0 y=z z=0 y=z x=y x+y=1/2"),
    ],
)
def test_surfaces_are_followed_where_balanced_lengths_do_not_lead_to_them(copies, text):
    loop = M.tetrahedron(copies).faces(text)
    assert judged(loop, 12)
    areas = [M.conjugate(loop, n).area for n in (8, 16)]
    assert areas[0] == pytest.approx(areas[1], rel=0.03)


def test_refusals_tell_how_far_a_surface_was_followed():
    loop = M.prism().faces("y=0 x=y z=0 x=1/2 z=1/2")  # of five sides, so that one number is sought
    with pytest.raises(ConvergenceError, match=r"7\.1 degrees before them, the surface turns back"):
        M.conjugate(loop, 8)


@pytest.mark.parametrize("n", [8, 16])
def test_what_is_not_minimal_is_refused(n):
    loop = M.cuboid().faces("x- y- z- y+ z+ y- x+ y+")  # with few edges a surface seems to exist
    with pytest.raises(ConvergenceError):
        M.conjugate(loop, n)
