"""Progress of long work: a bar on a terminal, a callable of yours, or nothing.

Guarantee: the items of the iterable pass through unchanged, in order. Nothing is written unless
`progress` is True and the standard error stream is a terminal. What a callable raises ends the work
and is passed on as it is.
"""

import sys
from collections.abc import Callable, Iterable, Iterator, Mapping
from typing import TypeVar

from ilattice.errors import InputError

T = TypeVar("T")
Progress = bool | Callable[[str, int, int], object] | None


def track(
    items: Iterable[T], label: str, progress: Progress = None, *, total: int | None = None
) -> Iterator[T]:
    """Yield from `items` and report how many are done.

    Parameters
    ----------
    items : iterable
        The work; `total` is needed where it has no length.
    label : str
        What is being done, for people.
    progress : bool or callable, optional
        True draws a bar if standard error is a terminal; a callable is called as
        ``progress(label, done, total)`` after each item; None and False do nothing.
    total : int, optional
        Number of items, by default ``len(items)``, or 0 (unknown) where there is no length.

    Yields
    ------
    object
        The items.
    """
    count = total if total is not None else _length(items)
    if not (progress is None or isinstance(progress, bool) or callable(progress)):
        raise InputError(f"progress must be True, False, None or a callable, got {progress!r:.80}")
    if callable(progress):
        for done, item in enumerate(items, 1):
            yield item
            progress(label, done, count)
    elif progress is True and sys.stderr is not None and sys.stderr.isatty():
        yield from _bar(items, label, count)
    else:
        yield from items


def staged(work: Mapping[str, Callable[[], T]], progress: Progress = None) -> list[T]:
    """Do one thing after the other, each under its name.

    Parameters
    ----------
    work : mapping of str to callable
        What is done, by what it is called, in order.
    progress : bool or callable, optional
        As for `track`: bars have the name while it is done, a callable is told after it.

    Returns
    -------
    list
        What they return.
    """
    return [do() for label, do in work.items() for _ in track((None,), label, progress)]


def _length(items: Iterable[T]) -> int:
    try:
        return len(items)  # type: ignore[arg-type]
    except TypeError:
        return 0


def _bar(items: Iterable[T], label: str, count: int) -> Iterator[T]:
    from rich.console import Console
    from rich.progress import track as rich_track

    console = Console(stderr=True)
    yield from rich_track(items, description=label, total=count or None, console=console)
