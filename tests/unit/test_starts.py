"""First motions: static states, paths on which dampers are taken away, and motions whose position is arbitrary."""

import math
from types import SimpleNamespace

import numpy as np
import pytest
from machines import single_mass
from scipy.integrate import solve_ivp

import hbgear as hb
from hbgear.continuation.curve.segment import CurvePoint, Segment
from hbgear.harmonic.balance import initial_guess
from hbgear.harmonic.balance.initial_guess import from_damped
from hbgear.harmonic.equations.static_state import static_states
from hbgear.time.integration import state_of


def oscillator(K, C, law, F=0.1, constant=None, displacement=None):
    element = hb.Element([1.0], law, displacement or hb.mechanics.Series())
    load = hb.Load(constant=None if constant is None else [constant], cosine={1: [F]})
    return hb.System([[1.0]], [[C]], [[K]], [element], load)


# ---- structures of negative stiffness


@pytest.mark.parametrize(("C", "mean", "H1"), [(0.1, 0.957541, 0.233289), (0.3, 0.979417, 0.164070)])
@pytest.mark.parametrize("k1", [0.0, 0.5, 0.9, 1.0 - 1e-11])
def test_double_well(C, mean, H1, k1):
    """x'' + C x' - x + x^3 = .1 cos(1.2 t); mean and amplitude by shooting (DOP853, rtol 1e-11), det P = exp(-C T).

    However the linear part is split between K and the law, also so that K and the reference stiffness cancel.
    """
    problem = hb.HarmonicBalance(oscillator(-1.0 - k1, C, hb.Cubic(k3=1.0, k1=k1)), 10)
    X = np.zeros(21)
    X[0] = 1.0
    point = hb.trace(problem, "Omega", (1.2, 1.25), start=X)[0]
    assert point.amplitude("mean") == pytest.approx(mean, abs=2e-6)
    assert point.amplitude("H1") == pytest.approx(H1, abs=2e-6)
    np.testing.assert_allclose(np.abs(point.multipliers), math.exp(-C * math.pi / 1.2), rtol=1e-6)
    assert point.stable


def test_a_constant_load_on_a_double_well_is_no_unbalanced_load():
    problem = hb.HarmonicBalance(oscillator(-1.0, 0.1, hb.Cubic(k3=1.0), constant=0.05), 8)
    X = problem.start(Omega=2.0)
    static = np.roots([1.0, 0.0, -1.0, -0.05]).real
    assert np.abs(X[0] - static).min() < 0.02


def test_a_rigid_motion_stays_one():
    """Two wheels and a mesh: the rotation of both is no motion of the mesh, and carries no receptance."""
    mesh = hb.Element([1.0, -1.0], hb.Cubic(k3=1.0), damping=0.1)
    pair = hb.System(np.eye(2), np.zeros((2, 2)), np.zeros((2, 2)), [mesh], hb.Load([0.2, -0.2], {1: [0.1, 0.0]}))
    assert hb.HarmonicBalance(pair, 5).compiled({}).structure.free.shape == (2, 1)
    unbalanced = hb.System(np.eye(2), np.zeros((2, 2)), np.zeros((2, 2)), [mesh], hb.Load([0.2, -0.1]))
    with pytest.raises(ValueError, match="on a motion that nothing holds"):
        hb.HarmonicBalance(unbalanced, 5)


# ---- the state of rest comes first


def test_softening_oscillator_starts_at_rest():
    """x'' + .1 x' + x - x^3 = .05 cos: from rest SciPy settles on the motion about zero, not on the saddles at +-1."""
    problem = hb.HarmonicBalance(oscillator(1.0, 0.1, hb.Cubic(k3=-1.0), F=0.05), 12)
    for span in ((0.1, 1.6), (1.6, 0.1)):
        curve = hb.trace(problem, "Omega", span)
        assert sorted(round(jump.value, 5) for jump in curve.jumps()) == [0.86271, 0.89278]
        assert np.abs(curve.amplitude("mean")).max() < 1e-9 and not curve.warnings


def test_a_curve_without_a_stable_point_has_a_warning():
    problem = hb.HarmonicBalance(oscillator(1.0, 0.1, hb.Cubic(k3=-1.0), F=0.05), 8)
    X = np.zeros(17)
    X[0] = 1.0  # the saddle
    curve = hb.trace(problem, "Omega", (1.5, 1.6), start=X)
    assert not curve.stable.any() and "no point of the curve is stable" in " ".join(curve.warnings)


@pytest.mark.parametrize("K", [-1.0, -0.5, 0.0])
def test_stable_static_states_come_first(K):
    """Of a double well the two wells, and the top between them last, however the linear part is split."""
    compiled = hb.HarmonicBalance(oscillator(K, 0.1, hb.Cubic(k3=4.0, k1=-1.0 - K)), 3).compiled({})
    found = list(static_states(compiled, 1.0))
    assert found[0].stable and abs(found[0].d[0]) == pytest.approx(0.5, rel=1e-6)
    assert not found[-1].stable and found[-1].balanced and found[-1].d[0] == pytest.approx(0.0, abs=1e-9)


@pytest.mark.parametrize("model", [hb.SpurPair(), oscillator(-1.0, 0.1, hb.Cubic(k3=4.0))])
def test_static_states_are_found_once(model):
    """Starts at rest and on both sides lead to one contact, or to two wells and the top between them."""
    found = [float(state.d[0]) for state in static_states(hb.HarmonicBalance(model, 3).compiled({}), 1.0)]
    assert len({round(d, 6) + 0.0 for d in found}) == len(found)


def settled(acceleration, x0, v0, Omega, periods):
    """Return mean and first harmonic of the displacement after a number of periods, integrated by SciPy."""
    T = 2 * np.pi / Omega
    times = (periods + np.arange(256) / 256) * T
    x = solve_ivp(
        lambda t, y: [y[1], acceleration(*y, t)], (0, times[-1]), [x0, v0], "DOP853", times, rtol=1e-10, atol=1e-12
    ).y[0]
    return x.mean(), 2 * abs(np.mean(x * np.exp(-1j * Omega * times)))


@pytest.mark.parametrize(("F", "Omega"), [(0.15, 0.75), (0.15, 0.8), (0.2, 0.8), (0.22, 0.8)])
def test_a_motion_about_rest_comes_before_saddles_far_away(F, Omega):
    """x'' + .1 x' + x - x^3 = F cos: curves began near the saddle at 1; the stable motion has no mean."""
    problem = hb.HarmonicBalance(oscillator(1.0, 0.1, hb.Cubic(k3=-1.0), F=F), 16)
    X = problem.start(Omega=Omega)
    k = np.arange(1, 17)
    x0, v0 = X[0] + X[1::2].sum(), Omega * (k * X[2::2]).sum()
    mean, H1 = settled(lambda x, v, t: F * math.cos(Omega * t) - 0.1 * v - x + x**3, x0, v0, Omega, 40)
    assert [X[0], np.hypot(X[1], X[2])] == pytest.approx([mean, H1], abs=1e-4) and abs(X[0]) < 1e-9


@pytest.mark.parametrize(("C", "F", "Omega"), [(0.2, 1.3, 1.5), (0.2, 1.5, 2.0), (0.1, 2.5, 1.7), (0.2, 0.8, 1.2)])
def test_a_motion_across_both_wells_replaces_an_unstable_one(C, F, Omega):
    """x'' + C x' - x + x^3 = F cos: curves began on unstable motions; the large motion settles from (2.5, 0)."""
    X = hb.HarmonicBalance(oscillator(-1.0, C, hb.Cubic(k3=1.0), F=F), 20).start(Omega=Omega)
    mean, H1 = settled(lambda x, v, t: F * math.cos(Omega * t) - C * v + x - x**3, 2.5, 0.0, Omega, 100)
    assert [X[0], np.hypot(X[1], X[2])] == pytest.approx([mean, H1], abs=1e-6)


@pytest.mark.parametrize("gap", [0.5, 1.5])
def test_several_elements_on_one_mass_do_not_hide_an_unstable_state(gap):
    """x'' + .1 x' - x + x^3 with a stop: curves began on the top between both wells, which has stiffness -1."""
    elements = [hb.Element([1.0], law) for law in (hb.Cubic(k3=1.0), hb.Unilateral(k=5.0, gap=gap))]
    problem = hb.HarmonicBalance(hb.System([[1.0]], [[0.1]], [[-1.0]], elements, hb.Load(cosine={1: [0.2]})), 20)
    found = list(static_states(problem.compiled({}), 2.2))
    stiffness = [-1 + 3 * x**2 + 5 * (x > gap) for x in (state.d[0] for state in found)]
    assert [state.stable for state in found] == [k > 0 for k in stiffness] and min(stiffness) < 0
    assert len({round(state.d[0], 6) + 0.0 for state in found}) == len(found)
    X = problem.start(Omega=2.2)

    def acceleration(x, v, t):
        return 0.2 * math.cos(2.2 * t) - 0.1 * v + x - x**3 - 5 * max(x - gap, 0)

    mean, H1 = settled(acceleration, X[0], 0.0, 2.2, 100)
    assert [X[0], np.hypot(X[1], X[2])] == pytest.approx([mean, H1], abs=1e-5)


# ---- stiff contacts without a gap


@pytest.mark.slow
@pytest.mark.parametrize("H", [20, 60])
@pytest.mark.parametrize("ratio", [500.0, 1e3, 1e4])
def test_bilinear_oscillator(ratio, H):
    """At w = 2 sqrt(k) / (1 + sqrt(k)), the frequency of both halves together, and next to it, for any H.

    The power that the load puts in is what the damper takes, F/2 Im d_1 Omega = c/2 sum_k (k Omega |d_k|)^2.
    """
    system = oscillator(1.0, 0.04, hb.Unilateral(k=ratio - 1.0, gap=0.0), F=1.0)
    problem = hb.HarmonicBalance(system, H)
    w = 2 * math.sqrt(ratio) / (1 + math.sqrt(ratio))
    for Omega in (w, 0.9 * w, 1.1 * w):
        X = problem.start(Omega=Omega)
        assert np.linalg.norm(problem.residual(X, Omega=Omega)) < 1e-6 * ratio
        rates = Omega * np.arange(1, H + 1)
        dissipated = 0.02 * np.sum(rates**2 * (X[1::2] ** 2 + X[2::2] ** 2))
        assert dissipated == pytest.approx(0.5 * Omega * X[2], rel=1e-6)
    assert problem.observe(problem.start(Omega=w), Omega=w)["multipliers"].__abs__().max() < 1


@pytest.mark.slow
@pytest.mark.parametrize("end", [1.01, 0.99])
def test_automatic_harmonics_start_on_the_resonance_of_the_bilinear_oscillator(end):
    """Peak to peak 11.1650 with 152 harmonics; with few of them there are other motions, of a third of the size."""
    w = 2 * math.sqrt(1e3) / (1 + math.sqrt(1e3))
    system = oscillator(1.0, 0.04, hb.Unilateral(k=999.0, gap=0.0), F=1.0)
    curve = hb.trace(hb.HarmonicBalance(system, "auto", tolerance=1e-4), "Omega", (w, end * w), special=False)
    assert curve.amplitude("pp2")[0] == pytest.approx(11.165, abs=1e-3)
    assert set(curve.stability) == {"stable"} and curve.error.max() <= 1e-4


def test_a_path_of_dampers_ends_on_the_linear_response():
    """Of a linear oscillator there is but one motion: 1 / (k - Omega^2 + i c Omega)."""
    problem = hb.HarmonicBalance(oscillator(1.0, 0.1, hb.Cubic(k3=0.0, k1=1.0), F=0.3), 3)
    X = from_damped(problem, {"Omega": 1.3}).X
    response = 0.3 / (2.0 - 1.3**2 + 0.13j)
    np.testing.assert_allclose(X[1:3], [response.real, -response.imag], rtol=0, atol=1e-9)
    np.testing.assert_allclose(np.delete(X, [1, 2]), 0, atol=1e-9)


@pytest.mark.slow
def test_long_searches_end_early_with_advice(monkeypatch):
    """Teeth that rattle have no motion near static states: with 73 to 273 unknowns the search took up to minutes."""
    refused = pytest.fail
    monkeypatch.setattr(initial_guess, "continue_from_nearby_frequency", lambda *_: refused("takes minutes"))
    monkeypatch.setattr(initial_guess, "MANY_UNKNOWNS", 60)
    pinion, wheel = (hb.gears.Gear(teeth=z, module="3 mm", face_width="20 mm") for z in (25, 40))
    pair = hb.GearPair(pinion, wheel, backlash="80 um")
    problem = hb.HarmonicBalance(pair.model(0, 0.04, torque_orders={2: "60 N m"}), 8)
    with pytest.raises(hb.NoConvergence, match=r"time\.sweep.*fewer harmonics"):
        problem.start(Omega=0.03)
    assert np.isfinite(problem.with_order(1, 4).start(Omega=0.03)).all()


def test_with_many_unknowns_the_path_of_dampers_follows_the_first_guess(monkeypatch):
    """Further guesses took most of 80 s in which the path finds a motion of a train with 250 unknowns."""
    problem, tried = hb.HarmonicBalance(hb.SpurPair(), 4), []

    def refused(_, guess, parameters):
        tried.append(guess)
        raise hb.NoConvergence("none", guess, parameters, [])

    monkeypatch.setattr(initial_guess, "solve", refused)
    monkeypatch.setattr(initial_guess, "from_damped", lambda *_: SimpleNamespace(X=np.ones(9)))
    counts = []
    for limit in (8, 9):
        tried.clear()
        monkeypatch.setattr(initial_guess, "MANY_UNKNOWNS", limit)
        assert np.array_equal(problem.start(Omega=1.0), np.ones(9))
        counts.append(len(tried))
    assert counts[0] == 1 and counts[1] > 1


def test_the_search_at_other_frequencies_goes_on_after_a_motion_without_contact(monkeypatch):
    """No curve begins at such a motion, whose mean is arbitrary; the error ended the search."""
    problem, visited = hb.HarmonicBalance(hb.SpurPair(F_m=0.0), 4), []

    def solution(_, parameters, guesses):
        visited.append(parameters["Omega"])
        return np.zeros(9)

    monkeypatch.setattr(initial_guess, "_solution_from_guesses", solution)
    assert initial_guess.continue_from_nearby_frequency(problem, {"Omega": 1.0}) is None
    assert len(visited) == 8


# ---- without contact


@pytest.mark.parametrize("e", [(0.5,), (0.4, 0.3)])
def test_motion_in_the_gap_is_arbitrary_in_its_mean_only(e):
    """No torque: x'' + 2 zeta x' = 0 with x = d + e, so d = -e cos; its damper gives d_1 = -e W / (W - 2 i zeta)."""
    model = hb.SpurPair(F_m=0.0, e=e)
    curve = hb.trace(hb.HarmonicBalance(model, 12), "Omega", (1.5, 0.3))
    assert curve.status is hb.Status.ARBITRARY and curve.status.complete
    assert "the position in the gap is arbitrary" in curve.message and len(curve) < 200
    expected = e[0] * curve.values / np.hypot(curve.values, 2 * model.zeta)
    np.testing.assert_allclose(curve.amplitude("H1"), expected, rtol=1e-9)
    np.testing.assert_allclose(curve.amplitude("mean"), 0, atol=1e-12)


def test_motion_that_touches_the_edge_of_its_gap_within_the_tolerance_is_arbitrary():
    """Newton's method ends within the tolerance, in contact, with a force that no torque balances. The motion is that
    of the test above; a curve along the edge of the gap would have grazing and branch points by rounding."""
    model = hb.SpurPair(zeta=0.03, F_m=0.0, e=(0.6,), eps=(0.1,))
    problem = hb.HarmonicBalance(model, 30)
    assert problem.regime(problem.start(Omega=2.2), Omega=2.2).tolist() == [1]
    curve = hb.trace(problem, "Omega", (2.2, 0.3))
    assert curve.status is hb.Status.ARBITRARY and not curve.special
    np.testing.assert_allclose(curve.amplitude("H1"), 0.6 * curve.values / np.hypot(curve.values, 0.06), rtol=1e-9)
    np.testing.assert_allclose(curve.amplitude("mean"), 0, atol=1e-12)


@pytest.mark.slow
def test_rattle_without_torque_jumps_in_both_directions_of_the_trace():
    """The motion with contact exists above the first contact, which a motion without contact reaches from above: a
    sweep in time jumps from it at the same frequency."""
    model = hb.SpurPair(F_m=0.0, e=(), fluctuation=hb.mechanics.Series(cosine=(0.5,)))
    for span in ((1.2, 0.5), (0.5, 1.2)):
        curve = hb.trace(hb.HarmonicBalance(model, 12), "Omega", span)
        assert curve.status is hb.Status.ARBITRARY and len(curve.curves) == 2
        assert {each.status for each in curve.curves} == {hb.Status.ARBITRARY}
        up, down = (jump.value for each in curve.curves for jump in each.jumps())
        assert up == pytest.approx(0.89044, abs=2e-5) and down == pytest.approx(0.69569, abs=2e-5)
        values = [0.8, up - 1e-3, up + 1e-3]
        sweep = hb.time.sweep(model, [0.6, 0.7, *values], "up")
        motions = [[float(p.amplitude("pp2")) for p in curve.at(x) if p.stable] for x in values]
        assert [len(each) for each in motions] == [2, 2, 1]
        np.testing.assert_allclose(sweep.pp2[2:, 0], [max(each) for each in motions], rtol=1e-3)


@pytest.mark.slow
@pytest.mark.parametrize("span", [(3.0, 0.05), (0.05, 3.0)])
def test_without_torque_the_span_is_covered(span):
    """Above first contact the motion is determined, below it is not: the amplitude reaches the half gap in between."""
    model = hb.SpurPair(F_m=0.0, e=(1.05,))
    curve = hb.trace(hb.HarmonicBalance(model, 12), "Omega", span)
    touching = 2 * model.zeta / math.sqrt(1.05**2 - 1)
    assert curve.status is hb.Status.ARBITRARY
    ends = [x for each in curve.curves for x in (each.values.min(), each.values.max())]
    assert min(ends) == 0.05 and max(ends) == 3.0
    assert min(abs(x - touching) for x in ends) < 1e-4
    contact, free = sorted(curve.curves, key=lambda each: -each.values.max())
    assert (contact.regime > 0).any() and not (free.regime[:-1] > 0).any()


def test_a_load_however_small_determines_the_position():
    curve = hb.trace(hb.HarmonicBalance(hb.SpurPair(F_m=1e-6, e=(0.5,)), 8), "Omega", (1.5, 0.5))
    assert curve.status is hb.Status.REACHED_END


# ---- segments without length


def test_a_segment_of_no_length():
    """Two special points can lie at one place: no division of zero by zero."""
    problem = hb.HarmonicBalance(hb.Duffing(), 3)
    curve = hb.trace(problem, "Omega", (0.8, 0.9))
    u, tangent = np.append(curve.X[3], curve.values[3]), np.append(curve.X[4] - curve.X[3], 0.01)
    row = CurvePoint(u, tangent, 1, 0.0, 1)
    segment = Segment(problem, "Omega", {}, row, row, np.ones(len(u)), hb.NewtonSettings())
    with np.errstate(all="raise"):
        assert segment.at(0.5) is row and segment.fraction_of(u) == 0.0
        np.testing.assert_allclose(segment.guess(0.5), u)
        assert not segment.passes(CurvePoint(u + 1.0, tangent, 1, 0.0, 1))


# ---- sweeps that go on where a stable branch bifurcates


def two_masses(k3, coupling, F):
    K = np.array([[1 + coupling, -coupling], [-coupling, 1 + coupling]])
    elements = [hb.Element(w, hb.Cubic(k3=k3)) for w in ([1.0, 0.0], [0.0, 1.0])]
    return hb.System(np.eye(2), 0.05 * np.eye(2), K, elements, hb.Load(cosine={1: [F, F]}))


@pytest.mark.slow
def test_a_supercritical_pitchfork_is_no_jump():
    """Two equal masses lose their common motion to one in which they differ, as integration finds too."""
    curve = hb.trace(hb.HarmonicBalance(two_masses(1.0, -0.05, 0.1), 5), "Omega", (0.6, 2.2))
    (jump,) = (jump for jump in curve.jumps() if jump.label.startswith("BP"))
    assert jump.landing == "bifurcating" and "no jump" in jump.note and "continues" in jump.landing_description
    before, after = (point.amplitude("H1") for point in (jump.before, jump.after))
    assert after == pytest.approx(before, rel=0.05) and jump.after.stable
    assert abs(jump.after.amplitude("H1", 0) - jump.after.amplitude("H1", 1)) > 1e-3 * before
    branch = hb.switch(curve, jump.label, steps=hb.StepControl(max_points=8))
    assert branch.stable.all() and branch.values[-1] > branch.values[0]
    (found,) = hb.validate(curve, [jump.label]).jumps
    assert found.ok and found.status == "agrees" and found.rms == pytest.approx(found.before, rel=0.1)


@pytest.mark.slow
@pytest.mark.parametrize("F", [0.35, 0.4])
def test_motions_without_symmetry_end_at_a_pitchfork_without_a_jump(F):
    """Damped motions in one of two wells; below the pitchfork integration finds a symmetric motion of the same size."""
    law = hb.Cubic(k3=3.3, k1=-1.735)
    C = [[2.465, -0.74, 0.0], [-0.74, 1.682, -0.833], [0.0, -0.833, 0.941]]
    K = [[1.571, -0.494, 0.0], [-0.494, 1.049, -0.556], [0.0, -0.556, 0.556]]
    system = hb.System(np.eye(3), C, K, [hb.Element([1.0, 0.0, 0.0], law)], hb.Load(cosine={1: [0.0, 0.0, F]}))
    curve = hb.trace(hb.HarmonicBalance(system, 9), "Omega", (0.8, 0.3))
    turn = curve["BP1"]
    assert turn.amplitude("mean") == pytest.approx(0.0, abs=1e-6)
    assert not any("both sides" in warning for warning in curve.warnings)
    (jump,) = curve.jumps()
    assert jump.label == "BP1" and jump.landing == "bifurcating" and jump.direction == -1
    state = state_of(curve.problem, jump.after.X, **jump.after.parameters) + 0.004 * np.eye(6)[0]
    d = hb.time.integrate(system, state, 15, jump.after.parameters["Omega"], samples=256, tolerance=1e-8).d[0, -256:]
    assert d.std() == pytest.approx(jump.after.amplitude("rms"), rel=1e-3) and abs(d.mean()) < 0.02 * d.std()
    assert d.std() == pytest.approx(turn.amplitude("rms"), rel=0.03)


@pytest.mark.slow
def test_a_sweep_of_motions_without_symmetry_leaves_them_at_the_vertex_in_its_own_direction():
    """They exist from 0.3718 to 0.3852, where a sweep in either direction returns to the symmetric motion. The last
    vertex, at which the fold was a second label, had a sweep in the wrong direction, and a point was not located."""
    system = single_mass(hb.Cubic(1.0), F=5.0)
    curve = hb.trace(hb.HarmonicBalance(system, 15), "Omega", (0.3, 0.65))
    ends = [point.parameters["Omega"] for point in curve.special if point.kind == "BP"]
    for number, end in enumerate(ends, 1):
        branch = hb.switch(curve, f"BP{number}")
        other, direction = (ends[number], 1) if number % 2 else (ends[number - 2], -1)
        assert branch.values.min() > min(end, other) - 1e-3 and branch.values.max() < max(end, other) + 1e-3
        assert [point.kind for point in branch.special] == ["BP", "BP"] and branch.warnings == ()
        (jump,) = branch.jumps()
        assert (jump.direction, jump.landing) == (direction, "bifurcating")
        assert jump.value == pytest.approx(other, abs=1e-5) and jump.after.amplitude("mean") < 1e-9


def test_a_subcritical_pitchfork_is_a_jump():
    curve = hb.trace(hb.HarmonicBalance(two_masses(0.5, -0.02, 0.2), 5), "Omega", (0.6, 2.2))
    (jump,) = (jump for jump in curve.jumps() if jump.label.startswith("BP"))
    assert jump.landing == "nearest" and jump.after.amplitude("H1") < 0.1 * jump.before.amplitude("H1")


def test_a_bifurcating_branch_is_kept_in_files(tmp_path):
    curve = hb.trace(hb.HarmonicBalance(two_masses(1.0, -0.05, 0.1), 5), "Omega", (1.0, 1.6))
    curve.save(tmp_path / "curve.npz")
    again = hb.load(tmp_path / "curve.npz")
    assert [jump.landing_description for jump in again.jumps()] == [jump.landing_description for jump in curve.jumps()]


# ---- points at an end of the span


@pytest.mark.parametrize(
    "make", [lambda: hb.HarmonicBalance(hb.Duffing(), 5), lambda: hb.ContactInstants(hb.SpurPair())]
)
def test_a_point_at_either_end_of_the_span_starts_the_whole_curve(make):
    """From the last end there is one direction into the span: the curve is that of the exchanged span."""
    problem = make()
    whole = hb.trace(problem, "Omega", (1.5, 0.7))
    kinds = [point.kind for point in whole.special]
    for start, span in ((whole[0], (0.7, 1.5)), (whole[-1], (1.5, 0.7))):
        curve = hb.trace(problem, "Omega", span, start=start)
        assert curve.status is hb.Status.REACHED_END and set(curve.values[[0, -1]]) == set(span)
        assert curve.values[0] == start.parameters["Omega"] == span[1]
        points = curve.special if start.parameters["Omega"] == 1.5 else curve.special[::-1]
        assert kinds == [point.kind for point in points]
        for point, expected in zip(points, whole.special, strict=True):
            assert point.parameters["Omega"] == pytest.approx(expected.parameters["Omega"], rel=1e-8)


def test_a_start_beyond_the_span_by_rounding_is_at_its_beginning():
    problem, first = hb.HarmonicBalance(hb.Duffing(), 5), 0.5 * (1 + 1e-12)
    last = hb.trace(problem, "Omega", (0.4, 0.5))[-1]
    again = hb.trace(problem, "Omega", (first, 0.6), start=last)
    assert again.status == "reached_end" and again.values[0] == first
    with pytest.raises(ValueError, match=r"the start has Omega = 0\.5, outside the span"):
        hb.trace(problem, "Omega", (0.5 * (1 + 1e-6), 0.6), start=last)
