"""Symmetric machines: contacts of different elements begin and end at the same instants.

Two equal masses, coupled by a spring and loaded equally, move as one mass, which has the same folds and grazing points.
Antisymmetric disturbances have the stiffness 1 + 2 kc, and branch points where one of their multipliers is 1.
"""

import math
from typing import Any

import numpy as np
import pytest
import scipy

import hbgear as hb

FOLLOWED = pytest.mark.slow
"""Curves of two masses take about a second each."""


def one_mass(k: float, gap: float, c: float, F: float) -> hb.System:
    """Return a mass of frequency 1 with a stop."""
    return hb.System(
        [[1.0]], [[c]], [[1.0]], [hb.Element([1.0], hb.Unilateral(k=k, gap=gap))], hb.Load(cosine={1: [F]})
    )


def two_masses(k: float, gap: float, c: float, F: float, kc: float = 0.5, side: float = 1.0) -> hb.System:
    """Return two such masses with a spring between them; the second is the mirror image if ``side`` is -1."""
    K = np.array([[1 + kc, -side * kc], [-side * kc, 1 + kc]])
    stops = [hb.Element(w, hb.Unilateral(k=k, gap=gap)) for w in ([1.0, 0.0], [0.0, side])]
    return hb.System(np.eye(2), c * np.eye(2), K, stops, hb.Load(cosine={1: [F, side * F]}))


def special(branch: hb.Branch, *kinds: str) -> list[float]:
    """Return the frequencies of all special points of some kinds, in their order along the curve."""
    return [point.parameters["Omega"] for point in branch.special if point.kind in kinds]


@FOLLOWED
@pytest.mark.parametrize("side", [1.0, -1.0], ids=["in phase", "mirrored"])
@pytest.mark.parametrize(
    "machine",
    [(1e5, 0.5, 0.1, 0.3), (50.0, 0.0, 0.04, 0.3), (1e3, 0.0, 0.04, 0.3)],
    ids=["folds-next-to-grazings", "soft-stop-without-gap", "hard-stop-without-gap"],
)
def test_a_symmetric_machine_has_the_points_of_its_half(machine: tuple[float, ...], side: float) -> None:
    """Folds 2e-11 to 5e-8 from grazing points were missed, and curves of stops without gap ended early."""
    one = hb.trace(hb.ContactInstants(one_mass(*machine), 8), "Omega", (0.5, 2.2))
    two = hb.trace(hb.ContactInstants(two_masses(*machine, side=side), 8), "Omega", (0.5, 2.2))
    assert two.status is hb.Status.REACHED_END
    for kind in ("LP", "GR"):
        assert len(special(one, kind)) >= 2
        np.testing.assert_allclose(special(two, kind), special(one, kind), rtol=0, atol=1e-10)
    doublings = np.array(special(two, "PD"))
    for value in special(one, "PD"):
        assert np.abs(doublings - value).min() < 1e-9


@FOLLOWED
@pytest.mark.parametrize(
    ("machine", "span", "count"),
    [
        ((1e5, 0.5, 0.1, 0.3, 0.5), (0.5, 2.2), 6),
        ((1577.1, 0.0, 0.0534328, 0.164589, 0.28566), (2.2, 0.6), 5),
        ((1e5, 0.5, 0.1, 0.3, 1.4469103991124164), (0.505739956347118, 2.2), 8),
    ],
    ids=["gap", "no gap", "tangents near a branch point"],
)
def test_branch_points_next_to_grazings(machine: tuple[float, ...], span: Any, count: int) -> None:
    """Closed forms of one mass and its antisymmetric disturbance, solved for their multiplier 1; contacts of 3e-5 rad.

    One branch point was reported where no multiplier is 1, another one 2e-9 away from its place. The last curve ended
    next to one: its tangents were those of the iterate before the last Newton step, and turned from point to point.
    """
    curve = hb.trace(hb.ContactInstants(two_masses(*machine), 8), "Omega", span)
    points = [point for point in curve.special if point.kind == "BP"]
    assert curve.status is hb.Status.REACHED_END and len(points) == count
    for point in points:
        assert abs(point.parameters["Omega"] - branch_point(curve, point, *machine)) < 5e-11, point
        assert np.abs(point.multipliers - 1).min() < 1e-3


@FOLLOWED
def test_three_period_doublings_in_a_step() -> None:
    """Closed forms of one mass and of its antisymmetric disturbance, whose multiplier passes -1 and returns.

    All three points were in one step with one change of sign: the first two were not reported.
    """
    machine = (1965.14, 0.5, 0.0647076, 0.222913, 1.62871)
    one = hb.trace(hb.ContactInstants(one_mass(*machine[:4]), 8), "Omega", (2.2, 0.6))
    curve = hb.trace(hb.ContactInstants(two_masses(*machine), 8), "Omega", (2.2, 0.6))
    doublings = [point for point in curve.special if point.kind == "PD"]
    symmetric = [any(abs(p.parameters["Omega"] - x) < 1e-10 for x in special(one, "PD")) for p in doublings]
    assert symmetric == [False, True, False, True]
    for point, is_symmetric in zip(doublings, symmetric, strict=True):
        if not is_symmetric:
            Omega = branch_point(curve, point, *machine, unit=-1.0)
            assert abs(point.parameters["Omega"] - Omega) < 5e-11, point


def branch_point(
    curve: Any, point: hb.SpecialPoint, k: float, gap: float, c: float, F: float, kc: float, unit: float = 1.0
) -> float:
    """Return Omega near a point where an antisymmetric multiplier is +1 or -1: instants and velocities of one mass."""
    state = curve.problem.known_states.states[point.index]
    mine = [i for i, switch in enumerate(state.pattern.switches) if switch.element == 0]
    segments = [(k * (state.pattern.switches[i].sign > 0), gap) for i in mine]
    return critical_frequency(curve, point, mine, segments, c, F, 2 * kc, unit)


def critical_frequency(
    curve: Any, point: Any, mine: list[int], segments: Any, c: float, F: float, extra: float, unit: float
) -> float:
    """Return Omega where a disturbance with an ``extra`` stiffness of a mass has a multiplier ``unit``.

    ``mine`` are the switches of the mass; ``segments`` are the stiffness of the contact after each, and its level.
    """
    state, K = curve.problem.known_states.states[point.index], len(mine)

    def equations(u: Any) -> Any:
        tau, v, Omega = u[:K], u[K : 2 * K], u[-1]
        ends, P, R = np.append(tau[1:], tau[0] + math.tau), np.eye(2), []
        for i, (stiffness, level) in enumerate(segments):
            A = np.zeros((5, 5))  # of q, dq/dt, 1, cos tau, sin tau
            A[0, 1], A[3, 4], A[4, 3] = 1, -Omega, Omega
            A[1] = [-1 - stiffness, -c, stiffness * level, F, 0]
            a = np.array([[0, 1], [-1 - stiffness - extra, -c]])
            t = (ends[i] - tau[i]) / Omega
            q, dq, *_ = scipy.linalg.expm(A * t) @ [level, v[i], 1, math.cos(tau[i]), math.sin(tau[i])]
            P = scipy.linalg.expm(a * t) @ P
            R += [q - segments[(i + 1) % K][1], dq - v[(i + 1) % K]]
        return np.array([*R, np.linalg.det(P - unit * np.eye(2))])

    # the motion between its instants in harmonics has the velocities at them, up to the error of a first guess
    u = np.concatenate([state.iterate.tau[mine], velocities(curve, state, mine), [state.value]])
    for _ in range(30):
        columns = [(equations(u + d) - equations(u - d)) / 2e-7 for d in 1e-7 * np.eye(len(u))]
        step = np.linalg.solve(np.array(columns).T, -equations(u))
        u = u + step
        if np.abs(step).max() < 1e-11:
            return float(u[-1])
    raise AssertionError("the reference does not converge")


@pytest.mark.parametrize("other", [1066.55, 300.0])
def test_fold_next_to_the_grazing_of_two_stops_of_different_stiffness(other: float) -> None:
    """Closed forms of a mass between stops at equal distances; Omega of fold and grazing differ by 1e-9 to 3e-9.

    The contacts began and ended with 6e-4 rad, behind the fold, because their durations differ there.
    """
    k, gap, c, F = 1124.75, 0.4, 0.07977, 0.12673
    stops = [hb.Element([side], hb.Unilateral(k=x, gap=gap)) for side, x in ((1.0, k), (-1.0, other))]
    model = hb.System([[1.0]], [[c]], [[1.0]], stops, hb.Load(cosine={1: [F]}))
    rising = hb.trace(hb.ContactInstants(model), "Omega", (1.143, 1.141))
    falling = hb.trace(rising.problem, "Omega", (1.143, 1.141), start=rising[-2])
    assert [point.kind for point in rising.special] == ["GR", "LP"]
    assert [point.kind for point in falling.special] == ["LP", "GR"]
    for curve in (rising, falling):
        fold = next(point for point in curve.special if point.kind == "LP")
        switches = curve.problem.known_states.states[fold.index].pattern.switches
        sides = [(k, gap), (other, -gap)]
        segments = [(sides[s.element][0] * (s.sign > 0), sides[s.element][1]) for s in switches]
        Omega = critical_frequency(curve, fold, list(range(4)), segments, c, F, 0.0, 1.0)
        assert abs(fold.parameters["Omega"] - Omega) < 2e-11
        assert fold.parameters["Omega"] - curve["GR1"].parameters["Omega"] < -1e-9


def velocities(curve: Any, state: Any, switches: list[int]) -> list[float]:
    """Return the velocities of the first mass at some switches."""
    ode, h = curve.problem.family("Omega", dict(curve.fixed))(state.value), 1e-7
    out = []
    for i in switches:
        contacts, tau = state.pattern.contacts[i], float(state.iterate.tau[i])
        y = ode.extended(state.iterate.x[i], tau, contacts.section)
        out.append(float(ode.gaps(contacts.section)[0] @ (scipy.linalg.expm(h * ode.flow(contacts).A) @ y - y)) / h)
    return [state.value * v for v in out]


@hb.mechanics.model
def pair(gap: float = 0.5, F: float = 0.3, k: float = 1e3, c: float = 0.1, count: float = 2.0) -> hb.System:
    """Return two masses, or one of them, with parameters."""
    return two_masses(k, gap, c, F) if count == 2 else one_mass(k, gap, c, F)


@FOLLOWED
@pytest.mark.parametrize("name", ["gap", "F", "k", "c"])
def test_points_of_a_symmetric_machine_are_followed_as_those_of_its_half(name: str) -> None:
    """The balance refused the points of short contacts, and followed others to 1e-5."""
    span = (getattr(pair(), name), 1.04 * getattr(pair(), name))
    one, two = (hb.trace(hb.ContactInstants(pair(count=n), 8), "Omega", (1.265, 1.25)) for n in (1.0, 2.0))
    for label in ("GR1", "LP1"):
        alone, found = (hb.follow(curve, label, name, span) for curve in (one, two))
        assert found.status is alone.status is hb.Status.REACHED_END
        Omega = found.tracked["Omega"][-1]
        assert Omega == pytest.approx(alone.tracked["Omega"][-1], rel=1e-12)
        sensitivities = [hb.analysis.sensitivity(curve[label], [name]).of("Omega")[name] for curve in (one, two)]
        assert sensitivities[1] == pytest.approx(sensitivities[0], rel=1e-7)


@FOLLOWED
def test_an_antisymmetric_doubling_depends_on_the_ratio_of_load_and_gap() -> None:
    """The half of the machine does not have this point, whose contacts are too short for the balance."""
    curve = hb.trace(hb.ContactInstants(pair(), 8), "Omega", (1.265, 1.25))
    over_gap, over_load = hb.follow(curve, "PD1", "gap", (0.5, 0.52)), hb.follow(curve, "PD1", "F", (0.3, 0.15 / 0.52))
    assert over_gap.tracked["Omega"][-1] == pytest.approx(over_load.tracked["Omega"][-1], rel=1e-11)
    after = hb.trace(hb.ContactInstants(pair(gap=0.52), 8), "Omega", (1.26, 1.24))
    assert over_gap.tracked["Omega"][-1] == pytest.approx(after["PD1"].parameters["Omega"], rel=1e-11)


@pytest.mark.parametrize("ends", [False, True], ids=["begins", "ends"])
def test_simultaneous_switches_in_any_order_take_another_contact(ends: bool) -> None:
    """The order of the first two switches, or of the last and the first one of the next period, is rounding.

    A switch went to the other end of the period, where the contacts before it are others.
    """
    from hbgear.harmonic.instants.pattern import Pattern, Switch
    from hbgear.harmonic.instants.refine import with_missed_crossings
    from hbgear.harmonic.instants.sampling import MissedCrossing, sample_gaps
    from hbgear.harmonic.instants.shooting import Iterate

    curve = hb.trace(hb.ContactInstants(two_masses(10.0, 0.0, 0.1, 0.3), 8), "Omega", (2.2, 2.1))
    state = curve.problem.known_states.states[-1]
    iterate, ode = state.iterate, curve.problem.family("Omega", {})(state.value)
    switches, tau = iterate.pattern.switches, iterate.tau.copy()
    assert len({switch.element for switch in switches[:2]}) == 2
    t = float(tau[-1] + 0.5 * (tau[0] + math.tau - tau[-1]))
    if ends:
        first = iterate.pattern.contacts[0]
        pattern = Pattern.of((*switches[1:], switches[0]), first.levels, first.section)
        wrong = Iterate(pattern, np.append(tau[1:], tau[1] + math.tau - 1e-12), np.roll(iterate.x, -1, axis=0))
    else:
        tau[1] = tau[0] - 1e-15
        wrong = Iterate(iterate.pattern, tau, iterate.x)
    assert not sample_gaps(ode, wrong)[1]
    added = with_missed_crossings(ode, wrong, [MissedCrossing(t - 1e-3, t + 1e-3, Switch(0, 0, switches[0].sign))])
    assert added.pattern.count == iterate.pattern.count + 2
    assert np.diff(added.tau).min() > -1e-14 and added.tau[-1] - added.tau[0] < math.tau
