"""The documentation does what it says: its programs run, and what it names is there."""

import contextlib
import importlib.util
import inspect
import io
import json
import re
import sys
from pathlib import Path

import pytest
from matplotlib import pyplot

import ilattice as il
from ilattice import errors
from ilattice.io import registry

DOCS = Path(__file__).parents[1] / "docs"
PAGES = {
    str(path.relative_to(DOCS)): path.read_text(encoding="utf-8")
    for path in sorted([*DOCS.glob("*.md"), *DOCS.glob("guide/*.md")])
}
#: Pages whose programs are those of a test of their own.
ELSEWHERE = {"how_to.md"}
#: A block of Python, with the line before it if that says that it is not to be run.
BLOCK = re.compile(r"(<!-- not run: .+ -->\n)?^```python\n(.*?)^```", re.DOTALL | re.MULTILINE)
NAMED = re.compile(r"`(?:ilattice|il)((?:\.[A-Za-z_]\w*)+)(?:\(|`)")
PRINTED = re.compile(r"^ *print\(.*\)  # (.*)$", re.MULTILINE)


def blocks(text):
    """Programs of a page that are to be run."""
    return [code for skipped, code in BLOCK.findall(text) if not skipped]


def load(name):
    spec = importlib.util.spec_from_file_location(name, DOCS / f"{name}.py")
    module = importlib.util.module_from_spec(spec)
    sys.modules[name] = module
    spec.loader.exec_module(module)
    return module


@pytest.fixture
def pages(monkeypatch):
    """The module that writes the generated pages."""
    monkeypatch.syspath_prepend(str(DOCS))
    yield load("make_pages")
    for name in ("make_pages", "build_gallery"):
        sys.modules.pop(name, None)


@pytest.mark.parametrize("name", [n for n in PAGES if n not in ELSEWHERE and blocks(PAGES[n])])
def test_programs_of_a_page_run_and_print_what_it_says(name, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    namespace = {}
    for code in blocks(PAGES[name]):
        with contextlib.redirect_stdout(io.StringIO()) as out:
            exec(compile(code, name, "exec"), namespace)
        assert out.getvalue().splitlines() == PRINTED.findall(code), code
    pyplot.close("all")


def test_everyday_jobs_are_short_and_shown():
    """At most twenty lines each, imports and all; a picture, and an example that is checked."""
    text = PAGES["guide/jobs.md"]
    programs = blocks(text)
    assert len(programs) == 8
    for code in programs:
        assert sum(bool(line.strip()) for line in code.splitlines()) <= 20
        assert "screenshot=" in code or ".save(" in code or "savefig" in code
    parts = re.split(r"^## ", text, flags=re.MULTILINE)[1:]
    for part in parts:
        assert re.search(r"!\[.+\]\(\.\./images/\w+\.jpg\)", part), part[:40]
        name = re.search(r"^In full: `(\w+)`", part, re.MULTILINE)[1]
        assert (DOCS.parent / "examples" / f"{name}.py").is_file()


def resolved(path):
    """What a dotted name of the package stands for; modules are imported, fields are None."""
    item = il
    for part in path[1:].split("."):
        if inspect.ismodule(item) and not hasattr(item, part):
            item = importlib.import_module(f"{item.__name__}.{part}")
        elif part in getattr(item, "__dataclass_fields__", {}):
            item = None
        else:
            item = getattr(item, part)
    return item


@pytest.mark.parametrize("name", PAGES)
def test_what_a_page_names_is_there(name):
    for path in NAMED.findall(PAGES[name]):
        resolved(path)


def test_names_that_are_not_there_are_found():
    assert resolved(".mesh.surface.SurfaceMesh") is il.SurfaceMesh
    for path in (".tiles.nothing", ".Nothing", ".SurfaceMesh.nothing"):
        with pytest.raises((ImportError, AttributeError)):
            resolved(path)


def test_blocks_are_found_and_some_are_skipped():
    text = "```python\na\n```\n\n<!-- not run: slow -->\n```python\nb\n```\n"
    assert blocks(text) == ["a\n"]
    assert NAMED.findall("`il.tiles.get` and `il.tiles.get(1)`, `il`") == [".tiles.get"] * 2
    assert PRINTED.findall("print(1)  # 1\nx  # 2\n") == ["1"]
    assert sum(len(blocks(text)) for text in PAGES.values()) > 30


def test_every_page_is_in_a_table_of_contents(pages):
    found = set()
    for name, text in [*PAGES.items(), ("index.md", pages.background())]:
        for block in re.findall(r"```\{toctree\}\n(.*?)```", text, re.DOTALL):
            found |= {str(Path(name).parent / f"{line}.md") for line in block.split()}
    assert PAGES.keys() - found == {"index.md"}


def test_every_error_is_explained():
    text = PAGES["errors.md"]
    for name, item in vars(errors).items():
        if isinstance(item, type) and issubclass(item, Exception | Warning):
            assert f"`{name}`" in text, name


def test_messages_are_those_of_the_package():
    sources = "".join(p.read_text(encoding="utf-8") for p in Path(il.__file__).parent.rglob("*.py"))
    joined = re.sub(r"\"\s*\n\s*f?\"", "", sources)
    told = re.findall(r"^\| `([^`]+)` \|", PAGES["errors.md"], re.MULTILINE)
    assert len(told) > 10
    for message in told:
        for part in re.split(r"\.\.\.|\bon=|\bh=|\btol=|\bu\b|\bh\b|\d+ [GM]B", message):
            words = part.strip(" ,;:.")
            assert words in joined, message


def test_the_table_of_benchmarks_has_all_of_them(pages):
    files = list((DOCS.parent / "benchmarks").glob("bench_*.py"))
    text = pages.benchmarks()
    assert len(re.findall(r"^### `\w+`$", text, re.MULTILINE)) == len(files) > 5
    known = json.loads((DOCS / "benchmarks.json").read_text(encoding="utf-8"))
    assert text.count("\n| ") == sum(len(found["rows"]) + 1 for found in known.values())
    for found in known.values():
        for row in found["rows"]:
            assert f"| {row['ours']} | {row['reference']} | {row['value']:.3g} |" in text


def test_the_table_of_formats_has_all_of_them(pages):
    table = pages.formats()
    assert table.count("\n| `SurfaceMesh` |") == len(registry.WRITERS["mesh"])
    assert sorted(pages.saved().values()) == sorted(registry.WRITERS)  # one class for each
    written, read = table.split("## Read as meshes")
    for endings, part in [
        *((e, written) for e in registry.WRITERS.values()),
        (registry.READERS, read),
    ]:
        for ending in endings:
            assert f"| `{ending}` |" in part


def test_all_commands_tell_their_help(pages):
    text = pages.commands()
    for name in ("build", "slice", "homogenize", "bands", "sdf", "demo", "info", "tiles", "warmup"):
        assert f"## `ilattice {name}`" in text
    assert "--thickness" in text
    assert "gyroid" in text


def test_everything_public_is_in_the_reference_once(pages):
    text = {room: pages.reference(room) for room in pages.ROOMS}
    assert {*text, "errors"} == {n for n in il.__all__ if not n[0].isupper()}
    documented = re.findall(
        r"^\.\. auto(?:class|function|data):: (\w+)", "\n".join(text.values()), re.M
    )
    for room in pages.ROOMS:
        for name in getattr(il, room).__all__:
            assert documented.count(name) >= 1, (room, name)
            assert f":: {name}\n" in text[room] or f"`{name} <" in text[room]
    assert "Also here" in text["cutfem"]
    assert pages.homes()["SurfaceMesh"] == "ilattice.mesh"


def test_absolute_values_in_docstrings_are_no_substitutions(pages):
    lines = ["The |d| of ``|x|``::", "", "    |f|", "", "and |g|", ">>> a | b"]
    told = ["The \\|d\\| of ``|x|``::", "", "    |f|", "", "and \\|g\\|", ">>> a | b"]
    assert pages.escaped(lines) == told


def test_broken_links_are_found(tmp_path):
    check = load("check_links")
    (tmp_path / "a.html").write_text("<a href='b.html#here'>b</a><img src='c.png'>")
    (tmp_path / "b.html").write_text("<p id='here'>b</p><a href='https://example.org'>x</a>")
    (tmp_path / "c.png").write_text("")
    assert check.complaints(tmp_path) == []
    (tmp_path / "b.html").write_text(
        "<a href='d.html'></a><script src='https://e.org/x.js'></script>"
    )
    wrong = "\n".join(check.complaints(tmp_path))
    assert "a.html: b.html#here leads to no place" in wrong
    assert "b.html: d.html leads nowhere" in wrong
    assert "loads https://e.org/x.js from elsewhere" in wrong
    assert check.main([str(tmp_path)]) == 1
    assert check.complaints(tmp_path / "nothing")


@pytest.mark.client
def test_pages_are_looked_at_in_a_browser(tmp_path):
    check = load("check_site")
    program = check.browser()
    if not program:
        pytest.skip("there is no Chromium or Chrome")
    (tmp_path / "a.html").write_text("<img src='icon.png'>")
    (tmp_path / "b.html").write_text("<img src='no.png'><script>throw Error('bad')</script>")
    (tmp_path / "icon.png").write_bytes((DOCS / "_static" / "icon.png").read_bytes())
    (tmp_path / "search.html").write_text(
        "<p id='search-results'></p><script>document.querySelector('p').innerHTML ="
        "location.search.includes('density') ? '<a href=guide/thickness.html>d</a>' : ''</script>"
    )
    wrong = "\n".join(check.complaints(tmp_path, program, ["a.html", "b.html"]))
    assert "a.html" not in wrong
    assert "b.html: picture no.png is not there" in wrong
    assert "b.html: the console says" in wrong
    assert "search: 'heat exchanger' does not find jobs" in wrong
    assert "relative_density" not in wrong


def test_without_a_browser_it_is_said(monkeypatch, capsys):
    check = load("check_site")
    monkeypatch.setattr(check, "BROWSERS", ())
    assert check.main([]) == 3
    assert "skipped" in capsys.readouterr().out


def test_every_public_object_has_an_example(pages):
    """In its docstring, or in a program of the documentation or of the gallery."""
    programs = [p.read_text(encoding="utf-8") for p in (DOCS.parent / "examples").glob("*.py")]
    texts = [*PAGES.values(), (DOCS.parent / "README.md").read_text(encoding="utf-8")]
    programs += [code for text in texts for _, code in BLOCK.findall(text)]
    words = set(re.findall(r"\w+", "\n".join(programs)))
    without = []
    for room in pages.ROOMS:
        module = importlib.import_module(f"ilattice.{room}")
        for name, _ in pages.members(room):
            item = getattr(module, name)
            shown = (
                ">>>" in f"{inspect.getdoc(item)}{inspect.getdoc(getattr(item, '__init__', None))}"
            )
            if callable(item) and not shown and name not in words:
                without.append(f"{room}.{name}")
    assert without == []
