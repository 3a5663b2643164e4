"""Effective stiffness of a cell, and what engineers ask of it.

Guarantees: stiffnesses are symmetric to the bit; moduli of directions in which nothing is borne
are zero, not noise. Non-guarantee: `errors` are estimates of what the cells of the grid miss, and
bound nothing; what the geometry is off is not in them.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any, ClassVar

import numpy as np

from ilattice._typing import AnyArray, FloatArray
from ilattice._validate import FixedMapping, as_array, as_choice, read_only
from ilattice.errors import InputError
from ilattice.homogenize import tensors
from ilattice.homogenize._result import SOFT, Result, finite, told
from ilattice.homogenize.bounds import Bounds
from ilattice.homogenize.sphere import directions
from ilattice.homogenize.tensors import SYMMETRIES

#: Distance below which a stiffness has a symmetry.
SAME = 1e-4
#: Distance that cells may hide without an estimate.
HIDDEN = 0.05
#: Parts of the largest entry of a stiffness that are rounding, in those that are read from files.
ODD = 1e-6


@dataclass(frozen=True, eq=False)
class Effective(Result):
    """Effective stiffness of a cell: made by `elastic` and `voxels`.

    Attributes
    ----------
    C : ndarray, shape (6, 6)
        Stiffness: mean stress xx, yy, zz, yz, xz, xy of mean strains with engineering shear.
    errors : ndarray, shape (6, 6)
        Estimated errors of its entries because of the cells or voxels of the grid; NaN where there
        is no estimate.
    density : float
        Part of the cell that is filled.
    bounds : Bounds
        Of Voigt, Reuss, Hashin and Shtrikman.
    expansion : ndarray, shape (6,), or None
        Thermal expansion per degree: strain xx, yy, zz, yz, xz, xy, with engineering shear, that is
        free of mean stress; zero for what meets no resistance. None if no `expansion` was given.
    expansion_errors : ndarray, shape (6,), or None
        Estimated errors of its entries, as `errors`.
    modulus_error : float
        Largest estimated error of the energy of any strain, as a part of it: Young's, shear and
        bulk moduli are off by as much at most, which is more than entries of C are where these
        nearly cancel, as in tension of struts that bend. NaN without an estimate, and of voxels.
    of_solid : str or None
        Symmetry that was found in the solid itself, whatever the cells make of it; None if it was
        not looked for: in voxels, and in material that varies or is given by matrices.
    percolates : tuple of 3 bool
        Whether the solid goes on through the cell along each of its edges.
    report : HomogenizationReport
        Grid, unknowns, iterations.

    Examples
    --------
    >>> import numpy as np
    >>> import ilattice as il
    >>> layers = np.zeros((4, 4, 4), int)
    >>> layers[2:] = 1
    >>> eff = il.homogenize.voxels(layers, young=(1.0, 3.0), poisson=0.0)
    >>> round(eff.E((1, 0, 0)), 9), round(eff.E((0, 1, 0)), 9)
    (1.5, 2.0)
    """

    C: FloatArray
    errors: FloatArray
    bounds: Bounds
    expansion: FloatArray | None = None
    expansion_errors: FloatArray | None = None
    of_solid: str | None = None
    modulus_error: float = float("nan")
    matrix: ClassVar[str] = "C"
    quantity: ClassVar[str] = "E"
    title: ClassVar[str] = "Young's modulus E"

    def __post_init__(self) -> None:
        """Refuse what is no stiffness.

        Raises
        ------
        InputError
            If C is not a symmetric matrix, or has a negative eigenvalue beyond rounding.
        """
        C = as_array("C", self.C)
        if C.shape != (6, 6) or np.abs(C - C.T).max() > ODD * np.abs(C).max():
            raise InputError(f"C must be a symmetric matrix, shape (6, 6), got {self.C!r:.80}")
        values = self._spectrum[0]
        if values[0] < -ODD * np.abs(values).max():
            raise InputError(
                f"C must not have negative eigenvalues: in Mandel's notation one is "
                f"{values[0]:.3g}, the largest {values[-1]:.3g}; nothing elastic gives energy back"
            )
        super().__post_init__()

    def __repr__(self) -> str:
        return (
            f"Effective(density {self.density:.4g}, E {self.E((1, 0, 0)):.4g}, "
            f"{self.E((0, 1, 0)):.4g}, {self.E((0, 0, 1)):.4g}, error {self.error:.1e})"
        )

    # ---------------------------------------------------------------- numbers

    @cached_property
    def S(self) -> FloatArray:
        """Compliance (6, 6), the pseudo-inverse of C: zero for stresses that nothing bears."""
        return read_only(tensors.compliance(self.C, SOFT))

    @cached_property
    def _spectrum(self) -> tuple[FloatArray, FloatArray]:
        """Eigenvalues and tensors of C in Mandel's notation."""
        values, vectors = np.linalg.eigh(self.C * np.outer(tensors.MANDEL, tensors.MANDEL))
        return values, vectors

    @property
    def _firm(self) -> AnyArray:
        values = self._spectrum[0]
        return values > max(SOFT * float(values[-1]), 0.0)

    @property
    def mechanisms(self) -> int:
        """Number of independent strains, 0 to 6, that meet no resistance."""
        return int((~self._firm).sum())

    def E(self, n: Any) -> Any:
        """Young's modulus for tension along a direction.

        Parameters
        ----------
        n : array_like, shape (3,) or (m, 3)
            One direction, or rows of them, of any length.

        Returns
        -------
        float, or ndarray of shape (m,)
            Zero where the cell bears no such tension.
        """
        a = self._of_directions(tensors.as_direction("n", n))["E"]
        return float(a[0]) if np.ndim(n) == 1 else a

    def nu(self, n: Any, m: Any) -> Any:
        """Poisson's ratio: contraction along m under tension along n.

        Parameters
        ----------
        n, m : array_like, shape (3,) or (k, 3)
            Directions, orthogonal to each other.

        Returns
        -------
        float, or ndarray of shape (k,)
            NaN where the cell bears no tension along n.
        """
        a, b = _orthogonal(n, m)
        s, t = _dyad(a, a), _dyad(b, b)
        along = np.einsum("ki,ij,kj->k", s, self.S, s)
        across = np.einsum("ki,ij,kj->k", s, self.S, t)
        firm = self._bears(s)
        out = np.where(firm, -across / np.where(firm, along, 1.0), np.nan)
        return float(out[0]) if np.ndim(n) == 1 and np.ndim(m) == 1 else out

    def G(self, n: Any, m: Any) -> Any:
        """Shear modulus for shear of planes normal to n along m.

        Parameters
        ----------
        n, m : array_like, shape (3,) or (k, 3)
            Directions, orthogonal to each other.

        Returns
        -------
        float, or ndarray of shape (k,)
            Zero where the cell bears no such shear.
        """
        s = 2.0 * _dyad(*_orthogonal(n, m))
        firm = self._bears(s)
        soft = np.einsum("ki,ij,kj->k", s, self.S, s)
        out = np.where(firm, 1.0 / np.where(firm, soft, 1.0), 0.0)
        return float(out[0]) if np.ndim(n) == 1 and np.ndim(m) == 1 else out

    def _bears(self, s: FloatArray) -> AnyArray:
        """Whether stresses (k, 6), in Voigt's notation, meet no mechanism."""
        lost = (s * tensors.MANDEL) @ self._spectrum[1][:, ~self._firm]
        return np.asarray((lost**2).sum(axis=1) <= 1e-6 * ((s * tensors.MANDEL) ** 2).sum(axis=1))

    @property
    def K(self) -> float:
        """Bulk modulus: mean stress under a unit of volume change in every direction alike."""
        return float(tensors.bulk_and_shear(self.C)[0])

    @property
    def G_mean(self) -> float:
        """Shear modulus of the nearest isotropic tensor."""
        return float(tensors.bulk_and_shear(self.C)[1])

    @property
    def zener(self) -> float:
        """Anisotropy 2 C44 / (C11 - C12) of the nearest cubic tensor: 1 for isotropic ones."""
        C = tensors.nearest(self.C, "cubic")
        return float(2.0 * C[3, 3] / (C[0, 0] - C[0, 1])) if C[0, 0] > C[0, 1] else float("nan")

    @property
    def universal_anisotropy(self) -> float:
        """5 G_V / G_R + K_V / K_R - 6: zero for isotropic tensors, infinite with mechanisms."""
        if self.mechanisms:
            return float("inf")
        bulk, shear = tensors.bulk_and_shear(self.C)
        R = self.S / np.outer(tensors.MANDEL, tensors.MANDEL)
        soft_bulk = float(3.0 * (R * tensors.VOLUME).sum())
        soft_shear = float(0.4 * (R * tensors.SHAPE).sum())
        return 5.0 * shear * soft_shear + bulk * soft_bulk - 6.0

    # ---------------------------------------------------------------- symmetry

    def nearest(self, symmetry: str) -> FloatArray:
        """The nearest stiffness with a symmetry, with axes along x, y, z.

        Parameters
        ----------
        symmetry : {"isotropic", "cubic", "transversely isotropic", "tetragonal", "orthotropic"}
            Which; the axis of the third and the fourth is z.

        Returns
        -------
        ndarray, shape (6, 6)
            Stiffness.
        """
        return tensors.nearest(self.C, as_choice("symmetry", symmetry, SYMMETRIES))

    @cached_property
    def distances(self) -> Mapping[str, float]:
        """Relative distance to the nearest tensor of each symmetry."""
        whole = max(tensors.size(self.C), 1e-300)
        return FixedMapping(
            {s: tensors.size(self.C - tensors.nearest(self.C, s)) / whole for s in SYMMETRIES}
        )

    @property
    def symmetry(self) -> str:
        """The highest symmetry of which `distances` is below 1e-4, or "anisotropic".

        Where the solid itself was found to have one, cells that have not may hide it: then
        `distances` is below `error`, or 5 % without an estimate.
        """
        may = dict.fromkeys(SYMMETRIES, SAME)
        if self.of_solid in may:
            may[self.of_solid] = max(SAME, HIDDEN if np.isnan(self.error) else self.error)
        return next((s for s in SYMMETRIES if self.distances[s] <= may[s]), "anisotropic")

    def rotated(self, rotation: Any) -> FloatArray:
        """Stiffness of the turned cell.

        Parameters
        ----------
        rotation : array_like, shape (3, 3)
            Orthogonal matrix: a point x of the cell goes to ``rotation @ x``.

        Returns
        -------
        ndarray, shape (6, 6)
            Stiffness.
        """
        return tensors.rotated(self.C, tensors.as_rotation(rotation))

    @property
    def margins(self) -> dict[str, float]:
        """See `Bounds.margins`."""
        return self.bounds.margins(self.C)

    # ---------------------------------------------------------------- files

    def _of_directions(self, n: FloatArray) -> dict[str, AnyArray]:
        s = _dyad(n, n)
        firm = self._bears(s)
        soft = np.einsum("ki,ij,kj->k", s, self.S, s)
        out: dict[str, AnyArray] = {"E": np.where(firm, 1.0 / np.where(firm, soft, 1.0), 0.0)}
        nu, shear = [], []
        for m in directions(n):
            t, both = _dyad(m, m), 2.0 * _dyad(n, m)
            across = np.einsum("ki,ij,kj->k", s, self.S, t)
            nu.append(np.where(firm, -across * out["E"], 0.0))
            slack = np.einsum("ki,ij,kj->k", both, self.S, both)
            bears = self._bears(both)
            shear.append(np.where(bears, 1.0 / np.where(bears, slack, 1.0), 0.0))
        for name, values in (("nu", nu), ("G", shear)):
            out[f"{name}_min"], out[f"{name}_max"] = np.min(values, axis=0), np.max(values, axis=0)
        return out

    def as_dict(self) -> dict[str, Any]:
        """All numbers in a form that JSON takes.

        Returns
        -------
        dict of str to object
            By name.
        """
        axes = np.eye(3)
        out: dict[str, Any] = {
            "density": self.density, "C": self.C.tolist(), "errors": self.errors.tolist(),
            "error": self.error, "modulus_error": self.modulus_error, "S": self.S.tolist(),
            "K": self.K, "G_mean": self.G_mean, "zener": self.zener,
            "universal_anisotropy": self.universal_anisotropy, "symmetry": self.symmetry,
            "mechanisms": self.mechanisms, "percolates": list(self.percolates),
            "distances": dict(self.distances), "bounds": told(self.bounds), "margins": self.margins,
            "report": vars(self.report),
        }  # fmt: skip
        if self.expansion is not None and self.expansion_errors is not None:
            out["expansion"] = self.expansion.tolist()
            out["expansion_errors"] = self.expansion_errors.tolist()
        for i, a in enumerate("xyz"):
            out[f"E_{a}"] = self.E(axes[i])
        for i, j in ((0, 1), (0, 2), (1, 2)):
            out[f"nu_{'xyz'[i]}{'xyz'[j]}"] = self.nu(axes[i], axes[j])
            out[f"G_{'xyz'[i]}{'xyz'[j]}"] = self.G(axes[i], axes[j])
        return finite(out)


def _orthogonal(n: Any, m: Any) -> tuple[FloatArray, FloatArray]:
    """Pairs of orthogonal unit vectors, m made so where it is nearly."""
    a, b = tensors.as_direction("n", n), tensors.as_direction("m", m)
    if len(a) != len(b) and 1 not in (len(a), len(b)):
        raise InputError(
            f"m must be one direction or as many as n, got {len(b)} with {len(a)} of n"
        )
    a, b = np.broadcast_arrays(a, b)
    off = (a * b).sum(axis=1, keepdims=True)
    if np.abs(off).max(initial=0.0) > 1e-6:
        raise InputError(f"m must be orthogonal to n, got {m!r:.60} with n={n!r:.60}")
    return a, b


def _dyad(a: FloatArray, b: FloatArray) -> FloatArray:
    """Stresses (k, 6) of a unit of a b: in Voigt's notation."""
    return np.stack([0.5 * (a[:, i] * b[:, j] + a[:, j] * b[:, i]) for i, j in tensors.PAIRS], 1)
