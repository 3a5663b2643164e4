"""The command line ``ilattice``: every command is one call of the library.

Guarantee: what goes wrong on purpose ends in one line on standard error and exit code 2 (wrong
words: usage and arguments) or 1 (files, geometry and everything else); interrupting ends in 130. No
traceback, whatever the encoding of the terminal; whoever reads the output may stop reading it.
Warnings are lines on standard error too.
"""

import os
import re
import sys
import time
import warnings
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from ilattice.errors import (
    FileError,
    GeometryError,
    GraphError,
    IlatticeError,
    InputError,
    PrecisionWarning,
    printable,
    shortened,
)

if TYPE_CHECKING:
    from cyclopts import App


def main(arguments: Sequence[str] | None = None) -> int:
    """Run one command.

    Parameters
    ----------
    arguments : sequence of str, optional
        The words after ``ilattice``; by default those of this process.

    Returns
    -------
    int
        Exit code.
    """
    from cyclopts import CycloptsError

    words = sys.argv[1:] if arguments is None else list(arguments)
    _take_any_letter()
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("always", PrecisionWarning)
            warnings.showwarning = _warn
            if words[:1] == ["sdf"]:
                _sdf(words[1:])  # of which Cyclopts would drop empty ones
            else:
                _app()(_renamed(words), exit_on_error=False, print_error=False)
            if sys.stdout is not None:  # as it is where it was closed
                sys.stdout.flush()
    except BrokenPipeError:
        _stop_writing()
    except CycloptsError as e:
        return _fail(str(e), 2)
    except InputError as e:
        return _fail(str(e), 1 if isinstance(e, (FileError, GraphError)) else 2)
    except FileNotFoundError as e:  # os.getcwd names nothing
        return _fail(str(e) if e.filename else "the working directory is gone; change to one", 1)
    except (IlatticeError, OSError) as e:
        return _fail(str(e), 1)
    except MemoryError:
        return _fail("not enough memory; try a larger h or fewer tiles", 1)
    except KeyboardInterrupt:
        return _fail("interrupted", 130)
    return 0


def _take_any_letter() -> None:
    """Let letters that the terminal does not know stand as their codes."""
    for stream in (sys.stdout, sys.stderr):
        with suppress(AttributeError, ValueError):  # streams that are no files of text
            stream.reconfigure(errors="backslashreplace")  # type: ignore[union-attr]


def _stop_writing() -> None:
    """Nobody reads the output any more: let what is left of it vanish."""
    with suppress(OSError, ValueError, AttributeError):
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


def _fail(message: str, code: int) -> int:
    _tell("error", message)
    return code


def _renamed(words: Sequence[str]) -> list[str]:
    """The words with today's names of options, for one release, and a warning of old ones."""
    out = [re.sub(r"^--map(?==|$)", "--through", word) for word in words]
    if out != list(words) and words[0] in ("build", "slice"):
        _tell("warning", "--map is called --through now, and will be unknown in the next release")
        return out
    return list(words)


def _warn(message: Warning | str, *_: Any, **__: Any) -> None:
    _tell("warning", str(message))


def _tell(kind: str, message: str) -> None:
    if sys.stderr is None:  # closed; print would take the output instead
        return
    with suppress(BrokenPipeError):
        print(f"ilattice: {kind}:", shortened(" ".join(message.split())), file=sys.stderr)


def _app() -> "App":
    from cyclopts import App, Parameter

    import ilattice as il

    app = App(
        name="ilattice",
        help=str(il.__doc__).splitlines()[0],
        help_format="plaintext",
        version=il.__version__,
        default_parameter=Parameter(negative=()),
        result_action="return_value",
        suppress_keyboard_interrupt=False,
    )
    files = (_add_demo, _add_build, _add_slice)
    rooms = (_add_homogenize, _add_bands, _add_graph, _add_shell, _add_cost)
    for add in (*files, *rooms, _add_sdf, _add_others):
        add(app)
    return app


def _add_demo(app: "App") -> None:
    from cyclopts import Parameter

    from ilattice import _job

    Length = Annotated[float, Parameter(name="--h")]

    @app.command
    def demo(*, out: str = "ilattice-demo", h: Length = 0.05) -> None:
        """Build the Schwarz-P lattice in a torus: meshes, a picture and a report.

        Parameters
        ----------
        out
            Directory for the files.
        h
            Length of the edges of the mesh.
        """
        _summary(_job.demo(out, h=h, progress=True))


def _add_build(app: "App") -> None:
    from cyclopts import Parameter

    from ilattice import _job

    Files = Annotated[list[Path], Parameter(name=("--output", "-o"), consume_multiple=True)]
    Length = Annotated[float, Parameter(name="--h")]
    Thickness = Annotated[str, Parameter(allow_leading_hyphen=True)]

    @app.command
    def build(
        *,
        tile: str,
        through: str,
        repeat: tuple[int, int, int],
        thickness: Thickness,
        output: Files,
        tol: float | None = None,
        h: Length | None = None,
        report: Path | None = None,
        features: bool = False,
        remove_islands: bool = False,
        allow_loss: bool = False,
        seed: int | None = None,
    ) -> None:
        """Fill a volume with a lattice of given wall thickness.

        Parameters
        ----------
        tile
            Name of a tile; see ``ilattice tiles``. Several, with commas in between, follow each
            other along the first direction that is not closed, with smooth transitions.
        through
            Name of a built-in volume, or FILE, or FILE#patch.
        repeat
            Number of tiles along u, v and w.
        thickness
            Half-thickness: a number, or an equation in u, v, w, "0.1 + 0.05*sin(2*pi*u)", or in
            x, y, z of space.
        output
            Files to write; the endings pick the formats.
        tol
            Largest error of the half-thickness; by default that of 16 spans per tile.
        h
            Length of the edges of the mesh; it may be longer than the wall is thick.
        report
            File for the report, as JSON.
        features
            Measure the thinnest wall and the narrowest gap, too; this may take a minute.
        remove_islands
            Keep only the largest part of the mesh, without loose chips.
        allow_loss
            Accept a mesh that has lost more than 5 % of the volume of the wall.
        seed
            Draw one of the tiles for every cell; the same seed gives the same lattice.
        """
        _summary(
            _job.build(
                tile=tile,
                through=through,
                repeat=repeat,
                thickness=thickness,
                tol=tol,
                h=h,
                output=output,
                report=report,
                features=features,
                remove_islands=remove_islands,
                allow_loss=allow_loss,
                seed=seed,
                progress=True,
            )
        )


def _add_slice(app: "App") -> None:
    from cyclopts import Parameter

    from ilattice import _job

    Files = Annotated[list[Path], Parameter(name=("--output", "-o"), consume_multiple=True)]
    Length = Annotated[float, Parameter(name="--h")]
    Thickness = Annotated[str, Parameter(allow_leading_hyphen=True)]

    @app.command(name="slice")
    def slice_(
        *,
        tile: str,
        through: str,
        repeat: tuple[int, int, int],
        thickness: Thickness,
        layer: float,
        output: Files,
        h: Length | None = None,
        rough: bool = False,
        seed: int | None = None,
    ) -> None:
        """Slice a lattice in a volume without a mesh.

        Parameters
        ----------
        tile
            Name of a tile; see ``ilattice tiles``. Several, with commas in between, follow each
            other along the first direction that is not closed, with smooth transitions.
        through
            Name of a built-in volume, or FILE, or FILE#patch.
        repeat
            Number of tiles along u, v and w.
        thickness
            Half-thickness: a number, or an equation in u, v, w or in x, y, z.
        layer
            Thickness of the layers.
        output
            Files to write: .cli, .svg or .3mf.
        h
            Length of the edges of the contours.
        rough
            Follow the distance spline instead of the exact offset; faster.
        seed
            Draw one of the tiles for every cell; the same seed gives the same lattice.
        """
        report = _job.slices(
            tile=tile,
            through=through,
            repeat=repeat,
            thickness=thickness,
            layer=layer,
            output=output,
            h=h,
            polish=not rough,
            seed=seed,
            progress=True,
        )
        print(f"{report['layers']} layers from {report['from']:.6g} to {report['to']:.6g}")
        print("\n".join(f"wrote  {printable(name)}" for name in report["files"]))


def _add_homogenize(app: "App") -> None:
    from cyclopts import Parameter

    from ilattice.homogenize import job

    Numbers = Annotated[list[float] | None, Parameter(consume_multiple=True)]

    @app.command
    def homogenize(
        *,
        tile: str | None = None,
        density: float | None = None,
        thickness: float | None = None,
        voxels: Path | None = None,
        cells: int = 16,
        young: Numbers = None,
        poisson: float = 0.3,
        report: Path | None = None,
        sphere: Path | None = None,
    ) -> None:
        """Tell the effective stiffness of a cell that repeats.

        Parameters
        ----------
        tile
            Name of a tile; see ``ilattice tiles``. The solid is where it is negative.
        density
            Relative density of sheets around the tile's surface, instead.
        thickness
            Half-thickness of the sheets, instead of a density.
        voxels
            File of voxels instead of a tile: .npy, .vti or .tif; true and false, fill fractions, or
            whole numbers of phases.
        cells
            Number of cells of the grid per direction; voxels have their own.
        young
            Young's modulus, by default 1; of voxels also one per phase.
        poisson
            Poisson's ratio.
        report
            File for all numbers, as JSON.
        sphere
            File for Young's modulus in all directions as a surface, such as .vtp.
        """
        _tell_cell(
            job.homogenize(
                tile=tile,
                density=density,
                thickness=thickness,
                voxels=voxels,
                cells=cells,
                young=young or [1.0],
                poisson=poisson,
                report=report,
                sphere=sphere,
                progress=True,
            )
        )


def _tell_cell(report: dict[str, Any]) -> None:
    """Print the report of `ilattice.homogenize.job.homogenize`."""
    print(f"{'relative density':>20}  {report['density']:.6g}")
    for name, keys in (
        ("Young's moduli", ("E_x", "E_y", "E_z")),
        ("Poisson's ratios", ("nu_xy", "nu_xz", "nu_yz")),
        ("shear moduli", ("G_yz", "G_xz", "G_xy")),
    ):
        told = (_number(report[k]) for k in keys)
        print(f"{name:>20}  {', '.join(told)}")
    for name, key in (("bulk modulus", "K"), ("Zener's ratio", "zener"), ("error", "error")):
        print(f"{name:>20}  {_number(report[key])}")
    print(f"{'symmetry':>20}  {report['symmetry']}")
    for name in report["files"]:
        print(f"{'wrote':>20}  {printable(str(name))}")


def _number(value: float | None) -> str:
    return "unknown" if value is None else f"{value:.6g}"


def _add_bands(app: "App") -> None:
    from cyclopts import Parameter

    from ilattice.homogenize import job

    Files = Annotated[list[Path], Parameter(name=("--output", "-o"), consume_multiple=True)]

    @app.command
    def bands(
        *,
        tile: str,
        output: Files,
        density: float | None = None,
        thickness: float | None = None,
        path: str = "GXMRG",
        count: int = 8,
        steps: int = 8,
        cells: int = 12,
        young: float = 1.0,
        poisson: float = 0.3,
        mass: float = 1.0,
    ) -> None:
        """Tell the frequencies of waves in a cell that repeats, and the gaps between them.

        Parameters
        ----------
        tile
            Name of a tile; see ``ilattice tiles``. The solid is where it is negative.
        output
            Files to write: .csv, .json, or pictures .png, .svg, .pdf.
        density
            Relative density of sheets around the tile's surface, instead.
        thickness
            Half-thickness of the sheets, instead of a density.
        path
            Letters of the points of symmetry that the wave vectors go through.
        count
            Number of bands.
        steps
            Wave vectors from a point to the next one.
        cells
            Number of cells of the grid per direction.
        young
            Young's modulus.
        poisson
            Poisson's ratio.
        mass
            Mass per volume of the solid.
        """
        report = job.bands(
            tile=tile,
            output=output,
            density=density,
            thickness=thickness,
            path=path,
            count=count,
            steps=steps,
            cells=cells,
            young=young,
            poisson=poisson,
            mass=mass,
            progress=True,
        )
        print(f"{'wave vectors':>20}  {len(report['k'])}")
        print(f"{'bands':>20}  {len(report['errors'])}")
        print(f"{'error':>20}  {_number(report['error'])}")
        for gap in report["gaps"]:
            ends = f"{gap['lower']:.6g} to {gap['upper']:.6g}"
            print(f"{'gap':>20}  {ends} above band {gap['below']}")
        for name in report["files"]:
            print(f"{'wrote':>20}  {printable(str(name))}")


def _add_cost(app: "App") -> None:
    from cyclopts import App, Parameter

    from ilattice.cost import job

    Files = Annotated[list[Path], Parameter(name=("--output", "-o"), consume_multiple=True)]
    Length = Annotated[float | None, Parameter(name="--h")]
    command = App(name="cost", help="Structures of tetrahedra that share corners.")

    @command.command
    def kagome(
        *,
        resolution: int,
        output: Files,
        map: str | None = None,
        cells: int = 0,
        radius: float | None = None,
        h: Length = None,
        thickness: float | None = None,
        stiffen: bool = False,
        report: Path | None = None,
    ) -> None:
        """Fill a tetrahedron, or a volume, with a Kagome structure of round beams.

        Parameters
        ----------
        resolution
            Tetrahedra along an edge: 2 or more.
        output
            Files to write: beams .3mf, .vtp, .vtu; meshes .stl, .ply, ...; slices .cli, .svg.
        map
            File of a volume, FILE#patch, or the name of a built-in one; see ``ilattice info``.
        cells
            Cells of the volume per direction, of five tetrahedra each; 0 for one tetrahedron.
        radius
            Of the beams; by default a tenth of the shortest one at each vertex.
        h
            Spacing of the grid of meshes; by default a third of the radius.
        thickness
            Of layers; by default a fiftieth of the height.
        stiffen
            Add bars that make the structure minimally rigid.
        report
            File for all numbers, as JSON.
        """
        from ilattice import _job

        found = job.run(
            resolution=resolution,
            output=output,
            through=None if map is None else _job.volume(map),
            cells=cells,
            radius=radius,
            h=h,
            thickness=thickness,
            stiffen=stiffen,
            report=report,
            progress=True,
        )
        for key in ("vertices", "tetrahedra", "bars", "beams", "radius", "length of beams"):
            print(f"{key:>18}  {_text(found[key])}")
        for name in found["files"]:
            print(f"{'wrote':>18}  {printable(str(name))}")

    app.command(command)


def _add_shell(app: "App") -> None:
    from cyclopts import Parameter

    from ilattice.shells import job

    Files = Annotated[list[Path] | None, Parameter(name=("--output", "-o"), consume_multiple=True)]
    Many = Annotated[list[float] | None, Parameter(consume_multiple=True)]
    Counts = Annotated[list[int] | None, Parameter(consume_multiple=True)]

    @app.command
    def shell(
        *,
        topology: str = "",
        output: Files = None,
        position: Many = None,
        derivative: Many = None,
        density: float | None = None,
        thickness: float | None = None,
        repeat: Counts = None,
        n: int = 24,
        layer: float = 0.02,
        method: str = "harmonic",
        h: float = 0.05,
        report: Path | None = None,
    ) -> None:
        """Make a shell like a minimal surface over curves on the faces of an octant of its cell.

        Parameters
        ----------
        topology
            Class of the curves, and r or t per axis, as topo_19_rrr; without it they are listed.
        output
            Files for the mesh.
        position
            Of the nodes on the edges of the octant, from -1 to 1: one, or one per orbit or node.
        derivative
            Of the curves at the nodes: one, or one per orbit or node.
        density
            Relative density of walls around the shell.
        thickness
            Their half-thickness, instead.
        repeat
            Number of cells of edge 1, one or three.
        n
            Cells of the grid of the surface per edge of the octant.
        layer
            Length over which curvatures die out that smooth transitions between octants need.
        method
            harmonic or currents.
        h
            Length of the edges of the mesh of walls.
        report
            File for all numbers, as JSON.
        """
        if not topology:
            print("\n".join(job.listed()))
            return
        found = job.shell(
            topology=topology,
            output=output or (),
            position=position or (0.0,),
            derivative=derivative or (1.5,),
            density=density,
            thickness=thickness,
            repeat=1 if repeat is None else repeat[0] if len(repeat) == 1 else repeat,
            n=n,
            layer=layer,
            method=method,
            h=h,
            report=report,
            progress=True,
        )
        for key in ("area", "genus", "pieces", "mean_curvature", "slope", "tile_error", "density"):
            if found[key] is not None:
                print(f"{key.replace('_', ' '):>18}  {_text(found[key])}")
        for name in found["files"]:
            print(f"{'wrote':>18}  {printable(str(name))}")


def _add_graph(app: "App") -> None:
    from cyclopts import Parameter

    from ilattice.graph import job

    Files = Annotated[list[Path] | None, Parameter(name=("--output", "-o"), consume_multiple=True)]

    @app.command
    def graph(
        action: str, file: str, *, output: Files = None, h: float = 0.02, cells: int | None = None,
        seeds: int = 10, thickness: float = 0.05,
    ) -> None:  # fmt: skip
        """Evaluate, draw or check a procedural graph, or explore random ones.

        Parameters
        ----------
        action
            run, plot, validate or explore.
        file
            A graph (.json), or a name of the library; for explore: truss, direct, conjugate or
            asymmetric.
        output
            Files to write. run: meshes, .vti of voxels, .json with the stiffness; plot: .png, .svg,
            .pdf; explore: .csv, which an interrupted exploration goes on with.
        h
            Spacing of meshes.
        cells
            Voxels per direction.
        seeds
            Number of random graphs.
        thickness
            Thickness of random graphs.
        """
        report = job.run(
            action, file, output=output or [], h=h, cells=cells, seeds=seeds,
            thickness=thickness, progress=True,
        )  # fmt: skip
        for name, value in report.items():
            if name != "files":
                print(f"{name:>20}  {printable(str(value))}")
        print("\n".join(f"wrote  {printable(name)}" for name in report["files"]))


def _add_sdf(app: "App") -> None:
    from cyclopts import App, Parameter

    Words = Annotated[str, Parameter(allow_leading_hyphen=True)]
    command = App(name="sdf", help_flags=(), version_flags=(), end_of_options_delimiter="")

    @command.default
    def sdf(*words: Words) -> None:
        """Mesh a solid that is described by words: ``ilattice sdf -h`` tells which.

        Parameters
        ----------
        words
            Solids, operations and options.
        """
        _sdf(words)

    app.command(command)


def _sdf(words: Sequence[str]) -> None:
    """Carry out ``ilattice sdf``."""
    from ilattice._version import __version__
    from ilattice.sdf.job import run
    from ilattice.sdf.manual import manual

    if not words or "-h" in words or "--help" in words:
        print(manual())
    elif "--version" in words:
        print(__version__)
    else:
        report = run(words, progress=True)
        _tell_solid(report)
        if report.get("rows") and not any(row["file"] for row in report["rows"]):
            raise GeometryError(f"none of the {len(report['rows'])} runs made a solid")


def _tell_solid(report: dict[str, Any]) -> None:
    """Print the report of `ilattice.sdf.job.run`."""
    for line in report.get("tree", ()):
        print(printable(line))
    for key, value in report.items():
        if key not in ("tree", "rows", "stages", "files", "command"):
            print(f"{key:>18}  {_text(value)}")
    for row in report.get("rows", ()):
        if row["message"]:
            _tell("warning", f"{row['message']}")
    for name in report.get("files", ()):
        print(f"{'wrote':>18}  {printable(str(name))}")


def _add_others(app: "App") -> None:
    from ilattice import _job, _warmup

    @app.command
    def info(file: str) -> None:
        """Tell what a file holds: the patches of a volume.

        Parameters
        ----------
        file
            FILE or FILE#patch, or the name of a built-in volume.
        """
        print("\n".join(map(printable, _job.describe(file))))

    @app.command
    def tiles() -> None:
        """List the catalogue of tiles."""
        print("\n".join(_job.catalogue()))

    @app.command
    def warmup() -> None:
        """Compile all kernels now, so that later runs start at once."""
        start = time.perf_counter()
        _warmup.warmup(progress=True)
        print(f"all kernels are compiled ({time.perf_counter() - start:.0f} s)")


def _summary(report: dict[str, Any]) -> None:
    keys = ("volume", "area", "genus", "components", "islands", "watertight", "self_intersections")
    for key in keys:
        print(f"{key.replace('_', ' '):>18}  {_text(report[key])}")
    if report.get("wall_volume") is not None:
        print(f"{'of the wall':>18}  {_text(report['wall_volume'])}")
    for key in ("vertices", "faces", "unconverged"):
        print(f"{key:>18}  {_text(report[key])}")
    for key in ("thickness_error", "closest_points"):
        parts = (f"{name.replace('_', ' ')} {_text(value)}" for name, value in report[key].items())
        print(f"{key.replace('_', ' '):>18}  {', '.join(parts)}")
    for key in ("minimum_thickness", "minimum_gap"):
        if key in report:
            found = report[key]
            print(f"{key.replace('_', ' '):>18}  {_text(found['size'])} ({found['kind']})")
    for name in report["files"]:
        print(f"{'wrote':>18}  {printable(str(name))}")


def _text(value: Any) -> str:
    if isinstance(value, bool) or value is None:
        return {True: "yes", False: "no", None: "unknown: the mesh is open"}[value]
    return f"{value:.6g}" if isinstance(value, float) else str(value)
