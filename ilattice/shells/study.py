"""Effective stiffness of shells over ranges of their parameters.

Points of the ranges are those of a Sobol sequence, so that more of them keep the first ones, and a
table that was begun is gone on with.

Guarantees: as those of `ilattice.homogenize.sweep`; what is no shell (its curves cross, it tears,
it falls into bubbles) is a row that says why.

Source: Xu et al. 2023, section 3.1 and table A.1.
"""

from collections.abc import Mapping
from concurrent.futures import Executor
from dataclasses import dataclass
from functools import partial
from os import PathLike
from typing import Any

import numpy as np
from scipy.spatial import ConvexHull, QhullError

from ilattice._progress import Progress
from ilattice._typing import FloatArray
from ilattice._validate import (
    FixedMapping,
    Frozen,
    as_array,
    as_index,
    as_whole,
    read_only,
)
from ilattice.errors import GeometryError, InputError
from ilattice.homogenize.rows import Rows
from ilattice.homogenize.sweep import sweep
from ilattice.lattice import Lattice, Wall
from ilattice.macroshape.cells import cell as unit_cell
from ilattice.shells.boundary import check_range
from ilattice.shells.cell import Shell, cell
from ilattice.shells.surface import MAX_N, MIN_N, as_layer
from ilattice.shells.topologies import Topology, parsed

#: Ranges of table A.1, and of relative densities.
RANGES: Mapping[str, Mapping[str, tuple[float, float]]] = FixedMapping(
    {
        "topo_1": FixedMapping(
            {
                "position_1": (-0.45, 0.45), "position_2": (-0.45, 0.45),
                "position_3": (-0.45, 0.45), "derivative": (1.0, 2.0),
            }
        ),
        "topo_18": FixedMapping({"position": (0.45, 0.8), "derivative": (2.0, 4.0)}),
        "topo_19": FixedMapping({"position": (-0.4, 0.4), "derivative": (1.0, 2.0)}),
    }
)  # fmt: skip
#: Least and largest relative density by default.
DENSITY = (0.2, 0.4)
#: Triangles, layer and cells of the analysis, and its options: good for some per cent.
N, LAYER, CELLS = 16, 0.03, 12
OPTIONS = FixedMapping({"estimate": False})
#: Most designs of a study, a bound for mistakes, and the largest seed, that of a signed integer.
MAX_SAMPLES, _MAX_SEED = 100_000, 2**63 - 1
#: Fewest and most cells of an analysis per direction that may be asked for: bounds for mistakes.
MIN_CELLS, MAX_CELLS = 3, 1000


@dataclass(frozen=True)
class Space(Frozen):
    """Ranges of the parameters of a shell. Made by `space`.

    Attributes
    ----------
    topology : str
        Name, as topo_19_rrr.
    names : tuple of str
        position, or position_1 and so on per orbit; derivative; density.
    low, high : tuple of float
        Ends of the ranges.
    """

    topology: str
    names: tuple[str, ...]
    low: tuple[float, ...]
    high: tuple[float, ...]

    def points(self, count: int, seed: int = 0) -> FloatArray:
        """Points of a Sobol sequence.

        Parameters
        ----------
        count : int
            Number of points, from the first one on.
        seed : int
            Of its scrambling.

        Returns
        -------
        (count, k) array
            In the ranges.

        Raises
        ------
        InputError
            If an argument is no whole number, or negative.
        """
        from scipy.stats import qmc

        count = as_whole("count", count, 0, MAX_SAMPLES)
        seed = as_whole("seed", seed, 0, _MAX_SEED)

        power = max(1, int(np.ceil(np.log2(max(count, 2)))))
        unit = qmc.Sobol(len(self.names), seed=seed).random_base2(power)[:count]
        return self.placed(unit)

    def placed(self, unit: FloatArray) -> FloatArray:
        """Points of the unit cube in the ranges.

        Parameters
        ----------
        unit : (n, k) or (k,) array
            From 0 to 1.

        Returns
        -------
        array of that shape
            Parameters.

        Raises
        ------
        InputError
            If there are not k columns, or a value is not from 0 to 1.
        """
        unit = as_array("unit", unit)
        if not 1 <= unit.ndim <= 2 or unit.shape[-1] != len(self.names):
            told = f"{len(self.names)} columns, {', '.join(self.names)}"
            raise InputError(f"unit must have {told}, got shape {unit.shape}")
        if ((unit < 0.0) | (unit > 1.0)).any():
            raise InputError(f"unit must be from 0 to 1, but reaches {unit.min()} or {unit.max()}")
        low, high = np.array(self.low), np.array(self.high)
        points: FloatArray = low + unit * (high - low)
        return points

    def named(self, row: FloatArray) -> FixedMapping[str, float]:
        """Parameters by name.

        Parameters
        ----------
        row : (k,) array
            Parameters.

        Returns
        -------
        mapping
            In the order of `names`.

        Raises
        ------
        InputError
            If there are not k of them.
        """
        row = as_array("row", row, ndim=1)
        if len(row) != len(self.names):
            raise InputError(f"row must be {', '.join(self.names)}, got {len(row)} numbers")
        return FixedMapping(dict(zip(self.names, map(float, row), strict=True)))


def space(
    name: str | Topology, ranges: Mapping[str, tuple[float, float]] | None = None,
    density: float | tuple[float, float] = DENSITY,
) -> Space:  # fmt: skip
    """Ranges of the parameters of a shell.

    Parameters
    ----------
    name : str
        As ``topo_19_rrr``.
    ranges : mapping, optional
        Pairs by name: ``position`` for all nodes, or ``position_1`` and so on for all orbits; and
        ``derivative``. By default those of table A.1, for topo_1, topo_18 and topo_19.
    density : float or tuple of 2 float
        Relative density, or its range.

    Returns
    -------
    Space
        The ranges.

    Raises
    ------
    InputError
        If names or ranges are wrong, or must be given.
    """
    topology, symmetry = parsed(name)
    called = topology.paper or topology.name
    if ranges is None:
        if called not in RANGES:
            raise InputError(
                f"ranges must be given for {called}, such as "
                "{'position': (-0.3, 0.3), 'derivative': (1, 2)}; "
                f"they are known for {', '.join(RANGES)}"
            )
        ranges = RANGES[called]
    if not isinstance(ranges, Mapping):
        raise InputError(f"ranges must be a mapping of pairs, got {ranges!r:.80}")
    orbits = tuple(f"position_{i}" for i in range(1, len(topology.orbits) + 1))
    if set(ranges) not in ({"position", "derivative"}, {*orbits, "derivative"}):
        raise InputError(
            f"ranges must have the names position and derivative, or {', '.join(orbits)} and "
            f"derivative, got {', '.join(map(str, ranges))}"
        )
    pair = as_array("density", density)
    both = {**ranges, "density": np.broadcast_to(pair, (2,)) if pair.size == 1 else pair}
    low, high = [], []
    for key, value in both.items():
        ends = as_array(key, value)
        if ends.shape != (2,) or not ends[0] <= ends[1]:
            raise InputError(f"{key} must be a range of two ascending numbers, got {value!r:.60}")
        if key != "density":
            check_range(key, ends, value)
        low.append(float(ends[0]))
        high.append(float(ends[1]))
    if not 0.0 < low[-1] <= high[-1] < 1.0:
        raise InputError(f"density must be between 0 and 1, got {density!r:.60}")
    return Space(f"{called}_{symmetry}", tuple(map(str, both)), tuple(low), tuple(high))


def shell_of(name: str, values: Mapping[str, float], n: int = N, layer: float = LAYER) -> Shell:
    """The shell of parameters by name.

    Parameters
    ----------
    name : str
        As ``topo_19_rrr``.
    values : mapping
        Parameters by the names of a `Space`.
    n, layer : optional
        See `ilattice.shells.surface`.

    Returns
    -------
    Shell
        The shell.
    """
    orbits = [v for k, v in values.items() if k.startswith("position")]
    position: Any = orbits[0] if len(orbits) == 1 else np.array(orbits)
    return cell(name, position=position, derivative=values["derivative"], n=n, layer=layer)


def wall_of(name: str, values: Mapping[str, float], n: int = N, layer: float = LAYER) -> Wall:
    """The wall of parameters by name, in one cell that repeats.

    Parameters
    ----------
    name, values, n, layer : optional
        See `shell_of`; ``density`` is the relative density.

    Returns
    -------
    Wall
        For `ilattice.homogenize.elastic`.
    """
    tile = shell_of(name, values, n, layer).tile
    return Lattice(tile, through=unit_cell(), repeat=(1, 1, 1)).offset(
        relative_density=values["density"]
    )


def sampled(*, space: Space, seed: int, n: int, layer: float, sample: int) -> Wall:
    """The wall of a point of the Sobol sequence of a space: what `sweep` calls.

    Parameters
    ----------
    space : Space
        Ranges.
    seed : int
        Of the sequence.
    n, layer : int, float
        See `ilattice.shells.surface`.
    sample : int
        Number of the point.

    Returns
    -------
    Wall
        In a cell that repeats.
    """
    values = space.named(space.points(as_index("sample", sample) + 1, seed)[-1])
    return wall_of(space.topology, values, n, layer)


@dataclass(frozen=True, eq=False, repr=False)
class Cloud(Frozen):
    """Parameters and effective stiffness of many shells. Made by `cloud`.

    Attributes
    ----------
    space : Space
        Ranges.
    parameters : (m, k) array
        Of the shells that there are.
    young, poisson, zener, density : (m,) arrays
        Along the axes, of cells of cubic symmetry, for a solid of Young's modulus 1.
    rows : Rows
        All results, and why some are missing.
    """

    space: Space
    parameters: FloatArray
    young: FloatArray
    poisson: FloatArray
    zener: FloatArray
    density: FloatArray
    rows: Rows

    def __repr__(self) -> str:
        """Short form."""
        return f"Cloud({self.space.topology}, {len(self.young)} of {len(self.rows)} shells)"

    @property
    def hull_area(self) -> float:
        """Area of the convex hull in the plane of Young's modulus and Poisson's ratio."""
        return hull_area(self.young, self.poisson)


def cloud(
    name: str | Topology, count: int = 64, *,
    ranges: Mapping[str, tuple[float, float]] | None = None,
    density: float | tuple[float, float] = 0.3, seed: int = 0, n: int = N, layer: float = LAYER,
    cells: int = CELLS, table: str | PathLike[str] | None = None,
    executor: Executor | None = None, progress: Progress = None,
) -> Cloud:  # fmt: skip
    """Effective stiffness of shells, at points of ranges of their parameters.

    Parameters
    ----------
    name : str
        As ``topo_19_rrr``.
    count : int
        Number of shells; each takes some seconds.
    ranges, density : optional
        See `space`.
    seed : int
        Of the Sobol sequence.
    n, layer : optional
        See `surface`.
    cells : int
        Of the analysis, per direction; see `ilattice.homogenize.elastic`. Errors are not estimated.
    table : path-like, optional
        CSV file for the rows; if it is there, what it has is not computed again.
    executor, progress : optional
        See `ilattice.homogenize.sweep`.

    Returns
    -------
    Cloud
        Parameters and moduli.

    Raises
    ------
    InputError
        If an argument is wrong, or octants are not alike along all axes.
    GeometryError
        If none of the points is a shell.
    """
    of = space(name, ranges, density)
    count = as_whole("count", count, 1, MAX_SAMPLES)
    topology, symmetry = parsed(name)
    if not topology.is_cubic or symmetry != "rrr":
        raise InputError(
            f"name must be of a shell of cubic symmetry, with three reflections, got {name!r:.40}"
        )
    seed, layer = as_whole("seed", seed, 0, _MAX_SEED), as_layer(layer)
    n, cells = as_whole("n", n, MIN_N, MAX_N), as_whole("cells", cells, MIN_CELLS, MAX_CELLS)
    make = partial(sampled, space=of, seed=seed, n=n, layer=layer)
    rows = sweep(
        make, sample=list(range(count)), table=table, cells=cells, options=dict(OPTIONS),
        executor=executor, progress=progress,
    )  # fmt: skip
    good = np.flatnonzero([row["message"] == "" for row in rows])
    if not len(good):
        raise GeometryError(f"none of {count} points is a shell: {rows[0]['message']}")
    young, bulk = rows["E_x"][good], rows["K"][good]
    return Cloud(
        of, read_only(of.points(count, seed)[good]), read_only(young),
        read_only(0.5 - young / (6.0 * bulk)), read_only(rows["zener"][good]),
        read_only(rows["density"][good]), rows,
    )  # fmt: skip


def hull_area(x: FloatArray, y: FloatArray) -> float:
    """Area of the convex hull of points in a plane.

    Parameters
    ----------
    x, y : (n,) arrays
        Coordinates.

    Returns
    -------
    float
        0 for fewer than three points, or points on a line.

    Raises
    ------
    InputError
        If they are not two rows of numbers, as many of each.
    """
    x, y = as_array("x", x, ndim=1), as_array("y", y, ndim=1)
    if len(x) != len(y):
        raise InputError(f"x and y must have as many numbers, got {len(x)} and {len(y)}")
    points = np.column_stack([x, y])
    if len(points) < 3:
        return 0.0
    try:
        return float(ConvexHull(points).volume)
    except QhullError:
        return 0.0
