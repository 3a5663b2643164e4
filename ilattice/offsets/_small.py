"""Many small linear systems at once, some of which may be singular.

Guarantee: no error is raised, singular systems have solutions that are not numbers. Maps are
singular where faces collapse into edges or points, as in wedges, and where continuations fold.
"""

import numpy as np

from ilattice._typing import AnyArray, FloatArray


def solved(a: AnyArray, b: AnyArray) -> FloatArray:
    """Solutions (n, k, m) of systems a (n, k, k) with right-hand sides b (n, k, m).

    Parameters
    ----------
    a, b : ndarray, shape (n, k, k) and (n, k, m)
        Matrices and right-hand sides.

    Returns
    -------
    ndarray, shape (n, k, m)
        Solutions; NaN where a matrix is singular.
    """
    try:
        return np.linalg.solve(a, b)
    except np.linalg.LinAlgError:
        regular = np.linalg.det(a) != 0.0
    out = np.full(np.broadcast_shapes(a.shape[:-1] + b.shape[-1:], b.shape), np.nan)
    out[regular] = np.linalg.solve(a[regular], b[regular])
    return out
