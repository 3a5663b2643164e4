"""`Graph`: nodes with their bounding volume, checked, evaluated, drawn, written.

Guarantees: a graph that exists keeps all rules of its nodes; evaluating it again computes nothing.
"""

import os
from dataclasses import dataclass, field
from functools import cached_property
from hashlib import blake2b
from typing import TYPE_CHECKING, Any

import numpy as np

from ilattice._progress import Progress
from ilattice._typing import AnyArray
from ilattice._validate import FixedMapping, Frozen, as_choice, as_positive, as_texts, as_whole
from ilattice.errors import GraphError, IlatticeError, InputError
from ilattice.fields import box, from_callable, intersection, translate
from ilattice.graph.body import Body, warn_empty
from ilattice.graph.evaluate import Evaluation, kept, ordered
from ilattice.graph.nodes import Node
from ilattice.graph.patches import check
from ilattice.graph.plot import figure
from ilattice.graph.rules import MAX_NODES, check_counts, names_of, roots_of, solids_of
from ilattice.graph.shapes import Shape
from ilattice.graph.skeletons import Skeleton, Surface, thickened
from ilattice.graph.solids import (
    MaterialMatrix,
    Object,
    PhononicBandgap,
    Solid,
    Voxel,
)
from ilattice.graph.volumes import region_data, region_of
from ilattice.graph.writing import data_of, save
from ilattice.homogenize import Bands, Effective, bloch, elastic, voxels
from ilattice.io.vtk import save_grid
from ilattice.lattice import Lattice
from ilattice.macroshape.cells import cell
from ilattice.mesh import SurfaceMesh
from ilattice.minimal.tile import COARSE, warn_coarse
from ilattice.sdf import mesh
from ilattice.tiles import Tile

if TYPE_CHECKING:
    from matplotlib.figure import Figure


@dataclass(frozen=True, eq=False, repr=False)
class Graph(Frozen):
    """A procedural graph: what makes a cell of a metamaterial.

    Parameters
    ----------
    roots : Node, or sequence of Node
        What is wanted: an object, a Boolean, a voxel node, or properties of one voxel node.
    within : Region, optional
        Bounding volume of fundamental skeletons, as ``il.graph.cuboid()``.
    name : str
        Name of what is made.
    about : mapping of str to str
        Words on it, such as ``source`` and ``note``.
    names : mapping of str to Node, optional
        Names of nodes; others are named by their types and numbers.

    Raises
    ------
    GraphError
        If a node breaks a rule: which node, and which rule.

    Examples
    --------
    >>> import ilattice as il
    >>> g = il.graph
    >>> strut = g.line(g.chain([g.vertex((0, 0, 0)), g.vertex((0.5, 0.5, 0.5))]), thickness=0.1)
    >>> bcc = g.Graph(g.object(strut.mirrored("x").mirrored("y").mirrored("z")), within=g.cuboid())
    >>> bcc.count, len(bcc.shape.struts)
    (8, 8)
    """

    roots: Any
    within: Any = None
    name: str = "graph"
    about: Any = field(default_factory=dict, kw_only=True)
    names: Any = field(default_factory=dict, kw_only=True)

    def __post_init__(self) -> None:
        """Check all rules."""
        put = object.__setattr__
        put(self, "roots", roots_of(self.roots))
        if not isinstance(self.name, str):
            raise InputError(f"name must be a text, got {self.name!r:.80}")
        put(self, "about", FixedMapping(as_texts("about", self.about)))
        try:
            put(self, "within", region_of(self.within))
        except InputError as e:
            raise GraphError("graph", str(e)) from e
        if len(self.nodes) > MAX_NODES:
            raise GraphError(
                "graph", f"a graph must have at most {MAX_NODES} nodes, got {len(self.nodes)}"
            )
        put(self, "names", FixedMapping(names_of(self.nodes, self.names)))
        check_counts(self.nodes, self._solids, self._evaluation.told)
        for node in self.nodes:
            if isinstance(node, Surface):
                try:
                    check(node, node.within or self.within)
                except InputError as e:
                    raise GraphError(self._evaluation.told(node), str(e)) from e

    @cached_property
    def _solids(self) -> tuple[Solid, ...]:
        """The solid that each root is, or depends on."""
        return solids_of(self.roots)

    @cached_property
    def _evaluation(self) -> Evaluation:
        names = {id(node): name for name, node in self.names.items()}
        return Evaluation(self.within, names)

    # ------------------------------------------------------------------ what there is

    @cached_property
    def nodes(self) -> tuple[Node, ...]:
        """All nodes, each after its inputs."""
        return ordered(self.roots)

    @property
    def count(self) -> int:
        """Number of nodes."""
        return len(self.nodes)

    @cached_property
    def digest(self) -> str:
        """Digest of content: equal for equal nodes in an equal bounding volume."""
        place = None if self.within is None else region_data(self.within)
        told = repr((place, [root.digest for root in self.roots]))
        return blake2b(told.encode(), digest_size=16).hexdigest()

    @property
    def solid_node(self) -> Solid:
        """The object or Boolean that is made."""
        return self._solids[0]

    @property
    def voxel_node(self) -> Voxel | None:
        """The voxel node, if there is one."""
        return next((n for n in self.nodes if isinstance(n, Voxel)), None)

    def __repr__(self) -> str:
        """Short form."""
        return f"Graph({self.name!r}, {self.count} nodes, {self.solid_node.word})"

    def thickened(self, thickness: float | None = None, *, factor: float = 1.0) -> "Graph":
        """The graph with another thickness of its lines and surfaces.

        Parameters
        ----------
        thickness : float, optional
            Of all; without it each keeps its own, times the factor.
        factor : float
            What all are multiplied by.

        Returns
        -------
        Graph
            A new graph.
        """
        factor = as_positive("factor", factor)
        one = None if thickness is None else as_positive("thickness", thickness)
        new = thickened(self.nodes, one, factor)
        names = {name: new[id(node)] for name, node in self.names.items()}
        roots = [new[id(root)] for root in self.roots]
        return Graph(roots, self.within, self.name, about=self.about, names=names)

    # ------------------------------------------------------------------ evaluation

    def evaluate(self, node: Any = None) -> Shape | Body:
        """Result of a node; see `ilattice.graph.computed`.

        Parameters
        ----------
        node : Node or str, optional
            A skeleton or a solid of the graph, or its name; by default the solid.

        Returns
        -------
        Shape or Body
            What it makes.

        Raises
        ------
        GraphError
            If the node cannot be made: the reason.
        """
        if isinstance(node, str):
            if node not in self.names:
                raise InputError(f"node must be a name of the graph, got {node!r:.60}")
            node = self.names[node]
        node = self.solid_node if node is None else node
        if not isinstance(node, (Skeleton, Solid)):
            raise InputError(f"node must be a skeleton or a solid, got {node!r:.60}")
        return self._evaluation.of(node)

    @property
    def body(self) -> Body:
        """The solid."""
        return self._evaluation.of(self.solid_node)

    @property
    def shape(self) -> Shape:
        """All skeletons of objects, in the cell, each once."""
        out = Shape()
        for node in self.nodes:
            if isinstance(node, Object):
                out = out + self._evaluation.of(node.skeleton)
        return out.distinct

    def patches(self) -> tuple[Any, ...]:
        """Surfaces of all surface nodes, as `MinimalPatch`.

        Returns
        -------
        tuple of MinimalPatch
            In the order of the nodes.
        """
        found = [n for n in self.nodes if isinstance(n, Surface)]
        return tuple(self._evaluation.patch(n) for n in found)

    def tile(self) -> Tile:
        """The graph as a tile.

        Returns
        -------
        Tile
            Of surfaces of one thickness that part the cell into two sides, the surface, with its
            vertices corrected: walls are made by `Lattice.offset`. Of all others the solid,
            negative inside: made by
            ``Lattice.offset((np.inf, 0))``, or a shell of it.

        Raises
        ------
        GraphError
            If a node cannot be made: the reason.
        """
        if self.body.objection:
            return self.solid()
        warn_coarse(self._evaluation.off(self.solid_node), self.name)
        return self._told("tile", self._tile)

    def _tile(self) -> Tile:
        names = self._evaluation.names
        sharp = Evaluation(self.within, names, sharp=True).of(self.solid_node)
        return (self.body if sharp.objection else sharp).tile(self.name)

    def _warn_coarse(self, wanted: float = COARSE) -> None:
        """Tell where triangles are too large for the minimal surfaces that they stand for."""
        if self.body:  # which names what fails
            warn_coarse(self._evaluation.off(self.solid_node, wanted), self.name, wanted)

    def solid(self) -> Tile:
        """The solid as a tile, negative inside: an exact distance to its skeleton less the radius.

        Returns
        -------
        Tile
            Surfaces count as their triangles.

        Warns
        -----
        PrecisionWarning
            If the vertices of a conjugate surface are off the smooth one by more than 5e-4 of the
            cell, as in boxes of 2:1 and longer with 16 edges per side.
        """
        self._warn_coarse()
        return self._told("solid", lambda: self.body.solid(self.name))

    def _told(self, what: str, make: Any) -> Any:
        """A result of the whole, kept; errors name the solid."""
        key = (f"{what} {self.digest} {self.name}", self._evaluation.place)
        try:
            return kept(key, make)
        except GraphError:
            raise
        except IlatticeError as e:
            raise GraphError(self._evaluation.told(self.solid_node), str(e)) from e

    def mesh(
        self, h: float = 0.02, *, allow_loss: bool = False, progress: Progress = None
    ) -> SurfaceMesh:
        """The solid in one cell, closed by the faces of the cell.

        Parameters
        ----------
        h : float
            Spacing of the grid.
        allow_loss : bool
            Accept a mesh whose volume differs by more than 5 % from that of the solid.
        progress : bool or callable, optional
            See `ilattice._progress.track`.

        Returns
        -------
        SurfaceMesh
            Watertight.

        Raises
        ------
        GeometryError
            If the mesh is too coarse for the solid, or the solid is empty.
        """
        self._warn_coarse()
        cube = translate(box(0.5), (0.5, 0.5, 0.5))
        solid = intersection(cube, from_callable(self.body.field))
        return mesh(solid, h, allow_loss=allow_loss, progress=progress)

    def voxels(self, count: int | None = None) -> AnyArray:
        """The solid as voxels.

        Parameters
        ----------
        count : int, optional
            Voxels per edge; by default the resolution of the object.

        Returns
        -------
        ndarray of bool, shape (count, count, count)
            Whether their middles are inside, by x, y, z.

        Warns
        -----
        PrecisionWarning
            If no middle is inside, or surfaces are off by more than a tenth of a voxel.
        """
        n = self.solid_node.resolution if count is None else as_whole("count", count, 2, 1024)
        self._warn_coarse(max(COARSE, 0.1 / n))
        made: AnyArray = self._told(f"voxels {n}", lambda: _fixed(self.body.voxels(n)))
        warn_empty(made, self.name)
        return made

    def save_voxels(self, path: str | os.PathLike[str], count: int | None = None) -> None:
        """Write the voxels with their material as a file for ParaView, or for `voxels`.

        Parameters
        ----------
        path : path-like
            Ends in ``.vti``.
        count : int, optional
            Voxels per edge.
        """
        solid = self.voxels(count)
        node = self.voxel_node or Voxel(self.solid_node)
        axis = (np.arange(len(solid)) + 0.5) / len(solid)
        data: dict[str, AnyArray] = {"solid": solid.astype(np.uint8)}
        for name, value in (("E", node.young), ("nu", node.poisson), ("rho", node.density)):
            data[name] = value * solid
        save_grid(path, [axis] * 3, data)

    # ------------------------------------------------------------------ properties

    @property
    def _material(self) -> dict[str, float]:
        node = self.voxel_node
        return {} if node is None else {"young": node.young, "poisson": node.poisson}

    def solid_of_cell(self) -> Any:
        """What `ilattice.homogenize` takes: a wall of a surface with two sides, else a tile.

        Returns
        -------
        Wall or Tile
            In the unit cell.
        """
        if self.body.objection:
            return self.solid()
        half = self.body.half_thickness
        return self._told(
            "wall", lambda: Lattice(self.tile(), through=cell(), repeat=(1, 1, 1)).offset(half)
        )

    def homogenize(self, cells: Any = 16, *, method: str = "cut", **options: Any) -> Effective:
        """Effective stiffness of the solid.

        Parameters
        ----------
        cells : int
            Cells of the grid per direction, or voxels.
        method : {"cut", "voxels"}
            Splines on cut cells, or voxels.
        **options
            As in `ilattice.homogenize.elastic` or `voxels`; by default with the material of the
            voxel node.

        Returns
        -------
        Effective
            Stiffness with an estimate of its errors.
        """
        given = {**self._material, **options}
        if as_choice("method", method, ("cut", "voxels")) == "cut":
            return elastic(self.solid_of_cell(), cells, **given)
        return voxels(self.voxels(cells), **given)

    def stiffness(self) -> Effective:
        """What the material matrix node tells: by voxels at the resolution of the object.

        Returns
        -------
        Effective
            The stiffness.

        Raises
        ------
        GraphError
            If there is no such node.
        """
        if not any(isinstance(n, MaterialMatrix) for n in self.nodes):
            raise GraphError("graph", "stiffness() needs a material matrix node; or homogenize()")
        count = self.solid_node.resolution
        return self._told(
            "stiffness", lambda: self.homogenize(count, method="voxels", estimate=count % 2 == 0)
        )

    def bandgap(self, cells: int = 12, progress: Progress = None, **options: Any) -> Bands:
        """What the band gap node tells, by splines on cut cells.

        Parameters
        ----------
        cells : int
            Cells of the grid per direction.
        progress : bool or callable, optional
            See `ilattice._progress.track`.
        **options
            As in `ilattice.homogenize.bloch`.

        Returns
        -------
        Bands
            Dispersion curves, `Bands.gaps` between them.

        Raises
        ------
        GraphError
            If there is no such node.
        """
        node = next((n for n in self.nodes if isinstance(n, PhononicBandgap)), None)
        if node is None:
            raise GraphError("graph", "bandgap() needs a phononic band gap node")
        given: dict[str, Any] = {
            "count": node.curves, "steps": node.samples, "tol": node.tol, **self._material,
            "density": node.voxel.density, **options,
        }  # fmt: skip
        return bloch(self.solid_of_cell(), cells, progress=progress, **given)

    # ------------------------------------------------------------------ files and pictures

    def as_dict(self) -> dict[str, Any]:
        """The graph as plain data, see `ilattice.graph.files`.

        Returns
        -------
        dict
            What `save` writes.
        """
        return data_of(self)

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write the graph as JSON.

        Parameters
        ----------
        path : path-like
            Ends in ``.json``.
        """
        save(self, path)

    def plot(self, *, stages: bool = True) -> "Figure":
        """Draw the graph, and what its stages make.

        Parameters
        ----------
        stages : bool
            Whether to draw fundamental skeletons, the skeleton in the cell and the solid.

        Returns
        -------
        matplotlib.figure.Figure
            ``savefig`` writes it.
        """
        return figure(self, stages=stages)


def _fixed(a: AnyArray) -> AnyArray:
    a.flags.writeable = False
    return a
