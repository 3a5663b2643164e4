"""The procedural graph: trusses, shells, solids and minimal surfaces from a few nodes.

::

    g = il.graph
    v = [g.vertex(p) for p in ((0.5, 0, 0.25), (0.5, 0.25, 0), (0.25, 0.5, 0), ...)]
    patch = g.surface(g.chain(v, closed=True), kind="conjugate", thickness=0.02)
    p = g.Graph(g.object(patch.mirrored("x").mirrored("y").mirrored("z")), within=g.cuboid())
    lattice = il.Lattice(p.tile(), through=il.macroshape.torus(), repeat=(16, 2, 2))

A skeleton, its thickness and its symmetry make a cell, whatever its architecture. Fundamental
skeletons live in a bounding volume, whose faces are mirrors for what slides on them; mirrors and
transforms fill the unit cube; the solid repeats over its faces.

=====================  ============================================================================
`vertex`, `chain`      points, and ways along them
`line`, `surface`      beams and shells: direct, mixed and conjugate surfaces
`dual`, `associate`    relatives of conjugate surfaces
`group`                skeletons as one; each has `mirrored`, `moved` and `completed`
`object`               a skeleton with its thickness: a solid
`union`, `difference`  Booleans of solids, and `intersection`
`voxel`                a solid with its material
`stiffness`            properties of a voxel node, and `bandgap`
`cuboid`, `prism`      bounding volumes, and `tetrahedron`, `halfspaces`
`Graph`                nodes that are checked: tile, solid, mesh, voxels, properties, pictures
`load`, `parse`        graphs from files and texts
`library`              known structures, by name
`ways`                 all closed ways along the faces of a bounding volume
`contact_sheet`        pictures of many graphs
`truss`, `topologies`  the 1205 topologies of beams with cubic symmetry of Panetta et al.
`random_graph`         graphs by kind and seed; `explore` makes a table of their properties
`computed`, `forget`   how many results were computed; drop those that are kept
=====================  ============================================================================

Guarantees: graphs keep the rules of their nodes, or a `GraphError` names node and rule; a node is
evaluated once. Non-guarantees: that beams or shells do not touch where they come near each other.
Source: Makatura et al., Procedural metamaterials: a unified procedural graph for metamaterial
design, ACM Trans. Graph. 42, 2023.
"""

from ilattice.graph.build import (
    associate,
    bandgap,
    chain,
    difference,
    dual,
    group,
    intersection,
    line,
    object,
    stiffness,
    surface,
    union,
    vertex,
    voxel,
)
from ilattice.graph.contact_sheet import contact_sheet
from ilattice.graph.evaluate import computed, forget
from ilattice.graph.explore import explore, random_graph
from ilattice.graph.files import load, parse
from ilattice.graph.graph import Graph
from ilattice.graph.library import Library, library
from ilattice.graph.nodes import EdgeChain, Vertex
from ilattice.graph.skeletons import (
    AssociateFamily,
    DualSurface,
    Group,
    Line,
    Mirror,
    Surface,
    Transform,
)
from ilattice.graph.solids import (
    CSGBoolean,
    MaterialMatrix,
    Object,
    PhononicBandgap,
    Voxel,
)
from ilattice.graph.trusses import topologies, truss
from ilattice.graph.volumes import halfspaces
from ilattice.graph.ways import ways
from ilattice.minimal import cuboid, prism, tetrahedron

__all__ = [
    "AssociateFamily",
    "CSGBoolean",
    "DualSurface",
    "EdgeChain",
    "Graph",
    "Group",
    "Library",
    "Line",
    "MaterialMatrix",
    "Mirror",
    "Object",
    "PhononicBandgap",
    "Surface",
    "Transform",
    "Vertex",
    "Voxel",
    "associate",
    "bandgap",
    "chain",
    "computed",
    "contact_sheet",
    "cuboid",
    "difference",
    "dual",
    "explore",
    "forget",
    "group",
    "halfspaces",
    "intersection",
    "library",
    "line",
    "load",
    "object",
    "parse",
    "prism",
    "random_graph",
    "stiffness",
    "surface",
    "tetrahedron",
    "topologies",
    "truss",
    "union",
    "vertex",
    "voxel",
    "ways",
]
