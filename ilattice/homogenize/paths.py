"""Wave vectors: reciprocal lattices, points of symmetry by name, paths between them.

Points are given in parts of the edges of the reciprocal lattice: those of a cell with the edges
a_i are b_j with a_i . b_j = 2 pi delta_ij. Names are the usual ones (W. Setyawan and S. Curtarolo,
High-throughput electronic band structure calculations, 2010).

Guarantee: names are those of the lattice that the edges make up, and unknown ones are refused with
a list. Non-guarantee: the solid in the cell may have less symmetry than its lattice; paths then
miss some directions.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Any

import numpy as np

from ilattice._typing import FloatArray, IntArray
from ilattice._validate import Frozen, as_array
from ilattice.errors import InputError

#: Relative differences of lengths and angles that do not count.
SAME = 1e-9
#: Halves and thirds of reciprocal vectors, for the table.
H, T = 0.5, 1.0 / 3.0
#: Points of lattices with edges along x, y, z; the axis of tetragonal and hexagonal ones is z.
POINTS: dict[str, dict[str, tuple[float, float, float]]] = {
    "cubic": {"G": (0, 0, 0), "X": (H, 0, 0), "M": (H, H, 0), "R": (H, H, H)},
    "tetragonal": {
        "G": (0, 0, 0), "X": (H, 0, 0), "M": (H, H, 0), "Z": (0, 0, H), "R": (H, 0, H),
        "A": (H, H, H),
    },
    "orthorhombic": {
        "G": (0, 0, 0), "X": (H, 0, 0), "Y": (0, H, 0), "Z": (0, 0, H), "S": (H, H, 0),
        "T": (0, H, H), "U": (H, 0, H), "R": (H, H, H),
    },
    "hexagonal": {
        "G": (0, 0, 0), "M": (H, 0, 0), "K": (T, T, 0), "A": (0, 0, H), "L": (H, 0, H),
        "H": (T, T, H),
    },
    "triclinic": {
        "G": (0, 0, 0), "X": (H, 0, 0), "Y": (0, H, 0), "Z": (0, 0, H), "V": (H, H, 0),
        "T": (0, H, H), "U": (H, 0, H), "R": (H, H, H),
    },
}  # fmt: skip


@dataclass(frozen=True, eq=False)
class Path(Frozen):
    """Wave vectors along straight lines between corners.

    Attributes
    ----------
    fractions : ndarray, shape (n, 3)
        In parts of the edges of the reciprocal lattice.
    corners : ndarray, shape (m,)
        Which of them are corners.
    labels : tuple of str
        Names of the corners.
    """

    fractions: FloatArray
    corners: IntArray
    labels: tuple[str, ...]

    def reduced(self) -> "Path":
        """The same waves by vectors near 0.

        A wave does not change by edges of the reciprocal lattice; grids know only slow ones.
        """
        return replace(self, fractions=self.fractions - np.rint(self.fractions))


def reciprocal(edges: FloatArray) -> FloatArray:
    """Edges of the reciprocal lattice.

    Parameters
    ----------
    edges : ndarray, shape (3, 3)
        Edges of the cell as columns.

    Returns
    -------
    ndarray, shape (3, 3)
        As columns: edges.T @ them is 2 pi.
    """
    return np.asarray(2.0 * np.pi * np.linalg.inv(edges).T)


def system_of(edges: FloatArray) -> str:
    """Which of `POINTS` the edges of a cell make up.

    Parameters
    ----------
    edges : ndarray, shape (3, 3)
        As columns.

    Returns
    -------
    str
        "triclinic" where no other fits.
    """
    G = edges.T @ edges
    G = G / np.trace(G)
    off = np.array([G[0, 1], G[0, 2], G[1, 2]])
    same = abs(G[0, 0] - G[1, 1]) < SAME
    if (np.abs(off) < SAME).all():
        if same and abs(G[0, 0] - G[2, 2]) < SAME:
            return "cubic"
        return "tetragonal" if same else "orthorhombic"
    upright = (np.abs(off[1:]) < SAME).all()
    if same and upright and abs(abs(off[0]) - 0.5 * G[0, 0]) < SAME:
        return "hexagonal"
    return "triclinic"


def points_of(edges: FloatArray, system: str | None = None) -> dict[str, FloatArray]:
    """Points of symmetry by name, in parts of the edges of the reciprocal lattice.

    Parameters
    ----------
    edges : ndarray, shape (3, 3)
        Of the cell, as columns.
    system : str, optional
        One of `POINTS`, such as "tetragonal" for a cell in a cube; by default that of the edges.

    Returns
    -------
    dict of str to ndarray
        By letter.
    """
    found = system_of(edges)
    if system is not None and system not in POINTS:
        raise InputError(f"system must be one of {', '.join(POINTS)}, got {system!r:.40}")
    points = {k: np.array(v) for k, v in POINTS[system or found].items()}
    if found == "hexagonal" and edges[:, 0] @ edges[:, 1] > 0:  # edges at 60 degrees
        for name in ("K", "H"):
            points[name][:2] = (2 * T, T)
    return points


def path_of(path: Any, edges: FloatArray, steps: int, system: str | None = None) -> Path:
    """Wave vectors along a path.

    Parameters
    ----------
    path : str or array_like, shape (m, 3)
        Letters of `points_of`, or corners in parts of the edges of the reciprocal lattice.
    edges : ndarray, shape (3, 3)
        Of the cell, as columns.
    steps : int
        From a corner to the next one.
    system : str, optional
        As in `points_of`.

    Returns
    -------
    Path
        With every corner.

    Raises
    ------
    InputError
        If a letter is unknown, or corners are not finite or not apart.
    """
    if isinstance(path, str):
        known = points_of(edges, system)
        for letter in path:
            if letter not in known:
                raise InputError(
                    f"path: {letter!r} in {path!r:.40} is no point of a "
                    f"{system or system_of(edges)} lattice, which has {', '.join(known)}"
                )
        if not path:
            raise InputError("path is empty; give letters such as 'GXMRG', or points")
        at, labels = np.array([known[letter] for letter in path]), tuple(path)
    else:
        at = as_array("path", path)
        if at.ndim != 2 or at.shape[1] != 3 or not len(at):
            raise InputError(
                "path must be letters such as 'GXMRG', or points (m, 3) in parts of the edges of "
                f"the reciprocal lattice, got shape {np.shape(path)}"
            )
        labels = tuple(_told(p) for p in at)
    same = np.flatnonzero((np.diff(at, axis=0) == 0).all(axis=1))
    if len(same):
        raise InputError(f"path goes from {labels[same[0]]} to itself; leave one of them out")
    parts = [at[:1]]
    for a, b in pairwise(at):
        parts.append(a + (b - a) * (np.arange(1, steps + 1) / steps)[:, None])
    return Path(np.concatenate(parts), np.arange(len(at)) * steps, labels)


def _told(point: Sequence[float]) -> str:
    return "(" + ", ".join(f"{v:.4g}" for v in point) + ")"
