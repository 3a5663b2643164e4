"""Surfaces over boundaries: soap films and thin shells over fixed curves, and films that slide.

Guarantees: as those of `ilattice.minimal.plateau`; what does not converge is refused.
"""

from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
from scipy import sparse

from ilattice._progress import Progress, staged
from ilattice._typing import ArrayLike, FloatArray, IntArray
from ilattice._validate import as_array, as_items, as_not_negative, as_triple, read_only
from ilattice.errors import ConvergenceError, GeometryError, InputError
from ilattice.minimal.closing import conjugated
from ilattice.minimal.completion import edge_table
from ilattice.minimal.disc import MAX_VERTICES, Disc, cotangents, opposite_edges
from ilattice.minimal.patch import MinimalPatch, Report, made
from ilattice.minimal.plateau import MAX_STEPS, TOLERANCE, Motion, Solved, fair_step, stationary
from ilattice.minimal.region import MAX_FACES, Region
from ilattice.minimal.symmetry import Isometry, half_turn

#: Edges per side with which sides begin to slide.
_COARSE = 4
#: Part of the size of a region by which a surface may leave it.
_OUTSIDE = 1e-3
#: How a film is searched: how many times as many edges, and in how many steps vertices slide along
#: straight sides before it is solved for (None: they stay; a half: once, and half of it back), and
#: how many steps that may take.
_SLIDES = ((None, MAX_STEPS), (0, 100), (2, 100), (8, 100), (0.5, 100), (None, 100))
_ATTEMPTS = tuple((factor, *row) for factor in (1, 2) for row in _SLIDES)


def direct(
    boundary: Sequence[ArrayLike] | ArrayLike,
    n: int = 16,
    *,
    alpha: float = 0.0,
    cell: ArrayLike | None = None,
    progress: Progress = None,
) -> MinimalPatch:
    """Surface over a closed curve: of least area, or the shape of a thin shell.

    Parameters
    ----------
    boundary : array_like, shape (N, 3), or sequence of N arrays (k, 3)
        Corners of a polygon; or its sides as polylines, each starting where the last one ends.
    n : int
        Edges per side, at least 2. Where no surface is found with them, twice as many.
    alpha : float
        Weight of bending against stretching, a squared length: 0 is the minimal surface, from
        which the shell is deformed.
    cell : array_like, optional
        Edges of the cell in which half turns about straight sides repeat the surface, one number
        or three; without it `MinimalPatch.completed` asks for a group.
    progress : bool or callable, optional
        "surface", "shell" and "conjugate"; see `ilattice._progress.track`.

    Returns
    -------
    MinimalPatch
        The surface. With `alpha` its residual is that of the equations of the shell.

    Raises
    ------
    InputError
        If the boundary is not a closed curve with three sides or more.
    ConvergenceError
        If the surface is not found; the message says how far it came.

    Examples
    --------
    >>> petrie = [(2, 0, 0), (2, 2, 0), (0, 2, 0), (0, 2, 2), (0, 0, 2), (2, 0, 2)]
    >>> film = direct(np.array(petrie) / 4, n=16, cell=1.0)
    >>> round(4 * film.area, 2)
    1.92
    """
    sides, straight = _as_sides(boundary)
    disc = Disc.checked(len(sides), n)
    weight = as_not_negative("alpha", alpha)
    ((disc, found),) = staged({"surface": lambda: _film(sides, disc)}, progress)
    v, residual, count = found.vertices, found.residual, found.factorizations
    if weight > 0.0:
        film, motion = v, Motion.inside(disc.count, disc.boundary)
        ((v, residual),) = staged({"shell": lambda: _shell(film, disc, motion, weight)}, progress)
        count += 1
    if cell is not None and not straight:
        raise InputError("cell must be left out where sides are bent: these are no axes")
    group = None if cell is None else (_half_turns(sides), as_triple("cell", cell, positive=True))
    report = Report("direct", residual, count)
    (other,) = staged({"conjugate": lambda: conjugated(v, disc)}, progress)
    again = partial(_direct_again, sides, alpha)
    return made(v, disc, other, report, symmetry=group, what="the surface", again=again)


def _direct_again(boundary: Any, alpha: float, n: int) -> MinimalPatch:
    return direct(boundary, n, alpha=alpha)


def mixed(
    region: Region, corners: ArrayLike, slides: Sequence[str | None], n: int = 16, *,
    progress: Progress = None,
) -> MinimalPatch:  # fmt: skip
    """Minimal surface some sides of which are straight, while others slide on faces.

    Where a side slides, the surface meets the face at right angles.

    Parameters
    ----------
    region : Region
        The region with the faces.
    corners : array_like, shape (N, 3)
        Corners to start from. One between two faces slides along their edge, one next to a
        straight side stays.
    slides : sequence of str or None
        For every side, from corner i to corner i + 1, the name of the face on which it slides, or
        None for a straight side.
    n : int
        Edges per side, at least 2.
    progress : bool or callable, optional
        "surface" and "conjugate"; see `ilattice._progress.track`.

    Returns
    -------
    MinimalPatch
        The surface; `completed` reflects it in the faces of the region.

    Raises
    ------
    InputError
        If corners are off the faces, or numbers of corners and sides differ.
    ConvergenceError
        If no stationary surface is found: it may not exist, or shrink to a point.
    GeometryError
        If the surface leaves the region, as it may where faces meet at obtuse angles.
    """
    if not isinstance(region, Region):
        raise InputError(f"region must be a Region, got {region!r:.80}")
    points = _as_corners("corners", corners)
    names = as_items("slides", slides)
    if len(names) != len(points):
        raise InputError(
            f"slides must name a face or None per side, {len(points)}, got {names!r:.80}"
        )
    planes = [None if name is None else region.number(name) for name in names]
    if all(plane is None for plane in planes):
        raise InputError("slides must name a face for one side at least; direct() fixes all sides")
    _check_on_planes(region, points, planes)
    disc = Disc.checked(len(points), n)
    ((v, residual, count),) = staged(
        {"surface": lambda: _slid(region, disc, points, planes)}, progress
    )
    _check_inside(region, v)
    report = Report("mixed", residual, count)
    group = (region.mirrors, region.cell)
    again = partial(mixed, region, points, names)
    partner = conjugated(v, disc)
    return made(v, disc, partner, report, symmetry=group, what="the surface", again=again)


# --- direct ------------------------------------------------------------------------------------


def _film(sides: list[FloatArray], disc: Disc) -> tuple[Disc, Solved]:
    """The surface of least area, and the disc that it is one of.

    Equal steps along sides far from those of a conformal map fold triangles. Where that keeps the
    surface from being found, the vertices slide along straight sides, and sides are cut finer.
    """
    reasons = []
    for factor, slides, most in _ATTEMPTS:
        finer = Disc(disc.sides, factor * disc.n)
        if finer.count > MAX_VERTICES:
            continue
        try:
            return finer, _attempt(sides, finer, slides, most)
        except ConvergenceError as e:
            reasons.append(e)
    raise reasons[0]


def _attempt(sides: list[FloatArray], disc: Disc, slides: float | None, most: int) -> Solved:
    """The surface after some steps in which vertices slide along straight sides."""
    faces, flat = disc.faces, cotangents(disc.flat, disc.faces)
    loop = np.concatenate([_resampled(side, disc.n)[:-1] for side in sides])
    fixed = Motion.inside(disc.count, disc.boundary)
    v = disc.fan(loop.mean(axis=0), loop[:: disc.n])
    v[disc.boundary :] = loop
    v = fair_step(v, fixed, flat)
    if slides is None:
        found = stationary(v, faces, fixed, what="the surface", most=most)
        return replace(found, factorizations=found.factorizations + 1)
    motion = Motion(_along_sides(fixed, disc, sides))
    v = fair_step(v, motion, flat)
    if slides == 0.5:
        v[disc.boundary :] += 0.5 * (loop - v[disc.boundary :])
        v, motion = fair_step(v, fixed, flat), fixed
    for _ in range(int(slides)):
        v = fair_step(v, motion, cotangents(v, faces))
    found = stationary(v, faces, fixed, what="the surface", fairing=motion, most=most)
    _check_order(found.vertices, disc, sides)
    return replace(found, factorizations=found.factorizations + int(slides) + 2)


def _along_sides(fixed: Motion, disc: Disc, sides: list[FloatArray]) -> FloatArray:
    """Projectors that let the vertices of straight sides slide along these."""
    p = np.array(fixed.projectors)
    for row, side in zip(disc.side_rows, sides, strict=True):
        if len(side) == 2:
            t = (side[1] - side[0]) / np.linalg.norm(side[1] - side[0])
            p[row[1:-1]] = np.outer(t, t)
    return read_only(p)


def _check_order(v: FloatArray, disc: Disc, sides: list[FloatArray]) -> None:
    """Refuse vertices that have passed each other, or a corner, on a side."""
    for row, side in zip(disc.side_rows, sides, strict=True):
        if len(side) == 2:
            t = side[1] - side[0]
            if not (np.diff(v[row] @ t) > 0.0).all():
                raise ConvergenceError("vertices pass each other on a side of the surface")


def _shell(v: FloatArray, disc: Disc, motion: Motion, weight: float) -> tuple[FloatArray, float]:
    """Least energy of stretching and bending over the minimal surface, and its residual."""
    matrix = cotangents(v, disc.faces) + weight * hinges(v, disc.faces)
    new = fair_step(v, motion, matrix.tocsc())
    pull = (matrix @ new)[: disc.boundary]
    scale = float(abs(matrix).max()) * float(np.abs(new).max())
    residual = float(np.abs(pull).max()) / scale
    if not residual <= TOLERANCE:
        raise ConvergenceError(
            f"the shell is not in balance: forces are {residual:.3g} of the largest; take a "
            f"smaller alpha than {weight:g}"
        )
    return new, residual


def hinges(v: FloatArray, faces: IntArray) -> Any:
    """Bending of a surface as a quadratic form: jumps of the slopes across its edges.

    Parameters
    ----------
    v : (V, 3) array
        Vertices.
    faces : (F, 3) array
        Corners.

    Returns
    -------
    (V, V) sparse array
        Symmetric, positive semidefinite; zero for what is linear when triangles are unfolded.
    """
    e = opposite_edges(v, faces)
    double = np.linalg.norm(np.cross(e[:, 0], e[:, 1]), axis=1)
    nxt, last = np.roll(e, -1, axis=1), np.roll(e, 1, axis=1)
    cot = -np.einsum("fac,fac->fa", nxt, last) / double[:, None]
    after = np.roll(cot, -1, axis=1)  # corner k starts the edge to corner k + 1
    values = np.stack([after, cot, -(cot + after)], axis=2).reshape(-1, 3)
    corners = np.stack([faces, np.roll(faces, -1, axis=1), np.roll(faces, 1, axis=1)], axis=2)
    _, counts, (edge, _) = edge_table(faces)
    rows = np.repeat(edge, 3)
    at = (rows, corners.reshape(-1))
    jumps = sparse.coo_array((values.ravel(), at), shape=(len(counts), len(v))).tocsr()
    areas = np.bincount(edge, np.repeat(0.5 * double, 3), len(counts))
    scale = np.where(counts == 2, 3.0 / areas, 0.0)
    return (jumps.T @ sparse.diags_array(scale) @ jumps).tocsc()


def _as_corners(name: str, value: Any) -> FloatArray:
    """Corners of a polygon without repetitions."""
    points = as_array(name, value, ndim=2)
    if points.shape[1] != 3 or not 3 <= len(points) <= MAX_FACES:
        raise InputError(f"{name} must be 3 to {MAX_FACES} points as rows, got {points.shape}")
    with np.errstate(over="ignore", invalid="ignore"):
        size = float(np.linalg.norm(np.ptp(points, axis=0)))
        gaps = np.linalg.norm(points - np.roll(points, -1, axis=0), axis=1)
    if not (np.isfinite(size) and 1e-100 < size < 1e100 and gaps.min() > 1e-9 * size):
        raise InputError(f"{name} must be different from their neighbours, got {value!r:.80}")
    return points


def _as_sides(boundary: Any) -> tuple[list[FloatArray], bool]:
    """Sides as polylines, and whether all are straight."""
    given = as_items("boundary", boundary)
    if not given or np.ndim(given[0]) < 2:
        corners = _as_corners("boundary", boundary)
        return list(np.stack([corners, np.roll(corners, -1, axis=0)], axis=1)), True
    sides = [as_array(f"boundary[{i}]", side, ndim=2) for i, side in enumerate(given)]
    for i, side in enumerate(sides):
        if side.shape[1] != 3 or len(side) < 2:
            raise InputError(f"boundary[{i}] must be two points or more, got shape {side.shape}")
    corners = _as_corners("boundary", np.array([side[0] for side in sides]))
    size = float(np.linalg.norm(np.ptp(corners, axis=0)))
    for i, side in enumerate(sides):
        off = float(np.abs(side[-1] - corners[(i + 1) % len(sides)]).max())
        if off > 1e-9 * size:
            raise InputError(
                f"boundary must be closed, but side {i} ends {off:.3g} away from where the next "
                "starts"
            )
    return sides, all(len(side) == 2 for side in sides)


def _resampled(side: FloatArray, n: int) -> FloatArray:
    """Points of a polyline at equal steps of its length, ends included."""
    steps = np.linalg.norm(np.diff(side, axis=0), axis=1)
    if not steps.min() > 0.0:
        raise InputError("boundary must not repeat points within a side")
    at = np.concatenate([[0.0], np.cumsum(steps)])
    where = np.linspace(0.0, at[-1], n + 1)
    out = np.stack([np.interp(where, at, c) for c in side.T], axis=1)
    out[0], out[-1] = side[0], side[-1]
    return out


def _half_turns(sides: list[FloatArray]) -> tuple[Isometry, ...]:
    return tuple(half_turn(side[0], side[1] - side[0]) for side in sides)


# --- mixed -------------------------------------------------------------------------------------


def _slid(
    region: Region, fine: Disc, points: FloatArray, planes: list[int | None]
) -> tuple[FloatArray, float, int]:
    """Vertices, residual and factorizations, from a few triangles to many."""
    levels = [fine.n]
    while levels[-1] > _COARSE:
        levels.append((levels[-1] + 1) // 2)
    disc, v, count = fine, fine.flat, 0
    for i, n in enumerate(reversed(levels)):
        last, disc = disc, Disc(fine.sides, n)
        inside = Motion.inside(disc.count, disc.boundary)
        if i == 0:
            v = disc.fan(points.mean(axis=0), points)
            v = fair_step(v, inside, cotangents(disc.flat, disc.faces))
        else:
            v = last.finer(n, v)
        what = f"the surface with sliding sides, at {n} edges per side,"
        motion = Motion(_sliding(region, disc, planes))
        found = stationary(v, disc.faces, motion, what=what, fairing=inside)
        v, count = found.vertices, count + found.factorizations
    return v, found.residual, count + 1


def _check_on_planes(region: Region, points: FloatArray, planes: list[int | None]) -> None:
    """Refuse corners that are not where their sides slide."""
    for i, plane in enumerate(planes):
        for k in (i, (i + 1) % len(points)):
            if plane is None:
                continue
            off = float(region.normals[plane] @ points[k] - region.offsets[plane])
            if abs(off) > 1e-9 * region.size:
                raise InputError(
                    f"corners[{k}] must lie on {region.names[plane]}, on which side {i} slides, "
                    f"but it is {abs(off):.3g} off"
                )


def _check_inside(region: Region, v: FloatArray) -> None:
    """Refuse a surface that leaves its region."""
    out = (v @ region.normals.T - region.offsets).max(axis=0)
    face = int(out.argmax())
    if out[face] > _OUTSIDE * region.size:
        raise GeometryError(
            f"the surface with sliding sides leaves the region by {out[face]:.3g}, through "
            f"{region.names[face]}: name that face for a side, or move the corners"
        )


def _sliding(region: Region, disc: Disc, planes: list[int | None]) -> FloatArray:
    """Projectors of all vertices onto what they may do."""
    p = np.zeros((disc.count, 3, 3))
    p[: disc.boundary] = np.eye(3)
    for s, plane in enumerate(planes):
        row, before = disc.side_rows[s], planes[s - 1]
        if plane is None:
            continue
        m = region.normals[plane]
        p[row[1:-1]] = np.eye(3) - np.outer(m, m)
        if before is None:
            continue
        t = np.cross(m, region.normals[before])
        if float(t @ t) < 1e-12:
            p[row[0]] = np.eye(3) - np.outer(m, m)
        else:
            p[row[0]] = np.outer(t, t) / float(t @ t)
    return read_only(p)
