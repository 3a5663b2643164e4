"""Problems on one cell of a periodic solid, copies of which are all around.

`PeriodicProblem` makes periodic what problems of `cutfem` share: functions and rules go on over the
faces of the cell, pieces of the solid are held at one function each instead of supports, and
islands, which bear nothing, are left out.

Guarantee: what holds a piece changes no strain. Non-guarantee: cells are boxes, or images of boxes
under affine maps.
"""

import warnings
from functools import cached_property
from typing import Any

import numpy as np

from ilattice._typing import FloatArray, IntArray
from ilattice._validate import read_only
from ilattice.cutfem.assembly import Assembly, constant_jacobian
from ilattice.cutfem.connectivity import links
from ilattice.cutfem.constraints import Constraints
from ilattice.cutfem.problem import Problem
from ilattice.errors import GeometryError, PrecisionWarning
from ilattice.homogenize._estimate import outside
from ilattice.homogenize.arguments import EDGES
from ilattice.homogenize.percolation import Percolation, percolation
from ilattice.macroshape.maps import SplineMap

#: A cell that lacks less than this part is full.
FULL = 1e-9


class PeriodicProblem(Problem):
    """What makes a problem one of a periodic cell."""

    @property
    def cell_volume(self) -> float:
        """Volume of the cell with its voids."""
        box = np.ptp(self.domain.cut.grid.domain, axis=0)
        return float(abs(np.linalg.det(self._jacobian[0])) * np.prod(box))

    @property
    def _through(self) -> SplineMap | None:
        return self.domain.cut.through

    @property
    def _jacobian(self) -> FloatArray:
        """The Jacobian (1, 3, 3) of the affine map."""
        J = np.eye(3)[None] if self._through is None else constant_jacobian(self._through)
        assert J is not None
        return J

    @cached_property
    def network(self) -> Percolation:
        """Pieces of the solid: their numbers are those of `Domain.parts`."""
        domain, parts = self.domain, self.domain.parts
        low, high = links(domain.joints)
        axis = np.repeat(np.arange(3), [len(rule.cells) for rule in domain.joints])
        grid, n = domain.elements, np.array(domain.cut.grid.shape)
        apart = grid.cell_indices(high) - grid.cell_indices(low)
        steps = (apart <= 0) & (axis[:, None] == np.arange(3))  # from the last cell to the first
        if domain.interface is not None:
            seam = (domain.interface.cells, domain.interface.neighbours)
            apart = grid.cell_indices(seam[1]) - grid.cell_indices(seam[0])
            steps = np.concatenate([steps, np.where(apart < -(n // 2), 1, 0) - (apart > n // 2)])
            low, high = (np.concatenate(pair) for pair in zip((low, high), seam, strict=True))
        keep = np.isin(low, parts.cells) & np.isin(high, parts.cells)
        low, high = (np.searchsorted(parts.cells, c[keep]) for c in (low, high))
        return percolation(len(parts.cells), low, high, steps[keep].astype(np.int64))

    @cached_property
    def parts(self) -> tuple[IntArray, IntArray]:
        """Numbers of the parts that go on in some direction, and of islands."""
        labels, ranks = self.domain.parts.labels, self.network.ranks
        rank = np.zeros(len(self.domain.parts), np.int64)
        rank[labels] = ranks[self.network.labels]
        return read_only(np.flatnonzero(rank > 0)), read_only(np.flatnonzero(rank == 0))

    @property
    def percolates(self) -> tuple[bool, bool, bool]:
        """Whether the solid goes on through the cell along each of its edges."""
        return self.network.axes

    def check_held(self) -> None:
        """Nothing: every piece is held by `constraints`."""

    @cached_property
    def assembly(self) -> Assembly:
        """Functions on the parts that go on.

        Raises
        ------
        GeometryError
            If there are only islands, or some with ``islands="refuse"``.
        """
        held, loose = self.parts
        what = self.domain.parts
        sizes = np.bincount(what.labels, what.solid.integrate_cells())
        loose = loose[sizes[loose] > FULL * sizes.sum()]  # the others are rounding
        if len(loose) and (not len(held) or self.islands == "refuse"):
            raise GeometryError(f"nothing is borne by islands, {what.describe(loose)}")
        if len(loose):
            warnings.warn(
                f"left out, because islands bear nothing: {what.describe(loose)}",
                PrecisionWarning,
                stacklevel=outside(),
            )
        self.domain.warn_gaps()
        return self.domain.assembly(held, weak=False)

    @cached_property
    def assembly_of_all(self) -> Assembly:
        """Functions on all parts, for the map alone."""
        return self.domain.assembly(np.arange(len(self.domain.parts)), weak=False)

    def fractions(self) -> FloatArray:
        """Parts of the cell that phases fill, islands too.

        Returns
        -------
        ndarray, shape (phases,)
            Of one phase or two.
        """
        whole = float(np.prod(np.ptp(self.domain.cut.grid.domain, axis=0)))
        phases = self.domain.of_phases(self.domain.volume)
        return np.array([rule.weights.sum() for rule in phases]) / whole

    def free_normals(self) -> FloatArray:
        """Normals (k, 3) of the faces of the cell through which nothing goes on.

        Returns
        -------
        ndarray, shape (k, 3)
            Unit vectors in space.
        """
        n = np.linalg.inv(self._jacobian[0])
        n = n / np.linalg.norm(n, axis=1, keepdims=True)
        return np.asarray(n[~np.array(self.percolates)])

    @cached_property
    def constraints(self) -> Constraints:
        """One function of every piece, and of rods one that keeps them from turning."""
        asm = self.assembly
        fixed = np.zeros((len(asm.space), self.m), bool)
        for part in self.parts[0]:
            self._hold(fixed, asm, int(part))
        return Constraints(fixed, np.zeros(fixed.shape), np.where(fixed, 0, -1))

    def _hold(self, fixed: Any, asm: Assembly, part: int) -> None:
        """Mark the components that hold a piece."""
        parts, network = self.domain.parts, self.network
        rows = np.flatnonzero(parts.labels == part)
        filled = parts.solid.integrate_cells()[rows]
        cells = parts.cells[rows]
        middle = asm.space.dofs.shape[1] // 2
        held = int(np.argmax(filled))
        at = np.searchsorted(asm.space.cells, cells)
        fixed[asm.space.dofs[at[held], middle]] = True
        ways = network.ways[int(network.labels[rows[0]])]
        if self.m == 1 or len(ways) != 1:
            return
        box = self.domain.elements.boxes(cells)
        period = np.ptp(self.domain.cut.grid.domain, axis=0)
        u = box[:, :3] + 0.5 * box[:, 3:] + network.shifts[rows] * period
        x = (u - u[held]) @ self._jacobian[0].T
        turn = np.cross(self._jacobian[0] @ (ways[0] * period), x)
        best = np.abs(turn) * np.sqrt(filled / filled.max())[:, None]
        element, component = divmod(int(best.argmax()), 3)
        fixed[asm.space.dofs[at[element], middle], component] = True

    def warn_of_gaps(self) -> None:
        """Warn of edges of the cell along which nothing is borne, and refuse nothing."""
        warn_of_axes(self.percolates)


def warn_of_axes(percolates: tuple[bool, bool, bool], names: str = EDGES, rest: str = "") -> None:
    """Warn of edges of the cell along which the solid does not go on; `rest` is what bears then."""
    missing = [names[a] for a in range(3) if not percolates[a]]
    if missing:
        borne = f"only {rest} bear anything" if rest else "nothing is borne"
        warnings.warn(
            f"the solid does not go on through the cell along {', '.join(missing)}: {borne} "
            f"there{'' if rest else ', and the effective stiffness or conductivity is zero'}",
            PrecisionWarning,
            stacklevel=outside(),
        )
