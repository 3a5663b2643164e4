"""From a field to a mesh: the box, the grid, what it will cost, the spacing that is fine enough.

Guarantees: the surface is closed, whatever the field. Faces of boxes that a solid is intersected
with are exact: planes of the grid lie on them, and their edges are sharp. A mesh that is meshed
again with the spacing it was made with changes little, however often. Grids that would need more
memory than allowed are refused before any work, with the numbers. Volumes of meshes are compared
with those of their solids (`ilattice.sdf._loss`).

Not guaranteed: other sharp edges (`ilattice.mesh.creases`), where they bend by less than 35 degrees
or end in wedges thinner than a cell, and in meshes of more than 5e6 vertices, which is warned of;
features thinner than a cell. The estimate of the cost is that of a coarse sampling.
"""

import warnings
from dataclasses import dataclass
from typing import Any

import numpy as np

from ilattice._field import Field
from ilattice._geometry import grid_points
from ilattice._memory import available, need
from ilattice._progress import Progress
from ilattice._typing import FloatArray, Solid
from ilattice._validate import Frozen, as_flag, as_positive, as_triple, check_lengths
from ilattice.errors import GeometryError, InputError, PrecisionWarning
from ilattice.fields.algebra import split_box
from ilattice.fields.node import Leaf, Node, as_node, is_empty
from ilattice.fields.solids import field_of
from ilattice.macroshape.maps import SplineMap
from ilattice.mesh import SurfaceMesh
from ilattice.mesh.contouring import contour_arrays
from ilattice.mesh.creases import sharpened
from ilattice.mesh.measure import volume_and_area
from ilattice.sdf._loss import check_loss
from ilattice.sdf._parting import SLIVER, parted
from ilattice.sdf._through import mesh_through
from ilattice.sdf.mesh_distance import MeshDistance

__all__ = ["Plan", "mesh", "plan"]

PARTS = 100  # spacings along the longest side, unless told otherwise
MEMORY = 8.0  # gigabytes
#: Planes of a grid per direction.
MAX_PLANES = 1_000_000
PER_TRIANGLE = 60  # bytes, with all that is in memory at once
#: Bytes per block of the grid.
PER_BLOCK = 100
#: Bytes per cell of the grid, more than meshing can take.
MAX_PER_CELL = 320
COARSE_GRID = 2.5  # spacings along the longest side below which a grid is called coarse
#: Bytes of the program without a mesh.
BASE = 3e8
LARGE = 5e6  # vertices above which edges stay chamfered
MARGIN = 0.25  # spacings between the solid and the outermost planes, at least
COARSE = 40  # samples per side of the estimate
FIRST = 24  # spacings along the longest side where a tolerance picks them
WITHIN = 90.0  # percent of the triangles that keep the tolerance: some edges stay chamfered


@dataclass(frozen=True, eq=False)
class Plan(Frozen):
    """A solid with the grid on which it is contoured; made by `plan`.

    Attributes
    ----------
    solid : Node
        The field.
    inner : Node
        The field without the box that clips it.
    box : ndarray, shape (2, 3)
        Box of the solid.
    axes : tuple of ndarray
        Planes of the grid.
    """

    solid: Node
    inner: Node
    box: FloatArray
    axes: tuple[FloatArray, FloatArray, FloatArray]

    @property
    def shape(self) -> tuple[int, int, int]:
        """Planes along the axes."""
        x, y, z = (len(a) for a in self.axes)
        return x, y, z

    @property
    def spacing(self) -> FloatArray:
        """Distances of the planes, shape (3,)."""
        return np.array([a[1] - a[0] for a in self.axes])

    def triangles(self) -> int:
        """About how many triangles the mesh has, from a coarse sampling.

        Returns
        -------
        int
            The estimate.
        """
        sparse = [np.linspace(a[0], a[-1], min(COARSE, len(a))) for a in self.axes]
        p = grid_points(*sparse)
        with np.errstate(all="ignore"):
            inside = self.inner(p).reshape([len(a) for a in sparse]) < 0.0
        inside = np.pad(inside, 1)
        area, h = 0.0, self.spacing
        coarse = np.array([a[1] - a[0] for a in sparse])
        for axis in range(3):
            crossed = np.count_nonzero(np.diff(inside, axis=axis))
            others = [k for k in range(3) if k != axis]
            area += crossed * float(np.prod(coarse[others] / h[others]))
        return int(2.0 * area)

    def memory(self) -> float:
        """About how many gigabytes meshing takes.

        Returns
        -------
        float
            The estimate.
        """
        blocks = 8 * np.prod([np.ceil(n / 8) for n in self.shape[1:]])
        return float(BASE + PER_TRIANGLE * self.triangles() + PER_BLOCK * blocks) / 1e9

    def most_memory(self) -> float:
        """More gigabytes than meshing can take, from the shape of the grid alone.

        Returns
        -------
        float
            The bound.
        """
        return float(BASE + MAX_PER_CELL * np.prod(np.array(self.shape, float))) / 1e9

    def mesh(self, *, allow_loss: bool = False, progress: Progress = None) -> SurfaceMesh:
        """Contour the solid.

        Parameters
        ----------
        allow_loss : bool
            Accept a mesh whose volume differs by more than 5 % from that of the solid.
        progress : bool or callable, optional
            See `ilattice._progress.track`.

        Returns
        -------
        SurfaceMesh
            Closed surface.

        Raises
        ------
        GeometryError
            Where there is no surface, the field is NaN, or the mesh is too coarse.

        Warns
        -----
        PrecisionWarning
            If there are more than 5e6 vertices, so that edges stay chamfered.
        """
        allow_loss = as_flag("allow_loss", allow_loss)
        found = self._contoured(progress)
        self._check(found, allow_loss)
        return found

    def _check(self, found: SurfaceMesh, allow_loss: bool) -> None:
        """Compare the volume of a mesh."""
        ends = np.array([(a[0], a[-1]) for a in self.axes]).T
        check_loss(
            self.inner, ends, ends[1] - ends[0], float(self.spacing.max()),
            volume_and_area(found.vertices, found.faces)[0], allowed=allow_loss,
        )  # fmt: skip

    def _contoured(self, progress: Progress) -> SurfaceMesh:
        """The mesh, whatever its volume."""
        axes = [a.copy() for a in self.axes]  # to kernels, read-only ones are of another type
        raw = contour_arrays(self.inner, axes, progress=progress)
        if not self.inner.program.kinked:
            return SurfaceMesh._adopt(raw.vertices, raw.faces)
        if len(raw.vertices) > LARGE:
            warnings.warn(
                f"edges stay chamfered by up to {self.spacing.max():.3g}: sharp ones would need "
                f"too much memory with {len(raw.vertices)} vertices; use a larger spacing",
                PrecisionWarning,
                stacklevel=4,
            )
            return SurfaceMesh._adopt(*parted(self.inner, raw, axes))
        sharp = sharpened(raw, self.inner, axes, _corners(self.inner))
        return SurfaceMesh._adopt(*parted(self.inner, sharp, axes, slivers=SLIVER))


def plan(solid: Field, spacing: Any = None, *, memory: float = MEMORY) -> Plan:
    """Box and grid of a solid.

    Parameters
    ----------
    solid : Field
        With a finite box.
    spacing : float or (3,) array, optional
        Largest distance of the planes of the grid; default a hundredth of the longest side.
    memory : float
        Gigabytes that may be used.

    Returns
    -------
    Plan
        What is needed to mesh it.

    Raises
    ------
    InputError
        If the box is infinite, if the spacing is not positive, or if the grid is too fine.
    GeometryError
        If the box is empty.
    """
    found = planned(solid, spacing)
    limit = as_positive("memory", memory)
    what = "a grid of " + " x ".join(map(str, found.shape)) + " planes"
    if found.most_memory() > limit and found.memory() > limit:
        raise InputError(
            f"{what} needs about {found.memory():.3g} GB; allowed are {limit:g} GB: take a larger "
            "spacing, or allow more memory"
        )
    if 1e9 * found.most_memory() > available():
        need(1e9 * found.memory(), what, "take a larger spacing")
    return found


def planned(solid: Field, spacing: Any = None) -> Plan:
    """Box and grid of a solid, however much memory meshing takes; see `plan`."""
    solid = as_node("solid", solid)
    box = _checked_box(solid)
    inner, walls = split_box(solid)
    sides = box[1] - box[0]
    h = sides.max() / PARTS if spacing is None else as_triple("spacing", spacing, positive=True)
    h = np.broadcast_to(h, (3,))
    counts = sides / h
    if counts.max() > MAX_PLANES:
        raise InputError(
            f"spacing {h.tolist()} makes {counts.max():.3g} planes of a box of {sides.tolist()}; "
            f"at most {MAX_PLANES} are allowed"
        )
    axes = [
        _planes(box[:, k], None if walls is None else walls[:, k], float(h[k])) for k in range(3)
    ]
    if counts.max() < COARSE_GRID:
        warnings.warn(
            f"spacing {h.max():g} is coarse for a solid of which the box is "
            f"{' x '.join(f'{s:.3g}' for s in sides)}: parts thinner than that are lost; use a "
            f"spacing of at most {sides.max() / 20:.2g}",
            PrecisionWarning,
            stacklevel=4,
        )
    return Plan(solid, inner, box, (axes[0], axes[1], axes[2]))


def _corners(solid: Node) -> FloatArray | None:
    """Vertices of the meshes that a solid is made of."""
    leaves = [leaf.f for leaf, _ in solid.program.leaves if isinstance(leaf, Leaf)]
    found = [f.mesh.vertices for f in leaves if isinstance(f, MeshDistance)]
    return np.concatenate(found).astype(np.float64) if found else None


def _checked_box(solid: Node) -> FloatArray:
    box = np.array(solid.bounds)
    if is_empty(box) or (box[0] == box[1]).any():
        where = f": its box is {box.tolist()}" if np.isfinite(box).all() else ""
        raise GeometryError(f"the solid is empty{where}")
    endless = ["xyz"[k] for k in range(3) if not np.isfinite(box[:, k]).all()]
    if endless:
        raise InputError(
            f"the solid has no end along {', '.join(endless)}: add a box, a sphere or a mesh"
        )
    far, size = float(np.abs(box).max()), float((box[1] - box[0]).max())
    check_lengths("the solid", size, far)
    return box


def _planes(ends: FloatArray, walls: FloatArray | None, h: float) -> FloatArray:
    """Planes of an axis: on walls exactly, otherwise multiples of the spacing around the solid.

    So meshes of a solid, and of a mesh that was made of it, share their planes.
    """
    low, high = ends
    first, last = (False, False) if walls is None else (low <= walls[0], high >= walls[1])
    count = int(np.ceil((high - low) / h - 1e-9)) + 1
    if first and last:
        return np.linspace(low, high, max(2, count))
    if first:
        return low + h * np.arange(count + 1)
    if last:
        return high - h * np.arange(count + 1)[::-1]
    return h * np.arange(np.floor(low / h - MARGIN), np.ceil(high / h + MARGIN) + 1.0)


def mesh(
    solid: Any,
    spacing: Any = None,
    *,
    tol: float | None = None,
    through: SplineMap | None = None,
    memory: float = MEMORY,
    allow_loss: bool = False,
    progress: Progress = None,
) -> SurfaceMesh:
    """Mesh of a solid.

    Parameters
    ----------
    solid : Field or Solid
        With a finite box, such as a word of the language or a `MeshDistance`; or a wall, or any
        other solid that brings its map, though `Wall.mesh` is more exact; with `through` any
        field of the parameters of that map, such as
        ``fields.intersection(wall.field, fields.pull_back(part, wall.through))``.
    spacing : float or (3,) array, optional
        Largest distance of the planes of the grid; default a hundredth of the longest side, or
        what the tolerance needs. With a map it must be given, as the length of edges in space.
    tol : float, optional
        Chord error: the spacing, a 24th of the longest side or the one given, is halved until the
        middles of 90 % of the triangles (all but those along edges) are that close to the surface,
        to first order, and the mesh has the same number of handles as the one before.
    through : SplineMap, optional
        Map from the parameters in which the solid is given to space, where the mesh will be, with
        edges of about `spacing`.
    memory : float
        Gigabytes that may be used.
    allow_loss : bool
        Accept a mesh whose volume differs by more than 5 % from that of the solid, either way, as
        where parts are thinner than the spacing. A `PrecisionWarning` names more than 2 %.
    progress : bool or callable, optional
        See `ilattice._progress.track`.

    Returns
    -------
    SurfaceMesh
        Closed surface.

    Raises
    ------
    InputError
        As `plan`; if a solid with a map of its own is given another one; if the tolerance needs a
        finer grid than the memory allows.
    GeometryError
        If there is no surface, or the mesh is too coarse for it.
    """
    allow_loss = as_flag("allow_loss", allow_loss)
    if isinstance(solid, Solid):
        if through is not None and solid.through is not None:
            raise InputError(f"through: the solid {solid.name!r} has a map already; leave it out")
        solid, through = field_of(solid), solid.through if through is None else through
    if through is not None:
        if tol is not None or spacing is None:
            raise InputError(
                "through, or a solid with a map of its own, needs a spacing, the length of edges "
                "in space, and no tol"
            )
        return mesh_through(solid, through, spacing, progress, allow_loss=allow_loss)
    if tol is None:
        return plan(solid, spacing, memory=memory).mesh(allow_loss=allow_loss, progress=progress)
    largest = np.inf if spacing is None else as_positive("spacing", spacing)
    return _converged(
        as_node("solid", solid), as_positive("tol", tol), largest, memory, allow_loss, progress
    )


def _converged(
    solid: Node, tol: float, largest: float, memory: float, allow_loss: bool, progress: Progress
) -> SurfaceMesh:
    box = _checked_box(solid)
    h = min(largest, float((box[1] - box[0]).max()) / FIRST)
    before: int | None = None
    last = np.inf
    while True:
        part = _allowed(solid, h, tol, memory)
        try:
            found = part._contoured(progress)
        except GeometryError:  # nothing seen yet
            if h < 1e-3 * float((box[1] - box[0]).max()):
                raise
            h *= 0.5
            continue
        handles, error = found.genus, _chord_error(part, found)
        if handles == before and error <= tol:
            part._check(found, allow_loss)
            return found
        if error > tol and last < np.inf:
            _allowed(solid, h * 0.5 ** _halvings(last, error, tol), tol, memory)
        before, last, h = handles, error, 0.5 * h


def _allowed(solid: Node, h: float, tol: float, memory: float) -> Plan:
    """The plan of a spacing, or the error that says why a tolerance cannot be kept."""
    try:
        return plan(solid, h, memory=memory)
    except InputError as e:
        raise InputError(f"tol={tol:g} needs a finer grid than is allowed: {e}") from e


def _halvings(last: float, error: float, tol: float) -> int:
    """How often the spacing must at least be halved until the tolerance is kept.

    Errors of smooth surfaces fall to a quarter; where they fall less, or more, the second of two is
    trusted between a half and an eighth, and one halving is given.
    """
    order = float(np.clip(np.log2(last / max(error, 1e-300)), 1.0, 3.0))
    return max(1, int((np.log2(error) - np.log2(tol)) / order))  # the quotient may be too large


def _chord_error(part: Plan, found: SurfaceMesh) -> float:
    """Distance of the middles of triangles from the surface, to first order; not that of walls."""
    x = np.asarray(found.vertices, np.float64)
    middle = x[found.faces].mean(axis=1)
    half = 0.5 * part.spacing
    inner = ((middle > part.box[0] + half) & (middle < part.box[1] - half)).all(axis=1)
    if not inner.any():
        return 0.0
    f, g = part.inner.jet(middle[inner], order=1)
    steep = np.maximum(np.linalg.norm(g, axis=1), 1e-300)
    return float(np.percentile(np.abs(f) / steep, WITHIN))
