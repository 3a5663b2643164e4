"""What is integrated for a problem of any law: matrices, loads, supports, energies.

A physics is a problem with a law, see `Pointwise.law`; the rest follows from it, and is overridden
where more is known, or where fields are projected.

Guarantee: matrices are made cell by cell, of two phases each by its own law. Non-guarantee:
nothing is solved here, or checked for being held.
"""

from dataclasses import dataclass
from functools import cached_property, partial
from typing import Any

import numpy as np

from ilattice._typing import FloatArray
from ilattice._validate import read_only
from ilattice.cutfem import coupling, watching, weak
from ilattice.cutfem.conditions import Known, Load, Support
from ilattice.cutfem.jumps import CALM, warn_of_jump
from ilattice.cutfem.overlaps import loads_at
from ilattice.cutfem.pointwise import Pointwise, Terms
from ilattice.linalg.symmetric import Symmetric
from ilattice.quadrature.rules import Quadrature


@dataclass(frozen=True, eq=False, init=False, repr=False)
class Integrals(Pointwise):
    """Integrals over a solid with supports and loads: what a `Problem` is made of.

    Attributes are those of `Posed`.
    """

    # ---------------------------------------------------------------- matrix and loads

    @property
    def matrix(self) -> Any:
        """Stiffness with stabilization, springs and weak supports, before anything is fixed.

        The whole `bsr_array` is put together at every call from its upper half, which is kept.
        """
        return self._stiffness.whole()

    @property
    def _stiffness(self) -> Symmetric:
        """See `matrix`."""
        made: Symmetric | None = self._held.get("matrix")  # which another thread may take out
        if made is None:
            made = self._held["matrix"] = self._matrix()
        return made

    def _matrix(self) -> Symmetric:
        asm, law = self.assembly, self.law
        data, jump = asm.zeros(self.m), CALM
        uniform = all(phase.constant for phase in law.phases)
        for rule in self.domain.stiff_rules(asm, constant=uniform):
            for phase, part in enumerate(self.domain.of_phases(rule)):
                jump = np.maximum(jump, self._add_solid(data, phase, part))
        warn_of_jump(law.called, jump)
        self._held["unfollowed"] = float(jump[1])
        self._add_projected(data)
        asm.add_ghost(data, self._ghost_stiffness)
        for support in self.weakly_imposed:
            weak.add(data, self, weak.terms_of(self, support))
        if asm.seam is not None:
            coupling.add(data, self)
        return asm.pattern.matrix(data)

    def _add_solid(self, data: FloatArray, phase: int, part: Quadrature) -> FloatArray:
        """Add the matrix of a part of a phase to blocks; by how much the law jumps there."""
        return self.law.phases[phase].add(data, self.assembly, part)

    @property
    def unfollowed(self) -> float:
        """Part of an energy that a material which jumps or waves within cells may take."""
        if "unfollowed" not in self._held:
            _ = self._stiffness
        return float(self._held.get("unfollowed", 0.0))

    def forces(self) -> FloatArray:
        """Loads as coefficients, without what comes from supports and springs.

        Returns
        -------
        ndarray, shape (functions, m)
            Their sums over the functions are the resultants: force, or heat per time.
        """
        return self._forces

    @cached_property
    def _forces(self) -> FloatArray:
        f = np.zeros((len(self.assembly.space), self.m))
        for load in self.loads:
            watching.check_reached(self, load)
            f += self._force(load)
        return read_only(f)

    def _force(self, load: Load) -> FloatArray:
        """One load as coefficients (functions, m)."""
        asm, load = self.assembly, self._spread(load)
        solid = partial(self.domain.stiff_rule, asm, constant=self._is_constant(load))
        rule = self.domain.edge(asm, load.on) if load.on else solid()
        return asm.vector_by_parts(rule, self.m, partial(self._density, load))

    def _is_constant(self, load: Load) -> bool:
        """Whether a load in the solid is the same everywhere."""
        return not (callable(load.value) or isinstance(load.value, Known))

    def _add_projected(self, data: FloatArray) -> None:
        """Add what is projected cell by cell to blocks."""

    def _from_supports(self) -> FloatArray:
        """What springs and weak supports add to the right-hand side, (functions, m)."""
        f = np.zeros((len(self.assembly.space), self.m))
        for support in self.weakly_imposed:
            terms = weak.terms_of(self, support)
            f += weak.force(self, terms, support.value)
            if isinstance(support, Support):
                w = terms.rule.weights[:, None]
                f -= self.assembly.vector(terms.rule, w * self._taken(terms))
        return f

    def _taken(self, terms: Terms) -> FloatArray:
        """What loads (n, m) bring to the place of a weak support, which takes it."""
        return terms.held(loads_at(self, terms.rule))

    def _energies(self, c: FloatArray, rule: Quadrature) -> FloatArray:
        """Parts (n,) of the points of a rule in parameters of twice the energy that is stored."""
        asm, out = self.assembly, np.empty(len(rule))
        owner = asm.owners(rule)
        for rows, _, gradient in asm.on_rule(c, rule):
            u = rule.points[rows]
            flux = self.law.components(self._flux(gradient, u, owner[rows]))
            weights = rule.weights[rows] * np.abs(np.linalg.det(asm.jacobians(u)))
            out[rows] = weights * (flux * gradient).sum(axis=(1, 2))
        return out

    def _energy_on(self, c: FloatArray, rule: Quadrature) -> float:
        """Twice the energy of coefficients over a rule in parameters, nothing heated."""
        return float(self._energies(c, rule).sum())

    def _solid_energy(self, c: FloatArray) -> float:
        """Twice the energy that the solid alone stores, without springs and supports."""
        rule = self.domain.stiff_rule(self.assembly, constant=self.law.constant)
        return self._energy_on(c, rule)
