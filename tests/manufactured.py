"""A smooth displacement in a ball, with the force that causes it: Young's modulus 1, ratio 0.3."""

import numpy as np

LAM, MU = 0.3 / (1.3 * 0.4), 1 / 2.6


def ball(u, r=0.8123):
    return (u**2).sum(axis=1) - r * r


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
