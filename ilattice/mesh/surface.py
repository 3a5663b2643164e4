"""`SurfaceMesh`: triangles with named data, the product of contouring.

Guarantees: immutable (arrays are copied once and read-only); faces name three different, existing
vertices; all coordinates are finite. Topology is that of the index table.
Not guaranteed: closedness and freedom from self-intersections; ask `is_watertight` and
`self_intersections`.
"""

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np

from ilattice._progress import Progress
from ilattice._typing import ArrayLike
from ilattice.io.registry import read_mesh, save
from ilattice.mesh.regions import without_islands, without_voids
from ilattice.mesh.solid_mesh import SolidMesh
from ilattice.mesh.solid_meshing import tetrahedra
from ilattice.mesh.triangles import TriangleMesh
from ilattice.plot.cards import card
from ilattice.plot.quick import show
from ilattice.plot.shapes import triangles
from ilattice.slicing.slices import SliceStack, slice_mesh

if TYPE_CHECKING:
    import os

    import pyvista
    import trimesh


_MAX_DRAWN = 1_000_000  # faces, in notebooks


@dataclass(frozen=True, eq=False, repr=False)
class SurfaceMesh(TriangleMesh):
    """A triangle mesh in space with named data on vertices and faces.

    Parameters
    ----------
    vertices : (V, 3) array
        Points; float32 is kept, everything else becomes float64.
    faces : (F, 3) array of integers
        Corners, counter-clockwise seen from outside; int32 is kept, everything else becomes int64.
    point_data : mapping of str to (V,) or (V, c) array
        Named data on the vertices. ``r``, ``g``, ``b`` in [0, 1] are taken as colours by the
        writers.
    cell_data : mapping of str to (F,) or (F, c) array
        Named data on the faces.

    Raises
    ------
    InputError
        Wrong shapes, coordinates that are not finite, corners that do not exist or are repeated.
    """

    file_kind: ClassVar[str] = "mesh"

    @classmethod
    def load(cls, path: "str | os.PathLike[str]", *, format: str | None = None) -> "SurfaceMesh":
        """Read a triangle mesh from an STL, PLY, OBJ or OFF file.

        Parameters
        ----------
        path : path-like
            The file.
        format : str, optional
            Ending that names the format, by default that of `path`.

        Returns
        -------
        SurfaceMesh
            Vertices and triangles; polygons are cut into fans.

        Raises
        ------
        FormatError
            Unknown ending, or the file cannot be read as that format.
        """
        data = read_mesh(path, format=format)
        return cls._adopt(data.vertices, data.faces)

    def _repr_html_(self) -> str:
        numbers = {**self.sizes(), "size": tuple(map(float, np.ptp(self.bounds, axis=0)))}
        if len(self.faces) > _MAX_DRAWN:
            return card(self, numbers, of=False)
        closed = {"volume": self.volume} if self.is_watertight else {"open edges": self.open_edges}
        return card(self, {**numbers, "area": self.area, **closed})

    def slices(
        self,
        z: ArrayLike | None = None,
        *,
        thickness: float | None = None,
        normal: ArrayLike = (0.0, 0.0, 1.0),
    ) -> SliceStack:
        """Cross-sections by parallel planes.

        Parameters
        ----------
        z : array_like, optional
            Heights of the planes, increasing, at least one of them within the part; beyond it
            slices are empty.
        thickness : float, optional
            Of layers, each cut at its middle; instead of `z`. The last one is what is left of
            the height.
        normal : (3,) array_like
            Normal of the planes, of any length.

        Returns
        -------
        SliceStack
            Slices, computed when asked for.

        Raises
        ------
        InputError
            If both or none of `z` and `thickness` are given, or all of `z` is outside of the part.
        GeometryError
            If the mesh is open, or not oriented.
        """
        return slice_mesh(self, z, thickness=thickness, normal=normal)

    def remove_islands(self, least: float | None = None) -> "SurfaceMesh":
        """The mesh without the parts that do not hang together with the largest.

        Parameters
        ----------
        least : float, optional
            Volume from which on parts stay; by default only the largest does.

        Returns
        -------
        SurfaceMesh
            Voids stay in the parts that stay.

        Raises
        ------
        InputError
            If `least` is not a number of at least zero.
        GeometryError
            If the mesh is not a closed oriented surface.
        """
        return without_islands(self, least)

    def fill_voids(self, most: float | None = None) -> "SurfaceMesh":
        """The mesh with its closed hollows filled, which would trap powder or resin.

        Parameters
        ----------
        most : float, optional
            Volume up to which voids are filled; by default all are.

        Returns
        -------
        SurfaceMesh
            The same surfaces without those of the voids.

        Raises
        ------
        InputError
            If `most` is not a number of at least zero.
        GeometryError
            If the mesh is not a closed oriented surface.
        """
        return without_voids(self, most)

    def tetrahedra(self, *, order: int = 2, progress: Progress = None) -> SolidMesh:
        """Fill the solid with tetrahedra, for CalculiX, Abaqus and others.

        Parameters
        ----------
        order : {1, 2}
            With nodes at the corners (C3D4), or in the middle of edges too (C3D10). Use 2: linear
            tetrahedra are far too stiff.
        progress : bool or callable, optional
            See `ilattice._progress.track`.

        Returns
        -------
        SolidMesh
            Its surface are exactly these triangles; closed voids stay empty.

        Raises
        ------
        InputError
            If TetGen is not installed: ``pip install "ilattice[tetrahedra]"``.
        GeometryError
            If the surface is open, or crosses itself.
        ConvergenceError
            If the tetrahedra do not have the volume of this mesh.

        Warns
        -----
        PrecisionWarning
            If there are several parts, each of which has to be held.
        """
        return tetrahedra(self, order, progress)

    # --- exits --------------------------------------------------------------------------------

    def to_pyvista(self) -> "pyvista.PolyData":
        """Copy as a pyvista mesh, with all data.

        Returns
        -------
        pyvista.PolyData
            Independent of this mesh.
        """
        return triangles(self.vertices, self.faces, self.point_data, self.cell_data)

    def to_trimesh(self) -> "trimesh.Trimesh":
        """Copy as a trimesh mesh, with all data as vertex and face attributes.

        Returns
        -------
        trimesh.Trimesh
            Unprocessed: same vertices and faces in the same order.
        """
        import trimesh

        return trimesh.Trimesh(
            np.array(self.vertices, np.float64),
            np.array(self.faces, np.int64),
            vertex_attributes={name: np.array(a) for name, a in self.point_data.items()},
            face_attributes={name: np.array(a) for name, a in self.cell_data.items()},
            process=False,
        )

    def plot(self, **options: Any) -> Any:
        """Show the mesh in a window or a notebook.

        Parameters
        ----------
        **options
            Of `ilattice.plot.show`, for example ``scalars="thickness"``, ``clip="y > 0"`` or
            ``screenshot="part.png"``.

        Returns
        -------
        object
            What pyvista returns.
        """
        return show(self, **options)

    def screenshot(self, path: "str | os.PathLike[str]", **options: Any) -> None:
        """Render without a window into a PNG file.

        Parameters
        ----------
        path : path-like
            File to write, whatever its ending.
        **options
            See `ilattice.io.png.write_png`: ``scalars``, ``clip``, ``size``, ``view``, ...

        Raises
        ------
        FormatError
            If the file cannot be written.
        """
        self.save(path, format="png", **options)

    def save(self, path: "str | os.PathLike[str]", **options: Any) -> None:
        """Write the mesh in the format that the ending names: STL, PLY, OBJ, OFF, 3MF, VTP, PNG.

        Parameters
        ----------
        path : path-like
            File to write; an old one is replaced as a whole or left alone.
        **options
            See the writer of the format in `ilattice.io`.

        Raises
        ------
        FormatError
            Unknown ending, or the file cannot be written.
        """
        save(self, path, **options)


load = SurfaceMesh.load
