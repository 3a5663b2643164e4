"""Parts of a solid that hang together through the faces of cells, and those that nothing holds.

A piece that touches the rest along an edge only, or not at all, is a mechanism: it breaks every
solver, and counting shared nodes does not find it. Cells belong together here if the solid passes
through the face between them.

Guarantees: found before a system is made; a face counts by the area that is wet, not by the cells
having it in common, relative to the smaller of the two pieces of solid, so that small cells count
like large ones. Non-guarantee: where one cell holds two separate pieces they are not told apart:
they share functions, so they hold each other.
"""

from dataclasses import dataclass

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from ilattice._typing import FloatArray, IntArray
from ilattice._validate import read_only
from ilattice.cutfem.rules import Quadrature

#: Least wet area of a face, in units of the two thirds power of the smaller volume beside it.
LEAST_NECK = 1e-6


@dataclass(frozen=True, eq=False)
class Parts:
    """Connected parts of a solid on a grid.

    Attributes
    ----------
    cells : ndarray, shape (cells,)
        Cells that hold solid, increasing.
    labels : ndarray, shape (cells,)
        Part of each of them; the largest part is number 0.
    volumes : ndarray, shape (parts,)
        Volumes in space, decreasing.
    centroids : ndarray, shape (parts, 3)
        Centroids in space.
    """

    cells: IntArray
    labels: IntArray
    volumes: FloatArray
    centroids: FloatArray

    def __len__(self) -> int:
        return len(self.volumes)

    def touching(self, cells: IntArray) -> IntArray:
        """Numbers of the parts that have one or more of some cells.

        Parameters
        ----------
        cells : ndarray
            Numbers of cells of the grid.

        Returns
        -------
        ndarray
            Parts, increasing.
        """
        return np.unique(self.labels[np.isin(self.cells, cells)])

    def describe(self, parts: IntArray, most: int = 3) -> str:
        """Number, volumes and places of some parts, in words.

        Parameters
        ----------
        parts : ndarray
            Numbers of parts.
        most : int
            How many are told one by one.

        Returns
        -------
        str
            Such as ``"2 parts: volume 0.1 at (0, 0, 1); ..."``.
        """
        told = [
            f"volume {self.volumes[i]:.4g} at ({', '.join(f'{c:.4g}' for c in self.centroids[i])})"
            for i in parts[:most]
        ]
        rest = [f"and {len(parts) - most} more, volume {self.volumes[parts[most:]].sum():.4g}"]
        noun = "part" if len(parts) == 1 else "parts"
        return f"{len(parts)} {noun}: " + "; ".join(told + (rest if len(parts) > most else []))


def connected_parts(
    solid: Quadrature, faces: tuple[Quadrature, ...], there: Quadrature | None = None
) -> Parts:
    """Parts of a solid, by the wet faces between its cells.

    Parameters
    ----------
    solid : Quadrature
        Volume rule in parameters.
    faces : tuple of Quadrature
        Rules on the faces between cells, `CutGrid.faces`, of the three directions.
    there : Quadrature, optional
        The volume rule in space, if it is known.

    Returns
    -------
    Parts
        Cells with their parts; volumes and centroids.
    """
    cells, n = solid.cells, len(solid.cells)
    box = solid.grid.boxes(cells)
    full = box[:, 3:].prod(axis=1)
    bulk = (np.maximum(solid.integrate_cells(), 0.0) / full) ** (2 / 3)
    rows, columns = [], []
    for axis, rule in enumerate(faces):
        assert rule.neighbours is not None
        keep = np.isin(rule.cells, cells) & np.isin(rule.neighbours, cells)
        low, high = (np.searchsorted(cells, c[keep]) for c in (rule.cells, rule.neighbours))
        others = [3 + a for a in range(3) if a != axis]
        wet = rule.integrate_cells()[keep] / box[low][:, others].prod(axis=1)
        joined = wet > LEAST_NECK * np.minimum(bulk[low], bulk[high])
        rows.append(low[joined])
        columns.append(high[joined])
    i, j = np.concatenate(rows), np.concatenate(columns)
    count, labels = connected_components(coo_array((np.ones(len(i)), (i, j)), shape=(n, n)), False)
    if there is None:
        there = solid if solid.through is None else solid.in_space()
    owner = labels[solid.owners]
    volumes = np.bincount(owner, there.weights, count)
    moments = [np.bincount(owner, there.weights * there.points[:, a], count) for a in range(3)]
    order = np.argsort(-volumes, kind="stable")
    rank = np.empty(count, np.int64)
    rank[order] = np.arange(count)
    return Parts(
        cells,
        read_only(rank[labels]),
        read_only(volumes[order]),
        read_only((np.stack(moments, axis=1) / volumes[:, None])[order]),
    )
