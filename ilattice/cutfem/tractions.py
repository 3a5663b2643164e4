"""Tractions between elements of degree 1 that are in equilibrium with the forces of their nodes.

On the nodes of an element its stress and its loads act with forces that are in equilibrium, as
motions of rigid bodies are among its functions; those of all elements at a node add up to nothing.
So they can be shared out, node by node, to the faces between elements at it, with least squares
weighted by the part of the face that belongs to the node: uniform stress then gets its own
tractions. What a face transmits in sum, its force and moment, acts on its section as a traction
that varies like the motion of a rigid body. Source: Ladeveze and Leguillon, 1983, for the shares;
there tractions follow all functions on a face, of which thin sections have only these.

Guarantees: tractions on both sides of a face are opposite, those on an element are in equilibrium
with its loads, in force and moment, where no support is. Non-guarantee: of all that are, they are
not those of least energy.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.sparse import coo_array, csr_array, diags_array
from scipy.sparse.linalg import splu

from ilattice._typing import FloatArray, IntArray
from ilattice.cutfem.integrals import Integrals
from ilattice.quadrature.making import TANGENT_DEPTH, inner_face_rule
from ilattice.quadrature.rules import Quadrature, in_space, kept, on_cells

#: Gauss points per direction on faces: for moments of inertia of polygons.
POINTS = 2
#: Part of the diagonal that is added where forces of a node are shared out: they are given up to
#: one that is the same on all sides.
GROUND = 1e-12
#: Part of the largest inertia of a section, in its own size, that is none: that of a line.
LINE = 1e-12

#: Rules in space with forces (n, 3), stresses (n, 3, 3), or None, weights included.
Forces = list[tuple[Quadrature, FloatArray | None, FloatArray | None]]

#: Force (n, 3) and stress (n, 3, 3) per volume, or None, that a solution makes act, of a rule in
#: space, displacements (n, 3) there, and their gradients (n, 3, 3).
Acting = Callable[[Quadrature, FloatArray, FloatArray], tuple[FloatArray | None, FloatArray | None]]


@dataclass(frozen=True, eq=False)
class Tractions:
    """What acts on faces between elements, on the lower ones.

    Attributes
    ----------
    low, high : ndarray, shape (n,)
        Positions of the elements on both sides of points.
    points : ndarray, shape (n, 3)
        Of a rule in space on the faces.
    forces : ndarray, shape (n, 3)
        Tractions times areas.
    loads : list
        On the elements, see `Forces`.
    solid : Quadrature
        Rule in space, for stiffnesses, in the elements and around them.
    gradients : ndarray, shape (m, 3, 3)
        Of the solution, at its points.
    """

    low: IntArray
    high: IntArray
    points: FloatArray
    forces: FloatArray
    loads: Forces
    solid: Quadrature
    gradients: FloatArray

    def around(self, patch: IntArray) -> tuple[FloatArray, FloatArray]:
        """Points and forces (n, 3) between some elements and others."""
        low, high = np.isin(self.low, patch), np.isin(self.high, patch)
        some = low != high
        return self.points[some], np.where(low[some, None], 1.0, -1.0) * self.forces[some]


def transmitted(
    problem: Integrals, c: FloatArray, wanted: IntArray, acting: Acting | None = None
) -> Tractions:
    """Tractions on some elements of degree 1.

    Parameters
    ----------
    problem : Integrals
        Of three unknowns.
    c : ndarray, shape (functions, 3)
        Solution.
    wanted : ndarray
        Positions of elements without supports.
    acting : callable, optional
        See `Acting`; by default the loads of the problem act.

    Returns
    -------
    Tractions
        On all of their faces.
    """
    asm = problem.assembly
    space = asm.space
    hit = np.zeros(len(space), bool)
    hit[space.dofs[wanted]] = True
    near = np.flatnonzero(hit[space.dofs].any(axis=1))
    whole = problem.domain.stiff_rule(asm, constant=problem.law.constant)
    rule = in_space(on_cells(whole, space.cells[near]))
    gradients = _on(problem, c, rule)[1]
    if acting is None:
        loads = _loads(problem, near, rule)
    else:
        solid = _solid(problem, near, rule)
        w, (f, P) = solid.weights[:, None], acting(solid, *_on(problem, c, solid))
        loads = [(solid, None if f is None else w * f, None if P is None else w[:, None] * P)]
    forces = _of_nodes(problem, near, rule, gradients, loads)
    low, high, at, rules = _faces(problem, near)
    parts = [_shares(problem, axis, rule) for axis, rule in enumerate(rules)]
    shares, corners = (np.concatenate(some) for some in zip(*parts, strict=True))
    used = hit[np.take_along_axis(space.dofs[low], at[0], axis=1)]
    places = 8 * np.searchsorted(near, np.stack([low, high]))[:, :, None] + at
    b = np.zeros((*shares.shape, 3))
    b[used] = _shared_out(forces.reshape(-1, 3), places[:, used], shares[used])
    owner = np.repeat(np.arange(len(low)), np.concatenate([np.diff(r.offsets) for r in rules]))
    mine = (np.isin(low, wanted) | np.isin(high, wanted))[owner]
    x, w = (np.concatenate([getattr(r, of) for r in rules])[mine] for of in ("points", "weights"))
    owner = owner[mine]
    on_faces = _on_sections(owner, x, np.abs(w), corners, b)
    return Tractions(low[owner], high[owner], x, on_faces, loads, rule, gradients)


def _on(problem: Integrals, c: FloatArray, rule: Quadrature) -> tuple[FloatArray, FloatArray]:
    """Displacements (n, 3) and gradients (n, 3, 3) at the points of a rule in space."""
    values, gradients = np.empty((len(rule), 3)), np.empty((len(rule), 3, 3))
    for rows, value, gradient in problem.assembly.on_rule(c, rule):
        values[rows], gradients[rows] = value, gradient
    return values, gradients


def _solid(problem: Integrals, near: IntArray, stiff: Quadrature) -> Quadrature:
    """Rule in space on some elements with no points in the void, which one for stiffnesses has."""
    cells = problem.assembly.space.cells[near]
    rule = on_cells(problem.domain.volume, cells)
    return stiff if len(rule) == len(stiff) else in_space(rule)


def _loads(problem: Integrals, near: IntArray, stiff: Quadrature) -> Forces:
    """Loads on some elements; functions are asked at all points of a place, as in `forces`."""
    asm, out = problem.assembly, []
    cells, solid = asm.space.cells[near], _solid(problem, near, stiff)
    for given in problem.loads:
        load = problem._spread(given)
        rule = problem.domain.edge(asm, load.on) if load.on else solid
        some = np.isin(rule.cells, cells)
        if some.any():
            w, rows = rule.weights[:, None], some[rule.owners]
            f, P = problem._density(load, rule)
            f = None if f is None else (w * f)[rows]
            out.append((kept(rule, some), f, None if P is None else (w[:, None] * P)[rows]))
    return out


def _of_nodes(
    problem: Integrals, near: IntArray, rule: Quadrature, gradients: FloatArray, loads: Forces
) -> FloatArray:
    """What is to act on elements from others (near, 8, 3), at their nodes."""
    asm = problem.assembly
    cells, owner = asm.space.cells[near], asm.owners(rule)
    assert rule.parameters is not None
    flux = problem.law.components(problem._flux(gradients, rule.parameters, owner))
    stress = rule.weights[:, None, None] * flux
    out = np.zeros((len(near), 8, 3))
    for sign, (some, f, P) in [(1.0, (rule, None, stress)), *((-1.0, load) for load in loads)]:
        out[np.searchsorted(cells, some.cells)] += sign * asm.per_cell(some, f, P)
    return out


def _faces(
    problem: Integrals, near: IntArray
) -> tuple[IntArray, IntArray, IntArray, list[Quadrature]]:
    """Elements (n,) on both sides of faces, places (2, n, 4) of nodes in these, and rules."""
    domain, space = problem.domain, problem.assembly.space
    cells, out, rules = space.cells[near], [], []
    home = np.unique(domain.elements.home(cells))
    for axis in range(3):
        rule = inner_face_rule(domain.cut, axis, POINTS, TANGENT_DEPTH, home)
        rule = domain.parts.joined(domain.elements.divided(rule))
        assert rule.neighbours is not None
        rule = kept(rule, np.isin(rule.cells, cells) & np.isin(rule.neighbours, cells))
        assert rule.neighbours is not None
        sides = [np.searchsorted(space.cells, side) for side in (rule.cells, rule.neighbours)]
        at = _places(axis)
        same = (space.dofs[sides[0]][:, at[0]] == space.dofs[sides[1]][:, at[1]]).all(axis=1)
        rules.append(in_space(kept(rule, same)))
        wide = np.broadcast_to(at[:, None], (2, int(same.sum()), 4))
        out.append((sides[0][same], sides[1][same], wide))
    low, high, places = zip(*out, strict=True)
    return np.concatenate(low), np.concatenate(high), np.concatenate(places, axis=1), rules


def _places(axis: int) -> IntArray:
    """Places (2, 4) of the nodes of a face among those of the lower and the upper element."""
    cube = np.arange(8).reshape(2, 2, 2)
    return np.stack([cube.take(side, axis).ravel() for side in (1, 0)])


def _shares(problem: Integrals, axis: int, rule: Quadrature) -> tuple[FloatArray, FloatArray]:
    """Integrals (faces, 4) of functions on faces, and corners (faces, 4, 3) in space."""
    asm, u = problem.assembly, rule.parameters
    assert u is not None
    boxes = asm.space.grid.boxes(rule.cells)
    corners = np.stack([(place >> np.array([2, 1, 0])) & 1 for place in _places(axis)[0]])
    t = np.clip((u - boxes[rule.owners, :3]) / boxes[rule.owners, 3:], 0.0, 1.0)
    across = np.arange(3) != axis
    near = np.where(corners[:, across], t[:, None, across], 1.0 - t[:, None, across])
    values = np.abs(rule.weights)[:, None] * near.prod(axis=2)
    sums = np.zeros((len(rule.cells), 4))
    np.add.at(sums, rule.owners, values)
    x = asm.x((boxes[:, None, :3] + corners * boxes[:, None, 3:]).reshape(-1, 3))
    return sums, x.reshape(-1, 4, 3)


def _shared_out(forces: FloatArray, places: IntArray, shares: FloatArray) -> FloatArray:
    """Parts (n, 3) of forces of nodes that act between pairs (2, n) of places of elements."""
    n = shares.size
    w = np.maximum(shares, GROUND * shares.max(initial=0.0))
    ends = np.concatenate([np.ones(n), -np.ones(n)])
    S = coo_array((ends, (places.ravel(), np.tile(np.arange(n), 2))), (len(forces), n)).tocsr()
    L: csr_array = S @ diags_array(w) @ S.T
    d = L.diagonal()
    ground = np.where(d > 0.0, GROUND * d, 1.0)
    return np.asarray(w[:, None] * (S.T @ splu((L + diags_array(ground)).tocsc()).solve(forces)))


def _on_sections(
    owner: IntArray, x: FloatArray, w: FloatArray, corners: FloatArray, b: FloatArray
) -> FloatArray:
    """Forces (n, 3) at points of faces, like motions of rigid bodies, for those (faces, 4, 3)."""
    n = len(corners)
    sums = np.stack([np.bincount(owner, v, n) for v in (w, *(w[:, None] * x).T)], axis=1)
    middle = sums[:, 1:] / np.maximum(sums[:, :1], 1e-300)
    size = np.abs(corners - middle[:, None]).max(axis=(1, 2))[:, None]
    motions = _rigid((x - middle[owner]) / size[owner])
    at = _rigid(((corners - middle[:, None]) / size[:, None]).reshape(-1, 3)).reshape(n, 4, 3, 6)
    inertia = np.zeros((n, 6, 6))
    np.add.at(inertia, owner, w[:, None, None] * (motions.transpose(0, 2, 1) @ motions))
    whole = np.einsum("faik,fai->fk", at, b)
    how = (np.linalg.pinv(inertia, rcond=LINE, hermitian=True) @ whole[:, :, None])[owner]
    return np.asarray(w[:, None] * (motions @ how)[:, :, 0])


def _rigid(x: FloatArray) -> FloatArray:
    """Motions (n, 3, 6) of a rigid body at points."""
    out = np.zeros((len(x), 3, 6))
    out[:, :, :3] = np.eye(3)
    for a in range(3):
        b, c = (a + 1) % 3, (a + 2) % 3
        out[:, c, 3 + a], out[:, b, 3 + a] = x[:, b], -x[:, c]
    return out
