"""Compiled search of triangles in a tree of boxes: nearest one, winding number, crossings.

The tree is that of `ilattice.fields._kernels_boxes`. Triangles lie in the order of the leaves in
`tri` (F, 12): three corners and the unit normal (zero for flat triangles).

Guarantees: the least distance does not depend on the order of the points or on the number of
threads, and of triangles at equal distance the one of least number wins; a triangle counts as
inside only by heights above its edges, never by barycentric quotients, so that slivers lose no
digits.
"""

import numpy as np

from ilattice._kernels import in_ranges, inner, outer
from ilattice.fields._kernels_boxes import FAST, STACK, box_square

#: Where in a row of `tri` its corners and its normal begin.
A, B, C, NORMAL = 0, 3, 6, 9
#: Points that a thread takes at once.
CHUNK = 256
FACE = 0  # features: the face, 1..3 the edge from that corner on, 4..6 a corner
FAR = 2.0  # a node this many radii away is summed as one dipole
SURE = 0.25  # how far a winding number must be from one half to be taken from dipoles
CLEAR = 1e-6  # least cosine between a pseudonormal and the way to the point that tells a side
ON = 1e-12  # of the coordinates: points on edges and corners that are nearer have no direction


# --- dipoles ----------------------------------------------------------------------------------


@outer(error_model="numpy")
def dipoles(box, link, tri, area, out):
    """Moments of all nodes, (N, 7): area vector, area-weighted centre, radius about it."""
    for node in range(len(link) - 1, -1, -1):
        moment = np.zeros(7)
        total = 0.0
        if link[node, 2] > 0:
            for k in range(link[node, 1], link[node, 1] + link[node, 2]):
                total += area[k]
                for a in range(3):
                    moment[a] += area[k] * tri[k, NORMAL + a]
                    centre = (tri[k, A + a] + tri[k, B + a] + tri[k, C + a]) / 3.0
                    moment[3 + a] += area[k] * centre
        else:
            for child in (node + 1, link[node, 0]):
                total += out[child, 6]
                moment[:3] += out[child, :3]
                moment[3:6] += out[child, 6] * out[child, 3:6]
        if total > 0.0:
            moment[3:6] /= total
        else:
            moment[3:6] = 0.5 * (box[node, :3] + box[node, 3:])
        moment[6] = total
        out[node] = moment
    for node in range(len(link)):
        far = 0.0
        for a in range(3):
            c = out[node, 3 + a]
            far += max(c - box[node, a], box[node, 3 + a] - c) ** 2
        out[node, 6] = np.sqrt(far)


# --- nearest triangle -------------------------------------------------------------------------


@inner(fastmath=FAST, error_model="numpy")
def segment(px, py, pz, ex, ey, ez):
    """Where on the segment from 0 to e the point nearest to p lies, 0 to 1, and how far squared."""
    ee = ex * ex + ey * ey + ez * ez
    t = px * ex + py * ey + pz * ez
    t = 0.0 if t <= 0.0 or ee == 0.0 else (1.0 if t >= ee else t / ee)
    if t == 1.0:
        px, py, pz = px - ex, py - ey, pz - ez
    else:
        px, py, pz = px - t * ex, py - t * ey, pz - t * ez
    return t, px * px + py * py + pz * pz


@inner(fastmath=FAST, error_model="numpy")
def triangle(tri, k, x, y, z, bound):
    """Squared distance to triangle k, the feature that is nearest, and the place on its edge.

    Infinite where the plane alone is farther than `bound`.
    """
    ax, ay, az = tri[k, A], tri[k, A + 1], tri[k, A + 2]
    bx, by, bz = tri[k, B], tri[k, B + 1], tri[k, B + 2]
    cx, cy, cz = tri[k, C], tri[k, C + 1], tri[k, C + 2]
    nx, ny, nz = tri[k, NORMAL], tri[k, NORMAL + 1], tri[k, NORMAL + 2]
    px, py, pz = x - ax, y - ay, z - az
    h = nx * px + ny * py + nz * pz
    if h * h > bound:
        return np.inf, FACE, 0.0
    qx, qy, qz = x - bx, y - by, z - bz
    rx, ry, rz = x - cx, y - cy, z - cz
    ex, ey, ez = bx - ax, by - ay, bz - az
    fx, fy, fz = cx - bx, cy - by, cz - bz
    gx, gy, gz = ax - cx, ay - cy, az - cz
    hab = nx * (ey * pz - ez * py) + ny * (ez * px - ex * pz) + nz * (ex * py - ey * px)
    hbc = nx * (fy * qz - fz * qy) + ny * (fz * qx - fx * qz) + nz * (fx * qy - fy * qx)
    hca = nx * (gy * rz - gz * ry) + ny * (gz * rx - gx * rz) + nz * (gx * ry - gy * rx)
    if hab > 0.0 and hbc > 0.0 and hca > 0.0:
        return h * h, FACE, 0.0
    best, feature, place = np.inf, FACE, 0.0
    if hab <= 0.0:
        t, d = segment(px, py, pz, ex, ey, ez)
        best, feature, place = d, 1, t
    if hbc <= 0.0:
        t, d = segment(qx, qy, qz, fx, fy, fz)
        if d < best:
            best, feature, place = d, 2, t
    if hca <= 0.0:
        t, d = segment(rx, ry, rz, gx, gy, gz)
        if d < best:
            best, feature, place = d, 3, t
    if place == 0.0:
        feature += 3
    elif place == 1.0:
        feature = 4 + feature % 3
    return best, feature, place


@inner(fastmath=FAST, error_model="numpy")
def rounding(x, y, z, scale):
    """How far a computed distance from a point may be off; `scale` is that of the coordinates."""
    return 1e-15 * (scale + abs(x) + abs(y) + abs(z))


@inner(fastmath=FAST, error_model="numpy")
def widened(square, slack):
    """Squared distance up to which boxes must be opened, in spite of rounding."""
    d = np.sqrt(square) + slack
    return d * d * (1.0 + 1e-14)


@inner(fastmath=FAST, error_model="numpy")
def nearest(box, link, tri, number, x, y, z, k, scale, nodes, squares):
    """Nearest triangle (its place in the tree), its squared distance, feature and place.

    The search starts with the bound that triangle `k` gives.
    """
    slack = rounding(x, y, z, scale)
    best, feature, place = triangle(tri, k, x, y, z, np.inf)
    bound = widened(best, slack)
    nodes[0], squares[0] = 0, box_square(box, 0, x, y, z)
    top = 1
    while top > 0:
        top -= 1
        if squares[top] > bound:
            continue
        node = nodes[top]
        while link[node, 2] == 0:
            left, right = node + 1, link[node, 0]
            dl, dr = box_square(box, left, x, y, z), box_square(box, right, x, y, z)
            if dr < dl:
                left, right, dl, dr = right, left, dr, dl
            if dr <= bound:
                nodes[top], squares[top] = right, dr
                top += 1
            node = left
            if dl > bound:
                break
        for j in range(link[node, 1], link[node, 1] + link[node, 2]):
            d, f, t = triangle(tri, j, x, y, z, bound)
            if d < best or (d == best and number[j] < number[k]):
                best, feature, place, k = d, f, t, j
                bound = widened(best, slack)
    return k, best, feature, place


@inner(fastmath=FAST, error_model="numpy")
def foot_of(tri, k, feature, place, x, y, z, out):
    """The nearest point of triangle k, and the signed height above its plane."""
    nx, ny, nz = tri[k, NORMAL], tri[k, NORMAL + 1], tri[k, NORMAL + 2]
    h = nx * (x - tri[k, A]) + ny * (y - tri[k, A + 1]) + nz * (z - tri[k, A + 2])
    if feature == FACE:
        out[0], out[1], out[2] = x - h * nx, y - h * ny, z - h * nz
    elif feature >= 4:
        for a in range(3):
            out[a] = tri[k, 3 * (feature - 4) + a]
    else:
        i, j = 3 * (feature - 1), 3 * (feature % 3)
        for a in range(3):
            out[a] = tri[k, i + a] + place * (tri[k, j + a] - tri[k, i + a])
    return h


@inner(fastmath=FAST, error_model="numpy")
def pseudonormal(tri, k, feature, twin, corners, normals, out):
    """Angle-weighted normal of a feature, any length; zero where a flat triangle spoils it."""
    if feature == FACE:
        for j in range(3):
            out[j] = tri[k, NORMAL + j]
    elif feature >= 4:
        for j in range(3):
            out[j] = normals[corners[k, feature - 4], j]
    else:
        j = twin[k, feature - 1]
        for a in range(3):
            out[a] = tri[k, NORMAL + a] + tri[j, NORMAL + a]
        flat_k = tri[k, NORMAL] == 0.0 and tri[k, NORMAL + 1] == 0.0 and tri[k, NORMAL + 2] == 0.0
        flat_j = tri[j, NORMAL] == 0.0 and tri[j, NORMAL + 1] == 0.0 and tri[j, NORMAL + 2] == 0.0
        if flat_k or flat_j:
            out[:] = 0.0


@in_ranges(CHUNK)
@outer(nogil=True, fastmath=FAST, error_model="numpy")
def closest(
    first, last, points, box, link, tri, number, scale, square, face, feature, foot, height
):
    """Nearest triangles (places in the tree), features, feet and heights of points (n, 3)."""
    nodes = np.empty(STACK, np.int64)
    squares = np.empty(STACK)
    for start in range(first, last, CHUNK):
        k = 0
        for i in range(start, min(last, start + CHUNK)):
            x, y, z = points[i, 0], points[i, 1], points[i, 2]
            k, d, f, t = nearest(box, link, tri, number, x, y, z, k, scale, nodes, squares)
            square[i], face[i], feature[i] = d, k, f
            height[i] = foot_of(tri, k, f, t, x, y, z, foot[i])


# --- sides ------------------------------------------------------------------------------------


@in_ranges(8 * CHUNK)
@outer(nogil=True, fastmath=FAST, error_model="numpy")
def sides_by_normals(
    first, last, points, square, face, feature, foot, height, tri, twin, corners, normals, scale,
    turn, side,
):  # fmt: skip
    """-1 inside, 1 outside, 0 where the pseudonormal does not tell; `turn` -1 swaps them."""
    n = np.empty(3)
    for i in range(first, last):
        if feature[i] == FACE:
            side[i] = turn if height[i] >= 0.0 else -turn
            continue
        pseudonormal(tri, face[i], feature[i], twin, corners, normals, n)
        length = np.sqrt(n[0] * n[0] + n[1] * n[1] + n[2] * n[2])
        along = 0.0
        for a in range(3):
            along += n[a] * (points[i, a] - foot[i, a])
        slack = rounding(points[i, 0], points[i, 1], points[i, 2], scale)
        clear = length * (CLEAR * np.sqrt(square[i]) + slack)
        side[i] = turn if along > clear else (-turn if along < -clear else 0)


@inner(fastmath=FAST, error_model="numpy")
def solid_angle(tri, k, x, y, z):
    """Signed solid angle of a triangle seen from a point, positive from inside."""
    ax, ay, az = tri[k, A] - x, tri[k, A + 1] - y, tri[k, A + 2] - z
    bx, by, bz = tri[k, B] - x, tri[k, B + 1] - y, tri[k, B + 2] - z
    cx, cy, cz = tri[k, C] - x, tri[k, C + 1] - y, tri[k, C + 2] - z
    a = np.sqrt(ax * ax + ay * ay + az * az)
    b = np.sqrt(bx * bx + by * by + bz * bz)
    c = np.sqrt(cx * cx + cy * cy + cz * cz)
    volume = ax * (by * cz - bz * cy) + ay * (bz * cx - bx * cz) + az * (bx * cy - by * cx)
    ab, bc, ca = (
        ax * bx + ay * by + az * bz,
        bx * cx + by * cy + bz * cz,
        cx * ax + cy * ay + cz * az,
    )
    return 2.0 * np.arctan2(volume, a * b * c + ab * c + bc * a + ca * b)


@inner(fastmath=FAST, error_model="numpy")
def winding(box, link, tri, moment, x, y, z, far, nodes):
    """Generalised winding number of a point; nodes beyond `far` radii count as dipoles."""
    nodes[0] = 0
    top = 1
    total = 0.0
    while top > 0:
        top -= 1
        node = nodes[top]
        dx, dy, dz = moment[node, 3] - x, moment[node, 4] - y, moment[node, 5] - z
        r = np.sqrt(dx * dx + dy * dy + dz * dz)
        if r > far * moment[node, 6]:
            flux = moment[node, 0] * dx + moment[node, 1] * dy + moment[node, 2] * dz
            total += flux / (r * r * r)
        elif link[node, 2] > 0:
            for k in range(link[node, 1], link[node, 1] + link[node, 2]):
                total += solid_angle(tri, k, x, y, z)
        else:
            nodes[top], nodes[top + 1] = link[node, 0], node + 1
            top += 2
    return total / (4.0 * np.pi)


@in_ranges(CHUNK)
@outer(nogil=True, fastmath=FAST, error_model="numpy")
def sides_by_winding(first, last, points, box, link, tri, moment, turn, side):
    """Fill in the sides that are 0: -1 where `turn` x the winding number is above 1/2, else 1."""
    nodes = np.empty(STACK, np.int64)
    for i in range(first, last):
        if side[i] == 0:
            x, y, z = points[i, 0], points[i, 1], points[i, 2]
            w = turn * winding(box, link, tri, moment, x, y, z, FAR, nodes)
            if abs(w - 0.5) < SURE:
                w = turn * winding(box, link, tri, moment, x, y, z, np.inf, nodes)
            side[i] = -1 if w > 0.5 else 1


@in_ranges(CHUNK // 8)
@outer(nogil=True, fastmath=FAST, error_model="numpy")
def windings(first, last, points, box, link, tri, moment, out):
    """Winding numbers of points, every triangle summed."""
    nodes = np.empty(STACK, np.int64)
    for i in range(first, last):
        x, y, z = points[i, 0], points[i, 1], points[i, 2]
        out[i] = winding(box, link, tri, moment, x, y, z, np.inf, nodes)


# --- derivatives ------------------------------------------------------------------------------


@outer(fastmath=FAST, error_model="numpy")
def gradients(points, square, face, feature, foot, height, side, tri, turn, out):
    """Unit vectors (n, 3) along which the signed distance grows."""
    for i in range(len(points)):
        k, d = face[i], np.sqrt(square[i])
        size = 0.0
        for a in range(3):
            size += abs(points[i, a]) + abs(tri[k, a])
        on = d <= ON * size  # too near for a direction
        if feature[i] == FACE and d > 0.0:
            sign = side[i] if height[i] > 0.0 else -side[i]
            for a in range(3):
                out[i, a] = sign * tri[k, NORMAL + a]
        else:
            for a in range(3):
                away = (
                    turn * tri[k, NORMAL + a] if on else side[i] * (points[i, a] - foot[i, a]) / d
                )
                out[i, a] = away


@outer(fastmath=FAST, error_model="numpy")
def hessians(square, face, feature, side, tri, gradient, out):
    """Second derivatives (n, 3, 3): curved about edges and corners, zero over faces."""
    edge = np.empty(3)
    for i in range(len(square)):
        out[i] = 0.0
        if feature[i] == FACE or square[i] == 0.0:
            continue
        edge[:] = 0.0
        if feature[i] < 4:
            first, last = 3 * (feature[i] - 1), 3 * (feature[i] % 3)
            edge[:] = tri[face[i], last : last + 3] - tri[face[i], first : first + 3]
            edge /= np.sqrt(edge[0] ** 2 + edge[1] ** 2 + edge[2] ** 2)
        curvature = side[i] / np.sqrt(square[i])
        for a in range(3):
            out[i, a, a] = curvature
            for b in range(3):
                flat = edge[a] * edge[b] + gradient[i, a] * gradient[i, b]
                out[i, a, b] -= curvature * flat


# --- preparation ------------------------------------------------------------------------------


@outer(error_model="numpy")
def vertex_normals(vertices, faces, normals, out):
    """Sum of the face normals around every vertex, weighted by angles; zero beside flat faces."""
    spoilt = np.zeros(len(vertices), np.bool_)
    for f in range(len(faces)):
        flat = normals[f, 0] == 0.0 and normals[f, 1] == 0.0 and normals[f, 2] == 0.0
        for j in range(3):
            i = faces[f, j]
            u = vertices[faces[f, (j + 1) % 3]] - vertices[i]
            v = vertices[faces[f, (j + 2) % 3]] - vertices[i]
            w0, w1, w2 = (
                u[1] * v[2] - u[2] * v[1],
                u[2] * v[0] - u[0] * v[2],
                u[0] * v[1] - u[1] * v[0],
            )
            sine = np.sqrt(w0 * w0 + w1 * w1 + w2 * w2)
            angle = np.arctan2(sine, u[0] * v[0] + u[1] * v[1] + u[2] * v[2])
            out[i] += angle * normals[f]
            spoilt[i] |= flat
    for i in range(len(vertices)):
        if spoilt[i]:
            out[i] = 0.0


@inner(fastmath=FAST, error_model="numpy")
def orientation(a, b, c, d):
    """Sign of the volume of a tetrahedron, 0 where rounding might decide it."""
    u0, u1, u2 = a[0] - d[0], a[1] - d[1], a[2] - d[2]
    v0, v1, v2 = b[0] - d[0], b[1] - d[1], b[2] - d[2]
    w0, w1, w2 = c[0] - d[0], c[1] - d[1], c[2] - d[2]
    p0, q0 = v1 * w2, v2 * w1
    p1, q1 = v2 * w0, v0 * w2
    p2, q2 = v0 * w1, v1 * w0
    volume = u0 * (p0 - q0) + u1 * (p1 - q1) + u2 * (p2 - q2)
    size = (
        abs(u0) * (abs(p0) + abs(q0))
        + abs(u1) * (abs(p1) + abs(q1))
        + abs(u2) * (abs(p2) + abs(q2))
    )
    error = 1e-15 * size
    return 1 if volume > error else (-1 if volume < -error else 0)


@inner(fastmath=FAST, error_model="numpy")
def pierces(p, q, t):
    """Whether the segment p q goes through the inside of the triangle t (9 numbers), surely."""
    a, b, c = t[0:3], t[3:6], t[6:9]
    up, down = orientation(a, b, c, p), orientation(a, b, c, q)
    if up * down >= 0:
        return False
    s = orientation(p, q, a, b)
    return s != 0 and s == orientation(p, q, b, c) and s == orientation(p, q, c, a)


@in_ranges(CHUNK)
@outer(nogil=True, error_model="numpy")
def crossings(first, last, box, link, tri, corners, out):
    """How many edges each triangle has that go through another triangle without a common corner.

    `corners` are vertex numbers in the order of `tri`; an edge counts for each triangle it has.
    """
    nodes = np.empty(STACK, np.int64)
    for k in range(first, last):
        out[k] = 0
        for e in range(3):
            i, j = corners[k, e], corners[k, (e + 1) % 3]
            if i < j and edge_crosses(
                box, link, tri, corners, i, j,
                tri[k, 3 * e : 3 * e + 3], tri[k, 3 * ((e + 1) % 3) : 3 * ((e + 1) % 3) + 3],
                nodes,
            ):  # fmt: skip
                out[k] += 1


@inner(fastmath=FAST, error_model="numpy")
def edge_crosses(box, link, tri, corners, i, j, p, q, nodes):
    """Whether the edge from p (vertex i) to q (vertex j) goes through a triangle without i or j."""
    nodes[0] = 0
    top = 1
    while top > 0:
        top -= 1
        node = nodes[top]
        apart = False
        for a in range(3):
            apart |= max(p[a], q[a]) < box[node, a] or min(p[a], q[a]) > box[node, 3 + a]
        if apart:
            continue
        if link[node, 2] == 0:
            nodes[top], nodes[top + 1] = link[node, 0], node + 1
            top += 2
            continue
        for k in range(link[node, 1], link[node, 1] + link[node, 2]):
            shared = False
            for a in range(3):
                shared |= corners[k, a] == i or corners[k, a] == j
            if not shared and pierces(p, q, tri[k]):
                return True
    return False
