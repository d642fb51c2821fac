"""Coordinates without mass against closed forms, condensed systems and the limit of small masses."""

import numpy as np
import pytest
from machines import static_node

import hbgear as hb
from hbgear.continuation.solvers.newton import solve
from hbgear.harmonic.structure.linear_structure import LinearStructure

SPRING, DAMPER = 0.5, 0.3
STOP = hb.Unilateral(k=2.0, gap=0.2)


def maxwell(mass=0.0, direction=(1.0, 0.0), law=STOP):
    """Return a mass on a spring, with a Maxwell element: a spring and a damper in series."""
    K = np.array([[1 + SPRING, -SPRING], [-SPRING, SPRING]])
    element = hb.Element(list(direction), law, name="stop")
    return hb.System(np.diag([1.0, mass]), np.diag([0.02, DAMPER]), K, [element], hb.Load(cosine={1: [0.2, 0.0]}))


def motion(model, Omega=0.9, H=15):
    problem = hb.HarmonicBalance(model, H)
    X = solve(problem, problem.start(Omega=Omega), {"Omega": Omega}).X
    return problem, X


def test_maxwell_element_is_its_complex_stiffness():
    structure = LinearStructure(maxwell())
    assert len(structure.modes.poles) == 3
    for w in (0.1, 0.7, 1.4, 9.0):
        G = structure.modes.output @ (structure.modes.input / (1j * w - structure.modes.poles)[:, None])
        stiffness = 1j * w * SPRING * DAMPER / (SPRING + 1j * w * DAMPER)
        assert G[0, 0] == pytest.approx(1 / (1 - w**2 + 0.02j * w + structure.kr[0] + stiffness), rel=1e-12)


def test_a_campbell_diagram_has_the_roots_of_the_characteristic_polynomial():
    """A Maxwell element on a mass that turns, and a node without mass and damper between two springs.

    (s^2 + c0 s + k0 + k) (c s + k) = k^2 without gyroscopic terms; with them both whirls have (.. -+ i g Omega s).
    """
    k0, k, c0, c, g = 1.0, 1.5, 0.05, 0.6, 0.4
    one, zero = np.eye(2), np.zeros((2, 2))
    M, C = np.block([[one, zero], [zero, zero]]), np.block([[c0 * one, zero], [zero, c * one]])
    K = np.block([[(k0 + k) * one, -k * one], [-k * one, k * one]])
    G = np.zeros((4, 4))
    G[0, 1], G[1, 0] = g, -g
    stop = hb.Element([1.0, 0.0, 0.0, 0.0], hb.Unilateral(k=1.0, gap=1.0), name="stop")
    rotor = hb.System(M, C, K, [stop], speed=hb.mechanics.SpeedTerms(G))
    found = hb.analysis.campbell(rotor, (0.5, 2.0), {"shaft": 1.0}, points=4)
    for i, Omega in enumerate(found.Omega.tolist()):
        roots = [
            np.roots(np.polysub(np.polymul([1, c0 + sign * 1j * g * Omega, k0 + k], [c, k]), [k**2]))
            for sign in (1, -1)
        ]
        expected = np.concatenate(roots)
        expected = np.sort(expected[expected.imag > 1e-6].imag)
        np.testing.assert_allclose(np.sort(found.frequencies[i]), expected, rtol=1e-12)
    node = hb.System([[1.0, 0.0], [0.0, 0.0]], None, [[1.0, -1.0], [-1.0, 4.0]], [hb.Element([1.0, 0.0], stop.law)])
    frequencies = hb.analysis.campbell(node, (0.5, 2.0), points=2).frequencies
    np.testing.assert_allclose(frequencies, np.full((2, 1), np.sqrt(1.0 - 1.0 / 4.0)), rtol=1e-12)


@pytest.mark.parametrize("direction", [(1.0, 0.0), (0.0, 1.0), (1.0, -1.0)])
def test_multipliers_are_the_limit_of_small_masses(direction):
    problem, X = motion(maxwell(direction=direction))
    exact, errors = problem.multipliers(X, Omega=0.9), []
    assert len(exact) == 3
    for mass in (1e-4, 1e-5):
        small, found = motion(maxwell(mass, direction))
        mu = small.multipliers(found, Omega=0.9)
        errors.append(max(np.abs(mu - one).min() for one in exact[np.abs(exact) > 1e-3]))
    assert errors[0] < 5e-3 and errors[1] == pytest.approx(0.1 * errors[0], rel=0.1)  # first order in the mass


def test_static_nodes_are_those_of_a_condensed_system():
    (problem, X), (condensed, expected) = motion(static_node(STOP)), motion(static_node(STOP, condensed=True))
    np.testing.assert_allclose(X, expected, rtol=0, atol=1e-12)
    q, r = problem.motion(X, Omega=0.9), condensed.motion(expected, Omega=0.9)
    np.testing.assert_allclose(q[[0, 2]], r, rtol=0, atol=1e-12)
    node = (1.5 * q[0] + 0.7 * q[2] + 0.2 * np.eye(len(q[0]))[1]) / 2.2
    np.testing.assert_allclose(q[1], node, rtol=0, atol=1e-12)
    mu = [np.sort_complex(one.multipliers(x, Omega=0.9)) for one, x in ((problem, X), (condensed, expected))]
    np.testing.assert_allclose(*mu, rtol=0, atol=1e-11)


def test_a_curve_has_stability_and_folds():
    stop = hb.Unilateral(k=20.0, gap=0.2)
    curve = hb.trace(hb.HarmonicBalance(maxwell(law=stop), 15), "Omega", (0.6, 2.2))
    small = hb.trace(hb.HarmonicBalance(maxwell(1e-6, law=stop), 15), "Omega", (0.6, 2.2))
    assert curve.status.complete and [p.kind for p in curve.special] == [p.kind for p in small.special]
    np.testing.assert_allclose(
        [p.parameters["Omega"] for p in curve.special], [p.parameters["Omega"] for p in small.special], atol=2e-5
    )


@hb.mechanics.model
def self_excited(damping: float = 0.1) -> hb.System:
    K = np.array([[1 + SPRING, -SPRING], [-SPRING, SPRING]])
    return hb.System(np.diag([1.0, 0.0]), np.diag([damping, DAMPER]), K, [hb.Element([1.0, 0.0], hb.Cubic(1.0))])


@pytest.mark.slow
def test_the_hopf_point_of_a_maxwell_element_has_its_closed_form():
    """d s^3 + (k + c d) s^2 + (c k + d + k d) s + k has the roots +- i Omega where (k + c d)(c k + d + k d) = d k."""
    (hopf,) = hb.analysis.hopf_points(self_excited(), "damping", (0.1, -0.5))
    k, d, c = SPRING, DAMPER, hopf.value
    assert abs((k + c * d) * (c * k + d + k * d) - d * k) < 1e-12
    assert abs(hopf.Omega**2 - (c * k + d + k * d) / d) < 1e-11
    cycles = hb.analysis.limit_cycles(self_excited(), hopf, (-0.25, -0.15), harmonics=5)
    assert cycles.status.complete and abs(cycles.tracked["Omega"][0] - hopf.Omega) < 2e-3


def test_the_backbone_of_a_maxwell_element_is_the_limit_of_small_masses():
    found = [
        hb.analysis.backbone(maxwell(mass, law=hb.Cubic(1.0)), span=(0.01, 1.0), harmonics=5)
        for mass in (0.0, 1e-5, 1e-6)
    ]
    exact, *near = (np.array([one.tracked[name][-1] for name in ("Omega", "modal_damping")]) for one in found)
    coarse, fine = (np.abs(one - exact) for one in near)
    assert (coarse < 1e-4).all() and np.allclose(fine, 0.1 * coarse, rtol=0.1)  # first order in the mass


@pytest.mark.parametrize("mode", [1, 2])
def test_the_backbone_of_a_static_node_is_that_of_the_condensed_system(mode):
    a, b = (hb.analysis.backbone(static_node(STOP, c), mode=mode, span=(0.01, 1.0), harmonics=7) for c in (False, True))
    assert a.status.complete and len(a) == len(b)
    for name in ("Omega", "modal_damping"):
        np.testing.assert_allclose(a.tracked[name], b.tracked[name], rtol=0, atol=1e-10)


def _without(K, direction=(1.0, 0.0), C=0.0):
    element = hb.Element(list(direction), STOP, name="stop")
    return hb.System(np.diag([1.0, 0.0]), np.diag([0.1, C]), K, [element], hb.Load(cosine={1: [0.2, 0.0]}))


@pytest.mark.parametrize(
    ("model", "message"),
    [
        (_without([[1.0, 0.0], [0.0, 0.0]]), "coordinate 'q2' has no mass, no damping and no stiffness"),
        (
            _without([[2.0, -1.0], [-1.0, 1.0]], (0.0, 1.0)),
            "element 'stop' acts on coordinate 'q2' without mass and damping",
        ),
    ],
)
def test_coordinates_that_cannot_be_eliminated(model, message):
    with pytest.raises(ValueError, match=message):
        hb.HarmonicBalance(model, 5).start(Omega=1.0)


def _chain(count, damping, direct=True):
    """Return a chain of coordinates, every second one without mass, or the condensed chain of the others."""
    K = 2 * np.eye(count) - np.eye(count, k=1) - np.eye(count, k=-1)
    kept, left = np.arange(0, count, 2), np.arange(1, count, 2)
    if direct:
        M = np.diag(1.0 - np.arange(count) % 2)
        return hb.System(M, damping * M, K, [hb.Element(np.eye(count)[0], STOP)])
    K = K[np.ix_(kept, kept)] - K[np.ix_(kept, left)] @ np.linalg.solve(K[np.ix_(left, left)], K[np.ix_(left, kept)])
    unit = np.eye(len(kept))
    return hb.System(unit, damping * unit, K, [hb.Element(unit[0], STOP)])


@pytest.mark.parametrize("damping", [0.0, 0.02])
@pytest.mark.parametrize("turned", [False, True])
def test_many_coordinates_without_mass_or_damping(damping, turned):
    """Structures of more than 30 coordinates try real modes first, which need a regular M."""
    model, condensed = _chain(41, damping), LinearStructure(_chain(41, damping, direct=False))
    if turned:  # rounding in N^T C N is no damping
        Q = np.linalg.qr(np.random.default_rng(0).standard_normal((41, 41)))[0]
        M, C, K = (0.5 * (A + A.T) for A in (Q.T @ A @ Q for A in (model.M, model.C, model.K)))
        model = hb.System(M, C, K, [hb.Element(Q.T @ model.W[:, 0], STOP)])
    structure = LinearStructure(model)
    assert len(structure.modes.poles) == len(condensed.modes.poles) == 42
    for w in (0.7, 1.3):
        G, expected = (
            one.modes.output @ (one.modes.input / (1j * w - one.modes.poles)[:, None]) for one in (structure, condensed)
        )
        np.testing.assert_allclose(G, expected, rtol=1e-10)
