"""Four minimal surfaces from the faces that they meet, with their areas per unit cell.

Schwarz P, I-WP and Neovius meet the same four faces of a tetrahedron, in other orders; F-RD meets
those of another one. Their pieces are found by conjugation, and reflected until they fill the cell.
Extrapolated from two sizes of triangles, areas are those known within 1e-4: 2.34511, 3.46416,
3.51048 and 4.76999.

    python examples/minimal_surfaces.py
"""

import ilattice as il

M = il.minimal
SURFACES = {
    "P": M.tetrahedron().faces("z=0 x=1/2 y=z x=y"),
    "I-WP": M.tetrahedron().faces("z=0 x=y x=1/2 y=z"),
    "Neovius": M.tetrahedron().faces("z=0 x=1/2 x=y y=z"),
    "F-RD": M.tetrahedron(192).faces("z=0 x+y=1/2 x=y y=z"),
}
AREAS = {"P": 2.34511, "I-WP": 3.46416, "Neovius": 3.51048, "F-RD": 4.76999}


def main(n: int = 32, out: str = "") -> dict[str, float]:
    """Areas of the unit cells; with `out`, all four in a picture and as VTP."""
    numbers: dict[str, float] = {}
    cells = {}
    for name, loop in SURFACES.items():
        coarse, fine = M.conjugate(loop, n // 2), M.conjugate(loop, n)
        area = len(loop.region.group) * (4.0 * fine.area - coarse.area) / 3.0
        assert abs(area - AREAS[name]) < 2e-4, f"{name}: {area:.6g}"
        cells[name] = M.conjugate(loop, 8).completed()
        numbers[f"area of {name}"] = area
        numbers[f"genus of {name}"] = cells[name].genus
    if out:
        for name, surface in cells.items():
            surface.mesh.save(f"{out}_{name}.vtp")
        _picture({name: surface.mesh for name, surface in cells.items()}, f"{out}.png")
    return numbers


def _picture(meshes: dict[str, "il.SurfaceMesh"], path: str) -> None:
    other_side = {"backface_params": {"color": "steelblue"}}
    scenes = [
        il.plot.Scene(view=(-31.0, 21.0), title=name).add(mesh, color="goldenrod", **other_side)
        for name, mesh in meshes.items()
    ]
    il.plot.Panels(scenes, size=(2000, 560)).save(path)


if __name__ == "__main__":
    for name, number in main(out="minimal_surfaces").items():
        print(f"{name}: {number:.6g}")
