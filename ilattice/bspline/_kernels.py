"""Compiled evaluation of tensor-product B-splines with one to three parameters.

A spline is seen as a trivariate one (missing parameters have degree 0 and one span) with
coefficients component first, shape (M, n0, n1, n2). Each direction is one flat array, see
`pack_direction`: compiled code passes single arrays around for free, but pays for counting
references to tuples of arrays. Per knot span s it holds the monomial coefficients, in
r = (u - mid[s]) * ih[s] in [-1/2, 1/2], of the k+1 basis functions that live there.

Degrees arrive as objects whose
`len` is k+1: a tuple makes it a compile-time constant and unrolls the loops, an array keeps
one generic kernel for the rest.

Guarantees: no allocation per point, the same result for any number of threads.
Non-guarantees: arguments are not checked; outside the domain the end polynomials continue.
"""

import numpy as np
from numba import njit, prange

FAST = {"contract", "nsz", "arcp", "reassoc"}
CHUNK = 4096


@njit(cache=True)
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
            a[:] = b
        out[s] = a[: k + 1]
    return out


def pack_direction(t, k, n):
    """Everything evaluation needs of one direction, in one float array.

    Layout: ns, nb, first break, bins per length | upper ends of spans (ns) | rows of spans
    (ns, 3 + (k+1)^2): mid, 1/h, index of the first basis function, table | buckets (nb): the
    first span that overlaps each of nb equal bins.
    """
    spans = k + np.flatnonzero(np.diff(t[k : n + 1]) > 0)
    breaks = np.append(t[spans], t[n])
    h = np.diff(breaks)
    bins = len(spans) * (1 if np.allclose(h, h[0], rtol=1e-9, atol=0) else 4)
    length = breaks[-1] - breaks[0]
    edges = breaks[0] + np.arange(bins) * (length / bins)
    bucket = np.clip(np.searchsorted(breaks, edges, side="right") - 1, 0, len(spans) - 1)
    table = monomial_table(np.ascontiguousarray(t), k, spans).reshape(len(spans), -1)
    rows = np.column_stack([0.5 * (breaks[1:] + breaks[:-1]), 1.0 / h, spans - k, table])
    head = [len(spans), bins, breaks[0], bins / length]
    return np.concatenate([head, breaks[1:], rows.ravel(), bucket])


@njit(cache=True, fastmath=FAST, error_model="numpy", forceinline=True)
def find_span(d, size, u):
    """Index of the span that holds u; the first or the last one outside the domain."""
    ns = int(d[0])
    nb = int(d[1])
    s = int(min(max((u - d[2]) * d[3], 0.0), nb - 1.0))
    s = int(d[4 + ns * (1 + size) + s])
    while s < ns - 1 and u >= d[4 + s]:
        s += 1
    while s > 0 and u < d[3 + s]:
        s -= 1
    return s


@njit(cache=True, fastmath=FAST, error_model="numpy", forceinline=True)
def basis(d, deg, u, order, out, axis):
    """Basis functions and derivatives at u into out[axis] (3, >= k+1); index of the first."""
    size = 3 + len(deg) * len(deg)
    top = len(deg) - 1
    row = 4 + int(d[0]) + find_span(d, size, u) * size
    ih = d[row + 1]
    r = (u - d[row]) * ih
    for j in range(len(deg)):
        o = row + 3 + j * len(deg)
        f = d[o + top]
        g = 0.0
        h = 0.0
        for e in range(top - 1, -1, -1):
            if order > 1:
                h = h * r + g
            if order > 0:
                g = g * r + f
            f = f * r + d[o + e]
        out[axis, 0, j] = f
        out[axis, 1, j] = g * ih
        out[axis, 2, j] = 2.0 * h * ih * ih
    return int(d[row + 2])


@njit(cache=True, fastmath=FAST, error_model="numpy", forceinline=True)
def contract0(c, m, i0, j0, l0, k0, k1, k2, b):
    """Value of one component."""
    f = 0.0
    for i in range(len(k0)):
        a = 0.0
        for j in range(len(k1)):
            s = 0.0
            for q in range(len(k2)):
                s += b[2, 0, q] * c[m, i0 + i, j0 + j, l0 + q]
            a += b[1, 0, j] * s
        f += b[0, 0, i] * a
    return f


@njit(cache=True, fastmath=FAST, error_model="numpy", forceinline=True)
def contract1(c, m, i0, j0, l0, k0, k1, k2, b):
    """Value and gradient of one component."""
    f = 0.0
    fu = 0.0
    fv = 0.0
    fw = 0.0
    for i in range(len(k0)):
        a = 0.0
        av = 0.0
        aw = 0.0
        for j in range(len(k1)):
            s = 0.0
            sw = 0.0
            for q in range(len(k2)):
                x = c[m, i0 + i, j0 + j, l0 + q]
                s += b[2, 0, q] * x
                sw += b[2, 1, q] * x
            a += b[1, 0, j] * s
            av += b[1, 1, j] * s
            aw += b[1, 0, j] * sw
        f += b[0, 0, i] * a
        fu += b[0, 1, i] * a
        fv += b[0, 0, i] * av
        fw += b[0, 0, i] * aw
    return f, fu, fv, fw


@njit(cache=True, fastmath=FAST, error_model="numpy", forceinline=True)
def contract2(c, m, i0, j0, l0, k0, k1, k2, b):
    """Value, gradient and Hessian (uu, vv, ww, vw, uw, uv) of one component."""
    f = 0.0
    fu = 0.0
    fv = 0.0
    fw = 0.0
    fuu = 0.0
    fvv = 0.0
    fww = 0.0
    fvw = 0.0
    fuw = 0.0
    fuv = 0.0
    for i in range(len(k0)):
        a = 0.0
        av = 0.0
        aw = 0.0
        avv = 0.0
        aww = 0.0
        avw = 0.0
        for j in range(len(k1)):
            s = 0.0
            sw = 0.0
            sww = 0.0
            for q in range(len(k2)):
                x = c[m, i0 + i, j0 + j, l0 + q]
                s += b[2, 0, q] * x
                sw += b[2, 1, q] * x
                sww += b[2, 2, q] * x
            a += b[1, 0, j] * s
            av += b[1, 1, j] * s
            avv += b[1, 2, j] * s
            aw += b[1, 0, j] * sw
            avw += b[1, 1, j] * sw
            aww += b[1, 0, j] * sww
        f += b[0, 0, i] * a
        fu += b[0, 1, i] * a
        fuu += b[0, 2, i] * a
        fv += b[0, 0, i] * av
        fuv += b[0, 1, i] * av
        fvv += b[0, 0, i] * avv
        fw += b[0, 0, i] * aw
        fuw += b[0, 1, i] * aw
        fww += b[0, 0, i] * aww
        fvw += b[0, 0, i] * avw
    return f, fu, fv, fw, fuu, fvv, fww, fvw, fuw, fuv


@njit(cache=True, fastmath=FAST, error_model="numpy")
def jet_at(d0, d1, d2, k0, k1, k2, c, u, v, w, order, b, out):
    """Jet of all components at one point: out (M, >= 1, 4 or 10), scratch b (3, 3, >= k+1)."""
    i0 = basis(d0, k0, u, order, b, 0)
    j0 = basis(d1, k1, v, order, b, 1)
    l0 = basis(d2, k2, w, order, b, 2)
    for m in range(c.shape[0]):
        if order == 0:
            out[m, 0] = contract0(c, m, i0, j0, l0, k0, k1, k2, b)
        elif order == 1:
            f, fu, fv, fw = contract1(c, m, i0, j0, l0, k0, k1, k2, b)
            out[m, 0] = f
            out[m, 1] = fu
            out[m, 2] = fv
            out[m, 3] = fw
        else:
            f, fu, fv, fw, fuu, fvv, fww, fvw, fuw, fuv = contract2(c, m, i0, j0, l0, k0, k1, k2, b)
            out[m, 0] = f
            out[m, 1] = fu
            out[m, 2] = fv
            out[m, 3] = fw
            out[m, 4] = fuu
            out[m, 5] = fvv
            out[m, 6] = fww
            out[m, 7] = fvw
            out[m, 8] = fuw
            out[m, 9] = fuv


@njit(cache=True, parallel=True, fastmath=FAST, error_model="numpy")
def values(d0, d1, d2, k0, k1, k2, c, u, out):
    """Values at points u (n, 3) into out (n, M)."""
    n = len(u)
    for chunk in prange((n + CHUNK - 1) // CHUNK):
        b = np.empty((3, 3, max(len(k0), len(k1), len(k2))))
        for p in range(chunk * CHUNK, min(n, (chunk + 1) * CHUNK)):
            i0 = basis(d0, k0, u[p, 0], 0, b, 0)
            j0 = basis(d1, k1, u[p, 1], 0, b, 1)
            l0 = basis(d2, k2, u[p, 2], 0, b, 2)
            for m in range(c.shape[0]):
                out[p, m] = contract0(c, m, i0, j0, l0, k0, k1, k2, b)


@njit(cache=True, parallel=True, fastmath=FAST, error_model="numpy")
def jets1(d0, d1, d2, k0, k1, k2, c, u, f, g):
    """Values and gradients at points u (n, 3) into f (n, M) and g (n, M, 3)."""
    n = len(u)
    for chunk in prange((n + CHUNK - 1) // CHUNK):
        b = np.empty((3, 3, max(len(k0), len(k1), len(k2))))
        for p in range(chunk * CHUNK, min(n, (chunk + 1) * CHUNK)):
            i0 = basis(d0, k0, u[p, 0], 1, b, 0)
            j0 = basis(d1, k1, u[p, 1], 1, b, 1)
            l0 = basis(d2, k2, u[p, 2], 1, b, 2)
            for m in range(c.shape[0]):
                x, xu, xv, xw = contract1(c, m, i0, j0, l0, k0, k1, k2, b)
                f[p, m] = x
                g[p, m, 0] = xu
                g[p, m, 1] = xv
                g[p, m, 2] = xw


@njit(cache=True, parallel=True, fastmath=FAST, error_model="numpy")
def jets2(d0, d1, d2, k0, k1, k2, c, u, f, g, h):
    """Values, gradients and Hessians into f (n, M), g (n, M, 3) and h (n, M, 3, 3)."""
    n = len(u)
    for chunk in prange((n + CHUNK - 1) // CHUNK):
        b = np.empty((3, 3, max(len(k0), len(k1), len(k2))))
        for p in range(chunk * CHUNK, min(n, (chunk + 1) * CHUNK)):
            i0 = basis(d0, k0, u[p, 0], 2, b, 0)
            j0 = basis(d1, k1, u[p, 1], 2, b, 1)
            l0 = basis(d2, k2, u[p, 2], 2, b, 2)
            for m in range(c.shape[0]):
                x, xu, xv, xw, xuu, xvv, xww, xvw, xuw, xuv = contract2(
                    c, m, i0, j0, l0, k0, k1, k2, b
                )
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


@njit(cache=True, fastmath=FAST, error_model="numpy")
def axis_basis(d, deg, x, order):
    """Basis functions at sample sites of one direction: (order+1, k+1, n) and first (n,)."""
    n = len(x)
    b = np.empty((1, 3, len(deg)))
    out = np.empty((order + 1, len(deg), n))
    first = np.empty(n, np.int64)
    for p in range(n):
        first[p] = basis(d, deg, x[p], order, b, 0)
        for o in range(order + 1):
            for j in range(len(deg)):
                out[o, j, p] = b[0, o, j]
    return out, first


@njit(cache=True, fastmath=FAST, error_model="numpy")
def expand_last(c, b, first, out):
    """Contract the last axis: out (n0, n1, nz) from c (n0, n1, n2) and basis b (k+1, nz)."""
    for i in range(c.shape[0]):
        for j in range(c.shape[1]):
            for z in range(b.shape[1]):
                s = 0.0
                for q in range(b.shape[0]):
                    s += b[q, z] * c[i, j, first[z] + q]
                out[i, j, z] = s


@njit(cache=True, fastmath=FAST, error_model="numpy")
def accumulate(out, rows, weights):
    """Write the weighted sum of rows (k+1, nz) into out (nz,), contiguous in z."""
    n = len(out)
    k = len(weights)
    if k == 3:
        w0, w1, w2 = weights[0], weights[1], weights[2]
        for z in range(n):
            out[z] = w0 * rows[0, z] + w1 * rows[1, z] + w2 * rows[2, z]
    elif k == 2:
        w0, w1 = weights[0], weights[1]
        for z in range(n):
            out[z] = w0 * rows[0, z] + w1 * rows[1, z]
    elif k == 4:
        w0, w1, w2, w3 = weights[0], weights[1], weights[2], weights[3]
        for z in range(n):
            out[z] = w0 * rows[0, z] + w1 * rows[1, z] + w2 * rows[2, z] + w3 * rows[3, z]
    else:
        for z in range(n):
            out[z] = 0.0
        for q in range(k):
            for z in range(n):
                out[z] += weights[q] * rows[q, z]


@njit(cache=True, parallel=True, fastmath=FAST, error_model="numpy")
def grid(c, bx, fx, by, fy, bz, fz, out):
    """Values on a tensor grid, one component: out (1, nx, ny, nz); with derivatives (4, ...).

    The last direction is expanded first; then, for each sample row in y, the coefficients
    are contracted along y and x with contiguous inner loops in z.
    """
    order = bx.shape[0] - 1
    ky, kx = by.shape[1], bx.shape[1]
    nx, ny, nz = out.shape[1:]
    n0, n1 = c.shape[0], c.shape[1]
    e = np.empty((order + 1, n0, n1, nz))
    for i in prange(n0):
        for o in range(order + 1):
            expand_last(c[i : i + 1], bz[o], fz, e[o, i : i + 1])
    for y in prange(ny):
        j = fy[y]
        rows = np.empty((1 + 2 * order, n0, nz))
        for i in range(n0):
            accumulate(rows[0, i], e[0, i, j : j + ky], by[0, :, y])
            if order > 0:
                accumulate(rows[1, i], e[0, i, j : j + ky], by[1, :, y])
                accumulate(rows[2, i], e[1, i, j : j + ky], by[0, :, y])
        for x in range(nx):
            i = fx[x]
            accumulate(out[0, x, y], rows[0, i : i + kx], bx[0, :, x])
            if order > 0:
                accumulate(out[1, x, y], rows[0, i : i + kx], bx[1, :, x])
                accumulate(out[2, x, y], rows[1, i : i + kx], bx[0, :, x])
                accumulate(out[3, x, y], rows[2, i : i + kx], bx[0, :, x])
