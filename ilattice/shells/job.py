"""The command on shells: parameters in; meshes and a report, which is plain data, out.

Guarantee: wrong words, and files that cannot be written, are found before anything is computed.
"""

import os
from collections.abc import Sequence
from pathlib import PurePath
from typing import Any

import numpy as np

from ilattice._files import check_distinct, check_outputs, write_report
from ilattice._progress import Progress
from ilattice._stages import Stages
from ilattice._validate import as_counts, as_positive
from ilattice._version import __version__
from ilattice.errors import FormatError, InputError
from ilattice.io.registry import WRITERS
from ilattice.lattice import Lattice
from ilattice.macroshape import box
from ilattice.shells.cell import Shell, cell
from ilattice.shells.surface import N
from ilattice.shells.topologies import table


def shell(
    *, topology: str, output: Sequence[str | os.PathLike[str]] = (),
    position: Sequence[float] = (0.0,), derivative: Sequence[float] = (1.5,),
    density: float | None = None, thickness: float | None = None,
    repeat: int | Sequence[int] = 1, n: int = N, layer: float | None = None,
    method: str = "harmonic", h: float = 0.05, report: str | os.PathLike[str] | None = None,
    progress: Progress = None,
) -> dict[str, Any]:  # fmt: skip
    """Make a shell, with a wall and its mesh if files are asked for.

    Parameters
    ----------
    topology : str
        As topo_19_rrr; see `ilattice.shells.cell`.
    output : sequence of path-like
        Files for the mesh, by their endings.
    position, derivative : sequence of float
        One number, or one per orbit or node.
    density, thickness : float, optional
        Relative density of the walls, or their half-thickness; without any, files hold the
        triangles of the surface in one cell.
    repeat : int or sequence of int
        Number of cells of edge 1.
    n, layer, method : optional
        As in `ilattice.shells.cell`.
    h : float
        Length of the edges of the mesh of the wall.
    report : path-like, optional
        File for the report, as JSON.
    progress : bool or callable, optional
        See `ilattice._progress.track`.

    Returns
    -------
    dict
        The report.

    Raises
    ------
    InputError
        If an argument is wrong.
    FormatError
        If nothing can write a file.
    """
    if density is not None and thickness is not None:
        raise InputError("give either --density or --thickness")
    known = tuple(WRITERS["mesh"])
    for file in output:
        if PurePath(file).suffix.lower() not in known:
            raise FormatError(
                f"-o {str(file)!r:.200} has none of the endings {', '.join(sorted(known))}"
            )
    outputs = [*output, *([] if report is None else [report])]
    check_outputs(outputs)
    check_distinct({"-o": output, "--report": [] if report is None else [report]})
    counts, edge, stages = as_counts("repeat", repeat), as_positive("h", h), Stages()
    with stages("shell"):
        made = cell(
            topology, position=_numbers(position), derivative=_numbers(derivative), n=n,
            layer=layer, method=method,
        )  # fmt: skip
    mesh, filled = made.periodic.mesh, None
    if density is not None or thickness is not None:
        with stages("wall"):
            lattice = Lattice(made.tile, through=box(np.array(counts, np.float64)), repeat=counts)
            how: Any = {"relative_density": density} if thickness is None else {"d": thickness}
            wall = lattice.offset(**how, progress=progress)
            filled = wall.volume() / float(np.prod(counts))
        if output:
            with stages("mesh"):
                mesh = wall.mesh(h=edge, progress=progress)
    with stages("write"):
        for file in output:
            mesh.save(file)
    result = {
        "ilattice": __version__, **told(made), "density": filled, "stages": stages.records,
        "files": [str(path) for path in outputs],
    }  # fmt: skip
    if report is not None:
        write_report(report, result)
    return result


def told(made: Shell) -> dict[str, Any]:
    """What is known of a shell.

    Parameters
    ----------
    made : Shell
        The shell.

    Returns
    -------
    dict
        Its name and parameters, and measures per cell of edge 1.
    """
    whole = made.periodic
    return {
        "shell": made.name, "parameters": dict(made.parameters), "area": made.area,
        "euler": whole.euler, "genus": whole.genus, "pieces": whole.components,
        "mean_curvature": made.surface.curvature_quantile(), "slope": made.surface.slope,
        "layer": made.surface.layer,
        "tile_error": made.tile_error,
    }  # fmt: skip


def listed() -> list[str]:
    """The classes, a line each.

    Returns
    -------
    list of str
        Name, family, numbers of nodes and loops, and patterns.
    """
    return [
        f"{t.paper or t.name:8} {t.family:4} {len(t.nodes):2} nodes in {len(t.loops)} "
        f"loop{'s' if len(t.loops) > 1 else ' '}  {'  '.join(t.patterns)}"
        for t in table()
    ]


def _numbers(values: Sequence[float]) -> Any:
    """A number, or several."""
    many = list(values)
    return many[0] if len(many) == 1 else np.array(many, np.float64)
