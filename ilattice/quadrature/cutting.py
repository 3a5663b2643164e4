"""Solids on background grids: the certified signs of cells, and rules on them.

`cut(wall, cells)` puts a wall, or any one or two level sets, on a grid of boxes over the parameter
domain. Without `cells` the grid is that of the elements of the splines; a grid that is coarser, or
does not match, is refined inside by the breaks of the splines, so that cells may be any.

Guarantees: a cell that is called in or out is so everywhere: its sign is decided by Bernstein
coefficients, never by sampling. A cell that is called cut may be full or empty by less than the
halving of pieces can tell. Fields of `il.fields` and `il.sdf` are split at `abs`, `min`, `max` and
steps into smooth ones, and certified by their bounds.
Non-guarantee: the certificate for functions without `range` is that of their interpolant, and what
is smaller than a cell may be missed in them; `CutGrid.error` and a warning say what is seen of it,
`CutGrid.unseen` how large is what may not be.
"""

import math
import warnings
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from ilattice._field import owns
from ilattice._geometry import grid_array
from ilattice._memory import need
from ilattice._progress import Progress, staged
from ilattice._typing import AnyArray, FloatArray, IntArray, Solid
from ilattice._validate import Frozen, as_array, as_choice, as_counts
from ilattice.errors import GeometryError, InputError, PrecisionWarning
from ilattice.macroshape.maps import SplineMap
from ilattice.plot.quick import show
from ilattice.plot.shapes import hexahedra
from ilattice.quadrature._filling import sites
from ilattice.quadrature._layouts import Layout, layout_of
from ilattice.quadrature.field_pieces import CRUDE, TOLD, FieldPieces
from ilattice.quadrature.grid import CUT, IN, OUT, Grid
from ilattice.quadrature.levelsets import PER_PIECE, LevelSets, Pieces, as_level_sets
from ilattice.quadrature.making import end_face_rule, inner_face_rule, surface_rule, volume_rule
from ilattice.quadrature.rules import NAMES, Quadrature

if TYPE_CHECKING:
    import pyvista

#: Error of the volume of a speck, a void or a thin part around one cell, as a part of it, above
#: which that is told.
LOCALLY = 0.1


@dataclass(frozen=True, eq=False, repr=False)
class CutGrid(Frozen):
    """Level sets on a grid: made by `cut`.

    Attributes
    ----------
    grid : Grid
        The cells.
    sets : LevelSets
        The solid is where all of them are negative.
    through : SplineMap or None
        The map to space, if there is one.
    """

    grid: Grid
    sets: LevelSets
    through: SplineMap | None = None

    def __repr__(self) -> str:
        inside, cut, _ = (int((self.status == sign).sum()) for sign in (IN, CUT, OUT))
        size = " x ".join(map(str, self.grid.shape))
        return f"CutGrid({size} cells: {inside} in, {cut} cut, of {self.sets!r})"

    @cached_property
    def pieces(self) -> "Pieces | FieldPieces":
        """The boxes on which the level sets are polynomials."""
        return self.sets.pieces(self.grid.axes)

    @cached_property
    def layout(self) -> Layout:
        """Which boxes make up the cells."""
        return layout_of(self.grid, self.pieces)

    @cached_property
    def status(self) -> AnyArray:
        """Sign of the solid in each cell: -1 in, 0 cut, 1 out; shape of the grid, int8."""
        return self.layout.status

    def cells(self, status: int) -> IntArray:
        """Numbers of the cells with a status.

        Parameters
        ----------
        status : {-1, 0, 1}
            In, cut or out.

        Returns
        -------
        ndarray, shape (n,)
            In increasing order, the last direction running fastest.
        """
        wanted = as_choice("status", status, (IN, CUT, OUT))
        return np.flatnonzero(self.status.ravel() == wanted)

    @property
    def error(self) -> float:
        """Estimated error of the volume, as a part of it; 0 for splines.

        How far the surface of what is integrated is from that of the fields, times its area, and
        boxes of which it is not certain whether they are in the solid, over the volume.
        """
        return self.pieces.error

    @property
    def unseen(self) -> float:
        """Diameter of the largest speck or void that may pass unseen, in lengths of a cell.

        It is 0 where all is certified: for splines, and for fields that have a formula or bounds. A
        function of points is known at the sites of its interpolant, `degree` + 1 per direction and
        cell, at a few more, and where slopes lead from there: so balls of a hundredth of a cell are
        found in distances. What fits between is not in `error`; its volume is at most that of such
        a ball, times the number of cells that have one.
        """
        if not self.sets.opaque:
            return 0.0
        return float(np.sqrt(3.0) * np.diff(sites(self.sets.degree + 1)[0]).max())

    def to_pyvista(self) -> "pyvista.UnstructuredGrid":
        """The cells that are in or cut, for pictures.

        Returns
        -------
        pyvista.UnstructuredGrid
            In space, with cell data ``status``: -1 in, 0 cut.
        """
        u = grid_array(*self.grid.axes)
        x = u if self.through is None else self.through.x(u.reshape(-1, 3)).reshape(u.shape)
        cells = hexahedra(x, self.status < OUT)
        status = self.status.ravel(order="F")
        cells.cell_data["status"] = status[status < OUT]
        return cells

    def plot(self, **options: Any) -> Any:
        """Show the cells that are in and those that are cut in a window or a notebook.

        Parameters
        ----------
        **options
            Of `ilattice.plot.show`, such as ``clip``, ``view`` or ``screenshot``.

        Returns
        -------
        object
            What pyvista returns.
        """
        usual = {"scalars": "status", "cmap": ["#e0a030", "#4a7ba6"], "clim": (-1, 0),
                 "label": "", "show_edges": True, "title": "in: yellow, cut: blue"}  # fmt: skip
        return show(self, **{**usual, **options})

    # ------------------------------------------------------------------ rules

    def volume(self, q: int = 3, *, tangent_depth: int = 3, only: str = "") -> Quadrature:
        """Rule on the solid.

        Parameters
        ----------
        q : int
            Gauss points per direction and piece of a cell, 1 to 10.
        tangent_depth : int
            How often a box is halved that has a direction to integrate along, but is nearly
            tangent to it.
        only : {"", "in", "cut"}
            Which cells; by default both.

        Returns
        -------
        Quadrature
            Points in the parameter domain, by cell.
        """
        return volume_rule(self, q, tangent_depth, only)

    def surface(self, q: int = 3, *, tangent_depth: int = 3) -> Quadrature:
        """Rule on the zero sets that bound the solid, with outward normals.

        Parameters
        ----------
        q : int
            Gauss points per direction, 1 to 10.
        tangent_depth : int
            As in `volume`.

        Returns
        -------
        Quadrature
            Points in the parameter domain; `sets` tells which zero set each is on.
        """
        return surface_rule(self, q, tangent_depth)

    def face(self, name: str, q: int = 3, *, tangent_depth: int = 3) -> Quadrature:
        """Rule on the part of the solid on one end face of the grid, normals outward.

        Parameters
        ----------
        name : {"u=0", "u=1", "v=0", "v=1", "w=0", "w=1"}
            The face: where that parameter is at its lower (0) or upper (1) end.
        q : int
            Gauss points per direction, 1 to 10.
        tangent_depth : int
            As in `volume`.

        Returns
        -------
        Quadrature
            Points by cell.
        """
        return end_face_rule(self, name, q, tangent_depth)

    def faces(self, axis: int, q: int = 3, *, tangent_depth: int = 3) -> Quadrature:
        """Rule on the part of the solid on the faces between neighbouring cells.

        Parameters
        ----------
        axis : {0, 1, 2}
            Direction across the faces.
        q : int
            Gauss points per direction, 1 to 10.
        tangent_depth : int
            As in `volume`.

        Returns
        -------
        Quadrature
            Points by face: `cells` are those on the lower side, `neighbours` those on the upper;
            normals point from lower to upper. In a closed direction the seam counts as such.
        """
        return inner_face_rule(self, axis, q, tangent_depth)


def cut(
    field: Any,
    cells: Any = None,
    *,
    domain: Any = None,
    degree: int = 4,
    through: SplineMap | None = None,
) -> CutGrid:
    """A wall, or one or two level sets, on a background grid.

    Parameters
    ----------
    field : Wall, BSpline, Node, callable, or pair of fields
        The solid is where it is negative; of a pair, where both are. Solids with edges or thin
        parts are best stated by `il.fields` or `il.sdf`: those are found and integrated exactly
        that a function of points, which tells nothing of its kinks, may hide between samples; see
        `CutGrid.unseen`.
    cells : int, sequence of 3 int or Grid, optional
        Number of equal cells per direction, or the grid itself. By default the elements of the
        splines.
    domain : array_like, shape (2, 3), optional
        Box of the grid; by default the bounds of the field.
    degree : int
        Degree of the interpolation of fields that are no splines, 1 to 4.
    through : SplineMap, optional
        Map to space; by default that of the wall.

    Returns
    -------
    CutGrid
        Signs of cells, and rules.

    Raises
    ------
    InputError
        If an argument is of the wrong kind, or the grid leaves the field.
    GeometryError
        If no part of the grid is in the solid.

    Warns
    -----
    PrecisionWarning
        If the estimated error of the volume is more than 0.1 %, or, around one cell, a tenth of the
        solid or of the air there and half a thousandth of the cell. The latter is left out where
        the volume is not known to 0.2 %.

    Examples
    --------
    >>> import numpy as np
    >>> import ilattice as il
    >>> def ball(u):
    ...     return (u**2).sum(axis=1) - 0.16
    >>> grid = il.cutfem.cut(ball, 8, domain=np.array([[-0.5] * 3, [0.5] * 3]), degree=2)
    >>> round(grid.volume(q=4).integrate(), 6)
    0.268083
    """
    as_choice("degree", degree, (1, 2, 3, 4))
    if through is not None and not isinstance(through, SplineMap):
        raise InputError(f"through must be a SplineMap, got {type(through).__name__}")
    box = None if domain is None else _as_box(domain)
    if isinstance(cells, Grid):
        if domain is not None:
            raise InputError("domain: a Grid has its own; give one of the two")
        box = cells.domain
    sets = as_level_sets(field, box, degree)
    if isinstance(field, Solid) and through is None:
        through = field.through
    grid = cells if isinstance(cells, Grid) else _as_grid(cells, sets, through)
    out = CutGrid(grid, sets, through)
    if (out.status == OUT).all():
        raise GeometryError("the solid is empty: the field is positive in every cell of the grid")
    check_resolved(out, "field")
    return out


def quadrature(
    field: Any,
    cells: Any = None,
    *,
    q: int = 3,
    kind: str = "volume",
    domain: Any = None,
    degree: int = 4,
    tangent_depth: int = 3,
    progress: Progress = None,
) -> Quadrature:
    """Rule to integrate over a solid, or its surface: in space for a wall.

    Parameters
    ----------
    field : Wall, BSpline, callable, or pair of fields
        The solid is where it is negative, as in `cut`.
    cells : int, sequence of 3 int or Grid, optional
        Background grid, as in `cut`.
    q : int
        Gauss points per direction and piece of a cell, 1 to 10.
    kind : {"volume", "surface", "u=0", "u=1", "v=0", "v=1", "w=0", "w=1"}
        The solid, the level sets that bound it, or its part on an end face of the domain.
    domain : array_like, shape (2, 3), optional
        Box of the grid; by default the bounds of the field.
    degree : int
        Degree of the interpolation of fields that are no splines, 1 to 4.
    tangent_depth : int
        How often a nearly tangent box is halved.
    progress : bool or callable, optional
        "cells" and "rules"; see `ilattice._progress.track`.

    Returns
    -------
    Quadrature
        In space for a wall, in parameters for any other field.

    Raises
    ------
    InputError
        If an argument is wrong.
    GeometryError
        If the solid is empty.

    Examples
    --------
    >>> import ilattice as il
    >>> lattice = il.Lattice("gyroid", through=il.macroshape.box((1, 1, 1)))
    >>> rule = il.cutfem.quadrature(lattice.offset(0.05), q=2)
    >>> volume, centroid = rule.integrate(), rule.integrate(lambda x: x) / rule.integrate()
    """
    as_choice("kind", kind, ("volume", "surface", *NAMES))
    grid = cut(field, cells, domain=domain, degree=degree)
    depth = tangent_depth
    made = {
        "volume": lambda: grid.volume(q, tangent_depth=depth),
        "surface": lambda: grid.surface(q, tangent_depth=depth),
    }.get(kind, lambda: grid.face(kind, q, tangent_depth=depth))
    work: dict[str, Callable[[], Any]] = {"cells": lambda: grid.status, "rules": made}
    rule: Quadrature = staged(work, progress)[1]
    return rule.in_space() if grid.through is not None else rule


def check_resolved(cut: CutGrid, what: str) -> None:
    """Warn of a solid, with a name for messages, that the cells do not resolve, or refuse it."""
    if not cut.error < np.inf:
        raise GeometryError(
            f"no solid is found, and the {what} is not resolved: take finer cells, or state it by "
            "il.fields or il.sdf, which are split at kinks"
        )
    if cut.error > TOLD:
        opaque = cut.sets.opaque
        remedy = "state it by il.fields or il.sdf, which are split at kinks" * opaque
        warnings.warn(
            f"the volume of the {what} is known to {100 * cut.error:.2g} % only: it is not "
            f"resolved by {' x '.join(map(str, cut.grid.shape))} cells; take finer cells"
            f"{', or ' * opaque}{remedy}",
            PrecisionWarning,
            stacklevel=3,
        )
    if cut.pieces.local > LOCALLY and cut.error <= CRUDE:
        box = cut.grid.boxes(np.array([cut.pieces.place]))
        middle = box[:, :3] + 0.5 * box[:, 3:]
        x = middle if cut.through is None else cut.through.x(middle)
        place = ", ".join(f"{c:.4g}" for c in np.round(x[0], 12) + 0.0)
        warnings.warn(
            f"near ({place}) the volume of a small part of the {what}, or of a void in it, is "
            f"known to {100 * min(cut.pieces.local, 1.0):.2g} % of its own only; take finer cells",
            PrecisionWarning,
            stacklevel=3,
        )


def _as_box(domain: Any) -> FloatArray:
    box = as_array("domain", domain)
    if box.shape != (2, 3) or not (box[0] < box[1]).all():
        raise InputError(
            f"domain must be a lower and an upper corner, shape (2, 3), got {domain!r:.80}"
        )
    return box


def _as_grid(cells: Any, sets: LevelSets, through: SplineMap | None) -> Grid:
    lo, hi = sets.domain
    whole = through is not None and np.allclose(through.domain, sets.domain)
    closed = through.wraps if through is not None and whole else (False, False, False)
    if cells is not None:
        counts: Sequence[int] = as_counts("cells", cells)
        need(
            PER_PIECE * math.prod(map(float, counts)),
            f"a grid of {' x '.join(map(str, counts))} cells",
            "use fewer cells per direction",
        )
        x, y, z = (np.linspace(lo[a], hi[a], counts[a] + 1) for a in range(3))
        return Grid((x, y, z), closed)
    if not sets.exact:
        with_breaks = [f for f in sets.fields if owns(f, "breaks")]
        if not with_breaks:
            raise InputError("cells is needed: only splines have elements of their own")
        x, y, z = (with_breaks[0].breaks(a) for a in range(3))
        return Grid((x, y, z), closed)
    x, y, z = sets.pieces(tuple(np.array([lo[a], hi[a]]) for a in range(3))).axes
    return Grid((x, y, z), closed)
