"""Approximations of the inverse of a stiffness matrix: factors and hierarchies.

An engine is called with residuals, a vector (n,) or rows (r, n), and returns approximate solutions.
Guarantee: one that is singular to working precision raises `ConvergenceError` when it is made. The
optional packages are imported inside of functions.
"""

from __future__ import annotations

from collections.abc import Callable
from importlib import import_module
from importlib.util import find_spec
from typing import Any

import numpy as np
from scipy.sparse import csr_array, diags_array, triu
from scipy.sparse.csgraph import reverse_cuthill_mckee
from scipy.sparse.linalg import splu

from ilattice._typing import FloatArray
from ilattice.errors import ConvergenceError, InputError
from ilattice.linalg.multigrid import Multigrid
from ilattice.linalg.symmetric import Symmetric

Engine = Callable[[FloatArray], FloatArray]
#: Length of K⁻¹ b for unit b and a unit diagonal above which K counts as singular.
SINGULAR = 1e12
#: Numbers in a factor up to which it is faster than multigrid: SuperLU's, the same where multigrid
#: is slow, and PARDISO's. Of 38 matrices between the first two, of walls, struts, beams, plates and
#: blocks of degrees 1 and 2, whose cells are not flat, multigrid takes a third of the time of
#: SuperLU in the median, 1.3 times as long at most.
SMALL, SLOW_SMALL, MEDIUM = 1e6, 1.5e7, 6e7
#: Where it is slow: couplings per node, as of cubic splines; how much longer than thin clouds of
#: coupled nodes are, as in plates of flat cells (3.8 times as long as SuperLU at 6, 8 times at 29).
FAR, STRETCHED = 216, 5.0
#: Nodes that are looked at for that.
SAMPLE = 256
#: Numbers in a factor up to which SuperLU takes over where multigrid that was chosen fails.
LIMIT = 2e8


def multigrid(
    K: Symmetric, modes: FloatArray, coordinates: FloatArray | None = None
) -> tuple[Engine, int]:
    """Our own smoothed aggregation, and the bytes it takes."""
    engine = Multigrid(K, modes, coordinates)
    return engine, engine.nbytes


def superlu(K: Symmetric, *_: Any) -> tuple[Engine, int]:
    """SciPy's SuperLU for symmetric matrices, without pivoting."""
    d = 1 / np.sqrt(_positive_diagonal(K))
    try:
        lu = _factor(K.whole(), d)
    except RuntimeError as e:
        raise ConvergenceError(f"K is singular: SuperLU says '{e}'. {REMEDY}") from e
    except MemoryError as e:
        raise ConvergenceError("the factor does not fit into memory; use 'multigrid'") from e
    return _certain(lambda r: d * lu.solve((d * r).T).T, d), 12 * lu.nnz


def _factor(K: Any, d: FloatArray) -> Any:
    """SuperLU of a symmetric matrix whose rows and columns are scaled by d, without pivoting."""
    scaled = (diags_array(d) @ K.tocsr() @ diags_array(d)).tocsc()
    return splu(
        scaled, permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options={"SymmetricMode": True}
    )  # fmt: skip


def definite(A: Any) -> bool:
    """Whether a symmetric matrix is positive definite: all pivots are (Sylvester's inertia)."""
    diagonal = A.diagonal()
    if not diagonal.min() > 0:
        return False
    try:
        lu = _factor(A, 1 / np.sqrt(diagonal))
    except RuntimeError:
        return False
    return bool((lu.U.diagonal() > 0).all())


def pardiso(K: Symmetric, *_: Any) -> tuple[Engine, int]:
    """MKL's PARDISO for positive definite matrices, by pypardiso."""
    module = _optional("pypardiso.pardiso_wrapper", "pardiso")
    d = 1 / np.sqrt(_positive_diagonal(K))
    upper = triu(diags_array(d) @ K.whole().tocsr() @ diags_array(d), format="csr")
    upper = csr_array(upper)
    upper.sort_indices()
    solver = module.PyPardisoSolver(mtype=2)
    try:
        solver.factorize(upper)
    except module.PyPardisoError as e:
        raise ConvergenceError(f"K is singular: PARDISO says '{e}'. {REMEDY}") from e
    engine = _certain(_each(lambda r: d * np.ravel(solver.solve(upper, d * r))), d)
    return engine, 1024 * int(solver.get_iparm(17))


def pyamg(K: Symmetric, modes: FloatArray, *_: Any) -> tuple[Engine, int]:
    """Smoothed aggregation with block Gauss-Seidel by pyamg."""
    module = _optional("pyamg", "fem")
    _positive_diagonal(K)
    smoother = ("block_gauss_seidel" if K.size > 1 else "gauss_seidel", {"sweep": "symmetric"})
    ml = module.smoothed_aggregation_solver(
        K.whole(), B=modes, presmoother=smoother, postsmoother=smoother, max_coarse=500
    )
    operator = ml.aspreconditioner()
    held = sum(12 * level.A.nnz for level in ml.levels)
    return _each(lambda r: operator @ r), held


ENGINES = {"multigrid": multigrid, "pardiso": pardiso, "pyamg": pyamg, "superlu": superlu}
REMEDY = (
    "Is every part held against translation and rotation, none by an edge only, by springs far "
    "softer than it, or at the end of a length of hundreds of its width?"
)


def choose(K: Symmetric, coordinates: FloatArray | None = None) -> str:
    """The engine that is likely to be the fastest."""
    size = factor_size(K)
    if size <= MEDIUM and find_spec("pypardiso"):
        return "pardiso"
    if SMALL < size <= SLOW_SMALL:
        far = K.couplings >= FAR * K.rows
        slow = far or (coordinates is not None and stretch(K, coordinates) > STRETCHED)
        return "superlu" if slow else "multigrid"
    return "superlu" if size <= SMALL else "multigrid"


def stretch(K: Symmetric, coordinates: FloatArray) -> float:
    """How much longer than thin the clouds of coupled nodes are, in the median of some."""
    offsets, columns, _ = K.graph()
    ratios = []
    for i in np.unique(np.linspace(0, K.rows - 1, SAMPLE).astype(np.int64)):
        near = coordinates[columns[offsets[i] : offsets[i + 1]]]
        extents = np.linalg.svd(near - near.mean(axis=0), compute_uv=False)
        ratios.append(extents[0] / max(extents[-1], 1e-9 * extents[0]) if extents[0] > 0 else 1.0)
    return float(np.median(ratios))


def factor_size(K: Symmetric) -> float:
    """Estimate of the numbers in a Cholesky factor of K.

    The lesser of what an ordering by levels gives (slender parts) and the growth with n^(4/3) of
    nested dissection in three dimensions (blocks), whose separators are the thicker the farther
    nodes couple. Beyond LIMIT it is not refined.
    """
    n, m, nodes = K.shape[0], K.size, K.rows
    if 4.0 * n > LIMIT or K.nnz > LIMIT:
        return float(K.nnz)
    offsets, columns, _ = K.graph()
    graph = csr_array((np.ones(len(columns), np.int8), columns, offsets), shape=(nodes,) * 2)
    order = reverse_cuthill_mckee(graph, symmetric_mode=True)
    place = np.empty(nodes, np.int64)
    place[order] = np.arange(nodes)
    first = np.minimum.reduceat(place[columns], offsets[:-1])
    levels = m * m * float((place - np.minimum(first, place) + 1).sum())
    layers = max(len(columns) / (27 * nodes), 1.0) ** (1 / 3)
    return min(levels, 20.0 * n ** (4 / 3) * layers**2)


def _positive_diagonal(K: Symmetric) -> FloatArray:
    diagonal = K.diagonal()
    if not diagonal.min() > 0:
        i = int(np.argmin(diagonal))
        raise InputError(
            f"K must have a positive diagonal, got {diagonal[i]:g} in row {i}; drop nodes "
            "without stiffness"
        )
    return diagonal


def _certain(solve: Engine, d: FloatArray) -> Engine:
    """`solve`, unless inverse iteration finds a motion without stiffness."""
    v = np.sin(1.0 + np.arange(len(d), dtype=float) ** 2 % 7919)
    for _ in range(2):
        v /= np.linalg.norm(v)
        v = solve(v / d) / d
        length = float(np.linalg.norm(v))
        if not length < SINGULAR:
            raise ConvergenceError(
                f"K is singular: a unit load moves it by {length:.1e}, after scaling to a unit "
                f"diagonal. {REMEDY}"
            )
    return solve


def _each(solve: Engine) -> Engine:
    """An engine of one that takes vectors only."""

    def engine(r: FloatArray) -> FloatArray:
        return solve(r) if r.ndim == 1 else np.stack([solve(row) for row in r])

    return engine


def _optional(name: str, extra: str) -> Any:
    try:
        return import_module(name)
    except ImportError as e:
        package = name.partition(".")[0]
        raise InputError(
            f'method needs the package {package}: pip install "ilattice[{extra}]", or use another'
        ) from e
