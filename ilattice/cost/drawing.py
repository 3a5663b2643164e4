"""Pictures of structures: edges as tubes, coloured by what is told of them.

Guarantee: compression is blue and tension red, on a scale that is symmetric about zero,
or begins there if nothing is negative.
"""

from typing import Any

import numpy as np

from ilattice._typing import ArrayLike, FloatArray
from ilattice._validate import as_array, as_flag, as_kind, as_positive
from ilattice.cost._structure import Structure
from ilattice.errors import InputError
from ilattice.plot import quick
from ilattice.plot.scene import Scene
from ilattice.plot.shapes import segments

#: Colour of edges and of simplices.
EDGES, SIMPLICES = "#4477aa", "#ddaa33"
#: Edges whose values are from and to these parts of the largest have tubes of so many radii.
THICKNESS = ((0.0, 0.05, 0.4), (0.05, 0.3, 1.0), (0.3, 1.1, 2.0))


def plot(
    k: Structure, *, values: ArrayLike | None = None, radius: float | None = None,
    filled: bool = False, screenshot: Any = None, label: str = "force", **options: Any,
) -> Any:  # fmt: skip
    """Show a structure in a window, a notebook, or a file.

    Parameters
    ----------
    k : CornerSharing
        The structure.
    values : array_like, shape (e,), optional
        Numbers for the edges, such as forces: they colour them and, larger ones, thicken them.
    radius : float, optional
        Of the tubes; default a twentieth of the mean length of edges.
    filled : bool
        Draw the simplices as solids.
    screenshot : path-like, optional
        File for the picture, which is not shown then.
    label : str
        Title of the colour bar.
    **options
        Of `ilattice.plot.Scene` (``size``, ``view``, ``title``, ...) and of showing it.

    Returns
    -------
    object
        What pyvista returns, None for a file.
    """
    of_scene, unknown, of_show = quick.split(options)
    if unknown:
        raise InputError(f"plot has no option {next(iter(unknown))!r}")
    return quick.show(
        drawn(k, values=values, radius=radius, filled=filled, label=label, **of_scene),
        screenshot=screenshot, **of_show,
    )  # fmt: skip


def drawn(
    k: Structure, *, values: ArrayLike | None = None, radius: float | None = None,
    filled: bool = False, label: str = "force", **options: Any,
) -> Scene:  # fmt: skip
    """The scene that `plot` shows.

    Parameters
    ----------
    k, values, radius, filled, label : optional
        See `plot`.
    **options
        Of `ilattice.plot.Scene`.

    Returns
    -------
    Scene
        With edges and simplices; structures in the plane are seen from above.
    """
    as_kind("k", k, "CornerSharing")
    x = np.pad(k.positions, ((0, 0), (0, 3 - k.dim)))
    e = np.array(k.edges)
    if not len(e):
        raise InputError("the structure has no edges: there is nothing to draw")
    thick = 0.05 * float(k.lengths.mean()) if radius is None else as_positive("radius", radius)
    flat: dict[str, Any] = (
        {"view": "top", "parallel": True, "occlusion": False} if k.dim == 2 else {}
    )
    scene = Scene(**(flat | options))
    if values is None:
        scene = scene.add(segments(x, e).tube(radius=thick), color=EDGES)
    else:
        v = as_array("values", values, ndim=1)
        if v.shape != (len(e),):
            raise InputError(f"values must have shape ({len(e)},), got {v.shape}")
        most = float(np.abs(v).max()) or 1.0
        for low, high, part in THICKNESS:
            some = (np.abs(v) >= low * most) & (np.abs(v) < high * most)
            if some.any():
                piece = segments(x, e[some])
                piece.cell_data[label] = v[some]
                scene = scene.add(piece.tube(radius=part * thick), scalars=label, **_colours(v))
    if as_flag("filled", filled):
        scene = scene.add(_simplices(k, x), color=SIMPLICES, opacity=1.0 if k.dim == 3 else 0.6)
    return scene


def _colours(values: FloatArray) -> dict[str, Any]:
    """Blue below 0 and red above; the bar begins at 0, at the same grey, if nothing is below."""
    most = float(np.abs(values).max()) or 1.0
    if values.min() < 0.0:
        return {"cmap": "coolwarm", "clim": (-most, most)}
    from matplotlib import colormaps
    from matplotlib.colors import ListedColormap

    half = colormaps["coolwarm"](np.linspace(0.5, 1.0, 256))
    return {"cmap": ListedColormap(half, name="grey to red"), "clim": (0.0, most)}


def _simplices(k: Structure, x: Any) -> Any:
    """Triangles, or the faces of tetrahedra."""
    import pyvista

    sides = [np.delete(k.simplices, j, axis=1) for j in range(4)] if k.dim == 3 else []
    corners = np.concatenate(sides) if sides else k.simplices
    return pyvista.PolyData(x, np.insert(corners, 0, 3, axis=1).ravel())
