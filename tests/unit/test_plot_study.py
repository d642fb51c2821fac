"""Figures of many cases, held against the closed form of a linear oscillator; what is drawn and what is left out."""

import csv
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

import matplotlib
import numpy as np
import pytest

import hbgear as hb
from hbgear import plot
from hbgear.design.studies.sweep_statistics import stable_segments, sweep_response, sweep_responses

matplotlib.use("Agg")
ZETA = [0.1, 0.15, 0.2, 0.25, 0.3]
HARD = [0.04, 0.05, 0.5]


def cases(vary, compute, k3=0.0, F=0.15):
    with ThreadPoolExecutor(1) as pool:
        return hb.design.cases(hb.Duffing(k3=k3, F=F), vary, compute, harmonics=3, span=(0.5, 2.0), executor=pool)


@pytest.fixture(scope="module")
def linear():
    return cases(hb.design.grid(zeta=ZETA), ("curve",))


@pytest.fixture(scope="module")
def hard():
    return cases(hb.design.grid(zeta=HARD), ("peak", "jumps", "curve"), k3=1.0)


def amplitude(zeta, Omega):
    return 0.15 / np.hypot(1 - Omega**2, 2 * zeta * Omega)


def test_envelope_of_a_linear_oscillator(linear):
    """The amplitude falls with damping, so its percentiles over cases are those of the damping."""
    Omega = np.linspace(0.5, 2.0, 7)
    least, _, middle, _, largest = plot.percentiles(linear, Omega)
    for found, zeta in ((least, 0.3), (middle, 0.2), (largest, 0.1)):
        np.testing.assert_allclose(found, amplitude(zeta, Omega), rtol=5e-3)
    ax = plot.envelope(linear)
    np.testing.assert_allclose(ax.lines[0].get_ydata()[[0, -1]], amplitude(0.2, np.array([0.5, 2.0])), rtol=1e-6)
    assert [text.get_text() for text in ax.get_legend().get_texts()] == ["all cases", "5 to 95 %", "median"]


def test_frequencies_where_none_is_stable_are_marked(linear):
    gap = {case: np.array([x, y, np.abs(x - 1.0) > 0.1]) for case, (x, y, _) in linear.curves.items()}
    labels = [text.get_text() for text in plot.envelope(replace(linear, curves=gap)).get_legend().get_texts()]
    assert labels[-1] == "no stable motion"


def test_both_stable_motions_count_and_the_unstable_one_does_not():
    Omega, height = np.array([1.0, 2.0, 3.0, 2.5, 1.5, 2.0, 4.0]), np.array([1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0])
    stable = np.array([1, 1, 1, 0, 1, 1, 1.0])
    parts = list(stable_segments(np.array([Omega, height, stable])))
    at = np.array([1.5, 2.0, 3.5])
    rows = [np.interp(at, *part, left=np.nan, right=np.nan) for part in parts]
    np.testing.assert_allclose(rows, [[1.5, 2.0, np.nan], [5.0, 6.0, 6.75]])


def test_jumps_are_counted(hard):
    ax = plot.jump_distribution(hard)
    labels = [text.get_text() for text in ax.get_legend().get_texts()]
    assert [label.partition(": ")[2] for label in labels] == ["2 of 3 cases"] * 2
    drawn = [patch.get_data().values.sum() for patch in ax.patches]
    assert drawn == [2, 2, 2, 2]


def test_numbers_against_parameters(hard):
    figure = plot.against_parameters(hard)
    peak, jumps = figure.axes
    assert jumps.get_xlabel() == hb.Duffing.labels["zeta"]
    assert peak.get_ylabel() == "largest half peak-to-peak\nof $x$ [-]"
    np.testing.assert_allclose(peak.lines[0].get_xydata(), np.array([HARD, hard.table["peak"]]).T)
    assert {line.get_gid(): len(line.get_xdata()) for line in jumps.lines} == {"jump_rising": 2, "jump_falling": 2}


def test_only_computed_results_are_drawn(linear, hard):
    assert list(plot.figures(linear)) == ["envelope"]
    assert list(plot.figures(hard)) == ["envelope", "jump_distribution", "against_parameters"]
    with pytest.raises(ValueError, match=r"compute=\('jumps',\)"):
        plot.jump_distribution(linear)


def folded():
    """A curve that leans over: up the lower part to a fold at 3, back unstable to one at 2, up the other to 5."""
    Omega, height = np.array([1.0, 3.0, 2.0, 5.0]), np.array([1.0, 2.0, 3.0, 6.0])
    return np.array([Omega, height, [1, 1, 0, 1]])


def test_a_sweep_stays_on_its_stable_part_and_lands_where_the_jump_does():
    Omega = np.array([1.0, 1.9, 2.1, 2.9, 3.1, 5.0])
    up, jumped = sweep_response(folded(), np.array([[3.0, 2.0, 4.0]]), Omega, 1)
    np.testing.assert_allclose(up, [1.0, 1.45, 1.55, 1.95, 4.1, 6.0])
    np.testing.assert_array_equal(jumped, [0, 0, 0, 0, 1, 1])
    down, jumped = sweep_response(folded(), np.array([[2.0, 3.0, 1.5]]), Omega, -1)
    np.testing.assert_allclose(down, [1.0, 1.45, 3.1, 3.9, 4.1, 6.0])
    np.testing.assert_array_equal(jumped, [1, 1, 0, 0, 0, 0])
    # Without a table of jumps the response continues on the only other curve.
    np.testing.assert_allclose(sweep_response(folded(), None, Omega, 1)[0], up)


def test_where_a_part_ends_without_a_jump_there_is_no_motion_for_a_while():
    curve = np.array([[1.0, 2.0, 3.0, 4.0, 5.0], [1.0, 2.0, 3.0, 4.0, 5.0], [1, 1, 0, 1, 1]])
    up, jumped = sweep_response(curve, np.empty((0, 3)), np.array([1.5, 2.5, 3.5, 4.5]), 1)
    np.testing.assert_allclose(up, [1.5, np.nan, np.nan, 4.5])
    assert not jumped.any()


def test_every_percentile_across_a_fold_is_a_motion_of_some_case(hard):
    Omega = np.linspace(0.5, 2.0, 301)
    for direction in (1, -1):
        each = sweep_responses(hard, Omega, direction).amplitude
        for row in plot.percentiles(hard, Omega, direction):
            gap = np.nanmin(abs(each - row), axis=0)
            assert np.nanmax(gap) == 0.0
    up, down = (sweep_responses(hard, Omega, direction).amplitude for direction in (1, -1))
    assert np.nanmax(up - down) > 0.3  # between the folds the two sweeps are on different motions


def test_envelope_marks_cases_with_jumps(hard):
    ax = plot.envelope(hard, points=301)
    words = " ".join(text.get_text() for text in ax.get_legend().get_texts())
    assert "sweep up" in words and "sweep down" in words
    (share,) = (child for child in ax.child_axes if child.get_label() == "share")
    for line, column, there in zip(share.lines, ("jump_rising", "jump_falling"), (np.greater, np.less), strict=True):
        jumps = hard.table[column][np.isfinite(hard.table[column])]
        expected = [100 * there(x, jumps).sum() / len(hard) for x in line.get_xdata()]
        assert np.mean(np.abs(line.get_ydata() - expected) > 1.0) < 0.01  # but for a step of the grid at each jump
    Omega = np.linspace(0.5, 2.0, 301)
    motions = np.concatenate([sweep_responses(hard, Omega, direction).amplitude for direction in (1, -1)])
    medians = [line for line in ax.lines if line.get_gid() == "median"]
    assert len(medians) >= 3
    for x, y in (line.get_data() for line in medians):  # lines that leap are broken, not drawn where no motion is
        there = np.isfinite(y)
        near = motions[:, np.searchsorted(Omega, x[there] - 1e-9)]
        assert np.nanmax(np.nanmin(abs(near - y[there]), axis=0)) == 0.0
        drawn = abs(np.diff(y))
        assert np.nanmax(drawn, initial=0.0) < 0.1


def test_figures_of_a_machine_with_scales_are_in_its_units():
    """Speeds and amplitudes are those of the dimensionless figure times the scales of the pair."""
    pair = hb.SpurPair(reference=(38000.0, 37.6e-6, 15000.0, 25.0))
    with ThreadPoolExecutor(1) as pool:
        found = hb.design.cases(
            pair,
            hb.design.grid(zeta=[0.04, 0.05]),
            ("peak", "jumps", "curve"),
            harmonics=3,
            span=(1.0, 0.6),
            executor=pool,
        )
    speed, length = pair.scales.pinion_speed(1.0), 1e6 * pair.scales.length
    drawn = {}
    for bare in (False, True):
        axes = (
            plot.envelope(found, dimensionless=bare),
            plot.jump_distribution(found, dimensionless=bare),
            plot.against_parameters(found, dimensionless=bare).axes[0],
        )
        labels = " ".join((axes[0].get_xlabel(), axes[0].get_ylabel(), axes[1].get_xlabel(), axes[2].get_ylabel()))
        assert ("r/min" in labels, "\N{MICRO SIGN}m" in labels) == (not bare, not bare)
        assert (r"\Omega" in labels) == bare
        drawn[bare] = (
            axes[0].get_lines()[0].get_xydata(),
            axes[1].patches[0].get_data().edges,
            axes[2].lines[0].get_ydata(),
        )
    np.testing.assert_allclose(drawn[False][0], drawn[True][0] * (speed, length))
    np.testing.assert_allclose(drawn[False][1], drawn[True][1] * speed)
    np.testing.assert_allclose(drawn[False][2], drawn[True][2] * length)


REFERENCES = ((38000.0, 37.6e-6, 15000.0, 25), (45000.0, 30e-6, 15000.0, 25))
"""Scales of two spur pairs of the same equations."""


@pytest.fixture(scope="module")
def scaled():
    with ThreadPoolExecutor(1) as pool:
        return hb.design.cases(
            hb.SpurPair(reference=REFERENCES[0]),
            hb.design.grid(reference=REFERENCES),
            ("peak", "jumps", "curve"),
            harmonics=4,
            span=(0.6, 1.2),
            executor=pool,
        )


def test_each_case_is_shown_by_its_own_scales(scaled, tmp_path):
    """Equal equations have equal Omega and x / b; speeds and lengths are those of each pair."""
    a, b = (hb.SpurPair(reference=reference).scales for reference in REFERENCES)
    assert scaled.table["jump_rising"][0] == scaled.table["jump_rising"][1]
    ax = plot.jump_distribution(scaled)
    assert ax.get_xlabel() == "jump, speed of the pinion [r/min]"
    speeds = [one.pinion_speed(float(scaled.table["jump_rising"][0])) for one in (a, b)]
    peak, jumps = plot.against_parameters(with_numbers(scaled)).axes
    np.testing.assert_allclose(jumps.lines[0].get_ydata(), speeds, rtol=1e-12)
    np.testing.assert_allclose(
        peak.lines[0].get_ydata(), [1e6 * one.length * scaled.table["peak"][0] for one in (a, b)], rtol=1e-12
    )
    envelope = plot.envelope(scaled)
    limits = b.pinion_speed(0.6), a.pinion_speed(1.2)  # both curves cover this range
    np.testing.assert_allclose(envelope.get_xlim(), limits)
    assert plot.envelope(scaled, dimensionless=True).get_xlim() == (0.6, 1.2)
    scaled.export(tmp_path / "t.csv")
    header, *rows = csv.reader((tmp_path / "t.csv").open())
    assert header[2:6] == ["peak [um]", "peak at pinion [r/min]", "jumps", "jump_rising at pinion [r/min]"]
    np.testing.assert_allclose([float(row[5]) for row in rows], speeds, rtol=1e-12)
    scaled.export(tmp_path / "t.csv", dimensionless=True)
    assert next(csv.reader((tmp_path / "t.csv").open())) == list(scaled.table)


def with_numbers(found):
    """Return cases whose varied parameter is a number."""
    return replace(found, table={**found.table, "reference": np.array([1.0, 2.0])})


def test_the_envelope_follows_each_case(scaled):
    """The upper limit at a speed is the larger of both curves there."""
    a, b = (hb.SpurPair(reference=reference).scales for reference in REFERENCES)
    x = np.array([a.pinion_speed(1.1)])
    heights = [
        1e6 * one.length * sweep_response(scaled.curves[i], None, x / one.pinion_speed(1.0), -1)[0][0]
        for i, one in enumerate((a, b))
    ]
    ax = plot.envelope(scaled, points=1201)
    vertices = np.concatenate([path.vertices for c in ax.collections for path in c.get_paths()])
    near = vertices[np.abs(vertices[:, 0] - x[0]) < 8.0]
    assert near[:, 1].max() == pytest.approx(max(heights), rel=2e-3)
    assert min(heights) < 0.95 * max(heights)
