"""Random command lines of hbgear: every command and option of the application, with valid and invalid values.

    python -m tests.fuzz.commands --count 3000 --seed 0 --processes 2

The exit code of a command is 0, 2 or 3 (also 1 for ``certify``, ``redesign`` and ``validate``), without a traceback.
If it is 2, each error is reported in a line that begins with ``hbgear: error:``.
"""

from __future__ import annotations

import io
import itertools
import os
import re
import shlex
import shutil
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager, redirect_stderr, redirect_stdout, suppress
from pathlib import Path
from typing import Any

import numpy as np

from . import pool

MEASURED = ["measured.csv", "speeds.csv", "directions.csv", "broken.csv", "cell.csv"]
"""Tables of measured points among the files of `files.small_files`."""

Random = np.random.Generator

MODELS = ["spur-pair", "duffing", "duffing", "rotor-bearing", "double-helical", "no-such", "", "Spur-Pair", "spur pair"]
NAMES = ["zeta", "F_m", "b", "e", "eps", "k3", "F", "Omega", "phase", "nope", "", "e_scale", "torque", "b_c", "k_mean"]
NUMBERS = [
    "0.05",
    "0.1",
    "1",
    "0.3",
    "1.5",
    "2",
    "0",
    "-1",
    "-0.5",
    "1e-300",
    "1e300",
    "inf",
    "nan",
    "-inf",
    "x",
    "",
    "1,2",
    "0.05,0.02",
    "0.1,,0.2",
    "12000",
    "80",
    "1_000",
    "٣",
    "0x10",
    "1e",
    "True",
    "1" * 400,
]
COUNTS = ["1", "2", "3", "0", "-1", "1.5", "x", "", "99999999", "1" * 30, "+2", "²", "inf"]
SPANS = {"--from": ["0.8", "0.5", "1.5", "0.05"], "--to": ["1.1", "0.3", "0.9", "0.2"]}
TEXTS = ["", "x", "LP1", "GR1", "PD1", "0.9", "1.0", "rms", "H1", "H0", "H99999999999", "'", "a\nb", "é", "--", "../x"]
MEASURES = ["pp2", "rms", "max", "mean", "H1", "H2", "H1/2", "H0", "H99", "h1", "", "pp", "H1/0", "H" + "9" * 5000]
ELEMENTS = ["0", "1", "-1", "mesh", "spring", "x", "", "9" * 30, "²", "0.0"]
FIXED = {
    "trace": ["--max-points", "12", "--harmonics", "3"],
    "map": ["--harmonics", "3", "--seeds", "2"],
    "critical": ["--harmonics", "3"],
    "survey": ["--harmonics", "3", "--frequencies", "1", "--guesses", "1"],
    "sweep": ["--count", "2", "--max-periods", "20", "--tolerance", "1e-2"],
    "validate": ["--points", "1"],
    "redesign": ["--harmonics", "2", "--from", "1.4", "--to", "0.8"],
    "fit": ["--harmonics", "2", "--starts", "1"],
    "study": ["--processes", "1"],
    "explore": ["--no-browser"],
    "basins": ["--shape", "6,6", "--tolerance", "1e-2"],
    "backbone": ["--harmonics", "3", "--amplitudes", "0.01:0.05"],
    "cycles": ["--harmonics", "3"],
    "gear": ["--harmonics", "2"],
}
"""Options that keep a valid command short; a random option after them may override them."""

WEIGHTS = {
    "trace": 8,
    "info": 3,
    "jumps": 2,
    "plot": 1,
    "validate": 1,
    "switch": 2,
    "sweep": 2,
    "critical": 1,
    "map": 1,
    "survey": 1,
    "study": 1,
    "basins": 1,
    "models": 0.2,
    "campbell": 1,
    "explore": 3,
    "report": 4,
    "sensitivity": 4,
    "fit": 3,
}


def run_command(args: list[str], folder: Path) -> tuple[int | None, str, str, BaseException | None]:
    """Return the exit code, standard output, standard error, and the exception raised instead of an exit."""
    from hbgear.cli import app

    out, err = io.StringIO(), io.StringIO()
    here = os.getcwd()
    os.chdir(folder)
    try:
        with redirect_stdout(out), redirect_stderr(err), _nothing_served():
            app.main(args)
    except SystemExit as end:
        return int(end.code or 0) if isinstance(end.code, int | None) else 99, out.getvalue(), err.getvalue(), None
    except BaseException as error:
        return None, out.getvalue(), err.getvalue(), error
    finally:
        os.chdir(here)
        _close_figures()
    return None, out.getvalue(), err.getvalue(), RuntimeError("the command did not exit")


@contextmanager
def _nothing_served() -> Iterator[None]:
    """Replace the server of the explorer: it computes its page and one curve, and ends; no browser is opened."""
    import webbrowser
    from unittest import mock

    from hbgear.web.server import Server

    def once(server: Any) -> None:
        served = server.explorer
        server._server.server_close()
        served.start()
        values = {each.name: each.value for each in served.subject.parameters()}
        with suppress(ValueError, KeyError, NoConvergence):  # errors that the page shows
            served.curve("s", Request(values, served.span, 2))

    from hbgear import NoConvergence
    from hbgear.web.explorer import Request

    with mock.patch.object(Server, "run", once), mock.patch.object(webbrowser, "open", lambda address: True):
        yield


def absurd(args: list[str]) -> str:
    """Return an implausible option with its value, as of a wrong unit or a missing number, or an empty string."""
    given = {(a, b) for a, b in itertools.pairwise(args)}
    if args[0] in ("trace", "sweep", "survey", "critical", "map"):
        frequency = {"--omega-from", "--omega-to"} | (
            set() if {"--parameter", "--in"} & set(args) else {"--from", "--to"}
        )
        for option, value in given:
            if option in frequency and value in ("12000", "1e300", "1" * 400):
                return f"{option} {value[:9]}"
            if option == "--set" and (
                "=0.1,,0.2" in value or value in ("b_c=80", "b=12000", "b=1e300", "zeta=1e300", "b_c=1")
            ):
                return f"{option} {value}"
    return ""


def _close_figures() -> None:
    if "matplotlib.pyplot" in sys.modules:
        sys.modules["matplotlib.pyplot"].close("all")


def judged(args: list[str], folder: Path) -> pool.Wrong | None:
    """Run a command and return its invalid outcome, if any."""
    code, out, err, error = run_command(args, folder)
    name = args[0] if args else ""
    if error is not None:
        return pool.Wrong("traceback", pool.place(error), repr(error)[:300])
    lines = err.splitlines()
    errors = [line for line in lines if line.startswith("hbgear: error: ")]
    if code not in (0, 2, 3) and not (code == 1 and name in ("certify", "redesign", "validate")):
        return pool.Wrong("exit", name, f"exit code {code}: {err[-300:]}")
    if strange := [line for line in lines if not line.startswith(("hbgear: error: ", "hbgear: warning: ", "hbgear: "))]:
        return pool.Wrong("stderr", name, strange[0][:300])
    several = any(str(arg).endswith(".toml") for arg in args)  # every error of a file is reported
    if code == 2 and not (errors if several else len(errors) == 1):
        return pool.Wrong("exit", name, f"exit code 2 with {len(errors)} errors: {err[:300]!r}")
    if code == 2 and out and name not in ("study",) and "wrote" in out:
        return pool.Wrong("exit", name, f"exit code 2 after it said that it wrote: {out[-200:]!r}")
    for line in lines:
        if words := pool.raw_words(line):
            return pool.Wrong("raw", f"{name}: {words}", line[:300])
        if len(line) > 2000:
            return pool.Wrong("raw", f"{name}: a line of {len(line)} characters", line[:300])
    if code in (0, 3) and not lines and (meant := absurd(args)):
        return pool.Wrong("nonsense", f"{name} takes {meant} without a word", out[:200])
    if code == 0 and not lines and (found := re.search(r".*\b(nan|inf)\b.*", out)):
        return pool.Wrong("nonsense", f"{name} prints {found[1]}", found[0].strip()[:300])
    return None


def value_for(rng: Random, command: str, option: str, files: list[str]) -> str:
    """Return a random value of an option or argument, by its name."""
    pick: Callable[[list[str]], str] = lambda words: words[rng.integers(len(words))]  # noqa: E731
    good = rng.random() < 0.6
    table: dict[str, list[str]] = {
        "model": MODELS[:4] if good else MODELS,
        "file": files if command != "study" else ["good.toml", *files, "no.toml"],
        "over": files,
        "parameter": ["zeta", "zeta", "F_m", "k3", "F", "b"] if good else NAMES,
        "--parameter": ["Omega", "zeta", "F_m", "F", "b", "e_scale"] if good else NAMES,
        "--in": ["zeta=0.05:0.08", "F=0.17:0.2", "b=1:0.8", "zeta"] if good else [*NAMES, "zeta=1:x", "b=-1:1", "=1:2"],
        "--harmonics": ["2", "3", "4", "auto"] if good else [*COUNTS, "AUTO"],
        "--measure": MEASURES[:6] if good else MEASURES,
        "--element": ["0", "spring", "mesh"] if good else ELEMENTS,
        "--output": ["out.npz", "out.csv", "out.mat"]
        if good
        else ["", "x", "no/out.npz", ".", "out.NPZ", "o" * 300 + ".npz", "o" * 248 + ".npz", "/proc/x.npz"],
        "--plot": ["out.svg"] if good else ["out.jpg", "", "no/out.png", ".png", "p" * 250 + ".png", "/proc/x.png"],
        "--point": ["LP1", "GR1", "0.9", "1.0"] if good else [*TEXTS, *NUMBERS],
        "points": ["LP1", "LP2", "GR1"] if good else [*TEXTS, *NUMBERS],
        "--amplitudes": ["0.01:0.05", "0.1:0.2"]
        if good
        else ["0.1", ":", "0.2:0.1", "0:1", "-1:1", "nan:1", "1e300:1"],
        "--friction": ["0.05", "0"] if good else ["-1", "2", "nan", "0.05 N", "5 %", *TEXTS],
        "--z": ["25,40", "25,-70"] if good else ["25", "0,40", "-25,40", "1e9,1e9", *TEXTS],
        "--module": ["3 mm"] if good else ["3", "0 mm", "3 N", "nan mm", *TEXTS],
        "--width": ["20 mm"] if good else ["20", "-1 mm", "inf mm", *TEXTS],
        "--torque": ["200 N m", "-200 N m"] if good else ["200", "0 N m", "1e300 N m", *TEXTS],
        "--backlash": ["80 um"] if good else ["80", "0 um", "-80 um", "1 km", *TEXTS],
        "--mode": ["1"] if good else COUNTS,
        "point": ["LP1", "GR1", "jump1", "peak", "0.9", *TEXTS],
        "data": ["measured.csv", "directions.csv", "speeds.csv"] if good else ["no.csv", *MEASURED, *files],
        "--measured": ["measured.csv", "speeds.csv"] if good else ["no.csv", *MEASURED, *files],
        "files": files,
        "what": ["duffing", "spur-pair", "good.toml", *files] if good else [*MODELS, "sample.toml", "no.toml", *files],
        "--study": ["no", ".", "measured.csv", *files],
        "--title": TEXTS,
        "--port": ["0", "0", "1", "-1", "65536", "x"] if not good else ["0"],
        "--validate": ["0", "1"] if good else COUNTS[:6],
        "--column": ["frequency=Omega", "amplitude=amplitude"] if good else ["x=y", "=", "frequency", "amplitude=é"],
        "--unit": ["Omega", "mesh Hz", "Hz", "r/min"] if good else TEXTS,
        "--length": ["um", "m", "mm"] if good else ["s", "N", *TEXTS],
        "--sort-by": ["Omega", "amplitude", "value", *TEXTS],
        "--free": ["zeta", "zeta=0.01:0.2", "e[0]"] if good else NAMES,
        "--curve": files,
        "label": ["LP1", "PD1", "BP1", "GR1", *TEXTS],
        "--max-periods": ["20", "30", "100"] if good else COUNTS,
    }
    table["--bifurcation"] = table["--plot"]
    if option in ("--set", "--at"):
        if not good and rng.random() < 0.3:
            return pick(
                ["", "=", "zeta", "zeta=", "=1", "zeta==1", " zeta = 0.05 ", "phase=sin", "e=(0.1,0.2)", "tilt=maybe"]
            )
        known = (
            ["Omega=0.9", "Omega=1.1"]
            if option == "--at"
            else ["zeta=0.05", "e=0.05,0.02", "F=0.18", "k3=0.1", "b=0.5"]
        )
        return pick(known) if good else f"{pick(NAMES)}={pick(NUMBERS)}"
    if option in ("--omega-from", "--omega-to", *SPANS):
        usual = SPANS.get(option.replace("omega-", ""), NUMBERS)
        return pick(usual) if good else pick(NUMBERS)
    if option in table:
        return pick(table[option])
    if option in (
        "--count",
        "--seeds",
        "--frequencies",
        "--guesses",
        "--points",
        "--max-points",
        "--predictor-points",
        "--nu",
        "--samples",
        "--processes",
    ):
        return pick(["1", "2", "3", "10"]) if good else pick(COUNTS)
    return pick(NUMBERS if good else [*NUMBERS, *TEXTS])


def drawn(rng: Random, files: list[str]) -> list[str]:
    """Return a random command line."""
    import typer

    from hbgear.cli import app

    commands = typer.main.get_command(app.app).commands  # type: ignore[attr-defined]
    names = [*commands]
    weights = np.array([WEIGHTS.get(name, 1.0) for name in names])
    name = str(rng.choice(names, p=weights / weights.sum()))
    args: list[str] = []
    options = []
    for each in commands[name].params:
        if each.param_type_name == "argument":
            if rng.random() < 0.97:
                args.append(value_for(rng, name, each.name, files))
        else:
            options.append(each)
    args += FIXED.get(name, [])
    required = [o for o in options if o.required and rng.random() < 0.95]
    others = [o for o in options if not o.required]
    count = min(int(rng.geometric(0.35)) - 1, len(others))
    chosen = [*required, *(others[i] for i in rng.choice(len(others), count, replace=False))] if others else required
    for option in chosen:
        flag = option.opts[-1] if rng.random() < 0.97 else option.opts[-1][: len(option.opts[-1]) // 2]
        args.append(flag)
        if not option.is_flag and rng.random() < 0.98:
            args.append(value_for(rng, name, option.opts[-1], files))
    args = [name, *args]
    if rng.random() < 0.04:  # any word at any position
        junk = ["--nope", "-x", "extra", "", "--", "--help", "-h", "@", "\u202e", "--set", "--from=1", "-o"]
        args.insert(int(rng.integers(len(args) + 1)), str(rng.choice(junk)))
    return args


def make() -> pool.Attempt:
    """Return the attempt of this fuzzer."""
    from .files import small_files

    saved = small_files()

    def attempt(seed: int, folder: Path, note: pool.Note) -> pool.Wrong | None:
        rng = np.random.default_rng([3, seed])
        work = folder / "work"
        work.mkdir(exist_ok=True)
        for name, content in saved.items():
            (work / name).write_bytes(content)
        known = [name for name in saved if not name.endswith(".csv")]
        args = drawn(rng, [*known, *known, *known, *known, "no.npz", ".", ""])
        note("hbgear " + shlex.join(args)[:600])
        wrong = judged(args, work)
        for path in work.iterdir():
            if path.is_file():
                path.unlink()
            else:
                shutil.rmtree(path)
        return wrong

    return attempt


if __name__ == "__main__":
    pool.main("commands", make)
