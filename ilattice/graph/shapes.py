"""What skeletons are made of: struts, curves, balls and sheets, with their radii.

Guarantees: frozen; affine maps move points and control points, so that curves stay exact; a
thickness is never scaled.
"""

from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import numpy as np

from ilattice._typing import FloatArray, IntArray
from ilattice._validate import Frozen
from ilattice.bspline import BSpline
from ilattice.tiles.entities import Ball, Curve, Entity, Segments, Triangles

#: Points closer than this are one.
SAME = 1e-9


@dataclass(frozen=True, eq=False)
class Sheet(Frozen):
    """Triangles with a radius at every vertex.

    Attributes
    ----------
    vertices : (V, 3) array
        Corners.
    faces : (F, 3) array
        Triangles.
    radius : (V,) array
        Half the thickness.
    """

    vertices: FloatArray
    faces: IntArray
    radius: FloatArray


@dataclass(frozen=True, eq=False)
class Bend(Frozen):
    """A curve with its radius.

    Attributes
    ----------
    spline : BSpline
        The curve.
    radius : float or BSpline
        A number, or a function of the curve's parameter.
    """

    spline: BSpline
    radius: Any


@dataclass(frozen=True, eq=False)
class Shape(Frozen):
    """A skeleton in the cell.

    Attributes
    ----------
    struts : (n, 2, 4) array
        Ends of straight beams, and their radii.
    balls : (n, 4) array
        Centres and radii.
    bends : tuple of Bend
        Curved beams.
    sheets : tuple of Sheet
        Surfaces.
    """

    struts: FloatArray = field(default_factory=lambda: np.zeros((0, 2, 4)))
    balls: FloatArray = field(default_factory=lambda: np.zeros((0, 4)))
    bends: tuple[Bend, ...] = ()
    sheets: tuple[Sheet, ...] = ()

    def __add__(self, other: "Shape") -> "Shape":
        """Both together."""
        return Shape(
            np.concatenate([self.struts, other.struts]),
            np.concatenate([self.balls, other.balls]),
            self.bends + other.bends,
            self.sheets + other.sheets,
        )

    @property
    def size(self) -> int:
        """Number of pieces."""
        faces = sum(len(s.faces) for s in self.sheets)
        return len(self.struts) + len(self.balls) + 64 * len(self.bends) + faces

    @property
    def extent(self) -> float:
        """Largest extent of a strut, a bend or a sheet along an axis."""
        parts = [np.ptp(self.struts[:, :, :3], axis=1).ravel()]
        parts += [np.ptp(b.spline.c, axis=0) for b in self.bends]
        parts += [np.ptp(s.vertices, axis=0) for s in self.sheets]
        return float(np.concatenate(parts).max(initial=0.0))

    def moved(self, matrix: FloatArray, shift: FloatArray) -> "Shape":
        """The shape under ``x -> matrix x + shift``; radii stay.

        Parameters
        ----------
        matrix : (3, 3) array
            Linear part.
        shift : (3,) array
            Translation.

        Returns
        -------
        Shape
            The image.
        """

        def at(x: FloatArray) -> FloatArray:
            image: FloatArray = x @ matrix.T + shift
            return image

        struts, balls = self.struts.copy(), self.balls.copy()
        struts[:, :, :3], balls[:, :3] = at(struts[:, :, :3]), at(balls[:, :3])
        bends = tuple(replace(b, spline=_with(b.spline, at(b.spline.c))) for b in self.bends)
        sheets = tuple(replace(s, vertices=at(s.vertices)) for s in self.sheets)
        return Shape(struts, balls, bends, sheets)

    @cached_property
    def distinct(self) -> "Shape":
        """The shape without what is there twice, up to whole cells; centres are in the cell."""
        struts = _wrapped(self.struts)
        flip = _later(struts[:, 0, :3], struts[:, 1, :3])
        struts[flip] = struts[flip][:, ::-1]
        balls = _wrapped(self.balls[:, None])[:, 0]
        bends: dict[bytes, Bend] = {}
        for b in self.bends:
            b = replace(b, spline=_with(b.spline, _wrapped(b.spline.c[None])[0]))
            bends.setdefault(_way(b), b)
        sheets = tuple(replace(s, vertices=_wrapped(s.vertices[None])[0]) for s in self.sheets)
        return Shape(_unique(struts), _unique(balls), tuple(bends.values()), sheets)

    @cached_property
    def entities(self) -> tuple[Entity, ...]:
        """As what skeletons are made of: all struts one, all sheets one, each ball and bend."""
        s = self.distinct.struts
        out: list[Entity] = [Segments(s[:, :, :3], s[:, :, 3])] if len(s) else []
        out += [Ball(b[:3], float(b[3])) for b in self.distinct.balls]
        out += [Curve(b.spline, b.radius) for b in self.distinct.bends]
        if self.sheets:
            v, faces, radius = self.triangles
            out.append(Triangles(v, faces, radius))
        return tuple(out)

    @cached_property
    def triangles(self) -> tuple[FloatArray, IntArray, FloatArray]:
        """Vertices, triangles and radii of all sheets, images that coincide once."""
        sheets = self.distinct.sheets
        starts = np.cumsum([0] + [len(s.vertices) for s in sheets])
        v = np.concatenate([s.vertices for s in sheets])
        radius = np.concatenate([s.radius for s in sheets])
        faces = np.concatenate([s.faces + n for s, n in zip(sheets, starts, strict=False)])
        return v, _different(v, faces, radius), radius

    @property
    def radii(self) -> FloatArray:
        """All radii, or what bounds them."""
        parts = [self.struts[:, :, 3].ravel(), self.balls[:, 3]]
        parts += [np.ravel(_radii(b.radius)) for b in self.bends]
        return np.concatenate(parts + [s.radius for s in self.sheets])


def _with(spline: BSpline, c: FloatArray) -> BSpline:
    """The spline with other coefficients."""
    return BSpline(spline.t, c, spline.k, periodic=spline.periodic)


def _radii(radius: Any) -> FloatArray:
    return radius.c if isinstance(radius, BSpline) else np.array([radius])


def _wrapped(points: FloatArray) -> FloatArray:
    """Rows (n, k, 3 or 4) of points with their middle in the cell."""
    out = points.copy()
    middle = out[:, :, :3].mean(axis=1, keepdims=True)
    out[:, :, :3] -= np.floor(middle + SAME)
    return out


def _later(a: FloatArray, b: FloatArray) -> Any:
    """Rows in which the second point comes first, by x, then y, then z."""
    off = np.where(np.abs(a - b) > SAME, a - b, 0.0)
    lead = np.argmax(off != 0.0, axis=1)
    return off[np.arange(len(off)), lead] > 0.0


def _whole(values: FloatArray) -> IntArray:
    """Whole numbers that are equal for equal values."""
    return np.rint(values / SAME / 10.0).astype(np.int64)


def _way(bend: Bend) -> bytes:
    """The same for a bend and for that bend run through backwards."""
    (t,), radius = bend.spline.t, bend.radius
    (r,) = radius.t if isinstance(radius, BSpline) else (t,)
    start, length = t[0], t[-1] - t[0]
    parts = [bend.spline.c, (t - start) / length, _radii(radius), (r - start) / length]
    back = [a[::-1] for a in parts]
    back[1], back[3] = 1.0 - back[1], 1.0 - back[3]
    return min(b"".join(_whole(a).tobytes() for a in way) for way in (parts, back))


def _groups(keys: IntArray) -> tuple[IntArray, IntArray]:
    """First of equal rows, in order, and the number of its group for each row."""
    order = np.lexsort(keys.T)
    new = np.append(True, (np.diff(keys[order], axis=0) != 0).any(axis=1))
    number = np.empty(len(keys), np.int64)
    number[order] = np.cumsum(new) - 1
    return np.sort(order[new]), number


def _unique(rows: FloatArray) -> FloatArray:
    """Rows without repetitions, in order."""
    return rows[_groups(_whole(rows.reshape(len(rows), -1)))[0]] if len(rows) else rows


def _different(v: FloatArray, faces: IntArray, radius: FloatArray) -> IntArray:
    """Triangles without those whose corners and radii agree with another's, up to whole cells."""
    near = np.mod(v + 0.25 * SAME, 1.0)
    corners = _groups(_whole(np.column_stack([near, radius])))[1][faces]
    turns = np.rint(v - near).astype(np.int64)[faces]
    order = np.argsort(corners, axis=1)
    corners = np.take_along_axis(corners, order, axis=1)
    turns = np.take_along_axis(turns, order[:, :, None], axis=1)
    apart = (turns[:, 1:] - turns[:, :1]).reshape(-1, 6)
    return faces[_groups(np.column_stack([corners, apart]))[0]]
