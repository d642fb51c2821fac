"""Values at which a jump vanishes against the folds of curves that are traced on both sides."""

import pytest

import hbgear as hb


@pytest.mark.slow
def test_a_jump_does_not_vanish_where_its_fold_grazes():
    """The fold curve turns twice there, at zeta = 0.0538231 and 0.0538314: the latter was the result."""
    stiffness = hb.mechanics.Periodic.rectangular(high=0.8, low=1.2, share=0.354)
    model = hb.SpurPair(zeta=0.0422, F_m=0.0762, stiffness=stiffness)
    critical = hb.analysis.critical_parameter(model, "zeta", frequencies=(0.3, 1.6))
    assert critical.jump_below
    for ratio, count in ((0.8, 2), (0.999, 2), (1.001, 0)):
        problem = hb.HarmonicBalance(model.replace(zeta=ratio * critical.value), 16)
        curve = hb.trace(problem, "Omega", (0.45, 0.52), stability=False)
        assert sum(point.kind == "LP" for point in curve.special) == count
