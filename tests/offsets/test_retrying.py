"""Sweeps over seeds, feet of neighbours, and feet that are followed, where maps squeeze tiles."""

import numpy as np
import pytest

import ilattice as il
from ilattice.bspline import BSpline
from ilattice.offsets import _kernels_newton as newton
from ilattice.offsets import _kernels_patches as kernels
from ilattice.offsets import _kernels_sweep, seeded
from ilattice.offsets.mending import mended
from ilattice.offsets.polish import polish
from ilattice.offsets.seed_boxes import SLABS, _halves

OUT = 6


@pytest.fixture(scope="module")
def flat():
    """Gyroids in flat cells of a wing, continued beyond its ends."""
    return il.Lattice("gyroid", through=il.macroshape.wing(), repeat=(2, 1, 3))


def queries(lattice, count, seed):
    """Random parameters, tile coordinates and points."""
    lo, hi = lattice.domain
    u = lo + np.random.default_rng(seed).random((count, 3)) * (hi - lo)
    return u, lattice.search.to_tile(u), lattice.through.x(u)


def likely(search, x, q, best):
    """Seeds that may have a foot nearer than `best`, nearest first, by looking at all of them."""
    sp, sx, sn, sh = search.seeds
    geom = search.space.geom
    away = np.linalg.norm(sx - x, axis=1)
    return [
        s
        for s in np.argsort(away, kind="stable")
        if not kernels.unlikely(tuple(x), sx, sn, s, sh[s], best)
        and kernels.in_reach(geom, sp, sx, sn, s, tuple(x), tuple(q))
        and not _kernels_sweep.away_from(sn, sh, s, away[s], best)
    ]


def test_a_sweep_finds_what_looking_at_all_seeds_does(flat):
    """Those whose own boxes are in reach, one per patch, and none but likely ones."""
    search, n = flat.search, 40
    sp, sx, sn, sh = search.seeds
    _, q, x = queries(flat, n, 1)
    rng = np.random.default_rng(2)
    best = search.candidates(x, 1)[0][:, 0] * rng.uniform(0.3, 4.0, n)
    out = np.empty((n, OUT), np.int64)
    _kernels_sweep.sweep(len(x), search.space.geom, *search.seeds, *search.boxes, x, q, best, out)
    half, full, held_back = _halves(sn, sh), 0, 0
    for i in range(n):

        def alike(a, b):
            return kernels.alike(search.space.geom, sp, sx, sn, a, b, 0.6 * sh[b])

        found = [int(s) for s in out[i] if s >= 0]
        seeds = likely(search, x[i], q[i], best[i])
        assert set(found) <= set(seeds)
        assert sorted(found, key=seeds.index) == found
        assert not any(alike(a, b) for b in found for a in found[: found.index(b)])
        full += len(found) == OUT
        gap = np.maximum(np.abs(sx[seeds] - x[i]) - half[seeds], 0.0)
        for s in np.array(seeds, int)[(gap**2).sum(axis=1) <= best[i] ** 2]:
            if s not in found and not any(alike(a, s) for a in found):
                assert len(found) == OUT
                held_back += 1
    assert 0 < full < n
    assert held_back > 0


def test_boxes_hold_what_all_seeds_stand_for(flat):
    boxes, x = flat.search.boxes, flat.search.seeds.images
    half = _halves(*flat.search.seeds[2:])
    assert boxes.first[-1] - boxes.first[-2] == 1
    for level in range(len(boxes.first) - 1):
        at = np.arange(len(x)) // (_kernels_sweep.LEAF * _kernels_sweep.FAN**level)
        row = boxes.first[level] + at
        inside = (boxes.lo[row] <= x - half) & (x + half <= boxes.hi[row])
        assert inside.all()


def test_slabs_hold_the_cells_of_all_seeds(flat):
    """Their corners, and what bends away from them; and they are thinner than boxes."""
    boxes, (_, x, normal, _) = flat.search.boxes, flat.search.seeds
    assert normal.shape[1] == kernels.SQUEEZED_TOO
    cells, bend = normal[:, 5:14].reshape(-1, 3, 3), normal[:, 14]
    told = np.flatnonzero(cells.any(axis=(1, 2)))
    thinner = []
    for level in range(SLABS):
        row = boxes.first[level] + told // (_kernels_sweep.LEAF * _kernels_sweep.FAN**level)
        way, lo, hi = boxes.slab[row, :3], boxes.slab[row, 3], boxes.slab[row, 4]
        np.testing.assert_allclose(np.linalg.norm(way, axis=1), 1.0)
        for corner in np.stack(np.meshgrid(*[[-1.0, 1.0]] * 3), axis=-1).reshape(-1, 3):
            away = np.linalg.solve(cells[told], kernels.AROUND * corner[:, None])[..., 0]
            s = ((x[told] + away) * way).sum(axis=1)
            room = 1e-9 * np.ptp(x)
            assert (s - bend[told] >= lo - room).all()
            assert (s + bend[told] <= hi + room).all()
        across = (np.abs(way) * (boxes.hi - boxes.lo)[row]).sum(axis=1)
        thinner.append(np.median((hi - lo) / across))
    assert max(thinner[:2]) < 0.7


@pytest.mark.parametrize("axis", range(3))
def test_what_seeds_stand_for_has_the_cells_around_them(flat, axis):
    """Images of random places up to a cell away are in the boxes; most cells are long along w."""
    search, rng = flat.search, np.random.default_rng(axis)
    sp, sx, sn, sh = search.seeds
    far = np.minimum(sp, np.array(flat.repeat) - sp).min(axis=1) > 0.3  # from layers in tips
    at = rng.choice(np.flatnonzero(far), 500, replace=False)
    cell = np.array([0.25, 0.25, 1.0 / seeded.MAX_REFINED]) / search._least_seeds
    way = rng.uniform(-1.0, 1.0, (500, 3))
    way[:, axis] = rng.choice([-1.0, 1.0], 500)
    x = flat.through.x(search.from_tile(sp[at] + way * cell), extrapolate="extend")
    gap = np.abs(x - sx[at]) - _halves(sn[at], sh[at])
    assert gap.max() <= 1e-12


def test_feet_that_are_too_far_are_replaced_by_those_of_neighbours(flat):
    """Three of a row of queries are given feet of others far away."""
    search = flat.search
    u = queries(flat, 2, 3)[0]
    u = u[0] + np.linspace(0.0, 0.02, 21)[:, None] * (u[1] - u[0])
    found = flat.closest(u)
    p, x = search.to_tile(u), flat.through.x(u)
    feet = np.full((2, len(u), 8), np.nan)
    feet[0] = np.column_stack([search.to_tile(found.u), found.foot, found.distance, found.distance])
    feet[1, :, 6] = np.inf
    wrong = [4, 5, 13]
    far = flat.closest(queries(flat, 3, 4)[0])
    y = far.foot
    away = np.sign(found.distance[wrong]) * np.linalg.norm(x[wrong] - y, axis=1)
    feet[0, wrong] = np.column_stack([search.to_tile(far.u), y, away, away])
    assert (np.abs(away) > 1.5 * np.abs(found.distance[wrong])).all()
    status = np.full(len(u), newton.OK)
    assert mended(search, x, p, feet, status, (1,), None, False) == len(wrong)
    assert np.abs(feet[0, :, 6] - found.distance).max() < 1e-7 * np.abs(found.distance).max()


def test_followed_feet_are_points_of_the_surface_no_nearer_than_the_closest():
    """Of the surface in the domain: on the continuation some have no seeds."""
    flat = il.Lattice("gyroid", through=il.macroshape.wing(), repeat=(2, 1, 3), boundary="clip")
    u = queries(flat, 300, 5)[0]
    known = flat.closest(u)
    lo, hi = flat.domain
    moved = np.clip(u + 3e-3 * np.random.default_rng(6).standard_normal(u.shape), lo, hi)
    found, best = flat.search.follow(moved, known), flat.closest(moved)
    ok = found.status < newton.FALLBACK
    assert ok.mean() > 0.9
    x = flat.through.x(moved)
    assert np.allclose(np.linalg.norm(x - found.foot, axis=1)[ok], np.abs(found.distance)[ok])
    size = np.linalg.norm(np.ptp(flat.through.x(flat.domain), axis=0))
    farther, distance = np.abs(found.distance[ok]), np.abs(best.distance[ok])
    assert (farther > distance - 1e-7 * distance - 1e-8 * size).all()
    assert np.median(farther / distance) < 1.0 + 1e-7


def test_polished_points_are_at_the_asked_distance_from_all_of_the_surface(flat):
    """Steps go by known feet; where these are not the closest ones, a search corrects them."""
    u, _, _ = queries(flat, 400, 7)
    near = flat.closest(u)
    d = 0.3 * np.median(np.abs(near.distance))
    side = np.sign(near.distance)
    box = [flat.domain[:, a] for a in range(3)]
    fixed = np.zeros(u.shape, bool)
    out, residual = polish(flat, u, fixed, side, BSpline(box, np.full((1, 1, 1), d), 0))
    good = residual < 1e-6 * d
    assert good.mean() > 0.8
    assert np.abs(side * flat.distance(out) - d)[good].max() < 1e-5 * d


@pytest.mark.filterwarnings("ignore:the spline approximation of tile")
@pytest.mark.parametrize("tile", ["gyroid", "re_entrant_honeycomb"])
def test_no_seed_leads_to_a_nearer_foot(tile):
    """Every seed around is started from, alone: feet of thin plates have others behind them."""
    lattice = il.Lattice(tile, through=il.macroshape.wing(), repeat=(1, 1, 3))
    search, n = lattice.search, 250
    u, q, x = queries(lattice, n, 8)
    best = np.abs(lattice.closest(u).distance)
    near = search.tree.query_ball_point(x, best + 0.8 * search.spacing.size.mean())
    owner = np.repeat(np.arange(n), [len(s) for s in near])
    seed = np.concatenate([np.array(s, np.int64) for s in near])[:, None]
    feet, counts = np.full((2, len(seed), 8), np.nan), np.zeros((len(seed), 2), np.int64)
    status = np.full(len(seed), newton.FALLBACK)
    search._run(x[owner], q[owner], seed, feet, counts, status)
    found = np.where(status < newton.FALLBACK, np.abs(feet[0, :, 6]), np.inf)
    nearest = np.minimum.reduceat(found, np.searchsorted(owner, np.unique(owner)))
    best = best[np.unique(owner)]
    assert len(best) > 0.9 * n
    assert (nearest > best - 1e-6 * best.max()).all()


def test_feet_at_seeds_are_not_looked_for_again():
    """Many queries of a grid have a seed for a foot, which may be nearer by rounding alone."""
    lattice = il.Lattice("gyroid", through=il.macroshape.box((3.0, 3.0, 3.0)), repeat=(3, 3, 3))
    lattice.offset(0.1)
    assert lattice.statistics.queries > 1e5
    assert lattice.statistics.retries == 0
