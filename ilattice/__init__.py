"""Lattice design: implicit tiles, repeated through spline volumes, with true wall thickness.

Rooms, from the bottom up:

========================  ==================================================================
`io`                      one file per format: STL, PLY, OBJ, 3MF, VTK, G+Smo, MFEM, IRIT
`plot`                    pictures: scenes, panels, films
`bspline`                 tensor-product B-splines in one to three parameters, fits
`linalg`                  sparse direct solvers, multigrid, conjugate gradients
`fields`                  algebra on implicit fields: primitives, sets, placement, blends
`tiles`                   implicit fields on the unit cube: the TPMS catalogue, own fields
`macroshape`              maps of the parameter box to space: primitives, files, certificates
`quadrature`              background grids, level sets, cut cells, rules on them
`offsets`                 closest points, signed distance splines, thickness, densities
`slicing`                 layers: contours of walls and meshes at given heights
`mesh`                    watertight contouring, surface meshes, measures
`topology`                critical points of distances, sweeps, thinnest parts and gaps
`cutfem`                  elasticity and heat on cut cells, their solutions
`minimal`                 triangle minimal surfaces, their symmetries, tiles of them
`lattice`                 `Lattice` and `Wall` with all that can be done with them
`homogenize`              effective properties of cells that repeat
`cost`                    corner-sharing tetrahedra: rigid micro-structures, loads, beams
`graph`                   the procedural graph: cells from vertices, ways, mirrors, thickness
`sdf`                     solids from commands and from meshes, as fields
`shells`                  shells like minimal surfaces, from curves on faces; inverse design
========================  ==================================================================

Central types:

========================  ==================================================================
`BSpline`                 knots, coefficients, degree; value, gradient, Hessian, bounds
`Tile`                    smooth field on the unit cube, with name and period
`SplineMap`               spline volume with its inverse and further coordinates
`Lattice`                 a tile, repeated through a map
`Wall`                    the lattice with a thickness: a solid
`SurfaceMesh`             vertices, faces, named data; measures, pictures, files
`errors`                  everything that is raised on purpose
========================  ==================================================================

The shortest program::

    import ilattice as il

    torus = il.macroshape.torus(major=4.0, width=2.0)
    lattice = il.Lattice(il.tiles.schwarz_p(), through=torus, repeat=(16, 2, 2))
    mesh = lattice.offset(0.1).mesh(h=0.05)
    mesh.save("torus.stl")

Guarantees: points are rows, float64; fields are negative inside; everything public is immutable;
results do not depend on the number of threads. Importing this package loads NumPy, SciPy and
Numba and nothing heavier; names are loaded when first used.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from ilattice import (
        bspline,
        cost,
        cutfem,
        errors,
        fields,
        graph,
        homogenize,
        io,
        lattice,
        linalg,
        macroshape,
        mesh,
        minimal,
        offsets,
        plot,
        quadrature,
        sdf,
        shells,
        slicing,
        tiles,
        topology,
    )
    from ilattice._version import __version__ as __version__
    from ilattice.bspline import BSpline
    from ilattice.lattice import Lattice, Wall
    from ilattice.macroshape import SplineMap
    from ilattice.mesh import SurfaceMesh
    from ilattice.tiles import Tile

__all__ = [
    "BSpline",
    "Lattice",
    "SplineMap",
    "SurfaceMesh",
    "Tile",
    "Wall",
    "bspline",
    "cost",
    "cutfem",
    "errors",
    "fields",
    "graph",
    "homogenize",
    "io",
    "lattice",
    "linalg",
    "macroshape",
    "mesh",
    "minimal",
    "offsets",
    "plot",
    "quadrature",
    "sdf",
    "shells",
    "slicing",
    "tiles",
    "topology",
]

_HOMES = {
    "BSpline": "ilattice.bspline",
    "Lattice": "ilattice.lattice",
    "SplineMap": "ilattice.macroshape",
    "SurfaceMesh": "ilattice.mesh",
    "Tile": "ilattice.tiles",
    "Wall": "ilattice.lattice",
    "__version__": "ilattice._version",
}


def __getattr__(name: str) -> Any:
    if name in _HOMES:
        return getattr(import_module(_HOMES[name]), name)
    if name in __all__:
        return import_module(f"ilattice.{name}")
    raise AttributeError(f"module 'ilattice' has no attribute {name!r}")


def __dir__() -> list[str]:
    return sorted([*__all__, "__version__"])
