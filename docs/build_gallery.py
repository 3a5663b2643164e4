"""One page of all examples: what each shows, its pictures, its numbers, and how long it took.

    python docs/build_gallery.py [FOLDER] [EXAMPLE ...]

Every example runs as a program of its own in a folder under FOLDER (by default ``build/gallery``);
``FOLDER/index.html`` shows what it says, prints and draws. While it runs, a table of times is
printed: from the start of a program until its last mesh is on disk, and until its pictures are,
too. An example that fails is on the page with its message, the others run all the same, and the
exit code is 1.

`markdown` and `example` make pages of the documentation from the docstrings, with the small
pictures of ``docs/images`` and without running anything.
"""

import ast
import html
import os
import re
import subprocess
import sys
import time
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

EXAMPLES = Path(__file__).parents[1] / "examples"
THUMBNAILS = Path(__file__).parent / "images"
FIGURES = "Figures of Hong, Antolin, Elber and Kim"
OTHERS = "Figures of other papers"
RECIPES = "Recipes"
MESHES = (".vtp", ".stl", ".ply", ".3mf", ".vtu")
STYLE = """
body { font: 16px/1.5 sans-serif; max-width: 60em; margin: 2em auto; padding: 0 1em; color: #222; }
img { max-width: 100%; border: 1px solid #ddd; margin: 0.3em 0; }
pre { background: #f4f4f4; padding: 0.6em; overflow-x: auto; }
.failed { color: #b00020; font-weight: bold; }
"""


@dataclass(frozen=True)
class Entry:
    """One example on the page.

    Attributes
    ----------
    name : str
        Name of the file, without its ending.
    title, text : str
        First line and the rest of its docstring.
    printed : str
        What it printed.
    pictures : tuple of str
        Paths of its pictures, relative to the page.
    meshed, seconds : float
        Time until the last mesh was on disk, and until it ended; 0 if it was not run.
    failed : str
        What it wrote to standard error, if it failed.
    """

    name: str
    title: str
    text: str
    printed: str = ""
    pictures: tuple[str, ...] = ()
    meshed: float = 0.0
    seconds: float = 0.0
    failed: str = ""

    @property
    def group(self) -> str:
        """Where it is listed."""
        if not re.match(r"Figures? \d", self.title):
            return RECIPES
        return FIGURES if "Hong, Antolin" in self.title else OTHERS


def names() -> list[str]:
    """All examples, sorted."""
    return sorted(path.stem for path in EXAMPLES.glob("*.py"))


def described(name: str) -> Entry:
    """An example by its docstring, not run."""
    source = (EXAMPLES / f"{name}.py").read_text(encoding="utf-8")
    title, _, text = (ast.get_docstring(ast.parse(source)) or "").partition("\n")
    return Entry(name, title, text.split(f"    python examples/{name}.py")[0].strip())


def run(name: str, folder: Path) -> Entry:
    """An example, run in a folder of its own; if it fails, with what it wrote until then."""
    inside = folder / name
    inside.mkdir(parents=True, exist_ok=True)
    path = os.pathsep.join([str(EXAMPLES.parent), os.environ.get("PYTHONPATH", "")])
    start = time.time()
    done = subprocess.run(
        [sys.executable, str(EXAMPLES / f"{name}.py")], cwd=inside, capture_output=True, text=True,
        check=False, env=os.environ | {"PYTHONPATH": path},
    )  # fmt: skip
    seconds = time.time() - start
    failed = done.stderr.strip() or f"exit code {done.returncode}" if done.returncode else ""
    written = sorted(inside.iterdir())
    meshes = [p.stat().st_mtime - start for p in written if p.suffix in MESHES]
    pictures = tuple(f"{name}/{p.name}" for p in written if p.suffix in (".png", ".svg"))
    entry = described(name)
    return Entry(
        name, entry.title, entry.text, done.stdout.strip(), pictures, max(meshes, default=0.0),
        seconds, failed,
    )  # fmt: skip


def grouped(entries: Iterable[Entry]) -> dict[str, list[Entry]]:
    """Figures in the order of their numbers, then recipes; groups that are empty are left out."""
    found: dict[str, list[Entry]] = {FIGURES: [], OTHERS: [], RECIPES: []}
    for entry in entries:
        found[entry.group].append(entry)
    return {title: group for title, group in found.items() if group}


def page(entries: Iterable[Entry]) -> str:
    """The page of all that was run, in HTML."""
    groups = grouped(entries)
    parts = [
        "<!DOCTYPE html>", "<html lang='en'><head><meta charset='utf-8'>",
        f"<title>ilattice: gallery</title><style>{STYLE}</style></head><body>", "<h1>Gallery</h1>",
        "<p>Every example of <code>examples/</code>: one file is one figure or one recipe, with "
        "numbers that a test checks.</p>",
    ]  # fmt: skip
    for title, group in groups.items():
        listed = (f"<li><a href='#{e.name}'>{html.escape(e.title)}</a></li>" for e in group)
        parts += [f"<h3>{title}</h3>", "<ul>", *listed, "</ul>"]
    for group in groups.values():
        for entry in group:
            parts += shown(entry)
    return "\n".join([*parts, "</body></html>", ""])


def shown(e: Entry) -> list[str]:
    """An example on the page of all that was run, in lines of HTML."""
    parts = [f"<h2 id='{e.name}'>{html.escape(e.title)}</h2>"]
    parts += [f"<p>{html.escape(p)}</p>" for p in e.text.split("\n\n") if p]
    parts += [f"<img src='{p}' alt='{Path(p).stem}' loading='lazy'>" for p in e.pictures]
    if e.printed:
        parts.append(f"<pre>{html.escape(e.printed)}</pre>")
    if e.failed:
        parts.append(f"<p class='failed'>failed:</p><pre>{html.escape(e.failed)}</pre>")
    took = f", {e.seconds:.1f} s" if e.seconds else ""
    parts.append(f"<p><code>python examples/{e.name}.py</code>{took}</p>")
    source = (EXAMPLES / f"{e.name}.py").read_text(encoding="utf-8")
    parts.append(f"<details><summary>Source</summary><pre>{html.escape(source)}</pre></details>")
    return parts


def markdown() -> str:
    """The page of the documentation that leads to all examples, in MyST."""
    parts = [
        "# Gallery\n\nEvery file of `examples/` is one figure or one recipe, and prints a number "
        "that a test checks. Pictures are small here, and some of smaller parts than the program "
        "makes; `python docs/build_gallery.py` makes all of them, large, on a page.\n\n"
        "```{contents}\n:local:\n:depth: 1\n:backlinks: none\n```\n\n"
        "```{toctree}\n:hidden:\n:glob:\n\nexamples/*\n```\n"
    ]
    for title, group in grouped(map(described, names())).items():
        parts.append(f"## {title}\n\n::::{{container}} pictures\n")
        for e in group:
            picture = f"[{thumbnail(e, '..')}](examples/{e.name}.md)\n\n"
            link = f"[{e.title.rstrip('.')}](examples/{e.name}.md)"
            parts.append(f":::{{container}} picture\n{picture}{link}\n:::\n")
        parts.append("::::\n")
    return "\n".join(parts)


def example(name: str) -> str:
    """The page of one example in the documentation: picture, docstring and source."""
    e = described(name)
    return (
        f"# {e.title.rstrip('.')}\n\n{thumbnail(e, '../..')}\n\n{e.text}\n\n"
        f"```sh\npython examples/{name}.py\n```\n\n{{download}}`Download the source "
        f"<{EXAMPLES.name}/{name}.py>`\n\n".replace("<examples/", "<../../../examples/")
        + f"```{{literalinclude}} ../../../examples/{name}.py\n:language: python\n```\n"
    )


def thumbnail(e: Entry, up: str) -> str:
    """The small picture of an example; its name where there is none."""
    if not (THUMBNAILS / f"{e.name}.jpg").is_file():
        return f"`{e.name}`"
    return f"![{e.title.rstrip('.')}]({up}/images/{e.name}.jpg)"


def main(words: list[str]) -> int:
    """Run the examples, print the times, write the page; return 1 if one failed."""
    folder = Path(words[0]) if words else Path("build/gallery")
    entries = []
    for name in words[1:] or names():
        entries.append(run(name, folder))
        e = entries[-1]
        print(f"{name:20s} {e.meshed:7.1f} s {e.seconds:7.1f} s", flush=True)
        if e.failed:
            print(f"{name} failed:\n{e.failed}", file=sys.stderr, flush=True)
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "index.html").write_text(page(entries), encoding="utf-8")
    print(f"wrote {folder / 'index.html'}")
    return int(any(e.failed for e in entries))


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
