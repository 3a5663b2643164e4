"""Background grids: tensor grids of boxes, of which some cells may have several elements.

Guarantee: numbers of cells are those of their indices, the last direction running fastest.
"""

from dataclasses import dataclass, field

import numpy as np

from ilattice._typing import FloatArray, IntArray
from ilattice._validate import Frozen, as_array, as_flag, as_items, as_numbers, read_only
from ilattice.errors import InputError

#: What a cell is.
IN, CUT, OUT = -1, 0, 1


@dataclass(frozen=True, eq=False, repr=False)
class Grid(Frozen):
    """Tensor grid of boxes.

    Attributes
    ----------
    axes : tuple of ndarray, shape (n_i + 1,)
        Planes in the three directions, increasing.
    closed : tuple of bool
        Directions in which the first and the last plane are the same place.
    """

    axes: tuple[FloatArray, FloatArray, FloatArray]
    closed: tuple[bool, bool, bool] = (False, False, False)

    def __post_init__(self) -> None:
        if len(as_items("axes", self.axes)) != 3:
            raise InputError(f"axes must hold three arrays, got {len(self.axes)}")
        closed = [as_flag("closed", c) for c in as_items("closed", self.closed)]
        if len(closed) != 3:
            raise InputError(f"closed must hold three flags, got {self.closed!r:.80}")
        planes = []
        for i, a in enumerate(self.axes):
            x = as_array(f"axes[{i}]", a, ndim=1)
            if len(x) < 2 or not (np.diff(x) > 0).all():
                raise InputError(f"axes[{i}] must hold two or more increasing numbers")
            planes.append(read_only(x.copy()))
        object.__setattr__(self, "axes", tuple(planes))

    def __repr__(self) -> str:
        closed = f", closed={self.closed}" if any(self.closed) else ""
        return f"Grid({' x '.join(map(str, self.shape))} cells{closed})"

    @property
    def shape(self) -> tuple[int, int, int]:
        """Number of cells per direction."""
        a, b, c = (len(x) - 1 for x in self.axes)
        return a, b, c

    @property
    def count(self) -> int:
        """Number of cells."""
        return int(np.prod(self.shape))

    @property
    def domain(self) -> FloatArray:
        """Lower and upper corner, shape (2, 3)."""
        return np.array([[x[0] for x in self.axes], [x[-1] for x in self.axes]])

    def home(self, elements: IntArray) -> IntArray:
        """Cells of elements: the same numbers, where every cell is one element.

        Parameters
        ----------
        elements : ndarray, shape (n,)
            Their numbers.

        Returns
        -------
        ndarray, shape (n,)
            Numbers of cells.
        """
        return as_numbers("elements", elements, self.count)

    def cell_indices(self, cells: IntArray) -> IntArray:
        """Index of cells per direction.

        Parameters
        ----------
        cells : ndarray, shape (n,)
            Numbers of cells, or of elements.

        Returns
        -------
        ndarray, shape (n, 3)
            Indices.
        """
        return np.stack(np.unravel_index(self.home(cells), self.shape), axis=1)

    def boxes(self, cells: IntArray) -> FloatArray:
        """Lower corner and extent of cells.

        Parameters
        ----------
        cells : ndarray, shape (n,)
            Numbers of cells, the last direction running fastest, or of elements.

        Returns
        -------
        ndarray, shape (n, 6)
            Lower corners, then extents.
        """
        ijk = self.cell_indices(cells)
        out = np.empty((len(ijk), 6))
        for a, i in enumerate(ijk.T):
            out[:, a] = self.axes[a][i]
            out[:, 3 + a] = self.axes[a][i + 1] - self.axes[a][i]
        return out


@dataclass(frozen=True, eq=False, repr=False)
class DividedGrid(Grid):
    """A grid of which some cells have several elements, numbered beyond the cells.

    Attributes
    ----------
    parents : ndarray, shape (e,)
        Cells of the elements beyond the cells.
    """

    parents: IntArray = field(kw_only=True)

    @property
    def several(self) -> IntArray:
        """Cells with more than one element, increasing, where it is known which one is where."""
        return np.zeros(0, np.int64)

    def element_at(self, u: FloatArray, cells: IntArray) -> IntArray:
        """Elements in which, or nearest to which, points are.

        Parameters
        ----------
        u : ndarray, shape (n, 3)
            Parameters.
        cells : ndarray, shape (n,)
            Cells of the grid in which they are.

        Returns
        -------
        ndarray, shape (n,)
            Numbers of elements.
        """
        del u  # every cell is one element
        return cells

    def home(self, elements: IntArray) -> IntArray:
        """Cells of elements.

        Parameters
        ----------
        elements : ndarray, shape (n,)
            Their numbers.

        Returns
        -------
        ndarray, shape (n,)
            Numbers of cells.
        """
        elements = as_numbers("elements", elements, self.count + len(self.parents))
        if not len(self.parents):
            return elements
        beyond = elements - self.count
        return np.where(beyond < 0, elements, self.parents[np.maximum(beyond, 0)])
