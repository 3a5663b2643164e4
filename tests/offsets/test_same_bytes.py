"""The same bytes in new processes, whatever the number of threads and the seed of hashes."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

PROGRAM = """
import hashlib, sys, warnings
import numpy as np
import ilattice as il

warnings.simplefilter("ignore")
lattice = il.Lattice("gyroid", through=il.macroshape.tapered())
wall = lattice.offset((0.0, 0.083))
mesh = wall.mesh(0.041)
cuts = wall.slices([0.23, 0.61], h=0.053)
slices = [loop for s in cuts for outer, holes in s.polygons for loop in (outer, *holes)]
solid = il.sdf.mesh(il.sdf.parse("box gyroid dilate 0.2"), 0.13)
how = {"table": sys.argv[1], "cells": 4, "options": {"estimate": False}}
il.homogenize.sweep(["gyroid", "iwp"], relative_density=[0.7, 0.9], **how)
print(hashlib.sha256(open(sys.argv[1], "rb").read()).hexdigest())
arrays = [mesh.vertices, mesh.faces, *slices, solid.vertices, solid.faces]
arrays += [mesh.point_data[name] for name in sorted(mesh.point_data)]
for a in arrays:
    print(a.shape, hashlib.sha256(np.ascontiguousarray(a).tobytes()).hexdigest())
"""


def bytes_of(threads, seed, table):
    """Sizes and hashes of a mesh, slices, the mesh of a field, and the table of a sweep."""
    new = {"NUMBA_NUM_THREADS": str(threads), "PYTHONHASHSEED": str(seed)}
    path = os.pathsep.join([str(Path(__file__).parents[2]), os.environ.get("PYTHONPATH", "")])
    done = subprocess.run(
        [sys.executable, "-c", PROGRAM, str(table)], env={**os.environ, **new, "PYTHONPATH": path},
        capture_output=True, text=True, timeout=300, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr[-2000:]
    return done.stdout


@pytest.mark.threads
def test_bytes_do_not_depend_on_threads_or_hash_seeds(tmp_path):
    first = bytes_of(1, 1, tmp_path / "first.csv")
    assert len(first.splitlines()) > 10
    assert bytes_of(2, 2, tmp_path / "second.csv") == first
