"""The study of random machines in quick form, and its error measures on cases with known results."""

import json
from dataclasses import replace
from pathlib import Path

import matplotlib
import numpy as np
import pytest

import hbgear as hb

pytestmark = pytest.mark.slow

matplotlib.use("Agg")


@pytest.fixture(scope="module")
def campaign():
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(str(Path(__file__).parents[2]))
        import studies.random.collecting as module

        yield module


@pytest.fixture(scope="module")
def results(campaign):
    from studies.random.campaign import run

    return run(quick=True)


def test_machines_depend_on_their_numbers_only(campaign):
    from studies.random.machines import KINDS

    assert len(KINDS) == 19
    for kind in KINDS:
        one, again, other = (campaign.machine(kind, i) for i in (4, 4, 5))
        problems = [hb.HarmonicBalance(m.model, 4) for m in (one, again, other)]
        A, B, C = (problem.evaluate(np.ones(problem.size), Omega=1.0)[0] for problem in problems)
        assert one.span == again.span and np.array_equal(A, B) and not np.array_equal(A, C)


def test_quick_form(campaign, results, tmp_path):
    assert len(results.ended) == 4 and not any(one.contradictions for one in results.ended)
    (compared,) = results.compared
    shot = [p for p in compared.points if p.by == "shooting"]
    assert len(shot) == 8 and all(p.error < 1e-5 for p in shot)
    assert compared.verdicts and not any(v.wrong for v in compared.verdicts)
    assert compared.jumps and all(j.right for j in compared.jumps)
    from studies.random.reporting import plot, report

    plot(results).savefig(tmp_path / "a.png")
    assert "| spur pairs | 1 |" in report(results)


def test_figure_and_table_have_all_kinds(campaign, tmp_path):
    from studies.random.machines import KINDS
    from studies.random.reporting import TITLES, plot, report

    ended = [campaign.TraceEnd(f"{kind}:0", "reached_end", 100, 0.1, 2) for kind in KINDS]
    results = campaign.Results(ended, [], 1.0)
    plot(results).savefig(tmp_path / "a.png")
    assert set(TITLES) == set(KINDS) and all(f"| {title} | 1 |" in report(results) for title in TITLES.values())


def test_it_goes_on_where_it_stopped(campaign, tmp_path, monkeypatch):
    first = campaign.collect({"spur": 2}, {}, 1, tmp_path)
    monkeypatch.setattr(campaign, "work", lambda *task: pytest.fail("a stored result was computed again"))
    again = campaign.collect({"spur": 2}, {}, 1, tmp_path)
    assert again.ended == first.ended
    (file,) = tmp_path.iterdir()
    file.write_text("{")
    monkeypatch.setattr(campaign, "work", lambda *task: [json.loads(json.dumps(vars(one))) for one in first.ended])
    assert campaign.collect({"spur": 2}, {}, 1, tmp_path).ended == first.ended


@pytest.mark.parametrize(
    ("model", "span", "kinds"),
    [(hb.SpurPair(e=(0.1,)), (2.2, 0.6), {"PD"}), (hb.SpurPair(), (1.5, 0.3), {"LP", "GR"})],
    ids=["doublings", "folds"],
)
def test_true_points_are_those_of_shooting(campaign, model, span, kinds):
    """With 6 harmonics the largest error exceeds 1e-6; points by shooting agree with 60 harmonics to 1e-7."""
    it = campaign.Machine("spur", 0, model, span)
    rough, middle, fine = (campaign.truth.traced(it, H, accuracy=None) for H in (6, 24, 60))
    found = campaign.truth.special_points(it, rough, middle, np.random.default_rng(0))
    assert {p.kind for p in found} == kinds and all(p.by == "shooting" for p in found)
    for p in found:
        nearest = min(abs(q.parameters["Omega"] - p.true) for q in fine.special if q.kind == p.kind)
        assert nearest < 1e-7 and nearest < max(1e-9, 0.1 * p.error)
    assert max(p.error for p in found) > 1e-6


def test_missing_and_false_points(campaign):
    it = campaign.Machine("spur", 0, hb.SpurPair(), (1.5, 0.3))
    curve = campaign.truth.traced(it, 16)
    fold = next(p for p in curve.special if p.kind == "LP")
    without = replace(curve, special=tuple(p for p in curve.special if p is not fold))
    (gone,) = [
        p for p in campaign.truth.special_points(it, without, curve, np.random.default_rng(0)) if np.isnan(p.Omega)
    ]
    assert gone.kind == "LP" and gone.true == pytest.approx(fold.parameters["Omega"], abs=1e-6)
    row = curve[len(curve) // 8]
    here = {**vars(fold), "X": row.X, "parameters": row.parameters, "index": len(curve) // 8, "label": "LP9"}
    more = replace(curve, special=(*curve.special, type(fold)(**here)))
    found = campaign.truth.special_points(it, more, curve, np.random.default_rng(0))
    (false,) = [p for p in found if np.isnan(p.true)]
    assert false.kind == "LP" and false.Omega == row.parameters["Omega"]


def test_verdicts_that_are_wrong_are_seen(campaign):
    it = campaign.Machine("spur", 0, hb.SpurPair(e=(0.1,)), (2.2, 0.6))
    curve = campaign.truth.traced(it, 16)
    finer = curve.problem.with_order(1, 40)
    right = campaign.truth.verdicts(it, curve, finer, np.random.default_rng(0))
    assert len(right) == campaign.truth.POINTS_PER_CURVE and not any(v.wrong for v in right)
    lies = replace(curve, multipliers=np.where(curve.stable[:, None], 1.5, 0.5) * np.ones_like(curve.multipliers))
    assert all(v.wrong for v in campaign.truth.verdicts(it, lies, finer, np.random.default_rng(0)))


def test_contradicted_ends_are_detected(campaign):
    it = campaign.Machine("spur", 0, hb.SpurPair(), (1.5, 0.3))
    curve = campaign.truth.traced(it, 8)
    assert list(campaign.contradictions(it, curve)) == []
    half = curve.values > 0.9
    names = ("values", "X", "iterations", "residual", "error", "step", "regime", "multipliers", "modulus_error")
    arrays = {name: getattr(curve, name)[half] for name in names}
    short = replace(curve, **arrays, special=(), jump_records=())
    found = list(campaign.contradictions(it, short))
    assert any("reached_end at" in text for text in found) and any("without a message" in text for text in found)
    assert any(
        "residual" in text for text in campaign.contradictions(it, replace(curve, residual=curve.residual + 1e-6))
    )
    far = replace(curve, meta={**curve.meta, "asymptotes": {"last": 0.7}})
    assert any("to infinity at 0.7" in text for text in campaign.contradictions(it, far))


def test_long_traces_are_interrupted(campaign, monkeypatch):
    monkeypatch.setattr(campaign, "SECONDS", 0.05)
    slow = campaign.Machine("two", 1, hb.SpurPair(), (1.5, 0.3))
    monkeypatch.setattr(
        campaign.truth,
        "traced",
        lambda it, H: hb.trace(
            hb.HarmonicBalance(it.model, 100), "Omega", it.span, steps=hb.StepControl(max_step=1e-4)
        ),
    )
    assert campaign.trace_end(slow).status == "interrupted"


@pytest.mark.parametrize(
    "kind, number, harmonics", [("bearings", 8, 10), ("bearings", 8, 12), ("helical", 47, 12), ("two", 22, 12)]
)
def test_the_parameter_turns_at_folds_only(on_path, kind, number, harmonics):
    """A turn without a fold means a missed fold, or special points in the wrong order along the curve."""
    from studies.random.machines import machine

    it = machine(kind, number)
    curve = hb.trace(hb.HarmonicBalance(it.model, harmonics), "Omega", it.span, cover=False)
    turns = 1 + np.flatnonzero(np.diff(np.sign(np.diff(curve.values))))
    folds = np.array([point.index for point in curve.special if point.kind == "LP"])
    assert len(turns) > 1 and np.abs(turns[:, None] - folds).min(axis=1).max() <= 1
    assert len(turns) == len(folds)


def test_two_doublings_near_a_grazing_contact_are_found(on_path):
    """Both lie within one step whose end points are stable; the reference has H = 48 and shorter steps."""
    from studies.random.machines import machine

    it = machine("helical", 113)
    curve = hb.trace(hb.HarmonicBalance(it.model, 16), "Omega", (0.36, 0.28), cover=False)
    found = [point for point in curve.special if 0.325 < point.parameters["Omega"] < 0.335]
    assert [point.kind for point in found] == ["PD", "GR", "PD"]
    first, _, second = (curve.values[point.index] for point in found)
    inside = curve.values[(curve.values < first) & (curve.values > second)]
    assert len(inside) and not curve.stable[np.isin(curve.values, inside)].any()
    short = hb.StepControl(max_step=0.002)
    fine = hb.trace(hb.HarmonicBalance(it.model, 48), "Omega", (0.333, 0.328), steps=short, accuracy=None, cover=False)
    places = [point.parameters["Omega"] for point in fine.special if point.kind == "PD"]
    assert len(places) == 2
    for point, place in zip((found[0], found[2]), places, strict=True):
        assert abs(point.parameters["Omega"] - place) < 3 * point.error


@pytest.mark.parametrize(
    "kind, number, harmonics, way, between, shot",
    [
        ("helical", 0, 16, 1, (0.3164, 0.3171), (0.316600628842, 0.317018689341)),
        ("bearings", 11, 16, 1, (0.3474, 0.3476), (0.347489101730,)),
        ("bearings", 8, 16, -1, (0.46624, 0.4664), (0.466254838821, 0.466288418686, 0.466368069970)),
        ("bearings", 2, 16, -1, (0.7475, 0.74755), (0.747522733085,)),
    ],
)
def test_pairs_that_change_sides_often_on_a_step_are_where_shooting_has_them(
    on_path, kind, number, harmonics, way, between, shot
):
    """Neimark-Sacker points agree with shooting within three error estimates: two on the step of other special points;
    one that requires more harmonics; three crossings of the unit circle by one pair on a step; one of a pair that
    becomes real near a period doubling and a fold.
    """
    from studies.random.machines import machine

    it = machine(kind, number)
    curve = hb.trace(hb.HarmonicBalance(it.model, harmonics), "Omega", it.span[::way], cover=False)
    found = [p for p in curve.special if p.kind == "NS" and between[0] < p.parameters["Omega"] < between[1]]
    assert len(found) == len(shot)
    for point, place in zip(sorted(found, key=lambda p: p.parameters["Omega"]), shot, strict=True):
        assert abs(point.parameters["Omega"] - place) < 3 * point.error < 3e-5


@pytest.mark.parametrize("seed", [0, 3])
def test_rounding_does_not_decide_which_pairs_are_found(on_path, seed):
    """Two pairs leave the unit circle within 6e-5 of Omega, one after a return a step before; starts vary by 1e-12."""
    from studies.random.machines import machine

    it = machine("helical", 0)
    problem = hb.HarmonicBalance(it.model, 16)
    X = problem.start(Omega=it.span[0])
    moved = X * (1 + 1e-12 * np.random.default_rng(seed).standard_normal(len(X)))
    curve = hb.trace(problem, "Omega", it.span, moved)
    found = sorted(
        p.parameters["Omega"] for p in curve.special if p.kind == "NS" and 0.325 < p.parameters["Omega"] < 0.33
    )
    assert found == pytest.approx([0.3251643, 0.3252347, 0.3280795, 0.3298697, 0.3299181], abs=1e-6)  # with H = 64


def test_jumps_do_not_depend_on_the_points_of_a_curve(on_path):
    """A fold and a Neimark-Sacker point on one step, stable between them: both directions give the same jumps."""
    from studies.random.machines import machine

    problem = hb.HarmonicBalance(machine("bearings", 2).model, 16)
    up, down = (hb.trace(problem, "Omega", span, cover=False) for span in ((0.3, 0.45), (0.45, 0.3)))
    jumps = [sorted((jump.value, jump.direction) for jump in curve.jumps()) for curve in (up, down)]
    # at the period doubling in front of LP5 integration continues with twice the period: no jump
    assert len(jumps[0]) == 5 and np.allclose(*jumps, rtol=0, atol=1e-8)
    for curve in (up, down):
        ends = [p.index for p in curve.special if p.located and p.kind in ("LP", "PD", "NS", "BP")]
        assert len(ends) > 8 and min(np.diff(ends)) > 1
        assert np.isfinite(curve.multipliers[: max(ends)]).all()
