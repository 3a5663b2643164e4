"""3MF with a beam lattice (beam lattice extension, 1.2), written as it comes, without lib3mf.

Guarantees: positions and radii with eight significant digits of the largest coordinate; the
extension is marked as required, since the object has no triangles; the same beams give the same
bytes. Caps are spheres, so that the solid is that of the beams.
"""

import os
import warnings
import zipfile
from collections.abc import Iterator

import numpy as np

from ilattice._files import atomic_write
from ilattice.errors import PrecisionWarning
from ilattice.io._mesh import TEXT_BLOCK, BeamArrays, blocks, check_single
from ilattice.io._slices import as_unit
from ilattice.io.threemf_slices import CORE, RELATIONS, TYPES, XML, entry

_BEAMS = "http://schemas.microsoft.com/3dmanufacturing/beamlattice/2017/02"
#: Part of the least radius that single precision may lose without a word.
FAR = 1e-3
_DIGITS = 8
_SIZES = 1e-9, 1e9


def write_3mf_beams(
    beams: BeamArrays, path: str | os.PathLike[str], *, unit: str = "millimeter"
) -> None:
    """Write beams as a 3MF beam lattice.

    Parameters
    ----------
    beams : Beams
        The beams.
    path : path-like
        File to create or to replace.
    unit : {"micron", "millimeter", "centimeter", "inch", "foot", "meter"}
        Unit of the coordinates.

    Raises
    ------
    InputError
        Unknown unit.
    FormatError
        If the file cannot be written, or holds no coordinates of this size.
    """
    unit = as_unit(unit)
    check_single(beams.vertices, "3MF", *_SIZES)
    _tell_far(beams)
    with (
        atomic_write(path) as file,
        zipfile.ZipFile(file, "w", zipfile.ZIP_DEFLATED, compresslevel=4) as package,
    ):
        for name, text in (("[Content_Types].xml", TYPES), ("_rels/.rels", RELATIONS)):
            with package.open(entry(name), "w") as part:
                part.write(text.encode("utf-8"))
        with package.open(entry("3D/3dmodel.model"), "w", force_zip64=True) as part:
            for text in _model(beams, unit):
                part.write(text.encode("utf-8"))


def _tell_far(beams: BeamArrays) -> None:
    """Warn where readers in single precision lose a part of radii."""
    lost = 2.0**-24 * float(np.abs(beams.vertices).max()) / float(beams.radii.min())
    if lost > FAR:
        warnings.warn(
            f"the beams are so far from the origin that readers in single precision move their "
            f"ends by {100.0 * lost:.2g} % of the least radius: move the part to the origin",
            PrecisionWarning,
            stacklevel=4,
        )


def _model(beams: BeamArrays, unit: str) -> Iterator[str]:
    size = float(np.abs(beams.vertices).max())
    fine = min(size, 1e2 * float(beams.radii.min()))  # digits of radii, too
    places = int(np.clip(_DIGITS - np.floor(np.log10(max(fine, 1e-30))), 1, 16))
    least = float(np.linalg.norm(np.diff(beams.vertices[beams.pairs], axis=1), axis=2).min())
    number = f"%.{places}f"
    yield (
        f'{XML}<model unit="{unit}" xml:lang="en-US" xmlns="{CORE}" xmlns:b="{_BEAMS}" '
        'requiredextensions="b">\n<resources>\n<object id="1" type="model"><mesh><vertices>\n'
    )
    row = f'<vertex x="{number}" y="{number}" z="{number}"/>\n'
    for rows in blocks(len(beams.vertices), TEXT_BLOCK):
        points = beams.vertices[rows]
        yield (row * len(points)) % tuple(points.flat)
    yield (
        f'</vertices><triangles/>\n<b:beamlattice minlength="{0.5 * least:.9g}" '
        f'radius="{float(beams.radii.mean()):.9g}" cap="sphere"><b:beams>\n'
    )
    row = '<b:beam v1="%d" v2="%d" r1="%.9g" r2="%.9g"/>\n'
    for rows in blocks(len(beams.pairs), TEXT_BLOCK):
        ends, radii = beams.pairs[rows].tolist(), beams.radii[rows].tolist()
        values = [x for e, r in zip(ends, radii, strict=True) for x in (*e, *r)]
        yield (row * len(ends)) % tuple(values)
    yield (
        "</b:beams></b:beamlattice></mesh></object>\n</resources>\n"
        '<build><item objectid="1"/></build>\n</model>\n'
    )
