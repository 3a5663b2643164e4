"""Naive `ilattice.mesh.contouring`: dictionaries and graph searches, no tables.

It works on a dense array of signs (True inside), padded or wrapped here, and gives the quads as
cyclic lists of patches; a patch is (cell, frozenset of crossed edges). An edge is (axis, sample).
"""

import itertools

import numpy as np

from ilattice.mesh._grid import INSET, MARGIN


def padded(inside, wrap):
    """Signs with a ghost layer of outside samples in the directions that do not wrap."""
    for axis in range(3):
        if wrap[axis]:
            inside = np.take(inside, range(inside.shape[axis] - 1), axis=axis)
        else:
            pad = [(0, 0)] * 3
            pad[axis] = (1, 1)
            inside = np.pad(inside, pad)
    return inside


class Naive:
    """Patches and quads of the padded grid of signs."""

    def __init__(self, inside, wrap=(False,) * 3):
        self.wrap = wrap
        self.inside = padded(np.asarray(inside, bool), wrap)
        self.n = self.inside.shape
        counts = [n if w else n - 1 for n, w in zip(self.n, wrap, strict=True)]
        self.cells = list(itertools.product(*(range(c) for c in counts)))
        self.flipped = set()
        patches = self._all_patches()
        self.flipped = self._doubled(patches)
        self.patches = self._all_patches() if self.flipped else patches
        assert not self._doubled(self.patches)

    def at(self, p):
        return tuple(c % n for c, n in zip(p, self.n, strict=True))

    def sign(self, p):
        return bool(self.inside[self.at(p)])

    def face_segments(self, axis, p):
        """Pairs of crossed edges on the face normal to `axis` with lowest sample p."""
        b, c = (d for d in range(3) if d != axis)
        eb, ec = np.eye(3, dtype=int)[b], np.eye(3, dtype=int)[c]
        p = np.array(p)
        corners = [p, p + eb, p + eb + ec, p + ec]
        edges = [(b, self.at(p)), (c, self.at(p + eb)), (b, self.at(p + ec)), (c, self.at(p))]
        signs = [self.sign(q) for q in corners]
        crossed = [edges[i] for i in range(4) if signs[i] != signs[(i + 1) % 4]]
        if len(crossed) == 4:
            cut = (axis, self.at(p)) not in self.flipped
            return [(edges[i - 1], edges[i]) for i in range(4) if signs[i] == cut]
        return [tuple(crossed)] if crossed else []

    def cell_faces(self, cell):
        for axis in range(3):
            for side in (0, 1):
                p = list(cell)
                p[axis] += side
                yield axis, self.at(p)

    def cell_patches(self, cell):
        links = {}
        for axis, p in self.cell_faces(cell):
            for a, b in self.face_segments(axis, p):
                links.setdefault(a, []).append(b)
                links.setdefault(b, []).append(a)
        out = []
        while links:
            todo, seen = [next(iter(links))], set()
            while todo:
                e = todo.pop()
                if e not in seen:
                    seen.add(e)
                    todo += links[e]
            for e in seen:
                del links[e]
            out.append(frozenset(seen))
        return out

    def _all_patches(self):
        return {c: p for c in self.cells if (p := self.cell_patches(c))}

    def _doubled(self, patches):
        """Faces that are crossed twice by one patch in both of their cells."""
        seen = {}
        for cell, parts in patches.items():
            for face in self.cell_faces(cell):
                s = self.face_segments(*face)
                if len(s) == 2 and any(s[0][0] in q and s[1][0] in q for q in parts):
                    seen[face] = seen.get(face, 0) + 1
        return {face for face, n in seen.items() if n == 2}

    def quads(self):
        """Four patches around each crossed edge, counter-clockwise seen from outside."""
        out = []
        for axis in range(3):
            b, c = (axis + 1) % 3, (axis + 2) % 3
            for p in np.argwhere(np.ones(self.n, bool)):
                q = p.copy()
                q[axis] += 1
                if not self.wrap[axis] and q[axis] >= self.n[axis]:
                    continue
                if self.sign(p) == self.sign(q):
                    continue
                around = []
                for db, dc in ((-1, -1), (0, -1), (0, 0), (-1, 0)):
                    cell = p.copy()
                    cell[b] += db
                    cell[c] += dc
                    cell = self.at(cell)
                    edge = (axis, tuple(int(v) for v in p))
                    (patch,) = (s for s in self.patches[cell] if edge in s)
                    around.append((cell, patch))
                out.append(around if self.sign(p) else around[::-1])
        return out

    def position(self, cell, patch, values, level, axes):
        """Mean of the linear crossings of a patch; on the faces of D for ghost cells."""
        low, high = np.empty(3), np.empty(3)
        for a in range(3):
            planes = list(axes[a])
            index = cell[a] - (0 if self.wrap[a] else 1)
            if not self.wrap[a]:
                planes[0] += INSET * (axes[a][1] - axes[a][0])
                planes[-1] -= INSET * (axes[a][-1] - axes[a][-2])
            if index < 0:
                low[a] = high[a] = axes[a][0]
            elif index == len(planes) - 1:
                low[a] = high[a] = axes[a][-1]
            else:
                low[a], high[a] = planes[index], planes[index + 1]
        points = []
        for axis, p in patch:
            index = [p[a] - (0 if self.wrap[a] else 1) for a in range(3)]
            onto = list(index)
            onto[axis] += 1
            real = all(self.wrap[a] or (index[a] >= 0 and onto[a] < len(axes[a])) for a in range(3))
            if not real:
                continue
            f0, f1 = values[tuple(index)], values[tuple(onto)]
            t = (level - f0) / (f1 - f0)
            x = np.where([p[a] == cell[a] for a in range(3)], low, high)
            x[axis] = low[axis] + t * (high[axis] - low[axis])
            points.append(x)
        x = np.mean(points, axis=0) if points else 0.5 * (low + high)
        rim = MARGIN * (high - low)
        return np.clip(x, low + rim, high - rim)

    def euler(self):
        """Euler number of the surface, from the connected pieces of the inside (all contractible).

        Twice that of the solid: pieces per cell - per face + per edge - per sample.
        """
        total = 0
        for cell in self.cells:
            total += self._pieces(cell)
        faces = {f for c in self.cells for f in self.cell_faces(c)}
        for axis, p in faces:
            total -= self._face_pieces(axis, p)
        for axis in range(3):
            step = np.eye(3, dtype=int)[axis]
            for p in np.argwhere(np.ones(self.n, bool)):
                q = p + step
                if self.wrap[axis] or q[axis] < self.n[axis]:
                    total += self.sign(p) + self.sign(q) - (self.sign(p) and self.sign(q))
        return 2 * (total - int(self.inside.sum()))

    def _pieces(self, cell):
        corners = [c for c in itertools.product((0, 1), repeat=3) if self.sign(np.add(cell, c))]
        group = {c: c for c in corners}

        def join(a, b):
            if a in group and b in group:
                old, new = group[a], group[b]
                for k, v in group.items():
                    if v == old:
                        group[k] = new

        for a in corners:
            for b in corners:
                if sum(abs(x - y) for x, y in zip(a, b, strict=True)) == 1:
                    join(a, b)
        for axis, p in self.cell_faces(cell):
            if (axis, p) in self.flipped:
                side = 0 if p == self.at(cell) else 1
                ring = [c for c in corners if c[axis] == side]
                join(ring[0], ring[1])
        return len(set(group.values()))

    def _face_pieces(self, axis, p):
        b, c = (np.eye(3, dtype=int)[d] for d in range(3) if d != axis)
        s = [self.sign(q) for q in (p, p + b, p + b + c, p + c)]
        changes = sum(s[i] != s[i - 1] for i in range(4))
        if changes == 4:
            return 1 if (axis, p) in self.flipped else 2
        return 1 if any(s) else 0
