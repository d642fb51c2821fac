"""Shipped models: their equations against the same written by hand, units, ranges, and the catalogue."""

import dataclasses
import json
from typing import Any

import numpy as np
import pytest

from hbgear.common.text.symbols import unit_of
from hbgear.gears import DoubleHelicalPair, SpurPair
from hbgear.gears.drawing.geometry import base_helix_angle, base_radius, shaft_stiffness, transverse_pressure_angle
from hbgear.harmonic.models.model_registry import MODELS, build, rebuild_model
from hbgear.mechanics.models import System, describe
from hbgear.mechanics.oscillators import Duffing
from hbgear.mechanics.series.fourier import evaluate

TAU = np.linspace(0.1, 6.4, 40)
OMEGA = 0.83


def random_motion(seed, n, scale=1.0, H=4):
    """Rows (n, 2H + 1) of a smooth random motion, and a function of the order of the time derivative."""
    rows = scale * np.random.default_rng(seed).normal(size=(n, 2 * H + 1))
    return lambda order: OMEGA**order * evaluate(rows, TAU, order)


def imbalance(system, q, dq, ddq):
    """Left minus right side (n, T) of the equations of motion of hbgear.model at the phases TAU."""
    out = system.M @ ddq + system.C @ dq + system.K @ q
    for element in system.elements:
        w, e = np.asarray(element.direction), element.displacement.row()
        d, v = w @ q - evaluate(e, TAU), w @ dq - OMEGA * evaluate(e, TAU, 1)
        out = out + np.outer(w, element.law.force(d, v, TAU)[0] + element.damping * v)
    for load in system.load:
        for order, amplitude in load.complex(system.n).items():
            out = out - OMEGA**load.power * np.outer(amplitude, np.exp(1j * order * TAU)).real
    return out


def backlash(d, b):
    return np.sign(d) * np.maximum(np.abs(d) - b, 0.0)


def test_duffing_equation():
    model = Duffing(zeta=0.07, k3=-0.3, F=0.4)
    x = random_motion(1, 1)
    expected = x(2) + 0.14 * x(1) + x(0) - 0.3 * x(0) ** 3 - 0.4 * np.cos(TAU)
    np.testing.assert_allclose(imbalance(model.system(), x(0), x(1), x(2)), expected, atol=1e-12)


@pytest.mark.parametrize(("phase", "wave"), [("cos", np.cos), ("sin", np.sin)])
def test_spur_pair_equation(phase, wave):
    eps, e = (0.2, -0.1), (0.05, 0.02, -0.01)
    model = SpurPair(zeta=0.04, F_m=0.15, eps=eps, e=e, phase=phase, b=0.7, eps_scale=1.5, e_scale=0.5)
    x = random_motion(2, 1)
    assert np.ptp(np.sign(backlash(x(0), 0.7))) == 2  # meets both flanks
    k = 1 - 1.5 * sum(a * np.cos(o * TAU) for o, a in enumerate(eps, 1))
    excitation = 0.5 * sum((o * OMEGA) ** 2 * a * wave(o * TAU) for o, a in enumerate(e, 1))
    expected = x(2) + 0.08 * x(1) + k * backlash(x(0), 0.7) - 0.15 - excitation

    # q = x + e(tau), its derivatives with the excitation's own second derivative e'' = -(l Omega)^2 e
    def error(order):
        turn = 0 if phase == "cos" else -np.pi / 2
        return 0.5 * sum(
            (o * OMEGA) ** order * a * np.cos(o * TAU + turn + order * np.pi / 2) for o, a in enumerate(e, 1)
        )

    q, dq, ddq = (x(order) + error(order) for order in range(3))
    np.testing.assert_allclose(imbalance(model.system(), q, dq, ddq), expected, atol=1e-12)


def test_spur_pair_without_series_or_gap_is_linear():
    model = SpurPair(e=(), eps=(), b=0.0, zeta=0.1, F_m=0.2)
    x = random_motion(3, 1)
    expected = x(2) + 0.2 * x(1) + x(0) - 0.2
    np.testing.assert_allclose(imbalance(model.system(), x(0), x(1), x(2)), expected, atol=1e-13)


def gap_by_hand(m, q, h, psi, beta, r):
    """Eq. (16) of Dong et al. (2022) without the error, of the helix with hand h; q["p"], q["g"] are (6, T)."""
    x, y, z = q["p"][:3] - q["g"][:3]
    tx, ty, t = r["p"] * q["p"][3:] - r["g"] * q["g"][3:]
    tilt = tx * np.sin(psi) + ty * np.cos(psi) if m.tilt else 0.0
    return (x * np.sin(psi) + y * np.cos(psi) + t) * np.cos(beta) + h * (z + tilt) * np.sin(beta)


def mesh_force_by_hand(m, gap, dgap, tau, omega, m_c):
    """k_mean k(tau) f(d) + c_m d' of one helix, d = gap - e(tau)."""
    orders = np.arange(1, 4)[:, None]
    k = 1 - m.eps_scale * np.array(m.eps) @ np.cos(orders * tau)
    size = m.e_sign * m.e_scale * m.b_c * np.array(m.e)
    d = gap - size @ np.sin(orders * (tau - m.e_phase))
    v = dgap - size @ (orders * omega * np.cos(orders * (tau - m.e_phase)))
    return m.k_mean * k * backlash(d, m.b_c * (1 + m.W)) + 2 * m.zeta * np.sqrt(m_c * m.k_mean) * v


def node_by_hand(m, gear, h, own, other, F, beta, psi, r):
    """Eqs. (3)-(6) for one node: left minus right side (6, T); own and other (3, 6, T) hold q, q', q''."""
    sign = 1 if gear == "p" else -1
    m_i, I_i, r_i = getattr(m, f"m_{gear}"), getattr(m, f"I_{gear}"), r[gear]
    D, d, length = getattr(m, f"outer_{gear}"), getattr(m, f"inner_{gear}"), m.shaft_length
    bend = 12 * m.E * np.pi * (D**4 - d**4) / 64 / length**3
    axial = m.E * np.pi * (D**2 - d**2) / 4 / length
    twist = m.E / (2 * (1 + m.poisson)) * np.pi * (D**4 - d**4) / 32 / length
    cb, sb, sp, cp = np.cos(beta), np.sin(beta), np.sin(psi), np.cos(psi)
    arm = h * r_i * sb * m.tilt
    table = [
        (m_i, "x", bend, F * cb * sp),
        (m_i, "y", bend, F * cb * cp),
        (m_i, "z", axial, F * h * sb),
        (I_i, "thx", 0.0, F * arm * sp),
        (I_i, "thy", 0.0, F * arm * cp),
        (I_i, "", twist, F * r_i * cb - m.torque * r_i / r["p"]),
    ]
    rows = []
    for a, (inertia, name, k_shaft, mesh) in enumerate(table):
        k = getattr(m, f"k_{gear}{name}") if name else 0.0
        tabulated = len(name) == 1 and m.support_damping == "tabulated"
        c = getattr(m, f"c_{gear}{name}") if tabulated else 2 * m.zeta * np.sqrt(k * inertia)
        c_shaft = 2 * m.zeta * np.sqrt(k_shaft * inertia / 2)
        (q, dq, ddq), (qo, dqo, _) = own[:, a], other[:, a]
        rows.append(inertia * ddq + c * dq + k * q + c_shaft * (dq - dqo) + k_shaft * (q - qo) + sign * mesh)
    return np.array(rows)


def marine_pair_by_hand(m, motion):
    """Left minus right side (24, T) in SI units; motion (3, 24, T) holds q, q', q'' at the phases TAU."""
    alpha_n, beta, phi = np.radians([m.alpha_n_deg, m.beta_deg, m.phi_deg])
    alpha_t = np.arctan(np.tan(alpha_n) / np.cos(beta))
    r = {i: m.module * z * np.cos(alpha_t) / 2 / np.cos(beta) for i, z in (("p", m.teeth_p), ("g", m.teeth_g))}
    m_c = 1 / (r["p"] ** 2 / m.I_p + r["g"] ** 2 / m.I_g)
    omega = OMEGA * np.sqrt(m.k_mean / m_c)
    if m.mesh_helix == "base":
        beta = np.arctan(np.tan(beta) * np.cos(alpha_t))
    node = dict(zip(("pL", "gL", "pR", "gR"), np.split(motion, 4, axis=1), strict=True))
    out = []
    for side, h, lag in (("L", 1, 0.0), ("R", -1, m.stagger)):
        gap, dgap, _ = (
            gap_by_hand(m, {i: node[i + side][o] for i in "pg"}, h, alpha_t - phi, beta, r) for o in range(3)
        )
        F = mesh_force_by_hand(m, gap, dgap, TAU - lag, omega, m_c)
        other = "R" if side == "L" else "L"
        out += [node_by_hand(m, i, h, node[i + side], node[i + other], F, beta, alpha_t - phi, r) for i in "pg"]
    return np.concatenate(out)


READINGS: list[dict[str, Any]] = [
    {},
    {"e_sign": 1, "e_phase": 0.7, "stagger": 2.0, "W": -0.4, "e_scale": 3.0, "eps_scale": 1.2},
    {"support_damping": "zeta", "mesh_helix": "base", "zeta": 0.1, "b_c": 40e-6},
    {"tilt": False, "phi_deg": 50.0, "torque": 300.0, "k_pz": 1e8, "c_pz": 2e4, "teeth_g": 60},
    {"W": -1.0, "beta_deg": -15.0},
]


@pytest.mark.parametrize("changes", READINGS)
def test_double_helical_equations_against_si_by_hand(changes):
    m = DoubleHelicalPair(**changes)
    motion = random_motion(4, 24)
    q, dq, ddq = (motion(order) for order in range(3))
    units = np.array([m.b_c] * 3 + [m.b_c / m.r_p] * 3 + [m.b_c] * 3 + [m.b_c / m.r_g] * 3)
    units = np.tile(units, 2)[:, None]
    np.testing.assert_allclose(m.units, units[:, 0], rtol=1e-14)
    physical = units * np.array([q, m.omega_n * dq, m.omega_n**2 * ddq])
    # virtual work of one unit of each coordinate, in units of k_mean b_c^2
    expected = marine_pair_by_hand(m, physical) * units / (m.k_mean * m.b_c**2)
    np.testing.assert_allclose(imbalance(m.system(), q, dq, ddq), expected, rtol=1e-9, atol=1e-9)


def test_double_helical_matrices_are_symmetric_and_dampers_do_not_feed():
    for changes in READINGS:
        system = DoubleHelicalPair(**changes).system()
        for matrix in (system.M, system.C, system.K):
            np.testing.assert_array_equal(matrix, matrix.T)
            assert np.linalg.eigvalsh(matrix)[0] > -1e-9 * np.abs(matrix).max()


def test_double_helical_names():
    system = DoubleHelicalPair().system()
    assert system.dof_names[:7] == ("x_pL", "y_pL", "z_pL", "theta_x_pL", "theta_y_pL", "theta_pL", "x_gL")
    assert system.dof_names[12] == "x_pR" and system.dof_names[-1] == "theta_gR"
    assert [element.name for element in system.elements] == ["gap L", "gap R"]


def test_default_error_is_minus_the_sine_series():
    m = DoubleHelicalPair()
    expected = -sum(e * np.sin(o * TAU) for o, e in enumerate((0.03, 0.01, 0.01), 1))
    for element in m.system().elements:
        np.testing.assert_allclose(element.displacement(TAU), expected, atol=1e-15)


def test_frequency_and_speed():
    m = DoubleHelicalPair()
    assert m.mesh_frequency(1.0) == pytest.approx(m.omega_n / (2 * np.pi), rel=1e-14)
    # 1200 r/min with 25 teeth is 500 Hz
    assert m.mesh_frequency(m.from_pinion_speed(1200.0)) == pytest.approx(500.0, rel=1e-13)
    assert m.pinion_speed(m.from_mesh_frequency(500.0)) == pytest.approx(1200.0, rel=1e-13)
    values = np.array([0.2, 0.9, 1.6])
    np.testing.assert_allclose(m.from_mesh_frequency(m.mesh_frequency(values)), values, rtol=1e-14)
    np.testing.assert_allclose(m.from_pinion_speed(m.pinion_speed(values)), values, rtol=1e-14)


def test_geometry_relations():
    alpha_n, beta = np.radians(20), np.radians(24.43)
    alpha_t = transverse_pressure_angle(alpha_n, beta)
    assert np.tan(base_helix_angle(alpha_n, beta)) == pytest.approx(np.tan(beta) * np.cos(alpha_t), rel=1e-14)
    assert base_radius(40, 2e-3, alpha_n, 0.0) == pytest.approx(0.04 * np.cos(alpha_n), rel=1e-14)
    # a solid shaft of 0.1 m diameter and 1 m length, E = 200 GPa, G = 80 GPa
    steel = shaft_stiffness(2e11, 0.25, 0.1, 0.0, 1.0)
    assert steel.bending == pytest.approx(11780972.45, abs=0.01)
    assert steel.axial == pytest.approx(1570796326.8, abs=0.1)
    assert steel.torsional == pytest.approx(785398.16, abs=0.01)


@pytest.mark.parametrize(
    ("cls", "fields", "message"),
    [
        (Duffing, {"zeta": -0.1}, "zeta = -0.1 must not be negative"),
        (Duffing, {"F": np.inf}, "F = inf must be a finite number"),
        (SpurPair, {"zeta": -1.0}, "zeta = -1.0 must not be negative"),
        (SpurPair, {"b": -0.5}, "b = -0.5 must not be negative"),
        (SpurPair, {"phase": "cosine"}, "phase = 'cosine' must be 'cos' or 'sin'"),
        (SpurPair, {"e": 0.05}, "e = 0.05 must be a sequence of numbers"),
        (SpurPair, {"e": "0.05"}, "e = '0.05' must be a sequence of numbers"),
        (SpurPair, {"eps": (0.1, np.nan)}, "eps = .* not finite"),
        (DoubleHelicalPair, {"W": -1.01}, "W = -1.01 must be at least -1"),
        (DoubleHelicalPair, {"b_c": 0.0}, "b_c = 0.0 must be positive"),
        (DoubleHelicalPair, {"k_gy": -1.0}, "k_gy = -1.0 must not be negative"),
        (DoubleHelicalPair, {"inner_p": 0.1}, "inner_p = 0.1 must be smaller than outer_p = 0.092"),
        (DoubleHelicalPair, {"beta_deg": 90.0}, "beta_deg = 90.0 must lie between"),
        (DoubleHelicalPair, {"poisson": 0.6}, "poisson = 0.6"),
        (DoubleHelicalPair, {"teeth_p": 25.5}, "teeth_p = 25.5 must be a whole number"),
        (DoubleHelicalPair, {"teeth_g": 0}, "teeth_g = 0 must be a whole number of at least 1"),
        (DoubleHelicalPair, {"e_sign": 0}, "e_sign = 0 must be -1 or 1"),
        (DoubleHelicalPair, {"mesh_helix": "basis"}, "mesh_helix = 'basis' must be 'pitch' or 'base'"),
        (DoubleHelicalPair, {"support_damping": "none"}, "support_damping = 'none'"),
        (DoubleHelicalPair, {"tilt": "no"}, "tilt = 'no' must be True or False"),
        (DoubleHelicalPair, {"torque": float("nan")}, "torque = nan must be a finite number"),
    ],
)
def test_ranges(cls, fields, message):
    with pytest.raises(ValueError, match=f"{cls.__name__}: {message}"):
        cls(**fields)


def test_limits_of_the_ranges_are_allowed():
    Duffing(zeta=0.0, k3=0.0, F=0.0)
    SpurPair(zeta=0.0, b=0.0, e=(), eps=(0.0,))
    DoubleHelicalPair(zeta=0.0, W=-1.0, inner_p=0.0, torque=-1400.0, e=(), eps=())


@pytest.mark.parametrize("cls", MODELS.values())
def test_every_parameter_is_documented_and_labelled(cls):
    model = cls()
    words = set(cls.__doc__.replace(",", " ").replace(":", " ").split())
    for field in dataclasses.fields(cls):
        assert field.name in words, f"{field.name} is missing in the docstring"
    assert set(model.parameters) | {"Omega", "amplitude"} == set(cls.labels)
    assert all(unit_of(label) for label in cls.labels.values())  # [-] without a dimension: the labels name axes
    assert isinstance(model.system(), System)


def test_replace_refuses_unknown_names_and_keeps_the_original():
    pair = DoubleHelicalPair()
    assert pair.replace(zeta=0.05).zeta == 0.05 and pair.zeta == 0.063
    with pytest.raises(KeyError, match="DoubleHelicalPair has no parameter 'zetta'; did you mean 'zeta'"):
        pair.replace(zetta=0.05)
    with pytest.raises(ValueError, match="must be at least -1"):
        pair.replace(W=-2.0)


def test_build_by_name():
    assert build("duffing", F=0.2) == Duffing(F=0.2)
    with pytest.raises(KeyError, match="no model 'spurpair'; did you mean 'spur-pair'"):
        build("spurpair")
    with pytest.raises(KeyError, match="SpurPair has no parameter 'eps_scal'; did you mean 'eps_scale'"):
        build("spur-pair", eps_scal=2.0)


@pytest.mark.parametrize(
    "model",
    [
        Duffing(k3=-0.2),
        build("spur-pair", eps=[0.1, 0.2], e=np.array([0.3]), phase="sin", F_m=np.float64(0.2)),
        build("double-helical", teeth_p=np.int64(30), tilt=False, mesh_helix="base", e_sign=1, eps=()),
    ],
)
def test_catalogue_round_trip(model):
    again = rebuild_model(json.loads(json.dumps(describe(model))))
    assert again == model and type(again) is type(model)
    assert hash(again) == hash(model)


def test_rebuild_refuses_unknown_models():
    with pytest.raises(KeyError, match="no model class 'SpurPear'; did you mean 'SpurPair'"):
        rebuild_model({"class": "SpurPear", "fields": {}})
    with pytest.raises(KeyError, match="has no parameter 'zetta'"):
        rebuild_model({"class": "Duffing", "fields": {"zetta": 1.0}})
    with pytest.raises(ValueError, match="described by"):
        rebuild_model({"name": "Duffing"})


def test_a_system_is_described_with_its_matrices():
    system = SpurPair().system()
    described = describe(system)
    assert described["class"] == "System" and described["fields"]["M"] == {"array": [[1.0]]}
    again = rebuild_model(described)
    assert np.array_equal(again.K, system.K) and again.elements == system.elements
