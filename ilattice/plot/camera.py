"""Cameras that show all of a part, and nothing but the part.

Guarantee: all points are in the picture, and those at the rims along one of its axes are at the
stated margin.
"""

from typing import Any

import numpy as np

from ilattice._typing import FloatArray
from ilattice._validate import as_array
from ilattice.errors import InputError

#: Size of the picture in units of what it shows.
_MARGIN = 1.05
_ANGLE = 30.0  # degrees: vertical angle of view before it is fitted
_FAR = 1.2  # distance of the viewer from the sphere of the part, in units of what fills the picture
#: Azimuth and elevation of the viewer in degrees; up in the picture is z, or y from the top.
VIEWS = {
    "front": (-90.0, 0.0),
    "back": (90.0, 0.0),
    "left": (180.0, 0.0),
    "right": (0.0, 0.0),
    "top": (-90.0, 90.0),
    "bottom": (-90.0, -90.0),
}


def as_view(value: Any) -> tuple[float, float]:
    """Azimuth and elevation in degrees of a view that is given by name or by these.

    Raises
    ------
    InputError
        If it is neither.
    """
    if isinstance(value, str) and value in VIEWS:
        return VIEWS[value]
    angles = np.empty(0) if isinstance(value, str) else as_array("view", value)
    if angles.shape != (2,):
        raise InputError(
            "view must be azimuth and elevation of the viewer in degrees, or one of "
            f"{', '.join(VIEWS)}, got {value!r:.80}"
        )
    return float(angles[0]), float(angles[1])


def directions(view: tuple[float, float]) -> tuple[FloatArray, FloatArray]:
    """Unit vectors from the part to the viewer, and upwards in the picture, both (3,)."""
    (c, s), (along, upward) = ((np.cos(a), np.sin(a)) for a in np.deg2rad(view))
    return np.array((along * c, along * s, upward)), np.array((-upward * c, -upward * s, along))


def fit(
    camera: Any, points: FloatArray, view: tuple[float, float], *, aspect: float, zoom: float,
    parallel: bool, room: tuple[float, float] = (1.0, 1.0),
) -> None:  # fmt: skip
    """Point a camera at points so that they fill the picture.

    Parameters
    ----------
    camera : pyvista.Camera
        Changed.
    points : ndarray, shape (n, 3)
        What is to be seen.
    view : (float, float)
        Azimuth and elevation of the viewer in degrees.
    aspect : float
        Width of the picture over its height.
    zoom : float
        Magnification.
    parallel : bool
        Without perspective.
    room : (float, float)
        Part of the width, from the left, and of the height, from below, that there is for them.
    """
    aspect *= room[0] / room[1]
    toward, up = directions(view)
    axes = np.column_stack([np.cross(up, toward), up, toward])
    local = points @ axes
    lo, hi = local.min(axis=0), local.max(axis=0)
    middle, size = (lo + hi) / 2, hi - lo
    local = local - middle
    least = 1e-6 * max(float(size.max()), 1e-9 * float(np.abs(points).max()), 1e-300)
    half = max(size[0] / aspect, size[1], least) / 2
    depth = _FAR * half / np.tan(np.deg2rad(_ANGLE / 2)) + size[2] / 2
    camera.parallel_projection = parallel
    if parallel:
        camera.parallel_scale = _MARGIN * half / (zoom * room[1])
        shift = np.zeros(2)
    else:
        shift = _off_centre(local, depth)
        slope = np.abs(local[:, :2] - shift) / (depth - local[:, 2:])
        steepest = max(float(slope[:, 0].max()) / aspect, float(slope[:, 1].max()), 1e-6)
        camera.view_angle = float(
            2.0 * np.rad2deg(np.arctan(_MARGIN * steepest / (zoom * room[1])))
        )
    focus = axes @ (middle + np.append(shift, 0.0))
    camera.focal_point = focus
    camera.position = focus + depth * toward
    camera.up = up
    camera.SetWindowCenter(1.0 - room[0], 1.0 - room[1])
    reach = size[2] + 0.01 * half  # of flat parts, too, both planes are away from them
    camera.clipping_range = (depth - reach, depth + reach)


def _off_centre(local: FloatArray, depth: float) -> FloatArray:
    """How far the middle of the picture is from that of the box, because of the perspective."""
    shift = np.zeros(2)
    for _ in range(4):
        slope = (local[:, :2] - shift) / (depth - local[:, 2:])
        shift += depth * (slope.min(axis=0) + slope.max(axis=0)) / 2
    return shift
