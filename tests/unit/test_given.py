"""Arguments of another kind: every function says what it got, what it needs and what to do."""

import numpy as np
import pytest

import hbgear as hb
from hbgear.common.text.messages import article

MODEL = hb.SpurPair()
PROBLEM = hb.HarmonicBalance(MODEL, 5)
SPAN = (1.5, 0.6)


@pytest.fixture(scope="module")
def curve():
    return hb.trace(PROBLEM, "Omega", SPAN)


A_BRANCH, A_MODEL, A_PROBLEM = "needs a Branch", "needs a model", "needs a HarmonicBalance"


@pytest.mark.parametrize(
    ("call", "words"),
    [
        (lambda _: hb.trace(MODEL, "Omega", SPAN), (A_PROBLEM, "got a SpurPair: give HarmonicBalance(model)")),
        (lambda c: hb.trace(c, "Omega", SPAN), (A_PROBLEM, "got a Branch", "branch.problem")),
        (lambda _: hb.trace(hb.Duffing, "Omega", SPAN), (A_PROBLEM, "got the class Duffing: call it: Duffing()")),
        (lambda _: hb.trace(PROBLEM, "Omega", SPAN, "LP1"), ("got 'LP1'", "curve['LP1']")),
        (lambda c: hb.trace(PROBLEM, "Omega", SPAN, c), ("got a Branch", "curve[-1]")),
        (lambda _: hb.trace(PROBLEM, "Omega", SPAN, at=("zeta", 0.1)), ("got a tuple", "at={'zeta': 0.05}")),
        (lambda _: hb.trace(PROBLEM, "Omega", SPAN, steps=100), ("got 100", "StepControl(max_points=100)")),
        (lambda _: hb.trace(PROBLEM, "Omega", SPAN, settings=1e-9), ("got 1e-09", "NewtonSettings(tolerance=1e-12)")),
        (lambda _: hb.validate(MODEL), (A_BRANCH, "got a SpurPair", "trace it first")),
        (lambda _: hb.validate(PROBLEM), (A_BRANCH, "got a HarmonicBalance", "trace it first")),
        (lambda _: hb.validate("low.npz"), (A_BRANCH, "got 'low.npz'", "load(path)")),
        (lambda c: hb.validate(c, "6"), ("got '6'", "a list of indices and labels")),
        (lambda _: hb.extend(PROBLEM), (A_BRANCH, "got a HarmonicBalance")),
        (lambda _: hb.analysis.peaks(MODEL), (A_BRANCH, "got a SpurPair")),
        (lambda _: hb.switch(PROBLEM, "PD1"), (A_BRANCH, "got a HarmonicBalance")),
        (lambda c: hb.switch(c, c["LP1"]), ("got a SpecialPoint", "'PD1'")),
        (lambda c: hb.switch(c, 3), ("got 3", "'PD1'")),
        (lambda _: hb.time.sweep(PROBLEM, [0.66, 0.68]), (A_MODEL, "problem.model")),
        (lambda c: hb.time.basins(c, 0.7), (A_MODEL, "branch.problem.model")),
        (lambda c: hb.jump_map(c, "zeta", (0.1, 0.2)), (A_MODEL, "got a Branch")),
        (lambda _: hb.analysis.critical_parameter(hb.SpurPair, "zeta"), (A_MODEL, "the class SpurPair", "SpurPair()")),
        (lambda _: hb.trace_all(MODEL, SPAN), (A_PROBLEM, "HarmonicBalance(model)")),
        (lambda _: hb.trace_all(PROBLEM, SPAN, frequencies="5"), ("got '5'", "a number of frequencies")),
        (lambda _: hb.trace_all(PROBLEM, SPAN, second="zeta"), ("got 'zeta'", "('zeta', (0.05, 0.2))")),
        (lambda _: hb.time.integrate(PROBLEM, [0.0, 0.0], 3, 0.7), (A_MODEL, "problem.model")),
        (lambda _: hb.time.shoot(PROBLEM, 0.7, [0.0, 0.0]), (A_MODEL, "problem.model")),
        (lambda _: hb.design.cases(PROBLEM, hb.design.grid(zeta=[0.1])), (A_MODEL, "problem.model")),
        (lambda _: hb.design.cases(MODEL, {"zeta": [0.1]}), ("got a dict", "grid(zeta=")),
        (lambda _: hb.mechanics.reduce(np.eye(3), 2), (A_MODEL, "ndarray")),
        (lambda c: hb.HarmonicBalance(c), (A_MODEL, "got a Branch")),
        (lambda _: hb.HarmonicBalance("spur-pair"), (A_MODEL, "got 'spur-pair'")),
        (lambda _: hb.continuation.FoldProblem(MODEL), (A_PROBLEM, "HarmonicBalance(model)")),
    ],
)
def test_messages_state_given_required_and_remedy(curve, call, words):
    with pytest.raises(TypeError) as error:
        call(curve)
    for word in words:
        assert word in str(error.value)


@pytest.mark.parametrize(
    ("call", "words"),
    [
        (lambda _: hb.trace(PROBLEM, "Omega", 1.5), ("span = 1.5 must be two numbers (from, to)",)),
        (lambda _: hb.trace(PROBLEM, "Omega", ("1.5", 0.6)), ("span = ('1.5', 0.6) must be two numbers",)),
        (lambda _: hb.trace(PROBLEM, "Omega", SPAN, at={"zeta": "0.1"}), ("zeta = '0.1' must be a finite number",)),
        (lambda _: hb.trace(PROBLEM, "Omega", SPAN, at={"Omega": 1.0}), ("it is what changes along the curve",)),
        (lambda _: hb.jump_map(MODEL, "zeta", 0.1), ("span = 0.1 must be two numbers",)),
        (lambda _: hb.jump_map(MODEL, "zeta", (0.1, 0.2), seeds="3"), ("seeds = '3'", "a whole number")),
        (
            lambda _: hb.analysis.critical_parameter(MODEL, "zeta", frequencies=(3,)),
            ("frequencies = (3,) must be two numbers",),
        ),
        (lambda _: hb.trace_all(PROBLEM, 1.5), ("span = 1.5 must be two numbers",)),
        (lambda _: hb.design.cases(MODEL, hb.design.grid(zeta=[0.1]), span=3), ("span = 3 must be two numbers",)),
        (lambda c: hb.switch(c, "LP1"), ("LP1 is an LP;", "choose a PD or BP")),
        (lambda c: hb.switch(c, "GR1"), ("GR1 is a GR;",)),
    ],
)
def test_values_that_cannot_be_meant(curve, call, words):
    with pytest.raises(ValueError) as error:
        call(curve)
    for word in words:
        assert word in str(error.value)


def test_names_that_are_no_text():
    for call in (lambda: hb.trace(PROBLEM, 3, SPAN), lambda: hb.jump_map(MODEL, 3, SPAN)):
        with pytest.raises(TypeError, match=r"needs the name of a parameter, such as '.*'; got 3"):
            call()


def test_articles():
    assert [article(x) for x in ("LP", "PD", "NS", "BP", "GR", "CP", "Element", "Branch")] == [
        "an LP",
        "a PD",
        "an NS",
        "a BP",
        "a GR",
        "a CP",
        "an Element",
        "a Branch",
    ]


@pytest.mark.parametrize(
    ("call", "words"),
    [
        (lambda n: hb.mechanics.Receptances([0, 1, 2, 3], [[[n]]] * 4, ["a"]), "must be complex numbers"),
        (lambda n: hb.design.Measurements([1.0], [1.0], jumps=[(n, 1)]), "the jump a tuple must be"),
        (lambda n: hb.gears.Mesh("a", "b", 1e8, eps=(n,)), "eps"),
        (lambda n: hb.gears.Gear(teeth=20, module=n, face_width=0.02), "module"),
        (lambda n: hb.mechanics.model(default_span=(n, 1.0))(lambda zeta=0.1: None), "default_span"),
        (lambda n: hb.mechanics.Series(n), "mean"),
    ],
)
def test_integers_beyond_the_range_of_floats_are_refused(call, words):
    with pytest.raises((ValueError, TypeError), match=words):
        call(10**400)
