"""Integrals of linear elasticity: matrices, loads, thermal stress, reactions.

What a problem of `Elasticity` is made of, on the functions of its assembly. Source: Hong et al.
2025, section 4 and Appendix A.

Guarantees: materials and loads are asked at points of rules, and checked there; matrices are made
cell by cell, of two phases each by its own. Non-guarantee: nothing is solved, held or checked for
being held here.
"""

import warnings
from dataclasses import dataclass, replace
from functools import cached_property, partial
from typing import Any, ClassVar

import numpy as np

from ilattice._typing import FloatArray, IntArray
from ilattice._validate import FixedMapping, as_points, read_only
from ilattice.cutfem import _kernels_assembly as kernels
from ilattice.cutfem import coupling, locking, watching
from ilattice.cutfem._voigt import PLACES, UNIT
from ilattice.cutfem.conditions import Connection, Known, Load, values_at
from ilattice.cutfem.dilatation import FROM, MAX_SMOOTH, Dilatation, as_terms
from ilattice.cutfem.discretization import Product
from ilattice.cutfem.material import Elastic, Property, Scalar
from ilattice.cutfem.pointwise import FluxOn, Terms
from ilattice.cutfem.problem import Problem
from ilattice.cutfem.regions import spread
from ilattice.errors import InputError, PrecisionWarning
from ilattice.quadrature.rules import Quadrature, on_cells

#: Poisson's ratio with which errors of solids that keep their volume are measured.
SOFT = 0.3


@dataclass(frozen=True, eq=False, init=False, repr=False)
class ElasticOperators(Problem):
    """What is integrated for problems of `Elasticity`.

    Attributes
    ----------
    material : Elastic
        Stiffness, density and thermal expansion.
    dilatation : {"auto", "full", "projected"}
        See `Elasticity`.
    connections : tuple of Connection
        Places that move as rigid bodies.
    """

    m: ClassVar[int] = 3
    flux_name: ClassVar[str] = "stress"
    material: Elastic
    dilatation: str
    connections: tuple[Connection, ...]

    def _check_solvable(self) -> None:
        if any(c.motion is None for c in self.connections):
            self._refuse_connections()

    def _refuse_connections(self) -> None:
        """Refuse matrices on nodes alone, which leave out motions of connections."""
        if self.connections:
            raise InputError(
                f"the rigid connection on {self.connections[0].on} has motions of its own, which "
                "are not in matrices on nodes: take solve, natural_modes or buckling, or clamp it"
            )

    @cached_property
    def projection(self) -> Dilatation | None:
        """What projects the change of volume, or None where it is taken at every point."""
        near = self._largest_nu >= FROM
        full = self.material.full
        if (self.dilatation == "full" or full) and near:
            warnings.warn(
                f"Poisson's ratio is up to {self._largest_nu:g}, and with "
                f"{'a stiffness=' if full else 'dilatation=full'} the solid locks: it is too stiff "
                f"by a tenth and more; take {'finer cells' if full else 'dilatation=auto'}",
                PrecisionWarning,
                stacklevel=3,
            )
        if self.dilatation == "full" or full or (self.dilatation == "auto" and not near):
            return None
        asm, space = self.assembly, self.assembly.space
        if near and space.degree == 3 and space.smoothness > MAX_SMOOTH:
            warnings.warn(
                f"Poisson's ratio is up to {self._largest_nu:g}, and cubic splines of smoothness 2 "
                "lock: they are too stiff by some per cent, and pressures may be of no use; take "
                "smoothness=1, or degree=2",
                PrecisionWarning,
                stacklevel=3,
            )

        def make() -> Dilatation:
            rules = self.domain.stiff_rules(asm, constant=self.material.constant)
            parts = (
                pair
                for rule in rules
                for pair in zip(self.material.phases, self.domain.of_phases(rule), strict=False)
            )
            return Dilatation.of(asm, parts, as_terms(space.degree, space.smoothness))

        if "projection" not in self._held:
            self._held["projection"] = make()
        made: Dilatation = self._held["projection"]
        return made

    @cached_property
    def _largest_nu(self) -> float:
        """Largest Poisson's ratio, that of the nearest isotropic stiffness, at points of rules."""
        parts = self.domain.of_phases(self.domain.volume)
        found = [-1.0]
        for m, part in zip(self.material.phases, parts, strict=False):
            found.append(m.ratio(self.assembly, part.points).max(initial=-1.0))
        return float(max(found))

    @property
    def law(self) -> Elastic:
        """See `Problem.law`."""
        return self.material

    def _matrix(self) -> Any:
        _ = self.projection  # warns of what locks, before anything else
        return super()._matrix()

    def _add_solid(self, data: FloatArray, phase: int, part: Quadrature) -> FloatArray:
        """Without the change of volume, if that is projected."""
        if self.projection is None:
            return super()._add_solid(data, phase, part)
        return self.material.phases[phase].add_shape(data, self.assembly, part)

    def mass(self, density: Property | None = None) -> Any:
        """Consistent mass matrix on the nodes of `system`.

        Parameters
        ----------
        density : float, str or callable, optional
            Mass per volume; by default that of the material.

        Returns
        -------
        bsr_array
            Rows of prescribed components are zero.
        """
        self._refuse_connections()
        return self.constraints.reduce(self._mass(density), diagonal=False)

    def _mass(self, density: Property | None = None) -> Any:
        """The mass matrix on all functions."""
        asm = self.assembly
        rho = self.material.density
        rho = rho if density is None else replace(rho, value=density)
        watching.check_property(self, rho)
        rule = on_cells(self.domain.volume, asm.space.cells)
        data = asm.zeros(3)
        d = self._scalar_at(rho, rule.points, asm.owners(rule))[:, None]
        asm.add_cells(data, rule, kernels.MASS, d)
        return asm.pattern.matrix(data).whole()

    def _geometric_stiffness(self, stress_on: FluxOn) -> Any:
        """The stiffness by the stress of a solution on all functions."""
        asm = self.assembly
        rule = on_cells(self.domain.volume, asm.space.cells)
        data = asm.zeros(3)
        asm.add_cells(data, rule, kernels.TENSOR, stress_on(rule))
        return asm.pattern.matrix(data).whole()

    # ---------------------------------------------------------------- supports

    def _taken(self, terms: Terms) -> FloatArray:
        """With the tractions of hindered expansion."""
        out, rule = super()._taken(terms), terms.rule
        for load in self.loads:
            if load.kind == "temperature":
                assert rule.parameters is not None
                assert rule.normals is not None
                owner = self.assembly.owners(rule)
                stress = self._thermal_stress(load, rule.parameters, owner)
                out += terms.held(self.law.through(stress, rule.normals))
        return out

    def _with_pressure(self, terms: Terms, scale: FloatArray) -> Terms:
        """See `Problem._with_pressure`: λ is apart, with a penalty of what it can do in a cell."""
        rule, projection = terms.rule, self.projection
        if projection is None:
            return terms
        u, n = rule.parameters, rule.normals
        assert u is not None
        assert n is not None
        owner = self.assembly.owners(rule)
        lam = np.array(np.broadcast_to(self._lame(u, owner)[0], len(u)))
        least = 2.0 * projection.traces(rule, rule.weights * lam)[rule.owners]
        Q = (np.maximum(least - scale, 0.0) * lam)[:, None, None] * (n[:, :, None] * n[:, None, :])
        assert terms.normal is not None
        of_pressure = lam[:, None, None, None] * np.einsum("qi,jl->qijl", n, np.eye(3))
        return replace(
            terms, Q=terms.Q + Q, normal=terms.normal - of_pressure, projection=projection,
            pressure=lam,
        )  # fmt: skip

    def _at_seam(self) -> list[FloatArray]:
        """Without the change of volume, if that is projected."""
        asm, rule = self.assembly, self.assembly.seam
        if self.projection is None:
            return super()._at_seam()
        assert rule is not None
        assert rule.parameters is not None
        assert rule.normals is not None
        u, n = rule.parameters, rule.normals
        return [law.normal_of_shape(asm, u, n) for law in self.material.phases]

    def _add_projected(self, data: FloatArray) -> None:
        """See `Problem._add_projected`."""
        if self.projection is None:
            return
        self.projection.add(data)
        asm = self.assembly
        if asm.seam is not None:
            assert asm.seam.parameters is not None
            first, second = (m.lame(asm, asm.seam.parameters)[0] for m in self.material.phases)
            coupling.add_projected(data, self, self.projection, (first, second))

    def _lame(self, u: FloatArray, owner: IntArray) -> tuple[FloatArray, FloatArray]:
        """Lamé constants (n,) or (1,) at parameters in active cells, by the phases of these."""
        asm, phases = self.assembly, self.material.phases
        lam, mu = self.domain.by_phase(
            lambda k, at: np.stack(phases[k].lame(asm, u[at]), axis=1), asm.space.cells[owner]
        ).T
        return lam, mu

    # ---------------------------------------------------------------- loads

    @property
    def factors(self) -> tuple[Scalar, ...]:
        """See `Problem.factors`."""
        kinds, m = {load.kind for load in self.loads}, self.material
        of = {"gravity": m.density, "temperature": m.expansion}
        return tuple(scalar for kind, scalar in of.items() if kind in kinds)

    def _force(self, load: Load) -> FloatArray:
        f = super()._force(load)
        if load.kind == "temperature" and self.assembly.seam is not None:
            f += coupling.thermal_force(self, partial(self._thermal_stress, load))
        return f

    def _is_constant(self, load: Load) -> bool:
        """Where the material is, too."""
        material = self.material
        return super()._is_constant(load) and material.constant and material.density.constant

    def _spread(self, load: Load) -> Load:
        """A load, as tractions if it is a resultant."""
        if load.kind not in ("force", "moment"):
            return load
        rule = self.domain.edge(self.assembly, load.on)
        return Load("traction", spread(load.kind, np.array(load.value), rule), load.on)

    def _density(self, load: Load, rule: Quadrature) -> tuple[FloatArray | None, FloatArray | None]:
        """Force f (n, 3) and stress P (n, 3, 3) of a load at the points of a rule in space."""
        assert rule.parameters is not None
        if load.kind == "temperature":
            s = self._thermal_stress(load, rule.parameters, self.assembly.owners(rule))
            nowhere = np.flatnonzero(~np.isfinite(s).all(axis=1))
            if len(nowhere):
                at = ", ".join(f"{c:.4g}" for c in rule.points[nowhere[0]])
                raise InputError(
                    f"temperature: the solution of heat has none at ({at}); solve it on all of the "
                    "solid"
                )
            return None, s[:, PLACES]
        if load.kind == "pressure":
            assert rule.normals is not None
            return -load.at(rule.points, 1) * rule.normals, None
        value, nothing = super()._density(load, rule)
        if load.kind == "gravity":
            assert value is not None
            owner = self.assembly.owners(rule)
            value *= self._scalar_at(self.material.density, rule.parameters, owner)[:, None]
        return value, nothing

    def thermal_strain(self, u: FloatArray) -> FloatArray:
        """Strain of free expansion in every direction, under all temperatures.

        Parameters
        ----------
        u : ndarray, shape (n, 3)
            Parameters.

        Returns
        -------
        ndarray, shape (n,)
            α ΔT.
        """
        u = as_points("u", u)
        return self._thermal_strain(u, self.assembly.space.locate(u))

    def _thermal_strain(self, u: FloatArray, owner: IntArray) -> FloatArray:
        """`thermal_strain` at parameters in active cells."""
        heated = (load for load in self.loads if load.kind == "temperature")
        return sum((self._expansion(load, u, owner) for load in heated), np.zeros(len(u)))

    def _expansion(self, load: Load, u: FloatArray, owner: IntArray) -> FloatArray:
        """Free expansion (n,) under one temperature at parameters in active cells."""
        phases = self.material.phases
        return self.domain.by_phase(
            lambda k, at: self._expansion_of(phases[k], load, u[at]),
            self.assembly.space.cells[owner],
        )

    def _thermal_stress(self, load: Load, u: FloatArray, owner: IntArray) -> FloatArray:
        """Stress that would keep a heated solid from expanding, with the other sign.

        Parameters
        ----------
        load : Load
            A temperature.
        u : ndarray, shape (n, 3)
            Parameters.
        owner : ndarray, shape (n,)
            Active cells they are in.

        Returns
        -------
        ndarray, shape (n, 6)
            (3 λ + 2 μ) α ΔT on the diagonal, the change of volume 3 α ΔT projected if that of the
            solid is; xx, yy, zz, yz, xz, xy.
        """
        asm = self.assembly
        if self.projection is None:
            phases = self.material.phases
            return self.domain.by_phase(
                lambda k, at: (
                    phases[k].hindered(asm, u[at])
                    * self._expansion_of(phases[k], load, u[at])[:, None]
                ),
                asm.space.cells[owner],
            )
        lam, mu = self._lame(u, owner)
        projected = self.projection.at(self.projected_expansion[load], u, owner)
        strain = 3 * lam * projected + 2 * mu * self._expansion(load, u, owner)
        return np.multiply.outer(strain, UNIT)

    @cached_property
    def projected_expansion(self) -> FixedMapping[Load, FloatArray]:
        """Projections (cells, terms) of α ΔT of every temperature, if there are any."""
        if self.projection is None:
            return FixedMapping()
        rule = on_cells(self.domain.volume, self.assembly.space.cells)
        parts = zip(self.material.phases, self.domain.of_phases(rule), strict=False)
        heated = [load for load in self.loads if load.kind == "temperature"]
        found: dict[Load, FloatArray] = {}
        for m, part in parts:
            for load in heated if len(part) else ():
                rise = self._expansion_of(m, load, part.points)
                mine = self.projection.of_values(m, part, rise)
                found[load] = found[load] + mine if load in found else mine
        return FixedMapping({load: read_only(values) for load, values in found.items()})

    def _expansion_of(self, material: Elastic, load: Load, u: FloatArray) -> FloatArray:
        """Free expansion α ΔT (n,) of a phase under one temperature at parameters (n, 3)."""
        asm, value = self.assembly, load.value
        if isinstance(value, Known):
            rise = value._within(asm, u)
        else:
            rise = values_at("temperature", value, asm.x(u), 1)[:, 0]
        return material.expansion.at(asm, u) * rise

    def _rigid_modes(self, x: FloatArray) -> FloatArray:
        out = np.zeros((len(x), 3, 6))
        for i in range(3):
            j, k = (i + 1) % 3, (i + 2) % 3
            out[:, i, i] = 1.0
            out[:, j, 3 + i] = -x[:, k]
            out[:, k, 3 + i] = x[:, j]
        return out

    def _starts(self, x: FloatArray) -> FloatArray:
        """All that is linear where heat expands the solid: freely, it stores no energy."""
        if not any(f.kind == "temperature" for f in self.loads):
            return self._rigid_modes(x)
        out = np.zeros((len(x), 3, 12))
        for i in range(3):
            out[:, i, i] = 1.0
            out[:, i, 3 + 3 * i : 6 + 3 * i] = x
        return out

    # ---------------------------------------------------------------- errors

    @property
    def _keeps_volume(self) -> bool:
        return self.projection is not None

    def _locked(self, c: FloatArray) -> float:
        return locking.relative_error(self, c)

    def _discretization_error(self, product: Product, c: FloatArray, energy: float) -> float:
        """As of all problems; where volumes are kept, in the energy of a solid that gives in.

        Coarse splines cannot keep the volume of every fine cell, so that their distance would grow
        with the bulk modulus, which the error does not.
        """
        if self.projection is None:
            return super()._discretization_error(product, c, energy)
        if "soft" not in self._held:
            like = self._with(material=self.material.softer(SOFT), dilatation="full", _held={})
            like._set(assembly=self.assembly)  # which tells what is left out when it is made
            self._held["soft"] = like
        like = self._held["soft"]
        K = like._reduced()

        def times(x: FloatArray) -> FloatArray:
            y = np.empty_like(x)
            K.multiply(x, y, 0)
            return y

        return Problem._discretization_error(like, times, c, energy)
