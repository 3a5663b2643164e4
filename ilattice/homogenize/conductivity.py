"""Effective conductivity of a cell."""

from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from ilattice._typing import AnyArray, FloatArray
from ilattice.homogenize import tensors
from ilattice.homogenize._result import Result, finite, told
from ilattice.homogenize.bounds import ConductivityBounds


@dataclass(frozen=True, eq=False)
class Conductivity(Result):
    """Effective conductivity of a cell: made by `conductive` and `voxels`.

    Attributes
    ----------
    k : ndarray, shape (3, 3)
        Mean flux, without the sign, of mean gradients.
    errors : ndarray, shape (3, 3)
        Estimated errors of its entries because of the cells; NaN where there is no estimate.
    density : float
        Part of the cell that is filled.
    bounds : ConductivityBounds
        Of Wiener, Hashin and Shtrikman.
    percolates : tuple of 3 bool
        Whether the solid goes on through the cell along each of its edges.
    report : HomogenizationReport
        Grid, unknowns, iterations.
    """

    k: FloatArray
    errors: FloatArray
    bounds: ConductivityBounds
    matrix: ClassVar[str] = "k"
    quantity: ClassVar[str] = "k"
    title: ClassVar[str] = "conductivity k"

    def __repr__(self) -> str:
        a, b, c = np.diag(self.k)
        return (
            f"Conductivity(density {self.density:.4g}, k {a:.4g}, {b:.4g}, {c:.4g}, "
            f"error {self.error:.1e})"
        )

    @property
    def mean(self) -> float:
        """Mean of the principal conductivities."""
        return float(np.trace(self.k) / 3.0)

    def rotated(self, rotation: Any) -> FloatArray:
        """Conductivity of the turned cell.

        Parameters
        ----------
        rotation : array_like, shape (3, 3)
            Orthogonal matrix: a point x of the cell goes to ``rotation @ x``.

        Returns
        -------
        ndarray, shape (3, 3)
            Conductivity.
        """
        Q = tensors.as_rotation(rotation)
        return Q @ self.k @ Q.T

    def _of_directions(self, n: FloatArray) -> dict[str, AnyArray]:
        return {"k": np.einsum("ni,ij,nj->n", n, self.k, n)}

    def as_dict(self) -> dict[str, Any]:
        """All numbers in a form that JSON takes.

        Returns
        -------
        dict of str to object
            By name.
        """
        return finite({
            "density": self.density, "k": self.k.tolist(), "errors": self.errors.tolist(),
            "error": self.error, "mean": self.mean, "percolates": list(self.percolates),
            "bounds": told(self.bounds), "report": vars(self.report),
        })  # fmt: skip
