"""Functions on the octant that change sign at the boundary, and their zero sets as triangles.

The curves part the faces of the cube into two colours. With data +1 and -1 there, the harmonic
function has a zero set over the curves; the function of least total variation has the least
of all surfaces over them as its level set (a surface of currents: Xu et al. 2023, equation 3, is
its dual). The first is a good start for a surface near by; the second may be in other pieces.

Guarantees: harmonic functions are solutions of the equations on the grid to rounding; boundaries of
the triangles lie on the curves. Non-guarantees: total variation is minimised to the stated number
of steps only.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy import sparse
from scipy.fft import dstn, idstn
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from ilattice._geometry import fixed_coordinates, grid_points
from ilattice._typing import AnyArray, FloatArray, IntArray
from ilattice.bspline import BSpline
from ilattice.errors import ConvergenceError
from ilattice.mesh.contouring import contour_arrays
from ilattice.minimal.completion import edge_table
from ilattice.minimal.disc import vertex_normals
from ilattice.shells.boundary import Boundary
from ilattice.shells.refined import refined
from ilattice.shells.topologies import FACES, Segment, edge_place, others

#: Points per arc for distances, and cells over which colours change at the curves.
POINTS, SOFT = 513, 1.5
_EVERY = 4  # of the points, for what is on which side
#: Least absolute value of colours: so that nodes on curves have a side, and a part of a cell inside
#: of the faces, where the surface is looked for, it is that of the face.
MIN_COLOUR = 0.2
#: Steps of the method of Chambolle and Pock.
STEPS = 400


class _DisagreeingError(ConvergenceError):
    """Triangles on two faces that are one are not the same."""


@dataclass(frozen=True, eq=False)
class Triangles:
    """Zero set of a function on the octant.

    Attributes
    ----------
    vertices : (V, 3) array
        In [-1, 1]³; those of the boundary are on the curves.
    faces : (F, 3) array
        Corners; normals point to where the function is positive.
    on : (V, 3) array of int
        -1 or 1 where a vertex lies on a face normal to that axis, else 0.
    """

    vertices: FloatArray
    faces: IntArray
    on: IntArray


def face_values(curves: Boundary, face: int, x: FloatArray, width: float) -> FloatArray:
    """Colour of a face, with a slope across the curves.

    Parameters
    ----------
    curves : Boundary
        The curves.
    face : int
        Number of the face.
    x : (n,) array
        Nodes in both directions.
    width : float
        Distance from the curves where values are full.

    Returns
    -------
    (n, n) array
        From -1 to 1.
    """
    axis, side = divmod(face, 2)
    plane = list(others(axis))
    q = grid_points(x, x)
    mine = [k for k, s in enumerate(curves.topology.segments) if s.face == face]
    lines = curves.points(POINTS)[mine][:, :, plane]
    distance = cKDTree(lines.reshape(-1, 2)).query(q)[0]
    inside = np.zeros(len(q), bool)
    for k, line in zip(mine, lines, strict=True):
        outline = _outline(curves.topology.segments[k], line[::_EVERY])
        inside |= _within(outline, (1.0 - 1e-9) * q)
    colours = np.take(curves.topology.colours, side, axis)
    colour = colours[curves.topology.segments[mine[0]].corners[0]]
    values: FloatArray = np.clip(distance / width, MIN_COLOUR, 1.0) * np.where(
        inside, colour, -colour
    )
    return values.reshape(len(x), len(x))


def edge_values(curves: Boundary, number: int, x: FloatArray, width: float) -> FloatArray:
    """Colour of an edge of the cube; see `face_values`.

    Parameters
    ----------
    curves : Boundary
        The curves.
    number : int
        Number of the edge.
    x : (n,) array
        Nodes.
    width : float
        Distance from the node of the curves where values are full.

    Returns
    -------
    (n,) array
        From -1 to 1.
    """
    axis, ends = edge_place(number)
    first, second = others(axis)
    low = np.moveaxis(curves.topology.colours, axis, 0)[0, ends[first], ends[second]]
    if number not in curves.topology.nodes:
        return np.full(len(x), float(low))
    at = curves.nodes[curves.topology.nodes.index(number), axis]
    out: FloatArray = np.clip(np.abs(x - at) / width, MIN_COLOUR, 1.0)
    return np.where(x < at + 1e-9, low, -low) * out


def _outline(s: Segment, line: FloatArray) -> FloatArray:
    """Polygon of what an arc cuts off from its face."""
    corners = 2.0 * np.array(s.corners) - 1.0
    gaps = np.linalg.norm(corners - line[-1], axis=1)
    return np.concatenate([line, corners[np.argsort(gaps)]])


def _within(polygon: FloatArray, q: FloatArray) -> AnyArray:
    """Whether points (n, 2) are inside of a polygon."""
    a, b = polygon, np.roll(polygon, -1, axis=0)
    keep = a[:, 1] != b[:, 1]
    a, b = a[keep], b[keep]
    x, y = q[:, None, 0], q[:, None, 1]
    across = (a[:, 1] > y) != (b[:, 1] > y)
    at = a[:, 0] + (y - a[:, 1]) * ((b - a)[:, 0] / (b - a)[:, 1])
    odd: AnyArray = (across & (x < at)).sum(axis=1) % 2 == 1
    return odd


def coloured(curves: Boundary, n: int) -> FloatArray:
    """Data on the faces of a grid, zero inside.

    Parameters
    ----------
    curves : Boundary
        The curves.
    n : int
        Cells per edge.

    Returns
    -------
    (n + 1, n + 1, n + 1) array
        From -1 to 1.
    """
    x, u = np.linspace(-1.0, 1.0, n + 1), np.zeros((n + 1,) * 3)
    for face in range(6):
        axis, side = divmod(face, 2)
        np.moveaxis(u, axis, 0)[-side] = face_values(curves, face, x, SOFT * 2.0 / n)
    for number in range(12):
        axis, ends = edge_place(number)
        first, second = others(axis)
        line = np.moveaxis(u, axis, 0)[:, -ends[first], -ends[second]]
        line[:] = edge_values(curves, number, x, SOFT * 2.0 / n)
    return u


def harmonic(curves: Boundary, n: int) -> FloatArray:
    """Solution of Laplace's equation with the colours on the faces.

    Parameters
    ----------
    curves : Boundary
        The curves.
    n : int
        Cells per edge.

    Returns
    -------
    (n + 1, n + 1, n + 1) array
        Values at the nodes, by a sine transform of the seven-point star.
    """
    u = coloured(curves, n)
    right = np.zeros((n - 1,) * 3)
    for axis in range(3):
        r, w = np.moveaxis(right, axis, 0), np.moveaxis(u, axis, 0)[:, 1:-1, 1:-1]
        r[0] += w[0]
        r[-1] += w[-1]
    k = 2.0 - 2.0 * np.cos(np.pi * np.arange(1, n) / n)
    symbol = k[:, None, None] + k[None, :, None] + k[None, None, :]
    u[1:-1, 1:-1, 1:-1] = idstn(dstn(right, type=1) / symbol, type=1)
    return u


def least_gradient(curves: Boundary, n: int, steps: int = STEPS) -> FloatArray:
    """Function of least total variation with the colours on the faces.

    Parameters
    ----------
    curves : Boundary
        The curves.
    n : int
        Cells per edge.
    steps : int
        Of the primal-dual method.

    Returns
    -------
    (n + 1, n + 1, n + 1) array
        Values at the nodes.

    Notes
    -----
    A. Chambolle and T. Pock, J. Math. Imaging Vis. 40 (2011), algorithm 1.
    """
    u = harmonic(curves, n)
    inner = (slice(1, -1),) * 3
    p, bar = np.zeros((3, n, n, n)), u.copy()
    tau = sigma = 0.99 / np.sqrt(12.0)
    for _ in range(steps):
        for axis in range(3):
            p[axis] += sigma * np.diff(bar, axis=axis)[_corner(axis)]
        p /= np.maximum(1.0, np.sqrt((p**2).sum(axis=0)))
        down = np.zeros_like(u)
        for axis in range(3):
            whole = np.zeros_like(u)
            whole[:-1, :-1, :-1] = p[axis]
            down[:-1, :-1, :-1] += p[axis]
            np.moveaxis(down, axis, 0)[1:] -= np.moveaxis(whole, axis, 0)[:-1]
        new = u[inner] + tau * down[inner]
        bar[inner] = 2.0 * new - u[inner]
        u[inner] = new
    return u


def _corner(axis: int) -> tuple[slice, ...]:
    """The first n of n + 1 nodes in the directions in which no difference was taken."""
    return tuple(slice(None) if a == axis else slice(-1) for a in range(3))


def zero_set(u: FloatArray, curves: Boundary, n: int, glued: tuple[bool, ...]) -> Triangles:
    """Zero set of nodal values as triangles, with its boundary put on the curves.

    Parameters
    ----------
    u : (m, m, m) array
        Values at nodes of which every (m - 1) / n-th is taken.
    curves : Boundary
        The curves.
    n : int
        Cells per edge of the grid of the triangles.
    glued : tuple of 3 bool
        Axes along which the low face is the high one, shifted.

    Returns
    -------
    Triangles
        The surface.

    Raises
    ------
    ConvergenceError
        If the boundary does not meet the curves as it should: they are too fine for the grid.
    """
    step = (len(u) - 1) // n
    x = np.linspace(-1.0, 1.0, n + 1)
    nodes = np.ascontiguousarray(u[::step, ::step, ::step])
    try:
        return _contoured(nodes, x, curves, glued)
    except _DisagreeingError:  # triangles of two faces that are one
        return _contoured(_alike(nodes, curves, glued), x, curves, glued)


def _contoured(
    nodes: FloatArray, x: FloatArray, curves: Boundary, glued: tuple[bool, ...]
) -> Triangles:
    """See `zero_set`; ``x`` are the planes of the nodes."""
    n, knots = len(x) - 1, np.concatenate([[-1.0], x, [1.0]])
    spline = BSpline([knots] * 3, nodes, 1)
    found = contour_arrays(spline, [x] * 3, caps=False, place="linear")
    v = np.array(found.vertices)
    on = np.where(fixed_coordinates(found.kind), np.sign(v), 0.0).astype(np.int64)
    _snap(v, on, curves)
    for axis in np.flatnonzero(glued):
        _match(v, on, int(axis), 2.0 / n)
    triangles = Triangles(v, np.array(found.faces, np.int64), on)
    _check_boundary(triangles, curves, n)
    return triangles


def _alike(u: FloatArray, curves: Boundary, glued: tuple[bool, ...]) -> FloatArray:
    """Values that agree next to faces that are one: contours look a part of a cell inside."""
    u = np.array(u)
    for axis in np.flatnonzero(glued):
        sign, planes = curves.congruent(int(axis)), np.moveaxis(u, axis, 0)
        planes[1] = 0.5 * (planes[1] + sign * planes[-2])
        planes[-2] = sign * planes[1]
    return u


def graded(t: Triangles, curves: Boundary, glued: tuple[bool, ...], rounds: int) -> Triangles:
    """Triangles that get smaller towards the curves.

    Parameters
    ----------
    t : Triangles
        Triangles with their boundary on the curves.
    curves : Boundary
        The curves.
    glued : tuple of 3 bool
        Axes along which the low face is the high one, shifted.
    rounds : int
        How often edges at the curves are cut in half.

    Returns
    -------
    Triangles
        With their boundary on the curves.
    """
    for _ in range(rounds):
        v, faces, on = refined(t.vertices, t.faces, t.on)
        new = np.arange(len(v)) >= len(t.vertices)
        middles = v[new]
        _snap(middles, on[new], curves)
        v[new] = middles
        for axis in np.flatnonzero(glued):
            _match(v, on, int(axis), 1e-6)
        t = Triangles(v, faces, on)
    return t


def evened(v: FloatArray, faces: IntArray, fixed: AnyArray, rounds: int = 5) -> FloatArray:
    """Vertices moved along their surface towards the means of their neighbours.

    Parameters
    ----------
    v : (V, 3) array
        Vertices.
    faces : (F, 3) array
        Corners.
    fixed : (V,) array of bool
        Vertices that stay.
    rounds : int
        How often.

    Returns
    -------
    (V, 3) array
        The vertices, half of the way in each round.
    """
    rows, cols = np.concatenate([faces, faces[:, [1, 2, 0]]]).ravel(), faces[:, [1, 2, 0]].ravel()
    cols = np.concatenate([cols, faces.ravel()])
    links: Any = sparse.csr_array((np.ones(len(rows)), (rows, cols)), shape=(len(v),) * 2)
    count = links.sum(axis=1)
    for _ in range(rounds):
        n = vertex_normals(v, faces)
        shift = (links @ v) / count[:, None] - v
        shift -= np.einsum("vc,vc->v", shift, n)[:, None] * n
        v = np.where(fixed[:, None], v, v + 0.5 * shift)
    return v


def _snap(v: FloatArray, on: IntArray, curves: Boundary) -> None:
    """Move vertices of the boundary onto the curves, in place."""
    points = curves.points(2 * POINTS - 1)
    count = np.abs(on).sum(axis=1)
    for face in range(6):
        axis, side = divmod(face, 2)
        mine = np.flatnonzero((on[:, axis] == 2 * side - 1) & (count == 1))
        rows = [k for k, s in enumerate(curves.topology.segments) if s.face == face]
        if len(mine) and rows:
            v[mine] = _on_polylines(points[rows], v[mine])
    ends = np.flatnonzero(count == 2)
    if len(ends):
        v[ends] = curves.nodes[cKDTree(curves.nodes).query(v[ends])[1]]


def _on_polylines(lines: FloatArray, q: FloatArray) -> FloatArray:
    """Nearest points on polylines (s, m, 3)."""
    a, b = lines[:, :-1].reshape(-1, 3), lines[:, 1:].reshape(-1, 3)
    near = cKDTree(0.5 * (a + b)).query(q)[1]
    chord = b[near] - a[near]
    t = np.einsum("nc,nc->n", q - a[near], chord) / np.einsum("nc,nc->n", chord, chord)
    points: FloatArray = a[near] + np.clip(t, 0.0, 1.0)[:, None] * chord
    return points


def _match(v: FloatArray, on: IntArray, axis: int, h: float) -> None:
    """Make vertices on the high face those of the low one, shifted, in place."""
    low, high = (np.flatnonzero(on[:, axis] == side) for side in (-1, 1))
    flat = list(others(axis))
    gap, near = map(np.asarray, cKDTree(v[low][:, flat]).query(v[high][:, flat]))
    if len(low) != len(high) or len(np.unique(near)) != len(low) or gap.max(initial=0.0) > h:
        raise _DisagreeingError(
            f"triangles on {FACES[2 * axis]} and {FACES[2 * axis + 1]} do not agree, though the "
            "curves do: take another n"
        )
    v[high[:, None], flat] = v[low[near][:, None], flat]


def _check_boundary(t: Triangles, curves: Boundary, n: int) -> None:
    """Refuse triangles whose boundary passes nodes by, or is in other loops."""
    ends = np.flatnonzero(np.abs(t.on).sum(axis=1) == 2)
    loops = boundary_loops(t.faces)
    if len(ends) != len(curves.nodes) or loops != len(curves.topology.loops):
        raise ConvergenceError(
            f"with {n} cells per edge the surface ends in {loops} loops through {len(ends)} nodes, "
            f"not in {len(curves.topology.loops)} through {len(curves.nodes)}: curves come too "
            "near to each other or to a corner; take a larger n, or other positions"
        )


def boundary_loops(faces: IntArray) -> int:
    """Number of closed curves that triangles end in.

    Parameters
    ----------
    faces : (F, 3) array
        Corners.

    Returns
    -------
    int
        Number of components of the open edges.
    """
    edges, counts, _ = edge_table(faces)
    open_edges = edges[counts == 1]
    used, rows = np.unique(open_edges, return_inverse=True)
    at = rows.reshape(-1, 2).T
    links: Any = sparse.coo_array((np.ones(at.shape[1], bool), at), shape=(len(used),) * 2)
    return int(connected_components(links, directed=False)[0])
