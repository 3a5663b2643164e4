"""The energy of a lattice against CalculiX, on a mesh of its solid by Gmsh.

Skips where ``ccx`` or ``gmsh`` is missing. On Debian: ``apt-get install calculix-ccx gmsh``.
"""

import re
import shutil
import subprocess

import numpy as np
import pytest

import ilattice as il

pytestmark = [pytest.mark.client, pytest.mark.slow]

GEOMETRY = """Merge "skin.stl";
Surface Loop(1) = {1};
Volume(1) = {1};
Mesh.SaveAll = 1;
"""
DECK = """*INCLUDE, INPUT=solid.inp
*NSET, NSET=BOTTOM
{bottom}
*ELSET, ELSET=SOLID
{solid}
*MATERIAL, NAME=ONE
*ELASTIC
1.0, 0.3
*DENSITY
1.0
*SOLID SECTION, ELSET=SOLID, MATERIAL=ONE
*BOUNDARY
BOTTOM, 1, 3
*STEP
*STATIC
*DLOAD
SOLID, GRAV, 1.0, 1.0, 0.0, 0.0
*EL PRINT, ELSET=SOLID, TOTALS=ONLY
ELSE
*END STEP
"""


def run(folder, *command):
    if shutil.which(command[0]) is None:
        pytest.skip(f"{command[0]} is not installed")
    done = subprocess.run(
        command, cwd=folder, capture_output=True, text=True, timeout=300, check=False
    )
    if done.returncode:
        pytest.fail(f"{' '.join(command)}: {done.returncode}\n{done.stdout}\n{done.stderr}")


def calculix(wall, h, folder, axis=2):
    """Elastic energy under a body load of 1 along x, held where one coordinate is 0; C3D10."""
    wall.mesh(h).save(folder / "skin.stl")
    (folder / "solid.geo").write_text(GEOMETRY)
    run(folder, "gmsh", "-3", "-order", "2", "-format", "inp", "solid.geo", "-o", "all.inp")
    blocks = re.split(r"^(?=\*)", (folder / "all.inp").read_text(), flags=re.MULTILINE)
    nodes = next(b for b in blocks if b.upper().startswith("*NODE"))
    solid = next(b for b in blocks if b.upper().startswith("*ELEMENT") and "C3D10" in b.upper())
    (folder / "solid.inp").write_text(nodes + solid)
    table = np.array([row.split(",") for row in nodes.splitlines()[1:]], float)
    rows = np.array(re.findall(r"\d+", solid.split("\n", 1)[1]), int).reshape(-1, 11)
    bottom = np.intersect1d(table[np.abs(table[:, 1 + axis]) < 1e-6, 0].astype(int), rows[:, 1:])
    sets = {"bottom": bottom, "solid": rows[:, 0]}
    text = {name: ",\n".join(map(str, numbers)) for name, numbers in sets.items()}
    (folder / "job.inp").write_text(DECK.format(**text))
    run(folder, "ccx", "-i", "job")
    found = re.search(r"total internal energy[^\n]*\s+(\S+)", (folder / "job.dat").read_text())
    return float(found[1])


@pytest.mark.filterwarnings("ignore:the wall is")  # the coarsest grid
def test_the_energy_of_a_lattice_is_that_of_calculix(tmp_path):
    wall = il.Lattice("schwarz_p", through=il.macroshape.box((1.0, 1.0, 1.0))).offset(0.1)
    coarse, fine = (calculix(wall, h, tmp_path) for h in (0.09, 0.06))

    def solved(n):
        problem = il.cutfem.Elasticity(wall, n, young=1.0, poisson=0.3)
        return problem.clamp("w=0").load(body=(1.0, 0.0, 0.0)).solve()

    study = il.cutfem.refinement_study(solved, (6, 8, 12), {"energy": lambda s: s.energy})
    assert study.values["energy"][-1] == pytest.approx(fine, rel=0.02)
    # edges at the held face and facets leave CalculiX the first order, seen down to h = 0.045
    assert study.limit("energy") == pytest.approx(fine + 2 * (fine - coarse), rel=0.02)
