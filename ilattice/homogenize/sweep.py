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

import inspect
import pickle
import sys
import warnings
from collections.abc import Callable, Iterable, Iterator, Mapping
from concurrent.futures import BrokenExecutor, Executor, Future, ProcessPoolExecutor
from contextlib import nullcontext
from functools import partial
from hashlib import sha256
from itertools import product
from os import PathLike
from typing import TYPE_CHECKING, Any

import numpy as np

from ilattice._progress import Progress, track
from ilattice._validate import FixedMapping, as_items
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
from ilattice.homogenize.rows import NUMBERS, RESULTS, Rows
from ilattice.homogenize.voxel import voxels
from ilattice.io.table import KEPT, Table
from ilattice.lattice import Lattice
from ilattice.macroshape.cells import cell as unit_cell
from ilattice.tiles.catalog import get
from ilattice.tiles.tile import Tile

if TYPE_CHECKING:
    pass

#: Which of these may be NaN, which may be missing, and which may be negative.
UNKNOWN = ("nu", "zener", "error")
MISSING = ("E_most", "G_most", "K_most", "bulk", "shear")
SIGNED = ("nu", "voigt", "reuss", "bulk", "shear")
#: Part of the largest number of a row below which the sign of others is rounding.
ROUNDING = 1e-6
#: Rows of a table above which a sweep is taken for a mistake.
MAX_RUNS = 1_000_000
REMEDY = "give a function with a name at the top of a module, or functools.partial of one"


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
        More options of `elastic`, or of `voxels` for arrays, by name.
    **parameters
        Values, or sequences of them, by name.

    Returns
    -------
    Rows
        In the order of cells, then of parameters, the last one running fastest.

    Raises
    ------
    InputError
        If an argument is wrong, a cell cannot be sent to the executor, or a process of it ends.
    FormatError
        If the table is of another sweep, another sweep writes to it, or a row of it that would be
        taken has a result that is none.

    Warns
    -----
    PrecisionWarning
        If rows have no results, as functions raise or what they return is refused; and as
        `elastic` does, where rows are computed.

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
    if not isinstance(options, (Mapping, type(None))):
        raise InputError(f"options must be a dict of options by their names, got {options!r:.60}")
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
        if found is not None and table is not None:
            _check_row(found, key, str(table.path))
        known.append(found)
    jobs = [partial(_run, one, values, given) for one, _, values in runs]
    waiting: dict[int, Future[dict[str, Any]]] = {}
    try:
        if executor is not None:
            waiting = {i: _sent(executor, job) for i, job in enumerate(jobs) if not known[i]}
        for i in track(range(len(runs)), "sweep", progress):
            key, inputs = keys[i]
            row: dict[str, Any] = dict(known[i] or {})
            if not row:
                made = _received(waiting[i]) if i in waiting else jobs[i]()
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


def _check_row(row: dict[str, str], key: dict[str, str], path: str) -> None:
    """Refuse results of a table that no sweep has written."""
    numbers = {}
    wrong = [] if set(row["percolates"]) <= set("uvw") else ["percolates"]
    for name in NUMBERS:
        try:
            numbers[name] = float(row[name] or "nan")
        except ValueError:
            wrong.append(name)
            continue
        lost = np.isnan(numbers[name]) and name not in (UNKNOWN if row[name] else MISSING)
        if lost or np.isinf(numbers[name]):
            wrong.append(name)
    least = -ROUNDING * np.nanmax([0.0, *(abs(v) for v in numbers.values() if np.isfinite(v))])
    wrong += [name for name, v in numbers.items() if v < least and name not in SIGNED]
    if wrong:
        named = ", ".join(f"{k}={v}" for k, v in key.items())
        raise FormatError(
            f"table {path!r}, row of {named}: {wrong[0]} is {row[wrong[0]]!r:.40}, which is no "
            "result; mend the row or take it out"
        )


def _sent(executor: Executor, job: Callable[[], dict[str, Any]]) -> "Future[dict[str, Any]]":
    try:
        return executor.submit(job)
    except RuntimeError as e:
        raise InputError(f"executor takes no more work: {e}; give a new one") from e


def _received(future: "Future[dict[str, Any]]") -> dict[str, Any]:
    """The row of a job, unless its process has ended."""
    try:
        return future.result()
    except BrokenExecutor as e:
        raise InputError(
            "executor: a process ended without a result: it could not import the cells, or was "
            f"killed, as for want of memory; {REMEDY} that processes can import, or use fewer "
            "processes"
        ) from e


def _run(one: Any, values: dict[str, Any], given: dict[str, Any]) -> dict[str, Any]:
    """One row: results, or why there are none."""
    try:
        solid = _solid(one, values)
        if isinstance(solid, np.ndarray):
            options = {k: v for k, v in given.items() if k != "cells"}
            check_options("voxels", options, voxels)
            eff = voxels(solid, **options)
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
        try:
            return one(**values)
        except IlatticeError:
            raise
        except Exception as e:
            raise InputError(f"{_name_of(one)} raised {type(e).__name__}: {e}") from e
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
