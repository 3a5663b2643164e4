"""Weakly imposed conditions on surfaces: springs, and supports by Nitsche's method.

The symmetric method of Nitsche, 1971, with the penalty 10 p² (2 μ u·v + λ (u·n)(v·n)) / h, where h
is the height in space of the cell along the normal, or less where the solid is a thin layer there.
On surfaces that cut cells it needs the ghost penalty, which problems with such supports always
have. Changes of volume that are projected cell by cell are not held by that: the penalty of λ is at
least twice what their tractions can do there.

Guarantee: consistent, so that the order of the space is kept; symmetric.
"""

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from ilattice._typing import FloatArray, IntArray
from ilattice.bspline import _kernels_basis as basis
from ilattice.cutfem._kernels_surface import seam_blocks, surface_blocks
from ilattice.cutfem._voigt import PLACES, tensor
from ilattice.cutfem.anisotropic import Anisotropic
from ilattice.cutfem.assembly import Assembly
from ilattice.cutfem.conditions import Spring, Support, stiffness_at, values_at
from ilattice.cutfem.overlaps import held_before, held_by, joined, loads_at
from ilattice.cutfem.space import IDENTITY
from ilattice.quadrature.rules import Quadrature, on_cells

if TYPE_CHECKING:
    from ilattice.cutfem.domain import Domain
    from ilattice.cutfem.operators import ElasticOperators
    from ilattice.cutfem.solution import Solution

#: Penalty of weakly imposed supports, in units of stiffness times degree² over the height of cells.
NITSCHE = 10.0
#: Volume over area of a surface in a cell, in heights of it, below which the penalty grows as that
#: falls: so do the tractions that thin layers and slivers with no solid beside them can have. And
#: how thin they may seem.
THIN, LEAST = 0.2, 1e-9


@dataclass(frozen=True, eq=False)
class Terms:
    """The integral of u·Q v - mask u·t(v) - mask v·t(u), with tractions t.

    Attributes
    ----------
    rule : Quadrature
        In space.
    Q : ndarray, shape (n, 3, 3)
        Symmetric stiffness per area.
    lame : ndarray, shape (n, 2)
        Lamé constants of the tractions; zero for springs.
    pressure : ndarray, shape (n,)
        λ of tractions by a projected change of volume, which is not in `lame` then; else zero.
    mask : ndarray, shape (3,)
        1 in components that are held.
    along : ndarray, shape (n, 3, 3, 3), or None
        What makes tractions of a solid of any symmetry, see `normal_stiffness`; `lame` is not used
        then.
    onto : ndarray, shape (n, 3, 3), or None
        Projections onto what is held, in place of `mask`; `along` is given then.
    """

    rule: Quadrature
    Q: FloatArray
    lame: FloatArray
    pressure: FloatArray
    mask: FloatArray
    along: FloatArray | None = None
    onto: FloatArray | None = None

    def held(self, vectors: FloatArray, rows: slice = slice(None)) -> FloatArray:
        """The parts that are held of vectors (n, 3, ...) at points."""
        if self.onto is None:
            return vectors * self.mask.reshape(3, *[1] * (vectors.ndim - 2))
        return np.einsum("qij,qj...->qi...", self.onto[rows], vectors)


def elastic_terms(problem: "ElasticOperators", support: Spring | Support) -> Terms:
    """Terms of a spring or a weak support."""
    asm = problem.assembly
    rule = problem.domain.edge(asm, support.on)
    u, n = rule.parameters, rule.normals
    assert u is not None
    assert n is not None
    if isinstance(support, Spring):
        Q = stiffness_at("stiffness", support.stiffness, rule.points, 3)[:, :, None] * np.eye(3)
        held = held_before(problem, rule)
        if held is not None:
            free = np.eye(3) - held
            Q = free @ Q @ free
        none = np.zeros((len(u), 3))
        return Terms(rule, Q, none[:, :2], none[:, 2], np.zeros(3))
    scale = NITSCHE * asm.space.degree**2 / cell_heights(asm, rule)
    scale /= depths(problem.domain, asm, rule)
    mask, onto = support.mask.astype(np.float64), _onto(problem, support, rule)
    if isinstance(problem.material, Anisotropic):
        along = normal_stiffness(problem._matrices(u, asm.owners(rule)), n)
        # of tractions that a strain makes no more than this can be had from its energy
        Q = 2.0 * scale[:, None, None] * np.einsum("qijl,ql->qij", along, n)
        none = np.zeros((len(u), 3))
        return _projected(Terms(rule, Q, none[:, :2], none[:, 2], mask, along, onto))
    both = problem._lame(u, asm.owners(rule))
    lame = np.stack([np.broadcast_to(v, len(u)) for v in both], axis=1)
    nn = n[:, :, None] * n[:, None, :]
    Q = 2 * lame[:, 1, None, None] * np.eye(3) + lame[:, 0, None, None] * nn
    Q *= scale[:, None, None]
    pressure = np.zeros(len(u))
    if problem.projection is not None:
        pressure, lame[:, 0] = lame[:, 0].copy(), 0.0
        least = 2.0 * problem.projection.traces(rule, rule.weights * pressure)[rule.owners]
        Q += (np.maximum(least - scale, 0.0) * pressure)[:, None, None] * nn
    full = None if onto is None else isotropic_stiffness(lame, n)
    return _projected(Terms(rule, Q, lame, pressure, mask, full, onto))


def _onto(problem: "ElasticOperators", support: Support, rule: Quadrature) -> FloatArray | None:
    """Projections onto what a support holds and none before it; None for some components."""
    before = held_before(problem, rule, support)
    if before is None:
        return held_by(support, rule) if support.normal else None
    return joined(before, held_by(support, rule)) - before


def _projected(terms: Terms) -> Terms:
    """Terms with a stiffness in what is held only."""
    return replace(terms, Q=terms.held(terms.held(terms.Q).transpose(0, 2, 1)))


def add_elastic(data: FloatArray, problem: "ElasticOperators", terms: Terms) -> None:
    """Add the matrix of terms to blocks."""
    asm, rule = problem.assembly, terms.rule
    assert rule.parameters is not None
    assert rule.normals is not None
    size = 3 * asm.space.dofs.shape[1]
    for at, part, rows in asm.batches(rule, size * size):
        A = np.empty((len(at), size, size))
        u, offsets = rule.parameters[rows], rule.offsets[part.start : part.stop + 1] - rows.start
        if terms.along is not None:
            N, D = functions_at(asm, rule, at[rule.owners[rows] - part.start], rows)
            T = terms.held(tractions_of(terms.along[rows], D), rows)
            seam_blocks(offsets, rule.weights[rows], N, T, terms.Q[rows], A)
            asm.add_blocks(data, at, A)
            continue
        surface_blocks(
            *asm.space._tables, asm.space.cell_indices[at], asm.space.boxes[at],
            offsets, u, rule.weights[rows],
            asm.jacobians(u), rule.normals[rows], terms.Q[rows], terms.lame[rows], terms.mask, A,
        )  # fmt: skip
        asm.add_blocks(data, at, A)
    if problem.projection is not None and terms.pressure.any():
        f = (rule.weights * terms.pressure)[:, None] * terms.held(rule.normals)
        problem.projection.add_tractions(data, rule, f)


def elastic_force(problem: "ElasticOperators", terms: Terms, value: Any) -> FloatArray:
    """Coefficients (functions, 3) of the integral of g·Q v - mask g·t(v)."""
    asm, rule = problem.assembly, terms.rule
    g = values_at("value", value, rule.points, 3)
    if not g.any():
        return np.zeros((len(asm.space), 3))
    n, held = rule.normals, terms.held(g)
    assert n is not None
    if terms.along is not None:
        P = np.einsum("qi,qijl->qjl", held, terms.along)
    else:
        P = held[:, :, None] * n[:, None, :]
        P = terms.lame[:, 1, None, None] * (P + P.transpose(0, 2, 1))
        P += (terms.lame[:, 0] * np.einsum("qi,qi->q", held, n))[:, None, None] * np.eye(3)
    w = rule.weights
    f = w[:, None] * np.einsum("qij,qj->qi", terms.Q, g)
    out = asm.vector(rule, f, -w[:, None, None] * P)
    if problem.projection is not None and terms.pressure.any():
        normal = np.einsum("qi,qi->q", held, n)
        out += problem.projection.traction_force(rule, w * terms.pressure * normal)
    return out


def thermal_force(problem: "ElasticOperators", terms: Terms) -> FloatArray:
    """Coefficients of what the tractions of hindered expansion add to weak supports."""
    asm, rule = problem.assembly, terms.rule
    f = np.zeros((len(asm.space), 3))
    for load in problem.loads:
        if load.kind == "temperature":
            assert rule.parameters is not None
            assert rule.normals is not None
            s = problem._thermal_stress(load, rule.parameters, asm.owners(rule))
            t = np.einsum("qij,qj->qi", s[:, PLACES], rule.normals)
            f += asm.vector(rule, rule.weights[:, None] * terms.held(t))
    return f


def elastic_reaction(
    problem: "ElasticOperators", terms: Terms, value: Any, solution: "Solution"
) -> FloatArray:
    """Forces (n, 3) on the solid at points: weights times tractions minus Q (u - g)."""
    rule = terms.rule
    assert rule.normals is not None
    g = values_at("value", value, rule.points, 3)
    out = np.zeros((len(rule), 3))
    for rows, u, _ in problem.assembly.on_rule(solution.coefficients, rule):
        out[rows] = -np.einsum("qij,qj->qi", terms.Q[rows], u - g[rows])
    if terms.mask.any():
        s = solution.stress_on(rule)[:, PLACES]
        out += terms.held(np.einsum("qij,qj->qi", s, rule.normals))
        out -= terms.held(loads_at(problem, rule))
    return rule.weights[:, None] * out


def cell_heights(asm: Assembly, rule: Quadrature) -> FloatArray:
    """Heights (n,) in space of the cells of a surface rule along its normals.

    The inverse length of the gradient of the distance along the normal in the unit of the cell.
    """
    assert rule.parameters is not None
    assert rule.normals is not None
    J = asm.jacobians(rule.parameters)
    extent = rule.grid.boxes(rule.cells)[:, 3:][rule.owners]
    along = np.einsum("qki,qi->qk", np.broadcast_to(np.linalg.inv(J), (len(rule), 3, 3)),
                      rule.normals) / extent  # fmt: skip
    return 1.0 / np.linalg.norm(along, axis=1)


def depths(domain: "Domain", asm: Assembly, rule: Quadrature) -> FloatArray:
    """How deep (n,) the solid behind the points of a surface rule is, at most 1; see `THIN`."""
    assert rule.parameters is not None
    cells = asm.space.cells
    at = np.searchsorted(cells, rule.cells)[rule.owners]
    volume = on_cells(domain.volume, cells)
    there = np.bincount(np.searchsorted(cells, volume.cells), volume.integrate_cells(), len(cells))
    area = np.bincount(at, rule.weights, len(cells))
    size = np.abs(np.linalg.det(asm.jacobians(rule.parameters)))
    depth = there[at] * size / (THIN * cell_heights(asm, rule) * area[at])
    return np.clip(depth, LEAST, 1.0)


def normal_stiffness(C: FloatArray, n: FloatArray) -> FloatArray:
    """What makes tractions of gradients: n_k C_ikjl as (q, i, j, l), of C (q, 6, 6) or (1, 6, 6).

    Its product with n over l is Christoffel's matrix; the square of a traction in its inverse is at
    most the energy of the strain, by Cauchy and Schwarz.
    """
    if len(C) == 1:
        return np.einsum("ikjl,qk->qijl", tensor(C[0]), n)
    return np.einsum("qikjl,qk->qijl", tensor(C), n)


def isotropic_stiffness(lame: FloatArray, n: FloatArray) -> FloatArray:
    """The same of isotropic materials with Lamé constants (n, 2): λ and μ."""
    one = np.eye(3)
    lam, mu = lame[:, 0, None, None, None], lame[:, 1, None, None, None]
    out = lam * np.einsum("qi,jl->qijl", n, one)
    out += mu * (np.einsum("ql,ij->qijl", n, one) + np.einsum("qj,il->qijl", n, one))
    return out


def tractions_of(along: FloatArray, D: FloatArray) -> FloatArray:
    """Tractions (n, 3, nb, 3) of functions with gradients D (n, nb, 3) along unit vectors."""
    return np.einsum("qijl,qbl->qibj", along, D)


def functions_at(
    asm: Assembly, rule: Quadrature, at: IntArray, rows: slice
) -> tuple[FloatArray, FloatArray]:
    """Values (n, nb) and gradients in space (n, nb, 3) of the functions of the element of each."""
    assert rule.parameters is not None
    space, u = asm.space, rule.parameters[rows]
    n, nb = len(u), asm.space.dofs.shape[1]
    N, D = np.empty((n, nb, 1)), np.empty((n, nb, 3))
    where = (*space._tables, space.cell_indices[at], space.boxes[at], np.arange(n + 1), u)
    basis.vectors(*where, IDENTITY, np.ones((n, 1)), np.zeros((0, 1, 3)), N)
    unit = np.ascontiguousarray(np.broadcast_to(np.eye(3), (n, 3, 3)))
    basis.vectors(*where, asm.jacobians(u), np.zeros((0, 3)), unit, D)
    return N[:, :, 0], D
