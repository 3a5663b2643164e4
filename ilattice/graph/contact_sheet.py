"""Contact sheets: solids of many graphs in one picture.

Non-guarantee: pictures are for eyes; solids are drawn by coarse triangles.
"""

from collections.abc import Iterable
from typing import TYPE_CHECKING, Any

from ilattice._validate import as_whole
from ilattice.errors import InputError
from ilattice.graph.graph import Graph
from ilattice.graph.plot import draw_solid, space

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def contact_sheet(graphs: Any, columns: int = 5) -> "Figure":
    """Solids of many graphs side by side.

    Parameters
    ----------
    graphs : sequence of Graph
        The graphs.
    columns : int
        Pictures in a row.

    Returns
    -------
    matplotlib.figure.Figure
        The picture.
    """
    from matplotlib.figure import Figure

    many = list(graphs) if isinstance(graphs, Iterable) else []
    if not many or not all(isinstance(graph, Graph) for graph in many):
        raise InputError(f"graphs must be one or more graphs, got {graphs!r:.80}")
    columns = as_whole("columns", columns, 1, 100)
    rows = -(-len(many) // columns)
    fig = Figure(figsize=(2.4 * columns, 2.5 * rows), layout="constrained")
    for i, graph in enumerate(many):
        axes = space(fig.add_subplot(rows, columns, i + 1, projection="3d"), graph.name)
        axes.set_axis_off()
        draw_solid(axes, graph)
    return fig
