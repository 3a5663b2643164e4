"""Patches: small sets of nodes that hang on each other, and the inverses of their matrices.

Nodes of slivers are held by little else than each other, so that steps which see one node at a time
leave their common motions alone. Guarantees: patches are disjoint, and no larger than asked; the
inverses are positive definite; every patch is done by one thread.
"""

from typing import Any

import numpy as np

from ilattice._kernels import in_ranges, inner, outer
from ilattice.linalg._kernels_multigrid import cholesky, solve_cholesky

#: Least pivot of a patch whose diagonal is one: below it, the matrix in single precision is noise.
MIN_PIVOT = 1e-6


@outer(error_model="numpy")
def join(rows: Any, columns: Any, most: int, out: Any) -> None:
    """out[i] = first node of the patch of node i; couplings are taken in the order given."""
    size = np.ones(len(out), np.int32)
    for i in range(len(out)):
        out[i] = i
    for k in range(len(rows)):
        i = root(out, rows[k])
        j = root(out, columns[k])
        if i != j and size[i] + size[j] <= most:
            i, j = min(i, j), max(i, j)
            out[j] = i
            size[i] += size[j]
    for i in range(len(out)):
        out[i] = out[out[i]]


@inner(error_model="numpy")
def root(first: Any, i: int) -> int:
    """First node of the patch of node i."""
    while first[i] != i:
        i = first[i]
    return i


@in_ranges(16)
@outer(nogil=True, error_model="numpy")
def invert(
    first: int, last: int, offsets: Any, columns: Any, blocks: Any, starts: Any, members: Any,
    where: Any, out: Any,
) -> None:  # fmt: skip
    """Inverses, from out[where[p]] on, of the matrices of the nodes of every patch p.

    Blocks on and right of the diagonal are given, and nodes of a patch ascend.
    """
    m = blocks.shape[1]
    for p in range(first, last):
        nodes = members[starts[p] : starts[p + 1]]
        n = m * len(nodes)
        D = np.zeros((n, n))
        for i in range(len(nodes)):
            for k in range(offsets[nodes[i]], offsets[nodes[i] + 1]):
                for j in range(i, len(nodes)):
                    if columns[k] == nodes[j]:
                        for a in range(m):
                            for b in range(m):
                                D[m * j + b, m * i + a] = blocks[k, a, b]
        cholesky(D, MIN_PIVOT)
        unit = np.zeros(n)
        x = np.empty(n)
        for c in range(n):
            unit[c] = 1.0
            solve_cholesky(D, unit, x)
            unit[c] = 0.0
            for a in range(n):
                out[where[p] + a * n + c] = x[a]


@in_ranges(128)
@outer(nogil=True, error_model="numpy")
def apply(
    first: int, last: int, starts: Any, members: Any, where: Any, inverses: Any, m: int, r: Any,
    s: Any,
) -> None:  # fmt: skip
    """s = inverse times r on the patches, vectors in rows of r (k, n)."""
    for p in range(first, last):
        nodes = members[starts[p] : starts[p + 1]]
        inverse = inverses[where[p] : where[p + 1]]
        for c in range(len(r)):
            at = 0
            for i in range(len(nodes)):
                for a in range(m):
                    v = 0.0
                    for j in range(len(nodes)):
                        for b in range(m):
                            v += inverse[at] * r[c, m * nodes[j] + b]
                            at += 1
                    s[c, m * nodes[i] + a] = v
