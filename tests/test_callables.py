"""What functions of the user raise, or return, says which argument they were."""

import copy
import pickle

import numpy as np
import pytest

import ilattice as il
from ilattice.bspline.fit import fit
from ilattice.errors import ConvergenceError, GeometryError, InputError

BOX = [[-1.0] * 3, [1.0] * 3]


class BrokenError(Exception):
    """Nobody's error but the user's."""


def fails(*_):
    raise BrokenError("line 7")


def asks_outside(u):
    """A mistake of the user that this package notices."""
    return il.macroshape.box().spline(np.asarray(u)[:, :3] + 3.0)[:, 0]


def ball(u):
    return (u**2).sum(axis=1) - 0.6


class Half:
    """A field of which one method fails."""

    def __init__(self, method):
        self.method = method

    def __call__(self, u):
        return ball(u)

    def jet(self, u, order=2):
        if self.method == "jet":
            fails()
        return (ball(u), 2.0 * u, np.tile(2.0 * np.eye(3), (len(u), 1, 1)))[: order + 1]

    def range(self, lo, _hi):
        if self.method == "range":
            fails()
        return np.tile([-np.inf, np.inf], (len(lo), 1))

    def grid(self, axes):
        if self.method == "grid":
            fails()
        return ball(np.stack(np.meshgrid(*axes, indexing="ij"), -1).reshape(-1, 3)).reshape(
            [len(x) for x in axes]
        )


def lattice(tile="gyroid"):
    return il.Lattice(tile, through=il.macroshape.box(), repeat=1)


def solid():
    return il.cutfem.Elasticity(ball, 4, domain=BOX, young=1.0)


def heat():
    return il.cutfem.Heat(ball, 4, domain=BOX).fix("surface", 0.0)


def strut(radius):
    return il.tiles.skeleton([il.tiles.Polyline([(0, 0.5, 0.5), (1, 0.5, 0.5)], radius=radius)])


def tile_with(**properties):
    return il.tiles.get("gyroid").with_properties(**properties)


DOORS = {  # the name that the message must hold, and a call that asks the function
    "d": lambda f: lattice().offset(f),
    "d[0]": lambda f: lattice().offset((f, 0.1)),
    "d[1]": lambda f: lattice().offset((0.1, f)),
    "relative_density": lambda f: lattice().offset(relative_density=f),
    "tile 'odd'": lambda f: il.Tile(f, name="odd"),
    "tile 'custom'": lambda f: lattice(f),
    "property 'p'": lambda f: lattice(tile_with(p=f)).property_at("p", [[0.1, 0.2, 0.3]]),
    "weight": lambda f: lattice(il.tiles.hybrid("gyroid", "cross", weight=f)).implicit([[0.1] * 3]),
    "cells": lambda f: lattice(il.tiles.mix("gyroid", "cross", cells=f)).implicit([[0.1] * 3]),
    "radius": strut,
    "extra": lambda f: il.macroshape.box().with_extra(extra=f),
    "field": lambda f: il.mesh.contour(f, [np.linspace(-1, 1, 9)] * 3),
    "scale": lambda f: il.mesh.contour(ball, [np.linspace(-1, 1, 9)] * 3, scale=f),
    "field ": lambda f: il.cutfem.quadrature(f, 4, domain=BOX),
    "field  ": lambda f: il.sdf.mesh(il.fields.from_callable(f, bounds=BOX), 0.4),
    "field   ": lambda f: fit(f, domain=BOX, degree=2, spans=4, tol=0.1),
    "f": lambda f: il.cutfem.quadrature(ball, 4, domain=BOX).integrate(f),
    "density": lambda f: il.cutfem.mass_properties(ball, 4, domain=BOX, density=f),
    "young": lambda f: il.cutfem.Elasticity(ball, 4, domain=BOX, young=f).clamp("surface").load(
        gravity=(0, 0, 1)).solve(),
    "value": lambda f: solid().clamp("surface", value=f).load(gravity=(0, 0, 1)).solve(),
    "stiffness": lambda f: solid().spring("surface", f).load(body=(0, 0, 1)).solve(),
    "traction": lambda f: solid().clamp("surface").load(traction=f, on="surface").solve(),
    "pressure": lambda f: solid().clamp("surface").load(pressure=f, on="surface").solve(),
    "body": lambda f: solid().clamp("surface").load(body=f).solve(),
    "source": lambda f: heat().source(f).solve(),
    "flux": lambda f: heat().flux("surface", f).solve(),
    "transfer": lambda f: heat().convection("surface", f, around=0.0).source(1.0).solve(),
    "conductivity": lambda f: il.cutfem.Heat(ball, 4, domain=BOX, conductivity=f).fix(
        "surface", 0.0).source(1.0).solve(),
    "initial": lambda f: heat().evolve(1.0, steps=1, initial=f),
    "build": lambda f: il.cutfem.refinement_study(f, [2, 4, 8], {"e": float}),
    "quantities['e']": lambda f: il.cutfem.refinement_study(
        lambda n: il.cutfem.Heat(ball, n, domain=BOX).fix("surface", 0.0).source(1.0).solve(),
        [4, 6, 9], {"e": f}),
}  # fmt: skip


@pytest.mark.filterwarnings("ignore::ilattice.errors.PrecisionWarning")
@pytest.mark.parametrize("door", DOORS)
def test_errors_of_functions_name_the_argument(door):
    with pytest.raises(InputError) as caught:
        DOORS[door](fails)
    told, cause = str(caught.value), caught.value.__cause__
    assert f"{door.strip()} raised BrokenError: line 7" in told.replace("the field of ", "")
    while not isinstance(cause, BrokenError):
        cause = cause.__cause__
    assert "\n" not in told


@pytest.mark.filterwarnings("ignore::ilattice.errors.PrecisionWarning")
@pytest.mark.parametrize(
    "door", ["d", "density", "value", "source", "field", "tile 'odd'", "extra"]
)
def test_our_errors_in_functions_name_the_argument_too(door):
    with pytest.raises(InputError) as caught:
        DOORS[door](asks_outside)
    assert f"{door}: " in str(caught.value)
    assert "outside the domain" in str(caught.value)


def test_errors_keep_their_kind():
    def hopeless(_):
        raise ConvergenceError("no")

    class MineError(GeometryError):
        def __init__(self, a, b):
            super().__init__(f"{a} {b}")

    def odd(_):
        raise MineError("two", "words")

    with pytest.raises(ConvergenceError, match="d: no"):
        lattice().offset(hopeless)
    with pytest.raises(GeometryError, match="d: two words"):
        lattice().offset(odd)


@pytest.mark.parametrize("method", ["jet", "range", "grid"])
def test_errors_of_methods_of_fields_name_the_field(method):
    field = Half(method)
    with pytest.raises(InputError, match=f"{method} of the field raised BrokenError: line 7"):
        il.mesh.contour(field, [np.linspace(-1, 1, 40)] * 3)
    tile = il.Tile(Half("no"), check=False)
    u = [[0.1, 0.2, 0.3]]
    asked = {"jet": (u, 1), "range": (u, u), "grid": ([[0.1, 0.2]] * 3,)}[method]
    getattr(tile, method)(*asked)
    tile = il.Tile(field, check=False)
    with pytest.raises(
        InputError, match=f"{method} of the field of tile 'custom' raised BrokenError"
    ):
        getattr(tile, method)(*asked)


def test_interrupts_pass():
    def interrupted(_):
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        lattice().offset(interrupted)


def test_tiles_keep_the_functions_that_they_were_given():
    tile = il.Tile(Half("jet"), check=False)
    for other in (copy.deepcopy(tile), pickle.loads(pickle.dumps(tile))):
        with pytest.raises(InputError, match="raised BrokenError"):
            other.jet([[0.1, 0.2, 0.3]])
    assert il.Tile(ball, level=0.1).field is ball


def test_quantities_are_numbers():
    def build(n):
        return il.cutfem.Heat(ball, n, domain=BOX).fix("surface", 0.0).source(1.0).solve()

    for value in ("text", None, [1.0, 2.0], 1j):
        with pytest.raises(InputError, match=r"quantities\['q'\]"):
            il.cutfem.refinement_study(build, [4, 6, 9], {"q": lambda _, v=value: v})
