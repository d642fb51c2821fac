"""Special points against shooting: error estimates, multipliers at located points, first point of a branch."""

from dataclasses import replace

import numpy as np
import pytest
from cross.shooting import shoot, state

import hbgear as hb
from hbgear.continuation.curve.segment import Segment, point_from_solution
from hbgear.continuation.events.accuracy import estimate_error
from hbgear.continuation.events.branch_point import BranchPointEvent
from hbgear.continuation.events.event import LocatedEvent
from hbgear.continuation.problem.adapter import as_problem
from hbgear.continuation.problem.base import observe_all
from hbgear.continuation.problem.curve_equations import CurveEquations
from hbgear.continuation.solvers.newton import solve
from hbgear.harmonic.bifurcations.multiplier_events import NeimarkSackerEvent, PeriodDoublingEvent

STATED = 3.0  # largest ratio of the true to the stated error
CRITICAL = 1e-3  # largest distance of a multiplier from +1 or -1 at a located point


def by_shooting(problem, point):
    """Multipliers of the motion at a special point by shooting, at its parameters."""
    Omega = point.parameters["Omega"]
    own = problem.with_order(problem.nu, point.layout.harmonics)
    _, period = shoot(problem.model.system(), Omega, state(own, point.X, Omega=Omega), problem.nu)
    return np.linalg.eigvals(period.monodromy)


# ---- error estimates


def stiff_stop():
    """Two masses and a stop a hundred times as stiff as their springs."""
    K = np.array([[1.0, -1.0], [-1.0, 2.0]])
    stop = hb.Element([1.0, 0.0], hb.Unilateral(k=100.0, gap=1.0))
    return hb.System(np.eye(2), 0.03 * K, K, [stop], hb.Load(cosine={1: [0.0, 0.1]}))


DOUBLING = 0.738783025373  # by shooting


@pytest.fixture(scope="module")
def near_the_doubling():
    """A resonant motion after the upper fold, at an Omega slightly above the period doubling."""
    rough = hb.trace(hb.HarmonicBalance(stiff_stop(), 32), "Omega", (0.8, 0.6), accuracy=None, stability=False)
    behind = rough["LP2"].index + np.flatnonzero(rough.values[rough["LP2"].index :] < 0.743)[0]
    return rough[int(behind)]


@pytest.mark.slow
def test_the_error_of_a_doubling_does_not_depend_on_how_it_was_reached(near_the_doubling):
    """With 64 harmonics an error of 3.3e-7 or 6.6e-6 was stated for a point whose true error is 1.0e-5.

    It is located from 32 and from 64 harmonics, to two accuracies; equal harmonics give equal errors, to 20 %.
    """
    stated = {}
    for harmonics, accuracy in ((32, 1.2e-5), (64, 1.2e-5), (64, 5e-6)):
        balance = hb.HarmonicBalance(stiff_stop(), harmonics)
        curve = hb.trace(balance, "Omega", (0.743, 0.737), start=near_the_doubling, accuracy=accuracy)
        (point,) = (p for p in curve.special if p.kind == "PD")
        true = abs(point.parameters["Omega"] - DOUBLING)
        assert point.located and true <= STATED * point.error, (harmonics, accuracy)
        assert np.abs(point.multipliers + 1).min() < CRITICAL
        stated.setdefault(point.layout.harmonics, []).append(point.error)
    same = max(stated.values(), key=len)
    assert len(same) >= 2 and max(same) < 1.2 * min(same)


def test_a_doubling_of_the_stiff_stop_by_shooting(near_the_doubling):
    """At the reference `DOUBLING` the monodromy matrix of shooting has the multiplier -1, to 1e-6."""
    balance = hb.HarmonicBalance(stiff_stop(), 32)
    X = solve(balance, balance.from_point(near_the_doubling), {"Omega": DOUBLING}).X
    _, period = shoot(stiff_stop(), DOUBLING, state(balance, X, Omega=DOUBLING))
    assert np.abs(np.linalg.eigvals(period.monodromy) + 1).min() < 1e-6


# ---- located points have the multipliers of their event


def two_gaps():
    """Two equal masses with equal backlashes and loads: symmetric motions with branch points."""
    C, K = 0.05 * np.array([[2.0, -1.0], [-1.0, 2.0]]), np.array([[2.0, -0.3], [-0.3, 2.0]])
    gaps = [hb.Element(w, hb.Backlash(b=0.3, k=8.0), name=n) for w, n in (([1.0, 0.0], "a"), ([0.0, 1.0], "b"))]
    return hb.System(np.eye(2), C, K, gaps, hb.Load(cosine={1: [0.3, 0.3]}))


BRANCHING = 1.0149020  # by shooting in the symmetric subspace


@pytest.mark.parametrize("harmonics", [16, 128])
def test_a_branch_point_states_its_error_at_every_size(harmonics):
    """With 128 harmonics it was located at .98, an end of its segment, with an error of nan and without warning."""
    problem = hb.HarmonicBalance(two_gaps(), harmonics)
    assert (problem.refined_problem is None) == (harmonics == 128) and len(problem.comparisons) == 2
    curve = hb.trace(problem, "Omega", (0.99, 1.03))
    (point,) = (p for p in curve.special if p.kind == "BP")
    assert point.located and abs(point.parameters["Omega"] - BRANCHING) <= STATED * point.error + 5e-8
    assert point.error < 1e-5 and np.abs(point.multipliers - 1).min() < CRITICAL


def test_a_branch_point_has_the_multiplier_by_shooting():
    """Shooting is singular at the point; the multiplier passes +1 between motions on both sides."""
    curve = hb.trace(hb.HarmonicBalance(two_gaps(), 16), "Omega", (0.99, 1.03))
    (point,) = (p for p in curve.special if p.kind == "BP")
    problem, real = curve.problem.with_order(1, 64), []
    for step in (-3e-4, 3e-4):
        Omega = point.parameters["Omega"] + step
        X = solve(problem, problem.resized(point.X), {"Omega": Omega}).X
        _, period = shoot(problem.model.system(), Omega, state(problem, X, Omega=Omega))
        mu = np.linalg.eigvals(period.monodromy)
        real.append(float(mu[np.abs(mu - 1).argmin()].real) - 1)
    assert real[0] > 5e-3 and real[1] < -5e-3
    assert abs(sum(real)) / 2 < CRITICAL / 10


def segment_without_events(event):
    """A segment of a spur pair's curve without special points, and its end as a located point of an event."""
    curve = hb.trace(hb.HarmonicBalance(hb.SpurPair(), 6), "Omega", (1.5, 1.3), special=False)
    problem, scale = as_problem(curve.problem), np.ones(14)
    rows = [
        point_from_solution(solve(problem, curve.X[k], {"Omega": curve.values[k]}, "Omega"), np.eye(14)[-1], scale)
        for k in (0, 2)
    ]
    observed = observe_all(CurveEquations(problem, "Omega", {}), np.array([r.u for r in rows]), True)
    for row, seen in zip(rows, observed, strict=True):
        row.observed.update(seen)
    return Segment(problem, "Omega", {}, *rows, scale, hb.NewtonSettings()), LocatedEvent(event, 0.0, rows[0], True)


@pytest.mark.parametrize("event", [BranchPointEvent(), PeriodDoublingEvent()])
def test_a_point_without_the_multiplier_of_its_event_is_not_located(event):
    arc, found = segment_without_events(event)
    assert not estimate_error(arc, found, 1e-5).located


def test_multipliers_that_were_refined_at_the_ends_are_no_crossing(monkeypatch):
    """Refined multipliers at the ends of a segment jump to those along it: two evaluations are enough."""
    arc, _ = segment_without_events(NeimarkSackerEvent())
    arc.a.observed["multipliers"] = np.array([1.1, 0.6 + 0.3j, 0.6 - 0.3j])
    arc.b.observed["multipliers"] = np.array([1.05 + 0.2j, 1.05 - 0.2j, 0.5])
    calls, multipliers = [], type(arc.problem).multipliers

    def counted(self, X, **given):
        calls.append(X)
        return multipliers(self, X, **given)

    monkeypatch.setattr(type(arc.problem), "multipliers", counted)
    assert NeimarkSackerEvent().find(arc) == [] and len(calls) == 2


def test_an_unknown_error_is_a_doubt_that_names_the_point():
    curve = hb.trace(hb.HarmonicBalance(hb.Duffing(), 5), "Omega", (0.8, 1.6))
    assert curve.warnings == ()
    unknown = tuple(replace(p, error=np.nan) if p.label == "LP2" else p for p in curve.special)
    assert "LP2 not known" in replace(curve, special=unknown).warnings[0]
    plain = hb.trace(hb.HarmonicBalance(hb.Duffing(), 5), "Omega", (0.8, 1.6), accuracy=None)
    assert np.isnan(plain["LP1"].error) and plain.warnings == ()  # no accuracy is required


# ---- first point of a branch


def test_a_branch_begins_at_its_special_point_and_not_beyond_its_first_fold():
    """The doubled branch of a subcritical doubling has a fold 3e-4 above it, within a fraction of the first step.

    Its first motions are unstable; at the fold shooting gives a multiplier +1, and a sweep jumps.
    """
    curve = hb.trace(hb.HarmonicBalance(hb.SpurPair(e=(0.1,)), 16), "Omega", (2.1, 1.75))
    doubled = hb.switch(curve, "PD1")
    again = hb.switch(doubled, "PD1", steps=hb.StepControl(max_points=20))
    assert again.problem.nu == 4
    for old, new, label in ((curve, doubled, "PD1"), (doubled, again, "PD1")):
        point = old[label]
        assert new.values[0] == pytest.approx(point.parameters["Omega"], abs=1e-9)
        assert np.linalg.norm(new.problem.subharmonic_part(new.X[0])[::2]) < np.linalg.norm(new.X[0])
    fold = again["LP1"]
    assert fold.parameters["Omega"] == pytest.approx(1.84650, abs=5e-6)  # by another continuation with nu = 4
    assert not again.stable[1 : fold.index].any() and again.stable[fold.index + 1]
    assert np.abs(by_shooting(again.problem, fold) - 1).min() < 0.02  # |mu - 1| decreases as a square root near a fold
    assert [jump.label for jump in again.jumps()] == ["LP1"]


# ---- long steps


def test_long_steps_do_not_lose_a_pair_of_doublings():
    """An unstable range of width .043 within a step of .23, which was missed without warning."""
    eps = (0.08719385437618231, 0.012913368645819146, 0.005505055803624091)
    model = hb.SpurPair(zeta=0.018939949313678924, F_m=0.39088024656702675, eps=eps, e=(), phase="sin")
    steps = hb.StepControl(max_step=0.12, max_turn_deg=35)
    long = hb.trace(hb.HarmonicBalance(model, 10), "Omega", (0.3, 2.5), steps=steps)
    pair = [p for p in long.special if p.kind == "PD"]
    places = [p.parameters["Omega"] for p in pair]
    assert places == pytest.approx([1.97798, 2.02085], abs=2e-5)
    for point in pair:
        assert np.abs(by_shooting(long.problem, point) + 1).min() < CRITICAL
    between = (long.values > places[0]) & (long.values < places[1])
    assert between.any() and not long.stable[between].any()
