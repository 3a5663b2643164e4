"""Results one after the other: panels, films, and one file for ParaView.

Guarantees: all results of a series are in one scale of colours; the one file of a series is written
last, so that it names files that are there.
"""

from collections.abc import Mapping, Sequence
from os import PathLike
from pathlib import Path
from typing import Any, TypeVar, overload

import numpy as np

from ilattice._progress import Progress, track
from ilattice._typing import FloatArray
from ilattice._validate import FrozenCopies, as_index, as_whole
from ilattice.cutfem.output import Result
from ilattice.cutfem.shapes import shape_of
from ilattice.errors import FormatError, InputError
from ilattice.io.vtk import write_pvd
from ilattice.plot import Panels, Scene, animate
from ilattice.plot.animation import film_of
from ilattice.plot.quick import split

R = TypeVar("R", bound=Result)


class Series(FrozenCopies, Sequence[R]):
    """Results one after the other: a sequence that is one file for ParaView."""

    def __repr__(self) -> str:
        ends = " to ".join(self[k]._title() for k in (0, -1) if len(self))
        return f"{type(self).__name__}({len(self)} results: {ends})"

    @property
    def times(self) -> FloatArray:
        """Where the results are on the time line of a viewer, shape (len,)."""
        return np.arange(len(self), dtype=np.float64)

    def _result(self, number: int) -> R:
        raise NotImplementedError

    @overload
    def __getitem__(self, index: int) -> R: ...
    @overload
    def __getitem__(self, index: slice) -> tuple[R, ...]: ...
    def __getitem__(self, index: int | slice) -> R | tuple[R, ...]:
        if isinstance(index, slice):
            return tuple(self._result(k) for k in range(len(self))[index])
        return self._result(range(len(self))[as_index("index", index)])

    def plot(
        self, *, most: int = 6, on: str = "auto", h: float | None = None,
        scale: float | str = "auto", screenshot: "str | PathLike[str] | None" = None,
        **options: Any,
    ) -> Any:  # fmt: skip
        """Show several results side by side, in one scale of colours.

        Parameters
        ----------
        most : int
            How many, evenly from the first to the last.
        on, h, scale : str, float
            As in `Result.plot`.
        screenshot : path-like, optional
            File for the picture, which is not shown then.
        **options
            Of `ilattice.plot.Scene` and its `add`, and ``size``, that of the whole picture.

        Returns
        -------
        object
            What pyvista returns, None for a file.
        """
        count = min(as_whole("most", most, 1, 99), len(self))
        which = np.unique(np.linspace(0, len(self) - 1, count).round().astype(int)).tolist()
        of_scene, of_layer, of_show = split(options)
        size = of_scene.pop("size", None)
        scenes = self._scenes(which, of_scene, of_layer, on=on, h=h, scale=scale)
        panels = Panels(tuple(scenes), columns=min(3, len(scenes)), size=size)
        return panels.show(**of_show) if screenshot is None else panels.save(screenshot)

    def animate(
        self, path: "str | PathLike[str]", *, on: str = "auto", h: float | None = None,
        scale: float | str = "auto", fps: float = 12.0, progress: Progress = None,
        **options: Any,
    ) -> None:  # fmt: skip
        """Write a film of the results, one picture each, in one scale of colours.

        Parameters
        ----------
        path : path-like
            Ending in .gif, or .mp4; see `ilattice.plot.animate`.
        on, h, scale : str, float
            As in `Result.plot`.
        fps : float
            Pictures per second.
        progress : bool or callable, optional
            See `ilattice._progress.track`.
        **options
            Of `ilattice.plot.Scene` and its `add`.
        """
        film_of(path)
        of_scene, of_layer, _ = split(options)
        of_scene = {"size": (800, 600), **of_scene}
        which = list(range(len(self)))
        scenes = self._scenes(which, of_scene, of_layer, on=on, h=h, scale=scale)
        animate(scenes, path, fps=fps, progress=progress)

    def _scenes(
        self, which: Sequence[int], of_scene: Mapping[str, Any], of_layer: Mapping[str, Any],
        **how: Any,
    ) -> list[Scene]:  # fmt: skip
        """Some of the results, in one scale of colours."""
        grids = [self[k].to_pyvista(how["on"], h=how["h"], scale=how["scale"]) for k in which]
        of_layer = {"scalars": self[0].shown, **of_layer}
        shown = [np.asarray(grid[of_layer["scalars"]], float) for grid in grids]
        sizes = [np.linalg.norm(a, axis=1) if a.ndim == 2 else a for a in shown]
        limits = (min(np.nanmin(a) for a in sizes), max(np.nanmax(a) for a in sizes))
        return [
            Scene(**{"title": self[k]._title(), **of_scene}).add(
                grid, **{"clim": limits, **of_layer}
            )
            for k, grid in zip(which, grids, strict=True)
        ]

    def save(
        self, path: "str | PathLike[str]", *, on: str = "auto", h: float | None = None,
        scale: float | str = 0.0, progress: Progress = None,
    ) -> None:  # fmt: skip
        """Write a PVD file for ParaView, and a VTU file per result in a folder beside it.

        Parameters
        ----------
        path : path-like
            File ending in ``.pvd``; those of ``modes.pvd`` are ``modes/modes_0000.vtu``, ...
        on, h : str, float
            As in `Solution.to_pyvista`; the mesh is made once.
        scale : float or "auto"
            As in `Solution.surface`.
        progress : bool or callable, optional
            See `ilattice._progress.track`.

        Raises
        ------
        InputError
            If an argument is wrong.
        FormatError
            Another ending, or a file cannot be written.
        """
        if not isinstance(path, (str, PathLike)):
            raise InputError(f"path must be a file name, got {path!r:.80}")
        target = Path(path)
        if target.suffix != ".pvd":
            raise FormatError(f"{str(path)!r}: series are written as .pvd")
        shape, folder = shape_of(self[0].problem, on, h), target.with_suffix("")
        files = [folder / f"{target.stem}_{k:04d}.vtu" for k in range(len(self))]
        try:
            folder.mkdir(exist_ok=True)
        except OSError as e:
            raise FormatError(f"{str(folder)!r}: cannot be made: {e.strerror}") from e
        for k, file in track(enumerate(files), "save", progress, total=len(files)):
            self[k]._write(file, shape, scale)
        write_pvd(path, files, self.times)
