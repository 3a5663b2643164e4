"""VTK's XML formats for ParaView: VTP surfaces, VTU cells and Bezier volumes, grids, PVD series.

Guarantees: raw appended binary, little endian, readable by ParaView 5.9 and later; indices are
32-bit wherever they fit; Bezier volumes are exact, rational ones too, with degrees and weights
set as attributes. Arrays indexed [u, v, w] are turned to VTK's order (first index fastest) in one
place, `_by_points`. Not done: pieces for parallel readers.
"""

import errno
import os
import shutil
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any
from xml.sax.saxutils import quoteattr

import numpy as np

from ilattice._files import as_path, atomic_path
from ilattice._geometry import grid_array
from ilattice._typing import AnyArray, ArrayLike, Map
from ilattice._validate import as_array, as_choice, as_flag, as_items, as_points
from ilattice._vtk import quiet_vtk
from ilattice.errors import FormatError, InputError
from ilattice.io._kinds import kind_of
from ilattice.io._mesh import Triangles, check_mesh, colours
from ilattice.io.bezier_cells import bezier_nodes

#: Cell type of VTK.
_BEZIER_HEXAHEDRON = 79
#: Part of a step by which the spacing of an image may vary: files have one number per axis.
_SAME_STEP = 1e-9
#: Components of symmetric tensors in Voigt order: without names ParaView takes them for another.
VOIGT = ("XX", "YY", "ZZ", "YZ", "XZ", "XY")
TENSORS = ("stress", "strain")
#: Points of cells by VTK's number of their kind; None if that varies.
_CELLS: dict[int, int | None] = {
    1: 1, 2: None, 3: 2, 4: None, 5: 3, 6: None, 7: None, 8: 4, 9: 4, 10: 4, 11: 8, 12: 8, 13: 6,
    14: 5, 21: 3, 22: 6, 23: 8, 24: 10, 25: 20, 26: 15, 27: 13, 28: 9, 29: 27,
    **dict.fromkeys(range(68, 82)),
}  # fmt: skip
_ROOM = 1 << 20  # bytes that a disk lacks if it is full
#: Types in which numbers are written whose own types VTK does not have.
_KINDS: dict[str, np.dtype[Any]] = {"b1": np.dtype(np.uint8), "f2": np.dtype(np.float32)}


# --- surfaces ---------------------------------------------------------------------------------


def write_vtp(mesh: Triangles, path: str | os.PathLike[str], *, compress: bool = False) -> None:
    """Write a surface with all its data.

    Parameters
    ----------
    mesh : SurfaceMesh
        The mesh; ``r``, ``g``, ``b`` are written once more as the colour array ``RGB``.
    path : path-like
        File to create or to replace.
    compress : bool
        Compress with zlib: smaller, but several times slower.

    Raises
    ------
    GeometryError
        If the mesh is empty.
    FormatError
        If the file cannot be written.
    """
    from vtkmodules.vtkCommonDataModel import vtkPolyData

    check_mesh(mesh)
    surface = vtkPolyData()
    surface.SetPoints(_points(mesh.vertices))
    surface.SetPolys(_cells(mesh.faces, len(mesh.vertices)))
    point_data = dict(mesh.point_data)
    colour = colours(point_data)
    if colour is not None:
        point_data["RGB"] = colour
    _attach(surface.GetPointData(), point_data)
    _attach(surface.GetCellData(), mesh.cell_data)
    _write("vtkXMLPolyDataWriter", surface, path, compress)


# --- volumes ----------------------------------------------------------------------------------


def save_bezier_vtu(volume: Any, path: str | os.PathLike[str], *, compress: bool = False) -> None:
    """Write a spline volume as exact Bezier hexahedra, one per element.

    Parameters
    ----------
    volume : SplineMap
        The volume; further coordinates become point data in the same Bezier basis, under their
        names.
    path : path-like
        File to create or to replace.
    compress : bool
        Compress with zlib.

    Raises
    ------
    FormatError
        If a degree is 0, or the file cannot be written.

    Notes
    -----
    Rational volumes keep Cartesian control points and carry the point attribute
    ``RationalWeights``; the cell attribute ``HigherOrderDegrees`` allows different degrees per
    direction. In ParaView raise "Nonlinear Subdivision Level" to see the curvature.
    """
    if kind_of(volume) != "map":
        raise InputError(f"volume must be a SplineMap, got {volume!r:.80}")
    nodes = bezier_nodes(volume.spline.to_bezier())
    extra = nodes.values[:, 3:]
    names = list(volume.names) or [f"x{i + 3}" for i in range(extra.shape[1])]
    data = dict(zip(names, np.ascontiguousarray(extra.T), strict=True))
    grid = _unstructured(nodes.values[:, :3], nodes.cells, _BEZIER_HEXAHEDRON, data, {})
    degrees = np.tile(np.array(nodes.degrees, np.float64), (len(nodes.cells), 1))
    grid.GetCellData().SetHigherOrderDegrees(_array("HigherOrderDegrees", degrees))
    if nodes.weights is not None:
        grid.GetPointData().SetRationalWeights(_array("RationalWeights", nodes.weights))
    _write("vtkXMLUnstructuredGridWriter", grid, path, compress)


def write_vtu(
    path: str | os.PathLike[str],
    points: ArrayLike,
    cells: ArrayLike,
    cell_type: int,
    *,
    point_data: Mapping[str, ArrayLike] | None = None,
    cell_data: Mapping[str, ArrayLike] | None = None,
    field_data: Mapping[str, ArrayLike] | None = None,
    compress: bool = False,
) -> None:
    """Write cells of one kind with named data.

    Parameters
    ----------
    path : path-like
        File to create or to replace.
    points : (n, 3) array
        Points.
    cells : (e, c) array of integers
        Points of each cell, in VTK's order.
    cell_type : int
        VTK's number of the kind: 5 triangle, 9 quadrilateral, 10 tetrahedron, 12 hexahedron,
        72 Lagrange hexahedron, ...
    point_data : mapping of str to (n, ...) array, optional
        Data on the points; matrices are flattened to rows.
    cell_data : mapping of str to (e, ...) array, optional
        Data on the cells.
    field_data : mapping of str to float or array, optional
        Data about the whole, such as a frequency.
    compress : bool
        Compress with zlib.

    Raises
    ------
    InputError
        Wrong shapes, or cells that name points that do not exist.
    FormatError
        If the file cannot be written.
    """
    x = as_points("points", points)
    try:
        corners = np.asarray(cells)
    except ValueError as e:
        raise InputError(f"cells must be integers of shape (e, c), got {cells!r:.80}") from e
    if corners.ndim != 2 or corners.dtype.kind not in "iu":
        raise InputError(f"cells must be integers of shape (e, c), got shape {corners.shape}")
    if corners.size and not 0 <= corners.min() <= corners.max() < len(x):
        raise InputError(f"cells must name points below {len(x)}, got up to {corners.max()}")
    count = _CELLS[as_choice("cell_type", cell_type, tuple(_CELLS))]
    if count not in (None, corners.shape[1]):
        raise InputError(
            f"cells of cell_type {cell_type} have {count} points, got {corners.shape[1]}"
        )
    grid = _unstructured(
        x,
        corners,
        cell_type,
        _named("point_data", point_data, (len(x),)),
        _named("cell_data", cell_data, (len(corners),)),
    )
    _attach(grid.GetFieldData(), _named("field_data", _rows(field_data), ()))
    _write("vtkXMLUnstructuredGridWriter", grid, path, compress)


def write_mixed_vtu(
    path: str | os.PathLike[str],
    parts: Sequence[tuple[int, AnyArray]],
    *,
    degree: int,
    compress: bool = False,
) -> None:
    """Write cells of several kinds, each with points of its own.

    Parameters
    ----------
    path : path-like
        File to create or to replace.
    parts : sequence of (int, (e, c, 3) array)
        VTK's number of a kind, and the points of its cells in VTK's order.
    degree : int
        Of Lagrange and Bezier cells, in all directions.
    compress : bool
        Compress with zlib.

    Raises
    ------
    FormatError
        If the file cannot be written.
    """
    from vtkmodules.vtkCommonCore import vtkIdList
    from vtkmodules.vtkCommonDataModel import vtkUnstructuredGrid

    grid = vtkUnstructuredGrid()
    points = np.concatenate([np.reshape(x, (-1, 3)) for _, x in parts])
    grid.SetPoints(_points(points))
    grid.Allocate(sum(len(x) for _, x in parts))
    first = 0
    for kind, x in parts:
        ids = vtkIdList()
        ids.SetNumberOfIds(x.shape[1])
        for _ in range(len(x)):
            for j in range(x.shape[1]):
                ids.SetId(j, first + j)
            grid.InsertNextCell(kind, ids)
            first += x.shape[1]
    degrees = np.full((grid.GetNumberOfCells(), 3), float(degree))
    grid.GetCellData().SetHigherOrderDegrees(_array("HigherOrderDegrees", degrees))
    _write("vtkXMLUnstructuredGridWriter", grid, path, compress)


def write_lines(
    path: str | os.PathLike[str],
    points: ArrayLike,
    lines: ArrayLike,
    *,
    point_data: Mapping[str, ArrayLike] | None = None,
    cell_data: Mapping[str, ArrayLike] | None = None,
    compress: bool = False,
) -> None:
    """Write straight lines with named data as .vtp.

    Parameters
    ----------
    path : path-like
        File to create or to replace.
    points : (n, 3) array
        Points.
    lines : (e, 2) array of integers
        Ends of the lines.
    point_data, cell_data : mapping of str to array, optional
        Data on the points and on the lines.
    compress : bool
        Compress with zlib.

    Raises
    ------
    InputError
        Wrong shapes, or lines that name points that do not exist.
    FormatError
        If the file cannot be written.
    """
    from vtkmodules.vtkCommonDataModel import vtkPolyData

    x = as_points("points", points)
    ends = np.asarray(lines)
    if ends.ndim != 2 or ends.shape[1] != 2 or ends.dtype.kind not in "iu":
        raise InputError(f"lines must be integers of shape (e, 2), got shape {ends.shape}")
    if ends.size and not 0 <= ends.min() <= ends.max() < len(x):
        raise InputError(f"lines must name points below {len(x)}, got up to {ends.max()}")
    drawing = vtkPolyData()
    drawing.SetPoints(_points(x))
    drawing.SetLines(_cells(ends, len(x)))
    _attach(drawing.GetPointData(), _named("point_data", point_data, (len(x),)))
    _attach(drawing.GetCellData(), _named("cell_data", cell_data, (len(ends),)))
    _write("vtkXMLPolyDataWriter", drawing, path, compress)


def write_pvd(
    path: str | os.PathLike[str], files: Sequence[str | os.PathLike[str]], times: ArrayLike
) -> None:
    """Write a ParaView collection: files that follow each other in time.

    Parameters
    ----------
    path : path-like
        File to create or to replace, ending in ``.pvd``.
    files : sequence of path-like, n of them
        VTK files that are there already, in the folder of `path` or below; they are named
        relative to it, so that all can be moved together.
    times : (n,) array
        When each is shown, not decreasing; files of the same time are shown together.

    Raises
    ------
    InputError
        No file, not one time per file, times that decrease, or files elsewhere.
    FormatError
        Another ending, or the file cannot be written.
    """
    target = as_path("path", path)
    if target.suffix.lower() != ".pvd":
        raise FormatError(f"{str(path)!r}: a collection is written as .pvd")
    files, t = as_items("files", files), as_array("times", times)
    if np.ndim(times) != 1 or t.shape != (len(files),) or not len(t) or (np.diff(t) < 0).any():
        raise InputError(
            f"times must be {len(files)} numbers that do not decrease, one per file and at least "
            f"one, got shape {t.shape}"
        )
    folder = Path(os.path.abspath(target)).parent
    lines = ['<?xml version="1.0"?>', '<VTKFile type="Collection" version="0.1">', "  <Collection>"]
    for time, file in zip(t.tolist(), files, strict=True):
        place = Path(os.path.abspath(as_path("files", file)))
        if not place.is_relative_to(folder):
            raise InputError(f"files: {str(file)!r} is not in the folder of {str(path)!r}")
        name = quoteattr(place.relative_to(folder).as_posix())
        lines.append(f'    <DataSet timestep="{time!r}" part="0" file={name}/>')
    lines += ["  </Collection>", "</VTKFile>", ""]
    with atomic_path(path) as temporary:
        temporary.write_text("\n".join(lines), encoding="utf-8")


# --- grids ------------------------------------------------------------------------------------


def save_grid(
    path: str | os.PathLike[str],
    axes: Sequence[ArrayLike],
    point_data: Mapping[str, ArrayLike],
    *,
    through: Map | None = None,
    compress: bool = True,
) -> None:
    """Write fields on a grid: ``.vti`` in the parameter domain, ``.vts`` also through a map.

    Parameters
    ----------
    path : path-like
        File to create or to replace, ending in ``.vti`` or ``.vts``.
    axes : three arrays (n0,), (n1,), (n2,)
        Increasing coordinates of the grid in each direction; equidistant for ``.vti``.
    point_data : mapping of str to (n0, n1, n2) or (n0, n1, n2, c) array
        Fields at the grid points, indexed [u, v, w].
    through : SplineMap, optional
        ``.vts`` only: the points are mapped to space.
    compress : bool
        Compress with zlib.

    Raises
    ------
    InputError
        Wrong shapes, axes that do not increase or, for ``.vti``, are not equidistant.
    FormatError
        Another ending, or the file cannot be written.
    """
    ticks = [as_array(f"axes[{i}]", a, ndim=1) for i, a in enumerate(axes)]
    if len(ticks) != 3 or any(len(a) < 2 or (np.diff(a) <= 0).any() for a in ticks):
        raise InputError("axes must be three arrays of at least two increasing numbers each")
    shape = tuple(len(a) for a in ticks)
    fields = _named("point_data", point_data, shape)
    suffix = as_path("path", path).suffix.lower()
    if suffix == ".vti" and through is None:
        grid, writer = _image(ticks), "vtkXMLImageDataWriter"
    elif suffix == ".vts":
        u = grid_array(*ticks)
        x = u if through is None else through.x(u.reshape(-1, 3)).reshape(u.shape)
        grid, writer = _structured(x), "vtkXMLStructuredGridWriter"
    else:
        raise FormatError(
            f"a grid is written as .vti (without a map) or .vts, not as {suffix!r}: {str(path)!r}"
        )
    _attach(grid.GetPointData(), {name: _by_points(a) for name, a in fields.items()})
    _write(writer, grid, path, compress)


def _image(axes: Sequence[AnyArray]) -> Any:
    from vtkmodules.vtkCommonDataModel import vtkImageData

    image = vtkImageData()
    steps = [(a[-1] - a[0]) / (len(a) - 1) for a in axes]
    for i, (a, step) in enumerate(zip(axes, steps, strict=True)):
        if np.abs(np.diff(a) - step).max() > _SAME_STEP * step:
            raise InputError(f"axes[{i}] must be equidistant for .vti; write .vts")
    image.SetDimensions(*(len(a) for a in axes))
    image.SetOrigin(*(float(a[0]) for a in axes))
    image.SetSpacing(*(float(step) for step in steps))
    return image


def _structured(x: AnyArray) -> Any:
    from vtkmodules.vtkCommonDataModel import vtkStructuredGrid

    grid = vtkStructuredGrid()
    grid.SetDimensions(*x.shape[:3])
    grid.SetPoints(_points(_by_points(x)))
    return grid


def _by_points(a: AnyArray) -> AnyArray:
    """Values indexed [u, v, w] as a list of points with u fastest, shape (n,) or (n, c)."""
    turned = np.moveaxis(a, (0, 1, 2), (2, 1, 0))
    return np.ascontiguousarray(turned).reshape(-1, *a.shape[3:])


# --- shared with VTK --------------------------------------------------------------------------


def _named(
    name: str, data: Mapping[str, ArrayLike] | None, shape: tuple[int, ...]
) -> dict[str, AnyArray]:
    """Data as arrays whose first axes are `shape`."""
    arrays = {}
    for key, value in _items(name, data):
        a = np.asarray(value)
        if a.shape[: len(shape)] != shape or a.dtype.kind not in "biuf":
            raise InputError(
                f"{name}[{key!r}] must hold real numbers of shape {shape} or {shape} + (c,), "
                f"got {a.dtype} of shape {a.shape}"
            )
        arrays[key] = a
    return arrays


def _rows(data: Mapping[str, ArrayLike] | None) -> dict[str, AnyArray]:
    """Single numbers as arrays of one."""
    return {name: np.atleast_1d(value) for name, value in _items("field_data", data)}


def _items(name: str, data: Mapping[str, ArrayLike] | None) -> list[tuple[str, ArrayLike]]:
    """Names and arrays of a mapping, or `InputError`."""
    if data is not None and not isinstance(data, Mapping):
        raise InputError(f"{name} must be a mapping of names to arrays, got {data!r:.80}")
    found = list((data or {}).items())
    for key, value in found:
        try:
            np.asarray(value)
        except ValueError as e:
            raise InputError(f"{name}[{key!r:.60}] must be an array, got {value!r:.80}") from e
        if not isinstance(key, str) or not key:
            raise InputError(f"{name} must have names as keys, got {key!r:.80}")
    return found


def _array(name: str, values: AnyArray) -> Any:
    """VTK array over the memory of `values`, which VTK keeps alive."""
    from vtkmodules.util.numpy_support import numpy_to_vtk

    kind = _KINDS.get(values.dtype.str[1:], values.dtype)
    flat = values.reshape(len(values), -1) if values.ndim > 1 else values
    array = numpy_to_vtk(np.ascontiguousarray(flat, dtype=kind))
    array.SetName(name)
    name_components(array)
    return array


def name_components(array: Any) -> None:
    """Name the components of a VTK array that is a stress or strain in Voigt order.

    Parameters
    ----------
    array : vtkDataArray
        Changed if its name ends with one of `TENSORS` and it has six components.
    """
    if array.GetNumberOfComponents() == len(VOIGT) and array.GetName().endswith(TENSORS):
        for k, component in enumerate(VOIGT):
            array.SetComponentName(k, component)


def _attach(target: Any, data: Mapping[str, AnyArray]) -> None:
    for name, values in data.items():
        target.AddArray(_array(name, values))


def _points(x: AnyArray) -> Any:
    from vtkmodules.vtkCommonCore import vtkPoints

    points = vtkPoints()
    points.SetData(_array("Points", x))
    return points


def _cells(corners: AnyArray, n_points: int) -> Any:
    from vtkmodules.vtkCommonDataModel import vtkCellArray

    kind = np.int32 if max(corners.size, n_points) < 2**31 else np.int64
    offsets = np.arange(0, corners.size + 1, corners.shape[1], dtype=kind)
    cells = vtkCellArray()
    cells.SetData(_array("offsets", offsets), _array("corners", corners.astype(kind).ravel()))
    return cells


def _unstructured(
    x: AnyArray,
    corners: AnyArray,
    cell_type: int,
    point_data: Mapping[str, AnyArray],
    cell_data: Mapping[str, AnyArray],
) -> Any:
    from vtkmodules.vtkCommonDataModel import vtkUnstructuredGrid

    grid = vtkUnstructuredGrid()
    grid.SetPoints(_points(x))
    grid.SetCells(cell_type, _cells(corners, len(x)))
    _attach(grid.GetPointData(), point_data)
    _attach(grid.GetCellData(), cell_data)
    return grid


def _write(writer_name: str, data: Any, path: str | os.PathLike[str], compress: bool) -> None:
    from vtkmodules import vtkIOXML

    compress = as_flag("compress", compress)
    writer = getattr(vtkIOXML, writer_name)()
    writer.SetInputData(data)
    writer.SetDataModeToAppended()
    writer.EncodeAppendedDataOff()
    writer.SetHeaderTypeToUInt64()
    if compress:
        writer.SetCompressorTypeToZLib()
    else:
        writer.SetCompressorTypeToNone()
    with atomic_path(path) as temporary, quiet_vtk():
        writer.SetFileName(str(temporary))
        done = writer.Write()
        _check(done, writer.GetErrorCode(), temporary.parent)


def _check(done: int, code: int, folder: Path) -> None:
    """`OSError` for VTK's error code: numbers of the system, or beyond them VTK's own."""
    from vtkmodules.vtkCommonMisc import vtkErrorCode

    if done and not code:
        return
    message = vtkErrorCode.GetStringFromErrorCode(code)
    if message != "OutOfDiskSpaceError":
        raise OSError(code, message)
    if shutil.disk_usage(folder).free < _ROOM:
        raise OSError(errno.ENOSPC, "no space left")
    raise OSError(errno.EFBIG, "file too large")  # VTK does not tell which
