"""A line on standard error when kernels are being compiled, so that nobody takes it for a hang.

The garbage collector waits meanwhile: it would go through all of the compiler's objects again and
again, which is a twentieth of the time.

Guarantee: one line in the life of a process, as soon as compiling has taken `PATIENCE` seconds in
all; it goes through `logging` as a warning of the logger ``ilattice``, which anybody may silence.
Kernels that are found on the disk are not compiled. The environment variable
``ILATTICE_PATIENCE`` sets other seconds, ``inf`` for never.
"""

import gc
import logging
import os
import threading
import time
from contextlib import suppress
from typing import Any

PATIENCE = 2.0  # seconds
_TOLD = (
    "ilattice: compiling kernels, once; later runs find them on the disk "
    "('ilattice warmup' does it in advance)"
)


class _Clock:
    """Adds up the time of compiling, and tells when it is too long."""

    def __init__(self, patience: float) -> None:
        self.left, self.depth, self.start = patience, 0, 0.0
        self.lock = threading.Lock()
        self.timer: threading.Timer | None = None
        self.collects = False

    def on_start(self) -> None:
        """A kernel begins."""
        with self.lock:
            self.depth += 1
            if self.depth == 1:
                self.collects = gc.isenabled()
                gc.disable()
            if self.depth == 1 and self.left < float("inf"):
                self.start = time.perf_counter()
                self.timer = threading.Timer(max(self.left, 0.0), self.tell)
                self.timer.daemon = True
                self.timer.start()

    def on_end(self) -> None:
        """A kernel is done."""
        with self.lock:
            self.depth -= 1
            if self.depth == 0 and self.collects:
                self.collects = False
                gc.enable()
            if self.depth == 0 and self.timer is not None:
                self.timer.cancel()
                self.left -= time.perf_counter() - self.start

    def forget(self) -> None:
        """Be as at rest: a child has not got the thread that was compiling."""
        self.lock, self.depth, self.timer = threading.Lock(), 0, None
        if self.collects:
            gc.enable()

    def tell(self) -> None:
        """Say it, once."""
        with self.lock:
            if self.left < float("inf"):
                self.left = float("inf")
                logging.getLogger("ilattice").warning(_TOLD)


def watch() -> None:
    """Begin to listen to the compiler; once in a process."""
    with suppress(ImportError, AttributeError, ValueError):
        from numba.core import event

        clock = _Clock(float(os.environ.get("ILATTICE_PATIENCE", PATIENCE)))

        if hasattr(os, "register_at_fork"):
            os.register_at_fork(after_in_child=clock.forget)

        class Listener(event.Listener):
            """Passes events on to the clock."""

            def on_start(self, event: Any) -> None:  # noqa: ARG002
                clock.on_start()

            def on_end(self, event: Any) -> None:  # noqa: ARG002
                clock.on_end()

        event.register("numba:compile", Listener())  # type: ignore[no-untyped-call]
