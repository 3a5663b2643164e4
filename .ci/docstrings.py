"""Check the docstrings of everything public with the rules that pyproject.toml lists.

``numpydoc lint`` reads source and takes properties for functions and dataclasses for classes
without parameters; here the objects themselves are asked. Public is what ``__all__`` names.
"""

import enum
import functools
import inspect
import pkgutil
import sys
import tomllib
import types
from collections.abc import Iterator
from importlib import import_module
from pathlib import Path

from numpydoc.validate import validate

import ilattice

ROOT = Path(__file__).parents[1]
DOCUMENTED = (classmethod, staticmethod, property, functools.cached_property, types.FunctionType)


def modules() -> Iterator[str]:
    """Names of the public modules."""
    yield "ilattice"
    for module in pkgutil.walk_packages(ilattice.__path__, "ilattice."):
        if not any(part.startswith("_") for part in module.name.split(".")):
            yield module.name


def public(module: str) -> Iterator[tuple[str, object]]:
    """Full names of what a module exports, and of the methods of that, with the objects."""
    home = import_module(module)
    for name in getattr(home, "__all__", ()):
        item = getattr(home, name)
        is_class = inspect.isclass(item) and not issubclass(item, enum.Enum)
        if (is_class or inspect.isfunction(item)) and item.__module__.startswith("ilattice."):
            yield f"{module}.{name}", item
        if is_class:
            for k, member in vars(item).items():
                if k[0] != "_" and isinstance(member, DOCUMENTED):
                    yield f"{module}.{name}.{k}", member


def is_result(item: object) -> bool:
    """Whether only the library makes objects of this class: attributes stand for parameters."""
    return inspect.isclass(item) and "\n    Attributes\n" in str(item.__doc__)


def main() -> int:
    """Print what is wrong, one line each; return how much."""
    settings = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
    rules = set(settings["tool"]["numpydoc_validation"]["checks"])
    wrong = {}
    count = 0
    for module in modules():
        for name, item in public(module):
            count += 1
            result = validate(name)
            place = f"{result['file']}:{result['file_line']}"
            asked = rules - {"PR01"} if is_result(item) else rules
            wrong |= {(place, code): text for code, text in result["errors"] if code in asked}
    for (place, code), text in sorted(wrong.items()):
        print(f"{place}: {code} {text}")
    print(f"{count} docstrings, {len(wrong)} complaints")
    return min(len(wrong), 1)


if __name__ == "__main__":
    sys.exit(main())
