"""The mid-surface of a lattice for pictures: a contour at samples, without thickness.

Guarantee: vertices are in the domain. Non-guarantee: what is smaller than the steps between samples
is missed, and large lattices get fewer of them.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from ilattice._geometry import grid_array
from ilattice.errors import GeometryError
from ilattice.offsets.mid_surface import MidSurface
from ilattice.plot.shapes import isosurface

#: Samples in a picture, at most, and those along an edge of a tile, at least.
PLOTTED, MIN_SAMPLES = 6_000_000, 4


def mid_surface_contour(lattice: MidSurface, n: int) -> Any:
    """Triangles of the mid-surface in space.

    Parameters
    ----------
    lattice : Lattice
        Tiles and map.
    n : int
        Samples along each edge of a tile; fewer where there are many tiles.

    Returns
    -------
    pyvista.PolyData
        The triangles.

    Raises
    ------
    GeometryError
        If the tile does not change its sign at the samples.
    """
    n = min(n, max(MIN_SAMPLES, int((PLOTTED / np.prod(lattice.repeat)) ** (1 / 3))))
    axes = [
        np.linspace(a, b, n * r + 1)
        for (a, b), r in zip(lattice.domain.T, lattice.repeat, strict=True)
    ]
    values = np.empty([len(a) for a in axes])
    for i, u in enumerate(axes[0]):
        plane = grid_array([u], *axes[1:])
        values[i] = lattice.implicit(plane.reshape(-1, 3)).reshape(values.shape[1:])
    shown = isosurface(values, axes)
    if shown.n_points == 0:
        raise GeometryError("the tile has no zero set at the points of the picture")
    lo, hi = lattice.domain
    shown.points = lattice.through.x(np.clip(np.asarray(shown.points, float), lo, hi))
    return shown
