"""Tiles from curves and surfaces: least distance minus radius, joined sharply or smoothly.

Per entity q with radius r_q the field is ``a_q(x) = min over its points p of |x - p| - r_q(p)``:
for a constant radius the distance to the entity minus the radius, for a varying one the envelope of
the balls. The sharp union is the least of them. The smooth union of width k is
``min over w >= 0, sum w = 1 of sum_q w_q a_q + k/2 (sum_q w_q² - 1)``: once continuously
differentiable, the least a_q exactly where no other is within k of it, and never below that by
more than ``k/2 (1 - 1/n)`` where n are within k. An entity, its images and its continuations count
as one.

Guarantees: a_q is the least over all stationary points, corners, ends and boundaries, found by
subdivision with proven bounds, to 1e-12 in units of the tile; gradients (convex combinations of
unit vectors) have at most length one, and length one where only one foot is nearest; `range` is
rigorous; building takes at most 1 kB per piece or copy in a periodic cell, half of which stays, and
no object each. Non-guarantees: second derivatives do not exist where two feet are equally near, and
first ones there only if the union is smooth and the feet are on two entities; on a skeleton itself
derivatives are set to zero. With a varying radius or unequal weights the last bits depend on what
points are asked for together.

Source: Hong et al. 2025, section 3.1.
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from itertools import pairwise, product
from typing import Any

import numpy as np

from ilattice._field import Field
from ilattice._geometry import grid_points
from ilattice._typing import AnyArray, ArrayLike, FloatArray
from ilattice._validate import (
    Frozen,
    among,
    as_array,
    as_points,
    as_positive,
    as_real,
    as_triple,
    read_only,
)
from ilattice.errors import GeometryError, InputError
from ilattice.tiles._copies import copies, covering_radius
from ilattice.tiles._given import as_entities
from ilattice.tiles._kernels_skeleton import Tree, skeleton_jets
from ilattice.tiles._piece_arrays import Pieces
from ilattice.tiles._pieces import Part, pieces_of
from ilattice.tiles.entities import (
    Arc,
    Ball,
    Entity,
    Group,
    Patch,
    Polyline,
    Segments,
    Triangles,
)
from ilattice.tiles.flattened import FlattenedField, points_of_grid
from ilattice.tiles.tile import Tile

FACES = ("x-", "x+", "y-", "y+", "z-", "z+")
KINDS = ("open", "closed", "periodic")
#: About how many pieces tell how far from its pieces a cell is anywhere.
MANY = 10_000
#: Points along the edges of faces at which distances are bounded.
_FACE = 16
#: How far outside the tile an entity may be, and what counts as on a face, in tile coordinates.
ON_FACE = 1e-9
#: Error of the spline approximation of a skeleton, relative to its smallest radius.
SPLINE_ERROR = 0.01


@dataclass(frozen=True, eq=False, repr=False)
class SkeletonField(Field, Frozen):
    """Distance to curves and surfaces minus their radii, negative inside.

    Parameters
    ----------
    entities : sequence of Entity, BSpline or array_like of shape (n, 3)
        Curves and surfaces in lengths of the cell; plain points are a polyline. An array (n, 2, 3)
        is n segments; these, and pairs of points that follow each other, are kept as one
        `Segments`.
    radius : float, optional
        Radius of entities that have none of their own: half the thickness of arms and plates.
    blend : float
        Width of the smooth union of the entities; 0 joins them sharply.
    faces : str or mapping
        "open", "closed" or "periodic" for all faces, or per axis ("x") or face ("x-", "x+").
        Ends on an open face are continued straight through it; a closed face cuts the solid
        there; across periodic faces the entities repeat, and may leave the cell. In a lattice,
        open ends must meet others of the same radius on the opposite face, or tiles do not fit
        together; the rim of a closed face is an edge, which the spline approximation of the tile
        rounds off.
    cell : array_like of shape () or (3,) or (3, 3)
        Edges of the cell: lengths, or vectors as columns. Points of the unit cube stand for
        ``cell @ u``.

    Raises
    ------
    InputError
        If there is no entity, one leaves the cell through a face that is not periodic, a radius is
        missing or not positive, or `faces` contradicts itself.
    """

    entities: Sequence[Any] | AnyArray
    radius: Any = None
    blend: float = 0.0
    faces: Any = "open"
    cell: Any = 1.0
    _items: tuple[range, ...] = field(init=False)

    def __post_init__(self) -> None:
        put = object.__setattr__
        entities, items = as_entities(self.entities)
        put(self, "entities", entities)
        put(self, "_items", items)
        if self.radius is not None:
            put(self, "radius", as_positive("radius", self.radius))
        blend = as_array("blend", self.blend)
        if blend.size != 1 or not blend.ravel()[0] >= 0.0:
            raise InputError(f"blend must be zero or positive, got {self.blend!r:.80}")
        put(self, "blend", float(blend.ravel()[0]))
        put(self, "cell", _as_cell(self.cell))
        put(self, "faces", _as_faces(self.faces))
        self._check_inside()
        _ = self._tree

    # ------------------------------------------------------------------ evaluation

    def __call__(self, u: ArrayLike, /) -> FloatArray:
        """Values, shape (n,), at points ``u`` (n, 3) of the unit cube."""
        return self.jet(u, 0)[0]

    def jet(self, u: ArrayLike, order: int = 2) -> tuple[FloatArray, ...]:
        """Value and derivatives with respect to ``u``.

        Parameters
        ----------
        u : array_like, shape (n, 3)
            Points of the unit cube.
        order : {0, 1, 2}
            Highest derivative.

        Returns
        -------
        tuple of ndarray
            Values (n,), gradients (n, 3), Hessians (n, 3, 3): the first ``order + 1``.

        Raises
        ------
        InputError
            If the points are not finite, or the order is unknown.
        """
        if not among(order, (0, 1, 2)):
            raise InputError(f"order must be 0, 1 or 2, got {order!r}")
        p = as_points("u", u)
        f, *rest = self._evaluate(self._in_space(p), self._tree, order)
        if self.stretched and order > 0:
            rest[0] = rest[0] @ self.cell
        if self.stretched and order > 1:
            rest[1] = self.cell.T @ rest[1] @ self.cell
        return (f, *rest)

    def grid(self, axes: Iterable[ArrayLike]) -> FloatArray:
        """Values on a tensor grid of the unit cube.

        Parameters
        ----------
        axes : iterable of array_like
            Three 1-D arrays of coordinates.

        Returns
        -------
        ndarray, shape (len(x), len(y), len(z))
            Values.
        """
        p, shape = points_of_grid(axes)
        return self(p).reshape(shape)

    def up_to(self, limit: float, u: ArrayLike) -> FloatArray:
        """Values as far as they are below a limit; it is several times faster to stop there.

        Parameters
        ----------
        limit : float
            Largest value wanted.
        u : array_like, shape (n, 3)
            Points of the unit cube.

        Returns
        -------
        ndarray, shape (n,)
            The lesser of value and limit.
        """
        limit = as_real("limit", limit, finite=False)
        # A smooth union is below the least distance by at most half its width.
        p = self._in_space(as_points("u", u))
        return np.minimum(self._evaluate(p, self._tree, 0, limit + 0.5 * self.blend)[0], limit)

    def range(self, lo: ArrayLike, hi: ArrayLike) -> FloatArray:
        """Rigorous bounds of the values on boxes, from the value in the middle.

        Parameters
        ----------
        lo, hi : array_like, shape (m, 3)
            Corners of the boxes in the unit cube.

        Returns
        -------
        ndarray, shape (m, 2)
            Lower and upper bounds.
        """
        a, b = as_points("lo", lo), as_points("hi", hi)
        if a.shape != b.shape or (a > b).any():
            raise InputError("lo and hi must have the same shape, with lo <= hi")
        half = 0.5 * (b - a)
        corners = np.array(list(product((-1.0, 1.0), repeat=3)))[4:]
        reach = np.linalg.norm((half[:, None] * corners) @ self.cell.T, axis=2).max(axis=1)
        f = self(0.5 * (a + b))
        pad = 1e-13 * (1.0 + np.abs(f))
        return np.stack([f - reach - pad, f + reach + pad], axis=1)

    # ------------------------------------------------------------------ properties

    @property
    def bounds(self) -> FloatArray:
        """The unit cube, shape (2, 3)."""
        return np.array([[0.0] * 3, [1.0] * 3])

    @property
    def lipschitz(self) -> float:
        """Bound of the gradient with respect to ``u``: 1 for the unit cube."""
        return float(np.linalg.norm(self.cell, 2))

    @property
    def repeats(self) -> tuple[bool, bool, bool]:
        """Axes along which the field repeats."""
        x, y, z = (self.faces[2 * a] == "periodic" for a in range(3))
        return (x, y, z)

    @cached_property
    def thinnest(self) -> float:
        """A lower bound of all radii."""
        return self._own_pieces.least

    @property
    def far(self) -> float:
        """How far ends on open and closed faces go on."""
        return 2.0 * float(np.linalg.norm(self.cell, axis=0).max())

    @cached_property
    def stretched(self) -> bool:
        """Whether the cell is not the unit cube."""
        return not np.array_equal(self.cell, np.eye(3))

    def flattened(self, level: float = 0.0, reach: float | None = None) -> FlattenedField:
        """A smoother field with the same zero set and slope there, for splines.

        Parameters
        ----------
        level : float
            Level of the zero set.
        reach : float, optional
            Distance from the zero set at which it becomes constant; default the least radius.

        Returns
        -------
        FlattenedField
            The field minus the level, constant at a distance.
        """
        return FlattenedField(self, level, self.thinnest if reach is None else reach)

    def __repr__(self) -> str:
        """Short form."""
        return f"SkeletonField({self.count} entities, blend={self.blend:g})"

    # ------------------------------------------------------------------ inner

    def _evaluate(
        self, x: FloatArray, tree: Tree, order: int, limit: float = np.inf
    ) -> tuple[FloatArray, ...]:
        n = len(x)
        f = np.empty(n)
        g = np.empty((n if order > 0 else 0, 3))
        h = np.empty((n if order > 1 else 0, 3, 3))
        x = np.ascontiguousarray(x)
        skeleton_jets(n, x, order, self.blend, limit, tree, self._planes, f, g, h)
        return (f, g, h)[: order + 1]

    def _in_space(self, u: FloatArray) -> FloatArray:
        """Points of the cell, to the same bits alone and among others."""
        if not self.stretched:
            return u
        a, b, c = self.cell.T
        return u[:, :1] * a + u[:, 1:2] * b + u[:, 2:] * c

    @cached_property
    def count(self) -> int:
        """Number of entities, each segment of many one: what a smooth union blends."""
        return sum(_counts(self.entities))

    @cached_property
    def _own_pieces(self) -> Pieces:
        groups = np.cumsum([0, *_counts(self.entities)]) * (self.blend > 0.0)
        parts = []
        for e, items, group in zip(self.entities, self._items, groups, strict=False):
            for one in e.members if isinstance(e, Group) else (e,):
                radius = self.radius if one.radius is None else one.radius
                own: Any = int(group)
                if one is e and isinstance(e, Segments) and self.blend > 0.0:
                    own = group + np.arange(len(e.points))
                parts.append(Part(one, radius, own, f"entities[{items[0]}]"))
        return pieces_of(parts, self.outward, self.far)

    @cached_property
    def _tree(self) -> Tree:
        own = self._own_pieces
        if not any(self.repeats):
            return own.tree()
        # The way from a point to the nearest piece, where that is a copy beyond a face, crosses
        # the face, and there the copy is nearest, too: it is no farther from the cell than the
        # cell's own pieces, or some of them, are from any point of the faces.
        some = np.arange(0, len(own.rows), 1 + len(own.rows) // MANY)
        points, gap = self._on_faces()
        top = self._evaluate(points, own.tree(some), 0)[0].max() + gap
        if all(self.repeats):  # next to each point is a copy of any point of a piece
            top = min(top, covering_radius(self.cell))
        top += 1.5 * self.blend
        return own.tree(*copies(own, self.cell, self.repeats, float(top)))

    def _on_faces(self) -> tuple[FloatArray, float]:
        """Points of the six faces, and how far all others of the faces are from them at most."""
        a = (np.arange(_FACE) + 0.5) / _FACE
        s, t = (c.ravel() for c in np.meshgrid(a, a, indexing="ij"))
        points, gap = [], 0.0
        for axis in range(3):
            b, c = (self.cell[:, k] for k in range(3) if k != axis)
            gap = max(gap, *(0.5 / _FACE * float(np.linalg.norm(v)) for v in (b + c, b - c)))
            points += [np.outer(s, b) + np.outer(t, c) + n * self.cell[:, axis] for n in (0, 1)]
        return np.concatenate(points), gap

    @cached_property
    def _planes(self) -> FloatArray:
        """Half-spaces of the closed faces in space, rows (normal, offset)."""
        rows = []
        inverse = np.linalg.inv(self.cell)
        for i, kind in enumerate(self.faces):
            if kind == "closed":
                axis, upper = divmod(i, 2)
                n = inverse[axis] / np.linalg.norm(inverse[axis])
                rows.append([*(n if upper else -n), upper / np.linalg.norm(inverse[axis])])
        return np.array(rows).reshape(-1, 4)

    def outward(self, p: FloatArray, direction: FloatArray) -> AnyArray:
        """Whether entities go on straight at their ends, through faces that are not periodic.

        Parameters
        ----------
        p, direction : ndarray, shape (n, 3)
            Ends in space, and unit vectors along which entities come there.

        Returns
        -------
        ndarray of bool, shape (n,)
            Whether they do, by `far`.
        """
        p, direction = as_points("p", p), as_points("direction", direction)
        if len(p) != len(direction):
            raise InputError(
                f"p and direction must be as many, got {len(p)} and {len(direction)}; give one "
                "direction per end"
            )
        inverse = np.linalg.inv(self.cell)
        u, d = (np.einsum("ij,nj->ni", inverse, a) for a in (p, direction))
        out = np.zeros(len(p), np.bool_)
        for i, kind in enumerate(self.faces):
            if kind != "periodic":
                axis, upper = divmod(i, 2)
                way = d[:, axis] if upper else -d[:, axis]
                out |= (np.abs(u[:, axis] - upper) <= ON_FACE) & (way > 1e-6)
        return out

    def _check_inside(self) -> None:
        if all(self.repeats):
            return
        samples = [_samples(e) for e in self.entities]
        u = np.einsum("ij,nj->ni", np.linalg.inv(self.cell), np.concatenate(samples))
        outside = np.where(self.repeats, -np.inf, np.maximum(-u, u - 1.0)).max(axis=1)
        if not (outside > ON_FACE).any():
            return
        ends = np.cumsum([len(s) for s in samples])
        at = int(np.argmax(outside > ON_FACE))
        i = int(np.searchsorted(ends, at, "right"))
        start, stop, item = ends[i] - len(samples[i]), ends[i], self._items[i][0]
        if len(self._items[i]) > 1:  # one of the segments, two samples each
            k = (at - start) // 2
            start, stop, item = start + 2 * k, start + 2 * k + 2, self._items[i][k]
        worst = start + int(np.argmax(outside[start:stop]))
        raise InputError(
            f"entities[{item}] leaves the tile: it reaches u = {np.round(u[worst], 6).tolist()}, "
            "outside [0, 1]³; move, scale or cut it, or give the cell"
        )


def _counts(entities: Iterable[Entity]) -> list[int]:
    """How many entities each is."""
    return [len(e.points) if isinstance(e, Segments) else 1 for e in entities]


def _samples(e: Entity) -> FloatArray:
    """Points that tell whether an entity is inside."""
    if isinstance(e, Group):
        return np.concatenate([_samples(m) for m in e.members])
    if isinstance(e, Polyline | Segments):
        return e.points.reshape(-1, 3)
    if isinstance(e, Patch):
        return e.corners
    if isinstance(e, Triangles):
        return e.vertices
    if isinstance(e, Ball):
        return e.centre[None]
    if isinstance(e, Arc):
        return e.at(np.linspace(0.0, e.angle, 181))
    s = e.spline
    count = 33 if s.ndim == 1 else 9
    axes = []
    for axis in range(s.ndim):
        b = s.breaks(axis)
        axes.append(np.unique(np.concatenate([np.linspace(*v, count) for v in pairwise(b)])))
    return s(grid_points(*axes))


def _as_cell(value: Any) -> FloatArray:
    a = as_array("cell", value)
    if np.ndim(value) == 2:
        if a.shape != (3, 3) or not abs(np.linalg.det(a)) > 1e-12 * np.abs(a).max() ** 3:
            raise InputError(f"cell must be lengths or three independent columns, got {value}")
        return read_only(np.array(a))
    return read_only(np.diag(as_triple("cell", value, positive=True)))


def _as_faces(value: Any) -> tuple[str, ...]:
    """Kind of each of the six faces."""
    given = dict.fromkeys("xyz", value) if isinstance(value, str) else value
    if not isinstance(given, Mapping):
        raise InputError(f"faces must be one of {KINDS} or a mapping of faces to these: {value!r}")
    out: dict[str, str] = {}
    for key, kind in given.items():
        names = [key] if key in FACES else [f for f in FACES if f[0] == key]
        if not names or kind not in KINDS:
            raise InputError(
                f"faces: {key!r}: {kind!r} is unknown; the keys are 'x', 'y', 'z' and {FACES}, "
                f"the kinds {KINDS}"
            )
        for name in names:
            if out.setdefault(name, kind) != kind:
                raise InputError(
                    f"faces are in conflict: {name!r} is both {out[name]!r} and {kind!r}"
                )
    kinds = tuple(out.get(f, "open") for f in FACES)
    for axis in range(3):
        a, b = kinds[2 * axis : 2 * axis + 2]
        if a != b and "periodic" in (a, b):
            raise InputError(
                f"faces are in conflict: {FACES[2 * axis]!r} is {a!r} and {FACES[2 * axis + 1]!r} "
                f"is {b!r}; opposite faces are periodic together"
            )
    return kinds


def skeleton_of(tile: Any) -> SkeletonField | None:
    """The skeleton that a tile is made of, or None if it is of another kind, or a mixture."""
    field = tile.field if isinstance(tile, Tile) else None
    return field if isinstance(field, SkeletonField) else None


def skeleton(
    entities: Sequence[Any] | AnyArray,
    *,
    radius: float | None = None,
    blend: float = 0.0,
    faces: str | Mapping[str, str] = "open",
    cell: ArrayLike = 1.0,
    name: str = "skeleton",
    source: str = "",
) -> Tile:
    """Tile whose solid is all that is within a radius of curves and surfaces.

    Parameters
    ----------
    entities : sequence of Entity, BSpline or array_like of shape (n, 3)
        Curves and surfaces inside the cell; plain points are a polyline, an array (n, 2, 3) is n
        segments. `Polyline`, `Segments`, `Arc`, `Patch`, `Curve` and `Surface` have a radius of
        their own, constant or varying.
    radius : float, optional
        Radius of entities that have none: half the thickness of arms and plates.
    blend : float
        Width of the smooth union; 0 joins the entities sharply. Where two arms meet, a fillet
        of this size is left.
    faces : str or mapping
        "open", "closed" or "periodic" for all faces, or per axis ("x") or face ("x-", "x+").
        Ends on an open face are continued straight through it; a closed face cuts the solid
        there; across periodic faces the entities repeat.
    cell : array_like of shape () or (3,) or (3, 3)
        Edges of the cell: lengths, or vectors as columns; entities and radii are in its lengths.
    name : str
        Name of the tile.
    source : str
        Where it is from.

    Returns
    -------
    Tile
        The tile {f < 0}: ``lattice.offset((np.inf, 0))`` makes that solid, ``(0, d)`` a shell
        around it. What needs a spline (`fit`, a lattice) approximates f near its zero set only,
        see `FlattenedField`. Distances, so all offsets but ``(np.inf, 0)``, are those to struts
        themselves, but for a few feet in a hundred next to nodes; of plates, and of struts in
        tiles that meet in creases (ends on open faces), they go by a spline whose zero set is up
        to a hundredth of the smallest radius off (more is told): for less take
        ``tile.fit(tol=1e-4, max_spans=128)``, with a tolerance in lengths of the cell.

    Raises
    ------
    InputError
        If there is no entity, one has no length or leaves the cell, a radius is missing or not
        positive, or `faces` contradicts itself.
    GeometryError
        If the solid fills the tile.

    Examples
    --------
    >>> bar = skeleton([[(0, 0.5, 0.5), (1, 0.5, 0.5)]], radius=0.2)
    >>> bar([[0.3, 0.5, 1.0]])
    array([0.3])
    """
    field = SkeletonField(entities, radius, blend, faces, cell)
    edges = field.cell if field.stretched else None
    tol = SPLINE_ERROR * field.thinnest
    tile = Tile(field, name=name, source=source, tol=tol, edges=edges, check=False)
    if not any((tile.grid([(np.arange(n) + 0.37) / n] * 3) > 0.0).any() for n in (24, 64)):
        raise GeometryError(
            f"tile {name!r} has no zero set: the solid fills the cell; radii of {field.thinnest:g} "
            "and more are too large for it"
        )
    return tile
