"""The patch: one spline of a file, and what all spline formats do with it.

Guarantees: a patch that was read is finite, its weights are positive, its knots do not decrease
and bound a domain; every violation is a `FormatError`. Nearly equal knots (1e-9 of the domain),
as printing leaves them, are made equal.
Not guaranteed: that the patch is a usable map; folds are found by `ilattice.macroshape`.
"""

import itertools
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, NoReturn

import numpy as np

from ilattice._typing import FloatArray
from ilattice.bspline import BSpline
from ilattice.errors import InputError

#: Raises `FormatError` with the place of the trouble in front of the message.
Fail = Callable[[str], NoReturn]

KINDS = ("curve", "surface", "volume")
#: Knots that are nearer than this part of the domain are equal.
SNAP = 1e-9
#: Numbers up to this size have products of three that do not overflow.
LARGEST = 1e100
MAX_DEGREE = 8
MANY = 20_000  # splines that a file may hold, however short they are; of more
PER_PATCH = 120  # letters, each
_NAME = re.compile(r"[\w .:/+-]+")


@dataclass(frozen=True)
class Patch:
    """One spline of a file.

    Parameters
    ----------
    spline : BSpline
        The spline; Cartesian coefficients, weights apart.
    index : int or None
        Number among the volumes of the file, from 0 in the order of the file; ``None`` for a
        curve or a surface.
    name : str
        Name in the file, "" if it has none. Names need not be unique.
    names : tuple of str
        Names of the components after x, y, z, empty if the file does not tell.
    info : mapping
        What else the file says: id, attributes, line.
    """

    spline: BSpline
    index: int | None = None
    name: str = ""
    names: tuple[str, ...] = ()
    info: Mapping[str, Any] = field(default_factory=dict)

    @property
    def kind(self) -> str:
        """One of "curve", "surface", "volume"."""
        return KINDS[self.spline.ndim - 1]

    def __str__(self) -> str:
        label = self.kind if self.index is None else f"{self.kind} {self.index}"
        if self.name:
            label += f" {self.name!r}"
        if "id" in self.info:
            label += f" (id {self.info['id']})"
        size = " x ".join(str(n) for n in self.spline.shape)
        text = f"{label}: {size} control points of degree {self.spline.k}"
        text += f", {self.spline.m or 1} coordinates"
        text += ", rational" if self.spline.weights is not None else ""
        return text + (", periodic" if any(self.spline.periodic) else "")


def numbered(patches: Sequence[Patch]) -> list[Patch]:
    """Copies of the patches, the volumes numbered from 0."""
    numbers = itertools.count()
    return [replace(p, index=next(numbers) if p.spline.ndim == 3 else None) for p in patches]


# --- from flat numbers to a spline --------------------------------------------------------------


def to_spline(
    fail: Fail,
    knots: Sequence[FloatArray],
    rows: FloatArray,
    degrees: Sequence[int],
    *,
    weights: FloatArray | None = None,
    periodic: Sequence[bool] | None = None,
) -> BSpline:
    """Spline of flat control points, first direction fastest.

    Parameters
    ----------
    fail : callable
        Raises the `FormatError`.
    knots : sequence of ndarray
        Full knot vectors; those of periodic directions count the wrapped copies too.
    rows : ndarray, shape (n, m)
        Cartesian control points, wrapped copies not included.
    degrees : sequence of int
        Degrees.
    weights : ndarray, shape (n,), optional
        Weights.
    periodic : sequence of bool, optional
        Periodic directions.

    Returns
    -------
    BSpline
        The spline.
    """
    periodic = periodic or (False,) * len(knots)
    sizes = [
        len(t) - k - 1 - (k if p else 0) for t, k, p in zip(knots, degrees, periodic, strict=True)
    ]
    check_size(fail, rows, "coordinates")
    grid = rows.reshape(*sizes[::-1], rows.shape[1])
    c = np.transpose(grid, (*_reverse(sizes), len(sizes)))
    w = None
    if weights is not None:
        check_weights(fail, weights)
        w = weights.reshape(sizes[::-1]).T
    for axis, (n, k, p) in enumerate(zip(sizes, degrees, periodic, strict=True)):
        if p:
            around = np.arange(n + k) % n
            c = np.take(c, around, axis)
            w = None if w is None else np.take(w, around, axis)
    snapped = [snap_knots(fail, t, k) for t, k in zip(knots, degrees, strict=True)]
    return checked(fail, snapped, c, degrees, periodic, w)


def checked(
    fail: Fail,
    knots: Sequence[FloatArray],
    c: FloatArray,
    degrees: Sequence[int],
    periodic: Sequence[bool],
    weights: FloatArray | None,
) -> BSpline:
    """`BSpline` with its `InputError` turned into the `FormatError` of the file."""
    try:
        return BSpline(knots, c, degrees, periodic=periodic, weights=weights)
    except InputError as e:
        fail(str(e))


def check_size(fail: Fail, values: FloatArray, what: str) -> None:
    """Refuse numbers so large that products of three of them overflow."""
    if not (values.max(initial=0.0) <= LARGEST and values.min(initial=0.0) >= -LARGEST):
        fail(f"{what} must be finite and not above {LARGEST:g} in size")


def check_count(fail: Fail, count: int, size: int, per_patch: int = PER_PATCH) -> None:
    """Refuse to read on where splines take far more memory than the file is long."""
    if count >= MANY + size // per_patch:
        fail(f"the file holds more than {count} splines in {size} letters; not read")


def check_weights(fail: Fail, weights: FloatArray) -> None:
    """Refuse weights that are not positive, or out of all proportion."""
    if not (weights > 0).all():
        fail(f"weights must be positive, the least is {weights.min():g}")
    if weights.max() > LARGEST or weights.min() < 1 / LARGEST:
        fail(f"weights must lie between {1 / LARGEST:g} and {LARGEST:g}")


def check_spans(fail: Fail, t: FloatArray) -> None:
    """Refuse knots so close that the reciprocal of a span overflows."""
    steps = np.diff(t)
    if (steps[steps > 0] < 1 / LARGEST).any():
        fail(f"knots must be equal or at least {1 / LARGEST:g} apart")


def snap_knots(fail: Fail, t: FloatArray, k: int) -> FloatArray:
    """Knots with runs of nearly equal values made equal; refuses what is no knot vector."""
    if k > MAX_DEGREE:
        fail(f"degree {k} is above {MAX_DEGREE}, the largest that is supported")
    n = len(t) - k - 1
    if n < k + 1:
        fail(f"{len(t)} knots are too few for degree {k}; expected at least {2 * k + 2}")
    check_size(fail, t, "knots")
    tol = SNAP * (t.max() - t.min())
    out = t.copy()
    for i in range(1, len(out)):
        if abs(out[i] - out[i - 1]) <= tol:
            out[i] = out[i - 1]
        elif out[i] < out[i - 1]:
            fail(f"knots must not decrease: knot {i + 1} is {t[i]:g} after {t[i - 1]:g}")
    check_spans(fail, out)
    if not out[k] < out[n]:
        fail(f"knots must bound a domain; degree {k} gives [{t[k]:g}, {t[n]:g}]")
    same = np.unique(out, return_counts=True)[1].max()
    if same > k + 1:
        fail(f"a knot is repeated {same} times; degree {k} allows {k + 1}")
    return out


def _reverse(items: Sequence[Any]) -> tuple[int, ...]:
    return tuple(range(len(items)))[::-1]


# --- from a spline to flat numbers ---------------------------------------------------------------


def to_rows(spline: BSpline, *, unwrapped: bool = False) -> tuple[FloatArray, FloatArray | None]:
    """Control points (n, m) and weights (n,), first direction fastest.

    With `unwrapped` the wrapped copies of periodic directions are left out.
    """
    c = spline.c if spline.m else spline.c[..., None]
    w = spline.weights
    if unwrapped:
        for axis, (n, k, p) in enumerate(zip(spline.shape, spline.k, spline.periodic, strict=True)):
            if p:
                c = np.take(c, range(n - k), axis)
                w = None if w is None else np.take(w, range(n - k), axis)
    order = _reverse(c.shape[:-1])
    rows = np.transpose(c, (*order, c.ndim - 1)).reshape(-1, c.shape[-1])
    return rows, None if w is None else np.transpose(w, order).ravel()


def to_text(rows: FloatArray, before: str = "", after: str = "") -> str:
    """Rows of numbers, as many digits as needed to read the same numbers back."""
    return "\n".join(before + " ".join(map(repr, row)) + after for row in rows.tolist())


def clamped(spline: BSpline, *, only_periodic: bool = False) -> BSpline:
    """Rewrite with end knots of full multiplicity: same function, same domain.

    For formats that know no periodic or no unclamped knots. Exact up to rounding.
    """
    axes = [
        axis
        for axis, (t, k, p) in enumerate(zip(spline.t, spline.k, spline.periodic, strict=True))
        if p or not (only_periodic or (t[0] == t[k] and t[-1] == t[-1 - k]))
    ]
    if not axes:
        return spline
    knots, c, w = list(spline.t), spline.c, spline.weights
    if w is not None:
        c = c * (w[..., None] if spline.m else w)
    for axis in axes:
        t, k = knots[axis], spline.k[axis]
        knots[axis], c = _clamp_axis(t, c, k, axis)
        w = None if w is None else _clamp_axis(t, w, k, axis)[1]
    if w is not None:
        c = c / (w[..., None] if spline.m else w)
    return BSpline(knots, c, spline.k, weights=w)


def _clamp_axis(t: FloatArray, c: FloatArray, k: int, axis: int) -> tuple[FloatArray, FloatArray]:
    c = np.moveaxis(c, axis, 0)
    t, c = _clamp_left(t, c, k)
    t, c = _clamp_left(-t[::-1], c[::-1], k)
    return -t[::-1], np.moveaxis(c[::-1], 0, axis)


def _clamp_left(t: FloatArray, c: FloatArray, k: int) -> tuple[FloatArray, FloatArray]:
    """Knot insertion (Boehm 1980) at the left end of the domain, and what lies outside cut off."""
    x = t[k]
    while (same := int((t == x).sum())) < k:
        last = int(np.searchsorted(t, x, side="right")) - 1
        i = np.arange(last - k + 1, last - same + 1)
        a = ((x - t[i]) / (t[i + k] - t[i])).reshape(-1, *[1] * (c.ndim - 1))
        new = a * c[i] + (1 - a) * c[i - 1]
        c = np.concatenate([c[: last - k + 1], new, c[last - same :]])
        t = np.insert(t, last + 1, x)
    last = int(np.searchsorted(t, x, side="right")) - 1
    return np.concatenate([np.full(k + 1, x), t[last + 1 :]]), c[last - k :]


# --- names of the extra coordinates --------------------------------------------------------------


def join_names(names: Sequence[str]) -> str:
    """Put the names into one field, for formats that keep them in an attribute or a comment."""
    for name in names:
        if not _NAME.fullmatch(name):
            raise InputError(
                f"names: {name!r:.40} cannot be stored in this format; "
                "use letters, digits and blanks, or save as .npz or .json"
            )
    return ",".join(names)


def split_names(fail: Fail, text: str, components: int) -> tuple[str, ...]:
    """Read back what `join_names` wrote; one name per component after the third."""
    names = tuple(n.strip() for n in text.split(","))
    if len(names) != max(components - 3, 0):
        fail(f"{len(names)} names of extra coordinates; expected {max(components - 3, 0)}")
    return names
