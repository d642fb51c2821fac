"""Certificates against numbers that were computed without hbgear, and against an independent interval checker.

The intervals of the folds of the spur pair come from another program in interval arithmetic, the special points of the
stop from a code with 30 digits. A claim whose motion, contact order or model is changed must not be proved.
"""

from __future__ import annotations

import copy
import dataclasses
import json
import math
import re
from decimal import Decimal
from fractions import Fraction
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from machines import single_mass

pytest.importorskip("flint")
pytest.importorskip("mpmath")

from truth.interval_checker import Checker

import hbgear as hb
from hbgear.analysis import Certificate, NotCertifiedError, certify
from hbgear.analysis.certificates.coefficients import coefficients_of

SPUR_FOLDS = {"LP1": ("0.7080316187218250", "0.7080316187218381"), "LP2": ("0.8284639843882141", "0.8284639843882173")}
"""Intervals of the folds of SpurPair(zeta=.05, F_m=.1, e=(.05,))."""

STOP_POINTS = {
    "PD2": "0.86396784958531215291",
    "PD1": "0.96254908803479464627",
    "LP2": "1.731365021391413406",
    "LP1": "1.2596146258363070128",
}
"""Special points of the stop with k = 1000, by a code with 30 digits; LP1 lies 4e-8 from a grazing point."""


def stop(k: float = 1e3) -> hb.System:
    """Return a mass with a stop."""
    return single_mass(hb.Unilateral(k=k, gap=0.5), F=0.3, name="stop")


@pytest.fixture(scope="module")
def spur() -> hb.Branch:
    return hb.trace(hb.ContactInstants(hb.SpurPair(zeta=0.05, F_m=0.1, e=(0.05,)), 8), "Omega", (0.9, 0.6))


@pytest.fixture(scope="module")
def hard() -> hb.Branch:
    return hb.trace(hb.ContactInstants(stop(), 8), "Omega", (2.2, 0.8))


@pytest.fixture(scope="module")
def fold(spur: hb.Branch) -> Certificate:
    return certify(spur["LP1"])


def inner(proof: Certificate) -> tuple[Fraction, Fraction]:
    return Fraction(proof.Omega[0]), Fraction(proof.Omega[1])


@pytest.mark.parametrize("label", SPUR_FOLDS)
def test_folds_of_the_spur_pair_lie_in_the_intervals_of_another_program(spur: hb.Branch, label: str) -> None:
    low, high = inner(certify(spur[label]))
    other = [Fraction(x) for x in SPUR_FOLDS[label]]
    assert other[0] <= low <= high <= other[1]
    assert high - low < Fraction(1, 10**20)


@pytest.mark.parametrize("label", STOP_POINTS)
def test_points_of_a_hard_stop_contain_the_numbers_of_another_code(hard: hb.Branch, label: str) -> None:
    low, high = inner(certify(hard[label]))
    digits = len(STOP_POINTS[label]) - 2
    rounding = Fraction(1, 10**digits)
    assert low - rounding <= Fraction(STOP_POINTS[label]) <= high + rounding
    assert high - low < Fraction(1, 10**20)


@pytest.mark.parametrize("harmonics", [12, 32])
def test_a_fold_of_harmonic_balance_leads_to_the_same_certificate(fold: Certificate, harmonics: int) -> None:
    curve = hb.trace(hb.HarmonicBalance(hb.SpurPair(), harmonics), "Omega", (0.9, 0.6))
    other = certify(curve["LP1"])
    assert inner(other)[0] <= inner(fold)[1] and inner(fold)[0] <= inner(other)[1]


def test_a_point_with_more_harmonics_than_its_curve() -> None:
    """The curve has H = 4, its fold has more; it is the same fold as in contact instants."""
    soft = single_mass(hb.Unilateral(k=6.0, gap=0.5), F=0.3, name="stop")
    fold = hb.trace(hb.HarmonicBalance(soft, 4), "Omega", (2.0, 1.0))["LP1"]
    proof = hb.analysis.certify(fold)
    assert fold.layout.harmonics > 4 and float(proof.Omega[0]) == pytest.approx(1.2583354666646203, abs=1e-12)


def test_grazing_points_of_a_linear_motion_are_roots_of_its_amplitude(hard: hb.Branch) -> None:
    """At the first grazing, |.3 / (1 - Omega^2 + .1 i Omega)| = .5, a quadratic equation of Omega^2."""
    proof = certify(hard["GR1"])
    linear = math.sqrt(1.99 / 2 + math.sqrt((1.99 / 2) ** 2 - 1 + 0.36))
    assert abs(float(proof.Omega[0]) - linear) < 1e-14 and float(proof.uniqueness) > 1e-12
    assert proof.stable and not proof.instants


# ---- the independent checker


@pytest.mark.parametrize("case", ["spur LP1", "spur LP2", "spur motion", "hard PD1", "hard LP2"])
def test_an_independent_checker_confirms_the_proof(case: str, spur: hb.Branch, hard: hb.Branch) -> None:
    name, label = case.split()
    curve = spur if name == "spur" else hard
    proof = certify(curve[12] if label == "motion" else curve[label])
    checker = Checker(proof.claim)
    image = checker.krawczyk("1e-18")
    assert image is not None, "no box of the checker is mapped into itself"
    assert checker.signs_hold(image)
    for i, bounds in enumerate(proof.instants):
        assert image[2 * i].low <= mpf(bounds[1]) and mpf(bounds[0]) <= image[2 * i].high
    if proof.kind != "motion":
        Omega = image[2 * checker.K]
        assert Omega.low <= mpf(proof.Omega[1]) and mpf(proof.Omega[0]) <= Omega.high
        assert Omega.high - Omega.low < 1e-30


def mpf(text: str) -> Any:
    import mpmath

    return mpmath.mpf(text)


def test_the_checker_rejects_a_perturbed_motion(fold: Certificate) -> None:
    claim = copy.deepcopy(fold.claim)
    claim["center"][4] = str(float(claim["center"][4]) + 1e-9)
    assert Checker(claim).krawczyk("1e-12") is None


def test_multipliers_satisfy_the_formula_of_liouville(spur: hb.Branch) -> None:
    """Product of the multipliers: exp(-2 zeta T) with T = 2 pi / Omega."""
    proof = certify(spur[12])
    mu = [complex(float(a), float(b)) for a, b, _ in proof.multipliers]
    assert abs(mu[0] * mu[1] - math.exp(-0.1 * 2 * math.pi / float(proof.Omega[0]))) < 1e-14
    np.testing.assert_allclose(np.sort_complex(mu), np.sort_complex(spur[12].multipliers), atol=1e-8)


def test_an_unstable_motion_is_proved_unstable(spur: hb.Branch) -> None:
    unstable = next(point for point in spur if point.stable is False)
    assert certify(unstable).stable is False


# ---- claims that are not true


def not_proved(claim: dict[str, Any], condition: str) -> str:
    with pytest.raises(NotCertifiedError) as caught:
        Certificate.of(claim, "")
    assert caught.value.condition == condition, caught.value
    return str(caught.value)


@pytest.mark.parametrize("entry", [0, 1, 4, 6])
def test_a_perturbed_motion_is_not_certified(fold: Certificate, entry: int) -> None:
    claim = copy.deepcopy(fold.claim)
    claim["center"][entry] = str(float(claim["center"][entry]) + 1e-9)
    claim["factor"] = "1.0"
    assert "existence" in not_proved(claim, "existence")


@pytest.mark.parametrize(("field", "value"), [("damping", "0.1000000001"), ("direction", ["1.0000000001"])])
def test_a_perturbed_model_is_not_certified(fold: Certificate, field: str, value: Any) -> None:
    claim = copy.deepcopy(fold.claim)
    claim["equations"]["elements"][0][field] = value
    not_proved(claim, "existence")


def test_a_wrong_order_of_contacts_is_not_certified(fold: Certificate) -> None:
    claim = copy.deepcopy(fold.claim)
    claim["order"]["switches"] = claim["order"]["switches"][::-1]
    not_proved(claim, "contact order")
    claim = copy.deepcopy(fold.claim)
    claim["order"]["before"] = [1]
    for switch in claim["order"]["switches"]:
        switch[2] = -switch[2]
    with pytest.raises(NotCertifiedError):
        Certificate.of(claim, "")


def test_a_contact_that_is_left_out_is_noticed() -> None:
    """The equations of a motion without contacts do not contain the stop; only the sign of the gap does."""
    far = single_mass(hb.Unilateral(k=10.0, gap=5.0), F=0.3, name="stop")
    curve = hb.trace(hb.ContactInstants(far, 4), "Omega", (0.9, 0.95))
    claim = certify(curve[0]).claim
    amplitude = 0.3 / abs(1 - 0.9**2 + 0.09j)
    for level, proved in ((amplitude * (1 + 1e-9), True), (amplitude * (1 - 1e-9), False)):
        element = claim["equations"]["elements"][0]
        element["breakpoints"], element["springs"][0]["corners"] = [repr(level)], [repr(level)]
        if proved:
            assert Certificate.of(claim, "").stable
        else:
            assert "stop" in not_proved(claim, "gaps")


def test_breakpoints_of_the_stiffness_may_not_be_left_out() -> None:
    teeth = hb.mechanics.Periodic.rectangular(high=1.16, low=0.76, share=0.6)
    curve = hb.trace(hb.ContactInstants(hb.SpurPair(stiffness=teeth, e=(0.01,)), 8), "Omega", (1.4, 1.38))
    proof = certify(curve[0])
    assert proof.stable and inner(proof)[0] == Fraction(repr(curve[0].parameters["Omega"]))
    claim = copy.deepcopy(proof.claim)
    order = claim["order"]
    order["switches"], order["turns"] = order["switches"][:1], order["turns"][:1]
    assert "breakpoints of the stiffness" in not_proved(claim, "contact order")


# ---- several coordinates, files, input


def two_masses() -> hb.System:
    """Return two masses, the first against a stop."""
    element = hb.Element([1.0, 0.0], hb.Unilateral(k=20.0, gap=0.5), name="stop")
    return hb.System(
        np.diag([1.0, 1.5]), 0.1 * np.eye(2), [[2.0, -1.0], [-1.0, 2.0]], [element], hb.Load(cosine={1: [0.3, 0.1]})
    )


def test_a_motion_of_two_masses_is_the_one_of_the_contact_instants() -> None:
    curve = hb.trace(hb.ContactInstants(two_masses(), 8), "Omega", (0.75, 0.76))
    proof = certify(curve[0])
    exact = curve[0].problem.exact_motion(curve[0].X, **curve[0].parameters)
    found = sorted(float(low) % (2 * math.pi) for low, _ in proof.instants)
    np.testing.assert_allclose(found, np.sort(exact.instants), atol=1e-9)
    mu = sorted((abs(complex(float(a), float(b))) for a, b, _ in proof.multipliers), reverse=True)
    np.testing.assert_allclose(mu, np.sort(np.abs(exact.multipliers))[::-1], atol=1e-8)


@pytest.mark.slow
def test_a_fold_with_harmonic_stiffness() -> None:
    curve = hb.trace(hb.HarmonicBalance(hb.SpurPair(eps=(0.1,), e=(0.03,)), 48), "Omega", (0.9, 0.6))
    proof = certify(curve["LP1"])
    low, high = inner(proof)
    assert high - low < Fraction(1, 10**15) and abs(float(low) - curve["LP1"].parameters["Omega"]) < 1e-8


def test_a_certificate_is_saved_as_exact_decimals_and_proved_again(fold: Certificate, tmp_path: Path) -> None:
    fold.save(tmp_path / "LP1.json")
    assert json.loads((tmp_path / "LP1.json").read_text())["claim"]["equations"]["elements"][0]["damping"] == "0.1"
    again = Certificate.load(tmp_path / "LP1.json")
    assert again.to_dict() == fold.to_dict()
    assert again.verify().Omega == fold.Omega
    with pytest.raises(ValueError, match="format"):
        Certificate.from_dict({"format": "another"})


@pytest.mark.parametrize(
    "change",
    [
        {"Omega": ("0.708", "0.709")},
        {"Omega": ("0.70802", "0.7080316187218310")},
        {"stable": False},
        {"kind": "GR"},
        {"uniqueness": 1.0},
        {"instants": ()},
        {"multipliers": (("1", "0", "1e-9"), ("0", "0", "2e-30"))},
    ],
)
def test_numbers_that_the_proof_does_not_give_are_refused(fold: Certificate, change: dict[str, Any]) -> None:
    """Wider intervals follow from the proof, other ones do not."""
    stated = dataclasses.replace(fold, **change)
    if change == {"Omega": ("0.708", "0.709")}:
        assert stated.verify().Omega == fold.Omega
        return
    with pytest.raises(
        NotCertifiedError, match=r"stated numbers: the proof gives a fold with Omega between 0\.7080316"
    ):
        stated.verify()


def test_a_damaged_claim_is_refused(fold: Certificate) -> None:
    claim = copy.deepcopy(fold.claim)
    claim["center"] = claim["center"][:2]
    with pytest.raises((ValueError, NotCertifiedError)):
        dataclasses.replace(fold, claim=claim).verify()


def test_the_sentence_states_proof_and_assumptions(fold: Certificate) -> None:
    assert "exactly one periodic motion with multiplier 1" in fold.statement and fold.Omega[0] in fold.statement
    assert "all other multipliers lie inside the unit circle" in fold.statement
    assert "exactly the decimals" in fold.assumptions and str(fold).count("\n") == 1


def test_bad_input() -> None:
    smooth = hb.trace(hb.HarmonicBalance(hb.Duffing(), 5), "Omega", (0.8, 1.6))
    with pytest.raises(NotCertifiedError, match="not piecewise linear"):
        certify(smooth["LP1"])
    with pytest.raises(TypeError):
        certify(1.0)  # type: ignore[arg-type]
    moved = hb.SpurPair(error=hb.mechanics.Periodic.trapezoidal(high=0.1, low=0.0, share=0.4, ramp=0.1))
    with pytest.raises(NotCertifiedError, match="displacement of gap has breakpoints"):
        coefficients_of(hb.HarmonicBalance(moved, 4).compiled({}).contact_equations)


def test_the_missing_library_is_named(monkeypatch: pytest.MonkeyPatch, spur: hb.Branch) -> None:
    monkeypatch.setitem(__import__("sys").modules, "flint", None)
    with pytest.raises(ValueError, match=r"hbgear\[certify\]"):
        certify(spur["LP1"])


def test_a_certificate_is_saved_with_its_curve(spur: hb.Branch, fold: Certificate, tmp_path: Path) -> None:
    certified = fold.attached_to(spur)
    certified.save(tmp_path / "pair.npz")
    loaded = hb.load(tmp_path / "pair.npz")
    again = Certificate.from_dict(loaded["LP1"].certificate)
    assert again.Omega == fold.Omega and again.claim == fold.claim and again.verify().stable
    assert loaded["LP2"].certificate is None and spur["LP1"].certificate is None
    with pytest.raises(ValueError, match=r"fold LP1 .* fits no special point"):
        fold.attached_to(hb.trace(hb.HarmonicBalance(hb.SpurPair(F_m=0.2), 4), "Omega", (0.9, 0.85)))


@pytest.mark.parametrize(
    "change", [{"format": "1"}, {"kind": "XX"}, {"Omega": ["0.7", "nan"]}, {"Omega": ["0.7"]}, {"claim": {}}]
)
def test_a_damaged_certificate_in_a_file_is_refused(
    spur: hb.Branch, fold: Certificate, tmp_path: Path, change: dict[str, Any]
) -> None:
    damaged = dataclasses.replace(spur["LP1"], certificate=fold.to_dict() | change)
    dataclasses.replace(spur, special=(damaged,)).save(tmp_path / "pair.npz")
    with pytest.raises(ValueError, match="certificate"):
        hb.load(tmp_path / "pair.npz")


def test_tables_figures_and_pages_mark_certified_points(spur: hb.Branch, fold: Certificate) -> None:
    from hbgear.analysis.summary import special_table
    from hbgear.io.branches.columns import columns_of
    from hbgear.web.view import views

    certified = fold.attached_to(spur)
    headers, rows = special_table(certified)
    enclosure = "0.70803161872183103 to 0.70803161872183104"
    assert headers[-1] == "certified Omega" and [row[-1] for row in rows if row[0] in SPUR_FOLDS] == [enclosure, ""]
    assert special_table(spur)[0] == headers[:-1]
    lower = columns_of(certified)["certified_lower"].values
    assert [text for text in lower if text] == [fold.Omega[0]] and "certified_lower" not in columns_of(spur)
    texts = {point["label"]: point["certified"] for point in views([certified], [""])[0]["special"]}
    assert texts["LP1"] == f"certified Omega: {enclosure}" and texts["LP2"] == ""
    axes = hb.plot.response(certified)
    filled = {line.get_gid(): line.get_markerfacecolor() for line in axes.get_lines() if line.get_gid() in SPUR_FOLDS}
    assert filled == {"LP1": "black", "LP2": "white"}
    assert sum("certified" in text for text in axes.get_legend_handles_labels()[1]) == 1


def test_the_enclosure_of_a_speed_contains_the_speed() -> None:
    """A speed is Omega times a scale, rounded outward; the bounds have the width of the last of 17 digits."""
    from hbgear.common.text.digits import outward

    low, high = outward(Decimal("7080.31618721831030101"), Decimal("7080.31618721831030102"))
    assert (low, high) == ("7080.3161872183103", "7080.3161872183104")
    assert outward(Decimal(-2), Decimal(-2)) == ("-2", "-2")


def test_the_command_writes_proofs_into_the_file_and_states_failures(tmp_path: Path) -> None:
    from typer.testing import CliRunner

    from hbgear.cli.app import app

    hb.trace(hb.HarmonicBalance(hb.SpurPair(), 16), "Omega", (0.9, 0.6)).save(tmp_path / "pair.npz")
    before = hb.load(tmp_path / "pair.npz")
    done = CliRunner().invoke(app, ["certify", str(tmp_path / "pair.npz"), "LP1", "-o", str(tmp_path / "LP1.json")])
    assert done.exit_code == 0 and "Proved:" in done.output and "0.70803161872183103" in done.output
    after = hb.load(tmp_path / "pair.npz")
    assert (after.X == before.X).all() and after.meta == before.meta
    assert Certificate.from_dict(after["LP1"].certificate).verify().stable
    assert Certificate.load(tmp_path / "LP1.json").to_dict() == after["LP1"].certificate
    assert "certified Omega" in CliRunner().invoke(app, ["info", str(tmp_path / "pair.npz")]).output
    hb.trace(hb.HarmonicBalance(hb.Duffing(), 5), "Omega", (0.8, 1.6)).save(tmp_path / "duffing.npz")
    refused = CliRunner().invoke(app, ["certify", str(tmp_path / "duffing.npz"), "LP1"])
    assert refused.exit_code == 1 and not (tmp_path / "duffing.LP1.json").exists()


def test_the_command_states_speeds_of_models_with_scales(tmp_path: Path) -> None:
    from typer.testing import CliRunner

    from hbgear.cli.app import app

    model = hb.SpurPair(reference=(38000.0, 37.6e-6, 15000.0, 25))
    path = str(tmp_path / "pair.npz")
    hb.trace(hb.ContactInstants(model), "Omega", (0.9, 0.6)).save(path)
    done = CliRunner().invoke(app, ["certify", path, "LP1"])
    speed = model.scales.pinion_speed(0.70803161872183103)
    found = re.search(r"with pinion r/min in \[([\d.]+), ([\d.]+)\]", done.output)
    assert done.exit_code == 0 and found is not None and "Omega" not in done.output
    assert float(found[1]) == pytest.approx(speed, rel=1e-14) and 0 <= float(found[2]) - float(found[1]) < 1e-11
    dimensionless = CliRunner().invoke(app, ["certify", path, "LP1", "--dimensionless"])
    assert "with Omega in [0.7080316187218310" in dimensionless.output


def test_a_grazing_next_to_a_breakpoint_of_the_stiffness_is_proved() -> None:
    """The sample of the gap nearest to the extremum is the breakpoint, in the segment after the one that grazes."""
    teeth = hb.mechanics.Periodic.rectangular(high=1.15196, low=0.88996, share=0.42)
    pair = hb.SpurPair(zeta=0.024, F_m=0.102, e=(0.068,), stiffness=teeth)
    point = hb.trace(hb.ContactInstants(pair), "Omega", (2.3, 0.6))["GR1"]
    proof = hb.analysis.certify(point)
    assert float(proof.Omega[0]) == pytest.approx(point.parameters["Omega"], abs=1e-11)


def test_contacts_of_a_symmetric_machine_are_named() -> None:
    stops = [hb.Element(row, hb.Unilateral(k=10.0, gap=0.5), name=f"stop {i + 1}") for i, row in enumerate(np.eye(2))]
    load = hb.Load(cosine={1: [0.3, 0.3]})
    machine = hb.System(np.eye(2), 0.1 * np.eye(2), [[1.5, -0.5], [-0.5, 1.5]], stops, load)
    curve = hb.trace(hb.ContactInstants(machine), "Omega", (1.6, 1.2))
    expected = r"instants of stop [12] and of stop [12] may coincide at phase .*: in a symmetric machine, model one"
    with pytest.raises(NotCertifiedError, match=expected):
        hb.analysis.certify(curve["LP1"])
    with pytest.raises(NotCertifiedError, match="contacts of stop 1, stop 2 graze at once"):
        hb.analysis.certify(curve["GR1"])


@pytest.mark.parametrize("label", STOP_POINTS)
def test_parallel_stops_are_proved_as_one_stop(label: str) -> None:
    """Two stops of k = 300 and 700 at one gap pass it at the same instants; together they are the stop of k = 1000."""
    parts = [hb.Element([1.0], hb.Unilateral(k=k, gap=0.5), name=f"stop {k:g}") for k in (300.0, 700.0)]
    curve = hb.trace(hb.ContactInstants(dataclasses.replace(stop(), elements=parts), 8), "Omega", (2.2, 0.8))
    low, high = inner(certify(curve[label]))
    rounding = Fraction(1, 10 ** (len(STOP_POINTS[label]) - 2))
    assert low - rounding <= Fraction(STOP_POINTS[label]) <= high + rounding


def test_dampers_of_parallel_stops_are_summed_as_decimals() -> None:
    """0.1 + 0.2 is 0.3 in decimals, not in binary numbers."""
    parts = [hb.Element([1.0], hb.Unilateral(k=k, gap=0.5), damping=c) for k, c in ((300.0, 0.1), (700.0, 0.2))]
    curve = hb.trace(hb.ContactInstants(dataclasses.replace(stop(), elements=parts), 8), "Omega", (1.2, 1.18))
    first = certify(curve[0]).claim["equations"]["elements"][0]
    assert first["damping"] == "0.3" and [spring["slopes"][1] for spring in first["springs"]] == ["300.0", "700.0"]


def test_stops_of_opposite_directions_at_one_place_are_advised() -> None:
    facing = [
        hb.Element([-1.0], hb.mechanics.PiecewiseLinear((-0.5,), (5.0, 0.0)), name="left"),
        hb.Element([1.0], hb.Unilateral(k=5.0, gap=0.5), name="right"),
    ]
    curve = hb.trace(hb.ContactInstants(dataclasses.replace(stop(), elements=facing), 8), "Omega", (1.2, 1.15))
    with pytest.raises(NotCertifiedError, match="elements in one direction are one contact only if"):
        certify(next(point for point in curve if 1 in point.regime))


def test_both_flanks_of_a_symmetric_gap_graze_at_once() -> None:
    curve = hb.trace(
        hb.ContactInstants(single_mass(hb.Backlash(b=0.3, k=10.0), F=0.3, name="gap")), "Omega", (2.2, 1.2)
    )
    with pytest.raises(NotCertifiedError, match="contacts of gap graze at once"):
        hb.analysis.certify(curve["GR1"])


def test_a_corner_that_is_no_breakpoint_is_noticed(fold: Certificate) -> None:
    claim = json.loads(json.dumps(fold.claim))
    claim["equations"]["elements"][0]["springs"][0]["corners"][0] = "-0.5"
    with pytest.raises(NotCertifiedError, match=r"corners of .* are missing among its breakpoints"):
        Certificate.of(claim, "")
