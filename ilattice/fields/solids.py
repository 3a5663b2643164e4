"""Solids as fields: one field that is negative in all level sets of a solid.

Guarantee: that of `intersection`. Non-guarantee: kinks where two level sets meet stay kinks.
"""

from typing import Any

from ilattice._typing import Solid
from ilattice.fields.algebra import intersection


def field_of(solid: Solid) -> Any:
    """What is negative in a solid, over its parameters.

    Parameters
    ----------
    solid : Solid
        A wall, or any other source with `level_sets`.

    Returns
    -------
    Field
        Its level set, or the largest of a pair.
    """
    sets = solid.level_sets()
    return intersection(*sets) if isinstance(sets, tuple | list) else sets
