"""Slices of Kagome structures that are never stored: edges near a plane, block by block.

Guarantees: complete: a block is passed over only if bounds of the height on it exclude the plane,
also through a curved map; every edge comes once; memory is that of a block, and of what is found.
Source: Section 6 of the paper, with bounds of blocks in place of its flood fill, which may miss
parts of a slice.
"""

from collections.abc import Iterator
from typing import Any

import numpy as np

from ilattice._typing import ArrayLike, FloatArray, IntArray
from ilattice._validate import as_kind, as_not_negative, as_positive, as_real, as_triple
from ilattice.cost.beams import Beams
from ilattice.cost.kagome import Blocks
from ilattice.errors import GeometryError, InputError
from ilattice.slicing._slicer import as_frame, component
from ilattice.slicing.slices import Slice


def crossings(
    blocks: Blocks, height: float, *, normal: ArrayLike = (0.0, 0.0, 1.0), through: Any = None,
    margin: float = 0.0,
) -> Iterator[FloatArray]:  # fmt: skip
    """Edges that come within a distance of a plane, block by block.

    Parameters
    ----------
    blocks : Blocks
        The structure.
    height : float
        Of the plane along the normal.
    normal : array_like, shape (3,)
        Normal of the plane.
    through : SplineMap, optional
        Map of the vertices; positions are its parameters.
    margin : float
        The distance, such as the largest radius.

    Yields
    ------
    ndarray, shape (e, 2, 3)
        Ends of the edges of a block.

    Raises
    ------
    InputError
        If the structure is outside of the domain of the map.
    """
    as_kind("blocks", blocks, "Blocks")
    level, near = as_real("height", height), as_not_negative("margin", margin)
    n = as_frame(as_triple("normal", normal))[2]
    spline = None
    if through is not None:
        lo, hi = as_kind("through", through, "SplineMap").domain
        c = blocks.corners
        if (c < lo - 1e-9 * (hi - lo)).any() or (c > hi + 1e-9 * (hi - lo)).any():
            raise InputError(
                f"corners {c.tolist()} leave the domain {lo.tolist()} to {hi.tolist()} of the map"
            )
        spline = component(through.geometry, n)
    for block in blocks:
        if not _may_meet(blocks, block, n, spline, level, near):
            continue
        ends = blocks.places(blocks.edges(block))
        if through is not None:
            ends = through.x(np.clip(ends.reshape(-1, 3), lo, hi)).reshape(-1, 2, 3)
        h = ends @ n
        yield ends[(h.min(axis=1) <= level + near) & (h.max(axis=1) >= level - near)]


def _may_meet(
    blocks: Blocks, block: IntArray, n: FloatArray, spline: Any, level: float, near: float
) -> bool:
    """Whether the height of a block, by bounds, comes near the plane."""
    hull = blocks.places(blocks.hull(block))
    if spline is None:
        low, high = (hull @ n).min(), (hull @ n).max()
    else:
        low, high = spline.range(hull.min(axis=0)[None], hull.max(axis=0)[None])[0]
    return bool(low <= level + near and high >= level - near)


def section(
    blocks: Blocks, height: float, radius: float, *, h: float | None = None,
    normal: ArrayLike = (0.0, 0.0, 1.0), through: Any = None,
) -> Slice:  # fmt: skip
    """Contours of the beams of a structure at one height, without the structure.

    Parameters
    ----------
    blocks : Blocks
        The structure.
    height : float
        Of the plane along the normal.
    radius : float
        Of all beams.
    h : float, optional
        Sides of the squares of the grid; default half the radius.
    normal : array_like, shape (3,)
        Normal of the plane.
    through : SplineMap, optional
        Map of the vertices.

    Returns
    -------
    Slice
        Outer contours with their holes.

    Raises
    ------
    GeometryError
        If no beam is there.
    """
    r = as_positive("radius", radius)
    found = list(crossings(blocks, height, normal=normal, through=through, margin=r))
    ends = np.concatenate([np.zeros((0, 2, 3)), *found])
    if not len(ends):
        raise GeometryError(f"no beam comes to height {height:g}")
    pairs = np.arange(2 * len(ends)).reshape(-1, 2)
    near = Beams(ends.reshape(-1, 3), pairs, np.full((len(ends), 2), r))
    return near.slices([height], normal=normal, h=h)[0]
