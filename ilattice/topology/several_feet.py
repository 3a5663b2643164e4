"""All feet of points that are about as near as the nearest one, with jets of the distances to them.

Guarantee: distances, gradients and Hessians are those of the converged feet. Non-guarantees: a foot
without a seed nearby is missed; feet that are about to become one, next to focal curves, count as
one, and their Hessians are large.
"""

from __future__ import annotations

from itertools import pairwise
from typing import NamedTuple

import numpy as np

from ilattice._typing import AnyArray, FloatArray, IntArray
from ilattice.offsets import _kernels_newton
from ilattice.offsets._kernels_patches import DISTANCE, IMAGE
from ilattice.topology.clearance import Clearance

#: Feet are looked for that are farther than the nearest by up to so many diagonals of a span.
NEARLY = 1.2
#: Seeds from which feet of one point are looked for, at most; chosen without measurements.
MAX_SEEDS = 64
#: Feet whose distances differ by less, relative to the size of a span, are equally near.
EVEN = 1e-5


class Feet(NamedTuple):
    """Feet of one point, nearest first: jets in u of the distances to them; lengths at the point.

    Distances are less the half-thickness. `size` (3,) are the lengths of the derivatives of the
    map, `reach` is about that of a span.
    """

    value: FloatArray
    gradient: FloatArray
    hessian: FloatArray
    size: FloatArray
    reach: float

    @property
    def nearest(self) -> AnyArray:
        """Which feet (n,) are as near as the nearest one."""
        return np.asarray(self.value <= self.value.min(initial=np.inf) + EVEN * self.reach)

    def of(self, rows: IntArray) -> Feet:
        """Some of the feet."""
        return self._replace(
            value=self.value[rows], gradient=self.gradient[rows], hessian=self.hessian[rows]
        )


class SeveralFeet:
    """Finds all near feet of points.

    Parameters
    ----------
    clearance : Clearance
        Distance less half-thickness.
    """

    def __init__(self, clearance: Clearance) -> None:
        self.clearance, self.lattice, self.search = (
            clearance,
            clearance.lattice,
            clearance.lattice.search,
        )

    def __call__(
        self, u: FloatArray, known: FloatArray | None = None, number: IntArray | None = None
    ) -> list[Feet]:
        """For each point the feet that are about as near as the nearest, with jets.

        Among them are those that are known, (n, m, 3) in tile coordinates, `number` (n,) of them.
        """
        if not len(u):
            return []
        x, jacobian = self.lattice.through.jet(u, 1)
        size = np.linalg.norm(jacobian, axis=1)
        reach = NEARLY * np.linalg.norm(size * self.clearance.span, axis=1)
        owner, p = self._found(u, x, reach)
        first = np.zeros(len(p), np.int64)
        if known is not None and number is not None:
            slot = np.arange(known.shape[1]) < number[:, None]
            owner = np.concatenate([np.nonzero(slot)[0], owner])
            p = np.concatenate([known[slot], p])
            first = np.concatenate([np.full(int(slot.sum()), -1), first])
        foot = self.clearance.image(p)
        d = np.linalg.norm(foot - x[owner], axis=1)
        order = np.lexsort((d, first, owner))
        order = order[d[order] > 1e-9 * reach[owner[order]]]
        keep = order[_first_ones(owner[order], foot[order], 1e-5 * d[order])]
        keep = keep[np.lexsort((d[keep], owner[keep]))]
        owner, p, foot, d = owner[keep], p[keep], foot[keep], d[keep]
        value, gradient, hessian = self._jets(u, owner, p, foot, d)
        ends = np.searchsorted(owner, np.arange(len(u) + 1))
        return [
            Feet(value[i:j], gradient[i:j], hessian[i:j], size[k], float(reach[k]))
            for k, (i, j) in enumerate(pairwise(ends))
        ]

    def _found(
        self, u: FloatArray, x: FloatArray, reach: FloatArray
    ) -> tuple[IntArray, FloatArray]:
        """Points, and their feet (r, 3) in tile coordinates, from seeds."""
        seeds = self._seeds(x, reach)
        owner = np.repeat(np.arange(len(u)), [len(s) for s in seeds])
        seed = np.concatenate(seeds)
        n = len(seed)
        feet, counts = np.full((2, n, 8), np.nan), np.zeros((n, 2), np.int64)
        status = np.full(n, _kernels_newton.FALLBACK, np.int64)
        q = self.search.to_tile(u)[owner]
        self.search._run(x[owner], q, seed[:, None].copy(), feet, counts, status)
        good = (status == _kernels_newton.OK)[None] & np.isfinite(feet[:, :, DISTANCE])
        return np.tile(owner, 2)[good.ravel()], feet[good][:, :IMAGE]

    def _seeds(self, x: FloatArray, reach: FloatArray) -> list[IntArray]:
        """For each point seeds not further than the nearest one and `reach` and two spacings."""
        sx, spacing = self.search.seeds.images, self.search.seeds.spacing
        nearest, first = self.search.tree.query(x)
        size = spacing[first]
        near = self.search.tree.query_ball_point(x, nearest + reach + 2.0 * size)
        return [_spread(np.array(v), sx, x[i], 1.5 * size[i]) for i, v in enumerate(near)]

    def _jets(
        self, u: FloatArray, owner: IntArray, p: FloatArray, foot: FloatArray, d: FloatArray
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Distances to feet as functions of u, less the half-thickness if there is one."""
        x, jacobian, bend = (a[owner] for a in self.lattice.through.jet(u, 2))
        normal = (x - foot) / d[:, None]
        gradient = np.einsum("nc,nca->na", normal, jacobian)
        inner = np.eye(3) - normal[:, :, None] * normal[:, None, :]
        inner = (inner - self._foot_motion(p, foot - x)) / d[:, None, None]
        hessian = np.einsum("nca,ncd,ndb->nab", jacobian, inner, jacobian)
        hessian += np.einsum("nc,ncab->nab", normal, bend)
        v, g, h = self.clearance.taken(u[owner], self.clearance.side(u)[owner], 2)
        return d - v, gradient - g, hessian - h

    def _foot_motion(self, p: FloatArray, r: FloatArray) -> FloatArray:
        """Derivatives (n, 3, 3) of feet with respect to the point, from r = foot - point."""
        lattice = self.lattice
        u = self.clearance.wrapped(self.search.from_tile(p))
        _, jacobian, bend = lattice.through.jet(u, 2, extrapolate="extend")
        _, g, h = lattice.implicit_jet(u, 2)
        pull = np.einsum("nca,nc->na", jacobian, r)
        weight = -(pull * g).sum(axis=1) / (g * g).sum(axis=1)
        system = np.zeros((len(p), 4, 4))
        system[:, :3, :3] = (
            np.einsum("nca,ncb->nab", jacobian, jacobian)
            + np.einsum("nc,ncab->nab", r, bend)
            + weight[:, None, None] * h
        )
        system[:, :3, 3] = system[:, 3, :3] = g
        right = np.zeros((len(p), 4, 3))
        right[:, :3] = jacobian.transpose(0, 2, 1)
        out: FloatArray = jacobian @ (np.linalg.pinv(system) @ right)[:, :3]
        return out


def _spread(index: IntArray, sx: FloatArray, x: FloatArray, size: float) -> IntArray:
    """Of the seeds in each box of some size the nearest to a point, nearest first, not too many."""
    away = np.linalg.norm(sx[index] - x, axis=1)
    index = index[np.argsort(away, kind="stable")]
    boxes = np.floor((sx[index] - x) / size).astype(np.int64)
    _, first = np.unique(boxes, axis=0, return_index=True)
    return index[np.sort(first)[:MAX_SEEDS]]


def _first_ones(owner: IntArray, place: FloatArray, reach: FloatArray) -> IntArray:
    """Rows without those that repeat an earlier place of the same owner."""
    keep = np.ones(len(owner), np.bool_)
    ends = np.flatnonzero(np.diff(owner, prepend=-1, append=-1))
    for i, j in pairwise(ends):
        gap = np.linalg.norm(place[i:j, None] - place[None, i:j], axis=2)
        same = np.tril(gap < reach[i:j, None], -1)
        for k in np.flatnonzero(same.any(axis=1)):
            keep[i + k] = not (same[k] & keep[i:j]).any()
    return np.flatnonzero(keep)
