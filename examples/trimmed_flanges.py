"""A lattice trimmed to a cylinder, and joined with flanges.

Diamond walls of 0.8 mm are cut by a cylinder of 11 mm radius and joined with two solid discs, the
upper one thicker. The part is one field: its mesh is made of it, and so are the rules on cut cells,
which integrate its volume and its middle of mass without a mesh, with 28 cells per side to
1e-5 of it.

    python examples/trimmed_flanges.py
"""

import ilattice as il


def main(h: float = 0.3, d: float = 0.4, cells: int = 28, out: str = "") -> dict[str, float]:
    """Make and mesh the part; write it if `out` is given."""
    block = il.macroshape.box(lo=(-13.0, -13.0, 0.0), hi=(13.0, 13.0, 26.0))
    wall = il.Lattice("diamond", through=block, repeat=3).offset(d)
    column = il.fields.intersection(
        wall.field, il.fields.pull_back(il.fields.cylinder(11.0), block)
    )
    discs = [
        il.fields.intersection(il.fields.cylinder(12.5), il.fields.half_space((0, 0, 1), 2.0)),
        il.fields.intersection(il.fields.cylinder(12.5), il.fields.half_space((0, 0, -1), -23.0)),
    ]
    part = il.fields.union(column, *(il.fields.pull_back(disc, block) for disc in discs))
    mesh = il.sdf.mesh(part, h, through=block)

    rule = il.cutfem.cut(part, cells, through=block).volume().in_space()
    if out:
        mesh.save(f"{out}.stl")
        scene = il.plot.Scene(view=(-50.0, 25.0)).add(mesh)
        il.plot.Panels([scene, scene.clipped("y > 0")], labels=True).save(f"{out}.png")
    return {
        "closed": float(mesh.is_watertight),
        "volume": rule.integrate(),
        "volume of the mesh": mesh.volume,
        "height of the middle of mass": float(rule.weights @ rule.points[:, 2] / rule.integrate()),
    }


if __name__ == "__main__":
    for name, number in main(out="trimmed_flanges").items():
        print(f"{name}: {number:.4g}")
