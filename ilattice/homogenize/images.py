"""Arrays of voxels from files.

Guarantee: axes are x, y, z of the file; nothing is scaled. Stacks of images, of which the slowest
axis is that of the slices, are turned round to that order.
"""

from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np

from ilattice._typing import AnyArray, FloatArray
from ilattice.errors import FileError, FormatError
from ilattice.io._common import as_path

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
    if not file.is_file():
        raise FileError(f"there is no file {str(file)!r:.200}")
    ending = file.suffix.lower()
    readers = {".npy": _npy, ".vti": _vti, **dict.fromkeys(STACKS, _stack)}
    if ending not in readers:
        raise FormatError(f"{file.name!r:.80} must end in one of {', '.join(sorted(readers))}")
    try:
        array, spacing = readers[ending](file)
    except FormatError:
        raise
    except Exception as e:
        raise FormatError(f"{file.name!r:.80} cannot be read as {ending}: {e}") from e
    if array.ndim != 3 or array.size == 0 or array.dtype.kind not in "biuf":
        raise FormatError(
            f"{file.name!r:.80} holds no voxels in three directions, but shape {array.shape} of "
            f"{array.dtype}"
        )
    return array, spacing


def _npy(file: Path) -> tuple[AnyArray, FloatArray]:
    return np.load(file, allow_pickle=False), np.ones(3)


def _vti(file: Path) -> tuple[AnyArray, FloatArray]:
    import pyvista as pv

    image: Any = pv.read(str(file))
    shape = np.array(image.dimensions)
    data = image.cell_data if len(image.cell_data) else image.point_data
    if not len(data):
        raise FormatError(f"{file.name!r:.80} holds no values")
    if len(image.cell_data):
        shape = np.maximum(shape - 1, 1)
    name = data.active_scalars_name or data.keys()[0]
    values = np.asarray(data[name])
    return values.reshape(shape, order="F"), np.array(image.spacing, np.float64)


def _stack(file: Path) -> tuple[AnyArray, FloatArray]:
    try:
        from skimage.io import imread
    except ImportError as e:
        raise FormatError('stacks of images need scikit-image: pip install "scikit-image"') from e
    return np.ascontiguousarray(np.asarray(imread(file)).transpose()), np.ones(3)
