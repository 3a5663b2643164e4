"""What supports hold where they overlap: each direction once.

Nitsche's method adds the tractions of what a support holds. Where two supports hold the same, they
would count twice, and the solution would be that of a body with tractions of its own there. So a
support holds what no weak one before it does. Tractions and springs that act on what is held go
into the support, not into the solid, as they do where functions are fixed.

Guarantee: points of places are the same to the last bit wherever these overlap, as their rules are
parts of one. Non-guarantee: places that touch in curves only share nothing.
"""

from itertools import combinations

import numpy as np

from ilattice._typing import FloatArray, IntArray
from ilattice.cutfem.assembly import Assembly
from ilattice.cutfem.conditions import Support, values_at
from ilattice.cutfem.constraints import SAME
from ilattice.cutfem.domain import Domain
from ilattice.cutfem.places import Spot
from ilattice.cutfem.pointwise import Pointwise
from ilattice.errors import InputError
from ilattice.quadrature.rules import Quadrature

#: Part of a direction that is left of it without another one, below which it is that one.
MIN_REST = 1e-6
#: A normal is along axes if its part along the others is no longer than this.
ALONG = 1e-9


def held_by(support: Support, rule: Quadrature) -> FloatArray:
    """Projections onto what a support holds.

    Parameters
    ----------
    support : Support
        With components, or along normals.
    rule : Quadrature
        Points of its place.

    Returns
    -------
    ndarray, shape (n, m, m)
        Symmetric.
    """
    if support.normal:
        assert rule.normals is not None
        return rule.normals[:, :, None] * rule.normals[:, None, :]
    one = np.diag(support.mask.astype(np.float64))
    return np.broadcast_to(one, (len(rule), *one.shape)).copy()


def held_before(
    problem: Pointwise, rule: Quadrature, support: Support | None = None
) -> FloatArray | None:
    """Projections onto what weak supports hold at points of a surface.

    Parameters
    ----------
    problem : Pointwise
        Gives the supports.
    rule : Quadrature
        Points in space, of active cells.
    support : Support, optional
        The one up to which they count; by default all do.

    Returns
    -------
    ndarray, shape (n, m, m), or None
        Nothing where none of them holds anything.
    """
    out = None
    for one in problem.supports:
        if one is support:
            break
        if not one.weak:
            continue
        rows, _ = _shared(rule, problem.domain.edge(problem.assembly, one.on))
        if len(rows):
            out = np.zeros((len(rule), problem.m, problem.m)) if out is None else out
            out[rows] = joined(out[rows], held_by(one, rule)[rows])
    return out


def check_agreement(domain: Domain, asm: Assembly, supports: tuple[Support, ...], m: int) -> None:
    """Refuse different values at one point, at least one of them weakly imposed.

    Parameters
    ----------
    domain, asm, supports, m
        As in `ilattice.cutfem.constraints.constraints`.

    Raises
    ------
    InputError
        If two supports prescribe different values.
    """
    for s, t in combinations(supports, 2):
        if not (s.weak or t.weak):
            continue
        rule = domain.edge(asm, s.on)
        rows, _ = _shared(rule, domain.edge(asm, t.on))
        if not len(rows):
            continue
        assert rule.normals is not None
        x, held = rule.points[rows], _held_by_both(s, t, rule.normals[rows])
        a, b = (values_at("value", one.value, x, m) for one in (s, t))
        off = np.abs(np.einsum("nij,nj->ni", held, a - b))
        if off.max() > SAME * max(_largest(s, a), _largest(t, b)):
            row, column = np.unravel_index(np.argmax(off), off.shape)
            a, b = (np.einsum("ij,j->i", held[row], values[row]) for values in (a, b))
            raise InputError(
                f"supports on {s.on!r} and {t.on!r} contradict each other: near the point "
                f"{np.round(x[row], 6).tolist()} one asks for {a[column]:g} and the other "
                f"for {b[column]:g}; prescribe it once, or equal values"
            )


def _held_by_both(s: Support, t: Support, n: FloatArray) -> FloatArray:
    """Projections (n, m, m) on what two supports both prescribe, at points with normals."""
    both = np.diag((s.mask & t.mask).astype(float))
    if not (s.normal or t.normal):
        return np.broadcast_to(both, (len(n), *both.shape))
    within = np.abs(np.where(s.mask & t.mask, 0.0, n)).max(axis=1, initial=0.0) < ALONG
    return n[:, :, None] * n[:, None, :] * within[:, None, None]


def _largest(s: Support, values: FloatArray) -> float:
    """Largest value of a support; along normals they are rounded as whole vectors are."""
    return float(np.abs(values if s.normal else values[:, s.mask]).max())


def loads_at(problem: Pointwise, rule: Quadrature) -> FloatArray:
    """Loads on surfaces.

    Parameters
    ----------
    problem : Pointwise
        Gives the loads.
    rule : Quadrature
        Points in space, of active cells, with normals.

    Returns
    -------
    ndarray, shape (n, m)
        Per area; nothing but at points of the places of loads.
    """
    out = np.zeros((len(rule), problem.m))
    for load in problem.loads:
        if not load.on or isinstance(load.on, Spot):
            continue
        own = problem.domain.edge(problem.assembly, load.on)
        rows, there = _shared(rule, own)
        if len(rows):
            density = problem._density(problem._spread(load), own)[0]
            assert density is not None
            out[rows] += density[there]
    return out


def joined(one: FloatArray, other: FloatArray) -> FloatArray:
    """Projections (n, m, m) onto what one or another of two projections leaves whole."""
    values, vectors = np.linalg.eigh(one + other)
    kept = vectors * (values > MIN_REST)[:, None, :]
    out: FloatArray = kept @ vectors.transpose(0, 2, 1)
    return out


def _shared(rule: Quadrature, other: Quadrature) -> tuple[IntArray, IntArray]:
    """Numbers of the points of a rule that another one has, too, and their numbers there."""
    if rule is other:
        return np.arange(len(rule)), np.arange(len(rule))
    nothing = np.zeros(0, np.int64), np.zeros(0, np.int64)
    if not (len(rule) and len(other)):
        return nothing
    low = np.maximum(rule.points.min(axis=0), other.points.min(axis=0))
    if (low > np.minimum(rule.points.max(axis=0), other.points.max(axis=0))).any():
        return nothing
    x, y = (
        np.ascontiguousarray(r.points).view([("", np.float64)] * 3).ravel() for r in (rule, other)
    )
    _, rows, there = np.intersect1d(x, y, return_indices=True)
    return rows, there
