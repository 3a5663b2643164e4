"""Spline volumes as pictures: their faces, and lines of constant parameters on them."""

from collections.abc import Iterator
from typing import Any, Protocol

import numpy as np

from ilattice._geometry import grid_array
from ilattice._typing import ArrayLike, FloatArray
from ilattice.plot.shapes import hexahedra, polylines

_FINE = 8  # pieces of a line between two of the others


class _Map(Protocol):
    """What is drawn of a spline volume."""

    @property
    def names(self) -> tuple[str, ...]: ...
    @property
    def closed(self) -> tuple[bool, ...]: ...
    @property
    def domain(self) -> FloatArray: ...
    def x(self, u: ArrayLike) -> FloatArray: ...
    def extra(self, u: ArrayLike) -> FloatArray: ...


def faces_of(through: _Map, n: int) -> Any:
    """Faces of a volume, without those where a closed one meets itself."""
    shown = []
    for x, u in _faces(through, n):
        side = hexahedra(x[:, :, None])
        for name, values in zip(through.names, through.extra(u).T, strict=True):
            side.point_data[name] = values.reshape(n, n).ravel(order="F")
        shown.append(side)
    return shown[0].merge(shown[1:]).extract_surface(algorithm=None)


def net_of(through: _Map, n: int) -> Any:
    """Lines of constant parameters on the faces, `n` in each direction."""
    sides = (x for x, _ in _faces(through, _FINE * (n - 1) + 1))
    return polylines([line for x in sides for y in (x, x.swapaxes(0, 1)) for line in y[::_FINE]])


def _faces(through: _Map, n: int) -> Iterator[tuple[FloatArray, FloatArray]]:
    """Points (n, n, 3) and parameters (n * n, 3) of each face."""
    closed = (False,) * 3 if all(through.closed) else through.closed
    for axis in (k for k in range(3) if not closed[k]):
        for end in through.domain[:, axis]:
            lo, hi = through.domain
            a, b = (np.linspace(lo[k], hi[k], n) for k in range(3) if k != axis)
            u = np.insert(grid_array(a, b), axis, end, axis=-1)
            u = u.reshape(-1, 3)
            yield through.x(u).reshape(n, n, 3), u
