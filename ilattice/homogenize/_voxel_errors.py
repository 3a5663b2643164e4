"""How far off arrays of voxels are: the same material on voxels twice and four times as long.

The energy under a mean strain falls to the true one under refinement, by a factor from one halving
to the next that two differences tell. Around edges and corners where phases meet like fields of a
chessboard it falls slowly: fields grow there with the power (4 / pi) atan(1 / sqrt(K)) of the
distance, K the ratio of the phases (R. Kellogg, On the Poisson equation with intersecting
interfaces, 1974), and the energy falls with twice that. Where four times longer voxels
are too few to show the fall, it is taken from these powers, in between bounds. Not the energy but
its inverse is continued: near such edges voxels are too stiff by factors, and conduct as 1 / log of
their number does.

Guarantees: an error is never larger than the distance to the mean of compliances (Reuss), which
voxels never go below; zero where longer voxels change nothing; shifts of the cell do not change
them, unless its steps are as many on any longer voxels. Non-guarantee: an estimate, and no bound.
Of 774 entries (chessboards in two and three dimensions, random blocks, struts, voids, level sets;
4 to 64 voxels; ratios from 3 to 1e6; against exact values, and fits to finer voxels), on which
the numbers below were chosen, estimates were 0.42 to 4.3 times the true error, 1 % of them above 4
times and 2 % below half; of 105 others, of random blocks that conduct, 0.8 to 6.1 times.
"""

from collections.abc import Iterable
from dataclasses import replace

import numpy as np

from ilattice._typing import FloatArray
from ilattice.cutfem._voigt import PLACES
from ilattice.homogenize import tensors
from ilattice.homogenize._spectral import VoxelGrid, descend, prolonged, restricted

#: Tolerance of the fields on longer voxels; energies are off by its square.
COARSE = 1e-2
#: Parts of an error that are left on voxels half as long: at least; at most, where that is not
#: seen, with edges of chessboards and without; and where it is seen, with them and without.
MIN_LEFT, UNSEEN, SEEN = 0.5, (0.75, 2.0 / 3.0), (0.98, 2.0 / 3.0)
#: What estimates are multiplied by.
SAFETY = 1.3
#: Part of what voxels relax that those four times as long must relax for a fall to be seen.
ENOUGH = 0.5
#: Elements whose matrices are made at once.
CHUNK = 1024


def missed(
    energy: FloatArray, lost: FloatArray, more: FloatArray | None, done: FloatArray,
    least: FloatArray, edges: float,
) -> FloatArray:  # fmt: skip
    """By how much energies are too large.

    Parameters
    ----------
    energy : ndarray, shape (k,)
        On the voxels at hand, of unit strains or gradients.
    lost, more : ndarray, shape (k,)
        What is added on voxels twice as long, and from these to those four times as long; None
        where there are none.
    done : ndarray, shape (k,)
        What the voxels at hand relax.
    least : ndarray, shape (k,)
        Lower bounds of the true energies.
    edges : float
        Of `left_at_edges`.

    Returns
    -------
    ndarray, shape (k,)
        Errors, up to the distance to `least`.
    """
    tiny = np.finfo(np.float64).tiny
    lost, energy = np.maximum(lost, 0.0), np.maximum(energy, 0.0)
    fallen = lost / np.maximum(energy + lost, tiny)
    seen = np.zeros(len(energy), bool)
    left = lost / np.maximum(done, tiny)
    if more is not None:
        more = np.maximum(more, 0.0)
        before = (1.0 - fallen) * more / np.maximum(energy + lost + more, tiny)
        left = np.minimum(fallen / np.maximum(before, tiny), 1.0)
        seen = done - lost - more > ENOUGH * done
    unseen = np.clip(edges, UNSEEN[1], UNSEEN[0])
    least_left = np.where(seen, MIN_LEFT, np.clip(edges, MIN_LEFT, UNSEEN[0]))
    left = np.clip(left, least_left, np.where(seen, np.clip(edges, SEEN[1], SEEN[0]), unseen))
    rest = SAFETY * fallen * left / (1.0 - left)
    return np.asarray(np.clip(energy * rest / (1.0 + rest), 0.0, np.maximum(energy - least, 0.0)))


def left_at_edges(grid: VoxelGrid) -> float:
    """Part of an error that half as long voxels leave at the worst edge of chessboards, or 0."""
    size, ratio = _sizes(grid), 1.0
    for a, b in ((0, 1), (0, 2), (1, 2)):
        beside, above = np.roll(size, 1, a), np.roll(size, 1, b)
        corner = np.roll(beside, 1, b)
        for one, other in (((size, corner), (beside, above)), ((beside, above), (size, corner))):
            least, most = np.minimum(*one), np.maximum(*other)
            if (most < least).any():
                soft = np.maximum(most, 1e-30 * least.max())
                ratio = max(ratio, float((least / np.where(soft > 0.0, soft, 1.0)).max()))
    power = 4.0 / np.pi * np.arctan(ratio**-0.5)
    return float(2.0 ** (-2.0 * power)) if ratio > 1.0 else 0.0


def aligned(grid: VoxelGrid) -> VoxelGrid:
    """The grid shifted so that most of the steps of the material are on faces of longer voxels."""
    size, phase = _sizes(grid), grid.phase
    for axis, count in enumerate(phase.shape):
        others = tuple(a for a in range(3) if a != axis)
        step = np.abs(size - np.roll(size, 1, axis)).sum(axis=others)
        steps = step.reshape(-1, 2 if count % 4 else 4).sum(axis=0)
        first = int(steps[1::2].sum() > steps[::2].sum())
        most = first + 2 * int(steps[first::2].argmax())
        phase = np.roll(phase, -most, axis)
    return replace(grid, phase=np.ascontiguousarray(phase))


class Twice:
    """Fields on voxels twice as long, in the material of the short ones.

    Parameters
    ----------
    grid : VoxelGrid
        The short ones, in even numbers.
    """

    def __init__(self, grid: VoxelGrid) -> None:
        self.fine, self.grid = grid, _longer(grid, 2)

    def forces(self, u: FloatArray) -> FloatArray:
        """Forces (m, n0, n1, n2) of a field of the same shape."""
        return self.restricted(self.fine.forces(prolonged(u)))

    def restricted(self, f: FloatArray) -> FloatArray:
        """Forces on the short voxels as forces on these."""
        return restricted(f)


class FourTimes:
    """The same on voxels four times as long, each of which has a matrix.

    Parameters
    ----------
    grid : VoxelGrid
        The short ones, in numbers that four divides.
    """

    def __init__(self, grid: VoxelGrid) -> None:
        self.grid, self.matrices = _longer(grid, 4), _matrices(grid)

    def forces(self, u: FloatArray) -> FloatArray:
        """Forces (m, n0, n1, n2) of a field of the same shape."""
        m, shape = self.grid.m, self.grid.phase.shape
        corners = np.stack([np.roll(u, (-i, -j, -k), (1, 2, 3)) for i, j, k in np.ndindex(2, 2, 2)])
        at = np.ascontiguousarray(corners.reshape(8 * m, -1).T)
        f = (self.matrices @ at[:, :, None])[:, :, 0].T.reshape(8, m, *shape)
        out = np.zeros_like(u)
        for one, (i, j, k) in zip(f, np.ndindex(2, 2, 2), strict=True):
            out += np.roll(one, (i, j, k), (1, 2, 3))
        return out

    def restricted(self, f: FloatArray) -> FloatArray:
        """Forces on the short voxels as forces on these."""
        return restricted(restricted(f))


def relaxed(
    longer: Twice | FourTimes, loads: Iterable[FloatArray], tol: float, steps: int
) -> FloatArray:
    """What loads relax on longer voxels, times the volume.

    Parameters
    ----------
    longer : Twice or FourTimes
        The longer voxels.
    loads : iterable of ndarray, shape (m, n0, n1, n2)
        Forces on the short ones.
    tol, steps : float, int
        Tolerance of the fields at hand, and most steps.

    Returns
    -------
    ndarray, shape (k,)
        Off by the squares of errors of the fields only.
    """
    out = []
    for load in loads:
        b = longer.restricted(load)
        run = descend(longer.forces, longer.grid.precondition, b, max(COARSE, tol), steps)
        out.append(float((run.x * (b + run.residual)).sum()))
    return np.array(out)


def _longer(grid: VoxelGrid, times: int) -> VoxelGrid:
    """Longer voxels, for what depends on their size alone."""
    phase = np.ascontiguousarray(grid.phase[::times, ::times, ::times])
    return VoxelGrid(phase, grid.table, times * grid.spacing, grid.reference)


def _sizes(grid: VoxelGrid) -> FloatArray:
    """How stiff voxels are, or how well they conduct."""
    sizes = grid.table @ np.trace(_units(grid), axis1=1, axis2=2)
    return np.asarray(sizes[grid.phase])


def _units(grid: VoxelGrid) -> FloatArray:
    """Stiffnesses (k, 6, 6), or conductivities (k, 3, 3), that the table has the numbers of."""
    count = grid.table.shape[1]
    if count == 2:
        return np.asarray(tensors.isotropic(np.array([1.0, 0.0]), np.array([0.0, 1.0])))
    unit = np.eye(count)
    return unit[:, PLACES] if count == 6 else unit.reshape(36, 6, 6)


def _matrices(grid: VoxelGrid) -> FloatArray:
    """Matrices (elements, 8 m, 8 m) of elements of 4x4x4 voxels."""
    units, slopes = _units(grid), _slopes(grid.spacing)
    if grid.m == 1:
        parts = np.einsum("siajb,dab->sdij", slopes, units)
    else:
        parts = np.einsum("siajb,dpaqb->sdipjq", slopes, tensors.tensor(units), optimize=True)
    side = 8 * grid.m
    flat = parts.reshape(-1, side * side)
    n0, n1, n2 = (n // 4 for n in grid.phase.shape)
    blocks = grid.phase.reshape(n0, 4, n1, 4, n2, 4).transpose(0, 2, 4, 1, 3, 5).reshape(-1, 64)
    out = np.empty((len(blocks), side * side))
    for start in range(0, len(blocks), CHUNK):
        rows = grid.table[blocks[start : start + CHUNK]]
        out[start : start + CHUNK] = rows.reshape(len(rows), -1) @ flat
    return out.reshape(-1, side, side)


def _slopes(spacing: FloatArray) -> FloatArray:
    """Integrals (64, 8, 3, 8, 3), over voxels, of products of slopes of an element of 4x4x4."""
    ends = 0.5 + 0.5 / np.sqrt(3.0) * np.array([-1.0, 1.0])
    x = (np.arange(4)[:, None] + ends) / 4.0
    value = np.stack([1.0 - x, x])  # (corner, voxel, point)
    slope = np.stack([-np.ones_like(x), np.ones_like(x)])
    gradient = np.stack([
        np.einsum("iag,jbh,kcl->ijkabcghl", *(slope if a == d else value for a in range(3)))
        / (4.0 * spacing[d]) for d in range(3)
    ])  # fmt: skip
    g = gradient.reshape(3, 8, 64, 8)
    return np.asarray(np.einsum("aisg,bjsg->siajb", g, g) * spacing.prod() / 8.0)
