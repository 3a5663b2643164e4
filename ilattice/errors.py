"""The errors that `ilattice` raises on purpose.

::

    IlatticeError
    ├── InputError (ValueError)   an argument is wrong: which one, its value, the remedy
    ├── GeometryError             the input is well-formed, but its geometry cannot be used
    ├── ConvergenceError          a numerical method failed on more than the stated fraction
    └── FormatError               a file cannot be read or written as the named format

Guarantee: bad input ends in one of these, before anything on disk is touched.
"""


class IlatticeError(Exception):
    """Base class of every error raised on purpose."""


class InputError(IlatticeError, ValueError):
    """An argument is wrong; the message names it, its value and the remedy."""


class GeometryError(IlatticeError):
    """The input is well-formed, but its geometry cannot be used (folded map, no zero set)."""


class ConvergenceError(IlatticeError):
    """A numerical method failed on more points than the stated fraction."""


class FormatError(IlatticeError):
    """A file cannot be read or written as the named format."""


class PrecisionWarning(UserWarning):
    """The result is usable, but less accurate or less complete than asked."""
