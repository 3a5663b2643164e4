"""What cells of periodic solids are given by: any field that repeats, and a grid closed all around.

Guarantee: fields that change their signs from a face of the cell to the opposite one, and phases
that meet there without a level set, are refused, with the largest jump and its place.
"""

import inspect
from collections.abc import Iterable
from typing import Any

import numpy as np

from ilattice._geometry import grid_points
from ilattice._typing import FloatArray
from ilattice._validate import as_counts, near_names
from ilattice.cutfem.assembly import constant_jacobian
from ilattice.cutfem.domain import Domain
from ilattice.cutfem.phases import PhasedDomain
from ilattice.errors import InputError
from ilattice.lattice import Lattice, Wall
from ilattice.macroshape.cells import CellMap, cell
from ilattice.macroshape.maps import SplineMap
from ilattice.offsets.solid import TileSolid
from ilattice.quadrature.cutting import CutGrid, cut
from ilattice.quadrature.grid import OUT, Grid
from ilattice.quadrature.making import rule_on
from ilattice.quadrature.rules import NAMES
from ilattice.tiles.catalog import get
from ilattice.tiles.mixture import Mixture
from ilattice.tiles.tile import Tile

#: Points per direction at which opposite faces of a cell are compared, and by what part of its
#: largest value there a field may jump between them.
COMPARED, JUMP = 33, 1e-3
#: Points per direction of rules on faces of the cell, and the part of what is solid on one of them,
#: or of the area of a cell there, that may have no solid across.
ON_FACES, MISSED = 8, 0.01
EDGES = "uvw"
#: Straight bars, and their copies, up to which a cell is cut as it is.
BARS = 1000


def check_options(name: str, options: Iterable[str], *takers: Any) -> None:
    """Refuse options that none of some functions has.

    Parameters
    ----------
    name : str
        What was called, for the message.
    options : iterable of str
        Names that were given.
    *takers : callable
        Functions that take them by name.

    Raises
    ------
    InputError
        With the names that are like it.
    """
    known = [
        p.name
        for f in takers
        for p in inspect.signature(f).parameters.values()
        if p.kind is p.KEYWORD_ONLY
    ]
    wrong = sorted(set(options) - set(known))
    if wrong:
        near = near_names(wrong[0], list(dict.fromkeys(known)))
        raise InputError(f"{name} has no option {wrong[0]!r:.60}; names like it: {near}")


def as_cell(field: Any, cells: Any, *, domain: Any = None, through: Any = None) -> CutGrid | Domain:
    """A cell of a periodic solid on a grid that is closed in all directions.

    Parameters
    ----------
    field : Wall, Tile, str, BSpline, Node, callable, pair of these, CutGrid or Domain
        The solid; see `ilattice.homogenize.elastic`.
    cells : int, sequence of 3 int or Grid
        Background grid.
    domain : array_like, shape (2, 3), optional
        The box that repeats; by default the unit cube.
    through : CellMap, optional
        Affine map to space.

    Returns
    -------
    CutGrid or Domain
        The level sets on the grid.

    Raises
    ------
    InputError
        If an argument is wrong, or the field does not repeat.
    """
    if isinstance(field, (CutGrid, Domain)):
        grid = field.grid if isinstance(field, CutGrid) else field.cut.grid
        if not all(grid.closed):
            raise InputError(f"field: its grid must be closed in all directions, got {grid.closed}")
        return field
    if isinstance(field, np.ndarray):
        raise InputError(
            f"field is an array, shape {field.shape}: voxels are for il.homogenize.voxels, or "
            "conductive_voxels"
        )
    field, through = _as_solid(field, through)
    if through is not None and not isinstance(through, CellMap):
        affine = isinstance(through, SplineMap) and constant_jacobian(through) is not None
        if not affine:
            raise InputError(
                f"through must be a cell that repeats, of il.macroshape.cell(), got {through!r:.80}"
            )
    if isinstance(cells, Grid):
        grid = Grid(cells.axes, (True,) * 3)
    else:
        box = np.array([[0.0] * 3, [1.0] * 3]) if domain is None else np.asarray(domain, float)
        if domain is None and through is not None:
            box = through.domain
        if box.shape != (2, 3) or not (box[0] < box[1]).all():
            raise InputError(f"domain must be a lower and an upper corner, got {domain!r:.80}")
        if through is not None and _leaves(box, through.domain):
            raise InputError(
                f"domain leaves that of through, {through.domain.tolist()}, got {domain!r:.80}; "
                "leave it out: lengths are those of the edges of through"
            )
        counts = as_counts("cells", cells)
        x, y, z = (np.linspace(box[0, a], box[1, a], counts[a] + 1) for a in range(3))
        grid = Grid((x, y, z), (True,) * 3)
    bars = field.bars(BARS) if isinstance(field, TileSolid) else None
    out = cut(field if bars is None else bars, grid, through=through)
    check_repeats(out, field)
    return out


def _leaves(box: FloatArray, other: FloatArray) -> bool:
    """Whether a box (2, 3) reaches beyond another one."""
    slack = 1e-9 * np.ptp(other, axis=0)
    return bool((box[0] < other[0] - slack).any() or (box[1] > other[1] + slack).any())


def _as_solid(field: Any, through: Any) -> tuple[Any, Any]:
    """What is cut, and its map."""
    if isinstance(field, str):
        try:
            field = get(field)
        except InputError as e:
            raise InputError(
                f"field: {e}; a field is the name of a tile, or made of an equation by "
                "il.fields.equation"
            ) from e
    if isinstance(field, Tile):
        through = cell(field.cell) if through is None else through
        field = Lattice(field, through=through).offset((np.inf, 0.0))
    if isinstance(field, (Lattice, Mixture)):
        raise InputError(
            "field must be a solid: give a lattice through il.macroshape.cell() a thickness by "
            f".offset(...), got {field!r:.80}"
        )
    if isinstance(field, Wall):
        if through is not None and through is not field.lattice.through:
            raise InputError("through: a wall has its own map; make the lattice through the cell")
        return field, field.lattice.through
    return field, through


def check_repeats(solid: CutGrid, field: Any) -> None:
    """Refuse a field whose opposite faces do not fit together.

    Parameters
    ----------
    solid : CutGrid
        Level sets on the grid.
    field : object
        What they come from.

    Raises
    ------
    InputError
        With the largest jump, and its place.
    """
    tile = getattr(getattr(field, "lattice", None), "tile", None)
    sets: list[Any] = [solid.sets]
    if isinstance(tile, Tile):
        lattice = field.lattice
        sets.append(lambda u: tile(lattice._in_tile(lattice.tile_coordinates(u)))[:, None])
    _refuse_jumps("field", sets, solid)
    _refuse_ends("field", solid)


def check_phases(domain: Domain) -> None:
    """Refuse phases that meet on faces of the cell, where no level set joins them.

    Parameters
    ----------
    domain : Domain
        Of one phase or two.

    Raises
    ------
    InputError
        With the largest jump of the level set, and its place.
    """
    if isinstance(domain, PhasedDomain):
        level, solid = domain.level, domain.cut
        _refuse_jumps("phases", [lambda u: level(u)[:, None]], solid)
        for phase in domain.phases:
            _refuse_ends("phases", phase)


def _refuse_ends(name: str, solid: CutGrid) -> None:
    """Refuse a solid that reaches a face of the cell where it does not reach the opposite one."""
    grid = solid.grid
    (lo, hi), some = grid.domain, np.flatnonzero(solid.status != OUT)
    for face in NAMES:
        axis, side = divmod(NAMES.index(face), 2)
        rule = rule_on(solid, face, some, ON_FACES)
        if not len(rule):
            continue
        u = rule.points.copy()
        u[:, axis] = (hi, lo)[side][axis]
        missed = rule.weights * (solid.sets(u).max(axis=1) > 0.0)
        area = np.delete(grid.boxes(rule.cells)[:, 3:], axis, axis=1).prod(axis=1)
        part = np.bincount(rule.owners, missed, len(rule.cells)) / area
        whole = float(missed.sum() / rule.weights.sum())
        if max(whole, part.max()) > MISSED:
            told = ", ".join(f"{c:.4g}" for c in rule.points[missed.argmax()])
            raise InputError(
                f"{name} does not repeat: {100 * whole:.2g} % of the solid on the face {face} have "
                f"none across, on {EDGES[axis]}={1 - side}, such as at ({told}); give one that is "
                "the same on opposite faces"
            )


def _refuse_jumps(name: str, sets: list[Any], solid: CutGrid) -> None:
    """Refuse functions (n, sets) that change their signs from a face of the cell to the other."""
    lo, hi = solid.grid.domain
    s = np.linspace(0.0, 1.0, COMPARED)[:-1] + 0.31 / COMPARED
    flat = grid_points(s, s)
    ends = np.zeros((3, 2, len(flat), 3))
    for a in range(3):
        ends[a] = np.insert(flat, a, 0.0, axis=1) * (hi - lo) + lo
        ends[a, 1, :, a] = hi[a]
    worst, place, axis = 0.0, lo, 0
    for f in sets:
        values = f(ends.reshape(-1, 3)).reshape(3, 2, len(flat), -1)
        scale = np.maximum(np.abs(values).max(axis=(0, 1, 2)), 1e-300)
        first, last = values[:, 0], values[:, 1]
        jump = np.where((first < 0) != (last < 0), np.abs(first - last) / scale, 0.0).max(axis=2)
        if jump.max() > worst:
            axis, i = (int(k) for k in np.unravel_index(jump.argmax(), jump.shape))
            worst, place = float(jump.max()), ends[axis, 0, i]
    if worst > JUMP:
        told = ", ".join(f"{c:.4g}" for c in place)
        raise InputError(
            f"{name} does not repeat: between the faces {EDGES[axis]}=0 and {EDGES[axis]}=1 it "
            f"jumps by up to {worst:.2g} of its largest value on them, at ({told}); give one that "
            "is the same on opposite faces"
        )
