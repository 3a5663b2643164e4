"""What given functions do between the points at which rules ask them.

Loads, supports and materials may be functions; integrals know them at the points of a rule only.
Here they are asked at others. In full cells and on full end faces these are in every layer, and
the mean of what a polynomial leaves there that follows the function at the points of the rule is
what the integral is off by. In cut cells and on level sets a rule of more points tells that.

Guarantees: in full cells and on full end faces points lie in each of `DRAWN` layers of every
direction, so that a layer along the grid of one part in `DRAWN` of a cell, or more, is met; all
cells are looked at up to `WATCHED`, or to fewer where these hold many points (see `POINTS`). What
is found is the same every time.
Non-guarantee: an estimate, right to a half where a function waves; of more cells half are those
next to which the function changes most, and the others are drawn; in cut cells and on level sets
what lies between the points of both rules passes unseen.
"""

import warnings
from collections.abc import Callable

import numpy as np

from ilattice._typing import AnyArray, FloatArray, IntArray
from ilattice.cutfem.assembly import Assembly
from ilattice.errors import InputError, PrecisionWarning
from ilattice.quadrature.rules import Quadrature, in_space, kept

#: Part of a function that is lost or made up from which it is told, and from which it is refused.
TOLD, USELESS = 0.02, 0.5
#: Cells that are looked at, points in each, and part of a cell that counts as all of it.
WATCHED, DRAWN, FULL = 256, 256, 0.999
#: Points of a rule in the cells that are looked at, of which there are at least so many: cells that
#: hold tiles have tens of thousands of points, and the rules of more points several times as many.
POINTS, MIN_WATCHED = 400_000, 32
#: Part of the largest singular value below which points do not determine a part of a polynomial:
#: many points may have two heights only, but for rounding.
KNOWN = 1e-2
#: Part of the solid in a cell by which two rules may differ.
ALIKE = 0.1

Function = Callable[[FloatArray], FloatArray]
Denser = Callable[[IntArray], Quadrature]


def layers(count: int) -> FloatArray:
    """Points (count, 3) of the unit cube, one in each of `count` layers of every direction."""
    rng = np.random.default_rng(0)
    order = np.stack([rng.permutation(count) for _ in range(3)], axis=1)
    return (order + rng.random((count, 3))) / count


def full(rule: Quadrature) -> IntArray:
    """Positions of the full cells of a volume rule in parameters."""
    held = rule.integrate_cells()
    return np.flatnonzero(held > FULL * rule.grid.boxes(rule.cells)[:, 3:].prod(axis=1))


def check(what: str, part: float) -> None:
    """Warn of a part of a function that is lost or made up, or refuse it.

    Parameters
    ----------
    what : str
        Name in messages.
    part : float
        See `unseen`.

    Raises
    ------
    InputError
        If it is half or more.

    Warns
    -----
    PrecisionWarning
        From 2 % on.
    """
    if part <= TOLD:
        return
    much = f"{what} jumps or waves between the points at which cells ask it: about"
    remedy = "take finer cells, a larger q=, or a smoother function"
    if part >= USELESS:
        raise InputError(f"{much} {100 * part:.0f} % of it would be lost or made up; {remedy}")
    warnings.warn(
        f"{much} {100 * part:.2g} % of it are lost or made up; {remedy}",
        PrecisionWarning,
        stacklevel=6,
    )


def unseen(asm: Assembly, rule: Quadrature, denser: Denser, f: Function) -> float:
    """Estimated error of the integral of a function, as a part of that of its size.

    Parameters
    ----------
    asm : Assembly
        Knows the map.
    rule : Quadrature
        Where it is integrated, in parameters or in space.
    denser : callable
        Takes cells of the grid, returns a rule in space with more points there.
    f : callable
        Takes points of space (n, 3), returns values (n, m).

    Returns
    -------
    float
        Sum over cells of by how much the integrals are off.
    """
    rule = kept(rule, np.diff(rule.offsets) > 0)
    if not len(rule):
        return 0.0
    mark, stands = _watched(asm, rule, f)
    rule, stands = in_space(kept(rule, mark)), stands[mark]
    values = f(rule.points)
    whole = _sizes(asm, rule) > FULL
    off, size = np.zeros(len(whole)), _norms(rule.integrate_cells(np.abs(values)))
    if whole.any():
        full_cells = _in_layers(asm, rule, values, np.flatnonzero(whole), f)
        off[whole], size[whole] = full_cells[0], np.maximum(size[whole], full_cells[1])
    if not whole.all():
        others = _by_denser(rule, values, ~whole, denser, f)
        off[~whole], size[~whole] = others[0], np.maximum(size[~whole], others[1])
    return float(stands @ off) / max(float(stands @ size), 1e-300)


def between(
    asm: Assembly, rule: Quadrature, denser: Denser, f: Function
) -> tuple[FloatArray, FloatArray]:
    """Points between those of a rule, where `unseen` looks, for what is no integral.

    Parameters
    ----------
    asm, rule, denser, f : Assembly, Quadrature, callable, callable
        As in `unseen`.

    Returns
    -------
    u : ndarray, shape (n, 3)
        Parameters.
    weights : ndarray, shape (n,)
        Volume, or area, in space that they stand for.
    """
    rule = kept(rule, np.diff(rule.offsets) > 0)
    if not len(rule):
        return np.zeros((0, 3)), np.zeros(0)
    mark, stands = _watched(asm, rule, f)
    rule, stands = in_space(kept(rule, mark)), stands[mark]
    whole = _sizes(asm, rule) > FULL
    u, weights = np.zeros((0, 3)), np.zeros(0)
    if whole.any():
        u = _layered(rule, np.flatnonzero(whole))[1].reshape(-1, 3)
        weights = np.repeat((stands * rule.integrate_cells())[whole] / DRAWN, DRAWN)
    if not whole.all():
        homes, first = np.unique(rule.grid.home(rule.cells[~whole]), return_index=True)
        fine = denser(homes)
        if len(fine):
            there = np.searchsorted(homes, fine.cells)[fine.owners]
            assert fine.parameters is not None
            u = np.concatenate([u, fine.parameters])
            weights = np.append(weights, fine.weights * stands[~whole][first][there])
    return u, weights


def _norms(values: FloatArray) -> FloatArray:
    return np.asarray(np.linalg.norm(values, axis=1))


def _watched(asm: Assembly, rule: Quadrature, f: Function) -> tuple[AnyArray, FloatArray]:
    """Which cells are looked at, and for how many cells each stands."""
    count = len(rule.cells)
    mark, stands = np.ones(count, bool), np.ones(count)
    watched = int(np.clip(POINTS * count / len(rule), MIN_WATCHED, WATCHED))
    if count <= watched:
        return mark, stands
    middle = rule.offsets[:-1] + np.diff(rule.offsets) // 2
    x = rule.points[middle]
    steps = np.abs(np.diff(f(x if rule.parameters is not None else asm.x(x)), axis=0)).sum(axis=1)
    change = np.maximum(np.append(steps, 0.0), np.append(0.0, steps))
    first = np.argsort(-change, kind="stable")
    rest = np.sort(first[watched // 2 :])
    drawn = rest[np.unique(np.linspace(0, len(rest) - 1, watched // 2).astype(int))]
    stands[drawn] = len(rest) / len(drawn)
    mark[rest] = False
    mark[drawn] = True
    return mark, stands


def _sizes(asm: Assembly, rule: Quadrature) -> FloatArray:
    """Part (cells,) of the cell, or of its face on an end face, that a rule in space covers."""
    assert rule.parameters is not None
    J = asm.jacobians(rule.parameters)
    box = rule.grid.boxes(rule.cells)[:, 3:]
    if rule.normals is None:
        scale = np.broadcast_to(np.abs(np.linalg.det(J)), len(rule))
        return rule.integrate_cells(1.0 / scale) / box.prod(axis=1)
    flat = _flat(rule)
    if flat is None:
        return np.zeros(len(rule.cells))
    a, b = (J[:, :, k] for k in range(3) if k != flat)
    scale = np.broadcast_to(np.linalg.norm(np.cross(a, b), axis=1), len(rule))
    return rule.integrate_cells(1.0 / scale) / np.delete(box, flat, axis=1).prod(axis=1)


def _flat(rule: Quadrature) -> int | None:
    """Direction in which all parameters of a surface rule are the same, if there is one."""
    assert rule.parameters is not None
    same = np.ptp(rule.parameters, axis=0) == 0.0
    return int(np.argmax(same)) if same.any() and rule.normals is not None else None


def _layered(rule: Quadrature, cells: IntArray) -> tuple[FloatArray, FloatArray]:
    """Points (DRAWN, 3) of the unit cube, and (cells, DRAWN, 3) in full cells or on their faces."""
    assert rule.parameters is not None
    box, flat = rule.grid.boxes(rule.cells[cells]), _flat(rule)
    t = layers(DRAWN)
    u = box[:, None, :3] + t * box[:, None, 3:]
    if flat is not None:
        t[:, flat], u[:, :, flat] = 0.5, rule.parameters[0, flat]
    return t, u


def _in_layers(
    asm: Assembly, rule: Quadrature, values: FloatArray, cells: IntArray, f: Function
) -> tuple[FloatArray, FloatArray]:
    """By how much integrals over full cells, by position, are off; and of the size."""
    assert rule.parameters is not None
    t, u = _layered(rule, cells)
    box, flat = rule.grid.boxes(rule.cells[cells]), _flat(rule)
    found = f(asm.x(u.reshape(-1, 3))).reshape(len(cells), DRAWN, -1)
    total = rule.integrate_cells()[cells]
    off = np.empty(len(cells))
    known: dict[tuple[int, bytes], tuple[FloatArray, FloatArray, FloatArray]] = {}
    for k, cell in enumerate(cells):
        at = slice(rule.offsets[cell], rule.offsets[cell + 1])
        here = (rule.parameters[at] - box[k, :3]) / box[k, 3:]
        if flat is not None:
            here[:, flat] = 0.5
        key = (len(here), np.round(here, 9).tobytes())
        if key not in known:
            A = _monomials(here, _degree(len(here), flat is not None))
            known[key] = (
                A,
                np.asarray(np.linalg.pinv(A, KNOWN), np.float64),
                _monomials(t, _degree(len(here), flat is not None)),
            )
        A, inverse, B = known[key]
        fit = inverse @ values[at]
        left, new = values[at] - A @ fit, found[k] - B @ fit
        gap = np.linalg.norm(new.mean(axis=0) - rule.weights[at] @ left / total[k])
        noise = np.linalg.norm(new.std(axis=0)) / np.sqrt(DRAWN)
        off[k] = gap * gap / max(np.hypot(gap, noise), 1e-300)
    return total * off, total * _norms(np.abs(found).mean(axis=1))


def _by_denser(
    rule: Quadrature, values: FloatArray, cells: AnyArray, denser: Denser, f: Function
) -> tuple[FloatArray, FloatArray]:
    """By how much integrals over the cells that are marked are off; and of the size."""
    homes, at, counts = np.unique(
        rule.grid.home(rule.cells[cells]), return_inverse=True, return_counts=True
    )
    known, wanted = np.zeros((2, len(homes), 1 + values.shape[1]))
    size = np.zeros((len(homes), values.shape[1]))
    np.add.at(known[:, 0], at, rule.integrate_cells()[cells])
    np.add.at(known[:, 1:], at, rule.integrate_cells(values)[cells])
    fine = denser(homes)
    if len(fine):
        given, there = f(fine.points), np.searchsorted(homes, fine.cells)
        wanted[there, 0] = fine.integrate_cells()
        wanted[there, 1:] = fine.integrate_cells(given)
        size[there] = fine.integrate_cells(np.abs(given))
    alike = np.abs(known[:, 0] - wanted[:, 0]) < ALIKE * known[:, 0]  # all of the cell is held
    off = np.where(alike, _norms(known[:, 1:] - wanted[:, 1:]) / counts, 0.0)
    return off[at], np.where(alike, _norms(size) / counts, 0.0)[at]


def _degree(count: int, flat: bool) -> int:
    """Largest degree, up to 3, of polynomials that points determine."""
    sizes = (1, 3, 6, 10) if flat else (1, 4, 10, 20)
    return max(d for d in range(4) if sizes[d] <= max(count, 1))


def _monomials(t: FloatArray, degree: int) -> FloatArray:
    """Products (n, ...) of coordinates, centred, up to a total degree."""
    p = [(2.0 * t - 1.0) ** k for k in range(degree + 1)]
    powers = [
        (a, b, c)
        for a in range(degree + 1)
        for b in range(degree + 1 - a)
        for c in range(degree + 1 - a - b)
    ]
    return np.stack([p[a][:, 0] * p[b][:, 1] * p[c][:, 2] for a, b, c in powers], axis=1)
