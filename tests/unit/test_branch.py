"""Branch: measures against closed forms, exact round trips of files, and error messages with advice."""

import csv
import dataclasses
import json
import os
import zipfile

import numpy as np
import pytest
from scipy.io import loadmat

import hbgear as hb
from hbgear.analysis.summary import reliability_lines
from hbgear.continuation.results.branch import Branch
from hbgear.continuation.results.point import Jump, Point, SpecialPoint
from hbgear.continuation.results.status import Status
from hbgear.harmonic.equations.layout import Layout
from hbgear.io.branches import npz
from hbgear.io.branches.npz import load
from hbgear.mechanics.series import measures
from hbgear.mechanics.series.fourier import evaluate, extrema
from hbgear.time.integration import state_of

NAN = float("nan")


def make(nu=1, H=3, **changes):
    """Return a branch of eight random points with two elements, special points, jumps and missing values."""
    rng = np.random.default_rng(7)
    P, n = 8, 2 * (2 * H + 1)
    layout = Layout(H, nu, ("left", "right mesh"), ((-1.0, 1.0), ()), {"Omega": "Ω", "amplitude": r"$d / b_c$"})
    X = rng.normal(size=(P, n)) * np.pi
    mu = changes.get("multipliers", rng.normal(size=(P, 3)) + 1j * rng.normal(size=(P, 3)))
    error = rng.uniform(size=P)
    error[2] = NAN

    def fields(i, label=""):
        parameters = {"zeta": 0.1 + 0.2, "F_m": 0.1 * i, "Omega": 1 / 3 + i}
        row = None if mu is None else mu[i]
        return X[i].copy(), parameters, 1e-13 / 3, 4, row, np.array([1, 0], np.int8), NAN, layout, label

    special = (
        SpecialPoint(*fields(3, "LP1"), kind="LP", index=3, interval=(1.0, 1.1), note="a fold"),
        SpecialPoint(*fields(5, "GR1"), kind="GR", index=5, located=False),
    )
    point = Point(X[6], {"Omega": 2.0}, 0.0, 0, None, np.array([0, 0], np.int8), 0.5, None)
    jumps = (Jump("LP1", "Omega", 1 / 3, -1, special[0], point), Jump("GR1", "Omega", 0.7, 1, special[1], None))
    defaults = {
        "parameter": "Omega",
        "values": np.linspace(1.5, 0.9, P) / 3,
        "X": X,
        "fixed": {"zeta": 0.3},
        "tracked": {"F_m": rng.normal(size=P)},
        "multipliers": mu,
        "iterations": np.arange(P),
        "residual": 10.0 ** -rng.uniform(9, 14, P),
        "regime": np.tile(np.array([[1, 0]], np.int8), (P, 1)),
        "error": error,
        "step": np.zeros(P),
        "special": special,
        "jump_records": jumps,
        "status": Status.MAX_POINTS,
        "message": "größer",
        "layout": layout,
        "meta": {"hbgear": "0.1", "model": {"class": "SpurPair", "parameters": {"eps": [0.1, 0.2], "e": ()}}, "H": 3},
    }
    return Branch(**{**defaults, **changes})


def same(one, two):
    """Return whether two objects are equal to the last bit and type of every field; nan equals nan."""
    if isinstance(one, np.ndarray):
        return one.dtype == two.dtype and one.shape == two.shape and one.tobytes() == two.tobytes()
    if type(one) is not type(two):
        return False
    if hasattr(one, "__dataclass_fields__"):
        return all(same(getattr(one, name), getattr(two, name)) for name in one.__dataclass_fields__)
    if isinstance(one, dict):
        return list(one) == list(two) and all(same(one[name], two[name]) for name in one)
    if isinstance(one, list | tuple):
        return len(one) == len(two) and all(same(a, b) for a, b in zip(one, two, strict=True))
    return one == two or (one != one and two != two)


# ---- measures


def dense(X, count=2_000_001):
    return evaluate(X, np.linspace(0, 2 * np.pi, count))


def test_rms_mean_and_harmonics_in_closed_form():
    X = np.array([[0.7, 3.0, 4.0, 0.0, -12.0], [-2.0, 0.0, 0.0, 5.0, 0.0]])
    assert np.allclose(measures.measure("rms", X), [13 / np.sqrt(2), 5 / np.sqrt(2)], rtol=1e-15, atol=0)
    assert np.array_equal(measures.measure("mean", X), [0.7, -2.0])
    assert np.array_equal(measures.measure("H1", X), [5.0, 0.0])
    assert np.array_equal(measures.measure("H2", X), [12.0, 5.0])


def test_subharmonic_names_count_harmonics_of_the_excitation():
    X = np.zeros((1, 9))
    X[0, 1::2] = [1.0, 2.0, 3.0, 4.0]
    found = {name: measures.measure(name, X, nu=2)[0] for name in ("H1/2", "H1", "H3/2", "H2", "H2/2")}
    assert found == {"H1/2": 1.0, "H1": 2.0, "H3/2": 3.0, "H2": 4.0, "H2/2": 2.0}
    with pytest.raises(ValueError, match=r"there are rms, pp2, max, mean, H1/2, H1, H3/2, H2"):
        measures.measure("H5/2", X, nu=2)


def test_extrema_of_two_harmonics_in_closed_form():
    # cos t + a cos 2t has, for a > 1/4, its maximum 1 + a at 0 and its minimum -a - 1/(8a) at cos t = -1/(4a)
    a = np.array([0.3, 0.5, 2.0, 7.0])
    X = np.zeros((4, 5))
    X[:, 1], X[:, 3] = 1.0, a
    assert np.allclose(measures.measure("pp2", X), (1 + a + a + 1 / (8 * a)) / 2, rtol=1e-15, atol=1e-15)
    X[:, 0] = -3.0
    expected = np.maximum(np.abs(a - 2), 3 + a + 1 / (8 * a))
    assert np.allclose(measures.measure("max", X), expected, rtol=1e-15, atol=1e-15)


@pytest.mark.slow
def test_pp2_and_max_agree_with_a_dense_grid():
    rng = np.random.default_rng(3)
    for _ in range(6):
        X = np.zeros(2 * 5 + 1)
        X[[0, 1, 2, 9, 10]] = rng.normal(size=5)  # harmonics 1 and 5, any phases
        x = dense(X)
        assert abs(measures.measure("pp2", X) - np.ptp(x) / 2) < 1e-10
        assert abs(measures.measure("max", X) - np.max(np.abs(x))) < 1e-10


def test_extrema_choose_the_right_one_of_nearly_equal_peaks():
    # three peaks whose difference a coarse grid does not resolve
    rng = np.random.default_rng(5)
    for _ in range(40):
        X = np.zeros(7)
        X[5:] = rng.normal(size=2)
        X[1:3] = 1e-3 * rng.normal(size=2)
        low, at_low, high, at_high = extrema(X)
        x = dense(X, 200_001)
        curvature = 9 * np.hypot(*X[5:]) * (2 * np.pi / 200_000) ** 2
        assert -1e-14 < high - x.max() < curvature and -1e-14 < x.min() - low < curvature
        assert abs(evaluate(X, [at_high])[0] - high) < 1e-14 and abs(evaluate(X, [at_low])[0] - low) < 1e-14


def test_extrema_of_flat_peaks_constants_arrays_and_nan():
    flat = np.array([0.0, 1.0, 0.0, -0.25, 0.0])  # fourth-order maximum 3/4 at 0
    shifted = np.array([0.0, np.cos(0.03), np.sin(0.03), -0.25 * np.cos(0.06), -0.25 * np.sin(0.06)])
    for row in (flat, shifted):
        assert abs(extrema(row)[2] - 0.75) < 1e-13 and abs(extrema(row)[0] + 1.25) < 1e-14
    X = np.full((3, 2, 5), 2.0) * np.eye(5)[0]
    X[1, 1] = NAN
    low, _, high, _ = extrema(X)
    assert low.shape == (3, 2) and np.isnan(high[1, 1]) and np.nansum(high) == np.nansum(low) == 10.0


def test_unknown_measures_list_the_known_ones():
    b = make()
    with pytest.raises(ValueError, match="no measure 'peak'; there are rms, pp2, max, mean, H1, H2, H3"):
        b.amplitude("peak")
    with pytest.raises(ValueError, match="no harmonic 'H4' among H = 3"):
        b.amplitude("H4")
    with pytest.raises(ValueError, match="no harmonic 'H0'"):
        b.amplitude("H0")
    with pytest.raises(ValueError, match="H1/0"):
        b.amplitude("H1/0")
    for wrong in ("rihgt", 2, -1):
        with pytest.raises(KeyError, match="'left', 'right mesh'"):
            b.amplitude("rms", wrong)


# ---- branch and points


def test_elements_by_name_and_number():
    b = make()
    right = np.sqrt(0.5 * np.sum(b.X[:, 8:] ** 2, axis=1))
    assert np.allclose(b.amplitude("rms", 1), right, rtol=1e-15, atol=0)
    assert np.array_equal(b.amplitude("rms", "right mesh"), b.amplitude("rms", 1))
    assert np.array_equal(b[2].coefficients("right mesh"), b.X[2, 7:])
    assert b[2].amplitude("pp2", 1) == pytest.approx(b.amplitude("pp2", 1)[2], rel=1e-15)


def test_rows_and_labels():
    b = make()
    assert b[3].parameters == {"zeta": 0.3, "F_m": b.tracked["F_m"][3], "Omega": b.values[3]} == b.parameters_at(3)
    assert b[-1].iterations == 7 and b[np.int64(7)].residual == b.residual[7]
    assert b["LP1"] is b.special[0] and b.jumps() is b.jump_records
    assert len(list(b)) == len(b) == 8
    with pytest.raises(KeyError, match="no special point 'LP2' on this branch; it has: LP1, GR1"):
        b["LP2"]
    with pytest.raises(IndexError, match="no point 8; the branch has 8 points"):
        b[8]
    with pytest.raises(TypeError, match="label"):
        b[1.5]
    assert "LP1 GR1" in repr(b) and repr(b["LP1"]).startswith("<LP1 at Omega = 3.33333")


def test_peak_is_the_highest_point():
    b = make()
    assert np.array_equal(b.peak("pp2", 1).X, b.X[np.argmax(b.amplitude("pp2", 1))])


def test_samples_and_their_derivative():
    b = make()
    theta, x = b[0].samples("right mesh", 64)
    a = b.X[0, 7:]
    k = np.arange(1, 4)
    expected = a[0] + a[1::2] @ np.cos(np.outer(k, theta)) + a[2::2] @ np.sin(np.outer(k, theta))
    assert np.allclose(x, expected, rtol=0, atol=1e-13)
    slope = (-k * a[1::2]) @ np.sin(np.outer(k, theta)) + (k * a[2::2]) @ np.cos(np.outer(k, theta))
    assert np.allclose(b[0].samples(1, 64, order=1)[1], slope, rtol=0, atol=1e-13)


def test_stability_is_the_unit_circle_and_may_be_unknown():
    largest = np.array([1.0, 1 + 1e-9, 1 + 1e-4, NAN, -1.1, 0.6 + 0.9j, 0.6 + 0.79j, 0])
    mu = np.column_stack([np.full(8, 0.5j), largest])
    b = make(multipliers=None)
    assert b.stable is None and b[0].stable is None
    b = make(multipliers=mu)
    assert b.stable.tolist() == [True, True, False, False, False, False, True, True]
    assert [p.stable for p in b] == [True, True, False, None, False, False, True, True]


def test_deprecated_names_return_the_attributes_that_replace_them():
    b = make(problem=object())
    for owner, old, new in (
        (b, "doubts", b.warnings),
        (b, "verdicts", b.stability),
        (b, "recorded", b.full_motion),
        (b, "known_problem", b.require_problem()),
        (b[0], "verdict", b[0].stability),
        (b["LP1"], "verdict", b["LP1"].stability),
        (b.jumps()[0], "decided", "nearest"),
    ):
        with pytest.warns(DeprecationWarning, match=rf"\.{old} is deprecated: use "):
            assert getattr(owner, old) == new
    with pytest.raises(ValueError, match=r"needs the problem of the branch.*hbgear\.load\(path, problem="):
        make().require_problem()


def test_regimes_are_those_of_the_worst_element():
    codes = np.array([[0, 0], [1, 0], [0, 2], [-1, -1], [-1, 0], [0, 5], [2, 1], [0, 1]])
    b = make(regime=codes)
    assert b.regimes == [
        "no_impact",
        "single_sided",
        "double_sided",
        "unknown",
        "no_impact",
        "gross_slip",
        "double_sided",
        "single_sided",
    ]
    assert b[2].regime_name == "double_sided"


def test_degrees_of_freedom_come_from_the_problem():
    class Problem:
        dof_names = ("x", "y")

        def motion(self, X, **parameters):
            return np.stack([X[:7], parameters["Omega"] * X[7:]])

    b = make(problem=Problem(), nu=2)
    assert np.allclose(b.amplitude("rms", dof="y"), b.values * b.amplitude("rms", 1), rtol=1e-14)
    assert np.array_equal(b.amplitude("pp2", dof=0), b.amplitude("pp2", 0))
    # harmonic 1/2 of the acceleration is (Omega / 2)^2 times that of the displacement, harmonic 1 Omega^2 times
    for name, factor in (("H1/2", 0.5), ("H1", 1.0), ("H3/2", 1.5)):
        expected = (factor * b.values) ** 2 * b.amplitude(name, 0)
        assert np.allclose(b.amplitude(name, dof="x", derivative=2), expected, rtol=1e-14)
        assert np.allclose(b.amplitude(name, derivative=1), factor * b.values * b.amplitude(name), rtol=1e-14)
    assert np.all(b.amplitude("mean", dof="x", derivative=1) == 0)
    assert b[2].amplitude("H1", dof="y", derivative=1) == b.amplitude("H1", dof="y", derivative=1)[2]
    assert b[2].amplitude("H1/2", 1, derivative=2) == b.amplitude("H1/2", 1, derivative=2)[2]
    with pytest.raises(KeyError, match="no degree of freedom 'z'; it has: x, y"):
        b.amplitude(dof="z")
    with pytest.raises(KeyError, match="no degree of freedom 'z'; it has: x, y"):
        b[2].amplitude(dof="z")
    with pytest.raises(ValueError, match="needs the problem of the point"):
        make()[2].amplitude(dof="x")
    with pytest.raises(KeyError, match="there are 2"):
        b.amplitude(dof=2)
    with pytest.raises(ValueError, match="problem="):
        make().amplitude(dof="x")
    with pytest.raises(ValueError, match="needs Omega"):
        make(parameter="zeta", fixed={}).amplitude(derivative=1)


def test_a_branch_without_layout_has_no_amplitudes():
    with pytest.raises(ValueError, match="layout is None"):
        make(layout=None).amplitude()
    with pytest.raises(ValueError, match="layout is None"):
        make(layout=None)[0].amplitude()


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("X", np.zeros((7, 14))),
        ("X", np.zeros((8, 13))),
        ("residual", np.zeros(3)),
        ("regime", np.zeros(8)),
        ("multipliers", np.zeros((9, 2))),
        ("tracked", {"F": np.zeros(2)}),
    ],
)
def test_wrong_shapes_are_refused(name, value):
    with pytest.raises(ValueError, match=r"Branch: (.*points|points of 13)"):
        make(**{name: value})


def test_labels_must_be_unique():
    special = make().special
    with pytest.raises(ValueError, match="unique"):
        make(special=(*special, special[0]))


def test_every_status_has_advice():
    assert all(status.advice for status in Status)
    assert {s for s in Status if s.complete} == set(Status) - {
        Status.RETRACED,
        Status.MAX_POINTS,
        Status.STEP_TOO_SMALL,
        Status.INTERRUPTED,
        Status.FAILED,
    }


# ---- files


@pytest.mark.parametrize("changes", [{}, {"multipliers": None}, {"layout": None}, {"special": (), "jump_records": ()}])
def test_round_trip_is_exact(tmp_path, changes):
    b = make(**changes)
    b.save(tmp_path / "b.npz")
    problem = object()
    loaded = load(tmp_path / "b.npz", problem=problem)
    assert loaded.problem is problem
    assert same(b, load(tmp_path / "b.npz"))
    assert not same(b, make(**{**changes, "message": "other"}))  # the comparison detects differences


def test_round_trip_keeps_special_values(tmp_path):
    b = make(multipliers=None)
    b.save(tmp_path / "b.npz")
    c = load(str(tmp_path / "b.npz"))
    assert c.multipliers is None and c.jumps()[1].after is None and c.jumps()[0].after.layout is None
    assert np.isnan(c.error[2]) and np.isnan(c["LP1"].error) and np.isnan(c["GR1"].interval).all()
    assert c["LP1"].parameters["zeta"] == 0.1 + 0.2 and type(c["LP1"]) is SpecialPoint
    assert c.status is Status.MAX_POINTS and c.layout.breakpoints == ((-1.0, 1.0), ())


def test_numpy_scalars_are_saved_as_numbers(tmp_path):
    make(meta={"H": np.int64(3), "tol": np.float64(1e-9), "on": np.bool_(True)}).save(tmp_path / "b.npz")
    assert load(tmp_path / "b.npz").meta == {"H": 3, "tol": 1e-9, "on": True}


def test_file_has_a_json_header_and_no_pickle(tmp_path):
    make().save(tmp_path / "b.npz")
    with np.load(tmp_path / "b.npz", allow_pickle=False) as archive:
        header = json.loads(str(archive["header"]))
        arrays = {name: archive[name] for name in archive.files}
    assert header["schema"] == npz.SCHEMA and header["branch"]["parameter"] == "Omega"
    assert all(array.dtype != object for array in arrays.values()) and arrays["X"].shape == (8, 14)


def test_missing_foreign_and_damaged_files(tmp_path):
    good, bad = tmp_path / "good.npz", tmp_path / "bad.npz"
    make().save(good)
    whole = good.read_bytes()
    with pytest.raises(FileNotFoundError, match=r"there is no file .*none\.npz"):
        load(tmp_path / "none.npz")
    with pytest.raises(FileNotFoundError, match="there is no file '111"):
        load("1" * 400)  # exceeds the length limit of file names
    for content in (b"", b"Omega,rms\n1,2\n", b"\x93NUMPY", whole[: len(whole) // 2], whole[:100], whole[200:-300]):
        bad.write_bytes(content)
        with pytest.raises(ValueError, match=r"bad\.npz' cannot be read as a branch .*need an \.npz written by"):
            load(bad)
    np.save(tmp_path / "array.npy", np.zeros(3))
    bad.write_bytes((tmp_path / "array.npy").read_bytes())
    with pytest.raises(ValueError, match="cannot be read as a branch"):
        load(bad)
    with pytest.raises(ValueError, match="cannot be read as a branch"):
        load(tmp_path)


@pytest.mark.parametrize(
    "arrays",
    [
        {"X": np.zeros(3)},
        {"header": np.zeros(3)},
        {"header": np.array("{}")},
        {"header": np.array("[1]")},
        {"header": np.array('{"format": "other", "schema": 1}')},
        {"header": np.array('{"format": "hbgear branch", "schema": 1, "branch": {"__class__": "Branch"}}')},
        {"header": np.array('{"format": "hbgear branch", "schema": 1, "branch": {"__class__": "os"}}')},
    ],
)
def test_foreign_npz(tmp_path, arrays):
    np.savez(tmp_path / "b.npz", **arrays)
    with pytest.raises(ValueError, match=r"cannot be read as a branch .*need an \.npz written by"):
        load(tmp_path / "b.npz")


def test_a_flipped_byte_never_goes_unnoticed(tmp_path):
    path = tmp_path / "b.npz"
    make().save(path)
    whole = path.read_bytes()
    with zipfile.ZipFile(path) as archive:
        offset = archive.getinfo("X.npy").header_offset + 400
    path.write_bytes(whole[:offset] + bytes([whole[offset] ^ 1]) + whole[offset + 1 :])
    with pytest.raises(ValueError, match="cannot be read as a branch"):
        load(path)


def test_pickles_are_not_opened(tmp_path):
    np.savez(tmp_path / "b.npz", header=np.array([print], dtype=object))
    with pytest.raises(ValueError, match="cannot be read as a branch"):
        load(tmp_path / "b.npz")


def test_newer_schema_requires_an_upgrade(tmp_path, monkeypatch):
    monkeypatch.setattr(npz, "SCHEMA", npz.SCHEMA + 1)
    make().save(tmp_path / "b.npz")
    monkeypatch.undo()
    with pytest.raises(ValueError, match=f"has schema {npz.SCHEMA + 1}, this hbgear reads up to {npz.SCHEMA}; upgrade"):
        load(tmp_path / "b.npz")


class Full(OSError):
    """The disk is full."""


@pytest.mark.parametrize(
    ("name", "target"), [("b.npz", "numpy.savez"), ("b.mat", "scipy.io.savemat"), ("b.csv", "csv.writer")]
)
def test_a_failing_write_leaves_the_old_file_and_nothing_else(tmp_path, monkeypatch, name, target):
    path = tmp_path / name
    write = make().save if name == "b.npz" else make().export
    write(path)
    before = path.read_bytes()

    def fail(handle, *_, **__):
        handle.write("half" if name == "b.csv" else b"half")
        handle.flush()
        raise Full

    monkeypatch.setattr(target, fail)
    with pytest.raises(Full):
        write(path)
    assert path.read_bytes() == before and os.listdir(tmp_path) == [name]
    path.unlink()
    with pytest.raises(Full):
        write(path)
    assert os.listdir(tmp_path) == []


def test_a_failing_rename_leaves_nothing_behind(tmp_path):
    (tmp_path / "b.npz").mkdir()
    with pytest.raises(OSError):
        make().save(tmp_path / "b.npz")
    assert os.listdir(tmp_path) == ["b.npz"]


def test_meta_that_is_no_json_is_refused_before_writing(tmp_path):
    with pytest.raises(TypeError, match="not JSON serializable"):
        make(meta={"model": object()}).save(tmp_path / "b.npz")
    with pytest.raises(TypeError, match="not JSON serializable"):
        make(meta={"status": {Status}}).save(tmp_path / "b.npz")
    assert not list(tmp_path.iterdir())


def test_wrong_suffix_and_missing_folder(tmp_path):
    with pytest.raises(ValueError, match=r"must end in \.npz; use export"):
        make().save(tmp_path / "b.mat")
    with pytest.raises(ValueError, match=r"must end in \.csv or \.mat; use save"):
        make().export(tmp_path / "b.npz")
    with pytest.raises(FileNotFoundError, match="there is no folder"):
        make().save(tmp_path / "none" / "b.npz")


def test_saved_files_have_ordinary_permissions(tmp_path):
    make().save(tmp_path / "b.npz")
    (tmp_path / "plain").touch()
    assert (tmp_path / "b.npz").stat().st_mode == (tmp_path / "plain").stat().st_mode


def test_csv_has_a_column_for_everything_and_loses_no_digit(tmp_path):
    b = make()
    b.export(tmp_path / "b.csv")
    lines = (tmp_path / "b.csv").read_text(encoding="utf-8").splitlines()
    table = [line for line in lines if not line.startswith("#")]
    rows = list(csv.DictReader(table))
    assert len(rows) == len(b)
    per_element = ["regime", "rms", "pp2", "max", "mean", "a0", "a1", "b1", "a2", "b2", "a3", "b3"]
    assert list(rows[0]) == [
        "Omega",
        "F_m",
        "special",
        "special_value",
        "special_error",
        "landing",
        "stable",
        "multiplier_max",
        "residual",
        "iterations",
        "error",
        *(f"{name}_left" for name in per_element),
        *(f"{name}_right mesh" for name in per_element),
    ]

    def column(name):
        return np.array([float(row[name]) for row in rows])

    assert np.array_equal(column("Omega"), b.values) and np.array_equal(column("F_m"), b.tracked["F_m"])
    assert np.array_equal(column("pp2_right mesh"), b.amplitude("pp2", 1))
    assert np.array_equal(column("b2_right mesh"), b.X[:, 7 + 4])
    assert np.array_equal(column("stable"), b.stable) and np.isnan(column("error")[2])
    assert np.array_equal(column("multiplier_max"), np.abs(b.multipliers).max(axis=1))
    assert [row["special"] for row in rows] == ["", "", "", "LP1", "", "GR1", "", ""]
    assert rows[0]["regime_left"] == "single_sided" and rows[0]["regime_right mesh"] == "no_impact"
    numbers = np.genfromtxt(table, delimiter=",", names=True, dtype=None, encoding="utf-8")
    assert np.array_equal(numbers["rms_left"], b.amplitude("rms"))


def test_csv_without_layout_or_multipliers(tmp_path):
    b = make(layout=None, multipliers=None)
    b.export(tmp_path / "b.csv")
    lines = (tmp_path / "b.csv").read_text(encoding="utf-8").splitlines()
    header = next(line for line in lines if not line.startswith("#")).split(",")
    assert "stable" not in header and header[-14:] == [f"X{i}" for i in range(14)]


def test_mat_is_read_back(tmp_path):
    b = make()
    b.export(tmp_path / "b.mat")
    m = loadmat(tmp_path / "b.mat", simplify_cells=True)
    for name in ("values", "X", "multipliers", "residual", "iterations", "regime"):
        assert np.array_equal(m[name], getattr(b, name)), name
    assert m["parameter"] == "Omega" and m["status"] == "max_points" and m["message"] == "größer"
    assert m["fixed"]["zeta"] == 0.3 and np.array_equal(m["tracked"]["F_m"], b.tracked["F_m"])
    assert np.array_equal(m["stable"], b.stable) and json.loads(m["meta"])["H"] == 3
    assert np.array_equal(m["amplitude"]["pp2"][:, 1], b.amplitude("pp2", 1))
    assert m["special"][0]["label"] == "LP1" and m["special"][0]["row"] == 4  # rows are counted from 1
    assert np.array_equal(m["special"][0]["X"], b["LP1"].X) and m["special"][0]["interval"].tolist() == [1.0, 1.1]
    assert m["jumps"][0]["after"]["parameters"]["Omega"] == 2.0 and "after" not in m["jumps"][1]
    assert m["layout"]["harmonics"] == 3 and list(m["layout"]["elements"]) == ["left", "right mesh"]
    assert m["layout"]["breakpoints"][0].tolist() == [-1.0, 1.0]


def test_mat_of_a_bare_branch(tmp_path):
    b = make(layout=None, multipliers=None, special=(), jump_records=(), tracked={})
    b.export(tmp_path / "b.mat")
    m = loadmat(tmp_path / "b.mat", simplify_cells=True)
    assert "multipliers" not in m and "amplitude" not in m and np.array_equal(m["X"], b.X) and len(m["special"]) == 0


@pytest.mark.slow
def test_largest_loads_of_teeth_are_those_of_all_stable_motions() -> None:
    """They were those of the largest amplitudes: 2 % lower where helical teeth stay in contact, the root stress 4 %.

    Of an unbounded branch, motions up to its last special point are searched.
    """
    from hbgear.cli.machine_report.gear_tables import largest_motions
    from hbgear.cli.machine_report.peaks import stable_or_limit

    def largest(points) -> np.ndarray:
        loads = [hb.analysis.tooth_loads(point, mesh) for point in points]
        return np.max([(x.force.max(), *x.root_stress.max(axis=(1, 2))) for x in loads], axis=0)

    gears = [
        hb.gears.Gear(z, "2.5 mm", "25 mm", helix_angle=beta, tip_relief="15 um")
        for z, beta in ((25, "15 deg"), (63, "-15 deg"))
    ]
    pair = hb.GearPair(*gears, backlash="80 um")
    mesh = hb.gears.tooth_mesh(pair, 60.0)
    curve = hb.trace(hb.HarmonicBalance(pair.model(60.0, 0.04), 8), "Omega", (0.88, 0.8))
    stable = [curve[i] for i in np.flatnonzero(stable_or_limit(curve))]
    np.testing.assert_allclose(largest(largest_motions(curve, mesh, 1)), largest(stable), rtol=1e-3)
    by_amplitude = sorted(stable, key=lambda point: float(point.amplitude("max")))[-5:]
    assert (largest(by_amplitude) < [0.99, 0.97, 0.995] * largest(stable)).all()
    endless = dataclasses.replace(curve, meta={**curve.meta, "asymptotes": {"last": 0.9}})
    assert [point.parameters["Omega"] for point in largest_motions(endless, mesh, 1)] == [0.88]


def test_largest_factor_of_a_varying_stiffness() -> None:
    """The largest force of the curve is not at one of its largest amplitudes."""
    from hbgear.cli.machine_report.assumptions import largest_factor

    model = hb.SpurPair(zeta=0.04, F_m=0.5, eps=(-0.13,), e=(0.05,), reference=(3e4, 4e-5, 1e4, 25))
    curve = hb.trace(hb.HarmonicBalance(model, 8), "Omega", (1.5, 0.3))
    largest = hb.analysis.machine_quantities(curve)["dynamic factor"][curve.stable].max()
    assert float(largest_factor(model, curve)) == pytest.approx(largest, abs=0.005)
    by_amplitude = np.argsort(curve.amplitude("max") * curve.stable)[-5:]
    assert max(hb.analysis.dynamic_factor(model, curve[int(i)]) for i in by_amplitude) < largest - 0.02


def test_all_motions_at_one_frequency_repeat_after_a_period(tmp_path):
    """Integration over one period returns to the initial state of each motion, stable or unstable, to 1e-4."""
    curve = hb.trace(hb.HarmonicBalance(hb.SpurPair(), 32), "Omega", (1.3, 0.6))
    points = curve.at(0.8)
    assert [point.stable for point in points] == [True, False, True]
    for point in points:
        assert point.parameters["Omega"] == 0.8
        state = state_of(curve.problem, point.X, Omega=0.8)
        end = hb.time.integrate(hb.SpurPair(), state, 1, 0.8).end
        assert np.abs(end - state).max() < 1e-4 * np.abs(state).max()
    curve.save(tmp_path / "curve.npz")
    again = hb.load(tmp_path / "curve.npz").at(0.8)
    assert [point.amplitude("rms") for point in again] == pytest.approx([point.amplitude("rms") for point in points])


def test_a_frequency_outside_all_curves_is_refused():
    curve = hb.trace(hb.HarmonicBalance(hb.SpurPair(), 3), "Omega", (1.3, 1.2), stability=False)
    with pytest.raises(ValueError, match="no curve reaches Omega = 2: the span that was traced"):
        curve.at(2.0)


@pytest.mark.parametrize("status", list(Status))
def test_a_curve_that_stopped_early_has_a_warning(status):
    """The table of a command states the status already, so that it does not repeat this warning."""
    branch = make(status=status, message="10000 points, at Omega = 1.2")
    stopped = [text for text in branch.warnings if text.startswith("stopped early")]
    assert stopped == ([] if status.complete else [f"{status.in_words}: {branch.message}"])
    assert not any("stopped early" in line for line in reliability_lines(branch))
