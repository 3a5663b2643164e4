"""Figure 1 of Hong, Antolin, Elber and Kim: tiles from curves, and from a curve and a surface.

Ten curved arms meet in the middle of a tile; its corners are octants of a joint with seven other
tiles. It is shown (a) open, to be connected, and (b) closed; (c) is a closed tile of a curve and a
surface, which go on in its neighbours. The field is the least distance to the curves minus their
radius, fitted as a B-spline to 1e-3; where the arms pass through the faces, the field on opposite
faces is the same to rounding.

    python examples/fig01_tiles.py
"""

import numpy as np

import ilattice as il


def main(n: int = 64, tol: float = 1e-3, out: str = "") -> dict[str, float]:
    """Make the tiles; write ``OUT_a`` to ``OUT_c`` as VTP, and ``OUT.png``, if `out` is given."""
    tiles = {
        "a": il.tiles.ten_arms(),
        "b": il.tiles.ten_arms(faces="closed"),
        "c": il.tiles.curve_and_surface(),
    }
    axis = np.linspace(0.0, 1.0, n + 1)
    meshes = {}
    for name, tile in tiles.items():
        field = tile.fit(tol=tol) if name == "a" else tile
        meshes[name] = il.mesh.contour(field, (axis, axis, axis), caps=name != "a")
    face = np.random.default_rng(0).random((1000, 3))
    low, high = face * [0, 1, 1], face * [0, 1, 1] + [1, 0, 0]
    if out:
        for name, mesh in meshes.items():
            mesh.save(f"{out}_{name}.vtp")
        _picture(list(meshes.values()), f"{out}.png")
    return {
        "jump": np.abs(tiles["a"](low) - tiles["a"](high)).max(),
        "open edges of a": meshes["a"].open_edges,
        "open edges of b and c": meshes["b"].open_edges + meshes["c"].open_edges,
        "volume of b": meshes["b"].volume,
    }


def _picture(meshes: list["il.SurfaceMesh"], path: str) -> None:
    scenes = [il.plot.Scene(view=(-35.0, 22.0)).add(mesh, color="goldenrod") for mesh in meshes]
    il.plot.Panels(scenes, labels=True, size=(1800, 640)).save(path)


if __name__ == "__main__":
    for name, number in main(out="fig01_tiles").items():
        print(f"{name}: {number:.6g}")
