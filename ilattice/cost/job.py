"""The command ``ilattice cost kagome``: a structure in a map, with its files and a report.

Guarantee: wrong words, and files that cannot be written, are found before anything is computed.
"""

import os
import warnings
from collections.abc import Sequence
from pathlib import PurePath
from typing import Any

import numpy as np

from ilattice._files import as_path, check_distinct, check_outputs, write_report
from ilattice._progress import Progress
from ilattice._stages import Stages
from ilattice._validate import as_positive
from ilattice._version import __version__
from ilattice.cost.kagome import divided_box, fill, kagome
from ilattice.cost.stiffening import braced, tell_rank
from ilattice.cost.structure import CornerSharing
from ilattice.errors import FormatError, InputError, PrecisionWarning
from ilattice.io.registry import WRITERS

#: Layers of sliced files, if no thickness is given.
LAYERS = 50


def run(
    *, resolution: int, output: Sequence[str | os.PathLike[str]], through: Any = None,
    cells: int = 0, radius: float | None = None, h: float | None = None,
    thickness: float | None = None, stiffen: bool = False,
    report: str | os.PathLike[str] | None = None, progress: Progress = None,
) -> dict[str, Any]:  # fmt: skip
    """Kagome structure in a tetrahedron or a box, through a map, as files.

    Parameters
    ----------
    resolution : int
        Tetrahedra along an edge.
    output : sequence of path-like
        Beams (.3mf, .vtp, .vtu), meshes (.stl, .ply, .obj, ...), slices (.cli, .svg).
    through : SplineMap, optional
        Map; default none.
    cells : int
        Cells of the domain per direction, of five tetrahedra each; 0 for one regular tetrahedron.
    radius : float, optional
        Of the beams; default a tenth of the shortest edge at each vertex.
    h : float, optional
        Spacing of the grid of meshes.
    thickness : float, optional
        Of layers; default a fiftieth of the height.
    stiffen : bool
        Add bars that make it minimally rigid.
    report : path-like, optional
        File for the report, as JSON.
    progress : bool or callable, optional
        See `ilattice._progress.track`.

    Returns
    -------
    dict
        The report.
    """
    known = {*WRITERS["beams"], *WRITERS["mesh"], ".cli", ".svg"}
    files = [*output] if report is None else [*output, report]
    check_outputs(files)
    check_distinct({"-o": output, "--report": [] if report is None else [report]})
    for file in output:
        if PurePath(as_path("output", file)).suffix.lower() not in known:
            told = ", ".join(sorted(known))
            raise FormatError(f"-o {str(file)!r:.200} has none of the endings {told}")
    stages = Stages()
    with stages("structure"):
        k = _structure(resolution, cells, through)
        if stiffen:
            k = braced(k, generic=bool(cells))
        if through is not None:
            k = k.mapped(through)
        found = tell_rank(k, "matroid") if stiffen else None
        r = 0.1 * k.shortest if radius is None else as_positive("radius", radius)
        beams = k.beams(r)
    with stages("write"):
        for file in output:
            _write(beams, file, h, thickness, progress)
    result = {
        "ilattice": __version__, "resolution": resolution, "cells": cells,
        "radius": float(beams.radii.mean()), "least radius": float(beams.radii.min()),
        "largest radius": float(beams.radii.max()),
        "vertices": len(k.positions), "tetrahedra": len(k.simplices), "bars": len(k.bars),
        "beams": len(k.edges), "length of beams": float(k.lengths.sum()), "deficit": k.deficit,
        "stages": stages.records, "files": [str(file) for file in output],
    }  # fmt: skip
    if found is not None:
        result |= {"rank": found.rank, "flexes": found.flexes, "self-stresses": found.self_stresses}
    if report is not None:
        write_report(report, result)
    return result


def _structure(resolution: int, cells: int, through: Any) -> CornerSharing:
    """The structure in the domain of the map, or in the unit cube."""
    if cells < 0:
        raise InputError(f"cells must be 0 or more, got {cells}")
    lo, hi = np.array([(0.0,) * 3, (1.0,) * 3]) if through is None else np.asarray(through.domain)
    if cells:
        x, tets = divided_box(cells, lo=lo, hi=hi)
        return fill(x, tets, resolution=resolution).joined()
    k = kagome(resolution)
    return k.moved(lo + k.positions * (hi - lo))


def _write(beams: Any, file: Any, h: float | None, thickness: float | None, progress: Any) -> None:
    ending = PurePath(file).suffix.lower()
    if ending in WRITERS["beams"]:
        beams.save(file)
    elif ending in (".cli", ".svg"):
        low, high = beams.bounds[:, 2]
        t = (high - low) / LAYERS if thickness is None else thickness
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", PrecisionWarning)
            beams.slices(thickness=t).save(file)
    else:
        beams.mesh(h, progress=progress).save(file)
