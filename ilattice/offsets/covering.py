"""Seeds that cover the surface of one tile, closer together where it bends sharply.

Guarantees: those of `seeding`; along edges, where normals turn by more than `EDGED` over a cell,
points of a grid of `EDGES` planes per direction have a seed that faces alike within about a cell of
a `REFINED` th of the size. Non-guarantee: edges rounder than a space of that grid may have normals
between those of their seeds.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from ilattice._typing import FloatArray, IntArray
from ilattice.offsets.seeding import bends, crossings, gaps, regular
from ilattice.tiles.trig import TrigField

if TYPE_CHECKING:
    from ilattice.offsets.space import TileSpace

#: Seeds that were missed crowd where they are more than this part of the others.
CROWDING = 0.02
#: Planes per direction between which splines are searched for surfaces that seeds have missed, and
#: trigonometric tiles, per seed.
FINE, FINER = 65, 4
#: Normals that turn by more than this over a cell make an edge; there, cells are parts of that
#: size, and planes per direction between which edges are searched.
EDGED, REFINED, EDGES = 4.0, 4, 129


class Covering(NamedTuple):
    """Seeds of one tile.

    Attributes
    ----------
    plain : ndarray, shape (n, 3)
        One in each cell about, and more where they leave gaps.
    sharp : ndarray, shape (s, 3)
        More along edges.
    crowded : bool
        Whether many of them crowd on one sheet.
    """

    plain: FloatArray
    sharp: FloatArray
    crowded: bool

    @classmethod
    def of(cls, space: TileSpace, p: FloatArray, m: IntArray) -> Covering:
        """Seeds, and more where they leave gaps.

        Fields that level off, as those of skeletons, lead back to the surface from next to it only;
        where surfaces meet, Newton's method leads to where they do, and that has no normal.

        Parameters
        ----------
        space : TileSpace
            Gives the tile.
        p : ndarray, shape (n, 3)
            Points of its surface, from the centres of cells.
        m : ndarray of int, shape (3,)
            Cells per direction.

        Returns
        -------
        Covering
            The seeds.
        """
        field = space.lattice.smooth_tile
        p = p[regular(field, p)]
        fine = FINER * int(m.min()) + 1 if isinstance(field, TrigField) else FINE
        points = crossings(field, fine)
        more = space._project(gaps(field, points, p, m), m)
        more = more[regular(field, more)]
        plain = np.concatenate([p, more])
        sharp = np.empty((0, 3))
        if (_turns(space, points, m) > EDGED).any():
            points = crossings(field, EDGES)
            points = points[_turns(space, points, m) > EDGED]
            sharp = space._project(gaps(field, points, plain, REFINED * m), REFINED * m)
            sharp = sharp[regular(field, sharp)]
        return cls(plain, sharp, len(more) > CROWDING * len(p))


def _turns(space: TileSpace, points: FloatArray, m: IntArray) -> FloatArray:
    """How much normals (n,) turn over a cell next to points of a surface."""
    field = space.lattice.smooth_tile
    out = np.zeros(len(points))
    at = np.flatnonzero(regular(field, points))
    out[at] = bends(field, points[at]) / float(m.min())
    return out
