"""The table of contents, what importing costs, and the rules no linter knows."""

import ast
import graphlib
import os
import re
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest

import ilattice as il

ROOT = Path(il.__file__).parent
MODULES = sorted(ROOT.rglob("*.py"))
COMPILED = ("_kernels", "_tables")  # what numba compiles, and the constants that it compiles in
KERNELS = [p for p in MODULES if p.name.startswith(COMPILED)]
HEAVY = {"cyclopts", "lib3mf", "matplotlib", "pyamg", "pyvista", "rich", "skimage", "trimesh"}
HEAVY |= {"pypardiso", "vtk"}


def test_every_public_name_exists_and_is_sorted():
    assert list(il.__all__) == sorted(il.__all__)
    assert set(il.__all__) < set(dir(il))
    for name in il.__all__:
        assert getattr(il, name) is not None


def test_unknown_names_are_attribute_errors():
    with pytest.raises(AttributeError, match="gyroide"):
        _ = il.gyroide


def test_the_docstring_lists_every_public_name():
    assert set(il.__all__) <= set(re.findall(r"^`(\w+)`", il.__doc__, re.MULTILINE))


def test_every_room_lists_its_names():
    for room in sorted({p.parent.name for p in MODULES if p.name == "__init__.py"} - {ROOT.name}):
        module = getattr(il, room)
        assert sorted(module.__all__) == list(module.__all__), room
        assert all(hasattr(module, name) for name in module.__all__), room


@pytest.mark.parametrize("statement", ["import ilattice", "from ilattice import *"])
def test_importing_loads_nothing_heavy(statement):
    code = f"{statement}; import sys; print(*sorted({{m.split('.')[0] for m in sys.modules}}))"
    # Ambient start-up hooks of the environment may load anything: compare with an empty program.
    loaded, before = (_run(c) for c in (code, code.replace(statement, "pass")))
    assert not (loaded - before) & (HEAVY | {"vtkmodules", "PIL", "networkx", "pandas"})


def test_importing_the_package_alone_loads_no_room():
    code = "import ilattice, sys; print(*[m for m in sys.modules if m.startswith('ilattice')])"
    assert _run(code) == {"ilattice"}


def _run(code):
    env = {k: v for k, v in os.environ.items() if not k.startswith("COV")}
    out = subprocess.run([sys.executable, "-c", code], capture_output=True, check=True, env=env)
    return set(out.stdout.decode().split())


def _imports(tree):
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            yield "." * node.level + (node.module or "")


def _module_level(tree):
    """The tree without the bodies of its functions and of ``if TYPE_CHECKING``."""
    todo = list(tree.body)
    while todo:
        node = todo.pop()
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef | ast.Lambda):
            continue
        if isinstance(node, ast.If) and "TYPE_CHECKING" in ast.unparse(node.test):
            todo.extend(node.orelse)
            continue
        yield node
        todo.extend(ast.iter_child_nodes(node))


@pytest.mark.parametrize("path", MODULES, ids=lambda p: p.relative_to(ROOT).as_posix())
def test_heavy_packages_are_imported_inside_functions_only(path):
    tree = ast.parse(path.read_text(encoding="utf-8"))
    shallow = ast.Module([n for n in _module_level(tree) if isinstance(n, ast.stmt)], [])
    names = {
        name.split(".")[0]
        for node in shallow.body
        if isinstance(node, ast.Import | ast.ImportFrom)
        for name in _imports(node)
    }
    assert not names & (HEAVY | {"vtkmodules"})


@pytest.mark.parametrize("path", KERNELS, ids=lambda p: p.relative_to(ROOT).as_posix())
def test_kernels_import_numpy_numba_and_kernels_only(path):
    for name in _imports(ast.parse(path.read_text(encoding="utf-8"))):
        allowed = name.split(".")[0] in {"llvmlite", "numba", "numpy", *sys.stdlib_module_names}
        assert allowed or name.split(".")[-1].startswith((*COMPILED, "_typing")), name


@pytest.mark.parametrize("path", KERNELS, ids=lambda p: p.relative_to(ROOT).as_posix())
def test_kernels_name_their_fast_math_flags(path):
    """The bare flag and ``nnan``/``ninf`` would let NaN vanish without a trace."""
    allowed = {"contract", "nsz", "arcp", "reassoc"}
    tree = ast.parse(path.read_text(encoding="utf-8"))
    named = {
        target.id: node.value
        for node in tree.body
        if isinstance(node, ast.Assign)
        for target in node.targets
        if isinstance(target, ast.Name)
    }
    for node in ast.walk(tree):
        if isinstance(node, ast.keyword) and node.arg == "fastmath":
            value = named.get(getattr(node.value, "id", ""), node.value)
            if not isinstance(value, ast.Name):  # else imported from a kernel file checked itself
                assert set(ast.literal_eval(value) or ()) <= allowed


def test_the_walk_finds_module_level_imports():
    source = "import rich\nif x:\n    import vtk\ndef f():\n    import trimesh\n"
    nodes = [n for n in _module_level(ast.parse(source)) if isinstance(n, ast.Import)]
    assert {name for n in nodes for name in _imports(n)} == {"rich", "vtk"}


# --- who imports whom: at the top, inside functions, for types ------------------------------------


def _modules_of(tree, known):
    """Modules of this package that a module imports anywhere."""
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            yield from (a.name for a in node.names if a.name.split(".")[0] == "ilattice")
        elif isinstance(node, ast.ImportFrom) and (node.module or "").split(".")[0] == "ilattice":
            for alias in node.names:
                full = f"{node.module}.{alias.name}"
                yield full if full in known else node.module


@pytest.fixture(scope="module")
def imports():
    """Module -> modules of this package that it imports; that of the package as a whole is none."""
    named = {}
    for path in MODULES:
        parts = ("ilattice", *path.relative_to(ROOT).with_suffix("").parts)
        named[".".join(parts).removesuffix(".__init__")] = path
    out = {}
    for name, path in named.items():
        tree = ast.parse(path.read_text(encoding="utf-8"))
        out[name] = set(_modules_of(tree, named)) - {name} if name != "ilattice" else set()
    return out


def _room(module):
    return module.split(".")[1] if "." in module else module


def _rooms(imports):
    """Room -> rooms that it imports."""
    out = {}
    for module, others in imports.items():
        out.setdefault(_room(module), set()).update(map(_room, others))
    return {room: others - {room} for room, others in out.items()}


def test_no_circle_between_rooms_counting_imports_inside_functions_and_for_types(imports):
    order = list(graphlib.TopologicalSorter(_rooms(imports)).static_order())
    assert order.index("bspline") < order.index("fields") < order.index("lattice")


def test_no_circle_between_modules_wherever_imports_stand(imports):
    order = list(graphlib.TopologicalSorter(imports).static_order())
    assert set(order) == set(imports)


def _within_functions(tree, known):
    """Modules of this package that a module imports within functions."""
    for node in ast.walk(tree):
        if isinstance(node, (ast.FunctionDef, ast.AsyncFunctionDef)):
            yield from _modules_of(node, known)


@pytest.mark.parametrize("path", MODULES, ids=lambda p: p.relative_to(ROOT).as_posix())
def test_modules_are_imported_at_the_top_but_by_the_command_line(path):
    """There, a call for help is not to wait for kernels."""
    if path.name in ("cli.py", "_commands.py"):
        return
    tree = ast.parse(path.read_text(encoding="utf-8"))
    assert list(_within_functions(tree, set())) == []


def test_no_import_climbs_wherever_it_stands(imports):
    contract = tomllib.loads((ROOT.parent / "pyproject.toml").read_text(encoding="utf-8"))
    (layers,) = contract["tool"]["importlinter"]["contracts"]
    assert "ignore_imports" not in layers
    floor = {}
    for number, layer in enumerate(reversed(layers["layers"])):
        for room in re.findall(r"\w+", layer):
            floor[room] = number, ":" in layer  # those that a colon joins may see each other
    rooms = _rooms(imports)
    climbs = []
    for room, others in rooms.items():
        if room == "ilattice":
            continue
        for other in others - {"ilattice"}:
            (high, open_), (low, _) = floor[room], floor[other]
            if not (low < high or (low == high and open_)):
                climbs.append((room, other))
    assert climbs == []
    assert set(rooms) - {"ilattice"} == set(floor) - {"design"}


def test_only_what_is_above_all_rooms_imports_the_package_as_a_whole(imports):
    asked = {m for m, others in imports.items() if "ilattice" in others}
    assert {_room(m) for m in asked} <= {"_job", "_warmup", "cli", "__main__"}


def test_the_walk_finds_imports_inside_functions_and_for_types():
    source = "def f():\n    from ilattice.b import c\nif TYPE_CHECKING:\n    import ilattice.d\n"
    assert set(_modules_of(ast.parse(source), {"ilattice.b.c"})) == {"ilattice.b.c", "ilattice.d"}
