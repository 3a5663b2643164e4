"""Topology of walls, their necks, and when it changes with the thickness.

Guarantees: Betti numbers are those of the closed surface that contouring gives. Critical
thicknesses are those of the exact distance. Contours of walls take exact distances at kinks, so
that pores close when they should.
Non-guarantee: parts and gaps thinner than the mesh are not seen, or in pieces: pores that are about
to close need an `h` smaller than they are wide. `TopologySweep.unexplained` names intervals in
which events and contours disagree.
"""

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from ilattice._progress import Progress, track
from ilattice._shown import Shown
from ilattice._typing import ArrayLike, FloatArray, IntArray
from ilattice._validate import as_array, as_positive
from ilattice.errors import InputError
from ilattice.mesh.regions import TopologyReport, topology_of
from ilattice.mesh.wall_mesh import wall_contour
from ilattice.offsets.mid_surface import MidSurface
from ilattice.offsets.offsetting import offset_solid
from ilattice.offsets.wall import OffsetSolid
from ilattice.topology.critical import critical_points
from ilattice.topology.critical_point import CriticalPoint

if TYPE_CHECKING:
    from matplotlib.figure import Figure

#: How the kinds of changes are drawn.
COLOURS = {"part": "black", "bridge": "royalblue", "neck": "darkorange", "void": "seagreen"}


@dataclass(frozen=True)
class TopologySweep(Shown):
    """How the topology of a wall depends on its half-thickness.

    Attributes
    ----------
    d : ndarray, shape (n,)
        Half-thicknesses, increasing.
    reports : tuple of TopologyReport
        Of the contours at these.
    events : tuple of CriticalPoint
        All changes between the first and the last: `value` is the critical half-thickness. Where
        walls meet along whole curves or surfaces, one event stands for each; its `change` is right
        if that ends at faces of the domain only, or is a ring.
    unexplained : tuple of (float, float)
        Intervals between half-thicknesses whose contours differ by more or less in Euler number
        than the events in between say. Contours with longer edges than a pore is wide lose it.
    """

    d: FloatArray
    reports: tuple[TopologyReport, ...]
    events: tuple[CriticalPoint, ...]
    unexplained: tuple[tuple[float, float], ...]

    @property
    def thicknesses(self) -> FloatArray:
        """The different critical half-thicknesses, increasing."""
        values = np.array([e.value for e in self.events])
        new = np.diff(values, prepend=-np.inf) > 1e-7 * np.abs(values)
        out: FloatArray = values[new]
        return out

    def euler(self, d: ArrayLike) -> IntArray:
        """Euler numbers of walls: that of the first contour, and the changes up to there.

        Parameters
        ----------
        d : array_like, shape (n,)
            Half-thicknesses, in the range of those of the sweep.

        Returns
        -------
        ndarray of int, shape (n,)
            Parts less handles plus voids, however narrow these are.

        Raises
        ------
        InputError
            For half-thicknesses out of range.
        """
        values = np.atleast_1d(as_array("d", d))
        if not ((values >= self.d[0]) & (values <= self.d[-1])).all():
            raise InputError(
                f"d must be between {self.d[0]:g} and {self.d[-1]:g}, got {d!r:.80}; sweep further"
            )
        changes = np.cumsum([0, *(e.change for e in self.events)])
        at = np.searchsorted([e.value for e in self.events], values, side="right")
        return np.asarray(self.reports[0].euler + changes[at])

    def plot(self) -> "Figure":
        """Euler number over the half-thickness, and where parts, bridges, necks and voids change.

        Returns
        -------
        Figure
            Of matplotlib; ``savefig`` writes it.
        """
        from matplotlib.figure import Figure
        from matplotlib.ticker import MaxNLocator

        figure = Figure(figsize=(7, 4.5), layout="constrained")
        axes = figure.add_subplot()
        d = np.unique([self.d[0], *(e.value for e in self.events), self.d[-1]])
        axes.step(d, self.euler(d), where="post", color="0.3", label="Euler number")
        axes.plot(self.d, [r.euler for r in self.reports], "kx", label="of the contours")
        for kind, colour in COLOURS.items():
            values = np.array([e.value for e in self.events if e.kind == kind])
            if len(values):
                label = f"{len(values)} {kind}{'s' * (len(values) > 1)}"
                axes.plot(values, self.euler(values), "o", color=colour, ms=4, label=label)
        axes.set(xlabel="half-thickness", ylabel="parts - handles + voids")
        axes.yaxis.set_major_locator(MaxNLocator(integer=True))
        axes.grid(alpha=0.3)
        axes.legend()
        return figure


def wall_topology(
    wall: OffsetSolid, h: float | None, necks: float | None, progress: Progress
) -> TopologyReport:
    """Topology of a wall; see `ilattice.lattice.Wall.topology`."""
    report = topology_of(wall_contour(wall, h, progress=progress))
    reach = 0.1 * wall.least_thickness if necks is None else necks
    if not wall._has_necks or wall.lattice.ends.any() or reach <= 0.0:
        return report
    t = wall.thickness
    found = critical_points(wall.lattice, -reach, reach, inner=t.inner, outer=t.outer)
    return TopologyReport(report.parts, report.voids, report.genus, tuple(found))


def topology_sweep(
    lattice: MidSurface, d_values: ArrayLike, *, h: float | None = None, progress: Progress = None
) -> TopologySweep:
    """Changes of topology with the thickness; see `Lattice.topology_sweep`."""
    d = np.array(np.atleast_1d(as_array("d_values", d_values)))
    if d.ndim != 1 or len(d) < 2 or not d[0] > 0 or (np.diff(d) <= 0).any():
        raise InputError(f"d_values must be two or more increasing half-thicknesses, got {d!r:.80}")
    h = None if h is None else as_positive("h", h)
    reports = [
        topology_of(wall_contour(offset_solid(lattice, value), h, progress=None))
        for value in track(d.tolist(), "topology", progress)
    ]
    events = tuple(critical_points(lattice, float(d[0]), float(d[-1]), progress=progress))
    unexplained = []
    for i in range(len(d) - 1):
        change = sum(e.change for e in events if d[i] < e.value <= d[i + 1])
        if reports[i + 1].euler - reports[i].euler != change:
            unexplained.append((float(d[i]), float(d[i + 1])))
    return TopologySweep(d, tuple(reports), events, tuple(unexplained))
