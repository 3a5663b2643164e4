"""From a periodic surface to a tile: the signed distance of the smooth surface as a spline.

Triangles are replaced by curved ones through the vertices with the normals there, so that errors
are of fourth instead of second order in their size. Dense samples of these with normals and
curvatures give the signed distance near the surface, which is fitted by a periodic cubic spline;
away from the surface the field levels off, as distances have kinks there.

Guarantees: how far the zero set of the spline is off the curved triangles is measured between the
nodes of the fit, and told where it is more than `TOLERANCE`. Non-guarantee: errors of the vertices
themselves are not seen here, but see `MinimalPatch.sharpened`.
"""

import warnings
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
from scipy.spatial import cKDTree

from ilattice._typing import ArrayLike, FloatArray, IntArray
from ilattice._validate import as_points, as_whole
from ilattice.bspline import BSpline
from ilattice.bspline.fit import fit
from ilattice.errors import GeometryError, InputError, PrecisionWarning
from ilattice.mesh import SurfaceMesh
from ilattice.minimal.disc import area_vectors, gathered, opposite_edges, unit_rows
from ilattice.tiles import Tile

#: Largest distance of the zero set from the surface, in parts of the cell, without a warning.
TOLERANCE = 1e-4
#: Errors of vertices, in parts of the cell, up to which half of them, or less, is left of them.
COARSE = 5e-4
#: Distances up to this part of the least radius of curvature are kept as they are.
REACH = 0.5
#: Distances beyond this part of the shortest edge of the cell are not kept, however flat the
#: surface.
MAX_REACH = 0.12
#: Spans of the spline along an edge of the cell: the fewest by default, and the most.
MIN_SPANS, MAX_SPANS = 8, 128
#: Points at which the surface is sampled, about, and every how many of them errors are looked at:
#: chosen without measurements.
_SAMPLES, _EVERY = 150_000, 16


class Periodic(Protocol):
    """An oriented surface that repeats with a cell: a `PeriodicSurface`."""

    @property
    def mesh(self) -> SurfaceMesh:
        """The surface in one cell."""

    @property
    def labels(self) -> IntArray:
        """Numbers of the vertices up to shifts by whole cells, shape (V,)."""

    @property
    def cell(self) -> FloatArray:
        """Edges of the cell, shape (3,)."""

    @property
    def objection(self) -> str:
        """Why the surface does not separate the cell; empty if it does."""


@dataclass(frozen=True, eq=False)
class Samples:
    """Dense points of a smooth surface in the unit cell.

    Attributes
    ----------
    points, normals : (n, 3) arrays
        Points with their unit normals.
    shapes : (n, 3, 3) array
        Second fundamental forms: how normals change.
    """

    points: FloatArray
    normals: FloatArray
    shapes: FloatArray


@dataclass(frozen=True, eq=False)
class SignedDistance:
    """Signed distance to a sampled periodic surface, levelled off beyond a reach.

    Attributes
    ----------
    samples : Samples
        The surface.
    cell : (3,) array
        Edges of the cell.
    reach : float
        Where the field becomes constant.
    """

    samples: Samples
    cell: FloatArray
    reach: float

    def __post_init__(self) -> None:
        """Sort the samples into trees: all of them, with copies beyond the faces, and a few."""
        points = _inside(self.samples.points, self.cell)
        some = np.arange(0, len(points), _EVERY)
        margin = 2.0 * self.reach
        rows, copies = _padded(points, self.cell, margin)
        object.__setattr__(self, "_fine", (cKDTree(copies), rows))
        object.__setattr__(self, "_few", (cKDTree(points[some], boxsize=self.cell), some))

    def __call__(self, u: ArrayLike) -> FloatArray:
        """Values, shape (n,), at points ``u`` (n, 3) of the unit cube."""
        x = _inside(as_points("u", u) * self.cell, self.cell)
        tree, rows = self._few  # type: ignore[attr-defined]
        far, near = tree.query(x)
        near = rows[near]
        close = np.flatnonzero(far < 1.5 * self.reach)
        tree, rows = self._fine  # type: ignore[attr-defined]
        near[close] = rows[tree.query(x[close])[1]]
        d = self._distance(x, near)
        away = far >= 1.5 * self.reach
        d[away] = np.copysign(np.inf, d[away])
        s = np.clip(d / self.reach, -1.0, 1.0)
        q = s * s
        return self.reach * s * (1.0 - q * (2.0 / 3.0 - 0.2 * q))

    def _distance(self, x: FloatArray, near: IntArray) -> FloatArray:
        """Distance to the paraboloid at the nearest sample."""
        s = self.samples
        off = x - s.points[near]
        off -= np.rint(off / self.cell) * self.cell
        height = np.einsum("nc,nc->n", off, s.normals[near])
        aside = off - height[:, None] * s.normals[near]
        bent = 0.5 * np.einsum("ni,nij,nj->n", aside, s.shapes[near], aside)
        distance: FloatArray = height + bent
        return distance


def signed_tile(surface: Periodic, name: str, spans: int | None) -> Tile:
    """The tile whose zero set is a periodic surface.

    Parameters
    ----------
    surface : Periodic
        A surface that separates the cell.
    name : str
        Name of the tile.
    spans : int, optional
        Knot spans per axis.

    Returns
    -------
    Tile
        With a periodic cubic spline.

    Raises
    ------
    GeometryError
        If the surface does not separate the cell.
    """
    if not isinstance(name, str):
        raise InputError(f"name must be a text, got {name!r:.80}")
    if surface.objection:
        raise GeometryError(
            f"the surface is no boundary between an inside and an outside: {surface.objection}"
        )
    distance, edge = signed_distance(surface)
    longest = float(surface.cell.max())
    count = spans_for(edge / longest) if spans is None else as_whole("spans", spans, 4, MAX_SPANS)
    spline = fit(distance, degree=3, spans=count, method="interpolate", periodic=True)
    spline = BSpline(spline.t, spline.c / longest, spline.k, periodic=spline.periodic)
    warn_off(zero_set_error(spline, distance), name)
    edges = None if np.ptp(surface.cell) == 0.0 else np.diag(surface.cell / longest)
    return Tile(spline, name=name, source="minimal surface of triangles", edges=edges)


def signed_distance(surface: Periodic) -> tuple[SignedDistance, float]:
    """Signed distance to a surface that separates its cell.

    Parameters
    ----------
    surface : Periodic
        An oriented surface.

    Returns
    -------
    distance : SignedDistance
        Levelled off within the least radius of curvature.
    edge : float
        Mean length of the edges of its triangles.
    """
    v, faces = surface.mesh.vertices, surface.mesh.faces
    samples, bend = sampled(v, faces, smooth_normals(surface), _SAMPLES)
    reach = min(REACH / max(bend, 1e-9), MAX_REACH * float(surface.cell.min()))
    edge = float(np.linalg.norm(opposite_edges(v, faces), axis=2).mean())
    return SignedDistance(samples, surface.cell, reach), edge


def spans_for(edge: float) -> int:
    """Spans per cell that resolve what edges of that length resolve.

    Parameters
    ----------
    edge : float
        Mean length, in parts of the cell.

    Returns
    -------
    int
        A multiple of 4, from 24 to 64.
    """
    return int(np.clip(np.ceil(1.0 / edge / 4.0) * 4, 24, 64))


def sampled(
    v: FloatArray, faces: IntArray, normals: FloatArray, count: int
) -> tuple[Samples, float]:
    """Points of curved triangles, about as many per area everywhere.

    Parameters
    ----------
    v : (V, 3) array
        Vertices.
    faces : (F, 3) array
        Corners.
    normals : (V, 3) array
        Unit normals of the surface at the vertices.
    count : int
        About how many points; a triangle has one at least.

    Returns
    -------
    samples : Samples
        Points with normals and curvatures.
    bend : float
        Largest principal curvature, but for one in a thousand triangles.
    """
    shapes = _shapes(v, faces, normals[faces])
    bend = np.abs(np.linalg.eigvalsh(shapes)).max(axis=1)
    areas = np.linalg.norm(area_vectors(v, faces), axis=1)
    cuts = np.maximum(1, np.rint(np.sqrt(count * areas / areas.sum()))).astype(np.int64)
    parts = []
    for k in np.unique(cuts):
        rows, w = np.flatnonzero(cuts == k), _middles(int(k))
        points, n = curved(v[faces[rows]], normals[faces[rows]], w)
        parts.append((points, n, np.repeat(shapes[rows], len(w), axis=0)))
    points, n, every = (np.concatenate(part) for part in zip(*parts, strict=True))
    return Samples(points, n, every), float(np.quantile(bend, 0.999))


def _middles(cuts: int) -> FloatArray:
    """Middles of the parts of a triangle with divided edges, in barycentric coordinates."""
    i, j = np.divmod(np.arange(cuts * cuts), cuts)
    turned = i + j >= cuts
    i, j = np.where(turned, cuts - 1 - i, i), np.where(turned, cuts - 1 - j, j)
    third = np.where(turned, 2.0, 1.0) / 3.0
    w = np.stack([(i + third) / cuts, (j + third) / cuts], axis=1)
    return np.column_stack([1.0 - w.sum(axis=1), w])


def curved(p: FloatArray, normals: FloatArray, w: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Points and normals of curved triangles.

    The mean of the projections onto the tangent planes of the corners lies twice as far from the
    flat triangle as the surface does.

    Parameters
    ----------
    p, normals : (F, 3, 3) arrays
        Corners of triangles and normals there.
    w : (m, 3) array
        Barycentric coordinates.

    Returns
    -------
    points, normals : (F m, 3) arrays
        On the curved triangles.
    """
    flat = np.einsum("ma,fac->fmc", w, p)
    n = np.einsum("ma,fac->fmc", w, normals)
    gaps = np.einsum("fac,fac->fa", normals, p)[:, None, :] - np.einsum(
        "fac,fmc->fma", normals, flat
    )
    lifted = flat + 0.5 * np.einsum("ma,fma,fac->fmc", w, gaps, normals)
    return lifted.reshape(-1, 3), unit_rows(n.reshape(-1, 3))


def smooth_normals(surface: Periodic) -> FloatArray:
    """Normals of a periodic surface at its vertices.

    Parameters
    ----------
    surface : Periodic
        An oriented surface.

    Returns
    -------
    (V, 3) array
        Unit normals; those of a vertex take all triangles about it, over the faces of the cell.
    """
    sums = normal_sums(surface.mesh.vertices, surface.mesh.faces)
    labels = surface.labels
    whole: FloatArray = np.stack([np.bincount(labels, c) for c in sums.T], axis=1, dtype=float)
    return unit_rows(whole)[labels]


def normal_sums(v: FloatArray, faces: IntArray) -> FloatArray:
    """Sums of weighted normals of the triangles about vertices.

    Parameters
    ----------
    v : (V, 3) array
        Vertices.
    faces : (F, 3) array
        Corners.

    Returns
    -------
    (V, 3) array
        Their directions are those of normals at the vertices, exact on spheres.

    Notes
    -----
    N. Max, Journal of Graphics Tools 4 (1999).
    """
    e, w = opposite_edges(v, faces), area_vectors(v, faces)
    squares = np.einsum("fac,fac->fa", e, e)
    weight = 1.0 / (np.roll(squares, 1, axis=1) * np.roll(squares, -1, axis=1))
    return gathered(weight[:, :, None] * w[:, None, :], faces, len(v))


def _shapes(v: FloatArray, faces: IntArray, normals: FloatArray) -> FloatArray:
    """Second fundamental form of every triangle, from the normals at its corners."""
    p = v[faces]
    n = unit_rows(area_vectors(v, faces))
    first = unit_rows(p[:, 1] - p[:, 0])
    frame = np.stack([first, np.cross(n, first)], axis=1)
    moves = np.einsum("fkc,fac->fka", frame, p[:, 1:] - p[:, :1])
    turns = np.einsum("fkc,fac->fka", frame, normals[:, 1:] - normals[:, :1])
    form = turns @ np.linalg.inv(moves)
    form = 0.5 * (form + np.swapaxes(form, 1, 2))
    return np.einsum("fki,fkl,flj->fij", frame, form, frame)


def _padded(points: FloatArray, cell: FloatArray, margin: float) -> tuple[IntArray, FloatArray]:
    """Points of the cell and copies within a margin of it, with the rows that they copy."""
    rows, copies = np.arange(len(points)), points
    for axis in range(3):
        low = copies[:, axis] < margin
        high = copies[:, axis] > cell[axis] - margin
        step = cell * (np.arange(3) == axis)
        copies = np.concatenate([copies, copies[low] + step, copies[high] - step])
        rows = np.concatenate([rows, rows[low], rows[high]])
    return rows, copies


def _inside(x: FloatArray, cell: FloatArray) -> FloatArray:
    """Points shifted into the cell, below its upper faces."""
    y = np.mod(x, cell)
    return np.where(y >= cell, 0.0, y)


def zero_set_error(spline: Any, distance: SignedDistance) -> float:
    """How far the zero set of a spline is off a sampled surface.

    Parameters
    ----------
    spline : BSpline
        On the unit cube.
    distance : SignedDistance
        To the surface.

    Returns
    -------
    float
        Largest distance at 20 000 samples, in parts of the cell.
    """
    samples, cell = distance.samples, distance.cell
    some = np.random.default_rng(0).integers(0, len(samples.points), 20_000)
    value, gradient = spline.jet(_inside(samples.points[some], cell) / cell, order=1)
    slope = np.linalg.norm(gradient / cell * float(cell.max()), axis=1)
    return float(np.abs(value / np.maximum(slope, 0.1)).max())


def warn_coarse(off: float, name: str, wanted: float = COARSE) -> None:
    """Warn where the triangles of a surface are too large, for a tile: to be corrected.

    Parameters
    ----------
    off : float
        How far vertices are off the smooth surface, in parts of the cell; nan if it is not known.
    name : str
        Name of the tile.
    wanted : float
        Up to which nothing is said.
    """
    if not off <= wanted:
        told = f"by up to {off:.2g}" if off == off else "by an unknown part"
        warnings.warn(
            f"vertices of the surface of tile {name!r} are off the smooth surface {told} of the "
            f"cell (wanted {wanted:g}): take more edges per side",
            PrecisionWarning,
            stacklevel=4,
        )


def warn_off(off: float, name: str, wanted: float = TOLERANCE) -> None:
    """Warn where the zero set of a tile is off its surface.

    Parameters
    ----------
    off : float
        How far, in parts of the cell.
    name : str
        Name of the tile.
    wanted : float
        Up to which nothing is said.
    """
    if off > wanted:
        warnings.warn(
            f"the zero set of tile {name!r} is off the surface by up to {off:.2g} of the cell "
            f"(wanted {wanted:g}): take more spans, or more edges per side",
            PrecisionWarning,
            stacklevel=4,
        )
