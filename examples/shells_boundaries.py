"""Figure 5 of Xu, Pan, Wang, Du and Lu: the closed curves that pass through all faces of a cube.

On each face of an octant of the cell a boundary follows one of eight patterns. Of 8⁶ choices 256
close, which are 20 but for symmetries of the cube; all are drawn, with the loops of each in its own
colour.

    python examples/shells_boundaries.py
"""

import ilattice as il


def main(out: str = "") -> dict[str, float]:
    """Find the classes; draw them to ``OUT.png`` if `out` is given."""
    classes = il.shells.enumerate()
    numbers = {"classes": float(len(classes))}
    numbers["closed choices"] = float(sum(48 // len(t.symmetries) for t in classes))
    numbers["that repeat by shifts"] = float(sum(t.is_translational for t in classes))
    if out:
        _picture(f"{out}.png")
    return numbers


def _picture(path: str) -> None:
    import numpy as np
    from matplotlib.figure import Figure

    figure = Figure(figsize=(10, 8.6), layout="constrained")
    corners = 2.0 * np.indices((2, 2, 2)).reshape(3, -1).T - 1.0
    for i, name in enumerate(il.shells.names()):
        axes = figure.add_subplot(4, 5, i + 1, projection="3d")
        for a in corners:
            for b in corners:
                if np.abs(a - b).sum() == 2.0:
                    axes.plot(*np.stack([a, b]).T, color="0.75", lw=0.8)
        start = 0.6 if name == "topo_18" else 0.0
        for loop in il.shells.boundary(name, start, 1.5).loops(17):
            axes.plot(*np.concatenate([loop, loop[:1]]).T, lw=2.0)
        axes.set_title(name, fontsize=9, y=0.95)
        axes.set_axis_off()
        axes.set_box_aspect((1, 1, 1), zoom=1.25)
        axes.view_init(22, -58)
    figure.savefig(path, dpi=110)


if __name__ == "__main__":
    for name, number in main(out="shells_boundaries").items():
        print(f"{name}: {number:.6g}")
