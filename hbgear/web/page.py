"""Pages of HTML: templates filled in, with style, scripts, Plotly and data in the same file."""

from __future__ import annotations

import json
import re
from base64 import b64encode
from functools import cache
from hashlib import sha256
from pathlib import Path
from typing import Any

from hbgear._version import __version__
from hbgear.common.optional import needed
from hbgear.plot.style import BRANCHES, COLOURS, WIDTHS

ASSETS = Path(__file__).parent / "assets"

PALETTES = {
    "light": {
        "regimes": COLOURS, "branches": list(BRANCHES), "text": "#1b1f24", "grid": "#e3e6ea", "line": "#8a8f98",
        "paper": "#ffffff",
    },
    "dark": {
        "regimes": {"no_impact": "#7db4ff", "single_sided": "#ffab5e", "double_sided": "#ff8ac0", "unknown": "#d5d8dc"},
        "branches": ["#56b4e9", "#ff8c42", "#2fd1a0", "#ef8cc8", "#ffffff", "#f5c242", "#9ad0f5", "#c9a545"],
        "text": "#e6e8eb", "grid": "#30353c", "line": "#8a8f98", "paper": "#15181c",
    },
}  # fmt: skip
"""Colours on white and on black paper: those of the figures, and lighter ones in the same order."""


_POLICY = "content-security-policy-of-this-page"
"""Stands in a page for its policy, which has the hashes of the scripts around it."""


def page(template: str, data: Any, connect: str = "'none'", **values: Any) -> str:
    """A page of the folder of templates, with a Content-Security-Policy: only its own scripts run.

    Parameters
    ----------
    template : its name.
    data : what its scripts read, fit for JSON.
    connect : where its scripts may send requests to, a source list of connect-src.
    values : what the template itself takes.

    Raises
    ------
    ValueError
        If Plotly or Jinja is not installed.
    """
    jinja2 = needed("jinja2", "report", "a page")
    loader = jinja2.FileSystemLoader(ASSETS)
    environment = jinja2.Environment(loader=loader, autoescape=True, trim_blocks=True, lstrip_blocks=True)
    environment.undefined = jinja2.StrictUndefined
    settings = {"palettes": PALETTES, "widths": WIDTHS}
    text = environment.get_template(template).render(
        version=__version__, data=in_script(data), settings=in_script(settings), style=asset("page.css"),
        curves=asset("curves.js"), explorer=asset("explorer.js"), policy=_POLICY, **values,
    )  # fmt: skip
    return str(text).replace(_POLICY, policy_of(str(text), connect), 1)


def policy_of(text: str, connect: str) -> str:
    """Content-Security-Policy of a page: nothing but its own scripts, by their hashes, its style and inline images.

    Plotly adds styles while it draws and makes images of figures as data and blobs.
    """
    hashes = {sha256(script.encode()).digest() for script in re.findall(r"<script>(.*?)</script>", text, re.DOTALL)}
    scripts = " ".join(sorted(f"'sha256-{b64encode(each).decode()}'" for each in hashes))
    return (f"default-src 'none'; script-src {scripts}; style-src 'unsafe-inline'; img-src data: blob:; "
            f"connect-src {connect}; base-uri 'none'; form-action 'none'")  # fmt: skip


def check_installed() -> None:
    """Refuse before any work what a page could not be made with.

    Raises
    ------
    ValueError
        If Plotly or Jinja is not installed.
    """
    for library in ("jinja2", "plotly"):
        needed(library, "report", "a page")


def in_script(value: Any) -> Any:
    """JSON that cannot end the script it stands in."""
    from markupsafe import Markup

    text = json.dumps(value, ensure_ascii=False, allow_nan=False, separators=(",", ":"))
    return Markup(text.replace("<", "\\u003c").replace("\u2028", "\\u2028").replace("\u2029", "\\u2029"))


def asset(name: str) -> Any:
    """A file that goes into a page as it is."""
    from markupsafe import Markup

    return Markup((ASSETS / name).read_text(encoding="utf-8"))


@cache
def plotly_script() -> Any:
    """The script of Plotly, which its package for Python brings."""
    from markupsafe import Markup

    return Markup(needed("plotly.offline", "report", "a page").get_plotlyjs())
