"""The padded grid of blocks on which contouring works; the checks of its input.

A direction with n planes has ``n + 1`` padded cells, of which the first and the last are ghosts of
width 0 on the faces of the domain; a wrapped direction has its ``n - 1`` cells and no ghosts. The
outermost samples are taken `INSET` of a cell inside the faces: so vertices on the faces keep a
distance from all others, and triangles along the edges of caps are not slim.
"""

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from ilattice._memory import need
from ilattice._typing import AnyArray, FloatArray, IntArray
from ilattice._validate import as_array, as_flag, as_items
from ilattice.errors import InputError
from ilattice.mesh._kernels_cells import BOTTOM, LOW, TOP, WIDTH, B, S

PER_COLUMN = 3  # bytes of memory per point of a cross-section
MARGIN = 5e-3  # distance of vertices from the boundary of their cell, as a fraction of the cell
INSET = 0.15  # distance of the outermost samples from the faces of the domain, likewise


@dataclass(frozen=True, eq=False)
class Grid:
    """Planes of samples, ends of the domain, directions that wrap, and what follows from them."""

    axes: tuple[FloatArray, FloatArray, FloatArray]
    ends: FloatArray  # (2, 3)
    wrap: tuple[bool, bool, bool]

    @classmethod
    def checked(cls, axes: Any, wrap: Any) -> "Grid":
        """Grid of user input, or `InputError`."""
        if len(as_items("axes", axes)) != 3:
            raise InputError("axes must be three 1-D arrays of grid planes")
        flags = (
            (wrap,) * 3
            if isinstance(wrap, bool)
            else tuple(as_flag("wrap", w) for w in as_items("wrap", wrap))
        )
        if len(flags) != 3:
            raise InputError(f"wrap must be one flag or three, got {wrap!r:.80}")
        planes = [
            _as_planes(f"axes[{i}]", a, w) for i, (a, w) in enumerate(zip(axes, flags, strict=True))
        ]
        need(
            PER_COLUMN * float(len(planes[1])) * len(planes[2]),
            f"a grid of {' x '.join(str(len(a)) for a in planes)} planes",
            "use fewer planes along the second and the third axis",
        )
        ends = np.array([[a[0] for a in planes], [a[-1] for a in planes]])
        x, y, z = (a if w else _inset(a) for a, w in zip(planes, flags, strict=True))
        return cls((x, y, z), ends, (flags[0], flags[1], flags[2]))

    @cached_property
    def cells(self) -> tuple[int, int, int]:
        """Padded cells per direction."""
        nx, ny, nz = (
            len(a) - 1 if w else len(a) + 1 for a, w in zip(self.axes, self.wrap, strict=True)
        )
        return nx, ny, nz

    @cached_property
    def blocks(self) -> tuple[int, int, int]:
        """Blocks per direction."""
        nx, ny, nz = (-(-c // B) for c in self.cells)
        return nx, ny, nz

    @cached_property
    def shape(self) -> IntArray:
        """`cells` and `wrap` as the kernels take them, shape (6,)."""
        return np.array([*self.cells, *self.wrap], dtype=np.int64)

    @cached_property
    def planes(self) -> tuple[IntArray, IntArray, IntArray]:
        """Plane of each padded sample, per direction, 8 more at the end; ghosts repeat theirs."""
        px, py, pz = (self._planes(axis) for axis in range(3))
        return px, py, pz

    def _planes(self, axis: int) -> IntArray:
        s = np.arange(B * self.blocks[axis] + S + 7, dtype=np.int64)
        n = len(self.axes[axis])
        if self.wrap[axis]:
            return np.where(s < n - 1, s, 0)
        return np.clip(s - 1, 0, n - 1)

    @cached_property
    def cell_table(self) -> FloatArray:
        """Of the padded cells, shape (4, 3, most cells): see `_kernels_cells.LOW`."""
        out = np.zeros((4, 3, max(self.cells)))
        for axis in range(3):
            out[LOW, axis, : self.cells[axis]] = self._low(axis)
            out[WIDTH, axis, : self.cells[axis]] = self._size(axis)
        out[BOTTOM] = out[LOW] + MARGIN * out[WIDTH]
        out[TOP] = out[LOW] + (1.0 - MARGIN) * out[WIDTH]
        return out

    def _low(self, axis: int) -> FloatArray:
        a = self.axes[axis]
        if self.wrap[axis]:
            return a[:-1]
        return np.concatenate((self.ends[:1, axis], a[:-1], self.ends[1:, axis]))

    def _size(self, axis: int) -> FloatArray:
        d = np.diff(self.axes[axis])
        return d if self.wrap[axis] else np.concatenate(([0.0], d, [0.0]))

    @cached_property
    def period(self) -> FloatArray:
        """Length of the wrapped directions, 0 for the others, shape (3,)."""
        return np.where(self.wrap, self.ends[1] - self.ends[0], 0.0)

    def box_ends(self, axis: int, first: IntArray, last: IntArray) -> tuple[FloatArray, FloatArray]:
        """Coordinates where blocks ``first`` begin and blocks ``last`` end along an axis."""
        a = self.axes[axis]
        shift = 0 if self.wrap[axis] else 1
        low = np.clip(B * first - shift, 0, len(a) - 1)
        high = np.clip(B * (last + 1) - shift, 0, len(a) - 1)
        return a[low], a[high]

    def touches_faces(self, axis: int, first: IntArray, last: IntArray) -> AnyArray:
        """Whether the ranges of blocks hold ghost cells of an axis."""
        if self.wrap[axis]:
            return np.zeros(len(first), dtype=bool)
        return (
            (first == 0)
            | (last >= self.blocks[axis] - 1)
            | (B * (last + 1) >= self.cells[axis] - 1)
        )


def _inset(planes: FloatArray) -> FloatArray:
    """Planes with the outermost ones moved inwards."""
    moved = planes.copy()
    moved[0] += INSET * (planes[1] - planes[0])
    moved[-1] -= INSET * (planes[-1] - planes[-2])
    return moved


def _as_planes(name: str, value: Any, wrapped: bool) -> FloatArray:
    a = as_array(name, value, ndim=1)
    least = 4 if wrapped else 2
    if len(a) < least:
        raise InputError(f"{name} must hold at least {least} planes, got {len(a)}")
    step = np.diff(a)
    if not (step > 0).all():
        i = int(np.argmin(step > 0))
        raise InputError(
            f"{name} must increase: plane {i + 1} is {a[i + 1]} after {a[i]}; sort the planes "
            "and drop equal ones"
        )
    return a
