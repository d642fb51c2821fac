"""How a long computation says how far it is."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field


@dataclass(frozen=True)
class Progress:
    """How far a computation is, as it is told to ``progress=`` of every function that takes long.

    Parameters
    ----------
    done : share of the work that is done, from 0 to 1; nan where it cannot be told. Of a trace it is the place within
        the span, which goes back where the curve turns.
    text : what it is at, in one line.
    numbers : numbers of the text, if any: of `trace` the ``value`` of the parameter, ``points`` and ``step``; of
        `cases` how many are ``finished``, ``total`` and ``failed``.

    Examples
    --------
    >>> import hbgear as hb
    >>> seen = []
    >>> curve = hb.trace(hb.HarmonicBalance(hb.Duffing(), 5), "Omega", (0.5, 0.8), progress=seen.append)
    >>> seen[-1].done, seen[-1].numbers["value"]
    (1.0, 0.8)
    >>> print(hb.Progress(0.25, "Omega = 0.9"))
     25 %  Omega = 0.9
    """

    done: float = math.nan
    text: str = ""
    numbers: Mapping[str, float] = field(default_factory=dict)

    def __str__(self) -> str:
        share = "" if math.isnan(self.done) else f"{100 * self.done:3.0f} %  "
        return share + self.text


ProgressCallback = Callable[[Progress], None]
"""What ``progress=`` may be: ``print``, or any function of a `Progress`. What it raises ends the computation.

Examples
--------
>>> import hbgear as hb
>>> def tell(progress: hb.Progress) -> None:
...     if progress.done == 1.0:
...         print(progress.text.split(",")[0])
>>> curve = hb.trace(hb.HarmonicBalance(hb.Duffing(), 5), "Omega", (0.5, 0.6), progress=tell)
Omega = 0.60000
"""
