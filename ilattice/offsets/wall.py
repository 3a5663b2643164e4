"""Walls: the part of a lattice within a given distance of its mid-surface.

Guarantees: the wall is the pair of level sets S < d_outer and S > -d_inner of one distance
spline S; another thickness does not compute distances again; where offset surfaces meet, the
topology follows by itself. Non-guarantee: between sites S is exact to its fit only; `tol`
refines it, and `mesh(polish=True)` moves vertices onto the exact offset.
"""

from __future__ import annotations

import warnings
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from ilattice._progress import Progress
from ilattice._typing import AnyArray, ArrayLike, FloatArray
from ilattice._validate import (
    as_flag,
    as_float_type,
    as_kind,
    as_not_negative,
    as_points,
    as_positive,
)
from ilattice.bspline import BSpline
from ilattice.errors import GeometryError, InputError, PrecisionWarning
from ilattice.offsets.distance_spline import distance_spline
from ilattice.offsets.local_thickness import depths_of, least_of, points
from ilattice.offsets.thickness import Thickness, as_thickness

if TYPE_CHECKING:
    from os import PathLike

    from ilattice.macroshape.lattice import Lattice
    from ilattice.mesh.slices import SliceStack
    from ilattice.mesh.surface import SurfaceMesh
    from ilattice.mesh.topology import TopologyReport
    from ilattice.offsets.features import Feature

#: Boxes of up to so many spans per direction are bounded element by element, wider ones by the
#: extremes of their coefficients: contouring asks for boxes of hundreds of elements.
NARROW = 4
#: Random points, and the corners, at which a wall that fills the part is noticed.
FILLED = 4096
CORNERS = np.indices((2, 2, 2)).reshape(3, -1).T


@dataclass(frozen=True)
class ThicknessReport:
    """Error | |distance| - d | of the half-thickness over the vertices of a wall's mesh.

    Attributes
    ----------
    max, p99, rms : float
        Largest, 99th percentile, root mean square, in units of length.
    relative : float
        99th percentile relative to d; on sides where d is zero, to the least total thickness.
    relative_max : float
        Largest, likewise.
    count : int
        Number of vertices measured: those of the offset surfaces, caps excluded.
    missing : float
        Part of the offset surfaces, by area, next to which the mesh has no triangle.
    """

    max: float
    p99: float
    rms: float
    relative: float
    relative_max: float
    count: int
    missing: float


@dataclass(frozen=True, eq=False)
class WallField:
    """The implicit function of a wall, negative in the wall: max(S - d_outer, -S - d_inner).

    Attributes
    ----------
    distance : BSpline
        Signed distance S.
    thickness : Thickness
        Half-thickness on both sides.
    """

    distance: BSpline
    thickness: Thickness

    @property
    def bounds(self) -> FloatArray:
        """The parameter domain, shape (2, 3)."""
        return self.distance.domain

    def __call__(self, u: ArrayLike, /) -> FloatArray:
        """Value, shape (n,), at parameters (n, 3)."""
        return self.jet(u, 0)[0]

    def jet(self, u: ArrayLike, order: int = 2) -> tuple[FloatArray, ...]:
        """Value, gradient and Hessian of the side that bounds the wall: `order` + 1 of them."""
        u = as_points("u", u)
        s = self.distance.jet(u, order)
        outer = self.thickness.outer.jet(u, order)
        inner = outer if self.thickness.symmetric else self.thickness.inner.jet(u, order)
        out = s[0] - outer[0] >= -s[0] - inner[0]
        pick = [out.reshape(-1, *(1,) * (a.ndim - 1)) for a in s]
        return tuple(
            np.where(p, a - b, -a - c) for p, a, b, c in zip(pick, s, outer, inner, strict=True)
        )

    def range(self, lo: ArrayLike, hi: ArrayLike) -> FloatArray:
        """Rigorous bounds, shape (m, 2), on boxes; looser ones on boxes of many spans."""
        lo, hi = as_points("lo", lo), as_points("hi", hi)
        spans = np.array([np.diff(self.distance.breaks(a)).max() for a in range(3)])
        narrow = (hi - lo <= NARROW * spans).all(axis=1)
        out = np.empty((len(lo), 2))
        for tight in (False, True):
            at = np.flatnonzero(narrow == tight)
            out[at] = self._bounds(lo[at], hi[at], tight)
        return out

    def _bounds(self, lo: FloatArray, hi: FloatArray, tight: bool) -> FloatArray:
        s = self.distance.range(lo, hi, tight=tight)
        outer = self.thickness.outer.range(lo, hi, tight=tight)
        symmetric = self.thickness.symmetric
        inner = outer if symmetric else self.thickness.inner.range(lo, hi, tight=tight)
        low = np.maximum(s[:, 0] - outer[:, 1], -s[:, 1] - inner[:, 1])
        high = np.maximum(s[:, 1] - outer[:, 0], -s[:, 0] - inner[:, 0])
        return np.stack([low, high], axis=1)

    def side(self, u: FloatArray) -> FloatArray:
        """+1 where the outer level set bounds the wall, -1 where the inner one does."""
        s = self.distance(u)
        return np.where(s - self.thickness.outer(u) >= -s - self.thickness.inner(u), 1.0, -1.0)


@dataclass(frozen=True, eq=False)
class Wall:
    """Wall of a lattice: made by `Lattice.offset`.

    Attributes
    ----------
    lattice : Lattice
        Where it comes from.
    distance : BSpline
        Signed distance to the mid-surface as a function of the parameters.
    thickness : Thickness
        Half-thickness on both sides.
    """

    lattice: Lattice
    distance: BSpline
    thickness: Thickness

    @cached_property
    def field(self) -> WallField:
        """The implicit function, negative in the wall."""
        return WallField(self.distance, self.thickness)

    @cached_property
    def least_thickness(self) -> float:
        """Least total thickness; of a solid, but for the thinnest tenth of its surface."""
        least = self.thickness.extremes[0]
        if not self.thickness.solid:
            return least
        depth = -float(self.distance.c.min())
        u, depths, area = depths_of(self.lattice, depth)
        local = depths + self.thickness.outer(u)
        left = local > 0.0
        if left.any():
            return 2.0 * least_of(local[left], area[left])
        if least + depth > 0.0:
            return 2.0 * (least + depth)
        raise GeometryError(
            f"nothing is left of the solid: it is {depth:g} deep and eroded by {-least:g}"
        )

    def mesh(
        self,
        h: float | None = None,
        *,
        polish: bool = True,
        caps: bool = True,
        dtype: Any = np.float64,
        allow_loss: bool = False,
        progress: Progress = None,
    ) -> SurfaceMesh:
        """Watertight triangle mesh in space.

        Parameters
        ----------
        h : float, optional
            Length of edges; by default a quarter of the least total thickness. Where it is more
            than two thirds of that, the mesh is made from the mid-surface, moved to both sides:
            edges may be longer than the wall is thick by any factor.
        polish : bool
            Move the vertices of the offset surfaces onto the exact offset by closest points.
            Parametric walls have none; theirs are moved onto the first-order one.
        caps : bool
            Close the wall on the faces of the domain; otherwise it is open there.
        dtype : float64 or float32
            Type of the vertices.
        allow_loss : bool
            Accept a mesh whose volume differs by more than 5 % from that of the wall, either way.
            A `PrecisionWarning` names differences of more than 1 %, of meshes with edges shorter
            than 0.6 of the least thickness of more than 2 %.
        progress : bool or callable, optional
            See `ilattice._progress.track`.

        Returns
        -------
        SurfaceMesh
            Outward oriented, with point data: signed_distance, half_thickness (on the side of the
            vertex), thickness (of both sides together; solids have none), parameters u, v, w, side
            (0 on caps), held (1 where a vertex is off the offset, to keep triangles from
            crossing), and the properties of the lattice.

        Raises
        ------
        InputError
            If `h` is not positive, or `dtype` is neither of the two.
        GeometryError
            If the wall is empty, or the mesh too coarse for it; the message says which `h` is not.
        ConvergenceError
            If more than a thousandth of the vertices cannot be moved onto the offset: `h` is too
            long for what is between them. Two in a hundred may be next to creases, off either side
            by a quarter of the length of edges at most, and any number where the distance jumps at
            the end of the continuation; a `PrecisionWarning` tells of a thousandth and more.
        """
        from ilattice.mesh.wall_mesh import wall_mesh

        dtype = as_float_type("dtype", dtype)
        h = None if h is None else as_positive("h", h)
        caps, allow_loss = as_flag("caps", caps), as_flag("allow_loss", allow_loss)
        _warn_full(self)
        return wall_mesh(
            self, h, polish=self._polished(polish), caps=caps, dtype=dtype, progress=progress,
            allow_loss=allow_loss,
        )  # fmt: skip

    def save(
        self,
        path: str | PathLike[str],
        h: float | None = None,
        *,
        polish: bool = True,
        allow_loss: bool = False,
        progress: Progress = None,
    ) -> None:
        """Mesh and write slab by slab, for walls whose mesh is larger than memory.

        Parameters
        ----------
        path : path-like
            File ending in ``.stl`` or ``.ply``.
        h, polish, allow_loss, progress : optional
            As in `mesh`. Walls that are meshed from their mid-surface are held in memory as a
            whole.

        Raises
        ------
        FormatError
            If the file cannot be written as that format.
        """
        from ilattice.io.stream import StreamedMeshWriter
        from ilattice.mesh.wall_mesh import wall_pieces

        h = None if h is None else as_positive("h", h)
        _warn_full(self)
        with StreamedMeshWriter(path) as writer:
            for vertices, faces in wall_pieces(
                self, h, polish=self._polished(polish), progress=progress, allow_loss=allow_loss
            ):
                writer.append(vertices, faces)

    def plot(self, h: float | None = None, **options: Any) -> Any:
        """Show the wall in a window or a notebook.

        Parameters
        ----------
        h : float, optional
            Length of edges, as in `mesh`.
        **options
            Of `ilattice.plot.show`, such as ``clip``, ``view`` or ``screenshot``.

        Returns
        -------
        object
            What pyvista returns.
        """
        return self.mesh(h).plot(**options)

    def slices(
        self,
        z: ArrayLike | None = None,
        *,
        thickness: float | None = None,
        h: float | None = None,
        normal: ArrayLike = (0.0, 0.0, 1.0),
        polish: bool = True,
    ) -> SliceStack:
        """Closed, oriented and nested contours at given heights, without a mesh.

        Parameters
        ----------
        z : array_like, shape (n,), optional
            Heights of the cuts, increasing, at least one of them within the part; beyond it
            slices are empty.
        thickness : float, optional
            In place of `z`: layers of this thickness from the lowest point of the part to its
            highest, cut half-way up. The last one is what is left of the height.
        h : float, optional
            Length of the edges of contours; by default a quarter of the least total thickness.
        normal : array_like, shape (3,)
            Direction of the heights.
        polish : bool
            Move the contours onto the exact offset by closest points; otherwise they are those
            of the distance spline, and come several times faster.

        Returns
        -------
        SliceStack
            An iterable that computes one slice at a time; ``save`` writes it.

        Raises
        ------
        InputError
            If neither or both of `z` and `thickness` are given, something is not positive,
            finite or increasing, or all of `z` is outside of the part.
        """
        from ilattice.mesh.slices import slice_wall

        return slice_wall(
            self, z, thickness=thickness, h=h, normal=normal, polish=self._polished(polish)
        )

    def topology(
        self, h: float | None = None, *, necks: float | None = None, progress: Progress = None
    ) -> TopologyReport:
        """Parts, handles, voids (traps of powder or resin), islands and thin necks.

        Parameters
        ----------
        h : float, optional
            Length of the edges of the contour that is counted, as in `mesh`.
        necks : float, optional
            How much another half-thickness may differ for a change of topology to be reported as
            a neck; by default a tenth of the least total thickness. 0 looks for none.
        progress : bool or callable, optional
            See `ilattice._progress.track`.

        Returns
        -------
        TopologyReport
            Counts, and the place and volume of every part and void. No necks are looked for in
            parametric walls, nor in solids of struts and plates as they are.

        Raises
        ------
        InputError
            If `h` is not positive, or `necks` is negative.
        """
        from ilattice.mesh.topology import wall_topology

        h = None if h is None else as_positive("h", h)
        necks = None if necks is None else as_not_negative("necks", necks)
        return wall_topology(self, h, necks, progress)

    def minimum_thickness(self) -> Feature:
        """Thinnest part: the two half-thicknesses together, or a web that has just closed.

        Returns
        -------
        Feature
            Size and place. A wall that a face of the domain cuts at an angle is not thinner.

        Raises
        ------
        InputError
            For solids, parametric walls, and ``boundary="clip"``.
        """
        from ilattice.offsets.features import minimum_thickness

        return minimum_thickness(self._in_space("minimum_thickness"))

    def minimum_gap(self) -> Feature:
        """Narrowest gap: twice what the wall may grow before pores change their topology.

        Returns
        -------
        Feature
            Size and place; a ball of less diameter passes wherever there is a way at all.

        Raises
        ------
        InputError
            For parametric walls, and ``boundary="clip"``.
        """
        from ilattice.offsets.features import minimum_gap

        return minimum_gap(self._in_space("minimum_gap"))

    def _in_space(self, name: str) -> Wall:
        if not self._exact:
            raise InputError(f"{name} is for walls in space, this one is parametric")
        return self

    def volume(self) -> float:
        """Volume of the wall in space, by cut-cell quadrature.

        Returns
        -------
        float
            Volume, as the distance spline has it: see `tol` of `offset`. Meshes hold less, those
            of struts that are two cells thick one to three parts in a hundred.
        """
        from ilattice.cutfem.density import wall_volumes

        if "volume" not in self._known:
            self._known["volume"] = float(wall_volumes(self).sum())
        return self._known["volume"]

    @property
    def known_volume(self) -> float | None:
        """What `volume` has returned, also to `mesh`; None if it was not asked for."""
        return self._known.get("volume")

    def relative_density(self, *, per_cell: bool = False) -> Any:
        """Part of the macro-shape that the wall fills, by cut-cell quadrature.

        Parameters
        ----------
        per_cell : bool
            Whether to give one number per tile.

        Returns
        -------
        float, or ndarray of shape (nx, ny, nz)
            Relative density.
        """
        from ilattice.cutfem.density import relative_density

        return relative_density(self, per_cell=as_flag("per_cell", per_cell))

    def thickness_error(self, mesh: SurfaceMesh | None = None) -> ThicknessReport:
        """How far the wall is from the asked thickness, by fresh closest points.

        Parameters
        ----------
        mesh : SurfaceMesh, optional
            A mesh of this wall; by default an unpolished one, which measures the spline.

        Returns
        -------
        ThicknessReport
            Errors over the vertices of the offset surfaces, caps excluded, and what part of these
            surfaces the mesh lacks.
        """
        from ilattice.mesh.coverage import missing_part

        if mesh is None:
            mesh = self.mesh(polish=False)
        u, side = parameters_of(as_kind("mesh", mesh, "SurfaceMesh"))
        if not side.any():  # the wall fills the part
            return ThicknessReport(0.0, 0.0, 0.0, 0.0, 0.0, 0, 0.0)
        error, asked = self._errors(u[side != 0], side[side != 0])
        relative = error / np.where(asked != 0.0, np.abs(asked), self.least_thickness)
        return ThicknessReport(
            float(error.max()), float(np.percentile(error, 99)),
            float(np.sqrt(np.mean(error**2))), float(np.percentile(relative, 99)),
            float(relative.max()), len(error), missing_part(self, mesh),
        )  # fmt: skip

    def _polished(self, polish: bool) -> bool:
        """Whether vertices move onto the exact offset, if that is asked for."""
        return as_flag("polish", polish) and self._exact

    @cached_property
    def _known(self) -> dict[str, float]:
        """What has been computed already."""
        return {}

    def _middle(self, most: int) -> tuple[FloatArray, FloatArray]:
        """Parameters (n, 3) of points of the mid-surface, and areas (n,), up to a factor."""
        u, _, _, area = points(self.lattice, most)
        return u, area

    def _planes(self, h: float) -> tuple[FloatArray, ...]:
        """Grid planes of a mesh with edges of length `h`."""
        from ilattice.mesh.wall_mesh import grid_axes

        return grid_axes(self, h)

    #: Whether vertices can be polished onto an exact offset.
    _exact = True
    #: Whether necks can be found: where the distance has critical points.
    _has_necks = True
    #: Whether edges of meshes are made sharp where the gradient of the field jumps.
    creased = False

    @property
    def _asked(self) -> Thickness:
        """The half-thickness as it was asked for, in the units of `_true_distance`."""
        return self.thickness

    def _true_distance(self, u: FloatArray) -> FloatArray:
        """Signed distance to the mid-surface by fresh closest points."""
        return self.lattice.distance(u)

    def _errors(self, u: FloatArray, side: AnyArray) -> tuple[FloatArray, FloatArray]:
        """Errors of the half-thickness at points of the offset surfaces, and what it should be."""
        asked = self._asked.at(u, side)
        return np.abs(side * self._true_distance(u) - asked), asked


def parameters_of(mesh: SurfaceMesh) -> tuple[FloatArray, AnyArray]:
    """Parameters (V, 3) and side (V,) of the vertices of a wall's mesh."""
    data = mesh.point_data
    u = np.stack([data[name] for name in ("u", "v", "w")], axis=1).astype(np.float64)
    return u, data["side"]


def offset(
    lattice: Lattice,
    d: Any = None,
    *,
    points: ArrayLike | None = None,
    values: ArrayLike | None = None,
    relative_density: Any = None,
    tol: float | None = None,
    least_wall: float | None = None,
    least_gap: float | None = None,
    progress: Progress = None,
) -> Wall:
    """Wall of Euclidean half-thickness `d` about the mid-surface of a lattice.

    Parameters
    ----------
    lattice : Lattice
        Tiles and map.
    d : float, callable, Node, BSpline, str, or pair of these
        Half-thickness in units of length, on both sides, or (inner, outer) for the sides where
        the implicit function is negative and positive. A callable takes parameters (n, 3), and
        may have kinks but no jumps; a text is the name of a property of the lattice, or an
        equation, in u, v, w or in x, y, z of space, ``"max(0.05, 0.1*u)"``; other fields of
        `ilattice.fields` are functions of space. ``(np.inf, d)`` is the solid of the tile, grown
        by d, or eroded if d is negative; ``(np.inf, 0)`` takes no distances.
    points, values : array_like, shape (n, 3) and (n,), optional
        In place of `d`: half-thickness at points of space, interpolated in between and within the
        range of the values, see `ilattice.offsets.scattered`.
    relative_density : float, callable, or array_like of shape (nx, ny, nz), optional
        Part of the volume that the wall shall fill: of the whole, or of every tile (a callable
        takes the parameters (n, 3) of their centres). `d` then is the shape of the thickness,
        which is scaled until the density is met; by default it is constant. Of the solid
        ``(np.inf, d)`` the growth d is scaled, and must not vanish: d > 0 reaches densities above
        that of the solid, d < 0 those below, of the whole only.
    tol : float, optional
        Largest error (99th percentile) of the half-thickness, in units of length; the distance
        spline is refined until it holds. It is for what goes by the spline: quadrature, analysis,
        and meshes and slices that are not polished. See Notes.
    least_wall, least_gap : float, optional
        What can be made: a wall with a thinner part or a narrower gap (see
        `Wall.minimum_thickness` and `Wall.minimum_gap`) is refused.
    progress : bool or callable, optional
        See `ilattice._progress.track`.

    Returns
    -------
    Wall
        The wall; it shares the distance spline with every other wall of the lattice.

    Raises
    ------
    InputError
        If `d` is not positive, not continuous or larger than the part, or `tol` is not positive,
        or `least_wall` or `least_gap` is negative, or a density cannot be reached (the message
        says which can).
    ConvergenceError
        If `tol` is not met with 96 spans per tile, or the densities of tiles are not met.
    GeometryError
        If something is smaller than `least_wall` or `least_gap`; the message says where.

    Notes
    -----
    Hong et al. 2025, eq. 4 and 5: I_+e and I_-e are S - d and S + d.

    Without `tol` S has 16 spans per tile. In the walls of their Figures 14 and 15, which come
    within a third of a span of the creases and focal curves of the distance, 1 % of the surface
    then is off by more than 3 to 7 % of d. With ``tol=0.01 * d`` it takes 32 spans for the gyroid
    in the torus, 40 in the duck and 64 where its thickness varies, and 6, 12 and 15 times as many
    closest points, for these are asked near the surfaces and creases only. That takes minutes in
    large parts, which is why there is no default.
    """
    if points is not None or values is not None:
        from ilattice.offsets.scattered import scattered

        if d is not None or points is None or values is None:
            raise InputError("give points and values together, in place of d")
        d = scattered(lattice, points, values)
    if d is None and relative_density is None:
        raise InputError("offset needs a half-thickness d, or a relative_density")
    tol = None if tol is None else as_positive("tol", tol)
    size = float(np.linalg.norm(np.diff(lattice.through.bounds, axis=0)))
    for name, least in (("least_wall", least_wall), ("least_gap", least_gap)):
        if least is not None and as_not_negative(name, least) > size:
            raise InputError(f"{name} must be at most the size {size:.4g} of the part, got {least}")
    d = 1e-3 * size if d is None else d
    sides = as_thickness(d, lattice)
    if sides.unchanged and relative_density is None:
        from ilattice.offsets.solid import solid_wall

        wall: Wall = solid_wall(lattice, sides, tol)
        tol = None
    else:
        wall = Wall(lattice, distance_spline(lattice, progress=progress), sides)
    if relative_density is not None:
        from ilattice.cutfem.density import wall_of_density

        wall = wall_of_density(wall, relative_density)
    if tol is not None:
        from ilattice.offsets.tolerance import refined

        wall = refined(wall, tol, progress)
    if least_wall is not None or least_gap is not None:
        from ilattice.offsets.features import check_features

        check_features(wall, least_wall, least_gap)
    return wall


def _warn_full(wall: Wall) -> None:
    """Warn of a wall that fills the part."""
    lo, hi = wall.lattice.domain
    u = lo + (hi - lo) * np.random.default_rng(0).random((FILLED, 3))
    full = wall.field(u).max() < 0.0
    if full and wall.field(lo + (hi - lo) * CORNERS).max() < 0.0:
        top = np.abs(wall.distance(u)).max()
        warnings.warn(
            "the wall fills the part: its half-thickness is more than the distance from the "
            f"mid-surface, which is {top:.3g} at most; what is left is the volume as a whole",
            PrecisionWarning,
            stacklevel=3,
        )


def warn_coarse(h: float, least: float) -> None:
    """Warn of a mesh that is too coarse for the wall."""
    if h > 0.6 * least:
        warnings.warn(
            f"h={h:g} is coarse for a wall that is {least:g} thick at its thinnest: thinner "
            f"parts may be lost; use h <= {0.5 * least:g}",
            PrecisionWarning,
            stacklevel=4,
        )
