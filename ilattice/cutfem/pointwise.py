"""Problems at points: functions, and what law, loads and supports are at points of rules.

What conditions on surfaces, phases and checks are made of, before anything is integrated.

Guarantees: parts that nothing holds are found before anything is integrated, and reported with
volume and place; of two phases each point has its own law.
"""

import warnings
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import Any, ClassVar

import numpy as np

from ilattice._typing import FloatArray, IntArray
from ilattice._validate import read_only
from ilattice.cutfem.assembly import Assembly
from ilattice.cutfem.conditions import Load, stiffness_at
from ilattice.cutfem.dilatation import Dilatation
from ilattice.cutfem.law import Law
from ilattice.cutfem.material import Scalar
from ilattice.cutfem.posed import Posed
from ilattice.errors import GeometryError, PrecisionWarning
from ilattice.quadrature.rules import Quadrature

#: Takes a rule in the active cells; returns the flux (n, entries) of a solution at its points.
FluxOn = Callable[[Quadrature], FloatArray]


@dataclass(frozen=True, eq=False)
class Terms:
    """The integral of u·Q v - held u·t(v) - held v·t(u), with what flows through the surface, t.

    Attributes
    ----------
    rule : Quadrature
        In space.
    Q : ndarray, shape (n, m, m)
        Symmetric stiffness per area.
    normal : ndarray, shape (n, m, m, 3), or None
        What makes the held part of t of gradients, see `Law.normal`; None for springs.
    mask : ndarray, shape (m,)
        1 in components that are held.
    onto : ndarray, shape (n, m, m), or None
        Projections onto what is held, in place of `mask`.
    projection : Dilatation or None
        What projects the change of volume, of which tractions are not in `normal` then.
    pressure : ndarray, shape (n,)
        λ of these, or nothing.
    """

    rule: Quadrature
    Q: FloatArray
    normal: FloatArray | None
    mask: FloatArray
    onto: FloatArray | None = None
    projection: Dilatation | None = None
    pressure: FloatArray | float = 0.0

    def held(self, vectors: FloatArray) -> FloatArray:
        """The parts that are held of vectors (n, m, ...) at points."""
        if self.onto is None:
            return vectors * self.mask.reshape(-1, *[1] * (vectors.ndim - 2))
        return np.einsum("qij,qj...->qi...", self.onto, vectors)


@dataclass(frozen=True, eq=False, init=False, repr=False)
class Pointwise(Posed):
    """A solid with supports, loads and a law, on its functions.

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

    def _with_pressure(self, terms: Terms, scale: FloatArray) -> Terms:
        """Terms of a support with what is projected cell by cell, of a penalty of some scale."""
        del scale
        return terms

    # ---------------------------------------------------------------- loads

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
