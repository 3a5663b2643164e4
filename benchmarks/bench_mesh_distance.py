"""Signed distances to meshes against libigl, which builds its tree in every call."""

from collections.abc import Iterator

import numpy as np

from benchmarks import references
from benchmarks.measure import Row, cpu, wall
from ilattice._typing import FloatArray, IntArray
from ilattice.mesh import SurfaceMesh
from ilattice.sdf import MeshDistance


def knot(count: int, around: int) -> tuple[FloatArray, IntArray]:
    """Tube of radius 0.35 along a trefoil, 2 count x around triangles."""
    t = np.arange(count) * 2 * np.pi / count
    centre = np.stack(
        [np.sin(t) + 2 * np.sin(2 * t), np.cos(t) - 2 * np.cos(2 * t), -np.sin(3 * t)], 1
    )
    along = np.roll(centre, -1, axis=0) - np.roll(centre, 1, axis=0)
    along /= np.linalg.norm(along, axis=1)[:, None]
    side = np.cross(along, [0.0, 0.0, 1.0])
    side /= np.linalg.norm(side, axis=1)[:, None]
    up = np.cross(along, side)
    s = (np.arange(around) * 2 * np.pi / around)[None, :, None]
    v = centre[:, None] + 0.35 * (np.cos(s) * side[:, None] + np.sin(s) * up[:, None])
    i, j = np.meshgrid(np.arange(count), np.arange(around), indexing="ij")
    a, b = i * around + j, (i + 1) % count * around + j
    c, d = (i + 1) % count * around + (j + 1) % around, i * around + (j + 1) % around
    faces = np.concatenate([np.stack([a, d, c], -1), np.stack([a, c, b], -1)]).reshape(-1, 3)
    return v.reshape(-1, 3), faces


class Knot:
    """Random points in the bounding box of a knotted tube."""

    points_are = "random"
    size = (500, 50)
    count = 100_000

    def setup(self) -> None:
        self.part = knot(*self.size)
        self.field = MeshDistance(SurfaceMesh(*self.part), strict=True)
        box = self.field.bounding_box(0.5)
        self.points = np.random.default_rng(0).uniform(*box, (self.count, 3))

    def time_build(self) -> None:
        MeshDistance(SurfaceMesh(*self.part))

    def time_distance(self) -> FloatArray:
        return self.field(self.points)

    def time_libigl(self) -> FloatArray:
        return references.libigl_distance(self.points, *self.part)


class Near(Knot):
    """Points near the surface, ordered as a contour asks for them."""

    points_are = "near"

    def setup(self) -> None:
        super().setup()
        vertices, faces = self.part
        pick = np.sort(np.random.default_rng(1).integers(len(faces), size=self.count))
        middle = vertices[faces[pick]].mean(axis=1)
        self.points = middle + np.random.default_rng(2).normal(0, 0.02, (self.count, 3))


def rows(quick: bool) -> Iterator[Row]:
    """Lines of the table."""
    for kind in (Knot, Near):
        bench = kind()
        if quick:
            bench.size, bench.count = (60, 12), 5_000
        bench.setup()
        ours, theirs = cpu(bench.time_distance, 3), cpu(bench.time_libigl, 3)
        gap = np.abs(bench.time_distance() - bench.time_libigl()).max()
        name = f"mesh distance, {len(bench.part[1])} triangles, {kind.points_are}"
        yield Row(
            f"{name} points, cpu",
            f"{1e6 * ours / bench.count:.2f} us/point, within {gap:.0e}",
            f"{1e6 * theirs / bench.count:.2f} us/point libigl, its tree included",
            theirs / ours,
            ">= 1x",
        )
    build = wall(bench.time_build, 3)
    yield Row(
        f"tree, normals and crossings of {len(bench.part[1])} triangles, wall",
        f"{1e3 * build:.0f} ms",
        f"{1e3 * wall(bench.time_libigl, 1):.0f} ms a libigl query",
        build,
    )
