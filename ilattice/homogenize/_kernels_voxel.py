"""Forces of trilinear voxels on a periodic grid, and the inverse of a homogeneous one.

In every voxel a field is taken apart into its mean slopes and its bilinear and trilinear parts.
The gradients of these are multiples of 1, x, y, z, yz, xz and xy, which are orthogonal, so that
the exact integral is a sum of seven products: a third of the work of an element matrix.

Planes of voxels are worked on in chunks of a size that depends on the grid alone; what a chunk adds
to the first plane of the next one waits in a buffer: the same bits for any number of threads.
"""

from typing import Any

import numpy as np

from ilattice._kernels import in_ranges, inner, outer

FAST = {"nsz", "arcp", "contract", "reassoc"}  # NaN stays alive


@inner(error_model="numpy", fastmath=FAST)
def _modes(
    c: int, k: int, e: int, gx: float, gy: float, gz: float, u00: Any, u01: Any, u10: Any,
    u11: Any,
) -> Any:  # fmt: skip
    """Slopes along x, y, z of component c in voxel k, and its parts xy, xz, yz and xyz."""
    # means and slopes along z, then along y and x
    s00, d00 = 0.5 * (u00[c, k] + u00[c, e]), u00[c, e] - u00[c, k]
    s01, d01 = 0.5 * (u01[c, k] + u01[c, e]), u01[c, e] - u01[c, k]
    s10, d10 = 0.5 * (u10[c, k] + u10[c, e]), u10[c, e] - u10[c, k]
    s11, d11 = 0.5 * (u11[c, k] + u11[c, e]), u11[c, e] - u11[c, k]
    x = 0.5 * ((s10 + s11) - (s00 + s01)) * gx
    y = 0.5 * ((s01 - s00) + (s11 - s10)) * gy
    z = 0.25 * ((d00 + d01) + (d10 + d11)) * gz
    xy = (s11 - s10) - (s01 - s00)
    xz = 0.5 * ((d10 + d11) - (d00 + d01))
    yz = 0.5 * ((d01 - d00) + (d11 - d10))
    xyz = (d11 - d10) - (d01 - d00)
    return x, y, z, xy, xz, yz, xyz


@inner(error_model="numpy", fastmath=FAST)
def _spread(
    c: int, k: int, e: int, h: Any, fx: float, fy: float, fz: float, fxy: float, fxz: float,
    fyz: float, fxyz: float, f00: Any, f01: Any, f10: Any, f11: Any,
) -> None:  # fmt: skip
    """Add what belongs to the parts of `_modes` to the nodes of voxel k."""
    hx, hy, hz = h
    V = hx * hy * hz
    fx, fy, fz = V / hx * fx, V / hy * fy, V / hz * fz
    fxy, fxz, fyz = V / 12.0 * fxy, V / 12.0 * fxz, V / 12.0 * fyz
    fxyz = V / 144.0 * fxyz
    # back to nodes: slopes are differences, means are halves
    X0, X1 = -0.5 * fx, 0.5 * fx
    s00, s01 = 0.5 * (X0 - 0.5 * fy + fxy), 0.5 * (X0 + 0.5 * fy - fxy)
    s10, s11 = 0.5 * (X1 - 0.5 * fy - fxy), 0.5 * (X1 + 0.5 * fy + fxy)
    Z0, Z1 = 0.5 * fz - fxz, 0.5 * fz + fxz
    d00, d01 = 0.5 * (Z0 - fyz) + fxyz, 0.5 * (Z0 + fyz) - fxyz
    d10, d11 = 0.5 * (Z1 - fyz) - fxyz, 0.5 * (Z1 + fyz) + fxyz
    f00[c, k] += s00 - d00
    f00[c, e] += s00 + d00
    f01[c, k] += s01 - d01
    f01[c, e] += s01 + d01
    f10[c, k] += s10 - d10
    f10[c, e] += s10 + d10
    f11[c, k] += s11 - d11
    f11[c, e] += s11 + d11


@inner(error_model="numpy", fastmath=FAST)
def _rows(
    m: int, n2: int, h: Any, phase: Any, table: Any, u00: Any, u01: Any, u10: Any, u11: Any,
    f00: Any, f01: Any, f10: Any, f11: Any,
) -> None:  # fmt: skip
    """Add the forces of one row of voxels; u and f are the rows (m, n2) of nodes at its edges."""
    gx, gy, gz = 1.0 / h[0], 1.0 / h[1], 1.0 / h[2]
    a0 = a1 = a2 = b0 = b1 = b2 = c0 = c1 = c2 = 0.0
    p0 = p1 = p2 = q0 = q1 = q2 = r0 = r1 = r2 = 0.0
    t0 = t1 = t2 = 0.0
    for k in range(n2):
        e = k + 1 if k + 1 < n2 else 0
        for c in range(m):
            x, y, z, xy, xz, yz, xyz = _modes(c, k, e, gx, gy, gz, u00, u01, u10, u11)
            if c == 0:
                a0, b0, c0, p0, q0, r0, t0 = x, y, z, xy, xz, yz, xyz
            elif c == 1:
                a1, b1, c1, p1, q1, r1, t1 = x, y, z, xy, xz, yz, xyz
            else:
                a2, b2, c2, p2, q2, r2, t2 = x, y, z, xy, xz, yz, xyz
        w = phase[k]
        for c in range(m):
            if m == 1:  # conduction: symmetric tensor xx, yy, zz, yz, xz, xy
                kx, ky, kz = table[w, 0], table[w, 1], table[w, 2]
                kyz, kxz, kxy = table[w, 3], table[w, 4], table[w, 5]
                fx = kx * a0 + kxy * b0 + kxz * c0
                fy = kxy * a0 + ky * b0 + kyz * c0
                fz = kxz * a0 + kyz * b0 + kz * c0
                # of x: (0, xy/hy, xz/hz); of y: (xy/hx, 0, yz/hz); of z: (xz/hx, yz/hy, 0)
                y1, z1 = p0 * gy, q0 * gz
                x2, z2 = p0 * gx, r0 * gz
                x3, y3 = q0 * gx, r0 * gy
                fxy = (ky * y1 + kyz * z1) * gy + (kx * x2 + kxz * z2) * gx
                fxz = (kyz * y1 + kz * z1) * gz + (kx * x3 + kxy * y3) * gx
                fyz = (kxz * x2 + kz * z2) * gz + (kxy * x3 + ky * y3) * gy
                fxyz = (kx * gx * gx + ky * gy * gy + kz * gz * gz) * t0
            else:
                lam, mu = table[w, 0], table[w, 1]
                if c == 0:
                    tr = lam * (a0 + b1 + c2)
                    fx, fy, fz = tr + 2.0 * mu * a0, mu * (b0 + a1), mu * (c0 + a2)
                    fxy = mu * p0 * gy * gy
                    fxy += (lam * (p0 * gx + r2 * gz) + 2.0 * mu * p0 * gx) * gx
                    fxz = mu * q0 * gz * gz
                    fxz += (lam * (q0 * gx + r1 * gy) + 2.0 * mu * q0 * gx) * gx
                    fyz = mu * (r0 * gz + p2 * gx) * gz + mu * (r0 * gy + q1 * gx) * gy
                    fxyz = ((lam + 2.0 * mu) * gx * gx + mu * (gy * gy + gz * gz)) * t0
                elif c == 1:
                    tr = lam * (a0 + b1 + c2)
                    fx, fy, fz = mu * (a1 + b0), tr + 2.0 * mu * b1, mu * (c1 + b2)
                    fxy = mu * p1 * gx * gx
                    fxy += (lam * (p1 * gy + q2 * gz) + 2.0 * mu * p1 * gy) * gy
                    fyz = mu * r1 * gz * gz
                    fyz += (lam * (r1 * gy + q0 * gx) + 2.0 * mu * r1 * gy) * gy
                    fxz = mu * (q1 * gz + p2 * gy) * gz + mu * (q1 * gx + r0 * gy) * gx
                    fxyz = ((lam + 2.0 * mu) * gy * gy + mu * (gx * gx + gz * gz)) * t1
                else:
                    tr = lam * (a0 + b1 + c2)
                    fx, fy, fz = mu * (a2 + c0), mu * (b2 + c1), tr + 2.0 * mu * c2
                    fxz = mu * q2 * gx * gx
                    fxz += (lam * (q2 * gz + p1 * gy) + 2.0 * mu * q2 * gz) * gz
                    fyz = mu * r2 * gy * gy
                    fyz += (lam * (r2 * gz + p0 * gx) + 2.0 * mu * r2 * gz) * gz
                    fxy = mu * (p2 * gy + q1 * gz) * gy + mu * (p2 * gx + r0 * gz) * gx
                    fxyz = ((lam + 2.0 * mu) * gz * gz + mu * (gx * gx + gy * gy)) * t2
            _spread(c, k, e, h, fx, fy, fz, fxy, fxz, fyz, fxyz, f00, f01, f10, f11)


@inner(owning=True, error_model="numpy", fastmath=FAST)
def _rows_of_matrices(
    n2: int, h: Any, phase: Any, table: Any, u00: Any, u01: Any, u10: Any, u11: Any,
    f00: Any, f01: Any, f10: Any, f11: Any,
) -> None:  # fmt: skip
    """`_rows` of displacements in voxels with stiffnesses table (phases, 36)."""
    gx, gy, gz = 1.0 / h[0], 1.0 / h[1], 1.0 / h[2]
    E = np.zeros((7, 6))  # strains that are multiples of 1, x, y, z, yz, xz, xy
    S = np.empty((7, 6))
    for k in range(n2):
        e = k + 1 if k + 1 < n2 else 0
        x0, y0, z0, p0, q0, r0, t0 = _modes(0, k, e, gx, gy, gz, u00, u01, u10, u11)
        x1, y1, z1, p1, q1, r1, t1 = _modes(1, k, e, gx, gy, gz, u00, u01, u10, u11)
        x2, y2, z2, p2, q2, r2, t2 = _modes(2, k, e, gx, gy, gz, u00, u01, u10, u11)
        E[0, 0], E[0, 1], E[0, 2] = x0, y1, z2
        E[0, 3], E[0, 4], E[0, 5] = z1 + y2, z0 + x2, y0 + x1
        E[1, 1], E[1, 2], E[1, 3] = p1 * gy, q2 * gz, q1 * gz + p2 * gy
        E[1, 4], E[1, 5] = q0 * gz, p0 * gy
        E[2, 0], E[2, 2], E[2, 3] = p0 * gx, r2 * gz, r1 * gz
        E[2, 4], E[2, 5] = r0 * gz + p2 * gx, p1 * gx
        E[3, 0], E[3, 1], E[3, 3] = q0 * gx, r1 * gy, r2 * gy
        E[3, 4], E[3, 5] = q2 * gx, r0 * gy + q1 * gx
        E[4, 0], E[4, 4], E[4, 5] = t0 * gx, t2 * gx, t1 * gx
        E[5, 1], E[5, 3], E[5, 5] = t1 * gy, t2 * gy, t0 * gy
        E[6, 2], E[6, 3], E[6, 4] = t2 * gz, t1 * gz, t0 * gz
        w = phase[k]
        for i in range(7):
            for r in range(6):
                s = 0.0
                for j in range(6):
                    s += table[w, 6 * r + j] * E[i, j]
                S[i, r] = s
        for c in range(3):
            x, y, z = c, 1, 2  # places of stresses c x, c y, c z
            if c == 0:
                y, z = 5, 4
            elif c == 1:
                x, z = 5, 3
            else:
                x, y = 4, 3
            _spread(
                c, k, e, h, S[0, x], S[0, y], S[0, z], S[1, y] * gy + S[2, x] * gx,
                S[1, z] * gz + S[3, x] * gx, S[2, z] * gz + S[3, y] * gy,
                S[4, x] * gx + S[5, y] * gy + S[6, z] * gz, f00, f01, f10, f11,
            )  # fmt: skip


@in_ranges(1)
@outer(nogil=True, error_model="numpy")
def forces(
    begin: int, end: int, u: Any, phase: Any, table: Any, h: Any, chunk: int, buffer: Any, out: Any
) -> None:
    """Forces of a field on a periodic grid of voxels, but for what is in `buffer` in the end.

    Parameters
    ----------
    begin, end
        Which chunks.
    u : ndarray, shape (m, n0, n1, n2)
        Field at the nodes; m = 3 for displacements, 1 for temperatures.
    phase : ndarray of int32, shape (n0, n1, n2)
        Row of `table` of every voxel.
    table : ndarray, shape (phases, 2, 6 or 36)
        Lamé constants; conductivities xx, yy, zz, yz, xz, xy; stiffnesses, row by row.
    h : tuple of 3 floats
        Edges of voxels.
    chunk : int
        Planes per chunk.
    buffer : ndarray, shape (chunks, m, n1, n2)
        Forces on the first planes of next chunks, see `add_planes`.
    out : ndarray, shape of u
        Result.
    """
    m, n0, n1, n2 = u.shape
    for b in range(begin, end):
        first, last = b * chunk, min((b + 1) * chunk, n0)
        out[:, first:last] = 0.0
        buffer[b] = 0.0
        for i in range(first, last):
            e = i + 1 if i + 1 < n0 else 0
            lower = out[:, i]
            upper = buffer[b] if i + 1 == last else out[:, i + 1]
            for j in range(n1):
                g = j + 1 if j + 1 < n1 else 0
                if table.shape[1] == 36:
                    _rows_of_matrices(
                        n2, h, phase[i, j], table, u[:, i, j], u[:, i, g], u[:, e, j], u[:, e, g],
                        lower[:, j], lower[:, g], upper[:, j], upper[:, g],
                    )  # fmt: skip
                else:
                    _rows(
                        m, n2, h, phase[i, j], table, u[:, i, j], u[:, i, g], u[:, e, j],
                        u[:, e, g], lower[:, j], lower[:, g], upper[:, j], upper[:, g],
                    )  # fmt: skip


@in_ranges(4)
@outer(nogil=True, error_model="numpy")
def add_planes(first: int, last: int, chunk: int, buffer: Any, out: Any) -> None:
    """Add what `forces` of chunks leaves for the first planes of the next ones."""
    _, m, n1, n2 = buffer.shape
    for b in range(first, last):
        before = b - 1 if b > 0 else len(buffer) - 1
        for c in range(m):
            for j in range(n1):
                for k in range(n2):
                    out[c, b * chunk, j, k] += buffer[before, c, j, k]


@in_ranges(2)
@outer(nogil=True, error_model="numpy")
def invert(first: int, last: int, z: Any, mass: Any, slope: Any, wave: Any, table: Any) -> None:
    """Divide transforms of forces by the symbol of a homogeneous grid.

    Parameters
    ----------
    first, last
        Which planes.
    z : ndarray of complex64, shape (m, n0, n1, r)
        Transforms; overwritten.
    mass, slope, wave : ndarray, shape (3, n)
        Symbols per direction of products of functions, of slopes, and of both (that of the latter
        is i times it).
    table : ndarray, shape (2 or 6,)
        As a row of that of `forces`.
    """
    m, _, n1, r = z.shape
    for i in range(first, last):
        for j in range(n1):
            mx, dx, sx = mass[0, i], slope[0, i], wave[0, i]
            my, dy, sy = mass[1, j], slope[1, j], wave[1, j]
            xy, dxy, xdy, ss = mx * my, dx * my, mx * dy, sx * sy
            for k in range(r):
                mz, dz, sz = mass[2, k], slope[2, k], wave[2, k]
                kx, ky, kz = dxy * mz, xdy * mz, xy * dz
                if i == 0 and j == 0 and k == 0:
                    for c in range(m):
                        z[c, 0, 0, 0] = 0.0
                elif m == 1:
                    s = table[0] * kx + table[1] * ky + table[2] * kz
                    s += 2.0 * table[3] * mx * sy * sz + 2.0 * table[4] * my * sx * sz
                    s += 2.0 * table[5] * mz * ss
                    z[0, i, j, k] *= 1.0 / s
                else:
                    lam, mu = table[0], table[1]
                    a, whole = lam + mu, mu * (kx + ky + kz)
                    xx, yy, zz = whole + a * kx, whole + a * ky, whole + a * kz
                    yz, xz, xy_ = a * mx * sy * sz, a * my * sx * sz, a * mz * ss
                    A, B, C = yy * zz - yz * yz, xx * zz - xz * xz, xx * yy - xy_ * xy_
                    D, E, F = xy_ * xz - xx * yz, xy_ * yz - yy * xz, yz * xz - zz * xy_
                    inverse = 1.0 / (xx * A + xy_ * F + xz * E)
                    x, y, w = z[0, i, j, k], z[1, i, j, k], z[2, i, j, k]
                    z[0, i, j, k] = inverse * (A * x + F * y + E * w)
                    z[1, i, j, k] = inverse * (F * x + B * y + D * w)
                    z[2, i, j, k] = inverse * (E * x + D * y + C * w)
