"""Compiled loops over triangles: measures and edge topology.

Guarantees: time and memory linear in the number of triangles; no table of edges is kept. One
thread: 25 million triangles take seconds, and serial loops compile several times faster.
Not guaranteed: anything for faces with a repeated corner or with indices out of range; the door of
`SurfaceMesh` keeps those out.
"""

from typing import Any

import numpy as np

from ilattice._kernels import inner, outer

#: Triangles that are summed up one after the other, for any number of threads.
_CHUNK = 1 << 15


@inner()
def _double_area_vector(vertices: Any, faces: Any, f: int) -> Any:
    """Cross product of two sides of triangle `f`."""
    a, b, c = faces[f, 0], faces[f, 1], faces[f, 2]
    # Numba's float() would leave single precision as it is.
    ax, ay, az = np.float64(vertices[a, 0]), np.float64(vertices[a, 1]), np.float64(vertices[a, 2])
    px, py, pz = vertices[b, 0] - ax, vertices[b, 1] - ay, vertices[b, 2] - az
    qx, qy, qz = vertices[c, 0] - ax, vertices[c, 1] - ay, vertices[c, 2] - az
    return py * qz - pz * qy, pz * qx - px * qz, px * qy - py * qx


@outer()
def volume_and_area(vertices: Any, faces: Any, centre: Any) -> Any:
    """Partial sums, shape (chunks, 2), of 6 x the signed volume about `centre` and 2 x the area."""
    count = len(faces)
    chunks = (count + _CHUNK - 1) // _CHUNK
    sums = np.zeros((chunks, 2))
    for i in range(chunks):
        volume = 0.0
        area = 0.0
        for f in range(i * _CHUNK, min(count, (i + 1) * _CHUNK)):
            nx, ny, nz = _double_area_vector(vertices, faces, f)
            a = faces[f, 0]
            volume += (
                nx * (vertices[a, 0] - centre[0])
                + ny * (vertices[a, 1] - centre[1])
                + nz * (vertices[a, 2] - centre[2])
            )
            area += np.sqrt(nx * nx + ny * ny + nz * nz)
        sums[i, 0] = volume
        sums[i, 1] = area
    return sums


@outer()
def triangle_quality(vertices: Any, faces: Any) -> Any:
    """4 sqrt(3) area / (sum of squared sides), shape (F,); 0 for a triangle shrunk to a point."""
    count = len(faces)
    q = np.zeros(count)
    for f in range(count):
        nx, ny, nz = _double_area_vector(vertices, faces, f)
        squares = 0.0
        for j in range(3):
            a, b = faces[f, j], faces[f, (j + 1) % 3]
            for k in range(3):
                side = np.float64(vertices[b, k]) - np.float64(vertices[a, k])
                squares += side * side
        if squares > 0.0:
            q[f] = 2.0 * np.sqrt(3.0) * np.sqrt(nx * nx + ny * ny + nz * nz) / squares
    return q


@outer()
def first_bad_face(faces: Any, n_vertices: int) -> int:
    """Index of the first face with a corner out of range or with two equal corners, or -1."""
    for f in range(len(faces)):
        a, b, c = faces[f, 0], faces[f, 1], faces[f, 2]
        if a == b or b == c or c == a or min(a, b, c) < 0 or max(a, b, c) >= n_vertices:
            return f
    return -1


# --- edges ------------------------------------------------------------------------------------
# Half-edge h = 3 f + j runs from corner j of face f to corner (j + 1) % 3; corner h is its start.


@inner()
def _ends(faces: Any, h: int) -> Any:
    """Start and end vertex of half-edge `h`."""
    f, j = h // 3, h % 3
    return faces[f, j], faces[f, (j + 1) % 3]


@inner()
def _sort_bucket(order: Any, upper: Any, lo: int, hi: int) -> None:
    """Sort order[lo:hi] by the scratch keys upper[:hi - lo], equal ones by their own numbers.

    Shell's sort, which is insertion sort while it is short.
    """
    n = hi - lo
    gap = 1
    while 48 * gap < n:
        gap = 3 * gap + 1
    while gap > 0:
        for i in range(gap, n):
            key, value = upper[i], order[lo + i]
            j = i - gap
            while j >= 0 and (upper[j] > key or (upper[j] == key and order[lo + j] > value)):
                upper[j + gap] = upper[j]
                order[lo + j + gap] = order[lo + j]
                j -= gap
            upper[j + gap] = key
            order[lo + j + gap] = value
        gap //= 3


@outer()
def sort_half_edges(faces: Any, start: Any, order: Any) -> None:
    """Half-edges sorted by (lower vertex, upper vertex): a counting sort, then short sorts.

    Parameters
    ----------
    faces : (F, 3) integer array
    start : (V + 1,) int64 array of zeros
        Receives the first place in `order` of each lower vertex.
    order : (3 F,) integer array
        Receives the half-edges.
    """
    for h in range(order.size):
        a, b = _ends(faces, h)
        start[min(a, b) + 1] += 1
    longest = 0
    for v in range(start.size - 1):
        longest = max(longest, start[v + 1])
        start[v + 1] += start[v]
    for h in range(order.size):
        a, b = _ends(faces, h)
        v = min(a, b)
        order[start[v]] = h
        start[v] += 1
    for v in range(start.size - 1, 0, -1):
        start[v] = start[v - 1]
    start[0] = 0
    upper = np.empty(longest, np.int64)
    for v in range(start.size - 1):
        lo, hi = start[v], start[v + 1]
        for i in range(lo, hi):
            a, b = _ends(faces, order[i])
            upper[i - lo] = max(a, b)
        _sort_bucket(order, upper, lo, hi)


@inner()
def _same_edge(faces: Any, start: Any, order: Any, v: int, i: int) -> Any:
    """End of the run of half-edges in bucket `v` that lie on the edge of order[i]; runs up."""
    a, b = _ends(faces, order[i])
    w = max(a, b)
    forward = 0
    while i < start[v + 1]:
        a, b = _ends(faces, order[i])
        if max(a, b) != w:
            break
        forward += a == v
        i += 1
    return i, forward


@inner()
def _find(parent: Any, i: int) -> int:
    """Root of `i`; halves the path on the way."""
    while parent[i] != i:
        parent[i] = parent[parent[i]]
        i = parent[i]
    return i


@inner()
def _unite(parent: Any, i: int, j: int) -> bool:
    """Join two sets; the smaller root stays. True if they were apart."""
    i, j = _find(parent, i), _find(parent, j)
    if i == j:
        return False
    if i < j:
        parent[j] = i
    else:
        parent[i] = j
    return True


@outer()
def census(faces: Any, start: Any, order: Any, parent: Any) -> Any:
    """Count the edges by kind and join the corners that meet across edges.

    Parameters
    ----------
    faces, start, order
        As `sort_half_edges` left them.
    parent : (3 F,) integer array
        Receives a union-find forest over the corners: one tree per fan of triangles at a vertex.

    Returns
    -------
    tuple of int
        Edges, open edges (one triangle), non-manifold edges (more than two), edges of two
        triangles or more that are not run through equally often both ways, fans.
    """
    edges = opened = crowded = twisted = 0
    fans = parent.size
    for h in range(parent.size):
        parent[h] = h
    for v in range(start.size - 1):
        i = start[v]
        while i < start[v + 1]:
            end, forward = _same_edge(faces, start, order, v, i)
            n = end - i
            edges += 1
            opened += n == 1
            crowded += n > 2
            twisted += n > 1 and 2 * forward != n
            first = order[i]
            reverse = _ends(faces, first)[0] != v
            for k in range(i + 1, end):
                h = order[k]
                swapped = (_ends(faces, h)[0] != v) != reverse
                tip, first_tip = h - h % 3 + (h + 1) % 3, first - first % 3 + (first + 1) % 3
                if swapped:
                    h, tip = tip, h
                fans -= _unite(parent, first, h)
                fans -= _unite(parent, first_tip, tip)
            i = end
    return edges, opened, crowded, twisted, fans


@outer()
def label_components(parent: Any, labels: Any) -> int:
    """Join the corners of every face, number the trees by their first face; returns their count.

    Parameters
    ----------
    parent : (3 F,) integer array
        The forest of `census`; is used up.
    labels : (F,) integer array
        Receives the number of the component of every face.
    """
    for h in range(0, parent.size, 3):
        _unite(parent, h, h + 1)
        _unite(parent, h, h + 2)
    count = 0
    for f in range(labels.size):
        # The root of a tree is its smallest corner, thus the first corner of its first face.
        root = _find(parent, 3 * f)
        if root == 3 * f:
            labels[f] = count
            count += 1
        else:
            labels[f] = labels[root // 3]
    return count


@outer()
def faulty_edges(faces: Any, start: Any, order: Any, out: Any) -> int:
    """Vertex pairs of the edges without exactly two triangles, into `out`; returns their count."""
    count = 0
    for v in range(start.size - 1):
        i = start[v]
        while i < start[v + 1]:
            end, _ = _same_edge(faces, start, order, v, i)
            if end - i != 2:
                if count < len(out):
                    a, b = _ends(faces, order[i])
                    out[count, 0], out[count, 1] = a, b
                count += 1
            i = end
    return count


@outer()
def mark_vertices(faces: Any, used: Any) -> int:
    """Set used[v] for every vertex of a face; returns their number."""
    count = 0
    for f in range(len(faces)):
        for j in range(3):
            v = faces[f, j]
            count += not used[v]
            used[v] = True
    return count
