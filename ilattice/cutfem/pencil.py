"""Matrices of eigenvalue problems on what is free of a solid, rigid connections included.

The motions q of rigid connections are unknowns beside those of free nodes. Each node is counted
from where a motion takes it by itself: displacements are ``x + W q`` with the solutions W of unit
motions (R. Craig and M. Bampton, "Coupling of substructures for dynamic analyses", AIAA J. 6,
1968). In these coordinates the stiffness falls apart into that of a solid whose connections are at
rest, and a small matrix of the connections, so that the solver of the former serves for both.

A connection turns by finite angles: points at r from where its force acts move by
``½ θ x (θ x r)`` to second order. The forces f by which it holds the solid do work on that, which
is part of what is stiff against buckling: ``θ·H θ`` with the symmetric part of ``Σ f r - (f·r) 1``.
A load on top of a rigid post topples it by that alone.

Guarantee: the same numbers as with a full matrix of both, to the tolerance of the solver. Moments
on connections count as those whose work is moment times rotation vector; other moments (of a fixed
axis, of one that turns along) have other critical values, and none of them is a dead load.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.sparse import block_array, csr_array

from ilattice._typing import FloatArray
from ilattice._validate import Frozen, read_only
from ilattice.cutfem import rigid
from ilattice.cutfem.elasticity import Elasticity, Solution
from ilattice.cutfem.places import Motion
from ilattice.linalg.solvers import Solver


@dataclass(frozen=True, eq=False)
class Pencil(Frozen):
    """The stiffness on free unknowns, and how other matrices and shapes belong to it.

    Attributes
    ----------
    problem : Elasticity
        With connections, if any, at rest.
    K : sparse array, shape (n, n)
        Stiffness, with the shift.
    solver : Solver or Joined
        Of it.
    starts : ndarray, shape (n, k)
        Motions with little energy.
    W : ndarray, shape (connections * 6, functions, 3)
        Displacements by unit motions of the connections.
    S : ndarray, shape (connections * 6, connections * 6)
        Stiffness of the connections.
    size : float
        Unit rotations are those by one over this.
    """

    problem: Elasticity
    K: Any
    solver: Any
    starts: FloatArray
    W: FloatArray
    S: FloatArray
    size: float

    def reduced(self, full: Any, own: FloatArray | None = None) -> Any:
        """A matrix of all functions on the free unknowns.

        Parameters
        ----------
        full : bsr_array
            Symmetric, on all functions.
        own : ndarray, shape (connections * 6, connections * 6), optional
            What is added for the motions of connections.

        Returns
        -------
        sparse array, shape (n, n)
            Rows of prescribed components are zero.
        """
        con = self.problem.constraints
        free = con.reduce(full, diagonal=False)
        if not len(self.W):
            return free
        flat = self.W.reshape(len(self.W), -1)
        times = np.asarray(full @ flat.T)
        side = np.stack([con.restrict(v.reshape(-1, 3)).ravel() for v in times.T], axis=1)
        corner = flat @ times
        return _joined(free, side, 0.5 * (corner + corner.T) + (0.0 if own is None else own))

    def shapes(self, x: FloatArray) -> tuple[FloatArray, tuple[tuple[Motion, ...], ...]]:
        """All coefficients (count, functions, 3) of vectors (n, count), and motions in each."""
        con = self.problem.constraints
        count = self.K.shape[0] - len(self.W)
        out = [con.expand(v[:count].reshape(-1, 3)) - con.values for v in np.ascontiguousarray(x.T)]
        q = x[count:].T
        shapes = np.stack(out) + np.einsum("ck,kij->cij", q, self.W)
        return shapes, tuple(self._motions(v.reshape(-1, 6)) for v in q)

    def _motions(self, q: FloatArray) -> tuple[Motion, ...]:
        return tuple(
            Motion(read_only(v[:3].copy()), read_only(v[3:] / self.size), c.about)
            for c, v in zip(self.problem.connections, q, strict=True)
        )

    def second_order(self, solution: Solution) -> FloatArray | None:
        """What forces of connections add by their finite turns, as `own` of `reduced`."""
        problem = self.problem
        first = len(problem.supports) - len(problem.connections)
        if not problem.connections:
            return None
        out = np.zeros((len(problem.connections), 6, len(problem.connections), 6))
        for j, c in enumerate(problem.connections):
            virial = rigid.virial(problem, solution.coefficients, first + j, c.about)
            H = 0.5 * (virial + virial.T) - np.trace(virial) * np.eye(3)
            out[j, 3:, j, 3:] = H / self.size**2
        return out.reshape(self.S.shape)


@dataclass(frozen=True, eq=False)
class Joined(Frozen):
    """A solver of nodes and connections together; see `Solver`.

    Attributes
    ----------
    nodes : Solver
        Of the free nodes, connections at rest.
    S : ndarray, shape (k, k)
        Stiffness of the connections.
    """

    nodes: Solver
    S: FloatArray

    @property
    def method(self) -> str:
        """That of the nodes."""
        return self.nodes.method

    def multiply(self, x: FloatArray) -> FloatArray:
        """K x for a vector or columns."""
        count = len(x) - len(self.S)
        return np.concatenate([self.nodes.multiply(x[:count]), self.S @ x[count:]])

    def precondition(self, r: FloatArray) -> FloatArray:
        """Approximate solution of K z = r."""
        count = len(r) - len(self.S)
        own = np.linalg.solve(self.S, r[count:])
        return np.concatenate([self.nodes.precondition(r[:count]), own])


def pencil(problem: Elasticity, method: str, added: Any = None) -> Pencil:
    """The stiffness of a problem for its eigenvalues.

    Parameters
    ----------
    problem : Elasticity
        With connections, if any, as supports that are at rest or were found.
    method : str
        Of the solver.
    added : bsr_array, optional
        What is added to the stiffness, on all functions.

    Returns
    -------
    Pencil
        With a solver.
    """
    system, K = problem.system, problem.system.K
    if added is not None:
        K = K + problem.constraints.reduce(added, diagonal=False)
    solver = Solver(
        system._half if added is None else K,
        near_nullspace=system.near_nullspace,
        method=method,
        coordinates=system.coordinates,
    )
    size = float(np.ptp(problem.assembly.coordinates, axis=0).max())
    if not problem.connections:
        none = np.zeros((0, *system.constraints.fixed.shape))
        return Pencil(problem, K, solver, system.near_nullspace, none, np.zeros((0, 0)), size)
    full = problem.matrix if added is None else problem.matrix + added
    W, S = _unit_motions(problem, full, solver, size)
    starts = np.zeros((K.shape[0] + len(W), len(W) + system.near_nullspace.shape[1]))
    starts[K.shape[0] :, : len(W)] = np.eye(len(W))
    starts[: K.shape[0], len(W) :] = system.near_nullspace
    both = _joined(K, np.zeros((K.shape[0], len(W))), S)
    return Pencil(problem, both, Joined(solver, S), starts, W, S, size)


def _unit_motions(
    problem: Elasticity, full: Any, solver: Solver, size: float
) -> tuple[FloatArray, FloatArray]:
    """Displacements (k, functions, 3) by unit motions of connections, and their stiffness."""
    con = problem.constraints
    first = len(problem.supports) - len(problem.connections)
    units = [
        rigid.unit(problem, first + j, motion)
        for j, c in enumerate(problem.connections)
        for motion in rigid.unit_motions(c.about, size)
    ]
    held = np.stack([u.constraints.values for u in units])  # exactly
    given = np.stack([u._from_supports() for u in units])  # weakly imposed
    flat = held.reshape(len(units), -1)
    force = given - np.asarray(full @ flat.T).T.reshape(held.shape)
    b = np.stack([con.restrict(f).ravel() for f in force], axis=1)
    x = np.zeros_like(b)
    pushed = b.any(axis=0)  # a motion that moves nothing else has no solution of its own
    if pushed.any():
        x[:, pushed], _ = solver.solve(b[:, pushed], tol=rigid.TIGHT)
    W = held + np.stack([con.expand(v.reshape(-1, 3)) - con.values for v in x.T])
    moved, pull = W.reshape(len(units), -1), given.reshape(len(units), -1)
    cross = moved @ pull.T
    S = moved @ np.asarray(full @ moved.T) - cross - cross.T
    for j in range(len(problem.connections)):
        mine = slice(6 * j, 6 * j + 6)
        S[mine, mine] += rigid.held_stiffness(problem, first + j, units[mine])
    return W, 0.5 * (S + S.T)


def _joined(free: Any, side: FloatArray, corner: FloatArray) -> Any:
    blocks = [[free, csr_array(side)], [csr_array(side.T), csr_array(corner)]]
    return block_array(blocks, format="csr")
