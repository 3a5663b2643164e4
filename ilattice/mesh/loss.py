"""What a mesh has lost or gained of its wall: its volume against that of the wall by cut cells.

Guarantee: meshes whose edges are long against the wall are compared, and others where the volume at
random points is another one. Chords lose material where a wall is convex, and gain it where pores
are narrow. Non-guarantees: less than 2 % of meshes with short edges is not told, nor less
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
from ilattice.offsets.volume_points import VolumePoints

if TYPE_CHECKING:
    from ilattice.offsets.wall import OffsetSolid

#: Part of the volume from which on it is told, and from which on it is an error.
TOLD, REFUSED = 0.01, 0.05
#: Boxes with two random points each, by which volumes are compared first, and the part of the
#: volume from which on it is told where edges are short, and given.
BOXES, NEAR = 1 << 16, 0.02
#: Length of edges, relative to the least thickness, from which on volumes are compared, and that
#: which is recommended.
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
    short = h <= COMPARED * least
    most = NEAR if short and not default else TOLD
    if short and VolumePoints(wall, BOXES).near(got, most):
        return None
    whole = wall._volume
    rounded = wall._rounded.volume if exactly and abs(got - whole) > TOLD * whole else 0.0
    whole += rounded
    off = got / whole - 1.0 if whole > 0.0 else 0.0
    if abs(off) <= most:
        return None
    told, h = f"{h:g}", min(h, mesh.longest)  # a grid has at least some planes per tile
    enough = min(ENOUGH * least, 0.9 * h * (TOLD / abs(off)) ** 0.5)
    if sheets:
        enough = 0.9 * h * (TOLD / abs(off)) ** 0.5
    message = (
        f"the mesh with h={told} has the volume {got:.6g}, {100 * abs(off):.2g} % "
        f"{'less' if off < 0.0 else 'more'} than the wall ({whole:.6g}), which is {least:g} thick "
        f"at its thinnest; use h <= {enough:.3g}"
    )
    if abs(rounded) > TOLD * whole:
        message += f" and spans_per_tile > {wall.lattice.spans}, or tol"
    return Loss(off, message)
