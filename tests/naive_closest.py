"""Naive closest-point search: dense samples, then Newton from all that may be nearest.

Pure NumPy and SciPy: tiles typed with sines and cosines, maps by `scipy.interpolate.NdBSpline`,
samples where grid edges cross the surface. Every value the oracle returns is the distance of a
point of the surface in the domain, or of a foot on its continuation (found by convergence to a
stationary point), so it can be too large but never too small.
"""

from dataclasses import dataclass, field
from functools import cache, cached_property
from pathlib import Path

import numpy as np
from scipy.interpolate import NdBSpline
from scipy.spatial import cKDTree

import ilattice as il

TAU = 2 * np.pi
#: Largest side of a tile, cubed, over its volume, above which it counts as squeezed.
SQUEEZED = 10.0
DIAGONALS = np.array([[1, 1, 1, 1], [1, 1, -1, -1], [1, -1, 1, -1]])
PAIRS = ((0, 0), (1, 1), (2, 2), (1, 2), (0, 2), (0, 1))


def _cyclic(coefficient, a, b, c):
    return [(coefficient, (a, b, c)), (coefficient, (c, a, b)), (coefficient, (b, c, a))]


#: Terms as (coefficient, one function per axis); "c2" is cos(2 X), "" is 1.
TERMS = {
    "primitive": _cyclic(1.0, "c1", "", ""),
    "gyroid": _cyclic(1.0, "c1", "s1", ""),
    "iwp": _cyclic(2.0, "c1", "c1", "") + _cyclic(-1.0, "c2", "", ""),
}


def _wave(code, x):
    """Value, first and second derivative of one factor."""
    if not code:
        return np.ones_like(x), np.zeros_like(x), np.zeros_like(x)
    w = TAU * int(code[1])
    s, c = np.sin(w * x), np.cos(w * x)
    return (c, -w * s, -w * w * c) if code[0] == "c" else (s, w * c, -w * w * s)


def tile_jet(name, p, order=2):
    """Value (n,), gradient (n, 3), Hessian (n, 3, 3) of a tile at tile coordinates.

    The tile is a key of `TERMS`, or a function that returns them, only values for order 0.
    """
    if callable(name):
        return name(p, order)
    f, g, h = np.zeros(len(p)), np.zeros((len(p), 3)), np.zeros((len(p), 3, 3))
    for a, codes in TERMS[name]:
        w = [_wave(code, p[:, i]) for i, code in enumerate(codes)]
        f += a * w[0][0] * w[1][0] * w[2][0]
        for i in range(3):
            nu = [int(i == j) for j in range(3)]
            g[:, i] += a * w[0][nu[0]] * w[1][nu[1]] * w[2][nu[2]]
        for i, j in PAIRS:
            nu = [int(i == k) + int(j == k) for k in range(3)]
            v = a * w[0][nu[0]] * w[1][nu[1]] * w[2][nu[2]]
            h[:, i, j] += v
            if i != j:
                h[:, j, i] += v
    return f, g, h


@dataclass(frozen=True)
class NaiveMap:
    """A spline volume by scipy, in tile coordinates, continued beyond its open ends."""

    spline: object
    closed: tuple
    repeat: tuple

    @cached_property
    def _parts(self):
        s = self.spline
        if s.weights is None:
            return NdBSpline(s.t, s.c[..., :3], s.k, extrapolate=True)
        c = np.concatenate([s.c[..., :3] * s.weights[..., None], s.weights[..., None]], axis=-1)
        return NdBSpline(s.t, c, s.k, extrapolate=True)

    def _derivative(self, u, nu):
        if any(n > k for n, k in zip(nu, self.spline.k, strict=True)):
            return np.zeros((len(u), self._parts.c.shape[-1]))
        return self._parts(u, nu=nu)

    def jet(self, p, order=2):
        """Points (n, 3), Jacobian (n, 3, 3), Hessian (n, 3, 3, 3), in tile coordinates."""
        lo, hi = self.spline.domain
        step = (hi - lo) / np.array(self.repeat)
        u = lo + p * step
        for i in range(3):
            if self.closed[i]:
                u[:, i] = lo[i] + np.mod(u[:, i] - lo[i], hi[i] - lo[i])
        e = np.eye(3, dtype=int)
        a = self._derivative(u, (0, 0, 0))
        out = [a]
        if order > 0:
            out.append(
                np.stack([self._derivative(u, tuple(e[i])) * step[i] for i in range(3)], axis=-1)
            )
        if order > 1:
            second = np.empty((*a.shape, 3, 3))
            for i, j in PAIRS:
                second[..., i, j] = self._derivative(u, tuple(e[i] + e[j])) * step[i] * step[j]
                second[..., j, i] = second[..., i, j]
            out.append(second)
        return out if self.spline.weights is None else _quotient(out)


def volume(jac):
    """Determinants of Jacobians (n, 3, 3)."""
    a, b, c = jac.transpose(2, 1, 0)
    return (
        a[0] * (b[1] * c[2] - b[2] * c[1])
        + a[1] * (b[2] * c[0] - b[0] * c[2])
        + a[2] * (b[0] * c[1] - b[1] * c[0])
    )


def _quotient(homogeneous):
    """Derivatives of x = a / w from those of (a, w)."""
    a, w = homogeneous[0][:, :3], homogeneous[0][:, 3]
    out = [a / w[:, None]]
    if len(homogeneous) > 1:
        da, dw = homogeneous[1][:, :3], homogeneous[1][:, 3]
        out.append((da - out[0][:, :, None] * dw[:, None, :]) / w[:, None, None])
    if len(homogeneous) > 2:
        dda, ddw = homogeneous[2][:, :3], homogeneous[2][:, 3]
        mixed = out[1][:, :, :, None] * dw[:, None, None, :]
        whole = dda - mixed - mixed.transpose(0, 1, 3, 2)
        whole -= out[0][:, :, None, None] * ddw[:, None]
        out.append(whole / w[:, None, None, None])
    return out


def tile_samples(name, m):
    """Nodes and crossings of edges of an m³ grid of the closed unit cell on the surface, (n, 3)."""
    axis = np.linspace(0.0, 1.0, m + 1)
    grid = np.stack(np.meshgrid(axis, axis, axis, indexing="ij"), axis=-1)
    f = tile_jet(name, grid.reshape(-1, 3), 0)[0].reshape(grid.shape[:3])
    out = [grid[np.abs(f) < 1e-13]]
    f = np.where(np.abs(f) < 1e-13, 1e-13, f)
    for a in range(3):
        e = np.eye(3)[a]
        here, there = np.take(f, range(m), a), np.take(f, range(1, m + 1), a)
        low = np.take(grid, range(m), a)[here * there < 0]
        left = here[here * there < 0]
        lo, hi = np.zeros(len(low)), np.full(len(low), 1.0 / m)
        for _ in range(52):
            middle = 0.5 * (lo + hi)
            same = tile_jet(name, low + middle[:, None] * e, 0)[0] * left > 0
            lo, hi = np.where(same, middle, lo), np.where(same, hi, middle)
        ends = [tile_jet(name, low + side[:, None] * e, 0)[0] for side in (lo, hi)]
        jumps = np.minimum(*np.abs(ends)) > 1e-6 * np.abs(f).max()  # no zero between
        out.append((low + (0.5 * (lo + hi))[:, None] * e)[~jumps])
    return np.concatenate(out)


@dataclass(frozen=True)
class Oracle:
    """Closest points on the image of a periodic tile.

    Parameters
    ----------
    tile : str or callable
        Key of `TERMS`, or a function of tile coordinates to values, gradients and Hessians.
    lattice : Lattice
        Its map, repeat and boundary rule are read, nothing is called but attributes.
    m : int
        Samples per tile and direction.
    """

    tile: str
    lattice: object
    m: int = 32
    coarse: int = 8
    _kept: dict = field(default_factory=dict)

    @cached_property
    def map(self):
        through = self.lattice.through
        return NaiveMap(through.spline, through.closed, self.lattice.repeat)

    @cached_property
    def clip(self):
        return self.lattice.boundary == "clip"

    @cached_property
    def box(self):
        """Admissible tile coordinates of feet: one ghost tile beyond the open ends."""
        closed, count = np.array(self.lattice.through.closed), np.array(self.lattice.repeat)
        margin = 0 if self.clip else 1
        return np.array(
            [np.where(closed, -np.inf, -margin), np.where(closed, np.inf, count + margin)]
        )

    @cached_property
    def tiles(self):
        """Indices of all tiles, (t, 3)."""
        closed, count = self.lattice.through.closed, self.lattice.repeat
        margin = [0 if c or self.clip else 1 for c in closed]
        axes = [np.arange(-a, n + a) for a, n in zip(margin, count, strict=True)]
        return np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)

    def samples(self, tiles, m):
        """Samples of tiles: coordinates, points, diagonals of cells, tiles, whether squeezed."""
        if m not in self._kept:
            self._kept[m] = tile_samples(self.tile, m)
        p = (self.tiles[tiles][:, None] + self._kept[m][None]).reshape(-1, 3)
        number = np.repeat(tiles, len(self._kept[m]))
        x, jac = self.map.jet(p, 1)
        keep = self._admissible(p, jac)
        side = np.linalg.norm(jac, axis=1)
        size = np.linalg.norm(jac @ DIAGONALS, axis=1).max(axis=1) / m
        squeezed = side.max(axis=1) ** 3 > SQUEEZED * np.abs(volume(jac))
        return p[keep], x[keep], size[keep], number[keep], squeezed[keep]

    @cached_property
    def domain(self):
        """Tile coordinates of the domain; infinite where it is closed."""
        closed, count = np.array(self.lattice.through.closed), np.array(self.lattice.repeat)
        return np.array([np.where(closed, -np.inf, 0), np.where(closed, np.inf, count)])

    def _beyond(self, p, slack=0.0):
        """On the continuation."""
        return ((p < self.domain[0] - slack) | (p > self.domain[1] + slack)).any(axis=1)

    def _admissible(self, p, jac):
        """Inside the box, and not squeezed to a fifth or folded where the map is continued.

        That is looked at in quarters of the way from the domain.
        """
        beyond = self._beyond(p)
        inside = ((p >= self.box[0] - 1e-9) & (p <= self.box[1] + 1e-9)).all(axis=1)
        at = np.flatnonzero(inside & beyond)
        left = np.clip(p[at], *self.domain)
        size = self._turned(self.map.jet(left, 1)[1])
        least = np.minimum.reduce(
            [self._turned(self.map.jet(left + s * (p[at] - left), 1)[1]) for s in (0.25, 0.5, 0.75)]
            + [self._turned(jac[at])]
        )
        inside[at] = (size > 0) & (least >= size / 5)
        return inside

    def _back(self, x, p, y):
        """On the continuation, and nearer to a point of the domain than a quarter of its way."""
        out = self._beyond(p)
        at = np.flatnonzero(out)
        way = np.linalg.norm(y[at] - self.map.jet(np.clip(p[at], *self.domain), 0)[0], axis=1)
        out[at] = np.linalg.norm(y[at] - x[at], axis=1) < 0.25 * way
        return out

    def _turned(self, jac):
        """det J, positive in the domain."""
        return volume(jac) * self.lattice.through.orientation

    def _reached(self, p, q):
        """A foot on the continuation counts for queries within two tiles of it."""
        count, closed = np.array(self.lattice.repeat), np.array(self.lattice.through.closed)
        away = p - q
        away = np.where(closed, away - count * np.round(away / count), away)
        return ~(self._beyond(p) & (np.abs(away) > 2).any(axis=1))

    @cached_property
    def _coarse(self):
        p, x, size, number = self.samples(np.arange(len(self.tiles)), self.coarse)[:4]
        return p, x, size, number, cKDTree(x)

    def distance(self, q):
        """Unsigned distances of the images of tile coordinates q, and feet in tile coordinates."""
        x = self.map.jet(q, 0)[0]
        best = np.full(len(q), np.inf)
        foot = np.full((len(q), 3), np.nan)
        slab = np.floor(q[:, 0] / 3).astype(int)  # layers that are sampled together
        for s in np.unique(slab):
            at = np.flatnonzero(slab == s)
            best[at], foot[at] = self._block(x[at], q[at])
        return best, foot

    def _block(self, x, q):
        found = self.samples(self._tiles_near(x, q), self.m)
        away = np.maximum(np.maximum(q.min(axis=0) - found[0], found[0] - q.max(axis=0)), 0.0)
        closed = np.array(self.lattice.through.closed)
        keep = ~self._beyond(found[0]) | (closed | (away <= 2)).all(axis=1)
        p, y, size, _, squeezed = (a[keep] for a in found)
        best, foot = np.full(len(q), np.inf), np.full((len(q), 3), np.nan)
        on = (np.abs(p - self.domain[:, None]) < 1e-12).any(axis=0)
        groups = [(np.ones(len(p), bool), ())]  # surface, curves on faces, points on edges
        groups += [(on[:, a], (a,)) for a in range(3)]
        groups += [(on[:, a] & on[:, b], (a, b)) for a, b in ((0, 1), (0, 2), (1, 2))]
        for mask, fixed in groups:
            if not mask.any():
                continue
            row, start = self._starts(p[mask], y[mask], size[mask], squeezed[mask], x, q)
            end, dist = self._feet(x[row], q[row], start, fixed)
            order = np.lexsort((dist, row))
            first = np.unique(row[order], return_index=True)
            pick = order[first[1]]
            better = dist[pick] < best[first[0]]
            best[first[0][better]] = dist[pick][better]
            foot[first[0][better]] = end[pick][better]
        return best, foot

    def _tiles_near(self, x, q):
        """Tiles that may hold the nearest point, by the coarse samples."""
        p, _, size, number, tree = self._coarse
        sample, near = self._nearest(tree, p, x, q)
        near += size[sample]
        reach = near + np.percentile(size, 99)
        return np.unique(number[np.unique(np.concatenate(tree.query_ball_point(x, reach)))]).astype(
            int
        )

    def _starts(self, p, y, size, squeezed, x, q):
        """Rows of queries and starts: one sample per cell among those that may be nearest.

        A sample within its covering radius r of a foot at distance d is within sqrt(d² + 4 r²)
        of the query if no principal curvature exceeds 3 / d, and within d + r in any case; that
        counts where the map squeezes tiles, and the surface may have edges.
        """
        tree = cKDTree(y)
        near = self._nearest(tree, p, x, q)[1]
        near = np.where(near < np.inf, near, -size.max())  # no sample counts
        next_to = tree.query(x, k=range(1, min(8, len(p)) + 1))[1]
        pinched = squeezed[next_to].any(axis=1)
        cell = np.floor(p * self.m / 2).astype(int) @ [1, 1 << 20, 1 << 40]  # a number each
        rows, starts = [], []
        for i, found in enumerate(tree.query_ball_point(x, near + size.max())):
            found = np.array(found, dtype=int)
            away = np.linalg.norm(y[found] - x[i], axis=1)
            wide = squeezed[found] | pinched[i]
            r = size[found]
            may = away <= np.where(wide, near[i] + r, np.sqrt(near[i] ** 2 + 4 * r**2))
            found = found[may][np.argsort(away[may])]
            found = found[np.sort(np.unique(cell[found], return_index=True)[1])]
            rows.append(np.full(len(found), i))
            starts.append(p[found])
        return np.concatenate(rows), np.concatenate(starts)

    def _nearest(self, tree, p, x, q, k=100):
        """Numbers of the nearest samples that count for the queries, and how far they are away."""
        number, away = np.zeros(len(x), int), np.full(len(x), np.inf)
        todo = np.arange(len(x))
        way = np.linalg.norm(tree.data - self.map.jet(np.clip(p, *self.domain), 0)[0], axis=1)
        way[~self._beyond(p)] = 0.0
        while len(todo):
            k = min(k, len(p))
            dist, index = (np.reshape(a, (-1, k)) for a in tree.query(x[todo], k=k))
            usable = self._reached(p[index.ravel()], np.repeat(q[todo], k, axis=0)).reshape(-1, k)
            usable &= dist >= 0.25 * way[index]
            found, pick = usable.any(axis=1), np.argmax(usable, axis=1)
            number[todo[found]] = index[found, pick[found]]
            away[todo[found]] = dist[found, pick[found]]
            todo = todo[~found] if k < len(p) else todo[:0]
            k *= 8
        return number, away

    def _feet(self, x, q, start, fixed):
        """Where starts end, and how far that is; the start itself if it is nearer and counts."""
        end, left = start, np.zeros(len(start))
        if len(fixed) < 2:
            end, left = self._descend(x, start, fixed)
        end, dist = self._measure(x, q, end, fixed)
        dist[self._beyond(end, 1e-9) & ((left > 1e-6) | (len(fixed) > 0))] = np.inf
        raw = np.linalg.norm(self.map.jet(start, 0)[0] - x, axis=1)
        use = ~self._beyond(start) & (raw < dist)
        return np.where(use[:, None], start, end), np.where(use, raw, dist)

    def _descend(self, x, p, fixed, steps=100):
        """Newton's method on the surface, or on its curve on a face, from every start.

        Those that go a tile beyond the box are given up. Returns the ends, and the lengths of the
        last steps in tiles.
        """
        p = p.copy()
        last = np.zeros(len(p))
        todo = np.arange(len(p))
        free = [a for a in range(3) if a not in fixed]
        for _ in range(steps):
            step, size, cell = newton_step(self.map, self.tile, x[todo], p[todo], free)
            cap = np.minimum(1.0, cell / self.m / np.maximum(size, 1e-300))
            p[todo] += cap[:, None] * step
            last[todo] = size / cell
            lost = ((p[todo] < self.box[0] - 1) | (p[todo] > self.box[1] + 1)).any(axis=1)
            todo = todo[(size > 1e-12 * cell) & ~lost]
            if len(todo) == 0:
                break
        return p, last

    def _measure(self, x, q, p, fixed):
        """Points moved onto the surface, and their distances; infinite where they do not count."""
        free = np.ones(3)
        free[list(fixed)] = 0.0
        for _ in range(4):
            f, g, _ = tile_jet(self.tile, p)
            g = g * free
            p = p - (f / np.maximum((g * g).sum(axis=1), 1e-300))[:, None] * g
        y, jac = self.map.jet(p, 1)
        bad = ~self._admissible(p, jac) | ~self._reached(p, q) | self._back(x, p, y)
        bad |= np.abs(tile_jet(self.tile, p)[0]) > 1e-12
        return p, np.where(bad, np.inf, np.linalg.norm(y - x, axis=1))


def newton_step(space, tile, x, p, free):
    """Step of Newton's method for 1/2 |T(p) - x|² on {I = 0} in the free directions.

    Returns
    -------
    tuple
        Step (n, 3), its length in space (n,), size of a tile in space (n,).
    """
    y, jac, hess = space.jet(p)
    f, g, bend = tile_jet(tile, p)
    r = y - x
    jr = np.einsum("nck,nc->nk", jac, r)
    metric = np.einsum("nci,ncj->nij", jac, jac)
    curved = np.einsum("nc,ncij->nij", r, hess)
    metric = metric + 1e-10 * np.trace(metric, axis1=1, axis2=2)[:, None, None] * np.eye(3)
    gf, mf = g[:, free], metric[:, free][:, :, free]
    a = np.linalg.solve(mf, gf[:, :, None])[:, :, 0]
    lam = -(a * jr[:, free]).sum(axis=1) / np.maximum((a * gf).sum(axis=1), 1e-300)
    h = (metric + curved + lam[:, None, None] * bend)[:, free][:, :, free]
    z = np.linalg.svd(gf[:, None, :])[2][:, 1:].transpose(0, 2, 1)  # null space of g
    zh, zm = (np.einsum("nia,nij,njb->nab", z, b, z) for b in (h, mf))
    chol = np.linalg.inv(np.linalg.cholesky(zm))
    low = np.linalg.eigvalsh(chol @ zh @ chol.transpose(0, 2, 1))[:, 0]
    zh = zh + np.where(low < 0.02, 0.1 - low, 0.0)[:, None, None] * zm
    zh = zh + 1e-10 * np.trace(zm, axis1=1, axis2=2)[:, None, None] * np.eye(zm.shape[1])
    normal = -(f / np.maximum((gf * gf).sum(axis=1), 1e-300))[:, None] * gf
    right = -(jr[:, free] + np.einsum("nij,nj->ni", h, normal))
    right = np.einsum("nia,ni->na", z, right)
    sound = np.isfinite(zh).all(axis=(1, 2)) & (np.linalg.det(zh) != 0.0)
    zh[~sound] = np.eye(zh.shape[1])  # at critical points of the tile: no step
    y = np.linalg.solve(zh, np.where(sound[:, None], right, 0.0)[:, :, None])
    step = np.zeros_like(p)
    step[:, free] = normal + (z @ y)[:, :, 0]
    size = np.linalg.norm(np.einsum("nck,nk->nc", jac, step), axis=1)
    return step, size, np.linalg.norm(jac, axis=1).max(axis=1)


def queries(oracle, n, seed=0):
    """Tile coordinates of n queries, half of them where it is hard.

    Random points; critical points of the tile, symmetry planes; points on the surface and next to
    it; corners of tiles; faces, edges and corners of the domain; places of small det J.
    """
    rng = np.random.default_rng(seed)
    count = np.array(oracle.lattice.repeat, dtype=float)
    p = rng.random((n, 3)) * count
    part = np.array_split(np.arange(n // 2, n), 7)
    p[part[0]] = _critical(oracle.tile, p[part[0]])
    p[part[1]] = np.round(p[part[1]] * 8) / 8
    on = tile_samples(oracle.tile, 8)
    p[part[2]] = np.floor(p[part[2]]) + on[rng.integers(len(on), size=len(part[2]))]
    p[part[3]] = np.floor(p[part[3]]) + on[rng.integers(len(on), size=len(part[3]))]
    p[part[3]] += rng.standard_normal((len(part[3]), 3)) * 10.0 ** rng.uniform(
        -9, -2, (len(part[3]), 1)
    )
    p[part[4]] = np.round(p[part[4]]) + 1e-3 * rng.standard_normal((len(part[4]), 3))
    held = rng.random((len(part[5]), 3)) < 0.5
    p[part[5]] = np.where(held, np.round(p[part[5]] / count) * count, p[part[5]])
    many = rng.random((20 * len(part[6]) + 20, 3)) * count
    det = np.abs(volume(oracle.map.jet(many, 1)[1]))
    p[part[6]] = many[np.argsort(det)[: len(part[6])]]
    return np.clip(p, 0.0, count)


def _critical(tile, p):
    """Points moved towards critical points of the tile, by damped Newton steps on its gradient."""
    p = p.copy()
    for _ in range(8):
        _, g, h = tile_jet(tile, p)
        step = -np.linalg.solve(h + 1e-9 * np.eye(3), g[:, :, None])[:, :, 0]
        size = np.linalg.norm(step, axis=1, keepdims=True)
        p += step * np.minimum(1.0, 0.1 / np.maximum(size, 1e-300))
    return p


def parameters(lattice, q):
    """Parameters of tile coordinates, in the domain."""
    lo, hi = lattice.domain
    return np.clip(lo + q / np.array(lattice.repeat) * (hi - lo), lo, hi)


def _letter():
    return il.macroshape.load(Path(__file__).parent / "data" / "gismo" / "GshapedVolume.xml")


#: Maps, and tiles in them, for comparisons: closed, from degree 1 to 3, with det J near 0.
MAPS = {
    "torus": (il.macroshape.torus, (16, 2, 2)),
    "duck": (il.macroshape.duck, (18, 5, 4)),
    "G": (_letter, (16, 1, 7)),
}


@cache
def lattice_of(shape, tile, boundary):
    """One of the lattices of MAPS."""
    make, repeat = MAPS[shape]
    return il.Lattice(tile, through=make(), repeat=repeat, boundary=boundary)
