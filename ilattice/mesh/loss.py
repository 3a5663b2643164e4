"""What a mesh has lost or gained of its wall: its volume against that of the wall.

Guarantee: the volume of the wall is one of random points where four standard errors of it do not
change whether a loss is told or refused, and three of them are a tenth of what is told; else it is
that by cut cells. Chords lose material where a wall is convex, and gain it where pores are
narrow. Non-guarantees: less than 2 % of meshes with short edges is not told, nor less
than 1 % of those by default; the volume of the wall goes by the distance spline (see
`ilattice.lattice.Wall.volume`), and where the mesh has another one by what exact distances change
of it at random points.
"""

from __future__ import annotations

import warnings
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from ilattice._typing import AnyArray, FloatArray
from ilattice.errors import GeometryError, PrecisionWarning

if TYPE_CHECKING:
    from ilattice.offsets.volume_points import Estimate
    from ilattice.offsets.wall import OffsetSolid

#: Part of the volume from which on it is told, and from which on it is an error.
TOLD, REFUSED = 0.01, 0.05
#: The same where edges are short, and given.
NEAR = 0.02
#: Standard errors of the volume of the wall that must not matter for what is told, and the part of
#: what is lost that they may be, if it is told: three of them are a tenth.
ERRORS, KNOWN = 4.0, 0.12
#: Part of what is told with short edges from which on exact distances are asked for, too: what
#: they change of the volume adds to it.
CLOSE = 0.9
#: Length of edges, relative to the least thickness, up to which they are short, and that which is
#: recommended.
COMPARED, ENOUGH = 0.6, 0.25
#: Part of a loss that is left with edges shorter by a fifth, at most, where these help.
HELPS = 0.9
#: Triangles that are measured at once.
TOGETHER = 1 << 18


class Extent:
    """Volume and longest edge of a closed mesh that comes in pieces.

    Faces of a piece may name vertices of its own, of the piece before it, and of the first one.

    Attributes
    ----------
    volume, longest : float
        Of the pieces so far.
    """

    def __init__(self) -> None:
        self.volume, self.longest = 0.0, 0.0
        self._blocks: list[tuple[int, FloatArray]] = []

    @classmethod
    def of(cls, vertices: FloatArray, faces: AnyArray) -> Extent:
        """That of a whole mesh.

        Parameters
        ----------
        vertices, faces : ndarray, shape (V, 3) and (F, 3)
            The mesh.

        Returns
        -------
        Extent
            Its volume and longest edge.
        """
        out = cls()
        out.add(vertices, faces)
        return out

    def add(self, vertices: FloatArray, faces: AnyArray) -> None:
        """Take a piece.

        Parameters
        ----------
        vertices : ndarray, shape (n, 3)
            Its vertices, numbered on from those of the pieces before.
        faces : ndarray of int, shape (m, 3)
            Its faces, in the numbers of the whole mesh.
        """
        if len(vertices):
            first = 0 if not self._blocks else self._blocks[-1][0] + len(self._blocks[-1][1])
            middle = self._blocks[-1:] if len(self._blocks) > 1 else []
            self._blocks = [*self._blocks[:1], *middle, (first, vertices)]
        for i in range(0, len(faces), TOGETHER):
            self._count(faces[i : i + TOGETHER])

    def _count(self, faces: AnyArray) -> None:
        corners = np.full((*faces.shape, 3), np.nan)
        for start, block in self._blocks:
            at = (faces >= start) & (faces < start + len(block))
            corners[at] = block[faces[at] - start]
        a, b, c = (corners - self._blocks[0][1][0]).transpose(1, 0, 2)
        self.volume += float(np.einsum("ij,ij->", a, np.cross(b, c))) / 6.0
        edges = corners - np.roll(corners, 1, axis=1)
        self.longest = max(self.longest, float(np.linalg.norm(edges, axis=2).max(initial=0.0)))


class Loss(NamedTuple):
    """Another volume than that of the wall, or missing surfaces.

    Attributes
    ----------
    part : float
        What the mesh has more of the volume of the wall, or lacks of its surfaces.
    message : str
        What it has, and what to do.
    most : float
        Part above which it is an error.
    """

    part: float
    message: str
    most: float = REFUSED

    def shrinks(self, before: Loss | None) -> bool:
        """Whether shorter edges help, as far as a loss with longer ones tells.

        Parameters
        ----------
        before : Loss, optional
            That with longer ones.

        Returns
        -------
        bool
            True if it is by `HELPS` less, or another kind of loss, or there is nothing to compare.
        """
        if before is None or before.most != self.most:
            return True
        return abs(self.part) < HELPS * abs(before.part)

    def tell(self, *, allowed: bool) -> None:
        """Warn of it.

        Parameters
        ----------
        allowed : bool
            Whether to warn only, however much is lost.

        Raises
        ------
        GeometryError
            If more than `most` is lost or gained, unless that is allowed.
        """
        if abs(self.part) > self.most and not allowed:
            raise GeometryError(f"{self.message}, or allow_loss=True")
        warnings.warn(self.message, PrecisionWarning, stacklevel=5)


def loss_of(
    wall: OffsetSolid, h: float, mesh: Extent, *, sheets: bool, exactly: bool, default: bool
) -> Loss | None:
    """Compare the volume of a mesh with that of its wall, where they may differ.

    Parameters
    ----------
    wall : Wall
        The wall.
    h : float
        Length of the edges.
    mesh : Extent
        Volume and longest edge of its mesh.
    sheets : bool
        Whether it was made from the mid-surface, so that it loses by bends only, as h².
    exactly : bool
        Whether it is one of the exact offset, and not of the distance spline.
    default : bool
        Whether the length of edges is that by default.

    Returns
    -------
    Loss or None
        What is to be told, if it is more than `TOLD` of the volume, or `NEAR` where edges are short
        and not those by default.
    """
    least, got = wall.least_thickness, mesh.volume
    most = NEAR if h <= COMPARED * least and not default else TOLD
    about = wall._estimated(np.inf)
    found = _Compared.of(wall, about, got, most, exactly=exactly)
    while about.error > found.error:
        about = wall._estimated(found.error)
        found = _Compared.of(wall, about, got, most, exactly=exactly)
    if abs(found.off) <= most:
        return None
    return Loss(found.off, found.message(wall, h, mesh, sheets=sheets))


class _Compared(NamedTuple):
    """A volume compared with that of a wall.

    Attributes
    ----------
    off : float
        What it has more, as a part.
    whole, rounded : float
        Volume of the wall; what exact distances change of it, which is part of that.
    error : float
        Standard error of the volume of the wall at most, for what is told to be right.
    about : bool
        Whether that volume is one of random points.
    """

    off: float
    whole: float
    rounded: float
    error: float
    about: bool

    @classmethod
    def of(
        cls, wall: OffsetSolid, about: Estimate, got: float, most: float, *, exactly: bool
    ) -> _Compared:
        """A volume `got` compared with an estimate of that of the wall, told from `most` on."""
        whole, rounded = about.volume, 0.0
        if whole <= 0.0:
            return cls(0.0, whole, rounded, 0.0, about.boxes > 0)
        off = got / whole - 1.0
        left = abs(abs(off) - most)
        sure = ERRORS * about.error * (1.0 + off) <= left * whole
        if exactly and sure and abs(off) > max(TOLD, CLOSE * most):  # exact distances are slow
            rounded = wall._rounded.volume
            whole += rounded
            off = got / whole - 1.0 if whole > 0.0 else 0.0
            left = min(left, abs(abs(off) - most))
        if abs(off) > most:
            left = min(left, abs(abs(off) - REFUSED), KNOWN * abs(off))
        error = left / ERRORS * whole / (1.0 + off) if off > -1.0 else np.inf
        return cls(off, whole, rounded, error, about.boxes > 0)

    def message(self, wall: OffsetSolid, h: float, mesh: Extent, *, sheets: bool) -> str:
        """What a mesh has lost or gained, and what to do."""
        least, lost = wall.least_thickness, abs(self.off)
        told, h = f"{h:g}", min(h, mesh.longest)  # a grid has at least some planes per tile
        enough = 0.9 * h * (TOLD / lost) ** 0.5
        if not sheets:
            enough = min(ENOUGH * least, enough)
        about, digits = ("about ", 3) if self.about else ("", 6)
        message = (
            f"the mesh with h={told} has the volume {mesh.volume:.6g}, {about}{100 * lost:.2g} % "
            f"{'less' if self.off < 0.0 else 'more'} than the wall ({self.whole:.{digits}g}), "
            f"which is {least:g} thick at its thinnest; use h <= {enough:.3g}"
        )
        if abs(self.rounded) > TOLD * self.whole:
            message += f" and spans_per_tile > {wall.lattice.spans}, or tol"
        return message
