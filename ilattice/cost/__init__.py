"""Corner-sharing tetrahedra: micro-structures of bars that are minimally rigid by construction.

========================  ==================================================================
`kagome`, `fill`          Kagome structures in a simplex, in a mesh of simplices
`midpoint`, `stacked`     structures of the faces of any mesh; layers with apices between them
`CornerSharing`           vertices, simplices and bars: checks, ranks, refinement, maps
`stiffening`              bars that make a structure minimally rigid
`rigidity`, `counting`    ranks, self-stresses, motions; the pebble game, resistances
`stress`                  forces under loads, by levels too
`frames`                  joints that are rigid, and how far trusses are right
`flips`, `refinement`     local changes of the graph
`shaping`, `mapping`      changes of position
`boxspline`, `drawing`    box splines on the lattices of structures; pictures
`fracture`, `slicing`     how structures break; slices of those that are never stored
`Beams`                   edges as round cones: a field, meshes, slices, 3MF, lines
`Pipes`                   edges as smooth Bezier patches: VTU, IRIT, meshes
`Blocks`                  a Kagome structure of any size, part by part
========================  ==================================================================

The shortest program::

    import ilattice as il

    k = il.cost.kagome(6).stiffened()
    k.mapped(il.macroshape.duck()).beams(0.02).mesh(0.01).save("duck.stl")

Source: "Corner-Sharing Tetrahedra for Modeling Micro-structure" (Sitharam, Youngquist, Nolan,
Peters). Guarantees: structures are immutable; ranks are numerical ones, with their tolerance, never
counts; forces are told with the residual of their balance; fields are negative inside.
"""

from ilattice.cost import (
    boxspline,
    counting,
    drawing,
    embedding,
    flips,
    fracture,
    frames,
    mapping,
    refinement,
    rigidity,
    shaping,
    slicing,
    stiffening,
    stress,
)
from ilattice.cost.beams import Beams
from ilattice.cost.kagome import Blocks, divided_box, fill, kagome
from ilattice.cost.mapping import BernsteinSimplex
from ilattice.cost.midpoint import load, midpoint, stacked
from ilattice.cost.pipes import Pipes
from ilattice.cost.structure import CornerSharing

__all__ = [
    "Beams",
    "BernsteinSimplex",
    "Blocks",
    "CornerSharing",
    "Pipes",
    "boxspline",
    "counting",
    "divided_box",
    "drawing",
    "embedding",
    "fill",
    "flips",
    "fracture",
    "frames",
    "kagome",
    "load",
    "mapping",
    "midpoint",
    "refinement",
    "rigidity",
    "shaping",
    "slicing",
    "stacked",
    "stiffening",
    "stress",
]
