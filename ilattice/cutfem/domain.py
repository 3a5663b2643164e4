"""A solid on its grid, ready for analysis: rules, parts and assemblies, each made once.

Problems on the same grid share one `Domain`: other loads, supports and materials cost no new
quadrature, and the sparse pattern is that of the active cells.

Guarantee: what is asked for twice is computed once.
"""

from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any, ClassVar

import numpy as np

from ilattice._typing import AnyArray, FloatArray, IntArray, NamedProperties
from ilattice._validate import Frozen, among, as_choice, as_positive
from ilattice.cutfem import gaps
from ilattice.cutfem.assembly import Assembly, compressed_where_long
from ilattice.cutfem.choosing import USUAL, degree_for
from ilattice.cutfem.connectivity import Parts, connected_parts, links
from ilattice.cutfem.elements import ElementGrid, elements_of
from ilattice.cutfem.places import Spot
from ilattice.cutfem.regions import BOUNDARY, PLACES, SURFACES, Region
from ilattice.cutfem.space import DEGREES, SplineSpace, as_degree_and_smoothness
from ilattice.cutfem.stabilise import ghost_faces, lone_cells, void_rule
from ilattice.errors import GeometryError, InputError
from ilattice.macroshape.maps import SplineMap
from ilattice.offsets.wall import OffsetSolid
from ilattice.quadrature._filling import MAX_POINTS
from ilattice.quadrature.cutting import CutGrid, cut
from ilattice.quadrature.grid import CUT
from ilattice.quadrature.making import rule_on
from ilattice.quadrature.rules import (
    NAMES,
    Quadrature,
    in_space,
    kept,
    on_cells,
    some_cells,
    sums_of_cells,
    united,
)

#: Takes the number of a phase and an index of points; returns values (n, ...) or (1, ...) there.
OfPhase = Callable[[int, Any], FloatArray]
STABILIZATIONS = ("auto", "ghost", "void", "none")
CHOICES = ("auto", *DEGREES)
#: Stiffness of the void, relative to that of the solid, that keeps unknowns determined.
GUARD = 4e-9
#: Weights of ghost penalties per degree and smoothness: as little as bounds the condition number by
#: three and a half times that of whole cells, since thin walls are stiffened by them; and more, per
#: degree, for Nitsche's method. For degree 3 and smoothness 0 no weight does it: where slivers meet
#: at an edge or a corner the number is up to 1e4 times that of whole cells.
GHOST = {(1, 0): 0.1, (2, 1): 1e-3, (2, 0): 1e-4, (3, 2): 3e-3, (3, 1): 1e-3, (3, 0): 1e-3}
GHOST_NITSCHE = {1: 0.1, 2: 1e-2, 3: 1e-2}
#: Cells of which more than this part is filled have none, except with Nitsche's method: their
#: functions hold themselves, and couplings across all faces are two thirds of a matrix.
ENOUGH = 0.4
#: Gauss points per direction by default. On cells that a plane cuts, gradients of degree p in each
#: direction, of total degree 3 p - 1, are integrated exactly by 2 q - 1 >= 3 p + 1, as patch tests
#: need, where planes meet by one more; at degree 1, where that takes 3, speed counts more.
POINTS = {1: 2, 2: 4, 3: 6}
#: Points per direction that rules have more which check others.
MORE = 3
#: Part of a cell that must be filled for its integrals to be taken from moments through a curved
#: map: in less, what the moments of the whole cell are off by may exceed the integral.
SLIVER = 0.05


@dataclass(frozen=True, eq=False)
class Domain(Frozen):
    """A solid on a background grid, with what discretises it.

    Attributes
    ----------
    cut : CutGrid
        Level sets on the grid.
    degree : int
        Of the splines: 1, 2 or 3.
    smoothness : int
        Number of their derivatives that are continuous across the faces of cells.
    q : int
        Gauss points per direction.
    stabilization : {"ghost", "void", "none"}
        What is done about badly cut cells.
    weight : float or None
        Of that; None for that of `GHOST`, or of `GHOST_NITSCHE` with weak supports.
    wall : Wall or None
        Where the level sets come from.
    chosen : str
        Why it has this degree, if nobody gave one.
    named : NamedProperties or None
        Where properties come from that are given by name, if the solid has some.
    """

    cut: CutGrid
    degree: int
    smoothness: int
    q: int
    stabilization: str
    weight: float | None
    wall: OffsetSolid | None = None
    chosen: str = ""
    named: NamedProperties | None = None
    _made: dict[Any, Any] = field(default_factory=dict, repr=False)

    def __getstate__(self) -> dict[str, Any]:
        """For `pickle` and `copy.deepcopy`, without what is made again when needed."""
        return {**vars(self), "_made": {}}

    def once(self, key: Any, make: Any) -> Any:
        """What `make` returns, made at the first call with this key only."""
        if key not in self._made:
            self._made[key] = make()
        return self._made[key]

    #: The surface between two phases; see `PhasedDomain`.
    interface: ClassVar[Any] = None
    #: Whether there are two phases.
    phased: ClassVar[bool] = False

    def by_phase(self, values: OfPhase, elements: IntArray) -> FloatArray:
        """Values (n, ...) at points, those of the phase of the element of each.

        Parameters
        ----------
        values : callable
            See `OfPhase`.
        elements : ndarray, shape (n,)
            Of the points.

        Returns
        -------
        ndarray, shape (n, ...), or (1, ...) where the phases do not differ
            Values.
        """
        del elements  # there is one phase
        return values(0, slice(None))

    def of_phases(self, rule: Quadrature) -> tuple[Quadrature, ...]:
        """The parts of a rule by elements in each phase."""
        return (rule,)

    @property
    def status(self) -> AnyArray:
        """See `CutGrid.status`."""
        return self.cut.status

    # ---------------------------------------------------------------- rules

    @cached_property
    def _divided(self) -> tuple[ElementGrid, Quadrature]:
        """Elements, and the rule by elements; that by cells, which may be large, is not kept."""
        return elements_of(self.cut, self.cut.volume(self.q))

    @property
    def elements(self) -> ElementGrid:
        """The cells, and further elements where the solid in a cell is in several pieces."""
        return self._divided[0]

    @property
    def volume(self) -> Quadrature:
        """Rule on the solid, in parameters, by elements."""
        return self._divided[1]

    @cached_property
    def interior_facets(self) -> tuple[Quadrature, ...]:
        """Areas of the faces between elements, of the three directions, at one point each."""
        faces = (self.elements.divided(self.cut.faces(axis, 1)) for axis in range(3))
        return tuple(sums_of_cells(rule) for rule in faces)

    @cached_property
    def joints(self) -> tuple[Quadrature, ...]:
        """Those faces of `interior_facets` through which parts hang together."""
        return tuple(self.parts.joined(rule) for rule in self.interior_facets)

    @cached_property
    def parts(self) -> Parts:
        """Connected parts of the solid."""
        return connected_parts(self.volume, self.interior_facets)

    def boundary(self, on: str | Region) -> Quadrature:
        """Rule in space on an end face, a level set or a region, with normals and `parameters`.

        Parameters
        ----------
        on : {"u=0", ..., "w=1", "surface", "outer", "inner", "boundary"} or Region
            Where.

        Returns
        -------
        Quadrature
            In space; also without a map.
        """
        if not isinstance(on, Region) and not among(on, PLACES):
            raise InputError(f"on must be one of {PLACES}, got {on!r}")
        return self.once(("boundary", on), lambda: self._boundary(on))

    def _boundary(self, on: str | Region) -> Quadrature:
        if isinstance(on, Region):
            whole = self.boundary(on.place)
            return where(whole, on.of(whole.points))
        if on == BOUNDARY:
            return self._whole_boundary()
        rule = self._by_elements(on)
        if on in SURFACES[1:]:
            rule = where(rule, np.asarray(rule.sets) == SURFACES.index(on) - 1)
        if not len(rule):
            hint = ""
            if on in NAMES:
                hint = (
                    ": it may end there, or before, as a field does at the ends of its own bounds; "
                    "make the domain smaller, take a condition such as 'x < 0.1', or"
                )
            raise GeometryError(f"on={on!r}: the solid has no area there{hint or ';'} choose "
                                "another place")  # fmt: skip
        return on_cells(in_space(rule), self.volume.cells)

    @property
    def solids(self) -> tuple[CutGrid, ...]:
        """The level sets of each phase."""
        return (self.cut,)

    def denser(self, on: str | Region, cells: IntArray, cut: CutGrid | None = None) -> Quadrature:
        """Rule in space on some cells of the grid with more points than `volume`, or `boundary`.

        Parameters
        ----------
        on : str or Region
            As in `boundary`, or ``""`` for the solid.
        cells : ndarray, shape (n,)
            Cells, increasing, that hold solid.
        cut : CutGrid, optional
            The level sets, those of a phase if that is wanted alone.

        Returns
        -------
        Quadrature
            By cells, of all parts.
        """
        if isinstance(on, Region):
            rule = self.denser(on.place, cells)
            return where(rule, np.asarray(on.inside(rule.points))) if len(rule) else rule
        if on == BOUNDARY:
            ends = [n for i, n in enumerate(NAMES) if not self.cut.grid.closed[i // 2]]
            return united([self.denser(name, cells) for name in (*ends, SURFACES[0])])
        kind = on if on in NAMES else SURFACES[0] if on else "volume"
        rule = in_space(rule_on(cut or self.cut, kind, cells, min(self.q + MORE, MAX_POINTS)))
        if on in SURFACES[1:]:
            rule = where(rule, np.asarray(rule.sets) == SURFACES.index(on) - 1)
        return rule

    def finer(self, cells: IntArray, more: int) -> Quadrature:
        """Rule like `volume` with more points per direction, on cells that hold solid."""
        q = min(self.q + more, MAX_POINTS)
        return self.elements.divided(rule_on(self.cut, "volume", cells, q))

    def area_error(self, region: Region) -> float:
        """See `Region.error`."""
        return self.once(("area", region), lambda: region.error(self.boundary(region.place)))

    def _whole_boundary(self) -> Quadrature:
        """All level sets and those end faces that the solid reaches."""
        found = []
        for place in (*NAMES, SURFACES[0]):
            if place in NAMES and self.cut.grid.closed[NAMES.index(place) // 2]:
                continue
            with suppress(GeometryError):
                found.append(self.boundary(place))
        if not found:
            raise GeometryError(f"on={BOUNDARY!r}: the solid has no boundary")
        return united(found)

    def _by_elements(self, on: str) -> Quadrature:
        """Rule in parameters on an end face, or on all level sets."""
        if on in NAMES:
            return self.elements.divided(self.cut.face(on, self.q))
        return self.once("level sets", lambda: self.elements.divided(self.cut.surface(self.q)))

    # ---------------------------------------------------------------- discretisation

    def assembly(self, parts: IntArray, *, weak: bool) -> Assembly:
        """Functions on the cells of some parts.

        Parameters
        ----------
        parts : ndarray
            Numbers of parts.
        weak : bool
            Whether there are weak supports; jumps are penalised then in any case.

        Returns
        -------
        Assembly
            The same one for the same parts.
        """
        return self.once(("assembly", tuple(parts), weak), lambda: self._assembly(parts, weak))

    def _assembly(self, parts: IntArray, weak: bool) -> Assembly:
        cells = self.parts.cells[np.isin(self.parts.labels, parts)]
        space = SplineSpace(self.elements, self.degree, cells, self.smoothness, links(self.joints))
        if not weak and self.stabilization != "ghost":
            return Assembly(space, self.cut.through)
        weak |= self.interface is not None
        weight = self.weight if self.stabilization == "ghost" else None
        if weight is None:
            p = self.degree
            weight = GHOST_NITSCHE[p] if weak else GHOST[p, self.smoothness]
        enough = 1.0 if weak else ENOUGH
        faces = ghost_faces(self.status, self.joints, cells, weight, self.volume, enough)
        lone = lone_cells(self.volume, self.parts.labels, parts) if self.degree > 1 else None
        return Assembly(space, self.cut.through, faces, lone, self._seam(cells))

    def _seam(self, cells: IntArray) -> Quadrature | None:
        """The surface between phases in some cells."""
        if self.interface is None:
            return None
        rule = self.interface
        return kept(rule, np.isin(rule.cells, cells) & np.isin(rule.neighbours, cells))

    def stiff_rule(self, asm: Assembly, *, constant: bool) -> Quadrature:
        """Rule for the stiffness of the solid, in parameters, compressed where that loses nothing.

        Parameters
        ----------
        asm : Assembly
            Functions on the active cells.
        constant : bool
            Whether the material is the same everywhere.

        Returns
        -------
        Quadrature
            The same one for the same arguments.
        """
        short = constant and self._compressible(asm)

        def make() -> Quadrature:
            rule = on_cells(self.volume, asm.space.cells)
            least = 0.0 if asm.affine is not None else SLIVER
            return compressed_where_long(rule, 2 * self.degree, least) if short else rule

        return self.once(("stiff", asm, short), make)

    def stiff_rules(self, asm: Assembly, *, constant: bool) -> Iterator[Quadrature]:
        """Parts of `stiff_rule` with the weighted void of cut cells; one at a time is in memory."""
        rule = self.stiff_rule(asm, constant=constant)
        if self.stabilization != "void":
            yield rule
            return
        assert self.weight is not None
        yield from self._with_void(asm, rule, self.weight, 1.0 - self.weight)

    def void_rules(self, asm: Assembly) -> Iterator[Quadrature]:
        """Parts of a rule, in parameters, on the weighted void of cut cells, solid negative."""
        is_cut = self.cut.status.ravel()[self.elements.home(asm.space.cells)] == CUT
        cells = asm.space.cells[is_cut]
        assert self.weight is not None
        yield from self._with_void(asm, on_cells(self.volume, cells), self.weight, -self.weight)

    def _with_void(
        self, asm: Assembly, rule: Quadrature, weight: float, solid: float
    ) -> Iterator[Quadrature]:
        for _, cells, _ in asm.batches(rule, (3 * asm.space.dofs.shape[1]) ** 2):
            yield void_rule(self.cut, some_cells(rule, cells), self.degree + 1, weight, solid)

    def _compressible(self, asm: Assembly) -> bool:
        """Whether integrals over cells may be taken from moments.

        Exact through an affine map. Through others the Jacobian is interpolated in every cell with
        degree 2 p; the tiny errors of slivers, which may be negative, need a ghost penalty, and
        second derivatives of the map must not jump within cells.
        """
        if asm.affine is not None or self.degree == 1:
            return asm.affine is not None
        assert asm.through is not None
        return asm.ghost is not None and all(
            np.abs(kinks(asm.through, a)[:, None] - x).min(axis=1).max(initial=0) < 1e-9 * np.ptp(x)
            for a, x in enumerate(self.cut.grid.axes)
        )

    def solid(self, asm: Assembly) -> Quadrature:
        """Rule in space on the active cells, with `parameters`."""
        return self.once(("solid", asm), lambda: in_space(on_cells(self.volume, asm.space.cells)))

    def edge(self, asm: Assembly, on: str | Region | Spot) -> Quadrature:
        """Rule in space on the boundary of the active cells, or at a point; see `boundary`."""
        if isinstance(on, Spot):
            return on.rule(asm)
        return self.once(("edge", asm, on), lambda: on_cells(self.boundary(on), asm.space.cells))

    # ---------------------------------------------------------------- resolution

    def warn_gaps(self) -> None:
        """See `gaps.warn`."""
        gaps.warn(self.cut, self.elements, self.parts, self.joints)


def kinks(through: SplineMap, axis: int) -> FloatArray:
    """Inner knots at which second derivatives of a map may jump."""
    t, k = through.spline.t[axis], through.spline.k[axis]
    knots, times = np.unique(t, return_counts=True)
    lo, hi = through.domain[:, axis]
    return knots[(knots > lo) & (knots < hi) & (k - times < 2)]


def where(rule: Quadrature, keep: AnyArray) -> Quadrature:
    """Some points of a surface rule."""
    assert rule.normals is not None
    counts = np.bincount(rule.owners[keep], minlength=len(rule.cells))
    some = counts > 0
    return replace(
        rule,
        points=rule.points[keep],
        weights=rule.weights[keep],
        normals=rule.normals[keep],
        sets=None if rule.sets is None else rule.sets[keep],
        parameters=None if rule.parameters is None else rule.parameters[keep],
        cells=rule.cells[some],
        offsets=np.append(0, np.cumsum(counts[some])),
    )


def as_domain(
    field: Any, cells: Any, *, degree: int | str, smoothness: int | None, q: int | None,
    stabilization: str, weight: float | None, domain: Any, through: Any, bends: bool = True,
) -> Domain:  # fmt: skip
    """Check the arguments that all problems share.

    Parameters
    ----------
    field : Wall, BSpline, callable, pair of fields, CutGrid or Domain
        The solid; of a `Domain` everything is kept.
    cells, domain, through : optional
        As in `cut`.
    degree, smoothness, q, stabilization, weight : optional
        As in `Domain`; a degree of "auto" is chosen.
    bends : bool
        Whether walls bend: what a degree is chosen by.

    Returns
    -------
    Domain
        Nothing is integrated yet.

    Raises
    ------
    InputError
        If an argument is wrong.
    """
    if isinstance(field, Domain):
        return field
    as_choice("stabilization", stabilization, STABILIZATIONS)
    grid, chosen = None, ""
    if as_choice("degree", degree, CHOICES) == "auto":
        degree = USUAL
        if (smoothness, q, stabilization, weight) == (None, None, "auto", None):
            grid = _as_cut(field, cells, domain, through)
            degree, chosen = degree_for(grid, bends)
    degree, smoothness = as_degree_and_smoothness(degree, smoothness)
    q = POINTS[degree] if q is None else q
    as_choice("q", q, tuple(range(1, MAX_POINTS + 1)))
    if stabilization == "auto":
        stabilization = "void" if degree == 1 else "ghost"
    weight = None if weight is None else as_positive("weight", weight)
    if stabilization == "void" and weight is None:
        weight = GUARD
    if stabilization == "void" and weight is not None and weight > 1.0:
        raise InputError(f"weight of the void must not exceed 1, got {weight!r}")
    grid = _as_cut(field, cells, domain, through) if grid is None else grid
    wall = field if isinstance(field, OffsetSolid) else None
    named = getattr(field, "named_properties", None)
    return Domain(grid, degree, smoothness, int(q), stabilization, weight, wall, chosen, named)


def _as_cut(field: Any, cells: Any, domain: Any, through: Any) -> CutGrid:
    """The solid on its grid."""
    if isinstance(field, CutGrid):
        return field
    return cut(field, cells, domain=domain, through=through)
