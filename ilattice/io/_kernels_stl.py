"""Compiled loop that turns triangles into the numbers of an STL file.

Guarantee: the normal is that of the rounded corners.
"""

from typing import Any

import numpy as np

from ilattice._kernels import outer


@outer()
def fill_triangles(vertices: Any, faces: Any, out: Any) -> int:
    """Normal and corners of each triangle, into ``out`` (F, 12) float32.

    Parameters
    ----------
    vertices : (V, 3) float array
        Points.
    faces : (F, 3) integer array
        Corners.
    out : (F, 12) float32 array
        Receives the unit normal (0 where there is no area) and the three corners.

    Returns
    -------
    int
        How many triangles have two equal corners after rounding.
    """
    collapsed = 0
    for f in range(len(faces)):
        row = out[f]
        for j in range(3):
            for k in range(3):
                row[3 + 3 * j + k] = vertices[faces[f, j], k]
        same = 0
        for j in range(3):
            a, b = 3 + 3 * j, 3 + 3 * ((j + 1) % 3)
            same += row[a] == row[b] and row[a + 1] == row[b + 1] and row[a + 2] == row[b + 2]
        collapsed += same > 0
        ax, ay, az = np.float64(row[3]), np.float64(row[4]), np.float64(row[5])
        px, py, pz = row[6] - ax, row[7] - ay, row[8] - az
        qx, qy, qz = row[9] - ax, row[10] - ay, row[11] - az
        nx, ny, nz = py * qz - pz * qy, pz * qx - px * qz, px * qy - py * qx
        length = np.sqrt(nx * nx + ny * ny + nz * nz)
        scale = 1.0 / length if length > 0.0 else 0.0
        row[0], row[1], row[2] = nx * scale, ny * scale, nz * scale
    return collapsed
