"""Compiled jets of a map and of a repeated tile, in tile coordinates, and small linear algebra.

Points of the parameter domain are given in *tile coordinates* p: the tile with index
(i, j, k) is the box [i, i+1] x [j, j+1] x [k, k+1]. A lattice is a `Space`, the scratch of one
thread a `Work`; kernels of ranges have both `borrowed`. Symmetric matrices are tuples
xx, yy, zz, yz, xz, xy.

Guarantee: nothing is allocated per point. Non-guarantee: arguments are not checked.
"""

from typing import Any, NamedTuple

import numpy as np

from ilattice._kernels import inner
from ilattice.bspline._kernels import basis, contract1, contract2, width
from ilattice.tiles._kernels import trig_jet, trig_tab

FAST = {"contract", "nsz", "arcp", "reassoc"}
#: Places in `geom`: u = origin + p * step, closed directions and numbers of tiles, three each;
#: whether the map is rational, the kind of tile, and whether the gradient of its field jumps at the
#: faces of tiles, so that they meet in creases; and the directions in which the surface ends with
#: the domain, three.
ORIGIN, STEP, CLOSED, TILES, RATIONAL, KIND, CREASED, ENDS = 0, 3, 6, 9, 12, 13, 14, 15
#: Kinds of tiles.
TRIGONOMETRIC, TILE_SPLINE, LATTICE_SPLINE = 0.0, 1.0, 2.0
#: The continuation of a map counts as far as det J keeps its sign and this part of the size that it
#: has where the domain ends, seen in so many steps of equal length; and for points of the domain
#: that are farther away from it than this part of the way to that end.
UPRIGHT, STEPS, BESIDE = 0.2, 4, 0.25


class Space(NamedTuple):
    """A lattice for kernels.

    Attributes
    ----------
    d0, d1, d2, k0, k1, k2, c
        The map T as arguments of the B-spline kernels, see `BSpline.kernel_args`.
    geom : ndarray, shape (18,)
        Numbers whose places `ORIGIN` and what follows name.
    coef, factor, omega
        The tile, if it is a trigonometric polynomial, see `trig_jet`.
    t0, t1, t2, q0, q1, q2, tc
        Otherwise the tile as a spline on the unit cube, or all tiles together as a spline in tile
        coordinates, with period in closed directions.
    """

    d0: Any
    d1: Any
    d2: Any
    k0: Any
    k1: Any
    k2: Any
    c: Any
    geom: Any
    coef: Any
    factor: Any
    omega: Any
    t0: Any
    t1: Any
    t2: Any
    q0: Any
    q1: Any
    q2: Any
    tc: Any

    def through(self, spline: tuple[Any, ...], geom: Any) -> "Space":
        """The same tile through another map."""
        return Space._make((*spline, geom, *self[len(spline) + 1 :]))


class Work(NamedTuple):
    """Scratch of one thread.

    Attributes
    ----------
    basis : ndarray, shape (3, 3, width)
        Basis functions.
    map : ndarray, shape (3, 10) or (4, 10)
        Jet of the map, see `map_jet`.
    tile : ndarray, shape (10,)
        Jet of the tile, see `tile_jet`.
    table : ndarray
        Of `trig_tab`.
    room : ndarray, shape (2, 3)
        Bounds of an iteration.
    """

    basis: Any
    map: Any
    tile: Any
    table: Any
    room: Any


@inner(owning=True)
def scratch(space):
    """New `Work` for a space."""
    k = max(width(space.k0, space.k1, space.k2), width(space.q0, space.q1, space.q2))
    return Work(
        np.zeros((3, 3, k)), np.zeros((space.c.shape[0], 10)), np.zeros(10),
        trig_tab(space.factor), np.zeros((2, 3)),
    )  # fmt: skip


@inner(fastmath=FAST, error_model="numpy")
def wrap(x, lo, length):
    """x moved by whole lengths into [lo, lo + length)."""
    return x - length * np.floor((x - lo) / length)


@inner(fastmath=FAST, error_model="numpy", forceinline=True)
def parameter(geom, axis, p):
    """Parameter of a tile coordinate, wrapped in a closed direction."""
    if geom[CLOSED + axis] != 0.0:
        p = wrap(p, 0.0, geom[TILES + axis])
    return geom[ORIGIN + axis] + p * geom[STEP + axis]


@inner(fastmath=FAST, error_model="numpy", forceinline=True)
def map_jet(space, p, order, b, m):
    """Map jet in tile coordinates into m (3, 10): rational maps divided through; scratch b."""
    c, geom, k0, k1, k2 = space.c, space.geom, space.k0, space.k1, space.k2
    i0 = basis(space.d0, k0, parameter(geom, 0, p[0]), order, b, 0)
    j0 = basis(space.d1, k1, parameter(geom, 1, p[1]), order, b, 1)
    l0 = basis(space.d2, k2, parameter(geom, 2, p[2]), order, b, 2)
    for axis in range(3):  # derivatives with respect to p
        s = geom[STEP + axis]
        for j in range(b.shape[2]):
            b[axis, 1, j] *= s
            b[axis, 2, j] *= s * s
    for a in range(c.shape[0]):
        if order == 1:
            f, fu, fv, fw = contract1(c, a, i0, j0, l0, k0, k1, k2, b)
        else:
            f, fu, fv, fw, fuu, fvv, fww, fvw, fuw, fuv = contract2(c, a, i0, j0, l0, k0, k1, k2, b)
            m[a, 4] = fuu
            m[a, 5] = fvv
            m[a, 6] = fww
            m[a, 7] = fvw
            m[a, 8] = fuw
            m[a, 9] = fuv
        m[a, 0] = f
        m[a, 1] = fu
        m[a, 2] = fv
        m[a, 3] = fw
    if geom[RATIONAL] != 0.0:
        divide(m, order)


@inner(fastmath=FAST, error_model="numpy")
def divide(m, order):
    """Quotient rule on homogeneous jets, the weight in the last row."""
    w = m.shape[0] - 1
    inv = 1.0 / m[w, 0]
    for a in range(3):
        m[a, 0] *= inv
        for i in range(1, 4):
            m[a, i] = (m[a, i] - m[a, 0] * m[w, i]) * inv
        if order > 1:
            for i in range(1, 4):
                m[a, 3 + i] = (m[a, 3 + i] - 2.0 * m[a, i] * m[w, i] - m[a, 0] * m[w, 3 + i]) * inv
            for n, i, j in ((7, 2, 3), (8, 1, 3), (9, 1, 2)):
                m[a, n] = (
                    m[a, n] - m[a, i] * m[w, j] - m[a, j] * m[w, i] - m[a, 0] * m[w, n]
                ) * inv


@inner(fastmath=FAST, error_model="numpy", forceinline=True)
def in_tile(geom, axis, p):
    """Coordinate for the spline of the tiles: within one tile, or, of kind 2, within the lattice.

    The upper end of the domain belongs to the last tile.
    """
    if geom[KIND] == LATTICE_SPLINE:
        return p if geom[CLOSED + axis] == 0.0 else wrap(p, 0.0, geom[TILES + axis])
    if geom[CLOSED + axis] == 0.0 and abs(p - geom[TILES + axis]) < 1e-9:
        return p - geom[TILES + axis] + 1.0
    return p - np.floor(p)


@inner(fastmath=FAST, error_model="numpy", forceinline=True)
def tile_jet(space, p, b, t, tab):
    """Tile jet in tile coordinates into t (10,): f, gradient, xx, yy, zz, yz, xz, xy."""
    geom = space.geom
    if geom[KIND] == TRIGONOMETRIC:
        trig_jet(space.coef, space.factor, space.omega, p[0], p[1], p[2], tab, t)
    else:
        q0, q1, q2 = space.q0, space.q1, space.q2
        i0 = basis(space.t0, q0, in_tile(geom, 0, p[0]), 2, b, 0)
        j0 = basis(space.t1, q1, in_tile(geom, 1, p[1]), 2, b, 1)
        l0 = basis(space.t2, q2, in_tile(geom, 2, p[2]), 2, b, 2)
        t[0], t[1], t[2], t[3], t[4], t[5], t[6], t[7], t[8], t[9] = contract2(
            space.tc, 0, i0, j0, l0, q0, q1, q2, b
        )


@inner(fastmath=FAST, error_model="numpy")
def sym(h, a, b):
    """a' H b with H as xx, yy, zz, yz, xz, xy and vectors as tuples."""
    return (
        h[0] * a[0] * b[0]
        + h[1] * a[1] * b[1]
        + h[2] * a[2] * b[2]
        + h[3] * (a[1] * b[2] + a[2] * b[1])
        + h[4] * (a[0] * b[2] + a[2] * b[0])
        + h[5] * (a[0] * b[1] + a[1] * b[0])
    )


@inner(fastmath=FAST, error_model="numpy")
def metric(m):
    """J'J from a map jet, as xx, yy, zz, yz, xz, xy."""
    return (
        m[0, 1] * m[0, 1] + m[1, 1] * m[1, 1] + m[2, 1] * m[2, 1],
        m[0, 2] * m[0, 2] + m[1, 2] * m[1, 2] + m[2, 2] * m[2, 2],
        m[0, 3] * m[0, 3] + m[1, 3] * m[1, 3] + m[2, 3] * m[2, 3],
        m[0, 2] * m[0, 3] + m[1, 2] * m[1, 3] + m[2, 2] * m[2, 3],
        m[0, 1] * m[0, 3] + m[1, 1] * m[1, 3] + m[2, 1] * m[2, 3],
        m[0, 1] * m[0, 2] + m[1, 1] * m[1, 2] + m[2, 1] * m[2, 2],
    )


@inner(fastmath=FAST, error_model="numpy")
def solve_sym(h, b):
    """Solution of H x = b for a 3 x 3 symmetric H, and whether H is regular."""
    c00 = h[1] * h[2] - h[3] * h[3]
    c01 = h[4] * h[3] - h[5] * h[2]
    c02 = h[5] * h[3] - h[4] * h[1]
    det = h[0] * c00 + h[5] * c01 + h[4] * c02
    if not abs(det) > 0.0:
        return (0.0, 0.0, 0.0), False
    inv = 1.0 / det
    c11 = h[0] * h[2] - h[4] * h[4]
    c12 = h[4] * h[5] - h[0] * h[3]
    c22 = h[0] * h[1] - h[5] * h[5]
    return (
        (c00 * b[0] + c01 * b[1] + c02 * b[2]) * inv,
        (c01 * b[0] + c11 * b[1] + c12 * b[2]) * inv,
        (c02 * b[0] + c12 * b[1] + c22 * b[2]) * inv,
    ), True


@inner(fastmath=FAST, error_model="numpy")
def cofactor_normal(m, g):
    """Normal cof(J) g = det(J) J^-T g of the image, from a map jet and a parameter gradient."""
    a = (
        m[1, 2] * m[2, 3] - m[1, 3] * m[2, 2],
        m[1, 3] * m[2, 1] - m[1, 1] * m[2, 3],
        m[1, 1] * m[2, 2] - m[1, 2] * m[2, 1],
    )
    b = (
        m[2, 2] * m[0, 3] - m[2, 3] * m[0, 2],
        m[2, 3] * m[0, 1] - m[2, 1] * m[0, 3],
        m[2, 1] * m[0, 2] - m[2, 2] * m[0, 1],
    )
    c = (
        m[0, 2] * m[1, 3] - m[0, 3] * m[1, 2],
        m[0, 3] * m[1, 1] - m[0, 1] * m[1, 3],
        m[0, 1] * m[1, 2] - m[0, 2] * m[1, 1],
    )
    n0 = a[0] * g[0] + a[1] * g[1] + a[2] * g[2]
    n1 = b[0] * g[0] + b[1] * g[1] + b[2] * g[2]
    n2 = c[0] * g[0] + c[1] * g[1] + c[2] * g[2]
    det = m[0, 1] * a[0] + m[0, 2] * a[1] + m[0, 3] * a[2]
    return (n0, n1, n2), det


@inner(fastmath=FAST, error_model="numpy")
def upright(space, orient, p, y, away, b, m):
    """Whether the continuation of the map counts at p, beyond an open end of the domain.

    Its image y is `away` from a point of the domain: if that is much less than the way to the end
    of the domain, the continuation has come back over the domain. Leaves the jet of order 1 at p
    in m if it counts.
    """
    geom, zero = space.geom, (0.0, 0.0, 0.0)
    e0, e1, e2 = at_end(geom, 0, p[0]), at_end(geom, 1, p[1]), at_end(geom, 2, p[2])
    map_jet(space, (e0, e1, e2), 1, b, m)
    whole = orient * cofactor_normal(m, zero)[1]
    way = np.sqrt((y[0] - m[0, 0]) ** 2 + (y[1] - m[1, 0]) ** 2 + (y[2] - m[2, 0]) ** 2)
    if not whole > 0.0 or away < BESIDE * way:
        return False
    return upright_part(space, orient, (e0, e1, e2), p, whole, b, m) >= UPRIGHT


@inner(fastmath=FAST, error_model="numpy")
def upright_part(space, orient, end, p, whole, b, m):
    """What is left of det J, of size `whole` at `end`, on the way from there to p, at least.

    Stops where that is less than half of `UPRIGHT`; leaves the jet of order 1 at p in m otherwise.
    """
    rest = 1.0
    for i in range(1, STEPS + 1):
        s = i / STEPS
        q0 = end[0] + s * (p[0] - end[0])
        q1 = end[1] + s * (p[1] - end[1])
        q2 = end[2] + s * (p[2] - end[2])
        map_jet(space, (q0, q1, q2), 1, b, m)
        rest = min(rest, orient * cofactor_normal(m, (0.0, 0.0, 0.0))[1] / whole)
        if not rest >= 0.5 * UPRIGHT:
            return 0.0
    return rest


@inner(fastmath=FAST, error_model="numpy")
def at_end(geom, axis, p):
    """Tile coordinate of the domain next to p; p itself in a closed direction."""
    return p if geom[CLOSED + axis] != 0.0 else min(max(p, 0.0), geom[TILES + axis])


@inner(fastmath=FAST, error_model="numpy")
def tangents(g, fixed):
    """Two vectors that span the null space of g among the free directions (zero if fewer).

    A fixed direction takes part in neither; with one fixed direction the second is zero.
    """
    zero = (0.0, 0.0, 0.0)
    n = fixed[0] + fixed[1] + fixed[2]
    if n >= 2:
        return zero, zero
    if n == 1:
        if fixed[0]:
            t = (0.0, -g[2], g[1])
        elif fixed[1]:
            t = (g[2], 0.0, -g[0])
        else:
            t = (-g[1], g[0], 0.0)
        s = np.sqrt(t[0] * t[0] + t[1] * t[1] + t[2] * t[2]) + 1e-300
        return (t[0] / s, t[1] / s, t[2] / s), zero
    a0, a1, a2 = abs(g[0]), abs(g[1]), abs(g[2])
    if a0 <= a1 and a0 <= a2:
        t = (0.0, -g[2], g[1])
    elif a1 <= a2:
        t = (g[2], 0.0, -g[0])
    else:
        t = (-g[1], g[0], 0.0)
    s = 1.0 / (np.sqrt(t[0] * t[0] + t[1] * t[1] + t[2] * t[2]) + 1e-300)
    t = (t[0] * s, t[1] * s, t[2] * s)
    q = (g[1] * t[2] - g[2] * t[1], g[2] * t[0] - g[0] * t[2], g[0] * t[1] - g[1] * t[0])
    s = 1.0 / (np.sqrt(q[0] * q[0] + q[1] * q[1] + q[2] * q[2]) + 1e-300)
    return t, (q[0] * s, q[1] * s, q[2] * s)
