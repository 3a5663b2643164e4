"""Elements: the connected pieces of the solid inside the cells of a grid.

A gap or a slit that passes through a cell leaves two or more pieces of solid in it. They are
elements of their own, with functions of their own, so that nothing is carried through air. The
first piece of a cell has the number of the cell, all others have numbers beyond those of the cells:
rules and spaces take both alike, and where every cell has one piece nothing changes.

Guarantees: pieces are told apart by Bernstein coefficients (see `_kernels_elements`), never by
sampling, so that what hangs together inside a cell stays together. Pieces so small that a rule has
no points in them have no functions; their surface and facets are left out of rules, so that they
join nothing that is apart. Non-guarantee: air that is thinner than some thirtieth of a cell may not
be seen; `ElementGrid.gaps` says where that divides a piece.
"""

from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import pairwise
from typing import Any

import numpy as np

from ilattice._memory import need
from ilattice._typing import AnyArray, FloatArray, IntArray
from ilattice._validate import read_only
from ilattice.cutfem import _kernels_elements as kernels
from ilattice.quadrature.cutting import CutGrid
from ilattice.quadrature.grid import CUT, DividedGrid
from ilattice.quadrature.rules import Quadrature

#: Pieces of splines that are worked on at once.
BATCH = 1 << 15


@dataclass(frozen=True, eq=False, repr=False)
class ElementGrid(DividedGrid):
    """A grid of which some cells have several elements.

    Attributes
    ----------
    cut : CutGrid
        The level sets.
    divided_cells : ndarray, shape (c,)
        Cells with more than one piece, with points or without, increasing.
    offsets : ndarray, shape (c + 1,)
        The boxes of the i-th of them are those from offsets[i] to offsets[i + 1].
    corner, length : ndarray, shape (boxes, 3)
        Boxes in `_kernels_elements.UNIT` parts of the pieces of splines, or of cells, from the
        cell's corner.
    label : ndarray, shape (boxes,)
        Element of each box; of pieces without points -1 less the number of their cell.
    gaps : ndarray, shape (g, 5)
        Cells with air that is too thin to be resolved, its length along the three directions, in
        cells, 0 along those in which it goes on, and 1 where it alone is between solid, 0 where
        other boxes that are not certain are there, too, as next to edges that touch.
    """

    cut: CutGrid = field(kw_only=True)
    divided_cells: IntArray = field(kw_only=True)
    offsets: IntArray = field(kw_only=True)
    corner: IntArray = field(kw_only=True)
    length: IntArray = field(kw_only=True)
    label: IntArray = field(kw_only=True)
    gaps: FloatArray = field(kw_only=True)

    @cached_property
    def several(self) -> IntArray:
        """Cells with more than one element, increasing."""
        return read_only(np.unique(self.parents))

    def element_at(self, u: FloatArray, cells: IntArray) -> IntArray:
        """See `DividedGrid.element_at`: where boxes leave a point out, the nearest one counts.

        In pieces without points it is the first element of the cell.
        """
        found = self._label_at(u, cells)
        return np.where(found < 0, -1 - found, found)

    def _label_at(self, u: FloatArray, cells: IntArray) -> IntArray:
        """The label of the box of each point (n, 3), or its cell where it is in one piece."""
        out = np.array(cells, np.int64)
        if not len(self.divided_cells):
            return out
        at = np.minimum(np.searchsorted(self.divided_cells, cells), len(self.divided_cells) - 1)
        mine = np.flatnonzero(self.divided_cells[at] == cells)
        if len(mine):
            x = self.cut.layout.fine(u[mine], out[mine])
            found = np.empty(len(mine), np.int64)
            kernels.labels_at(
                len(x), x, at[mine], self.offsets, self.corner, self.length, self.label, found
            )
            out[mine] = found
        return out

    def divided(self, rule: Quadrature) -> Quadrature:
        """A rule by cells as one by elements.

        Parameters
        ----------
        rule : Quadrature
            In parameters, on the solid, its surface, or faces.

        Returns
        -------
        Quadrature
            Sorted by element; the same points, on surfaces and faces without those of pieces that
            have none inside.
        """
        if not len(self.divided_cells):
            return replace(rule, grid=self)
        cells = rule.cells[rule.owners]
        if rule.normals is None:
            return regrouped(replace(rule, grid=self), self.element_at(rule.points, cells), None)
        low, high = self._label_at(rule.points, cells), None
        keep = low >= 0
        if rule.neighbours is not None:
            high = self._label_at(*_on_the_other_side(rule))
            keep &= high >= 0
        return regrouped(replace(rule, grid=self), low, high, keep)


def elements_of(cut: CutGrid, solid: Quadrature) -> tuple[ElementGrid, Quadrature]:
    """The elements of a solid, and the rule on it by elements.

    Parameters
    ----------
    cut : CutGrid
        Level sets on a grid.
    solid : Quadrature
        Rule on the solid, in parameters: pieces in which it has no points are none.

    Returns
    -------
    grid : ElementGrid
        With the cells of the grid.
    rule : Quadrature
        As `ElementGrid.divided` would have it.
    """
    cells, counts, widths = _counted(cut)
    thin = widths.max(axis=1, initial=0.0) > 0.0
    gaps = np.column_stack([cells[thin], widths[thin]])
    return _made(cut, cells[counts > 1], np.zeros(0, np.int64), gaps, solid)


def unbridged(
    elements: ElementGrid, solid: Quadrature, cells: IntArray
) -> tuple[ElementGrid, Quadrature]:
    """What `elements_of` would find if nothing that is not resolved in some cells joined pieces.

    Parameters
    ----------
    elements : ElementGrid
        The elements.
    solid : Quadrature
        Rule on the solid by them.
    cells : ndarray
        Of `ElementGrid.gaps`.

    Returns
    -------
    grid, rule
        As `elements_of` has them, without gaps.
    """
    home = elements.home(solid.cells[solid.owners])
    by_cells = regrouped(replace(solid, grid=elements.cut.grid), home, None)
    several = np.union1d(elements.divided_cells, cells)
    return _made(elements.cut, several, cells, np.zeros((0, 5)), by_cells)


def _made(
    cut: CutGrid, several: IntArray, parted: IntArray, gaps: FloatArray, solid: Quadrature
) -> tuple[ElementGrid, Quadrature]:
    """Elements of which some cells have several, in some of these only by what is certain."""
    boxes = [
        kernels.pieces_of(*cut.layout.insides(one)[:5], cut.pieces.order, bool(certain))[:3]
        for one, certain in zip(several[:, None], np.isin(several, parted), strict=True)
    ]
    corner = np.concatenate([np.zeros((0, 3), np.int64), *(b[0] for b in boxes)])
    length = np.concatenate([np.zeros((0, 3), np.int64), *(b[1] for b in boxes)])
    label = np.concatenate([np.zeros(0, np.int64), *(b[2] for b in boxes)])
    offsets = np.append(0, np.cumsum([len(b[1]) for b in boxes])).astype(np.int64)
    seen = [label[a:b] for a, b in pairwise(offsets)]
    grid = cut.grid
    raw = ElementGrid(
        grid.axes, grid.closed, cut=cut, divided_cells=read_only(several),
        offsets=read_only(offsets), corner=read_only(corner), length=read_only(length),
        label=read_only(label), parents=read_only(np.zeros(0, np.int64)), gaps=read_only(gaps),
    )  # fmt: skip
    return _numbered(raw, seen, solid, parted)


def _counted(cut: CutGrid) -> tuple[IntArray, IntArray, FloatArray]:
    """Cut cells, their numbers of pieces, and gaps (n, 4) that are not resolved."""
    cells = cut.cells(CUT)
    counts, widths = np.ones(len(cells), np.int64), np.zeros((len(cells), 4))
    rest = np.flatnonzero(~cut.layout.single(cells))
    per_cell = cut.layout.per_cell
    size = max(int(BATCH / per_cell), 1)
    for i in range(0, len(rest), size):
        part = rest[i : i + size]
        tensors, tables, which, start, extent, owner = cut.layout.insides(cells[part])
        offsets = np.append(np.searchsorted(owner, cells[part]), len(owner))
        found, gaps = np.zeros(len(part), np.int64), np.zeros((len(part), 4))
        kernels.count_pieces(
            len(part), tensors, tables, which, start, extent, offsets, cut.pieces.order, found, gaps
        )
        counts[part], widths[part] = found, gaps
    widths[:, :3] /= np.cbrt(per_cell)
    return cells, counts, widths


def _numbered(
    raw: ElementGrid, labels: list[IntArray], solid: Quadrature, parted: IntArray
) -> tuple[ElementGrid, Quadrature]:
    """The same with numbers of elements for labels, and the rule by elements.

    In cells that are `parted` the last label is of boxes that are not certain, where points are of
    the first element.
    """
    if not len(raw.divided_cells):
        return raw, replace(solid, grid=raw)
    element = np.asarray(solid.cells, np.int64)[solid.owners]
    inside = np.flatnonzero(np.isin(solid.cells, raw.divided_cells)[solid.owners])
    owner = element[inside]
    found = raw.element_at(solid.points[inside], owner)
    ends = (np.searchsorted(owner, raw.divided_cells, side) for side in ("left", "right"))
    out: list[IntArray] = []
    parents: list[int] = []
    for cell, mine, begin, end in zip(raw.divided_cells, labels, *ends, strict=True):
        inhabited = np.flatnonzero(np.bincount(found[begin:end]))
        if cell in parted:
            inhabited = inhabited[inhabited < mine.max()]
        names = np.full(mine.max() + 1, -1 - cell)
        more = max(len(inhabited) - 1, 0)
        numbers = [cell, *(raw.count + len(parents) + np.arange(more))]
        names[inhabited] = numbers[: len(inhabited)]
        parents += [cell] * more
        out.append(names[mine])
        new = names[found[begin:end]]
        element[inside[begin:end]] = np.where(new < 0, cell, new)
    grid = replace(
        raw,
        label=read_only(np.concatenate(out)),
        parents=read_only(np.array(parents, np.int64)),
    )
    whole = replace(solid, grid=grid)
    return grid, regrouped(whole, element, None) if parents else whole


def _on_the_other_side(rule: Quadrature) -> tuple[FloatArray, IntArray]:
    """Points of a rule on faces, as those of the upper cells, and these."""
    assert rule.normals is not None
    assert rule.neighbours is not None
    u, upper = rule.points.copy(), rule.neighbours[rule.owners]
    axis = np.abs(rule.normals).argmax(axis=1)
    rows = np.arange(len(u))
    u[rows, axis] = rule.grid.boxes(upper)[rows, axis]
    return u, upper


def regrouped(
    rule: Quadrature, low: IntArray, high: IntArray | None, keep: AnyArray | None = None
) -> Quadrature:
    """The same points, or some of them, by elements, and by those on the other side.

    Parameters
    ----------
    rule : Quadrature
        Points; its cells do not matter.
    low : ndarray, shape (n,)
        Element of each point.
    high : ndarray, shape (n,), or None
        Elements on the other side of faces.
    keep : ndarray of bool, shape (n,), optional
        Which points.

    Returns
    -------
    Quadrature
        Sorted.
    """
    held = [rule.points, rule.weights, rule.normals, rule.sets, rule.parameters, low, low]
    need(
        sum(a.nbytes for a in held if a is not None),
        f"a rule of {len(rule)} points by elements",
        "use fewer cells, a smaller q or a part of the solid",
    )
    order = np.argsort(low, kind="stable") if high is None else np.lexsort((high, low))
    order = order if keep is None else order[keep[order]]
    low = low[order]
    change = low[1:] != low[:-1]
    if high is not None:
        high = high[order]
        change |= high[1:] != high[:-1]
    first = np.append(0, np.flatnonzero(change) + 1) if len(low) else np.zeros(0, np.int64)

    def part(a: Any) -> Any:
        return None if a is None else read_only(a[order])

    return replace(
        rule,
        points=part(rule.points),
        weights=part(rule.weights),
        normals=part(rule.normals),
        sets=part(rule.sets),
        parameters=part(rule.parameters),
        cells=read_only(low[first]),
        neighbours=None if high is None else read_only(high[first]),
        offsets=read_only(np.append(first, len(low))),
    )
