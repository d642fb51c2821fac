"""The lines on the reliability of a branch are true in all cases: determined, undecided and unknown stability."""

from dataclasses import replace

import numpy as np
import pytest
from machines import gear_pair

import hbgear as hb
from hbgear.analysis.summary import in_speeds, reliability_lines, speeds_of


@pytest.fixture(scope="module")
def curve():
    return hb.trace(hb.HarmonicBalance(hb.Duffing(), 8), "Omega", (0.5, 1.6))


def with_moduli(curve, first):
    """The branch without warnings, its first points with these moduli and errors of the largest multiplier."""
    multipliers = np.full((len(curve), 2), 0.5, dtype=complex)
    error = np.full(len(curve), 1e-6)
    for i, (modulus, its_error) in enumerate(first):
        multipliers[i], error[i] = modulus, its_error
    return replace(curve, multipliers=multipliers, modulus_error=error, special=(), jump_records=())


def test_all_points_determined(curve):
    first, *warnings = reliability_lines(curve)
    assert first.startswith("Estimated relative error: special points ")
    assert f"response {curve.relative_error:.0e}" in first
    assert first.endswith("; stability determined at all points") and not curve.undecided.any()
    assert warnings == [f"warning: {text}" for text in curve.warnings]


def test_undecided_points_are_counted(curve):
    branch = with_moduli(curve, [(1.0, 0.1), (1.0, 0.1)])
    assert branch.undecided.sum() == 2
    first, *warnings = reliability_lines(branch)
    assert first.endswith(f"; stability determined at {len(curve) - 2} of {len(curve)} points")
    assert any(line.startswith("warning: stability undecided at 2 points") for line in warnings)


def test_points_without_multipliers_are_counted(curve):
    branch = with_moduli(curve, [(np.nan, np.nan)])
    assert branch.stability[0] == "unknown"
    assert reliability_lines(branch)[0].endswith(f"; stability determined at {len(curve) - 1} of {len(curve)} points")


def test_warnings_do_not_replace_the_errors(curve):
    branch = with_moduli(curve, [(2.0, 1e-6)] * len(curve))
    first, *warnings = reliability_lines(branch)
    assert first == f"Estimated relative error: response {curve.relative_error:.0e}; stability determined at all points"
    assert any("no point of the curve is stable" in line for line in warnings)


def test_stability_that_was_not_computed_is_not_mentioned(curve):
    branch = replace(curve, multipliers=None)
    assert all("stability determined" not in line for line in reliability_lines(branch))


def test_the_reason_for_missing_stability_is_given(curve):
    branch = replace(curve, multipliers=None, meta={**curve.meta, "stability": "not available: no damping"})
    assert "; stability is not available: no damping" in reliability_lines(branch)[0]


def test_unknown_errors_are_named(curve):
    special = (replace(curve.special[0], error=np.nan), *curve.special[1:])
    assert f"(1 of {len(special)} unknown)" in reliability_lines(replace(curve, special=special))[0]
    branch = replace(curve, special=(), jump_records=(), error=np.full(len(curve), np.nan))
    assert reliability_lines(branch)[0].startswith("Estimated relative error: unknown; ")


def test_without_errors_of_special_points_those_of_the_points_are_stated(curve):
    """A branch of tori had no line, and its warnings were not shown."""
    special = tuple(replace(point, error=np.nan) for point in curve.special)
    branch = replace(curve, special=special, meta={**curve.meta, "trace": {"accuracy": None}})
    first, *warnings = reliability_lines(branch)
    assert first.startswith(f"Estimated relative error: special points unknown, response {curve.relative_error:.0e}; ")
    assert warnings == [f"warning: {text}" for text in branch.warnings]
    assert reliability_lines(replace(branch, error=np.full(len(curve), np.nan))) == []


def test_warnings_state_speeds_of_models_with_units():
    """A value of Omega with n digits is a speed with n - 1 digits, at least five."""
    pair = gear_pair()
    branch = hb.trace(hb.HarmonicBalance(pair.model("200 N m", 0.05), 4), "Omega", (0.31, 0.3), accuracy=None)
    factor = speeds_of(branch, branch[0])["pinion r/min"] / branch.values[0]
    text = "between Omega = 0.647487 and Omega = 0.123456789"
    assert in_speeds(branch, text) == f"between {0.647487 * factor:.5g} r/min and {0.123456789 * factor:.8g} r/min"
    assert in_speeds(branch, text, dimensionless=True) == text


def test_errors_of_special_points_near_zero_are_relative_to_a_thousandth_of_the_largest_value(curve):
    """A value of 2e-15 is no size: an error of 3e-15 is accurate on a curve up to 1.6."""
    special = tuple(
        replace(point, parameters={**point.parameters, "Omega": 2e-15}, error=3e-15) for point in curve.special
    )
    branch = replace(curve, special=special)
    largest = np.abs(curve.values).max()
    assert f"special points {3e-15 / (1e-3 * largest):.0e}" in reliability_lines(branch)[0]
    assert not any("accuracy" in warning for warning in branch.warnings)


def test_results_of_a_curve_have_a_short_text():
    """Interactive sessions print it; the arrays of a result are too long."""
    model = hb.Duffing()
    curve = hb.trace(hb.HarmonicBalance(model, 3), "Omega", (0.5, 1.6))
    up = hb.analysis.run_up(curve, "up")
    assert repr(up) == f"<RunUp up in Omega, LP1 at {up.jumps[0].value:.6g}; Omega = 1.6 reached>"
    jumps = hb.jump_map(model, "zeta", (0.05, 0.06), frequencies=(0.9, 1.4), harmonics=1, seeds=2)
    assert repr(jumps) == f"<JumpMap over zeta: 0.05 to 0.06, 2 arms, {jumps.cusps[0]!r}, reached_end>"
    diagram = hb.analysis.campbell(model, (0.5, 1.5))
    assert repr(diagram) == "<Campbell: Omega = 0.5 to 1.5, modes: 1, critical speeds: 1>"
    found = hb.analysis.machine_quantities(curve)
    assert repr(found).startswith(f"<MachineQuantities at {len(curve)} points: 'Omega [-]', ")
    ends = hb.time.basins(model, 0.8, shape=(2, 2))
    assert repr(ends) == "<Basins at Omega = 0.8: 4 starts, period 1, reached_end>"
