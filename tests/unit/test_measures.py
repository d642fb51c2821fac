"""Registry of measures: every measure through save, load, figures, tables and peaks, and measures of the user."""

import csv

import matplotlib
import numpy as np
import pytest
from machines import single_mass

import hbgear as hb
from hbgear import plot
from hbgear.analysis import peaks
from hbgear.harmonic import register_measure
from hbgear.mechanics.series import measures
from hbgear.mechanics.series.measures import MEASURES

matplotlib.use("Agg")


def two_norm(X):
    """Square root of the sum of squares of the harmonics: sqrt(2) times the rms."""
    return np.sqrt((X[..., 1:] ** 2).sum(axis=-1))


def crest(X):
    """Largest magnitude over the rms value of the alternating part."""
    return measures.largest(X) / measures.rms(X)


@pytest.fixture(scope="module")
def curve():
    return hb.trace(hb.HarmonicBalance(hb.SpurPair(), 8), "Omega", (1.2, 0.6))


@pytest.fixture(autouse=True)
def registry(registries_are_restored):
    """The measures of hbgear and two of a user."""
    register_measure(two_norm, name="size", text="norm of the harmonics")
    register_measure(name="crest", text="crest factor", dimension=0, peaks=False, default=True)(crest)


NAMES = ["rms", "pp2", "max", "mean", "H1", "H3", "size", "crest"]


@pytest.mark.parametrize("name", NAMES)
def test_every_measure_after_save_and_load(curve, name, tmp_path):
    hb.save(curve, tmp_path / "curve.npz")
    loaded = hb.load(tmp_path / "curve.npz")
    A = curve.amplitude(name)
    assert A.shape == curve.values.shape and np.isfinite(A).all()
    np.testing.assert_array_equal(loaded.amplitude(name), A)
    np.testing.assert_allclose([curve[i].amplitude(name) for i in (0, len(curve) // 2, -1)], A[[0, len(A) // 2, -1]])


@pytest.mark.parametrize("name", NAMES)
def test_every_measure_on_a_figure(curve, name):
    axes = plot.response(curve, name, jumps=False, special=False)
    drawn = np.concatenate([np.asarray(line.get_ydata(), dtype=float) for line in axes.lines])
    assert np.isin(curve.amplitude(name), drawn).all()
    text = axes.get_ylabel()
    assert text.startswith(MEASURES[name].text if name in MEASURES else f"harmonic {name[1:]}")
    assert text.endswith("of $x$ [-]")
    matplotlib.pyplot.close("all")


@pytest.mark.parametrize("name", [name for name in NAMES if name != "crest"])
def test_peaks_of_every_measure(curve, name):
    found = peaks(curve, name, accuracy=None)
    A = curve.amplitude(name)
    assert len(found) == np.sum((A[1:-1] > A[:-2]) & (A[1:-1] > A[2:])) >= (name != "mean")
    for peak in found:
        assert peak.located and peak.note == f"peak of {name}"
        for shift in (-1e-3, 1e-3):  # the measure is smaller on both sides
            problem, Omega = curve.problem, peak.parameters["Omega"] + shift
            near = hb.trace(problem, "Omega", (Omega, Omega + 1e-6), start=peak.X, cover=False, special=False)
            assert near[0].amplitude(name) < peak.amplitude(name)


def test_peaks_of_a_registered_measure_agree_with_those_of_the_rms(curve):
    for one, other in zip(peaks(curve, "size", accuracy=None), peaks(curve, "rms", accuracy=None), strict=True):
        assert one.parameters["Omega"] == pytest.approx(other.parameters["Omega"], abs=1e-8)
    top = peaks(curve, "size", share=0.99)[0]
    followed = hb.follow(curve, top, "zeta", (0.05, 0.06), steps=hb.StepControl(max_points=3))
    assert followed.tracked["Omega"][0] == pytest.approx(top.parameters["Omega"], abs=1e-7)


def test_measures_that_are_refused_by_name(curve):
    with pytest.raises(ValueError, match=r"peaks of 'crest' cannot be located, .*peaks=False; use rms, .*size or H1"):
        peaks(curve, "crest")
    with pytest.raises(ValueError, match="no measure 'loud'; there are rms"):
        peaks(curve, "loud")
    with pytest.raises(ValueError, match="the measure 'crest' is not a displacement; use rms"):
        hb.design.Measurements([1.0], [1.0], measure="crest")
    with pytest.raises(KeyError, match=r"no .*'loud'; choose one of 'Omega'.*; measures are rms, .*crest, H1, H2"):
        plot.response(curve, "loud")
    with pytest.raises(KeyError, match=r"no .*'pp'"):  # the length of a name decides nothing
        plot.response(curve, "pp")


def test_a_sweep_has_the_measures_that_it_records():
    sweep = hb.time.sweep(hb.Duffing(), [0.5, 0.52])
    assert sweep.amplitude("pp2").shape == (2,) and sweep.amplitude("H1").shape == (2,)
    with pytest.raises(ValueError, match="a sweep has no measure 'crest'"):
        sweep.amplitude("crest")


def test_tables_contain_the_default_measures(curve, tmp_path):
    curve.export(tmp_path / "curve.csv")
    with open(tmp_path / "curve.csv", encoding="utf-8") as file:
        header = next(row for row in csv.reader(file) if row and not row[0].startswith("#"))
    keys = {name.split("_")[0] for name in header}
    assert {"rms", "pp2", "max", "mean", "crest"} <= keys and "size" not in keys
    data = hb.io.to_xarray(curve)
    assert list(data.measure.values) == ["rms", "pp2", "max", "mean"]  # one unit; the crest factor has another
    np.testing.assert_array_equal(data["crest"].values[:, 0], curve.amplitude("crest"))
    assert data["crest"].attrs["units"] == "1"


def test_units():
    assert MEASURES["rms"].unit_for("um") == "um" and MEASURES["crest"].unit_for("um") == "-"
    assert measures.Measure("power", two_norm, "power", dimension=2).unit_for("um") == "um^2"
    assert measures.Measure("level", two_norm, "level", unit="dB").unit_for("um") == "dB"
    assert measures.axis_text("crest", "$d$ [um], gap L") == "crest factor of $d$, gap L [-]"
    assert measures.axis_text("crest", measures.motion_text({}, ("stop",), 0)) == "crest factor of $d$, stop [-]"
    assert measures.axis_text("H2", "$d$ [um]") == "harmonic 2 of $d$ [um]"


def test_registration():
    with pytest.raises(ValueError, match=r"the name 'rms' belongs to .*measures\.rms; give another one"):
        register_measure(two_norm, name="rms")
    with pytest.raises(ValueError, match=r"the name 'size' belongs to .*two_norm"):
        register_measure(crest, name="size")
    for name in ("H1", "two words", "1st", "H1/2"):
        with pytest.raises(ValueError, match="must be letters, digits and _, and not H1"):
            register_measure(two_norm, name=name)
    with pytest.raises(TypeError, match="needs a function of coefficients"):
        register_measure(3.0)
    with pytest.raises(ValueError, match=r"'flat' must return one finite value .*got shape \(\)"):
        register_measure(lambda X: X.max(), name="flat")
    with pytest.raises(ValueError, match=r"'bad' fails for coefficients of shape .*index them as X"):
        register_measure(lambda X: X[..., 99], name="bad")
    register_measure(two_norm, name="size", text="again")  # a definition that is repeated replaces the first
    assert MEASURES["size"].text == "again"


def test_degrees_of_freedom_of_points_with_more_harmonics():
    """A special point that is located with more harmonics than its curve: one mass moves like its element."""
    mass = single_mass(hb.Unilateral(k=20.0, gap=0.5), F=0.2, c=0.05, name="stop")
    curve = hb.trace(hb.HarmonicBalance(mass, 8), "Omega", (0.85, 1.3))
    refined = [point for point in curve.special if len(point.X) > curve.X.shape[1]]
    assert refined
    for point in refined:
        for derivative in (0, 2):
            mass_rms = point.amplitude("rms", dof=0, derivative=derivative)
            assert mass_rms == pytest.approx(point.amplitude("rms", derivative=derivative), rel=1e-9)
