"""Time integration of any model, the independent check of harmonic balance. No solver uses it.

    M q'' + C q' + K q + sum_j w_j [p_j(d_j, d_j', tau) + c_j d_j'] = F(tau),   d_j = w_j^T q - e_j(tau)

Two independent integrators end a step at every instant at which an element reaches a breakpoint of its law. The
Runge-Kutta methods of SciPy ("DOP853", the reference; "RK45"; "Radau" for stiff models) are in `runge_kutta`. The
method "exponential", exact in the linear part and for many motions at once, is in `exponential.integrator`.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from hbgear.common.argument_checks import checked_arguments
from hbgear.common.arrays import Array
from hbgear.common.ranges import POSITIVE, Range, checked, counted
from hbgear.common.text.messages import did_you_mean
from hbgear.mechanics.models import Model
from hbgear.mechanics.series.fourier import derive, evaluate, to_complex, to_real
from hbgear.time.exponential.integrator import ExponentialIntegrator
from hbgear.time.exponential.segments import SAMPLES_PER_STEP
from hbgear.time.flows.slider_flow import complete_state
from hbgear.time.runge_kutta import METHODS, Flow


@dataclass(frozen=True, eq=False)
class Motion:
    """One or several integrated motions.

    Attributes
    ----------
    Omega : float or ndarray, shape (B,)
        Excitation frequency.
    tau : ndarray, shape (T,)
        Phases of the samples from the start on, with an integer number of samples in each excitation period.
    d, v : ndarray, shape (..., m, T)
        Element coordinates and their rates in time.
    end : ndarray, shape (..., 2n)
        State (q, q') at the end, followed by the positions of friction sliders; without free motions if the method is
        "exponential".
    switches : ndarray
        Phases at which any element passed a breakpoint, of all motions together; empty if the method is "exponential".
    steps : int
        Number of steps.
    """

    Omega: Any
    tau: Array
    d: Array
    v: Array
    end: Array
    switches: Array
    steps: int


@checked_arguments()
def state_of(problem: Any, X: Array, theta: float = 0.0, **parameters: float) -> Array:
    """Return the state (q, q') of a harmonic-balance solution at the phase theta, followed by the sliders.

    theta is the basis phase in radians, tau = nu theta. The parameters are ``Omega``, and values that differ from those
    of the model.
    """
    q = problem.motion(X, **parameters)
    velocity = parameters["Omega"] / problem.nu * to_real(derive(to_complex(q)))
    positions = problem.slider_positions(X, theta, **parameters)
    return np.concatenate([evaluate(q, theta)[:, 0], evaluate(velocity, theta)[:, 0], positions])


_START_TOLERANCE = 1e-11
"""Error per step [-] of the integration to the start of the period, relative to the size of the motion."""


def start_state(problem: Any, X: Array, **parameters: float) -> Array:
    """Return the state of a harmonic-balance solution at tau = 0, with accurate rates at breakpoints of the excitation.

    At a breakpoint of the excitation the rates of a truncated series have an error of the order 1/H. The state is
    therefore integrated from the phase before tau = 0 that is farthest from all breakpoints. Without breakpoints, and
    if the integration fails, it is that of `state_of`.
    """
    phases = problem.compiled(parameters).piecewise.phases
    if not len(phases):
        return state_of(problem, X, **parameters)
    ends = np.append(phases, phases[0] + 2 * np.pi)
    widest, Omega = int(np.argmax(np.diff(ends))), parameters["Omega"]
    start = 0.5 * (ends[widest] + ends[widest + 1]) % (2 * np.pi) - 2 * np.pi
    y = state_of(problem, X, start / problem.nu, **parameters)
    flow = Flow(problem.model.at(parameters).system(), Omega)
    try:
        end = flow.integrate(start / Omega, flow.states(y), 0.0, "DOP853", _START_TOLERANCE)[0]
        return flow.coordinates(0.0, end)[:, 0]
    except ArithmeticError:
        return state_of(problem, X, **parameters)


_MAX_RECORDED_SAMPLES = 10_000_000
"""Largest number of samples [-] of one motion; their memory is 80 MB per element and quantity."""


@checked_arguments(model="a model, such as SpurPair() or a System, or a list of them")
def integrate(
    model: Model | Sequence[Model],
    state: Array,
    periods: int,
    Omega: float | Array,
    *,
    method: str = "DOP853",
    tolerance: float = 1e-11,
    samples: int = 256,
    steps: int | None = None,
    phase: float = 0.0,
) -> Motion:
    """Integrate a model over a number of excitation periods 2 pi / Omega.

    Parameters
    ----------
    model : Model or sequence of Model
        Model; for the method "exponential" also B models of one kind.
    state : array_like, shape (2n,) or (B, 2n)
        State (q, q') at tau = phase. Coordinates without mass follow: of those with a damper only q is used, of the
        others nothing. The positions of friction sliders may follow; by default they are the residual
        ones of the laws, moved to within the friction limits.
    periods : int
        Number of excitation periods, at least 1.
    Omega : float or array_like, shape (B,)
        Excitation frequency, > 0. Several values require the method "exponential".
    method : {"DOP853", "RK45", "Radau", "exponential"}, optional
        Integrator. Default: "DOP853".
    tolerance : float, optional
        Error per step of the methods of SciPy, relative to the size of the motion. Default: 1e-11.
    samples : int, optional
        Number of samples of d and v per excitation period. Default: 256.
    steps : int, optional
        Number of steps of the method "exponential" per excitation period. By default the error is about 1e-9.
    phase : float, optional
        Phase tau at the start in radians. Default: 0.

    Returns
    -------
    Motion
        Samples of the motion and the state at the end.

    Raises
    ------
    ValueError
        If the method is unknown, a number is out of its range, or the states do not fit the model.
    ArithmeticError
        If a motion diverges before the end, or Omega or the tolerance is too small for the method to continue.

    Examples
    --------
    >>> import hbgear as hb
    >>> motion = hb.time.integrate(hb.Duffing(), [0.0, 0.0], 2, 1.0)
    >>> motion.d.shape
    (1, 512)
    """
    if method != "exponential" and method not in METHODS:
        raise ValueError(f"no method '{method}'{did_you_mean(method, (*METHODS, 'exponential'))}")
    counted("periods", periods)
    counted("samples", samples)
    counted("periods * samples", periods * samples, _MAX_RECORDED_SAMPLES)
    checked("integrate", "phase", phase)
    checked("integrate", "tolerance", tolerance, Range(low=1e-14, below=1))
    phase, tolerance = float(phase), float(tolerance)  # they may be instances of Fraction
    state = np.asarray(state, dtype=float)
    if state.ndim not in (1, 2) or not np.all(np.isfinite(state)):
        raise ValueError(f"state = {state} must be one state (2n,) or several states (B, 2n) with finite entries")
    if method == "exponential":
        return _exponential(model, state, periods, Omega, samples, steps, phase)
    if not isinstance(model, Model) or np.ndim(Omega):
        raise ValueError(f"{method} takes one model and one Omega; use method='exponential' for several at once")
    checked("integrate", "Omega", Omega, POSITIVE)
    system = model.system()
    flow = Flow(system, float(Omega))
    runs = [_runge_kutta(flow, y, phase, periods, method, tolerance, samples) for y in np.atleast_2d(state)]
    if state.ndim == 1:
        return runs[0]
    d, v, end = (np.array([getattr(r, name) for r in runs]) for name in ("d", "v", "end"))
    switches = np.concatenate([r.switches for r in runs])
    return Motion(float(Omega), runs[0].tau, d, v, end, switches, sum(r.steps for r in runs))


def _runge_kutta(
    flow: Flow, y: Array, phase: float, periods: int, method: str, tolerance: float, samples: int
) -> Motion:
    """Return the motion from one state by a method of SciPy."""
    y = flow.states(complete_state(flow, phase / flow.Omega, np.asarray(y)))
    tau = phase + 2 * np.pi * np.arange(periods * samples) / samples
    t = tau / flow.Omega
    d, v = np.empty((2, flow.m, len(t)))

    def visit(t0: float, t1: float, dense: Callable[[Array], Array]) -> None:
        inside = slice(int(np.searchsorted(t, t0)), int(np.searchsorted(t, t1)))
        if inside.stop > inside.start:
            d[:, inside], v[:, inside] = flow.gaps_over(t[inside], dense(t[inside]))

    end = (phase + 2 * np.pi * periods) / flow.Omega
    Y, instants, count = flow.integrate(phase / flow.Omega, y, end, method, tolerance, visit)
    return Motion(flow.Omega, tau, d, v, flow.coordinates(end, Y)[:, 0], flow.Omega * np.array(instants), count)


def _exponential(
    model: Model | Sequence[Model],
    state: Array,
    periods: int,
    Omega: float | Array,
    samples: int,
    steps: int | None,
    phase: float,
) -> Motion:
    """Return the motion by the exponential method, with a number of steps for which each sample lies on their grid."""
    if np.mod(phase + np.pi, 2 * np.pi) != np.pi:
        raise ValueError(
            f"the exponential method starts at a multiple of 2 pi, not at phase = {phase}; use method='DOP853'"
        )
    integrator = ExponentialIntegrator(model, Omega, steps)
    divisor = samples // int(np.gcd(samples, SAMPLES_PER_STEP))
    if integrator.N % divisor:
        integrator = ExponentialIntegrator(model, Omega, -(-integrator.N // divisor) * divisor, adaptive=steps is None)
    motions, pieces, step_count = integrator.start(state), [], 0
    chunk = periods if integrator.method.straight else 1  # the number of steps is checked before each piece
    for _ in range(0, periods, chunk):
        fine = integrator.advance(motions, chunk, record=True)
        assert fine is not None
        pieces.append([x[..., :: integrator.N * SAMPLES_PER_STEP // samples] for x in fine])
        step_count += chunk * integrator.N
    d, v = (np.concatenate(arrays, axis=-1) for arrays in zip(*pieces, strict=True))
    end = integrator.states(motions)
    if not np.isfinite(end).all():
        raise ArithmeticError(
            f"a motion diverges within {periods} periods; start nearer to a motion that stays bounded"
        )
    if state.ndim == 1 and len(end) == 1:
        d, v, end = d[0], v[0], end[0]
    tau = phase + 2 * np.pi * np.arange(periods * samples) / samples
    return Motion(np.squeeze(Omega)[()], tau, d, v, end, np.empty(0), step_count)
