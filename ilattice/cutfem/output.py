"""Solutions as meshes and files.

Guarantee: files are written as a whole or not at all; `io` gets points, cells and named arrays.
Non-guarantee: on the surface of a mesh, which lies off the level sets of the splines by the error
of both, fields are continued from the nearest cell.
"""

from typing import TYPE_CHECKING

import numpy as np

from ilattice._typing import AnyArray, FloatArray
from ilattice.errors import FormatError, InputError
from ilattice.mesh import SurfaceMesh
from ilattice.offsets.wall import parameters_of

if TYPE_CHECKING:
    from os import PathLike

    from ilattice.cutfem.heat import HeatSolution
    from ilattice.cutfem.solution import Solution

HEXAHEDRON, TRIANGLE = 12, 5
CORNERS = ((0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0), (0, 0, 1), (1, 0, 1), (1, 1, 1), (0, 1, 1))


def surface_of(solution: "Solution | HeatSolution", h: float | None, scale: float) -> SurfaceMesh:
    """See `Solution.surface`."""
    wall = solution.problem.domain.wall
    if wall is None:
        raise InputError("only walls have a surface mesh; save(path, on='cells') writes cells")
    mesh = wall.mesh(h, polish=False)
    u = parameters_of(mesh)[0]
    data = solution.point_data(u)
    good = np.asarray(np.isfinite(next(iter(data.values())).reshape(len(u), -1)).all(axis=1))
    vertices = mesh.vertices + scale * np.where(good[:, None], data.get("displacement", 0.0), 0.0)
    named = {**mesh.point_data, **data}
    moved = SurfaceMesh(vertices, mesh.faces, point_data=named, cell_data=mesh.cell_data)
    return moved if good.all() else moved.select(good[mesh.faces].all(axis=1))


def cells_of(
    solution: "Solution | HeatSolution", scale: float
) -> tuple[FloatArray, AnyArray, dict[str, AnyArray]]:
    """Corners of the active cells, the cells, and fields with the level sets at the corners."""
    asm, cut = solution.problem.assembly, solution.problem.domain.cut
    shape = tuple(n + 1 for n in cut.grid.shape)
    at = asm.space.places[:, None, :] + np.array(CORNERS)
    used, cells = np.unique(np.ravel_multi_index(tuple(np.moveaxis(at, 2, 0)), shape),
                            return_inverse=True)  # fmt: skip
    index = np.unravel_index(used, shape)
    u = np.stack([x[i] for x, i in zip(cut.grid.axes, index, strict=True)], axis=1)
    data = solution.point_data(u)
    data["level_set"] = cut.sets(u).max(axis=1)
    return asm.x(u) + scale * data.get("displacement", 0.0), cells.reshape(-1, 8), data


def save(
    solution: "Solution | HeatSolution",
    path: "str | PathLike[str]",
    on: str,
    h: float | None,
    scale: float,
) -> None:
    """See `Solution.save`."""
    if on not in ("auto", "surface", "cells"):
        raise InputError(f"on must be 'auto', 'surface' or 'cells', got {on!r}")
    from ilattice.io.vtk import write_vtu

    if not str(path).endswith(".vtu"):
        raise FormatError(f"{str(path)!r}: solutions are written as .vtu")
    if on == "surface" or (on == "auto" and solution.problem.domain.wall is not None):
        mesh = surface_of(solution, h, scale)
        write_vtu(path, mesh.vertices, mesh.faces, TRIANGLE, point_data=mesh.point_data)
        return
    points, cells, data = cells_of(solution, scale)
    write_vtu(path, points, cells, HEXAHEDRON, point_data=data)
