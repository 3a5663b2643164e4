"""Trigonometric polynomials on tensor grids: one table per axis, terms gathered by z-factor.

Per row of constant x and y the polynomial is ``base + sum_c pz[c] * Z[c]`` with as few rows ``Z``
as there are z-factors, so that long rows run at the speed of the store.

Guarantee: no scratch per row, results do not depend on the number of threads.
"""

from typing import Any

import numpy as np

from ilattice._kernels import in_ranges, inner, outer

FAST = {"contract", "nsz", "arcp", "reassoc"}


@inner(fastmath=FAST)
def _row(base: Any, pz: Any, tz: Any, row: Any) -> None:
    """``row = base + pz @ tz``; the number of rows of tz is even."""
    z0, z1 = tz[0], tz[1]
    p0, p1 = pz[0], pz[1]
    for k in range(row.shape[0]):
        row[k] = base + p0 * z0[k] + p1 * z1[k]
    for c in range(2, tz.shape[0], 2):
        z0, z1 = tz[c], tz[c + 1]
        p0, p1 = pz[c], pz[c + 1]
        for k in range(row.shape[0]):
            row[k] += p0 * z0[k] + p1 * z1[k]


@inner(owning=True, fastmath=FAST)
def _slab(i: int, coef: Any, slot: Any, tx: Any, ty: Any, tz: Any, out: Any) -> None:
    """All rows of constant x index i."""
    m = coef.shape[0]
    kx = np.empty(m)
    for t in range(m):
        kx[t] = coef[t] * tx[slot[t, 0], i]
    p = np.empty(tz.shape[0] + 1)
    pz = np.empty(tz.shape[0], dtype=tz.dtype)
    for j in range(ty.shape[1]):
        for c in range(p.shape[0]):
            p[c] = 0.0
        for t in range(m):
            p[slot[t, 2]] += kx[t] * ty[slot[t, 1], j]
        for c in range(pz.shape[0]):
            pz[c] = p[c + 1]
        _row(tz.dtype.type(p[0]), pz, tz, out[i, j])


@in_ranges(4)
@outer(nogil=True, error_model="numpy")
def tensor_grid(
    first: int, last: int, coef: Any, slot: Any, tx: Any, ty: Any, tz: Any, out: Any
) -> None:
    """Fill ``out[i, j, k]`` with ``sum_t coef[t] tx[slot[t, 0], i] ty[slot[t, 1], j] z``.

    Parameters
    ----------
    first, last
        Indices i.
    coef, slot
        Terms: (m,) float64, (m, 3) int64 rows of the tables.
    tx, ty
        Tables of the first two axes, (rows, n) float64.
    tz
        Table of the last axis, (even number of rows, n), in the type of ``out``;
        ``slot[t, 2] = s`` means row ``s - 1``, and 0 the constant 1.
    out
        Result, (nx, ny, nz) float32 or float64.
    """
    for i in range(first, last):
        _slab(i, coef, slot, tx, ty, tz, out)
