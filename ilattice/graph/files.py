"""Graphs as JSON: a schema with a version, read strictly.

::

    {
        "schema": "ilattice.graph",
        "version": 1,
        "name": "bcc",
        "within": {"kind": "cuboid", "size": [0.5, 0.5, 0.5]},
        "nodes": [
            {"id": "v1", "type": "vertex", "position": [0, 0, 0]},
            {"id": "v2", "type": "vertex", "position": [0.5, 0.5, 0.5]},
            {"id": "e1", "type": "chain", "inputs": ["v1", "v2"]},
            {"id": "l1", "type": "line", "inputs": ["e1"], "thickness": 0.1},
            {"id": "obj1", "type": "object", "inputs": ["l1"]},
        ],
        "roots": ["obj1"],
    }

Nodes may come in any order. Properties that have a default may be left out.

Guarantees: what is written and read again has the same digest. Whatever a file holds, reading it
ends in a graph or a `GraphError` that names node and rule, in time proportional to its size;
nothing unknown is passed over.
"""

import json
import os
from dataclasses import MISSING, fields
from typing import Any

from ilattice._files import read_bytes
from ilattice.errors import GraphError, InputError, printable
from ilattice.graph.evaluate import ordered
from ilattice.graph.graph import Graph
from ilattice.graph.nodes import Node
from ilattice.graph.rules import MAX_NODES
from ilattice.graph.solids import TYPES
from ilattice.graph.volumes import region_from
from ilattice.graph.writing import SCHEMA, VERSION, check_ending

_KEYS = ("schema", "version", "name", "about", "within", "nodes", "roots")
#: Letters of an identifier.
_LONGEST = 200


def load(path: str | os.PathLike[str]) -> Graph:
    """Read a graph.

    Parameters
    ----------
    path : path-like
        File of `Graph.save`.

    Returns
    -------
    Graph
        The graph.

    Raises
    ------
    GraphError
        If the file is no such graph: which node, which rule.
    FormatError
        If the file is missing, or cannot be read.
    """
    check_ending(path)
    try:
        text = read_bytes(path).decode("utf-8-sig")
    except UnicodeDecodeError as e:
        raise GraphError("graph", f"the file is no text in UTF-8: {e.reason}") from e
    return parse(text)


def parse(text: str) -> Graph:
    """Read a graph from a text.

    Parameters
    ----------
    text : str
        JSON.

    Returns
    -------
    Graph
        The graph.

    Raises
    ------
    GraphError
        If it is no such graph.
    """
    try:
        data = json.loads(text, parse_constant=_refuse, object_pairs_hook=_once)
    except GraphError:
        raise
    except (ValueError, RecursionError, TypeError) as e:
        raise GraphError("graph", f"the text is no JSON: {printable(str(e))}") from e
    return graph_of(data)


def graph_of(data: Any) -> Graph:
    """The graph of plain data.

    Parameters
    ----------
    data : object
        What JSON holds.

    Returns
    -------
    Graph
        The graph.

    Raises
    ------
    GraphError
        If it is no graph: which node, which rule.
    """
    if not isinstance(data, dict):
        raise GraphError("graph", f"a file must hold an object, got {data!r:.60}")
    unknown = [key for key in data if key not in _KEYS]
    if unknown:
        raise GraphError("graph", f"{unknown[0]!r:.60} is unknown; there are {', '.join(_KEYS)}")
    if data.get("schema") != SCHEMA or type(data.get("version")) is not int:
        raise GraphError("graph", f"schema must be {SCHEMA!r} with a version, got {data!r:.80}")
    if data["version"] != VERSION:
        raise GraphError(
            "graph", f"version must be {VERSION}, got {data['version']!r:.40}: take a newer library"
        )
    rows = _rows(data)
    made: dict[str, Node] = {}
    for name in _sorted(rows):
        made[name] = _node(name, rows[name], made)
    roots = data.get("roots")
    if not isinstance(roots, list) or not roots or not all(_is_name(r, made) for r in roots):
        raise GraphError("graph", f"roots must be ids of nodes, got {roots!r:.80}")
    used = {id(node) for node in ordered(made[r] for r in roots)}
    loose = [name for name, node in made.items() if id(node) not in used]
    if loose:
        told = f"{made[loose[0]].word} {loose[0]!r}"
        raise GraphError(told, "every node must lead to a root")
    try:
        within = None if data.get("within") is None else region_from(data["within"])
        name, about = data.get("name", "graph"), data.get("about", {})
        return Graph([made[r] for r in roots], within, name, about=about, names=made)
    except GraphError:
        raise
    except InputError as e:
        raise GraphError("graph", str(e)) from e


def _is_name(value: Any, known: Any) -> bool:
    return isinstance(value, str) and value in known


def _rows(data: dict[str, Any]) -> dict[str, dict[str, Any]]:
    """Rows of nodes by their ids."""
    nodes = data.get("nodes")
    if not isinstance(nodes, list) or not nodes:
        raise GraphError("graph", f"nodes must be a list of objects, got {nodes!r:.60}")
    if len(nodes) > MAX_NODES:
        name = nodes[MAX_NODES].get("id") if isinstance(nodes[MAX_NODES], dict) else None
        raise GraphError(
            f"node {name!r:.60}", f"a graph must have at most {MAX_NODES} nodes, got {len(nodes)}"
        )
    rows: dict[str, dict[str, Any]] = {}
    for i, row in enumerate(nodes):
        name = row.get("id") if isinstance(row, dict) else None
        if not isinstance(name, str) or not 0 < len(name) <= _LONGEST:
            raise GraphError(f"node {i}", f"id must be a text, got {row!r:.60}")
        if name in rows:
            raise GraphError(f"node {name!r}", "id must be there once")
        if not isinstance(row.get("type"), str) or row["type"] not in TYPES:
            raise GraphError(
                f"node {name!r}",
                f"type must be one of {', '.join(TYPES)}, got {row.get('type')!r:.60}",
            )
        inputs = row.get("inputs", [])
        if not isinstance(inputs, list) or not all(isinstance(v, str) for v in inputs):
            raise GraphError(f"{row['type']} {name!r}", "inputs must be ids of nodes")
        rows[name] = row
    for name, row in rows.items():
        for other in row.get("inputs", []):
            if other not in rows:
                raise GraphError(f"{row['type']} {name!r}", f"inputs: there is no {other!r:.60}")
    return rows


def _sorted(rows: dict[str, dict[str, Any]]) -> list[str]:
    """Names, each after its inputs, or the cycle that forbids it."""
    waiting = {name: len(set(row.get("inputs", []))) for name, row in rows.items()}
    users: dict[str, list[str]] = {name: [] for name in rows}
    for name, row in rows.items():
        for other in set(row.get("inputs", [])):
            users[other].append(name)
    ready = [name for name, count in waiting.items() if not count]
    out: list[str] = []
    while ready:
        name = ready.pop()
        out.append(name)
        for user in users[name]:
            waiting[user] -= 1
            if not waiting[user]:
                ready.append(user)
    if len(out) < len(rows):
        name = next(n for n, count in waiting.items() if count)
        raise GraphError(
            f"{rows[name]['type']} {name!r}",
            "a graph must have no cycles, but this node is on, or behind, one",
        )
    return out


def _node(name: str, row: dict[str, Any], made: dict[str, Node]) -> Node:
    """The node of a row whose inputs are made."""
    kind = TYPES[row["type"]]
    told = f"{kind.word} {name!r}"
    given = {k: v for k, v in row.items() if k not in ("id", "type", "inputs")}
    known = {f.name: f for f in fields(kind) if f.name not in kind.takes}
    for key in given:
        if key not in known:
            raise GraphError(
                told, f"{key!r:.60} is no property; there are {', '.join(known) or 'none'}"
            )
    for key, field in known.items():
        if key not in given and field.default is MISSING:
            raise GraphError(told, f"{key} must be given")
    inputs = [made[other] for other in row.get("inputs", [])]
    try:
        if given.get("within") is not None:
            given["within"] = region_from(given["within"])
        return kind(**_taken(kind, inputs), **given)
    except GraphError as e:
        raise GraphError(told, e.rule or str(e)) from e
    except InputError as e:
        raise GraphError(told, str(e)) from e


def _taken(kind: type[Node], inputs: list[Node]) -> dict[str, Any]:
    """Inputs as the fields of a type: one field takes all, or each takes one."""
    several = kind.word in ("chain", "line", "surface", "group", "boolean")
    if several:
        return {kind.takes[0]: inputs}
    if len(inputs) != len(kind.takes):
        raise InputError(f"inputs must be {len(kind.takes)}, got {len(inputs)}")
    return dict(zip(kind.takes, inputs, strict=True))


def _refuse(word: str) -> Any:
    raise GraphError("graph", f"numbers must be finite, got {word}")


def _once(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    """An object of JSON, in which no key comes twice."""
    out = dict(pairs)
    if len(out) < len(pairs):
        raise GraphError("graph", f"keys must be there once, got {[k for k, _ in pairs]!r:.100}")
    return out
