"""Compiled tree of boxes, over triangles or any other things that have boxes.

The tree is flat: `box` (N, 6) lower and upper corners, `link` (N, 3): right child (the left one is
the next node), first thing and number of things (0 for inner nodes). Things lie in the order of the
leaves, which `order` becomes.

Guarantee: the tree does not depend on the number of threads.
"""

import numpy as np

from ilattice._kernels import inner, outer

FAST = {"contract", "nsz"}
#: Most boxes in a leaf of things that are quickly looked at; bins among which a node is cut.
LEAF = 4
BINS = 16
DEEP = 40  # from here on nodes are halved by count
STACK = 128  # > DEEP + the logarithm of the number of things


@outer(error_model="numpy")
def build(lo, hi, order, box, link, most):
    """Tree over boxes (F, 3), binned by surface area, with at most `most` in a leaf.

    Returns the number of nodes.
    """
    stack = np.empty((2 * STACK, 4), np.int64)
    stack[0] = 0, len(lo), 0, -1
    top = 1
    nodes = 0
    spare = np.empty(len(lo), np.int64)
    while top > 0:
        top -= 1
        begin, end, depth, parent = stack[top, 0], stack[top, 1], stack[top, 2], stack[top, 3]
        node = nodes
        nodes += 1
        if parent >= 0:
            link[parent, 0] = node
        enclose(lo, hi, order, begin, end, box[node])
        link[node, 0], link[node, 1], link[node, 2] = -1, begin, end - begin
        if end - begin > most:
            middle = split(lo, hi, order, begin, end, depth, spare)
            link[node, 1], link[node, 2] = 0, 0
            stack[top] = middle, end, depth + 1, node
            stack[top + 1] = begin, middle, depth + 1, -1
            top += 2
    return nodes


@inner(error_model="numpy")
def enclose(lo, hi, order, begin, end, out):
    """Box of the things order[begin:end]."""
    out[:3], out[3:] = np.inf, -np.inf
    for i in range(begin, end):
        for a in range(3):
            out[a] = min(out[a], lo[order[i], a])
            out[3 + a] = max(out[3 + a], hi[order[i], a])


@inner(error_model="numpy")
def half_area(b):
    """Half the surface of a box."""
    x, y, z = b[3] - b[0], b[4] - b[1], b[5] - b[2]
    return x * y + y * z + z * x


@inner(owning=True, error_model="numpy")
def split(lo, hi, order, begin, end, depth, spare):
    """Partition order[begin:end] where the expected cost is least; returns the boundary."""
    axis, first, width = widest(lo, hi, order, begin, end)
    if depth >= DEEP or not width > 0.0:
        return (begin + end) // 2
    counts = np.zeros(BINS, np.int64)
    boxes = np.empty((BINS, 6))
    boxes[:, :3], boxes[:, 3:] = np.inf, -np.inf
    for i in range(begin, end):
        t = order[i]
        b = bin_of(lo[t, axis] + hi[t, axis], first, width)
        counts[b] += 1
        for a in range(3):
            boxes[b, a] = min(boxes[b, a], lo[t, a])
            boxes[b, 3 + a] = max(boxes[b, 3 + a], hi[t, a])
    cut = cheapest(counts, boxes)
    left, right = begin, 0
    for i in range(begin, end):
        t = order[i]
        if bin_of(lo[t, axis] + hi[t, axis], first, width) < cut:
            order[left] = t
            left += 1
        else:
            spare[right] = t
            right += 1
    order[left:end] = spare[:right]
    return left


@inner(error_model="numpy")
def widest(lo, hi, order, begin, end):
    """Axis along which doubled centres spread most, their least value and their spread."""
    axis, first, width = 0, 0.0, -1.0
    for a in range(3):
        low, high = np.inf, -np.inf
        for i in range(begin, end):
            c = lo[order[i], a] + hi[order[i], a]
            low, high = min(low, c), max(high, c)
        if high - low > width:
            axis, first, width = a, low, high - low
    return axis, first, width


@inner(error_model="numpy")
def bin_of(centre, first, width):
    """Bin of a doubled centre; the least one is in the first bin, the largest in the last."""
    return min(BINS - 1, int(BINS * ((centre - first) / width)))


@inner(owning=True, error_model="numpy")
def cheapest(counts, boxes):
    """Number of bins that go to the left; both sides get some."""
    above = np.empty(BINS)
    b = boxes[BINS - 1].copy()
    n = 0
    for i in range(BINS - 1, 0, -1):
        n += counts[i]
        b[:3], b[3:] = np.minimum(b[:3], boxes[i, :3]), np.maximum(b[3:], boxes[i, 3:])
        above[i] = half_area(b) * n if n else 0.0
    b[:] = boxes[0]
    n = 0
    cut, best = 1, np.inf
    for i in range(1, BINS):
        n += counts[i - 1]
        b[:3], b[3:] = np.minimum(b[:3], boxes[i - 1, :3]), np.maximum(b[3:], boxes[i - 1, 3:])
        cost = half_area(b) * n + above[i]
        if cost < best:
            cut, best = i, cost
    return cut


@outer()
def greatest(link, size, out):
    """Greatest of numbers of the things, in the order of the leaves, in each node."""
    for node in range(len(link) - 1, -1, -1):
        most = -np.inf
        if link[node, 2] > 0:
            for i in range(link[node, 1], link[node, 1] + link[node, 2]):
                most = max(most, size[i])
        else:
            most = max(out[node + 1], out[link[node, 0]])
        out[node] = most


@inner(fastmath=FAST, error_model="numpy")
def box_square(box, i, x, y, z):
    """Squared distance to a box."""
    u = max(max(box[i, 0] - x, x - box[i, 3]), 0.0)
    v = max(max(box[i, 1] - y, y - box[i, 4]), 0.0)
    w = max(max(box[i, 2] - z, z - box[i, 5]), 0.0)
    return u * u + v * v + w * w
