"""Makers of nodes, as short as a drawing of a graph."""

from typing import Any

from ilattice.graph.nodes import EdgeChain, Vertex
from ilattice.graph.skeletons import (
    EDGES,
    THICKNESS,
    AssociateFamily,
    DualSurface,
    Group,
    Line,
    Surface,
)
from ilattice.graph.solids import (
    RESOLUTION,
    CSGBoolean,
    MaterialMatrix,
    Object,
    PhononicBandgap,
    Voxel,
)


def vertex(position: Any) -> Vertex:
    """A point of the unit cube; see `Vertex`."""
    return Vertex(position)


def chain(vertices: Any, *, closed: bool = False, smooth: bool = False) -> EdgeChain:
    """A way along vertices; see `EdgeChain`.

    Parameters
    ----------
    vertices : sequence of Vertex
        In order.
    closed : bool
        Whether it goes back to the first.
    smooth : bool
        Whether it is a spline, or may slide.

    Returns
    -------
    EdgeChain
        The node.
    """
    order = (*range(len(vertices)), 0) if closed and isinstance(vertices, (list, tuple)) else None
    return EdgeChain(vertices, order, smooth)


def line(chains: Any, *, thickness: Any = THICKNESS) -> Line:
    """Beams along chains; see `Line`."""
    return Line(chains, thickness)


def surface(
    chains: Any, *, kind: str = "direct", thickness: Any = THICKNESS, alpha: float = 0.0,
    edges: int = EDGES, within: Any = None,
) -> Surface:  # fmt: skip
    """A surface over a loop of chains; see `Surface`."""
    return Surface(chains, kind, thickness, alpha, edges, within)


def dual(of: Any) -> DualSurface:
    """The dual of a conjugate surface; see `DualSurface`."""
    return DualSurface(of)


def associate(first: Any, second: Any, *, angle: float) -> AssociateFamily:
    """A member of an associate family; see `AssociateFamily`."""
    return AssociateFamily(first, second, angle)


def group(skeletons: Any) -> Group:
    """Several skeletons as one; see `Group`."""
    return Group(skeletons)


def object(skeleton: Any, *, resolution: int = RESOLUTION, extrusion: str = "spherical") -> Object:
    """A skeleton with its thickness; see `Object`."""
    return Object(skeleton, resolution, extrusion)


def union(*objects: Any) -> CSGBoolean:
    """What is in any of several objects; see `CSGBoolean`."""
    return CSGBoolean(objects, "union")


def intersection(*objects: Any) -> CSGBoolean:
    """What is in all of several objects; see `CSGBoolean`."""
    return CSGBoolean(objects, "intersection")


def difference(*objects: Any) -> CSGBoolean:
    """What is in the first of several objects, but in none of the others; see `CSGBoolean`."""
    return CSGBoolean(objects, "difference")


def voxel(solid: Any, *, young: float = 1.0, poisson: float = 0.3, density: float = 1.0) -> Voxel:
    """A solid as voxels, with its material; see `Voxel`."""
    return Voxel(solid, young, poisson, density)


def stiffness(of: Any) -> MaterialMatrix:
    """The effective stiffness; see `MaterialMatrix`."""
    return MaterialMatrix(of)


def bandgap(of: Any, *, curves: int = 8, samples: int = 8, tol: float = 1e-4) -> PhononicBandgap:
    """Frequencies at which no wave passes; see `PhononicBandgap`."""
    return PhononicBandgap(of, curves, samples, tol)
