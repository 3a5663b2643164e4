"""Names of the catalogue and the tiles they stand for: surfaces by equations, cells by skeletons.

Guarantee: names and aliases are found whatever their case, with ``-``, ``_`` and blanks taken for
equal; no two entries share a name. An equation is expanded when first asked for.
"""

from collections.abc import Callable
from functools import cache
from typing import Any

from ilattice._validate import as_array, near_names
from ilattice.errors import GeometryError, InputError
from ilattice.tiles.cells import CELLS, CellRow, make
from ilattice.tiles.tile import Tile
from ilattice.tiles.tpms import ROWS, Row
from ilattice.tiles.trig import TrigField

_SAME = str.maketrans({"-": "_", " ": "_", "\N{MINUS SIGN}": "_", "\N{EN DASH}": "_"})


def _key(name: str) -> str:
    return name.strip().lower().translate(_SAME)


_ALL: tuple[Row | CellRow, ...] = (*ROWS, *CELLS)
_BY_KEY: dict[str, Row | CellRow] = {_key(n): row for row in _ALL for n in (row.name, *row.aliases)}


def names() -> list[str]:
    """Identifiers of all tiles, sorted.

    Returns
    -------
    list of str
        One name per tile; aliases are in `row`.
    """
    return sorted(row.name for row in _ALL)


def row(name: str) -> Row | CellRow:
    """What the catalogue knows of a tile.

    Parameters
    ----------
    name : str
        Identifier or alias.

    Returns
    -------
    Row or CellRow
        Of a surface: equation, aliases, symmetry, Euler number, volume fraction, flags and source.
        Of a cell: struts, plates and walls, aliases, default radius and source.

    Raises
    ------
    InputError
        If there is no such tile; the message lists near names.
    """
    if not isinstance(name, str):
        raise InputError(f"a tile's name must be a string, got {name!r:.80}")
    if not name.strip():
        raise InputError("a tile's name is empty; il.tiles.names() lists all")
    found = find(name)
    if found is None:
        raise InputError(
            f"no tile is called {name!r}; near names: {near_names(_key(name), sorted(_BY_KEY))}; "
            "il.tiles.names() lists all"
        )
    return found


def find(name: str) -> Row | CellRow | None:
    """What the catalogue knows of a tile, or None.

    Parameters
    ----------
    name : str
        Identifier or alias.

    Returns
    -------
    Row, CellRow or None
        As `row`; None where that raises.
    """
    return _BY_KEY.get(_key(name))


@cache
def _field(name: str) -> TrigField:
    """Field of a row, expanded once."""
    r = _BY_KEY[name]
    assert isinstance(r, Row)
    return TrigField.parse(r.equation)


def get(name: str, *, level: float | None = None, **shape: Any) -> Tile:
    """Tile of the catalogue.

    Parameters
    ----------
    name : str
        Identifier or alias.
    level : float, optional
        Level of the surface; default that of the catalogue, which is zero for most.
    **shape
        Of cells: `radius` or `thickness`, `blend` and `faces`, see `ilattice.tiles.cells.make`.

    Returns
    -------
    Tile
        The tile; the solid is where the equation is at most `level`.

    Raises
    ------
    InputError
        If there is no such tile, the level is not a number, or an option belongs to the other
        kind of tile.
    GeometryError
        If the level lies outside the range of the equation.
    """
    r = row(name)
    if isinstance(r, CellRow):
        if level is not None:
            raise InputError(f"tile {r.name!r} has no level: give its radius or thickness")
        return make(r, **shape)
    if shape:
        raise InputError(f"tile {r.name!r} has no {', '.join(shape)}: give its level")
    value = as_array("level", r.level if level is None else level)
    if value.size != 1:
        raise InputError(f"level must be one number, got {level!r:.80}")
    at = float(value.ravel()[0])
    low, high = r.range
    if not low < at < high:
        raise GeometryError(
            f"tile {r.name!r} has no zero set at level {at:g}: its values run from {low:g} to "
            f"{high:g}; choose a level between"
        )
    return Tile(
        _field(r.name),
        name=r.name,
        level=at,
        source=r.source,
        singular_at_zero=r.singular_at_zero and at == 0.0,
        hexagonal=r.hexagonal,
        disconnected=r.disconnected,
        symmetric=r.cyclic,
        check=False,
    )


def maker(name: str) -> Callable[..., Tile]:
    """Function that makes one tile: ``gyroid(level=0.1)``, ``octet(radius=0.05)``.

    Parameters
    ----------
    name : str
        Identifier or alias.

    Returns
    -------
    callable
        Takes the keyword `level`, or those of `ilattice.tiles.cells.make`; returns a `Tile`.

    Raises
    ------
    InputError
        If there is no such tile.
    """
    r = row(name)
    if isinstance(r, CellRow):
        return _cell_maker(name, r)

    def surface(*, level: float | None = None) -> Tile:
        return get(r.name, level=level)

    surface.__name__ = surface.__qualname__ = name
    surface.__doc__ = (
        f"Tile {r.name!r}: {{{r.equation} <= level}}, default level {r.level:g}.\n\n"
        f"Source: {r.source}. {r.note}".rstrip()
    )
    return surface


def _cell_maker(name: str, r: CellRow) -> Callable[..., Tile]:
    """Function that makes one cell: ``octet(radius=0.1)``."""

    def cell(
        *,
        radius: float | None = None,
        thickness: float | None = None,
        blend: float | None = None,
        faces: Any = None,
    ) -> Tile:
        return make(r, radius=radius, thickness=thickness, blend=blend, faces=faces)

    cell.__name__ = cell.__qualname__ = name
    cell.__doc__ = (
        f"Tile {r.name!r}: struts or plates of the given radius, default {r.radius:g}.\n\n"
        f"Options as in `ilattice.tiles.cells.make`. Source: {r.source}. {r.note}".rstrip()
    )
    return cell


def identifiers() -> list[str]:
    """Names and aliases that can be typed as attributes, sorted.

    Returns
    -------
    list of str
        Valid Python identifiers among names and aliases.
    """
    return sorted(k for k in _BY_KEY if k.isidentifier())
