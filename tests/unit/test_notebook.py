"""What notebooks show: curves, models, progress."""

import base64
import io
import re
import sys
from types import SimpleNamespace

import matplotlib.pyplot as plt
import numpy as np
import pytest
from PIL import Image

import hbgear as hb
from hbgear.common.process import progress_bar


@pytest.fixture
def agg():
    before = plt.get_backend()
    plt.switch_backend("Agg")
    yield
    plt.close("all")
    plt.switch_backend(before)


def test_curve_is_a_table_and_a_figure(agg):
    curve = hb.trace(hb.HarmonicBalance(hb.Duffing(), 5), "Omega", (0.5, 1.6))
    shown = curve._repr_html_()
    assert "jumps of a slow sweep" in shown and "<td>LP1</td>" in shown and "Estimated relative error" in shown
    assert "&lt;Branch in Omega" in shown and "<Branch" not in shown
    found = re.search(r"base64,([^\"]+)", shown)
    assert found and Image.open(io.BytesIO(base64.b64decode(found[1]))).size[0] > 300
    assert plt.get_fignums() == []  # a notebook would show it twice


def test_curve_of_any_equations_is_printed():
    class Line:
        def evaluate(self, X, p):
            return X - p, np.eye(1)

    assert "Branch in p" in hb.trace(Line(), "p", (0, 1), np.array([0.0]))._repr_html_()


def test_model_is_a_table_with_units():
    shown = hb.gears.DoubleHelicalPair()._repr_html_()
    assert "<td><code>m_p</code></td><td>7.11</td><td>[kg]</td><td>m<sub>p</sub> </td>" in shown
    assert "$" not in shown


class Shell:
    """A notebook's kernel, as far as the bar asks it."""

    def __init__(self):
        self.kernel, self.shown, self.updates = object(), [], []

    def display(self, data, raw, display_id):
        self.shown.append(data["text/html"])
        return SimpleNamespace(update=lambda data, raw: self.updates.append(data["text/html"]))


def test_bar_in_a_notebook(monkeypatch):
    shell = Shell()
    monkeypatch.setattr(progress_bar, "_MIN_INTERVAL", 0.0)
    monkeypatch.setitem(sys.modules, "IPython", SimpleNamespace(get_ipython=lambda: shell))
    monkeypatch.setitem(sys.modules, "IPython.display", SimpleNamespace(display=shell.display))
    hb.trace(hb.HarmonicBalance(hb.Duffing(), 3), "Omega", (0.5, 0.8), progress=hb.ProgressBar("a < b"))
    assert len(shell.shown) == 1 and shell.shown[0].startswith("a &lt; b <progress value=")
    assert 'value="1.0000"' in shell.updates[-1]


def test_bar_shows_how_far_it_has_come():
    bar = hb.ProgressBar("a <curve>")
    assert '<progress value="0.0000">' in bar._repr_html_()
    hb.trace(hb.HarmonicBalance(hb.Duffing(), 3), "Omega", (0.5, 0.6), progress=bar)
    shown = bar._repr_html_()
    assert shown.startswith('a &lt;curve&gt; <progress value="1.0000"></progress>') and "0.6" in shown


def test_bar_in_a_terminal_and_elsewhere(monkeypatch):
    for terminal, expected in ((True, "\r\033[Kwork   50 %  half\r\033[Kwork  100 %  all\n"), (False, "")):
        out = io.StringIO()
        out.isatty = lambda terminal=terminal: terminal
        monkeypatch.setattr(sys, "stderr", out)
        bar = hb.ProgressBar("work")
        for progress in (
            hb.continuation.Progress(0.5, "half"),
            hb.continuation.Progress(0.6, "too soon"),
            hb.continuation.Progress(1.0, "all"),
        ):
            bar(progress)
        assert out.getvalue() == expected
