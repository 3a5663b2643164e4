"""Waves in a periodic solid by splines on cut cells: frequencies over wave vectors, and gaps.

::

    cell = il.Lattice("gyroid", through=il.macroshape.cell(), repeat=1).offset(relative_density=0.3)
    bands = il.homogenize.bloch(cell, cells=12, path="GXMRG", count=8)
    print(bands.gaps, bands.error)
    bands.plot().savefig("bands.png")

Matrices are those of `BlochCell`: void is absent, and has no modes; group velocities are exact
derivatives. Waves of some wave vectors are searched for with a preconditioner that is that of the
cell without k, made once or twice for all, and found as combinations of these at the others (see
`_search`).

Guarantees: residuals are computed afresh at every wave vector, and above `tol` raise
`ConvergenceError`; frequencies come with an estimate of what they are too high because of the
cells, from fewer cells (see `_estimate`). Non-guarantees: splines of a finite grid do not have
exp(2 pi i x), so that frequencies repeat with the reciprocal lattice up to `errors` only; islands,
whose bands are flat, are left out.
"""

import time
import warnings
from typing import Any

import numpy as np

from ilattice._memory import need
from ilattice._progress import Progress
from ilattice._typing import AnyArray, FloatArray
from ilattice._validate import as_flag, as_positive, as_whole, read_only
from ilattice.cutfem.discretization import WARNED
from ilattice.cutfem.elasticity import Elasticity
from ilattice.cutfem.material import Property
from ilattice.errors import InputError, PrecisionWarning
from ilattice.homogenize._eigen import GUARD, MAX_VECTORS, Pairs, Vectors
from ilattice.homogenize._estimate import estimated, outside
from ilattice.homogenize._matching import farthest, overlaps
from ilattice.homogenize._reduced import FULL
from ilattice.homogenize._search import Search
from ilattice.homogenize.arguments import check_options
from ilattice.homogenize.bands import Bands, BlochReport
from ilattice.homogenize.paths import Path, path_of, reciprocal
from ilattice.homogenize.waves import BlochCell

#: Relative distances of frequencies that are the same.
SAME = 1e-5
#: Points of a cell at which its waves are compared with those of others.
POINTS = 4000
#: Between which `tol` must be: frequencies are right to about its square.
MIN_TOL, MAX_TOL = 1e-12, 0.1


def bloch(
    field: Any, cells: Any = 12, *, path: Any = "GXMRG", count: int = 8, steps: int = 8,
    system: str | None = None, young: Property | None = None, poisson: Property | None = None,
    density: Property = 1.0, method: str = "auto", tol: float = 1e-4, max_iterations: int = 200,
    modes: bool = False, progress: Progress = None, **options: Any,
) -> Bands:  # fmt: skip
    """Frequencies of waves in a periodic solid, over a path of wave vectors.

    Parameters
    ----------
    field, cells : object
        The solid in one cell, and the background grid, as in `elastic`.
    path : str or array_like, shape (m, 3), keyword-only
        Points of symmetry by their letters, such as ``"GXMRG"`` for cubic cells, ``"GXWKGLU"`` for
        primitive cells of face-centred and ``"GHNGP"`` of body-centred cubic lattices,
        ``"GXMGZRAZ"`` for tetragonal and ``"GMKGALHA"`` for hexagonal ones; or corners in parts of
        the edges of the reciprocal lattice.
    count : int, keyword-only
        Number of bands.
    steps : int, keyword-only
        From a corner of the path to the next one; 1 for the corners alone.
    system : str, optional
        Whose letters `path` has: ``"cubic"``, ``"fcc"``, ``"bcc"``, ``"tetragonal"``,
        ``"orthorhombic"`` or ``"hexagonal"``, as far as the edges of the cell make it up, by
        default with the most symmetries; ``"triclinic"`` names halves of the edges of any
        reciprocal lattice.
    young, poisson, density : float, str or callable, keyword-only
        As in `ilattice.cutfem.Elasticity`, also pairs for two `phases`; or ``stiffness`` and
        ``axes`` instead, likewise.
    method : str, keyword-only
        Of the preconditioner, as in `ilattice.cutfem.Solver`.
    tol : float, keyword-only
        Largest residual of a pair, see `Bands.residuals`; frequencies are right to about its
        square, relative to themselves, as far as rounding allows, group velocities to itself.
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
        If islands were left out, or the square of a frequency is off by more than 2 %, by estimate
        or by rounding.

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
    most, tol = as_whole("max_iterations", max_iterations, 1, 10**6), as_residual(tol)
    modes = as_flag("modes", modes)
    check_options("bloch", options, Elasticity.__init__)
    cell = BlochCell(field, cells, young=young, poisson=poisson, density=density, **options)
    way = path_of(path, cell.edges, steps, system)
    unknowns = 3 * len(cell.assembly.space)
    if unknowns < 3 * (count + GUARD):
        raise InputError(
            f"count = {count} is too many for {unknowns} unknowns: ask for fewer, or take more "
            "cells"
        )
    kept = 16.0 * unknowns * ((len(way.fractions) + MAX_VECTORS) * (count + GUARD) + FULL)
    kept += 5 * 72.0 * len(cell.matrix.indices)  # blocks of one wave vector and by axes
    need(kept, f"{count} waves of {unknowns} unknowns", "use fewer cells, or a smaller count")
    search = Search(cell, count, method, tol, most)
    return _bands(search, way, search.along(way.reduced(), progress), modes, begin)


def as_residual(tol: Any) -> float:
    """Largest residual of a pair, of which frequencies still are right to a per cent."""
    out = as_positive("tol", tol)
    if not MIN_TOL <= out <= MAX_TOL:
        raise InputError(f"tol must be between {MIN_TOL:g} and {MAX_TOL:g}, got {tol!r:.80}")
    return out


def _bands(search: Search, way: Path, found: list[Pairs], modes: bool, begin: float) -> Bands:
    """What is told of all pairs."""
    cell, count = search.cell, search.count
    inner = way.reduced()
    k, zone = (p.fractions @ reciprocal(cell.edges).T for p in (way, inner))
    tangents = np.diff(k, axis=0, append=k[-1:] + (k[-1:] - k[-2:-1] if len(k) > 1 else 1.0))
    made: dict[int, tuple[FloatArray, Vectors]] = {}
    velocities, vectors = [], []
    for i, pairs in enumerate(found):
        key = id(pairs)
        if key not in made:
            made[key] = velocities_of(search, zone[i], tangents[i], pairs)
        velocities.append(made[key][0])
        vectors.append(made[key][1])
    errors = _errors(search, [(zone[c], found[c]) for c in distinct(inner)])
    lost = rounded(found, inner, count)
    cell.warn_of_error(2.0 * float(errors.max()), "the square of a frequency")
    warn_of_rounding(lost)
    mu, mass = cell.inertia
    report = BlochReport(
        cell.domain.cut.grid.shape, cell.matrix.shape[0], search.solver.method,
        read_only(np.array([p.steps for p in found])), time.perf_counter() - begin,
    )  # fmt: skip
    return Bands(
        k, way.fractions, way.corners, way.labels, frequencies(found, inner, count),
        np.stack(velocities), np.stack([p.residuals[:count] for p in found]),
        errors + lost,
        float(cell.cell_volume ** (1 / 3)), float(np.sqrt(mu / mass)), report,
        cell, vectors if modes else None,
    )  # fmt: skip


def distinct(way: Path) -> list[int]:
    """Corners of a path, each wave vector once."""
    names = {tuple(np.round(way.fractions[c], 12).tolist()): c for c in way.corners.tolist()}
    return list(names.values())


def frequencies(found: list[Pairs], way: Path, count: int) -> FloatArray:
    """Angular frequencies (n, count), zero where they are next to it at rest."""
    values = np.stack([np.maximum(p.values[:count], 0.0) for p in found])
    moving = np.stack([p.moving(count) for p in found])
    return np.where(moving | ~_resting(way)[:, None], np.sqrt(values), 0.0)


def _resting(way: Path) -> AnyArray:
    """Which wave vectors are none, up to edges of the reciprocal lattice."""
    return np.asarray((way.fractions == np.rint(way.fractions)).all(axis=1))


def rounded(found: list[Pairs], way: Path, count: int) -> FloatArray:
    """Largest parts (count,) of frequencies that rounding leaves, 1 where it hides them."""
    parts = [p.lost(count, bool(r)) for p, r in zip(found, _resting(way), strict=True)]
    return np.asarray(0.5 * np.max(parts, axis=0))


def warn_of_rounding(lost: FloatArray) -> None:
    """Warn of frequencies that rounding leaves little of."""
    much = 2.0 * float(lost.max())
    if much > WARNED:
        told = f"about {100 * much:.2g} %" if much < 1.0 else "all"
        warnings.warn(
            f"rounding leaves {told} of the square of a frequency open: that of band "
            f"{int(lost.argmax()) + 1} is next to nothing against the largest of the grid; take "
            "longer wave vectors, phases or edges of cells that differ by less, and no pieces that "
            "nothing holds",
            PrecisionWarning,
            stacklevel=outside(),
        )


def _errors(search: Search, corners: list[tuple[FloatArray, Pairs]]) -> FloatArray:
    """Estimated parts (count,) by which frequencies are too high because of the cells.

    The largest of some wave vectors and their pairs.
    """
    count, u = search.count, _samples(search.cell)
    waves = [search.sampled(pairs, count, u) for _, pairs in corners]

    def squares(cell: BlochCell, tol: float) -> FloatArray:
        other, out = Search(cell, count, search.method, tol, search.most), []
        for (k, pairs), fine in zip(corners, waves, strict=True):
            found = other.at(k)
            coarse = other.sampled(found, len(found.values), u)
            known = np.isfinite(fine).all(axis=0) & np.isfinite(coarse).all(axis=0)
            shares = overlaps(fine[:, known], coarse[:, known])
            out.append(farthest(pairs.values[:count], found.values, shares))
        return np.concatenate(out)

    there = np.concatenate([pairs.moving(count) for _, pairs in corners])
    values = np.concatenate([pairs.values[:count] for _, pairs in corners])
    off = estimated(search.cell, values, squares, search.tol)
    part = np.where(there, 0.5 * off / np.where(there, values, 1.0), 0.0)
    return np.asarray(part.reshape(-1, count).max(axis=0) + 0.5 * search.cell.unfollowed)


def _samples(cell: BlochCell) -> FloatArray:
    """Parameters of points spread over the solid, as far as there is enough of it."""
    cut = cell.domain.cut
    lo, hi = cut.grid.domain
    u = lo + (hi - lo) * np.random.default_rng(0).random((POINTS, 3))
    inside = (cut.sets(u) < 0.0).all(axis=1)
    return u[inside][: POINTS // 4] if inside.any() else u


def velocities_of(
    search: Any, k: FloatArray, along: FloatArray, pairs: Pairs
) -> tuple[FloatArray, Vectors]:
    """Group velocities (count, 3), and waves that keep apart along a direction."""
    count, values = search.count, pairs.values
    omega = np.sqrt(np.maximum(values, 0.0))
    last = count
    while last < len(values) and omega[last] - omega[count - 1] <= SAME * omega[last]:
        last += 1  # all of a group that the count cuts
    x = pairs.vectors[:last]
    slopes = search.slopes(k, x)
    starts = np.flatnonzero(np.append(True, np.diff(omega[:last]) > SAME * omega[1:last]))
    turned = np.eye(last, dtype=np.complex128)
    for a, b in zip(starts, np.append(starts[1:], last), strict=True):
        one = np.einsum("j,jab->ab", along, slopes[:, a:b, a:b])
        turned[a:b, a:b] = np.linalg.eigh(0.5 * (one + one.conj().T))[1]
    x = x.T @ turned
    diagonal = np.einsum("na,jnm,ma->aj", turned.conj(), slopes, turned).real[:count]
    moving = pairs.moving(count)
    half = np.where(moving, 0.5 / np.where(moving, omega[:count], 1.0), np.nan)
    return diagonal * half[:, None], x[:, :count]
