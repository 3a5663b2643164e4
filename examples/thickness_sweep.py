"""How stiff and how heavy: a sweep of the thickness of walls.

Cells of gyroid and Schwarz P walls are homogenized at several half-thicknesses. Stiffness is shown
over the thickness, which is what one chooses, and over the density, which is what one pays, with
the bound of Hashin and Shtrikman that no isotropic cell exceeds. Bars are the estimated errors of
so few cells. The table is kept in a file: run again, it is read. The numbers that are checked: the
density of thin walls is twice the half-thickness times the area of the surface, and the exponent of
the power law E ~ density^n, which is 1 for walls that are stretched only and 3 for walls that are
bent only.

    python examples/thickness_sweep.py
"""

from typing import Any

import ilattice as il

AREAS = {"gyroid": 3.0915, "primitive": 2.3451}  # of the minimal surfaces, per unit cell
HALF = (0.02, 0.04, 0.06, 0.08, 0.1)


def main(thickness: Any = HALF, cells: int = 10, out: str = "") -> dict[str, float]:
    """Sweep; a table and a picture of it if `out` is given."""
    rows = il.homogenize.sweep(
        list(AREAS), thickness=list(thickness), cells=cells, table=f"{out}.csv" if out else None,
        progress=True,
    )  # fmt: skip
    if out:
        figure = rows.plot("E")
        figure.set_size_inches(9.6, 4.2)
        over = figure.axes[0]
        over.set_ylabel("Young's modulus E / E of the solid")
        left = figure.add_subplot(1, 2, 1, sharey=over)
        over.set_subplotspec(left.get_gridspec()[1])
        for name in AREAS:
            mine = [row for row in rows if row["cell"] == name]
            d, E, error = ([float(row[k]) for row in mine] for k in ("thickness", "E", "error"))
            left.errorbar(d, E, yerr=[e * r for e, r in zip(E, error, strict=True)], fmt="o-")
        left.set(xlabel="half-thickness d, in cells", ylabel="E / E of the solid")
        figure.savefig(f"{out}.png", dpi=150)
    found = {}
    for name, area in AREAS.items():
        thinnest = next(row for row in rows if row["cell"] == name)
        found[f"{name}: density over 2 d area"] = thinnest["density"] / (
            2.0 * float(thinnest["thickness"]) * area
        )
        found[f"{name}: exponent of E"] = rows.fit("E", cell=name).exponent
    found["largest part of the upper bound"] = float((rows["E"] / rows["E_most"]).max())
    return found


if __name__ == "__main__":
    for name, number in main(out="thickness_sweep").items():
        print(f"{name}: {number:.4g}")
