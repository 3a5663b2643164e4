"""Weakly imposed conditions on surfaces: springs, and supports by Nitsche's method.

The symmetric method of Nitsche, 1971, with the penalty 10 p² / h times that of the law, such as
2 μ u·v + λ (u·n)(v·n), where h is the height in space of the cell along the normal, or less where
the solid is a thin layer there. On surfaces that cut cells it needs the ghost penalty, which
problems with such supports always have. Changes of volume that are projected cell by cell are not
held by that: the penalty of λ is at least twice what their tractions can do there.

Guarantee: consistent, so that the order of the space is kept; symmetric; the same for all laws.
"""

from dataclasses import replace
from typing import Any

import numpy as np

from ilattice._typing import FloatArray
from ilattice.cutfem._kernels_surface import seam_blocks
from ilattice.cutfem.assembly import Assembly
from ilattice.cutfem.conditions import Spring, Support, stiffness_at, values_at
from ilattice.cutfem.domain import Domain
from ilattice.cutfem.law import functions_at
from ilattice.cutfem.overlaps import held_before, held_by, joined, loads_at
from ilattice.cutfem.pointwise import FluxOn, Pointwise, Terms
from ilattice.quadrature.rules import Quadrature, on_cells

#: Penalty of weakly imposed supports, in units of stiffness times degree² over the height of cells.
NITSCHE = 10.0
#: Volume over area of a surface in a cell, in heights of it, below which the penalty grows as that
#: falls: so do the tractions that thin layers and slivers with no solid beside them can have. And
#: how thin they may seem.
THIN, THINNEST = 0.2, 1e-9


def terms_of(problem: Pointwise, support: Spring | Support) -> Terms:
    """Terms of a spring or a weak support."""
    asm, m = problem.assembly, problem.m
    rule = problem.domain.edge(asm, support.on)
    if isinstance(support, Spring):
        k = stiffness_at(problem.spring_name, support.stiffness, rule.points, m)
        Q, held = k[:, :, None] * np.eye(m), held_before(problem, rule)
        if held is not None:
            free = np.eye(m) - held
            Q = free @ Q @ free
        return Terms(rule, Q, None, np.zeros(m))
    scale = NITSCHE * asm.space.degree**2 / cell_heights(asm, rule)
    scale /= depths(problem.domain, asm, rule)
    normal, penalty = problem._at_surface(rule)
    mask, onto = support.mask.astype(np.float64), _onto(problem, support, rule)
    terms = Terms(rule, scale[:, None, None] * penalty, normal, mask, onto)
    terms = problem._with_pressure(terms, scale)
    assert terms.normal is not None
    held = terms.held(terms.held(terms.Q).transpose(0, 2, 1))  # of both sides, in what is held only
    return replace(terms, Q=held, normal=terms.held(terms.normal))


def _onto(problem: Pointwise, support: Support, rule: Quadrature) -> FloatArray | None:
    """Projections onto what a support holds and none before it; None for some components."""
    before = held_before(problem, rule, support)
    if before is None:
        return held_by(support, rule) if support.normal else None
    return joined(before, held_by(support, rule)) - before


def add(data: FloatArray, problem: Pointwise, terms: Terms) -> None:
    """Add the matrix of terms to blocks."""
    asm, rule, m = problem.assembly, terms.rule, problem.m
    nb = asm.space.dofs.shape[1]
    assert rule.parameters is not None
    for at, part, rows in asm.batches(rule, (m * nb) ** 2):
        A = np.empty((len(at), m * nb, m * nb))
        N, D = functions_at(asm, rule.parameters[rows], at[rule.owners[rows] - part.start])
        T = np.zeros((len(D), m, nb, m))
        if terms.normal is not None:
            T = through(terms.normal[rows], D)
        offsets = rule.offsets[part.start : part.stop + 1] - rows.start
        seam_blocks(len(A), offsets, rule.weights[rows], N, T, terms.Q[rows], A)
        asm.add_blocks(data, at, A)
    if terms.projection is not None:
        f = (rule.weights * terms.pressure)[:, None] * terms.held(_normals(rule))
        terms.projection.add_tractions(data, rule, f)


def force(problem: Pointwise, terms: Terms, value: Any) -> FloatArray:
    """Coefficients (functions, m) of the integral of g·Q v - held g·t(v)."""
    asm, rule, w = problem.assembly, terms.rule, terms.rule.weights
    g = values_at("value", value, rule.points, problem.m)
    if not g.any():
        return np.zeros((len(asm.space), problem.m))
    P = None
    if terms.normal is not None:
        P = -w[:, None, None] * np.einsum("qi,qijl->qjl", g, terms.normal)
    out = asm.vector(rule, w[:, None] * np.einsum("qij,qj->qi", terms.Q, g), P)
    if terms.projection is not None:
        normal = np.einsum("qi,qi->q", terms.held(g), _normals(rule))
        out += terms.projection.traction_force(rule, w * terms.pressure * normal)
    return out


def reaction(
    problem: Pointwise, terms: Terms, value: Any, c: FloatArray, flux_on: FluxOn
) -> FloatArray:
    """What comes in (n, m) at points: weights times what flows, minus Q (u - g).

    Of a solution with coefficients c (functions, m).
    """
    rule = terms.rule
    g = values_at("value", value, rule.points, problem.m)
    out = np.zeros((len(rule), problem.m))
    for rows, u, _ in problem.assembly.on_rule(c, rule):
        out[rows] = -np.einsum("qij,qj->qi", terms.Q[rows], u - g[rows])
    if terms.mask.any():
        out += terms.held(problem.law.through(flux_on(rule), _normals(rule)))
        out -= terms.held(loads_at(problem, rule))
    return rule.weights[:, None] * out


def _normals(rule: Quadrature) -> FloatArray:
    assert rule.normals is not None
    return rule.normals


def through(normal: FloatArray, D: FloatArray) -> FloatArray:
    """What flows (n, m, nb, m) of functions with gradients D (n, nb, 3); see `Law.normal`."""
    n, m = normal.shape[:2]
    T = normal.reshape(n, m * m, 3) @ D.transpose(0, 2, 1)
    return np.ascontiguousarray(T.reshape(n, m, m, -1).transpose(0, 1, 3, 2))


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


def depths(domain: Domain, asm: Assembly, rule: Quadrature) -> FloatArray:
    """How deep (n,) the solid behind the points of a surface rule is, at most 1; see `THIN`."""
    assert rule.parameters is not None
    cells = asm.space.cells
    at = np.searchsorted(cells, rule.cells)[rule.owners]
    volume = on_cells(domain.volume, cells)
    there = np.bincount(np.searchsorted(cells, volume.cells), volume.integrate_cells(), len(cells))
    area = np.bincount(at, rule.weights, len(cells))
    size = np.abs(np.linalg.det(asm.jacobians(rule.parameters)))
    depth = there[at] * size / (THIN * cell_heights(asm, rule) * area[at])
    return np.clip(depth, THINNEST, 1.0)
