"""Known structures as graphs, by name: `il.graph.library["schoen_iwp"]`.

Of the 31 structures of Tables 2 to 4 those are here that their table determines (``exact``: loop,
volume and kind of surface follow, and genus and area agree with what is known of the surface), and
those that follow from what is published on them elsewhere (``reconstructed``: topology and node
types agree, sizes are ours). `missing` says why the others are not. ``known`` ones are not in the
tables.

Guarantee: files are read when asked for, and checked as any other.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from importlib.resources import files
from typing import Any

from ilattice._validate import FixedMapping, near_names
from ilattice.errors import InputError
from ilattice.graph.files import parse
from ilattice.graph.graph import Graph

_FOLDER = "structures"


@dataclass(frozen=True, eq=False, repr=False)
class Library(Mapping[str, Graph]):
    """Graphs by their names; `missing` tells of structures that cannot be reconstructed."""

    def __getitem__(self, name: str) -> Graph:
        """The graph of a name.

        Raises
        ------
        InputError
            If there is none.
        """
        if isinstance(name, str) and name in self.missing:
            raise InputError(f"library: {name!r} cannot be reconstructed: {self.missing[name]}")
        if not isinstance(name, str) or name not in self._names():
            near = near_names(str(name), self._names())
            raise InputError(f"library has no structure {name!r:.60}; the nearest are {near}")
        return parse(self._folder.joinpath(f"{name}.json").read_text("utf-8"))

    def __contains__(self, name: object) -> bool:
        return name in self._names()

    def __iter__(self) -> Iterator[str]:
        return iter(self._names())

    def __len__(self) -> int:
        return len(self._names())

    def __repr__(self) -> str:
        """Short form."""
        return f"Library({len(self)} structures, {len(self.missing)} missing)"

    @property
    def missing(self) -> Mapping[str, str]:
        """Structures of the tables that are not here, and why."""
        return MISSING

    @property
    def _folder(self) -> Any:
        return files("ilattice.graph").joinpath(_FOLDER)

    def _names(self) -> list[str]:
        found = (path.name for path in self._folder.iterdir())
        return sorted(name[:-5] for name in found if name.endswith(".json"))


_SHAPE = "its beams are drawn, not told"
_OWN = "the authors' own design, drawn only"
MISSING = FixedMapping(
    {
        "chen_alpha_delta": "which of its six sides are straight, and where, is drawn, not told",
        "twist_tilable": _SHAPE,
        "twist_tilable_bezier": _SHAPE,
        "anti_chiral": _SHAPE,
        "star_shaped": "its sheet and beams are drawn, not told",
        "non_manifold_surface": _OWN,
        "composition": _OWN,
    }
)
library = Library()
