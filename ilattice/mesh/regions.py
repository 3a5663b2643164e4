"""What hangs together in a mesh: parts, handles and voids of the solid that it bounds.

Guarantees: Betti numbers are those of the closed surface, and every void and island is counted with
place and volume. Non-guarantee: parts and gaps thinner than the mesh are not seen, or in pieces.
"""

import warnings
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, TypeVar

import numpy as np

from ilattice._shown import Shown
from ilattice._typing import AnyArray, FloatArray, IntArray
from ilattice._validate import as_not_negative
from ilattice.errors import GeometryError, PrecisionWarning
from ilattice.mesh.triangles import TriangleMesh

Mesh = TypeVar("Mesh", bound=TriangleMesh)
#: Triangles that are looked at at once.
CHUNK = 1 << 20
#: Parts smaller than this, relative to the largest, are told of as chips.
CHIP = 0.05


@dataclass(frozen=True)
class Region(Shown):
    """What one closed surface encloses: a part of a solid, or a void in it.

    Attributes
    ----------
    volume : float
        Enclosed volume; of a part without its voids.
    centre : ndarray, shape (3,)
        Centroid of what the surface encloses.
    bounds : ndarray, shape (2, 3)
        Box around it, rows are the lower and the upper corner.
    genus : int
        Handles of the surface.
    label : int
        Number of the surface, as in `SurfaceMesh.component_labels`.
    """

    volume: float
    centre: FloatArray
    bounds: FloatArray
    genus: int
    label: int


@dataclass(frozen=True)
class TopologyReport(Shown):
    """Parts, handles and voids of a solid.

    Attributes
    ----------
    parts : tuple of Region
        Parts that do not hang together, the largest first.
    voids : tuple of Region
        Closed hollows, the largest first: traps of powder or resin.
    genus : int
        Handles of all surfaces together.
    necks : tuple of CriticalPoint
        Places where a slightly different thickness would change the topology; `value` is the
        distance to the mid-surface less the half-thickness: half the width of a throat if
        positive, and how long ago a web closed if negative.
    """

    parts: tuple[Region, ...]
    voids: tuple[Region, ...]
    genus: int
    necks: tuple[Any, ...] = ()

    @property
    def islands(self) -> tuple[Region, ...]:
        """All parts but the largest."""
        return self.parts[1:]

    @property
    def betti(self) -> tuple[int, int, int]:
        """Betti numbers of the solid: parts, independent loops, voids."""
        return len(self.parts), self.genus, len(self.voids)

    @property
    def euler(self) -> int:
        """Euler number of the solid, half that of its surface."""
        return len(self.parts) - self.genus + len(self.voids)

    def __repr__(self) -> str:
        b0, b1, b2 = self.betti
        return f"TopologyReport({b0} parts, {b1} handles, {b2} voids, {len(self.necks)} necks)"

    def __str__(self) -> str:
        b0, b1, b2 = self.betti
        lines = [f"{b0} parts, {b1} handles, {b2} voids"]
        for name, regions in (("island", self.islands), ("void", self.voids)):
            lines += [f"  {name} of volume {r.volume:.4g} at {_place(r.centre)}" for r in regions]
        lines += [f"  {n.kind} within {n.value:+.3g} at {_place(n.x)}" for n in self.necks]
        return "\n".join(lines)


def topology_of(mesh: TriangleMesh) -> TopologyReport:
    """Parts, handles and voids of the solid that a mesh bounds.

    Parameters
    ----------
    mesh : SurfaceMesh
        Closed and oriented outwards, without self-intersections.

    Returns
    -------
    TopologyReport
        Without necks.

    Raises
    ------
    GeometryError
        If the mesh is open, not oriented, or inside out.
    """
    regions = _regions(mesh)
    solid = [r for r in regions if r.volume > 0.0]
    hollow = [r for r in regions if r.volume <= 0.0]
    if not solid:
        raise GeometryError("the mesh bounds no solid: it is empty, or inside out")
    inside = dict.fromkeys((r.label for r in solid), 0.0)
    for r, owner in zip(hollow, owners(mesh, solid, hollow), strict=True):
        inside[owner] += r.volume
    parts = [
        Region(r.volume + inside[r.label], r.centre, r.bounds, r.genus, r.label) for r in solid
    ]
    voids = [Region(-r.volume, r.centre, r.bounds, r.genus, r.label) for r in hollow]
    return TopologyReport(_by_size(parts), _by_size(voids), sum(r.genus for r in regions))


def without_islands(mesh: Mesh, least: float | None) -> Mesh:
    """Mesh without its small parts; see `SurfaceMesh.remove_islands`."""
    least = None if least is None else as_not_negative("least", least)
    report = topology_of(mesh)
    limit = report.parts[0].volume if least is None else least
    gone = {r.label for r in report.parts if r.volume < limit}
    solid = [Region(1.0, r.centre, r.bounds, r.genus, r.label) for r in report.parts]
    around = owners(mesh, solid, report.voids)
    gone |= {r.label for r, owner in zip(report.voids, around, strict=True) if owner in gone}
    return mesh.select(~np.isin(mesh.component_labels, sorted(gone)))


def without_voids(mesh: Mesh, most: float | None) -> Mesh:
    """Mesh with its voids filled; see `SurfaceMesh.fill_voids`."""
    limit = np.inf if most is None else as_not_negative("most", most, finite=False)
    gone = [r.label for r in topology_of(mesh).voids if r.volume <= limit]
    return mesh.select(~np.isin(mesh.component_labels, gone))


def islands_of(mesh: TriangleMesh) -> dict[str, Any]:
    """Parts of a mesh besides the largest, as plain data for reports, with a warning of chips.

    Parameters
    ----------
    mesh : SurfaceMesh
        The mesh.

    Returns
    -------
    dict
        `islands`, their number, and `islands_volume`, that of all of them within their outer
        surfaces; None if the mesh is open.

    Warns
    -----
    PrecisionWarning
        If one is smaller than `CHIP` of the largest part: most likely it was not meant.
    """
    if not (mesh.is_watertight and mesh.is_oriented):
        return {"islands": None, "islands_volume": None}
    if mesh.components <= 1:
        return {"islands": 0, "islands_volume": 0.0}
    volumes = np.sort([r.volume for r in _regions(mesh) if r.volume > 0.0])[::-1]
    loose = volumes[1:]
    chips = loose[loose < CHIP * volumes[0]] if len(loose) else loose
    if len(chips):
        warnings.warn(
            f"{len(chips)} loose {'chips hang' if len(chips) > 1 else 'chip hangs'} together with "
            f"nothing, {100 * chips.sum() / volumes.sum():.2g} % of the volume; --remove-islands, "
            "or mesh.remove_islands(), removes them",
            PrecisionWarning,
            stacklevel=3,
        )
    return {"islands": len(loose), "islands_volume": float(loose.sum())}


# --- surfaces ---------------------------------------------------------------------------------


def _regions(mesh: TriangleMesh) -> list[Region]:
    """What each closed surface encloses, with signed volume."""
    if not (mesh.is_watertight and mesh.is_oriented):
        raise GeometryError(
            f"topology needs a closed oriented surface, this one has {mesh.open_edges} open and "
            f"{mesh.nonmanifold_edges} non-manifold edges; mesh walls with caps"
        )
    labels = np.asarray(mesh.component_labels)
    count = mesh.components
    moments = np.zeros((count, 4))
    middle = mesh.vertices.mean(axis=0, dtype=np.float64)
    for i in range(0, len(mesh.faces), CHUNK):
        part = slice(i, i + CHUNK)
        p = mesh.vertices[mesh.faces[part]].astype(np.float64) - middle
        six = np.einsum("fc,fc->f", p[:, 0], np.cross(p[:, 1], p[:, 2]))
        rows = np.column_stack([six / 6.0, six[:, None] * p.sum(axis=1) / 24.0])
        for c in range(4):
            moments[:, c] += np.bincount(labels[part], rows[:, c], count)
    lower, upper = np.full((count, 3), np.inf), np.full((count, 3), -np.inf)
    fans = _fans(mesh, labels, count, lower, upper)
    faces = np.bincount(labels, minlength=count)
    genus = 1 - (fans - faces // 2) // 2
    return [
        Region(float(m[0]), middle + m[1:] / m[0], np.stack([lower[k], upper[k]]), int(genus[k]), k)
        for k, m in enumerate(moments)
    ]


def _fans(
    mesh: TriangleMesh, labels: AnyArray, count: int, lower: FloatArray, upper: FloatArray
) -> IntArray:
    """Vertices of each surface, those of several surfaces for each; boxes around them."""
    total = np.zeros(count, np.int64)
    n = len(mesh.vertices)
    keys = labels.astype(np.int64)[:, None] * n + mesh.faces
    owner, vertex = np.divmod(np.unique(keys), n)
    total += np.bincount(owner, minlength=count)
    np.minimum.at(lower, owner, mesh.vertices[vertex])
    np.maximum.at(upper, owner, mesh.vertices[vertex])
    return total


def owners(mesh: TriangleMesh, solid: Sequence[Region], hollow: Sequence[Region]) -> list[int]:
    """For each void the smallest part around it.

    Parameters
    ----------
    mesh : SurfaceMesh
        Of the parts and voids.
    solid, hollow : sequence of Region
        Parts and voids.

    Returns
    -------
    list of int
        Labels of parts.

    Raises
    ------
    GeometryError
        If a void lies in no part.
    """
    labels = np.asarray(mesh.component_labels)
    out = []
    for void in hollow:
        x = mesh.vertices[mesh.faces[int(np.argmax(labels == void.label)), 0]].astype(np.float64)
        around = [r for r in solid if (r.bounds[0] <= x).all() and (x <= r.bounds[1]).all()]
        if len(around) > 1:
            around = [r for r in around if _winding(mesh, labels == r.label, x) > 0.5]
        if not around:
            raise GeometryError("a void of the mesh lies in no part: the mesh is not a solid")
        out.append(min(around, key=lambda r: float(np.prod(np.ptp(r.bounds, axis=0)))).label)
    return out


def _winding(mesh: TriangleMesh, faces: AnyArray, x: FloatArray) -> float:
    """How often a closed surface winds around a point, from solid angles."""
    p = mesh.vertices[mesh.faces[faces]].astype(np.float64) - x
    a, b, c = np.linalg.norm(p, axis=2).T
    det = np.einsum("fc,fc->f", p[:, 0], np.cross(p[:, 1], p[:, 2]))
    ab, bc, ca = (np.einsum("fc,fc->f", p[:, i], p[:, (i + 1) % 3]) for i in range(3))
    angle = 2.0 * np.arctan2(det, a * b * c + ab * c + bc * a + ca * b)
    return float(angle.sum() / (4.0 * np.pi))


def _by_size(regions: list[Region]) -> tuple[Region, ...]:
    return tuple(sorted(regions, key=lambda r: (-r.volume, r.label)))


def _place(x: FloatArray) -> str:
    return "(" + ", ".join(f"{v:.4g}" for v in x) + ")"
