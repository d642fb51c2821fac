"""Equations as MathML, which browsers draw by themselves: no script and no network is needed.

LaTeX is translated by math-core. The font is that of the package ziamath, for not every system has one for mathematics.
"""

from __future__ import annotations

import html
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from docutils import nodes
from math_core import LatexError, LatexToMathML
from sphinx.application import Sphinx
from sphinx.util import logging

ACCENTS = {"\u0308": "\u00a8", "\u0307": "\u02d9"}
"""Dots as characters of their own: combining ones stand beside the letter in some browsers."""


def font() -> str:
    """File of the font of equations, STIX Two Math (SIL Open Font License)."""
    found = find_spec("ziamath")
    assert found and found.origin
    return str(Path(found.origin).parent / "fonts" / "STIXTwoMath-Regular.ttf")


def mathml(node: nodes.Element, block: bool) -> str:
    """The element ``<math>`` of an equation; what cannot be translated is a warning, and shown as it was written."""
    try:
        text = str(LatexToMathML().convert_with_local_state(node.astext(), displaystyle=block))
    except LatexError as error:
        logging.getLogger(__name__).warning("equation: %s", error, location=node)
        return f"<code>{html.escape(node.astext())}</code>"
    return text.translate(str.maketrans(ACCENTS))


def inline(writer: Any, node: nodes.Element) -> None:
    """An equation in a line."""
    writer.body.append(mathml(node, block=False))
    raise nodes.SkipNode


def display(writer: Any, node: nodes.Element) -> None:
    """An equation of its own, which scrolls by itself where it is wider than the page."""
    writer.body.append(f"{writer.starttag(node, 'div', CLASS='math')}{mathml(node, block=True)}</div>\n")
    raise nodes.SkipNode


def setup(app: Sphinx) -> dict[str, bool]:
    """What Sphinx asks of an extension."""
    app.add_html_math_renderer("mathml", (inline, None), (display, None))
    return {"parallel_read_safe": True, "parallel_write_safe": True}
