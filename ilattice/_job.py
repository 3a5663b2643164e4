"""The main job as one call: tile, volume and thickness in; files and a report out.

This is what the command line calls; the report is plain data, ready for JSON.
"""

import os
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

import ilattice as il
from ilattice._files import check_distinct, check_outputs, write_report
from ilattice._progress import Progress
from ilattice._stages import Stages
from ilattice._validate import as_positive
from ilattice._warmup import aside
from ilattice.errors import FileError, FormatError, InputError
from ilattice.io.registry import WRITERS
from ilattice.io.splines import list_patches
from ilattice.mesh.regions import islands_of
from ilattice.offsets.thickness import as_equation
from ilattice.tiles.cells import CellRow

#: Volumes of `ilattice.macroshape` that need no arguments.
VOLUMES = ("box", "cylinder_shell", "duck", "tapered", "torus", "wing")


def volume(spec: str) -> "il.SplineMap":
    """A volume by its name, or from a file.

    Parameters
    ----------
    spec : str
        One of `VOLUMES`, or the path of a file; ``path#2`` is patch 2 of a file with several.

    Returns
    -------
    SplineMap
        The volume.

    Raises
    ------
    InputError
        If it is a word that names no volume.
    FileError, FormatError
        If a file (a word with a dot or a slash) is missing, or cannot be read.
    """
    if spec in VOLUMES:
        return getattr(il.macroshape, spec)()
    file = spec.rpartition("#")[0] or spec
    if not any(os.path.exists(path) for path in (spec, file)):
        if Path(file).name != file or Path(file).suffix:
            raise FileError(f"through {spec!r:.80}: there is no such file")
        near = ", ".join(VOLUMES)
        raise InputError(
            f"through {spec!r:.80} is neither a file nor a built-in volume; these are {near}"
        )
    return il.macroshape.load(spec)


def cell(spec: str, space: "il.SplineMap", seed: int | None = None) -> "il.Tile | il.tiles.Mixture":
    """A tile by its name, or several of them.

    Parameters
    ----------
    spec : str
        Name of a tile of the catalogue, or several, separated by commas: they follow each other,
        with smooth transitions, along the first direction of the volume that is not closed.
    space : SplineMap
        The volume.
    seed : int, optional
        Seed of a random choice among the tiles for every cell, instead of that order.

    Returns
    -------
    Tile or Mixture
        What `Lattice` takes.

    Raises
    ------
    InputError
        If a name is unknown, or the seed is negative.
    """
    names = [name.strip() for name in spec.split(",")]
    if seed is not None:
        return il.tiles.mix(*names, seed=seed)
    if len(names) == 1:
        return il.tiles.get(names[0])
    axis = int(np.argmin(space.closed))
    lo, hi = space.domain[:, axis]
    part = (hi - lo) / len(names)
    centres = lo + part * np.arange(1, len(names))
    return il.tiles.hybrid(*names, weight=il.tiles.sigmoid(axis, centres, 0.5 * part))


def half_thickness(value: str | float) -> Any:
    """A half-thickness from a command line.

    Parameters
    ----------
    value : str or float
        A number, or an equation in u, v, w or in x, y, z; see `ilattice.fields.equation`.

    Returns
    -------
    float or Node
        What `offset` takes: the number, also of constant equations such as ``"1/8"``, or a field.

    Raises
    ------
    InputError
        For any other text, with the place of the first wrong character.
    """
    if not isinstance(value, str):
        return value
    return as_equation(value)


def build(
    *,
    tile: str,
    through: str,
    repeat: tuple[int, int, int],
    thickness: str | float,
    output: Sequence[str | os.PathLike[str]],
    tol: float | None = None,
    h: float | None = None,
    report: str | os.PathLike[str] | None = None,
    features: bool = False,
    remove_islands: bool = False,
    allow_loss: bool = False,
    seed: int | None = None,
    progress: Progress = None,
) -> dict[str, Any]:
    """Fill a volume with a lattice of given wall thickness and write meshes of it.

    Parameters
    ----------
    tile : str
        Name of a tile of the catalogue, or several, see `cell`.
    through : str
        Name of a built-in volume, or ``FILE`` or ``FILE#patch``.
    repeat : tuple of int
        Number of tiles along u, v and w.
    thickness : str or float
        Half-thickness: a number, or an equation in u, v, w or in x, y, z.
    output : sequence of path-like
        Files to write; the endings pick the formats.
    tol : float, optional
        Largest error of the half-thickness.
    h : float, optional
        Length of the edges of the mesh.
    report : path-like, optional
        File for the report.
    features : bool
        Whether to measure the thinnest wall and the narrowest gap, which may take a minute.
    remove_islands : bool
        Whether to keep only the largest part of the mesh.
    allow_loss : bool
        Whether to accept a mesh that has lost more than 5 % of the volume of the wall.
    seed : int, optional
        Seed of a random choice among the tiles, see `cell`.
    progress : bool or callable, optional
        See `ilattice._progress.track`.

    Returns
    -------
    dict
        The report.
    """
    reports = [report] if report else []
    check_outputs([*output, *reports])
    check_distinct({"--through": _files(through), "-o": output, "--report": reports})
    check_endings(output, "mesh")
    d = half_thickness(thickness)
    h = None if h is None else as_positive("h", h)
    for name in tile.split(","):
        il.tiles.row(name)
    stages = Stages()
    with stages("volume"):
        space = volume(through)
        lattice = il.Lattice(cell(tile, space, seed), through=space, repeat=repeat)
    with stages("distance"):
        wall = lattice.offset(d, tol=tol, progress=progress)
    with stages("mesh"):
        mesh = wall.mesh(h=h, allow_loss=allow_loss, progress=progress)
        if remove_islands:
            mesh = mesh.remove_islands()
    with stages("thickness error"):
        error = wall.thickness_error(mesh)
    least = {}
    if features:
        with stages("features"):
            least = {"minimum_thickness": _plain(wall.minimum_thickness()),
                     "minimum_gap": _plain(wall.minimum_gap())}  # fmt: skip
    with stages("write"):
        for path in output:
            mesh.save(path)
    inputs = {
        "tile": tile,
        "through": through,
        "map": through,  # its name until the next release
        "repeat": list(repeat),
        "thickness": thickness,
        "tol": tol,
        "seed": seed,
        "remove_islands": remove_islands,
    }
    result = {
        "ilattice": il.__version__,
        "input": inputs | {"h": h},
        **mesh.measures(),
        **islands_of(mesh),
        "wall_volume": wall.known_volume,
        "self_intersections": mesh.self_intersections,
        "unconverged": int(mesh.point_data["unconverged"].sum()),
        "thickness_error": {
            k: getattr(error, k) for k in ("max", "p99", "rms", "relative", "missing")
        },
        **least,
        "closest_points": counts(lattice),
        "stages": stages.records,
        "files": [str(path) for path in [*output, *([report] if report else [])]],
    }
    if report:
        write_report(report, result)
    return result


def slices(
    *,
    tile: str,
    through: str,
    repeat: tuple[int, int, int],
    thickness: str | float,
    layer: float,
    output: Sequence[str | os.PathLike[str]],
    h: float | None = None,
    polish: bool = True,
    seed: int | None = None,
    progress: Progress = None,
) -> dict[str, Any]:
    """Fill a volume with a lattice of given wall thickness and write slices of it.

    Parameters
    ----------
    tile, through, repeat, thickness, h, seed, progress : optional
        As in `build`.
    layer : float
        Thickness of the layers.
    output : sequence of path-like
        Files to write: CLI, SVG or 3MF.
    polish : bool
        Whether contours move onto the exact offset; otherwise they follow the distance spline.

    Returns
    -------
    dict
        Number of layers, their lower and upper end, and the files.
    """
    check_outputs(output)
    check_distinct({"--through": _files(through), "-o": output})
    check_endings(output, "slices")
    d = half_thickness(thickness)
    layer, h = as_positive("layer", layer), None if h is None else as_positive("h", h)
    space = volume(through)
    lattice = il.Lattice(cell(tile, space, seed), through=space, repeat=repeat)
    wall = lattice.offset(d, progress=progress)
    stack = wall.slices(thickness=layer, h=h, polish=polish)
    for path in output:
        stack.save(path, progress=progress)
    return {
        "layers": len(stack),
        "from": stack.bottom,
        "to": float(stack.tops[-1]),
        "files": [str(path) for path in output],
    }


def demo(
    out: str | os.PathLike[str] = "ilattice-demo",
    *,
    h: float = 0.05,
    progress: Progress = None,
) -> dict[str, Any]:
    """Build the Schwarz-P torus with half-thickness 0.1, with files, picture and report.

    Parameters
    ----------
    out : path-like
        Directory for ``torus.stl``, ``torus.vtp``, ``macroshape.vtu``, ``torus.png`` and
        ``report.json``; made if it does not exist.
    h : float
        Length of the edges of the mesh.
    progress : bool or callable, optional
        See `ilattice._progress.track`.

    Returns
    -------
    dict
        The report.
    """
    if not isinstance(out, (str, os.PathLike)) or not os.fspath(out):
        raise InputError(f"out must name a directory, got {out!r:.80}; '.' is this one")
    folder, h = Path(out), as_positive("h", h)
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as e:
        raise FileError(f"out: cannot make the directory {str(folder)!r}: {e.strerror}") from e
    names = ("torus.stl", "torus.vtp", "torus.png")
    with aside("meshes"):
        result = build(
            tile="schwarz_p",
            through="torus",
            repeat=(16, 2, 2),
            thickness=0.1,
            h=h,
            output=[folder / name for name in names],
            progress=progress,
        )
    volume("torus").save(folder / "macroshape.vtu")
    result["files"] += [str(folder / name) for name in ("macroshape.vtu", "report.json")]
    write_report(folder / "report.json", result)
    return result


def _plain(feature: "il.topology.Feature") -> dict[str, Any]:
    """A feature as plain data; nothing of infinite size."""
    there = feature.kind != "none"
    return {
        "size": feature.size if there else None,
        "kind": feature.kind,
        "at": feature.x.tolist() if there else None,
    }


def counts(lattice: "il.Lattice") -> dict[str, float]:
    """What the report says about closest points."""
    found = lattice.statistics
    return {
        "queries": found.queries,
        "mean_iterations": round(found.mean_iterations, 3),
        "fallbacks": found.fallbacks,
    }


def _files(spec: str) -> list[str]:
    """The file that a volume is read from, if it is."""
    return [path for path in (spec, spec.rpartition("#")[0]) if os.path.isfile(path)][:1]


def check_endings(paths: Sequence[str | os.PathLike[str]], kind: str) -> None:
    """Refuse, before any work, endings that no format of an object has.

    Parameters
    ----------
    paths : sequence of path-like
        Files that will be written.
    kind : str
        Kind of what they will hold, such as ``"mesh"``; see `ilattice.io.save`.

    Raises
    ------
    FormatError
        Naming the first file of an unknown format, and the known ones.
    """
    known = WRITERS[kind]
    for path in paths:
        if Path(path).suffix.lower() not in known:
            raise FormatError(f"{str(path)!r} has none of the endings {', '.join(sorted(known))}")


def describe(spec: str) -> list[str]:
    """What a volume or a file of volumes is, in lines of text.

    Parameters
    ----------
    spec : str
        As for `volume`.

    Returns
    -------
    list of str
        Size, degrees, bounds, volume and Jacobian certificate of each patch.
    """
    if spec in VOLUMES or not os.path.exists(spec):
        space = volume(spec)
        return _described(f"{spec}: {space!r}", space)
    lines = []
    for patch in list_patches(spec):
        usable = patch.index is not None and patch.spline.m >= 3 and min(patch.spline.k) >= 1
        if usable:
            lines += _described(str(patch), il.SplineMap(patch.spline, names=patch.names))
        else:
            lines.append(str(patch))
    if not lines:
        raise FormatError(f"{spec}: holds no spline that is known here")
    return lines


def _described(title: str, space: "il.SplineMap") -> list[str]:
    (a, b), (lo, hi) = space.domain.tolist(), space.bounds.tolist()
    return [
        title,
        f"  parameters   {a} to {b}",
        f"  bounds       {_short(lo)} to {_short(hi)}",
        f"  volume       {space.volume():.6g}",
        f"  certificate  {space.certificate}",
    ]


def _short(values: list[float]) -> str:
    return "(" + ", ".join(f"{v:.4g}" for v in values) + ")"


_FLAGS = ("singular_at_zero", "hexagonal", "disconnected")


def catalogue() -> list[str]:
    """The tiles of the catalogue, one line of text each.

    Returns
    -------
    list of str
        Name, aliases and flags.
    """
    lines = []
    for name in il.tiles.names():
        row = il.tiles.row(name)
        flags = [f for f in _FLAGS if getattr(row, f, False)]
        if isinstance(row, CellRow):
            flags.append(f"radius {row.radius:g}")
        lines.append(f"{name:<24}{', '.join([*row.aliases, *(f'[{f}]' for f in flags)])}".rstrip())
    return lines
