"""Figure 6 of Xu, Pan, Wang, Du and Lu: one class of boundaries, different positions of its nodes.

Two boundaries of the class of Neovius' surface, and two of that of Schwarz P, with the surfaces
over them in an octant. The triangles at the mirrors meet them at right angles, but for about the
turn of half a triangle: the mean sine of the angle by which they miss it is below 0.03.

    python examples/shells_variations.py
"""

import ilattice as il

VARIATIONS = {
    "N-like, wide": ("topo_1", (0.2, 0.2, 0.0), 1.0),
    "N-like, slanted": ("topo_1", (0.1, 0.3, 0.2), 1.4),
    "P-like, symmetric": ("topo_19", 0.0, 1.7),
    "P-like, skew": ("topo_19", 0.35, 1.2),
}


def main(n: int = 32, out: str = "") -> dict[str, float]:
    """Areas and slopes; draw the surfaces to ``OUT.png`` if `out` is given."""
    numbers, meshes = {}, {}
    for name, (topology, position, derivative) in VARIATIONS.items():
        curves = il.shells.boundary(topology, position, derivative)
        shell = il.shells.surface(curves, n=n)
        numbers[f"{name}: area"] = shell.area
        numbers[f"{name}: slope at mirrors"] = shell.slope
        meshes[name] = shell.mesh
    if out:
        _picture(meshes, f"{out}.png")
    return numbers


def _picture(meshes: dict[str, "il.SurfaceMesh"], path: str) -> None:
    import pyvista as pv

    scene = pv.Plotter(off_screen=True, window_size=(2000, 560), shape=(1, 4), border=False)
    for i, (name, mesh) in enumerate(meshes.items()):
        scene.subplot(0, i)
        surface = mesh.to_pyvista()
        scene.add_mesh(surface, color="goldenrod", smooth_shading=True, specular=0.3,
                       backface_params={"color": "steelblue"})  # fmt: skip
        rim = surface.extract_feature_edges(manifold_edges=False, feature_edges=False)
        scene.add_mesh(rim, color="black", line_width=5)
        scene.add_mesh(pv.Box((0.5, 1, 0.5, 1, 0.5, 1)), style="wireframe", color="grey")
        scene.add_text(name, position="upper_left", font_size=12, color="black")
        scene.view_vector((1.0, -1.5, 0.9))
        scene.camera.zoom(1.2)
    scene.screenshot(path)
    scene.close()


if __name__ == "__main__":
    for name, number in main(out="shells_variations").items():
        print(f"{name}: {number:.6g}")
