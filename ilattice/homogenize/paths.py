"""Wave vectors: reciprocal lattices, points of symmetry by name, paths between them.

Points are given in parts of the edges of the reciprocal lattice: those of a cell with the edges
a_i are b_j with a_i . b_j = 2 pi delta_ij. Names are the usual ones (W. Setyawan and S. Curtarolo,
High-throughput electronic band structure calculations, 2010).

Guarantee: names are those of the lattice that the edges make up, whichever of its edges these are
for cubic, face-centred and body-centred cubic ones, in whatever order for the others; unknown names
are refused with a list, and those of lattices that are not known. Non-guarantee: the solid in the
cell may have less symmetry than its lattice; paths then miss some directions.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Any

import numpy as np

from ilattice._geometry import grid_points
from ilattice._typing import FloatArray, IntArray
from ilattice._validate import Frozen, as_array
from ilattice.errors import InputError

#: Relative differences of lengths and angles that do not count, and of steps of a lattice.
SAME, LOOSE = 1e-9, 1e-6
#: Steps along edges of a cell by which edges of a cube are looked for.
STEPS = 3
#: Halves, thirds and quarters of reciprocal vectors, for the table.
H, T, Q = 0.5, 1.0 / 3.0, 0.25
#: Points of lattices, in parts of the edges of the lattice that is reciprocal to that of `_axes`.
POINTS: dict[str, dict[str, tuple[float, float, float]]] = {
    "cubic": {"G": (0, 0, 0), "X": (H, 0, 0), "M": (H, H, 0), "R": (H, H, H)},
    "fcc": {
        "G": (0, 0, 0), "X": (0, 1, 0), "L": (H, H, H), "W": (H, 1, 0), "K": (3 * Q, 3 * Q, 0),
        "U": (Q, 1, Q),
    },
    "bcc": {"G": (0, 0, 0), "H": (0, 1, 0), "N": (H, H, 0), "P": (H, H, H)},
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
#: Cells of cubic lattices in a cube, and the middles of which of its diagonals are points.
CENTRED: dict[str, tuple[int, tuple[tuple[float, float, float], ...]]] = {
    "cubic": (1, ()), "bcc": (2, ((H, H, H),)), "fcc": (4, ((H, H, 0), (H, 0, H), (0, H, H))),
}  # fmt: skip
#: What lattices are, too, with fewer symmetries.
LESS = {
    "cubic": ("tetragonal", "orthorhombic"), "tetragonal": ("orthorhombic",),
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
    return _axes(edges)[0]


def _axes(edges: FloatArray) -> tuple[str, FloatArray]:
    """A lattice, and the edges (3, 3) that its points are told by, as columns."""
    for system, (cells, middles) in CENTRED.items():
        cube = _cube(edges, cells)
        if cube is not None:
            inside = np.linalg.solve(edges, cube @ np.reshape(middles, (-1, 3)).T)
            if np.abs(inside - np.rint(inside)).max(initial=0.0) < LOOSE:
                return system, cube
    length = np.linalg.norm(edges, axis=0)
    cosines = (edges.T @ edges) / np.outer(length, length)
    upright = np.abs(cosines) < SAME
    for last in (2, 1, 0):
        i, j = (last + 1) % 3, (last + 2) % 3
        turned = edges[:, [i, j, last]]
        if not (upright[i, last] and upright[j, last]):
            continue
        if abs(length[i] - length[j]) < SAME * length[i]:
            if upright[i, j]:
                return "tetragonal", turned
            if abs(abs(cosines[i, j]) - 0.5) < SAME:
                turned[:, 1] *= -np.sign(cosines[i, j])  # to 120 degrees
                return "hexagonal", turned
    if upright[np.triu_indices(3, 1)].all():
        return "orthorhombic", edges
    return "triclinic", edges


def _cube(edges: FloatArray, cells: int) -> FloatArray | None:
    """Edges of a cube of so many cells that are steps of their lattice, as columns."""
    edge = (cells * abs(np.linalg.det(edges))) ** (1 / 3)
    steps = grid_points(*[np.arange(-STEPS, STEPS + 1)] * 3)
    v = steps @ edges.T / edge
    v = v[np.abs((v**2).sum(axis=1) - 1.0) < 2.0 * SAME]
    v = v[np.lexsort(np.round(-v, 6).T[::-1])]
    out: list[FloatArray] = []
    for one in v:
        if all(abs(one @ other) < SAME for other in out):
            out.append(one)
    return edge * np.stack(out[:3], axis=1) if len(out) >= 3 else None


def points_of(edges: FloatArray, system: str | None = None) -> dict[str, FloatArray]:
    """Points of symmetry by name, in parts of the edges of the reciprocal lattice.

    Parameters
    ----------
    edges : ndarray, shape (3, 3)
        Of the cell, as columns.
    system : str, optional
        One of `POINTS`, such as "tetragonal" for a cell in a cube, or "triclinic" for halves of the
        edges of whatever reciprocal lattice; by default that of the edges, G alone where these are
        triclinic.

    Returns
    -------
    dict of str to ndarray
        By letter.

    Raises
    ------
    InputError
        If the edges do not make up a lattice of this system.
    """
    found, axes = _axes(edges)
    if system is None:
        names = {"G": POINTS[found]["G"]} if found == "triclinic" else POINTS[found]
    elif system not in POINTS:
        raise InputError(f"system must be one of {', '.join(POINTS)}, got {system!r:.40}")
    else:
        fits = (found, *LESS.get(found, ()), "triclinic")
        if system not in fits:
            raise InputError(
                f"system: the edges of the cell make up a {found} lattice, not {system!r:.40}; "
                f"leave it out, or take one of {', '.join(dict.fromkeys(fits))}"
            )
        names = POINTS[system]
        if system == "triclinic" or (system != found and found != "cubic"):
            axes = edges
    turn = 0.5 * np.rint(2.0 * np.linalg.solve(axes, edges)).T  # halves, without rounding
    return {name: turn @ np.array(k) for name, k in names.items()}


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
        If a letter is unknown, corners are not finite or not apart, or the system is not that of
        the edges.
    """
    known = points_of(edges, system)
    if isinstance(path, str):
        for letter in path:
            if letter not in known:
                name = system or system_of(edges)
                more = "" if len(known) > 1 else (
                    " alone; give points in parts of the edges of the reciprocal lattice, or "
                    "system='triclinic' for names of their halves"
                )  # fmt: skip
                raise InputError(
                    f"path: {letter!r} in {path!r:.40} is no point of a {name} lattice, which has "
                    f"{', '.join(known)}{more}"
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
