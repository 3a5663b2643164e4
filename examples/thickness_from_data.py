"""Thickness from data: a table of points, an image, and the stress of a first analysis.

One lattice, three ways to say how thick its walls are: a CSV file with x, y, z and the thickness; a
stack of images, here made up, whose grey values are smoothed and become thickness; and the von
Mises stress of a solid bar of the same shape, so that material is where it is used. The number that
is checked: by how much walls differ from what the table says.

    python examples/thickness_from_data.py
"""

from pathlib import Path
from tempfile import mkdtemp

import numpy as np

import ilattice as il

SIZE = np.array([40.0, 20.0, 20.0])


def from_table(lattice: il.Lattice, path: Path) -> il.Wall:
    """Walls as thick as a file with the columns x, y, z, thickness says."""
    x, y, z, thickness = il.io.read_columns(path, ("x", "y", "z", "thickness")).T
    return lattice.offset(points=np.column_stack([x, y, z]), values=0.5 * thickness)


def from_image(lattice: il.Lattice, stack: np.ndarray) -> il.Wall:
    """Walls as thick as a stack of grey values (nx, ny, nz), from 0 to 1, is bright."""
    from skimage.filters import gaussian

    grey = gaussian(stack, 5.0)
    ticks = [(np.arange(n) + 0.5) / n for n in grey.shape]
    centres = np.stack(np.meshgrid(*ticks, indexing="ij"), axis=-1)
    some = (slice(4, None, 8),) * 3
    points = lattice.through.x(centres[some].reshape(-1, 3))
    return lattice.offset(points=points, values=0.4 + 0.8 * grey[some].ravel())


def from_stress(lattice: il.Lattice) -> il.Wall:
    """Walls as thick as a solid of this shape is stressed, within limits."""
    bar = il.fields.half_space((0.0, 0.0, 1.0), 2.0)  # all of the parameters, where w < 2
    problem = il.cutfem.Elasticity(
        bar, (8, 4, 4), through=lattice.through, domain=lattice.through.domain, young=2000.0
    )
    solution = problem.clamp("u=0").load(force=(0, 0, -100.0), on="u=1").solve()
    usual = np.median(solution.von_mises(np.random.default_rng(0).random((600, 3))))
    return lattice.offset(lambda u: 0.4 + 0.6 * np.tanh(0.5 * solution.von_mises(u) / usual))


def main(h: float = 0.55, out: str = "") -> dict[str, float]:
    """How far walls are from the table, and volumes; with `out`, meshes and a picture."""
    lattice = il.Lattice("gyroid", through=il.macroshape.box(SIZE), repeat=(4, 2, 2))
    rng = np.random.default_rng(1)
    corners = np.array(list(np.ndindex(2, 2, 2)))
    points = SIZE * np.concatenate([corners, rng.random((200, 3))])
    told = 1.0 + 1.2 * points[:, 0] / SIZE[0]
    table = Path(mkdtemp()) / "thickness.csv"
    rows = "\n".join(
        f"{x:.6f},{y:.6f},{z:.6f},{t:.6f}" for (x, y, z), t in zip(points, told, strict=True)
    )
    table.write_text(f"x,y,z,thickness\n{rows}\n")
    ramp = np.tile(np.linspace(0.0, 1.0, 24), (48, 24, 1))
    walls = {
        "table": from_table(lattice, table),
        "image": from_image(lattice, ramp + 0.1 * rng.standard_normal(ramp.shape)),
        "stress": from_stress(lattice),
    }
    mesh = walls["table"].mesh(h)
    asked = 1.0 + 1.2 * mesh.vertices[:, 0] / SIZE[0]
    inner = ((mesh.vertices > 2.0) & (mesh.vertices < SIZE - 2.0)).all(axis=1)
    off = np.abs(mesh.point_data["thickness"][inner] / asked[inner] - 1.0)
    if out:
        scenes = [
            il.plot.Scene(view=(-60.0, 25.0), title=f"thickness by {name}")
            .add(wall.mesh(h), scalars="thickness", unit="mm", clim=(0.8, 2.4))
            for name, wall in walls.items()
        ]  # fmt: skip
        il.plot.Panels(scenes, labels=True, size=(1800, 620)).save(f"{out}.png")
    return {
        "largest part by which walls differ from the table": float(off.max()),
        **{f"volume by {name}": wall.volume() for name, wall in walls.items()},
    }


if __name__ == "__main__":
    for name, number in main(out="thickness_from_data").items():
        print(f"{name}: {number:.4g}")
