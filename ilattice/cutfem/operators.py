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
from typing import TYPE_CHECKING, Any, ClassVar, cast

import numpy as np

from ilattice._typing import FloatArray, IntArray
from ilattice._validate import FixedMapping, as_kind, as_points, read_only
from ilattice.cutfem import _kernels_assembly as kernels
from ilattice.cutfem import coupling, watching, weak
from ilattice.cutfem._voigt import PLACES, UNIT
from ilattice.cutfem.anisotropic import AT_ONCE, Anisotropic, Material, hindered
from ilattice.cutfem.assembly import Assembly
from ilattice.cutfem.conditions import Load, Support, values_at
from ilattice.cutfem.dilatation import FROM, MAX_SMOOTH, Dilatation, as_terms
from ilattice.cutfem.material import (
    CALM,
    Isotropic,
    Property,
    Scalar,
    jump_within_cells,
    warn_of_jump,
)
from ilattice.cutfem.overlaps import loads_at
from ilattice.cutfem.problem import Problem
from ilattice.cutfem.regions import spread
from ilattice.cutfem.rigid import Connection
from ilattice.errors import InputError, PrecisionWarning
from ilattice.macroshape.maps import SplineMap
from ilattice.quadrature.rules import Quadrature, on_cells, some_cells

if TYPE_CHECKING:
    from ilattice.cutfem.solution import Solution


@dataclass(frozen=True, eq=False, init=False, repr=False)
class ElasticOperators(Problem):
    """What is integrated for problems of `Elasticity`.

    Attributes
    ----------
    material : Material
        Stiffness, density and thermal expansion.
    dilatation : {"auto", "full", "projected"}
        See `Elasticity`.
    connections : tuple of Connection
        Places that move as rigid bodies.
    """

    m: ClassVar[int] = 3
    material: Material
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
            if isinstance(m, Anisotropic):
                lam, mu = m.lame(self.assembly, part.points)
                found.append((0.5 * lam / (lam + mu)).max(initial=-1.0))
            else:
                found.append(m.poisson.at(self.assembly, part.points).max(initial=-1.0))
        return float(max(found))

    def _matrix(self) -> Any:
        asm = self.assembly
        data = asm.zeros(3)
        projection = self.projection
        whole = 0.0 if projection is not None else 1.0
        jump = CALM
        phases = self.material.phases
        uniform = all(m.constant for m in phases)
        for rule in self.domain.stiff_rules(asm, constant=uniform):
            for m, part in zip(phases, self.domain.of_phases(rule), strict=False):
                if isinstance(m, Anisotropic):
                    jump = np.maximum(jump, self._add_matrices(data, m, part))
                    continue
                lame = m.lame(asm, part.points)
                if uniform:
                    lam, mu = (float(v[0]) for v in lame)
                    asm.add_cells(data, part, kernels.PAIRS, np.ones((1, 1)), whole * lam, mu)
                    continue
                jump = np.maximum(jump, jump_within_cells(part, lame[1], partial(_shear, m, asm)))
                for v, p, q in zip(lame, (whole, 0.0), (0.0, 1.0), strict=True):
                    if p or q:
                        d = np.broadcast_to(v, len(part))[:, None].copy()
                        asm.add_cells(data, part, kernels.PAIRS, d, p, q)
        warn_of_jump("stiffness" if self.material.full else "young", jump)
        self._held["unfollowed"] = float(jump[1])
        if projection is not None:
            projection.add(data)
        asm.add_ghost(data, self._ghost_stiffness)
        for support in self.in_the_mean:
            weak.add_elastic(data, self, weak.elastic_terms(self, support))
        if asm.seam is not None:
            coupling.add_elastic(data, self)
        return asm.pattern.matrix(data)

    def _add_matrices(self, data: FloatArray, m: Anisotropic, part: Quadrature) -> FloatArray:
        """Add the stiffness of a phase that is given by matrices; by how much it jumps."""
        asm = self.assembly
        if m.constant:
            C = np.array(m.matrices(asm, part.points[:1]).reshape(1, 36))  # of the writable type
            asm.add_cells(data, part, kernels.STIFFNESS, C)
            return CALM
        count = len(part.cells)
        step = max(AT_ONCE * count // max(len(part), 1), 1)
        for i in range(0, count, step):
            some = some_cells(part, slice(i, min(i + step, count)))
            C = m.matrices(asm, some.points).reshape(-1, 36)
            asm.add_cells(data, some, kernels.STIFFNESS, np.ascontiguousarray(C))
        return jump_within_cells(part, m.lame(asm, part.points)[1], partial(_shear, m, asm))

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
        return asm.pattern.matrix(data)

    def geometric_stiffness(self, solution: "Solution") -> Any:
        """Stiffness by the stress of a solution, for buckling, on the nodes of `system`.

        Parameters
        ----------
        solution : Solution
            Of this problem with any loads.

        Returns
        -------
        bsr_array
            The integral of grad v . stress . grad u; rows of prescribed components are zero.
        """
        self._refuse_connections()
        return self.constraints.reduce(self._geometric_stiffness(solution), diagonal=False)

    def _geometric_stiffness(self, solution: "Solution") -> Any:
        """The stiffness by stress on all functions."""
        asm = self.assembly
        self._own(as_kind("solution", solution, "Solution"))
        rule = on_cells(self.domain.volume, asm.space.cells)
        data = asm.zeros(3)
        asm.add_cells(data, rule, kernels.TENSOR, solution.stress_on(rule))
        return asm.pattern.matrix(data)

    # ---------------------------------------------------------------- supports

    def _from_supports(self) -> FloatArray:
        f = np.zeros((len(self.assembly.space), 3))
        for support in self.in_the_mean:
            terms = weak.elastic_terms(self, support)
            f += weak.elastic_force(self, terms, support.value)
            if isinstance(support, Support):
                f -= weak.thermal_force(self, terms)
                w = terms.rule.weights[:, None]
                f -= self.assembly.vector(terms.rule, w * terms.held(loads_at(self, terms.rule)))
        return f

    def _ghost_stiffness(self, u: FloatArray, elements: IntArray) -> FloatArray:
        """2 μ."""
        asm, phases = self.assembly, self.material.phases
        return 2.0 * self.domain.by_phase(lambda k, at: phases[k].lame(asm, u[at])[1], elements)

    def _lame(self, u: FloatArray, owner: IntArray) -> tuple[FloatArray, FloatArray]:
        """Lamé constants (n,) or (1,) at parameters in active cells, by the phases of these."""
        asm, phases = self.assembly, self.material.phases
        lam, mu = self.domain.by_phase(
            lambda k, at: np.stack(phases[k].lame(asm, u[at]), axis=1), asm.space.cells[owner]
        ).T
        return lam, mu

    def _matrices(self, u: FloatArray, owner: IntArray) -> FloatArray:
        """Stiffness (n, 6, 6) or (1, 6, 6), likewise, of a material that is given by them."""
        asm, phases = self.assembly, self.material.phases
        return self.domain.by_phase(
            lambda k, at: phases[k].matrices(asm, u[at]),  # type: ignore[union-attr]
            asm.space.cells[owner],
        )

    def reactions(self, solution: "Solution") -> dict[str, FloatArray]:
        """Forces (3,) that places of supports and springs exert on the solid.

        Parameters
        ----------
        solution : Solution
            Of this problem.

        Returns
        -------
        dict of str to ndarray
            Sums over all supports and springs of each place.
        """
        self._own(as_kind("solution", solution, "Solution"))
        out = self._strong_reactions(solution.coefficients)
        for support in self.in_the_mean:
            terms = weak.elastic_terms(self, support)
            force = weak.elastic_reaction(self, terms, support.value, solution).sum(axis=0)
            out[str(support.on)] = out.get(str(support.on), 0.0) + force
        return out

    # ---------------------------------------------------------------- loads

    @property
    def factors(self) -> tuple[Scalar, ...]:
        """See `Problem.factors`."""
        kinds, m = {load.kind for load in self.loads}, self.material
        of = {"gravity": m.density, "temperature": m.expansion}
        return tuple(scalar for kind, scalar in of.items() if kind in kinds)

    def _force(self, load: Load) -> FloatArray:
        asm, load = self.assembly, self._spread(load)
        constant = not (callable(load.value) or hasattr(load.value, "evaluate"))
        constant = constant and self.material.constant and self.material.density.constant
        rule = (
            self.domain.edge(asm, load.on)
            if load.on
            else self.domain.stiff_rule(asm, constant=constant)
        )
        f = asm.vector_by_parts(rule, 3, partial(self._density, load))
        if load.kind == "temperature" and asm.seam is not None:
            f += coupling.thermal_force(self, load)
        return f

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
            return -values_at(load.kind, load.value, rule.points, 1) * rule.normals, None
        value = values_at(load.kind, load.value, rule.points, 3)
        if load.kind == "gravity":
            owner = self.assembly.owners(rule)
            value *= self._scalar_at(self.material.density, rule.parameters, owner)[:, None]
        return value, None

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
                    hindered(phases[k], asm, u[at])
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
            assert isinstance(m, Isotropic)  # no other is projected
            for load in heated if len(part) else ():
                rise = self._expansion_of(m, load, part.points)
                mine = self.projection.of_values(m, part, rise)
                found[load] = found[load] + mine if load in found else mine
        return FixedMapping({load: read_only(values) for load, values in found.items()})

    def _expansion_of(self, material: Material, load: Load, u: FloatArray) -> FloatArray:
        """Free expansion α ΔT (n,) of a phase under one temperature at parameters (n, 3)."""
        asm, known = self.assembly, cast(Any, load.value)
        if not hasattr(known, "evaluate"):
            rise = values_at("temperature", load.value, asm.x(u), 1)[:, 0]
        elif _same(known.problem.assembly.through, asm.through):
            rise = known.evaluate(u)
        else:
            rise = known.at(asm.x(u), outside="nan").temperature
        out: FloatArray = material.expansion.at(asm, u) * rise
        return out

    def _motions(self, x: FloatArray) -> FloatArray:
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
            return self._motions(x)
        out = np.zeros((len(x), 3, 12))
        for i in range(3):
            out[:, i, i] = 1.0
            out[:, i, 3 + 3 * i : 6 + 3 * i] = x
        return out


def _shear(material: Material, asm: Assembly, u: FloatArray) -> FloatArray:
    """Shear modulus (n,) at parameters."""
    return np.broadcast_to(material.lame(asm, u)[1], len(u))


def _same(a: SplineMap | None, b: SplineMap | None) -> bool:
    """Whether maps are sure to take equal parameters to equal points."""
    if a is b or a is None or b is None:
        return a is b
    s, t = a.spline, b.spline
    weights = [np.ones(1) if one.weights is None else one.weights for one in (s, t)]
    return (
        (s.k, s.periodic) == (t.k, t.periodic)
        and all(map(np.array_equal, s.t, t.t))
        and np.array_equal(s.c[..., :3], t.c[..., :3])
        and np.array_equal(weights[0], weights[1])
    )
