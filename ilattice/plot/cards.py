"""What notebooks show of a thing: its numbers, and a small picture made when it is shown.

Guarantee: cheap, and never an error: where no picture can be made (no OpenGL, an empty part), there
are the numbers alone.
"""

import base64
import html
import warnings
from collections.abc import Mapping
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

#: Pixels of a picture on a card.
_SIZE = (360, 270)


def card(thing: Any, numbers: Mapping[str, Any], *, of: Any = None, **options: Any) -> str:
    """A small table, and what a `plot` draws beside it.

    Parameters
    ----------
    thing : object
        What it is about; its class is the headline.
    numbers : mapping of str to object
        Rows of the table; floats are shown with five digits.
    of : object, optional
        What is drawn in place of `thing`; False for no picture.
    **options
        Of its ``plot``.

    Returns
    -------
    str
        HTML.
    """
    rows = "".join(
        f"<tr><th style='text-align:left'>{html.escape(name)}</th>"
        f"<td style='text-align:left'>{html.escape(_text(value))}</td></tr>"
        for name, value in numbers.items()
    )
    picture = "" if of is False else _picture(thing if of is None else of, options)
    return (
        f"<div style='display:flex;gap:1em;align-items:center'>{picture}<div>"
        f"<b>{html.escape(type(thing).__name__)}</b><table>{rows}</table></div></div>"
    )


def _text(value: Any) -> str:
    if isinstance(value, (tuple, list)):
        return " x ".join(map(_text, value))
    return f"{value:.5g}" if isinstance(value, float) else str(value)


def _picture(thing: Any, options: Mapping[str, Any]) -> str:
    """An image element, or nothing."""
    try:
        with TemporaryDirectory() as folder, warnings.catch_warnings():
            warnings.simplefilter("ignore")
            path = Path(folder) / "a.png"
            thing.plot(screenshot=path, size=_SIZE, title="", **options)
            text = base64.b64encode(path.read_bytes()).decode("ascii")
    except Exception:  # a notebook still wants the numbers
        return ""
    width, height = _SIZE
    return f"<img width='{width}' height='{height}' src='data:image/png;base64,{text}'>"
