"""Which splines an analysis takes when nobody says: ``degree="auto"``.

Decided by the cells of the solid, before anything is integrated. Measured on the four analyses of
Figures 16 and 17 of Hong et al. 2025, walls and solids of gyroids and diamonds, a block and a
sphere, by seconds of CPU to 5 and 2 % of the extrapolated compliance:

- solids thicker than some cells: degree 2, of which a thirtieth of the cells is as accurate;
- networks of struts of a few cells: degree 1 on finer cells, in as much time if struts are smooth,
  and in a half to a fifth if they have kinks, as body centred and octet ones;
- networks of struts that are thinner than cells: degree 2, as degree 1 does not bend them (body
  centred struts of a third of a cell are 8.8 times too stiff, at degree 2 by a few per cent);
- networks in cells of which a tenth is stretched: degree 2, as degree 1 does not bend struts that
  follow the long edges. Of cells four times as long as wide it takes a third of the time for 5 %
  where struts are crosses, six tenths where they are body centred, as much where they are diamonds,
  and four times as long where they are octets, which hardly bend;
- walls between two surfaces, which bend: degree 2 in half of the time for 2 %, and in as much as
  degree 1 for 5 %, also with more cells than others; heat flows along them, and degree 1 takes half
  of the time;
- up to some thousand cells time does not count, and degree 2 has the better stresses.

Guarantee: the same solid of the same law on the same cells gets the same splines, whatever acts.
Non-guarantee: other cells may get others (`refinement_study` refuses to compare them), and stresses
converge more slowly than energies at degree 1, whoever chose it.
"""

import numpy as np

from ilattice._typing import IntArray
from ilattice.quadrature.cutting import CutGrid
from ilattice.quadrature.grid import CUT, IN

#: Cells of a solid up to which there is degree 2: some ten seconds.
FEW = 8_000
#: Cells of a solid from which on there is degree 1: at degree 2, cut cells take some 2 ms and 0.1
#: MB each, a hundred seconds and 5 GB, and cells are small beside the solid by then.
MANY = 50_000
#: The same for walls that bend, up to 8 GB: with the 52,000 cells of Figure 16c, degree 2 is 2 %
#: off, and degree 1 on the same cells 20 %.
MANY_OF_WALLS = 80_000
#: Cells of which an edge is so many times as long as another are stretched, and part of the cells
#: from which on it counts; looked at are so many cells.
LONG, STRETCHED, SEEN = 3.0, 0.1, 4096
#: Part of the cells that is whole from which on the solid is thick.
THICK = 0.5
#: Part of the cells that is whole up to which struts are thinner than a cell and a half, and lock
#: in bending at degree 1. No cell is whole of body centred struts of 1.3 cells, 6 % of 1.6 cells.
SLENDER = 0.05
#: The degree where it is no question.
USUAL = 2


def degree_for(solid: CutGrid, bends: bool) -> tuple[int, str]:
    """The degree of splines for a solid on its cells, where walls bend or not, and why."""
    solids = np.flatnonzero((solid.status == IN) | (solid.status == CUT))
    cells = len(solids)
    if cells <= FEW:
        return USUAL, f"{cells:,} cells are few"
    whole = int((solid.status == IN).sum())
    wall = bends and solid.sets.count > 1
    if cells > (MANY_OF_WALLS if wall else MANY):
        return 1, f"{cells:,} cells are many"
    if wall:
        return USUAL, f"a wall between surfaces in {cells:,} cells"
    if bends and whole <= SLENDER * cells:
        return USUAL, f"parts are thinner than cells: {whole:,} of {cells:,} cells are whole"
    if whole > THICK * cells:
        return USUAL, f"{100 * whole / cells:.0f} % of {cells:,} cells are whole"
    stretched = _stretched(solid, solids) if bends else 0.0
    if stretched >= STRETCHED:
        return USUAL, f"{100 * stretched:.0f} % of {cells:,} cells are stretched"
    return 1, f"{100 * (1 - whole / cells):.0f} % of {cells:,} cells are cut"


def _stretched(solid: CutGrid, cells: IntArray) -> float:
    """Part of cells of which an edge in space is `LONG` times as long as another."""
    some = np.random.default_rng(0).permutation(cells)[:SEEN]
    box = solid.grid.boxes(some)
    edges = box[:, 3:]
    if solid.through is not None:
        J = solid.through.jacobian(box[:, :3] + 0.5 * edges)
        edges = edges * np.linalg.norm(J, axis=1)
    return float((edges.max(axis=1) > LONG * edges.min(axis=1)).mean())
