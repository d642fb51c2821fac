"""Events by name: those that are located on request, those of a user, and the names in messages."""

import numpy as np
import pytest

import hbgear as hb
from hbgear.analysis import peaks
from hbgear.continuation import register_event
from hbgear.continuation.events.registry import EVENTS, optional_events
from hbgear.harmonic.bifurcations.events import KINDS


@pytest.fixture(scope="module")
def problem():
    return hb.HarmonicBalance(hb.SpurPair(), 8)


class Stiff(hb.Event):
    """The mean deflection passes a limit."""

    kind, meaning = "stiff", "mean deflection of 1.1"

    def __init__(self, limit=1.05):
        self.limit = limit

    def test(self, point):
        return point.amplitude("mean") - self.limit


def test_registered_events_have_meaning_and_default():
    two = ["CP", "IC", "RI", "RII", "RIII", "RIV", "FF", "LPNS", "PDNS", "NSNS", "GPD"]
    assert list(KINDS) == ["LP", "PD", "NS", "BP", "GR", "SL", *two, "EP", "PK"]
    assert list(optional_events()) == ["PK"] and not EVENTS["PK"].default
    assert all(EVENTS[name].default for name in KINDS if name != "PK")
    assert all(entry.name == name and entry.meaning for name, entry in EVENTS.items())


def test_peaks_are_located_on_request(problem):
    plain = hb.trace(problem, "Omega", (1.2, 0.6))
    curve = hb.trace(problem, "Omega", (1.2, 0.6), events=["PK"])
    labels = [point.label for point in curve.special]
    assert [label for label in labels if "PK" not in label] == [point.label for point in plain.special]
    found = [point for point in curve.special if point.kind == "PK"]
    expected = peaks(plain, "rms")
    assert len(found) == len(expected) >= 1
    for one, other in zip(found, expected, strict=True):
        assert one.located and one.parameters["Omega"] == pytest.approx(other.parameters["Omega"], abs=1e-6)
    ridge = hb.follow(curve, "PK1", "zeta", (0.05, 0.06), steps=hb.StepControl(max_points=3))
    assert ridge.tracked["Omega"][0] == pytest.approx(found[0].parameters["Omega"], abs=1e-6)


def test_names_select_single_kinds(problem):
    folds = hb.trace(problem, "Omega", (1.2, 0.6), special=False, events=["LP"])
    assert {point.kind for point in folds.special} == {"LP"}
    both = hb.trace(problem, "Omega", (1.2, 0.6), events=["LP"])  # located anyway
    assert [p.label for p in both.special] == [p.label for p in hb.trace(problem, "Omega", (1.2, 0.6)).special]


def test_an_event_of_a_user_by_name(problem, tmp_path):
    limit = register_event(hb.Event("limit", lambda point: point.amplitude("max") - 1.3, "the largest deflection"))
    register_event(Stiff, name="soft-spring")
    curve = hb.trace(problem, "Omega", (1.2, 0.6), events=["limit", "soft-spring"])
    assert curve["limit1"].amplitude("max") == pytest.approx(1.3, abs=1e-9) and curve["limit1"].event is limit
    assert curve["stiff1"].amplitude("mean") == pytest.approx(1.05, abs=1e-9)
    assert curve["stiff1"].meaning == Stiff.meaning
    curve.save(tmp_path / "curve.npz")
    loaded = hb.load(tmp_path / "curve.npz", problem=problem)
    one = hb.follow(loaded, "limit1", "zeta", (0.05, 0.06), steps=hb.StepControl(max_points=2))  # by its kind
    assert one.amplitude("max") == pytest.approx(1.3, abs=1e-8)
    assert hb.trace(problem, "Omega", (1.2, 1.1)).special == ()  # not by default


def test_names_that_are_unknown(problem):
    register_event(Stiff)
    with pytest.raises(ValueError, match="no event 'PKK'; always located: LP, BP, PD, NS, GR; on request: PK, stiff"):
        hb.trace(problem, "Omega", (1.2, 0.6), events=["PKK"])
    with pytest.raises(ValueError, match=r"the event 'PK' does not exist for this problem and parameter; always .*CP"):
        hb.trace(hb.continuation.FoldProblem(problem), "zeta", (0.05, 0.2), np.zeros(18), events=["PK"])
    with pytest.raises(ValueError, match="events = 'PK' must be a sequence of Events or texts"):
        hb.trace(problem, "Omega", (1.2, 0.6), events="PK")
    with pytest.raises(ValueError, match=r"events = \[3\] must be a sequence of Events or texts"):
        hb.trace(problem, "Omega", (1.2, 0.6), events=[3])


def test_registration():
    register_event(Stiff)
    register_event(Stiff)  # again, as in a notebook
    with pytest.raises(TypeError, match=r"needs an hb\.Event or a class derived from it, got 1"):
        register_event(1)
    with pytest.raises(TypeError, match=r"Event needs kind, test; give the arguments defaults"):
        register_event(hb.Event)
    for name in ("PK", "two words", ""):
        with pytest.raises(ValueError, match=r"must be a word, and none of LP"):
            register_event(Stiff, name=name)
    with pytest.raises(ValueError, match="kind = 'LP' is one that hbgear uses itself"):
        register_event(type("Own", (Stiff,), {"kind": "LP"}))
    other = type("Other", (Stiff,), {"__module__": "elsewhere"})
    with pytest.raises(ValueError, match="the name 'stiff' belongs to an event of"):
        register_event(other)


def test_a_test_may_use_the_problem_of_the_point_while_traced_and_followed(problem):
    """A level of the power of the damper, which needs the problem."""
    limit = hb.Event("limit", lambda point: point.problem.m * point.amplitude("H1") - 0.3)
    curve = hb.trace(problem, "Omega", (1.2, 0.6), events=[limit])
    held = hb.follow(curve, "limit1", "zeta", (0.05, 0.06), steps=hb.StepControl(max_points=3))
    assert held.amplitude("H1") == pytest.approx(0.3, abs=1e-8)
    multipliers = hb.Event("mu", lambda point: abs(point.multipliers).max() - 0.9)
    with pytest.raises(ValueError, match="may use only the unknowns, parameters and problem of a point"):
        multipliers.equations(problem, "Omega", curve["limit1"])


def test_events_on_the_command_line(run, tmp_path):
    own = tmp_path / "mine.py"
    own.write_text(
        "import hbgear as hb\n"
        "hb.continuation.register_event(hb.Event('tall', lambda p: p.amplitude('max') - 1.3, 'deflection of 1.3'))\n"
        "@hb.mechanics.model\n"
        "def stop(zeta: float = 0.05) -> hb.System:\n"
        "    return hb.SpurPair(zeta=zeta).system()\n"
    )
    span = "--from 1.2 --to 0.6 --harmonics 8"
    code, out, _ = run(f"trace spur-pair {span} --event PK")
    assert code == 0 and "PK1" in out
    code, out, _ = run(f"trace {own}:stop {span} --event tall --event PK")
    assert code == 0 and "tall1" in out and "PK1" in out
    code, _, err = run(f"trace spur-pair {span} --event peak")
    assert code == 2 and "no event 'peak'; always located: LP, BP" in err
    _, text, _ = run("trace --help")
    assert "--event" in text and "PK" in text
