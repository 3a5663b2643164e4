"""Random bodies at random places of the grid: what is off is in the estimate, or warned of.

Sheets, combined solids with holes, two parts close together, and struts. Of 176 bodies drawn like
these on four to six cells, with all degrees, loads and heat, all changed on twice finer cells by
less than twice the estimate. Of 501 before, when it followed the fall of errors on few cells, too,
496 did, and four of the others came with a warning.
"""

import warnings

import numpy as np
import pytest

import ilattice as il

F = il.fields


def unit(rng):
    v = rng.standard_normal(3)
    return v / np.linalg.norm(v)


def sheet(rng, _):
    """A wavy sheet."""
    k, s, t = rng.uniform(1.5, 3.0, 3), rng.uniform(0, 6, 3), rng.uniform(0.4, 0.7)
    sines = (f"sin({k[i]:.4f}*{'xyz'[i]}+{s[i]:.4f})" for i in range(3))
    cosines = (f"cos({k[i - 1]:.4f}*{'xyz'[i - 1]}+{s[i - 1]:.4f})" for i in range(3))
    waves = [f"{a}*{b}" for a, b in zip(sines, cosines, strict=True)]
    return F.intersection(F.equation(f"abs({'+'.join(waves)})-{t:.4f}"), F.box((0.9, 0.9, 1.4)))


def holes(rng, _):
    """A block with a ball and a bore taken away, and a box that is turned added."""
    block = F.box((*rng.uniform(0.5, 0.8, 2), 1.4))
    ball = F.translate(F.sphere(rng.uniform(0.2, 0.4)), tuple(rng.uniform(-0.4, 0.4, 3)))
    a = rng.uniform(-0.5, 0.5, 3)
    bore = F.capsule(tuple(a - 2 * unit(rng)), tuple(a + 2 * unit(rng)), rng.uniform(0.1, 0.2))
    knob = F.translate(F.box(tuple(rng.uniform(0.2, 0.4, 3))), tuple(rng.uniform(-0.5, 0.5, 3)))
    return F.union(F.difference(block, F.union(ball, bore)), F.rotate(knob, 1.0, tuple(unit(rng))))


def two(rng, h):
    """Two columns, one on top of the other, with a gap of one to two cells between."""
    n = np.append(rng.uniform(-0.3, 0.3, 2), 1.0)
    at, gap = rng.uniform(-0.2, 0.2), rng.uniform(1.0, 2.0) * h
    plane = "+".join(f"({c:.6f})*{x}" for c, x in zip(n / np.linalg.norm(n), "xyz", strict=True))
    half = tuple(rng.uniform(0.4, 0.8, 2))
    low = F.intersection(F.box((*half, 1.4)), F.equation(f"{plane}-({at:.6f})"))
    top = F.intersection(F.box((*half, 0.9)), F.equation(f"{at + gap:.6f}-({plane})"))
    return F.union(low, top)


def struts(rng, _):
    """Three struts that stand on the support and meet, and a fourth one."""
    low = rng.uniform(-0.7, 0.7, (3, 3))
    low[:, 2] = -1.4
    top = np.append(rng.uniform(-0.4, 0.4, 2), rng.uniform(0.2, 0.6))
    r = rng.uniform(0.15, 0.3)
    legs = [F.capsule(tuple(p), tuple(top), r * rng.uniform(0.7, 1.3)) for p in low]
    return F.union(*legs, F.capsule(tuple(top), tuple(rng.uniform(-0.8, 0.8, 3)), r))


CASES = [(body, seed) for body in (sheet, holes, two) for seed in range(3)]


@pytest.mark.parametrize(("body", "seed"), [*CASES, (struts, 1)])
def test_finer_cells_change_no_more_than_twice_the_estimate(body, seed):
    rng = np.random.default_rng([16, seed, len(body.__name__)])
    n, degree = rng.integers(4, 6, 3), 1 if seed else 2
    box = np.array([-1 - rng.uniform(0, 0.2, 3), 1 + rng.uniform(0, 0.2, 3)])
    solid, pull = body(rng, float((np.ptp(box, axis=0) / n).max())), rng.standard_normal(3)

    def solved(cells):
        p = il.cutfem.Elasticity(solid, tuple(cells), domain=box, degree=degree)
        p = p.clamp("w=0").spring("surface", 1e-2)
        return p.load(body=lambda x: pull + 0.3 * np.sin(2 * x)).solve()

    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        coarse, fine = solved(n), solved(2 * n)
    off = abs(fine.compliance / coarse.compliance - 1)
    assert off <= 2 * coarse.report.discretization_error


def test_a_fall_that_is_seen_from_one_cell_is_not_believed():
    """Heat in struts that meet, on 3 x 4 x 4 cells: 5.6 % off, where 2.0 % were told."""
    low = [
        (-0.34, -0.192, -1.4),
        (0.075, -0.394, -1.4),
        (0.247, 0.494, -1.4),
        (0.329, -0.184, -1.4),
    ]
    knot, ends = (-0.124, -0.292, 0.377), [(0.32, 0.082, -0.014), (0.183, 0.633, 0.287)]
    radii = (0.543, 0.439, 0.431, 0.577, 0.492, 0.492)
    legs = [F.capsule(p, knot, r) for p, r in zip(low + ends, radii, strict=True)]
    box = [[-1.179, -1.124, -1.059], [1.051, 1.086, 1.17]]

    def solved(k):
        p = il.cutfem.Heat(F.union(*legs), (3 * k, 4 * k, 4 * k), domain=box, degree=1)
        p = p.fix("w=0", 0.0).source(lambda x: 0.203 + 0.3 * np.sin(2 * x[:, 0] + 0.518))
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            s = p.solve()
        return float((s.problem.forces() * s.coefficients).sum()), s.report.discretization_error

    (coarse, told), (fine, _) = solved(1), solved(2)
    assert told > 0.02
    assert 0.04 < fine / coarse - 1.0 <= 2.0 * told


@pytest.mark.parametrize("seed", [46, 66])
def test_a_fast_fall_from_a_tenth_of_the_energy_is_not_believed(seed):
    """Two columns that air cools were three times as far off as was told."""
    rng = np.random.default_rng([1611, seed])
    n = rng.integers(4, 8, 3)
    rng.choice(5), rng.random(2)
    box = np.array([-1 - rng.uniform(0, 0.2, 3), 1 + rng.uniform(0, 0.2, 3)])
    solid, pull = two(rng, float((np.ptp(box, axis=0) / n).max())), rng.standard_normal(3)
    cooling = 0.1 * 10 ** rng.uniform(-3, 1)

    def solved(cells):
        p = il.cutfem.Heat(solid, tuple(cells), domain=box, degree=2)
        p = p.fix("w=0", 0.0).convection("surface", cooling, around=0.0)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            s = p.source(lambda x: pull[0] + 0.3 * np.sin(2 * x[:, 0])).solve()
        return float((s.problem.forces() * s.coefficients).sum()), s.report.discretization_error

    (coarse, told), (fine, _) = solved(n), solved(2 * n)
    assert abs(fine / coarse - 1) <= 2 * told


def test_a_fall_between_cells_that_see_nothing_of_a_hole_is_not_believed():
    """A block with a bore and a hollow of a cell: 0.9 % off, where 0.2 % were told."""
    rng = np.random.default_rng([2513, 16, 40])
    n = rng.integers(4, 7, 3)
    rng.choice(3, p=[0.45, 0.42, 0.13])
    box = np.array([-1 - rng.uniform(0, 0.2, 3), 1 + rng.uniform(0, 0.2, 3)])
    solid, pull = holes(rng, 0.0), rng.standard_normal(3)

    def solved(cells):
        p = il.cutfem.Heat(solid, tuple(cells), domain=box, degree=2).fix("w=0", 0.0)
        p = p.source(lambda x: pull[0] + 0.3 * np.sin(2 * x[:, 0] + pull[1]))
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            s = p.solve()
        return float((s.problem.forces() * s.coefficients).sum()), s.report.discretization_error

    (coarse, told), (fine, _) = solved(n), solved(2 * n)
    assert 8e-3 < abs(fine / coarse - 1) <= 2 * told


def test_a_slow_fall_that_many_cells_see_is_believed():
    """A turned block with a bore of a cell, on 8 x 12 x 12: 1.4 % off, where 0.6 % were told."""
    rng = np.random.default_rng([5201, 16, 15])
    n = rng.integers(8, 13, 3)
    rng.choice(3, p=[0.45, 0.42, 0.13])
    box = np.array([-1 - rng.uniform(0, 0.2, 3), 1 + rng.uniform(0, 0.2, 3)])
    solid, pull = holes(rng, 0.0), rng.standard_normal(3)
    poisson = 0.4 * rng.random(7)[4]
    solid = F.rotate(solid, rng.uniform(-0.35, 0.35), tuple(unit(rng)))

    def solved(cells):
        p = il.cutfem.Elasticity(solid, tuple(cells), domain=box, poisson=poisson).clamp("w=0")
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            s = p.load(body=lambda x: pull + 0.3 * np.sin(2 * x)).solve()
        return s.compliance, s.report.discretization_error

    (coarse, told), (fine, _) = solved(n), solved(2 * n)
    assert 0.012 < fine / coarse - 1 <= 2 * told


@pytest.mark.parametrize("seed", [1, 9, 39, 41, 55, 67])
def test_the_tip_of_a_notch_is_not_told(seed):
    """Bodies of random parts: what is thin in a cell or two, and joined beside it."""
    rng = np.random.default_rng([41, seed])
    n = rng.integers(4, 11, 3)
    box = np.array([-1 - rng.uniform(0, 0.2, 3), 1 + rng.uniform(0, 0.2, 3)])
    solid = (holes, struts)[seed % 4 == 3](rng, 0.0)
    if rng.random() < 0.5:
        angle = rng.uniform(-0.35, 0.35)
        solid = F.rotate(solid, angle, tuple(unit(rng)))
    problem = il.cutfem.Elasticity(solid, tuple(n), domain=box, degree=1)
    assert len(problem.domain.elements.gaps)
    problem.spring("surface", 1.0).load(body=(0, 0, 1)).assembly  # noqa: B018
