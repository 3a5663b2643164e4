"""Surfaces of beams: one mesh with sharp creases, or slab by slab into a file.

Guarantees: closed surfaces; a spacing at which beams would be lost is refused. Not guaranteed:
sharp creases of what is written slab by slab: they are chamfered within a cell.
"""

import os
import warnings
from typing import Any

import numpy as np

from ilattice._memory import need
from ilattice._progress import Progress
from ilattice._validate import as_positive
from ilattice.errors import GeometryError, InputError, PrecisionWarning
from ilattice.fields.node import Node
from ilattice.io.stream import StreamedMeshWriter
from ilattice.mesh.contouring import contour_blocks
from ilattice.mesh.surface import SurfaceMesh
from ilattice.sdf.meshing import mesh

#: Spacing of the grid of a mesh, in least radii, above which beams may be cut, and are lost.
COARSE, LOST = 1.001, 2.0
PER_POINT = 80.0  # bytes of memory per point of a slab of the grid
SLABS = 40  # layers of points at once


def meshed(
    beams: Node, least: float, h: float | None, *, tol: float | None, allow_loss: bool,
    progress: Progress,
) -> SurfaceMesh:  # fmt: skip
    """Mesh of beams of some least radius; see `Beams.mesh`."""
    spacing = spacing_of(least, least if h is None and tol is not None else h)
    return mesh(beams, spacing, tol=tol, allow_loss=allow_loss, progress=progress)


def streamed(
    beams: Node,
    least: float,
    path: str | os.PathLike[str],
    *,
    h: float | None = None,
    progress: Progress = None,
    **others: Any,
) -> None:
    """Write the surface to STL or PLY slab by slab: memory for one slab only."""
    if others:
        raise InputError(f"surfaces of beams have no option {min(others)!r}: h and progress only")
    spacing = spacing_of(least, h)
    low, high = beams.bounds
    counts = np.ceil((high - low) / spacing).astype(np.int64) + 4
    order = np.argsort(-counts)  # slabs go along the longest side
    need(PER_POINT * SLABS * float(np.prod(counts[order[1:]])), f"h={spacing:g}", "take a larger h")
    axes = [a - 2.0 * spacing + spacing * np.arange(n) for a, n in zip(low, counts, strict=True)]
    turned = _Turned(beams, order)
    even = _even(order)
    with StreamedMeshWriter(path) as writer:
        for piece in contour_blocks(turned, [axes[i] for i in order], progress=progress):
            faces = piece.faces if even else piece.faces[:, ::-1]
            writer.append(piece.vertices[:, np.argsort(order)], faces)


class _Turned:
    """A field with its axes in another order."""

    def __init__(self, field: Any, order: Any) -> None:
        self.field, self.back = field, np.argsort(order)

    def __call__(self, p: Any, /) -> Any:
        """Values (n,) at points (n, 3)."""
        return self.field(np.ascontiguousarray(np.asarray(p)[:, self.back]))


def _even(order: Any) -> bool:
    """Whether a permutation keeps the orientation."""
    return bool(np.linalg.det(np.eye(3)[order]) > 0.0)


def spacing_of(least: float, h: float | None) -> float:
    """A spacing that finds the thinnest beams: a third of their radius by default."""
    spacing = least / 3.0 if h is None else as_positive("h", h)
    if spacing > COARSE * least:
        told = f"h={spacing:g} is too coarse for beams of radius {least:.3g}"
        if spacing > LOST * least:
            raise GeometryError(f"{told}: they would be lost; use h={0.5 * least:.2g} or less")
        warnings.warn(
            f"{told}: some may be cut through; use h={0.5 * least:.2g} or less",
            PrecisionWarning,
            stacklevel=4,
        )
    return spacing
