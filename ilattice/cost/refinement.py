"""Refinement of simplices by the rules R0 and R1, and by Kagome structures.

R0 puts a vertex on the middle of every edge of a simplex and keeps its d + 1 corners; since
simplices share no edges, any subset can be refined. R0 keeps minimal rigidity: the refined simplex
is isostatic and has the same pins. R1, in the plane, puts vertices on the edges around a void and
joins them to a ring; what is left of the triangles around it are bars.

Guarantees: both rules keep positions, bars and the deficit; R0 multiplies the area by 3/4 in the
plane, the volume by 1/2 in space, where all is refined.
"""

from dataclasses import replace
from typing import Any

import numpy as np

from ilattice._typing import IntArray
from ilattice._validate import as_array, as_rows
from ilattice.cost._refining import area, facets, refined, voids
from ilattice.cost.kagome import kagome
from ilattice.cost.structure import CornerSharing
from ilattice.errors import InputError

__all__ = ["area", "coarsest", "facets", "forgotten", "refined", "substituted", "voids"]


def substituted(k: CornerSharing, rows: Any, resolution: int, *, seed: int = 0) -> CornerSharing:
    """Stiffened Kagome structures in place of some tetrahedra.

    The four corners of valence 3 of each take the places of those of the tetrahedron, which is what
    keeps minimal rigidity.

    Parameters
    ----------
    k : CornerSharing
        The structure, in space.
    rows : array_like of int
        Tetrahedra.
    resolution : int
        Of the Kagome structures.
    seed : int
        Of the perturbation where bars are chosen.

    Returns
    -------
    CornerSharing
        The structure; its bars are those of this one, then those that stiffen.
    """
    if k.dim != 3:
        raise InputError("substituted is for tetrahedra")
    where = np.unique(as_rows("rows", rows, len(k.simplices)))
    unit = kagome(resolution).stiffened(seed=seed)
    assert unit.origin is not None
    ints = unit.origin.integers
    pins = np.array([int(np.argmax(ints[:, j])) for j in range(4)])
    inner = np.setdiff1d(np.arange(len(ints)), pins)
    weights = _to_corners(ints / ints[0].sum(), pins)
    x, s, bars, n = (
        [k.positions],
        [np.delete(k.simplices, where, axis=0)],
        [k.bars],
        len(k.positions),
    )
    for i in where:
        name = np.empty(len(ints), np.int64)
        name[pins], name[inner] = k.simplices[i], n + np.arange(len(inner))
        x.append(weights[inner] @ k.positions[k.simplices[i]])
        s.append(name[unit.simplices])
        bars.append(name[unit.bars])
        n += len(inner)
    return CornerSharing(np.concatenate(x), np.concatenate(s), np.concatenate(bars))


def _to_corners(bary: Any, pins: IntArray) -> Any:
    """Barycentric coordinates with respect to the tetrahedron of four of the points."""
    return np.linalg.solve(bary[pins].T, as_array("bary", bary).T).T


def coarsest(k: CornerSharing) -> CornerSharing:
    """The structure that one was refined from, by all its levels.

    Parameters
    ----------
    k : CornerSharing
        The structure.

    Returns
    -------
    CornerSharing
        Itself if it was not refined.
    """
    while k.coarse is not None:
        k = k.coarse.structure
    return k


def forgotten(k: CornerSharing) -> CornerSharing:
    """The structure without memory of what it was refined from.

    Parameters
    ----------
    k : CornerSharing
        The structure.

    Returns
    -------
    CornerSharing
        Same arrays.
    """
    return replace(k, coarse=None)
