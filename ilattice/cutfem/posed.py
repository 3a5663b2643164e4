"""What is asked of a solid: where it is held, what acts on it, checked at the door.

Guarantees: nothing is changed in place: every verb returns a new problem, which shares all that it
does not change. Places that touch no surface are refused; those of which the area is not known well
come with a warning.
"""

import warnings
from dataclasses import dataclass, fields, replace
from itertools import count
from typing import Any, ClassVar, Self

import numpy as np

from ilattice._typing import FloatArray
from ilattice._validate import among, as_array, read_only
from ilattice.cutfem.conditions import Known, Load, Spring, Support, as_mask, as_value
from ilattice.cutfem.domain import Domain
from ilattice.cutfem.places import Spot
from ilattice.cutfem.probe import NEAR, off, parameters
from ilattice.cutfem.regions import ROUGH, Region, as_place, beside_plane
from ilattice.errors import GeometryError, InputError, PrecisionWarning
from ilattice.quadrature.rules import NAMES, Quadrature

#: Part of the area of a plane, held along its normal, that may be elsewhere without a word.
RIM = 1e-8


@dataclass(frozen=True, eq=False, init=False, repr=False)
class Posed:
    """A solid with supports and loads, and the verbs that add more.

    Attributes
    ----------
    domain : Domain
        The solid on its grid.
    islands : {"drop", "refuse"}
        What is done with parts that nothing holds.
    supports : tuple of Support
        Prescribed values.
    springs : tuple of Spring
        Stiffness per area.
    loads : tuple of Load
        What acts.
    """

    domain: Domain
    islands: str
    supports: tuple[Support, ...]
    springs: tuple[Spring, ...]
    loads: tuple[Load, ...]
    _held: dict[Any, Any]  # matrices and solvers, shared by problems with the same supports

    m: ClassVar[int]

    def __init__(self, domain: Domain, islands: str) -> None:
        self._set(
            domain=domain, islands=islands, supports=(), springs=(), loads=(), _held={}
        )  # fmt: skip

    def _set(self, **values: Any) -> None:
        for name, value in values.items():
            object.__setattr__(self, name, value)

    def _with(self, **changes: Any) -> Self:
        """A copy with some attributes changed, and nothing computed."""
        new = object.__new__(type(self))
        new._set(**{f.name: getattr(self, f.name) for f in fields(self)})
        new._set(**changes)
        return new

    def __repr__(self) -> str:
        counts = f"{len(self.supports) + len(self.springs)} supports, {len(self.loads)} loads"
        shape = "×".join(map(str, self.domain.cut.grid.shape))
        kind = f"degree {self.domain.degree}, smoothness {self.domain.smoothness}"
        return f"{type(self).__name__}({shape} cells, {kind}, {counts})"

    # ---------------------------------------------------------------- verbs

    def _supported(
        self, on: Any, components: Any, value: Any, method: str, name: str, where: Any = None
    ) -> Self:
        place = self._named(as_place(on, where))
        if not among(method, ("auto", "strong", "nitsche")):
            raise InputError(f"method must be 'auto', 'strong' or 'nitsche', got {method!r}")
        if method == "strong" and place not in NAMES:
            raise InputError(
                f"on={on!r}: only whole end faces are held exactly, others by method='nitsche'"
            )
        weak = method == "nitsche" or place not in NAMES
        self.domain.boundary(place)
        self._warn_rough(place)
        normal = False
        if isinstance(components, str) and components == "n":
            components = self._normal(place)
            normal = components is None
            if normal:
                self._warn_rim(place)
            if normal and method == "strong":
                raise InputError(
                    f"components='n': {place} is not flat and normal to x, y or z, and cannot be "
                    "held exactly; method='nitsche' does it weakly"
                )
            if normal and not callable(value) and np.ndim(value) == 0 and value != 0:
                raise InputError(
                    f"{name}={value!r:.40}: {place} is not normal to x, y or z; give a vector, of "
                    "which the part along the normal is prescribed"
                )
        value = as_value(name, value, self.m)
        new = Support(place, as_mask(components, self.m), value, weak or normal, normal)
        return self._with(supports=(*self.supports, new), _held={})

    def _sprung(self, on: Any, stiffness: Any, value: Any, name: str, where: Any = None) -> Self:
        k = as_value(name, stiffness, self.m)
        if not callable(k) and (np.min(k) < 0 or np.max(k) <= 0):
            raise InputError(f"{name} must not be negative, and not all zero, got {stiffness!r}")
        new = Spring(self._named(as_place(on, where)), k, as_value("value", value, self.m))
        self.domain.boundary(new.on)
        self._warn_rough(new.on)
        return self._with(springs=(*self.springs, new), _held={})

    def _loaded(
        self, kind: str, value: Any, m: int, on: Any = "", where: Any = None, at: Any = None
    ) -> Self:
        value = value if isinstance(value, Known) else as_value(kind, value, m)
        if at is not None:
            on = _spot(self.domain, at)
        elif not isinstance(on, str) or on:
            on = as_place(on, where)
            self.domain.boundary(on)
            if kind not in ("force", "moment"):
                self._warn_rough(on)
        return self._with(loads=(*self.loads, Load(kind, value, on)))

    def _named(self, place: str | Region) -> str | Region:
        """A region with a name that no other of this problem has, so that reactions are told."""
        if isinstance(place, str):
            return place
        asked = (*self.supports, *self.springs, *getattr(self, "connections", ()))
        known = {str(one.on) for one in asked}
        names = (place.name if k == 1 else f"{place.name} ({k})" for k in count(1))
        return replace(place, name=next(name for name in names if name not in known))

    def _warn_rough(self, place: str | Region) -> None:
        """Warn of a region of which the area is not known well."""
        if isinstance(place, str):
            return
        error = self.domain.area_error(place)
        if error > ROUGH:
            warnings.warn(
                f"on={place}: its area is off by about {100 * error:.2g} %, since its edge passes "
                "through cells, and so are tractions and supports; take finer cells, or an edge "
                "along them, or loads by force= and moment=, whose sums are exact",
                PrecisionWarning,
                stacklevel=4,
            )

    def _warn_rim(self, place: str | Region) -> None:
        """Warn of a plane, held along its normal, that comes with a part of other surfaces."""
        part = beside_plane(self.domain.boundary(place))
        if part > RIM:
            warnings.warn(
                f"components='n': {100 * part:.2g} % of the area of {place} is not in the plane of "
                "the rest, and is held along its own normals, which may stiffen the body by much "
                "more than that; name the place more narrowly",
                PrecisionWarning,
                stacklevel=4,
            )

    def _normal(self, place: str | Region) -> tuple[int] | None:
        """The axis that is normal to a flat place; none where there is no such axis."""
        normals = self.domain.boundary(place).normals
        assert normals is not None
        axis = int(np.argmax(np.abs(normals[0])))
        return None if np.abs(np.abs(normals[:, axis]) - 1.0).max() > 1e-9 else (axis,)

    @property
    def weakly_imposed(self) -> tuple[Spring | Support, ...]:
        """Springs and weak supports: what is added to the matrix."""
        return (*self.springs, *(s for s in self.supports if s.weak))

    def __getstate__(self) -> dict[str, Any]:
        """For `pickle` and `copy.deepcopy`, without what is made again when needed."""
        return {**{f.name: getattr(self, f.name) for f in fields(self)}, "_held": {}}


def _spot(domain: Domain, at: Any) -> Spot:
    """A point of the solid in space, off it by less than a tenth of a cell at most."""
    x = as_array("at", at)
    if x.shape != (3,):
        raise InputError(f"at must be a point, 3 numbers, got {at!r:.80}")
    u = parameters(domain.cut, x[None])
    if not np.isfinite(u).all() or off(domain.cut, u)[0] > NEAR:
        away, foot = _nearest(domain.boundary("boundary"), x)
        raise GeometryError(
            f"at={x.tolist()}: no solid there; the nearest surface is {away:.3g} away, at "
            f"{np.round(foot, 6).tolist()}"
        )
    return Spot(read_only(x.copy()), read_only(u[0]))


def _nearest(rule: Quadrature, x: FloatArray) -> tuple[float, FloatArray]:
    """Distance of a point from a surface, and its foot, to the distance of points of the rule."""
    assert rule.normals is not None
    gap = np.linalg.norm(rule.points - x, axis=1)
    k = int(np.argmin(gap))
    along = float((x - rule.points[k]) @ rule.normals[k])
    if gap[k] ** 2 - along**2 > rule.weights[k]:  # not beside what the point stands for
        return float(gap[k]), rule.points[k]
    return abs(along), x - along * rule.normals[k]
