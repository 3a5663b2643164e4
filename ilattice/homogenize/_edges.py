"""Whether a solid has re-entrant edges, at which stresses have no bound and errors fall slowly.

Points next to the surface are moved onto it, in some of the cells that it cuts; where in a cell the
surface turns inwards by a lot on little way, there is an edge, or a fillet that the cells do not
resolve, which is no better. That holds for whatever solid: fields that tell their kinks, splines
that round them off, functions. Faces between cells are looked at by the cells around their edges.

Non-guarantee: a guess by samples; narrow gaps that are not parallel count as edges.
"""

from collections.abc import Callable
from typing import Any

import numpy as np

from ilattice._typing import AnyArray, FloatArray
from ilattice.cutfem.phases import PhasedDomain
from ilattice.quadrature.grid import CUT, IN

#: Cells that are looked at, at most, points in each, and steps towards the surface.
CELLS, POINTS, STEPS = 1000, 10, 6
#: Step of differences, and what counts as on the surface, in edges of cells.
STEP, NEAR = 1e-4, 1e-3
#: Least turn of unit normals between two points of a cell, the largest (beyond are gaps), and the
#: least turn per edge of a cell.
MIN_TURN, MAX_TURN, MIN_RATE = 0.6, 1.8, 1.5
#: Part of the cells from which edges count.
FEW = 0.01

Function = Callable[[FloatArray], FloatArray]


def notched(domain: Any) -> bool:
    """Whether a solid, or one of its two phases, has edges that turn inwards.

    Parameters
    ----------
    domain : Domain
        On its cells.

    Returns
    -------
    bool
        As samples show it.
    """
    cut = domain.cut
    lo, hi = cut.grid.domain
    if _on_grid(domain):
        return True

    def at(f: Function, u: FloatArray) -> FloatArray:
        return np.asarray(f(lo + (u - lo) % (hi - lo)), float)

    if _part(cut, lambda u: at(cut.sets, u).max(axis=1), both=False) > FEW:
        return True
    if not isinstance(domain, PhasedDomain):
        return False
    return any(_part(p, lambda u: at(domain.level, u), both=True) > FEW for p in domain.phases)


def _on_grid(domain: Any) -> bool:
    """Whether full cells around an edge of the grid are of phases, or a void, that meet there."""
    phases = domain.phases if isinstance(domain, PhasedDomain) else (domain.cut,)
    status = [p.status.reshape(p.grid.shape) for p in phases]
    kind = sum((k + 1) * (s == IN) for k, s in enumerate(status))
    known = np.all([s != CUT for s in status], axis=0)
    for axis in range(3):
        a, b = (k for k in range(3) if k != axis)
        shifts = ((0, 0), (0, -1), (-1, 0), (-1, -1))
        around = np.stack([np.roll(kind, s, (a, b)) for s in shifts])
        clear = np.all([np.roll(known, s, (a, b)) for s in shifts], axis=0)
        w, x, y, z = around
        flat = ((w == x) & (y == z)) | ((w == y) & (x == z))
        outwards = (around == 0).sum(axis=0) == 3
        if (clear & ~flat & ~outwards).any():
            return True
    return False


def _part(cut: Any, f: Function, *, both: bool) -> float:
    """Part of the cells cut by f = 0 in which it has edges, with `both` of either kind."""
    cells = np.flatnonzero(cut.status == CUT)
    cells = cells[:: 1 + len(cells) // CELLS]
    if not len(cells):
        return 0.0
    rng = np.random.default_rng(0)
    box = cut.grid.boxes(cells)
    size = box[:, None, 3:]
    # boxes beside the cells, since edges may be in their faces
    corner = box[:, None, :3] + (rng.random((len(cells), 1, 3)) - 0.5) * size
    u = corner + rng.random((len(cells), POINTS, 3)) * size
    for _ in range(STEPS):
        value, slope = _slope(f, u, size)
        square = np.maximum((slope**2).sum(axis=2), 1e-300)
        move = np.clip((value / square)[..., None] * slope, -0.5, 0.5)
        u = u - move * size
    value, slope = _slope(f, u, size)
    steep = np.linalg.norm(slope, axis=2)
    there = (np.abs(value) <= NEAR * steep) & (steep > 0.0)
    there &= (np.abs(u - corner - 0.5 * size) <= 0.5 * size).all(axis=2)
    normal = slope / np.maximum(steep, 1e-300)[..., None]
    edges = _edges((u - corner) / size, normal, there, both=both)
    seen = there.sum(axis=1) > 1
    return float(edges.sum() / max(seen.sum(), 1))


def _slope(f: Function, u: FloatArray, size: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Values (n, m) and differences (n, m, 3) per edge of a cell at points (n, m, 3)."""
    n, m, _ = u.shape
    steps = np.concatenate([np.zeros((1, 3)), STEP * np.eye(3)])
    at = u[:, :, None] + steps * size[:, :, None]
    v = f(at.reshape(-1, 3)).reshape(n, m, 4)
    return v[..., 0], (v[..., 1:] - v[..., :1]) / STEP


def _edges(x: FloatArray, normal: FloatArray, there: AnyArray, *, both: bool) -> AnyArray:
    """Which cells (n,) have a pair of points (n, m, 3) between which the surface turns inwards."""
    way = x[:, :, None] - x[:, None]
    turn = normal[:, :, None] - normal[:, None]
    much = np.linalg.norm(turn, axis=3)
    sharp = (much > MIN_TURN) & (much < MAX_TURN) & (much > MIN_RATE * np.linalg.norm(way, axis=3))
    if not both:
        sharp &= (way * turn).sum(axis=3) < 0.0
    pairs = there[:, :, None] & there[:, None]
    return np.asarray((sharp & pairs).any(axis=(1, 2)))
