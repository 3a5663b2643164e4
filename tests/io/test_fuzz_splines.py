"""Damaged files: a reader either refuses with `FormatError`, or returns splines that work."""

import io
import random
import re
import time
import tracemalloc
import zipfile
from pathlib import Path

import numpy as np
import pytest
from spline_zoo import ZOO
from wounds import mutated

from ilattice.errors import FormatError
from ilattice.io import splines
from ilattice.macroshape import SplineMap

DATA = Path(__file__).parents[1] / "data"
COUNT = 1200
MFEM = "MFEM NURBS mesh v1.0\n"


def seeds(ending, tmp_path):
    """Small good files of one format."""
    out = []
    for kind in ("trilinear", "closed rational", "rational material", "repeated knots"):
        spline, names = ZOO[kind]
        path = tmp_path / f"seed{ending}"
        splines.save(SplineMap(spline, names=names), path)
        out.append(path.read_bytes())
    if ending == ".xml":
        out += [(DATA / "gismo" / f).read_bytes() for f in ("cylinder.xml", "fichera.xml")]
    if ending == ".mesh":
        names = (
            "cube-nurbs.mesh",
            "pipe-nurbs.mesh",
            "two-cubes-nurbs.mesh",
            "beam-hex-nurbs.mesh",
        )
        out += [(DATA / "mfem" / f).read_bytes() for f in names]
    if ending == ".itd":
        out.append((DATA / "irit" / "volumes.itd").read_bytes())
    return out


def mutated_archive(data: bytes, rng: random.Random) -> bytes:
    """The archive wounded, or whole with a wound in one of its members."""
    if rng.random() < 0.3:
        return mutated(data, rng)
    out = io.BytesIO()
    with zipfile.ZipFile(io.BytesIO(data)) as old, zipfile.ZipFile(out, "w") as new:
        names = old.namelist()
        chosen = rng.choice(names)
        for name in names:
            content = old.read(name)
            new.writestr(name, mutated(content, rng) if name == chosen else content)
    return out.getvalue()


def attempt(path):
    """Patches of the file, or the `FormatError`; any other error is passed on."""
    try:
        return splines.list_patches(path)
    except FormatError as e:
        return e


def works(patch):
    middle = patch.spline.domain.mean(axis=0)[None]
    return np.isfinite(patch.spline(middle)).all()


@pytest.mark.parametrize("ending", splines.FORMATS)
def test_damaged_files(tmp_path, ending):
    rng = random.Random(f"ilattice {ending}")
    good = seeds(ending, tmp_path)
    wound = mutated_archive if ending == ".npz" else mutated
    path = tmp_path / f"a{ending}"
    refused = slowest = 0.0
    for _ in range(COUNT):
        path.write_bytes(wound(rng.choice(good), rng))
        start = time.process_time()
        outcome = attempt(path)
        slowest = max(slowest, time.process_time() - start)
        if isinstance(outcome, FormatError):
            assert path.name in str(outcome)
            refused += 1
        else:
            assert all(map(works, outcome[:2]))
    assert slowest < 2.0
    assert COUNT / 3 < refused < COUNT  # mostly real damage, but not every wound is one


@pytest.mark.parametrize("ending", [".xml", ".mesh", ".itd"])
def test_claims_take_no_memory(tmp_path, ending):
    path = tmp_path / f"a{ending}"
    splines.save(ZOO["trilinear"][0], path)
    text = path.read_text()
    numbers = list(re.finditer(r"(?<![\w.])\d+(?![\w.])", text))
    tracemalloc.start()
    for claim in ("1000000000000", "999999999", "2000000"):
        for m in numbers:
            path.write_text(text[: m.start()] + claim + text[m.end() :])
            attempt(path)
    assert tracemalloc.get_traced_memory()[1] < 4e6
    tracemalloc.stop()


@pytest.mark.parametrize(
    ("ending", "text"),
    [
        (".itd", '"' + '\\"' * 100_000),
        (".itd", "[" * 200_000),
        (".itd", "[OBJECT " * 50_000),
        (".itd", "[OBJECT]" * 50_000),
        (".itd", '"\\' * 100_000),
        (".xml", "<!--" * 100_000),
        (".xml", "<xml>" + "<a>" * 100_000),
        (".xml", "<xml " + "a='1' " * 50_000 + ">"),
        (".xml", "<xml>" + "<MultiPatch><patches type='id_range'>0 1</patches></MultiPatch>" * 999),
        (".mesh", MFEM + "#\n" * 200_000),
        (".mesh", f"{MFEM}dimension 3 elements 1000000 " + "1 5 0 1 2 3 4 5 6 7 " * 20_000),
        (".json", "[" * 200_000),
        (".json", '{"a":' * 100_000),
    ],
)  # fmt: skip
def test_long_nonsense_ends_soon(tmp_path, ending, text):
    path = tmp_path / f"a{ending}"
    path.write_text(text)
    start = time.process_time()
    attempt(path)
    assert time.process_time() - start < 3.0
