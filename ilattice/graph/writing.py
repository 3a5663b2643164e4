"""Graphs as plain data, and as files of JSON; see `ilattice.graph.files`, which reads them.

Guarantee: data name all nodes, each after its inputs.
"""

import os
from collections.abc import Mapping
from typing import Any, Protocol

from ilattice._files import as_path, write_report
from ilattice.errors import FormatError
from ilattice.graph.nodes import Node
from ilattice.graph.volumes import region_data
from ilattice.minimal import Region

#: What files are told from others by, and the version of what they hold.
SCHEMA, VERSION = "ilattice.graph", 1


class NamedNodes(Protocol):
    """Nodes with their names and bounding volume: a `Graph`."""

    @property
    def name(self) -> str:
        """Name of what is made."""

    @property
    def about(self) -> Mapping[str, str]:
        """Words on it."""

    @property
    def within(self) -> Region | None:
        """Bounding volume."""

    @property
    def nodes(self) -> tuple[Node, ...]:
        """All nodes, each after its inputs."""

    @property
    def roots(self) -> tuple[Node, ...]:
        """What is wanted."""

    @property
    def names(self) -> Mapping[str, Node]:
        """Nodes by their names."""


def save(graph: NamedNodes, path: str | os.PathLike[str]) -> None:
    """Write a graph.

    Parameters
    ----------
    graph : NamedNodes
        The graph.
    path : path-like
        Ends in ``.json``.
    """
    check_ending(path)
    write_report(path, data_of(graph))


def data_of(graph: NamedNodes) -> dict[str, Any]:
    """A graph as plain data.

    Parameters
    ----------
    graph : NamedNodes
        The graph.

    Returns
    -------
    dict
        What JSON holds.
    """
    names = {id(node): name for name, node in graph.names.items()}
    nodes = []
    for node in graph.nodes:
        row: dict[str, Any] = {"id": names[id(node)], "type": node.word}
        if node.inputs:
            row["inputs"] = [names[id(n)] for n in node.inputs]
        nodes.append(row | node.properties)
    out: dict[str, Any] = {"schema": SCHEMA, "version": VERSION, "name": graph.name}
    if graph.about:
        out["about"] = dict(graph.about)
    if graph.within is not None:
        out["within"] = region_data(graph.within)
    return out | {"nodes": nodes, "roots": [names[id(n)] for n in graph.roots]}


def check_ending(path: str | os.PathLike[str]) -> None:
    """Refuse a path of another format.

    Parameters
    ----------
    path : path-like
        Of a graph.

    Raises
    ------
    FormatError
        If it does not end in ``.json``.
    """
    if as_path("path", path).suffix.lower() != ".json":
        raise FormatError(f"a graph is a .json file, got {str(path)!r:.200}")
