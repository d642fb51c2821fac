"""Progress bar for notebooks and terminals."""

from __future__ import annotations

import html
import math
import sys
import time
from typing import Any

from hbgear.common.process.progress import Progress

_MIN_INTERVAL = 0.1
"""Time [s] between two updates of the bar."""


class ProgressBar:
    """Progress bar for ``progress=`` of long computations: a bar in a notebook, a line in a terminal.

    Parameters
    ----------
    text : str, optional
        Name of the computation.

    Examples
    --------
    >>> import hbgear as hb
    >>> problem = hb.HarmonicBalance(hb.Duffing(), 5)
    >>> curve = hb.trace(problem, "Omega", (0.5, 1.6), progress=hb.ProgressBar("Duffing"))
    >>> curve.message
    'Omega = 1.6 reached'
    """

    def __init__(self, text: str = "") -> None:
        if not isinstance(text, str):
            raise ValueError(f"ProgressBar: text must be a text, got a {type(text).__name__}")
        self.text = text
        self._last = -math.inf
        self._shown: Any = None
        self._now = Progress(0.0)

    def __call__(self, progress: Progress) -> None:
        """Show the progress, at most every 0.1 s."""
        self._now = progress
        at = time.monotonic()
        if progress.done != 1.0 and at - self._last < _MIN_INTERVAL:
            return
        self._last = at
        display = _display()
        if display is None:
            if sys.stderr.isatty():
                end = "\n" if progress.done == 1.0 else ""
                print(f"\r\033[K{self.text}  {progress}".rstrip(), end=end, file=sys.stderr, flush=True)
        elif self._shown is None:
            self._shown = display(
                {"text/html": self._html(progress), "text/plain": str(progress)}, raw=True, display_id=True
            )
        else:
            self._shown.update({"text/html": self._html(progress), "text/plain": str(progress)}, raw=True)

    def _repr_html_(self) -> str:
        """Return the bar for notebooks."""
        return self._html(self._now)

    def _html(self, progress: Progress) -> str:
        """Return the HTML of the bar."""
        value = "" if math.isnan(progress.done) else f' value="{progress.done:.4f}"'
        return f"{html.escape(self.text)} <progress{value}></progress> {html.escape(progress.text)}"


def _display() -> Any:
    """Return the display function of a notebook; None outside notebooks."""
    ipython = sys.modules.get("IPython")
    shell = ipython.get_ipython() if ipython is not None else None
    if shell is None or not hasattr(shell, "kernel"):
        return None
    from IPython.display import display

    return display
