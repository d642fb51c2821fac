"""The band of a whole curve, against curves traced with other values of the parameters."""

import matplotlib
import numpy as np
import pytest
from machines import single_mass

import hbgear as hb

matplotlib.use("Agg")

PAIR = hb.SpurPair(reference=(38000.0, 37.6e-6, 15000.0, 25.0))
FINE = hb.StepControl(max_step=0.004, max_points=4000)
SPREAD = {"zeta": 1e-4, "e[0]": 5e-5, "F_m": 2e-4, "reference[0]": 10.0}


@pytest.fixture(scope="module")
def curve():
    return hb.trace(hb.HarmonicBalance(PAIR, 5), "Omega", (1.4, 0.4))


def displaced(band, model, width=0.03):
    """Signed distances (P,) along its normals to the curve of another model, in the units of the band."""
    other = hb.trace(hb.HarmonicBalance(model, 5), "Omega", (1.5, 0.3), steps=FINE, accuracy=None, stability=False)
    speed = model.scales.pinion_speed(1.0) if band.unit != "Omega" else 1.0
    length = model.scales.length * 1e6 if band.length else 1.0
    path = np.column_stack([speed * other.values, length * other.amplitude("pp2")]) / band.size
    out = np.full(len(band.frequency), np.nan)
    for i, (x, y) in enumerate(zip(band.frequency, band.amplitude, strict=True)):
        n = band.normal[i]
        away = path - np.array([x, y]) / band.size
        along, across = away @ [n[1], -n[0]], away @ n
        met = np.flatnonzero((along[:-1] * along[1:] <= 0) & (np.abs(across[:-1]) < width))
        shares = along[met] / (along[met] - along[met + 1])
        places = across[met] + shares * (across[met + 1] - across[met])
        out[i] = places[np.argmin(np.abs(places))] if len(places) else np.nan
    return out


def moved(model, **changes):
    own = model.parameters | model.entries
    return model.replace(**{name: own[name] + change for name, change in changes.items()})


@pytest.mark.parametrize(("unit", "length"), [("Omega", ""), ("pinion r/min", "um")])
@pytest.mark.parametrize("name", SPREAD)
def test_each_parameter_against_two_curves(curve, name, unit, length):
    """Also in r/min and um, whose scales move with the curve: the natural frequency moves it in r/min alone."""
    band = hb.design.response_band(curve, {name: SPREAD[name]}, unit=unit, length=length)
    up, down = (displaced(band, moved(PAIR, **{name: side * SPREAD[name]})) for side in (1, -1))
    found, expected = band.effects[:, 0], (up - down) / 2
    np.testing.assert_allclose(band.deviation, np.abs(found), atol=1e-12)
    if name == "reference[0]" and unit == "Omega":
        np.testing.assert_allclose(found, 0.0, atol=1e-12)
        return
    assert np.isfinite(expected).all() and np.abs(expected).max() > 1e-4
    np.testing.assert_allclose(found, expected, atol=0.02 * np.abs(expected).max())


@pytest.mark.slow
def test_monte_carlo_of_whole_curves(curve):
    """Each of many traced curves is where the first order puts it, and so is their standard deviation.

    Where the curve is bent as sharply as the band is wide, at its tip, no first order holds; these rows are left out.
    """
    spread = {"zeta": 1e-4, "e[0]": 5e-5, "F_m": 2e-4}
    band = hb.design.response_band(curve, spread)
    xi = np.random.default_rng(3).normal(size=(40, 3))
    drawn = np.array(
        [
            displaced(band, moved(PAIR, **{n: x * s for (n, s), x in zip(spread.items(), row, strict=True)}))
            for row in xi
        ]
    )
    turned = np.abs(np.gradient(np.unwrap(np.arctan2(*band.normal.T))))
    path = np.column_stack([band.frequency, band.amplitude]) / band.size
    radius = np.linalg.norm(np.gradient(path, axis=0), axis=1) / turned
    smooth = radius > 50 * band.deviation
    assert smooth.sum() > 80 and smooth[curve["LP1"].index] and smooth[curve["LP2"].index]
    drawn, first, deviation = drawn[:, smooth], (xi @ band.effects.T)[:, smooth], band.deviation[smooth]
    assert np.isfinite(drawn).all()
    assert np.sqrt(np.mean((drawn - first) ** 2, axis=0)).max() < 0.1 * deviation.max()
    np.testing.assert_allclose(drawn.std(axis=0), first.std(axis=0), rtol=0.06, atol=0.02 * deviation.max())
    assert 0.90 < (np.abs(drawn) < 2 * deviation).mean() < 0.99


def test_held_frequency_and_held_amplitude(curve):
    """Away from folds the scatter of the amplitude is that of `sensitivity`; at the fold it is unknown."""
    band = hb.design.response_band(curve, {"zeta": 1e-3, "e[0]": 5e-4}, unit="Omega", length="")
    for i in (5, 20, len(curve) - 4):
        row = hb.analysis.sensitivity(curve[i], ["zeta", "e[0]"], measure="pp2")
        assert band.at_frequency[i] == pytest.approx(row.scatter({"zeta": 1e-3, "e[0]": 5e-4}, "pp2"), rel=1e-6)
    fold = curve["LP1"]
    jump = hb.analysis.sensitivity(fold, ["zeta", "e[0]"]).scatter({"zeta": 1e-3, "e[0]": 5e-4})
    assert band.at_amplitude[fold.index] == pytest.approx(jump, rel=1e-6)
    assert band.at_frequency[fold.index] > 1e3 * jump
    upper, lower = band.edges(1)
    np.testing.assert_allclose((upper + lower) / 2, np.column_stack([band.frequency, band.amplitude]))
    apart = np.einsum("px,px->p", (upper - lower) / band.size, band.normal) / 2
    np.testing.assert_allclose(apart, band.deviation)


def test_band_of_a_fit(curve):
    """The covariance counts, not the standard errors alone."""
    rows = np.arange(2, 30, 3)
    data = hb.design.Measurements(curve.values[rows], 1.001 * curve.amplitude("pp2")[rows], -1, 0.001)
    found = hb.design.fit(hb.HarmonicBalance(PAIR, 5), data, ["zeta", "e[0]"])
    band = hb.design.response_band(found.curve, found)
    alone = hb.design.response_band(found.curve, found.errors)
    i = 40
    g = [alone.effects[i, j] / found.errors[name] for j, name in enumerate(found.names)]
    assert band.deviation[i] == pytest.approx(np.sqrt(g @ found.covariance @ g), rel=1e-9)
    assert not np.isclose(band.deviation[i], alone.deviation[i], rtol=1e-3)


def test_figure(curve, tmp_path):
    band = hb.design.response_band(curve, {"zeta": 2e-3})
    assert (band.unit, band.length) == ("pinion r/min", "um")
    ax = hb.plot.band(band, sigmas=3)
    assert "r/min" in ax.get_xlabel() and "[\N{MICRO SIGN}m]" in ax.get_ylabel()
    (shade,) = ax.patches
    upper, lower = band.edges(3)
    corners = shade.get_path().vertices
    for edge in (upper, lower):
        apart = np.abs((corners[:, None] - edge[None]) / band.size).sum(axis=2).min(axis=0)
        assert apart.max() < 1e-9
    under = hb.plot.response(curve)
    lines = len(under.lines)
    hb.plot.band(hb.design.response_band(curve, {"zeta": 2e-3}), under)
    assert len(under.lines) == lines + 1 and len(under.patches) >= 1
    with pytest.raises(ValueError, match="there is no colour 'blau'"):
        hb.plot.band(band, color="blau")


def test_quantities_without_a_band(curve):
    with pytest.raises(KeyError, match="no parameter 'zetta'; did you mean 'zeta'"):
        hb.design.response_band(curve, {"zetta": 0.1})
    with pytest.raises(ValueError, match="Omega is the continuation parameter of the curve"):
        hb.design.response_band(curve, {"Omega": 0.1})
    with pytest.raises(ValueError, match="name at least one parameter that scatters"):
        hb.design.response_band(curve, {})
    with pytest.raises(ValueError, match=r"zeta = -0\.1"):
        hb.design.response_band(curve, {"zeta": -0.1})
    with pytest.raises(ValueError, match="unit = 'rpm'"):
        hb.design.response_band(curve, {"zeta": 0.1}, unit="rpm")
    duffing = hb.trace(hb.HarmonicBalance(hb.Duffing(), 3), "Omega", (0.8, 0.9))
    with pytest.raises(ValueError, match="Duffing does not know its units"):
        hb.design.response_band(duffing, {"zeta": 0.001}, length="um")
    over_damping = hb.trace(curve.problem, "zeta", (0.05, 0.06), at={"Omega": 1.2})
    with pytest.raises(ValueError, match="the curve is over zeta, so unit = 'mesh Hz' has no meaning"):
        hb.design.response_band(over_damping, {"b": 0.1}, unit="mesh Hz")
    folds = hb.follow(curve, "LP1", "zeta", (0.05, 0.051))
    with pytest.raises(ValueError, match="a band needs a response curve"):
        hb.design.response_band(folds, {"b": 0.1})


def test_jumps_in_revolutions_per_minute(curve):
    """The natural frequency moves jumps in r/min only, in proportion; other parameters by the scale of the speed."""
    spread = {"reference[0]": 10.0, "zeta": 1e-4}
    bare, speed = (hb.design.jump_tolerance(curve, spread, draws=50, unit=unit)[0] for unit in ("Omega", None))
    scale = PAIR.scales.pinion_speed(1.0)
    assert speed.unit == "pinion r/min" and speed.value == pytest.approx(scale * bare.value, rel=1e-12)
    assert speed.effects["zeta"] == pytest.approx(scale * bare.effects["zeta"], rel=1e-9)
    assert abs(bare.effects["reference[0]"]) < 1e-9
    assert speed.effects["reference[0]"] == pytest.approx(speed.value * 10.0 / 38000.0, rel=1e-6)
    assert speed.sampled == pytest.approx(speed.first, rel=0.3)
    with pytest.raises(ValueError, match="unit = 'rpm' is unknown"):
        hb.design.jump_tolerance(curve, spread, unit="rpm")


def test_derivatives_are_shown_in_physical_units(curve):
    found = hb.analysis.sensitivity(curve["LP1"], ["zeta", "reference[0]"], measure="pp2")
    assert found.shown(dimensionless=True) == found.quantities
    assert found.shown() == ("pinion r/min", "mesh Hz", "pp2 m")
    axes = hb.plot.tornado(found)
    speed, size = f"{found.size('pinion r/min'):.6g} r/min", f"{1e6 * found.size('pp2 m'):.6g} \N{MICRO SIGN}m"
    assert axes.get_xlabel() == f"change of the speed of the pinion at LP1, {speed} [%]"
    assert hb.plot.tornado(found, "pp2 m").get_xlabel() == f"change of pp2 at LP1, {size} [%]"


def test_the_parameters_of_a_tornado_have_units():
    found = hb.analysis.sensitivity(
        hb.trace(hb.HarmonicBalance(hb.gears.DoubleHelicalPair(zeta=0.05), 5), "Omega", (1.0, 0.8), accuracy=None)[
            "LP1"
        ],
        ["k_mean", "zeta", "b_c"],
    )
    labels = {text.get_text() for text in hb.plot.tornado(found).get_yticklabels()}
    assert labels == {r"k_mean = $1.846 \times 10^{9}$ N/m", "zeta = 0.05", r"b_c = $2.5 \times 10^{-5}$ m"}


@pytest.mark.slow
def test_command(curve, tmp_path, run):
    curve.save("pair.npz")
    code, out, _ = run("scatter pair.npz zeta=0.001 e[0]=0.0005 --draws 20 --plot band.png")
    assert code == 0 and "LP1" in out and "the curve is displaced most at pinion r/min" in out
    assert "Omega" not in out
    assert (tmp_path / "band.png").stat().st_size > 10_000
    first = hb.design.jump_tolerance(curve, {"zeta": 0.001, "e[0]": 0.0005}, draws=20)[0].first
    assert f"{first:.3g}" in out
    code, out, _ = run("scatter pair.npz zeta=0.001 --draws 2 --dimensionless")
    assert code == 0 and "displaced most at Omega" in out and "r/min" not in out
    code, _, err = run("scatter pair.npz zetta=0.001")
    assert code == 2 and "did you mean 'zeta'" in err
    assert run("scatter pair.npz zeta")[0] == 2


def test_axes_end_above_the_bounded_part_of_a_curve_that_grows_without_bound():
    pair = hb.SpurPair(zeta=0.01, eps=(0.0, 0.2), e=(0.05,))
    branch = hb.trace(hb.HarmonicBalance(pair, 8), "Omega", (1.5, 0.3), accuracy=None)
    ax = hb.plot.band(hb.design.response_band(branch, {"zeta": 1e-4}))
    low, high = ax.get_ylim()
    assert branch["LP1"].amplitude("pp2") < high < 0.2 * branch.amplitude("pp2").max()
    assert -0.1 * high < low < branch.amplitude("pp2").min()


@hb.mechanics.model
def stopped(F: float = 0.3, gap: float = 0.5, c: float = 0.1) -> hb.System:
    """One mass and a hard stop."""
    return single_mass(hb.Unilateral(k=1e3, gap=gap), F=F, c=c, name="stop")


@pytest.mark.slow
def test_the_band_of_a_hard_stop_follows_its_similarity():
    """Load and gap times a factor change all amplitudes by it, also at grazing points and folds next to them."""
    curve = hb.trace(hb.ContactInstants(stopped(), 32), "Omega", (0.5, 2.2))
    band = hb.design.response_band(curve, {"F": 0.3, "gap": 0.5}, measure="rms")
    assert len(curve.special) == 14 and np.abs(band.effects).max() > 0.1
    expected = band.normal[:, 1] * band.amplitude / band.size[1]
    np.testing.assert_allclose(band.effects.sum(axis=1), expected, atol=1e-6)


@pytest.mark.slow
def test_the_band_of_a_hard_stop_without_and_with_contact():
    """Without contact the derivative by the damping has a closed form, with contact it is that of exact motions."""
    problem = hb.ContactInstants(stopped(), 32)
    curve = hb.trace(problem, "Omega", (1.5, 1.1), cover=False)
    band = hb.design.response_band(curve, {"c": 1.0}, measure="rms")
    free, h, w = curve.regime[:, 0] == 0, 1e-5, curve.values
    y = 0.3 / np.hypot(1 - w**2, 0.1 * w) / np.sqrt(2)
    slope = -y * 0.1 * w**2 / ((1 - w**2) ** 2 + (0.1 * w) ** 2)
    away = ~free & (np.min([np.abs(w - p.parameters["Omega"]) for p in curve.special], axis=0) > 1e-3)
    assert free.sum() > 5 and away.sum() > 5
    for i in np.flatnonzero(away):
        X = [curve.X[i] - problem.linearise(curve.X[i], "c", Omega=w[i], c=0.1 + d).R for d in (h, -h)]
        above, below = (np.linalg.norm(x[1:]) / np.sqrt(2) for x in X)  # without the mean
        slope[i] = (above - below) / (2 * h)
    expected = band.normal[:, 1] * slope / band.size[1]
    np.testing.assert_allclose(band.effects[free | away, 0], expected[free | away], atol=1e-5)
