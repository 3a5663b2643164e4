"""Structures that several tests of corner-sharing tetrahedra use."""

from itertools import product

import numpy as np

import ilattice as il

OCTAHEDRON = np.array(
    [(0, 0, 0), (1, 0, 0), (-1, 0, 0), (0, 1, 0), (0, -1, 0), (0, 0, 1), (0, 0, -1)], float
)
EIGHT = [
    (0, a, b, c) if np.linalg.det(OCTAHEDRON[[a, b, c]]) > 0 else (0, b, a, c)
    for a, b, c in product((1, 2), (3, 4), (5, 6))
]


def octahedron(resolution):
    return il.cost.fill(OCTAHEDRON, EIGHT, resolution=resolution).joined()
