"""Beams in boxes: which of them matter there, and smooth fields that have the same sign.

Where a box lies beside a beam, or beyond its end, the sign is that of a polynomial of degree two,
which analyses take exactly; elsewhere it is that of the distance. Beams that share a ball within a
box are one piece there, since their distances are equal in a part of it.

Guarantee: within a box the union of its pieces is the solid. Non-guarantee: creases within pieces
of several beams are those of an interpolant; boxes are halved until the volume is right.
"""

from dataclasses import dataclass
from typing import Any, TypeAlias

import numpy as np

from ilattice._field import as_boxes
from ilattice._typing import AnyArray, ArrayLike, FloatArray, IntArray
from ilattice._validate import as_points
from ilattice.cost import _kernels_beams as kernels
from ilattice.errors import InputError
from ilattice.fields._program import Builder, Point
from ilattice.fields.node import Node

#: Most beams of one box; where there are more it is halved.
MOST_PIECES = 16
#: The same after beams that meet there are taken together, and diagonals of boxes, in radii, below
#: which they may be: rules on boxes with more need many points.
MOST_JOINED, SMALL = 3, 1.0
#: Part of a beam's length by which boxes may reach beyond its end: rounding, not a piece.
EVEN = 1e-12
#: Sorts of pieces.
DISTANCE, SIDE, BALL = 0, 1, 2
#: A piece: its sort, and its beams in the order of the tree, or its vertex.
Piece: TypeAlias = tuple[int, ...]
#: Corners of a box, in halves of its lengths from its middle.
CORNERS = np.stack(np.meshgrid(*[[-1.0, 1.0]] * 3, indexing="ij"), -1).reshape(8, 3)


def corners(lo: ArrayLike, hi: ArrayLike) -> tuple[FloatArray, FloatArray]:
    """Corners (n, 3) of boxes, which may be infinite, checked."""
    a, b = as_points("lo", lo, finite=False), as_points("hi", hi, finite=False)
    if a.shape != b.shape:
        raise InputError(f"lo and hi must have one shape, got {a.shape} and {b.shape}")
    return a, b


def bounds(f: Any, lo: FloatArray, hi: FloatArray, moved: bool) -> FloatArray:
    """Bounds and steepness (n, 3) on boxes of a field that changes no faster than distances."""
    out = np.tile([-np.inf, np.inf, np.inf], (len(lo), 1))
    finite = np.isfinite(lo).all(axis=1) & np.isfinite(hi).all(axis=1)
    if finite.any():
        a, b = lo[finite], hi[finite]
        reach = 0.5 * np.linalg.norm(b - a, axis=1)
        v = f(0.5 * (a + b))
        slack = 1e-13 * (np.abs(v) + np.abs(a).max(axis=1) + np.abs(b).max(axis=1))
        out[finite, 0], out[finite, 1] = v - reach - slack, v + reach + slack
    if not moved:
        out[:, 2] = 1.0
    return out


# ------------------------------------------------------------------ which pieces


def parts_on(
    tree: tuple[AnyArray, ...], pairs: IntArray, radii: FloatArray, lo: FloatArray, hi: FloatArray
) -> list[tuple[Piece, ...] | None]:
    """Pieces that matter in boxes; None for those that are to be halved before."""
    reach = np.linalg.norm(hi - lo, axis=1) * (1.0 + 1e-9)
    rows = np.full((len(lo), MOST_PIECES), -1, np.int64)
    count = np.empty(len(lo), np.int64)
    middle = 0.5 * (lo + hi)
    box, wide, link, beam, order = tree
    kernels.among(len(lo), middle, reach, box, wide, link, beam, rows, count)
    first, last = _ends(beam[rows], middle, 0.5 * (hi - lo))
    least = np.where(rows >= 0, beam[rows, :2].min(axis=2), np.inf).min(axis=1)
    round_ = _round(pairs, radii)
    out: list[tuple[Piece, ...] | None] = []
    for k, c in enumerate(count.tolist()):
        if c > MOST_PIECES:
            out.append(None)
            continue
        part = zip(rows[k, :c].tolist(), first[k].tolist(), last[k].tolist(), strict=False)
        rows_of = [(i, *pairs[order[i]].tolist(), a, b) for i, a, b in part]
        out.append(_pieces(rows_of, round_, reach[k] <= SMALL * least[k]))
    return out


def _round(pairs: IntArray, radii: FloatArray) -> AnyArray:
    """Whether all beams at a vertex have one radius there: a ball that several of them share."""
    n = int(pairs.max()) + 1
    low, high = np.full(n, np.inf), np.full(n, -np.inf)
    np.minimum.at(low, pairs, radii)
    np.maximum.at(high, pairs, radii)
    return np.asarray(low == high)


def _ends(beam: FloatArray, middle: FloatArray, half: FloatArray) -> tuple[IntArray, IntArray]:
    """The parts of beams that boxes are nearest to, from first to last: 0 and 2 are the ends."""
    way = beam[..., 5:8] - beam[..., 2:5]
    length = np.linalg.norm(way, axis=2)
    s = np.clip((beam[..., 1] - beam[..., 0]) / length, -1.0, 1.0)
    steep = s / np.sqrt(np.maximum(1.0 - s * s, 1e-12))
    p = middle[:, None] - beam[..., 2:5]
    z = (p * way).sum(axis=2) / length
    off = np.sqrt(np.maximum((p * p).sum(axis=2) - z * z, 0.0))
    t = z + steep * off
    slack = (np.abs(way) * half[:, None]).sum(axis=2) / length
    slack = slack + np.abs(steep) * np.linalg.norm(half, axis=1)[:, None] - EVEN * length
    low, high = t - slack, t + slack
    first = np.where(low < 0.0, 0, np.where(low >= length, 2, 1))
    return first, np.where(high <= 0.0, 0, np.where(high > length, 2, 1))


def _pieces(
    rows: list[tuple[int, int, int, int, int]], round_: AnyArray, small: bool
) -> tuple[Piece, ...] | None:
    """Sides, balls that are part of no other piece, and beams, together where they meet in one."""
    balls, sides = set(), []
    touched: dict[int, set[int]] = {}
    held: set[int] = set()
    for i, a, b, first, last in rows:
        vertex = (a if last == 0 else b) if first == last != 1 else -1
        if vertex >= 0 and round_[vertex]:
            balls.add(vertex)
        elif first == last == 1:
            sides.append((SIDE, i))
        else:
            touched[i] = {v for v, at in ((a, first == 0), (b, last == 2)) if at}
            held |= touched[i]
    whole = _together(touched)
    if not small and (len(whole) + len(sides) > MOST_JOINED or any(len(g) > 1 for g in whole)):
        return None
    return (
        *sides,
        *((DISTANCE, *g) for g in whole),
        *((BALL, v) for v in sorted(balls - held)),
    )


def _together(touched: dict[int, set[int]]) -> list[tuple[int, ...]]:
    """Keys, those together that share something, directly or by others."""
    out: list[tuple[set[int], set[int]]] = []
    for i, mine in sorted(touched.items()):
        joined = [g for g in out if g[1] & mine]
        out = [g for g in out if g not in joined]
        out.append(({i}.union(*(g[0] for g in joined)), mine.union(*(g[1] for g in joined))))
    return sorted(tuple(sorted(g[0])) for g in out)


def part(
    tree: tuple[AnyArray, ...], vertices: FloatArray, pairs: IntArray, radii: FloatArray,
    piece: Piece,
) -> Node:  # fmt: skip
    """The field of a piece."""
    beam = tree[3]
    if piece[0] == BALL:
        v = piece[1]
        r = radii[tuple(np.argwhere(pairs == v)[0])]
        return _BeamQuadric(np.concatenate([[r, r], vertices[v], vertices[v]]))
    if piece[0] == SIDE:
        return _BeamQuadric(np.array(beam[piece[1]]))
    return _BeamDistance(np.array(beam[list(piece[1:])]))


# ------------------------------------------------------------------ their fields


@dataclass(frozen=True, eq=False)
class _BeamDistance(Node):
    """Distance to the union of beams (k, 8)."""

    rows: FloatArray

    def _emit(self, b: Builder, p: Point) -> int:
        return b.leaf(self, p)

    def values(self, points: FloatArray) -> FloatArray:
        """Values (n,) at points (n, 3)."""
        out = np.empty((len(self.rows), len(points)))
        for row, values in zip(self.rows, out, strict=True):
            kernels.single(len(points), np.array(points), np.array(row), values)
        return np.asarray(out.min(axis=0))

    def range(self, lo: ArrayLike, hi: ArrayLike) -> FloatArray:
        """Bounds (n, 2) on boxes."""
        return self.bounds_on(*as_boxes(lo, hi), True)[:, :2]

    def _box(self, level: float = 0.0) -> FloatArray:
        """Box about all balls."""
        reach = self.rows[:, :2, None] + max(level, 0.0)
        ends = self.rows[:, 2:].reshape(-1, 2, 3)
        return np.stack([(ends - reach).min(axis=(0, 1)), (ends + reach).max(axis=(0, 1))])

    def bounds_on(self, lo: FloatArray, hi: FloatArray, moved: bool) -> FloatArray:
        """Bounds and steepness (n, 3) on finite boxes; distances to beams are convex."""
        m, half = 0.5 * (lo + hi), 0.5 * (hi - lo)
        ends = (m[:, None] + half[:, None] * CORNERS).reshape(-1, 3)
        low, high = np.full(len(m), np.inf), np.full(len(m), np.inf)
        for row in self.rows:
            f, slope = _tangent(row, m)
            low = np.minimum(low, f - (np.abs(slope) * half).sum(axis=1))
            high = np.minimum(high, _tangent(row, ends)[0].reshape(-1, 8).max(axis=1))
        slack = 1e-15 * (np.abs(high) + np.abs(lo).max(axis=1) + np.abs(hi).max(axis=1))
        steep = np.full(len(m), np.inf if moved else 1.0)
        return np.column_stack([low - slack, high + slack, steep])


def _tangent(row: FloatArray, p: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Distances (n,) of points (n, 3) from one beam, and subgradients (n, 3)."""
    w, length, s = _axis(row)
    d = p - row[2:5]
    z = d @ w
    off = np.sqrt(np.maximum((d * d).sum(axis=1) - z * z, 0.0))
    t = np.clip(z + s / np.sqrt(max(1.0 - s * s, 1e-12)) * off, 0.0, length)
    d = d - t[:, None] * w
    reach = np.linalg.norm(d, axis=1)
    return reach - (row[0] + s * t), d / np.maximum(reach, 1e-300)[:, None]


def _axis(row: FloatArray) -> tuple[FloatArray, float, float]:
    """Direction, length, and growth of the radius of a beam."""
    way = row[5:8] - row[2:5]
    length = float(np.linalg.norm(way))
    if length == 0.0:
        return way, 0.0, 0.0
    return way / length, length, float(np.clip((row[1] - row[0]) / length, -1.0, 1.0))


@dataclass(frozen=True, eq=False)
class _BeamQuadric(Node):
    """A polynomial that is negative just in a ball, or in the cone beside a beam.

    That is (1 - s²) (|d|² - z²) - (r + s z)² over 2 r, with d from the first end, z its part along
    the axis, and the radius r + s z; near the surface it is about the distance.
    """

    row: FloatArray

    def _emit(self, b: Builder, p: Point) -> int:
        return b.leaf(self, p)

    def _form(self) -> tuple[FloatArray, FloatArray, float]:
        """Matrix, vector and number: d A d / 2 + b d + c."""
        w, _, s = _axis(self.row)
        r = self.row[0]
        matrix = (2.0 * (1.0 - s * s)) * (np.eye(3) - np.outer(w, w)) - 2.0 * s * s * np.outer(w, w)
        return matrix / (2.0 * r), -s * w, -0.5 * r

    def values(self, points: FloatArray) -> FloatArray:
        """Values (n,) at points (n, 3)."""
        A, b, c = self._form()
        d = points - self.row[2:5]
        return np.asarray(0.5 * ((d @ A) * d).sum(axis=1) + d @ b + c)

    def jets(self, points: FloatArray, order: int) -> tuple[FloatArray, ...]:
        """Values (n,), gradients (n, 3) and, for order 2, Hessians (n, 3, 3)."""
        A, b, _ = self._form()
        d = points - self.row[2:5]
        return (self.values(points), d @ A + b, np.tile(A, (len(points), 1, 1)))[: order + 1]

    def range(self, lo: ArrayLike, hi: ArrayLike) -> FloatArray:
        """Bounds (n, 2) on boxes."""
        return self.bounds_on(*as_boxes(lo, hi), True)[:, :2]

    def bounds_on(self, lo: FloatArray, hi: FloatArray, moved: bool) -> FloatArray:
        """Bounds and steepness (n, 3) on finite boxes."""
        del moved  # a polynomial has no largest slope
        A, b, c = self._form()
        m, half = 0.5 * (lo + hi) - self.row[2:5], 0.5 * (hi - lo)
        slope = m @ A + b
        f = 0.5 * ((m @ A) * m).sum(axis=1) + m @ b + c
        reach = (np.abs(slope) * half).sum(axis=1)
        reach += 0.5 * ((half @ np.abs(A)) * half).sum(axis=1)
        slack = 1e-15 * (np.abs(f) + reach + abs(c))
        return np.column_stack([f - reach - slack, f + reach + slack, np.full(len(f), np.inf)])

    def _box(self, level: float = 0.0) -> FloatArray:
        """All of space: a cone goes on beyond the ends of its beam."""
        del level
        return np.array([[-np.inf] * 3, [np.inf] * 3])
