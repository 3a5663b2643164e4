"""The energy of a lattice against CalculiX, on a mesh of its solid by Gmsh.

What CalculiX 2.20 gave for a sector of a torus, on meshes by Gmsh 4.15.2, is written down, so that
it is compared everywhere; what runs it skips where ``ccx`` or ``gmsh`` is missing. On Debian:
``apt-get install calculix-ccx gmsh``.
"""

import re
import shutil
import subprocess

import numpy as np
import pytest

import ilattice as il

pytestmark = pytest.mark.slow

#: Lengths of edges, and energies of the sector with second-order tetrahedra (C3D10) of them.
LENGTHS, SECTOR = (0.13, 0.09), (25.25367, 25.51004)

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


def sector():
    """Two by two by two tiles in a sector of a torus with a square section of two tiles."""
    c = np.array([[[2, 0, 0], [2, 0, 2]], [[4, 0, 0], [4, 0, 2]]], float)
    square = il.bspline.BSpline((np.array([0, 0, 1, 1.0]),) * 2, c, (1, 1))
    through = il.macroshape.revolve(square, angle=2 / 3)
    return il.Lattice("schwarz_p", through=through, repeat=(2, 2, 2)).offset(0.1)


def limit(coarse, fine):
    """Energy on meshes without end: facets, and edges of their length, leave its square."""
    ratio = (LENGTHS[0] / LENGTHS[1]) ** 2
    return fine + (fine - coarse) / (ratio - 1)


def agrees(wall, held, coarse, fine):
    """The default grid against the finer mesh, and against the limit of both."""
    problem = il.cutfem.Elasticity(wall, young=1.0, poisson=0.3)
    found = problem.clamp(held).load(body=(1.0, 0.0, 0.0)).solve()
    assert found.energy == pytest.approx(fine, rel=0.01)
    known = limit(coarse, fine)
    assert found.energy == pytest.approx(known, rel=0.01)
    assert abs(known / found.energy - 1) < found.report.discretization_error


@pytest.mark.filterwarnings("ignore:the cells are too coarse")
def test_the_energy_in_a_sector_of_a_torus_is_what_calculix_gave():
    agrees(sector(), "u=0", *SECTOR)


@pytest.mark.client
@pytest.mark.filterwarnings("ignore:the cells are too coarse")
def test_the_energy_of_eight_tiles_is_that_of_calculix(tmp_path):
    box = il.macroshape.box((2.0, 2.0, 2.0))
    wall = il.Lattice("schwarz_p", through=box, repeat=(2, 2, 2)).offset(0.1)
    agrees(wall, "w=0", *(calculix(wall, h, tmp_path) for h in LENGTHS))


@pytest.mark.client
@pytest.mark.filterwarnings("ignore:the mesh with h")  # the coarser of the two
def test_calculix_gives_what_is_written_down(tmp_path):
    found = calculix(sector(), LENGTHS[0], tmp_path, axis=1)
    assert found == pytest.approx(SECTOR[0], rel=2e-3)  # another Gmsh makes another mesh


@pytest.mark.client
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
