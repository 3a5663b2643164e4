"""Results at points of space: where they are in parameters, and whether they are in the solid.

Guarantees: a point has values if it is in the image of the map and in an active cell, and the level
sets are negative there, or zero within a tenth of a cell; no other point has any. Non-guarantee:
that tenth is measured to first order.
Parts that a problem leaves out have no values.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from ilattice._geometry import cell_sizes
from ilattice._typing import AnyArray, ArrayLike, FloatArray
from ilattice._validate import (
    FixedMapping,
    Frozen,
    among,
    as_array,
    as_points,
    as_whole,
    read_only,
)
from ilattice.errors import InputError
from ilattice.quadrature.cutting import CutGrid

#: How far off the solid points may be, in cells.
NEAR = 0.1
#: Step of differences of level sets, in cells.
STEP = 1e-3
#: Points in the message of an error, so that it fits on a line or two.
SHOWN = 3
#: Names of the columns of vectors and of symmetric matrices.
COMPONENTS = {1: [""], 3: ["x", "y", "z"], 6: ["xx", "yy", "zz", "yz", "xz", "xy"]}


@dataclass(frozen=True, eq=False)
class Probe(Frozen):
    """A result at points of space: made by `Solution.at` and others.

    Every field of the result that is a function of parameters is an attribute here, such as
    ``displacement``, ``strain``, ``stress``, ``von_mises`` or ``principal`` of an elastic
    solution, ``temperature`` and ``heat_flux`` of heat.

    Attributes
    ----------
    result : object
        Whose: `Solution`, `HeatSolution` or `Mode`.
    x : ndarray, shape (n, 3)
        Points of space.
    u : ndarray, shape (n, 3)
        Their parameters; NaN outside of the solid.
    """

    result: Any
    x: FloatArray
    u: FloatArray

    def __repr__(self) -> str:
        return f"Probe({len(self.x)} points, {', '.join(self.data)})"

    def __len__(self) -> int:
        return len(self.x)

    @cached_property
    def inside(self) -> AnyArray:
        """Which points are in the solid, shape (n,)."""
        return read_only(np.isfinite(self.u[:, 0]))

    @cached_property
    def data(self) -> Mapping[str, AnyArray]:
        """What files hold, by name; NaN outside of the solid."""
        known = self.result.point_data(self.u[self.inside])
        return FixedMapping({name: read_only(self._spread(v)) for name, v in known.items()})

    def __getattr__(self, name: str) -> AnyArray:
        if name.startswith("_"):
            raise AttributeError(name)
        if name in self.data:
            return self.data[name]
        field = getattr(type(self.result), name, None)
        if not callable(field) or name not in self.result.probed:
            raise AttributeError(
                f"there is no {name!r} at points; there are "
                f"{', '.join(sorted({*self.data, *self.result.probed}))}"
            )
        return self._spread(field(self.result, self.u[self.inside]))

    @cached_property
    def distance(self) -> FloatArray:
        """Way (n,) along the points from the first one."""
        steps = np.linalg.norm(np.diff(self.x, axis=0), axis=1)
        return read_only(np.append(0.0, np.cumsum(steps))[: len(self.x)])

    def plot(self, name: str = "", *, label: str = "") -> Any:
        """Draw a field along the points; gaps are where there is no solid.

        Parameters
        ----------
        name : str
            Which one, by default the main one of the result; of vectors and stresses all
            components.
        label : str
            Of the axis, such as ``"von Mises stress (MPa)"``; by default the name.

        Returns
        -------
        Figure
            Of matplotlib; ``savefig`` writes it.

        Raises
        ------
        InputError
            If there is no such field.
        """
        from matplotlib import pyplot

        name = name or self.result.shown
        try:
            values = np.asarray(getattr(self, name))
        except AttributeError as error:
            raise InputError(f"name: {error}") from None
        figure, axes = pyplot.subplots(figsize=(6.4, 3.6), layout="constrained")
        columns = values.reshape(len(self), -1)
        names = COMPONENTS.get(columns.shape[1], [str(i) for i in range(columns.shape[1])])
        for column, part in zip(columns.T, names, strict=True):
            axes.plot(self.distance, column, label=part)
        if columns.shape[1] > 1:
            axes.legend()
        axes.set(xlabel="distance along the line", ylabel=label or name.replace("_", " "))
        axes.grid(alpha=0.3)
        return figure

    def _spread(self, values: AnyArray) -> AnyArray:
        """Values at all points from those inside."""
        out = np.full((len(self.x), *values.shape[1:]), np.nan)
        out[self.inside] = values
        return out


def probe(result: Any, x: ArrayLike, outside: str) -> Probe:
    """A result at points of space; see `Result.at`."""
    if not among(outside, ("raise", "nan")):
        raise InputError(f"outside must be 'raise' or 'nan', got {outside!r}")
    points = as_points("x", x)
    u = _inside(result.problem, points)
    outer = np.isnan(u[:, 0])
    if outer.any() and outside == "raise":
        first = np.round(points[outer][:SHOWN], 6).tolist()
        raise InputError(
            f"x: {int(outer.sum())} of {len(points)} points are outside of the solid, the first "
            f"are {first}; outside='nan' leaves them out"
        )
    return Probe(result, points, u)


def along(result: Any, start: ArrayLike, end: ArrayLike, n: int) -> Probe:
    """A result on a line; see `Result.along`."""
    a, b = (as_array(name, x) for name, x in (("start", start), ("end", end)))
    if a.shape != (3,) or b.shape != (3,) or not (a != b).any():
        raise InputError(f"start and end must be two points, got {start!r:.80} and {end!r:.80}")
    steps = np.linspace(0.0, 1.0, as_whole("n", n, 2, 10**7))
    found = probe(result, a + steps[:, None] * (b - a), "nan")
    if not found.inside.any():
        raise InputError(
            f"the line from {a.tolist()} to {b.tolist()} passes no solid at {n} points"
        )
    return found


def _inside(problem: Any, x: FloatArray) -> FloatArray:
    """Parameters of points in the solid, NaN for others."""
    asm = problem.assembly
    u = parameters(problem.domain.cut, x)
    inside = np.isfinite(u[:, 0])
    rows = np.flatnonzero(inside)
    inside[rows] = asm.space.locate(u[rows]) >= 0
    rows = np.flatnonzero(inside)
    inside[rows] = ~np.isin(problem.domain.parts.at(u[rows]), problem.parts[1])
    rows = np.flatnonzero(inside)
    inside[rows] = off(problem.domain.cut, u[rows]) <= NEAR
    return np.where(inside[:, None], u, np.nan)


def parameters(cut: CutGrid, x: FloatArray) -> FloatArray:
    """Parameters (n, 3) of points of space (n, 3), NaN outside of the image of the map."""
    return x.copy() if cut.through is None else cut.through.inverse(x)


def off(cut: CutGrid, u: FloatArray) -> FloatArray:
    """How far points (n, 3) are outside of the solid or the grid, in cells, to first order."""
    grid, sets = cut.grid, cut.sets
    lo, hi = grid.domain
    sizes = cell_sizes(grid.axes, u)
    beyond = (np.maximum(np.maximum(lo - u, u - hi), 0.0) / sizes)[:, ~np.array(grid.closed)]
    p = np.clip(u, lo, hi)
    value = sets(p)
    square = np.zeros_like(value)
    for a in range(3):
        step = STEP * sizes[:, a : a + 1] * np.eye(3)[a]
        up, down = np.minimum(p + step, hi), np.maximum(p - step, lo)
        width = ((up - down)[:, a] / sizes[:, a])[:, None]
        square += ((sets(up) - sets(down)) / width) ** 2
    with np.errstate(divide="ignore", invalid="ignore"):
        distance = np.where(value > 0.0, value / np.sqrt(square), 0.0)
    return np.maximum(distance.max(axis=1), beyond.max(axis=1, initial=0.0))
