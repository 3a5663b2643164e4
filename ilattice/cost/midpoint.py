"""Corner-sharing structures of meshes: one vertex per face, one simplex per cell; and stacks.

Guarantee: the volume of each simplex is exactly d^-d of that of its cell (paper, Definition 5).
"""

import os
from collections.abc import Sequence
from contextlib import redirect_stderr, redirect_stdout
from io import StringIO
from typing import Any

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import breadth_first_order

from ilattice._files import as_path
from ilattice._typing import ArrayLike, FloatArray, IntArray
from ilattice._validate import as_array, as_items, as_kind
from ilattice.cost.structure import CornerSharing
from ilattice.errors import FormatError, GeometryError, InputError


def midpoint(vertices: ArrayLike, simplices: ArrayLike) -> CornerSharing:
    """Structure of the midpoints of the faces of a mesh.

    Parameters
    ----------
    vertices : array_like, shape (n, d)
        Vertices of the mesh.
    simplices : array_like of int, shape (m, d + 1)
        Triangles (edges are their faces) or tetrahedra.

    Returns
    -------
    CornerSharing
        One simplex per simplex of the mesh, in their order.

    Raises
    ------
    InputError
        For wrong shapes or numbers.
    GeometryError
        If three simplices share a face, or two of them two faces, or one is flat.
    """
    mesh = CornerSharing(as_array("vertices", vertices), np.asarray(simplices))
    d, cells = mesh.dim, mesh.simplices
    if not len(cells):
        raise InputError("simplices must not be empty")
    _check_flat("simplices", mesh)
    faces = np.stack([np.delete(cells, j, axis=1) for j in range(d + 1)], axis=1)
    names, place, count = np.unique(
        np.sort(faces.reshape(-1, d), axis=1), axis=0, return_inverse=True, return_counts=True
    )
    if count.max() > 2:
        i = int(np.argmax(count > 2))
        rows = (np.flatnonzero(place.ravel() == i) // (d + 1)).tolist()
        raise GeometryError(
            f"the face {names[i].tolist()} is shared by {int(count[i])} simplices, {rows}: at most "
            "two may share one"
        )
    x = mesh.positions[names].mean(axis=1)
    return CornerSharing(x, place.reshape(-1, d + 1)).check()


def load(path: str | os.PathLike[str]) -> tuple[FloatArray, IntArray]:
    """Vertices and simplices of a mesh file, for `midpoint` and `fill`.

    Parameters
    ----------
    path : path-like
        Any file of tetrahedra, or else of triangles, that meshio reads: .msh, .vtu, .mesh, ...

    Returns
    -------
    ndarray, shape (n, d)
        Vertices; of triangles in the plane z = 0 the first two coordinates.
    ndarray of int, shape (m, d + 1)
        Tetrahedra, turned so that their volumes are positive, or triangles.

    Raises
    ------
    FormatError
        If meshio is missing (``pip install "ilattice[files]"``), or cannot read the file, or there
        are neither tetrahedra nor triangles in a plane.
    """
    file = as_path("path", path)
    try:
        import meshio  # type: ignore[import-not-found, unused-ignore]
    except ImportError as e:
        raise FormatError('reading meshes needs meshio: pip install "ilattice[files]"') from e
    said = StringIO()
    try:
        with redirect_stdout(said), redirect_stderr(said):
            mesh = meshio.read(file)
    except (Exception, SystemExit) as e:  # meshio ends the process where it finds no file
        told = str(e) if isinstance(e, Exception) else " ".join(said.getvalue().split())
        raise FormatError(f"{str(path)!r}: meshio cannot read it: {told:.200}") from e
    x = np.asarray(mesh.points, np.float64)
    tets, triangles = (
        [b.data for b in mesh.cells if b.type == kind] for kind in ("tetra", "triangle")
    )
    if tets:
        cells = np.concatenate(tets).astype(np.int64)
    elif triangles and (x.shape[1] == 2 or np.ptp(x[:, 2]) == 0.0):
        x, cells = x[:, :2], np.concatenate(triangles).astype(np.int64)
    else:
        raise FormatError(f"{str(path)!r} has neither tetrahedra nor triangles in the plane z = 0")
    used, place = np.unique(cells, return_inverse=True)
    x, cells = x[used], np.asarray(place, np.int64).reshape(-1, cells.shape[1])
    down = CornerSharing(x, cells).volumes < 0
    cells[down, :2] = cells[down, 1::-1]
    return x, cells


def stacked(
    layer: CornerSharing, layers: ArrayLike, apices: Sequence[ArrayLike | None] | None = None
) -> CornerSharing:
    """Layers of triangles, with apices between them that make tetrahedra (paper, Definition 3).

    The triangles of the layer are coloured so that those that share a vertex have different
    colours. Between layers i and i + 1 every triangle of colour i mod 2 gets an apex, which makes
    a tetrahedron with it and one with the same triangle of the next layer.

    Parameters
    ----------
    layer : CornerSharing
        Of triangles.
    layers : array_like, shape (k, n, 3)
        Positions of its vertices in each layer, k of 2 or more.
    apices : sequence of array_like (t, 3) or None, optional
        Places of the apices between two layers; default, and for None, the mean of the six
        vertices around each.

    Returns
    -------
    CornerSharing
        Vertices layer by layer, then apices; those that no tetrahedron has are left out.

    Raises
    ------
    GeometryError
        If the triangles cannot be coloured so, or a tetrahedron is flat.
    """
    as_kind("layer", layer, "CornerSharing")
    return coloured_stack(layer, layers, apices, two_coloured(layer))


def coloured_stack(
    layer: CornerSharing, layers: Any, apices: Any, colour: IntArray
) -> CornerSharing:
    """`stacked`, with the colours (t,) of the triangles."""
    x = as_array("layers", layers, ndim=3)
    n = len(layer.positions)
    if layer.dim != 2 or x.shape[1:] != (n, 3) or len(x) < 2:
        raise InputError(f"layers must have shape (k, {n}, 3) with k of 2 or more, got {x.shape}")
    places: list[FloatArray] = [x.reshape(-1, 3)]
    rows, first = [], len(x) * n
    given = [None] * (len(x) - 1) if apices is None else as_items("apices", apices)
    if len(given) != len(x) - 1:
        raise InputError(f"apices must be {len(x) - 1} arrays, one per gap, got {len(given)}")
    for i in range(len(x) - 1):
        t = layer.simplices[colour == i % 2]
        top = 0.5 * (x[i][t].mean(axis=1) + x[i + 1][t].mean(axis=1))
        own = given[i]
        if own is not None:
            top = as_array(f"apices[{i}]", own, ndim=2)
            if top.shape != (len(t), 3):
                raise InputError(f"apices[{i}] must have shape ({len(t)}, 3), got {top.shape}")
        at = (first + np.arange(len(t)))[:, None]
        rows += [np.hstack([t + i * n, at]), np.hstack([t + (i + 1) * n, at])]
        places.append(top)
        first += len(t)
    used, name = np.unique(np.concatenate(rows), return_inverse=True)
    out = CornerSharing(np.concatenate(places)[used], name.reshape(-1, 4)).check()
    _check_flat("tetrahedra", out)
    return out


def _check_flat(name: str, k: CornerSharing) -> None:
    """Refuse simplices without volume."""
    corners = k.positions[k.simplices]
    sides = corners[:, 1:] - corners[:, :1]
    widest = np.abs(sides).max(axis=(1, 2))
    flat = np.abs(np.linalg.det(sides / np.maximum(widest, 1e-300)[:, None, None])) <= 1e-14
    if flat.any():
        i = int(np.argmax(flat))
        raise GeometryError(
            f"{name}[{i}] {k.simplices[i].tolist()} is flat ({int(flat.sum())} of {len(flat)} "
            "are so): move its corners, or drop it"
        )


def two_coloured(layer: CornerSharing) -> IntArray:
    """Colours 0 and 1 of simplices such that those that share a vertex differ.

    Parameters
    ----------
    layer : CornerSharing
        The structure.

    Returns
    -------
    ndarray of int, shape (m,)
        Colours; the first simplex of each connected part has 0.

    Raises
    ------
    GeometryError
        If there is an odd cycle of simplices.
    """
    vt, m = layer.incidence, len(layer.simplices)
    pairs = vt[vt[:, 1] >= 0]
    graph = coo_array((np.ones(len(pairs)), (pairs[:, 0], pairs[:, 1])), (m, m)).tocsr()
    colour = np.full(m, -1, np.int64)
    for start in range(m):
        if colour[start] >= 0:
            continue
        order, before = breadth_first_order(graph, start, directed=False)
        colour[start] = 0
        for i in order[1:]:
            colour[i] = 1 - colour[before[i]]
    same = colour[pairs[:, 0]] == colour[pairs[:, 1]]
    if same.any():
        a, b = pairs[int(np.argmax(same))].tolist()
        raise GeometryError(f"simplices {a} and {b} close an odd cycle: two colours do not suffice")
    return colour
