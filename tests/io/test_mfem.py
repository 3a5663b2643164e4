import itertools
import re
import tracemalloc
from pathlib import Path

import numpy as np
import pytest

from ilattice import macroshape
from ilattice.errors import FormatError
from ilattice.io import splines
from ilattice.macroshape import SplineMap

DATA = Path(__file__).parents[1] / "data" / "mfem"
#: Corners and faces of the cube as MFEM lists them.
CORNERS = [(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0), (0, 0, 1), (1, 0, 1), (1, 1, 1), (0, 1, 1)]
FACES = ["3210", "0154", "1265", "2376", "3047", "4567"]


def det(spline, count=9):
    lo, hi = spline.domain
    axes = [np.linspace(a, b, count) for a, b in zip(lo, hi, strict=True)]
    return np.linalg.det(spline.grid(axes, 1)[1])


def test_every_patch_of_every_file_is_right_handed():
    counts = {}
    for path in sorted(DATA.glob("*.mesh")):
        patches = splines.read_patches(path)
        counts[path.name] = len(patches)
        assert all(det(p.spline).min() > 0.3 for p in patches), path.name
    assert counts == {
        "beam-hex-nurbs.mesh": 2,
        "cube-nurbs-deformed.mesh": 1,
        "cube-nurbs.mesh": 1,
        "pipe-nurbs.mesh": 4,
        "two-cubes-nurbs.mesh": 2,
    }


def test_cube_is_the_unit_cube():
    shape = macroshape.load(DATA / "cube-nurbs.mesh")
    u = np.random.default_rng(0).uniform(0, 1, (20, 3))
    assert np.abs(shape.x(u) - u).max() < 1e-15


def test_deformed_cube_has_its_corners_and_edges_where_the_file_says():
    path = DATA / "cube-nurbs-deformed.mesh"
    rows = [
        [float(v) for v in line.split()]
        for line in path.read_text().split("Ordering: 1")[1].splitlines()
        if line.strip()
    ]
    c = macroshape.load(path).spline.c
    for corner, row in zip(CORNERS, rows, strict=False):
        assert c[tuple(5 * i for i in corner)].tolist() == row
    assert c[1:5, 0, 0].tolist() == rows[8:12]  # edge 0 of the file runs from vertex 0 to 1
    assert c[1:5, 5, 0][::-1].tolist() == rows[12:16]  # edge 1: from 2 to 3 by number
    assert len(rows) == 6**3
    assert sorted(map(tuple, rows)) == sorted(map(tuple, c.reshape(-1, 3)))


def test_beam():
    a, b = (p.spline for p in splines.read_patches(DATA / "beam-hex-nurbs.mesh"))
    u = np.random.default_rng(0).uniform(0, 1, (50, 3)) * [4, 1, 1]
    assert np.abs(a(u) - u).max() < 1e-14
    assert np.abs(b(u) - u - [4, 0, 0]).max() < 1e-14


def test_pipe_is_round_at_both_ends_and_its_patches_meet():
    patches = [p.spline for p in splines.read_patches(DATA / "pipe-nurbs.mesh")]
    u = np.random.default_rng(0).uniform(0, 1, (100, 3))
    for s in patches:
        u[:, 2] = 0
        x = s(u)
        assert np.abs(np.hypot(x[:, 0], x[:, 1]) - 2 - u[:, 0]).max() < 1e-13
        assert np.abs(x[:, 2]).max() == 0
        u[:, 2] = 2
        x = s(u)
        assert np.abs(np.hypot(x[:, 1], x[:, 2] - 20) - 2 - u[:, 0]).max() < 1e-13
        assert np.abs(x[:, 0] - 10).max() < 1e-13
    for a, b in zip(patches, patches[1:] + patches[:1], strict=True):
        assert np.array_equal(a.c[:, -1], b.c[:, 0])
        assert np.array_equal(a.weights[:, -1], b.weights[:, 0])


def test_patches_form_multiplies_homogeneous_points(tmp_path):
    text = (DATA / "two-cubes-nurbs.mesh").read_text()
    expected = splines.read_patches(DATA / "two-cubes-nurbs.mesh")[0].spline.c
    for name, row in (
        ("controlpoints_homogeneous", "2 2 0 2"),
        ("controlpoints_cartesian", "1 1 0 2"),
    ):
        changed = text.replace("controlpoints", name).replace("1 1 0 1", row)
        (tmp_path / "a.mesh").write_text(changed)
        spline = splines.read_patches(tmp_path / "a.mesh")[0].spline
        assert np.array_equal(spline.c, expected)
        assert spline.weights[1, 1, 0] == 2


# --- several patches with shared knot vectors, built by coordinates instead of indices ------------

SHARES = [np.array([0, 0.4, 1]), np.array([0, 0.1, 0.5, 1]), np.array([0, 0.2, 0.3, 0.9, 1])]
KNOTS = ["1 3 0 0 .3 1 1", "2 4 0 0 0 .2 1 1 1", "3 5 0 0 0 0 .4 1 1 1 1"]
ROTATIONS = [
    (p, f)
    for p in itertools.permutations(range(3))
    for f in itertools.product((0, 1), repeat=3)
    if np.linalg.det(np.eye(3)[list(p)]) * (-1) ** sum(f) > 0
]


def bent(x):
    x = np.asarray(x, dtype=float)
    return x + 0.05 * np.sin(x[..., [1, 2, 0]] * 1.7)


def weight(x):
    return 1 + 0.2 * np.sin(np.asarray(x, dtype=float) @ [1.0, 2.0, 3.0])


class Block:
    """2 x 2 x 2 cells with turned axes and shuffled vertices, and their control points."""

    def __init__(self, seed):
        rng = np.random.default_rng(seed)
        self.number = dict(
            zip(itertools.product(range(3), repeat=3), rng.permutation(27), strict=True)
        )
        self.place = {int(n): np.array(p) for p, n in self.number.items()}
        self.turns = [ROTATIONS[i] for i in rng.integers(0, 24, 8)]
        cells = list(itertools.product((0, 1), repeat=3))
        self.cells = [np.array(cells[i]) for i in rng.permutation(8)]
        self.elements = [
            [int(self.number[tuple(c + self.turned(t, q))]) for q in CORNERS]
            for c, t in zip(self.cells, self.turns, strict=True)
        ]
        edges = {
            (int(self.number[p]), int(self.number[tuple(np.add(p, step))]), a)
            for p in self.number
            for a, step in enumerate(np.eye(3, dtype=int))
            if p[a] < 2
        }
        self.edges = [sorted(edges)[i] for i in rng.permutation(len(edges))]
        self.points = self.control_points()

    @staticmethod
    def turned(turn, q):
        """Corner of the cell in the axes of space."""
        order, flips = turn
        out = [0, 0, 0]
        for i in range(3):
            out[order[i]] = 1 - q[i] if flips[i] else q[i]
        return np.array(out)

    def along(self, a, b):
        """Shares of the inner control points on the way from vertex a to its neighbour b."""
        step = self.place[b] - self.place[a]
        axis = int(np.flatnonzero(step)[0])
        share = SHARES[axis] if step[axis] > 0 else 1 - SHARES[axis][::-1]
        return [s * step for s in share[1:-1]]

    def control_points(self):
        """Places of all control points in the order of the file."""
        out = [self.place[v] for v in range(27)]
        for a, b, _ in self.edges:
            low, high = min(a, b), max(a, b)
            out += [self.place[low] + s for s in self.along(low, high)]
        seen = set()
        for element in self.elements:
            for face in FACES:
                q = [element[int(i)] for i in face]
                if frozenset(q) not in seen:
                    seen.add(frozenset(q))
                    for slow in self.along(q[0], q[3]):
                        out += [self.place[q[0]] + fast + slow for fast in self.along(q[0], q[1])]
        for e in self.elements:
            for w in self.along(e[0], e[4]):
                for v in self.along(e[0], e[3]):
                    out += [self.place[e[0]] + u + v + w for u in self.along(e[0], e[1])]
        return np.array(out, dtype=float)

    def text(self, ordering=1):
        points = bent(self.points)
        lines = ["MFEM NURBS mesh v1.0", "dimension", "3", "elements", "8"]
        lines += ["1 5 " + " ".join(map(str, e)) for e in self.elements]
        lines += ["boundary", "0", "edges", str(len(self.edges))]
        lines += [f"{axis} {a} {b}" for a, b, axis in self.edges]
        lines += ["vertices", "27", "knotvectors", "3", *KNOTS, "weights"]
        lines += [repr(float(w)) for w in weight(self.points)]
        lines += ["FiniteElementSpace", "FiniteElementCollection: NURBS", "VDim: 3"]
        lines += [f"Ordering: {ordering}"]
        numbers = points if ordering else points.T
        return "\n".join([*lines, *(repr(float(v)) for v in numbers.ravel())])


@pytest.mark.parametrize("seed", range(6))
def test_shared_control_points_of_turned_patches(tmp_path, seed):
    block = Block(seed)
    path = tmp_path / "a.mesh"
    path.write_text(block.text(ordering=seed % 2))
    patches = splines.read_patches(path)
    assert len(patches) == 8
    for patch, cell, turn in zip(patches, block.cells, block.turns, strict=True):
        order, flips = turn
        share = [1 - SHARES[a][::-1] if f else SHARES[a] for a, f in zip(order, flips, strict=True)]
        local = np.stack(np.meshgrid(*share, indexing="ij"), -1)
        x = np.empty_like(local)
        for i, (axis, f) in enumerate(zip(order, flips, strict=True)):
            x[..., axis] = cell[axis] + (1 - local[..., i] if f else local[..., i])
            knots = np.array(KNOTS[axis].split()[2:], dtype=float)
            assert np.allclose(patch.spline.t[i], 1 - knots[::-1] if f else knots, atol=1e-15)
        assert np.allclose(patch.spline.c, bent(x), atol=1e-14)
        assert np.allclose(patch.spline.weights, weight(x), atol=1e-14)
        assert det(patch.spline).min() > 0


def test_surfaces_with_shared_knot_vectors(tmp_path):
    vertices = [(0, 0), (2, 0), (4, 0), (0, 2), (2, 2), (4, 2)]
    edges = [(0, 0, 1), (1, 2, 1), (0, 3, 4), (1, 5, 4), (2, 0, 3), (2, 1, 4), (2, 2, 5)]
    points = list(vertices)
    for _, a, b in edges:
        points.append(tuple(np.add(vertices[a], vertices[b]) / 2))
    points += [(1, 1), (3, 1)]
    text = (
        "MFEM NURBS mesh v1.1\ndimension 2 elements 2 1 3 0 1 4 3 1 3 2 5 4 1 boundary 0 edges 7\n"
    )
    text += "\n".join(f"{k} {a} {b}" for k, a, b in edges)
    text += "\nvertices 6 knotvectors 3" + " 2 3 0 0 0 1 1 1" * 3
    text += "\nrefinements 1 1 spacing 1 0 2 1 1 5 0.5 unitweights FiniteElementSpace\n"
    text += "FiniteElementCollection: NURBS2 VDim: 2 Ordering: 1\n"
    text += "\n".join(f"{x} {y}" for x, y in points)
    (tmp_path / "a.mesh").write_text(text)
    a, b = (p.spline for p in splines.list_patches(tmp_path / "a.mesh"))
    u = np.random.default_rng(0).uniform(0, 1, (20, 2))
    assert np.abs(a(u) - 2 * u).max() < 1e-15
    assert np.abs(b(u) - np.stack([4 - 2 * u[:, 1], 2 * u[:, 0]], 1)).max() < 1e-15


# --- what is written ------------------------------------------------------------------------------


def test_the_written_topology_is_that_of_the_files_of_the_project(tmp_path):
    shape = macroshape.load(DATA / "cube-nurbs.mesh")
    splines.save(shape, tmp_path / "a.mesh")
    section = re.compile(r"edges\n12\n(.*?)\n\nvertices\n8\n", re.DOTALL)
    ours = section.search((tmp_path / "a.mesh").read_text())[1].split("\n")
    theirs = section.search((DATA / "cube-nurbs.mesh").read_text())[1].split("\n")
    assert {tuple(e.split()[:1] + sorted(e.split()[1:])) for e in ours} == {
        tuple(e.split()[:1] + sorted(e.split()[1:])) for e in theirs
    }
    text = (tmp_path / "a.mesh").read_text()
    assert "elements\n1\n1 5 0 1 2 3 4 5 6 7\n" in text
    assert "boundary\n6\n1 3 3 2 1 0\n2 3 0 1 5 4\n" in text


def test_names_are_kept_in_a_comment(tmp_path):
    shape = SplineMap(macroshape.load(DATA / "cube-nurbs.mesh").spline).with_extra(density=0.5)
    splines.save(shape, tmp_path / "a.mesh")
    assert macroshape.load(tmp_path / "a.mesh").names == ("density",)


# --- what is refused ------------------------------------------------------------------------------

CUBE = (DATA / "cube-nurbs.mesh").read_text()
TWO = (DATA / "two-cubes-nurbs.mesh").read_text()


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (CUBE.replace("mesh v1.0", "NC-patch mesh v1.0"), "line 1: found 'MFEM NURBS NC-patch"),
        (CUBE.replace("MFEM NURBS mesh v1.0", "MFEM mesh v1.0"), "line 1: found 'MFEM mesh v1.0'"),
        (CUBE[:500], "expected 24 coordinates, 3 of 8 control points"),
        (CUBE + "7", "expected the end of the file"),
        (CUBE.replace("elements\n1", "elements\n1000000000000"), "line 18: found 'boundary'"),
        (CUBE.replace("vertices\n8", "vertices\n1000000000000"), "more control points than"),
        (CUBE.replace("vertices\n8", "vertices\n7"), "vertex 7 is used, but there are only 7"),
        (CUBE.replace("1 5 0 1 2", "1 5 0 1 1"), "a vertex is repeated"),
        (CUBE.replace("1 5 0 1 2", "1 5 0 2 1"), "is not listed"),
        (CUBE.replace("0 3 2\n", "0 3 1\n"), "the edge from vertex 3 to 2 is not listed"),
        (
            CUBE.replace("0 3 2\n", "0 2 3\n").replace("\n1 2 0 0 1 1", "\n1 3 0 0 .1 1 1", 1),
            "line 45: patch",
        ),
        (CUBE.replace("0 3 2\n", "0 0 1\n"), "two edges join the vertices 0 and 1"),
        (CUBE.replace("0 3 2\n", "5 3 2\n"), "an edge has knot vector 5, there are only 3"),
        (CUBE.replace("0 3 2\n", "1 3 2\n"), "edges of direction 0 differ"),
        (CUBE.replace("1 2 0 0", "1 1000000000000 0 0", 1), "expected 1000000000002 knots"),
        (CUBE.replace("1 2 0 0", "1 1 0 0", 1), "line 47: found '1'; expected number of control"),
        (CUBE.replace("weights", "mesh_elements"), "section 'mesh_elements' is not supported"),
        (CUBE.replace("weights\n1", "weights\n0"), "weights must be positive"),
        (CUBE.replace("NURBS1", "NURBS2"), "found 'NURBS2'; expected NURBS of degree 1"),
        (CUBE.replace("NURBS1", "H1_3D_P1"), "found 'H1_3D_P1'"),
        (CUBE.replace("1 1 1\n0 1 1\n", "1 1 1\n0 1 x\n"), "found 'x'; expected coordinates"),
        (
            CUBE.replace("edges\n12", "edges\n0\nvertices\n8\n").replace("\n0 0 1\n0 3 2", "\n", 1),
            "expected 'patches'",
        ),
        (TWO.replace("controlpoints", "points"), "found 'points'; expected 'controlpoints'"),
        (TWO.replace("2 1 0 1", "2 1 0 0"), "weights must be positive"),
        (TWO.replace("2 1 0 1", "2 1 0"), "expected"),
        (TWO.replace("dimension\n3\n\nc", "dimension\n3000000\n\nc"), "control points x .. w"),
        (TWO + "\n# ilattice names: a, b", "2 names of extra coordinates; expected 0"),
    ],
)
def test_what_is_wrong_is_said(tmp_path, text, message):
    assert text not in (CUBE, TWO)
    path = tmp_path / "a.mesh"
    path.write_text(text)
    with pytest.raises(FormatError, match=re.escape(message)) as caught:
        splines.list_patches(path)
    assert "a.mesh, line " in str(caught.value)


def test_three_patches_cannot_share_a_face(tmp_path):
    element = "1 5 0 1 2 3 4 5 6 7"
    text = CUBE.replace("elements\n1", "elements\n3").replace(element, "\n".join([element] * 3))
    (tmp_path / "a.mesh").write_text(text)
    with pytest.raises(FormatError, match="more than two patches"):
        splines.list_patches(tmp_path / "a.mesh")


def test_patches_that_share_long_edges_take_no_memory(tmp_path):
    g, n = 15, 5000  # g^2 patches on 4 g edges of n control points each
    elements, edges = [], {(1, v, v + 4 * g) for v in range(4 * g)}
    for i, j in itertools.product(range(g), repeat=2):
        a, b, c, d = i, g + j, 2 * g + (i + j) % g, 3 * g + (i + 2 * j) % g
        elements.append([a, b, c, d, *(v + 4 * g for v in (a, b, c, d))])
        for p, q in ((a, b), (d, c), (a, d), (b, c)):
            edges |= {(0, p, q), (0, p + 4 * g, q + 4 * g)}
    text = f"MFEM NURBS mesh v1.0\ndimension 3 elements {g * g}\n"
    text += "\n".join("1 5 " + " ".join(map(str, e)) for e in elements)
    text += f"\nboundary 0 edges {len(edges)}\n"
    text += "\n".join(" ".join(map(str, e)) for e in sorted(edges))
    text += f"\nvertices {8 * g} knotvectors 2 1 2 0 0 1 1 1 {n} 0 "
    text += " ".join(map(str, range(n))) + f" {n - 1} weights " + "1 " * 1000
    (tmp_path / "a.mesh").write_text(text)
    tracemalloc.start()
    with pytest.raises(FormatError, match="more control points than the file has numbers"):
        splines.list_patches(tmp_path / "a.mesh")
    assert tracemalloc.get_traced_memory()[1] < 5e6
    tracemalloc.stop()


def test_curves_with_shared_knot_vectors_are_refused(tmp_path):
    text = "MFEM NURBS mesh v1.0\ndimension 1 elements 1 1 1 0 1 boundary 0 edges 1 0 0 1\n"
    text += "vertices 2 knotvectors 1 1 2 0 0 1 1 weights 1 1"
    (tmp_path / "a.mesh").write_text(text)
    with pytest.raises(FormatError, match="line 3: curves are read in the patches form only"):
        splines.list_patches(tmp_path / "a.mesh")
