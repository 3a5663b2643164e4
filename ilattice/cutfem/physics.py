"""Any linear law on a solid that is cut out of a grid: electrostatics, diffusion, what you like.

::

    problem = il.cutfem.Physics(solid, 16, law=Permittivity())
    problem = problem.hold("w=0", 0.0).hold("z > 1", 5.0).load(body=lambda x: x[:, 0])
    solution = problem.solve()
    solution.flux([[0.5, 0.5, 0.5]]), solution.error_estimate().relative

What is solved is div(A grad v) + body = 0, with the tensor A of a `Law`: on the same functions,
rules and stabilization, and with the same supports, estimates and files as for `Elasticity` and
`Heat`, which are laws, too.

Guarantees: those of `problem` and `solved`; a law that is not symmetric and positive at one of 64
points of the solid is refused. Non-guarantee: elsewhere it may be neither.
"""

from collections.abc import Mapping
from copy import deepcopy
from dataclasses import dataclass
from functools import cached_property
from typing import Any, ClassVar, Self

import numpy as np

from ilattice._progress import Progress
from ilattice._typing import ArrayLike, FloatArray
from ilattice._validate import as_choice, as_points
from ilattice.cutfem.law import Law
from ilattice.cutfem.phases import as_phased
from ilattice.cutfem.problem import ISLANDS, Problem
from ilattice.cutfem.solved import Smooth, Solved
from ilattice.errors import InputError
from ilattice.quadrature.rules import Quadrature

#: Points of a part at which the tensor of a law is looked at, and the part of its largest entry
#: that is rounding.
LOOKED_AT, ROUNDED = 64, 1e-9


@dataclass(frozen=True, eq=False, init=False, repr=False)
class Physics(Problem):
    """A solid with a law of your own.

    Parameters
    ----------
    field : Wall, BSpline, callable, pair of fields, CutGrid, or Domain
        The solid, as in `cut`. The `domain` of another problem shares its rules and pattern.
    cells : int, sequence of 3 int or Grid, optional
        Background grid, as in `cut`.
    law : Law, keyword-only
        Which flux gradients make; it is copied.
    degree, smoothness, q, stabilization, weight, islands, domain, through, phases : keyword-only
        As in `Elasticity`; of two phases a law has two `phases`.

    Raises
    ------
    InputError
        If an argument is wrong.
    GeometryError
        If the solid is empty.

    Examples
    --------
    >>> import numpy as np
    >>> import ilattice as il
    >>> class Permittivity(il.cutfem.Law):
    ...     def tangent(self, asm, u):
    ...         return 2.0 * np.eye(3).reshape(1, 1, 3, 1, 3)
    >>> bar = lambda u: -np.ones(len(u))
    >>> problem = il.cutfem.Physics(bar, 2, law=Permittivity(), domain=[[0, 0, 0], [1, 1, 4]])
    >>> solution = problem.hold("w=0", 0.0).hold("w=1", 8.0).solve()
    >>> solution.flux([[0.5, 0.5, 1.0]]).round(9).tolist()
    [[0.0, 0.0, 4.0]]
    """

    lack: ClassVar[str] = "nothing holds the field: add hold or exchange before solving"
    spring_name: ClassVar[str] = "transfer"
    energy_name: ClassVar[str] = "the energy of the field"
    given: Law

    def __init__(
        self, field: Any, cells: Any = None, *, law: Law, degree: int | str = "auto",
        smoothness: int | None = None, q: int | None = None, stabilization: str = "auto",
        weight: float | None = None, islands: str = "drop", domain: Any = None,
        through: Any = None, phases: Any = None,
    ) -> None:  # fmt: skip
        _check_law(law)
        as_choice("islands", islands, ISLANDS)
        where = as_phased(
            field, cells, degree=degree, smoothness=smoothness, q=q, stabilization=stabilization,
            weight=weight, domain=domain, through=through, phases=phases,
        )  # fmt: skip
        super().__init__(where, islands)
        self._set(given=deepcopy(law))  # matrices and solutions are those of the law of now

    @property
    def m(self) -> int:  # type: ignore[override]
        """Number of unknowns per point."""
        return self.given.m

    @property
    def law(self) -> Law:
        """Which flux gradients make."""
        return self.given

    def _add_solid(self, data: FloatArray, phase: int, part: Quadrature) -> FloatArray:
        """With a tensor that has the right shape, and an energy."""
        some = np.unique(np.linspace(0, max(len(part) - 1, 0), LOOKED_AT).astype(np.int64))
        if len(part):
            _check_tangent(self.law.phases[phase], self.assembly, part.points[some])
        return super()._add_solid(data, phase, part)

    def __repr__(self) -> str:
        return super().__repr__().replace("Physics(", f"Physics({type(self.given).__name__}, ", 1)

    def hold(
        self, on: Any, value: Any = 0.0, *, components: Any = None, method: str = "auto",
        where: Any = None,
    ) -> Self:  # fmt: skip
        """Prescribe the field on an end face, a level set or a region.

        Parameters
        ----------
        on : str, callable, (2, 3) array-like, Field or SurfaceMesh
            As in `Elasticity.clamp`.
        value : float, sequence of m floats or callable
            The field; a callable takes points of space (n, 3), returns (n, m).
        components : sequence of int, optional
            Which unknowns; by default all. They have no normal part.
        method : {"auto", "strong", "nitsche"}
            As in `Elasticity.clamp`.
        where : str, callable, (2, 3) array-like, Field or SurfaceMesh, optional
            As in `Elasticity.clamp`.

        Returns
        -------
        Physics
            A new problem.
        """
        if isinstance(components, str):
            raise InputError(
                f"components={components!r:.40}: give numbers of unknowns, from 0 to {self.m - 1}"
            )
        return self._supported(on, components, value, method, "value", where)

    def exchange(self, on: Any, transfer: Any, *, around: Any = 0.0, where: Any = None) -> Self:
        """Let flow in what is proportional to the distance from what is around.

        Parameters
        ----------
        on : str, callable, (2, 3) array-like, Field or SurfaceMesh
            As in `hold`.
        transfer : float, sequence of m floats or callable
            Per area and unit of the field.
        around : float, sequence of m floats or callable
            The field around.
        where : str, callable, (2, 3) array-like, Field or SurfaceMesh, optional
            As in `hold`.

        Returns
        -------
        Physics
            A new problem.
        """
        return self._sprung(on, transfer, around, "transfer", where)

    def load(
        self, *, body: Any = None, surface: Any = None, on: Any = "", where: Any = None
    ) -> Self:
        """Add what comes in, in the solid or through a place.

        Parameters
        ----------
        body : float, sequence of m floats or callable, optional
            Per volume.
        surface : float, sequence of m floats or callable, optional
            Per area, at `on`.
        on, where : str, callable, (2, 3) array-like, Field or SurfaceMesh
            As in `hold`.

        Returns
        -------
        Physics
            A new problem.

        Raises
        ------
        InputError
            If there is no load, or a place is missing or too much.
        """
        if (surface is None) == (not isinstance(on, str) or bool(on)):
            raise InputError(f"on={on!r:.80}: what is surface= needs a place, body= has none")
        if body is None and surface is None:
            raise InputError("load needs body or surface")
        new = self if body is None else self._loaded("body", body, self.m)
        return new if surface is None else new._loaded("surface", surface, self.m, on, where)

    def solve(
        self, *, method: str = "auto", tol: float = 1e-8, max_iterations: int = 500,
        progress: Progress = None,
    ) -> "FieldSolution":  # fmt: skip
        """Solve for the field.

        Parameters
        ----------
        method, tol, max_iterations, progress : str, float, int, bool or callable
            As in `Elasticity.solve`.

        Returns
        -------
        FieldSolution
            Field, flux, what comes in through every place.

        Raises
        ------
        InputError
            If nothing holds the field.
        ConvergenceError
            If the tolerance is not reached.

        Warns
        -----
        PrecisionWarning
            If the energy is off by more than 2 % because of the cells, by estimate: see
            `SolveReport.discretization_error`.
        """
        return FieldSolution(self, *self._solve(method, tol, max_iterations, progress))


def _check_law(law: Any) -> None:
    """Refuse what is no law, or has other numbers of unknowns or phases than there are."""
    if not isinstance(law, Law) or type(law).tangent is Law.tangent:
        raise InputError(f"law must be a Law, of a class with a tangent, got {law!r:.80}")
    if isinstance(law.m, bool) or not isinstance(law.m, int) or law.m < 1:
        raise InputError(f"law.m must be a number of unknowns, 1 or more, got {law.m!r:.40}")
    pair = law.phases
    if not isinstance(pair, (tuple, list)) or len(pair) != 2:
        raise InputError(f"law.phases must be two laws, got {pair!r:.80}")
    for one in pair:
        if not isinstance(one, Law) or one.m != law.m:
            raise InputError(f"law.phases must be laws of {law.m} unknowns, got {one!r:.80}")


def _check_tangent(law: Law, asm: Any, u: FloatArray) -> None:
    """Refuse tensors at parameters (n, 3) of another shape, or not symmetric and positive."""
    alone = _tensors(law, asm, u[-1:])
    A = _tensors(law, asm, u)
    size, most = 3 * law.m, np.abs(A).max(axis=(1, 2, 3, 4))
    if np.abs(A[-1] - alone[0]).max() > ROUNDED * most.max():
        raise InputError(
            f"law.tangent has one row for {len(u)} points, and another tensor at u="
            f"{u[-1].round(6).tolist()} alone; return a row per point where it varies"
        )
    own = np.abs(np.einsum("qikil->qikl", A)).max(axis=(2, 3)).min(axis=1)
    A = A.reshape(-1, size, size)
    skew = np.abs(A - A.transpose(0, 2, 1)).max(axis=(1, 2))
    least = np.linalg.eigvalsh(0.5 * (A + A.transpose(0, 2, 1)))[:, 0]
    for bad, what in (
        (own <= 0.0, "zero for an unknown"),
        (skew > ROUNDED * most, "not symmetric"),
        (least < -ROUNDED * most, "not positive"),
    ):
        if bad.any():
            k = int(bad.argmax())
            at = u[min(k, len(u) - 1)].round(6).tolist()
            raise InputError(
                f"law.tangent is {what} at u={at} (its largest entry is {most[k]:.4g}, its lowest "
                f"eigenvalue {least[k]:.4g}, off symmetry {skew[k]:.4g}); flux must be the "
                "derivative of an energy that no gradient makes negative"
            )


def _tensors(law: Law, asm: Any, u: FloatArray) -> FloatArray:
    """Tensors at parameters, of the right shape, real and finite."""
    A, wanted = np.asarray(law.tangent(asm, u)), (len(u), *[law.m, 3] * 2)
    if A.shape not in (wanted, (1, *wanted[1:])):
        points = "one point" if len(u) == 1 else f"{len(u)} points"
        raise InputError(f"law.tangent must be of shape {wanted} at {points}, got {A.shape}")
    if A.dtype.kind not in "fiu":
        raise InputError(f"law.tangent must be of real numbers, got {A.dtype}")
    bad = ~np.isfinite(A).all(axis=(1, 2, 3, 4))
    if bad.any():
        at = u[min(int(bad.argmax()), len(u) - 1)].round(6).tolist()
        raise InputError(
            "law.tangent must be finite, also in cells that are partly outside of the solid, and "
            f"is not at u={at}"
        )
    return A


@dataclass(frozen=True, eq=False, repr=False)
class FieldSolution(Solved):
    """Field of a law: made by `Physics.solve`.

    Attributes
    ----------
    problem : Physics
        What was solved.
    coefficients : ndarray, shape (functions, m)
        Of the splines.
    solved : SolveReport or None
        What the solver says; None if nothing was free.
    """

    problem: Physics
    shown: ClassVar[str] = "value"
    written: ClassVar[tuple[tuple[str, str], ...]] = (("value", "evaluate"), ("flux", "flux"))

    def __repr__(self) -> str:
        return f"FieldSolution({len(self.coefficients)} functions, energy {self.energy:.6g})"

    @property
    def _smooth(self) -> "type[RecoveredField]":
        return RecoveredField

    def flux(self, u: ArrayLike) -> FloatArray:
        """Flux of the law at parameters: its tensor times the gradient.

        Parameters
        ----------
        u : array_like, shape (n, 3)
            Parameters.

        Returns
        -------
        ndarray, shape (n, 3 m)
            Component by component.
        """
        return self._flux_at(as_points("u", u))

    def flux_on(self, rule: Quadrature) -> FloatArray:
        """Flux at the points of a rule in the active cells.

        Parameters
        ----------
        rule : Quadrature
            In parameters, or in space with `parameters`.

        Returns
        -------
        ndarray, shape (n, 3 m)
            As `flux`.
        """
        return self._flux_on(rule)

    @cached_property
    def energy(self) -> float:
        """Half of the integral of flux times gradient."""
        return 0.5 * self.problem._solid_energy(self.coefficients)

    @cached_property
    def inflow(self) -> Mapping[str, FloatArray]:
        """What comes in (m,) through each place where the field is held or exchanged."""
        return self._coming_in

    def field_data(self) -> dict[str, float]:
        """Numbers that files hold about the whole.

        Returns
        -------
        dict of str to float
            ``energy``.
        """
        return {"energy": self.energy}


@dataclass(frozen=True, eq=False, repr=False)
class RecoveredField(Smooth, FieldSolution):
    """A field with a smooth flux: made by `FieldSolution.recovered`.

    Attributes
    ----------
    projected : ndarray, shape (functions, 3 m)
        Coefficients of the recovered flux.
    """
