"""Meshes of solids for other programs: tetrahedra and hexahedra with named regions.

Guarantees: elements have positive volume and the order of nodes that CalculiX, Abaqus and VTK
share; forces on regions have exactly the resultant that was asked for. Edges are straight, also
those with a node in the middle: curved surfaces are those of the triangles.
Not guaranteed: a good shape of elements; that all parts are held.
"""

import os
import re
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any, ClassVar

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from ilattice._conditions import as_planes
from ilattice._geometry import grid_points
from ilattice._shown import one_line
from ilattice._typing import AnyArray, FloatArray, IntArray
from ilattice._validate import (
    FixedMapping,
    Frozen,
    as_points,
    as_triple,
    asked,
    near_names,
    read_only,
)
from ilattice.errors import GeometryError, InputError
from ilattice.io.registry import save
from ilattice.plot.quick import show

#: By nodes of an element: its name, VTK's number, and its sides in CalculiX's order, corners first.
KINDS: dict[int, tuple[str, int, tuple[tuple[int, ...], ...]]] = {
    4: ("C3D4", 10, ((0, 1, 2), (0, 3, 1), (1, 3, 2), (2, 3, 0))),
    10: ("C3D10", 24, ((0, 1, 2, 4, 5, 6), (0, 3, 1, 7, 8, 4), (1, 3, 2, 8, 9, 5),
                       (2, 3, 0, 9, 7, 6))),
    8: ("C3D8", 12, ((0, 1, 2, 3), (4, 7, 6, 5), (0, 4, 5, 1), (1, 5, 6, 2), (2, 6, 7, 3),
                     (3, 7, 4, 0))),
}  # fmt: skip
_NAME = re.compile(r"[A-Za-z][A-Za-z0-9_]{0,59}")
_TAKEN = ("SOLID", "NODES", "MATERIAL")
#: Distance from planes that counts as none, in units of the largest coordinate.
_NEAR = 1e-9
_GAUSS = (0.5 - 0.5 / np.sqrt(3.0), 0.5 + 0.5 / np.sqrt(3.0))


@dataclass(frozen=True, eq=False, repr=False)
class SolidMesh(Frozen):
    """Elements that fill a solid: made by `SurfaceMesh.tetrahedra` and `hexahedra`.

    Attributes
    ----------
    points : ndarray, shape (n, 3)
        Nodes.
    cells : ndarray of int, shape (e, 4), (e, 10) or (e, 8)
        Nodes of tetrahedra (C3D4, or C3D10 with nodes in the middle of edges) or of hexahedra
        (C3D8), in the order of CalculiX, Abaqus and VTK.
    error : float
        Volume of the elements over that of what they were made of, minus one.
    regions : mapping of str to ndarray of bool, shape (n,)
        Nodes of regions; see `with_regions`.
    """

    file_kind: ClassVar[str] = "elements"
    points: FloatArray
    cells: IntArray
    error: float = 0.0
    regions: Mapping[str, AnyArray] = field(default_factory=FixedMapping)

    def __post_init__(self) -> None:
        points = as_points("points", self.points).copy()
        cells = np.array(self.cells)
        if cells.ndim != 2 or cells.shape[1] not in KINDS or cells.dtype.kind not in "iu":
            raise InputError(
                f"cells must be integers of shape (e, 4), (e, 8) or (e, 10), got {cells.dtype} of "
                f"shape {cells.shape}"
            )
        if len(cells) == 0 or not 0 <= cells.min() <= cells.max() < len(points):
            raise InputError(f"cells must be some, and name points below {len(points)}")
        for name, inside in self.regions.items():
            if np.shape(inside) != (len(points),) or np.asarray(inside).dtype != bool:
                raise InputError(f"regions[{name!r}] must be {len(points)} booleans")
        object.__setattr__(self, "regions", FixedMapping(self.regions))
        object.__setattr__(self, "points", points)
        object.__setattr__(self, "cells", cells)
        super().__post_init__()

    def __repr__(self) -> str:
        regions = f", regions: {', '.join(self.regions)}" if self.regions else ""
        return one_line(
            f"SolidMesh({len(self.cells)} {self.kind}, {len(self.points)} nodes, volume "
            f"{self.volume:.6g} ({100.0 * self.error:+.2g} %){regions})"
        )

    @property
    def kind(self) -> str:
        """Name of the elements: C3D4, C3D10 or C3D8."""
        return KINDS[self.cells.shape[1]][0]

    @cached_property
    def volumes(self) -> FloatArray:
        """Volumes of the elements, shape (e,)."""
        if self.kind == "C3D8":
            at = grid_points(_GAUSS, _GAUSS, _GAUSS)
            parts = [_jacobian(self.points[self.cells], *u) for u in at]
            return read_only(np.mean([np.linalg.det(a) for a in parts], axis=0))
        x = self.points[self.cells[:, :4]]
        return read_only(np.linalg.det(x[:, 1:] - x[:, :1]) / 6.0)

    @property
    def volume(self) -> float:
        """Volume of all elements."""
        return float(self.volumes.sum())

    @cached_property
    def parts(self) -> int:
        """Number of parts that have no node in common."""
        count = len(self.points)
        first = np.repeat(self.cells[:, 0], self.cells.shape[1] - 1)
        links = (np.ones(len(first), bool), (first, self.cells[:, 1:].ravel()))
        labels = connected_components(coo_array(links, shape=(count, count)), directed=False)[1]
        return len(np.unique(labels[self.cells[:, 0]]))

    # --- regions ------------------------------------------------------------------------------

    def with_regions(self, **conditions: Any) -> "SolidMesh":
        """Give names to parts of the mesh, for supports, loads and materials.

        Parameters
        ----------
        **conditions
            By name, a linear condition such as ``"x > 199"``, a box (lowest, highest), or a
            function of points (n, 3) that gives booleans. Names are those of sets in the deck:
            letters, digits and underscores.

        Returns
        -------
        SolidMesh
            With these regions besides those it has; one of the same name is replaced.

        Raises
        ------
        InputError
            If a name or a condition cannot be used.
        GeometryError
            If no node is in a region.
        """
        found = dict(self.regions)
        for name, condition in conditions.items():
            if not _NAME.fullmatch(name) or name.upper() in _TAKEN:
                raise InputError(
                    f"a region cannot be called {name!r:.80}: names are up to 60 letters, digits "
                    f"and underscores, and none of {', '.join(_TAKEN)}"
                )
            if any(name.upper() == other.upper() for other in found if other != name):
                raise InputError(f"regions {name!r} and another differ in small letters only")
            found[name] = self._where(name, condition)
        return replace(self, regions=FixedMapping(found))

    def _where(self, name: str, condition: Any) -> AnyArray:
        """Which nodes are in a region, shape (n,)."""
        x = self.points
        if callable(condition):
            inside = np.asarray(asked(name, condition, x))
            if inside.shape != (len(x),) or inside.dtype != bool:
                raise InputError(
                    f"{name}: a condition takes points (n, 3) and returns n booleans, got "
                    f"{inside.dtype} of shape {inside.shape}"
                )
            inside = inside.copy()
        else:
            planes = as_planes(condition, name)
            away = x @ planes[:, :3].T + planes[:, 3]
            inside = np.all(away >= -_NEAR * float(np.abs(x).max()), axis=1)
        if not inside.any():
            span = " to ".join(str(a.round(6).tolist()) for a in (x.min(axis=0), x.max(axis=0)))
            raise GeometryError(f"{name}: no node there; the mesh reaches from {span}")
        return read_only(inside)

    def _region(self, name: str) -> AnyArray:
        if name not in self.regions:
            known = near_names(str(name), list(self.regions)) or "none; see with_regions"
            raise InputError(f"there is no region {name!r:.80}; known: {known}")
        return self.regions[name]

    def elements(self, name: str) -> IntArray:
        """Elements of which all nodes are in a region.

        Parameters
        ----------
        name : str
            Of the region.

        Returns
        -------
        ndarray of int, shape (k,)
            Their numbers from 0, increasing.
        """
        return np.flatnonzero(self._region(name)[self.cells].all(axis=1))

    def sides(self, name: str) -> IntArray:
        """Sides of elements on the surface of which all nodes are in a region.

        Parameters
        ----------
        name : str
            Of the region.

        Returns
        -------
        ndarray of int, shape (k, 2)
            Elements and their sides, both from 0.
        """
        outer = self.boundary
        return outer[self._region(name)[self._nodes_of(outer)].all(axis=1)]

    @cached_property
    def boundary(self) -> IntArray:
        """Elements and sides, both from 0, that are on the surface, shape (k, 2)."""
        sides = KINDS[self.cells.shape[1]][2]
        corners = 4 if self.kind == "C3D8" else 3
        faces = np.concatenate([self.cells[:, list(side[:corners])] for side in sides])
        faces.sort(axis=1)
        order = np.lexsort(faces.T)
        same = (faces[order][1:] == faces[order][:-1]).all(axis=1)
        alone = ~(np.append(same, False) | np.append(False, same))
        side, element = np.divmod(np.sort(order[alone]), len(self.cells))
        return read_only(np.column_stack([element, side]))

    def _nodes_of(self, sides: IntArray) -> IntArray:
        """Nodes of sides, shape (k, 3), (k, 6) or (k, 4)."""
        table = np.array(KINDS[self.cells.shape[1]][2])
        return np.take_along_axis(self.cells[sides[:, 0]], table[sides[:, 1]], axis=1)

    def area(self, name: str) -> float:
        """Area of the surface in a region.

        Parameters
        ----------
        name : str
            Of the region.

        Returns
        -------
        float
            Sum over its `sides`.
        """
        return float(self._shares(name).sum())

    def nodal_forces(self, name: str, force: Any) -> FloatArray:
        """Forces on nodes that do the same work as a uniform traction on a region.

        Parameters
        ----------
        name : str
            Of the region.
        force : array_like, shape (3,)
            The resultant.

        Returns
        -------
        ndarray, shape (n, 3)
            For all nodes.

        Raises
        ------
        GeometryError
            If no side of an element is in the region.
        """
        value, shares = as_triple("force", force), self._shares(name)
        if not shares.sum() > 0.0:
            raise GeometryError(f"force on {name!r}: no whole side of an element is in the region")
        return shares[:, None] / shares.sum() * value

    def _shares(self, name: str) -> FloatArray:
        """Integrals of the functions of the nodes over the surface of a region, shape (n,)."""
        nodes = self._nodes_of(self.sides(name))
        shares = np.zeros(len(self.points))
        x = self.points[nodes]
        if self.kind == "C3D8":
            for s in _GAUSS:
                for t in _GAUSS:
                    along = (1 - t) * (x[:, 1] - x[:, 0]) + t * (x[:, 2] - x[:, 3])
                    across = (1 - s) * (x[:, 3] - x[:, 0]) + s * (x[:, 2] - x[:, 1])
                    area = np.linalg.norm(np.cross(along, across), axis=1) / 4.0
                    values = ((1 - s) * (1 - t), s * (1 - t), s * t, (1 - s) * t)
                    np.add.at(shares, nodes, area[:, None] * np.array(values))
            return shares
        area = np.linalg.norm(np.cross(x[:, 1] - x[:, 0], x[:, 2] - x[:, 0]), axis=1) / 2.0
        # with nodes in the middle, those have all: functions of corners have no integral
        np.add.at(shares, nodes[:, -3:], area[:, None] / 3.0)
        return shares

    # --- out of it ----------------------------------------------------------------------------

    def to_pyvista(self) -> Any:
        """The elements as a dataset, regions as data of the points.

        Returns
        -------
        pyvista.UnstructuredGrid
            A copy.
        """
        import pyvista as pv

        count = self.cells.shape[1]
        cells = np.column_stack([np.full(len(self.cells), count), self.cells]).ravel()
        kinds = np.full(len(self.cells), KINDS[count][1], np.uint8)
        grid = pv.UnstructuredGrid(cells, kinds, np.array(self.points))
        for name, inside in self.regions.items():
            grid.point_data[name] = inside.astype(np.uint8)
        return grid

    def plot(self, **options: Any) -> Any:
        """Show the elements in a window or a notebook.

        Parameters
        ----------
        **options
            Of `ilattice.plot.show`, such as ``clip``, ``scalars`` (a region) or ``screenshot``.

        Returns
        -------
        object
            What pyvista returns.
        """
        return show(self, **{"show_edges": True, "line_width": 1, **options})

    def save(self, path: str | os.PathLike[str], **options: Any) -> None:
        """Write the mesh, or an analysis of it: .inp for CalculiX and Abaqus, .vtu for ParaView.

        Parameters
        ----------
        path : path-like
            File to create or to replace.
        **options
            See `ilattice.io.solids.write_inp`: ``young``, ``fixed``, ``forces``, ...

        Raises
        ------
        FormatError
            Unknown ending, or the file cannot be written.
        """
        save(self, path, **options)


def _jacobian(x: FloatArray, r: float, s: float, t: float) -> FloatArray:
    """Derivatives of hexahedra (e, 8, 3) at a point of the unit cube, shape (e, 3, 3)."""
    signs = np.array([(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0),
                      (0, 0, 1), (1, 0, 1), (1, 1, 1), (0, 1, 1)])  # fmt: skip
    u = np.array((r, s, t))
    values = np.where(signs == 1, u, 1.0 - u)
    slopes = [
        np.where(signs[:, a] == 1, 1.0, -1.0) * np.delete(values, a, axis=1).prod(axis=1)
        for a in range(3)
    ]
    return np.stack(slopes) @ x
