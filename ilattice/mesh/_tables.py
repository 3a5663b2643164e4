"""The table of the 256 sign patterns of a grid cell, generated from one rule at import.

Corner ``4 dx + 2 dy + dz`` of a cell is bit ``1 << corner`` of its pattern, set when the corner is
inside. Edge ``4 a + 2 o + p`` runs along axis `a` at offsets `o`, `p` along the other two axes in
ascending order. Face ``2 a + s`` is normal to axis `a` at its lower (s = 0) or upper (s = 1) end.

The rule: the surface crosses a face in segments that *separate the inside corners*; segments that
meet at a crossed edge belong to the same patch. So what happens on a face depends on its four
signs alone, and two cells always agree about the face that they share.

A face that one patch crosses twice is called *double*. A pattern has at most one. Where a face is
double in both of its cells, the two patches would share two edges of the dual mesh, which is not
a manifold: there both cells separate the outside corners of that face instead (the *flipped*
pattern, rows 256 to 511), and each of the two patches falls into two.
"""

from functools import cache

import numpy as np

from ilattice._typing import AnyArray

PATCHES = 0  # column: number of patches
DOUBLE = 1  # column: the double face, or -1
LABEL = 2  # 12 columns: patch of each edge, or -1
ORDER = 14  # 12 columns: crossed edges, sorted by patch
START = 26  # 5 columns: where each patch starts in ORDER
#: Entries of a row of the table, and rows before those of flipped patterns.
WIDTH, FLIPPED = 31, 256


def _edge_between(a: int, b: int) -> int:
    """Edge that joins two neighbouring corners."""
    axis = {4: 0, 2: 1, 1: 2}[a ^ b]
    offset = [a >> 2 & 1, a >> 1 & 1, a & 1]
    o, p = (offset[d] for d in range(3) if d != axis)
    return 4 * axis + 2 * o + p


@cache
def _face_corners(face: int) -> list[int]:
    """Corners of a face, in cyclic order."""
    axis, side = divmod(face, 2)
    first, second = (4 >> d for d in range(3) if d != axis)
    base = (4 >> axis) * side
    return [base, base + first, base + first + second, base + second]


def _segments(code: int, face: int, flipped: bool) -> list[tuple[int, int]]:
    """Pairs of crossed edges that the surface joins on a face."""
    return _joined(face, tuple(bool(code >> c & 1) for c in _face_corners(face)), flipped)


@cache
def _joined(face: int, inside: tuple[bool, ...], flipped: bool) -> list[tuple[int, int]]:
    """The same by the signs of the face's corners: there are few of these."""
    corners = _face_corners(face)
    edges = [_edge_between(corners[i], corners[(i + 1) % 4]) for i in range(4)]
    crossed = [edges[i] for i in range(4) if inside[i] != inside[(i + 1) % 4]]
    if len(crossed) == 4:
        return [(edges[i - 1], edges[i]) for i in range(4) if inside[i] != flipped]
    return [(crossed[0], crossed[1])] if crossed else []


def _labels(code: int, flipped_face: int) -> list[int]:
    """Patch of each edge: patches are numbered by their lowest edge, -1 is not crossed."""
    group = list(range(12))
    crossed = set()
    for face in range(6):
        for a, b in _segments(code, face, face == flipped_face):
            crossed |= {a, b}
            low, high = sorted((group[a], group[b]))
            group = [low if g == high else g for g in group]
    names = sorted({group[e] for e in crossed})
    return [names.index(group[e]) if e in crossed else -1 for e in range(12)]


def _double_face(code: int, labels: list[int]) -> int:
    """Face that one patch crosses twice, or -1."""
    for face in range(6):
        segments = _segments(code, face, False)
        if len(segments) == 2 and labels[segments[0][0]] == labels[segments[1][0]]:
            return face
    return -1


def case_table() -> AnyArray:
    """Rows of the 256 patterns, then of the 256 flipped ones, shape (512, WIDTH), int8."""
    table = np.zeros((512, WIDTH), dtype=np.int8)
    for row in range(512):
        code = row % FLIPPED
        plain = _labels(code, -1)
        face = _double_face(code, plain)
        labels = plain if row < FLIPPED else _labels(code, face)
        order = sorted((e for e in range(12) if labels[e] >= 0), key=lambda e: labels[e])
        table[row, PATCHES] = max(labels) + 1
        table[row, DOUBLE] = face
        table[row, LABEL : LABEL + 12] = labels
        table[row, ORDER : ORDER + len(order)] = order
        sizes = [labels.count(p) for p in range(4)]
        table[row, START : START + 5] = np.concatenate(([0], np.cumsum(sizes)))
    table.flags.writeable = False
    return table


CASES = case_table()
