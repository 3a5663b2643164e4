"""Makers of nodes, as short as a drawing of a graph."""

from typing import Any

from ilattice._validate import as_flag
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
    """A point of the unit cube.

    Parameters
    ----------
    position : array_like, shape (3,)
        Where it is.

    Returns
    -------
    Vertex
        The node.
    """
    return Vertex(position)


def chain(vertices: Any, *, closed: bool = False, smooth: bool = False) -> EdgeChain:
    """A way along vertices.

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
    closed = as_flag("closed", closed)
    order = (*range(len(vertices)), 0) if closed and isinstance(vertices, (list, tuple)) else None
    return EdgeChain(vertices, order, smooth)


def line(chains: Any, *, thickness: Any = THICKNESS) -> Line:
    """Beams along chains.

    Parameters
    ----------
    chains : EdgeChain or sequence of EdgeChain
        One way without branches.
    thickness : float or sequence of (t, thickness)
        As of `Line`.

    Returns
    -------
    Line
        The node.
    """
    return Line(chains, thickness)


def surface(
    chains: Any, *, kind: str = "direct", thickness: Any = THICKNESS, alpha: float = 0.0,
    edges: int = EDGES, within: Any = None,
) -> Surface:  # fmt: skip
    """A surface over a loop of chains.

    Parameters
    ----------
    chains : EdgeChain or sequence of EdgeChain
        The loop.
    kind, thickness, alpha, edges, within : optional
        As of `Surface`.

    Returns
    -------
    Surface
        The node.
    """
    return Surface(chains, kind, thickness, alpha, edges, within)


def dual(surface: Any) -> DualSurface:
    """The dual of a conjugate surface.

    Parameters
    ----------
    surface : Surface
        Of kind "conjugate".

    Returns
    -------
    DualSurface
        The node.
    """
    return DualSurface(surface)


def associate(first: Any, second: Any, *, angle: float) -> AssociateFamily:
    """A member of an associate family.

    Parameters
    ----------
    first, second : Surface or DualSurface
        A conjugate surface and its dual.
    angle : float
        In radians, from the first to the second.

    Returns
    -------
    AssociateFamily
        The node.
    """
    return AssociateFamily(first, second, angle)


def group(skeletons: Any) -> Group:
    """Several skeletons as one.

    Parameters
    ----------
    skeletons : sequence of Skeleton
        At least one.

    Returns
    -------
    Group
        The node.
    """
    return Group(skeletons)


def object(skeleton: Any, *, resolution: int = RESOLUTION, extrusion: str = "spherical") -> Object:
    """A skeleton with its thickness: a solid.

    Parameters
    ----------
    skeleton : Skeleton
        The skeleton.
    resolution, extrusion : optional
        As of `Object`.

    Returns
    -------
    Object
        The node.
    """
    return Object(skeleton, resolution, extrusion)


def union(*objects: Any) -> CSGBoolean:
    """What is in any of several objects.

    Parameters
    ----------
    *objects : Solid
        Two or more.

    Returns
    -------
    CSGBoolean
        The node.
    """
    return CSGBoolean(objects, "union")


def intersection(*objects: Any) -> CSGBoolean:
    """What is in all of several objects.

    Parameters
    ----------
    *objects : Solid
        Two or more.

    Returns
    -------
    CSGBoolean
        The node.
    """
    return CSGBoolean(objects, "intersection")


def difference(*objects: Any) -> CSGBoolean:
    """What is in the first of several objects, but in none of the others.

    Parameters
    ----------
    *objects : Solid
        Two or more.

    Returns
    -------
    CSGBoolean
        The node.
    """
    return CSGBoolean(objects, "difference")


def voxel(solid: Any, *, young: float = 1.0, poisson: float = 0.3, density: float = 1.0) -> Voxel:
    """A solid as voxels, with its material.

    Parameters
    ----------
    solid : Solid
        The solid.
    young, poisson, density : float
        As of `Voxel`.

    Returns
    -------
    Voxel
        The node.
    """
    return Voxel(solid, young, poisson, density)


def stiffness(voxel: Any) -> MaterialMatrix:
    """The effective stiffness.

    Parameters
    ----------
    voxel : Voxel
        The solid.

    Returns
    -------
    MaterialMatrix
        The node; see `Graph.stiffness`.
    """
    return MaterialMatrix(voxel)


def bandgap(voxel: Any, *, curves: int = 8, samples: int = 8, tol: float = 1e-4) -> PhononicBandgap:
    """Frequencies at which no wave passes.

    Parameters
    ----------
    voxel : Voxel
        The solid.
    curves, samples, tol : optional
        As of `PhononicBandgap`.

    Returns
    -------
    PhononicBandgap
        The node; see `Graph.bandgap`.
    """
    return PhononicBandgap(voxel, curves, samples, tol)
