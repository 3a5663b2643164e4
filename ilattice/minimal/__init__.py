"""Minimal surfaces of triangles: found over faces of a region, completed, and made into tiles.

::

    octant = il.minimal.cuboid().faces("x+ z- y+ x- z+ y-")
    patch = il.minimal.conjugate(octant, n=16)
    surface = patch.completed()
    print(surface.area, surface.genus)  # 2.346, 3
    lattice = il.Lattice(surface.tile(), through=il.macroshape.torus(), repeat=(16, 2, 2))

=====================  ============================================================================
`cuboid`, `prism`      regions whose faces are mirrors, and which repeat in the unit cell; their
`tetrahedron`          method `faces` names a closed way along the faces
`Region`, `FaceLoop`   any convex body of mirrors; a closed way along its faces
`conjugate`            surface that meets faces at right angles in a given order
`mixed`                surface some sides of which are straight, while others slide on faces
`direct`               surface over a fixed curve: a soap film or a thin shell
`MinimalPatch`         what these return: area, dual, associate family, `completed`
`PeriodicSurface`      all images of a patch: Euler number, genus, sides, `tile`
`Report`               residual and cost of a patch
`Disc`                 how triangles of a patch are numbered
`reflection`           isometries
`half_turn`
`Isometry`, `Group`    a map that keeps lengths; a group of those, up to shifts by whole cells
`generated`            the group that some isometries generate
=====================  ============================================================================

Guarantees: surfaces have the residual that their report states, or there is an error that says why
there is none; completed surfaces are joined exactly. Non-guarantees: that a surface is the smallest
one over its boundary, or the only one that meets its faces.
"""

from ilattice.minimal.completion import PeriodicSurface
from ilattice.minimal.conjugate import conjugate
from ilattice.minimal.disc import Disc
from ilattice.minimal.patch import MinimalPatch, Report
from ilattice.minimal.region import FaceLoop, Region, cuboid, prism, tetrahedron
from ilattice.minimal.spanned import direct, mixed
from ilattice.minimal.symmetry import Group, Isometry, generated, half_turn, reflection

__all__ = [
    "Disc",
    "FaceLoop",
    "Group",
    "Isometry",
    "MinimalPatch",
    "PeriodicSurface",
    "Region",
    "Report",
    "conjugate",
    "cuboid",
    "direct",
    "generated",
    "half_turn",
    "mixed",
    "prism",
    "reflection",
    "tetrahedron",
]
