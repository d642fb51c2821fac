"""Docstrings as they are written here, turned into what Sphinx reads.

name : what it is          becomes a parameter with that text: the words behind the colon are no type
an indented equation       becomes a block as it stands
|x| and trailing_          lose the meaning that reStructuredText gives them
"""

from __future__ import annotations

import re
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from sphinx.application import Sphinx

FIELD = re.compile(r"^(\*{0,2}[\w.]+(?:, \*{0,2}[\w.]+)*) : (.*)$")
HEADED = ("Parameters", "Attributes", "Other Parameters")


def escaped(line: str) -> str:
    """A line of prose without what would be read as a substitution, a target or emphasis."""
    pieces = re.split(r"(``.*?``)", line)
    for i in range(0, len(pieces), 2):
        text = pieces[i].replace("|", r"\|")
        text = re.sub(r"(?<=\w)_(?=[\s,;.:)]|$)", r"\\_", text)
        text = re.sub(r"(`[^`]+`)(?=\w)", r"\1\\ ", text)  # `Wheel`s
        pieces[i] = re.sub(r"(?<!\*)\*(?=\s)|(?<![\s*(`])\*(?!\*)", r"\\*", text)
    return "".join(pieces)


def is_heading(lines: list[str], i: int) -> bool:
    """Whether a section begins at a line: the next one is as many dashes."""
    return i + 1 < len(lines) and bool(lines[i]) and re.fullmatch(r"-{3,}", lines[i + 1].strip()) is not None


def rewritten(lines: list[str], fields_first: bool) -> list[str]:
    """A docstring as Sphinx understands it.

    Parameters
    ----------
    lines : of the docstring.
    fields_first : whether fields may come before any section, as those of a class do.
    """
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
        field = FIELD.match(line)
        if field and not section and fields_first:
            section = "Parameters"
            done += ["", section, "-" * len(section)]
        if field and section in HEADED:
            done += [field[1], f"    {escaped(field[2])}"]
        elif section == "Examples" or line.lstrip().startswith(">>>"):
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
    """Rewrite a docstring; one that is only that of the type of a constant is left out."""
    if what in ("data", "attribute") and "\n".join(lines).strip() == str(type(thing).__doc__).strip():
        lines[:] = []
    lines[:] = rewritten(lines, fields_first=what == "class")


def setup(app: Sphinx) -> dict[str, bool]:
    """What Sphinx asks of an extension."""
    app.connect("autodoc-process-docstring", process, priority=100)
    return {"parallel_read_safe": True}
