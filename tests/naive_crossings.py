"""Independent search for self-intersections of a triangle mesh: every edge against every triangle.

Pairs that share a vertex are left out, touching is not crossing. Candidates come from k-d trees of
the midpoints of edges, one for each class of lengths.
"""

import numpy as np
from scipy.spatial import cKDTree

BATCH = 2000


def crossings(x, faces):
    """Where an edge pierces a triangle: rows of two vertices and a face, shape (n, 3)."""
    x, faces = np.asarray(x, float), np.asarray(faces, np.int64)
    edges = np.unique(np.sort(faces[:, [[0, 1], [1, 2], [2, 0]]], axis=2).reshape(-1, 2), axis=0)
    half = 0.5 * np.linalg.norm(x[edges[:, 1]] - x[edges[:, 0]], axis=1)
    size = np.frexp(half)[1]
    found = [_pierced(x, faces, edges[size == s], half[size == s].max()) for s in np.unique(size)]
    return np.concatenate(found)


def _pierced(x, faces, edges, reach):
    tree = cKDTree(x[edges].mean(axis=1))
    centre = x[faces].mean(axis=1)
    radius = np.linalg.norm(x[faces] - centre[:, None], axis=2).max(axis=1) + reach
    found = [np.empty((0, 3), np.int64)]
    for i in range(0, len(faces), BATCH):
        near = tree.query_ball_point(centre[i : i + BATCH], radius[i : i + BATCH])
        f = np.repeat(np.arange(i, i + len(near)), [len(n) for n in near])
        e = np.concatenate([np.asarray(n, np.int64) for n in near])
        apart = (edges[e][:, :, None] != faces[f][:, None, :]).all(axis=(1, 2))
        e, f = e[apart], f[apart]
        hit = _pierces(*x[edges[e]].transpose(1, 0, 2), *x[faces[f]].transpose(1, 0, 2))
        found.append(np.column_stack([edges[e[hit]], f[hit]]))
    return np.concatenate(found)


def _pierces(p, q, a, b, c):
    """Whether the segments p q cross the triangles a b c, by the signs of five volumes."""

    def volume(a, b, c, d):
        return np.einsum("ij,ij->i", np.cross(b - a, c - a), d - a)

    above, below = volume(a, b, c, p), volume(a, b, c, q)
    u, v, w = volume(p, q, a, b), volume(p, q, b, c), volume(p, q, c, a)
    inside = ((u > 0) & (v > 0) & (w > 0)) | ((u < 0) & (v < 0) & (w < 0))
    return inside & (above * below < 0)
