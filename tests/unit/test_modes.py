"""The modes of a structure in parts that do not mix: what is found in parts is what is found of the whole."""

import numpy as np
import pytest

from hbgear import Backlash, Cubic, DoubleHelicalPair, Element, HarmonicBalance, Load, SpurPair, System, trace
from hbgear.harmonic import floquet
from hbgear.harmonic.floquet import multipliers_of


def from_the_whole(problem, X, Omega, monkeypatch):
    """Multipliers with the modes in one part."""
    with monkeypatch.context() as patch:
        patch.setattr(floquet, "_alike", lambda compiled, parts, X: np.zeros(len(X), dtype=bool))
        return multipliers_of(problem.compiled({}), X, Omega)


def carried(monkeypatch):
    """Sizes of the parts that are carried, as they are asked for."""
    sizes, before = [], floquet.monodromies

    def seen(compiled, part, *args):
        sizes.append(part.size)
        return before(compiled, part, *args)

    monkeypatch.setattr(floquet, "monodromies", seen)
    return sizes


def same(found, expected):
    """Sets of multipliers (P, r) agree, each to the digits that a non-normal matrix leaves it."""
    for a, b in zip(found, expected, strict=True):
        left = list(b)
        for mu in a:
            nearest = min(left, key=lambda other, mu=mu: abs(other - mu))
            assert abs(nearest - mu) < 1e-9 * np.abs(b).max()
            left.remove(nearest)


def test_a_symmetric_pair_falls_into_two_parts(monkeypatch):
    """The double-helical pair along its response: contact of all kinds, both sides moving alike."""
    problem = HarmonicBalance(DoubleHelicalPair(), 8)
    curve = trace(problem, "Omega", (1.3, 0.7), stability=False, special=False)
    X, Omega = curve.X[::4], curve.values[::4]
    parts = problem.compiled({}).parts()
    assert len(parts.split) == 2 and sum(part.size for part in parts.split) == parts.whole.size
    assert all(part.size < parts.whole.size for part in parts.split)
    assert {len(problem.switching(x, Omega=w).theta) for x, w in zip(X, Omega, strict=True)} >= {0, 4}
    expected = from_the_whole(problem, X, Omega, monkeypatch)
    sizes = carried(monkeypatch)
    found = multipliers_of(problem.compiled({}), X, Omega)
    assert sizes == [part.size for part in parts.split] and found.shape == (len(X), parts.size)
    assert np.all(np.diff(np.abs(found)) <= 0)
    same(found, expected)


def test_a_motion_that_breaks_the_symmetry_is_not_split(monkeypatch):
    """One side moved off the other: its multipliers are those of the whole, and no longer those of the parts."""
    problem = HarmonicBalance(DoubleHelicalPair(zeta=0.05), 8)
    curve = trace(problem, "Omega", (1.1, 0.75), stability=False, special=False)
    place = int(np.argmax(curve.amplitude("pp2")))
    X, Omega = curve.X[place], np.full(2, curve.values[place])
    rows = X.reshape(2, -1).copy()
    np.testing.assert_allclose(rows[0], rows[1], rtol=0, atol=1e-12)
    rows[1, 1] += 0.05
    both = np.array([X, rows.ravel()])
    compiled = problem.compiled({})
    np.testing.assert_array_equal(floquet._alike(compiled, compiled.parts(), both), [True, False])
    expected, sizes = from_the_whole(problem, both, Omega, monkeypatch), carried(monkeypatch)
    same(multipliers_of(compiled, both, Omega), expected)
    assert sizes == [part.size for part in compiled.parts().split] + [compiled.parts().whole.size]
    with monkeypatch.context() as patch:
        patch.setattr(floquet, "_alike", lambda compiled, parts, X: np.ones(len(X), dtype=bool))
        split = multipliers_of(compiled, both[1:], Omega[1:])
    assert np.abs(np.sort(np.abs(split[0])) - np.sort(np.abs(expected[1]))).max() > 1e-4
    rows[1] = rows[0]
    rows[1, 1] += 1e-9
    assert not floquet._alike(compiled, compiled.parts(), rows.ravel()[None])[0]


def two(first, second, C=0.05):
    """Two equal masses joined by a spring, each with an element to the ground."""
    elements = [Element([1.0, 0.0], first), Element([0.0, 1.0], second)]
    M, K = np.eye(2), np.array([[1.2, -0.2], [-0.2, 1.2]])
    return HarmonicBalance(System(M, C * np.eye(2), K, elements, Load(cosine={1: [0.2, 0.2]})), 5)


def test_alike_are_elements_of_the_same_law_on_a_symmetric_structure():
    assert len(two(Cubic(0.3, 0.1), Cubic(0.3, 0.1)).compiled({}).parts().split) == 2
    assert len(two(Backlash(0.3), Backlash(0.3)).compiled({}).parts().split) == 2
    for problem in (two(Cubic(0.3, 0.1), Cubic(0.3, 0.2)), two(Backlash(0.3), Backlash(0.4)),
                    HarmonicBalance(SpurPair(), 5)):  # fmt: skip
        parts = problem.compiled({}).parts()
        assert parts.split == (parts.whole,)
    K = np.array([[1.2, -0.2], [-0.2, 1.7]])
    elements = [Element([1.0, 0.0], Cubic(0.3)), Element([0.0, 1.0], Cubic(0.3))]
    other = HarmonicBalance(System(np.eye(2), 0.05 * np.eye(2), K, elements, Load(cosine={1: [0.2, 0.2]})), 5)
    assert other.compiled({}).parts().split == (other.compiled({}).parts().whole,)


def test_modes_that_no_element_feels_keep_their_poles():
    """A mass that nothing joins to the others: exp(lambda 2 pi / Omega) of its own poles are among the multipliers."""
    M, C, K = np.diag([1.0, 2.0]), np.diag([0.1, 0.3]), np.diag([1.0, 5.0])
    problem = HarmonicBalance(System(M, C, K, [Element([1.0, 0.0], Backlash(0.3))], Load(cosine={1: [0.2, 0.0]})), 5)
    parts = problem.compiled({}).parts()
    own = np.roots([2.0, 0.3, 5.0])
    np.testing.assert_allclose(np.sort_complex(parts.idle), np.sort_complex(own), rtol=1e-12)
    assert parts.whole.size == 2 and parts.size == 4
    mu = problem.multipliers(problem.start(0.8), Omega=0.8)
    for value in np.exp(own * 2 * np.pi / 0.8):
        assert np.abs(mu - value).min() == pytest.approx(0.0, abs=1e-12)
