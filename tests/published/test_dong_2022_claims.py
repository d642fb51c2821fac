"""Claims, printed errors and readings of Dong et al. (2022): quick forms, against independent numbers."""

import dataclasses

import matplotlib
import numpy as np
import pytest
from scipy.linalg import eigvals

import hbgear as hb
from hbgear.time.steady_state import SteadyStateSettings

matplotlib.use("Agg")
pytestmark = pytest.mark.usefixtures("on_path")


@pytest.fixture
def made_up():
    """Results as the paper would have them, typed in."""
    from studies.dong_2022.claims import Case

    def case(peak, jumps=(0.89,), regimes=("no_impact", "single_sided"), slope=10.0, at=0.89, W=0.0):
        height = 0.1 * peak if jumps else 0.0
        return Case(peak, at, slope, at, jumps, regimes, (0.5, 0.33), 1 + peak + W, height)

    def wider(cases):
        return [dataclasses.replace(one, displacement=one.displacement + 0.6) for one in cases]

    linear = {"jumps": (), "regimes": ("no_impact",)}
    falling = [case(3.0, slope=30.0), case(2.0, slope=20.0), case(1.0, slope=10.0, **linear)]
    motion = {"regime": "no_impact", "least": 1.5, "stable": True, "orders": np.array([1.0, 0.5, 0.07, 0.0])}
    ellipse = {**motion, "regime": "single_sided", "orders": np.array([1.0, 0.05, 0.02, 0.0])}
    return {
        "base": case(3.0),
        "motions": {"1": ellipse, "1/2": motion, "1/3": motion},
        "doubled": {**motion, "opposition": (0.0, 1.0), "unstable": (0.33, 0.34)},
        "W": [case(x, at=0.8 + 0.01 * x) for x in range(1, 6)],
        "eps": falling,
        "eps W": wider([case(3.0), case(2.0, **linear), case(1.0, **linear)]),
        "zeta": falling,
        "zeta W": wider([case(3.0), case(2.0, **linear), case(1.0, **linear)]),
        "e": [case(3.0), case(2.0), case(1.0)],
        "e W": wider([case(3.0), case(2.0), case(1.0)]),
        "torque": [case(1.0, at=0.8), case(2.0, at=0.9, **linear)],
        "torque W": wider([case(1.0, at=0.8), case(2.0, at=0.9, **linear)]),
        "b": [[1.0, 2.0, 3.0], [2.0, 3.0, 4.0]],
    }


def test_verdicts_follow_the_results(made_up):
    from studies.dong_2022 import claims

    found = dict(zip(((claim.figure, claim.text) for claim in claims.CLAIMS), claims.verdicts(made_up), strict=True))
    others = {key: verdict for key, verdict in found.items() if verdict != "reproduced"}
    assert others == {  # the paper contradicts itself on the load
        ("abstract, conclusion 3", "damping and load constrain the amplitude"): "in part",
        ("16", "rig, 1200 r/min: sidebands of the mesh line"): "not modelled",
    }
    without = {**made_up, "base": dataclasses.replace(made_up["base"], jumps=())}
    assert claims.verdicts(without).count("in part") == 2
    flat = {**made_up, "W": [made_up["W"][0]] * 5}
    assert claims.verdicts(flat).count("refuted") == 2
    still = {**made_up, "motions": {**made_up["motions"], "1": made_up["motions"]["1/2"]}}
    assert claims.verdicts(still)[:2] == ["refuted", "refuted"]
    both = {"default": made_up, "found": {**made_up, "doubled": None}}
    assert "in opposite phase" in claims.report(both)
    alike = {**made_up, "doubled": {**made_up["doubled"], "opposition": (1.0, 0.0)}}
    assert "not in opposite phase" in claims.report({**both, "default": alike})
    assert "is stable at Omega = 1/3" in claims.report({**both, "default": both["found"]})


@pytest.mark.slow
def test_around_one_third_the_stable_motion_has_impacts_and_the_halves_move_oppositely():
    """Time integration from a start with the halves pushed to opposite sides ends on it, least gap included."""
    from studies.dong_2022 import base, claims

    doubled = claims.doubling(base.curve(12, (0.36, 0.31)))
    assert doubled["stable"] and doubled["regime"] == "single_sided"
    alike, opposite = doubled["opposition"]
    assert alike < 1e-9 and opposite == pytest.approx(0.926, abs=2e-3)
    assert doubled["unstable"] == pytest.approx((0.33055, 0.34347), abs=5e-5)
    start = np.zeros(48)
    start[[5, 17]] = 0.5, -0.5
    found = hb.time.sweep(
        hb.gears.DoubleHelicalPair(), [1 / 3], start=start, settling=SteadyStateSettings(tolerance=1e-4)
    )
    assert found.period[0] == 2
    assert found.max[0, 0] - 2 * found.pp2[0, 0] == pytest.approx(doubled["least"], abs=1e-3)


def test_base_case_has_a_steep_rise_and_no_jump():
    from studies.dong_2022 import base, claims

    case = claims.case(base.curve(16, (1.1, 0.8)))
    assert case.jumps == ()
    assert case.peak == pytest.approx(0.5894, abs=5e-4)  # by time integration 0.589
    assert case.slope_at == pytest.approx(0.887, abs=2e-3)


def test_without_errors_the_printed_equations_are_those_of_24_coordinates():
    from studies.dong_2022 import as_printed

    half = hb.HarmonicBalance(as_printed.symmetric(), 16)
    pair = hb.HarmonicBalance(hb.gears.DoubleHelicalPair(), 16)
    for Omega in (0.9, 1.3):
        np.testing.assert_allclose(half.start(Omega), pair.start(Omega).reshape(2, -1)[0], atol=1e-9)
    shifted = hb.HarmonicBalance(as_printed.symmetric(["z_sign"]), 16).start(0.9)
    assert np.abs(shifted - half.start(0.9)).max() > 1e-2


def test_opposite_motions_have_eigenvalues_of_the_24_coordinates():
    from studies.dong_2022 import as_printed

    system = hb.gears.DoubleHelicalPair().system()
    W, n = system.W, system.n
    K, C = system.K + W @ W.T, system.C + 2 * 0.063 * W @ W.T
    A = np.block([[np.zeros((n, n)), np.eye(n)], [-np.linalg.solve(system.M, np.hstack([K, C]))]])
    every = eigvals(A)
    found = as_printed.antisymmetric()
    assert len(found) == 24
    nearest = np.abs(found[:, None] - every).min(axis=1)
    assert nearest.max() < 1e-6 * np.abs(every).max()


@pytest.mark.parametrize("error", ["z_sign", "mesh_r1", "undefined", "undefined_half", "undefined_zero"])
def test_some_errors_alone_make_opposite_motions_unstable(error):
    from studies.dong_2022 import as_printed

    assert as_printed.antisymmetric([error]).real.max() > 0.1


@pytest.mark.parametrize("error", ["shaft_r2", "no_tilts"])
def test_others_alone_do_not(error):
    from studies.dong_2022 import as_printed

    assert as_printed.antisymmetric([error]).real.max() < -1e-3


def test_mean_force_without_tilts_is_smaller_by_the_square_of_the_cosine():
    """Statics by hand: (c_b^2 + s_b^2) F = c_b T / r_p instead of c_b^2 F."""
    from studies.dong_2022 import as_printed

    means = [hb.HarmonicBalance(as_printed.symmetric(errors), 6) for errors in ((), ["no_tilts"])]
    F = [problem.mesh_forces(problem.start(1.3), Omega=1.3)[0, 0] for problem in means]
    assert F[1] / F[0] == pytest.approx(np.cos(np.radians(24.43)) ** 2, rel=1e-9)


@pytest.mark.slow
def test_a_reading_found_by_search_holds_all_statements():
    """Its neighbours do not; the folds are at the jump that the paper states."""
    from studies.dong_2022 import search

    cells = search.run(quick=True)
    (found,) = search.complete(cells)
    assert (found.helix, found.phi, found.torque) == ("base", -10.0, 700.0)
    assert found.case.jumps == pytest.approx((0.88792, 0.88963), abs=2e-5)
    assert "of 6 statements: " in search.report(cells) and len(search.plot(cells).axes) == 3


def test_unknown_error_is_refused():
    from studies.dong_2022 import as_printed

    with pytest.raises(ValueError, match="no such error: sign"):
        as_printed.symmetric(["sign"])


def test_printed_errors_quick(tmp_path):
    from studies import study
    from studies.dong_2022 import printed_errors

    results = printed_errors.run(quick=True)
    assert len(results["curves"]["no_tilts"].jumps()) == 2 and not results["curves"]["none"].jumps()
    assert results["growth"]["all, undefined"] < 0 < 0.1 < results["growth"]["all, undefined_zero"]
    assert study.draw(printed_errors.plot, results, tmp_path / "a")[0].stat().st_size > 10_000
    assert "| no_tilts |" in printed_errors.report(results)


def test_readings_count_satisfied_claims():
    from studies.dong_2022 import readings
    from studies.dong_2022.claims import Case

    good = Case(1.0, 0.9, 9.0, 0.89, (0.8855, 0.865), ("no_impact", "single_sided"), (0.48, 0.32))
    regimes = {"1": "single_sided", "1/2": "no_impact", "1/3": "no_impact"}
    assert all(readings.held(good, regimes))
    worse = dataclasses.replace(good, jumps=(0.95,), regimes=("double_sided",))
    assert readings.held(worse, {**regimes, "1": "no_impact"}) == (False, False, True, True, True, False)


def test_reduction_to_one_degree_of_freedom_jumps():
    """The jumps of slow sweeps by time integration: up at 0.8855, down at 0.865."""
    from studies.dong_2022 import readings

    curve = hb.trace(hb.HarmonicBalance(readings.model("one DOF, F_m = 0.109"), 16), "Omega", (1.1, 0.75))
    up, down = sorted(curve.jumps(), key=lambda jump: -jump.direction)
    assert up.value == pytest.approx(0.8855, abs=1e-3)
    assert down.value == pytest.approx(0.865, abs=1e-3)


def test_readings_quick(tmp_path):
    from studies import study
    from studies.dong_2022 import readings

    results = readings.run(quick=True)
    assert [sum(found["held"]) for found in results["curves"].values()] == [4, 4]
    jumps = results["rest"]["one DOF, F_m = 0.109", 0.0]["case"].jumps
    assert jumps == pytest.approx([0.8825])  # from 0.880 to 0.885; it ends at the fold at 0.8855
    assert study.draw(readings.plot, results, tmp_path / "a")[0].stat().st_size > 10_000
    text = readings.report(results)
    assert "| default | no | no | yes | yes | yes | yes | 4 of 6 | no |" in text
    assert "from rest, W = 0 | yes | yes | no | no | yes | yes | 4 of 6 |" in text


@pytest.fixture(scope="module")
def rest():
    from studies.dong_2022 import from_rest

    return from_rest.run(quick=True)


def test_from_rest_the_motions_are_those_of_the_curve(rest):
    """Time integration ends on a stable motion of harmonic balance: the only one at 0.9, one of two at 0.875."""
    curve = rest["parts"]["one"]["curve"]
    motions = rest["parts"]["one"]["motions"]
    x, A = curve.values[curve.stable], curve.amplitude("pp2")[curve.stable]
    only = A[np.argmin(np.abs(x - 0.9))]
    assert [a[1] for a in motions.values()] == pytest.approx([only] * 2, abs=2e-3)
    expected = [np.interp(0.875, x[some][::-1], A[some][::-1]) for some in (A < 0.14, A > 0.172)]
    assert [motions[W][0] for W in (0.0, 0.3)] == pytest.approx(expected, abs=2e-3)


def test_from_rest_figure_and_report(rest, tmp_path):
    from studies import study
    from studies.dong_2022 import from_rest

    np.testing.assert_array_equal(from_rest.upper(rest["parts"]["one"]), [[0, np.nan], [1, np.nan]])
    assert study.draw(from_rest.plot, rest, tmp_path / "a")[0].stat().st_size > 10_000
    assert "| 0.8750 |" in from_rest.report(rest)


def test_from_rest_refuses_an_unknown_machine():
    from studies.dong_2022 import from_rest

    with pytest.raises(ValueError, match="no machine 'two'; there are one, pair"):
        from_rest.machine("two", 0.0)
