"""Parts of error messages."""

from __future__ import annotations

import difflib
from collections.abc import Iterable
from typing import Any


def did_you_mean(word: str, known: Iterable[str], otherwise: str = "it has:") -> str:
    """Return ``; did you mean 'x'?`` for a similar name, else the list of the known names after ``otherwise``."""
    known = list(known)
    close = difflib.get_close_matches(str(word), known, n=1)
    if close:
        return f"; did you mean '{close[0]}'?"
    return f"; {otherwise} {', '.join(known)}" if known else "; it has none"


def article(word: str) -> str:
    """Return a word or abbreviation with its article as pronounced: an LP, a PD, an element."""
    spelt = word[:2].isupper()
    return f"{'an' if word[:1] in ('AEFHILMNORSX' if spelt else 'AEIOaeio') else 'a'} {word}"


def quoted(value: Any) -> str:
    """Return a value in one short line: its representation, or its type if that is long."""
    if isinstance(value, type):
        return f"the class {value.__name__}"
    if isinstance(value, int) and abs(value) >= 10**60:  # Python raises an error for the text of larger ones
        return "a number of more than 60 digits"
    if isinstance(value, str):
        return repr(shortened(value))
    text = " ".join(repr(value).split())
    return text if len(text) <= 80 and " at 0x" not in text else article(type(value).__name__)


def origin_of(definition: Any) -> tuple[str, str]:
    """Return the module and the qualified name of a class or a function; of other callables those of their class."""
    return str(definition.__module__), str(getattr(definition, "__qualname__", type(definition).__qualname__))


def shortened(text: str, most: int = 80) -> str:
    """Return a text in one line of at most ``most`` characters; the middle of a longer text is left out."""
    text = " ".join(text.split()) if "\n" in text else text
    return text if len(text) <= most else f"{text[: most - 13]}...{text[-10:]}"
