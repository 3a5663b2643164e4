"""Many cells at once: extraction of Bernstein tensors, signs of cells, rules in chunks.

Guarantees: one allocation of scratch per chunk; every row depends on its own cell only, so the
results have the same bits for any number of threads.
"""

from typing import Any

import numpy as np
from numba import njit, prange

from ilattice.cutfem._kernels_columns import (
    EXT,
    INTEGERS,
    LO,
    N_SURFACE,
    N_VOLUME,
    NUMBERS,
    TENSORS,
)
from ilattice.cutfem._kernels_faces import face_rule
from ilattice.cutfem._kernels_rules import cell_rule, cell_sign, solid

CHUNK = 32


@njit(cache=True, error_model="numpy", parallel=True)
def extract(
    c: Any,
    rows0: Any,
    rows1: Any,
    rows2: Any,
    first0: Any,
    first1: Any,
    first2: Any,
    pieces: Any,
    factor: Any,
    P: int,
    out: Any,
) -> None:
    """Add factor[k] times the Bernstein tensor of a spline to tensor k of each piece.

    `rows` (pieces, P, k + 1) and `first` (pieces,) say for each direction how coefficients
    from the first one on make those of the piece; out is (n, m, P³).
    """
    s0 = rows0.shape[2]
    s1 = rows1.shape[2]
    s2 = rows2.shape[2]
    for chunk in prange((len(pieces) + CHUNK - 1) // CHUNK):
        a = np.empty((s0, s1, P))
        b = np.empty((s0, P, P))
        for n in range(chunk * CHUNK, min(len(pieces), (chunk + 1) * CHUNK)):
            p0 = pieces[n, 0]
            p1 = pieces[n, 1]
            p2 = pieces[n, 2]
            for i in range(s0):
                for j in range(s1):
                    for r in range(P):
                        v = 0.0
                        for t in range(s2):
                            v += rows2[p2, r, t] * c[first0[p0] + i, first1[p1] + j, first2[p2] + t]
                        a[i, j, r] = v
                for j in range(P):
                    for r in range(P):
                        v = 0.0
                        for t in range(s1):
                            v += rows1[p1, j, t] * a[i, t, r]
                        b[i, j, r] = v
            for i in range(P):
                for j in range(P):
                    for r in range(P):
                        v = 0.0
                        for t in range(s0):
                            v += rows0[p0, i, t] * b[t, j, r]
                        for k in range(len(factor)):
                            out[n, k, (i * P + j) * P + r] += factor[k] * v


@njit(cache=True, error_model="numpy", parallel=True)
def windows(
    c: Any, first0: Any, first1: Any, first2: Any, size: Any, factor: Any, out: Any
) -> None:
    """Add bounds of factor[k] times a spline on all pieces to out (n0, n1, n2, m, 2).

    They are the extremes of the coefficients that matter there.
    """
    for i in prange(len(first0)):
        for j in range(len(first1)):
            for r in range(len(first2)):
                least = np.inf
                most = -np.inf
                for x in range(first0[i], first0[i] + size[0]):
                    for y in range(first1[j], first1[j] + size[1]):
                        for z in range(first2[r], first2[r] + size[2]):
                            least = min(least, c[x, y, z])
                            most = max(most, c[x, y, z])
                for k in range(len(factor)):
                    f = factor[k]
                    out[i, j, r, k, 0] += min(f * least, f * most)
                    out[i, j, r, k, 1] += max(f * least, f * most)


@njit(cache=True, error_model="numpy", parallel=True)
def signs(tensors: Any, halvings: int, L: Any, out: Any) -> None:
    """`cell_sign` of every row of tensors (n, m, P³)."""
    m = tensors.shape[1]
    size = tensors.shape[2]
    for chunk in prange((len(tensors) + CHUNK - 1) // CHUNK):
        Z = np.empty(NUMBERS)
        N = np.zeros(INTEGERS, np.int64)
        for n in range(chunk * CHUNK, min(len(tensors), (chunk + 1) * CHUNK)):
            for k in range(m):
                for i in range(size):
                    Z[TENSORS + k * size + i] = tensors[n, k, i]
            out[n] = cell_sign(Z, N, m, halvings, L)


@njit(cache=True, error_model="numpy", parallel=True)
def rules(
    tensors: Any,
    which: Any,
    boxes: Any,
    sides: Any,
    gauss: Any,
    accept: int,
    want: int,
    q: int,
    L: Any,
    volume: Any,
    surface: Any,
    counts: Any,
    used: Any,
) -> None:
    """Rules on boxes (n, 6), given by lower corners and extents.

    which[n] is the row of the tensors, or -1 for a full box. sides[n] is -1 for the box itself,
    or 2 axis + side for one of its faces. Chunk i writes rows of volume[i] (rows, 4) and
    surface[i] (rows, 8); used[i] says how many it has, or would have; counts (n,) are those of
    each box.
    """
    m = tensors.shape[1]
    size = tensors.shape[2]
    for chunk in prange((len(boxes) + CHUNK - 1) // CHUNK):
        Z = np.empty(NUMBERS)
        N = np.zeros(INTEGERS, np.int64)
        points = volume[chunk]
        feet = surface[chunk]
        for i in range(len(gauss)):
            Z[i] = gauss[i]
        for n in range(chunk * CHUNK, min(len(boxes), (chunk + 1) * CHUNK)):
            before = N[N_VOLUME] + N[N_SURFACE]
            for i in range(3):
                Z[LO + i] = boxes[n, i]
                Z[EXT + i] = boxes[n, 3 + i]
            if which[n] < 0:
                if sides[n] < 0:
                    solid(Z, N, points, q)
            else:
                for k in range(m):
                    for i in range(size):
                        Z[TENSORS + k * size + i] = tensors[which[n], k, i]
                if sides[n] < 0:
                    cell_rule(Z, N, points, feet, m, accept, want, q, L)
                else:
                    face_rule(Z, N, points, m, sides[n] // 2, sides[n] % 2, accept, q, L)
            counts[n] = N[N_VOLUME] + N[N_SURFACE] - before
        used[chunk] = N[N_VOLUME] + N[N_SURFACE]


@njit(cache=True, error_model="numpy", parallel=True)
def gather(
    arena: Any, starts: Any, used: Any, points: Any, weights: Any, normals: Any, sets: Any
) -> None:
    """Copy the rows of all chunks to where they belong; normals and sets of surfaces only."""
    wide = arena.shape[2] > 4
    for chunk in prange(len(used)):
        for i in range(used[chunk]):
            row = starts[chunk] + i
            for j in range(3):
                points[row, j] = arena[chunk, i, j]
            weights[row] = arena[chunk, i, 3]
            if wide:
                for j in range(3):
                    normals[row, j] = arena[chunk, i, 4 + j]
                sets[row] = int(arena[chunk, i, 7])
