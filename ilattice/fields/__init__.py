"""Algebra on implicit fields, negative inside: primitives, sets, offsets, placement, blends.

A tree of any depth becomes one program of scalar instructions: values, derivatives and rigorous
bounds cost arithmetic, and where bounds decide a union or an intersection, the losing branch is
not evaluated::

    from ilattice import fields

    part = fields.difference(fields.box(1.0), fields.translate(fields.sphere(0.8), (1, 0, 0)))
    mesh = il.mesh.contour(part, axes)

Guarantees and non-guarantees: see `node`, `algebra`, `primitives`.
"""

from ilattice.fields.algebra import (
    complement,
    difference,
    dilate,
    erode,
    intersection,
    normalize,
    repeat,
    rotate,
    scale,
    shell,
    translate,
    twist,
    union,
)
from ilattice.fields.node import Node
from ilattice.fields.outside import from_callable
from ilattice.fields.primitives import box, capsule, cylinder, half_space, sphere, torus

__all__ = [
    "Node", "box", "capsule", "complement", "cylinder", "difference", "dilate", "erode",
    "from_callable", "half_space", "intersection", "normalize", "repeat", "rotate", "scale",
    "shell", "sphere", "torus", "translate", "twist", "union",
]  # fmt: skip
