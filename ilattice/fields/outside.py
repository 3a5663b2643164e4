"""Functions of one's own as leaves of a tree of fields.

Guarantee: bounds are those of the field's own `range`, or none. Not guaranteed: derivatives of a
function without `jet`, which are differences.
"""

from typing import Any

import numpy as np

from ilattice._field import owns
from ilattice._validate import as_array
from ilattice.errors import InputError
from ilattice.fields.node import Leaf, Node, everywhere

__all__ = ["from_callable"]


def from_callable(f: Any, *, bounds: Any = None) -> Node:
    """Any field as a node.

    Parameters
    ----------
    f : callable
        Takes points (n, 3), returns values (n,). Its `jet`, `range`, `lipschitz` and
        `bounding_box` are used. What has a formula of its own as `node`, such as tiles and
        `TrigField`, becomes part of the program.
    bounds : (2, 3) array, optional
        Box that holds the points where it is not positive; default all of space. What has a
        formula knows its own.

    Returns
    -------
    Node
        The field. Without `range` nothing that holds it can be pruned.

    Raises
    ------
    InputError
        If it is not callable, or the bounds are no box.
    """
    if not callable(f):
        raise InputError(f"f must be callable, got {f!r:.80}")
    f = f.node if owns(f, "node") else f
    box = everywhere()
    if bounds is not None:
        box = np.array(as_array("bounds", bounds, ndim=2, finite=False))
        if box.shape != (2, 3) or not (box[0] <= box[1]).all():
            told = "bounds must be two corners (2, 3), lower one first"
            raise InputError(f"{told}, got {bounds!r:.80}")
    return f if isinstance(f, Node) else Leaf(f, box)
