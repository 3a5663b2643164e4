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
from pathlib import Path
from typing import Any

import numpy as np

from ilattice._typing import AnyArray, FloatArray
from ilattice._validate import as_array, as_flag, as_positive
from ilattice._vtk import quiet_vtk
from ilattice.errors import FormatError, InputError
from ilattice.plot import camera, overlays, styles
from ilattice.plot.clips import as_planes, clipped
from ilattice.plot.styles import Layer

_BAR, _HEAD = 0.17, 0.07  # parts of the width for a colour bar, and of the height for a title
_OCCLUSION = 0.04  # reach of the ambient occlusion, in units of the part's size
_PANEL = (900, 760)


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

    Notes
    -----
    Immutable: every verb returns another scene.

    Examples
    --------
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
    layers: tuple[Layer, ...] = ()
    planes: FloatArray | None = None
    box: FloatArray | None = None
    insets: tuple[tuple["Scene", tuple[float, float, float, float]], ...] = ()
    axes: bool = False
    scale_bar: bool = False
    unit: str = ""

    def __post_init__(self) -> None:
        object.__setattr__(self, "size", _as_size(self.size))
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
            Name of the point or cell data by which it is coloured.
        label, unit : str
            Title of the colour bar (by default the quantity's symbol), empty for none, and unit.
        flat : bool, optional
            Whether light is flat; by default where colours are data.
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
        return replace(self, insets=(*self.insets, (scene, tuple(map(float, at)))))

    # --- out of it ----------------------------------------------------------------------------

    def image(self) -> AnyArray:
        """The picture.

        Returns
        -------
        ndarray of uint8, shape (height, width, 3)
            Its pixels.
        """
        picture = _rendered(Panels((self,)), self.size)
        for scene, place in self.insets:
            picture = overlays.pasted(picture, scene, place)
        return picture

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
        _save(self, path)

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
        return Panels((self,)).show(**options)

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
        """Points that have to be in the picture, shape (n, 3)."""
        if self.box is not None:
            return overlays.corners(self.box)
        points = [np.asarray(data.points, float) for data, _, _ in self.pieces()]
        if not points:
            raise InputError("the scene is empty, or all of it is clipped away: nothing to show")
        return np.vstack(points)

    def pieces(self) -> list[tuple[Any, Mapping[str, Any], Layer]]:
        """Datasets after clipping, with their styles, and the layers they come from."""
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


@dataclass(frozen=True, eq=False)
class Panels:
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

    @property
    def shape(self) -> tuple[int, int]:
        """Rows and columns."""
        columns = min(self.columns or len(self.scenes), len(self.scenes))
        return -(-len(self.scenes) // columns), columns

    def image(self) -> AnyArray:
        """The picture.

        Returns
        -------
        ndarray of uint8, shape (height, width, 3)
            Its pixels.
        """
        rows, columns = self.shape
        return _rendered(self, self.size or (_PANEL[0] * columns, _PANEL[1] * rows))

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write the picture, as `Scene.save`.

        Parameters
        ----------
        path : path-like
            Ending in .png or .jpg.
        """
        _save(self, path)

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
        off_screen = options.pop("off_screen", None)
        if "screenshot" in options:
            options["screenshot"] = os.fspath(options["screenshot"])
        with quiet_vtk():
            size = options.pop("window_size", None) or self.size or self.scenes[0].size
            plotter = drawn(self, _as_size(size), off_screen=off_screen)
            return plotter.show(**options)

    def _repr_png_(self) -> bytes:
        return overlays.png(self.image())


def drawn(panels: Panels, size: tuple[int, int], *, off_screen: bool | None = True) -> Any:
    """A plotter of pyvista with everything in it."""
    import pyvista as pv

    rows, columns = panels.shape
    options: dict[str, Any] = {"off_screen": off_screen} if off_screen is not None else {}
    plotter = pv.Plotter(
        window_size=list(size), shape=(rows, columns), border=False, lighting="none", **options
    )
    limits = overlays.shared_limits([scene.layers for scene in panels.scenes])
    last = {layer.title: i for i, scene in enumerate(panels.scenes) for layer in scene.layers}
    aspect = size[0] * rows / (size[1] * columns)
    for i, scene in enumerate(panels.scenes):
        plotter.subplot(i // columns, i % columns)
        title = f"({chr(97 + i)}) {scene.title}" if panels.labels else scene.title
        bars = {name for name, at in last.items() if name and at == i}
        _draw(plotter, scene, limits, aspect, bars, room=1.0 - (_HEAD if title else 0.0))
        if title:
            plotter.add_text(title, position="upper_edge", font_size=11, color="black")
    plotter.enable_anti_aliasing("ssaa", all_renderers=True)
    return plotter


def _draw(
    plotter: Any, scene: Scene, limits: Mapping[str, Any], aspect: float, bars: set[str], *,
    room: float,
) -> None:  # fmt: skip
    """One panel; the colour bars named are drawn in it, `room` is the height below the title."""
    points, bar = scene.corners(), None
    plotter.set_background(scene.background, all_renderers=False)
    for data, style, layer in scene.pieces():
        name = style.get("scalars")
        limited = {"clim": limits[name]} if layer.title and name in limits else {}
        actor = plotter.add_mesh(data, reset_camera=False, **{**limited, **style})
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
        overlays.colour_bar(plotter, *bar)
    entries = [[a.legend, a.style["color"]] for a in scene.layers if a.legend]
    if entries:
        plotter.add_legend(entries, bcolor=None, face="circle", size=(0.18, 0.05 * len(entries)))
    if scene.axes:
        plotter.add_axes(color="black")
    if scene.occlusion:
        reach = max(_OCCLUSION * float(np.ptp(points, axis=0).max()), 1e-30)
        plotter.enable_ssao(radius=reach, bias=0.08 * reach, kernel_size=32, blur=True)


def _rendered(panels: Panels, size: tuple[int, int]) -> AnyArray:
    """Pixels, shape (height, width, 3)."""
    with quiet_vtk():  # VTK warns about the missing display before it falls back to EGL
        plotter = drawn(panels, size)
        try:
            return np.asarray(plotter.screenshot(return_img=True))
        finally:
            plotter.close()


def _save(picture: Scene | Panels, path: str | os.PathLike[str]) -> None:
    ending = Path(os.fspath(path)).suffix.lower()
    if ending in (".png", ".jpg", ".jpeg"):
        overlays.write(picture.image(), path)
        return
    if ending not in (".gltf", ".html"):
        raise FormatError(f"{path!s:.80}: pictures are .png or .jpg, scenes .gltf or .html")
    panels = picture if isinstance(picture, Panels) else Panels((picture,))
    with quiet_vtk():
        plotter = drawn(panels, panels.size or panels.scenes[0].size)
        try:
            overlays.export(plotter, path, ending)
        finally:
            plotter.close()


def _as_size(value: Any) -> tuple[int, int]:
    size = as_array("size", value)
    if size.shape != (2,) or (size != np.rint(size)).any() or (size < 1).any():
        raise InputError(
            "size must be width and height in pixels, two whole numbers of at least 1, "
            f"got {value!r:.80}"
        )
    return int(size[0]), int(size[1])


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
