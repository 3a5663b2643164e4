"""CLI, the common layer interface 2.0: contours of layers, for machines that melt powder.

Guarantees: layers ascend and name their upper surface; a zero-layer gives the lower end of the
first; outer contours have direction 1 (counter-clockwise), holes 0; the first point is repeated
at the end; slices are written as they come. Binary files hold long commands in single precision,
ASCII files eight digits. Not written: hatches, dates, labels.
"""

import os
from typing import IO, Any

import numpy as np

from ilattice._files import atomic_write
from ilattice._progress import Progress, track
from ilattice._typing import FloatArray
from ilattice.io._slices import MILLIMETRES, Section, Stack, as_unit, contours, decimals, join

_LAYER = np.dtype([("command", "<u2"), ("z", "<f4")])
_POLYLINE = np.dtype([("command", "<u2"), ("id", "<i4"), ("dir", "<i4"), ("n", "<i4")])
#: Commands of the binary format (CLI 2.0): a layer, and a polyline, in long form.
_LONG_LAYER, _LONG_POLYLINE = 127, 130


def write_cli(
    stack: Stack,
    path: str | os.PathLike[str],
    *,
    binary: bool = True,
    unit: str = "millimeter",
    progress: Progress = None,
) -> None:
    """Write slices as a common layer interface file.

    Parameters
    ----------
    stack : SliceStack
        The slices.
    path : path-like
        File to create or to replace.
    binary : bool
        Binary geometry, else ASCII.
    unit : {"micron", "millimeter", "centimeter", "inch", "foot", "meter"}
        Unit of the coordinates.
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
    places = decimals(stack.bounds)
    with atomic_write(path) as file:
        file.write(_header(stack, binary, unit, places).encode("ascii"))
        _write_layer(file, stack.bottom, None, binary, places)
        for section in track(stack, "slices", progress, total=len(stack)):
            _write_layer(file, section.top, section, binary, places)
        if not binary:
            file.write(b"$$GEOMETRYEND\n")


def _header(stack: Stack, binary: bool, unit: str, places: int) -> str:
    box = ",".join(f"{v:.{places}f}" for v in stack.bounds.ravel())
    lines = [
        "$$HEADERSTART",
        "$$BINARY" if binary else "$$ASCII",
        f"$$UNITS/{MILLIMETRES[unit][0]:.10g}",
        "$$VERSION/200",
        f"$$DIMENSION/{box}",
        f"$$LAYERS/{len(stack) + 1}",
        "$$HEADEREND",
    ]
    head = "\n".join(lines)
    return head if binary else head + "\n$$GEOMETRYSTART\n"


def _write_layer(
    file: IO[Any], top: float, section: Section | None, binary: bool, places: int
) -> None:
    if binary:
        file.write(np.array((_LONG_LAYER, top), _LAYER).tobytes())
    else:
        file.write(f"$$LAYER/{top:.{places}f}\n".encode("ascii"))
    for points, outer in contours(section) if section is not None else ():
        closed = np.concatenate([points, points[:1]])
        file.write((_binary if binary else _text)(closed, int(outer), places))


def _binary(points: FloatArray, direction: int, _: int) -> bytes:
    head = np.array((_LONG_POLYLINE, 1, direction, len(points)), _POLYLINE)
    return head.tobytes() + points.astype("<f4").tobytes()


def _text(points: FloatArray, direction: int, places: int) -> bytes:
    rest = join(points, places, ",", ",", "")
    return f"$$POLYLINE/1,{direction},{len(points)}{rest}\n".encode("ascii")
