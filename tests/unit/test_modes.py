"""Independent parts of a structure and lumped modes give the same multipliers as the whole structure."""

import numpy as np
import pytest

from hbgear import Backlash, Cubic, Element, HarmonicBalance, Load, SpurPair, System, Unilateral, trace
from hbgear.gears import DoubleHelicalPair
from hbgear.harmonic.equations.motion import with_driven_harmonics
from hbgear.harmonic.multipliers import floquet
from hbgear.harmonic.multipliers.floquet import floquet_multipliers
from hbgear.harmonic.structure.linear_structure import LinearStructure
from hbgear.harmonic.structure.modes import SymmetricPair, _lumped
from hbgear.mechanics import Parallel


def from_the_whole(problem, X, Omega, monkeypatch):
    """Return the multipliers computed with all modes in one part."""
    with monkeypatch.context() as patch:
        patch.setattr(floquet, "_move_identically", lambda compiled, parts, X: np.zeros(len(X), dtype=bool))
        return floquet_multipliers(problem.compiled({}), X, Omega)


def recorded_sizes(monkeypatch):
    """Return a list that collects the sizes of the parts whose monodromy matrices are computed."""
    sizes, before = [], floquet.monodromies

    def recorded(compiled, part, *args):
        sizes.append(part.size)
        return before(compiled, part, *args)

    monkeypatch.setattr(floquet, "monodromies", recorded)
    return sizes


def same(found, expected):
    """Check that sets of multipliers (P, r) agree to 1e-9 of the largest one, the accuracy of a non-normal matrix."""
    for a, b in zip(found, expected, strict=True):
        left = list(b)
        for mu in a:
            nearest = min(left, key=lambda other, mu=mu: abs(other - mu))
            assert abs(nearest - mu) < 1e-9 * np.abs(b).max()
            left.remove(nearest)


def test_a_symmetric_pair_falls_into_two_parts(monkeypatch):
    """A double-helical pair along its response: both sides move identically, with and without contact loss."""
    problem = HarmonicBalance(DoubleHelicalPair(), 8)
    curve = trace(problem, "Omega", (1.3, 0.7), stability=False, special=False)
    X, Omega = curve.X[::4], curve.values[::4]
    parts = problem.compiled({}).stability_modes()
    assert len(parts.blocks) == 2 and sum(part.size for part in parts.blocks) == parts.coupled.size
    assert all(part.size < parts.coupled.size for part in parts.blocks)
    assert {len(problem.switching(x, Omega=w).theta) for x, w in zip(X, Omega, strict=True)} >= {0, 4}
    expected = from_the_whole(problem, X, Omega, monkeypatch)
    sizes = recorded_sizes(monkeypatch)
    found = floquet_multipliers(problem.compiled({}), X, Omega)
    assert sizes == [part.size for part in parts.blocks] and found.shape == (len(X), parts.size)
    assert np.all(np.diff(np.abs(found)) <= 0)
    same(found, expected)


def test_a_motion_that_breaks_the_symmetry_is_not_split(monkeypatch):
    """With one side displaced, multipliers are computed for the whole structure; the parts give different ones."""
    problem = HarmonicBalance(DoubleHelicalPair(zeta=0.05), 8)
    curve = trace(problem, "Omega", (1.1, 0.75), stability=False, special=False)
    place = int(np.argmax(curve.amplitude("pp2")))
    X, Omega = curve.X[place], np.full(2, curve.values[place])
    rows = X.reshape(2, -1).copy()
    np.testing.assert_allclose(rows[0], rows[1], rtol=0, atol=1e-12)
    rows[1, 1] += 0.05
    both = np.array([X, rows.ravel()])
    compiled = problem.compiled({})
    np.testing.assert_array_equal(floquet._move_identically(compiled, compiled.stability_modes(), both), [True, False])
    expected, sizes = from_the_whole(problem, both, Omega, monkeypatch), recorded_sizes(monkeypatch)
    same(floquet_multipliers(compiled, both, Omega), expected)
    assert sizes == [part.size for part in compiled.stability_modes().blocks] + [
        compiled.stability_modes().coupled.size
    ]
    with monkeypatch.context() as patch:
        patch.setattr(floquet, "_move_identically", lambda compiled, parts, X: np.ones(len(X), dtype=bool))
        split = floquet_multipliers(compiled, both[1:], Omega[1:])
    assert np.abs(np.sort(np.abs(split[0])) - np.sort(np.abs(expected[1]))).max() > 1e-4
    rows[1] = rows[0]
    rows[1, 1] += 1e-9
    assert not floquet._move_identically(compiled, compiled.stability_modes(), rows.ravel()[None])[0]


def two(first, second, C=0.05):
    """Two equal masses joined by a spring, each with an element to the ground."""
    elements = [Element([1.0, 0.0], first), Element([0.0, 1.0], second)]
    M, K = np.eye(2), np.array([[1.2, -0.2], [-0.2, 1.2]])
    return HarmonicBalance(System(M, C * np.eye(2), K, elements, Load(cosine={1: [0.2, 0.2]})), 5)


def test_alike_are_elements_of_the_same_law_on_a_symmetric_structure():
    assert len(two(Cubic(0.3, 0.1), Cubic(0.3, 0.1)).compiled({}).stability_modes().blocks) == 2
    assert len(two(Backlash(0.3), Backlash(0.3)).compiled({}).stability_modes().blocks) == 2
    for problem in (
        two(Cubic(0.3, 0.1), Cubic(0.3, 0.2)),
        two(Backlash(0.3), Backlash(0.4)),
        HarmonicBalance(SpurPair(), 5),
    ):
        parts = problem.compiled({}).stability_modes()
        assert parts.blocks == (parts.coupled,)
    K = np.array([[1.2, -0.2], [-0.2, 1.7]])
    elements = [Element([1.0, 0.0], Cubic(0.3)), Element([0.0, 1.0], Cubic(0.3))]
    other = HarmonicBalance(System(np.eye(2), 0.05 * np.eye(2), K, elements, Load(cosine={1: [0.2, 0.2]})), 5)
    assert other.compiled({}).stability_modes().blocks == (other.compiled({}).stability_modes().coupled,)


def test_modes_that_no_element_feels_keep_their_poles():
    """An uncoupled mass: exp(2 pi lambda / Omega) of its poles lambda are among the multipliers."""
    M, C, K = np.diag([1.0, 2.0]), np.diag([0.1, 0.3]), np.diag([1.0, 5.0])
    problem = HarmonicBalance(System(M, C, K, [Element([1.0, 0.0], Backlash(0.3))], Load(cosine={1: [0.2, 0.0]})), 5)
    parts = problem.compiled({}).stability_modes()
    own = np.roots([2.0, 0.3, 5.0])
    np.testing.assert_allclose(np.sort_complex(parts.omitted_poles), np.sort_complex(own), rtol=1e-12)
    assert parts.coupled.size == 2 and parts.size == 4
    mu = problem.multipliers(problem.start(0.8), Omega=0.8)
    for value in np.exp(own * 2 * np.pi / 0.8):
        assert np.abs(mu - value).min() == pytest.approx(0.0, abs=1e-12)


def chain(law, n=60, damping=0.02):
    """Return n masses between walls, driven at the first, with an element at the last, and the first frequency."""
    K = 2 * np.eye(n) - np.eye(n, k=1) - np.eye(n, k=-1)
    element = Element(np.eye(n)[-1], law, name="ground")
    system = System(np.eye(n), damping * K, K, [element], Load(cosine={1: 0.1 * np.eye(n)[0]}))
    return system, 2 * np.sin(np.pi / (2 * (n + 1)))


def flexibility(poles, output, input_, s):
    """Return the flexibility (m, m) at a complex frequency s as a sum over the modes."""
    return (output / (s - poles)) @ input_


@pytest.mark.parametrize("elements", [1, 2])
def test_one_mode_for_each_element_stands_for_many(elements):
    """Lumped modes keep the flexibility, damping and inertia of modes above a frequency: the error is O(s^3)."""
    system, w = chain(Cubic(k1=0.3, k3=0.5))
    more = [Element(np.eye(60)[20], Cubic(k1=0.3, k3=0.5), name=f"other {i}") for i in range(elements - 1)]
    system = System(system.M, system.C, system.K, [*system.elements, *more], system.loads)
    modes = LinearStructure(system).modes
    far = np.abs(modes.poles) > 10 * w
    many = modes.poles[far], modes.output[:, far], modes.input[far]
    few = _lumped(*many, np.eye(elements))
    assert len(few[0]) == 2 * elements and np.all(few[0].real < 0)
    s = 1j * w * np.array([0.2, 0.4])
    sizes = [np.abs(flexibility(*many, x)).max() for x in s]
    errors = [
        np.abs(flexibility(*many, x) - flexibility(*few, x)).max() / size for x, size in zip(s, sizes, strict=True)
    ]
    assert errors[0] < 1e-6 and errors[1] / errors[0] > 7.5


def test_modes_of_no_structure_are_not_lumped():
    """No lumped modes are returned for an unsymmetric or negative flexibility, or for an unstable mode."""
    poles = np.array([-0.1 + 5j, -0.1 - 5j, -0.2 + 9j, -0.2 - 9j])
    output = np.array([[1, 1, 1, 1], [1, 1, -1, -1]], dtype=complex)
    input_ = output.T / (2j * poles.imag)[:, None]
    assert _lumped(poles, output, input_, np.eye(2)) is not None
    assert _lumped(poles, output, input_ * [1.0, 2.0], np.eye(2)) is None
    assert _lumped(poles, output, -input_, np.eye(2)) is None
    growing = np.array([0.1 + 5j, 0.1 - 5j])
    one = np.ones((1, 2), dtype=complex)
    assert _lumped(growing, one, one.T / (2j * growing.imag)[:, None], np.eye(1)) is None


@pytest.mark.parametrize(
    ("law", "leading", "others"),
    [
        (Cubic(k1=0.0, k3=0.5), 1e-4, 1e-3),
        (Unilateral(k=1.0, gap=1.0), 1e-2, 3e-2),
        (Parallel((Cubic(k1=0.1, k3=0.2), Unilateral(k=0.2, gap=0.5))), 5e-3, 1e-2),
    ],
)
def test_few_modes_give_the_result_of_all(law, leading, others):
    """Errors of the largest and of the eight largest multipliers along the response, with far fewer modes."""
    system, w = chain(law)
    curve = trace(
        HarmonicBalance(system, 7), "Omega", (0.9 * w, 1.2 * w), special=False, stability=False, accuracy=None
    )
    some = slice(None, None, max(1, len(curve) // 12))
    X, Omega = curve.X[some], curve.values[some]
    few, all_ = (HarmonicBalance(system, 7, reduce=reduce).compiled({}) for reduce in (True, False))
    motions = with_driven_harmonics(all_, X, Omega)
    found, expected = floquet_multipliers(few, motions, Omega), floquet_multipliers(all_, motions, Omega)
    apart = np.abs(found[:, :8, None] - expected[:, None]).min(axis=2)
    assert apart[:, 0].max() < leading and apart.max() < others
    assert np.abs(found).max() < np.abs(expected).max() + leading
    sizes = [few.stability_modes(reach).coupled.size for reach in floquet._retained_frequency(few, motions, Omega)[0]]
    assert max(sizes) < 60 and few.stability_modes().coupled.size == 120
    if not law.breakpoints:
        assert min(sizes) < 20


def test_undamped_modes_that_are_left_out_do_not_hide_the_others():
    """A list of 32 multipliers, of 60 modes of which only the first ten are damped, has those of the slow modes.

    The reference are the multipliers of all modes.
    """
    system, w = chain(Cubic(k1=0.0, k3=5e-4))
    squares, V = np.linalg.eigh(system.K)
    system = system.replace(C=V @ np.diag(np.where(np.arange(60) < 10, 0.04, 0.0) * np.sqrt(squares)) @ V.T)
    few, all_ = (HarmonicBalance(system, 7, reduce=reduce).compiled({}) for reduce in (True, False))
    motion = 0.0 * np.arange(15.0)
    motion[1:3] = 3.0, -1.0
    motions, Omega = with_driven_harmonics(all_, motion[None], np.array([w])), np.array([w])
    found, expected = floquet_multipliers(few, motions, Omega)[0], floquet_multipliers(all_, motions, Omega)[0]
    slow = expected[np.abs(expected) < 0.999][:4]
    assert len(slow) == 4 and np.abs(found[:, None] - slow).min(axis=0).max() < 2e-3
    assert np.count_nonzero(found) < 32  # modes that are left out and do not grow are not listed


def test_residual_flexibility_of_modes_up_to_a_frequency():
    system, w = chain(Cubic(0.0, 0.5))
    compiled = HarmonicBalance(system, 3).compiled({})
    frequencies = np.array([0.5, 2.5, 7.3, 20.0, 1e3]) * w
    expected = [np.diag(compiled.stability_modes(one).flexibility) for one in frequencies.tolist()]
    np.testing.assert_allclose(compiled.flexibility_above(frequencies), expected, rtol=1e-12, atol=1e-15)
    assert compiled.flexibility_above(frequencies)[-1] == 0 < compiled.flexibility_above(frequencies)[-2]


@pytest.mark.parametrize("laws", [(0.5, 0.0, 0.0), (0.0, 0.5, 0.0), (0.5, 0.5, 0.3)])
def test_elements_of_one_law_on_different_springs_are_not_identical(laws):
    """Uncoupled oscillators at rest: mu = exp(s T) of each, also where two elements have one law without stiffness.

    Their slopes are relative to different reference springs, so that mean and difference couple.
    """
    stiffness, damping, Omega = np.array([1.0, 2.0, 3.3]), np.array([0.1, 0.2, 0.35]), 0.99
    elements = [Element(w, Cubic(k)) for w, k in zip(np.eye(3), laws, strict=True)]
    problem = HarmonicBalance(
        System(np.eye(3), np.diag(damping), np.diag(stiffness), elements, Load(cosine={1: [0.1, 0.0, 0.0]})), 3
    )
    found = floquet_multipliers(problem.compiled({}), np.zeros((1, problem.size)), np.array([Omega]))
    roots = -damping / 2 + 1j * np.sqrt(stiffness - damping**2 / 4)
    mu = np.exp(2 * np.pi / Omega * np.append(roots, roots.conj()))
    same(found, mu[None])


def test_ports_are_combinations_of_independent_ports():
    rng = np.random.default_rng(4)
    measure, action = rng.standard_normal((6, 3)), rng.standard_normal((2, 6))
    output, input_ = measure @ rng.standard_normal((3, 4)) * (1 + 0.5j), rng.standard_normal((4, 2)) @ action * (1 - 2j)
    flexibility = measure @ rng.standard_normal((3, 2)) @ action
    base = SymmetricPair.of(-np.arange(1.0, 5.0) + 1j, output, input_, np.arange(6), flexibility).base
    assert base.output.shape == (3, 4) and base.input.shape == (4, 2)
    np.testing.assert_allclose(base.measure @ base.output, output, atol=1e-13)
    np.testing.assert_allclose(base.input @ base.action, input_, atol=1e-13)
    np.testing.assert_allclose(base.measure @ base.flexibility @ base.action, flexibility, atol=1e-12)
