"""Connected components of the supports of functions, which get a copy of the function each.

What hangs together within a support, or within a cell around it, is one: two sides of a wall that
meet just outside would only get more unknowns by being apart. In periodic cells only the support
counts.

Guarantee: a function is worked on by one thread, in the order of its elements, so that results are
the same for any number of threads.
"""

from typing import Any

import numpy as np

from ilattice._kernels import in_ranges, inner, outer
from ilattice.cutfem._kernels_elements import grown, root
from ilattice.quadrature._kernels_solid import FAST


@inner(owning=True)
def _gather(
    shape: Any, closed: Any, low: Any, high: Any, far: int, first: Any, after: Any, members: Any,
    cells: Any, where: Any, size: int,
) -> Any:  # fmt: skip
    """Members, with the cells they are in, of a box of cells, or of the layer `far` around it.

    Those of which `where` knows the place are there; new ones follow the first `size`.
    """
    for a in range(high[0] + far, low[0] - far - 1, -1):
        for b in range(high[1] + far, low[1] - far - 1, -1):
            for c in range(high[2] + far, low[2] - far - 1, -1):
                i = a % shape[0] if closed[0] else a
                j = b % shape[1] if closed[1] else b
                k = c % shape[2] if closed[2] else c
                if min(i, j, k) < 0 or i >= shape[0] or j >= shape[1] or k >= shape[2]:
                    continue
                e = first[(i * shape[1] + j) * shape[2] + k]
                while e >= 0:
                    if where[e] < 0:
                        if size == len(members):
                            members = grown(members, 2 * size)
                            cells = grown(cells, 2 * size)
                        members[size] = e
                        cells[size] = ((high[0] - a) * 8 + high[1] - b) * 8 + high[2] - c
                        where[e] = size
                        size += 1
                    e = after[e]
    return members, cells, size


@inner()
def _unite(begin: Any, upper: Any, members: Any, size: int, where: Any, parent: Any) -> int:
    """Join members that are linked; the root of a set is its first one. Returns how many sets."""
    for k in range(size):
        parent[k] = k
    sets = size
    for k in range(size):
        for j in range(begin[members[k]], begin[members[k] + 1]):
            other = where[upper[j]]
            if other >= 0:
                low = root(parent, k)
                high = root(parent, other)
                if low != high:
                    parent[max(low, high)] = min(low, high)
                    sets -= 1
    return sets


@in_ranges(1)
@outer(nogil=True, **FAST)
def components(
    start: int, stop: int, shape: Any, count: Any, step: int, p: int, numbers: Any, closed: Any,
    first: Any, after: Any, begin: Any, upper: Any, chunks: int, out: Any, copies: Any,
) -> None:  # fmt: skip
    """Connected components of the elements in the support of each function.

    `numbers` are the functions, on a grid of `shape` cells and `count` functions per direction;
    `first` is an element of every cell, or -1, `after` the next one of the same cell;
    upper[begin[e] : begin[e + 1]] are elements linked to e on its upper sides. The component is
    written to out (elements, (p + 1)³), the number of components to `copies`. Items are the
    `chunks` that functions are cut into, each with scratch for all elements.
    """
    n = p + 1
    where = np.full(len(begin) - 1, -1, np.int64)
    members = np.empty(256, np.int64)
    cells = np.empty(256, np.int64)
    parent = np.empty(256, np.int64)
    f = np.empty(3, np.int64)
    low = np.empty(3, np.int64)
    high = np.empty(3, np.int64)
    for chunk in range(start, stop):
        for r in range(len(numbers) * chunk // chunks, len(numbers) * (chunk + 1) // chunks):
            f[0] = numbers[r] // (count[1] * count[2])
            f[1] = numbers[r] // count[2] % count[1]
            f[2] = numbers[r] % count[2]
            for d in range(3):
                low[d] = -((p - f[d]) // step)
                high[d] = f[d] // step
            members, cells, size = _gather(
                shape, closed, low, high, 0, first, after, members, cells, where, 0
            )
            if len(parent) < len(members):
                parent = np.empty(len(members), np.int64)
            mine = size
            # a periodic cell is the same in any tiling, which specks that are joined would not be;
            # and around a short closed axis all would meet again, behind what parts them
            wraps = closed[0] and closed[1] and closed[2]
            for d in range(3):
                wraps = wraps or (closed[d] and high[d] - low[d] + 3 >= shape[d])
            if _unite(begin, upper, members, size, where, parent) > 1 and not wraps:
                members, cells, size = _gather(
                    shape, closed, low, high, 1, first, after, members, cells, where, size
                )
                if len(parent) < len(members):
                    parent = np.empty(len(members), np.int64)
                _unite(begin, upper, members, size, where, parent)
            number = 0
            for k in range(mine):
                e = members[k]
                i = f[0] - step * (high[0] - cells[k] // 64)
                j = f[1] - step * (high[1] - cells[k] // 8 % 8)
                local = (i * n + j) * n + f[2] - step * (high[2] - cells[k] % 8)
                up = root(parent, k)
                if up == k:
                    out[e, local] = number
                    where[e] = number
                    number += 1
                else:
                    out[e, local] = where[members[up]]
            copies[r] = number
            for k in range(size):
                where[members[k]] = -1
