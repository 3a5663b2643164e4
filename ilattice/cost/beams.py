"""Edges as round cones: a solid that is a field, meshed, sliced, intersected, analysed, printed.

A beam is the union of the balls along an edge whose radii go linearly from one end to the other.
The field is the least of the distances to all beams, less their radii: outside it is the exact
distance to the solid.

Guarantees: values are exact up to rounding, for any number of beams, in logarithmic time by a tree
of boxes; `range` is rigorous (the field is 1-Lipschitz); the same bits for any number of threads.
Analyses (`cutfem`) get the beams one by one: creases between them are not smeared.
Not guaranteed: between vertices a radius that is a function of position is linear; how far that is
off is warned of.
"""

import os
import warnings
from dataclasses import dataclass
from functools import cached_property
from typing import Any, ClassVar

import numpy as np

from ilattice._files import as_path
from ilattice._memory import need
from ilattice._progress import Progress
from ilattice._typing import AnyArray, ArrayLike, FloatArray, IntArray
from ilattice._validate import (
    as_array,
    as_choice,
    as_flag,
    as_kind,
    as_points,
    asked,
)
from ilattice.cost import _kernels_beams as kernels
from ilattice.cost import _pieces as pieces
from ilattice.cost._structure import Structure, _numbers
from ilattice.cost._surfaces import meshed, spacing_of, streamed
from ilattice.errors import FormatError, GeometryError, InputError, PrecisionWarning
from ilattice.fields import _kernels_boxes as tree
from ilattice.fields._pieces import Union
from ilattice.fields.node import Node
from ilattice.io import save
from ilattice.mesh.field_slices import slice_field
from ilattice.mesh.surface import SurfaceMesh
from ilattice.slicing.slices import SliceStack

#: Part of the radius that a linear radius may be off in the middle of a beam before a warning.
UNEVEN = 0.05
PER_BEAM = 400.0  # bytes


@dataclass(frozen=True, eq=False, repr=False)
class Beams(Union):
    """A solid of round beams between vertices.

    Attributes
    ----------
    vertices : ndarray, shape (n, 3)
        Ends of the beams.
    pairs : ndarray of int, shape (e, 2)
        Their numbers.
    radii : ndarray, shape (e, 2)
        Radii at the ends of each.
    """

    file_kind: ClassVar[str] = "beams"
    vertices: FloatArray
    pairs: IntArray
    radii: FloatArray

    def __post_init__(self) -> None:
        """Check the arrays."""
        x = as_points("vertices", self.vertices)
        pairs = _numbers("pairs", self.pairs, 2, len(x))
        if not len(pairs):
            raise InputError("pairs must not be empty: there is no beam")
        r = as_array("radii", self.radii)
        if r.shape != (len(pairs), 2):
            raise InputError(f"radii must have shape ({len(pairs)}, 2), got {r.shape}")
        if not (r > 0.0).all():
            i = int(np.argmax((r <= 0.0).any(axis=1)))
            raise InputError(f"radii must be positive, but radii[{i}] is {r[i].tolist()}")
        flat = (x[pairs[:, 0]] == x[pairs[:, 1]]).all(axis=1)
        if flat.any():
            i = int(np.argmax(flat))
            raise InputError(f"pairs[{i}] {pairs[i].tolist()} has both ends at one place; drop it")
        need(PER_BEAM * len(pairs), f"{len(pairs)} beams", "use fewer, or Blocks")
        put = object.__setattr__
        for name, value in (("vertices", x), ("pairs", pairs), ("radii", r)):
            put(self, name, np.array(value))
        super().__post_init__()

    def __repr__(self) -> str:
        low, high = self.radii.min(), self.radii.max()
        return f"Beams({len(self.pairs)} beams, radii from {low:.3g} to {high:.3g})"

    # ------------------------------------------------------------------ tree

    @cached_property
    def _tree(self) -> tuple[AnyArray, ...]:
        """Boxes, largest radii, links and beams of the tree, and the numbers of its beams."""
        a, b = self.vertices[self.pairs[:, 0]], self.vertices[self.pairs[:, 1]]
        lo, hi = np.minimum(a, b), np.maximum(a, b)
        m = len(lo)
        order = np.arange(m)
        box, link = np.empty((2 * m, 6)), np.empty((2 * m, 3), np.int64)
        count = tree.build(lo, hi, order, box, link, tree.LEAF)
        beam = np.hstack([self.radii, a, b])[order]
        box, link = box[:count].copy(), link[:count].copy()
        wide = np.empty(count)
        tree.greatest(link, beam[:, :2].max(axis=1), wide)
        return box, wide, link, beam, order

    # ------------------------------------------------------------------ field

    def _box(self, level: float = 0.0) -> FloatArray:
        r = np.maximum(self.radii + level, 0.0)
        x = self.vertices[self.pairs]
        kept = (self.radii + level >= 0.0)[..., None]
        low = np.where(kept, x - r[..., None], np.inf)
        high = np.where(kept, x + r[..., None], -np.inf)
        return np.stack([low.min(axis=(0, 1)), high.max(axis=(0, 1))])

    @property
    def analysis_box(self) -> FloatArray:
        """The box of the vertices, in which an analysis takes place unless told otherwise.

        Beams that end on its faces are cut through their middle, so that they can be held there.
        Of those that lie in a face half of the cross-section is outside: for all of it give an
        analysis a larger ``domain``, but for the face that is held.
        """
        used = self.vertices[self.pairs.ravel()]
        low, high = used.min(axis=0), used.max(axis=0)
        flat = high - low <= 1e-9 * float((high - low).max())
        box = self._box()
        return np.stack([np.where(flat, box[0], low), np.where(flat, box[1], high)])

    def values(self, points: FloatArray) -> FloatArray:
        """Values at checked points, without a copy of the program.

        Parameters
        ----------
        points : ndarray, shape (n, 3)
            Points.

        Returns
        -------
        ndarray, shape (n,)
            Values.
        """
        points = as_points("points", points)
        out = np.empty(len(points))
        box, wide, link, beam, _ = self._tree
        kernels.values(len(points), np.array(points), box, wide, link, beam, out)
        return out

    def __call__(self, p: ArrayLike, /) -> FloatArray:
        """Values, shape (n,), at points ``p`` (n, 3)."""
        return self.values(as_points("p", p))

    def jets(self, points: FloatArray, order: int) -> tuple[FloatArray, ...]:
        """Derivatives at checked points; those of the nearest beam.

        Parameters
        ----------
        points : ndarray, shape (n, 3)
            Points.
        order : {1, 2}
            Highest derivative.

        Returns
        -------
        tuple of ndarray
            Values (n,), gradients (n, 3) and, for order 2, Hessians (n, 3, 3).
        """
        points, order = as_points("points", points), as_choice("order", order, (1, 2))
        n = len(points)
        f, g, h = np.empty(n), np.empty((n, 3)), np.empty((n if order == 2 else 0, 3, 3))
        box, wide, link, beam, _ = self._tree
        kernels.jets(n, np.array(points), box, wide, link, beam, order, f, g, h)
        return (f, g, h)[: order + 1]

    def bounds_on(self, lo: FloatArray, hi: FloatArray, moved: bool) -> FloatArray:
        """Bounds on boxes.

        Parameters
        ----------
        lo, hi : ndarray, shape (n, 3)
            Corners.
        moved : bool
            Whether points are moved before, so that no steepness is known.

        Returns
        -------
        ndarray, shape (n, 3)
            Lower and upper bounds, and the largest slope.
        """
        lo, hi = pieces.corners(lo, hi)
        return pieces.bounds(self.values, lo, hi, as_flag("moved", moved))

    # ------------------------------------------------------------------ pieces for analyses

    def parts_on(self, lo: FloatArray, hi: FloatArray) -> list[tuple[tuple[int, ...], ...] | None]:
        """Pieces that may be nearest somewhere in boxes.

        Parameters
        ----------
        lo, hi : ndarray, shape (n, 3)
            Corners.

        Returns
        -------
        list of tuple of tuple of int or None
            Pieces: a 0 and the numbers (in the order of the tree) of beams that share a ball
            within the box, so that their distances are equal in a part of it; a 1 and that of a
            beam beside which the box lies; a 2 and the vertex of a ball that is nearest. None for
            boxes that are to be halved before.
        """
        return pieces.parts_on(self._tree, self.pairs, self._even, *pieces.corners(lo, hi))

    @cached_property
    def _even(self) -> AnyArray:
        """Whether all beams at a vertex have one radius there."""
        return pieces.balls_of(self.pairs, self.radii)

    def part(self, numbers: tuple[int, ...]) -> Node:
        """One of the pieces of `parts_on`.

        Parameters
        ----------
        numbers : tuple of int
            Its sort and beams, or vertex.

        Returns
        -------
        Node
            A field of its sign in such boxes: the distance for sort 0, or else a polynomial.

        Raises
        ------
        InputError
            If there is no such piece.
        """
        return pieces.part(self._tree, self.vertices, self.pairs, self.radii, numbers)

    # ------------------------------------------------------------------ what to do with it

    def mesh(
        self, h: float | None = None, *, tol: float | None = None, allow_loss: bool = False,
        progress: Progress = None,
    ) -> SurfaceMesh:  # fmt: skip
        """Closed surface of the solid, with sharp creases between beams.

        Parameters
        ----------
        h : float, optional
            Spacing of the grid: a third of the least radius or less.
        tol : float, optional
            Chord error instead; see `ilattice.sdf.mesh`.
        allow_loss : bool
            Accept a mesh whose volume differs by more than 5 % from that of the solid.
        progress : bool or callable, optional
            See `ilattice._progress.track`.

        Returns
        -------
        SurfaceMesh
            The surface.

        Raises
        ------
        GeometryError
            If `h` exceeds twice the least radius, so that beams would be lost, or for the volume.

        Warns
        -----
        PrecisionWarning
            If it exceeds the least radius.
        """
        least = float(self.radii.min())
        return meshed(self, least, h, tol=tol, allow_loss=allow_loss, progress=progress)

    def slices(self, z: ArrayLike | None = None, **options: Any) -> SliceStack:
        """Contours at heights; see `ilattice.mesh.slice_field`.

        Parameters
        ----------
        z : array_like, optional
            Heights; or give ``thickness``, that of layers.
        **options
            See there; `h` is half the least radius by default.

        Raises
        ------
        GeometryError
            If `h` exceeds twice the least radius, so that beams would be lost.

        Returns
        -------
        SliceStack
            Slices, each computed when asked for.
        """
        h = options.pop("h", None)
        least = float(self.radii.min())
        h = 0.5 * least if h is None else spacing_of(least, h)
        return slice_field(self, z, h=h, **options)

    def save(self, path: str | os.PathLike[str], **options: Any) -> None:
        """Write the beams: 3MF (beam lattice), VTP, VTU (lines with radii), STL, PLY (surface).

        Parameters
        ----------
        path : path-like
            File to write; its ending names the format.
        **options
            See the writer of the format in `ilattice.io`. For STL and PLY: ``h``, the spacing of
            the grid, by default a third of the least radius, and ``progress``. The surface goes
            into the file slab by slab, so that it may be larger than memory; its creases are
            chamfered within a cell (`mesh` makes sharp ones).
        """
        ending = as_path("path", path).suffix.lower()
        if ending in (".stl", ".ply"):
            streamed(self, float(self.radii.min()), path, **options)
        elif ending in (".3mf", ".vtp", ".vtu"):
            save(self, path, **options)
        else:
            raise FormatError(
                f"{str(path)!r:.200}: beams are written as .3mf, .ply, .stl, .vtp or .vtu, not "
                f"{ending!r}"
            )


def beams(k: Structure, radius: Any, *, check: bool = True) -> Beams:
    """Edges of a structure as round cones.

    Parameters
    ----------
    k : CornerSharing
        The structure; one in the plane lies at z = 0.
    radius : float, array_like or callable
        One for all, one per vertex (n,), one per edge (e,), both ends of each edge (e, 2), or a
        function of points (n, 3) that gives radii (n,); it is taken at the vertices.
    check : bool
        Refuse radii that fill a simplex, or that swallow a whole beam.

    Returns
    -------
    Beams
        The solid.

    Raises
    ------
    InputError
        For radii that are not positive or of another shape.
    GeometryError
        If beams fill a simplex or close all its faces, or the ball at an end of an edge holds the
        other one; the message names the first.

    Warns
    -----
    PrecisionWarning
        If a function is off by more than 5 % from linear in the middle of an edge.
    """
    as_kind("k", k, "CornerSharing")
    x = np.pad(k.positions, ((0, 0), (0, 3 - k.dim)))
    r = radii_of(k, x, radius)
    out = Beams(x, k.edges, r)
    if check:
        check_swallowed(k, r)
    return out


def radii_of(k: Structure, x: FloatArray, radius: Any) -> FloatArray:
    """Radii (e, 2) at the ends of edges."""
    n, e = len(x), k.edges
    if callable(radius):
        at = as_array("radius", asked("radius", radius, x.copy()))
        middle = x[e].mean(axis=1)
        there = as_array("radius", asked("radius", radius, middle.copy()))
        if at.shape != (n,) or there.shape != (len(e),):
            raise InputError(f"radius must give one value per point, ({n},), got {at.shape}")
        off = np.abs(there - at[e].mean(axis=1)) / np.maximum(np.abs(there), 1e-300)
        if off.max(initial=0.0) > UNEVEN:
            warnings.warn(
                f"the radius in the middle of edges is off by up to {100 * off.max():.2g} % from "
                "the linear one between their ends: refine, or use a smoother radius",
                PrecisionWarning,
                stacklevel=4,
            )
        return np.asarray(at[e])
    r = as_array("radius", radius)
    if np.ndim(radius) == 0:
        return np.full((len(e), 2), float(r.ravel()[0]))
    if r.shape == (len(e), 2):
        return r
    if r.shape == (n,) and n == len(e):
        raise InputError(
            f"radius of shape ({n},) is not clear: there are as many vertices as edges; give both "
            f"ends of edges, shape ({n}, 2)"
        )
    if r.shape == (len(e),):
        return np.stack([r, r], axis=1)
    if r.shape == (n,):
        return np.asarray(r[e])
    raise InputError(
        f"radius must be one number, one per vertex ({n},), one per edge ({len(e)},), both ends of "
        f"edges ({len(e)}, 2), or a function, got shape {r.shape}"
    )


def check_swallowed(k: Structure, r: FloatArray) -> None:
    """Refuse beams that lie in a ball at their end, and simplices all of whose faces are closed."""
    inside = np.flatnonzero(np.abs(r[:, 1] - r[:, 0]) >= k.lengths)
    if len(inside):
        i = int(inside[0])
        raise GeometryError(
            f"the ball at one end of edge {i} {k.edges[i].tolist()} holds the other one: radii "
            f"{r[i].tolist()}, length {k.lengths[i]:.3g} ({len(inside)} edges are so)"
        )
    d, m = k.dim, len(k.simplices)
    own = len(k.edges[: m * d * (d + 1) // 2]) // max(m, 1)
    ends, radii = k.positions[k.edges[: m * own]].reshape(m, own, 2, d), r[: m * own]
    radii = radii.reshape(m, own, 2).min(axis=2)
    corners = k.positions[k.simplices]
    faces = [np.delete(np.arange(4), j) for j in range(4)] if d == 3 else [np.arange(3)]
    full = np.arange(m)
    for lattice in (np.full((1, 3), 1.0 / 3.0), LATTICE):  # the middle first: it is mostly free
        for face in faces:
            p = np.einsum("qj,mjd->mqd", lattice, corners[full][:, face])
            held = [
                (_distances(p[:, q], ends[full]) <= radii[full]).any(axis=1)
                for q in range(len(lattice))
            ]
            full = full[np.all(held, axis=0)]
    if len(full):
        i = int(full[0])
        raise GeometryError(
            f"beams close all faces of simplex {i} {k.simplices[i].tolist()}, with radii "
            f"up to {radii[i].max():.3g} and edges from {_shortest(ends[i]):.3g} "
            f"({len(full)} of {m} are so): use smaller radii"
        )


#: Barycentric coordinates of points on a face at which it is looked whether beams close it.
LATTICE = np.array([(i, j, 12 - i - j) for i in range(13) for j in range(13 - i)]) / 12.0


def _distances(p: FloatArray, ends: FloatArray) -> FloatArray:
    """Distances (m, e) of points (m, d) from segments (m, e, 2, d)."""
    a, way = ends[:, :, 0], ends[:, :, 1] - ends[:, :, 0]
    t = ((p[:, None] - a) * way).sum(axis=2) / np.maximum((way**2).sum(axis=2), 1e-300)
    foot = a + np.clip(t, 0.0, 1.0)[..., None] * way
    return np.asarray(np.linalg.norm(p[:, None] - foot, axis=2))


def _shortest(ends: FloatArray) -> float:
    return float(np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1).min())
