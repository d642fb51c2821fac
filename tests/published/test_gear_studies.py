"""What the studies of gears say comes out of them."""

import importlib

import pytest

pytestmark = pytest.mark.usefixtures("on_path")


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
