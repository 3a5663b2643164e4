"""Products with a symmetric matrix of which the blocks on and right of the diagonal are kept.

A block is read once for both products that it takes part in, that of its row and, transposed, that
of its column, so a vector costs half of the memory traffic that it does with all blocks. Rows are
cut into parts; each adds to a vector of its own, from its first row to the last column that it
meets, and these are added up after all are done.

Guarantees: sums are in an order that depends on the parts alone: the same bits for any number of
threads; the rest as in `_kernels_rows`. Every row begins with its diagonal block.
"""

from typing import Any

from llvmlite import ir
from numba import types
from numba.core import errors
from numba.extending import intrinsic

from ilattice._kernels import in_ranges, outer
from ilattice.linalg._kernels_rows import (
    CONTRACT,
    INDEX,
    LANES,
    SHORT,
    _config,
    _entry,
    _tools,
)


class _Row:
    """Writes the loop over the blocks of a row: sums of the row, and additions to its columns."""

    lanes = 1

    def __init__(self, builder: Any, real: Any, m: int) -> None:
        self.builder, self.m = builder, m
        self.bytes = 4 if isinstance(real, ir.FloatType) else 8
        self.width = LANES if self.lanes > 1 else m  # or a row of a block
        self.kind = ir.VectorType(real, self.width)
        self.none = ir.Constant(self.kind, ir.Undefined)

    def load(self, data: Any, at: Any) -> Any:
        """A register from a position on."""
        pointer = self.builder.bitcast(self.builder.gep(data, [at]), self.kind.as_pointer())
        return self.builder.load(pointer, align=self.bytes)

    def store(self, value: Any, data: Any, at: Any) -> None:
        """A register to a position."""
        pointer = self.builder.bitcast(self.builder.gep(data, [at]), self.kind.as_pointer())
        self.builder.store(value, pointer, align=self.bytes)

    def repeated(self, value: Any, lane: int) -> Any:
        """One number of a register in all of them."""
        mask = ir.Constant(ir.VectorType(SHORT, self.width), [lane] * self.width)
        return self.builder.shuffle_vector(value, self.none, mask)

    def add(self, total: Any, a: Any, b: Any) -> Any:
        """A sum and a product."""
        product = self.builder.fmul(a, b, flags=CONTRACT)
        return self.builder.fadd(total, product, flags=CONTRACT)

    def begin(self, blocks: Any, block: Any, x: Any, node: Any) -> None:
        """Sums are those of the diagonal block."""
        own = self.load(x, self.builder.mul(node, INDEX(self.m)))
        self.own = [self.repeated(own, a) for a in range(self.m)]
        self.places = []
        for a in range(self.m):
            place = _tools.alloca_once(self.builder, self.kind)
            row = self.load(blocks, self.builder.add(block, INDEX(self.m * a)))
            self.builder.store(self.builder.fmul(row, own, flags=CONTRACT), place)
            self.places.append(place)

    def step(self, blocks: Any, block: Any, x: Any, node: Any, out: Any, to: Any) -> None:
        """Add the products of a block to the sums, and of its transpose to node `to` of out."""
        given = self.load(x, self.builder.mul(node, INDEX(self.m)))
        there = self.builder.mul(to, INDEX(self.m))
        total = self.load(out, there)
        for a, place in enumerate(self.places):
            row = self.load(blocks, self.builder.add(block, INDEX(self.m * a)))
            self.builder.store(self.add(self.builder.load(place), row, given), place)
            total = self.add(total, row, self.own[a])
        self.store(total, out, there)

    def end(self, out: Any, to: Any) -> None:
        """Add the sums to node `to` of out."""
        first = self.builder.mul(to, INDEX(self.m))
        for a, place in enumerate(self.places):
            register = self.builder.load(place)
            pointer = self.builder.gep(out, [self.builder.add(first, INDEX(a))])
            total = self.builder.load(pointer)
            for b in range(self.m):
                part = self.builder.extract_element(register, SHORT(b))
                total = self.builder.fadd(total, part)
            self.builder.store(total, pointer)


class _RowOfEight(_Row):
    """Of eight vectors side by side: a register holds a number of each."""

    lanes = LANES

    def at(self, node: Any, a: int) -> Any:
        """Where number a of a node is."""
        first = self.builder.mul(node, INDEX(LANES * self.m))
        return self.builder.add(first, INDEX(LANES * a))

    def entry(self, blocks: Any, block: Any, a: int, b: int) -> Any:
        """An entry of a block in all of a register."""
        pointer = self.builder.gep(blocks, [self.builder.add(block, INDEX(self.m * a + b))])
        value = self.builder.insert_element(self.none, self.builder.load(pointer), SHORT(0))
        return self.repeated(value, 0)

    def begin(self, blocks: Any, block: Any, x: Any, node: Any) -> None:
        self.own = [self.load(x, self.at(node, a)) for a in range(self.m)]
        self.places = []
        for a in range(self.m):
            place = _tools.alloca_once(self.builder, self.kind)
            total = ir.Constant(self.kind, [0.0] * LANES)
            for b in range(self.m):
                total = self.add(total, self.entry(blocks, block, a, b), self.own[b])
            self.builder.store(total, place)
            self.places.append(place)

    def step(self, blocks: Any, block: Any, x: Any, node: Any, out: Any, to: Any) -> None:
        for b in range(self.m):
            given, total = self.load(x, self.at(node, b)), self.load(out, self.at(to, b))
            for a, place in enumerate(self.places):
                entry = self.entry(blocks, block, a, b)
                self.builder.store(self.add(self.builder.load(place), entry, given), place)
                total = self.add(total, entry, self.own[a])
            self.store(total, out, self.at(to, b))

    def end(self, out: Any, to: Any) -> None:
        for a, place in enumerate(self.places):
            total = self.builder.fadd(self.load(out, self.at(to, a)), self.builder.load(place))
            self.store(total, out, self.at(to, a))


def _operation(kind: type[_Row]) -> Any:
    """One of the operations, by NumPy where nothing is compiled."""

    def plain(first: int, last: int, columns: Any, blocks: Any, x: Any, L: Any, i: int, out: Any,
              base: int) -> None:  # fmt: skip
        m = len(L)
        given, to = x.reshape(-1, m, kind.lanes), out.reshape(-1, m, kind.lanes)
        for k in range(first, last):
            j = columns[k]
            to[i - base] += blocks[k] @ given[j]
            if k > first:
                to[j - base] += blocks[k].T @ given[i]

    def typed(typing: Any, first: Any, last: Any, columns: Any, blocks: Any, x: Any, L: Any,
              i: Any, out: Any, base: Any) -> Any:  # fmt: skip
        if any(a.layout != "C" for a in (columns, blocks, x, out)):
            raise errors.TypingError("rows are of arrays that are C-contiguous")
        index = types.int64
        return types.void(index, index, columns, blocks, x, L, index, out, index), generate

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        nodes, blocks, x, out = (
            context.make_array(signature.args[i])(context, builder, arguments[i]).data
            for i in (2, 3, 4, 7)
        )
        first, last, own, base = (arguments[i] for i in (0, 1, 6, 8))
        m = len(signature.args[5])
        maker = kind(builder, context.get_value_type(signature.args[3].dtype), m)
        maker.begin(blocks, builder.mul(first, INDEX(m * m)), x, own)
        after = builder.add(first, INDEX(1))
        with _tools.for_range_slice(builder, after, last, INDEX(1)) as (k, _):
            j = _entry(builder, nodes, k)
            maker.step(blocks, builder.mul(k, INDEX(m * m)), x, j, out, builder.sub(j, base))
        maker.end(out, builder.sub(own, base))
        return context.get_dummy_value()

    return plain if _config.DISABLE_JIT else intrinsic(typed)


#: Row i with blocks first to last - 1, the first of which is on the diagonal: node i - base of out
#: gets the products with x of its blocks, and every node columns[k] - base but itself those of
#: block k, transposed, with node i of x. In the second, x and out have eight numbers side by side.
_row: Any = _operation(_Row)
_row_of_eight: Any = _operation(_RowOfEight)


@in_ranges(1)
@outer(nogil=True, error_model="numpy")
def multiply(
    begin: int, end: int, cuts: Any, starts: Any, offsets: Any, columns: Any, blocks: Any, x: Any,
    L: Any, sums: Any,
) -> None:  # fmt: skip
    """Parts of K x: rows cuts[p] to cuts[p + 1] - 1 add to nodes from cuts[p] on.

    Those of a part are in sums (numbers, 1), or of eight vectors (numbers, 8), from row
    ``len(L) starts[p]`` to that of the next part.
    """
    m = len(L)
    for p in range(begin, end):
        out = sums[m * starts[p] : m * starts[p + 1]]
        out[:] = 0.0
        for i in range(cuts[p], cuts[p + 1]):
            if sums.shape[1] == 1:
                _row(offsets[i], offsets[i + 1], columns, blocks, x, L, i, out, cuts[p])
            else:
                _row_of_eight(offsets[i], offsets[i + 1], columns, blocks, x, L, i, out, cuts[p])


@in_ranges(1)
@outer(nogil=True, error_model="numpy")
def add_parts(
    begin: int, end: int, cuts: Any, starts: Any, m: int, sums: Any, sign: Any, y: Any
) -> None:  # fmt: skip
    """y += sign K x (or y = K x for sign 0) in rows of y, from parts that `multiply` made."""
    for p in range(begin, end):
        low = m * cuts[p]
        total = sums[m * starts[p] : m * (starts[p] + cuts[p + 1] - cuts[p])]
        for q in range(p - 1, -1, -1):
            reach = min(m * (cuts[q] + starts[q + 1] - starts[q]) - low, len(total))
            if reach > 0:
                first = m * (starts[q] - cuts[q]) + low
                other = sums[first : first + reach]
                for e in range(reach):
                    for r in range(total.shape[1]):
                        total[e, r] += other[e, r]
        for r in range(len(y)):
            for e in range(len(total)):
                if sign == 0:
                    y[r, low + e] = total[e, r]
                else:
                    y[r, low + e] += sign * total[e, r]


@outer(error_model="numpy")
def count_whole(offsets: Any, columns: Any, counts: Any) -> None:
    """Number of blocks of every row of the whole matrix."""
    for i in range(len(offsets) - 1):
        counts[i] += offsets[i + 1] - offsets[i]
        for k in range(offsets[i] + 1, offsets[i + 1]):
            counts[columns[k]] += 1


@outer(error_model="numpy")
def list_whole(offsets: Any, columns: Any, to: Any, whole: Any, which: Any) -> None:
    """Columns of every row of the whole matrix, ascending, and their blocks, ~k if transposed.

    Row i is written from to[i] on, which is moved behind it.
    """
    for i in range(len(offsets) - 1):
        for k in range(offsets[i], offsets[i + 1]):
            j = columns[k]
            whole[to[i]] = j
            which[to[i]] = k
            to[i] += 1
            if j != i:
                whole[to[j]] = i
                which[to[j]] = ~k
                to[j] += 1
