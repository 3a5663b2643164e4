"""Many small linear systems at once, some of which may be singular.

Guarantee: no error is raised, singular systems have solutions that are not numbers. Maps are
singular where faces collapse into edges or points, as in wedges, and where continuations fold.
"""

import numpy as np

from ilattice._typing import AnyArray, FloatArray

#: Sine squared of the angle between conditions of which one follows from the other.
DEPENDENT = 1e-6


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


def least_steps(rows: FloatArray, miss: FloatArray, metric: FloatArray | None = None) -> FloatArray:
    """Shortest steps (n, 3) that make up for what linear conditions miss.

    Conditions of which one follows from others, or that are none, ask for nothing more; of those
    that contradict each other all are missed by as little as possible.

    Parameters
    ----------
    rows, miss : ndarray, shape (n, k, 3) and (n, k)
        Steps s are to have ``rows @ s = -miss``.
    metric : ndarray, shape (n, 3, 3), optional
        Of lengths, the unit matrix by default.

    Returns
    -------
    ndarray, shape (n, 3)
        The steps; NaN where the metric is singular.
    """
    lifted = rows.transpose(0, 2, 1)
    if metric is not None:
        lifted = solved(metric, lifted)
    gram = rows @ lifted
    finite = np.isfinite(gram).all(axis=(1, 2))
    inverse = np.full(gram.shape, np.nan)
    inverse[finite] = np.linalg.pinv(gram[finite], DEPENDENT, hermitian=True)
    out: FloatArray = -(lifted @ (inverse @ miss[:, :, None]))[:, :, 0]
    return out
