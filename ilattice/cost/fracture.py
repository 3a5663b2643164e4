"""Fracture by successive overload: the edge with the largest force over its strength breaks.

Guarantee: every event is a state of balance with its residual. Model: linear, small displacements,
the displacement grows and forces follow; a broken edge keeps a millionth of its stiffness.
"""

from dataclasses import dataclass

import numpy as np

from ilattice._progress import Progress, track
from ilattice._typing import ArrayLike, FloatArray, IntArray
from ilattice._validate import Frozen, as_array, as_kind, as_rows, as_whole
from ilattice.cost.stress import per_edge, stress
from ilattice.cost.structure import CornerSharing
from ilattice.errors import IlatticeError, InputError

#: What a broken edge keeps of its stiffness, and the growth of the compliance that ends it all.
LEFT, COLLAPSE = 1e-6, 1e3


@dataclass(frozen=True, eq=False)
class Fracture(Frozen):
    """Events of a fracture.

    Attributes
    ----------
    structure : CornerSharing
        The structure, whole.
    broken : ndarray of int, shape (s,)
        Edges in the order in which they break.
    load : ndarray, shape (s,)
        Factor of the loads at which each breaks.
    displacement : ndarray, shape (s,)
        Displacement of the loaded vertices along the loads then: their work over their size, of
        loads that are not on supports.
    collapsed : bool
        Whether the compliance has grown a thousandfold in the end, or nothing holds any more.
    """

    structure: CornerSharing
    broken: IntArray
    load: FloatArray
    displacement: FloatArray
    collapsed: bool

    @property
    def path(self) -> FloatArray:
        """Middles (s, d) of the broken edges."""
        return np.asarray(self.structure.positions[self.structure.edges[self.broken]].mean(axis=1))


def fracture(
    k: CornerSharing, loads: ArrayLike, *, supports: ArrayLike, stiffness: ArrayLike = 1.0,
    strength: ArrayLike = 1.0, steps: int = 50, progress: Progress = None,
) -> Fracture:  # fmt: skip
    """Load a structure until its edges break one after the other.

    Parameters
    ----------
    k : CornerSharing
        The structure.
    loads : array_like, shape (n, d)
        Forces on the vertices, of which a factor grows.
    supports : array_like
        Vertices that are held, as in `ilattice.cost.stress.stress`.
    stiffness, strength : array_like, shape () or (e,)
        Young's modulus times cross-section of the edges, and the force at which each breaks.
    steps : int
        Most edges that break.
    progress : bool or callable, optional
        See `ilattice._progress.track`.

    Returns
    -------
    Fracture
        The events; it ends early when the compliance has grown a thousandfold.
    """
    as_kind("k", k, "CornerSharing")
    f = as_array("loads", loads, ndim=2)
    if f.shape != k.positions.shape:
        raise InputError(f"loads must have shape {k.positions.shape}, got {f.shape}")
    EA, most = per_edge("stiffness", stiffness, k), per_edge("strength", strength, k)
    free = np.ones(len(f), np.bool_)
    free[as_rows("supports", supports, len(f))] = False
    size = float(np.linalg.norm(f[free]))
    if size == 0.0:
        raise InputError("loads must not vanish at all vertices that are free")
    broken: list[int] = []
    load: list[float] = []
    way: list[float] = []
    first, collapsed = 0.0, False
    for _ in track(range(as_whole("steps", steps, 1, 100_000)), "fracture", progress):
        try:
            found = stress(k, f, supports=supports, stiffness=EA)
        except IlatticeError:
            if not broken:
                raise
            collapsed = True
            break
        first = first or found.compliance
        if found.compliance > COLLAPSE * first:
            collapsed = True
            break
        part = np.abs(found.bars) / most
        part[broken] = 0.0
        i = int(np.argmax(part))
        if not part[i] > 0.0:
            break
        broken.append(i)
        load.append(1.0 / float(part[i]))
        way.append(load[-1] * found.compliance / size)
        EA[i] *= LEFT
    return Fracture(k, np.array(broken, np.int64), np.array(load), np.array(way), collapsed)
