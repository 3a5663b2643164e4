"""Vectors of four float64 for compiled code.

LLVM does not turn the short sums of a B-spline (3 terms at degree 2) into vector instructions
by itself; these operations do it by name. A vector lives in one register, or two on machines
with shorter ones, and is made by `load` or `spread`. Nothing here depends on the machine.

Guarantee: `load` touches no memory beyond the entries it is told to read.
Non-guarantees: positions are not checked. Where compilation is off (``NUMBA_DISABLE_JIT``),
vectors are NumPy arrays, and results may differ in the last bits.
"""

import numpy as np
from llvmlite import ir
from numba import config, types
from numba.core import cgutils
from numba.extending import intrinsic, models, register_model

#: Doubles in a register of AVX2.
LANES = 4
DOUBLE, INDEX, BIT = ir.DoubleType(), ir.IntType(64), ir.IntType(1)
VECTOR = ir.VectorType(DOUBLE, LANES)
CONTRACT = ("contract",)


class Vector(types.Type):
    """Numba's type of a vector."""

    def __init__(self):
        super().__init__(name=f"Vector{LANES}")


@register_model(Vector)
class VectorModel(models.PrimitiveModel):
    """A vector is one LLVM value."""

    def __init__(self, manager, kind):
        super().__init__(manager, kind, VECTOR)


vector = Vector()


def operation(plain):
    """Decorate an intrinsic: `plain` does the same to NumPy arrays, where nothing is compiled."""
    return lambda compiled: plain if config.DISABLE_JIT else intrinsic(compiled)


def repeat(builder, x):
    """LLVM vector with the scalar x in every lane."""
    kind = ir.VectorType(x.type, LANES)
    first = builder.insert_element(ir.Constant(kind, ir.Undefined), x, INDEX(0))
    zeros = ir.Constant(ir.VectorType(ir.IntType(32), LANES), [0] * LANES)
    return builder.shuffle_vector(first, first, zeros)


def address(context, builder, kind, array, at):
    """Pointer to the vector that starts at a position of a contiguous array."""
    data = context.make_array(kind)(context, builder, array).data
    return builder.bitcast(builder.gep(data, [at]), VECTOR.as_pointer())


def plain_load(a, at, count):
    """See `load`."""
    out = np.zeros(LANES)
    out[: min(count, LANES)] = a.reshape(-1)[at : at + min(count, LANES)]
    return out


def plain_store(a, at, x):
    """See `store`."""
    a.reshape(-1)[at : at + LANES] = x


@operation(plain_load)
def load(typing, a, at, count):
    """Up to four entries of a C-contiguous array from flat position `at` on, then zeros."""

    def generate(context, builder, signature, arguments):
        pointer = address(context, builder, signature.args[0], *arguments[:2])
        lanes = ir.Constant(ir.VectorType(INDEX, LANES), list(range(LANES)))
        mask = builder.icmp_signed("<", lanes, repeat(builder, arguments[2]))
        kind = ir.FunctionType(VECTOR, [pointer.type, ir.IntType(32), mask.type, VECTOR])
        call = cgutils.get_or_insert_function(builder.module, kind, "llvm.masked.load.v4f64.p0")
        zeros = ir.Constant(VECTOR, [0.0] * LANES)
        return builder.call(call, [pointer, ir.IntType(32)(8), mask, zeros])

    return vector(a, types.int64, types.int64), generate


@operation(plain_store)
def store(typing, a, at, x):
    """Write a vector to flat position `at` of a C-contiguous array."""

    def generate(context, builder, signature, arguments):
        pointer = address(context, builder, signature.args[0], *arguments[:2])
        builder.store(arguments[2], pointer, align=8)
        return context.get_dummy_value()

    return types.void(a, types.int64, x), generate


@operation(lambda x: np.full(LANES, x))
def spread(typing, x):
    """Vector with the number x in every lane."""
    return vector(types.float64), lambda _c, builder, _s, arguments: repeat(builder, arguments[0])


@operation(lambda x, a: x * a)
def scale(typing, x, a):
    """Vector times number."""

    def generate(context, builder, signature, arguments):
        return builder.fmul(arguments[0], repeat(builder, arguments[1]), flags=CONTRACT)

    return vector(x, types.float64), generate


@operation(lambda x, a, y: x * a + y)
def multiply_add(typing, x, a, y):
    """Vector times number plus vector."""

    def generate(context, builder, signature, arguments):
        product = builder.fmul(arguments[0], repeat(builder, arguments[1]), flags=CONTRACT)
        return builder.fadd(product, arguments[2], flags=CONTRACT)

    return vector(x, types.float64, y), generate


@operation(lambda x, y: float(np.dot(x, y)))
def dot(typing, x, y):
    """Scalar product of two vectors."""

    def generate(context, builder, signature, arguments):
        kind = ir.FunctionType(DOUBLE, [DOUBLE, VECTOR])
        total = cgutils.get_or_insert_function(
            builder.module, kind, "llvm.vector.reduce.fadd.v4f64"
        )
        product = builder.fmul(*arguments)
        return builder.call(total, [DOUBLE(-0.0), product], fastmath=("reassoc",))

    return types.float64(x, y), generate
