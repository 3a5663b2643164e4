"""An STL part with a solid skin and a gyroid inside, of walls as thick as asked.

A bracket, here made by `il.sdf` and written as STL, gets a skin of 1 mm and inside of it gyroid
walls of 0.6 mm. The walls are measured where they are: at the vertices of the mesh that are in the
infill, by exact closest points. Level sets of the gyroid would be off by up to a third.

    python examples/infill_stl.py
"""

import numpy as np

import ilattice as il


def main(h: float = 0.35, skin: float = 1.0, wall: float = 0.6, out: str = "") -> dict[str, float]:
    """Make the part; write ``OUT.stl`` and pictures if `out` is given."""
    part = il.sdf.MeshDistance(bracket(out))
    low, high = part.mesh.vertices.min(axis=0) - h, part.mesh.vertices.max(axis=0) + h
    box = il.macroshape.box(lo=low, hi=high)
    cells = np.rint((high - low) / 6.0).astype(int)
    walls = il.Lattice("gyroid", through=box, repeat=cells).offset(wall / 2)

    inside = il.fields.pull_back(part, box)
    core = il.fields.erode(inside, skin)
    solid = il.fields.union(
        il.fields.difference(inside, core), il.fields.intersection(walls.field, inside)
    )
    mesh = il.sdf.mesh(solid, h, through=box)

    deep = part(mesh.vertices) < -skin - h
    u = box.inverse(mesh.vertices[deep])
    off = np.abs(np.abs(walls.lattice.distance(u)) - wall / 2) / (wall / 2)
    if out:
        mesh.save(f"{out}.stl")
        scenes = [il.plot.Scene(view=(-55.0, 30.0)).add(m, cap="#c8642d") for m in (mesh, mesh)]
        il.plot.Panels([scenes[0], scenes[1].clipped("y > 0")], labels=True).save(f"{out}.png")
    return {
        "closed": float(mesh.is_watertight),
        "volume of the part": part.mesh.volume,
        "volume with infill": mesh.volume,
        "99 % of the walls within": float(np.quantile(off, 0.99)),
    }


def bracket(out: str) -> il.SurfaceMesh:
    """A bracket of 40 x 24 x 30 mm, as it would come from CAD."""
    plate = il.fields.translate(il.fields.box((20.0, 12.0, 4.0)), (0.0, 0.0, 4.0))
    tower = il.fields.translate(il.fields.box((5.0, 12.0, 13.0)), (-15.0, 0.0, 17.0))
    hole = il.fields.translate(il.fields.cylinder(4.0), (8.0, 0.0, 0.0))
    mesh = il.sdf.mesh(il.fields.difference(il.fields.union(plate, tower), hole), 0.5)
    if out:
        mesh.save(f"{out}_part.stl")
        return il.mesh.load(f"{out}_part.stl")
    return mesh


if __name__ == "__main__":
    for name, number in main(out="infill_stl").items():
        print(f"{name}: {number:.4g}")
