"""What the studies of gears say comes out of them."""

import importlib

import pytest

pytestmark = pytest.mark.usefixtures("on_path")


def test_planets_in_phase_and_one_after_the_other():
    """In phase the sun turns and rests in its bearings; else it moves sideways, and the symmetry breaks."""
    study = importlib.import_module("studies.gears.phasing")
    together, in_turn = study.run(quick=True)
    assert together.broken is None and in_turn.broken is not None
    assert together.largest("x_sun") < 1e-6 and together.largest("u_sun") == pytest.approx(1.36, abs=0.02)
    assert in_turn.largest("x_sun") == pytest.approx(3.08, abs=0.03)
    assert together.jumps == ["6414 -", "7049 +"] and len(in_turn.jumps) == 4
    figure = study.plot((together, in_turn))
    assert [ax.get_title() for ax in figure.axes[:2]] == ["in phase: 28, 36, 100 teeth", "sequential: 27, 35, 97 teeth"]


def test_relief_cures_the_jump():
    """As drawn it jumps at six speeds and carries ten times the static force; with 18 um, none, and 1.3 times."""
    study = importlib.import_module("studies.gears.relief")
    plain, some, enough = study.run(quick=True)
    assert len(plain.jumps) == 6 and plain.factor == pytest.approx(9.951, abs=0.02)
    assert [direction for _, direction in some.jumps] == [-1, 1] and some.jumps[-1][0] == pytest.approx(12795, abs=20)
    assert enough.jumps == () and enough.factor == pytest.approx(1.25, abs=0.02)
    assert enough.ripple < plain.ripple / 5
    figure = study.plot((plain, some, enough))
    top = next(ax for ax in figure.axes if ax.get_xlabel() == "speed of the pinion [r/min]")
    assert len(top.get_legend().get_texts()) == 3
    assert study.report((plain, enough)).count("| none |") == 1


def test_a_marine_pair_from_its_drawing():
    """Half the stiffness that is published, a third of its variation, and tests far below the resonance."""
    study = importlib.import_module("studies.gears.rig")
    found = study.run(quick=True)
    k = found.cycle.stiffness
    assert k.mean == pytest.approx(1.8456e9 / 2, rel=0.05)
    assert k.function().row(1)[1:] @ k.function().row(1)[1:] < (0.06 * k.mean) ** 2
    assert study.line(found.curves["from the drawing"], 8000, 1) > 1000
    assert study.line(found.curves["from the drawing"], 600, 1) != study.line(found.curves["as published"], 8000, 1)
    assert study.report(found).count("| 400 |") == 3
    assert len(study.plot(found).axes) == 2
