"""Pieces of periodic solids, and the ways between their copies."""

import numpy as np
import pytest

from ilattice.homogenize.percolation import percolation

X, Y, Z = np.eye(3, dtype=int)
STILL = np.zeros(3, int)


def found(count, edges):
    low, high, steps = zip(*edges, strict=True) if edges else ((), (), ())
    return percolation(
        count, np.array(low, int), np.array(high, int), np.array(steps, int).reshape(-1, 3)
    )


def test_islands_rods_sheets_and_networks():
    p = found(5, [(0, 1, STILL), (1, 0, X), (2, 2, Y), (2, 2, Z), (3, 4, Y), (3, 4, Y)])
    assert list(p.labels) == [0, 0, 1, 2, 2]
    assert list(p.ranks) == [1, 2, 0]
    assert p.axes == (True, True, True)
    assert list(p.shifts[4] - p.shifts[3]) == [0, 1, 0]


def test_nothing_hangs_together():
    p = found(3, [])
    assert list(p.ranks) == [0, 0, 0]
    assert p.axes == (False, False, False)


def test_a_diagonal_way_goes_on_along_two_edges():
    p = found(2, [(0, 1, X), (1, 0, Y)])
    assert [w.tolist() for w in p.ways] == [[[1, 1, 0]]]
    assert p.axes == (True, True, False)


def test_around_a_corner_and_back_is_no_way():
    p = found(4, [(0, 1, X), (1, 2, Y), (3, 2, X), (0, 3, Y)])
    assert list(p.ranks) == [0]


@pytest.mark.parametrize("seed", range(4))
def test_ranks_by_growing_pieces_in_many_cells(seed):
    """Voxels in 5³ copies of a cell: a piece goes on as far as its copies are one piece there."""
    rng = np.random.default_rng(seed)
    n, copies = 4, 5
    solid = rng.random((n, n, n)) < 0.36
    number = np.cumsum(solid.ravel()).reshape(solid.shape) - 1
    edges = []
    for a, way in enumerate((X, Y, Z)):
        other = np.roll(solid, -1, axis=a)
        for at in np.argwhere(solid & other):
            to = at + way
            edges.append((number[tuple(at)], number[tuple(to % n)], way * (to[a] == n)))
    p = found(int(solid.sum()), edges)
    from scipy.ndimage import label

    many, _ = label(np.tile(solid, (copies,) * 3))
    middle = many[2 * n : 3 * n, 2 * n : 3 * n, 2 * n : 3 * n]
    for piece in range(len(p.ways)):
        cells = np.argwhere(solid)[p.labels == piece]
        at = 2 * n + cells[0]
        same = []
        for step in np.argwhere(np.ones((copies,) * 3)) - 2:
            there = at + n * step
            if many[tuple(there)] == middle[tuple(cells[0])]:
                same.append(step)
        assert np.linalg.matrix_rank(np.array(same)) <= len(p.ways[piece])
        if len(p.ways[piece]) and np.abs(p.ways[piece]).max() <= 1:
            assert np.linalg.matrix_rank(np.array(same)) == len(p.ways[piece])
