"""Kernels on the disk are taken only if nothing that they were compiled from has changed.

Numba keeps a compiled kernel until the file of its source changes. Kernels hold the code of those
that they call, and these are in other files: after an update, or an edit, old code would be run
without a word. Here the stamp of a file is a digest of it and of all files of kernels that it
imports, one by one.

Guarantee: files of other packages are left to Numba. Non-guarantee: what kernels take from other
files than those of kernels, such as tables of constants, counts where these are imported by name
at the top.
"""

import re
from collections.abc import Iterator
from contextlib import suppress
from functools import cache
from hashlib import sha256
from pathlib import Path
from typing import Any

HOME = Path(__file__).parent
_IMPORTED = re.compile(r"^ *from (ilattice[\w.]*) import (\([^)]*\)|.*)", re.MULTILINE)


def stamp_all() -> None:
    """Let Numba judge our kernels by all of their sources; before the first one is imported."""
    with suppress(ImportError, AttributeError):
        from numba.core import caching

        usual = (
            caching.UserProvidedCacheLocator,
            caching.InTreeCacheLocator,
            caching.UserWideCacheLocator,
        )
        ours: Any = [type(f"Ours{base.__name__}", (_Stamped, base), {}) for base in usual]
        caching.CacheImpl._locator_classes[:0] = ours


class _Stamped:
    """Where Numba keeps a kernel of ours, with another stamp; mixed into its locators."""

    _py_file: str

    @classmethod
    def from_function(cls, py_func: Any, py_file: str) -> Any:
        """A locator for files of this package, None for others."""
        if HOME not in Path(py_file).parents:
            return None
        return super().from_function(py_func, py_file)  # type: ignore[misc]

    def get_source_stamp(self) -> bytes:
        """What has to be the same for a kernel on the disk to be taken."""
        return stamp(Path(self._py_file))


@cache
def stamp(file: Path) -> bytes:
    """Digest of a file and of what it is compiled with.

    Parameters
    ----------
    file : Path
        A module of this package.

    Returns
    -------
    bytes
        Another one whenever one of the files is another.
    """
    digest = sha256()
    for one in sorted(_sources(file)):
        digest.update(sha256(one.read_bytes()).digest())
    return digest.digest()


def _sources(file: Path) -> set[Path]:
    """A file and, if it has kernels, the files that it imports from, and so on."""
    found, left = {file}, [file]
    while left:
        one = left.pop()
        new = set(_imported(one)) - found if one.name.startswith("_kernels") else set()
        found |= new
        left += new
    return found


@cache
def _imported(file: Path) -> tuple[Path, ...]:
    """Files of this package that a file imports from at its top."""
    return tuple(_files(file.read_text(encoding="utf-8")))


def _files(text: str) -> Iterator[Path]:
    for module, names in _IMPORTED.findall(text):
        place = HOME.joinpath(*module.split(".")[1:])
        if place.with_suffix(".py").is_file():
            yield place.with_suffix(".py")
            continue
        for name in re.findall(r"\w+", names):  # modules of a package
            if (place / f"{name}.py").is_file():
                yield place / f"{name}.py"
