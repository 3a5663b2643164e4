"""Bands of frequencies over wave vectors, and the gaps between them.

Guarantees: bands are sorted at every wave vector; gaps are as narrow as the estimated errors of the
frequencies make them, or say that these are not known. Non-guarantee: gaps are those of the wave
vectors at hand: between these, and off the path, a band may come closer.
"""

import csv
from dataclasses import dataclass, field
from functools import cached_property
from os import PathLike
from pathlib import PurePath
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np

from ilattice._files import as_path, atomic_write, write_report
from ilattice._shown import Shown
from ilattice._typing import ArrayLike, FloatArray, IntArray
from ilattice._validate import Frozen, as_points, as_whole, read_only
from ilattice.cutfem.output import Result
from ilattice.errors import FormatError, InputError
from ilattice.homogenize._result import finite
from ilattice.homogenize.paths import reciprocal

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from ilattice.homogenize.waves import BlochCell


@dataclass(frozen=True)
class Gap(Shown):
    """Frequencies at which no wave goes through.

    Attributes
    ----------
    below : int
        Number of bands beneath it.
    lower, upper : float
        Angular frequencies between which it lies.
    narrowed : bool
        Whether it is without the errors of the frequencies; False where these are not known.
    """

    below: int
    lower: float
    upper: float
    narrowed: bool = True

    @property
    def width(self) -> float:
        """Its width as a part of the frequency in its middle."""
        return 2.0 * (self.upper - self.lower) / (self.upper + self.lower)


@dataclass(frozen=True, eq=False)
class BlochReport(Frozen):
    """How bands were found.

    Attributes
    ----------
    cells : tuple of 3 int
        Of the grid.
    unknowns : int
        Size of the systems.
    method : str
        Of the preconditioner.
    steps : ndarray, shape (k,)
        Steps at every wave vector.
    seconds : float
        Wall time.
    """

    cells: tuple[int, int, int]
    unknowns: int
    method: str
    steps: IntArray
    seconds: float


@dataclass(frozen=True, eq=False)
class BlochMode(Result):
    """A wave at one moment: made by `Bands.mode`.

    Attributes
    ----------
    problem : BlochCell
        Of what.
    coefficients : ndarray, shape (functions, 6)
        Real and imaginary parts of v in u = exp(i k.x) v.
    k : ndarray, shape (3,)
        Wave vector.
    omega : float
        Angular frequency.
    phase : float
        Angle that the wave has gone on.
    """

    problem: "BlochCell"
    coefficients: FloatArray
    k: FloatArray
    omega: float
    phase: float = 0.0
    shown: ClassVar[str] = "displacement"
    written: ClassVar[tuple[tuple[str, str], ...]] = (("displacement", "evaluate"),)

    def evaluate(self, u: ArrayLike) -> FloatArray:
        """Displacement at parameters.

        Parameters
        ----------
        u : array_like, shape (n, 3)
            Parameters.

        Returns
        -------
        ndarray, shape (n, 3)
            Real part of the wave; NaN more than a cell away from the solid.
        """
        u = as_points("u", u)
        asm = self.problem.assembly
        v = asm.evaluate(self.coefficients, u)[0]
        angle = asm.x(u) @ self.k - self.phase
        return np.cos(angle)[:, None] * v[:, :3] - np.sin(angle)[:, None] * v[:, 3:]

    def field_data(self) -> dict[str, float]:
        """Numbers that files hold about the whole.

        Returns
        -------
        dict of str to float
            ``omega``.
        """
        return {"omega": self.omega}


@dataclass(frozen=True, eq=False)
class Bands(Frozen):
    """Frequencies of waves in a periodic solid, over wave vectors: made by `bloch`.

    Attributes
    ----------
    k : ndarray, shape (n, 3)
        Wave vectors in space.
    fractions : ndarray, shape (n, 3)
        In parts of the edges of the reciprocal lattice.
    corners : ndarray, shape (m,)
        Which of them are corners of the path.
    labels : tuple of str
        Names of the corners.
    omega : ndarray, shape (n, count)
        Angular frequencies, ascending at every wave vector; zero for rigid-body modes at rest.
    velocities : ndarray, shape (n, count, 3)
        Group velocities, derivatives of omega by k; NaN where omega is zero. Of frequencies that
        are the same, those of the waves that keep apart along the path.
    residuals : ndarray, shape (n, count)
        |K x - ω² M x| of every pair in the norm of the preconditioner, relative to the energy norm
        of x: ω² is too high by about the square of it, relatively.
    errors : ndarray, shape (count,)
        Estimated parts by which frequencies are too high because of the cells, at the corner of
        the path where they are worst, from the same waves on half and three quarters as many
        cells; with what rounding leaves, at the worst wave vector, 1 where it leaves nothing. NaN
        where there are too few cells to tell.
    size : float
        Edge a of a cube of the volume of the cell.
    speed : float
        Speed c_T of transverse waves in the solid: root of mean shear modulus by mean density.
    report : BlochReport
        Unknowns, steps.
    """

    k: FloatArray
    fractions: FloatArray
    corners: IntArray
    labels: tuple[str, ...]
    omega: FloatArray
    velocities: FloatArray
    residuals: FloatArray
    errors: FloatArray
    size: float
    speed: float
    report: BlochReport
    _problem: Any = field(repr=False)
    _vectors: Any = field(repr=False)

    def __repr__(self) -> str:
        n, count = self.omega.shape
        return (
            f"Bands({count} bands at {n} wave vectors, {'-'.join(self.labels)}, "
            f"{len(self.gaps)} gaps, error {self.error:.1e})"
        )

    @property
    def error(self) -> float:
        """Largest estimated relative error of a frequency, NaN without an estimate."""
        return float(self.errors.max())

    @property
    def normalised(self) -> FloatArray:
        """Frequencies omega a / (2 pi c_T), shape (n, count)."""
        return self.omega * (self.size / (2.0 * np.pi * self.speed))

    @cached_property
    def distance(self) -> FloatArray:
        """Length of the path from its start, shape (n,)."""
        steps = np.linalg.norm(np.diff(self.k, axis=0), axis=1)
        return read_only(np.append(0.0, np.cumsum(steps)))

    @cached_property
    def gaps(self) -> tuple[Gap, ...]:
        """Frequencies at which no wave of the path goes through."""
        return self._gaps(np.arange(len(self.k)))

    @cached_property
    def directional_gaps(self) -> tuple[tuple[str, tuple[Gap, ...]], ...]:
        """Gaps of waves of each part of the path, with its name, such as "GX"."""
        out = []
        for i in range(len(self.corners) - 1):
            rows = np.arange(self.corners[i], self.corners[i + 1] + 1)
            out.append((self.labels[i] + self.labels[i + 1], self._gaps(rows)))
        return tuple(out)

    def _gaps(self, rows: IntArray) -> tuple[Gap, ...]:
        """Between bands at some wave vectors, less what frequencies are too high."""
        low = self.omega[rows] * (1.0 - np.nan_to_num(self.errors))
        tops, floors = self.omega[rows].max(axis=0), low.min(axis=0)
        return tuple(
            Gap(n + 1, float(tops[n]), float(floors[n + 1]), bool(np.isfinite(self.errors[n + 1])))
            for n in range(self.omega.shape[1] - 1)
            if floors[n + 1] > tops[n] * (1.0 + 1e-6)
        )

    def mode(self, point: int, band: int, *, phase: float = 0.0) -> BlochMode:
        """The wave of one pair, for pictures and files.

        Parameters
        ----------
        point : int
            Number of the wave vector.
        band : int
            Number of the band, from 0.
        phase : float, keyword-only
            Angle in radians that the wave has gone on.

        Returns
        -------
        BlochMode
            With ``plot`` and ``save`` as other results have them.

        Raises
        ------
        InputError
            If there is no such pair, or waves were not kept.
        """
        n, count = self.omega.shape
        point, band = as_whole("point", point, 0, n - 1), as_whole("band", band, 0, count - 1)
        if self._vectors is None:
            raise InputError("waves were not kept: give bloch(..., modes=True); voxels keep none")
        v = self._vectors[point][:, band].reshape(-1, 3)
        both = np.concatenate([v.real, v.imag], axis=1)
        f = self.fractions[point]  # waves are those of the first zone, see `Path.reduced`
        zone = (f - np.rint(f)) @ reciprocal(self._problem.edges).T
        return BlochMode(self._problem, both, zone, float(self.omega[point, band]), float(phase))

    # ---------------------------------------------------------------- files

    def plot(self, *, normalised: bool = True) -> "Figure":
        """Draw all bands over the path, with complete gaps shaded.

        Parameters
        ----------
        normalised : bool, keyword-only
            Whether frequencies are those of `normalised`.

        Returns
        -------
        matplotlib.figure.Figure
            ``savefig`` writes it.
        """
        from matplotlib.figure import Figure

        factor = self.size / (2.0 * np.pi * self.speed) if normalised else 1.0
        figure = Figure(figsize=(5.2, 4.2), layout="constrained")
        axes = figure.subplots()
        for gap in self.gaps:
            axes.axhspan(factor * gap.lower, factor * gap.upper, color="0.85", lw=0)
        axes.plot(self.distance, factor * self.omega, color="tab:blue", lw=1.2, marker=".", ms=3)
        ticks = self.distance[self.corners]
        axes.set_xticks(ticks, ["Γ" if name == "G" else name for name in self.labels])
        for x in ticks:
            axes.axvline(x, color="0.6", lw=0.6)
        axes.set_xlim(ticks[0], ticks[-1] if ticks[-1] > ticks[0] else ticks[0] + 1.0)
        axes.set_ylim(0.0, None)
        axes.set_ylabel("frequency  ω a / (2π c_T)" if normalised else "angular frequency ω")
        return figure

    def save(self, path: str | PathLike[str]) -> None:
        """Write the bands as a table, or with all that is known of them.

        Parameters
        ----------
        path : path-like
            Ending in ``.csv`` or ``.json``.

        Raises
        ------
        FormatError
            If it has another ending, or the file cannot be written.
        """
        ending = PurePath(as_path("path", path)).suffix.lower()
        if ending == ".json":
            write_report(path, self.as_dict())
        elif ending == ".csv":
            with atomic_write(path, text=True) as file:
                csv.writer(file, lineterminator="\n").writerows(self._rows())
        else:
            raise FormatError(f"{path!s:.80}: bands are written as .csv or .json")

    def as_dict(self) -> dict[str, Any]:
        """All numbers in a form that JSON takes.

        Returns
        -------
        dict of str to object
            By name.
        """
        report = {**vars(self.report), "steps": self.report.steps.tolist()}
        out: dict[str, Any] = {
            name: getattr(self, name).tolist()
            for name in ("k", "fractions", "corners", "omega", "velocities", "residuals", "errors")
        }
        out |= {"labels": list(self.labels), "size": self.size, "speed": self.speed}
        out["gaps"] = [vars(gap) for gap in self.gaps]
        found = self.directional_gaps
        out["directional_gaps"] = {name: [vars(gap) for gap in gaps] for name, gaps in found}
        return finite({**out, "report": report})

    def _rows(self) -> list[list[str]]:
        """A line per wave vector."""
        names = {int(c): name for c, name in zip(self.corners, self.labels, strict=True)}
        count = self.omega.shape[1]
        rows = [["label", "distance", "kx", "ky", "kz", *(f"omega{n + 1}" for n in range(count))]]
        for i, (d, k, omega) in enumerate(zip(self.distance, self.k, self.omega, strict=True)):
            rows.append([names.get(i, ""), *(repr(float(v)) for v in (d, *k, *omega))])
        return rows
