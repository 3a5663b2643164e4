"""Constants of compiled quadrature that decide integrals: each fails with a useless value.

Kernels are run as Python, see `as_python`. Bodies are those of which rules are exact. `LEFT_OUT`
says of the other constants that are no whole numbers why they are not here.
"""

import re

import numpy as np
import pytest
from as_python import constants, results_of, write

import ilattice as il
from ilattice.bspline.fit import fit
from ilattice.quadrature import _kernels_thinning as thinning

INF = np.inf


def volume(*polynomials):
    """Volume of what is negative in all polynomials, in one cell, with three points a way."""

    class Solid:
        name, through = "solid", None

        def level_sets(self):
            return tuple(fit(f, degree=2, spans=1) for f in polynomials)

    return il.cutfem.cut(Solid(), 1, domain=[[0] * 3, [1] * 3]).volume(3).integrate()


def is_exact(found, exact):
    assert abs(found - exact) < 1e-9, f"off by {found - exact}"


def balls_are_exact():
    is_exact(volume(lambda p: ((p - 0.5) ** 2).sum(axis=1) - 0.16), 4.0 / 3.0 * np.pi * 0.4**3)


def half_cylinders_are_exact():
    found = volume(lambda p: ((p[:, 1:] - 0.5) ** 2).sum(axis=1) - 0.09, lambda p: p[:, 1] - 0.5)
    is_exact(found, 0.5 * np.pi * 0.09)


def plates_are_exact():
    """An oblique one, of thickness 0.2."""
    is_exact(volume(lambda p: (p @ [0.6, 0.0, 0.8] - 0.7) ** 2 - 0.01), 0.2 / 0.8)


def rules_are_thinned():
    """60 points on an oblique plane: at most 10 keep all moments of degree 2."""
    points = np.random.default_rng(0).random((60, 4)) + 0.1
    points[:, 2] = 0.4 + 0.2 * points[:, 0] - 0.3 * points[:, 1]
    x, y, z = points[:, :3].T
    moments = np.stack([x**0, x, y, z, x * x, y * y, z * z, x * y, x * z, y * z])
    before = moments @ points[:, 3]
    end = thinning.thinned(points, 0, 60, 2, np.zeros(thinning.ROOM))
    assert end <= 10, f"{end} points are left"
    x, y, z = points[:end, :3].T
    moments = np.stack([x**0, x, y, z, x * x, y * y, z * z, x * y, x * z, y * z])
    assert np.abs(moments @ points[:end, 3] - before).max() < 1e-8 * before[0]


CASES = [
    ("_kernels_scratch", "MIN_SLOPE", 0.0, half_cylinders_are_exact, "off by"),
    ("_kernels_scratch", "GAP", 0.1, plates_are_exact, "off by"),
    ("_kernels_scratch", "TINY", 0.0, balls_are_exact, "off by"),
    ("_kernels_quadrics", "QUADRATIC", 0.0, balls_are_exact, "off by"),
    ("_kernels_quadrics", "ROUNDED", INF, balls_are_exact, "off by"),
    ("_kernels_quadrics", "SAME", 1.0, balls_are_exact, "off by"),
    ("_kernels_quadrics", "WIDE", 0.0, balls_are_exact, "off by"),
    ("_kernels_thinning", "KEPT", 0.0, rules_are_thinned, "60 points are left"),
    ("_kernels_thinning", "PIVOT", 0.5, rules_are_thinned, "60 points are left"),
]
#: What is not above, and why.
LEFT_OUT = {
    "_kernels_scratch": {
        "NEAR": "no case known: crossings that are one but for rounding",
        "WELL": "speed: boxes are halved where crossings are not known so well",
        "LEVEL": "no case known: bodies of which rules are exact keep their volumes",
    },
    "_kernels_quadrics": {
        "VANISHING": "a name",
        "RIGHT": "accuracy and speed: what is exact is so for any; angles above are halved",
    },
    "_kernels_pairs": {
        "EVEN CUBIC FLAT": "speed: boxes with two sheets are halved, with the same integrals",
    },
    "_kernels_drive": {"ROUNDING": "no case known: signs that are certain but for it"},
    "_kernels_solid": {"TINY": "no case known"},
    "_kernels_thinning": {},
}


@pytest.mark.parametrize("module", LEFT_OUT)
def test_no_constant_of_kernels_is_forgotten(module):
    left_out = {name for names in LEFT_OUT[module] for name in names.split()}
    held = {name for of, name, *_ in CASES if of == module}
    assert not left_out & held
    assert left_out | held == constants(f"quadrature.{module}", (float,))


@pytest.fixture(scope="module")
def results():
    return results_of(__file__)


@pytest.mark.parametrize("row", range(len(CASES)), ids=lambda i: ".".join(CASES[i][:2]))
def test_a_useless_constant_of_kernels_is_noticed(row, results):
    right, other = results[row]
    assert right == ""
    assert re.search(CASES[row][-1], other)


if __name__ == "__main__":
    write("quadrature", CASES)
