"""Trees over many segments, alone and with copies in other cells, against SciPy's of points."""

import time
from collections.abc import Iterator

import numpy as np

from benchmarks.measure import Row, in_turns
from ilattice.tiles import SkeletonField


def rows(quick: bool) -> Iterator[Row]:
    """Lines of the table."""
    from scipy.spatial import cKDTree

    count = 5_000 if quick else 100_000
    rng = np.random.default_rng(0)
    start = rng.random((count, 1, 3))
    ends = np.concatenate([start, 0.98 * start + 0.02 * rng.random((count, 1, 3))], axis=1)
    middle = ends.mean(axis=1)
    for faces, goal in (("open", "<= 20x"), ("periodic", "<= 40x")):
        ours, theirs = in_turns(
            lambda faces=faces: SkeletonField(ends, 0.001, faces=faces),  # type: ignore[misc]
            lambda: cKDTree(middle), 5, time.process_time,
        )  # fmt: skip
        yield Row(
            f"skeleton of {count} segments, {faces} faces, built, cpu",
            f"{ours:.2g} s",
            f"{theirs:.2g} s scipy cKDTree of their middles",
            ours / theirs,
            goal,
        )
