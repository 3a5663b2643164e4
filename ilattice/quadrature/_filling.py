"""Running the kernels that make rules: boxes in, rows of points and weights out.

Guarantee: the same bits for any number of threads.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np

from ilattice._memory import need
from ilattice._typing import AnyArray, FloatArray, IntArray
from ilattice.bspline.bezier import bernstein
from ilattice.quadrature import _kernels_drive as kernels
from ilattice.quadrature._kernels_thinning import moments_of

#: Points of a rule per direction at most.
MAX_POINTS = 10
#: Chunks of boxes between two copies: at first, and then as many as there is room for.
FIRST, MAX_CHUNKS = 8, 128
#: What is integrated over: bits.
VOLUME, SURFACE = 1, 2
MAX_ROWS = 1 << 22  # of all boxes between two copies, that room is kept for
#: Points of a box, over polynomials that keep their integrals, above which they are thinned.
LONG = 2
#: The degree of these by the length of boxes, over that of cells: what they leave falls with the
#: power degree + 1 of it. Larger boxes are thinned in parts of the first length.
THINNED = {0.25: 4, 0.125: 3}
#: The same for as many points per direction as degree 3 takes: the squares of its functions have
#: degree 6 at least, of which shorter parts leave less than 1e-7. Who asks for more wants them all.
FINELY, MAX_THINNED = {0.125: 5}, 5
#: Points of a box, or of such a part of it, above which they are thinned in any case, and to which
#: degree: boxes halved along a line where a zero set crosses itself have tens of thousands.
CROWDED, CAREFUL = 512, 5
#: Points per direction, of q in `EASED`, that boxes of a field do without: length over that of the
#: cell up to which, polynomials from which on, and how many. What q points leave falls with a high
#: power of the length: it stays below that of larger boxes (5e-5 of their volume for q = 4).
EASED = (4, 5)
#: These three, for the cases one after the other.
EASIER = ((0.25, 3, 1), (0.0625, 1, 1), (0.0625, 3, 2))
#: Points of a rule on pieces of splines that are expected before any are thinned, which takes
#: longer than what is done with them: a gigabyte. Halved boxes have many more than they need.
MANY = 2e7
SOFT_FROM = {VOLUME: 5, SURFACE: 2}  # points from which substitution at tangents pays


@dataclass(frozen=True, eq=False)
class Content:
    """Polynomials of some boxes.

    Attributes
    ----------
    tensors : ndarray, shape (n, m, (degree + 1)³)
        Bernstein coefficients.
    many : ndarray, shape (n,)
        How many of the m count.
    tables : ndarray, shape (n,)
        Bit b tells whether points are in the solid where just the polynomials of the ones in b are
        negative.
    names : ndarray, shape (n, m)
        Numbers of the polynomials, on surfaces.
    """

    tensors: FloatArray
    many: IntArray
    tables: IntArray
    names: IntArray


@dataclass(frozen=True, eq=False)
class Listing:
    """Boxes, or faces of boxes, that a rule is made on.

    Attributes
    ----------
    rows : ndarray, shape (k,) or (k, 3)
        Pieces, or boxes, that are cut.
    which : ndarray, shape (n,)
        Place in `rows` of each box; -1 for those that are full.
    boxes : ndarray, shape (n, 6)
        Lower corners and extents.
    sides : ndarray, shape (n,)
        -1 for the box itself, or 2 axis + side for one of its faces.
    cells : ndarray, shape (n,)
        Cells, increasing.
    part : ndarray, shape (n,), or None
        Lengths of boxes over those of their cells, where points may be thinned.
    small : float
        Lengths above which boxes keep what they have, unless they are crowded.
    halved : bool
        Whether boxes are those of a field, halved until they are simple: small ones take fewer
        points per direction.
    """

    rows: IntArray
    which: IntArray
    boxes: FloatArray
    sides: IntArray
    cells: IntArray
    part: FloatArray | None = None
    small: float = np.inf
    halved: bool = False


def gauss(n: int) -> tuple[FloatArray, FloatArray]:
    """Gauss points and weights on [0, 1]."""
    x, w = np.polynomial.legendre.leggauss(n)
    return 0.5 * (x + 1.0), 0.5 * w


def sites(order: int) -> tuple[FloatArray, FloatArray]:
    """Chebyshev-Lobatto sites on [0, 1], and the matrix from values there to coefficients."""
    p = order - 1
    x = 0.5 - 0.5 * np.cos(np.pi * np.arange(order) / p)
    return x, np.asarray(np.linalg.inv(bernstein(p, x)), np.float64)


def table(q: int, want: int, order: int) -> FloatArray:
    """Nodes and weights on [0, 1], those for integrands with square roots at the ends, sites."""
    x, w = gauss(q)
    rows = [x, w, x, w]
    if q >= SOFT_FROM[want]:
        rows = [x, w, x * x * (3.0 - 2.0 * x), 6.0 * x * (1.0 - x) * w]
    out = np.zeros((4, MAX_POINTS))
    out[:, :q] = rows
    at, inverse = sites(order)
    return np.concatenate([out.ravel(), np.pad(at, (0, 5 - order)), inverse.ravel()])


class Rows:
    """Arrays that grow, to about what the part that is done lets expect, at most twofold."""

    def __init__(self, wide: bool) -> None:
        self.count = 0
        self.wide = wide
        self.arrays: list[AnyArray] = [
            np.empty((0, 3)),
            np.empty(0),
            np.empty((0, 3)),
            np.empty(0, np.int8),
        ]

    def append(self, arena: FloatArray, room: IntArray, used: IntArray, done: float) -> None:
        """Add the rows of all chunks; `done` is the part of the boxes that they complete."""
        starts = self.count + np.cumsum(used) - used
        self.count += int(used.sum())
        if self.count > len(self.arrays[1]):
            expected = self.count / done
            need(
                (57.0 if self.wide else 32.0) * (2.0 * expected - self.count),
                f"a rule of about {expected:.1g} points, and one sorted",
                "use fewer cells, a smaller q or a part of the solid: a thin beam takes points in "
                "proportion to its length over its radius; of a function whose faces cross within "
                "cells, make a union or an intersection of fields; edges of solids take many in "
                "smooth unions and intersections (radius > 0), and few in sharp ones",
            )
            self._resize(min(int(1.03 * self.count / done) + 1, 2 * self.count))
        kernels.gather(len(used), arena, room, starts, used, *self.arrays)

    def finish(self) -> None:
        """Give back what is too much."""
        self._resize(self.count)

    def _resize(self, rows: int) -> None:
        """More or less room; large arrays are not copied for that."""
        for a in self.arrays[: 4 if self.wide else 2]:
            a.resize((rows, *a.shape[1:]), refcheck=False)


def thinning(listing: Listing, q: int) -> IntArray:
    """Points above which boxes are thinned, to which degree, in how many parts, and q (n, 4)."""
    out = np.zeros((len(listing.boxes), 4), np.int64)
    out[:, 3] = q
    if listing.part is None or not 1 < q <= MAX_THINNED:
        return out
    degrees = FINELY if q == MAX_THINNED else THINNED
    lengths = sorted(degrees, reverse=True)
    may = listing.part <= listing.small
    for length in lengths:
        here = may if length == lengths[0] else may & (listing.part <= length)
        out[here, 0] = LONG * moments_of(degrees[length])
        out[here, 1] = degrees[length]
    out[~may, :2] = CROWDED, CAREFUL
    out[:, 2] = np.ceil(listing.part / lengths[0])
    return out


def ease(thin: IntArray, pieces: Any, listing: Listing, q: int) -> None:
    """Set points per direction of the small ones of boxes that were halved."""
    if listing.part is None or not listing.halved or q not in EASED:
        return
    many = np.zeros(len(thin), np.int64)
    cut = listing.which >= 0
    many[cut] = np.diff(pieces.first)[listing.rows][listing.which[cut]]
    for length, least, fewer in EASIER:
        thin[(listing.part <= length) & (many >= least), 3] = q - fewer
    plain = ~cut & (thin[:, 2] == 1)
    thin[plain, 3] = thin[plain, 1] // 2 + 1  # Gauss points of the degree that would be left


def filled(pieces: Any, listing: Listing, want: int, q: int, accept: int) -> tuple[Rows, IntArray]:
    """Rows of a rule on boxes, sorted by cell, and their number for each box."""
    boxes, which = listing.boxes, listing.which
    rows = Rows(want == SURFACE)
    counts = np.zeros(len(boxes), np.int64)
    asked = np.array([pieces.project, accept, want], np.int64)
    numbers = np.stack([table(n, want, pieces.order) for n in range(1, q + 1)])
    thin = thinning(listing, q)
    ease(thin, pieces, listing, q)
    degrees = thin[:, 1].copy()
    if not listing.halved:
        thin[:, 1] = 0
    width = 8 if want == SURFACE else 4
    most, chunks, done = kernels.CHUNK * 3 * q**3, FIRST, 0
    arena, none = np.empty((0, width)), np.empty((0, 12 - width))
    while done < len(boxes):
        part = slice(done, min(done + chunks * kernels.CHUNK, len(boxes)))
        local = which[part].copy()
        content = pieces.content(listing.rows[local[local >= 0]])
        local[local >= 0] = np.arange(len(content.tensors))
        used = np.zeros(-(-(part.stop - done) // kernels.CHUNK), np.int64)
        room = np.arange(len(used) + 1) * max(most, MAX_ROWS // chunks)
        while True:
            if room[-1] > len(arena):
                arena = np.empty((room[-1], width))
            volume, surface = (none, arena) if want == SURFACE else (arena, none)
            kernels.rules(
                len(used), (content.tensors, content.many, content.tables, content.names), local,
                boxes[part], listing.sides[part], thin[part], numbers, asked, pieces.lengths,
                volume, surface, room, counts[part], used,
            )  # fmt: skip
            fits = used <= np.diff(room)
            if fits.all():
                break
            room = np.append(0, np.cumsum(np.where(fits, np.diff(room), used)))
            most = max(most, int(used.max()))  # the next ones may be as long
        rows.append(arena, room, used, part.stop / len(boxes))
        chunks = min(max(MAX_ROWS // most, FIRST), MAX_CHUNKS)
        done = part.stop
        if rows.count * len(boxes) > MANY * done:
            thin[:, 1] = degrees
    rows.finish()
    return rows, counts
