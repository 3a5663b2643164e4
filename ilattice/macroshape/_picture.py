"""Spline volumes as pictures: their faces, and lines of constant parameters on them."""

from typing import TYPE_CHECKING, Any

import numpy as np

from ilattice._typing import FloatArray
from ilattice.plot.shapes import hexahedra, polylines

if TYPE_CHECKING:
    from ilattice.macroshape.maps import SplineMap

_FINE = 8  # pieces of a line between two of the others


def points_of(through: "SplineMap", n: int) -> Any:
    """Points of a volume on a grid, with its further coordinates."""
    axes = [np.linspace(a, b, n) for a, b in through.domain.T]
    u = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)
    grid = hexahedra(through.x(u).reshape(n, n, n, 3))
    extra = through.extra(u)
    for k, name in enumerate(through.names):
        grid.point_data[name] = extra[:, k].reshape(n, n, n).ravel(order="F")
    return grid


def net_of(through: "SplineMap", n: int) -> tuple[Any, Any]:
    """Faces of a volume, without those where a closed one meets itself, and lines on them."""
    closed = (False,) * 3 if all(through.closed) else through.closed
    faces, net = [], []
    for axis in (k for k in range(3) if not closed[k]):
        for end in through.domain[:, axis]:
            x = _face(through, axis, end, _FINE * (n - 1) + 1)
            faces.append(hexahedra(x[:, :, None]))
            net += [line for side in (x, x.swapaxes(0, 1)) for line in side[::_FINE]]
    shown = faces[0].merge(faces[1:]) if len(faces) > 1 else faces[0]
    return shown.extract_surface(algorithm=None), polylines(net)


def _face(through: "SplineMap", axis: int, end: float, n: int) -> FloatArray:
    """Points of one face, shape (n, n, 3)."""
    a, b = (np.linspace(*through.domain[:, k], n) for k in range(3) if k != axis)
    u = np.insert(np.stack(np.meshgrid(a, b, indexing="ij"), axis=-1), axis, end, axis=-1)
    return through.x(u.reshape(-1, 3)).reshape(n, n, 3)
