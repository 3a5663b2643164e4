"""The input doors: every public function checks its arguments here, once.

Guarantee: what passes is finite (unless ``finite=False`` leaves that to the caller), of the
stated shape, C-contiguous float64.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any, TypeVar

import numpy as np

from ilattice import _forks  # noqa: F401  (every way to a kernel leads through here)
from ilattice._caching import stamp_all
from ilattice._compiling import watch
from ilattice._shown import Shown
from ilattice._typing import ArrayLike, FloatArray, IntArray
from ilattice.errors import IlatticeError, InputError

watch()
stamp_all()

K = TypeVar("K")
V = TypeVar("V")
T = TypeVar("T")
#: Largest number of tiles or cells in one direction.
LARGEST_COUNT = 10_000_000
#: Lengths whose cubes, and products of these, are far from the ends of double precision.
SHORTEST, LONGEST = 1e-50, 1e50


def as_array(
    name: str, value: Any, ndim: int | None = None, *, finite: bool = True, flags: bool = True
) -> FloatArray:
    """Writable float64 array, finite unless told otherwise, or `InputError` with the argument.

    Arrays of True and False are taken if `flags` are.
    """
    try:
        raw = np.asarray(value)
        # NumPy reads None as NaN and text as numbers, and drops masks and imaginary parts
        flag = raw.dtype.kind == "b" and (raw.ndim == 0 or not flags)
        if value is None or flag or raw.dtype.kind not in "biufO" or np.ma.is_masked(value):
            raise TypeError(value)
        a = np.ascontiguousarray(raw, dtype=np.float64)
        if not a.flags.writeable:  # of another type to kernels, which would be compiled again
            a = a.copy()
    except (TypeError, ValueError, OverflowError, AttributeError) as e:
        masked = " without masks" if np.ma.is_masked(value) else ""
        raise InputError(
            f"{name} must be an array of real numbers{masked}, got {value!r:.80}"
        ) from e
    if ndim is not None and np.ndim(value) != ndim:
        raise InputError(f"{name} must have {ndim} axes, got shape {np.shape(value)}")
    return check_finite(name, a) if finite else a


def as_own(name: str, value: Any) -> FloatArray:
    """`as_array` as an array of one's own, copied no more than once."""
    a = as_array(name, value)
    fresh = type(value) in (list, tuple) or not np.may_share_memory(a, np.asarray(value))
    return a if fresh else a.copy()


def check_finite(name: str, a: FloatArray) -> FloatArray:
    """`a` itself, or `InputError` with the first index that is NaN or infinite."""
    if a.size and np.isfinite(a.min()) and np.isfinite(a.max()):  # no room as large as `a`
        return a
    finite = np.isfinite(a)
    if not finite.all():
        bad = tuple(int(i) for i in np.argwhere(~finite)[0])
        raise InputError(
            f"{name} must be finite: {a.size - int(finite.sum())} of {a.size} values are not, "
            f"the first is {a[bad]} at index {bad}"
        )
    return a


def as_points(name: str, value: ArrayLike, dim: int = 3, *, finite: bool = True) -> FloatArray:
    """Points as rows, shape (n, dim)."""
    a = as_array(name, value, finite=finite, flags=False)
    if a.ndim != 2 or a.shape[1] != dim:
        raise InputError(f"{name} must be points as rows, shape (n, {dim}), got {np.shape(value)}")
    return a


def as_triple(name: str, value: Any, *, positive: bool = False) -> FloatArray:
    """Three finite numbers; a single number is repeated."""
    a = as_array(name, _no_flags(name, value))
    if a.shape not in ((), (1,), (3,)) or np.size(value) not in (1, 3):
        raise InputError(f"{name} must be one number or three, got {value!r:.80}")
    a = np.array(np.broadcast_to(a, (3,)))
    if positive and (a <= 0).any():
        raise InputError(f"{name} must be positive, got {value!r:.80}")
    return a


def as_counts(name: str, value: Any) -> tuple[int, int, int]:
    """Three integers of at least 1; a single one is repeated."""
    a = as_triple(name, value)
    if (a != np.rint(a)).any() or (a < 1).any() or (a > LARGEST_COUNT).any():
        raise InputError(
            f"{name} must be whole numbers from 1 to {LARGEST_COUNT}, got {value!r:.80}"
        )
    i, j, k = (int(v) for v in a)
    return i, j, k


def as_positive(name: str, value: Any) -> float:
    """One finite number above zero."""
    return _as_one(name, value, "one number above zero", lambda x: x > 0, finite=True)


def as_not_negative(name: str, value: Any, *, finite: bool = True) -> float:
    """One number of at least zero, finite unless told otherwise."""
    return _as_one(name, value, "one number, zero or more", lambda x: x >= 0, finite=finite)


def as_real(name: str, value: Any, *, finite: bool = True) -> float:
    """One number, finite unless told otherwise, never NaN."""
    return _as_one(name, value, "one number", lambda x: x == x, finite=finite)


def _as_one(
    name: str, value: Any, what: str, fits: Callable[[float], bool], *, finite: bool
) -> float:
    try:
        a = as_array(name, _no_flags(name, value), finite=False).ravel()
    except InputError as e:
        raise InputError(f"{name} must be {what}, got {value!r:.80}") from e
    if finite and len(a) == 1:
        check_finite(name, a)
    if len(a) != 1 or not fits(float(a[0])):
        raise InputError(f"{name} must be {what}, got {value!r:.80}")
    return float(a[0])


def _no_flags(name: str, value: Any) -> Any:
    """`value` itself; True and False are no numbers, alone or in a short list."""
    few = value if isinstance(value, (list, tuple)) and len(value) < 4 else (value,)
    for v in few:
        odd = isinstance(v, (bool, np.bool_, np.datetime64, np.timedelta64)) or v is np.ma.masked
        if odd or (isinstance(v, np.ndarray) and v.dtype.kind == "b"):
            raise InputError(f"{name} must be a number, got {value!r:.80}")
    return value


def as_kind(name: str, value: Any, kind: str) -> Any:
    """`value` itself if it is of a class of this name, or `InputError`."""
    if all(c.__name__ != kind for c in type(value).__mro__):
        raise InputError(f"{name} must be a {kind}, got {type(value).__name__}: {value!r:.60}")
    return value


def as_choice(name: str, value: Any, choices: Sequence[Any]) -> Any:
    """`value` itself if it is one of some words or whole numbers, and of their type."""
    if not among(value, choices):
        told = ", ".join(map(repr, choices))
        raise InputError(f"{name} must be one of {told}, got {value!r:.80}")
    return value


def among(value: Any, choices: Sequence[Any]) -> bool:
    """Whether a value is one of some words or whole numbers, and of their type: True is no 1.

    Words and numbers of arrays count as such.
    """
    array = isinstance(value, (np.integer, np.str_))
    return (array or any(type(value) is type(c) for c in choices)) and value in choices


def as_axis(name: str, value: Any, count: int = 3) -> int:
    """A direction: a whole number from 0 on, below the number of directions."""
    if not among(value, range(count)):
        raise InputError(f"{name} must be a whole number from 0 to {count - 1}, got {value!r:.80}")
    return int(value)


def as_whole(name: str, value: Any, least: int, most: int) -> int:
    """A whole number between two others."""
    known = isinstance(value, (int, np.integer)) and not isinstance(value, bool)
    if not known or not least <= value <= most:
        told = f"a whole number from {least} to {most}"
        raise InputError(f"{name} must be {told}, got {value!r:.80}")
    return int(value)


def as_flag(name: str, value: Any) -> bool:
    """True or False, or 1 or 0."""
    known = isinstance(value, (bool, np.bool_)) or (
        isinstance(value, (int, np.integer)) and value in (0, 1)
    )
    if not known:
        raise InputError(f"{name} must be True or False, got {value!r:.80}")
    return bool(value)


def as_numbers(name: str, value: Any, count: int) -> IntArray:
    """Numbers of things from 0 on, below their count, shape (n,)."""
    whole = isinstance(value, np.ndarray) and value.dtype.kind in "iu" and value.ndim == 1
    a = value
    if not whole:
        numbers = as_array(name, value, ndim=1)
        if (numbers != np.rint(numbers)).any():
            raise InputError(f"{name} must be whole numbers, got {value!r:.80}")
        a = np.clip(numbers, -1, count).astype(np.int64)
    if len(a) and (a.min() < 0 or a.max() >= count):
        raise InputError(f"{name} must be whole numbers from 0 to {count - 1}, got {value!r:.80}")
    found: IntArray = a
    return found


def as_rows(name: str, value: Any, count: int) -> IntArray:
    """Numbers of rows, below their count, from numbers or from a mask."""
    if not isinstance(value, np.ndarray) or value.dtype != np.bool_:
        found = as_numbers(name, value, count)
        if len(found) == count > 2 and found.max() <= 1:
            raise InputError(
                f"{name} has {count} numbers, each 0 or 1: a mask must be an array of bool"
            )
        return found
    if value.shape != (count,):
        raise InputError(f"{name} must be a mask of shape ({count},), got {value.shape}")
    return np.flatnonzero(value)


def as_index(name: str, value: Any) -> int:
    """A whole number for the index of a sequence; too large ones are for Python to refuse."""
    if isinstance(value, (bool, np.bool_)) or not isinstance(value, (int, np.integer)):
        raise InputError(f"{name} must be a whole number or a slice, got {value!r:.80}")
    return int(value)


def as_texts(name: str, value: Any) -> dict[str, str]:
    """Texts by their names, or `InputError`."""
    known = isinstance(value, Mapping)
    if not known or not all(isinstance(v, str) for item in value.items() for v in item):
        raise InputError(f"{name} must be a mapping of names to texts, got {value!r:.80}")
    return dict(value)


def as_items(name: str, value: Any) -> list[Any]:
    """The items of a list, a tuple or an array."""
    listed = isinstance(value, Sequence) and not isinstance(value, (str, bytes))
    if not listed and not (isinstance(value, np.ndarray) and value.ndim):
        raise InputError(f"{name} must be a list, got {value!r:.80}")
    return list(value)


def per_direction(name: str, value: Any, count: int) -> list[Any]:
    """One value per direction; a single value is repeated."""
    several = isinstance(value, (list, tuple)) or (isinstance(value, np.ndarray) and value.ndim)
    values = list(value) if several else [value] * count
    if len(values) != count:
        raise InputError(f"{name} must be one value or {count}, got {value!r:.80}")
    return values


def as_float_type(name: str, value: Any) -> Any:
    """`numpy.float64` or `numpy.float32`, from whatever NumPy takes for one of them."""
    try:
        kind = np.dtype(value)
    except (TypeError, ValueError) as e:
        raise InputError(f"{name} must be float64 or float32, got {value!r:.80}") from e
    if kind not in (np.dtype(np.float64), np.dtype(np.float32)):
        raise InputError(f"{name} must be float64 or float32, got {kind}")
    return kind.type


def as_knots(name: str, value: ArrayLike, n: int, k: int) -> FloatArray:
    """Knot vector of length n + k + 1, non-decreasing, with t[k] < t[n]."""
    t = as_array(name, value, ndim=1)
    if len(t) != n + k + 1:
        raise InputError(
            f"{name} must hold n + k + 1 = {n} + {k} + 1 = {n + k + 1} knots, got {len(t)}"
        )
    step = np.diff(t)
    if (step < 0).any():
        i = int(np.argmax(step < 0))
        raise InputError(
            f"{name} must not decrease: knot {i + 1} is {t[i + 1]} after {t[i]}; sort the knots"
        )
    if not t[k] < t[n]:
        raise InputError(f"{name} spans no domain: t[k] = {t[k]} is not below t[n] = {t[n]}")
    return t


def asked(name: str, f: Callable[..., Any], *arguments: Any) -> Any:
    """What a function of the user returns; what it raises says which argument it was."""
    if str(getattr(f, "__module__", "")).startswith("ilattice."):
        return f(*arguments)  # which says by itself what is wrong
    try:
        return f(*arguments)
    except IlatticeError as e:
        kind = next(c for c in type(e).__mro__ if c.__module__ == "ilattice.errors")
        raise kind(f"{name}: {e}") from e
    except Exception as e:
        raise InputError(f"{name} raised {type(e).__name__}: {e}") from e


def near_names(name: str, known: Sequence[str], count: int = 3) -> str:
    """The known names most like `name`, for error messages."""
    from difflib import get_close_matches

    close = get_close_matches(name.lower(), known, n=count, cutoff=0.4)
    return ", ".join(close) if close else ", ".join(list(known)[:count])


def read_only(a: Any) -> Any:
    """`a` with its write flag cleared."""
    a.flags.writeable = False
    return a


def seen(a: Any) -> Any:
    """A read-only view; `a` itself stays of the type that compiled code knows."""
    return read_only(a.view())


class FixedMapping(Mapping[K, V]):
    """A mapping that nobody can change, also after `pickle` and `copy.deepcopy`."""

    __slots__ = ("_items",)
    _items: dict[K, V]

    def __init__(self, items: Mapping[K, V] | None = None) -> None:
        object.__setattr__(self, "_items", dict(items or {}))

    def __getitem__(self, key: K) -> V:
        return self._items[key]

    def __iter__(self) -> Iterator[K]:
        return iter(self._items)

    def __len__(self) -> int:
        return len(self._items)

    def __repr__(self) -> str:
        return repr(self._items)

    def __setattr__(self, name: str, value: Any) -> None:
        raise AttributeError(f"{name!r} cannot be set: mappings of results are immutable")

    def __reduce__(self) -> tuple[Any, ...]:
        """For `pickle` and `copy`; arrays are read-only again."""
        return _fixed, (self._items,)


def _fixed(items: dict[Any, Any]) -> "FixedMapping[Any, Any]":
    """Mapping of a pickle, which forgets that arrays are read-only."""
    for value in items.values():
        _freeze(value)
    return FixedMapping(items)


class FrozenCopies(Shown):
    """Objects of which copies, by `pickle` or `copy.deepcopy`, have read-only public arrays."""

    def __setstate__(self, state: dict[str, Any]) -> None:
        """Restore from a pickle, which forgets that arrays are read-only."""
        self.__dict__.update(state)
        freeze(self)


class Frozen(FrozenCopies):
    """Objects whose public arrays are read-only, also through `pickle` and `copy.deepcopy`."""

    def __post_init__(self) -> None:
        """Clear the write flags of public arrays of a dataclass."""
        freeze(self)


def freeze(thing: T) -> T:
    """`thing` itself, its public arrays read-only."""
    for name, value in vars(thing).items():
        if not name.startswith("_"):
            _freeze(value)
    return thing


def _freeze(value: Any) -> None:
    """Clear the write flags of arrays, also in sequences."""
    if isinstance(value, np.ndarray):
        read_only(value)
    elif isinstance(value, (list, tuple)):
        for item in value:
            _freeze(item)


def check_lengths(name: str, size: float, far: float) -> None:
    """Refuse solids whose volume would overflow, or vanish by its units alone.

    Parameters
    ----------
    name : str
        What messages call the solid.
    size, far : float
        Its size, and its largest distance from the origin.

    Raises
    ------
    InputError
        If they are beyond `SHORTEST` to `LONGEST`.
    """
    if far > LONGEST or 0.0 < size < SHORTEST:
        raise InputError(
            f"{name} has a size of {size:.3g}, up to {far:.3g} away from the origin: volumes "
            f"cannot be computed beyond {SHORTEST:g} to {LONGEST:g}; use other units of length"
        )
