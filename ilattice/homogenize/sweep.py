"""Effective stiffness of many cells: a table that can be interrupted, fits, pictures.

::

    rows = il.homogenize.sweep(["gyroid", "P"], relative_density=[0.1, 0.2, 0.3], table="e_nu.csv")
    rows.fit("E", cell="gyroid").exponent
    rows.plot().savefig("e.png")

Rows go to a table of `ilattice.io.table`, the one of the sweeps of the command line, as soon as
they and all before them are known.

Guarantees: a sweep that was killed and is run again ends with the bytes of one that was not, for
any executor; what is in the table is not computed again while the cell, its parameters, the options
and the library are the same. Non-guarantee: of a function only its own source counts, not that of
what it calls.
"""

import csv
import inspect
import pickle
import sys
import warnings
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import Executor, Future, ProcessPoolExecutor
from contextlib import nullcontext
from dataclasses import dataclass
from functools import partial
from hashlib import sha256
from itertools import product
from os import PathLike
from pathlib import PurePath
from typing import TYPE_CHECKING, Any

import numpy as np

from ilattice._files import as_path, atomic_write
from ilattice._progress import Progress, track
from ilattice._typing import FloatArray
from ilattice._validate import FixedMapping, Frozen, as_items, near_names, read_only
from ilattice._version import __version__
from ilattice.cutfem.elasticity import Elasticity
from ilattice.errors import (
    FormatError,
    IlatticeError,
    InputError,
    PrecisionWarning,
    printable,
    shortened,
)
from ilattice.homogenize._estimate import outside
from ilattice.homogenize.arguments import check_options
from ilattice.homogenize.effective import Effective
from ilattice.homogenize.elastic import elastic
from ilattice.homogenize.voxel import voxels
from ilattice.io.table import KEPT, Table
from ilattice.lattice import Lattice
from ilattice.macroshape.cells import cell as unit_cell
from ilattice.tiles.catalog import get
from ilattice.tiles.tile import Tile

if TYPE_CHECKING:
    from matplotlib.figure import Figure

#: What is told of a cell: stiffness of the nearest isotropic tensor, along the axes, estimated
#: error, upper bounds of Hashin and Shtrikman, margins of the bounds, and the edges of the cell, of
#: u, v, w, along which the solid goes on.
RESULTS = (
    "density", "E", "nu", "G", "K", "zener", "E_x", "E_y", "E_z", "error", "E_most", "G_most",
    "K_most", "voigt", "reuss", "bulk", "shear", "percolates",
)  # fmt: skip
NUMBERS = RESULTS[:-1]
MAX_RUNS = 1_000_000
#: Part of the cases in which the true numbers are within the intervals of a fit.
SURE = 0.95
MARKS = "osD^v<>p*"
REMEDY = "give a function with a name at the top of a module, or functools.partial of one"


@dataclass(frozen=True)
class Fit:
    """A power law C density^n through rows, by least squares of logarithms.

    Attributes
    ----------
    coefficient, exponent : float
        C and n.
    coefficient_interval, exponent_interval : tuple of 2 floats
        In which they are with a confidence of 95 %, if deviations from the law were random; of two
        rows, which leave nothing to judge by, infinite.
    deviation : float
        Root mean square of the relative deviations of rows.
    count : int
        Number of rows.
    """

    coefficient: float
    exponent: float
    coefficient_interval: tuple[float, float]
    exponent_interval: tuple[float, float]
    deviation: float
    count: int


@dataclass(frozen=True, eq=False)
class Rows(Frozen, Sequence[FixedMapping[str, Any]]):
    """Rows of a sweep, in its order; ``rows["E"]`` is a column.

    Attributes
    ----------
    rows : tuple of mappings
        Cell, parameters, results by name; ``message`` tells why there are none.
    """

    rows: tuple[FixedMapping[str, Any], ...]

    def __repr__(self) -> str:
        return f"Rows({len(self)} rows, {len(self.failed)} without results)"

    def __len__(self) -> int:
        return len(self.rows)

    def __getitem__(self, index: Any) -> Any:
        """A row by number, rows by a slice, or a column by name."""
        if not isinstance(index, str):
            return self.rows[index]
        if not self.rows or index not in self.rows[0]:
            known = list(self.rows[0]) if self.rows else []
            raise InputError(f"rows have no column {index!r:.40}{near_names(index, known)}")
        values = [row[index] for row in self.rows]
        if index in NUMBERS:
            return read_only(np.array([np.nan if v == "" else v for v in values], np.float64))
        return values

    @property
    def failed(self) -> tuple[FixedMapping[str, Any], ...]:
        """Rows without results."""
        return tuple(row for row in self.rows if row["message"])

    def _numbers(self, name: str, cell: str | None) -> tuple[FloatArray, FloatArray]:
        """Densities and a quantity of rows in which it is positive."""
        if name not in NUMBERS:
            raise InputError(f"quantity must be one of {', '.join(NUMBERS)}, got {name!r:.40}")
        mine = np.ones(len(self), bool)
        if cell is not None:
            names = cell, _full_name(cell)
            mine = np.array([row["cell"] in names for row in self.rows])
            if not mine.any():
                known = dict.fromkeys(row["cell"] for row in self.rows)
                raise InputError(f"cell: no row has {cell!r:.60}; there are {', '.join(known)}")
        density, y = self["density"][mine], self[name][mine]
        return density[y > 0], y[y > 0]

    def fit(self, quantity: str = "E", *, cell: str | None = None) -> Fit:
        """Fit a power law of the relative density (L. Gibson and M. Ashby, 1997).

        Parameters
        ----------
        quantity : str
            Column of results.
        cell : str, optional, keyword-only
            Take the rows of this cell alone.

        Returns
        -------
        Fit
            With intervals of confidence.

        Raises
        ------
        InputError
            If there are no two densities, or no such column.
        """
        from scipy.stats import t

        density, y = self._numbers(quantity, cell)
        if len(density) < 2 or not np.ptp(density) > 1e-9:
            raise InputError(
                f"fit needs rows of two densities or more with {quantity} above zero, got "
                f"{len(density)} rows"
            )
        A = np.stack([np.ones(len(y)), np.log(density)], axis=1)
        c, n = np.linalg.lstsq(A, np.log(y), rcond=None)[0]
        off = np.log(y) - A @ (c, n)
        free = len(y) - 2
        wide = np.full(2, np.inf)
        if free:
            spread = np.sqrt(np.diag(np.linalg.inv(A.T @ A)) * (off @ off) / free)
            wide = float(t.ppf(0.5 + 0.5 * SURE, free)) * spread
        low, high = np.exp(c - wide[0]), np.exp(c + wide[0])
        return Fit(
            float(np.exp(c)), float(n), (float(low), float(high)),
            (float(n - wide[1]), float(n + wide[1])), float(np.sqrt(np.mean(off**2))), len(y),
        )  # fmt: skip

    def save(self, path: str | PathLike[str]) -> None:
        """Write all columns, parameters as they were given.

        Parameters
        ----------
        path : path-like
            Ending in ``.csv``, or in ``.parquet``, which needs pyarrow.

        Raises
        ------
        FormatError
            If the ending is another one, pyarrow is missing, or the file cannot be written.
        """
        ending = PurePath(as_path("path", path)).suffix.lower()
        if ending not in (".csv", ".parquet"):
            raise FormatError(f"{path!s:.80} must end in .csv or .parquet")
        names = list(self.rows[0]) if self.rows else []
        with atomic_write(path, text=ending == ".csv") as file:
            if ending == ".csv":
                lines = csv.writer(file, lineterminator="\n")
                lines.writerows([names, *([row[n] for n in names] for row in self.rows)])
            else:
                _parquet({n: self[n] for n in names}, file)

    def plot(self, quantity: str = "E") -> "Figure":
        """Draw a quantity over the relative density, with the bounds of Hashin and Shtrikman.

        Parameters
        ----------
        quantity : str
            Column of results.

        Returns
        -------
        matplotlib.figure.Figure
            ``savefig`` writes it.
        """
        from matplotlib.figure import Figure

        self._numbers(quantity, None)
        figure = Figure(figsize=(5.2, 4.2), layout="constrained")
        axes = figure.subplots()
        for number, name in enumerate(dict.fromkeys(self["cell"])):
            density, y = self._numbers(quantity, name)
            mark = MARKS[number % len(MARKS)]  # hollow: cells may be alike
            axes.plot(density, y, mark, ms=5, mfc="none", label=name)
        if f"{quantity}_most" in NUMBERS:
            density, y = self._numbers(f"{quantity}_most", None)
            order = np.argsort(density)
            axes.plot(density[order], y[order], "k--", lw=1, label="upper bound")
        axes.set_xlabel("relative density")
        axes.set_ylabel(quantity)
        if len(dict.fromkeys(self["cell"])) < 20:
            axes.legend(frameon=False, fontsize="small")
        return figure


def _parquet(columns: dict[str, Any], file: Any) -> None:
    """Columns as a Parquet file; what is missing is null."""
    try:
        import pyarrow
        from pyarrow.parquet import write_table
    except ImportError as e:
        raise FormatError("Parquet needs pyarrow: pip install pyarrow; or save a .csv") from e
    arrays = {k: pyarrow.array(v, from_pandas=True) for k, v in columns.items()}
    write_table(pyarrow.table(arrays), file)


def sweep(
    cells_or_makers: Any, *, table: str | PathLike[str] | None = None, cells: Any = 16,
    young: float = 1.0, poisson: float = 0.3, executor: Executor | None = None,
    progress: Progress = None, options: dict[str, Any] | None = None, **parameters: Any,
) -> Rows:  # fmt: skip
    """Effective stiffness of cells for all combinations of parameters.

    Parameters
    ----------
    cells_or_makers : str, Tile, callable, or sequence of these
        Tiles, or names of the catalogue, which take ``relative_density`` or ``thickness``, the
        half-thickness of their sheets; or functions that take all parameters by name and return
        what `elastic` takes, or an array for `voxels`, which has cells of its own.
    table : path-like, optional, keyword-only
        CSV file for the rows; if it is there, what it has is not computed again.
    cells, young, poisson : optional, keyword-only
        As in `elastic`.
    executor : concurrent.futures.Executor, optional, keyword-only
        Where rows are computed at the same time, such as
        ``ProcessPoolExecutor(mp_context=multiprocessing.get_context("spawn"))``.
    progress : bool or callable, optional, keyword-only
        Rows; see `ilattice._progress.track`.
    options : dict, optional, keyword-only
        More options of `elastic`, by name.
    **parameters
        Values, or sequences of them, by name.

    Returns
    -------
    Rows
        In the order of cells, then of parameters, the last one running fastest.

    Raises
    ------
    InputError
        If an argument is wrong, or a cell cannot be sent to the executor.
    FormatError
        If the table is of another sweep, or another sweep writes to it.

    Warns
    -----
    PrecisionWarning
        If rows have no results; and as `elastic` does, where rows are computed.

    Examples
    --------
    >>> import ilattice as il
    >>> how = {"cells": 4, "options": {"estimate": False}}  # so few cells are for examples only
    >>> rows = il.homogenize.sweep("gyroid", relative_density=[0.7, 0.9], **how)
    >>> len(rows), bool(1.0 < rows.fit("E").exponent < 3.0)
    (2, True)
    """
    many = cells_or_makers
    many = [many] if isinstance(many, (str, Tile)) or callable(many) else as_items("cells", many)
    names = [_name_of(c) for c in many]
    same = [n for n in dict.fromkeys(names) if names.count(n) > 1]
    if same or not names:
        raise InputError(f"cells: {same[0]!r:.60} is there twice" if same else "cells: none")
    values = {name: _values(name, v) for name, v in parameters.items()}
    check_options("sweep: options", options or {}, elastic, voxels, Elasticity.__init__)
    given = {"cells": cells, "young": young, "poisson": poisson, **(options or {})}
    told = "homogenize.sweep " + " ".join(f"{k}={_told(k, v)}" for k, v in given.items())
    count = len(many) * int(np.prod([len(v) for v in values.values()], dtype=np.int64))
    if count > MAX_RUNS:
        raise InputError(f"these are {count} rows; at most {MAX_RUNS} are allowed")
    runs = [
        (one, name, dict(zip(values, chosen, strict=True)))
        for one, name in zip(many, names, strict=True)
        for chosen in product(*values.values())
    ]
    _check_executor(executor, many, given)
    columns = ("cell", *values)
    where: Any = nullcontext() if table is None else Table(table, columns, RESULTS)
    with where as open_table:
        out = Rows(tuple(_computed(runs, given, told, open_table, executor, progress)))
    if out.failed:
        first = out.failed[0]
        named = ", ".join(f"{k}={first[k]}" for k in columns)
        warnings.warn(
            f"{len(out.failed)} of {len(out)} rows have no results (see Rows.failed); the first is "
            f"{named}: {first['message']}",
            PrecisionWarning,
            stacklevel=outside(),
        )
    return out


def _computed(
    runs: list[tuple[Any, str, dict[str, Any]]], given: dict[str, Any], told: str,
    table: Table | None, executor: Executor | None, progress: Progress,
) -> Iterator[FixedMapping[str, Any]]:  # fmt: skip
    """Rows, from the table or made, in their order."""
    known: list[dict[str, str] | None] = []
    keys = []
    for one, name, values in runs:
        key = {"cell": name, **{k: repr(v) for k, v in values.items()}}
        inputs = _digest(one)
        keys.append((key, inputs))
        found = None if table is None else table.find(None, key, told, inputs, __version__)
        known.append(found)
    jobs = [partial(_run, one, values, given) for one, _, values in runs]
    waiting: dict[int, Future[dict[str, Any]]] = {}
    try:
        if executor is not None:
            waiting = {i: executor.submit(job) for i, job in enumerate(jobs) if not known[i]}
        for i in track(range(len(runs)), "sweep", progress):
            key, inputs = keys[i]
            row: dict[str, Any] = dict(known[i] or {})
            if not row:
                made = waiting[i].result() if i in waiting else jobs[i]()
                row = {**key, **made, "command": told, "inputs": inputs, "version": __version__}
                if table is not None:
                    table.append(row)
            numbers = {k: row[k] for k in ("percolates", "message")}
            for name in NUMBERS:
                numbers[name] = "" if row[name] == "" else float(row[name])
            yield FixedMapping({"cell": key["cell"], **runs[i][2], **numbers})
    finally:
        for future in waiting.values():
            future.cancel()


def _run(one: Any, values: dict[str, Any], given: dict[str, Any]) -> dict[str, Any]:
    """One row: results, or why there are none."""
    try:
        solid = _solid(one, values)
        if isinstance(solid, np.ndarray):
            eff = voxels(solid, **{k: v for k, v in given.items() if k != "cells"})
        else:
            eff = elastic(solid, **given)
    except IlatticeError as e:
        return {**dict.fromkeys(RESULTS, ""), "message": shortened(printable(str(e)))}
    ways = "".join(a for a, on in zip("uvw", eff.percolates, strict=True) if on)
    return {**_results(eff), "percolates": ways, "message": ""}


def _results(eff: Effective) -> dict[str, Any]:
    """The numbers of `RESULTS`."""
    K, G = eff.K, eff.G_mean
    out: dict[str, Any] = {
        "density": eff.density, "E": _young(K, G), "G": G, "K": K, "zener": eff.zener,
        "nu": (3 * K - 2 * G) / (6 * K + 2 * G) if K + G > 0 else float("nan"), "error": eff.error,
    }  # fmt: skip
    for axis, name in zip(np.eye(3), ("E_x", "E_y", "E_z"), strict=True):
        out[name] = eff.E(axis)
    bounds = eff.bounds.hashin_shtrikman or {}
    if bounds:
        out["K_most"], out["G_most"] = bounds["bulk"][1], bounds["shear"][1]
        out["E_most"] = _young(out["K_most"], out["G_most"])
    out |= eff.margins
    return {name: "" if name not in out else float(out[name]) for name in NUMBERS}


def _young(K: float, G: float) -> float:
    """Young's modulus of an isotropic tensor."""
    return 9.0 * K * G / (3.0 * K + G) if 3.0 * K + G > 0 else 0.0


def _solid(one: Any, values: dict[str, Any]) -> Any:
    """What `elastic` takes."""
    if not isinstance(one, (str, Tile)):
        return one(**values)
    tile = get(one) if isinstance(one, str) else one
    unknown = sorted(set(values) - {"relative_density", "thickness"})
    if unknown or len(values) > 1:
        raise InputError(
            f"tiles take relative_density or thickness, got {', '.join(values)}; give a function "
            "that makes the cell"
        )
    if not values:
        return tile
    lattice = Lattice(tile, through=unit_cell(tile.cell), repeat=(1, 1, 1))
    if "thickness" in values:
        return lattice.offset(values["thickness"])
    return lattice.offset(relative_density=values["relative_density"])


# -------------------------------------------------------------------- arguments


def _name_of(one: Any) -> str:
    """What a row calls a cell."""
    if isinstance(one, str):
        return get(one).name
    if isinstance(one, Tile):
        return one.name
    if isinstance(one, partial):
        inside = [*map(repr, one.args), *(f"{k}={v!r}" for k, v in one.keywords.items())]
        return f"{_name_of(one.func)}({', '.join(inside)})"
    if not callable(one):
        raise InputError(f"cells must be tiles, names or functions, got {one!r:.60}")
    name = getattr(one, "__qualname__", "")
    if not name or "<" in name:
        raise InputError(f"cells: {one!r:.80} has no name that a row could have; {REMEDY}")
    return f"{one.__module__}.{name}" if one.__module__ != "__main__" else name


def _full_name(name: str) -> str:
    """The name of a tile that has several, others as they are."""
    try:
        return get(name).name
    except InputError:
        return name


def _digest(one: Any) -> str:
    """What changes if a cell does."""
    if isinstance(one, str):
        return ""
    if isinstance(one, partial):
        return _digest(one.func)
    if isinstance(one, Tile):
        try:
            text = pickle.dumps(one, protocol=4)
        except (pickle.PicklingError, AttributeError, TypeError):
            text = repr(one).encode()
        return sha256(text).hexdigest()[:32]
    try:
        return sha256(inspect.getsource(one).encode()).hexdigest()[:32]
    except (OSError, TypeError):
        return ""


def _values(name: str, value: Any) -> list[Any]:
    """Values of a parameter, as plain numbers and texts."""
    if name in (*RESULTS, *KEPT, "cell"):
        raise InputError(f"{name!r} is a column of the table; rename the parameter")
    many = [value] if isinstance(value, str) or np.ndim(value) == 0 else list(value)
    if not many:
        raise InputError(f"{name} has no values")
    out = [v.item() if isinstance(v, np.generic) else v for v in many]
    for v in out:
        if not isinstance(v, (bool, int, float, str)) or v != v:
            raise InputError(f"{name} must be numbers or texts, got {v!r:.60}")
    if len({repr(v) for v in out}) < len(out):
        raise InputError(f"{name} has a value twice")
    return out


def _told(name: str, value: Any) -> str:
    """An option as it stands in the table."""
    if isinstance(value, (bool, int, float, str)) or value is None:
        return repr(value)
    if isinstance(value, (list, tuple)):
        return "(" + ",".join(_told(name, v) for v in value) + ")"
    if isinstance(value, (np.ndarray, np.generic)):
        return _told(name, value.tolist())
    raise InputError(f"{name} must be numbers or texts in a sweep, got {value!r:.60}")


def _check_executor(executor: Any, many: Iterable[Any], given: dict[str, Any]) -> None:
    """Refuse executors that would hang, and cells that they cannot be sent."""
    if executor is None:
        return
    submit: Callable[..., Any] | None = getattr(executor, "submit", None)
    if not callable(submit):
        raise InputError(
            f"executor must have the interface of concurrent.futures, got {executor!r:.60}"
        )
    if isinstance(executor, ProcessPoolExecutor):
        way = getattr(getattr(executor, "_mp_context", None), "get_start_method", lambda: "spawn")()
        if way == "fork" and sys.platform != "win32":
            raise InputError(
                "executor: processes that fork hang in compiled code with threads; give "
                "ProcessPoolExecutor(mp_context=multiprocessing.get_context('spawn'))"
            )
        for one in many:
            try:
                pickle.dumps((one, given))
            except (pickle.PicklingError, AttributeError, TypeError) as e:
                raise InputError(
                    f"cells: {_name_of(one)!r:.60} cannot be sent to another process; {REMEDY}"
                ) from e
