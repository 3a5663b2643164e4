"""Bounds of effective properties by what phases there are, and how much of each.

Voigt's and Reuss's bounds, means of stiffnesses and of compliances, hold for every cell, in the
order of quadratic forms. Those of Hashin and Shtrikman (1963), for any number of isotropic phases
as Walpole (1966) has them, hold for the mean moduli that `Bounds` names: with polarizations that
are the same multiple of all deviators, or of the unit tensor, their derivation does not use that
the cell is isotropic.

Guarantee: exact statements on exact effective properties. Non-guarantee: discrete ones lie above
the exact ones on exact geometry, by up to the error that results come with.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ilattice._typing import FloatArray
from ilattice._validate import Frozen
from ilattice.homogenize.tensors import MANDEL, bulk_and_shear

Interval = tuple[float, float]


@dataclass(frozen=True, eq=False)
class Bounds(Frozen):
    """Bounds of an effective stiffness.

    Attributes
    ----------
    voigt, reuss : ndarray, shape (6, 6)
        Mean stiffness, and the inverse of the mean compliance: zero with voids.
    bulk, shear : tuple of 2 floats, or None
        Bounds of Hashin and Shtrikman of the moduli of the nearest isotropic tensor, `Effective.K`
        and `Effective.G_mean`; None where a material varies continuously.
    """

    voigt: FloatArray
    reuss: FloatArray
    bulk: Interval | None
    shear: Interval | None

    def __repr__(self) -> str:
        """Intervals of the moduli."""
        return f"Bounds(bulk={_told(self.bulk)}, shear={_told(self.shear)})"

    @property
    def hashin_shtrikman(self) -> dict[str, Interval] | None:
        """Both intervals by name."""
        if self.bulk is None or self.shear is None:
            return None
        return {"bulk": self.bulk, "shear": self.shear}

    def margins(self, C: FloatArray) -> dict[str, float]:
        """How far a stiffness is within the bounds, as a part of the upper ones.

        Parameters
        ----------
        C : ndarray, shape (6, 6)
            Stiffness.

        Returns
        -------
        dict of str to float
            Negative where a bound is broken: ``voigt`` and ``reuss`` the least eigenvalues of the
            differences, ``bulk`` and ``shear`` the distances to the upper bounds.
        """
        scale = np.outer(MANDEL, MANDEL)
        top = float(np.linalg.eigvalsh(self.voigt * scale)[-1]) or 1.0
        out = {
            "voigt": float(np.linalg.eigvalsh((self.voigt - C) * scale)[0]) / top,
            "reuss": float(np.linalg.eigvalsh((C - self.reuss) * scale)[0]) / top,
        }
        found = dict(zip(("bulk", "shear"), bulk_and_shear(C), strict=True))
        for name, interval in (self.hashin_shtrikman or {}).items():
            out[name] = (interval[1] - found[name]) / (interval[1] or 1.0)
        return out


@dataclass(frozen=True, eq=False)
class ConductivityBounds(Frozen):
    """Bounds of an effective conductivity.

    Attributes
    ----------
    wiener : tuple of ndarray, shape (3, 3)
        Inverse of the mean resistance, zero with voids, and mean conductivity.
    hashin_shtrikman : tuple of 2 floats, or None
        Of the mean of the principal conductivities; None where a material varies continuously.
    """

    wiener: tuple[FloatArray, FloatArray]
    hashin_shtrikman: Interval | None


def elastic_bounds(
    fractions: FloatArray, bulk: FloatArray, shear: FloatArray
) -> tuple[Interval, Interval]:
    """Intervals of the bulk and of the shear modulus of isotropic phases.

    Parameters
    ----------
    fractions, bulk, shear : ndarray, shape (phases,)
        Volume fractions, which sum up to 1, and moduli, zero for voids.

    Returns
    -------
    tuple of 2 tuples
        Bounds of the bulk modulus, and of the shear modulus.
    """
    there = fractions > 0.0
    f, K, G = fractions[there], bulk[there], shear[there]
    zeta = [
        g / 6.0 * ((9.0 * k + 8.0 * g) / (k + 2.0 * g)) if g > 0 else 0.0 for k, g in _ends(K, G)
    ]
    low, high = (_mean(f, K, 4.0 / 3.0 * g) for _, g in _ends(K, G))
    least, most = (_mean(f, G, z) for z in zeta)
    return (low, high), (least, most)


def conductive_bounds(fractions: FloatArray, conductivity: FloatArray) -> Interval:
    """Interval of the conductivity of phases with a scalar one each."""
    there = fractions > 0.0
    f, k = fractions[there], conductivity[there]
    return _mean(f, k, 2.0 * k.min()), _mean(f, k, 2.0 * k.max())


def _ends(K: FloatArray, G: FloatArray) -> Sequence[tuple[float, float]]:
    """Least and largest moduli."""
    return (float(K.min()), float(G.min())), (float(K.max()), float(G.max()))


def _mean(f: FloatArray, x: FloatArray, y: float) -> float:
    """The mean of x in which 1 / (x + y) is averaged."""
    if (x + y <= 0.0).any():
        return 0.0
    return max(float(1.0 / (f / (x + y)).sum() - y), 0.0)


def _told(interval: Interval | None) -> str:
    """An interval in few digits."""
    return "None" if interval is None else f"({interval[0]:.5g}, {interval[1]:.5g})"
