"""3MF with a slice stack (slice extension 1.0), written as it comes, without lib3mf.

Guarantees: closed polygons, eight digits, tops that increase; empty slices are kept. The mesh
that every 3MF object needs, and which programs print that do not know of slices, is the part
itself: the mesh that was sliced, or that of the wall at twice the default length of edges, marked
as low resolution. The extension is marked as required.
"""

import os
import zipfile
from collections.abc import Iterator

import numpy as np

from ilattice._files import atomic_write
from ilattice._progress import Progress, track
from ilattice._typing import FloatArray
from ilattice.io._mesh import TEXT_BLOCK, Triangles, blocks
from ilattice.io._slices import Section, Stack, as_unit, contours, decimals, join

CORE = "http://schemas.microsoft.com/3dmanufacturing/core/2015/02"
_SLICE = "http://schemas.microsoft.com/3dmanufacturing/slice/2015/07"
XML = '<?xml version="1.0" encoding="UTF-8"?>\n'
TYPES = (
    f'{XML}<Types xmlns="http://schemas.openxmlformats.org/package/2006/content-types">'
    '<Default Extension="rels" '
    'ContentType="application/vnd.openxmlformats-package.relationships+xml"/>'
    '<Default Extension="model" '
    'ContentType="application/vnd.ms-package.3dmanufacturing-3dmodel+xml"/></Types>'
)
RELATIONS = (
    f'{XML}<Relationships xmlns="http://schemas.openxmlformats.org/package/2006/relationships">'
    '<Relationship Target="/3D/3dmodel.model" Id="rel0" '
    'Type="http://schemas.microsoft.com/3dmanufacturing/2013/01/3dmodel"/></Relationships>'
)
#: Date of all entries, so that equal slices make equal files: the earliest that ZIP has.
_EPOCH = (1980, 1, 1, 0, 0, 0)


def write_3mf_slices(
    stack: Stack,
    path: str | os.PathLike[str],
    *,
    unit: str = "millimeter",
    progress: Progress = None,
) -> None:
    """Write slices as the slice stack of a 3MF object.

    Parameters
    ----------
    stack : SliceStack
        The slices.
    path : path-like
        File to create or to replace.
    unit : {"micron", "millimeter", "centimeter", "inch", "foot", "meter"}
        Unit of the coordinates.
    progress : bool or callable, optional
        See `ilattice._progress.track`.

    Raises
    ------
    InputError
        Unknown unit.
    FormatError
        If the file cannot be written.
    """
    unit = as_unit(unit)
    with (
        atomic_write(path) as file,
        zipfile.ZipFile(file, "w", zipfile.ZIP_DEFLATED, compresslevel=4) as package,
    ):
        for name, text in (("[Content_Types].xml", TYPES), ("_rels/.rels", RELATIONS)):
            with package.open(entry(name), "w") as part:
                part.write(text.encode("utf-8"))
        with package.open(entry("3D/3dmodel.model"), "w", force_zip64=True) as part:
            for text in _model(stack, unit, progress):
                part.write(text.encode("utf-8"))


def entry(name: str) -> zipfile.ZipInfo:
    """A file of a package, without the time."""
    entry = zipfile.ZipInfo(name, _EPOCH)
    entry.compress_type = zipfile.ZIP_DEFLATED
    return entry


def _model(stack: Stack, unit: str, progress: Progress) -> Iterator[str]:
    approximation = stack.slicer.approximation()
    places = decimals(stack.bounds)
    yield (
        f'{XML}<model unit="{unit}" xml:lang="en-US" xmlns="{CORE}" xmlns:s="{_SLICE}" '
        'requiredextensions="s">\n<resources>\n'
        f'<s:slicestack id="1" zbottom="{stack.bottom:.{places}f}">\n'
    )
    for section in track(stack, "slices", progress, total=len(stack)):
        yield _slice(section, places)
    yield (
        '</s:slicestack>\n<object id="2" type="model" s:slicestackid="1" '
        's:meshresolution="lowres">\n'
    )
    yield from _mesh(approximation, stack.frame, places)
    yield '</object>\n</resources>\n<build><item objectid="2"/></build>\n</model>\n'


def _slice(section: Section, places: int) -> str:
    loops = [points for points, _ in contours(section)]
    if not loops:
        return f'<s:slice ztop="{section.top:.{places}f}"/>\n'
    vertices = join(np.concatenate(loops), places, '<s:vertex x="', '" y="', '"/>')
    parts, first = [f'<s:slice ztop="{section.top:.{places}f}"><s:vertices>{vertices}'], 0
    parts.append("</s:vertices>\n")
    for points in loops:
        following = [*range(first + 1, first + len(points)), first]
        segments = "".join(f'<s:segment v2="{i}"/>' for i in following)
        parts.append(f'<s:polygon startv="{first}">{segments}</s:polygon>\n')
        first += len(points)
    return "".join(parts) + "</s:slice>\n"


def _mesh(mesh: Triangles, frame: FloatArray, places: int) -> Iterator[str]:
    """Vertices in the directions of the slices, and triangles."""
    yield "<mesh><vertices>\n"
    row = f'<vertex x="%.{places}f" y="%.{places}f" z="%.{places}f"/>\n'
    for rows in blocks(len(mesh.vertices), TEXT_BLOCK):
        points = mesh.vertices[rows].astype(np.float64) @ frame.T
        yield (row * len(points)) % tuple(points.flat)
    yield "</vertices>\n<triangles>\n"
    row = '<triangle v1="%d" v2="%d" v3="%d"/>\n'
    for rows in blocks(len(mesh.faces), TEXT_BLOCK):
        corners = mesh.faces[rows]
        yield (row * len(corners)) % tuple(corners.flat)
    yield "</triangles></mesh>\n"
