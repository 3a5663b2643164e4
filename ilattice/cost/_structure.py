"""`Structure`: simplices and bars as arrays, with their measures; what `CornerSharing` is made of.

Guarantees: immutable; edges follow from simplices and bars, in a fixed order; `check` proves the
combinatorial conditions of a corner-sharing structure. What is made from a structure is of its
class.
"""

from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any, Generic, Self, TypeVar

import numpy as np

from ilattice._typing import AnyArray, ArrayLike, FloatArray, IntArray
from ilattice._validate import Frozen, as_array, as_not_negative, as_whole, read_only
from ilattice.cost._kernels_kagome import PAIRS2, PAIRS3
from ilattice.errors import GeometryError, InputError

#: Size of positions above which, or below the inverse of which, volumes are no numbers.
MAX_SIZE = 1e100

K = TypeVar("K", bound="Structure")
K_co = TypeVar("K_co", bound="Structure", covariant=True)


@dataclass(frozen=True, eq=False)
class Origin(Frozen):
    """Where the vertices of Kagome structures come from.

    Attributes
    ----------
    integers : ndarray of int, shape (n, d + 1)
        Barycentric integers of the vertices in their cells.
    cell : ndarray of int, shape (n,)
        Cell of each vertex: one of those that share it.
    cells : ndarray of int, shape (c, d + 1)
        Corners of the cells, by their numbers in the mesh that was filled.
    resolution : ndarray of int, shape (c,)
        Resolutions of the cells.
    """

    integers: IntArray
    cell: IntArray
    cells: IntArray
    resolution: IntArray


@dataclass(frozen=True, eq=False)
class Coarse(Frozen, Generic[K_co]):
    """What a structure is the refinement of, by rule R0.

    Attributes
    ----------
    structure : CornerSharing
        The coarser structure.
    rows : ndarray of int, shape (r,)
        Its simplices that were refined. The others come first in the finer one, then the d + 1
        children of each of these; its vertices come first, then the midpoints of their edges.
    """

    structure: K_co
    rows: IntArray


@dataclass(frozen=True, eq=False, repr=False)
class Structure(Frozen):
    """Triangles or tetrahedra with bars: the arrays of a `CornerSharing`, and what follows."""

    positions: FloatArray
    simplices: IntArray
    bars: IntArray = field(default_factory=lambda: np.zeros((0, 2), np.int64))
    origin: Origin | None = None
    coarse: "Coarse[Self] | None" = None

    def __post_init__(self) -> None:
        """Check shapes and numbers; `check` looks at the rest."""
        x = as_array("positions", self.positions, ndim=2, flags=False)
        if x.shape[1] not in (2, 3):
            raise InputError(f"positions must have shape (n, 2) or (n, 3), got {x.shape}")
        if not len(x):
            raise InputError("positions must have one row or more: an empty structure is none")
        size = float(np.abs(x).max())
        if not (size == 0.0 or 1.0 / MAX_SIZE <= size <= MAX_SIZE):
            raise InputError(
                f"positions must be from {1.0 / MAX_SIZE:g} to {MAX_SIZE:g} in size, "
                f"got {size:.3g}: change units"
            )
        put = object.__setattr__
        put(self, "positions", np.array(x))
        put(self, "simplices", _numbers("simplices", self.simplices, x.shape[1] + 1, len(x)))
        bars = self.bars if np.size(self.bars) else np.zeros((0, 2))
        put(self, "bars", _numbers("bars", bars, 2, len(x)))
        super().__post_init__()

    def __repr__(self) -> str:
        kind = "triangles" if self.dim == 2 else "tetrahedra"
        return (
            f"{type(self).__name__}({len(self.simplices)} {kind}, {len(self.positions)} vertices, "
            f"{len(self.bars)} bars)"
        )

    # ------------------------------------------------------------------ what there is

    @property
    def dim(self) -> int:
        """Dimension d of space, 2 or 3."""
        return self.positions.shape[1]

    @cached_property
    def edges(self) -> IntArray:
        """Ends (e, 2) of all edges: those of the simplices in their order, then the bars."""
        pairs = PAIRS2 if self.dim == 2 else PAIRS3
        inner = self.simplices[:, pairs].reshape(-1, 2)
        edges: IntArray = read_only(np.concatenate([inner, self.bars]))
        return edges

    @cached_property
    def lengths(self) -> FloatArray:
        """Lengths (e,) of the edges."""
        ends = self.positions[self.edges]
        return np.asarray(read_only(np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1)))

    @cached_property
    def shortest(self) -> FloatArray:
        """Length (n,) of the shortest edge at each vertex: a measure for radii of beams."""
        out = np.full(len(self.positions), np.inf)
        np.minimum.at(out, self.edges, self.lengths[:, None])
        return np.asarray(read_only(out))

    @cached_property
    def incidence(self) -> IntArray:
        """The one or two simplices (n, 2) of each vertex, in rising order; -1 where there is none.

        Raises
        ------
        GeometryError
            If three simplices share a vertex.
        """
        flat = self.simplices.ravel()
        order = np.argsort(flat, kind="stable")
        count = np.bincount(flat, minlength=len(self.positions))
        if count.max(initial=0) > 2:
            v = int(np.argmax(count > 2))
            rows = np.flatnonzero((self.simplices == v).any(axis=1))[:3].tolist()
            raise GeometryError(
                f"vertex {v} is shared by {int(count[v])} simplices, among them {rows}: at most "
                "two may share one"
            )
        out = np.full((len(self.positions), 2), -1, np.int64)
        first = np.cumsum(count) - count
        place = np.arange(len(flat)) - first[flat[order]]
        out[flat[order], place] = order // (self.dim + 1)
        return np.asarray(read_only(out))

    @cached_property
    def valence(self) -> IntArray:
        """Number of edges (n,) at each vertex."""
        return np.asarray(read_only(np.bincount(self.edges.ravel(), minlength=len(self.positions))))

    @property
    def trivial(self) -> int:
        """Number of rigid motions: 3 in the plane, 6 in space."""
        return self.dim * (self.dim + 1) // 2

    @property
    def deficit(self) -> int:
        """How many more bars minimal rigidity needs by count: d n - d (d + 1) / 2 - e."""
        return self.dim * len(self.positions) - self.trivial - len(self.edges)

    @cached_property
    def volumes(self) -> FloatArray:
        """Signed areas, or volumes, (m,) of the simplices."""
        corners = self.positions[self.simplices]
        sides = corners[:, 1:] - corners[:, :1]
        return np.asarray(read_only(np.linalg.det(sides) / (2.0 if self.dim == 2 else 6.0)))

    @property
    def mass(self) -> float:
        """Area, or volume, of all simplices: tells how mass changes, not how much there is."""
        return float(np.abs(self.volumes).sum())

    # ------------------------------------------------------------------ checks

    def check(self) -> Self:
        """Prove the combinatorial conditions of a corner-sharing structure.

        No simplex names a vertex twice, every vertex is in one or two simplices, two simplices
        share one vertex at most, and no edge is there twice.

        Returns
        -------
        CornerSharing
            The structure itself.

        Raises
        ------
        GeometryError
            Where a condition fails; the message names the simplices, the vertex or the bar.
        """
        sorted_rows = np.sort(self.simplices, axis=1)
        twice = (np.diff(sorted_rows, axis=1) == 0).any(axis=1)
        if twice.any():
            i = int(np.argmax(twice))
            raise GeometryError(f"simplices[{i}] {self.simplices[i].tolist()} has a vertex twice")
        vt = self.incidence
        alone = vt[:, 0] < 0
        if alone.any():
            raise GeometryError(
                f"vertex {int(np.argmax(alone))} is in no simplex ({int(alone.sum())} are in none)"
            )
        shared = vt[vt[:, 1] >= 0]
        pairs, count = np.unique(shared, axis=0, return_counts=True)
        if (count > 1).any():
            i = int(np.argmax(count > 1))
            a, b = (int(x) for x in pairs[i])
            raise GeometryError(
                f"simplices {a} and {b} share {int(count[i])} vertices, so an edge is theirs in "
                "common: they may share one"
            )
        self._check_bars()
        return self

    def _check_bars(self) -> None:
        """Refuse bars that join a vertex with itself or are there already."""
        n = len(self.positions)
        e = np.sort(self.edges, axis=1)
        loop = e[:, 0] == e[:, 1]
        keys = e[:, 0] * n + e[:, 1]
        _, first = np.unique(keys, return_index=True)
        again = np.ones(len(e), np.bool_)
        again[first] = False
        bad = np.flatnonzero(loop | again)
        if len(bad):
            i = int(bad[0]) - (len(e) - len(self.bars))
            what = "joins a vertex with itself" if loop[bad[0]] else "is there twice"
            name = f"bars[{i}]" if i >= 0 else f"edge {int(bad[0])}"
            raise GeometryError(f"{name} {self.edges[bad[0]].tolist()} {what}: drop it")

    # ------------------------------------------------------------------ changes of position

    def moved(self, positions: ArrayLike) -> Self:
        """The same structure with other positions.

        Parameters
        ----------
        positions : array_like, shape (n, d)
            Where the vertices are.

        Returns
        -------
        CornerSharing
            The structure; it knows no more of a coarser one.
        """
        x = as_array("positions", positions, ndim=2, flags=False)
        if x.shape != self.positions.shape:
            raise InputError(f"positions must have shape {self.positions.shape}, got {x.shape}")
        return replace(self, positions=x, coarse=None)

    def perturbed(self, amount: float = 0.05, *, seed: int = 0) -> Self:
        """Vertices moved at random, as for generic ranks.

        Parameters
        ----------
        amount : float
            Most that a coordinate changes, in mean lengths of edges.
        seed : int
            Of the random numbers.

        Returns
        -------
        CornerSharing
            The structure.
        """
        a = as_not_negative("amount", amount)
        rng = np.random.default_rng(as_whole("seed", seed, 0, 2**63 - 1))
        if not len(self.edges):
            raise GeometryError("the structure has no edges, so no length that moves are parts of")
        step = a * float(self.lengths.mean())
        return self.moved(self.positions + rng.uniform(-step, step, self.positions.shape))

    def with_bars(self, bars: ArrayLike) -> Self:
        """The structure with further bars.

        Parameters
        ----------
        bars : array_like of int, shape (k, 2)
            Ends of the bars.

        Returns
        -------
        CornerSharing
            The structure.

        Raises
        ------
        GeometryError
            If a bar is there already, or joins a vertex with itself.
        """
        new = _numbers("bars", bars, 2, len(self.positions))
        out = replace(self, bars=np.concatenate([self.bars, new]), coarse=None)
        out._check_bars()
        return out

    def fitted(self, box: ArrayLike) -> Self:
        """Positions scaled and moved along the axes so that they fill a box.

        Parameters
        ----------
        box : array_like, shape (2, d)
            Lower and upper corner, such as the `domain` of a map.

        Returns
        -------
        CornerSharing
            The structure.
        """
        b = as_array("box", box, ndim=2)
        if b.shape != (2, self.dim) or not (b[0] < b[1]).all():
            raise InputError(f"box must be two corners (2, {self.dim}), lower one first, got {b}")
        low, high = self.positions.min(axis=0), self.positions.max(axis=0)
        if not (high > low).all():
            raise GeometryError(
                f"the structure is flat along axis {int(np.argmin(high - low))}: it fills no box"
            )
        t = (self.positions - low) / (high - low)
        return self.moved(b[0] + t * (b[1] - b[0]))


def _numbers(name: str, value: Any, width: int, count: int) -> AnyArray:
    """Rows of vertices, checked."""
    a = value
    if not (isinstance(a, np.ndarray) and a.dtype.kind in "iu"):
        found = as_array(name, value)
        a = found.astype(np.int64)
        if (a != found).any():
            raise InputError(f"{name} must be whole numbers, got {value!r:.80}")
    if a.ndim != 2 or a.shape[1] != width:
        raise InputError(f"{name} must have shape (m, {width}), got {np.shape(value)}")
    wrong = ((a < 0) | (a >= count)).any(axis=1)
    if wrong.any():
        i = int(np.argmax(wrong))
        raise InputError(
            f"{name}[{i}] is {a[i].tolist()}: vertices have numbers from 0 to {count - 1}"
        )
    return np.array(a, np.int64)
