"""Bernstein polynomials of det J on Bézier elements: products, elevation, halving.

Arrays hold a batch of polynomials, their three coefficient axes last. "Scaled" coefficients are
multiplied by the binomials of their index: there, the product of polynomials is a convolution.

Guarantee: every coefficient is a sum of convex combinations of products of control-net
differences, so differences that vanish exactly give zeros that are exact; no system is solved.
"""

from functools import cache
from math import comb

import numpy as np

from ilattice._typing import FloatArray
from ilattice._validate import read_only
from ilattice.bspline.bezier import bernstein


@cache
def binomials(shape: tuple[int, int, int]) -> FloatArray:
    """Products of the binomials of each axis, for degrees ``shape - 1``."""
    rows = [np.array([comb(n - 1, i) for i in range(n)], dtype=float) for n in shape]
    return read_only(np.einsum("i,j,k->ijk", *rows))


def scaled(c: FloatArray) -> FloatArray:
    """Scaled from plain coefficients."""
    i, j, k = c.shape[-3:]
    return c * binomials((i, j, k))


def plain(c: FloatArray) -> FloatArray:
    """Plain from scaled coefficients."""
    i, j, k = c.shape[-3:]
    return c / binomials((i, j, k))


def product(a: FloatArray, b: FloatArray) -> FloatArray:
    """Product of two batches of scaled polynomials; leading axes are broadcast."""
    if np.prod(a.shape[-3:]) > np.prod(b.shape[-3:]):
        a, b = b, a
    ni, nj, nk = b.shape[-3:]
    lead = np.broadcast_shapes(a.shape[:-3], b.shape[:-3])
    size = [p + q - 1 for p, q in zip(a.shape[-3:], b.shape[-3:], strict=True)]
    out = np.zeros((*lead, *size))
    for i, j, k in np.ndindex(*a.shape[-3:]):
        out[..., i : i + ni, j : j + nj, k : k + nk] += a[..., i, j, k, None, None, None] * b
    return out


def difference(c: FloatArray, axis: int) -> FloatArray:
    """Plain coefficients of the derivative along one of the last three axes."""
    return np.diff(c, axis=axis - 3) * (c.shape[axis - 3] - 1)


def determinant(x: FloatArray) -> FloatArray:
    """Plain coefficients of det J, degree 3p - 1, from control points (E, 3, i, j, k)."""
    a, b, c = (scaled(difference(x, axis)) for axis in range(3))
    one, two = [1, 2, 0], [2, 0, 1]
    cross = product(b[:, one], c[:, two]) - product(b[:, two], c[:, one])
    return plain(product(a, cross).sum(axis=1))


def homogeneous_determinant(p: FloatArray) -> FloatArray:
    """Scaled coefficients of w⁴ det J, degree 4p - 1.

    The control points (E, 4, i, j, k) hold the weight first, then the weighted coordinates:
    w⁴ det J is the determinant of the rows P, ∂P/∂u, ∂P/∂v, ∂P/∂w, developed here by the
    second-order minors of the first two and the last two rows.
    """
    rows = [scaled(p), *(scaled(difference(p, axis)) for axis in range(3))]
    first, second = [0, 0, 0, 1, 1, 2], [1, 2, 3, 2, 3, 3]

    def minors(a: FloatArray, b: FloatArray) -> FloatArray:
        return product(a[:, first], b[:, second]) - product(a[:, second], b[:, first])

    sign = np.array([1.0, -1, 1, 1, -1, 1])[:, None, None, None]
    upper, lower = minors(rows[0], rows[1]), minors(rows[2], rows[3])
    return product(sign * upper, lower[:, ::-1]).sum(axis=1)


def fourth_power(w: FloatArray) -> FloatArray:
    """Scaled coefficients of w⁴ from the plain coefficients (E, i, j, k) of w."""
    square = product(scaled(w), scaled(w))
    return product(square, square)


def elevated(c: FloatArray) -> FloatArray:
    """Scaled coefficients of the same polynomial with each degree raised by one."""
    return product(np.ones((1, 2, 2, 2)), c)


@cache
def _half(n: int) -> FloatArray:
    """De Casteljau at 1/2: rows are the coefficients of the left and the right half."""
    left = np.array([[comb(i, j) * 0.5**i if j <= i else 0.0 for j in range(n)] for i in range(n)])
    return read_only(np.stack([left, left[::-1, ::-1]]))


def halves(c: FloatArray) -> FloatArray:
    """Plain coefficients on the eight halves of each element, (8 E, i, j, k).

    Children of an element follow each other, the half of the last direction fastest.
    """
    ni, nj, nk = c.shape[-3:]
    c = np.einsum("xai,eijk->exajk", _half(ni), c, optimize=True)
    c = np.einsum("ybj,exajk->exyabk", _half(nj), c, optimize=True)
    c = np.einsum("zck,exyabk->exyzabc", _half(nk), c, optimize=True)
    return np.ascontiguousarray(c.reshape(-1, ni, nj, nk))


def sampled(c: FloatArray, sites: tuple[int, int, int]) -> FloatArray:
    """Values of plain polynomials on a grid of each element, ends included."""
    ni, nj, nk = c.shape[-3:]
    rows = [
        bernstein(n - 1, np.linspace(0.0, 1.0, s)) for n, s in zip((ni, nj, nk), sites, strict=True)
    ]
    return np.einsum("...ijk,ai,bj,ck->...abc", c, *rows, optimize=True)
