"""Compiled evaluation of tensor-product B-splines with one to three parameters.

A spline is seen as a trivariate one (missing parameters have degree 0 and one span) with
coefficients component first, shape (M, n0, n1, n2). Each direction is one flat array, see
`pack_direction`: compiled code passes single arrays around for free, but pays for counting
references to tuples of arrays. Per knot span it holds the monomial coefficients, in
r = (u - middle) / length in [-1/2, 1/2], of the k+1 basis functions that live there.

Sums over coefficients run along the last direction in vectors of four, which are contracted in
the first and second direction before their lanes are added up. Degrees arrive as objects whose
`len` is k+1: a tuple makes it a compile-time constant and unrolls the loops, an array keeps
one generic kernel for the rest. Basis functions lie in scratch of shape (3, 3, `width`):
direction, derivative, function.

Guarantees: no allocation per point; the same result for any number of threads, and whatever
the other points are. No parameter, not even NaN, makes them read outside their arrays.
Non-guarantees: other arguments are not checked; outside the domain the end polynomials continue.
"""

import numpy as np

from ilattice._kernels import in_ranges, inner, outer
from ilattice.bspline._kernels_vector import dot, load, multiply_add, scale, spread, store

FAST = {"contract", "nsz", "arcp", "reassoc"}
#: Points that a thread takes at once.
CHUNK = 4096
PLANES = 4  # of a grid, per piece of parallel work
START, DENSITY, LAST, BUCKETS = range(4)  # layout of a direction, see `pack_direction`
LOWER, UPPER, MIDDLE, SCALE, FIRST, TABLE = range(6)  # layout of the row of a knot span


@outer()
def monomial_table(t, k, spans):
    """Centred monomial coefficients (ns, k+1, k+1) of the basis functions on knot spans."""
    out = np.zeros((len(spans), k + 1, k + 1))
    a = np.zeros((k + 2, k + 1))
    b = np.zeros((k + 2, k + 1))
    for s in range(len(spans)):
        i = spans[s]
        mid = 0.5 * (t[i] + t[i + 1])
        h = t[i + 1] - t[i]
        a[:] = 0.0
        a[0, 0] = 1.0  # row j holds the function that starts at knot i - p + j
        for p in range(1, k + 1):
            b[:] = 0.0
            for j in range(p + 1):
                m = i - p + j
                if j > 0:  # (u - t[m]) / (t[m+p] - t[m]) times the function starting at m
                    d = 1.0 / (t[m + p] - t[m])
                    for e in range(p):
                        b[j, e] += (mid - t[m]) * d * a[j - 1, e]
                        b[j, e + 1] += h * d * a[j - 1, e]
                if j < p:  # (t[m+p+1] - u) / (t[m+p+1] - t[m+1]) times that starting at m + 1
                    d = 1.0 / (t[m + p + 1] - t[m + 1])
                    for e in range(p):
                        b[j, e] += (t[m + p + 1] - mid) * d * a[j, e]
                        b[j, e + 1] -= h * d * a[j, e]
            a, b = b, a
        for j in range(k + 1):
            for e in range(k + 1):
                out[s, j, e] = a[j, e]
    return out


def pack_direction(t, k, n):
    """Everything evaluation needs of one direction, in one float array.

    Layout: first break, bins per length, index of the last bin | per bin the place of the row
    of a span near it | rows of spans (ns, 5 + (k+1)^2): lower and upper end, middle, 1/length,
    index of the first basis function, and power by power the coefficients of the k+1 functions.
    The outer ends of the domain are NaN, which no search passes.
    """
    spans = k + np.flatnonzero(np.diff(t[k : n + 1]) > 0)
    breaks = np.append(t[spans], t[n])
    h = np.diff(breaks)
    bins = len(spans) * (1 if np.allclose(h, h[0], rtol=1e-9, atol=0) else 4)
    length = breaks[-1] - breaks[0]
    edges = breaks[0] + np.arange(bins) * (length / bins)
    bucket = np.clip(np.searchsorted(breaks, edges, side="right") - 1, 0, len(spans) - 1)
    table = monomial_table(np.array(t), k, spans).swapaxes(1, 2)
    lower, upper = np.append(np.nan, breaks[1:-1]), np.append(breaks[1:-1], np.nan)
    middle = 0.5 * (breaks[1:] + breaks[:-1])
    rows = np.column_stack(
        [lower, upper, middle, 1.0 / h, spans - k, table.reshape(len(spans), -1)]
    )
    places = BUCKETS + bins + bucket * rows.shape[1]
    return np.concatenate([[breaks[0], bins / length, bins - 1.0], places, rows.ravel()])


@inner(fastmath=FAST, error_model="numpy", forceinline=True)
def whole(x):
    """A whole number >= 0 stored as float; what follows need not count from the end."""
    return np.int64(np.uint32(x))


@inner(fastmath=FAST, error_model="numpy", forceinline=True)
def find_row(d, size, u):
    """Place of the row of the span that holds u; the outermost one outside the domain."""
    x = (u - d[START]) * d[DENSITY]
    x = x if x > 0.0 else 0.0  # NaN, too
    x = x if x < d[LAST] else d[LAST]
    row = whole(d[BUCKETS + whole(x)])
    while u >= d[row + UPPER]:
        row = whole(row + size)
    while u < d[row + LOWER]:
        row = whole(row - size)
    return row


@inner(fastmath=FAST, error_model="numpy", forceinline=True)
def width(k0, k1, k2):
    """Length of the last axis of scratch: whole vectors."""
    return (max(len(k0), len(k1), len(k2)) + 3) // 4 * 4


@inner(fastmath=FAST, error_model="numpy", forceinline=True)
def basis(d, deg, u, order, out, axis):
    """Basis functions and derivatives at u into out[axis] (3, width); index of the first."""
    n = len(deg)
    row = find_row(d, TABLE + n * n, u)
    ih = d[row + SCALE]
    r = (u - d[row + MIDDLE]) * ih
    for j in range(0, n, 4):
        at = row + TABLE + n * (n - 1) + j
        f = load(d, at, n - j)
        g = spread(0.0)
        h = spread(0.0)
        for _ in range(n - 1):
            at -= n
            if order > 1:
                h = multiply_add(h, r, g)
            if order > 0:
                g = multiply_add(g, r, f)
            f = multiply_add(f, r, load(d, at, n - j))
        at = 3 * axis * out.shape[2] + j
        store(out, at, f)
        if order > 0:
            store(out, at + out.shape[2], scale(g, ih))
        if order > 1:
            store(out, at + 2 * out.shape[2], scale(h, 2.0 * ih * ih))
    return whole(d[row + FIRST])


@inner(fastmath=FAST, error_model="numpy", forceinline=True)
def place(c, m, i, j, q):
    """Flat position of a coefficient."""
    return ((m * c.shape[1] + i) * c.shape[2] + j) * c.shape[3] + q


@inner(fastmath=FAST, error_model="numpy", forceinline=True)
def contract0(c, m, i0, j0, l0, k0, k1, k2, b):
    """Value of one component."""
    first = place(c, m, i0, j0, l0)
    value = 0.0
    for q in range(0, len(k2), 4):
        n = len(k2) - q
        f = spread(0.0)
        for i in range(len(k0)):
            a = spread(0.0)
            for j in range(len(k1)):
                x = load(c, first + place(c, 0, i, j, q), n)
                a = multiply_add(x, b[1, 0, j], a)
            f = multiply_add(a, b[0, 0, i], f)
        value += dot(f, load(b, 6 * b.shape[2] + q, n))
    return value


@inner(fastmath=FAST, error_model="numpy", forceinline=True)
def contract1(c, m, i0, j0, l0, k0, k1, k2, b):
    """Value and gradient of one component."""
    first = place(c, m, i0, j0, l0)
    value = 0.0
    du = 0.0
    dv = 0.0
    dw = 0.0
    for q in range(0, len(k2), 4):
        n = len(k2) - q
        f = spread(0.0)
        fu = spread(0.0)
        fv = spread(0.0)
        for i in range(len(k0)):
            a = spread(0.0)
            av = spread(0.0)
            for j in range(len(k1)):
                x = load(c, first + place(c, 0, i, j, q), n)
                a = multiply_add(x, b[1, 0, j], a)
                av = multiply_add(x, b[1, 1, j], av)
            f = multiply_add(a, b[0, 0, i], f)
            fu = multiply_add(a, b[0, 1, i], fu)
            fv = multiply_add(av, b[0, 0, i], fv)
        z = load(b, 6 * b.shape[2] + q, n)
        value += dot(f, z)
        du += dot(fu, z)
        dv += dot(fv, z)
        dw += dot(f, load(b, 7 * b.shape[2] + q, n))
    return value, du, dv, dw


@inner(fastmath=FAST, error_model="numpy", forceinline=True)
def contract2(c, m, i0, j0, l0, k0, k1, k2, b):
    """Value, gradient and Hessian (uu, vv, ww, vw, uw, uv) of one component."""
    first = place(c, m, i0, j0, l0)
    value = 0.0
    du = 0.0
    dv = 0.0
    dw = 0.0
    duu = 0.0
    dvv = 0.0
    dww = 0.0
    dvw = 0.0
    duw = 0.0
    duv = 0.0
    for q in range(0, len(k2), 4):
        n = len(k2) - q
        # Derivatives in u and v, of lanes along w, so that `load` takes coefficients as they lie.
        f = spread(0.0)
        fu = spread(0.0)
        fv = spread(0.0)
        fuu = spread(0.0)
        fvv = spread(0.0)
        fuv = spread(0.0)
        for i in range(len(k0)):
            a = spread(0.0)
            av = spread(0.0)
            avv = spread(0.0)
            for j in range(len(k1)):
                x = load(c, first + place(c, 0, i, j, q), n)
                a = multiply_add(x, b[1, 0, j], a)
                av = multiply_add(x, b[1, 1, j], av)
                avv = multiply_add(x, b[1, 2, j], avv)
            f = multiply_add(a, b[0, 0, i], f)
            fu = multiply_add(a, b[0, 1, i], fu)
            fuu = multiply_add(a, b[0, 2, i], fuu)
            fv = multiply_add(av, b[0, 0, i], fv)
            fuv = multiply_add(av, b[0, 1, i], fuv)
            fvv = multiply_add(avv, b[0, 0, i], fvv)
        # Rows 6, 7, 8 of the scratch: basis functions in w and their derivatives, which end lanes.
        z = load(b, 6 * b.shape[2] + q, n)
        dz = load(b, 7 * b.shape[2] + q, n)
        value += dot(f, z)
        du += dot(fu, z)
        dv += dot(fv, z)
        dw += dot(f, dz)
        duu += dot(fuu, z)
        dvv += dot(fvv, z)
        dww += dot(f, load(b, 8 * b.shape[2] + q, n))
        dvw += dot(fv, dz)
        duw += dot(fu, dz)
        duv += dot(fuv, z)
    return value, du, dv, dw, duu, dvv, dww, dvw, duw, duv


@in_ranges(CHUNK)
@outer(nogil=True, error_model="numpy")
def inside(first, last, u, lo, hi, out):
    """Set out[0] to False unless all points u (n, nd) lie in the closed box; NaN does not."""
    bad = 0
    for p in range(first, last):
        for axis in range(u.shape[1]):
            bad += not lo[axis] <= u[p, axis] <= hi[axis]
    if bad:
        out[0] = False


@in_ranges(CHUNK)
@outer(nogil=True, fastmath=FAST, error_model="numpy")
def values(first, last, d0, d1, d2, k0, k1, k2, c, u, out):
    """Values at points u (n, 3) into out (n, M)."""
    b = np.empty((3, 3, width(k0, k1, k2)))
    for p in range(first, last):
        i0 = basis(d0, k0, u[p, 0], 0, b, 0)
        j0 = basis(d1, k1, u[p, 1], 0, b, 1)
        l0 = basis(d2, k2, u[p, 2], 0, b, 2)
        for m in range(c.shape[0]):
            out[p, m] = contract0(c, m, i0, j0, l0, k0, k1, k2, b)


@in_ranges(CHUNK)
@outer(nogil=True, fastmath=FAST, error_model="numpy")
def jets1(first, last, d0, d1, d2, k0, k1, k2, c, u, f, g):
    """Values and gradients at points u (n, 3) into f (n, M) and g (n, M, 3)."""
    b = np.empty((3, 3, width(k0, k1, k2)))
    for p in range(first, last):
        i0 = basis(d0, k0, u[p, 0], 1, b, 0)
        j0 = basis(d1, k1, u[p, 1], 1, b, 1)
        l0 = basis(d2, k2, u[p, 2], 1, b, 2)
        for m in range(c.shape[0]):
            x, xu, xv, xw = contract1(c, m, i0, j0, l0, k0, k1, k2, b)
            f[p, m] = x
            g[p, m, 0] = xu
            g[p, m, 1] = xv
            g[p, m, 2] = xw


@in_ranges(CHUNK)
@outer(nogil=True, fastmath=FAST, error_model="numpy")
def jets2(first, last, d0, d1, d2, k0, k1, k2, c, u, f, g, h):
    """Values, gradients and Hessians into f (n, M), g (n, M, 3) and h (n, M, 3, 3)."""
    b = np.empty((3, 3, width(k0, k1, k2)))
    for p in range(first, last):
        i0 = basis(d0, k0, u[p, 0], 2, b, 0)
        j0 = basis(d1, k1, u[p, 1], 2, b, 1)
        l0 = basis(d2, k2, u[p, 2], 2, b, 2)
        for m in range(c.shape[0]):
            x, xu, xv, xw, xuu, xvv, xww, xvw, xuw, xuv = contract2(c, m, i0, j0, l0, k0, k1, k2, b)
            f[p, m] = x
            g[p, m, 0] = xu
            g[p, m, 1] = xv
            g[p, m, 2] = xw
            h[p, m, 0, 0] = xuu
            h[p, m, 1, 1] = xvv
            h[p, m, 2, 2] = xww
            h[p, m, 1, 2] = xvw
            h[p, m, 2, 1] = xvw
            h[p, m, 0, 2] = xuw
            h[p, m, 2, 0] = xuw
            h[p, m, 0, 1] = xuv
            h[p, m, 1, 0] = xuv


@outer(fastmath=FAST, error_model="numpy")
def axis_basis(d, deg, x, order):
    """Basis functions at sample sites of one direction: (order+1, k+1, n) and first (n,)."""
    n = len(x)
    b = np.empty((1, 3, width(deg, deg, deg)))
    out = np.empty((order + 1, len(deg), n))
    first = np.empty(n, np.int64)
    for p in range(n):
        first[p] = basis(d, deg, x[p], order, b, 0)
        for o in range(order + 1):
            for j in range(len(deg)):
                out[o, j, p] = b[0, o, j]
    return out, first


@inner(fastmath=FAST, error_model="numpy", forceinline=True)
def contract_first(c, b, o, x, i, low, out):
    """Sum of planes i, i+1, ... of c from row `low` on, transposed: out[o] (n2, n1)."""
    for j in range(out.shape[2]):
        for z in range(out.shape[1]):
            s = 0.0
            for q in range(b.shape[1]):
                s += b[o, q, x] * c[i + q, low + j, z]
            out[o, z, j] = s


@inner(fastmath=FAST, error_model="numpy", forceinline=True)
def expand_last(plane, p, b, o, first, line, out, r):
    """Rows of samples out[r] (n1, >= nz) from rows of coefficients plane[p] (n2, n1)."""
    n = plane.shape[2]
    for z in range(b.shape[2]):
        for j in range(0, n, 4):
            s = spread(0.0)
            for q in range(b.shape[1]):
                at = (p * plane.shape[1] + first[z] + q) * n + j
                s = multiply_add(load(plane, at, n - j), b[o, q, z], s)
            store(line, j, s)
        for j in range(n):
            out[r, j, z] = line[j]


@inner(fastmath=FAST, error_model="numpy", forceinline=True)
def add_rows(rows, r, j, b, o, y, out, x, d):
    """Weighted sum of rows[r, j], rows[r, j+1], ... into out[x, d, y], four at a time."""
    k = b.shape[1]
    last = rows.shape[1] - 1
    for q in range(0, k, 4):
        w0 = b[o, q, y]
        w1 = b[o, q + 1, y] if q + 1 < k else 0.0
        w2 = b[o, q + 2, y] if q + 2 < k else 0.0
        w3 = b[o, q + 3, y] if q + 3 < k else 0.0
        j0, j1, j2, j3 = j + q, min(j + q + 1, last), min(j + q + 2, last), min(j + q + 3, last)
        if q == 0:
            for z in range(out.shape[3]):
                s = w0 * rows[r, j0, z] + w1 * rows[r, j1, z]
                out[x, d, y, z] = s + w2 * rows[r, j2, z] + w3 * rows[r, j3, z]
        else:
            for z in range(out.shape[3]):
                s = w0 * rows[r, j0, z] + w1 * rows[r, j1, z]
                out[x, d, y, z] += s + w2 * rows[r, j2, z] + w3 * rows[r, j3, z]


@in_ranges(PLANES)
@outer(nogil=True, fastmath=FAST, error_model="numpy")
def grid(first, last, c, bx, fx, by, fy, bz, fz, out):
    """Planes first ... last of values on a tensor grid, one component: out (nx, 1, ny, nz).

    With derivatives it is (nx, 4, ny, nz). For each plane of samples, coefficients are contracted
    in x, which leaves few numbers; those are expanded in z; then each row of samples is a weighted
    sum of rows that lie in cache.
    """
    order = bx.shape[0] - 1
    ny, nz = out.shape[2], out.shape[3]
    low = fy.min() if ny else 0
    n1 = fy.max() + by.shape[1] - low if ny else 0
    plane = np.empty((order + 1, c.shape[2], n1))
    line = np.empty(n1 + 3)
    stride = (nz // 8 + 1 | 1) * 8  # an odd number of cache lines, for columns to spread
    rows = np.empty((1 + 2 * order, n1, stride))
    for x in range(first, last):
        for o in range(order + 1):
            contract_first(c, bx, o, x, fx[x], low, plane)
        for r in range(1 + 2 * order):  # nothing, x or z differentiated
            expand_last(plane, int(r == 1), bz, int(r == 2), fz, line, rows, r)
        for d in range(1 + 3 * order):
            r = int(d == 1) + 2 * int(d == 3)
            for y in range(ny):
                add_rows(rows, r, fy[y] - low, by, int(d == 2), y, out, x, d)
