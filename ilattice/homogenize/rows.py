"""Rows of a sweep: columns, power laws of the density, files, pictures."""

import csv
from collections.abc import Sequence
from dataclasses import dataclass
from os import PathLike
from pathlib import PurePath
from typing import TYPE_CHECKING, Any

import numpy as np

from ilattice._files import as_path, atomic_write
from ilattice._shown import Shown
from ilattice._typing import FloatArray
from ilattice._validate import FixedMapping, Frozen, near_names, read_only
from ilattice.errors import FormatError, InputError
from ilattice.tiles.catalog import get

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
#: Part of the cases in which the true numbers are within the intervals of a fit.
SURE = 0.95
MARKS = "osD^v<>p*"


@dataclass(frozen=True)
class Fit(Shown):
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


def _full_name(name: str) -> str:
    """The name of a tile that has several, others as they are."""
    try:
        return get(name).name
    except InputError:
        return name
