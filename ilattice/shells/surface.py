"""Shells in one octant: surfaces of least area over a boundary, smooth where octants meet.

Guarantees: surfaces are stationary to the residual that they report, in as many pieces as the
harmonic function has; boundaries are the given curves. Non-guarantees: mean curvature vanishes away
from the boundary only (see `ilattice.minimal.clamped`), by how much is reported; no surface is the
least one.
"""

import warnings
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from scipy import sparse
from scipy.sparse.csgraph import connected_components

from ilattice._progress import Progress, staged
from ilattice._typing import AnyArray, FloatArray, IntArray
from ilattice._validate import Frozen, as_choice, as_not_negative, as_real, as_whole, read_only
from ilattice.errors import ConvergenceError, GeometryError, InputError, PrecisionWarning
from ilattice.mesh import SurfaceMesh
from ilattice.minimal.clamped import Rim, clamped
from ilattice.minimal.completion import PeriodicSurface, completed
from ilattice.minimal.disc import area_vectors, unit_rows, vertex_areas
from ilattice.minimal.symmetry import Group
from ilattice.minimal.tile import normal_sums
from ilattice.shells.boundary import Boundary, check_translations
from ilattice.shells.octant import Triangles, evened, graded, harmonic, least_gradient, zero_set

METHODS = ("harmonic", "currents")
#: Cells per edge of the octant, and lengths over which mean curvatures die out, in cells: the first
#: that is tried, thicker ones for surfaces that tear, and the least.
N, LAYER, THICKER, MIN_LAYER = 24, 0.01, (0.02, 0.04), 0.003
#: Mean curvature, times the edge of the cell, that half of the area stays below: that of coarse
#: triangles, by which layers are chosen, and that which is told.
_CURVED, CURVED = 0.04, 0.05
#: Ratios of layers from one surface to the next where larger ones tear: the first, and the least.
_SMALL_STEP, _MIN_STEP = 2.0**0.25, 1.05
#: Fewest and most cells per edge of the octant that may be asked for; chosen without measurements.
MIN_N, MAX_N = 8, 96
#: The harmonic function is found on a grid at least so fine.
_FINE = 48
#: Edges of triangles times n, in cells; parts of the layer that edges at the boundary may have, and
#: have at most where it gets thinner in the end; most rounds of division.
EDGE, _RESOLVED, _COARSEST, _MAX_ROUNDS = 0.65, 0.35, 0.5, 6
_SCALE = 0.25  # from the octant [-1, 1]³ to the cell
_SAME = 1e-9  # images of vertices on the faces of the octant agree to rounding


@dataclass(frozen=True, eq=False, repr=False)
class OctantSurface(Frozen):
    """A surface in the octant [1/2, 1]³ of the unit cell. Made by `surface`.

    Attributes
    ----------
    boundary : Boundary
        Its boundary, in the cube [-1, 1]³.
    symmetry : str
        How octants make up the cell: r or t for each axis.
    vertices : (V, 3) array
        In the cell.
    faces : (F, 3) array
        Corners; normals point to the side of positive colour.
    on : (V, 3) array of int
        -1 or 1 where a vertex lies on the lower or upper face of the octant, else 0.
    mean_curvature : (V,) array
        Absolute mean of the principal curvatures, of the surface with its images.
    residual : float
        Largest force per area, times the size.
    factorizations : int
        Sparse factorizations.
    layer : float
        Length over which mean curvatures die out, in cells.
    """

    boundary: Boundary
    symmetry: str
    vertices: FloatArray
    faces: IntArray
    on: IntArray
    mean_curvature: FloatArray
    residual: float
    factorizations: int
    layer: float

    def __repr__(self) -> str:
        """Short form."""
        name = self.boundary.topology.paper or self.boundary.topology.name
        return f"OctantSurface({name}_{self.symmetry}, {len(self.faces)} triangles)"

    @cached_property
    def mesh(self) -> SurfaceMesh:
        """The triangles."""
        return SurfaceMesh._adopt(np.array(self.vertices), np.array(self.faces))

    @cached_property
    def normals(self) -> FloatArray:
        """Unit normals (V, 3) of the surface with its images, to the side of positive colour."""
        sums = normal_sums(self.vertices, self.faces)
        turned = np.ones(len(sums))
        for axis, letter in enumerate(self.symmetry):
            if letter == "r":
                sums[self.on[:, axis] != 0, axis] = 0.0
            else:
                turned[self.on[:, axis] == 1] *= self.signs[axis]
        labels = _labels(self.vertices, self.on, self.symmetry)
        parts = [np.bincount(labels, turned * c) for c in sums.T]
        unit = unit_rows(np.stack(parts, axis=1, dtype=float))
        normals: FloatArray = read_only(turned[:, None] * unit[labels])
        return normals

    @property
    def area(self) -> float:
        """Area per cell: of eight octants."""
        return 8.0 * self.mesh.area

    @cached_property
    def slopes(self) -> tuple[FloatArray, FloatArray]:
        """Sines of the angles by which triangles at mirrors miss the right one, and their edges.

        Returns
        -------
        slopes, lengths : (n,) arrays
            Of all edges on the boundary, at axes of reflection.
        """
        w = area_vectors(self.vertices, self.faces)
        n = w / np.linalg.norm(w, axis=1)[:, None]
        slopes, lengths = [], []
        for axis in range(3):
            for side in (-1, 1):
                held = self.on[self.faces, axis] == side
                rows = np.flatnonzero(held.sum(axis=1) == 2)
                if self.symmetry[axis] == "t" or not len(rows):
                    continue
                ends = self.vertices[self.faces[rows][held[rows]].reshape(-1, 2)]
                slopes.append(np.abs(n[rows, axis]))
                lengths.append(np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1))
        both = (np.concatenate([np.zeros(0), *parts]) for parts in (slopes, lengths))
        found, edges = (read_only(a) for a in both)
        return found, edges

    @property
    def slope(self) -> float:
        """Mean of `slopes` along the boundary; 0 without reflections."""
        slopes, lengths = self.slopes
        return float(np.average(slopes, weights=lengths)) if len(slopes) else 0.0

    @cached_property
    def pieces(self) -> IntArray:
        """Number of the piece of each vertex, from 0, in the octant."""
        rows = np.concatenate([self.faces[:, :2], self.faces[:, 1:]]).T
        links = sparse.coo_array((np.ones(rows.shape[1], bool), rows), shape=(len(self.on),) * 2)
        pieces: IntArray = read_only(
            connected_components(links, directed=False)[1].astype(np.int64)
        )
        return pieces

    @cached_property
    def bubbles(self) -> int:
        """Pieces that reflections close to bubbles, which no other part of the shell touches.

        They end on one face at most of each axis, by which they are reflected.
        """
        found = 0
        for k in range(int(self.pieces.max()) + 1):
            on = self.on[self.pieces == k]
            both = (on == -1).any(axis=0) & (on == 1).any(axis=0)
            moved = np.array([letter == "t" for letter in self.symmetry]) & on.any(axis=0)
            found += not (both | moved).any()
        return found

    def curvature_quantile(self, q: float = 0.5) -> float:
        """Quantile of the mean curvature over the area.

        Parameters
        ----------
        q : float
            0.5 for the median.

        Returns
        -------
        float
            In one over edges of the cell.

        Raises
        ------
        InputError
            If `q` is not between 0 and 1.
        """
        q = as_real("q", q)
        if not 0.0 <= q <= 1.0:
            raise InputError(f"q must be from 0 to 1, got {q:g}")
        order = np.argsort(self.mean_curvature)
        part = np.cumsum(vertex_areas(self.vertices, self.faces)[order])
        row = int(np.searchsorted(part, q * part[-1]))
        return float(self.mean_curvature[order[min(row, len(order) - 1)]])

    @cached_property
    def signs(self) -> tuple[int, ...]:
        """For each axis -1 if sides swap from one octant to the next, else 1."""
        return tuple(
            1 if kind == "r" else self.boundary.congruent(axis)
            for axis, kind in enumerate(self.symmetry)
        )

    def completed(self) -> PeriodicSurface:
        """The surface in the whole cell, which repeats.

        Returns
        -------
        PeriodicSurface
            Eight octants, joined; its sides are those of the colours.
        """
        matrices, shifts, sides = [np.eye(3)], [np.zeros(3)], [1]
        for axis, kind in enumerate(self.symmetry):
            unit = np.eye(3)[axis]
            turn = np.eye(3) - 2.0 * np.outer(unit, unit) if kind == "r" else np.eye(3)
            shift = unit if kind == "r" else 0.5 * unit
            matrices += [turn @ m for m in matrices]
            shifts += [turn @ s + shift for s in shifts]
            sides += [self.signs[axis] * s for s in sides]
        group = Group(
            read_only(np.array(matrices)), read_only(np.array(shifts)), read_only(np.ones(3))
        )
        return completed(self.vertices, self.faces, group, np.array(sides), tol=_SAME)


def surface(
    curves: Boundary, symmetry: str = "rrr", *, n: int = N, method: str = "harmonic",
    layer: float | None = None, progress: Progress = None,
) -> OctantSurface:  # fmt: skip
    """Surface over a boundary, smooth where octants meet.

    Parameters
    ----------
    curves : Boundary
        The boundary.
    symmetry : str
        r or t for each axis: whether octants are reflected or translated.
    n : int
        Cells per edge of the octant from which triangles are made, 8 to 96; edges are about 1.3 of
        them.
    method : {"harmonic", "currents"}
        Where the search starts: at the zero set of the harmonic function, or at the surface of
        least area of all.
    layer : float, optional
        Length, in cells, over which mean curvatures die out that a smooth transition needs; 0 for
        surfaces of least area with creases where octants meet. By default 0.01 or, where creases
        are near to most of the surface, as much less (down to 0.003) as keeps the mean curvature
        below 0.05 on half of the area; 0.02 or 0.04 where thinner ones tear: see
        `OctantSurface.layer`.
    progress : bool or callable, optional
        "start" and "surface"; see `ilattice._progress.track`.

    Returns
    -------
    OctantSurface
        The surface.

    Raises
    ------
    InputError
        If an argument is wrong.
    GeometryError
        If octants cannot be translated, or the surface of least area is in other pieces.
    ConvergenceError
        If no stationary surface is found.

    Warns
    -----
    PrecisionWarning
        If the mean curvature is above 0.05 on half of the area, since thinner layers tear.
    """
    if not isinstance(curves, Boundary):
        raise InputError(f"curves must be a Boundary, got {curves!r:.80}")
    if not isinstance(symmetry, str) or len(symmetry) != 3 or set(symmetry) - {"r", "t"}:
        raise InputError(f"symmetry must be r or t for each axis, as 'rrt', got {symmetry!r:.40}")
    n = as_whole("n", n, MIN_N, MAX_N)
    as_choice("method", method, METHODS)
    given = None if layer is None else as_layer(layer)
    glued = tuple(letter == "t" for letter in symmetry)
    check_translations(curves, symmetry)
    step = max(1, -(-_FINE // n))

    def triangles() -> Triangles:
        found = zero_set(harmonic(curves, step * n), curves, n, glued)
        least = _least(curves, n, glued, found) if method == "currents" else found
        return _evened(least, least.vertices)

    (start,) = staged({"start": triangles}, progress)
    work = {"surface": lambda: _smooth(start, curves, symmetry, n, given)}
    (found,) = staged(work, progress)
    if given is None and found.curvature_quantile() > CURVED:
        warnings.warn(
            f"{found} has mean curvatures above {found.curvature_quantile():.2g} over the edge of "
            f"the cell on half of its area (wanted {CURVED:g}): with layers thinner than "
            f"{found.layer:.2g} it tears, as surfaces do whose necks are too long, or they are "
            "not tried; move nodes of the boundary, or accept that it is no surface of least area",
            PrecisionWarning, stacklevel=2,
        )  # fmt: skip
    return found


def as_layer(layer: Any) -> float:
    """A length of layers, up to the edge of the cell.

    Parameters
    ----------
    layer : float
        Length, in cells.

    Returns
    -------
    float
        The same.

    Raises
    ------
    InputError
        If it is none.
    """
    length = as_not_negative("layer", layer)
    if length > 1.0:
        raise InputError(f"layer must be at most 1, the edge of the cell, got {length:g}")
    return length


def _smooth(
    start: Triangles, curves: Boundary, symmetry: str, n: int, layer: float | None
) -> OctantSurface:
    """The stationary surface near triangles, with smaller ones at the boundary in the end."""
    if layer is not None:
        coarse = _tried(start, curves, symmetry, (layer,)) if _rounds(n, layer) else None
        return _graded(start, coarse, curves, symmetry, n, layer)
    coarse = _tried(start, curves, symmetry, (LAYER, *THICKER))
    thin = [] if coarse is None else _thinner(start, coarse, curves, symmetry)
    for one in reversed(thin):
        with suppress(ConvergenceError):
            return _continued(_graded(start, one, curves, symmetry, n, one.layer), n)
    first = LAYER if coarse is None else coarse.layer
    *others, last = (first, *(thick for thick in THICKER if thick > first))
    for one_layer in others:
        with suppress(ConvergenceError):
            return _continued(_graded(start, coarse, curves, symmetry, n, one_layer), n)
    return _continued(_graded(start, coarse, curves, symmetry, n, last), n)


def _continued(found: OctantSurface, n: int) -> OctantSurface:
    """The surface with a thinner layer, if it needs one: by small steps, from one to the next."""
    least = max(MIN_LAYER, EDGE / n / 2 ** _rounds(n, found.layer) / _COARSEST)
    step = _SMALL_STEP
    while found.curvature_quantile() > _CURVED and found.layer > least and step > _MIN_STEP:
        triangles = Triangles((found.vertices - 0.5) / _SCALE - 1.0, found.faces, found.on)
        triangles = _evened(triangles, triangles.vertices)
        layer = max(least, found.layer / step)
        try:
            thin = _solved(triangles, found.boundary, found.symmetry, layer, True)
        except ConvergenceError:
            step = np.sqrt(step)
            continue
        found = replace(thin, factorizations=found.factorizations + thin.factorizations)
    return found


def _tried(
    start: Triangles, curves: Boundary, symmetry: str, layers: tuple[float, ...]
) -> OctantSurface | None:
    """The coarse surface with the first layer in which it does not tear."""
    for one in layers:
        with suppress(ConvergenceError):
            return _solved(start, curves, symmetry, one)
    return None


def _thinner(
    start: Triangles, coarse: OctantSurface, curves: Boundary, symmetry: str
) -> list[OctantSurface]:
    """Coarse surfaces with thinner layers, the last of which is curved near its boundary only."""
    found: list[OctantSurface] = []
    while coarse.curvature_quantile() > _CURVED and coarse.layer > MIN_LAYER:
        layer = max(MIN_LAYER, coarse.layer / np.sqrt(2.0))
        try:
            thin = _solved(_moved(start, coarse), curves, symmetry, layer, True)
        except ConvergenceError:
            break
        coarse = replace(thin, factorizations=coarse.factorizations + thin.factorizations)
        found.append(coarse)
    return found


def _moved(start: Triangles, to: OctantSurface) -> Triangles:
    """Triangles in the places of a solution, evened out along it: its steps are along normals."""
    return _evened(start, (to.vertices - 0.5) / _SCALE - 1.0)


def _evened(start: Triangles, v: FloatArray) -> Triangles:
    """Triangles with other vertices inside, evened out along their surface."""
    rim: AnyArray = np.asarray(start.on.any(axis=1))
    v = np.where(rim[:, None], start.vertices, v)
    return replace(start, vertices=evened(v, start.faces, rim))


def _graded(
    start: Triangles, coarse: OctantSurface | None, curves: Boundary, symmetry: str, n: int,
    layer: float,
) -> OctantSurface:  # fmt: skip
    """The surface with triangles at the boundary that resolve the layer, from a coarse one."""
    glued = tuple(letter == "t" for letter in symmetry)
    rounds = _rounds(n, layer)
    if coarse is None:
        return _solved(graded(start, curves, glued, rounds), curves, symmetry, layer)
    fine = graded(_moved(start, coarse), curves, glued, rounds)
    found = _solved(fine, curves, symmetry, layer, True)
    return replace(found, factorizations=coarse.factorizations + found.factorizations)


def _solved(
    start: Triangles, curves: Boundary, symmetry: str, layer: float, near: bool = False
) -> OctantSurface:
    """The stationary surface near triangles."""
    v, on = start.vertices, start.on
    projectors = np.tile(np.eye(3), (len(v), 1, 1))
    for axis, letter in enumerate(symmetry):
        if letter == "r":
            projectors[on[:, axis] != 0, axis, axis] = 0.0
    rim = Rim(on.any(axis=1), projectors, _labels(v, on, symmetry))
    name = curves.topology.paper or curves.topology.name
    what = f"the shell {name}_{symmetry}"
    solved, h = clamped(v, start.faces, rim, layer / _SCALE, what=what, near=near)
    x = 0.5 + _SCALE * (solved.vertices + 1.0)
    return OctantSurface(
        curves, symmetry, read_only(x), read_only(start.faces), read_only(on),
        read_only(np.abs(h) / _SCALE), solved.residual, solved.factorizations, layer,
    )  # fmt: skip


def _rounds(n: int, layer: float) -> int:
    """How often triangles at the boundary are divided, so that they resolve a layer."""
    if layer == 0.0:
        return 0
    return int(np.clip(np.ceil(np.log2(EDGE / n / (_RESOLVED * layer))), 0, _MAX_ROUNDS))


def _least(curves: Boundary, n: int, glued: tuple[bool, ...], start: Triangles) -> Triangles:
    """Start from the surface of least area, if it hangs together as the harmonic one does."""
    found = zero_set(least_gradient(curves, n), curves, n, glued)
    counts = []
    for t in (start, found):
        mesh = SurfaceMesh._adopt(np.array(t.vertices), np.array(t.faces))
        counts.append((mesh.components, mesh.euler, mesh.area * _SCALE**2))
    (parts, euler, area), (others, other_euler, less) = counts
    if (parts, euler) != (others, other_euler):
        raise GeometryError(
            f"the surface of least area over this boundary collapses: it has {others} pieces "
            f"(Euler number {other_euler}, area {less:.4g} of an octant of edge 1/2) where the "
            f"harmonic one has {parts} ({euler}, {area:.4g}); method='harmonic' keeps that"
        )
    return found


def _labels(v: FloatArray, on: IntArray, symmetry: str) -> IntArray:
    """Equal numbers for vertices that are one when octants are shifted."""
    labels = np.arange(len(v))
    low, high = v.min(axis=0), v.max(axis=0)
    shifted = np.array([letter == "t" for letter in symmetry])
    rows = np.flatnonzero((on[:, shifted] != 0).any(axis=1))
    q = v[rows] - np.where((on[rows] == 1) & shifted, high - low, 0.0)
    _, first, back = np.unique(
        np.round(q / (high - low), 9), axis=0, return_index=True, return_inverse=True
    )
    labels[rows] = rows[first][back.ravel()]
    return labels
