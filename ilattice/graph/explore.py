"""Random graphs: trusses, direct and conjugate surfaces, with and without symmetry; and a table.

A seed and a kind are a graph, for ever. What is drawn is valid by the rules of the nodes; whether
a conjugate surface exists is found out when it is evaluated.

Guarantees: `random_graph` returns a graph, or, for conjugate ones, raises the `GraphError` of what
was drawn when it is evaluated. The table is that of `ilattice.homogenize.sweep`, with its
guarantees.
"""

import os
from collections.abc import Sequence
from concurrent.futures import Executor
from functools import partial
from typing import Any

import numpy as np

from ilattice._progress import Progress
from ilattice._typing import FloatArray
from ilattice._validate import as_choice, as_items, as_positive, as_whole
from ilattice.graph import build
from ilattice.graph.graph import Graph
from ilattice.graph.skeletons import THICKNESS, Skeleton
from ilattice.graph.ways import ways
from ilattice.homogenize.rows import Rows
from ilattice.homogenize.sweep import sweep
from ilattice.minimal import FaceLoop, cuboid, tetrahedron

KINDS = ("truss", "direct", "conjugate", "asymmetric")
#: Places of vertices are multiples of this.
_STEP = 1.0 / 16.0
#: Largest seed of a random graph: one of 32 bits.
_MAX_SEED = 2**32 - 1


def random_graph(kind: str, seed: int, *, thickness: float = THICKNESS) -> Graph:
    """A random graph.

    Parameters
    ----------
    kind : {"truss", "direct", "conjugate", "asymmetric"}
        Beams in a tetrahedron with 48 images; a shell over a random polygon in an octant; a minimal
        surface along a way of faces of a random box, on which there is one in a cube; shells over
        random polygons in the cell, without any symmetry.
    seed : int
        Equal seeds are equal graphs.
    thickness : float
        Of all beams and shells.

    Returns
    -------
    Graph
        The graph.

    Examples
    --------
    >>> a, b = (random_graph("truss", 3) for _ in range(2))
    >>> a.digest == b.digest
    True
    """
    kind = as_choice("kind", kind, KINDS)
    seed = as_whole("seed", seed, 0, _MAX_SEED)
    rng = np.random.default_rng([KINDS.index(kind), seed])
    make: Any = {
        "truss": _truss, "direct": _direct, "conjugate": _conjugate, "asymmetric": _asymmetric,
    }[kind]  # fmt: skip
    return make(rng, thickness, f"{kind}_{seed}")


def explore(
    kind: str, seeds: int | Sequence[int] = 10, *, thickness: Any = THICKNESS,
    table: str | os.PathLike[str] | None = None, method: str = "voxels", cells: int = 32,
    young: float = 1.0, poisson: float = 0.3, executor: Executor | None = None,
    progress: Progress = None,
) -> Rows:  # fmt: skip
    """Effective stiffness of random graphs, as rows of a table.

    Parameters
    ----------
    kind : {"truss", "direct", "conjugate", "asymmetric"}
        See `random_graph`.
    seeds : int or sequence of int
        How many, or which.
    thickness : float or sequence of float
        Of all beams and shells.
    table : path-like, optional
        CSV file of rows, which an interrupted exploration goes on with.
    method : {"voxels", "cut"}
        See `Graph.homogenize`.
    cells : int
        Voxels or cells per direction.
    young, poisson : float
        Of the base material.
    executor : concurrent.futures.Executor, optional
        Where rows are computed at the same time.
    progress : bool or callable, optional
        See `ilattice._progress.track`.

    Returns
    -------
    Rows
        Density, moduli, bounds; `Rows.plot` draws them. ``message`` tells why a graph has none.
    """
    many = range(as_whole("seeds", seeds, 1, 10**6)) if np.ndim(seeds) == 0 else seeds
    numbers = [as_whole("seeds", s, 0, _MAX_SEED) for s in as_items("seeds", list(many))]  # type: ignore[arg-type]
    cells = as_whole("cells", cells, 2, 512)
    count = cells if as_choice("method", method, ("voxels", "cut")) == "voxels" else 0
    if isinstance(thickness, (list, tuple, np.ndarray)):
        thickness = [as_positive("thickness", t) for t in as_items("thickness", thickness)]
    else:
        thickness = as_positive("thickness", thickness)
    maker = partial(solid, kind=as_choice("kind", kind, KINDS), voxels=count)
    return sweep(
        maker, table=table, cells=cells, young=young, poisson=poisson, executor=executor,
        progress=progress, seed=numbers, thickness=thickness,
    )  # fmt: skip


def solid(*, kind: str, seed: int, thickness: float, voxels: int = 0) -> Any:
    """The solid of a random graph, as sweeps take it.

    Parameters
    ----------
    kind, seed, thickness : optional
        See `random_graph`.
    voxels : int
        Voxels per edge; 0 for none.

    Returns
    -------
    ndarray, Wall or Tile
        Voxels, or what is cut.
    """
    graph = random_graph(kind, seed, thickness=thickness)
    return graph.voxels(voxels) if voxels else graph.solid_of_cell()


# --- kinds ------------------------------------------------------------------------------------


def _place(rng: Any, low: FloatArray, high: FloatArray) -> FloatArray:
    """A random point of a box, on the raster."""
    counts = np.rint((high - low) / _STEP).astype(int)
    return low + _STEP * np.array([rng.integers(0, n + 1) for n in counts])


def _truss(rng: Any, thickness: float, name: str) -> Graph:
    """A way through random points of the tetrahedron, which starts and ends on its boundary."""
    region = tetrahedron()
    corners = region.corners
    faces = [np.flatnonzero(np.abs(corners @ n - d) < 1e-9) for n, d in zip(
        region.normals, region.offsets, strict=True)]  # fmt: skip
    count = int(rng.integers(2, 5))
    points: list[FloatArray] = []
    while len(points) < count:
        rows = faces[int(rng.integers(len(faces)))]
        if 0 < len(points) < count - 1 and rng.random() < 0.5:
            rows = np.arange(len(corners))
        w = rng.multinomial(8, np.full(len(rows), 1.0 / len(rows))) / 8.0
        p = w @ corners[rows]
        if all(np.abs(p - q).max() > 1e-6 for q in points):
            points.append(p)
    line = build.line(build.chain([build.vertex(p) for p in points]), thickness=thickness)
    return Graph(build.object(line.completed(region)), region, name)


def _polygon(rng: Any, low: FloatArray, high: FloatArray, thickness: float) -> Skeleton:
    """A direct surface over a random polygon, smooth or not."""
    while True:
        p = np.unique([_place(rng, low, high) for _ in range(int(rng.integers(3, 7)))], axis=0)
        p = rng.permutation(p, axis=0)
        if len(p) < 3 or np.linalg.svd(p - p.mean(axis=0))[1][1] < 0.5 * _STEP:
            continue
        angles = _corners(p)
        if angles.min() > np.radians(15.0) and not _meets_itself(p):
            break
    vertices = [build.vertex(q) for q in p]
    chain = build.chain(vertices, closed=True)
    return build.surface(chain, thickness=thickness, edges=8)


def _corners(p: FloatArray) -> FloatArray:
    """Angles of a polygon."""
    a, b = np.roll(p, 1, axis=0) - p, np.roll(p, -1, axis=0) - p
    cos = (a * b).sum(1) / (np.linalg.norm(a, axis=1) * np.linalg.norm(b, axis=1))
    angles: FloatArray = np.arccos(np.clip(cos, -1.0, 1.0))
    return angles


def _meets_itself(p: FloatArray) -> bool:
    """Whether sides that are no neighbours come near each other."""
    t = (np.arange(17) / 16)[:, None]
    n = len(p)
    sides = [(1 - t) * p[i] + t * p[(i + 1) % n] for i in range(n)]
    for i in range(n):
        for j in range(i + 2, n - (i == 0)):
            gap = np.linalg.norm(sides[i][:, None] - sides[j][None], axis=2).min()
            if gap < 0.5 * _STEP:
                return True
    return False


def _direct(rng: Any, thickness: float, name: str) -> Graph:
    region = cuboid()
    patch = _polygon(rng, np.zeros(3), np.full(3, 0.5), thickness)
    return Graph(build.object(patch.completed(region)), region, name)


def _asymmetric(rng: Any, thickness: float, name: str) -> Graph:
    count = int(rng.integers(2, 5))
    patches = [_polygon(rng, np.zeros(3), np.ones(3), thickness) for _ in range(count)]
    return Graph(build.object(build.group(patches)), None, name)


#: Ways along the faces of a box, up to its symmetries, on which a surface is found in a cube: of
#: all with at most eight sides. Of the others it is not known whether there is one.
SOLVED = (
    "x- y- z- x+ y+ z+", "x- y- z- x+ z+ y+", "x- y- x- z- x+ y+ z+", "x- y- x- y- z- y+ x+ z+",
    "x- y- x- z- x+ y+ x+ z+", "x- y- x- z- y+ x+ y+ z+", "x- y- z- x- y+ z- x+ z+",
)  # fmt: skip


def _conjugate(rng: Any, thickness: float, name: str) -> Graph:
    """A way of faces of a random box of mirrors, or of a tetrahedron."""
    if rng.random() < 0.1:
        region = tetrahedron()
        loops = ways(region, 4)
        loop = loops[int(rng.integers(len(loops)))]
    else:
        region = cuboid([0.5 / int(rng.integers(1, 3)) for _ in range(3)])
        axes, turned = rng.permutation(3), rng.integers(0, 2, 3)
        words = SOLVED[int(rng.integers(len(SOLVED)))].split()
        numbers = [("xyz".index(w[0]), w[1] == "+") for w in words]
        loop = region.faces(["xyz"[axes[a]] + "-+"[int(up) ^ int(turned[a])] for a, up in numbers])
    vertices = [build.vertex(p) for p in _between(loop, rng)]
    chain = build.chain(vertices, closed=True)
    patch = build.surface(chain, kind="conjugate", thickness=thickness, edges=8)
    return Graph(build.object(patch.completed(region)), region, name)


def _between(loop: FaceLoop, rng: Any) -> FloatArray:
    """Points of the edges between neighbouring faces, no two at one place."""
    out: list[FloatArray] = []
    numbers = loop.numbers
    for i in range(len(numbers)):
        a, b = loop.region.edge(numbers[i - 1], numbers[i])
        while True:
            t = float(rng.integers(1, 16)) / 16.0
            p = (1 - t) * a + t * b
            if all(np.abs(p - q).max() > 1e-6 for q in out):
                break
        out.append(p)
    return np.array(out)
