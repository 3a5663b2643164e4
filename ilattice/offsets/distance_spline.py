"""The signed Euclidean distance of a lattice, fitted once as one spline over the domain.

Guarantee: interpolates the distance at one site per coefficient, C1, periodic where the map is
closed. Non-guarantee: on the medial axis the distance has kinks, which a C1 spline rounds off
over about one span.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np

from ilattice._geometry import grid_points
from ilattice._memory import need
from ilattice._progress import Progress, track
from ilattice._typing import ArrayLike, FloatArray
from ilattice.bspline import BSpline
from ilattice.bspline.fit import fit_interpolate, sites
from ilattice.bspline.knots import uniform_knots

if TYPE_CHECKING:
    from ilattice.offsets.mid_surface import MidSurface

#: Degree of distance splines, the least whose gradients are continuous.
DEGREE = 2
PER_SITE = 40  # bytes
#: Sites of a slab, of which closest points are found at once.
SLAB_POINTS = 1 << 17


def distance_spline(
    lattice: MidSurface, spans_per_tile: int | None = None, progress: Progress = None
) -> BSpline:
    """Signed distance to the mid-surface as a function of the parameters.

    Parameters
    ----------
    lattice : Lattice
        The lattice; the spline is kept there.
    spans_per_tile : int, optional
        Spans per tile and direction, by default those of the lattice.
    progress : bool or callable, optional
        See `ilattice._progress.track`.

    Returns
    -------
    BSpline
        Scalar, degree 2, n = spans_per_tile * tiles + 2 coefficients per open direction.

    Notes
    -----
    Hong et al. 2025, section 3.3 and eq. 5, with interpolation at Greville sites in place of
    coefficients set to samples.
    """
    spans = lattice.spans if spans_per_tile is None else spans_per_tile
    key = f"distance_spline_{spans}"
    if key not in lattice._cache:
        lattice._cache[key] = _fit(lattice, spans, progress)
    spline: BSpline = lattice._cache[key]
    return spline


def _fit(lattice: MidSurface, spans: int, progress: Progress) -> BSpline:
    def distance(u: FloatArray, strides: tuple[int, ...]) -> FloatArray:
        return lattice.search.query(u, strides=strides).distance

    return interpolated(lattice, distance, spans, DEGREE, progress)


def interpolated(
    lattice: MidSurface,
    f: Callable[[FloatArray, tuple[int, ...]], FloatArray],
    spans: int | ArrayLike,
    degree: int,
    progress: Progress = None,
) -> BSpline:
    """Spline over the domain of a lattice that interpolates a function at one site per coefficient.

    Parameters
    ----------
    lattice : Lattice
        Gives the domain, the tiles and the closed directions.
    f : callable
        Takes parameters (n, 3), and how many rows apart neighbours are; returns values (n,).
    spans : int or three of them
        Spans per tile and direction.
    degree : int
        Degree.
    progress : bool or callable, optional
        See `ilattice._progress.track`.

    Returns
    -------
    BSpline
        Scalar, periodic where the map is closed.
    """
    closed = lattice.through.wraps
    counts = np.broadcast_to(np.asarray(spans, np.int64), 3).tolist()
    need(
        PER_SITE * math.prod(n * r + degree for n, r in zip(counts, lattice.repeat, strict=True)),
        f"the distance spline of {' x '.join(map(str, lattice.repeat))} tiles with "
        f"{max(counts)} spans per tile and direction",
        "use fewer tiles, or a smaller spans_per_tile",
    )
    knots, axes = [], []
    for a in range(3):
        t = uniform_knots(
            counts[a] * lattice.repeat[a], degree, tuple(lattice.domain[:, a]), periodic=closed[a]
        )
        knots.append(t)
        axes.append(sites(t, degree, "interpolate", closed[a]))
    shape = tuple(len(a) for a in axes)
    values = np.empty(shape)
    step = max(1, SLAB_POINTS // (shape[1] * shape[2]))
    for i in track(range(0, shape[0], step), "distance", progress):
        part = (axes[0][i : i + step], axes[1], axes[2])
        u = grid_points(*part)
        strides = (1, shape[2], shape[1] * shape[2])
        values[i : i + step] = f(u, strides).reshape(-1, *shape[1:])
    return fit_interpolate(values, knots, degree, periodic=closed)
