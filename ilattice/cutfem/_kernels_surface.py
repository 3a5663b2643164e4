"""Matrices of conditions on surfaces: springs, Nitsche's method, also between two phases.

Guarantees: a matrix depends on its own cell only; both halves come from the same operations; the
same bits for any number of threads.
"""

from typing import Any

from ilattice._kernels import in_ranges, outer
from ilattice.bspline._kernels_basis import INNER


@in_ranges(16)
@outer(nogil=True, **INNER)
def seam_blocks(
    first: int, last: int, offsets: Any, w: Any, N: Any, T: Any, Q: Any, out: Any
) -> None:
    """Matrices out (pairs, m nb, m nb) of w (N Q N - N T - its transpose) on pairs of elements.

    N (n, nb) are the jumps of the functions of both elements, T (n, m, nb, m) the mean tractions of
    function b along direction j at [:, :, b, j], Q (n, m, m) a symmetric stiffness per area.
    """
    nb = N.shape[1]
    m = Q.shape[1]
    for e in range(first, last):
        A = out[e]
        A[:] = 0.0
        for q in range(offsets[e], offsets[e + 1]):
            for a in range(nb):
                for b in range(a, nb):
                    for i in range(m):
                        for j in range(m):
                            v = N[q, a] * N[q, b] * Q[q, i, j]
                            v -= N[q, a] * T[q, i, b, j] + N[q, b] * T[q, j, a, i]
                            A[m * a + i, m * b + j] += w[q] * v
        for a in range(m * nb):
            for b in range(a // m * m):
                A[a, b] = A[b, a]
