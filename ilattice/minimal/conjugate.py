"""Minimal surfaces that meet the faces of a region at right angles, by conjugation.

The sides of such a surface lie in mirrors, those of its dual are straight, along the normals of
the mirrors: a polygon whose lengths of sides are known up to N - 3 numbers. For given lengths the
dual is a Plateau problem, and its conjugate one linear solve. Scale and position are linear; the
N - 4 numbers that are left are found by Newton's method with Broyden's updates.

Guarantees: what is returned meets the planes of all faces, lies in the region, and has a mean
curvature that vanishes; else a `ConvergenceError` or `GeometryError` says why. Non-guarantee:
where several surfaces meet the same faces, which one is found.
"""

from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from scipy.linalg import null_space

from ilattice._typing import FloatArray
from ilattice._validate import read_only
from ilattice.errors import ConvergenceError, GeometryError, InputError
from ilattice.minimal.disc import Disc, area, cotangents
from ilattice.minimal.patch import MinimalPatch, Report, made
from ilattice.minimal.plateau import Motion, Solved, factorized, fair_step, stationary
from ilattice.minimal.region import FaceLoop

#: Edges per side with which lengths are searched, before they are polished with those asked for.
COARSE = 6
MOST_STARTS = 4
#: Most Plateau problems of one search.
MOST_EVALUATIONS = 250
#: Mean curvature times size that all but a twentieth of the vertices keep below.
MOST_CURVATURE = 3.0
_MOST_STEPS = 20
_CLOSED = 1e-9
_STEP = 1e-4
#: Relative change of a length from which on a surface is solved for from nothing.
_FAR = 0.2


def conjugate(faces: FaceLoop, n: int = 16) -> MinimalPatch:
    """Minimal surface that meets faces of a region at right angles, in a given order.

    Parameters
    ----------
    faces : FaceLoop
        Faces in cyclic order, as ``il.minimal.cuboid().faces("x+ z- y+ x- z+ y-")``; a face may
        come several times.
    n : int
        Edges per side, at least 2. Vertices are off by some 0.01 / n² of the cell.

    Returns
    -------
    MinimalPatch
        The surface in the region; its `completed` is periodic.

    Raises
    ------
    InputError
        If `faces` is no `FaceLoop`, or `n` is too small or too large.
    ConvergenceError
        If no lengths of the sides were found with which the surface meets all planes.
    GeometryError
        If the surface that meets all planes is not in the region.

    Examples
    --------
    >>> from ilattice.minimal import cuboid
    >>> octant = conjugate(cuboid().faces("x+ z- y+ x- z+ y-"), n=8)
    >>> round(8 * octant.area, 2)
    2.35
    """
    if not isinstance(faces, FaceLoop):
        raise InputError(
            f"faces must be a FaceLoop, as region.faces('x+ z- ...') makes it, got {faces!r:.80}"
        )
    disc = Disc.checked(len(faces), n)
    search = _Search(faces)
    reasons: list[Exception] = []
    for start in search.starts():
        try:
            return search.found(start, disc)
        except (ConvergenceError, GeometryError) as e:
            reasons.append(e)
    raise search.refusal(reasons)


def conjugated(v: FloatArray, disc: Disc) -> FloatArray:
    """The conjugate of a minimal disc: every tangent plane is turned by 90 degrees.

    Parameters
    ----------
    v : (V, 3) array
        Vertices of a minimal surface.
    disc : Disc
        Its triangles.

    Returns
    -------
    (V, 3) array
        Vertices of the conjugate; the centre lies at the origin.
    """
    loop = v[disc.boundary :]
    flux = np.zeros_like(v)
    flux[disc.boundary :] = 0.5 * (np.roll(loop, 1, axis=0) - np.roll(loop, -1, axis=0))
    x = np.zeros_like(v)
    x[1:] = factorized(cotangents(v, disc.faces)[1:, 1:]).solve(flux[1:])
    return x


class _Placed(NamedTuple):
    """A dual disc, its conjugate, and how that is scaled and moved to the planes."""

    dual: Solved
    x: FloatArray
    scale: float
    shift: FloatArray
    gaps: FloatArray


class _Base(NamedTuple):
    """A dual surface from which others start, so that these depend smoothly on the lengths."""

    lengths: FloatArray
    vertices: FloatArray
    directions: FloatArray
    rows: Any
    factors: Any

    @classmethod
    def of(cls, lengths: FloatArray, v: FloatArray, disc: Disc, motion: Motion) -> "_Base":
        """The surface with its normals, and the factors that carry moves of the boundary on."""
        rows = cotangents(v, disc.faces)[: disc.boundary]
        factors = factorized(rows[:, : disc.boundary])
        return cls(lengths, v, motion.directions(v, disc.faces), rows, factors)

    def moved(self, v: FloatArray, boundary: int) -> FloatArray:
        """The surface with the boundary of another one, which pulls the inside along."""
        shift = np.zeros_like(v)
        shift[boundary:] = v[boundary:] - self.vertices[boundary:]
        shift[:boundary] = -self.factors.solve(self.rows @ shift)
        return self.vertices + shift


@dataclass(eq=False)
class _Search:
    """The lengths of the sides with which the conjugate meets all planes."""

    faces: FaceLoop

    def __post_init__(self) -> None:
        m = self.faces.normals
        self.size = self.faces.region.size
        self.free = null_space(np.vstack([m.T, np.ones(len(m))]), rcond=1e-9)
        self.factorizations = 0
        self.evaluations = 0
        self.level(Disc(len(m), COARSE))

    def level(self, disc: Disc) -> None:
        """Take another resolution."""
        self.disc = disc
        self.motion = Motion.inside(disc.count, disc.boundary)
        self.base: _Base | None = None

    # ---------------------------------------------------------------- one shape

    def placed(self, lengths: FloatArray) -> _Placed:
        """The surface of given lengths, moved and scaled to fit the planes as well as it can."""
        disc, m, d = self.disc, self.faces.normals, self.faces.offsets
        dual = self.dual(lengths)
        self.evaluations += 1
        x = conjugated(dual.vertices, disc)
        self.factorizations += dual.factorizations + 1
        heights = np.einsum("snc,sc->sn", x[disc.side_rows], m)
        means = (heights.sum(axis=1) - 0.5 * (heights[:, 0] + heights[:, -1])) / disc.n
        system = np.column_stack([means, m])
        fitted = np.linalg.lstsq(system, d, rcond=None)[0]
        gaps = system @ fitted - d
        return _Placed(dual, x, float(fitted[0]), fitted[1:], gaps)

    def dual(self, lengths: FloatArray) -> Solved:
        """The dual surface: from nothing, or by moving that of lengths nearby along its normals."""
        disc, faces = self.disc, self.disc.faces
        corners = np.cumsum(-lengths[:, None] * self.faces.normals, axis=0)
        v = disc.fan(np.zeros(3), np.roll(corners, 1, axis=0) - corners.mean(axis=0))
        if self.base is None:
            v = fair_step(v, self.motion, cotangents(disc.flat, faces))
            self.factorizations += 1
            return stationary(v, faces, self.motion, what="the dual surface")
        start = self.base.moved(v, disc.boundary)
        told = "the dual surface"
        return stationary(start, faces, self.motion, what=told, directions=self.base.directions)

    def rebased(self, lengths: FloatArray) -> _Placed:
        """The surface of given lengths, from nothing, as one that others start from."""
        self.base = None
        dual = self.dual(lengths)
        self.factorizations += dual.factorizations + 1
        self.base = _Base.of(lengths, dual.vertices, self.disc, self.motion)
        return self.placed(lengths)

    # ---------------------------------------------------------------- the search

    def starts(self) -> Any:
        """Lengths to start from: the most balanced ones, then random ones."""
        yield self.faces.balance
        if self.free.shape[1] == 0:
            return
        rng = np.random.default_rng(len(self.faces))
        lengths = self.faces.balance
        for _ in range(MOST_STARTS - 1):
            for _ in range(4):
                along = self.free @ rng.normal(size=self.free.shape[1])
                low = (-lengths[along > 0] / along[along > 0]).max()
                high = (-lengths[along < 0] / along[along < 0]).min()
                lengths = lengths + rng.uniform(0.9 * low, 0.9 * high) * along
            yield lengths

    def found(self, start: FloatArray, disc: Disc) -> MinimalPatch:
        """The surface that is reached from some lengths."""
        lengths, jacobian = start, None
        if self.free.shape[1] == 0:
            self.level(disc)
            return self.checked(lengths, self.placed(lengths))
        for n in sorted({min(COARSE, disc.n), disc.n}):
            self.level(Disc(disc.sides, n))
            lengths, jacobian, best = self.closed(lengths, jacobian)
        return self.checked(lengths, best)

    def closed(
        self, lengths: FloatArray, jacobian: FloatArray | None
    ) -> tuple[FloatArray, FloatArray | None, _Placed]:
        """Newton's method for the lengths, with the Jacobian brought up to date by Broyden."""
        best = self.rebased(lengths)
        base = lengths
        for _ in range(_MOST_STEPS if self.evaluations < MOST_EVALUATIONS else 0):
            size = float(np.linalg.norm(best.gaps))
            if size <= _CLOSED * self.size:
                return lengths, jacobian, best
            fresh = jacobian is None
            if jacobian is None:
                jacobian = self.slopes(lengths, best)
            step = self.free @ -np.linalg.lstsq(jacobian, best.gaps, rcond=1e-8)[0]
            trial = self.tried(lengths, step, size)
            if trial is None:
                if fresh:
                    break
                jacobian = None
                continue
            t, new = trial
            z = self.free.T @ (t * step)
            change = new.gaps - best.gaps
            slow = float(np.linalg.norm(new.gaps)) > 0.3 * size
            jacobian = None if slow else jacobian + np.outer(change - jacobian @ z, z) / (z @ z)
            lengths, best = lengths + t * step, new
            if np.abs(lengths / base - 1.0).max() > _FAR:
                base, best = lengths, self.rebased(lengths)
        raise ConvergenceError(
            f"no lengths of the sides close the surface {self.faces!r}: its sides are up to "
            f"{np.abs(best.gaps).max():.3g} off their planes in a region of size {self.size:.3g}"
        )

    def slopes(self, lengths: FloatArray, best: _Placed) -> FloatArray:
        """Changes of the gaps with the free numbers, by differences."""
        columns = []
        for column in self.free.T:
            h = _STEP * float(lengths.min()) / float(np.abs(column).max())
            columns.append((self.placed(lengths + h * column).gaps - best.gaps) / h)
        return np.stack(columns, axis=1)

    def tried(self, lengths: FloatArray, step: FloatArray, size: float) -> tuple[float, Any] | None:
        """Part of a step that brings the sides closer to their planes, lengths staying positive."""
        shrinking = step < 0.0
        room = float((-lengths[shrinking] / step[shrinking]).min()) if shrinking.any() else np.inf
        t = min(1.0, 0.7 * room)
        for _ in range(4):
            try:
                new = self.placed(lengths + t * step)
            except ConvergenceError:
                new = None
            if new is not None and np.linalg.norm(new.gaps) < (1.0 - 0.1 * t) * size:
                return t, new
            t *= 0.4
        return None

    # ---------------------------------------------------------------- the result

    def checked(self, lengths: FloatArray, best: _Placed) -> MinimalPatch:
        """The surface with its sides in the planes, or the reason why it is none."""
        told = f"the surface {self.faces!r}"
        if not best.scale > 0.0:
            raise GeometryError(
                f"{told} would lie on the outer side of its faces: no surface within the region "
                "meets them in this order"
            )
        x = best.scale * best.x + best.shift
        snapped, gap = self.snapped(x)
        if gap > 0.03 * self.size:
            raise ConvergenceError(
                f"{told} is off its planes by up to {gap:.3g} in a region of size {self.size:.3g}: "
                f"take more edges per side than n={self.disc.n}"
            )
        partner = -best.scale * best.dual.vertices
        distortion = area(snapped, self.disc.faces) / area(partner, self.disc.faces) - 1.0
        if abs(distortion) > 0.1:
            raise ConvergenceError(
                f"{told} and its dual differ in area by {abs(distortion):.2%}, where they are "
                f"equal: take more edges per side than n={self.disc.n}"
            )
        region = self.faces.region
        out = float((snapped @ region.normals.T - region.offsets).max())
        if out > max(4.0 * gap, 1e-3 * self.size):
            raise GeometryError(
                f"{told} leaves the region by {out:.3g}, through a face that it does not name "
                "there: no surface within the region meets the faces in this order"
            )
        report = Report(
            kind="conjugate",
            residual=best.dual.residual,
            factorizations=self.factorizations,
            evaluations=self.evaluations,
            lengths=read_only(best.scale * lengths),
            gap=gap,
            distortion=distortion,
        )
        symmetry = (region.mirrors, region.cell)
        patch = made(snapped, self.disc, partner, report, symmetry=symmetry, what=told)
        bent = float(np.quantile(np.abs(patch.mean_curvature[: self.disc.boundary]), 0.95))
        if bent * self.size > MOST_CURVATURE:
            raise ConvergenceError(
                f"{told} is not minimal: its mean curvature times size is {bent * self.size:.3g}; "
                f"take more edges per side than n={self.disc.n}"
            )
        return patch

    def snapped(self, x: FloatArray) -> tuple[FloatArray, float]:
        """Sides moved into their planes, and how far that was."""
        out, m, d = x.copy(), self.faces.normals, self.faces.offsets
        rows = self.disc.side_rows
        for s, side in enumerate(rows):
            out[side[1:-1]] -= np.outer(out[side[1:-1]] @ m[s] - d[s], m[s])
            pair = m[[s - 1, s]]
            off = pair @ out[side[0]] - d[[s - 1, s]]
            out[side[0]] -= np.linalg.lstsq(pair, off, rcond=None)[0]
        moved = np.linalg.norm(out - x, axis=1)
        return out, float(moved.max())

    def refusal(self, reasons: list[Exception]) -> Exception:
        """The most telling of several reasons: geometry over numbers."""
        for reason in reasons:
            if isinstance(reason, GeometryError):
                return reason
        last = reasons[0]
        return type(last)(f"{last} (from {len(reasons)} starts)")
