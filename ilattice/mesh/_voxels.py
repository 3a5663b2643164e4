"""Voxels in which triangles near others are found.

Guarantee: a triangle of which the box touches that of a marked one is found; so are some others.
"""

from typing import NamedTuple, Self

import numpy as np

from ilattice._typing import AnyArray, FloatArray
from ilattice._validate import seen
from ilattice.mesh import _kernels_crossings as kernels

#: So few voxels each way that there are as many as the root of the number of triangles divided by
#: this.
PER_VOXEL = 4.0


def extent(vertices: AnyArray) -> FloatArray:
    """Least and largest coordinates (2, 3) of vertices."""
    out = np.empty((2, 3))
    kernels.extent(seen(vertices), out)
    return out


class Voxels(NamedTuple):
    """A grid of n voxels each way from `low` on, `scale` (3,) of them per length."""

    low: FloatArray
    scale: FloatArray
    n: int

    @classmethod
    def over(cls, low: FloatArray, size: AnyArray, triangles: int, most: int) -> Self:
        """As many as suit a number of triangles, at most so many each way."""
        n = int(np.clip(triangles**0.5 / PER_VOXEL, 1, most))
        return cls(low, n / np.maximum(size, np.finfo(np.float64).tiny), n)

    def of(self, x: AnyArray) -> AnyArray:
        """Voxels (V, 3) of points; the outermost hold what is beyond them."""
        out = np.empty((len(x), 3), np.uint8)
        kernels.voxels(seen(x), self.low, self.scale, self.n, out)
        return out

    def marked(self, voxel: AnyArray, faces: AnyArray, active: AnyArray) -> AnyArray:
        """Marks (n, n, n) of those that the boxes of active triangles touch."""
        mask = np.zeros((self.n,) * 3, np.bool_)
        kernels.mark_voxels(voxel, _corners(faces, len(voxel)), active, mask)
        return mask


def in_marked(voxel: AnyArray, faces: AnyArray, mask: AnyArray) -> AnyArray:
    """Triangles (F,) of which the boxes touch marked voxels, from the voxels of the vertices."""
    out = np.empty(len(faces), np.bool_)
    kernels.in_voxels(len(faces), voxel, _corners(faces, len(voxel)), mask, out)
    return out


def _corners(faces: AnyArray, vertices: int) -> AnyArray:
    """Faces as in meshes, and read-only, so that there is one kernel."""
    return seen(faces.astype(np.int32, copy=False) if vertices < 2**31 else faces)
