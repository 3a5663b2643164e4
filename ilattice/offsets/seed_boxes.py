"""Order of seeds in memory, and boxes around what they stand for, to sweep through.

Guarantee: what a seed stands for lies in its box, and in the slab of it. Non-guarantee: boxes are
tight only where seeds that follow each other in memory are next to each other in space.
"""

from __future__ import annotations

from itertools import pairwise
from typing import NamedTuple

import numpy as np
from scipy.spatial import cKDTree

from ilattice._geometry import inverses
from ilattice._typing import FloatArray, IntArray
from ilattice.offsets import _kernels_sweep
from ilattice.offsets._kernels_patches import AROUND, PLAIN, SAGITTA

#: Most places along an axis by which seeds are put in order.
BITS = (1 << 14) - 1
#: Levels of boxes, from the lowest one, that have slabs.
SLABS = 5


class Boxes(NamedTuple):
    """Boxes around what seeds stand for, see `_kernels_sweep`.

    Attributes
    ----------
    lo, hi : ndarray, shape (b, 3)
        Corners of the boxes.
    slab : ndarray, shape (b, 5)
        Directions in which what they hold is thin where cells are squeezed, and its ends along
        these; zero and infinite where it is not, and far up.
    first : ndarray, shape (levels + 1,)
        Where the levels of boxes begin, lowest first, and end.
    """

    lo: FloatArray
    hi: FloatArray
    slab: FloatArray
    first: IntArray

    @classmethod
    def of(cls, x: FloatArray, normal: FloatArray, spacing: FloatArray) -> Boxes:
        """Boxes around what seeds next to each other in memory stand for.

        Parameters
        ----------
        x : ndarray, shape (s, 3)
            Seeds in space, see `in_order`.
        normal, spacing : ndarray, shape (s, k) and (s,)
            Their normals and cells, and their spacings, see `_kernels_patches`.

        Returns
        -------
        Boxes
            The boxes.
        """
        half = _halves(normal, spacing)
        lo, hi = x - half, x + half
        ends: list[tuple[FloatArray, FloatArray]] = []
        first, size = [0], _kernels_sweep.LEAF
        while not ends or len(lo) > 1:
            at = np.arange(0, len(lo), size)
            lo, hi = np.minimum.reduceat(lo, at), np.maximum.reduceat(hi, at)
            ends.append((lo, hi))
            first.append(first[-1] + len(lo))
            size = _kernels_sweep.FAN
        los, his = (np.concatenate(a) for a in zip(*ends, strict=True))
        return cls(los, his, _slabs(x, normal, first), np.array(first))


def in_order(p: FloatArray, x: FloatArray, normal: FloatArray) -> IntArray:
    """Order in which seeds that are next to each other in space are so in memory.

    Parameters
    ----------
    p, x : ndarray, shape (s, 3)
        Seeds in tile coordinates and in space.
    normal : ndarray, shape (s, k)
        Their normals and cells, see `_kernels_patches`: where cells are squeezed, seeds next to
        each other in tiles follow each other, for in space there are others between them.

    Returns
    -------
    ndarray, shape (s,)
        Their numbers.
    """
    if normal.shape[1] == PLAIN:
        return np.asarray(cKDTree(x).indices, np.int64)
    return np.argsort(_morton(p), kind="stable")


def _morton(p: FloatArray) -> IntArray:
    """Numbers of points (n, 3) along a curve that stays near: the bits of their coordinates."""
    lo, hi = p.min(axis=0), p.max(axis=0)
    q = ((p - lo) * (BITS / max(float((hi - lo).max()), 1e-300))).astype(np.uint64)
    out = np.zeros(len(p), np.uint64)
    for k in range(BITS.bit_length()):
        for a in range(3):
            out |= ((q[:, a] >> np.uint64(k)) & np.uint64(1)) << np.uint64(3 * k + a)
    return out.astype(np.int64)


def _slabs(x: FloatArray, normal: FloatArray, first: list[int]) -> FloatArray:
    """Slabs (b, 5) around what the seeds of boxes stand for, see `Boxes`."""
    out = np.tile([0.0, 0.0, 0.0, -np.inf, np.inf], (first[-1], 1))
    if normal.shape[1] == PLAIN:
        return out
    cells, bend = normal[:, PLAIN:SAGITTA].reshape(-1, 3, 3), normal[:, SAGITTA]
    told = np.asarray(cells.any(axis=(1, 2)))
    cells = np.where(told[:, None, None], cells, np.eye(3))
    sides = inverses(cells)
    size = np.linalg.norm(cells, axis=2)
    thin = np.take_along_axis(cells, size.argmax(axis=1)[:, None, None], axis=1)[:, 0]
    thin /= size.max(axis=1)[:, None]
    width = _kernels_sweep.LEAF
    for i, j in pairwise(first[: SLABS + 1]):
        at = np.arange(0, len(x), width)
        way = np.add.reduceat(thin, at)
        way /= np.maximum(np.linalg.norm(way, axis=1), 1e-300)[:, None]
        each = np.repeat(way, width, axis=0)[: len(x)]
        middle = np.einsum("sa,sa->s", x, each)
        half = AROUND * np.abs(np.einsum("sa,sak->sk", each, sides)).sum(axis=1) + bend
        half = np.where(told, half, np.inf)
        out[i:j, :3] = way
        out[i:j, 3] = np.minimum.reduceat(middle - half, at)
        out[i:j, 4] = np.maximum.reduceat(middle + half, at)
        width *= _kernels_sweep.FAN
    return out


def _halves(normal: FloatArray, spacing: FloatArray) -> FloatArray:
    """Half the sides (s, 3) of boxes around what seeds stand for."""
    out = np.repeat(_kernels_sweep.ACROSS * spacing[:, None], 3, axis=1)
    if normal.shape[1] > PLAIN:
        cells, bend = normal[:, PLAIN:SAGITTA], normal[:, SAGITTA]
        told = np.flatnonzero(cells.any(axis=1))
        sides = np.abs(inverses(cells[told].reshape(-1, 3, 3))).sum(axis=2)
        out[told] = AROUND * sides + bend[told, None]
    return out
