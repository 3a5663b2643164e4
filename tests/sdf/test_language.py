"""The command language: what words mean, every error, and that no words do harm."""

import random

import numpy as np
import pytest

import ilattice as il
from ilattice.errors import FormatError, IlatticeError, InputError
from ilattice.sdf._vocabulary import OPERATIONS, known_names
from ilattice.sdf.language import MAX_DEPTH, Command, parse

F = il.fields
P = np.random.default_rng(1).uniform(-1.5, 1.5, (200, 3))
BALL, CUBE = F.sphere(), F.box()


def tile(name):
    return F.from_callable(il.tiles[name])


@pytest.mark.parametrize(
    ("command", "field"),
    [
        ("sphere", BALL),
        ("Sphere BOX", F.intersection(BALL, CUBE)),
        ("sphere box union", F.union(BALL, CUBE)),
        ("sphere box difference", F.difference(BALL, CUBE)),
        ("box sphere cylinder union intersection",
         F.intersection(CUBE, F.union(BALL, F.cylinder()))),
        ("sphere complement", F.complement(BALL)),
        ("sphere dilate 0.5", F.dilate(BALL, 0.5)),
        ("sphere dilate offset 0.5", F.dilate(BALL, 0.5)),
        ("sphere erode 1/4", F.erode(BALL, 0.25)),
        ("sphere shell 2*0.35", F.shell(BALL, 0.7)),
        ("sphere shell '0.1+0.05*x'", F.shell(BALL, F.equation("0.1+0.05*x"))),
        ("sphere translate -1,0,2^-1", F.translate(BALL, (-1, 0, 0.5))),
        ("sphere translate max(1,2),0,0", F.translate(BALL, (2, 0, 0))),
        ("box scale 1,2,-3", F.scale(CUBE, (1, 2, -3))),
        ("box scale 2", F.scale(CUBE, 2.0)),
        ("box rotate pi/6 0,0,2", F.rotate(CUBE, np.pi / 6, (0, 0, 1))),
        ("box rotate axis 0,0,2 angle pi/6", F.rotate(CUBE, np.pi / 6, (0, 0, 1))),
        ("x+y+z-1 box", F.intersection(F.equation("x+y+z-1"), CUBE)),
        ("(-x) -- -y", F.intersection(F.equation("-x"), F.equation("-y"))),
        ("gyroid", tile("gyroid")),
        ("p-surface D_Surface intersection", F.intersection(tile("primitive"), tile("diamond"))),
        ("y", tile("y")),
        ("box sphere smooth-union 0.2", F.union(CUBE, BALL, radius=0.2)),
        ("box sphere mix x", F.mix(CUBE, BALL, F.equation("x"))),
        ("torus cone half-space capsule", F.intersection(
            F.torus(), F.cone(), F.half_space(), F.capsule((0, 0, -1), (0, 0, 1), 0.5))),
        ("gyroid twist 0.3 # and no more", F.twist(tile("gyroid"), 0.3)),
        ("sphere repeat 1,2,3", F.repeat(BALL, (1, 2, 3))),
    ],
)  # fmt: skip
def test_words_mean_what_the_functions_do(command, field):
    np.testing.assert_array_equal(parse(command)(P), field(P))


def test_operands_may_start_with_a_sign():
    np.testing.assert_array_equal(
        parse(["sphere", "translate", "-1,0,0"])(P), parse("sphere translate -1,0,0")(P)
    )


def test_differences_take_the_second_from_the_first():
    ball = parse("sphere sphere translate 1,0,0 difference")
    np.testing.assert_array_equal(ball([[-0.5, 0, 0], [0.5, 0, 0]]) < 0, [True, False])


def test_names_stand_for_numbers_and_words():
    f = parse("shape dilate t*2 'x - t'", shape="sphere", t=0.1)
    expected = F.intersection(F.dilate(BALL, 0.2), F.equation("x - 0.1"))
    np.testing.assert_allclose(f(P), expected(P), atol=1e-15)


def test_files_insert_words_and_files(tmp_path):
    (tmp_path / "inner").mkdir()
    (tmp_path / "a.txt").write_text("box   # a cube\n@inner/b.txt\n'x + y'\n")
    (tmp_path / "inner" / "b.txt").write_text("sphere @c.txt union")
    (tmp_path / "inner" / "c.txt").write_text("torus")
    f = parse(["@" + str(tmp_path / "a.txt")])
    np.testing.assert_array_equal(f(P), parse("box sphere torus union 'x + y'")(P))


def test_meshes_are_solids(tmp_path):
    mesh = il.mesh.contour(BALL, [np.linspace(-1.2, 1.2, 25)] * 3)
    path = tmp_path / "ball.STL"
    mesh.save(path)
    f = parse([str(path), "translate", "1,0,0"])
    np.testing.assert_allclose(f(P), F.translate(BALL, (1, 0, 0))(P), atol=0.02)
    np.testing.assert_allclose(f.bounds, [[0, -1, -1], [2, 1, 1]], atol=0.01)


@pytest.mark.parametrize(
    ("command", "message"),
    [
        ("", "nothing to mesh"),
        ("dilate 1", "word 1 'dilate': needs 1 solid before it, found 0"),
        ("box union", "word 2 'union': needs 2 solids before it, found 1"),
        ("box shell", "thickness, a number or an equation, must follow"),
        ("box rotate 1", "axis"),
        ("box rotate angle 1 angle 2", "axis must follow, got 'angle'"),
        ("box rotate angle 1 wheel 2", "axis must follow, got 'wheel'"),
        ("box translate 1,2", "word 2 'translate', offset at word 3 '1,2': must be three numbers"),
        ("box translate 1,2,x", "without x, y and z"),
        ("box scale 1,0,1", "zero"),
        ("box scale 1,2", "one number, or three"),
        ("box dilate -1", "at least 0"),
        ("box shell -0.1", "at least 0"),
        ("box dilate 1/0", "finite"),
        ("box rotate 1 0,0,0", "zero"),
        ("box cylindrical 1.5", "whole"),
        ("gyriod box", "word 1 'gyriod': unknown name; near names: gyroid"),
        ("box unionx", "union"),
        ("1+1 box", "constant equation"),
        ("box x+*y", "character 3"),
        ("box 'x $ y'", "'$' at character 3"),
        ("nofile.stl", "no file 'nofile.stl'"),
        ("box @nofile", "cannot read the file"),
        ("box 'x", "quotation"),
        ("box --foo", "unknown option"),
        ("-x box", "in parentheses"),
        ("box -s 1", "no options"),
        ("box " + "complement " * (MAX_DEPTH + 1), "nested"),
        ("box " * 100_001, "words"),
        (["box", 3], "sequence of words"),
    ],
)  # fmt: skip
def test_errors_name_the_word_and_its_place(command, message):
    with pytest.raises(InputError) as caught:
        parse(command)
    assert message in str(caught.value)


def test_files_in_circles_and_too_deep_are_refused(tmp_path):
    (tmp_path / "a").write_text("@b")
    (tmp_path / "b").write_text("@a")
    with pytest.raises(InputError, match="inserts itself"):
        parse([f"@{tmp_path / 'a'}"])
    for k in range(20):
        (tmp_path / f"d{k}").write_text(f"@d{k + 1}")
    with pytest.raises(InputError, match="16 files deep"):
        parse([f"@{tmp_path / 'd0'}"])


def test_broken_meshes_are_refused_by_strict_and_unreadable_ones_always(tmp_path):
    path = tmp_path / "a.off"
    il.SurfaceMesh(np.eye(3), [[0, 1, 2]]).save(path)
    with pytest.raises(IlatticeError, match="open"):
        parse([str(path)], strict=True)
    with pytest.warns(il.errors.PrecisionWarning, match="open"):
        parse([str(path)])
    path.write_text("OFF\n1 nonsense")
    with pytest.raises(FormatError):
        parse([str(path)])


@pytest.mark.parametrize("name", ["x", "sin", "pi", "union", "2a"])
def test_names_with_a_meaning_stand_for_nothing_else(name):
    with pytest.raises(InputError, match="meaning"):
        parse("box", **{name: 1.0})


def test_long_chains_of_unions_are_flat():
    f = parse("sphere " + "box union " * 2000)
    assert f.depth == 2
    np.testing.assert_array_equal(f(P), F.union(BALL, CUBE)(P))


def test_random_words_end_in_a_field_or_an_input_error():
    fuzz(random.Random(7), 3000)


def fuzz(rng, count):
    """Random commands: a field, or an `IlatticeError`."""
    words = [*known_names(), *OPERATIONS, "x+y", "x*", "(", ",", "1", "-1", "1,2,3", "0.1", "--"]
    words += ["-s", "-o", "--set", "@a", "a.stl", "'", "angle", "axis", "offset", "é", "pi", "#"]
    words += ["x-0.5", "0,0,1", "2", "box", "sphere", "union", "translate", "scale"] * 4
    accepted = evaluated = 0
    for _ in range(count):
        command = [rng.choice(words) for _ in range(rng.randrange(1, 9))]
        try:
            field = parse(command)
            if not field.program.leaves:  # distances take long
                assert field(P[:2]).shape == (2,)
                evaluated += 1
            assert field.bounds.shape == (2, 3)
            accepted += 1
        except IlatticeError:
            continue
    assert accepted > count / 100
    assert evaluated > accepted / 3


def test_the_field_is_a_tile_and_goes_through_a_macro_shape():
    tile_ = il.Tile(parse("gyroid"))
    torus = il.macroshape.torus(major=2.0, width=1.0)
    lattice = il.Lattice(tile_, through=torus, repeat=(8, 1, 1))
    same = il.Lattice("gyroid", through=torus, repeat=(8, 1, 1))
    u = np.random.default_rng(2).uniform(0, 1, (50, 3))
    np.testing.assert_allclose(lattice.distance(u), same.distance(u), atol=1e-3)


def test_a_command_tells_its_tree():
    lines = Command.read("box sphere dilate 0.1 union gyroid").tree()
    assert lines == ["intersection", "  union", "    box", "    dilate offset 0.1", "      sphere",
                     "  gyroid"]  # fmt: skip
