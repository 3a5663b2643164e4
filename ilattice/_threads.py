"""Parallel kernels called from several Python threads at a time, where the layer cannot take it.

Numba runs parallel kernels on one of three layers. TBB (the extra ``fast``) and OpenMP serve
several Python threads at once. The third, "workqueue", which Numba takes where neither is found,
ends the whole process when two threads come at the same time. Here they take turns instead.

Guarantee: with any layer kernels may be called from any thread, with the same results. Not
guaranteed: that threads gain anything on the layer where they take turns; that kernels of other
libraries, which have started that layer before this package was imported, take turns with ours;
processes forked after the first kernel on OpenMP (TBB and workqueue take that). Children do not
wait for attributes that another thread was making when they were forked.
"""

import ctypes
import os
import sys
import threading
from contextlib import suppress
from functools import cached_property
from importlib import import_module
from typing import Any

_LAUNCH = ctypes.CFUNCTYPE(
    None,
    ctypes.c_void_p,  # the loop
    ctypes.c_void_p,  # its arguments
    ctypes.c_void_p,  # its bounds
    ctypes.c_void_p,  # steps
    ctypes.c_void_p,  # data
    ctypes.c_size_t,  # inner dimensions
    ctypes.c_size_t,  # arrays
    ctypes.c_ssize_t,  # threads
)
_kept: list[Any] = []


def _free_attributes() -> None:
    """Give attributes that are made once locks that no thread of another process holds.

    Until Python 3.12 a lock is held while such an attribute is made; a child that is forked then
    would wait for ever for a thread that it has not got.
    """
    for name, module in list(sys.modules.items()):
        if not name.startswith("ilattice"):
            continue
        for kind in list(vars(module).values()):
            for made in list(vars(kind).values()) if isinstance(kind, type) else ():
                if isinstance(made, cached_property) and hasattr(made, "lock"):
                    made.lock = threading.RLock()


if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_free_attributes)


def take_turns() -> None:
    """Put a lock before the launch of loops on the layer that cannot take two at a time."""
    with suppress(ImportError, AttributeError, TypeError):
        workqueue: Any = import_module("numba.np.ufunc.workqueue")

        if _kept:
            return
        launch, lock = _LAUNCH(workqueue.parallel_for), threading.RLock()

        def one_at_a_time(*arguments: Any) -> None:
            with lock:
                launch(*arguments)

        if hasattr(os, "register_at_fork"):  # a child must not wait for threads that it has not
            os.register_at_fork(
                before=lock.acquire, after_in_parent=lock.release, after_in_child=lock.release
            )
        guarded = _LAUNCH(one_at_a_time)
        _kept.extend((guarded, launch))
        address = ctypes.cast(guarded, ctypes.c_void_p).value
        workqueue.parallel_for = address  # which Numba reads when it starts the layer
