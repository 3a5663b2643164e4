"""Loads of a cell of which the solutions follow from others by symmetry, to solve fewer of them.

The 48 symmetries of a cube, about the middle of the cell or a place half a cell from it, permute
the functions of a grid that has them. Where the solid seems to be the same, cell by cell, the
solution of one load is turned into a candidate for another.

Independently of the grid, `group` finds the symmetries of the solid itself on points.

Guarantee: nothing is believed. A candidate is put into the equations of its own load, with the true
matrix, and counts as their solution only where the residual is below the tolerance that solutions
must meet; otherwise it is where solving starts. So a cell that is nearly symmetric costs some steps
and is never wrong. Non-guarantee: symmetries about other places are not found.
"""

import itertools
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

from ilattice._geometry import grid_points
from ilattice._typing import AnyArray, FloatArray, IntArray
from ilattice.cutfem.domain import Domain
from ilattice.cutfem.phases import PhasedDomain
from ilattice.cutfem.space import SplineSpace
from ilattice.homogenize import tensors

#: Part of a cell of the grid by which the solid in it may differ from that in its image: rules on
#: cut cells are good to some 1e-6 in any position.
ALIKE = 1e-3
#: Relative residual from which on a candidate is of no use.
USELESS = 0.1
#: Symmetries that are tried per load.
TRIED = 2
#: Points per direction on which a solid is compared with its images, shifted by any number of them,
#: and the part of all that may differ.
POINTS, DIFFER = 24, 2e-4
#: How far a rotation in space may be from axes to axes.
SQUARE = 1e-12


@dataclass(frozen=True)
class Motion:
    """A symmetry of the grid: (Q u)_a = sign_a u_(axis_a), about the middle, and a shift.

    Attributes
    ----------
    axes : tuple of 3 int
        Axis that comes to each.
    signs : tuple of 3 int
        Whether it is turned over.
    shift : tuple of 3 int
        In cells of the grid.
    """

    axes: tuple[int, int, int]
    signs: tuple[int, int, int]
    shift: tuple[int, int, int]

    @property
    def matrix(self) -> FloatArray:
        """Q."""
        return np.array(self.signs, float)[:, None] * np.eye(3)[list(self.axes)]

    def cells(self, ijk: IntArray, shape: IntArray) -> IntArray:
        """Images of cells, indices (n, 3) per direction."""
        out = ijk[:, self.axes]
        out = np.where(np.array(self.signs) > 0, out, shape - 1 - out)
        return np.asarray((out + self.shift) % shape)

    def local(self, degree: int) -> IntArray:
        """Images of the functions of one cell, ((p + 1)³,)."""
        p = np.arange(degree + 1)
        one = grid_points(p, p, p)[:, self.axes]
        one = np.where(np.array(self.signs) > 0, one, degree - one)
        return np.asarray(np.ravel_multi_index(tuple(one.T), (degree + 1,) * 3))


def motions(space: SplineSpace, volumes: FloatArray) -> list[Motion]:
    """Symmetries that a grid has, and a solid seems to have, the best first.

    Parameters
    ----------
    space : SplineSpace
        Functions on the active cells.
    volumes : ndarray, shape (cells,)
        Of the solid in them.

    Returns
    -------
    list of Motion
        Without the one that moves nothing; none if cells have several elements.
    """
    grid = space.grid
    if (space.cells >= grid.count).any():
        return []
    filled = np.zeros(grid.count)
    filled[space.cells] = volumes
    filled = filled.reshape(grid.shape)
    scale = float(np.prod([np.diff(a).max() for a in grid.axes]))
    found = []
    for motion in _of_grid(grid):
        image = np.transpose(filled, motion.axes)
        turned = tuple(slice(None, None, s) for s in motion.signs)
        image = np.roll(image[turned], motion.shift, axis=(0, 1, 2))
        off = float(np.abs(image - filled).max()) / scale
        if off <= ALIKE:
            found.append((off, motion))
    found.sort(key=lambda pair: pair[0])
    return [m for _, m in found if (m.axes, m.signs) != ((0, 1, 2), (1, 1, 1))]


def _of_grid(grid: Any) -> Iterator[Motion]:
    """Symmetries of the planes of a grid."""
    steps = [np.diff(a) / np.ptp(a) for a in grid.axes]
    halves = [(0, n // 2) if n % 2 == 0 else (0,) for n in grid.shape]
    for axes in itertools.permutations(range(3)):
        if any(grid.shape[a] != grid.shape[b] for a, b in enumerate(axes)):
            continue
        for signs in itertools.product((1, -1), repeat=3):
            for shift in itertools.product(*halves):
                pairs = zip(range(3), axes, signs, shift, strict=True)
                if all(np.allclose(steps[a], np.roll(steps[b][::s], k)) for a, b, s, k in pairs):
                    yield Motion(axes, signs, shift)  # type: ignore[arg-type]


def in_space(motion: Motion, J: FloatArray) -> FloatArray | None:
    """The orthogonal matrix (3, 3) of a symmetry in space, None if it is not from axes to axes."""
    Q = J @ motion.matrix @ np.linalg.inv(J)
    rounded = np.rint(Q)
    good = np.abs(Q - rounded).max() < SQUARE and (rounded @ rounded.T == np.eye(3)).all()
    return rounded if good else None


def group(domain: Domain, J: FloatArray) -> list[FloatArray]:
    """Symmetries of a solid in space, as orthogonal matrices from axes to axes.

    Parameters
    ----------
    domain : Domain
        The solid, of one phase or two.
    J : ndarray, shape (3, 3)
        Jacobian of its map.

    Returns
    -------
    list of ndarray, shape (3, 3)
        With the unit matrix; those about places that are no 24ths of the cell are not seen.
    """
    lo, hi = domain.cut.grid.domain
    t = (np.arange(POINTS) + 0.5) / POINTS
    u = lo + grid_points(t, t, t) * (hi - lo)
    what = (domain.cut.sets(u) < 0.0).all(axis=1).astype(float)
    if isinstance(domain, PhasedDomain):
        what += what * domain.second(u)
    what = what.reshape(POINTS, POINTS, POINTS)
    spectrum, square, found = np.fft.fftn(what), float((what**2).sum()), []
    for axes in itertools.permutations(range(3)):
        for signs in itertools.product((1, -1), repeat=3):
            motion = Motion(axes, signs, (0, 0, 0))  # type: ignore[arg-type]
            Q = in_space(motion, J @ np.diag(hi - lo))
            if Q is None:
                continue
            image = np.transpose(what, axes)[tuple(slice(None, None, s) for s in signs)]
            product = np.fft.ifftn(spectrum * np.fft.fftn(image).conj()).real
            if 2.0 * (square - float(product.max())) <= DIFFER * what.size:
                found.append(Q)
    return found


def symmetry_of(turns: list[FloatArray]) -> str:
    """The highest symmetry that stiffnesses of solids with these have, or "anisotropic"."""
    any_one = np.random.default_rng(0).standard_normal((6, 6))
    C = np.mean([tensors.rotated(any_one @ any_one.T, Q) for Q in turns], axis=0)
    off = {s: tensors.size(C - tensors.nearest(C, s)) for s in tensors.SYMMETRIES}
    return next((s for s, d in off.items() if d < SQUARE * tensors.size(C)), "anisotropic")


def permutation(space: SplineSpace, motion: Motion) -> IntArray | None:
    """Function that comes to each one (n,), None if functions do not fall on functions."""
    shape = np.array(space.grid.shape)
    numbers = np.ravel_multi_index(
        tuple(motion.cells(space.cell_indices, shape).T), space.grid.shape
    )
    at = np.searchsorted(space.cells, numbers)
    if (at >= len(space.cells)).any() or (space.cells[at] != numbers).any():
        return None
    to = space.dofs[at][:, motion.local(space.degree)]
    out = np.full(len(space), -1, np.int64)
    out[to] = space.dofs
    there = (out[to] == space.dofs).all() and (np.bincount(out, minlength=len(out)) == 1).all()
    return out if there else None


def image_of_load(loads: FloatArray, a: int, Q: FloatArray) -> tuple[int, float] | None:
    """Load that a load becomes, and its sign."""
    moved = Q @ loads[a] @ Q.T if loads.ndim == 3 else Q @ loads[a]
    for b, load in enumerate(loads):
        for sign in (1.0, -1.0):
            if np.array_equal(moved, sign * load):
                return b, sign
    return None


@dataclass(frozen=True)
class Way:
    """How the solution of load `source` becomes one of another: sign, functions, rotation."""

    source: int
    sign: float
    functions: AnyArray
    Q: FloatArray

    def __call__(self, c: FloatArray) -> FloatArray:
        """Coefficients (n, m) of the candidate from those of the source."""
        out = c[self.functions]
        return self.sign * (out @ self.Q.T if out.shape[1] == 3 else out)


def ways(
    space: SplineSpace, volumes: FloatArray, J: FloatArray, loads: FloatArray, there: IntArray
) -> dict[int, list[Way]]:
    """Loads that may follow from others, which are solved, and how."""
    out: dict[int, list[Way]] = {}
    sources: set[int] = set()
    known: dict[Motion, AnyArray | None] = {}
    turned = [(m, Q) for m in motions(space, volumes) if (Q := in_space(m, J)) is not None]
    for a in there.tolist():
        if a in out:
            continue
        sources.add(a)
        for motion, Q in turned:
            image = image_of_load(loads, a, Q)
            if image is None or image[0] in sources or image[0] not in there:
                continue
            if len(out.get(image[0], ())) >= TRIED:
                continue
            if motion not in known:
                known[motion] = permutation(space, motion)
            functions = known[motion]
            if functions is not None:
                out.setdefault(image[0], []).append(Way(a, image[1], functions, Q))
    return out
