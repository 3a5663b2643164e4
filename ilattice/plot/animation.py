"""Films of scenes: GIF, and MP4 where imageio has its encoder.

Guarantees: all pictures are seen from where the first is and in one frame, so that nothing jumps;
files are whole or not there.
"""

import os
from collections.abc import Iterable
from dataclasses import replace
from pathlib import Path

import numpy as np

from ilattice._files import as_path, atomic_path
from ilattice._progress import Progress, track
from ilattice._validate import as_positive
from ilattice.errors import FormatError, InputError
from ilattice.plot.scene import Scene


def animate(
    scenes: Iterable[Scene], path: str | os.PathLike[str], *, fps: float = 20.0,
    still: bool = True, progress: Progress = None,
) -> None:  # fmt: skip
    """Write scenes one after the other into a film.

    Parameters
    ----------
    scenes : iterable of Scene
        Such as `Scene.turntable`, or the modes of a vibration.
    path : path-like
        Ending in .gif or, after ``pip install imageio-ffmpeg``, .mp4.
    fps : float
        Pictures per second.
    still : bool
        One frame for all, from what is seen in any of them.
    progress : bool or callable, optional
        See `ilattice._progress.track`.

    Raises
    ------
    FormatError
        If the ending is another, the encoder is missing, or the file cannot be written.
    """
    fps = as_positive("fps", fps)
    ending = film_of(path)
    shown = list(scenes)
    if not shown:
        raise InputError("scenes are empty: nothing to show")
    if still:
        points = np.vstack([_extent(scene) for scene in shown])
        box = np.array([points.min(axis=0), points.max(axis=0)])
        shown = [replace(scene, box=box, size=shown[0].size) for scene in shown]
    pictures = [scene.image() for scene in track(shown, "pictures", progress)]
    with atomic_path(path) as temporary:
        if ending == ".gif":
            _gif(pictures, temporary, fps)
        else:
            _mp4(pictures, temporary, fps)


def film_of(path: str | os.PathLike[str]) -> str:
    """Ending of the file of a film, .gif or .mp4, or the error that says so."""
    ending = as_path("path", path).suffix.lower()
    if ending not in (".gif", ".mp4"):
        raise FormatError(f"{path!s:.80}: films are .gif or .mp4")
    return ending


def _extent(scene: Scene) -> np.ndarray:
    points = scene.corners()
    return np.array([points.min(axis=0), points.max(axis=0)])


def _gif(pictures: list[np.ndarray], path: Path, fps: float) -> None:
    from PIL import Image

    frames = [Image.fromarray(p).quantize(128) for p in pictures]
    frames[0].save(
        path, format="GIF", save_all=True, append_images=frames[1:], duration=1000.0 / fps, loop=0
    )


def _mp4(pictures: list[np.ndarray], path: Path, fps: float) -> None:
    try:
        import imageio_ffmpeg
    except ImportError:
        raise FormatError("films in .mp4 need pip install imageio-ffmpeg; .gif does not") from None
    height, width = (2 * (n // 2) for n in pictures[0].shape[:2])  # as the encoder wants it
    writer = imageio_ffmpeg.write_frames(str(path), (width, height), fps=fps, macro_block_size=2)
    writer.send(None)
    for picture in pictures:
        writer.send(np.ascontiguousarray(picture[:height, :width]))
    writer.close()
