"""Linear elasticity on a solid that is cut out of a grid: no mesh of the solid is needed.

::

    problem = il.cutfem.Elasticity(wall, cells=(128, 16, 16), young=1.0, poisson=0.3)
    solution = problem.clamp("w=0").load(body=(1e-3, 0, 0)).solve()

Source: Hong et al. 2025, section 4 and Appendix A: integrals over the solid in parameters, pulled
back through the map at every point, with splines of the grid for the displacement. Two things
differ by default: degree 2 instead of 1 (see `choosing`), with a consistent stabilization (see
`stabilise`); theirs are ``degree=1, stabilization="void", weight=1.0``.

Guarantees: equilibrium of loads and reactions, and twice the energy equal to the work, to the
tolerance of the solver; exact for displacements in the space (affine ones, through affine maps)
from degree 2 on, and of degree 1 with ``q=3, stabilization="ghost"``; of degree 2 where planes meet
within cells to 1e-5 of the stress, and exact there with ``q=5``.
Non-guarantees: the defaults of degree 1 are chosen for speed: stresses of an affine displacement
are off by up to 0.2 % in the mean square, and by up to a tenth in slivers of cells, and struts
thinner than a fifth of a cell bow by several times their thickness, which takes next to no energy
(``q=4`` or degree 2 keeps them straight); small displacements; stresses at re-entrant edges grow
without bound under refinement; walls of a cell or two are too stiff, by a part that every solution
estimates, and warns of (see `discretization`); functions that give loads or materials are
integrated by the points of the rules, `q` or more per direction and cell; what they do in between
is looked at, told from 2 % on, and refused from a half (see `sampling`).
"""

from dataclasses import dataclass
from typing import Any, Self

import numpy as np

from ilattice._progress import Progress
from ilattice._typing import FloatArray
from ilattice._validate import among, as_choice, as_kind
from ilattice.cutfem import rigid
from ilattice.cutfem.anisotropic import as_material
from ilattice.cutfem.choosing import USUAL
from ilattice.cutfem.conditions import Connection, as_value
from ilattice.cutfem.deformed import Deformed
from ilattice.cutfem.dilatation import MAX_SMOOTH, is_near
from ilattice.cutfem.material import Property, named_properties
from ilattice.cutfem.operators import ElasticOperators
from ilattice.cutfem.phases import as_phased
from ilattice.cutfem.places import Motion, as_vector
from ilattice.cutfem.problem import ISLANDS
from ilattice.cutfem.regions import Region, as_place
from ilattice.cutfem.series import Series
from ilattice.cutfem.solved import Smooth
from ilattice.errors import InputError
from ilattice.quadrature.rules import Quadrature

DILATATIONS = ("auto", "full", "projected")
#: Least part, of the energy that heat stores where nothing may move, that errors are relative to:
#: a solid that expands freely stores none, and any error is large beside nothing.
HEATED = 1e-5


@dataclass(frozen=True, eq=False, init=False, repr=False)
class Elasticity(ElasticOperators):
    """A linear elastic solid with supports and loads.

    Parameters
    ----------
    field : Wall, BSpline, callable, pair of fields, CutGrid, or Domain
        The solid, as in `cut`. The `domain` of another problem shares its rules and pattern.
    cells : int, sequence of 3 int or Grid, optional
        Background grid, as in `cut`.
    young, poisson, density, expansion : float, str or callable, keyword-only
        Young's modulus; Poisson's ratio, above -1 and below 1/2; mass per volume; thermal
        expansion per degree; by default 1, 0.3, 1 and 0. A callable takes points of space (n, 3);
        a name is that of a property of the lattice, or of an extra coordinate of the map; with
        `phases`, a pair of these is one of each.
    strength : float, str or callable, optional, keyword-only
        Von Mises stress at which the material yields; solutions then tell how much of it is used.
    stiffness : array_like, shape (6, 6), Graded or callable, optional, keyword-only
        Of any symmetry, instead of `young` and `poisson`: symmetric and positive definite, in
        Voigt order xx, yy, zz, yz, xz, xy with engineering shear. A callable takes points of space
        (n, 3) and returns (n, 6, 6); with `phases`, a tuple of two is one of each.
    axes : {"space", "map"}, keyword-only
        Whether the axes of `stiffness` are x, y, z, or turn with the map; see
        `ilattice.cutfem.anisotropic`.
    degree : {"auto", 1, 2, 3}, keyword-only
        Of the splines. By default 2, or 1 on more than 50,000 cells of the solid (80,000 of walls
        between two surfaces), and from 8,000 on for struts of two cells or more, which it solves to
        the same error in a fraction of the time (thinner ones it does not bend, nor those along
        long edges, so 2 where a tenth of the cells has edges three times as long as others):
        ``solution.report.splines`` tells which and why. 2 where any of the next four is given,
        there are `phases`, or Poisson's ratio is 0.45 or above.
    smoothness : int, optional, keyword-only
        Number of derivatives that are continuous across the faces of cells, from 0 to degree - 1,
        which is the default; but 1 for degree 3 where a number of `poisson` is 0.45 or above, as
        2 locks there. With 0 thin struts bend at joints within a cell or two, at up to degree³
        times as many unknowns; see `ilattice.cutfem` for which to use when.
    q : int, optional, keyword-only
        Gauss points per direction and piece of a cell; by default 2 for degree 1, which takes two
        thirds of the time of 3 and costs accuracy in slivers (see above), 4 for degree 2 and 6 for
        degree 3, exact on cells that a plane cuts: with fewer, errors under tractions on a curved
        surface fall more slowly than those of the space. Where planes meet within cells, 3, 5 and 6
        are exact.
    stabilization : {"auto", "ghost", "void", "none"}, keyword-only
        What is done about badly cut cells: ``"ghost"`` penalises jumps, the default from degree 2
        on; ``"void"`` gives the void part of cut cells a weight, 4e-9 by default for degree 1.
    weight : float, optional, keyword-only
        Of the stabilization.
    dilatation : {"auto", "full", "projected"}, keyword-only
        Change of volume in the energy: at every point, or projected cell by cell, which keeps
        nearly incompressible solids from locking; see `ilattice.cutfem.dilatation`. By default it
        is projected where Poisson's ratio is 0.45 or above somewhere.
    islands : {"drop", "refuse"}, keyword-only
        What is done with parts that nothing holds.
    domain : array_like, shape (2, 3), optional, keyword-only
        Box of the grid, as in `cut`.
    through : SplineMap, optional, keyword-only
        Map to space, as in `cut`.
    phases : BSpline, Node, str or callable, optional, keyword-only
        Level set that divides the solid into two materials, negative in the first: a spline of
        parameters, a field or an equation in u, v, w or in x, y, z, or a function of points of
        space (n, 3). Cells are cut by it, and strains may jump there; see
        `ilattice.cutfem.phases`.

    Raises
    ------
    InputError
        If an argument is wrong.
    GeometryError
        If the solid is empty.

    Warns
    -----
    PrecisionWarning
        If the solid is nearly incompressible and locks, or its stiffness jumps within a cell.

    Examples
    --------
    >>> import ilattice as il
    >>> rod = lambda u: (u[:, :2] ** 2).sum(axis=1) - 0.25
    >>> box = [[-0.6, -0.6, 0], [0.6, 0.6, 4]]
    >>> problem = il.cutfem.Elasticity(rod, (4, 4, 6), domain=box, young=2.0, strength=5.0)
    >>> solution = problem.clamp("w=0").load(traction=(0, 0, 1.0), on="w=1").solve()
    >>> float(round(solution.reactions["w=0"][2], 4))  # minus the area
    -0.7854
    >>> bool(0 < solution.safety_factor < 5)
    True
    """

    def __init__(
        self, field: Any, cells: Any = None, *, young: Property | None = None,
        poisson: Property | None = None, density: Property = 1.0, expansion: Property = 0.0,
        strength: Property | None = None, stiffness: Any = None, axes: str = "space",
        degree: int | str = "auto", smoothness: int | None = None, q: int | None = None,
        stabilization: str = "auto", weight: float | None = None, dilatation: str = "auto",
        islands: str = "drop", domain: Any = None, through: Any = None, phases: Any = None,
    ) -> None:  # fmt: skip
        if not among(dilatation, DILATATIONS):
            raise InputError(f"dilatation must be one of {DILATATIONS}, got {dilatation!r}")
        as_choice("islands", islands, ISLANDS)
        if is_near(poisson):
            degree = USUAL if among(degree, ("auto",)) else degree
            cubic = smoothness is None and among(degree, (3,))
            smoothness = MAX_SMOOTH if cubic and dilatation != "full" else smoothness
        where = as_phased(
            field, cells, degree=degree, smoothness=smoothness, q=q, stabilization=stabilization,
            weight=weight, domain=domain, through=through, phases=phases,
        )  # fmt: skip
        known: dict[str, Any] = {"lattice": named_properties(where), "phased": where.phased}
        if stiffness is not None and dilatation == "projected":
            raise InputError("dilatation='projected' is not there for a stiffness; take 'auto'")
        material = as_material(
            young, poisson, density, expansion, strength, stiffness, axes, where.cut.through, known
        )
        _ = where.interface  # areas between phases that are not known are told here
        super().__init__(where, islands)
        self._set(material=material, dilatation=dilatation, connections=())

    # ---------------------------------------------------------------- verbs

    def clamp(
        self, on: Any, *, components: Any = None, value: Any = 0.0, method: str = "auto",
        where: Any = None, rotation: Any = None, about: Any = None,
    ) -> Self:  # fmt: skip
        """Prescribe the displacement on an end face, a level set or a region.

        Parameters
        ----------
        on : str, callable, (2, 3) array-like, Field or SurfaceMesh
            An end face of the domain, ``"u=0"`` to ``"w=1"``; the level sets that bound the solid,
            ``"surface"``, or one of them, ``"outer"`` or ``"inner"``; or the part of the whole
            ``"boundary"`` in space where a linear condition holds, such as ``"z > 5 and x < 1"``,
            where a function of points (n, 3) is true, which is in a box, where a field of space
            is not positive, or which is on the triangles of a mesh (`SurfaceMesh.select` takes
            some of one).
        components : str or sequence of int, optional
            Such as ``"xz"`` or ``(0, 2)``; ``"n"`` for the one along the normal, as on planes of
            symmetry and frictionless guides, flat or curved: exactly where it is one of x, y and z,
            else by Nitsche's method; by default all.
        value : float, sequence of 3 floats or callable
            The displacement; a callable takes points of space (n, 3), returns vectors (n, 3).
        method : {"auto", "strong", "nitsche"}
            Exactly, for end faces; or weakly imposed, by Nitsche's method. Loads and springs on
            the place go into the support; of supports that overlap, the first one holds. Where two
            phases meet on an end face, values with a kink there are right by Nitsche's method only:
            held exactly they are interpolated (by up to 2 % in coarse cells).
        where : str, callable, (2, 3) array-like, Field or SurfaceMesh, optional
            The part of a place with a name, as in `on`.
        rotation : sequence of 3 floats, optional
            A small turn that is added to the displacement: its axis times its angle in radians.
        about : sequence of 3 floats, optional
            Point on the axis of the turn; by default the middle of the place.

        Returns
        -------
        Elasticity
            A new problem.
        """
        if rotation is not None:
            value = self._turned(on, where, value, rotation, about)
        elif about is not None:
            raise InputError("about is the point of a rotation=, which is not given")
        return self._supported(on, components, value, method, "value", where)

    def rigid(
        self, on: Any, *, force: Any = (0.0, 0.0, 0.0), moment: Any = (0.0, 0.0, 0.0),
        about: Any = None, where: Any = None,
    ) -> Self:  # fmt: skip
        """Let a place move as a rigid body: a plate, a bolt or a hub that is much stiffer.

        Parameters
        ----------
        on : str, callable, (2, 3) array-like, Field or SurfaceMesh
            As in `clamp`. Two parts of the boundary are joined by one place that has both.
        force, moment : sequence of 3 floats
            What acts on the rigid body.
        about : sequence of 3 floats, optional
            Where the force acts; by default the middle of the place.
        where : str, callable, (2, 3) array-like, Field or SurfaceMesh, optional
            As in `clamp`.

        Returns
        -------
        Elasticity
            A new problem, of which the `Solution.motions` are found.

        Notes
        -----
        `solve` takes eight solutions of one matrix, and six more for each further connection.
        """
        place = self._named(as_place(on, where))
        self.domain.boundary(place)
        middle = self._middle(place) if about is None else as_vector("about", about)
        new = Connection(place, as_vector("force", force), as_vector("moment", moment), middle)
        self._warn_rough(place)
        return self._with(connections=(*self.connections, new))

    def _turned(self, on: Any, where: Any, value: Any, rotation: Any, about: Any) -> Motion:
        """A displacement with a turn."""
        if callable(value):
            raise InputError("value is a function: add the rotation to what it returns")
        place = as_place(on, where)
        middle = self._middle(place) if about is None else as_vector("about", about)
        move = np.array(as_value("value", value, 3), np.float64)
        return Motion(move, as_vector("rotation", rotation), middle)

    def _middle(self, place: str | Region) -> FloatArray:
        """The centroid (3,) of a place."""
        rule = self.domain.boundary(place)
        return rule.weights @ rule.points / rule.weights.sum()

    def spring(self, on: Any, stiffness: Any, *, value: Any = 0.0, where: Any = None) -> Self:
        """Hold an end face, a level set or a region by springs.

        Parameters
        ----------
        on : str, callable or (2, 3) array-like
            As in `clamp`.
        stiffness : float, sequence of 3 floats or callable
            Force per area and displacement, of all components or each.
        value : float, sequence of 3 floats or callable
            Displacement at which the springs are at rest.
        where : str, callable or (2, 3) array-like, optional
            As in `clamp`.

        Returns
        -------
        Elasticity
            A new problem.
        """
        return self._sprung(on, stiffness, value, "stiffness", where)

    def load(
        self, *, body: Any = None, gravity: Any = None, traction: Any = None,
        pressure: Any = None, force: Any = None, moment: Any = None, on: Any = "",
        where: Any = None, at: Any = None, temperature: Any = None,
    ) -> Self:  # fmt: skip
        """Add loads to those that are there.

        Parameters
        ----------
        body : sequence of 3 floats or callable, optional
            Force per volume.
        gravity : sequence of 3 floats or callable, optional
            Acceleration; the force is that times the density.
        traction : sequence of 3 floats or callable, optional
            Force per area, at `on`.
        pressure : float or callable, optional
            Pressure against the surface, at `on`.
        force, moment : sequence of 3 floats, optional
            Resultants at `on`: the force as a uniform traction, the moment (about the middle of
            the place) as tractions that turn it. Their sums are exact.
        on, where : str, callable, (2, 3) array-like, Field or SurfaceMesh
            As in `clamp`; for tractions, pressures, forces and moments.
        at : sequence of 3 floats, optional
            The point of space, in the solid, at which a force acts, instead of `on`. Displacement
            and stress there grow without bound on finer cells, as they do in the solid; elsewhere
            they do not.
        temperature : float, callable or HeatSolution, optional
            Temperature above the one without stress. A solution of heat is taken at the same
            points of space, also where it was found on other cells or through another map, and
            must be known on all of the solid.

        Returns
        -------
        Elasticity
            A new problem.

        Raises
        ------
        InputError
            If there is no load, a place is missing or too much, or heat expands nothing.
        """
        new = self
        given = {"traction": traction, "pressure": pressure, "force": force, "moment": moment}
        placed = {k: v for k, v in given.items() if v is not None}
        if at is not None:
            if set(placed) != {"force"} or not (isinstance(on, str) and not on):
                raise InputError("at is the point of a force=: give that, and neither on nor more")
        elif bool(placed) != (not isinstance(on, str) or bool(on)):
            raise InputError(
                f"on={on!r:.80}: tractions, pressures, forces and moments need a place, such as "
                "on='w=1' or on='surface', other loads have none"
            )
        if isinstance(temperature, Series):
            raise InputError(
                f"temperature is one of {len(temperature)} solutions, got all of them; take one, "
                "such as history[-1]"
            )
        if temperature is not None and self.material.expansion.value == 0.0:
            raise InputError("temperature: the material does not expand; give it an expansion")
        for kind, value in {**placed, "body": body, "gravity": gravity}.items():
            numbers = kind in ("force", "moment") or not (value is None or callable(value))
            if numbers and kind != "pressure" and np.shape(value) != (3,):
                raise InputError(f"{kind} must be a vector of 3 numbers, got {value!r:.80}")
        for kind, value in placed.items():
            new = new._loaded(kind, value, 1 if kind == "pressure" else 3, on, where, at)
        for kind, value, m in (
            ("body", body, 3), ("gravity", gravity, 3), ("temperature", temperature, 1)
        ):  # fmt: skip
            if value is not None:
                new = new._loaded(kind, value, m)
        if new is self:
            raise InputError(
                "load needs one of body, gravity, traction, pressure, force, moment, temperature"
            )
        return new

    def solve(
        self, *, method: str = "auto", tol: float = 1e-8, max_iterations: int = 500,
        progress: Progress = None,
    ) -> "Solution":  # fmt: skip
        """Solve for the displacement.

        Parameters
        ----------
        method : str
            Solver; see `Solver`.
        tol : float
            Relative residual of iterative solvers.
        max_iterations : int
            Of iterative solvers.
        progress : bool or callable, optional
            Per cent of the digits asked for; see `ilattice._progress.track`.

        Returns
        -------
        Solution
            Displacement, stress, energy, reactions.

        Raises
        ------
        InputError
            If the solid is free to move, or half of a load that is a function or more lies
            between the points at which cells ask it.
        GeometryError
            If parts are not held with ``islands="refuse"``, or none is.
        ConvergenceError
            If the tolerance is not reached.

        Warns
        -----
        PrecisionWarning
            If the energy is off by more than 2 % because of the cells, by estimate: see
            `SolveReport.discretization_error`.
        """
        how = (method, tol, max_iterations, progress)
        if self.connections:
            return Solution(*rigid.solved(self, *how))
        return Solution(self, *self._solve(*how))

    # ---------------------------------------------------------------- solutions

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
        mine = self._own(as_kind("solution", solution, "Solution"))
        return self._reactions(mine.coefficients, mine._own_flux_on)

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
        mine = self._own(as_kind("solution", solution, "Solution"))
        stiffness = self._geometric_stiffness(mine.stress_on)
        return self.constraints.reduce(stiffness, diagonal=False)

    def _solid_energy(self, c: FloatArray) -> float:
        rule = self.domain.stiff_rule(self.assembly, constant=self.material.constant)
        energy = Solution(self, c, None)._energy(rule, heated=True)
        if any(f.kind == "temperature" for f in self.loads):  # solids that expand freely store none
            none = Solution(self, np.zeros_like(c), None)._energy(rule, heated=True)
            energy = max(energy, HEATED * none)
        return 2.0 * energy

    def _energy_on(self, c: FloatArray, rule: Quadrature) -> float:
        return 2.0 * Solution(self, c, None)._energy(rule, heated=False)

    def _energies(self, c: FloatArray, rule: Quadrature) -> FloatArray:
        parts = Solution(self, c, None)._energies(rule)
        return 2.0 * np.concatenate([np.zeros(0), *parts])


@dataclass(frozen=True, eq=False, repr=False)
class Solution(Deformed):
    """Displacement of an elastic solid: made by `Elasticity.solve`.

    Attributes
    ----------
    problem : Elasticity
        What was solved.
    coefficients : ndarray, shape (functions, 3)
        Of the splines.
    solved : SolveReport or None
        What the solver says; None if nothing was free.
    """

    problem: Elasticity

    def __repr__(self) -> str:
        return f"Solution({len(self.coefficients)} functions, energy {self.energy:.6g})"

    @property
    def _smooth(self) -> "type[Recovered]":
        return Recovered


@dataclass(frozen=True, eq=False, repr=False)
class Recovered(Smooth, Solution):
    """A displacement with a smooth stress: made by `Solution.recovered`.

    Displacement, strain, energies and reactions are those of the solution; stresses, in pictures
    and files as well, the recovered ones.

    Attributes
    ----------
    projected : ndarray, shape (functions, 6)
        Coefficients of the recovered stress.
    """

    @property
    def stresses(self) -> FloatArray:
        """Coefficients (functions, 6) of the recovered stress."""
        return self.projected
