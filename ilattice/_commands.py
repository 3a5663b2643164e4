"""Commands of the upper rooms: homogenization, waves, graphs, shells, corner-sharing structures.

Each adds itself to the application of `ilattice.cli`, and says on standard output what was found.
"""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from ilattice.errors import InputError, printable

if TYPE_CHECKING:
    from cyclopts import App


def add_homogenize(app: "App") -> None:
    """Effective properties of a cell."""
    from cyclopts import Parameter

    Numbers = Annotated[list[float] | None, Parameter(consume_multiple=True)]

    @app.command
    def homogenize(
        *,
        tile: str | None = None,
        density: float | None = None,
        thickness: float | None = None,
        voxels: Path | None = None,
        cells: int | None = None,
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
            Number of cells of the grid of a tile per direction, by default 16; voxels have their
            own.
        young
            Young's modulus, by default 1; of voxels also one per phase.
        poisson
            Poisson's ratio.
        report
            File for all numbers, as JSON.
        sphere
            File for Young's modulus in all directions as a surface, such as .vtp.
        """
        from ilattice.homogenize import job

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


def add_bands(app: "App") -> None:
    """Waves in a cell."""
    from cyclopts import Parameter

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
        from ilattice.homogenize import job

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
            ends = f"{gap['lower']:.6g} to {gap['upper']:.6g} above band {gap['below']}"
            print(f"{'gap':>20}  {ends}{'' if gap['narrowed'] else ', errors not known'}")
        for name in report["files"]:
            print(f"{'wrote':>20}  {printable(str(name))}")


def add_cost(app: "App") -> None:
    """Corner-sharing structures."""
    from cyclopts import App, Parameter

    Files = Annotated[list[Path], Parameter(name=("--output", "-o"), consume_multiple=True)]
    Length = Annotated[float | None, Parameter(name="--h")]
    command = App(name="cost", help="Structures of tetrahedra that share corners.")

    @command.command
    def kagome(
        *,
        resolution: int,
        output: Files,
        through: str | None = None,
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
        through
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
        from ilattice.cost import job

        found = job.run(
            resolution=resolution,
            output=output,
            through=None if through is None else _job.volume(through),
            cells=cells,
            radius=radius,
            h=h,
            thickness=thickness,
            stiffen=stiffen,
            report=report,
            progress=True,
        )
        for key in ("vertices", "tetrahedra", "bars", "beams", "radius", "length of beams"):
            print(f"{key:>18}  {text(found[key])}")
        for name in found["files"]:
            print(f"{'wrote':>18}  {printable(str(name))}")

    app.command(command)


def add_shell(app: "App") -> None:
    """Shells over curves in an octant."""
    from cyclopts import Parameter

    Files = Annotated[list[Path] | None, Parameter(name=("--output", "-o"), consume_multiple=True)]
    Many = Annotated[list[float] | None, Parameter(consume_multiple=True)]
    Counts = Annotated[list[int] | None, Parameter(consume_multiple=True)]

    @app.command
    def shell(
        *,
        topology: str | None = None,
        output: Files = None,
        position: Many = None,
        derivative: Many = None,
        density: float | None = None,
        thickness: float | None = None,
        repeat: Counts = None,
        n: int = 24,
        layer: float | None = None,
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
            Length over which curvatures die out that smooth transitions between octants need; by
            default 0.01, less where creases are near to most of the shell, 2 or 4 times that
            where it tears.
        method
            harmonic or currents.
        h
            Length of the edges of the mesh of walls.
        report
            File for all numbers, as JSON.
        """
        from ilattice.shells import job

        asked = (output, position, derivative, density, thickness, repeat, layer, report)
        if topology is None and any(value is not None for value in asked):
            raise InputError("--topology is missing: name a class; ilattice shell alone lists them")
        if topology is None:
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
                print(f"{key.replace('_', ' '):>18}  {text(found[key])}")
        for name in found["files"]:
            print(f"{'wrote':>18}  {printable(str(name))}")


def add_graph(app: "App") -> None:
    """Procedural graphs."""
    from cyclopts import Parameter

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
        from ilattice.graph import job

        report = job.run(
            action, file, output=output or [], h=h, cells=cells, seeds=seeds,
            thickness=thickness, progress=True,
        )  # fmt: skip
        for name, value in report.items():
            if name != "files":
                print(f"{name:>20}  {printable(str(value))}")
        print("\n".join(f"wrote  {printable(name)}" for name in report["files"]))


def text(value: Any) -> str:
    """A number, or what is known instead of one, for people."""
    if isinstance(value, bool) or value is None:
        return {True: "yes", False: "no", None: "unknown: the mesh is open"}[value]
    return f"{value:.6g}" if isinstance(value, float) else str(value)
