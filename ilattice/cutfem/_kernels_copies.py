"""Connected components of the supports of functions, which get a copy of the function each.

Guarantee: a function is worked on by one thread, in the order of its elements, so that results are
the same for any number of threads.
"""

from typing import Any

import numpy as np
from numba import njit, prange

from ilattice.cutfem._kernels_elements import grown, root
from ilattice.quadrature._kernels_solid import FAST


@njit(parallel=True, **FAST)
def components(
    shape: Any, count: Any, step: int, p: int, numbers: Any, closed: Any, first: Any, after: Any,
    begin: Any, upper: Any, chunks: int, out: Any, copies: Any,
) -> None:  # fmt: skip
    """Connected components of the elements in the support of each function.

    `numbers` are the functions, on a grid of `shape` cells and `count` functions per direction;
    `first` is an element of every cell, or -1, `after` the next one of the same cell;
    upper[begin[e] : begin[e + 1]] are elements linked to e on its upper sides. The component is
    written to out (elements, (p + 1)³), the number of components to `copies`.
    """
    n = p + 1
    for chunk in prange(chunks):
        where = np.full(len(begin) - 1, -1, np.int64)
        room = 256
        members = np.empty(room, np.int64)
        local = np.empty(room, np.int64)
        parent = np.empty(room, np.int64)
        f = np.empty(3, np.int64)
        for r in range(len(numbers) * chunk // chunks, len(numbers) * (chunk + 1) // chunks):
            f[0] = numbers[r] // (count[1] * count[2])
            f[1] = numbers[r] // count[2] % count[1]
            f[2] = numbers[r] % count[2]
            size = 0
            for i in range(n * n * n):
                a = f[0] - i // (n * n)
                b = f[1] - i // n % n
                c = f[2] - i % n
                if a % step or b % step or c % step:
                    continue
                a //= step
                b //= step
                c //= step
                a = a % shape[0] if closed[0] else a
                b = b % shape[1] if closed[1] else b
                c = c % shape[2] if closed[2] else c
                if min(a, b, c) < 0 or a >= shape[0] or b >= shape[1] or c >= shape[2]:
                    continue
                e = first[(a * shape[1] + b) * shape[2] + c]
                while e >= 0:
                    if size == room:
                        room *= 2
                        members = grown(members, room)
                        local = grown(local, room)
                        parent = grown(parent, room)
                    members[size] = e
                    local[size] = i
                    parent[size] = size
                    where[e] = size
                    size += 1
                    e = after[e]
            for k in range(size):
                for j in range(begin[members[k]], begin[members[k] + 1]):
                    other = where[upper[j]]
                    if other >= 0:
                        low = root(parent, k)
                        high = root(parent, other)
                        parent[max(low, high)] = min(low, high)
            number = 0
            for k in range(size):  # the root of a set is its first member
                e = members[k]
                if root(parent, k) == k:
                    out[e, local[k]] = number
                    number += 1
                else:
                    up = root(parent, k)
                    out[e, local[k]] = out[members[up], local[up]]
            copies[r] = number
            for k in range(size):
                where[members[k]] = -1
