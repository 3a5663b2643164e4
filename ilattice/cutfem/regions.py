"""Where loads and supports are: end faces, level sets, and the parts of them where something holds.

Guarantee: areas of regions are sums over the points of a rule; loads that are given as a resultant
are distributed over these, so that their sums are exact. Non-guarantee: the edge of a region runs
through cells without dividing them: its area is known to about a point of the rule in each cell
that it passes. By how much it is off is estimated from what each point stands for, and told above
`ROUGH`; edges that have all points near by on one side are not seen.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.ndimage import binary_dilation

from ilattice._conditions import as_planes
from ilattice._field import Field
from ilattice._typing import AnyArray, FloatArray
from ilattice._validate import Frozen, among, as_array, asked
from ilattice.cutfem.places import Inside, Patch
from ilattice.errors import GeometryError, InputError
from ilattice.mesh import SurfaceMesh
from ilattice.quadrature.rules import NAMES, Quadrature

#: Places for conditions besides the end faces: the level sets that bound the solid, or the outer
#: (first, of a wall that of the offset to the outside) and the inner (second) of them alone.
SURFACES = ("surface", "outer", "inner")
#: All level sets and end faces together.
BOUNDARY = "boundary"
PLACES = (*NAMES, *SURFACES, BOUNDARY)
#: Error of the area of a region, as a part of it, above which it is warned of.
ROUGH = 0.02
#: Places per direction in what a point stands for, and the parts of these that must be inside and
#: outside for an edge to pass there; of points far from edges this part must agree.
SUBDIVIDED, SEEN, AGREE = 5, 0.15, 0.9
#: How far outside of conditions points count as inside, in the size of the place.
NEAR = 1e-9
#: How far points and normals of a plane may be off it, relative to its size.
FLAT = 1e-3
#: Part of what a point stands for that is not known, since that is no square.
ROUND = 0.05


@dataclass(frozen=True, eq=False)
class Region(Frozen):
    """The part of a place where a condition holds.

    Attributes
    ----------
    place : str
        An end face, level sets, or all of the boundary.
    inside : callable
        Takes points of space (n, 3), returns booleans (n,).
    name : str
        In messages and reactions.
    planes : ndarray, shape (m, 4), or None
        Half-spaces ``a·x + b >= 0`` that the region is the intersection of, if it is one.
    """

    place: str
    inside: Callable[[FloatArray], Any]
    name: str
    planes: FloatArray | None = None

    def __str__(self) -> str:
        return self.name

    def __repr__(self) -> str:
        return f"{self.name!r}"

    def of(self, points: FloatArray) -> AnyArray:
        """Which points are in it.

        Parameters
        ----------
        points : ndarray, shape (n, 3)
            Of the place, in space.

        Returns
        -------
        ndarray of bool, shape (n,)
            At least one is true.

        Raises
        ------
        InputError
            If the condition gives something else.
        GeometryError
            If there is none.
        """
        found = np.asarray(asked("on", self.inside, points))
        if found.shape != (len(points),) or found.dtype != bool:
            raise InputError(
                f"on={self.name}: a condition takes points (n, 3) and returns n booleans, got "
                f"{found.dtype} of shape {found.shape}; fields of il.fields do as they are"
            )
        if not found.any():
            raise GeometryError(f"on={self.name}: no surface there; {self._nearest(points)}")
        return found

    def error(self, rule: Quadrature) -> float:
        """Estimated error of the area of the region, as a part of it.

        Each point stands for a square in the tangent plane: what of it is on the other side of the
        edge than the point is wrong. NaN for conditions that do not hold beside the surface.

        Parameters
        ----------
        rule : Quadrature
            On the place, in space.

        Returns
        -------
        float
            Positive.
        """
        assert rule.normals is not None
        found = np.asarray(asked("on", self.inside, rule.points))
        axis = np.eye(3)[np.abs(rule.normals).argmin(axis=1)]
        first = np.cross(rule.normals, axis)
        first /= np.linalg.norm(first, axis=1, keepdims=True)
        second, length = np.cross(rule.normals, first), np.sqrt(rule.weights)[:, None]
        steps = (np.arange(SUBDIVIDED) + 0.5) / SUBDIVIDED - 0.5
        some_in, some_out = _around(rule, found), _around(rule, ~found)
        rows = np.flatnonzero(found | (some_in & some_out))
        part = np.zeros(len(rule))
        for s in steps:
            for t in steps:
                away = (length * (s * first + t * second))[rows]
                part[rows] += np.asarray(asked("on", self.inside, rule.points[rows] + away))
        part /= SUBDIVIDED**2
        inner = found & ~some_out
        if inner.any() and part[inner].mean() < AGREE:
            return float("nan")
        passes = some_in & some_out & (part > SEEN) & (part < 1.0 - SEEN)
        off = abs(float((rule.weights * np.where(passes, part - found, 0.0)).sum()))
        off += ROUND * float(rule.weights[passes].sum())
        return off / float(rule.weights[found].sum())

    def _nearest(self, x: FloatArray) -> str:
        if isinstance(self.inside, Inside | Patch) and len(x):
            away = self.inside.away(x)
            k = int(np.nanargmin(away))
            return f"the nearest is {away[k]:.3g} away, at {np.round(x[k], 6).tolist()}"
        if self.planes is None or not len(x):
            span = " to ".join(str(np.round(a, 6).tolist()) for a in (x.min(axis=0), x.max(axis=0)))
            return f"the surface reaches from {span}" if len(x) else "there is none at all"
        outside = np.maximum(-(x @ self.planes[:, :3].T + self.planes[:, 3]), 0.0).max(axis=1)
        k = int(np.argmin(outside))
        return f"the nearest is {outside[k]:.3g} away, at {np.round(x[k], 6).tolist()}"


def _around(rule: Quadrature, what: AnyArray) -> AnyArray:
    """Whether something holds at points of the same side of the solid in cells next to each."""
    assert rule.normals is not None
    grid = rule.grid
    main = np.abs(rule.normals).argmax(axis=1)
    side = 2 * main + (rule.normals[np.arange(len(rule)), main] > 0)
    at = (side, *grid.cell_indices(rule.cells)[rule.owners].T)
    found = np.zeros((6, *grid.shape), bool)
    np.logical_or.at(found, at, what)
    near = np.ones((1, 3, 3, 3), bool)
    return np.asarray(binary_dilation(found, near)[at])


def as_place(on: Any, where: Any = None) -> str | Region:
    """A place by its name, or the part of the boundary where a condition holds.

    Parameters
    ----------
    on : str, callable, (2, 3) array-like, Field or SurfaceMesh
        A name; a linear condition such as ``"z > 5"``; a function of points (n, 3) that gives
        booleans; a box; a field of space, where it is not positive; or triangles, those points
        that are on them.
    where : str, callable, (2, 3) array-like, Field or SurfaceMesh, optional
        A condition on a place with a name.

    Returns
    -------
    str or Region
        The place.

    Raises
    ------
    InputError
        If it is none.
    """
    if among(on, PLACES):
        return str(on) if where is None else _region(str(on), where)
    if where is not None:
        raise InputError(f"where narrows a place with a name, one of {PLACES}, got on={on!r:.80}")
    if isinstance(on, str) and not any(c in on for c in "<>"):
        raise InputError(
            f"on must be one of {', '.join(PLACES)}, a condition such as 'z > 5', a box or a "
            f"function of points, got {on!r}"
        )
    return _region(BOUNDARY, on)


def _region(place: str, condition: Any) -> Region:
    ahead = "" if place == BOUNDARY else f"{place} where "
    if isinstance(condition, SurfaceMesh):
        if not len(condition.faces):
            raise InputError("on is a mesh without triangles: no place")
        return Region(place, Patch(condition), f"{ahead}patch of {len(condition.faces)} triangles")
    if isinstance(condition, Field):
        return Region(place, Inside(condition), f"{ahead}{_name(condition)} <= 0")
    if callable(condition):
        return Region(place, condition, ahead + _name(condition))
    planes = as_planes(condition, "where" if ahead else "on", flat=True)
    name = condition if isinstance(condition, str) else f"box {as_array('on', condition).tolist()}"
    return Region(place, _Within(planes), ahead + name, planes)


def _name(condition: Any) -> str:
    """What a function or a field is called."""
    return str(getattr(condition, "__name__", type(condition).__name__)).strip("<>_")


@dataclass(frozen=True, eq=False)
class _Within(Frozen):
    """Whether points are in all of some half-spaces."""

    planes: FloatArray

    def __call__(self, x: FloatArray) -> AnyArray:
        """Booleans, shape (n,)."""
        if not len(x):
            return np.zeros(0, bool)
        away = x @ self.planes[:, :3].T + self.planes[:, 3]
        rounding = 8.0 * np.finfo(float).eps * np.abs(x).max()
        return np.asarray((away >= -(NEAR * np.ptp(x, axis=0).max() + rounding)).all(axis=1))


@dataclass(frozen=True, eq=False)
class Spread(Frozen):
    """Tractions at points (n, 3) with a given resultant: ``f + c × (x - middle)``.

    Uniform for a force; for a moment those of a rigid turn about the middle of the place, of which
    the sum vanishes.
    """

    f: FloatArray
    c: FloatArray
    middle: FloatArray

    def __call__(self, x: FloatArray) -> FloatArray:
        """Tractions, shape (n, 3)."""
        return self.f + np.cross(self.c, x - self.middle)


def spread(kind: str, value: FloatArray, rule: Quadrature) -> Spread:
    """Tractions with a resultant ``"force"`` or ``"moment"`` (3,) over a surface rule in space."""
    w, x = rule.weights, rule.points
    area, nothing = float(w.sum()), np.zeros(3)
    middle = w @ x / area
    if kind == "force":
        return Spread(value / area, nothing, middle)
    second = np.einsum("n,ni,nj->ij", w, x - middle, x - middle)
    inertia = np.trace(second) * np.eye(3) - second
    c = np.linalg.pinv(inertia, rcond=1e-12) @ value
    if np.abs(inertia @ c - value).max() > 1e-9 * np.abs(value).max():
        raise GeometryError("moment: its place is a line or a point, which cannot bear it")
    return Spread(nothing, c, middle)


def beside_plane(rule: Quadrature) -> float:
    """Part of the area of a place that is not in the plane in which most of it is.

    Parameters
    ----------
    rule : Quadrature
        In space, with normals.

    Returns
    -------
    float
        Nothing where less than half of the area is in one plane, as on curved places.
    """
    n, w = rule.normals, rule.weights
    assert n is not None
    size = float(np.ptp(rule.points, axis=0).max())
    height = np.einsum("qi,qi->q", rule.points - rule.points[0], n) / size
    key = np.rint(np.column_stack([n, height]) / (0.1 * FLAT))
    _, first, rows = np.unique(key, axis=0, return_index=True, return_inverse=True)
    most = first[np.argmax(np.bincount(rows.ravel(), w))]
    flat = (np.linalg.norm(n - n[most], axis=1) <= FLAT) & (
        np.abs((rule.points - rule.points[most]) @ n[most]) <= FLAT * size
    )
    part = float(w[~flat].sum() / w.sum())
    return part if part < 0.5 else 0.0
