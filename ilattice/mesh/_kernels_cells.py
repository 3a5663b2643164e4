"""Compiled passes over blocks of 8 x 8 x 8 cells: signs, crossings, counts, vertices.

The grid is padded by one ghost layer of outside samples beyond each face of the domain, except in
wrapped directions. Padded cell c lies between the padded samples c and c + 1; cells 0 and
``cells - 1`` of a direction that is not wrapped are ghost cells. A *window* is a list of sampled
blocks:

- ``coords (W, 4)``: layer in the window, block index along y and z, block index along x;
- ``lookup (L, by, bz)``: place of a block in the list, or -1;
- ``rows (W, 81)``: bit k of row 9 i + j is set when sample (i, j, k) of the block is inside;
- ``flips (W, 64)``: bit k of row 8 i + j is set when the cell takes the flipped pattern;
- ``prefix (W, 65)``: number of vertices in the cell rows before row 8 i + j;
- ``shape (6,)``: padded cells per direction, then 1 for each wrapped direction.

Guarantees: each block writes to its own place, so results do not depend on the number of threads.
Non-guarantees: arguments are not checked.
"""

import numpy as np
from numba import njit

from ilattice._kernels import in_ranges, inner, outer
from ilattice.mesh._kernels_bits import lowest, popcount
from ilattice.mesh._tables import CASES, DOUBLE, FLIPPED, ORDER, PATCHES, START

B = 8  # cells per block and direction
S = 9  # samples per block and direction
LANES = 16  # samples in memory per row
CHUNK = 16  # blocks per task

_OFFSET = np.array(  # corner of each edge (its lower end), and its axis
    [[0, o, p, 0] for o in (0, 1) for p in (0, 1)]
    + [[o, 0, p, 1] for o in (0, 1) for p in (0, 1)]
    + [[o, p, 0, 2] for o in (0, 1) for p in (0, 1)]
)
_SLOT = _OFFSET[:, 3] * 729 + _OFFSET[:, 0] * 81 + _OFFSET[:, 1] * 9 + _OFFSET[:, 2]
CAP = 64  # bit of `kind`: inside a cap, not on the level set
LOWER = 128  # bit of `kind`: on the lower of two levels
#: Places in the table of cells along the axes: lower ends, widths, and the least and the largest
#: coordinate of vertices.
LOW, WIDTH, BOTTOM, TOP = 0, 1, 2, 3


@inner()
def extent(shape, axis, block):
    """Number of cells of a block along an axis."""
    return min(B, shape[axis] - B * block)


@inner()
def real_bits(shape, axis, block):
    """Bits of the samples of a block that are not ghosts."""
    n = extent(shape, axis, block)
    bits = (1 << (n + 1)) - 1
    if shape[3 + axis] == 0:
        if block == 0:
            bits &= ~1
        if B * block + n == shape[axis]:
            bits &= ~(1 << n)
    return bits


@inner()
def ghost_side(shape, axis, cell):
    """Offset of the real corners of a ghost cell along an axis; -1 for other cells."""
    if shape[3 + axis] == 1:
        return -1
    if cell == 0:
        return 1
    if cell == shape[axis] - 1:
        return 0
    return -1


@inner()
def neighbour(lookup, shape, coords, b, ox, oy, oz):
    """Place in the window of a block next to block b, or -1."""
    w = coords[b, 0] + ox
    y = coords[b, 1] + oy
    z = coords[b, 2] + oz
    if shape[4] == 1:
        y = y % lookup.shape[1]
    if shape[5] == 1:
        z = z % lookup.shape[2]
    if w < 0 or w >= lookup.shape[0] or y < 0 or y >= lookup.shape[1]:
        return -1
    if z < 0 or z >= lookup.shape[2]:
        return -1
    return lookup[w, y, z]


@njit(cache=True, inline="always")
def crossed_cells(rows, b, i, j, bits):
    """Bits of the cells of a row that the surface crosses, and the four rows of signs."""
    r = S * i + j
    m0 = np.int64(rows[b, r])
    m1 = np.int64(rows[b, r + 1])
    m2 = np.int64(rows[b, r + S])
    m3 = np.int64(rows[b, r + S + 1])
    some = m0 | m1 | m2 | m3
    every = m0 & m1 & m2 & m3
    return (some | (some >> 1)) & ~(every & (every >> 1)) & bits, m0, m1, m2, m3


@njit(cache=True, inline="always")
def pattern(m0, m1, m2, m3, k):
    """Pattern of the cell at k between four rows of signs."""
    return ((m0 >> k) & 3) | ((m1 >> k) & 3) << 2 | ((m2 >> k) & 3) << 4 | ((m3 >> k) & 3) << 6


@inner()
def pattern_at(rows, b, i, j, k):
    """Pattern of one cell."""
    r = S * i + j
    m0 = np.int64(rows[b, r])
    m1 = np.int64(rows[b, r + 1])
    m2 = np.int64(rows[b, r + S])
    m3 = np.int64(rows[b, r + S + 1])
    return pattern(m0, m1, m2, m3, k)


@inner()
def is_flipped(rows, lookup, shape, coords, b, i, j, k, code):
    """Whether the double face of a pattern is double in the cell across it, too."""
    face = np.int64(CASES[code, DOUBLE])
    axis = face >> 1
    step = 2 * (face & 1) - 1
    ox = oy = oz = 0
    if axis == 0:
        i += step
        ox = -1 if i < 0 else (1 if i >= extent(shape, 0, coords[b, 3]) else 0)
    elif axis == 1:
        j += step
        oy = -1 if j < 0 else (1 if j >= extent(shape, 1, coords[b, 1]) else 0)
    else:
        k += step
        oz = -1 if k < 0 else (1 if k >= extent(shape, 2, coords[b, 2]) else 0)
    if ox != 0 or oy != 0 or oz != 0:
        b = neighbour(lookup, shape, coords, b, ox, oy, oz)
        if b < 0:
            return False
        if ox != 0:
            i = 0 if ox > 0 else extent(shape, 0, coords[b, 3]) - 1
        elif oy != 0:
            j = 0 if oy > 0 else extent(shape, 1, coords[b, 1]) - 1
        else:
            k = 0 if oz > 0 else extent(shape, 2, coords[b, 2]) - 1
    return CASES[pattern_at(rows, b, i, j, k), DOUBLE] == face ^ 1


@inner()
def is_bare(gx, gy, gz, code):
    """Whether all real corners of a ghost cell are inside: its vertex belongs to caps only."""
    if gx < 0 and gy < 0 and gz < 0:
        return False
    for c in range(8):
        real = (
            (gx < 0 or c >> 2 == gx) and (gy < 0 or (c >> 1) & 1 == gy) and (gz < 0 or c & 1 == gz)
        )
        if real and (code >> c) & 1 == 0:
            return False
    return True


@in_ranges(4 * CHUNK)
@outer(nogil=True, error_model="numpy")
def signs(first, last, samples, coords, shape, lower, upper, rows, crossed):
    """Signs of sampled blocks into `rows`; number of crossed edges of each into `crossed`."""
    for b in range(first, last):
        bx = real_bits(shape, 0, coords[b, 3])
        by = real_bits(shape, 1, coords[b, 1])
        bz = real_bits(shape, 2, coords[b, 2])
        for i in range(S):
            for j in range(S):
                m = np.uint32(0)
                for k in range(LANES):
                    v = samples[b, i, j, k]
                    m |= np.uint32(v < upper and not v <= lower) << np.uint32(k)
                keep = ((bx >> i) & 1) * ((by >> j) & 1) * bz
                rows[b, S * i + j] = np.int64(m) & keep
        crossed[b] = _crossed_edges(rows, shape, coords, b)


@inner()
def _crossed_edges(rows, shape, coords, b):
    """Number of crossed edges of a block, those on its upper faces included."""
    ni = extent(shape, 0, coords[b, 3])
    nj = extent(shape, 1, coords[b, 1])
    bits = (1 << extent(shape, 2, coords[b, 2])) - 1
    total = 0
    for i in range(ni + 1):
        for j in range(nj + 1):
            m = np.int64(rows[b, S * i + j])
            total += popcount((m ^ (m >> 1)) & bits)
            if j < nj:
                total += popcount(m ^ np.int64(rows[b, S * i + j + 1]))
            if i < ni:
                total += popcount(m ^ np.int64(rows[b, S * i + j + S]))
    return total


@njit(cache=True, inline="always")
def _fraction(v0, v1, lower, upper):
    """Where on an edge the linear interpolant crosses a bound; 2 more where it is the lower."""
    out = v1 if (v0 < upper and not v0 <= lower) else v0
    bound = upper if out >= upper else lower
    t = (bound - v0) / (v1 - v0)
    t = t if t >= 0.0 and t <= 1.0 else np.float32(0.5)
    return t if out >= upper else t + np.float32(2.0)


@in_ranges(4 * CHUNK)
@outer(nogil=True, error_model="numpy")
def crossings(first, last, samples, coords, shape, lower, upper, rows, edge, t):
    """Fractions of the crossed edges of block b into ``t[edge[b] : edge[b + 1]]``."""
    for b in range(first, last):
        ni = extent(shape, 0, coords[b, 3])
        nj = extent(shape, 1, coords[b, 1])
        bits = (1 << extent(shape, 2, coords[b, 2])) - 1
        at = edge[b]
        for i in range(ni + 1):
            for j in range(nj + 1):
                m = np.int64(rows[b, S * i + j])
                x = (m ^ (m >> 1)) & bits
                while x != 0:
                    k = lowest(x)
                    x &= x - 1
                    t[at] = _fraction(samples[b, i, j, k], samples[b, i, j, k + 1], lower, upper)
                    at += 1
                x = m ^ np.int64(rows[b, S * i + j + 1]) if j < nj else 0
                while x != 0:
                    k = lowest(x)
                    x &= x - 1
                    t[at] = _fraction(samples[b, i, j, k], samples[b, i, j + 1, k], lower, upper)
                    at += 1
                x = m ^ np.int64(rows[b, S * i + j + S]) if i < ni else 0
                while x != 0:
                    k = lowest(x)
                    x &= x - 1
                    t[at] = _fraction(samples[b, i, j, k], samples[b, i + 1, j, k], lower, upper)
                    at += 1


@inner()
def _unpack(rows, ni, nj, bits, b, t, at, dense):
    """Fractions of the crossed edges of a block from the packed list to their places."""
    for i in range(ni + 1):
        for j in range(nj + 1):
            r = S * i + j
            m = np.int64(rows[b, r])
            x = (m ^ (m >> 1)) & bits
            while x != 0:
                dense[1458 + 9 * r + lowest(x)] = t[at]
                at += 1
                x &= x - 1
            x = m ^ np.int64(rows[b, r + 1]) if j < nj else 0
            while x != 0:
                dense[729 + 9 * r + lowest(x)] = t[at]
                at += 1
                x &= x - 1
            x = m ^ np.int64(rows[b, r + S]) if i < ni else 0
            while x != 0:
                dense[9 * r + lowest(x)] = t[at]
                at += 1
                x &= x - 1


@inner()
def kept_edges(shape, axis, block, caps):
    """Bits of the edges along an axis that carry a face: without caps, not those to ghosts."""
    n = extent(shape, axis, block)
    bits = (1 << n) - 1
    if shape[3 + axis] == 0 and not caps:
        if block == 0:
            bits &= ~1
        if B * block + n == shape[axis]:
            bits &= ~(1 << (n - 1))
    return bits


@inner()
def _count_quads(rows, shape, coords, b, caps):
    """Number of faces that a block owns."""
    bx = kept_edges(shape, 0, coords[b, 3], caps)
    by = kept_edges(shape, 1, coords[b, 1], caps)
    bz = kept_edges(shape, 2, coords[b, 2], caps)
    bits = (1 << extent(shape, 2, coords[b, 2])) - 1
    total = 0
    for i in range(extent(shape, 0, coords[b, 3])):
        for j in range(extent(shape, 1, coords[b, 1])):
            r = S * i + j
            m = np.int64(rows[b, r])
            total += popcount((m ^ (m >> 1)) & bz)
            if (by >> j) & 1:
                total += popcount((m ^ np.int64(rows[b, r + 1])) & bits)
            if (bx >> i) & 1:
                total += popcount((m ^ np.int64(rows[b, r + S])) & bits)
    return total


@in_ranges(4 * CHUNK)
@outer(nogil=True, error_model="numpy")
def count(first, last, offset, rows, lookup, shape, coords, caps, flips, prefix, quads):
    """Fill `flips` and `prefix` of the blocks from `offset` on; their numbers of faces."""
    for n in range(first, last):
        b = offset + n
        quads[n] = _count_quads(rows, shape, coords, b, caps)
        bits = (1 << extent(shape, 2, coords[b, 2])) - 1
        nj = extent(shape, 1, coords[b, 1])
        total = np.int64(0)
        for i in range(B):
            for j in range(B):
                prefix[b, B * i + j] = total
                flip = 0
                x = 0
                m0 = m1 = m2 = m3 = 0
                if i < extent(shape, 0, coords[b, 3]) and j < nj:
                    x, m0, m1, m2, m3 = crossed_cells(rows, b, i, j, bits)
                while x != 0:
                    k = lowest(x)
                    x &= x - 1
                    code = pattern(m0, m1, m2, m3, k)
                    if CASES[code, DOUBLE] >= 0 and is_flipped(
                        rows, lookup, shape, coords, b, i, j, k, code
                    ):
                        flip |= 1 << k
                        total += 1
                    if caps or not _bare_at(shape, coords, b, i, j, k, code):
                        total += int(CASES[code, PATCHES])
                flips[b, B * i + j] = flip
        prefix[b, B * B] = total


@inner()
def _bare_at(shape, coords, b, i, j, k, code):
    """Whether a cell of a block has nothing but a cap."""
    return is_bare(
        ghost_side(shape, 0, B * coords[b, 3] + i),
        ghost_side(shape, 1, B * coords[b, 1] + j),
        ghost_side(shape, 2, B * coords[b, 2] + k),
        code,
    )


@inner()
def _is_real_edge(e, gx, gy, gz):
    """Whether an edge of a ghost cell lies on the face of the domain."""
    axis = _OFFSET[e, 3]
    return (
        (gx < 0 or (axis != 0 and _OFFSET[e, 0] == gx))
        and (gy < 0 or (axis != 1 and _OFFSET[e, 1] == gy))
        and (gz < 0 or (axis != 2 and _OFFSET[e, 2] == gz))
    )


@inner()
def _place(row, patch, slot, dense, gx, gy, gz, fraction):
    """Mean of the crossings of a patch, as fractions of the cell; CAP or LOWER for its kind."""
    sx = sy = sz = 0.0
    n = 0
    lower = 0
    ghost = gx >= 0 or gy >= 0 or gz >= 0
    for q in range(CASES[row, START + patch], CASES[row, START + patch + 1]):
        e = CASES[row, ORDER + q]
        if ghost and not _is_real_edge(e, gx, gy, gz):
            continue
        t = dense[slot + _SLOT[e]]
        if t >= 2.0:
            t -= np.float32(2.0)
            lower += 1
        axis = _OFFSET[e, 3]
        sx += t if axis == 0 else _OFFSET[e, 0]
        sy += t if axis == 1 else _OFFSET[e, 1]
        sz += t if axis == 2 else _OFFSET[e, 2]
        n += 1
    fraction[0] = sx / n if n > 0 else 0.5
    fraction[1] = sy / n if n > 0 else 0.5
    fraction[2] = sz / n if n > 0 else 0.5
    if n == 0:
        return CAP
    return LOWER if 2 * lower > n else 0


@inner()
def face_bits(gx, gy, gz):
    """Bit 2 a + s for each face of the domain that a cell is a ghost of."""
    bits = 0
    if gx >= 0:
        bits |= 1 << (1 - gx)
    if gy >= 0:
        bits |= 4 << (1 - gy)
    if gz >= 0:
        bits |= 16 << (1 - gz)
    return bits


@in_ranges(4 * CHUNK)
@outer(nogil=True, error_model="numpy")
def vertices(
    first, last, rows, flips, shape, coords, caps, t, t_first, start, cells, out, kind, place,
    cell, alone,
):  # fmt: skip
    """Vertices of blocks into `out`, their codes into `kind` and `place`.

    The first one has row ``start[0]`` there. Their cells go to `cell`, and whether they are
    the only ones in them to `alone`, from row 0 on. Codes in `place` are
    ``k | row << 3 | patch << 12``: their cell in its row, row and patch of `CASES`.
    ``cells[LOW, a]`` and so on are those of the padded cells along axis a: ghost cells have width
    0.
    """
    dense = np.empty(3 * S * S * S, np.float32)
    fraction = np.empty(3)
    for b in range(first, last):
        ni = extent(shape, 0, coords[b, 3])
        nj = extent(shape, 1, coords[b, 1])
        bits = (1 << extent(shape, 2, coords[b, 2])) - 1
        _unpack(rows, ni, nj, bits, b, t, t_first[b], dense)
        at = start[b]
        for i in range(ni):
            cx = B * coords[b, 3] + i
            gx = ghost_side(shape, 0, cx)
            for j in range(nj):
                cy = B * coords[b, 1] + j
                gy = ghost_side(shape, 1, cy)
                x, m0, m1, m2, m3 = crossed_cells(rows, b, i, j, bits)
                while x != 0:
                    k = lowest(x)
                    x &= x - 1
                    cz = B * coords[b, 2] + k
                    gz = ghost_side(shape, 2, cz)
                    code = pattern(m0, m1, m2, m3, k)
                    if not caps and is_bare(gx, gy, gz, code):
                        continue
                    row = code + FLIPPED * ((np.int64(flips[b, B * i + j]) >> k) & 1)
                    for patch in range(CASES[row, PATCHES]):
                        level = _place(row, patch, 81 * i + 9 * j + k, dense, gx, gy, gz, fraction)
                        for a in range(3):
                            c = cx if a == 0 else (cy if a == 1 else cz)
                            p = cells[LOW, a, c] + fraction[a] * cells[WIDTH, a, c]
                            out[at, a] = min(max(p, cells[BOTTOM, a, c]), cells[TOP, a, c])
                            cell[at - start[0], a] = c
                        kind[at] = face_bits(gx, gy, gz) | level
                        place[at] = k | row << 3 | patch << 12
                        alone[at - start[0]] = CASES[row, PATCHES] == 1
                        at += 1
