"""Ready tiles of struts, plates and walls: rows of data, and how a row becomes a tile.

A row lists struts by their ends, or by nodes and the length of the struts between them; plates by
their corners; walls as lines of a plane, extruded. Struts in one line count as one, so that the
smooth union leaves no bulge on them.

Guarantee, held by tests: rows marked periodic repeat exactly. Not guaranteed: plate cells enclose
voids, which trap powder or resin.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations, permutations, product
from typing import Any

import numpy as np

from ilattice._shown import Shown
from ilattice._typing import FloatArray
from ilattice._validate import as_positive
from ilattice.bspline import BSpline
from ilattice.errors import InputError
from ilattice.tiles.entities import Arc, Curve, Entity, Group, Patch, Polyline, Surface
from ilattice.tiles.skeleton import skeleton
from ilattice.tiles.tile import Tile

HONG = "Hong et al. 2025"
USUAL = "common strut cell"
PLATES = "common plate cell"
HONEYCOMB = "common honeycomb"
Point = tuple[float, ...]
Line = tuple[Point, Point]


@dataclass(frozen=True, kw_only=True)
class CellRow(Shown):
    """One cell of the library.

    Attributes
    ----------
    name, aliases
        Identifier and what else it is called.
    lines
        Struts as pairs of ends, in coordinates of the unit cube.
    nodes, length
        Struts between all nodes that are `length` apart.
    plates
        Corners of plates.
    walls
        Lines (x, y) to (x, y) of walls along z.
    rings
        Circles about the z-axis: centre and size.
    curves
        Control points of clamped cubic curves.
    surface
        Control points of a biquadratic surface.
    cell
        Lengths of the edges of the cell.
    faces
        As in `skeleton`.
    radius
        Default radius: half the thickness.
    blend
        Default width of the smooth union, as a share of the radius.
    note, source
        What to know, and where it is from.
    """

    name: str
    aliases: tuple[str, ...] = ()
    lines: tuple[Line, ...] = ()
    nodes: tuple[Point, ...] = ()
    length: float = 0.0
    plates: tuple[tuple[Point, ...], ...] = ()
    walls: tuple[Line, ...] = ()
    rings: tuple[tuple[Point, float], ...] = ()
    curves: tuple[tuple[Point, ...], ...] = ()
    surface: tuple[tuple[Point, ...], ...] = ()
    cell: tuple[float, float, float] = (1.0, 1.0, 1.0)
    faces: str | dict[str, str] = "periodic"
    radius: float = 0.08
    blend: float = 0.5
    note: str = ""
    source: str = USUAL


#: Halves, for the tables.
H = 0.5
ROOT3 = 3.0**0.5
CORNERS: tuple[Point, ...] = tuple(product((0.0, 1.0), repeat=3))
CENTRES: tuple[Point, ...] = tuple(
    p for p in product((0.0, H, 1.0), repeat=3) if sum(v == H for v in p) == 2
)
EDGES: tuple[Point, ...] = tuple(
    p for p in product((0.0, H, 1.0), repeat=3) if sum(v == H for v in p) == 1
)
_DIAGONALS: tuple[Line, ...] = (
    ((0, 0, 0), (1, 1, 0)), ((1, 0, 0), (0, 1, 0)), ((0, 0, 0), (1, 0, 1)),
    ((1, 0, 0), (0, 0, 1)), ((0, 0, 0), (0, 1, 1)), ((0, 1, 0), (0, 0, 1)),
)  # fmt: skip
_PYROCHLORE: tuple[Point, ...] = tuple(
    p
    for p in product((0.0, 0.25, H, 0.75, 1.0), repeat=3)
    if any(
        all((a - b - c) % 1.0 == 0.0 for a, b, c in zip(p, site, shift, strict=True))
        for site in ((0, 0, 0), (0.25, 0.25, 0), (0.25, 0, 0.25), (0, 0.25, 0.25))
        for shift in ((0, 0, 0), (H, H, 0), (H, 0, H), (0, H, H))
    )
)


def _bow_tie(b: float) -> tuple[Line, ...]:
    """Walls of a honeycomb with vertical walls of half-length b: re-entrant for b > 1/4."""
    return (
        ((H, H - b), (H, H + b)),
        ((0.0, 0.0), (0.0, b)), ((0.0, 1.0 - b), (0.0, 1.0)),
        ((0.0, b), (H, H - b)), ((1.0, b), (H, H - b)),
        ((0.0, 1.0 - b), (H, H + b)), ((1.0, 1.0 - b), (H, H + b)),
    )  # fmt: skip


def _re_entrant(b: float) -> tuple[Line, ...]:
    """Struts of the re-entrant cell: posts of half-length b, joined by inclined struts."""
    low: tuple[Line, ...] = tuple(((i, j, b), (H, H, H - b)) for i in (0, 1) for j in (0, 1))
    high: tuple[Line, ...] = tuple(((i, j, 1.0 - b), (H, H, H + b)) for i in (0, 1) for j in (0, 1))
    posts: tuple[Line, ...] = (
        ((H, H, H - b), (H, H, H + b)), ((0, 0, 0), (0, 0, b)), ((0, 0, 1 - b), (0, 0, 1)),
    )  # fmt: skip
    return posts + low + high


def _tetrachiral(size: float) -> tuple[Line, ...]:
    """Ligaments tangent to a ring and its neighbours, and posts where they touch it."""
    sine, cosine = 2.0 * size, (1.0 - 4.0 * size * size) ** 0.5
    touch, end = (size * sine, size * cosine), (H, 0.0)
    out: list[Line] = []
    for _ in range(4):
        out.append(((H + touch[0], H + touch[1], H), (H + end[0], H + end[1], H)))
        out.append(((H + touch[0], H + touch[1], 0.0), (H + touch[0], H + touch[1], 1.0)))
        touch, end = (-touch[1], touch[0]), (-end[1], end[0])
    return tuple(out)


def _arms() -> tuple[tuple[Point, ...], ...]:
    """Ten curved arms from the middle: to the eight corners, and to two opposite faces."""
    out: list[tuple[Point, ...]] = []
    for c in CORNERS:
        d = np.array(c) - H
        side = np.array([-d[1], d[0], 0.0])
        rows = np.array([[H, H, H], H + 0.35 * d + 0.5 * side, H + 0.7 * d + 0.15 * side, c])
        out.append(tuple(map(tuple, rows.tolist())))
    out.append(((H, H, H), (0.62, H, 0.325), (H, 0.38, 0.3), (H, H, 0.0)))
    out.append(((H, H, H), (0.62, H, 0.675), (H, 0.38, 0.7), (H, H, 1.0)))
    return tuple(out)


CELLS: tuple[CellRow, ...] = (
    CellRow(
        name="ten_arms", aliases=("joint",), curves=_arms(), radius=0.1,
        note="The corners are octants of a joint with seven other tiles.",
        source=f"{HONG}, Figure 1 (a, b)",
    ),
    CellRow(
        name="curve_and_surface", radius=0.06,
        curves=(((H, H, 0.0), (0.0, 0.3, 0.35), (1.0, 0.7, 0.65), (H, H, 1.0)),),
        surface=(
            ((0.0, 0.0, 0.35), (0.0, 0.5, 0.75), (0.0, 1.0, 0.35)),
            ((0.5, 0.0, 0.65), (0.5, 0.5, 0.25), (0.5, 1.0, 0.65)),
            ((1.0, 0.0, 0.35), (1.0, 0.5, 0.75), (1.0, 1.0, 0.35)),
        ),
        note="Both go on in the neighbours.", source=f"{HONG}, Figure 1 (c)",
    ),
    CellRow(
        name="cross", aliases=("cross_3d", "3d_cross"), radius=0.12,
        lines=(((0, H, H), (1, H, H)), ((H, 0, H), (H, 1, H)), ((H, H, 0), (H, H, 1))),
        note="The simple cubic cell, its node in the middle.", source=f"{HONG}, Figure 10",
    ),
    CellRow(
        name="four_lines",
        lines=(
            ((0, 0.25, H), (1, 0.25, H)), ((0, 0.75, H), (1, 0.75, H)),
            ((H, 0, H), (H, 1, H)), ((H, H, 0), (H, H, 1)),
        ),
        note="Two of the lines are parallel.", source=f"{HONG}, Figure 4",
    ),
    CellRow(
        name="sc_struts", aliases=("simple_cubic", "cubic"),
        lines=(((0, 0, 0), (1, 0, 0)), ((0, 0, 0), (0, 1, 0)), ((0, 0, 0), (0, 0, 1))),
    ),
    CellRow(
        name="bcc_struts",
        lines=tuple(((*p[:2], 0.0), (1 - p[0], 1 - p[1], 1.0)) for p in product((0, 1), repeat=2)),
    ),
    CellRow(name="fcc_struts", aliases=("fcc",), lines=_DIAGONALS, radius=0.06),
    CellRow(
        name="octet", aliases=("octet_truss",), nodes=CORNERS + CENTRES, length=H**0.5, radius=0.05,
    ),
    CellRow(
        name="kelvin", aliases=("kelvin_foam", "truncated_octahedron"), length=H**1.5, radius=0.05,
        nodes=tuple(
            sorted({
                tuple(H + v for v in p)
                for a, b in product((-0.25, 0.25), (-H, H))
                for p in permutations((0.0, a, b))
            })
        ),
    ),
    CellRow(
        name="diamond_struts", aliases=("diamond_lattice",), length=ROOT3 / 4, radius=0.06,
        nodes=(
            *CORNERS, *CENTRES, (0.25, 0.25, 0.25), (0.75, 0.75, 0.25), (0.75, 0.25, 0.75),
            (0.25, 0.75, 0.75),
        ),
    ),
    CellRow(name="cuboctahedron", nodes=EDGES, length=H**0.5, radius=0.06),
    CellRow(
        name="re_entrant", aliases=("auxetic", "re_entrant_auxetic"), lines=_re_entrant(0.35),
        radius=0.04, note="Negative Poisson's ratio along z.",
    ),
    CellRow(
        name="chiral", aliases=("tetrachiral",), lines=_tetrachiral(0.22), radius=0.04,
        rings=(((H, H, H), 0.22),),
        note="Rings with four tangent ligaments in layers, joined by posts.",
    ),
    CellRow(
        name="pyramidal", lines=tuple(((*p, 0.0), (H, H, 1.0)) for p in product((0, 1), repeat=2)),
        faces={"x": "periodic", "y": "periodic", "z": "open"}, radius=0.06,
        note="One layer between face sheets; it does not repeat along z.",
    ),
    CellRow(
        name="kagome", aliases=("kagome_3d", "pyrochlore"), nodes=_PYROCHLORE, length=H**1.5,
        radius=0.035, note="The three-dimensional Kagome net: tetrahedra that share corners.",
    ),
    CellRow(
        name="sc_plates", radius=0.05, source=PLATES,
        plates=(
            ((0, 0, 0), (0, 1, 0), (0, 1, 1), (0, 0, 1)),
            ((0, 0, 0), (1, 0, 0), (1, 0, 1), (0, 0, 1)),
            ((0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0)),
        ),
        note="Closed cells.",
    ),
    CellRow(
        name="bcc_plates", radius=0.03, source=PLATES,
        plates=(
            ((0, 0, 0), (1, 1, 0), (1, 1, 1), (0, 0, 1)),
            ((1, 0, 0), (0, 1, 0), (0, 1, 1), (1, 0, 1)),
            ((0, 0, 0), (1, 0, 1), (1, 1, 1), (0, 1, 0)),
            ((1, 0, 0), (0, 0, 1), (0, 1, 1), (1, 1, 0)),
            ((0, 0, 0), (0, 1, 1), (1, 1, 1), (1, 0, 0)),
            ((0, 1, 0), (0, 0, 1), (1, 0, 1), (1, 1, 0)),
        ),
        note="Closed cells.",
    ),
    CellRow(
        name="fcc_plates", aliases=("octet_plates",), radius=0.03, source=PLATES,
        plates=tuple(
            tuple(tuple(1 - c if i == j else c for j, c in enumerate(p)) for i in range(3))
            for p in product((0, 1), repeat=3)
        ),
        note="Closed cells.",
    ),
    CellRow(
        name="hexagonal_honeycomb", aliases=("honeycomb",), walls=_bow_tie(1 / 6), radius=0.05,
        cell=(1.0, ROOT3, 1.0), source=HONEYCOMB, note="Two columns of hexagons in a 1 by √3 cell.",
    ),
    CellRow(
        name="re_entrant_honeycomb", aliases=("bow_tie_honeycomb",), walls=_bow_tie(0.35),
        radius=0.03, source=HONEYCOMB, note="Negative Poisson's ratio in the plane.",
    ),
    CellRow(
        name="square_honeycomb", walls=(((0, H), (1, H)), ((H, 0), (H, 1))), radius=0.05,
        source=HONEYCOMB,
    ),
    CellRow(
        name="triangular_honeycomb",
        walls=(((0, 0), (1, 0)), ((0, H), (1, H)), ((0, 0), (1, 1)), ((1, 0), (0, 1))),
        cell=(1.0, ROOT3, 1.0), radius=0.04, source=HONEYCOMB, note="In a 1 by √3 cell.",
    ),
)  # fmt: skip


def make(
    row: CellRow,
    *,
    radius: float | None = None,
    thickness: float | None = None,
    blend: float | None = None,
    faces: Any = None,
) -> Tile:
    """Tile of a row.

    Parameters
    ----------
    row : CellRow
        The row.
    radius : float, optional
        Radius of struts, half the thickness of plates and walls; default that of the row.
    thickness : float, optional
        Twice the radius, instead of it.
    blend : float, optional
        Width of the smooth union; default a share of the radius. 0 joins sharply.
    faces : str or mapping, optional
        As in `skeleton`; default that of the row.

    Returns
    -------
    Tile
        The tile.

    Raises
    ------
    InputError
        If both radius and thickness are given, or an argument is out of range.
    GeometryError
        If the solid fills the cell.
    """
    if radius is not None and thickness is not None:
        raise InputError("radius and thickness say the same: give one of them")
    r = row.radius if radius is None else as_positive("radius", radius)
    if thickness is not None:
        r = 0.5 * as_positive("thickness", thickness)
    return skeleton(
        entities(row),
        radius=r,
        blend=row.blend * r if blend is None else blend,
        faces=row.faces if faces is None else faces,
        cell=row.cell,
        name=row.name,
        source=row.source,
    )


def entities(row: CellRow) -> list[Entity]:
    """Curves and surfaces of a row, in lengths of its cell.

    Parameters
    ----------
    row : CellRow
        The row.

    Returns
    -------
    list of Entity
        Struts in one line are grouped.
    """
    size = np.array(row.cell)
    struts = [np.array(line, np.float64) for line in row.lines]
    struts += _between(row.nodes, row.length)
    walls = [np.array([(*p, 0.5) for p in w]) for w in row.walls]
    out: list[Entity] = [Group([Polyline(a * size) for a in line]) for line in _aligned(struts)]
    out += [Group([Patch(_extruded(a) * size) for a in line]) for line in _aligned(walls)]
    out += [Patch(np.array(p) * size) for p in row.plates]
    out += [Arc(np.array(c) * size, *(ring * np.eye(3)[:2])) for c, ring in row.rings]
    cubic = [0.0] * 4 + [1.0] * 4
    out += [Curve(BSpline([cubic], np.array(c) * size, 3)) for c in row.curves]
    if row.surface:
        square = [0.0] * 3 + [1.0] * 3
        out.append(Surface(BSpline([square] * 2, np.array(row.surface) * size, 2)))
    return out


def _extruded(line: FloatArray) -> FloatArray:
    """Corners of the wall over a line at half the height."""
    low, high = line.copy(), line[::-1].copy()
    low[:, 2], high[:, 2] = 0.0, 1.0
    return np.concatenate([low, high])


def _between(nodes: Sequence[Point], length: float) -> list[FloatArray]:
    """Struts between nodes that are a length apart, those that are images of others left out."""
    out: dict[tuple[int, ...], FloatArray] = {}
    for a, b in combinations(nodes, 2):
        line = np.array([a, b], np.float64)
        if abs(np.linalg.norm(line[1] - line[0]) - length) < 1e-9:
            out.setdefault(_modulo(line.sum(axis=0), 2.0) + _direction(line), line)
    return list(out.values())


def _modulo(p: FloatArray, period: float = 1.0) -> tuple[int, ...]:
    """Point up to whole cells, as integers that can be compared."""
    return tuple(int(v) for v in np.rint(np.mod(np.rint(p * 1e9), period * 1e9)))


def _direction(line: FloatArray) -> tuple[int, ...]:
    """Direction up to length and sign, as integers that can be compared."""
    d = line[1] - line[0]
    d = np.rint(d / np.linalg.norm(d) * 1e6)
    return tuple(int(v) for v in (d if tuple(d) > (0.0, 0.0, 0.0) else -d))


def _aligned(lines: Sequence[FloatArray]) -> list[list[FloatArray]]:
    """Lines in groups of those that continue each other, whole cells apart or not."""
    group = list(range(len(lines)))
    owner: dict[tuple[int, ...], int] = {}
    for i, line in enumerate(lines):
        for end in line:
            j = owner.setdefault(_modulo(end) + _direction(line), i)
            old, new = group[i], group[j]
            group = [new if g == old else g for g in group]
    return [[a for a, g in zip(lines, group, strict=True) if g == k] for k in sorted(set(group))]
