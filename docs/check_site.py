"""Look at the built site in a real browser: ``python docs/check_site.py [folder] [-b chromium]``.

Pages are shown by headless Chromium from a server on this machine: nothing may be said on the
console but notices of the theme, every picture of a page must be loaded, and a search must find
what it is asked for. Needs Chromium or Chrome; without one it says so and ends with 3, as skipped.
"""

import argparse
import html
import json
import re
import shutil
import subprocess
import sys
import threading
from functools import partial
from http.server import SimpleHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

BROWSERS = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable", "chrome")
#: What is looked for, and a page that must be among what is found.
SEARCHED = {"relative_density": "thickness", "heat exchanger": "jobs"}
#: How notices of the theme begin, that it tells of the colours it has taken and so on.
NOTICE = '"[PST]: '
#: How long a page may take, in milliseconds of its own clock.
TIME = 30_000
#: A page that shows another one in a frame, and tells which of its pictures are there.
PROBE = """<!doctype html><title>probe</title><iframe id="f" width="1200" height="4000"></iframe>
<script>
const frame = document.getElementById("f"), told = [];
frame.onload = async () => {
  const inside = frame.contentDocument, images = [...inside.images];
  images.forEach(image => { image.loading = "eager"; });
  await Promise.all(images.map(image => image.complete ||
    new Promise(done => { image.onload = image.onerror = done; })));
  for (const image of images)
    if (!image.naturalWidth) told.push(image.getAttribute("src"));
  document.title = JSON.stringify({images: images.length, missing: told});
};
frame.src = location.hash.slice(1);
</script>
"""


class Quiet(SimpleHTTPRequestHandler):
    """A server that says nothing, with the probe beside the pages."""

    def do_GET(self) -> None:
        """Answer for the probe; files are those of the folder."""
        if self.path != "/probe.html":
            super().do_GET()
            return
        self.send_response(200)
        self.send_header("Content-Type", "text/html; charset=utf-8")
        self.end_headers()
        self.wfile.write(PROBE.encode())

    def log_message(self, format: str, *arguments: Any) -> None:
        """Say nothing."""


def browser() -> str:
    """Path of a browser, empty if there is none."""
    return next((path for name in BROWSERS if (path := shutil.which(name))), "")


def shown(program: str, address: str) -> tuple[str, list[str]]:
    """The page as it stands after its scripts, and what was said on the console."""
    with TemporaryDirectory() as home:
        done = subprocess.run(
            [program, "--headless", "--no-sandbox", "--disable-gpu", f"--user-data-dir={home}",
             "--disable-background-networking", "--enable-logging=stderr", "--dump-dom",
             f"--virtual-time-budget={TIME}", "--window-size=1280,1600", address],
            capture_output=True, text=True, check=True, timeout=300,
        )  # fmt: skip
    said = [line for line in done.stderr.splitlines() if "CONSOLE" in line]
    lines = (re.sub(r"^.*?CONSOLE[^\]]*\]\s*", "", line) for line in said)
    return done.stdout, [line for line in lines if not line.startswith(NOTICE)]


def complaints(folder: Path, program: str, pages: list[str]) -> list[str]:
    """What is wrong, one line each."""
    server = ThreadingHTTPServer(("127.0.0.1", 0), partial(Quiet, directory=str(folder)))
    threading.Thread(target=server.serve_forever, daemon=True).start()
    home, wrong = f"http://127.0.0.1:{server.server_port}", []
    try:
        for page in pages:
            text, said = shown(program, f"{home}/probe.html#/{page}")
            wrong += [f"{page}: the console says {line}" for line in said]
            title = re.search(r"<title>(.*?)</title>", text, re.DOTALL)
            found = json.loads(html.unescape(title[1])) if title and title[1][0] == "{" else {}
            if not found:
                wrong.append(f"{page}: is not shown in time")
            wrong += [f"{page}: picture {src} is not there" for src in found.get("missing", [])]
        for words, target in SEARCHED.items():
            text, said = shown(program, f"{home}/search.html?q={words.replace(' ', '+')}")
            wrong += [f"search: the console says {line}" for line in said]
            results = text.partition('id="search-results"')[2]
            if not re.search(rf'href="?[^">]*{target}', results):
                wrong.append(f"search: {words!r} does not find {target}")
    finally:
        server.shutdown()
        server.server_close()
    return wrong


def main(words: list[str]) -> int:
    """Print what is wrong; return 1 if something is, 3 without a browser."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", nargs="?", type=Path, default=Path("build/docs"))
    parser.add_argument("-b", "--browser", default=browser())
    parser.add_argument("-p", "--pages", nargs="*", help="by default those with pictures")
    arguments = parser.parse_args(words)
    if not arguments.browser:
        print("skipped: there is no Chromium or Chrome")
        return 3
    pages = arguments.pages
    if pages is None:
        all_of_them = sorted(arguments.folder.rglob("*.html"))
        names = [p.relative_to(arguments.folder).as_posix() for p in all_of_them
                 if "_static" not in p.parts]  # fmt: skip
        pages = [n for n in names if n.count("/") < 2 or "gallery" in n]
    wrong = complaints(arguments.folder, arguments.browser, pages)
    print("\n".join([*wrong, f"{len(wrong)} complaints about {len(pages)} pages"]))
    return int(bool(wrong))


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
