"""Lengths of the sides of a dual polygon with which the conjugate surface meets given planes.

The sides of the dual polygon run along the normals of the planes. For given lengths the dual is a
Plateau problem, and its conjugate one linear solve; scale and position are linear. So the lengths,
with their sum kept, are N - 4 unknowns of as many equations.

Newton's method with Broyden's updates solves these from a good start. From a bad one the surface
is followed: whatever the lengths are, their surface meets planes of the same normals, only with
other offsets; these are moved to where they should be, and the surface goes with them.

Guarantee: what `Closing.closed` returns meets the planes on average over each side, up to rounding.
Non-guarantees: a surface that is not found may exist; which of several is found.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from scipy.linalg import null_space

from ilattice._typing import FloatArray
from ilattice.errors import ConvergenceError
from ilattice.minimal.disc import Disc, cotangents, unit_rows, vertex_normals
from ilattice.minimal.plateau import Motion, Solved, factorized, fair_step, stationary
from ilattice.minimal.region import FaceLoop

#: Edges per side with which lengths are searched, before they are polished with those asked for.
COARSE = 6
#: Polygons that are looked at for each unknown, from how many Newton starts, how many are followed.
SURVEY, MAX_NEWTON, MAX_FOLLOWED = 20, 4, 4
#: Most Plateau problems of one search, but for those of the last start.
MAX_EVALUATIONS = 800
#: Angle between directions of offsets from which on Newton's method takes over.
_NEAR = 0.005
#: Newton steps of one search, and moves of planes when they are followed, at most; chosen without
#: measurements.
_MAX_STEPS, _MAX_MOVES = 20, 60
#: Gaps up to this part of the size of the surface are none.
_CLOSED = 1e-9
#: Step of differences, as a part of the shortest side.
_STEP = 1e-4
#: Relative change of a length from which on a surface is solved for from nothing.
_FAR = 0.2
#: Part of the mean length below which a side counts as gone.
_GONE = 0.03
#: Singular values of slopes of gaps, and of aims, relative to the largest one, below which unknowns
#: stay as they are.
_RANK, _AIM_RANK = 1e-8, 1e-10
#: Newton's slopes are taken anew where a step leaves more than this part of the gaps.
_SLOW = 0.3
#: Part of the way to where a length vanishes that a step may go; how often it is shortened, to
#: which part, and the part of what it promises that it must bring: chosen without measurements.
_ROOM, _TRIES, _SHORTER, _GAIN = 0.7, 4, 0.4, 0.1
#: Random steps from one polygon to the next, and the part of the room that they may take.
_MIXED, _INSIDE = 4, 0.98
#: Where planes are followed: the angle of the first step, by how much more the next one may be
#: than the last, and the least.
_STRIDE, _LONGER, _LEAST = 0.3, 2.0, 1e-5
#: Parts of the room and of what a step promises, and the shortening, then.
_FOLLOWED_ROOM, _FOLLOWED_GAIN, _HALF = 0.6, 0.3, 0.5


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


class Placed(NamedTuple):
    """A dual disc, its conjugate, and how that is scaled and moved to the planes.

    Attributes
    ----------
    dual : Solved
        The dual disc.
    x : (V, 3) array
        Its conjugate.
    scale : float
        By which the conjugate is multiplied.
    shift : (3,) array
        By which it is moved.
    gaps : (N,) array
        Mean distances of the sides from their planes.
    aim : (N - 3,) array
        Offsets of the planes that it meets exactly: up to shifts, and of unit length.
    """

    dual: Solved
    x: FloatArray
    scale: float
    shift: FloatArray
    gaps: FloatArray
    aim: FloatArray


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
class Closing:
    """The equations for the lengths of the sides, and how they are solved.

    Parameters
    ----------
    faces : FaceLoop
        The planes, in order.
    """

    faces: FaceLoop

    def __post_init__(self) -> None:
        """Count unknowns, begin with few edges."""
        m = self.faces.normals
        self.size = self.faces.region.size
        self.free = null_space(np.vstack([m.T, np.ones(len(m))]), rcond=1e-9)
        self.across = null_space(m.T, rcond=1e-9)  # what shifts do not change
        aim = self.across.T @ self.faces.offsets
        self.aim = aim / np.linalg.norm(aim)
        self.turns = unit_rows(np.cross(np.roll(m, 1, axis=0), m))
        self.factorizations = 0
        self.evaluations = 0
        self.level(Disc(len(m), COARSE))

    def level(self, disc: Disc) -> None:
        """Take another resolution.

        Parameters
        ----------
        disc : Disc
            Triangles of all surfaces from now on.
        """
        self.disc = disc
        self.motion = Motion.inside(disc.count, disc.boundary)
        self.base: _Base | None = None

    # ---------------------------------------------------------------- one shape

    def placed(self, lengths: FloatArray) -> Placed:
        """The surface of given lengths, moved and scaled to fit the planes as well as it can.

        Parameters
        ----------
        lengths : (N,) array
            Of the sides of the dual polygon.

        Returns
        -------
        Placed
            The surface.

        Raises
        ------
        ConvergenceError
            If there is no minimal surface over the polygon, or it is not found.
        """
        self.evaluations += 1
        return self._fitted(self._dual(lengths, self.base))

    def rebased(self, lengths: FloatArray, start: bool = True) -> Placed:
        """The surface of given lengths, as one that others start from.

        Parameters
        ----------
        lengths : (N,) array
            Of the sides of the dual polygon.
        start : bool
            Whether to begin from nothing, rather than from the last such surface.

        Returns
        -------
        Placed
            The surface.

        Raises
        ------
        ConvergenceError
            As `placed`.
        """
        dual = self._dual(lengths, None if start else self.base, fair=True)
        self.factorizations += dual.factorizations + 1
        self.base = _Base.of(lengths, dual.vertices, self.disc, self.motion)
        return self.placed(lengths)

    def _fitted(self, dual: Solved) -> Placed:
        """The conjugate of a dual surface, scaled and moved."""
        disc, m, d = self.disc, self.faces.normals, self.faces.offsets
        x = conjugated(dual.vertices, disc)
        self.factorizations += dual.factorizations + 1
        heights = np.einsum("snc,sc->sn", x[disc.side_rows], m)
        means = (heights.sum(axis=1) - 0.5 * (heights[:, 0] + heights[:, -1])) / disc.n
        system = np.column_stack([means, m])
        fitted = np.linalg.lstsq(system, d, rcond=None)[0]
        aim = self.across.T @ means
        gaps = system @ fitted - d
        aim /= max(float(np.linalg.norm(aim)), 1e-300)
        return Placed(dual, x, float(fitted[0]), fitted[1:], gaps, aim)

    def _dual(self, lengths: FloatArray, base: _Base | None, fair: bool = False) -> Solved:
        """The dual surface: from nothing, or by moving that of lengths nearby along its normals."""
        disc, faces = self.disc, self.disc.faces
        corners = np.cumsum(-lengths[:, None] * self.faces.normals, axis=0)
        v = disc.fan(np.zeros(3), np.roll(corners, 1, axis=0) - corners.mean(axis=0))
        told = "the dual surface"
        if base is None:
            v = fair_step(v, self.motion, cotangents(disc.flat, faces))
            self.factorizations += 1
            return stationary(v, faces, self.motion, what=told)
        start = base.moved(v, disc.boundary)
        along = None if fair else base.directions
        return stationary(start, faces, self.motion, what=told, directions=along)

    def turned(self, dual: Solved) -> int | None:
        """A corner at which the surface has its other side up, so that it leaves the region.

        Parameters
        ----------
        dual : Solved
            A dual surface.

        Returns
        -------
        int or None
            Number of the corner, before the side of that number; None if all are right.
        """
        n = vertex_normals(dual.vertices, self.disc.faces)[self.disc.side_rows[:, 0]]
        up = np.einsum("sc,sc->s", n, self.turns)
        return None if (up > 0.0).all() else int(up.argmin())

    # ---------------------------------------------------------------- Newton's method

    def closed(
        self, lengths: FloatArray, jacobian: FloatArray | None = None
    ) -> tuple[FloatArray, FloatArray | None, Placed]:
        """Newton's method for the lengths, with the Jacobian brought up to date by Broyden.

        Parameters
        ----------
        lengths : (N,) array
            To start from.
        jacobian : (N, N - 4) array, optional
            Changes of the gaps with the unknowns.

        Returns
        -------
        lengths, jacobian, placed
            Those with which the surface closes.

        Raises
        ------
        ConvergenceError
            If none are found.
        """
        best = self.rebased(lengths)
        base = lengths
        for _ in range(_MAX_STEPS):
            size = float(np.linalg.norm(best.gaps))
            if size <= _CLOSED * self.size:
                return lengths, jacobian, best
            fresh = jacobian is None
            if jacobian is None:
                jacobian = self._slopes(lengths, best.gaps, "gaps")
            step = self.free @ -np.linalg.lstsq(jacobian, best.gaps, rcond=_RANK)[0]
            trial = self._tried(lengths, step, size)
            if trial is None:
                if fresh:
                    break
                jacobian = None
                continue
            t, new = trial
            z = self.free.T @ (t * step)
            change = new.gaps - best.gaps
            slow = float(np.linalg.norm(new.gaps)) > _SLOW * size
            jacobian = None if slow else jacobian + np.outer(change - jacobian @ z, z) / (z @ z)
            lengths, best = lengths + t * step, new
            if np.abs(lengths / base - 1.0).max() > _FAR:
                base, best = lengths, self.rebased(lengths)
        raise ConvergenceError(
            f"no lengths of the sides close the surface {self.faces!r}: its sides are up to "
            f"{np.abs(best.gaps).max():.3g} off their planes in a region of size {self.size:.3g}"
        )

    def _slopes(self, lengths: FloatArray, value: FloatArray, name: str) -> FloatArray:
        """Changes of the gaps, or of the aim, with the unknowns, by differences."""
        columns = []
        for column in self.free.T:
            h = _STEP * float(lengths.min()) / float(np.abs(column).max())
            columns.append((getattr(self.placed(lengths + h * column), name) - value) / h)
        return np.stack(columns, axis=1)

    def _tried(
        self, lengths: FloatArray, step: FloatArray, size: float
    ) -> tuple[float, Placed] | None:
        """Part of a step that brings the sides closer to their planes, lengths staying positive."""
        t = min(1.0, _ROOM * room(lengths, step))
        for _ in range(_TRIES):
            try:
                new = self.placed(lengths + t * step)
            except ConvergenceError:
                new = None
            if new is not None and np.linalg.norm(new.gaps) < (1.0 - _GAIN * t) * size:
                return t, new
            t *= _SHORTER
        return None

    # ---------------------------------------------------------------- following

    def starts(self) -> Iterator[FloatArray | ConvergenceError]:
        """Lengths near those that close the surface, or reasons why they are not reached.

        Yields
        ------
        (N,) array or ConvergenceError
            Those whose surfaces meet the most similar planes; then where following these leads.
        """
        found = []
        self.level(Disc(len(self.faces), COARSE))
        for lengths in self._polygons(SURVEY * self.free.shape[1]):
            self.base = None
            try:
                placed = self.placed(lengths)
            except ConvergenceError:
                continue
            if self.turned(placed.dual) is None:
                found.append((float(placed.aim @ self.aim), lengths))
        found.sort(key=lambda pair: -pair[0])
        if not found:
            yield ConvergenceError(
                f"no polygon was found whose dual surface lies within {self.faces!r} at all corners"
            )
        for _, lengths in found[:MAX_NEWTON]:
            if self.evaluations > MAX_EVALUATIONS // 2:
                break
            yield lengths
        for _, lengths in found[:MAX_FOLLOWED]:
            if self.evaluations > MAX_EVALUATIONS:
                return
            self.level(Disc(len(self.faces), COARSE))
            try:
                yield self._follow(lengths)
            except ConvergenceError as e:
                yield e

    def _polygons(self, count: int) -> Iterator[FloatArray]:
        """Lengths of random closed polygons, spread over all there are."""
        rng = np.random.default_rng(len(self.faces))
        lengths = self.faces.balance
        for _ in range(count):
            for _ in range(_MIXED):
                along = self.free @ rng.normal(size=self.free.shape[1])
                low, high = -room(lengths, -along), room(lengths, along)
                lengths = lengths + rng.uniform(_INSIDE * low, _INSIDE * high) * along
            yield lengths

    def _follow(self, lengths: FloatArray) -> FloatArray:
        """Move the planes to where they should be, as far as the surface goes along."""
        best, stride = self.rebased(lengths), _STRIDE
        for _ in range(_MAX_MOVES):
            away = _angle(best.aim, self.aim)
            if away < _NEAR:
                return lengths
            slopes = self._slopes(lengths, best.aim, "aim")
            moved = self._advanced(lengths, best, slopes, min(1.0, stride / away))
            if moved is None:
                break
            lengths, best, part = moved
            stride = _LONGER * part * away
        raise self._stopped(lengths, best)

    def _advanced(
        self, lengths: FloatArray, best: Placed, slopes: FloatArray, part: float
    ) -> tuple[FloatArray, Placed, float] | None:
        """Go a part of the way to the planes, or less; None if nothing comes nearer."""
        away, base = _angle(best.aim, self.aim), self.base
        while part * away > _LEAST:
            wanted = np.sin((1.0 - part) * away) * best.aim + np.sin(part * away) * self.aim
            wanted /= np.linalg.norm(wanted)
            step = self.free @ np.linalg.lstsq(slopes, wanted - best.aim, rcond=_AIM_RANK)[0]
            t = min(1.0, _FOLLOWED_ROOM * room(lengths, step))
            try:
                new = self.rebased(lengths + t * step, start=False)
                nearer = _angle(new.aim, self.aim) < away * (1.0 - _FOLLOWED_GAIN * t * part)
                if nearer and self.turned(new.dual) is None:
                    return lengths + t * step, new, part
            except ConvergenceError:
                pass
            self.base = base
            part *= _HALF
        return None

    def _stopped(self, lengths: FloatArray, best: Placed) -> ConvergenceError:
        """Why a surface could not be followed further."""
        least = int(lengths.argmin())
        left = np.degrees(_angle(best.aim, self.aim))
        way = f"while its planes move to those of {self.faces!r}, {left:.2g} degrees before them,"
        if lengths[least] < _GONE * lengths.mean():
            name = self.faces.names[least]
            return ConvergenceError(f"{way} side {least} on {name} shrinks to nothing")
        return ConvergenceError(f"{way} the surface turns back or pinches off")


def room(lengths: FloatArray, step: FloatArray) -> float:
    """How many times a step can be made until a length is zero.

    Parameters
    ----------
    lengths, step : (N,) array
        Lengths, and how they change.

    Returns
    -------
    float
        Infinite if no length shrinks.
    """
    shrinking = step < 0.0
    return float((-lengths[shrinking] / step[shrinking]).min()) if shrinking.any() else np.inf


def _angle(a: FloatArray, b: FloatArray) -> float:
    """Angle between unit vectors, also a small one."""
    return float(2.0 * np.arctan2(np.linalg.norm(a - b), np.linalg.norm(a + b)))
