"""Figures of many cases, held against the closed form of a linear oscillator; what is drawn and what is left out."""

from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

import matplotlib
import matplotlib.pyplot as plt
import numpy as np
import pytest

import hbgear as hb
from hbgear import plot_cases

matplotlib.use("Agg")
ZETA = [0.1, 0.15, 0.2, 0.25, 0.3]
HARD = [0.04, 0.05, 0.5]


@pytest.fixture(autouse=True)
def closed():
    yield
    plt.close("all")


def cases(vary, compute, k3=0.0, F=0.15):
    with ThreadPoolExecutor(1) as pool:
        return hb.cases(hb.Duffing(k3=k3, F=F), vary, compute, harmonics=3, span=(0.5, 2.0), executor=pool)


@pytest.fixture(scope="module")
def linear():
    return cases(hb.grid(zeta=ZETA), ("curve",))


@pytest.fixture(scope="module")
def hard():
    return cases(hb.grid(zeta=HARD), ("peak", "jumps", "curve"), k3=1.0)


def amplitude(zeta, Omega):
    return 0.15 / np.hypot(1 - Omega**2, 2 * zeta * Omega)


def test_envelope_of_a_linear_oscillator(linear):
    """The amplitude falls with damping, so its percentiles over cases are those of the damping."""
    Omega = np.linspace(0.5, 2.0, 7)
    least, _, middle, _, largest = plot_cases.percentiles(linear, Omega)
    for found, zeta in ((least, 0.3), (middle, 0.2), (largest, 0.1)):
        np.testing.assert_allclose(found, amplitude(zeta, Omega), rtol=5e-3)
    ax = plot_cases.envelope(linear)
    np.testing.assert_allclose(ax.lines[0].get_ydata()[[0, -1]], amplitude(0.2, np.array([0.5, 2.0])), rtol=1e-6)
    assert [text.get_text() for text in ax.get_legend().get_texts()] == ["all cases", "5 to 95 %", "median"]


def test_frequencies_where_none_is_stable_are_marked(linear):
    gap = {case: np.array([x, y, np.abs(x - 1.0) > 0.1]) for case, (x, y, _) in linear.curves.items()}
    labels = [text.get_text() for text in plot_cases.envelope(replace(linear, curves=gap)).get_legend().get_texts()]
    assert labels[-1] == "none stable"


def test_both_stable_motions_count_and_the_unstable_one_does_not():
    Omega, height = np.array([1.0, 2.0, 3.0, 2.5, 1.5, 2.0, 4.0]), np.array([1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0])
    stable = np.array([1, 1, 1, 0, 1, 1, 1.0])
    rows = list(plot_cases._stretches(np.array([Omega, height, stable]), np.array([1.5, 2.0, 3.5])))
    np.testing.assert_allclose(rows, [[1.5, 2.0, np.nan], [5.0, 6.0, 6.75]])


def test_jumps_are_counted(hard):
    ax = plot_cases.jump_distribution(hard)
    labels = [text.get_text() for text in ax.get_legend().get_texts()]
    assert [label.partition(": ")[2] for label in labels] == ["2 of 3 cases"] * 2
    drawn = [patch.get_data().values.sum() for patch in ax.patches]
    assert drawn == [2, 2, 2, 2]


def test_numbers_against_parameters(hard):
    figure = plot_cases.against_parameters(hard)
    peak, jumps = figure.axes
    assert jumps.get_xlabel() == hb.Duffing.labels["zeta"]
    assert peak.get_ylabel() == "largest half peak-to-peak\nof $x$ [-]"
    np.testing.assert_allclose(peak.lines[0].get_xydata(), np.array([HARD, hard.table["peak"]]).T)
    assert {line.get_gid(): len(line.get_xdata()) for line in jumps.lines} == {"jump_rising": 2, "jump_falling": 2}


def test_only_what_was_computed_is_drawn(linear, hard):
    assert list(plot_cases.figures(linear)) == ["envelope"]
    assert list(plot_cases.figures(hard)) == ["envelope", "jump_distribution", "against_parameters"]
    with pytest.raises(ValueError, match=r"compute=\('jumps',\)"):
        plot_cases.jump_distribution(linear)
