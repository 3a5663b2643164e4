"""The manual of the command language, made from its tables."""

from ilattice import tiles
from ilattice.fields.equation import FUNCTIONS
from ilattice.sdf._vocabulary import MESHES, OPERATIONS, SOLIDS

__all__ = ["manual"]

_TEXT = """\
Mesh a solid that is described by words, read from left to right.

  ilattice sdf box gyroid shell 0.6 -s 2/100 -o gyroid.stl
  ilattice sdf box scale 4 sphere scale 5 p-surface scale 4 gyroid -s 4/100
  ilattice sdf part.stl gyroid scale 2 distance shell 0.4

Solids are put on a stack; operations replace those on top of it; what is left at the end is
intersected. The result must be bounded: a surface that goes on for ever needs a box, a sphere or
a mesh beside it.

Solids
  {solids}; half-width or radius 1
  FILE with the ending {meshes}: signed distance
  'EQUATION' in x, y, z, inside where it is negative: 'x^2 + y^2 - z'; pi, tau, e;
  {functions}
  {tiles}

Operations on the last solid
  {unary}
Operations on the last two
  {binary}
Amounts of dilate, erode, shell and of blends are in units of the field, lengths for distances;
they may be equations, 'shell 0.1+0.05*x'. distance makes any solid one whose field is a distance.
Parameters follow in order, or by name: rotate axis 0,0,1 angle pi/2.

Options
  -s SPACING        of the grid, one number or three, such as 2/100; default: longest side / 100
  --tol LENGTH      chord error of the mesh, in place of a spacing
  -o FILE           .ply .stl .obj .off .vtp .3mf .png; default out.ply
  --report FILE     measures of the mesh, as JSON
  --slices LENGTH   write layers of this thickness: -o .cli .svg .3mf
  --set NAME=A,B    run for each value that NAME stands for; several for all combinations
  --table FILE      results of all runs, continued after an interruption; default: as -o, .csv
  --memory GB       that may be used; default 8
  --dry-run         tell the tree, the box and the cost, and stop
  --remove-islands  keep only the largest part
  --allow-loss      write meshes that have lost more than 5 % of the volume, with a warning
  --strict          refuse meshes that bound no solid
  --                what follows are no options
  @FILE             stands for the words of a file
Exit codes: 0 done, 1 files or geometry, 2 wrong words.
"""


def manual() -> str:
    """Text for the command line.

    Returns
    -------
    str
        What solids, operations and options there are.
    """

    def rows(solids: int) -> str:
        found = [
            " ".join([name.replace("_", "-"), *(p.name.upper() for p in op.parameters)])
            for name, op in OPERATIONS.items()
            if op.solids == solids
        ]
        return _wrapped(found)

    return _TEXT.format(
        solids=", ".join(name.replace("_", "-") for name in SOLIDS),
        meshes=" ".join(MESHES),
        functions=_wrapped(list(FUNCTIONS)),
        tiles=_wrapped([name.replace("_", "-") for name in tiles.names()]),
        unary=rows(1),
        binary=rows(2),
    )


def _wrapped(words: list[str]) -> str:
    from textwrap import fill

    return fill(", ".join(words), 98, subsequent_indent="  ", break_on_hyphens=False).strip()
