"""What effective properties of all kinds have in common: how they were found, files, pictures."""

import csv
from dataclasses import dataclass
from os import PathLike
from pathlib import PurePath
from typing import Any, ClassVar

import numpy as np

from ilattice._files import as_path, atomic_write, write_report
from ilattice._shown import Shown
from ilattice._typing import AnyArray, FloatArray
from ilattice._validate import Frozen, as_whole
from ilattice.errors import FormatError
from ilattice.homogenize.sphere import sphere
from ilattice.mesh import SurfaceMesh

#: Eigenvalues of a stiffness below this part of the largest one are those of mechanisms.
SOFT = 1e-9


@dataclass(frozen=True, eq=False)
class HomogenizationReport(Shown):
    """How effective properties were found.

    Attributes
    ----------
    route : {"cut cells", "voxels"}
        Of which cells the grid is.
    cells : tuple of 3 int
        How many per direction.
    unknowns : int
        Size of the system.
    iterations : int
        Steps of conjugate gradients of the load that took most.
    residual : float
        The largest relative residual.
    seconds : float
        Wall time of all systems.
    loads : int
        Number of loads that were solved from nothing, 0 to 6, or 7 where voxels expand.
    symmetry : float
        The largest relative residual of the others as they followed by symmetry, from which they
        were solved to the tolerance; NaN if there are none.
    """

    route: str
    cells: tuple[int, int, int]
    unknowns: int
    iterations: int
    residual: float
    seconds: float
    loads: int = 0
    symmetry: float = float("nan")


@dataclass(frozen=True, eq=False)
class Result(Frozen):
    """What effective properties of all kinds have."""

    density: float
    percolates: tuple[bool, bool, bool]
    report: HomogenizationReport
    #: its matrix, of which there are `errors`; what its surface shows, and the title of that
    matrix: ClassVar[str]
    quantity: ClassVar[str]
    title: ClassVar[str]

    @property
    def error(self) -> float:
        """Largest estimated error of a diagonal entry of the matrix, as a part of it.

        Entries are found too large, so that 0.8 says five times. NaN without an estimate.
        """
        values, errors = (np.diag(getattr(self, name)) for name in (self.matrix, "errors"))
        there = values > SOFT * values.max(initial=0.0)
        return float((errors[there] / values[there]).max(initial=0.0))

    def surface(self, level: int = 5) -> SurfaceMesh:
        """The property in all directions as a surface: its distance from the origin.

        Parameters
        ----------
        level : int
            How often the triangles of an icosahedron are halved, 0 to 7.

        Returns
        -------
        SurfaceMesh
            With the numbers of all directions as point data.
        """
        vertices, faces = sphere(as_whole("level", level, 0, 7))
        data = self._of_directions(vertices)
        radius = data[self.quantity]
        least = 1e-6 * max(float(radius.max()), 1e-300)  # triangles must not vanish
        return SurfaceMesh(vertices * np.maximum(radius, least)[:, None], faces, data)

    def _of_directions(self, n: FloatArray) -> dict[str, AnyArray]:
        raise NotImplementedError

    def plot(self, *, unit: str = "", **options: Any) -> Any:
        """Show `surface` in a window or a notebook.

        Parameters
        ----------
        unit : str, keyword-only
            Of the property, which is that of what was given, for the title of the colours.
        **options
            Of `ilattice.plot.show`, such as ``screenshot`` or ``view``.

        Returns
        -------
        object
            What pyvista returns.
        """
        usual = {"scalars": self.quantity, "axes": True, "label": self.title, "unit": unit}
        return self.surface().plot(**{**usual, **options})

    def save(self, path: str | PathLike[str]) -> None:
        """Write the surface of directions, or the numbers, as the ending of the file asks.

        Parameters
        ----------
        path : path-like
            Ending in ``.json``, ``.csv`` for the numbers, else a format of meshes such as ``.vtp``.

        Raises
        ------
        FormatError
            If the ending is unknown, or the file cannot be written.
        """
        ending = PurePath(as_path("path", path)).suffix.lower()
        if ending == ".json":
            write_report(path, self.as_dict())
        elif ending == ".csv":
            with atomic_write(path, text=True) as file:
                csv.writer(file, lineterminator="\n").writerows(self._rows())
        elif not ending:
            raise FormatError(f"{path!s:.80} has no ending: take .json, .csv or .vtp")
        else:
            self.surface().save(path)

    def as_dict(self) -> dict[str, Any]:
        """All numbers in a form that JSON takes.

        Returns
        -------
        dict of str to object
            By name.
        """
        raise NotImplementedError

    def _rows(self) -> list[list[Any]]:
        """Names and numbers, one per line."""
        rows: list[list[Any]] = [["name", "value"]]
        for name, value in self.as_dict().items():
            if isinstance(value, (int, float)):
                rows.append([name, repr(value)])
            elif isinstance(value, list) and isinstance(value[0], list):
                rows += _entries(name, value)
        return rows


def _entries(name: str, matrix: list[list[float]]) -> list[list[Any]]:
    """Entries of a matrix, one per line."""
    return [
        [f"{name}{i + 1}{j + 1}", repr(v)]
        for i, row in enumerate(matrix)
        for j, v in enumerate(row)
    ]


def told(bounds: Any) -> dict[str, Any]:
    """Bounds as lists."""
    return {k: np.asarray(v).tolist() for k, v in vars(bounds).items() if v is not None}


def finite(value: Any) -> Any:
    """Numbers that are not finite as None, which JSON has."""
    if isinstance(value, dict):
        return {k: finite(v) for k, v in value.items()}
    if isinstance(value, (list, tuple)):
        return [finite(v) for v in value]
    if isinstance(value, (float, np.floating)):
        return float(value) if np.isfinite(value) else None
    return value
