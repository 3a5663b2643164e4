"""What the ``plot`` methods of this package do: a scene with one thing in it, shown at once."""

from collections.abc import Mapping
from typing import Any

from ilattice._progress import Progress, staged
from ilattice.plot.scene import Scene

#: Options of `Scene`; "window_size" is pyvista's word for "size".
_OF_SCENE = ("size", "view", "zoom", "background", "parallel", "occlusion", "title", "axes",
             "scale_bar")  # fmt: skip
_OF_SHOW = ("off_screen", "jupyter_backend", "interactive", "return_viewer", "auto_close", "cpos",
            "return_img", "full_screen", "interactive_update")  # fmt: skip


def split(options: Mapping[str, Any]) -> tuple[dict[str, Any], dict[str, Any], dict[str, Any]]:
    """Options of scenes, of layers, and of showing them."""
    left = dict(options)
    if "window_size" in left:
        left["size"] = left.pop("window_size")
    scene = {name: left.pop(name) for name in _OF_SCENE if name in left}
    shown = {name: left.pop(name) for name in _OF_SHOW if name in left}
    return scene, left, shown


def show(
    what: Any, *, clip: Any = None, lines: Any = None, ghost: Any = None, screenshot: Any = None,
    progress: Progress = None, **options: Any,
) -> Any:  # fmt: skip
    """Show one thing in a window or a notebook, or write its picture.

    Parameters
    ----------
    what : object
        As for `Scene.add`, or a `Scene`.
    clip : str or box, optional
        As for `Scene.clipped`.
    lines, ghost : object, optional
        As for `Scene.lines` and `Scene.ghost`.
    screenshot : path-like, optional
        File for the picture, which is not shown then.
    progress : bool or callable, optional
        "scene" and "picture"; see `ilattice._progress.track`.
    **options
        Of `Scene` (``size``, ``view``, ``title``, ...), of `Scene.add` (``scalars``, ``color``,
        ``cmap``, ...) and of ``pyvista.Plotter.show``.

    Returns
    -------
    object
        What pyvista returns, None for a file.
    """
    of_scene, of_layer, of_show = split(options)

    def made() -> Scene:
        scene = what if isinstance(what, Scene) else Scene(**of_scene).add(what, **of_layer)
        scene = scene if lines is None else scene.lines(lines, color="dimgray")
        scene = scene if ghost is None else scene.ghost(ghost)
        return scene if clip is None else scene.clipped(clip)

    (scene,) = staged({"scene": made}, progress)
    if screenshot is not None:
        staged({"picture": lambda: scene.save(screenshot)}, progress)
        return None
    return staged({"picture": lambda: scene.show(**of_show)}, progress)[0]
