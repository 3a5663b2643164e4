"""Two phases held together where they meet, by Nitsche's method.

Symmetric, with tractions that are weighed by the stiffness of the other phase, so that neither
a hard nor a soft inclusion spoils the condition of the matrix (Burman and Zunino, 2006), and by how
deep the phases are, so that thin coats do not (Annavarapu, Hautefeuille and Dolbow, 2012), and the
penalty 10 p² / h of `weak`, of what these weights leave of the stiffness. Slivers need the ghost
penalty, which phased problems always have.

Guarantees: consistent and symmetric; a jump of the stiffness of any size changes no order.
"""

from collections.abc import Callable, Iterator
from dataclasses import replace
from itertools import pairwise

import numpy as np

from ilattice._typing import FloatArray, IntArray
from ilattice.cutfem._kernels_surface import seam_blocks
from ilattice.cutfem._voigt import PLACES
from ilattice.cutfem.assembly import BATCH_BYTES, Assembly
from ilattice.cutfem.dilatation import Dilatation
from ilattice.cutfem.law import Law, functions_at
from ilattice.cutfem.pointwise import Pointwise
from ilattice.cutfem.weak import NITSCHE, cell_heights, depths, through
from ilattice.quadrature.rules import Quadrature

#: Takes the number of a side, its rows and gradients (n, nb, 3); returns tractions (n, m, nb, m).
Tractions = Callable[[int, slice, FloatArray], FloatArray]
Pair = tuple[FloatArray, FloatArray]


def add(data: FloatArray, problem: Pointwise) -> None:
    """Add what couples the phases of a solid to blocks."""
    asm, rule, u = _surface(problem.assembly)
    n = rule.normals
    assert n is not None
    weights = weights_of(problem)
    scale = 2.0 * NITSCHE * asm.space.degree**2 / cell_heights(asm, rule)
    Q = sum(
        (scale * s * s / f)[:, None, None] * law.penalty(asm, u, n)
        for s, f, law in zip(weights, both_depths(problem), problem.law.phases, strict=True)
    )
    _add(data, asm, np.asarray(Q), tractions(problem, weights))


def add_projected(
    data: FloatArray, problem: Pointwise, projection: Dilatation, moduli: Pair
) -> None:
    """Add what projected pressures, λ of both sides weighed, do: - [N]·n λ π(div N), transposed.

    The moduli are λ (n,) or (1,) of both sides at the points of the seam.
    """
    asm, rule, _ = _surface(problem.assembly)
    weighed = [w * lam for w, lam in zip(weights_of(problem), moduli, strict=True)]
    n = rule.normals
    assert n is not None
    both, nb, terms = (rule, upper(rule)), asm.space.dofs.shape[1], projection.terms
    for pairs, rows in _batches(rule, (6 * nb) ** 2):
        owner, begin = rule.owners[rows], rule.offsets[:-1][pairs] - rows.start
        N = [_functions(asm, both[side], at[owner], rows)[0] for side, at in enumerate(asm.sides)]
        jump = np.concatenate([N[0], -N[1]], axis=1)[:, :, None] * n[rows, None, :]
        A = np.zeros((len(begin), 6 * nb, 6 * nb))
        for side, at in enumerate(asm.sides):
            at_side = both[side].parameters
            assert at_side is not None
            m = projection.polynomials(at_side[rows], at[owner])
            m *= (rule.weights * weighed[side])[rows, None]
            H = np.add.reduceat(jump.reshape(len(m), -1, 1) * m[:, None, :], begin)
            G = projection.products[at[pairs]].reshape(len(begin), 3 * nb, terms)
            block = H @ (G @ projection.inverses[at[pairs]]).transpose(0, 2, 1)
            mine = slice(3 * nb * side, 3 * nb * (side + 1))
            A[:, :, mine] -= block
            A[:, mine, :] -= block.transpose(0, 2, 1)
        asm.add_pairs(data, pairs.start, A)


def add_waves(data: FloatArray, problem: Pointwise, whole: Assembly) -> None:
    """Add what waves exp(i k x) v change of that to blocks (3, blocks, 3, 3): i k_j data[j].

    Their gradients grad v + i k v make up mean tractions, too; matrices are skew, so that `whole`
    is not one of halves.
    """
    asm, rule, _ = _surface(whole)
    of, both, nb = tractions(problem), (rule, upper(rule)), asm.space.dofs.shape[1]
    for pairs, rows in _batches(rule, 3 * (6 * nb) ** 2):
        values = [
            _functions(asm, both[side], at[rule.owners[rows]], rows)[0]
            for side, at in enumerate(asm.sides)
        ]
        jumps = np.concatenate([values[0], -values[1]], axis=1) * rule.weights[rows, None]
        ends = rule.offsets[pairs.start : pairs.stop + 1] - rows.start
        for j in range(3):
            D = [v[:, :, None] * np.eye(3)[j] for v in values]
            T = np.concatenate([of(side, rows, d) for side, d in enumerate(D)], axis=2)
            A = np.empty((len(ends) - 1, 6 * nb, 6 * nb))
            for e, (a, b) in enumerate(pairwise(ends)):
                one = np.einsum("qa,qibj->aibj", jumps[a:b], T[a:b]).reshape(A.shape[1:])
                A[e] = one.T - one
            asm.add_pairs(data[j], pairs.start, A)


def tractions(problem: Pointwise, weights: Pair | None = None) -> Tractions:
    """What flows through the surface between phases, weighed."""
    weights = weights_of(problem) if weights is None else weights
    both = [
        w[:, None, None, None] * normal
        for w, normal in zip(weights, problem._at_seam(), strict=True)
    ]
    return lambda side, rows, D: through(both[side][rows], D)


def thermal_force(
    problem: Pointwise, stress_at: Callable[[FloatArray, IntArray], FloatArray]
) -> FloatArray:
    """Coefficients (functions, 3) of what the mean traction of hindered expansion adds.

    Its stress (n, 6) is a function of parameters (n, 3) in active cells (n,).
    """
    asm, rule, u = _surface(problem.assembly)
    assert rule.normals is not None
    stress = np.zeros((len(u), 6))
    for part, one, at in zip(weights_of(problem), (rule, upper(rule)), asm.sides, strict=True):
        assert one.parameters is not None
        there = stress_at(one.parameters, at[rule.owners])
        stress += part[:, None] * there
    f = rule.weights[:, None] * np.einsum("qij,qj->qi", stress[:, PLACES], rule.normals)
    return asm.vector(upper(rule), f) - asm.vector(rule, f)


def weights_of(problem: Pointwise) -> Pair:
    """Weights (n,) of what flows through both phases at the seam: of each the more, the softer."""
    asm, rule, u = _surface(problem.assembly)
    assert rule.normals is not None
    one, other = both_depths(problem)
    first, second = (law.along(asm, u, rule.normals) for law in problem.law.phases)
    a, b = one * second, other * first
    return a / (a + b), b / (a + b)


def mean_force(problem: Pointwise, flux: Callable[[Law], FloatArray]) -> FloatArray:
    """Coefficients (functions, m) of the mean of what flows at the seam, of a flux in each phase.

    Parameters
    ----------
    problem : Pointwise
        With two phases.
    flux : callable
        Takes the law of a phase, returns its flux (n, entries) at the points of the seam.

    Returns
    -------
    ndarray, shape (functions, m)
        Of the first phase less those of the second.
    """
    asm, rule, _ = _surface(problem.assembly)
    assert rule.normals is not None
    out = sum(
        w[:, None] * law.through(flux(law), rule.normals)
        for w, law in zip(weights_of(problem), problem.law.phases, strict=True)
    )
    f = rule.weights[:, None] * np.asarray(out)
    return asm.vector(rule, f) - asm.vector(upper(rule), f)


def both_depths(problem: Pointwise) -> tuple[FloatArray, FloatArray]:
    """How deep both phases are at the seam; see `weak.depths`."""
    asm, rule, _ = _surface(problem.assembly)

    def make() -> tuple[FloatArray, FloatArray]:
        return depths(problem.domain, asm, rule), depths(problem.domain, asm, upper(rule))

    found: tuple[FloatArray, FloatArray] = problem.domain.once(("depths", asm), make)
    return found


def upper(rule: Quadrature) -> Quadrature:
    """A rule on a seam by the elements of the second phase."""
    assert rule.neighbours is not None
    assert rule.parameters is not None
    u, grid = rule.parameters.copy(), rule.grid
    box = grid.boxes(rule.neighbours)[rule.owners]
    for a in np.flatnonzero(grid.closed):  # the cell may be on the other side of the end
        period = grid.axes[a][-1] - grid.axes[a][0]
        middle = box[:, a] + 0.5 * box[:, 3 + a]
        u[:, a] -= period * np.rint((u[:, a] - middle) / period)
    return replace(rule, cells=rule.neighbours, neighbours=None, parameters=u)


def _surface(asm: Assembly) -> tuple[Assembly, Quadrature, FloatArray]:
    """The seam of an assembly, and its points in parameters."""
    assert asm.seam is not None
    assert asm.seam.parameters is not None
    return asm, asm.seam, asm.seam.parameters


def _add(data: FloatArray, asm: Assembly, Q: FloatArray, flows: Tractions) -> None:
    """Add w ([N] Q [N] - [N] mean t(N) - its transpose), where [N] is low minus high."""
    rule, m = asm.seam, Q.shape[1]
    assert rule is not None
    both = (rule, upper(rule))
    nb = asm.space.dofs.shape[1]
    for pairs, rows in _batches(rule, (2 * m * nb) ** 2):
        N, T = [], []
        for side, at in enumerate(asm.sides):
            values, D = _functions(asm, both[side], at[rule.owners[rows]], rows)
            N.append(values if side == 0 else -values)
            T.append(flows(side, rows, D))
        A = np.empty((pairs.stop - pairs.start, 2 * m * nb, 2 * m * nb))
        seam_blocks(
            len(A), rule.offsets[pairs.start : pairs.stop + 1] - rows.start, rule.weights[rows],
            np.concatenate(N, axis=1), np.concatenate(T, axis=2), Q[rows], A,
        )  # fmt: skip
        asm.add_pairs(data, pairs.start, A)


def _functions(
    asm: Assembly, rule: Quadrature, at: IntArray, rows: slice
) -> tuple[FloatArray, FloatArray]:
    """Values and gradients of the functions of one side, see `functions_at`."""
    assert rule.parameters is not None
    return functions_at(asm, rule.parameters[rows], at)


def _batches(rule: Quadrature, entries: int) -> Iterator[tuple[slice, slice]]:
    """Slices of pairs and of their points."""
    size = max(BATCH_BYTES // (8 * entries), 8)
    for i in range(0, len(rule.cells), size):
        stop = min(i + size, len(rule.cells))
        yield slice(i, stop), slice(int(rule.offsets[i]), int(rule.offsets[stop]))
