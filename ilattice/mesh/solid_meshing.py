"""Elements that fill a solid: tetrahedra by TetGen, hexahedra of a background grid.

Guarantees: tetrahedra have exactly the given triangles as their surface, closed voids stay empty.
Hexahedra are cells of which at least half is solid: their surface has steps, which is an
approximation, of first order in stiffness and none at all in stresses at the surface; the error of
the volume is told.
"""

import os
import subprocess
import sys
import tempfile
import warnings
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np
from scipy.ndimage import label
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from ilattice._memory import need
from ilattice._progress import Progress, staged
from ilattice._typing import AnyArray, FloatArray, IntArray
from ilattice._validate import as_choice, as_real
from ilattice.errors import ConvergenceError, GeometryError, InputError, PrecisionWarning
from ilattice.mesh.solid_mesh import SolidMesh
from ilattice.mesh.triangles import TriangleMesh
from ilattice.quadrature.cutting import CutGrid, cut
from ilattice.quadrature.grid import Grid

_CORNERS = np.array([(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0),
                     (0, 0, 1), (1, 0, 1), (1, 1, 1), (0, 1, 1)])  # fmt: skip
#: Corners of a tetrahedron at the ends of its edges.
_EDGES = ((0, 1), (1, 2), (2, 0), (0, 3), (1, 3), (2, 3))
#: And those of its faces.
_SIDES = ((0, 1, 2), (0, 3, 1), (1, 3, 2), (2, 3, 0))
#: Asks for ratios of radius to edge up to 1.5, and angles between faces from 10 degrees on.
_PROGRAM = """
import sys, numpy, tetgen
given = numpy.load(sys.argv[1])
points, cells = tetgen.TetGen(given["vertices"], given["faces"]).tetrahedralize(
    plc=True, nobisect=True, quality=True, minratio=1.5, mindihedral=10.0, quiet=True)[:2]
numpy.savez(sys.argv[2], points=points, cells=cells)
"""
#: Memory of TetGen per triangle, measured; tetrahedra are two to four times as many.
_PER_FACE = 4000
#: Errors of the volume that are warned of.
_ROUGH = 0.02
#: Parts of the volume below which what hangs by edges or corners only is left out.
_CRUMB = 0.01


def tetrahedra(mesh: TriangleMesh, order: int = 2, progress: Progress = None) -> SolidMesh:
    """Fill a closed surface; see `SurfaceMesh.tetrahedra`."""
    as_choice("order", order, (1, 2))
    if find_spec("tetgen") is None:
        raise InputError(
            'tetrahedra need TetGen, which is not installed: pip install "ilattice[tetrahedra]" '
            "(its license is the AGPL); il.mesh.hexahedra needs nothing"
        )
    if not mesh.is_watertight:
        raise GeometryError(
            f"only closed surfaces can be filled: {mesh.open_edges} open edges, "
            f"{mesh.nonmanifold_edges} edges of more than two faces; mesh with caps=True"
        )
    need(_PER_FACE * len(mesh.faces), f"tetrahedra in {len(mesh.faces)} triangles", "a larger h")
    faces = np.array(mesh.faces, np.int32)
    vertices = np.array(mesh.vertices, float)
    work = {"tetrahedra": lambda: _filled(vertices, faces, mesh)}
    ((points, cells),) = staged(work, progress)
    solid = SolidMesh(points, cells[_in_solid(cells, faces)])
    error = solid.volume / mesh.volume - 1.0
    if not abs(error) < 1e-6:
        raise ConvergenceError(
            f"the tetrahedra have {solid.volume:.6g} of the volume {mesh.volume:.6g}; mesh with "
            "another h"
        )
    points, cells = _used(points, solid.cells)
    if order == 2:
        points, cells = _with_middles(points, cells)
    return _told(SolidMesh(points, cells, error), "leave out small ones by remove_islands()")


def _told(solid: SolidMesh, remedy: str) -> SolidMesh:
    """The mesh; warns of parts that programs will not find held."""
    if solid.parts > 1:
        warnings.warn(
            f"the solid has {solid.parts} parts that do not touch: each must be held for an "
            f"analysis to run; {remedy}",
            PrecisionWarning,
            stacklevel=4,
        )
    return solid


def _filled(
    vertices: FloatArray, faces: AnyArray, mesh: TriangleMesh
) -> tuple[FloatArray, IntArray]:
    """Points and tetrahedra of TetGen, which may abort, and does in a process of its own."""
    with tempfile.TemporaryDirectory() as folder:
        given, made = Path(folder) / "given.npz", Path(folder) / "made.npz"
        np.savez(given, vertices=vertices, faces=faces)
        paths = os.pathsep.join(os.path.abspath(path) for path in sys.path if path)
        done = subprocess.run(
            [sys.executable, "-c", _PROGRAM, given, made], env={**os.environ, "PYTHONPATH": paths},
            cwd=folder, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True, check=False,
        )  # fmt: skip
        if done.returncode == 0:
            with np.load(made) as arrays:
                return arrays["points"], arrays["cells"].astype(np.int64)
    said = (done.stderr.strip().splitlines() or [f"exit code {done.returncode}"])[-1]
    raise GeometryError(
        f"TetGen cannot fill the surface ({said:.80}); {mesh.self_intersections} of its triangles "
        "cross each other: mesh with another h"
    )


def _in_solid(cells: IntArray, faces: AnyArray) -> AnyArray:
    """Which tetrahedra are inside of an oriented surface that consists of sides of theirs."""
    count = len(cells)
    sides = np.concatenate([cells[:, side] for side in _SIDES])  # normals point outwards or
    owner = np.tile(np.arange(count), 4)
    every = np.concatenate([sides, np.asarray(faces, np.int64)])
    key = np.sort(every, axis=1)
    _, group = np.unique(key, axis=0, return_inverse=True)
    group = group.ravel()
    wall = np.zeros(group.max() + 1, bool)
    wall[group[len(sides) :]] = True
    mine = group[: len(sides)]
    order = np.argsort(mine, kind="stable")
    pairs = np.flatnonzero((mine[order][1:] == mine[order][:-1]) & ~wall[mine[order][1:]])
    a, b = owner[order[pairs]], owner[order[pairs + 1]]
    links = coo_array((np.ones(len(a), bool), (a, b)), shape=(count, count))
    part = connected_components(links, directed=False)[1]
    turn = np.zeros(len(wall), np.int64)
    turn[group[len(sides) :]] = _turn(np.asarray(faces, np.int64))
    inner = wall[mine] & (turn[mine] == -_turn(sides))
    return np.isin(part, np.unique(part[owner[inner]]))


def _turn(triangles: IntArray) -> IntArray:
    """1 or -1: whether corners are an even permutation of the increasing ones, shape (n,)."""
    a, b, c = triangles.T
    return np.sign(b - a) * np.sign(c - b) * np.sign(c - a)


def _used(points: FloatArray, cells: IntArray) -> tuple[FloatArray, IntArray]:
    """Without points that no cell has."""
    numbers, cells_of = np.unique(cells, return_inverse=True)
    return points[numbers], cells_of.reshape(cells.shape)


def _with_middles(points: FloatArray, cells: IntArray) -> tuple[FloatArray, IntArray]:
    """Quadratic tetrahedra with straight edges."""
    ends = np.sort(np.stack([cells[:, edge] for edge in _EDGES], axis=1).reshape(-1, 2), axis=1)
    edges, numbers = np.unique(ends, axis=0, return_inverse=True)
    middles = points[edges].mean(axis=1)
    nodes = len(points) + numbers.reshape(-1, 6)
    return np.vstack([points, middles]), np.column_stack([cells, nodes])


def hexahedra(
    field: Any, cells: Any = None, *, least: float = 0.5, domain: Any = None, through: Any = None,
    progress: Progress = None,
) -> SolidMesh:  # fmt: skip
    """Cells of a background grid of which enough is solid, as hexahedra for other programs.

    Needs no mesher and takes any solid, but is approximate: the surface has steps, and what is
    thinner than a cell may be lost. `SolidMesh.error` is that of the volume; stiffness is off by
    more than that, and stresses at the surface are worthless. `SurfaceMesh.tetrahedra` have none
    of this, and `ilattice.cutfem` cuts the same cells exactly.

    Parameters
    ----------
    field : Wall, CutGrid, BSpline, Node, callable, or pair of fields
        The solid, as for `ilattice.cutfem.cut`.
    cells : int or sequence of 3 int, optional
        Cells per direction; of a `CutGrid`, none.
    least : float
        Part of a cell that must be solid for it to be taken, above 0 up to 1.
    domain, through : optional
        As for `ilattice.cutfem.cut`.
    progress : bool or callable, optional
        "cells" and "rules"; see `ilattice._progress.track`.

    Returns
    -------
    SolidMesh
        Through the map, if there is one. Parts of less than a hundredth of the volume that touch
        nothing by a whole side are left out.

    Raises
    ------
    InputError
        If an argument is wrong.
    GeometryError
        If no cell is solid enough.

    Warns
    -----
    PrecisionWarning
        If the volume is off by more than 2 %.

    Examples
    --------
    >>> import ilattice as il
    >>> ball = il.fields.sphere(1.0)
    >>> solid = il.mesh.hexahedra(ball, 40, domain=[[-1, -1, -1], [1, 1, 1]])
    >>> solid.kind, abs(solid.error) < 0.01
    ('C3D8', True)
    >>> solid = solid.with_regions(bottom="z < -0.9")  # for solid.save("ball.inp")
    >>> solid.nodal_forces("bottom", (0, 0, 1)).sum(axis=0).round(9).tolist()
    [0.0, 0.0, 1.0]
    """
    part = as_real("least", least)
    if not 0.0 < part <= 1.0:
        raise InputError(f"least must be above 0 and at most 1, got {least!r}")
    if isinstance(field, CutGrid):
        if cells is not None or domain is not None or through is not None:
            raise InputError("a CutGrid has cells, domain and map already: give it alone")
        grid = field
    else:
        grid = cut(field, cells, domain=domain, through=through)
    staged({"cells": lambda: grid.status}, progress)
    staged({"rules": lambda: grid.volume()}, progress)
    wanted = _solid_enough(grid, part)
    if not wanted.any():
        raise GeometryError(f"no cell has a part of {part:g} in the solid; take finer cells")
    u, nodes = _corners(grid.grid, np.argwhere(wanted))
    x = u if grid.through is None else grid.through.x(u)
    rule = grid.volume()
    volume = (rule if grid.through is None else rule.in_space()).integrate()
    solid = SolidMesh(x, nodes)
    if not (solid.volumes > 0.0).all():
        nodes = nodes[:, [0, 3, 2, 1, 4, 7, 6, 5]]  # a map that turns space over
        solid = SolidMesh(x, nodes)
    error = solid.volume / volume - 1.0
    if abs(error) > _ROUGH:
        warnings.warn(
            f"the volume of the hexahedra is {100.0 * error:+.2g} % off: they are a rough "
            "approximation, also of the stiffness; take more cells, or tetrahedra",
            PrecisionWarning,
            stacklevel=2,
        )
    return _told(SolidMesh(x, nodes, error), "take more cells, or hold all of them")


def _corners(grid: Grid, ijk: IntArray) -> tuple[FloatArray, IntArray]:
    """Corners (n, 3) of cells, each once also across seams, and which are those of a cell."""
    at = ijk[:, None, :] + _CORNERS
    shape = tuple(n + 1 for n in grid.shape)
    for axis in np.flatnonzero(grid.closed):
        at[..., axis] %= grid.shape[axis]
    flat = np.ravel_multi_index(tuple(np.moveaxis(at, 2, 0)), shape)
    used, nodes = np.unique(flat, return_inverse=True)
    index = np.unravel_index(used, shape)
    u = np.stack([x[i] for x, i in zip(grid.axes, index, strict=True)], axis=1)
    return u, nodes.reshape(flat.shape)


def _solid_enough(grid: CutGrid, least: float) -> AnyArray:
    """Which cells have a part in the solid, without crumbs; shape of the grid."""
    rule = grid.volume(q=1)
    inside = np.zeros(grid.grid.count)
    inside[rule.cells] = rule.integrate_cells()
    whole = grid.grid.boxes(np.arange(grid.grid.count))[:, 3:].prod(axis=1)
    wanted = (inside >= (least - 1e-9) * whole).reshape(grid.grid.shape)
    parts, count = label(wanted)
    if count < 2:
        return wanted
    for axis in np.flatnonzero(grid.grid.closed):  # parts that meet across the seam
        first, last = np.take(parts, 0, axis), np.take(parts, -1, axis)
        for a, b in np.unique(np.stack([first, last], axis=-1)[(first > 0) & (last > 0)], axis=0):
            parts[parts == max(a, b)] = min(a, b)
    size = np.bincount(parts.ravel(), weights=whole)
    size[0] = 0.0
    return wanted & (size >= _CRUMB * size.sum())[parts]
