"""Time of the first command after an installation, which compiles the core, and of later ones, from start to end.

    python -m studies.speed.commands [--quick] [-o DIR]

Each is a process of its own, and the processor's time is that of all processes it starts. First commands find an empty
folder for kernels, later ones what the last of these left. Python has its own compiled files before.
"""

from __future__ import annotations

import os
import subprocess
import sys
import time
from pathlib import Path
from statistics import median
from tempfile import TemporaryDirectory
from typing import Any

from studies import study

ALONE = True

MODELS = ("spur-pair", "double-helical")


def timed(model: str, folder: Path | None = None) -> tuple[float, float]:
    """Seconds that `hbgear trace` takes with a folder for kernels, or the usual one, and those of the processor."""
    kept = {} if folder is None else {"NUMBA_CACHE_DIR": str(folder)}
    before, start = os.times(), time.perf_counter()
    subprocess.run(
        [sys.executable, "-m", "hbgear", "trace", model],
        env={**os.environ, **kept},
        check=True,
        capture_output=True,
        cwd=study.ROOT.parent,
    )
    after = os.times()
    busy = after.children_user + after.children_system - before.children_user - before.children_system
    return time.perf_counter() - start, busy


def row(model: str, which: str, found: list[tuple[float, float]]) -> dict[str, Any]:
    """Medians of some commands."""
    real, busy = zip(*found, strict=True)
    return {
        "model": model,
        "which": which,
        "runs": len(found),
        "median": median(real),
        "worst": max(real),
        "processor": median(busy),
    }


def run(quick: bool = False) -> list[dict[str, Any]]:
    """One row for each model and first and later commands; quick: one later command, with the kernels there are."""
    if quick:
        return [row("spur-pair", "later", [timed("spur-pair")])]
    rows = []
    for model in MODELS:
        timed(model)
        with TemporaryDirectory() as parent:
            folders = [Path(parent) / str(i) for i in range(3)]
            rows.append(row(model, "first", [timed(model, folder) for folder in folders]))
            rows.append(row(model, "later", [timed(model, folders[-1]) for _ in range(11)]))
    return rows


def report(rows: list[dict[str, Any]]) -> str:
    """Table in Markdown."""
    lines = [
        "| `hbgear trace` | command | runs | median [s] | worst [s] | processor [s] |",
        "| --- | --- | --- | --- | --- | --- |",
    ]
    for each in rows:
        lines.append(
            f"| {each['model']} | {each['which']} | {each['runs']} | {each['median']:.2f} | {each['worst']:.2f} "
            f"| {each['processor']:.2f} |"
        )
    return "\n".join([*lines, ""])


if __name__ == "__main__":
    study.main()
