"""Figures 8 and 10 of Patience, Audet and Blais (Cesogen, 2024): what errors meshes bring in.

Figure 8: a box cut by a sphere, a P surface and a finer D surface, at once (a), and one after the
other (b), where each result is meshed and its distance goes into the next. Figure 10: a sphere
filled by a gyroid before (a) and after (b) it is meshed, read as a distance and meshed again,
several times. Colours are the distance to the surface of the first field, on a scale of logarithms.
In the paper the last step of the sequence, a gyroid finer than these, and the 16th roundtrip end
in a division by zero. The numbers that are checked: the root of the mean square of the distances at
vertices is 3.6e-4 at once and 9.1e-4 one after the other, most of it along edges, which every mesh
rounds off a little; and it grows from trip to trip, from 1.28e-3 to 1.68e-3 after three of them.

    python examples/cesogen_errors.py
"""

import warnings

import numpy as np

import ilattice as il

STEPS = ("box scale 4 sphere scale 5", "p-surface scale 4", "d-surface scale 3.75")
BALL = "box scale 4 sphere scale 4 gyroid scale 4"


def sequence(h: float) -> "il.SurfaceMesh":
    """The hierarchical solid with a mesh after every step."""
    field = il.sdf.parse(STEPS[0])
    for step in STEPS[1:]:
        distance = il.sdf.MeshDistance(il.sdf.mesh(field, h))
        field = il.fields.intersection(distance, il.sdf.parse(step))
    return il.sdf.mesh(field, h)


def roundtrips(h: float, count: int) -> list["il.SurfaceMesh"]:
    """A mesh, and those made of its distance, of the distance to that, and so on."""
    meshes = [il.sdf.mesh(il.sdf.parse(BALL), h)]
    for _ in range(count):
        meshes.append(il.sdf.mesh(il.sdf.MeshDistance(meshes[-1]), h))
    return meshes


def with_error(mesh: "il.SurfaceMesh", field: "il.fields.Field") -> "il.SurfaceMesh":
    """Distances of the vertices to the zero set of a field, to first order; at least rounding."""
    value, slope = field.jet(mesh.vertices, 1)[:2]
    off = np.abs(value) / np.maximum(np.linalg.norm(slope, axis=1), 1e-3)
    return mesh.with_point_data(error=np.maximum(off, 1e-16))


def main(h: float = 8 / 130, ball: float = 8 / 100, count: int = 3, out: str = "") -> dict:
    """Root mean squares of the errors; write ``OUT_8.png`` and ``OUT_10.png`` if `out` is given."""
    with warnings.catch_warnings():  # meshes of meshes are told to be coarse, and are
        warnings.simplefilter("ignore", il.errors.PrecisionWarning)
        field, first = il.sdf.parse(" ".join(STEPS)), il.sdf.parse(BALL)
        hierarchy = [with_error(m, field) for m in (il.sdf.mesh(field, h), sequence(h))]
        trips = [with_error(m, first) for m in roundtrips(ball, count)]
    if out:
        _picture(hierarchy, ("at once", "one after the other"), f"{out}_8.png")
        titles = ("before", f"after {count} roundtrips")
        _picture([trips[0], trips[-1]], titles, f"{out}_10.png")
    return {
        "at once": rms(hierarchy[0]),
        "one after the other": rms(hierarchy[1]),
        **{f"after {k} roundtrips": rms(mesh) for k, mesh in enumerate(trips)},
    }


def rms(mesh: "il.SurfaceMesh") -> float:
    """Root of the mean square of the errors at vertices."""
    return float(np.sqrt(np.mean(mesh.point_data["error"] ** 2)))


def _picture(meshes: list["il.SurfaceMesh"], titles: tuple[str, ...], path: str) -> None:
    scenes = [
        il.plot.Scene(title=title).add(
            mesh, scalars="error", label="distance to the field", log_scale=True,
            clim=(1e-16, 1.0), cmap="viridis",
        )
        for mesh, title in zip(meshes, titles, strict=True)
    ]  # fmt: skip
    il.plot.Panels(scenes, labels=True, size=(1800, 800)).save(path)


if __name__ == "__main__":
    for name, number in main(out="cesogen_errors").items():
        print(f"{name}: {number:.3g}")
