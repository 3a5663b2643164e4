"""Every public callable with arguments that make no sense: our errors, soon, and little memory.

Soon means few calls of Python functions, which are the same on every machine; compiling, which only
the first run does, is not counted.
"""

import importlib
import inspect
import os
import random
import sys
import tracemalloc
import warnings
from enum import Enum

import numpy as np
import pytest
from numba.core import event

import ilattice as il
from ilattice.errors import IlatticeError, InputError
from ilattice.graph.solids import TYPES

ROUNDS = int(os.environ.get("ILATTICE_ROUNDS", "2"))
ROOMS = (
    "bspline", "tiles", "macroshape", "fields", "sdf", "mesh", "offsets", "cutfem", "io",
    "homogenize", "minimal", "lattice", "linalg", "quadrature", "slicing", "topology", "cost",
    "shells", "graph",
)  # fmt: skip
SKIPPED = {"save_grid", "contact_sheet"}
MAX_CALLS = 400_000  # of functions, within less than two seconds
MAX_MEMORY = 500e6
NAN, INF = float("nan"), float("inf")
ODD = [
    NAN, INF, -INF, 0, -1, 1e-320, 1e300, -1e-300, 2**70, 10**400, True, None, "", "x", "nan", b"1",
    1j, (), [], {}, {1: 2}, set(), object(), lambda *_: None, lambda *u: u[0],
    lambda *u: np.full(len(u[0]), np.nan), lambda *_: "text", range(3), np.zeros(0),
    np.zeros((0, 3)),
    np.zeros((2, 2)), np.full((3, 3), np.nan), np.array([1 + 1j]), np.array("a"), np.ones(3, bool),
    np.ma.masked_all((2, 3)), [[1, 2], [3]], [[np.inf, 0, 0]], [NAN] * 3, (1, 2), [None] * 3,
    np.float32(1), np.datetime64("2020-01-01"), "a" * 5000, "\0", [[1e300] * 3] * 2, (0, 0),
    np.zeros((3, 3, 3, 3)), [1e18, 1, 1], 10**9, 1e-12, "/dev/zero", "gyroid", "../nothing.stl",
]  # fmt: skip


def good():
    """Arguments that make sense, by the name of the parameter."""
    box = il.macroshape.box()
    lattice = il.Lattice("gyroid", through=box, repeat=1)
    wall = lattice.offset(0.1)
    ball = il.fields.sphere(1.0)
    mesh = il.sdf.mesh(ball, 0.2)
    axes = [np.linspace(-1.2, 1.2, 7)] * 3
    return {
        "lattice": lattice, "wall": wall, "mesh": mesh, "field": ball, "f": ball, "g": ball,
        "part": ball, "a": ball, "b": ball, "solid": ball, "spline": box.spline, "through": box,
        "space": box, "axes": axes, "d": 0.1, "h": 0.4, "tile": "gyroid", "repeat": 1, "k": 1,
        "t": [[0, 0, 1, 1]], "c": [0.0, 1.0], "cells": 4, "u": [[0.2, 0.3, 0.4]], "tol": 0.1,
        "x": [[0.2, 0.3, 0.4]], "points": [[0.2, 0.3, 0.4]], "radius": 0.2, "name": "gyroid",
        "thickness": 0.3, "text": "x + y", "vertices": mesh.vertices, "faces": mesh.faces,
        "command": "sphere", "spacing": 0.4, "path": "nowhere/a.stl", "degree": 2, "axis": 0,
    }  # fmt: skip


def minimal():
    """Arguments of minimal surfaces."""
    region = il.minimal.tetrahedron()
    loop = region.faces("z=0 x=1/2 y=z x=y")
    around, flat = [[0, 0, 0], [1, 0, 0], [1, 1, 0]], [[0, 0, 0], [0.5, 0, 0], [0.5, 0.5, 0.0]]
    square = {"region": region, "normals": region.normals, "offsets": region.offsets, "n": 3}
    mixed = {"corners": flat, "slides": ["z=0", None, None]}
    return {
        "minimal.conjugate": {"faces": loop, "n": 3}, "minimal.FaceLoop": {"region": region},
        "minimal.direct": {"boundary": around, "n": 3}, "minimal.mixed": {**square, **mixed},
        "minimal.Region": {**square, "cell": 1.0}, "minimal.reflection": {"normal": (0, 0, 1)},
        "minimal.half_turn": {"point": (0, 0, 0), "direction": (0, 0, 1)},
        "minimal.generated": {"generators": list(region.mirrors)},
        "minimal.Isometry": {"matrix": np.eye(3), "shift": np.zeros(3)},
    }  # fmt: skip


def structures():
    """Arguments of corner-sharing structures."""
    x, tets = il.cost.divided_box(1)
    layer = il.cost.kagome(2, dim=2)
    layers = [np.column_stack([layer.positions, np.full(9, z)]) for z in (0.0, 0.4)]
    corners = np.vstack([np.zeros(3), np.eye(3)])
    mesh = {"vertices": x, "simplices": tets}
    return {
        "cost.fill": {**mesh, "resolution": 2}, "cost.midpoint": mesh,
        "cost.kagome": {"resolution": 3}, "cost.Blocks": {"resolution": 5},
        "cost.stacked": {"layer": layer, "layers": layers},
        "cost.CornerSharing": {"positions": x[:4], "simplices": [[0, 1, 2, 3]]},
        "cost.Beams": {"vertices": corners, "pairs": [[0, 1]], "radii": [[0.1, 0.1]]},
        "cost.Pipes": {"quads": np.zeros((1, 3, 3, 3)), "triangles": np.zeros((1, 6, 3))},
        "cost.BernsteinSimplex": {"degree": 1, "points": corners, "corners": corners},
    }  # fmt: skip


def shells():
    """Arguments of shells."""
    name, curves = {"name": "topo_19_rrr", "n": 8}, il.shells.boundary("topo_19")
    return {
        "shells.cell": name, "shells.boundary": name, "shells.topology": name,
        "shells.space": name, "shells.surface": {"curves": curves, "n": 8},
        "shells.family": {**name, "spans": 8}, "shells.Boundary": {"topology": curves.topology},
    }  # fmt: skip


def graphs():
    """Arguments of nodes of procedural graphs."""
    g = il.graph
    hexagon = il.minimal.cuboid().faces("x+ z- y+ x- z+ y-")
    edges = [hexagon.region.edge(hexagon.numbers[i - 1], k) for i, k in enumerate(hexagon.numbers)]
    corners = [g.vertex(edge.mean(axis=0)) for edge in edges]
    around = g.chain(corners, closed=True)
    film = g.surface(around, kind="conjugate", edges=2)
    line = g.line(g.chain(corners[:2]))
    thing = g.object(line, resolution=4)
    voxel = g.voxel(thing)
    takes = {
        "chain": {"vertices": corners[:2]}, "line": {"chains": around},
        "group": {"skeletons": [line]},
        "surface": {"chains": around, "kind": "conjugate", "edges": 2}, "dual": {"surface": film},
        "associate": {"first": g.dual(film), "second": film, "angle": 0.3},
        "object": {"skeleton": line}, "voxel": {"solid": thing}, "stiffness": {"voxel": voxel},
        "bandgap": {"voxel": voxel}, "mirror": {"skeleton": line, "direction": "x"},
        "transform": {"skeleton": line}, "boolean": {"objects": [thing, thing]},
        "vertex": {"position": (0, 0, 0)},
    }  # fmt: skip
    kinds = {cls.__name__: word for word, cls in TYPES.items()}
    both = {**{f"graph.{word}": v for word, v in takes.items()}}
    both |= {f"graph.{name}": takes[word] for name, word in kinds.items()}
    return {
        **both, "graph.Graph": {"roots": thing},
        "graph.ways": {"within": hexagon.region, "sides": 4},
        "graph.truss": {"number": 7}, "graph.random_graph": {"kind": "truss", "seed": 1},
        "graph.explore": {"kind": "truss", "seeds": 1, "cells": 4, "thickness": 0.5},
        "graph.parse": {"text": "{}"}, "graph.load": {"path": "nowhere.json"},
        "graph.halfspaces": {"normals": [[-1, 0, 0], [0, -1, 0], [0, 0, -1], [1, 1, 1]],
                             "offsets": [0, 0, 0, 0.5]},
    }  # fmt: skip


def own(sense):
    """Arguments that make sense to one callable only, by its name."""
    line = il.BSpline([[0, 0, 0.4, 1, 1]], [[0, 0, 0], [0.5, 0.1, 0], [1, 0, 0]], 1)
    flat = np.array([[[0, 0, 0], [0, 1, 0]], [[1, 0, 0], [1, 1, 0.2]]])
    sheet, above = (il.BSpline([[0, 0, 1, 1]] * 2, flat + np.array([0, 0, h]), 1) for h in (0, 1))
    box, ball, corners = sense["through"], sense["f"], [[0, 0, 0], [1, 0, 0], [1, 1, 0.0]]
    strut = [[(0, 0.5, 0.5), (1, 0.5, 0.5)]]
    block = (sense["mesh"].vertices, sense["mesh"].faces)
    closed = il.cutfem.Grid((np.linspace(0.0, 1.0, 5),) * 3, (True,) * 3)
    cell = il.cutfem.cut(lambda u: np.cos(2 * np.pi * u).sum(axis=1), closed)
    labels = np.arange(8).reshape(2, 2, 2) % 2
    kinds = ("elastic", "conductive", "ElasticCell", "ConductiveCell")
    return {
        **{f"homogenize.{kind}": {"field": cell, "through": None} for kind in kinds},
        "cutfem.Graded": {"at": [0.0, 1.0], "C": [np.eye(6)] * 2},
        "cutfem.orthotropic": {"young": 1.0, "poisson": 0.3},
        "homogenize.macro": {"wall": sense["wall"], "cells": 2, "tile_cells": 4},
        "homogenize.voxels": {"array": labels, "young": (1.0, 2.0), "spacing": 1.0},
        "homogenize.conductive_voxels": {"array": labels, "spacing": 1.0},
        **minimal(), **structures(), **shells(), **graphs(),
        "tiles.Ball": {"centre": (0.5, 0.5, 0.5)},
        "tiles.Arc": {"centre": (0.3, 0.5, 0.5), "u": (0.2, 0, 0), "v": (0, 0.2, 0)},
        "tiles.Curve": {"spline": line}, "tiles.Surface": {"spline": sheet},
        "tiles.Group": {"members": [il.tiles.Polyline(corners)]},
        "tiles.Patch": {"corners": corners}, "tiles.Polyline": {"points": corners},
        "tiles.Segments": {"points": [corners[:2]]},
        "tiles.SkeletonField": {"entities": strut}, "tiles.skeleton": {"entities": strut},
        "tiles.struts": {"nodes": corners, "edges": [[0, 1], [1, 2]], "radii": 0.1},
        "tiles.hybrid": {"weight": il.tiles.sigmoid(0, [0.5], 0.2)},
        "macroshape.affine": {"matrix": np.eye(3)}, "macroshape.certify": {"volume": box},
        "macroshape.check_map": {"volume": box}, "macroshape.loft": {"sections": [sheet, above]},
        "macroshape.extrude": {"surface": sheet}, "macroshape.regrade": {"volume": box},
        "macroshape.ruled": {"first": sheet, "second": above},
        "macroshape.revolve": {"surface": sheet, "point": (-1, 0, 0), "axis": (0, 1, 0)},
        "fields.capsule": {"first": (0, 0, 0), "second": (1, 0, 0)},
        "fields.constant": {"text": "1/3"}, "fields.rotate": {"axis": (0, 0, 1)},
        "fields.difference": {"first": ball, "second": ball},
        "fields.mix": {"first": ball, "second": ball, "weight": ball},
        "io.save": {"obj": sense["mesh"], "path": "s.stl"},
        "io.save_bezier_vtu": {"volume": box, "path": "s.vtu"},
        "io.write_pvd": {"path": "s.pvd", "files": ["a.vtu"], "times": [0.0]},
        "io.write_stream": {"path": "s.stl", "blocks": [block]},
        "io.write_vtu": {
            "path": "s.vtu", "cells": [[0, 1, 2]], "cell_type": 5, "points": corners
        },
    }  # fmt: skip


#: Methods that work for seconds where arguments make sense, draw, or are those of tuples.
SLOW = {"topology", "topology_sweep", "plot", "screenshot", "index", "count"}
BALL = [[-1.0] * 3, [1.0] * 3]


def solids():
    """A heated and an elastic ball on few cells, and what becomes of them."""
    elastic = il.cutfem.Elasticity(
        lambda u: (u**2).sum(axis=1) - 0.6, 4, domain=BALL, density=1.0, expansion=0.1
    ).clamp("surface")
    bent = elastic.load(body=(0, 0, 1), temperature=1.0)
    heat = il.cutfem.Heat(elastic.domain, capacity=1.0).fix("surface", 0.0).source(1.0)
    solution, warm = bent.solve(), heat.solve()
    return [
        bent, heat, solution, warm, solution.recovered(), warm.recovered(),
        solution.error_estimate(), heat.evolve(1.0, steps=2), solution.at([[0.1, 0.2, 0.3]]),
        il.cutfem.natural_modes(elastic, 2), il.cutfem.natural_modes(elastic, 1)[0],
        bent.assembly.space, elastic.domain.cut, elastic.domain.cut.grid,
        elastic.domain.cut.volume(2), elastic.domain.cut.surface(2),
        il.cutfem.Solver(bent.system.K, method="superlu"),
    ]  # fmt: skip


def things(sense):
    """Objects of public classes, of which the methods are called."""
    mesh, wall, lattice, ball = (sense[name] for name in ("mesh", "wall", "lattice", "f"))
    strut = il.tiles.Polyline([(0, 0.5, 0.5), (1, 0.5, 0.5)], radius=0.1)
    search = il.offsets.ClosestPointSearch(lattice)
    tile, stack = il.tiles.get("gyroid"), mesh.slices(thickness=0.3)
    own = [
        sense["spline"], sense["through"], il.macroshape.torus().with_extra(d=0.1), tile,
        tile.field, il.Tile(lambda u: np.cos(2 * np.pi * u).sum(axis=1)), lattice, wall,
        lattice.offset(0.1, space="parametric"), ball, il.sdf.parse("box gyroid shell 0.6"),
        il.fields.from_callable(ball, bounds=BALL), il.tiles.mix("gyroid", "diamond", seed=1),
        il.tiles.SkeletonField([strut]), il.tiles.sigmoid(0, [0.5], 0.2), mesh, stack, stack[2],
        il.tiles.Arc((0.3, 0.5, 0.5), (0.2, 0, 0), (0, 0.2, 0)), il.sdf.MeshDistance(mesh),
        il.sdf.Command.read("sphere dilate t"), il.sdf.plan(ball, 0.5), search,
        search.query([[0.2, 0.3, 0.4]]), sense["through"].locate([[0.2, 0.3, 0.4]]),
    ]  # fmt: skip
    labels = np.arange(8).reshape(2, 2, 2) % 2
    own += [il.homogenize.voxels(labels), il.homogenize.conductive_voxels(labels)]
    k = il.cost.kagome(2).refined()
    straight = il.cost.BernsteinSimplex.straight(np.vstack([np.zeros(3), np.eye(3)]), 2)
    own += [k, k.beams(0.01), il.cost.Blocks(3), straight]
    return own + solids()


def methods(thing):
    """Its public methods, by name."""
    names = [n for n in dir(type(thing)) if not n.startswith("_") or n == "__call__"]
    kinds = {n: inspect.getattr_static(type(thing), n) for n in names}
    found = {n: getattr(thing, n) for n, k in kinds.items() if is_method(k)}
    return {n: f for n, f in found.items() if n not in SLOW}


def is_method(kind):
    return inspect.isfunction(kind) or isinstance(kind, (classmethod, staticmethod))


def targets():
    found = {}
    for room in ("", *ROOMS):
        module = importlib.import_module(f"ilattice.{room}".rstrip("."))
        for name in getattr(module, "__all__", ()):
            thing = getattr(module, name)
            if callable(thing) and name not in SKIPPED and not is_error(thing):
                found[f"{room}.{name}"] = thing
    return found


def is_error(thing):
    return isinstance(thing, type) and issubclass(thing, (Exception, Warning, Enum))


TARGETS = targets()


def arguments(thing, sense, rng):
    """A call with one or all arguments odd."""
    try:
        parameters = list(inspect.signature(thing).parameters.values())
    except (TypeError, ValueError):
        parameters = []
    all_odd = rng.random() < 0.2
    wanted = [p for p in parameters if p.kind not in (p.VAR_KEYWORD, p.VAR_POSITIONAL)]
    chosen = rng.choice(wanted).name if wanted else ""
    positional, named = [], {}
    for p in parameters:
        odd = all_odd or p.name == chosen
        if not odd and p.name not in sense and p.default is not p.empty:
            continue
        value = rng.choice(ODD) if odd else sense.get(p.name, rng.choice(ODD))
        if p.kind is p.VAR_POSITIONAL:
            positional += [rng.choice(ODD) for _ in range(rng.randrange(3))]
        elif p.kind is p.POSITIONAL_ONLY:
            positional.append(value)
        elif p.kind is not p.VAR_KEYWORD:
            named[p.name] = value
    return positional, named


class Calls(event.Listener):
    """Counts calls of functions in a block, but for those of the compiler."""

    def __enter__(self):
        self.count = self.depth = 0
        event.register("numba:compile", self)
        sys.setprofile(self.note)
        return self

    def __exit__(self, *_):
        sys.setprofile(None)
        event.unregister("numba:compile", self)

    def note(self, _frame, what, _arg):
        self.count += what in ("call", "c_call")

    def on_start(self, _):
        self.depth += 1
        sys.setprofile(None)

    def on_end(self, _):
        self.depth -= 1
        if not self.depth:
            sys.setprofile(self.note)


def call(thing, positional, named):
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        try:
            thing(*positional, **named)
        except IlatticeError as e:
            return str(e)
    return ""


@pytest.fixture(scope="module")
def sense():
    return good()


@pytest.fixture(scope="module")
def senses(sense):
    return {name: sense | mine for name, mine in own(sense).items()}


@pytest.mark.parametrize("room", ["", *ROOMS])
def test_public_callables_refuse_what_makes_no_sense(room, sense, senses, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    rng = random.Random(f"odd {room}")
    wrong = []
    for name, thing in TARGETS.items():
        if name.split(".")[0] != room:
            continue
        for _ in range(ROUNDS):
            positional, named = arguments(thing, senses.get(name, sense), rng)
            told = f"{name}(*{positional!r:.200}, **{named!r:.300})"
            tracemalloc.start()
            try:
                with Calls() as calls:
                    message = call(thing, positional, named)
                if "\n" in message or len(message) > 1100:
                    wrong.append(f"{told}: {message.count(chr(10))} breaks, {len(message)} letters")
            except Exception as e:  # every other error is one to mend
                wrong.append(f"{told}: {type(e).__name__}: {e!s:.200}")
            peak = tracemalloc.get_traced_memory()[1]
            tracemalloc.stop()
            if peak > MAX_MEMORY:
                wrong.append(f"{told}: {peak / 1e6:.0f} MB")
            if calls.count > MAX_CALLS:
                wrong.append(f"{told}: {calls.count} calls")
    assert not wrong, "\n" + "\n".join(wrong)


@pytest.mark.filterwarnings("ignore::ilattice.errors.PrecisionWarning")
def test_methods_refuse_what_makes_no_sense(sense, tmp_path, monkeypatch):
    """Arguments one at a time; the others make sense."""
    monkeypatch.chdir(tmp_path)
    rng, wrong = random.Random("methods"), []
    for thing in things(sense):
        mine = sense | usual(thing)
        for name, method in methods(thing).items():
            known = inspect.signature(method).parameters.values()
            for chosen in (p for p in known if p.kind in (p.POSITIONAL_OR_KEYWORD, p.KEYWORD_ONLY)):
                for odd in rng.sample(ODD, min(ROUNDS, len(ODD))):
                    needed = {p.name: mine.get(p.name) for p in known if p.default is p.empty}
                    needed.pop("options", None)
                    told = f"{type(thing).__name__}.{name}({chosen.name}={odd!r:.60})"
                    wrong += outcome(told, method, {**needed, chosen.name: odd})
    assert not wrong, "\n" + "\n".join(wrong)


def usual(thing):
    """Arguments of methods that make sense."""
    kind = type(thing).__name__
    ending = {"SliceStack": "svg", "SplineMap": "xml", "HeatHistory": "pvd", "Modes": "pvd"}
    return {
        "path": f"a.{ending.get(kind, 'stl' if kind in ('SurfaceMesh', 'Wall') else 'vtu')}",
        "p": [[0.2, 0.3, 0.4]], "lo": [[0.1] * 3], "hi": [[0.2] * 3], "on": "surface", "cells": [0],
        "axes": [[0.1, 0.5]] * 3, "value": 0.0, "tol": 0.2, "level": 0.1, "stiffness": 1.0, "q": 2,
        "transfer": 1.0, "around": 0.0, "duration": 1.0, "steps": 1, "knots": [0.3], "status": 0,
        "values": {"t": "1"}, "closed": (False,) * 3, "domain": [[0.0] * 3, [1.0] * 3], "limit": 1,
        "name": "u=0", "elements": [0], "at": [0], "order": [0, 1, 2], "f": sense_of_f,
    }  # fmt: skip


def sense_of_f(u):
    return (np.asarray(u) ** 2).sum(axis=1) - 0.6


def outcome(told, method, named):
    """What is wrong with a call, in a list of lines."""
    tracemalloc.start()
    try:
        with Calls() as calls:
            call(method, [], named)
    except Exception as e:  # every other error is one to mend
        return [f"{told}: {type(e).__name__}: {e!s:.200}"]
    finally:
        peak = tracemalloc.get_traced_memory()[1]
        tracemalloc.stop()
    many, much = calls.count > MAX_CALLS, peak > MAX_MEMORY
    return [f"{told}: {calls.count} calls"] * many + [f"{told}: {peak / 1e6:.0f} MB"] * much


CORNERS = [[0, 0, 0], [1, 0, 0], [1, 1, 0.0]]
TRIANGLE = {"path": "s.vtu", "points": CORNERS, "cells": [[0, 1, 2]], "cell_type": 5}


@pytest.mark.parametrize("name", ["cell_type", "compress", "point_data", "cell_data", "field_data"])
def test_vtk_is_asked_for_nothing_odd(name, tmp_path, monkeypatch):
    """It ended the process for a kind of cells that is None."""
    monkeypatch.chdir(tmp_path)
    for odd in ODD:
        if odd is None and name.endswith("data"):
            continue
        empty = isinstance(odd, dict) and not odd and name.endswith("data")
        flag = name == "compress" and (odd is True or (isinstance(odd, int) and odd == 0))
        if empty or flag:
            il.io.write_vtu(**TRIANGLE | {name: odd})
            continue
        with pytest.raises(InputError):
            il.io.write_vtu(**TRIANGLE | {name: odd})
    il.io.write_vtu(**TRIANGLE | {"field_data": {"a": 1.0}, "point_data": {"b": [1, 2, 3]}})
    with pytest.raises(InputError, match="cells of cell_type 9 have 4 points, got 3"):
        il.io.write_vtu(**TRIANGLE | {"cell_type": 9})


def warm(cells=4):
    """The temperature of a heated ball."""
    return il.cutfem.Heat(sense_of_f, cells, domain=BALL).fix("surface", 0.0).source(1.0).solve()


LINE = il.BSpline([[0, 0, 1, 1]], CORNERS[:2], 1)
GRID = il.cutfem.Grid([np.linspace(0, 1, 4)] * 3)
ODD_CALLS = [
    lambda _: il.cost.kagome(2).beams(0.01).mesh(tol=1e-320),
    lambda _: il.io.write_vtu("s.vtu", CORNERS, [[1, 2], [3]], 5),
    lambda _: il.io.write_pvd("s.pvd", 3, [1.0]),
    lambda _: il.io.write_pvd("s.pvd", ["a.vtu"], 0.0),
    lambda _: il.io.write_stream("s.stl", 0.3),
    lambda _: il.io.write_stream("s.stl", [CORNERS, CORNERS]),
    lambda s: il.io.save_bezier_vtu(s["through"], "a" * 300 + ".vtu"),
    lambda s: il.io.save_bezier_vtu(s["through"], "a.vtu", compress=np.zeros(3)),
    lambda s: s["mesh"].save("a" * 300 + ".stl"),
    lambda _: il.sdf.run("sphere -s 0.5 -o a.ply --set t=0", progress="no"),
    lambda _: il.sdf.parse("sphere", strict="no"),
    lambda s: il.sdf.MeshDistance(s["mesh"], strict=None),
    lambda s: il.fields.from_callable(s["f"], bounds=[[1, 1, 1], [0, 0, 0]]),
    lambda _: il.BSpline([[0, 0, 1, 1]], [0.0, 1.0], True),
    lambda _: il.tiles.Arc((0.3, 0.5, 0.5), (0.2, 0, 0), (0, 0.2, 0), radius=NAN),
    lambda _: il.tiles.Polyline(CORNERS, radius=[0.1, -0.1, 0.1]),
    lambda _: il.tiles.Patch(CORNERS, radius="wide"),
    lambda _: il.tiles.Curve(LINE, radius=0.0),
    lambda _: il.tiles.Mixture((), None, None, 0.5, 0.1),
    lambda _: il.tiles.Mixture("gyroid", len, None, 0.5, 0.1),
    lambda s: s["through"].flipped(np.zeros(3)),
    lambda s: s["through"].flipped(np.float32(1)),
    lambda s: s["through"].jet([[0.2, 0.3, 0.4]], True),
    lambda s: s["through"].x([[0.2, 0.3, 0.4]], extrapolate=np.zeros(2)),
    lambda s: s["through"].permuted([None] * 3),
    lambda s: s["through"].volume(points=NAN),
    lambda s: s["through"].volume(points=2**70),
    lambda s: s["through"].inverse([[0.2, 0.3, 0.4]], tol=1e300),
    lambda s: s["spline"].breaks(7),
    lambda s: s["spline"].greville("x"),
    lambda s: s["spline"].derivative(None),
    lambda s: s["spline"].elevate(0, -1),
    lambda s: s["spline"].elevate(1j),
    lambda s: s["spline"].grid(3),
    lambda s: list(s["spline"].slabs([], 0)),
    lambda s: list(s["spline"].slabs([[0.5]] * 3, 0, thickness=0)),
    lambda s: s["f"].jet([[0.2, 0.3, 0.4]], np.zeros(2)),
    lambda _: il.tiles.get("gyroid").grid(3),
    lambda _: il.tiles.TrigField.parse(3),
    lambda s: s["lattice"].property_at([], [[0.2, 0.3, 0.4]]),
    lambda s: s["wall"].mesh(h=0.3, polish=np.zeros(2)),
    lambda s: s["wall"].relative_density(per_cell="x"),
    lambda s: s["wall"].thickness_error(3),
    lambda s: il.cutfem.Elasticity(s["wall"], 4).clamp(np.zeros(2)),
    lambda s: il.cutfem.Elasticity(s["wall"], 4).clamp("w=0", components=3),
    lambda s: il.cutfem.Elasticity(s["wall"], 4).clamp("w=0", method=[]),
    lambda s: il.cutfem.Elasticity(s["wall"], 4).clamp("w=0").solve(method=[]),
    lambda s: (
        il.cutfem.Elasticity(s["wall"], 4)
        .clamp("w=0")
        .load(body=(1, 0, 0))
        .solve(max_iterations=NAN)
    ),
    lambda _: il.cutfem.SplineSpace("grid", 1, [0], 0),
    lambda _: il.cutfem.SplineSpace(GRID, 1, "cells", 0),
    lambda _: il.cutfem.SplineSpace(GRID, 1, [0.5], 0),
    lambda _: il.cutfem.SplineSpace(GRID, 1, [1e300], 0),
    lambda _: il.cutfem.refinement_study(len, [2, 4, 8], {1: 2}),
    lambda _: il.cutfem.refinement_study(len, [2, 4, 8], {"a": len}),
    lambda s: s["lattice"].offset(relative_density=[[1, 2], [3]]),
    lambda s: s["lattice"].offset(0.1, least_wall=1e300),
    lambda s: s["lattice"].offset(0.1, least_gap=40.0),
    lambda s: il.Lattice("gyroid", through=s["through"]).offset(0.1, progress=3),
    lambda s: s["f"].bounding_box(None),
    lambda s: s["through"].fix_orientation(axis=7),
    lambda s: s["through"].permuted(np.array("a")),
    lambda s: s["mesh"].select([[1, 2], [3]]),
    lambda s: s["mesh"].slices(thickness=0.3)[1.5],
    lambda s: s["wall"].mesh(h=0.3, caps=np.zeros(2)),
    lambda s: s["lattice"].search.query("x"),
    lambda s: s["lattice"].search.query([[0.1] * 3], strides=0),
    lambda s: s["lattice"].search.candidates([[0.1] * 3], -1),
    lambda s: s["lattice"].search.to_tile(None),
    lambda s: s["lattice"].search.query([[0.1] * 3]).rows([0.5]),
    lambda s: s["lattice"].search.query([[0.1] * 3]).replaced([0], 3),
    lambda _: il.tiles.Arc((0.3, 0.5, 0.5), (0.2, 0, 0), (0, 0.2, 0)).at([NAN]),
    lambda _: il.tiles.SkeletonField([[(0, 0.5, 0.5), (1, 0.5, 0.5)]], 0.1).up_to(NAN, [[0.1] * 3]),
    lambda _: il.tiles.mix("gyroid", "iwp", seed=1).blended(-1, [[0] * 3, [1] * 3], (False,) * 3),
    lambda _: il.tiles.mix("gyroid", "iwp", seed=1).field(1, [[0] * 3, [1] * 3], "abc"),
    lambda _: il.tiles.get("gyroid").fit(tol=0.1, degree=[[1, 2], [3]]),
    lambda _: il.tiles.get("gyroid").fit(tol=0.1, periodic=np.zeros((3, 3))),
    lambda _: il.tiles.get("gyroid").fit(tol=1e-9, max_spans=NAN),
    lambda s: il.Tile(s["f"], name=3),
    lambda s: il.Tile(s["f"], symmetric="no"),
    lambda _: il.sdf.Command.read("sphere dilate t").files(3),
    lambda _: il.sdf.Command.read("sphere dilate t").solid({"t": 1}),
    lambda _: il.sdf.Command.read("sphere dilate t").check_used([1]),
    lambda _: GRID.cell_indices([-1]),
    lambda _: GRID.boxes(3),
    lambda _: GRID.home([0.5]),
    lambda s: il.cutfem.cut(s["wall"], 4).cells([0]),
    lambda _: (
        il.cutfem.Heat(sense_of_f, 4, domain=BALL).fix("surface", 0.0).evolve(1.0, steps=10**9)
    ),
    lambda _: (
        il.cutfem.Heat(sense_of_f, 4, domain=BALL)
        .fix("surface", 0.0)
        .evolve(1.0, steps=1, theta=[1] * 2)
    ),
    lambda _: il.cutfem.Heat(sense_of_f, 4, domain=BALL).flux(np.zeros(0), 1.0),
    lambda s: il.cutfem.Elasticity(s["wall"], 4).clamp("w=0").reactions(None),
    lambda _: warm().heat_flux_on([1]),
    lambda _: warm().problem.inflow(warm(5)),
    lambda _: warm().save("a.vtu", h=1e-12),
    lambda _: warm().save("a.vtu", h=1e-320),
    lambda _: warm().problem.evolve(1.0, steps=1).save(3),
    lambda _: warm().problem.evolve(1.0, steps=1)[0.5],
]


@pytest.mark.filterwarnings("ignore::ilattice.errors.PrecisionWarning")
@pytest.mark.parametrize("number", range(len(ODD_CALLS)))
def test_odd_arguments_that_used_to_pass_or_to_end_in_foreign_errors(
    number, sense, tmp_path, monkeypatch
):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(IlatticeError):
        ODD_CALLS[number](sense)


def test_points_that_are_infinitely_far_are_outside(sense):
    found = sense["through"].locate([[1e300, -1e300, 1e300], [0.2, 0.3, 0.4], [-1e200, 0, 0]])
    assert np.isnan(found.u[[0, 2]]).all()
    np.testing.assert_allclose(found.u[1], [0.2, 0.3, 0.4])
