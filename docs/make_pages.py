"""Pages of the documentation that follow from the package: reference, commands, formats, gallery.

`write` makes them anew before every build of the documentation; the result is not kept in git.
"""

import ast
import contextlib
import importlib
import inspect
import io
import json
import re
import shutil
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import build_gallery

import ilattice as il
from ilattice import cli
from ilattice.io import registry

HERE = Path(__file__).parent
sys.path.append(str(HERE.parent))

from benchmarks.measure import Row  # noqa: E402

#: Rooms of the package, in the order of its docstring.
ROOMS = tuple(re.findall(r"^`([a-z]+)` ", str(il.__doc__), re.MULTILINE)[:-1])
#: Pages behind the others, of those that there are.
BACKGROUND = ("theory", "equations", "words", "architecture", "how_to")
#: What formats are for, by their endings.
MEANINGS = {
    ".stl": "triangles for slicers, binary or text when read; written in single precision",
    ".ply": "triangles with data at the vertices, binary",
    ".obj": "triangles as text",
    ".off": "triangles as text",
    ".3mf": 'what slicers read best; needs `pip install "ilattice[print]"`',
    ".vtp": "triangles with all data, for ParaView",
    ".vtu": "for ParaView: volumes as Bézier cells, analyses as surfaces or solids",
    ".inp": "decks for CalculiX and Abaqus: elements, sets, and a static analysis of them",
    ".png": "a picture",
    ".xml": "volumes of G+Smo",
    ".mesh": "volumes of MFEM",
    ".itd": "volumes of IRIT",
    ".npz": "arrays of NumPy: knots, coefficients, weights",
    ".json": "the same as text",
    ".cli": "layers in the Common Layer Interface",
    ".svg": "layers as a drawing",
}


def write(folder: Path) -> None:
    """Write all pages into a folder, from which older ones vanish."""
    shutil.rmtree(folder, ignore_errors=True)
    for name, text in pages():
        path = folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text, encoding="utf-8")


def pages() -> Iterator[tuple[str, str]]:
    """Names of files and their text."""
    yield "parts/background.md", background()
    yield "parts/benchmarks.md", benchmarks()
    yield "parts/formats.md", formats()
    yield "parts/commands.md", commands()
    yield "gallery.md", build_gallery.markdown()
    for name in build_gallery.names():
        yield f"examples/{name}.md", build_gallery.example(name)
    yield "api/index.md", contents()
    for room in [*ROOMS, "errors"]:
        yield f"api/{room}.rst", reference(room)


def background() -> str:
    """Table of contents of the pages behind the others."""
    there = [name for name in BACKGROUND if (HERE / f"{name}.md").is_file()]
    return "\n".join(
        ["```{toctree}", ":maxdepth: 1", ":caption: Background", "", *there, "```", ""]
    )


def benchmarks() -> str:
    """Tables of what was measured, module by module, under the first lines of their docstrings."""
    known = json.loads((HERE / "benchmarks.json").read_text(encoding="utf-8"))
    lines = []
    for path in sorted((HERE.parent / "benchmarks").glob("bench_*.py")):
        said = str(ast.get_docstring(ast.parse(path.read_text(encoding="utf-8"))))
        name = path.stem.removeprefix("bench_")
        lines += [f"### `{name}`", "", said.splitlines()[0], ""]
        if name not in known:
            lines += ["Not measured yet.", ""]
            continue
        found = known[name]
        sizes = "small sizes (`--quick`)" if found["quick"] else "full sizes"
        where = ", ".join(found[k] for k in ("machine", "cores", "threads", "version", "load"))
        lines += [
            "| benchmark | ours | reference | ratio | goal | met |",
            "|---|---|---|---|---|---|",
        ]
        for row in found["rows"]:
            made = Row(**row)
            cells = (made.name, made.ours, made.reference, f"{made.value:.3g}", made.goal, made.met)
            lines.append("| " + " | ".join(cell.replace("|", "\\|") for cell in cells) + " |")
        lines += ["", f"With {sizes}, on {where}.", ""]
    return "\n".join(lines)


# --- file formats and commands ------------------------------------------------------------------


def formats() -> str:
    """Tables of what is written and read, from the registry of formats."""
    lines = ["## Written", "", "| what | ending | for |", "|---|---|---|"]
    for name, kind in sorted(saved().items()):
        for ending in sorted(registry.WRITERS[kind]):
            meaning = "layers of a print" if (kind, ending) == ("slices", ".3mf") else ""
            lines.append(f"| `{name}` | `{ending}` | {meaning or MEANINGS[ending]} |")
    lines += ["", "## Read as meshes", "", "| ending | for |", "|---|---|"]
    lines += [f"| `{ending}` | {MEANINGS[ending]} |" for ending in sorted(registry.READERS)]
    return "\n".join([*lines, ""])


def saved() -> dict[str, str]:
    """Names of public classes that declare their kind for files, and that kind."""
    classes = (getattr(getattr(il, r), name) for r in ROOMS for name in exported(r))
    kinds = {c.__name__: vars(c).get("file_kind") for c in classes if inspect.isclass(c)}
    return {name: kind for name, kind in kinds.items() if kind}


def commands() -> str:
    """Help of all commands, as they print it themselves."""
    names = [name for name in cli._app() if not name.startswith("-")]
    told = {"`ilattice`": said("--help")}
    told |= {f"`ilattice {name}`": said(name, "--help") for name in names}
    told["The catalogue of tiles"] = said("tiles")
    return "\n".join(f"## {title}\n\n```text\n{text}\n```\n" for title, text in told.items())


def said(*words: str) -> str:
    """What a command prints."""
    with contextlib.redirect_stdout(io.StringIO()) as out:
        cli.main(words)
    return "\n".join(line.rstrip() for line in out.getvalue().strip("\n").splitlines())


# --- reference ----------------------------------------------------------------------------------


def homes() -> dict[str, str]:
    """Name of what is public -> the module in which it is documented."""
    found: dict[str, str] = {}
    for room in ROOMS:
        for name, home in members(room):
            if home == f"ilattice.{room}":
                found.setdefault(name, home)
    return found | dict.fromkeys(exported("errors"), "ilattice.errors")


def exported(room: str) -> list[str]:
    """Names that a room exports; of errors all classes."""
    module = importlib.import_module(f"ilattice.{room}")
    classes = (name for name, item in vars(module).items() if inspect.isclass(item))
    return sorted(getattr(module, "__all__", classes), key=str.lower)


def members(room: str) -> Iterator[tuple[str, str]]:
    """What a room exports, and the module in which each is documented."""
    module = importlib.import_module(f"ilattice.{room}")
    for name in exported(room):
        origin = str(getattr(getattr(module, name), "__module__", "")).split(".")
        home = origin[1] if len(origin) > 1 and origin[1] in ROOMS else room
        yield name, f"ilattice.{home if name in exported(home) else room}"


def contents() -> str:
    """The first page of the reference."""
    names = "\n".join([*ROOMS, "errors"])
    return (
        "# Reference\n\nEverything public, by rooms from the bottom up. `import ilattice as il` "
        "loads none of them: each is loaded when it is first used.\n\n"
        f"```{{toctree}}\n:maxdepth: 1\n\n{names}\n```\n"
    )


def reference(room: str) -> str:
    """All that a room exports, in reStructuredText."""
    title = f"ilattice.{room}"
    own = [name for name, home in members(room) if home == title]
    others = [(name, home) for name, home in members(room) if home != title]
    module = importlib.import_module(title)
    lines = [title, "=" * len(title), "", f".. automodule:: {title}", "   :no-members:", ""]
    if own:
        lines += ["Overview", "--------", "", ".. autosummary::", ""]
        lines += [f"   {name}" for name in own] + [""]
    if others:
        links = ", ".join(f":py:obj:`{name} <{home}.{name}>`" for name, home in others)
        lines += [f"Also here: {links}.", ""]
    for title, kind in (("Classes", "class"), ("Functions", "function"), ("Others", "data")):
        chosen = [name for name in own if kind_of(getattr(module, name)) == kind]
        lines += [title, "-" * len(title), ""] if chosen else []
        for name in chosen:
            lines.append(f".. auto{kind}:: {name}")
            lines += members_of(getattr(module, name)) if kind == "class" else [""]
    return "\n".join(lines)


def members_of(item: type) -> list[str]:
    """Options for the members of a class, with those of classes in private modules of its room."""
    private = ".".join(item.__module__.split(".")[:2]) + "._"
    others = [base.__name__ for base in item.__mro__[1:] if not base.__module__.startswith(private)]
    inherits = len(others) < len(item.__mro__) - 1
    return ["   :members:", *[f"   :inherited-members: {', '.join(others)}"] * inherits, ""]


def kind_of(item: Any) -> str:
    """The directive of autodoc that documents it, without ``auto``."""
    if inspect.isclass(item):
        return "class"
    return "function" if callable(item) else "data"


def escaped(lines: list[str]) -> list[str]:
    """A docstring whose ``|d|`` are absolute values, but for blocks that are literal."""
    result, literal = [], None
    for line in lines:
        indent = len(line) - len(line.lstrip())
        if literal is not None and line.strip() and indent <= literal:
            literal = None
        if literal is None and not line.lstrip().startswith((">>>", "...")):
            parts = line.split("``")
            parts[::2] = [part.replace("|", "\\|") for part in parts[::2]]
            line = "``".join(parts)
            if line.rstrip().endswith("::"):
                literal = indent
        result.append(line)
    return result
