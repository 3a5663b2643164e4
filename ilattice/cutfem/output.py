"""Results as meshes, pictures and files; series of them as one file for ParaView.

What is shown of a solid: the surface mesh of its wall; the solid itself, cut out of the cells as
tetrahedra; or the active cells whole, as Lagrange hexahedra of the degree of the splines, in which
fields and level sets are polynomials like those of the splines.

Guarantees: fields are evaluated at every vertex, not interpolated; displacements and temperatures
in Lagrange cells are those of the splines everywhere; files are written as a whole or not at all,
the one of a series last. Non-guarantee: on the surface of a mesh, which lies off the level sets of
the splines by the error of both, fields are continued from the nearest cell.
"""

import math
from collections.abc import Mapping, Sequence
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar, NamedTuple, TypeVar, overload

import numpy as np

from ilattice._progress import Progress, track
from ilattice._typing import AnyArray, ArrayLike, FloatArray, IntArray
from ilattice._validate import (
    FrozenCopies,
    among,
    as_array,
    as_index,
    as_positive,
    as_whole,
    read_only,
)
from ilattice.cutfem.probe import Probe, along, probe
from ilattice.errors import FormatError, InputError
from ilattice.mesh import SurfaceMesh
from ilattice.mesh.wall_mesh import parameters_of, wall_mesh, warn_full
from ilattice.plot import Panels, Scene, animate, show
from ilattice.plot.animation import film_of
from ilattice.plot.cards import card
from ilattice.plot.quick import split
from ilattice.quadrature.clipping import MOST, clipped, lattice, smooth

if TYPE_CHECKING:
    import pyvista

    from ilattice.cutfem.page import Report
    from ilattice.cutfem.problem import Problem
    from ilattice.linalg.solvers import SolveReport

#: VTK's numbers.
TRIANGLE, TETRAHEDRON, HEXAHEDRON, LAGRANGE_HEXAHEDRON = 5, 10, 12, 72
CORNERS = ((0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0), (0, 0, 1), (1, 0, 1), (1, 1, 1), (0, 1, 1))
WAYS = ("auto", "surface", "solid", "cells")
#: Largest displacement of pictures with scale="auto", in lengths of the solid.
AUTO = 0.1


class Shape(NamedTuple):
    """What is shown of a solid, before fields are on it.

    Attributes
    ----------
    u, x : ndarray, shape (n, 3)
        Vertices, in parameters and in space.
    cells : ndarray, shape (e, c)
        Vertices of cells.
    kind : int
        VTK's number of the kind of cells.
    data : dict of str to ndarray
        What is known at the vertices without a result.
    """

    u: FloatArray
    x: FloatArray
    cells: IntArray
    kind: int
    data: dict[str, AnyArray]


class Result(FrozenCopies):
    """What results have in common: surfaces, pictures and files."""

    problem: "Problem"
    coefficients: FloatArray
    shown: ClassVar[str]  #: the field that gives pictures their colours
    probed: ClassVar[tuple[str, ...]] = ()  #: functions of parameters, besides `point_data`

    def __post_init__(self) -> None:
        """Show the coefficients, and arrays that are like them, read-only."""
        for name, value in vars(self).items():
            if isinstance(value, np.ndarray):
                object.__setattr__(self, name, read_only(value.view()))

    def point_data(self, u: Any) -> dict[str, AnyArray]:
        """What files hold, at parameters.

        Parameters
        ----------
        u : array_like, shape (n, 3)
            Parameters.

        Returns
        -------
        dict of str to ndarray
            Fields by name.
        """
        raise NotImplementedError

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

        from ilattice.io.vtk import name_components

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

    def _on(self, shape: Shape, scale: float | str) -> tuple[FloatArray, dict[str, AnyArray]]:
        """Vertices, moved, and all data."""
        data = self.point_data(shape.u)
        return moved(shape.x, data, scale), {**shape.data, **data}

    def _write(
        self, path: "str | PathLike[str]", shape: Shape, scale: float | str,
        cell_data: Mapping[str, AnyArray] | None = None,
    ) -> None:  # fmt: skip
        from ilattice.io.vtk import write_vtu

        points, data = self._on(shape, scale)
        write_vtu(
            path, points, shape.cells, shape.kind, point_data=data, cell_data=cell_data,
            field_data=self.field_data(),
        )  # fmt: skip


R = TypeVar("R", bound=Result)


class Reported:
    """What is known of how a result was found."""

    solved: "SolveReport | None"

    @property
    def report(self) -> "Report | None":
        """How the system was solved, with an estimate of the error; None if nothing was free.

        It is a function, too: ``solution.report("part.html")`` writes a page about the analysis.
        """
        from ilattice.cutfem.page import report_of

        return report_of(self, self.solved)


class Series(FrozenCopies, Sequence[R]):
    """Results one after the other: a sequence that is one file for ParaView."""

    @property
    def times(self) -> FloatArray:
        """Where the results are on the time line of a viewer, shape (len,)."""
        return np.arange(len(self), dtype=np.float64)

    def _result(self, number: int) -> R:
        raise NotImplementedError

    @overload
    def __getitem__(self, index: int) -> R: ...
    @overload
    def __getitem__(self, index: slice) -> tuple[R, ...]: ...
    def __getitem__(self, index: int | slice) -> R | tuple[R, ...]:
        if isinstance(index, slice):
            return tuple(self._result(k) for k in range(len(self))[index])
        return self._result(range(len(self))[as_index("index", index)])

    def plot(
        self, *, most: int = 6, on: str = "auto", h: float | None = None,
        scale: float | str = "auto", screenshot: "str | PathLike[str] | None" = None,
        **options: Any,
    ) -> Any:  # fmt: skip
        """Show several results side by side, in one scale of colours.

        Parameters
        ----------
        most : int
            How many, evenly from the first to the last.
        on, h, scale : str, float
            As in `Result.plot`.
        screenshot : path-like, optional
            File for the picture, which is not shown then.
        **options
            Of `ilattice.plot.Scene` and its `add`, and ``size``, that of the whole picture.

        Returns
        -------
        object
            What pyvista returns, None for a file.
        """
        count = min(as_whole("most", most, 1, 99), len(self))
        which = np.unique(np.linspace(0, len(self) - 1, count).round().astype(int)).tolist()
        of_scene, of_layer, of_show = split(options)
        size = of_scene.pop("size", None)
        scenes = self._scenes(which, of_scene, of_layer, on=on, h=h, scale=scale)
        panels = Panels(tuple(scenes), columns=min(3, len(scenes)), size=size)
        return panels.show(**of_show) if screenshot is None else panels.save(screenshot)

    def animate(
        self, path: "str | PathLike[str]", *, on: str = "auto", h: float | None = None,
        scale: float | str = "auto", fps: float = 12.0, progress: Progress = None,
        **options: Any,
    ) -> None:  # fmt: skip
        """Write a film of the results, one picture each, in one scale of colours.

        Parameters
        ----------
        path : path-like
            Ending in .gif, or .mp4; see `ilattice.plot.animate`.
        on, h, scale : str, float
            As in `Result.plot`.
        fps : float
            Pictures per second.
        progress : bool or callable, optional
            See `ilattice._progress.track`.
        **options
            Of `ilattice.plot.Scene` and its `add`.
        """
        film_of(path)
        of_scene, of_layer, _ = split(options)
        of_scene = {"size": (800, 600), **of_scene}
        which = list(range(len(self)))
        scenes = self._scenes(which, of_scene, of_layer, on=on, h=h, scale=scale)
        animate(scenes, path, fps=fps, progress=progress)

    def _scenes(
        self, which: Sequence[int], of_scene: Mapping[str, Any], of_layer: Mapping[str, Any],
        **how: Any,
    ) -> list[Scene]:  # fmt: skip
        """Some of the results, in one scale of colours."""
        grids = [self[k].to_pyvista(how["on"], h=how["h"], scale=how["scale"]) for k in which]
        of_layer = {"scalars": self[0].shown, **of_layer}
        shown = [np.asarray(grid[of_layer["scalars"]], float) for grid in grids]
        sizes = [np.linalg.norm(a, axis=1) if a.ndim == 2 else a for a in shown]
        limits = (min(np.nanmin(a) for a in sizes), max(np.nanmax(a) for a in sizes))
        return [
            Scene(**{"title": self[k]._title(), **of_scene}).add(
                grid, **{"clim": limits, **of_layer}
            )
            for k, grid in zip(which, grids, strict=True)
        ]

    def save(
        self, path: "str | PathLike[str]", *, on: str = "auto", h: float | None = None,
        scale: float | str = 0.0, progress: Progress = None,
    ) -> None:  # fmt: skip
        """Write a PVD file for ParaView, and a VTU file per result in a folder beside it.

        Parameters
        ----------
        path : path-like
            File ending in ``.pvd``; those of ``modes.pvd`` are ``modes/modes_0000.vtu``, ...
        on, h : str, float
            As in `Solution.to_pyvista`; the mesh is made once.
        scale : float or "auto"
            As in `Solution.surface`.
        progress : bool or callable, optional
            See `ilattice._progress.track`.

        Raises
        ------
        InputError
            If an argument is wrong.
        FormatError
            Another ending, or a file cannot be written.
        """
        from ilattice.io.vtk import write_pvd

        if not isinstance(path, (str, PathLike)):
            raise InputError(f"path must be a file name, got {path!r:.80}")
        target = Path(path)
        if target.suffix != ".pvd":
            raise FormatError(f"{str(path)!r}: series are written as .pvd")
        shape, folder = shape_of(self[0].problem, on, h), target.with_suffix("")
        files = [folder / f"{target.stem}_{k:04d}.vtu" for k in range(len(self))]
        try:
            folder.mkdir(exist_ok=True)
        except OSError as e:
            raise FormatError(f"{str(folder)!r}: cannot be made: {e.strerror}") from e
        for k, file in track(enumerate(files), "save", progress, total=len(files)):
            self[k]._write(file, shape, scale)
        write_pvd(path, files, self.times)


# --- shapes -----------------------------------------------------------------------------------


def shape_of(problem: "Problem", on: str, h: float | None) -> Shape:
    """What is shown of a solid; see `Result.to_pyvista`."""
    if not among(on, WAYS):
        raise InputError(f"on must be one of {', '.join(map(repr, WAYS))}, got {on!r}")
    if on == "auto":
        on = "solid" if problem.domain.wall is None else "surface"
    if on == "surface":
        mesh = surface_of(problem, h)
        u = parameters_of(mesh)[0]
        return Shape(u, mesh.vertices, mesh.faces, TRIANGLE, dict(mesh.point_data))
    return _solid(problem, h) if on == "solid" else _cells(problem)


def surface_of(problem: "Problem", h: float | None) -> SurfaceMesh:
    """The mesh of the wall of a problem, without the parts that were left out."""
    wall = problem.domain.wall
    if wall is None:
        raise InputError("only walls have a surface mesh; on='solid' and on='cells' are for all")
    h = None if h is None else as_positive("h", h)
    warn_full(wall)
    mesh = wall_mesh(wall, h, polish=False, caps=True, dtype=np.float64, progress=None)
    near = problem.assembly.space.locate(parameters_of(mesh)[0]) >= 0
    return mesh if near.all() else mesh.select(near[mesh.faces].all(axis=1))


def _solid(problem: "Problem", h: float | None) -> Shape:
    asm, cut = problem.assembly, problem.domain.cut
    n = (asm.space.degree,) * 3
    if h is None:
        rule = problem.domain.volume
        own = rule.integrate_cells()[np.isin(rule.cells, asm.space.cells)].sum()
        u, cells = smooth(cut.grid, asm.space.homes[0], n, cut.sets, float(own))
    else:
        middle = asm.space.boxes[:, :3] + 0.5 * asm.space.boxes[:, 3:]
        edges = np.linalg.norm(asm.jacobians(middle), axis=1) * asm.space.boxes[:, 3:]
        least = as_positive("h", h)
        longest = np.minimum(edges.max(axis=0), MOST * least)  # so that more of them are refused
        i, j, k = (max(math.ceil(e / least), 1) for e in longest)
        u, cells = clipped(cut.grid, asm.space.homes[0], (i, j, k), cut.sets)
    return Shape(u, asm.x(u), cells, TETRAHEDRON, {})


def _cells(problem: "Problem") -> Shape:
    from ilattice.io.bezier_cells import vtk_order

    asm, cut = problem.assembly, problem.domain.cut
    p = asm.space.degree
    steps = np.array(CORNERS)
    if p > 1:
        steps = np.stack(np.unravel_index(np.argsort(vtk_order(p, p, p).ravel()), (p + 1,) * 3), 1)
    u, cells = lattice(cut.grid, asm.space.homes[0], (p, p, p), steps)
    kind = HEXAHEDRON if p == 1 else LAGRANGE_HEXAHEDRON
    return Shape(u, asm.x(u), cells, kind, {"level_set": cut.sets(u).max(axis=1)})


def moved(x: FloatArray, data: Mapping[str, AnyArray], scale: float | str) -> FloatArray:
    """Points with a factor of the displacement, if there is one, added."""
    if "displacement" not in data:
        return x
    d = np.where(np.isfinite(data["displacement"]), data["displacement"], 0.0)
    if isinstance(scale, str) and scale == "auto":
        far = np.linalg.norm(d, axis=1).max(initial=0.0)
        scale = float(AUTO * np.ptp(x, axis=0).max() / far) if far > 0 else 0.0
    if isinstance(scale, str) or as_array("scale", scale).size != 1:
        raise InputError(f"scale must be a number or 'auto', got {scale!r}")
    return x + float(scale) * d


# --- files ------------------------------------------------------------------------------------


def save_cells(
    result: Result, path: "str | PathLike[str]", scale: float | str,
    cell_data: Mapping[str, AnyArray] | None = None,
) -> None:  # fmt: skip
    """Write the active cells with fields and level sets at their nodes, and data of cells."""
    result._write(as_vtu(path), _cells(result.problem), scale, cell_data)


def as_vtu(path: "str | PathLike[str]") -> "str | PathLike[str]":
    """A path that ends in .vtu, or `FormatError`."""
    if not str(path).endswith(".vtu"):
        raise FormatError(
            f"{str(path)!r}: results are written as .vtu, on the surface of a wall as .vtp too"
        )
    return path
