"""Progress of long computations."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field


@dataclass(frozen=True)
class Progress:
    """Progress of a computation: argument of the callback ``progress=`` of long computations.

    Attributes
    ----------
    done : float
        Fraction of the work that is done, 0 to 1; nan if unknown. For a trace it is the position in the span, which
        decreases where the curve turns back.
    text : str
        Current state in one line.
    numbers : mapping
        Numbers of the text by name. `trace` gives the ``value`` of the parameter, ``points`` and ``step``; `cases` the
        numbers of ``finished``, ``total`` and ``failed`` cases.

    Examples
    --------
    >>> import hbgear as hb
    >>> received = []
    >>> curve = hb.trace(hb.HarmonicBalance(hb.Duffing(), 5), "Omega", (0.5, 0.8), progress=received.append)
    >>> received[-1].done, received[-1].numbers["value"]
    (1.0, 0.8)
    >>> print(hb.continuation.Progress(0.25, "Omega = 0.9"))
     25 %  Omega = 0.9
    """

    done: float = math.nan
    text: str = ""
    numbers: Mapping[str, float] = field(default_factory=dict)

    def __str__(self) -> str:
        share = "" if math.isnan(self.done) else f"{100 * self.done:3.0f} %  "
        return share + self.text


def curve_progress(
    name: str, value: float, span: tuple[float, float], points: int, step: float, activity: str = ""
) -> Progress:
    """Return the progress of a curve in a parameter over a span: its value, number of points, and step or activity."""
    done = min(max((value - span[0]) / (span[1] - span[0]), 0.0), 1.0)
    text = f"{name} = {value:.5f}, {points} points, {activity or f'step {step:.1e}'}"
    return Progress(done, text, {"value": value, "points": points, "step": step})


ProgressCallback = Callable[[Progress], None]
"""Type of ``progress=``: ``print`` or another function of a `Progress`. An exception in it ends the computation.

Examples
--------
>>> import hbgear as hb
>>> def show(progress: hb.continuation.Progress) -> None:
...     if progress.done == 1.0:
...         print(progress.text.split(",")[0])
>>> curve = hb.trace(hb.HarmonicBalance(hb.Duffing(), 5), "Omega", (0.5, 0.6), progress=show)
Omega = 0.60000
"""
