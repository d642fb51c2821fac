"""The smallest design change that reaches a goal, against searches over the parameters."""

import math

import numpy as np
import pytest

import hbgear as hb
from hbgear.design import least_change
from hbgear.design.goal_search import Cusp, Search, Slack, Spread, smallest_change
from hbgear.design.least_change import _traced_shortfall

PAIR = hb.HarmonicBalance(hb.SpurPair(), 5)


@pytest.fixture(scope="module")
def cusp():
    """Return the damping at which the jump of the pair vanishes."""
    return hb.analysis.critical_parameter(PAIR, "zeta", frequencies=PAIR.model.default_span).value


@pytest.fixture(scope="module")
def plain():
    """Return the damping of the redesign without tolerances."""
    return hb.design.redesign(PAIR, hb.design.no_jumps(), ["zeta"]).values["zeta"]


@pytest.mark.slow
def test_a_jump_is_removed_by_the_least_change():
    """Against cusps in the damping at five factors of the error: the result is the cusp nearest to the design."""
    found = hb.design.redesign(PAIR, hb.design.no_jumps(), ["zeta", "e_scale"])
    assert found.reached and found.status.complete and not found.curve.jumps() and found.short == 0
    every = []
    for factor in np.linspace(0.31, 0.36, 5):
        other = hb.HarmonicBalance(PAIR.model.replace(e_scale=factor), 5)
        cusp = hb.analysis.critical_parameter(other, "zeta", frequencies=PAIR.model.default_span).value
        every.append(np.hypot(factor - 1.0, cusp / 0.05 - 1.0))
    assert found.distance == pytest.approx(min(every), rel=2e-3) and found.distance >= min(every)
    assert found.values["zeta"] == pytest.approx(0.05 * (1 + found.changes["zeta"]))
    # with 2 % less change the jump remains
    less = {
        name: found.model.parameters[name] - 0.02 * (found.values[name] - own)
        for name, own in (("zeta", 0.05), ("e_scale", 1.0))
    }
    curve = hb.trace(hb.HarmonicBalance(PAIR.model.replace(**less), 5), "Omega", PAIR.model.default_span)
    assert any(point.kind == "LP" for point in curve.special)


def test_a_peak_is_lowered_to_its_limit():
    own = max(point.amplitude("pp2") for point in hb.analysis.peaks(hb.trace(PAIR, "Omega", (1.5, 0.3)), "pp2"))
    found = hb.design.redesign(PAIR, hb.design.peak_below(0.9 * own), ["zeta", "e[0]", "F_m"])
    assert found.reached and found.curve.amplitude("pp2").max() == pytest.approx(0.9 * own, rel=5e-3)
    # random directions of the same length do not lower the peak as much
    rng = np.random.default_rng(0)
    for _ in range(5):
        u = rng.normal(size=3)
        u *= found.distance / np.linalg.norm(u)
        values = {"zeta": 0.05 * (1 + u[0]), "e[0]": 0.05 * (1 + u[1]), "F_m": 0.1 * (1 + u[2])}
        curve = hb.trace(hb.HarmonicBalance(PAIR.model.replace(**values), 5), "Omega", (1.5, 0.3), stability=False)
        assert curve.amplitude("pp2").max() > 0.9 * own


@pytest.mark.slow
def test_a_reserve_for_scatter(plain):
    """With a standard deviation of the damping the result is three deviations above the damping at the cusp."""
    safe = hb.design.redesign(PAIR, hb.design.no_jumps(), ["zeta"], scatter={"zeta": 0.002}, sigmas=3)
    assert safe.values["zeta"] - plain == pytest.approx(0.006, rel=1e-3)
    other = hb.design.redesign(PAIR, hb.design.no_jumps(), ["zeta"], scatter={"e_scale": 0.05})
    assert other.values["zeta"] > plain


@pytest.mark.slow
def test_a_goal_out_of_reach(cusp):
    found = hb.design.redesign(PAIR, hb.design.no_jumps(), ["zeta"], {"zeta": (0.04, 0.08)})
    assert not found.reached and found.values["zeta"] == pytest.approx(0.08)
    assert found.short == pytest.approx((cusp - 0.08) / 0.05, abs=2e-3)
    assert "the goal is not reached: jumps remain: zeta would have to change by" in found.message
    found = hb.design.redesign(PAIR, hb.design.peak_below(0.05), ["zeta"], {"zeta": (0.04, 0.08)})
    assert not found.reached and found.short > 1 and "above the limit" in found.message


def test_peaks_of_motions_without_bound():
    """An unbounded curve has no highest peak: `redesign` raises ValueError, and the shortfall is infinite."""
    model = hb.SpurPair(zeta=0.01, eps=(0.0, 0.2), e=(0.05,))
    with pytest.raises(ValueError, match=r"grow without bound towards Omega = 1\.048.* more damping"):
        hb.design.redesign(model, hb.design.peak_below(0.5), ["zeta"], harmonics=8, span=(1.5, 0.3))
    search = Search(
        hb.HarmonicBalance(model, 8),
        hb.design.peak_below(50.0),
        ("zeta",),
        np.array([0.01]),
        (1.5, 0.3),
        Spread({}, 2.0, (), 1.0),
        None,
    )
    assert math.isinf(_traced_shortfall(search, np.zeros(1), {})[1])


@pytest.mark.parametrize("goal", [hb.design.no_jumps(), hb.design.peak_below(3.0)])
def test_a_verification_that_stops_early(goal, monkeypatch):
    """The jump and the peak of the oscillator are above 1.1: curves of 10 points from 0.8 do not reach them, and the
    goal counts as missed with an unknown shortfall, for the design as well as for a machine of a sample."""
    whole = least_change.trace

    def shortened(problem, *args, **options):
        steps = hb.StepControl(max_points=10 if abs(problem.model.zeta - zeta) < 1e-9 else 10000)
        return whole(problem, *args, **options, steps=steps)

    monkeypatch.setattr(least_change, "trace", shortened)
    problem, zeta = hb.HarmonicBalance(hb.Duffing(), 1), 0.05
    search = Search(problem, goal, ("zeta",), np.array([0.05]), (0.8, 1.6), Spread({}, 2.0, (), 1.0), None)
    curve, missed = _traced_shortfall(search, np.zeros(1), {})
    assert math.isnan(missed) and search.stopped is curve and curve.status is hb.Status.MAX_POINTS
    damped, sample = hb.Duffing(zeta=0.2), hb.design.grid(zeta=(0.05, -0.05))
    for zeta, share in ((0.2, 1.0), (0.15, 0.5), (0.3, 1.0)):  # the design, a machine of the sample, none of them
        found = hb.design.redesign(damped, goal, ["zeta"], tolerances=sample, harmonics=1, span=(0.8, 1.6))
        stopped = zeta < 0.3
        assert found.reached is not stopped and found.share == share
        assert math.isnan(found.short) is stopped and found.status.complete is not stopped
        assert ("a trace that verifies the goal ended early" in found.message) is stopped


@pytest.mark.slow
def test_a_parameter_that_removes_no_jump():
    """eps_scale multiplies stiffness amplitudes, of which this pair has none."""
    found = hb.design.redesign(PAIR, hb.design.no_jumps(), ["eps_scale"])
    assert not found.reached and math.isnan(found.short) and found.values == {"eps_scale": 1.0}
    assert found.message.startswith("jumps remain, and no value of eps_scale was found at which one vanishes")


@pytest.mark.slow
def test_a_cusp_farther_away(cusp):
    """A margin adds its distance to the damping at the cusp; it may be measured in a parameter that stays fixed."""
    found = hb.design.redesign(PAIR, hb.design.no_jumps(0.2), ["zeta"])
    assert found.reached and found.values["zeta"] == pytest.approx(cusp + 0.2 * 0.05, rel=1e-4)
    found = hb.design.redesign(PAIR, hb.design.no_jumps(0.2, "zeta"), ["e_scale"])
    assert found.reached
    apart = hb.analysis.critical_parameter(
        hb.HarmonicBalance(found.model, 5), "zeta", frequencies=PAIR.model.default_span
    ).value
    assert apart == pytest.approx(0.05 - 0.2 * 0.05, rel=1e-3)
    near, far = (
        hb.trace(hb.HarmonicBalance(found.model.replace(zeta=apart + side * 2e-4), 5), "Omega", (1.5, 0.3))
        for side in (1, -1)
    )
    assert not near.jumps() and far.jumps()
    with pytest.raises(KeyError, match="no parameter 'zetta'"):
        hb.design.redesign(PAIR, hb.design.no_jumps(0.2, "zetta"), ["zeta"])


@pytest.mark.parametrize(("name", "side"), [("zeta", 1.0), ("F", -1.0)])
def test_a_margin_is_verified_by_a_trace_toward_the_cusp(name, side):
    """The jump exists below the cusp of the damping and above the cusp of the force; a design 10 % beyond either cusp
    satisfies margins of 5 % and 9 % and misses margins of 11 % and 15 %."""
    span, short = (1.6, 0.8), 0.04
    cusp = hb.analysis.critical_parameter(hb.HarmonicBalance(hb.Duffing(), 1), name, frequencies=span)
    assert cusp.jump_below is (side > 0)
    own = cusp.value / (1 - 0.1 * side)
    problem = hb.HarmonicBalance(hb.Duffing(**{name: own}), 1)
    spread = Spread({}, 2.0, (), 1.0)
    for margin, expected in ((0.05, 0.0), (0.09, 0.0), (0.11, short), (0.15, short)):
        search = Search(problem, hb.design.no_jumps(margin), (name,), np.array([own]), span, spread, None)
        search.cusps = [Cusp(name, side, cusp.point, np.zeros(1))]
        search.slack = Slack(np.array([[margin - short]]), np.ones((1, 1, 1)), np.array([margin]))
        curve, missed = _traced_shortfall(search, np.zeros(1), {})
        assert missed == pytest.approx(expected, rel=1e-12) and not curve.jumps()


@pytest.mark.slow
def test_a_goal_for_every_machine_of_a_sample(plain):
    """With deviations of the damping alone the worst machine, or the worst of the required share, is at the cusp."""
    drawn = hb.design.monte_carlo(9, 4, zeta=("normal", 0.0, 0.002))
    off = np.sort([row["zeta"] for row in drawn.rows()])
    every = hb.design.redesign(PAIR, hb.design.no_jumps(), ["zeta"], tolerances=drawn)
    assert every.reached and every.share == 1.0
    assert every.values["zeta"] == pytest.approx(plain - off[0], rel=1e-4)
    most = hb.design.redesign(PAIR, hb.design.no_jumps(), ["zeta"], tolerances=drawn, share=0.75)
    assert most.reached and most.share == pytest.approx(7 / 9)
    assert most.values["zeta"] == pytest.approx(plain - off[2], rel=1e-4)


@pytest.mark.slow
def test_a_peak_below_its_limit_for_a_sample():
    """Two parameters change and a third one scatters: the highest peak of all traced machines equals the limit."""
    own = max(point.amplitude("pp2") for point in hb.analysis.peaks(hb.trace(PAIR, "Omega", (1.5, 0.3)), "pp2"))
    drawn = hb.design.latin_hypercube(6, 1, zeta=("normal", 0.0, 0.002), F_m=("uniform", -0.01, 0.01))
    found = hb.design.redesign(PAIR, hb.design.peak_below(0.9 * own), ["zeta", "e[0]"], tolerances=drawn)
    assert found.reached and found.share == 1.0
    tops = []
    for row in drawn.rows():
        values = {"zeta": found.values["zeta"] + row["zeta"], "e[0]": found.values["e[0]"], "F_m": 0.1 + row["F_m"]}
        curve = hb.trace(hb.HarmonicBalance(PAIR.model.replace(**values), 5), "Omega", (1.5, 0.3), stability=False)
        tops.append(max(point.amplitude("pp2") for point in hb.analysis.peaks(curve, "pp2")))
    assert max(tops) == pytest.approx(0.9 * own, rel=2e-3) and max(tops) <= 0.9 * own
    # within tight bounds the goal cannot be reached for 90 % of the sample, and the result reports it
    tight = {"zeta": (0.0499, 0.0501), "e[0]": (0.0499, 0.0501)}
    short = hb.design.redesign(
        PAIR, hb.design.peak_below(0.995 * own), ["zeta", "e[0]"], tight, tolerances=drawn, share=0.9
    )
    assert not short.reached and short.share < 0.9 and short.short > 0
    with pytest.raises(ValueError, match="give either scatter"):
        hb.design.redesign(PAIR, hb.design.no_jumps(), ["zeta"], scatter={"zeta": 0.001}, tolerances=drawn)
    with pytest.raises(ValueError, match="share = 0"):
        hb.design.redesign(PAIR, hb.design.no_jumps(), ["zeta"], tolerances=drawn, share=0)


def test_the_nearest_point_of_several_half_planes():
    """Against a grid search; if no point within the bounds lies in all of them, the smallest excess is largest."""
    rng = np.random.default_rng(5)
    low, high = np.array([-0.5, -0.4]), np.array([0.6, 0.5])
    grid = np.stack(np.meshgrid(np.linspace(-0.5, 0.6, 441), np.linspace(-0.4, 0.5, 361), indexing="ij"), -1)
    for _ in range(20):
        slack = Slack(rng.normal(0, 0.1, (3, 1)), rng.normal(size=(3, 1, 2)), np.full(3, 0.05))
        c, slopes = slack.c[:, 0], slack.slopes[:, 0]
        u = rng.uniform(-0.1, 0.1, 2)
        found = smallest_change(slack, u, low, high)
        excess = ((grid - u) @ slopes.T + c - slack.required).min(axis=-1)
        good, reached = excess >= 0, ((found - u) @ slopes.T + c - slack.required).min()
        assert reached == pytest.approx(-slack.predicted(found - u), abs=1e-12)
        if not good.any():
            assert (
                excess.max() - 1e-9 <= reached < excess.max() + 0.01 and (found >= low).all() and (found <= high).all()
            )
            continue
        assert reached >= -1e-9
        assert np.linalg.norm(found) <= np.linalg.norm(grid, axis=-1)[good].min() + 1e-9


@hb.mechanics.model(default_span=(0.7, 1.4))
def absorber(tuning: float = 0.9, ratio: float = 0.1):
    """Mass with a tuned mass damper of a twentieth of its mass."""
    k, c = 0.05 * tuning**2, 0.1 * ratio
    spring = hb.Element([1.0, 0.0], hb.Cubic(1e-12), name="x")
    load = hb.Load(cosine={1: [1.0, 0.0]})
    return hb.System([[1, 0], [0, 0.05]], [[c + 1e-9, -c], [-c, c]], [[1 + k, -k], [-k, k]], [spring], load)


def absorber_height(Omega, tuning, ratio):
    """Return the amplitude of the mass of `absorber` in closed form."""
    k, c = 0.05 * tuning**2, 0.1 * ratio
    absorbed = k + 1j * c * Omega
    force = absorbed * -0.05 * Omega**2 / (absorbed - 0.05 * Omega**2)
    return np.abs(1 / (1 - Omega**2 + force))


@pytest.mark.parametrize("factor", [1.05, 1.02, 1.01])
def test_two_peaks_of_an_absorber(factor):
    """A stiffer absorber lowers one peak and raises the other.

    Both peaks of the result are at the limit, and no absorber at a smaller distance has lower peaks. The smallest limit
    is close to the height sqrt((2 + mu) / mu) of equal peaks, Den Hartog (1985), Mechanical Vibrations, section 3.3.
    """
    limit = factor * np.sqrt((2 + 0.05) / 0.05)
    found = hb.design.redesign(
        hb.HarmonicBalance(absorber(), 1), hb.design.peak_below(limit, "pp2"), ["tuning", "ratio"]
    )
    assert found.reached and found.steps <= 8
    Omega = np.linspace(0.7, 1.4, 4001)
    response = absorber_height(Omega, found.values["tuning"], found.values["ratio"])
    tops = response[1:-1][(response[1:-1] > response[:-2]) & (response[1:-1] > response[2:])]
    assert tops == pytest.approx([limit, limit], rel=3e-3) and max(tops) <= limit
    angle = np.linspace(0, 2 * np.pi, 181)
    u = 0.97 * found.distance * np.array([np.cos(angle), np.sin(angle)])
    near = absorber_height(Omega[:, None], 0.9 * (1 + u[0]), 0.1 * (1 + u[1]))
    assert near.max(axis=0).min() > limit


@pytest.mark.parametrize("factor", [1.0, 0.95, 0.8])
@pytest.mark.parametrize("bounds", [{}, {"tuning": (0.85, 0.92)}])
def test_a_limit_below_the_smallest_height_of_an_absorber(factor, bounds):
    """The result has the smallest height of all absorbers, from a grid of the closed form; steps are halved near it."""
    limit = factor * np.sqrt((2 + 0.05) / 0.05)
    problem = hb.HarmonicBalance(absorber(), 1)
    found = hb.design.redesign(problem, hb.design.peak_below(limit, "pp2"), ["tuning", "ratio"], bounds)
    tunings = np.linspace(0.91, 0.92, 11) if bounds else np.linspace(0.9519, 0.9529, 41)
    ratios = np.linspace(0.138, 0.141, 31) if bounds else np.linspace(0.125, 0.13, 41)
    Omega = np.linspace(0.8, 1.2, 2001)[:, None, None]
    smallest = absorber_height(Omega, tunings[:, None], ratios).max(axis=0).min()
    assert not found.reached and found.steps <= 20 and found.message.startswith(f"{found.steps} steps")
    assert found.curve.amplitude("pp2").max() == pytest.approx(smallest, rel=1e-4)
    assert found.short == pytest.approx(smallest / limit - 1, abs=1e-4)


def test_the_largest_amplitude_at_an_end_of_the_span():
    """Below both peaks of an absorber the amplitude increases to the end of the span, against its closed form."""
    problem, (before,) = hb.HarmonicBalance(absorber(), 1), absorber_height(np.array([0.8]), 0.9, 0.1)
    found = hb.design.redesign(
        problem, hb.design.peak_below(0.95 * before, "pp2"), ["tuning", "ratio"], span=(0.5, 0.8)
    )
    assert found.reached and found.steps <= 8
    (after,) = absorber_height(np.array([0.8]), found.values["tuning"], found.values["ratio"])
    assert after == pytest.approx(0.95 * before, rel=2e-3) and after <= 0.95 * before
    angle = np.linspace(0, 2 * np.pi, 721)
    u = 0.98 * found.distance * np.array([np.cos(angle), np.sin(angle)])
    assert absorber_height(0.8, 0.9 * (1 + u[0]), 0.1 * (1 + u[1])).min() > 0.95 * before


def test_a_sample_of_amplitudes_at_an_end_of_the_span():
    """The required share of a sample is below the limit at the end of the span, as single curves confirm."""
    drawn = hb.design.latin_hypercube(10, e_scale=("normal", 0.0, 0.02))
    goal, span = hb.design.peak_below(0.17), (1.4, 1.0)
    found = hb.design.redesign(PAIR, goal, ["e_scale"], span=span, tolerances=drawn)
    heights = []
    for row in drawn.rows():
        other = PAIR.model.replace(e_scale=found.values["e_scale"] + row["e_scale"])
        curve = hb.trace(hb.HarmonicBalance(other, 5), "Omega", span, stability=False)
        heights.append(curve.amplitude("pp2"))
    assert found.reached and found.share == 1.0 and all(each.argmax() == len(each) - 1 for each in heights)
    assert max(each[-1] for each in heights) == pytest.approx(0.17, rel=2e-3)


class _TwoHalfPlanes(Search):
    """Search whose cusps are two straight lines x + 2 y = 0.3 and 2 x + y = 0.3, found in turn, one in each search."""

    searches = 0

    def _relocated_cusps(self, u):
        lines = [(u @ a - 0.3, {"x": a[0], "y": a[1]}) for a in np.array([[1.0, 2.0], [2.0, 1.0]])]
        return [[lines[i]] for i in self.cusps]

    def _add_cusps(self, u):
        new = self.searches % 2
        self.searches += 1
        if new in self.cusps:
            return False
        self.cusps.append(new)
        return True


def test_cusps_found_one_after_the_other_remain():
    """The search ends at the corner of two half-planes and not at the nearest point of one of them."""
    problem = hb.HarmonicBalance(hb.Duffing(), 1)
    search = _TwoHalfPlanes(
        problem, hb.design.no_jumps(), ("x", "y"), np.ones(2), (0.5, 1.5), Spread({}, 2.0, (), 1.0), None
    )
    u = search.run(np.zeros(2), np.full(2, -1.0), np.full(2, 1.0))
    assert u == pytest.approx([(0.3 + 1e-3) / 3] * 2, abs=1e-6)
    assert search.steps < 8 and search.message.endswith("steps")


def test_nothing_to_do():
    found = hb.design.redesign(hb.HarmonicBalance(hb.SpurPair(zeta=0.2), 5), hb.design.no_jumps(), ["zeta"])
    assert found.reached and found.distance == 0 and "reaches the goal without a change" in found.message
    found = hb.design.redesign(PAIR, hb.design.peak_below(5.0), ["zeta"])
    assert found.reached and found.changes == {"zeta": 0.0}


def test_the_goal_is_verified_at_the_peak_between_the_points_of_the_curve():
    """The peak of a linear oscillator is F / (2 zeta sqrt(1 - zeta^2)); its highest point is 2e-4 lower."""
    problem = hb.HarmonicBalance(hb.Duffing(k3=0.0, F=0.02), 1)
    limit = 0.9999 * 0.02 / (0.1 * np.sqrt(1 - 0.05**2))
    assert hb.trace(problem, "Omega", (0.5, 1.5)).amplitude("pp2").max() < limit
    found = hb.design.redesign(problem, hb.design.peak_below(limit), ["zeta"], {"zeta": (0.04, 0.05)}, span=(0.5, 1.5))
    assert not found.reached and found.short == pytest.approx(1e-4, rel=1e-2)


def test_invalid_redesigns_are_refused():
    with pytest.raises(KeyError, match="no parameter 'zetta'"):
        hb.design.redesign(PAIR, hb.design.no_jumps(), ["zetta"])
    with pytest.raises(ValueError, match="name at least one parameter"):
        hb.design.redesign(PAIR, hb.design.no_jumps(), [])
    with pytest.raises(ValueError, match="W is 0 in the model"):
        hb.design.redesign(hb.HarmonicBalance(hb.gears.DoubleHelicalPair(), 4), hb.design.no_jumps(), ["W"])
    with pytest.raises(ValueError, match="F_m is not among the parameters that may change"):
        hb.design.redesign(PAIR, hb.design.no_jumps(), ["zeta"], {"F_m": (0.1, 0.2)})
    with pytest.raises(ValueError, match=r"must contain its value 0\.05"):
        hb.design.redesign(PAIR, hb.design.no_jumps(), ["zeta"], {"zeta": (0.06, 0.2)})
    with pytest.raises(ValueError, match="limit = -1"):
        hb.design.peak_below(-1)
    with pytest.raises(ValueError, match="peak_below: no measure 'peak'; there are rms, pp2"):
        hb.design.peak_below(1.0, "peak")
    with pytest.raises(TypeError, match="needs a goal, such as no_jumps"):
        hb.design.redesign(PAIR, "no jumps", ["zeta"])


@pytest.mark.slow
@pytest.mark.parametrize(
    ("words", "code", "said"),
    [
        ("--free zeta=0.04:0.052 --peak 0.5", 1, "the goal, pp2 at most 0.5, is missed by"),
        ("--free zeta,F --scatter zeta=0.002 --draws 4", 0, "100% of 4 machines drawn from the scatter reach the goal"),
        ("--free F --margin 0.1 --margin-in zeta", 0, "the goal, no jumps, is reached"),
        ("--free F --draws 4", 2, "--draws needs the scatter"),
        ("--free F --margin 0.1 --peak 1", 2, "give --margin or --peak"),
        ("--free zeta=0.04", 2, "need NAME or NAME=LOW:HIGH"),
    ],
)
def test_command(run, words, code, said):
    end, out, err = run(f"redesign duffing --harmonics 1 {words}")
    assert end == code and said in (err if code == 2 else out)


@pytest.mark.slow
def test_command_with_the_limit_of_a_machine(run):
    """The highest peak of the new curve in half backlashes of 25 um is the limit in um."""
    words = "--free zeta --harmonics 3 --from 1.6 --to 0.6"
    model = hb.gears.DoubleHelicalPair()
    before = hb.trace(hb.HarmonicBalance(model, 3), "Omega", (1.6, 0.6)).amplitude("pp2").max() * model.b_c * 1e6
    limit = f"{0.9 * before:.4g}um"
    code, out, err = run(f"redesign double-helical {words} --peak {limit} -o new.npz")
    assert (code, err) == (0, "") and f"the goal, pp2 at most {limit}, is reached" in out
    top = hb.analysis.peaks(hb.load("new.npz", hb.HarmonicBalance(model, 3)), "pp2", share=0.9)[0]
    assert top.amplitude("pp2") * model.b_c * 1e6 == pytest.approx(0.9 * before, rel=2e-3)


@pytest.mark.parametrize(
    ("words", "said"),
    [
        ("double-helical --free zeta --peak 20", "need a quantity with its unit, such as --peak 20um"),
        ("double-helical --free zeta,b_c --peak 20um", "changes with b_c"),
        ("double-helical --free zeta --scatter b_c=1 --peak 20um", "changes with b_c"),
        ("double-helical --free zeta --peak 20N", "must be a quantity in m"),
        ("duffing --free zeta --peak 20um", "need a finite number"),
    ],
)
def test_command_with_a_limit_of_the_wrong_unit(run, words, said):
    code, _, err = run(f"redesign {words}")
    assert code == 2 and said in err


@pytest.mark.slow
def test_command_saves_the_new_curve(run):
    code, out, _ = run("redesign duffing --harmonics 1 --free zeta,F -o new.npz")
    assert code == 0 and "the goal, no jumps, is reached" in out
    assert not hb.load("new.npz").jumps()


def test_a_parameter_without_effect_is_not_changed():
    """eps_scale has no effect on the peaks of a pair without harmonics of the stiffness."""
    found = hb.design.redesign(PAIR, hb.design.peak_below(0.1), ["eps_scale"])
    assert not found.reached and found.changes == {"eps_scale": 0.0} and found.steps == 1


def test_a_fold_outside_the_span():
    """With an amplitude of the error of 0.05 the pair does not jump between Omega = 0.8 and 1.4, and with 0.02 it does.

    The cusp between them, at 0.0125, does not matter to the design.
    """
    problem = hb.HarmonicBalance(hb.SpurPair(), 2)
    found = hb.design.redesign(problem, hb.design.no_jumps(), ["e[0]"], span=(1.4, 0.8))
    assert found.reached and found.distance == 0 and found.curve.jumps() == ()
    lower = hb.HarmonicBalance(hb.SpurPair(e=(0.02,)), 2)
    assert hb.trace(lower, "Omega", (1.4, 0.8)).jumps()
    changed = hb.design.redesign(lower, hb.design.no_jumps(), ["e[0]"], span=(1.4, 0.8))
    assert changed.reached and changed.values["e[0]"] == pytest.approx(0.01248, rel=3e-3)
    # with two harmonics the fold curve ends below the cusp, which is located with more of them
    below = hb.analysis.critical_parameter(
        hb.HarmonicBalance(hb.SpurPair(e=(0.01243,)), 2), "e[0]", frequencies=(1.4, 0.8)
    )
    assert below.value == pytest.approx(0.012482, abs=1e-6) and not below.jump_below
