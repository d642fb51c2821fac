"""Models that users write: functions, classes with fields of any type, and how the command line finds them."""

import dataclasses
import pickle
import subprocess
import sys
from dataclasses import dataclass
from importlib.metadata import EntryPoint

import numpy as np
import pytest
from machines import Needs, system, two

import hbgear as hb
from hbgear.harmonic.models import model_registry
from hbgear.mechanics import model_lookup as naming
from hbgear.mechanics.fields import kinds_of, made, parameters_of, required_of
from hbgear.mechanics.models import describe

SOURCE = '''"""Somebody's machines."""
from __future__ import annotations
import hbgear as hb
from helper import CUBIC

@hb.mechanics.model(default_span=(0.6, 1.5))
def two(F: float, zeta: float = 0.05, e: tuple[float, ...] = ()) -> hb.System:
    """An oscillator of somebody; with a spring.

        x'' + 2 zeta x' + x + x^3 / 10 = F cos(tau)

    F : load.
    """
    spring = hb.Element([1.0], hb.Cubic(CUBIC), name="x")
    return hb.System([[1.0]], [[2 * zeta]], [[1.0]], [spring], hb.Load(cosine={1: [F]}))

def bare(zeta: float = 0.1):
    return None

print("mine.py runs")
'''


@pytest.fixture
def run(run, tmp_path):
    """Run the command in a folder with a user's file: ``(exit code, stdout, stderr)``."""
    (tmp_path / "mine.py").write_text(SOURCE)
    (tmp_path / "helper.py").write_text("CUBIC = 0.1\n")
    return run


# ---- fields


def test_fields_of_every_way_to_write_a_number_are_parameters():
    assert parameters_of(Needs) == ("F", "zeta", "W") and kinds_of(Needs)["teeth"] is int
    assert Needs(0.18).parameters == {"F": 0.18, "zeta": 0.05, "W": 0.0}
    with pytest.raises(ValueError, match=r"Needs: zeta = nan must be a finite number"):
        Needs(0.18, zeta=float("nan"))
    curve = hb.trace(hb.HarmonicBalance(Needs(0.18), 5), "zeta", (0.2, 0.15), at={"Omega": 1.0})
    assert curve.values[-1] == 0.15


def test_types_known_only_inside_of_a_function_leave_the_others():
    Local = int

    @dataclass(frozen=True)
    class Inner(hb.mechanics.Model):
        z: "float" = 0.1
        n: "Local" = 1

        def system(self):
            return system(self.z, 0.1)

    assert Inner().parameters == {"z": 0.1}


def test_required_fields():
    assert required_of(Needs) == ("F",)
    with pytest.raises(ValueError, match="Needs needs F: no default, so give a value"):
        made(Needs, {"zeta": 0.1})
    with pytest.raises(KeyError, match="Needs has no parameter 'zetta'; did you mean 'zeta'"):
        made(Needs, {"F": 1.0, "zetta": 0.1})
    model = Needs(0.2, teeth=17)
    assert model_registry.rebuild_model(describe(model), Needs) == model


@pytest.mark.slow
def test_a_model_with_required_fields_in_a_study():
    found = hb.design.cases(
        Needs(0.1), hb.design.grid(zeta=[0.1, 0.2]), ("peak",), harmonics=3, span=(0.7, 1.3), processes=1
    )
    assert not found.failed and found.table["peak"][0] > 1.5 * found.table["peak"][1]


# ---- functions


def test_a_function_is_a_model():
    assert repr(two()) == "two()" and repr(two(zeta=0.1)) == "two(zeta=0.1)"
    assert two(0.1) == two(zeta=0.1) != two() and hash(two()) == hash(two())
    assert two().parameters == {"zeta": 0.05, "F": 0.18} and two().replace(F=0.2) == two(F=0.2)
    assert isinstance(two(), hb.mechanics.Model) and isinstance(two().system(), hb.System)
    assert two.__doc__ == "An oscillator of somebody." and two.default_span == (0.5, 1.6)
    assert pickle.loads(pickle.dumps(two(n=2))) == two(n=2)
    assert describe(two())["class"] == "two" and describe(two())["from"].endswith(":two")
    assert model_registry.rebuild_model(describe(two(F=0.2, kind="b")), two) == two(F=0.2, kind="b")


@pytest.mark.slow
def test_curves_folds_and_critical_values_of_a_function_are_those_of_the_class():
    own, known = hb.HarmonicBalance(two(), 6), hb.HarmonicBalance(hb.Duffing(), 6)
    curves = [hb.trace(problem, "Omega", (0.5, 1.6)) for problem in (own, known)]
    np.testing.assert_array_equal(curves[0].X, curves[1].X)
    folds = [
        hb.trace(hb.continuation.FoldProblem(c.problem, "Omega"), "zeta", (0.05, 0.06), start=c["LP1"]) for c in curves
    ]
    np.testing.assert_array_equal(folds[0].tracked["Omega"], folds[1].tracked["Omega"])
    assert hb.analysis.critical_parameter(own, "zeta").value == hb.analysis.critical_parameter(known, "zeta").value
    maps = [hb.jump_map(problem, "F", (0.16, 0.18)) for problem in (own, known)]
    np.testing.assert_array_equal(maps[0].arms[0].Omega, maps[1].arms[0].Omega)


@pytest.mark.slow
def test_cases_of_a_function_in_processes_are_those_of_the_class():
    vary = hb.design.grid(zeta=[0.05, 0.06])
    own, known = (
        hb.design.cases(m, vary, ("peak",), harmonics=3, span=(0.7, 1.3), processes=1) for m in (two(), hb.Duffing())
    )
    assert not own.failed
    np.testing.assert_array_equal(own.table["peak"], known.table["peak"])


def no_type(zeta=0.1): ...
def several(*zeta: float): ...
def keywords(**zeta: float): ...
def by_place(zeta: float, /): ...
def a_list(zeta: list[float]): ...
def a_method(system: float = 1.0): ...
def frequency(Omega: float = 1.0): ...
def unknown(zeta: "Nowhere" = 1.0): ...  # noqa: F821


@pytest.mark.parametrize(
    ("function", "message"),
    [
        (no_type, r"no_type: zeta has no type; write zeta: float = 1.0"),
        (several, r"several\(\*zeta: float\): a model needs parameters with names"),
        (keywords, r"keywords\(\*\*zeta: float\): a model needs parameters with names"),
        (by_place, r"by_place\(zeta: float\): a model needs parameters with names"),
        (a_list, r"a_list: zeta is of type list\[float\]; need float, int"),
        (a_method, r"no parameter of a model can be called 'system'"),
        (frequency, r"no parameter of a model can be called 'Omega'"),
        (unknown, r"the type of zeta, Nowhere, cannot be understood"),
        (hb.Duffing, r"decorates a function"),
    ],
)
def test_functions_that_are_no_models_are_refused(function, message):
    with pytest.raises(ValueError, match=message):
        hb.mechanics.model(function)


def test_options_of_other_names_are_refused():
    with pytest.raises(ValueError, match="ranges of 'zetta', which is no parameter; did you mean 'zeta'"):
        hb.mechanics.model(ranges={"zetta": hb.mechanics.Range()})(two.function)


@pytest.mark.parametrize(
    ("options", "said"),
    [
        ({"ranges": np.inf}, "ranges = inf must be a dict of Range by name"),
        ({"ranges": {"k": (0, 1)}}, "must be a dict of Range by name"),
        ({"usual": [1]}, "usual = .1. must be a dict of Range"),
        ({"labels": 3}, "labels = 3 must be a dict of texts by name"),
        ({"default_span": np.inf}, "default_span = inf must be two different frequencies"),
        ({"default_span": (1.0, 1.0)}, "must be two different frequencies"),
        ({"default_span": ("a", "b")}, "must be two different frequencies"),
    ],
)
def test_options_of_other_types_are_refused(options, said):
    with pytest.raises(ValueError, match=said):
        hb.mechanics.model(**options)


def test_wrong_values_are_refused():
    for fields, message in [
        ({"zeta": -0.1}, "two: zeta = -0.1 must not be negative"),
        ({"zeta": "a"}, "two: zeta = 'a' must be a finite number"),
        ({"n": 1.5}, "two: n = 1.5 must be a whole number"),
        ({"kind": "c"}, "two: kind = 'c' must be 'a' or 'b'"),
    ]:
        with pytest.raises(ValueError, match=message):
            two(**fields)

    @hb.mechanics.model
    def nothing(zeta: float = 0.1, e: tuple[float, ...] = ()):
        return None

    assert nothing(e=[1.0]).e == (1.0,)
    with pytest.raises(ValueError, match=r"nothing: e\[0\] = nan must be a finite number"):
        nothing(e=(float("nan"),))
    with pytest.raises(ValueError, match=r"nothing\(\) returned None; need a System"):
        hb.HarmonicBalance(nothing(), 4)


# ---- on the command line


@pytest.mark.slow
def test_a_function_in_a_file_on_the_command_line(run):
    short = ["--harmonics", 3, "--set", "F=0.18"]
    code, out, err = run("trace", "mine.py:two", *short, "-o", "a.npz")
    assert (code, err) == (0, "") and "mine.py:two:" in out
    there = hb.trace(hb.HarmonicBalance(hb.Duffing(), 3), "Omega", (0.6, 1.5))
    np.testing.assert_allclose(hb.load("a.npz").X, there.X, rtol=0, atol=1e-10)
    code, out, _ = run("critical", "mine.py:two", "zeta", *short)
    expected = hb.analysis.critical_parameter(hb.HarmonicBalance(hb.Duffing(), 3), "zeta", frequencies=(0.6, 1.5)).value
    assert code == 0 and abs(float(out.split()[2].strip(":").partition("(")[0]) - expected) < 1e-5
    assert run("map", "mine:two", "--in", "F=0.17:0.18", *short)[0] == 0
    assert run("sweep", "mine.py:two", "--set", "F=0.18", "--up", "--count", 3, "--tolerance", "1e-2")[0] == 0
    code, out, _ = run("models", "mine.py:two")
    assert code == 0 and "F=VALUE, zeta=0.05, e=()" in out and "An oscillator of somebody" in out
    assert "x'' + 2 zeta x' + x + x^3 / 10 = F cos(tau)" in out


@pytest.mark.slow
def test_a_saved_curve_runs_no_code_until_its_model_is_named_again(run):
    assert run("trace", "mine.py:two", "--set", "F=0.18", "--harmonics", 6, "--to", 1.0, "-o", "a.npz")[0] == 0
    script = "import sys, hbgear as hb; b = hb.load('a.npz'); print(b.meta['model']['from'])"
    fresh = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, timeout=60)
    assert fresh.stdout == "mine.py:two\n", fresh.stderr  # and not what the file prints
    code, out, _ = run("info", "a.npz")
    assert code == 0 and "from mine.py:two" in out
    for command in (
        ["extend", "a.npz", "--to", 1.05],
        ["validate", "a.npz", "--points", 2],
        ["switch", "a.npz", "PD1"],
        ["results", "a.npz"],
    ):
        code, _, err = run(*command)
        assert "hbgear.load" not in err and '("' not in err  # no other text in quotation marks around it
        assert code == 2 and "it was in mine.py:two: name it again if you trust it, by --model" in err
    assert run("extend", "a.npz", "--to", 1.05, "--model", "mine.py:two")[0] == 0
    assert run("validate", "a.npz", "--points", 2, "--model", "mine.py:two", "--tolerance", 1e-2)[0] == 0
    code, _, err = run("switch", "a.npz", "PD1", "--model", "mine.py:two")
    assert code == 2 and "PD1" in err and "--model" not in err  # the curve has none
    code, _, err = run("extend", "a.npz", "--model", "duffing")
    assert code == 2 and "the file is of model two; the given model is Duffing" in err
    args = ["--harmonics", 6, "--start", "a.npz", "--to", 1.05]
    assert run("trace", "mine.py:two", "--set", "F=0.18", *args)[0] == 0


@pytest.mark.slow
@pytest.mark.parametrize("name", ["mine.py:two", "mine:two"])
def test_a_study_of_a_function_in_a_file(run, tmp_path, name):
    study = f'model = "{name}"\n[base]\nF = 0.18\n[grid]\nzeta = [0.05, 0.06]\n'
    (tmp_path / "s.toml").write_text(study + '[compute]\nwhat = ["peak"]\nharmonics = 3\nspan = [0.7, 1.3]\n')
    code, out, err = run("study", "s.toml", "--processes", 1, "--allow-code")
    assert (code, err) == (0, "") and "2 of 2 cases, 0 of them failed" in out
    (tmp_path / "t.toml").write_text(study.replace("F = 0.18\n", ""))
    code, _, err = run("study", "t.toml", "--allow-code")
    assert code == 2 and f"t.toml, line 2: the model '{name}' needs F: no default, so give a value in [base]" in err


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("mine.py:two", "needs F, which have no default: --set F=VALUE"),
        ("mine.py:too", "'mine.py' has no model 'too'; did you mean 'two'"),
        ("mine.py:bare", "is a function, not a class of models; decorate it by @hb.mechanics.model"),
        ("mine.py:hb", "is a module, not a class of models"),
        ("other.py:two", "'other.py' cannot be loaded: there is no file"),
        ("nowhere.at.all:two", "cannot be loaded: ModuleNotFoundError"),
        ("broken.py:two", "'broken.py' cannot be loaded: ZeroDivisionError: division by zero"),
        ("dufing", "there is no model 'dufing'; did you mean 'duffing'"),
    ],
)
def test_names_that_are_no_models_get_one_sentence(run, tmp_path, name, words):
    (tmp_path / "broken.py").write_text("1 / 0\n")
    code, _, err = run("trace", name)
    assert code == 2 and words in err and err.count("\n") == 1


def test_models_of_installed_packages(run, monkeypatch):
    points = [
        EntryPoint("own-machine", f"{__name__}:two", naming.GROUP),
        EntryPoint("lost", "nowhere:two", naming.GROUP),
    ]
    monkeypatch.setattr("importlib.metadata.entry_points", lambda group: points if group == naming.GROUP else [])
    monkeypatch.setitem(sys.modules, __name__, sys.modules[two.__module__])
    code, out, err = run("models")
    assert code == 0 and "own-machine" in out and "An oscillator of somebody" in out
    assert "warning: the model 'lost' of nowhere:two cannot be loaded" in err
    assert model_registry.model_class("own-machine") is two
    with pytest.raises(KeyError, match="no model 'own-machin'; did you mean 'own-machine'"):
        model_registry.model_class("own-machin")


def test_every_field_of_a_function_model_is_a_field():
    assert [f.name for f in dataclasses.fields(two)] == ["zeta", "F", "n", "kind"]


@pytest.mark.parametrize(
    ("options", "said"),
    [
        ({"ranges": np.inf}, "ranges = inf must be a dict of Range"),
        ({"ranges": {"zeta": 1.0}}, "ranges = {'zeta': 1.0} must be a dict of Range"),
        ({"usual": [1]}, r"usual = \[1\] must be a dict of Range"),
        ({"labels": {"zeta": 3}}, "labels = {'zeta': 3} must be a dict of texts"),
        ({"default_span": 1.0}, "default_span = 1.0 must be two different frequencies"),
        ({"default_span": (0.5, np.nan)}, "must be two different frequencies"),
        ({"default_span": "ab"}, "must be two different frequencies"),
    ],
)
def test_options_of_another_kind_are_refused(options, said):
    with pytest.raises(ValueError, match=f"model: .*{said}"):

        @hb.mechanics.model(**options)
        def stop(zeta: float = 0.05) -> hb.System:
            raise AssertionError
