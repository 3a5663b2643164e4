"""Commands on graphs: a file in; tiles, meshes, voxels, properties and pictures out.

Guarantee: wrong words, and files that cannot be written, are found before anything is computed.
"""

import os
from collections.abc import Sequence
from pathlib import PurePath
from typing import Any

from ilattice._files import as_path, check_distinct, check_outputs, write_report
from ilattice._progress import Progress
from ilattice._validate import as_choice, as_positive
from ilattice.errors import FormatError, InputError
from ilattice.graph.explore import KINDS, explore
from ilattice.graph.files import load
from ilattice.graph.graph import Graph
from ilattice.graph.library import library
from ilattice.io.registry import WRITERS

PICTURES = (".pdf", ".png", ".svg")
ACTIONS = ("run", "plot", "validate", "explore")


def opened(name: str) -> Graph:
    """A graph from a file, or from the library by its name.

    Parameters
    ----------
    name : str
        File ending in .json, or a name.

    Returns
    -------
    Graph
        The graph.
    """
    return load(name) if PurePath(name).suffix else library[name]


def run(
    action: str, file: str, *, output: Sequence[str | os.PathLike[str]] = (), h: float = 0.02,
    cells: int | None = None, seeds: int = 10, thickness: float = 0.05, progress: Progress = None,
) -> dict[str, Any]:  # fmt: skip
    """Do one thing with a graph.

    Parameters
    ----------
    action : {"run", "plot", "validate", "explore"}
        Make files of its solid; draw it; check it; a table of random graphs.
    file : str
        File or name of a graph; for "explore" the kind of graphs.
    output : sequence of path-like
        Meshes, .vti of voxels, pictures, or a .json report with the stiffness; of "explore" one
        .csv.
    h : float
        Spacing of meshes.
    cells : int, optional
        Voxels per direction.
    seeds : int
        Number of random graphs.
    thickness : float
        Of random graphs.
    progress : bool or callable, optional
        See `ilattice._progress.track`.

    Returns
    -------
    dict
        What there is to tell.
    """
    as_choice("action", action, ACTIONS)
    check_outputs(output)
    check_distinct({"-o": output})
    endings = [PurePath(as_path("-o", f)).suffix.lower() for f in output]
    meshes = tuple(WRITERS["mesh"])
    known = {
        "run": (*meshes, ".vti", ".json"), "plot": PICTURES, "validate": (), "explore": (".csv",),
    }[action]  # fmt: skip
    for ending, path in zip(endings, output, strict=True):
        if ending not in known:
            told = ", ".join(sorted(known)) or "no file"
            raise FormatError(f"-o {str(path)!r:.200}: graph {action} writes {told}")
    if action == "explore":
        if len(output) > 1:
            raise InputError("-o: graph explore writes one table")
        rows = explore(
            as_choice("FILE", file, KINDS), seeds, thickness=as_positive("thickness", thickness),
            cells=cells or 32, table=output[0] if output else None, progress=progress,
        )  # fmt: skip
        return {"rows": len(rows), "failed": len(rows.failed), "files": [str(f) for f in output]}
    graph = opened(file)
    out = {"name": graph.name, "nodes": graph.count, "digest": graph.digest}
    if action == "validate":
        return {**out, "files": []}
    if action == "plot" and not output:
        raise InputError("-o must name a picture")
    for ending, path in zip(endings, output, strict=True):
        _write(graph, ending, path, h, cells, out)
    if not output:
        solid = graph.voxels(cells)
        out |= {"voxels": len(solid), "density": float(solid.mean())}
    return {**out, "files": [str(f) for f in output]}


def _write(
    graph: Graph, ending: str, path: Any, h: float, cells: int | None, told: dict[str, Any]
) -> None:
    """One file."""
    if ending in PICTURES:
        graph.plot().savefig(path)
    elif ending == ".vti":
        graph.save_voxels(path, cells)
    elif ending == ".json":
        effective = graph.homogenize(cells or 48, method="voxels")
        write_report(path, {**told, **effective.as_dict()})
        told["density"] = effective.density
    else:
        graph.mesh(as_positive("h", h)).save(path)
