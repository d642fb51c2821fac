"""Words that errors share."""

from __future__ import annotations

import difflib
from collections.abc import Iterable


def did_you_mean(word: str, known: Iterable[str]) -> str:
    """`` ; did you mean 'x'?`` for a close match, else the list of what is known."""
    known = list(known)
    close = difflib.get_close_matches(str(word), known, n=1)
    if close:
        return f"; did you mean '{close[0]}'?"
    return f"; it has: {', '.join(known)}" if known else "; it has none"
