"""PNG pictures of meshes, rendered without a window.

Guarantee: works without a display where VTK finds EGL or OSMesa. Not guaranteed: equal pixels on
different machines.
"""

import os
from typing import Any

import numpy as np

from ilattice._files import atomic_write
from ilattice._typing import FloatArray
from ilattice._validate import as_array, as_positive
from ilattice.errors import InputError
from ilattice.io._mesh import Triangles, check_not_empty, colours
from ilattice.io.vtk import quiet_vtk

_SMOOTH_UP_TO = 2_000_000
_CREASE = 40.0
_MARGIN = 1.05
_ROOM_FOR_BAR = 0.85
_MATERIAL = {"ambient": 0.25, "diffuse": 0.75, "specular": 0.25, "specular_power": 20.0}
_DEFAULT_COLOUR = "#d9b382"
#: Azimuth and elevation of the viewer in degrees; up in the picture is z, or y from the top.
VIEWS = {
    "front": (-90.0, 0.0),
    "back": (90.0, 0.0),
    "left": (180.0, 0.0),
    "right": (0.0, 0.0),
    "top": (-90.0, 90.0),
    "bottom": (-90.0, -90.0),
}


def write_png(
    mesh: Triangles,
    path: str | os.PathLike[str],
    *,
    size: tuple[int, int] = (1600, 1200),
    view: str | tuple[float, float] = (-60.0, 30.0),
    zoom: float = 1.0,
    background: str = "white",
    scalars: str | None = None,
    **options: Any,
) -> None:
    """Render a mesh into a PNG file.

    Parameters
    ----------
    mesh : SurfaceMesh
        The mesh; coloured by `scalars`, else by ``r``, ``g``, ``b``, else in one colour.
    path : path-like
        File to create or to replace.
    size : (int, int)
        Width and height in pixels.
    view : (float, float) or {"front", "back", "left", "right", "top", "bottom"}
        Azimuth from the x-axis and elevation of the viewer, in degrees; z is up. From the front
        and the top x points to the right.
    zoom : float
        Magnification; 1 makes the mesh fill the picture.
    background : str
        Colour of the background.
    scalars : str, optional
        Name of point or cell data to colour by.
    **options
        Passed to ``pyvista.Plotter.add_mesh``: ``color``, ``cmap``, ``clim``, ...

    Raises
    ------
    GeometryError
        If the mesh is empty.
    InputError
        Unknown `scalars` or `view`, or a `size` or `zoom` that is not positive.
    FormatError
        If the file cannot be written.
    """
    from PIL import Image

    check_not_empty(mesh)
    size, view, zoom = _as_size(size), _as_view(view), as_positive("zoom", zoom)
    names = [*mesh.point_data, *mesh.cell_data]
    if scalars is not None and scalars not in names:
        raise InputError(f"scalars {scalars!r} are not in the mesh; it has {names}")
    surface = to_pyvista(mesh)
    style = _style(mesh, scalars)
    if style.get("rgb"):
        surface.point_data["RGB"] = colours(mesh.point_data)
    style |= options
    zoom *= _ROOM_FOR_BAR if scalars is not None else 1.0
    picture = _render(surface, size, view, zoom, background, style)
    with atomic_write(path) as file:
        Image.fromarray(picture).save(file, format="PNG")


def _as_size(value: Any) -> tuple[int, int]:
    size = as_array("size", value)
    if size.shape != (2,) or (size != np.rint(size)).any() or (size < 1).any():
        raise InputError(
            "size must be width and height in pixels, two whole numbers of at least 1, "
            f"got {value!r:.80}"
        )
    return int(size[0]), int(size[1])


def _as_view(value: Any) -> tuple[float, float]:
    if isinstance(value, str) and value in VIEWS:
        return VIEWS[value]
    angles = np.empty(0) if isinstance(value, str) else as_array("view", value)
    if angles.shape != (2,):
        raise InputError(
            "view must be azimuth and elevation of the viewer in degrees, or one of "
            f"{', '.join(VIEWS)}, got {value!r:.80}"
        )
    return float(angles[0]), float(angles[1])


def to_pyvista(mesh: Triangles) -> Any:
    """A mesh with its data as ``pyvista.PolyData``."""
    import pyvista as pv

    out = pv.PolyData.from_regular_faces(np.array(mesh.vertices), np.array(mesh.faces))
    for name, array in mesh.point_data.items():
        out.point_data[name] = np.array(array)
    for name, array in mesh.cell_data.items():
        out.cell_data[name] = np.array(array)
    return out


def _style(mesh: Triangles, scalars: str | None) -> dict[str, Any]:
    smooth = len(mesh.faces) <= _SMOOTH_UP_TO
    style = {"smooth_shading": smooth, "split_sharp_edges": smooth, "feature_angle": _CREASE}
    if scalars is not None:
        bar = {
            "title": f"{scalars}\n",  # apart from the uppermost number
            "vertical": True,
            "fmt": "%.3g",
            "position_x": 0.92,
            "position_y": 0.25,
            "width": 0.04,
        }
        return style | _MATERIAL | {"scalars": scalars, "scalar_bar_args": bar}
    if {"r", "g", "b"} <= set(mesh.point_data):
        return style | _MATERIAL | {"scalars": "RGB", "rgb": True}
    return style | _MATERIAL | {"color": _DEFAULT_COLOUR}


def _render(
    surface: Any,
    size: tuple[int, int],
    view: tuple[float, float],
    zoom: float,
    background: str,
    style: dict[str, Any],
) -> Any:
    """Pixels, shape (height, width, 3)."""
    import pyvista as pv

    (c, s), (along, upward) = ((np.cos(a), np.sin(a)) for a in np.deg2rad(view))
    toward, up = (along * c, along * s, upward), (-upward * c, -upward * s, along)
    with quiet_vtk():  # VTK warns about the missing display before it falls back to EGL
        plotter = pv.Plotter(off_screen=True, window_size=list(size), lighting="three lights")
        try:
            plotter.set_background(background)
            plotter.add_mesh(surface, **style)
            plotter.enable_anti_aliasing("ssaa")
            plotter.view_vector(toward, viewup=up)
            plotter.camera.view_angle = _view_angle(plotter.camera, surface.points, size) / zoom
            return plotter.screenshot(return_img=True)
        finally:
            plotter.close()


def _view_angle(camera: Any, points: FloatArray, size: tuple[int, int]) -> float:
    """Vertical angle of view, in degrees, in which all points lie, with a margin."""
    position, focus, up = (np.array(v) for v in (camera.position, camera.focal_point, camera.up))
    forward = (focus - position) / np.linalg.norm(focus - position)
    right = np.cross(forward, up)
    right /= np.linalg.norm(right)
    depth = (points - position) @ forward
    across = np.abs((points - position) @ right) / depth * (size[1] / size[0])
    along = np.abs((points - position) @ np.cross(right, forward)) / depth
    tangent = float(max(across.max(), along.max(), 1e-6))
    return float(2.0 * np.rad2deg(np.arctan(_MARGIN * tangent)))
