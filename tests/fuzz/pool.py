"""Fuzzing with many inputs, each tried in a worker that may hang, exhaust its memory or die without ending the run.

Each input is given by a seed. A fuzzer is a function ``attempt(seed, folder, note)`` that makes the input of the seed,
describes it by a call of ``note``, tries it, and returns a `Wrong` if the outcome is invalid, otherwise None. A seed
gives the same input in every run, so ``--seed 17 --count 1`` repeats a failure.
"""

from __future__ import annotations

import argparse
import faulthandler
import gc
import multiprocessing
import os
import re
import resource
import shutil
import signal
import tempfile
import time
import traceback
import warnings
from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import dataclass
from multiprocessing.connection import Connection, wait
from pathlib import Path
from typing import Any

SECONDS = 20.0
"""Processor time [s] above which an input counts as hanging; the limit of elapsed time is three times as long."""

MEMORY = 1 << 30
"""Largest increase of the memory of a worker by one input, in bytes."""

_CEILING = 3 << 30  # limit of additional address space in bytes; above MEMORY, so that an excess is measured
_LIFE = 400  # inputs after which a worker is replaced, so that leaked resources do not accumulate


@dataclass(frozen=True)
class Wrong:
    """An invalid outcome: its kind (traceback, raw, nonsense, exit, hang, memory, died), its place and its text."""

    kind: str
    where: str
    text: str


@dataclass(frozen=True)
class Failure:
    """A seed whose input failed."""

    seed: int
    what: str
    wrong: Wrong


@dataclass
class Most:
    """The inputs with the longest processor time and with the most memory so far."""

    seconds: float = 0.0
    slowest: str = ""
    memory: int = 0
    largest: str = ""

    def see(self, seed: int, what: str, seconds: float, memory: int) -> None:
        """Record a finished input."""
        if seconds > self.seconds:
            self.seconds, self.slowest = seconds, f"seed {seed}: {what}"
        if memory > self.memory:
            self.memory, self.largest = memory, f"seed {seed}: {what}"

    def __str__(self) -> str:
        return (
            f"the longest took {self.seconds:.1f} s of processor time, {self.slowest}\n"
            f"the largest took {self.memory / 2**20:.0f} MB, {self.largest}"
        )


Note = Callable[[str], None]
Attempt = Callable[[int, Path, Note], Wrong | None]


def place(error: BaseException) -> str:
    """Return the place of an error: the last two functions of hbgear in the traceback, and the last file."""
    frames = traceback.extract_tb(error.__traceback__)
    ours = [
        f"{Path(f.filename).name}:{f.name}"
        for f in frames
        if "hbgear" in Path(f.filename).parts and Path(f.filename).name != "arguments.py"
    ]
    final = [] if not frames or "hbgear" in Path(frames[-1].filename).parts else [Path(frames[-1].filename).name]
    return f"{type(error).__name__} in {' > '.join([*ours[-2:], *final]) or 'the test'}"


RAW = re.compile(
    r"object has no attribute|object is not|not supported between|unsupported operand|positional argument"
    r"|unexpected keyword|NoneType|indices must be|unhashable|cannot be interpreted as|could not convert"
    r"|invalid literal|could not be broadcast|setting an array element|inhomogeneous|must be real number"
    r"|ufunc '|numpy\.ndarray|object at 0x|\[Errno|Traceback|__\w+__\(|missing \d+ required|Expecting \w+|<class '"
    r"|index out of|out of bounds|truth value|mismatch in its core|not iterable|can't multiply|must be str"
    r"|argument must be|bad operand|embedded null|cannot unpack|too many values to|int too large|Errno \d"
)
"""Parts of internal messages of Python and NumPy, which a user should not see."""


LINE = re.compile(r", line \d+: |\(at line \d+|line \d+\)|, line \d+ has the byte")
"""Forms in which a message about a text file names the line."""


def raw_words(text: str) -> str:
    """Return the first part of a message that matches `RAW`, or an empty string."""
    found = RAW.search(text)
    return found[0] if found else ""


def run(
    attempt: Attempt,
    seeds: range,
    processes: int = 1,
    seconds: float = SECONDS,
    memory: int = MEMORY,
    most: Most | None = None,
) -> Iterator[Failure]:
    """Try every seed and yield the failures; ``most`` records the longest time and the largest memory."""
    most = Most() if most is None else most
    waiting = iter(seeds)
    with tempfile.TemporaryDirectory(prefix="fuzz") as folder:
        workers = [_Worker(attempt, Path(folder) / str(i), seconds, memory, most) for i in range(processes)]
        try:
            busy = [w for w in workers if w.give(next(waiting, None))]
            while busy:
                ready = wait([w.pipe for w in busy], timeout=0.2)
                for w in list(busy):
                    if (failed := w.look(w.pipe in ready)) is not None:
                        yield failed
                    if w.seed is None and not w.give(next(waiting, None)):
                        busy.remove(w)
        finally:
            for w in workers:
                w.end()


class _Worker:
    """A process that tries one seed after another and is replaced when it hangs or dies."""

    def __init__(self, attempt: Attempt, folder: Path, seconds: float, memory: int, most: Most) -> None:
        self.attempt, self.folder, self.seconds, self.memory, self.most = attempt, folder, seconds, memory, most
        self.seed: int | None = None
        self.begin()

    def begin(self) -> None:
        shutil.rmtree(self.folder, ignore_errors=True)
        self.folder.mkdir()
        self.what, self.left = "", _LIFE
        self.pipe, theirs = multiprocessing.Pipe()
        args = self.attempt, theirs, self.pipe, self.folder, self.memory
        self.process = multiprocessing.get_context("fork").Process(target=_work, args=args)
        self.process.start()
        theirs.close()

    def give(self, seed: int | None) -> bool:
        """Send a seed to the process; return False if no seed is left."""
        if seed is None:
            return False
        if self.left == 0:
            self.end()
            self.begin()
        self.seed, self.what, self.started = seed, "", time.monotonic()
        self.left -= 1
        self.cpu = self.spent()
        self.pipe.send(seed)
        return True

    def look(self, ready: bool) -> Failure | None:
        """Process a message or a timeout and return the failure, if any; ``seed`` is None once it is finished."""
        wrong: Wrong | None
        taken = 0
        if ready:
            try:
                kind, value, taken = self.pipe.recv()
            except (EOFError, ConnectionResetError):
                self.process.join(5)
                kind, value = "done", Wrong("died", "", f"the process ended with {self.process.exitcode}")
                self.left = 0
            if kind == "what":
                self.what = value
                return None
            wrong = value
        elif self.spent() - self.cpu > self.seconds or time.monotonic() - self.started > 3 * self.seconds:
            wrong, self.left = Wrong("hang", self.stuck(), f"not done after {self.seconds:g} s"), 0
        else:
            return None
        seed, self.seed = self.seed, None
        assert seed is not None
        self.most.see(seed, self.what, self.spent() - self.cpu, taken)
        if wrong is not None and wrong.kind == "memory":
            self.left = 0  # the memory may not have been released
        return None if wrong is None else Failure(seed, self.what, wrong)

    def spent(self) -> float:
        """Return the processor time of the worker in seconds."""
        try:
            fields = Path(f"/proc/{self.process.pid}/stat").read_text().rpartition(")")[2].split()
        except OSError:
            return 0.0
        return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")

    def stuck(self) -> str:
        """Return the functions of hbgear in which the worker hangs."""
        with suppress(ProcessLookupError):
            os.kill(self.process.pid or 0, signal.SIGUSR1)
        time.sleep(0.5)
        text = (self.folder / "stuck.txt").read_text()
        return (
            " > ".join(reversed(re.findall(r'hbgear/(\w+\.py)", line \d+ in \w+', text)[:3]))
            + " "
            + " < ".join(re.findall(r'File ".*?", line \d+ in (\w+)', text)[:4])
        )

    def end(self) -> None:
        """Kill the worker and its child processes."""
        with suppress(ProcessLookupError, PermissionError):
            os.killpg(self.process.pid or 0, signal.SIGKILL)
        self.process.kill()
        self.process.join()
        self.pipe.close()


def _work(attempt: Attempt, pipe: Connection, parents: Connection, folder: Path, memory: int) -> None:
    parents.close()  # so that the pipe ends when the parent is killed
    os.setsid()  # so that the parent can kill it with its children
    with open(folder / "stuck.txt", "w") as stuck:
        faulthandler.register(signal.SIGUSR1, stuck)
        resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
        pages = int(Path("/proc/self/statm").read_text().split()[0])
        resource.setrlimit(resource.RLIMIT_AS, (pages * resource.getpagesize() + _CEILING,) * 2)
        while True:
            try:
                seed = pipe.recv()
            except EOFError:
                return
            pipe.send(("done", *_tried(attempt, seed, folder, lambda text: pipe.send(("what", text, 0)), memory)))
            gc.collect(0)


def _tried(attempt: Attempt, seed: int, folder: Path, note: Note, memory: int) -> tuple[Wrong | None, int]:
    """Return the invalid outcome, if any, and the increase of the memory in bytes."""
    before = _peak_memory()
    try:
        with warnings.catch_warnings(action="always"):
            warnings.showwarning = lambda *_, **__: None  # type: ignore[assignment]
            wrong = attempt(seed, folder, note)
    except BaseException as error:
        wrong = Wrong("traceback", place(error), f"{error!r}"[:400])
    taken = _peak_memory(reset=False) - before
    if taken > memory:
        wrong = Wrong("memory", wrong.where if wrong else "", f"{taken / 2**20:.0f} MB")
    return wrong, taken


def _peak_memory(reset: bool = True) -> int:
    """Return the peak memory of the process in bytes; ``reset`` first sets the peak to the current memory."""
    if reset:
        Path("/proc/self/clear_refs").write_text("5")
    found = re.search(r"VmHWM:\s+(\d+) kB", Path("/proc/self/status").read_text())
    assert found is not None
    return int(found[1]) * 1024


def main(name: str, make: Callable[[], Any]) -> None:
    """Run a fuzzer from the command line; ``make()`` returns its attempt."""
    parser = argparse.ArgumentParser(prog=f"python -m tests.fuzz.{name}")
    parser.add_argument("--count", type=int, default=1000, help="how many inputs")
    parser.add_argument("--seed", type=int, default=0, help="the first; the others are the numbers after it")
    parser.add_argument("--processes", type=int, default=1)
    parser.add_argument("--seconds", type=float, default=SECONDS, help="an input that takes longer hangs")
    asked = parser.parse_args()
    started, failures, most = time.monotonic(), [], Most()
    seeds = range(asked.seed, asked.seed + asked.count)
    for failure in run(make(), seeds, asked.processes, asked.seconds, most=most):
        failures.append(failure)
        wrong = failure.wrong
        print(f"seed {failure.seed}: {wrong.kind}: {wrong.where}: {wrong.text}\n    {failure.what}", flush=True)
    print(report(failures))
    print(most)
    took = time.monotonic() - started
    print(f"{name}: {asked.count} inputs in {took:.0f} s, {len(failures)} failed")
    raise SystemExit(1 if failures else 0)


def report(failures: list[Failure]) -> str:
    """Return the distinct causes as text, the most frequent first, each with one input."""
    causes: dict[tuple[str, str], list[Failure]] = {}
    for failure in failures:
        causes.setdefault((failure.wrong.kind, failure.wrong.where), []).append(failure)
    lines = [
        f"{len(each)} x {kind}: {where}\n    seed {each[0].seed}: {each[0].what}\n    {each[0].wrong.text}"
        for (kind, where), each in sorted(causes.items(), key=lambda item: -len(item[1]))
    ]
    return "\n".join(lines)
