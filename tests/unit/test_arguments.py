"""Arguments that are not what is annotated are refused in one sentence; those that are, pass."""

import copy
import inspect
import pickle
from collections.abc import Sequence

import numpy as np
import pytest

import hbgear as hb
from hbgear.common.argument_checks import check, checked_arguments, fits, words

HBM = hb.HarmonicBalance(hb.Duffing(), 3)
GEAR = hb.gears.Gear(teeth=20, module=0.003, face_width=0.02)


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: hb.trace(hb.Duffing(), "Omega", (0.5, 1.0)), "needs a HarmonicBalance, .*; got a Duffing: give Harm"),
        (lambda: hb.trace(hb.HarmonicBalance, "Omega", (0.5, 1.0)), "; got the class HarmonicBalance: call it"),
        (lambda: hb.trace(HBM, 3, (0.5, 1.0)), "needs the name of a parameter, such as 'Omega'; got 3"),
        (lambda: hb.trace(HBM, "Omega", 0.5), r"trace: span = 0.5 must be two numbers"),
        (lambda: hb.trace(HBM, "Omega", (0.5, "1")), r"trace: span = \(0.5, '1'\) must be two numbers"),
        (lambda: hb.trace(HBM, "Omega", (0.5, np.nan)), r"trace: span = \(0.5, nan\) must be finite"),
        (lambda: hb.trace(HBM, "Omega", (0.5, 1.0), at={"F": "x"}), "trace: at: F = 'x' must be a finite number"),
        (lambda: hb.trace(HBM, "Omega", (0.5, 1.0), at={"F": np.inf}), "trace: at: F = inf must be a finite number"),
        (lambda: hb.trace(HBM, "Omega", (0.5, 1.0), steps=3), r"trace\(steps\) needs StepControl.*; got 3"),
        (lambda: hb.trace(HBM, "Omega", (0.5, 1.0), stability="no"), "stability = 'no' must be True or False"),
        (lambda: hb.HarmonicBalance(hb.SpurPair), r"needs a model.*; got the class SpurPair: call it: SpurPair\(\)"),
        (lambda: hb.HarmonicBalance(HBM), "needs a model, .*; got a HarmonicBalance: give its model: problem.model"),
        (lambda: hb.HarmonicBalance(hb.Duffing(), 2.5), "harmonics = 2.5 must be a whole number or a text"),
        (lambda: hb.HarmonicBalance(hb.Duffing(), True), "harmonics = True must be a whole number or a text"),
        (lambda: hb.validate(hb.Duffing()), r"validate\(branch\) needs a Branch, .*; got a Duffing: trace it"),
        (lambda: hb.trace_all(hb.Duffing(), (0.5, 1.0)), "needs a HarmonicBalance, .*; got a Duffing: give Harm"),
        (lambda: hb.analysis.peaks(3), r"peaks\(branch\) needs a Branch, .*; got 3$"),
        (lambda: HBM.start(Omega="fast"), "HarmonicBalance.start: Omega = 'fast' must be a finite number"),
        (lambda: HBM.motion(np.zeros(8), Omega=1.0), r"X of shape \(8,\): need the unknowns of one motion"),
        (lambda: hb.StepControl(max_points="many"), "StepControl: max_points = 'many' must be a whole number"),
        (lambda: hb.validate(HBM, problem=3), "needs a Branch, .*; got a HarmonicBalance: trace it first"),
        (lambda: hb.HarmonicBalance(hb.Duffing(), 3, tolerance="fine"), "tolerance = 'fine' must be a finite number"),
        (lambda: hb.load(3), "load: path = 3 must be a text or a path"),
        (lambda: hb.save(None, "a.npz"), r"save\(branch\) needs a Branch, .*; got None"),
        (lambda: hb.io.export([], "a.csv"), r"export\(branch\) needs a Branch, .*; got a list"),
        (lambda: hb.io.read_machine(None), "read_machine: path = None must be a text or a path"),
        (lambda: hb.gears.root_factors(None, 0.06), r"root_factors\(gear\) needs a Gear; got None"),
        (lambda: hb.gears.tooth_mesh(GEAR, 3), r"tooth_mesh\(pair\) needs a GearPair; got a Gear"),
        (lambda: GEAR.tooth_thickness(0.0), "tooth_thickness: diameter = 0.* must be positive"),
        (lambda: hb.harmonic.TwoToneProblem(hb.Duffing(), 0.618, dense=0), "dense = 0 must be a whole number"),
    ],
)
def test_an_argument_is_refused_where_it_is_given(call, message):
    with pytest.raises((ValueError, TypeError), match=message) as caught:
        call()
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("value", "kind", "good"),
    [
        (1, float, True),
        (np.float32(1), float, True),
        (np.array(1.0), float, True),
        (True, float, False),
        (1j, float, False),
        (10**400, int, True),
        (np.int64(3), int, True),
        (3.0, int, False),
        (True, int, False),
        (np.bool_(True), bool, True),
        (1, bool, False),
        ("x", str, True),
        (None, str | None, True),
        ([0.1, 0.2], tuple[float, float], True),
        (np.array([0.1, 0.2]), tuple[float, float], True),
        ((0.1, 0.2, 0.3), tuple[float, float], False),
        ((1, 2, 3), tuple[float, ...], True),
        ("12", tuple[str, ...], False),
    ],
)
def test_matching_values(value, kind, good):
    assert fits(value, kind) is good


def test_numbers_too_large_for_a_float_are_refused():
    with pytest.raises(ValueError, match="must be a finite number"):
        check("f", "x", 10**400, float)


def test_defaults_are_not_looked_at():
    @checked_arguments()
    def f(x: float = "any", *, y: "Nowhere" = None, **others: float) -> object:  # noqa: F821
        return x, y, others

    assert f() == ("any", None, {})
    assert f(2, z=3) == (2, None, {"z": 3})
    with pytest.raises(ValueError, match="z = 'a' must be a finite number"):
        f(z="a")
    with pytest.raises(TypeError, match="missing"):
        checked_arguments()(lambda x: x)()


def test_words():
    assert words(float | int | None) == "a finite number, a whole number or None"
    assert words(tuple[float, ...]) == "a sequence of numbers"
    assert words(tuple[int, int]) == "two whole numbers"
    assert words(Sequence[hb.Branch]) == "a sequence of Branches"
    assert words(tuple[float, float]) == "two numbers (from, to)"


def test_classes_imported_for_type_checkers_are_known_by_name():
    @checked_arguments()
    def f(x: "Nowhere | None" = None) -> object:
        return x

    class Nowhere:
        pass

    class Inner(Nowhere):
        pass

    assert isinstance(f(Inner()), Nowhere)
    with pytest.raises(TypeError, match=r"f\(x\) needs a Nowhere or None; got 'what'"):
        f("what")


def test_requirements_of_a_function_in_its_messages():
    @checked_arguments(at="values by name, such as at={'zeta': 0.05}")
    def f(at: dict[str, float] | None) -> object:
        return at

    assert f({"zeta": 1}) == {"zeta": 1}
    with pytest.raises(TypeError, match=r"^f\(at\) needs values by name, such as at={'zeta': 0.05}; got a tuple$"):
        f(("zeta", 1))
    with pytest.raises(ValueError, match=r"^f: at: zeta = '1' must be a finite number$"):
        f({"zeta": "1"})


def test_long_values_are_cut():
    @checked_arguments()
    def f(x: float) -> object:
        return x

    for value in ("x" * 5000, 10**4000, [1.0] * 5000):
        with pytest.raises(ValueError) as caught:
            f(value)
        assert len(str(caught.value)) < 200


def test_unknown_and_missing_arguments_name_the_function_and_its_arguments():
    with pytest.raises(TypeError, match=r"HarmonicBalance: .* 'H'; its arguments are: model, harmonics, samples"):
        hb.HarmonicBalance(hb.Duffing(), H=5)
    with pytest.raises(TypeError, match=r"'n_harmonics'; did you mean 'harmonics'\?"):
        hb.HarmonicBalance(hb.Duffing(), n_harmonics=5)
    with pytest.raises(TypeError, match=r"^trace: missing a required argument: 'span'$"):
        hb.trace(hb.HarmonicBalance(hb.Duffing(), 5), (0.5, 1.5))


class FreeModel(hb.mechanics.Model):
    """A model of a user that is not a dataclass and takes any name."""

    def __init__(self, **given):
        self.given = given

    @property
    def system(self):
        return hb.Duffing().system


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: hb.SpurPair(zetta=0.05), "SpurPair has no parameter 'zetta'; did you mean 'zeta'?"),
        (lambda: hb.Duffing(damping=0.05), "Duffing has no parameter 'damping'; it has: zeta, k3, F"),
        (lambda: hb.System(M=1, D=0, K=1), "System has no parameter 'D'; it has: M, C, K, elements, load, "),
        (
            lambda: hb.Element([1], hb.Cubic(0.1), dampng=1),
            "Element has no parameter 'dampng'; did you mean 'damping'?",
        ),
        (lambda: hb.Cubic(stiffness=1), "Cubic has no parameter 'stiffness'; it has: k3, k1"),
        (lambda: hb.StepControl(maxstep=0.1), "StepControl has no parameter 'maxstep'; did you mean 'max_step'?"),
        (lambda: hb.gears.Gear(tooth=20), "Gear has no parameter 'tooth'; did you mean 'teeth'?"),
        (lambda: hb.System([[1]], [[1]]), "System: missing K; its required arguments are M, C, K"),
        (
            lambda: hb.Element(law=hb.Cubic(1.0)),
            "Element: missing direction; its required arguments are direction, law",
        ),
    ],
)
def test_unknown_and_missing_arguments_are_named(call, message):
    with pytest.raises(TypeError) as error:
        call()
    assert str(error.value).startswith(message)


def test_classes_with_checked_names_are_created_and_copied():
    free = FreeModel(anything=1)
    assert free.given == {"anything": 1}
    assert copy.deepcopy(hb.SpurPair(zeta=0.07)) == pickle.loads(pickle.dumps(hb.SpurPair(zeta=0.07)))
    assert list(inspect.signature(hb.Duffing).parameters) == ["zeta", "k3", "F"]
