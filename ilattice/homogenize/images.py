"""Arrays of voxels from files.

Guarantee: axes are x, y, z of the file; nothing is scaled. Stacks of images, of which the slowest
axis is that of the slices, are turned round to that order. Files need not be trusted: memory is
bounded by what they say, and what they say by their bytes, 1,100 times those where they are
compressed.
"""

import math
from io import BytesIO
from os import PathLike
from pathlib import Path

import numpy as np
from numpy.lib import format as npy

from ilattice._files import as_path, read_bytes
from ilattice._memory import need
from ilattice._typing import AnyArray, FloatArray
from ilattice.errors import FileError, FormatError, InputError
from ilattice.homogenize._vti import GROWTH, read_vti

STACKS = (".tif", ".tiff")


def read_voxels(path: str | PathLike[str]) -> tuple[AnyArray, FloatArray]:
    """Read an array of voxels, and the edges of voxels.

    Parameters
    ----------
    path : path-like
        ``.npy`` of NumPy; ``.vti`` of VTK, its values of cells, else those of points; ``.tif``, a
        stack of images, with scikit-image.

    Returns
    -------
    tuple of ndarray, shape (n0, n1, n2), and ndarray, shape (3,)
        Values along x, y, z, and edges: ones where the file has none.

    Raises
    ------
    FormatError
        If the file cannot be read as three directions of voxels.
    """
    file = Path(as_path("path", path))
    ending = file.suffix.lower()
    readers = {".npy": _npy, ".vti": read_vti, **dict.fromkeys(STACKS, _stack)}
    if ending not in readers:
        raise FormatError(f"{file.name!r:.80} must end in one of {', '.join(sorted(readers))}")
    if not file.exists():
        raise FileError(f"there is no file {str(file)!r:.200}")
    data = read_bytes(file)
    try:
        array, spacing = readers[ending](data)
    except InputError:  # it needs more memory than there is
        raise
    except Exception as e:
        raise FormatError(f"{file.name!r:.80} cannot be read as {ending}: {e!s:.200}") from e
    if array.ndim != 3 or array.size == 0 or array.dtype.kind not in "biuf":
        raise FormatError(
            f"{file.name!r:.80} holds no voxels in three directions, but shape {array.shape} of "
            f"{array.dtype}"
        )
    return array, spacing


def _npy(data: bytes) -> tuple[AnyArray, FloatArray]:
    file = BytesIO(data)
    version = npy.read_magic(file)
    read = npy.read_array_header_1_0 if version == (1, 0) else npy.read_array_header_2_0
    shape, fortran, dtype = read(file)
    if dtype.kind not in "biuf":
        raise FormatError(f"holds {dtype}, and not numbers or flags")
    count = math.prod(shape)
    if count * dtype.itemsize != len(data) - file.tell():
        raise FormatError(f"shape {shape!s:.80} is not that of the bytes that follow")
    values = np.frombuffer(data, dtype, count, file.tell())
    return values.reshape(shape, order="F" if fortran else "C"), np.ones(3)


def _stack(data: bytes) -> tuple[AnyArray, FloatArray]:
    try:
        from tifffile import TiffFile
    except ImportError as e:
        raise FormatError('stacks of images need scikit-image: pip install "scikit-image"') from e
    with TiffFile(BytesIO(data)) as file:
        found = file.series[0]
        room = math.prod(found.shape) * found.dtype.itemsize
        if room > len(data) * GROWTH:
            raise FormatError(f"says shape {found.shape}, which {len(data)} bytes do not hold")
        need(2 * room, f"an array of shape {found.shape}", "take fewer slices")
        return np.ascontiguousarray(np.asarray(found.asarray()).transpose()), np.ones(3)
