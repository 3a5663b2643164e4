"""Triangles with named data: the arrays, what is measured on them, and their parts.

Guarantees: immutable (arrays are copied once and read-only); faces name three different, existing
vertices; all coordinates are finite. Topology is that of the index table.
Not guaranteed: closedness and freedom from self-intersections.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from types import MappingProxyType
from typing import Any, Self

import numpy as np

from ilattice._shown import one_line
from ilattice._typing import AnyArray, ArrayLike, FloatArray, IntArray
from ilattice._validate import as_array, check_finite, read_only
from ilattice.errors import GeometryError, InputError
from ilattice.mesh import measure
from ilattice.mesh._kernels_surface import first_bad_face

_NO_DATA: Mapping[str, AnyArray] = MappingProxyType({})


@dataclass(frozen=True, eq=False, repr=False)
class TriangleMesh:
    """Vertices, faces and named data on them; see `SurfaceMesh`, which is what users get."""

    vertices: AnyArray
    faces: AnyArray
    point_data: Mapping[str, AnyArray] = field(default_factory=lambda: _NO_DATA)
    cell_data: Mapping[str, AnyArray] = field(default_factory=lambda: _NO_DATA)

    def __post_init__(self) -> None:
        """Check at the door, copy once."""
        vertices = _as_vertices(self.vertices)
        faces = _as_faces(self.faces, len(vertices))
        self._set(
            vertices,
            faces,
            _as_data("point_data", self.point_data, len(vertices)),
            _as_data("cell_data", self.cell_data, len(faces)),
        )

    @classmethod
    def _adopt(
        cls,
        vertices: AnyArray,
        faces: AnyArray,
        point_data: Mapping[str, AnyArray] = _NO_DATA,
        cell_data: Mapping[str, AnyArray] = _NO_DATA,
    ) -> Self:
        """Mesh of arrays that the caller gives away: no copy and no check.

        For producers of large meshes. The arrays become read-only.

        Parameters
        ----------
        vertices : (V, 3) C-contiguous float64 or float32 array
            Finite points.
        faces : (F, 3) C-contiguous int32 or int64 array
            Corners, three different existing vertices each.
        point_data : mapping of str to (V,) or (V, c) array
            Named data on the vertices.
        cell_data : mapping of str to (F,) or (F, c) array
            Named data on the faces.

        Returns
        -------
        SurfaceMesh
            The mesh that now owns the arrays.
        """
        self = object.__new__(cls)
        self._set(vertices, faces, dict(point_data), dict(cell_data))
        return self

    def _set(
        self,
        vertices: AnyArray,
        faces: AnyArray,
        point_data: dict[str, AnyArray],
        cell_data: dict[str, AnyArray],
    ) -> None:
        for array in (vertices, faces, *point_data.values(), *cell_data.values()):
            read_only(array)
        object.__setattr__(self, "vertices", vertices)
        object.__setattr__(self, "faces", faces)
        object.__setattr__(self, "point_data", MappingProxyType(point_data))
        object.__setattr__(self, "cell_data", MappingProxyType(cell_data))

    def __reduce__(self) -> tuple[Any, ...]:
        """Pickle by content (read-only mappings cannot be pickled)."""
        data = (self.vertices, self.faces, dict(self.point_data), dict(self.cell_data))
        return type(self)._adopt, data

    def __repr__(self) -> str:
        """One line: sizes and names of the data."""
        names = ", ".join((*self.point_data, *self.cell_data))
        return one_line(
            f"{type(self).__name__}({len(self.vertices)} vertices, {len(self.faces)} faces"
            + (f", data: {names}" if names else "")
            + ")"
        )

    # --- measures -----------------------------------------------------------------------------

    @cached_property
    def bounds(self) -> FloatArray:
        """Bounding box, shape (2, 3): rows are the lower and the upper corner."""
        if len(self.vertices) == 0:
            raise GeometryError("a mesh without vertices has no bounds")
        corners = np.stack([self.vertices.min(axis=0), self.vertices.max(axis=0)])
        return read_only(corners.astype(np.float64))

    @cached_property
    def _volume_and_area(self) -> tuple[float, float]:
        return measure.volume_and_area(self.vertices, self.faces)

    @property
    def volume(self) -> float:
        """Enclosed volume, positive for outward faces.

        Raises
        ------
        GeometryError
            If the mesh has open edges: it encloses nothing.
        """
        if self.open_edges:
            raise GeometryError(
                f"a mesh with {self.open_edges} open edges encloses no volume; "
                "close it (mesh walls with caps) before you ask"
            )
        return self._volume_and_area[0]

    @property
    def area(self) -> float:
        """Area of the surface."""
        return self._volume_and_area[1]

    @property
    def quality(self) -> FloatArray:
        """Quality of every triangle, shape (F,): 4 sqrt(3) area / sum of squared sides, in [0, 1].

        Computed anew on every access.
        """
        return measure.triangle_quality(self.vertices, self.faces)

    @cached_property
    def self_intersections(self) -> int:
        """Number of pairs of triangles that pass through each other, or overlap in one plane."""
        return measure.self_intersections(self.vertices, self.faces)[0]

    def measures(self) -> dict[str, Any]:
        """Size, volume, area and topology as plain data, for reports.

        Returns
        -------
        dict
            `bounds`, `volume` and `genus` (None if the mesh is open), `area`, `components`,
            `watertight`, and the numbers of `vertices` and `faces`.
        """
        closed = self.is_watertight
        return {
            "bounds": self.bounds.tolist(),
            "volume": self.volume if closed else None,
            "area": self.area,
            "genus": self.genus if closed and self.is_oriented else None,
            "components": self.components,
            "watertight": closed,
            **self.sizes(),
        }

    def sizes(self) -> dict[str, int]:
        """Numbers of `vertices` and `faces` as plain data, which cost nothing to tell.

        Returns
        -------
        dict
            The two numbers.
        """
        return {"vertices": len(self.vertices), "faces": len(self.faces)}

    # --- topology -----------------------------------------------------------------------------

    @cached_property
    def topology(self) -> measure.Topology:
        """Census of vertices, edges, fans and components; the source of the properties below."""
        return measure.topology(self.faces, len(self.vertices))

    @property
    def open_edges(self) -> int:
        """Number of edges of a single triangle."""
        return self.topology.open_edges

    @property
    def nonmanifold_edges(self) -> int:
        """Number of edges of three or more triangles."""
        return self.topology.nonmanifold_edges

    @property
    def nonmanifold_vertices(self) -> int:
        """Number of surplus fans: vertices count once for every further sheet that touches them."""
        return self.topology.fans - self.topology.vertices

    @property
    def is_watertight(self) -> bool:
        """True if every edge belongs to exactly two triangles (and there are some)."""
        return len(self.faces) > 0 and not (self.open_edges or self.nonmanifold_edges)

    @property
    def is_oriented(self) -> bool:
        """True if neighbours agree on which side is out."""
        return self.topology.twisted_edges == 0

    @property
    def euler(self) -> int:
        """Euler number V - E + F of the index table; vertices without triangles do not count."""
        return self.topology.vertices - self.topology.edges + self.topology.faces

    @property
    def genus(self) -> int:
        """Number of handles, summed over all components.

        Vertices in which sheets touch are counted once for every sheet.

        Raises
        ------
        GeometryError
            If the mesh is not a closed oriented surface.
        """
        if not (self.is_watertight and self.is_oriented):
            raise GeometryError(
                f"genus needs a closed oriented surface, this one has {self.open_edges} open, "
                f"{self.nonmanifold_edges} non-manifold and {self.topology.twisted_edges} "
                "wrongly oriented edges"
            )
        t = self.topology
        return t.components - (t.fans - t.edges + t.faces) // 2

    @property
    def components(self) -> int:
        """Number of parts that hang together through edges."""
        return self.topology.components

    @property
    def component_labels(self) -> IntArray:
        """Number of the part of every face, shape (F,), by first appearance."""
        return self.topology.labels

    def faulty_edges(self) -> IntArray:
        """Open and non-manifold edges.

        Returns
        -------
        (n, 2) array
            Their vertex pairs; empty for a watertight mesh.
        """
        return measure.faulty_edges(self.faces, len(self.vertices))

    # --- verbs: new meshes --------------------------------------------------------------------

    def with_point_data(self, **arrays: ArrayLike) -> Self:
        """The same mesh with further data on its vertices.

        Parameters
        ----------
        **arrays : (V,) or (V, c) array
            Data by name; replaces data of the same name.

        Returns
        -------
        SurfaceMesh
            Shares vertices and faces with this one.
        """
        new = _as_data("point_data", arrays, len(self.vertices))
        mesh = self._adopt(self.vertices, self.faces, {**self.point_data, **new}, self.cell_data)
        _share_cache(self, mesh)
        return mesh

    def select(self, faces: ArrayLike) -> Self:
        """The mesh of some of the faces; vertices without a face are dropped.

        Parameters
        ----------
        faces : (F,) array of bool
            The faces to keep, for example ``mesh.component_labels == 0``.

        Returns
        -------
        SurfaceMesh
            With the data of what is kept, in the old order.
        """
        as_array("faces", faces)
        keep = np.asarray(faces)
        if keep.shape != (len(self.faces),) or keep.dtype != np.bool_:
            raise InputError(
                f"faces must be a mask of shape ({len(self.faces)},), "
                f"got {keep.dtype} of shape {keep.shape}"
            )
        kept = self.faces[keep]
        used = np.zeros(len(self.vertices), np.bool_)
        used[kept] = True
        number = (np.cumsum(used) - 1).astype(self.faces.dtype)
        return self._adopt(
            self.vertices[used],
            number[kept],
            {name: a[used] for name, a in self.point_data.items()},
            {name: a[keep] for name, a in self.cell_data.items()},
        )


# --- doors ------------------------------------------------------------------------------------


def _as_vertices(value: Any) -> AnyArray:
    dtype = np.float32 if getattr(value, "dtype", None) == np.float32 else np.float64
    if getattr(value, "dtype", None) == np.bool_:
        raise InputError(f"vertices must be an array of real numbers, got {value!r:.80}")
    if getattr(value, "dtype", None) != dtype or np.ma.isMaskedArray(value):
        value = as_array("vertices", value, finite=False)
    vertices = np.array(value, dtype=dtype, order="C")
    if vertices.ndim != 2 or vertices.shape[1] != 3:
        raise InputError(f"vertices must have shape (V, 3), got {vertices.shape}")
    check_finite("vertices", vertices)  # type: ignore[arg-type]
    return vertices


def _as_faces(value: Any, n_vertices: int) -> AnyArray:
    try:
        given = np.asarray(value)
    except (TypeError, ValueError) as e:
        raise InputError(f"faces must be integers of shape (F, 3), got {value!r:.80}") from e
    if given.size == 0:
        given = given.astype(np.int64)
    if given.ndim != 2 or given.shape[1] != 3 or given.dtype.kind not in "iu":
        raise InputError(
            f"faces must be integers of shape (F, 3), got {given.dtype} of shape {given.shape}"
        )
    faces = np.array(given, dtype=np.int32 if given.dtype == np.int32 else np.int64, order="C")
    bad = first_bad_face(faces, n_vertices)
    if bad >= 0:
        raise InputError(
            f"faces must name three different vertices below {n_vertices}, "
            f"face {bad} is {faces[bad].tolist()}"
        )
    return faces


def _as_data(name: str, value: Any, count: int) -> dict[str, AnyArray]:
    """Copies of named arrays with `count` rows, one or two axes, real numbers."""
    if not isinstance(value, Mapping):
        raise InputError(f"{name} must be a mapping of names to arrays, got {value!r:.80}")
    arrays = {}
    for key, given in value.items():
        array = np.array(given, order="C")
        if not isinstance(key, str) or not key:
            raise InputError(f"{name} must have names as keys, got {key!r:.80}")
        if array.ndim not in (1, 2) or len(array) != count or array.dtype.kind not in "biuf":
            raise InputError(
                f"{name}[{key!r}] must hold real numbers of shape ({count},) or ({count}, c), "
                f"got {array.dtype} of shape {array.shape}"
            )
        arrays[key] = array
    return arrays


def _share_cache(old: TriangleMesh, new: TriangleMesh) -> None:
    """Hand on what was computed from the same vertices and faces."""
    for name in ("bounds", "_volume_and_area", "topology", "self_intersections"):
        if name in old.__dict__:
            new.__dict__[name] = old.__dict__[name]
