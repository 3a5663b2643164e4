"""Seeds that cover the surface of one tile, closer together where it bends sharply or meets itself.

Guarantees: those of `seeding`; along edges, where normals of splines turn much over a cell, points
of a grid of `EDGES` planes per direction have a seed that faces alike within about a smaller cell;
likewise next to curves in which a surface meets itself.
Non-guarantee: edges sharper than that grid may have normals between those of their seeds.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from ilattice._typing import FloatArray, IntArray
from ilattice.bspline import BSpline
from ilattice.offsets.seeding import bends, crossings, falls, gaps, regular
from ilattice.tiles.trig import TrigField

if TYPE_CHECKING:
    from ilattice.offsets.space import TileSpace

#: Seeds that were added crowd where they are more than this part of the others.
CROWDING = 0.02
#: Planes per direction between which splines are searched for surfaces that seeds have missed, and
#: trigonometric tiles, per seed.
FINE, FINER = 65, 4
#: Normals of splines that turn by more than this over a cell make an edge, and slopes that fall by
#: more than that tell of surfaces that meet: cells are smaller there by these factors. Planes per
#: direction between which both are sought. Trigonometric fields bend evenly, and lead to edges from
#: farther away.
EDGED, EDGES = {4: 4.0, 2: 2.0}, 129


class Covering(NamedTuple):
    """Seeds of one tile.

    Attributes
    ----------
    plain : ndarray, shape (n, 3)
        One in each cell about, and more where they leave gaps.
    sharp : dict
        More along edges and where surfaces meet, (s, 3), for each part of a cell that they stand
        for.
    crowded : bool
        Whether many of them crowd on one sheet.
    """

    plain: FloatArray
    sharp: dict[int, FloatArray]
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
        sharp: dict[int, FloatArray] = {}
        if isinstance(field, TrigField) and fine < EDGES and _meets(field, points, fine):
            points = crossings(field, EDGES)
        turns = _turns(field, points, m)
        if isinstance(field, BSpline) and (turns > min(EDGED.values())).any():
            points = crossings(field, EDGES)
            turns = _turns(field, points, m)
        if (turns > min(EDGED.values())).any():
            for n, least in EDGED.items():
                there = np.concatenate([plain, *sharp.values()])
                new = space._project(gaps(field, points[turns > least], there, n * m), n * m)
                sharp[n] = new[regular(field, new)]
        added = len(more) + sum(len(s) for s in sharp.values())
        return cls(plain, sharp, added > CROWDING * len(p))


def _meets(field: Any, points: FloatArray, planes: int) -> bool:
    """Whether a surface meets itself next to some of its points on the edges of a grid."""
    return bool((falls(field, points, np.full(3, planes - 1)) > 1.0).any())


def _turns(field: Any, points: FloatArray, m: IntArray) -> FloatArray:
    """How much normals (n,) turn, or slopes fall, over a cell next to points of a surface."""
    out = np.zeros(len(points))
    at = np.flatnonzero(regular(field, points))
    near = points[at]
    out[at] = falls(field, near, m)
    if isinstance(field, BSpline):  # trigonometric fields bend evenly
        out[at] = np.maximum(out[at], bends(field, near) / float(m.min()))
    return out
