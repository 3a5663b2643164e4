"""What is around the parts of a picture: light, colour bars, scales, insets, and its file.

Guarantee: files are whole or not there.
"""

import io
import os
import textwrap
import warnings
from collections.abc import Callable, Iterable, Sequence
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np

from ilattice._files import atomic_path, atomic_write
from ilattice._typing import AnyArray, FloatArray
from ilattice.errors import FormatError
from ilattice.plot.camera import directions
from ilattice.plot.styles import Layer

_BAR_PLACE = {"position_x": 0.875, "position_y": 0.2, "width": 0.045, "height": 0.55}
_TITLE_WIDTH = 12  # letters
_ROUNDING = 1e-9  # part of numbers by which they may differ without a colour of their own
_WIDE = 900  # pixels from which on fonts have their full size
_LEVEL = 3  # of compression of PNG: twice as fast as the usual 6, a tenth longer
_KEY, _FILL, _HEAD = 0.85, 0.3, 0.38  # intensities of the lights


def lights(plotter: Any, view: tuple[float, float]) -> None:
    """A key light from the upper left of the viewer, a weak one from his right, and his own."""
    import pyvista as pv

    toward, up = directions(view)
    right = np.cross(up, toward)
    for at, strength in (
        (toward + 0.9 * up - 0.7 * right, _KEY),
        (0.6 * toward - 0.2 * up + right, _FILL),
        (toward, _HEAD),
    ):
        light = pv.Light(position=at, focal_point=(0, 0, 0), intensity=strength)
        light.positional = False
        plotter.renderer.add_light(light)


def shown(text: str) -> str:
    """A text as it can be drawn: VTK takes a bar for the end of a column, and drops it.

    Parameters
    ----------
    text : str
        The text.

    Returns
    -------
    str
        With broken bars.
    """
    return text.replace("|", "\u00a6")


def font(points: float, width: float) -> int:
    """Size of a font for a picture or a panel of some width in pixels: smaller in small ones."""
    return max(round(points * min(1.0, width / _WIDE)), 6)


def colour_bar(plotter: Any, mapper: Any, title: str, width: float) -> None:
    """The colour bar of what a mapper draws, at the right of a picture of some width."""
    title = "\n".join(
        part
        for line in title.split("\n")
        for part in textwrap.wrap(line, _TITLE_WIDTH, break_long_words=False)
    )
    bar = plotter.add_scalar_bar(
        title=shown(title), mapper=mapper, vertical=True, fmt="%.3g", n_labels=5, color="black",
        title_font_size=font(20, width), label_font_size=font(18, width), **_BAR_PLACE,
    )  # fmt: skip
    bar.SetVerticalTitleSeparation(font(12, width))
    bar.SetUnconstrainedFontSize(True)


def shared_limits(pictures: Iterable[Sequence[Layer]]) -> dict[str, tuple[float, float]]:
    """Least and largest number of each quantity that is drawn, over all panels."""
    limits: dict[str, tuple[float, float]] = {}
    for layer in (layer for picture in pictures for layer in picture):
        name = layer.style.get("scalars")
        if name is None or layer.style.get("rgb"):
            continue
        values = np.asarray(layer.data[name], float)
        if values.ndim == 2:
            values = np.linalg.norm(values, axis=1)
        values = values[np.isfinite(values)]
        if len(values):
            lo, hi = limits.get(name, (np.inf, -np.inf))
            limits[name] = (min(lo, float(values.min())), max(hi, float(values.max())))
    return {name: _apart(*ends) for name, ends in limits.items()}


def _apart(lo: float, hi: float) -> tuple[float, float]:
    """Limits of colours, a per mille apart at least, so that rounding is no pattern."""
    size = max(abs(lo), abs(hi))
    if hi - lo > _ROUNDING * size:
        return lo, hi
    return lo - 5e-4 * size, hi + 5e-4 * size


def scale_bar(
    plotter: Any, points: FloatArray, view: tuple[float, float], unit: str
) -> FloatArray:  # fmt: skip
    """A bar of a round length below the part, at the depth of its middle; its ends, (2, 3)."""
    import pyvista as pv

    toward, up = directions(view)
    axes = np.column_stack([np.cross(up, toward), up, toward])
    local = points @ axes
    lo, hi = local.min(axis=0), local.max(axis=0)
    length = _round(0.25 * (hi[0] - lo[0]))
    gap = 0.06 * max(hi[1] - lo[1], hi[0] - lo[0])
    start = np.array([lo[0], lo[1] - gap, (lo[2] + hi[2]) / 2])
    ends = np.array([start, start + np.array([length, 0.0, 0.0])]) @ axes.T
    plotter.add_mesh(pv.Line(*ends), color="black", line_width=4, reset_camera=False)
    plotter.add_point_labels(
        [ends.mean(axis=0)], [f"{length:g} {unit}".strip()], shape=None, text_color="black",
        font_size=18, show_points=False, always_visible=True, reset_camera=False,
        justification_horizontal="center", justification_vertical="top",
    )  # fmt: skip
    below = (start - (0.0, 0.05 * (hi[0] - lo[0]), 0.0)) @ axes.T
    return np.vstack([ends, below])


def _round(length: float) -> float:
    """The largest of 1, 2 and 5 times a power of ten that is not longer."""
    ten = 10.0 ** np.floor(np.log10(max(length, 1e-300)))
    return float(ten * max(m for m in (1, 2, 5) if m * ten <= length * (1 + 1e-12)))


def corners(box: FloatArray) -> FloatArray:
    """The corners of a box, shape (8, 3)."""
    return np.array(list(product(*box.T)))


def pasted(
    picture: AnyArray, drawn: Callable[[tuple[int, int]], AnyArray], place: Sequence[float]
) -> AnyArray:
    """A picture with another one, drawn as wide and high as its place, in a frame on it."""
    height, width = picture.shape[:2]
    left, low, w, h = (round(p * s) for p, s in zip(place, (width, height) * 2, strict=True))
    small = drawn((max(w, 8), max(h, 8)))
    small[:3], small[-3:], small[:, :3], small[:, -3:] = 0, 0, 0, 0
    out = picture.copy()
    top = height - low - small.shape[0]
    out[top : top + small.shape[0], left : left + small.shape[1]] = small
    return out


def png(picture: AnyArray) -> bytes:
    """Bytes of a PNG file."""
    from PIL import Image

    file = io.BytesIO()
    Image.fromarray(picture).save(file, format="PNG", compress_level=_LEVEL)
    return file.getvalue()


def write(picture: AnyArray, path: str | os.PathLike[str]) -> None:
    """A picture into a file, whole or not at all."""
    from PIL import Image

    kind = "PNG" if Path(os.fspath(path)).suffix.lower() == ".png" else "JPEG"
    with atomic_write(path) as file:
        Image.fromarray(picture).save(file, format=kind)


def export(plotter: Any, path: str | os.PathLike[str], ending: str) -> None:
    """A scene for the web: glTF, or a page of its own."""
    with atomic_path(path) as temporary:
        if ending == ".gltf":
            plotter.export_gltf(str(temporary))
            return
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")  # pyvista warns of the error that it raises
                plotter.export_html(str(temporary))
        except ImportError as error:
            raise FormatError(
                f"{path!s:.80}: pages need trame, pip install 'pyvista[jupyter]' trame-pyvista "
                f"({error})"
            ) from error
