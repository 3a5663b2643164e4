"""The class `SplineMap`: a spline volume as a map from the parameter box to space.

Guarantees: values and derivatives are those of the spline; a direction is called closed only if
its two end faces coincide; `volume` is exact for polynomial volumes up to rounding.
Non-guarantees: a map is not certified when it is made, but when a lattice is (`check_map`), or
on request (`certificate`); where a map overlaps itself, `inverse` returns one of the parameters.
"""

from collections.abc import Sequence
from copy import deepcopy
from dataclasses import dataclass
from functools import cached_property
from os import PathLike
from typing import TYPE_CHECKING, Any, ClassVar, Self

import numpy as np

from ilattice._geometry import determinants
from ilattice._typing import ArrayLike, FloatArray
from ilattice._validate import (
    Frozen,
    among,
    as_array,
    as_axis,
    as_flag,
    as_items,
    as_points,
    as_whole,
    read_only,
)
from ilattice.bspline import BSpline
from ilattice.bspline.knots import with_planes
from ilattice.errors import InputError
from ilattice.io.registry import save
from ilattice.macroshape._extra import interpolated, warn_missed
from ilattice.macroshape._picture import faces_of, net_of
from ilattice.macroshape._seeds import Seeds, bends
from ilattice.macroshape.certify import Certificate, certify
from ilattice.macroshape.inverse import Located, locate
from ilattice.plot.quick import show

if TYPE_CHECKING:
    import pyvista

__all__ = ["SplineMap"]

MAX_POINTS = 1000  # of a Gauss rule per element and direction


@dataclass(frozen=True, eq=False, repr=False)
class SplineMap(Frozen):
    """Map from the domain of a spline volume to space.

    Parameters
    ----------
    spline : BSpline
        Three parameters, at least three components, degrees of at least 1. The first three
        components are the point, further ones are extra coordinates.
    names : sequence of str, keyword-only
        Names of the extra coordinates, such as ``("r", "g", "b", "d")``; by default
        ``("e0", "e1", ...)``.

    Raises
    ------
    InputError
        If the spline is no volume in space, or the names do not match its components.
    """

    file_kind: ClassVar[str] = "map"
    spline: BSpline
    names: tuple[str, ...] = ()

    def __init__(self, spline: BSpline, *, names: Sequence[str] = ()) -> None:
        if not isinstance(spline, BSpline) or spline.ndim != 3 or spline.m < 3:
            raise InputError(
                "spline must be a BSpline with 3 parameters and at least 3 components, "
                f"got {spline!r:.80}"
            )
        if min(spline.k) < 1:
            raise InputError(f"spline must have degrees of at least 1, got {spline.k}; elevate it")
        extra = spline.m - 3
        names = tuple(as_items("names", names)) or tuple(f"e{i}" for i in range(extra))
        if len(names) != extra or len(set(names)) != extra or not all(map(_is_name, names)):
            raise InputError(
                f"names must be {extra} different words, one per component beyond x, y, z, "
                f"got {names!r}"
            )
        object.__setattr__(self, "spline", spline)
        object.__setattr__(self, "names", names)

    def __repr__(self) -> str:
        size = "×".join(map(str, self.spline.shape))
        kind = ", rational" if self.spline.weights is not None else ""
        extra = f", extra={self.names}" if self.names else ""
        return f"SplineMap({size}, degrees={self.spline.k}{kind}, closed={self.closed}{extra})"

    # ---------------------------------------------------------------- evaluation

    @cached_property
    def geometry(self) -> BSpline:
        """The spline with its first three components only."""
        return self.spline if self.spline.m == 3 else self._with(self.spline.c[..., :3])

    @property
    def domain(self) -> FloatArray:
        """The parameter box, shape (2, 3): rows are the lower and the upper corner."""
        return self.spline.domain

    def x(self, u: ArrayLike, *, extrapolate: str = "raise") -> FloatArray:
        """Points of space.

        Parameters
        ----------
        u : array_like, shape (n, 3)
            Parameters.
        extrapolate : {"raise", "clamp", "extend"}
            What happens outside the domain, as in `BSpline`.

        Returns
        -------
        ndarray, shape (n, 3)
            Points.
        """
        return self.geometry(u, extrapolate=extrapolate)

    def jacobian(self, u: ArrayLike, *, extrapolate: str = "raise") -> FloatArray:
        """First derivatives.

        Parameters
        ----------
        u : array_like, shape (n, 3)
            Parameters.
        extrapolate : {"raise", "clamp", "extend"}
            What happens outside the domain, as in `BSpline`.

        Returns
        -------
        ndarray, shape (n, 3, 3)
            ``J[:, c, k] = dx_c / du_k``.
        """
        return self.geometry.jet(u, 1, extrapolate=extrapolate)[1]

    def hessian(self, u: ArrayLike, *, extrapolate: str = "raise") -> FloatArray:
        """Second derivatives.

        Parameters
        ----------
        u : array_like, shape (n, 3)
            Parameters.
        extrapolate : {"raise", "clamp", "extend"}
            What happens outside the domain, as in `BSpline`.

        Returns
        -------
        ndarray, shape (n, 3, 3, 3)
            ``H[:, c, k, l] = d²x_c / du_k du_l``.
        """
        return self.geometry.jet(u, 2, extrapolate=extrapolate)[2]

    def jet(
        self, u: ArrayLike, order: int = 2, *, extrapolate: str = "raise"
    ) -> tuple[FloatArray, ...]:
        """Points, first and second derivatives in one pass.

        Parameters
        ----------
        u : array_like, shape (n, 3)
            Parameters.
        order : {0, 1, 2}
            Highest derivative.
        extrapolate : {"raise", "clamp", "extend"}
            What happens outside the domain, as in `BSpline`.

        Returns
        -------
        tuple of ndarray
            The first ``order + 1`` of x (n, 3), J (n, 3, 3), H (n, 3, 3, 3).
        """
        return self.geometry.jet(u, order, extrapolate=extrapolate)

    @cached_property
    def _coordinates(self) -> tuple[BSpline, ...]:
        """The coordinates of space as scalar splines."""
        g = self.geometry
        return tuple(
            BSpline(g.t, g.c[..., c], g.k, periodic=g.periodic, weights=g.weights) for c in range(3)
        )

    def boxes(self, lo: ArrayLike, hi: ArrayLike) -> FloatArray:
        """Boxes of space that hold the images of boxes of parameters.

        Parameters
        ----------
        lo, hi : array_like, shape (m, 3)
            Corners; clipped to the domain.

        Returns
        -------
        ndarray, shape (m, 2, 3)
            Lower and upper corners: rigorous, from Bernstein coefficients.
        """
        return np.stack([c.range(lo, hi) for c in self._coordinates], axis=2)

    def extra(self, u: ArrayLike, *, extrapolate: str = "raise") -> FloatArray:
        """Coordinates beyond x, y, z: colour, material, thickness.

        Parameters
        ----------
        u : array_like, shape (n, 3)
            Parameters.
        extrapolate : {"raise", "clamp", "extend"}
            What happens outside the domain, as in `BSpline`.

        Returns
        -------
        ndarray, shape (n, m - 3)
            One column per name.
        """
        if not self.names:
            return np.empty((len(as_points("u", u)), 0))
        return self._attributes(u, extrapolate=extrapolate)

    @cached_property
    def _attributes(self) -> BSpline:
        return self._with(self.spline.c[..., 3:])

    def inverse(self, x: ArrayLike, *, tol: float = 1e-10) -> FloatArray:
        """Parameters of points.

        Parameters
        ----------
        x : array_like, shape (n, 3)
            Points.
        tol : float
            Points nearer to the image than `tol` times the diagonal of `bounds` count as
            inside. Found points are solved to rounding, not to this tolerance.

        Returns
        -------
        ndarray, shape (n, 3)
            Parameters inside the domain; rows of NaN where `x` is outside the image.

        Warns
        -----
        PrecisionWarning
            If the search failed for some points: these rows are NaN too, and `locate` tells
            them from the points outside.
        """
        found = locate(self._seeds, as_points("x", x), tol=tol)
        found.warn()
        return found.u

    def locate(self, x: ArrayLike, *, tol: float = 1e-10) -> Located:
        """Parameters of points, with status, distance and number of iterations.

        Parameters
        ----------
        x : array_like, shape (n, 3)
            Points.
        tol : float
            As in `inverse`.

        Returns
        -------
        Located
            What the search found for every point.
        """
        found = locate(self._seeds, as_points("x", x), tol=tol)
        for a in (found.u, found.status, found.distance, found.iterations):
            read_only(a)
        return found

    @cached_property
    def _seeds(self) -> Seeds:
        diagonal = float(np.linalg.norm(self.bounds[1] - self.bounds[0]))
        return Seeds(self.geometry, self.closed, diagonal)

    # ---------------------------------------------------------------- properties

    @cached_property
    def bounds(self) -> FloatArray:
        """Bounding box of the control net, shape (2, 3); the image lies inside."""
        net = self.spline.c[..., :3].reshape(-1, 3)
        return read_only(np.stack([net.min(axis=0), net.max(axis=0)]))

    @cached_property
    def closed(self) -> tuple[bool, bool, bool]:
        """Per direction, whether its two end faces coincide point by point."""
        a, b, c = (self.spline.periodic[k] or self._faces_meet(k) for k in range(3))
        return a, b, c

    @property
    def wraps(self) -> tuple[bool, bool, bool]:
        """Per direction, whether what is inside goes on at the other end: where it is closed.

        Cells that repeat (`cell`) do so in all directions, and are closed in none.
        """
        return self.closed

    def _faces_meet(self, axis: int) -> bool:
        """Compare the end faces at as many sites as determine them; 1e-12 of the size passes."""
        sites = [_face_sites(self.geometry.breaks(k), self.spline.k[k]) for k in range(3)]
        sites[axis] = self.domain[:, axis]
        faces = np.moveaxis(np.asarray(self.geometry.grid(sites)), axis, 0)
        size = float(np.abs(self.bounds).max())
        gap = float(np.abs(faces[1] - faces[0]).max())
        return gap <= 1e-12 * size

    @cached_property
    def certificate(self) -> Certificate:
        """Jacobian certificate: status, orientation, worst place."""
        return certify(self)

    @property
    def orientation(self) -> int:
        """+1 for a right-handed map, -1 for a left-handed one, 0 for a flat one."""
        return self.certificate.orientation

    @property
    def info(self) -> dict[str, Any]:
        """Plain summary: size, domain, bounds, handedness, certificate, volume; a copy of yours."""
        return deepcopy(self._info)

    @cached_property
    def _info(self) -> dict[str, Any]:
        """What `info` says."""
        s, c = self.spline, self.certificate
        return {
            "shape": list(s.shape),
            "degrees": list(s.k),
            "rational": s.weights is not None,
            "periodic": list(s.periodic),
            "closed": list(self.closed),
            "domain": self.domain.tolist(),
            "bounds": self.bounds.tolist(),
            "extra": list(self.names),
            "orientation": c.orientation,
            "certificate": str(c.status),
            "least_det": c.worst_det,
            "least_det_u": c.worst_u.tolist(),
            "least_det_x": c.worst_x.tolist(),
            "scaled_jacobian": c.scaled,
            "singular_u": c.singular_u.tolist(),
            "volume": self.volume(),
        }

    def volume(self, *, points: int | None = None) -> float:
        """Volume of the image, the integral of |det J| of a map that is not folded.

        Parameters
        ----------
        points : int, optional
            Gauss points per element and direction. By default enough to be exact for a
            polynomial volume, and for a rational one to be right to about ten digits on
            circular arcs of up to a quarter turn.

        Returns
        -------
        float
            The absolute value of the integral of det J.
        """
        planes = [self.spline.breaks(axis) for axis in range(3)]
        return abs(float(self.box_volumes(planes, points=points).sum()))

    def box_volumes(
        self, planes: Sequence[ArrayLike], *, points: int | None = None, split: bool = True
    ) -> FloatArray:
        """Volumes of the images of boxes, the integrals of det J.

        Parameters
        ----------
        planes : sequence of 3 array_like, shapes (n_i + 1,)
            Planes between the boxes, increasing, within the domain.
        points : int, optional
            Gauss points per direction, box and element of the spline; see `volume`.
        split : bool
            Whether there is a rule per box and element; else one per box, however many elements
            of the spline it holds.

        Returns
        -------
        ndarray, shape (n_0, n_1, n_2)
            Negative of left-handed maps.

        Raises
        ------
        InputError
            If planes do not increase, or leave the domain.
        """
        rational = self.spline.weights is not None
        points = None if points is None else as_whole("points", points, 1, MAX_POINTS)
        split, boxes = as_flag("split", split), self._as_planes(planes)
        sites, weights, firsts = [], [], []
        for axis, given in enumerate(boxes):
            n = points or (3 * self.spline.k[axis] + 1) // 2 + 6 * rational
            s, w = np.polynomial.legendre.leggauss(n)
            b = with_planes(given, self.spline.breaks(axis)) if split else given
            half = 0.5 * np.diff(b)
            sites.append((0.5 * (b[1:] + b[:-1])[:, None] + np.outer(half, s)).ravel())
            weights.append(np.outer(half, w).ravel())
            firsts.append(n * np.searchsorted(b, given[:-1]))
        rows = []
        for first, last, jet in self.geometry.slabs(sites, 1):
            det = determinants(jet[1]) * weights[0][first:last, None, None]
            det = np.add.reduceat(det * weights[1][:, None], firsts[1], axis=1)
            rows.append(np.add.reduceat(det * weights[2], firsts[2], axis=2))
        return np.add.reduceat(np.concatenate(rows), firsts[0], axis=0)

    def _as_planes(self, planes: Any) -> list[FloatArray]:
        """Increasing planes of the three parameters, within the domain, up to rounding."""
        items = as_items("planes", planes)
        if len(items) != 3:
            raise InputError(f"planes must hold three arrays, got {len(items)}")
        out = []
        for axis, (lo, hi) in enumerate(self.domain.T):
            x, slack = as_array(f"planes[{axis}]", items[axis], ndim=1), 1e-9 * (hi - lo)
            inside = len(x) > 1 and lo - slack <= x[0] and x[-1] <= hi + slack
            if not (inside and (np.diff(x) > 0.0).all()):
                raise InputError(
                    f"planes[{axis}] must hold two or more increasing numbers from {lo:g} to {hi:g}"
                )
            out.append(np.clip(x, lo, hi))
        return out

    def bends(self, axis: int) -> FloatArray:
        """Inner knots of one parameter at which first derivatives may jump.

        Parameters
        ----------
        axis : int
            Parameter.

        Returns
        -------
        ndarray, shape (n,)
            Increasing: the knots that repeat as often as the degree says, or more often.
        """
        return bends(self.spline, as_axis("axis", axis, 3))

    # ---------------------------------------------------------------- variations

    def with_extra(self, **coordinates: Any) -> Self:
        """Same map with further coordinates, the ℝ⁷ of the paper among them.

        Parameters
        ----------
        **coordinates : float, array_like (n0, n1, n2) or callable
            By name: a constant; coefficients on the knots of the map; or a function of
            parameters (n, 3) that returns values (n,). A function is interpolated in the
            spline space of the map, so it varies no faster than the map can: two
            coefficients along a direction make it linear there. For more, see Notes.

        Returns
        -------
        SplineMap
            The map with its old extra coordinates, then the new ones.

        Raises
        ------
        InputError
            If a name is taken, or coefficients or values are of the wrong shape.

        Warns
        -----
        PrecisionWarning
            If a function is missed by more than 1 % of its range.

        Notes
        -----
        A map gets more coefficients, and stays the same, by
        ``SplineMap(map.spline.elevate(axis, 2).insert_knots(axis, knots), names=map.names)``,
        with knots inside of the domain.

        Hong, Antolin, Elber, Kim (Variable offsets and processing of implicit forms) hold
        volumes in ℝ⁷: x, y, z, then red, green, blue, then the half-thickness d.
        """
        new = [self._extra_coefficients(n, v) for n, v in coordinates.items()]
        if not new:
            return self
        c = np.concatenate([self.spline.c, np.stack(new, axis=-1)], axis=-1)
        rich = type(self)(self._with(c), names=(*self.names, *coordinates))
        for (name, value), scalar in zip(coordinates.items(), new, strict=True):
            if callable(value):
                warn_missed(self._with(scalar), name, value)
        return rich

    def _extra_coefficients(self, name: str, value: Any) -> FloatArray:
        shape = self.spline.shape
        if callable(value):
            return interpolated(self.spline, name, value)
        c = as_array(name, value)
        if np.ndim(value) not in (0, 3) or (np.ndim(value) == 3 and c.shape != shape):
            raise InputError(
                f"{name} must be a number, coefficients of shape {shape} or a function, "
                f"got shape {np.shape(value)}"
            )
        return np.array(np.broadcast_to(c, shape))

    def _with(self, c: FloatArray) -> BSpline:
        s = self.spline
        return BSpline(s.t, c, s.k, periodic=s.periodic, weights=s.weights)

    def flipped(self, axis: int = 2) -> Self:
        """Same volume with one direction run backwards: the handedness changes.

        Parameters
        ----------
        axis : {0, 1, 2}
            Direction.

        Returns
        -------
        SplineMap
            On the same domain.
        """
        axis = as_axis("axis", axis)
        s = self.spline
        t = list(s.t)
        t[axis] = (self.domain[:, axis].sum() - s.t[axis])[::-1]
        w = None if s.weights is None else np.flip(s.weights, axis)
        spline = BSpline(t, np.flip(s.c, axis), s.k, periodic=s.periodic, weights=w)
        return type(self)(spline, names=self.names)

    def permuted(self, order: Sequence[int]) -> Self:
        """Same volume with its directions in another order.

        Parameters
        ----------
        order : sequence of int
            The old directions in their new order, such as ``(2, 0, 1)``. An odd permutation
            changes the handedness.

        Returns
        -------
        SplineMap
            The map with permuted parameters.
        """
        listed = as_items("order", order)
        if not all(among(a, range(3)) for a in listed) or sorted(listed) != [0, 1, 2]:
            raise InputError(f"order must be a permutation of 0, 1, 2, got {order!r}")
        s = self.spline
        t, k, wrap = (
            [s.t[i] for i in order],
            [s.k[i] for i in order],
            [s.periodic[i] for i in order],
        )
        w = None if s.weights is None else s.weights.transpose(order)
        spline = BSpline(t, s.c.transpose(*order, 3), k, periodic=wrap, weights=w)
        return type(self)(spline, names=self.names)

    def fix_orientation(self, *, axis: int = 2) -> Self:
        """Right-handed version of this map.

        Parameters
        ----------
        axis : {0, 1, 2}
            Direction that is run backwards if the map is left-handed.

        Returns
        -------
        SplineMap
            This map itself if it is right-handed.
        """
        axis = as_axis("axis", axis)
        return self.flipped(axis) if self.orientation < 0 else self

    def to_pyvista(self, n: int = 33) -> "pyvista.PolyData":
        """Its faces, for pictures; not those where a closed map meets itself.

        Parameters
        ----------
        n : int
            Points along each edge.

        Returns
        -------
        pyvista.PolyData
            With further coordinates as point data.
        """
        return faces_of(self, as_whole("n", n, 2, 500))

    def plot(self, *, n: int = 9, **options: Any) -> Any:
        """Show the volume, with lines of constant parameters, in a window or a notebook.

        Parameters
        ----------
        n : int
            Lines along each direction.
        **options
            Of `ilattice.plot.show`, such as ``view`` or ``screenshot``.

        Returns
        -------
        object
            What pyvista returns.
        """
        return show(self, lines=net_of(self, as_whole("n", n, 2, 100)), **options)

    def save(self, path: str | PathLike[str]) -> None:
        """Write the volume to a file; its ending names the format.

        Parameters
        ----------
        path : path-like
            Where to.

        Raises
        ------
        FormatError
            If the format is unknown, or cannot hold this map.
        """
        save(self, path)


def _is_name(name: Any) -> bool:
    return isinstance(name, str) and name.isidentifier() and name not in ("x", "y", "z")


def _face_sites(breaks: FloatArray, degree: int) -> FloatArray:
    """Sites that determine a rational piecewise polynomial of the given degree."""
    s = (np.arange(2 * degree + 1) + 0.5) / (2 * degree + 1)
    return (breaks[:-1, None] + np.diff(breaks)[:, None] * s).ravel()
