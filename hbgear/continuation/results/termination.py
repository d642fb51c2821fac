"""Termination of long computations: completed, by Ctrl-C or by an error. Completed results are kept."""

from __future__ import annotations

import traceback
from dataclasses import dataclass
from pathlib import Path

from hbgear.continuation.results.branch import Branch
from hbgear.continuation.results.status import Status


class TraceInterrupted(KeyboardInterrupt):
    """Ctrl-C within a trace that is a part of a larger computation; ``branch`` is the traced part."""

    def __init__(self, branch: Branch) -> None:
        super().__init__(branch.message)
        self.branch = branch


def raise_if_interrupted(branch: Branch) -> Branch:
    """Return the result of `trace`; raise `TraceInterrupted` if Ctrl-C interrupted it.

    `trace` returns the traced part after Ctrl-C, with a status. A computation of several traces has to end as a whole.
    """
    if branch.status is Status.INTERRUPTED:
        raise TraceInterrupted(branch)
    return branch


@dataclass
class Termination:
    """Status and message of a result, and the error or KeyboardInterrupt that ended the computation.

    ``advice`` is the recommended action of the user if the computation is not complete, by default that of the status.
    """

    status: Status = Status.REACHED_END
    message: str = ""
    error: BaseException | None = None
    advice: str = ""

    def record_error(self, error: BaseException, location: str) -> None:
        """Record Ctrl-C or an error that ended the computation or a part of it, at a location such as "after 3 curves".

        Only the first one is kept.
        """
        if self.error is not None:
            return
        self.error = error
        if isinstance(error, KeyboardInterrupt):
            self.status, self.message = Status.INTERRUPTED, f"interrupted {location}"
        else:
            self.status, self.message = Status.FAILED, f"an error {location}: {error_text(error)}"

    def record_end(self, status: Status, message: str) -> None:
        """Record the end of the computation, unless an error was recorded."""
        if self.error is None:
            self.status, self.message = status, message

    def merge(self, branch: Branch, name: str) -> None:
        """Take over the status of one of several traces with a name; the first incomplete one is kept."""
        if not branch.status.complete and self.status.complete:
            self.status, self.message = branch.status, f"{name} ended early: {branch.message.partition('. ')[0]}"

    @property
    def message_with_advice(self) -> str:
        """The message, followed by the advice if the computation is not complete."""
        advice = self.advice or self.status.advice
        return self.message if self.status.complete else f"{self.message}. {advice[:1].upper()}{advice[1:]}"


def error_text(error: BaseException) -> str:
    """Return an error in one line: its class, its message, and the file and line where it was raised."""
    frames = traceback.extract_tb(error.__traceback__)
    location = f" ({Path(frames[-1].filename).name}, line {frames[-1].lineno})" if frames else ""
    text = " ".join(str(error).split())
    return f"{type(error).__name__}{f': {text}' if text else ''}{location}"
