"""The gallery shows every example, with its pictures and its numbers."""

import importlib.util
import sys
from pathlib import Path

import pytest
from PIL import Image

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


def test_an_example_that_fails_is_named_and_the_others_run(gallery, tmp_path, monkeypatch, capsys):
    (tmp_path / "a_broken.py").write_text('"""Broken."""\nprint(7)\nraise ValueError("no <b>")\n')
    (tmp_path / "b_silent.py").write_text('"""Silent."""\nraise SystemExit(3)\n')
    (tmp_path / "c_whole.py").write_text('"""Whole."""\nopen("c.png", "w").close()\n')
    monkeypatch.setattr(gallery, "EXAMPLES", tmp_path)
    assert gallery.main([str(tmp_path / "out")]) == 1
    page = (tmp_path / "out" / "index.html").read_text(encoding="utf-8")
    assert "<pre>7</pre>" in page
    assert "ValueError: no &lt;b&gt;</pre>" in page
    assert "exit code 3" in page
    assert "<img src='c_whole/c.png'" in page
    assert page.count("class='failed'") == 2
    assert "a_broken failed" in capsys.readouterr().err
    assert gallery.main([str(tmp_path / "out"), "c_whole"]) == 0


def test_examples_are_in_groups_with_contents(gallery):
    groups = gallery.grouped(map(gallery.described, gallery.names()))
    assert list(groups) == [gallery.FIGURES, gallery.OTHERS, gallery.RECIPES]
    assert all(e.name.startswith("fig") for e in groups[gallery.FIGURES])
    assert "hierarchical" in [e.name for e in groups[gallery.OTHERS]]
    page = gallery.page(map(gallery.described, gallery.names()))
    for group in groups.values():
        for e in group:
            assert page.count(f"<li><a href='#{e.name}'>") == 1


def test_the_page_of_the_documentation_leads_to_every_example(gallery):
    text = gallery.markdown()
    for name in gallery.names():
        assert f"](examples/{name}.md)" in text
        page = gallery.example(name)
        assert page.startswith(f"# {gallery.described(name).title.rstrip('.')}\n")
        assert f"literalinclude}} ../../../examples/{name}.py" in page


def test_thumbnails_are_small_and_of_examples(gallery):
    files = list(gallery.THUMBNAILS.glob("*.jpg"))
    assert sum(f.stat().st_size for f in files) <= 1_000_000
    shown = [f for f in files if f.stem in gallery.names()]
    assert len(shown) > 15
    for f in shown:
        assert f.stat().st_size <= 25_000
        with Image.open(f) as picture:
            assert picture.width <= 480
