"""What the benchmarks compare with: the same work, done by SciPy, NumPy and VTK.

Each function imports what it needs itself, so that memory is charged to who uses it.
"""

from collections.abc import Sequence
from typing import Any

import numpy as np

from ilattice._typing import AnyArray, FloatArray


def ndbspline_jet(spline: Any, points: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Value and gradient by SciPy: one call per derivative, as its interface wants it."""
    orders = np.eye(3, dtype=int)
    return spline(points), np.stack([spline(points, nu=tuple(nu)) for nu in orders], axis=-1)


def store(shape: Sequence[int]) -> FloatArray:
    """Write every byte of a new array once: the bound of whatever returns such an array."""
    out = np.empty(shape)
    out.fill(1.0)
    return out


def interpolate(
    values: FloatArray, knots: Sequence[FloatArray], degrees: Sequence[int]
) -> FloatArray:
    """Coefficients of the interpolant at the Greville sites by SciPy, one axis after another."""
    from scipy.interpolate import make_interp_spline

    for axis, (t, k) in enumerate(zip(knots, degrees, strict=True)):
        sites = np.array([t[i + 1 : i + k + 1].mean() for i in range(values.shape[axis])])
        c = make_interp_spline(sites, np.moveaxis(values, axis, 0), k=k, t=t).c
        values = np.moveaxis(c, 0, axis)
    return values


def nearest(cloud: FloatArray, queries: FloatArray, workers: int = 2) -> tuple[Any, Any]:
    """Distance to the nearest point of a cloud and its index, tree included."""
    from scipy.spatial import cKDTree

    return cKDTree(cloud).query(queries, workers=workers)


def shortest_means(ends: AnyArray, vectors: FloatArray) -> FloatArray:
    """Lengths of the shortest means of rows ends[n] to ends[n + 1], with weights >= 0 of sum 1."""
    from scipy.optimize import nnls

    out = np.empty(len(ends) - 1)
    goal = np.array([0.0, 0.0, 0.0, 1e3])  # the sum of the weights, and heavily so
    for n in range(len(out)):
        rows = vectors[ends[n] : ends[n + 1]]
        weights = nnls(np.vstack([rows.T, np.full(len(rows), goal[3])]), goal)[0]
        out[n] = np.linalg.norm(weights @ rows)
    return out


def gyroid_box(n: int, *, sheet: bool) -> tuple[AnyArray, float]:
    """Gyroid of period 1 in the box [-1, 1]³ on n³ samples, from separable tables, as float32.

    Parameters
    ----------
    n : int
        Samples per axis; the box is padded by 1.5 of them on each side.
    sheet : bool
        The sheet ``|g| <= 0.3`` in place of the network ``g <= 0``.

    Returns
    -------
    tuple
        Samples (n, n, n), negative inside, and their spacing.
    """
    h = 2.0 / (n - 4)
    x = -1.0 - 1.5 * h + h * np.arange(n)
    s, c = (f(2 * np.pi * x).astype(np.float32) for f in (np.sin, np.cos))
    box = (np.abs(x) - 1).astype(np.float32)
    sc, side = np.outer(s, c), np.maximum.outer(box, box)
    out = np.empty((n, n, n), np.float32)
    for i, slab in enumerate(out):
        np.multiply(s[i], c[:, None], out=slab)
        slab += sc
        slab += c[i] * s
        if sheet:
            np.abs(slab, out=slab)
            slab -= np.float32(0.3)
        np.maximum(slab, side, out=slab)
        np.maximum(slab, box[i], out=slab)
    return out, h


def flying_edges(samples: AnyArray, h: float) -> tuple[int, int]:
    """Contour at 0 by VTK's fastest filter; returns the number of points and of triangles."""
    from vtkmodules.util.numpy_support import numpy_to_vtk
    from vtkmodules.vtkCommonDataModel import vtkImageData
    from vtkmodules.vtkFiltersCore import vtkFlyingEdges3D

    image = vtkImageData()
    image.SetDimensions(*samples.shape[::-1])
    image.SetSpacing(h, h, h)
    image.GetPointData().SetScalars(numpy_to_vtk(samples.ravel()))
    contour = vtkFlyingEdges3D()
    contour.SetInputData(image)
    contour.SetValue(0, 0.0)
    contour.ComputeNormalsOff()
    contour.ComputeGradientsOff()
    contour.ComputeScalarsOff()
    contour.Update()
    out = contour.GetOutput()
    return out.GetNumberOfPoints(), out.GetNumberOfPolys()


def microgen_gyroid(n: int, *, sheet: bool) -> int:
    """Number of triangles of microgen's boxed gyroid of 2 x 2 x 2 cells on n³ samples."""
    from microgen import Tpms, surface_functions

    shape = Tpms(surface_functions.gyroid, 0.6, repeat_cell=2, resolution=(n - 1) // 2)
    part = shape.generate_vtk(type_part="sheet" if sheet else "lower skeletal")
    return int(part.extract_surface().triangulate().n_cells)


def fogleman_gyroid(n: int, *, sheet: bool) -> int:
    """Number of triangles of the same by fogleman/sdf; its field is not steeper than 1."""
    import sdf

    @sdf.sdf3
    def gyroid() -> Any:
        def f(p: FloatArray) -> FloatArray:
            x, y, z = (2.0 * np.pi * p).T
            wave = np.sin(x) * np.cos(y) + np.sin(y) * np.cos(z) + np.sin(z) * np.cos(x)
            wave = np.abs(wave) - 0.3 if sheet else wave
            value: FloatArray = wave / (2.0 * np.pi * np.sqrt(3.0))
            return value

        return f

    step, end = 2.0 / (n - 1), 1.0 + 1e-9
    bounds = ((-end - step,) * 3, (end + 2.0 * step,) * 3)
    points = sdf.core.generate(sdf.box(2.0) & gyroid(), step=step, bounds=bounds, verbose=False)
    return len(points) // 3


def bernstein(tensors: FloatArray, t: FloatArray) -> FloatArray:
    """Values of one quadratic Bernstein tensor (n, 27) each at local points (n, 3)."""
    s = 1.0 - t
    b = np.stack([s * s, 2.0 * s * t, t * t], axis=2)
    c = np.matmul(tensors.reshape(-1, 9, 3), b[:, 2, :, None]).reshape(-1, 3, 3)
    return np.einsum("ni,nij,nj->n", b[:, 0], c, b[:, 1], optimize=False)


def libigl_distance(points: FloatArray, vertices: FloatArray, faces: AnyArray) -> FloatArray:
    """Signed distance to a closed mesh by pseudonormals."""
    import igl

    kind = igl.SIGNED_DISTANCE_TYPE_PSEUDONORMAL
    return igl.signed_distance(points, vertices, faces, kind)[0]
