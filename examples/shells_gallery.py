"""Figure 10 of Xu, Pan, Wang, Du and Lu: shells of many classes, reflected and translated.

Ten unit cells of different topology: like Schwarz D, Neovius, F-RD, P and I-WP, and others, of
which the last ones are not alike along all axes. Euler numbers per cell are those of the surfaces
that they are like: -16 (D, Neovius), -40 (F-RD), -12 (I-WP), -4 (P).

    python examples/shells_gallery.py
"""

import ilattice as il

CELLS = {
    "a": ("topo_1_ttt", 0.0, 1.2),
    "b": ("topo_1_rrr", (0.2, 0.2, 0.0), 1.5),
    "c": ("topo_8_rrr", (-0.6, 0.6, -0.3), 2.5),
    "d": ("topo_11_rrr", (0.0, 0.0), 2.5),
    "e": ("topo_14_rrr", (-0.3, 0.3), 2.5),
    "f": ("topo_18_rrr", 0.6, 3.0),
    "g": ("topo_19_rrr", 0.0, 1.7),
    "h": ("c13_rrr", 0.0, 1.2),
    "i": ("c18_rrr", 0.0, 1.2),
    "j": ("c12_trr", 0.0, 1.2),
}


def main(n: int = 24, out: str = "") -> dict[str, float]:
    """Euler numbers; with `out`, walls of density 0.2 as ``OUT_a.stl`` ... and a picture."""
    numbers, meshes = {}, {}
    for letter, (name, position, derivative) in CELLS.items():
        shell = il.shells.cell(name, position=position, derivative=derivative, n=n, layer=0.02)
        numbers[f"{letter}, {name}: Euler number"] = shell.periodic.euler
        if out:
            lattice = il.Lattice(shell.tile, through=il.macroshape.box(), repeat=1)
            meshes[f"{letter}: {name}"] = lattice.offset(relative_density=0.2).mesh(h=0.03)
            meshes[f"{letter}: {name}"].save(f"{out}_{letter}.stl")
    if out:
        _picture(meshes, f"{out}.png")
    return numbers


def _picture(meshes: dict[str, "il.SurfaceMesh"], path: str) -> None:
    import pyvista as pv

    scene = pv.Plotter(off_screen=True, window_size=(2000, 900), shape=(2, 5), border=False)
    for i, (name, mesh) in enumerate(meshes.items()):
        scene.subplot(i // 5, i % 5)
        scene.add_mesh(mesh.to_pyvista(), color="lightsteelblue", specular=0.3, smooth_shading=True,
                       split_sharp_edges=True)  # fmt: skip
        scene.add_text(name, position="upper_left", font_size=11, color="black")
        scene.view_vector((1.0, -1.3, 0.8))
        scene.camera.zoom(1.25)
    scene.screenshot(path)
    scene.close()


if __name__ == "__main__":
    for name, number in main(out="shells_gallery").items():
        print(f"{name}: {number:.6g}")
