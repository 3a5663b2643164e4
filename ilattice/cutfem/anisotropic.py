"""Elastic material of any symmetry: a stiffness of 21 constants, constant or varying.

::

    C = il.cutfem.orthotropic(young=(3.0, 2.0, 1.0), poisson=(0.3, 0.2, 0.4), shear=(1.0, 0.8, 0.6))
    il.cutfem.Elasticity(solid, 16, stiffness=C)  # along x, y, z
    il.cutfem.Elasticity(solid, 16, through=torus, stiffness=C, axes="map")  # turned with the map
    graded = il.cutfem.Graded("rho", [0.1, 0.2, 0.4], [C1, C2, C3])  # by a coordinate of the map
    il.cutfem.Elasticity(solid, 16, through=torus, stiffness=graded, axes="map")

Matrices are 6×6 in Voigt order xx, yy, zz, yz, xz, xy with engineering shear. Axes that follow a
map are those of its rotation, the orthogonal matrix nearest to its Jacobian (polar decomposition).

Guarantees: every matrix is checked to be symmetric and positive definite where it is used, at the
points of quadrature too. Non-guarantees: what the map stretches changes the axes only, not the
matrix; volume is not kept by projection: what hardly changes its volume locks, with a warning.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar, Self

import numpy as np
from scipy.interpolate import PchipInterpolator

from ilattice._typing import ArrayLike, FloatArray
from ilattice._validate import Frozen, among, as_array, asked, check_finite, read_only
from ilattice.cutfem._voigt import MANDEL, rotated
from ilattice.cutfem.assembly import Assembly, constant_jacobian
from ilattice.cutfem.material import Elastic, Isotropic, PerPhase, Property, Scalar
from ilattice.errors import InputError
from ilattice.macroshape.maps import SplineMap

AXES = ("space", "map")
#: Part of its largest entry by which a stiffness may fail to be symmetric, and part of its largest
#: eigenvalue that the least must have.
ODD, MIN_EIGENVALUE = 1e-9, 1e-12


@dataclass(frozen=True, eq=False)
class Graded(Frozen):
    """A stiffness that depends on one property: interpolated, entry by entry.

    Attributes
    ----------
    by : float, str or callable
        The property, such as the relative density: a function of points of space (n, 3), or the
        name of an extra coordinate of the map or of a property of the lattice.
    at : array_like, shape (m,)
        Increasing values of it.
    C : array_like, shape (m, 6, 6)
        Stiffnesses there, such as `Effective.C`.

    Raises
    ------
    InputError
        If values do not increase, or a matrix is no stiffness.

    Notes
    -----
    Cubic Hermite splines that keep monotony (Fritsch and Butland, 1984).

    Examples
    --------
    >>> import numpy as np
    >>> import ilattice as il
    >>> C = il.cutfem.orthotropic(young=1.0, poisson=0.3)
    >>> graded = il.cutfem.Graded(lambda x: x[:, 2], [0.0, 1.0], [C, 2 * C])
    >>> bool(np.allclose(graded.between(np.array([0.5])), 1.5 * C))
    True
    """

    by: Property
    at: ArrayLike
    C: ArrayLike

    def __post_init__(self) -> None:
        at = as_array("at", self.at)
        if at.ndim != 1 or len(at) < 2 or not (np.diff(at) > 0).all():
            raise InputError(f"at must be two increasing values or more, got {self.at!r:.80}")
        C = as_matrices("C", self.C)
        if C.shape != (len(at), 6, 6):
            raise InputError(
                f"C must be one matrix per value of at, shape ({len(at)}, 6, 6), got {C.shape}"
            )
        object.__setattr__(self, "at", at)
        object.__setattr__(self, "C", C)
        super().__post_init__()

    def between(self, values: ArrayLike) -> FloatArray:
        """Stiffness at values of the property.

        Parameters
        ----------
        values : array_like, shape (n,)
            From the first to the last of `at`.

        Returns
        -------
        ndarray, shape (n, 6, 6)
            Interpolated.

        Raises
        ------
        InputError
            If a value is beyond.
        """
        t, at = as_array("values", values), np.asarray(self.at)
        lo, hi = at[0], at[-1]
        slack = 1e-9 * (hi - lo)
        out = (t < lo - slack) | (t > hi + slack)
        if out.any():
            raise InputError(
                f"stiffness is given from {lo:g} to {hi:g}, but its property is {t[out][0]:g}; "
                "give matrices for that, too"
            )
        return np.asarray(PchipInterpolator(at, np.asarray(self.C))(np.clip(t, lo, hi)))


def as_matrices(name: str, value: Any) -> FloatArray:
    """Symmetric positive definite matrices (..., 6, 6), or `InputError`."""
    C = as_array(name, value)
    if C.shape[-2:] != (6, 6):
        raise InputError(f"{name} must be a matrix, shape (6, 6), got shape {C.shape}")
    wrong = refused(C)
    if wrong is not None:
        raise InputError(f"{name} {wrong[1]}")
    return 0.5 * (C + np.swapaxes(C, -1, -2))


def refused(C: FloatArray) -> tuple[int, str] | None:
    """The first matrix of (..., 6, 6) that is no stiffness, and why; None if all are."""
    flat = C.reshape(-1, 6, 6)
    top = np.abs(flat).max(axis=(1, 2))
    odd = np.abs(flat - flat.transpose(0, 2, 1)).max(axis=(1, 2)) > ODD * top
    if odd.any():
        i = int(odd.argmax())
        return i, f"must be symmetric, entries differ by {_odd(flat[i]):.3g} of the largest"
    values = np.linalg.eigvalsh(flat * np.outer(MANDEL, MANDEL))
    bad = ~(values[:, 0] > MIN_EIGENVALUE * np.maximum(values[:, -1], 0.0))
    if bad.any():
        i = int(bad.argmax())
        return i, (
            "must be positive definite: its eigenvalues in Mandel's notation are from "
            f"{values[i, 0]:.4g} to {values[i, -1]:.4g}"
        )
    return None


def _odd(C: FloatArray) -> float:
    return float(np.abs(C - C.T).max() / np.abs(C).max())


def orthotropic(*, young: Any, poisson: Any, shear: Any = None) -> FloatArray:
    """Stiffness of an orthotropic material with axes x, y, z.

    Parameters
    ----------
    young : float or sequence of 3 floats
        Young's moduli along x, y, z.
    poisson : float or sequence of 3 floats
        Poisson's ratios xy, xz, yz: contraction along the second under tension along the first.
    shear : float or sequence of 3 floats, optional
        Shear moduli yz, xz, xy; by default, of one Young's modulus and Poisson's ratio, isotropic.

    Returns
    -------
    ndarray, shape (6, 6)
        Read-only.

    Raises
    ------
    InputError
        If the moduli are not those of a material that takes energy to deform.

    Examples
    --------
    >>> import ilattice as il
    >>> il.cutfem.orthotropic(young=1.0, poisson=0.25)[0].round(6)
    array([1.2, 0.4, 0.4, 0. , 0. , 0. ])
    """
    E, nu = _three("young", young), _three("poisson", poisson, sign=True)
    if shear is None:
        if np.ptp(E) or np.ptp(nu):
            raise InputError("shear must be given where young or poisson are three different ones")
        shear = E / (2.0 * (1.0 + nu)) if nu[0] > -1.0 else np.nan
    S = np.zeros((6, 6))
    S[range(3), range(3)] = 1.0 / E
    for (i, j), ratio in zip(((0, 1), (0, 2), (1, 2)), nu, strict=True):
        S[i, j] = S[j, i] = -ratio / E[i]
    S[range(3, 6), range(3, 6)] = 1.0 / _three("shear", shear)
    wrong = refused(S)
    if wrong is not None:
        raise InputError(
            f"poisson={poisson!r:.60} is not that of a solid with young={young!r:.60}: the "
            "compliance must be positive definite"
        )
    return read_only(as_matrices("young, poisson and shear: the stiffness", np.linalg.inv(S)))


def _three(name: str, value: Any, *, sign: bool = False) -> FloatArray:
    """Three numbers, positive unless they may have any sign."""
    a = as_array(name, value)
    if a.size not in (1, 3) or a.ndim > 1 or not (sign or (a > 0).all()):
        what = "numbers" if sign else "positive numbers"
        raise InputError(f"{name} must be one or three {what}, got {value!r:.80}")
    return np.array(np.broadcast_to(a.ravel(), 3))


@dataclass(frozen=True, eq=False)
class Tensor(PerPhase):
    """A stiffness or conductivity as it was given.

    Attributes
    ----------
    value : float, str, ndarray, Graded, callable, or pair of these
        The tensor, or one of each phase.
    axes : {"space", "map"}
        Which axes matrices have.
    lattice : object or None
        Where named properties come from.
    phased : bool
        Whether there are two phases, see `Scalar`.
    """

    value: Any
    axes: str = "space"
    lattice: Any = None
    phased: bool = False

    @classmethod
    def of(
        cls, value: Any, axes: str, through: SplineMap | None, lattice: Any, phased: bool
    ) -> Self:
        """What a user gave, checked, with axes of space wherever the map turns all alike."""
        if not among(axes, AXES):
            raise InputError(f"axes must be one of {AXES}, got {axes!r:.80}")
        J = np.eye(3)[None] if through is None else constant_jacobian(through)
        turn = None if axes == "space" or J is None else turns(J)[0]
        pair = isinstance(value, tuple | list) and len(value) == 2 and phased
        parts = [cls._checked(v, lattice, turn) for v in (value if pair else (value,))]
        if J is not None and not any(callable(p) or isinstance(p, Graded) for p in parts):
            axes = "space"
        return cls(tuple(parts) if pair else parts[0], axes, lattice, phased)

    @staticmethod
    def _checked(value: Any, lattice: Any, turn: FloatArray | None) -> Any:
        """One as it is kept, matrices turned."""
        raise NotImplementedError


class Stiffness(Tensor):
    """A stiffness as it was given: a matrix (6, 6), a `Graded`, a callable, or a pair of these."""

    @property
    def constant(self) -> bool:
        """Whether it is one matrix."""
        return isinstance(self.value, np.ndarray) and self.axes == "space"

    @staticmethod
    def _checked(value: Any, lattice: Any, turn: FloatArray | None) -> Any:
        """See `Tensor._checked`."""
        if isinstance(value, Graded):
            Scalar("by", value.by, -np.inf, lattice=lattice)
            return value
        if callable(value):
            return value
        C = as_matrices("stiffness", value)
        if C.ndim != 2:
            raise InputError(
                f"stiffness must be a matrix (6, 6), a function of points, a Graded, or a pair of "
                f"these with phases=, got shape {C.shape}"
            )
        return read_only(C if turn is None else rotated(C, turn))

    def at(self, asm: Assembly, u: FloatArray) -> FloatArray:
        """Matrices (n, 6, 6) at parameters (n, 3), or (1, 6, 6) of a constant; see `Scalar.at`."""
        assert not self.paired
        C = self._matrices(asm, u)
        return C if self.axes == "space" else rotated(C, turns(asm.jacobians(u)))

    def _matrices(self, asm: Assembly, u: FloatArray) -> FloatArray:
        """As they were given, along their own axes."""
        value = self.value
        if isinstance(value, np.ndarray):
            return value[None]
        if isinstance(value, Graded):
            scalar = Scalar("by", value.by, -np.inf, lattice=self.lattice)
            C = value.between(scalar.at(asm, u))
        else:
            C = as_array("stiffness", asked("stiffness", value, asm.x(u)), finite=False)
            if C.shape != (len(u), 6, 6):
                raise InputError(
                    f"stiffness must give one matrix per point, shape ({len(u)}, 6, 6), got "
                    f"{C.shape}"
                )
            check_finite("stiffness", C)
        wrong = refused(C)
        if wrong is not None:
            at = ", ".join(f"{c:.4g}" for c in asm.x(u)[wrong[0] if len(C) > 1 else 0])
            raise InputError(f"stiffness at ({at}) {wrong[1]}")
        return C


def turns(J: FloatArray) -> FloatArray:
    """Rotations (n, 3, 3) of Jacobians: the nearest orthogonal matrices."""
    U, _, V = np.linalg.svd(J)
    return np.asarray(U @ V)


@dataclass(frozen=True, eq=False)
class Anisotropic(Elastic):
    """Linear elastic material of any symmetry: as `Isotropic` is used.

    Attributes
    ----------
    stiffness : Stiffness
        Matrices.
    density, expansion : Scalar
        Mass per volume; thermal expansion per degree, the same in all directions.
    strength : Scalar or None
        Von Mises stress at which the material yields.
    """

    called: ClassVar[str] = "stiffness"
    stiffness: Stiffness
    density: Scalar
    expansion: Scalar
    strength: Scalar | None = None

    @property
    def constant(self) -> bool:
        """Whether the stiffness is the same everywhere."""
        return self.stiffness.constant

    @property
    def told(self) -> dict[str, Any]:
        """See `Law.told`."""
        return {**super().told, "stiffness": "6 x 6, of any symmetry"}

    def matrices(self, asm: Assembly, u: FloatArray) -> FloatArray:
        """Stiffness (n, 6, 6) or (1, 6, 6) at parameters (n, 3)."""
        return self.stiffness.at(asm, u)


def as_material(
    young: Any, poisson: Any, density: Any, expansion: Any, strength: Any, stiffness: Any,
    axes: Any, through: SplineMap | None, known: Mapping[str, Any],
) -> Elastic:  # fmt: skip
    """The material of what a user gave, see `Elasticity`, with where named properties come from."""
    others = (
        Scalar("density", density, closed=True, **known),
        Scalar("expansion", expansion, -np.inf, **known),
        None if strength is None else Scalar("strength", strength, **known),
    )
    if stiffness is None:
        if not among(axes, ("space",)):
            raise InputError(f"axes={axes!r:.80} are those of a stiffness=, which is not given")
        return Isotropic(
            Scalar("young", 1.0 if young is None else young, **known),
            Scalar("poisson", 0.3 if poisson is None else poisson, -1.0, 0.5, **known),
            *others,
        )
    given = "young" if young is not None else "poisson" if poisson is not None else ""
    if given:
        raise InputError(
            f"stiffness and {given} are both given: leave out one of them; "
            "il.cutfem.orthotropic makes a stiffness of moduli"
        )
    return Anisotropic(Stiffness.of(stiffness, axes, through, **known), *others)
