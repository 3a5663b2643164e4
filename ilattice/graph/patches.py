"""From surface nodes to triangles: which faces of the bounding volume a loop meets, and the solver.

Guarantee: rules that need the bounding volume are checked before anything is solved for.
"""

from itertools import pairwise
from typing import Any

import numpy as np

from ilattice._typing import FloatArray
from ilattice.errors import InputError
from ilattice.graph.curves import curve_of
from ilattice.graph.nodes import EdgeChain
from ilattice.graph.shapes import Sheet
from ilattice.graph.skeletons import Surface
from ilattice.minimal import Disc, FaceLoop, MinimalPatch, Region, conjugate, direct, mixed
from ilattice.minimal.weights import located, spread

#: Distance from a face below which a vertex is on it.
ON = 1e-6
#: Points of a curved side between two edges of its triangles.
_DENSE = 8


def positions(surface: Surface) -> FloatArray:
    """Corners of the loop of a surface, shape (N, 3)."""
    return np.array([v.position for v in surface.corners])


def check(surface: Surface, region: Region | None) -> None:
    """Refuse a surface that breaks a rule of its kind in a bounding volume.

    Parameters
    ----------
    surface : Surface
        The node.
    region : Region or None
        Its bounding volume.

    Raises
    ------
    InputError
        With the rule and the vertex.
    """
    p = positions(surface)
    gaps = np.linalg.norm(p - np.roll(p, -1, axis=0), axis=1)
    if not gaps.min() > ON:
        i = int(gaps.argmin())
        raise InputError(f"neighbours must be at different places, but vertex {i} and the next are")
    if region is None:
        if surface.kind != "direct":
            raise InputError(
                f"a {surface.kind} surface needs a bounding volume: give within= to the graph or "
                "the surface, as g.cuboid()"
            )
    else:
        out = (p @ region.normals.T - region.offsets).max(axis=1)
        if out.max() > ON:
            i = int(out.argmax())
            raise InputError(
                f"vertices must lie in the bounding volume {region!r}, but vertex {i} at "
                f"{p[i].tolist()} is {out[i]:.3g} outside"
            )
        if surface.kind == "conjugate":
            face_loop(p, region)
        elif surface.kind == "mixed":
            _slides(surface, region)
    if not isinstance(surface.thickness, float):
        located(Disc(len(p), 2), [place for place, _ in surface.thickness])


def face_loop(points: FloatArray, region: Region) -> FaceLoop:
    """The faces along which a loop of vertices on edges of a region runs.

    Parameters
    ----------
    points : (N, 3) array
        Vertices.
    region : Region
        The bounding volume.

    Returns
    -------
    FaceLoop
        The face of the side from vertex i to vertex i + 1 comes at place i.

    Raises
    ------
    InputError
        If a vertex is on no edge, or neighbours share no face.
    """
    on = np.abs(points @ region.normals.T - region.offsets) <= ON
    for i, row in enumerate(on):
        if row.sum() != 2:
            raise InputError(
                "every vertex of a conjugate surface must lie on one edge of the bounding volume, "
                f"between two faces, but vertex {i} at {points[i].tolist()} lies on {row.sum()}"
            )
    pairs = [np.flatnonzero(row).tolist() for row in on]
    fault = 0
    for start in pairs[0]:
        numbers, last = [], start
        for i, (a, b) in enumerate(pairs):
            if last not in (a, b):
                fault = max(fault, i)
                break
            last = b if last == a else a
            numbers.append(last)
        if len(numbers) == len(pairs) and last == start:
            return FaceLoop(region, tuple(numbers))
    raise InputError(
        "sides of a conjugate surface must lie on faces of the bounding volume, and leave a vertex "
        f"on its other face, but none leads through vertex {fault} at {points[fault].tolist()}"
    )


def _slides(surface: Surface, region: Region) -> list[str | None]:
    """Names of the faces on which the sides slide, None for straight ones."""
    p = positions(surface)
    on = np.abs(p @ region.normals.T - region.offsets) <= ON
    out: list[str | None] = []
    for chain, _ in surface.steps:
        for _ in range(len(chain.order) - 1):
            i = len(out)
            if not chain.smooth:
                out.append(None)
                continue
            both = np.flatnonzero(on[i] & on[(i + 1) % len(p)])
            if len(both) != 1:
                raise InputError(
                    f"each sliding side must lie on one face of the bounding volume, but the side "
                    f"from vertex {i} at {p[i].tolist()} lies on {len(both)}"
                )
            out.append(region.names[int(both[0])])
    if all(name is None for name in out):
        raise InputError("a mixed surface needs a smooth chain that slides; direct fixes all sides")
    if None not in out:
        raise InputError(
            "a mixed surface needs a side that stays; where all slide, take a conjugate one"
        )
    return out


def _sides(surface: Surface) -> list[FloatArray]:
    """Sides of a direct surface as polylines."""
    out: list[FloatArray] = []
    for chain, back in surface.steps:
        sides = _curved(chain, surface.edges) if chain.smooth else list(
            np.stack([chain.points[:-1], chain.points[1:]], axis=1)
        )  # fmt: skip
        out += [s[::-1] for s in sides[::-1]] if back else sides
    return out


def _curved(chain: EdgeChain, n: int) -> list[FloatArray]:
    spline = curve_of(chain)
    ends = spline.breaks(0)
    count = len(chain.order) - 1
    if len(ends) - 1 != count:  # a parabola over three vertices
        ends = np.linspace(ends[0], ends[-1], count + 1)
    rows = [spline(np.linspace(a, b, _DENSE * n + 1)) for a, b in pairwise(ends)]
    for row, a, b in zip(rows, chain.points, chain.points[1:], strict=False):
        row[0], row[-1] = a, b
    return rows


def patch_of(surface: Surface, region: Region | None) -> MinimalPatch:
    """Solve for a surface.

    Parameters
    ----------
    surface : Surface
        The node.
    region : Region or None
        Its bounding volume.

    Returns
    -------
    MinimalPatch
        The surface.
    """
    check(surface, region)
    if surface.kind == "direct":
        return direct(_sides(surface), surface.edges, alpha=surface.alpha)
    assert region is not None
    if surface.kind == "mixed":
        return mixed(region, positions(surface), _slides(surface, region), surface.edges)
    return conjugate(face_loop(positions(surface), region), surface.edges)


def sheet_of(patch: MinimalPatch, thickness: Any) -> Sheet:
    """The triangles of a patch with their radii.

    Parameters
    ----------
    patch : MinimalPatch
        The surface.
    thickness : float or tuple
        As that of a surface node.

    Returns
    -------
    Sheet
        Half the thickness as the radius.
    """
    if isinstance(thickness, float):
        radius = np.full(len(patch.vertices), 0.5 * thickness)
    else:
        places, values = zip(*thickness, strict=True)
        radius = 0.5 * spread(patch.vertices, patch.disc, places, values)
    return Sheet(np.array(patch.vertices), np.array(patch.disc.faces), radius)
