"""The lattice: tiles in the parameter domain of a map, and what can be done with them.

Guarantees: the map has been certified not to fold (a warning names isolated points with
det J = 0); everything expensive (seeds, k-d tree, distance spline) is computed once and kept.
Non-guarantees: neighbouring tiles fit together only as smoothly as the tile is periodic; a
mixture is one C2 spline for the entire lattice, which deviates from its tiles by up to its `tol`.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from ilattice._typing import ArrayLike
from ilattice._validate import as_choice, as_not_negative, as_whole
from ilattice.errors import InputError
from ilattice.lattice.wall import Wall, described, offset, parametric_offset
from ilattice.macroshape.primitives import box
from ilattice.mesh.mid_surface import mid_surface_contour
from ilattice.offsets.mid_surface import MidSurface
from ilattice.plot.cards import card
from ilattice.plot.quick import show
from ilattice.tiles.struts import as_graph, box_around, struts
from ilattice.topology.sweep import TopologySweep, topology_sweep

SPACES = ("euclidean", "parametric")
#: Options of offsets in space only.
IN_SPACE = {"points", "values", "tol", "relative_density", "least_wall", "least_gap"}


@dataclass(frozen=True, eq=False)
class Lattice(MidSurface):
    """Tiles repeated through a map.

    Parameters
    ----------
    tile : Tile or Mixture
        The unit cell; a name of the catalogue or a callable is accepted. For different tiles
        in one lattice see `ilattice.tiles.mix` and `ilattice.tiles.hybrid`.
    through : SplineMap
        Macro-shape: the map from the parameter box to space.
    repeat : int or sequence of 3 int
        Number of tiles along u, v and w.
    boundary : {"extend", "clip"}
        What distances near the ends of the domain refer to: the mid-surface continued by one
        layer of tiles, so that a wall runs into the end face at full thickness, or only its
        part inside the domain, even where that is one point, as in two corners of gyroids, around
        which walls are parts of balls. Closed directions always wrap. Along directions in which
        tiles do not fit together (see `fits`) there is nothing to go on with, and "extend" is like
        "clip".
    spans_per_tile : int, optional
        Spans of the fitted distance spline per tile and direction; by default 16, and 12 per
        period of the finest wave of a trigonometric tile.

    Raises
    ------
    InputError
        If an argument is of the wrong kind.
    GeometryError
        If the map folds.

    Examples
    --------
    >>> import ilattice as il
    >>> lattice = il.Lattice("gyroid", through=il.macroshape.box((2, 1, 1)), repeat=(2, 1, 1))
    >>> lattice.repeat
    (2, 1, 1)
    """

    @classmethod
    def from_struts(
        cls, nodes: ArrayLike, edges: ArrayLike, radii: ArrayLike, *, blend: float = 0.0
    ) -> Lattice:
        """One tile that holds a graph of round struts anywhere in space, in a box around it.

        Parameters
        ----------
        nodes, edges, radii, blend : array_like and float
            As in `ilattice.tiles.struts`, but `nodes` are points of space, in units of length.

        Returns
        -------
        Lattice
            Its ``offset((np.inf, 0))`` is the struts, to be meshed, sliced and analysed.

        Raises
        ------
        InputError
            As in `ilattice.tiles.struts`.

        Examples
        --------
        >>> import numpy as np, ilattice as il
        >>> graph = il.Lattice.from_struts([(5, 0, 0), (9, 0, 0), (9, 3, 0)], [(0, 1), (1, 2)], 0.4)
        >>> graph.offset((np.inf, 0)).mesh().genus
        0
        """
        points, ends, r = as_graph(nodes, edges, radii)
        low, high = box_around(points, ends, r, as_not_negative("blend", blend))
        tile = struts(points - low, ends, r, blend=blend, faces="open", cell=high - low)
        return cls(tile, through=box(lo=low, hi=high))

    def offset(self, d: Any = None, *, space: str = "euclidean", **options: Any) -> Wall:
        """Wall of half-thickness `d` about the mid-surface.

        Parameters
        ----------
        d : float, callable, BSpline, str, or pair of these, optional
            Half-thickness, as in `ilattice.lattice.offset`.
        space : {"euclidean", "parametric"}
            Where `d` is measured: in space, exactly; or in tiles before the map, to first order,
            as in `ilattice.lattice.parametric_offset`.
        **options
            ``points`` and ``values``, ``tol``, ``relative_density``, ``least_wall``, ``least_gap``
            (in space only) and ``progress``, as in `ilattice.lattice.offset`.

        Returns
        -------
        Wall
            The wall.

        Raises
        ------
        InputError
            If `space` is neither of the two, or `d` is unusable.
        """
        as_choice("space", space, SPACES)
        if space == "euclidean":
            return offset(self, d, **options)
        wrong = options.keys() & IN_SPACE
        if wrong:
            raise InputError(f"{sorted(wrong)} are for offsets in space, not for parametric ones")
        return parametric_offset(self, d, **options)

    def _repr_html_(self) -> str:
        return card(self, {**described(self), "boundary": self.boundary}, n=12)

    def plot(self, *, n: int = 20, **options: Any) -> Any:
        """Show the mid-surface in space, without thickness, in a window or a notebook.

        Parameters
        ----------
        n : int
            Samples along each edge of a tile; fewer where there are many tiles.
        **options
            Of `ilattice.plot.show`, such as ``clip``, ``view`` or ``screenshot``.

        Returns
        -------
        object
            What pyvista returns.
        """
        return show(mid_surface_contour(self, as_whole("n", n, 2, 200)), **options)

    def topology_sweep(self, d_values: ArrayLike, **options: Any) -> TopologySweep:
        """Half-thicknesses at which the topology of the wall changes, and where.

        Parameters
        ----------
        d_values : array_like, shape (n,)
            Increasing half-thicknesses. Changes are looked for from the first to the last; the
            contours at all of them are counted, and checked against the changes in between.
        **options
            ``h``, length of the edges of the contours, and ``progress``.

        Returns
        -------
        TopologySweep
            Critical half-thicknesses with places, and counts.

        Raises
        ------
        InputError
            If there are not two increasing positive values, or ``boundary="clip"``.

        Notes
        -----
        Stratified Morse theory of the distance to the mid-surface, see
        `ilattice.topology.critical`.
        """
        return topology_sweep(self, d_values, **options)
