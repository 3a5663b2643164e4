"""One page of all examples: what each shows, its pictures, its numbers, and how long it took.

    python docs/build_gallery.py [FOLDER] [EXAMPLE ...]

Every example runs as a program of its own in a folder under FOLDER (by default ``build/gallery``);
``FOLDER/index.html`` shows what it says, prints and draws. At the end a table of times is printed:
from the start of the program until its last mesh is on disk, and until its pictures are, too.
"""

import ast
import html
import os
import subprocess
import sys
import time
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

EXAMPLES = Path(__file__).parents[1] / "examples"
MESHES = (".vtp", ".stl", ".ply", ".3mf", ".vtu")
STYLE = """
body { font: 16px/1.5 sans-serif; max-width: 60em; margin: 2em auto; padding: 0 1em; color: #222; }
img { max-width: 100%; border: 1px solid #ddd; margin: 0.3em 0; }
pre { background: #f4f4f4; padding: 0.6em; overflow-x: auto; }
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
    """

    name: str
    title: str
    text: str
    printed: str = ""
    pictures: tuple[str, ...] = ()
    meshed: float = 0.0
    seconds: float = 0.0


def names() -> list[str]:
    """All examples, sorted."""
    return sorted(path.stem for path in EXAMPLES.glob("*.py"))


def described(name: str) -> Entry:
    """An example by its docstring, not run."""
    source = (EXAMPLES / f"{name}.py").read_text(encoding="utf-8")
    title, _, text = (ast.get_docstring(ast.parse(source)) or "").partition("\n")
    return Entry(name, title, text.split(f"    python examples/{name}.py")[0].strip())


def run(name: str, folder: Path) -> Entry:
    """An example, run in a folder of its own.

    Raises
    ------
    RuntimeError
        If it fails.
    """
    inside = folder / name
    inside.mkdir(parents=True, exist_ok=True)
    path = os.pathsep.join([str(EXAMPLES.parent), os.environ.get("PYTHONPATH", "")])
    start = time.time()
    done = subprocess.run(
        [sys.executable, str(EXAMPLES / f"{name}.py")], cwd=inside, capture_output=True, text=True,
        check=False, env=os.environ | {"PYTHONPATH": path},
    )  # fmt: skip
    seconds = time.time() - start
    if done.returncode:
        raise RuntimeError(f"{name} failed:\n{done.stderr}")
    written = sorted(inside.iterdir())
    meshes = [p.stat().st_mtime - start for p in written if p.suffix in MESHES]
    pictures = tuple(f"{name}/{p.name}" for p in written if p.suffix in (".png", ".svg"))
    entry = described(name)
    return Entry(
        name, entry.title, entry.text, done.stdout.strip(), pictures, max(meshes, default=0.0),
        seconds,
    )  # fmt: skip


def page(entries: Iterable[Entry]) -> str:
    """The page, in HTML."""
    parts = [
        "<!DOCTYPE html>", "<html lang='en'><head><meta charset='utf-8'>",
        f"<title>ilattice: gallery</title><style>{STYLE}</style></head><body>", "<h1>Gallery</h1>",
        "<p>Every example of <code>examples/</code>: one file is one figure or one recipe, with "
        "numbers that a test checks.</p>",
    ]  # fmt: skip
    for e in entries:
        parts.append(f"<h2 id='{e.name}'>{html.escape(e.title)}</h2>")
        parts += [f"<p>{html.escape(p)}</p>" for p in e.text.split("\n\n") if p]
        parts += [f"<img src='{p}' alt='{Path(p).stem}' loading='lazy'>" for p in e.pictures]
        if e.printed:
            parts.append(f"<pre>{html.escape(e.printed)}</pre>")
        took = f", {e.seconds:.1f} s" if e.seconds else ""
        parts.append(f"<p><code>python examples/{e.name}.py</code>{took}</p>")
    return "\n".join([*parts, "</body></html>", ""])


def main(words: list[str]) -> None:
    """Run the examples, write the page, print the times."""
    folder = Path(words[0]) if words else Path("build/gallery")
    entries = []
    for name in words[1:] or names():
        entries.append(run(name, folder))
        print(f"{name:20s} {entries[-1].meshed:7.1f} s {entries[-1].seconds:7.1f} s", flush=True)
    (folder / "index.html").write_text(page(entries), encoding="utf-8")
    print(f"wrote {folder / 'index.html'}")


if __name__ == "__main__":
    main(sys.argv[1:])
