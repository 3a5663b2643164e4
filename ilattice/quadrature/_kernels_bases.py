"""Rules on a box in columns along one direction in which all active polynomials are monotone.

Where zero sets of two polynomials cross, their seam is projected to the base and divides it (see
`_kernels_crossings`).

Guarantees: as those of the columns. Non-guarantees: columns with a vertical tangent are accepted at
the asked depth, and then are of lower order.
"""

from typing import Any

import numpy as np

from ilattice._kernels import inner
from ilattice.bspline._kernels_bernstein import bend, extremes, halve, slopes, straight
from ilattice.quadrature._kernels_columns import strips
from ilattice.quadrature._kernels_crossings import crossing, least_slope, may_cross, steepest
from ilattice.quadrature._kernels_pairs import has_pairs
from ilattice.quadrature._kernels_scratch import (
    ACTIVE,
    CAP,
    CURVES,
    CUT_FACES,
    DEEP,
    DIRECTED,
    FACES,
    FLAT,
    HALVED,
    MAX_SETS,
    MIN_SLOPE,
    OWNERS,
    PART,
    PARTS,
    PROJECT,
    ROW,
    SEAMS,
    SENSE,
    SLOTS,
    SPANS,
    TABLE,
    TOL,
    all_negative,
)


@inner(error_model="numpy")
def best_axis(Z: Any, N: Any, axes: int, n: int, which: int, up: int, flat: bool) -> Any:
    """Direction in which n polynomials are monotone, and how steep they are there.

    With `flat` those that do not depend on it do not matter.

    Their least and largest differences are in SPANS; polynomial i has the tolerance
    Z[TOL + N[which + i]], and the sense N[up + i] along the direction. That is -1 if none will do.
    """
    best = -1
    score = -1.0
    for axis in range(axes):
        worst = 2.0
        for i in range(n):
            low = Z[SPANS + axis * ROW + i * 2]
            high = Z[SPANS + axis * ROW + i * 2 + 1]
            eps = least_slope(Z, i, axes, Z[TOL + N[which + i]])
            if max(-low, high) <= eps:
                worst = worst if flat else -1.0
            elif low < -eps and high > eps:
                worst = -1.0
            elif worst >= 0.0:
                top = steepest(Z, i, axes)
                worst = min(worst, max(max(low, -high), 0.0) / top)
        if worst > score:
            best = axis
            score = worst
    if best >= 0:
        for i in range(n):
            at = SPANS + best * ROW + i * 2
            N[up + i] = 1 if Z[at + 1] > -Z[at] else -1
    return best, score


@inner(error_model="numpy")
def first_part(Z: Any) -> None:
    """The whole base as the only part of it."""
    for i in range(PART):
        Z[PARTS + i] = 1.0 if i == 2 or i == 3 else 0.0


@inner(error_model="numpy")
def first_faces(Z: Any, N: Any, at: int, n: int, e0: int, L: Any) -> None:
    """The two faces across e0 of all active tensors."""
    P = len(L)
    u = 1 if e0 == 0 else 0
    v = 1 if e0 == 2 else 2
    step1 = P ** (2 - u)
    step2 = P ** (2 - v)
    for k in range(n):
        for side in range(2):
            c = at + N[ACTIVE + k] * P * P * P + side * (P - 1) * P ** (2 - e0)
            f = FACES + (2 * k + side) * P * P
            for i in range(P):
                for j in range(P):
                    Z[f + i * P + j] = Z[c + i * step1 + j * step2]


@inner(error_model="numpy")
def face_pairs(Z: Any, N: Any, here: int, n_faces: int, L: Any) -> int:
    """Direction along which all cut faces are steep, or have two well parted roots; or -1.

    Least and largest differences are in SPANS.
    """
    square = len(L) * len(L)
    for axis in range(2):
        good = True
        for j in range(n_faces):
            low = Z[SPANS + axis * ROW + j * 2]
            high = Z[SPANS + axis * ROW + j * 2 + 1]
            c, eps = here + N[CUT_FACES + j] * square, Z[TOL + N[OWNERS + j]]
            steep = max(low, -high) >= MIN_SLOPE * steepest(Z, j, 2)
            good = good and (steep or has_pairs(Z, c, axis, eps, L))
        if good:
            return axis
    return -1


@inner(error_model="numpy")
def face_axis(Z: Any, N: Any, here: int, n_faces: int, L: Any) -> Any:
    """Direction in which all cut faces are monotone, or -1, and whether they are steep there.

    Or along which they have two well parted roots.

    Where faces of different polynomials vanish together their crossing must be well known.
    """
    P = len(L)
    square = P * P
    for j in range(n_faces):
        c = here + N[CUT_FACES + j] * square
        for k in range(2):
            step = P if k == 0 else 1
            low, high = slopes(Z, c, step, P + 1 - step, 0, 1, L)
            Z[SPANS + k * ROW + j * 2] = low
            Z[SPANS + k * ROW + j * 2 + 1] = high
    axis, score = best_axis(Z, N, 2, n_faces, OWNERS, SENSE, False)
    if axis < 0 and N[PROJECT]:
        axis, score = best_axis(Z, N, 2, n_faces, OWNERS, SENSE, True)
    good = score >= MIN_SLOPE
    if axis < 0:
        axis = face_pairs(Z, N, here, n_faces, L)
        good = axis >= 0
    for i in range(n_faces):
        for j in range(i):
            if good and may_cross(Z, N, here, i, j, L):
                good = N[CURVES] == 1 and crossing(Z, N, here, i, j, axis == 1, L)
    return axis, good


@inner(error_model="numpy")
def halve_base(Z: Any, N: Any, level: int, used: int, n_faces: int, directed: bool, L: Any) -> None:
    """Halve a part of a base along its most curved direction: upper half here, lower above."""
    P = len(L)
    square = P * P
    here = FACES + level * SLOTS * square
    cut = 0
    top = 0.0
    for j in range(n_faces):
        c = here + N[CUT_FACES + j] * square
        for k in range(2):
            step = P if k == 0 else 1
            size = bend(Z, c, step, P + 1 - step, 0, 1, L)
            if size > top * (1.0 + 1e-9):
                top = size
                cut = k
    step = P if cut == 0 else 1
    for f in range(used):
        c = here + f * square
        halve(Z, c, c + SLOTS * square, step, P + 1 - step, 0, 1, L)
    part = PARTS + PART * level
    Z[part + HALVED] += 1.0
    if directed:
        Z[part + DIRECTED] += 1.0
    Z[part + 2 + cut] *= 0.5
    for i in range(PART):
        Z[part + PART + i] = Z[part + i]
    Z[part + cut] += Z[part + 2 + cut]


@inner(error_model="numpy")
def base(
    Z: Any,
    N: Any,
    volume: Any,
    surface: Any,
    at: int,
    n: int,
    e0: int,
    soft: bool,
    crowd: bool,
    accept: int,
    want: int,
    q: int,
    L: Any,
) -> None:
    """Rules on a box in columns along e0; halves the base where no direction of it will do."""
    P = len(L)
    square = P * P
    first_faces(Z, N, at, n, e0, L)
    first_part(Z)
    simple = all_negative(N[TABLE], N, n)
    used = 2 * n + N[SEAMS]
    N[CURVES] = 1 if N[PROJECT] or N[SEAMS] or n > 2 or not simple else 0
    level = 0
    while level >= 0:
        here = FACES + level * SLOTS * square
        part = PARTS + PART * level
        n_faces = 0
        empty = False
        for k in range(n):
            eps = Z[TOL + N[ACTIVE + k]]
            lowest = np.inf
            for side in range(2):
                least, most = extremes(Z, here + (2 * k + side) * square, square)
                lowest = min(lowest, least)
                # Columns change sort only where one changes sign at their ends.
                if least < -eps and most > eps:
                    N[CUT_FACES + n_faces] = 2 * k + side
                    N[OWNERS + n_faces] = N[ACTIVE + k]
                    n_faces += 1
            # Monotone ones are least at the ends: negative nowhere if they are not so there.
            empty = empty or (lowest >= -eps and simple and not crowd)
        flat = n_faces
        for k in range(N[SEAMS]):
            least, most = extremes(Z, here + (2 * n + k) * square, square)
            # A seam beside this part divides nothing of it.
            if least < -Z[TOL + MAX_SETS + k] and most > Z[TOL + MAX_SETS + k]:
                N[CUT_FACES + n_faces] = 2 * n + k
                N[OWNERS + n_faces] = MAX_SETS + k
                n_faces += 1
        axis = 0
        good = True
        # Without curves any direction of lines will do, and without solid there are none.
        if n_faces and not empty:
            axis, good = face_axis(Z, N, here, n_faces, L)
            if axis < 0 and flat < n_faces and Z[part + HALVED] >= DEEP:
                n_faces = flat  # a seam that turns back is not worth more
                if n_faces:
                    axis, good = face_axis(Z, N, here, n_faces, L)
                axis = max(axis, 0) if n_faces == 0 else axis
            # Smaller parts are straighter; those with a direction are halved `accept` times only.
            if not good and (axis < 0 or Z[part + DIRECTED] < accept) and Z[part + HALVED] < CAP:
                halve_base(Z, N, level, used, n_faces, axis >= 0, L)
                level += 1
                continue
        if not empty:
            for i in range(4):
                Z[FLAT + i] = Z[part + i]
            rooted = soft  # where lines end like square roots
            for j in range(n_faces):
                # Where curves are steep or straight, lines do not end like square roots.
                if not good and not rooted:
                    c = here + N[CUT_FACES + j] * square
                    rooted = not straight(Z, c, P, 1, 0, 1, Z[TOL + N[OWNERS + j]], L)
            strips(Z, N, volume, surface, at, n, here, n_faces, e0, axis == 1, rooted,
                   crowd or not simple, want, q, L)  # fmt: skip
        level -= 1
