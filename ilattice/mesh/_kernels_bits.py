"""Bits of integers in compiled code, in one machine instruction each.

Guarantee: the same results where compilation is off (``NUMBA_DISABLE_JIT``).
Non-guarantee: arguments are not checked.
"""

from llvmlite import ir
from numba import types

from ilattice.bspline._kernels_vector import BIT, operation


@operation(lambda x: int(x).bit_count())
def popcount(typing, x):
    """Number of set bits of a non-negative integer."""
    return types.int64(types.int64), lambda _c, builder, _s, arguments: builder.ctpop(*arguments)


@operation(lambda x: (int(x) & -int(x)).bit_length() - 1)
def lowest(typing, x):
    """Index of the lowest set bit of a positive integer."""
    never_zero = ir.Constant(BIT, 1)
    return types.int64(types.int64), lambda _c, builder, _s, arguments: builder.cttz(
        *arguments, never_zero
    )
