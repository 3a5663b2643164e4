"""Compiling kernels before they are needed, by doing small jobs of each kind.

Numba compiles a kernel when it is first called and keeps the result on disk. It compiles one at a
time; a second process compiles at the same time into the same place.

Guarantee: what is compiled twice, or at the same time, stays right. Non-guarantee: that nothing is
left to compile; rare options have kernels of their own.
"""

import os
import subprocess
import sys
import tempfile
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import wraps
from pathlib import Path
from typing import Any

import numpy as np

import ilattice as il
from ilattice._progress import Progress, track
from ilattice._validate import read_only
from ilattice.errors import PrecisionWarning
from ilattice.mesh.contouring import split_quads
from ilattice.mesh.measure import self_intersections
from ilattice.mesh.repair import remove_slivers


def warmup(progress: Progress = None) -> None:
    """Compile what walls, meshes, slices and analysis need.

    Parameters
    ----------
    progress : bool or callable, optional
        See `ilattice._progress.track`.
    """
    shapes = il.macroshape
    box = shapes.box()
    quadratic = il.SplineMap(box.spline.elevate(0).elevate(1).elevate(2))
    torus = shapes.torus(major=0.8, width=0.6)
    volumes = [box, quadratic, torus, shapes.cylinder_shell(0.2, 0.8, 0.6)]
    with aside("analysis"):
        for through in track(volumes, "compile", progress):
            walls(through)
        solids()
        structures()
        words()


def _quietly(work: Callable[..., None]) -> Callable[..., None]:
    """Work on examples that are coarse on purpose, without warnings about it."""

    @wraps(work)
    def quiet(*arguments: Any) -> None:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", PrecisionWarning)
            work(*arguments)

    return quiet


@contextmanager
def aside(job: str) -> Iterator[None]:
    """Compile in a process beside this one while the block runs, and wait for it at the end.

    Parameters
    ----------
    job : {"meshes", "analysis"}
        Name of a function of this module.
    """
    environment = {**os.environ, "NUMBA_NUM_THREADS": "1", "PYTHONPATH": os.pathsep.join(sys.path)}
    command = [sys.executable, "-c", f"from ilattice import _warmup; _warmup.{job}()"]
    silent = subprocess.DEVNULL
    with subprocess.Popen(command, stdout=silent, stderr=silent, env=environment) as other:
        try:
            yield
        except BaseException:
            other.kill()
            raise


@_quietly
def walls(through: "il.SplineMap") -> None:
    """Walls of constant and of varying thickness: meshed, measured, sliced, written.

    Parameters
    ----------
    through : SplineMap
        A small volume.
    """
    for order in (0, 1, 2):  # arrays of meshes cannot be written to, which kernels can tell
        through.spline.jet(read_only(np.full((1, 3), 0.5)), order)
    lattice = il.Lattice(il.tiles.get("gyroid"), through=through, repeat=(3, 1, 1))
    with tempfile.TemporaryDirectory() as folder:
        for d in (0.05, il.fields.equation("0.05 + 0.001*x")):
            wall = lattice.offset(d)
            mesh = wall.mesh(0.05, allow_loss=True)
            wall.thickness_error(mesh)
            wall.volume()
            list(wall.slices(thickness=0.25, h=0.05))
            for ending in ("stl", "vtp"):
                mesh.save(Path(folder) / f"mesh.{ending}")


@_quietly
def solids() -> None:
    """Solids of tiles of all kinds, also through a map of degree 4, and offsets before the map."""
    box = il.macroshape.box()
    own = il.Tile(lambda u: np.cos(2.0 * np.pi * u).sum(axis=1))
    bar = il.tiles.skeleton([[(0, 0.5, 0.5), (1, 0.5, 0.5)]], radius=0.1)
    for tile in (il.tiles.get("gyroid"), il.tiles.octet(radius=0.05), bar, own):
        il.Lattice(tile, through=box).offset((np.inf, 0.05)).mesh(0.2, allow_loss=True)
    torus = il.macroshape.torus(major=0.8, width=0.6)
    il.Lattice(il.tiles.get("gyroid"), through=torus).offset(0.1, space="parametric").mesh(
        0.1, allow_loss=True
    )
    il.tiles.get("gyroid").jet(np.random.default_rng(0).random((5000, 3)), 2)  # in parallel
    quartic = il.SplineMap(box.spline.elevate(0, 3).elevate(1, 3).elevate(2, 3))
    for through in (box, quartic):
        il.Lattice(il.tiles.get("gyroid"), through=through).offset(0.1, space="parametric").mesh(
            0.2, allow_loss=True
        )
    il.Lattice(il.tiles.get("gyroid"), through=quartic).offset(0.1).mesh(0.2, allow_loss=True)
    lattice = il.Lattice(il.tiles.get("gyroid"), through=box)
    lattice.offset(0.005).mesh(0.2, allow_loss=True)  # a sheet: the wall is thinner than the grid
    wall = lattice.offset(relative_density=0.3, least_gap=0.01)
    wall.minimum_gap()
    wall.minimum_thickness()
    mixed = il.tiles.mix("gyroid", "diamond", seed=1)
    il.Lattice(mixed, through=box, repeat=(2, 1, 1)).offset(0.1).mesh(0.2, allow_loss=True)


def structures() -> None:
    """Corner-sharing structures, in the plane and in space: forces, flips, beams."""
    for dim in (2, 3):
        k = il.cost.kagome(3, dim=dim).stiffened()
        k.stress(np.zeros_like(k.positions))
        il.cost.flips.randomised(k, 10)
        il.cost.counting.pebble_rank(len(k.positions), k.edges)
        solid = k.beams(0.02)
        solid.jet(k.beams(0.01).vertices, 2)
    solid.slices([0.5], h=0.02)[0]


def words() -> None:
    """Solids that are described by words, also from the file of a mesh: meshed and measured."""
    commands = [
        ["box", "gyroid", "shell", "0.6"],
        ["box", "scale", "2", "sphere", "scale", "2.5", "p-surface", "gyroid"],
        ["box", "gyroid", "diamond", "mix", "1/(1+exp(-10*x))", "shell", "0.4+0.2*x"],
        ["box", "gyroid", "dilate", "0.2"],
    ]
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "part.stl"
        il.sdf.mesh(il.fields.sphere(1.0), 0.2).save(path)
        commands.append([str(path), "gyroid", "scale", "2", "distance", "shell", "0.4"])
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", PrecisionWarning)  # these meshes are for nobody
            for command in commands:
                found = il.sdf.mesh(il.sdf.parse(command), 0.2, allow_loss=True)
                found.measures()
                for ending in ("ply", "stl"):
                    found.save(path.with_suffix(f".{ending}"))


def meshes() -> None:
    """A sheet between two level sets of a spline: meshed, measured, repaired, written."""
    plane = _plane()
    mesh = il.mesh.contour(plane, [np.linspace(0.0, 1.0, 12)] * 3, level=(-0.2, 0.2))
    mesh.measures()
    _ = mesh.self_intersections
    # whole numbers as NumPy has them, those of meshes that others make
    _ = il.SurfaceMesh(mesh.vertices, np.array(mesh.faces, np.int64)).volume
    # as if everything were wrong with it: good meshes need no repair
    vertices, faces = np.array(mesh.vertices), np.array(mesh.faces)
    remove_slivers(vertices, faces, quality=1.0)
    plane.range([[0.0] * 3], [[1.0] * 3])
    split_quads(vertices, faces)
    self_intersections(vertices, faces, np.arange(len(faces)) == 0)
    with tempfile.TemporaryDirectory() as folder:
        mesh.save(Path(folder) / "sheet.stl")


@_quietly
def analysis() -> None:
    """A plate under its weight, large enough for two levels of multigrid, and a bent wall."""
    meshes()
    ball = il.mesh.contour(il.fields.sphere(1.0), [np.linspace(-1.1, 1.1, 8)] * 3)
    il.sdf.MeshDistance(ball)([[0.5, 0.5, 0.5]])
    middle = _plane()
    sides = [il.BSpline(middle.t, sign * middle.c - 0.2, 2) for sign in (1.0, -1.0)]
    for degree in (1, 2):
        problem = il.cutfem.Elasticity(
            (sides[0], sides[1]), (24, 10, 10), degree=degree, through=il.macroshape.box()
        ).clamp("u=0")
        problem.load(gravity=(0.0, 0.0, -1.0)).solve(method="multigrid").von_mises([[0.5] * 3])
    plate = il.cutfem.Heat((sides[0], sides[1]), (24, 10, 10)).fix("u=0", 0.0)
    plate.source(1.0).solve(method="multigrid")
    il.cutfem.Elasticity((sides[0], sides[1]), 4, young=(1.0, 2.0), phases="u - 0.4").clamp(
        "u=0"
    ).load(traction=(0.0, 0.0, 1.0), on="u=1").solve()
    torus = il.macroshape.torus(major=4.0, width=2.0)
    wall = il.Lattice(il.tiles.get("schwarz_p"), through=torus, repeat=(4, 1, 1)).offset(0.3)
    il.cutfem.mass_properties(wall, (8, 4, 4))
    il.cutfem.mass_properties(il.sdf.parse("box gyroid shell 0.6"), 4)
    heavy = il.cutfem.Elasticity(wall, (16, 4, 4)).clamp("w=0").load(gravity=(0.0, 0.0, -1.0))
    solution = heavy.solve()
    solution.recovered()
    solution.error_estimate()
    modes = il.cutfem.natural_modes(heavy, 2)
    il.cutfem.buckling(solution, 1)
    heat = il.cutfem.Heat(wall, (16, 4, 4), conductivity=1.0).fix("w=0", 0.0).source(1.0)
    warm = il.cutfem.Elasticity(wall, (16, 4, 4), expansion=1e-3).clamp("w=0")
    warm.load(temperature=heat.solve()).solve()
    two = il.cutfem.Elasticity(wall, (16, 4, 4), young=(1.0, 2.0), phases="x - 0.3").clamp("w=0")
    two.load(gravity=(0.0, 0.0, -1.0)).solve()
    cells()
    with tempfile.TemporaryDirectory() as folder:
        solution.save(Path(folder) / "surface.vtu")
        solution.save(Path(folder) / "solid.vtu", on="solid")
        modes.save(Path(folder) / "modes.pvd")
        heat.solve().save(Path(folder) / "heat.vtu")
        heat.evolve(1.0, steps=2).save(Path(folder) / "cooling.pvd")


def cells() -> None:
    """Cells that repeat, on cut cells and as voxels."""
    cell = il.Lattice(il.tiles.get("gyroid"), through=il.macroshape.cell()).offset(0.1)
    il.homogenize.elastic(cell, 8, method="multigrid")
    il.homogenize.conductive(cell, 8, method="multigrid")
    il.homogenize.bloch(cell, 4, path="GX", count=2, steps=1)
    labels = np.arange(64).reshape(4, 4, 4) % 3
    il.homogenize.voxels(labels, young=(0.0, 1.0, 2.0))
    il.homogenize.conductive_voxels(labels, conductivity=(0.0, 1.0, 2.0))


def _plane() -> "il.BSpline":
    """Height over the plane w = 1/2 as a quadratic spline."""
    knots = np.array([0, 0, *range(7), 6, 6]) / 6.0
    height = np.convolve(knots[1:-1], (0.5, 0.5), "valid") - 0.5
    return il.BSpline([knots] * 3, np.broadcast_to(height, (8, 8, 8)), 2)
