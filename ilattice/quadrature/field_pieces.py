"""Fields on the cells of a grid: smooth level sets, interpolated on boxes that are halved.

A field is split at its kinks (see `ilattice.fields._formula`): in every box the solid is a Boolean
function of the signs of at most six smooth fields, which are interpolated there. A box is halved
if it has more of them, if bounds leave a sign open that the interpolants call certain, or if it
has too large a share in the error of the volume.

Guarantees: fields without kinks that are polynomials of the degree per direction are represented
exactly, and so are solids of them. A box that is called in or out is so by rigorous bounds where
fields have them, or by interpolants that were exact wherever they were looked at. Boxes of which
neither is known at the last halving count as errors.
Non-guarantees: the error of other fields is what is seen on the surface, and at random points: not
a bound. What is smaller than a box, in a field without bounds, may be missed, unless the field
leads there, as distances do: its slopes are followed to where it would change sign.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from scipy.ndimage import uniform_filter

from ilattice._geometry import grid_points
from ilattice._memory import need
from ilattice._typing import AnyArray, FloatArray, IntArray
from ilattice._validate import Frozen, read_only
from ilattice.fields.node import Node
from ilattice.fields.outside import from_callable
from ilattice.quadrature import _kernels_drive as kernels
from ilattice.quadrature._choice import Chosen, Splits
from ilattice.quadrature._filling import SURFACE, VOLUME, Content, Listing, filled
from ilattice.quadrature._kernels_scratch import UNIT

#: Halvings of a cell: of fields with bounds, and of those without.
MAX_HALVINGS, BLIND_HALVINGS = 7, 2
#: Boxes are small from this part of a cell on: bounds that end at zero are theirs.
SMALL = 4
#: Boxes in `BATCH`, of fields without bounds, that are halved for a sign which is found, but not at
#: the sites of interpolants: specks have a few, thin sheets have many.
FEW = 64
#: Estimated error of the volume, as a part of it, below which no box is halved for it.
TARGET = 1e-4
#: The same of the side that has less, solid or air, in a cell and those around it, by which specks,
#: voids and slits are halved; and the error, in volumes of a cell, below which nothing is.
LOCAL, MIN_SHARE = 0.02, 1e-7
#: Such an error below which none is told, as of air a rounding thick beside a face of the grid.
NOISE = 5e-4
#: Error of the whole volume above which that is told, and above which specks are left as they are.
TOLD, CRUDE = 1e-3, 2e-3
#: Part of the share of a cell from which on a box counts when cells are halved for that.
NOTABLE = 0.01
#: Times that boxes are halved for that, and boxes, per cell of the surface, above which none is;
#: fewer cells than some count as these.
ROUNDS, MAX_BOXES, FEW_CELLS = 4, 16, 256
BATCH = 1 << 12  # boxes at once
PER_POLYNOMIAL = 150.0  # bytes of memory besides coefficients


@dataclass(frozen=True, eq=False)
class FieldPieces(Frozen):
    """Boxes with polynomials.

    Attributes
    ----------
    axes : tuple of ndarray
        Planes between cells.
    order : int
        Coefficients per direction.
    cell : ndarray, shape (n,)
        Cells of the boxes, increasing; what has no box is outside of the solid.
    corner : ndarray, shape (n, 3)
        Lower corners, in `UNIT` parts of the cells, from their corners.
    length : ndarray, shape (n,)
        Lengths, in these.
    full : ndarray of bool, shape (n,)
        Whether boxes lie in the solid.
    first : ndarray, shape (n + 1,)
        The polynomials of box i are those from first[i] to first[i + 1]; full ones have some where
        they may vanish on a face.
    coefficients : ndarray, shape (polynomials, order³)
        Bernstein coefficients.
    names : ndarray, shape (polynomials,)
        Number of the field of each, in a pair of them.
    tables : ndarray, shape (n,)
        See `Content`.
    error : float
        Estimated error of the volume, as a part of it.
    local : float
        The same around one cell, as a part of the solid or the air there, whichever is less.
    place : int
        The cell.
    """

    axes: tuple[FloatArray, ...]
    order: int
    cell: IntArray
    corner: IntArray
    length: IntArray
    full: AnyArray
    first: IntArray
    coefficients: FloatArray
    names: IntArray
    tables: IntArray
    error: float = 0.0
    local: float = 0.0
    place: int = 0
    #: See `Pieces.project`.
    project = True

    @property
    def lengths(self) -> Any:
        """An array of length `order`, for the kernels."""
        return np.zeros(self.order, np.int64)

    def geometry(self, rows: IntArray) -> FloatArray:
        """Lower corners and extents (n, 6) of boxes."""
        return _geometry(self.axes, self.cell[rows], self.corner[rows], self.length[rows])

    def content(self, rows: IntArray) -> Content:
        """Polynomials of boxes."""
        many = (self.first[1:] - self.first[:-1])[rows]
        m = max(int(many.max(initial=1)), 1)
        at = self.first[rows][:, None] + np.arange(m)
        there = np.arange(m) < many[:, None]
        at = np.where(there, at, 0)
        tensors = np.zeros((len(rows), m, self.order**3))
        if len(self.coefficients):
            tensors[there] = self.coefficients[at[there]]
        names = np.where(there, self.names[at], 0) if len(self.names) else at
        return Content(tensors, many, self.tables[rows], names)


def _geometry(
    axes: Sequence[FloatArray], cell: IntArray, corner: IntArray, length: IntArray
) -> FloatArray:
    """Lower corners and extents (n, 6) of boxes in cells; faces that meet are the same numbers."""
    out = np.empty((len(cell), 6))
    ijk = np.unravel_index(cell, tuple(len(x) - 1 for x in axes))
    for a, (x, i) in enumerate(zip(axes, ijk, strict=True)):
        step = (x[i + 1] - x[i]) / UNIT
        end = corner[:, a] + length
        out[:, a] = x[i] + step * corner[:, a]
        high = np.where(end == UNIT, x[i + 1], x[i] + step * end)
        out[:, 3 + a] = high - out[:, a]
    return out


def field_pieces(
    fields: Sequence[Any], domain: FloatArray, degree: int, axes: tuple[FloatArray, ...]
) -> FieldPieces:
    """The solid where all of some fields are negative, on the cells of a grid.

    Parameters
    ----------
    fields : sequence of Node or callable
        The fields.
    domain : ndarray, shape (2, 3)
        Where they are defined.
    degree : int
        Degree of the interpolation, 1 to 4.
    axes : tuple of ndarray
        Planes between cells.

    Returns
    -------
    FieldPieces
        Boxes, and an estimate of the error of their volume.

    Raises
    ------
    InputError
        If fields are not finite, or there is too little memory.
    """
    nodes = [f if isinstance(f, Node) else from_callable(f) for f in fields]
    return _Halving(Splits(nodes, domain, degree), axes).pieces()


@dataclass(eq=False)
class _Part:
    """Boxes that are done: what `FieldPieces` has, and what is uncertain or not exact."""

    cell: IntArray
    corner: IntArray
    length: IntArray
    sign: IntArray  # -1 for boxes in the solid, 1 for those that are outside as far as is known
    chosen: Chosen
    unresolved: FloatArray  # volume of which it is not known whether it is solid
    exact: AnyArray
    share: FloatArray  # in the error of the volume; NaN if that is not known yet
    volume: FloatArray  # that is solid, likewise

    def take(self, rows: AnyArray) -> "_Part":
        """Some of the boxes."""
        return _Part(
            self.cell[rows], self.corner[rows], self.length[rows], self.sign[rows],
            self.chosen.take(rows), self.unresolved[rows], self.exact[rows], self.share[rows],
            self.volume[rows],
        )  # fmt: skip


class _Halving:
    """Boxes in the making."""

    def __init__(self, splits: Splits, axes: tuple[FloatArray, ...]) -> None:
        self.splits, self.axes = splits, axes
        self.order = splits.degree + 1
        self.parts: list[_Part] = []
        self.count = 0

    def pieces(self) -> FieldPieces:
        """All boxes."""
        n = int(np.prod([len(x) - 1 for x in self.axes]))
        cells = np.arange(n)
        self._halve_until_known(cells, np.zeros((n, 3), np.int64), np.full(n, UNIT))
        first = self._joined()
        most = MAX_BOXES * max(len(first.cell), FEW_CELLS)
        for k in range(ROUNDS + 1):
            whole = self._joined()
            self._measure(whole)
            off, volume = float(whole.share.sum()), float(whole.volume.sum())
            error = off / volume if volume > 0.0 else (np.inf if off > 0.0 else 0.0)
            local = self._local(whole)
            if k == ROUNDS:
                break
            room = (most - len(whole.cell)) // 7
            worst = self._worst(whole, volume) if error > TARGET else np.zeros(0, np.int64)
            worst = worst if len(worst) <= room else worst[:0]
            if error <= CRUDE:
                small = np.union1d(worst, self._smallest(whole, local))
                worst = small if len(small) <= room else worst
            if not len(worst):
                break
            keep = np.ones(len(whole.cell), bool)
            keep[worst] = False
            self.parts = [whole.take(keep)]
            self._halve_until_known(*_halves(whole.take(worst)))
        local = self._local(whole, NOISE)
        out, place = self._finished(self._joined(), error), int(local.argmax())
        return replace(out, local=float(local[place]), place=place)

    # ------------------------------------------------------------------ halving

    def _halve_until_known(self, cell: IntArray, corner: IntArray, length: IntArray) -> None:
        while len(cell):
            left = []
            for i in range(0, len(cell), BATCH):
                part = slice(i, i + BATCH)
                left.append(self._step(cell[part], corner[part], length[part]))
                self._need()
            cell, corner, length = (
                np.concatenate(x).astype(np.int64) for x in zip(*left, strict=True)
            )

    def _need(self) -> None:
        need(
            2.0 * self.count * (8.0 * self.order**3 + PER_POLYNOMIAL),
            f"the field on {self.count} boxes",
            "use fewer cells per direction, or a simpler field",
        )

    def _step(
        self, cell: IntArray, corner: IntArray, length: IntArray
    ) -> tuple[IntArray, IntArray, IntArray]:
        """Sort out boxes; the halves of those that are not known yet."""
        box = _geometry(self.axes, cell, corner, length)
        small = length * SMALL <= UNIT
        chosen = self.splits.choose(box, small, length * MAX_PARTS < 2 * UNIT)
        todo = np.flatnonzero(chosen.certain == 0)
        unresolved, exact = np.zeros(len(cell)), np.ones(len(cell), bool)
        again = np.flatnonzero(chosen.certain == 2)
        if len(todo):
            cut = chosen.take(todo)
            measured = self.splits.interpolate(cut, box[todo], small[todo])
            hidden = measured.hidden & (measured.hidden.sum() <= FEW)
            least = np.where(measured.blind & ~hidden, BLIND_PARTS, MAX_PARTS)
            may = length[todo] * least >= 2 * UNIT
            unknown = measured.unknown & may
            content = cut.content(self.order)
            sign = np.empty(len(todo), np.int64)
            kernels.signs(
                len(content.tensors), content.tensors, content.many, content.tables, 6,
                np.zeros(self.order, np.int64), sign,
            )  # fmt: skip
            volume = box[todo, 3:].prod(axis=1)
            unresolved[todo] = np.where(measured.unknown & ~may, measured.unresolved * volume, 0.0)
            exact[todo] = measured.exact
            again = np.sort(np.concatenate([again, todo[unknown]]))
            chosen.put(todo, cut, (sign == 1) | ((sign == -1) & cut.plain(box[todo])))
            chosen.certain[todo] = sign
        keep = chosen.certain <= 0
        keep |= unresolved > 0.0
        keep[again] = False
        rows = np.flatnonzero(keep)
        part = _Part(
            cell[rows], corner[rows], length[rows], chosen.certain[rows], chosen.take(rows),
            unresolved[rows], exact[rows], np.full(len(rows), np.nan), np.full(len(rows), np.nan),
        )  # fmt: skip
        self.parts.append(part)
        self.count += len(part.chosen.coefficients)
        return _halved(cell[again], corner[again], length[again])

    # ------------------------------------------------------------------ errors

    def _measure(self, p: _Part) -> None:
        """Set shares of boxes in the error of the volume, and their volumes, where unknown."""
        if (p.exact | (p.chosen.many == 0)).all() and not p.unresolved.any():
            p.share[:], p.volume[:] = 0.0, 1.0
            return
        new = np.flatnonzero(np.isnan(p.share))
        part = p.take(new)
        first, leaf = part.chosen.first, part.chosen.leaf
        numbers = np.arange(len(leaf)) - np.repeat(first[:-1], part.chosen.many)
        view = replace(self._finished(part, 0.0, merge=False), names=numbers)
        share, volume = part.unresolved.copy(), np.zeros(len(new))
        rough = np.flatnonzero(~part.exact & (part.sign == 0))
        rows, counts = filled(view, _listed(view, rough), SURFACE, 2, 1)
        points, weights, normals, place = rows.arrays
        owner = np.repeat(rough, counts)
        reach = np.linalg.norm(view.geometry(owner)[:, 3:], axis=1)
        off = self.splits.distances(points, normals, leaf[first[owner] + place], reach)
        np.add.at(share, owner, weights * off)
        solid = np.flatnonzero(part.sign <= 0)
        rows, counts = filled(view, _listed(view, solid), VOLUME, 1, 1)
        np.add.at(volume, np.repeat(solid, counts), rows.arrays[1])
        p.share[new], p.volume[new] = share, volume

    def _worst(self, p: _Part, volume: float) -> IntArray:
        """Boxes to be halved so that what is left is a half of the target."""
        share = p.share
        least = np.where(self.splits.blind_boxes(p.chosen), BLIND_PARTS, MAX_PARTS)
        may = p.length * least >= 2 * UNIT
        order = np.argsort(-share, kind="stable")
        left = share.sum() - np.cumsum(share[order])
        n = int(np.searchsorted(-left, -0.5 * TARGET * volume)) + 1
        return np.sort(order[:n][may[order[:n]] & (share[order[:n]] > 0.0)])

    def _local(self, p: _Part, least: float = MIN_SHARE) -> FloatArray:
        """Error (cells,) around each cell of the surface, as a part of the thinner side there."""
        shape = tuple(len(x) - 1 for x in self.axes)
        n = int(np.prod(shape))
        off = np.asarray(np.bincount(p.cell, p.share, n), np.float64)
        if not off.any():
            return off
        x, y, z = (np.diff(a) for a in self.axes)
        whole = (x[:, None, None] * y[:, None] * z).ravel()
        solid = np.minimum(np.bincount(p.cell, p.volume, n), whole)
        near, inside, air = (
            27.0 * uniform_filter(a.reshape(shape), 3, mode="constant").ravel()
            for a in (off, solid, whole - solid)
        )
        there = off > least * whole
        return np.where(there, near / np.maximum(np.minimum(inside, air), least * whole), 0.0)

    def _smallest(self, p: _Part, local: FloatArray) -> IntArray:
        """Boxes to be halved so that specks and voids are known well."""
        mark = (local[p.cell] > LOCAL) & (p.length >= 2 * UNIT // MAX_PARTS)
        share = np.bincount(p.cell, p.share, len(local))
        return np.flatnonzero(mark & (p.share > NOTABLE * share[p.cell]))

    # ------------------------------------------------------------------ the end

    def _joined(self) -> _Part:
        """All boxes that are done, in order."""
        q = self.parts
        if len(q) > 1:
            whole = _Part(
                np.concatenate([p.cell for p in q]),
                np.concatenate([p.corner for p in q]),
                np.concatenate([p.length for p in q]),
                np.concatenate([p.sign for p in q]),
                Chosen.joined([p.chosen for p in q]),
                np.concatenate([p.unresolved for p in q]),
                np.concatenate([p.exact for p in q]),
                np.concatenate([p.share for p in q]),
                np.concatenate([p.volume for p in q]),
            )
            order = np.lexsort((*whole.corner.T[::-1], whole.cell))
            self.parts = [whole.take(order)]
        return self.parts[0]

    def _finished(self, p: _Part, error: float, *, merge: bool = True) -> FieldPieces:
        if merge:
            p = _merged(p.take(p.sign <= 0))
        c = p.chosen
        return FieldPieces(
            self.axes,
            self.order,
            read_only(p.cell),
            read_only(p.corner),
            read_only(p.length),
            read_only(p.sign == -1),
            read_only(c.first),
            read_only(c.coefficients),
            read_only(self.splits.names(c.leaf)),
            read_only(c.tables),
            error,
        )


MAX_PARTS, BLIND_PARTS = 1 << MAX_HALVINGS, 1 << BLIND_HALVINGS


def _listed(pieces: FieldPieces, rows: IntArray) -> Listing:
    """Some boxes, each as a cell of its own."""
    cut = ~pieces.full[rows]
    which = np.where(cut, np.cumsum(cut) - 1, -1)
    return Listing(rows[cut], which, pieces.geometry(rows), np.full(len(rows), -1), rows)


def _halves(p: _Part) -> tuple[IntArray, IntArray, IntArray]:
    return _halved(p.cell, p.corner, p.length)


def _halved(
    cell: IntArray, corner: IntArray, length: IntArray
) -> tuple[IntArray, IntArray, IntArray]:
    """The eight halves of boxes."""
    steps = grid_points(*[[0, 1]] * 3)[None]
    half = length // 2
    corners = (corner[:, None] + steps * half[:, None, None]).astype(np.int64)
    return np.repeat(cell, 8), corners.reshape(-1, 3), np.repeat(half, 8)


def _merged(p: _Part) -> _Part:
    """Eight full halves, in which nothing vanishes, as one box."""
    while True:
        plain = np.flatnonzero((p.sign == -1) & (p.chosen.many == 0) & (p.length < UNIT))
        whole = p.corner[plain] // (2 * p.length[plain, None]) * (2 * p.length[plain, None])
        keys = np.column_stack([p.cell[plain], whole, p.length[plain]])
        _, group, count = np.unique(keys, axis=0, return_inverse=True, return_counts=True)
        eight = count[group.ravel()] == 8
        if not eight.any():
            return p
        rows = plain[eight]
        lead = (p.corner[rows] == whole[eight]).all(axis=1)
        p.length[rows[lead]] *= 2
        keep = np.ones(len(p.cell), bool)
        keep[rows[~lead]] = False
        p = p.take(keep)
