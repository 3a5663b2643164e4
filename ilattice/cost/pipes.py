"""Edges as smooth pipes: biquadratic Bezier patches around beams, quadratic triangles at nodes.

At each vertex stands a deformed cube, one face per beam: its corners lie along the sums of three
directions. Around a half-beam the four corners of its face are the controls of a closed quadratic
spline, along it those of the face, of a square ring at a quarter of the beam, and of the middle:
four patches. Eight triangles close what the faces leave, and a face without a beam is one patch
(paper, Section 3.8 and Figure 16a).

Guarantees: patches meet exactly, so that the surface is closed; it is C1 around and along beams.
Not guaranteed: smoothness at vertices, where patches meet at an angle; radii, which are those of
beams to 3 % in the middle of the beam only; that pipes of sharp corners do not cross: see
`Pipes.mesh` and its `self_intersections`. Exact cylinders with sharp creases are `Beams`.
"""

import os
from dataclasses import dataclass
from itertools import permutations
from typing import Any, ClassVar

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from ilattice._typing import AnyArray, ArrayLike, FloatArray, IntArray
from ilattice._validate import Frozen, as_array, as_kind, as_whole
from ilattice.cost._structure import Structure
from ilattice.cost.beams import check_swallowed, radii_of
from ilattice.errors import GeometryError, InputError
from ilattice.io import save
from ilattice.mesh.surface import SurfaceMesh

#: A closed quadratic of four controls at distance 1 lies at 0.707 to 0.75 from their middle.
ROUND = 0.7286
#: Corners of a cube as signs; the slots (axis, sign) of its faces; corners of each face in a cycle.
CORNERS = np.array([(i, j, k) for i in (1, -1) for j in (1, -1) for k in (1, -1)])
SLOTS = [(axis, sign) for sign in (1, -1) for axis in range(3)]
#: Least sines between corners of a face, seen along its beam: for the first way, for any.
SOUND, FLAT = 0.3, 0.05
#: Shortest sums of three directions that point to a corner, and parts of them across a beam.
SHORT = 0.15
#: Weld of points of neighbouring patches, in sizes of the whole.
WELD = 1e-9


def _cycle(axis: int, sign: int) -> list[int]:
    """Corners of a face, counter-clockwise seen from outside in a right-handed cube."""
    u, v = np.array([(1, 1), (-1, 1), (-1, -1), (1, -1)]).T
    rows = np.zeros((4, 3), np.int64)
    rows[:, axis], rows[:, (axis + 1) % 3], rows[:, (axis + 2) % 3] = sign, u, v
    rows = rows if sign > 0 else rows[::-1]
    return [int(np.flatnonzero((row == CORNERS).all(axis=1))[0]) for row in rows]


FACES = np.array([_cycle(*slot) for slot in SLOTS])


@dataclass(frozen=True, eq=False, repr=False)
class Pipes(Frozen):
    """A closed surface of Bezier patches.

    Attributes
    ----------
    quads : ndarray, shape (q, 3, 3, 3)
        Controls of biquadratic patches.
    triangles : ndarray, shape (t, 6, 3)
        Controls of quadratic triangles: three corners, then those between 0 and 1, 1 and 2, 2 and
        0.
    """

    file_kind: ClassVar[str] = "patches"
    quads: FloatArray
    triangles: FloatArray

    def __post_init__(self) -> None:
        """Check the shapes."""
        q, t = as_array("quads", self.quads), as_array("triangles", self.triangles)
        if q.ndim != 4 or q.shape[1:] != (3, 3, 3):
            raise InputError(f"quads must have shape (q, 3, 3, 3), got {q.shape}")
        if t.ndim != 3 or t.shape[1:] != (6, 3):
            raise InputError(f"triangles must have shape (t, 6, 3), got {t.shape}")
        object.__setattr__(self, "quads", np.array(q))
        object.__setattr__(self, "triangles", np.array(t))
        super().__post_init__()

    def __repr__(self) -> str:
        return f"Pipes({len(self.quads)} biquadratic patches, {len(self.triangles)} triangles)"

    def mesh(self, n: int = 4) -> SurfaceMesh:
        """Triangles whose vertices lie on the patches.

        Parameters
        ----------
        n : int
            Pieces of each side of a patch.

        Returns
        -------
        SurfaceMesh
            Closed, and of the right orientation.

        Raises
        ------
        GeometryError
            If patches do not meet, as they do when made by `pipes`.
        """
        n = as_whole("n", n, 1, 64)
        t = np.arange(n + 1) / n
        b = np.stack([(1 - t) ** 2, 2 * t * (1 - t), t**2], axis=1)
        points = np.einsum("ui,vj,qijx->quvx", b, b, self.quads).reshape(-1, 3)
        at = np.arange((n + 1) ** 2).reshape(n + 1, n + 1)
        a, c, d, e = (v.ravel() for v in (at[:-1, :-1], at[1:, :-1], at[1:, 1:], at[:-1, 1:]))
        cell = np.concatenate([np.stack([a, c, d], 1), np.stack([a, d, e], 1)])
        faces = (cell + (n + 1) ** 2 * np.arange(len(self.quads))[:, None, None]).reshape(-1, 3)
        bary, small = _triangle(n)
        i, j, k = bary.T / n
        weights = np.stack([i * i, j * j, k * k, 2 * i * j, 2 * j * k, 2 * k * i], axis=1)
        more = np.einsum("pc,tcx->tpx", weights, self.triangles).reshape(-1, 3)
        step = len(bary) * np.arange(len(self.triangles))[:, None, None]
        faces = np.concatenate([faces, len(points) + (small + step).reshape(-1, 3)])
        x, number = _welded(np.concatenate([points, more]))
        faces = number[faces]
        sound = (faces != np.roll(faces, 1, axis=1)).all(axis=1)
        out = SurfaceMesh(x, faces[sound])
        if not out.is_watertight:
            raise GeometryError("patches do not meet: edges of neighbours have other controls")
        return out

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write the patches, exactly: VTU (Bezier cells) or ITD (IRIT).

        Parameters
        ----------
        path : path-like
            File to write; its ending names the format.
        """
        save(self, path)


def pipes(k: Structure, radius: Any) -> Pipes:
    """Edges of a structure as smooth pipes.

    Parameters
    ----------
    k : CornerSharing
        In space, with at most six edges at each vertex.
    radius : float, array_like or callable
        As of `CornerSharing.beams`; that of a vertex is the mean of those of its edges there.

    Returns
    -------
    Pipes
        The surface.

    Raises
    ------
    InputError
        For a structure in the plane, or a vertex with more than six edges.
    GeometryError
        If edges at a vertex lie too much on one side (vertices that are far from balanced), or
        beams of these radii close all faces of a simplex.
    """
    as_kind("k", k, "CornerSharing")
    if k.dim != 3:
        raise InputError("pipes are for structures in space")
    edges, x = k.edges, np.array(k.positions)
    if not len(edges):
        raise GeometryError("the structure has no edges, so no pipes")
    r = radii_of(k, x, radius)
    count = np.bincount(edges.ravel(), minlength=len(x))
    if count.max() > 6:
        v = int(count.argmax())
        raise InputError(f"vertex {v} has {count[v]} edges, pipes join at most 6: use beams")
    used = np.flatnonzero(count)
    size = np.bincount(edges.ravel(), weights=r.ravel(), minlength=len(x)) / np.maximum(count, 1)
    if (r <= 0.0).any():
        raise InputError(f"radii must be positive, got {r.min():g}")
    check_swallowed(k, r)
    way = x[edges[:, 1]] - x[edges[:, 0]]
    way /= np.linalg.norm(way, axis=1)[:, None]
    slot = np.full((len(edges), 2), -1)
    cube, hand = np.empty((len(x), 8, 3)), np.ones(len(x))
    closing, bad = [], []
    for v, own in zip(used.tolist(), _incident(k, used), strict=True):
        directions = np.where((edges[own, 0] == v)[:, None], way[own], -way[own])
        where, six, sine = _assigned(directions)
        bad += [v] if sine < FLAT else []
        slot[own, np.where(edges[own, 0] == v, 0, 1)] = where
        cube[v] = x[v] + size[v] / ROUND / np.sqrt(2.0 / 3.0) * _corners_at(six)
        hand[v] = 1.0 if np.linalg.det(six[:3]) > 0.0 else -1.0
        closing += [(v, s) for s in range(6) if s not in where]
    if bad:
        raise GeometryError(
            f"at vertex {bad[0]} ({len(bad)} of {len(used)} are so) the edges lie so much on one "
            "side that they cannot leave a cube by its faces, as those of balanced structures do: "
            "use beams"
        )
    quads = [_half_beams(k, x, r, way, slot, cube, hand), _caps(closing, cube, hand)]
    return Pipes(np.concatenate(quads), _triangles(used, cube, hand))


def _incident(k: Structure, used: IntArray) -> list[IntArray]:
    """Edges at each used vertex, those of its first simplex first."""
    ends = k.edges.ravel()
    order = np.argsort(ends, kind="stable")
    first = np.searchsorted(ends[order], used)
    last = np.searchsorted(ends[order], used, side="right")
    return [order[a:b] // 2 for a, b in zip(first, last, strict=True)]


def _assigned(directions: FloatArray) -> tuple[IntArray, FloatArray, float]:
    """Slots (n,) of the beams at a vertex, directions (6, 3) of the slots, and the least sine.

    The first three, edges of one simplex, take +x +y +z, the others what faces them best; where a
    ring of corners does not run round its beam then, the best of all ways is taken.
    """
    n, padded = len(directions), _padded(directions)
    first = np.array([(0, 1, 2, *(3 + np.array(p))) for p in permutations(range(3))])
    facing = np.einsum("pix,ix->p", padded[first[:, 3:]], padded[:3])
    order = first[facing.argmin()]
    sine = float(_sines(padded, order[None], n)[0])
    if sine < SOUND:
        ways = np.array(list(permutations(range(6))))
        sines = _sines(padded, ways, n)
        order, sine = ways[sines.argmax()], float(sines.max())
    return np.argsort(order)[:n], padded[order], sine


def _padded(directions: FloatArray) -> FloatArray:
    """Six directions: those given, then opposites of those that have none."""
    out = directions
    if len(out) < 3:
        out = np.concatenate([out, np.linalg.svd(out)[2][len(out) :]])
    while len(out) < 6:
        own = out[:3] if len(out) == 3 else out
        alone = (own @ out.T).min(axis=1)
        out = np.concatenate([out, -own[[int(alone.argmax())]]])
    return np.asarray(out)


def _corners_at(six: FloatArray) -> FloatArray:
    """Directions (..., 8, 3) of the corners of cubes whose faces look along `six` (..., 6, 3)."""
    rows = np.where(CORNERS > 0, 0, 3) + np.arange(3)
    sums = six[..., rows, :].sum(axis=-2)
    length = np.linalg.norm(sums, axis=-1, keepdims=True)
    return np.asarray(np.where(length > SHORT, sums / np.maximum(length, SHORT), 0.0))


def _sines(padded: FloatArray, ways: IntArray, n: int) -> FloatArray:
    """Least sines (p,) between neighbouring corners of faces, seen along their beams."""
    six = padded[ways]
    hand = np.sign(np.linalg.det(six[:, :3]))
    ring = _corners_at(six)[:, FACES]
    along = six[:, :, None]
    ring = ring - (ring * along).sum(axis=-1, keepdims=True) * along
    wide = np.linalg.norm(ring, axis=-1, keepdims=True)
    ring = np.where(wide > SHORT, ring / np.maximum(wide, SHORT), 0.0)
    turn = np.cross(ring, np.roll(ring, -1, axis=2))
    sine = ((turn * along).sum(axis=-1) * hand[:, None, None]).min(axis=-1)
    return np.asarray(np.where(ways < n, sine, 1.0).min(axis=1))


def _half_beams(
    k: Structure, x: FloatArray, r: FloatArray, way: FloatArray, slot: IntArray,
    cube: FloatArray, hand: FloatArray,
) -> FloatArray:  # fmt: skip
    """Patches (8 e, 3, 3, 3) around both halves of all edges."""
    edges, length = k.edges, k.lengths
    rings, ways = [], []
    for end, sign in ((0, 1.0), (1, -1.0)):
        v = edges[:, end]
        at = cube[v[:, None], FACES[slot[:, end]]]  # counter-clockwise from outside
        turned = (hand[v] * sign) < 0.0  # so that all run counter-clockwise about the edge's way
        at = np.where(turned[:, None, None], at[:, ::-1], at)
        out = at - x[v][:, None]
        out -= np.einsum("eix,ex->ei", out, way)[..., None] * way[:, None]
        norm = np.linalg.norm(out, axis=2, keepdims=True)
        rings.append(at)
        ways.append(out / np.maximum(norm, 1e-300))
    turn = (np.arange(4) + _least_twist(*ways)[:, None]) % 4
    for group in (rings, ways):
        group[1] = np.take_along_axis(group[1], turn[..., None], axis=1)
    square = _square(ways, way)
    own = [
        (x[edges[:, end]] + (sign * 0.25 * length)[:, None] * way)[:, None]
        + (r[:, end] / ROUND)[:, None, None] * square
        for end, sign in ((0, 1.0), (1, -1.0))
    ]
    middle = 0.5 * (own[0] + own[1])
    patches = []
    for end in (0, 1):
        rows = np.stack([rings[end], own[end], middle], axis=1)  # (e, 3, 4, 3)
        half = 0.5 * (rows + np.roll(rows, -1, axis=2))
        net = np.stack([np.roll(half, 1, axis=2), rows, half], axis=3)  # (e, 3, 4, 3, 3)
        net = np.moveaxis(net, 2, 1)
        patches.append(net[:, :, ::-1] if end == 0 else net)
    return np.concatenate(patches).reshape(-1, 3, 3, 3)


def _square(rings: list[FloatArray], way: FloatArray) -> FloatArray:
    """Square of directions (e, 4, 3) across edges, turned to be nearest to rings at both ends.

    The radius of a pipe is that of its beam only where the controls around it are a square.
    """
    u = rings[0][:, 0]
    v = np.cross(way, u)
    turn = 1j ** np.arange(4)
    off = np.zeros(len(u), np.complex128)
    for ring in rings:
        along, across = (np.einsum("eix,ex->ei", ring, w) for w in (u, v))
        off += ((along + 1j * across) / turn).sum(axis=1)
    off /= np.maximum(np.abs(off), 1e-300)
    at = off[:, None] * turn
    return np.asarray(at.real[..., None] * u[:, None] + at.imag[..., None] * v[:, None])


def _least_twist(a: FloatArray, b: FloatArray) -> IntArray:
    """Cyclic shifts (e,) of the rings b that bring them nearest to the rings a."""
    off = [((a - np.roll(b, -s, axis=1)) ** 2).sum(axis=(1, 2)) for s in range(4)]
    return np.argmin(off, axis=0)


def _caps(closing: list[tuple[int, int]], cube: FloatArray, hand: FloatArray) -> FloatArray:
    """Patches (c, 3, 3, 3) over the faces of cubes that have no beam."""
    if not closing:
        return np.empty((0, 3, 3, 3))
    v, s = np.array(closing).T
    c = cube[v[:, None], FACES[s]]
    m = 0.5 * (c + np.roll(c, -1, axis=1))  # between corners i and i + 1
    net = np.empty((len(v), 3, 3, 3))
    net[:, 0, 0], net[:, 2, 0], net[:, 2, 2], net[:, 0, 2] = np.moveaxis(m, 1, 0)
    net[:, 1, 0], net[:, 2, 1], net[:, 1, 2], net[:, 0, 1] = np.moveaxis(
        np.roll(c, -1, axis=1), 1, 0
    )
    net[:, 1, 1] = c.mean(axis=1)
    return np.where((hand[v] > 0.0)[:, None, None, None], net, np.swapaxes(net, 1, 2))


def _triangles(used: IntArray, cube: FloatArray, hand: FloatArray) -> FloatArray:
    """Quadratic triangles (8 n, 6, 3) at the corners of cubes."""
    out = np.empty((len(used), 8, 6, 3))
    for i, signs in enumerate(CORNERS):
        c = cube[used, i]
        for a in range(3):
            flipped = signs.copy()
            flipped[a] *= -1
            j = int(np.flatnonzero((flipped == CORNERS).all(axis=1))[0])
            out[:, i, a] = 0.5 * (c + cube[used, j])
        out[:, i, 3:] = c[:, None]
    turned = np.prod(CORNERS, axis=1) * hand[used][:, None] < 0.0
    other = out[:, :, [0, 2, 1, 5, 4, 3]]
    return np.where(turned[:, :, None, None], other, out).reshape(-1, 6, 3)


def _triangle(n: int) -> tuple[IntArray, IntArray]:
    """Barycentric integers (p, 3) of a triangle in n pieces per side, and its small triangles."""
    bary = np.array([(n - i - j, i, j) for i in range(n + 1) for j in range(n + 1 - i)])
    number = {tuple(b): p for p, b in enumerate(bary[:, 1:].tolist())}
    faces = []
    for i, j in number:
        if i + j < n:
            faces.append((number[i, j], number[i + 1, j], number[i, j + 1]))
        if i + j < n - 1:
            faces.append((number[i + 1, j], number[i + 1, j + 1], number[i, j + 1]))
    return bary, np.array(faces)


def _welded(points: ArrayLike) -> tuple[FloatArray, AnyArray]:
    """Points without those that repeat others up to rounding, and the number of each."""
    x = as_array("points", points)
    near = cKDTree(x).query_pairs(WELD * float(np.ptp(x, axis=0).max()), output_type="ndarray")
    graph = coo_array((np.ones(len(near)), near.T), shape=(len(x), len(x)))
    _, label = connected_components(graph, directed=False)
    first = np.unique(label, return_index=True)[1]
    return x[first], label
