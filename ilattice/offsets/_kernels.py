"""Compiled search for closest points over many starts, and the seeds it starts from.

The arguments are those of `_kernels_jets`, seeds those of `_kernels_patches`.

Guarantees: the same result for any number of threads, a status for every query.
Non-guarantee: the foot is the global minimiser only as far as the seeds cover the surface.
"""

import numpy as np

from ilattice._kernels import in_ranges, inner, outer
from ilattice._kernels_tuples import borrowed
from ilattice.offsets._kernels_jets import (
    CLOSED,
    CREASED,
    ENDS,
    FAST,
    cofactor_normal,
    metric,
    scratch,
    tile_jet,
    upright,
)
from ilattice.offsets._kernels_newton import (
    BOUNDARY,
    FAILED,
    FALLBACK,
    OK,
    WORSE,
    Known,
    clamp,
    newton,
    soft_direction,
)
from ilattice.offsets._kernels_patches import (
    CLEAR,
    DISTANCE,
    IMAGE,
    MULTIPLIER,
    across,
    added,
    alike,
    in_reach,
    narrowness,
    outside,
    piece,
    reachable,
    row_near,
    same_patch,
    seed_distance,
    unlikely,
)

#: Queries that a thread takes at once.
CHUNK = 256
#: Where the distance grows this slowly about a foot, compared with a plane, there may be another.
LOOSE = 0.4
#: Tiles whose longest side, cubed, is this many times their volume are squeezed.
SQUEEZED = 10.0
#: Feet so near to each other, in spacings, are one; steps off a loose foot are this part of its
#: distance, or a spacing if that is less.
SAME, ASIDE = 0.05, 0.5
#: Part of the reach of a foot that is loose, or was found on the way: others may be next to it.
LOOSER = 0.05
#: Where the surface is so much nearer by the field at a query than the foot, that is a start, too.
PASSED = 0.5


@inner(fastmath=FAST, error_model="numpy")
def counted(geom, p, box):
    """Whether p lies in the box or, where the surface goes on, in a layer about it."""
    for a in range(3):
        margin = 1e-9 if geom[ENDS + a] != 0.0 else 1.0 + 1e-9
        if p[a] < box[0, a] - margin or p[a] > box[1, a] + margin:
            return False
    return True


@inner(fastmath=FAST, error_model="numpy")
def bounded(geom, box, whole, room):
    """Fill in bounds of an iteration: of the whole box, or where the surface ends with it.

    Returns whether there are any bounds.
    """
    out = False
    for a in range(3):
        held = whole or geom[ENDS + a] != 0.0
        room[0, a] = box[0, a] if held else -np.inf
        room[1, a] = box[1, a] if held else np.inf
        out = out or held
    return out


@inner(fastmath=FAST, error_model="numpy")
def ends_everywhere(geom):
    """Whether there are open directions, and the surface ends with the domain along all of them."""
    some = False
    for a in range(3):
        if geom[CLOSED + a] == 0.0 and geom[ENDS + a] == 0.0:
            return False
        some = some or geom[ENDS + a] != 0.0
    return some


@inner(fastmath=FAST, error_model="numpy")
def tried(geom, sp, sx, sn, idx, row, used, s, h):
    """Whether a start like the seed s has been made; `used` has a bit per candidate."""
    for c in range(idx.shape[1]):
        if used & (1 << c) and alike(geom, sp, sx, sn, idx[row, c], s, h):
            return True
    return False


@inner(fastmath=FAST, error_model="numpy")
def store(feet, i, p, y, dist, lam):
    """Fill a foot row."""
    feet[i, 0], feet[i, 1], feet[i, 2] = p[0], p[1], p[2]
    feet[i, IMAGE], feet[i, IMAGE + 1], feet[i, IMAGE + 2] = y[0], y[1], y[2]
    feet[i, DISTANCE] = dist
    feet[i, MULTIPLIER] = lam


@inner(fastmath=FAST, error_model="numpy")
def wanted(geom, sp, sx, sn, idx, c, x, feet, seconds, i, used, h):
    """Whether candidate c is worth a start, given the feet found so far."""
    s = idx[i, c]
    if same_patch(geom, sp, sx, sn, s, x, feet, i, h):
        return False
    if seconds[i, DISTANCE] < np.inf and same_patch(geom, sp, sx, sn, s, x, seconds, i, h):
        return False
    return not unlikely(x, sx, sn, s, h, feet[i, DISTANCE]) and not tried(
        geom, sp, sx, sn, idx, i, used, s, 0.5 * h
    )


@inner(fastmath=FAST, error_model="numpy")
def slid(geom, orient, m, start, p):
    """Whether an iteration left the domain for p where the map, of jet m, squeezes tiles.

    It may have jumped over a fold, to a foot farther away than the edge of the sheet on the face.
    """
    if not outside(geom, p) or outside(geom, start):
        return False
    g = metric(m)
    longest = max(g[0], g[1], g[2])
    return SQUEEZED * orient * cofactor_normal(m, p)[1] < longest * np.sqrt(longest)


@inner(fastmath=FAST, error_model="numpy")
def accept(space, box, orient, foot, x, q, h, feet, seconds, i, empty, work):
    """File a foot of `newton`: 2 if it is the best now, 1 if not, 0 if it does not count.

    It counts in the box, and, where the surface goes on, on its continuation by one layer of tiles
    as far as that is `upright`.
    """
    geom = space.geom
    p, y, lam, _, _, st = foot
    if st >= FAILED or not counted(geom, p, box) or not reachable(geom, p, q):
        return 0
    dist = np.sqrt((x[0] - y[0]) ** 2 + (x[1] - y[1]) ** 2 + (x[2] - y[2]) ** 2)
    if outside(geom, p) and not upright(space, orient, p, y, dist, work.basis, work.map):
        return 0
    same = row_near(feet, i, IMAGE, y, SAME * h) and not empty
    if empty or dist < feet[i, DISTANCE]:
        if not empty and not same:
            for j in range(8):
                seconds[i, j] = feet[i, j]
        store(feet, i, p, y, dist, lam)
        return 2
    if dist < seconds[i, DISTANCE] and not same:
        store(seconds, i, p, y, dist, lam)
    return 1


@inner(fastmath=FAST, error_model="numpy")
def multi_start(space, seeds, x, q, idx, i, box, orient, tol, feet, seconds, status, work):
    """Best and second-best distinct foot of x over the candidate seeds idx[i].

    Rows i of `feet` and `seconds` (n, 8) receive p (3), y (3), distance and multiplier. Unless
    `status` is FALLBACK they hold feet already, with distances, and those count too. Where tiles
    meet in creases each start stays in its tile, as if there were no other one. Returns the number
    of starts, of iterations, and the status.
    """
    sp, sx, sn, sh = seeds.points, seeds.images, seeds.normals, seeds.spacing
    geom, room = space.geom, work.room
    starts = 0
    iterations = 0
    used = 0
    soft = 1.0
    along = (0.0, 0.0, 0.0)
    creased = geom[CREASED] != 0.0
    ends = ends_everywhere(geom)
    if status == FALLBACK:
        feet[i, DISTANCE] = np.inf
        seconds[i, DISTANCE] = np.inf
    first = first_reachable(geom, sp, sx, sn, idx, i, x, q)
    reach = seed_distance(sx, first, x)
    for a in range(idx.shape[1] + 2):
        # first the seeds, then both ways along a direction in which the best foot is loose
        h = sh[first]
        if a < idx.shape[1]:
            s = idx[i, a]
            if s < 0:  # rows are filled up
                continue
            h = sh[s]
            away = seed_distance(sx, s, x)  # as `in_reach`, which would take it again
            if away > reach + 2.0 * h or away < sn[s, CLEAR]:  # too far, or too near to tell
                continue
            if not reachable(geom, (sp[s, 0], sp[s, 1], sp[s, 2]), q):
                continue
            if status != FALLBACK and not wanted(
                geom, sp, sx, sn, idx, a, x, feet, seconds, i, used, h
            ):  # nearly all end here: one start a patch
                continue
            used |= 1 << a
            start = (sp[s, 0], sp[s, 1], sp[s, 2])
            narrow = narrowness(sn, s)
        else:
            if status == FALLBACK or soft > LOOSE:  # firm: next to it there is no other foot
                break
            s = min(h, ASIDE * feet[i, DISTANCE]) * (1.0 if a == idx.shape[1] else -1.0)
            start = (
                feet[i, 0] + s * along[0], feet[i, 1] + s * along[1], feet[i, 2] + s * along[2],
            )  # fmt: skip
            bounded(geom, box, False, room)
            start = clamp(start, room)
            narrow = 1.0
        whole = ends or creased
        freed = whole
        held = bounded(geom, box, whole, room)
        if creased:  # derivatives jump between tiles: no step may cross
            piece(geom, start, room)
        while True:
            firm = narrow if soft > LOOSE and status == OK else LOOSER
            if status != FALLBACK and across(geom, start, (feet[i, 0], feet[i, 1], feet[i, 2])):
                firm = 0.0
            foot = newton(space, x, start, known_foot(feet, i, firm), held, h, tol, work)
            p, _, lam, low, n, st = foot
            starts += 1
            iterations += n
            filed = accept(
                space, box, orient, foot, x, q, h, feet, seconds, i, status == FALLBACK, work
            )
            if filed == 2:
                status = st
                soft = low
                if low <= LOOSE:
                    along = soft_direction(work.map, work.tile, x, lam, low, (0, 0, 0))
            if whole and not freed and filed == 2 and st == BOUNDARY:
                # the sheet may go on behind the face
                freed, whole, start = True, False, p
                held = bounded(geom, box, False, room)
                continue
            if whole or ((filed > 0 or st >= WORSE) and not slid(geom, orient, work.map, start, p)):
                break
            # where the continuation folds or ends, the sheet ends at the face
            whole = held = bounded(geom, box, True, room)
            start = clamp(start, box)
    if status == FALLBACK:  # something to compare with, and told as no foot
        p = (sp[first, 0], sp[first, 1], sp[first, 2])
        store(feet, i, p, (sx[first, 0], sx[first, 1], sx[first, 2]), reach, 0.0)
    return starts, iterations, status


@inner(fastmath=FAST, error_model="numpy")
def known_foot(feet, i, reach):
    """The foot in row i, see `Known`."""
    image = (feet[i, IMAGE], feet[i, IMAGE + 1], feet[i, IMAGE + 2])
    return Known(image, feet[i, DISTANCE], feet[i, MULTIPLIER], reach)


@inner(fastmath=FAST, error_model="numpy")
def first_reachable(geom, sp, sx, sn, idx, row, x, q):
    """Nearest candidate that counts for the query x, q, or the nearest one."""
    for a in range(idx.shape[1]):
        s = idx[row, a]
        if in_reach(geom, sp, sx, sn, s, x, q):
            return s
    return idx[row, 0]


@in_ranges(512)
@outer(nogil=True, fastmath=FAST, error_model="numpy")
def spread(first, last, geom, sp, sx, sn, sh, x, q, best, idx, out):
    """Thin out candidates idx (n, m), nearest first: those that count, one per patch; out (n, k).

    Those that cannot hold a foot nearer than `best` (n,) are left out. Rows of `out` are filled up
    with -1; the nearest seed stands where none is left.
    """
    for i in range(first, last):
        xi, qi = (x[i, 0], x[i, 1], x[i, 2]), (q[i, 0], q[i, 1], q[i, 2])
        count = 0
        for a in range(idx.shape[1]):
            s = idx[i, a]
            if not in_reach(geom, sp, sx, sn, s, xi, qi) or (
                best[i] < np.inf and unlikely(xi, sx, sn, s, sh[s], best[i])
            ):
                continue
            count = added(geom, sp, sx, sn, sh, s, out, i, count)
            if count == out.shape[1]:
                break
        for c in range(count, out.shape[1]):
            out[i, c] = -1
        if count == 0:
            out[i, 0] = idx[i, 0]


@inner(fastmath=FAST, error_model="numpy")
def passed(t, q, feet, i):
    """Whether the field, of jet t at the query q, tells of a surface much nearer than the foot."""
    slope = t[1] * t[1] + t[2] * t[2] + t[3] * t[3]
    d0, d1, d2 = feet[i, 0] - q[0], feet[i, 1] - q[1], feet[i, 2] - q[2]
    return t[0] * t[0] < PASSED * PASSED * slope * (d0 * d0 + d1 * d1 + d2 * d2)


@inner(fastmath=FAST, error_model="numpy")
def from_query(space, x, q, h, box, orient, tol, feet, seconds, i, work):
    """Start from the query itself: iterations, and the status of the foot if it is the best."""
    geom, room = space.geom, work.room
    held = bounded(geom, box, geom[CREASED] != 0.0, room)
    if geom[CREASED] != 0.0:
        piece(geom, q, room)
    foot = newton(space, x, q, known_foot(feet, i, LOOSER), held, h, tol, work)
    filed = accept(space, box, orient, foot, x, q, h, feet, seconds, i, False, work)
    return foot[4], foot[5] if filed == 2 else FAILED


@in_ranges(CHUNK)
@outer(nogil=True, fastmath=FAST, error_model="numpy")
def closest(first, last, space, seeds, x, q, idx, box, orient, tol, feet, seconds, counts, status):
    """Foot points of many queries.

    Parameters
    ----------
    first, last
        Which queries.
    space, seeds
        The lattice, and its seeds, see the module.
    x, q
        Queries in space and in tile coordinates, (n, 3).
    idx
        Candidate seeds, nearest first, (n, K), K <= 60; -1 ends a row.
    box, orient, tol
        The domain (2, 3), sign of det J, tolerance.
    feet, seconds
        Output (n, 8): foot p, foot in space, distance with the sign of I(q), multiplier.
    counts
        Output (n, 2): starts and iterations are added.
    status
        Output (n,). On entry FALLBACK, or the status of known feet, which are then improved on.
    """
    space, seeds = borrowed(space), borrowed(seeds)
    work = scratch(space)
    t = work.tile
    for i in range(first, last):
        xi = (x[i, 0], x[i, 1], x[i, 2])
        qi = (q[i, 0], q[i, 1], q[i, 2])
        feet[i, DISTANCE] = abs(feet[i, DISTANCE])
        seconds[i, DISTANCE] = abs(seconds[i, DISTANCE])
        starts, iterations, st = multi_start(
            space, seeds, xi, qi, idx, i, box, orient, tol, feet, seconds, status[i], work
        )
        tile_jet(space, qi, work.basis, t, work.table)
        value = t[0]
        if st != FALLBACK and passed(t, qi, feet, i):
            n, own = from_query(
                space, xi, qi, seeds.spacing[idx[i, 0]], box, orient, tol, feet, seconds, i, work
            )
            starts += 1
            iterations += n
            st = own if own != FAILED else st
        counts[i, 0] += starts
        counts[i, 1] += iterations
        status[i] = st
        if value < 0.0:
            feet[i, DISTANCE] = -feet[i, DISTANCE]
            seconds[i, DISTANCE] = -seconds[i, DISTANCE]
        elif value == 0.0:
            feet[i, DISTANCE] = 0.0
