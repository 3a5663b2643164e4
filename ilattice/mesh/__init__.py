"""Triangle meshes: `SurfaceMesh` and its measures.

`SurfaceMesh` is what contouring gives and what `ilattice.io` writes. `measure` holds the same
measures as functions of plain arrays.
"""

from ilattice.mesh.surface import SurfaceMesh

__all__ = ["SurfaceMesh"]
