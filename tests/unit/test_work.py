"""The bound of the work for solutions with more unknowns, and what a curve says where it is reached."""

import math

import numpy as np
import pytest
from machines import single_mass

import hbgear as hb
from hbgear.continuation.problem.work import MIN_WEIGHT, Work
from hbgear.harmonic.stability import undecided


def test_no_solution_takes_more_than_half_of_the_remaining_work():
    work = Work(2.5)
    taken = [work.allows(700) for _ in range(4)]
    assert taken == [True, False, False, False] and work.refused == 3
    assert work.allows(350) and work.spent == pytest.approx(1.0 + 0.125 + 4e-3)
    while work.allows(70):
        assert work.spent < work.limit
    assert work.limit - work.spent < 2 * 3.1e-3


def test_first_estimates_have_a_sum_of_their_own():
    work = Work(2.5, spent=2.5)
    assert not work.allows(70) and work.estimates(700, solutions=2) and not work.estimates(700)
    assert work.spent == 2.5 and work.estimated == pytest.approx(2 + 4e-3) and work.refused == 2


def test_a_curve_is_traced_again_if_half_of_the_work_is_left():
    work = Work(2.5, spent=1.2, estimated=2.4)
    assert work.affords(700) and not work.affords(700, solutions=2) and work.refused == 1 and work.spent == 1.2
    again = work.renewed()
    assert (again.limit, again.spent, again.estimated, again.refused) == (2.5, 1.2, 1.25, 0)
    assert not Work(2.5, spent=1.3).affords(70)
    assert Work(math.inf, spent=1e9).affords(700, solutions=1000)


def test_exact_motions_have_a_sum_of_their_own():
    work = Work(0.01, spent=0.01, estimated=0.01)
    assert [work.verifies(7, solutions=2) for _ in range(4)] == [True, True, True, False]
    assert work.refused == 1 and work.verified == pytest.approx(0.012, rel=1e-3)


def test_without_a_limit_everything_is_allowed():
    work = Work(math.inf)
    assert all(work.allows(10_000, solutions=50) for _ in range(100)) and not work.refused and not work.message


@pytest.fixture(scope="module")
def stop():
    return single_mass(hb.Unilateral(k=40.0, gap=0.5), F=0.3, c=0.06, name="stop")


def test_a_curve_with_little_work_is_the_same_curve_and_states_unknowns(stop):
    problem = hb.HarmonicBalance(stop, 16)
    full = hb.trace(problem, "Omega", (0.9, 2.2), work=None)
    little = hb.trace(problem, "Omega", (0.9, 2.2), work=0.0)
    assert little.status.complete and "the bound work = 0 was reached" in little.message
    assert "the bound work" not in full.message
    assert little.warnings and len(little.special) >= 1
    for p in little.special:
        assert min(abs(p.parameters["Omega"] - q.parameters["Omega"]) for q in full.special) < 0.05
    assert little.undecided.sum() >= full.undecided.sum()
    assert not little.undecided.all()


@pytest.mark.slow
@pytest.mark.parametrize("work, factor", [(0.04, 10), (0.1, 10), (0.3, 3), (0.6, 3)])
def test_where_the_work_ends_every_point_keeps_the_error_that_it_has(stop, work, factor):
    """The first estimates, and those of points that were located with more harmonics but not compared again.

    Below 0.3 the limit refuses the exact motions that find H = 8 too small: PD1 is .0134 away, .0036 is estimated.
    """
    problem = hb.HarmonicBalance(stop, 8)
    true = hb.trace(hb.HarmonicBalance(stop, 128), "Omega", (0.9, 2.2), cover=False)
    little = hb.trace(problem, "Omega", (0.9, 2.2), accuracy=1e-9, work=work, cover=False)
    assert "the bound work" in little.message and max(p.error for p in little.special) > 1e-9
    for p in little.special:
        off = min(abs(p.parameters["Omega"] - q.parameters["Omega"]) for q in true.special if q.kind == p.kind)
        assert off < factor * p.error + 1e-9
        assert not p.located or factor * p.error + 1e-9 < 4e-2


def test_the_work_is_counted_not_timed(stop):
    problem = hb.HarmonicBalance(stop, 16)
    one, other = (hb.trace(problem, "Omega", (0.9, 2.2), work=0.05) for _ in range(2))
    assert one.message == other.message and np.array_equal(one.values, other.values)
    assert [p.error for p in one.special] == [p.error for p in other.special]


@pytest.mark.parametrize("work", [-1.0, math.nan])
def test_a_bound_is_no_negative_number(stop, work):
    with pytest.raises(ValueError, match="work"):
        hb.trace(hb.HarmonicBalance(stop, 4), "Omega", (0.9, 2.2), work=work)


@pytest.mark.slow
def test_a_rattle_with_endless_contacts_ends_within_its_bound(monkeypatch):
    """At low Omega each period has more impacts, folds and flips; every exact motion counts, also one that fails."""
    problem = hb.HarmonicBalance(
        single_mass(hb.Backlash(k=1.0, b=1.0), F=0.05, mean=0.02, c=0.0, k=0.0, damping=0.1, name="mesh"), 24
    )
    calls, refine = [], undecided.refine_motion

    def counted(*given, **options):
        calls.append(1)
        return refine(*given, **options)

    monkeypatch.setattr(undecided, "refine_motion", counted)
    curve = hb.trace(problem, "Omega", (0.15, 0.1), work=0.1, cover=False)
    assert 0 < len(calls) <= 0.1 / (undecided.EXACT_MOTION_COST * MIN_WEIGHT) + 1
    assert curve.status.complete and "the bound work = 0.1 was reached" in curve.message
    assert curve.undecided.any() and curve.warnings
