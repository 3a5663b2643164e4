"""Figures 3, 4 and 5 of Hong, Antolin, Elber and Kim: tiles, and where they lie in a volume.

Figure 3: a tile is the image of one box of the domain D; there, the implicit function of the
lattice is that of the tile, to rounding. Figure 4: the tile of four lines (a), and
three of it in a row, of one thickness (b), then graded (c); one colour repeats in every tile, the
others go through the row. As a spline with ten coefficients per direction the tile has a volume
that is off by a tenth. Figure 5:
a gyroid with 10 x 10 x 10 coefficients. If these are set to samples, as the paper has it, the tile
is off by 0.61, where values go up to 1.5; as many coefficients that interpolate are off by 0.013.

    python examples/fig03_tiles.py
"""

import numpy as np

import ilattice as il
from ilattice.bspline.fit import fit

#: Eight spans of degree two: ten coefficients per direction.
PAPER = {"degree": 2, "spans": 8}


def lattice_of(volume: il.SplineMap, repeat: tuple[int, int, int]) -> il.Lattice:
    """Lattice of the tile of Figure 4, with a colour that repeats in every tile."""
    lines = il.tiles.four_lines(radius=0.1)
    tile = il.Tile(fit(lines, method="interpolate", periodic=True, **PAPER), name="four lines")
    wave = tile.with_properties(g=lambda p: 0.5 - 0.4 * np.cos(2 * np.pi * p[:, 0]))
    return il.Lattice(wave, through=volume, repeat=repeat)


def embedded(out: str) -> float:
    """Figure 3: largest difference between a tile and the lattice, in one box of the domain."""
    volume = il.macroshape.cylinder_shell(1.5, 2.7, 1.0, angle=0.75 * np.pi)
    colours = {"r": lambda u: u[:, 0], "b": lambda u: 1.0 - u[:, 0]}
    lattice = lattice_of(volume.with_extra(**colours), (4, 1, 1))
    p = np.random.default_rng(0).random((10_000, 3))
    box = (p + np.array([2.0, 0.0, 0.0])) / np.array(lattice.repeat)  # of the third tile
    if out:
        mesh = lattice.offset((np.inf, 0.0), space="parametric").mesh(0.03)
        mesh.save(f"{out}_embedded.vtp")
        _picture_of_maps(mesh, volume, f"{out}_embedded.png")
    return float(np.abs(lattice.implicit(box) - lattice.tile(p)).max())


def rows(h: float, out: str) -> dict[str, float]:
    """Figure 4: by how much the radius of arms grows from the first tile to the last."""
    tile = lattice_of(il.macroshape.box(), (1, 1, 1)).tile
    mesh = il.mesh.contour(tile, [np.linspace(0.0, 1.0, int(np.ceil(1.0 / h)) + 1)] * 3)
    exact = il.tiles.four_lines(radius=0.1)(np.random.default_rng(0).random((200_000, 3)))
    gained = {"volume of the tile over that of the lines": mesh.volume / float((exact < 0).mean())}
    if out:
        mesh.save(f"{out}_tile.vtp")
        _picture_of_a_tile(mesh, f"{out}_tile.png")
    for kind, high in (("uniform", 0.0), ("graded", 0.12)):
        row = il.macroshape.box((3, 1, 1)).with_extra(
            r=lambda u: u[:, 0], b=lambda u: 1.0 - u[:, 0], d=lambda u, high=high: high * u[:, 0]
        )
        d = "d" if high else 0.0
        lattice = lattice_of(row, (3, 1, 1))
        mesh = lattice.offset((np.inf, d), space="parametric").mesh(h)
        gained[kind] = radius(mesh, 2.5) / radius(mesh, 0.5)
        if out:
            mesh.save(f"{out}_{kind}.vtp")
            mesh.screenshot(f"{out}_{kind}.png", view=(-70.0, 20.0))
    return gained


def radius(mesh: il.SurfaceMesh, x: float) -> float:
    """Mean radius of the upright arm in the middle of a tile, where no other arm is near."""
    across = mesh.vertices[:, :2] - [x, 0.5]
    far = np.abs(mesh.vertices[:, 2] - 0.5)
    on = (far > 0.4) & (far < 0.49) & (np.linalg.norm(across, axis=1) < 0.4)
    return float(np.linalg.norm(across[on], axis=1).mean())


def gyroids(n: int, out: str) -> dict[str, float]:
    """Figure 5: largest error of each way to find the coefficients."""
    gyroid = il.tiles.gyroid()
    axis = np.linspace(0.0, 1.0, n + 1)
    errors, surfaces = {}, []
    for method in ("uniform-sampling", "greville", "interpolate"):
        spline = fit(gyroid, method=method, **PAPER)
        errors[method] = float(np.abs(spline.grid([axis] * 3) - gyroid.grid([axis] * 3)).max())
        if out:
            mesh = il.mesh.contour(spline, [axis] * 3, caps=False)
            value, slope = gyroid.jet(np.clip(mesh.vertices, 0.0, 1.0), 1)
            off = np.abs(value) / np.linalg.norm(slope, axis=1)
            surfaces.append(mesh.with_point_data(off=off))
    if out:
        surfaces[0].save(f"{out}_gyroid.vtp")
        _picture_of_gyroids(surfaces, f"{out}_gyroid.png")
    return errors


def main(h: float = 0.025, n: int = 60, out: str = "") -> dict[str, float]:
    """Make the three figures; write ``OUT_*.vtp`` and ``OUT_*.png`` if `out` is given."""
    grown = rows(h, out)
    return {"difference": embedded(out), **grown, **gyroids(n, out)}


def _picture_of_a_tile(mesh: "il.SurfaceMesh", path: str) -> None:
    """Figure 4 (a): one tile in its cell."""
    scene = il.plot.Scene(view=(-60.0, 25.0)).add(mesh, color="goldenrod")
    scene.lines([[0, 0, 0], [1, 1, 1]], color="gray").save(path)


def _picture_of_maps(mesh: "il.SurfaceMesh", volume: il.SplineMap, path: str) -> None:
    """The lattice in the domain and in space, the box of its third tile in black."""
    u = np.stack([mesh.point_data[c] for c in "uvw"], axis=1)
    flat = il.SurfaceMesh(u * [4, 1, 1], mesh.faces, {c: mesh.point_data[c] for c in "rgb"})
    scenes = [
        il.plot.Scene(view=(-68.0, 37.0), title="in the domain").add(flat),
        il.plot.Scene(view=(-63.0, 56.0), title="in space").add(mesh),
    ]
    t = np.linspace(0.0, 1.0, 25)
    for i in (0, 1, 3, 2):
        edges = [
            np.insert(np.tile(ends, (25, 1)).astype(float), axis, t, axis=1) + np.array([i, 0, 0])
            for axis in range(3)
            for ends in np.ndindex(2, 2)
        ]
        look = {"color": "black", "width": 8} if i == 2 else {"color": "gray", "width": 2}
        curves = [volume.x(edge / [4, 1, 1]) for edge in edges]
        scenes[0] = scenes[0].lines(il.plot.polylines(edges), **look)
        scenes[1] = scenes[1].lines(il.plot.polylines(curves), **look)
    il.plot.Panels(scenes, size=(1600, 620)).save(path)


def _picture_of_gyroids(surfaces: list["il.SurfaceMesh"], path: str) -> None:
    """The zero sets, coloured by how far off they are, in tile edges."""
    titles = ("samples as coefficients", "samples at Greville points", "interpolation")
    scenes = [
        il.plot.Scene(view=(-58.0, 25.0), title=title).add(
            mesh, scalars="off", label="distance to the gyroid, in tiles", clim=(0.0, 0.06),
            cmap="YlOrBr",
        )
        for mesh, title in zip(surfaces, titles, strict=True)
    ]  # fmt: skip
    il.plot.Panels(scenes, size=(1800, 640)).save(path)


if __name__ == "__main__":
    for name, number in main(out="fig03").items():
        print(f"{name}: {number:.6g}")
