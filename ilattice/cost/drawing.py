"""Pictures of structures: edges as tubes, coloured by what is told of them.

Guarantee: compression is blue and tension red, on a scale that is symmetric about zero. Needs
nothing but pyvista.
"""

from typing import Any

import numpy as np

from ilattice._typing import ArrayLike
from ilattice._validate import as_array, as_flag, as_kind
from ilattice.cost.structure import CornerSharing
from ilattice.errors import InputError


def plot(
    k: CornerSharing, *, values: ArrayLike | None = None, radius: float | None = None,
    filled: bool = False, **options: Any,
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
    **options
        Of ``pyvista.Plotter.show``, and ``off_screen``: ``screenshot="file.png"``.

    Returns
    -------
    object
        What pyvista returns.
    """
    import pyvista

    as_kind("k", k, "CornerSharing")
    x = np.pad(k.positions, ((0, 0), (0, 3 - k.dim)))
    thick = 0.05 * float(k.lengths.mean()) if radius is None else radius
    off = bool(options.pop("off_screen", "screenshot" in options))
    show = pyvista.Plotter(off_screen=off)
    show.set_background("white")
    e = np.array(k.edges)
    lines = pyvista.PolyData(x, lines=np.insert(e, 0, 2, axis=1).ravel())
    if values is None:
        show.add_mesh(lines.tube(radius=thick), color="#4477aa")
    else:
        v = as_array("values", values, ndim=1)
        if v.shape != (len(e),):
            raise InputError(f"values must have shape ({len(e)},), got {v.shape}")
        most = float(np.abs(v).max()) or 1.0
        for low, high, part in ((0.0, 0.05, 0.4), (0.05, 0.3, 1.0), (0.3, 1.1, 2.0)):
            some = (np.abs(v) >= low * most) & (np.abs(v) < high * most)
            if some.any():
                piece = pyvista.PolyData(x, lines=np.insert(e[some], 0, 2, axis=1).ravel())
                piece.cell_data["force"] = v[some]
                show.add_mesh(
                    piece.tube(radius=part * thick), scalars="force", cmap="coolwarm",
                    clim=(-most, most),
                )  # fmt: skip
    if as_flag("filled", filled):
        sides = [np.delete(k.simplices, j, axis=1) for j in range(4)] if k.dim == 3 else []
        corners = np.concatenate(sides) if sides else k.simplices
        faces = pyvista.PolyData(x, np.insert(corners, 0, 3, axis=1).ravel())
        show.add_mesh(faces, color="#ddaa33", opacity=1.0 if k.dim == 3 else 0.6)
    if k.dim == 2:
        show.view_xy()
    return show.show(**options)
