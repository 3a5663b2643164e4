"""Several scenes in one picture or window.

Guarantee: the same quantity has the same colours in all of them, and one colour bar.
"""

import os
from dataclasses import dataclass, replace
from typing import Any

from ilattice._shown import Shown
from ilattice._typing import AnyArray
from ilattice._validate import as_whole
from ilattice.errors import InputError
from ilattice.plot import overlays, render
from ilattice.plot.scene import Scene

#: Pixels of a panel.
_PANEL = (900, 760)


@dataclass(frozen=True, eq=False)
class Panels(Shown):
    """Scenes side by side, in one window or picture.

    Parameters
    ----------
    scenes : sequence of Scene
        From the upper left; their sizes do not count.
    columns : int, optional
        How many in a row; by default all.
    labels : bool
        Letter them (a), (b), ...; their titles are shown, too.
    linked : bool
        All from the view of the first.
    size : (int, int), optional
        Of the picture in pixels.

    Notes
    -----
    Scenes with the same colour bar share one and its limits.
    """

    scenes: tuple[Scene, ...]
    columns: int | None = None
    labels: bool = False
    linked: bool = False
    size: tuple[int, int] | None = None

    def __post_init__(self) -> None:
        scenes = tuple(self.scenes)
        if not scenes or not all(isinstance(scene, Scene) for scene in scenes):
            raise InputError("scenes must be scenes, at least one")
        if self.linked:
            scenes = tuple(replace(s, view=scenes[0].view, zoom=scenes[0].zoom) for s in scenes)
        object.__setattr__(self, "scenes", scenes)
        if self.size is not None:
            object.__setattr__(self, "size", render.as_size(self.size))
        if self.columns is not None:
            object.__setattr__(self, "columns", as_whole("columns", self.columns, 1, 99))

    @property
    def shape(self) -> tuple[int, int]:
        """Rows and columns."""
        columns = min(self.columns or len(self.scenes), len(self.scenes))
        return -(-len(self.scenes) // columns), columns

    @property
    def _pixels(self) -> tuple[int, int]:
        rows, columns = self.shape
        return self.size or (_PANEL[0] * columns, _PANEL[1] * rows)

    def image(self) -> AnyArray:
        """The picture.

        Returns
        -------
        ndarray of uint8, shape (height, width, 3)
            Its pixels.
        """
        return render.image(self.scenes, self.shape, self._pixels, labels=self.labels)

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write the picture, as `Scene.save`.

        Parameters
        ----------
        path : path-like
            Ending in .png or .jpg.
        """
        render.save(self, self.scenes, self.shape, self._pixels, path, labels=self.labels)

    def show(self, **options: Any) -> Any:
        """Show them in a window or a notebook.

        Parameters
        ----------
        **options
            Passed to ``pyvista.Plotter.show``, and ``off_screen``.

        Returns
        -------
        object
            What pyvista returns.
        """
        return render.show(self.scenes, self.shape, self._pixels, options, labels=self.labels)

    def _repr_png_(self) -> bytes:
        return overlays.png(self.image())
