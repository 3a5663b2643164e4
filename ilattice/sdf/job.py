"""A command with its options, carried out: files and a report.

Guarantees: the same command writes the same bytes of meshes and tables; what is wrong with the
words is found before anything is meshed or written. A sweep that was interrupted goes on where it
stopped: rows of the table are kept as long as the command and the file they name are the same.
"""

import csv
import io
import math
import os
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np

from ilattice import fields
from ilattice._progress import Progress, track
from ilattice._stages import Stages
from ilattice._typing import FloatArray
from ilattice.errors import FormatError, IlatticeError, InputError
from ilattice.io._common import atomic_write, write_report
from ilattice.io.registry import WRITERS
from ilattice.mesh.topology import islands_of
from ilattice.sdf._tokens import Token
from ilattice.sdf.language import Command, is_free
from ilattice.sdf.meshing import MEMORY, Plan, mesh, plan

__all__ = ["run"]

OUTPUT = "out.ply"
MOST_RUNS = 100_000
MEASURES = ("volume", "area", "genus", "components", "watertight", "vertices", "faces")


@dataclass(frozen=True)
class Settings:
    """The options of a command, checked."""

    output: Path
    spacing: FloatArray | None
    tol: float | None
    slices: float | None
    report: Path | None
    table: Path
    memory: float
    strict: bool
    dry_run: bool
    remove_islands: bool
    sweep: Mapping[str, tuple[str, ...]]

    @classmethod
    def of(cls, command: Command) -> "Settings":
        """Settings of a command, or `InputError`."""
        options = command.options
        output = _path(options, "-o") or Path(OUTPUT)
        found = cls(
            output,
            _spacing(options.get("-s", ())),
            _number(options, "--tol"),
            _number(options, "--slices"),
            _path(options, "--report"),
            _path(options, "--table") or output.with_suffix(".csv"),
            _number(options, "--memory") or MEMORY,
            "--strict" in options,
            "--dry-run" in options,
            "--remove-islands" in options,
            _sweep(options.get("--set", ())),
        )
        if found.spacing is not None and found.tol is not None:
            raise InputError("give either -s, a spacing, or --tol, a tolerance")
        kind = "SurfaceMesh" if found.slices is None else "SliceStack"
        if output.suffix.lower() not in WRITERS[kind]:
            known = ", ".join(sorted(WRITERS[kind]))
            raise FormatError(f"output {str(output)!r} has none of the endings {known}")
        for path in (output, found.report, found.table):
            if path is not None and not path.parent.is_dir():
                raise InputError(
                    f"output {str(path)!r}: there is no directory {str(path.parent)!r}"
                )
        return found


def run(command: str | Sequence[str], *, progress: Progress = None) -> dict[str, Any]:
    """Carry out a command with its options, as ``ilattice sdf`` does.

    Parameters
    ----------
    command : str or sequence of str
        Solids, operations, and options: ``-s`` spacing, one number or three; ``-o`` file; ``--tol``
        chord error in place of a spacing; ``--report`` file; ``--slices`` thickness of layers,
        written in place of a mesh; ``--set name=a,b,..`` values that a name stands for, several
        times for all combinations; ``--table`` file for their results; ``--memory`` gigabytes;
        ``--remove-islands``; ``--strict``; ``--dry-run``.
    progress : bool or callable, optional
        See `ilattice._progress.track`.

    Returns
    -------
    dict
        The report: plain data. Of a dry run `tree`, box, grid and cost; of a sweep its `rows`.

    Raises
    ------
    InputError, FormatError, GeometryError
        For words, files and solids that cannot be used.
    """
    found = Command.read(command)
    settings = Settings.of(found)
    words = [t.text for item in found.items for t in (item.token, *item.operands.values())]
    if settings.dry_run:
        report = _described(found, settings)
    elif settings.sweep:
        report = _swept(found, settings, words, progress)
    else:
        report = _meshed(found, settings, settings.output, {}, progress)
    if settings.report and not settings.dry_run:
        report = {"command": words, **report}
        write_report(settings.report, report)
    return report


def _meshed(
    command: Command,
    settings: Settings,
    output: Path,
    values: Mapping[str, str],
    progress: Progress,
) -> dict[str, Any]:
    """Mesh, measure and write one solid."""
    stages = Stages()
    with stages("solid"):
        solid = command.solid(values, strict=settings.strict)
    with stages("mesh"):
        found = mesh(
            solid, settings.spacing, tol=settings.tol, memory=settings.memory, progress=progress
        )
        if settings.remove_islands:
            found = found.remove_islands()
    full = bool(settings.report or settings.sweep or settings.remove_islands)
    with stages("measure"):
        report = found.measures() | islands_of(found) if full else found.sizes()
    with stages("write"):
        if settings.slices is None:
            found.save(output)
        else:
            found.slices(thickness=settings.slices).save(output)
    return {**report, "stages": stages.records, "files": [str(output)]}


def _described(command: Command, settings: Settings) -> dict[str, Any]:
    """What a run would do; of a sweep, what its first run would."""
    first = {name: values[0] for name, values in settings.sweep.items()}
    solid = command.solid(first, strict=settings.strict)
    found: Plan = plan(solid, settings.spacing, memory=1e9)
    return {
        "runs": math.prod(map(len, settings.sweep.values())),
        "tree": command.tree(),
        "box": found.box.tolist(),
        "grid": list(found.shape),
        "spacing": found.spacing.tolist(),
        "triangles": found.triangles(),
        "gigabytes": round(found.memory(), 3),
        "instructions": len(solid.program.code),
    }


# ---------------------------------------------------------------------------- sweeps


def _swept(
    command: Command, settings: Settings, words: list[str], progress: Progress
) -> dict[str, Any]:
    """One run for every combination of values; the rows of the table."""
    names = list(settings.sweep)
    combinations = list(product(*settings.sweep.values()))
    if len(combinations) > MOST_RUNS:
        raise InputError(f"--set makes {len(combinations)} runs; at most {MOST_RUNS} are allowed")
    known = _known(settings.table, names, " ".join(words) + _how(settings))
    rows: list[dict[str, Any]] = []
    for combination in track(combinations, "sweep", progress):
        values = dict(zip(names, combination, strict=True))
        row = known.get(combination)
        if row is None:
            row = _row(command, settings, values)
            row["command"] = " ".join(words) + _how(settings)
        rows.append(row)
        _write_table(settings.table, names, rows)
    return {"rows": rows, "files": [str(settings.table), *(r["file"] for r in rows if r["file"])]}


def _row(command: Command, settings: Settings, values: dict[str, str]) -> dict[str, Any]:
    tag = re.sub(r"[^\w.+=-]", "~", "_".join(f"{name}={value}" for name, value in values.items()))
    output = settings.output.with_stem(f"{settings.output.stem}_{tag}")
    try:
        found = _meshed(command, settings, output, values, None)
    except IlatticeError as e:
        return {**values, "file": "", "message": " ".join(str(e).split())}
    return {**values, "file": str(output), "message": "", **{k: found[k] for k in MEASURES}}


def _how(settings: Settings) -> str:
    """The options that change results, as text."""
    spacing = (
        "" if settings.spacing is None else f" -s {','.join(map(repr, settings.spacing.tolist()))}"
    )
    tol = "" if settings.tol is None else f" --tol {settings.tol!r}"
    kept = " --remove-islands" if settings.remove_islands else ""
    return (
        spacing + tol + kept + ("" if settings.slices is None else f" --slices {settings.slices!r}")
    )


def _known(table: Path, names: list[str], command: str) -> dict[tuple[str, ...], dict[str, Any]]:
    """Rows of an earlier run that are still right."""
    if not table.is_file():
        return {}
    try:
        with table.open(encoding="utf-8", newline="") as file:
            rows = list(csv.DictReader(file))
    except (OSError, ValueError, csv.Error) as e:
        raise FormatError(f"table {str(table)!r} cannot be read: {e}; remove it") from e
    right = [r for r in rows if r.get("command") == command and all(n in r for n in names)]
    return {tuple(r[n] for n in names): r for r in right if r["file"] and os.path.isfile(r["file"])}


def _write_table(table: Path, names: list[str], rows: list[dict[str, Any]]) -> None:
    columns = [*names, *MEASURES, "file", "message", "command"]
    text = io.StringIO()
    writer = csv.DictWriter(text, columns, restval="", extrasaction="ignore", lineterminator="\n")
    writer.writeheader()
    writer.writerows(rows)
    with atomic_write(table, text=True) as file:
        file.write(text.getvalue())


# ---------------------------------------------------------------------------- options


def _spacing(tokens: Sequence[Token]) -> FloatArray | None:
    if not tokens:
        return None
    token = tokens[0]
    try:
        values = np.array([fields.constant(part) for part in token.text.split(",")])
    except InputError as e:
        raise InputError(f"-s at {token}: {e}") from e
    if len(values) not in (1, 3) or (values <= 0).any():
        raise InputError(f"-s at {token}: must be one number above zero, or three")
    return np.array(np.broadcast_to(values, 3))


def _number(options: Mapping[str, tuple[Token, ...]], name: str) -> float | None:
    if name not in options:
        return None
    token = options[name][0]
    try:
        value = fields.constant(token.text)
    except InputError as e:
        raise InputError(f"{name} at {token}: {e}") from e
    if value <= 0:
        raise InputError(f"{name} at {token}: must be above zero")
    return value


def _path(options: Mapping[str, tuple[Token, ...]], name: str) -> Path | None:
    return Path(options[name][0].text) if name in options else None


def _sweep(tokens: Sequence[Token]) -> dict[str, tuple[str, ...]]:
    sweep: dict[str, tuple[str, ...]] = {}
    for token in tokens:
        name, _, values = token.text.partition("=")
        if not values or not is_free(name) or name in sweep:
            raise InputError(
                f"--set at {token}: must be name=value,value,.. with a name of its own that has "
                "no meaning yet"
            )
        sweep[name] = tuple(v.strip() for v in values.split(","))
    return sweep
