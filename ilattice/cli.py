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

from ilattice._commands import add_bands, add_cost, add_graph, add_homogenize, add_shell, text
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
    try:
        return _main(arguments)
    except KeyboardInterrupt:
        if arguments is None:  # the process ends: objects left half made may fail in silence
            sys.unraisablehook = lambda _: None
        return _fail("interrupted", 130)


def _main(arguments: Sequence[str] | None) -> int:
    """See `main`; interruptions are passed on."""
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
    if out != list(words) and words[0] in ("build", "slice", "cost"):
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
        default_parameter=Parameter(negative=(), converter=_converted),
        result_action="return_value",
        suppress_keyboard_interrupt=False,
    )
    files = (_add_demo, _add_build, _add_slice)
    rooms = (add_homogenize, add_bands, add_graph, add_shell, add_cost)
    for add in (*files, *rooms, _add_sdf, _add_others):
        add(app)
    return app


def _converted(kind: Any, words: Any) -> Any:
    """Values of an option; Cyclopts alone would round fractions where whole numbers are wanted."""
    from cyclopts import convert

    return convert(kind, words, converter=_single)


def _single(kind: Any, word: str) -> Any:
    """One of them; Cyclopts names the option of a `ValueError` as it was written."""
    from cyclopts import CoercionError, convert

    if kind is int and "." in word and not float(word).is_integer():
        raise ValueError(f"{word} is no whole number")
    try:
        return convert(kind, [word])
    except CoercionError as e:
        raise ValueError(str(e)) from e


def _add_demo(app: "App") -> None:
    from cyclopts import Parameter

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
        from ilattice import _job

        _summary(_job.demo(out, h=h, progress=True))


def _add_build(app: "App") -> None:
    from cyclopts import Parameter

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
        from ilattice import _job

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
        from ilattice import _job

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
            print(f"{key:>18}  {text(value)}")
    for row in report.get("rows", ()):
        if row["message"]:
            _tell("warning", f"{row['message']}")
    for name in report.get("files", ()):
        print(f"{'wrote':>18}  {printable(str(name))}")


def _add_others(app: "App") -> None:
    @app.command
    def info(file: str) -> None:
        """Tell what a file holds: the patches of a volume.

        Parameters
        ----------
        file
            FILE or FILE#patch, or the name of a built-in volume.
        """
        from ilattice import _job

        print("\n".join(map(printable, _job.describe(file))))

    @app.command
    def tiles() -> None:
        """List the catalogue of tiles."""
        from ilattice import _job

        print("\n".join(_job.catalogue()))

    @app.command
    def warmup() -> None:
        """Compile all kernels now, so that later runs start at once."""
        from ilattice import _warmup

        start = time.perf_counter()
        _warmup.warmup(progress=True)
        print(f"all kernels are compiled ({time.perf_counter() - start:.0f} s)")


def _summary(report: dict[str, Any]) -> None:
    keys = ("volume", "area", "genus", "components", "islands", "watertight", "self_intersections")
    for key in keys:
        print(f"{key.replace('_', ' '):>18}  {text(report[key])}")
    if report.get("wall_volume") is not None:
        print(f"{'of the wall':>18}  {text(report['wall_volume'])}")
    for key in ("vertices", "faces", "unconverged"):
        print(f"{key:>18}  {text(report[key])}")
    for key in ("thickness_error", "closest_points"):
        parts = (f"{name.replace('_', ' ')} {text(value)}" for name, value in report[key].items())
        print(f"{key.replace('_', ' '):>18}  {', '.join(parts)}")
    for key in ("minimum_thickness", "minimum_gap"):
        if key in report:
            found = report[key]
            print(f"{key.replace('_', ' '):>18}  {text(found['size'])} ({found['kind']})")
    for name in report["files"]:
        print(f"{'wrote':>18}  {printable(str(name))}")
