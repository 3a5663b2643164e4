"""Structures whose joints are rigid: round beams that bend and twist, between vertices that turn.

`stress` takes structures as trusses: pin-jointed bars. Printed joints are rigid. The stiffness of
bars goes with the square of their radius, that of bending with the fourth power, so that thin
frames tend to trusses; but minimally rigid structures have motions that stretch little, which
bending holds long before. `frame` tells how much: the compliance of the truss is off by a part
`bending` / (1 - `bending`) at least.

Guarantees: the compliance of a frame is that of its truss less `bending` of it, or lower. Model:
Euler's beams, linear, joined in points. Solids differ by a part that goes with radius over
length, and are mostly stiffer, since joints have a size: an analysis (`ilattice.cutfem`) of
`Beams` tells.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.sparse import coo_array, csc_array, diags_array
from scipy.sparse.linalg import splu

from ilattice._memory import need
from ilattice._typing import ArrayLike, FloatArray, IntArray
from ilattice._validate import Frozen, as_array, as_kind, as_positive, as_real, as_rows
from ilattice.cost.stress import MAX_LOAD, per_edge
from ilattice.cost.structure import CornerSharing
from ilattice.errors import ConvergenceError, GeometryError, InputError

#: Pivots below this part of the largest, of a matrix with unit diagonal, mean a free motion.
FREE = 1e-13
#: Residual above which displacements are refused.
USELESS = 1e-6
#: Radius over length below which squares of stiffnesses are lost, and above the inverse of which.
FLAT = 1e-20


@dataclass(frozen=True, eq=False)
class Frame(Frozen):
    """Displacements of a frame under loads.

    Attributes
    ----------
    structure : CornerSharing
        The structure.
    loads : ndarray, shape (n, d)
        The loads.
    motion : ndarray, shape (n, d)
        Displacements of the vertices.
    turn : ndarray, shape (n, 3)
        Their rotations; in the plane only the last is not zero.
    bars : ndarray, shape (e,)
        Forces along the edges, tension positive.
    bending : float
        Part of the strain energy that is in bending and twist. Where it is small the structure
        is a truss, as in `ilattice.cost.stress`, of about 1 / (1 - bending) times this compliance.
    residual : float
        Norm of what is out of balance, over that of the loads.
    """

    structure: CornerSharing
    loads: FloatArray
    motion: FloatArray
    turn: FloatArray
    bars: FloatArray
    bending: float
    residual: float

    @property
    def compliance(self) -> float:
        """Work of the loads on the displacements: loads times motion."""
        return float((self.loads * self.motion).sum())


def frame(
    k: CornerSharing, loads: ArrayLike, *, supports: Any, radius: ArrayLike, young: float = 1.0,
    poisson: float = 0.3,
) -> Frame:  # fmt: skip
    """Displacements of a structure of round beams that are joined rigidly.

    Parameters
    ----------
    k : CornerSharing
        The structure. One in the plane bends in the plane.
    loads : array_like, shape (n, d)
        Forces on the vertices.
    supports : array_like, shape (n,) of bool or (s,) of int
        Vertices that neither move nor turn.
    radius : array_like, shape () or (e,)
        Of the beams.
    young, poisson : float
        Young's modulus and Poisson's ratio.

    Returns
    -------
    Frame
        Displacements, and the part of the energy in bending.

    Raises
    ------
    InputError
        For wrong shapes or numbers.
    GeometryError
        If a part of the structure is free to move.
    ConvergenceError
        If the residual exceeds 1e-6.

    Examples
    --------
    >>> import numpy as np
    >>> import ilattice as il
    >>> k = il.cost.kagome(3).stiffened()
    >>> load = np.zeros_like(k.positions)
    >>> load[-1, 2] = -1.0
    >>> low = k.positions[:, 2] < 0.3
    >>> [frame(k, load, supports=low, radius=r).bending < 0.1 for r in (0.02, 0.002)]
    [False, True]
    """
    as_kind("k", k, "CornerSharing")
    f = as_array("loads", loads, ndim=2)
    if f.shape != k.positions.shape:
        raise InputError(f"loads must have shape {k.positions.shape}, got {f.shape}")
    r = per_edge("radius", radius, k)
    E, nu = as_positive("young", young), as_real("poisson", poisson)
    if not -1.0 < nu < 0.5:
        raise InputError(f"poisson must be above -1 and below 1/2, got {nu:g}")
    held = as_rows("supports", supports, len(f))
    need(6000.0 * len(k.edges), f"a frame of {len(k.edges)} beams", "analyse a smaller part")
    unit, top, thick = float(k.lengths.mean()), float(np.abs(f).max()) or 1.0, float(r.max())
    for name, size in (("lengths", unit), ("loads", top), ("radius", thick), ("young", E)):
        if not 1.0 / MAX_LOAD <= size <= MAX_LOAD:
            raise InputError(
                f"{name} must be from {1 / MAX_LOAD:g} to {MAX_LOAD:g}, got {size:.3g}: "
                "change units"
            )
    if not FLAT < thick / unit < 1.0 / FLAT:
        raise InputError(
            f"radius must be from {FLAT:g} to {1 / FLAT:g} of the mean length of edges, got "
            f"{thick:.3g} of {unit:.3g}"
        )
    whole = CornerSharing(k.positions / unit, k.simplices, k.bars)
    one = _solved(whole, f / top, held, r / unit, nu)
    scale = top / unit / E
    return Frame(
        k, f, scale * one.motion, scale / unit * one.turn, top * one.bars, one.bending, one.residual
    )


def _solved(k: CornerSharing, f: FloatArray, held: IntArray, r: FloatArray, nu: float) -> Frame:
    """Balance of forces and moments at the vertices that are free, in units of about 1."""
    n = len(f)
    stretch, bend = _stiffness(k, r, nu)
    moves = np.zeros((n, 6), np.bool_)
    moves[:, [0, 1, 5] if k.dim == 2 else slice(None)] = True
    moves[held] = False
    free = np.flatnonzero(moves.ravel())
    K = csc_array((stretch + bend)[free][:, free])
    b = np.zeros((n, 6))
    b[:, : k.dim] = f
    b = b.ravel()[free]
    scale = 1.0 / np.sqrt(np.maximum(K.diagonal(), 1e-300))
    D = diags_array(scale)
    S = csc_array(D @ K @ D)
    try:
        lu = splu(S, permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0)
    except RuntimeError as error:
        raise GeometryError(_LOOSE) from error
    if np.abs(lu.U.diagonal()).min(initial=1.0) < FREE:
        raise GeometryError(_LOOSE)
    x = scale * lu.solve(scale * b)
    x += scale * lu.solve(scale * (b - K @ x))
    off = float(np.linalg.norm(K @ x - b)) / (float(np.linalg.norm(b)) or 1.0)
    if not off <= USELESS:
        raise ConvergenceError(f"displacements balance the loads to {off:.1e} only: thicker beams")
    u = np.zeros(6 * n)
    u[free] = x
    both = u @ (stretch @ u), u @ (bend @ u)
    motion, turn = np.split(u.reshape(n, 6), 2, axis=1)
    way, length = _axes(k)
    ends = motion[k.edges]
    bars = np.pi * r**2 / length * ((ends[:, 1] - ends[:, 0]) * way).sum(axis=1)
    share = min(max(float(both[1] / (sum(both) or 1.0)), 0.0), 1.0)
    return Frame(k, f, motion[:, : k.dim].copy(), turn.copy(), bars, share, off)


_LOOSE = "a part of the structure is free to move: support more vertices, or join the parts"


def _axes(k: CornerSharing) -> tuple[FloatArray, FloatArray]:
    """Directions (e, 3) and lengths (e,) of the edges."""
    x = np.pad(k.positions, ((0, 0), (0, 3 - k.dim)))
    way = x[k.edges[:, 1]] - x[k.edges[:, 0]]
    length = np.linalg.norm(way, axis=1)
    if not length.min(initial=np.inf) > 0.0:
        i = int(np.argmin(length))
        raise GeometryError(f"edge {i} {k.edges[i].tolist()} has both ends at one place")
    return way / length[:, None], length


def _stiffness(k: CornerSharing, r: FloatArray, nu: float) -> tuple[csc_array, csc_array]:
    """Stiffness (6 n, 6 n) of stretching, and of bending and twist, of a Young's modulus of 1.

    Of a beam with direction w, displacements u and turns t of its ends: the difference of u along w
    stretches it, that of t along w twists it, that of t across bends it to an arc, and the mean of
    t less the turn w x (u1 - u0) / L of the chord, across w, to an S.
    """
    way, length = _axes(k)
    e, area = len(way), np.pi * r**2
    along = way[:, :, None] * way[:, None]
    across = np.eye(3) - along
    chord = np.zeros((e, 3, 3))  # w x, as a matrix
    for a, b, c in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
        chord[:, a, b], chord[:, b, a] = -way[:, c], way[:, c]
    zero = np.zeros((e, 3, 3))
    part = chord / length[:, None, None]
    modes = (
        np.concatenate([-along, zero, along, zero], axis=2),
        np.concatenate([zero, -along, zero, along], axis=2),
        np.concatenate([zero, -across, zero, across], axis=2),
        np.concatenate([part, 0.5 * across, -part, 0.5 * across], axis=2),
    )
    inertia = 0.25 * np.pi * r**4
    sizes = (area, inertia / (1.0 + nu), inertia, 12.0 * inertia)
    local = [
        np.einsum("e,eij,eik->ejk", s / length, m, m) for m, s in zip(modes, sizes, strict=True)
    ]
    at = (6 * k.edges[:, :, None] + np.arange(6)).reshape(e, 12)
    places = np.repeat(at, 12, axis=1).ravel(), np.tile(at, (1, 12)).ravel()
    shape = (6 * len(k.positions),) * 2
    stretch, bend = (
        csc_array(coo_array((v.ravel(), places), shape=shape))
        for v in (local[0], local[1] + local[2] + local[3])
    )
    return stretch, bend
