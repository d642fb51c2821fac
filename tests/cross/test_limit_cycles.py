"""Neimark-Sacker points of limit cycles against multipliers by integration."""

from dataclasses import dataclass

import numpy as np
import pytest
import scipy

import hbgear as hb
from hbgear.harmonic.autonomous.cycle_events import CycleDoublingEvent, CycleTorusEvent

MU, ZETA = 0.05, 0.05


@dataclass(frozen=True)
class VanDerPol(hb.mechanics.Law):
    eps: float

    def force(self, d, v, tau):
        return self.eps * (d**2 - 1) * v, 2 * self.eps * d * v, self.eps * (d**2 - 1)


@hb.mechanics.model
def absorber(eps: float = 0.1) -> hb.System:
    """A van der Pol oscillator with a tuned mass on it."""
    c, k = 2 * ZETA * MU, MU
    springs = [hb.Element([1.0, 0.0], VanDerPol(eps))]
    return hb.System(np.diag([1.0, MU]), [[c, -c], [-c, c]], [[1 + k, -k], [-k, k]], springs)


@pytest.mark.slow
def test_neimark_sacker_point_of_a_limit_cycle_has_a_pair_of_modulus_one():
    second = hb.analysis.hopf_points(absorber(), "eps", (0.0, 0.3))[1]
    cycles = hb.analysis.limit_cycles(absorber(), second, (0.0, 0.3), harmonics=9, accuracy=None)
    assert [point.label for point in cycles.special] == ["NS1"]
    point = cycles["NS1"]
    after = int(point.index) + 1
    assert not cycles.stable[0] and cycles.stable[after]
    eps, T = point.parameters["eps"], 2 * np.pi / point.parameters["Omega"]
    c, k = 2 * ZETA * MU, MU

    def rates(t, y):
        x, v, Y = y[:2], y[2:4], y[4:].reshape(4, 4)
        force = -eps * (x[0] ** 2 - 1) * v[0] - x[0]
        link = k * (x[1] - x[0]) + c * (v[1] - v[0])
        J = np.zeros((4, 4))
        J[0, 2] = J[1, 3] = 1.0
        J[2] = [-1 - 2 * eps * x[0] * v[0] - k, k, -eps * (x[0] ** 2 - 1) - c, c]
        J[3] = np.array([k, -k, c, -c]) / MU
        return np.concatenate([v, [force + link, -link / MU], (J @ Y).ravel()])

    def flow(start, T):
        y0 = np.concatenate([start, np.eye(4).ravel()])
        y = scipy.integrate.solve_ivp(rates, (0, T), y0, "DOP853", rtol=1e-12, atol=1e-13).y[:, -1]
        return y[:4], y[4:].reshape(4, 4)

    problem = cycles.problem.problem
    rows = problem.motion(point.X, **{name: x for name, x in point.parameters.items()})
    x = np.concatenate([rows[:, 0] + rows[:, 1::2].sum(axis=1), np.zeros(2)])
    order = np.arange(1, rows.shape[1] // 2 + 1)
    x[2:] = point.parameters["Omega"] * (rows[:, 2::2] * order).sum(axis=1)
    for _ in range(4):  # Newton in the state and the period, orthogonal to the flow
        end, Phi = flow(x, T)
        f = rates(0.0, np.concatenate([x, np.eye(4).ravel()]))[:4]
        A = np.block([[Phi - np.eye(4), rates(0.0, np.concatenate([end, np.eye(4).ravel()]))[:4, None]], [f, 0.0]])
        change = np.linalg.solve(A, np.append(x - end, 0.0))
        x, T = x + change[:4], T + change[4]
    assert np.abs(change).max() < 1e-9
    mu = np.linalg.eigvals(flow(x, T)[1])
    pair = mu[np.abs(mu.imag) > 0.1]
    assert len(pair) == 2 and np.abs(np.abs(pair) - 1).max() < 1e-6
    assert pytest.approx(2 * np.pi / point.parameters["Omega"], abs=1e-8) == T


def test_functions_of_the_multipliers_change_sign_at_the_circle():
    assert (
        CycleDoublingEvent().function(np.array([-0.99, 0.3]))
        > 0
        > CycleDoublingEvent().function(np.array([-1.01, 0.3]))
    )
    pair = np.array([0.3 + 0.8j, 0.3 - 0.8j])
    inside, outside = pair / abs(pair[0]) * 0.99, pair / abs(pair[0]) * 1.01
    assert CycleTorusEvent().function(inside) < 0 < CycleTorusEvent().function(outside)
    assert np.isnan(CycleTorusEvent().function(np.array([0.5, -0.5])))
