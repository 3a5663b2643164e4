"""New positions for the same graph: relaxation, given lengths, holes.

Guarantees: boundary vertices, with one simplex only, stay where they are unless told otherwise;
`with_lengths` ends with lengths that are right to 1e-10, or says that it does not.
"""

from typing import Any

import numpy as np
from scipy.sparse import csc_array, csr_array, eye_array
from scipy.sparse.linalg import splu

from ilattice._typing import ArrayLike, IntArray
from ilattice._validate import as_array, as_positive, as_whole
from ilattice.cost._lengths import held_vertices, with_lengths
from ilattice.cost._refining import area, voids
from ilattice.cost.flips import flipped
from ilattice.cost.structure import CornerSharing
from ilattice.errors import GeometryError, InputError

__all__ = ["opened", "relaxed", "void_areas", "with_lengths"]


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
    held = held_vertices(k, fixed)
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
