"""Algebra on implicit fields, negative inside: primitives, sets, offsets, placement, blends.

A tree of any depth becomes one program of scalar instructions: values, derivatives and rigorous
bounds cost arithmetic, and where bounds decide a union or an intersection, the losing branch is
not evaluated::

    from ilattice import fields

    part = fields.difference(fields.box(1.0), fields.translate(fields.sphere(0.8), (1, 0, 0)))
    mesh = il.mesh.contour(part, axes)

Solids may be equations, ``fields.equation("x^2 + y^2 + z^2 - 1")``, and tiles,
``fields.from_callable(il.tiles["gyroid"])``, which repeat through space.

Every field goes with every other one: splines, tiles, walls (``wall.field``), distances to meshes;
`pull_back` takes a field of space into the parameters of a map.

Guarantees and non-guarantees: see `node`, `algebra`, `deform`, `primitives`, `equation`.
"""

from ilattice._field import Field
from ilattice.fields.algebra import (
    clipped,
    complement,
    difference,
    dilate,
    erode,
    intersection,
    mix,
    normalize,
    rotate,
    scale,
    shell,
    translate,
    union,
)
from ilattice.fields.deform import bend, cylindrical, repeat, twist
from ilattice.fields.equation import constant, equation
from ilattice.fields.node import Node
from ilattice.fields.outside import from_callable
from ilattice.fields.primitives import box, capsule, cone, cylinder, half_space, sphere, torus
from ilattice.fields.pulled import pull_back

__all__ = [
    "Field", "Node", "bend", "box", "capsule", "clipped", "complement", "cone", "constant",
    "cylinder", "cylindrical", "difference", "dilate", "equation", "erode", "from_callable",
    "half_space", "intersection", "mix", "normalize", "pull_back", "repeat", "rotate", "scale",
    "shell", "sphere", "torus", "translate", "twist", "union",
]  # fmt: skip
