"""Random walls of all kinds, and what an oracle that shares no code with the kernel says of them.

    python tests/combinations.py --first 0 --count 100 --table /tmp/table.csv

A combination is a tile of the catalogue, a map, repeats, a boundary rule, a thickness, a length of
edges and a scale, all from one seed. Its mesh is checked: closed, oriented, manifold, free of
crossings (libigl), in as many parts as its voxels, with the volume of the quadrature; its vertices
against naive closest points (`naive_closest`, with tiles by their coefficients in NumPy and
SciPy), and the other way, random points of the domain against the winding number of the mesh.
"""

import argparse
import csv
import signal
import sys
import time
import traceback
import warnings
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import igl
import naive_closest as nc
import numpy as np
from scipy.interpolate import NdBSpline
from scipy.ndimage import label

import ilattice as il
from ilattice.bspline import BSpline
from ilattice.bspline.knots import greville, uniform_knots
from ilattice.errors import ConvergenceError, GeometryError, IlatticeError, PrecisionWarning
from ilattice.offsets.struts import struts_of

DATA = Path(__file__).parent / "data"
FILES = (
    "gismo/GshapedVolume.xml", "gismo/cube.xml#0", "gismo/cylinder.xml", "gismo/fichera.xml#0",
    "gismo/fichera.xml#1", "mfem/beam-hex-nurbs.mesh#0", "mfem/cube-nurbs-deformed.mesh",
    "mfem/cube-nurbs.mesh", "mfem/pipe-nurbs.mesh#0", "mfem/two-cubes-nurbs.mesh#0",
)  # fmt: skip
KINDS = ("constant", "varying", "one-sided", "solid", "eroded", "clip")
KINKED = "kinked"
SCALES = (1.0, 1.0, 1e-6, 1e-3, 1e3, 1e6)
#: Triangles that a combination should have at most, about.
MAX_TRIANGLES = 16_000
#: Errors with which a combination may be refused.
REFUSALS = (ConvergenceError, GeometryError)
#: Columns of the table.
COLUMNS = (
    "seed", "tile", "map", "repeat", "boundary", "kind", "d", "h", "scale", "cpu", "all", "faces",
    "parts", "voxel_parts", "voxel_most", "closed", "crossing", "volume", "quadrature", "fallback",
    "held", "off", "p99", "max", "distance", "wrong_side", "warnings", "error", "faults",
)  # fmt: skip
#: Those that are rounded.
NUMBERS = (
    "d", "h", "cpu", "volume", "quadrature", "fallback", "held", "off", "p99", "max", "distance",
)  # fmt: skip


# ---------------------------------------------------------------- tiles in NumPy


def tile_function(lattice):
    """Values, gradients and Hessians of the tile of a lattice, by NumPy and SciPy alone.

    Its second argument is the order, 0 for values alone. Struts are themselves, not their splines
    that compiled code evaluates; `naive_skeleton` is about their fields.
    """
    if struts_of(lattice) is not None:
        return lambda p, order=2: lattice.tile.jet(p - np.floor(p), order)
    field = lattice.smooth_tile
    if isinstance(field, BSpline):
        return _spline_tile(field)
    return _trig_tile(field)


def _spline_tile(spline):
    f = NdBSpline(spline.t, spline.c, spline.k, extrapolate=True)
    e = np.eye(3, dtype=int)

    def jet(p, order=2):
        q = p - np.floor(p)
        if order == 0:
            return (f(q),)
        g = np.stack([f(q, nu=tuple(e[i])) for i in range(3)], axis=1)
        h = np.empty((len(p), 3, 3))
        for i, j in nc.PAIRS:
            h[:, i, j] = h[:, j, i] = f(q, nu=tuple(e[i] + e[j]))
        return f(q), g, h

    return jet


def _trig_tile(field):
    """Terms: a coefficient, and one of 1, sin, cos, sin 2x ... per axis by its number."""
    wave = (field.factor + 1) // 2
    turns = 2 * np.pi / np.asarray(field.period)
    shift = np.where((field.factor > 0) & (field.factor % 2 == 0), -0.5 * np.pi, 0.0)
    w = wave * turns

    def jet(p, order):
        angle = p[:, None, :] * w + shift
        zero = np.cos(angle)
        if order == 0:
            return (zero.prod(axis=2) @ field.coef,)
        one = -np.sin(angle) * w
        two = -zero * w * w
        parts = (zero, one, two)

        def term(nu):
            a = parts[nu[0]][..., 0] * parts[nu[1]][..., 1] * parts[nu[2]][..., 2]
            return a @ field.coef

        e = np.eye(3, dtype=int)
        g = np.stack([term(e[i]) for i in range(3)], axis=1)
        h = np.empty((len(p), 3, 3))
        for i, j in nc.PAIRS:
            h[:, i, j] = h[:, j, i] = term(e[i] + e[j])
        return term(np.zeros(3, int)), g, h

    def in_parts(p, order=2):
        """In pieces, for terms times points need room."""
        pieces = [jet(a, order) for a in np.array_split(p, len(p) // 20_000 + 1)]
        return tuple(np.concatenate(a) for a in zip(*pieces, strict=True))

    return in_parts


# ---------------------------------------------------------------- combinations


@dataclass(frozen=True)
class Combination:
    """One wall to be meshed."""

    seed: int
    tile: str
    map: str
    repeat: tuple
    boundary: str
    kind: str
    d: float
    h: float | None
    scale: float

    def through(self):
        """The map."""
        return _scaled(self.map, self.scale)

    def lattice(self):
        """The lattice."""
        return il.Lattice(
            self.tile, through=self.through(), repeat=self.repeat, boundary=self.boundary
        )

    def thickness(self):
        """What `offset` is asked for."""
        d, (lo, hi) = self.d, self.through().domain

        def varying(u):
            t = (u - lo) / (hi - lo)
            return d * (0.7 + 0.2 * t[:, 0] + 0.2 * t[:, 1] * t[:, 2])

        def kinked(u):
            t = (u - lo) / (hi - lo)
            return d * np.maximum(0.7, np.minimum(1.0, 0.5 + 0.8 * t[:, 0]))

        sides = (0.0, d) if self.seed % 2 else (d, 0.0)
        return {
            "constant": d, "clip": d, "varying": varying, KINKED: kinked, "one-sided": sides,
            "solid": (np.inf, d), "eroded": (np.inf, -d),
        }[self.kind]  # fmt: skip


@cache
def _scaled(name, scale):
    shape = _map(name)
    if scale == 1.0:
        return shape
    s = shape.spline
    return il.macroshape.SplineMap(
        BSpline(s.t, s.c * scale, s.k, periodic=s.periodic, weights=s.weights)
    )


def maps():
    """Names of the maps."""
    return ["box", "flat", "torus", "duck", "wing", "shell", "tapered", "swept", "loft",
            "revolved", "perturbed", *FILES]  # fmt: skip


@cache
def _map(name):
    ms = il.macroshape
    if name in FILES:
        file, _, patch = name.partition("#")
        return ms.load(DATA / file, int(patch) if patch else None)
    makers = {
        "box": lambda: ms.box((0.8, 1.7, 0.65)), "flat": lambda: ms.box((1, 1, 0.15)),
        "torus": ms.torus, "duck": ms.duck, "wing": ms.wing, "tapered": ms.tapered,
        "shell": lambda: ms.cylinder_shell(angle=2.0), "swept": lambda: ms.extrude(_patch(0.2)),
        "loft": lambda: ms.loft([_patch(a, z) for a, z in ((0.2, 0), (0.1, 0.4), (-0.2, 1))]),
        "revolved": lambda: ms.revolve(
            _patch(0.2), axis=(0, 1, 0), angle=1.0, center=(-1, 0, 0)
        ).fix_orientation(),
        "perturbed": _perturbed,
    }  # fmt: skip
    return makers[name]()


def _patch(bend, z=0.0):
    x, y = np.meshgrid(np.linspace(0, 1, 4), np.linspace(0, 1, 3), indexing="ij")
    c = np.stack([x, y, z + bend * np.sin(3 * x) * np.cos(2 * y)], axis=-1)
    return BSpline([uniform_knots(2, 2), uniform_knots(1, 2)], c, 2)


def _perturbed():
    t = [uniform_knots(2, 2)] * 3
    sites = [greville(a, 2) for a in t]
    c = np.stack(np.meshgrid(*sites, indexing="ij"), axis=-1)
    c += 0.015 * np.random.default_rng(5).standard_normal(c.shape)
    return il.macroshape.SplineMap(BSpline(t, c, (2, 2, 2)))


def sizes(through, repeat):
    """Median length of the shortest side of a tile, and the most elongated place."""
    t = np.stack(np.meshgrid(*[np.linspace(0.03, 0.97, 5)] * 3, indexing="ij"), -1).reshape(-1, 3)
    jac = nc.NaiveMap(through.spline, (False,) * 3, repeat).jet(t * np.array(repeat), 1)[1]
    side = np.linalg.norm(jac, axis=1)
    singular = np.linalg.svd(jac, compute_uv=False)
    return float(np.median(singular[:, 2])), side


def combination(seed, *, kinked=True, most=MAX_TRIANGLES):
    """The combination of a seed."""
    rng = np.random.default_rng(seed)
    names = il.tiles.names()
    tile = str(names[rng.integers(len(names))])
    shape = str(rng.choice(maps()))
    kinds = (*KINDS, KINKED) if kinked else KINDS
    kind = str(rng.choice(kinds))
    boundary = "clip" if kind == "clip" else "extend"
    through = _map(shape)
    repeat = _repeat(rng, through)
    size, _ = sizes(through, repeat)
    row = il.tiles.row(tile)
    waves = getattr(row, "area", 4.0)
    d = size * float(rng.uniform(0.02, 0.2)) / max(1.0, waves / 3.0)
    if kind == "eroded":
        d *= 0.4
    total = d if kind in ("one-sided", "solid", "eroded") else 2.0 * d
    total = max(total, 0.03 * size)
    default = rng.random() < 0.25
    h = total * float(rng.uniform(0.2, 0.5))
    cell = abs(float(np.prod(repeat)))
    area = max(waves, 3.0) * cell * _tile_area(through, repeat)
    sides = 1.0 if kind in ("solid", "eroded") else 2.0
    if default:  # thick enough that edges of a quarter of it are not too many
        h, most = 0.25 * total, 2 * most
    shortest = float(np.sqrt(2.3 * sides * area / most))
    if h < shortest:
        h = shortest
        d *= 1.0 if kind == "eroded" else max(1.0, h / ((0.25 if default else 0.55) * total))
    scale = float(rng.choice(SCALES))
    scale = float(rng.choice(SCALES))
    return Combination(
        seed, tile, shape, repeat, boundary, kind, d * scale, None if default else h * scale, scale
    )  # fmt: skip


def _tile_area(through, repeat):
    return float(through.volume() / np.prod(repeat)) ** (2.0 / 3.0)


def _repeat(rng, through):
    """One to four tiles, more where the part is long, so that they are seldom flat."""
    _, side = sizes(through, (1, 1, 1))
    length = np.median(side, axis=0)
    want = length / np.exp(rng.uniform(-0.4, 0.7)) / np.prod(length) ** (1 / 3)
    out = np.maximum(1, np.rint(want * rng.choice([0.8, 1.0, 1.3]))).astype(int)
    while np.prod(out) > 6:
        out[np.argmax(out)] -= 1
    return tuple(int(n) for n in out)


# ---------------------------------------------------------------- the oracle


class Judge:
    """What the oracle says of a mesh of a combination."""

    def __init__(self, combo, lattice, wall, mesh, *, count=100, m=None):
        self.combo, self.lattice, self.wall, self.mesh = combo, lattice, wall, mesh
        waves = int(lattice.finest_wave)
        self.oracle = nc.Oracle(
            tile_function(lattice), lattice, m=m or max(24, 8 * waves), coarse=max(8, 4 * waves)
        )
        self.count = count
        self.rng = np.random.default_rng(combo.seed)

    def tile_coordinates(self, u):
        """Parameters in tiles."""
        lo, hi = self.lattice.through.spline.domain
        return (u - lo) / (hi - lo) * np.array(self.lattice.repeat)

    def asked(self, u):
        """Half-thickness (inner, outer) that was asked for at parameters."""
        out = []
        d = self.combo.thickness()
        for side in d if isinstance(d, tuple) else (d, d):
            out.append(side(u) if callable(side) else np.full(len(u), float(side)))
        return out

    def thickness_errors(self, at):
        """| |distance| - d | at vertices by the oracle, and by how much the kernel is farther."""
        data = self.mesh.point_data
        u = np.stack([data[k] for k in ("u", "v", "w")], axis=1)[at].astype(float)
        inner, outer = self.asked(u)
        side = data["side"][at]
        asked = np.where(side > 0, outer, inner)
        p = self.tile_coordinates(u)
        distance, kernel = self._distances(p, u)
        sign = np.where(self._sign(p) < 0, -1.0, 1.0)
        return np.abs(side * sign * distance - asked), kernel - distance

    def _distances(self, p, u):
        """Distances by the oracle, to checked feet of the kernel where these are nearer, and its.

        The oracle may miss a foot, and so may the kernel; neither invents any.
        """
        distance, _ = self.oracle.distance(p)
        found = self.lattice.closest(u)
        foot = self.tile_coordinates(found.u)
        x, (y, jac) = self.oracle.map.jet(p, 0)[0], self.oracle.map.jet(foot, 1)
        f, g, _ = self.oracle.tile(self._in_domain(foot))
        slope = np.linalg.norm(
            np.linalg.solve(jac.transpose(0, 2, 1), g[:, :, None])[..., 0], axis=1
        )
        on = np.abs(f) <= 1e-5 * self.combo.d * slope
        away = np.linalg.norm(x - y, axis=1)
        return np.where(on & (away < distance), away, distance), np.abs(found.distance)

    def _sign(self, p):
        return self.oracle.tile(self._in_domain(p), 0)[0]

    def _in_domain(self, p):
        """Moved off the upper faces, where a tile that is not periodic would begin again."""
        count = np.array(self.lattice.repeat)
        return np.where(np.abs(p - count) < 1e-12, count - 1e-12, p)

    def vertices(self):
        """Vertices that are measured: random ones, half of them on edges of the domain."""
        data = self.mesh.point_data
        on = np.flatnonzero((data["side"] != 0) & (data["unconverged"] == 0))
        if len(on) == 0:
            return on
        p = self.tile_coordinates(np.stack([data[k] for k in ("u", "v", "w")], axis=1)[on])
        rim = on[(np.minimum(p, np.array(self.lattice.repeat) - p) < 1e-12).any(axis=1)]
        n = self.count
        a = self.rng.choice(on, min(n, len(on)), replace=False)
        b = self.rng.choice(rim, min(n // 3, len(rim)), replace=False)
        return np.unique(np.concatenate([a, b]))

    def _to_faces(self, p):
        """Distances from the faces of the domain, to first order; chords cut these off, too."""
        jac, count = self.oracle.map.jet(p, 1)[1], np.array(self.lattice.repeat)
        with np.errstate(divide="ignore"):
            away = np.minimum(p, count - p) / np.linalg.norm(np.linalg.inv(jac), axis=2)
        return np.where(np.array(self.lattice.through.closed), np.inf, away).min(axis=1)

    def wrong_side(self, chord):
        """Of random points next to the mid-surface, the part that the mesh has on the wrong side.

        Points nearer to the surface of the wall, or to the faces of the domain, than `chord` do not
        count.
        """
        count = np.array(self.lattice.repeat)
        on = nc.tile_samples(self.oracle.tile, 12)
        p = on[self.rng.integers(len(on), size=3 * self.count)]
        p = p + self.rng.integers(count, size=(len(p), 3))
        reach = 1.5 * self.combo.d
        jac = self.oracle.map.jet(p, 1)[1]
        away = self.rng.standard_normal((len(p), 3)) * reach
        p = np.clip(p + np.linalg.solve(jac, away[:, :, None])[:, :, 0] * 0.7, 0.0, count)
        p = p[: self.count]
        x = self.oracle.map.jet(p, 0)[0]
        lo, hi = self.lattice.through.spline.domain
        inner, outer = self.asked(lo + p / count * (hi - lo))
        distance, _ = self.oracle.distance(p)
        s = np.where(self._sign(p) < 0, -distance, distance)
        room = np.minimum(s + inner, outer - s)
        clear = np.abs(room) > chord
        faces = np.ascontiguousarray(self.mesh.faces, dtype=np.int64)
        scale = 1.0 / self.combo.scale
        w = igl.winding_number(np.ascontiguousarray(self.mesh.vertices * scale), faces, x * scale)
        inside = np.abs(w) > 0.5
        clear &= self._to_faces(p) > chord
        wrong = (inside != (room > 0)) & clear
        return float(wrong.sum() / max(clear.sum(), 1)), int(clear.sum())


def solid_parts(mesh):
    """Closed surfaces that hold material: those of voids have a negative volume."""
    a, b, c = (mesh.vertices[mesh.faces[:, i]] - mesh.vertices[0] for i in range(3))
    six = np.einsum("ij,ij->i", a, np.cross(b, c))
    return int((np.bincount(mesh.component_labels, six) > 0.0).sum())


def crossings(mesh):
    """Whether triangles cross, by libigl."""
    v = mesh.vertices * 0.5 ** np.ceil(np.log2(np.ptp(mesh.vertices, axis=0).max()))  # exactly
    import igl.copyleft.cgal as cgal

    out = cgal.remesh_self_intersections(
        v, np.ascontiguousarray(mesh.faces, dtype=np.int64), detect_only=True
    )
    return len(out[2])


#: Part of the median of |tile| at points of a wall within which these are next to its mid-surface.
PINCHED = 0.05


def voxel_parts(wall, side=0, per_tile=40):
    """Parts of a grid of samples of the wall's field: joined across corners too, and by faces only.

    Where the surface meets itself, or a gap is thinner than a voxel, the two differ, and a mesh may
    have any number between them. A wall on one `side` of a mid-surface that meets itself has parts
    that touch there, which the distance spline may join: the second number is that of voxels off
    the mid-surface by the tiles, if it is larger.
    """
    lo, hi = wall.lattice.domain
    count = np.array(wall.lattice.repeat) * per_tile
    t = [(np.arange(count[a]) + 0.5) / count[a] for a in range(3)]
    t = np.stack(np.meshgrid(*t, indexing="ij"), axis=-1).reshape(-1, 3)
    inside, closed = wall.field(lo + t * (hi - lo)) < 0.0, wall.lattice.through.closed
    fewest, most = (_joined(inside.reshape(count), closed, n) for n in (np.ones((3, 3, 3)), None))
    if side:
        f = side * tile_function(wall.lattice)(t * np.array(wall.lattice.repeat), 0)[0]
        off = inside & (f > PINCHED * np.median(np.abs(f[inside])))
        most = max(most, _joined(off.reshape(count), closed, None))
    return fewest, most


def _joined(inside, closed, neighbours):
    """Number of parts of voxels, joined across the seams of closed directions."""
    mark, n = label(inside, neighbours)
    parent = np.arange(n + 1)

    def root(i):
        while parent[i] != i:
            i = parent[i]
        return i

    for a in np.flatnonzero(closed):
        first, last = np.take(mark, 0, a).ravel(), np.take(mark, -1, a).ravel()
        for i, j in zip(first, last, strict=True):
            if i and j:
                parent[root(i)] = root(j)
    return len({root(i) for i in range(1, n + 1)})


# ---------------------------------------------------------------- a run


@dataclass
class Verdict:
    """A row of the table."""

    row: dict

    @property
    def faults(self):
        """What is wrong."""
        return self.row["faults"]


def judge(combo, *, count=100, igl_crossings=True, quadrature=True):
    """Mesh a combination, and say what is wrong with it."""
    row = dict.fromkeys(COLUMNS, "")
    row |= {k: getattr(combo, k) for k in (
        "seed", "tile", "map", "repeat", "boundary", "kind", "d", "h", "scale")}  # fmt: skip
    faults = []
    start = time.process_time()
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        try:
            lattice = combo.lattice()
            wall = lattice.offset(combo.thickness())
            mesh = wall.mesh(combo.h)
        except IlatticeError as e:
            row |= {"error": f"{type(e).__name__}: {str(e)[:160]}"}
            row["cpu"] = round(time.process_time() - start, 2)
            row["faults"] = [] if isinstance(e, REFUSALS) else ["error"]
            return Verdict(row)
    row["cpu"] = round(time.process_time() - start, 2)
    row["fallback"] = lattice.statistics.fallbacks / max(lattice.statistics.queries, 1)
    told = [str(w.message) for w in caught if issubclass(w.category, PrecisionWarning)]
    row["warnings"] = " | ".join(sorted({m[:70] for m in told}))
    faults += [f"warning {w.category.__name__}" for w in caught
               if w.category.__name__ == "RuntimeWarning"]  # fmt: skip
    faults += _sound(row, mesh, igl_crossings)
    if quadrature:
        faults += _volumes(row, combo, wall, mesh)
    spread = any("only neighbours have found" in m for m in told)
    faults += [
        f
        for f in _thickness(row, combo, lattice, wall, mesh, count)
        if not (spread and f.startswith(("off", "distance")))
    ]
    faults += _untold(row, mesh, told)
    row["faults"], row["all"] = faults, round(time.process_time() - start, 2)
    return Verdict(row)


def _sound(row, mesh, igl_crossings):
    """Faults of the mesh as such."""
    out = []
    row["faces"], row["parts"] = len(mesh.faces), solid_parts(mesh)
    row["closed"] = bool(mesh.is_watertight and mesh.is_oriented)
    if not row["closed"] or mesh.nonmanifold_edges or mesh.nonmanifold_vertices:
        out.append("not closed")
    row["crossing"] = crossings(mesh) if igl_crossings else mesh.self_intersections
    if row["crossing"]:
        out.append("crossing")
    if not mesh.volume > 0.0:
        out.append("inside out")
    return out


def _volumes(row, combo, wall, mesh):
    unit = combo.scale**3
    row["volume"], row["quadrature"] = mesh.volume / unit, wall.volume() / unit
    side = (1 if combo.seed % 2 else -1) if combo.kind == "one-sided" else 0
    row["voxel_parts"], row["voxel_most"] = voxel_parts(wall, side)
    lost = row["volume"] / row["quadrature"] - 1.0
    out = []
    if abs(lost) > 0.05 + wall.volume_error / unit / row["quadrature"]:
        out.append(f"volume {lost:+.1%}")
    if row["parts"] > max(4, 2 * row["voxel_parts"], row["voxel_most"]):
        out.append("crumbs")
    return out


def _thickness(row, combo, lattice, wall, mesh, count):
    """Faults of the thickness, both ways."""
    out = []
    size = combo.d
    data = mesh.point_data
    on = data["side"] != 0
    row["held"] = float((data["unconverged"] != 0)[on].mean()) if on.any() else 0.0
    u = np.stack([data[k] for k in ("u", "v", "w")], axis=1)[on].astype(float)
    side = data["side"][on]
    error = wall._errors(u, side)[0] / size
    free = data["unconverged"][on] == 0
    row["off"] = float((error > 1e-3)[free].mean()) if free.any() else 0.0
    judge_ = Judge(combo, lattice, wall, mesh, count=count)
    at = judge_.vertices()
    if len(at) == 0:
        return [] if "fills the part" in row["warnings"] else ["no vertices on the offset"]
    error, farther = judge_.thickness_errors(at)
    row["p99"] = float(np.percentile(error, 99) / size)
    row["max"] = float(error.max() / size)
    row["distance"] = float(farther[np.abs(farther).argmax()] / size)
    chord = 0.25 * size + 0.3 * (combo.h or 0.0)
    row["wrong_side"], clear = judge_.wrong_side(chord)
    if row["off"] > 0.0:
        out.append(f"off {row['off']:.2%}")
    if row["p99"] > 1e-3:
        out.append(f"p99 {row['p99']:.1e}")
    elif row["max"] > 1e-3:
        out.append(f"max {row['max']:.1e}")
    if abs(row["distance"]) > 1e-3:
        out.append(f"distance {row['distance']:.1e}")
    if row["wrong_side"] > 0.01:
        out.append(f"wrong side {row['wrong_side']:.1%} of {clear}")
    return out


def _untold(row, mesh, told):
    """Vertices that are off without a warning that gives their number."""
    held = int((mesh.point_data["unconverged"] != 0).sum())
    if held <= max(1e-3 * len(mesh.vertices), 10):
        return []
    start = f"{held} of {len(mesh.vertices)} vertices could not be moved"
    return [] if any(m.startswith(start) for m in told) else [f"held {row['held']:.2%}, untold"]


class OutOfTimeError(Exception):
    """A combination takes longer than it may."""


@contextmanager
def limited(seconds):
    """Give up after so many seconds of CPU, none for 0."""

    def stop(*_):
        raise OutOfTimeError("out of time")

    before = signal.signal(signal.SIGPROF, stop)
    signal.setitimer(signal.ITIMER_PROF, seconds)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_PROF, 0.0)
        signal.signal(signal.SIGPROF, before)


def main():
    """Run combinations, a row each."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--count", type=int, default=100)
    parser.add_argument("--seeds", type=int, nargs="*")
    parser.add_argument("--table", default="")
    parser.add_argument("--no-kinks", action="store_true")
    parser.add_argument("--trace", action="store_true")
    parser.add_argument("--most", type=int, default=MAX_TRIANGLES, help="triangles, about")
    parser.add_argument("--points", type=int, default=100, help="vertices that are measured")
    parser.add_argument("--quick", action="store_true", help="leave crossings to the package")
    parser.add_argument("--limit", type=float, default=0.0, help="seconds of CPU for one")
    arguments = parser.parse_args()
    seeds = arguments.seeds or range(arguments.first, arguments.first + arguments.count)
    out = open(arguments.table, "a", newline="") if arguments.table else sys.stdout  # noqa: SIM115
    writer = csv.DictWriter(out, COLUMNS)
    if not arguments.table or out.tell() == 0:
        writer.writeheader()
    for seed in seeds:
        combo = combination(seed, kinked=not arguments.no_kinks, most=arguments.most)
        try:
            with limited(arguments.limit):
                row = judge(combo, count=arguments.points, igl_crossings=not arguments.quick).row
        except Exception as e:
            if arguments.trace:
                traceback.print_exc()
            names = ("tile", "map", "repeat", "boundary", "kind", "d", "h", "scale")
            row = dict.fromkeys(COLUMNS, "") | {k: getattr(combo, k) for k in names}
            row |= {"seed": seed, "error": f"{type(e).__name__}: {str(e)[:160]}"}
            row["faults"] = ["untyped"]
        for k in NUMBERS:
            if isinstance(row[k], float):
                row[k] = f"{row[k]:.4g}"
        row["faults"] = "; ".join(row["faults"])
        writer.writerow(row)
        out.flush()


if __name__ == "__main__":
    main()
