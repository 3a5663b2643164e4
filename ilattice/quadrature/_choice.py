"""Which smooth fields matter in which boxes, with their interpolants.

Guarantee: a field of which bounds tell the sign on a box is left out there.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from ilattice._typing import AnyArray, FloatArray, IntArray
from ilattice.bspline.bezier import bernstein
from ilattice.errors import InputError
from ilattice.fields._formula import Splitter, signature
from ilattice.fields._logic import Formula
from ilattice.fields.node import Node
from ilattice.quadrature._filling import Content, sites

CHECKS = 8  # random points per box at which interpolants are compared
EXACT = 1e-11  # of coefficients: interpolants are called exact below
NOISE = 1e-14  # of values of fields: below this part of the largest they are zero
#: The same of bounds, which are wider than values, on cells and on quarters of them and less: what
#: is thin at places where fields are flat shows in smaller boxes, where values are smaller, too.
BOUNDS = 1e-13, 1e-12
PLACES = 1e-15  # the same, times the distance from zero in lengths of the box
RESOLVED = 1e-4  # interpolants may be off by this part of what fields change by, however thin these
BATCH = 1 << 10  # boxes interpolated at once
STEP = 1e-4  # of a box: for slopes
#: Part of a box, without bounds, in which solid may be missed though no point that was looked at
#: tells so: counts only where no solid is found at all.
MIN_UNRESOLVED = 1e-9
#: Steps of the search for a sign that no point has that was looked at, and how much longer each is
#: than one to where a straight field vanishes: distances vanish there, and change sign just behind.
DIVES, BEYOND = 12, 1.2
#: What such a sign has of the slab between two sites: from nothing to half, to the nearer one.
SLAB = 0.25


@dataclass(eq=False)
class Chosen:
    """Smooth fields per box.

    Attributes
    ----------
    certain : ndarray, shape (n,)
        -1 for boxes in the solid, 1 for those outside, 0 for those with fields, and 2 for those
        that have too many of them.
    first : ndarray, shape (n + 1,)
        The fields of box i are those from first[i] to first[i + 1].
    leaf : ndarray, shape (k,)
        Their numbers.
    tables : ndarray, shape (n,)
        See `Content`.
    coefficients : ndarray, shape (k, order³)
        Bernstein coefficients, once there are some.
    """

    certain: IntArray
    first: IntArray
    leaf: IntArray
    tables: IntArray
    coefficients: FloatArray

    @property
    def many(self) -> IntArray:
        """Number of fields of each box."""
        return np.diff(self.first)

    def rows(self, boxes: IntArray) -> IntArray:
        """Places of the fields of some boxes, one box after the other."""
        many = self.many[boxes]
        ends = np.cumsum(many)
        return np.repeat(self.first[boxes] - (ends - many), many) + np.arange(
            ends[-1] if len(ends) else 0
        )

    def take(self, boxes: AnyArray) -> "Chosen":
        """Some of the boxes."""
        boxes = np.flatnonzero(boxes) if boxes.dtype == bool else boxes
        rows = self.rows(boxes)
        c = self.coefficients
        return Chosen(
            self.certain[boxes],
            np.append(0, np.cumsum(self.many[boxes])),
            self.leaf[rows],
            self.tables[boxes],
            c[rows] if len(c) else c,
        )

    def put(self, boxes: IntArray, other: "Chosen", drop: AnyArray) -> None:
        """Coefficients of some boxes, the only ones with fields; `drop` says which lose them."""
        keep = np.repeat(~drop, other.many)
        many = self.many
        many[boxes[drop]] = 0
        self.first = np.append(0, np.cumsum(many))
        self.leaf, self.coefficients = other.leaf[keep], other.coefficients[keep]

    def plain(self, box: FloatArray) -> AnyArray:
        """Whether no interpolant vanishes anywhere in its box (n, 6), by its coefficients."""
        c = self.coefficients
        low, high = c.min(axis=1, initial=np.inf), c.max(axis=1, initial=-np.inf)
        out = np.ones(len(self.many), bool)
        owner = np.repeat(np.arange(len(out)), self.many)
        slack = 10.0 * rounding(box)[owner] * np.maximum(np.abs(low), np.abs(high))
        out[owner[(low <= slack) & (high >= -slack)]] = False
        return out

    def content(self, order: int) -> Content:
        """The polynomials of all boxes."""
        m = max(int(self.many.max(initial=1)), 1)
        there = np.arange(m) < self.many[:, None]
        tensors = np.zeros((len(self.many), m, order**3))
        tensors[there] = self.coefficients
        return Content(tensors, self.many, self.tables, np.zeros((len(self.many), m), np.int64))

    @staticmethod
    def joined(parts: "Sequence[Chosen]") -> "Chosen":
        """One after the other."""
        some = [p.coefficients for p in parts if len(p.leaf)]
        return Chosen(
            np.concatenate([p.certain for p in parts]),
            np.append(0, np.cumsum(np.concatenate([p.many for p in parts]))),
            np.concatenate([p.leaf for p in parts]),
            np.concatenate([p.tables for p in parts]),
            np.concatenate(some) if some else np.zeros((0, 1)),
        )


def rounding(box: FloatArray) -> FloatArray:
    """Relative error of values of fields on boxes (n, 6): their own, and that of the places."""
    far = (np.abs(box[:, :3]) / box[:, 3:]).max(axis=1)
    return np.asarray(NOISE + PLACES * far)


@dataclass(frozen=True, eq=False)
class Measured:
    """What is known of boxes after interpolation.

    Attributes
    ----------
    unknown : ndarray of bool, shape (n,)
        Whether the sign of a field that the interpolant has is not certain.
    blind : ndarray of bool, shape (n,)
        Whether that is one without bounds.
    exact : ndarray of bool, shape (n,)
        Whether all interpolants are exact.
    hidden : ndarray of bool, shape (n,)
        Whether a field without bounds has a sign that it has nowhere where it was interpolated.
    unresolved : ndarray, shape (n,)
        Part of the box of which the sign is not known, if it is not halved.
    """

    unknown: AnyArray
    blind: AnyArray
    exact: AnyArray
    hidden: AnyArray
    unresolved: FloatArray


class Splits:
    """Fields, split at their kinks, on boxes."""

    def __init__(self, fields: Sequence[Node], domain: FloatArray, degree: int) -> None:
        self.splitter = Splitter(fields)
        self.domain, self.degree = domain, degree
        self._sites, self._inverse = sites(degree + 1)

    def names(self, leaf: IntArray) -> IntArray:
        """Number of the field, in a pair, of smooth fields."""
        owners = np.array([*self.splitter.owners, 0], np.int64)
        return owners[leaf]

    def choose(self, box: FloatArray, small: AnyArray, last: AnyArray) -> Chosen:
        """Fields and tables of boxes (n, 6), `small` or not; in the `last` formulas may be long."""
        lo, hi = self._corners(box)
        n = len(box)
        bounds, states = self.splitter.decided(lo, hi)
        slack = _slack(bounds, box, small)
        certain = np.where(bounds[:, 1] < -slack, -1, np.where(bounds[:, 0] >= -slack, 1, 0))
        tables = np.zeros(n, np.int64)
        leaves: list[tuple[int, ...]] = [()] * n
        todo = np.flatnonzero(certain == 0)
        first, group = signature(states[todo])
        known = []
        for g in range(len(first)):
            boxes = todo[group == g]
            formula = self.splitter.formula(states[todo[first[g]]])
            if formula is None:
                certain[boxes] = 2
            else:
                known.append((boxes, formula))
        for boxes, found in self._restricted(known, box, small):
            if found is None:
                certain[boxes] = 2
                continue
            mine, table = found
            tables[boxes] = np.array(table, np.uint64).astype(np.int64)
            if not mine:
                certain[boxes] = -1 if table else 1
            for i in boxes:
                leaves[i] = mine
        whole = self.splitter.whole
        for i in np.flatnonzero((certain == 2) & last):
            found = whole.restricted((0,))
            assert found is not None
            certain[i], leaves[i] = 0, found[0]
            tables[i] = np.array(found[1], np.uint64).astype(np.int64)
        many = np.array([len(x) for x in leaves], np.int64)
        flat = np.array([leaf for x in leaves for leaf in x], np.int64)
        return Chosen(certain, np.append(0, np.cumsum(many)), flat, tables, np.zeros((0, 1)))

    def _restricted(
        self, known: Sequence[tuple[IntArray, Formula]], box: FloatArray, small: AnyArray
    ) -> Iterator[tuple[IntArray, tuple[tuple[int, ...], int] | None]]:
        """Boxes by the signs that bounds give to the fields of their formulas, and what is left."""
        if not known:
            return
        leaf = np.concatenate([np.repeat(f.leaves, len(b)) for b, f in known]).astype(np.int64)
        here = np.concatenate([np.tile(b, len(f.leaves)) for b, f in known])
        r = self.splitter.ranges(leaf, *self._corners(box[here]))
        slack = _slack(r, box[here], small[here])
        signs = np.where(r[:, 1] < -slack, -1, np.where(r[:, 0] > slack, 1, 0))
        end = 0
        for boxes, formula in known:
            start, end = end, end + len(boxes) * len(formula.leaves)
            mine = signs[start:end].reshape(len(formula.leaves), len(boxes)).T
            first, group = signature(np.ascontiguousarray(mine))
            for g in range(len(first)):
                yield boxes[group == g], formula.restricted(mine[first[g]].tolist())

    def _corners(self, box: FloatArray) -> tuple[FloatArray, FloatArray]:
        lo, hi = self.domain
        return np.clip(box[:, :3], lo, hi), np.clip(box[:, :3] + box[:, 3:], lo, hi)

    # ------------------------------------------------------------------ interpolation

    def interpolate(self, chosen: Chosen, box: FloatArray, small: AnyArray) -> Measured:
        """Set coefficients of fields on boxes (n, 6), and compare them at random points."""
        P = self.degree + 1
        owner = np.repeat(np.arange(len(box)), chosen.many)
        chosen.coefficients = np.empty((len(owner), P**3))
        off, wrong, lowest = np.empty(len(owner)), np.empty(len(owner)), np.empty((len(owner), 3))
        bounded, crossed, certain = (np.empty(len(owner), bool) for _ in range(3))
        rows = np.argsort(chosen.leaf, kind="stable")
        for i in range(0, len(rows), BATCH):
            part = rows[i : i + BATCH]
            leaf, here = chosen.leaf[part], box[owner[part]]
            c, off[part], wrong[part], crossed[part], lowest[part] = self._interpolated(leaf, here)
            chosen.coefficients[part] = c
            r = self.splitter.ranges(leaf, *self._corners(here))
            bounded[part] = np.isfinite(r).all(axis=1)
            slack = _slack(r, here, small[owner[part]])
            certain[part] = (r[:, 0] >= -slack) | (r[:, 1] <= slack)
        open_ = _open(chosen, off, bounded, crossed | certain)
        hidden = np.zeros(len(owner), bool)
        todo = np.flatnonzero(open_ & ~bounded & (wrong <= MIN_UNRESOLVED))
        hidden[todo] = self._hidden(chosen.leaf[todo], box[owner[todo]], lowest[todo])
        wrong[hidden] = SLAB / self.degree
        return _measured(
            chosen, owner, off, np.where(bounded, 1.0, wrong), (open_, bounded, hidden)
        )

    def _interpolated(
        self, leaf: IntArray, box: FloatArray
    ) -> tuple[FloatArray, FloatArray, FloatArray, AnyArray, FloatArray]:
        """Coefficients, their error, the part of wrong signs, whether they differ, least points.

        Signs differ where the interpolant follows the field on both sides of zero: one that is off
        by more than the field is deep may miss a solid that is thin, or hold one that is not there.
        """
        P = self.degree + 1
        t = self._sites
        u = np.empty((len(box), P, P, P, 3))
        for a, shape in enumerate(((-1, P, 1, 1), (-1, 1, P, 1), (-1, 1, 1, P))):
            u[..., a] = (box[:, a, None] + box[:, 3 + a, None] * t).reshape(shape)
        values = self._values(leaf, u.reshape(-1, P**3, 3)).reshape(-1, P, P, P)
        V = self._inverse
        c = np.einsum("ia,jb,kc,nabc->nijk", V, V, V, values, optimize=True).reshape(-1, P**3)
        top = np.abs(c).max(axis=1, keepdims=True)
        c[np.abs(c) <= 2.0 * rounding(box)[:, None] * top] = 0.0
        s = np.random.default_rng(0).random((CHECKS, 3))
        basis = [bernstein(self.degree, s[:, a]) for a in range(3)]
        B = np.einsum("qi,qj,qk->qijk", *basis).reshape(CHECKS, -1)
        x = box[:, None, :3] + box[:, None, 3:] * s
        seen = self._values(leaf, x)
        off = np.abs(c @ B.T - seen).max(axis=1)
        every = np.concatenate([values.reshape(-1, P**3), seen], axis=1)
        wrong = ((c @ B.T < 0.0) != (seen < 0.0)).mean(axis=1)
        low, high = every.min(axis=1), every.max(axis=1)
        seen_there = np.maximum(0.5 * np.minimum(-low, high), RESOLVED * (high - low))
        crossed = (low < 0.0) & (high > 0.0) & (off <= seen_there)
        least = np.abs(every).argmin(axis=1)
        points = np.concatenate([u.reshape(len(box), -1, 3), x], axis=1)[np.arange(len(box)), least]
        return c, off, np.maximum(wrong, MIN_UNRESOLVED), crossed, points

    def _hidden(self, leaf: IntArray, box: FloatArray, x: FloatArray) -> AnyArray:
        """Whether fields (n,), of one sign where they were looked at, have another one in boxes.

        By steps from the least values, at x (n, 3), to where a straight field would change sign.
        """
        found = np.zeros(len(leaf), bool)
        rows = np.arange(len(leaf))
        value = self._values(leaf, x[:, None])[:, 0]
        sign, long = np.where(value < 0.0, -1.0, 1.0), np.full(len(leaf), BEYOND)
        best = value * sign
        for _ in range(DIVES):
            here = box[rows]
            slope = self._slopes(leaf[rows], here, x[rows])
            square = (slope**2).sum(axis=1)
            step = (value[rows] / np.where(square > 0.0, square, np.inf))[:, None] * slope
            y = np.clip(x[rows] - long[rows, None] * step, here[:, :3], here[:, :3] + here[:, 3:])
            new = self._values(leaf[rows], y[:, None])[:, 0]
            found[rows] = new * sign[rows] < 0.0
            nearer = new * sign[rows] < best[rows]
            better = rows[nearer]
            x[better], value[better] = y[nearer], new[nearer]
            best[better] = new[nearer] * sign[better]
            long[rows[~nearer]] *= 0.5
            rows = rows[~found[rows] & (long[rows] > 0.1)]
            if not len(rows):
                break
        return found

    def _slopes(self, leaf: IntArray, box: FloatArray, x: FloatArray) -> FloatArray:
        """Gradients (n, 3) of fields (n,) at points (n, 3) by differences."""
        h = STEP * box[:, None, 3:] * np.eye(3)
        near = np.concatenate([x[:, None] + h, x[:, None] - h], axis=1)
        near = np.clip(near, *self.domain)
        values = self._values(leaf, near)
        apart = np.diagonal(near[:, :3] - near[:, 3:], axis1=1, axis2=2)
        return np.asarray((values[:, :3] - values[:, 3:]) / apart)

    def _values(self, leaf: IntArray, u: FloatArray) -> FloatArray:
        """Values (n, q) of fields (n,) at points (n, q, 3)."""
        values = self.splitter.values(leaf, np.clip(u, *self.domain))
        if not np.isfinite(values).all():
            raise InputError("field must be finite on the whole domain; shrink the domain")
        return values

    # ------------------------------------------------------------------ errors

    def distances(
        self, points: FloatArray, normals: FloatArray, leaf: IntArray, reach: FloatArray
    ) -> FloatArray:
        """Distances from points near the zero sets of fields to these, to first order."""
        h = STEP * reach[:, None]
        x = np.stack([points, points + h * normals, points - h * normals], axis=1)
        value, up, down = self._values(leaf, x).T
        slope = np.abs(up - down) / (2.0 * h[:, 0])
        with np.errstate(divide="ignore", invalid="ignore"):
            off = np.where(value == 0.0, 0.0, np.abs(value) / slope)
        return np.asarray(np.minimum(off, reach))

    def blind_boxes(self, chosen: Chosen) -> AnyArray:
        """Whether boxes are not to be halved often, for a field that each holds."""
        blind = np.array([*(not leaf.halved for leaf in self.splitter.leaves), False])
        out = np.zeros(len(chosen.many), bool)
        out[np.repeat(np.arange(len(out)), chosen.many)[blind[chosen.leaf]]] = True
        return out


def _slack(ranges: FloatArray, box: FloatArray, small: AnyArray) -> FloatArray:
    """What counts as zero of bounds (n, 2) on boxes (n, 6)."""
    top = np.abs(ranges).max(axis=1)
    part = np.maximum(rounding(box), np.where(small, BOUNDS[1], BOUNDS[0]))
    return np.where(np.isfinite(top), part * np.where(np.isfinite(top), top, 0.0), 0.0)


def _open(chosen: Chosen, off: FloatArray, bounded: AnyArray, known: AnyArray) -> AnyArray:
    """Whether the sign of each field, which its interpolant has, is not certain on its box."""
    c = chosen.coefficients
    low, high = c.min(axis=1, initial=np.inf), c.max(axis=1, initial=-np.inf)
    margin = np.maximum(np.maximum(low, -high), 0.0)
    return np.asarray(~known & ~_exact(c, off) & (bounded | (margin < 2.0 * off)))


def _exact(c: FloatArray, off: FloatArray) -> AnyArray:
    """Whether interpolants are their fields, up to rounding."""
    return np.asarray(off <= EXACT * np.abs(c).max(axis=1, initial=0.0))


def _measured(
    chosen: Chosen, owner: IntArray, off: FloatArray, wrong: FloatArray,
    known: tuple[AnyArray, AnyArray, AnyArray],
) -> Measured:  # fmt: skip
    """What is known of boxes by that of their fields: if open, bounded, hidden."""
    open_, bounded, hidden = known
    n = len(chosen.many)
    out = [np.zeros(n, bool) for _ in range(4)]
    rough = ~_exact(chosen.coefficients, off)
    for a, values in zip(out, (open_, open_ & ~bounded, rough, hidden), strict=True):
        a[owner[values]] = True
    unresolved = np.zeros(n)
    np.maximum.at(unresolved, owner, wrong * open_)
    return Measured(out[0], out[1], ~out[2], out[3], unresolved)
