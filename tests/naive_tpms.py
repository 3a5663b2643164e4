"""Reference implementation of the catalogue: equations in sines and cosines, and slow measures."""

from itertools import permutations, product

import numpy as np
from numpy import cos, sin, sqrt
from scipy.ndimage import label


def _cyclic(term):
    return lambda X, Y, Z: term(X, Y, Z) + term(Y, Z, X) + term(Z, X, Y)


P = _cyclic(lambda X, _Y, _Z: cos(X))
Q = _cyclic(lambda X, Y, _Z: cos(X) * cos(Y))
B = _cyclic(lambda X, _Y, _Z: cos(2 * X))
A = _cyclic(lambda X, Y, _Z: cos(2 * X) * cos(2 * Y))
L = _cyclic(lambda X, Y, Z: sin(2 * X) * cos(Y) * sin(Z))
T1 = _cyclic(lambda X, Y, _Z: sin(2 * X) * sin(Y))
T2 = _cyclic(lambda X, Y, _Z: cos(X) * sin(2 * Y))
W1 = _cyclic(lambda X, Y, _Z: cos(2 * X) * cos(Y))
W2 = _cyclic(lambda X, Y, _Z: cos(X) * cos(2 * Y))
GYROID = _cyclic(lambda X, Y, _Z: cos(X) * sin(Y))


def c(X, Y, Z):
    return cos(X) * cos(Y) * cos(Z)


def s(X, Y, Z):
    return sin(X) * sin(Y) * sin(Z)


EQUATIONS = {
    "gyroid": lambda *a: GYROID(*a),
    "diamond": lambda X, Y, Z: (
        s(X, Y, Z) + cos(X) * sin(Y) * cos(Z) + cos(Y) * sin(Z) * cos(X) + cos(Z) * sin(X) * cos(Y)
    ),
    "primitive": lambda *a: P(*a),
    "iwp": lambda *a: 2 * Q(*a) - B(*a),
    "neovius": lambda *a: 4 * c(*a) + 3 * P(*a),
    "c_y": lambda *a: -s(*a) + T1(*a) - c(*a) + T2(*a),
    "lidinoid": lambda *a: L(*a) - A(*a) + 0.3,
    "octo": lambda *a: 0.6 * Q(*a) - 0.4 * P(*a) + 0.25,
    "frd": lambda X, Y, Z: 8 * c(X, Y, Z) + cos(2 * X) * cos(2 * Y) * cos(2 * Z) - A(X, Y, Z),
    "s": lambda X, Y, Z: (
        cos(2 * X) * sin(Y) * cos(Z) + cos(2 * Y) * sin(Z) * cos(X) + cos(2 * Z) * sin(X) * cos(Y)
    ),
    "p_c_p": lambda X, Y, Z: (
        0.3 * c(X, Y, Z)
        + 0.1 * cos(2 * X) * cos(2 * Y) * cos(2 * Z)
        + 0.2 * P(X, Y, Z)
        + 0.1 * B(X, Y, Z)
        + 0.05 * (cos(3 * X) + cos(3 * Y) + cos(3 * Z))
        + 0.1 * Q(X, Y, Z)
    ),
    "split_p": lambda *a: 1.1 * L(*a) - 0.2 * A(*a) - 0.4 * B(*a),
    "f": lambda *a: c(*a),
    "c_d": lambda X, Y, Z: (
        cos(3 * X + Y) * cos(Z)
        - sin(3 * X - Y) * sin(Z)
        + cos(X + 3 * Y) * cos(Z)
        + sin(X - 3 * Y) * sin(Z)
        + cos(X - Y) * cos(3 * Z)
        - sin(X + Y) * sin(3 * Z)
    ),
    "g_prime": lambda *a: L(*a) + 0.32,
    "g_prime2": lambda *a: 5 * L(*a) + A(*a),
    "d_prime": lambda X, Y, Z: (
        0.5
        * (
            c(X, Y, Z)
            + sin(X) * cos(Y) * sin(Z)
            + sin(Y) * cos(Z) * sin(X)
            + sin(Z) * cos(X) * sin(Y)
        )
        - 0.5 * (sin(2 * X) * sin(2 * Y) + sin(2 * Y) * sin(2 * Z) + sin(2 * Z) * sin(2 * X))
        - 0.2
    ),
    "k": lambda *a: 0.3 * (P(*a) + Q(*a)) - 0.4 * B(*a) + 0.2,
    "c_s": lambda X, Y, Z: (
        B(X, Y, Z)
        + 2
        * (
            sin(2 * X) * cos(Y) * sin(3 * Z)
            + sin(2 * Y) * cos(Z) * sin(3 * X)
            + sin(2 * Z) * cos(X) * sin(3 * Y)
        )
        + 2
        * (
            sin(2 * X) * cos(3 * Y) * sin(Z)
            + sin(2 * Y) * cos(3 * Z) * sin(X)
            + sin(2 * Z) * cos(3 * X) * sin(Y)
        )
    ),
    "y": lambda *a: s(*a) + T2(*a) + c(*a) + T1(*a),
    "pm_y": lambda *a: 2 * c(*a) + T1(*a),
    "c_pm_y": lambda *a: -2 * c(*a) + T1(*a),
    "c_i2y": lambda *a: 2 * L(*a) + A(*a),
    "w": lambda *a: W1(*a) - W2(*a),
    "q_star": lambda X, Y, Z: (
        (cos(X) - 2 * cos(Y)) * cos(Z)
        - sqrt(3.0) * sin(Z) * (cos(X - Y) - cos(X))
        + cos(X - Y) * cos(Z)
    ),
    "c_g": lambda X, Y, Z: (
        3 * (sin(X) * cos(Y) + sin(Y) * cos(Z) + sin(Z) * cos(X))
        + 2 * (sin(3 * X) * cos(Y) + sin(3 * Y) * cos(Z) + sin(3 * Z) * cos(X))
        - 2 * (sin(X) * cos(3 * Y) + sin(Y) * cos(3 * Z) + sin(Z) * cos(3 * X))
    ),
    "slotted_p": lambda *a: -2 * Q(*a) - 2 * B(*a) + W1(*a) - W2(*a),
    "double_gyroid": lambda *a: 2.75 * L(*a) - A(*a) - 0.95,
    "i2y": lambda *a: -2 * L(*a) + A(*a),
    "double_primitive": lambda *a: 0.5 * Q(*a) + 0.2 * B(*a),
    "double_diamond": lambda *a: -Q(*a) - s(*a),
    "bcc": lambda *a: Q(*a),
    "p_j": lambda *a: P(*a) + 4 * c(*a),
    "d_fischer": lambda X, Y, Z: cos(X - Y) * cos(Z) + sin(X + Y) * sin(Z),
    "frd_vs": lambda *a: 4 * c(*a) - A(*a),
    "tubular_gyroid": lambda *a: 10 * GYROID(*a) - 2 * A(*a) - 12,
    "tubular_gyroid_ab": lambda *a: 20 * GYROID(*a) - 0.5 * A(*a) - 4,
    "honeycomb_gyroid": lambda X, Y, _Z: sin(X) * cos(Y) + sin(Y) + cos(X),
    "honeycomb_primitive": lambda X, Y, _Z: cos(X) + cos(Y),
    "honeycomb_diamond": lambda X, Y, _Z: (
        cos(X) * cos(Y) + sin(X) * sin(Y) + sin(X) * cos(Y) + cos(X) * sin(Y)
    ),
    "honeycomb_iwp": lambda X, Y, _Z: cos(X) * cos(Y) + cos(X) + cos(Y),
    "honeycomb_lidinoid": lambda X, Y, _Z: (
        1.1 * (sin(2 * X) * cos(Y) + sin(2 * Y) * sin(X) + cos(X) * sin(Y))
        - (cos(2 * X) * cos(2 * Y) + cos(2 * X) + cos(2 * Y))
    ),
}


def value(name, p):
    """Value of an equation at points (n, 3), real or complex."""
    return EQUATIONS[name](*(2 * np.pi * np.asarray(p).T))


def gradient(name, p):
    """Gradient by complex steps, exact to rounding."""
    steps = 1e-30j * np.eye(3)
    return np.stack([value(name, p + e).imag / 1e-30 for e in steps], axis=1)


# -------------------------------------------------------------------------------- measures


def samples(n, cells=1):
    """Coordinates of n samples per cell, off every mirror plane."""
    return (np.arange(n * cells) + 0.37) / n


def symmetry(f):
    """(order, order with sign, translations, balanced) by trying all operations of the cube."""
    p = np.random.default_rng(1).random((6, 3))
    v = f(p)
    tol = 1e-9 * np.abs(f(np.random.default_rng(2).random((200, 3)))).max()
    shifts = np.array(list(product(range(8), repeat=3))) / 8
    plus, minus, translations = set(), set(), 0
    for i, (perm, signs) in enumerate(product(permutations(range(3)), product((1, -1), repeat=3))):
        q = (p[:, perm] * signs)[None] + shifts[:, None]
        w = f(q.reshape(-1, 3)).reshape(len(shifts), -1)
        same = (np.abs(w - v) < tol).all(axis=1)
        if same.any():
            plus.add(i)
        if (np.abs(w + v) < tol).all(axis=1).any():
            minus.add(i)
        if perm == (0, 1, 2) and signs == (1, 1, 1):
            translations = int(same.sum())
    return len(plus), len(plus | minus), translations, bool(minus)


def surface_euler(inside):
    """Euler number of the boundary of a periodic voxel set, as a complex of Freudenthal simplices.

    All simplices whose corners are inside are counted by their least corner.
    """
    corners = list(product((0, 1), repeat=3))
    at = {o: np.roll(inside, [-i for i in o], (0, 1, 2)) for o in corners}

    def count(mask, last, sign):
        total = sign * int(mask.sum())
        for o in corners:
            if o != last and all(i <= j for i, j in zip(last, o, strict=True)):
                total += count(mask & at[o], o, -sign)
        return total

    return 2 * count(inside, (0, 0, 0), 1)


def components(inside):
    """Number of connected pieces of a periodic voxel set."""
    labels, n = label(inside)
    parent = list(range(n + 1))

    def find(i):
        while parent[i] != i:
            i = parent[i]
        return i

    for axis in range(3):
        first, last = np.take(labels, 0, axis).ravel(), np.take(labels, -1, axis).ravel()
        for a, b in {(int(a), int(b)) for a, b in zip(first, last, strict=True) if a and b}:
            parent[find(a)] = find(b)
    return len({find(i) for i in range(1, n + 1)})
