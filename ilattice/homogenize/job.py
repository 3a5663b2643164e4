"""Commands on cells: a tile, or voxels, in; files and a report, which is plain data, out.

Guarantee: wrong words, and files that cannot be written, are found before anything is computed.
"""

import os
from collections.abc import Sequence
from pathlib import PurePath
from typing import Any

from ilattice._files import as_path, check_distinct, check_outputs, write_report
from ilattice._progress import Progress
from ilattice._stages import Stages
from ilattice._validate import as_not_negative, as_positive
from ilattice._version import __version__
from ilattice.errors import FormatError, InputError
from ilattice.homogenize.bloch import bloch
from ilattice.homogenize.elastic import elastic
from ilattice.homogenize.voxel import voxels as of_voxels
from ilattice.io.registry import WRITERS
from ilattice.lattice import Lattice
from ilattice.macroshape.cells import cell
from ilattice.tiles.catalog import get

#: Of the grid of a tile, per direction.
CELLS = 16
PICTURES = (".pdf", ".png", ".svg")


def solid_of(tile: str, density: float | None, thickness: float | None) -> Any:
    """The solid in one cell.

    Parameters
    ----------
    tile : str
        Name of a tile of the catalogue.
    density : float or None
        Relative density of its sheets.
    thickness : float or None
        Or their half-thickness.

    Returns
    -------
    Tile or Wall
        Without any of them, where the tile is negative.

    Raises
    ------
    InputError
        If there is no such tile, or both are given.
    """
    found = get(tile)
    if density is not None and thickness is not None:
        raise InputError("give either --density or --thickness")
    if density is None and thickness is None:
        return found
    lattice = Lattice(found, through=cell(found.cell), repeat=(1, 1, 1))
    if thickness is not None:
        return lattice.offset(as_positive("thickness", thickness))
    return lattice.offset(relative_density=as_positive("density", density))


def homogenize(
    *, tile: str | None = None, density: float | None = None, thickness: float | None = None,
    voxels: str | os.PathLike[str] | None = None, cells: int | None = None,
    young: Sequence[float] = (1.0,), poisson: float = 0.3,
    report: str | os.PathLike[str] | None = None, sphere: str | os.PathLike[str] | None = None,
    progress: Progress = None,
) -> dict[str, Any]:  # fmt: skip
    """Effective stiffness of a tile or of an array of voxels, with its files.

    Parameters
    ----------
    tile : str, optional
        Name of a tile of the catalogue.
    density, thickness : float, optional
        See `solid_of`.
    voxels : path-like, optional
        File of `read_voxels`, instead of a tile.
    cells : int, optional
        Of the grid of a tile, per direction; by default 16.
    young : sequence of float
        Young's modulus, of voxels also one per phase.
    poisson : float
        Poisson's ratio.
    report : path-like, optional
        File for the report, as JSON.
    sphere : path-like, optional
        File for Young's modulus in all directions as a surface.
    progress : bool or callable, optional
        See `ilattice._progress.track`.

    Returns
    -------
    dict
        The report.
    """
    if (tile is None) == (voxels is None):
        raise InputError("give either --tile, the name of a tile, or --voxels, a file")
    if voxels is not None and {density, thickness, cells} != {None}:
        raise InputError("--density, --thickness and --cells are for tiles; voxels have their own")
    if voxels is None and cells is None:
        cells = CELLS
    if len(young) > 1 and voxels is None:
        raise InputError("young must be one number for a tile")
    files = {"--report": report, "--sphere": sphere}
    given = {name: [path] for name, path in files.items() if path is not None}
    outputs = [path for paths in given.values() for path in paths]
    check_outputs(outputs)
    check_distinct({**given, "--voxels": [] if voxels is None else [voxels]})
    if sphere is not None:
        _check_ending("--sphere", sphere, tuple(WRITERS["mesh"]))
    stages = Stages()
    with stages("solve"):
        if voxels is not None:
            modulus = young[0] if len(young) == 1 else tuple(young)
            eff = of_voxels(voxels, young=modulus, poisson=poisson, progress=progress)
        else:
            solid = solid_of(str(tile), density, thickness)
            eff = elastic(solid, cells, young=young[0], poisson=poisson, progress=progress)
    if sphere is not None:
        with stages("write"):
            eff.surface().save(sphere)
    inputs = {
        "tile": tile, "density": density, "thickness": thickness,
        "voxels": None if voxels is None else str(voxels), "cells": cells, "young": list(young),
        "poisson": poisson,
    }  # fmt: skip
    result = {
        "ilattice": __version__, "input": inputs, **eff.as_dict(), "stages": stages.records,
        "files": [str(path) for path in outputs],
    }  # fmt: skip
    if report is not None:
        write_report(report, result)
    return result


def bands(
    *, tile: str, output: Sequence[str | os.PathLike[str]], density: float | None = None,
    thickness: float | None = None, path: str = "GXMRG", count: int = 8, steps: int = 8,
    cells: int = 12, young: float = 1.0, poisson: float = 0.3, mass: float = 1.0,
    progress: Progress = None,
) -> dict[str, Any]:  # fmt: skip
    """Bands of frequencies of waves in a tile, with their files.

    Parameters
    ----------
    tile : str
        Name of a tile of the catalogue.
    output : sequence of path-like
        Tables (.csv), reports (.json) and pictures (.png, .svg, .pdf).
    density, thickness : float, optional
        See `solid_of`.
    path, count, steps, cells, young, poisson : optional
        As in `bloch`.
    mass : float
        Mass per volume of the solid.
    progress : bool or callable, optional
        See `ilattice._progress.track`.

    Returns
    -------
    dict
        The report.
    """
    check_outputs(output)
    check_distinct({"-o": output})
    for file in output:
        _check_ending("-o", file, (".csv", ".json", *PICTURES))
    mass = as_not_negative("--mass", mass)
    solid = solid_of(tile, density, thickness)
    found = bloch(
        solid, cells, path=path, count=count, steps=steps, young=young, poisson=poisson,
        density=mass, progress=progress,
    )  # fmt: skip
    for file in output:
        if PurePath(file).suffix.lower() in PICTURES:
            found.plot().savefig(file)
        else:
            found.save(file)
    return {**found.as_dict(), "error": found.error, "files": [str(file) for file in output]}


def _check_ending(name: str, path: str | os.PathLike[str], known: Sequence[str]) -> None:
    """Refuse a file that nothing can write."""
    if PurePath(as_path(name, path)).suffix.lower() not in known:
        raise FormatError(
            f"{name} {str(path)!r:.200} has none of the endings {', '.join(sorted(known))}"
        )
