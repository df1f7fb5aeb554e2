"""The page that browsers get: viser's own, with our scripts before its, in one answer."""

from __future__ import annotations

import functools
import gzip
from importlib import resources
from pathlib import Path
from typing import Final

import viser

SCRIPTS: Final = (
    "identity.js",
    "bridge.js",
    "drawing.js",
    "sky.js",
    "reconnect.js",
    "link.js",
    "clicks.js",
    "windows.js",
    "keyboard.js",
    "notes.js",
    "hand.js",
    "enlarge.js",
    "timebar.js",
    "texts.js",
    "panes.js",
    "files.js",
    "tour.js",
    "names.js",
)
"""In the order in which they run; each adds to the object `rallyscope`."""


@functools.cache
def page_html() -> bytes:
    """The whole page, UTF-8.

    Raises:
        RuntimeError: if viser's page is not built as we know it.
    """
    html = (Path(viser.__file__).parent / "client" / "build" / "index.html").read_text("utf-8")
    head, found, rest = html.partition("<title>Viser</title>")
    if not found:
        raise RuntimeError("viser's page has no title to put our script beside; its version must be the pinned one")
    folder = resources.files("app.web") / "page"
    script = "\n".join((folder / name).read_text("utf-8") for name in SCRIPTS)
    style = (folder / "style.css").read_text("utf-8")
    ours = f"<title>Rallyscope</title><style>{style}</style><script>const rallyscope = {{}};\n{script}</script>"
    return f"{head}{ours}{rest}".encode()


@functools.cache
def page_gzip() -> bytes:
    """The same, packed."""
    return gzip.compress(page_html())


def refusal_html(title: str, text: str, *, form: bool = False) -> bytes:
    """A small page that says why not; with a field for the token if `form`. Both texts are our own."""
    field = (
        "<form method='get' action='/'><input name='token' type='password' aria-label='Token' autofocus> "
        "<button>Open</button></form>"
    )
    return (
        "<!doctype html><html lang='en'><meta charset='utf-8'><title>Rallyscope</title>"
        "<body style='font:16px system-ui;background:#1a1b1e;color:#ddd;padding:3em;max-width:44em'>"
        f"<h1 style='color:#ff8c28'>{title}</h1><p>{text}</p>{field if form else ''}</body></html>"
    ).encode()
