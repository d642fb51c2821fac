"""What all tests share: one thread for linear algebra, random numbers, differences. This folder is on the path, so that
tests anywhere can ``from cross.shooting import ...``; so is the root, for ``from studies import ...``."""

import importlib
import os
import signal
import sys
from pathlib import Path

for _name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ.setdefault(_name, "1")

sys.path.append(str(Path(__file__).parents[1]))  # after everything else: `studies`, but the installed hbgear

import numpy as np  # noqa: E402
import pytest  # noqa: E402

if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:  # started in the background, where shells have Ctrl-C ignored
    signal.signal(signal.SIGINT, signal.default_int_handler)


def pytest_sessionstart():
    """Compile the large kernels in two workers of pytest-xdist: those of tracing in one, of stability in the other."""
    worker = os.environ.get("PYTEST_XDIST_WORKER")
    if worker not in ("gw0", "gw1"):
        return
    import hbgear as hb

    for stiffness in (None, hb.mechanics.Periodic.rectangular(1.2, 0.8, 0.3)):  # without and with breakpoints
        problem = hb.HarmonicBalance(hb.SpurPair(stiffness=stiffness), 5)
        if worker == "gw0":
            hb.trace(problem, "Omega", (0.8, 0.81), stability=False, special=False)
        else:
            problem.observe(np.ones(problem.size), Omega=0.8)


@pytest.fixture(autouse=True)
def figures_are_closed():
    """Figures that a test leaves open would be counted, and warned of, in another one."""
    yield
    if "matplotlib.pyplot" in sys.modules:
        sys.modules["matplotlib.pyplot"].close("all")


REGISTRIES = {
    "hbgear.mechanics.laws.registry": ("LAWS", "_BY_CLASS"),
    "hbgear.continuation.events.registry": ("EVENTS",),
    "hbgear.mechanics.series.measures": ("MEASURES",),
}


@pytest.fixture(autouse=True)
def registries_are_restored():
    """Laws, events and measures that a test registers are unknown to the next one."""
    importlib.import_module("hbgear.harmonic.bifurcations.events")  # registers the built-in events
    tables = [getattr(importlib.import_module(module), name) for module in REGISTRIES for name in REGISTRIES[module]]
    known = [dict(table) for table in tables]
    yield
    for table, before in zip(tables, known, strict=True):
        if table != before:
            table.clear()
            table.update(before)


@pytest.fixture(autouse=True)
def modules_are_forgotten(monkeypatch):
    """Modules and folders that a test imports, such as files of models, are unknown to the next one."""
    monkeypatch.setattr(sys, "path", [*sys.path])
    before = set(sys.modules)
    yield
    for name in set(sys.modules) - before:
        if name in ("helper", "mine") or name.endswith("mine.py"):
            del sys.modules[name]


@pytest.fixture
def run(capsys, tmp_path, monkeypatch):
    """Run the command ``hbgear`` in an empty folder: ``(exit code, stdout, stderr)``; words, or one line of words."""
    from hbgear.cli.app import main

    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("COLUMNS", "200")

    def call(*words):
        with pytest.raises(SystemExit) as stop:
            main(words[0].split() if len(words) == 1 else [str(word) for word in words])
        return stop.value.code, *capsys.readouterr()

    return call


@pytest.fixture
def rng():
    """Random numbers that are the same in every run."""
    return np.random.default_rng(2022)


@pytest.fixture
def on_path(monkeypatch):
    """The folder of the project on the path, so that ``studies`` can be imported."""
    monkeypatch.syspath_prepend(str(Path(__file__).parents[1]))


@pytest.fixture
def slope():
    """Fourth-order central difference of a function of one number (or along a direction, f(x + h direction))."""

    def difference(f, x=0.0, h=1e-3):
        return (8 * (f(x + h) - f(x - h)) - (f(x + 2 * h) - f(x - 2 * h))) / (12 * h)

    return difference
