"""Survey of all branches in a span: isolas and coexisting motions are found, distinguished and traced."""

import numpy as np
import pytest
from cross.shooting import shoot, state

from hbgear import Duffing, HarmonicBalance, SpurPair, StepControl, switch, trace
from hbgear.analysis.branch_search.backbone_starts import BackboneStarts
from hbgear.analysis.branch_search.multistart import complete_branch, random_motions, shifts, trace_all
from hbgear.continuation.solvers.deflation import deflated_newton
from hbgear.mechanics.series.fourier import evaluate, to_complex

STRONG = SpurPair(e=(0.10,))
ISOLA = Duffing(zeta=0.1, k3=1.0, F=10.0)
"""Its subharmonic of order 3 is an isola in Omega, disconnected from the motion with the period of the load."""
ISOLA_SPAN = (3.5, 9.0)
ATTRACTORS = (0.05141, 0.34055)
"""Rms of the two stable motions of kahraman_singh_fah010 at Omega = 0.65."""


@pytest.fixture(scope="module")
def isola():
    return trace_all(HarmonicBalance(ISOLA, 15, nu=3), ISOLA_SPAN, frequencies=[5.0], guesses=20)


def rms_at(branch, Omega):
    """Return rms and stability of the motions of a branch at a frequency, by interpolation."""
    out = []
    A = branch.amplitude("rms")
    for i in np.flatnonzero(np.diff(np.sign(branch.values - Omega))):
        s = (Omega - branch.values[i]) / (branch.values[i + 1] - branch.values[i])
        out.append(((1 - s) * A[i] + s * A[i + 1], bool(branch.stable[i])))
    return out


@pytest.mark.slow
def test_a_branch_that_merges_at_both_ends_is_traced_whole():
    """From two of its motions it is traced between both period doublings of the parent curve, with all its folds."""
    curve = trace(HarmonicBalance(STRONG, 16), "Omega", (2.6, 0.4))
    doubled = switch(curve, "PD1")
    assert doubled.status == "merged"
    for i in (len(doubled) // 3, len(doubled) - 10):
        whole = complete_branch(
            doubled.problem, doubled.X[i], float(doubled.values[i]), (2.6, 0.4), StepControl(), True
        )
        assert whole.status == "merged"
        np.testing.assert_allclose(np.sort(whole.values[[0, -1]]), np.sort(doubled.values[[0, -1]]), atol=1e-3)
        folds = [sorted(p.parameters["Omega"] for p in b.special if p.kind == "LP") for b in (whole, doubled)]
        np.testing.assert_allclose(*folds, rtol=1e-8)


# ---- isolas


def test_a_closed_branch_is_found(isola):
    """Three branches: from the linear response, a closed curve within the span, and the resonance."""
    assert len(isola) == 3
    main, found, resonance = isola
    assert resonance.status == "left_span" and resonance.amplitude("H1").max() > 7
    assert main.status == "reached_end" and main.special == ()
    assert found.status == "closed"
    assert sorted(p.kind for p in found.special if p.kind == "LP") == ["LP", "LP"]
    assert (found.values.min(), found.values.max()) == pytest.approx((4.048296, 6.813300), abs=1e-5)


def test_the_same_curves_are_found_in_any_unit_of_length():
    """The same oscillator with lengths in other units: k3 L^-2 and F L."""
    found = []
    for L in (1.0, 1e-6):
        scaled = Duffing(zeta=0.1, k3=1.0 / L**2, F=10.0 * L)
        curves = trace_all(HarmonicBalance(scaled, 9, nu=3), ISOLA_SPAN, frequencies=[5.0], guesses=2)
        found.append([(len(curve), curve.status) for curve in curves])
    assert found[0] == found[1] and len(found[0]) == 3


def test_it_is_disconnected(isola):
    """The subharmonic part is large along the whole isola and zero along the main branch."""
    main, found, _ = isola
    sizes = [[np.linalg.norm(branch.problem.subharmonic_part(X)) for X in branch.X] for branch in (main, found)]
    assert max(sizes[0]) < 1e-9 and min(sizes[1]) > 0.5


def test_its_folds_are_its_ends(isola):
    found = isola[1]
    folds = sorted(p.parameters["Omega"] for p in found.special if p.kind == "LP")
    assert folds == pytest.approx([found.values.min(), found.values.max()], abs=1e-9)
    for point in found.special:
        if point.kind == "LP":
            assert np.abs(point.multipliers - 1).min() < 1e-4


def test_its_motions_are_motions(isola):
    """Shooting from a stable and an unstable point closes after three load periods, with the same stability."""
    found = isola[1]
    for stable in (True, False):
        rows = np.flatnonzero(found.stable == stable)
        i = int(rows[np.argmin(np.abs(found.values[rows] - 5.0))])
        Omega = float(found.values[i])
        y = state(found.problem, found.X[i], Omega=Omega)
        true, period = shoot(ISOLA.system(), Omega, y, nu=3)
        np.testing.assert_allclose(true, y, rtol=0, atol=1e-4)
        assert bool(np.abs(np.linalg.eigvals(period.monodromy)).max() < 1) == stable


def test_the_survey_reports_its_starts(isola):
    assert isola.log[0].startswith("branch 1, from the linear response at Omega = 3.5")
    assert any("at Omega = 5 by Newton's method from a backbone: the curve closed" in line for line in isola.log)
    assert any(line.startswith("Omega = 5: 1 motions known") and "starts from backbones" in line for line in isola.log)
    assert "20 random starts" in isola.log[-1]


def test_backbones_lead_to_a_resonance_that_random_starts_miss(monkeypatch):
    """Ten random starts at each of two frequencies miss the resonance of a lightly damped oscillator."""
    problem = HarmonicBalance(Duffing(zeta=0.01232, k3=1.05876, F=2.73444), 12)
    search = {"frequencies": [3.4375, 4.3125], "guesses": 10, "stability": False}
    found = trace_all(problem, (6.5, 3.0), **search)
    assert len(found) == 3
    rms = sorted(float(branch.amplitude("rms")[np.argmin(np.abs(branch.values - 3.5))]) for branch in found)
    # resonant motions are on the backbone: Omega^2 = 1 + 3/4 k3 a^2 to first order in the third harmonic
    assert rms[1:] == pytest.approx([np.sqrt((3.5**2 - 1) / (1.5 * 1.05876))] * 2, rel=0.06)
    monkeypatch.setattr("hbgear.analysis.branch_search.backbone_starts.MODES", 0)
    assert len(trace_all(problem, (6.5, 3.0), **search)) == 1


def test_starts_from_backbones_are_free_motions_of_the_basis_frequencies():
    """They solve the balance without load and damping to 2 %, in six phases, with 1/3, 2/3 and 3/3 of Omega."""
    problem = HarmonicBalance(Duffing(zeta=0.0, k3=1.0, F=1e-12), 9, nu=3)
    starts = list(BackboneStarts(problem, 1.0).at(4.5, [np.zeros(problem.size)]))
    assert len(starts) == 3 * 6
    for X in starts:
        now = problem.linearise(X, "", **problem.parameters, Omega=4.5)
        assert np.linalg.norm(now.R) < 2e-2 * now.size
    energy = [np.abs(to_complex(X.reshape(1, -1))[0]) for X in starts]
    assert [int(np.argmax(each)) for each in energy] == [1] * 6 + [2] * 6 + [3] * 6


def test_subharmonics_of_a_lightly_damped_oscillator():
    """They form isolas: closed curves, mirror images of each other, with the same range of Omega."""
    problem = HarmonicBalance(Duffing(zeta=0.01, k3=1.0, F=3.0), 9, nu=3)
    found = trace_all(problem, (2.0, 4.0), frequencies=[3.0], guesses=12, stability=False)
    closed = [branch for branch in found if branch.status == "closed"]
    assert len(closed) >= 1
    for branch in closed:
        assert np.linalg.norm(problem.subharmonic_part(branch.X[0])) > 0.1
        assert (branch.values.min(), branch.values.max()) == pytest.approx((2.32427, 3.02947), abs=1e-4)


# ---- coexisting motions


@pytest.mark.parametrize("seed", [0, 1])
def test_two_attractors_and_the_motion_between(seed):
    found = trace_all(HarmonicBalance(STRONG, 20), (0.64, 0.66), frequencies=[0.65], guesses=20, seed=seed)
    motions = sorted(motion for branch in found for motion in rms_at(branch, 0.65))
    assert [stable for _, stable in motions] == [True, False, True]
    np.testing.assert_allclose([motions[0][0], motions[2][0]], ATTRACTORS, rtol=0, atol=2e-5)


def test_the_same_seed_finds_the_same():
    problem = HarmonicBalance(STRONG, 8)
    a, b = (trace_all(problem, (0.64, 0.66), frequencies=[0.65], guesses=6, stability=False) for _ in range(2))
    assert a.log == b.log and len(a) == len(b)
    for x, y in zip(a, b, strict=True):
        np.testing.assert_array_equal(x.X, y.X)


@pytest.mark.slow
def test_a_second_parameter_leads_to_the_others():
    """Without random starts, continuation in the excitation past its jumps and back finds all motions."""
    problem, second = HarmonicBalance(STRONG, 6), ("e_scale", (0.2, 2.0))
    found = trace_all(problem, (0.64, 0.66), frequencies=[0.65], guesses=0, second=second)
    motions = sorted(motion for branch in found for motion in rms_at(branch, 0.65))
    assert any("following e_scale to" in line for line in found.log)
    assert [stable for _, stable in motions] == [True, False, True]


def test_a_branch_is_found_once():
    """Both ends of the span and starts between them lead to the same curve, which is listed once."""
    found = trace_all(HarmonicBalance(ISOLA, 5), (3.0, 12.0), frequencies=[5.0], guesses=30, stability=False)
    ends = [tuple(np.round(branch.X[[0, -1]].ravel(), 6)) for branch in found]
    assert len(set(ends)) == len(ends)
    spans = [(branch.values.min(), branch.values.max()) for branch in found]
    assert min(low for low, _ in spans) >= 3.0 and max(high for _, high in spans) <= 12.0


@pytest.mark.slow
def test_a_motion_of_the_single_period_is_traced_in_a_longer_basis():
    """The resonant motion, which is not connected to an end of the span, is found with nu = 3 as well."""
    at = {"frequencies": [5.0], "guesses": 30, "stability": False}
    single = trace_all(HarmonicBalance(ISOLA, 3), (4.8, 5.2), **at)
    longer = trace_all(HarmonicBalance(ISOLA, 9, nu=3), (4.8, 5.2), **at)
    largest = max(branch.amplitude("H1").max() for branch in single)
    assert largest > 3
    assert max(branch.amplitude("H1").max() for branch in longer) == pytest.approx(largest, rel=1e-3)


def test_one_branch_where_there_is_one():
    found = trace_all(HarmonicBalance(Duffing(), 5), (0.6, 1.5), frequencies=3, guesses=8, stability=False)
    assert len(found) == 1 and found[0].status == "reached_end"
    assert len(found.log) == 1 + 2 * 3


# ---- parts


def test_shifted_motions_are_motions(isola):
    found = isola[1]
    X, Omega = found.X[len(found) // 2], float(found.values[len(found) // 2])
    copies = shifts(found.problem, X)
    assert len(copies) == 3
    theta = np.linspace(0, 2 * np.pi, 7)
    for j, copy in enumerate(copies):
        assert np.linalg.norm(found.problem.residual(copy, Omega=Omega)) < 1e-8
        np.testing.assert_allclose(evaluate(copy, theta), evaluate(X, theta + 2 * np.pi * j / 3), rtol=0, atol=1e-12)
    assert len(shifts(found.problem, isola[0].X[0])) == 1


def test_deflated_newton_does_not_come_back(isola):
    """Near a known motion Newton converges to it; with deflation of the known motions it does not."""
    found = isola[1]
    problem, i = found.problem, len(found) // 2
    here = {**ISOLA.parameters, "Omega": float(found.values[i])}
    X = found.X[i]
    near = X + 1e-3 * np.cos(np.arange(X.size))
    np.testing.assert_allclose(deflated_newton(problem, near, here, []), X, rtol=0, atol=1e-7)
    other = deflated_newton(problem, near, here, shifts(problem, X))
    assert other is None or min(np.linalg.norm(other - Y) for Y in shifts(problem, X)) > 1e-3


def test_random_starts_span_two_decades():
    problem = HarmonicBalance(STRONG, 8)
    known = [problem.start(0.65)]
    starts = random_motions(problem, known, 200, np.random.default_rng(0))
    sizes = np.array([problem.solution_norm(X) for X in starts])
    assert sizes.max() > 20 * sizes.min() and all(X.shape == (problem.size,) for X in starts)
    again = random_motions(problem, known, 200, np.random.default_rng(0))
    np.testing.assert_array_equal(starts, again)


@pytest.mark.parametrize("frequencies", [[0.5], [0.65, 0.7], []])
def test_frequencies_outside_the_span(frequencies):
    with pytest.raises(ValueError, match=r"must lie within the span \(0.62, 0.68\)"):
        trace_all(HarmonicBalance(STRONG, 3), (0.62, 0.68), frequencies=frequencies)
