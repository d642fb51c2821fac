"""Data for other programs: frames, data sets, tables that explain themselves, and files that need nothing else."""

import csv
import json
import math

import numpy as np
import pytest
from scipy.io import loadmat

import hbgear as hb
from hbgear.common import optional
from hbgear.common.text.symbols import in_html, in_text, unit_of, without_unit
from hbgear.io.branches.tables import EXPLAINED


@pytest.fixture(scope="module")
def pair():
    model = hb.SpurPair(zeta=0.04, reference=(38000.0, 37.6e-6, 15000.0, 25))
    return hb.trace(hb.HarmonicBalance(model, 6), "Omega", (1.5, 0.3))


@pytest.fixture(scope="module")
def wild():
    return hb.trace(hb.HarmonicBalance(hb.SpurPair(zeta=0.01, eps=(0, 0.2)), 8), "Omega", (1.5, 0.3))


def test_dataframe_has_the_columns_of_the_csv(pair, tmp_path):
    pd = pytest.importorskip("pandas")
    frame = pair.to_dataframe()
    pair.export(tmp_path / "pair.csv")
    # Text to float by Python: parsers of older versions of pandas lose up to four digits.
    read = pd.read_csv(tmp_path / "pair.csv", comment="#", dtype=str, keep_default_na=False)
    assert list(read) == list(frame) and len(frame) == len(pair)
    for name in ("Omega", "pp2_gap", "mesh_Hz", "a3_gap", "stable"):
        np.testing.assert_allclose(frame[name].to_numpy(float), read[name].to_numpy(float), rtol=1e-13)
    assert frame["special"][pair["LP1"].index] == "LP1" and frame["special"].to_list().count("") < len(frame)
    assert frame.attrs["units"]["pinion_rpm"] == "r/min" and "zeta=0.04" in frame.attrs["model"]
    assert frame.attrs["long_names"]["pp2_gap"] == "half peak-to-peak of x"


def test_speeds_are_those_of_the_model(pair):
    pytest.importorskip("pandas")
    frame, scales = pair.to_dataframe(), pair.problem.model.scales
    # n = 60 Omega omega_n / (2 pi z), with omega_n = 38000 rad/s and 25 teeth
    np.testing.assert_allclose(frame["pinion_rpm"], 60 * 38000.0 * pair.values / (2 * math.pi * 25), rtol=1e-14)
    np.testing.assert_allclose(frame["mesh_Hz"], scales.mesh_frequency(pair.values), rtol=1e-14)


def test_dataframe_of_several_curves(wild):
    pytest.importorskip("pandas")
    frame = wild.to_dataframe()
    assert len(frame) == sum(map(len, wild.curves)) and set(frame["curve"]) == {1, 2}


def test_xarray_has_named_dimensions_and_survives_netcdf(pair, tmp_path):
    xr = pytest.importorskip("xarray")
    data = pair.to_xarray()
    assert data.amplitude.dims == ("point", "element", "measure")
    np.testing.assert_array_equal(data.amplitude.sel(measure="pp2", element="gap"), pair.amplitude("pp2"))
    np.testing.assert_array_equal(data.coefficients.sel(element="gap", term="b2"), pair.X[:, 4])
    assert data.pinion_rpm.attrs == {"long_name": "speed of the pinion", "units": "r/min"}
    assert data.zeta.attrs["long_name"] == "damping ratio ζ" and float(data.zeta) == 0.04
    data.to_netcdf(tmp_path / "pair.nc", engine="scipy")
    with xr.open_dataset(tmp_path / "pair.nc", engine="scipy") as again:
        np.testing.assert_array_equal(again.Omega, pair.values)
        np.testing.assert_array_equal(again.multipliers_real + 1j * again.multipliers_imag, pair.multipliers)
        assert again.attrs["model"] == data.attrs["model"] and again.Omega.attrs["units"] == "1"


def test_xarray_of_any_equations():
    pytest.importorskip("xarray")

    class Ellipse:
        def evaluate(self, X, p):
            return np.array([X[0] ** 2 + p**2 - 1]), np.array([[2 * X[0]]])

    curve = hb.trace(Ellipse(), "p", (0, 2), np.array([1.0]))
    data = curve.to_xarray()
    assert data.X.dims == ("point", "unknown") and "p" in data.coords
    assert next(iter(curve.to_dataframe())) == "p"


def test_csv_has_a_header(pair, tmp_path):
    pair.export(tmp_path / "pair.csv")
    lines = (tmp_path / "pair.csv").read_text(encoding="utf-8").splitlines()
    head = [line for line in lines if line.startswith("# ")]
    assert lines[: len(head)] == head  # before the table, nowhere else
    assert "# zeta = 0.04 [-] (damping ratio ζ)" in head and any(
        line.startswith("# model = SpurPair(") for line in head
    )
    assert "# column pinion_rpm: speed of the pinion [r/min]" in head
    rows = list(csv.DictReader(lines[len(head) :]))
    assert float(rows[0]["pinion_rpm"]) == pytest.approx(pair.problem.model.scales.pinion_speed(1.5), rel=1e-14)


def test_mat_explains_its_names(pair, tmp_path):
    pair.export(tmp_path / "pair.mat")
    found = loadmat(tmp_path / "pair.mat", simplify_cells=True)
    names = {name for name in found if not name.startswith("_")} - {"explained"}
    assert set(found["explained"]) == names <= set(EXPLAINED) | {"about"}
    speeds = pair.problem.model.scales.pinion_speed(pair.values)
    np.testing.assert_allclose(found["pinion_rpm"], speeds, rtol=1e-14)


def test_degrees_of_freedom_need_nothing_but_the_file(tmp_path):
    curve = hb.trace(hb.HarmonicBalance(hb.gears.DoubleHelicalPair(), 3), "Omega", (1.6, 1.5))
    curve.save(tmp_path / "pair.npz")
    again = hb.load(tmp_path / "pair.npz")
    for derivative in (0, 2):
        expected = curve.amplitude("rms", dof="x_pL", derivative=derivative)
        np.testing.assert_array_equal(again.amplitude("rms", dof="x_pL", derivative=derivative), expected)
    with pytest.raises(KeyError, match="no degree of freedom 'x_pl'; did you mean"):
        again.amplitude(dof="x_pl")


@hb.mechanics.model
def own() -> hb.System:
    M, C, K = np.eye(2), 0.05 * np.eye(2), [[2, -1], [-1, 2]]
    stop = hb.Element([1, 0], hb.Unilateral(k=1.0, gap=1.0), name="stop")
    return hb.System(M, C, K, [stop], hb.Load(cosine={1: [0, 0.2]}), dof_names=["x", "y"])


def test_degrees_of_freedom_of_own_models_need_nothing_but_the_file(tmp_path):
    curve = hb.trace(hb.HarmonicBalance(own(), 6), "Omega", (0.5, 1.5))
    curve.save(tmp_path / "own.npz")
    again = hb.load(tmp_path / "own.npz")
    for dof in ("x", "y", 1):
        for derivative in (0, 2):
            expected = curve.amplitude("pp2", dof=dof, derivative=derivative)
            np.testing.assert_array_equal(again.amplitude("pp2", dof=dof, derivative=derivative), expected)
    again.save(tmp_path / "again.npz")  # and once more, still without the model
    np.testing.assert_array_equal(hb.load(tmp_path / "again.npz").amplitude(dof="y"), curve.amplitude(dof="y"))
    with pytest.raises(KeyError, match="no degree of freedom 'z'"):
        again.amplitude(dof="z")


def test_files_of_models_of_hbgear_have_no_motions(pair, tmp_path):
    pair.save(tmp_path / "pair.npz")
    with np.load(tmp_path / "pair.npz") as archive:
        assert not [name for name in archive.files if name.startswith("motions")]


@pytest.mark.parametrize(
    "change",
    [
        None,
        1,
        [],
        [1],
        [{"names": ["x"], "rows": {"__array__": "motions.0"}}],
        [{"names": ["x", 2], "rows": {"__array__": "motions.0"}}],
        [{"names": ["x", "y"], "rows": {"__array__": "values"}}],
    ],
)
def test_motions_that_do_not_fit_are_refused(change, tmp_path):
    hb.trace(hb.HarmonicBalance(own(), 3), "Omega", (0.5, 0.7)).save(tmp_path / "own.npz")
    with np.load(tmp_path / "own.npz") as archive:
        arrays = dict(archive)
    header = json.loads(str(arrays["header"]))
    arrays["header"] = np.array(json.dumps(header | {"motions": change}))
    np.savez(tmp_path / "damaged.npz", **arrays)
    if change is None:
        with pytest.raises(ValueError, match="needs the problem"):
            hb.load(tmp_path / "damaged.npz").amplitude(dof="x")
    else:
        with pytest.raises(ValueError, match="motions"):
            hb.load(tmp_path / "damaged.npz")


def test_missing_packages_are_named(pair, monkeypatch):
    def missing(name):
        raise ImportError(name)

    monkeypatch.setattr(optional.importlib, "import_module", missing)
    for call in (pair.to_dataframe, pair.to_xarray):
        with pytest.raises(ValueError, match=r"which is not installed; pip install 'hbgear\[data\]'"):
            call()


@pytest.mark.parametrize(
    "model", [hb.Duffing, hb.SpurPair, hb.gears.GearRotorBearing, hb.gears.HelicalPair, hb.gears.DoubleHelicalPair]
)
def test_labels_of_models_are_read(model):
    for label in model.labels.values():
        for text in (in_text(label), without_unit(label), in_html(label)):
            assert not set(text) & set("\\${}"), label
    assert in_text(model.labels["Omega"]).startswith("Ω = ω") and unit_of(model.labels["Omega"]) == "1"


def test_labels_in_html():
    assert in_html(r"$d / b_c$ [-]") == "d / b<sub>c</sub> [-]"
    assert in_html("x_one <b> & $a^{10}$") == "x_one &lt;b&gt; &amp; a<sup>10</sup>"
    assert in_text(r"$\lambda_\mathrm{max}$") == "λ_max"
