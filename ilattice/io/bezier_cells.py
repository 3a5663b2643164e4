"""Spline volumes as VTK Bezier hexahedra: numbering of the nodes, shared nodes, attributes.

Guarantees: exact, no sampling; elements share the nodes of common faces, also across the seam of
a closed direction, so that surface filters see a connected volume. Not guaranteed: shared nodes
where the spline jumps; such faces stay double.
"""

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from ilattice._typing import AnyArray, FloatArray, IntArray
from ilattice.errors import FormatError

if TYPE_CHECKING:
    from ilattice.bspline.bezier import BezierCells

#: Part of the largest coefficient by which control points on faces of cells may differ.
_SAME = 1e-12
_EDGE_CORNERS = {(0, 0): 0, (1, 0): 1, (1, 1): 2, (0, 1): 3}


class BezierNodes(NamedTuple):
    """Bezier elements with shared nodes.

    Attributes
    ----------
    values : (n, m) array
        Cartesian control values of the nodes: coordinates first.
    weights : (n,) array or None
        Weights of the nodes.
    cells : (e, (k0 + 1)(k1 + 1)(k2 + 1)) array
        Nodes of each element in VTK's order.
    degrees : tuple of int
        Degree in each direction, at least 1.
    """

    values: FloatArray
    weights: FloatArray | None
    cells: IntArray
    degrees: tuple[int, int, int]


def vtk_order(p: int, q: int, r: int) -> IntArray:
    """Place of each node of a hexahedron of degrees `p`, `q`, `r` in VTK's connectivity.

    Corners come first, then the nodes inside edges, inside faces, inside the volume (VTK 9 and
    later; the order of Lagrange and Bezier hexahedra is the same).

    Parameters
    ----------
    p, q, r : int
        Degrees, at least 1.

    Returns
    -------
    (p + 1, q + 1, r + 1) array
        A permutation of 0, 1, ...
    """
    place = np.empty((p + 1, q + 1, r + 1), np.int64)
    for i, j, k in np.ndindex(place.shape):
        place[i, j, k] = _place(i, j, k, p, q, r)
    return place


def _place(i: int, j: int, k: int, p: int, q: int, r: int) -> int:
    at_i, at_j, at_k = i in (0, p), j in (0, q), k in (0, r)
    high_i, high_j, high_k = int(i > 0), int(j > 0), int(k > 0)
    ends = at_i + at_j + at_k
    if ends == 3:
        return _EDGE_CORNERS[high_i, high_j] + 4 * high_k
    loop = p + q - 2
    if ends == 2:
        if not at_i:
            return 8 + (i - 1) + high_j * loop + high_k * 2 * loop
        if not at_j:
            return 8 + (j - 1) + (p - 1 if high_i else loop + p - 1) + high_k * 2 * loop
        return 8 + 4 * loop + (k - 1) + (r - 1) * _EDGE_CORNERS[high_i, high_j]
    start = 8 + 4 * (p + q + r - 3)
    across_i, across_j, across_k = (q - 1) * (r - 1), (p - 1) * (r - 1), (p - 1) * (q - 1)
    if at_i:
        return start + (j - 1) + (q - 1) * (k - 1) + high_i * across_i
    if at_j:
        return start + 2 * across_i + (i - 1) + (p - 1) * (k - 1) + high_j * across_j
    start += 2 * (across_i + across_j)
    if at_k:
        return start + (i - 1) + (p - 1) * (j - 1) + high_k * across_k
    return start + 2 * across_k + (i - 1) + (p - 1) * ((j - 1) + (q - 1) * (k - 1))


def bezier_nodes(elements: "BezierCells") -> BezierNodes:
    """Number the nodes of Bezier elements once, in VTK's order.

    Parameters
    ----------
    elements : BezierCells
        ``coefficients`` (e0, e1, e2, k0 + 1, k1 + 1, k2 + 1, m), and ``weights`` or None.

    Returns
    -------
    BezierNodes
        Elements in C order.

    Raises
    ------
    FormatError
        If a degree is 0, which VTK does not have.
    """
    c = np.asarray(elements.coefficients)
    weights = elements.weights
    count, size = c.shape[:3], c.shape[3:6]
    if min(size) < 2:
        raise FormatError(
            f"VTK has no Bezier cells of degree 0, this volume has degrees "
            f"{tuple(n - 1 for n in size)}; elevate it first"
        )
    homogeneous = c if weights is None else np.concatenate([c, weights[..., None]], axis=-1)
    lines = [_line_numbers(homogeneous, axis) for axis in range(3)]
    (n0, i0), (n1, i1), (n2, i2) = ((int(line.max()) + 1, line) for line in lines)
    number = (i0[:, None, None, :, None, None] * n1 + i1[:, None, None, :, None]) * n2
    number = number + i2[:, None, None, :]
    flat = np.broadcast_to(number, count + size).reshape(np.prod(count), np.prod(size))
    values = np.empty((n0 * n1 * n2, c.shape[6]))
    values[flat] = c.reshape(*flat.shape, -1)
    node_weights = None
    if weights is not None:
        node_weights = np.empty(len(values))
        node_weights[flat] = weights.reshape(flat.shape)
    cells = np.empty_like(flat)
    p, q, r = (n - 1 for n in size)
    cells[:, vtk_order(p, q, r).ravel()] = flat
    return BezierNodes(values, node_weights, cells, (p, q, r))


def _line_numbers(c: AnyArray, axis: int) -> IntArray:
    """Numbers (elements, nodes) along one direction; neighbours share a node where they agree."""
    c = np.moveaxis(c, (axis, axis + 3), (0, 1))
    elements, nodes = c.shape[:2]
    tolerance = _SAME * (float(np.abs(c).max()) or 1.0)
    numbers = np.empty((elements, nodes), np.int64)
    first = 0
    for e in range(elements):
        numbers[e] = first + np.arange(nodes)
        meets_next = e + 1 < elements and _agree(c[e, -1], c[e + 1, 0], tolerance)
        first += nodes - meets_next
    if elements * (nodes - 1) > 1 and _agree(c[-1, -1], c[0, 0], tolerance):
        numbers[-1, -1] = 0
    return numbers


def _agree(a: AnyArray, b: AnyArray, tolerance: float) -> bool:
    return bool(np.abs(a - b).max() <= tolerance)
