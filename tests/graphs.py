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


def every_type():
    """A graph with every type of node."""
    v = [g.vertex(p) for p in HEXAGON]
    ring = g.surface(g.chain(v, closed=True), kind="conjugate", thickness=0.1, edges=4)
    family = g.associate(g.dual(ring), ring, angle=0.7)
    arc = g.line(
        [g.chain(v[:3], smooth=True), g.chain([v[2], v[4]])], thickness=[(0, 0.05), (1, 0.2)]
    )
    film = g.surface(loop(HEXAGON[:4]), thickness=[((0, 0), 0.1), ((1, 0), 0.2)], edges=4)
    moved = g.group([film, family]).moved((0.1, 0, 0), angle=0.3, scale=(1, 0.5, 1), copy=True)
    one, two = g.object(arc.mirrored((1, 1, 0))), g.object(moved)
    voxel = g.voxel(g.difference(one, two), young=2.0)
    words = {"source": "tests"}
    roots = [g.stiffness(voxel), g.bandgap(voxel, curves=3)]
    return g.Graph(roots, g.cuboid(), "all", about=words)
