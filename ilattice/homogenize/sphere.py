"""Directions: triangles on the sphere, and directions around each of them."""

from collections.abc import Iterator

import numpy as np

from ilattice._typing import AnyArray, FloatArray

#: Half a turn about each direction is looked at in so many steps.
AROUND = 36


def sphere(level: int) -> tuple[FloatArray, AnyArray]:
    """Unit vectors (n, 3) and triangles (m, 3): an icosahedron, its edges halved `level` times."""
    g = 0.5 * (1.0 + 5.0**0.5)
    flat = np.array([[s, t * g] for s in (-1.0, 1.0) for t in (-1.0, 1.0)])
    v = np.concatenate([np.roll(np.pad(flat, ((0, 0), (1, 0))), k, axis=1) for k in range(3)])
    gap = np.linalg.norm(v[:, None] - v, axis=2)
    near = (gap > 0) & (gap < 2.1)
    faces = np.array(
        [(i, j, k) for i in range(12) for j in range(i) for k in range(j)
         if near[i, j] and near[j, k] and near[i, k]]
    )  # fmt: skip
    a, b, c = v[faces].transpose(1, 0, 2)
    inward = np.einsum("ni,ni->n", np.cross(b - a, c - a), a) < 0
    faces[inward] = faces[inward][:, ::-1]
    for _ in range(level):
        v, faces = _halved(v, faces)
    return v / np.linalg.norm(v, axis=1, keepdims=True), faces


def _halved(v: FloatArray, faces: AnyArray) -> tuple[FloatArray, AnyArray]:
    """Every triangle as four."""
    edges = np.sort(faces[:, [[1, 2], [2, 0], [0, 1]]], axis=2).reshape(-1, 2)
    pairs, number = np.unique(edges, axis=0, return_inverse=True)
    middle = v[pairs].mean(axis=1)
    middle *= np.linalg.norm(v[0]) / np.linalg.norm(middle, axis=1, keepdims=True)
    a, b, c = faces.T
    x, y, z = (len(v) + number.reshape(-1, 3)).T
    corners = [(a, z, y), (b, x, z), (c, y, x), (x, y, z)]
    return np.concatenate([v, middle]), np.concatenate([np.stack(t, axis=1) for t in corners])


def directions(n: FloatArray) -> Iterator[FloatArray]:
    """Unit vectors (k, 3) orthogonal to unit vectors n (k, 3), half a turn about them."""
    least = np.eye(3)[np.abs(n).argmin(axis=1)]
    first = np.cross(n, least)
    first /= np.linalg.norm(first, axis=1, keepdims=True)
    second = np.cross(n, first)
    for angle in np.arange(AROUND) * np.pi / AROUND:
        yield np.cos(angle) * first + np.sin(angle) * second
