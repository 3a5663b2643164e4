"""Minimal surfaces that meet the faces of a region at right angles, by conjugation.

The sides of such a surface lie in mirrors, those of its dual are straight, along the normals of
the mirrors: a polygon whose lengths of sides are known up to N - 3 numbers. For given lengths the
dual is a Plateau problem, and its conjugate one linear solve. Scale and position are linear; the
N - 4 numbers that are left are found by `ilattice.minimal.closing`.

Guarantees: what is returned meets the planes of all faces, lies in the region, and has a mean
curvature that vanishes; else a `ConvergenceError` or `GeometryError` says why. Non-guarantees:
where several surfaces meet the same faces, which one is found; that there is none where none is.
"""

from dataclasses import replace
from functools import partial
from itertools import chain

import numpy as np

from ilattice._progress import Progress, staged
from ilattice._typing import FloatArray
from ilattice._validate import read_only
from ilattice.errors import ConvergenceError, GeometryError, InputError
from ilattice.minimal.closing import COARSE, Closing, Placed
from ilattice.minimal.disc import Disc, area
from ilattice.minimal.patch import MinimalPatch, Report, made
from ilattice.minimal.region import FaceLoop

#: Mean curvature times size that all but a twentieth of the vertices keep below.
MAX_CURVATURE = 3.0


def conjugate(faces: FaceLoop, n: int = 16, *, progress: Progress = None) -> MinimalPatch:
    """Minimal surface that meets faces of a region at right angles, in a given order.

    Parameters
    ----------
    faces : FaceLoop
        Faces in cyclic order, as ``il.minimal.cuboid().faces("x+ z- y+ x- z+ y-")``; a face may
        come several times.
    n : int
        Edges per side, at least 2. Vertices are off by some 0.01 / n² of the cell in a cube, and
        by a hundred times as much in boxes of 5:1: `MinimalPatch.sharpened` estimates it.
    progress : bool or callable, optional
        "lengths of sides", once for each start of the search; see `ilattice._progress.track`.

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
    closing = Closing(faces)
    reasons: list[Exception] = []
    more = closing.starts() if closing.free.shape[1] else ()
    for start in chain([faces.balance], more):
        if isinstance(start, ConvergenceError):
            reasons.append(start)
            continue
        search = partial(_polished, closing, start, disc)
        try:
            found = staged({"lengths of sides": search}, progress)[0]
            return replace(found, _again=partial(conjugate, faces))
        except (ConvergenceError, GeometryError) as e:
            reasons.append(e)
    raise _refusal(reasons)


def _polished(closing: Closing, lengths: FloatArray, disc: Disc) -> MinimalPatch:
    """The surface that is reached from some lengths, with few edges first."""
    if closing.free.shape[1] == 0:
        closing.level(disc)
        return _checked(closing, lengths, closing.placed(lengths))
    jacobian = None
    for n in sorted({min(COARSE, disc.n), disc.n}):
        closing.level(Disc(disc.sides, n))
        lengths, jacobian, best = closing.closed(lengths, jacobian)
    return _checked(closing, lengths, best)


def _checked(closing: Closing, lengths: FloatArray, best: Placed) -> MinimalPatch:
    """The surface with its sides in the planes, or the reason why it is none."""
    told = f"the surface {closing.faces!r}"
    if not best.scale > 0.0:
        raise GeometryError(
            f"{told} would lie on the outer side of its faces: no surface within the region "
            "meets them in this order"
        )
    x = best.scale * best.x + best.shift
    snapped, gap = _snapped(closing, x)
    partner = -best.scale * best.dual.vertices
    distortion = area(snapped, closing.disc.faces) / area(partner, closing.disc.faces) - 1.0
    _check_place(closing, told, snapped, gap, distortion)
    region = closing.faces.region
    report = Report(
        kind="conjugate",
        residual=best.dual.residual,
        factorizations=closing.factorizations,
        evaluations=closing.evaluations,
        lengths=read_only(best.scale * lengths),
        gap=gap,
        distortion=distortion,
    )
    symmetry = (region.mirrors, region.cell)
    patch = made(snapped, closing.disc, partner, report, symmetry=symmetry, what=told)
    bent = float(np.quantile(np.abs(patch.mean_curvature[: closing.disc.boundary]), 0.95))
    if bent * closing.size > MAX_CURVATURE:
        raise ConvergenceError(
            f"{told} is not minimal: its mean curvature times size is {bent * closing.size:.3g}; "
            f"take more edges per side than n={closing.disc.n}"
        )
    return patch


def _check_place(closing: Closing, told: str, x: FloatArray, gap: float, distortion: float) -> None:
    """Refuse a surface off its planes, unlike its dual, or beyond the region."""
    size, region = closing.size, closing.faces.region
    more = f"take more edges per side than n={closing.disc.n}"
    if gap > 0.03 * size:
        raise ConvergenceError(
            f"{told} is off its planes by up to {gap:.3g} in a region of size {size:.3g}: {more}"
        )
    if abs(distortion) > 0.1:
        raise ConvergenceError(
            f"{told} and its dual differ in area by {abs(distortion):.2%}, where they are "
            f"equal: {more}"
        )
    out = float((x @ region.normals.T - region.offsets).max())
    if out > max(4.0 * gap, 1e-3 * size):
        raise GeometryError(
            f"{told} leaves the region by {out:.3g}, through a face that it does not name "
            "there: no surface within the region meets the faces in this order"
        )


def _snapped(closing: Closing, x: FloatArray) -> tuple[FloatArray, float]:
    """Sides moved into their planes, and how far that was."""
    out, m, d = x.copy(), closing.faces.normals, closing.faces.offsets
    rows = closing.disc.side_rows
    for s, side in enumerate(rows):
        out[side[1:-1]] -= np.outer(out[side[1:-1]] @ m[s] - d[s], m[s])
        pair = m[[s - 1, s]]
        off = pair @ out[side[0]] - d[[s - 1, s]]
        out[side[0]] -= np.linalg.lstsq(pair, off, rcond=None)[0]
    moved = np.linalg.norm(out - x, axis=1)
    return out, float(moved.max())


def _refusal(reasons: list[Exception]) -> Exception:
    """The most telling of several reasons: geometry over numbers."""
    for reason in reasons:
        if isinstance(reason, GeometryError):
            return reason
    last = reasons[-1]
    return type(last)(f"{last} (from {len(reasons)} starts)")
