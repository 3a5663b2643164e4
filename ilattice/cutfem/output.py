"""Results as meshes, pictures and files.

Guarantees: fields are evaluated at every vertex, not interpolated; displacements and temperatures
in Lagrange cells are those of the splines everywhere; files are written as a whole or not at all.
Non-guarantee: on the surface of a mesh, which lies off the level sets of the splines by the error
of both, fields are continued from the nearest cell.
"""

from collections.abc import Mapping
from os import PathLike
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np

from ilattice._typing import AnyArray, ArrayLike, FloatArray, IntArray
from ilattice._validate import FrozenCopies, as_points, read_only
from ilattice.cutfem.pointwise import Pointwise
from ilattice.cutfem.probe import Probe, along, probe
from ilattice.cutfem.shapes import Shape, cells_of, moved, shape_of, surface_of
from ilattice.errors import FormatError
from ilattice.io.vtk import name_components, write_vtu
from ilattice.mesh import SurfaceMesh
from ilattice.mesh.wall_mesh import parameters_of
from ilattice.plot import show
from ilattice.plot.cards import card

if TYPE_CHECKING:
    import pyvista


class Result(FrozenCopies):
    """What results have in common: surfaces, pictures and files."""

    problem: Pointwise
    coefficients: FloatArray
    shown: ClassVar[str]  #: the field that gives pictures their colours
    #: fields in files: their names, and those of the functions of parameters that they are
    written: ClassVar[tuple[tuple[str, str], ...]] = ()
    probed: ClassVar[tuple[str, ...]] = ()  #: functions of parameters, besides `point_data`

    def __post_init__(self) -> None:
        """Show the coefficients, and arrays that are like them, read-only."""
        for name, value in vars(self).items():
            if isinstance(value, np.ndarray):
                object.__setattr__(self, name, read_only(value.view()))

    def evaluate(self, u: ArrayLike) -> FloatArray:
        """The unknown at parameters: a displacement, a temperature, or that of another law.

        Parameters
        ----------
        u : array_like, shape (n, 3)
            Parameters.

        Returns
        -------
        ndarray, shape (n, m), or (n,) of one unknown
            The field; NaN more than a cell away from the solid.
        """
        value = self._fields(u)[0]
        return value[:, 0] if value.shape[1] == 1 else value

    def point_data(self, u: ArrayLike) -> dict[str, AnyArray]:
        """What files hold, at parameters.

        Parameters
        ----------
        u : array_like, shape (n, 3)
            Parameters.

        Returns
        -------
        dict of str to ndarray
            Fields by name, those of `written`.
        """
        return {name: getattr(self, function)(u) for name, function in self.written}

    def field_data(self) -> dict[str, float]:
        """Numbers that files hold about the whole.

        Returns
        -------
        dict of str to float
            By name.
        """
        return {}

    def at(self, x: ArrayLike, *, outside: str = "raise") -> Probe:
        """The result at points of space.

        Parameters
        ----------
        x : array_like, shape (n, 3)
            Points of space, in the solid. Points that lie off it by less than a tenth of a cell,
            as the vertices of meshes do, count as inside.
        outside : {"raise", "nan"}
            What is done with points elsewhere: an error, or NaN in all fields.

        Returns
        -------
        Probe
            Points, their parameters, and the fields there as attributes, such as ``.stress``.

        Raises
        ------
        InputError
            If points are outside of the solid; the message names the first ones.

        Examples
        --------
        >>> import ilattice as il
        >>> rod = lambda u: (u[:, :2] ** 2).sum(axis=1) - 0.25
        >>> problem = il.cutfem.Elasticity(rod, 4, domain=[[-0.6, -0.6, 0], [0.6, 0.6, 4]])
        >>> solution = problem.clamp("w=0").load(traction=(0, 0, 1.0), on="w=1").solve()
        >>> solution.at([[0.1, 0.2, 2.0]]).displacement.shape
        (1, 3)
        """
        return probe(self, x, outside)

    def along(self, start: ArrayLike, end: ArrayLike, n: int = 200) -> Probe:
        """The result along a straight line, NaN where it is out of the solid.

        Parameters
        ----------
        start, end : array_like, shape (3,)
            Points of space.
        n : int
            How many points there are on the line.

        Returns
        -------
        Probe
            As `at`; ``.plot("stress")`` draws it over its ``.distance``.

        Raises
        ------
        InputError
            If the points are equal, or no point is in the solid.
        """
        return along(self, start, end, n)

    def surface(self, h: float | None = None, *, scale: float | str = 0.0) -> SurfaceMesh:
        """The mesh of the wall with the fields of the result.

        Parameters
        ----------
        h : float, optional
            Length of edges, as in `Wall.mesh`.
        scale : float or "auto"
            Factor of the displacement, if there is one, that is added to the vertices; 0 leaves
            the shape, ``"auto"`` moves them by a tenth of the size of the solid.

        Returns
        -------
        SurfaceMesh
            With what `point_data` has; parts that were left out are left out.

        Raises
        ------
        InputError
            If the solid is no wall.
        """
        mesh = surface_of(self.problem, h)
        data = self.point_data(parameters_of(mesh)[0])
        vertices = moved(mesh.vertices, data, scale)
        named = {**mesh.point_data, **data}
        return SurfaceMesh(vertices, mesh.faces, point_data=named, cell_data=mesh.cell_data)

    def to_pyvista(
        self, on: str = "auto", *, h: float | None = None, scale: float | str = 0.0
    ) -> "pyvista.UnstructuredGrid":
        """The surface, the solid or the cells with all fields, for pyvista and its filters.

        Parameters
        ----------
        on : {"auto", "surface", "solid", "cells"}
            The surface of the wall; the solid, as tetrahedra; or the active cells, whole, with the
            level sets. By default the surface if there is a wall, else the solid.
        h : float, optional
            Length of edges: of the surface as in `Wall.mesh`, of the solid before it is cut. By
            default cells are divided by their degree, and further where parts are so thin that
            the volume of the picture would be off by more than half a per cent.
        scale : float or "auto"
            As in `surface`.

        Returns
        -------
        pyvista.UnstructuredGrid
            With point data and field data.

        Raises
        ------
        InputError
            If an argument is wrong, or the solid is no wall and its surface is wanted.
        """
        import pyvista as pv

        shape = shape_of(self.problem, on, h)
        points, data = self._on(shape, scale)
        sizes = np.full(len(shape.cells), shape.cells.shape[1])
        kinds = np.full(len(shape.cells), shape.kind, np.uint8)
        grid = pv.UnstructuredGrid(np.column_stack([sizes, shape.cells]).ravel(), kinds, points)
        for name, values in data.items():
            grid.point_data[name] = values
            name_components(grid.GetPointData().GetAbstractArray(name))
        for name, number in self.field_data().items():
            grid.field_data[name] = [number]
        return grid

    def plot(
        self, *, on: str = "auto", h: float | None = None, scale: float | str = "auto",
        **options: Any,
    ) -> Any:  # fmt: skip
        """Show the deformed solid, with colours by its main field.

        Parameters
        ----------
        on, h : str, float
            As in `to_pyvista`.
        scale : float or "auto"
            As in `surface`.
        **options
            Of `ilattice.plot.show`, such as ``scalars``, ``unit``, ``clip`` or ``screenshot``.

        Returns
        -------
        object
            What pyvista returns.
        """
        grid = self.to_pyvista(on, h=h, scale=scale)
        return show(grid, **{"scalars": self.shown, "title": self._title(), **options})

    def _repr_html_(self) -> str:
        report = getattr(self, "report", None)  # steps in time have none
        numbers: dict[str, Any] = {"functions": len(self.coefficients), **self.field_data()}
        if report is not None:
            numbers["estimated error of the energy"] = f"{100 * report.discretization_error:.2g} %"
        return card(self, numbers, on="solid", label="")

    def _title(self) -> str:
        """Text above pictures: the numbers about the whole."""
        return ", ".join(f"{name} {number:.4g}" for name, number in self.field_data().items())

    def save(
        self, path: "str | PathLike[str]", *, on: str = "auto", h: float | None = None,
        scale: float | str = 0.0,
    ) -> None:  # fmt: skip
        """Write a VTU file, or the surface of a wall as VTP.

        Stresses have named components, XX to XY, in ParaView.

        Parameters
        ----------
        path : path-like
            File ending in ``.vtu``, or in ``.vtp`` for the surface.
        on, h : str, float
            As in `to_pyvista`. In ParaView "Clip" with the scalars ``level_set`` cuts the solid out
            of cells.
        scale : float or "auto"
            As in `surface`.

        Raises
        ------
        InputError
            If an argument is wrong.
        FormatError
            Another ending, or the file cannot be written.
        """
        if str(path).endswith(".vtp") and on in ("auto", "surface"):
            self.surface(h, scale=scale).save(path)
            return
        self._write(as_vtu(path), shape_of(self.problem, on, h), scale)

    def _fields(self, u: ArrayLike) -> tuple[FloatArray, FloatArray]:
        """Values (n, m) and gradients in space (n, m, 3) at parameters."""
        return self.problem.assembly.evaluate(self.coefficients, as_points("u", u))

    def _flux(self, gradient: FloatArray, u: FloatArray, owner: IntArray) -> FloatArray:
        """Flux (n, entries) of gradients at parameters in active cells."""
        return self.problem._flux(gradient, u, owner)

    def _flux_at(self, u: FloatArray) -> FloatArray:
        """Flux (n, entries) at parameters; NaN more than a cell away from the solid."""
        return self._flux(self._fields(u)[1], u, self.problem.assembly.space.locate(u))

    def _on(self, shape: Shape, scale: float | str) -> tuple[FloatArray, dict[str, AnyArray]]:
        """Vertices, moved, and all data."""
        data = self.point_data(shape.u)
        return moved(shape.x, data, scale), {**shape.data, **data}

    def _write(
        self, path: "str | PathLike[str]", shape: Shape, scale: float | str,
        cell_data: Mapping[str, AnyArray] | None = None,
    ) -> None:  # fmt: skip
        points, data = self._on(shape, scale)
        write_vtu(
            path, points, shape.cells, shape.kind, point_data=data, cell_data=cell_data,
            field_data=self.field_data(),
        )  # fmt: skip


# --- files ------------------------------------------------------------------------------------


def save_cells(
    result: Result, path: "str | PathLike[str]", scale: float | str,
    cell_data: Mapping[str, AnyArray] | None = None,
) -> None:  # fmt: skip
    """Write the active cells with fields and level sets at their nodes, and data of cells."""
    result._write(as_vtu(path), cells_of(result.problem), scale, cell_data)


def as_vtu(path: "str | PathLike[str]") -> "str | PathLike[str]":
    """A path that ends in .vtu, or `FormatError`."""
    if not str(path).endswith(".vtu"):
        raise FormatError(
            f"{str(path)!r}: results are written as .vtu, on the surface of a wall as .vtp too"
        )
    return path
