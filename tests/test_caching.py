"""Compiled kernels are taken from the disk only while all of their sources are the same."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

import ilattice
from ilattice import _caching

HOME = Path(ilattice.__file__).parent
PROGRAM = """
import outer
print(outer.twice(3.0), sum(outer.twice.stats.cache_hits.values()))
"""
ALL = """
import importlib, pkgutil, sys
import ilattice
from numba.core.dispatcher import Dispatcher
importlib.import_module(sys.argv[1])
for module in pkgutil.walk_packages(ilattice.__path__, "ilattice."):
    if module.name != "ilattice.__main__":
        importlib.import_module(module.name)
kernels = [v for m in list(sys.modules.values()) if m.__name__.startswith("ilattice.")
           for v in vars(m).values() if isinstance(v, Dispatcher)]
places = [k._cache._impl.locator for k in kernels if hasattr(k._cache, "_impl")]
print(len(places) > 300, {type(p).__name__[:4] for p in places})
"""
INNER = "from numba import njit\n@njit(cache=True)\ndef inner(x):\n    return {} * x\n"
OUTER = """from numba import njit
from ilattice.bspline._kernels_inner import inner
@njit(cache=True)
def twice(x):
    return inner(x)
"""


def test_all_kernels_are_stamped_with_what_they_call():
    from ilattice.quadrature._kernels_drive import rules

    file = Path(HOME / "quadrature" / "_kernels_drive.py")
    assert rules.__wrapped__._cache._impl.locator.get_source_stamp() == _caching.stamp(file)
    names = {path.name for path in _caching._sources(file)}
    assert {"_kernels_rules.py", "_kernels_bases.py", "_kernels_bernstein.py"} <= names
    tables = _caching._sources(HOME / "mesh" / "_kernels_faces.py")
    assert HOME / "mesh" / "_tables.py" in tables


def test_a_kernel_is_compiled_again_when_one_that_it_calls_has_changed(tmp_path):
    shutil.copytree(HOME, tmp_path / "ilattice", ignore=shutil.ignore_patterns("__pycache__"))
    room = tmp_path / "ilattice" / "bspline"
    (room / "_kernels_outer.py").write_text(OUTER)
    (tmp_path / "outer.py").write_text("from ilattice.bspline._kernels_outer import twice\n")
    environment = {k: v for k, v in os.environ.items() if k != "NUMBA_CACHE_DIR"}
    environment |= {"PYTHONPATH": str(tmp_path), "ILATTICE_PATIENCE": "inf"}
    seen = []
    for factor in (2, 2, 5):
        (room / "_kernels_inner.py").write_text(INNER.format(factor))
        done = subprocess.run(
            [sys.executable, "-c", PROGRAM], env=environment, capture_output=True, text=True,
            check=True, cwd=tmp_path,
        )  # fmt: skip
        seen.append(done.stdout.split())
    assert seen == [["6.0", "0"], ["6.0", "1"], ["15.0", "0"]]


@pytest.mark.parametrize(
    "first", ["bspline._kernels", "quadrature._kernels_drive", "fields", "sdf"]
)
def test_no_kernel_is_left_out_whatever_is_imported_first(first):
    command = [sys.executable, "-c", ALL, f"ilattice.{first}"]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    assert done.stdout.split(None, 1) == ["True", "{'Ours'}\n"]
