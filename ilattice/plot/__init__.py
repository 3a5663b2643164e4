"""Pictures of everything: scenes, panels, films.

========================  ==================================================================
`Scene`                   what is drawn, how and from where; `save`, `show`, `image`
`Panels`                  scenes side by side, with letters and one colour bar
`heat_map`                a function on a plane
`show`                    one thing, at once
`polylines`               lines through points, to be drawn
`animate`                 scenes one after the other, as GIF or MP4
========================  ==================================================================

The ``plot`` of meshes, walls, solutions and so on is a scene with one thing in it.
"""

from ilattice.plot.animation import animate
from ilattice.plot.panels import Panels
from ilattice.plot.planes import heat_map
from ilattice.plot.quick import show
from ilattice.plot.scene import Scene
from ilattice.plot.shapes import polylines

__all__ = ["Panels", "Scene", "animate", "heat_map", "polylines", "show"]
