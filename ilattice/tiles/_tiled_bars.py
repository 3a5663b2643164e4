"""Copies of the straight bars of a tile in a box of tiles, cut where their tiles end.

A tile that does not repeat along an axis goes as far as its own faces: bars that reach over a face
between two tiles are cut there, unless those of the neighbour go on alike. Ends on faces that are
open or closed go on straight, as in the field of the tile.

Guarantee: within the box, the bars, cut, and what two of them have in common next to a face (there
no cut is to be seen) are the solid of the tiles. Non-guarantee: on edges at which four tiles meet
in the solid, their field is zero.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import product
from typing import Any, NamedTuple

import numpy as np

from ilattice._typing import AnyArray, FloatArray, IntArray
from ilattice.tiles.skeleton import ON_FACE, SkeletonField

#: Relative difference of directions and radii that are taken for equal.
ALIKE = 1e-9


class Cut(NamedTuple):
    """A face between tiles at which a bar ends.

    Attributes
    ----------
    axis : int
        Edge of the cell.
    plane : int
        Number of the face along it.
    above : bool
        Whether the bar is above it.
    """

    axis: int
    plane: int
    above: bool


class Bar(NamedTuple):
    """A straight bar, or a ball.

    Attributes
    ----------
    a, b : ndarray, shape (3,)
        Ends.
    r : float
        Radius.
    loose : tuple of 2 bool
        Whether the ends go on through open faces that they are on.
    cuts : tuple of Cut
        Where it is cut.
    """

    a: FloatArray
    b: FloatArray
    r: float
    loose: tuple[bool, bool] = (True, True)
    cuts: tuple[Cut, ...] = ()


class Joint(NamedTuple):
    """What two bars that meet at a face have in common.

    Attributes
    ----------
    below, above : Bar
        The bars.
    axis, plane : int
        The face.
    cuts : tuple of Cut
        Where it is cut.
    """

    below: Bar
    above: Bar
    axis: int
    plane: int
    cuts: tuple[Cut, ...]


class TiledBars(NamedTuple):
    """Bars of many tiles.

    Attributes
    ----------
    bars : list of Bar
        The bars.
    joints : list of Joint
        What those have in common that meet at faces between tiles: it is not cut there.
    """

    bars: list[Bar]
    joints: list[Joint]


def tiled(
    bars: Sequence[Bar], field: SkeletonField, count: IntArray, most: int
) -> TiledBars | None:
    """Copies of bars in tiles.

    Parameters
    ----------
    bars : sequence of Bar
        Those of the tile.
    field : SkeletonField
        That of the tile.
    count : ndarray of int, shape (3,)
        Tiles in the box.
    most : int
        Copies above which there are none.

    Returns
    -------
    TiledBars or None
        The copies that come into the box; None where there are too many.
    """
    faces = _Faces.of(bars, field)
    out: list[Bar] = []
    met: dict[tuple[Any, ...], tuple[list[Bar], list[Bar]]] = {}
    for i in range(len(bars)):
        for n in _steps(faces, i, count):
            bar = faces.copy(i, n, count)
            out.append(bar)
            for cut in bar.cuts:
                beside = tuple(n[a] for a in range(3) if a != cut.axis and not faces.repeats[a])
                key = cut.axis, cut.plane, beside
                met.setdefault(key, ([], []))[cut.above].append(bar)
        if len(out) > most:
            return None
    joints = []
    for (axis, plane, _), (below, above) in met.items():
        for pair in product(below, above):
            if faces.touch(*pair, axis, plane):
                others = {c for bar in pair for c in bar.cuts if c.axis != axis}
                joints.append(Joint(*pair, axis, plane, tuple(sorted(others))))
    return TiledBars(out, joints)


@dataclass(frozen=True)
class _Faces:
    """How bars of a tile meet its faces, in edges of the cell.

    `ends` (n, 2, 3) are those that go on, `out` (n, 2) says which do; `reach` (n, 3) is that of
    balls at them. Along axes that do not repeat `over` (n, 3, 2) is where bars reach over the lower
    and upper faces, `whole` where the neighbour's go on alike, `joined` (n, 2, 3, 2) where the ends
    do.
    """

    bars: Sequence[Bar]
    cell: FloatArray
    repeats: AnyArray
    far: float
    ends: FloatArray
    out: AnyArray
    reach: FloatArray
    over: AnyArray
    whole: AnyArray
    joined: AnyArray

    @classmethod
    def of(cls, bars: Sequence[Bar], field: SkeletonField) -> "_Faces":
        """Those of the tile of a field."""
        back = np.linalg.inv(field.cell)
        points = np.array([[bar.a, bar.b] for bar in bars])
        radii = np.array([bar.r for bar in bars])
        away = points - points[:, ::-1]
        way = away / np.maximum(np.linalg.norm(away, axis=2, keepdims=True), 1e-300)
        out = field.outward(points.reshape(-1, 3), way.reshape(-1, 3)).reshape(-1, 2)
        out &= np.array([bar.loose for bar in bars])
        inner, reach = points @ back.T, radii[:, None] * np.linalg.norm(back, axis=1)
        ends = inner + field.far * (way @ back.T) * out[:, :, None]
        over = np.zeros((len(bars), 3, 2), np.bool_)
        for i, a in product(range(len(bars)), range(3)):
            others = np.array([not r and b != a for b, r in enumerate(field.repeats)])
            lo = np.where(others, -reach[i], -np.inf)
            part = _within(ends[i], lo, np.where(others, 1.0 + reach[i], np.inf))
            if part is not None:
                over[i, a, 0] = part[:, a].min() < reach[i, a] - ON_FACE
                over[i, a, 1] = part[:, a].max() > 1.0 - reach[i, a] + ON_FACE
        repeats = np.array(field.repeats)
        over[:, repeats] = False
        normals = back / np.linalg.norm(back, axis=1, keepdims=True)
        # what is behind the far end of a bar, beside its axis, must not reach the face
        deep = radii[:, None, None] * np.sqrt(np.maximum(1.0 - (way @ normals.T) ** 2, 0.0))
        joined = _joined(inner, way, radii, out, deep * np.linalg.norm(back, axis=1), repeats)
        whole = joined.any(axis=1) | _twins(inner, radii, repeats)
        return cls(bars, field.cell, repeats, field.far, ends, out, reach, over, whole, joined)

    def copy(self, i: int, n: tuple[int, ...], count: IntArray) -> Bar:
        """The copy of a bar in a tile."""
        inside = ~self.repeats & np.stack([np.array(n) > 0, n < count - 1], axis=0)
        cuts = tuple(
            Cut(a, n[a] + side, side == 0)
            for a, side in product(range(3), range(2))
            if inside[side, a] and self.over[i, a, side] and not self.whole[i, a, side]
        )
        bar, ends = self.bars[i], self.ends[i].copy()
        own = np.stack([bar.a, bar.b]) @ np.linalg.inv(self.cell).T
        goes_on = self.out[i] & ~(self.joined[i] & inside.T).any(axis=(1, 2))
        ends = np.where(goes_on[:, None], ends, own)
        a, b = (ends + np.array(n)) @ self.cell.T
        return bar._replace(a=a, b=b, cuts=cuts)

    def touch(self, first: Bar, second: Bar, axis: int, plane: int) -> bool:
        """Whether two bars may meet at a face."""
        boxes, back = [], np.linalg.inv(self.cell)
        for bar in (first, second):
            reach = bar.r * np.linalg.norm(back, axis=1)
            lo, hi = np.full(3, -np.inf), np.full(3, np.inf)
            lo[axis], hi[axis] = plane - reach[axis], plane + reach[axis]
            part = _within(np.stack([bar.a, bar.b]) @ back.T, lo, hi)
            if part is None:
                return False
            boxes.append((part.min(axis=0) - reach, part.max(axis=0) + reach))
        (a, b), (c, d) = boxes
        return bool(((a < d) & (c < b)).all())


def _steps(faces: _Faces, i: int, count: IntArray) -> Iterator[tuple[int, ...]]:
    """Tiles from which a bar comes into the box."""
    ends, reach = faces.ends[i], faces.reach[i]
    first = np.where(faces.repeats, np.ceil(-ends.max(axis=0) - reach), 0.0).astype(int)
    last = np.floor(count - ends.min(axis=0) + reach).astype(int)
    last = np.where(faces.repeats, last, count - 1)
    for n in product(*(range(m, k + 1) for m, k in zip(first, last, strict=True))):
        if _within(ends + np.array(n), -reach, count + reach) is not None:
            yield n


def _within(ends: FloatArray, lo: FloatArray, hi: FloatArray) -> FloatArray | None:
    """The part (2, 3) of a segment that is in a box, None if there is none."""
    start, way = ends[0], ends[1] - ends[0]
    first, last = 0.0, 1.0
    for x, d, low, high in zip(start, way, lo, hi, strict=True):
        if abs(d) < ON_FACE:
            if x < low or x > high:
                return None
            continue
        s, t = sorted(((low - x) / d, (high - x) / d))
        first, last = max(first, s), min(last, t)
    return start + np.array([[first], [last]]) * way if first <= last else None


def _joined(
    ends: FloatArray, way: FloatArray, radii: FloatArray, out: AnyArray, deep: FloatArray,
    repeats: AnyArray,
) -> AnyArray:  # fmt: skip
    """Ends (n, 2, 3, 2) on faces, beyond which a bar of the neighbour goes on straight.

    `deep` (n, 2, 3) is how far, in edges, the other ends must be from the face.
    """
    found = np.zeros((*out.shape, 3, 2), np.bool_)
    ids = list(product(range(len(ends)), range(2)))
    for a in np.flatnonzero(~repeats):
        depth = np.abs(ends[:, ::-1, a] - ends[:, :, a]) >= deep[:, :, a]
        for (i, s), (j, t) in product(ids, ids):
            if (
                out[i, s] and out[j, t] and depth[i, s] and depth[j, t]
                and (np.abs(ends[i, s] - ends[j, t] - np.eye(3)[a]) <= ON_FACE).all()
                and (np.abs(way[i, s] + way[j, t]) <= ALIKE).all()
                and abs(radii[i] - radii[j]) <= ALIKE * radii[i]
            ):  # fmt: skip
                found[i, s, a, 1] = found[j, t, a, 0] = True
    return found


def _twins(ends: FloatArray, radii: FloatArray, repeats: AnyArray) -> AnyArray:
    """Faces (n, 3, 2) beyond which the same bar is one of the neighbour, too."""
    found = np.zeros((len(ends), 3, 2), np.bool_)
    for a in np.flatnonzero(~repeats):
        for i, j in product(range(len(ends)), repeat=2):
            other = ends[j] + np.eye(3)[a]
            same = min(np.abs(ends[i] - other).max(), np.abs(ends[i] - other[::-1]).max())
            if same <= ON_FACE and abs(radii[i] - radii[j]) <= ALIKE * radii[i]:
                found[i, a, 1] = found[j, a, 0] = True
    return found
