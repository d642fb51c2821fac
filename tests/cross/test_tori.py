"""Tori of two masses against invariant circles of the stroboscopic map, time integration, and Neimark-Sacker points.

m 1 and .05; k 1 (ground) and .0453 (link); d .002 and .013; cubic 1 and .0042 at the same places; .13 cos(Omega t) on
the first mass. The invariant circles were computed by Fourier collocation of an integrated stroboscopic map.
"""

from dataclasses import replace

import matplotlib.pyplot as plt
import numpy as np
import pytest
from machines import single_mass, two_masses

import hbgear as hb
from hbgear.analysis.summary import reliability_lines, special_table
from hbgear.continuation.solvers.newton import solve
from hbgear.harmonic.autonomous.tori import ends
from hbgear.harmonic.autonomous.tori.basis import TorusBasis
from hbgear.harmonic.autonomous.tori.branch import require_free_rotation
from hbgear.harmonic.autonomous.tori.ends import locking_remark
from hbgear.mechanics.structures.scales import Scales

CIRCLES = {
    1.12: (0.08538421776875502, 0.3573361101504505, 1.4217762117117727),
    1.14: (0.08760866919923584, 0.380393261844799, 1.397071170206905),
    1.16: (0.09060912674225884, 0.3923012490472335, 1.3639454591090436),
    1.18: (0.09091584050541562, 0.39812156311043484, 1.3231743991249871),
    1.2: (0.08552732091631919, 0.4070152266943867, 1.266267589539745),
    1.21: (0.07976049351697487, 0.41420508857739086, 1.2287133854515826),
}
"""Rotation number, and rms of both coordinates, at Omega."""


class CubicDamper(hb.mechanics.Law):
    """A cubic spring and a small cubic damper."""

    def force(self, d, v, tau):
        return d**3 + 1e-2 * v**3, 3 * d**2, 3e-2 * v**2


@pytest.fixture(scope="module")
def curve():
    return hb.trace(hb.HarmonicBalance(two_masses(), 9), "Omega", (1.1, 1.27))


@pytest.fixture(scope="module")
def tori(curve):
    return hb.analysis.torus(curve, "NS1", harmonics=(8, 12))


@pytest.fixture(scope="module")
def fine(curve):
    return hb.analysis.torus(curve, "NS1", harmonics=(12, 16))


def at(tori, Omega):
    """Coefficients and second frequency of the torus at one Omega."""
    (i,) = np.flatnonzero((tori.values[:-1] - Omega) * (tori.values[1:] - Omega) <= 0)
    problem, point = tori.problem, tori[int(i)]
    U = problem.join(point.X, point.parameters)
    return solve(problem.with_borders_at(U, {"Omega": Omega}, renew=True), U, {"Omega": Omega}).X


@pytest.mark.slow
@pytest.mark.parametrize("Omega", CIRCLES)
def test_rotation_number_and_rms_are_those_of_invariant_circles(fine, Omega):
    rotation, *rms = CIRCLES[Omega]
    U = at(fine, Omega)
    assert U[-1] / Omega == pytest.approx(rotation, abs=1e-10)
    q = fine.problem.motion(U[:-1], Omega=Omega, Omega_2=U[-1])
    np.testing.assert_allclose(np.sqrt(np.sum(np.abs(q[:, 1:]) ** 2, axis=1) / 2), rms, rtol=3e-10)
    assert fine.layout.measure("rms", U[:-1], "ground") == pytest.approx(rms[0], rel=3e-10)


@pytest.mark.slow
def test_errors_fall_exponentially_with_the_harmonics(curve):
    errors = []
    for harmonics in ((4, 4), (6, 8), (8, 12)):
        found = hb.analysis.torus(curve, "NS1", (1.1, 1.12), harmonics=harmonics)
        errors.append(abs(found.tracked["Omega_2"][-1] / 1.12 - CIRCLES[1.12][0]))
    assert errors[1] < 0.05 * errors[0] and errors[2] < 0.05 * errors[1]


@pytest.mark.slow
def test_branch_ends_at_the_other_neimark_sacker_point(curve, tori):
    assert tori.status is hb.Status.MERGED and "Neimark-Sacker" in tori.message
    first, last = curve["NS1"].parameters["Omega"], curve["NS2"].parameters["Omega"]
    assert tori["EP1"].parameters["Omega"] == pytest.approx(last, abs=1e-6)
    assert tori.problem.basis.odd and tori.values[0] == pytest.approx(first, abs=1e-3)
    exponent = hb.harmonic.NeimarkSackerProblem(curve.problem, "Omega").exponent(
        curve.problem.from_point(curve["NS2"]), **curve["NS2"].parameters
    )
    assert tori.tracked["Omega_2"][-1] == pytest.approx(abs(exponent.imag), abs=1e-4)


@pytest.mark.slow
@pytest.mark.parametrize(("harmonics", "label"), [((5, 8), "NS2"), ((5, 10), "NS2"), ((5, 8), "NS1"), ((7, 8), "NS1")])
def test_the_error_of_the_end_is_the_distance_from_the_neimark_sacker_point(curve, harmonics, label):
    """No error was stated. Ends are singular: with many harmonics the location is off by 6e-8."""
    start = "NS1" if label == "NS2" else "NS2"
    end = hb.analysis.torus(curve, start, harmonics=harmonics, stability=False)["EP1"]
    error = abs(end.parameters["Omega"] - curve[label].parameters["Omega"])
    assert error > 30 * curve[label].error
    assert error / 2 < end.error < 2 * error


@pytest.mark.slow
def test_the_error_of_the_second_frequency(curve, fine):
    tori = hb.analysis.torus(curve, "NS1", harmonics=(5, 8))
    fits = fine.values.min(), fine.values.max()
    inner = [i for i in range(0, len(tori) - 1, 3) if fits[0] < tori.values[i] < fits[1]]
    error = max(abs(at(fine, tori.values[i])[-1] / tori.tracked["Omega_2"][i] - 1) for i in inner)
    assert error / 3 < tori.unknown_errors["Omega_2"] < 3 * error
    assert f"Omega_2 {tori.unknown_errors['Omega_2']:.0e}" in reliability_lines(tori)[0]


def test_time_integration_stays_on_the_torus(tori):
    i = int(np.argmin(np.abs(tori.values - 1.15)))
    check = hb.time.verify_torus(tori, i, periods=400)
    assert check.stable and abs(check.growth) < 2e-3 and check.deviation < 1e-3 and check.rotation_error < 1e-6
    Omega_2 = 1.001 * tori.tracked["Omega_2"][i]  # a torus of another frequency is noticed
    moved = replace(tori, tracked={**tori.tracked, "Omega_2": np.full(len(tori), Omega_2)})
    assert hb.time.verify_torus(moved, i, periods=400).deviation > 0.1


@pytest.mark.parametrize("damped", [False, True])
def test_jacobian_is_the_derivative_of_the_residual(damped):
    balance = hb.HarmonicBalance(two_masses(ground=CubicDamper() if damped else None), 3)
    problem = hb.harmonic.TorusProblem(balance, TorusBasis(3, 3))
    rng = np.random.default_rng(0)
    U, v = rng.normal(size=(2, problem.size))
    U[-1] = 0.3
    here = {"Omega": 1.1}
    problem = problem.with_borders_at(U, here)
    now = problem.linearise(U, "Omega", **here)
    h = 1e-6
    near = [problem.linearise(U + s * h * v, "", **here).R for s in (1, -1)]
    np.testing.assert_allclose((near[0] - near[1]) / (2 * h), now.dR_dX @ v, rtol=1e-6, atol=1e-6 * now.size)
    near = [problem.linearise(U, "", Omega=1.1 + s * h).R for s in (1, -1)]
    np.testing.assert_allclose((near[0] - near[1]) / (2 * h), now.dR_dp, rtol=1e-6, atol=1e-6 * now.size)


def test_products_and_samples_of_the_basis():
    basis, rng = TorusBasis(4, 3), np.random.default_rng(1)
    a, b = (basis.to_complex(x) for x in rng.normal(size=(2, basis.width)))
    samples = basis.samples(a)
    np.testing.assert_allclose(basis.coefficients(samples), a, atol=1e-13)
    theta = np.array([[2 * np.pi * 3 / basis.shape[0], 2 * np.pi * 5 / basis.shape[1]]])
    assert basis.evaluate(a, theta)[0] == pytest.approx(samples[3, 5], abs=1e-12)
    product = basis.coefficients(samples * basis.samples(b))
    np.testing.assert_allclose(basis.product(samples) @ basis.to_real(b), basis.to_real(product), atol=1e-12)


def test_measures_are_those_of_dense_samples(tori):
    X, basis = tori[30].X, TorusBasis(8, 12, odd=True, dense=12)
    d = basis.samples(basis.to_complex(tori.layout.rows(X, "link")))
    assert tori.layout.measure("max", X, "link") == pytest.approx(np.abs(d).max(), rel=2e-4)
    assert tori.layout.measure("pp2", X, "link") == pytest.approx(0.5 * np.ptp(d), rel=2e-4)
    assert tori.layout.measure("rms", X, "link") == pytest.approx(d.std(), rel=1e-12)
    assert tori.layout.measure("mean", X, "link") == pytest.approx(0.0, abs=1e-12)


def test_figures(curve, tori):
    ax = hb.plot.torus(tori, "rms", "link", hb.plot.response(curve, "rms", "link"))
    first, *_ = (line for line in ax.lines if line.get_gid() == "tori")
    assert first.get_linestyle() == "-"  # stable
    np.testing.assert_array_equal(first.get_ydata()[:60], tori.amplitude("rms", "link")[:60])
    both = hb.plot.responses([curve, tori], "rms", "link", names=["periodic", "tori"])
    assert {line.get_gid() for line in both.lines} >= {"tori", "branch unknown True"}
    assert hb.plot.response(tori).get_xlabel() == r"$\Omega$"
    (section,) = hb.plot.torus_section(tori, 10).lines
    x, y = section.get_data()
    assert (x[0], y[0]) == pytest.approx((x[-1], y[-1])) and len(x) == 401
    ax = hb.plot.torus_spectrum(tori, 10)
    heights = [segment[1] for lines in ax.collections for segment in lines.get_segments()]
    highest = max(heights, key=lambda end: end[1])
    assert highest[0] == pytest.approx(tori.values[10])  # the frequency of the excitation
    plt.close("all")


def test_sections_and_spectra_in_physical_units(tori, monkeypatch):
    """Coordinates, rates and frequencies are those of the model times the units of `Scales`."""
    known = Scales(frequency=2e4, length=5e-5, force=1e3, teeth=25)
    (plain,) = hb.plot.torus_section(tori, 10).lines
    lines = hb.plot.torus_spectrum(tori, 10).collections
    monkeypatch.setattr("hbgear.plot.free_motions.scales_at", lambda branch, row: known)
    ax = hb.plot.torus_section(tori, 10)
    np.testing.assert_allclose(ax.lines[0].get_xydata(), plain.get_xydata() * [50.0, 1.0], rtol=1e-12)
    assert "[\N{MICRO SIGN}m]" in ax.get_xlabel() and "[m/s]" in ax.get_ylabel()
    ax = hb.plot.torus_spectrum(tori, 10)
    for now, before in zip(ax.collections, lines, strict=True):
        for one, other in zip(now.get_segments(), before.get_segments(), strict=True):
            np.testing.assert_allclose(one, other * [2e4 / (2 * np.pi), 50.0], rtol=1e-12)
    assert ax.get_xlabel() == "frequency [Hz]"
    (same,) = hb.plot.torus_section(tori, 10, dimensionless=True).lines
    np.testing.assert_array_equal(same.get_xydata(), plain.get_xydata())
    plt.close("all")


def test_saved_tori_have_the_same_numbers_measures_and_figures(tori, tmp_path):
    tori.save(tmp_path / "tori.npz")
    again = hb.load(tmp_path / "tori.npz")
    assert np.array_equal(again.X, tori.X) and np.array_equal(again.tracked["Omega_2"], tori.tracked["Omega_2"])
    assert again.layout.odd and again.amplitude("pp2", "link").max() == tori.amplitude("pp2", "link").max()
    for draw in (hb.plot.torus, hb.plot.torus_section, hb.plot.torus_spectrum):
        assert draw(again).has_data()
    plt.close("all")


@pytest.mark.slow
def test_saved_tori_are_continued(curve, tori, tmp_path):
    """The continued branch is the branch that is traced at once; a file holds the problem."""
    part = hb.analysis.torus(curve, "NS1", (1.1, 1.14), harmonics=(8, 12))
    part.save(tmp_path / "part.npz")
    loaded = hb.load(tmp_path / "part.npz")
    whole = hb.extend(loaded, (1.1, 1.27))
    assert whole.status is hb.Status.MERGED and len(whole) > len(part) and "stability" not in whole.message
    np.testing.assert_array_equal(whole.X[: len(part)], part.X)
    # the equations are singular at the end: rounding over a small modulation, which depends on the processor
    assert whole["EP1"].parameters["Omega"] == pytest.approx(tori["EP1"].parameters["Omega"], abs=1e-6)
    assert at(whole, 1.2)[-1] == pytest.approx(at(tori, 1.2)[-1], abs=1e-10)
    assert hb.time.verify_torus(hb.load(tmp_path / "part.npz"), periods=50).deviation < 1e-3


def test_messages_of_continued_tori(curve, tmp_path, monkeypatch):
    """The message states for continued tori, too, why the stability is not determined."""
    part = hb.analysis.torus(curve, "NS1", (1.1, 1.12), harmonics=(5, 4))
    monkeypatch.setattr("hbgear.harmonic.autonomous.tori.stability.obstacle", lambda problem, parameters: "no growth")
    whole = hb.extend(part, (1.1, 1.13))
    count = len(whole) - len(part) + 1
    assert whole.message.endswith(f"stability not determined at {count} of {count} points: no growth")


def test_a_damaged_description_of_tori_is_refused(tori, tmp_path):
    from hbgear.harmonic.models.model_registry import rebuild_problem

    for damaged in (
        {"harmonics": [8], "odd": True, "dense": 1},
        {"odd": True},
        {"harmonics": [8, 12], "odd": 1, "dense": 1},
    ):
        with pytest.raises(ValueError, match="tori"):
            rebuild_problem({**tori.meta, "torus": damaged})


def test_bad_input(curve, tori):
    with pytest.raises(ValueError, match="LP1 is no Neimark-Sacker point"):
        hb.analysis.torus(curve, "LP1")
    with pytest.raises(ValueError, match="outside the span"):
        hb.analysis.torus(curve, "NS1", (1.2, 1.3))
    with pytest.raises(ValueError, match="Omega_2 is an unknown"):
        tori.problem.check_parameter("Omega_2")
    with pytest.raises(ValueError, match="no measure 'H1'"):
        tori.amplitude("H1")
    with pytest.raises(ValueError, match="has no tori"):
        hb.time.verify_torus(curve)
    few = hb.HarmonicBalance(single_mass(hb.mechanics.Jenkins(1.0, 0.1), F=1.0), 3)
    with pytest.raises(ValueError, match="laws without memory"):
        hb.harmonic.TorusProblem(few, TorusBasis(2, 2))


def test_a_spectrum_that_does_not_decay_ends_the_branch(curve, monkeypatch):
    monkeypatch.setattr(ends, "MAX_SPECTRUM_END", 1e-3)
    found = hb.analysis.torus(curve, "NS1", harmonics=(6, 8))
    assert found.status is hb.Status.EVENT and "loss of smoothness" in found.message
    last = found["SM1"]
    assert last.parameters["Omega"] == found.values[-1] < 1.25
    assert found.layout.spectrum_end(last.X) == pytest.approx(1e-3, rel=1e-6)
    assert np.isnan(last.error) and "special points unknown" in reliability_lines(found)[0]
    assert "its error is unknown" in special_table(found)[1][0][-1]


def test_an_end_near_a_simple_rotation_number_is_named_as_locking(tori):
    i = int(np.argmin(np.abs(tori.tracked["Omega_2"] / tori.values - 1 / 11)))
    turns = tori.tracked["Omega_2"][i] / tori.values[i]
    assert abs(turns - 1 / 11) < 1e-3
    failed = replace(
        tori,
        status=hb.Status.STEP_TOO_SMALL,
        tracked={"Omega_2": np.append(tori.tracked["Omega_2"][:-1], turns * tori.values[-1])},
    )
    assert "locking at 1/11" in locking_remark(failed)
    assert "locking" not in locking_remark(tori)


def test_no_torus_leaves_at_a_strong_resonance():
    with pytest.raises(ValueError, match="near 1/3: at this strong resonance"):
        require_free_rotation("NS1", 0.3334)
    require_free_rotation("NS1", 0.34)
