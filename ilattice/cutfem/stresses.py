"""Displacement, strain and stress of an elastic solid at parameters: what results have in common.

Guarantee: fields are those of the splines, evaluated anywhere in the solid, not interpolated.
Non-guarantee: stresses are the derivatives of the displacement, an order less accurate, and are not
averaged; outside the solid fields are continued by one cell, then NaN.
"""

from functools import cached_property
from typing import Any, ClassVar

import numpy as np

from ilattice._typing import AnyArray, ArrayLike, FloatArray, IntArray
from ilattice._validate import as_points
from ilattice.cutfem._voigt import elastic_stress, engineering_strain
from ilattice.cutfem.operators import ElasticOperators
from ilattice.cutfem.output import Result
from ilattice.errors import InputError
from ilattice.plot import show


class Stresses(Result):
    """What is there of a displacement, given by coefficients (functions, 3), at parameters."""

    problem: ElasticOperators
    shown: ClassVar[str] = "von_mises"
    probed: ClassVar[tuple[str, ...]] = ("strain", "principal", "utilization", "margin")

    displacement = Result.evaluate

    def strain(self, u: ArrayLike) -> FloatArray:
        """Strain at parameters.

        Parameters
        ----------
        u : array_like, shape (n, 3)
            Parameters.

        Returns
        -------
        ndarray, shape (n, 6)
            xx, yy, zz, yz, xz, xy with engineering shear.
        """
        return engineering_strain(self._fields(u)[1])

    def stress(self, u: ArrayLike) -> FloatArray:
        """Stress at parameters.

        Parameters
        ----------
        u : array_like, shape (n, 3)
            Parameters.

        Returns
        -------
        ndarray, shape (n, 6)
            xx, yy, zz, yz, xz, xy.
        """
        return self._flux_at(as_points("u", u))

    def von_mises(self, u: ArrayLike) -> FloatArray:
        """Von Mises stress at parameters.

        Parameters
        ----------
        u : array_like, shape (n, 3)
            Parameters.

        Returns
        -------
        ndarray, shape (n,)
            The equivalent stress.
        """
        return von_mises(self.stress(u))

    def principal(self, u: ArrayLike) -> FloatArray:
        """Principal stresses at parameters.

        Parameters
        ----------
        u : array_like, shape (n, 3)
            Parameters.

        Returns
        -------
        ndarray, shape (n, 3)
            Increasing; NaN where the stress is.
        """
        s = self.stress(u)
        out = np.full((len(s), 3), np.nan)
        good = np.isfinite(s).all(axis=1)
        out[good] = np.linalg.eigvalsh(s[good][:, [[0, 5, 4], [5, 1, 3], [4, 3, 2]]])
        return out

    def utilization(self, u: ArrayLike) -> FloatArray:
        """Von Mises stress over the strength of the material, at parameters.

        Parameters
        ----------
        u : array_like, shape (n, 3)
            Parameters.

        Returns
        -------
        ndarray, shape (n,)
            Above 1 the material yields; the inverse is the factor of safety there.

        Raises
        ------
        InputError
            If the problem was made without `strength`.
        """
        p = as_points("u", u)
        return self.von_mises(p) / self._strength(p, self.problem.assembly.space.locate(p))

    def margin(self, u: ArrayLike) -> FloatArray:
        """Margin of safety at parameters: strength over von Mises stress, less one.

        Parameters
        ----------
        u : array_like, shape (n, 3)
            Parameters.

        Returns
        -------
        ndarray, shape (n,)
            Negative where the material yields; infinite without stress.

        Raises
        ------
        InputError
            If the problem was made without `strength`.
        """
        with np.errstate(divide="ignore"):
            return 1.0 / self.utilization(u) - 1.0

    def plot(self, *, scalars: str | None = None, **options: Any) -> Any:
        """Show the deformed solid, with colours by its main field.

        Parameters
        ----------
        scalars : str, optional
            Data by which it is coloured. ``"margin"`` is the margin of safety, red where it is
            negative and blue where it is positive, full blue from 1 on; it needs a `strength`.
        **options
            Of `Result.plot`: ``on``, ``h``, ``scale``, and of `ilattice.plot.show`.

        Returns
        -------
        object
            What pyvista returns.
        """
        if scalars != "margin":
            options |= {} if scalars is None else {"scalars": scalars}
            return super().plot(**options)
        how = {name: options.pop(name) for name in ("on", "h") if name in options}
        grid = self.to_pyvista(**how, scale=options.pop("scale", "auto"))
        if "utilization" not in grid.point_data:
            self._strength(np.zeros((0, 3)), np.zeros(0, np.int64))
        return show(grid, **margins(grid), **{"title": self._title(), **options})

    def _strength(self, u: FloatArray, owner: IntArray) -> FloatArray:
        """Strength (n,) or (1,) at parameters in active cells."""
        strength = self.problem.material.strength
        if strength is None:
            name = type(self.problem).__name__
            raise InputError(f"the material has no strength: give {name}(..., strength=...)")
        return self.problem._scalar_at(strength, u, owner)

    def point_data(self, u: ArrayLike) -> dict[str, AnyArray]:
        """What files hold, at parameters.

        Parameters
        ----------
        u : array_like, shape (n, 3)
            Parameters.

        Returns
        -------
        dict of str to ndarray
            ``displacement`` (n, 3), ``stress`` (n, 6), ``von_mises`` (n,), and, if the material
            has a strength, ``utilization`` (n,).
        """
        stress = self.stress(u)
        data = {"displacement": self.evaluate(u), "stress": stress, "von_mises": von_mises(stress)}
        if self.problem.material.strength is not None:
            p = as_points("u", u)
            strength = self._strength(p, self.problem.assembly.space.locate(p))
            data["utilization"] = data["von_mises"] / strength
        return data

    def _flux(self, gradient: FloatArray, u: FloatArray, owner: IntArray) -> FloatArray:
        """Stress (n, 6), of what is projected and heated as the solid is."""
        problem = self.problem
        if problem.projection is None:
            out = super()._flux(gradient, u, owner)
        else:
            lam, mu = problem._lame(u, owner)
            out = elastic_stress(gradient, lam * self._dilatation(gradient, u, owner), mu)
        for load in problem.loads:
            if load.kind == "temperature":
                out -= problem._thermal_stress(load, u, owner)
        return out

    def _dilatation(self, gradient: FloatArray, u: FloatArray, owner: IntArray) -> FloatArray:
        """Change of volume (n,) that makes stress: div u, or its projection."""
        projection = self.problem.projection
        if projection is None:
            return np.trace(gradient, axis1=1, axis2=2)
        return projection.at(self._projected, u, owner)

    @cached_property
    def _projected(self) -> FloatArray:
        """Projection (cells, terms) of div u."""
        assert self.problem.projection is not None
        return self.problem.projection.of_field(self.coefficients)


def von_mises(s: FloatArray) -> FloatArray:
    """Equivalent stress (n,) of stresses (n, 6)."""
    a, b, c = s[:, 0] - s[:, 1], s[:, 1] - s[:, 2], s[:, 2] - s[:, 0]
    return np.sqrt(0.5 * (a * a + b * b + c * c) + 3.0 * (s[:, 3:] ** 2).sum(axis=1))


def margins(grid: Any) -> dict[str, Any]:
    """Put margins of safety on a dataset that has utilizations; the style in which they are drawn.

    Parameters
    ----------
    grid : pyvista.DataSet
        Gets the point data ``margin``, at most 1.

    Returns
    -------
    dict
        For `ilattice.plot.Scene.add`: red below zero, white at zero, blue above.
    """
    used = np.asarray(grid.point_data["utilization"])
    with np.errstate(divide="ignore"):
        grid.point_data["margin"] = np.minimum(1.0 / used - 1.0, 1.0)
    return {"scalars": "margin", "label": "margin of safety", "clim": (-1.0, 1.0), "cmap": "RdBu"}
