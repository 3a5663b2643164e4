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
        _grid(grid, mesh, f"{out}_grid.png")
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
    axis = np.linspace(0.0, 1.0, 49)
    middle = il.mesh.contour(lattice.tile.kernel_field, [axis] * 3, caps=False)
    mapped = lattice.through.x(np.clip(middle.vertices, 0.0, 1.0))
    p, seeds = lattice.search.seeds[:2]  # those of neighbouring tiles, beyond the part, left out
    seeds = seeds[((p >= 0.0) & (p <= 1.0)).all(axis=1)]
    scene = il.plot.Scene(view=(-58.0, 25.0))
    scenes = [
        scene.add(middle, color="firebrick"),
        scene.add(il.SurfaceMesh(mapped, middle.faces), color="firebrick"),
        scene.add(seeds, color="black", radius=0.012),
        scene.add(flat, color="gold"),
        scene.add(mesh, color="gold"),
    ]
    box = np.array([[0.0, 0.0, 0.0], [1.0, 1.0, 1.0]])
    ends = list(np.ndindex(2, 2))
    edges = [np.insert(np.tile(e, (2, 1)), axis, (0, 1), axis=1) for axis in range(3) for e in ends]
    curves = il.plot.polylines([lattice.through.x(edge) for edge in edges])
    scenes = [s.lines(box if i in (0, 3) else curves, color="gray") for i, s in enumerate(scenes)]
    il.plot.Panels(scenes, labels=True, size=(2000, 480)).save(path)


def _grid(grid: "il.cutfem.CutGrid", mesh: "il.SurfaceMesh", path: str) -> None:
    """Figure 8: the cells of the farther half of the part, and all of the wall."""
    scene = il.plot.Scene(view=(-69.0, 28.0))
    cells = scene.add(grid, scalars="status", label="", cmap=["gold", "darkorange"], clim=(-1, 0),
                      show_edges=True)  # fmt: skip
    il.plot.Panels([scene.add(mesh, color="gold"), cells.clipped("y > 0.55")]).save(path)


if __name__ == "__main__":
    for name, number in main(out="fig07").items():
        print(f"{name}: {number:.6g}")
