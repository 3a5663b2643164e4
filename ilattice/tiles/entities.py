"""Curves and surfaces that skeletons are made of, each with a radius of its own.

Guarantees: an entity has a positive radius or none (then that of the skeleton is taken), finite
coordinates and a positive extent. Non-guarantee: see `ilattice.tiles._radii`.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from ilattice._typing import ArrayLike, FloatArray, IntArray
from ilattice._validate import (
    Frozen,
    as_array,
    as_flag,
    as_items,
    as_numbers,
    as_points,
    as_positive,
    read_only,
)
from ilattice.bspline import BSpline
from ilattice.errors import InputError
from ilattice.tiles._radii import check_radius

#: What counts as no length, in units of length.
TINY = 1e-12

Radius = float | ArrayLike | BSpline | Callable[..., Any]


@dataclass(frozen=True, eq=False)
class Polyline(Frozen):
    """Straight segments between points; two points are one segment.

    Parameters
    ----------
    points : array_like, shape (n, 3)
        Corners, in order.
    radius : float, array_like of shape (n,), callable or BSpline, optional
        Constant, or per corner and linear between, or a function of the share of the length from
        0 to 1. By default that of the skeleton.
    closed : bool
        Whether the last corner is joined to the first.

    Raises
    ------
    InputError
        If there are fewer than two different points.

    See Also
    --------
    Segments : many straight lines at once.
    """

    points: FloatArray
    radius: Any = None
    closed: bool = False

    def __post_init__(self) -> None:
        check_radius(self.radius)
        p = as_points("points", self.points)
        if as_flag("closed", self.closed) and len(p):
            p = np.concatenate([p, p[:1]])
        if len(p) < 2 or not np.abs(p[1:] - p[:-1]).max() > TINY:
            raise InputError(
                f"points must hold at least two different points: a curve of length zero has no "
                f"direction, got {np.asarray(self.points).tolist()!r:.80}"
            )
        object.__setattr__(self, "points", read_only(np.array(p)))


@dataclass(frozen=True, eq=False)
class Segments(Frozen):
    """Many straight segments, each an entity of its own: a smooth union blends them.

    Parameters
    ----------
    points : array_like, shape (n, 2, 3)
        Both ends of each.
    radius : float or array_like of shape (n,) or (n, 2), optional
        One for all, one per segment, or those at the ends of each and linear between. By default
        that of the skeleton.

    Raises
    ------
    InputError
        If there is none, one has no length, or there are not as many radii.
    """

    points: FloatArray
    radius: Any = None

    def __post_init__(self) -> None:
        p = as_array("points", self.points)
        if p.ndim != 3 or p.shape[1:] != (2, 3) or not len(p):
            raise InputError(f"points must be pairs of ends, shape (n, 2, 3), got {p.shape}")
        short = ~(np.abs(p[:, 1] - p[:, 0]).max(axis=1) > TINY)
        if short.any():
            i = int(np.argmax(short))
            raise InputError(
                f"points[{i}] must be two different points: a segment of length zero has no "
                f"direction, got {p[i].tolist()!r:.80}; drop it"
            )
        object.__setattr__(self, "points", read_only(np.array(p)))
        if self.radius is None:
            return
        r = as_array("radius", self.radius)
        if np.ndim(self.radius) and r.shape not in ((len(p),), (len(p), 2)):
            raise InputError(
                f"radius must be one number, one per segment ({len(p)},), or those at the ends, "
                f"shape ({len(p)}, 2), got {r.shape}"
            )
        if not r.min() > 0.0:
            raise InputError(f"radius must be positive, got {r.min():g}")
        own = read_only(np.array(r)) if np.ndim(self.radius) else float(r.ravel()[0])
        object.__setattr__(self, "radius", own)

    def at_ends(self, default: float | None = None) -> FloatArray:
        """Radii at both ends of all segments.

        Parameters
        ----------
        default : float, optional
            Radius where there is none of their own.

        Returns
        -------
        ndarray, shape (n, 2)
            Radii.

        Raises
        ------
        InputError
            If there is none at all.
        """
        r = default if self.radius is None else self.radius
        if r is None:
            raise InputError("radius must be given: for the segments, or as default")
        rows = np.asarray(r, np.float64)
        rows = rows[:, None] if rows.ndim == 1 else rows
        return np.array(np.broadcast_to(rows, (len(self.points), 2)))


@dataclass(frozen=True, eq=False)
class Arc(Frozen):
    """Arc ``centre + cos(a) u + sin(a) v`` for a from 0 to `angle`.

    Parameters
    ----------
    centre, u, v : array_like, shape (3,)
        Centre, and two perpendicular vectors of the same length: the size of the circle.
    angle : float
        Angle in radians, at most 2 pi: a full circle.
    radius : float, callable or BSpline, optional
        Constant, or a function of the angle. By default that of the skeleton.

    Raises
    ------
    InputError
        If the vectors are not perpendicular or not equally long, or the angle is out of range.
    """

    centre: FloatArray
    u: FloatArray
    v: FloatArray
    angle: float = 2.0 * math.pi
    radius: Any = None

    def __post_init__(self) -> None:
        check_radius(self.radius)
        for name in ("centre", "u", "v"):
            a = as_array(name, getattr(self, name), ndim=1)
            if a.shape != (3,):
                raise InputError(f"{name} must be three numbers, got {a.tolist()}")
            object.__setattr__(self, name, read_only(np.array(a)))
        size, other = float(np.linalg.norm(self.u)), float(np.linalg.norm(self.v))
        skew = max(abs(size - other), abs(float(self.u @ self.v)) / max(size, TINY))
        if not (size > TINY and skew <= 1e-9 * size):
            raise InputError(
                "u and v must be perpendicular and equally long, not zero, got "
                f"{self.u.tolist()} and {self.v.tolist()}"
            )
        angle = as_positive("angle", self.angle)
        if angle > 2.0 * math.pi + 1e-12:
            raise InputError(f"angle must be at most 2 pi radians, got {angle:g}")
        object.__setattr__(self, "angle", min(angle, 2.0 * math.pi))

    def at(self, a: ArrayLike) -> FloatArray:
        """Points at angles.

        Parameters
        ----------
        a : array_like, shape (n,)
            Angles in radians.

        Returns
        -------
        ndarray, shape (n, 3)
            Points.
        """
        t = as_array("a", a, ndim=1)[:, None]
        return self.centre + np.cos(t) * self.u + np.sin(t) * self.v


@dataclass(frozen=True, eq=False)
class Patch(Frozen):
    """Plane polygon, convex or not, without holes.

    Parameters
    ----------
    corners : array_like, shape (n, 3)
        Corners in order, in one plane.
    radius : float, optional
        Half the thickness of the plate. By default the radius of the skeleton.

    Raises
    ------
    InputError
        If there are fewer than three corners, or they are on one line or not in one plane.
    """

    corners: FloatArray
    radius: Any = None

    def __post_init__(self) -> None:
        check_radius(self.radius)
        p = as_points("corners", self.corners)
        if len(p) < 3:
            raise InputError(f"corners must be at least three points, got {len(p)}")
        values = np.linalg.svd(p - p.mean(axis=0), compute_uv=False)
        if not values[1] > 1e-9 * values[0] > 0.0:
            raise InputError("corners must span a plane: they are all on one line")
        if len(values) > 2 and values[2] > 1e-9 * values[0]:
            raise InputError(f"corners must be in one plane: they are off it by {values[2]:.3g}")
        object.__setattr__(self, "corners", read_only(np.array(p)))


@dataclass(frozen=True, eq=False)
class Curve(Frozen):
    """B-spline curve, rational or not, with corners or not.

    Parameters
    ----------
    spline : BSpline
        One parameter, three components, degree 1 to 8.
    radius : float, callable or BSpline, optional
        Constant, or a function of the curve's parameter. By default that of the skeleton.

    Raises
    ------
    InputError
        If the spline is no such curve, or has no length.
    """

    spline: BSpline
    radius: Any = None

    def __post_init__(self) -> None:
        check_radius(self.radius)
        _check_spline(self.spline, 1, "a curve: one parameter")


@dataclass(frozen=True, eq=False)
class Surface(Frozen):
    """B-spline surface, rational or not.

    Parameters
    ----------
    spline : BSpline
        Two parameters, three components, degrees 1 to 5.
    radius : float, callable or BSpline, optional
        Half the thickness: constant, or a function of the parameters (n, 2). By default that of
        the skeleton.

    Raises
    ------
    InputError
        If the spline is no such surface, or has no extent.
    """

    spline: BSpline
    radius: Any = None

    def __post_init__(self) -> None:
        check_radius(self.radius)
        _check_spline(self.spline, 2, "a surface: two parameters")


@dataclass(frozen=True, eq=False)
class Triangles(Frozen):
    """Surface of triangles, of any topology; each corner may have a radius of its own.

    It may leave the cell through periodic faces, and is not continued past open ones.

    Parameters
    ----------
    vertices : array_like, shape (V, 3)
        Corners.
    faces : array_like, shape (F, 3)
        Rows of `vertices`; triangles without an area are left out.
    radius : float or array_like of shape (V,), optional
        Half the thickness, constant or per vertex and linear in triangles. By default that of the
        skeleton.

    Raises
    ------
    InputError
        If there is no triangle with an area, or a number is no row.
    """

    vertices: FloatArray
    faces: IntArray
    radius: Any = None

    def __post_init__(self) -> None:
        check_radius(self.radius)
        v = as_points("vertices", self.vertices)
        faces = np.asarray(self.faces)
        if faces.ndim != 2 or faces.shape[1] != 3 or not len(faces):
            raise InputError(f"faces must have shape (F, 3), got {faces.shape}")
        rows = as_numbers("faces", faces.ravel(), len(v)).reshape(-1, 3)
        p = v[rows]
        twice = np.linalg.norm(np.cross(p[:, 1] - p[:, 0], p[:, 2] - p[:, 0]), axis=1)
        longest = np.linalg.norm(p - np.roll(p, 1, axis=1), axis=2).max(axis=1)
        rows = rows[twice > TINY * longest * np.maximum(longest, TINY)]
        if not len(rows):
            raise InputError("faces must hold a triangle with an area, but all are flat")
        object.__setattr__(self, "vertices", read_only(np.array(v)))
        object.__setattr__(self, "faces", read_only(np.array(rows, np.int64)))
        if self.radius is not None and np.ndim(self.radius):
            radius = as_array("radius", self.radius, ndim=1)
            if radius.shape != (len(v),):
                raise InputError(
                    f"radius must be one number or one per vertex ({len(v)}), got {radius.shape}"
                )
            object.__setattr__(self, "radius", read_only(np.array(radius)))
        elif callable(self.radius):
            raise InputError("radius of Triangles must be numbers, one or one per vertex")


@dataclass(frozen=True, eq=False)
class Ball(Frozen):
    """A point with a radius: a node of a lattice.

    Parameters
    ----------
    centre : array_like, shape (3,)
        Where it is.
    radius : float, optional
        By default that of the skeleton.

    Raises
    ------
    InputError
        If the radius is not positive.
    """

    centre: FloatArray
    radius: Any = None

    def __post_init__(self) -> None:
        if self.radius is not None:
            object.__setattr__(self, "radius", as_positive("radius", self.radius))
        centre = as_array("centre", self.centre, ndim=1)
        if centre.shape != (3,):
            raise InputError(f"centre must be three numbers, got {centre.tolist()}")
        object.__setattr__(self, "centre", read_only(np.array(centre)))


Single = Polyline | Segments | Arc | Patch | Curve | Surface | Triangles | Ball


@dataclass(frozen=True, eq=False)
class Group(Frozen):
    """Entities that a smooth union takes for one: they are joined sharply.

    Struts in one line belong in a group: the smooth union of two would have a bulge between them.

    Parameters
    ----------
    members : sequence of entities, BSpline or array_like
        At least one; each may have a radius of its own.

    Raises
    ------
    InputError
        If there is none, or one is no entity.
    """

    members: Sequence[Any]

    def __post_init__(self) -> None:
        members = tuple(
            as_single(f"members[{i}]", m) for i, m in enumerate(as_items("members", self.members))
        )
        if not members:
            raise InputError("members must be at least one entity, got none")
        object.__setattr__(self, "members", members)


Entity = Single | Group


def as_single(name: str, value: Any) -> Single:
    """Entity from what users write: an entity, a spline, or corners of a polyline; no group.

    Parameters
    ----------
    name : str
        Name for messages.
    value : Single, BSpline or array_like of shape (n, 3)
        What is given.

    Returns
    -------
    Single
        The entity.

    Raises
    ------
    InputError
        If it is none of these.
    """
    if isinstance(value, Single):
        return value
    if isinstance(value, BSpline):
        return Curve(value) if value.ndim == 1 else Surface(value)
    try:
        points = as_array(name, value)
        if points.shape == (3,):
            raise InputError("it is one point; for a single polyline write [points]")
        return Polyline(as_points(name, value))
    except InputError as e:
        raise InputError(
            f"{name} must be a Polyline, Segments, Arc, Patch, Curve, Surface, Triangles, Ball, "
            f"BSpline or points (n, 3): {e}"
        ) from e


def _check_spline(s: Any, nd: int, what: str) -> None:
    most = 8 if nd == 1 else 5
    if not isinstance(s, BSpline) or s.ndim != nd or s.m != 3 or not 1 <= min(s.k) <= max(s.k):
        raise InputError(f"spline must be {what}, three components, got {s!r:.80}")
    if max(s.k) > most:
        raise InputError(f"spline must be of degree 1 to {most}, got {s.k}")
    if not np.ptp(s.c.reshape(-1, 3), axis=0).max() > TINY:
        raise InputError(
            f"spline must have an extent: it is one point, {s.c.reshape(-1, 3)[0].tolist()}; "
            "a curve of length zero has no direction"
        )
