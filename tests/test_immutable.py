"""Everything public is immutable, also after `pickle` and `copy.deepcopy`: class by class.

What they are shows in one short line. A public class without an example here is an error, so
that none is forgotten.
"""

import copy
import importlib
import pickle
import sys
from collections.abc import Mapping
from contextlib import suppress
from enum import Enum
from functools import cached_property

import numpy as np
import pytest
from scipy.sparse import csr_array

import ilattice as il
from ilattice.errors import IlatticeError

ROOMS = (
    "bspline", "tiles", "macroshape", "fields", "sdf", "mesh", "offsets", "cutfem", "io",
    "homogenize", "minimal", "lattice", "linalg", "quadrature", "slicing", "topology", "plot",
    "cost", "shells", "graph",
)  # fmt: skip
#: Those that do something, and have no state that users could take for a result; and the base of
#: laws, whose classes are users' own (problems keep a copy of what they are given).
TOOLS = {"cutfem.Law", "offsets.ClosestPointSearch", "cutfem.Solver", "linalg.Solver",
         "io.StreamedMeshWriter", "plot.Scene", "plot.Panels"}  # fmt: skip


def public_classes():
    """Public classes by room and name; those of the top are in rooms, too."""
    found = {}
    for room in ROOMS:
        module = importlib.import_module(f"ilattice.{room}")
        for name in module.__all__:
            thing = getattr(module, name)
            if isinstance(thing, type) and not issubclass(thing, (Exception, Enum)):
                found[f"{room}.{name}"] = thing
    return found


CLASSES = public_classes()


def entities():
    """One of each kind of what tiles are made of."""
    from ilattice.tiles import (
        Arc,
        Ball,
        Curve,
        Group,
        Patch,
        Polyline,
        Segments,
        Surface,
        Triangles,
    )

    rng = np.random.default_rng(1)
    line = Polyline(rng.random((3, 3)))
    knots = [[0, 0, 0.4, 1, 1]]
    curve = Curve(il.BSpline(knots, rng.random((3, 3)), 1))
    sheet = il.BSpline(knots * 2, rng.random((3, 3, 3)), 1)
    patch = Patch(rng.random((3, 3)))
    arc = Arc((0.3, 0.5, 0.5), (0.2, 0, 0), (0, 0.2, 0))
    ball, triangles = Ball((0.5, 0.5, 0.5)), Triangles(np.eye(3), [[0, 1, 2]], [0.1, 0.2, 0.3])
    pairs = Segments(rng.random((4, 2, 3)), rng.random(4))
    return [line, pairs, arc, curve, patch, Surface(sheet), Group([line]), ball, triangles]


class Slow(il.cutfem.Law):
    """A law of one unknown."""

    def tangent(self, asm, u):  # noqa: ARG002
        return 0.1 * np.eye(3).reshape(1, 1, 3, 1, 3)


@pytest.fixture(scope="module")
def examples():
    """One object of each public class."""
    lattice = il.Lattice("gyroid", through=il.macroshape.box(), repeat=1)
    wall, ball = lattice.offset(0.1), il.fields.sphere(1.0)
    mesh = il.sdf.mesh(ball, 0.2)
    distance = il.sdf.MeshDistance(mesh)
    slices = mesh.slices(thickness=0.4)
    solid = il.cutfem.Elasticity(wall, 4).clamp("w=0").load(gravity=(0.1, 0.2, -1))
    solution = solid.solve()
    heat = il.cutfem.Heat(wall, 4).fix("w=0", 0.0).source(1.0)
    temperature = heat.solve()
    modes = il.cutfem.natural_modes(solid, 2)
    point = lattice.through.x([[0.2, 0.3, 0.1]])
    flow = il.cutfem.Physics(wall, 4, law=Slow()).hold("w=0", 0.0).load(body=1.0)
    field = flow.solve()
    study = il.cutfem.refinement_study(
        lambda cells: il.cutfem.Heat(wall, cells).fix("w=0", 0.0).source(1.0).solve(),
        (2, 4, 8),
        {"mean": lambda solution: float(solution.coefficients.mean())},
    )
    found = [
        lattice, wall, ball, mesh, distance, slices, slices[1], solid, solution, heat, temperature,
        modes, modes[0], study, lattice.through, lattice.through.spline,
        il.macroshape.torus(major=1.0, width=0.7).certificate, lattice.through.locate(point),
        il.tiles.get("cross"), il.tiles.get("gyroid").field, il.tiles.mix("cross", "f", seed=1),
        il.tiles.skeleton([[(0, 0.5, 0.5), (1, 0.5, 0.5)]], radius=0.1).field, *entities(),
        il.tiles.sigmoid(0, [0.5], 0.1), distance.closest([[0.1, 0.2, 0.3]]), distance.faults,
        il.sdf.Command.read("box rotate 10 0,0,1 -s 0.2"), il.sdf.plan(ball, 0.5),
        lattice.closest([[0.2, 0.3, 0.4]]), lattice.statistics, wall.minimum_gap(),
        lattice.offset(0.1, space="parametric"), wall.thickness_error(mesh_of(wall)),
        il.cutfem.cut(wall, 4), solid.domain.cut.grid, il.cutfem.quadrature(wall, 4),
        il.cutfem.mass_properties(wall, 4), heat.evolve(1.0, steps=2), modes.report,
        solution.recovered(), temperature.recovered(), solution.error_estimate(),
        solution.report, solution.solved, il.cutfem.buckling(solution, 1), solid.assembly.space,
        solution.at(point, outside="nan"),
        flow, field, field.recovered(),
        il.mesh.hexahedra(wall, 8).with_regions(left="x < 0"), *cells(), *surfaces(), *below(),
        *structures(), *shells(), *graphs(),
    ]  # fmt: skip
    return {type(thing): thing for thing in found}


def below():
    """What lattices and walls are made of."""
    tiling = il.macroshape.Tiling("gyroid", through=il.macroshape.box(), repeat=1)
    middle = il.offsets.MidSurface("gyroid", through=tiling.through, repeat=1)
    return [il.fields.Field(), tiling, middle, il.offsets.offset_solid(middle, 0.1)]


def cells():
    """A cell that repeats, and what it amounts to."""
    wall = il.Lattice("gyroid", through=il.macroshape.cell(), repeat=1).offset(0.1)
    elastic, heat = il.homogenize.ElasticCell(wall, 6), il.homogenize.ConductiveCell(wall, 6)
    eff, k = elastic.homogenized(), heat.homogenized()
    found = [elastic, heat, eff, k, eff.bounds, k.bounds, eff.report, il.macroshape.cell()]
    h = il.homogenize
    waves = h.BlochCell(wall, 4)
    bands = h.bloch(waves.domain, path="GX", count=2, steps=1, modes=True)
    fit = h.Fit(1.0, 2.0, (0.9, 1.1), (1.9, 2.1), 0.01, 3)
    more = [waves, bands, bands.mode(1, 0), bands.report, h.Gap(1, 0.5, 0.7), fit]
    more.append(elastic.under((1.0, 0, 0, 0, 0, 0)))
    C = il.cutfem.orthotropic(young=1.0, poisson=0.3)
    more.append(il.cutfem.Graded("rho", [0.0, 1.0], [C, 2 * C]))
    return [*found, *more, h.sweep("gyroid", thickness=0.1, cells=4)]


def surfaces():
    """A minimal surface, and what it is made of."""
    loop = il.minimal.tetrahedron().faces("z=0 x=1/2 y=z x=y")
    patch = il.minimal.conjugate(loop, 2)
    whole, region = patch.completed(), loop.region
    return [loop, patch, patch.report, patch.disc, whole, region, region.group, region.mirrors[0]]


def structures():
    """A structure of tetrahedra, refined, its beams, blocks and a map."""
    k = il.cost.kagome(2).refined()
    straight = il.cost.BernsteinSimplex.straight(np.vstack([np.zeros(3), np.eye(3)]), 2)
    spline = il.cost.boxspline.field(il.cost.kagome(2))
    return [k, k.beams(0.01), il.cost.Blocks(4), straight, spline, il.cost.kagome(3).pipes(0.01)]


def shells():
    """A shell, what it is made of, and how stiff many are."""
    s = il.shells
    shell = s.cell("topo_19_rrr", n=8, spans=8)
    of, moduli = s.space("topo_19_rrr"), np.linspace(0.1, 0.2, 32)
    rows = il.homogenize.sweep("gyroid", thickness=0.3, cells=4)
    cloud = s.Cloud(of, of.points(32), *(moduli.copy() for _ in range(4)), rows)
    model = s.Surrogate(cloud, 8, 0.03, 4)
    found = model.invert(young=0.15, poisson=0.15, density=0.3, verify=False)
    made = [shell.topology, shell.topology.segments[0], shell.surface.boundary, shell.surface]
    return [shell, *made, s.family("topo_19_rrr", n=8, spans=8), of, cloud, model, found[0]]


def graphs():
    """A procedural graph, and each of its nodes."""
    from graphs import every_type

    graph = every_type()
    return [graph, il.graph.library, *graph.nodes]


def mesh_of(wall):
    return wall.mesh(0.2, allow_loss=True)


def lacks(thing, path, seen):
    """What could be changed in the public attributes of a thing, and in theirs."""
    if id(thing) in seen:
        return
    seen[id(thing)] = thing
    if isinstance(thing, np.ndarray):
        if thing.flags.writeable:
            yield f"{path} can be written to"
    elif isinstance(thing, (dict, list, set, bytearray)):
        yield f"{path} is a {type(thing).__name__}"
    elif isinstance(thing, Mapping):
        for key, value in thing.items():
            yield from lacks(value, f"{path}[{key!r}]", seen)
    elif isinstance(thing, tuple):
        for i, value in enumerate(thing):
            yield from lacks(value, f"{path}[{i}]", seen)
    elif type(thing).__module__.startswith("ilattice") and hasattr(thing, "__dict__"):
        for name, value in {**vars(thing), **made(thing)}.items():
            if name[0] != "_":
                yield from lacks(value, f"{path}.{name}", seen)


def made(thing):
    """Values of attributes that are made when they are first asked for, and kept."""
    found = {}
    for kind in type(thing).__mro__:
        for name, value in vars(kind).items():
            if name[0] != "_" and isinstance(value, cached_property):
                with suppress(IlatticeError, NotImplementedError):
                    found[name] = getattr(thing, name)
    return found


def own(thing):
    """Names of attributes that must not be bound to something else."""
    public = [name for name in getattr(thing, "__dict__", ()) if name[0] != "_"]
    names = thing._fields if isinstance(thing, tuple) else public
    return ["foo", *names] if hasattr(thing, "__dict__") else list(names)


@pytest.mark.filterwarnings("ignore::ilattice.errors.PrecisionWarning")
@pytest.mark.parametrize("name", sorted(set(CLASSES) - TOOLS))
def test_public_objects_and_their_copies_are_immutable(name, examples):
    kind = CLASSES[name]
    known = [thing for its, thing in examples.items() if its is kind or name == "fields.Node"]
    assert known, f"{name} has no example here"
    thing = known[0]
    for way in (lambda x: x, copy.copy, copy.deepcopy, lambda x: pickle.loads(pickle.dumps(x))):
        other = way(thing)
        assert type(other) is type(thing)
        assert not list(lacks(other, name, {}))
        for attribute in own(other):
            with pytest.raises(AttributeError):
                setattr(other, attribute, getattr(thing, attribute, 1))
            with pytest.raises(AttributeError):
                delattr(other, attribute)


def oblique(x):
    """Level set of two phases."""
    return x @ np.array([0.3, -0.2, 0.9]) - 0.4


@pytest.mark.filterwarnings("ignore::ilattice.errors.PrecisionWarning")
@pytest.mark.parametrize("kind", [il.cutfem.Elasticity, il.cutfem.Heat])
@pytest.mark.parametrize("solid", ["wall", "tree"])
def test_solids_of_two_materials_and_their_copies_are_immutable(kind, solid, examples):
    field = examples[il.Lattice].offset(0.1) if solid == "wall" else il.fields.sphere(0.8)
    domain = None if solid == "wall" else [[-1.0] * 3, [1.0] * 3]
    name = "young" if kind is il.cutfem.Elasticity else "conductivity"
    held = kind(field, 4, domain=domain, phases=oblique, **{name: (1.0, 3.0)})
    other = pickle.loads(pickle.dumps(held))
    for thing in (held, other):
        assert not list(lacks(thing, kind.__name__, {}))
    assert held.domain.interface.weights.tobytes() == other.domain.interface.weights.tobytes()


def arrays(thing, depth=0):
    """Public arrays, in order."""
    if isinstance(thing, np.ndarray):
        yield thing
    elif isinstance(thing, Mapping):
        for key in thing:
            yield from arrays(thing[key], depth)
    elif isinstance(thing, tuple):
        for value in thing:
            yield from arrays(value, depth)
    elif depth < 3 and type(thing).__module__.startswith("ilattice"):
        for field in sorted(getattr(type(thing), "__dataclass_fields__", ())):
            if not field.startswith("_"):
                yield from arrays(getattr(thing, field), depth + 1)


def others(examples, folder):
    """More things that a console may show: deep, wide, or of a kind that is not public."""
    wall = examples[il.Lattice].offset(0.1)
    f = il.fields
    balls = f.union(*(f.translate(f.sphere(0.1), (i, 0, 0)) for i in range(30)))
    moved = f.translate(f.rotate(f.box((1, 2, 3)), 0.3, (1, 1, 1)), (0.1, 0.2, 0.3))
    deep = balls
    for _ in range(100):
        deep = f.complement(f.dilate(deep, 0.01))
    K = csr_array(np.eye(12))
    parts = [wall, wall.thickness, wall.thickness_error(mesh_of(wall)), wall.topology(), wall.field]
    made = [
        f.dilate(balls, 0.1),
        f.shell(moved, 0.1),
        f.mix(balls, moved, moved),
        f.normalize(deep),
    ]
    leaves = [
        f.from_callable(oblique),
        f.from_callable(lambda x: x[:, 0]),
        f.equation("x +" * 50 + " y"),
    ]
    return [
        *parts, balls, moved, deep, *made, *leaves, f.intersection(balls, moved, radius=0.1),
        f.twist(moved, 0.1), f.repeat(moved, (1, 2, 3)), f.torus(2.0, 1.0), f.half_space((1, 0, 0)),
        il.tiles.get("cross").field.node, il.offsets.ClosestPointSearch(examples[il.Lattice]),
        il.sdf.plan(balls, 0.1), il.cutfem.Solver(K), Slow(), il.io.StreamedMeshWriter(
            folder / "a.ply"), il.plot.Scene(), il.plot.Panels([il.plot.Scene()] * 9),
        wall.distance, wall.through.certificate,
    ]  # fmt: skip


def catalogued():
    """All rows of the catalogue, their tiles and fields."""
    tiles = [il.tiles.get(name) for name in il.tiles.names()]
    return [*map(il.tiles.row, il.tiles.names()), *tiles, *(tile.field for tile in tiles)]


def laden(examples):
    """Meshes with much data or many regions, and what is made of them."""
    mesh, solid = examples[il.SurfaceMesh], examples[il.mesh.SolidMesh]
    data = {f"data number {i}": np.zeros(len(mesh.vertices)) for i in range(20)}
    full = il.SurfaceMesh(mesh.vertices, mesh.faces, data)
    regions = {f"region_number_{i}": f"x < {i}" for i in range(20)}
    open_mesh = il.SurfaceMesh(mesh.vertices, mesh.faces[1:], data)
    distances = [il.sdf.MeshDistance(m, strict=False) for m in (full, open_mesh)]
    return [full, *distances, solid.with_regions(**regions)]


@pytest.mark.filterwarnings("ignore::ilattice.errors.PrecisionWarning")
def test_located_points_show_how_many_there_are(examples):
    located = examples[il.macroshape.Located]
    assert repr(located) == "Located(1 points, 0 failures)"


@pytest.mark.filterwarnings("ignore::ilattice.errors.PrecisionWarning")
def test_everything_shows_itself_in_one_short_line(examples, tmp_path):
    unfit = []
    for thing in [*examples.values(), *others(examples, tmp_path), *catalogued(), *laden(examples)]:
        shown = repr(thing)
        if len(shown) >= 120 or "\n" in shown or " at 0x" in shown or "array(" in shown:
            unfit.append(f"{type(thing).__module__}.{type(thing).__name__}: {shown[:150]}")
    assert not unfit, f"{len(unfit)} of these\n" + "\n".join(unfit)


def test_fields_show_what_they_are_made_of():
    f = il.fields
    ball = f.sphere(0.25)
    assert repr(ball) == "Sphere(radius=0.25)"
    moved = repr(f.translate(ball, (0.1, 0.2, 0.3)))
    assert moved == "Placed(part=Sphere(radius=0.25), factor=1)"
    assert repr(f.union(ball, f.sphere(1.0))) == (
        "Union(parts=(Sphere(radius=0.25), Sphere(radius=1)), radius=0)"
    )
    kinds = (f.dilate, "Dilation"), (f.erode, "Erosion"), (f.shell, "Shell")
    for make, kind in kinds:
        assert repr(make(ball, 0.1)).startswith(f"{kind}(part=Sphere(radius=0.25), amount=")
    assert repr(f.intersection(ball, f.sphere(1.0))).startswith("Intersection(")
    balls = repr(f.union(*map(f.sphere, range(1, 31))))
    assert balls.startswith("Union(parts=(Sphere(radius=1), ")
    assert "30 in all" in balls


@pytest.mark.filterwarnings("ignore::ilattice.errors.PrecisionWarning")
@pytest.mark.parametrize("name", sorted(set(CLASSES) - TOOLS))
def test_copies_hold_the_same_numbers(name, examples):
    thing = examples.get(CLASSES[name], examples[il.Lattice])
    for other in (copy.deepcopy(thing), pickle.loads(pickle.dumps(thing))):
        for mine, theirs in zip(arrays(thing), arrays(other), strict=True):
            assert mine.dtype == theirs.dtype
            assert mine.tobytes() == theirs.tobytes()


def test_solvers_can_be_copied():
    rng = np.random.default_rng(2)
    a = rng.random((12, 12))
    solver = il.cutfem.Solver(csr_array(a @ a.T + np.eye(12)), method="superlu")
    b = rng.random(12)
    for other in (copy.deepcopy(solver), pickle.loads(pickle.dumps(solver))):
        np.testing.assert_array_equal(other.solve(b)[0], solver.solve(b)[0])


def test_read_only_arrays_are_no_other_type_to_kernels():
    """They would be compiled once more for them, for minutes."""
    from ilattice._validate import as_array

    a = np.arange(6.0).reshape(2, 3)
    assert as_array("a", a) is a
    a.flags.writeable = False
    b = as_array("a", a)
    assert b.flags.writeable
    assert not np.shares_memory(a, b)
    np.testing.assert_array_equal(a, b)


@pytest.mark.filterwarnings("ignore::ilattice.errors.PrecisionWarning")
def test_analysis_compiles_no_kernel_once_more_for_read_only_arrays(examples):
    for kind in (il.cutfem.Elasticity, il.cutfem.Heat):
        thing = pickle.loads(pickle.dumps(examples[kind]))
        thing.solve().at(thing.assembly.coordinates[:0], outside="nan").data  # noqa: B018
    twice = []
    compiled = tuple(f"ilattice.{room}._k" for room in ("cutfem", "quadrature", "linalg"))
    for module in [m for name, m in sys.modules.items() if name.startswith(compiled)]:
        for name, kernel in vars(module).items():
            known = [str(s) for s in getattr(kernel, "signatures", ())]
            plain = [s.replace("readonly ", "").replace(", readonly", "") for s in known]
            twice += [f"{name}: {a}" for a in {*plain} if plain.count(a) > 1]
    assert not twice, "\n".join(twice)
