"""The interpreter on blocks of a tensor grid: what depends on one axis is computed once per plane.

A register is stored for the axes that it depends on only: 9 values for a function of x, 81 for one
of x and y, 729 for one of all three. Separable fields so cost a few operations per point, and
branches that cannot win in a block are left out of its program.

Guarantees: a grid point has bitwise the same value in all blocks that share it, for any number of
threads. Arguments are not checked.
"""

import numpy as np

import ilattice.fields._tables as ops
from ilattice._kernels import in_ranges, inner, outer
from ilattice.fields._kernels_program import apply, begin, bound, narrow

S = 9  # samples per block and direction
CHUNK = 16  # blocks per task


@inner()
def _size(mask):
    """Values of a register that depends on the axes of a mask."""
    return (S if mask & 1 else 1) * (S if mask & 2 else 1) * (S if mask & 4 else 1)


@inner()
def _spread(source, mask, to, out):
    """The values of a register of some axes, repeated along those of a larger mask."""
    ny, nz = (S if to & 2 else 1), (S if to & 4 else 1)
    sz = 1 if mask & 4 else 0
    sy = (S if mask & 4 else 1) if mask & 2 else 0
    sx = (S if mask & 4 else 1) * (S if mask & 2 else 1) if mask & 1 else 0
    for i in range(S if to & 1 else 1):
        for j in range(ny):
            at, row = i * sx + j * sy, (i * ny + j) * nz
            if sz == 1:
                for k in range(nz):
                    out[row + k] = source[at + k]
            else:
                value = source[at]
                for k in range(nz):
                    out[row + k] = value


@inner()
def _run(op, a, b, imm, m, x, y, z, mask, buf, first, second):
    """All registers of a program on one block."""
    for i in range(m):
        o = op[i]
        if o < ops.INPUTS:
            mask[i] = 1 << o if o < ops.CONST else 0
            if o == ops.CONST:
                buf[i, 0] = imm[i]
            else:
                axis = x if o == ops.X else y if o == ops.Y else z
                for k in range(S):
                    buf[i, k] = axis[k]
            continue
        p, q = a[i], b[i] if o >= ops.BINARY else a[i]
        mask[i] = mask[p] | mask[q]
        u, v = buf[p], buf[q]
        if mask[p] != mask[i]:
            _spread(u, mask[p], mask[i], first)
            u = first
        if mask[q] != mask[i]:
            _spread(v, mask[q], mask[i], second)
            v = second
        apply(o, u, v, buf[i], _size(mask[i]))


@in_ranges(CHUNK)
@outer(nogil=True)
def fill_program(first, last, op, a, b, imm, tx, ty, tz, coords, along, middle, samples):
    """Samples of blocks: ``samples[b, i, j, k]``, k < 9, less `middle`, float32.

    ``tx ty tz`` are the coordinates of the padded samples; block b begins at sample
    ``8 (coords[b, 3], coords[b, 1], coords[b, 2])`` of them. The rows of
    `coords` in the order `along` should be near each other.
    """
    codes, numbers, lengths, w, maps = begin(op, a, b, imm, 3)
    box, whole = np.empty((2, 3)), np.empty((2, 3))
    mask = np.empty(len(op) + 1, np.int64)
    buf, repeated = np.empty((64, S * S * S)), np.empty((2, S * S * S))
    for start in range(first, last, CHUNK):
        stop = min(last, start + CHUNK)
        whole[0], whole[1] = np.inf, -np.inf
        for block in along[start:stop]:
            _box(tx, ty, tz, coords[block], box)
            for axis in range(3):
                whole[0, axis] = min(whole[0, axis], box[0, axis])
                whole[1, axis] = max(whole[1, axis], box[1, axis])
        narrow(codes, numbers, lengths, 0, whole, w, maps)
        for block in along[start:stop]:
            _box(tx, ty, tz, coords[block], box)
            narrow(codes, numbers, lengths, 1, box, w, maps)
            m, c = lengths[2], codes[2]
            if m > len(buf):
                buf = np.empty((2 * m, S * S * S))
            x0, y0, z0 = 8 * coords[block, 3], 8 * coords[block, 1], 8 * coords[block, 2]
            x, y, z = tx[x0 : x0 + S], ty[y0 : y0 + S], tz[z0 : z0 + S]
            _run(
                c[0], c[1], c[2], numbers[2], m, x, y, z, mask, buf, repeated[0], repeated[1]
            )  # fmt: skip
            result = buf[m - 1]
            if mask[m - 1] != 7:
                _spread(result, mask[m - 1], 7, repeated[0])
                result = repeated[0]
            for i in range(S):
                for j in range(S):
                    row = samples[block, i, j]
                    for k in range(S):
                        row[k] = result[(i * S + j) * S + k] - middle
                    for k in range(S, len(row)):
                        row[k] = row[S - 1]


@inner()
def _box(tx, ty, tz, coord, box):
    """Box of the samples of a block."""
    x, y, z = 8 * coord[3], 8 * coord[1], 8 * coord[2]
    box[0, 0], box[0, 1], box[0, 2] = tx[x], ty[y], tz[z]
    box[1, 0], box[1, 1], box[1, 2] = tx[x + S - 1], ty[y + S - 1], tz[z + S - 1]


# ------------------------------------------------------------------------ bounds


@inner()
def _ends(ex, ey, ez, i, j, k, width, box):
    """Box of some blocks; how many there are along the axes."""
    i1, j1, k1 = min(i + width, len(ex)), min(j + width, len(ey)), min(k + width, len(ez))
    box[0, 0], box[1, 0] = ex[i, 0], ex[i1 - 1, 1]
    box[0, 1], box[1, 1] = ey[j, 0], ey[j1 - 1, 1]
    box[0, 2], box[1, 2] = ez[k, 0], ez[k1 - 1, 1]
    return i1, j1, k1


@inner()
def _decided(s, t, lower, upper):
    """Whether bounds lie beyond a level, or between the two."""
    return s > upper or t < lower or (lower < s and t < upper)


@in_ranges(4)
@outer(nogil=True)
def block_bounds(first, last, op, a, b, imm, ex, ey, ez, lower, upper, low, high):
    """Bounds on a tensor grid of blocks with ends (n, 2) along the axes, from large boxes down.

    Items are the boxes of eight blocks along each axis. Boxes whose bounds lie beyond
    `upper` or below `lower`, or between the two, are not divided.
    """
    nx, ny, nz = low.shape
    sy, sz = (ny + 7) // 8, (nz + 7) // 8
    codes, numbers, lengths, scratch, maps = begin(op, a, b, imm, 5)
    w = np.empty((len(op) + 1, 10))
    box, none, stack = np.empty((2, 3)), np.empty((0, 3)), np.empty((32, 4), np.int64)
    for task in range(first, last):
        stack[0, 0], stack[0, 1] = 8 * (task // (sy * sz)), 8 * (task // sz % sy)
        stack[0, 2], stack[0, 3] = 8 * (task % sz), 0
        count = 1
        while count:
            count -= 1
            i, j, k = stack[count, 0], stack[count, 1], stack[count, 2]
            level = stack[count, 3]
            width = 8 >> level
            i1, j1, k1 = _ends(ex, ey, ez, i, j, k, width, box)
            s, t = narrow(codes, numbers, lengths, level, box, scratch, maps)
            if width == 1 and not _decided(s, t, lower, upper):  # sharper, and dearer
                d, m = codes[level + 1], lengths[level + 1]
                bound(d[0], d[1], d[2], numbers[level + 1], m, box, none, w)
                s, t = w[m - 1, 0], w[m - 1, 1]
            if width == 1 or _decided(s, t, lower, upper):
                low[i:i1, j:j1, k:k1] = s
                high[i:i1, j:j1, k:k1] = t
                continue
            half = width // 2
            for part in range(8):
                p = i + half * (part >> 2 & 1)
                q, r = j + half * (part >> 1 & 1), k + half * (part & 1)
                if p < nx and q < ny and r < nz:
                    stack[count, 0], stack[count, 1] = p, q
                    stack[count, 2], stack[count, 3] = r, level + 1
                    count += 1
