"""Closed surfaces much smaller than a cell of the grid, left out.

Where a pore closes or a web parts within a cell, the contour of a spline may have a closed surface
of a few triangles that the exact offset has not, or has smaller: its vertices, moved one by one,
may leave it inside out, a chip of material within a pore that is none.

Guarantee: what is left out has less than `SPECK` of the volume of the cell it is in, and never
all there is. Non-guarantee: chips and pores of more than that are left, however few their faces.
"""

from collections.abc import Callable

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from ilattice._typing import FloatArray, IntArray
from ilattice.mesh.repair import Repair

#: Part of the volume of a cell below which a closed surface is left out; most faces of such.
SPECK, FEW = 2e-2, 24


def without_specks(x: FloatArray, repair: Repair, cell: Callable[[IntArray], FloatArray]) -> Repair:
    """A repaired closed surface without specks.

    Parameters
    ----------
    x : ndarray, shape (V, 3)
        Vertices before repair.
    repair : Repair
        Faces, and which vertices are left.
    cell : callable
        Volumes of the cells that vertices, given by their numbers, are in.

    Returns
    -------
    Repair
        Without the vertices and faces of specks.
    """
    faces, n = repair.faces, len(repair.vertices)
    if len(faces) == 0:
        return repair
    a, b = faces[:, :2].T, faces[:, 1:].T
    links = np.concatenate([a, b], axis=1)
    graph = coo_array((np.ones(links.shape[1], bool), (links[0], links[1])), shape=(n, n))
    count, label = connected_components(graph, directed=False)
    if count == 1:
        return repair
    of = label[faces[:, 0]]
    number = np.bincount(of, minlength=count)
    few = (number > 0) & (number <= FEW)
    rows = np.flatnonzero(few[of])
    if len(rows) == 0:
        return repair
    p = x[repair.vertices[faces[rows]]]
    p = p - p[:, :1].mean(axis=0)
    six = np.einsum("ij,ij->i", p[:, 0], np.cross(p[:, 1], p[:, 2]))
    volume = np.bincount(of[rows], six, count) / 6.0
    whole = np.zeros(count)
    whole[of[rows]] = cell(repair.vertices[faces[rows, 0]])  # of one of its faces
    speck = few & (np.abs(volume) < SPECK * whole)
    speck[np.argmax(number)] = False
    if not speck.any():
        return repair
    stay, kept = ~speck[of], ~speck[label]
    new = np.cumsum(kept) - 1
    return repair._replace(
        vertices=repair.vertices[kept], faces=new[faces[stay]].astype(faces.dtype),
        rows=repair.rows[stay],
    )  # fmt: skip
