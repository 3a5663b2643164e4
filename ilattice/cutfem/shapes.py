"""What is shown of a solid: the surface of its wall, the solid, or the active cells.

The surface mesh of a wall; the solid itself, cut out of the cells as tetrahedra; or the active
cells whole, as Lagrange hexahedra of the degree of the splines, in which fields and level sets are
polynomials like those of the splines. Parts that were left out are left out.

Guarantee: vertices are in the closure of the active cells, so that fields are known at all of them.
Non-guarantee: the mesh of a wall lies off the level sets of the splines by the error of both.
"""

import math
from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from ilattice._typing import AnyArray, FloatArray, IntArray
from ilattice._validate import among, as_array, as_positive
from ilattice.cutfem.pointwise import Pointwise
from ilattice.errors import InputError
from ilattice.io.bezier_cells import vtk_order
from ilattice.mesh import SurfaceMesh
from ilattice.mesh.wall_mesh import parameters_of, wall_mesh, warn_full
from ilattice.quadrature.clipping import MAX_TETRAHEDRA, clipped, lattice, smooth

#: VTK's numbers.
TRIANGLE, TETRAHEDRON, HEXAHEDRON, LAGRANGE_HEXAHEDRON = 5, 10, 12, 72
CORNERS = ((0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0), (0, 0, 1), (1, 0, 1), (1, 1, 1), (0, 1, 1))
WAYS = ("auto", "surface", "solid", "cells")
#: Largest displacement of pictures with scale="auto", in lengths of the solid.
AUTO = 0.1


class Shape(NamedTuple):
    """What is shown of a solid, before fields are on it.

    Attributes
    ----------
    u, x : ndarray, shape (n, 3)
        Vertices, in parameters and in space.
    cells : ndarray, shape (e, c)
        Vertices of cells.
    kind : int
        VTK's number of the kind of cells.
    data : dict of str to ndarray
        What is known at the vertices without a result.
    """

    u: FloatArray
    x: FloatArray
    cells: IntArray
    kind: int
    data: dict[str, AnyArray]


def shape_of(problem: Pointwise, on: str, h: float | None) -> Shape:
    """What is shown of a solid; see `Result.to_pyvista`."""
    if not among(on, WAYS):
        raise InputError(f"on must be one of {', '.join(map(repr, WAYS))}, got {on!r}")
    if on == "auto":
        on = "solid" if problem.domain.wall is None else "surface"
    if on == "surface":
        mesh = surface_of(problem, h)
        u = parameters_of(mesh)[0]
        return Shape(u, mesh.vertices, mesh.faces, TRIANGLE, dict(mesh.point_data))
    return _solid(problem, h) if on == "solid" else cells_of(problem)


def surface_of(problem: Pointwise, h: float | None) -> SurfaceMesh:
    """The mesh of the wall of a problem, without the parts that were left out."""
    wall = problem.domain.wall
    if wall is None:
        raise InputError("only walls have a surface mesh; on='solid' and on='cells' are for all")
    h = None if h is None else as_positive("h", h)
    warn_full(wall)
    mesh = wall_mesh(wall, h, polish=False, caps=True, dtype=np.float64, progress=None)
    u = parameters_of(mesh)[0]
    kept = problem.assembly.space.locate(u) >= 0
    if len(problem.parts[1]):
        kept &= ~_left_out(problem, mesh, u)
    return mesh if kept.all() else mesh.select(kept[mesh.faces].all(axis=1))


def _left_out(problem: Pointwise, mesh: SurfaceMesh, u: FloatArray) -> AnyArray:
    """Vertices (n,) of the pieces of a mesh of which most are on parts that were left out."""
    part, piece = problem.domain.parts.at(u), np.zeros(len(u), np.int64)
    piece[mesh.faces] = mesh.component_labels[:, None]
    count = len(mesh.faces) and int(mesh.component_labels.max()) + 1
    known = np.bincount(piece[part >= 0], minlength=count)
    out = np.bincount(piece[np.isin(part, problem.parts[1])], minlength=count)
    return np.asarray((2 * out > known)[piece])


def _solid(problem: Pointwise, h: float | None) -> Shape:
    """The solid as tetrahedra."""
    asm, cut = problem.assembly, problem.domain.cut
    n = (asm.space.degree,) * 3
    if h is None:
        rule = problem.domain.volume
        own = rule.integrate_cells()[np.isin(rule.cells, asm.space.cells)].sum()
        u, cells = smooth(cut.grid, asm.space.homes[0], n, cut.sets, float(own))
    else:
        middle = asm.space.boxes[:, :3] + 0.5 * asm.space.boxes[:, 3:]
        edges = np.linalg.norm(asm.jacobians(middle), axis=1) * asm.space.boxes[:, 3:]
        least = as_positive("h", h)
        longest = np.minimum(
            edges.max(axis=0), MAX_TETRAHEDRA * least
        )  # so that more of them are refused
        i, j, k = (max(math.ceil(e / least), 1) for e in longest)
        u, cells = clipped(cut.grid, asm.space.homes[0], (i, j, k), cut.sets)
    return Shape(u, asm.x(u), cells, TETRAHEDRON, {})


def cells_of(problem: Pointwise) -> Shape:
    """The active cells, whole, with the level sets at their nodes."""
    asm, cut = problem.assembly, problem.domain.cut
    p = asm.space.degree
    steps = np.array(CORNERS)
    if p > 1:
        steps = np.stack(np.unravel_index(np.argsort(vtk_order(p, p, p).ravel()), (p + 1,) * 3), 1)
    u, cells = lattice(cut.grid, asm.space.homes[0], (p, p, p), steps)
    kind = HEXAHEDRON if p == 1 else LAGRANGE_HEXAHEDRON
    return Shape(u, asm.x(u), cells, kind, {"level_set": cut.sets(u).max(axis=1)})


def moved(x: FloatArray, data: Mapping[str, AnyArray], scale: float | str) -> FloatArray:
    """Points with a factor of the displacement, if there is one, added."""
    if "displacement" not in data:
        return x
    d = np.where(np.isfinite(data["displacement"]), data["displacement"], 0.0)
    if isinstance(scale, str) and scale == "auto":
        far = np.linalg.norm(d, axis=1).max(initial=0.0)
        scale = float(AUTO * np.ptp(x, axis=0).max() / far) if far > 0 else 0.0
    if isinstance(scale, str) or as_array("scale", scale).size != 1:
        raise InputError(f"scale must be a number or 'auto', got {scale!r}")
    return x + float(scale) * d
