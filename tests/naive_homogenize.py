"""Homogenization as it is written in books: tensors of rank four, laminates, assembled voxels.

Shares no code with `ilattice.homogenize`.
"""

import itertools

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.linalg import spsolve

VOIGT = ((0, 0), (1, 1), (2, 2), (1, 2), (0, 2), (0, 1))


def isotropic(E, nu):
    """Stiffness (6, 6) by Young's modulus and Poisson's ratio."""
    out = np.zeros((6, 6))
    out[:3, :3] = nu
    out[range(3), range(3)] = 1 - nu
    out[range(3, 6), range(3, 6)] = (1 - 2 * nu) / 2
    return E / ((1 + nu) * (1 - 2 * nu)) * out


def full(C):
    """All 81 components."""
    out = np.empty((3, 3, 3, 3))
    for a, b in itertools.product(range(6), repeat=2):
        (i, j), (k, m) = VOIGT[a], VOIGT[b]
        for p, q in {(i, j), (j, i)}:
            for r, s in {(k, m), (m, k)}:
                out[p, q, r, s] = C[a, b]
    return out


def voigt(C4):
    """The matrix (6, 6) of 81 components."""
    return np.array([[C4[*p, *q] for q in VOIGT] for p in VOIGT])


def rotated(C, Q):
    """Stiffness of a turned solid."""
    return voigt(np.einsum("ai,bj,ck,dl,ijkl->abcd", Q, Q, Q, Q, full(C)))


def laminate(fractions, stiffnesses, normal=(1.0, 0.0, 0.0)):
    """Layers normal to a direction: tractions and in-plane strains are common."""
    n = np.asarray(normal) / np.linalg.norm(normal)
    other = np.eye(3)[np.argmin(np.abs(n))]
    t = np.cross(n, other) / np.linalg.norm(np.cross(n, other))
    Q = np.stack([n, t, np.cross(n, t)])  # n to x
    N, T = [0, 4, 5], [1, 2, 3]
    A = B = D = 0.0
    for f, C in zip(fractions, (rotated(C, Q) for C in stiffnesses), strict=True):
        inverse = np.linalg.inv(C[np.ix_(N, N)])
        A = A + f * inverse
        B = B + f * inverse @ C[np.ix_(N, T)]
        D = D + f * (C[np.ix_(T, T)] - C[np.ix_(T, N)] @ inverse @ C[np.ix_(N, T)])
    A = np.linalg.inv(A)
    out = np.empty((6, 6))
    out[np.ix_(N, N)], out[np.ix_(N, T)], out[np.ix_(T, N)] = A, A @ B, (A @ B).T
    out[np.ix_(T, T)] = D + B.T @ A @ B
    return rotated(out, Q.T)


def random_rotation(rng):
    """Any rotation or mirror."""
    return np.linalg.qr(rng.standard_normal((3, 3)))[0]


def random_stiffness(rng):
    """Positive definite, without symmetry."""
    A = rng.standard_normal((6, 6))
    return A @ A.T + 0.5 * np.eye(6)


def assembled(materials, spacing):
    """Effective matrix of voxels (n0, n1, n2) of matrices 6×6 or 3×3, by a direct solver."""
    shape, k = materials.shape[:3], materials.shape[-1]
    m = 3 if k == 6 else 1
    corners = np.array(list(itertools.product((0, 1), repeat=3)))
    gauss = np.array(list(itertools.product((-1, 1), repeat=3))) / 12**0.5 + 0.5
    volume = np.prod(spacing)
    cells = np.array(list(np.ndindex(*shape)))
    nodes = np.ravel_multi_index(
        tuple(np.moveaxis((cells[:, None] + corners) % shape, 2, 0)), shape
    )
    D = materials.reshape(-1, k, k)
    K, F = np.zeros((len(cells), 8 * m, 8 * m)), np.zeros((len(cells), 8 * m, k))
    for g in gauss:
        slope = np.array(
            [
                [
                    (2 * c[a] - 1)
                    / spacing[a]
                    * np.prod([g[b] if c[b] else 1 - g[b] for b in range(3) if b != a])
                    for a in range(3)
                ]
                for c in corners
            ]
        )
        B = np.zeros((k, 8 * m))
        if m == 1:
            B[:] = slope.T
        else:
            for row, (i, j) in enumerate(VOIGT):
                B[row, i::3] += slope[:, j]
                if i != j:
                    B[row, j::3] += slope[:, i]
        K += volume / 8 * np.einsum("pa,epq,qb->eab", B, D, B)
        F += volume / 8 * np.einsum("pa,epq->eaq", B, D)
    dofs = (m * nodes[:, :, None] + np.arange(m)).reshape(len(cells), -1)
    n = m * int(np.prod(shape))
    rows, columns = np.repeat(dofs, 8 * m, axis=1), np.tile(dofs, (1, 8 * m))
    matrix = coo_array((K.ravel(), (rows.ravel(), columns.ravel())), shape=(n, n)).tocsc()
    f = np.zeros((n, k))
    np.add.at(f, dofs, F)
    u = np.zeros((n, k))
    u[m:] = spsolve(matrix[m:, m:], -f[m:]).reshape(n - m, k)
    whole = volume * np.prod(shape)
    return (volume * D.sum(axis=0) + f.T @ u) / whole


def conducting_laminate(parts, conductivities, normal):
    """Exact conductivity of layers: fluxes along the normal, and gradients across it, are equal."""
    n = np.asarray(normal, float)
    along = [n @ k @ n for k in conductivities]
    soft = sum(f / a for f, a in zip(parts, along, strict=True))
    mixed = sum(f * (k @ n) / a for f, k, a in zip(parts, conductivities, along, strict=True))
    rest = sum(
        f * (k - np.outer(k @ n, k @ n) / a)
        for f, k, a in zip(parts, conductivities, along, strict=True)
    )
    return rest + np.outer(mixed, mixed) / soft
