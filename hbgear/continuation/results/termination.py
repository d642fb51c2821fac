"""How long work ends: done, by Ctrl-C or by an error. What was done before is kept, and the result says why."""

from __future__ import annotations

import traceback
from dataclasses import dataclass
from pathlib import Path

from hbgear.continuation.results.branch import Branch, Status


class TraceInterrupted(KeyboardInterrupt):
    """Ctrl-C within a trace that is a part of larger work; ``branch`` is what was traced of it."""

    def __init__(self, branch: Branch) -> None:
        super().__init__(branch.message)
        self.branch = branch


def whole(branch: Branch) -> Branch:
    """The branch, for work that traces several: `trace` makes a status of Ctrl-C, which must end all of the work.

    Raises
    ------
    Interrupted
        If the trace was interrupted.
    """
    if branch.status is Status.INTERRUPTED:
        raise TraceInterrupted(branch)
    return branch


@dataclass
class Termination:
    """Status and message of the result of some work, and the error or Ctrl-C that ended it, if one did."""

    status: Status = Status.REACHED_END
    message: str = ""
    error: BaseException | None = None

    def note(self, error: BaseException, place: str) -> None:
        """Ctrl-C or an error ended the work, or a part of it, at a place; the first is the one that is told."""
        if self.error is not None:
            return
        self.error = error  # an end of the whole work is told rather than that of a part; see `also`
        if isinstance(error, KeyboardInterrupt):
            self.status, self.message = Status.INTERRUPTED, f"interrupted {place}"
        else:
            self.status, self.message = Status.FAILED, f"an error {place}: {described(error)}"

    def reached(self, status: Status, message: str) -> None:
        """The work came to an end of its own."""
        if self.error is None:
            self.status, self.message = status, message

    def also(self, branch: Branch, what: str) -> None:
        """One of several traces was made; the first that is not complete is told."""
        if not branch.status.complete and self.status.complete:
            self.status, self.message = branch.status, f"{what} ended early: {branch.message.partition('. ')[0]}"

    @property
    def told(self) -> str:
        """The message, with advice if the work was not completed."""
        return self.message if self.status.complete else f"{self.message}. {self.status.advice}"


def described(error: BaseException) -> str:
    """An error in one line, with the place in the sources it came from."""
    frames = traceback.extract_tb(error.__traceback__)
    where = f" ({Path(frames[-1].filename).name}, line {frames[-1].lineno})" if frames else ""
    text = " ".join(str(error).split())
    return f"{type(error).__name__}{f': {text}' if text else ''}{where}"
