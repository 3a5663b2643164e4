"""Values of functions on planes, as heat maps.

Guarantees: values are those of the function at a grid of points in the plane, coloured linearly in
between; the line is where they change their sign. Not guaranteed: that what is finer than the grid
is seen.
"""

import ast
from collections.abc import Callable
from typing import Any

import numpy as np

from ilattice._conditions import as_affine, as_planes
from ilattice._field import Field, owns
from ilattice._geometry import grid_array
from ilattice._typing import AnyArray, FloatArray
from ilattice._validate import as_array, as_whole, asked
from ilattice.errors import InputError
from ilattice.plot import overlays
from ilattice.plot.camera import directions
from ilattice.plot.clips import clipped
from ilattice.plot.quick import split
from ilattice.plot.scene import Scene

_FORM = "write it like 'z = 0.3' or 'x + y = 1'"
_LIFT = 1e-3  # of the line towards the viewer, in units of the size of the picture


def heat_map(
    field: Callable[[FloatArray], Any], plane: str, *, box: Any = None, n: int = 240,
    label: str = "f", unit: str = "", **options: Any,
) -> Scene:  # fmt: skip
    """A function on a plane, by colours, with a line where it vanishes.

    Parameters
    ----------
    field : Field, BSpline or callable
        Takes points (n, 3), returns numbers (n,): a solid of `ilattice.fields`, a tile, a distance,
        ``wall.field``, the temperature of a solution.
    plane : str
        A linear equation in x, y and z, such as ``"z = 0.3"``; of fields in parameters these are
        u, v and w.
    box : (2, 3) array-like, optional
        What of the plane is shown; by default the bounds of the field.
    n : int
        Points along the longer side, 2 to 2000.
    label, unit : str
        Title of the colour bar, and unit.
    **options
        Of `Scene` (``size``, ``title``, ...), and of `Scene.add` (``cmap``, ``clim``, ...).

    Returns
    -------
    Scene
        Seen at right angles; negative values are blue and positive ones red.

    Raises
    ------
    InputError
        If the plane cannot be read or misses the box, or the field has no bounds and there is no
        box, or no finite value on it.

    Examples
    --------
    >>> import ilattice as il
    >>> part = il.fields.difference(il.fields.box(1.0), il.fields.sphere(1.2))
    >>> scene = il.plot.heat_map(part, "z = 0.3", unit="mm", size=(320, 240))
    >>> scene.image().shape
    (240, 320, 3)
    """
    row = _equation(plane)
    ends = _as_extent(field, box)
    n = as_whole("n", n, 2, 2000)
    data, _ = clipped(_grid(row, ends, n, plane), as_planes(ends, "box"))
    points = np.clip(np.asarray(data.points, float), *ends)
    values = np.asarray(asked("field", field, points), float)
    if values.size != data.n_points:
        raise InputError(
            f"field must give one number per point, got shape {values.shape} for {data.n_points}"
        )
    data.point_data["value"] = values.ravel()
    finite = np.isfinite(values.ravel())
    if not finite.any():
        raise InputError(f"field has no finite value on {plane} in the box {ends.tolist()}")
    known = data.extract_points(finite, adjacent_cells=False)
    low, high = float(values.ravel()[finite].min()), float(values.ravel()[finite].max())
    of_scene, of_layer, _ = split(options)
    looks = {"view": _across(row[:3]), "parallel": True, "occlusion": False, "title": plane}
    scene = Scene(**{**looks, **of_scene})
    colours: dict[str, Any] = {"cmap": "viridis", "nan_color": "lightgray"}
    if low < 0.0 < high:
        most = max(-low, high)
        colours |= {"cmap": "RdBu_r", "clim": (-most, most)}
    full = {**colours, "flat": True, **of_layer}
    scene = scene.add(data, scalars="value", label=label, unit=unit, **full)
    line = known.contour([0.0], scalars="value") if low < 0.0 < high else None
    if line is None or not line.n_points:
        return scene
    lift = _LIFT * float(np.ptp(points, axis=0).max())  # or the plane would cover parts of it
    return scene.lines(line.translate(lift * directions(scene.view)[0]), width=3.0)


def _equation(plane: Any) -> FloatArray:
    """Unit normal and offset, (4,): the plane is where ``a·x + b`` vanishes."""
    text = plane.replace("==", "=") if isinstance(plane, str) else ""
    if text.count("=") != 1:
        raise InputError(f"plane {plane!r:.80} is no equation; {_FORM}")
    left, right = (side.strip() for side in text.split("="))
    try:
        nodes = [ast.parse(side, mode="eval").body for side in (left, right)]
    except (SyntaxError, ValueError):
        raise InputError(f"plane {plane!r:.80} cannot be read; {_FORM}") from None
    row = as_affine(ast.BinOp(nodes[0], ast.Sub(), nodes[1]), f"plane {plane!r:.80}", _FORM)
    size = float(np.linalg.norm(row[:3]))
    if not 0.0 < size < np.inf:
        raise InputError(f"plane {plane!r:.80} is without x, y or z; {_FORM}")
    return row / size


def _as_extent(field: Any, box: Any) -> FloatArray:
    """Lowest and highest corner of what is shown, shape (2, 3)."""
    if not callable(field):
        raise InputError(f"field must take points (n, 3), got {type(field).__name__}")
    if box is None:
        found = _told_box(field)
        if found is not None:
            return found
        raise InputError("box: the field does not say where it is; give the corners to be shown")
    ends = as_array("box", box)
    if ends.shape != (2, 3) or not (ends[0] < ends[1]).all():
        raise InputError(
            f"box must be its lowest and highest corner, shape (2, 3), got {box!r:.80}"
        )
    return ends


def _told_box(field: Any) -> FloatArray | None:
    """Corners that a field, or the bounds of somebody else's callable, tell of; if finite."""
    if not owns(field, "bounds") and not isinstance(field, Field):
        return None
    try:
        box = np.asarray(field.shown_box if isinstance(field, Field) else field.bounds, float)
    except (TypeError, ValueError):
        return None
    return box if box.shape == (2, 3) and np.isfinite(box).all() else None


def _grid(row: FloatArray, ends: FloatArray, n: int, plane: str) -> Any:
    """Points in the plane over all of its part in the box, as a dataset."""
    import pyvista as pv

    corners = overlays.corners(ends)
    away = corners @ row[:3] + row[3]
    if away.min() > 0.0 or away.max() < 0.0:
        raise InputError(f"plane {plane!r:.80} misses the box {ends.tolist()}")
    axis = np.eye(3)[np.abs(row[:3]).argmin()]
    first = np.cross(axis, row[:3])
    first /= np.linalg.norm(first)
    second = np.cross(row[:3], first)
    flat = corners - np.outer(away, row[:3])
    s, t = flat @ first, flat @ second
    step = max(np.ptp(s), np.ptp(t)) / (n - 1)
    sides = [np.linspace(a.min(), a.max(), max(round(np.ptp(a) / step) + 1, 2)) for a in (s, t)]
    grid = grid_array(*sides)[:, :, None, :]
    points: AnyArray = grid[..., :1] * first + grid[..., 1:] * second - row[3] * row[:3]
    return pv.StructuredGrid(*np.moveaxis(points, -1, 0).astype(float))


def _across(normal: FloatArray) -> tuple[float, float]:
    """Azimuth and elevation of a viewer at right angles to a plane."""
    a = normal if normal[np.abs(normal).argmax()] > 0 else -normal
    if abs(a[2]) > 1.0 - 1e-12:
        return -90.0, 90.0
    if abs(a[1]) > 1.0 - 1e-12:
        a = -a  # from the front, where x points to the right
    return float(np.rad2deg(np.arctan2(a[1], a[0]))), float(np.rad2deg(np.arcsin(a[2])))
