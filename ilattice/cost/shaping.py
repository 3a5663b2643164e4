"""New positions for the same graph: relaxation, given lengths, holes.

Guarantees: boundary vertices, with one simplex only, stay where they are unless told otherwise;
`with_lengths` ends with lengths that are right to 1e-10, or says that it does not.
"""

from typing import Any

import numpy as np
from scipy.sparse import csc_array, csr_array, eye_array
from scipy.sparse.linalg import splu

from ilattice._typing import ArrayLike, IntArray
from ilattice._validate import as_array, as_kind, as_positive, as_rows, as_whole
from ilattice.cost.flips import flipped
from ilattice.cost.refinement import area, voids
from ilattice.cost.rigidity import matrix
from ilattice.cost.structure import CornerSharing
from ilattice.errors import ConvergenceError, GeometryError, InputError

#: Error of lengths, over the mean length, that ends the search, and its most steps.
RIGHT, STEPS = 1e-10, 60


def _held(k: CornerSharing, fixed: Any) -> IntArray:
    as_kind("k", k, "CornerSharing")
    if fixed is None:
        return np.flatnonzero(k.incidence[:, 1] < 0)
    fixed = np.asarray(fixed, np.int64) if np.size(fixed) == 0 else fixed
    return np.unique(as_rows("fixed", fixed, len(k.positions)))


def relaxed(k: CornerSharing, *, sweeps: int | None = None, fixed: Any = None) -> CornerSharing:
    """Every vertex at the mean of its neighbours.

    Parameters
    ----------
    k : CornerSharing
        The structure.
    sweeps : int, optional
        Steps in which all vertices move at once; default until nothing changes, by one solve.
    fixed : array_like of int or of bool, optional
        Vertices that stay; default those with one simplex only.

    Returns
    -------
    CornerSharing
        The structure. Whether it is embedded `is_embedded` tells.
    """
    held = _held(k, fixed)
    n, e = len(k.positions), k.edges
    free = np.setdiff1d(np.arange(n), held)
    if not len(held):
        raise InputError("fixed must not be empty: all would end in one point")
    both = np.concatenate([e, e[:, ::-1]])
    A = csr_array((np.ones(len(both)), (both[:, 0], both[:, 1])), shape=(n, n))
    W = csr_array(A.multiply(1.0 / k.valence[:, None]))
    x = np.array(k.positions)
    if sweeps is None:
        M = csc_array(eye_array(len(free)) - W[free][:, free])
        x[free] = splu(M).solve(np.asarray(W[free][:, held] @ x[held]))
        return k.moved(x)
    for _ in range(as_whole("sweeps", sweeps, 0, 10**7)):
        x[free] = W[free] @ x
    return k.moved(x)


def with_lengths(k: CornerSharing, lengths: ArrayLike, *, fixed: Any = None) -> CornerSharing:
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
    held, d = _held(k, fixed), k.dim
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


def opened(
    k: CornerSharing, near: ArrayLike, *, sweeps: int = 300, radius: float | None = None
) -> CornerSharing:
    """A hole in a structure in the plane: flips around a void, then relaxation.

    The triangles around the void give their outer corners to it by one flip each: of a hexagon
    becomes a 12-gon, nearly a circle when the structure is relaxed.

    Parameters
    ----------
    k : CornerSharing
        The structure, in the plane.
    near : array_like, shape (2,)
        A point in the void.
    sweeps : int
        Of `relaxed`.
    radius : float, optional
        Only vertices within this distance of the void's centre move; default all inner ones.

    Returns
    -------
    CornerSharing
        The structure.

    Raises
    ------
    GeometryError
        If the point is in no void, or a flip is not possible.
    """
    if k.dim != 2:
        raise InputError("opened is for structures in the plane")
    p = as_array("near", near, ndim=1)
    if p.shape != (2,):
        raise InputError(f"near must be one point of the plane, got shape {p.shape}")
    found = [f for f in voids(k) if _holds(k, f, p)]
    if not found:
        raise GeometryError(f"the point {p.tolist()} is in no void")
    ring = found[0]
    outer = []
    for a, b in zip(ring, np.roll(ring, -1), strict=True):
        t = (set(k.incidence[a].tolist()) & set(k.incidence[b].tolist()) - {-1}).pop()
        outer.append(int(next(c for c in k.simplices[t] if c not in (a, b))))
    centre = k.positions[ring].mean(axis=0)
    out = k
    for v in outer:
        out = flipped(out, v, kind="graph")
    still = out.incidence[:, 1] < 0
    if radius is not None:
        far = np.linalg.norm(out.positions - centre, axis=1) > as_positive("radius", radius)
        still = still | far
    return relaxed(out, sweeps=sweeps, fixed=still)


def _holds(k: CornerSharing, loop: IntArray, p: Any) -> bool:
    """Whether a point is in a loop of vertices."""
    x = k.positions[loop]
    y = np.roll(x, -1, axis=0)
    up = (x[:, 1] > p[1]) != (y[:, 1] > p[1])
    with np.errstate(divide="ignore", invalid="ignore"):
        at = x[:, 0] + (p[1] - x[:, 1]) / (y[:, 1] - x[:, 1]) * (y[:, 0] - x[:, 0])
    return bool((up & (p[0] < at)).sum() % 2 == 1)


def void_areas(k: CornerSharing) -> Any:
    """Areas of all voids of a structure in the plane.

    Parameters
    ----------
    k : CornerSharing
        The structure.

    Returns
    -------
    ndarray, shape (v,)
        Areas, in the order of `ilattice.cost.refinement.voids`.
    """
    return np.array([area(k, f) for f in voids(k)])
