"""Beams in boxes: which of them matter there, and smooth fields that have the same sign.

Where a box lies beside a beam, or beyond its end, the sign is that of a polynomial of degree two,
which analyses take exactly; elsewhere it is that of the distance. Beams that share a ball within a
box are one piece there, since their distances are equal in a part of it.

Guarantee: within a box the union of its pieces is the solid. Non-guarantee: creases within pieces
of several beams are those of an interpolant; boxes are halved until the volume is right.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, TypeAlias

import numpy as np

from ilattice._field import as_boxes, hessians
from ilattice._geometry import grid_points
from ilattice._typing import AnyArray, ArrayLike, FloatArray, IntArray
from ilattice._validate import as_numbers, as_points
from ilattice.cost import _kernels_beams as kernels
from ilattice.errors import InputError
from ilattice.fields._pieces import Stackable
from ilattice.fields.node import Node

#: Most beams of one box; where there are more it is halved.
MAX_PIECES = 16
#: The same after beams that meet there are taken together, and diagonals of boxes, in radii, below
#: which they may be: rules on boxes with more need many points.
MAX_JOINED, SMALL = 3, 1.0
#: Part of a beam's length by which boxes may reach beyond its end: rounding, not a piece.
EVEN = 1e-12
#: Sorts of pieces.
DISTANCE, SIDE, BALL = 0, 1, 2
#: A piece: its sort, and its beams in the order of the tree, or its vertex.
Piece: TypeAlias = tuple[int, ...]
#: Corners of a box, in halves of its lengths from its middle.
CORNERS = grid_points(*[[-1.0, 1.0]] * 3)


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
    tree: tuple[AnyArray, ...], pairs: IntArray, even: AnyArray, lo: FloatArray, hi: FloatArray
) -> list[tuple[Piece, ...] | None]:
    """Pieces that matter in boxes, given `balls_of`; None where boxes are to be halved before."""
    reach = np.linalg.norm(hi - lo, axis=1) * (1.0 + 1e-9)
    rows = np.full((len(lo), MAX_PIECES), -1, np.int64)
    count = np.empty(len(lo), np.int64)
    middle = 0.5 * (lo + hi)
    box, wide, link, beam, order = tree
    kernels.among(len(lo), middle, reach, box, wide, link, beam, rows, count)
    first, last = _ends(beam[rows], middle, 0.5 * (hi - lo))
    least = np.where(rows >= 0, beam[rows, :2].min(axis=2), np.inf).min(axis=1)
    out: list[tuple[Piece, ...] | None] = []
    for k, c in enumerate(count.tolist()):
        if c > MAX_PIECES:
            out.append(None)
            continue
        part = zip(rows[k, :c].tolist(), first[k].tolist(), last[k].tolist(), strict=False)
        rows_of = [(i, *pairs[order[i]].tolist(), a, b) for i, a, b in part]
        out.append(_pieces(rows_of, even, reach[k] <= SMALL * least[k]))
    return out


def balls_of(pairs: IntArray, radii: FloatArray) -> AnyArray:
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
    rows: list[tuple[int, int, int, int, int]], even: AnyArray, small: bool
) -> tuple[Piece, ...] | None:
    """Sides, balls that are part of no other piece, and beams, together where they meet in one."""
    balls, sides = set(), []
    touched: dict[int, set[int]] = {}
    held: set[int] = set()
    for i, a, b, first, last in rows:
        vertex = (a if last == 0 else b) if first == last != 1 else -1
        if vertex >= 0 and even[vertex]:
            balls.add(vertex)
        elif first == last == 1:
            sides.append((SIDE, i))
        else:
            touched[i] = {v for v, at in ((a, first == 0), (b, last == 2)) if at}
            held |= touched[i]
    whole = _together(touched)
    if not small and (len(whole) + len(sides) > MAX_JOINED or any(len(g) > 1 for g in whole)):
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
    most = max(len(vertices), len(pairs), BALL + 1)
    sort, *rest = as_numbers("numbers", piece, most).tolist() or [BALL]
    most = len(vertices) if sort == BALL else len(pairs)
    if sort > BALL or not rest or max(rest) >= most or (sort != DISTANCE and len(rest) > 1):
        raise InputError(f"numbers must be a piece of parts_on, got {piece!r:.80}")
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
class _BeamDistance(Stackable):
    """Distance to the union of beams (k, 8)."""

    rows: FloatArray

    def values(self, points: FloatArray) -> FloatArray:
        """Values (n,) at points (n, 3)."""
        return _Distances(self.rows[:, None]).values(np.zeros(1, np.int64), points[None])[0]

    def jets(self, points: FloatArray, order: int) -> tuple[FloatArray, ...]:
        """Values (n,), gradients (n, 3) and, for order 2, Hessians by differences of these."""
        value, slope = self._first(points)
        if order == 1:
            return value, slope
        return value, slope, hessians(lambda p: self._first(p)[1], points)

    def _first(self, points: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Values (n,) and gradients (n, 3) of the nearest beams."""
        near = [_tangent(row[None], points[None]) for row in self.rows]
        value, slope = (np.stack([pair[k][0] for pair in near]) for k in range(2))
        nearest, each = value.argmin(axis=0), np.arange(len(points))
        return value[nearest, each], slope[nearest, each]

    def range(self, lo: ArrayLike, hi: ArrayLike) -> FloatArray:
        """Bounds (n, 2) on boxes."""
        return self.bounds_on(*as_boxes(lo, hi), True)[:, :2]

    def _box(self, level: float = 0.0) -> FloatArray:
        """Box about all balls."""
        reach = self.rows[:, :2, None] + max(level, 0.0)
        ends = self.rows[:, 2:].reshape(-1, 2, 3)
        return np.stack([(ends - reach).min(axis=(0, 1)), (ends + reach).max(axis=(0, 1))])

    def bounds_on(self, lo: FloatArray, hi: FloatArray, moved: bool) -> FloatArray:
        """Bounds and steepness (n, 3) on finite boxes."""
        both = _Distances(self.rows[:, None]).bounds(np.zeros(len(lo), np.int64), lo, hi)
        return np.column_stack([both, np.full(len(lo), np.inf if moved else 1.0)])

    @classmethod
    def stacked(cls, pieces: "Sequence[_BeamDistance]") -> "_Distances":
        """Several, evaluated together: those with fewer beams count their last one again."""
        most = max(len(p.rows) for p in pieces)
        rows = [p.rows[np.minimum(np.arange(most), len(p.rows) - 1)] for p in pieces]
        return _Distances(np.stack(rows, axis=1))


class _Distances:
    """Distances to m unions of k beams each, with rows (k, m, 8)."""

    def __init__(self, rows: FloatArray) -> None:
        self.rows = rows

    def values(self, which: IntArray, x: FloatArray) -> FloatArray:
        """Values (n, q) of unions (n,) at points (n, q, 3)."""
        return np.asarray(np.min([_tangent(row[which], x)[0] for row in self.rows], axis=0))

    def bounds(self, which: IntArray, lo: FloatArray, hi: FloatArray) -> FloatArray:
        """Bounds (n, 2) of unions (n,) on finite boxes: distances to beams are convex."""
        m, half = 0.5 * (lo + hi), 0.5 * (hi - lo)
        ends = m[:, None] + half[:, None] * CORNERS
        low, high = np.full(len(m), np.inf), np.full(len(m), np.inf)
        for row in self.rows[:, which]:
            f, slope = _tangent(row, m[:, None])
            low = np.minimum(low, f[:, 0] - (np.abs(slope[:, 0]) * half).sum(axis=1))
            high = np.minimum(high, _tangent(row, ends)[0].max(axis=1))
        slack = 1e-15 * (np.abs(high) + np.abs(lo).max(axis=1) + np.abs(hi).max(axis=1))
        return np.column_stack([low - slack, high + slack])


def _tangent(row: FloatArray, p: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Distances (n, q) of points (n, q, 3) from beams (n, 8), and subgradients (n, q, 3)."""
    w, length, s = _axes(row)
    d = p - row[:, None, 2:5]
    z = (d @ w[..., None])[..., 0]
    off = np.linalg.norm(d - z[..., None] * w[:, None], axis=2)
    steep = s / np.sqrt(np.maximum(1.0 - s * s, 1e-12))
    t = np.clip(z + steep[:, None] * off, 0.0, length[:, None])
    # where one ball holds the other, it is nearest to all points, those on the axis too
    t = np.where(np.abs(s[:, None]) < 1.0, t, np.where(s[:, None] > 0.0, length[:, None], 0.0))
    d = d - t[..., None] * w[:, None]
    reach = np.linalg.norm(d, axis=2)
    slope = d / np.maximum(reach, 1e-300)[..., None]
    part = t / np.where(length > 0.0, length, 1.0)[:, None]
    return reach - (row[:, :1] + (row[:, 1:2] - row[:, :1]) * part), slope


def _axes(row: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Directions (n, 3), lengths, and growths of the radius of beams (n, 8)."""
    way = row[:, 5:8] - row[:, 2:5]
    length = np.linalg.norm(way, axis=1)
    long = np.where(length > 0.0, length, 1.0)
    return way / long[:, None], length, np.clip((row[:, 1] - row[:, 0]) / long, -1.0, 1.0)


@dataclass(frozen=True, eq=False)
class _BeamQuadric(Stackable):
    """A polynomial that is negative just in a ball, or in the cone beside a beam.

    That is (1 - s²) (|d|² - z²) - (r + s z)² over 2 r, with d from the first end, z its part along
    the axis, and the radius r + s z; near the surface it is about the distance.
    """

    row: FloatArray

    @cached_property
    def _one(self) -> "_Quadrics":
        return _Quadrics(self.row[None])

    def values(self, points: FloatArray) -> FloatArray:
        """Values (n,) at points (n, 3)."""
        return self._one.values(np.zeros(1, np.int64), points[None])[0]

    def jets(self, points: FloatArray, order: int) -> tuple[FloatArray, ...]:
        """Values (n,), gradients (n, 3) and, for order 2, Hessians (n, 3, 3)."""
        A, b = self._one.matrix[0], self._one.vector[0]
        d = points - self.row[2:5]
        return (self.values(points), d @ A + b, np.tile(A, (len(points), 1, 1)))[: order + 1]

    def range(self, lo: ArrayLike, hi: ArrayLike) -> FloatArray:
        """Bounds (n, 2) on boxes."""
        return self.bounds_on(*as_boxes(lo, hi), True)[:, :2]

    def bounds_on(self, lo: FloatArray, hi: FloatArray, moved: bool) -> FloatArray:
        """Bounds and steepness (n, 3) on finite boxes."""
        del moved  # a polynomial has no largest slope
        both = self._one.bounds(np.zeros(len(lo), np.int64), lo, hi)
        return np.column_stack([both, np.full(len(lo), np.inf)])

    def _box(self, level: float = 0.0) -> FloatArray:
        """All of space: a cone goes on beyond the ends of its beam."""
        del level
        return np.array([[-np.inf] * 3, [np.inf] * 3])

    @classmethod
    def stacked(cls, pieces: "Sequence[_BeamQuadric]") -> "_Quadrics":
        """Several, evaluated together."""
        return _Quadrics(np.stack([p.row for p in pieces]))


class _Quadrics:
    """Polynomials d A d / 2 + b d + c of m beams (m, 8), with d from their first ends."""

    def __init__(self, row: FloatArray) -> None:
        w, _, s = _axes(row)
        r = row[:, 0]
        along = w[:, :, None] * w[:, None]
        s2 = (s * s)[:, None, None]
        self.matrix = ((1.0 - s2) * (np.eye(3) - along) - s2 * along) / r[:, None, None]
        self.vector, self.number, self.origin = -s[:, None] * w, -0.5 * r, row[:, 2:5]

    def _jets(self, which: IntArray, x: FloatArray) -> tuple[FloatArray, FloatArray]:
        d = x - self.origin[which][:, None]
        half = 0.5 * (d @ self.matrix[which])
        slope = half + self.vector[which][:, None]
        return (slope * d).sum(axis=2) + self.number[which][:, None], slope + half

    def values(self, which: IntArray, x: FloatArray) -> FloatArray:
        """Values (n, q) of polynomials (n,) at points (n, q, 3)."""
        return self._jets(which, x)[0]

    def bounds(self, which: IntArray, lo: FloatArray, hi: FloatArray) -> FloatArray:
        """Bounds (n, 2) of polynomials (n,) on finite boxes: those of a Taylor series."""
        half = 0.5 * (hi - lo)
        f, slope = (v[:, 0] for v in self._jets(which, 0.5 * (lo + hi)[:, None]))
        bend = (half[:, None] @ np.abs(self.matrix[which]) @ half[..., None])[:, 0, 0]
        reach = (np.abs(slope) * half).sum(axis=1) + 0.5 * bend
        slack = 1e-15 * (np.abs(f) + reach + np.abs(self.number[which]))
        return np.column_stack([f - reach - slack, f + reach + slack])
