"""Joining of Kagome structures in neighbouring simplices, by exact keys.

Guarantee: vertices are one if the mesh says so, whatever their coordinates; no tolerance is used.
"""

from dataclasses import replace

import numpy as np

from ilattice._typing import IntArray
from ilattice._validate import as_kind
from ilattice.cost._structure import K
from ilattice.errors import GeometryError, InputError

#: Lengths of edges by which vertices that are one may lie apart.
SAME = 1e-6


def joined(k: K) -> K:
    """One structure of those in the cells of a mesh: vertices that are the same become one.

    A vertex is known by the corners of the mesh that it depends on, with its integers: vertices on
    a face have the same ones in both cells.

    Parameters
    ----------
    k : CornerSharing
        Made by `ilattice.cost.fill`.

    Returns
    -------
    CornerSharing
        Vertices in the order in which they first occur.

    Raises
    ------
    InputError
        If the structure was not made by `fill`.
    GeometryError
        If cells that share a face have different resolutions, or three share one, if a cell is
        there twice, or cells were moved apart.
    """
    o = as_kind("k", k, "CornerSharing").origin
    if o is None:
        raise InputError("joined is for structures made by fill: this one has no origin")
    _check_faces(o.cells, o.resolution)
    corner = o.cells[o.cell]
    used = o.integers > 0
    ids = np.where(used, corner, -1)
    order = np.argsort(ids, axis=1, kind="stable")
    key = np.concatenate(
        [np.take_along_axis(ids, order, 1), np.take_along_axis(o.integers * used, order, 1)], axis=1
    )
    _, first, place = np.unique(key, axis=0, return_index=True, return_inverse=True)
    rank = np.empty(len(first), np.int64)
    rank[np.argsort(first, kind="stable")] = np.arange(len(first))
    name, keep = rank[place.ravel()], np.sort(first)
    off = np.abs(k.positions - k.positions[keep[name]]).max(initial=0.0)
    if off > SAME * float(k.lengths.mean()):
        raise GeometryError(
            f"vertices that are one lie up to {off:.3g} apart: join cells first, and move then"
        )
    origin = replace(o, integers=o.integers[keep], cell=o.cell[keep])
    out = type(k)(k.positions[keep], name[k.simplices], name[k.bars], origin=origin)
    return out.check()


def _check_faces(cells: IntArray, resolution: IntArray) -> None:
    """Refuse neighbours of different resolutions, and faces of three cells."""
    d = cells.shape[1] - 1
    faces = np.concatenate([np.delete(cells, j, axis=1) for j in range(d + 1)])
    owner = np.tile(np.arange(len(cells)), d + 1)
    _, place, count = np.unique(
        np.sort(faces, axis=1), axis=0, return_inverse=True, return_counts=True
    )
    order = np.argsort(place.ravel(), kind="stable")
    first = np.cumsum(count) - count
    if (count > 2).any():
        i = int(np.argmax(count > 2))
        rows = owner[order[first[i] : first[i] + count[i]]].tolist()
        raise GeometryError(f"simplices {rows} share one face: two may")
    pairs = owner[np.stack([order[first[count == 2]], order[first[count == 2] + 1]], axis=1)]
    levels = resolution[pairs]
    bad = levels[:, 0] != levels[:, 1]
    if bad.any():
        i = int(np.argmax(bad))
        a, b = pairs[i].tolist()
        raise GeometryError(
            f"simplices {a} and {b} share a face, but have resolutions {levels[i, 0]} and "
            f"{levels[i, 1]}: give both the same one"
        )


def boundary_faces(cells: IntArray) -> tuple[IntArray, IntArray]:
    """Cells (f,) and the corners (f,) opposite to their faces that no other cell has."""
    d = cells.shape[1] - 1
    faces = np.concatenate([np.delete(cells, j, axis=1) for j in range(d + 1)])
    _, place, count = np.unique(
        np.sort(faces, axis=1), axis=0, return_inverse=True, return_counts=True
    )
    alone = np.flatnonzero(count[place.ravel()] == 1)
    return alone % len(cells), alone // len(cells)
