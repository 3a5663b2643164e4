"""Layers: closed contours of walls and meshes at given heights.

========================  ==================================================================
`Slice`                   one cross-section: polygons with holes
`SliceStack`              all of a part, computed one at a time; ``save`` writes them
========================  ==================================================================

`Wall.slices` and `SurfaceMesh.slices` make them.
"""

from ilattice.slicing.slices import Slice, SliceStack

__all__ = ["Slice", "SliceStack"]
