"""Parameters found again from synthetic measurements, and what is said of data that cannot determine them."""

import numpy as np
import pytest

import hbgear as hb
from hbgear.analysis.quantities.engineering_quantities import transmission_error
from hbgear.design.fitting.fit_search import FitSearch, FreeParameters, mean_square_limit
from hbgear.design.fitting.profile_likelihood import profile_interval
from hbgear.design.fitting.sweep_prediction import Prediction

TRUTH = hb.SpurPair(reference=(38000.0, 37.6e-6, 15000.0, 25.0))
START = TRUTH.replace(zeta=0.08, F_m=0.13, b=1.3, e=(0.07,))
FREE = ["zeta", "b", "F_m", "e[0]"]


def sweeps(model, measure, harmonics=8, span=(0.5, 1.4), count=30):
    """Frequencies, directions and amplitudes without noise of sweeps in both directions, and the jumps."""
    up = np.linspace(*span, count)
    Omega, direction = np.concatenate([up, up]), np.repeat([1, -1], count)
    vague = hb.design.Measurements(Omega, np.ones(2 * count), direction, deviation=1e9, measure=measure)
    found = Prediction(hb.HarmonicBalance(model, harmonics), vague, {}, (1.2 * span[1], span[0] / 1.2))
    return Omega, direction, found.amplitudes, found.jumps


@pytest.fixture(scope="module")
def largest():
    return sweeps(TRUTH, "max")


def test_a_model_that_does_not_resemble_the_data_is_named():
    """The amplitudes are those of a load of three times that of the model, without deviations."""

    def data_of(load):
        motions = hb.trace(hb.HarmonicBalance(hb.Duffing(k3=0.0, F=load), 2), "Omega", (0.5, 0.8))
        return hb.design.Measurements(motions.values, motions.amplitude("pp2"))

    problem = hb.HarmonicBalance(hb.Duffing(k3=0.0, F=0.1), 2)
    for load, warned in ((0.3, True), (0.1, False)):
        found = hb.design.fit(problem, data_of(load), {"zeta": (0.04, 0.06)})
        assert any("the model differs from the measured amplitudes by 67%" in text for text in found.warnings) == warned


def noisy(amplitude, seed, share=0.01):
    return amplitude * (1 + share * np.random.default_rng(seed).normal(size=len(amplitude)))


@pytest.mark.slow
def test_truth_without_noise(largest):
    Omega, direction, amplitude, jumps = largest
    data = hb.design.Measurements(Omega, amplitude, direction, 0.001 * amplitude, measure="max")
    found = hb.design.fit(START, data, FREE, harmonics=8)
    for name, true in zip(FREE, (0.05, 1.0, 0.1, 0.05), strict=True):
        assert found.values[name] == pytest.approx(true, rel=2e-3)
    assert found.reached.all() and found.status.complete and found.mean_square < 0.05
    assert [jump.value for jump in found.curve.jumps()] == pytest.approx([jump.value for jump in jumps], rel=1e-3)


def test_points_on_every_curve_of_the_span_are_reached():
    """The curve from 1.5 ends at its fold at 0.396: motions below it belong to another curve, and so does a jump."""
    problem, span = hb.HarmonicBalance(hb.SpurPair(zeta=0.01, eps=(0.0, 0.2), e=(0.05,)), 8), (1.5, 0.3)
    curve = hb.trace(problem, "Omega", span, accuracy=None)
    (other,) = curve.others
    rows = [int(np.argmin(np.abs(other.values - Omega) + 9.0 * ~other.stable)) for Omega in (0.32, 0.35, 0.38)]
    amplitude = other.amplitude("max")[rows]
    (jump,) = other.jumps()
    data = hb.design.Measurements(
        other.values[rows], amplitude, np.ones(3), measure="max", jumps=[(jump.value, jump.direction)]
    )
    found = Prediction(problem, data, {"zeta": 0.01}, span)
    assert {reference.kind for reference in found.references} <= {"swept", "other"}
    assert other.values[rows].max() < curve.values.min()
    np.testing.assert_allclose(found.amplitudes, amplitude, rtol=1e-6)
    np.testing.assert_allclose(found.jump_frequencies, [jump.value], rtol=1e-9)
    h = 1e-6
    up, down = (Prediction(problem, data, {"zeta": 0.01 + sign * h}, span).amplitudes for sign in (1, -1))
    J = found.jacobian(found.deviation)[:3, 0] * found.deviation
    np.testing.assert_allclose(J, (up - down) / (2 * h), rtol=1e-3, atol=1e-6)


@pytest.mark.slow
def test_derivatives_of_predictions(largest):
    """All residuals against central differences, where no point changes what it is held against; units too."""
    Omega, direction, amplitude, jumps = largest
    scales = TRUTH.scales
    data = hb.design.Measurements(
        scales.pinion_speed(Omega),
        noisy(amplitude, 1) * 37.6,
        direction,
        measure="max",
        unit="pinion r/min",
        length="um",
        jumps=[(scales.pinion_speed(jump.value) * 1.001, jump.direction) for jump in jumps],
    )
    problem = hb.HarmonicBalance(TRUTH, 8)
    values = {"zeta": 0.051, "b": 1.0, "F_m": 0.1, "e[0]": 0.05, "reference[0]": 38000.0, "reference[1]": 37.6e-6}
    span = (1.7, 0.4)
    here = Prediction(problem, data, values, span)
    s = here.deviation
    J = here.jacobian(s)
    far = here.distance_jacobian
    kinds = [reference.kind for reference in here.references]
    for i, (name, value) in enumerate(values.items()):
        h = 1e-6 * value
        up, down = (Prediction(problem, data, {**values, name: value + side * h}, span) for side in (1, -1))
        same = np.array([a == b.kind == c.kind for a, b, c in zip(kinds, up.references, down.references, strict=True)])
        rates = (up.residuals(s) - down.residuals(s)) / (2 * h)
        keep = np.concatenate([same, same, [True] * len(jumps)])
        np.testing.assert_allclose(J[keep, i], rates[keep], rtol=1e-4, atol=1e-4 * np.abs(rates).max() + 1e-9 / value)
        # distances are to rows of a curve, which move along it: the jumps alone are points
        both = (up.distances[-2:] - down.distances[-2:]) / (2 * h)
        np.testing.assert_allclose(far[-2:, i], both, rtol=1e-4, atol=1e-6 / value)


@pytest.mark.slow
def test_coverage_in_small(largest):
    """Of a few noise draws of 1 %, all estimates within 4 standard errors and most within 2; see the study."""
    Omega, direction, amplitude, _ = largest
    problem = hb.HarmonicBalance(START, 8)
    off = []
    for seed in range(4):
        data = hb.design.Measurements(Omega, noisy(amplitude, seed), direction, 0.01 * amplitude, measure="max")
        found = hb.design.fit(problem, data, FREE)
        truth = TRUTH.parameters | TRUTH.entries
        off.append([(found.values[name] - truth[name]) / found.errors[name] for name in FREE])
    assert np.mean(np.abs(off) < 2) > 0.8 and np.max(np.abs(off)) < 4


@pytest.mark.slow
def test_a_gap_that_alternating_amplitudes_do_not_know():
    """While no tooth touches on its back, a wider gap shifts the motion and changes nothing else."""
    Omega, direction, amplitude, _ = sweeps(TRUTH, "pp2")
    data = hb.design.Measurements(Omega, noisy(amplitude, 2), direction, 0.01 * amplitude)
    found = hb.design.fit(TRUTH.replace(zeta=0.06, b=1.1), data, ["zeta", "b"], harmonics=8, starts=1)
    assert "b has no effect on the data" in found.warnings and np.isnan(found.errors["b"])
    assert found.values["zeta"] == pytest.approx(0.05, abs=4 * found.errors["zeta"])
    with pytest.warns(DeprecationWarning, match="Fit.doubts is deprecated: use warnings"):
        assert found.doubts == found.warnings


@pytest.mark.parametrize("freedom", [2, 8, 50, 800])
def test_mean_square_below_which_a_fit_is_within_the_noise(freedom):
    """chi^2/f has the mean 1 and the standard deviation (2/f)^1/2: 4 of them above 1; 4 without given deviations."""
    assert mean_square_limit(freedom, True) == 4.0
    drawn = np.random.default_rng(0).chisquare(freedom, 200_000) / freedom
    limit = mean_square_limit(freedom, False)
    assert (limit - 1) / drawn.std() == pytest.approx(4.0, rel=0.01)
    assert 1e-5 < np.mean(drawn > limit) < 0.01  # noise is rarely taken for another minimum


class Residuals:
    """A prediction that consists of its residuals, in place of a traced curve."""

    def __init__(self, r, J=None):
        self.r, self.J, self.deviation = np.atleast_1d(r), J, np.ones(np.size(r))
        self.amplitudes = np.ones(np.size(r))

    def residuals(self, deviation):
        return self.r

    def information(self, deviation):
        return self.J


@pytest.mark.parametrize(
    ("assumed", "mean_square", "followed"), [(True, 3.9, 1), (True, 4.1, 3), (False, 2.9, 1), (False, 3.1, 3)]
)
def test_starts_end_with_the_first_minimum_within_the_noise(monkeypatch, assumed, mean_square, followed):
    """8 degrees of freedom: the limit is 4 without deviations of the data, and 1 + 4 (2/8)^1/2 = 3 with them."""
    data = hb.design.Measurements(np.linspace(0.5, 1.0, 10), np.ones(10), deviation=None if assumed else 0.01)
    low, high = np.array([0.01, 0.1]), np.array([0.2, 0.4])
    free = FreeParameters(("zeta", "F"), low, high, np.array([0.05, 0.2]))
    search = FitSearch(hb.HarmonicBalance(hb.Duffing(), 3), data, free, (0.4, 1.1))
    reached = Residuals(np.full(10, np.sqrt(8 * mean_square / 10)))
    minimized = []
    monkeypatch.setattr(search, "at", lambda x: Residuals(np.full(10, 1e3)))
    monkeypatch.setattr(search, "_minimize", lambda x: minimized.append(x) or setattr(search, "best", reached))
    search.run(starts=3, seed=0)
    assert search.followed == followed == len(minimized)
    assert minimized[0].tolist() == [0.05, 0.2]
    assert all((low < x).all() and (x < high).all() for x in minimized)


def test_a_start_without_a_response_is_left_out(monkeypatch):
    data = hb.design.Measurements(np.linspace(0.5, 1.0, 10), np.ones(10))
    free = FreeParameters(("zeta",), np.array([0.01]), np.array([0.2]), np.array([0.05]))
    search = FitSearch(hb.HarmonicBalance(hb.Duffing(), 3), data, free, (0.4, 1.1))
    monkeypatch.setattr(search, "at", lambda x: None)
    with pytest.raises(ValueError, match="the model has no response to compare with the data"):
        search.run(starts=3, seed=0)


def test_ctrl_c_during_a_curve_ends_the_search(monkeypatch):
    """A trace returns the part of its curve after Ctrl-C; the search took it for a model without a response."""
    truth = hb.trace(hb.HarmonicBalance(hb.Duffing(zeta=0.06), 3), "Omega", (0.7, 0.9))
    data, calls = hb.design.Measurements(truth.values, truth.amplitude("pp2")), []

    def interrupted(_):
        raise KeyboardInterrupt

    def trace(*args, **options):
        calls.append(args)
        return hb.trace(*args, **options, progress=interrupted if len(calls) == 2 else None)

    monkeypatch.setattr("hbgear.design.fitting.sweep_motions.trace", trace)
    found = hb.design.fit(hb.Duffing(), data, ["zeta"], harmonics=3)
    assert found.status == "interrupted" and len(calls) == 2


def test_a_parameter_without_effect_keeps_its_value():
    """The pair has no harmonics of the stiffness, of which eps_scale is the factor; a start had the factor 1.7."""
    data = hb.design.Measurements(np.linspace(0.7, 1.0, 8), np.full(8, 0.1))
    low, high = np.array([0.01, 0.1]), np.array([0.2, 10.0])
    free = FreeParameters(("zeta", "eps_scale"), low, high, np.array([0.05, 1.0]))
    search = FitSearch(hb.HarmonicBalance(hb.SpurPair(), 3), data, free, (0.6, 1.1))
    search.evaluate(np.array([0.07, 1.7]))
    search.restore()
    assert search.best.parameter_values["zeta"] == 0.07 and search.best.parameter_values["eps_scale"] == 1.0


def profile(residual, J, x, low=-np.inf, high=np.inf, unit=1.0):
    """Standard errors of an estimate x with residuals r(x) and their Jacobian there."""
    best = Residuals(residual(x), J)
    return profile_interval(
        best,
        lambda at: Residuals(residual(at)),
        x,
        unit * np.linalg.inv(J.T @ J),
        unit,
        np.broadcast_to(low, len(x)),
        np.broadcast_to(high, len(x)),
    )


@pytest.mark.parametrize("unit", [1.0, 2.5])
def test_profile_errors_of_a_linear_model_are_the_first_order_errors(unit):
    """S_j is a parabola with the ends a -+ 2 s_j, s_j^2 = unit C_jj, for any correlation."""
    random = np.random.default_rng(2)
    J, x = random.normal(size=(9, 3)) @ np.diag([1.0, 30.0, 0.01]), random.normal(size=3)
    rest = random.normal(size=9)
    rest -= J @ np.linalg.lstsq(J, rest, rcond=None)[0]
    expected = np.sqrt(unit * np.diag(np.linalg.inv(J.T @ J)))
    np.testing.assert_allclose(profile(lambda at: rest + J @ (at - x), J, x, unit=unit), expected, rtol=1e-9)


def test_profile_errors_are_those_of_the_side_with_the_slower_increase():
    """r = 1 - exp(-x): S(-2) = (e^2 - 1)^2 and S(2) = (1 - e^-2)^2 in place of 4, with s = 1."""
    J, x = np.array([[1.0]]), np.zeros(1)
    error = profile(lambda at: 1 - np.exp(-at), J, x)
    assert error[0] == pytest.approx(2 / (1 - np.exp(-2.0)), rel=1e-12)
    # next to a bound at 1.5 the parabola through this point; a bound nearer than 0.1 s leaves the other side
    assert profile(lambda at: 1 - np.exp(-at), J, x, high=1.5)[0] == pytest.approx(1.5 / (1 - np.exp(-1.5)), rel=1e-12)
    assert profile(lambda at: 1 - np.exp(-at), J, x, high=0.09)[0] == pytest.approx(2 / (np.exp(2.0) - 1), rel=1e-12)
    # a sum of squares that does not increase: three times the error of the linear model, and no more
    assert profile(lambda at: 0 * at, J, x)[0] == pytest.approx(3.0, rel=1e-12)


def test_profile_errors_minimize_over_the_other_parameters():
    """r = (x, y - x^2) is 4 at x = -+2 with the best y, and 20 with y = 0; along y it is linear: both errors are 1."""
    errors = profile(lambda at: np.array([at[0], at[1] - at[0] ** 2]), np.eye(2), np.zeros(2))
    np.testing.assert_allclose(errors, 1.0, rtol=1e-12)


def test_a_profile_without_any_curve_is_unknown():
    best = Residuals(np.zeros(1), np.array([[1.0]]))
    errors = profile_interval(best, lambda at: None, np.zeros(1), np.eye(1), 1.0, -np.ones(1), np.ones(1))
    assert np.isnan(errors).all()


def test_parameters_that_cannot_be_distinguished(largest):
    Omega, direction, amplitude, _ = largest
    data = hb.design.Measurements(Omega, amplitude, direction, 0.01 * amplitude, measure="max")
    found = hb.design.fit(
        TRUTH.replace(e_scale=1.1), data, {"e_scale": (0.5, 2), "e[0]": (0.02, 0.1)}, harmonics=8, starts=1
    )
    assert any("e_scale, e[0] cannot be distinguished with these data" in warning for warning in found.warnings)


def test_jumps_alone():
    _, _, _, jumps = sweeps(TRUTH, "pp2")
    data = hb.design.Measurements([], [], jumps=[(jump.value, jump.direction) for jump in jumps])
    found = hb.design.fit(TRUTH.replace(zeta=0.055, e=(0.053,)), data, ["zeta", "e[0]"], harmonics=8, span=(1.6, 0.4))
    assert found.values["zeta"] == pytest.approx(0.05, rel=1e-3) and found.values["e[0]"] == pytest.approx(
        0.05, rel=1e-3
    )
    assert found.jumps == pytest.approx([jump.value for jump in jumps], rel=1e-5)


def test_a_jump_that_the_model_does_not_have(largest):
    Omega, direction, amplitude, _ = largest
    few = Omega > 0.9
    data = hb.design.Measurements(
        Omega[few], amplitude[few], direction[few], 0.01 * amplitude[few], [(1.2, 1)], measure="max"
    )
    found = hb.design.fit(TRUTH.replace(zeta=0.2), data, {"zeta": (0.15, 0.25)}, harmonics=8, starts=1)
    assert any("the model has no jump like the one measured at 1.2" in warning for warning in found.warnings)


def test_data_in_the_wrong_unit(largest):
    Omega, direction, amplitude, _ = largest
    with pytest.raises(ValueError, match=r"the measured amplitudes are 1e\+06 times those of the model"):
        hb.design.fit(
            TRUTH, hb.design.Measurements(Omega, 1e6 * amplitude, direction, measure="max"), ["zeta"], harmonics=8
        )
    with pytest.raises(ValueError, match="the unit Omega is probably wrong; give unit='mesh Hz', 'pinion r/min' or"):
        hb.design.fit(TRUTH, hb.design.Measurements(1e4 * Omega, amplitude, direction), ["zeta"], harmonics=8)
    with pytest.raises(ValueError, match="Duffing does not know its units; give frequencies as Omega"):
        hb.design.fit(
            hb.Duffing(), hb.design.Measurements(Omega, amplitude, direction, unit="mesh Hz"), ["zeta"], harmonics=3
        )
    with pytest.raises(ValueError, match="Duffing does not know its unit of length"):
        hb.design.fit(
            hb.Duffing(), hb.design.Measurements(Omega, amplitude, direction, length="um"), ["zeta"], harmonics=3
        )


def test_invalid_fits_are_refused(largest):
    Omega, direction, amplitude, _ = largest
    data = hb.design.Measurements(Omega, amplitude, direction)
    with pytest.raises(KeyError, match="no parameter 'zetta'; did you mean 'zeta'"):
        hb.design.fit(TRUTH, data, ["zetta"])
    with pytest.raises(ValueError, match="Omega is the frequency"):
        hb.design.fit(TRUTH, data, ["Omega"])
    with pytest.raises(ValueError, match="name at least one parameter"):
        hb.design.fit(TRUTH, data, [])
    with pytest.raises(ValueError, match=r"bounds of zeta = \(0.2, 0.1\) must ascend"):
        hb.design.fit(TRUTH, data, {"zeta": (0.2, 0.1)})
    with pytest.raises(ValueError, match="W is 0 in the model, so give its bounds"):
        hb.design.fit(hb.gears.DoubleHelicalPair(), data, ["W"], harmonics=4)
    with pytest.raises(ValueError, match="2 parameters from 1 measured numbers"):
        hb.design.fit(TRUTH, hb.design.Measurements([0.9], [0.5]), ["zeta", "b"])
    with pytest.raises(ValueError, match="needs one number of harmonics throughout"):
        hb.design.fit(hb.HarmonicBalance(TRUTH, "auto"), data, ["zeta"])


def test_measurements_that_are_none():
    with pytest.raises(ValueError, match="no amplitudes and no jumps are given"):
        hb.design.Measurements([], [])
    with pytest.raises(ValueError, match="2 frequencies and 1 amplitudes"):
        hb.design.Measurements([0.9, 1.0], [0.5])
    with pytest.raises(ValueError, match="amplitude must be a list of positive, finite numbers"):
        hb.design.Measurements([0.9], [-0.5])
    with pytest.raises(ValueError, match=r"direction must be \+1"):
        hb.design.Measurements([0.9], [0.5], 2)
    with pytest.raises(ValueError, match=r"the jump \(1, 0\) must be"):
        hb.design.Measurements([0.9], [0.5], jumps=[(1, 0)])
    with pytest.raises(ValueError, match="unit = 'hz'"):
        hb.design.Measurements([0.9], [0.5], unit="hz")
    with pytest.raises(ValueError, match="Measurements: no measure 'pp'; there are rms, pp2"):
        hb.design.Measurements([0.9], [0.5], measure="pp")


def test_file(tmp_path, largest):
    Omega, direction, amplitude, jumps = largest
    path = tmp_path / "sweep.csv"
    rows = [
        f"{TRUTH.scales.pinion_speed(f)},{37.6 * a},{'up' if d > 0 else 'down'}"
        for f, a, d in zip(Omega, noisy(amplitude, 3), direction, strict=True)
    ]
    rows += [f"{TRUTH.scales.pinion_speed(jump.value)},,{jump.direction}" for jump in jumps]
    path.write_text("# a test\nrpm,x [um],sweep\n" + "\n".join(rows))
    columns = {"frequency": "rpm", "amplitude": "x [um]", "direction": "sweep"}
    data = hb.design.read_measurements(path, columns, unit="pinion r/min", length="um", measure="max")
    assert (
        len(data) == 60
        and len(data.jumps) == 2
        and data.amplitude[0] == pytest.approx(37.6e-6 * noisy(amplitude, 3)[0])
    )
    with pytest.raises(KeyError, match="there is no column 'speed' for frequency"):
        hb.design.read_measurements(path, {"frequency": "speed"})
    with pytest.raises(KeyError, match="there is no column for 'frequenzy'; did you mean 'frequency'"):
        hb.design.read_measurements(path, {"frequenzy": "rpm"})
    with pytest.raises(ValueError, match="cannot be read as measurements: No such file"):
        hb.design.read_measurements(tmp_path / "none.csv")
    bad = tmp_path / "bad.csv"
    bad.write_text("frequency,amplitude\n0.9,0.5\n1.0,x\n")
    with pytest.raises(ValueError, match=r"bad.csv', line 3: 'x' in the column 'amplitude' must be a number"):
        hb.design.read_measurements(bad)
    bad.write_text("frequency,amplitude,direction\n0.9,0.5,sideways\n")
    with pytest.raises(ValueError, match="line 2: 'sideways' in the column 'direction' must be up or down"):
        hb.design.read_measurements(bad)


def test_columns_of_machine_quantities_are_measurements(tmp_path):
    """Their headings are known; the transmission error was refused, or taken for a displacement with ``columns``."""
    pair = hb.SpurPair(e=(0.05,), reference=(38000.0, 37.6e-6, 15000.0, 25))
    curve = hb.trace(hb.HarmonicBalance(pair, 4), "Omega", (1.2, 1.15), stability=False)
    quantities, path = hb.analysis.machine_quantities(curve), tmp_path / "curve.csv"
    quantities.save(path)
    amplitude = "dte, half peak-to-peak [um]"
    for heading, unit in (("pinion [r/min]", "pinion r/min"), ("mesh [Hz]", "mesh Hz"), ("Omega [-]", "Omega")):
        data = hb.design.read_measurements(path, {"frequency": heading, "amplitude": amplitude})
        assert data.unit == unit and data.length == "um" and data.measure == "pp2" and data.transmission_error
        np.testing.assert_allclose(data.frequency, quantities.columns[heading], rtol=1e-12)
        np.testing.assert_allclose(data.amplitude, 1e-6 * quantities[amplitude], rtol=1e-12)
        table = tmp_path / "two.csv"
        table.write_text(f'{heading},"{amplitude}"\n9000,3.5\n')
        assert hb.design.read_measurements(table).transmission_error
    with pytest.raises(ValueError, match="is pp2, and measure = 'rms' was given"):
        hb.design.read_measurements(table, measure="rms")


@pytest.mark.slow
def test_command(tmp_path, largest, run):
    Omega, direction, amplitude, _ = largest
    path, figure = tmp_path / "sweep.csv", tmp_path / "fit.png"
    rows = [f"{f},{a},{d}" for f, a, d in zip(Omega, noisy(amplitude, 4), direction, strict=True)]
    path.write_text("frequency,amplitude,direction\n" + "\n".join(rows))
    said = ["fit", str(path), "spur-pair", "--set", "zeta=0.06", "--free", "zeta=0.01:0.2,e[0]", "--measure", "max"]
    code, out, _ = run(*said, "--harmonics", "8", "--plot", figure)
    assert (
        code == 0
        and "zeta" in out
        and "correlation" in out
        and "root mean square of the residuals" in out
        and figure.exists()
    )
    assert "1% of each amplitude is assumed, and the uncertainties follow" in " ".join(out.split())
    code, _, err = run(*said, "--unit", "knots")
    assert code == 2 and "unit = 'knots'" in err
    said[6] = "zeta=0.01"
    code, _, err = run(*said)
    assert code == 2 and "need NAME or NAME=LOW:HIGH" in err


@pytest.mark.slow
def test_transmission_errors_are_no_displacements_of_a_prescribed_error(tmp_path):
    """Taken as displacements d, the transmission errors d + e of this pair give a damping of 0.013 instead of 0.06."""
    for fields, refused in ({"e": (0.05,)}, True), ({"e": (), "eps": (0.2,)}, False):
        pair = hb.SpurPair(zeta=0.06, reference=(38000.0, 37.6e-6, 15000.0, 25), **fields)
        curve = hb.trace(hb.HarmonicBalance(pair, 8), "Omega", (1.4, 1.1))
        errors, speeds = transmission_error(curve), pair.scales.pinion_speed(curve.values)
        rows = [f"{speeds[i]:.12g}, {errors[i]:.12g}, down" for i in np.flatnonzero(curve.stable)[1::6]]
        (tmp_path / "rig.csv").write_text("\n".join(["n [r/min], dte [um], direction", *rows]))
        data = hb.design.read_measurements(tmp_path / "rig.csv")
        assert data.transmission_error and data.measure == "pp2"
        if refused:
            with pytest.raises(ValueError, match="element 'gap' has a prescribed displacement e"):
                hb.design.fit(pair, data, ["zeta"], harmonics=8)
            assert not hb.design.read_measurements(tmp_path / "rig.csv", transmission_error=False).transmission_error
        else:
            found = hb.design.fit(pair.replace(zeta=0.05), data, {"zeta": (0.03, 0.1)}, harmonics=8, starts=1)
            assert found.values["zeta"] == pytest.approx(0.06, rel=1e-3)
