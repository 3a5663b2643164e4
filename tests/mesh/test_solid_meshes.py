"""Tetrahedra and hexahedra for other programs: volumes, sides, forces, decks."""

import re
import shutil
import subprocess

import numpy as np
import pytest
from meshes import cube

import ilattice as il
from ilattice.errors import FormatError, GeometryError, InputError, PrecisionWarning

ORDERS = ((0, 1, 2), (0, 2, 1), (1, 0, 2), (1, 2, 0), (2, 0, 1), (2, 1, 0))
AFFINE = np.array([[2.0, 0.3, -0.1], [0.0, 0.7, 0.2], [0.1, 0.0, 1.1]])


def box(kind):
    """The image of a unit cube, in 27 boxes of unequal sides, under an affine map."""
    ticks = np.array([0.0, 0.2, 0.7, 1.0])
    grid = np.stack(np.meshgrid(ticks, ticks, ticks, indexing="ij"), axis=-1).reshape(-1, 3)

    def at(corner, steps):
        return np.ravel_multi_index(tuple(np.add(steps, corner)), (4, 4, 4))

    cells = []
    for corner in np.ndindex(3, 3, 3):
        if kind == "C3D8":
            flat = [(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0)]
            cells.append([at(corner, (x, y, z)) for z in (0, 1) for x, y, _ in flat])
            continue
        for order in ORDERS:
            path = np.zeros((4, 3), int)
            for i, axis in enumerate(order):
                path[i + 1 :, axis] = 1
            nodes = [at(corner, p) for p in path]
            odd = np.linalg.det(np.eye(3)[list(order)]) < 0
            cells.append([nodes[i] for i in ((0, 2, 1, 3) if odd else (0, 1, 2, 3))])
    points, cells = grid @ AFFINE.T, np.array(cells)
    if kind != "C3D10":
        return il.mesh.SolidMesh(points, cells)
    pairs = [(0, 1), (1, 2), (2, 0), (0, 3), (1, 3), (2, 3)]
    middles = np.concatenate([points[cells[:, list(p)]].mean(axis=1) for p in pairs])
    all_points = np.vstack([points, middles])
    used, numbers = np.unique(all_points.round(12), axis=0, return_inverse=True)
    extra = len(points) + np.arange(len(middles)).reshape(6, -1).T
    return il.mesh.SolidMesh(used, numbers.ravel()[np.column_stack([cells, extra])])


@pytest.fixture(params=["C3D4", "C3D10", "C3D8"])
def solid(request):
    return box(request.param)


def face_value(name):
    """A function that vanishes on a face of the box and is positive beyond it."""
    inverse = np.linalg.inv(AFFINE)
    axis, end = "xyz".index(name[0]), float(name[1])
    return lambda x: (x @ inverse.T)[:, axis] * (2 * end - 1) - end


def on_face(name):
    return lambda x: np.abs(face_value(name)(x)) < 1e-9


def test_volumes_sides_and_areas_are_those_of_the_box(solid):
    assert solid.volume == pytest.approx(np.linalg.det(AFFINE), rel=1e-12)
    assert (solid.volumes > 0).all()
    total = len(solid.boundary)
    assert total == 6 * 9 * (1 if solid.kind == "C3D8" else 2)
    count = 0
    for axis in range(3):
        edges = np.delete(AFFINE, axis, axis=1).T
        area = np.linalg.norm(np.cross(*edges))
        for end in "01":
            named = solid.with_regions(face=on_face(f"{'xyz'[axis]}{end}"))
            assert named.area("face") == pytest.approx(area, rel=1e-12)
            assert len(named.elements("face")) == 0
            count += len(named.sides("face"))
    assert count == total


def test_sides_are_the_ones_that_calculix_numbers(solid):
    """Nodes of a side by the tables of the manual (sections on element types), from 1."""
    tables = {4: ["123", "142", "243", "341"],
              8: ["1234", "5876", "1562", "2673", "3784", "4851"]}  # fmt: skip
    table = tables[8 if solid.kind == "C3D8" else 4]
    for element, side in solid.boundary:
        corners = solid.cells[element, [int(c) - 1 for c in table[side]]]
        x = solid.points[corners] @ np.linalg.inv(AFFINE).T
        flat = np.ptp(x, axis=0) < 1e-9
        assert flat.any()
        assert np.isclose(x[0][flat], 0).any() or np.isclose(x[0][flat], 1).any()


def test_forces_do_the_work_of_a_uniform_traction(solid):
    rng = np.random.default_rng(3)
    named = solid.with_regions(face=on_face("y1"))
    force = rng.standard_normal(3)
    f = named.nodal_forces("face", force)
    assert f.sum(axis=0) == pytest.approx(force, rel=1e-12)
    # against linear fields: the traction acts in the middle of the parallelogram
    middle = AFFINE @ [0.5, 1.0, 0.5]
    A, b = rng.standard_normal((3, 3)), rng.standard_normal(3)
    work = float((f * (solid.points @ A.T + b)).sum())
    assert work == pytest.approx(force @ (A @ middle + b), rel=1e-12)
    if solid.kind != "C3D10":
        return
    # and quadratic ones, by Gauss points of the face
    g, w = np.polynomial.legendre.leggauss(3)
    s, t = (a.ravel() for a in np.meshgrid((g + 1) / 2, (g + 1) / 2))
    weights = np.outer(w, w).ravel() / 4
    at = np.column_stack([s, np.ones(9), t]) @ AFFINE.T

    def bent(x):
        return (x @ A.T) * x[:, [0]]

    assert (f * bent(solid.points)).sum() == pytest.approx(force @ (weights @ bent(at)), rel=1e-12)


def test_regions_by_words_boxes_and_functions_agree():
    solid = box("C3D8")
    words = solid.with_regions(a="x > 1 and z < 0.5").regions["a"]
    called = solid.with_regions(a=lambda x: (x[:, 0] >= 1) & (x[:, 2] <= 0.5)).regions["a"]
    boxed = solid.with_regions(a=[[1, -9, -9], [9, 9, 0.5]]).regions["a"]
    assert words.any()
    assert not words.all()
    assert (words == called).all()
    assert (words == boxed).all()
    elements = solid.with_regions(a="x > 1").elements("a")
    corners = solid.points[solid.cells][:, :, 0].min(axis=1)
    assert (elements == np.flatnonzero(corners >= 1)).all()


def test_a_deck_has_what_the_mesh_has(solid, tmp_path):
    """Read by a parser of its own."""
    solid = solid.with_regions(held=on_face("x0"), pulled=on_face("x1"), low="z < 0.6")
    options = {"young": 70e3, "poisson": 0.3, "density": 2.7e-9, "fixed": "held"}
    solid.save(tmp_path / "a.inp", **options, forces={"pulled": (1, -2, 1e-3)})
    text = (tmp_path / "a.inp").read_text()
    assert max(map(len, text.splitlines())) < 132
    told = re.sub(r"^\*.*$", "", text, flags=re.MULTILINE)
    assert max(len(w.strip()) for w in re.split(r"[,\n]", told)) <= 20
    blocks = {}
    for block in re.split(r"^\*(?=[A-Z])", text, flags=re.MULTILINE)[1:]:
        head, _, rest = block.partition("\n")
        body = [line for line in rest.splitlines() if not line.startswith("**")]
        blocks[head] = [[w.strip() for w in line.split(",") if w.strip()] for line in body]
    nodes = np.array(blocks["NODE, NSET=NODES"], float)
    assert (nodes[:, 0] == np.arange(1, len(solid.points) + 1)).all()
    assert nodes[:, 1:] == pytest.approx(solid.points, rel=1e-12, abs=1e-12)
    elements = np.array(blocks[f"ELEMENT, TYPE={solid.kind}, ELSET=SOLID"], int)
    assert (elements[:, 1:] == solid.cells + 1).all()
    for name, inside in solid.regions.items():
        numbers = [int(w) for line in blocks[f"NSET, NSET={name}"] for w in line]
        assert numbers == (np.flatnonzero(inside) + 1).tolist()
    assert "ELSET, ELSET=held" not in blocks
    assert len([w for line in blocks["ELSET, ELSET=low"] for w in line]) == len(
        solid.elements("low")
    )
    sides = [(int(e) - 1, int(s[1:]) - 1) for e, s in blocks["SURFACE, NAME=pulled, TYPE=ELEMENT"]]
    assert sides == [tuple(row) for row in solid.sides("pulled").tolist()]
    total = np.zeros(3)
    for node, axis, value in blocks["CLOAD"]:
        assert solid.regions["pulled"][int(node) - 1]
        total[int(axis) - 1] += float(value)
    assert total == pytest.approx([1, -2, 1e-3], rel=1e-11)
    assert blocks["ELASTIC"] == [["7.000000000000e+04", "3.000000000000e-01"]]
    assert blocks["BOUNDARY"] == [["held", "1", "3"]]
    solid.save(tmp_path / "b.inp")
    assert "MATERIAL" not in (tmp_path / "b.inp").read_text()
    solid.save(tmp_path / "a.vtu")
    assert (tmp_path / "a.vtu").stat().st_size > 1000


@pytest.mark.parametrize(
    ("options", "said"),
    [
        ({"young": -1.0}, "young"),
        ({"young": 1.0, "poisson": 0.5}, "poisson must be between -1 and 0.5"),
        ({"young": 1.0, "fixed": "heldd"}, r"fixed: there is no region 'heldd'; known: held"),
        ({"young": 1.0, "forces": {"x": (1, 0, 0)}}, "forces: there is no region 'x'"),
        ({"young": 1.0, "forces": {"held": (1, 0)}}, r"forces\['held'\]"),
        ({"young": 1.0, "forces": (1, 0, 0)}, "forces must map names"),
        ({"young": 1.0, "forces": {"inner": (1, 0, 0)}}, "no whole side of an element"),
        ({"fixed": "held"}, "give young"),
        ({"density": 1.0}, "give young"),
    ],
)
def test_decks_that_make_no_sense_are_refused(options, said, tmp_path):
    solid = box("C3D8").with_regions(
        held=on_face("x0"),
        inner=lambda x: ~np.any([on_face(f"{a}{e}")(x) for a in "xyz" for e in "01"], axis=0),
    )
    with pytest.raises((InputError, GeometryError), match=said):
        solid.save(tmp_path / "a.inp", **options)
    assert list(tmp_path.iterdir()) == []


def test_regions_that_make_no_sense_are_refused():
    solid = box("C3D8").with_regions(held="x < 1")
    for name in ("SOLID", "nodes", "a b", "1a", "a" * 61):
        with pytest.raises(InputError, match="cannot be called"):
            solid.with_regions(**{name: "x < 1"})
    with pytest.raises(InputError, match="small letters only"):
        solid.with_regions(Held="x < 1")
    with pytest.raises(GeometryError, match=r"far: no node there; the mesh reaches from \["):
        solid.with_regions(far="x > 100")
    with pytest.raises(InputError, match="is not linear"):
        solid.with_regions(a="x*y > 1")
    with pytest.raises(InputError, match="booleans"):
        solid.with_regions(a=lambda x: x[:, 0])
    with pytest.raises(InputError, match="known: held"):
        solid.area("heldd")
    with pytest.raises(FormatError, match="below 1e"):
        il.mesh.SolidMesh(1e100 * solid.points, solid.cells).save("never.inp")


# --- hexahedra --------------------------------------------------------------------------------


def test_hexahedra_of_a_ball_approach_its_volume():
    ball, domain = il.fields.sphere(0.93), [[-1.0, -1.1, -1.0], [1.0, 1.0, 1.2]]
    with pytest.warns(PrecisionWarning, match="is .* % off"):
        il.mesh.hexahedra(ball, 3, domain=domain)
    solid = il.mesh.hexahedra(ball, (24, 25, 26), domain=domain)
    assert solid.volume / (4 / 3 * np.pi * 0.93**3) - 1 == pytest.approx(solid.error, abs=1e-6)
    assert abs(solid.error) < 0.01
    assert solid.parts == 1
    # Gauss: the surface of the cells is closed, and bounds their volume
    x = solid.points[solid._nodes_of(solid.boundary)]
    normal = np.cross(x[:, 2] - x[:, 0], x[:, 3] - x[:, 1]) / 2
    centre = solid.points[solid.cells[solid.boundary[:, 0]]].mean(axis=1)
    normal *= np.sign(np.einsum("ni,ni->n", normal, x.mean(axis=1) - centre))[:, None]
    assert normal.sum(axis=0) == pytest.approx(np.zeros(3), abs=1e-12)
    assert np.einsum("ni,ni->", normal, x.mean(axis=1)) / 3 == pytest.approx(solid.volume)


@pytest.mark.filterwarnings("ignore::ilattice.errors.PrecisionWarning")
def test_hexahedra_go_through_the_map_and_close_at_seams():
    torus = il.macroshape.torus(major=2.0, width=1.0)
    lattice = il.Lattice("schwarz_p", through=torus, repeat=(8, 1, 1))
    solid = il.mesh.hexahedra(lattice.offset(0.2), (64, 8, 8))
    assert (solid.volumes > 0).all()
    assert len(np.unique(solid.points.round(9), axis=0)) == len(solid.points)
    assert solid.volume == pytest.approx(lattice.offset(0.2).volume(), rel=0.1)
    radius = np.linalg.norm(solid.points[:, :2], axis=1)
    assert radius.min() == pytest.approx(1.5, abs=0.1)


def test_a_map_that_turns_space_over_gives_positive_volumes():
    block = il.macroshape.box((1.0, 1.0, 1.0))
    c = np.array(block.spline.c)
    c[..., 0] *= -1.0
    mirrored = il.macroshape.SplineMap(il.BSpline(block.spline.t, c, block.spline.k))
    solid = il.mesh.hexahedra(il.fields.sphere(0.9), 12, domain=[[0] * 3, [1] * 3],
                              through=mirrored)  # fmt: skip
    assert (solid.volumes > 0).all()
    assert solid.points[:, 0].max() <= 0.0


def test_small_parts_that_touch_nothing_are_left_out():
    two = il.fields.union(
        il.fields.sphere(0.8), il.fields.translate(il.fields.sphere(0.15), (0.9, 0.9, 0.9))
    )
    solid = il.mesh.hexahedra(two, 20, domain=[[-1.1] * 3, [1.1] * 3])
    assert solid.parts == 1
    assert solid.points.max() < 0.9
    twins = il.fields.union(
        il.fields.translate(il.fields.sphere(0.4), (-0.5, 0, 0)),
        il.fields.translate(il.fields.sphere(0.4), (0.5, 0, 0)),
    )
    with pytest.warns(PrecisionWarning, match="2 parts that do not touch"):
        assert il.mesh.hexahedra(twins, 30, domain=[[-1] * 3, [1] * 3]).parts == 2


def test_hexahedra_refuse_what_they_cannot_do():
    ball = il.fields.sphere(0.3)
    with pytest.raises(InputError, match="least must be above 0"):
        il.mesh.hexahedra(ball, 4, domain=[[-1] * 3, [1] * 3], least=0.0)
    with pytest.raises(GeometryError, match="no cell has a part of 1 in the solid"):
        il.mesh.hexahedra(ball, 2, domain=[[-1] * 3, [1] * 3], least=1.0)
    grid = il.cutfem.cut(ball, 12, domain=[[-1] * 3, [1] * 3])
    with pytest.raises(InputError, match="CutGrid has cells"):
        il.mesh.hexahedra(grid, 4)
    with pytest.raises(InputError):
        il.mesh.SolidMesh(np.eye(3), [[0, 1, 2]])


# --- tetrahedra -------------------------------------------------------------------------------


def test_without_tetgen_the_remedy_is_told(monkeypatch):
    monkeypatch.setitem(__import__("sys").modules, "tetgen", None)
    with pytest.raises(InputError, match=r'pip install "ilattice\[tetrahedra\]"'):
        il.SurfaceMesh(*cube()).tetrahedra()


@pytest.mark.parametrize("order", [1, 2])
def test_tetrahedra_fill_the_surface_but_not_its_voids(order):
    pytest.importorskip("tetgen")
    shell = il.fields.difference(
        il.fields.sphere(1.0), il.fields.translate(il.fields.sphere(0.5), (0.2, 0.1, 0.0))
    )
    mesh = il.sdf.mesh(shell, 0.2)
    solid = mesh.tetrahedra(order=order)
    assert solid.kind == ("C3D4", "C3D10")[order - 1]
    assert (solid.volumes > 0).all()
    assert solid.volume == pytest.approx(mesh.volume, rel=1e-9)
    corners = solid._nodes_of(solid.boundary)[:, :3]

    def rows(points, faces):
        return {tuple(sorted(map(tuple, points[f].round(9).tolist()))) for f in faces}

    assert rows(solid.points, corners) == rows(mesh.vertices, mesh.faces)
    assert solid.parts == 1
    assert np.unique(solid.cells).size == len(solid.points)


def test_surfaces_that_cannot_be_filled_are_refused():
    pytest.importorskip("tetgen")
    vertices, faces = cube()
    with pytest.raises(GeometryError, match="3 open edges"):
        il.SurfaceMesh(vertices, faces[1:]).tetrahedra()
    with pytest.raises(InputError, match="order"):
        il.SurfaceMesh(vertices, faces).tetrahedra(order=3)
    x = np.asarray(vertices, float)
    both = np.vstack([x, x + 0.37 * np.ptp(x, axis=0)])
    crossing = il.SurfaceMesh(both, np.vstack([faces, np.asarray(faces) + len(x)]))
    with pytest.raises(GeometryError, match="cross each other"):
        crossing.tetrahedra()
    apart = il.SurfaceMesh(np.vstack([x, x + 5.0]), crossing.faces)
    with pytest.warns(PrecisionWarning, match="2 parts that do not touch"):
        apart.tetrahedra()


@pytest.mark.client
def test_calculix_stretches_a_bar_as_it_should(solid, tmp_path):
    """A patch test: a uniform traction on an oblique box, against the exact strain."""
    if shutil.which("ccx") is None:
        pytest.skip("ccx is not installed")
    x = solid.points @ np.linalg.inv(AFFINE).T * [3.0, 1.0, 0.8]
    bar = il.mesh.SolidMesh(x, solid.cells)
    bar = bar.with_regions(held="x < 0", pulled="x > 3")
    bar.save(tmp_path / "a.inp", young=200.0, poisson=0.0, fixed="held",
             forces={"pulled": (16.0, 0, 0)})  # fmt: skip
    text = (tmp_path / "a.inp").read_text()
    asked = "*NODE PRINT, NSET=pulled\nU\n*EL PRINT, ELSET=SOLID, TOTALS=ONLY\nELSE\n*END STEP"
    (tmp_path / "b.inp").write_text(text.replace("*END STEP", asked))
    subprocess.run(["ccx", "-i", "b"], cwd=tmp_path, check=True, capture_output=True)
    found = (tmp_path / "b.dat").read_text()
    moved = np.array(re.findall(r"^ +\d+ +(\S+) +(\S+) +(\S+)$", found, re.MULTILINE), float)
    assert len(moved) == bar.regions["pulled"].sum()
    assert moved[:, 0] == pytest.approx(16.0 / 0.8 / 200.0 * 3.0, rel=1e-5)
    assert moved[:, 1:] == pytest.approx(0.0, abs=1e-6)
    energy = float(re.search(r"total internal energy[^\n]*\s+(\S+)", found)[1])
    assert energy == pytest.approx(0.5 * 16.0 * 0.3, rel=1e-5)
