"""What an object is to writers: the kind that its class declares, whatever its name.

Guarantee: only the class is asked, so that classes themselves, and objects that answer to every
name, are of no kind. What the kinds are, and what writers ask of each, is told by
`ilattice.io.save`.
"""

from typing import Any


def kind_of(obj: Any) -> str:
    """The kind that the class of an object declares as its ``file_kind``; "" if it does not."""
    kind = getattr(type(obj), "file_kind", "")
    return kind if isinstance(kind, str) else ""
