"""Single parts of a picture: what is drawn, and how it looks.

Guarantees: what is given is copied or left alone; colours that are data are drawn in light that is
nearly flat, so that a colour of the bar is that colour on the part, up to a seventh darker on the
far side; ``flat=True`` and a scene without occlusion leave no shade at all. Anything with a method
``to_pyvista`` can be drawn, datasets of pyvista, and points.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from ilattice._typing import FloatArray
from ilattice._validate import as_array, near_names
from ilattice.errors import InputError

#: Triangles up to which normals at vertices are drawn.
_SMOOTH_UP_TO = 2_000_000
_CREASE = 40.0  # degrees between normals from which an edge is drawn sharp
#: Of parts in a colour of their own, and of colours that are data.
MATERIAL = {"ambient": 0.22, "diffuse": 0.78, "specular": 0.18, "specular_power": 25.0}
FLAT = {"ambient": 0.86, "diffuse": 0.18, "specular": 0.0}
UNLIT = {"lighting": False, "ambient": 0.0, "diffuse": 1.0, "specular": 0.0}
COLOUR, CAP, GHOST = "#d9b382", "#b5651d", "#8fa3b5"
#: Titles of colour bars: names of data in the symbols of the field.
SYMBOLS = {
    "displacement": "displace-\nment u", "von_mises": "von Mises stress", "temperature": "T",
    "half_thickness": "half-thickness d", "thickness": "thickness 2d",
    "signed_distance": "signed distance", "young": "E", "E": "E",
    "heat_flux": "heat flux q", "curvature": "mean curvature H",
}  # fmt: skip


@dataclass(frozen=True, eq=False)
class Layer:
    """One thing in a picture.

    Attributes
    ----------
    data : pyvista.DataSet
        What is drawn.
    style : mapping
        Options of ``pyvista.Plotter.add_mesh``.
    title : str
        Of its colour bar; empty without one.
    clip : bool
        Whether clips cut it.
    cap : str
        Colour of the faces where it is cut.
    legend : str
        What a legend calls it; empty without one.
    """

    data: Any
    style: Mapping[str, Any]
    title: str = ""
    clip: bool = True
    cap: str = CAP
    legend: str = ""


def as_dataset(what: Any) -> Any:
    """A dataset of pyvista for a thing that can be drawn.

    Raises
    ------
    InputError
        If it cannot be drawn, or nothing is in it.
    """
    import pyvista as pv

    if hasattr(what, "to_pyvista"):
        data = what.to_pyvista()
    elif isinstance(what, pv.DataSet):
        data = what.copy()
    elif isinstance(what, np.ndarray | list | tuple):
        points = as_array("what", what)
        if points.ndim != 2 or points.shape[1] != 3:
            raise InputError(f"points must have shape (n, 3), got {points.shape}")
        data = pv.PolyData(points) if len(points) else pv.PolyData()
    else:
        raise InputError(
            f"{type(what).__name__} cannot be drawn: give a mesh, a solution or anything with "
            "to_pyvista(), a dataset of pyvista, or points (n, 3)"
        )
    lost = int((~np.isfinite(data.points).all(axis=1)).sum())
    if lost:
        raise InputError(
            f"{lost} of {data.n_points} points of {type(what).__name__} are not finite: "
            "nothing could be seen"
        )
    if data.n_points == 0:
        raise InputError(f"{type(what).__name__} is empty: nothing to draw")
    return data


def balls(data: Any, radius: float) -> Any:
    """Spheres about points."""
    import pyvista as pv

    ball = pv.Sphere(radius=radius, theta_resolution=24, phi_resolution=16)
    return data.glyph(scale=False, orient=False, geom=ball)


def made(
    data: Any, *, color: str | None, scalars: str | None, label: str | None, unit: str,
    flat: bool | None, clip: bool, cap: str | None, legend: str, options: Mapping[str, Any],
) -> Layer:  # fmt: skip
    """A layer of a dataset, with the looks that its data ask for."""
    style = _shading(data)
    title = ""
    if scalars is not None:
        names = [*data.point_data.keys(), *data.cell_data.keys()]
        _add_component(data, scalars)
        if scalars not in names and scalars not in data.point_data:
            near = near_names(str(scalars), names)
            raise InputError(
                f"scalars {scalars!r:.80} are not in the data; "
                f"{f'there is {near}' if near else 'there are none'}"
            )
        title = label if label is not None else SYMBOLS.get(scalars, scalars.replace("_", " "))
        title = f"{title} ({unit})" if unit and title else title
        style |= {"scalars": scalars, "show_scalar_bar": False, "cmap": "viridis"}
        if options.get("cmap") == "depth":
            options = {**options, "cmap": _depth()}
    elif color is None and (rgb := _own_colours(data)) is not None:
        data.point_data["_rgb"] = rgb
        style |= {"scalars": "_rgb", "rgb": True}
    else:
        style |= {"color": color if color is not None else COLOUR}
    style |= UNLIT if flat else MATERIAL if flat is False or scalars is None else FLAT
    _check_options(options)
    if scalars is not None:
        cap = cap if cap is not None else "#9a9a9a"
    return Layer(data, {**style, **options}, title, clip, cap if cap is not None else CAP, legend)


#: Names of the entries of symmetric matrices and of vectors.
_ENTRIES = {6: ("xx", "yy", "zz", "yz", "xz", "xy"), 3: ("x", "y", "z")}


def _add_component(data: Any, scalars: str) -> None:
    """An entry such as ``stress_xx`` of data with several, as data of its own."""
    known = data.point_data
    if scalars in known and np.ndim(known[scalars]) == 2 and known[scalars].shape[1] == 6:
        names = ", ".join(f"{scalars}_{end}" for end in _ENTRIES[6])
        more = " or von_mises" if "von_mises" in known else ""
        raise InputError(f"scalars {scalars!r} has six entries: take one of {names}{more}")
    name, _, end = scalars.rpartition("_")
    if scalars in known or name not in known or np.ndim(known[name]) != 2:
        return
    ends = _ENTRIES.get(known[name].shape[1], ())
    if end in ends:
        known[scalars] = np.ascontiguousarray(known[name][:, ends.index(end)])


def _check_options(options: Mapping[str, Any]) -> None:
    """Refuse options that pyvista does not have, and maps of colours that nobody knows."""
    import inspect

    import pyvista as pv
    from pyvista.plotting.colors import get_cmap_safe

    known = [*inspect.signature(pv.Plotter.add_mesh).parameters][2:]
    for name in options:
        if name not in known:
            raise InputError(
                f"{name} is no option of pictures: near it are {near_names(name, known)}"
            )
    opacity = options.get("opacity", 1.0)
    if isinstance(opacity, int | float) and not 0.0 <= opacity <= 1.0:
        raise InputError(f"opacity must be from 0, invisible, to 1, solid, got {opacity!r}")
    if isinstance(options.get("cmap"), str):
        try:
            get_cmap_safe(options["cmap"])
        except (ValueError, TypeError, ImportError):
            raise InputError(
                f"cmap {options['cmap']!r:.80} is no map of colours: take one of matplotlib, such "
                "as 'viridis', 'coolwarm' or 'gray', or 'depth'"
            ) from None


def _depth() -> Any:
    """White, brown, white: of what is deep in a wall."""
    from matplotlib.colors import LinearSegmentedColormap

    return LinearSegmentedColormap.from_list("depth", ["#fbf7f0", "#6b3a12", "#fbf7f0"])


def _shading(data: Any) -> dict[str, Any]:
    import pyvista as pv

    if not isinstance(data, pv.PolyData) or data.n_faces == 0:
        return {}
    smooth = data.n_cells <= _SMOOTH_UP_TO
    return {"smooth_shading": smooth, "split_sharp_edges": smooth, "feature_angle": _CREASE}


def _own_colours(data: Any) -> FloatArray | None:
    """The part's own colours as bytes, (n, 3), if it has r, g and b."""
    if not all(name in data.point_data for name in "rgb"):
        return None
    c = np.stack([np.asarray(data.point_data[name]) for name in "rgb"], axis=1)
    if c.ndim != 2:
        return None
    return c if c.dtype == np.uint8 else np.rint(np.clip(c, 0, 1) * 255).astype(np.uint8)
