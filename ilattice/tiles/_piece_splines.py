"""Pieces of spline curves and surfaces: their Bézier elements, all of one degree at once.

Guarantee: elements are those of curve or surface and radius on their common breaks.
"""

from collections.abc import Sequence
from math import comb
from typing import Any

import numpy as np

from ilattice._geometry import grid_indices
from ilattice._typing import FloatArray, IntArray
from ilattice.bspline import BSpline
from ilattice.errors import InputError
from ilattice.tiles._kernels_closest import MAX_DEGREE
from ilattice.tiles._kernels_skeleton import CURVE, SURFACE
from ilattice.tiles._piece_arrays import Groups, Outward, Pieces, alike, continued, segments
from ilattice.tiles._radii import as_radius
from ilattice.tiles.entities import TINY, Curve, Surface

#: Parts that a Bézier curve is cut into: smaller boxes are passed over more often.
PARTS = 4


# ------------------------------------------------------------------------------ Bernstein form


def _elevated(c: FloatArray, degree: Sequence[int]) -> FloatArray:
    """Bernstein coefficients of elements (n, ...) for higher degrees along axes from 1 on."""
    for axis, n in enumerate(degree, 1):
        while c.shape[axis] <= n:
            p = c.shape[axis] - 1
            a = np.moveaxis(c, axis, 0)
            t = (np.arange(p + 2) / (p + 1)).reshape(-1, *(1,) * (a.ndim - 1))
            pad = [(1, 1)] + [(0, 0)] * (a.ndim - 1)
            a = np.pad(a, pad)
            c = np.moveaxis(t * a[:-1] + (1.0 - t) * a[1:], 0, axis)
    return c


def _product(a: FloatArray, b: FloatArray) -> FloatArray:
    """Bernstein coefficients of products of two scalar polynomials, element by element."""
    shape = tuple(m + n - 1 for m, n in zip(a.shape[1:], b.shape[1:], strict=True))
    out, scale = np.zeros((len(a), *shape)), np.zeros(shape)
    for i in np.ndindex(a.shape[1:]):
        for j in np.ndindex(b.shape[1:]):
            k = tuple(x + y for x, y in zip(i, j, strict=True))
            f = 1.0
            for x, m, y, n in zip(i, a.shape[1:], j, b.shape[1:], strict=True):
                f *= comb(m - 1, x) * comb(n - 1, y)
            out[(slice(None), *k)] += f * a[(slice(None), *i)] * b[(slice(None), *j)]
            scale[k] += f
    return out / scale


def _homogeneous(points: FloatArray, weights: FloatArray | None, radius: FloatArray) -> FloatArray:
    """Rows (x w, y w, z w, r w, w) of Bézier elements, of a common degree."""
    w = np.ones(points.shape[:-1]) if weights is None else weights
    rw = radius if weights is None else _product(radius, w)
    top = [max(m, n) - 1 for m, n in zip(rw.shape[1:], w.shape[1:], strict=True)]
    parts = [points * w[..., None], rw[..., None], w[..., None]]
    return np.concatenate([_elevated(a, top) for a in parts], axis=-1)


def _elements(spline: BSpline, radius: float | BSpline) -> list[tuple[IntArray, FloatArray]]:
    """Indices (n, nd) and homogeneous Bézier points of elements on the common breaks, by degree."""
    nd = spline.ndim
    if isinstance(radius, BSpline):
        for axis in range(nd):
            mine, theirs = spline.breaks(axis), radius.breaks(axis)
            spline = spline.insert_knots(axis, _missing(theirs, mine))
            radius = radius.insert_knots(axis, _missing(mine, theirs))
    if nd == 1 and spline.k[0] > 1:
        b = spline.breaks(0)
        cuts = (b[:-1, None] + np.diff(b)[:, None] * np.arange(1, PARTS) / PARTS).ravel()
        spline = spline.insert_knots(0, cuts)
        if isinstance(radius, BSpline):
            radius = radius.insert_knots(0, cuts)
    cells = spline.to_bezier()
    index = grid_indices(cells.shape)
    points, w = _flat(cells.coefficients, nd), _flat(cells.weights, nd)
    if isinstance(radius, BSpline):
        r = _flat(radius.to_bezier().coefficients, nd)
    else:
        r = np.full((len(index), *(1,) * nd), radius)
    even = np.ones(len(index), np.bool_)
    if w is not None:
        rows = w.reshape(len(w), -1)
        even = np.ptp(rows, axis=1) <= 1e-14 * rows.max(axis=1)
    out = [(index[even], _homogeneous(points[even], None, r[even]))]
    if w is not None:
        out.append((index[~even], _homogeneous(points[~even], w[~even], r[~even])))
    return [(i, h) for i, h in out if len(i)]


def _flat(a: FloatArray | None, nd: int) -> Any:
    """Coefficients of elements, one after the other."""
    return None if a is None else a.reshape(-1, *a.shape[nd:])


def _missing(new: FloatArray, old: FloatArray) -> FloatArray:
    """Breaks that are new, up to rounding."""
    at = np.searchsorted(old, new)
    below, above = old[np.maximum(at - 1, 0)], old[np.minimum(at, len(old) - 1)]
    gap = np.minimum(np.abs(new - below), np.abs(new - above))
    return new[gap > 1e-12 * np.ptp(old)]


# ------------------------------------------------------------------------------ curves


def of_curve(e: Curve, radius: Any, group: int, outward: Outward, far: float) -> list[Pieces]:
    """Pieces of a curve and of its continuations past open faces.

    Parameters
    ----------
    e : Curve
        The curve.
    radius : float, callable or BSpline
        Its radius.
    group : int
        Its group in the smooth union.
    outward : callable
        Whether directions leave the tile through an open or closed face at points.
    far : float
        Length of continuations.

    Returns
    -------
    list of Pieces
        The pieces.
    """
    r = as_radius("radius", radius, e.spline.domain)
    elements = [(i[:, 0], h) for i, h in _elements(e.spline, r)]
    long = [np.ptp(h[..., :3] / h[..., 4:], axis=1).max(axis=1) > TINY for _, h in elements]
    elements = [(i[on], h[on]) for (i, h), on in zip(elements, long, strict=True) if on.any()]
    out = [part for _, h in elements for part in _curves(group, h)]
    if not e.spline.periodic[0]:
        _, first = min(elements, key=lambda part: part[0][0])
        _, last = max(elements, key=lambda part: part[0][-1])
        for h in (first[0], last[-1][::-1]):
            p, thick = h[:, :3] / h[:, 4:], h[0, 3] / h[0, 4]
            other = p[np.argmax(np.abs(p - p[0]).max(axis=1) > TINY)]
            out.append(continued(group, p[:1], p[:1] - other, thick, outward, far))
    return out


def _curves(group: Groups, h: FloatArray) -> list[Pieces]:
    """Bézier curves (n, p + 1, 5); straight ones with equal weights as segments."""
    degree = h.shape[1] - 1
    points, radius = h[..., :3] / h[..., 4:], h[..., 3] / h[..., 4]
    even = np.ptp(h[..., 4], axis=1) == 0.0
    bent = ~even | (degree > 1) | (np.ptp(points, axis=1).max(axis=1) <= TINY)
    if degree > MAX_DEGREE:
        raise InputError(
            f"radius: curve and radius together have degree {degree}, more than {MAX_DEGREE}; "
            "lower the degree of the radius"
        )
    plain = even & (np.ptp(radius, axis=1) == 0.0)
    out = [] if bent.all() else [segments(group, points[~bent], radius[~bent])]
    if bent.any():
        rows, points, radius = h[bent].reshape(int(bent.sum()), -1), points[bent], radius[bent]
        out.append(alike(CURVE, group, rows, points, radius, (degree, 0), plain[bent]))
    return out


# ------------------------------------------------------------------------------ surfaces


def of_surface(e: Surface, radius: Any, group: int, outward: Outward, far: float) -> list[Pieces]:
    """Pieces of a surface, of its edges and of its continuations past open faces.

    Parameters
    ----------
    e : Surface
        The surface.
    radius : float, callable or BSpline
        Half its thickness.
    group, outward, far : int, callable and float
        See `of_curve`.

    Returns
    -------
    list of Pieces
        The pieces.
    """
    r = as_radius("radius", radius, e.spline.domain)
    elements = _elements(e.spline, r)
    last = np.max([i.max(axis=0) for i, _ in elements], axis=0)
    grids = [h for _, h in elements]
    for i, h in elements:
        for axis in range(2):
            if e.spline.periodic[axis]:
                continue
            along = np.moveaxis(h, axis + 1, 1)
            grids.append(_strips(along[i[:, axis] == 0], outward, far))
            grids.append(_strips(along[i[:, axis] == last[axis], ::-1], outward, far))
    grids = [h for h in grids if len(h)]
    edges = [edge for h in grids for edge in (h[:, 0], h[:, -1], h[:, :, 0], h[:, :, -1])]
    out = [_surfaces(group, h) for h in grids]
    for size in {edge.shape[1] for edge in edges}:
        every = np.concatenate([edge for edge in edges if edge.shape[1] == size])
        keys = np.round(every.reshape(len(every), -1), 13) + 0.0
        out += _curves(group, every[np.sort(np.unique(keys, axis=0, return_index=True)[1])])
    return out


def _strips(h: FloatArray, outward: Outward, far: float) -> FloatArray:
    """Ruled continuations past first rows of control points that are on an open face."""
    p, q = (h[:, row, :, :3] / h[:, row, :, 4:] for row in (0, 1))
    step = p - q
    size = np.linalg.norm(step, axis=2).max(axis=1)[:, None, None]
    way = step / np.maximum(size, TINY)
    out = outward(p.reshape(-1, 3), way.reshape(-1, 3)).reshape(len(h), -1).all(axis=1)
    new = h[:, 0].copy()
    new[..., :3] = (p + far * way) * h[:, 0, :, 4:]
    return np.stack([h[:, 0], new], axis=1)[out & (size[:, 0, 0] > TINY)]


def _surfaces(group: Groups, h: FloatArray) -> Pieces:
    """Bézier surfaces (n, p + 1, q + 1, 5), without their boundaries."""
    degree = (h.shape[1] - 1, h.shape[2] - 1)
    if max(degree) > MAX_DEGREE:
        raise InputError(
            f"radius: surface and radius together have degrees {degree}, more than {MAX_DEGREE}; "
            "lower the degree of the radius"
        )
    h = h.reshape(len(h), -1, 5)
    points, radius = h[..., :3] / h[..., 4:], h[..., 3] / h[..., 4]
    plain = (np.ptp(h[..., 4], axis=1) == 0.0) & (np.ptp(radius, axis=1) == 0.0)
    return alike(SURFACE, group, h.reshape(len(h), -1), points, radius, degree, plain)
