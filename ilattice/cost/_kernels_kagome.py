"""Kagome structures by closed formulas: numbers of vertices and simplices without search or hash.

A vertex is (j, k): which of its d + 1 barycentric integers is the even one, and the halves k of
all of them (odd ones less one), which are a composition of l - 1. Its number is that of j times the
number of compositions, plus the rank of k among them.

Guarantees: any part of the structure is found from its compositions alone.
"""

from typing import Any

import numpy as np

from ilattice._kernels import inner, outer


@inner()
def rank3(n: int, a: int, b: int, c: int) -> int:
    """Rank of the composition (a, b, c, rest) of n, in lexicographic order."""
    m = n - a
    q = m - b
    first = ((n + 3) * (n + 2) * (n + 1) - (m + 3) * (m + 2) * (m + 1)) // 6
    return first + ((m + 2) * (m + 1) - (q + 2) * (q + 1)) // 2 + c


@inner()
def rank2(n: int, a: int, b: int) -> int:
    """Rank of the composition (a, b, rest) of n, in lexicographic order."""
    m = n - a
    return ((n + 2) * (n + 1) - (m + 2) * (m + 1)) // 2 + b


@inner()
def number3(n: int, count: int, trim: int, j: int, a: int, b: int, c: int) -> int:
    """Number of the vertex (j, k) in three dimensions; `trim` leaves out three per corner."""
    r = rank3(n, a, b, c)
    if trim == 0:
        return j * count + r
    before = 0  # corners of the simplex in the order of their ranks: 3, 2, 1, 0
    if j != 3 and r > 0:
        before += 1
    if j != 2 and r > n:
        before += 1
    if j != 1 and r > ((n + 2) * (n + 1) - 2) // 2:
        before += 1
    return j * (count - 3) + r - before


@outer()
def vertices3(n: Any, count: Any, trim: Any, out: Any) -> None:
    """Barycentric integers (V, 4) of all vertices, in their order."""
    for a in range(n + 1):
        for b in range(n + 1 - a):
            for c in range(n + 1 - a - b):
                d = n - a - b - c
                for j in range(4):
                    if trim and (
                        (a == n and j != 0) or (b == n and j != 1)
                        or (c == n and j != 2) or (d == n and j != 3)
                    ):  # fmt: skip
                        continue
                    i = number3(n, count, trim, j, a, b, c)
                    out[i, 0], out[i, 1] = 2 * a + 1, 2 * b + 1
                    out[i, 2], out[i, 3] = 2 * c + 1, 2 * d + 1
                    out[i, j] -= 1


@outer()
def simplices3(n: Any, count: Any, trim: Any, out: Any) -> None:
    """Vertices (m, 4) of all tetrahedra: upright ones, then turned ones."""
    row = 0
    for a in range(n + 1):
        for b in range(n + 1 - a):
            for c in range(n + 1 - a - b):
                if trim and (a == n or b == n or c == n or a + b + c == 0):
                    continue
                for j in range(4):
                    out[row, j] = number3(n, count, trim, j, a, b, c)
                row += 1
    for a in range(n):
        for b in range(n - a):
            for c in range(n - a - b):
                out[row, 0] = number3(n, count, trim, 0, a + 1, b, c)
                out[row, 1] = number3(n, count, trim, 1, a, b + 1, c)
                out[row, 2] = number3(n, count, trim, 2, a, b, c + 1)
                out[row, 3] = number3(n, count, trim, 3, a, b, c)
                row += 1


@outer()
def vertices2(n: Any, count: Any, out: Any) -> None:
    """Barycentric integers (V, 3) of all vertices in two dimensions."""
    for a in range(n + 1):
        for b in range(n + 1 - a):
            r = rank2(n, a, b)
            for j in range(3):
                i = j * count + r
                out[i, 0], out[i, 1], out[i, 2] = 2 * a + 1, 2 * b + 1, 2 * (n - a - b) + 1
                out[i, j] -= 1


@outer()
def simplices2(n: Any, count: Any, out: Any) -> None:
    """Vertices (m, 3) of all triangles: upright ones, then turned ones."""
    row = 0
    for a in range(n + 1):
        for b in range(n + 1 - a):
            for j in range(3):
                out[row, j] = j * count + rank2(n, a, b)
            row += 1
    for a in range(n):
        for b in range(n - a):
            out[row, 0] = rank2(n, a + 1, b)
            out[row, 1] = count + rank2(n, a, b + 1)
            out[row, 2] = 2 * count + rank2(n, a, b)
            row += 1


@outer()
def block3(n: Any, lo: Any, hi: Any, trim: Any, out: Any) -> int:
    """Simplices with compositions in a box: twice the centres' odd integers (m, 4), and the kind.

    `out` (m, 5) takes the odd integers c of each simplex and 1 for upright ones (vertices c - e_j),
    -1 for turned ones (vertices c + e_j); returns their number.
    """
    row = 0
    for a in range(lo[0], hi[0]):
        for b in range(lo[1], hi[1]):
            for c in range(lo[2], hi[2]):
                for kind in (1, -1):
                    d = n - (1 if kind < 0 else 0) - a - b - c
                    if d < 0:
                        continue
                    corner = a == n or b == n or c == n or d == n
                    if kind > 0 and trim and corner:
                        continue
                    out[row, 0], out[row, 1] = 2 * a + 1, 2 * b + 1
                    out[row, 2], out[row, 3] = 2 * c + 1, 2 * d + 1
                    out[row, 4] = kind
                    row += 1
    return row


#: Pairs of corners that are the edges of a triangle, and of a tetrahedron.
PAIRS2 = np.array([(0, 1), (0, 2), (1, 2)])
PAIRS3 = np.array([(0, 1), (0, 2), (0, 3), (1, 2), (1, 3), (2, 3)])
