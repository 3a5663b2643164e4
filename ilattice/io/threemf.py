"""3MF through lib3mf: triangles with a unit and colours, for slicers.

Guarantees: coordinates keep the seven digits of single precision whatever the unit; the unit is in
the file. Colours are rounded to five bits per channel when there are more than 65 536. Not kept:
named data other than ``r``, ``g``, ``b``. The same mesh gives the same bytes: its UUIDs are made
from a digest. Needs the extra ``print``.
"""

import ctypes
import hashlib
import os
import uuid
from collections.abc import Callable
from typing import IO, Any

import numpy as np

from ilattice._files import atomic_write
from ilattice._typing import AnyArray
from ilattice._validate import near_names
from ilattice.errors import FormatError, InputError
from ilattice.io._mesh import (
    Triangles,
    blocks,
    check_mesh,
    check_single,
    collapsed,
    colours,
    warn_collapsed,
    warn_rounded,
)

UNITS = {
    "micron": "MicroMeter",
    "millimeter": "MilliMeter",
    "centimeter": "CentiMeter",
    "inch": "Inch",
    "foot": "Foot",
    "meter": "Meter",
}
#: Colours of a file, and significant digits of coordinates.
_PALETTE = 1 << 16
_DIGITS = 8
_PLACES = 16  # most that lib3mf writes behind the point
_SIZES = 1e-9, 1e9  # of the first these are seven digits, the second is what lib3mf takes


def write_3mf(mesh: Triangles, path: str | os.PathLike[str], *, unit: str = "millimeter") -> None:
    """Write a 3MF file with one object.

    Parameters
    ----------
    mesh : SurfaceMesh
        The mesh; ``r``, ``g``, ``b`` become vertex colours.
    path : path-like
        File to create or to replace.
    unit : {"micron", "millimeter", "centimeter", "inch", "foot", "meter"}
        Unit of the coordinates.

    Raises
    ------
    GeometryError
        If the mesh is empty.
    InputError
        Unknown unit.
    FormatError
        If lib3mf is missing or refuses the mesh, or the file cannot be written, or holds no
        coordinates of this size.
    """
    check_mesh(mesh)
    check_single(mesh.vertices, "3MF", *_SIZES)
    if unit not in UNITS:
        raise InputError(f"unit {unit!r} is unknown; choose {near_names(str(unit), [*UNITS], 6)}")
    lib3mf = _library()
    vertices = mesh.vertices.astype(np.float32, order="C")
    try:
        model = _model(lib3mf, mesh, vertices, unit)
    except lib3mf.ELib3MFException as e:
        raise FormatError(f"lib3mf does not take this mesh: {e}; scale the part") from e
    with atomic_write(path) as file:
        _write(lib3mf, model, file, _decimals(mesh))
    lost = sum(collapsed(vertices[mesh.faces[rows]]) for rows in blocks(len(mesh.faces)))
    warn_collapsed(lost, "3MF")
    if not lost:
        warn_rounded(mesh, "3MF")


def _model(lib3mf: Any, mesh: Triangles, vertices: AnyArray, unit: str) -> Any:
    """The document of lib3mf that holds a mesh."""
    wrapper = lib3mf.get_wrapper()
    model = wrapper.CreateModel()
    model.SetUnit(lib3mf.ModelUnit[UNITS[unit]])
    part = model.AddMeshObject()
    _set_geometry(lib3mf, wrapper, part, vertices, mesh.faces)
    colour = colours(mesh.point_data)
    if colour is not None:
        _set_colours(lib3mf, wrapper, model, part, colour, mesh.faces)
    item = model.AddBuildItem(part, wrapper.GetIdentityTransform())
    _set_names(model, part, item, vertices, mesh.faces)
    return model


def _set_names(model: Any, part: Any, item: Any, vertices: AnyArray, faces: AnyArray) -> None:
    """UUIDs from what the mesh holds, in place of the random ones of lib3mf."""
    found = hashlib.sha256(np.ascontiguousarray(vertices).data)
    found.update(np.ascontiguousarray(faces, np.int64).data)
    space = uuid.UUID(bytes=found.digest()[:16])
    model.SetBuildUUID(str(uuid.uuid5(space, "build")))
    part.SetUUID(str(uuid.uuid5(space, "object")))
    item.SetUUID(str(uuid.uuid5(space, "item")))


def _library() -> Any:
    try:
        import lib3mf
    except ImportError as e:
        raise FormatError(
            "writing 3MF needs lib3mf, which is not installed: "
            'pip install "ilattice[print]"; or write .stl'
        ) from e
    return lib3mf


def _decimals(mesh: Triangles) -> int:
    """Places after the point that keep single precision for coordinates of this size."""
    largest = max(float(mesh.vertices.max()), -float(mesh.vertices.min()), 1e-30)
    return int(np.clip(_DIGITS - np.floor(np.log10(largest)), 1, _PLACES))


def _write(lib3mf: Any, model: Any, file: IO[bytes], decimals: int) -> None:
    """Write the model through callbacks.

    When lib3mf writes a file itself and the disk is full, its destructor ends the whole process.
    So Python writes; after an error the rest is thrown away and the error raised at the end.
    """
    errors: list[BaseException] = []

    def attempt(action: Callable[[], object]) -> None:
        if not errors:
            try:
                action()
            except BaseException as e:  # cannot pass through C; an interrupt neither
                errors.append(e)

    def write(address: int, size: int, _: object) -> None:
        attempt(lambda: file.write(ctypes.string_at(address, size)))

    def seek(position: int, _: object) -> None:
        attempt(lambda: file.seek(position))

    writer = model.QueryWriter("3mf")
    writer.SetDecimalPrecision(decimals)
    callbacks = lib3mf.WriteCallback(write), lib3mf.SeekCallback(seek)
    try:
        writer.WriteToCallback(*callbacks, None)
    except lib3mf.ELib3MFException as e:
        errors.append(FormatError(f"lib3mf could not write the file: {e}"))
    del writer
    if errors:
        raise errors[0]


def _set_geometry(
    lib3mf: Any, wrapper: Any, part: Any, vertices: AnyArray, faces: AnyArray
) -> None:
    """Hand the arrays over as they lie in memory; the bindings' own method copies item by item."""
    corners = np.ascontiguousarray(faces, dtype=np.uint32)
    wrapper.checkError(
        part,
        wrapper.lib.lib3mf_meshobject_setgeometry(
            part._handle,
            ctypes.c_uint64(len(vertices)),
            (lib3mf.Position * len(vertices)).from_buffer(vertices),
            ctypes.c_uint64(len(corners)),
            (lib3mf.Triangle * len(corners)).from_buffer(corners),
        ),
    )


def _set_colours(
    lib3mf: Any, wrapper: Any, model: Any, part: Any, colour: AnyArray, faces: AnyArray
) -> None:
    """A colour for every corner of every triangle, from a palette of the different ones."""
    palette, number = _palette(colour)
    group = model.AddColorGroup()
    identity = np.array(
        [group.AddColor(lib3mf.Color(*rgb, 255)) for rgb in palette.tolist()], np.uint32
    )
    resource = group.GetResourceID()
    properties = np.empty((len(faces), 4), np.uint32)
    properties[:, 0] = resource
    properties[:, 1:] = identity[number][faces]
    part.SetObjectLevelProperty(resource, int(identity[0]))
    wrapper.checkError(
        part,
        wrapper.lib.lib3mf_meshobject_setalltriangleproperties(
            part._handle,
            ctypes.c_uint64(len(faces)),
            (lib3mf.TriangleProperties * len(faces)).from_buffer(properties),
        ),
    )


def _palette(colour: AnyArray) -> tuple[AnyArray, AnyArray]:
    """Different colours (n, 3) and the number of each vertex's colour among them."""
    packed = colour.astype(np.uint32) @ np.array([1 << 16, 1 << 8, 1], np.uint32)
    found, number = np.unique(packed, return_inverse=True)
    if len(found) > _PALETTE:
        coarse = np.rint(np.rint(colour * (31 / 255)) * (255 / 31)).astype(np.uint8)
        return _palette(coarse)
    return np.stack([found >> 16, found >> 8 & 255, found & 255], axis=1), number
