"""Parts of a solid that hang together through the faces of cells, and those that nothing holds.

A piece that touches the rest along an edge only, or not at all, is a mechanism: it breaks every
solver, and counting shared nodes does not find it. Cells belong together here if the solid passes
through the face between them.

Guarantees: found before a system is made; a face counts by the area that is solid, not by the cells
having it in common, relative to the smaller of the two pieces of solid, so that small cells count
like large ones. Pieces of solid in one cell are apart as far as rules tell them apart by elements
(see `elements`).
"""

from dataclasses import dataclass

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from ilattice._geometry import cells_at, wrapped
from ilattice._typing import FloatArray, IntArray
from ilattice._validate import Frozen, read_only
from ilattice.quadrature.grid import DividedGrid
from ilattice.quadrature.rules import Quadrature, kept, on_cells

#: Least solid area of a face, in units of the two thirds power of the smaller volume beside it.
MIN_NECK = 1e-6
#: Part of its cells below which the volume of a part is what rounding leaves.
DUST = 1e-14


@dataclass(frozen=True, eq=False)
class Parts(Frozen):
    """Connected parts of a solid on a grid.

    Attributes
    ----------
    solid : Quadrature
        Volume rule in parameters.
    labels : ndarray, shape (cells,)
        Part of each of its cells; number 0 is the largest part in parameters.
    """

    solid: Quadrature
    labels: IntArray

    @property
    def cells(self) -> IntArray:
        """Cells that hold solid, increasing."""
        return self.solid.cells

    def __len__(self) -> int:
        return int(self.labels.max()) + 1

    def measure(self, part: int) -> tuple[float, FloatArray]:
        """Volume and centroid in space.

        Parameters
        ----------
        part : int
            Number of the part.

        Returns
        -------
        tuple of float and ndarray, shape (3,)
            Volume and centroid.
        """
        rule = on_cells(self.solid, self.cells[self.labels == part])
        there = rule if rule.through is None else rule.in_space()
        volume = there.integrate()
        return volume, there.integrate(there.points) / volume

    def seen(self, parts: IntArray) -> IntArray:
        """Those of some parts that are more than what rounding leaves.

        Parameters
        ----------
        parts : ndarray
            Numbers of parts.

        Returns
        -------
        ndarray
            Some of them, in the same order.
        """
        boxes = self.solid.grid.boxes(self.cells)[:, 3:].prod(axis=1)
        volumes, cells = (
            np.bincount(self.labels, w, len(self)) for w in (self.solid.integrate_cells(), boxes)
        )
        return parts[volumes[parts] > DUST * cells[parts]]

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

    def joined(self, faces: Quadrature) -> Quadrature:
        """Faces through which a part hangs together.

        Parameters
        ----------
        faces : Quadrature
            Rule on faces between its cells.

        Returns
        -------
        Quadrature
            Those of which both sides are of one part.
        """
        part = np.full(max(int(self.cells[-1]), *_highest(faces)) + 1, -1)
        part[self.cells] = self.labels
        assert faces.neighbours is not None
        low = part[faces.cells]
        return kept(faces, (low >= 0) & (low == part[faces.neighbours]))

    def at(self, u: FloatArray) -> IntArray:
        """Parts in whose cells, or pieces of cells, points are.

        Parameters
        ----------
        u : ndarray, shape (n, 3)
            Parameters.

        Returns
        -------
        ndarray, shape (n,)
            Their numbers; -1 in cells without solid, and outside of the grid.
        """
        grid = self.solid.grid
        lo, hi = grid.domain
        p = wrapped(u, lo, hi, grid.closed)
        inside = ((p >= lo) & (p <= hi)).all(axis=1)
        at = tuple(cells_at(grid.axes, p).T)
        element = np.asarray(np.ravel_multi_index(at, grid.shape), np.int64)
        if isinstance(grid, DividedGrid):
            element = grid.element_at(u, element)
        row = np.minimum(np.searchsorted(self.cells, element), len(self.cells) - 1)
        return np.where(inside & (self.cells[row] == element), self.labels[row], -1)

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
        told = []
        for part in parts[:most]:
            volume, centroid = self.measure(int(part))
            told.append(f"volume {volume:.4g} at ({', '.join(f'{c:.4g}' for c in centroid)})")
        if len(parts) > most:
            told.append(f"and {len(parts) - most} more")
        return f"{len(parts)} {'part' if len(parts) == 1 else 'parts'}: " + "; ".join(told)


def _highest(faces: Quadrature) -> tuple[int, int]:
    """Largest numbers on both sides of faces, 0 without any."""
    assert faces.neighbours is not None
    return int(faces.cells.max(initial=0)), int(faces.neighbours.max(initial=0))


def links(joined: tuple[Quadrature, ...]) -> tuple[IntArray, IntArray]:
    """Cells, or elements, on the lower and on the upper sides of faces."""
    high = [rule.neighbours for rule in joined if rule.neighbours is not None]
    return np.concatenate([rule.cells for rule in joined]), np.concatenate(high)


def falls_apart(
    parts: Parts, pairs: tuple[IntArray, IntArray], home: IntArray, thin: IntArray
) -> bool:
    """Whether a part would be two of a cell or more without what it has in some cells.

    Parameters
    ----------
    parts : Parts
        Of a solid, by elements.
    pairs : tuple of ndarray
        Elements that hang together, see `links`.
    home : ndarray
        Cell of each of those that have solid.
    thin : ndarray
        The cells.

    Returns
    -------
    bool
        That it would.
    """
    rest = ~np.isin(home, thin)
    i, j = (np.searchsorted(parts.cells, side) for side in pairs)
    keep = rest[i] & rest[j]
    n = len(home)
    graph = coo_array((np.ones(keep.sum()), (i[keep], j[keep])), shape=(n, n))
    count, labels = connected_components(graph, False)
    volumes = parts.solid.integrate_cells() / parts.solid.grid.boxes(parts.cells)[:, 3:].prod(1)
    large = np.bincount(labels, np.where(rest, volumes, 0.0), count) >= 1.0
    first = np.unique(labels, return_index=True)[1]
    return bool((np.bincount(parts.labels[first][large]) > 1).any())


def connected_parts(
    solid: Quadrature, faces: tuple[Quadrature, ...], seam: Quadrature | None = None
) -> Parts:
    """Parts of a solid, by the interior facets between its cells.

    Parameters
    ----------
    solid : Quadrature
        Volume rule in parameters.
    faces : tuple of Quadrature
        Rules on the faces between cells, `CutGrid.faces`, of the three directions.
    seam : Quadrature, optional
        Rule, in parameters, on the surface between phases, by pairs of elements.

    Returns
    -------
    Parts
        Cells with their parts.
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
        area = rule.integrate_cells()[keep] / box[low][:, others].prod(axis=1)
        joined = area > MIN_NECK * np.minimum(bulk[low], bulk[high])
        rows.append(low[joined])
        columns.append(high[joined])
    if seam is not None:
        assert seam.neighbours is not None
        low, high = (np.searchsorted(cells, c) for c in (seam.cells, seam.neighbours))
        area = seam.integrate_cells() / full[low] ** (2 / 3)
        joined = area > MIN_NECK * np.minimum(bulk[low], bulk[high])
        rows.append(low[joined])
        columns.append(high[joined])
    i, j = np.concatenate(rows), np.concatenate(columns)
    count, labels = connected_components(coo_array((np.ones(len(i)), (i, j)), shape=(n, n)), False)
    sizes = np.bincount(labels, bulk**1.5 * full, count)
    rank = np.empty(count, np.int64)
    rank[np.argsort(-sizes, kind="stable")] = np.arange(count)
    return Parts(solid, read_only(rank[labels]))
