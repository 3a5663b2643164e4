"""Frames of rigidly joined Euler beams, by the textbook: six freedoms per vertex, no shear."""

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.linalg import splu


def stiffness(axis, length, r, young, poisson):
    """Stiffness (12, 12) of a round beam: displacement and rotation of one end, then the other."""
    area, bend = np.pi * r**2, np.pi * r**4 / 4.0
    twist = young / (2.0 * (1.0 + poisson)) * 2.0 * bend / length
    k = np.zeros((12, 12))
    for at, value in ((0, young * area / length), (3, twist)):
        k[np.ix_([at, at + 6], [at, at + 6])] = value * np.array([[1, -1], [-1, 1]])
    flex = young * bend / length**3
    own = flex * np.array([
        [12, 6 * length, -12, 6 * length],
        [6 * length, 4 * length**2, -6 * length, 2 * length**2],
        [-12, -6 * length, 12, -6 * length],
        [6 * length, 2 * length**2, -6 * length, 4 * length**2],
    ])  # fmt: skip
    k[np.ix_([1, 5, 7, 11], [1, 5, 7, 11])] += own
    turned = own * np.outer((1, -1, 1, -1), (1, -1, 1, -1))
    k[np.ix_([2, 4, 8, 10], [2, 4, 8, 10])] += turned
    side = np.cross(axis, np.eye(3)[np.argmin(np.abs(axis))])
    side /= np.linalg.norm(side)
    turn = np.kron(np.eye(4), np.array([axis, side, np.cross(axis, side)]))
    return turn.T @ k @ turn


def displacements(x, edges, radii, loads, held, *, young=1.0, poisson=0.3):
    """Displacements (n, 3) of vertices under forces (n, 3); held ones neither move nor turn."""
    rows, columns, values = [], [], []
    for (i, j), r in zip(edges, np.broadcast_to(radii, len(edges)), strict=True):
        way = x[j] - x[i]
        length = np.linalg.norm(way)
        at = np.r_[6 * i : 6 * i + 6, 6 * j : 6 * j + 6]
        rows.append(np.repeat(at, 12))
        columns.append(np.tile(at, 12))
        values.append(stiffness(way / length, length, r, young, poisson).ravel())
    shape = (6 * len(x), 6 * len(x))
    at = np.concatenate(rows), np.concatenate(columns)
    whole = coo_array((np.concatenate(values), at), shape=shape).tocsr()
    free = np.setdiff1d(np.arange(6 * len(x)), (6 * held[:, None] + np.arange(6)).ravel())
    f = np.zeros((len(x), 6))
    f[:, :3] = loads
    u = np.zeros(6 * len(x))
    u[free] = splu(whole[free][:, free].tocsc()).solve(f.ravel()[free])
    return u.reshape(-1, 6)[:, :3]
