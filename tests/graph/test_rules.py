"""Rules of nodes, files, and evaluation: what is refused, and what is computed once."""

import json
import pickle
from contextlib import suppress

import numpy as np
import pytest
from graphs import HEXAGON, every_type, loop, schwarz_p, strut

import ilattice as il
from ilattice.errors import GeometryError, GraphError, IlatticeError
from ilattice.graph.solids import TYPES

g = il.graph


@pytest.fixture(scope="module")
def all_types():
    return every_type()


def test_files_give_equal_graphs(all_types, tmp_path):
    assert len({n.word for n in all_types.nodes}) == len(TYPES) == 14
    volumes = [None, g.cuboid(), g.cuboid((0.5, 0.25, 0.5)), g.prism(), g.tetrahedron(192)]
    volumes.append(g.halfspaces([[-1, 0, 0], [0, -1, 0], [0, 0, -1], [1, 2, 1]], [0, 0, 0, 0.7]))
    rng = np.random.default_rng(3)
    for _ in range(20):
        sides = rng.normal(size=(6, 3)) * rng.uniform(0.1, 10.0, (6, 1))
        rows = np.concatenate([sides, np.eye(3), -np.eye(3)])
        reach = 0.5 * sides.sum(axis=1) + 0.2 * np.linalg.norm(sides, axis=1)
        volumes.append(g.halfspaces(rows, [*reach, 0.7, 0.7, 0.7, 0.0, 0.0, 0.0]))
    for within in volumes:
        graph = g.Graph(g.object(strut((0, 0, 0), (0.1, 0.1, 0.1))), within)
        assert g.parse(json.dumps(graph.as_dict())).digest == graph.digest
    all_types.save(tmp_path / "all.json")
    again = g.load(tmp_path / "all.json")
    assert again.digest == all_types.digest
    assert again.as_dict() == all_types.as_dict()
    assert dict(again.about) == {"source": "tests"}
    assert pickle.loads(pickle.dumps(again)).digest == all_types.digest


def test_digests_tell_content_apart():
    same = [strut().digest, strut().digest]
    other = [strut(thickness=0.11).digest, strut(b=(0.5, 0.5, 0.4)).digest]
    other += [strut().mirrored("x").digest, g.group([strut()]).digest]
    assert same[0] == same[1]
    assert len({same[0], *other}) == 5


def test_a_second_evaluation_computes_nothing():
    g.forget()
    graph, count = schwarz_p(), g.computed()
    graph.tile(), graph.voxels(8)
    first = g.computed() - count
    assert first >= 5
    again = g.parse(json.dumps(schwarz_p().as_dict()))
    again.tile(), again.voxels(8), again.body
    assert g.computed() - count == first
    again.solid()
    assert g.computed() - count == first + 1


RULES = [
    (lambda: g.vertex((0, 0, 1.5)), "vertex", "unit cube"),
    (lambda: g.vertex((0, 0, np.nan)), "vertex", "finite"),
    (lambda: g.chain([g.vertex((0, 0, 0))]), "chain", "2 or more"),
    (
        lambda: g.EdgeChain([g.vertex((0, 0, 0)), g.vertex((1, 0, 0))], (0, 1, 0, 1)),
        "chain",
        "once",
    ),
    (lambda: g.line([strut().chains[0], strut().chains[0]]), "line", "branch-free"),
    (lambda: strut(thickness=-1.0), "line", "above zero"),
    (lambda: strut(thickness=[(0.5, 0.1), (0.2, 0.1)]), "line", "increase"),
    (lambda: g.surface(strut().chains), "surface", "closed loop"),
    (lambda: g.surface(loop(HEXAGON), alpha=0.1, kind="mixed"), "surface", "alpha must be 0"),
    (lambda: g.surface(loop(HEXAGON), kind="nice"), "surface", "kind must be"),
    (lambda: g.dual(g.surface(loop(HEXAGON))), "dual", "conjugate"),
    (lambda: g.dual(strut()), "dual", "must be a surface"),
    (lambda: strut().mirrored((0, 0, 0)), "mirror", "not zero"),
    (lambda: strut().mirrored("w"), "mirror", "direction"),
    (lambda: strut().moved(scale=0.0), "transform", "scale"),
    (lambda: g.group([]), "group", "one or more"),
    (lambda: g.group([g.object(strut())]), "group", "Object"),
    (lambda: g.object(g.object(strut())), "object", "skeleton"),
    (lambda: g.union(g.object(strut())), "boolean", "2 or more"),
    (
        lambda: g.union(g.object(strut()), g.object(strut(), resolution=50)),
        "boolean",
        "same grid resolution, got 50, 100",
    ),
    (lambda: g.voxel(g.object(strut()), poisson=0.5), "voxel", "below 0.5"),
    (lambda: g.Graph(strut()), "line", "roots"),
    (
        lambda: g.Graph([g.voxel(g.object(strut())), g.voxel(g.object(strut()))]),
        "voxel 'vox2'",
        "at most one voxel node",
    ),
    (lambda: g.Graph([g.object(strut()), g.object(strut())]), "object 'obj2'", "one solid"),
    (
        lambda: g.Graph(g.object(g.surface(loop(HEXAGON), kind="conjugate"))),
        "surface 's1'",
        "bounding volume",
    ),
]


@pytest.mark.parametrize(("make", "node", "rule"), RULES)
def test_errors_name_node_and_rule(make, node, rule):
    with pytest.raises(GraphError, match=rule) as e:
        make()
    assert e.value.node == node
    assert rule in e.value.rule
    copy = pickle.loads(pickle.dumps(e.value))
    assert (copy.node, copy.rule, str(copy)) == (node, e.value.rule, str(e.value))


@pytest.mark.parametrize(
    ("points", "rule"),
    [
        ([(0.5, 0.1, 0.25), *HEXAGON[1:]], "vertex 0 at .* lies on 1"),
        ([*HEXAGON[:2], (0.25, 0.4, 0.1), *HEXAGON[3:]], "vertex 2 at .* lies on 0"),
        ([*HEXAGON[:1], (0.5, 0.5, 0), *HEXAGON[2:]], "vertex 1 at .* lies on 3"),
        ([(0.5, 0, 0.25), (0.5, 0.5, 0.25), (0, 0.5, 0.25), (0, 0, 0.25)], "normals"),
        ([*HEXAGON[:4], (0.75, 0.25, 0.5)], "must lie in the bounding volume"),
        ([*HEXAGON[::2]], "faces must be 4|leave a vertex"),
    ],
)
def test_conjugate_loops_must_follow_edges(points, rule):
    surface = g.surface(loop(points), kind="conjugate")
    with pytest.raises(GraphError, match=rule) as e:
        g.Graph(g.object(surface), within=g.cuboid())
    assert e.value.node == "surface 's1'"


def test_mixed_surfaces_slide_on_one_face():
    v = [g.vertex(p) for p in ((0, 0, 0.2), (0.5, 0, 0.2), (0.5, 0.5, 0.3), (0, 0.5, 0.3))]
    straight = g.chain(v[:2])
    for way, rule in (
        ([straight, g.chain([v[1], v[2]], smooth=True), g.chain([v[2], v[3], v[0]])], None),
        ([straight, g.chain([v[1], v[2], v[3], v[0]])], "needs a smooth chain"),
        ([g.chain([*v[:3]], smooth=True), g.chain([v[2], v[3], v[0]], smooth=True)], "conjugate"),
    ):
        surface = g.surface(way, kind="mixed", edges=4)
        if rule is None:
            patch = g.Graph(g.object(surface), within=g.cuboid()).patches()[0]
            side = patch.vertices[patch.disc.side_rows[1]]
            assert np.abs(side[:, 0] - 0.5).max() < 1e-12
            assert np.ptp(side[:, 2]) > 0.05
        else:
            with pytest.raises(GraphError, match=rule):
                g.Graph(g.object(surface), within=g.cuboid())


def broken(**changes):
    data = schwarz_p().as_dict()
    return data | changes


def renamed(index, **changes):
    data = schwarz_p().as_dict()
    data["nodes"][index] |= changes
    return data


FILES = [
    ([], "graph", "object"),
    (broken(version=2), "graph", "version must be 1"),
    (broken(schema="x"), "graph", "schema"),
    (broken(more=1), "graph", "'more' is unknown"),
    (broken(roots=["obj9"]), "graph", "roots"),
    (broken(roots=["mirror3"]), "object 'obj1'", "lead to a root"),
    (broken(nodes=[]), "graph", "list"),
    (broken(within={"kind": "ball"}), "graph", "within"),
    (broken(within={"kind": "prism", "size": 1}), "graph", "nothing else"),
    (renamed(0, type="knot"), "node 'v1'", "type must be one of"),
    (renamed(0, id=7), "node 0", "id must be a text"),
    (renamed(1, id="v1"), "node 'v1'", "once"),
    (renamed(0, colour="red"), "vertex 'v1'", "'colour' is no property"),
    (renamed(0, position=[0, 0]), "vertex 'v1'", "unit cube"),
    (renamed(0, inputs=["e1"]), "vertex 'v1'", "cycles"),
    (renamed(8, inputs=["obj1"]), "mirror 'mirror1'", "cycles"),
    (renamed(8, inputs=["nobody"]), "mirror 'mirror1'", "there is no 'nobody'"),
    (renamed(8, inputs=["s1", "s1"]), "mirror 'mirror1'", "inputs must be 1, got 2"),
    (renamed(7, edges=1e9), "surface 's1'", "edges"),
    (renamed(6, order=[0, 1, 2]), "chain 'e1'", "order must visit"),
]


@pytest.mark.parametrize(("data", "node", "rule"), FILES)
def test_files_are_read_strictly(data, node, rule):
    with pytest.raises(GraphError, match=rule) as e:
        g.parse(json.dumps(data))
    assert e.value.node.startswith(node)


def test_texts_that_are_no_graphs(tmp_path):
    deep = "[" * 100_000
    nan = json.dumps(schwarz_p().as_dict()).replace("0.25", "NaN", 1)
    twice = '{"schema": 1, "schema": 2}'
    for text in ("", "{", deep, nan, twice, "null", '"x"', "1" * 10_000):
        with pytest.raises(GraphError):
            g.parse(text)
    (tmp_path / "b.json").write_bytes(b"\xff\x00{}")
    with pytest.raises(GraphError, match="UTF-8"):
        g.load(tmp_path / "b.json")
    with pytest.raises(IlatticeError, match="cannot be read"):
        g.load(tmp_path / "none.json")


def test_long_graphs_are_refused_or_read():
    data = g.Graph(g.object(strut())).as_dict()
    for i in range(3000):  # no recursion
        row = {"id": f"m{i}", "type": "mirror", "inputs": ["l1" if i == 0 else f"m{i - 1}"]}
        data["nodes"].append(row | {"direction": "x", "copy": False})
    data["nodes"][3], last = data["nodes"][-1], data["nodes"][3]
    data["nodes"][-1] = last
    next(n for n in data["nodes"] if n["id"] == "obj1")["inputs"] = ["m2999"]
    graph = g.parse(json.dumps(data))
    assert g.parse(json.dumps(graph.as_dict())).digest == graph.digest
    assert np.allclose(graph.shape.struts[0, :, :3], strut().chains[0].points)
    for row in data["nodes"]:
        if row["type"] == "mirror":
            row["copy"] = True
    with pytest.raises(GraphError, match="at most 1000000 pieces"):
        _ = g.parse(json.dumps(data)).body
    data["nodes"] += [
        {"id": f"x{i}", "type": "vertex", "position": [0, 0, 0]} for i in range(10**5)
    ]
    with pytest.raises(GraphError, match="at most 20000 nodes"):
        g.parse(json.dumps(data))


def mutated(text, rng):
    """A text with random bytes, words or parts of it changed."""
    words = ["null", "true", "-1", "1e999", "NaN", "{}", "[]", '"x"', "0.5", "[0,0,0]", '"v1"', ""]
    data = json.loads(text)
    kind = rng.integers(4)
    if kind == 0:
        i = int(rng.integers(len(text)))
        return text[:i] + chr(int(rng.integers(32, 127))) + text[i + int(rng.integers(3)) :]
    if kind == 1:
        i, j = sorted(rng.integers(len(text), size=2))
        return text[:i] + text[j:]
    row = data["nodes"][int(rng.integers(len(data["nodes"])))]
    key = list(row)[int(rng.integers(len(row)))]
    if kind == 2:
        del row[key]
    else:
        row[key] = "@"
    return json.dumps(data).replace('"@"', words[int(rng.integers(len(words)))])


def fuzz(texts, count, seed):
    """How many of mutated texts are graphs; all others are refused by a `GraphError`."""
    rng = np.random.default_rng(seed)
    good = 0
    for _ in range(count):
        text = mutated(texts[int(rng.integers(len(texts)))], rng)
        with suppress(GraphError):
            good += g.parse(text).count > 0
    return good


def test_mutated_files_end_in_graph_errors(all_types):
    texts = [json.dumps(graph.as_dict()) for graph in (all_types, schwarz_p())]
    assert 0 < fuzz(texts, 400, 1) < 200


def test_parts_over_many_cells_are_refused():
    for scale in (100.0, 1000.0):
        graph = g.Graph(g.object(strut().moved(scale=scale)))
        with pytest.raises(GraphError, match="at most 8 cells") as e:
            _ = graph.body
        assert e.value.node == "object 'obj1'"


def test_failures_name_the_node():
    graph = g.Graph(g.object(strut(thickness=3.0)))
    with pytest.raises(GraphError, match="fills the cell") as e:
        graph.tile()
    assert e.value.node == "object 'obj1'"
    assert isinstance(e.value.__cause__, GeometryError)


@pytest.mark.parametrize("odd", [None, "no", -0.5, [1, 2], np.array([1, 2])])
def test_odd_arguments_end_in_errors_that_name_them(odd):
    graph = g.Graph(g.object(strut()))
    calls = {
        "closed": lambda: g.chain([g.vertex((0, 0, 0)), g.vertex((1, 0, 0))], closed=odd),
        "names": lambda: g.Graph(graph.roots, names=odd),
        "completed": lambda: strut().completed(odd),
        "library": lambda: g.library[odd],
        "method": lambda: graph.homogenize(4, method=odd),
        "graphs": lambda: g.contact_sheet(odd),
        "columns": lambda: g.contact_sheet([graph], columns=odd),
        "thickness": lambda: g.explore("truss", 1, thickness=[0.1, odd]),
    }
    for name, call in calls.items():
        with pytest.raises(IlatticeError, match=name):
            call()
