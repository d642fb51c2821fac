"""Common parts of the studies: command line, folders and style of figures.

A study is a module with a docstring, whose first line describes the figure in one sentence, and

    run(quick=False)   returns the results; ``quick`` is a reduced form with the same parts, for the tests
    plot(results)      returns the figure (`matplotlib.figure.Figure`)
    report(results)    returns text in Markdown; a study has a figure, a report or both
    ALONE = True       optional: the study measures time and must run alone
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
    """Apply the settings of figures for print."""
    import matplotlib

    matplotlib.use("Agg")
    from hbgear.plot import STYLE

    with matplotlib.rc_context(STYLE):
        yield


def folder(module: ModuleType) -> Path:
    """Return the folder of the figures of a study."""
    assert module.__file__
    return Path(module.__file__).parent / "figures"


def make(name: str, out: Path | None = None, quick: bool = False, kinds: Sequence[str] = ("png",)) -> list[Path]:
    """Run a study and write its figure (.png) and its report (.md).

    Parameters
    ----------
    name : str
        Name of the module, ``studies.dong_2022.fig04``.
    out : Path, optional
        Folder of the files. By default `folder`.
    quick : bool, optional
        Argument of ``run``. By default False.
    kinds : sequence of {"png", "pdf", "svg"}, optional
        Formats of the figure. By default "png".

    Returns
    -------
    list of Path
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
    """Let Ctrl-C end the study without writing files: a trace would return a part of the curve."""
    raise SystemExit(3)


def draw(plot: Any, results: Any, stem: Path, kinds: Sequence[str] = ("png",)) -> list[Path]:
    """Write the figure in files of the given formats."""
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
    """Run the command line of a study, ``python -m``."""
    spec = sys.modules["__main__"].__spec__
    assert spec is not None
    name = spec.name
    parser = argparse.ArgumentParser(
        prog=f"python -m {name}",
        description=sys.modules["__main__"].__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument(
        "-o", "--out", type=Path, help="folder for the figure (default: figures, in the folder of the study)"
    )
    parser.add_argument("--quick", action="store_true", help="reduced size as in the tests")
    parser.add_argument("--pdf", action="store_true", help="also write the figure as .pdf; git ignores it")
    given = parser.parse_args()
    for path in make(name, given.out, given.quick, ("png", "pdf") if given.pdf else ("png",)):
        if path.suffix == ".md":
            print(path.read_text(encoding="utf-8"))
        print(f"wrote {path}")
