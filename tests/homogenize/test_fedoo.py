"""The same voxels in an independent program, if it is installed: fedoo, which assembles them."""

import numpy as np
import pytest

import ilattice as il

fd = pytest.importorskip("fedoo", reason="pip install fedoo simcoon")
#: fedoo has shears in the order xy, xz, yz.
ORDER = [0, 1, 2, 5, 4, 3]


@pytest.mark.slow  # minutes, in its direct solver
@pytest.mark.filterwarnings("ignore")
def test_three_phases_without_symmetry():
    n, young, poisson = 16, (0.05, 1.0, 7.0), (0.1, 0.3, 0.2)
    x = 2 * np.pi * (np.arange(n) + 0.5) / n
    x, y, z = x[:, None, None], x[:, None], x
    wave = np.sin(x + 0.3) * np.cos(y) + np.sin(y) * np.cos(2 * z) + np.sin(z) * np.cos(x)
    labels = np.digitize(wave, (-0.3, 0.4))
    fd.ModelingSpace("3D")
    mesh = fd.mesh.box_mesh(n + 1, n + 1, n + 1, elm_type="hex8")
    middle = mesh.nodes[mesh.elements].mean(axis=1)
    of = labels[tuple(np.floor(middle * n).astype(int).T)]
    laws = [fd.constitutivelaw.ElasticIsotrop(E, nu) for E, nu in zip(young, poisson, strict=True)]
    for k in range(3):
        mesh.add_element_set(np.flatnonzero(of == k), f"phase {k}")
    law = fd.constitutivelaw.Heterogeneous(tuple(laws), tuple(f"phase {k}" for k in range(3)))
    assembly = fd.Assembly.create(fd.weakform.StressEquilibrium(law), mesh, "hex8")
    C = fd.homogen.get_homogenized_stiffness(assembly)[np.ix_(ORDER, ORDER)]
    eff = il.homogenize.voxels(labels, young=young, poisson=poisson, tol=1e-7, estimate=False)
    assert np.abs(eff.C - C).max() < 1e-6 * C.max()
