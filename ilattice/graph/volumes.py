"""Bounding volumes of fundamental skeletons, as data of files.

Guarantee: a volume that is written and read again is the same to the last bit, up to the lengths
of normals, which are made unit vectors.
"""

from functools import lru_cache
from typing import Any

import numpy as np

from ilattice._typing import ArrayLike
from ilattice._validate import as_array
from ilattice.errors import InputError
from ilattice.minimal.region import Region, cuboid, prism, tetrahedron

_KEYS = {
    "cuboid": {"size"},
    "prism": set(),
    "tetrahedron": {"copies"},
    "halfspaces": {"normals", "offsets", "cell"},
}  # type: dict[str, set[str]]


def halfspaces(normals: ArrayLike, offsets: ArrayLike, cell: ArrayLike = 1.0) -> Region:
    """A convex bounding volume {normals x <= offsets}.

    Parameters
    ----------
    normals : array_like, shape (F, 3)
        Outward normals.
    offsets : array_like, shape (F,)
        In units of the lengths of the normals.
    cell : array_like
        Edges of the cell that repeats.

    Returns
    -------
    Region
        The volume.
    """
    return Region(normals, offsets, cell)  # type: ignore[arg-type]


def region_of(value: Any) -> Region | None:
    """A volume in the unit cube, or None."""
    if value is None:
        return None
    if not isinstance(value, Region):
        raise InputError(f"within must be a bounding volume such as g.cuboid(), got {value!r:.60}")
    if np.abs(value.corners - 0.5).max() > 0.5 + 1e-9:
        raise InputError(f"within must be in the unit cube, got {value!r:.120}")
    return value


def region_data(region: Region) -> dict[str, Any]:
    """A volume as plain data.

    Parameters
    ----------
    region : Region
        The volume.

    Returns
    -------
    dict
        Its kind, and what that needs.
    """
    size = region.cell / 2.0
    box = np.vstack([-np.eye(3), np.eye(3)]), np.concatenate([np.zeros(3), size]), region.cell
    if _same(region, *box):
        return {"kind": "cuboid", "size": size.tolist()}
    for data, known in _named():
        if _same(region, known.normals, known.offsets, known.cell):
            return dict(data)
    return {
        "kind": "halfspaces",
        "normals": region.normals.tolist(),
        "offsets": region.offsets.tolist(),
        "cell": region.cell.tolist(),
    }


@lru_cache(maxsize=1)
def _named() -> tuple[tuple[dict[str, Any], Region], ...]:
    """Volumes without a parameter that is a number."""
    return (
        ({"kind": "prism"}, prism()),
        ({"kind": "tetrahedron", "copies": 48}, tetrahedron()),
        ({"kind": "tetrahedron", "copies": 192}, tetrahedron(192)),
    )


def _same(region: Region, normals: Any, offsets: Any, size: Any) -> bool:
    """Whether a region has these half-spaces and this cell, bit by bit."""
    pairs = ((region.normals, normals), (region.offsets, offsets), (region.cell, size))
    return all(np.array_equal(a, b) for a, b in pairs)


def region_from(data: Any) -> Region:
    """The volume of `region_data`.

    Parameters
    ----------
    data : mapping
        Plain data.

    Returns
    -------
    Region
        The volume.

    Raises
    ------
    InputError
        If something in it is unknown or missing.
    """
    if not isinstance(data, dict) or data.get("kind") not in list(_KEYS):
        raise InputError(f"within must have a kind, one of {', '.join(_KEYS)}, got {data!r:.80}")
    kind = data["kind"]
    given = sorted(str(key) for key in data if key != "kind")
    if given != sorted(_KEYS[kind]):
        raise InputError(
            f"within of kind {kind!r} must have {', '.join(sorted(_KEYS[kind])) or 'nothing else'},"
            f" got {', '.join(map(repr, given)) or 'nothing'}"
        )
    if kind == "cuboid":
        made = cuboid(data["size"])
    elif kind == "prism":
        made = prism()
    elif kind == "tetrahedron":
        made = tetrahedron(data["copies"])
    else:
        offsets = as_array("offsets", data["offsets"], ndim=1)
        made = halfspaces(data["normals"], offsets, data["cell"])
    out = region_of(made)
    assert out is not None
    return out
