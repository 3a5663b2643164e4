"""Rows of matrices of small blocks, times one vector or eight, and small blocks times each other.

LLVM keeps short sums as they stand, number after number; here they are written as the vector
instructions that processors have: entries of a block side by side for one vector; numbers of the
eight vectors side by side where there are more, so that each entry of a matrix is read and repeated
once for all; rows of blocks where both factors are blocks.

Guarantees: sums are in the order of the blocks of a row, with the same bits wherever the row is;
nothing beyond blocks and vectors is read. Non-guarantees: arrays must be C-contiguous, which is
checked as calls are compiled; positions are not checked.
"""

from typing import Any

import numpy as np
from llvmlite import ir
from numba import config, types
from numba.core import cgutils, errors
from numba.extending import intrinsic

#: Vectors side by side; entries of a block in an instruction, that of AVX2 in single precision.
LANES, WIDTH = 8, 8
_config: Any = config
INDEX, SHORT = ir.IntType(64), ir.IntType(32)
CONTRACT = ("contract",)
_tools: Any = cgutils


class _Maker:
    """Writes the loop over the blocks of a row, or of a column where `transposed`."""

    def __init__(self, builder: Any, real: Any, m: int, p: int, transposed: bool) -> None:
        self.builder, self.real, self.m, self.p, self.transposed = builder, real, m, p, transposed
        self.bytes = 4 if isinstance(real, ir.FloatType) else 8

    @property
    def given(self) -> int:
        """Numbers of the vector that meet a block; the others are sums."""
        return self.m if self.transposed else self.p

    @property
    def sums(self) -> int:
        """Numbers that come out of it."""
        return self.p if self.transposed else self.m

    def load(self, data: Any, at: Any, width: int) -> Any:
        """Numbers of an array from a position on, as a vector."""
        kind = ir.VectorType(self.real, width)
        pointer = self.builder.bitcast(self.builder.gep(data, [at]), kind.as_pointer())
        return self.builder.load(pointer, align=self.bytes)

    def zeros(self, width: int) -> Any:
        """A place in registers for sums."""
        kind = ir.VectorType(self.real, width)
        place = _tools.alloca_once(self.builder, kind)
        self.builder.store(ir.Constant(kind, [0.0] * width), place)
        return place

    def add(self, place: Any, a: Any, b: Any) -> None:
        """Add the products of two vectors."""
        product = self.builder.fmul(a, b, flags=CONTRACT)
        total = self.builder.fadd(self.builder.load(place), product, flags=CONTRACT)
        self.builder.store(total, place)


class _One(_Maker):
    """Of one vector: a register holds entries of a block as they lie in memory."""

    def begin(self) -> None:
        """Sums are zero."""
        size = self.m * self.p
        self.widths = [min(WIDTH, size - at) for at in range(0, size, WIDTH)]
        self.places = [self.zeros(width) for width in self.widths]

    def step(self, blocks: Any, block: Any, x: Any, node: Any) -> None:
        """Add the products of a block."""
        given = self.load(x, self.builder.mul(node, INDEX(self.given)), self.given)
        for i, (width, place) in enumerate(zip(self.widths, self.places, strict=True)):
            entries = [WIDTH * i + lane for lane in range(width)]
            which = [e // self.p if self.transposed else e % self.p for e in entries]
            mask = ir.Constant(ir.VectorType(SHORT, width), which)
            there = self.builder.add(block, INDEX(WIDTH * i))
            repeated = self.builder.shuffle_vector(given, given, mask)
            self.add(place, self.load(blocks, there, width), repeated)

    def end(self, out: Any, at: Any) -> None:
        """Write sums of entries that belong together."""
        registers = [self.builder.load(place) for place in self.places]
        for a in range(self.sums):
            of = range(a, self.m * self.p, self.p) if self.transposed else (
                range(a * self.p, (a + 1) * self.p)
            )  # fmt: skip
            parts = [
                self.builder.extract_element(registers[e // WIDTH], SHORT(e % WIDTH)) for e in of
            ]
            total = parts[0]
            for part in parts[1:]:
                total = self.builder.fadd(total, part)
            there = self.builder.add(at, INDEX(a))
            self.builder.store(total, self.builder.gep(out, [there]))


class _Eight(_Maker):
    """Of eight vectors side by side: a register holds a number of each."""

    def begin(self) -> None:
        """Sums are zero."""
        self.places = [self.zeros(LANES) for _ in range(self.sums)]

    def step(self, blocks: Any, block: Any, x: Any, node: Any) -> None:
        """Add the products of a block."""
        none = ir.Constant(ir.VectorType(self.real, LANES), ir.Undefined)
        mask = ir.Constant(ir.VectorType(SHORT, LANES), [0] * LANES)
        first = self.builder.mul(node, INDEX(LANES * self.given))
        for g in range(self.given):
            given = self.load(x, self.builder.add(first, INDEX(LANES * g)), LANES)
            for a, place in enumerate(self.places):
                e = g * self.p + a if self.transposed else a * self.p + g
                pointer = self.builder.gep(blocks, [self.builder.add(block, INDEX(e))])
                entry = self.builder.insert_element(none, self.builder.load(pointer), SHORT(0))
                self.add(place, self.builder.shuffle_vector(entry, none, mask), given)

    def end(self, out: Any, at: Any) -> None:
        """Write sums side by side."""
        for a, place in enumerate(self.places):
            there = self.builder.mul(self.builder.add(at, INDEX(a)), INDEX(LANES))
            pointer = self.builder.bitcast(
                self.builder.gep(out, [there]), ir.VectorType(self.real, LANES).as_pointer()
            )
            self.builder.store(self.builder.load(place), pointer, align=self.bytes)


def _generate(kind: type[_One] | type[_Eight], transposed: bool) -> Any:
    """Typing and code of an operation."""

    def typed(typing: Any, first: Any, last: Any, nodes: Any, which: Any, blocks: Any, x: Any,
              M: Any, P: Any, out: Any, at: Any) -> Any:  # fmt: skip
        for a in (nodes, which, blocks, x, out):
            if a.layout != "C":
                raise errors.TypingError("rows are of arrays that are C-contiguous")
        index = types.int64
        signature = types.void(index, index, nodes, which, blocks, x, M, P, out, index)
        return signature, generate

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        arrays = {"nodes": 2, "which": 3, "blocks": 4, "x": 5, "out": 8}
        data = {
            name: context.make_array(signature.args[i])(context, builder, arguments[i]).data
            for name, i in arrays.items()
        }
        m, p = (len(signature.args[i]) for i in (6, 7))
        real = context.get_value_type(signature.args[arrays["blocks"]].dtype)
        maker = kind(builder, real, m, p, transposed)
        maker.begin()
        with _tools.for_range_slice(builder, *arguments[:2], INDEX(1)) as (k, _):
            node, block = (_entry(builder, data[name], k) for name in ("nodes", "which"))
            block = block if transposed else k
            maker.step(data["blocks"], builder.mul(block, INDEX(m * p)), data["x"], node)
        maker.end(data["out"], arguments[9])
        return context.get_dummy_value()

    return typed


def _entry(builder: Any, data: Any, k: Any) -> Any:
    """A whole number of an array, 64 bits long."""
    value = builder.load(builder.gep(data, [k]))
    return value if value.type == INDEX else builder.sext(value, INDEX)


def _operation(kind: type[_One] | type[_Eight], transposed: bool) -> Any:
    """One of the operations, by NumPy where nothing is compiled."""
    lanes = LANES if kind is _Eight else 1

    def plain(first: int, last: int, nodes: Any, which: Any, blocks: Any, x: Any, M: Any,
              P: Any, out: Any, at: int) -> None:  # fmt: skip
        m, p = len(M), len(P)
        total = np.zeros((p if transposed else m, lanes), x.dtype)
        given = x.reshape(-1, m if transposed else p, lanes)
        for k in range(first, last):
            B = blocks[which[k]].T if transposed else blocks[k]
            total += B @ given[nodes[k]]
        out.reshape(-1, lanes)[at : at + len(total)] = total

    return plain if _config.DISABLE_JIT else intrinsic(_generate(kind, transposed))


#: Sums over blocks first to last - 1, of which the k-th meets node nodes[k] of x: of a row,
#: ``out[at + a] = sum_k sum_b blocks[k, a, b] x[p nodes[k] + b]``; of a column,
#: ``out[at + b] = sum_k sum_a blocks[which[k], a, b] x[m nodes[k] + a]``. Sizes m, p are lengths
#: of the tuples M and P. Rows do not look at `which`. `x` and `out` have eight numbers side by side
#: instead of one in `row_of_eight` and `column_of_eight`.
row: Any = _operation(_One, False)
column: Any = _operation(_One, True)
row_of_eight: Any = _operation(_Eight, False)
column_of_eight: Any = _operation(_Eight, True)


def _product_of_blocks(transposed: bool) -> Any:
    """See `add_product`."""

    def plain(C: Any, at: int, A: Any, k: int, B: Any, e: int, rows: Any, inner: Any,
              columns: Any) -> None:  # fmt: skip
        C[at] += (A[k].T if transposed else A[k]) @ B[e]

    def typed(typing: Any, C: Any, at: Any, A: Any, k: Any, B: Any, e: Any, rows: Any, inner: Any,
              columns: Any) -> Any:  # fmt: skip
        if any(a.layout != "C" for a in (C, A, B)):
            raise errors.TypingError("blocks are of arrays that are C-contiguous")
        index = types.int64
        return types.void(C, index, A, index, B, index, rows, inner, columns), generate

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        kinds = signature.args
        m, n, p = (len(kinds[i]) for i in (6, 7, 8))
        arrays = [
            context.make_array(kinds[i])(context, builder, arguments[i]).data for i in (0, 2, 4)
        ]
        sizes = (m * p, m * n, n * p)
        C, A, B = (
            builder.gep(data, [builder.mul(arguments[i], INDEX(size))])
            for data, i, size in zip(arrays, (1, 3, 5), sizes, strict=True)
        )
        kind = kinds[0].dtype
        given = [_row_of(context, builder, B, c, p, kinds[4].dtype, kind) for c in range(n)]
        none = ir.Constant(given[0].type, ir.Undefined)
        mask = ir.Constant(ir.VectorType(SHORT, p), [0] * p)
        for a in range(m):
            total = _row_of(context, builder, C, a, p, kind, kind)
            for c, other in enumerate(given):
                entry = builder.load(
                    builder.gep(A, [INDEX(c * m + a if transposed else a * n + c)])
                )
                entry = context.cast(builder, entry, kinds[2].dtype, kind)
                entry = builder.insert_element(none, entry, SHORT(0))
                repeated = builder.shuffle_vector(entry, none, mask)
                product = builder.fmul(repeated, other, flags=CONTRACT)
                total = builder.fadd(total, product, flags=CONTRACT)
            pointer = builder.bitcast(builder.gep(C, [INDEX(a * p)]), total.type.as_pointer())
            builder.store(total, pointer, align=kind.bitwidth // 8)
        return context.get_dummy_value()

    return plain if _config.DISABLE_JIT else intrinsic(typed)


def _row_of(context: Any, builder: Any, block: Any, row: int, p: int, of: Any, to: Any) -> Any:
    """A row of a block as a vector of another type."""
    kind = ir.VectorType(context.get_value_type(of), p)
    pointer = builder.bitcast(builder.gep(block, [INDEX(row * p)]), kind.as_pointer())
    out = builder.load(pointer, align=of.bitwidth // 8)
    wide = ir.VectorType(context.get_value_type(to), p)
    if of.bitwidth < to.bitwidth:
        return builder.fpext(out, wide)
    return out if of == to else builder.fptrunc(out, wide)


#: C[at] += A[k] B[e], or with A[k] transposed, in the precision of C; tuples as long as there are
#: rows, sums and columns. Rows stay in registers.
add_product: Any = _product_of_blocks(False)
add_product_transposed: Any = _product_of_blocks(True)
