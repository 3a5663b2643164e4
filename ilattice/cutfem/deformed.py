"""Displacements, strains and stresses of a solved problem, energies, reactions, files, pictures.

Guarantees: fields are those of the splines, evaluated anywhere in the solid, not interpolated;
loads and reactions are in equilibrium, and work and energy agree, as well as the equations are
solved.
Non-guarantees: stresses are the derivatives of the displacement, an order less accurate, and are
not averaged, unless the solution is `recovered`; outside the solid fields are continued by one
cell, then NaN.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ilattice._typing import FloatArray, IntArray
from ilattice.cutfem._voigt import elastic_stress, engineering_strain
from ilattice.cutfem.operators import ElasticOperators
from ilattice.cutfem.places import Motion
from ilattice.cutfem.solved import Solved
from ilattice.cutfem.stresses import Stresses, von_mises
from ilattice.quadrature.rules import Quadrature


@dataclass(frozen=True, eq=False, repr=False)
class Deformed(Solved, Stresses):
    """What is there of the displacement of an elastic solid: what a `Solution` is made of.

    Attributes
    ----------
    problem : ElasticOperators
        What was solved.
    coefficients : ndarray, shape (functions, 3)
        Of the splines.
    solved : SolveReport or None
        What the solver says; None if nothing was free.
    """

    problem: ElasticOperators

    def stress_on(self, rule: Quadrature) -> FloatArray:
        """Stress at the points of a rule in the active cells.

        Parameters
        ----------
        rule : Quadrature
            In parameters, or in space with `parameters`.

        Returns
        -------
        ndarray, shape (n, 6)
            As `stress`.
        """
        return self._flux_on(rule)

    def _squared_norm(self, rule: Quadrature, flux: FloatArray) -> float:
        """By the energy, which what is heated does not store."""
        del rule, flux
        return 2.0 * self.energy

    # ---------------------------------------------------------------- numbers

    @cached_property
    def safety_factor(self) -> float:
        """Factor by which all loads may grow before a point of the solid yields.

        The least strength over von Mises stress at the points of quadrature; an `InputError`
        without a `strength`. Under temperatures it holds if they grow as the loads do.
        """
        problem = self.problem
        rule = problem.domain.solid(problem.assembly)
        assert rule.parameters is not None
        owner = problem.assembly.owners(rule)
        used = von_mises(self.stress_on(rule)) / self._strength(rule.parameters, owner)
        return float(1.0 / used.max()) if used.max() > 0.0 else float("inf")

    @cached_property
    def energy(self) -> float:
        """Energy of the elastic strain of the solid, without springs and stabilization.

        The strain of free expansion stores none.
        """
        problem = self.problem
        heated = any(load.kind == "temperature" for load in problem.loads)
        constant = problem.material.constant and not heated
        return self._energy(problem.domain.stiff_rule(problem.assembly, constant=constant))

    def _energy(self, rule: Quadrature, *, heated: bool = True) -> float:
        """Half of stress times elastic strain, or, not `heated`, as if nothing were heated."""
        return sum(float(part.sum()) for part in self._energies(rule, heated=heated))

    def _energies(self, rule: Quadrature, *, heated: bool = True) -> Iterator[FloatArray]:
        """Its parts at the points of a rule in parameters, batch by batch."""
        problem = self.problem
        asm = problem.assembly
        owner = asm.owners(rule)
        for rows, _, gradient in asm.on_rule(self.coefficients, rule):
            u = rule.points[rows]
            weights = rule.weights[rows] * np.abs(np.linalg.det(asm.jacobians(u)))
            mine = owner[rows]
            if problem.material.full:
                if heated:
                    gradient -= problem._thermal_strain(u, mine)[:, None, None] * np.eye(3)
                s = problem._flux(gradient, u, mine)
                yield 0.5 * weights * (s * engineering_strain(gradient)).sum(axis=1)
                continue
            lam, mu = problem._lame(u, mine)
            volume = self._dilatation(gradient, u, mine)
            if heated:
                gradient -= problem._thermal_strain(u, mine)[:, None, None] * np.eye(3)
                volume -= self._thermal_dilatation(u, mine)
            shape = elastic_stress(gradient, np.zeros(1), mu) * engineering_strain(gradient)
            yield 0.5 * weights * (shape.sum(axis=1) + lam * volume**2)

    def _thermal_dilatation(self, u: FloatArray, owner: IntArray) -> FloatArray:
        """Change of volume (n,) of free expansion, projected as `_dilatation` is."""
        problem = self.problem
        if problem.projection is None:
            return 3.0 * problem._thermal_strain(u, owner)
        heat = problem.projected_expansion.values()
        return 3.0 * sum((problem.projection.at(c, u, owner) for c in heat), np.zeros(len(u)))

    @cached_property
    def compliance(self) -> float:
        """Work of the loads on the displacement.

        Twice the energy where supports are at rest and nothing is heated. Of a temperature that is
        the work of the pressure that would keep the solid from expanding.
        """
        moved = sum(connection.work for connection in self.problem.connections)
        return float((self.problem.forces() * self.coefficients).sum()) + moved

    @cached_property
    def stabilization_energy(self) -> float:
        """Energy of what is no solid: weighted void, or penalty on jumps.

        Compare it with `energy`: the part by which the answer is too stiff.
        """
        problem = self.problem
        asm, domain = problem.assembly, problem.domain
        total = 0.0
        if domain.stabilization == "void":
            total += sum(self._energy(rule, heated=False) for rule in domain.void_rules(asm))
        if asm.ghost is not None:
            data = asm.zeros(3)
            asm.add_ghost(data, problem._ghost_stiffness)
            c = self.coefficients.ravel()
            total += 0.5 * float(c @ (asm.pattern.matrix(data) @ c))
        return total

    @cached_property
    def reactions(self) -> Mapping[str, FloatArray]:
        """Force (3,) that each place of supports and springs exerts on the solid."""
        return self._coming_in

    @cached_property
    def equilibrium(self) -> float:
        """Sum of loads and reactions, relative to the sum of what acts on all nodes."""
        problem = self.problem
        total = problem.forces().sum(axis=0) + sum(self.reactions.values())
        inner = problem._times(self.coefficients)
        return float(np.abs(total).max() / max(np.abs(inner).sum(), 1e-300))

    @property
    def motions(self) -> tuple[Motion, ...]:
        """How the places of rigid connections move, in the order of `Elasticity.rigid`."""
        return tuple(c.motion for c in self.problem.connections if c.motion is not None)

    @property
    def residual(self) -> float:
        """Relative residual of the equations."""
        return 0.0 if self.report is None else float(self.report.residual)
