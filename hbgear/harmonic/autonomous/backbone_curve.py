"""Backbone curves: modal frequency and damping over amplitude, their energy, and the resonance peaks on them.

    E = 1/2 q'^T M q' + 1/2 q^T K q - F_0^T q + sum_j int_0^d_j p_j        mean over a period

Without dissipation E is constant during the motion. At a resonance peak the excitation supplies the power of the
artificial damping:

    max_phi <q'^T F - (p - c d')^T e' - d'^T dk g>  =  2 D Omega <q'^T M q'>

F, e and dk are the periodic parts of loads, prescribed displacements and stiffness, shifted by the phase phi; g is the
force of the springs of unit stiffness.
"""

from __future__ import annotations

import dataclasses
from typing import Any, NamedTuple

import numpy as np
import scipy  # its parts are imported when they are first used

from hbgear.common.argument_checks import checked_arguments
from hbgear.common.arrays import Array
from hbgear.common.ranges import counted
from hbgear.continuation.results.branch import Branch
from hbgear.continuation.results.point import Point
from hbgear.continuation.tracing.trace import trace
from hbgear.harmonic.autonomous.backbone import AMPLITUDE, BackboneProblem, model_parameters
from hbgear.mechanics.laws.laws import Law
from hbgear.mechanics.laws.slider import friction_limits, limit_at, steady_force
from hbgear.mechanics.laws.vector_laws import Component, VectorLaw, vector_groups
from hbgear.mechanics.models import Model, System
from hbgear.mechanics.series.fourier import Series, evaluate, to_complex

_POWER_SAMPLES = 512
"""Instants of a period at which the power of a varying stiffness is evaluated."""

_ENERGY_SAMPLES = 64
"""Instants of a period over which the energy is averaged; it varies only by the dissipation within a period."""

_SLIDER_SAMPLES = 4096
"""Instants of a period at which the force of a friction slider is evaluated; it has kinks."""


@checked_arguments()
def backbone(
    model: Model, mode: int = 1, span: tuple[float, float] = (0.01, 10.0), *, harmonics: int = 16, **options: Any
) -> Branch:
    """Trace the backbone of a mode: the frequency and damping of free motions over their amplitude.

        M q'' + C q' - 2 D Omega M q' + K q + W p(d) = F_0,   rms(d) = amplitude

    Periodic excitation is left out; mean loads, mean prescribed displacements and mean stiffness remain. The artificial
    damping -2 D Omega M q' sustains the motion (extended periodic motion concept), so D is the modal damping ratio.

    Parameters
    ----------
    model : Model
        Any gear pair, oscillator, train or `System` with constant matrices.
    mode : int, optional
        Number of the linear mode about the static state, in ascending frequency. 1 by default.
    span : (float, float), optional
        First and last amplitude: rms of the alternating displacements of all elements together [length of the model].
    harmonics : int, optional
        H, number of harmonics. 16 by default.
    **options
        Arguments of `trace`; here ``cover`` is False by default, because a span may exceed the amplitudes of a mode.

    Returns
    -------
    Branch
        Curve in ``amplitude``, with the arrays ``tracked["Omega"]`` and ``tracked["modal_damping"]``. Turning points in
        amplitude and branch points belong to internal resonances.

    Raises
    ------
    ValueError
        If the model has fewer modes, a law varies with the phase and has no mean, or the structure depends on Omega, is
        measured or is too large.
    NoConvergence
        If no motion is found at either end of the span.

    References
    ----------
    Krack (2015), Comput. Struct. 154, 59-71, https://doi.org/10.1016/j.compstruc.2015.03.008.

    Examples
    --------
    The frequency of the unloaded backlash oscillator is 1 / (1 + 2 / (pi (A - 1))), with A the largest displacement
    over the half backlash.

    >>> import hbgear as hb
    >>> import math
    >>> free = hb.System([[1.0]], None, [[0.0]], [hb.Element([1.0], hb.Backlash())])
    >>> curve = hb.analysis.backbone(free, span=(4.0, 2.0))
    >>> A = float(curve[0].amplitude("max"))
    >>> bool(abs(curve.tracked["Omega"][0] - 1 / (1 + 2 / (math.pi * (A - 1)))) < 1e-5)
    True
    """
    return trace(BackboneProblem(model, mode, harmonics), AMPLITUDE, span, **({"cover": False} | options))


@checked_arguments()
def backbone_energy(curve: Branch) -> Array:
    """Return the energy of each motion of a backbone: kinetic, elastic, and of the mean loads.

    A friction slider has the energy of its spring, f^2 / (2 k). That of a law of several displacements is the integral
    of its force along the straight line from zero, which is its potential if it has one.

    Parameters
    ----------
    curve : Branch
        Curve of `backbone`, also from a file.

    Returns
    -------
    ndarray, shape (P,)
        Energy relative to the state q = 0, mean over a period [force times length of the model].

    Raises
    ------
    ValueError
        If the curve is not a backbone, or its model is unknown.

    Examples
    --------
    >>> import hbgear as hb
    >>> curve = hb.analysis.backbone(hb.Duffing(), span=(0.01, 0.1), harmonics=3)
    >>> energy = hb.analysis.backbone_energy(curve)
    >>> bool(abs(energy[0] / 0.01**2 - 1.0) < 1e-3)
    True
    """
    problem = _problem_of(curve, "the energy")
    return np.array([_energy(problem, curve[i]) for i in range(len(curve))])


def _problem_of(curve: Branch, quantity: str) -> BackboneProblem:
    """Return the problem of a backbone; raise ValueError for another curve."""
    problem = curve.require_problem()
    if not isinstance(problem, BackboneProblem):
        raise ValueError(f"{quantity} is that of a backbone: give the curve of hb.analysis.backbone(model)")
    return problem


def _energy(problem: BackboneProblem, point: Point) -> float:
    """Return the mean energy of the motion of a point."""
    system = problem.balance.model.at(point.parameters).system()
    rows, theta = problem.motion(point.X, **point.parameters), 2 * np.pi * np.arange(_ENERGY_SAMPLES) / _ENERGY_SAMPLES
    q, v = evaluate(rows, theta), point.parameters["Omega"] * evaluate(rows, theta, 1)
    load = np.asarray(system.loads[0].constant)
    quadratic = 0.5 * np.sum(v * (system.M @ v), axis=0) + 0.5 * np.sum(q * (system.K @ q), axis=0) - load @ q
    total = float(np.mean(quadratic))
    d = system.W.T @ q - np.array([[element.displacement.mean] for element in system.elements])
    for element, row in zip(system.elements, d, strict=True):
        if not isinstance(element.law, Component):
            total += float(np.mean([_potential(element.law, x) for x in row]))
    for elements, law in vector_groups([element.law for element in system.elements]):
        total += float(np.mean(_line_integral(law, d[elements])))
    return total + _energy_of_sliders(system, rows)


def _energy_of_sliders(system: System, rows: Array) -> float:
    """Return the mean energy of the springs of all friction sliders in a motion with rows (n, 2H + 1)."""
    tau, total = 2 * np.pi * np.arange(_SLIDER_SAMPLES) / _SLIDER_SAMPLES, 0.0
    for j, slider, limit in friction_limits(system.elements):
        d, normal = (  # a limit without normal force does not depend on the second one
            evaluate(system.W[:, i] @ rows, tau) - system.elements[i].displacement.mean for i in (j, limit.normal)
        )
        force = steady_force(slider, d, np.maximum(limit_at(limit, normal, tau), 0.0))
        total += float(np.mean(force**2)) / (2 * slider.k)
    return total


class PredictedPeak(NamedTuple):
    """A resonance peak that a backbone predicts.

    Attributes
    ----------
    amplitude : float
        Rms of the alternating displacements of all elements, the parameter of the backbone.
    Omega : float
        Excitation frequency.
    is_maximum : bool
        Whether the amplitude of the response is largest here. If not, it is the smallest one of a disconnected curve.

    Examples
    --------
    >>> import hbgear as hb
    >>> curve = hb.analysis.backbone(hb.Duffing(zeta=0.02, k3=0.5, F=0.02), span=(0.01, 1.0), harmonics=5)
    >>> (peak,) = hb.analysis.predicted_peaks(curve)
    >>> round(peak.Omega, 4), round(peak.amplitude, 4), peak.is_maximum
    (1.0424, 0.3391, True)
    """

    amplitude: float
    Omega: float
    is_maximum: bool


@checked_arguments()
def predicted_peaks(curve: Branch, order: int = 1) -> tuple[PredictedPeak, ...]:
    """Return the resonance peaks of the model of a backbone under its periodic excitation, without a response curve.

        max_phi <q'^T F - (p - c d')^T e' - d'^T dk g>  =  2 D Omega <q'^T M q'>

    The excitation is in quadrature with the motion of the mode. The relative error is of the order of the square of the
    damping ratio, and of the part of other modes in the response.

    Parameters
    ----------
    curve : Branch
        Curve of `backbone`, also from a file.
    order : int, optional
        Order l of the excitation that meets the mode, with the excitation frequency Omega = Omega_mode / l. Default: 1.

    Returns
    -------
    tuple of PredictedPeak
        Peaks in the order of the curve.

    Raises
    ------
    ValueError
        If the curve is not a backbone in the amplitude, or its model is unknown.

    References
    ----------
    Krack (2015), Comput. Struct. 154, 59-71, https://doi.org/10.1016/j.compstruc.2015.03.008.

    Examples
    --------
    >>> import hbgear as hb
    >>> pair = hb.SpurPair(zeta=0.02, e=(0.02,))
    >>> (peak,) = hb.analysis.predicted_peaks(hb.analysis.backbone(pair, span=(0.01, 1.0)))
    >>> response = hb.trace(hb.HarmonicBalance(pair), "Omega", (0.5, 1.2))
    >>> exact = max(hb.analysis.peaks(response, "rms"), key=lambda point: point.amplitude("rms"))
    >>> bool(abs(peak.Omega / exact.parameters["Omega"] - 1) < 0.01)
    True
    """
    problem = _problem_of(curve, "a predicted peak")
    if curve.parameter != AMPLITUDE:
        raise ValueError(
            f"peaks are predicted along the amplitude, this curve is in {curve.parameter}: give the curve of "
            "hb.analysis.backbone(model)"
        )
    counted("order", order)
    system = problem.model.at(model_parameters(curve.parameters_at(0))).system()
    with np.errstate(divide="ignore"):
        ratios = np.log([_power_ratio(problem, system, curve[i], order) for i in range(len(curve))])
    finite = np.flatnonzero(np.isfinite(ratios))
    if len(finite) < 2:  # no excitation of this order, or no dissipation
        return ()
    fits = {
        name: scipy.interpolate.PchipInterpolator(finite, values[finite])
        for name, values in (("ratio", ratios), (AMPLITUDE, curve.values), ("Omega", curve.tracked["Omega"]))
    }
    peaks = []
    for s in fits["ratio"].roots(extrapolate=False):
        grows = fits[AMPLITUDE](s, 1) > 0
        peaks.append(
            PredictedPeak(
                float(fits[AMPLITUDE](s)), float(fits["Omega"](s)) / order, bool((fits["ratio"](s, 1) < 0) == grows)
            )
        )
    return tuple(peaks)


def _power_ratio(problem: BackboneProblem, system: System, point: Point, order: int) -> float:
    """Return the largest power of the excitation over that of the artificial damping, for the motion of a point.

    The system is the one with its periodic excitation, which the problem leaves out.
    """
    evaluator = problem.balance.compiled(model_parameters(point.parameters))
    Omega, D = point.parameters["Omega"], point.parameters["modal_damping"]
    rate, q = 1j * Omega, to_complex(problem.motion(point.X, **point.parameters))
    d, p = (to_complex(x.reshape(evaluator.m, -1))[:, 1] for x in (point.X, evaluator.forces(point.X, Omega)))
    power = 0j
    for load in system.loads:
        if order in (vectors := load.complex(system.n)):
            power += 0.5 * np.vdot(rate * q[:, 1], vectors[order]) * (Omega / order) ** load.power
    theta = 2 * np.pi * np.arange(_POWER_SAMPLES) / _POWER_SAMPLES
    for j, element in enumerate(system.elements):
        e = to_complex(element.displacement.row(order))[order]
        power -= 0.5 * np.conj(p[j] - element.damping * rate * d[j]) * rate * e
        x, v = (evaluate(point.X.reshape(evaluator.m, -1)[j], theta, k) for k in (0, 1))
        for spring in element.law.piecewise or ():
            dk = to_complex(spring.stiffness.row(order))[order]
            unit = dataclasses.replace(spring, stiffness=Series(mean=1.0))
            first = 2 * np.mean(Omega * v * unit.force(x, v, theta)[0] * np.exp(-1j * theta))
            power -= 0.5 * np.conj(first) * dk
    k = np.arange(q.shape[1])
    needed = D * Omega * float(np.sum((k * Omega) ** 2 * (q.conj() * (system.M @ q)).real))
    return float(abs(power) / needed) if needed > 0 else 0.0


_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(8)

_LINE_PARTS = 64
"""Parts of the straight line along which the force of a law of several displacements is integrated."""


def _line_integral(law: VectorLaw, d: Array) -> Array:
    """Return the integrals (N,) of the force of a law along the straight lines from zero to displacements d (p, N)."""
    s = ((np.arange(_LINE_PARTS)[:, None] + 0.5 * (_NODES + 1)) / _LINE_PARTS).ravel()
    weights = np.tile(0.5 * _WEIGHTS / _LINE_PARTS, _LINE_PARTS)
    x = (d[:, :, None] * s).reshape(len(d), -1)
    force = law.force(x, np.zeros_like(x), np.zeros(x.shape[1]))[0].reshape(*d.shape, -1)
    return np.einsum("pn,pns,s->n", d, force, weights)


def _potential(law: Law, d: float) -> float:
    """Return the integral of the force of a law from 0 to d, by Gauss quadrature between its breakpoints."""
    ends = np.array([0.0, *sorted((x for x in law.breakpoints if 0 < x / d < 1), key=abs), d]) if d else np.zeros(2)
    half, middle = 0.5 * np.diff(ends)[:, None], 0.5 * (ends[1:] + ends[:-1])[:, None]
    x = (middle + half * _NODES).ravel()
    force = law.force(x, np.zeros_like(x), np.zeros_like(x))[0]
    return float(np.sum(half * (np.reshape(force, (len(ends) - 1, -1)) @ _WEIGHTS)[:, None]))
