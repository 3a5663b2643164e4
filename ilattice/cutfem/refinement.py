"""One problem on finer and finer grids: what a number tends to, how fast, and how far it is off.

::

    study = il.cutfem.refinement_study(
        lambda n: il.cutfem.Elasticity(wall, n).clamp("w=0").load(body=(1, 0, 0)).solve(),
        [(8, 8, 8), (12, 12, 12), (16, 16, 16)],
        {"compliance": lambda s: s.compliance},
    )
    print(study)

Source: Richardson, 1911; Roache, Perspective: a method for uniform reporting of grid refinement
studies, 1994: where a number differs from its limit by C hᵖ, three grids give limit and p.

Non-guarantee: this is so when all three grids resolve the solution. An order far from twice the
degree, for energies of smooth solutions, or none at all says that they do not, and the limit is no
better than the numbers then.
"""

import warnings
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from scipy.optimize import brentq

from ilattice._progress import Progress, track
from ilattice._shown import one_line
from ilattice._typing import FloatArray, IntArray
from ilattice._validate import FixedMapping, Frozen, as_array, as_counts, as_items, asked, read_only
from ilattice.cutfem.assembly import Assembly
from ilattice.cutfem.solved import Solved
from ilattice.errors import InputError, PrecisionWarning

if TYPE_CHECKING:
    from matplotlib.figure import Figure

#: Orders that are looked for.
ORDERS = (1e-3, 20.0)


@dataclass(frozen=True, eq=False, repr=False)
class RefinementStudy(Frozen):
    """Numbers on finer and finer grids: made by `refinement_study`.

    Attributes
    ----------
    cells : ndarray, shape (n, 3)
        Cells of the grids.
    h : ndarray, shape (n,)
        Mean length of the longest edges of cells, in space.
    functions : ndarray, shape (n,)
        Number of functions; times three it is the number of unknowns of elasticity.
    values : mapping of str to ndarray, shape (n,)
        What was asked for.
    estimates : ndarray, shape (n,)
        Estimated relative errors in the energy norm; NaN where they were not asked for.
    """

    cells: IntArray
    h: FloatArray
    functions: IntArray
    values: Mapping[str, FloatArray]
    estimates: FloatArray

    def order(self, name: str) -> FloatArray:
        """Observed order of convergence.

        Parameters
        ----------
        name : str
            One of `values`.

        Returns
        -------
        ndarray, shape (n,)
            From every grid and the two before it; NaN for the first two, and where differences
            do not fall.
        """
        q, out = self._named(name), np.full(len(self.h), np.nan)
        for i in range(2, len(out)):
            out[i] = observed_order(self.h[i - 2 : i + 1], q[i - 2 : i + 1])
        return out

    def limit(self, name: str) -> float:
        """What a number tends to, by Richardson extrapolation from the last three grids.

        Parameters
        ----------
        name : str
            One of `values`.

        Returns
        -------
        float
            The limit; NaN if no order is observed.
        """
        q, p = self._named(name), self.order(name)[-1]
        coarse, fine = self.h[-2:] ** p
        return float(q[-1] + (q[-1] - q[-2]) * fine / (coarse - fine))

    def error(self, name: str) -> FloatArray:
        """Relative difference from the limit.

        Parameters
        ----------
        name : str
            One of `values`.

        Returns
        -------
        ndarray, shape (n,)
            Not negative; NaN if there is no limit.
        """
        limit = self.limit(name)
        return np.abs(self._named(name) - limit) / max(abs(limit), 1e-300)

    def _named(self, name: str) -> FloatArray:
        if name not in self.values:
            raise InputError(f"name must be one of {', '.join(self.values)}, got {name!r}")
        return self.values[name]

    # ---------------------------------------------------------------- text and pictures

    def __repr__(self) -> str:
        finest = "×".join(map(str, self.cells[-1].tolist()))
        return one_line(
            f"RefinementStudy({len(self.h)} grids to {finest}: {', '.join(self.values)})"
        )

    def __str__(self) -> str:
        """A table, and the limits below it."""
        head, columns = ["cells", "h", "functions"], []
        columns.append(["x".join(map(str, row)) for row in self.cells.tolist()])
        columns.append([f"{h:.4g}" for h in self.h])
        columns.append([str(n) for n in self.functions])
        if np.isfinite(self.estimates).any():
            head.append("estimate")
            columns.append([f"{100 * e:.2g} %" for e in self.estimates])
        for name, q in self.values.items():
            head += [name, "order"]
            columns.append([f"{v:.8g}" for v in q])
            columns.append(["" if np.isnan(p) else f"{p:.2f}" for p in self.order(name)])
        rows = [head, *zip(*columns, strict=True)]
        width = [max(len(row[i]) for row in rows) for i in range(len(head))]
        lines = ["  ".join(t.rjust(w) for t, w in zip(row, width, strict=True)) for row in rows]
        return "\n".join([*lines, *map(self._verdict, self.values)])

    def _verdict(self, name: str) -> str:
        limit = self.limit(name)
        if np.isnan(limit):
            return f"{name}: no order of convergence yet; refine further"
        off = 100.0 * self.error(name)[-1]
        return f"{name}: tends to {limit:.8g}; the finest grid is off by {off:.2g} %"

    def plot(self) -> "Figure":
        """Differences from the limits, and estimates, over the length of cells.

        Returns
        -------
        Figure
            Of matplotlib; ``savefig`` writes it.
        """
        from matplotlib.figure import Figure

        figure = Figure(figsize=(6, 4.5), layout="constrained")
        axes = figure.add_subplot()
        for name in self.values:
            p = self.order(name)[-1]
            axes.loglog(self.h, self.error(name), "o-", label=f"{name}, order {p:.2f}")
        if np.isfinite(self.estimates).any():
            axes.loglog(self.h, self.estimates, "s--", label="estimate in the energy norm")
        axes.set(xlabel="length of cells", ylabel="relative error")
        axes.grid(which="both", alpha=0.3)
        axes.legend()
        return figure


def refinement_study(
    build: Callable[[tuple[int, int, int]], Solved],
    cells: Sequence[Any],
    quantities: Mapping[str, Callable[[Any], float]],
    *,
    error_estimate: bool = False,
    progress: Progress = None,
) -> RefinementStudy:
    """Solve one problem on several grids and compare.

    Parameters
    ----------
    build : callable
        Takes cells, returns the solution on them.
    cells : sequence of int or of 3 int
        Three or more grids, from coarse to fine, refined by the same factor in all directions.
    quantities : mapping of str to callable
        What to compare, by name: functions of the solution.
    error_estimate : bool
        Estimate the error in the energy norm on every grid, too.
    progress : bool or callable, optional
        See `ilattice._progress.track`.

    Returns
    -------
    RefinementStudy
        Numbers, orders, limits; ``print`` shows them as a table.

    Raises
    ------
    InputError
        If there are less than three grids, they are not refined uniformly, or nothing is asked for.

    Examples
    --------
    >>> import ilattice as il
    >>> ball = lambda u: (u**2).sum(axis=1) - 1
    >>> study = il.cutfem.refinement_study(
    ...     lambda n: (
    ...         il.cutfem.Heat(ball, n, domain=[[-1.1] * 3, [1.1] * 3], degree=1)
    ...         .convection("surface", 1.0, around=0.0)
    ...         .source(1.0)
    ...         .solve()
    ...     ),
    ...     [4, 6, 9],
    ...     {"stored": lambda s: s.stored},
    ... )
    >>> round(study.limit("stored"), 2)  # 8 π / 15 = 1.6755
    1.67
    """
    if not callable(build) or not isinstance(quantities, Mapping):
        raise InputError(
            "build must be callable and quantities a mapping, "
            f"got {build!r:.40}, {quantities!r:.40}"
        )
    grids = np.array([as_counts("cells", n) for n in as_items("cells", cells)])
    if len(grids) < 3:
        raise InputError(f"cells must be three or more grids, got {len(grids)}")
    factors = grids / grids[0]
    if np.ptp(factors, axis=1).max() > 1e-9 or not (np.diff(factors[:, 0]) > 0).all():
        raise InputError(
            "cells must be refined by the same factor in all directions, such as (8, 4, 4), "
            f"(12, 6, 6), got {grids.tolist()}"
        )
    if not all(callable(f) for f in quantities.values()):
        raise InputError(f"quantities must be functions of the solution, got {quantities!r:.80}")
    if not quantities:
        raise InputError("quantities must name what to compare, such as {'energy': ...}")
    rows: list[FloatArray] = []
    degrees: set[int] = set()
    for n in track(grids.tolist(), "refining", progress):
        with warnings.catch_warnings():  # how coarse grids are is what this is about
            warnings.filterwarnings("ignore", "the cells are too coarse", PrecisionWarning)
            solution = asked("build", build, tuple(n))
        if not isinstance(solution, Solved):
            raise InputError(f"build must return a solution, got {solution!r:.80}")
        asm = solution.problem.assembly
        degrees.add(asm.space.degree)
        if len(degrees) > 1:
            raise InputError(
                f"build: on {n} cells its problem chose another degree than on those before, and "
                "they cannot be compared; give it a degree="
            )
        estimate = solution.error_estimate().relative if error_estimate else np.nan
        numbers = [_number(name, f, solution) for name, f in quantities.items()]
        rows.append(np.array([_length(asm), len(asm.space), estimate, *numbers]))
    h, functions, estimates, *values = read_only(np.stack(rows, axis=1))
    named = dict(zip(quantities, values, strict=True))
    values = FixedMapping({name: read_only(q) for name, q in named.items()})
    return RefinementStudy(read_only(grids), h, functions.astype(np.int64), values, estimates)


def _number(name: str, f: Callable[[Any], float], solution: Any) -> float:
    """A quantity of a solution, checked."""
    told = f"quantities[{name!r}]"
    value = as_array(told, asked(told, f, solution), finite=False)
    if value.size != 1:
        raise InputError(f"{told} must return one number, got shape {value.shape}")
    return float(value.ravel()[0])


def observed_order(h: FloatArray, q: FloatArray) -> float:
    """The order p for which three numbers q differ from their limit by C hᵖ.

    Parameters
    ----------
    h : ndarray, shape (3,)
        Lengths of cells, falling.
    q : ndarray, shape (3,)
        Numbers.

    Returns
    -------
    float
        p; NaN if there is none from 0.001 to 20.
    """
    first, second = np.diff(q)
    x = h / h[0]
    if not first * second > 0:
        return np.nan

    def gap(p: float) -> float:
        a, b, c = x**p
        return float(np.log((a - b) / (b - c)) - np.log(first / second))

    return float(brentq(gap, *ORDERS)) if gap(ORDERS[0]) < 0 < gap(ORDERS[1]) else np.nan


def _length(asm: Assembly) -> float:
    """Mean of the longest edges of active cells in space."""
    box = asm.space.boxes
    J = asm.jacobians(box[:, :3] + 0.5 * box[:, 3:])
    return float((np.linalg.norm(J, axis=1) * box[:, 3:]).max(axis=1).mean())
