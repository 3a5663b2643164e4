"""Graphs that several tests take."""

import ilattice as il

g = il.graph
HEXAGON = (
    (0.5, 0, 0.25), (0.5, 0.25, 0), (0.25, 0.5, 0), (0, 0.5, 0.25), (0, 0.25, 0.5), (0.25, 0, 0.5),
)  # fmt: skip


def loop(points, **options):
    return g.chain([g.vertex(p) for p in points], closed=True, **options)


def schwarz_p(**options):
    patch = g.surface(loop(HEXAGON), kind="conjugate", edges=8, **options)
    return g.Graph(g.object(patch.mirrored("x").mirrored("y").mirrored("z")), within=g.cuboid())


def strut(a=(0, 0, 0), b=(0.5, 0.5, 0.5), thickness=0.1):
    return g.line(g.chain([g.vertex(a), g.vertex(b)]), thickness=thickness)
