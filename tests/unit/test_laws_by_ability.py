"""Laws that are sums of piecewise-linear springs are treated as such, whoever wrote them."""

from dataclasses import dataclass

import numpy as np
import pytest
from machines import single_mass

import hbgear as hb
from hbgear import Backlash, Cubic, Unilateral
from hbgear.mechanics import Law, Parallel, PiecewiseLinear, Series
from hbgear.time.exponential.law_table import LawTable, as_one_spring

WAVY = Series(mean=1.0, cosine=(0.1, 0.02), sine=(0.05,))
SIDE_BY_SIDE = Parallel((Backlash(1.0, 1.0, WAVY), Unilateral(0.5, 1.6, WAVY.scaled(2.0))))
AS_ONE = PiecewiseLinear((-1.0, 1.0, 1.6), (1.0, 0.0, 1.0, 2.0), stiffness=WAVY)


@dataclass(frozen=True)
class Own(Law):
    """The same law as a class of its own, which says no more than the contract asks for."""

    @property
    def reference(self):
        return AS_ONE.reference

    @property
    def piecewise(self):
        return (AS_ONE,)

    def force(self, d, v, tau):
        return AS_ONE.force(d, v, tau)


def machine(law):
    return single_mass(law, mean=0.1, c=0.0, k=0.0, displacement=hb.mechanics.Series(cosine=(0.05,)), damping=0.08)


@pytest.mark.parametrize("law", [SIDE_BY_SIDE, Own()], ids=["Parallel", "own class"])
def test_the_same_law_written_differently(law, rng):
    """Residual, Jacobian, truncation error and multipliers are those of the law as one PiecewiseLinear."""
    one, other = (hb.HarmonicBalance(machine(each), 12) for each in (AS_ONE, law))
    assert other.smooth
    X = np.zeros(one.size)
    X[:3] = 1.1, 0.6, -0.2
    X += 0.02 * rng.standard_normal(one.size)
    for a, b in zip(one.evaluate(X, Omega=0.8), other.evaluate(X, Omega=0.8), strict=True):
        np.testing.assert_allclose(b, a, rtol=1e-13, atol=1e-13)
    np.testing.assert_allclose(other.truncation(X, Omega=0.8), one.truncation(X, Omega=0.8), rtol=1e-10)
    np.testing.assert_allclose(other.multipliers(X, Omega=0.8), one.multipliers(X, Omega=0.8), rtol=1e-10)


def test_folds_of_the_same_law_written_differently():
    curves = [hb.trace(hb.HarmonicBalance(machine(law), 10), "Omega", (1.2, 0.6)) for law in (AS_ONE, SIDE_BY_SIDE)]
    folds = [[point.parameters["Omega"] for point in curve.special if point.kind == "LP"] for curve in curves]
    assert len(folds[0]) >= 2 and all(p.located for curve in curves for p in curve.special if p.kind == "LP")
    np.testing.assert_allclose(folds[1], folds[0], rtol=1e-11)


@pytest.mark.parametrize("method", ["exponential", "DOP853"])
def test_time_integration_of_the_same_law_written_differently(method):
    pieces, same = (LawTable.of([law], as_one_spring) for law in (AS_ONE, SIDE_BY_SIDE))
    assert not same.in_python.any()
    for name in ("slope", "offset", "low", "high"):
        np.testing.assert_allclose(getattr(same, name), getattr(pieces, name), rtol=0, atol=1e-15)
    ends = [hb.time.integrate(machine(law), [1.3, 0.2], 3, 0.8, method=method).end for law in (AS_ONE, Own())]
    np.testing.assert_allclose(ends[1], ends[0], rtol=1e-12)


def test_single_springs_and_sums():
    assert SIDE_BY_SIDE.piecewise == (AS_ONE,)
    assert Parallel((SIDE_BY_SIDE, Backlash(1.0, 1.0, WAVY))).piecewise[0].slopes == (2.0, 0.0, 2.0, 3.0)
    assert len(Parallel((Backlash(1.0, 1.0, WAVY), Unilateral(0.5, 1.6))).piecewise) == 2
    assert Parallel((Backlash(), Cubic(0.1))).piecewise is None
    with_itself_less = Parallel((Backlash(), Backlash(stiffness=Series(mean=-1.0))))
    assert with_itself_less.piecewise[0].slopes == (0.0, 0.0, 0.0)


def test_contract_derives_values_from_the_springs():
    own = Own()
    assert (own.breakpoints, own.rated, own.steady, own.parts) == (AS_ONE.corners, False, False, (own,))
    assert Parallel((Backlash(), Cubic(0.1))).steady and not SIDE_BY_SIDE.steady
    assert Parallel((SIDE_BY_SIDE, Cubic(0.1))).parts == (*SIDE_BY_SIDE.laws, Cubic(0.1))


def test_negative_stiffness_of_a_part_is_reported():
    law = Parallel((Cubic(0.1), Backlash(stiffness=Series(mean=1.0, cosine=(1.5,)))))
    with pytest.warns(hb.mechanics.ImplausibleInputWarning, match="stiffness of element 1 is negative"):
        hb.HarmonicBalance(machine(law), 8)


class Stiff(Law):
    """A linear spring whose stiffness is a number in the place of as many as there are displacements."""

    reference = 1.0

    def force(self, d, v, tau):
        return 1.0 * d, np.float64(1.0), 0.0 * d


def test_a_law_of_its_own_that_gives_a_number_for_an_array_is_refused():
    with pytest.raises(ValueError, match=r"Stiff\.force must return .* the shape of d, \(\d+,\); got .* np\.full_like"):
        hb.HarmonicBalance(machine(Stiff()), 5).start(0.5)
