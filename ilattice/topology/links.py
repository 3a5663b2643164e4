"""What changes at a critical point of the distance: the shape of the directions in which it falls.

They are a part of a small sphere about the point, in the domain. The distance may grow along the
sheet on which several feet are equally near, and falls steeply beside it; the sphere is flattened
and bent along that sheet, so that degenerate points (monkey saddles, points on mirror planes) count
right, and necks are not taken for voids.

Non-guarantee: what is smaller than the sphere, a part of a span, is not seen.
"""

from __future__ import annotations

from functools import cache
from itertools import product

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from ilattice._typing import AnyArray, FloatArray, IntArray
from ilattice.topology.clearance import Clearance
from ilattice.topology.several_feet import SeveralFeet

#: Segments per edge of the octahedron whose sphere shows what changes; its radius in spans.
SEGMENTS, RADIUS = 12, 0.2
#: Part of its radius to which the sphere is flattened across the sheet of equal distances, and
#: least slope across it of the distances to the feet.
FLAT, STEEP = 0.2, 0.05
#: A fall of the distance, relative to the radius, that is none: about isolated points, and others.
NONE, NONE_ALONG = 1e-9, 1e-4


class Links:
    """Looks about critical points.

    Parameters
    ----------
    clearance : Clearance
        Distance less half-thickness.
    feet : SeveralFeet
        Finds the feet of points.
    """

    def __init__(self, clearance: Clearance, feet: SeveralFeet) -> None:
        self.clearance, self.feet = clearance, feet

    def __call__(
        self,
        u: FloatArray,
        value: float,
        side: int,
        on: tuple[int, ...],
        isolated: bool,
        most: float,
    ) -> tuple[int, int, bool]:
        """Directions in which the distance falls.

        Parameters
        ----------
        u : ndarray, shape (3,)
            Parameters of a critical point.
        value : float
            Its value.
        side : int
            Sign of the implicit function there.
        on : tuple of int
            Faces of the domain that it lies on, as in `CriticalPoint`.
        isolated : bool
            Whether the point is none of a critical curve or surface, along which nothing falls.
        most : float
            Largest radius of the sphere, so that it holds no other critical point.

        Returns
        -------
        tuple of int, int, bool
            Parts of these directions, holes in them, and whether they are all.
        """
        corners, triangles = _octahedron(SEGMENTS)
        size = self.clearance.sizes(u[None])[0]
        length = min(most, RADIUS * float((size * self.clearance.span).min()))
        steps, inward = self._around(u, on, corners * length, size)
        around = np.clip(self.clearance.wrapped(u + steps[inward] / size), *self.clearance.domain)
        distance = np.abs(self.clearance.lattice.distance(around))
        taken = self.clearance.taken(around, np.full(len(around), side))[0]
        below = np.zeros(len(corners), np.bool_)
        none = NONE if isolated else NONE_ALONG
        below[inward] = distance - taken < value - none * length
        if below.all():
            return 1, 0, True
        return *_betti(below, triangles), False

    def _around(
        self, u: FloatArray, on: tuple[int, ...], sphere: FloatArray, size: FloatArray
    ) -> tuple[FloatArray, AnyArray]:
        """Steps, in lengths, from a point to those of a small sphere about it; which are inwards.

        The axes of the sphere lie in the sheet and across.
        """
        feet = self.feet(u[None])[0]
        slopes = feet.gradient[feet.nearest] / size
        bends = feet.hessian[feet.nearest] / np.outer(size, size)
        free = np.flatnonzero(np.array(on) == 0)
        _, spread, axes = np.linalg.svd(slopes[:, free])
        rank = int((spread > STEEP).sum())
        frame = np.zeros((3, 3))
        frame[: len(free), free] = axes
        frame[len(free) :] = np.eye(3)[np.array(on) != 0]
        along = sphere @ (frame * (np.arange(3) >= rank)[:, None])
        later = along @ slopes.T + 0.5 * np.einsum("na,fab,nb->nf", along, bends, along)
        meet = np.column_stack([slopes @ frame[:rank].T, -np.ones(len(slopes))])
        onto = -(later @ np.linalg.pinv(meet).T)[:, :rank]
        steps = along + (onto + FLAT * sphere[:, :rank]) @ frame[:rank]
        inward = (along * on <= 1e-12).all(axis=1)
        return steps, np.asarray(inward)


@cache
def _octahedron(n: int) -> tuple[FloatArray, IntArray]:
    """Sphere of n**2 triangles per octant: corners (m, 3) and triangles; closed on axis planes."""
    face = [(i, j) for i in range(n) for j in range(n - i)]
    up = np.array([[(i, j), (i + 1, j), (i, j + 1)] for i, j in face])
    down = np.array([[(i + 1, j), (i + 1, j + 1), (i, j + 1)] for i, j in face if i + j < n - 1])
    flat = np.concatenate([up, down])
    whole = np.concatenate([flat, n - flat.sum(axis=2, keepdims=True)], axis=2)
    signs = np.array(list(product((-1, 1), repeat=3)))
    every = (signs[:, None, None] * whole).reshape(-1, 3)
    corners, number = np.unique(every, axis=0, return_inverse=True)
    x = corners.astype(np.float64)
    return x / np.linalg.norm(x, axis=1, keepdims=True), number.reshape(-1, 3)


def _betti(inside: AnyArray, triangles: IntArray) -> tuple[int, int]:
    """Parts, and independent loops, of the marked part of a triangulated piece of a sphere."""
    kept = triangles[inside[triangles].all(axis=1)]
    sides = np.sort(triangles[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1)
    sides = np.unique(sides[inside[sides].all(axis=1)], axis=0)
    n = len(inside)
    graph = coo_array((np.ones(len(sides)), sides.T), shape=(n, n))
    _, label = connected_components(graph, directed=False)
    parts = len(np.unique(label[inside])) if inside.any() else 0
    return parts, parts - (int(inside.sum()) - len(sides) + len(kept))
