"""HTML pages from templates, with style, scripts, Plotly and data in one file."""

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
        "regimes": COLOURS,
        "branches": list(BRANCHES),
        "text": "#1b1f24",
        "grid": "#e3e6ea",
        "line": "#8a8f98",
        "paper": "#ffffff",
    },
    "dark": {
        "regimes": {
            "no_impact": "#7db4ff",
            "single_sided": "#ffab5e",
            "double_sided": "#ff8ac0",
            "stick": "#6fd0cb",
            "partial_slip": "#e0c060",
            "gross_slip": "#ff8f75",
            "unknown": "#d5d8dc",
        },
        "branches": ["#56b4e9", "#ff8c42", "#2fd1a0", "#ef8cc8", "#ffffff", "#f5c242", "#9ad0f5", "#c9a545"],
        "text": "#e6e8eb",
        "grid": "#30353c",
        "line": "#8a8f98",
        "paper": "#15181c",
    },
}
"""Colours of the light and the dark theme, in the same order; the light ones are those of `hbgear.plot`."""


_POLICY = "content-security-policy-of-this-page"
"""Placeholder of the Content-Security-Policy, which contains the hashes of the scripts of the page."""


def page(template: str, data: Any, connect: str = "'none'", **values: Any) -> str:
    """Return a page made from a template and data of its scripts; its Content-Security-Policy admits only these.

    ``connect`` is the source list of connect-src: destinations of requests. ``values`` are variables of the template.
    ValueError is raised if Plotly or Jinja is not installed.
    """
    jinja2 = needed("jinja2", "report", "a page")
    loader = jinja2.FileSystemLoader(ASSETS)
    environment = jinja2.Environment(loader=loader, autoescape=True, trim_blocks=True, lstrip_blocks=True)
    environment.undefined = jinja2.StrictUndefined
    settings = {"palettes": PALETTES, "widths": WIDTHS}
    text = environment.get_template(template).render(
        version=__version__,
        data=in_script(data),
        settings=in_script(settings),
        style=asset("page.css"),
        curves=asset("lines.js") + asset("curves.js"),
        explorer=asset("explorer.js"),
        policy=_POLICY,
        **values,
    )
    return str(text).replace(_POLICY, policy_of(str(text), connect), 1)


def policy_of(text: str, connect: str) -> str:
    """Return the Content-Security-Policy of a page: its own scripts by their hashes, its style and inline images.

    Plotly adds styles while it draws and exports figures as data and blobs.
    """
    hashes = {sha256(script.encode()).digest() for script in re.findall(r"<script>(.*?)</script>", text, re.DOTALL)}
    scripts = " ".join(sorted(f"'sha256-{b64encode(digest).decode()}'" for digest in hashes))
    return (
        f"default-src 'none'; script-src {scripts}; style-src 'unsafe-inline'; img-src data: blob:; "
        f"connect-src {connect}; base-uri 'none'; form-action 'none'"
    )


def check_installed() -> None:
    """Raise ValueError if Plotly or Jinja is not installed, before any computation."""
    for library in ("jinja2", "plotly"):
        needed(library, "report", "a page")


def in_script(value: Any) -> Any:
    """Return data as JSON that cannot end the script element that contains it."""
    from markupsafe import Markup

    text = json.dumps(value, ensure_ascii=False, allow_nan=False, separators=(",", ":"))
    return Markup(text.replace("<", "\\u003c").replace("\u2028", "\\u2028").replace("\u2029", "\\u2029"))


def asset(name: str) -> Any:
    """Return the text of a file in the folder of assets, which is included in a page unchanged."""
    from markupsafe import Markup

    return Markup((ASSETS / name).read_text(encoding="utf-8"))


@cache
def plotly_script() -> Any:
    """Return the script of Plotly, which its Python package contains."""
    from markupsafe import Markup

    return Markup(needed("plotly.offline", "report", "a page").get_plotlyjs())
