"""Pictures of parts: one way to draw all that this package makes.

A scene is a description: verbs return another one with something more in it, and nothing is
rendered before it is shown or saved. The defaults are for parts with many small holes: ambient
occlusion tells front from back, edges are sharp, and the camera is fitted to what is seen.

Guarantees: works without a display where VTK finds EGL or OSMesa; everything drawn, but for what
is beside the frame given to `Scene.framed`, is in the picture. Not guaranteed: equal pixels on
different machines.
"""

import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from ilattice._conditions import as_planes
from ilattice._typing import AnyArray, FloatArray
from ilattice._validate import as_array, as_flag, as_positive
from ilattice.errors import InputError
from ilattice.plot import camera, overlays, render, styles
from ilattice.plot.clips import clipped
from ilattice.plot.styles import Layer


@dataclass(frozen=True, eq=False)
class Scene:
    """What is in a picture, and from where it is seen.

    Parameters
    ----------
    size : (int, int)
        Width and height in pixels.
    view : (float, float) or {"front", "back", "left", "right", "top", "bottom"}
        Azimuth from the x-axis and elevation of the viewer, in degrees; z is up. From the front
        and the top x points to the right.
    zoom : float
        Magnification; 1 makes the part fill the picture.
    background : str
        Colour of the background.
    parallel : bool
        Without perspective.
    occlusion : bool
        Darken what is deep inside, by screen-space ambient occlusion.
    title : str
        Text at the top.
    axes : bool
        Show the directions x, y and z.
    scale_bar : bool
        Show a length, at the depth of the middle of the part.
    unit : str
        Of lengths, for the scale bar.
    layers, planes, box, insets : optional
        Made by `add`, `clipped`, `framed` and `inset`.

    Notes
    -----
    Immutable: every verb returns another scene.

    Examples
    --------
    >>> import numpy as np
    >>> import ilattice as il
    >>> mesh = il.mesh.contour(lambda x: (x**2).sum(axis=1) - 1, [np.linspace(-1.2, 1.2, 9)] * 3)
    >>> scene = il.plot.Scene(size=(320, 240)).add(mesh, color="gold").clipped("y > 0")
    >>> scene.image().shape
    (240, 320, 3)
    """

    size: tuple[int, int] = (1600, 1200)
    view: Any = (-60.0, 30.0)
    zoom: float = 1.0
    background: str = "white"
    parallel: bool = False
    occlusion: bool = True
    title: str = ""
    axes: bool = False
    scale_bar: bool = False
    unit: str = ""
    layers: tuple[Layer, ...] = ()
    planes: FloatArray | None = None
    box: FloatArray | None = None
    insets: tuple[tuple["Scene", tuple[float, float, float, float]], ...] = ()

    def __post_init__(self) -> None:
        object.__setattr__(self, "size", render.as_size(self.size))
        object.__setattr__(self, "view", camera.as_view(self.view))
        object.__setattr__(self, "zoom", as_positive("zoom", self.zoom))
        _check_colour("background", self.background)
        for name in ("parallel", "occlusion", "axes", "scale_bar"):
            object.__setattr__(self, name, as_flag(name, getattr(self, name)))

    def __repr__(self) -> str:
        return f"Scene({len(self.layers)} layers, {self.size[0]} x {self.size[1]})"

    # --- what is in it ------------------------------------------------------------------------

    def add(
        self, what: Any, *, color: str | None = None, scalars: str | None = None,
        label: str | None = None, unit: str = "", flat: bool | None = None, clip: bool = True,
        cap: str | None = None, radius: float | None = None, legend: str = "", **options: Any,
    ) -> "Scene":  # fmt: skip
        """Another thing in the picture.

        Parameters
        ----------
        what : object
            A `SurfaceMesh`, a solution or anything else with ``to_pyvista()``, a dataset of
            pyvista, or points (n, 3).
        color : str, optional
            Colour; by default the part's own (point data ``r``, ``g``, ``b``), or that of brass.
        scalars : str, optional
            Name of the point or cell data by which it is coloured; of vectors their length, or an
            entry such as ``"displacement_z"`` or ``"stress_xx"``.
        label, unit : str
            Title of the colour bar (by default the quantity's symbol), empty for none, and unit.
        flat : bool, optional
            True for no shade at all, False for that of a material; by default a seventh of shade
            where colours are data.
        clip : bool
            Whether clips of the scene cut it.
        cap : str, optional
            Colour of faces where it is cut.
        radius : float, optional
            Of balls in place of points.
        legend : str
            What a legend calls it.
        **options
            Passed to ``pyvista.Plotter.add_mesh``: ``cmap``, ``clim``, ``opacity``, ...; the map
            ``"depth"`` is brown in its middle and white at both ends.

        Returns
        -------
        Scene
            With it.

        Raises
        ------
        InputError
            If it cannot be drawn, or has no such data.
        """
        if color is not None:
            _check_colour("color", color)
        data = styles.as_dataset(what)
        if radius is not None:
            data = styles.balls(data, as_positive("radius", radius))
        layer = styles.made(
            data, color=color, scalars=scalars, label=label, unit=unit,
            flat=flat, clip=clip, cap=cap, legend=legend, options=options,
        )  # fmt: skip
        return replace(self, layers=(*self.layers, layer))

    def ghost(self, what: Any, *, color: str = styles.GHOST, opacity: float = 0.18) -> "Scene":
        """Another thing, shown as a shadow of itself: a macro-shape, an undeformed state.

        Parameters
        ----------
        what : object
            As for `add`.
        color : str
            Its colour.
        opacity : float
            0 for invisible, 1 for solid.

        Returns
        -------
        Scene
            With it; clips do not cut it.
        """
        return self.add(
            what, color=color, opacity=opacity, clip=False, specular=0.0, show_edges=False
        )

    def lines(self, what: Any, *, color: str = "black", width: float = 2.0) -> "Scene":
        """Lines, such as the cells of a background grid or a marked box.

        Parameters
        ----------
        what : object
            Something with ``to_pyvista()`` or a dataset of pyvista, of which the edges are drawn;
            or a box, its lowest and highest corner.
        color : str
            Their colour.
        width : float
            In pixels.

        Returns
        -------
        Scene
            With them; clips do not cut them.
        """
        import pyvista as pv

        if isinstance(what, np.ndarray | list | tuple):
            lo, hi = _as_box(what)
            what = pv.Box(np.column_stack([lo, hi]).ravel())
        data = styles.as_dataset(what)
        edges = data if _is_lines(data) else data.extract_all_edges()
        return self.add(edges, color=color, line_width=as_positive("width", width), clip=False)

    # --- how it is shown ----------------------------------------------------------------------

    def clipped(self, clip: Any) -> "Scene":
        """Show a part of it only, and what is inside.

        Parameters
        ----------
        clip : str or (2, 3) array-like
            What is kept: linear conditions in x, y, z joined by ``and``, such as ``"y > 0"``, or
            the lowest and highest corner of a box.

        Returns
        -------
        Scene
            Cut, closed surfaces with caps.
        """
        planes = as_planes(clip)
        if self.planes is not None:
            planes = np.vstack([self.planes, planes])
        return replace(self, planes=planes)

    def seen(self, view: Any, *, zoom: float | None = None) -> "Scene":
        """The same from elsewhere.

        Parameters
        ----------
        view : (float, float) or str
            As for the constructor.
        zoom : float, optional
            Magnification.

        Returns
        -------
        Scene
            Seen from there.
        """
        return replace(self, view=view, zoom=self.zoom if zoom is None else zoom)

    def framed(self, box: Any) -> "Scene":
        """With the camera on a box, not on all that is drawn.

        Parameters
        ----------
        box : (2, 3) array-like
            Lowest and highest corner.

        Returns
        -------
        Scene
            Looking at it.
        """
        return replace(self, box=_as_box(box))

    def inset(self, scene: "Scene", place: Sequence[float] = (0.68, 0.68, 0.3, 0.3)) -> "Scene":
        """With another scene in a small frame on top of saved pictures.

        Parameters
        ----------
        scene : Scene
            What is in the frame.
        place : (float, float, float, float)
            Left, lower side, width and height, in parts of the picture.

        Returns
        -------
        Scene
            With it.
        """
        at = as_array("place", place)
        if at.shape != (4,) or not ((at >= 0).all() and (at[2:] > 0).all() and
                                    (at[:2] + at[2:] <= 1).all()):  # fmt: skip
            raise InputError(
                f"place must be left, lower side, width and height within 0 to 1, got {place!r:.80}"
            )
        left, low, width, height = map(float, at)
        return replace(self, insets=(*self.insets, (scene, (left, low, width, height))))

    # --- out of it ----------------------------------------------------------------------------

    def image(self) -> AnyArray:
        """The picture.

        Returns
        -------
        ndarray of uint8, shape (height, width, 3)
            Its pixels.
        """
        picture = render.image([self], (1, 1), self.size)
        for scene, place in self.insets:
            picture = overlays.pasted(picture, scene._sized, place)
        return picture

    def _sized(self, size: tuple[int, int]) -> AnyArray:
        """The picture in another size."""
        return replace(self, size=size).image()

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write the picture, or the scene for the web.

        Parameters
        ----------
        path : path-like
            Ending in .png or .jpg; or in .gltf or .html, to be turned in a browser.

        Raises
        ------
        FormatError
            If the ending is another, or the file cannot be written.
        """
        render.save(self, [self], (1, 1), self.size, path)

    def show(self, **options: Any) -> Any:
        """Show it in a window or a notebook.

        Parameters
        ----------
        **options
            Passed to ``pyvista.Plotter.show``, and ``off_screen``.

        Returns
        -------
        object
            What pyvista returns.
        """
        return render.show([self], (1, 1), self.size, options)

    def turntable(self, frames: int = 60) -> list["Scene"]:
        """The scene from all sides, for `animate`.

        Parameters
        ----------
        frames : int
            How many.

        Returns
        -------
        list of Scene
            Turned once around.
        """
        azimuth, elevation = self.view
        return [
            replace(self, view=(azimuth + 360.0 * i / frames, elevation)) for i in range(frames)
        ]

    def _repr_png_(self) -> bytes:
        return overlays.png(replace(self, size=(800, 600)).image())

    # --- for whoever draws it -----------------------------------------------------------------

    def corners(self) -> FloatArray:
        """Points that have to be in the picture.

        Returns
        -------
        ndarray, shape (n, 3)
            All that are drawn, or the corners of the frame.
        """
        if self.box is not None:
            return overlays.corners(self.box)
        points = [np.asarray(data.points, float) for data, _, _ in self.pieces()]
        if not points:
            raise InputError("the scene is empty, or all of it is clipped away: nothing to show")
        return np.vstack(points)

    def pieces(self) -> list[tuple[Any, Mapping[str, Any], Layer]]:
        """Datasets after clipping, with their styles, and the layers they come from.

        Returns
        -------
        list of (pyvista.DataSet, mapping, Layer)
            Caps follow what they close.
        """
        found: list[tuple[Any, Mapping[str, Any], Layer]] = []
        for layer in self.layers:
            if self.planes is None or not layer.clip:
                found.append((layer.data, layer.style, layer))
                continue
            kept, caps = clipped(layer.data, self.planes)
            if kept.n_points:
                found.append((kept, layer.style, layer))
            if caps is not None:
                found.append((caps, {"color": layer.cap, **styles.FLAT}, layer))
        return found


def _as_box(value: Any) -> FloatArray:
    box = as_array("box", value)
    if box.shape != (2, 3) or not (box[0] <= box[1]).all():
        raise InputError(
            f"box must be its lowest and highest corner, shape (2, 3), got {value!r:.80}"
        )
    return box


def _check_colour(name: str, value: Any) -> None:
    import pyvista as pv

    try:
        pv.Color(value)
    except (ValueError, TypeError):
        raise InputError(
            f"{name} must be a colour such as 'gold' or '#d9b382', got {value!r:.80}"
        ) from None


def _is_lines(data: Any) -> bool:
    import pyvista as pv

    return isinstance(data, pv.PolyData) and data.n_lines > 0 and data.n_faces == 0
