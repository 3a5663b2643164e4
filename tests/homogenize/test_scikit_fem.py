"""The same voxels in an independent program, if it is installed: scikit-fem."""

import numpy as np
import pytest

import ilattice as il

skfem = pytest.importorskip("skfem", reason="pip install scikit-fem")


def octant(solid, E):
    """Coefficients of a displacement of an eighth of a mirror-symmetric cell, and its matrix."""
    from skfem.models.elasticity import lame_parameters, linear_elasticity

    n = len(solid)
    planes = np.linspace(0.0, 0.5, n // 2 + 1)
    mesh = skfem.MeshHex.init_tensor(planes, planes, planes)
    at = np.floor(mesh.p[:, mesh.t].mean(axis=1) * n).astype(int)
    mesh = mesh.restrict(np.flatnonzero(solid[tuple(at)]))
    basis = skfem.Basis(mesh, skfem.ElementVector(skfem.ElementHex1()), intorder=3)
    K = skfem.asm(linear_elasticity(*lame_parameters(1.0, 0.3)), basis)
    u, held = np.zeros(K.shape[0]), []
    for c in range(3):
        for side in (0.0, 0.5):
            dofs = basis.get_dofs(lambda p, c=c, side=side: np.abs(p[c] - side) < 1e-9)
            held.append(dofs.all([f"u^{c + 1}"]))
            u[held[-1]] = E[c] * side
    return skfem.solve(*skfem.condense(K, x=u, D=np.unique(np.concatenate(held)))), K


@pytest.mark.filterwarnings("ignore")
def test_a_sheet_of_schwarz_p():
    n = 12
    wall = il.Lattice("P", through=il.macroshape.cell(), repeat=1).offset(0.15)
    x = (np.arange(n) + 0.5) / n
    u = np.stack(np.meshgrid(x, x, x, indexing="ij"), -1).reshape(-1, 3)
    solid = (wall.field(u) < 0).reshape(n, n, n)
    assert (solid == solid[::-1]).all()
    fields = [octant(solid, E) for E in np.eye(3)]
    C = np.array([[p @ (K @ q) for q, _ in fields] for p, K in fields]) / 0.125
    eff = il.homogenize.voxels(solid, young=(0.0, 1.0), poisson=0.3, tol=1e-6)
    np.testing.assert_allclose(eff.C[:3, :3], C, rtol=1e-8)
