"""How the patches of an MFEM mesh hang together, and where each finds its control points.

In the form with shared knot vectors, control points are numbered over the whole mesh: one per
vertex, then those inside the edges, the faces and the patches. Those inside an edge run from its
vertex of lower number to that of higher number; those inside a face run as in the first patch that
has the face (first and second vertex of `FACES` span the fast direction, first and fourth the
slow one); edges are numbered as listed in the file, faces as they first appear. (Read from
``NURBSExtension::GenerateOffsets`` and ``Mesh::GetElementToFaceTable``; the rules hold for the
files of the MFEM project, whose shared faces coincide and whose Jacobians keep one sign.)

Guarantee: every control point of every patch gets exactly one number, or `FormatError` is raised.
Not guaranteed: meshes in which two edges join the same two vertices are refused.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import NoReturn

import numpy as np

from ilattice._typing import IntArray
from ilattice.io._patches import check_count
from ilattice.io._scanner import Scanner

_PER_PATCH = 250  # letters for each patch of many: what they share takes memory, too
#: Edges of a hexahedron.
_MAX_EDGES = 12

#: Codes of point, segment, square and cube, by dimension.
GEOMETRY = (0, 1, 3, 5)
#: Corners of the reference cube in the order of MFEM (and VTK).
CORNERS = (
    (0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0), (0, 0, 1), (1, 0, 1), (1, 1, 1), (0, 1, 1),
)  # fmt: skip
#: Corners of its faces, outward, in the order of MFEM.
FACES = ((3, 2, 1, 0), (0, 1, 5, 4), (1, 2, 6, 5), (2, 3, 7, 6), (3, 0, 4, 7), (4, 5, 6, 7))
#: Pairs of corners that differ in one direction, in its sense: square and cube.
PARALLEL = {
    2: (((0, 1), (3, 2)), ((0, 3), (1, 2))),
    3: (
        ((0, 1), (3, 2), (4, 5), (7, 6)),
        ((0, 3), (1, 2), (4, 7), (5, 6)),
        ((0, 4), (1, 5), (2, 6), (3, 7)),
    ),
}


@dataclass(frozen=True)
class NumberedPatch:
    """Knot vectors and control points of one patch.

    Parameters
    ----------
    vectors : tuple of (int, bool)
        Number of the knot vector per direction, and whether it runs backwards.
    dofs : ndarray of int, shape (n0[, n1[, n2]])
        Numbers of the control points.
    """

    vectors: tuple[tuple[int, bool], ...]
    dofs: IntArray


@dataclass(frozen=True)
class Topology:
    """Elements and edges of the mesh of patches.

    Parameters
    ----------
    ndim : int
        Number of parameters.
    elements : list of tuple of int
        Vertices of each patch.
    edges : list of tuple of int
        Knot vector, first and last vertex of each edge.
    vertices : int
        Number of vertices.
    """

    ndim: int
    elements: list[tuple[int, ...]]
    edges: list[tuple[int, int, int]]
    vertices: int

    def number(
        self, sizes: Sequence[int], room: int, fail: Callable[[str], NoReturn]
    ) -> tuple[int, list[NumberedPatch]]:
        """Number the control points of all patches.

        Parameters
        ----------
        sizes : sequence of int
            Number of control points per knot vector.
        room : int
            Largest number of control points that the file can mean, over all patches.
        fail : callable
            Raises the `FormatError`.

        Returns
        -------
        int
            Number of control points.
        list of NumberedPatch
            The patches.
        """
        return _Numbering(self, sizes, room, fail).run()


def read_topology(scanner: Scanner) -> Topology:
    """Sections from ``dimension`` to ``vertices``.

    Parameters
    ----------
    scanner : Scanner
        Stands at ``dimension``; stands behind the number of vertices afterwards.

    Returns
    -------
    Topology
        Elements, edges, number of vertices; boundary elements are passed over.
    """
    scanner.expect("dimension")
    ndim = scanner.integer("dimension", 1, 3)
    scanner.expect("elements")
    count = scanner.integer("number of elements", 1)
    check_count(scanner.fail, min(count, scanner.left) - 1, scanner.size, _PER_PATCH)
    elements = [_element(scanner, ndim) for _ in range(count)]
    scanner.expect("boundary")
    for _ in range(scanner.integer("number of boundary elements")):
        _element(scanner, ndim - 1)
    scanner.expect("edges")
    count = scanner.integer("number of edges")
    if count > _MAX_EDGES * len(elements):
        scanner.fail(f"{count} edges are more than {len(elements)} patches have", scanner.at - 1)
    edges = [(_vertex(scanner), _vertex(scanner), _vertex(scanner)) for _ in range(count)]
    scanner.expect("vertices")
    vertices = scanner.integer("number of vertices", 1)
    for used in (*elements, *(e[1:] for e in edges)):
        if max(used) >= vertices:
            scanner.fail(f"vertex {max(used)} is used, but there are only {vertices} vertices")
    return Topology(ndim, elements, edges, vertices)


def _element(scanner: Scanner, ndim: int) -> tuple[int, ...]:
    scanner.integer("attribute", -(10**9), 10**9)
    code = GEOMETRY[ndim]
    scanner.integer(f"geometry {code}", code, code)
    corners = tuple(_vertex(scanner) for _ in range(2**ndim))
    if len(set(corners)) != len(corners):
        scanner.fail(f"element with vertices {corners}: a vertex is repeated", scanner.at - 1)
    return corners


def _vertex(scanner: Scanner) -> int:
    return scanner.integer("number of a vertex or knot vector", 0, 10**9)


class _Numbering:
    """One run of the numbering rules."""

    def __init__(
        self, mesh: Topology, sizes: Sequence[int], room: int, fail: Callable[[str], NoReturn]
    ) -> None:
        self.mesh, self.sizes, self.room, self.fail = mesh, sizes, room, fail
        self.next = mesh.vertices
        self.edge_at: dict[int, int] = {}  # as packed by `_edge`
        self.face_at: dict[frozenset[int], tuple[int, tuple[int, ...], tuple[int, int]]] = {}
        self.face_uses: dict[frozenset[int], int] = {}

    def run(self) -> tuple[int, list[NumberedPatch]]:
        """Number edges, faces and patches, in this order."""
        if self.mesh.ndim == 1:
            self.fail("curves are read in the patches form only")
        if not self.mesh.edges:
            self.fail("no edges are listed, so knot vectors cannot be told; list the edges")
        for vector, first, last in self.mesh.edges:
            self._edge(vector, first, last)
        vectors = [self._vectors(e) for e in self.mesh.elements]
        shapes = [tuple(self.sizes[v] for v, _ in own) for own in vectors]
        if self.mesh.vertices > self.room or sum(map(math.prod, shapes)) > self.room:
            self.fail("the patches have more control points than the file has numbers")
        if self.mesh.ndim == 3:
            for element, shape in zip(self.mesh.elements, shapes, strict=True):
                self._faces(element, shape)
        patches = []
        for element, own, shape in zip(self.mesh.elements, vectors, shapes, strict=True):
            patches.append(NumberedPatch(own, self._dofs(element, shape)))
        if self.next > self.room:
            self.fail(f"{self.next} control points are more than the file has numbers")
        return self.next, patches

    def _edge(self, vector: int, first: int, last: int) -> None:
        key = _key(first, last)
        if vector >= len(self.sizes):
            self.fail(f"an edge has knot vector {vector}, there are only {len(self.sizes)}")
        if first == last or key in self.edge_at:
            self.fail(f"two edges join the vertices {first} and {last}, or they are equal")
        self.edge_at[key] = (self.next * len(self.sizes) + vector) * 2 + (first > last)
        self.next += self.sizes[vector] - 2

    def _vectors(self, element: tuple[int, ...]) -> tuple[tuple[int, bool], ...]:
        """Knot vector and sense per direction; the parallel edges must agree."""
        out = []
        for axis in range(self.mesh.ndim):
            found = set()
            for i, j in PARALLEL[self.mesh.ndim][axis]:
                key = _key(element[i], element[j])
                if key not in self.edge_at:
                    self.fail(f"the edge from vertex {element[i]} to {element[j]} is not listed")
                vector = self.edge_at[key] // 2 % len(self.sizes)
                backwards = bool(self.edge_at[key] % 2)
                found.add((vector, backwards != (element[i] > element[j])))
            if len(found) != 1:
                self.fail(f"patch {element}: edges of direction {axis} differ in knots or sense")
            out.append(found.pop())
        return tuple(out)

    def _faces(self, element: tuple[int, ...], shape: tuple[int, ...]) -> None:
        """Number the faces that appear first here."""
        for face in FACES:
            corners = tuple(element[i] for i in face)
            key = frozenset(corners)
            self.face_uses[key] = self.face_uses.get(key, 0) + 1
            if self.face_uses[key] > 2:
                self.fail(f"face {corners} belongs to more than two patches")
            if key not in self.face_at:
                fast, slow = (_axis(face[0], face[i]) for i in (1, 3))
                size = (shape[fast] - 2, shape[slow] - 2)
                self.face_at[key] = (self.next, corners, size)
                self.next += size[0] * size[1]

    def _dofs(self, element: tuple[int, ...], shape: tuple[int, ...]) -> IntArray:
        """Numbers of the control points of one patch."""
        dofs = np.full(shape, -1, dtype=np.int64)
        ends = {v: tuple(c[: self.mesh.ndim]) for v, c in zip(element, CORNERS, strict=False)}
        for vertex, corner in ends.items():
            dofs[tuple(-c for c in corner)] = vertex
        for axis in range(self.mesh.ndim):
            for i, j in PARALLEL[self.mesh.ndim][axis]:
                low, high = sorted((element[i], element[j]))
                start = self.edge_at[_key(low, high)] // 2 // len(self.sizes)
                _place(dofs, start, (shape[axis] - 2,), [ends[low], ends[high]])
        if self.mesh.ndim == 3:
            for face in FACES:
                start, corners, size = self.face_at[frozenset(element[i] for i in face)]
                if not _place(dofs, start, size, [ends[corners[i]] for i in (0, 1, 3)]):
                    self.fail(f"face {corners}: its two patches do not fit together")
        inner = tuple(n - 2 for n in shape)
        dofs[(slice(1, -1),) * len(shape)] = _consecutive(self.next, inner)
        self.next += math.prod(inner)
        return dofs


def _key(first: int, last: int) -> int:
    """One number for an edge, whichever of its vertices comes first."""
    return min(first, last) << 32 | max(first, last)


def _place(
    dofs: IntArray, start: int, size: tuple[int, ...], corners: list[tuple[int, ...]]
) -> bool:
    """Number what is inside an edge or a face, from corner 0 towards corners 1 (and 2)."""
    origin = corners[0]
    steps = [[a for a, c in enumerate(origin) if c != corner[a]] for corner in corners[1:]]
    if any(len(step) != 1 for step in steps):
        return False
    axes = [step[0] for step in steps]
    where: list[int | slice] = [-c for c in origin]
    for axis in axes:
        where[axis] = slice(1, -1)
    block = np.flip(
        _consecutive(start, size), tuple(i for i, axis in enumerate(axes) if origin[axis])
    )
    block = block if axes == sorted(axes) else block.T
    target = dofs[tuple(where)]
    if target.shape != block.shape:
        return False
    target[...] = block
    return True


def _consecutive(start: int, shape: tuple[int, ...]) -> IntArray:
    """Numbers from `start` on, first axis fastest."""
    return start + np.arange(math.prod(shape), dtype=np.int64).reshape(shape[::-1]).T


def _axis(i: int, j: int) -> int:
    """Direction in which two corners differ."""
    return next(a for a in range(3) if CORNERS[i][a] != CORNERS[j][a])
