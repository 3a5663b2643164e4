"""Beams in analyses: their pieces within boxes, and frames against pin-jointed trusses."""

import numpy as np
import pytest

import ilattice as il
from ilattice.cost import Beams, _pieces
from ilattice.fields._formula import Splitter

pytestmark = pytest.mark.filterwarnings("ignore::ilattice.errors.PrecisionWarning")


def crowd(seed, even):
    """Beams between random points, with one radius per vertex or another at each end."""
    rng = np.random.default_rng(seed)
    x = rng.random((12, 3)) * (1.0, 0.7, 1.3)
    pairs = np.array([(i, j) for i in range(12) for j in range(i) if rng.random() < 0.35])
    radii = rng.uniform(0.03, 0.12, 12)[pairs] if even else rng.uniform(0.03, 0.12, pairs.shape)
    short = np.linalg.norm(x[pairs[:, 0]] - x[pairs[:, 1]], axis=1) > 0.2
    return Beams(x, pairs[short], radii[short]), rng


@pytest.mark.parametrize("even", [True, False])
@pytest.mark.parametrize("size", [0.3, 0.06, 0.01])
def test_pieces_of_a_box_have_the_sign_of_the_solid_there(even, size):
    b, rng = crowd(int(1000 * size), even)
    lo = rng.random((40_000, 3)) * (1.2, 0.9, 1.5) - 0.1
    lo = lo[np.abs(b.values(lo)) < size][:400]
    hi = lo + size * rng.uniform(0.2, 1.0, (400, 3))
    found = b.parts_on(lo, hi)
    some = sum(f is not None for f in found)  # of 400; boxes that have many pieces have none
    if size > 0.1:
        assert some < 20
    else:
        assert some > 200
    sorts = set()
    for k, pieces in enumerate(found):
        if pieces is None:
            continue
        sorts |= {p[0] for p in pieces}
        x = lo[k] + (hi[k] - lo[k]) * rng.random((60, 3))
        values = np.min([b.part(p).values(x) for p in pieces], axis=0)
        exact = b.values(x)
        clear = np.abs(exact) > 1e-12
        assert ((values < 0.0) == (exact < 0.0))[clear].all()
    if size < 0.1:
        assert _pieces.SIDE in sorts


def test_bounds_of_pieces_hold_and_are_tight():
    rng = np.random.default_rng(3)
    for k in range(60):
        rows = np.hstack(
            [rng.uniform(0.05, 0.3, (1 + k % 3, 2)), rng.uniform(-1, 1, (1 + k % 3, 6))]
        )
        lo = rng.uniform(-1.2, 1.2, (30, 3))
        hi = lo + 10.0 ** rng.uniform(-4, 0, (30, 1)) * rng.random((30, 3))
        t = np.concatenate([0.5 + 0.5 * _pieces.CORNERS, rng.random((100, 3))])
        x = lo[:, None] + (hi - lo)[:, None] * t
        for piece in (_pieces._BeamDistance(rows), _pieces._BeamQuadric(rows[0])):
            low, high = piece.range(lo, hi).T
            v = piece.values(x.reshape(-1, 3)).reshape(30, -1)
            assert (v.min(axis=1) >= low).all()
            assert (v.max(axis=1) <= high).all()
            small = np.linalg.norm(hi - lo, axis=1) < 1e-3
            slack = (v.min(axis=1) - low)[small] / np.linalg.norm(hi - lo, axis=1)[small]
            assert np.median(slack) < 0.01 * len(rows)  # of the second order; Lipschitz: 0.2


def test_programs_of_pieces_hold_no_others():
    b, _ = crowd(5, True)
    lo = np.random.default_rng(0).random((400, 3))
    splitter = Splitter([b])
    _, states = splitter.decided(lo, lo + 0.03)
    for s in np.unique(states, axis=0):
        if s[-1] >= 0:
            splitter.formula(s)
    assert len(splitter.leaves) > 10
    assert {len(leaf.program.leaves) for leaf in splitter.leaves} == {1}


def test_a_beam_that_touches_planes_of_the_grid_is_exact():
    b = Beams([[0, 0, 0.5], [2, 0, 0.5]], [[0, 1]], [[0.25, 0.25]])
    box = [[0.0, -0.5, 0.0], [2.0, 0.5, 1.0]]  # the surface touches planes of the cells
    cut = il.cutfem.Elasticity(b, (8, 4, 4), domain=box).domain.cut
    assert cut.pieces.error < 1e-12
    assert float(cut.volume(4).weights.sum()) == pytest.approx(np.pi * 0.25**2 * 2.0, rel=2e-6)


def test_frames_of_thin_beams_tend_to_pin_jointed_trusses():
    corners = np.array([(0, 0, 0), (1, 0.1, 0), (0.4, 0.9, 0), (0.45, 0.3, 0.8)])
    k = il.cost.CornerSharing(corners, [[0, 1, 2, 3]])
    loads = np.zeros((4, 3))
    loads[3] = 0.1, -0.2, -1.0
    ratios = []
    for r, n in ((0.08, 14), (0.04, 23), (0.02, 37)):
        truss = k.stress(loads, supports=k.positions[:, 2] < 1e-9, stiffness=np.pi * r * r)
        frame = il.cutfem.Elasticity(k.beams(r), (n,) * 3, young=1.0, poisson=0.3)
        frame = frame.clamp("w=0").load(force=tuple(loads[3]), on="w=1").solve()
        ratios.append(frame.compliance / truss.compliance)
    assert abs(ratios[2] - 1.0) < 0.01
    assert abs(ratios[2] - 1.0) < abs(ratios[0] - 1.0)


def test_distances_of_pieces_are_those_of_beams_also_where_one_ball_holds_the_other():
    rng = np.random.default_rng(2)
    held = 0
    for _ in range(30):
        x, r = rng.random((2, 3)), rng.uniform(0.01, 1.5, 2)
        held += abs(r[1] - r[0]) > np.linalg.norm(x[1] - x[0])
        b = Beams(x, [[0, 1]], [r])
        p = rng.uniform(-1, 2, (500, 3))
        p[:100] = x[0] + rng.uniform(-1, 2, (100, 1)) * (x[1] - x[0])
        np.testing.assert_allclose(b.part((0, 0)).values(p), b.values(p), atol=1e-12)
    assert held > 3


@pytest.mark.parametrize("r", [0.15, 0.07, 0.03, 0.012])
def test_thin_beams_in_large_cells_keep_their_volume(r):
    rng = np.random.default_rng(int(1e4 * r))
    a, b = rng.uniform(0.2, 0.9, 3), rng.uniform(2.1, 2.8, 3)  # no other beam is near
    beam = il.cost.Beams([a, b], [[0, 1]], [[r, r]])
    cut = il.cutfem.cut(beam, 3, domain=[[0, 0, 0], [3, 3, 3]])
    rule = cut.volume()
    exact = np.pi * r * r * (np.linalg.norm(b - a) + 4.0 / 3.0 * r)
    off = abs(rule.weights.sum() / exact - 1.0)
    assert off <= max(2.0 * cut.pieces.error, 1e-4)
    assert off < 0.02
