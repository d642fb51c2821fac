"""Prose of docstrings as reStructuredText; sections are numpydoc and are left to napoleon.

an indented equation       becomes a literal block
|x| and trailing_          are escaped: reStructuredText would read substitutions and targets
"""

from __future__ import annotations

import re
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from sphinx.application import Sphinx

ENTRIES = ("Parameters", "Attributes", "Other Parameters", "Returns", "Yields", "Raises", "Warns")
"""Sections of entries, whose first lines are names and types."""


def escaped(line: str) -> str:
    """Return a line of prose without characters that would be substitutions, targets or emphasis."""
    parts = re.split(r"(``.*?``)", line)
    for i in range(0, len(parts), 2):
        text = parts[i].replace("|", r"\|")
        text = re.sub(r"(?<=\w)_(?=[\s,;.:)]|$)", r"\\_", text)
        text = re.sub(r"(`[^`]+`)(?=\w)", r"\1\\ ", text)  # `Wheel`s
        parts[i] = re.sub(r"(?<!\*)\*(?=\s)|(?<![\s*(`])\*(?!\*)", r"\\*", text)
    return "".join(parts)


def is_heading(lines: list[str], i: int) -> bool:
    """Return whether a section begins at a line: the next line consists of dashes."""
    return i + 1 < len(lines) and bool(lines[i]) and re.fullmatch(r"-{3,}", lines[i + 1].strip()) is not None


def rewritten(lines: list[str]) -> list[str]:
    """Return the lines of a docstring with escaped prose and literal blocks."""
    done: list[str] = []
    section = ""
    i = 0
    while i < len(lines):
        line = lines[i]
        if is_heading(lines, i):
            section = line.strip()
            done += [line, lines[i + 1]]
            i += 2
            continue
        is_entry = section in ENTRIES and not line.startswith(" ")
        if is_entry or section == "Examples" or line.lstrip().startswith(">>>"):
            done.append(line)
        elif line.startswith(" ") and not section and (i == 0 or not lines[i - 1].strip()):
            last = next((text for text in reversed(done) if text.strip()), "")
            block = i
            while i < len(lines) and (lines[i].startswith(" ") or not lines[i].strip()):
                i += 1
            done += [] if last.endswith("::") else [".. code-block:: text", ""]
            done += [*lines[block:i], ""]
            continue
        else:
            done.append(escaped(line))
        i += 1
    return done


def process(app: Sphinx, what: str, name: str, thing: Any, options: Any, lines: list[str]) -> None:
    """Rewrite a docstring; remove the docstring that a constant has from its type."""
    if what in ("data", "attribute") and "\n".join(lines).strip() == str(type(thing).__doc__).strip():
        lines[:] = []
    lines[:] = rewritten(lines)


def setup(app: Sphinx) -> dict[str, bool]:
    """Register the extension."""
    app.connect("autodoc-process-docstring", process, priority=100)
    return {"parallel_read_safe": True}
