"""Reference implementations: slow, obvious versions of what the kernels compute."""

from itertools import product

import numpy as np

# ------------------------------------------------------------------------------- B-splines


def basis(t, k, i, x):
    """Cox-de Boor recursion: value of basis function i of degree k at the number x.

    Half-open spans; the right end of the domain belongs to the last nonempty span.
    """
    if k == 0:
        return 1.0 if t[i] <= x < t[i + 1] else 0.0
    out = 0.0
    if t[i + k] > t[i]:
        out += (x - t[i]) / (t[i + k] - t[i]) * basis(t, k - 1, i, x)
    if t[i + k + 1] > t[i + 1]:
        out += (t[i + k + 1] - x) / (t[i + k + 1] - t[i + 1]) * basis(t, k - 1, i + 1, x)
    return out


def basis_row(t, k, x, nu=0):
    """All basis functions, or their nu-th derivatives, at the number x, shape (n,)."""
    n = len(t) - k - 1
    if nu:
        lower = basis_row(t[1:-1], k - 1, x, nu - 1) if k else np.zeros(n - 1)
        out = np.zeros(n)
        for i in range(n):
            if i > 0 and t[i + k] > t[i]:
                out[i] += k / (t[i + k] - t[i]) * lower[i - 1]
            if i < n - 1 and t[i + k + 1] > t[i + 1]:
                out[i] -= k / (t[i + k + 1] - t[i + 1]) * lower[i]
        return out
    if x >= t[n]:  # mirror the spline: its right end becomes a left end
        mirrored = -np.asarray(t)[::-1]
        left = mirrored[k]
        if not any(mirrored[i] <= left < mirrored[i + 1] for i in range(len(t) - 1)):
            raise ValueError("no span at the right end")
        return np.array([basis(mirrored, k, n - 1 - i, left) for i in range(n)])
    return np.array([basis(t, k, i, x) for i in range(n)])


def evaluate(t, c, k, u, nu=None):
    """Tensor-product spline, or a derivative, at one point u: sum over all coefficients."""
    nu = nu or (0,) * len(t)
    rows = [basis_row(*args) for args in zip(t, k, u, nu, strict=True)]
    out = 0.0
    for index in product(*(range(len(r)) for r in rows)):
        out = out + np.prod([r[i] for r, i in zip(rows, index, strict=True)]) * c[index]
    return out


def evaluate_rational(t, c, k, weights, u, nu=None):
    """Rational spline by the quotient rule, derivatives up to order 2 in total."""
    nd = len(t)
    nu = tuple(nu or (0,) * nd)
    spread = weights.reshape(weights.shape + (1,) * (c.ndim - nd))

    def a(d):
        return evaluate(t, c * spread, k, u, d)

    def w(d):
        return evaluate(t, weights, k, u, d)

    zero = (0,) * nd
    x = a(zero) / w(zero)
    ones = [i for i in range(nd) for _ in range(nu[i])]
    if not ones:
        return x
    unit = [tuple(int(i == j) for j in range(nd)) for i in ones]
    first = [(a(e) - w(e) * x) / w(zero) for e in unit]
    if len(ones) == 1:
        return first[0]
    return (a(nu) - w(unit[0]) * first[1] - w(unit[1]) * first[0] - w(nu) * x) / w(zero)


def de_casteljau(b, s):
    """Bernstein polynomial with coefficients b (k+1, ...) at the number s in [0, 1]."""
    b = np.array(b, float)
    while len(b) > 1:
        b = (1 - s) * b[:-1] + s * b[1:]
    return b[0]


def insert_knot(t, c, k, x):
    """Boehm's algorithm: one knot into a curve, new knots and coefficients."""
    j = max(i for i in range(k, len(c)) if t[i] <= x and t[i] < t[len(c)])
    new = []
    for i in range(len(c) + 1):
        if i <= j - k:
            new.append(c[i])
        elif i > j:
            new.append(c[i - 1])
        else:
            s = (x - t[i]) / (t[i + k] - t[i])
            new.append((1 - s) * c[i - 1] + s * c[i])
    return np.sort(np.append(t, x)), np.array(new)


def lspia(matrices, values, steps):
    """Iterates of least-squares progressive-iterative approximation, from dense matrices.

    c <- c + sum_m B(x_m) delta_m / sum_m B(x_m), one entry at a time.
    """
    full = matrices[0]
    for a in matrices[1:]:
        full = np.kron(full, a)
    f = np.ravel(values)
    c = np.zeros(full.shape[1])
    out = []
    for _ in range(steps):
        delta = f - full @ c
        c = np.array([c[h] + full[:, h] @ delta / full[:, h].sum() for h in range(full.shape[1])])
        out.append(c.reshape([a.shape[1] for a in matrices]))
    return out
