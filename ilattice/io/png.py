"""PNG pictures of meshes, rendered without a window.

Guarantee: works without a display where VTK finds EGL or OSMesa. Not guaranteed: equal pixels on
different machines.
"""

import os
from typing import Any

from ilattice._files import atomic_write
from ilattice.io._mesh import Triangles, check_mesh
from ilattice.plot import Scene
from ilattice.plot.overlays import png
from ilattice.plot.quick import split
from ilattice.plot.shapes import triangles


def write_png(
    mesh: Triangles,
    path: str | os.PathLike[str],
    *,
    clip: Any = None,
    scalars: str | None = None,
    **options: Any,
) -> None:
    """Render a mesh into a PNG file.

    Parameters
    ----------
    mesh : SurfaceMesh
        The mesh; coloured by `scalars`, else by ``r``, ``g``, ``b``, else in one colour.
    path : path-like
        File to create or to replace.
    clip : str or box, optional
        What is shown of it, such as ``"y > 0"``; see `ilattice.plot.Scene.clipped`.
    scalars : str, optional
        Name of point or cell data to colour by.
    **options
        Of `ilattice.plot.Scene`: ``size``, ``view``, ``zoom``, ``background``, ``parallel``, ...,
        and of its `add`: ``color``, ``cmap``, ``clim``, ``unit``, ...

    Raises
    ------
    GeometryError
        If the mesh is empty.
    InputError
        Unknown `scalars` or `view`, or a `size` or `zoom` that is not positive.
    FormatError
        If the file cannot be written.
    """
    check_mesh(mesh)
    of_scene, of_layer, _ = split(options)
    data = triangles(mesh.vertices, mesh.faces, mesh.point_data, mesh.cell_data)
    scene = Scene(**of_scene).add(data, scalars=scalars, **of_layer)
    picture = png((scene if clip is None else scene.clipped(clip)).image())
    with atomic_write(path) as file:
        file.write(picture)
