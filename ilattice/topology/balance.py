"""Newton's method for points whose feet pull in opposite directions, from many starts.

Guarantee: ends are where the last step was as small as is told; see
`ilattice.topology._kernels_balance`. Non-guarantee: which critical point a start ends in; whether
other feet are nearer there is to be checked.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from ilattice._typing import AnyArray, FloatArray, IntArray
from ilattice.bspline import BSpline
from ilattice.offsets._kernels_jets import RATIONAL
from ilattice.offsets.space import kernel_space
from ilattice.topology import _kernels_balance
from ilattice.topology.clearance import Clearance
from ilattice.topology.windows import Starts

#: How far points may go from their starts, and the last step of one that may be an end, in tiles.
REACH, SLOW = 0.15, 1e-4
#: Weights above which feet pull, not push, and eigenvalues above which they are no saddles.
PUSH, SADDLE = -1e-6, -1e-7


class Ends(NamedTuple):
    """Ends (n) of Newton's method in the domain.

    Parameters `u` (n, 3), the last step (n,) in tiles, `feet` (n, 4, 3) in tile coordinates, of
    which `number` (n,) are meant; whether these pull, and are no saddles; whether no other ends
    are about.
    """

    u: FloatArray
    last: FloatArray
    feet: FloatArray
    number: IntArray
    pulled: AnyArray
    isolated: AnyArray

    def of(self, rows: AnyArray) -> Ends:
        """Some of the ends."""
        pulled, isolated = self.pulled[rows], self.isolated[rows]
        head = self.u[rows], self.last[rows], self.feet[rows], self.number[rows]
        return Ends(*head, pulled, isolated)


class Balance:
    """Solves for critical points of a lattice.

    Parameters
    ----------
    clearance : Clearance
        Distance less half-thickness.
    """

    def __init__(self, clearance: Clearance) -> None:
        self.clearance, self.search = clearance, clearance.lattice.search
        self.space = kernel_space(clearance.lattice, generic=True)
        geom = self.space.geom.copy()
        geom[RATIONAL] = 0.0
        nothing = BSpline([np.array(d) for d in clearance.domain.T], np.zeros((1, 1, 1)), 0)
        self.less = {
            side: self.space.through((nothing if less is None else less).generic_kernel_args, geom)
            for side, less in clearance.less.items()
        }

    def ends(self, starts: Starts, on: tuple[int, ...]) -> Ends:
        """Ends of those starts from which the method converges in the domain.

        Parameters
        ----------
        starts : Starts
            Points with their feet.
        on : tuple of int
            For each direction -1 or 1 on that face of the domain, 0 where a point may move.

        Returns
        -------
        Ends
            Where the method ended.
        """
        p, feet, weights = (a.copy() for a in (starts.p, starts.feet, starts.weights))
        last, low, pivot = np.empty((3, len(p)))
        kernel: Any = _kernels_balance.balance
        kernel(
            len(p), self.space, self.less[starts.side], p, feet, weights, starts.number,
            np.array(on) != 0, REACH, last, low, pivot,
        )  # fmt: skip
        u = self.clearance.wrapped(self.search.from_tile(p))
        lo, hi = self.clearance.domain
        slack = 1e-9 * (hi - lo)
        good = (last < SLOW) & ((u >= lo - slack) & (u <= hi + slack)).all(axis=1)
        pulled = (weights > PUSH).all(axis=1) & (low > SADDLE)
        ends = Ends(
            np.clip(u, lo, hi), last, feet, starts.number, pulled, pivot > _kernels_balance.SINGULAR
        )
        return ends.of(good)
