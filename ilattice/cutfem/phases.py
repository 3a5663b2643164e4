"""Solids of two materials: the cells are cut by the surface between them, too.

A level set divides the solid into a first phase, where it is negative, and a second one. Each has
elements and functions of its own, so that strains may jump between them, and Nitsche's method holds
them together (A. Hansbo and P. Hansbo, 2002; see `weak`). Functions that pass through the surface
between them cannot bend there, and make laminates and composites too stiff or too weak by the part
of the cells that are cut.

Guarantees: both phases are integrated like any solid, by certified signs; solutions that are
polynomials of the degree of the space in both phases are exact, wherever the surface cuts.
Non-guarantee: layers of one phase within the other that are thinner than some thirtieth of a cell
may not be seen; nothing slides and nothing comes loose.
"""

import warnings
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any, ClassVar

import numpy as np

from ilattice._geometry import cells_at, grid_points, wrapped
from ilattice._typing import AnyArray, FloatArray, IntArray
from ilattice._validate import as_array, asked, read_only
from ilattice.bspline import BSpline
from ilattice.cutfem.connectivity import Parts, connected_parts
from ilattice.cutfem.domain import Domain, OfPhase, as_domain, where
from ilattice.cutfem.elements import ElementGrid, elements_of, regrouped
from ilattice.errors import GeometryError, InputError, PrecisionWarning
from ilattice.fields.node import Node
from ilattice.macroshape.maps import SplineMap
from ilattice.offsets.kinks import JumpError, fit_with_kinks
from ilattice.offsets.thickness import as_equation, of_parameters
from ilattice.quadrature._filling import MAX_POINTS
from ilattice.quadrature.cutting import CutGrid, check_resolved
from ilattice.quadrature.grid import CUT, IN, OUT, DividedGrid, Grid
from ilattice.quadrature.levelsets import MAX_DEGREE
from ilattice.quadrature.making import rule_on
from ilattice.quadrature.rules import NAMES, Quadrature, in_space, kept, sums_of_cells

#: Error of the spline of a level set, relative to its largest value: asked, and told.
FIT, TOLD = 1e-9, 1e-4
#: Part of a cell up to which a phase only touches it, as a sphere does a plane of the grid.
TOUCHED = 1e-18
#: How far, in cells, points on the faces of cells are moved to find the cell behind.
BEHIND = 1e-8
#: Part of the surface between phases that may join nothing without a word, and by which its area
#: may differ from one side to the other.
LOOSE, AGREE = 1e-3, 1e-2
ORDINALS = ("first", "second")


@dataclass(frozen=True, eq=False, repr=False)
class PhasedGrid(DividedGrid):
    """A grid with the elements of two phases.

    Attributes
    ----------
    level : callable
        Takes parameters (n, 3), returns values (n,), negative in the first phase.
    grids : tuple of ElementGrid
        Elements of each phase.
    numbers : tuple of ndarray
        Number here of every element of them, -1 for those without points.
    several : ndarray
        Cells with more than one element, increasing.
    """

    level: Any = field(kw_only=True)
    grids: tuple[ElementGrid, ElementGrid] = field(kw_only=True)
    numbers: tuple[IntArray, IntArray] = field(kw_only=True)

    @cached_property
    def several(self) -> IntArray:
        """Cells with more than one element."""
        return read_only(np.unique(self.parents))

    @cached_property
    def gaps(self) -> FloatArray:
        """See `ElementGrid.gaps`."""
        return read_only(np.concatenate([g.gaps for g in self.grids]))

    @cached_property
    def second(self) -> AnyArray:
        """Whether elements are of the second phase."""
        out = np.zeros(self.count + len(self.parents), bool)
        out[self.numbers[1][self.numbers[1] >= 0]] = True
        return read_only(out)

    def element_at(self, u: FloatArray, cells: IntArray) -> IntArray:
        """See `ElementGrid.element_at`."""
        found = [n[g.element_at(u, cells)] for g, n in zip(self.grids, self.numbers, strict=True)]
        low, high = found
        first = self.level(u) < 0.0
        return np.where(first & (low >= 0) | (high < 0), low, high)

    def renumbered(self, rule: Quadrature, phase: int) -> Quadrature:
        """A rule by cells on one phase as one by elements; points beside all of them are left out.

        Parameters
        ----------
        rule : Quadrature
            Of the phase, in parameters.
        phase : {0, 1}
            Which.

        Returns
        -------
        Quadrature
            Sorted by element.
        """
        rule = self.grids[phase].divided(rule)
        names = self.numbers[phase]
        low, high = names[rule.cells][rule.owners], None
        keep = low >= 0
        if rule.neighbours is not None:
            high = names[rule.neighbours][rule.owners]
            keep &= high >= 0
        return regrouped(replace(rule, grid=self), low, high, keep)


@dataclass(frozen=True, eq=False)
class PhasedDomain(Domain):
    """A solid of two phases on its grid.

    Attributes
    ----------
    phases : tuple of CutGrid
        The solid where the level set is negative, and where it is positive.
    level : callable
        See `PhasedGrid`.
    """

    phased: ClassVar[bool] = True
    phases: tuple[CutGrid, CutGrid] = field(kw_only=True)
    level: Any = field(kw_only=True)

    def second(self, u: FloatArray) -> AnyArray:
        """Whether points (n, 3) of parameters are in the second phase."""
        return np.asarray(self.level(u) >= 0.0)

    def by_phase(self, values: OfPhase, elements: IntArray) -> FloatArray:
        """See `Domain.by_phase`."""
        second = self.elements.second[elements]
        if second.all() or not second.any():
            return values(int(second.any()), slice(None))
        rows = np.flatnonzero(~second), np.flatnonzero(second)
        both = [values(k, at) for k, at in enumerate(rows)]
        out = np.empty((len(elements), *both[0].shape[1:]))
        for at, found in zip(rows, both, strict=True):
            out[at] = found
        return out

    def of_phases(self, rule: Quadrature) -> tuple[Quadrature, ...]:
        """See `Domain.of_phases`."""
        second = self.elements.second[rule.cells]
        return kept(rule, ~second), kept(rule, second)

    @property
    def solids(self) -> tuple[CutGrid, ...]:
        """See `Domain.solids`."""
        return self.phases

    @cached_property
    def status(self) -> AnyArray:
        """See `CutGrid.status`; cells that the surface between phases cuts are cut."""
        a, b = (c.status for c in self.phases)
        whole = np.where((a == IN) | (b == IN), IN, OUT)
        return read_only(np.where((a == CUT) | (b == CUT), CUT, whole))

    @cached_property
    def _volumes(self) -> tuple[Quadrature, Quadrature]:
        a, b = (_more_than_touching(c.volume(self.q)) for c in self.phases)
        return a, b

    @cached_property
    def elements(self) -> PhasedGrid:  # type: ignore[override]
        """The elements of both phases."""
        both = (elements_of(c, r) for c, r in zip(self.phases, self._volumes, strict=True))
        (a, b), rules = zip(*both, strict=True)
        solid = [np.unique(r.cells) for r in rules]
        names = [np.full(a.count + len(g.parents), -1) for g in (a, b)]
        names[0][solid[0]] = solid[0]
        taken = np.isin(solid[1], solid[0]) | (solid[1] >= a.count)
        new = solid[1][taken]
        names[1][solid[1][~taken]] = solid[1][~taken]
        names[1][new] = a.count + len(a.parents) + np.arange(len(new))
        return PhasedGrid(
            a.axes, a.closed, level=self.level, grids=(a, b),
            numbers=(read_only(names[0]), read_only(names[1])),
            parents=read_only(np.concatenate([a.parents, b.home(new)]).astype(np.int64)),
        )  # fmt: skip

    def _both(self, rules: Any) -> Quadrature:
        """One rule by elements of those by cells on each phase."""
        a, b = (self.elements.renumbered(r, k) for k, r in enumerate(rules))
        return _together(a, b)

    @cached_property
    def volume(self) -> Quadrature:
        """See `Domain.volume`."""
        return self._both(self._volumes)

    def finer(self, cells: IntArray, more: int) -> Quadrature:
        """See `Domain.finer`."""
        q = min(self.q + more, MAX_POINTS)
        both = zip(self.phases, self._volumes, strict=True)
        mine = [(c, np.intersect1d(cells, r.cells)) for c, r in both]
        return self._both([rule_on(c, "volume", some, q) for c, some in mine])

    @cached_property
    def interior_facets(self) -> tuple[Quadrature, ...]:
        """See `Domain.interior_facets`: there is no face between elements of two phases."""
        faces = (self._both([c.faces(a, 1) for c in self.phases]) for a in range(3))
        return tuple(sums_of_cells(rule) for rule in faces)

    @cached_property
    def parts(self) -> Parts:
        """Connected parts of the solid; phases that touch hang together."""
        return connected_parts(self.volume, self.interior_facets, self._between)

    def _by_elements(self, on: str) -> Quadrature:
        if on in NAMES:
            return self._both([c.face(on, self.q) for c in self.phases])
        return self._both([boundary for boundary, _ in self._boundaries])

    @cached_property
    def _boundaries(self) -> list[tuple[Quadrature, Quadrature]]:
        """The boundary of the solid around each phase, and that between both, by cells."""
        return [(where(r, ~inner), where(r, inner)) for r, inner, _ in self._shared]

    @cached_property
    def _shared(self) -> list[tuple[Quadrature, AnyArray, AnyArray]]:
        """Rules on the boundaries of phases, points in the solid, and others on the level set."""
        rules = [cut.surface(self.q) for cut in self.phases]
        return [(r, *self._goes_on(r, phase)) for phase, r in enumerate(rules)]

    def _goes_on(self, rule: Quadrature, phase: int) -> tuple[AnyArray, AnyArray]:
        """Whether points of the boundary of a phase are between both, and on the level set alone.

        Level sets that coincide there take turns as the one on which points lie.
        """
        assert rule.normals is not None
        home = rule.cells[rule.owners]
        u = rule.points + BEHIND * rule.normals * self.cut.grid.boxes(home)[:, 3:]
        there, u = _cells_at(self.cut.grid, u)
        solid = there >= 0
        solid[solid] = (self.cut.sets(u[solid]) < 0.0).all(axis=1)
        on = np.asarray(rule.sets) == self.cut.sets.count
        on[there >= 0] |= self.second(u[there >= 0]) == (phase == 0)
        return solid & on, ~solid & on

    @cached_property
    def _between(self) -> Quadrature:
        """Rule on the surface between phases, normals to the second, in parameters."""
        phase = _better(self._shared)
        rule = self.elements.renumbered(self._boundaries[phase][1], phase)
        mine = rule.cells[rule.owners]
        other = self._behind(rule, self.elements.home(mine), 1 - phase)
        keep = other >= 0
        _check_joined(rule.weights, keep)
        if not phase:
            return regrouped(rule, mine, other, keep)
        assert rule.normals is not None
        return regrouped(replace(rule, normals=-rule.normals), other, mine, keep)

    def _behind(self, rule: Quadrature, cells: IntArray, phase: int) -> IntArray:
        """Elements of a phase at points of the boundary of the other one; -1 for none."""
        grid, names = self.elements, self.elements.numbers[phase]
        out = names[grid.grids[phase].element_at(rule.points, cells)]
        none = np.flatnonzero(out < 0)  # the surface is a face of the cell
        if len(none):
            assert rule.normals is not None
            u = rule.points[none] + BEHIND * rule.normals[none] * grid.boxes(cells[none])[:, 3:]
            there, u = _cells_at(grid, u)
            found = names[grid.grids[phase].element_at(u, np.maximum(there, 0))]
            out[none] = np.where(there >= 0, found, -1)
        return out

    @cached_property
    def interface(self) -> Quadrature:
        """The surface between phases in space, by pairs of elements, normals to the second one."""
        return in_space(self._between)


def as_phased(field: Any, cells: Any, *, phases: Any, stabilization: str, **options: Any) -> Domain:
    """Check the arguments that all problems share; see `as_domain`.

    Parameters
    ----------
    field, cells, stabilization, **options : optional
        Those of `as_domain`.
    phases : BSpline, Node, str, callable or None
        Level set, negative in the first phase; see `Elasticity`.

    Returns
    -------
    Domain
        Nothing is integrated yet.

    Raises
    ------
    InputError
        If an argument is wrong.
    GeometryError
        If a phase is empty.
    """
    if phases is None:
        return as_domain(field, cells, stabilization=stabilization, **options)
    if isinstance(field, Domain):
        raise InputError("phases: a domain has its own; leave them out, or give the solid")
    if stabilization not in ("auto", "ghost"):
        raise InputError(
            f"stabilization must be 'auto' or 'ghost' for two phases, got {stabilization!r}"
        )
    return _divided(as_domain(field, cells, stabilization="ghost", **options), phases)


def _divided(domain: Domain, phases: Any) -> PhasedDomain:
    """A domain cut by a level set."""
    sets, through = domain.cut.sets, domain.cut.through
    level = _as_level(phases, through)
    if not sets.fields:
        level = _as_spline(level, sets.domain)
    cuts = []
    for sign, word in zip((1.0, -1.0), ORDINALS, strict=True):
        part = CutGrid(domain.cut.grid, sets.also(level, sign), through)
        if (part.status == OUT).all():
            raise GeometryError(
                f"phases: no part of the solid is in the {word} phase; move the level set, or "
                "leave it out"
            )
        check_resolved(part, f"{word} phase")
        cuts.append(part)
    return PhasedDomain(
        domain.cut, domain.degree, domain.smoothness, domain.q, domain.stabilization,
        domain.weight, domain.wall, named=domain.named, phases=(cuts[0], cuts[1]), level=level,
    )  # fmt: skip


def _more_than_touching(rule: Quadrature) -> Quadrature:
    """A rule on a phase without the cells that it only touches, which have no stiffness to sum."""
    whole = rule.grid.boxes(rule.cells)[:, 3:].prod(axis=1)
    return kept(rule, rule.integrate_cells() > TOUCHED * whole)


def _better(shared: list[tuple[Quadrature, AnyArray, AnyArray]]) -> int:
    """The phase of which the boundary tells best what of it both phases share.

    Where the level set coincides with faces of the solid, one side does not see their edges.
    """
    areas = [r.weights[inner].sum() for r, inner, _ in shared]
    off = abs(areas[0] - areas[1]) / max(*areas, 1e-300)
    if off > AGREE:
        warnings.warn(
            f"phases: the level set lies on faces of the solid, so that areas there are off by "
            f"{100 * off:.2g} % of the surface between the phases; move it off them",
            PrecisionWarning,
            stacklevel=6,
        )
    alone = [r.weights[rest].sum() for r, _, rest in shared]
    return int(alone[1] < alone[0])


def _check_joined(weights: FloatArray, keep: AnyArray) -> None:
    """Warn where points between the phases have no element of the other one behind them."""
    loose = weights[~keep].sum()
    if loose > LOOSE * weights.sum():
        warnings.warn(
            f"phases: {100 * loose / weights.sum():.2g} % of the surface between the phases joins "
            "nothing, since the phase behind it is too thin to be seen; take finer cells",
            PrecisionWarning,
            stacklevel=6,
        )


def _as_level(phases: Any, through: SplineMap | None) -> Any:
    """A level set as a function of parameters."""
    if isinstance(phases, str):
        found = as_equation(phases)
        if isinstance(found, float):
            raise InputError(f"phases: {phases!r:.80} is a number; give an equation in coordinates")
        phases = found
    if isinstance(phases, BSpline):
        if phases.ndim != 3 or phases.m:
            raise InputError(
                f"phases must be a scalar spline with 3 parameters, got {phases!r:.80}"
            )
        return phases
    if isinstance(phases, Node):
        return of_parameters(phases, through, "phases")
    if not callable(phases):
        raise InputError(
            "phases must be a level set, negative in the first phase: a spline, an equation, a "
            f"field or a function of points (n, 3), got {phases!r:.80}"
        )

    return _Level(phases, through)


@dataclass(frozen=True)
class _Level:
    """A level set that is a function of points in space, as one of parameters."""

    function: Any
    through: SplineMap | None

    def __call__(self, u: FloatArray) -> FloatArray:
        """Values (n,) at parameters (n, 3)."""
        x = u if self.through is None else self.through.x(u)
        value = as_array("phases", asked("phases", self.function, x))
        if value.shape != (len(u),):
            raise InputError(
                f"phases must give one value per point, shape ({len(u)},), got {value.shape}"
            )
        return value


def _as_spline(level: Any, domain: FloatArray) -> BSpline:
    """A level set as a spline, with a warning if that is off."""
    if isinstance(level, BSpline) and level.weights is None and max(level.k) <= MAX_DEGREE:
        return level
    scale = float(np.abs(level(domain[0] + np.ptp(domain, axis=0) * _SAMPLES)).max())
    try:
        spline, found = fit_with_kinks(level, domain, FIT * max(scale, 1e-300))
    except JumpError as e:
        raise InputError(f"phases jumps {e}; give a continuous level set") from e
    if found.absolute > TOLD * scale:
        warnings.warn(
            f"phases: the spline that stands for the level set is off by up to "
            f"{found.absolute / scale:.2g} of its largest value; give one with fewer kinks, or a "
            "spline",
            PrecisionWarning,
            stacklevel=5,
        )
    return spline


_SAMPLES = grid_points(*[np.linspace(0.0, 1.0, 9)] * 3)


def _together(a: Quadrature, b: Quadrature) -> Quadrature:
    """Two rules of the same kind as one."""

    def both(x: Any, y: Any) -> Any:
        return None if x is None else np.concatenate([x, y])

    low = both(a.cells[a.owners], b.cells[b.owners])
    high = None
    if a.neighbours is not None and b.neighbours is not None:
        high = both(a.neighbours[a.owners], b.neighbours[b.owners])
    whole = replace(
        a, points=both(a.points, b.points), weights=both(a.weights, b.weights),
        normals=both(a.normals, b.normals), sets=both(a.sets, b.sets),
        parameters=both(a.parameters, b.parameters),
    )  # fmt: skip
    return regrouped(whole, low, high)


def _cells_at(grid: Grid, u: FloatArray) -> tuple[IntArray, FloatArray]:
    """Cells of points, -1 outside of the grid, and the points, wrapped in closed directions."""
    lo, hi = grid.domain
    u = wrapped(u, lo, hi, grid.closed)
    cells = np.ravel_multi_index(tuple(cells_at(grid.axes, u).T), grid.shape)
    return np.where(((u >= lo) & (u <= hi)).all(axis=1), cells, -1), u
