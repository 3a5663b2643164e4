"""Feet on struts themselves, from feet on the spline that approximates their tile.

The search for closest points needs a field that compiled code evaluates: of a skeleton, a spline
whose zero set is up to a hundredth of the least radius off, and which rounds off where struts meet.
A foot on it is moved by Newton steps to the nearest point of the struts, within faces of the domain
where it is on one.

Guarantee: where these steps end, and lead no farther than `LONGEST`, the foot is on the struts to
`ON_STRUT` of their least radius, and the distance is that to it.
Non-guarantees: a foot next to where struts meet may be left beside the nearest one, by what the
spline rounds off there; other feet keep their place. Plates are left as the spline has them: their
rims have edges, to which no step along a normal leads.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ilattice._typing import AnyArray, FloatArray
from ilattice.macroshape.tiling import Tiling
from ilattice.offsets._kernels_newton import FALLBACK
from ilattice.offsets._kernels_patches import DISTANCE, IMAGE
from ilattice.offsets._small import solved
from ilattice.offsets.feet import ClosestPoints
from ilattice.offsets.space import TileSpace
from ilattice.tiles.entities import Arc, Ball, Curve, Group, Polyline, Segments
from ilattice.tiles.skeleton import ON_FACE, SkeletonField
from ilattice.tiles.tile import Tile

#: Value of the field, in least radii, above which a foot is moved once more; steps at most; and
#: the longest way in least radii: several times what the spline is off.
ON_STRUT, STEPS, LONGEST = 1e-6, 5, 0.5
#: Part of the distance by which a step must have brought a foot nearer for another one.
ON_FOOT = 1e-5
#: Distances, in ways that feet have been moved, below which signs are those of the struts.
SIGN = 4.0


def struts_of(lattice: Tiling) -> SkeletonField | None:
    """Field of a lattice of struts that fit together; None of any other.

    Parameters
    ----------
    lattice : Tiling
        Any.

    Returns
    -------
    SkeletonField or None
        The field of its tile.
    """
    tile = lattice.tile
    if not isinstance(tile, Tile) or not isinstance(tile.field, SkeletonField) or lattice.creased:
        return None
    field = tile.field
    alone = [m for e in field.entities for m in (e.members if isinstance(e, Group) else (e,))]
    return (
        field
        if all(isinstance(e, Polyline | Segments | Arc | Curve | Ball) for e in alone)
        else None
    )


def onto_struts(
    space: TileSpace, skeleton: SkeletonField, p: FloatArray, x: FloatArray, found: ClosestPoints
) -> ClosestPoints:
    """Feet moved from the spline to the struts.

    Parameters
    ----------
    space : TileSpace
        Tile coordinates of a lattice of struts.
    skeleton : SkeletonField
        The field of its tile, see `struts_of`.
    p, x : ndarray, shape (n, 3)
        Queries in tile coordinates and in space.
    found : ClosestPoints
        Their feet on the spline.

    Returns
    -------
    ClosestPoints
        Feet on the struts.
    """
    n = len(x)
    at = np.flatnonzero(found.status < FALLBACK)
    other = np.flatnonzero(np.isfinite(found.second_distance))
    row = np.concatenate([at, other])
    start = np.concatenate([found.u[at], found.second_u[other]])
    old = np.concatenate([found.distance[at], found.second_distance[other]])
    u, foot, way = _moved(space, skeleton, start, x[row])
    size = np.linalg.norm(x[row] - foot, axis=1)
    sign = np.where(old < 0.0, -1.0, 1.0)
    near = np.flatnonzero(np.abs(old) <= SIGN * way)
    if len(near):
        f = space.lattice.tile(_in_tile(p[row[near]]))
        sign[near] = np.where(f < 0.0, -1.0, 1.0)
    feet = np.full((2, n, DISTANCE + 1), np.nan)
    feet[0] = np.column_stack([found.u, found.foot, found.distance])
    feet[1] = np.column_stack([found.second_u, found.second, found.second_distance])
    moved = np.column_stack([u, foot, sign * size])
    feet[0, at], feet[1, other] = moved[: len(at)], moved[len(at) :]
    swap = np.abs(feet[1, :, DISTANCE]) < np.abs(feet[0, :, DISTANCE])
    first, second = np.where(swap[:, None], feet[::-1], feet)
    return replace(
        found, start=found.u,
        u=first[:, :IMAGE].copy(), second_u=second[:, :IMAGE].copy(),
        foot=first[:, IMAGE:DISTANCE].copy(), second=second[:, IMAGE:DISTANCE].copy(),
        distance=first[:, DISTANCE].copy(), second_distance=second[:, DISTANCE].copy(),
    )  # fmt: skip


def _moved(
    space: TileSpace, field: SkeletonField, u: FloatArray, x: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Parameters and places of feet of points x on the struts, and how far the ways there were."""
    lattice, p = space.lattice, space.to_tile(u)
    assert field is not None
    lo, hi = np.where(space.ends, space.box, [[-np.inf], [np.inf]])
    start = lattice.through.x(u, extrapolate="extend")
    q, foot = p.copy(), start.copy()
    nearest = np.full(len(u), np.inf)
    at, now, y = np.arange(len(u)), p.copy(), start
    for i in range(STEPS + 1):
        f, g, h = lattice.tile.jet(_in_tile(now), 2)
        size = np.linalg.norm(x[at] - y, axis=1)
        on = np.abs(f) <= ON_STRUT * field.thinnest
        better = on & (size < nearest[at])
        gain = np.where(np.isinf(nearest[at]), np.inf, nearest[at] - size)
        q[at[better]], foot[at[better]], nearest[at[better]] = now[better], y[better], size[better]
        go = ~on | (gain > ON_FOOT * size)
        if i == STEPS or not go.any():
            break
        at, now, y = at[go], now[go], y[go]
        fixed = (np.abs(now - lo) <= ON_FACE) | (np.abs(now - hi) <= ON_FACE)
        step = _step(space._jacobian(now), x[at] - y, f[go], g[go], h[go], fixed)
        far = np.linalg.norm((now + step - p[at]) @ field.cell.T, axis=1) > LONGEST * field.thinnest
        step[far | ~np.isfinite(step).all(axis=1)] = 0.0
        now = np.clip(now + step, lo, hi)
        y = lattice.through.x(space.from_tile(now), extrapolate="extend")
    return space.from_tile(q), foot, np.linalg.norm(foot - start, axis=1)


def _step(
    jacobian: FloatArray,
    r: FloatArray,
    f: FloatArray,
    g: FloatArray,
    h: FloatArray,
    fixed: AnyArray,
) -> FloatArray:
    """Newton's steps in tile coordinates to feet; as if maps did not bend within a step."""
    free = ~fixed
    metric = np.einsum("nca,ncb->nab", jacobian, jacobian)
    down = np.einsum("nca,nc->na", jacobian, r) * free
    g = g * free
    along = solved(_held(metric, free), np.stack([down, g], axis=2))
    with np.errstate(divide="ignore", invalid="ignore"):
        push = (g * along[:, :, 0]).sum(axis=1) / (g * along[:, :, 1]).sum(axis=1)
    bent = _held(metric + push[:, None, None] * h, free)
    along = solved(bent, np.stack([down, g], axis=2))
    with np.errstate(divide="ignore", invalid="ignore"):
        back = (f + (g * along[:, :, 0]).sum(axis=1)) / (g * along[:, :, 1]).sum(axis=1)
    out: FloatArray = along[:, :, 0] - back[:, None] * along[:, :, 1]
    return out


def _held(matrix: FloatArray, free: AnyArray) -> FloatArray:
    """Matrices (n, 3, 3) without the coordinates that are not free."""
    out: FloatArray = matrix * (free[:, :, None] & free[:, None, :])
    return out + ~free[:, :, None] * np.eye(3)


def _in_tile(p: FloatArray) -> FloatArray:
    """Tile coordinates within the unit cube."""
    out: FloatArray = p - np.floor(p)
    return out
