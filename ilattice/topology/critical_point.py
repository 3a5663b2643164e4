"""A critical point of the distance to a mid-surface, and what changes there.

Guarantee: kinds and jumps of Euler numbers follow from the directions in which the distance falls.
"""

from dataclasses import dataclass

from ilattice._shown import Shown
from ilattice._typing import FloatArray


@dataclass(frozen=True)
class CriticalPoint(Shown):
    """A place where the wall ``dist <= d`` changes its topology.

    What changes is told by the directions in which the distance falls, a part of a small sphere
    about the place (inside the domain): none, and a part of the wall appears; all, and a void is
    filled; several, and the wall meets itself; a ring, and a pore is closed.

    Attributes
    ----------
    value : float
        Distance to the mid-surface there (less the half-thickness, if one was given).
    u, x : ndarray, shape (3,)
        Its parameters, and its place in space.
    side : int
        Sign of the implicit function there.
    feet : int
        Number of nearest points of the mid-surface.
    on : tuple of int
        For each direction -1 or 1 on that face of the domain, 0 inside.
    parts, holes : int
        Parts of the directions in which the distance falls, and holes in them.
    closed : bool
        Whether it falls in all directions.
    isolated : bool
        Whether it does not stand for a whole curve or surface of critical points.
    euler : int
        Euler number of what it stands for: 0 for rings, else 1.
    """

    value: float
    u: FloatArray
    x: FloatArray
    side: int
    feet: int
    on: tuple[int, int, int]
    parts: int = 1
    holes: int = 0
    closed: bool = False
    isolated: bool = True
    euler: int = 1

    @property
    def change(self) -> int:
        """By how much the Euler number of the wall jumps as the thickness passes `value`.

        Not told for curves and surfaces that end inside of the domain, as in slots.
        """
        return self.euler * (1 - self.parts + self.holes - int(self.closed))

    @property
    def kind(self) -> str:
        """What happens, in a word: ``"part"``, ``"void"``, ``"bridge"`` or ``"neck"``."""
        if self.closed:
            return "void"
        if self.parts == 0:
            return "part"
        return "bridge" if self.parts > 1 else "neck"
