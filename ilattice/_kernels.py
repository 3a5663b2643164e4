"""How kernels are compiled, and called from several threads.

Numba compiles a loop that is marked as parallel as a kernel, as a wrapper of it and as the function
around both, each with all that they call, which takes three to four times as long as once. So most
kernels here are plain functions of a range of items, and Python's threads take the ranges.

Guarantees: see `in_ranges` and `inner`; results do not depend on the number of threads.
Non-guarantee: the order of ranges.
"""

import os
from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import suppress
from functools import cached_property, update_wrapper
from typing import Any

import numba
from numba import njit, types
from numba.core.registry import CPUDispatcher
from numba.np.ufunc import parallel as _parallel

from ilattice._kernels_bitcode import BitcodeCache, ToBitcode, ToMachine

_config: Any = numba.config
parallel: Any = _parallel
_pool: list[ThreadPoolExecutor] = []
_SHORT = (types.int8, types.int16, types.int32)


def _threads() -> ThreadPoolExecutor:
    """The threads, started when first needed."""
    if not _pool:
        _pool.append(ThreadPoolExecutor(_config.NUMBA_NUM_THREADS, "ilattice"))
    return _pool[0]


def thread_count() -> int:
    """How many threads `numba.set_num_threads` allows.

    Numba asks its layer of threads, which it starts when first asked, under locks that a child of a
    fork may find closed for ever. Nobody has set a number before it is started.
    """
    started = parallel._is_initialized
    return parallel._get_num_threads() if started else _config.NUMBA_NUM_THREADS


def _helped(work: Callable[[], None], helpers: int) -> list[Future[None]]:
    """What so many threads have been given to do: nothing when the interpreter is ending."""
    out: list[Future[None]] = []
    with suppress(RuntimeError):
        for _ in range(helpers):
            out.append(_threads().submit(work))
    return out


if hasattr(os, "register_at_fork"):  # a child has not got the threads
    os.register_at_fork(after_in_child=_pool.clear)


def in_ranges(grain: int) -> Callable[[Callable[..., None]], Callable[..., None]]:
    """Decorator of a kernel f(first, last, *arguments), which is then called as f(n, *arguments).

    The kernel treats the items first, first + 1, ..., last - 1, without the interpreter's lock
    (``nogil=True``), and must not depend on how they are grouped. As many threads as
    `numba.set_num_threads` allows, the calling one among them, take ranges in turn, so that slow
    ones do not hold up the rest. Calls from several threads do not wait for each other.

    Parameters
    ----------
    grain : int
        Items in a range: enough for 50 µs of work at least.

    Returns
    -------
    callable
        The decorator.
    """

    def decorate(kernel: Callable[..., None]) -> Callable[..., None]:
        def over(n: int, *arguments: Any) -> None:
            pieces = -(-n // grain)
            helpers = min(pieces, thread_count()) - 1 if pieces > 1 else 0
            if helpers < 1:
                kernel(0, n, *arguments)
                return
            tickets = iter(range(0, n, grain))  # of which threads can take the next one safely

            def work() -> None:
                for first in tickets:
                    kernel(first, min(n, first + grain), *arguments)

            futures = _helped(work, helpers)
            try:
                work()
            finally:
                for _ in tickets:  # none, unless the kernel was interrupted
                    pass
                for future in futures:
                    if not future.cancel():  # those that have not begun have nothing left to do
                        future.result()

        return update_wrapper(over, kernel)

    return decorate


def _has_arrays(kind: Any) -> bool:
    """Whether values of a type are arrays, or hold some."""
    if isinstance(kind, types.BaseTuple):
        parts: Any = kind
        return any(_has_arrays(part) for part in parts)
    return isinstance(kind, types.Array)


class _Inner(CPUDispatcher):
    """A compiled function without a way in from Python."""

    def add_overload(self, cres: Any) -> None:
        """Keep what was compiled, unless arrays are lost or freed where none is counted."""
        made = [] if self.targetoptions["_nrt"] else [cres.signature.return_type]
        notes = cres.type_annotation  # nothing where it came from the disk
        for call, signature in getattr(notes, "calltypes", {}).items():
            if made and getattr(call, "op", "") == "call":
                function = notes.typemap[call.func.name]
                made += [signature.return_type] * isinstance(function, types.Dispatcher)
        if any(_has_arrays(part) for part in made):
            raise TypeError(f"{self.py_func.__name__} gets or returns arrays: mark it as owning")
        super().add_overload(cres)

    def get_call_template(self, args: Any, kws: Any) -> Any:
        """Types of a call: whole numbers are not told from each other."""
        plain: Any = types.unliteral
        wide = (types.int64 if a in _SHORT else plain(a) for a in args)
        return super().get_call_template(tuple(wide), kws)

    def enable_caching(self) -> None:
        """Keep it on the disk."""
        self._cache = BitcodeCache(self.py_func)  # type: ignore[no-untyped-call]

    @cached_property
    def _outer(self) -> Any:
        inner = self
        return njit(lambda *arguments: inner(*arguments))

    def __call__(self, *arguments: Any) -> Any:
        return self._outer(*arguments)


def outer(**options: Any) -> Callable[[Callable[..., Any]], Any]:
    """Decorator as `numba.njit`, for kernels that Python calls; always with a cache.

    Parameters
    ----------
    **options
        As of `numba.njit`.

    Returns
    -------
    callable
        The decorator.
    """
    if _config.DISABLE_JIT:
        return lambda function: function
    options |= {"cache": True, "no_cfunc_wrapper": True, "pipeline_class": ToMachine}
    return njit(**options)


def inner(*, owning: bool = False, **options: Any) -> Callable[[Callable[..., Any]], Any]:
    """Decorator as `numba.njit`, for kernels that only other kernels call; always with a cache.

    Such a kernel is compiled up to what its callers link, see `ilattice._kernels_bitcode`, and once
    for whole numbers of any length, however many constants it is called with. A call from Python
    compiles a small kernel around it, which is not kept: tests do that. It does not count
    references of its arguments either, which the caller holds: two atomic operations per array and
    call were up to a quarter of the time.

    Parameters
    ----------
    owning : bool
        For kernels that make arrays, return them, or call others that do: these count.
    **options
        As of `numba.njit`.

    Returns
    -------
    callable
        The decorator.
    """
    options |= {"nopython": True, "no_cpython_wrapper": True, "no_cfunc_wrapper": True}
    options["_nrt"] = owning
    options.pop("cache", None)

    def decorate(function: Callable[..., Any]) -> Any:
        if _config.DISABLE_JIT:
            return function
        out = _Inner(function, targetoptions=options, pipeline_class=ToBitcode)
        out.enable_caching()
        return out

    return decorate
