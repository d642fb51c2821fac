"""The marine double-helical pair: derived quantities and linear dynamics.

Source: Dong, Bi, Wen, Liu & Wang (2022), J. Low Freq. Noise Vib. Act. Control 41(2), 519-539, Tables 1 and 2, in the
reading documented at `DoubleHelicalPair`. The paper prints no natural frequencies; the numbers below come from
separate assemblies of the same equations in SI units. Tolerances are half a unit of the last printed digit.
"""

from typing import Any

import numpy as np
import pytest
from scipy.linalg import eig, eigh, null_space

from hbgear.gears import DoubleHelicalPair

FREQUENCIES = """
    0 .0424 .0811 .1579 .1689 .4042 .4589 .6608 .6762 1.0568 1.2545 1.4924
    1.787 1.7874 2.0464 2.2883 3.2848 3.3197 5.2188 5.2189 9.1937 9.1946 13.857 13.857
"""


# Tables 1 and 2, columns pinion and wheel, in SI units; no axial support is given for the pinion
TABLES = {
    "teeth_{}": (25, 75),
    "I_{}": (0.012, 0.7279),
    "m_{}": (7.11, 64.75),
    "outer_{}": (0.092, 0.260),
    "inner_{}": (0.055, 0.070),
    "k_{}x": (1.5424e9, 1.6741e9),
    "k_{}y": (1.5746e9, 4.5124e8),
    "k_{}z": (0.0, 1.3454e8),
    "c_{}x": (1.1745e5, 1.1500e5),
    "c_{}y": (3.7145e6, 3.6500e6),
    "c_{}z": (0.0, 0.2416e5),
    "k_{}thx": (2.3809e9, 2.3988e9),
    "k_{}thy": (3.3607e8, 3.3607e8),
}


@pytest.fixture(scope="module")
def pair():
    return DoubleHelicalPair()


def closed(system):
    """Stiffness with the mean mesh closed, K + W W^T: the contact stiffness is one."""
    return system.K + system.W @ system.W.T


def torques(system: Any):
    """The constant load (24,)."""
    (load,) = system.load
    return load.constant


def test_defaults_are_the_tables_and_the_documented_reading(pair):
    for name, values in TABLES.items():
        assert (getattr(pair, name.format("p")), getattr(pair, name.format("g"))) == values
    assert (pair.module, pair.alpha_n_deg, pair.beta_deg, pair.phi_deg) == (6e-3, 20.0, 24.43, 0.0)
    assert (pair.shaft_length, pair.face_width, pair.k_mean) == (58e-3, 55e-3, 1.8456e9)
    assert (pair.zeta, pair.eps, pair.e) == (0.063, (0.16, 0.07, 0.03), (0.03, 0.01, 0.01))
    assert (pair.torque, pair.b_c, pair.W, pair.E, pair.poisson) == (1400.0, 25e-6, 0.0, 2.06e11, 0.3)
    assert (pair.e_sign, pair.e_phase, pair.stagger, pair.eps_scale, pair.e_scale) == (-1, 0.0, 0.0, 1.0, 1.0)
    assert (pair.support_damping, pair.tilt, pair.mesh_helix) == ("tabulated", True, "pitch")


def test_geometry(pair):
    assert np.degrees(pair.alpha_t) == pytest.approx(21.79, abs=5e-3)
    assert pair.r_p == pytest.approx(76.490e-3, abs=5e-7)
    assert pair.r_g == pytest.approx(229.469e-3, abs=5e-7)


def test_reference_quantities(pair):
    assert pair.m_c == pytest.approx(1.78604, abs=5e-6)
    assert pair.omega_n == pytest.approx(32145.7, abs=0.05)
    assert pair.mesh_frequency(1.0) == pytest.approx(5116.15, abs=5e-3)
    assert pair.c_m == pytest.approx(7234.1, abs=0.05)


def test_undamped_natural_frequencies(pair):
    system = pair.system()
    squares = eigh(closed(system), system.M, eigvals_only=True)
    assert np.sqrt(np.abs(squares[0])) < 1e-6
    expected = [(float(text), len(text.partition(".")[2])) for text in FREQUENCIES.split()]
    assert len(squares) == len(expected) == 24
    for square, (frequency, digits) in zip(squares[1:], expected[1:], strict=True):
        assert np.sqrt(square) == pytest.approx(frequency, abs=0.51 * 10.0**-digits)


def test_damped_mode_near_the_jump(pair):
    system = pair.system()
    C = system.C + sum(e.damping * np.outer(e.direction, e.direction) for e in system.elements)
    own, nothing = np.eye(24), np.zeros((24, 24))
    values = eig(
        np.block([[nothing, own], [-closed(system), -C]]), np.block([[own, nothing], [nothing, system.M]]), right=False
    )
    near = values[np.argmin(np.abs(values - (-0.075 + 0.936j)))]
    assert near.real == pytest.approx(-0.0749, abs=5e-5)
    assert near.imag == pytest.approx(0.9359, abs=5.1e-5)


def test_the_only_free_motion_is_the_rotation_of_the_train(pair):
    system = pair.system()
    free = null_space(closed(system), rcond=1e-9)
    assert free.shape == (24, 1)
    np.testing.assert_allclose(system.W.T @ free, 0, atol=1e-12)
    turning = np.array([name.startswith("theta_") and name[6] in "pg" for name in system.dof_names])
    np.testing.assert_allclose(free[~turning, 0], 0, atol=1e-12)
    # scaled by the base radii, all four gears turn by the same length
    np.testing.assert_allclose(free[turning, 0], free[turning, 0][0], rtol=1e-9)
    np.testing.assert_allclose(free[:, 0] @ torques(system), 0, atol=1e-13)


@pytest.mark.parametrize("support", ["tabulated", "zeta"])
def test_static_gap_closure(support):
    pair = DoubleHelicalPair(torque=700.0, support_damping=support)
    system = pair.system()
    W, b = system.W, 1 + pair.W
    q, *_ = np.linalg.lstsq(closed(system), torques(system) + b * W.sum(axis=1), rcond=1e-10)
    np.testing.assert_allclose(closed(system) @ q, torques(system) + b * W.sum(axis=1), atol=1e-12)
    closure = (W.T @ q - b) * pair.b_c
    np.testing.assert_allclose(closure, 5.446e-6, atol=5e-10)


def test_y_supports_are_over_critical_as_published(pair):
    ratio = [
        c / (2 * np.sqrt(k * m)) for c, k, m in ((pair.c_py, pair.k_py, pair.m_p), (pair.c_gy, pair.k_gy, pair.m_g))
    ]
    np.testing.assert_allclose(ratio, [17.6, 10.7], atol=0.05)
