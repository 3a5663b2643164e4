"""Time and memory of the stages of a job, for its report.

Guarantee: a stage is recorded also when it raises. Not guaranteed: that the peak belongs to this
stage alone. Linux lets a process reset its own peak; elsewhere it is the peak since the start, and
on Windows it is unknown (None).
"""

import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path


class Stages:
    """Records of named stages, in order.

    Attributes
    ----------
    records : dict of str to dict
        Of every stage the wall ``seconds``, the ``cpu_seconds`` of all threads, and
        ``peak_memory_mb``, the largest resident size in megabytes, or None if it is not known.
    """

    def __init__(self) -> None:
        self.records: dict[str, dict[str, float | None]] = {}

    @contextmanager
    def __call__(self, name: str) -> Iterator[None]:
        """Record what runs inside the ``with`` block."""
        _reset_peak()
        wall, cpu = time.perf_counter(), time.process_time()
        try:
            yield
        finally:
            self.records[name] = {
                "seconds": round(time.perf_counter() - wall, 3),
                "cpu_seconds": round(time.process_time() - cpu, 3),
                "peak_memory_mb": peak_megabytes(),
            }


def _reset_peak() -> None:
    with suppress(OSError):
        Path("/proc/self/clear_refs").write_text("5", encoding="ascii")


def peak_megabytes() -> float | None:
    """Largest resident size of this process in megabytes; None where it is not known."""
    with suppress(OSError):
        for line in Path("/proc/self/status").read_text(encoding="ascii").splitlines():
            if line.startswith("VmHWM:"):
                return round(int(line.split()[1]) * 1024 / 1e6, 1)
    if sys.platform == "win32":
        return None
    import resource

    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return round(peak / (1e6 if sys.platform == "darwin" else 1e3 / 1.024), 1)
