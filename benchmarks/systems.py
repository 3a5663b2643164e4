"""Stiffness matrices of periodic lattices in a box, on cut cells: test systems for solvers.

Trilinear hexahedra, E = 1, nu = 0.3, tiles of edge 1 with `per_tile` cells per edge. Cut cells are
integrated over those of 6³ samples that lie inside, so that every tile has the same cells.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numba import njit, prange
from scipy.ndimage import generate_binary_structure, label
from scipy.sparse import bsr_array

from ilattice._geometry import grid_points
from ilattice._typing import AnyArray, FloatArray
from ilattice.linalg.symmetric import Symmetric

SAMPLES = 6
#: Weight of the void in cut cells: some hold fewer samples than it takes to be stiff.
GUARD = 1e-6
CORNERS = np.array([(i, j, k) for i in (0, 1) for j in (0, 1) for k in (0, 1)])


@dataclass(frozen=True, eq=False)
class System:
    """K u = f with what a solver may know about it.

    Attributes
    ----------
    K : bsr_array, shape (n, n), or Symmetric
        Stiffness of the free nodes, blocks 3 x 3 (or 1 x 1 for heat).
    f : ndarray, shape (n,)
        Loads.
    modes : ndarray, shape (n, 6)
        Rigid-body modes (n, 6), or ones (n, 1).
    coordinates : ndarray, shape (nodes, 3)
        Where the nodes are.
    """

    K: Any
    f: FloatArray
    modes: FloatArray
    coordinates: FloatArray


def cross(u: FloatArray) -> AnyArray:
    """Three struts of radius 0.18 along the axes of a tile."""
    d = (u - 0.5) ** 2
    return np.stack([d[:, 1] + d[:, 2], d[:, 2] + d[:, 0], d[:, 0] + d[:, 1]]).min(0) < 0.18**2


def sheet(level: float = 0.5) -> Any:
    """The gyroid's sheet |g| < level of a tile."""

    def inside(u: FloatArray) -> AnyArray:
        s, c = np.sin(2 * np.pi * u), np.cos(2 * np.pi * u)
        return np.abs((s * np.roll(c, -1, axis=1)).sum(axis=1)) < level

    return inside


def solid(u: FloatArray) -> AnyArray:
    """The whole tile."""
    return np.ones(len(u), bool)


def system(
    inside: Any,
    cells: tuple[int, int, int],
    *,
    per_tile: int = 8,
    fixed: str = "z0",
    slivers: float = 0.0,
    heat: bool = False,
    hanging: bool = False,
    seed: int = 1,
    half: bool = False,
) -> System:
    """Elasticity, or heat, on the cells of a lattice under a body load (0, 0, -0.2).

    Parameters
    ----------
    inside : callable
        From points (n, 3) of the unit tile to whether they are solid.
    cells : tuple of int
        Cells of the grid.
    per_tile : int
        Cells per tile.
    fixed : str
        Faces whose nodes are fixed: words of axis and 0 or 1, as in "x0 x1".
    slivers : float
        Part of the cut cells that are scaled by 10^(-6 U), U uniform.
    heat : bool
        One unknown per node in place of three.
    hanging : bool
        Keep parts that do not hang together by faces.
    seed : int
        Of the slivers.
    half : bool
        Make the blocks of K on and right of the diagonal only, as analyses do.

    Returns
    -------
    System
        On the nodes of the cells that hang together by faces and touch a fixed one.
    """
    fractions, matrices = _tile(inside, per_tile, heat)
    index = np.stack(np.meshgrid(*(np.arange(n) % per_tile for n in cells), indexing="ij"))
    kind = np.ravel_multi_index(tuple(index), (per_tile,) * 3)
    active = fractions[kind] > 0
    if not hanging:
        active = _supported(active, fixed)
    scale = active.astype(float)
    cut = active & (fractions[kind] < 1)
    random = np.random.default_rng(seed)
    chosen = cut & (random.random(cells) < slivers)
    scale[chosen] = 10.0 ** (-6 * random.random(int(chosen.sum())))
    free = _nodes(active) & ~_fixed_nodes(cells, fixed)
    number = np.full(free.shape, -1, np.int32)
    number[free] = np.arange(free.sum())
    m = 1 if heat else 3
    counts = np.zeros(int(free.sum()) + 1, np.int32)
    cells_of = (number, kind, scale, matrices, half, m)
    _fill(*cells_of, counts, np.empty(0, np.int32), np.empty((0, m, m)))
    offsets = np.cumsum(counts, dtype=np.int32)
    columns = np.empty(offsets[-1], np.int32)
    blocks = np.empty((offsets[-1], m, m))
    _fill(*cells_of, offsets, columns, blocks)
    n = m * (len(offsets) - 1)
    K = Symmetric(offsets, columns, blocks) if half else (
        bsr_array((blocks, columns, offsets), shape=(n, n))
    )  # fmt: skip
    coordinates = np.argwhere(free) / per_tile
    return System(
        K, _load(fractions[kind] * scale, free, per_tile, m), modes(coordinates, m), coordinates
    )


def modes(coordinates: FloatArray, m: int = 3) -> FloatArray:
    """Rigid-body modes of nodes (3 n, 6), or ones (n, 1)."""
    if m == 1:
        return np.ones((len(coordinates), 1))
    out = np.zeros((len(coordinates), 3, 6))
    x, y, z = (coordinates - coordinates.mean(axis=0)).T
    out[:, :, :3] = np.eye(3)
    out[:, 1, 3], out[:, 2, 3] = -z, y
    out[:, 2, 4], out[:, 0, 4] = -x, z
    out[:, 0, 5], out[:, 1, 5] = -y, x
    return out.reshape(-1, 6)


def _tile(inside: Any, n: int, heat: bool) -> tuple[FloatArray, FloatArray]:
    """Solid part (n³,) and matrix (n³, 24, 24) of every cell of a tile."""
    s = (np.arange(SAMPLES) + 0.5) / SAMPLES
    local = grid_points(s, s, s)
    first = grid_points(*(np.arange(n),) * 3)
    solid = inside(((first[:, None] + local).reshape(-1, 3)) / n).reshape(n**3, -1)
    g = 0.5 + np.array([-0.5, 0.5]) / np.sqrt(3)
    gauss = grid_points(g, g, g)
    at_samples, whole = (_products(p, heat) / (len(p) * n) for p in (local, gauss))
    matrices = np.tensordot(solid.astype(float), at_samples, axes=1)
    part = solid.mean(axis=1)
    cut = (part > 0) & (part < 1)
    matrices[cut] += GUARD * (whole.sum(axis=0) - matrices[cut])
    matrices[part == 1] = whole.sum(axis=0)
    return part, matrices


def _products(points: FloatArray, heat: bool) -> FloatArray:
    """Integrand (n, 24, 24), or (n, 8, 8), at points of the unit cell."""
    factors = np.where(CORNERS == 1, points[:, None], 1 - points[:, None])
    slope = np.stack([np.delete(factors, c, axis=2).prod(axis=2) for c in range(3)], axis=-1)
    slope *= 2 * CORNERS - 1
    if heat:
        return np.einsum("pai,pbi->pab", slope, slope)
    lame, shear = 0.3 / (1.3 * 0.4), 1 / 2.6
    eye = np.eye(3)
    out = lame * np.einsum("pai,pbj->paibj", slope, slope)
    out += shear * np.einsum("paj,pbi->paibj", slope, slope)
    out += shear * np.einsum("pak,pbk,ij->paibj", slope, slope, eye)
    return out.reshape(len(points), 24, 24)


def _supported(active: AnyArray, fixed: str) -> AnyArray:
    """The cells that hang together by faces with one at a fixed face, or the largest part."""
    parts, _ = label(active, generate_binary_structure(3, 1))
    seeds = [np.moveaxis(parts, "xyz".index(w[0]), 0)[-int(w[1])] for w in fixed.split()]
    known = np.unique(np.concatenate([s.ravel() for s in seeds])) if seeds else None
    if known is None:
        known = np.bincount(parts.ravel())[1:].argmax() + 1
    return active & np.isin(parts, known)


def _nodes(active: AnyArray) -> AnyArray:
    out = np.zeros(np.add(active.shape, 1), bool)
    for i, j, k in CORNERS:
        a, b, c = active.shape
        out[i : i + a, j : j + b, k : k + c] |= active
    return out


def _fixed_nodes(cells: tuple[int, int, int], fixed: str) -> AnyArray:
    out = np.zeros(np.add(cells, 1), bool)
    for word in fixed.split():
        np.moveaxis(out, "xyz".index(word[0]), 0)[-int(word[1])] = True
    return out


def _load(fraction: FloatArray, free: AnyArray, per_tile: int, m: int) -> FloatArray:
    total = np.zeros(free.shape)
    a, b, c = fraction.shape
    for i, j, k in CORNERS:
        total[i : i + a, j : j + b, k : k + c] += fraction / (8 * per_tile**3)
    out = np.zeros((int(free.sum()), m))
    out[:, -1] = -0.2 * total[free]
    return out.ravel()


@njit(cache=True, parallel=True)
def _fill(
    number: Any,
    kind: Any,
    scale: Any,
    matrices: Any,
    half: bool,
    m: int,
    offsets: Any,
    columns: Any,
    out: Any,
) -> None:
    """Count (without `columns`) or write the blocks of every row."""
    n0, n1, n2 = kind.shape
    counting = len(columns) == 0
    for i in prange(n0 + 1):
        for j in range(n1 + 1):
            for k in range(n2 + 1):
                row = number[i, j, k]
                if row < 0:
                    continue
                to = 0 if counting else offsets[row]
                for a in range(max(i - 1, 0), min(i + 2, n0 + 1)):
                    for b in range(max(j - 1, 0), min(j + 2, n1 + 1)):
                        for c in range(max(k - 1, 0), min(k + 2, n2 + 1)):
                            if number[a, b, c] < (row if half else 0):
                                continue
                            shared = False
                            if not counting:
                                out[to] = 0.0
                            for p in range(max(i, a) - 1, min(i, a) + 1):
                                for q in range(max(j, b) - 1, min(j, b) + 1):
                                    for r in range(max(k, c) - 1, min(k, c) + 1):
                                        if p < 0 or q < 0 or r < 0 or p >= n0 or q >= n1 or r >= n2:
                                            continue
                                        s = scale[p, q, r]
                                        if s == 0.0:
                                            continue
                                        shared = True
                                        if counting:
                                            continue
                                        e = m * (((i - p) * 2 + j - q) * 2 + k - r)
                                        f = m * (((a - p) * 2 + b - q) * 2 + c - r)
                                        M = matrices[kind[p, q, r]]
                                        for x in range(m):
                                            for y in range(m):
                                                out[to, x, y] += s * M[e + x, f + y]
                            if shared:
                                if not counting:
                                    columns[to] = number[a, b, c]
                                to += 1
                if counting:
                    offsets[row + 1] = to
