"""Pictures of graphs: nodes in layers, and what the stages make.

Non-guarantee: pictures are for eyes; what is behind may be drawn before.
"""

import warnings
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np

from ilattice._typing import FloatArray
from ilattice.errors import IlatticeError, PrecisionWarning
from ilattice.graph.body import Body
from ilattice.graph.nodes import Node
from ilattice.graph.shapes import Shape
from ilattice.graph.skeletons import Line, Skeleton, Surface
from ilattice.graph.solids import Object
from ilattice.mesh import SurfaceMesh

if TYPE_CHECKING:
    from matplotlib.figure import Figure

#: Colours by types of nodes.
COLOURS = {
    "vertex": "#9ecae1", "chain": "#6baed6", "line": "#31a354", "surface": "#31a354",
    "dual": "#74c476", "associate": "#74c476", "mirror": "#fdae6b", "transform": "#fdae6b",
    "group": "#fdd0a2", "object": "#9e9ac8", "boolean": "#9e9ac8", "voxel": "#bcbddc",
    "stiffness": "#fb6a4a", "bandgap": "#fb6a4a",
}  # fmt: skip
#: Nodes above which a graph is not drawn; chosen without measurements.
_MAX_NODES = 400
#: Cells of the grid by which solids are drawn, and most of them where parts are thin.
_GRID, _FINEST = 48, 90


class Made(Protocol):
    """Nodes with their names, and what they make: a `Graph`."""

    @property
    def name(self) -> str:
        """Name of what is made."""

    @property
    def nodes(self) -> tuple[Node, ...]:
        """All nodes, each after its inputs."""

    @property
    def count(self) -> int:
        """Number of nodes."""

    @property
    def names(self) -> Mapping[str, Node]:
        """Nodes by their names."""

    @property
    def body(self) -> Body:
        """The solid."""

    def evaluate(self, node: Any = None) -> Shape | Body:
        """Result of a node."""

    def mesh(self, h: float = 0.02, *, allow_loss: bool = False) -> SurfaceMesh:
        """The solid in one cell."""


def figure(graph: Made, *, stages: bool) -> "Figure":
    """Draw a graph.

    Parameters
    ----------
    graph : Made
        The graph.
    stages : bool
        Whether to draw what stages make.

    Returns
    -------
    matplotlib.figure.Figure
        The picture.
    """
    from matplotlib.figure import Figure

    if not stages:
        fig = Figure(figsize=(6.4, 4.2), layout="constrained")
        draw_nodes(fig.subplots(), graph)
        return fig
    fig = Figure(figsize=(13.0, 4.0), layout="constrained")
    grid = fig.add_gridspec(1, 4, width_ratios=(1.5, 1, 1, 1))
    draw_nodes(fig.add_subplot(grid[0]), graph)
    objects = [n for n in graph.nodes if isinstance(n, Object)]
    first = [n for n in graph.nodes if isinstance(n, (Line, Surface))]
    panels: list[tuple[str, list[Skeleton]]] = [
        ("fundamental skeleton", list(first)),
        ("skeleton in the cell", [n.skeleton for n in objects]),
    ]
    for i, (title, nodes) in enumerate(panels):
        axes = space(fig.add_subplot(grid[1 + i], projection="3d"), title)
        for node in nodes:
            draw_shape(axes, graph.evaluate(node).distinct)  # type: ignore[union-attr]
    axes = space(fig.add_subplot(grid[3], projection="3d"), "solid")
    draw_solid(axes, graph)
    return fig


def draw_nodes(axes: Any, graph: Made) -> None:
    """Nodes in layers from left to right, with their edges.

    Parameters
    ----------
    axes : matplotlib.axes.Axes
        Where to draw.
    graph : Made
        The graph.
    """
    axes.set_axis_off()
    axes.set_title(f"{graph.name}: {graph.count} nodes", fontsize="medium")
    if graph.count > _MAX_NODES:
        axes.text(0.5, 0.5, f"{graph.count} nodes", ha="center")
        return
    at = _layers(graph.nodes)
    for node in graph.nodes:
        x, y = at[id(node)]
        for other in node.inputs:
            a, b = at[id(other)]
            axes.plot([a, x], [b, y], "-", color="0.6", lw=0.8, zorder=1)
    names = {id(node): name for name, node in graph.names.items()}
    for node in graph.nodes:
        x, y = at[id(node)]
        axes.plot(x, y, "o", ms=13, color=COLOURS[node.word], mec="0.3", mew=0.5, zorder=2)
        name = names[id(node)][:8]
        below = len(name) > 4  # wider than its circle
        axes.annotate(
            name, (x, y), (0, -8 if below else 0), textcoords="offset points", ha="center",
            va="top" if below else "center", fontsize=5, zorder=3,
        )  # fmt: skip
    axes.margins(0.08)


def _layers(nodes: tuple[Node, ...]) -> dict[int, tuple[float, float]]:
    """Places: a node is right of its inputs, at about the mean of their heights."""
    depth: dict[int, int] = {}
    for node in nodes:
        depth[id(node)] = 1 + max((depth[id(n)] for n in node.inputs), default=-1)
    height: dict[int, float] = {}
    at: dict[int, tuple[float, float]] = {}
    for layer in range(max(depth.values()) + 1):
        row = [n for n in nodes if depth[id(n)] == layer]
        for i, node in enumerate(row):
            means = [height[id(n)] for n in node.inputs]
            height[id(node)] = float(np.mean(means)) if means else float(i)
        row.sort(key=lambda n: height[id(n)])
        spread = np.arange(len(row)) - 0.5 * (len(row) - 1)
        for y, node in zip(spread, row, strict=True):
            height[id(node)] = float(y)
            at[id(node)] = (float(layer), -float(y))
    return at


def space(axes: Any, title: str) -> Any:
    """The unit cube, to draw in.

    Parameters
    ----------
    axes : mpl_toolkits.mplot3d.Axes3D
        Where to draw.
    title : str
        Its title.

    Returns
    -------
    mpl_toolkits.mplot3d.Axes3D
        The same.
    """
    axes.set_title(title, fontsize="medium")
    axes.set(xlim=(0, 1), ylim=(0, 1), zlim=(0, 1), xticks=[0, 1], yticks=[0, 1], zticks=[0, 1])
    axes.tick_params(labelsize=6)
    axes.set_box_aspect((1, 1, 1))
    axes.view_init(22, -55)
    return axes


def draw_shape(axes: Any, shape: Shape) -> None:
    """A skeleton in a picture of space.

    Parameters
    ----------
    axes : mpl_toolkits.mplot3d.Axes3D
        Where to draw.
    shape : Shape
        The skeleton.
    """
    for strut in shape.struts[:4000]:
        axes.plot(*strut[:, :3].T, "-", color="#31a354", lw=1.2)
    for bend in shape.bends[:1000]:
        ends = bend.spline.domain.ravel()
        axes.plot(*bend.spline(np.linspace(ends[0], ends[-1], 65)).T, "-", color="#31a354", lw=1.2)
    if len(shape.balls):
        axes.scatter(*shape.balls[:, :3].T, s=18, color="#31a354")
    for sheet in shape.sheets:
        draw_triangles(axes, sheet.vertices[sheet.faces], "#74c476")


def draw_solid(axes: Any, graph: Made) -> None:
    """The solid in one cell, by coarse triangles.

    Parameters
    ----------
    axes : mpl_toolkits.mplot3d.Axes3D
        Where to draw.
    graph : Made
        The graph.
    """
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", PrecisionWarning)  # it is the shape that is drawn
            thin = 1.4 * graph.body.field.thinnest  # of the radius
            mesh = graph.mesh(min(1.0 / _GRID, max(thin, 1.0 / _FINEST)), allow_loss=True)
    except IlatticeError as e:  # nothing that this grid sees
        axes.text(0.1, 0.5, 0.5, f"no picture:\n{str(e)[:60]}", fontsize=6)
        return
    draw_triangles(axes, mesh.vertices[mesh.faces], "#9e9ac8")


def draw_triangles(axes: Any, corners: FloatArray, colour: str) -> None:
    """Shaded triangles.

    Parameters
    ----------
    axes : mpl_toolkits.mplot3d.Axes3D
        Where to draw.
    corners : (F, 3, 3) array
        Triangles.
    colour : str
        Their colour.
    """
    from matplotlib.colors import to_rgb
    from mpl_toolkits.mplot3d.art3d import Poly3DCollection

    if not len(corners):
        return
    n = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    n /= np.maximum(np.linalg.norm(n, axis=1, keepdims=True), 1e-300)
    light = 0.45 + 0.55 * np.abs(n @ (np.array([0.4, -0.6, 0.7]) / np.sqrt(1.01)))
    shades = np.clip(light[:, None] * np.array(to_rgb(colour)), 0.0, 1.0)
    # Smoothed borders would let what is behind shine through between neighbours.
    axes.add_collection3d(
        Poly3DCollection(corners, facecolors=shades, edgecolors="none", antialiaseds=False)
    )
