"""Which waves on fewer cells are those of a wave on many, for the change of its frequency.

Bands that are close to each other change places between grids: the n-th frequency on one is not
that of the n-th wave on the other. Waves are compared by their products at points of the solid.

Guarantee: of several waves on fewer cells that one wave is made up of, the farthest counts.
Non-guarantee: a wave that fewer cells do not have at all takes the highest that they have.
"""

import numpy as np

from ilattice._typing import FloatArray
from ilattice.homogenize._eigen import Vectors

#: Part of a wave, squared, that another one has at least to count; parts that are the whole.
SHARE, WHOLE = 0.1, 0.5


def overlaps(fine: Vectors, coarse: Vectors) -> FloatArray:
    """Squares of products of unit waves.

    Parameters
    ----------
    fine : ndarray, shape (n, p)
        Values at points, or with their weights.
    coarse : ndarray, shape (m, p)
        The same of others.

    Returns
    -------
    ndarray, shape (n, m)
        Between 0 and 1, rows adding up to 1 at most.
    """
    return np.asarray(np.abs(_apart(fine).conj() @ _apart(coarse).T) ** 2)


def _apart(x: Vectors) -> Vectors:
    """The orthonormal rows that are next to some."""
    x = x / np.maximum(np.linalg.norm(x, axis=1), 1e-300)[:, None]
    left, _, right = np.linalg.svd(x, full_matrices=False)
    return np.asarray(left @ right)


def farthest(values: FloatArray, others: FloatArray, shares: FloatArray) -> FloatArray:
    """Of the values of waves that others are made up of the one that is farthest off.

    Parameters
    ----------
    values : ndarray, shape (n,)
        Of the waves, ascending.
    others : ndarray, shape (m,)
        Of the others, ascending, with m >= n.
    shares : ndarray, shape (n, m)
        Of `overlaps`.

    Returns
    -------
    ndarray, shape (n,)
        Among `others`.
    """
    counts = shares >= SHARE
    unknown = np.flatnonzero((shares * counts).sum(axis=1) < WHOLE)
    counts[unknown, -1] = counts[unknown, unknown] = True
    far = np.where(counts, np.abs(others - values[:, None]), -1.0)
    return np.asarray(others[far.argmax(axis=1)])
