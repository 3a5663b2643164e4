"""SVG: slices as filled paths, one layer of the drawing each, y upwards.

Guarantees: coordinates keep eight digits; holes stay empty (``fill-rule="evenodd"``); slices are
written as they come. Not guaranteed: that programs show more than the topmost of many layers.
"""

import os

import numpy as np

from ilattice._files import atomic_write
from ilattice._progress import Progress, track
from ilattice._typing import FloatArray
from ilattice.io._slices import MILLIMETRES, Section, Stack, as_unit, contours, decimals, join

_NAMES = (
    'xmlns="http://www.w3.org/2000/svg" '
    'xmlns:inkscape="http://www.inkscape.org/namespaces/inkscape"'
)
#: Room about the drawing, as a part of its longer side.
_MARGIN = 0.02


def write_svg(
    stack: Stack,
    path: str | os.PathLike[str],
    *,
    unit: str = "millimeter",
    progress: Progress = None,
) -> None:
    """Write slices as layers of one drawing.

    Parameters
    ----------
    stack : SliceStack
        The slices.
    path : path-like
        File to create or to replace.
    unit : {"micron", "millimeter", "centimeter", "inch", "foot", "meter"}
        Unit of the coordinates; sets the size of the drawing.
    progress : bool or callable, optional
        See `ilattice._progress.track`.

    Raises
    ------
    InputError
        Unknown unit.
    FormatError
        If the file cannot be written.
    """
    unit = as_unit(unit)
    bounds = stack.bounds
    places = decimals(bounds)
    with atomic_write(path, text=True) as file:
        file.write(_head(bounds[:, :2], unit, places))
        for i, section in enumerate(track(stack, "slices", progress, total=len(stack))):
            file.write(_layer(section, i, places))
        file.write("</svg>\n")


def slice_document(section: Section) -> str:
    """One slice as an SVG document.

    Parameters
    ----------
    section : Slice
        The slice.

    Returns
    -------
    str
        The document, in millimetres.
    """
    bounds = section.bounds if section.polygons else np.array([[0.0, 0.0], [1.0, 1.0]])
    places = decimals(bounds)
    return _head(bounds, "millimeter", places) + _layer(section, 0, places) + "</svg>\n"


def _head(bounds: FloatArray, unit: str, places: int) -> str:
    scale = MILLIMETRES[unit][0]
    margin = _MARGIN * float(np.ptp(bounds, axis=0).max())
    (x, y), (width, height) = bounds[0] - margin, np.ptp(bounds, axis=0) + 2 * margin
    box = " ".join(f"{v:.{places}f}" for v in (x, -y - height, width, height))
    return (
        '<?xml version="1.0" encoding="UTF-8"?>\n'
        f'<svg {_NAMES} width="{scale * width:.6g}mm" height="{scale * height:.6g}mm" '
        f'viewBox="{box}">\n'
    )


def _layer(section: Section, number: int, places: int) -> str:
    parts = []
    for points, _ in contours(section):
        parts.append("M" + join(points, places, "", ",", " ")[:-1] + "Z")
    return (
        f'<g id="layer{number}" inkscape:groupmode="layer" '
        f'inkscape:label="{section.height:.10g}" data-top="{section.top:.10g}" '
        'transform="scale(1,-1)">\n'
        f'<path fill="#8a6d3b" fill-rule="evenodd" d="{" ".join(parts)}"/>\n</g>\n'
    )
