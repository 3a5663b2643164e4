"""A mesh of 200 turned and stretched solids at n³ points against numexpr on the whole grid.

numexpr is asked for a part of the solids only, and the time is scaled; its expressions are written
by hand, one per solid. ``python -m benchmarks.bench_fields N`` measures both in one process.
"""

import json
import sys
import time
from collections.abc import Iterator
from typing import Any

import numpy as np

from benchmarks.measure import Row, alone
from ilattice._typing import AnyArray

COUNT = 200
PART = 10  # solids that numexpr is asked for
DEEPEST = "where(where(U>V,U,V)>W,where(U>V,U,V),W)"
FORMULAS = (
    "sqrt(X**2 + Y**2 + Z**2) - 1",
    "sqrt(where(U>0,U,0)**2 + where(V>0,V,0)**2 + where(W>0,W,0)**2) "
    f"+ where({DEEPEST}<0,{DEEPEST},0)",
    "sqrt((sqrt(X**2 + Y**2) - 0.8)**2 + Z**2) - 0.3",
    "sqrt((X - where(X>0.6,0.6,where(X<-0.6,-0.6,X)))**2 + Y**2 + Z**2) - 0.4",
)


def solids() -> list[tuple[int, Any, Any, Any]]:
    """Kind, matrix to local coordinates, shift and factor of every solid."""
    rng = np.random.default_rng(3)
    out = []
    for k in range(COUNT):
        stretch = rng.uniform(0.04, 0.08) * rng.uniform(0.8, 1.2, 3)
        turn, _ = np.linalg.qr(rng.normal(size=(3, 3)))
        out.append((k % 4, turn.T / stretch[:, None], rng.uniform(-0.85, 0.85, 3), stretch.min()))
    return out


def tree(count: int = COUNT) -> Any:
    """The union of the first solids as a field."""
    from ilattice import fields as f
    from ilattice.fields.algebra import _Placed

    kinds = [f.sphere(), f.box((1.0, 0.7, 0.5)), f.torus(0.8, 0.3),
             f.capsule((-0.6, 0, 0), (0.6, 0, 0), 0.4)]  # fmt: skip
    return f.union(*(_Placed(kinds[k], m, -m @ c, s) for k, m, c, s in solids()[:count]))


def blocks(n: int) -> int:
    """Number of triangles of our mesh, with sharp edges, also where it is too coarse."""
    from ilattice import fields, sdf

    solid = fields.intersection(tree(), fields.box(1.0))
    return len(sdf.mesh(solid, 2.0 / (n - 1), allow_loss=True).faces)


def numexpr(n: int, count: int = PART) -> AnyArray:
    """Values of the union of the first solids on the whole grid, in single precision."""
    import numexpr as ne

    x = np.linspace(-1, 1, n, dtype=np.float32)
    grid = {"x": x[:, None, None], "y": x[None, :, None], "z": x[None, None, :]}
    least = np.full((n, n, n), np.inf, np.float32)
    for kind, m, c, s in solids()[:count]:
        text = FORMULAS[kind]
        for name, half in zip("UVW", (1.0, 0.7, 0.5), strict=True):
            text = text.replace(name, f"(abs({'XYZ'['UVW'.index(name)]})-{half})")
        for name, row in zip("XYZ", m, strict=True):
            shift = float(row @ c)
            local = f"({row[0]}*x + {row[1]}*y + {row[2]}*z - {shift})"
            text = text.replace(name, local)
        text = f"where(({text})*{s} < least, ({text})*{s}, least)"
        ne.evaluate(text, {**grid, "least": least}, out=least, casting="same_kind")
    return least


def main(n: int) -> None:
    """Measure both, one after the other, after a warm-up."""
    found: dict[str, float] = {}
    for method in (blocks, numexpr):
        method(33)
        start, wall = time.process_time(), time.perf_counter()
        result = method(n)
        scale = COUNT / PART if method is numexpr else 1.0
        found[f"{method.__name__} cpu"] = scale * (time.process_time() - start)
        found[f"{method.__name__} wall"] = scale * (time.perf_counter() - wall)
        if method is blocks:
            found["triangles"] = result
    print(json.dumps(found))


def rows(quick: bool) -> Iterator[Row]:
    """Lines of the table: CPU, and wall, where both sides have all cores."""
    n = 201 if quick else 401
    found = alone("benchmarks.bench_fields", n)
    for clock in ("cpu", "wall"):
        ours, theirs = (found[f"{name} {clock}"] for name in ("blocks", "numexpr"))
        yield Row(
            f"mesh of a union of {COUNT} solids at {n}³, {clock}",
            f"{ours:.2f} s, {found['triangles']:.0f} triangles with sharp edges",
            f"{theirs:.1f} s numexpr, values only, from {PART} solids",
            theirs / ours,
            ">= 20x",
        )


if __name__ == "__main__":
    main(int(sys.argv[1]))
