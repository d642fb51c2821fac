"""Check of the built site: every internal link has a target, and no page loads content from another site.

Faults are warnings, so a build with ``-W`` fails. Links to other sites are not followed.
"""

from __future__ import annotations

from html.parser import HTMLParser
from pathlib import Path
from typing import TYPE_CHECKING
from urllib.parse import unquote, urlsplit

if TYPE_CHECKING:
    from sphinx.application import Sphinx

LOADS = {("script", "src"), ("link", "href"), ("img", "src"), ("source", "src"), ("iframe", "src"), ("object", "data")}


class Page(HTMLParser):
    """Links of a page, and the identifiers that links can refer to."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.places: set[str] = {"", "top"}
        self.links: set[tuple[str, bool]] = set()
        self.feed(text)

    def handle_starttag(self, tag: str, attributes: list[tuple[str, str | None]]) -> None:
        """Store identifiers and references of an element."""
        for key, value in attributes:
            if key == "id" and value:
                self.places.add(value)
            elif key in ("href", "src", "data") and value:
                self.links.add((value, (tag, key) in LOADS))


def faults(root: Path) -> list[str]:
    """Return broken links and content from other sites, of all pages below a folder."""
    pages = {path.resolve(): Page(path.read_text(encoding="utf-8")) for path in sorted(root.rglob("*.html"))}
    found = []
    for path, page in pages.items():
        here = path.relative_to(root.resolve())
        for link, loads in sorted(page.links):
            parts = urlsplit(link)
            if parts.scheme or parts.netloc:
                found += [f"{here} loads {link}"] if loads and parts.scheme != "data" else []
                continue
            target = (path.parent / unquote(parts.path)).resolve() if parts.path else path
            if not target.exists():
                found.append(f"{here} links to {link}, which is not there")
            elif target in pages and unquote(parts.fragment) not in pages[target].places:
                found.append(f"{here} links to {link}, which has no such place")
    return found


def check(app: Sphinx, error: Exception | None) -> None:
    """Warn of every fault of the built site."""
    from sphinx.util import logging

    if error is None and app.builder.name == "html":
        for fault in faults(Path(app.outdir)):
            logging.getLogger(__name__).warning("%s", fault)


def setup(app: Sphinx) -> dict[str, bool]:
    """Register the extension."""
    app.connect("build-finished", check, priority=900)
    return {"parallel_read_safe": True}
