"""Slices of a part, from a wall without a mesh, or from a mesh: closed contours at given heights.

Guarantees: contours close, are nested, and do not depend on the number of threads; outer ones run
counter-clockwise seen from the tip of the normal, holes clockwise; a stack computes one slice at
a time and keeps none, so memory does not grow with their number. Layers of a given thickness end
at the top of the part: the last one is as thick as what is left, and cut at the middle of it. At
the ends of a part the slice is what it ends with, such as a face; beyond them there is none. Where
contours bend they get points between those of the grid, so that chords cut off little: of a Schwarz
P wall 0.02 % of the area at the default `h`, of struts that are two cells wide less than 0.1 %.
Polished contours hold the area of the exact offset, to 1e-4 away from creases; unpolished ones that
of the distance spline, which at the default resolution is off by up to 0.5 % in thick walls: see
`tol` of `Lattice.offset`.
Contours do not cross or touch each other or themselves. Where gaps or webs are finer than the grid,
it is halved, up to three times; what may be finer still is counted as `Slice.unresolved_area` and,
where it is much, warned of.
Not guaranteed: next to creases, where two offset surfaces meet, a contour may be rounded over part
of a cell, which fills up to 0.07 % more of walls whose pores almost close, at the default `h`;
contours may cross where a cell of the grid is folded by the map.
"""

import os
import warnings
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from typing import TYPE_CHECKING, Any, ClassVar, Protocol, overload

import numpy as np

from ilattice._memory import need
from ilattice._progress import Progress, track
from ilattice._typing import ArrayLike, FloatArray
from ilattice._validate import (
    Frozen,
    as_array,
    as_index,
    as_positive,
    as_triple,
    as_whole,
    read_only,
)
from ilattice.errors import GeometryError, InputError, PrecisionWarning
from ilattice.fields.node import Node
from ilattice.io.registry import save
from ilattice.io.svg import slice_document
from ilattice.macroshape.planes import grid_axes
from ilattice.offsets.law import warn_between
from ilattice.offsets.wall import OffsetSolid, warn_coarse
from ilattice.plot.quick import show
from ilattice.plot.shapes import polylines
from ilattice.slicing import _kernels_slices as kernels
from ilattice.slicing._in_plane import InPlane
from ilattice.slicing._loops import Outline
from ilattice.slicing._mesh_slicer import ClosedMesh, MeshSlicer
from ilattice.slicing._slicer import BLOCK, Slicer, as_frame, extent

if TYPE_CHECKING:
    from matplotlib.figure import Figure


#: A polygon as arrays: its outer contour (n, 2), and its holes.
Polygon = tuple[FloatArray, tuple[FloatArray, ...]]
#: Layers above which a thickness is taken for a mistake.
MAX_LAYERS = 50_000
#: Bytes per cell of a cross-section, and per block of cells, while slicing.
PER_CELL, PER_BLOCK = 20, 40
#: Part of a layer below which what is left of the height goes to the last layer: it is rounding.
MIN_LAYER = 1e-3
#: How far beyond the part a height may be, relative to its extent, before it is outside.
ROUNDING = 1e-6
#: How far inside of it the slices at the ends of a part are cut, likewise.
END = 2e-6
#: Part of the area of a slice in which contours may be missed before a warning.
MAX_UNRESOLVED = 0.005


@dataclass(frozen=True, eq=False, repr=False)
class Slice(Frozen):
    """Cross-section of a wall.

    Attributes
    ----------
    height : float
        Where the plane cuts, along the normal.
    top, bottom : float
        Heights between which the slice stands for the wall.
    polygons : tuple of (ndarray, tuple of ndarray)
        Outer contour (n, 2) and holes of each part; the first point is not repeated.
        ``shapely.Polygon(outer, holes)`` takes them as they are.
    frame : ndarray, shape (3, 3)
        Rows: the two directions of the plane in space, and its normal.
    unresolved_area : float
        Area of the places where a gap or a web may be finer than an eighth of the grid.
    """

    height: float
    top: float
    bottom: float
    polygons: tuple[Polygon, ...]
    frame: FloatArray
    unresolved_area: float = 0.0

    def __repr__(self) -> str:
        return f"Slice(height={self.height:g}, {len(self.polygons)} polygons, area={self.area:g})"

    @property
    def loops(self) -> list[FloatArray]:
        """All contours, outer ones before their holes."""
        return [loop for outer, holes in self.polygons for loop in (outer, *holes)]

    @property
    def holes(self) -> int:
        """Number of holes."""
        return sum(len(holes) for _, holes in self.polygons)

    @cached_property
    def area(self) -> float:
        """Area of the material."""
        return float(sum(_area(loop) for loop in self.loops))

    @cached_property
    def perimeter(self) -> float:
        """Length of all contours."""
        steps = (np.roll(loop, -1, axis=0) - loop for loop in self.loops)
        return float(sum(np.hypot(*s.T).sum() for s in steps))

    @property
    def bounds(self) -> FloatArray:
        """Bounding box, shape (2, 2), rows are the lower and the upper corner; NaN if empty."""
        if not self.polygons:
            return np.full((2, 2), np.nan)
        points = np.concatenate([outer for outer, _ in self.polygons])
        return np.stack([points.min(axis=0), points.max(axis=0)])

    def to_space(self, points: ArrayLike) -> FloatArray:
        """Points of the plane as points of space.

        Parameters
        ----------
        points : array_like, shape (n, 2)
            In the plane.

        Returns
        -------
        ndarray, shape (n, 3)
            In space.
        """
        p = as_array("points", points, ndim=2)
        if p.shape[1] != 2:
            raise InputError(f"points must have shape (n, 2), got {p.shape}")
        out: FloatArray = p @ self.frame[:2] + self.height * self.frame[2]
        return out

    def to_pyvista(self) -> Any:
        """The contours in space, for pictures and films.

        Returns
        -------
        pyvista.PolyData
            A closed line for each loop, with its ``height``.

        Raises
        ------
        GeometryError
            If there is none.
        """
        return _contours([self])

    def plot(self) -> "Figure":
        """The slice as a picture of matplotlib.

        Returns
        -------
        matplotlib.figure.Figure
            The material, filled, in the coordinates of the plane.
        """
        from matplotlib.figure import Figure
        from matplotlib.patches import PathPatch
        from matplotlib.path import Path

        figure = Figure(figsize=(6.0, 6.0), layout="constrained")
        axes = figure.subplots()
        for outer, holes in self.polygons:
            path = Path.make_compound_path(*(Path(loop, closed=False) for loop in (outer, *holes)))
            axes.add_patch(PathPatch(path, facecolor="#d9b382", edgecolor="black", linewidth=0.5))
        axes.autoscale_view()
        axes.set_aspect("equal")
        axes.set_title(f"height {self.height:g}")
        return figure

    def to_svg(self) -> str:
        """The slice as a picture: an SVG document with one filled path.

        Returns
        -------
        str
            The document.
        """
        return slice_document(self)


class Cutter(Protocol):
    """What cuts a part: `Slicer` for walls, `MeshSlicer`, or that of fields in `ilattice.mesh`."""

    @property
    def net(self) -> FloatArray:
        """Points (n, 3) about the part."""

    def outline(self, height: float) -> Outline:
        """Contours at a height."""

    def approximation(self) -> Any:
        """A mesh of the whole, for programs that do not know of slices."""


@dataclass(frozen=True, eq=False, repr=False)
class SliceStack(Frozen):
    """Slices of a part, each computed when asked for; made by `Wall.slices`, `SurfaceMesh.slices`.

    Those of any field are made by `ilattice.mesh.slice_field`.

    Attributes
    ----------
    part : Wall, SurfaceMesh or Node
        What is cut.
    heights, tops : ndarray, shape (n,)
        Where the planes cut, and up to where each slice stands for the wall.
    bottom : float
        From where the lowest one stands for it.
    frame : ndarray, shape (3, 3)
        Rows: the two directions in the planes, and their normal.
    slicer : Cutter
        What cuts.
    cuts : ndarray, shape (n,)
        At which heights it does: at an end of the part a little inside, by 2e-6 of its height, so
        that the slice there is what the part ends with.
    """

    file_kind: ClassVar[str] = "slices"
    part: OffsetSolid | ClosedMesh | Node
    heights: FloatArray
    tops: FloatArray
    bottom: float
    frame: FloatArray
    slicer: Cutter
    cuts: FloatArray

    def __repr__(self) -> str:
        return f"SliceStack({len(self)} slices from {self.bottom:g} to {self.tops[-1]:g})"

    def __len__(self) -> int:
        return len(self.heights)

    @overload
    def __getitem__(self, index: int) -> Slice: ...
    @overload
    def __getitem__(self, index: slice) -> list[Slice]: ...
    def __getitem__(self, index: int | slice) -> Slice | list[Slice]:
        """One slice, or a list of them."""
        if isinstance(index, slice):
            return [self[i] for i in range(*index.indices(len(self)))]
        i = range(len(self))[as_index("index", index)]
        height = float(self.heights[i])
        below = self.bottom if i == 0 else float(self.tops[i - 1])
        outline = self.slicer.outline(float(self.cuts[i]))
        out = Slice(
            height, float(self.tops[i]), below, nested(outline), self.frame, outline.unresolved_area
        )
        if out.unresolved_area > MAX_UNRESOLVED * out.area:
            warnings.warn(
                "gaps or webs in slices are so fine that contours may be missed, see "
                "Slice.unresolved_area; use a smaller h",
                PrecisionWarning,
                stacklevel=2,
            )
        return out

    def __iter__(self) -> Iterator[Slice]:
        """Slices from the lowest to the highest."""
        return (self[i] for i in range(len(self)))

    @property
    def bounds(self) -> FloatArray:
        """Box around all slices in the directions of `frame`, shape (2, 3), rows are corners."""
        net = self.slicer.net @ self.frame.T
        out = np.stack([net.min(axis=0), net.max(axis=0)])
        out[:, 2] = self.bottom, self.tops[-1]
        return out

    def volume(self, *, progress: Progress = None) -> float:
        """Volume of the layers: sum of area times thickness.

        Parameters
        ----------
        progress : bool or callable, optional
            See `ilattice._progress.track`.

        Returns
        -------
        float
            Volume; for a stack of given thickness the midpoint rule, of second order: the last
            layer counts with what is left of the height.
        """
        layers = track(self, "slices", progress, total=len(self))
        return float(sum(s.area * (s.top - s.bottom) for s in layers))

    def to_pyvista(self) -> Any:
        """The contours of all layers in space, for pictures and films.

        Returns
        -------
        pyvista.PolyData
            A closed line for each loop, with its ``height``.

        Raises
        ------
        GeometryError
            If there is none.
        """
        return _contours(list(self))

    def plot(self, *, every: int = 1, **options: Any) -> Any:
        """Show the contours of the layers in space, in a window or a notebook.

        Parameters
        ----------
        every : int
            Show one of so many layers.
        **options
            Of `ilattice.plot.show`, such as ``clip``, ``view`` or ``screenshot``.

        Returns
        -------
        object
            What pyvista returns.
        """
        step = as_whole("every", every, 1, max(len(self), 1))
        shown = _contours([self[i] for i in range(0, len(self), step)])
        return show(shown, **{"scalars": "height", "line_width": 2, "occlusion": False, **options})

    def save(self, path: str | os.PathLike[str], **options: Any) -> None:
        """Write the stack slice by slice: CLI, SVG or 3MF, as the ending names.

        Parameters
        ----------
        path : path-like
            File to write; an old one is replaced as a whole or left alone.
        **options
            See the writer of the format in `ilattice.io`.

        Raises
        ------
        FormatError
            Unknown ending, or the file cannot be written.
        """
        save(self, path, **options)


def slice_wall(
    wall: OffsetSolid,
    z: ArrayLike | None = None,
    *,
    thickness: float | None = None,
    h: float | None = None,
    normal: ArrayLike = (0.0, 0.0, 1.0),
    polish: bool = True,
) -> SliceStack:
    """Slices of a wall; see `ilattice.lattice.Wall.slices`."""
    least = wall.least_thickness
    h = 0.25 * least if h is None else as_positive("h", h)
    warn_coarse(h, least)
    frame = as_frame(as_triple("normal", normal))
    axes = grid_axes(wall.lattice, h)
    warn_between(wall, axes, h)
    a, b, c = (float(len(planes)) for planes in axes)
    need(
        PER_CELL * max(a * b, b * c, c * a) + PER_BLOCK * a * b * c / BLOCK**3,
        f"slicing on a grid of {a:.3g} x {b:.3g} x {c:.3g} planes",
        "use a larger h or fewer tiles",
    )
    slicer = Slicer(InPlane(wall, axes, frame, h, polish))
    return stacked(wall, z, thickness, extent(slicer.height), frame, slicer)


def slice_mesh(
    mesh: ClosedMesh,
    z: ArrayLike | None = None,
    *,
    thickness: float | None = None,
    normal: ArrayLike = (0.0, 0.0, 1.0),
) -> SliceStack:
    """Slices of a closed mesh; see `ilattice.mesh.SurfaceMesh.slices`."""
    frame = as_frame(as_triple("normal", normal))
    slicer = MeshSlicer(mesh, frame)
    return stacked(mesh, z, thickness, slicer.ends, frame, slicer)


def stacked(
    part: Any, z: ArrayLike | None, thickness: float | None, ends: tuple[float, float],
    frame: FloatArray, slicer: Cutter,
) -> SliceStack:  # fmt: skip
    """A stack of slices of a part between two heights, at given ones or in layers."""
    heights, tops, bottom = _layers(z, thickness, ends)
    (low, high), slack = ends, ROUNDING * (ends[1] - ends[0])
    inside = low + END * (high - low), high - END * (high - low)
    cuts = np.where(np.abs(heights - low) <= slack, inside[0], heights)
    cuts = np.where(np.abs(heights - high) <= slack, inside[1], cuts)
    arrays = read_only(heights), read_only(tops), bottom, read_only(frame)
    return SliceStack(part, *arrays, slicer, read_only(cuts))


def _layers(
    z: ArrayLike | None, thickness: float | None, ends: tuple[float, float]
) -> tuple[FloatArray, FloatArray, float]:
    """Heights of the cuts, upper ends of the layers, lower end of the first."""
    low, high = ends
    if (z is None) == (thickness is None):
        raise InputError("give either z, the heights, or thickness, that of the layers")
    if thickness is not None:
        t = as_positive("thickness", thickness)
        layers = float(np.ceil((high - low) / max(t, 1e-300) - MIN_LAYER))
        count = int(np.clip(layers, 1, MAX_LAYERS + 1))
        if count > MAX_LAYERS:
            raise InputError(
                f"thickness={t:g} makes {layers:.3g} layers of a part from {low:g} to {high:g}; "
                f"at most {MAX_LAYERS} are allowed: use a thickness of at least "
                f"{(high - low) / MAX_LAYERS:.2g}"
            )
        ends_of_layers = np.append(low + t * np.arange(count), high)
        return 0.5 * (ends_of_layers[:-1] + ends_of_layers[1:]), ends_of_layers[1:], low
    heights = np.array(np.atleast_1d(as_array("z", z)))
    if heights.ndim != 1 or not len(heights) or (np.diff(heights) <= 0).any():
        raise InputError("z must be one height or increasing ones; sort them and drop equal ones")
    slack = ROUNDING * (high - low)
    if not ((heights >= low - slack) & (heights <= high + slack)).any():
        raise InputError(
            f"z must have heights within the part, from {low:g} to {high:g} along the normal, "
            f"got {heights[0]:g} to {heights[-1]:g}"
        )
    first = heights[1] - heights[0] if len(heights) > 1 else heights[0] - low
    return heights, heights.copy(), float(heights[0] - max(first, 0.0))


def nested(outline: Outline) -> tuple[Polygon, ...]:
    """Polygons of the loops of an outline: each hole in the smallest outer contour around it.

    Parameters
    ----------
    outline : Outline
        Loops with the material on their left.

    Returns
    -------
    tuple of (ndarray, tuple of ndarray)
        Outer contours, by first appearance, with their holes. A hole without an outer contour
        is dropped: it is smaller than the grid.
    """
    points, start, area, _ = outline
    loops = [points[a:b] for a, b in pairwise(start)]
    box = np.array([[*p.min(axis=0), *p.max(axis=0)] for p in loops]).reshape(-1, 4)
    owner = np.empty(len(area), np.int64)
    kernels.owners(points, start, area, box, owner)
    holes: dict[int, list[FloatArray]] = {int(i): [] for i in np.flatnonzero(area > 0.0)}
    for i in np.flatnonzero(owner >= 0):
        holes[int(owner[i])].append(read_only(loops[i].copy()))
    return tuple((read_only(loops[i].copy()), tuple(inner)) for i, inner in holes.items())


def _area(loop: FloatArray) -> float:
    out = np.empty(1)
    kernels.areas(loop, np.array([0, len(loop)]), out)
    return float(out[0])


def _contours(layers: list[Slice]) -> Any:
    """The loops of layers as closed lines in space."""
    lines = [layer.to_space(loop) for layer in layers for loop in layer.loops]
    if not lines:
        raise GeometryError("the slices are empty: nothing to show")
    shown = polylines(lines, closed=True)
    shown.cell_data["height"] = np.array([layer.height for layer in layers for _ in layer.loops])
    return shown
