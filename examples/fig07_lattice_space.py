"""Figures 7 and 8 of Hong, Antolin, Elber and Kim: one wall in the domain and in space.

Figure 7: a Schwarz P tile (a) in the domain D and (b) mapped into space; (c) the points that
closest-point searches start from; the wall of half-thickness 0.08 in space, (d) in D, where its
thickness is not constant, and (e) in space, where it is: to 1e-6. Figure 8: the background grid of
an analysis. Its cells are inside (yellow), cut (orange) or outside of the wall (not shown): called
so by certificates, never by samples, so that the volumes of those inside, and of those inside or
cut, are bounds of that of the wall.

    python examples/fig07_lattice_space.py
"""

import numpy as np

import ilattice as il


def main(d: float = 0.08, h: float = 0.03, cells: int = 24, out: str = "") -> dict[str, float]:
    """Build the wall and the grid; write ``OUT*.vtp`` and ``OUT_*.png`` if `out` is given."""
    volume = il.macroshape.hexahedron(
        [[0, 0, 0], [1.4, 0, 0.1], [1.2, 1.3, 0], [0, 1, 0], [0.1, 0, 1], [1.1, 0.1, 0.8],
         [1.5, 1.1, 1.5], [0.1, 0.9, 1.2]]
    )  # fmt: skip
    lattice = il.Lattice(il.tiles.schwarz_p(), through=volume)
    wall = lattice.offset(d)
    mesh = wall.mesh(h)
    flat = flattened(mesh)
    on = mesh.point_data["side"] != 0
    grid = il.cutfem.cut(wall, cells)
    volumes = cell_volumes(volume, cells)
    status = grid.status
    if out:
        mesh.save(f"{out}.vtp")
        _panels(lattice, flat, mesh, f"{out}_maps.png")
        _grid(volume, status, mesh, f"{out}_grid.png")
    there = il.Lattice(il.tiles.schwarz_p(), through=il.macroshape.box())
    in_domain = np.abs(there.distance(np.clip(flat.vertices[on], 0.0, 1.0)))
    return {
        "error in space": wall.thickness_error(mesh).relative,
        "thickness in the domain": float(in_domain.max() / in_domain.min()),
        "inside": float(volumes[status < 0].sum()),
        "inside or cut": float(volumes[status <= 0].sum()),
        "volume": grid.volume(3).in_space().integrate(),
        "volume of the mesh": mesh.volume,
    }


def flattened(mesh: "il.SurfaceMesh") -> "il.SurfaceMesh":
    """The same mesh in the domain."""
    u = np.stack([mesh.point_data[name] for name in "uvw"], axis=1)
    return il.SurfaceMesh(u, mesh.faces)


def cell_volumes(volume: il.SplineMap, n: int) -> np.ndarray:
    """Volumes in space of the cells of a grid, shape (n, n, n), by two Gauss points."""
    a = (np.arange(n)[:, None] + 0.5 + np.array([-0.5, 0.5]) / np.sqrt(3.0)).ravel() / n
    u = np.stack(np.meshgrid(a, a, a, indexing="ij"), axis=-1).reshape(-1, 3)
    det = np.linalg.det(volume.jacobian(u)).reshape(n, 2, n, 2, n, 2)
    return det.sum(axis=(1, 3, 5)) / (2 * n) ** 3


def _panels(lattice: il.Lattice, flat: "il.SurfaceMesh", mesh: "il.SurfaceMesh", path: str) -> None:
    """Figure 7, (a) to (e)."""
    import pyvista as pv

    axis = np.linspace(0.0, 1.0, 49)
    middle = il.mesh.contour(lattice.tile.kernel_field, [axis] * 3, caps=False)
    mapped = middle.to_pyvista()
    mapped.points = lattice.through.x(np.clip(middle.vertices, 0.0, 1.0))
    p, seeds = lattice.search.seeds[:2]  # those of neighbouring tiles, beyond the part, left out
    seeds = seeds[((p >= 0.0) & (p <= 1.0)).all(axis=1)]
    panels = [middle.to_pyvista(), mapped, pv.PolyData(seeds),
              flat.to_pyvista(), mesh.to_pyvista()]  # fmt: skip
    colours = ["firebrick", "firebrick", "black", "gold", "gold"]
    frame = pv.Box((0, 1, 0, 1, 0, 1)).extract_all_edges()
    scene = pv.Plotter(off_screen=True, window_size=(2000, 480), shape=(1, 5), border=False)
    scene.enable_anti_aliasing("ssaa")
    for i, (panel, colour) in enumerate(zip(panels, colours, strict=True)):
        scene.subplot(0, i)
        scene.add_mesh(
            panel, color=colour, point_size=8, smooth_shading=i != 2, split_sharp_edges=i > 2,
            ambient=0.2,
        )  # fmt: skip
        box = frame.copy()
        if i not in (0, 3):
            box.points = lattice.through.x(frame.points)
        scene.add_mesh(box, color="gray", line_width=3)
        scene.add_text(f"({'abcde'[i]})", position="upper_left", font_size=12, color="black")
        scene.view_vector((1.0, -1.6, 0.9))
        scene.camera.zoom(1.1)
    scene.screenshot(path)
    scene.close()


def _grid(volume: il.SplineMap, status: np.ndarray, mesh: "il.SurfaceMesh", path: str) -> None:
    """Figure 8: the cells of the farther half of the part, and all of the wall."""
    import pyvista as pv

    n = len(status)
    u = np.stack(np.meshgrid(*[np.linspace(0.0, 1.0, n + 1)] * 3, indexing="ij"), axis=-1)
    x = volume.x(u.reshape(-1, 3)).reshape(u.shape)
    grid = pv.StructuredGrid(*np.moveaxis(x, -1, 0))
    grid.cell_data["status"] = status.ravel(order="F")
    near = np.indices(status.shape)[1].ravel(order="F") < n // 2
    shown = grid.extract_cells((grid["status"] <= 0) & ~near)
    frame = grid.extract_surface(algorithm=None).extract_feature_edges(30)
    scene = pv.Plotter(off_screen=True, window_size=(1600, 700), shape=(1, 2), border=False)
    scene.enable_anti_aliasing("ssaa")
    scene.add_mesh(
        mesh.to_pyvista(), color="gold", smooth_shading=True, split_sharp_edges=True, ambient=0.2
    )
    scene.add_mesh(frame, color="gray", line_width=3)
    scene.view_vector((0.6, -1.6, 0.9))
    scene.camera.zoom(1.15)
    scene.subplot(0, 1)
    scene.add_mesh(
        shown, scalars="status", cmap=["gold", "darkorange"], show_edges=True,
        show_scalar_bar=False, ambient=0.2,
    )  # fmt: skip
    scene.add_mesh(frame, color="gray", line_width=3)
    scene.view_vector((0.6, -1.6, 0.9))
    scene.camera.zoom(1.15)
    scene.screenshot(path)
    scene.close()


if __name__ == "__main__":
    for name, number in main(out="fig07").items():
        print(f"{name}: {number:.6g}")
