"""The (2, 3) pebble game: which edges of a graph are independent in the plane.

Every vertex has two pebbles; an edge that is taken holds one of one of its ends. An edge is
independent if four pebbles can be gathered at its ends (Jacobs and Hendrickson 1997; Lee and
Streinu 2008).

Guarantee: exact, by whole numbers only; O(n) per edge.
"""

from typing import Any

import numpy as np

from ilattice._kernels import inner, outer


@inner()
def _fetch(root: int, keep: int, out: Any, seen: Any, before: Any, slot: Any, stack: Any) -> bool:
    """Bring a free pebble to `root`, none of `keep`, along held edges; whether there was one.

    `out` (n, 2) tells to where the edges go that hold the pebbles of each vertex; -1 is free.
    """
    seen[:] = False
    seen[root] = seen[keep] = True
    stack[0] = root
    top = 1
    while top > 0:
        top -= 1
        v = stack[top]
        for k in range(2):
            w = out[v, k]
            if w < 0 or seen[w]:
                continue
            seen[w] = True
            before[w], slot[w] = v, k
            free = 0 if out[w, 0] < 0 else (1 if out[w, 1] < 0 else -1)
            if free < 0:
                stack[top] = w
                top += 1
                continue
            while w != root:  # turn the edges of the path round
                v, k = before[w], slot[w]
                out[w, free] = v
                out[v, k] = -1
                w, free = v, k
            return True
    return False


@inner()
def _free(out: Any, v: int) -> int:
    """Number of free pebbles of a vertex."""
    return int(out[v, 0] < 0) + int(out[v, 1] < 0)


@outer()
def play(n: Any, edges: Any, taken: Any) -> int:
    """Mark the edges that are independent of those before them; their number."""
    out = np.full((n, 2), -1, np.int64)
    seen = np.zeros(n, np.bool_)
    before, slot = np.zeros(n, np.int64), np.zeros(n, np.int64)
    stack = np.zeros(n + 1, np.int64)
    count = 0
    for e in range(len(edges)):
        u, v = edges[e, 0], edges[e, 1]
        taken[e] = False
        if u == v:
            continue
        while _free(out, u) < 2 and _fetch(u, v, out, seen, before, slot, stack):
            pass
        while _free(out, v) < 2 and _fetch(v, u, out, seen, before, slot, stack):
            pass
        if _free(out, u) + _free(out, v) == 4:
            out[u, 0] = v
            taken[e] = True
            count += 1
    return count
