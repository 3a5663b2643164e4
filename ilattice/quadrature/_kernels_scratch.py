"""Scratch of the kernels for rules, tables of signs, and what they have in common.

All scratch is one array of numbers and one of integers, made once per chunk, in which everything
has the place that is named here: arrays as arguments cost counted references, which would take as
long as the work itself.

The solid is where the signs of the polynomials are such that a table says so: bit b of it is that
of the points where just the polynomials of the ones in b are negative.

Guarantee: tables do not depend on polynomials that are not there.
"""

from typing import Any

from ilattice._kernels import inner

CAP = 24  # levels of halving of a box, and of its base
MIN_SLOPE = 0.05  # least slope along the height, as a part of the largest slope
GAP = 1e-14  # intervals below this are dropped
NEAR = 1e-11  # crossings that are closer are one
WELL = 1e-4  # error of crossings that are well known, as a part of the values there
MAX_CROSSINGS = 1900  # of one line with all surfaces and seams
DEEP = 8  # levels of halving of a base for the sake of seams
VOLUME, SURFACE = 1, 2  # what is wanted
UNIT = 1 << 17  # length of a piece of splines, or of a cell with boxes of its own

MAX_SETS = 6  # polynomials
#: Polynomials on a base: faces, and seams of pairs.
SLOTS = 2 * MAX_SETS + MAX_SETS * (MAX_SETS - 1) // 2
#: Bits of a table in which polynomial k is not negative.
LOW = (
    0x5555555555555555, 0x3333333333333333, 0x0F0F0F0F0F0F0F0F, 0x00FF00FF00FF00FF,
    0x0000FFFF0000FFFF, 0x00000000FFFFFFFF,
)  # fmt: skip

# Places in the scratch Z of numbers, for coefficients up to degree 4
NODES, WEIGHTS, SOFT_NODES, SOFT_WEIGHTS = 0, 10, 20, 30
SITES, INVERSE = 40, 45  # of interpolation, and the matrix from values to coefficients
X, LO, EXT, FLAT, TOL = 70, 73, 76, 79, 83  # tolerances of polynomials, then of seams
B, D, SPANS = 106, 111, 116  # SPANS: [axis, polynomial, end], 3 x SLOTS x 2
ROW = 2 * SLOTS  # of SPANS
UPRIGHT, ALONG, CROSS = 278, 310, 430  # breakpoints in three directions
STACK, TEMP = 2430, 2724
SEAM = 2732  # values of a seam at the sites, or one row of them
PLANES, LINES = 2762, 3062  # of MAX_SETS each: values and slopes, values and two slopes
LINE = 3212  # SLOTS lines on a base
PARTS = 3347  # (CAP + 2) x [lower corner, extent, halvings, those of parts with a direction]
PART, HALVED, DIRECTED = 6, 4, 5  # numbers of a part of a base, and the places of the last two
BOXES = PARTS + (CAP + 2) * PART  # (CAP + 2) x the same, in three dimensions
BOX, BOX_HALVED, BOX_DIRECTED = 8, 6, 7  # the same of a box
FACES = BOXES + (CAP + 2) * BOX  # (CAP + 2) x SLOTS faces
TENSORS = FACES + (CAP + 2) * SLOTS * 25  # (CAP + 2) x tensors; the last, see `numbers`

# Places in the scratch N of whole numbers
ACTIVE, UP, NAMES = 0, 6, 12
CUT_FACES, OWNERS, SENSE = 18, 45, 72
N_VOLUME, N_SURFACE, UNSURE = 99, 100, 101  # rows written, whether any sign is not certain
TABLE, SEAMS = 102, 103  # of the present box, and how many pairs of polynomials cross there
PROJECT, CURVES = 104, 105  # whether crossings are looked for on all bases, and on the present one
EMIT = 106  # bits of the polynomials whose feet are wanted
INTEGERS = 107
TINY = 1e-15  # coefficients below this part of the largest count as zero; see `set_tolerances`
WEIGHT, NORMAL, SET = 3, 4, 7  # columns of a point of a rule, behind its place
LEVEL = 1e-9  # slopes below this part of the largest count as zero: rounding tilts no face


@inner(error_model="numpy")
def numbers(m: int, L: Any) -> int:
    """Length of the scratch of numbers for m polynomials."""
    return TENSORS + (CAP + 2) * m * len(L) ** 3


@inner(error_model="numpy")
def all_negative(table: int, N: Any, n: int) -> bool:
    """Whether a table asks for negative signs of the n active polynomials."""
    wanted = -1
    for i in range(n):
        wanted &= ~LOW[N[ACTIVE + i]]
    return bool(wanted == table)


@inner(error_model="numpy")
def with_sign(table: int, k: int, negative: bool) -> int:
    """A table where the sign of polynomial k is certain."""
    half = (table >> (1 << k) if negative else table) & LOW[k]
    return half | (half << (1 << k))
