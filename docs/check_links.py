"""Check the built documentation without a network: ``python docs/check_links.py [FOLDER]``.

Every link to a page, a place on a page or a file must lead somewhere in FOLDER (by default
``build/docs``), and pages must not load anything from elsewhere. Links to other sites are not
followed.
"""

import sys
from html.parser import HTMLParser
from pathlib import Path
from urllib.parse import unquote, urlsplit


class Page(HTMLParser):
    """Places on a page, and where it leads.

    Attributes
    ----------
    places : set of str
        Values of ``id`` and ``name``.
    links, loads : list of str
        What can be followed, and what is loaded together with the page.
    """

    def __init__(self, text: str) -> None:
        super().__init__()
        self.places: set[str] = set()
        self.links: list[str] = []
        self.loads: list[str] = []
        self.feed(text)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        """Note what a tag is, names, or needs."""
        found = {key: value for key, value in attrs if value}
        self.places |= {found[key] for key in ("id", "name") if key in found}
        if "src" in found:
            self.loads.append(found["src"])
        if "href" in found:
            (self.loads if tag == "link" else self.links).append(found["href"])


def complaints(folder: Path) -> list[str]:
    """What is wrong, one line each."""
    paths = [p for p in sorted(folder.rglob("*.html")) if "_static" not in p.parts]
    pages = {p.resolve(): Page(p.read_text(encoding="utf-8")) for p in paths}
    wrong = [] if pages else [f"{folder} has no pages"]
    for path, page in pages.items():
        name = path.relative_to(folder.resolve())
        elsewhere = (link for link in page.loads if urlsplit(link).netloc)
        wrong += [f"{name}: loads {link} from elsewhere" for link in elsewhere]
        for link in [*page.links, *page.loads]:
            parts = urlsplit(link)
            if parts.scheme or parts.netloc:
                continue
            target = (path.parent / unquote(parts.path)).resolve() if parts.path else path
            place = unquote(parts.fragment)
            if not target.is_file():
                wrong.append(f"{name}: {link} leads nowhere")
            elif place and target in pages and place not in pages[target].places:
                wrong.append(f"{name}: {link} leads to no place on that page")
    return wrong


def main(words: list[str]) -> int:
    """Print what is wrong; return 1 if something is."""
    folder = Path(words[0]) if words else Path("build/docs")
    wrong = complaints(folder)
    print("\n".join([*wrong, f"{len(wrong)} broken links in {folder}"]))
    return int(bool(wrong))


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
