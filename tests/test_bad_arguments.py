"""Every public callable with arguments that make no sense: our errors, soon, and little memory.

Soon means few calls of Python functions, which are the same on every machine; compiling, which only
the first run does, is not counted.
"""

import importlib
import inspect
import os
import random
import sys
import tracemalloc
import warnings
from enum import Enum

import numpy as np
import pytest
from numba.core import event

import ilattice as il
from ilattice.errors import IlatticeError

ROUNDS = int(os.environ.get("ILATTICE_ROUNDS", "2"))
ROOMS = (
    "bspline", "tiles", "macroshape", "fields", "sdf", "mesh", "offsets", "cutfem", "io",
)  # fmt: skip
SKIPPED = {"save_grid"}
MOST_CALLS = 400_000  # of functions, within less than two seconds
MOST_MEMORY = 500e6
NAN, INF = float("nan"), float("inf")
ODD = [
    NAN, INF, -INF, 0, -1, 1e-320, 1e300, -1e-300, 2**70, 10**400, True, None, "", "x", "nan", b"1",
    1j, (), [], {}, {1: 2}, set(), object(), lambda *_: None, lambda *u: u[0],
    lambda *u: np.full(len(u[0]), np.nan), lambda *_: "text", range(3), np.zeros(0),
    np.zeros((0, 3)),
    np.zeros((2, 2)), np.full((3, 3), np.nan), np.array([1 + 1j]), np.array("a"), np.ones(3, bool),
    np.ma.masked_all((2, 3)), [[1, 2], [3]], [[np.inf, 0, 0]], [NAN] * 3, (1, 2), [None] * 3,
    np.float32(1), np.datetime64("2020-01-01"), "a" * 5000, "\0", [[1e300] * 3] * 2, (0, 0),
    np.zeros((3, 3, 3, 3)), [1e18, 1, 1], 10**9, 1e-12, "/dev/zero", "gyroid", "../nothing.stl",
]  # fmt: skip


def good():
    """Arguments that make sense, by the name of the parameter."""
    box = il.macroshape.box()
    lattice = il.Lattice("gyroid", through=box, repeat=1)
    wall = lattice.offset(0.1)
    ball = il.fields.sphere(1.0)
    mesh = il.sdf.mesh(ball, 0.5)
    axes = [np.linspace(-1.2, 1.2, 7)] * 3
    return {
        "lattice": lattice, "wall": wall, "mesh": mesh, "field": ball, "f": ball, "g": ball,
        "part": ball, "a": ball, "b": ball, "solid": ball, "spline": box.spline, "through": box,
        "space": box, "axes": axes, "d": 0.1, "h": 0.4, "tile": "gyroid", "repeat": 1, "k": 1,
        "t": [[0, 0, 1, 1]], "c": [0.0, 1.0], "cells": 4, "u": [[0.2, 0.3, 0.4]], "tol": 0.1,
        "x": [[0.2, 0.3, 0.4]], "points": [[0.2, 0.3, 0.4]], "radius": 0.2, "name": "gyroid",
        "thickness": 0.3, "text": "x + y", "vertices": mesh.vertices, "faces": mesh.faces,
        "command": "sphere", "spacing": 0.4, "path": "nowhere/a.stl", "degree": 2, "axis": 0,
    }  # fmt: skip


def targets():
    found = {}
    for room in ("", *ROOMS):
        module = importlib.import_module(f"ilattice.{room}".rstrip("."))
        for name in getattr(module, "__all__", ()):
            thing = getattr(module, name)
            if callable(thing) and name not in SKIPPED and not is_error(thing):
                found[f"{room}.{name}"] = thing
    return found


def is_error(thing):
    return isinstance(thing, type) and issubclass(thing, (Exception, Warning, Enum))


TARGETS = targets()


def arguments(thing, sense, rng):
    """A call with one or all arguments odd."""
    try:
        parameters = list(inspect.signature(thing).parameters.values())
    except (TypeError, ValueError):
        parameters = []
    all_odd = rng.random() < 0.2
    wanted = [p for p in parameters if p.kind not in (p.VAR_KEYWORD, p.VAR_POSITIONAL)]
    chosen = rng.choice(wanted).name if wanted else ""
    positional, named = [], {}
    for p in parameters:
        odd = all_odd or p.name == chosen
        if not odd and p.name not in sense and p.default is not p.empty:
            continue
        value = rng.choice(ODD) if odd else sense.get(p.name, rng.choice(ODD))
        if p.kind is p.VAR_POSITIONAL:
            positional += [rng.choice(ODD) for _ in range(rng.randrange(3))]
        elif p.kind is p.POSITIONAL_ONLY:
            positional.append(value)
        elif p.kind is not p.VAR_KEYWORD:
            named[p.name] = value
    return positional, named


class Calls(event.Listener):
    """Counts calls of functions in a block, but for those of the compiler."""

    def __enter__(self):
        self.count = self.depth = 0
        event.register("numba:compile", self)
        sys.setprofile(self.note)
        return self

    def __exit__(self, *_):
        sys.setprofile(None)
        event.unregister("numba:compile", self)

    def note(self, _frame, what, _arg):
        self.count += what in ("call", "c_call")

    def on_start(self, _):
        self.depth += 1
        sys.setprofile(None)

    def on_end(self, _):
        self.depth -= 1
        if not self.depth:
            sys.setprofile(self.note)


def call(thing, positional, named):
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        try:
            thing(*positional, **named)
        except IlatticeError as e:
            return str(e)
    return ""


@pytest.fixture(scope="module")
def sense():
    return good()


@pytest.mark.parametrize("room", ["", *ROOMS])
def test_public_callables_refuse_what_makes_no_sense(room, sense, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    rng = random.Random(f"odd {room}")
    wrong = []
    for name, thing in TARGETS.items():
        if name.split(".")[0] != room:
            continue
        for _ in range(ROUNDS):
            positional, named = arguments(thing, sense, rng)
            told = f"{name}(*{positional!r:.200}, **{named!r:.300})"
            tracemalloc.start()
            try:
                with Calls() as calls:
                    message = call(thing, positional, named)
                if "\n" in message or len(message) > 1100:
                    wrong.append(f"{told}: {message.count(chr(10))} breaks, {len(message)} letters")
            except Exception as e:  # every other error is one to mend
                wrong.append(f"{told}: {type(e).__name__}: {e!s:.200}")
            peak = tracemalloc.get_traced_memory()[1]
            tracemalloc.stop()
            if peak > MOST_MEMORY:
                wrong.append(f"{told}: {peak / 1e6:.0f} MB")
            if calls.count > MOST_CALLS:
                wrong.append(f"{told}: {calls.count} calls")
    assert not wrong, "\n" + "\n".join(wrong)
