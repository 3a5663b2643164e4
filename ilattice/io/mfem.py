"""MFEM NURBS meshes, versions 1.0 and 1.1, of one to three parameters.

Guarantees: both forms are read, the patches form with its three kinds of control points, and the
form with shared knot vectors, weights and nodes, also of several patches (`_mfem_topology`). What
is written is the patches form with Cartesian control points and is read back bit by bit, but for
knots: MFEM wants end knots of full multiplicity.
Not guaranteed: attributes and boundaries are not interpreted; formulas for the spacing of later
refinements are passed over; NC-patch meshes, active elements (``mesh_elements``) and periodic
identifications are refused.

Format: https://mfem.org/mesh-format-v1.0 and ``NURBSExtension`` of MFEM.
"""

import os
import re

import numpy as np

from ilattice._files import atomic_write, read_text
from ilattice._typing import FloatArray
from ilattice.bspline import BSpline
from ilattice.errors import FormatError, InputError
from ilattice.io._mfem_topology import CORNERS, FACES, GEOMETRY, Topology, read_topology
from ilattice.io._patches import (
    MAX_DEGREE,
    Patch,
    clamped,
    join_names,
    numbered,
    split_names,
    to_rows,
    to_spline,
    to_text,
)
from ilattice.io._scanner import Scanner, blank_comments

Knots = tuple[int, FloatArray]
#: How often a control point of a mesh is used, on average, at most; 8 in a grid of bricks.
MAX_SHARED = 16
_HEADER = re.compile(r"MFEM NURBS mesh v1\.([01])\s*")
_NAMES = re.compile(r"^# ilattice names: (.*)$", re.MULTILINE)


# --- reading ----------------------------------------------------------------------------------


def read(path: str | os.PathLike[str]) -> tuple[list[Patch], list[str]]:
    """All patches of an MFEM NURBS mesh, in its order.

    Parameters
    ----------
    path : path-like
        The file.

    Returns
    -------
    list of Patch
        Volumes, or surfaces, or curves.
    list of str
        Empty: an MFEM mesh holds nothing else.

    Raises
    ------
    FormatError
        If the file is no such mesh, is malformed, or uses a feature that is not supported.
    """
    text = read_text(path)
    first, _, rest = text.partition("\n")
    header = _HEADER.fullmatch(first)
    if not header:
        raise FormatError(
            f"{path}, line 1: found {first.strip()!r:.60}; expected 'MFEM NURBS mesh v1.0'"
        )
    scanner = Scanner(blank_comments("\n" + rest), path)
    topology = read_topology(scanner)
    start = scanner.at
    if scanner.expect("patches", "knotvectors") == "patches":
        splines = [_patch(scanner) for _ in topology.elements]
    else:
        scanner.at = start
        splines = _shared(scanner, topology, spacing=header[1] == "1")
    if scanner.left:
        scanner.fail(f"found {scanner.peek()!r:.60}; expected the end of the file")
    found = _NAMES.search(text)
    names = split_names(scanner.fail, found[1], splines[0].m) if found else ()
    return numbered([Patch(s, names=names) for s in splines]), []


def _knot_vector(scanner: Scanner) -> Knots:
    k = scanner.integer("degree", 1, MAX_DEGREE)
    n = scanner.integer("number of control points", k + 1)
    return k, scanner.numbers(n + k + 1, "knots")


def _patch(scanner: Scanner) -> BSpline:
    """One patch of the patches form."""
    start = scanner.at
    scanner.expect("knotvectors")
    ndim = scanner.integer("number of knot vectors", 1, 3)
    vectors = [_knot_vector(scanner) for _ in range(ndim)]
    scanner.expect("dimension")
    dim = scanner.integer("number of coordinates", 1)
    form = scanner.expect("controlpoints", "controlpoints_homogeneous", "controlpoints_cartesian")
    count = 1
    for k, t in vectors:
        count *= len(t) - k - 1
    numbers = scanner.numbers(count * (dim + 1), f"numbers, {count} control points x .. w")
    rows = numbers.reshape(count, dim + 1)
    points, weights = rows[:, :dim], rows[:, dim]
    if form != "controlpoints_cartesian":
        if not (weights > 0).all():
            scanner.fail(f"weights must be positive, the least is {weights.min():g}", start)
        with np.errstate(over="ignore"):
            points = points / weights[:, None]
    return _spline(scanner, start, vectors, points, weights)


def _spline(
    scanner: Scanner, at: int, vectors: list[Knots], points: FloatArray, weights: FloatArray
) -> BSpline:
    """Spline that is rational only if its weights differ."""
    polynomial = bool((weights == weights[0]).all() and weights[0] > 0)
    return to_spline(
        lambda m: scanner.fail(m, at),
        [t for _, t in vectors],
        points,
        [k for k, _ in vectors],
        weights=None if polynomial else weights,
    )


def _shared(scanner: Scanner, topology: Topology, *, spacing: bool) -> list[BSpline]:
    """Patches of the form with shared knot vectors, weights and nodes."""
    start = scanner.at
    scanner.expect("knotvectors")
    count = scanner.integer("number of knot vectors", 1)
    vectors = [_knot_vector(scanner) for _ in range(count)]
    if spacing:
        _skip_spacing(scanner, topology.ndim, count)
    sizes = [len(t) - k - 1 for k, t in vectors]
    total, patches = topology.number(sizes, 8 * scanner.left, lambda m: scanner.fail(m, start))
    weights = np.ones(total) if scanner.peek() == "unitweights" else None
    section = scanner.word("'weights' or 'unitweights'")
    if section == "weights":
        weights = scanner.numbers(total, "weights, one per control point")
    if weights is None:
        scanner.fail(
            f"section {section!r:.40} is not supported; expected 'weights'", scanner.at - 1
        )
    if sum(p.dofs.size for p in patches) > MAX_SHARED * total:
        scanner.fail(f"patches share their points more than {MAX_SHARED} times", start)
    nodes = _nodes(scanner, total, [k for k, _ in vectors])
    splines = []
    for patch in patches:
        own = []
        for number, flipped in patch.vectors:
            k, t = vectors[number]
            own.append((k, (t[0] + t[-1]) - t[::-1] if flipped else t))
        dofs = patch.dofs.T.ravel()
        splines.append(_spline(scanner, start, own, nodes[dofs], weights[dofs]))
    return splines


def _skip_spacing(scanner: Scanner, ndim: int, count: int) -> None:
    """Pass over what version 1.1 says about later refinements."""
    section = scanner.expect("refinements", "knotvector_refinements", "spacing")
    if section == "refinements":
        for _ in range(ndim):
            scanner.integer("refinement factor", -(10**9))
        section = scanner.expect("knotvector_refinements", "spacing")
    if section == "knotvector_refinements":
        for _ in range(count):
            scanner.numbers(scanner.integer("number of factors"), "refinement factors")
        scanner.expect("spacing")
    for _ in range(scanner.integer("number of spacing formulas")):
        scanner.integer("knot vector", 0, count - 1)
        scanner.integer("kind of spacing")
        whole = scanner.integer("number of whole parameters")
        scanner.numbers(whole + scanner.integer("number of real parameters"), "parameters")


def _nodes(scanner: Scanner, total: int, degrees: list[int]) -> FloatArray:
    """Control points, shape (total, dim), of the finite element space at the end of the file."""
    scanner.expect("FiniteElementSpace")
    scanner.expect("FiniteElementCollection:")
    name = scanner.word("NURBS and a degree")
    match = re.fullmatch(r"NURBS([0-9]{0,3})", name)
    if not match or (match[1] and set(degrees) != {int(match[1])}):
        found = ", ".join(map(str, sorted(set(degrees))))
        scanner.fail(f"found {name!r:.40}; expected NURBS of degree {found}", scanner.at - 1)
    scanner.expect("VDim:")
    dim = scanner.integer("number of coordinates", 1)
    scanner.expect("Ordering:")
    by_nodes = scanner.integer("ordering", 0, 1) == 0
    values = scanner.numbers(total * dim, f"coordinates, {dim} of {total} control points")
    return values.reshape(dim, total).T if by_nodes else values.reshape(total, dim)


# --- writing ----------------------------------------------------------------------------------


def write(spline: BSpline, path: str | os.PathLike[str], names: tuple[str, ...] = ()) -> None:
    """Write one spline as a mesh of one patch.

    Parameters
    ----------
    spline : BSpline
        Curve, surface or volume with degrees of at least 1; a scalar one gets one coordinate.
        It is written clamped, and not as periodic.
    path : path-like
        The file.
    names : tuple of str
        Names of the coordinates after x, y, z, kept in a comment.

    Raises
    ------
    InputError, FormatError
        If a degree is 0, or the file cannot be written.
    """
    if min(spline.k) < 1:
        raise InputError(f"spline has degrees {spline.k}; MFEM needs at least 1, so elevate it")
    spline = clamped(spline)
    rows, weights = to_rows(spline)
    weights = np.ones(len(rows)) if weights is None else weights
    note = f"# ilattice names: {join_names(names)}\n\n" if names else ""
    with atomic_write(path, text=True) as file:
        file.write(f"MFEM NURBS mesh v1.0\n\n{note}{_topology_text(spline.ndim)}\npatches\n\n")
        file.write(f"knotvectors\n{spline.ndim}\n")
        for t, k, n in zip(spline.t, spline.k, spline.shape, strict=True):
            file.write(to_text(t[None], f"{k} {n} ", "\n"))
        file.write(f"\ndimension\n{rows.shape[1]}\n\ncontrolpoints_cartesian\n")
        file.write(to_text(np.column_stack([rows, weights])) + "\n")


def _topology_text(ndim: int) -> str:
    """Topology sections of a single patch."""
    corners = CORNERS[: 2**ndim]
    ends = range(len(corners))
    sides = FACES if ndim == 3 else [(0, 1), (1, 2), (2, 3), (3, 0)] if ndim == 2 else [(0,), (1,)]
    edges = [
        f"{axis} {i} {j}"
        for axis in range(ndim)
        for i in ends
        for j in ends
        if np.subtract(corners[j], corners[i]).tolist() == [int(a == axis) for a in range(3)]
    ]
    boundary = [
        f"{i + 1} {GEOMETRY[ndim - 1]} {' '.join(map(str, s))}" for i, s in enumerate(sides)
    ]
    return (
        f"dimension\n{ndim}\n\n"
        f"elements\n1\n1 {GEOMETRY[ndim]} {' '.join(map(str, ends))}\n\n"
        + "\n".join([f"boundary\n{len(boundary)}", *boundary, "", f"edges\n{len(edges)}", *edges])
        + f"\n\nvertices\n{len(corners)}\n"
    )
