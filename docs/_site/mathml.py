"""Equations as MathML, which browsers display without scripts and without a network.

math-core translates LaTeX. The font comes from the package ziamath, because not every system has a font for equations.
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
"""Dots as separate characters: some browsers misplace combining dots."""


def font() -> str:
    """Return the font file for equations, STIX Two Math (SIL Open Font License)."""
    found = find_spec("ziamath")
    assert found and found.origin
    return str(Path(found.origin).parent / "fonts" / "STIXTwoMath-Regular.ttf")


def mathml(node: nodes.Element, block: bool) -> str:
    """Return the element ``<math>`` of an equation; warn and return the source if it cannot be translated."""
    try:
        text = str(LatexToMathML().convert_with_local_state(node.astext(), displaystyle=block))
    except LatexError as error:
        logging.getLogger(__name__).warning("equation: %s", error, location=node)
        return f"<code>{html.escape(node.astext())}</code>"
    return text.translate(str.maketrans(ACCENTS))


def inline(writer: Any, node: nodes.Element) -> None:
    """Write an inline equation."""
    writer.body.append(mathml(node, block=False))
    raise nodes.SkipNode


def display(writer: Any, node: nodes.Element) -> None:
    """Write a displayed equation, which scrolls if it is wider than the page."""
    writer.body.append(f"{writer.starttag(node, 'div', CLASS='math')}{mathml(node, block=True)}</div>\n")
    raise nodes.SkipNode


def setup(app: Sphinx) -> dict[str, bool]:
    """Register the extension."""
    app.add_html_math_renderer("mathml", (inline, None), (display, None))
    return {"parallel_read_safe": True, "parallel_write_safe": True}
