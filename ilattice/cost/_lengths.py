"""Positions at which edges have given lengths.

Guarantee: lengths are right to 1e-10, or it is said that they are not.
"""

from typing import Any

import numpy as np
from scipy.sparse import csc_array, eye_array
from scipy.sparse.linalg import splu

from ilattice._typing import ArrayLike, IntArray
from ilattice._validate import as_array, as_kind, as_rows
from ilattice.cost._rigidity_matrix import matrix
from ilattice.cost._structure import K, Structure
from ilattice.errors import ConvergenceError, InputError

#: Error of lengths, over the mean length, that ends the search, and its most steps.
RIGHT, STEPS = 1e-10, 60


def held_vertices(k: Structure, fixed: Any) -> IntArray:
    """Vertices that stay: by default those with one simplex only."""
    as_kind("k", k, "CornerSharing")
    if fixed is None:
        return np.flatnonzero(k.incidence[:, 1] < 0)
    fixed = np.asarray(fixed, np.int64) if np.size(fixed) == 0 else fixed
    return np.unique(as_rows("fixed", fixed, len(k.positions)))


def with_lengths(k: K, lengths: ArrayLike, *, fixed: Any = None) -> K:
    """Positions near the present ones at which edges have given lengths.

    By damped Gauss-Newton steps of least length, on sparse normal equations.

    Parameters
    ----------
    k : CornerSharing
        The structure.
    lengths : array_like, shape () or (e,)
        Lengths of the edges.
    fixed : array_like of int or of bool, optional
        Vertices that stay; default those with one simplex only.

    Returns
    -------
    CornerSharing
        The structure.

    Raises
    ------
    ConvergenceError
        If there are no such positions near these; the message tells how far lengths are off.
    """
    target = as_array("lengths", lengths)
    if target.shape not in ((), (1,), (len(k.edges),)) or (target <= 0.0).any():
        raise InputError(f"lengths must be positive, one or one per edge ({len(k.edges)},)")
    goal = np.broadcast_to(target, (len(k.edges),)) ** 2
    held, d = held_vertices(k, fixed), k.dim
    columns = np.setdiff1d(np.arange(k.positions.size), (d * held[:, None] + np.arange(d)).ravel())
    scale, damping, now = float(np.sqrt(goal).mean()), 1e-9, k
    for _ in range(STEPS):
        miss = 0.5 * (now.lengths**2 - goal) / scale**2
        if np.abs(miss).max(initial=0.0) < RIGHT:
            return now
        R = csc_array(matrix(now)[:, columns]) / scale
        N = csc_array(R.T @ R + damping * eye_array(len(columns)))
        step = np.zeros(k.positions.size)
        step[columns] = -scale * splu(N).solve(np.asarray(R.T @ miss))
        trial = now.moved(now.positions + step.reshape(now.positions.shape))
        new = 0.5 * (trial.lengths**2 - goal) / scale**2
        if np.linalg.norm(new) < np.linalg.norm(miss):
            now, damping = trial, max(1e-12, 0.1 * damping)
        else:
            damping = 10.0 * damping
            if damping > 1e6:
                break
    raise ConvergenceError(
        f"lengths are off by up to {np.abs(now.lengths - np.sqrt(goal)).max():.2e}: no positions "
        "near these have them; take fewer fixed vertices, or smaller steps"
    )
