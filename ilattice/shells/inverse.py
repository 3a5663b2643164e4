"""Shells of wanted stiffness: a surrogate of many homogenized cells, and its inversion.

Young's modulus (its logarithm), Poisson's ratio and Zener's ratio are interpolated between the
shells of a `Cloud` by cubic radial functions. Parameters of wanted moduli are least squares from
many starts; there may be several. Each is homogenized as the shells of the surrogate were, and
corrected once by what it was off.

Guarantees: verified solutions have the moduli that they tell, with the cells and triangles of the
surrogate. Non-guarantee: errors of these cells are not part of any number here; a target that no
shell has gets the nearest ones, with their distance.

Source: Xu et al. 2023, section 4.2, with a network in place of the surrogate.
"""

import warnings
from collections.abc import Mapping
from concurrent.futures import Executor
from dataclasses import dataclass
from os import PathLike
from typing import Any

import numpy as np
from scipy.interpolate import RBFInterpolator
from scipy.optimize import least_squares

from ilattice._progress import Progress, track
from ilattice._typing import FloatArray
from ilattice._validate import FixedMapping, Frozen, as_flag, as_positive, as_real, as_whole
from ilattice.errors import GeometryError, IlatticeError, InputError, PrecisionWarning
from ilattice.homogenize.elastic import elastic
from ilattice.shells.cell import Shell
from ilattice.shells.study import (
    CELLS,
    DENSITY,
    LAYER,
    OPTIONS,
    Cloud,
    N,
    Space,
    cloud,
    shell_of,
    space,
    wall_of,
)
from ilattice.shells.topologies import Topology

#: Starts of the search, least distance of solutions in parts of the ranges.
STARTS, APART = 32, 0.1
#: Distance of the nearest solution that is told.
FAR = 0.05
#: Shells that a surrogate needs per parameter.
FEWEST = 6


@dataclass(frozen=True, eq=False, repr=False)
class Solution(Frozen):
    """Parameters for wanted moduli. Made by `Surrogate.invert`.

    Attributes
    ----------
    name : str
        Of the shell, as topo_19_rrr.
    parameters : mapping
        By name; `density` is the relative density.
    young, poisson, zener : float
        Moduli along the axes: homogenized if `verified`, else of the surrogate.
    distance : float
        From the wanted ones: relative in Young's modulus and absolute in Poisson's ratio, the
        larger of both.
    verified : bool
        Whether the cell was homogenized.
    """

    name: str
    parameters: FixedMapping[str, float]
    young: float
    poisson: float
    zener: float
    distance: float
    verified: bool

    def __repr__(self) -> str:
        """Short form."""
        given = ", ".join(f"{k}={v:.4g}" for k, v in self.parameters.items())
        return (
            f"Solution({given}; young={self.young:.4g}, poisson={self.poisson:.4g}, "
            f"distance={self.distance:.2g})"
        )

    def shell(self, **options: Any) -> Shell:
        """The shell.

        Parameters
        ----------
        **options
            ``n`` and ``layer``, as in `ilattice.shells.surface`; by default 16 and 0.03, as of
            surrogates: if it was made with others, give these.

        Returns
        -------
        Shell
            Its tile with ``offset(relative_density=parameters["density"])`` is the solution.
        """
        return shell_of(self.name, self.parameters, **options)


@dataclass(frozen=True, eq=False, repr=False)
class Surrogate(Frozen):
    """Moduli of shells as functions of their parameters. Made by `surrogate`.

    Attributes
    ----------
    cloud : Cloud
        The shells that it interpolates.
    n, layer, cells : int, float, int
        Of surfaces and analyses.
    """

    cloud: Cloud
    n: int
    layer: float
    cells: int

    def __post_init__(self) -> None:
        """Fit the interpolants."""
        if not isinstance(self.cloud, Cloud):
            raise InputError(f"cloud must be a Cloud, got {self.cloud!r:.80}")
        super().__post_init__()
        c = self.cloud
        _check_free(c.space)
        outputs = np.column_stack([np.log(c.young), c.poisson, np.log(c.zener)])
        object.__setattr__(self, "_fit", _interpolant(self._unit(c.parameters), outputs))

    def __repr__(self) -> str:
        """Short form."""
        return f"Surrogate({self.cloud.space.topology}, {len(self.cloud.young)} shells)"

    def predict(self, parameters: Mapping[str, float]) -> dict[str, float]:
        """Moduli at parameters.

        Parameters
        ----------
        parameters : mapping
            By the names of ``cloud.space``.

        Returns
        -------
        dict
            young, poisson and zener.

        Raises
        ------
        InputError
            If a name is missing or not known, or a value is out of its range.
        """
        space = self.cloud.space
        if not isinstance(parameters, Mapping) or set(parameters) != set(space.names):
            raise InputError(
                f"parameters must be {', '.join(space.names)} by name, got {parameters!r:.80}"
            )
        row = np.array([as_real(name, parameters[name]) for name in space.names])
        slack = 1e-9 * (np.array(space.high) - np.array(space.low))
        for name, x, low, high, s in zip(
            space.names, row, space.low, space.high, slack, strict=True
        ):
            if not low - s <= x <= high + s:
                raise InputError(f"{name} must be from {low:g} to {high:g}, got {x:g}")
        moduli = map(float, self._moduli(row[None])[0])
        return dict(zip(("young", "poisson", "zener"), moduli, strict=True))

    def errors(self, folds: int = 8) -> dict[str, float]:
        """Errors of prediction, by leaving out a part of the shells at a time.

        Parameters
        ----------
        folds : int
            Number of parts.

        Returns
        -------
        dict
            Root mean squares: relative of young and zener, absolute of poisson.

        Raises
        ------
        InputError
            If there are more parts than shells, or the others are too few to be interpolated.
        """
        count = len(self.cloud.young)
        folds = as_whole("folds", folds, 2, count)
        c = self.cloud
        x = self._unit(c.parameters)
        free = int((np.ptp(x, axis=0) > 0.0).sum())
        need, left = (free + 1) * (free + 2) // 2, count - -(-count // folds)
        if left < need:
            raise InputError(f"folds must leave {need} shells, but {folds} of {count} leave {left}")
        y = np.column_stack([np.log(c.young), c.poisson, np.log(c.zener)])
        off = np.empty_like(y)
        for k in range(folds):
            out = np.arange(len(x)) % folds == k
            off[out] = _interpolant(x[~out], y[~out])(x[out]) - y[out]
        rms = np.sqrt((off**2).mean(axis=0))
        return dict(zip(("young", "poisson", "zener"), map(float, rms), strict=True))

    def invert(
        self, *, young: float, poisson: float, density: float, count: int = 3,
        verify: bool = True, progress: Progress = None,
    ) -> tuple[Solution, ...]:  # fmt: skip
        """Parameters for wanted moduli.

        Parameters
        ----------
        young, poisson : float
            Along the axes, for a solid of Young's modulus 1.
        density : float
            Relative density, in the range of the surrogate.
        count : int
            Most solutions.
        verify : bool
            Whether solutions are homogenized, corrected once, and homogenized again; those that
            turn out to be no shells are left out. It takes some seconds for each.
        progress : bool or callable, optional
            Solutions; see `ilattice._progress.track`.

        Returns
        -------
        tuple of Solution
            The nearest first; different ones are a tenth of the ranges apart or more.

        Raises
        ------
        InputError
            If a modulus or the density is out of range.
        GeometryError
            If no solution is a shell.

        Warns
        -----
        PrecisionWarning
            If the nearest one is farther than 0.05 from the wanted moduli, see
            `Solution.distance`.
        """
        space = self.cloud.space
        goal = np.array([np.log(as_positive("young", young)), as_real("poisson", poisson)])
        if not -1.0 < goal[1] < 0.5:
            raise InputError(f"poisson must be between -1 and 1/2, got {poisson!r}")
        density = as_positive("density", density)
        low, high = space.low[-1], space.high[-1]
        if not low <= density <= high:
            raise InputError(
                f"density must be from {low:g} to {high:g}, as the surrogate's, got {density:g}"
            )
        count = as_whole("count", count, 1, STARTS)
        last = 0.0 if high == low else (density - low) / (high - low)
        found = self._searched(goal, last)[:count]
        if not as_flag("verify", verify):
            return _warned(
                [self._told(x, self._moduli_of(x), goal, verified=False) for x in found], goal
            )
        solutions, reasons = [], []
        for x in track(found, "verify", progress):
            try:
                solutions.append(self._verified(x, goal))
            except IlatticeError as e:
                reasons.append(str(e))
        if not solutions:
            raise GeometryError(f"no shell is found for these moduli: {reasons[0]}")
        return _warned(sorted(solutions, key=lambda s: s.distance), goal)

    # ------------------------------------------------------------------ inner

    def _unit(self, parameters: FloatArray) -> FloatArray:
        """Parameters in parts of their ranges; those that are fixed stay zero."""
        low, high = np.array(self.cloud.space.low), np.array(self.cloud.space.high)
        unit: FloatArray = (parameters - low) / np.where(high > low, high - low, 1.0)
        return unit

    def _moduli(self, parameters: FloatArray) -> FloatArray:
        """Young's modulus, Poisson's ratio and Zener's, as columns."""
        y = self._fit(self._unit(parameters))  # type: ignore[attr-defined]
        return np.column_stack([np.exp(y[:, 0]), y[:, 1], np.exp(y[:, 2])])

    def _moduli_of(self, x: FloatArray) -> FloatArray:
        row: FloatArray = self._moduli(self.cloud.space.placed(x[None]))[0]
        return row

    def _least(self, start: FloatArray, goal: FloatArray) -> Any:
        """Least squares within the ranges, at a fixed density."""
        fit, last = self._fit, start[-1:]  # type: ignore[attr-defined]

        def off(x: FloatArray) -> FloatArray:
            misfit: FloatArray = fit(np.concatenate([x, last])[None])[0, :2] - goal
            return misfit

        inside = np.clip(start[:-1], 1e-6, 1.0 - 1e-6)
        return least_squares(off, inside, bounds=(0.0, 1.0), xtol=1e-8, diff_step=[1e-4])

    def _searched(self, goal: FloatArray, last: float) -> list[FloatArray]:
        """Different solutions of the surrogate, the best first."""
        from scipy.stats import qmc

        space = self.cloud.space
        free = np.array(space.high[:-1]) > np.array(space.low[:-1])
        starts = qmc.Sobol(len(free), seed=1).random(STARTS) * free
        fits = [self._least(np.append(s, last), goal) for s in starts]
        fits.sort(key=lambda f: float(f.cost))
        found: list[FloatArray] = []
        for f in fits:
            x = np.append(f.x * free, last)
            if all(np.linalg.norm(x - other) > APART for other in found):
                found.append(x)
        return found

    def _verified(self, x: FloatArray, goal: FloatArray) -> Solution:
        """A solution that was homogenized, and corrected once if that makes it better."""
        first = self._homogenized(x)
        best = self._told(x, first, goal, verified=True)
        true = np.array([np.log(first[0]), first[1]])
        modelled = self._moduli_of(x)
        gap = np.array([np.log(modelled[0]), modelled[1]]) - true
        better = np.append(self._least(x, goal + gap).x, x[-1])
        if np.linalg.norm(better - x) < 1e-6:
            return best
        try:
            other = self._told(better, self._homogenized(better), goal, verified=True)
        except IlatticeError:
            return best
        return min(best, other, key=lambda s: s.distance)

    def _homogenized(self, x: FloatArray) -> FloatArray:
        """Young's modulus, Poisson's ratio and Zener's ratio of a shell."""
        space = self.cloud.space
        values = space.named(space.placed(x))
        eff = elastic(
            wall_of(space.topology, values, self.n, self.layer),
            self.cells,
            estimate=OPTIONS["estimate"],
        )
        young = eff.E((1.0, 0.0, 0.0))
        return np.array([young, 0.5 - young / (6.0 * eff.K), eff.zener])

    def _told(
        self, x: FloatArray, moduli: FloatArray, goal: FloatArray, *, verified: bool
    ) -> Solution:
        space = self.cloud.space
        young, poisson, zener = map(float, moduli)
        distance = max(abs(young / float(np.exp(goal[0])) - 1.0), abs(poisson - float(goal[1])))
        values = space.named(space.placed(x))
        return Solution(space.topology, values, young, poisson, zener, distance, verified)


def _check_free(of: Space) -> None:
    """Refuse ranges of a single point."""
    if of.low == of.high:
        raise InputError("ranges must not all be fixed: give one parameter two ends that differ")


def _warned(solutions: list[Solution], goal: FloatArray) -> tuple[Solution, ...]:
    """The solutions; where the nearest one is far from what is wanted, that is told."""
    best = min(solutions, key=lambda s: s.distance)
    if best.distance > FAR:
        young, poisson = float(np.exp(goal[0])), float(goal[1])
        warnings.warn(
            f"the moduli are out of reach: the nearest of {best.name} is off by {best.distance:.2g}"
            f" (wanted young={young:.4g}, poisson={poisson:.4g}; got young={best.young:.4g}, "
            f"poisson={best.poisson:.4g}): take wider ranges, another density, or another topology",
            PrecisionWarning, stacklevel=3,
        )  # fmt: skip
    return tuple(solutions)


def surrogate(
    name: str | Topology, samples: int = 200, *,
    ranges: Mapping[str, tuple[float, float]] | None = None,
    density: float | tuple[float, float] = DENSITY, seed: int = 0, n: int = N,
    layer: float = LAYER, cells: int = CELLS, table: str | PathLike[str] | None = None,
    executor: Executor | None = None, progress: Progress = None,
) -> Surrogate:  # fmt: skip
    """Moduli of shells as functions of their parameters, from some hundred that are homogenized.

    Parameters
    ----------
    name : str
        As ``topo_19_rrr``.
    samples : int
        Number of shells.
    ranges, density, seed, n, layer, cells, table, executor, progress : optional
        See `cloud`.

    Returns
    -------
    Surrogate
        With its inverse, `Surrogate.invert`.

    Raises
    ------
    InputError
        If an argument is wrong.
    GeometryError
        If too few of the samples are shells.
    """
    _check_free(space(name, ranges, density))
    found = cloud(
        name, samples, ranges=ranges, density=density, seed=seed, n=n, layer=layer, cells=cells,
        table=table, executor=executor, progress=progress,
    )  # fmt: skip
    need = FEWEST * len(found.space.names)
    if len(found.young) < need:
        why = found.rows.failed[0]["message"] if found.rows.failed else "take more samples"
        raise GeometryError(
            f"{len(found.young)} of {samples} samples are shells, a surrogate of "
            f"{len(found.space.names)} parameters needs {need}: {why}"
        )
    return Surrogate(found, n, layer, cells)


def _interpolant(x: FloatArray, y: FloatArray) -> Any:
    """Cubic radial functions; directions in which points do not differ are left out."""
    free = np.ptp(x, axis=0) > 0.0
    fit = RBFInterpolator(x[:, free], y, kernel="cubic", degree=2)
    return fit if free.all() else _Part(fit, free)


@dataclass(frozen=True, eq=False)
class _Part:
    """An interpolant of some of the coordinates."""

    fit: RBFInterpolator
    free: Any

    def __call__(self, x: FloatArray) -> FloatArray:
        """Values (n, m) at points (n, k)."""
        values: FloatArray = self.fit(x[:, self.free])
        return values
