"""Compiled sampling of fields on blocks of 9 x 9 x 9 grid points, and interval pruning.

Samples of a block lie in ``samples[b, i, j, k]``, k < 9, float32; the lanes from 9 on are filled
with further values along z, which nobody reads. Axis tables are indexed by padded sample (see
`_kernels_cells`), along z with 8 more at the end.

Guarantees: the value at a grid point is bitwise the same in all blocks that share it, for any
number of threads. Non-guarantees: arguments are not checked.
"""

import numpy as np
from numba import njit

from ilattice._kernels import in_ranges, outer
from ilattice.mesh._kernels_cells import CHUNK, LANES, B, S


@in_ranges(4 * CHUNK)
@outer(nogil=True, error_model="numpy")
def mark_points(first, last, coords, layer, px, py, pz, mark):
    """Set ``mark[x, y, z]`` to 1 at the planes that the blocks use; px < 0 is skipped."""
    for b in range(first, last):
        for i in range(S):
            x = px[B * (coords[b, 3] - layer) + i]
            if x < 0:
                continue
            for j in range(S):
                y = py[B * coords[b, 1] + j]
                for k in range(S):
                    mark[x, y, pz[B * coords[b, 2] + k]] = 1


@in_ranges(4 * CHUNK)
@outer(nogil=True, error_model="numpy")
def gather(first, last, values, coords, layer, px, py, pz, samples):
    """Samples of blocks from the values on the planes of a slab."""
    for b in range(first, last):
        for i in range(S):
            x = max(px[B * (coords[b, 3] - layer) + i], 0)
            for j in range(S):
                y = py[B * coords[b, 1] + j]
                for k in range(LANES):
                    samples[b, i, j, k] = values[x, y, pz[B * coords[b, 2] + k]]


@in_ranges(4 * CHUNK)
@outer(nogil=True, error_model="numpy", fastmath={"contract", "nsz"})
def fill_trig(first, last, coef, code, tx, ty, tz, coords, samples):
    """Samples of a separable sum: ``sum_m coef[m] tx[code[m, 0]] ty[code[m, 1]] tz[code[m, 2]]``.

    Terms are sorted by ``code[:, 2]``; the tables are (codes, padded samples), float32.
    """
    terms = len(coef)
    for b in range(first, last):
        z0 = B * coords[b, 2]
        for i in range(S):
            x = B * coords[b, 3] + i
            for j in range(S):
                y = B * coords[b, 1] + j
                row = samples[b, i, j]
                for k in range(LANES):
                    row[k] = np.float32(0.0)
                m = 0
                while m < terms:
                    q = code[m, 2]
                    a = np.float32(0.0)
                    while m < terms and code[m, 2] == q:
                        a += coef[m] * (tx[code[m, 0], x] * ty[code[m, 1], y])
                        m += 1
                    z = tz[q, z0 : z0 + LANES]
                    for k in range(LANES):
                        row[k] += a * z[k]


@njit(cache=True, inline="always")
def _product(a0, a1, b0, b1):
    """Interval product."""
    p, q, r, s = a0 * b0, a0 * b1, a1 * b0, a1 * b1
    return min(min(p, q), min(r, s)), max(max(p, q), max(r, s))


@in_ranges(4 * CHUNK)
@outer(nogil=True, error_model="numpy")
def ranges_trig(first, last, coef, code, ix, iy, iz, low, high):
    """Bounds of a separable sum on a tensor grid of boxes.

    ``ix (codes, boxes, 2)`` holds the interval of each factor on each box of the axis; bounds go
    to `low` and `high` of shape (boxes x, boxes y, boxes z).
    """
    ny, nz = low.shape[1], low.shape[2]
    for xy in range(first, last):
        x = xy // ny
        y = xy % ny
        for z in range(nz):
            low[x, y, z] = 0.0
            high[x, y, z] = 0.0
        for m in range(len(coef)):
            cx, cy, cz = code[m, 0], code[m, 1], code[m, 2]
            a0, a1 = _product(ix[cx, x, 0], ix[cx, x, 1], iy[cy, y, 0], iy[cy, y, 1])
            a0, a1 = coef[m] * a0, coef[m] * a1
            if a0 > a1:
                a0, a1 = a1, a0
            for z in range(nz):
                p, q = _product(a0, a1, iz[cz, z, 0], iz[cz, z, 1])
                low[x, y, z] += p
                high[x, y, z] += q


@in_ranges(4 * CHUNK)
@outer(nogil=True, error_model="numpy", fastmath={"contract", "nsz"})
def fill_spline(first, last, c, bx, sx, by, sy, bz, sz, coords, samples):
    """Samples of a scalar B-spline with coefficients `c` (n0, n1, n2), float32.

    ``bx (samples, k + 1)`` holds the basis functions at the padded samples of the axis, ``sx`` the
    index of the first of them; along z ``bz`` has the samples in its last axis, (k + 1, samples).
    """
    line = np.zeros((c.shape[0], c.shape[1], LANES), np.float32)
    plane = np.zeros((c.shape[0], S, LANES), np.float32)
    for b in range(first, last):
        x0, y0, z0 = B * coords[b, 3], B * coords[b, 1], B * coords[b, 2]
        i0, i1 = sx[x0], sx[x0 + S - 1] + bx.shape[1]
        j0, j1 = sy[y0], sy[y0 + S - 1] + by.shape[1]
        for i in range(i0, i1):
            for j in range(j0, j1):
                row = line[i, j]
                for k in range(S):
                    row[k] = np.float32(0.0)
                    for q in range(bz.shape[0]):
                        row[k] += bz[q, z0 + k] * c[i, j, sz[z0 + k] + q]
            for j in range(S):
                row = plane[i, j]
                for k in range(LANES):
                    row[k] = np.float32(0.0)
                for q in range(by.shape[1]):
                    w = by[y0 + j, q]
                    source = line[i, sy[y0 + j] + q]
                    for k in range(LANES):
                        row[k] += w * source[k]
        for i in range(S):
            for j in range(S):
                row = samples[b, i, j]
                for k in range(LANES):
                    row[k] = np.float32(0.0)
                for q in range(bx.shape[1]):
                    w = bx[x0 + i, q]
                    source = plane[sx[x0 + i] + q, j]
                    for k in range(LANES):
                        row[k] += w * source[k]


@in_ranges(4 * CHUNK)
@outer(nogil=True, error_model="numpy")
def divide(first, last, samples, divisor):
    """``samples / divisor`` in place."""
    for b in range(first, last):
        for i in range(S):
            for j in range(S):
                for k in range(LANES):
                    samples[b, i, j, k] /= divisor[b, i, j, k]
