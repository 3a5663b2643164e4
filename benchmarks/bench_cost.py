"""Corner-sharing tetrahedra: generation, matrices, stresses by levels, slices, beams."""

import time
from collections.abc import Iterator
from typing import Any

import numpy as np

from benchmarks.measure import Row, alone, cpu, in_turns
from ilattice._geometry import grid_points
from ilattice.cost import Beams, counting, kagome, rigidity, stress
from ilattice.cost.kagome import integers_of, simplices_of
from ilattice.cost.structure import CornerSharing


def by_numpy(level: int) -> Any:
    """The same structure by all odd tuples and a sort of the vertices."""
    n = level - 1
    k = grid_points(*[np.arange(level)] * 3)
    rows = []
    for total, sign in ((n, 1), (n - 1, -1)):
        c = k[k.sum(axis=1) <= total]
        odd = 2 * np.column_stack([c, total - c.sum(axis=1)]) + 1
        if sign > 0:
            odd = odd[odd.max(axis=1) < 2 * level - 1]
        rows.append(odd[:, None] - sign * np.eye(4, dtype=np.int64))
    vertices, place = np.unique(np.concatenate(rows).reshape(-1, 4), axis=0, return_inverse=True)
    return vertices, place.reshape(-1, 4)


def matrices(level: int) -> Iterator[Row]:
    """P1 to P3: generation, assembly, products."""
    out = integers_of(level, 3), simplices_of(level, 3)
    ours, copy = in_turns(
        lambda: (integers_of(level, 3), simplices_of(level, 3)), lambda: [a.copy() for a in out],
        15, time.process_time,
    )  # fmt: skip
    theirs = cpu(lambda: by_numpy(level), 1)
    name = f"Kagome of resolution {level}"
    yield Row(f"{name}, made", f"{ours:.3g} s", f"{copy:.3g} s a copy", ours / copy, "<= 10x")
    yield Row(f"{name}, made", f"{ours:.3g} s", f"{theirs:.3g} s numpy", theirs / ours, ">= 10x")
    k = kagome(level)
    R = rigidity.matrix(k)
    x, e = np.array(k.positions), np.array(k.edges)
    arrays = np.empty(len(e) + 1, np.int32), np.empty_like(R.indices), np.empty_like(R.data)
    ours, copy = in_turns(
        lambda: rigidity.kernels.fill(x, e, *arrays), lambda: (R.data.copy(), R.indices.copy()),
        15, time.process_time,
    )  # fmt: skip
    yield Row("rigidity matrix", f"{ours:.3g} s", f"{copy:.3g} s a copy", ours / copy, "<= 15x")
    u, s = np.random.default_rng(0).random(x.shape), np.random.default_rng(1).random(len(e))
    out1, out2, T = np.empty(len(e)), np.zeros_like(x), R.T.tocsr()
    for told, work, other in (
        ("R u", lambda: rigidity.kernels.stretch(x, e, u, out1), lambda: R @ u.ravel()),
        ("R^T s", lambda: rigidity.kernels.gather(x, e, s, out2), lambda: T @ s),
    ):
        ours, theirs = in_turns(work, other, 60, time.process_time)  # milliseconds
        yield Row(f"{told} without matrix", f"{ours:.3g} s", f"{theirs:.3g} s scipy csr",
                  theirs / ours, ">= 1x")  # fmt: skip


def levels(times: int) -> Iterator[Row]:
    """P5: stresses by levels, times per level."""
    k = kagome(5).stiffened()
    before = 0.0
    for i in range(times):
        k = k.refined()
        f = stress.balanced(k, np.random.default_rng(i).standard_normal(k.positions.shape))
        found = k.stress(f)
        now = cpu(lambda k=k, f=f: k.stress(f), 2)
        if i >= times - 2 and before:
            yield Row(f"stresses, {len(k.positions)} vertices, level {i + 1}",
                      f"{now:.3g} s, residual {found.residual:.0e}", f"{before:.3g} s a level less",
                      now / before, "<= 5x")  # fmt: skip
        before = now


def pebbles(level: int) -> Iterator[Row]:
    """P4: the pebble game against PyRigi, where that is installed."""
    k = kagome(level, dim=2).perturbed().stiffened()
    n, e = len(k.positions), np.array(k.edges)
    ours = cpu(lambda: counting.pebble_rank(n, e), 3)
    try:
        import pyrigi
    except ImportError:
        yield Row(f"pebble game, {n} vertices", f"{ours:.3g} s", "PyRigi is not installed", ours)
        return
    graph = pyrigi.Graph.from_vertices_and_edges(list(range(n)), [tuple(p) for p in e.tolist()])
    theirs = cpu(lambda: graph.is_min_rigid(dim=2), 1)
    yield Row(f"pebble game, {n} vertices", f"{ours:.3g} s", f"{theirs:.3g} s PyRigi",
              theirs / ours, ">= 50x")  # fmt: skip


def beams(level: int, count: int) -> Iterator[Row]:
    """Fields of many beams against all of them one by one, and a k-d tree of samples."""
    from scipy.spatial import cKDTree

    k = kagome(level)
    solid = k.beams(0.1 * k.lengths.mean())
    p = np.random.default_rng(0).uniform(0, 1, (count, 3))
    solid(p[:1])
    ours = cpu(lambda: solid(p), 2) / count
    few = p[:20]
    a, b = solid.vertices[solid.pairs[:, 0]], solid.vertices[solid.pairs[:, 1]]

    def naive() -> Any:
        d = b - a
        t = np.clip(((few[:, None] - a) * d).sum(2) / (d * d).sum(1), 0.0, 1.0)
        return np.linalg.norm(few[:, None] - a - t[..., None] * d, axis=2).min(axis=1)

    theirs = cpu(naive, 1) / len(few)
    yield Row(f"field of {len(a)} beams", f"{1e6 * ours:.3g} us a point",
              f"{1e6 * theirs:.3g} us all of them", theirs / ours)  # fmt: skip
    t = np.linspace(0, 1, 9)[:, None, None]
    tree = cKDTree((a + t * (b - a)).reshape(-1, 3))
    theirs = cpu(lambda: tree.query(p), 1) / count
    yield Row(f"field of {len(a)} beams", f"{1e6 * ours:.3g} us a point",
              f"{1e6 * theirs:.3g} us a k-d tree of 9 samples each", theirs / ours)  # fmt: skip


def build(level: int) -> Iterator[Row]:
    """Time to make the tree of many beams."""
    k: CornerSharing = kagome(level)
    x, e, r = k.positions, k.edges, np.full((len(k.edges), 2), 0.1 * k.lengths.mean())
    now = cpu(lambda: Beams(x, e, r)._tree, 1)
    yield Row(f"tree of {len(e)} beams", f"{now:.3g} s", "10 s for a million", now, "<= 10")


def rows(quick: bool) -> Iterator[Row]:
    """Lines of the table."""
    yield from matrices(20 if quick else 53)
    yield from pebbles(8 if quick else 20)
    yield from levels(2 if quick else 4)
    yield from beams(10 if quick else 37, 2000 if quick else 50_000)
    yield from build(15 if quick else 79)
    found = alone("benchmarks.bench_cost", *(["20"] if quick else ["114"]))
    grown = found["peak"] - found["before"]
    yield Row(
        f"slice of {found['vertices']:.0f} vertices, no array of them, MB",
        f"{found['seconds']:.3g} s, {found['edges']:.0f} edges, {grown:.0f} MB",
        f"{found['before']:.0f} MB before",
        grown,
        "<= 200",
    )


def _slice(level: int) -> None:
    """One slice in a process of its own: its peak memory in MB."""
    import json
    import resource

    from ilattice.cost import Blocks, slicing

    list(slicing.crossings(Blocks(4), 0.4))
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    start = time.process_time()
    blocks = Blocks(level)
    edges = sum(len(e) for e in slicing.crossings(blocks, 0.37))
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    print(json.dumps({"vertices": blocks.vertices, "edges": edges, "before": before, "peak": peak,
                      "seconds": time.process_time() - start}))  # fmt: skip


if __name__ == "__main__":
    import sys

    _slice(int(sys.argv[1]))
