"""Kernels over ranges, and kernels that only kernels call."""

import os
import subprocess
import sys
from typing import Any, NamedTuple

import numba
import numpy as np
import pytest
from numba.core.compiler import Flags
from numba.core.runtime import _nrt_python, rtsys

from ilattice._kernels import in_ranges, inner
from ilattice._kernels_bitcode import _Quick
from ilattice._kernels_tuples import borrowed


@inner(error_model="numpy")
def power(x, n):
    return x**n


@in_ranges(3)
@numba.njit(nogil=True)
def count(first, last, out):
    for i in range(first, last):
        out[i] += power(i, 2) + power(i, 3)


@pytest.mark.parametrize("n", [0, 1, 3, 4, 100])
@pytest.mark.parametrize("threads", [1, 2])
def test_every_item_is_treated_once(n, threads):
    before, out = numba.get_num_threads(), np.zeros(n, np.int64)
    numba.set_num_threads(min(threads, before))
    try:
        count(n, out)
    finally:
        numba.set_num_threads(before)
    assert out.tolist() == [i**2 + i**3 for i in range(n)]


def test_numbers_of_threads_are_those_that_numba_allows():
    code = """
import numba
from ilattice._kernels import parallel, thread_count
print(thread_count(), parallel._is_initialized, numba.get_num_threads(), thread_count())
numba.set_num_threads(1)
print(thread_count())
"""
    environment = {**os.environ, "NUMBA_NUM_THREADS": "3", "PYTHONPATH": os.pathsep.join(sys.path)}
    command = [sys.executable, "-c", code]
    done = subprocess.run(command, env=environment, capture_output=True, text=True, check=True)
    assert done.stdout.split() == ["3", "False", "3", "3", "1"]


def test_errors_of_ranges_are_raised():
    @in_ranges(2)
    def kernel(first, last):
        if last > 6:
            raise ValueError(f"{first} to {last}")

    kernel(6)
    with pytest.raises(ValueError, match=r"\d+ to \d+"):
        kernel(11)


def test_inner_kernels_take_constants_as_numbers_and_calls_from_python():
    assert power(3, 4) == 81
    assert {args[1] for args in getattr(power, "overloads", {})} <= {numba.int64}


@inner(owning=True)
def doubled(x):
    return 2.0 * x


@inner()
def sum_of_rows(x, out):
    for i in range(len(x)):
        row = x[i]
        for j in range(len(row)):
            out[i] += row[j]


@numba.njit
def summed(x):
    out = np.zeros(len(x))
    sum_of_rows(doubled(x), out)
    return out


def test_inner_kernels_count_no_references_and_lose_none():
    x = np.arange(12.0).reshape(4, 3)
    assert (summed(x) == 2.0 * x.sum(axis=1)).all()
    before = sys.getrefcount(x)
    _nrt_python.memsys_enable_stats()
    try:
        held = rtsys.get_allocation_stats()
        for _ in range(10):
            summed(x)
        after = rtsys.get_allocation_stats()
    finally:
        _nrt_python.memsys_disable_stats()
    assert after.mi_alloc - held.mi_alloc >= 20
    assert after.mi_alloc - held.mi_alloc == after.mi_free - held.mi_free
    assert sys.getrefcount(x) == before


def gets(x):
    return doubled(x)[0]


def gives(x):
    return x[1:]


def makes(x):
    return np.zeros(3)[0] + x[0]


@pytest.mark.skipif(numba.config.DISABLE_JIT, reason="nothing is compiled")
@pytest.mark.parametrize("function", [gets, gives, makes])
def test_inner_kernels_that_own_arrays_must_say_so(function):
    told = "mark it as owning|NRT required|Only accept returning of array"
    with pytest.raises((TypeError, numba.core.errors.NumbaError), match=told):
        inner()(function)(np.arange(3.0))


@inner()
def least(x, limit):
    out = limit
    for i in range(len(x)):
        out = min(out, x[i])
    return out


@numba.njit  # without a cache, so that it compiles `least` or takes it from the disk
def least_of_two(x, y):
    return least(x, 7.0) + least(y, np.inf)


@pytest.mark.skipif(numba.config.DISABLE_JIT, reason="nothing is compiled")
def test_inner_kernels_have_no_machine_code_and_their_callers_all_of_it():
    assert least_of_two(np.array([9.0, 8.0]), np.array([3.0])) == 10.0
    (inside,) = least.overloads.values()
    assert inside.library.get_pointer_to_function(inside.fndesc.llvm_func_name) == 0
    (around,) = least_of_two.overloads.values()
    assert around.library.get_pointer_to_function(around.fndesc.llvm_func_name) != 0


PROGRAM = """
import sys
import numpy as np
from numba.core import event
import {module} as m

class Told(event.Listener):
    names = []
    def on_start(self, event):
        self.names.append(event.data["dispatcher"].py_func.__name__)
    def on_end(self, event):
        pass

event.register("numba:compile", Told())
print(m.{function}(np.arange(5.0)), *Told.names)
"""
KERNELS = """
from ilattice._kernels import inner, outer

@inner()
def half(x):
    return 0.5 * x

@inner()
def quarter(x):
    return half(half(x))

@outer()
def first(x):
    return quarter(x[4])

@outer()
def second(x):
    return quarter(x[2]) + half(x[4])
"""


@pytest.mark.skipif(numba.config.DISABLE_JIT, reason="nothing is compiled")
def test_inner_kernels_are_taken_from_the_disk_for_other_callers(tmp_path):
    (tmp_path / "some_kernels.py").write_text(KERNELS)
    paths = os.pathsep.join([str(tmp_path), *sys.path])
    environment = {**os.environ, "PYTHONPATH": paths, "NUMBA_CACHE_DIR": str(tmp_path / "kept")}

    def run(function):
        program = PROGRAM.format(module="some_kernels", function=function)
        command = [sys.executable, "-c", program]
        out = subprocess.run(command, env=environment, capture_output=True, text=True, check=True)
        return out.stdout.split()

    assert run("first") == ["1.0", "first", "quarter", "half"]
    assert run("second") == ["2.5", "second"]
    assert run("second") == ["2.5"]


def prints(x):
    print(x)  # noqa: T201
    return x


def tells(x):
    if x > 1.0:
        raise ValueError(f"{x} is too large")
    return x


@pytest.mark.skipif(numba.config.DISABLE_JIT, reason="nothing is compiled")
@pytest.mark.parametrize("function", [prints, tells])
def test_inner_kernels_need_no_objects_of_python(function):
    refusals = (TypeError, RuntimeError, numba.core.errors.NumbaError)
    with pytest.raises(refusals, match=r"cannot be inner|missing Environment|NRT required"):
        inner()(function)(0.5)


@pytest.mark.skipif(numba.config.DISABLE_JIT, reason="nothing is compiled")
def test_options_of_compiling_are_compared_as_numba_does():
    given, others = [], [{}, {"nrt": True}, {"nrt": False}, {"fastmath": True, "nrt": True}]
    for kind in (Flags, _Quick):
        for values in others:
            flags = kind()
            for name, value in values.items():
                setattr(flags, name, value)
            given.append(flags)
    for a in given:
        for b in given:
            same = Flags.values(a) == Flags.values(b)
            assert (a == b) is same
            assert a.values() == Flags.values(a)
            assert not same or hash(a) == hash(b)


class Few(NamedTuple):
    row: Any
    table: Any
    scale: float


@inner()
def entry(few, i):
    few = borrowed(few)
    row, table = few.row, few.table
    return few.scale * (row[i] + table[i, 1])


@numba.njit
def total(few, n):
    few = borrowed(few)
    out = 0.0
    for i in range(n):
        out += entry(few, i)
    return out


def test_borrowed_tuples_hold_the_same_arrays_and_leave_their_references_alone():
    row, table = np.arange(5.0), np.arange(10.0).reshape(5, 2)
    before = sys.getrefcount(row), sys.getrefcount(table)
    assert total(Few(row, table, 0.5), 5) == 0.5 * (row.sum() + table[:, 1].sum())
    assert (sys.getrefcount(row), sys.getrefcount(table)) == before


def test_borrowed_tuples_of_arrays_of_one_type_are_what_they_were():
    @numba.njit
    def swapped(pair):
        a, b = borrowed(pair)
        return b[0] - a[0]

    assert swapped((np.array([2.0]), np.array([7.0]))) == 5.0
