"""Compiled questions about seeds and feet: which count, which may be near a nearer foot.

A seed stands for the patch of the surface around it. The arguments are those of `_kernels_jets`;
seeds are sp (tile coordinates, (s, 3)), sx (image, (s, 3)), sn (unit normal and more, (s, PLAIN),
or (s, SQUEEZED_TOO) where cells are squeezed, see `BENT`), and sh (spacing, (s,)). Rows of feet
have eight numbers, see `IMAGE`.

Guarantee: the same answers for any number of threads. Non-guarantee: a patch that bends more within
a cell than its seed tells may be ruled out.
"""

import numpy as np

from ilattice._kernels import inner
from ilattice.offsets._kernels_jets import CLOSED, CREASED, FAST, TILES

#: Points on sheets that face alike are at least this far apart in tile coordinates. It tells sheets
#: from each other where a map squeezes tiles to less than the spacing of seeds.
APART = 0.4
#: Least cosine between the normals of seeds of one patch: surfaces may meet at right angles. Where
#: normals turn by more than TURN over the spacing of seeds, patches are less wide, to a part.
ALIKE, TURN, MIN_ALIKE = 0.5, 1.5, 0.2
#: Seeds with a larger curvature times spacing say nothing about the normals next to them.
SHARP = 2.0
#: Columns of feet behind their tile coordinates: place in space, distance, multiplier.
IMAGE, DISTANCE, MULTIPLIER = 3, 6, 7
#: Columns of normals of seeds: the largest curvature times spacing, and how far away queries must
#: be for the seed to count; where cells are squeezed, behind PLAIN, the matrix that takes space to
#: cells, how far cells bend away from that, and how far the surface does from its tangent plane.
BENT, CLEAR, SAGITTA, BULGED = 3, 4, 14, 15
#: Columns of normals of seeds where cells are not squeezed, and where they are. A seed stands for
#: so many cells around it.
PLAIN, SQUEEZED_TOO, AROUND = 5, 16, 1.25
#: Part of a cell, along the normal, by which surfaces bend away from their tangent plane.
BULGE = 0.3
#: How far a foot may be from a seed along the surface, in spacings, before the turn of normals.
ACROSS = 0.9
#: A seed stands for the patch of a foot that is so near to it, in spacings and in parts of the
#: distance, whichever is less; or where the foot is within the third number of spacings of the
#: seed, or a part of one from its tangent plane below the query, and the way from foot to query is
#: along the normal to the last part. Chosen without a study of their own. Where cells are squeezed
#: the third number counts in cells, too: a spacing may hold several folds of a sheet.
BESIDE, BESIDE_FAR, WIDE, PLANE, ALONG = 0.2, 0.5, 1.2, 0.5, 0.7
#: How far below its upper faces a tile ends whose neighbours meet it in creases.
BELOW = 1e-12


@inner(fastmath=FAST, error_model="numpy")
def outside(geom, p):
    """Whether p lies beyond an open end of the domain, in the continuation."""
    for a in range(3):
        if geom[CLOSED + a] == 0.0 and (p[a] < 0.0 or p[a] > geom[TILES + a]):
            return True
    return False


@inner(fastmath=FAST, error_model="numpy")
def reachable(geom, p, q):
    """Whether the foot p counts for the query q: continued feet only for queries next to them."""
    if not outside(geom, p):
        return True
    for a in range(3):
        d = p[a] - q[a]
        if geom[CLOSED + a] != 0.0:
            d -= geom[TILES + a] * np.rint(d / geom[TILES + a])
        if abs(d) > 2.0:
            return False
    return True


@inner(fastmath=FAST, error_model="numpy")
def in_reach(geom, sp, sx, sn, s, x, q):
    """Whether the seed s counts for a query at x, of tile coordinates q."""
    if s < 0 or not reachable(geom, (sp[s, 0], sp[s, 1], sp[s, 2]), q):
        return False
    return seed_distance(sx, s, x) >= sn[s, CLEAR]


@inner(fastmath=FAST, error_model="numpy")
def unlikely(x, sx, sn, i, h, best):
    """Cheap rejection of a further start: its patch cannot hold a foot nearer than `best`.

    A foot within h of the seed s has its normal along x - foot, so the tangential part of
    x - s is at most h plus what the normal turns over h, times `best`; and the patch is nearer
    than that only if the normal part is. Where the normal turns too much, only distance counts,
    where cells are squeezed that from the cells around the seed.
    """
    v = (x[0] - sx[i, 0], x[1] - sx[i, 1], x[2] - sx[i, 2])
    if sn.shape[1] > PLAIN and off_cells(v, sn, i, best):
        return True
    a = v[0] * sn[i, 0] + v[1] * sn[i, 1] + v[2] * sn[i, 2]
    vv = v[0] * v[0] + v[1] * v[1] + v[2] * v[2]
    if sn[i, BENT] > SHARP:
        return np.sqrt(vv) > best + h
    tangential = np.sqrt(max(vv - a * a, 0.0))
    turn = max(0.5 * abs(a), best * sn[i, BENT])
    bulge = BULGE * h
    if sn.shape[1] > PLAIN:
        bulge = min(bulge, sn[i, BULGED])
    if tangential > ACROSS * h + turn or abs(a) > best + bulge:
        return True
    return sn.shape[1] > PLAIN and beside(v, a, sn, i, turn)


@inner(fastmath=FAST, error_model="numpy")
def off_cells(v, sn, i, best):
    """Whether a point at v from the seed i is farther than `best` from the cells around that."""
    reach = best + sn[i, SAGITTA]
    for k in range(3):
        b0, b1, b2 = sn[i, PLAIN + 3 * k], sn[i, PLAIN + 3 * k + 1], sn[i, PLAIN + 3 * k + 2]
        out = abs(b0 * v[0] + b1 * v[1] + b2 * v[2]) - AROUND
        if out > 0.0 and out * out > reach * reach * (b0 * b0 + b1 * b1 + b2 * b2):
            return True
    return False


@inner(fastmath=FAST, error_model="numpy")
def beside(v, a, sn, i, turn):
    """Whether a point at v from the seed i, a of that along its normal, is beside its cell."""
    t = (v[0] - a * sn[i, 0], v[1] - a * sn[i, 1], v[2] - a * sn[i, 2])
    for k in range(3):
        b0, b1, b2 = sn[i, PLAIN + 3 * k], sn[i, PLAIN + 3 * k + 1], sn[i, PLAIN + 3 * k + 2]
        room = AROUND + (turn + sn[i, SAGITTA]) * np.sqrt(b0 * b0 + b1 * b1 + b2 * b2)
        if abs(b0 * t[0] + b1 * t[1] + b2 * t[2]) > room:
            return True
    return False


@inner(fastmath=FAST, error_model="numpy")
def row_near(a, i, j, y, h):
    """Whether the point a[i, j:j+3] is within h of y."""
    d0, d1, d2 = a[i, j] - y[0], a[i, j + 1] - y[1], a[i, j + 2] - y[2]
    return d0 * d0 + d1 * d1 + d2 * d2 < h * h


@inner(fastmath=FAST, error_model="numpy")
def tile_index(geom, axis, p):
    """Number of the tile of a coordinate; the upper end of the domain belongs to the last one."""
    if geom[CLOSED + axis] == 0.0 and p == geom[TILES + axis]:
        return p - 1.0
    return np.floor(p)


@inner(fastmath=FAST, error_model="numpy")
def across(geom, p, q):
    """Whether a crease may lie between p and q: they are in different tiles, which have creases."""
    if geom[CREASED] == 0.0:
        return False
    for a in range(3):
        if tile_index(geom, a, p[a]) != tile_index(geom, a, q[a]):
            return True
    return False


@inner(fastmath=FAST, error_model="numpy")
def piece(geom, p, room):
    """Bounds of the tile of p, less the upper ones, which belong to the next tile, into `room`."""
    for a in range(3):
        k = tile_index(geom, a, p[a])
        room[0, a] = k
        room[1, a] = k + 1.0 - BELOW


@inner(fastmath=FAST, error_model="numpy")
def ends_between(geom, p, q):
    """Whether one of p and q is beyond an open end of the domain, and the other one on such."""
    if outside(geom, p) == outside(geom, q):
        return False
    for a in range(3):
        if geom[CLOSED + a] == 0.0:
            top = geom[TILES + a]
            if p[a] == 0.0 or p[a] == top or q[a] == 0.0 or q[a] == top:
                return True
    return False


@inner(fastmath=FAST, error_model="numpy")
def together(geom, a, i, b, j):
    """Whether the tile coordinates in rows i and j are too close for two sheets that face alike.

    A foot on a face of the domain does not stand for those beyond it.
    """
    p, q = (a[i, 0], a[i, 1], a[i, 2]), (b[j, 0], b[j, 1], b[j, 2])
    if across(geom, p, q) or ends_between(geom, p, q):
        return False
    return (
        abs(a[i, 0] - b[j, 0]) < APART
        and abs(a[i, 1] - b[j, 1]) < APART
        and abs(a[i, 2] - b[j, 2]) < APART
    )


@inner(fastmath=FAST, error_model="numpy")
def width(sn, s):
    """How wide the patch of the seed s is, for its spacing: less where its normal turns much."""
    bent = sn[s, BENT]
    return 1.0 if bent <= TURN else max(MIN_ALIKE, TURN / bent)


@inner(fastmath=FAST, error_model="numpy")
def alike(geom, sp, sx, sn, a, b, h):
    """Whether the seeds a and b are within h of each other and on the same side of a wall.

    Where the normal turns much over the spacing of b they must be nearer.
    """
    h *= width(sn, b)
    if not row_near(sx, a, 0, (sx[b, 0], sx[b, 1], sx[b, 2]), h) or not together(
        geom, sp, a, sp, b
    ):
        return False
    return sn[a, 0] * sn[b, 0] + sn[a, 1] * sn[b, 1] + sn[a, 2] * sn[b, 2] > ALIKE


@inner(fastmath=FAST, error_model="numpy")
def added(geom, sp, sx, sn, sh, s, out, i, count):
    """Add the seed s to the first `count` in row i of `out`, unless one is alike; how many then."""
    for c in range(count):
        if alike(geom, sp, sx, sn, out[i, c], s, 0.6 * sh[s]):
            return count
    out[i, count] = s
    return count + 1


@inner(fastmath=FAST, error_model="numpy")
def same_cells(sn, s, y, feet, i):
    """Whether the foot in row i is in the cells around the seed s, which is at y."""
    d0, d1, d2 = feet[i, IMAGE] - y[0], feet[i, IMAGE + 1] - y[1], feet[i, IMAGE + 2] - y[2]
    for k in range(3):
        b0, b1, b2 = sn[s, PLAIN + 3 * k], sn[s, PLAIN + 3 * k + 1], sn[s, PLAIN + 3 * k + 2]
        if abs(b0 * d0 + b1 * d1 + b2 * d2) > WIDE:
            return False
    return True


@inner(fastmath=FAST, error_model="numpy")
def same_patch(geom, sp, sx, sn, s, x, feet, i, h):
    """Whether the patch of seed s is that of the foot in row i: near to it, and facing x alike.

    Near is the seed, or the point next to x on its tangent plane. A sheet and the one behind it,
    however near, are seen from different sides.
    """
    if not together(geom, sp, s, feet, i):
        return False
    h *= width(sn, s)
    y = (sx[s, 0], sx[s, 1], sx[s, 2])
    a = (x[0] - y[0]) * sn[s, 0] + (x[1] - y[1]) * sn[s, 1] + (x[2] - y[2]) * sn[s, 2]
    if a * feet[i, MULTIPLIER] < 0.0:
        return False
    if row_near(feet, i, IMAGE, y, min(BESIDE * h, BESIDE_FAR * feet[i, DISTANCE])):
        return True
    foot = (x[0] - a * sn[s, 0], x[1] - a * sn[s, 1], x[2] - a * sn[s, 2])
    near = row_near(feet, i, IMAGE, y, WIDE * h) or row_near(feet, i, IMAGE, foot, PLANE * h)
    if not near:
        return False
    if sn.shape[1] > PLAIN and not same_cells(sn, s, y, feet, i):
        return False
    v = (x[0] - feet[i, IMAGE], x[1] - feet[i, IMAGE + 1], x[2] - feet[i, IMAGE + 2])
    turn = v[0] * sn[s, 0] + v[1] * sn[s, 1] + v[2] * sn[s, 2]
    return (turn if a > 0.0 else -turn) > ALONG * feet[i, DISTANCE]


@inner(fastmath=FAST, error_model="numpy")
def narrowness(sn, s):
    """Shortest side of the cell of the seed s by its longest one, which is its spacing."""
    if sn.shape[1] == PLAIN:
        return 1.0
    low, high = np.inf, 0.0
    for k in range(PLAIN, PLAIN + 9, 3):
        b = sn[s, k] * sn[s, k] + sn[s, k + 1] * sn[s, k + 1] + sn[s, k + 2] * sn[s, k + 2]
        low, high = min(low, b), max(high, b)
    return np.sqrt(low / high) if high > 0.0 else 1.0


@inner(fastmath=FAST, error_model="numpy")
def seed_distance(sx, s, x):
    """Distance of x to seed s."""
    return np.sqrt((x[0] - sx[s, 0]) ** 2 + (x[1] - sx[s, 1]) ** 2 + (x[2] - sx[s, 2]) ** 2)
