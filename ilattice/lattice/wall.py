"""Walls: lattices with a thickness, and what can be done with them.

Guarantees and non-guarantees are those of the rooms below: `ilattice.offsets` for the solid,
`ilattice.mesh`, `ilattice.slicing`, `ilattice.topology` and `ilattice.quadrature` for what is made
of it. Here are only names, defaults and checks of arguments.
"""

from __future__ import annotations

from dataclasses import dataclass, fields
from os import PathLike
from typing import Any

import numpy as np

from ilattice._progress import Progress
from ilattice._typing import ArrayLike
from ilattice._validate import (
    as_flag,
    as_float_type,
    as_kind,
    as_not_negative,
    as_positive,
)
from ilattice.errors import InputError
from ilattice.io.stream import StreamedMeshWriter
from ilattice.mesh.regions import TopologyReport
from ilattice.mesh.surface import SurfaceMesh
from ilattice.mesh.thickness import ThicknessReport, thickness_report
from ilattice.mesh.wall_mesh import wall_mesh, wall_pieces, warn_full
from ilattice.offsets.first_order import ParametricOffset, parametric_solid
from ilattice.offsets.mid_surface import MidSurface
from ilattice.offsets.offsetting import offset_solid
from ilattice.offsets.solid import TileSolid
from ilattice.offsets.wall import OffsetSolid
from ilattice.plot.cards import card
from ilattice.slicing.slices import SliceStack, slice_wall
from ilattice.topology.features import Feature, check_features, minimum_gap, minimum_thickness
from ilattice.topology.sweep import wall_topology


@dataclass(frozen=True, eq=False)
class Wall(OffsetSolid):
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

    def __repr__(self) -> str:
        """One line: tiles, and the least and greatest thickness."""
        least, most = (f"{d:.6g}" for d in self.thickness.extremes)
        tiles = " x ".join(map(str, self.lattice.repeat))
        thick = least if least == most else f"{least} to {most}"
        return f"{type(self).__name__}({self.name!r}, {tiles} tiles, total thickness {thick})"

    def _repr_html_(self) -> str:
        least, most = self.thickness.extremes
        numbers = {**described(self.lattice), "total thickness from": least, "to": most,
                   "picture": "the mid-surface"}  # fmt: skip
        return card(self, numbers, of=self.lattice, n=12)

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
            Length of edges; by default a quarter of the least total thickness, or a twentieth of a
            tile, whichever is less, and where vertices are off then, volume is lost or bends are
            cut off, a fifth or a sixth of the thickness. Where it is more than two thirds of that,
            the mesh is made from the mid-surface, moved to both sides: edges may be much longer
            than the wall is thick, up to where it bends within one.
        polish : bool
            Move the vertices of the offset surfaces onto the exact offset by closest points.
            Parametric walls have none; theirs are moved onto the first-order one.
        caps : bool
            Close the wall on the faces of the domain; otherwise it is open there.
        dtype : float64 or float32
            Type of the vertices.
        allow_loss : bool
            Accept a mesh whose volume differs by more than 5 % from that of the wall, either way.
            A `PrecisionWarning` names differences of more than 1 %, of meshes with a given `h`
            shorter than 0.6 of the least thickness of more than 2 %.
            Where random points tell that volume well enough, it is not computed exactly.
        progress : bool or callable, optional
            See `ilattice._progress.track`.

        Returns
        -------
        SurfaceMesh
            Outward oriented, with point data: signed_distance (on caps that of the distance
            spline, as everywhere with ``polish=False``), half_thickness (on the side of the
            vertex), thickness (of both sides together; solids have none), parameters u, v, w,
            side (0 on caps), unconverged (1 where a vertex is off the offset, also to keep
            triangles from crossing), and the properties of the lattice.

        Raises
        ------
        InputError
            If `h` is not positive, or `dtype` is neither of the two.
        GeometryError
            If the wall is empty, the mesh is too coarse for it (the message says which `h` is not)
            or not closed, which `allow_loss` accepts with a warning.
        ConvergenceError
            If more than a thousandth of the vertices cannot be moved onto the offset: `h` is too
            long for what is between them. Two in a hundred may be next to creases, off either side
            by a quarter of the length of edges at most, and any number where the distance jumps at
            the end of the continuation; a `PrecisionWarning` tells of a thousandth and more.

        Warns
        -----
        PrecisionWarning
            Beside that, where neighbouring tiles of a solid do not meet and are not straight bars:
            what ends at faces between them is ragged there.
        """
        dtype = as_float_type("dtype", dtype)
        h = None if h is None else as_positive("h", h)
        caps, allow_loss = as_flag("caps", caps), as_flag("allow_loss", allow_loss)
        warn_full(self)
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
        h = None if h is None else as_positive("h", h)
        warn_full(self)
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
        return minimum_gap(self._in_space("minimum_gap"))

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
        made = self.mesh(polish=False) if mesh is None else as_kind("mesh", mesh, "SurfaceMesh")
        return thickness_report(self, made)

    def _polished(self, polish: bool) -> bool:
        """Whether vertices move onto the exact offset, if that is asked for."""
        return as_flag("polish", polish) and self._exact


@dataclass(frozen=True, eq=False, repr=False)
class ParametricWall(Wall, ParametricOffset):
    """Wall between first-order offsets: made by ``Lattice.offset(d, space="parametric")``.

    Attributes
    ----------
    distance : BSpline
        The implicit function I itself; it takes the place of the distance.
    thickness : Thickness
        d |grad I|, in units of I.
    asked : Thickness
        d, in tiles.
    """


@dataclass(frozen=True, eq=False)
class SolidWall(Wall, TileSolid):
    """The solid of the tiles: made by ``Lattice.offset((np.inf, 0))``.

    Attributes
    ----------
    distance : TileField
        The field of the tiles; it takes the place of the distance.
    """


_WALLS: dict[type[OffsetSolid], type[Wall]] = {
    OffsetSolid: Wall,
    ParametricOffset: ParametricWall,
    TileSolid: SolidWall,
}


def described(lattice: Any) -> dict[str, Any]:
    """What notebooks tell of a lattice."""
    size = np.ptp(lattice.through.bounds, axis=0)
    tiles = tuple(lattice.repeat)
    return {"tile": lattice.tile.name, "tiles": tiles, "size": tuple(map(float, size))}


def as_wall(solid: OffsetSolid) -> Any:
    """The same solid with all that can be done with it."""
    return _WALLS[type(solid)](*(getattr(solid, f.name) for f in fields(solid)))


def offset(
    lattice: MidSurface,
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
    Hong et al. 2025, eq. 4 and 5: ``I_+e`` and ``I_-e`` are S - d and S + d.

    Without `tol` S has 16 spans per tile. In the walls of their Figures 14 and 15, which come
    within a third of a span of the creases and focal curves of the distance, 1 % of the surface
    then is off by more than 3 to 7 % of d. With ``tol=0.01 * d`` it takes 32 spans for the gyroid
    in the torus, 40 in the duck and 64 where its thickness varies, and 6, 12 and 15 times as many
    closest points, for these are asked near the surfaces and creases only. That takes minutes in
    large parts, which is why there is no default.
    """
    as_kind("lattice", lattice, "Lattice")
    size = float(np.linalg.norm(np.diff(lattice.through.bounds, axis=0)))
    for name, least in (("least_wall", least_wall), ("least_gap", least_gap)):
        if least is not None and as_not_negative(name, least) > size:
            raise InputError(f"{name} must be at most the size {size:.4g} of the part, got {least}")
    solid = offset_solid(
        lattice, d, points=points, values=values, relative_density=relative_density, tol=tol,
        progress=progress,
    )  # fmt: skip
    if least_wall is not None or least_gap is not None:
        check_features(solid, least_wall, least_gap)
    wall: Wall = as_wall(solid)
    return wall


def parametric_offset(lattice: MidSurface, d: Any, *, progress: Progress = None) -> ParametricWall:
    """Wall between the first-order offsets of the mid-surface by `d`, in tiles.

    Parameters
    ----------
    lattice : Lattice
        Tiles and map.
    d : float, callable, BSpline, str, or pair of these
        Half-thickness as in `offset`, but as a fraction of a tile before the map.
    progress : bool or callable, optional
        See `ilattice._progress.track`.

    Returns
    -------
    ParametricWall
        The wall; `thickness_error` compares it with the true distance before the map.

    Raises
    ------
    InputError
        If `d` is not positive or larger than the part.

    Notes
    -----
    Hong et al. 2025, eq. 2 and 3.
    """
    as_kind("lattice", lattice, "Lattice")
    wall: ParametricWall = as_wall(parametric_solid(lattice, d, progress=progress))
    return wall
