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
from typing import TYPE_CHECKING

import numpy as np

from ilattice._typing import FloatArray
from ilattice.cutfem._kernels_surface import seam_blocks
from ilattice.cutfem._voigt import PLACES
from ilattice.cutfem.anisotropic import Anisotropic
from ilattice.cutfem.assembly import BATCH_BYTES, Assembly
from ilattice.cutfem.conditions import Load
from ilattice.cutfem.conduction import flux
from ilattice.cutfem.weak import (
    NITSCHE,
    cell_heights,
    depths,
    functions_at,
    normal_stiffness,
    tractions_of,
)
from ilattice.quadrature.rules import Quadrature

if TYPE_CHECKING:
    from ilattice.cutfem.heat import Heat
    from ilattice.cutfem.operators import ElasticOperators
    from ilattice.cutfem.problem import Problem

#: Takes the number of a side, its rows and gradients (n, nb, 3); returns tractions (n, m, nb, m).
Tractions = Callable[[int, slice, FloatArray], FloatArray]


def add_elastic(data: FloatArray, problem: "ElasticOperators") -> None:
    """Add what couples the phases of an elastic solid to blocks."""
    asm, rule, _ = _surface(problem.assembly)
    share, lame = _lame(problem)
    n = rule.normals
    assert n is not None
    scale = 2.0 * NITSCHE * asm.space.degree**2 / cell_heights(asm, rule)
    matrices = _matrices(problem)
    if matrices is not None:
        Q = sum(
            np.einsum("q,qijl,ql->qij", 2.0 * scale * s * s / f, normal_stiffness(C, n), n)
            for s, f, C in zip(share, both_depths(problem), matrices, strict=True)
        )
        _add(data, asm, np.asarray(Q), _tractions(problem))
        return
    deep = both_depths(problem)
    lam, mu = scale * sum(s * s / f * v for s, f, v in zip(share, deep, lame, strict=True))
    if problem.projection is not None:
        _add_projected(data, problem, [s * v[0] for s, v in zip(share, lame, strict=True)])
    nn = n[:, :, None] * n[:, None, :]
    Q = 2.0 * mu[:, None, None] * np.eye(3) + lam[:, None, None] * nn
    _add(data, asm, Q, _tractions(problem))


def _add_projected(
    data: FloatArray, problem: "ElasticOperators", weighed: list[FloatArray]
) -> None:
    """Add what projected pressures, λ of both sides weighed, do: - [N]·n λ π(div N), transposed."""
    asm, rule, _ = _surface(problem.assembly)
    projection, n = problem.projection, rule.normals
    assert projection is not None
    assert n is not None
    both, nb, terms = (rule, upper(rule)), asm.space.dofs.shape[1], projection.terms
    for pairs, rows in _batches(rule, (6 * nb) ** 2):
        owner, begin = rule.owners[rows], rule.offsets[:-1][pairs] - rows.start
        N = [functions_at(asm, both[side], at[owner], rows)[0] for side, at in enumerate(asm.sides)]
        jump = np.concatenate([N[0], -N[1]], axis=1)[:, :, None] * n[rows, None, :]
        A = np.zeros((len(begin), 6 * nb, 6 * nb))
        for side, at in enumerate(asm.sides):
            u = both[side].parameters
            assert u is not None
            m = projection.polynomials(u[rows], at[owner])
            m *= (rule.weights * weighed[side])[rows, None]
            H = np.add.reduceat(jump.reshape(len(m), -1, 1) * m[:, None, :], begin)
            G = projection.products[at[pairs]].reshape(len(begin), 3 * nb, terms)
            block = H @ (G @ projection.inverses[at[pairs]]).transpose(0, 2, 1)
            mine = slice(3 * nb * side, 3 * nb * (side + 1))
            A[:, :, mine] -= block
            A[:, mine, :] -= block.transpose(0, 2, 1)
        asm.add_pairs(data, pairs.start, A)


def add_waves(data: FloatArray, problem: "ElasticOperators") -> None:
    """Add what waves exp(i k x) v change of that to blocks (3, blocks, 3, 3): i k_j data[j].

    Their gradients grad v + i k v make up mean tractions, too; matrices are skew.
    """
    asm, rule, _ = _surface(problem.assembly)
    of, both, nb = _tractions(problem), (rule, upper(rule)), asm.space.dofs.shape[1]
    for pairs, rows in _batches(rule, 3 * (6 * nb) ** 2):
        values = [
            functions_at(asm, both[side], at[rule.owners[rows]], rows)[0]
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


def _lame(problem: "ElasticOperators") -> tuple[tuple[FloatArray, FloatArray], list[FloatArray]]:
    """Weights of the tractions of both phases, and their Lamé constants (2, n)."""
    asm, _, u = _surface(problem.assembly)
    lame = [
        np.stack([np.broadcast_to(v, len(u)) for v in material.lame(asm, u)])
        for material in problem.material.phases
    ]
    return shares(problem, *(lam + 2.0 * mu for lam, mu in lame)), lame


def _matrices(problem: "ElasticOperators") -> list[FloatArray] | None:
    """Stiffnesses (n, 6, 6) of both phases at the seam, of materials that are given by them."""
    asm, _, u = _surface(problem.assembly)
    found = [m for m in problem.material.phases if isinstance(m, Anisotropic)]
    return [np.broadcast_to(m.matrices(asm, u), (len(u), 6, 6)) for m in found] or None


def _tractions(problem: "ElasticOperators") -> Tractions:
    """Tractions of elastic phases, weighed."""
    share, lame = _lame(problem)
    assert problem.assembly.seam is not None
    n: FloatArray = problem.assembly.seam.normals  # type: ignore[assignment]
    matrices = _matrices(problem)
    if matrices is not None:
        both = [
            s[:, None, None, None] * normal_stiffness(C, n)
            for s, C in zip(share, matrices, strict=True)
        ]
        return lambda side, rows, D: tractions_of(both[side][rows], D)

    point = float(problem.projection is None)  # else pressures are added apart

    def tractions(side: int, rows: slice, D: FloatArray) -> FloatArray:
        lam, mu = (share[side] * lame[side])[:, rows] * [[point], [1.0]]
        normal = n[rows]
        T = lam[:, None, None, None] * normal[:, :, None, None] * D[:, None]
        T += mu[:, None, None, None] * np.einsum("qbi,qj->qibj", D, normal)
        along = mu[:, None] * np.einsum("qbk,qk->qb", D, normal)
        for i in range(3):
            T[:, i, :, i] += along
        return T

    return tractions


def add_heat(data: FloatArray, problem: "Heat") -> None:
    """Add what couples the phases of a conductor to blocks."""
    asm, rule, u = _surface(problem.assembly)
    n = rule.normals
    assert n is not None
    out_of = conducted(problem, u, n)
    k = [np.einsum("qi,qi->q", v, n) for v in out_of]
    share = shares(problem, *k)
    scale = 2.0 * NITSCHE * asm.space.degree**2 / cell_heights(asm, rule)
    deep = both_depths(problem)
    Q = scale * sum(s * s / f * v for s, f, v in zip(share, deep, k, strict=True))

    def fluxes(side: int, rows: slice, D: FloatArray) -> FloatArray:
        weighed = share[side][rows, None] * out_of[side][rows]
        return np.einsum("qbk,qk->qb", D, weighed)[:, None, :, None]

    _add(data, asm, Q[:, None, None], fluxes)


def conducted(problem: "Heat", u: FloatArray, n: FloatArray) -> list[FloatArray]:
    """Conductivities of both phases times normals, (n, 3) each."""
    return [flux(s.at(problem.assembly, u), n) for s in problem.conductivity.phases]


def thermal_force(problem: "ElasticOperators", load: Load) -> FloatArray:
    """Coefficients (functions, 3) of what the mean traction of hindered expansion adds."""
    asm, rule, u = _surface(problem.assembly)
    assert rule.normals is not None
    materials = problem.material.phases
    share = shares(problem, *(lam + 2.0 * mu for lam, mu in (m.lame(asm, u) for m in materials)))
    stress = np.zeros((len(u), 6))
    for part, one, at in zip(share, (rule, upper(rule)), asm.sides, strict=True):
        assert one.parameters is not None
        there = problem._thermal_stress(load, one.parameters, at[rule.owners])
        stress += part[:, None] * there
    f = rule.weights[:, None] * np.einsum("qij,qj->qi", stress[:, PLACES], rule.normals)
    return asm.vector(upper(rule), f) - asm.vector(rule, f)


def shares(
    problem: "Problem", first: FloatArray, second: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Weights of the tractions of two phases of some stiffness."""
    one, other = both_depths(problem)
    a, b = one * second, other * first
    return a / (a + b), b / (a + b)


def both_depths(problem: "Problem") -> tuple[FloatArray, FloatArray]:
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


def _add(data: FloatArray, asm: Assembly, Q: FloatArray, tractions: Tractions) -> None:
    """Add w ([N] Q [N] - [N] mean t(N) - its transpose), where [N] is low minus high."""
    rule, m = asm.seam, Q.shape[1]
    assert rule is not None
    both = (rule, upper(rule))
    nb = asm.space.dofs.shape[1]
    for pairs, rows in _batches(rule, (2 * m * nb) ** 2):
        N, T = [], []
        for side, at in enumerate(asm.sides):
            values, D = functions_at(asm, both[side], at[rule.owners[rows]], rows)
            N.append(values if side == 0 else -values)
            T.append(tractions(side, rows, D))
        A = np.empty((pairs.stop - pairs.start, 2 * m * nb, 2 * m * nb))
        seam_blocks(
            rule.offsets[pairs.start : pairs.stop + 1] - rows.start, rule.weights[rows],
            np.concatenate(N, axis=1), np.concatenate(T, axis=2), Q[rows], A,
        )  # fmt: skip
        asm.add_pairs(data, pairs.start, A)


def _batches(rule: Quadrature, entries: int) -> Iterator[tuple[slice, slice]]:
    """Slices of pairs and of their points."""
    size = max(BATCH_BYTES // (8 * entries), 8)
    for i in range(0, len(rule.cells), size):
        stop = min(i + size, len(rule.cells))
        yield slice(i, stop), slice(int(rule.offsets[i]), int(rule.offsets[stop]))
