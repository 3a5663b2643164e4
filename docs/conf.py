"""Settings of Sphinx: ``python -m sphinx -q -W -b html docs build/docs``.

Pages that follow from the package (reference, commands, formats, gallery) are written to
``docs/generated`` by `make_pages` first. Nothing is fetched from anywhere while building, and
nothing by the pages that are built.
"""

import re
import sys
from pathlib import Path
from typing import Any

HERE = Path(__file__).parent
sys.path.insert(0, str(HERE))

import make_pages  # noqa: E402
from docutils import nodes  # noqa: E402
from sphinx import addnodes  # noqa: E402

import ilattice  # noqa: E402

project = "ilattice"
author = copyright = "The ilattice developers"
version = release = ilattice.__version__

extensions = ["myst_parser", "sphinx.ext.autodoc", "sphinx.ext.autosummary", "numpydoc"]
exclude_patterns = ["generated/parts/*"]
language = "en"
default_role = "py:obj"
highlight_language = "text"
nitpicky = False

myst_enable_extensions = ["colon_fence", "deflist"]
myst_heading_anchors = 3

autodoc_typehints = "none"
autodoc_member_order = "bysource"
autosummary_generate = False
numpydoc_show_class_members = False
numpydoc_class_members_toctree = False
toc_object_entries_show_parents = "hide"

html_theme = "pydata_sphinx_theme"
html_title = "ilattice"
html_static_path = ["_static"]
html_css_files = ["site.css"]
html_favicon = "_static/icon.png"
html_sidebars = {"*": []}  # pages that are in no section
html_context = {"default_mode": "light"}
html_copy_source = False
html_show_sourcelink = False
html_theme_options = {
    "logo": {"text": "ilattice"},
    "navbar_align": "left",
    "navigation_depth": 2,
    "show_toc_level": 2,
    "secondary_sidebar_items": ["page-toc"],
    "footer_start": ["copyright"],
    "footer_end": [],
}

HOMES = make_pages.homes()
NAME = re.compile(r"il(\.\w+)+|[A-Z]\w*(\.\w+)*")


def _escape(_app: Any, _kind: str, _name: str, _item: Any, _options: Any, lines: list[str]) -> None:
    """Let ``|d|`` in a docstring be an absolute value, not the name of a substitution."""
    lines[:] = make_pages.escaped(lines)


def _find(app: Any, env: Any, node: Any, contnode: Any) -> Any:
    """Where a name that is used outside of its room is documented."""
    if node.get("refdomain") != "py":
        return None
    first, *rest = node["reftarget"].removeprefix("ilattice.").removeprefix("il.").split(".")
    if first in make_pages.ROOMS and rest:
        first, *rest = rest
    if first not in HOMES:
        return None
    target = ".".join([HOMES[first], first, *rest])
    domain = env.get_domain("py")
    return domain.resolve_xref(env, node["refdoc"], app.builder, "obj", target, node, contnode)


def _link(app: Any, doctree: Any) -> None:
    """Let names in the text, such as `il.tiles.mix` and `Wall.mesh`, lead to the reference."""
    for code in list(doctree.findall(nodes.literal)):
        text = code.astext().removesuffix("()")
        inside = nodes.reference | nodes.title | addnodes.pending_xref
        if isinstance(code.parent, inside) or not NAME.fullmatch(text):
            continue
        link = addnodes.pending_xref(
            "", refdomain="py", reftype="obj", reftarget=text, refdoc=app.env.docname
        )
        code.replace_self(link)
        link += code


def setup(app: Any) -> None:
    """Write the generated pages before Sphinx looks for pages."""
    make_pages.write(HERE / "generated")
    app.connect("doctree-read", _link)
    app.connect("autodoc-process-docstring", _escape, priority=900)
    app.connect("missing-reference", _find)
