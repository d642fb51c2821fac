"""Sweeps by time integration against continuation: the same amplitudes, and jumps where the folds are."""

import dataclasses
from itertools import pairwise

import matplotlib.pyplot as plt
import numpy as np
import pytest
from machines import single_mass
from matplotlib.colors import to_rgb
from scipy.integrate import solve_ivp

import hbgear as hb
from hbgear import plot
from hbgear.continuation.results.status import Status
from hbgear.continuation.solvers.newton import solve
from hbgear.time.basins_of_attraction import basins
from hbgear.time.exponential.integrator import ExponentialIntegrator
from hbgear.time.frequency_sweep import export, sweep
from hbgear.time.observation import observe
from hbgear.time.steady_state import FEWEST, SteadyStateSettings, lyapunov, settle

FOLDS = (0.7080316187, 0.8284639844)
ATTRACTORS = (0.05141, 0.34055)


@pytest.fixture(scope="module")
def pair():
    return hb.trace(hb.HarmonicBalance(hb.SpurPair(), 40), "Omega", (1.0, 0.55))


@pytest.fixture(scope="module")
def up():
    return sweep(hb.SpurPair(), np.linspace(0.69, 0.85, 9), "up")


@pytest.fixture(scope="module")
def down():
    return sweep(hb.SpurPair(), np.linspace(0.69, 0.85, 9), "down")


def test_the_legend_explains_the_bands_of_jumps(up, down):
    axes = plot.sweeps([up, down])
    names = [text.get_text() for text in axes.get_legend().get_texts()]
    assert names == ["sweep up", "sweep down", "sweep up, jump", "sweep down, jump"]
    plt.close(axes.figure)


@pytest.mark.slow
def test_a_jump_that_hardly_changes_the_rms_is_found():
    """The amplitude falls by 22 % at a fold, the rms rises by 2 %: the third harmonic is lost."""
    M, K = np.diag([5.0, 5.0, 8.0]), 1e6 * np.array([[3.0, -1.0, 0.0], [-1.0, 4.0, -1.0], [0.0, -1.0, 2.0]])
    seal = hb.Element([1.0, 0.0, 0.0], hb.Backlash(k=5e6, b=1e-5), name="seal")
    rotor = hb.System(M, 1e-4 * K, K, [seal], hb.Load(cosine={1: [0.0005, 0.0, 0.0]}, power=2))
    curve = hb.trace(hb.HarmonicBalance(rotor, 16), "Omega", (300.0, 400.0))
    (fold,) = (jump.value for jump in curve.jumps() if jump.direction < 0)
    found = sweep(rotor, [*np.linspace(360.0, 372.0, 9), 390.0, 430.0, 500.0], "down")
    ((before, after),) = [jump.interval for jump in found.jumps]
    assert after < fold < before
    i = int(np.flatnonzero(found.values == after)[0])
    assert abs(found.rms[i, 0] / found.rms[i - 1, 0] - 1) < 0.03 and found.pp2[i, 0] < 0.8 * found.pp2[i - 1, 0]


def stable_rms(curve, Omega):
    """rms of the stable motions of a curve at one frequency."""
    x = curve.values - Omega
    out = []
    for i in np.flatnonzero(x[:-1] * x[1:] <= 0):
        X = solve(curve.problem, curve.X[i], {"Omega": Omega}).X
        if np.abs(curve.problem.multipliers(X, Omega=Omega)).max() < 1:
            out.append(float(curve.layout.measure("rms", X)))
    return np.array(out)


# ---- against continuation


def test_jumps_are_where_the_folds_are(up, down):
    """Within the sweep's own step, and nowhere else."""
    ((rise,), (fall,)) = up.jumps, down.jumps
    assert (rise.direction, fall.direction) == (1, -1)
    assert rise.interval[0] < FOLDS[1] < rise.interval[1] and fall.interval[1] < FOLDS[0] < fall.interval[0]
    assert abs(np.diff(rise.interval)) == pytest.approx(0.02) and rise.after > rise.before and fall.after < fall.before


def test_every_dot_lies_on_the_curve(up, down, pair):
    for found in (up, down):
        assert found.settled.all() and (found.period == 1).all() and found.status == Status.REACHED_END
        for Omega, rms in zip(found.values, found.amplitude(), strict=True):
            assert np.abs(stable_rms(pair, Omega) - rms).min() < 2e-6 * rms


def test_between_the_folds_the_two_sweeps_differ(up, down):
    between = (up.values > FOLDS[0]) & (up.values < FOLDS[1])
    assert np.all(down.amplitude()[::-1][between] > 1.5 * up.amplitude()[between])
    np.testing.assert_allclose(
        up.amplitude()[up.values < FOLDS[0]], down.amplitude()[::-1][up.values < FOLDS[0]], rtol=1e-6
    )


def test_measures_are_those_of_the_curve(pair):
    i = int(np.argmin(np.abs(pair.values - 0.9)))
    Omega = float(pair.values[i])
    found = sweep(hb.SpurPair(), [Omega], settling=SteadyStateSettings(1e-10))
    for measure in ("rms", "pp2", "max", "mean", "H1", "H2", "H5"):
        assert found.amplitude(measure)[0] == pytest.approx(pair[i].amplitude(measure), abs=2e-7)
    _, d = pair[i].samples(count=1)
    assert found.points[0][0, 0, 0] == pytest.approx(d[0], abs=1e-6)


def test_two_attractors():
    """SpurPair with F_ah = 0.10 at Omega = 0.65, from starts all over the plane; no other motion is met."""
    found = basins(hb.SpurPair(e=(0.1,)), 0.65, (-2, 2), (-1.5, 1.5), (12, 10))
    assert [a.period for a in found.attractors] == [1, 1]
    np.testing.assert_allclose(sorted(a.rms for a in found.attractors), ATTRACTORS, atol=5e-6)
    assert found.label.shape == (10, 12) and sum(a.share for a in found.attractors) == pytest.approx(1)
    assert found.attractors[0].share >= found.attractors[1].share > 0.1
    # one of the starts, integrated alone
    y, x = 3, 7
    stepper = ExponentialIntegrator(hb.SpurPair(e=(0.1,)), 0.65)
    flight = stepper.start([found.d[x] + 0.1, found.v[y]])
    settle(stepper, flight)
    assert observe(stepper, flight, 1).rms[0] == pytest.approx(found.attractors[found.label[y, x]].rms, abs=1e-5)


def test_default_double_helical_pair_rises_without_a_jump():
    """What a coarse sweep of it shows as a step is a steep slope: turned back by one value it returns."""
    found = sweep(hb.gears.DoubleHelicalPair(), [0.86, 0.89], settling=SteadyStateSettings(1e-5), disturbance=0.0)
    assert found.rms[1, 0] > 1.25 * found.rms[0, 0] and found.jumps == ()
    np.testing.assert_allclose(found.rms[:, 0], found.rms[:, 1], rtol=1e-4)


def test_symmetric_motion_that_is_unstable_is_left_only_if_disturbed():
    """The default double-helical pair between its period doublings: the helices then move in opposite phase too."""
    pair, how = hb.gears.DoubleHelicalPair(), SteadyStateSettings(1e-4, longest=800)
    still = sweep(pair, [0.337], settling=how, disturbance=0.0)
    left = sweep(pair, [0.337], settling=how, disturbance=0.02)
    assert still.period.tolist() == [1] and left.period.tolist() == [2]
    apart = left.points[0][:, 0, 0] - left.points[0][:, 1, 0]
    assert apart[0] == pytest.approx(-apart[1], rel=0.05) and abs(apart[0]) == pytest.approx(0.203, abs=0.01)
    assert abs(still.points[0][0, 0, 0] - still.points[0][0, 1, 0]) < 1e-9


# ---- periods


def test_doubled_motion_has_period_two():
    """Between the period doublings of F_ah = 0.10; harmonic balance over two periods has the same amplitude."""
    curve = hb.trace(hb.HarmonicBalance(hb.SpurPair(e=(0.1,)), 30), "Omega", (2.1, 1.9))
    doubled = hb.switch(curve, "PD1", steps=hb.StepControl(max_points=25))
    Omega = float(doubled.values[-1])
    found = sweep(hb.SpurPair(e=(0.1,)), [Omega])
    assert found.period.tolist() == [2] and found.points[0].shape == (2, 1, 2)
    assert found.amplitude()[0] == pytest.approx(doubled.amplitude()[-1], rel=1e-4)


def test_longer_periods_and_chaos():
    """The same pair further down: period 4, then a motion whose neighbours run away from it."""
    found = sweep(hb.SpurPair(e=(0.1,)), [1.5, 1.66], settling=SteadyStateSettings(longest=600))
    assert found.period.tolist() == [4, 0]
    assert np.isnan(found.lyapunov[0]) and 0.05 < found.lyapunov[1] < 0.1
    assert "1 of 2 motions did not settle" in found.message and found.integrated_periods[1] < 600
    assert [len(p) for p in found.points] == [4, 128]


def test_lyapunov_exponent_of_a_settled_motion_is_its_multiplier():
    """lambda = log|mu| / T: -zeta for the pair in impact, whose multipliers are complex."""
    model = hb.SpurPair()
    stepper = ExponentialIntegrator(model, 0.9)
    flight = stepper.start([1.1, 0.3])
    settle(stepper, flight)
    assert lyapunov(stepper, flight, 100) == pytest.approx(-0.05, abs=1e-3)


@pytest.mark.slow
def test_lyapunov_exponent_of_a_chaotic_motion():
    """x'' + 0.25 x' - x + x^3 = 0.4 cos t, against its variational equation along one long run of other code."""
    double_well = single_mass(hb.Cubic(1.0, -1.0), F=0.4, c=0.25, k=0.0)
    stepper = ExponentialIntegrator(double_well, 1.0)
    flight = stepper.start([0.3, 0.0])
    stepper.advance(flight, 30)
    exponent = lyapunov(stepper, flight, 300)

    def f(t, y):
        x, v, a, b = y
        return [v, -0.25 * v + x - x**3 + 0.4 * np.cos(t), b, -0.25 * b + (1 - 3 * x * x) * a]

    y, logs = np.array([0.3, 0.0, 1.0, 0.0]), []
    for p in range(350):
        y = solve_ivp(f, (2 * np.pi * p, 2 * np.pi * (p + 1)), y, rtol=1e-6, atol=1e-8).y[:, -1]
        size = np.hypot(*y[2:])
        logs.append(np.log(size))
        y[2:] /= size
    true = np.mean(logs[50:]) / (2 * np.pi)
    assert true > 0.05
    assert exponent == pytest.approx(true, rel=0.25)


# ---- settling


def test_settled_means_that_little_is_left():
    """Slow and fast: the distance still to go after it says settled, by going on for long."""
    for zeta, tolerance in ((0.02, 1e-4), (0.02, 1e-6), (0.2, 1e-6)):
        stepper = ExponentialIntegrator(hb.SpurPair(zeta=zeta), 0.5)
        flight = stepper.start([[1.0, 0.5], [2.0, -0.3], [0.0, 0.0]])
        how = settle(stepper, flight, SteadyStateSettings(tolerance))
        there = stepper.to_modal(flight)
        assert (how.period == 1).all()
        stepper.advance(flight, 100)
        size = np.linalg.norm(stepper.to_modal(flight), axis=1)
        left = np.linalg.norm(stepper.to_modal(flight) - there, axis=1) / size
        assert np.all(left < 3 * tolerance)
        assert zeta > 0.1 or left.max() > 1e-3 * tolerance  # it has not waited for ever
    assert how.integrated_periods.max() < 40


def test_a_motion_that_does_not_settle_is_reported():
    found = sweep(hb.SpurPair(zeta=1e-4), [0.5], settling=SteadyStateSettings(longest=60))
    assert (
        found.period[0] == 0
        and found.integrated_periods[0] == 60
        and found.remaining_distance[0] > 1e-3
        and abs(found.lyapunov[0]) < 1e-3
    )
    assert "1 of 1 motions did not settle within 60 periods" in found.message


@pytest.mark.parametrize("longest", [20, 405, 416])
def test_remaining_decay_is_known_for_few_periods(longest):
    """Also if few are left after the 400 after which a motion is tested for chaos."""
    found = sweep(hb.SpurPair(zeta=1e-4), [0.5], settling=SteadyStateSettings(longest=longest))
    assert (
        found.period[0] == 0 and found.integrated_periods[0] == longest and 1e-3 < found.remaining_distance[0] < np.inf
    )


# ---- motions that run away


ESCAPING = hb.Duffing(zeta=0.05, k3=-1.0, F=0.5)  # from rest, over the top of its potential


@pytest.mark.slow
def test_motions_that_run_away_are_one_basin(recwarn):
    """The safe basin of a softening oscillator: bounded motion from near its well, escape from far."""
    soft, Omega = hb.Duffing(zeta=0.05, k3=-1.0, F=0.1), 0.5
    found = basins(soft, Omega, (-2, 2), (-2, 2), (9, 9), settling=SteadyStateSettings(1e-4, 600))
    assert [(a.period, a.rms < 0.1, len(a.points)) for a in found.attractors] == [(0, False, 0), (1, True, 1)]
    assert found.attractors[0].rms == np.inf and found.label[4, 4] == 1 and found.label[0, 0] == 0
    for row, column in ((4, 5), (4, 6), (4, 7), (2, 4), (1, 4)):
        start = [found.d[column], found.v[row]]
        try:
            stays = np.isfinite(hb.time.integrate(soft, start, 20, Omega, tolerance=1e-6).end).all()
        except ArithmeticError:
            stays = False
        assert found.label[row, column] == stays
    assert {text.get_text().partition(":")[0] for text in plot.basins(found).get_legend().texts} == {
        "unbounded",
        f"period 1, rms {found.attractors[1].rms:.4g}",
    }
    plt.close("all")
    assert not recwarn.list


@pytest.mark.parametrize("tolerance", [1e-3, 1e-6])
def test_starts_that_all_lead_to_one_motion_have_one_attractor(tolerance):
    """Their states then differ by nothing but what is still to go."""
    found = basins(hb.Duffing(zeta=0.2), 1.0, shape=(6, 6), settling=SteadyStateSettings(tolerance))
    assert [(a.period, a.share) for a in found.attractors] == [(1, 1.0)]


def test_a_sweep_ends_where_the_motion_runs_away(recwarn):
    soft = hb.Duffing(zeta=0.02, k3=-1.0, F=0.2)
    found = sweep(soft, [0.3, 1.2, 1.1, 0.9], "down", settling=SteadyStateSettings(1e-4, 600))
    assert found.status is hb.Status.FAILED and 0 < len(found) < 4 and np.isfinite(found.rms).all()
    assert f"after {len(found)} of 4 values, the motion diverges at Omega = " in found.message
    assert not recwarn.list


def test_sweep_in_another_parameter(pair):
    """In the damping at fixed Omega, down the resonance."""
    found = sweep(hb.SpurPair(), [0.05, 0.06, 0.07], "down", parameter="zeta", at={"Omega": 0.9})
    curve = hb.trace(hb.HarmonicBalance(hb.SpurPair(), 20), "zeta", (0.05, 0.07), at={"Omega": 0.9}, stability=False)
    assert found.values.tolist() == [0.07, 0.06, 0.05]
    np.testing.assert_allclose(found.amplitude()[[0, 2]], curve.amplitude()[[-1, 0]], rtol=1e-5)


# ---- interruption, bad input, output


def test_results_are_kept_after_an_interruption():
    def stop(now):
        if now.done > 0.5:
            raise KeyboardInterrupt

    found = sweep(hb.SpurPair(), [0.4, 0.42, 0.44, 0.46], progress=stop)
    assert len(found) == 3 and found.status == Status.INTERRUPTED and "after 3 of 4 values" in found.message


def test_progress_is_reported():
    seen = []
    sweep(hb.SpurPair(), [0.4, 0.45], progress=lambda now: seen.append((now.done, now.text)))
    assert [share for share, _ in seen] == [0.5, 1.0] and "Omega = 0.45" in seen[1][1] and "period 1" in seen[1][1]


@pytest.mark.parametrize(
    ("call", "error", "words"),
    [
        (lambda: sweep(hb.SpurPair(), []), ValueError, "at least one value"),
        (lambda: sweep(hb.SpurPair(), [0.5, np.nan]), ValueError, "grid = .* must be finite"),
        (lambda: sweep(hb.SpurPair(), [-0.5, 0.5]), ValueError, "must be positive"),
        (lambda: sweep(hb.SpurPair(), [0.5], "sideways"), ValueError, "'up' or 'down'"),
        (lambda: sweep(hb.SpurPair(), [0.5], parameter="zetta"), KeyError, "did you mean 'zeta'"),
        (lambda: sweep(hb.SpurPair(), [0.05], parameter="zeta"), ValueError, "needs a fixed Omega"),
        (lambda: sweep(hb.SpurPair(), [0.5], disturbance=-1.0), ValueError, "disturbance = -1.0 must be at least 0"),
        (lambda: SteadyStateSettings(tolerance=1e-15), ValueError, "cannot be reached"),
        (lambda: SteadyStateSettings(longest=30, periods=31), ValueError, "exceeds longest"),
        (
            lambda: SteadyStateSettings(longest=FEWEST - 1),
            ValueError,
            "longest = 19 periods are too few .* give 20 or more",
        ),
        (
            lambda: sweep(ESCAPING, [0.9, 1.0]),
            ValueError,
            "diverges at Omega = 0.9: begin at a value with a bounded motion",
        ),
        (
            lambda: hb.time.integrate(ESCAPING, [1.0, 1.0], 9, 0.9, method="exponential"),
            ArithmeticError,
            "diverges within",
        ),
        (lambda: hb.time.integrate(ESCAPING, [1.0, 1.0], 9, 0.9), ArithmeticError, "t = .*: the motion diverges"),
        (lambda: basins(hb.gears.DoubleHelicalPair(), 0.9), ValueError, "24 coordinates"),
        (lambda: basins(hb.SpurPair(), 0.9, d=(1.0, -1.0)), ValueError, "ascending"),
        (lambda: plot.sweeps([]), ValueError, "no sweep"),
        (lambda: plot.sweeps(np.array([])), ValueError, "no sweep"),
    ],
)
def test_bad_input(call, error, words):
    with pytest.raises(error, match=words):
        call()


def test_table_and_figures(up, down, pair, tmp_path):
    export((up, down), tmp_path / "sweep.csv")
    table = np.genfromtxt(tmp_path / "sweep.csv", delimiter=",", names=True)
    assert len(table) == 18 and set(table["direction"]) == {-1, 1}
    np.testing.assert_array_equal(table["rms_gap"], np.concatenate([up.amplitude(), down.amplitude()]))
    with pytest.raises(ValueError, match=r"must end in \.csv"):
        up.export(tmp_path / "sweep.txt")
    ax = plot.sweeps((up, down), pair, "rms")
    dots = {line.get_gid(): line for line in ax.lines if str(line.get_gid()).startswith("sweep")}
    np.testing.assert_array_equal(dots["sweep up"].get_xdata(), up.values)
    np.testing.assert_array_equal(dots["sweep down"].get_ydata(), down.amplitude())
    drawn = [str(line.get_gid()).startswith("branch") for line in ax.lines]
    both = plot.sweeps((up,), dataclasses.replace(pair, others=(pair,)), "rms")
    assert sum(str(line.get_gid()).startswith("branch") for line in both.lines) == 2 * sum(drawn) > 0
    ax = plot.bifurcation((up,))
    np.testing.assert_array_equal(ax.lines[0].get_xdata(), up.values)
    with pytest.raises(ValueError, match="different parameters"):
        plot.sweeps((sweep(hb.SpurPair(), [0.1], parameter="zeta", at={"Omega": 0.5}),), pair)
    with pytest.raises(KeyError, match="no element 'mesh'"):
        up.amplitude("rms", "mesh")
    plt.close("all")


def test_dots_of_motions_without_a_period_are_smaller_and_many_are_pixels(up):
    period = np.array([0, *up.period[1:]])
    cloud = np.random.default_rng(0).normal(size=(1500, 1, 2))
    mixed = dataclasses.replace(up, period=period, points=(cloud, *up.points[1:]))
    settled, wild = plot.bifurcation((mixed,)).lines
    assert (settled.get_label(), wild.get_label()) == ("sweep up", "sweep up, not periodic")
    np.testing.assert_array_equal(settled.get_xdata(), up.values[1:])
    np.testing.assert_array_equal(wild.get_ydata(), cloud[:, 0, 0])
    assert (wild.get_xdata() == up.values[0]).all()
    assert wild.get_markersize() < settled.get_markersize()
    assert wild.get_rasterized() and not settled.get_rasterized()
    plt.close("all")


def test_basins_are_distinct_without_colour():
    lightness = [np.dot((0.299, 0.587, 0.114), to_rgb(shade)) for shade in plot.BASINS]
    assert min(abs(a - b) for a, b in pairwise(lightness)) > 0.08


def test_basins_are_drawn():
    found = basins(hb.SpurPair(e=(0.1,)), 0.65, (0, 2), (-1, 1), (4, 3))
    ax = plot.basins(found)
    assert len({line.get_marker() for line in ax.lines}) == len(found.attractors)
    np.testing.assert_array_equal(ax.images[0].get_array(), found.label)
    for i, a in enumerate(found.attractors):
        (line,) = (line for line in ax.lines if line.get_gid() == f"attractor {i}")
        np.testing.assert_array_equal(line.get_xydata(), a.points)
    plt.close("all")
