"""`CornerSharing`: simplices that share corners, with all that can be done with them.

Guarantees: immutable; edges follow from simplices and bars, in a fixed order; `check` proves the
combinatorial conditions of a corner-sharing structure. Not guaranteed: that simplices do not
overlap in space, which `is_embedded` decides; that the structure is rigid, which `rank` tells.
"""

from dataclasses import dataclass
from functools import cached_property
from typing import Any

from ilattice._typing import ArrayLike
from ilattice.cost._refining import refined
from ilattice.cost._structure import Structure
from ilattice.cost.beams import Beams, beams
from ilattice.cost.drawing import plot
from ilattice.cost.embedding import overlaps
from ilattice.cost.joining import joined
from ilattice.cost.mapping import mapped
from ilattice.cost.pipes import Pipes, pipes
from ilattice.cost.rigidity import Rigidity, analysed
from ilattice.cost.stiffening import stiffened
from ilattice.cost.stress import Stress, stress


@dataclass(frozen=True, eq=False, repr=False)
class CornerSharing(Structure):
    """Triangles in the plane, or tetrahedra in space, that share corners, and further bars.

    Made by `ilattice.cost.kagome`, `fill`, `midpoint` and `stacked`, or from arrays. Source: paper
    "Corner-Sharing Tetrahedra for Modeling Micro-structure" (Sitharam et al.), Definitions 1 to 4.

    Attributes
    ----------
    positions : ndarray, shape (n, d)
        Vertices, d = 2 or 3.
    simplices : ndarray of int, shape (m, d + 1)
        Corners of the defining simplices. No vertex has more than two.
    bars : ndarray of int, shape (k, 2)
        Bars that stiffen the structure.
    origin : Origin or None
        Where a Kagome structure comes from, as long as its vertices are those it began with.
    coarse : Coarse or None
        What this one is the refinement of, as long as positions are those it was given.
    """

    def mapped(self, through: Any) -> "CornerSharing":
        """Vertices moved through a map; edges stay straight. See `ilattice.cost.mapping`.

        Parameters
        ----------
        through : SplineMap, BernsteinSimplex or callable
            What takes positions (n, d) to new ones; those of a `SplineMap` are its parameters.

        Returns
        -------
        CornerSharing
            The structure.

        Raises
        ------
        InputError
            If positions are outside of the domain of the map.
        GeometryError
            If simplices are inverted; the message counts them and names the first.
        """
        return mapped(self, through)

    def joined(self) -> "CornerSharing":
        """See `ilattice.cost.joining.joined`.

        Returns
        -------
        CornerSharing
            Vertices that several cells have are one.
        """
        return joined(self)

    def stiffened(self, mode: str = "matroid", **options: Any) -> "CornerSharing":
        """Bars that make the structure minimally rigid; see `ilattice.cost.stiffening.stiffened`.

        Parameters
        ----------
        mode : {"matroid", "pattern", "cycle"}
            How bars are chosen.
        **options
            See there.

        Returns
        -------
        CornerSharing
            The structure with bars.
        """
        return stiffened(self, mode, **options)

    def refined(self, rule: str = "R0", *, where: Any = None) -> "CornerSharing":
        """Finer simplices; see `ilattice.cost.refinement.refined`.

        Parameters
        ----------
        rule : {"R0", "R1"}
            Rule of refinement.
        where : callable or array_like of bool, optional
            Which simplices; default all.

        Returns
        -------
        CornerSharing
            The structure.
        """
        return refined(self, rule, where=where)

    def rigidity(self, *, generic: bool = False, **options: Any) -> Rigidity:
        """Rank of the rigidity matrix and what follows; see `ilattice.cost.rigidity.analysed`.

        Parameters
        ----------
        generic : bool
            At a random realization near this one.
        **options
            See there.

        Returns
        -------
        Rigidity
            Rank with tolerance and gap.
        """
        return analysed(self, generic=generic, **options)

    @cached_property
    def rank(self) -> int:
        """Rank of the rigidity matrix at these positions; see `rigidity` for the tolerance."""
        return self.rigidity().rank

    def is_rigid(self, *, generic: bool = False) -> bool:
        """Whether the structure has no infinitesimal motions but rigid ones.

        Parameters
        ----------
        generic : bool
            At a random realization near this one.

        Returns
        -------
        bool
            By the numerical rank, never by counts alone.
        """
        return self.rigidity(generic=generic).rigid

    def stress(self, loads: ArrayLike, **options: Any) -> "Stress[CornerSharing]":
        """Forces in the edges under loads; see `ilattice.cost.stress.stress`.

        Parameters
        ----------
        loads : array_like, shape (n, d)
            Forces on the vertices.
        **options
            See there.

        Returns
        -------
        Stress
            Forces and the residual.
        """
        return stress(self, loads, **options)

    def beams(self, radius: Any, **options: Any) -> Beams:
        """Edges as round cones: a solid; see `ilattice.cost.beams.beams`.

        Parameters
        ----------
        radius : float, array_like or callable
            One, one per vertex or per edge, or a function of position.
        **options
            See there.

        Returns
        -------
        Beams
            The solid, a field.
        """
        return beams(self, radius, **options)

    def pipes(self, radius: Any) -> Pipes:
        """Edges as smooth pipes of Bezier patches; see `ilattice.cost.pipes.pipes`.

        Parameters
        ----------
        radius : float, array_like or callable
            As of `beams`.

        Returns
        -------
        Pipes
            The surface.
        """
        return pipes(self, radius)

    def plot(self, **options: Any) -> Any:
        """Edges as tubes; see `ilattice.cost.drawing.plot`.

        Parameters
        ----------
        **options
            See there.

        Returns
        -------
        object
            What pyvista returns, None for a file.
        """
        return plot(self, **options)

    def is_embedded(self) -> bool:
        """Whether no two simplices overlap; see `ilattice.cost.embedding.overlaps`.

        Returns
        -------
        bool
            True if none do, by separating axes.
        """
        return len(overlaps(self)) == 0
