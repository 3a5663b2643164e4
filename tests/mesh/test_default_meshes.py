"""Meshes with the default length of edges, of the solids and walls of the catalogue."""

import warnings

import combinations as cb
import numpy as np
import pytest
from scipy.ndimage import label

import ilattice as il
from ilattice.errors import ConvergenceError, PrecisionWarning
from ilattice.mesh import wall_mesh
from ilattice.mesh.loss import Loss

NAMES = il.tiles.names()
MAPS = {
    "box": il.macroshape.box((0.97, 1.1, 0.93)),
    "shell": il.macroshape.cylinder_shell(angle=1.1),
}
#: Voxels per direction, and boxes with two random points each.
VOXELS, BOXES = 48, 26
#: Values that are zero up to rounding.
ROUNDED = 1e-14
#: Part of the volume by which a mesh may be off without a word: see `Wall.mesh`; struts lose more.
UNTOLD = 0.04


def inside(lattice, d, u):
    """Which parameters are in the solid (d None) or in the wall, by the tile or exact distances."""
    return lattice.implicit(u) < 0.0 if d is None else np.abs(lattice.distance(u)) < d


def volume(lattice, d):
    """Volume by two random points in each of equal boxes, and its standard error."""
    lo, hi = lattice.domain
    corner = np.indices((BOXES,) * 3).reshape(3, -1).T
    at = np.repeat(corner, 2, axis=0) + np.random.default_rng(3).random((2 * len(corner), 3))
    u = lo + (hi - lo) * at / BOXES
    size = np.abs(np.linalg.det(lattice.through.jacobian(u))) * np.prod(hi - lo) / len(u)
    part = (size * inside(lattice, d, u)).reshape(-1, 2)
    return part.sum(), np.linalg.norm(part[:, 0] - part[:, 1])


def parts(wall):
    """Parts of a grid of samples: joined across corners too, and across faces only.

    Samples on the surface, up to rounding, may join parts or not: W touches itself there.
    """
    lo, hi = wall.lattice.domain
    axis = (np.arange(VOXELS) + 0.5) / VOXELS
    u = np.stack(np.meshgrid(axis, axis, axis, indexing="ij"), axis=-1).reshape(-1, 3)
    value = wall.field(lo + (hi - lo) * u).reshape((VOXELS,) * 3)
    return label(value <= ROUNDED, np.ones((3, 3, 3)))[1], label(value < -ROUNDED)[1]


def faults(name, shape, d=None):
    """What is wrong with the default mesh of a tile, as a list of texts.

    `d` is half the thickness of a wall, relative to the size of a tile and what its waves allow.
    """
    lattice = il.Lattice(name, through=MAPS[shape])
    if d is not None:
        d *= cb.sizes(lattice.through, (1, 1, 1))[0]
        d /= max(1.0, getattr(il.tiles.row(name), "area", 4.0) / 3.0)
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        wall = lattice.offset((np.inf, 0.0) if d is None else d)
        mesh = wall.mesh()
    told = " ".join(str(w.message) for w in caught if issubclass(w.category, PrecisionWarning))
    out = []
    if not (mesh.is_watertight and mesh.is_oriented) or mesh.self_intersections:
        out.append("not sound")
    if mesh.nonmanifold_edges or mesh.nonmanifold_vertices:
        out.append("not manifold")
    true, error = volume(lattice, d)
    off = mesh.volume / true - 1.0
    if abs(off) > 0.05 + 3 * error / true:
        out.append(f"volume {off:+.1%}")
    elif abs(off) > UNTOLD + 2 * error / true and "volume" not in told:
        out.append(f"volume {off:+.1%}, untold")
    least, most = parts(wall)
    found = cb.solid_parts(mesh)
    if not least <= found <= most:
        out.append(f"{found} parts instead of {least} to {most}")
    return out


@pytest.mark.filterwarnings("ignore:the spline approximation of tile")
@pytest.mark.parametrize("name", ["fcc_plates", *NAMES[6::8]])
def test_default_meshes_of_solids_are_whole(name):
    assert faults(name, "box" if NAMES.index(name) % 8 > 4 else "shell") == []


@pytest.mark.filterwarnings("ignore:the spline approximation of tile")
@pytest.mark.parametrize("name", ["c_i2y", "k", "sc_plates"])
def test_default_meshes_of_walls_are_whole(name):
    assert faults(name, "box" if NAMES.index(name) % 32 > 16 else "shell", 0.12) == []


@pytest.mark.parametrize(("name", "d"), [("gyroid", 0.147), ("iwp", 0.11), ("primitive", 0.19)])
def test_pores_of_thick_walls_bend_by_default(name, d):
    lattice = il.Lattice(name, through=il.macroshape.box((1.02, 0.96, 1.05)))
    mesh = lattice.offset(d).mesh()
    true, error = volume(lattice, d)
    assert mesh.volume == pytest.approx(true, rel=0.01 + 2 * error / true)
    assert error < 0.003 * true


@pytest.mark.filterwarnings("ignore:the mesh with h=:ilattice.errors.PrecisionWarning")
def test_shorter_edges_are_taken_where_vertices_are_off():
    through = il.macroshape.load(cb.DATA / "gismo/fichera.xml", 0)
    wall = il.Lattice("split_p", through=through).offset(0.10908063207556288)
    length = 0.25 * wall.least_thickness
    with pytest.raises(ConvergenceError, match="vertices are off"):
        wall.mesh(length)
    mesh = wall.mesh()
    assert mesh.is_watertight
    assert mesh.self_intersections == 0
    assert (
        np.median(np.linalg.norm(np.diff(mesh.vertices[mesh.faces[:, :2]], axis=1), axis=2))
        < length
    )


def test_polished_vertices_have_the_distance_that_they_were_moved_to():
    """It was that of the spline, up to a quarter of d off."""
    lattice = il.Lattice("lidinoid", through=il.macroshape.box((1.1, 0.9, 1.2)))
    wall = lattice.offset((0.02, 0.031))
    mesh = wall.mesh(0.024, allow_loss=True)
    data = mesh.point_data
    on = (data["side"] != 0) & (data["unconverged"] == 0)
    u = np.stack([data[k] for k in "uvw"], axis=1)[on][::7]
    told = data["signed_distance"][on][::7]
    np.testing.assert_allclose(told, lattice.distance(u), atol=1e-5 * 0.02)
    assert np.abs(wall.distance(u) - told).max() > 1e-3 * 0.02


def test_shorter_edges_end_where_they_do_not_help(monkeypatch):
    """Bends of the offset that no length of edges shows: not all lengths are tried."""
    made = []

    def lacking(_wall, _mesh, h, **_):
        made.append(h)
        return Loss(0.1, f"the mesh with h={h:g} lacks", most=np.inf)

    monkeypatch.setattr(wall_mesh, "missing", lacking)
    wall = il.Lattice("gyroid", through=il.macroshape.box((1.0, 0.9, 1.1))).offset(0.1)
    with pytest.warns(PrecisionWarning, match="lacks"):
        mesh = wall.mesh()
    assert len(made) == 2
    assert mesh.is_watertight
