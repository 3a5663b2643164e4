"""A heat exchanger: two fluids on both sides of a gyroid wall, with closed ends.

The wall of 0.8 mm parts a block into two labyrinths. The hot fluid enters and leaves at the ends
along x, the cold one at the sides along y; everywhere else a shell of 1.5 mm closes them. Each
fluid and the metal are watertight solids, for CFD and for printing. That the fluids are nowhere
nearer to each other than the wall is thick is measured between their meshes.

    python examples/heat_exchanger.py
"""

import numpy as np

import ilattice as il


def main(h: float = 0.5, d: float = 0.4, shell: float = 1.5, out: str = "") -> dict[str, float]:
    """Make the three solids; write them as STL, and a picture, if `out` is given."""
    block = il.macroshape.box((48.0, 24.0, 16.0))
    lattice = il.Lattice("gyroid", through=block, repeat=(6, 3, 2))
    side = lattice.offset(d).distance  # signed distance to the mid-surface
    hot = il.fields.intersection(il.fields.erode(side, d), channel(block, (0.0, shell, shell)))
    other = il.fields.erode(il.fields.complement(side), d)
    cold = il.fields.intersection(other, channel(block, (shell, 0.0, shell)))
    metal = il.fields.complement(il.fields.union(hot, cold))
    solids = {"hot": hot, "cold": cold, "metal": metal}
    meshes = {name: il.sdf.mesh(solid, h, through=block) for name, solid in solids.items()}
    gap = il.sdf.MeshDistance(meshes["cold"])(meshes["hot"].vertices).min()
    if out:
        for name, mesh in meshes.items():
            mesh.save(f"{out}_{name}.stl")
        picture(meshes).save(f"{out}.png")
    volumes = {f"volume of {name}": mesh.volume for name, mesh in meshes.items()}
    return {
        "closed": float(all(mesh.is_watertight for mesh in meshes.values())),
        "least gap between the fluids": float(gap),
        **volumes,
        "of the block": sum(volumes.values()) / (48.0 * 24.0 * 16.0),
        "surface of the hot fluid per volume": meshes["hot"].area / meshes["hot"].volume,
    }


def channel(block: il.SplineMap, margin: tuple[float, float, float]) -> "il.fields.Node":
    """The block without a margin at its sides, as a field of its parameters."""
    half = np.ptp(block.bounds, axis=0) / 2
    beyond = np.where(np.array(margin) == 0.0, 1.0, -np.array(margin))
    inside = il.fields.translate(il.fields.box(half + beyond), half)
    return il.fields.pull_back(inside, block)


def picture(meshes: dict[str, "il.SurfaceMesh"]) -> "il.plot.Panels":
    """The metal cut open, and the fluids."""
    scene = il.plot.Scene(view=(-50.0, 35.0))
    colours = {"hot": "#c8442d", "cold": "#2d6fc8"}
    cut = scene.add(meshes["metal"], color="#c9c9c9", cap="#8a8a8a").clipped("z < 9")
    fluids = scene
    for name, colour in colours.items():
        cut = cut.add(meshes[name], color=colour, cap=colour)
        fluids = fluids.add(meshes[name], color=colour)
    return il.plot.Panels([cut, fluids], labels=True)


if __name__ == "__main__":
    for name, number in main(out="heat_exchanger").items():
        print(f"{name}: {number:.4g}")
