"""Scenes into plotters of pyvista, and from there into pixels, windows and files."""

import os
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from ilattice._files import as_path
from ilattice._typing import AnyArray
from ilattice._validate import as_array
from ilattice._vtk import quiet_vtk
from ilattice.errors import FormatError, InputError
from ilattice.plot import camera, overlays

_BAR, _HEAD = 0.17, 0.07  # parts of the width for a colour bar, and of the height for a title
#: Pixels of height for a title, per point of its font: more than _HEAD if panels are low.
_LINE = 3.0
_OCCLUSION = 0.04  # reach of the ambient occlusion, in units of the part's size
_RAYS = 8  # per pixel, blurred: twice as many look the same and take two seconds more


#: Scenes, whose class stands above this module.
Scenes = Sequence[Any]


def drawn(
    scenes: Scenes, shape: tuple[int, int], size: tuple[int, int], *,
    labels: bool = False, off_screen: bool | None = True,
) -> Any:  # fmt: skip
    """A plotter of pyvista with everything in it."""
    import pyvista as pv

    rows, columns = shape
    options: dict[str, Any] = {"off_screen": off_screen} if off_screen is not None else {}
    plotter = pv.Plotter(
        window_size=list(size), shape=(rows, columns), border=False, lighting="none", **options
    )
    shown = [[layer for layer in scene.layers if layer.title] for scene in scenes]
    limits = overlays.shared_limits(shown)
    last = {layer.title: i for i, scene in enumerate(scenes) for layer in scene.layers}
    aspect = size[0] * rows / (size[1] * columns)
    for i, scene in enumerate(scenes):
        plotter.subplot(i // columns, i % columns)
        title = f"({chr(97 + i)}) {scene.title}" if labels else scene.title
        bars = {name for name, at in last.items() if name and at == i}
        letters = overlays.font(11, size[0] / columns)
        head = min(max(_HEAD, _LINE * letters * rows / size[1]), 0.5) if title else 0.0
        _draw(plotter, scene, limits, aspect, bars, room=1.0 - head, width=size[0] / columns)
        if title:
            plotter.add_text(
                overlays.shown(title),
                position="upper_edge",
                color="black",
                font_size=letters,
            )
    plotter.enable_anti_aliasing("ssaa", all_renderers=True)
    return plotter


def _draw(
    plotter: Any, scene: Any, limits: Mapping[str, Any], aspect: float, bars: set[str], *,
    room: float, width: float,
) -> None:  # fmt: skip
    """One panel of some width; the colour bars named are drawn in it, `room` is below the title."""
    points, bar = scene.corners(), None
    plotter.set_background(scene.background, all_renderers=False)
    for data, style, layer in scene.pieces():
        name = str(style.get("scalars", ""))
        known = limits if layer.title else overlays.shared_limits([[layer]])
        limited = {"clim": known[name]} if name in known else {}
        actor = plotter.add_mesh(data, reset_camera=False, **{**limited, **style})
        opacity = style.get("opacity", 1.0)
        if isinstance(opacity, int | float) and opacity < 1.0:
            _behind(actor.mapper)
        if name and layer.title in bars:
            bar = actor.mapper, layer.title
    overlays.lights(plotter, scene.view)
    if scene.scale_bar:
        points = np.vstack([points, overlays.scale_bar(plotter, points, scene.view, scene.unit)])
    camera.fit(
        plotter.camera, points, scene.view, aspect=aspect, zoom=scene.zoom,
        parallel=scene.parallel, room=(1.0 - (_BAR if bar else 0.0), room),
    )  # fmt: skip
    if bar:
        overlays.colour_bar(plotter, *bar, width)
    entries = [[a.legend, a.style["color"]] for a in scene.layers if a.legend]
    if entries:
        plotter.add_legend(entries, bcolor=None, face="circle", size=(0.18, 0.05 * len(entries)))
    if scene.axes:
        plotter.add_axes(color="black")
    if scene.occlusion:
        reach = max(_OCCLUSION * float(np.ptp(points, axis=0).max()), 1e-30)
        plotter.enable_ssao(radius=reach, bias=0.08 * reach, kernel_size=_RAYS, blur=True)


def _behind(mapper: Any) -> None:
    """Let what is drawn at the same depth be in front of what is translucent."""
    mapper.SetResolveCoincidentTopologyToPolygonOffset()
    mapper.SetRelativeCoincidentTopologyPolygonOffsetParameters(2.0, 2.0)


def image(
    scenes: Scenes, shape: tuple[int, int], size: tuple[int, int], *,
    labels: bool = False,
) -> AnyArray:  # fmt: skip
    """Pixels, shape (height, width, 3)."""
    with quiet_vtk():  # VTK warns about the missing display before it falls back to EGL
        plotter = drawn(scenes, shape, size, labels=labels)
        try:
            return np.asarray(plotter.screenshot(return_img=True))
        finally:
            plotter.close()


def show(
    scenes: Scenes, shape: tuple[int, int], size: tuple[int, int],
    options: Mapping[str, Any], *, labels: bool = False,
) -> Any:  # fmt: skip
    """A window, or a notebook's widget; `options` are those of pyvista."""
    left = dict(options)
    off_screen = left.pop("off_screen", None)
    size = as_size(left.pop("window_size", None) or size)
    with quiet_vtk():
        return drawn(scenes, shape, size, labels=labels, off_screen=off_screen).show(**left)


def save(
    picture: Any, scenes: Scenes, shape: tuple[int, int], size: tuple[int, int],
    path: str | os.PathLike[str], *, labels: bool = False,
) -> None:  # fmt: skip
    """A file: of the image of `picture`, or of the scenes for the web."""
    ending = as_path("path", path).suffix.lower()
    if ending in (".png", ".jpg", ".jpeg"):
        overlays.write(picture.image(), path)
        return
    if ending not in (".gltf", ".html"):
        raise FormatError(f"{path!s:.80}: pictures are .png or .jpg, scenes .gltf or .html")
    with quiet_vtk():
        plotter = drawn(scenes, shape, size, labels=labels)
        try:
            overlays.export(plotter, path, ending)
        finally:
            plotter.close()


def as_size(value: Any) -> tuple[int, int]:
    """Width and height in pixels.

    Raises
    ------
    InputError
        If they are no whole numbers of at least 1.
    """
    size = as_array("size", value)
    if size.shape != (2,) or (size != np.rint(size)).any() or (size < 1).any():
        raise InputError(
            "size must be width and height in pixels, two whole numbers of at least 1, "
            f"got {value!r:.80}"
        )
    return int(size[0]), int(size[1])
