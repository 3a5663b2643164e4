"""Vectors of four numbers against NumPy."""

import numba
import numpy as np
import pytest

from ilattice.bspline._kernels_vector import dot, load, multiply_add, scale, spread, store

A = np.arange(1.0, 13.0).reshape(3, 4)


@numba.njit
def copy(a, at, count, out, to):
    store(out, to, load(a, at, count))


@numba.njit
def combine(a, b, s, t, out):
    x, y = load(a, 0, 4), load(b, 0, 4)
    store(out, 0, multiply_add(x, s, y))
    store(out, 4, scale(x, t))
    store(out, 8, spread(s))
    return dot(x, y)


@pytest.mark.parametrize("count", range(7))
def test_loads_end_where_they_are_told_to(count):
    out = np.full((2, 5), -1.0)
    copy(A, 6, count, out, 3)
    wanted = np.full(10, -1.0)
    wanted[3:7] = [7, 8, 9, 10][:count] + [0] * (4 - count)
    assert out.ravel().tolist() == wanted.tolist()


def test_arithmetic():
    x, y = np.array([1.0, -2.0, 0.5, 3.0]), np.array([2.0, 4.0, -8.0, 1.0])
    out = np.empty(12)
    assert combine(x, y, 3.0, -2.0, out) == x @ y
    assert out[:4].tolist() == (3 * x + y).tolist()
    assert out[4:8].tolist() == (-2 * x).tolist()
    assert out[8:].tolist() == [3.0] * 4
