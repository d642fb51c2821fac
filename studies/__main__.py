"""Run all studies, or some. Studies with existing figures and unchanged sources are skipped.

    python -m studies [NAME ...] [--quick] [-o DIR] [--jobs N] [--again] [--list] [--gallery]

NAME is a study (dong_2022.fig04) or a folder of studies (dong_2022). Several studies run at once, each in a process
with one BLAS thread. Studies that measure time run alone after the others. ``studies/README.md`` is the gallery.
"""

from __future__ import annotations

import argparse
import hashlib
import importlib
import json
import multiprocessing
import os
import pkgutil
import sys
import time
from collections.abc import Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from pathlib import Path
from typing import Any

from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn, TimeRemainingColumn

import hbgear
from hbgear.common.atomic_write import atomic_write
from studies import study
from studies.gallery import gallery

MADE = study.ROOT / ".made.json"
"""Hashes of the sources of existing figures; not under version control."""


def names() -> list[str]:
    """Return the names of all studies: modules with a function ``run``."""
    found = []
    for info in pkgutil.walk_packages([str(study.ROOT)], "studies."):
        if not info.ispkg and info.name.count(".") == 2:
            module = importlib.import_module(info.name)
            if hasattr(module, "run"):
                found.append(info.name)
    return sorted(found)


def chosen(wanted: Sequence[str]) -> list[str]:
    """Return the selected studies, by default all.

    Raises
    ------
    ValueError
        If there is no such study.
    """
    known = names()
    if not wanted:
        return known
    full = [w if w.startswith("studies.") else f"studies.{w}" for w in wanted]
    for name in full:
        if not any(k == name or k.startswith(name + ".") for k in known):
            raise ValueError(f"no study '{name}'; there are\n  " + "\n  ".join(known))
    return [k for k in known if any(k == name or k.startswith(name + ".") for name in full)]


def fingerprint(name: str) -> str:
    """Return the hash of the sources of a figure: hbgear, the study, and the studies that it imports."""
    own = study.ROOT / name.split(".")[1]
    sources = [*Path(hbgear.__file__).parent.rglob("*.py"), *own.glob("*.py"), *study.ROOT.glob("*.py")]
    skipped = {path for path in own.glob("*.py") if f"studies.{own.name}.{path.stem}" in set(names()) - {name}}
    digest = hashlib.sha256()
    for path in sorted(set(sources) - skipped):
        digest.update(path.name.encode() + b"\0" + path.read_bytes())
    return digest.hexdigest()


def is_made(name: str, made: dict[str, Any]) -> bool:
    """Return whether the files of a study exist and its sources are unchanged."""
    here = made.get(name)
    return bool(here) and here["fingerprint"] == fingerprint(name) and all(map(os.path.exists, here["files"]))


def make_all(todo: Sequence[str], out: Path | None, quick: bool, jobs: int, made: dict[str, Any]) -> list[str]:
    """Run studies and store their hashes; return failures with their reasons. Ctrl-C keeps finished studies."""
    columns = TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeElapsedColumn()
    failed: list[str] = []
    with Progress(*columns, TextColumn("left"), TimeRemainingColumn()) as bar:
        task = bar.add_task("studies", total=len(todo))
        alone = [n for n in todo if getattr(importlib.import_module(n), "ALONE", False)]
        for group, workers in (([n for n in todo if n not in alone], jobs), (alone, 1)):
            failed += _in_processes(group, workers, out, quick, made, lambda text: _tell(bar, task, text))
    return failed


def _tell(bar: Progress, task: Any, text: str) -> None:
    bar.console.print(text, highlight=False)
    bar.advance(task)


def _in_processes(
    group: Sequence[str], workers: int, out: Path | None, quick: bool, made: dict[str, Any], report: Any
) -> list[str]:
    failed: list[str] = []
    if not group:
        return failed
    pool = ProcessPoolExecutor(workers, multiprocessing.get_context("spawn"))
    begun = time.monotonic()
    # functions of __main__ cannot be submitted: the processes do not import it
    running: dict[Future[list[Path]], str] = {pool.submit(study.make, name, out, quick): name for name in group}
    try:
        while running:
            for future in wait(running, return_when=FIRST_COMPLETED).done:
                name = running.pop(future)
                error = future.exception()
                if error is not None:
                    failed.append(f"{name}: {type(error).__name__}: {error}")
                    report(f"failed  {failed[-1]}")
                    continue
                if out is None and not quick:
                    made[name] = {"fingerprint": fingerprint(name), "files": [str(path) for path in future.result()]}
                    with atomic_write(MADE, "w") as handle:
                        json.dump(made, handle, indent=1)
                report(f"made    {name}  ({time.monotonic() - begun:.0f} s since the start)")
    except KeyboardInterrupt:
        for process in list((pool._processes or {}).values()):
            process.terminate()
        raise
    finally:
        pool.shutdown(wait=False, cancel_futures=True)
    return failed


def main() -> int:
    """Run the command; exit code 1 if a study failed, 2 for bad input, 3 when interrupted."""
    parser = argparse.ArgumentParser(
        prog="python -m studies", description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("names", nargs="*", metavar="NAME")
    parser.add_argument("--quick", action="store_true", help="reduced size as in the tests; needs -o")
    parser.add_argument(
        "-o", "--out", type=Path, help="folder for all figures (default: figures, in the folder of each study)"
    )
    parser.add_argument("--jobs", type=int, default=os.cpu_count() or 1, help="how many at once")
    parser.add_argument("--again", action="store_true", help="run also unchanged studies")
    parser.add_argument("--list", action="store_true", help="list the studies and stop")
    parser.add_argument("--gallery", action="store_true", help="only write studies/README.md")
    given = parser.parse_args()
    try:
        todo = chosen(given.names)
        if given.quick and given.out is None:
            raise ValueError("--quick would replace the full figures by reduced ones; give a folder with -o DIR")
        if given.jobs < 1:
            raise ValueError(f"--jobs {given.jobs} must be at least 1")
    except ValueError as error:
        print(error, file=sys.stderr)
        return 2
    if given.list:
        print("\n".join(name.removeprefix("studies.") for name in todo))
        return 0
    failed: list[str] = []
    if not given.gallery:
        made = json.loads(MADE.read_text()) if MADE.exists() else {}
        skip = [] if given.again or given.out else [name for name in todo if is_made(name, made)]
        print(f"{len(skip)} of {len(todo)} studies exist and are unchanged")
        try:
            failed = make_all([n for n in todo if n not in skip], given.out, given.quick, given.jobs, made)
        except KeyboardInterrupt:
            print("stopped; finished studies are kept, and the next run continues with the others", file=sys.stderr)
            return 3
    if given.out is None:
        (study.ROOT / "README.md").write_text(gallery(names()), encoding="utf-8")
    print("\n".join(failed), file=sys.stderr)
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
