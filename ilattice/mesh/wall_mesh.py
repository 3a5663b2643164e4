"""From a wall to triangles in space: contour in the parameter domain, polish, map.

Guarantees: those of `ilattice.mesh.contouring`; polished vertices lie on the exact offset of the
mid-surface, those on the faces of the domain stay there. Where polished, the contour is that of
the distance spline with exact values at its kinks (`ilattice.offsets.sharp`), so that pores close
when they should. The triangles of `wall_mesh` do not pass through each other
(`ilattice.mesh.uncrossing`), have no slivers (`ilattice.mesh.repair`) and no closed surfaces of
less than a fiftieth of a cell (`ilattice.mesh.specks`); those of `wall_pieces` may, for their
neighbours may be gone. Walls thinner than one and a half edges are meshed from
their mid-surface (`ilattice.mesh.sheets`), with slivers along their rims; meshes with long edges
are compared with the volume of the wall (`ilattice.mesh.loss`), those of solids of surfaces as they
are with the parts of their field (`ilattice.mesh.parts`). Vertices that are off the offset,
because polishing fails or to keep triangles from crossing, are marked as ``unconverged`` in the
point data and, where they are more than one in a thousand, counted in a `PrecisionWarning`; those
that are next to no jump or crease of the distance are then a `ConvergenceError`. Jumps are in
corners of the domain beyond which the map folds (`ilattice.offsets.closest`). All others are
on it to a ten-thousandth of the half-thickness. Non-guarantee: where two offset surfaces meet in a
crease, triangles do not follow the crease; ends of bars at faces between tiles are flat, but cut
at their rims.
"""

from __future__ import annotations

import warnings
from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from ilattice._geometry import CORNERS, cell_sizes, fixed_coordinates
from ilattice._memory import need
from ilattice._progress import Progress
from ilattice._typing import AnyArray, FloatArray
from ilattice.errors import ConvergenceError, GeometryError, InputError, PrecisionWarning
from ilattice.fields.algebra import intersection
from ilattice.macroshape.planes import MIN_CELLS_PER_TILE, grid_axes
from ilattice.mesh._own_cells import in_own_cells
from ilattice.mesh._projecting import (
    Classes,
    classified,
    measure,
    not_projected,
    projected,
)
from ilattice.mesh.contouring import ON_CAP, Contour, contour_arrays, contour_blocks
from ilattice.mesh.coverage import merged_part, missing
from ilattice.mesh.creases import sharpened
from ilattice.mesh.loss import ENOUGH, Extent, Loss, loss_of
from ilattice.mesh.parts import check_parts
from ilattice.mesh.sheets import Sheets
from ilattice.mesh.specks import without_specks
from ilattice.mesh.surface import SurfaceMesh
from ilattice.mesh.uncrossing import Uncrossed, uncrossed
from ilattice.offsets.law import warn_between
from ilattice.offsets.sharp import SharpDistance
from ilattice.offsets.wall_field import WallField

if TYPE_CHECKING:
    from ilattice.offsets.wall import OffsetSolid

#: Part of the vertices that may be held without a warning; part of them that may be off for no
#: jump or crease of the distance, and at creases, without an error; a number of them that always
#: may. Last, the part that may have nearer feet than they went by.
MAX_UNCONVERGED, MAX_OFF, MAX_CREASED, FEW, MAX_NEARER = 1e-3, 1e-3, 2e-2, 10, 1e-3
#: Random points, and the corners, at which a wall that fills the part is noticed.
FILLED = 4096
#: Bytes of memory per vertex of a mesh, and per site where the map is sampled.
PER_VERTEX, PER_SITE = 500, 150
#: Planes along the longest side, by size over edge, above which no grid is advised: that many are
#: refused, see `macroshape.planes`.
MAX_PLANES = 10_000_000
#: Length of edges, relative to the least thickness: by default, and where vertices are off then.
DEFAULTS = (0.25, 0.2, 0.16)
#: Least number of cells per tile and direction by default: pores of thick walls bend more than
#: their walls are thin.
PER_TILE = 20
#: Length of edges, relative to that by default, up to which they are as long.
AS_DEFAULT = 1.01
#: Longest edges, relative to the least thickness, with which contours show a wall; and the part of
#: its sides that may be within it where it is meshed from its mid-surface.
SEEN, MERGED = 1.0 / 1.5, 0.02
#: Vertices and triangles; kinds and sides of vertices; which of these may be off their side.
_Made = tuple[Uncrossed, AnyArray, FloatArray, AnyArray]


class TooCoarseError(ConvergenceError):
    """Vertices that are off for the length of edges; see `wall_mesh`."""


def wall_mesh(
    wall: OffsetSolid,
    h: float | None,
    *,
    polish: bool,
    caps: bool,
    dtype: Any,
    progress: Progress,
    cut: Any = None,
    allow_loss: bool = False,
) -> SurfaceMesh:
    """Mesh of a wall, less where a field `cut` is positive; see `ilattice.lattice.Wall.mesh`.

    Where edges of the default length are too long for vertices, volume or bends, shorter ones are
    tried, as long as they help and fit the memory; what is left is told.
    """
    job, before = _Job.of(wall, h, polish, progress, cut), None
    for part in (*DEFAULTS[1:], None):
        made, lost = None, None
        try:
            made = _meshed(job, caps, dtype)
            lost = made.lost
        except TooCoarseError as e:
            error = e
        again = made is None or (lost is not None and lost.shrinks(before))
        shorter = _shorter(job, part) if again and job.default and part is not None else None
        if shorter is None:
            break
        job, before = shorter, lost
    if made is None:
        raise error
    made.tell(job, caps, allow_loss=allow_loss)
    return made.mesh


def _shorter(job: _Job, part: float) -> _Job | None:
    """With edges of a part of the least thickness; None if that grid does not fit the memory."""
    try:
        out = _Job.of(job.wall, None, job.polish, job.options["progress"], job.cut, part)
        _check_size(out.axes)
    except InputError:
        return None
    return out


class _Meshed(NamedTuple):
    """A mesh of a wall.

    Attributes
    ----------
    mesh : SurfaceMesh
        The mesh.
    lost : Loss, optional
        What it has lost of the wall.
    nearer : tuple of float
        Part of its vertices that have nearer feet, that of which neighbours found them, and how
        many were looked at.
    crossing : int
        Pairs of triangles that cross.
    """

    mesh: SurfaceMesh
    lost: Loss | None
    nearer: tuple[float, float, int]
    crossing: int

    def tell(self, job: _Job, caps: bool, *, allow_loss: bool) -> None:
        """Warn of what it does not hold, or refuse it."""
        _check_again(*self.nearer)
        if caps:
            _check_closed(self.mesh, allowed=allow_loss)
        _warn_of_ends(job.wall.ragged)
        if self.lost is not None:
            self.lost.tell(allowed=allow_loss)
        if caps and job.cut is None and job.wall._countable:
            closed = job.wall.lattice.through.closed
            check_parts(job.wall.field, job.axes, closed, self.mesh, job.h)
        unconverged = self.mesh.point_data["unconverged"]
        _warn(int(np.count_nonzero(unconverged)), len(unconverged), self.crossing)


def _meshed(job: _Job, caps: bool, dtype: Any) -> _Meshed:
    """Mesh of a wall with edges of one length."""
    wall = job.wall
    _check_size(job.axes)
    sheets = _of_sheets(job, caps)
    new, kind, side, suspect = sheets or _of_contour(job, caps)
    kept = new.repair.vertices
    of = job.classify(new.u, kind, side, suspect)
    side = np.where(of.cap, 0.0, side)
    unconverged, nearer = of.unconverged[kept], (0.0, 0.0, 0)
    if job.polish:
        free = (side[kept] != 0) & ~unconverged
        wrong, part, mended = not_projected(wall, new.u[kept], side[kept], free)
        unconverged = unconverged | wrong
        nearer = (part, mended, int(free.sum()))
    _check(of.off[kept], of.crease[kept], job)
    faces = _outward(wall, new.repair.faces)
    exact = (side[kept] != 0) & ~unconverged & job.polish
    data = _point_data(wall, new.u[kept], side[kept], exact)
    data["unconverged"] = unconverged.astype(np.int8)
    mesh = SurfaceMesh._adopt(new.x[kept].astype(dtype, copy=False), faces, data)
    if mesh.vertices.dtype == np.float64:
        mesh.__dict__["self_intersections"] = new.left  # known, needs no other search
    lost = _lost(job, mesh, sheets is not None) if caps and job.cut is None else None
    return _Meshed(mesh, lost, nearer, new.left)


def _lost(job: _Job, mesh: SurfaceMesh, sheets: bool) -> Loss | None:
    """What a mesh has lost of its wall: volume, else bends."""
    wall, extent = job.wall, Extent.of(mesh.vertices, mesh.faces)
    loss = loss_of(wall, job.h, extent, sheets=sheets, exactly=job.polish, default=job.default)
    if loss is not None or not job.polish:
        return loss
    coarse = job.h > AS_DEFAULT * DEFAULTS[0] * wall.least_thickness
    return missing(wall, mesh, job.h, coarse=coarse)


def _of_contour(job: _Job, caps: bool) -> _Made:
    """A wall by contours of both its sides."""
    raw = contour_arrays(job.field, job.axes, caps=caps, **job.options)
    if job.wall.creased and job.cut is None:
        raw = sharpened(raw, job.field, job.axes)
    side = job.side(raw)
    u, lost = job.project(raw.vertices, raw.kind, side)
    new = uncrossed(
        job.wall.lattice, raw.vertices, u, raw.faces, raw.kind,
        lambda u, at: job.project(u, raw.kind[at], side[at]),
        lambda u, at: job.recall(u, raw.kind[at], side[at]),
    )  # fmt: skip
    if caps:
        new = new._replace(
            repair=without_specks(new.x, new.repair, lambda at: job.cell_volumes(new.u[at]))
        )
    return new, raw.kind, side, new.unconverged | lost


def _of_sheets(job: _Job, caps: bool) -> _Made | None:
    """A thin wall by its mid-surface, likewise; None for others, and where that fails."""
    if not job.thin:
        return None
    least = job.wall.least_thickness
    if job.h <= least and merged_part(job.wall) > MERGED:  # sheets would fail, slowly
        return None
    sheets = Sheets(
        job.wall, job.axes, exactly=job.polish, caps=caps, progress=job.options["progress"]
    )
    new, suspect = sheets.moved(
        job.wall, lambda u, at: job.project(u, sheets.kind[at], sheets.side[at])
    )
    off = int(job.classify(new.u, sheets.kind, sheets.side, suspect).off.sum())
    if new.left or off > max(MAX_OFF * len(suspect), FEW):
        if job.h <= least:
            return None
        raise GeometryError(
            f"h={job.h:g} is too long for a wall that is {least:g} thick at its thinnest: it is "
            f"meshed from its mid-surface, of which {off} of {len(suspect)} vertices cannot be "
            f"moved to its sides, and {new.left} pairs of triangles cross; {_remedy(job)}"
        )
    return new, sheets.kind, sheets.side, suspect


def _remedy(job: _Job) -> str:
    """What to do about a wall that is too thin."""
    enough = ENOUGH * job.wall.least_thickness
    size = float(np.ptp(job.wall.lattice.through.bounds, axis=0).max())
    if size > MAX_PLANES * enough:
        return "make the wall thicker: no grid is fine enough for it"
    return f"use h <= {enough:g}"


def wall_pieces(
    wall: OffsetSolid,
    h: float | None,
    *,
    polish: bool,
    progress: Progress,
    allow_loss: bool = False,
) -> Iterator[tuple[FloatArray, AnyArray]]:
    """Vertices and faces of a wall, slab by slab; faces count vertices through all slabs.

    Other than those of `wall_mesh`, they may contain slivers and cross each other. A wall thinner
    than the grid is one piece.
    """
    job = _Job.of(wall, h, polish, progress)
    if job.thin:
        mesh = wall_mesh(
            wall, h, polish=polish, caps=True, dtype=np.float64, progress=progress,
            allow_loss=allow_loss,
        )  # fmt: skip
        yield mesh.vertices, mesh.faces
        return
    _warn_of_ends(wall.ragged)
    off, crease = [np.zeros(0, np.bool_)], [np.zeros(0, np.bool_)]
    extent = Extent()
    for raw in contour_blocks(job.field, job.axes, **job.options):
        side = job.side(raw)
        u, lost = job.project(raw.vertices, raw.kind, side)
        of = job.classify(u, raw.kind, side, lost)
        _warn(int(of.unconverged.sum()), len(u), 0)
        off.append(of.off)
        crease.append(of.crease)
        vertices, faces = wall.lattice.through.x(u), _outward(wall, raw.faces)
        extent.add(vertices, faces)
        yield vertices, faces
    _check(np.concatenate(off), np.concatenate(crease), job)
    loss = loss_of(wall, job.h, extent, sheets=False, exactly=job.polish, default=job.default)
    if loss is not None:
        loss.tell(allowed=allow_loss)


def wall_contour(wall: OffsetSolid, h: float | None, *, progress: Progress) -> SurfaceMesh:
    """Contour of a wall for counting: exact distances at kinks, vertices as contouring leaves them.

    Other than the mesh of `wall_mesh`, it has no point data, and may contain slivers.
    """
    job = _Job.of(wall, h, wall._exact, progress)
    _check_size(job.axes)
    sheets = _of_sheets(job, True)
    if sheets is not None:
        new = sheets[0]
        return SurfaceMesh._adopt(new.x, _outward(wall, new.repair.faces), {})
    raw = contour_arrays(job.field, job.axes, **job.options)
    return SurfaceMesh._adopt(wall.lattice.through.x(raw.vertices), _outward(wall, raw.faces), {})


def _check_size(axes: tuple[FloatArray, ...]) -> None:
    """Refuse meshes that do not fit: of a surface that crosses the grid about once each way."""
    x, y, z = (float(len(a)) for a in axes)
    need(
        PER_VERTEX * (x * y + y * z + z * x) / 3.0,
        f"the mesh on a grid of {x:.3g} x {y:.3g} x {z:.3g} planes",
        "use a larger h or fewer tiles",
    )


def _outward(wall: OffsetSolid, faces: AnyArray) -> AnyArray:
    """Triangles counter-clockwise seen from outside, also behind a left-handed map."""
    return np.ascontiguousarray(faces[:, ::-1]) if wall.lattice.through.orientation < 0 else faces


@dataclass(frozen=True)
class _Job:
    """What contouring and polishing a wall need."""

    wall: OffsetSolid
    h: float
    field: Any
    axes: tuple[FloatArray, ...]
    options: dict[str, Any]
    polish: bool
    cut: Any = None
    default: bool = False

    @classmethod
    def of(
        cls, wall: OffsetSolid, h: float | None, polish: bool, progress: Progress,
        cut: Any = None, part: float = DEFAULTS[0],
    ) -> _Job:  # fmt: skip
        """What a wall needs for edges of some length, by default as fine as it is thin."""
        least, cells = wall.least_thickness, MIN_CELLS_PER_TILE  # and refuse what is empty
        default = h is None
        if h is None:
            h, cells = part * least, round(PER_TILE * DEFAULTS[0] / part)
        options: dict[str, Any] = {"wrap": wall.lattice.through.closed, "progress": progress}
        t = wall.thickness
        distance: Any = SharpDistance(wall.lattice, wall.distance, t) if polish else wall.drawn
        field: Any = WallField(distance, t)
        if cut is not None:
            field = intersection(field, cut)
        elif t.constant:
            field = distance
            inner, outer = (float(s.c.item()) for s in (t.inner, t.outer))
            options["level"] = outer if t.solid else (-inner, outer)
        elif t.solid and t.outer.c.min() > 0.0:
            field = distance
            options |= {"level": 1.0, "scale": t.outer}
        elif t.symmetric:
            field = distance
            options |= {"level": (-1.0, 1.0), "scale": t.outer}
        axes = grid_axes(wall.lattice, h, cells)
        warn_between(wall, axes, h)
        return cls(wall, h, field, axes, options, polish, cut, default)

    @property
    def thin(self) -> bool:
        """Whether the wall is thinner than the grid sees."""
        plain = self.cut is None and not self.wall.thickness.solid
        return plain and self.h > SEEN * self.wall.least_thickness

    def cell_volumes(self, u: FloatArray) -> FloatArray:
        """Volumes in space of the cells that points are in."""
        det = np.linalg.det(self.wall.lattice.through.jacobian(u))
        out: FloatArray = np.abs(det) * cell_sizes(self.axes, u).prod(axis=1)
        return out

    def side(self, raw: Contour) -> FloatArray:
        """Which offset surface the vertices of a contour belong to, 0 for none."""
        off = raw.kind & ON_CAP != 0
        if self.cut is not None:
            off |= self.wall.field(raw.vertices) < self.cut(raw.vertices)
        return np.where(off, 0.0, self.wall.field.side(raw.vertices))

    def project(
        self, u: FloatArray, kind: AnyArray, side: FloatArray
    ) -> tuple[FloatArray, AnyArray]:
        """Vertices moved onto the offset, and which could not be; see `projected`."""
        return projected(self.wall, self.axes, u, kind, side, exactly=self.polish)

    def recall(
        self, u: FloatArray, kind: AnyArray, side: FloatArray
    ) -> tuple[FloatArray, AnyArray]:
        """Points of the exact offset in the cells of vertices, and which vertices have none."""
        out, lost = u.copy(), side != 0
        at = np.flatnonzero(lost & self.polish)
        if len(at):
            fixed = fixed_coordinates(kind[at])
            within = measure(self.wall, u[at], side[at])
            out[at], found = in_own_cells(self.wall, self.axes, u[at], fixed, side[at], within)
            lost[at[found]] = False
        return out, lost

    def classify(
        self, u: FloatArray, kind: AnyArray, side: FloatArray, suspect: AnyArray
    ) -> Classes:
        """What suspect vertices are; see `classified`."""
        if not self.polish:
            none = np.zeros(len(u), np.bool_)
            return Classes(suspect & (side != 0), none, none, none)
        return classified(self.wall, self.axes, u, kind, side, suspect)


def _check(off: AnyArray, crease: AnyArray, job: _Job) -> None:
    """Refuse a mesh of which too many vertices are off the offset, or off its creases."""
    count = len(off)
    unconverged, cut = int(off.sum()), int(crease.sum())
    clip = "boundary='clip' where the map bends back beyond its ends, "
    remedy = (
        f"use h <= {0.5 * job.h:.3g}, {clip * (job.wall.lattice.boundary == 'extend')}"
        "more spans_per_tile where the distance spline has a wall and "
        "exact distances have none, or polish=False for a mesh of the spline"
    )
    if job.polish and unconverged > max(MAX_OFF * count, FEW):
        raise TooCoarseError(
            f"{unconverged} of {count} vertices are off the offset with h={job.h:g} (more than "
            f"{MAX_OFF:.1%}): there is none in their cells, as in slits thinner than a part of a "
            f"cell, or triangles would cross; {remedy}"
        )
    if job.polish and cut > max(MAX_CREASED * count, FEW):
        raise ConvergenceError(
            f"{cut} of {count} vertices cut creases of the offset with h={job.h:g} (more than "
            f"{MAX_CREASED:.0%}); {remedy}"
        )


def _check_closed(mesh: SurfaceMesh, *, allowed: bool) -> None:
    """Refuse what is not closed, as of a field with two values where a closed direction begins."""
    single, many = mesh.open_edges, mesh.nonmanifold_edges
    if not (single or many):
        return
    message = (
        f"the mesh is not closed: {single} edges have one triangle, and {many} more than two; does "
        "the field jump, or differ at both ends of a closed direction? Another h may help"
    )
    if not allowed:
        raise GeometryError(message)
    warnings.warn(message, PrecisionWarning, stacklevel=5)


def _warn_of_ends(ragged: AnyArray) -> None:
    """Tell of faces between tiles at which the field jumps, where there are any."""
    if ragged.any():
        axes = ", ".join("uvw"[a] for a in np.flatnonzero(ragged))
        warnings.warn(
            f"neighbouring tiles do not meet along {axes}: what ends at faces between them is "
            "ragged there, by up to about 2.5 edges; make opposite faces of the tile fit, or use "
            "fewer bars, which are meshed as they are if they are straight",
            PrecisionWarning,
            stacklevel=5,
        )


def _check_again(part: float, mended: float, count: int) -> None:
    """Tell of vertices that have nearer feet than those they went by, and refuse too many."""
    where = (
        "as where the map folds beyond its ends or squeezes tiles; use boundary='clip', more and "
        "smaller tiles"
    )
    if part * count > max(MAX_NEARER * count, FEW):
        raise ConvergenceError(
            f"{part:.2%} of the vertices are off the offset (more than {MAX_NEARER:.1%}): parts "
            f"of the mid-surface are nearer than their closest points, {where}, or polish=False "
            "for a mesh of the distance spline"
        )
    if max(part, mended) > MAX_UNCONVERGED:
        warnings.warn(
            f"of {count} vertices about {round(part * count)} are off the offset, for parts of "
            "the mid-surface are nearer than their closest points, and of about "
            f"{round(mended * count)} only neighbours have found the closest points, {where}",
            PrecisionWarning,
            stacklevel=5,
        )


def _warn(unconverged: int, count: int, left: int) -> None:
    """Warn of what a mesh could not hold."""
    if unconverged > max(MAX_UNCONVERGED * count, FEW):
        warnings.warn(
            f"{unconverged} of {count} vertices could not be moved onto the offset, or would make "
            "triangles cross there, and are off it; use a smaller h",
            PrecisionWarning,
            stacklevel=5,
        )
    if left:
        warnings.warn(
            f"{left} pairs of triangles pass through each other; use a smaller h",
            PrecisionWarning,
            stacklevel=5,
        )


def _point_data(
    wall: OffsetSolid, u: FloatArray, side: FloatArray, exact: AnyArray
) -> dict[str, AnyArray]:
    """What is known at vertices; those that are `exact` are on their side, not on the spline's."""
    asked = wall._asked.at(u, np.where(side < 0, -1.0, 1.0))
    data: dict[str, AnyArray] = {
        "signed_distance": np.where(exact, side * asked, wall._drawn_distance(u)),
        "half_thickness": asked,
        "u": u[:, 0].copy(),
        "v": u[:, 1].copy(),
        "w": u[:, 2].copy(),
        "side": side.astype(np.int8),
    }
    if not wall.thickness.solid:
        one = np.ones(len(u))
        data["thickness"] = wall._asked.at(u, -one) + wall._asked.at(u, one)
    lattice = wall.lattice
    return data | {name: lattice.property_at(name, u) for name in lattice.property_names}


def parameters_of(mesh: SurfaceMesh) -> tuple[FloatArray, AnyArray]:
    """Parameters (V, 3) and side (V,) of the vertices of a wall's mesh."""
    data = mesh.point_data
    u = np.stack([data[name] for name in ("u", "v", "w")], axis=1).astype(np.float64)
    return u, data["side"]


def warn_full(wall: OffsetSolid) -> None:
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
