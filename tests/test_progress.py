"""The progress helper passes items through and stays silent off a terminal."""

import sys

import pytest

from ilattice._progress import track


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
