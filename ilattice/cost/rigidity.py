"""Rigidity: the matrix, its rank with the tolerance that decided, self-stresses, motions.

Guarantees: ranks are numerical ones of the positions given, or of a random perturbation that is
named; the gap between what counts and what does not is told. Not guaranteed: a rank where there is
no gap.
"""

import warnings
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.linalg import eigh, qr, svd
from scipy.sparse import csc_array, csr_array
from scipy.sparse.linalg import splu

from ilattice._memory import need
from ilattice._typing import ArrayLike, FloatArray, IntArray
from ilattice._validate import (
    as_flag,
    as_kind,
    as_not_negative,
    as_positive,
    as_whole,
)
from ilattice.cost._lengths import with_lengths
from ilattice.cost._rigidity_matrix import (
    as_motion,
    free_columns,
    gathered,
    matrix,
    rigid_motions,
    stretched,
)
from ilattice.cost._structure import K, Structure
from ilattice.errors import GeometryError, InputError, PrecisionWarning

__all__ = [
    "Rigidity",
    "analysed",
    "flexes",
    "free_columns",
    "gathered",
    "matrix",
    "rigid_motions",
    "self_stresses",
    "stretched",
    "swung",
]

#: Rows or columns up to which ranks are taken from a dense factorisation.
DENSE = 6000
#: Part of the largest pivot below which one is zero; what is within `UNSURE` of it is warned of.
TOLERANCE = 1e-9
#: Factor by which pivots may be near that bound.
UNSURE = 1e3
#: Edges from which on the sparse LU of structures of the right count is tried first; it proves full
#: rank if no pivot is below this part of the largest.
SPARSE, CLEAR = 400, 1e-7
#: Part of the largest eigenvalue of the squared matrix below which one may be zero, and the largest
#: change of a length, over lengths of edges, by a motion that then counts as one.
SINGULAR, ACCURATE = 1e-12, 1e-9
#: Part of a step along a finite motion that must be left when lengths are right again.
KEPT = 0.5
#: Perturbation for generic ranks, in mean lengths of edges.
PERTURBATION = 0.05


@dataclass(frozen=True)
class Rigidity:
    """Rank of a rigidity matrix.

    Attributes
    ----------
    rank : int
        The rank.
    edges, freedoms : int
        Rows and columns of the matrix.
    trivial : int
        Rigid motions: 3 in the plane, 6 in space.
    tolerance : float
        Part of the largest pivot below which one counted as zero.
    least : float
        Least pivot that counted, as such a part.
    dropped : float
        Largest that did not; 0 if all did.
    perturbation : float
        How far vertices were moved at random before, in mean lengths of edges; 0 for not at all.
    """

    rank: int
    edges: int
    freedoms: int
    trivial: int
    tolerance: float
    least: float
    dropped: float
    perturbation: float

    @property
    def flexes(self) -> int:
        """Independent infinitesimal motions that are not rigid ones."""
        return self.freedoms - self.trivial - self.rank

    @property
    def self_stresses(self) -> int:
        """Independent self-stresses."""
        return self.edges - self.rank

    @property
    def rigid(self) -> bool:
        """Whether there are no motions but rigid ones."""
        return self.flexes == 0

    @property
    def minimal(self) -> bool:
        """Whether it is rigid without self-stress."""
        return self.rigid and self.self_stresses == 0

    @property
    def caution(self) -> str:
        """Why the rank is not clear: pivots within a factor 1000 of the tolerance; or nothing."""
        if self.least >= UNSURE * self.tolerance and self.dropped <= self.tolerance / UNSURE:
            return ""
        return (
            f"the rank {self.rank} is not clear: pivots lie at {self.least:.1e} and "
            f"{self.dropped:.1e} of the largest, and the tolerance is {self.tolerance:.1e}; move "
            "the vertices a little, or set another tolerance"
        )


# ------------------------------------------------------------------------------ rank


def analysed(
    k: Structure, *, generic: bool = False, tolerance: float = TOLERANCE, seed: int = 0,
    perturbation: float = PERTURBATION,
) -> Rigidity:  # fmt: skip
    """Rank of the rigidity matrix.

    By a sparse LU factorisation where there are as many edges as minimal rigidity needs and its
    pivots prove full rank, else with all vertices that have two simplices eliminated, if the
    motions that are found keep all lengths to 1e-9, else, up to 6000 edges or freedoms, by a dense
    QR factorisation with column pivots. Above that full rank can be proved only, of structures with
    no more edges.

    Parameters
    ----------
    k : CornerSharing
        The structure.
    generic : bool
        At a random perturbation of the positions; regular ones may have a lower rank.
    tolerance : float
        Part of the largest pivot below which one is zero.
    seed : int
        Of the perturbation.
    perturbation : float
        Its size, in mean lengths of edges.

    Returns
    -------
    Rigidity
        The rank, and how clear it is.

    Raises
    ------
    InputError
        If the structure is too large for a dense factorisation and has more edges than that.
    GeometryError
        If it is that large and its rank is not full: the rank stays unknown.

    Warns
    -----
    PrecisionWarning
        If pivots lie within a factor 1000 of the tolerance.
    """
    out = counted(k, generic=generic, tolerance=tolerance, seed=seed, perturbation=perturbation)
    if out.caution:
        warnings.warn(out.caution, PrecisionWarning, stacklevel=3)
    return out


def counted(
    k: Structure, *, generic: bool = False, tolerance: float = TOLERANCE, seed: int = 0,
    perturbation: float = PERTURBATION,
) -> Rigidity:  # fmt: skip
    """What `analysed` finds, without a warning: `Rigidity.caution` is for the caller to tell."""
    as_kind("k", k, "CornerSharing")
    tol, amount = as_positive("tolerance", tolerance), as_not_negative("perturbation", perturbation)
    moved = as_flag("generic", generic) and amount > 0.0
    at = k.perturbed(amount, seed=as_whole("seed", seed, 0, 2**63 - 1)) if moved else k
    pivots = _pivots(at)
    top = float(pivots.max(initial=0.0))
    part = pivots / top if top > 0.0 else pivots
    counts = part > tol
    return Rigidity(
        int(counts.sum()), len(k.edges), k.positions.size, k.trivial, tol,
        float(part[counts].min(initial=1.0)), float(part[~counts].max(initial=0.0)),
        amount if moved else 0.0,
    )  # fmt: skip


def _size(k: Structure) -> float:
    """Mean length of the edges, none of which is zero."""
    if not len(k.edges):
        raise GeometryError("the structure has no edges")
    if not k.lengths.min() > 0.0:
        i = int(np.argmin(k.lengths))
        raise GeometryError(f"edge {i} {k.edges[i].tolist()} has both ends at one place")
    return float(k.lengths.mean())


def _pivots(k: Structure) -> FloatArray:
    """Absolute pivots of the matrix, scaled by the mean length of edges."""
    R = csr_array(matrix(k) / _size(k))
    if k.deficit == 0 and len(k.edges) > SPARSE:
        pivots = _sparse_pivots(R, k)
        if pivots.min() > CLEAR * pivots.max():
            return pivots
    if len(k.edges) > SPARSE:
        at = np.flatnonzero(k.incidence[:, 1] < 0)
        columns = (k.dim * at[:, None] + np.arange(k.dim)).ravel()
        found = _by_elimination(R, columns) if 0 < len(columns) <= DENSE // 2 else None
        if found is not None:
            return found[1]
    if min(R.shape) <= DENSE:
        need(24.0 * R.shape[0] * R.shape[1], "a dense factorisation", "analyse a smaller part")
        tall = R.T if R.shape[0] < R.shape[1] else R
        upper = qr(tall.toarray(), mode="r", pivoting=True, overwrite_a=True, check_finite=False)[0]
        return np.abs(np.diag(upper))
    if k.deficit < 0:
        raise InputError(
            f"the structure has {len(k.edges)} edges, {-k.deficit} more than minimal rigidity: "
            f"above {DENSE} rows and columns only ranks of structures without are found"
        )
    pivots = _sparse_pivots(R, k)
    if pivots.min() <= (CLEAR if k.deficit else TOLERANCE) * pivots.max():  # roots of rounding
        raise GeometryError(
            f"the {len(k.edges)} edges are not independent at these positions, and the matrix is "
            "too large to count how many are; analyse a smaller part, or `perturbed` positions"
        )
    return pivots


def _sparse_pivots(R: csr_array, k: Structure) -> FloatArray:
    """Pivots of a matrix of full row rank, by LU: of a square part, or of R Rᵀ."""
    try:
        if k.deficit == 0:
            return np.abs(splu(csc_array(R[:, free_columns(k)].T)).U.diagonal())
        return np.sqrt(np.abs(splu(csc_array(R @ R.T)).U.diagonal()))
    except RuntimeError:  # exactly singular
        return np.zeros(1)


# ------------------------------------------------------------------------------ null spaces


def motions(k: Structure, ends: IntArray) -> tuple[FloatArray, int]:
    """Motions that change no length, at some vertices, and the rank of the matrix.

    Of more than 400 edges all other vertices are eliminated by sparse LU of the square of the
    matrix; if that does not keep the lengths to 1e-9, or of fewer, by dense QR.
    """
    R = csr_array(matrix(k) / _size(k))
    columns = (k.dim * ends[:, None] + np.arange(k.dim)).ravel()
    if len(k.edges) > SPARSE and len(columns) <= DENSE:
        found = _by_elimination(R, columns)
        if found is not None:
            return found[0], R.shape[1] - found[0].shape[1]
    if max(R.shape) > DENSE:
        raise GeometryError(
            f"motions of {len(k.positions)} vertices, {len(ends)} of which lack edges, are too "
            "many to be found, or edges depend on each other; stiffen smaller parts, by 'pattern', "
            "or use generic=True"
        )
    Q, upper, _ = qr(R.T.toarray(), pivoting=True, overwrite_a=True, check_finite=False)
    p = np.abs(np.diag(upper))
    rank = int((p > TOLERANCE * p.max(initial=0.0)).sum())
    return _orthonormal(np.asarray(Q[columns, rank:], np.float64)), rank


def _by_elimination(R: csr_array, columns: IntArray) -> tuple[FloatArray, FloatArray] | None:
    """Motions (c, z) at some coordinates, and all pivots, by the Schur complement of Rᵀ R.

    Small pivots are the rates at which the motions change lengths, not roots of rounding. None if
    they are not accurate, or there must be motions that leave these coordinates alone.
    """
    rest = np.setdiff1d(np.arange(R.shape[1]), columns)
    A, B = csc_array(R[:, rest]), csc_array(R[:, columns])
    S = (B.T @ B).toarray()
    X = np.zeros((len(rest), len(columns)))
    if len(rest):
        inner = _factorised(A)
        if inner is None:
            return None
        u = np.abs(inner.U.diagonal())
        if u.min() <= SINGULAR * u.max():
            return None
        C = csc_array(A.T @ B).toarray()
        X = inner.solve(C)
        S -= C.T @ X
    values, Z = eigh(S, overwrite_a=True, check_finite=False)
    count = int((values < SINGULAR * values[-1]).sum())
    Z = Z[:, :count]
    Y = X @ Z
    rates = B @ Z - A @ Y
    for _ in range(2 if len(rest) else 0):  # the square has lost half of the digits
        Y += inner.solve(np.asarray(A.T @ rates))
        rates = B @ Z - A @ Y
    if np.abs(rates).max(initial=0.0) > ACCURATE or count < R.shape[1] - R.shape[0]:
        return None
    pivots = np.full(min(R.shape), np.sqrt(values[-1]))
    pivots[: len(values) - count] = np.sqrt(values[count:])
    small = svd(rates, compute_uv=False, check_finite=False)
    left = len(pivots) - (R.shape[1] - count)
    pivots[len(pivots) - left :] = small[:left]
    return Z, pivots


def extended(k: Structure, ends: IntArray, Z: FloatArray) -> FloatArray:
    """Motions (d n, z) of all vertices from those of some, which keep all lengths."""
    R = csr_array(matrix(k) / _size(k))
    columns = (k.dim * ends[:, None] + np.arange(k.dim)).ravel()
    rest = np.setdiff1d(np.arange(R.shape[1]), columns)
    out = np.zeros((R.shape[1], Z.shape[1]))
    out[columns] = Z
    if len(rest):
        A = csc_array(R[:, rest])
        inner = _factorised(A)
        if inner is not None:
            out[rest] = -inner.solve(np.asarray(A.T @ (R[:, columns] @ Z)))
        if inner is None or np.abs(R @ out).max(initial=0.0) > ACCURATE:
            raise GeometryError(
                "bars between outer vertices do not suffice, and motions inside are not found to "
                f"{ACCURATE:g}: move the vertices (`perturbed`), or use generic=True"
            )
    return out


def _factorised(A: Any) -> Any:
    """Sparse LU of Aᵀ A; None if it is singular."""
    try:
        return splu(csc_array(A.T @ A), permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0)
    except RuntimeError:
        return None


def _orthonormal(Z: FloatArray) -> FloatArray:
    """Orthonormal basis of the columns, fewer than these if they depend on each other."""
    Q, upper, _ = qr(Z, mode="economic", pivoting=True, check_finite=False)
    p = np.abs(np.diag(upper))
    return np.asarray(Q[:, : int((p > TOLERANCE * p.max(initial=0.0)).sum())])


def _kernel_of(A: Any, tolerance: float) -> FloatArray:
    """Orthonormal basis of the vectors that are normal to the columns of a matrix."""
    if max(A.shape) > DENSE:
        raise InputError(
            f"null spaces are found up to {DENSE} edges or freedoms, and there are {max(A.shape)}: "
            "take a smaller part of the structure"
        )
    Q, upper, _ = qr(A.toarray(), pivoting=True, overwrite_a=True, check_finite=False)
    d = np.abs(np.diag(upper))
    part = d / (d.max(initial=0.0) or 1.0)
    counts = part > tolerance
    least, dropped = float(part[counts].min(initial=1.0)), float(part[~counts].max(initial=0.0))
    if least < UNSURE * tolerance or dropped > tolerance / UNSURE:
        warnings.warn(
            f"how many there are is not clear: pivots lie at {least:.1e} and {dropped:.1e} of the "
            f"largest, and the tolerance is {tolerance:.1e}; move the vertices a little, or set "
            "another tolerance",
            PrecisionWarning,
            stacklevel=3,
        )
    return np.asarray(Q[:, int(counts.sum()) :])


def self_stresses(k: Structure, *, tolerance: float = TOLERANCE) -> FloatArray:
    """Force densities that are in balance by themselves.

    Parameters
    ----------
    k : CornerSharing
        The structure, up to 6000 edges and freedoms.
    tolerance : float
        As in `analysed`.

    Returns
    -------
    ndarray, shape (e, s)
        Orthonormal columns.

    Warns
    -----
    PrecisionWarning
        If pivots lie within a factor 1000 of the tolerance.
    """
    return _kernel_of(matrix(k), as_positive("tolerance", tolerance))


def flexes(k: Structure, *, tolerance: float = TOLERANCE) -> FloatArray:
    """Infinitesimal motions that change no length, without the rigid ones.

    Parameters
    ----------
    k : CornerSharing
        The structure, up to 6000 edges and freedoms.
    tolerance : float
        As in `analysed`.

    Returns
    -------
    ndarray, shape (f, n, d)
        Orthonormal motions, normal to the rigid ones.

    Warns
    -----
    PrecisionWarning
        If pivots lie within a factor 1000 of the tolerance.
    """
    Z = _kernel_of(csr_array(matrix(k).T), as_positive("tolerance", tolerance))
    T = rigid_motions(k)
    Z = Z - T @ (T.T @ Z)
    Q, upper, _ = qr(Z, mode="economic", pivoting=True)
    some = np.abs(np.diag(upper)) > 1e-6
    own = np.ascontiguousarray(np.asarray(Q, np.float64)[:, : int(some.sum())].T)
    return own.reshape(-1, *k.positions.shape)


def swung(k: K, motion: ArrayLike, amplitude: float, *, frames: int = 16) -> list[K]:
    """Structures along a finite motion that begins as an infinitesimal one.

    Each frame is a step along the motion, then Gauss-Newton steps back to the lengths of the edges.

    Parameters
    ----------
    k : CornerSharing
        The structure.
    motion : array_like, shape (n, d)
        One of `flexes`; its rigid part does not count.
    amplitude : float
        Largest displacement of a vertex in the last frame, about.
    frames : int
        How many.

    Returns
    -------
    list of CornerSharing
        The frames, for `ilattice.io.write_pvd` or pictures.

    Raises
    ------
    GeometryError
        If the lengths cannot be kept, or only by moving all as one body: the motion is
        infinitesimal only, or ends.
    """
    given = as_motion(k, "motion", motion)
    count = as_whole("frames", frames, 1, 10_000)
    u = _without_rigid(k, given)
    if not np.linalg.norm(u) > 1e-9 * np.linalg.norm(given):
        raise InputError("motion must not be zero everywhere, or one of the whole as a rigid body")
    u /= np.linalg.norm(u, axis=1).max()
    step = as_positive("amplitude", amplitude) / count
    out, now, target = [], k, k.lengths
    for i in range(count):
        before = now
        now = with_lengths(now.moved(now.positions + step * u), target, fixed=())
        v = _without_rigid(before, now.positions - before.positions)
        if not np.linalg.norm(v) > KEPT * step * np.linalg.norm(u):
            raise GeometryError(
                f"the motion ends at frame {i} of {count}: lengths are kept by moving the whole as "
                "a rigid body only; it is infinitesimal, or the amplitude is too large"
            )
        u = v * (np.linalg.norm(u) / np.linalg.norm(v))
        out.append(now)
    return out


def _without_rigid(k: Structure, motion: FloatArray) -> FloatArray:
    """A motion less its rigid part."""
    T = rigid_motions(k)
    u = motion.ravel()
    for _ in range(2):
        u = u - T @ (T.T @ u)
    return np.asarray(u.reshape(motion.shape))
