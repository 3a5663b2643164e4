"""The pages for those who change the package: examples run, names exist, rooms are all there."""

import ast
import re
from importlib import import_module
from operator import attrgetter
from pathlib import Path

import pytest

import ilattice as il
from ilattice.io import registry

DOCS = Path(__file__).parent.parent / "docs"
HOME = Path(il.__file__).parent
#: Positional arguments of a kernel.
MAX_ARGUMENTS = 16
#: Rooms where one comment may serve all constants that follow it.
SHARED = ("cutfem", "fields", "io", "plot")
#: What the values of constants are made of.
NUMBERS = (ast.Constant, ast.Tuple, ast.BinOp, ast.UnaryOp, ast.operator, ast.unaryop, ast.Load)


def page(name):
    return (DOCS / name).read_text(encoding="utf-8")


@pytest.mark.filterwarnings("ignore::ilattice.errors.PrecisionWarning")
def test_examples_of_how_to_add_things_run(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setitem(registry.WRITERS, "mesh", dict(registry.WRITERS["mesh"]))
    parts = re.findall(r"```python\n(.*?)```", page("how_to.md"), re.DOTALL)
    assert len(parts) >= 4
    names = {}
    for number, part in enumerate(parts):
        exec(compile(part, f"part {number} of how_to.md", "exec"), names)


def test_functions_of_formulas_exist():
    found = re.findall(r"`((?:ilattice|il)(?:\.\w+)+)`", page("equations.md") + page("theory.md"))
    assert len(found) >= 60
    for name in found:
        if name.startswith("il."):
            assert attrgetter(name[3:])(il), name
            continue
        parts = name.split(".")
        module = next(
            ".".join(parts[:n])
            for n in range(len(parts), 0, -1)
            if HOME.joinpath(*parts[1:n]).with_suffix(".py").is_file()
        )
        thing = import_module(module)
        for part in name[len(module) + 1 :].split("."):
            thing = getattr(thing, part)


def test_every_room_is_in_the_plan_from_top_to_bottom():
    rows = re.findall(r"^\| (`.*?) \|", page("architecture.md"), re.MULTILINE)
    named = [room for row in rows for room in re.findall(r"`(\w+)`", row)]
    rooms = {p.parent.name for p in HOME.glob("*/__init__.py")}
    assert rooms <= set(named)
    order = [room for room in named if room in rooms]
    for upper, lower in (("lattice", "mesh"), ("mesh", "offsets"), ("fields", "bspline")):
        assert order.index(upper) < order.index(lower)


@pytest.mark.parametrize("name", ["architecture.md", "how_to.md", "equations.md", "words.md"])
def test_links_lead_to_files(name):
    for target in re.findall(r"\]\((\w+\.md)\)", page(name)):
        assert (DOCS / target).is_file()


def test_kernels_can_be_read():
    """Those with more arguments take named tuples, or numbers packed at named places."""
    counted = {
        f"{path.relative_to(HOME)}:{node.lineno} {node.name}": len(node.args.args)
        for path in HOME.rglob("_kernels*.py")
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8")))
        if isinstance(node, ast.FunctionDef)
    }
    assert len(counted) > 500
    assert {name: n for name, n in counted.items() if n > MAX_ARGUMENTS} == {}


def constants(path):
    """Numbers with names of capitals at the top of a module: first and last line, and name."""
    for node in ast.parse(path.read_text(encoding="utf-8")).body:
        if not isinstance(node, ast.Assign):
            continue
        parts = list(ast.walk(node.value))
        numbers = (isinstance(n.value, int | float) for n in parts if isinstance(n, ast.Constant))
        names = [n.id for n in ast.walk(node.targets[0]) if isinstance(n, ast.Name)]
        if all(isinstance(n, NUMBERS) for n in parts) and all(numbers) and "".join(names).isupper():
            yield node.lineno, node.end_lineno, names[0]


def described(lines, first, last, shared):
    """Whether a statement has a comment above or on its line; `shared` if one above others will do.

    It always will where nothing else, between blank lines, has one.
    """
    own = lines[last - 1].replace("# fmt: skip", "")
    if "#" in own or lines[first - 2].startswith("#"):
        return True
    begin, end = first - 1, last
    while begin > 0 and lines[begin - 1]:
        begin -= 1
    while end < len(lines) and lines[end]:
        end += 1
    block = [line.startswith("#") for line in lines[begin:end]]
    return any(block[: first - 1 - begin]) if shared else block == sorted(block)[::-1] and block[0]


def test_constants_say_what_they_are():
    """Each by a comment of its own, or together by one at the top of a block of their own."""
    silent, count = [], 0
    for path in HOME.rglob("*.py"):
        lines = path.read_text(encoding="utf-8").splitlines()
        shared = path.relative_to(HOME).parts[0] in SHARED
        for first, last, name in constants(path):
            count += 1
            if not described(lines, first, last, shared):
                silent.append(f"{path.relative_to(HOME)}:{first} {name}")
    assert count > 500
    assert silent == []
