"""Change of volume projected cell by cell, so that nearly incompressible solids do not lock.

Where Poisson's ratio comes near 1/2 the energy of the change of volume, λ (div u)² / 2, grows
without bound, and splines that cannot keep their volume at every point of quadrature become stiff.
With the mean of div u over the part of the solid in a cell, or its projection on few polynomials,
they can: the method of Hughes, 1980 (B-bar), for λ alone, so that the rest of the energy still sees
all of the strain. The projection is orthogonal in the mean with the weight λ; stresses, energies
and loads by temperature use the same one, so that work and energy agree. Of two phases each has
its own elements and its own λ; tractions where they meet have the projected change of volume, too
(see `coupling`).

Guarantees: exact where div u is constant in every cell (patch tests); the matrix stays symmetric
and positive, and no functions are coupled that were not before. Non-guarantees: the pressure is an
order less accurate than the displacement, and may oscillate from cell to cell where the solid
is held all around.
"""

import numbers
from dataclasses import dataclass
from typing import Any

import numpy as np

from ilattice._typing import FloatArray, IntArray
from ilattice.cutfem.assembly import Assembly
from ilattice.cutfem.material import Elastic
from ilattice.quadrature.rules import Quadrature

#: Poisson's ratio from which "auto" projects.
FROM = 0.45
#: Number of continuous derivatives of cubic splines that do not lock: smoother ones have one
#: function per cell, fewer than the conditions that keep their order.
MAX_SMOOTH = 1
#: Polynomials of which a cell has less than this part of the greatest spread are left out.
THIN = 1e-9


@dataclass(frozen=True, eq=False)
class Dilatation:
    """Projection of div u on polynomials of each active cell.

    Attributes
    ----------
    assembly : Assembly
        Functions and map.
    terms : int
        1 for constants, 4 for linear functions of the parameters.
    products : ndarray, shape (cells, nb, 3, terms)
        Integrals of λ times derivative of a function times polynomial.
    inverses : ndarray, shape (cells, terms, terms)
        Inverses of the integrals of λ times products of polynomials.
    """

    assembly: Assembly
    terms: int
    products: FloatArray
    inverses: FloatArray

    @classmethod
    def of(cls, asm: Assembly, parts: Any, terms: int) -> "Dilatation":
        """The projection with integrals over pairs of a material and a rule in parameters."""
        cells, nb = asm.space.dofs.shape
        products = np.zeros((cells, nb, 3, terms))
        masses = np.zeros((cells, terms, terms))
        for material, rule in parts:
            _add(asm, material, rule, products, masses)
        return cls(asm, terms, products, _inverses(masses))

    def add(self, data: FloatArray) -> None:
        """Add the energy of the projected change of volume to blocks (count, 3, 3)."""
        cells, nb = self.products.shape[:2]
        size = 3 * nb
        step = max((1 << 24) // (8 * size * size), 64)
        for i in range(0, cells, step):
            at = np.arange(i, min(i + step, cells))
            G = self.products[at].reshape(len(at), size, self.terms)
            A = G @ self.inverses[at] @ G.transpose(0, 2, 1)
            self.assembly.add_blocks(data, at, 0.5 * (A + A.transpose(0, 2, 1)))

    def add_tractions(self, data: FloatArray, rule: Quadrature, f: FloatArray) -> None:
        """Add minus the integral of (f·u) π(div v) + (f·v) π(div u) over a surface.

        f (n, 3) are λ times weight times normal at the points of a rule in space.
        """
        at, H = self._surface(rule, f)
        size = H.shape[1] * 3
        G = self.products[at].reshape(len(at), size, self.terms) @ self.inverses[at]
        A = G @ H.reshape(len(at), size, self.terms).transpose(0, 2, 1)
        self.assembly.add_blocks(data, at, -(A + A.transpose(0, 2, 1)))

    def traction_force(self, rule: Quadrature, g: FloatArray) -> FloatArray:
        """Coefficients (functions, 3) of minus the integral of g π(div v) over a surface.

        g (n,) are λ times weight times prescribed normal displacement.
        """
        assert rule.parameters is not None
        asm = self.assembly
        at = np.searchsorted(asm.space.cells, rule.cells)
        moments = np.zeros((len(at), self.terms))
        m = self.polynomials(rule.parameters, at[rule.owners])
        np.add.at(moments, rule.owners, g[:, None] * m)
        parts = np.einsum("eait,est,es->eai", self.products[at], self.inverses[at], moments)
        return -asm.gathered(rule, parts)

    def traces(self, rule: Quadrature, w: FloatArray) -> FloatArray:
        """Largest ratio (cells,) of the mean squares of polynomials on a surface and in its cells.

        w (n,) are λ times weight at the points of a rule in space.
        """
        assert rule.parameters is not None
        at = np.searchsorted(self.assembly.space.cells, rule.cells)
        m = self.polynomials(rule.parameters, at[rule.owners])
        squares = np.zeros_like(self.inverses)
        np.add.at(squares, at[rule.owners], w[:, None, None] * m[:, :, None] * m[:, None, :])
        return np.linalg.eigvals(self.inverses[at] @ squares[at]).real.max(axis=1, initial=0.0)

    def _surface(self, rule: Quadrature, f: FloatArray) -> tuple[IntArray, FloatArray]:
        """Cells of a surface rule, and integrals (cells, nb, 3, terms) of N f times polynomials."""
        assert rule.parameters is not None
        at = np.searchsorted(self.assembly.space.cells, rule.cells)
        m = self.polynomials(rule.parameters, at[rule.owners])
        parts = [self.assembly.per_cell(rule, m[:, t, None] * f) for t in range(self.terms)]
        return at, np.stack(parts, axis=3)

    def of_field(self, c: FloatArray) -> FloatArray:
        """Coefficients (cells, terms) of the projected div u of coefficients (functions, 3)."""
        local = c[self.assembly.space.dofs]
        right = np.einsum("eait,eai->et", self.products, local)
        return np.einsum("est,et->es", self.inverses, right)

    def of_values(self, material: Elastic, rule: Quadrature, f: FloatArray) -> FloatArray:
        """Coefficients (cells, terms) of the projection of f (n,) at the points of a rule."""
        at = np.searchsorted(self.assembly.space.cells, rule.cells)
        right = np.zeros(self.inverses.shape[:2])
        w = _weights(self.assembly, material, rule)
        values = (w * f)[:, None] * self.polynomials(rule.points, at[rule.owners])
        np.add.at(right, at[rule.owners], values)
        return np.einsum("est,et->es", self.inverses, right)

    def at(self, coefficients: FloatArray, u: FloatArray, owner: IntArray) -> FloatArray:
        """Values (n,) at parameters in the cells `owner`; NaN where that is -1."""
        at = np.maximum(owner, 0)
        value = (coefficients[at] * self.polynomials(u, at)).sum(axis=1)
        return np.where(owner < 0, np.nan, value)

    def polynomials(self, u: FloatArray, at: IntArray) -> FloatArray:
        """Those (n, terms) that are projected on, at parameters in the cells at some positions."""
        return polynomials(self.assembly, u, at, self.terms)


def is_near(poisson: Any) -> bool:
    """Whether Poisson's ratio, or that of a phase, is a number from which "auto" projects."""
    values = poisson if isinstance(poisson, tuple | list) else (poisson,)
    return any(isinstance(v, numbers.Real) and float(v) >= FROM for v in values)


def as_terms(degree: int, smoothness: int) -> int:
    """How many polynomials keep the order without locking.

    Linear ones are stable for quadratic splines that are no smoother than finite elements.
    Smooth quadratic splines have one function per cell, and bear one condition; cubic ones would
    lose their order with it, and lock with more: see `MAX_SMOOTH`.
    """
    return 1 if degree == 1 or (degree == 2 and smoothness == 1) else 4


def polynomials(asm: Assembly, u: FloatArray, at: IntArray, terms: int) -> FloatArray:
    """1 and the local coordinates, -1 to 1, of points in cells: (n, terms)."""
    out = np.ones((len(u), terms))
    if terms > 1:
        box = asm.space.boxes[at]
        local = 2.0 * (u - box[:, :3]) / box[:, 3:] - 1.0
        closed = np.flatnonzero(asm.space.grid.closed)
        axes = asm.space.grid.axes
        for a in closed:  # the cell may be on the other side of the seam
            period = 2.0 * (axes[a][-1] - axes[a][0]) / box[:, 3 + a]
            local[:, a] -= period * np.rint(local[:, a] / period)
        out[:, 1:] = local
    return out


def _weights(asm: Assembly, material: Elastic, rule: Quadrature) -> FloatArray:
    """Weights in space times λ, (n,)."""
    lam = material.lame(asm, rule.points)[0]
    return rule.weights * lam * np.abs(np.linalg.det(asm.jacobians(rule.points)))


def _add(
    asm: Assembly, material: Elastic, rule: Quadrature, products: FloatArray, masses: FloatArray
) -> None:
    """Add the integrals over a rule."""
    if not len(rule):
        return
    terms = masses.shape[1]
    at = np.searchsorted(asm.space.cells, rule.cells)
    m = polynomials(asm, rule.points, at[rule.owners], terms)
    w = _weights(asm, material, rule)
    np.add.at(masses, at[rule.owners], w[:, None, None] * m[:, :, None] * m[:, None, :])
    for t in range(terms):
        P = (w * m[:, t])[:, None, None] * np.eye(3)
        products[at, :, :, t] += asm.per_cell(rule, None, P)


def _inverses(masses: FloatArray) -> FloatArray:
    """Inverses of symmetric matrices (cells, terms, terms), without directions of no extent."""
    values, vectors = np.linalg.eigh(masses)
    kept = values > THIN * values[:, -1:]
    inverse = np.where(kept, 1.0 / np.where(kept, values, 1.0), 0.0)
    return (vectors * inverse[:, None, :]) @ vectors.transpose(0, 2, 1)
