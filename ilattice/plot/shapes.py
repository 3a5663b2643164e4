"""Arrays as datasets that a `Scene` can draw: level sets, lines, triangles, boxes, sections.

For pictures only: level sets are as coarse as the numbers given. Surfaces to print or to measure
come from `ilattice.mesh`.
"""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from ilattice._typing import AnyArray, ArrayLike, FloatArray, IntArray


def isosurface(values: AnyArray, axes: Sequence[FloatArray], *, solid: bool = False) -> Any:
    """The surface on which numbers on a grid vanish.

    Parameters
    ----------
    values : ndarray, shape (n_0, n_1, n_2)
        At the points of the grid, negative inside.
    axes : sequence of ndarray, shape (n_i,)
        Equidistant coordinates.
    solid : bool
        Close what is inside at the sides of the grid.

    Returns
    -------
    pyvista.PolyData
        Triangles.
    """
    import pyvista as pv

    spacing = [(a[-1] - a[0]) / (len(a) - 1) for a in axes]
    origin = [a[0] for a in axes]
    shown = np.asarray(values, float)
    if solid:
        big = float(np.abs(shown).max()) or 1.0
        shown = np.pad(shown, 1, constant_values=1e3 * big)
        origin = [o - s for o, s in zip(origin, spacing, strict=True)]
    image = pv.ImageData(dimensions=shown.shape, spacing=spacing, origin=origin)
    image.point_data["f"] = shown.ravel(order="F")
    return image.contour([0.0], scalars="f", compute_normals=False).clean()


def section(values: AnyArray, axes: Sequence[FloatArray], name: str = "value") -> Any:
    """Numbers on a grid of one or more layers of points, to be drawn as they are.

    Parameters
    ----------
    values : ndarray, shape (n_0, n_1, n_2)
        At the points of the grid; one or more of the lengths may be 1.
    axes : sequence of ndarray, shape (n_i,)
        Coordinates.
    name : str
        Of the point data.

    Returns
    -------
    pyvista.StructuredGrid
        With the numbers.
    """
    import pyvista as pv

    grid = pv.RectilinearGrid(*axes).cast_to_structured_grid()
    grid.point_data[name] = np.asarray(values).ravel(order="F")
    return grid


def polylines(lines: Sequence[FloatArray], *, closed: bool = False) -> Any:
    """Lines through points.

    Parameters
    ----------
    lines : sequence of ndarray, shape (n, 3)
        Points of each.
    closed : bool
        Whether the last point is joined to the first.

    Returns
    -------
    pyvista.PolyData
        One cell for each.
    """
    import pyvista as pv

    rows, start = [], 0
    for line in lines:
        numbers = np.arange(start, start + len(line))
        numbers = np.append(numbers, start) if closed else numbers
        rows.append(np.concatenate([[len(numbers)], numbers]))
        start += len(line)
    return pv.PolyData(np.vstack(lines).astype(float), lines=np.concatenate(rows))


def segments(points: ArrayLike, pairs: IntArray) -> Any:
    """Straight lines between points.

    Parameters
    ----------
    points : array_like, shape (n, 3)
        Their ends.
    pairs : ndarray of int, shape (m, 2)
        Which ends belong together.

    Returns
    -------
    pyvista.PolyData
        One cell for each.
    """
    import pyvista as pv

    rows = np.column_stack([np.full(len(pairs), 2), pairs])
    return pv.PolyData(np.asarray(points, float), lines=rows.ravel())


def triangles(
    points: AnyArray,
    corners: AnyArray,
    point_data: Mapping[str, AnyArray],
    cell_data: Mapping[str, AnyArray],
) -> Any:
    """Triangles with named data.

    Parameters
    ----------
    points : ndarray, shape (n, 3)
        Their corners.
    corners : ndarray of int, shape (m, 3)
        Which corners belong together.
    point_data, cell_data : mapping of str to ndarray
        Data of corners and of triangles.

    Returns
    -------
    pyvista.PolyData
        Copies of all.
    """
    import pyvista as pv

    out = pv.PolyData.from_regular_faces(np.array(points), np.array(corners))
    for name, array in point_data.items():
        out.point_data[name] = np.array(array)
    for name, array in cell_data.items():
        out.cell_data[name] = np.array(array)
    return out


def hexahedra(points: FloatArray, wanted: AnyArray | None = None) -> Any:
    """Cells of a curved grid.

    Parameters
    ----------
    points : ndarray, shape (n_0 + 1, n_1 + 1, n_2 + 1, 3)
        Corners of the cells.
    wanted : ndarray of bool, shape (n_0, n_1, n_2), optional
        Which of them; by default all.

    Returns
    -------
    pyvista.UnstructuredGrid or pyvista.StructuredGrid
        The cells.
    """
    import pyvista as pv

    grid = pv.StructuredGrid(*np.moveaxis(points, -1, 0))
    if wanted is None:
        return grid
    return grid.extract_cells(np.flatnonzero(np.asarray(wanted).ravel(order="F")))


def frame(edges: ArrayLike, origin: ArrayLike = (0.0, 0.0, 0.0)) -> Any:
    """The twelve edges of a parallelepiped.

    Parameters
    ----------
    edges : array_like, shape (3, 3)
        Its edges as columns.
    origin : array_like, shape (3,)
        Its corner.

    Returns
    -------
    pyvista.PolyData
        Lines.
    """
    corners = np.array(list(np.ndindex(2, 2, 2)))
    near = np.abs(corners[:, None] - corners).sum(axis=2) == 1
    points = corners @ np.asarray(edges, float).T + np.asarray(origin, float)
    return segments(points, np.argwhere(np.triu(near)))
