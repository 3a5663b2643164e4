"""What is cut away from a picture, and the caps of the cut.

Guarantees: closed surfaces stay closed, by caps of their own. Non-guarantee: surfaces that are
open or not manifold are cut without caps, since their inside is not known.
"""

from typing import Any

import numpy as np

from ilattice._typing import FloatArray

#: Of planes that are in the way, in units of the size of what is cut.
_SHIFTS = (1.37e-7, 2.11e-6)


def clipped(data: Any, planes: FloatArray) -> tuple[Any, Any]:
    """A dataset within half-spaces, and the caps of the cut.

    Parameters
    ----------
    data : pyvista.DataSet
        Of any kind.
    planes : ndarray, shape (m, 4)
        As `as_planes` gives them.

    Returns
    -------
    kept : pyvista.DataSet
        What is left.
    caps : pyvista.PolyData or None
        Faces where a closed surface was cut; None for other data, whose cells are cut themselves.
    """
    import pyvista as pv

    surface = isinstance(data, pv.PolyData) and data.n_faces > 0
    if surface and data.n_open_edges == 0:
        return _closed(data, planes)
    for a in planes:
        data = data.clip(normal=a[:3], origin=-a[3] * a[:3], invert=False)
    return data, None


def _closed(surface: Any, planes: FloatArray) -> tuple[Any, Any]:
    """A closed surface, cut by one plane after the other, so that all cuts are closed.

    In units of its size and from its middle, since what VTK takes for equal is an absolute length.
    """
    size, middle = max(surface.length, 1e-300), np.array(surface.center)
    surface = surface.copy()
    surface.points = (np.asarray(surface.points, float) - middle) / size
    planes = np.column_stack([planes[:, :3], (planes[:, :3] @ middle + planes[:, 3]) / size])
    for plane in planes:
        for shift in (0.0, *_SHIFTS):  # a plane through many vertices can leave loops open
            cut = _cut(surface, plane[:3], plane[3] + shift)
            if cut.n_open_edges == 0:
                break
        surface = cut
    if surface.n_cells == 0:
        return surface, None
    cap = np.zeros(surface.n_cells, bool)
    corners = surface.points[surface.regular_faces]
    for plane in planes:
        away = np.abs(corners @ plane[:3] + plane[3])
        cap |= (away <= 2.0 * max(_SHIFTS)).all(axis=1)
    surface.points = middle + size * np.asarray(surface.points, float)
    kept = surface.extract_cells(~cap).extract_surface(algorithm=None)
    return kept, surface.extract_cells(cap).extract_surface(algorithm=None) if cap.any() else None


def _cut(surface: Any, normal: FloatArray, offset: float) -> Any:
    """Triangles of a closed surface on one side of a plane, closed again."""
    import pyvista as pv
    from vtkmodules.vtkCommonDataModel import vtkPlane, vtkPlaneCollection
    from vtkmodules.vtkFiltersGeneral import vtkClipClosedSurface

    plane, planes = vtkPlane(), vtkPlaneCollection()
    plane.SetNormal(*normal)
    plane.SetOrigin(*(-offset * normal))
    planes.AddItem(plane)
    cutter = vtkClipClosedSurface()
    cutter.SetInputData(surface)
    cutter.SetClippingPlanes(planes)
    cutter.SetScalarModeToNone()
    cutter.PassPointDataOn()
    cutter.Update()
    return pv.wrap(cutter.GetOutput()).triangulate()
