"""Box splines on the lattices of Kagome structures, by subdivision.

In the plane the three directions (1, 0), (0, 1), (1, 1), in space the four directions of the unit
vectors and (-1, -1, -1), each twice: C² of degree 4, and of degree 5. The control array is indexed
by the first d barycentric integers: 1 at vertices, -1 elsewhere; the solid is where the spline is
positive, its field the negative (paper, Section 3.7).

Guarantee: the masks are exact dyadic fractions. Not guaranteed: which embedding of the four
directions the paper draws.
"""

from itertools import product

import numpy as np

from ilattice._memory import need
from ilattice._typing import ArrayLike, FloatArray, IntArray
from ilattice._validate import as_array, as_choice, as_whole
from ilattice.cost.structure import CornerSharing
from ilattice.errors import InputError

DIRECTIONS = {2: ((1, 0), (0, 1), (1, 1)), 3: ((1, 0, 0), (0, 1, 0), (0, 0, 1), (-1, -1, -1))}


def mask(dim: int) -> tuple[IntArray, FloatArray]:
    """Subdivision mask: 2^d times the product of ((1 + z^xi) / 2)² over the directions xi.

    Parameters
    ----------
    dim : {2, 3}
        Dimension.

    Returns
    -------
    ndarray of int, shape (t, d)
        Exponents: 19 in the plane, 65 in space.
    ndarray, shape (t,)
        Taps, of sum 2^d.
    """
    d = int(as_choice("dim", dim, (2, 3)))
    taps: dict[tuple[int, ...], float] = {(0,) * d: float(2**d)}
    for xi, _ in product(DIRECTIONS[d], range(2)):
        new: dict[tuple[int, ...], float] = {}
        for at, value in taps.items():
            there = tuple(a + b for a, b in zip(at, xi, strict=True))
            new[at] = new.get(at, 0.0) + 0.5 * value
            new[there] = new.get(there, 0.0) + 0.5 * value
        taps = new
    rows = sorted(taps)
    return np.array(rows, np.int64), np.array([taps[r] for r in rows])


def subdivided(values: ArrayLike, *, outside: float = -1.0) -> FloatArray:
    """One step of subdivision: twice as fine, centred on the old places.

    The array, spread by zeros, is averaged with its copy shifted by each direction, twice.

    Parameters
    ----------
    values : array_like of 2 or 3 axes
        Control values.
    outside : float
        What they are beyond the array.

    Returns
    -------
    ndarray
        Of shape 2 n - 1 along each axis: the value at 2 i belongs to the place i before.
    """
    c = as_array("values", values)
    d = c.ndim
    if d not in DIRECTIONS:
        raise InputError(f"values must have 2 or 3 axes, got shape {c.shape}")
    need(8.0 * 4**d * c.size, "a subdivided array", "take fewer steps")
    room = 2  # so many old places reach beyond the array
    c = np.pad(c, room, constant_values=outside)
    fine = np.zeros([2 * n for n in c.shape])
    fine[(slice(None, None, 2),) * d] = 2.0**d * c
    for xi, _ in product(DIRECTIONS[d], range(2)):
        fine = 0.5 * (fine + np.roll(fine, xi, axis=tuple(range(d))))
    centre = np.sum(DIRECTIONS[d], axis=0)  # the mask is symmetric about the sum of directions
    fine = np.roll(fine, tuple(-centre), axis=tuple(range(d)))
    inner = tuple(slice(2 * room, 2 * room + 2 * n - 1) for n in np.array(c.shape) - 2 * room)
    return np.ascontiguousarray(fine[inner])


def control(k: CornerSharing) -> FloatArray:
    """Control array of a Kagome structure: 1 at its vertices, -1 elsewhere.

    Parameters
    ----------
    k : CornerSharing
        Made by `ilattice.cost.kagome`.

    Returns
    -------
    ndarray of d axes
        Indexed by the first d barycentric integers.
    """
    o = k.origin
    if o is None or len(o.cells) != 1:
        raise InputError("control is for structures made by kagome: this one has another origin")
    out = np.full((int(o.integers.max()) + 2,) * k.dim, -1.0)
    out[tuple(o.integers[:, : k.dim].T)] = 1.0
    return out


def samples(k: CornerSharing, steps: int = 2) -> FloatArray:
    """Values of the box spline of a Kagome structure on a fine lattice; positive inside.

    Parameters
    ----------
    k : CornerSharing
        Made by `ilattice.cost.kagome`.
    steps : int
        Steps of subdivision.

    Returns
    -------
    ndarray of d axes
        The value at 2^steps i belongs to the barycentric integers i.
    """
    out = control(k)
    for _ in range(as_whole("steps", steps, 0, 8)):
        out = subdivided(out)
    return out
