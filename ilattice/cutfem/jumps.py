"""Materials that jump or wave within cells, where splines cannot bend.

Guarantee: what is told is a factor between values that were found, and a part of an energy by means
of them. Non-guarantee: cells are searched along lines, and some of them only: a thin layer between
these is not seen.
"""

import warnings
from collections.abc import Callable
from typing import Any

import numpy as np

from ilattice._typing import FloatArray
from ilattice._validate import read_only
from ilattice.cutfem.sampling import DRAWN, WATCHED, full, layers
from ilattice.errors import PrecisionWarning
from ilattice.quadrature.rules import Quadrature

#: Factor by which a stiffness may jump within a cell without a warning; cells that are searched,
#: steps of the search, and the part of the range that one of them takes where there is a jump.
STEEP, SEARCHED, STEPS, ABRUPT = 1.2, 20, 16, 0.4
#: Root mean square of what is left of a linear course, over the mean, that splines do not follow.
WAVY = 0.15
#: Factor and part lost of a stiffness that neither jumps nor waves within cells.
CALM = read_only(np.array([1.0, 0.0]))


def jump_within_cells(
    rule: Quadrature, values: FloatArray, at: Callable[[FloatArray], FloatArray]
) -> FloatArray:
    """By how much positive values jump or wave within a cell: a factor, and a part that is lost.

    `values` (n,) are those at the points of the rule, `at` gives them at any parameters: the cells
    in which they vary most are searched between the points of the least and the largest one. The
    part is that by which the harmonic mean in a cell is below the one that the rule sees, and so do
    splines that cannot bend there: about what an energy may be off by. `CALM` where none is seen.
    """
    if len(values) < len(rule) or not len(rule):
        return CALM
    return np.maximum(_jump(rule, values, at), _wave(rule, values, at))


def _wave(
    rule: Quadrature, values: FloatArray, at: Callable[[FloatArray], FloatArray]
) -> FloatArray:
    """Largest of both in full cells in which values, or their inverses, are far from linear.

    Points of rules may all lie where a wave is high, or beside a thin soft layer; these do not.
    """
    whole = full(rule)
    if not len(whole):
        return CALM
    some = whole[np.unique(np.linspace(0, len(whole) - 1, WATCHED // 4).astype(int))]
    box = rule.grid.boxes(rule.cells[some])
    t = layers(DRAWN)
    u = box[:, None, :3] + t * box[:, None, 3:]
    found = np.broadcast_to(at(u.reshape(-1, 3)), len(some) * DRAWN).reshape(len(some), DRAWN)
    linear = np.column_stack([np.ones(DRAWN), t])
    off = np.zeros(len(some))
    for v in (found, 1.0 / found):  # stiffness counts across layers, compliance along
        left = v - v @ np.linalg.pinv(linear).T @ linear.T
        off = np.maximum(off, np.sqrt((left**2).mean(axis=1)) / v.mean(axis=1))
    factor = found.max(axis=1) / found.min(axis=1)
    wavy = off > WAVY
    if not wavy.any():
        return CALM
    seen = (rule.integrate_cells(values) / rule.integrate_cells())[some[wavy]]
    one, all_of_them = _lost(found[wavy], seen), _lost(found[wavy].reshape(1, -1), seen.mean())
    return np.array([factor[wavy].max(), max(one, all_of_them)])  # cells may take turns


def _lost(values: FloatArray, seen: Any) -> float:
    """Largest relative distance of the means that rules see from those of rows of values."""
    arithmetic, harmonic = values.mean(axis=1), 1.0 / (1.0 / values).mean(axis=1)
    return float(np.maximum(arithmetic / seen - 1.0, 1.0 - harmonic / seen).max())


def _jump(
    rule: Quadrature, values: FloatArray, at: Callable[[FloatArray], FloatArray]
) -> FloatArray:
    """See `jump_within_cells`."""
    starts = rule.offsets[:-1][np.diff(rule.offsets) > 0]
    ratio = np.maximum.reduceat(values, starts) / np.minimum.reduceat(values, starts)
    worst = np.argsort(-ratio, kind="stable")[:SEARCHED]
    worst = worst[ratio[worst] > STEEP]
    if not len(worst):
        return CALM
    u, ends = rule.points, np.append(starts, len(rule))
    pairs = [
        (b + values[b:e].argmin(), b + values[b:e].argmax())
        for b, e in zip(ends[worst], ends[worst + 1], strict=True)
    ]
    low, high = np.array(pairs).T
    t = np.linspace(0.0, 1.0, STEPS + 1)[:, None]
    line = u[low][:, None] + t * (u[high] - u[low])[:, None]
    found = at(line.reshape(-1, 3)).reshape(len(worst), STEPS + 1)
    steps = np.abs(np.diff(found, axis=1)).max(axis=1)
    jumps = steps > ABRUPT * np.ptp(found, axis=1)
    w, starts = rule.weights, starts.astype(np.int64)
    means = [np.add.reduceat(w * v, starts) for v in (values, 1.0 / values)]
    lost = 1.0 - np.add.reduceat(w, starts) ** 2 / (means[0] * means[1])
    return np.array([ratio[worst][jumps].max(initial=1.0), lost[worst][jumps].max(initial=0.0)])


def warn_of_jump(name: str, jump: FloatArray) -> None:
    """Warn of a material that jumps within cells, see `jump_within_cells`."""
    factor = float(jump[0])
    if factor > STEEP:
        warnings.warn(
            f"{name} jumps or waves by a factor of {factor:.3g} within a cell, where splines "
            "cannot bend; divide the solid by phases= where it jumps, and give a pair, or let it "
            "change over several cells",
            PrecisionWarning,
            stacklevel=5,
        )
