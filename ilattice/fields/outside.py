"""Fields computed elsewhere (tiles, splines, own functions) as leaves of a tree.

Guarantee: bounds are those of the field's own `range`, or none. Not guaranteed: derivatives of a
function without `jet`, which are differences.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from ilattice._typing import FloatArray
from ilattice._validate import as_array, asked
from ilattice.errors import InputError
from ilattice.fields._program import Builder, Point
from ilattice.fields.node import Node, everywhere

__all__ = ["from_callable"]

STEP = 1e-4


@dataclass(frozen=True, eq=False)
class _Outside(Node):
    f: Any
    box: FloatArray

    def _emit(self, b: Builder, p: Point) -> int:
        return b.leaf(self, p)

    def _box(self, level: float = 0.0) -> FloatArray:
        if hasattr(self.f, "bounding_box"):
            return np.array(asked("bounding_box of the field", self.f.bounding_box, level))
        return np.array(self.box) if level <= 0.0 else everywhere()

    def values(self, points: FloatArray) -> FloatArray:
        """Values, checked for their shape."""
        out = as_array("values of the field", asked("field", self.f, points), finite=False)
        if out.shape != (len(points),):
            raise InputError(
                f"field must give {len(points)} values for {len(points)} points, "
                f"got shape {out.shape}"
            )
        return out

    def jets(self, points: FloatArray, order: int) -> tuple[FloatArray, ...]:
        """Value and derivatives, by differences where the field has none."""
        if hasattr(self.f, "jet"):
            return tuple(asked("jet of the field", self.f.jet, points, order))
        e = STEP * np.eye(3)
        value = self.values(points)
        up = np.stack([self.values(points + e[k]) for k in range(3)], axis=1)
        down = np.stack([self.values(points - e[k]) for k in range(3)], axis=1)
        first = (up - down) / (2.0 * STEP)
        if order == 1:
            return value, first
        H = np.empty((len(points), 3, 3))
        for i in range(3):
            H[:, i, i] = (up[:, i] - 2.0 * value + down[:, i]) / STEP**2
            for k in range(i):
                far = self.values(points + e[i] + e[k]) + self.values(points - e[i] - e[k])
                ends = up[:, i] + down[:, i] + up[:, k] + down[:, k]
                H[:, i, k] = H[:, k, i] = (far - ends + 2.0 * value) / (2.0 * STEP**2)
        return value, first, H

    def bounds_on(self, lo: FloatArray, hi: FloatArray, moved: bool) -> FloatArray:
        """Bounds and steepness (n, 3); the latter only where the point is not `moved`."""
        out = np.tile([-np.inf, np.inf, np.inf], (len(lo), 1))
        finite = np.isfinite(lo).all(axis=1) & np.isfinite(hi).all(axis=1)
        if hasattr(self.f, "range") and finite.any():
            told = "range of the field"
            out[finite, :2] = asked(told, self.f.range, lo[finite], hi[finite])
        if not moved:
            out[:, 2] = getattr(self.f, "lipschitz", np.inf)
        return out


def from_callable(f: Callable[..., Any], *, bounds: Any = None) -> Node:
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
    f = getattr(f, "node", f)
    box = everywhere()
    if bounds is not None:
        box = np.array(as_array("bounds", bounds, ndim=2, finite=False))
        if box.shape != (2, 3) or not (box[0] <= box[1]).all():
            told = "bounds must be two corners (2, 3), lower one first"
            raise InputError(f"{told}, got {bounds!r:.80}")
    return f if isinstance(f, Node) else _Outside(f, box)
