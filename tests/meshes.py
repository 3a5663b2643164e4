"""Small meshes with known measures, shared by the tests of meshes and files."""

import numpy as np

CUBE_FACES = np.array(
    [
        [0, 2, 3], [0, 3, 1], [4, 5, 7], [4, 7, 6], [0, 1, 5], [0, 5, 4],
        [2, 6, 7], [2, 7, 3], [0, 4, 6], [0, 6, 2], [1, 3, 7], [1, 7, 5],
    ]
)  # fmt: skip


def cube(corner=(0.0, 0.0, 0.0), side=1.0):
    """Vertices and outward faces of a cube: volume side³, area 6 side²."""
    corners = np.array([[i >> 0 & 1, i >> 1 & 1, i >> 2 & 1] for i in range(8)], float)
    return np.array(corner) + side * corners, CUBE_FACES.copy()


def torus(n=40, m=20, major=2.0, minor=0.7):
    """Vertices and outward faces of a torus of genus 1 with 2 n m triangles."""
    u, v = np.meshgrid(np.arange(n) * 2 * np.pi / n, np.arange(m) * 2 * np.pi / m, indexing="ij")
    ring = major + minor * np.cos(v)
    vertices = np.stack([ring * np.cos(u), ring * np.sin(u), minor * np.sin(v)], -1).reshape(-1, 3)
    i, j = np.meshgrid(np.arange(n), np.arange(m), indexing="ij")

    def number(di, dj):
        return ((i + di) % n * m + (j + dj) % m).ravel()

    a, b, c, d = number(0, 0), number(1, 0), number(1, 1), number(0, 1)
    return vertices, np.concatenate([np.stack([a, b, c], 1), np.stack([a, c, d], 1)])


def sphere(refinements=3):
    """Vertices and outward faces of a sphere of radius 1: a refined octahedron."""
    vertices = np.concatenate([np.eye(3), -np.eye(3)])
    faces = np.array(
        [[0, 1, 2], [1, 3, 2], [3, 4, 2], [4, 0, 2], [1, 0, 5], [3, 1, 5], [4, 3, 5], [0, 4, 5]]
    )
    for _ in range(refinements):
        edges = np.sort(faces[:, [[0, 1], [1, 2], [2, 0]]], axis=2)
        pairs, number = np.unique(edges.reshape(-1, 2), axis=0, return_inverse=True)
        middle = len(vertices) + number.reshape(-1, 3)
        points = vertices[pairs].sum(axis=1)
        vertices = np.concatenate([vertices, points / np.linalg.norm(points, axis=1)[:, None]])
        (a, b, c), (ab, bc, ca) = faces.T, middle.T
        children = [[a, ab, ca], [ab, b, bc], [ca, bc, c], [ab, bc, ca]]
        faces = np.concatenate([np.stack(child, axis=1) for child in children])
    return vertices, faces


def joined(*parts):
    """One vertex and face table of several."""
    start = np.cumsum([0] + [len(v) for v, _ in parts[:-1]])
    vertices = np.concatenate([v for v, _ in parts])
    return vertices, np.concatenate([f + s for (_, f), s in zip(parts, start, strict=True)])
