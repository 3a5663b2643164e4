"""Two sheets of one polynomial, such as two planes that are close together.

A polynomial that is quadratic along a direction, with a discriminant that is certainly positive,
has two simple roots on every line: they depend smoothly on the line, and no box must be as small as
what is between them for its columns to be exact.

Guarantee: the sign of the discriminant is that of its Bernstein coefficients, not of samples.
"""

from typing import Any

from ilattice._kernels import inner
from ilattice.bspline._kernels_bernstein import extremes
from ilattice.quadrature._kernels_scratch import PLANES

#: Part of its largest value that the discriminant must have everywhere; third differences up to
#: this many times the noise of coefficients are none.
EVEN, CUBIC = 0.9, 1e2
#: Part of the square of the largest coefficient below which it is rounding.
FLAT = 1e-10


@inner(error_model="numpy")
def quadratic_lines(
    Z: Any, at: int, step: int, other: int, third: int, n: int, eps: float, L: Any
) -> bool:
    """Whether lines along a direction are quadratic: their coefficients from `PLANES` on.

    Strides as of `slopes`; line (i, j) has three coefficients at PLANES + (i n + j) 3.
    """
    P = len(L)
    if P < 3:
        return False
    for i in range(P):
        for j in range(n):
            c = at + i * other + j * third
            for k in range(P - 3):
                d = Z[c + (k + 3) * step] - Z[c + k * step]
                d += 3.0 * (Z[c + (k + 1) * step] - Z[c + (k + 2) * step])
                if abs(d) > CUBIC * eps:
                    return False
            to = PLANES + (i * n + j) * 3
            Z[to] = Z[c]
            Z[to + 1] = Z[c] + 0.5 * (P - 1) * (Z[c + step] - Z[c])
            Z[to + 2] = Z[c + (P - 1) * step]
    return True


@inner(error_model="numpy")
def binomial(n: int, k: int) -> float:
    """n over k."""
    out = 1.0
    for i in range(k):
        out = out * (n - i) / (i + 1)
    return out


@inner(error_model="numpy")
def discriminant(Z: Any, n: int, L: Any) -> float:
    """Least value of the discriminant of lines at `PLANES`, or 0 if it is not positive and even."""
    P = len(L)
    p = P - 1
    q = n - 1
    least = 0.0
    most = 0.0
    for a in range(2 * p + 1):
        for b in range(2 * q + 1):
            value = 0.0
            for i in range(max(0, a - p), min(a, p) + 1):
                wi = binomial(p, i) * binomial(p, a - i)
                for j in range(max(0, b - q), min(b, q) + 1):
                    f = PLANES + (i * n + j) * 3
                    g = PLANES + ((a - i) * n + b - j) * 3
                    d = Z[f + 1] * Z[g + 1] - 0.5 * (Z[f] * Z[g + 2] + Z[g] * Z[f + 2])
                    value += wi * binomial(q, j) * binomial(q, b - j) * d
            value /= binomial(2 * p, a) * binomial(2 * q, b)
            if a == 0 and b == 0:
                least = value
                most = value
            least = min(least, value)
            most = max(most, value)
    low, high = extremes(Z, PLANES, 3 * P * n)
    top = max(-low, high)
    return least if least > FLAT * top * top and least > EVEN * most else 0.0


@inner(error_model="numpy")
def pair_axis(Z: Any, at: int, eps: float, L: Any) -> int:
    """Direction along which a tensor has two well parted roots on every line, or -1."""
    P = len(L)
    best = -1
    most = 0.0
    for axis in range(3):
        step = P ** (2 - axis)
        if quadratic_lines(Z, at, step, P * P if axis else P, 1 if axis < 2 else P, P, eps, L):
            least = discriminant(Z, P, L)
            if least > most:
                best = axis
                most = least
    return best


@inner(error_model="numpy")
def has_pairs(Z: Any, at: int, along: int, eps: float, L: Any) -> bool:
    """Whether a tensor in two variables has such roots along one of them."""
    P = len(L)
    step = P if along == 0 else 1
    return quadratic_lines(Z, at, step, P + 1 - step, 0, 1, eps, L) and discriminant(Z, 1, L) > 0.0
