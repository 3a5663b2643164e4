"""What is integrated for a problem of any law: matrices, loads, supports, energies.

A physics is a problem with a law, see `Integrals.law`; the rest follows from it, and is overridden
where more is known, or where fields are projected.

Guarantees: parts that nothing holds are found before anything is integrated, and reported with
volume and place; matrices are made cell by cell, of two phases each by its own law. Non-guarantee:
nothing is solved here, or checked for being held.
"""

import warnings
from dataclasses import dataclass
from functools import cached_property, partial
from typing import Any, ClassVar

import numpy as np

from ilattice._typing import FloatArray, IntArray
from ilattice._validate import read_only
from ilattice.cutfem import coupling, watching, weak
from ilattice.cutfem.assembly import Assembly
from ilattice.cutfem.conditions import Known, Load, Support, stiffness_at
from ilattice.cutfem.jumps import CALM, warn_of_jump
from ilattice.cutfem.law import Law
from ilattice.cutfem.material import Scalar
from ilattice.cutfem.overlaps import loads_at
from ilattice.cutfem.posed import Posed
from ilattice.errors import GeometryError, PrecisionWarning
from ilattice.quadrature.rules import Quadrature


@dataclass(frozen=True, eq=False, init=False, repr=False)
class Integrals(Posed):
    """Integrals over a solid with supports and loads: what a `Problem` is made of.

    Attributes are those of `Posed`.
    """

    spring_name: ClassVar[str] = "stiffness"
    flux_name: ClassVar[str] = "flux"

    def _scalar_at(self, scalar: Scalar, u: FloatArray, owner: IntArray) -> FloatArray:
        """A property (n,) or (1,) at parameters in active cells, that of the phase of the cell."""
        asm, phases = self.assembly, scalar.phases
        cells = asm.space.cells[owner]
        return self.domain.by_phase(lambda k, at: phases[k].at(asm, u[at]), cells)

    @cached_property
    def parts(self) -> tuple[IntArray, IntArray]:
        """Numbers of the parts that are held, and of those that nothing holds.

        Without any support or spring all parts count as held.
        """
        count = len(self.domain.parts)
        if not self.supports and not self.springs:
            return read_only(np.arange(count)), read_only(np.zeros(0, np.int64))
        cells = [self.domain.boundary(on).cells for on in {s.on for s in self.supports}]
        for s in self.springs:
            rule = self.domain.boundary(s.on)
            firm = stiffness_at(self.spring_name, s.stiffness, rule.points, self.m).any(axis=1)
            cells.append(np.unique(rule.cells[rule.owners[firm]]))
        held = np.unique(np.concatenate([self.domain.parts.touching(c) for c in cells]))
        return read_only(held), read_only(np.setdiff1d(np.arange(count), held))

    @cached_property
    def assembly(self) -> Assembly:
        """Functions on the parts that are held.

        Raises
        ------
        GeometryError
            If nothing is held, or something is not with ``islands="refuse"``.
        """
        held, loose = self.parts
        what = self.domain.parts
        if not len(held):
            raise GeometryError("no part of the solid touches a support; move the supports")
        loose = what.seen(loose)
        if len(loose) and self.islands == "refuse":
            raise GeometryError(
                f"nothing holds {what.describe(loose)}; islands='drop' leaves them out"
            )
        if len(loose):
            warnings.warn(
                f"left out, because nothing holds them: {what.describe(loose)}",
                PrecisionWarning,
                stacklevel=4,
            )
        self.domain.warn_gaps()
        return self.domain.assembly(held, weak=any(s.weak for s in self.supports))

    # ---------------------------------------------------------------- matrix and loads

    @property
    def matrix(self) -> Any:
        """Stiffness with stabilization, springs and weak supports, before anything is fixed."""
        if "matrix" not in self._held:
            self._held["matrix"] = self._matrix()
        return self._held["matrix"]

    def _matrix(self) -> Any:
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
        _ = self.matrix
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

    def _spread(self, load: Load) -> Load:
        """A load, as one per area if it is a resultant."""
        return load

    def _density(self, load: Load, rule: Quadrature) -> tuple[FloatArray | None, Any]:
        """A load (n, m), per area or volume, at the points of a rule; and a flux, or None."""
        return load.at(rule.points, self.m), None

    @property
    def factors(self) -> tuple[Scalar, ...]:
        """Properties that are factors of the loads."""
        return ()

    # ---------------------------------------------------------------- the law

    @property
    def law(self) -> Law:
        """Which flux gradients make."""
        raise NotImplementedError

    @property
    def _told(self) -> dict[str, Any]:
        """What reports tell of the properties of the solid: values as they were given, by name."""
        return self.law.told

    def _flux(self, gradient: FloatArray, u: FloatArray, owner: IntArray) -> FloatArray:
        """Flux (n, entries) of gradients (n, m, 3) at parameters in active cells, by their phases.

        It is NaN with the gradient where there is none.
        """
        asm, phases = self.assembly, self.law.phases
        return self.domain.by_phase(
            lambda k, at: phases[k].flux(asm, u[at], gradient[at]), asm.space.cells[owner]
        )

    def _stored(self, flux: FloatArray, u: FloatArray, owner: IntArray) -> FloatArray:
        """Products (n,) of fluxes (n, entries) with the gradients that make them, likewise."""
        asm, phases = self.assembly, self.law.phases
        return self.domain.by_phase(
            lambda k, at: phases[k].stored(asm, u[at], flux[at]), asm.space.cells[owner]
        )

    def _ghost_stiffness(self, u: FloatArray, elements: IntArray) -> FloatArray:
        """What scales the penalty on jumps (n,) or (1,), at parameters of faces of elements."""
        asm, phases = self.assembly, self.law.phases
        return self.domain.by_phase(lambda k, at: phases[k].mean(asm, u[at]), elements)

    def _at_surface(self, rule: Quadrature) -> tuple[FloatArray, FloatArray]:
        """`Law.normal` and `Law.penalty` at the points of a surface in space, by their phases."""
        asm, u, n, phases = self.assembly, rule.parameters, rule.normals, self.law.phases
        assert u is not None
        assert n is not None
        elements = asm.space.cells[asm.owners(rule)]
        return (
            self.domain.by_phase(lambda k, at: phases[k].normal(asm, u[at], n[at]), elements),
            self.domain.by_phase(lambda k, at: phases[k].penalty(asm, u[at], n[at]), elements),
        )

    def _at_seam(self) -> list[FloatArray]:
        """`Law.normal` of both phases at the surface between them."""
        asm, rule = self.assembly, self.assembly.seam
        assert rule is not None
        assert rule.parameters is not None
        assert rule.normals is not None
        return [law.normal(asm, rule.parameters, rule.normals) for law in self.law.phases]

    def _with_pressure(self, terms: weak.Terms, scale: FloatArray) -> weak.Terms:
        """Terms of a support with what is projected cell by cell, of a penalty of some scale."""
        del scale
        return terms

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

    def _taken(self, terms: weak.Terms) -> FloatArray:
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
