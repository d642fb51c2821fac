"""Jump maps and critical values against traces, similarity, and what they say when there is nothing to find."""

import dataclasses
import re
from itertools import pairwise
from types import SimpleNamespace

import numpy as np
import pytest
from machines import gear_pair

import hbgear as hb
from hbgear import Duffing, HarmonicBalance, SpurPair, StepControl, trace
from hbgear.analysis import jump_maps
from hbgear.analysis.critical_parameters import NoFoldError, critical_parameter
from hbgear.analysis.jump_maps import Arm, jump_map
from hbgear.continuation import FoldProblem
from hbgear.continuation.results.status import Status

SPAN = (0.112, 0.120)
NEAR = {"frequencies": (0.95, 0.8)}
PAIR = SpurPair(zeta=0.117)
"""Near its cusp, at zeta = 0.118."""


def folds_at(problem, **at):
    """Frequencies of the folds of a response curve, ascending."""
    curve = trace(problem, "Omega", (0.95, 0.8), at=at, stability=False, accuracy=None)
    return sorted(p.parameters["Omega"] for p in curve.special if p.kind == "LP")


@pytest.fixture(scope="module")
def problem():
    return HarmonicBalance(PAIR, 5)


@pytest.fixture(scope="module")
def jumps(problem):
    return jump_map(problem, "zeta", SPAN, seeds=2, **NEAR)


@hb.mechanics.model
def rotor(e: float = 0.08):
    """A rotor with unbalance that meets a stop; it jumps for 0.051 < e < 0.249."""
    stop = hb.Element([1.0], hb.Unilateral(k=4.0, gap=0.5), name="stop")
    return hb.System([[1.0]], [[0.1]], [[1.0]], [stop], hb.Load(cosine={1: [e]}, power=2))


# ---- jump maps


@pytest.fixture(scope="module")
def rotor_jumps():
    return jump_map(rotor(), "e", (0.03, 0.3), frequencies=(0.8, 1.6), harmonics=8, seeds=2)


@pytest.mark.parametrize("e", [0.08, 0.1])
def test_jumps_between_two_curves_without_jumps_are_those_of_response_curves(rotor_jumps, e):
    """The fold curve is closed, between e = 0.051 and 0.249, and starts at the value of the model, e = 0.08."""
    problem = HarmonicBalance(rotor(), 8)

    def folds(value):
        curve = trace(problem, "Omega", (0.8, 1.6), at={"e": value}, stability=False, accuracy=None)
        return sorted(p.parameters["Omega"] for p in curve.special if p.kind == "LP")

    assert [fold.status for fold in rotor_jumps.folds] == [Status.CLOSED]
    assert [folds(end) for end in rotor_jumps.span] == [[], []]
    found = rotor_jumps.jumps_at(e)
    assert [direction for _, direction in found] == [-1, 1]
    np.testing.assert_allclose([Omega for Omega, _ in found], folds(e), rtol=0, atol=2e-5)
    assert rotor_jumps.several_motions(e) == [(found[0][0], found[1][0])]


@pytest.mark.parametrize("zeta", [0.112, 0.115, 0.1175])
def test_jump_frequencies_are_those_of_response_curves(problem, jumps, zeta):
    """A softening jump: up at the lower fold while Omega falls, down at the upper while it rises."""
    found, expected = jumps.jumps_at(zeta), folds_at(problem, zeta=zeta)
    assert [direction for _, direction in found] == [-1, 1]
    np.testing.assert_allclose([Omega for Omega, _ in found], expected, rtol=0, atol=1e-6)
    assert jumps.several_motions(zeta) == [(found[0][0], found[1][0])]


def test_no_jump_beyond_the_cusp(problem, jumps):
    assert len(jumps.cusps) == 1
    zeta = jumps.cusps[0].parameters["zeta"]
    assert 0.117 < zeta < 0.119
    assert jumps.jumps_at(zeta + 1e-4) == [] and jumps.several_motions(zeta + 1e-4) == []
    assert len(jumps.jumps_at(zeta - 1e-4)) == 2
    assert folds_at(problem, zeta=zeta + 1e-4) == []


def test_one_fold_curve_and_its_two_arms(jumps):
    """All response curves meet the same folds: followed once, cut at the cusp."""
    assert len(jumps.folds) == 1 and len(jumps.arms) == 2
    for arm in jumps.arms:
        assert np.all(np.diff(arm.values) >= 0) and arm.values[0] == pytest.approx(SPAN[0], abs=1e-12)
        assert arm.values[-1] == pytest.approx(jumps.folds[0].values[jumps.cusps[0].index], abs=1e-12)
    ends = [arm.Omega[-1] for arm in jumps.arms]
    assert ends[0] == pytest.approx(ends[1], abs=1e-12)
    assert jumps.labels["zeta"] and jumps.span == SPAN


def test_the_band_of_several_motions(jumps):
    values = np.linspace(*SPAN, 31)
    ((low, high),) = jumps.bands(values)
    cusp = jumps.cusps[0].parameters["zeta"]
    assert np.isnan(low[values > cusp]).all() and np.isfinite(low[values < cusp]).all()
    inside = values < cusp
    width = (high - low)[inside]
    assert np.all(width > 0) and all(b < a for a, b in pairwise(width))


def test_jumps_of_every_curve_of_the_range_are_on_the_map():
    """The curve from 1.5 grows without bound; another one covers the range below its fold, and has a fold too."""
    model, at = SpurPair(zeta=0.01, eps=(0.0, 0.2), e=(0.05,)), 0.0105
    found = jump_map(model, "zeta", (0.01, 0.011), frequencies=(1.5, 0.3), harmonics=8, seeds=2)
    curve = trace(HarmonicBalance(model.replace(zeta=at), 8), "Omega", (1.5, 0.3))
    folds = [p.parameters["Omega"] for one in curve.curves for p in one.special if p.kind == "LP"]
    assert len(curve.others) == 1 and len(folds) == 2
    assert [direction for _, direction in found.jumps_at(at)] == [-1, 1]
    np.testing.assert_allclose([Omega for Omega, _ in found.jumps_at(at)], sorted(folds), rtol=1e-4)
    (low, high), *more = found.several_motions(at)
    assert low == 0.3 and high == pytest.approx(curve.asymptotes["last"], abs=1e-5) and not more
    assert {len(one.others) for one in found.curves} == {1} and found.message == ""


@pytest.mark.slow
def test_a_fold_that_goes_to_infinity_on_a_curve_that_was_not_traced():
    """The map names it; the intervals of several motions are those of the response curve, counted at its points."""
    model, at = SpurPair(zeta=0.04, eps=(0.0, 0.2), e=(0.05,)), 0.045
    found = jump_map(model, "zeta", (0.012, 0.06), frequencies=(1.5, 0.3), harmonics=6, seeds=2)
    (infinite,) = [fold for fold in found.folds if fold.unbounded_ends]
    place = f"zeta = {infinite.unbounded_ends[0][1]:.5g}, Omega = {infinite.tracked['Omega'][-1]:.5g}"
    assert found.status.complete and f"the motion of a fold grows without bound at {place}" in found.message
    others = "folds at zeta = 0.012, Omega = 0.37658, 0.77204 lie on curves that were not traced"
    assert others in found.message  # `trace_all` finds them, and five motions at Omega = 0.9
    curve = trace(HarmonicBalance(model.replace(zeta=at), 6), "Omega", (1.5, 0.3), stability=False)
    assert curve.status is Status.REACHED_END and len(found.jumps_at(at)) == 5
    folds = sorted(p.parameters["Omega"] for p in curve.special if p.kind == "LP")
    np.testing.assert_allclose(np.ravel(found.several_motions(at)), folds, rtol=1e-3)
    several = found.bands(np.linspace(0.041, 0.06, 40))
    assert len(several) == 2 and all(np.isfinite(band).all() for band in several)


def test_a_region_of_several_motions_continues_where_two_sections_cross():
    """Its lower end passes from one section to the other."""
    values = np.array([0.0, 1.0])
    ends = (((0.7, 0.9), -1), ((0.9, 0.7), -1), ((1.2, 1.2), 1), ((1.4, 1.4), 1))
    arms = tuple(Arm(values, np.array(Omega), sign) for Omega, sign in ends)
    found = jump_maps.JumpMap("zeta", (0.0, 1.0), (), arms, {}, frequencies=(0.5, 2.0))
    ((low, high),) = found.bands(np.linspace(0.0, 1.0, 60))
    np.testing.assert_allclose(low, 0.8 - np.abs(np.linspace(-0.1, 0.1, 60)), rtol=1e-12)
    assert np.all(high == 1.4)


def test_asymptotes_between_two_curves_are_those_with_the_same_number_of_motions():
    """Three folds need an asymptote, two need none, at every value between a curve with and one without."""
    values = np.array([0.0, 0.4])
    arms = (
        Arm(np.array([0.0, 1.0]), np.full(2, 0.7), -1),
        Arm(np.array([0.0, 1.0]), np.full(2, 1.0), 1),
        Arm(values, np.full(2, 0.9), -1),
    )
    curves = [
        SimpleNamespace(
            fixed={"zeta": at}, curves=[SimpleNamespace(special=(), values=[1.2], unbounded_ends=[(-1, 1.3)] * count)]
        )
        for at, count in ((0.0, 2), (1.0, 0))
    ]
    found = jump_maps.JumpMap("zeta", (0.0, 1.0), (), arms, {}, curves=tuple(curves), frequencies=(0.5, 2.0))
    assert found.several_motions(0.2) == found.several_motions(0.39) == [(0.7, 1.3)]
    assert found.several_motions(0.41) == found.several_motions(0.9) == [(0.7, 1.0)]


@pytest.mark.parametrize("turn", np.linspace(0.2, 0.9, 8))
def test_both_sections_end_at_their_cusp_without_rounding(turn):
    """By rounding, the lower jump was above the other one: the whole range had several motions at this value."""
    values = turn * np.linspace(0.1, 1.0, 12) ** 0.5
    lower = 0.7 + 0.3 * values**2
    upper = lower + 0.1 * np.maximum(turn - values, 0.0) ** 1.5
    arms = (Arm(values, lower, -1), Arm(values, upper, 1))
    found = jump_maps.JumpMap("zeta", (0.0, 1.0), (), arms, {}, frequencies=(0.5, 2.0))
    for i in (3, 11):
        assert found.several_motions(values[i]) == [(lower[i], upper[i])]


@pytest.mark.parametrize(
    ("directions", "frequencies", "several"),
    [
        ((-1, 1), (0.5, 2.0), [(0.7, 1.4)]),  # the upper motions end at both jumps
        ((-1, -1), (2.0, 0.5), [(0.7, 2.0)]),  # they leave the range
        ((1, 1), (0.5, 2.0), [(0.5, 1.4)]),
        ((1, -1), (0.5, 2.0), [(0.5, 0.7), (1.4, 2.0)]),
    ],
)
def test_intervals_of_several_motions(directions, frequencies, several):
    values = np.array([0.0, 1.0])
    arms = tuple(Arm(values, np.full(2, at), sign) for at, sign in zip((0.7, 1.4), directions, strict=True))
    found = jump_maps.JumpMap("zeta", (0.0, 1.0), (), arms, {}, frequencies=frequencies)
    assert found.several_motions(0.5) == several


def test_ranges_without_a_curve_are_named(jumps, problem):
    """A range that reaches far below the last motion of an incomplete curve."""
    curve = dataclasses.replace(jumps.curves[0], others=())
    said = jump_maps._without_curve("zeta", {0.112: curve}, (0.95, 0.7))
    assert said.startswith("at zeta = 0.112 no curve was found from Omega = 0.7 to 0.8")


def test_a_map_of_no_jumps():
    empty = jump_map(SpurPair(), "zeta", (0.2, 0.3), harmonics=4, seeds=2)
    assert (empty.folds, empty.arms, empty.cusps) == ((), (), ())
    assert empty.bands(np.array([0.25])) == []


def test_a_map_backwards_is_the_same_and_reports_progress(problem, jumps):
    said = []
    other = jump_map(problem, "zeta", SPAN[::-1], seeds=2, progress=lambda now: said.append(now.text), **NEAR)
    assert other.span == SPAN
    np.testing.assert_allclose(other.jumps_at(0.114), jumps.jumps_at(0.114), rtol=0, atol=1e-5)
    assert said[0] == "response curve at zeta = 0.112"
    assert sum("followed in zeta" in line for line in said) == 1
    assert sum("response curve" in line for line in said) == 3  # the ends, and the model with zeta = 0.117


def test_outside_of_its_values_an_arm_has_no_jump():
    arm = Arm(np.array([1.0, 2.0]), np.array([5.0, 7.0]), 1)
    assert arm.at(1.5) == 6.0 and np.isnan(arm.at(0.99)) and np.isnan(arm.at(2.01))


@pytest.mark.parametrize("span", [(0.1, 0.1), (0.1, np.inf), (np.nan, 0.1)])
def test_an_empty_or_infinite_span(problem, span):
    with pytest.raises(ValueError, match=r"need two different finite values of zeta|span = .* must be finite"):
        jump_map(problem, "zeta", span)


def test_too_few_seeds(problem):
    with pytest.raises(ValueError, match="seeds = 1 must be a whole number of at least 2"):
        jump_map(problem, "zeta", SPAN, seeds=1)


# ---- critical values


@pytest.fixture(scope="module")
def in_zeta(problem):
    return critical_parameter(problem, "zeta", **NEAR)


def test_the_critical_damping_is_the_cusp_of_the_map(jumps, in_zeta):
    cusp = jumps.cusps[0].parameters
    assert (in_zeta.value, in_zeta.Omega) == (in_zeta.point.parameters["zeta"], in_zeta.point.parameters["Omega"])
    assert in_zeta.value == pytest.approx(cusp["zeta"], abs=1e-8)
    assert in_zeta.Omega == pytest.approx(cusp["Omega"], abs=1e-7)
    assert in_zeta.jump_below and in_zeta.point.kind == "CP" and in_zeta.folds["CP1"] is in_zeta.point


@pytest.mark.parametrize(("factor", "count"), [(0.995, 2), (1.005, 0)])
def test_the_jump_is_below_and_not_above(problem, in_zeta, factor, count):
    assert len(folds_at(problem, zeta=factor * in_zeta.value)) == count


def test_found_from_a_model_without_a_jump(in_zeta):
    """The response has no fold; those of other dampings are looked at, away from the model's own."""
    said = []
    found = critical_parameter(
        HarmonicBalance(SpurPair(zeta=0.13), 5), "zeta", progress=lambda now: said.append(now.text), **NEAR
    )
    assert said[0].endswith("no fold")
    assert found.value == pytest.approx(in_zeta.value, abs=1e-8) and found.jump_below


@pytest.mark.slow
def test_all_cusps_of_a_fold_curve_are_found():
    """Two cusps of one fold curve of a pair with tip relief, against the folds of curves at dampings around them."""
    problem = HarmonicBalance(hb.gears.DrawnPair(gear_pair(tip_relief="15 um"), 200.0, 0.04), 8)
    found = critical_parameter(problem, "damping")
    assert found.jump_below and found.value == pytest.approx(0.04673, rel=1e-3)
    ((last, Omega),) = found.others
    folds = [
        [point.parameters["Omega"] for point in curve.special if point.kind == "LP"]
        for zeta in (0.999 * found.value, 1.001 * found.value, 0.999 * last, 1.001 * last)
        for curve in [trace(problem, "Omega", (1.0, 0.8), at={"damping": zeta}, stability=False)]
    ]
    assert [len(each) for each in folds] == [4, 2, 2, 0]
    assert folds[2] == pytest.approx([Omega] * 2, rel=1e-3)


@pytest.mark.slow
def test_load_and_error_matter_by_their_ratio():
    """While no tooth touches on its back the equation is homogeneous in F_m, e and x - b: e_crit / F_m = e / F_crit."""
    error = critical_parameter(PAIR, "e_scale", harmonics=8, **NEAR)
    load = critical_parameter(PAIR, "F_m", harmonics=8, **NEAR)
    stated = error.point.error / error.value + load.point.error / load.value
    assert error.value * load.value == pytest.approx(0.1, rel=3 * stated + 1e-7) and stated < 2e-5
    assert error.Omega == pytest.approx(load.Omega, abs=1e-5)
    assert (error.jump_below, load.jump_below) == (False, True)


def test_similar_pairs_have_the_same_critical_damping(in_zeta):
    found = critical_parameter(SpurPair(zeta=0.117, F_m=0.2, e=(0.1,), b=2.0), "zeta", harmonics=5, **NEAR)
    assert found.value == pytest.approx(in_zeta.value, abs=1e-8)
    assert found.Omega == pytest.approx(in_zeta.Omega, abs=1e-7)


def test_no_fold_at_all():
    """Linear oscillator: the message has the span tried and the steepest slope of the amplitude."""
    model = Duffing(k3=0.0)
    with pytest.raises(NoFoldError) as stop:
        critical_parameter(model, "zeta", harmonics=1, frequencies=(1.06, 0.94))
    text = str(stop.value)
    assert "no jump that appears or vanishes with zeta" in text and "Try another parameter" in text
    slope, Omega = map(float, re.search(r"rms amplitude is (\S+) at Omega = (\S+)\. ", text).groups())
    w = np.linspace(0.94, 1.06, 20001)
    rms = model.F / np.sqrt(2) / np.abs(1 - w**2 + 2j * model.zeta * w)
    exact = np.gradient(rms, w)
    assert slope == pytest.approx(exact[np.argmax(np.abs(exact))], rel=0.02)
    assert w[np.argmax(np.abs(exact))] == pytest.approx(Omega, abs=0.005)


@pytest.mark.parametrize("search", [critical_parameter, lambda model, name: jump_map(model, name, (0.1, 0.2))])
def test_bad_parameters(search):
    with pytest.raises(KeyError, match="SpurPair has no parameter 'zetta'; did you mean 'zeta'"):
        search(SpurPair(), "zetta")
    with pytest.raises(ValueError, match=r"must differ from Omega, .*; choose one of: zeta, F_m, b"):
        search(SpurPair(), "Omega")


def test_folds_of_the_critical_value_can_be_followed_on(problem, in_zeta):
    """Any of its points is a start: back through the cusp from a point on the far arm."""
    back = trace(FoldProblem(problem), "zeta", SPAN, in_zeta.folds[len(in_zeta.folds) - 1])
    assert [p.kind for p in back.special] == ["CP"]
    stated = back["CP1"].error + in_zeta.point.error
    assert back["CP1"].parameters["zeta"] == pytest.approx(in_zeta.value, abs=3 * stated + 1e-8)


def test_a_number_of_harmonics_that_varies_is_refused():
    """Before the work: a fold of one number of harmonics is no start for another."""
    auto = hb.HarmonicBalance(hb.Duffing(), "auto")
    for call in (
        lambda: hb.jump_map(auto, "zeta", (0.04, 0.05)),
        lambda: hb.analysis.critical_parameter(auto, "zeta"),
        lambda: hb.trace_all(auto, (0.5, 1.6)),
    ):
        with pytest.raises(ValueError, match=r"one number of harmonics throughout, not 'auto'; give harmonics="):
            call()


def test_a_fold_of_another_number_of_harmonics_is_a_start():
    problems = [hb.HarmonicBalance(hb.Duffing(), H) for H in (5, 7)]
    starts = [hb.trace(problem, "Omega", (0.9, 1.3), stability=False)["LP1"] for problem in problems]
    folds = [
        hb.trace(hb.continuation.FoldProblem(problems[1], "Omega"), "zeta", (0.05, 0.04), start) for start in starts
    ]
    assert folds[0].layout.harmonics == 7 and folds[0].values[-1] == 0.04
    for i in (0, -1):
        assert folds[0].tracked["Omega"][i] == pytest.approx(folds[1].tracked["Omega"][i], abs=1e-10)
    with pytest.raises(
        ValueError, match=r"the start has 11 coefficients, this problem 15: .* FoldProblem\(curve.problem"
    ):
        hb.continuation.FoldProblem(problems[1], "Omega").join(starts[0].X, starts[0].parameters)


def test_a_search_keeps_within_the_range_and_is_given_up(monkeypatch):
    """Every half backlash has the folds of the pair, none has a cusp: the search says so and ends."""
    monkeypatch.setattr(
        "hbgear.analysis.critical_parameters._FOLD_STEPS", StepControl(first_step=0.002, max_step=0.02, max_points=10)
    )
    said = []
    searched = r"vanishes with b was found from b = 0\.\d+ to 1\.\d+ \(response curves: 2, fold curves: 8\)"
    with pytest.raises(NoFoldError, match=searched):
        critical_parameter(
            SpurPair(zeta=0.09), "b", frequencies=(0.95, 0.7), harmonics=3, progress=lambda now: said.append(now.text)
        )
    ends = [float(line.rpartition(" ")[2]) for line in said if "followed" in line]
    assert ends and 0.0 < min(ends) <= 0.01 and len(ends) <= 8  # not through zero


def test_a_map_outside_the_range_is_refused():
    with pytest.raises(ValueError, match=r"span = \(-1.0, 1.0\): b must not be negative"):
        jump_map(SpurPair(), "b", (-1.0, 1.0))
