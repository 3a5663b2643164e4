"""Compiled loops over the quads of a contour: normals, planes around vertices, cells, root finding.

Guarantees: sums run over the quads in their order, on one thread; what runs on several handles each
quad or vertex on its own: results do not depend on the number of threads. Non-guarantees: arguments
are not checked.
"""

import numpy as np

from ilattice._kernels import in_ranges, inner, outer

#: Items that a thread takes at once: where some numbers are computed for each, and where many are.
MANY, FEW = 4096, 512


@inner()
def _below(planes, p, most):
    """Largest index up to `most` of a plane that is not above p; 0 if there is none."""
    low, high = 0, most + 1
    while high - low > 1:
        middle = (low + high) // 2
        if planes[middle] <= p:
            low = middle
        else:
            high = middle
    return low


@in_ranges(MANY)
@outer(nogil=True)
def facing(first, last, x, quads, normal):
    """Unit normals (n, 3) of quads; zero where there is none."""
    for i in range(first, last):
        a, b, c, d = quads[i, 0], quads[i, 1], quads[i, 2], quads[i, 3]
        ux, uy, uz = x[c, 0] - x[a, 0], x[c, 1] - x[a, 1], x[c, 2] - x[a, 2]
        vx, vy, vz = x[d, 0] - x[b, 0], x[d, 1] - x[b, 1], x[d, 2] - x[b, 2]
        nx, ny, nz = uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx
        length = np.sqrt(nx * nx + ny * ny + nz * nz)
        scale = 1.0 / length if length > 0.0 else 0.0
        normal[i, 0], normal[i, 1], normal[i, 2] = scale * nx, scale * ny, scale * nz


@outer()
def touched(mask, rows, out):
    """How many of the vertices in each row are in a mask."""
    for i in range(len(rows)):
        count = 0
        for k in range(rows.shape[1]):
            count += mask[rows[i, k]]
        out[i] = count


@outer()
def bends(quads, normal, mean, least):
    """Least cosines between the normals around vertices and their mean.

    ``mean`` (V, 3) comes filled with 0, ``least`` (V,) with 1.
    """
    for i in range(len(quads)):
        for k in range(4):
            for c in range(3):
                mean[quads[i, k], c] += normal[i, c]
    for v in range(len(mean)):
        length = np.sqrt(mean[v, 0] ** 2 + mean[v, 1] ** 2 + mean[v, 2] ** 2)
        for c in range(3):
            mean[v, c] /= max(length, 1e-300)
    for i in range(len(quads)):
        for k in range(4):
            v = quads[i, k]
            cosine = 0.0
            for c in range(3):
                cosine += mean[v, c] * normal[i, c]
            least[v] = min(least[v], cosine)


@outer()
def gather(quads, foot, normal, x, place, A, b):
    """Add to A (n, 3, 3) and b (n, 3) the planes of quads around the vertices with a place."""
    for i in range(len(quads)):
        for k in range(4):
            v = quads[i, k]
            own = place[v]
            if own < 0:
                continue
            height = 0.0
            for r in range(3):
                height += normal[i, r] * (foot[i, r] - x[v, r])
            for r in range(3):
                b[own, r] += normal[i, r] * height
                for c in range(3):
                    A[own, r, c] += normal[i, r] * normal[i, c]


@in_ranges(FEW)
@outer(nogil=True)
def approach(first, last, x, A, b, inverse, low, high, turns, out):
    """Points nearest to planes around x, in boxes: from planes to box and back."""
    p = np.empty(3)
    rest = np.empty(3)
    for i in range(first, last):
        for r in range(3):
            p[r] = x[i, r]
        for _ in range(turns):
            for r in range(3):
                rest[r] = b[i, r]
                for c in range(3):
                    rest[r] -= A[i, r, c] * (p[c] - x[i, c])
            still = True
            for r in range(3):
                q = p[r]
                for c in range(3):
                    q += inverse[i, r, c] * rest[c]
                q = min(max(q, low[i, r]), high[i, r])
                still = still and q == p[r]
                out[i, r] = q
            for r in range(3):
                p[r] = out[i, r]
            if still:
                break


@in_ranges(FEW)
@outer(nogil=True)
def cells(first, last, x, px, py, pz, low, high):
    """Lower and upper corners of the cells that hold points."""
    for i in range(first, last):
        c = _below(px, x[i, 0], len(px) - 2)
        low[i, 0], high[i, 0] = px[c], px[c + 1]
        c = _below(py, x[i, 1], len(py) - 2)
        low[i, 1], high[i, 1] = py[c], py[c + 1]
        c = _below(pz, x[i, 2], len(pz) - 2)
        low[i, 2], high[i, 2] = pz[c], pz[c + 1]


@inner()
def _span(planes, x, quad, a, low, high):
    """Ends along an axis of the grid edge inside four cells; 1 if it runs along that axis."""
    first = last = _below(planes, x[quad[0], a], len(planes) - 2)
    for k in range(1, 4):
        c = _below(planes, x[quad[k], a], len(planes) - 2)
        first, last = min(first, c), max(last, c)
    along = first == last
    low[a] = planes[first if along else last]
    high[a] = planes[last + 1 if along else last]
    return 1 if along else 0


@in_ranges(FEW)
@outer(nogil=True)
def edges(first, last, x, quads, px, py, pz, low, high, found):
    """Ends (n, 3) of the edges of the grid that quads surround; whether there is just one."""
    for i in range(first, last):
        count = _span(px, x, quads[i], 0, low[i], high[i])
        count += _span(py, x, quads[i], 1, low[i], high[i])
        count += _span(pz, x, quads[i], 2, low[i], high[i])
        found[i] = count == 1
