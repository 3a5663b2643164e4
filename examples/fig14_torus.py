"""Figure 14 of Hong, Antolin, Elber and Kim: gyroid and diamond in a torus.

16 x 2 x 2 tiles, walls of constant half-thickness 0.1, or one that goes from 0.1 to 0.28 and back
along each half turn. The walls of constant thickness have 481 and 993 handles; where the varying
wall is thick, pores close, so that it has fewer, and nobody had to look for self-intersections.

Where the topology changes is known before anything is meshed: at the critical values of the
distance to the mid-surface. An eighth of a tile of the gyroid has these: at 0.125 sheets meet on
the faces of the torus; at 0.228 the first throats of the pores close, and at 0.234 the last, which
cuts them into cells; the deepest of these is filled at 0.244. In (b) each happens where the
half-thickness passes that value: the throats close at 71 % of the way from the thinnest place to
the thickest. The last pore of the mesh is where the half-thickness is 0.242. Pores that have become
cells are voids, which would trap powder: they are counted, with their volume, and so are the loose
specks that lie on the faces of the torus, of which the saved meshes are free. Boxes in the pictures
mark where the topology changes, at thin and at thick places.

    python examples/fig14_torus.py
"""

import numpy as np

import ilattice as il
from ilattice.topology.critical import CriticalPoint, critical_points

#: White at both sides of a wall, brown in the middle.
DEPTH = {"scalars": "depth", "label": "distance / d", "cmap": "depth", "clim": (-1, 1)}

#: Boxes about places where the varying wall is thinnest and thickest.
MARKED = (
    np.array([[3.0, -1.0, -1.05], [5.05, 1.0, 1.05]]),
    np.array([[-1.0, -5.05, -1.05], [1.0, -3.0, 1.05]]),
)


def varying() -> il.BSpline:
    """Half-thickness that goes linearly from 0.1 to 0.28 and back, twice around the torus."""
    along = np.array([0.1, 0.28, 0.1, 0.28, 0.1])
    knots = [0.0, 0.0, 0.25, 0.5, 0.75, 1.0, 1.0]
    return il.BSpline([knots, [0, 1], [0, 1]], along[:, None, None], (1, 0, 0))


def main(
    h: float = 0.05, repeat: tuple[int, int, int] = (16, 2, 2), out: str = ""
) -> dict[str, float]:
    """Build the four walls; write ``OUT_*.vtp`` and ``OUT_*.png`` if `out` is given."""
    torus = il.macroshape.torus(major=4.0, width=2.0)
    numbers: dict[str, float] = {}
    for name in ("gyroid", "diamond"):
        lattice = il.Lattice(il.tiles[name], through=torus, repeat=repeat)
        for kind, d in (("constant", 0.1), ("varying", varying())):
            raw = lattice.offset(d).mesh(h=h)
            mesh = raw.remove_islands()
            numbers[f"{name} {kind}"] = raw.genus
            if kind == "varying":
                numbers |= {f"{name}: {what}": n for what, n in left(raw, mesh).items()}
            if out:
                mesh.save(f"{out}_{name}_{kind}.vtp")
                depth = mesh.point_data["signed_distance"] / mesh.point_data["half_thickness"]
                painted = mesh.with_point_data(depth=depth)
                scene = il.plot.Scene().add(painted, **DEPTH)
                for box in MARKED if kind == "varying" else ():
                    scene = scene.lines(box, color="black", width=3)
                scene.save(f"{out}_{name}_{kind}.png")
            if (name, kind) == ("gyroid", "varying"):
                numbers["thickest pore"] = thickest_pore(mesh)
    return numbers


def changes(repeat: tuple[int, int, int] = (16, 2, 2)) -> list[CriticalPoint]:
    """Critical points of the distance to the gyroid from 0.1 to 0.28, in an eighth of a tile."""
    torus = il.macroshape.torus(major=4.0, width=2.0)
    lattice = il.Lattice(il.tiles["gyroid"], through=torus, repeat=repeat)
    within = np.array([[3.5, 0.0, 0.0], [4.0, 0.5, 0.5]]) / np.array(repeat)
    return critical_points(lattice, 0.1, 0.28, within=within)


def left(raw: "il.SurfaceMesh", mesh: "il.SurfaceMesh") -> dict[str, float]:
    """Specks of a mesh, and the closed voids that stay in its solid."""
    whole = mesh.fill_voids()
    return {
        "specks": raw.components - mesh.components,
        "closed voids": mesh.components - whole.components,
        "volume of the voids": whole.volume - mesh.volume,
    }


def thickest_pore(mesh: "il.SurfaceMesh") -> float:
    """Largest half-thickness of a wall at which it still has a surface inside the volume."""
    inner = mesh.point_data["side"] != 0
    return float(mesh.point_data["half_thickness"][inner].max())


if __name__ == "__main__":
    for name, number in main(out="fig14").items():
        print(f"{name}: {number:.6g}")
    for point in changes():
        part = (point.value - 0.1) / 0.18
        print(f"{point.value:.4f}, {part:.0%} of the way to the thickest place: {point.kind}")
