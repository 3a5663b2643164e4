"""Memory that work will take, against what is free, before the work begins.

Guarantee: `need` refuses in one line, with the number needed, what is free, and what to change.
Not guaranteed: that what fits now still fits later; estimates are those of the callers. Where the
system does not tell what is free, physical memory counts, and else `UNKNOWN`.
"""

import os
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path

from ilattice.errors import InputError

#: Bytes taken for free where the system does not tell.
UNKNOWN = 1 << 36
#: Bytes below which the system is not asked.
SMALL = 1 << 26
_GROUPS = (
    ("memory.max", "memory.current"),  # cgroup 2
    ("memory/memory.limit_in_bytes", "memory/memory.usage_in_bytes"),  # cgroup 1
)


def need(size: float, what: str, remedy: str) -> None:
    """Refuse work that takes more memory than is free.

    Parameters
    ----------
    size : float
        Bytes, estimated.
    what : str
        The work, as the subject of "needs".
    remedy : str
        What to change.

    Raises
    ------
    InputError
        With the three numbers, if `size` is more than what is free.
    """
    if size <= SMALL:
        return
    free = available()
    if not size <= free:
        raise InputError(
            f"{what} needs about {readable(size)} of memory, {readable(free)} are free: {remedy}"
        )


def readable(size: float) -> str:
    """Bytes for people: ``1.3 GB``."""
    for unit in ("kB", "MB", "GB"):
        size /= 1e3
        if size < 999.5:
            return f"{size:.3g} {unit}"
    return f"{size / 1e3:.3g} TB" if size < 1e18 else "more than 1e15 TB"


def available() -> int:
    """Bytes that this process can take: of the machine, of its group, of its own limit."""
    return max(0, min([*_machine(), *_group(), *_own()], default=UNKNOWN))


def _machine() -> Iterator[int]:
    with suppress(OSError):
        for line in Path("/proc/meminfo").read_text(encoding="ascii").splitlines():
            if line.startswith("MemAvailable:"):
                yield int(line.split()[1]) * 1024
                return
    with suppress(AttributeError, OSError, ValueError):
        yield os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE")


def _group() -> Iterator[int]:
    for limit, used in _GROUPS:
        with suppress(OSError, ValueError):
            root = Path("/sys/fs/cgroup")
            most = int((root / limit).read_text(encoding="ascii"))
            now = int((root / used).read_text(encoding="ascii"))
            kept = (root / used).with_name("memory.stat").read_text(encoding="ascii").split()
            cache = dict(zip(kept[::2], kept[1::2], strict=False))  # given back when needed
            yield most - now + int(cache.get("inactive_file", 0)) + int(cache.get("active_file", 0))


def _own() -> Iterator[int]:
    """What the limit on the address space (``ulimit -v``) leaves."""
    with suppress(ImportError, OSError):
        import resource

        most = resource.getrlimit(resource.RLIMIT_AS)[0]
        if most != resource.RLIM_INFINITY:
            pages = int(Path("/proc/self/statm").read_text(encoding="ascii").split()[0])
            yield most - pages * resource.getpagesize()
