"""The progress helper passes items through and stays silent off a terminal."""

import sys

import numpy as np
import pytest

import ilattice as il
from ilattice._progress import staged, track
from ilattice.errors import InputError


@pytest.mark.parametrize("progress", [None, False, True, lambda *_: None])
def test_items_pass_through_silently(progress, capfd):
    assert list(track(iter("abc"), "letters", progress)) == ["a", "b", "c"]
    assert capfd.readouterr() == ("", "")


def test_a_callable_is_told():
    seen = []
    for item in track([7, 8], "numbers", lambda *a: seen.append(a)):
        seen.append(item)
    assert seen == [7, ("numbers", 1, 2), 8, ("numbers", 2, 2)]


def test_total_can_be_given_and_may_be_unknown():
    seen = []
    list(track(iter("ab"), "x", lambda *a: seen.append(a), total=5))
    list(track(iter("c"), "y", lambda *a: seen.append(a)))
    assert seen == [("x", 1, 5), ("x", 2, 5), ("y", 1, 0)]


def test_a_terminal_gets_a_bar(monkeypatch, capsys):
    monkeypatch.setattr(sys.stderr, "isatty", lambda: True)
    assert list(track(range(3), "walls", True)) == [0, 1, 2]
    out, err = capsys.readouterr()
    assert out == ""
    assert "walls" in err
    assert "100%" in err


def test_stages_are_told_by_name_in_order():
    seen = []
    work = {"cells": lambda: seen.append("a"), "rules": lambda: seen.append("b")}
    staged(work, lambda *told: seen.append(told))
    assert seen == ["a", ("cells", 1, 1), "b", ("rules", 1, 1)]
    staged(work)
    assert seen[-2:] == ["a", "b"]
    assert staged({"one": lambda: 1, "two": lambda: 2}) == [1, 2]


@pytest.mark.filterwarnings("ignore:the cells are too coarse")
def test_an_analysis_tells_its_stages():
    labels = []

    def told(label, *_):
        if label not in labels:
            labels.append(label)

    ball = il.fields.sphere(1.0)
    problem = il.cutfem.Elasticity(ball, 6, domain=[[-1.1, -1.2, -0.4], [1.1, 1.1, 1.3]], young=1.0)
    solution = problem.clamp("w=0").load(gravity=(0, 0, -1e-3)).solve(progress=told)
    assert labels == ["cells", "rules", "supports", "matrix", "solve"]
    labels.clear()
    assert solution.recovered(progress=told).recovered(progress=told) is not solution
    assert labels == ["stress", "masses", "projection"]
    labels.clear()
    solution.error_estimate(progress=told)
    assert labels == ["stress", "masses", "projection"]
    labels.clear()
    around = [[-1.1, -1.2, -0.4], [1.1, 1.1, 1.3]]
    warm = il.cutfem.Heat(ball, 6, domain=around, conductivity=1.0)
    warm.fix("w=0", 0.0).source(1.0).solve().recovered(progress=told)
    assert labels == ["heat flux", "masses", "projection"]
    with pytest.raises(InputError, match="support"):  # before anything is made
        problem.solve(progress=lambda label, *_: pytest.fail(label))
    labels.clear()
    hole = il.fields.complement(il.fields.translate(il.fields.sphere(0.3), (0.5, 0.5, 0.5)))
    il.homogenize.elastic(hole, cells=4, degree=1, estimate=False, progress=told)
    assert labels[:3] == ["cells", "rules", "matrix"]
    assert labels[-1] == "solve"
    labels.clear()
    il.cutfem.natural_modes(problem, 7, progress=told)
    assert labels == ["cells", "rules", "matrix", "factor", "modes"]


@pytest.mark.filterwarnings("ignore::ilattice.errors.PrecisionWarning")
def test_other_long_work_tells_its_stages():
    ball, box = il.fields.sphere(1.0), [[-1.1] * 3, [1.1] * 3]
    bar = il.macroshape.box((2.0, 1.0, 1.0))
    wall = il.Lattice("schwarz_p", through=bar, repeat=(2, 1, 1), spans_per_tile=6).offset(0.12)
    corners = [(0, 0, 0), (1, 0, 0), (1, 1, 0.3), (0, 1, 0)]
    rigid = il.cost.kagome(3).stiffened()
    load, low = np.ones_like(rigid.positions), rigid.positions[:, 2] < 0.3
    work = {
        ("cells", "rules"): [
            lambda told: il.cutfem.quadrature(ball, 6, domain=box, progress=told),
            lambda told: il.mesh.hexahedra(ball, 6, domain=box, progress=told),
        ],
        ("cells", "rules", "surface"): [
            lambda told: il.cutfem.mass_properties(ball, 6, domain=box, progress=told),
        ],
        ("lengths of sides",): [
            lambda told: il.minimal.conjugate(
                il.minimal.cuboid().faces("x+ z- y+ x- z+ y-"), n=4, progress=told
            ),
        ],
        ("surface", "shell", "conjugate"): [
            lambda told: il.minimal.direct(corners, n=4, alpha=0.01, progress=told),
        ],
        ("tiles",): [
            lambda told: il.homogenize.macro(wall, (2, 1, 1), tile_cells=4, estimate=False,
                                             progress=told),
        ],
        ("start", "surface"): [
            lambda told: il.shells.cell("topo_19_rrr", n=8, progress=told),
        ],
        ("fracture",): [
            lambda told: il.cost.fracture.fracture(
                rigid, load, supports=low, steps=1, progress=told
            ),
        ],
        ("flips",): [
            lambda told: il.cost.flips.randomised(il.cost.kagome(5), 1, progress=told),
        ],
    }  # fmt: skip
    for labels, calls in work.items():
        for call in calls:
            seen = []

            def told(label, *_, seen=seen):
                seen.append(label)

            call(told)
            assert tuple(seen) == labels
            with pytest.raises(InputError, match="progress"):
                call(3)


@pytest.mark.filterwarnings("ignore::ilattice.errors.PrecisionWarning")
@pytest.mark.parametrize("density", [0.3, [[[0.3]], [[0.28]]]])
def test_mixtures_and_densities_tell_their_stages(density):
    seen = []
    both = il.tiles.mix("schwarz_p", "gyroid", cells=np.arange(2).reshape(2, 1, 1))
    bar = il.macroshape.box((2.0, 1.0, 1.0))
    il.Lattice(both, through=bar, repeat=(2, 1, 1), spans_per_tile=6).offset(
        relative_density=density, progress=lambda label, *_: seen.append(label)
    )
    stages = ["tiles", "distance", *["densities"][: np.ndim(density)], "density"]
    assert list(dict.fromkeys(seen)) == stages
