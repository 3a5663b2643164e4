"""Rules of whole graphs: roots, names, and how many nodes of a kind there may be.

Guarantee: what breaks one raises an error that names the node. Rules of single nodes are in
`ilattice.graph.nodes` and `ilattice.graph.patches`.
"""

from collections.abc import Callable, Mapping, Sequence
from typing import Any

from ilattice._validate import as_items
from ilattice.errors import GraphError, InputError
from ilattice.graph.nodes import Node
from ilattice.graph.solids import Property, Solid, Voxel

#: Most nodes of a graph.
MAX_NODES = 20_000


def roots_of(given: Any) -> tuple[Node, ...]:
    """What a graph is for.

    Parameters
    ----------
    given : Node, or sequence of Node
        Objects, Booleans, voxel nodes or properties.

    Returns
    -------
    tuple of Node
        At least one.

    Raises
    ------
    GraphError
        If one is another node.
    """
    roots = [given] if isinstance(given, Node) else as_items("roots", given)
    wrong = [r for r in roots if not isinstance(r, (Solid, Voxel, Property))]
    if not roots or wrong:
        told = wrong[0].word if wrong and isinstance(wrong[0], Node) else "graph"
        raise GraphError(
            told, "roots of a graph must be objects, Booleans, voxel nodes or properties"
        )
    return tuple(roots)


def solids_of(roots: Sequence[Any]) -> tuple[Solid, ...]:
    """The solid that each root is, or depends on.

    Parameters
    ----------
    roots : sequence of Node
        See `roots_of`.

    Returns
    -------
    tuple of Solid
        One for each root.
    """
    out = []
    for node in roots:
        if isinstance(node, Property):
            node = node.voxel
        out.append(node.solid if isinstance(node, Voxel) else node)
    return tuple(out)


def names_of(nodes: Sequence[Node], given: Any) -> dict[str, Node]:
    """A name for every node.

    Parameters
    ----------
    nodes : sequence of Node
        All nodes, each after its inputs.
    given : mapping of str to Node
        Names of some; others are named by their types and numbers.

    Returns
    -------
    dict of str to Node
        In the order of the nodes.

    Raises
    ------
    InputError
        If names are no texts, or for nodes that are not among these.
    """
    if not isinstance(given, Mapping):
        raise InputError(f"names must be a mapping of texts to nodes, got {given!r:.80}")
    out = dict(given)
    order = {id(node): i for i, node in enumerate(nodes)}
    if not all(isinstance(k, str) and id(v) in order for k, v in out.items()):
        raise InputError("names must be texts for nodes of the graph")
    known = {id(node) for node in out.values()}
    counts: dict[str, int] = {}
    for node in nodes:
        while id(node) not in known:
            counts[node.code] = counts.get(node.code, 0) + 1
            name = f"{node.code}{counts[node.code]}"
            if name not in out:
                out[name] = node
                known.add(id(node))
    return dict(sorted(out.items(), key=lambda item: order[id(item[1])]))


def check_counts(
    nodes: Sequence[Node], solids: Sequence[Solid], told: Callable[[Node], str]
) -> None:
    """Refuse several voxel nodes, and roots of several solids.

    Parameters
    ----------
    nodes : sequence of Node
        All nodes.
    solids : sequence of Solid
        See `solids_of`.
    told : callable
        Name of a node in messages.

    Raises
    ------
    GraphError
        That names the second of them.
    """
    found = [n for n in nodes if isinstance(n, Voxel)]
    if len(found) > 1:
        raise GraphError(told(found[1]), "at most one voxel node may be in a graph")
    others = [s for s in solids if s is not solids[0]]
    if others:
        raise GraphError(
            told(others[0]), "all roots must be of one solid; join objects by a Boolean"
        )
