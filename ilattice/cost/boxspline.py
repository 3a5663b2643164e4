"""Box splines on the lattices of Kagome structures, by subdivision.

In the plane the three directions (1, 0), (0, 1), (1, 1), in space the four directions of the unit
vectors and (-1, -1, -1), each twice: C² of degree 4, and of degree 5. The control array is indexed
by the first d barycentric integers: 1 at vertices, -1 elsewhere; the solid is where the spline is
positive, its field the negative (paper, Section 3.8).

`BoxSpline` is that field, exactly, with derivatives and bounds; `field` makes it for a Kagome
structure, `tile` for the endless one.

Guarantees: the masks are exact dyadic fractions; polynomials have coefficients in whole 24ths (in
the plane) and 120ths (in space), so that values are exact up to rounding. Not guaranteed: which
embedding of the four directions the paper draws.
"""

import math
from dataclasses import dataclass
from functools import cache, cached_property
from itertools import permutations, product
from typing import Any

import numpy as np

from ilattice._memory import need
from ilattice._typing import ArrayLike, FloatArray, IntArray
from ilattice._validate import as_array, as_choice, as_flag, as_points, as_real, as_triple, as_whole
from ilattice.cost import _kernels_boxspline as kernels
from ilattice.cost.kagome import TETRAHEDRON
from ilattice.cost.structure import CornerSharing
from ilattice.errors import InputError
from ilattice.fields.node import Whole, everywhere, nowhere
from ilattice.tiles import Tile

DIRECTIONS = {2: ((1, 0), (0, 1), (1, 1)), 3: ((1, 0, 0), (0, 1, 0), (0, 0, 1), (-1, -1, -1))}


def mask(dim: int) -> tuple[IntArray, FloatArray]:
    """Subdivision mask: 2^d times the product of ((1 + z^xi) / 2)² over the directions xi.

    Parameters
    ----------
    dim : {2, 3}
        Dimension.

    Returns
    -------
    ndarray of int, shape (t, d)
        Exponents: 19 in the plane, 65 in space.
    ndarray, shape (t,)
        Taps, of sum 2^d.
    """
    d = int(as_choice("dim", dim, (2, 3)))
    taps: dict[tuple[int, ...], float] = {(0,) * d: float(2**d)}
    for xi, _ in product(DIRECTIONS[d], range(2)):
        new: dict[tuple[int, ...], float] = {}
        for at, value in taps.items():
            there = tuple(a + b for a, b in zip(at, xi, strict=True))
            new[at] = new.get(at, 0.0) + 0.5 * value
            new[there] = new.get(there, 0.0) + 0.5 * value
        taps = new
    rows = sorted(taps)
    return np.array(rows, np.int64), np.array([taps[r] for r in rows])


def subdivided(values: ArrayLike, *, outside: float = -1.0) -> FloatArray:
    """One step of subdivision: twice as fine, centred on the old places.

    The array, spread by zeros, is averaged with its copy shifted by each direction, twice.

    Parameters
    ----------
    values : array_like of 2 or 3 axes
        Control values.
    outside : float
        What they are beyond the array.

    Returns
    -------
    ndarray
        Of shape 2 n - 1 along each axis: the value at 2 i belongs to the place i before.
    """
    c = as_array("values", values)
    d = c.ndim
    if d not in DIRECTIONS:
        raise InputError(f"values must have 2 or 3 axes, got shape {c.shape}")
    need(8.0 * 4**d * c.size, "a subdivided array", "take fewer steps")
    room = 2  # so many old places reach beyond the array
    c = np.pad(c, room, constant_values=outside)
    fine = np.zeros([2 * n for n in c.shape])
    fine[(slice(None, None, 2),) * d] = 2.0**d * c
    for xi, _ in product(DIRECTIONS[d], range(2)):
        fine = 0.5 * (fine + np.roll(fine, xi, axis=tuple(range(d))))
    centre = np.sum(DIRECTIONS[d], axis=0)  # the mask is symmetric about the sum of directions
    fine = np.roll(fine, tuple(-centre), axis=tuple(range(d)))
    inner = tuple(slice(2 * room, 2 * room + 2 * n - 1) for n in np.array(c.shape) - 2 * room)
    return np.ascontiguousarray(fine[inner])


def control(k: CornerSharing) -> FloatArray:
    """Control array of a Kagome structure: 1 at its vertices, -1 elsewhere.

    Parameters
    ----------
    k : CornerSharing
        Made by `ilattice.cost.kagome`.

    Returns
    -------
    ndarray of d axes
        Indexed by the first d barycentric integers.
    """
    o = k.origin
    if o is None or len(o.cells) != 1:
        raise InputError("control is for structures made by kagome: this one has another origin")
    out = np.full((int(o.integers.max()) + 2,) * k.dim, -1.0)
    out[tuple(o.integers[:, : k.dim].T)] = 1.0
    return out


def samples(k: CornerSharing, steps: int = 2) -> FloatArray:
    """Values of the box spline of a Kagome structure on a fine lattice; positive inside.

    Parameters
    ----------
    k : CornerSharing
        Made by `ilattice.cost.kagome`.
    steps : int
        Steps of subdivision.

    Returns
    -------
    ndarray of d axes
        The value at 2^steps i belongs to the barycentric integers i.
    """
    count, c = as_whole("steps", steps, 0, 8), control(k)
    room = 3  # old places by which what is outside reaches into the array, over all steps
    out = np.pad(c, room, constant_values=-1.0)
    for _ in range(count):
        out = subdivided(out)
    first = room << count
    return np.ascontiguousarray(
        out[tuple(slice(first, first + ((n - 1) << count) + 1) for n in c.shape)]
    )


def field(k: CornerSharing) -> "BoxSpline":
    """The solid of a Kagome structure as a smooth field: 0 where its box spline is.

    Parameters
    ----------
    k : CornerSharing
        Made by `ilattice.cost.kagome`, in any simplex. One in the plane gives columns along z.

    Returns
    -------
    BoxSpline
        The field, negative inside: the level set of Figure 16b in the plane, of Figure 18 in space.
    """
    values, d = control(k), k.dim
    o = k.origin
    assert o is not None
    corners = np.pad(_corners_of(k), ((0, 0), (0, 3 - d)))
    total = int(o.integers[0].sum())
    steps = (corners[:d] - corners[d]) / total
    return BoxSpline(values, origin=corners[d], steps=steps)


def tile() -> Tile:
    """The endless Kagome structure in space as a tile, its solid that of the box spline.

    Returns
    -------
    Tile
        In a cell with angles of 60 degrees (`Tile.cell`), that of face-centred cubic crystals.
    """
    odd = np.stack(np.meshgrid(*[np.arange(2)] * 3, indexing="ij"), -1).sum(axis=-1) >= 2
    spline = BoxSpline(np.where(odd, 1.0, -1.0), steps=0.5 * np.eye(3), periodic=True)
    edges = (TETRAHEDRON[:3] - TETRAHEDRON[3]).T
    return Tile(
        spline,
        name="kagome_box_spline",
        source="Sitharam et al., Section 3.8",
        edges=edges / np.linalg.norm(edges[:, 0]),
        symmetric=True,
        tol=1e-4,
    )


def _corners_of(k: CornerSharing) -> FloatArray:
    """Corners (d + 1, d) of the simplex of a structure, from where its vertices are now."""
    o = k.origin
    assert o is not None
    bary = o.integers / o.integers[0].sum()
    corners, *_ = np.linalg.lstsq(bary, k.positions, rcond=None)
    off = np.abs(bary @ corners - k.positions).max() / np.ptp(corners, axis=0).max()
    if off > 1e-9:
        raise InputError(
            f"k has been moved by something else than an affine map ({off:.2g} of its size): take "
            "the field of the structure before, and map that (see ilattice.fields)"
        )
    return np.asarray(corners)


@cache
def pieces(dim: int) -> tuple[IntArray, IntArray, FloatArray]:
    """Polynomials of the box spline about 0 on the simplex t0 >= t1 >= ... of each unit cell.

    Parameters
    ----------
    dim : {2, 3}
        Dimension.

    Returns
    -------
    ndarray of int, shape (K, d)
        Offsets of the controls that reach into the simplex of cell 0.
    ndarray of int, shape (E, d + 1)
        Exponents of the Bernstein polynomials in barycentric coordinates.
    ndarray, shape (K, E)
        Bernstein coefficients: multiples of 1/24 or 1/120.
    """
    d = int(as_choice("dim", dim, (2, 3)))
    levels, degree, whole = (3, 4, 24.0) if d == 2 else (3, 5, 120.0)
    n = 2**levels
    fine = np.zeros((9,) * d)
    fine[(4,) * d] = 1.0
    for _ in range(levels):
        fine = subdivided(fine, outside=0.0)
    fine = _limits(fine)
    grid = np.array([p for p in product(range(n + 1), repeat=d) if sorted(p)[::-1] == list(p)])
    ends = np.column_stack([np.full(len(grid), n), grid, np.zeros(len(grid), np.int64)])
    bary = (ends[:, :-1] - ends[:, 1:]) / n
    powers = np.array([e for e in product(range(degree + 1), repeat=d + 1) if sum(e) == degree])
    basis = np.prod(bary[:, None] ** powers, axis=2) * _multinomials(powers)
    offsets, rows = [], []
    for at in product(range(-2, 4), repeat=d):
        places = grid - n * np.array(at) + 4 * n
        ok = ((places >= 0) & (places <= 8 * n)).all(axis=1)
        values = np.where(ok, fine[tuple(np.clip(places, 0, 8 * n).T)], 0.0)
        if np.abs(values).max() > 1e-12:
            offsets.append(at)
            rows.append(np.linalg.lstsq(basis, values, rcond=None)[0])
    table = np.rint(np.array(rows) * whole) / whole
    return np.array(offsets, np.int64), powers.astype(np.int64), table


def _multinomials(powers: IntArray) -> FloatArray:
    """Multinomial coefficients (E,) of rows of exponents."""
    return np.array(
        [math.factorial(sum(e)) / math.prod(map(math.factorial, e)) for e in powers.tolist()]
    )


def _limits(fine: FloatArray) -> FloatArray:
    """Values of a spline at the places of its controls."""
    d = fine.ndim
    at, taps = mask(d)
    at = at - np.sum(DIRECTIONS[d], axis=0)
    ids = list(product(range(-2, 3), repeat=d))
    tap = {tuple(a): t for a, t in zip(at.tolist(), taps.tolist(), strict=True)}
    step = np.array([[tap.get(tuple(2 * np.array(i) - j), 0.0) for j in ids] for i in ids])
    values, vectors = np.linalg.eig(step)
    own = np.real(vectors[:, int(np.argmin(np.abs(values - 1.0)))])
    out = np.zeros_like(fine)
    for i, w in zip(ids, own / own.sum(), strict=True):
        if abs(w) > 1e-14:
            out += w * np.roll(fine, i, axis=tuple(range(d)))
    return out


@dataclass(frozen=True, eq=False, repr=False)
class BoxSpline(Whole):
    """The negative of a box spline, so that the solid is where the spline is positive.

    Parameters
    ----------
    control : array_like of 2 or 3 axes
        Control values.
    origin : array_like, shape (3,)
        Place of the control 0.
    steps : array_like, shape (d, 3), optional
        From one control to the next, per axis; default unit vectors. Two of them make columns.
    periodic : bool
        Whether controls repeat along all axes.
    outside : float
        Control value beyond the array, where it does not repeat.

    Raises
    ------
    InputError
        For arrays of other shapes, or steps that are not independent.

    Notes
    -----
    C² (Section 3.8 of the paper), of degree 4 in the plane and 5 in space. Not a distance.
    """

    control: Any
    origin: Any = (0.0, 0.0, 0.0)
    steps: Any = None
    periodic: bool = False
    outside: float = -1.0

    def __post_init__(self) -> None:
        """Check the arguments."""
        c = as_array("control", self.control)
        d = c.ndim
        if d not in DIRECTIONS or not c.size:
            raise InputError(f"control must have 2 or 3 axes and values, got shape {c.shape}")
        steps = np.eye(3)[:d] if self.steps is None else as_array("steps", self.steps)
        if steps.shape != (d, 3):
            raise InputError(f"steps must have shape ({d}, 3), got {steps.shape}")
        scale = np.linalg.norm(steps, axis=1)
        if not scale.all() or np.linalg.svd(steps / scale[:, None])[1][-1] < 1e-9:
            raise InputError(f"steps must be independent, got {steps.tolist()!r:.120}")
        need(40.0 * c.size, f"a box spline of {c.size} controls", "use a smaller array")
        put = object.__setattr__
        put(self, "control", np.array(c))
        put(self, "origin", np.array(as_triple("origin", self.origin)))
        put(self, "steps", np.array(steps))
        put(self, "periodic", as_flag("periodic", self.periodic))
        put(self, "outside", as_real("outside", self.outside))
        super().__post_init__()

    def __repr__(self) -> str:
        shape = "x".join(map(str, self.control.shape))
        return f"BoxSpline({shape} controls{', periodic' if self.periodic else ''})"

    @property
    def repeats(self) -> tuple[bool, bool, bool]:
        """Whether it repeats on the unit cube, per axis."""
        whole = self.control.ndim == 3 and self.periodic
        fits = (
            np.allclose(self.steps, np.diag(1.0 / np.array(self.control.shape))) if whole else False
        )
        return (fits, fits, fits)

    @cached_property
    def _parts(self) -> tuple[Any, ...]:
        """Arguments of the kernels, from `turn` to `table`."""
        d = self.control.ndim
        turn = np.linalg.pinv(self.steps).T
        offsets, powers, table = pieces(d)
        low = 0.0 if self.periodic else self.outside
        return (
            np.column_stack([turn, -turn @ self.origin]),
            np.ascontiguousarray(self.control - low).ravel(),
            np.array(self.control.shape, np.int64),
            self.periodic,
            offsets,
            powers,
            table,
        )

    @property
    def _level(self) -> float:
        """The field where all controls within reach are 0."""
        return 0.0 if self.periodic else -self.outside

    @cached_property
    def lipschitz(self) -> float:
        """Largest slope: bounded by differences of controls, of which derivatives are means."""
        c, d = self.control, self.control.ndim
        if not self.periodic:
            c = np.pad(c, 1, constant_values=self.outside)
        most = [np.abs(c - np.roll(c, 1, axis=a)).max() for a in range(d)]
        return float(np.linalg.norm(most) * np.linalg.norm(self._parts[0][:, :3], 2))

    def _box(self, level: float = 0.0) -> FloatArray:
        if self.periodic or self.outside >= -level:
            return everywhere()
        at = np.argwhere(self.control >= -level)
        if not len(at):
            return nowhere()
        ends = np.stack([at.min(axis=0) - 2.0, at.max(axis=0) + 2.0])
        moves = ends[:, :, None] * self.steps
        out = self.origin + np.stack([moves.min(axis=0).sum(axis=0), moves.max(axis=0).sum(axis=0)])
        if len(self.steps) == 2:
            free = np.abs(np.cross(*self.steps)) > 1e-12 * np.abs(np.cross(*self.steps)).max()
            out = np.where(free, [[-np.inf], [np.inf]], out)
        return np.asarray(out)

    def values(self, points: FloatArray) -> FloatArray:
        """Values at checked points.

        Parameters
        ----------
        points : ndarray, shape (n, 3)
            Points.

        Returns
        -------
        ndarray, shape (n,)
            Values.
        """
        return self._jets(as_points("points", points), 0)[0]

    def __call__(self, p: ArrayLike, /) -> FloatArray:
        """Values, shape (n,), at points ``p`` (n, 3)."""
        return self.values(as_points("p", p))

    def jets(self, points: FloatArray, order: int) -> tuple[FloatArray, ...]:
        """Derivatives at checked points.

        Parameters
        ----------
        points : ndarray, shape (n, 3)
            Points.
        order : {1, 2}
            Highest derivative.

        Returns
        -------
        tuple of ndarray
            Values (n,), gradients (n, 3) and, for order 2, Hessians (n, 3, 3).
        """
        return self._jets(as_points("points", points), as_choice("order", order, (1, 2)))

    def _jets(self, points: FloatArray, order: int) -> tuple[FloatArray, ...]:
        n = len(points)
        f = np.empty(n)
        g, h = np.empty((n if order > 0 else 0, 3)), np.empty((n if order > 1 else 0, 3, 3))
        *parts, table = self._parts
        table = table * _multinomials(parts[-1])
        kernels.jets(n, np.array(points), *parts, table, order, f, g, h)
        out = (self._level - f, -g, -h)
        return out[: order + 1]

    def bounds_on(self, lo: FloatArray, hi: FloatArray, moved: bool) -> FloatArray:
        """Bounds on boxes.

        Parameters
        ----------
        lo, hi : ndarray, shape (n, 3)
            Corners.
        moved : bool
            Whether points are moved before, so that no steepness is known.

        Returns
        -------
        ndarray, shape (n, 3)
            Lower and upper bounds, and the largest slope.
        """
        a, b = as_points("lo", lo, finite=False), as_points("hi", hi, finite=False)
        out = np.full((len(a), 3), self.lipschitz if not as_flag("moved", moved) else np.inf)
        turn, c, *rest = self._parts
        ends = np.array(
            [
                c.min(initial=0.0 if not self.periodic else np.inf),
                c.max(initial=0.0 if not self.periodic else -np.inf),
            ]
        )
        found = np.empty((len(a), 2))
        orders = np.array(list(permutations(range(len(turn)))), np.int64)
        kernels.bounds(len(a), np.array(a), np.array(b), turn, c, *rest, orders, ends, found)
        out[:, 0], out[:, 1] = self._level - found[:, 1], self._level - found[:, 0]
        near = np.isfinite(a).all(axis=1) & np.isfinite(b).all(axis=1)
        reach = 0.5 * np.linalg.norm(b[near] - a[near], axis=1) * self.lipschitz
        middle = self.values(0.5 * (a[near] + b[near]))
        slack = 1e-13 * (np.abs(c).max() + abs(self._level))
        out[near, 0] = np.maximum(out[near, 0], middle - reach) - slack
        out[near, 1] = np.minimum(out[near, 1], middle + reach) + slack
        return out
