"""Smooth displacements and temperatures, with the forces and sources that cause them.

Young's modulus 1, Poisson's ratio 0.3, conductivity 1; in space, so that they suit any solid.
"""

import numpy as np

import ilattice as il
from ilattice.errors import GeometryError

LAM, MU = 0.3 / (1.3 * 0.4), 1 / 2.6


def ball(u, r=0.8123):
    return (u**2).sum(axis=1) - r * r


def sheet(n):
    """A part of the gyroid's sheet, in a box of edge 1, at least 0.65 n cells thick."""
    gyroid, box = il.tiles["gyroid"], il.macroshape.box((5.0, 5.0, 5.0))
    sides = (lambda u: gyroid(u) - 0.6, lambda u: -gyroid(u) - 0.6)
    return il.cutfem.cut(sides, n, domain=[[0.125] * 3, [0.325] * 3], through=box)


def interior_facets(domain):
    """Places that the solid reaches, the surface last."""
    out = []
    for place in ("u=0", "u=1", "v=0", "v=1", "w=0", "w=1", "surface"):
        try:
            domain.boundary(place)
        except GeometryError:
            continue
        out.append(place)
    return out


def exact(x):
    X, Y, Z = x.T
    return np.stack([0.1 * np.sin(X) * Y, 0.2 * np.cos(Y) * Z, 0.1 * X * Z], axis=1)


def slope_of(x):
    X, Y, Z = x.T
    g = np.zeros((len(x), 3, 3))
    g[:, 0, 0], g[:, 0, 1] = 0.1 * np.cos(X) * Y, 0.1 * np.sin(X)
    g[:, 1, 1], g[:, 1, 2] = -0.2 * np.sin(Y) * Z, 0.2 * np.cos(Y)
    g[:, 2, 0], g[:, 2, 2] = 0.1 * Z, 0.1 * X
    return g


def force(x):
    X, Y, Z = x.T
    laplacian = np.stack([-0.1 * np.sin(X) * Y, -0.2 * np.cos(Y) * Z, 0 * X], axis=1)
    divergence = np.stack([0.1 - 0.1 * np.sin(X) * Y, 0.1 * np.cos(X) - 0.2 * np.cos(Y) * Z,
                           -0.2 * np.sin(Y)], axis=1)  # fmt: skip
    return -(MU * laplacian + (LAM + MU) * divergence)


def stress(x):
    g = slope_of(x)
    s = MU * (g + g.transpose(0, 2, 1)) + LAM * np.trace(g, axis1=1, axis2=2)[
        :, None, None
    ] * np.eye(3)
    return s.reshape(-1, 9)[:, [0, 4, 8, 5, 2, 1]]


def traction(x, normals):
    return np.einsum("nij,nj->ni", stress(x)[:, [[0, 5, 4], [5, 1, 3], [4, 3, 2]]], normals)


def temperature(x):
    X, Y, Z = x.T
    return np.sin(X) * np.exp(Y) * (1 + Z**2)


def slope_of_temperature(x):
    X, Y, Z = x.T
    e = np.exp(Y)
    wide = 1 + Z**2
    return np.stack([np.cos(X) * e * wide, np.sin(X) * e * wide, 2 * np.sin(X) * e * Z], axis=1)


def source(x):
    return -2 * np.sin(x[:, 0]) * np.exp(x[:, 1])


def flux(x, normals):
    """Heat that enters per area."""
    return np.einsum("ni,ni->n", slope_of_temperature(x), normals)


def errors_of(solution, value, slope):
    """Errors in the mean square of a solution and of its gradient, over the solid."""
    asm = solution.problem.assembly
    rule = solution.problem.domain.solid(asm)
    square = np.zeros(2)
    for rows, v, g in asm.on_rule(solution.coefficients, rule):
        x, w = rule.points[rows], rule.weights[rows]
        square[0] += w @ ((v - value(x).reshape(v.shape)) ** 2).sum(axis=1)
        square[1] += w @ ((g - slope(x).reshape(g.shape)) ** 2).sum(axis=(1, 2))
    return np.sqrt(square)
