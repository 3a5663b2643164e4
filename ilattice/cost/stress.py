"""Forces in pin-jointed structures under loads.

Of a minimally rigid structure they follow from balance alone: the transposed rigidity matrix times
force densities is the loads. It is factorised as it is (its square would be far too
ill-conditioned), or, if the structure was refined, only the coarsest one is: every refined simplex
is isostatic, so its forces follow from those at its pins, by one small matrix for all.

Joints of printed structures are no hinges: `ilattice.cost.frames` tells how far that matters.

Guarantees: tension is positive; the residual of the balance is computed on the whole structure
and told. Loads that are not in balance by themselves are refused unless vertices are supported.
"""

from dataclasses import dataclass
from typing import Any, Generic

import numpy as np
from scipy.sparse import block_array, csc_array, diags_array
from scipy.sparse.linalg import splu

from ilattice._typing import AnyArray, ArrayLike, FloatArray, IntArray
from ilattice._validate import Frozen, as_array, as_kind, as_rows
from ilattice.cost._refining import children, refined
from ilattice.cost._rigidity_matrix import free_columns, gathered, matrix, rigid_motions
from ilattice.cost._structure import Coarse, K, K_co, Structure
from ilattice.cost.drawing import plot
from ilattice.errors import ConvergenceError, GeometryError, InputError

#: How far loads may be off balance, as a part of their size.
BALANCED = 1e-9
#: Part of the largest pivot below which a structure counts as not rigid.
SINGULAR = 1e-11
#: Residual above which forces are refused, and that at which forces by levels are not improved.
USELESS, FINE = 1e-6, 1e-12
#: Squares of loads above this, or below its inverse, are no numbers.
MAX_LOAD = 1e140


@dataclass(frozen=True, eq=False)
class Stress(Frozen, Generic[K_co]):
    """Forces in the edges of a structure under loads.

    Attributes
    ----------
    structure : CornerSharing
        The structure.
    density : ndarray, shape (e,)
        Forces over lengths, tension positive: rigidity matrix, transposed, times density = loads.
    loads : ndarray, shape (n, d)
        The loads.
    residual : float
        Norm of what is out of balance at the free vertices, over that of the loads.
    motion : ndarray, shape (n, d), or None
        Displacements, if a stiffness was given. Without supports two or three far vertices are
        held where they are, as `ilattice.cost.rigidity.free_columns` picks them.
    reactions : ndarray, shape (n, d)
        Forces of the supports.
    """

    structure: K_co
    density: FloatArray
    loads: FloatArray
    residual: float
    motion: FloatArray | None
    reactions: FloatArray

    @property
    def bars(self) -> FloatArray:
        """Forces (e,) in all edges, tension positive."""
        return np.asarray(self.density * self.structure.lengths)

    @property
    def compliance(self) -> float:
        """Work of the loads on the displacements: loads times motion."""
        if self.motion is None:
            raise InputError("compliance needs displacements: give a stiffness to stress")
        return float((self.loads * self.motion).sum())

    def plot(self, **options: Any) -> Any:
        """Edges coloured by their forces; see `ilattice.cost.drawing.plot`.

        Parameters
        ----------
        **options
            See there.

        Returns
        -------
        object
            What pyvista returns, None for a file.
        """
        return plot(self.structure, values=self.bars, **options)


def stress(
    k: K, loads: ArrayLike, *, supports: Any = None, stiffness: ArrayLike | None = None
) -> Stress[K]:
    """Forces in the edges under loads.

    Parameters
    ----------
    k : CornerSharing
        The structure. Without supports and stiffness it is to be minimally rigid, in these
        positions; if it was refined (rule R0), all levels but the coarsest take linear time.
    loads : array_like, shape (n, d)
        Forces on the vertices, in balance by themselves unless there are supports.
    supports : array_like, shape (n,) of bool or (s,) of int, optional
        Vertices that are held.
    stiffness : array_like, shape () or (e,), optional
        Young's modulus times cross-section of the edges, for displacements, and for forces where
        balance does not determine them.

    Returns
    -------
    Stress
        Forces, with the residual of their balance.

    Raises
    ------
    InputError
        For wrong shapes, loads that are not in balance (the message tells their sum and moment),
        or a structure with more edges than balance determines, without stiffness.
    GeometryError
        If the structure is not rigid.
    ConvergenceError
        If the residual exceeds 1e-6.
    """
    as_kind("k", k, "CornerSharing")
    f = as_array("loads", loads, ndim=2)
    if f.shape != k.positions.shape:
        raise InputError(f"loads must have shape {k.positions.shape}, got {f.shape}")
    top = float(np.abs(f).max())
    if not 1.0 / MAX_LOAD <= (top or 1.0) <= MAX_LOAD:
        raise InputError(
            f"loads must be from {1 / MAX_LOAD:g} to {MAX_LOAD:g}, got {top:.3g}: change units"
        )
    EA = None if stiffness is None else per_edge("stiffness", stiffness, k)
    held = None if supports is None else as_rows("supports", supports, len(f))
    if held is None:
        _check_balance(k, f)
    if held is None and EA is None:
        if k.deficit:
            _refuse_count(k)
        return _finished(k, f, _densities(k, f), None, None)
    return _supported(k, f, held, EA)


def per_edge(name: str, value: ArrayLike, k: Structure) -> FloatArray:
    """Positive numbers (e,), from one for all or one per edge."""
    a, e = as_array(name, value), len(k.edges)
    if a.shape not in ((), (1,), (e,)) or (a <= 0.0).any():
        raise InputError(
            f"{name} must be one positive number or one per edge ({e},), got {value!r:.80}"
        )
    return np.array(np.broadcast_to(a, (e,)))


def _check_balance(k: Structure, f: FloatArray) -> None:
    """Refuse loads that would move the structure as a whole."""
    size = float(np.linalg.norm(f))
    off = float(np.linalg.norm(rigid_motions(k).T @ f.ravel()))
    if off > BALANCED * size:
        x = k.positions - k.positions.mean(axis=0)
        moment = np.cross(x, f).sum(axis=0)
        raise InputError(
            f"loads must be in balance: their sum is {f.sum(axis=0).tolist()} and their moment "
            f"about the centre {np.round(moment, 12).tolist()}; see `balanced`, or give supports"
        )


def balanced(k: Structure, loads: ArrayLike) -> FloatArray:
    """Loads less the part that moves the structure as a whole, spread over all vertices.

    Parameters
    ----------
    k : CornerSharing
        The structure.
    loads : array_like, shape (n, d)
        Forces.

    Returns
    -------
    ndarray, shape (n, d)
        Loads in balance: inertia relief of vertices of equal mass.
    """
    f = as_array("loads", loads, ndim=2)
    if f.shape != k.positions.shape:
        raise InputError(f"loads must have shape {k.positions.shape}, got {f.shape}")
    T = rigid_motions(k)
    g = f.ravel()
    for _ in range(2):
        g = g - T @ (T.T @ g)
    return np.asarray(g.reshape(f.shape))


def _refuse_count(k: Structure) -> None:
    if k.deficit > 0:
        raise GeometryError(
            f"the structure is not rigid: {k.deficit} of the "
            f"{len(k.edges) + k.deficit} edges that it needs are missing; see `stiffened`"
        )
    raise InputError(
        f"the structure has {-k.deficit} edges more than balance determines: give their stiffness"
    )


# ------------------------------------------------------------------------------ levels


def _densities(k: Structure, f: FloatArray) -> FloatArray:
    """Force densities of a minimally rigid structure."""
    if k.coarse is None:
        return _flat(k, f)
    s = _by_levels(k, f)
    size = float(np.linalg.norm(f)) or 1.0
    left = f - gathered(k, s)
    for _ in range(4):  # every level costs digits
        before = float(np.linalg.norm(left))
        if before <= FINE * size:
            break
        new = s + _by_levels(k, left)
        left = f - gathered(k, new)
        if not np.linalg.norm(left) < 0.5 * before:
            break
        s = new
    return s


def _by_levels(k: Structure, f: FloatArray) -> FloatArray:
    """Those of the coarsest structure by LU, of finer ones simplex by simplex."""
    up = k.coarse
    if up is None:
        return _flat(k, f)
    return _on_fine(k, up, f, _by_levels(up.structure, _on_coarse(up, f)))


def _flat(k: Structure, f: FloatArray) -> FloatArray:
    """By one sparse factorisation, with one step of refinement."""
    free = free_columns(k)
    A = csc_array(matrix(k)[:, free].T)
    solved = factorised(A, k)
    b = f.ravel()[free]
    s = solved.solve(b)
    return np.asarray(s + solved.solve(b - A @ s))


def factorised(A: csc_array, k: Structure) -> Any:
    """Sparse LU, or the error that says that the structure is not rigid."""
    try:
        out = splu(A)
    except RuntimeError as e:
        raise GeometryError(_slack(k)) from e
    pivots = np.abs(out.U.diagonal())
    if pivots.min() <= SINGULAR * pivots.max():
        raise GeometryError(_slack(k))
    return out


def _slack(k: Structure) -> str:
    told = "the structure is not rigid at these positions, though it has enough edges"
    remedy = (
        ", or stiffen it in the mode 'matroid'"
        if len(k.bars) == 0
        else (
            "; bars of the mode 'matroid' may be lost in rounding "
            "where lengths differ by many decades"
        )
    )
    return f"{told} ({len(k.edges)}): see `rigidity()`{remedy}"


def _on_coarse(up: Coarse[Structure], f: FloatArray) -> FloatArray:
    """Loads on the coarser structure: those on midpoints go to both ends, half and half."""
    c = up.structure
    n = len(c.positions)
    _, pairs = children(c.dim)
    out = f[:n].copy()
    half = 0.5 * f[n:].reshape(len(up.rows), len(pairs), c.dim)
    ends = c.simplices[up.rows][:, pairs]
    for side in range(2):
        np.add.at(out, ends[:, :, side], half)
    return out


def _on_fine(k: Structure, up: Coarse[Structure], f: FloatArray, s: FloatArray) -> FloatArray:
    """Force densities in refined simplices from those in the coarser structure."""
    c, d = up.structure, k.dim
    _, pairs = children(d)
    inner = s[: len(pairs) * len(c.simplices)].reshape(-1, len(pairs))
    corners = c.positions[c.simplices[up.rows]]  # (r, d + 1, d)
    mids = f[len(c.positions) :].reshape(len(up.rows), len(pairs), d)
    q = np.zeros((len(up.rows), d + 1 + len(pairs), d))
    way = corners[:, pairs[:, 0]] - corners[:, pairs[:, 1]]
    force = inner[up.rows][:, :, None] * way
    for e, (i, j) in enumerate(pairs.tolist()):
        q[:, i] += force[:, e] - 0.5 * mids[:, e]
        q[:, j] += -force[:, e] - 0.5 * mids[:, e]
    q[:, d + 1 :] = mids
    local = _local(k)
    shape = corners[:, 1:] - corners[:, :1]  # rows are images of the unit vectors
    back = np.linalg.solve(np.swapaxes(shape, 1, 2), np.swapaxes(q, 1, 2))
    fine = np.swapaxes(back, 1, 2).reshape(len(q), -1) @ local.T
    rest = np.delete(inner, up.rows, axis=0)
    bars = s[len(pairs) * len(c.simplices) :]
    return np.concatenate([rest.ravel(), fine.ravel(), bars])


def _local(k: Structure) -> FloatArray:
    """Force densities of the refined unit simplex from forces on its vertices, in balance."""
    d = k.dim
    unit = type(k)(np.vstack([np.zeros(d), np.eye(d)]), np.arange(d + 1)[None])
    return np.asarray(np.linalg.pinv(matrix(refined(unit)).toarray().T))


# ------------------------------------------------------------------------------ supports


def _supported(k: K, f: FloatArray, held: IntArray | None, EA: FloatArray | None) -> Stress[K]:
    """Forces and displacements together: the compliance of edges, and balance."""
    fixed = np.zeros(f.shape, np.bool_)
    if held is None:
        fixed.ravel()[np.setdiff1d(np.arange(f.size), free_columns(k))] = True
    else:
        fixed[held] = True
    free = np.flatnonzero(~fixed.ravel())
    R = csc_array(matrix(k)[:, free])
    e = len(k.edges)
    if len(free) > e:
        raise GeometryError(
            f"the structure is not rigid: {len(free)} free coordinates, {e} edges; support more "
            "vertices, or stiffen it"
        )
    if EA is None and len(free) < e:
        raise InputError(
            f"balance does not determine the {e} forces, {e - len(free)} too many: give stiffness"
        )
    if EA is None:
        A = csc_array(R.T)
        solved = factorised(A, k)
        b = f.ravel()[free]
        s = solved.solve(b)
        return _finished(k, f, s + solved.solve(b - A @ s), None, fixed)
    size, usual = float(k.lengths.mean()), float(np.exp(np.log(EA).mean()))  # units cancel
    R = csc_array(R / size)
    soft = (k.lengths / size) ** 3 / (EA / usual)
    A = csc_array(block_array([[diags_array(-soft), R], [R.T, None]], format="csc"))
    scale = 1.0 / np.sqrt(np.maximum(abs(A).max(axis=1).toarray().ravel(), 1e-300))
    S = diags_array(scale)
    solved = factorised(csc_array(S @ A @ S), k)
    b = np.concatenate([np.zeros(e), f.ravel()[free]])
    x = scale * solved.solve(scale * b)
    x += scale * solved.solve(scale * (b - A @ x))
    motion = np.zeros(f.size)
    motion[free] = x[e:] * size / usual
    return _finished(k, f, x[:e] / size, motion.reshape(f.shape), fixed)


def _finished(
    k: K, f: FloatArray, s: FloatArray, motion: FloatArray | None,
    fixed: AnyArray | None,
) -> Stress[K]:  # fmt: skip
    """The result, with its residual."""
    off = gathered(k, s) - f
    reactions = np.zeros_like(f) if fixed is None else np.where(fixed, off, 0.0)
    size = float(np.linalg.norm(f))
    left = float(np.linalg.norm(off - reactions)) / (size if size > 0.0 else 1.0)
    if not left <= USELESS:
        why = "the structure is close to one that is not rigid; see `rigidity()`"
        if k.coarse is not None:
            why = f"solve without levels, see `refinement.forgotten`, or {why}"
        raise ConvergenceError(f"the forces balance the loads to {left:.1e} only: {why}")
    return Stress(k, s, f, left, motion, reactions)
