"""Waves in a periodic solid by splines on cut cells: frequencies over wave vectors, and gaps.

::

    cell = il.Lattice("gyroid", through=il.macroshape.cell(), repeat=1).offset(relative_density=0.3)
    bands = il.homogenize.bloch(cell, cells=12, path="GXMRG", count=8)
    print(bands.gaps, bands.error)
    bands.plot().savefig("bands.png")

A wave u = exp(i k.x) v has a v that repeats with the cell (Bloch, 1929). Its gradient is exp(i k.x)
times grad v + i k v, so that the stiffness is a polynomial of degree two in k with matrices of the
cell that are made once: no unknown has a phase, splines stay smooth over the faces of the cell, and
derivatives by k, which are group velocities, are exact. The mass does not depend on k. Void is
absent, and has no modes. The search at a wave vector starts with the waves of those that are known
(M. Hussein, Reduced Bloch mode expansion for periodic media band structure calculations, 2009), and
its preconditioner is that of the cell without k, made once or twice for all.

Guarantees: matrices are Hermitian; residuals are computed afresh and above `tol` raise
`ConvergenceError`; frequencies come with an estimate of what they are too high because of the
cells. The penalty on jumps at cut cells is that of v. Splines of the highest smoothness jump in
their highest derivatives alone, and there it is, up to a phase, that of u for every k; with less
smoothness it is another penalty that vanishes for what does not jump, as consistent as the first.
Non-guarantees: splines of a finite grid do not have exp(2 pi i x), so that frequencies repeat with
the reciprocal lattice up to `errors` only; islands, whose bands are flat, are left out.
"""

import time
from collections.abc import Iterable
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from scipy.sparse import bsr_array, csr_array

from ilattice._memory import need
from ilattice._progress import Progress, track
from ilattice._typing import FloatArray
from ilattice._validate import as_flag, as_positive, as_whole, read_only
from ilattice.cutfem import _kernels_assembly as kernels
from ilattice.cutfem import coupling, discretization
from ilattice.cutfem.constraints import Constraints
from ilattice.cutfem.material import Property
from ilattice.cutfem.solvers import Solver
from ilattice.errors import ConvergenceError, InputError
from ilattice.homogenize._eigen import GUARD, RANDOM, Pairs, Vectors, lowest
from ilattice.homogenize.bands import Bands, BlochReport
from ilattice.homogenize.elastic import ElasticCell
from ilattice.homogenize.paths import Path, path_of, reciprocal

#: Unknowns up to which a factor is the better preconditioner.
SMALL = 20_000
#: The preconditioner is made anew where its shift is off by this factor.
OFF = 3.0
#: Squares of frequencies below this part of the shift are zero, and relative distances of
#: frequencies that are the same.
ZERO, SAME = 1e-8, 1e-5


@dataclass(frozen=True, eq=False, init=False, repr=False)
class BlochCell(ElasticCell):
    """An elastic cell of a periodic solid, for waves.

    Parameters
    ----------
    field, cells, **options : optional
        As in `bloch`.
    """

    def __init__(self, field: Any, cells: Any = 12, **options: Any) -> None:
        if options.get("dilatation", "full") != "full":
            raise InputError("dilatation must be 'full' for waves; leave it out")
        super().__init__(field, cells, **{**options, "dilatation": "full"})

    @cached_property
    def constraints(self) -> Constraints:
        """Nothing is held."""
        shape = (len(self.assembly.space), 3)
        return Constraints(np.zeros(shape, bool), np.zeros(shape), np.full(shape, -1))

    @cached_property
    def edges(self) -> FloatArray:
        """Edges (3, 3) of the cell as columns."""
        box = np.ptp(self.domain.cut.grid.domain, axis=0)
        return read_only(self._jacobian[0] * box)

    @cached_property
    def masses(self) -> Any:
        """Mass matrix, or `InputError` where there is none."""
        M = self.mass()
        if not M.data.any():
            raise InputError("density: the solid has no mass, and no waves; give it a density")
        return M

    @cached_property
    def inertia(self) -> tuple[float, float]:
        """Integrals of the shear modulus and of the density over the active solid."""
        one = np.tile([1.0, 0.0, 0.0], len(self.assembly.space))
        return self.moments()[1], float(one @ (self.masses @ one))

    # ---------------------------------------------------------------- matrices

    @cached_property
    def _terms(self) -> list[tuple[float, float, FloatArray, FloatArray, FloatArray]]:
        """Lamé constants, and integrals of grad N N, N grad N (blocks, 3), N N (blocks,)."""
        asm, phases, out = self.assembly, self.material.phases, []
        uniform = all(m.constant for m in phases)
        one, only = np.ones((1, 1)), 1 if self.domain.interface is None else 2
        for m, number in zip(phases[:only], range(only), strict=True):
            jets: dict[str, tuple[float, float, FloatArray]] = {}
            for rule in self.domain.stiff_rules(asm, constant=uniform):
                part = self.domain.of_phases(rule)[number]
                lam, mu = m.lame(asm, part.points)
                factors: list[tuple[str, FloatArray, float, float]]
                factors = [("both", one, float(lam[0]), float(mu[0]))]
                if not uniform:
                    lam, mu = (np.broadcast_to(v, len(part))[:, None].copy() for v in (lam, mu))
                    factors = [("lam", lam, 1.0, 0.0), ("mu", mu, 0.0, 1.0)]
                for name, d, p, q in factors:
                    if name not in jets:
                        jets[name] = (p, q, asm.zeros(4))
                    asm.add_cells(jets[name][2], part, kernels.JETS, d)
            for p, q, J in jets.values():
                out.append((p, q, J[:, :3, 3].copy(), J[:, 3, :3].copy(), J[:, 3, 3].copy()))
        return out

    @cached_property
    def _seam(self) -> FloatArray | None:
        """What couples two phases, per direction of k (3, blocks, 3, 3)."""
        if self.assembly.seam is None:
            return None
        data = np.stack([self.assembly.zeros(3) for _ in range(3)])
        coupling.add_waves(data, self)
        return data

    def _linear(self, k: FloatArray) -> FloatArray:
        """Blocks of the real, skew matrix that i times is the linear part of the stiffness."""
        out = np.zeros((len(self.assembly.pattern.indices), 3, 3))
        for lam, mu, a, b, _ in self._terms:
            ak, bk = a[:, :, None] * k, b[:, :, None] * k
            out += lam * (ak - bk.transpose(0, 2, 1)) + mu * (ak.transpose(0, 2, 1) - bk)
            trace = mu * ((a - b) @ k)
            for i in range(3):
                out[:, i, i] += trace
        if self._seam is not None:
            out += np.einsum("j,jbmn->bmn", k, self._seam)
        return out

    def _square(self, k: FloatArray, other: FloatArray) -> FloatArray:
        """Blocks of the quadratic part, as a symmetric function of two vectors."""
        out = np.zeros((len(self.assembly.pattern.indices), 3, 3))
        both = 0.5 * (np.outer(k, other) + np.outer(other, k))
        for lam, mu, _, _, c in self._terms:
            out += c[:, None, None] * ((lam + mu) * both + mu * float(k @ other) * np.eye(3))
        return out

    def stiffness(self, k: FloatArray) -> Any:
        """The Hermitian matrix of a wave vector.

        Parameters
        ----------
        k : ndarray, shape (3,)
            In space.

        Returns
        -------
        bsr_array
            Complex.
        """
        real = self.matrix.data + self._square(k, k)
        return self._blocks(real + 1j * self._linear(k))

    def _blocks(self, data: Any) -> Any:
        K = self.matrix
        return bsr_array((data, K.indices, K.indptr), shape=K.shape)

    def slopes(self, k: FloatArray, x: Vectors) -> Vectors:
        """Products with the derivatives of the matrix by the wave vector.

        Parameters
        ----------
        k : ndarray, shape (3,)
            In space.
        x : ndarray, shape (n, b)
            Vectors.

        Returns
        -------
        ndarray, shape (3, b, b)
            x* dK/dk_j x.
        """
        out = np.empty((3, x.shape[1], x.shape[1]), np.complex128)
        for j, e in enumerate(np.eye(3)):
            D = self._blocks(2.0 * self._square(k, e) + 1j * self._linear(e))
            out[j] = x.conj().T @ (D @ x)
        return out

    # ---------------------------------------------------------------- solving

    def preconditioner(self, shift: float, method: str) -> Solver:
        """Factor or hierarchy of the stiffness without k, and a little of the mass.

        Parameters
        ----------
        shift : float
            What the mass is multiplied by.
        method : str
            As in `bloch`.

        Returns
        -------
        Solver
            Real.
        """
        K = self.matrix
        if method == "auto":
            method = "superlu" if K.shape[0] <= SMALL else "multigrid"
        A = bsr_array((K.data + shift * self.masses.data, K.indices, K.indptr), shape=K.shape)
        system = self.system
        return Solver(A, near_nullspace=system.near_nullspace, method=method, places=system.places)

    def error_of(self, k: FloatArray, pairs: Pairs, count: int, shift: float) -> FloatArray:
        """Estimated parts by which frequencies are too high because of the cells.

        Parameters
        ----------
        k : ndarray, shape (3,)
            In space.
        pairs : Pairs
            Those there.
        count : int
            How many of them.
        shift : float
            Size of squares of frequencies.

        Returns
        -------
        ndarray, shape (count,)
            Relative.
        """
        asm, K = self.assembly, self.stiffness(k)
        levels = self.domain.once(
            ("coarser", asm.space), lambda: discretization.levels(asm.space)
        )  # as `Problem` keeps them
        diagonal = np.tile(self.matrix.diagonal().reshape(-1, 3), 2)

        def multiply(v: FloatArray) -> FloatArray:
            w = K @ (v[:, :3] + 1j * v[:, 3:]).ravel()
            return np.concatenate([w.real.reshape(-1, 3), w.imag.reshape(-1, 3)], axis=1)

        out = np.zeros(count)
        for n in range(count):
            if pairs.values[n] <= ZERO * shift:
                continue
            v = pairs.vectors[:, n].reshape(-1, 3)
            c = np.concatenate([v.real, v.imag], axis=1)
            jumps = asm.ghost_energy(c, self._ghost_stiffness)
            held, energy = np.zeros(c.shape, bool), float(pairs.values[n])
            out[n] = 0.5 * discretization.relative_error(
                levels, multiply, diagonal, c, held, energy, jumps
            )
        return out


class _Search:
    """Lowest pairs at wave vectors, one after the other, with what was found before."""

    def __init__(self, cell: BlochCell, count: int, method: str, tol: float, most: int) -> None:
        self.cell, self.count, self.tol, self.most, self.method = cell, count, tol, most, method
        mu, mass = cell.inertia
        self.shift = mu / mass * np.pi**2 * cell.cell_volume ** (-2 / 3)
        self.solver = cell.preconditioner(self.shift, method)
        M = cell.masses
        self.inert = csr_array(
            (M.data[:, 0, 0].copy(), M.indices, M.indptr), shape=(M.shape[0] // 3,) * 2
        )
        self.random = np.random.default_rng(0)

    def at(self, k: FloatArray, known: Iterable[Vectors], fresh: int) -> Pairs:
        """Pairs at one wave vector, from known vectors and some random ones."""
        n = self.cell.masses.shape[0]
        noise = self.random.standard_normal((n, fresh)) + 1j * self.random.standard_normal(
            (n, fresh)
        )
        start = np.concatenate([self.precondition(self.mass(noise)), *known], axis=1)
        K = self.cell.stiffness(k)
        pairs = lowest(
            K, self.mass, self.precondition, start, self.count, self.shift, self.tol, self.most
        )
        worst = float(pairs.residuals[: self.count].max())
        if not worst <= self.tol:
            raise ConvergenceError(
                f"bands at k = {np.round(k, 4).tolist()} have a residual of {worst:.1e} after "
                f"{pairs.steps} steps, above tol = {self.tol:.1e}; allow more max_iterations, ask "
                "for another count, or give method='superlu'"
            )
        self._adapt(float(pairs.values[self.count - 1]))
        return pairs

    def _adapt(self, largest: float) -> None:
        """Make the preconditioner anew if it is far from the frequencies asked for."""
        if largest > ZERO * self.shift and not 1 / OFF <= largest / self.shift <= OFF:
            self.shift = largest
            self.solver = self.cell.preconditioner(self.shift, self.method)

    def mass(self, x: Vectors) -> Vectors:
        """Mass times vectors (n, k): the same for all components, and real."""
        flat = np.ascontiguousarray(x).view(np.float64).reshape(len(x) // 3, -1)
        return np.asarray((self.inert @ flat).reshape(len(x), -1).view(np.complex128))

    def precondition(self, r: Vectors) -> Vectors:
        """Apply it to real and imaginary parts, all together."""
        out = self.solver.precondition(np.concatenate([r.real, r.imag], axis=1))
        count = r.shape[1]
        return np.asarray(out[:, :count] + 1j * out[:, count:])


def bloch(
    field: Any, cells: Any = 12, *, path: Any = "GXMRG", count: int = 8, steps: int = 8,
    system: str | None = None, young: Property = 1.0, poisson: Property = 0.3,
    density: Property = 1.0, method: str = "auto", tol: float = 1e-5, max_iterations: int = 200,
    modes: bool = False, progress: Progress = None, **options: Any,
) -> Bands:  # fmt: skip
    """Frequencies of waves in a periodic solid, over a path of wave vectors.

    Parameters
    ----------
    field, cells : object
        The solid in one cell, and the background grid, as in `elastic`.
    path : str or array_like, shape (m, 3), keyword-only
        Points of symmetry by their letters, such as ``"GXMRG"`` for cubic cells, ``"GXMGZRAZ"`` for
        tetragonal and ``"GMKGALHA"`` for hexagonal ones; or corners in parts of the edges of the
        reciprocal lattice.
    count : int, keyword-only
        Number of bands.
    steps : int, keyword-only
        From a corner of the path to the next one; 1 for the corners alone.
    system : {"cubic", "tetragonal", "orthorhombic", "hexagonal", "triclinic"}, optional
        Whose letters `path` has; by default by the edges of the cell.
    young, poisson, density : float, str or callable, keyword-only
        As in `ilattice.cutfem.Elasticity`, also pairs for two `phases`.
    method : str, keyword-only
        Of the preconditioner, as in `ilattice.cutfem.Solver`.
    tol : float, keyword-only
        Largest residual of a pair, see `Bands.residuals`; frequencies are right to about its
        square.
    max_iterations : int, keyword-only
        Steps at one wave vector.
    modes : bool, keyword-only
        Whether waves are kept for `Bands.mode`.
    progress : bool or callable, keyword-only
        Wave vectors; see `ilattice._progress.track`.
    **options
        As in `elastic`, but for ``dilatation``.

    Returns
    -------
    Bands
        Frequencies, group velocities, gaps.

    Raises
    ------
    InputError
        If an argument is wrong, or the field does not repeat: the message tells the largest jump.
    GeometryError
        If there is no solid.
    ConvergenceError
        If the tolerance is not reached.

    Warns
    -----
    PrecisionWarning
        If islands were left out, or the square of a frequency is off by more than 2 %, by estimate.

    Examples
    --------
    >>> import ilattice as il
    >>> solid = il.fields.box(2.0)  # a full cell: waves of one speed
    >>> way = [[0, 0, 0], [0.25, 0, 0]]
    >>> bands = il.homogenize.bloch(solid, 6, path=way, count=3, steps=2, poisson=0.25)
    >>> (bands.omega[1:] / bands.omega[1, 0]).round(4)
    array([[1.    , 1.    , 1.7321],
           [2.    , 2.    , 3.4641]])
    """
    begin = time.perf_counter()
    count = as_whole("count", count, 1, 500)
    steps = as_whole("steps", steps, 1, 10_000)
    most, tol = as_whole("max_iterations", max_iterations, 1, 10**6), as_positive("tol", tol)
    modes = as_flag("modes", modes)
    cell = BlochCell(field, cells, young=young, poisson=poisson, density=density, **options)
    way = path_of(path, cell.edges, steps, system)
    unknowns = 3 * len(cell.assembly.space)
    if unknowns < 3 * (count + GUARD):
        raise InputError(
            f"count = {count} is too many for {unknowns} unknowns: ask for fewer, or take more "
            "cells"
        )
    kept = 16.0 * unknowns * (len(way.fractions) * modes + 12) * (count + GUARD)
    need(kept, f"{count} waves of {unknowns} unknowns", "use fewer cells, or a smaller count")
    search = _Search(cell, count, method, tol, most)
    found = _along(search, way, cell, progress)
    return _bands(search, way, found, modes, begin)


def _along(search: _Search, way: Path, cell: BlochCell, progress: Progress) -> list[Pairs]:
    """Pairs at all wave vectors: first those of corners, then what is between them."""
    k = way.fractions @ reciprocal(cell.edges).T
    names = [tuple(np.round(f, 12).tolist()) for f in way.fractions]
    corners = dict.fromkeys(names[c] for c in way.corners)
    order = sorted(range(len(k)), key=lambda i: (names[i] not in corners, i))
    out: dict[tuple[float, ...], Pairs] = {}
    for i in track(order, "bands", progress):
        if names[i] in out:
            continue
        if names[i] in corners:
            known, fresh = [p.vectors for p in list(out.values())[-2:]], search.count + GUARD
        else:
            after = int(np.searchsorted(way.corners, i))
            near = dict.fromkeys(
                (names[way.corners[after - 1]], names[way.corners[after]], names[i - 1])
            )
            known, fresh = [out[name].vectors for name in near], RANDOM
        out[names[i]] = search.at(k[i], known, fresh)
    return [out[name] for name in names]


def _bands(search: _Search, way: Path, found: list[Pairs], modes: bool, begin: float) -> Bands:
    """What is told of all pairs."""
    cell, count = search.cell, search.count
    k = way.fractions @ reciprocal(cell.edges).T
    tangents = np.diff(k, axis=0, append=k[-1:] + (k[-1:] - k[-2:-1] if len(k) > 1 else 1.0))
    made: dict[int, tuple[FloatArray, Vectors]] = {}
    velocities, vectors = [], []
    for i, pairs in enumerate(found):
        key = id(pairs)
        if key not in made:
            made[key] = _velocities(search, k[i], tangents[i], pairs)
        velocities.append(made[key][0])
        vectors.append(made[key][1])
    far = max(way.corners.tolist(), key=lambda c: float(np.linalg.norm(k[c])))
    errors = cell.error_of(k[far], found[far], count, search.shift)
    discretization.warn(2.0 * float(errors.max()), "the square of a frequency", cell.assembly.space)
    mu, mass = cell.inertia
    values = np.stack([p.values[:count] for p in found])
    report = BlochReport(
        cell.domain.cut.grid.shape, cell.matrix.shape[0], search.solver.method,
        read_only(np.array([p.steps for p in found])), time.perf_counter() - begin,
    )  # fmt: skip
    return Bands(
        k, way.fractions, way.corners, way.labels, np.sqrt(np.maximum(values, 0.0)),
        np.stack(velocities), np.stack([p.residuals[:count] for p in found]), errors,
        float(cell.cell_volume ** (1 / 3)), float(np.sqrt(mu / mass)), report,
        cell, vectors if modes else None,
    )  # fmt: skip


def _velocities(
    search: _Search, k: FloatArray, along: FloatArray, pairs: Pairs
) -> tuple[FloatArray, Vectors]:
    """Group velocities (count, 3), and waves that keep apart along a direction."""
    count, values = search.count, pairs.values
    omega = np.sqrt(np.maximum(values, 0.0))
    last = count
    while last < len(values) and omega[last] - omega[count - 1] <= SAME * omega[last]:
        last += 1  # all of a group that the count cuts
    x, slopes = pairs.vectors[:, :last].copy(), search.cell.slopes(k, pairs.vectors[:, :last])
    starts = np.flatnonzero(np.append(True, np.diff(omega[:last]) > SAME * omega[1:last]))
    turned = np.eye(last, dtype=np.complex128)
    for a, b in zip(starts, np.append(starts[1:], last), strict=True):
        one = np.einsum("j,jab->ab", along, slopes[:, a:b, a:b])
        turned[a:b, a:b] = np.linalg.eigh(0.5 * (one + one.conj().T))[1]
    x = x @ turned
    diagonal = np.einsum("na,jnm,ma->aj", turned.conj(), slopes, turned).real[:count]
    moving = values[:count] > ZERO * search.shift
    half = np.where(moving, 0.5 / np.where(moving, omega[:count], 1.0), np.nan)
    return diagonal * half[:, None], x[:, :count]
