"""Figure 2 of Hong, Antolin, Elber and Kim: level sets are not offsets.

Two implicit functions with one and the same zero set, the Schwarz P surface: the
trigonometric one, and that one times exp(sin 2 pi u). A level set of the second is not where that
of the first is, so a level cannot be a thickness. Measured about the surface of the unit cell,
for a half-thickness of 0.05: the level set of the best constant is between 0.77 and 1.37 times as
far away as asked, that of the graded function between 0.38 and 3.9 times; the parametric offset,
of first order, between 0.92 and 1.05, and 0.82 and 1.21 times. The offset by closest points is
exact. In the first picture: both level sets and, at the right, that offset. White is right, blue
walls are too thin, red ones too thick.

The second picture is that of the paper: the four lines of (b) are the middle of two solids that are
the same at level 0 (red). At level 0.05 (green), arms of the distance (a) have grown by 0.05
everywhere, those of the graded field (c) by 0.05 at the left end and by a third of it at the right
one. Thick ovals mark that pair of arms, thin ones arms that have grown alike.

    python examples/fig02_level_sets.py
"""

from typing import Any

import numpy as np

import ilattice as il


def spread(lattice: il.Lattice, vertices: np.ndarray, d: float) -> tuple[float, float]:
    """Least and largest distance of points of the unit cube, relative to the asked one."""
    distance = np.abs(lattice.distance(np.clip(vertices, 0.0, 1.0)))
    return float(distance.min() / d), float(distance.max() / d)


def main(d: float = 0.05, h: float = 0.04, out: str = "") -> dict[str, Any]:
    """Make both walls in all ways; write ``OUT.png`` if `out` is given."""
    plain = il.tiles["primitive"]
    graded = il.Tile(lambda u: plain(u) * np.exp(np.sin(2 * np.pi * u[:, 0])), name="graded")
    axes = [np.linspace(0.0, 1.0, int(np.ceil(1.0 / h)) + 1)] * 3
    result: dict[str, Any] = {}
    shown = []
    for tile in (plain, graded):
        lattice = il.Lattice(tile, through=il.macroshape.box())
        middle = il.mesh.contour(tile.kernel_field, axes, caps=False)
        slope = np.linalg.norm(tile.jet(np.clip(middle.vertices, 0, 1), 1)[1], axis=1).mean()
        level = il.mesh.contour(tile.kernel_field, axes, level=(-d * slope, d * slope), caps=False)
        result[f"{tile.name}: level set"] = spread(lattice, level.vertices, d)
        for space in ("parametric", "euclidean"):
            mesh = lattice.offset(d, space=space).mesh(h=h)
            on = mesh.point_data["side"] != 0
            result[f"{tile.name}: {space}"] = spread(lattice, mesh.vertices[on], d)
        shown.append(coloured(lattice, level, d))
    result |= arms(d, h, out)
    if out:
        _picture([*shown, coloured(lattice, without_ends(mesh), d)], f"{out}.png")
    return result


def arms(d: float, h: float, out: str) -> dict[str, tuple[float, float]]:
    """By how much arms grow at the left and the right end, relative to d, of both fields."""
    lines = il.tiles.four_lines(radius=0.08)
    axes = [np.linspace(0.0, 1.0, 2 * int(np.ceil(1.0 / h)) + 1)] * 3
    fields = {
        "lines": lines,
        "graded lines": lambda u: lines(u) * (1.0 + 2.0 * u[:, 0] ** 2),
    }
    result, solids = {}, []
    for name, field in fields.items():
        pair = [il.mesh.contour(field, axes, level=level) for level in (0.0, d)]
        x = pair[1].vertices
        ends = (x[np.abs(x[:, 0] - at) < 1e-9] for at in (0.0, 1.0))
        rims = (end[lines(end) > 0.2 * d] for end in ends)  # without what is inside of the rim
        result[name] = tuple(float(lines(rim).max() / d) for rim in rims)
        solids.append(pair)
    if out:
        _picture_of_arms(solids, f"{out}_four_lines.png")
    return result


def _picture_of_arms(solids: list[list["il.SurfaceMesh"]], path: str) -> None:
    """The levels of both fields, the outer one as glass, and the curves between them."""
    cube = [[0.0, 0.0, 0.0], [1.0, 1.0, 1.0]]
    ends = [[(0, 0.25, 0.5), (1, 0.25, 0.5)], [(0, 0.75, 0.5), (1, 0.75, 0.5)],
            [(0.5, 0, 0.5), (0.5, 1, 0.5)], [(0.5, 0.5, 0), (0.5, 0.5, 1)]]  # fmt: skip
    curves = il.plot.polylines([np.array(line, float) for line in ends])
    scene = il.plot.Scene(view=(-40.0, 25.0), occlusion=False).lines(cube, color="gray")
    scenes = []
    for inner, outer in solids:
        both = scene.add(inner, color="firebrick").add(outer, color="seagreen", opacity=0.4)
        both = both.lines(ovals((1.0, 0.25, 0.5), (1.0, 0.75, 0.5)), color="black", width=5)
        scenes.append(both.lines(ovals((0.5, 0.0, 0.5), axis=1), color="black", width=2))
    scenes.insert(1, scene.lines(curves, color="black", width=6))
    il.plot.Panels(scenes, labels=True, size=(2000, 720)).save(path)


def ovals(*middles: tuple[float, float, float], axis: int = 0) -> Any:
    """Circles about the ends of arms along an axis, of radius 0.22."""
    angles = np.linspace(0.0, 2 * np.pi, 60, endpoint=False)
    circle = np.insert(0.22 * np.column_stack([np.cos(angles), np.sin(angles)]), axis, 0.0, axis=1)
    return il.plot.polylines([circle + middle for middle in middles], closed=True)


def coloured(lattice: il.Lattice, mesh: "il.SurfaceMesh", d: float) -> "il.SurfaceMesh":
    """The mesh with its distance to the mid-surface, relative to the asked one."""
    distance = np.abs(lattice.distance(np.clip(mesh.vertices, 0.0, 1.0)))
    return mesh.with_point_data(relative=distance / d)


def without_ends(mesh: "il.SurfaceMesh") -> "il.SurfaceMesh":
    """The offset surfaces alone, without the faces of the cube."""
    flat = (mesh.vertices == 0.0) | (mesh.vertices == 1.0)
    return mesh.select(~flat[mesh.faces].all(axis=1).any(axis=1))


def _picture(meshes: list["il.SurfaceMesh"], path: str) -> None:
    """All in one scale of colours."""
    titles = ("level set", "level set of the graded function", "offset by closest points")
    scenes = [
        il.plot.Scene(view=(-58.0, 25.0), title=title).add(
            mesh, scalars="relative", label="distance / asked distance", log_scale=True,
            clim=(0.25, 4.0), cmap="coolwarm",
        )
        for mesh, title in zip(meshes, titles, strict=True)
    ]  # fmt: skip
    il.plot.Panels(scenes, size=(1800, 640)).save(path)


if __name__ == "__main__":
    for name, numbers in main(out="fig02").items():
        print(f"{name:25s} {numbers[0]:.3f} ... {numbers[1]:.3f}")
