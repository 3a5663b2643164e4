"""Displacements and stresses inside of a cell under mean stresses, and at which of these it yields.

::

    cell = il.homogenize.ElasticCell(wall, 12, young=70e3, strength=250.0)
    local = cell.under((100.0, 0, 0, 0, 0, 0))
    local.save("tension.vtu")
    cell.first_yield([(1.0, 0, 0, 0, 0, 0), (0, 0, 0, 0, 0, 1.0)])  # stresses that it bears

Everything comes from the solutions for six mean strains, which are kept: a further mean stress is a
combination of them.

Guarantees: the mean of the stresses over the cell, voids included, is the mean stress, up to what
the penalty on jumps at cut cells bears; a mean stress that the cell does not bear is refused.
Non-guarantee: stresses are an order less accurate than displacements, and at re-entrant edges they
grow without bound under refinement, so that the first yield there depends on the cells.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np

from ilattice._typing import ArrayLike, FloatArray, IntArray
from ilattice._validate import as_array, as_points
from ilattice.cutfem.elasticity import Elasticity
from ilattice.cutfem.stresses import Stresses, von_mises
from ilattice.errors import InputError
from ilattice.homogenize import tensors
from ilattice.homogenize._result import SOFT

#: Part of a mean stress that a cell may miss without bearing none of it.
BORNE = 1e-6
#: Part of a stress below which its deviator is rounding.
ROUNDING = 1e-12


@dataclass(frozen=True, eq=False)
class LocalFields(Stresses):
    """A cell under a mean stress: made by `ElasticCell.under`.

    Attributes
    ----------
    problem : ElasticCell
        The cell.
    coefficients : ndarray, shape (functions, 3)
        Of the displacement without the mean strain.
    mean_stress, mean_strain : ndarray, shape (6,)
        xx, yy, zz, yz, xz, xy; strains with engineering shear.
    """

    problem: Elasticity
    coefficients: FloatArray
    mean_stress: FloatArray
    mean_strain: FloatArray

    def _fields(self, u: ArrayLike) -> tuple[FloatArray, FloatArray]:
        """Displacement and its gradient, those of the mean strain included."""
        value, gradient = super()._fields(u)
        E = as_matrix(self.mean_strain)
        return value + self.problem.assembly.x(as_points("u", u)) @ E, gradient + E

    def _dilatation(self, gradient: FloatArray, u: FloatArray, owner: IntArray) -> FloatArray:
        """Change of volume (n,): only what is not the mean is projected."""
        if self.problem.projection is None:
            return super()._dilatation(gradient, u, owner)
        return super()._dilatation(gradient, u, owner) + self.mean_strain[:3].sum()


def as_matrix(strain: FloatArray) -> FloatArray:
    """A strain (6,) with engineering shear as a symmetric matrix (3, 3)."""
    return np.einsum("a,aij->ij", strain, tensors.strain_matrices())


def as_stresses(stress: Any, C: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Mean stresses (n, 6) and their mean strains, or `InputError` where none is borne."""
    given = as_array("stress", stress)
    if given.ndim not in (1, 2) or given.shape[-1] != 6 or not given.size:
        raise InputError(
            f"stress must be xx, yy, zz, yz, xz, xy, shape (6,), or rows of them, got shape "
            f"{given.shape}"
        )
    rows = given.reshape(-1, 6)
    size = np.abs(rows).max(axis=1, keepdims=True)
    unit = rows / np.where(size > 0, size, 1.0)  # squares of large numbers have no room
    strains = unit @ tensors.compliance(C, SOFT)
    missed = np.linalg.norm(unit - strains @ C, axis=1)
    wrong = np.flatnonzero(~((missed <= BORNE * np.linalg.norm(unit, axis=1)) & (size[:, 0] > 0)))
    if len(wrong):
        raise InputError(
            f"stress: the cell bears nothing of {rows[wrong[0]].tolist()}, or only a part; give "
            "stresses that are not zero and that meet resistance, see `Effective.mechanisms`"
        )
    return rows, size * strains


def first_yield(problem: Elasticity, coefficients: FloatArray, strains: FloatArray) -> FloatArray:
    """Factors (m,) by which cases may grow until a point yields, infinite where none does.

    Of solutions (functions, 3, 6) for unit strains, and the mean strains (m, 6) of the cases.
    """
    strength = problem.material.strength
    if strength is None:
        raise InputError("the material has no strength: give ElasticCell(..., strength=...)")
    asm = problem.assembly
    rule = problem.domain.solid(asm)
    assert rule.parameters is not None
    c = np.ascontiguousarray(coefficients.transpose(0, 2, 1)).reshape(len(coefficients), 18)
    unit = [
        LocalFields(problem, coefficients[..., a], np.zeros(6), e) for a, e in enumerate(np.eye(6))
    ]
    E, owners, used = tensors.strain_matrices(), asm.owners(rule), np.zeros(len(strains))
    size = np.abs(strains).max(axis=1)
    for rows, _, gradient in asm.on_rule(c, rule):
        u, owner = rule.parameters[rows], owners[rows]
        g = gradient.reshape(-1, 6, 3, 3) + E
        local = np.stack([one._flux(g[:, a], u, owner) for a, one in enumerate(unit)])
        limit = problem._scalar_at(strength, u, owner)
        for i, strain in enumerate(strains / size[:, None]):
            stress = np.einsum("a,anj->nj", strain, local)
            equivalent = von_mises(stress)
            equivalent[equivalent <= ROUNDING * np.abs(stress).max(axis=1, initial=0.0)] = 0.0
            used[i] = max(used[i], float((equivalent / limit).max(initial=0.0)))
    with np.errstate(divide="ignore", over="ignore"):
        return np.asarray(1.0 / used / size)
