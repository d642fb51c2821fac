"""Verification of tori by time integration: stroboscopic points, rotation number, growth of disturbances.

    x_p = x(theta_1 = 0, theta_2 = 2 pi p Omega_2 nu / Omega)          p periods 2 pi nu / Omega of the first frequency

The motion that starts on the torus of the harmonic balance is integrated. Its stroboscopic points are compared with the
section of the torus at the phases that the second frequency predicts. The rotation number is also computed from the
integrated points alone: the weighted average of the increments of the angle of u_p = a^H z_p, a the first harmonic of
the section. The torus is stable if a disturbance of the integrated motion does not grow.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from hbgear.common.argument_checks import checked_arguments
from hbgear.common.arrays import Array
from hbgear.common.ranges import counted
from hbgear.continuation.results.branch import Branch
from hbgear.harmonic.autonomous.tori.layout import SECOND
from hbgear.harmonic.autonomous.tori.problem import TorusProblem
from hbgear.harmonic.autonomous.tori.stability import birkhoff_weights
from hbgear.time.exponential.integrator import ExponentialIntegrator
from hbgear.time.steady_state import growth_rates

_MAX_PERIODS = 100_000
"""Largest number of integrated periods [-]."""

_PHASES = 256
"""Number of points of the section from which its first harmonic is computed [-]."""

_MAX_GROWTH = 5e-3
"""Logarithmic growth of a disturbance per period [-] up to which a torus is stable; on a torus the exponent is zero."""


class TorusCheck(NamedTuple):
    """Comparison of a torus with time integration.

    Attributes
    ----------
    deviation : float
        Largest distance of the stroboscopic points from the predicted ones, relative to the largest state.
    rotation_number : float
        Omega_2 nu / Omega of the harmonic balance.
    rotation_error : float
        Its difference from the weighted average of the integrated motion; nan if the torus is unstable.
    growth : float
        Mean logarithmic growth of a disturbance per period of the first frequency.
    stable : bool
        Whether disturbances do not grow.

    Examples
    --------
    See `hbgear.time.verify_torus`.

    >>> import hbgear as hb
    >>> hb.time.TorusCheck(1e-6, 0.0854, 1e-9, 1e-4, True).stable
    True
    """

    deviation: float
    rotation_number: float
    rotation_error: float
    growth: float
    stable: bool


@checked_arguments()
def verify_torus(tori: Branch, point: int = -1, *, periods: int = 1000) -> TorusCheck:
    """Compare a torus with event-exact time integration, and determine its stability.

    Parameters
    ----------
    tori : Branch
        Branch of `hbgear.analysis.torus`, with its problem.
    point : int, optional
        Number of the point. Default: the last one.
    periods : int, optional
        Number of periods of the first frequency. Default: 1000. The deviation grows with it by the error of Omega_2.

    Returns
    -------
    TorusCheck
        Deviation, rotation number and growth of disturbances.

    Raises
    ------
    ValueError
        If the branch is not of tori, or has no problem.

    Examples
    --------
    >>> import hbgear as hb
    >>> import numpy as np
    >>> C, K = [[0.015, -0.013], [-0.013, 0.013]], [[1.0453, -0.0453], [-0.0453, 0.0453]]
    >>> springs = [hb.Element([1.0, 0.0], hb.Cubic(1.0)), hb.Element([1.0, -1.0], hb.Cubic(0.0042))]
    >>> masses = hb.System(np.diag([1.0, 0.05]), C, K, springs, hb.Load(cosine={1: [0.13, 0.0]}))
    >>> curve = hb.trace(hb.HarmonicBalance(masses, 5), "Omega", (1.0, 1.15))
    >>> tori = hb.analysis.torus(curve, "NS1", (1.11, 1.12), harmonics=(5, 6))
    >>> check = hb.time.verify_torus(tori, periods=300)
    >>> check.stable, check.deviation < 2e-2
    (True, True)
    """
    problem = tori.require_problem()
    if not isinstance(problem, TorusProblem):
        raise ValueError("the branch has no tori: give the branch of hb.analysis.torus(curve, 'NS1')")
    counted("periods", periods, _MAX_PERIODS, least=20)
    parameters, nu = dict(tori[point].parameters), problem.balance.nu
    turns = parameters[SECOND] * nu / parameters["Omega"]
    predicted = _section(problem, tori[point].X, parameters, 2 * np.pi * turns * np.arange(periods + 1))
    model = problem.balance.model_at({name: x for name, x in parameters.items() if name != SECOND})
    integrator = ExponentialIntegrator(model, parameters["Omega"])
    motions = integrator.start(predicted[:1])
    growth = nu * float(growth_rates(integrator, motions, max(periods // 2, 20))[0])
    states = np.empty((periods * nu, *motions.zeta.shape))
    integrator.stroboscopic_map(motions, states)
    stable = growth <= _MAX_GROWTH
    z = integrator.weights()[0] * (states[nu - 1 :: nu, 0] + integrator.z[0])
    expected = integrator.weights()[0] * integrator.modal(predicted[1:])
    deviation = np.linalg.norm(z - expected, axis=1).max() / np.linalg.norm(expected, axis=1).max()
    curve = _section(problem, tori[point].X, parameters, 2 * np.pi * np.arange(_PHASES) / _PHASES)
    rotation = _rotation_number(z, integrator.weights()[0] * integrator.modal(curve)) if stable else np.nan
    return TorusCheck(float(deviation), float(turns), _difference(rotation, turns), growth, stable)


def _section(problem: TorusProblem, X: Array, parameters: dict[str, float], theta: Array) -> Array:
    """Return the states (T, 2n) of a torus at theta_1 = 0 and second phases (T,)."""
    basis = problem.basis
    q = problem.motion(X, **parameters)
    w = basis.k @ np.array([parameters["Omega"] / problem.balance.nu, parameters[SECOND]])
    phases = np.column_stack([np.zeros(len(theta)), theta])
    return np.concatenate([basis.evaluate(q, phases), basis.evaluate(1j * w * q, phases)]).T


def _rotation_number(z: Array, section: Array) -> float:
    """Return the turns per period of points z (P, k) of a closed curve, with equidistant points (T, k) of the curve."""
    first = np.exp(-2j * np.pi * np.arange(len(section)) / len(section)) @ section
    u = (z - section.mean(axis=0)) @ first.conj()
    increments = np.angle(u[1:] / u[:-1])
    return float(birkhoff_weights(len(increments)) @ increments / (2 * np.pi))


def _difference(rotation: float, turns: float) -> float:
    """Return the difference of two rotation numbers, which are known up to whole turns."""
    return float(abs((rotation - turns + 0.5) % 1.0 - 0.5))
