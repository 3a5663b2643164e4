"""A command with its options, carried out: files and a report.

Guarantees: the same command writes the same bytes of meshes and tables; what is wrong with the
words is found before anything is meshed or written. A sweep that was interrupted goes on where it
stopped, and ends with the same table (`ilattice.io.table`): runs are left out as long as the
command, its input files, the library and the file that was written are the same.
"""

import math
import os
import re
import shlex
from ast import literal_eval
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np

from ilattice import fields
from ilattice._files import as_path, check_distinct, check_outputs, write_report
from ilattice._progress import Progress, track
from ilattice._shown import Shown
from ilattice._stages import Stages
from ilattice._typing import FloatArray
from ilattice._version import __version__
from ilattice.errors import FormatError, IlatticeError, InputError
from ilattice.io.registry import WRITERS
from ilattice.io.table import KEPT, Table, digest
from ilattice.mesh.regions import islands_of
from ilattice.sdf._tokens import Token
from ilattice.sdf._vocabulary import key
from ilattice.sdf.language import Command, is_free
from ilattice.sdf.meshing import MEMORY, Plan, mesh, planned

__all__ = ["run"]

OUTPUT = "out.ply"
#: Runs of a sweep at most.
MAX_RUNS = 100_000
LONGEST_NAME = 240  # bytes of the name of a file
MEASURES = (
    "volume", "area", "genus", "components", "islands", "watertight", "vertices", "faces"
)  # fmt: skip


@dataclass(frozen=True)
class Settings(Shown):
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
    allow_loss: bool
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
            "--allow-loss" in options,
            _sweep(options.get("--set", ())),
        )
        if "--table" in options and not found.sweep:
            raise InputError("--table is for the rows of a sweep: give --set as well")
        if found.spacing is not None and found.tol is not None:
            raise InputError("give either -s, a spacing, or --tol, a tolerance")
        kind = "mesh" if found.slices is None else "slices"
        if output.suffix.lower() not in WRITERS[kind]:
            known = ", ".join(sorted(WRITERS[kind]))
            raise FormatError(f"output {str(output)!r} has none of the endings {known}")
        files = {"-o": [output]}
        if found.report is not None:
            files["--report"] = [found.report]
        if found.sweep:
            files["--table"] = [found.table]
        check_outputs([path for paths in files.values() for path in paths])
        check_distinct(files)
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
        ``--remove-islands``; ``--allow-loss``; ``--strict``; ``--dry-run``.
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
    read = _real([*found.files({}), *found.sources])
    if settings.report:
        check_distinct({"--report": [settings.report], "input": read})
    if settings.dry_run:
        report = _described(found, settings)
    elif settings.sweep:
        report = _swept(found, settings, words, progress)
    else:
        check_distinct({"-o": [settings.output], "input": read})
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
            solid, settings.spacing, tol=settings.tol, memory=settings.memory,
            allow_loss=settings.allow_loss, progress=progress,
        )  # fmt: skip
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
    found: Plan = planned(solid, settings.spacing)
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
    runs = _runs(command, settings)
    told = " ".join([shlex.join(words), *_how(settings)])
    digests = _Digests()
    rows: list[dict[str, Any]] = []
    with Table(settings.table, list(settings.sweep), MEASURES) as table:
        table.check_files({str(path): values for path, values in runs.items()}, told)
        for output, values in track(list(runs.items()), "sweep", progress):
            inputs = digests(command.files(values))
            known = table.find(str(output), values, told, inputs, __version__)
            if known:
                row = _typed(known) | {"file": str(output)}
            else:
                with table.aside(output) as made:
                    found = _row(command, settings, output, made, values)
                    row = found | {"command": told, "inputs": inputs, "version": __version__}
                    row = table.add(row, made)
            rows.append({name: row[name] for name in table.columns if name in row})
    return {"rows": rows, "files": [str(settings.table), *(r["file"] for r in rows if r["file"])]}


def _runs(command: Command, settings: Settings) -> dict[Path, dict[str, str]]:
    """The values of every run by the file it writes; refused if two would write the same one."""
    count = math.prod(map(len, settings.sweep.values()))
    if count > MAX_RUNS:
        raise InputError(f"--set makes {count} runs; at most {MAX_RUNS} are allowed")
    command.check_used(settings.sweep)
    runs: dict[Path, dict[str, str]] = {}
    inputs = set(command.sources)
    for combination in product(*settings.sweep.values()):
        values = dict(zip(settings.sweep, combination, strict=True))
        told = "_".join(f"{name}={value}" for name, value in values.items())
        tag = re.sub(r"[^\w.+=-]", "~", told)
        output = settings.output.with_stem(f"{settings.output.stem}_{tag}")
        if len(os.fsencode(output.name)) > LONGEST_NAME:
            raise InputError(f"--set: the name of a file, {output.name!r:.80}, would be too long")
        if output in runs:
            before = "_".join(f"{name}={value}" for name, value in runs[output].items())
            raise InputError(
                f"--set: {before!r:.80} and {told!r:.80} would both write {str(output)!r:.80}; "
                "leave one of them out, or write it with other letters"
            )
        runs[output] = values
        inputs.update(command.files(values))
    check_distinct({"-o": list(runs), "--table": [settings.table], "input": _real(inputs)})
    if settings.report:
        check_distinct({"--report": [settings.report], "-o": list(runs)})
    return runs


def _real(paths: Iterable[str]) -> list[str]:
    """Files behind paths, each once."""
    return sorted({os.path.realpath(path) for path in paths})


def _row(
    command: Command, settings: Settings, output: Path, made: Path, values: dict[str, str]
) -> dict[str, Any]:
    """The row of one run, which writes `made`, and is to become `output`."""
    try:
        found = _meshed(command, settings, made, values, None)
    except IlatticeError as e:
        told = str(e).replace(str(made), str(output))
        return {**values, "file": "", "message": told}
    return {**values, "file": str(output), "message": "", **{k: found[k] for k in MEASURES}}


def _typed(row: Mapping[str, str]) -> dict[str, Any]:
    """A row of the table, its measures as `_row` has them."""
    return {k: _value(v) if k in MEASURES else v for k, v in row.items()}


def _value(text: str) -> Any:
    """A number or a flag; what somebody has written by hand stays text."""
    try:
        return literal_eval(text)
    except (ValueError, SyntaxError):
        return text


class _Digests:
    """Digests of input files, taken again when a file has changed."""

    def __init__(self) -> None:
        self._known: dict[str, tuple[Any, str]] = {}

    def __call__(self, paths: Sequence[str]) -> str:
        return "-".join(self._one(path) for path in paths)

    def _one(self, path: str) -> str:
        try:
            found = os.stat(path)
        except OSError:
            return "none"  # the run says so
        state = (found.st_dev, found.st_ino, found.st_size, found.st_mtime_ns, found.st_ctime_ns)
        if path not in self._known or self._known[path][0] != state:
            self._known[path] = (state, _readable(path))
        return self._known[path][1]


def _readable(path: str) -> str:
    """Digest of a file; of one that cannot be read the run says so."""
    try:
        return digest(path)
    except FormatError:
        return "none"


def _how(settings: Settings) -> list[str]:
    """The options that change results, as text."""
    parts = []
    if settings.spacing is not None:
        parts.append(f"-s {','.join(map(repr, settings.spacing.tolist()))}")
    if settings.tol is not None:
        parts.append(f"--tol {settings.tol!r}")
    if settings.slices is not None:
        parts.append(f"--slices {settings.slices!r}")
    parts += ["--remove-islands"] * settings.remove_islands
    parts += ["--allow-loss"] * settings.allow_loss
    return parts + ["--strict"] * settings.strict


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
    return as_path(name, options[name][0].text) if name in options else None


def _sweep(tokens: Sequence[Token]) -> dict[str, tuple[str, ...]]:
    sweep: dict[str, tuple[str, ...]] = {}
    for token in tokens:
        name, _, values = token.text.partition("=")
        if not values or not is_free(name) or name in sweep:
            raise InputError(
                f"--set at {token}: must be name=value,value,.. with a name of its own that has "
                "no meaning yet"
            )
        if name in (*MEASURES, *KEPT):
            raise InputError(f"--set at {token}: {name!r} is a column of the table; rename it")
        if key(name) in map(key, sweep):
            raise InputError(
                f"--set at {token}: capitals are the same as small letters, and there is a name "
                "like this one; rename it"
            )
        sweep[name] = tuple(v.strip() for v in values.split(","))
        if not all(sweep[name]):
            raise InputError(f"--set at {token}: there is nothing between two commas; give a value")
    return sweep
