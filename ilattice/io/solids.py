"""Elements of solids: CalculiX and Abaqus decks (.inp), and cells for ParaView (.vtu).

Guarantees of decks: coordinates are written with twelve decimals in at most twenty characters,
which is what CalculiX reads; lines are shorter than its limit; only keywords that both programs
know. Numbers count from 1, in the order of the arrays. Not written: contact, steps in time,
anisotropy.
"""

import math
import os
from collections.abc import Iterator, Mapping, Sequence
from typing import IO, Any, Protocol

import numpy as np

from ilattice._files import atomic_write
from ilattice._typing import AnyArray, FloatArray, IntArray
from ilattice._validate import as_items, as_positive, as_real, as_triple
from ilattice.errors import FormatError, GeometryError, InputError
from ilattice.io._mesh import TEXT_BLOCK, blocks
from ilattice.io.vtk import write_vtu

#: Numbers per line.
_PER_LINE = 10
#: Numbers below are read as they are; CalculiX cuts longer exponents off.
_MAX_NUMBER = 1e99
#: VTK's numbers of elements, whose nodes have the same order.
_VTK = {"C3D4": 10, "C3D8": 12, "C3D10": 24}


class SolidArrays(Protocol):
    """Elements of a solid with named regions, as writers take them."""

    @property
    def points(self) -> AnyArray:
        """Nodes, shape (n, 3)."""

    @property
    def cells(self) -> AnyArray:
        """Nodes of the elements in the order of CalculiX, shape (e, 4), (e, 8) or (e, 10)."""

    @property
    def kind(self) -> str:
        """Name of the elements, such as ``"C3D10"``."""

    @property
    def regions(self) -> Mapping[str, AnyArray]:
        """Whether nodes are in a region, by its name."""

    @property
    def error(self) -> float:
        """Relative error of the volume."""

    def elements(self, name: str) -> IntArray:
        """Numbers of the elements of a region."""

    def sides(self, name: str) -> IntArray:
        """Elements and numbers of their sides (from 0) on a region, shape (k, 2)."""

    def nodal_forces(self, name: str, force: Any) -> FloatArray:
        """Forces on the nodes of the same effect as a uniform traction, shape (n, 3)."""


def write_inp(
    solid: SolidArrays, path: str | os.PathLike[str], *, young: float | None = None,
    poisson: float = 0.3, density: float | None = None, fixed: Sequence[str] | str = (),
    forces: Mapping[str, Any] | None = None,
) -> None:  # fmt: skip
    """Write a deck for CalculiX or Abaqus.

    Without `young` it has nodes, elements and sets only, for ``*INCLUDE`` into a deck of yours: all
    elements are ``SOLID``; a region is a node set, an element set (of the elements of which all
    nodes are in it) and a surface (of the sides of which all nodes are), all of its name.

    Parameters
    ----------
    solid : SolidMesh
        What to write.
    path : path-like
        File to create or to replace.
    young : float, optional
        Young's modulus, in force per area of the units of the part: then the deck has a material
        and a linear static step, and runs as it is.
    poisson : float
        Poisson's ratio.
    density : float, optional
        Mass per volume.
    fixed : str or sequence of str
        Regions that are held in all directions.
    forces : mapping of str to 3 floats, optional
        Resultant forces on regions of the surface, distributed as uniform tractions.

    Raises
    ------
    InputError
        Unknown regions, or constants that no material has.
    GeometryError
        If there are no elements, or no surface in a region with a force.
    FormatError
        If the file cannot be written, or coordinates are too large for it.
    """
    if len(solid.cells) == 0:
        raise GeometryError("the mesh has no elements: nothing to write")
    if not float(np.abs(solid.points).max()) < _MAX_NUMBER:
        raise FormatError(f"{path}: decks hold coordinates below {_MAX_NUMBER:g}; scale the part")
    held, pulled, load = _loaded(solid, fixed, forces)
    if young is None and (held or load is not None or density is not None):
        raise InputError("fixed, forces and density are written with a material only: give young")
    material = None if young is None else _material(young, poisson, density)
    with atomic_write(path, text=True) as file:
        file.write(
            "** written by ilattice\n"
            f"** {len(solid.points)} nodes, {len(solid.cells)} elements {solid.kind}; "
            f"volume off by {100.0 * solid.error:.3g} %\n"
        )
        _write_mesh(file, solid)
        for name in solid.regions:
            _write_sets(file, solid, name)
        if material is not None:
            file.write(material)
            _write_step(file, held, pulled, load)


def write_vtu_solid(
    solid: SolidArrays, path: str | os.PathLike[str], *, compress: bool = False
) -> None:
    """Write elements as cells, with 1 at the nodes of each region under its name.

    Parameters
    ----------
    solid : SolidMesh
        What to write.
    path : path-like
        File to create or to replace.
    compress : bool
        Compress with zlib.

    Raises
    ------
    FormatError
        If the file cannot be written.
    """
    data = {name: inside.astype(np.uint8) for name, inside in solid.regions.items()}
    kind = _VTK[solid.kind]
    write_vtu(path, solid.points, solid.cells, kind, point_data=data, compress=compress)


def _loaded(
    solid: SolidArrays, fixed: Sequence[str] | str, forces: Mapping[str, Any] | None
) -> tuple[list[str], list[str], FloatArray | None]:
    """Names of regions that are held, and that are pulled, and forces on all nodes (n, 3)."""
    held = [fixed] if isinstance(fixed, str) else as_items("fixed", fixed)
    if forces is not None and not isinstance(forces, Mapping):
        raise InputError(f"forces must map names of regions to 3 numbers, got {forces!r:.80}")
    for argument, names in (("fixed", held), ("forces", list(forces or {}))):
        for name in names:
            if name not in solid.regions:
                known = ", ".join(solid.regions) or "none; see with_regions"
                raise InputError(f"{argument}: there is no region {name!r:.80}; known: {known}")
    if not forces:
        return held, [], None
    load = np.zeros((len(solid.points), 3))
    for name, force in forces.items():
        load += solid.nodal_forces(name, as_triple(f"forces[{name!r}]", force))
    return held, list(forces), load


def _material(young: float, poisson: float, density: float | None) -> str:
    E, nu = as_positive("young", young), as_real("poisson", poisson)
    if not -1.0 < nu < 0.5:
        raise InputError(f"poisson must be between -1 and 0.5, got {poisson!r}")
    text = f"*MATERIAL, NAME=MATERIAL\n*ELASTIC\n{_number(E)}, {_number(nu)}\n"
    if density is not None:
        text += f"*DENSITY\n{_number(as_positive('density', density))}\n"
    return text + "*SOLID SECTION, ELSET=SOLID, MATERIAL=MATERIAL\n"


def _number(value: float) -> str:
    return f"{value:.12e}"


def _write_mesh(file: IO[str], solid: SolidArrays) -> None:
    file.write("*NODE, NSET=NODES\n")
    for rows in blocks(len(solid.points), TEXT_BLOCK):
        some = enumerate(solid.points[rows].tolist(), rows.start + 1)
        file.writelines(f"{i}, {x:.12e}, {y:.12e}, {z:.12e}\n" for i, (x, y, z) in some)
    file.write(f"*ELEMENT, TYPE={solid.kind}, ELSET=SOLID\n")
    for rows in blocks(len(solid.cells), TEXT_BLOCK):
        cells = enumerate((solid.cells[rows] + 1).tolist(), rows.start + 1)
        file.writelines(f"{i}, {', '.join(map(str, cell))}\n" for i, cell in cells)


def _write_sets(file: IO[str], solid: SolidArrays, name: str) -> None:
    file.write(f"*NSET, NSET={name}\n")
    file.writelines(_rows(np.flatnonzero(solid.regions[name]) + 1))
    elements, sides = solid.elements(name), solid.sides(name)
    if len(elements):
        file.write(f"*ELSET, ELSET={name}\n")
        file.writelines(_rows(elements + 1))
    if len(sides):
        file.write(f"*SURFACE, NAME={name}, TYPE=ELEMENT\n")
        file.writelines(f"{e}, S{s}\n" for e, s in (sides + 1).tolist())


def _rows(numbers: AnyArray) -> Iterator[str]:
    """Lines of integers; all but the last end in a comma."""
    count = math.ceil(len(numbers) / _PER_LINE)
    for i in range(count):
        some = numbers[i * _PER_LINE : (i + 1) * _PER_LINE].tolist()
        yield ", ".join(map(str, some)) + (",\n" if i < count - 1 else "\n")


def _write_step(
    file: IO[str], held: list[str], pulled: list[str], load: FloatArray | None
) -> None:  # fmt: skip
    if held:
        file.write("*BOUNDARY\n")
        file.writelines(f"{name}, 1, 3\n" for name in held)
    file.write("*STEP\n*STATIC\n")
    if load is not None:
        file.write(f"** resultants on {', '.join(pulled)}\n*CLOAD\n")
        for node, axis in np.argwhere(load != 0.0).tolist():
            file.write(f"{node + 1}, {axis + 1}, {_number(load[node, axis])}\n")
    file.write("*NODE FILE\nU\n*EL FILE\nS, E\n*END STEP\n")
