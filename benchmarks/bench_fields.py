"""A union of 200 turned and stretched solids on n³ points against numexpr on the whole grid.

numexpr is not among the dependencies: install it to run this. It is asked for a part of the solids
only, and the time is scaled; its expressions are written by hand, one per solid.
``python -m benchmarks.bench_fields METHOD N`` measures one side in a process of its own.
"""

import json
import sys
import time
from collections.abc import Iterator
from typing import Any

import numpy as np

from benchmarks.measure import Row, alone

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


def tree() -> Any:
    """The union as a field."""
    from ilattice import fields as f
    from ilattice.fields.algebra import _Placed

    kinds = [f.sphere(), f.box((1.0, 0.7, 0.5)), f.torus(0.8, 0.3),
             f.capsule((-0.6, 0, 0), (0.6, 0, 0), 0.4)]  # fmt: skip
    return f.union(*(_Placed(kinds[k], m, -m @ c, s) for k, m, c, s in solids()))


def blocks(n: int) -> int:
    """Number of triangles of our mesh."""
    from ilattice.mesh import contour

    return len(contour(tree(), (np.linspace(-1, 1, n),) * 3, dtype=np.float32).faces)


def numexpr(n: int) -> int:
    """Values of some of the solids on the whole grid; points inside."""
    import numexpr as ne

    x = np.linspace(-1, 1, n, dtype=np.float32)
    grid = {"x": x[:, None, None], "y": x[None, :, None], "z": x[None, None, :]}
    least = np.full((n, n, n), np.inf, np.float32)
    for kind, m, c, s in solids()[:PART]:
        text = FORMULAS[kind]
        for name, half in zip("UVW", (1.0, 0.7, 0.5), strict=True):
            text = text.replace(name, f"(abs({'XYZ'['UVW'.index(name)]})-{half})")
        for name, row in zip("XYZ", m, strict=True):
            shift = float(row @ c)
            local = f"({row[0]}*x + {row[1]}*y + {row[2]}*z - {shift})"
            text = text.replace(name, local)
        text = f"where(({text})*{s} < least, ({text})*{s}, least)"
        ne.evaluate(text, {**grid, "least": least}, out=least, casting="same_kind")
    return int((least < 0).sum())


METHODS = {"blocks": blocks, "numexpr": numexpr}


def main(method: str, n: str) -> None:
    """Measure one method after a warm-up."""
    METHODS[method](33)
    start, wall = time.process_time(), time.perf_counter()
    count = METHODS[method](int(n))
    scale = COUNT / PART if method == "numexpr" else 1.0
    result = {
        "cpu": scale * (time.process_time() - start),
        "wall": scale * (time.perf_counter() - wall),
        "count": count,
    }
    print(json.dumps(result))


def rows(quick: bool) -> Iterator[Row]:
    """Lines of the table."""
    n = 201 if quick else 401
    ours, theirs = (alone("benchmarks.bench_fields", m, n) for m in ("blocks", "numexpr"))
    yield Row(
        f"mesh of a union of {COUNT} solids at {n}³, CPU",
        f"{ours['cpu']:.2f} s, wall {ours['wall']:.2f} s, {ours['count']:.0f} triangles",
        f"{theirs['cpu']:.1f} s numexpr, values only, from {PART} solids",
        theirs["cpu"] / ours["cpu"],
        ">= 20x",
    )


if __name__ == "__main__":
    main(*sys.argv[1:])
