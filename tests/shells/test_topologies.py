"""Classes of boundaries: counts of the paper, and what the table says against the enumeration."""

import itertools

import numpy as np
import pytest

import ilattice as il
from ilattice.errors import InputError
from ilattice.shells import topologies as rooms

#: Nodes, loops and size of the stabilizer, of c1 to c20, as published counts demand.
ROWS = [
    (12, (12,), 12), (12, (12,), 4), (12, (3, 9), 2), (12, (6, 6), 8), (12, (3, 3, 6), 12),
    (12, (3, 3, 6), 4), (12, (3, 3, 3, 3), 24), (9, (9,), 2), (9, (3, 6), 6), (9, (3, 6), 2),
    (9, (3, 3, 3), 6), (8, (8,), 2), (8, (8,), 8), (8, (3, 5), 2), (8, (4, 4), 8), (7, (7,), 2),
    (7, (3, 4), 2), (6, (6,), 4), (6, (6,), 12), (6, (3, 3), 12),
]  # fmt: skip


def determinant(g):
    sign = np.linalg.det(np.eye(3)[list(g[0])])
    return round(float(sign)) * (-1) ** sum(g[1])


def test_patterns_of_faces_are_the_eight_plane_matchings():
    for face in range(6):
        edges = {e for p in rooms.patterns(face) for s in rooms.segments(face, p) for e in s.edges}
        assert len(edges) == 4
        every = {
            tuple(sorted(s.edges for s in rooms.segments(face, p))) for p in rooms.patterns(face)
        }
        pairs = [tuple(sorted(p)) for p in itertools.combinations(sorted(edges), 2)]
        crossing = {(p, q) for p in pairs for q in pairs if p < q and not set(p) & set(q)}
        assert len(crossing) == 3  # one of which crosses: two segments between opposite edges
        assert len(every) == 8
        assert {e for e in every if len(e) == 1} == {(p,) for p in pairs}
        assert sum(len(e) == 2 for e in every) == 2
        straight = [s.edges for p in ("|x", "|y", "|z") if p in rooms.patterns(face)
                    for s in rooms.segments(face, p)]  # fmt: skip
        assert tuple(sorted(straight)) not in every


def test_there_are_256_closed_ones_in_20_classes_and_three_repeat():
    closed = rooms.closed_patterns()
    assert len(closed) == len(set(closed)) == 256
    classes = il.shells.enumerate()
    assert [t.name for t in classes] == [f"c{k}" for k in range(1, 21)]
    assert sum(48 // len(t.symmetries) for t in classes) == 256
    assert [t.paper for t in classes if t.is_translational] != []
    repeats = [p for p in closed if p[::2] == p[1::2]]
    found = {min(rooms.images(rooms._segments_of(p))) for p in repeats}
    assert found == {min(rooms.images(il.shells.topology(f"topo_{k}").segments)) for k in (1, 3, 6)}


def test_without_reflections_there_are_23():
    keys = {rooms._key(rooms._segments_of(p)): p for p in rooms.closed_patterns()}
    turns = [g for g in rooms._group() if determinant(g) == 1]
    assert len(turns) == 24
    count = 0
    while keys:
        count += 1
        parts = rooms._segments_of(next(iter(keys.values())))
        for g in turns:
            keys.pop(rooms._key(rooms._moved(parts, g)), None)
    assert count == 23


def test_the_table_lists_these_classes():
    found = {t.name: t for t in il.shells.enumerate()}
    assert len(rooms.table()) == 20
    for row, (nodes, loops, stabilizer) in zip(rooms.table(), ROWS, strict=True):
        assert len(row.nodes) == nodes
        assert tuple(len(loop) for loop in row.loops) == loops
        assert len(row.symmetries) == stabilizer
        assert min(rooms.images(row.segments)) == min(rooms.images(found[row.name].segments))


def test_colours_change_at_nodes_only_and_segments_part_them():
    for t in rooms.table():
        for number in range(12):
            axis, ends = rooms.edge_place(number)
            at = [ends.get(a, slice(None)) for a in range(3)]
            low, high = t.colours[tuple(at)]
            assert (low != high) == (number in t.nodes)
        for s in t.segments:
            axis, side = divmod(s.face, 2)
            face = np.take(t.colours, side, axis)
            inside = {face[c] for c in s.corners}
            assert len(inside) == 1  # on one side there is one colour


def test_orbits_are_those_of_permuted_axes():
    assert [len(o) for o in il.shells.topology("topo_1").orbits] == [3, 3, 6]
    assert [len(o) for o in il.shells.topology("topo_19").orbits] == [6]
    assert [len(o) for o in il.shells.topology("topo_18").orbits] == [3, 3]
    for t in rooms.table():
        assert sorted(i for o in t.orbits for i in o) == list(range(len(t.nodes)))


@pytest.mark.parametrize("bad", ["topo_21", "topo_19_rrx", "topo_19_rr", "", "c0", 3, None, ["c1"]])
def test_names_that_are_none(bad):
    with pytest.raises(InputError, match="topolog"):
        il.shells.topology(bad)


def test_near_names_are_told():
    with pytest.raises(InputError, match="topo_18"):
        il.shells.topology("topo_118")
    assert il.shells.topology(" TOPO_19_rtr ").name == "c19"
    assert il.shells.topology("c19").paper == "topo_19"
