"""Walls of random tiles, maps, thicknesses, lengths of edges and scales, against naive oracles."""

import os
import time
import warnings

import combinations as cb
import numpy as np
import pytest

import ilattice as il
from ilattice.errors import ConvergenceError, PrecisionWarning
from ilattice.mesh import _projecting

#: Combinations per run, and seconds of CPU that they may take together, and one of them.
COUNT, TOGETHER, EACH = 60, 700.0, 40.0
#: So many must be looked at in that time.
LEAST = 40
#: The first one; others by the environment.
FIRST = int(os.environ.get("ILATTICE_COMBINATIONS", 1_246_860))


@pytest.fixture(scope="module")
def spent():
    """Seconds of CPU that combinations have taken."""
    return [0.0]


@pytest.fixture(scope="module")
def looked_at(request, tmp_path_factory):
    """A file that processes side by side share: a line per combination, its seed and seconds."""
    home = tmp_path_factory.getbasetemp()
    return (home.parent if hasattr(request.config, "workerinput") else home) / "combinations"


def enough(rows):
    """That most combinations have been looked at, if these are the rows of all; see `looked_at`."""
    done = [row for row in rows if not row.endswith("skipped")]
    assert len(rows) < COUNT or len(done) >= LEAST, (
        f"{len(done)} of {COUNT} combinations were looked at, {LEAST} must be; "
        f"seeds and seconds of CPU: {'; '.join(rows)}"
    )


@pytest.mark.parametrize("place", range(COUNT))
def test_a_random_combination_is_right_or_refused(place, spent, looked_at):
    """Closed, of the right volume and thickness, both ways; see `combinations`.

    ``ILATTICE_COMBINATIONS=first`` draws others,
    ``tests/combinations.py --most 2500 --points 16 --quick --seeds n`` a single one. As many are
    looked at as there is time for, but at least `LEAST`: the last of all tells.
    """
    seed, found, why = FIRST + place, None, f"{TOGETHER:g} s of CPU are spent"
    start = time.process_time()
    if spent[0] <= TOGETHER:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", PrecisionWarning)
            try:
                with cb.limited(EACH):
                    found = cb.judge(cb.combination(seed, most=2500), count=16, igl_crossings=False)
            except cb.OutOfTimeError:
                why = f"it takes more than {EACH:g} s of CPU"
    took = time.process_time() - start
    spent[0] += took
    with open(looked_at, "a") as file:
        file.write(f"{seed} {took:.1f}{' skipped' if found is None else ''}\n")
    enough(looked_at.read_text().splitlines())
    if found is None:
        pytest.skip(f"seed {seed}: {why}")
    assert found.faults == [], f"ILATTICE_COMBINATIONS={FIRST}: {found.row}"


def test_too_few_combinations_are_told():
    rows = [f"{n} 12.5{' skipped' if n >= LEAST else ''}" for n in range(COUNT)]
    enough(rows)
    enough(["0 0.0 skipped"] * (COUNT - 1))  # not all yet
    rows[7] = "7 40.1 skipped"
    with pytest.raises(
        AssertionError, match=r"39 of 60 .* 40 must be; .*; 6 12\.5; 7 40\.1 skipped"
    ):
        enough(rows)


def test_vertices_on_edges_of_the_domain_are_on_the_offset():
    """They used to be off by up to 97 % of d, and counted as right."""
    lattice = il.Lattice("iwp", through=il.macroshape.duck(), repeat=(5, 2, 1))
    wall = lattice.offset((np.inf, -0.05))
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", PrecisionWarning)
        mesh = wall.mesh(0.08)
    data = mesh.point_data
    u = np.stack([data[k] for k in "uvw"], axis=1)
    on = (data["side"] != 0) & (data["unconverged"] == 0)
    assert np.abs(lattice.distance(u[on]) + 0.05).max() < 1e-4 * 0.05
    assert (data["unconverged"] != 0).sum() < 3e-3 * len(u)
    lo, hi = lattice.domain
    edge = ((u == lo) | (u == hi)).sum(axis=1) == 2
    assert (edge & on).sum() > 5
    cap = edge & (data["side"] == 0)
    assert lattice.distance(u[cap]).max() < -0.05 + 1e-4


def test_slits_thinner_than_a_part_of_a_cell_are_refused():
    """Next to faces of the domain the plates leave a slit of a tenth of d on either side."""
    wall = il.Lattice("sc_plates", through=il.macroshape.box((1, 1, 1))).offset(0.072)
    with pytest.raises(ConvergenceError, match=r"are off the offset .* use h <= 0\.04"):
        wall.mesh(0.08)


def test_all_vertices_are_looked_at_again_where_some_are_off(monkeypatch):
    seen = []

    def errors(_wall, u, _side):
        seen.append(len(u))
        return np.where(u[:, 0] > limit, 2 * _projecting.OFF, 0.0), 2

    monkeypatch.setattr(_projecting, "CHECKED", 100)
    monkeypatch.setattr(_projecting, "_errors", errors)
    u, free = np.random.default_rng(1).random((1030, 3)), np.arange(1030) % 9 != 0
    limit = 0.9
    wrong, part, mended = _projecting.not_projected(None, u, np.ones(1030), free)
    np.testing.assert_array_equal(wrong, free & (u[:, 0] > 0.9))
    assert part == pytest.approx(wrong.sum() / free.sum())
    assert (sum(seen), mended) == (free.sum(), pytest.approx(2 * len(seen) / free.sum()))
    limit = 1.0
    seen.clear()
    assert not _projecting.not_projected(None, u, np.ones(1030), free)[0].any()
    assert seen == [100]


def test_sheets_on_stretched_continuations_are_found():
    """A map whose continuation grows and bends back: feet are there, far from all other seeds."""
    combo = cb.combination(700184)
    lattice = combo.lattice()
    rng = np.random.default_rng(3)
    u = rng.random((300, 3))
    u[:150, 2], u[150:, 1] = 1.0 - 0.05 * rng.random((2, 150))
    judge_ = cb.Judge(combo, lattice, None, None)
    distance, found = judge_._distances(lattice.tile_coordinates(u), u)
    assert (found <= distance * (1.0 + 1e-6)).all()


def test_feet_in_the_domain_are_found_behind_a_continuation_that_comes_back():
    """All that was near were seeds that do not count: every twentieth query fell back to one."""
    combo = cb.combination(80003)
    lattice = combo.lattice()
    u = np.stack(np.meshgrid(*[np.linspace(0, 1, 13)] * 3, indexing="ij"), axis=-1).reshape(-1, 3)
    found = lattice.closest(u)
    assert (found.status < 2).all()
    u = u[(np.abs(u - 0.5) < 0.45).all(axis=1)][::7]
    judge_ = cb.Judge(combo, lattice, None, None)
    distance, found = judge_._distances(lattice.tile_coordinates(u), u)
    assert (found <= distance * (1.0 + 1e-6)).all()
