"""Sweeps over seeds, feet of neighbours, and feet that are followed, where maps squeeze tiles."""

import numpy as np
import pytest

import ilattice as il
from ilattice.bspline import BSpline
from ilattice.offsets import _kernels as kernels
from ilattice.offsets import _kernels_newton as newton
from ilattice.offsets import _kernels_sweep
from ilattice.offsets.mending import mended
from ilattice.offsets.polish import polish

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


def swept(search, x, q, best, reach):
    """What a sweep of one query should find, by looking at all seeds."""
    sp, sx, sn, sh = search.seeds
    geom = search.space[7]
    away = np.linalg.norm(sx - x, axis=1)
    near = np.flatnonzero(away <= reach)
    out = []
    for s in near[np.argsort(away[near])]:
        if not kernels.in_reach(geom, sp, sx, sn, s, tuple(x), tuple(q)):
            continue
        if kernels.unlikely(tuple(x), sx, sn, s, sh[s], best):
            continue
        if not any(kernels.alike(geom, sp, sx, sn, c, s, 0.6 * sh[s]) for c in out):
            out.append(s)
    return out, sh[near].max(initial=0.0)


def test_a_sweep_finds_what_looking_at_all_seeds_does(flat):
    search, n = flat.search, 60
    _, q, x = queries(flat, n, 1)
    rng = np.random.default_rng(2)
    away = search.candidates(x, 1)[0][:, 0]
    best = away * rng.uniform(0.3, 2.0, n)
    reach = np.maximum(best, away) * rng.uniform(0.5, 8.0, n)
    out, widest = np.empty((n, OUT), np.int64), np.empty(n)
    _kernels_sweep.sweep(
        search.space[7], *search.seeds, *search.boxes, x, q, best, reach, out, widest
    )
    full = 0
    for i in range(n):
        found, largest = swept(search, x[i], q[i], best[i], reach[i])
        assert out[i].tolist() == (found + [-1] * OUT)[:OUT]
        assert widest[i] == largest
        full += len(found) > OUT
    assert 0 < full < n


def test_boxes_hold_all_seeds_once(flat):
    boxes, x = flat.search.boxes, flat.search.seeds[1]
    assert sorted(boxes.order) == list(range(len(x)))
    assert boxes.first[-1] - boxes.first[-2] == 1
    for level in range(len(boxes.first) - 1):
        at = np.arange(len(x)) // (_kernels_sweep.LEAF * _kernels_sweep.FAN**level)
        row = boxes.first[level] + at
        inside = (boxes.lo[row] <= x[boxes.order]) & (x[boxes.order] <= boxes.hi[row])
        assert inside.all()


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
