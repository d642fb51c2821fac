"""What the studies of gears say comes out of them."""

import importlib

import numpy as np
import pytest

pytestmark = pytest.mark.usefixtures("on_path")


@pytest.mark.slow
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


@pytest.mark.slow
def test_relief_cures_the_jump():
    """As drawn it jumps and a branch tends to infinity; with 12 um it still jumps, with 20 um it does not.

    Integration pair by pair, in steps of 100 r/min with a slightly larger damper: 11900 r/min with rising speed without
    relief, 8700 and 13300 r/min with 12 um, none with 20 um.
    """
    study = importlib.import_module("studies.gears.relief")
    plain, some, enough = study.run(quick=True)
    assert plain.jumps[-1] == (pytest.approx(11850, abs=20), 1) and plain.factor == np.inf
    assert [direction for _, direction in some.jumps][-2:] == [-1, 1]
    assert some.jumps[-1][0] == pytest.approx(13282, abs=20) and 3.0 < some.pair_factor < some.factor < 4.8
    assert enough.jumps == () and enough.factor == pytest.approx(1.94, abs=0.02)
    assert enough.ripple < plain.ripple / 5
    figure = study.plot((plain, some, enough))
    top = next(ax for ax in figure.axes if ax.get_xlabel() == "speed of the pinion [r/min]")
    assert len(top.get_legend().get_texts()) == 3
    assert study.report((plain, enough)).count("| none |") == 1
    assert "without a jump at 200 N m [um]: 20." in study.report((plain, some, enough))


@pytest.mark.slow
def test_the_secant_misses_jumps_that_the_pairs_of_teeth_have():
    """Without relief both have the same driving flanks and the same highest jump; with 12 um the secant has none."""
    study = importlib.import_module("studies.gears.mesh_models")
    plain, some = study.run(quick=True)
    assert plain.deviation("secant") == pytest.approx(0.0, abs=2e-4)
    assert not some.right("secant") and not some.cases["secant"].jumps and some.cases["teeth"].jumps
    assert "No jump in 1 cases" in study.report([plain, some])
    assert len(study.plot([plain, some]).axes) == 6


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


def test_a_drag_above_the_torque_of_the_engine_ends_rattle():
    """With 16 N m the force at low speed is that of rigid teeth, F_0 + F_2; with 4 N m they cross the backlash."""
    study = importlib.import_module("studies.gears.rattle")
    light, heavy = study.run(quick=True)
    assert (light.drag, heavy.drag) == (4.0, 16.0)
    base_radius = 0.5 * 0.075 * np.cos(np.radians(20.0))
    assert heavy.static == pytest.approx(16.0 / base_radius, rel=1e-9)
    assert heavy.force[0] == pytest.approx(heavy.static * (1 + heavy.ratio), rel=1e-4)
    assert light.travel.min() > study.HALF_BACKLASH > 50 * heavy.travel.max()
    assert light.force.min() > 5 * light.static and (np.diff(light.force) > 0).all()
    for one in (light, heavy):
        assert one.contact == pytest.approx(one.closed_form, rel=1e-8)
    assert len(study.plot((light, heavy)).axes[0].get_legend().get_texts()) == 2
    assert study.report((light, heavy)).count("of 3 |") == 2
