"""Status: the reason why a trace or a study ended, with advice."""

from __future__ import annotations

from enum import StrEnum


class Status(StrEnum):
    """Reason why a trace ended.

    Examples
    --------
    >>> import hbgear as hb
    >>> problem = hb.HarmonicBalance(hb.Duffing(), 5)
    >>> curve = hb.trace(problem, "Omega", (0.8, 1.6), steps=hb.StepControl(max_points=10))
    >>> curve.status is hb.Status.MAX_POINTS, curve.status.complete
    (True, False)
    """

    REACHED_END = "reached_end"
    """The end of the span was reached."""
    LEFT_SPAN = "left_span"
    """The curve turned back and left the span through its start."""
    UNBOUNDED = "unbounded"
    """The solutions grow without bound as the parameter approaches a value within the span."""
    CLOSED = "closed"
    """The curve closed on itself."""
    MERGED = "merged"
    """The branch joined the one from which it started."""
    EVENT = "event"
    """A terminal event was reached."""
    ARBITRARY = "arbitrary"
    """The equations leave a part of the solution arbitrary."""
    RETRACED = "retraced"
    """The trace turned round and followed its own points back."""
    MAX_POINTS = "max_points"
    """The largest number of points was reached before the end of the span."""
    STEP_TOO_SMALL = "step_too_small"
    """The corrector failed with the smallest step."""
    INTERRUPTED = "interrupted"
    """Ctrl-C, or a request to end, stopped the trace."""
    FAILED = "failed"
    """An error stopped the trace."""

    @property
    def complete(self) -> bool:
        """True if the branch was traced as far as it exists within the span."""
        return self in (
            Status.REACHED_END,
            Status.LEFT_SPAN,
            Status.UNBOUNDED,
            Status.CLOSED,
            Status.MERGED,
            Status.EVENT,
            Status.ARBITRARY,
        )

    @property
    def in_words(self) -> str:
        """Status for readers, such as "complete", "complete, unbounded" or "stopped early, max points"."""
        words = self.value.replace("_", " ")
        if self is Status.REACHED_END:
            return "complete"
        return f"complete, {words}" if self.complete else f"stopped early, {words}"

    @property
    def advice(self) -> str:
        """Recommended action of the user."""
        return _ADVICE[self]


_ADVICE = {
    Status.REACHED_END: "nothing to do: the end of the span was reached",
    Status.LEFT_SPAN: "the curve turned back and left the span through its start; trace it from the other end as well, "
    "with the ends of the span exchanged",
    Status.UNBOUNDED: "nothing to do: the solutions grow without bound as the parameter approaches the stated value",
    Status.MERGED: "nothing to do: the branch ended on the one it came from",
    Status.EVENT: "nothing to do: a terminal event was reached; start from its point to trace further",
    Status.ARBITRARY: "the equations leave a part of the solution arbitrary, as the message states, and a value was "
    "chosen: load the system, or support the free motion",
    Status.CLOSED: "nothing to do: the curve closed on itself",
    Status.RETRACED: "allow shorter steps or a smaller turning angle: "
    "steps=hb.StepControl(max_step=..., max_turn_deg=...)",
    Status.MAX_POINTS: "allow more points or longer steps, or continue from the last point: hb.extend(curve), "
    "hbgear extend FILE",
    Status.STEP_TOO_SMALL: "continue from the last point with more harmonics or samples: hb.extend(curve, "
    "problem=...), hbgear extend FILE --harmonics 32; or allow shorter steps: steps=hb.StepControl(min_step=...)",
    Status.INTERRUPTED: "completed results are kept; continue from there (a curve: hb.extend(curve), hbgear extend "
    "FILE)",
    Status.FAILED: "completed results are kept; continue from there, if necessary with other settings (a curve: "
    "hb.extend(curve, problem=...))",
}
