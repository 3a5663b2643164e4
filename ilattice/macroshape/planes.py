"""Grids of the parameter domain whose cells are about as large as asked in space.

Guarantee: every tile has `MIN_CELLS_PER_TILE` cells or more per direction.
"""

import numpy as np

from ilattice._memory import need
from ilattice._typing import FloatArray
from ilattice.errors import InputError
from ilattice.macroshape.tiling import Tiling

#: Cells per tile and direction at least.
MIN_CELLS_PER_TILE = 8
#: Longest side of a cell of space over its shortest one, about.
ANISOTROPY = 2.0
#: How much closer planes are next to where faces collapse into edges or points.
CLOSEST = 32.0
#: Bytes of memory per site where the map is sampled.
PER_SITE = 150
#: Planes along a direction, above which lengths of edges are taken for mistakes: arrays of that
#: many numbers fit everywhere, grids of them nowhere.
MAX_PLANES = 10_000_000


def grid_axes(lattice: Tiling, h: float, least: int = MIN_CELLS_PER_TILE) -> tuple[FloatArray, ...]:
    """Grid planes whose images are about `h` apart, and not much closer along one direction.

    Along each direction the largest stretch of the map over the cross-section sets the density
    of planes. Where a cross-section shrinks, its cells shrink with it, and the planes across
    move together too, so that cells keep their shape.

    Parameters
    ----------
    lattice : Tiling
        Tiles and map.
    h : float
        Length of the edges of cells in space.
    least : int, optional
        Least number of cells per tile and direction.

    Returns
    -------
    tuple of ndarray
        Planes along the three parameters.
    """
    lo, hi = lattice.domain
    counts = [max(33, 4 * n + 1) for n in lattice.repeat]
    need(
        PER_SITE * float(np.prod(np.array(counts, float))),
        f"the grid of {' x '.join(map(str, lattice.repeat))} tiles",
        "use fewer tiles",
    )
    sites = [np.linspace(lo[a], hi[a], counts[a]) for a in range(3)]
    _, g = lattice.through.geometry.grid(sites, 1)
    stretch = np.linalg.norm(g, axis=-2)  # (n0, n1, n2, parameter)
    others = [tuple(b for b in range(3) if b != a) for a in range(3)]
    step = [h / stretch[..., a].max(axis=others[a]) for a in range(3)]  # widths at the sites
    for a in range(3):
        planes = float((np.diff(sites[a]) / np.maximum(step[a][1:], 1e-300)).sum())
        if not planes < MAX_PLANES:
            raise InputError(
                f"h = {h:.3g} makes {planes:.3g} planes along {'uvw'[a]}; at most {MAX_PLANES} "
                "are allowed: use a larger h"
            )
    limited = []
    for a in range(3):
        b, c = others[a]
        size = [(stretch[..., o] * _along(step[o], o)).max(axis=others[a]) for o in (b, c)]
        most = ANISOTROPY * np.maximum(*size) / stretch[..., a].max(axis=others[a])
        limited.append(np.minimum(step[a], np.maximum(most, step[a] / CLOSEST)))
    return tuple(_planes(sites[a], limited[a], least * lattice.repeat[a]) for a in range(3))


def _along(a: FloatArray, axis: int) -> FloatArray:
    shape = [1, 1, 1]
    shape[axis] = len(a)
    return a.reshape(shape)


def _planes(sites: FloatArray, step: FloatArray, least: int) -> FloatArray:
    """Planes from the first to the last site, `step` apart at the sites, or by `least` cells."""
    density = 1.0 / np.minimum(step, (sites[-1] - sites[0]) / least)
    cells = np.concatenate([[0.0], np.cumsum(0.5 * (density[1:] + density[:-1]) * np.diff(sites))])
    n = int(np.ceil(cells[-1]))
    planes = np.interp(np.linspace(0.0, cells[-1], n + 1), cells, sites)
    planes[0], planes[-1] = sites[0], sites[-1]
    return planes
