"""Pairs of multipliers that cross the unit circle in both directions between two points of a curve."""

from types import SimpleNamespace

import numpy as np
import pytest

import hbgear as hb
from hbgear.continuation.events.even_crossings import SampledCurve, drop_odd_counts, find_even_crossings
from hbgear.continuation.tracing import even_crossing_search
from hbgear.harmonic.multipliers.multiplier_collisions import (
    collisions,
    exchanges,
    extrapolated_crossings,
    leaps,
    passes_minus_one_cleanly,
)


def pairs(*exponents):
    mu = np.exp(np.array(exponents))
    return np.concatenate([mu, mu.conj()])


def test_one_leaves_as_another_returns():
    """sigma = log |mu| of one pair goes from .01 to -.03, of another one from -.02 to .02: crossings at .25 and .5."""
    mu = np.array([pairs(0.01 + 1.4j, -0.02 + 2.6j), pairs(-0.03 + 1.45j, 0.02 + 2.62j)])
    ((piece, s),) = exchanges(mu)
    assert piece == 0 and s == pytest.approx(0.375)


def test_the_same_pair_stays_outside():
    mu = np.array([pairs(0.01 + 1.4j, -0.02 + 2.6j), pairs(0.03 + 1.5j, -0.02 + 2.62j)])
    assert exchanges(mu) == []
    assert exchanges(mu[:, :0]) == []
    assert exchanges(np.array([pairs(-0.01 + 1.4j), pairs(0.01 + 1.4j)])) == []  # the number outside changes


def test_where_their_number_changes_both_crossings_must_be_certain():
    """One pair leaves; the two pairs outside afterwards match pairs outside and inside equally well, or only inside."""
    before, left = pairs(0.01 + 1.0j, -0.02 + 2.0j, -0.02 + 2.5j), -0.01 + 1.01j
    uncertain = np.array([before, pairs(left, 0.02 + 1.5j, 0.02 + 1.4j)])
    assert exchanges(uncertain) == [] and exchanges(uncertain[::-1]) == []
    certain = np.array([before, pairs(left, 0.02 + 2.05j, 0.02 + 2.55j)])
    ((segment, s),) = exchanges(certain)
    assert segment == 0 and s == pytest.approx(0.5)  # from .01 to -.01 and from -.02 to .02
    ((segment, s),) = exchanges(certain[::-1])
    assert segment == 0 and s == pytest.approx(0.5)


def test_one_that_moves_far_leaves_because_another_surely_returned():
    """One pair is outside at each end: one surely returns at 7/8, so another one of uncertain match leaves at .162."""
    mu = np.array([pairs(0.007 + 0.805j, -0.0185 + 0.868j), pairs(-0.001 + 0.83j, 0.096 + 0.88j)])
    ((piece, s),) = exchanges(mu)
    assert piece == 0 and s == pytest.approx((7 / 8 + 185 / 1145) / 2)


def test_a_pair_about_to_leave_is_seen_behind_a_steady_one():
    """sigma goes from -.02 to -.01: extrapolation reaches 0 after the same length; the next point has another pair."""
    steady = -0.001 + 1j
    mu = np.array(
        [
            pairs(-0.02 + 3j, 0.05 + 2.9j, steady),
            pairs(-0.01 + 3.02j, 0.04 + 2.95j, steady),
            pairs(-0.07 + 2.8j, 0.03 + 2.95j, steady),
        ]
    )
    assert extrapolated_crossings(mu, np.array([1.0, 1.0])) == []  # too far along the segment
    ((piece, s),) = extrapolated_crossings(mu, np.array([1.0, 10.0]))
    assert piece == 1 and s == pytest.approx(0.1)
    ((piece, s),) = extrapolated_crossings(mu[::-1], np.array([10.0, 1.0]))
    assert piece == 0 and s == pytest.approx(0.9)
    assert extrapolated_crossings(np.delete(mu, [1, 4], axis=1), np.array([1.0, 10.0])) == []  # no pair is outside


def near_minus_one(sigma, detuning, width=0.0):
    """Return a pair near -1 that is real where |detuning| < width; it reaches -1 if the width exceeds |sigma|."""
    parted = np.emath.sqrt(width**2 - detuning**2)
    return -np.exp(sigma + np.array([parted, -parted], dtype=complex))


def four_points(random, curved, width):
    """Return segment lengths and multipliers of four points around the passage of a pair near -1; width over sigma."""
    x = np.cumsum(random.uniform(0.6, 1.4, 4))
    x -= random.uniform(x[1], x[2])
    speed, sigma = random.uniform(0.05, 0.4), -(10 ** random.uniform(-3, -0.7))
    detuning = speed * (x + curved * random.uniform(-0.05, 0.05) * x**2)
    mu = [near_minus_one(sigma * (1 + 0.02 * at), d, width * abs(sigma)) for at, d in zip(x, detuning, strict=True)]
    return np.diff(x), np.array(mu)


def passes(points):
    length, mu = points
    return bool(passes_minus_one_cleanly(mu, length, np.array([1]))[0])


@pytest.mark.slow
def test_a_pair_that_passes_minus_one_differs_from_one_that_reaches_it():
    random = np.random.default_rng(3)
    assert all(passes(four_points(random, 0, 0.0)) for _ in range(300))
    for width in (1.02, 1.3, 2.0, 5.0, 30.0):
        assert not any(passes(four_points(random, curved, width)) for curved in (0, 1) for _ in range(300))


def test_a_pair_that_speeds_up_passes_plainly():
    """The slope of the detuning changes by 20 % per unit length; a pair that collides does not pass cleanly."""
    x = np.array([-1.3, -0.4, 0.7, 1.8])
    for faster in (-0.1, 0.1):
        detuning = 0.3 * (x + faster * x**2)
        for width in (0.0, 1.02, 2.0):
            mu = [near_minus_one(-0.1 + 0.01 * at, d, 0.1 * width) for at, d in zip(x, detuning, strict=True)]
            assert passes((np.diff(x), np.array(mu))) is (width == 0)


def test_a_pair_that_bends_on_one_side_alone_is_not_plain():
    """A deviation on one side may be another pair: a parabola through the four angles deviates on both sides."""
    x = np.array([-1.3, -0.4, 0.7, 1.8])
    for outer, plain in (((1, 1), True), ((1.05, 1), True), ((1.1, 1), False), ((1, 0.95), True), ((1, 0.8), False)):
        detuning = 0.1 * x * np.array([outer[0], 1.0, 1.0, outer[1]])
        mu = [near_minus_one(-0.1, d) for d in detuning]
        assert passes((np.diff(x), np.array(mu))) is plain


def test_pairs_far_within_the_circle_are_plain():
    mu = np.array([near_minus_one(-0.6, d) for d in (-0.3, 0.5, 0.1, 0.4)])
    assert passes((np.ones(3), mu)) and not passes((np.ones(3), mu * np.exp(0.3)))


def test_each_of_several_pairs_must_pass_plainly():
    x = np.array([-1.3, -0.4, 0.7, 1.8])
    slow, fast = ([near_minus_one(s, d) for d in v * (x - at)] for s, v, at in ((-0.01, 0.1, 0.0), (-0.2, 0.4, 0.3)))
    wide = [near_minus_one(-0.2, d, 0.25) for d in 0.4 * (x - 0.1)]
    apart = [near_minus_one(-0.05, d) for d in (1.4, 1.5, 1.6, 1.7)]
    for pairs_, plain in (((slow, fast), True), ((slow, apart), True), ((slow, wide), False), ((apart,), False)):
        assert passes((np.diff(x), np.hstack(pairs_))) is plain


def test_invalid_follow_problems_are_refused():
    x = np.array([-1.3, -0.4, 0.7, 1.8])
    mu = np.array([near_minus_one(-0.01, 0.1 * d) for d in x])
    assert passes_minus_one_cleanly(mu, np.diff(x), np.array([0, 1, 2])).tolist() == [
        False,
        True,
        False,
    ]  # no points on either side
    assert passes_minus_one_cleanly(mu, np.diff(x), np.array([], dtype=int)).tolist() == []
    unknown, real, sudden = mu.copy(), np.hstack([mu, np.full((4, 2), -0.8)]), mu.copy()
    unknown[3] = np.nan
    sudden[2] *= np.exp(-0.01)
    assert not passes((np.diff(x), unknown))
    assert not passes((np.diff(x), real))
    assert not passes((np.diff(x), sudden))


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("short", [0.0, 1e-20])
def test_points_that_coincide_cause_no_division_by_zero(short):
    """A curve has two points at one place where a special point of another resolution is a point of it."""
    x = np.array([-1.3, -0.4, 0.7, 1.8])
    mu = np.array([near_minus_one(-0.01, 0.1 * d) for d in x])
    for coinciding in (0, 2):
        length = np.diff(x)
        length[coinciding] = short
        assert not passes((length, mu))
    several = np.array([pairs(0.01 + 1.4j, -0.02 + 2.6j)] * 4)
    assert extrapolated_crossings(several, np.array([short, 1.0, short])) == []


def test_modes_that_pass_minus_one_are_not_looked_at_closer(monkeypatch):
    """Modes of a chain pass -1 on every curve; the search, as expensive as twenty points, runs at most four times."""
    searches = []
    monkeypatch.setattr(
        even_crossing_search, "find_even_crossings", lambda *args: searches.append(args) or find_even_crossings(*args)
    )
    K = 2 * np.eye(30) - np.eye(30, k=1) - np.eye(30, k=-1)
    spring = hb.Element(np.eye(30)[-1], hb.Cubic(k1=0.0, k3=0.5))
    chain = hb.System(np.eye(30), 0.02 * K, K, [spring], hb.Load(cosine={1: 0.1 * np.eye(30)[0]}))
    first = 2 * np.sin(np.pi / 62)
    curve = hb.trace(hb.HarmonicBalance(chain, 5), "Omega", (0.8 * first, 1.3 * first), accuracy=None)
    assert [point.kind for point in curve.special] == ["LP", "LP"] and len(searches) <= 4


def test_multipliers_that_leap_cannot_be_followed():
    """A pair that turns by 20 degrees between points is followed, by 60 degrees not; small pairs are ignored."""
    angle = np.radians([20.0, 40.0, 60.0, 120.0, 140.0])
    small = 0.05 * np.exp(3j * angle)
    mu = np.column_stack([np.exp(1j * angle), np.exp(-1j * angle), small, small.conj()])
    assert leaps(mu) == [(2, 0.5)]
    mu[3, 0] = np.nan
    assert leaps(mu) == []  # the multiplier is unknown there
    assert leaps(mu[:, :0]) == []


def test_a_collision_on_the_first_segment():
    """Exponents sigma + i (phi -+ q^1/2) with a cubic q, negative between points 0 and 1, where the moduli differ.
    Multipliers change by less than their distance between neighbouring points."""
    sigma, unit = -0.005, 0.05
    cubic = np.polyfit([0.0, 1.0, 2.0, 3.0], [1.0, 1.0, 6.0, 8.0], 3)

    def multipliers(x):
        parted = unit * np.emath.sqrt(np.polyval(cubic, x))
        return pairs(sigma + 1j * (1.3 + parted), sigma + 1j * (1.3 - parted))

    mu = np.array([multipliers(x) for x in range(4)])
    assert (np.abs(mu) < 1).all()
    outside = [np.count_nonzero(np.abs(multipliers(s)) > 1) for s in np.arange(1, 8) / 8]
    assert max(outside) == 2
    assert collisions(mu, np.ones(3)) == [(0, (1 + int(np.argmax(outside))) / 8)]
    assert collisions(mu * np.exp(-2 * unit), np.ones(3)) == []  # too far within the circle
    assert collisions(np.insert(mu, 2, mu[2], axis=0), np.array([1.0, 1.0, 1e-20, 1.0])) == []  # two points coincide


# ---- even numbers of crossings between points of a curve


def event(kind, two_sided=False):
    return SimpleNamespace(kind=kind, needs_two_sides=two_sided)


def located(kind, s=0.5, two_sided=False, finder=None):
    return SimpleNamespace(event=event(kind, two_sided), s=s, finder=finder, row=SimpleNamespace(u=s))


@pytest.mark.parametrize("made_up", [False, True])
def test_of_points_that_change_a_sign_an_even_number_is_kept(made_up):
    """A single two-sided event is kept if another special point may explain it, as are points found by other events."""
    twice, once, pair_ = [located("PD"), located("PD")], located("LP"), located("NS", two_sided=True)
    by_another = located("BP", finder=event("LP"))
    kept = drop_odd_counts([*twice, once, pair_, by_another], explained=made_up)
    assert kept == [*twice, *([pair_] if made_up else []), by_another]
    assert drop_odd_counts([*twice, located("PD")]) == []


class Watch:
    """Detector with given numbers of sign changes between the points of a curve and along a sampled curve."""

    def __init__(self, one, points, changes, on_path):
        self.searched, self.points, self.known, self.on_path = [one], points, np.array(changes), np.array(on_path)

    def changes(self, one, points):
        return self.known if points is self.points else self.on_path


@pytest.mark.parametrize(("changes", "unseen"), [([0, 0], {}), ([1, 0], {}), ([2, 0], {0: [0]}), ([1, 1], {1: [1]})])
def test_changes_of_sign_near_a_known_point(changes, unseen):
    """A special point explains one sign change on its part of the path, not a second one or one on another part."""
    pair_, points = event("NS", two_sided=True), ["a", "b", "c"]
    path = SampledCurve(["a", "b", "c "], [(0, 0.0), (1, 0.0), (2, 0.0)], ["", "", ""], {0: "NS"})
    found = path.unmatched_sign_changes(Watch(pair_, points, [1, 0], changes), points)
    assert found == {segment: [(k, pair_) for k in sections] for segment, sections in unseen.items()}


@pytest.mark.parametrize(
    ("two_sided", "kind", "searched"),
    [(True, "PD", True), (True, "LP", True), (True, "peak", False), (False, "PD", False)],
)
def test_a_known_change_of_number_belongs_to_a_point_of_another_kind(two_sided, kind, searched):
    """A pair leaves next to a period doubling, and both change the number of multipliers outside. Only for events that
    need both sides, the known sign change is attributed to the doubling, and the path is searched for another one."""
    one, points = event("NS" if two_sided else "own", two_sided), ["a", "b"]
    path = SampledCurve(["a", "q", "b"], [(0, 0.0), (0, 0.5), (1, 0.0)], ["", kind, ""], {})
    found = path.unmatched_sign_changes(Watch(one, points, [1], [1, 0]), points)
    assert found == ({0: [(0, one)]} if searched else {})


@pytest.mark.parametrize(
    ("s", "ends", "kept"),
    [
        (0.06, ("PD", ""), True),
        (0.04, ("PD", ""), False),
        (0.04, ("NS", ""), True),
        (0.94, ("", "PD"), True),
        (0.96, ("", "PD"), False),
        (0.7, ("", "PD"), True),
        (1e-7, ("", ""), False),
        (1 - 1e-7, ("", ""), False),
        (1e-5, ("", ""), True),
    ],
)
def test_a_point_found_next_to_one_of_its_kind_is_this_one(s, ends, kept):
    """A point within 1/20 of the part from an end of its kind, or within 1e-6 from any end, is not returned."""
    point, calls = located("PD", s), []
    watch = SimpleNamespace(
        sign_changes=lambda rows: calls.append(rows) or ([] if len(calls) == 1 else [0]),
        find=lambda part: [point],
        changes=lambda one, rows: np.zeros(1),
    )
    segment = SimpleNamespace(part=lambda a, b: (a, b))
    path = SimpleNamespace(points=["a", "b"], kinds=list(ends))
    found = find_even_crossings(watch, segment, [(point.event, 0.5)], lambda *_: None, path, 0)
    assert found == ([(("a", "b"), point)] if kept else [])
