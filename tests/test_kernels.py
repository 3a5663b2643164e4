"""Kernels over ranges, and kernels that only kernels call."""

import numba
import numpy as np
import pytest

from ilattice._kernels import in_ranges, inner


@inner(error_model="numpy")
def power(x, n):
    return x**n


@in_ranges(3)
@numba.njit(nogil=True)
def count(first, last, out):
    for i in range(first, last):
        out[i] += power(i, 2) + power(i, 3)


@pytest.mark.parametrize("n", [0, 1, 3, 4, 100])
@pytest.mark.parametrize("threads", [1, 2])
def test_every_item_is_treated_once(n, threads):
    before, out = numba.get_num_threads(), np.zeros(n, np.int64)
    numba.set_num_threads(min(threads, before))
    try:
        count(n, out)
    finally:
        numba.set_num_threads(before)
    assert out.tolist() == [i**2 + i**3 for i in range(n)]


def test_errors_of_ranges_are_raised():
    @in_ranges(2)
    def kernel(first, last):
        if last > 6:
            raise ValueError(f"{first} to {last}")

    kernel(6)
    with pytest.raises(ValueError, match=r"\d+ to \d+"):
        kernel(11)


def test_inner_kernels_take_constants_as_numbers_and_calls_from_python():
    assert power(3, 4) == 81
    assert {args[1] for args in getattr(power, "overloads", {})} <= {numba.int64}
