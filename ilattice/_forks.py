"""Processes that are forked while other threads are at work.

Guarantee: children do not wait for attributes that another thread was making when they were forked.
Non-guarantee: locks of other libraries.
"""

import os
import sys
import threading
from functools import cached_property


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
