"""Events of users: located, labelled, saved, listed, drawn, usable as starts and followed in a second parameter."""

import numpy as np
import pytest

import hbgear as hb

LIMIT = hb.Event("limit", lambda point: point.amplitude("max") - 1.3, "the largest deflection is 1.3", marker="*")


@pytest.fixture(scope="module")
def curve():
    return hb.trace(hb.HarmonicBalance(hb.SpurPair(), 8), "Omega", (1.2, 0.6), events=[LIMIT])


def test_located_and_labelled(curve):
    points = [point for point in curve.special if point.kind == "limit"]
    assert [point.label for point in points] == ["limit1", "limit2"]
    for point in points:
        assert point.located and point.meaning == "the largest deflection is 1.3" and point.marker == "*"
        assert point.amplitude("max") == pytest.approx(1.3, abs=1e-9)
        low, high = sorted(point.interval)
        assert low <= point.parameters["Omega"] <= high
    alone = hb.trace(curve.problem, "Omega", (1.2, 0.6))
    assert [p.label for p in curve.special if p.kind != "limit"] == [p.label for p in alone.special]


def test_every_crossing_between_rows_is_found(curve):
    size = curve.amplitude("max") - 1.3
    assert sum(size[:-1] * size[1:] < 0) <= 2 == sum(point.kind == "limit" for point in curve.special)


def test_saved_and_loaded(curve, tmp_path):
    curve.save(tmp_path / "curve.npz")
    again = hb.load(tmp_path / "curve.npz")
    point = again["limit1"]
    assert (point.meaning, point.marker) == ("the largest deflection is 1.3", "*")
    assert point.amplitude("max") == curve["limit1"].amplitude("max")


def test_a_start(curve):
    again = hb.trace(curve.problem, "Omega", (1.2, 0.6), start=curve["limit1"])
    np.testing.assert_allclose(again.X[0], curve["limit1"].X, atol=1e-9)


def test_followed_in_a_second_parameter(curve):
    """Where the largest deflection stays 1.3: the frequency as a function of the damping, against fresh traces."""
    problem = curve.problem
    level = LIMIT.equations(problem, "Omega", curve["limit1"])
    held = hb.trace(level, "zeta", (0.05, 0.06), start=curve["limit1"])
    assert held.status is hb.Status.REACHED_END
    np.testing.assert_allclose(held.amplitude("max"), 1.3, atol=1e-9)
    fresh = hb.trace(problem, "Omega", (1.2, 0.6), at={"zeta": 0.06}, events=[LIMIT])
    nearest = min((p.parameters["Omega"] for p in fresh.special if p.kind == "limit"),
                  key=lambda Omega: abs(Omega - held.tracked["Omega"][-1]))  # fmt: skip
    assert held.tracked["Omega"][-1] == pytest.approx(nearest, abs=1e-9)


def test_a_terminal_event_ends_the_trace(curve):
    stop = hb.Event("stop", lambda point: point.amplitude("max") - 1.3, terminal=True)
    cut = hb.trace(curve.problem, "Omega", (1.2, 0.6), events=[stop])
    assert cut.status is hb.Status.EVENT and cut.status.complete
    assert cut.special[-1].label == "stop1" and cut.special[-1].index == len(cut) - 1
    assert cut.values[-1] == pytest.approx(curve["limit1"].parameters["Omega"], abs=1e-12)


def test_without_special_points_only_own_events():
    curve = hb.trace(hb.HarmonicBalance(hb.SpurPair(), 8), "Omega", (1.2, 0.6), special=False, events=[LIMIT])
    assert {point.kind for point in curve.special} == {"limit"}


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda: hb.Event("LP", abs), "one that hbgear uses itself"),
        (lambda: hb.Event("two words", abs), "must be letters"),
        (lambda: hb.Event("", abs), "must be letters"),
        (lambda: hb.Event("limit", 2.0), "must be a function of a point"),
    ],
)
def test_bad_input(make, words):
    with pytest.raises((ValueError, TypeError), match=words):
        make()


def test_two_of_one_name(curve):
    with pytest.raises(ValueError, match="two events are called limit"):
        hb.trace(curve.problem, "Omega", (1.2, 0.6), events=[LIMIT, LIMIT])


def test_a_test_that_is_not_finite(curve):
    broken = hb.Event("broken", lambda point: float("nan"))
    with pytest.raises(ValueError, match="the test of the event 'broken' is nan"):
        broken.test(curve[0])
