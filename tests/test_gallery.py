"""The gallery shows every example, with its pictures and its numbers."""

import importlib.util
import sys
from pathlib import Path

import pytest

SOURCE = Path(__file__).parents[1] / "docs" / "build_gallery.py"


@pytest.fixture(scope="module")
def gallery():
    spec = importlib.util.spec_from_file_location("build_gallery", SOURCE)
    module = importlib.util.module_from_spec(spec)
    sys.modules["build_gallery"] = module
    spec.loader.exec_module(module)
    yield module
    del sys.modules["build_gallery"]


def test_every_example_is_on_the_page(gallery):
    files = sorted(p.stem for p in (SOURCE.parents[1] / "examples").glob("*.py"))
    assert gallery.names() == files
    page = gallery.page(map(gallery.described, files))
    for name in files:
        assert page.count(f"<h2 id='{name}'>") == 1
        assert f"python examples/{name}.py</code>" in page
    assert "<h2 id='fig13_tapered'>Figure 13 of Hong" in page


def test_pictures_and_numbers_of_a_run_are_shown(gallery, tmp_path, monkeypatch, capsys):
    (tmp_path / "examples").mkdir()
    (tmp_path / "examples" / "small.py").write_text(
        '"""A title.\n\nIt <shows> this.\n\n    python examples/small.py\n"""\n'
        "open('a.png', 'w').close()\nopen('a.stl', 'w').close()\nprint({'number': 1})\n"
    )
    monkeypatch.setattr(gallery, "EXAMPLES", tmp_path / "examples")
    gallery.main([str(tmp_path / "out")])
    page = (tmp_path / "out" / "index.html").read_text(encoding="utf-8")
    assert "<h2 id='small'>A title.</h2>\n<p>It &lt;shows&gt; this.</p>" in page
    assert "<img src='small/a.png'" in page
    assert "{&#x27;number&#x27;: 1}" in page
    assert (tmp_path / "out" / "small" / "a.png").exists()
    assert capsys.readouterr().out.startswith("small")


def test_an_example_that_fails_is_named(gallery, tmp_path, monkeypatch):
    (tmp_path / "broken.py").write_text('"""Broken."""\nraise ValueError("no")\n')
    monkeypatch.setattr(gallery, "EXAMPLES", tmp_path)
    with pytest.raises(RuntimeError, match="broken failed"):
        gallery.run("broken", tmp_path / "out")
