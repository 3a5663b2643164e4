"""Solids as fields: one field that is negative in all level sets of a solid.

Guarantee: that of `intersection`. Non-guarantee: kinks where two level sets meet stay kinks.
"""

from typing import Any

from ilattice._field import Field
from ilattice._typing import Solid
from ilattice.errors import InputError
from ilattice.fields.algebra import intersection


def level_sets_of(solid: Solid) -> Any:
    """What a solid says that is negative in it.

    Parameters
    ----------
    solid : Solid
        A wall, or any other source with `level_sets`.

    Returns
    -------
    Field or pair of fields
        What `level_sets` gives.

    Raises
    ------
    InputError
        If it is a class, or has no such method.
    """
    given = solid.level_sets
    if isinstance(solid, type) or isinstance(given, Field) or not callable(given):
        raise InputError(f"a solid must be an object with a method level_sets(), got {solid!r:.60}")
    sets = given()
    if sets is None:
        raise InputError(f"level_sets() of {solid!r:.60} must give a field or a pair, got None")
    return sets


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
    sets = level_sets_of(solid)
    return intersection(*sets) if isinstance(sets, tuple | list) else sets
