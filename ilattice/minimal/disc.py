"""Triangulated discs over polygons, and what the area says about their vertices.

A disc over N sides is a fan of N sectors about a centre, each cut into n² triangles. Vertices come
ring by ring: ring r holds N r of them, the last ring is the boundary, and side s of it runs from
corner s to corner s + 1.

Guarantees: gradient and Hessian are those of the area of the triangles, not of a surface that they
stand for; all is vectorised, and takes memory proportional to the number of triangles.
"""

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from scipy import sparse

from ilattice._typing import FloatArray, IntArray
from ilattice._validate import FrozenCopies, as_whole, read_only
from ilattice.errors import InputError

#: Most vertices of one disc; a factorization takes some 2 kB for each.
MAX_VERTICES = 500_000
_NEXT, _LAST = (1, 2, 0), (2, 0, 1)


@dataclass(frozen=True)
class Disc(FrozenCopies):
    """A fan of N sectors, each cut into n² triangles.

    Attributes
    ----------
    sides : int
        Number N of sides.
    n : int
        Edges per side.
    """

    sides: int
    n: int

    @classmethod
    def checked(cls, sides: int, n: Any) -> "Disc":
        """A disc that is neither too coarse nor too fine.

        Parameters
        ----------
        sides : int
            Number of sides.
        n : int
            Edges per side, at least 2.

        Returns
        -------
        Disc
            The disc.

        Raises
        ------
        InputError
            If `n` is not a whole number of at least 2, or there would be too many vertices.
        """
        n = as_whole("n", n, 2, 1 << 20)
        disc = cls(sides, n)
        if disc.count > MAX_VERTICES:
            raise InputError(
                f"n must leave at most {MAX_VERTICES} vertices, got {n}: {sides} sides make "
                f"{disc.count} vertices, some {disc.count * 2e-6:.3g} GB; n={disc.finest()} fits"
            )
        return disc

    def finest(self) -> int:
        """Most edges per side.

        Returns
        -------
        int
            The largest n that is accepted for this number of sides.
        """
        return int(np.sqrt(2.0 * MAX_VERTICES / self.sides)) - 1

    @property
    def count(self) -> int:
        """Number of vertices."""
        return 1 + self.sides * self.n * (self.n + 1) // 2

    @property
    def boundary(self) -> int:
        """Number of the first vertex of the boundary, corner 0; the rest follows in order."""
        return self.count - self.sides * self.n

    @cached_property
    def faces(self) -> IntArray:
        """Corners of the triangles, shape (N n², 3)."""
        parts = []
        for r in range(1, self.n + 1):
            s, j = np.divmod(np.arange(self.sides * r), r)
            outer, inner = self._ring(r, s * r + j), self._ring(r - 1, s * (r - 1) + j)
            after = self._ring(r, s * r + j + 1)
            parts.append(np.stack([inner, outer, after], axis=1))
            more = j < r - 1
            beside = self._ring(r - 1, s * (r - 1) + j + 1)
            parts.append(np.stack([inner, after, beside], axis=1)[more])
        faces: IntArray = read_only(np.concatenate(parts))
        return faces

    @cached_property
    def side_rows(self) -> IntArray:
        """Vertices of the sides, both corners included, shape (N, n + 1)."""
        k = np.arange(self.sides)[:, None] * self.n + np.arange(self.n + 1)
        rows: IntArray = read_only(self.boundary + k % (self.sides * self.n))
        return rows

    @cached_property
    def flat(self) -> FloatArray:
        """Vertices over the regular polygon with unit radius, shape (V, 3)."""
        turn = 2.0 * np.pi * np.arange(self.sides) / self.sides
        corners = np.stack([np.cos(turn), np.sin(turn), np.zeros(self.sides)], axis=1)
        vertices: FloatArray = read_only(self.fan(np.zeros(3), corners))
        return vertices

    @cached_property
    def nested(self) -> IntArray:
        """Vertices of every other ring and step: those of the disc of half as many edges."""
        rings = range(1, self.n // 2 + 1)
        rows = [self._ring(2 * r, 2 * np.arange(self.sides * r)) for r in rings]
        out: IntArray = read_only(np.concatenate([np.zeros(1, np.int64), *rows]))
        return out

    def fan(self, centre: FloatArray, corners: FloatArray) -> FloatArray:
        """Vertices of the flat sectors between a centre and corners.

        Parameters
        ----------
        centre : (3,) array
            Middle of the fan.
        corners : (N, 3) array
            Corners of the polygon.

        Returns
        -------
        (V, 3) array
            Vertices.
        """
        rings = [centre + (r / self.n) * (along(corners, r) - centre) for r in range(1, self.n + 1)]
        return np.concatenate([centre[None, :], *rings])

    def finer(self, n: int, values: FloatArray) -> FloatArray:
        """Values at the vertices of another disc of as many sides, linear in the triangles.

        Parameters
        ----------
        n : int
            Edges per side of the other disc.
        values : (V, c) array
            Values at the vertices of this one.

        Returns
        -------
        (W, c) array
            Values at the vertices of the other.
        """
        r = np.repeat(np.arange(1, n + 1), self.sides * np.arange(1, n + 1))
        k = np.concatenate([np.arange(self.sides * ring) for ring in range(1, n + 1)])
        s, j = np.divmod(k, r)
        whole, part = np.divmod(np.stack([r - j, j]) * self.n, n)
        a, b = whole
        x, y = part / n
        upper = x + y > 1.0
        first = self._at(s, a + upper, b + upper)
        right, left = self._at(s, a + 1, b), self._at(s, a, b + 1)
        wx, wy = np.where(upper, 1.0 - y, x)[:, None], np.where(upper, 1.0 - x, y)[:, None]
        rest = (1.0 - wx - wy) * values[first]
        out: FloatArray = rest + wx * values[right] + wy * values[left]
        return np.concatenate([values[:1], out])

    def _at(self, s: IntArray, a: IntArray, b: IntArray) -> IntArray:
        """Vertex of sector s, a steps towards its first and b towards its second corner."""
        ring = np.clip(a + b, 0, self.n)
        count = 1 + self.sides * ring * (ring - 1) // 2
        turn = s * ring + np.minimum(b, ring)
        number: IntArray = np.where(ring > 0, count + turn % np.maximum(self.sides * ring, 1), 0)
        return number

    def _ring(self, r: int, k: IntArray) -> IntArray:
        """Number of the k-th vertex of ring r."""
        if r == 0:
            return np.zeros_like(k)
        first: IntArray = 1 + self.sides * r * (r - 1) // 2 + k % (self.sides * r)
        return first


def along(corners: FloatArray, n: int) -> FloatArray:
    """Points of a closed polygon.

    Parameters
    ----------
    corners : (N, 3) array
        Its corners.
    n : int
        Equal steps per side.

    Returns
    -------
    (N n, 3) array
        Points, starting from the first corner.
    """
    t = (np.arange(n) / n)[None, :, None]
    after = np.roll(corners, -1, axis=0)
    points: FloatArray = ((1.0 - t) * corners[:, None] + t * after[:, None]).reshape(-1, 3)
    return points


def opposite_edges(v: FloatArray, faces: IntArray) -> FloatArray:
    """Edges of triangles.

    Parameters
    ----------
    v : (V, 3) array
        Vertices.
    faces : (F, 3) array
        Corners.

    Returns
    -------
    (F, 3, 3) array
        Row a is the edge opposite of corner a, running counter-clockwise.
    """
    p = v[faces]
    edges: FloatArray = p[:, _LAST] - p[:, _NEXT]
    return edges


def area_vectors(v: FloatArray, faces: IntArray) -> FloatArray:
    """Normals of triangles, twice as long as their areas.

    Parameters
    ----------
    v : (V, 3) array
        Vertices.
    faces : (F, 3) array
        Corners.

    Returns
    -------
    (F, 3) array
        Their lengths are twice the areas.
    """
    p = v[faces]
    w: FloatArray = np.cross(p[:, 1] - p[:, 0], p[:, 2] - p[:, 0])
    return w


def area(v: FloatArray, faces: IntArray) -> float:
    """Area of all triangles.

    Parameters
    ----------
    v : (V, 3) array
        Vertices.
    faces : (F, 3) array
        Corners.

    Returns
    -------
    float
        Their sum.
    """
    return 0.5 * float(np.linalg.norm(area_vectors(v, faces), axis=1).sum())


def vertex_areas(v: FloatArray, faces: IntArray) -> FloatArray:
    """A third of the area of all triangles about each vertex.

    Parameters
    ----------
    v : (V, 3) array
        Vertices.
    faces : (F, 3) array
        Corners.

    Returns
    -------
    (V,) array
        Areas.
    """
    third = np.linalg.norm(area_vectors(v, faces), axis=1) / 6.0
    return np.asarray(np.bincount(faces.ravel(), np.repeat(third, 3), len(v)), np.float64)


def vertex_normals(v: FloatArray, faces: IntArray) -> FloatArray:
    """Unit normals at the vertices, weighted by the angles of the triangles.

    Parameters
    ----------
    v : (V, 3) array
        Vertices.
    faces : (F, 3) array
        Corners.

    Returns
    -------
    (V, 3) array
        Normals; zero where nothing is known.
    """
    e = opposite_edges(v, faces)
    w = area_vectors(v, faces)
    double = np.linalg.norm(w, axis=1)
    unit = w / np.maximum(double, 1e-300)[:, None]
    dots = -np.einsum("fac,fac->fa", e[:, _NEXT], e[:, _LAST])
    weighted = np.arctan2(double[:, None], dots)[:, :, None] * unit[:, None, :]
    return unit_rows(gathered(weighted, faces, len(v)))


def unit_rows(a: FloatArray) -> FloatArray:
    """Rows of unit length.

    Parameters
    ----------
    a : (n, 3) array
        Vectors.

    Returns
    -------
    (n, 3) array
        Unit vectors; rows of zeros stay.
    """
    length = np.linalg.norm(a, axis=1, keepdims=True)
    return np.divide(a, length, out=np.zeros_like(a), where=length > 1e-300)


def gathered(parts: FloatArray, faces: IntArray, count: int) -> FloatArray:
    """Sums over the corners of triangles.

    Parameters
    ----------
    parts : (F, 3, 3) array
        A vector for every corner.
    faces : (F, 3) array
        Corners.
    count : int
        Number of vertices.

    Returns
    -------
    (V, 3) array
        Sums at the vertices.
    """
    rows = faces.ravel()
    flat = parts.reshape(-1, 3)
    return np.stack([np.bincount(rows, flat[:, c], count) for c in range(3)], axis=1)


def cotangents(v: FloatArray, faces: IntArray) -> Any:
    """The cotangent Laplacian: the gradient of the area is this matrix times the vertices.

    Parameters
    ----------
    v : (V, 3) array
        Vertices.
    faces : (F, 3) array
        Corners.

    Returns
    -------
    (V, V) sparse array
        Symmetric, positive semidefinite, rows sum to zero.
    """
    e = opposite_edges(v, faces)
    double = np.linalg.norm(np.cross(e[:, 0], e[:, 1]), axis=1)
    blocks = np.einsum("fac,fbc->fab", e, e) / (2.0 * np.maximum(double, 1e-300))[:, None, None]
    return assembled(blocks, faces, len(v))


def area_hessian(v: FloatArray, faces: IntArray, directions: FloatArray) -> Any:
    """Second derivatives of the area where every vertex moves in a direction of its own.

    Parameters
    ----------
    v : (V, 3) array
        Vertices.
    faces : (F, 3) array
        Corners.
    directions : (V, 3) array
        Direction of every vertex.

    Returns
    -------
    (V, V) sparse array
        Symmetric.
    """
    e, d = opposite_edges(v, faces), directions[faces]
    w = area_vectors(v, faces)
    double = np.maximum(np.linalg.norm(w, axis=1), 1e-300)
    n = w / double[:, None]
    turned = np.cross(e, d)
    turned -= np.einsum("fac,fc->fa", turned, n)[:, :, None] * n[:, None, :]
    blocks = np.einsum("fac,fbc->fab", turned, turned) / double[:, None, None]
    for a, b in ((0, 1), (1, 2), (2, 0)):
        mixed = np.einsum("fc,fc->f", n, np.cross(d[:, a], d[:, b]))
        blocks[:, a, b] += mixed
        blocks[:, b, a] += mixed
    return assembled(0.5 * blocks, faces, len(v))


def assembled(blocks: FloatArray, faces: IntArray, count: int) -> Any:
    """Sum of matrices of triangles.

    Parameters
    ----------
    blocks : (F, 3, 3) array
        Matrix of every triangle.
    faces : (F, 3) array
        Corners.
    count : int
        Number of vertices.

    Returns
    -------
    (V, V) sparse array
        The sum, in compressed columns.
    """
    rows, columns = np.repeat(faces, 3, axis=1), np.tile(faces, (1, 3))
    at = (rows.ravel(), columns.ravel())
    return sparse.coo_array((blocks.ravel(), at), shape=(count, count)).tocsc()
