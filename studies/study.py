"""What every study shares: how it is run, where its figures go, and how they look.

A study is a module with a docstring whose first line says in one sentence what its figure shows, and

    run(quick=False)   the results; ``quick`` is a smaller form with the same parts, for the tests
    plot(results)      the figure (`matplotlib.figure.Figure`)
    report(results)    text in Markdown, a table for instance; a study has a figure, a report or both
    ALONE = True       optional: it measures time, so nothing else may run beside it
"""

from __future__ import annotations

import argparse
import importlib
import signal
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from types import FrameType, ModuleType
from typing import Any

from threadpoolctl import threadpool_limits

from hbgear.common.process.signals import signal_handlers

ROOT = Path(__file__).parent

BLUE, ORANGE, PURPLE, GREEN, GREY = "#1f4e8c", "#d9730d", "#9c1f5c", "#2f7d4f", "#8a8a8a"
"""Colours of several curves in one figure, in this order."""


@contextmanager
def journal() -> Iterator[None]:
    """Settings of a figure for print, while it is made."""
    import matplotlib

    matplotlib.use("Agg")
    from hbgear.plot import STYLE

    with matplotlib.rc_context(STYLE):
        yield


def folder(module: ModuleType) -> Path:
    """Where the figures of a study are kept: ``figures`` beside it."""
    assert module.__file__
    return Path(module.__file__).parent / "figures"


def make(name: str, out: Path | None = None, quick: bool = False, kinds: Sequence[str] = ("png",)) -> list[Path]:
    """Run a study and write its figure (.png) and its report (.md).

    Parameters
    ----------
    name : of its module, ``studies.dong_2022.fig04``.
    out : folder to write to, by default `folder`.
    quick : see `run` of the study.
    kinds : of figures, "png", "pdf" or "svg".

    Returns
    -------
    The files written.
    """
    module: Any = importlib.import_module(name)
    stem, out = name.rsplit(".", 1)[-1], out or folder(module)
    out.mkdir(parents=True, exist_ok=True)
    with threadpool_limits(1), signal_handlers(_end, signal.SIGINT):
        results = module.run(quick=quick)
    written = [] if not hasattr(module, "plot") else draw(module.plot, results, out / stem, kinds)
    if hasattr(module, "report"):
        path = out / f"{stem}.md"
        path.write_text(module.report(results), encoding="utf-8")
        written.append(path)
    return written


def _end(number: int, frame: FrameType | None) -> None:
    """Ctrl-C ends the whole study and writes nothing: a trace alone would keep half a curve."""
    raise SystemExit(3)


def draw(plot: Any, results: Any, stem: Path, kinds: Sequence[str] = ("png",)) -> list[Path]:
    """Write the figure of these results in files of these kinds."""
    with journal():
        import matplotlib.pyplot as plt

        from hbgear.plot import save

        figure = plot(results)
        paths = [stem.with_suffix(f".{kind}") for kind in kinds]
        for path in paths:
            save(figure, path, dpi=160)
        plt.close(figure)
    return paths


def main() -> None:
    """Command line of a study that is run as ``python -m``."""
    spec = sys.modules["__main__"].__spec__
    assert spec is not None
    name = spec.name
    parser = argparse.ArgumentParser(prog=f"python -m {name}", description=sys.modules["__main__"].__doc__,
                                     formatter_class=argparse.RawDescriptionHelpFormatter)  # fmt: skip
    parser.add_argument("-o", "--out", type=Path, help="folder for the figure (default: figures beside the study)")
    parser.add_argument("--quick", action="store_true", help="a smaller form, as the tests run it")
    parser.add_argument("--pdf", action="store_true", help="the figure as .pdf too; git ignores it beside the study")
    given = parser.parse_args()
    for path in make(name, given.out, given.quick, ("png", "pdf") if given.pdf else ("png",)):
        if path.suffix == ".md":
            print(path.read_text(encoding="utf-8"))
        print(f"wrote {path}")
