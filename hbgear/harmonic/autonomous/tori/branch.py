"""Branches of tori from Neimark-Sacker points.

    d = d_0(theta_1) + 2 eps Re(v(theta_1) e^{i theta_2}),   theta_2' = Omega_2 = Im s

d_0 is the periodic motion at the Neimark-Sacker point, s the exponent of its pair of multipliers. v is the null vector
of the equations of a torus at d_0 in the coefficients with k_2 = 1. The first torus has a small given modulation; its
Omega and Omega_2 are unknown.
"""

from __future__ import annotations

from fractions import Fraction
from typing import Any

import numpy as np

from hbgear.common.argument_checks import checked_arguments
from hbgear.common.arrays import Array, ComplexArray
from hbgear.common.ranges import Range, checked, counted
from hbgear.continuation.numerics.linear import norm
from hbgear.continuation.results.branch import Branch
from hbgear.continuation.results.point import Point, SpecialPoint
from hbgear.continuation.solvers.newton import solve
from hbgear.continuation.tracing.trace import trace
from hbgear.harmonic.autonomous.prescribed_amplitude import PrescribedAmplitude
from hbgear.harmonic.autonomous.tori.basis import TorusBasis
from hbgear.harmonic.autonomous.tori.layout import SECOND
from hbgear.harmonic.autonomous.tori.problem import TorusProblem
from hbgear.harmonic.bifurcations.neimark_sacker import exponent_of_pair
from hbgear.harmonic.harmonic_balance import HarmonicBalance
from hbgear.mechanics.series.fourier import to_complex

_MAX_EVEN_PART = 1e-8
"""Even harmonics of a motion and its disturbance, over the whole, below which they are rounding."""


@checked_arguments()
def torus(
    branch: Branch,
    label: str = "NS1",
    span: tuple[float, float] | None = None,
    *,
    harmonics: tuple[int, int] | None = None,
    modulation: float = 0.05,
    dense: int = 1,
    **options: Any,
) -> Branch:
    """Trace the quasi-periodic motions that leave a curve at a Neimark-Sacker point.

        d(t) = Re sum_k c_k e^{i (k_1 Omega / nu + k_2 Omega_2) t},   |k_1| / H_1 + |k_2| / H_2 <= 1

    The second frequency Omega_2 is an unknown. The branch leaves the point in the direction in which the modulation
    grows, and ends at another Neimark-Sacker point, at an end of the span, or where the spectrum no longer decays
    (loss of smoothness, locking); `Branch.message` names the end. A torus is stable if disturbances other than a shift
    of its second phase decay: the only multiplier is the mean factor by which the slowest one changes in a period
    2 pi nu / Omega. Where its error is too large, the stability is undecided, and the message states the reason. Points
    at which tori gain or lose stability are not located.

    Parameters
    ----------
    branch : Branch
        Curve of periodic motions of a harmonic balance, with its problem.
    label : str, optional
        Label of a Neimark-Sacker point. Default: "NS1".
    span : (float, float), optional
        Values of the parameter between which tori are traced, in any order. By default the range of the curve.
    harmonics : (int, int), optional
        H_1 and H_2, highest harmonics of both frequencies. By default H_1 is the H of the curve, at most 9, and H_2
        is 12. Laws with gaps need more of both.
    modulation : float, optional
        Modulation of the first torus, relative to the periodic motion. Default: 0.05.
    dense : int, optional
        Factor of the number of samples of the forces; larger ones reduce the error with gaps. Default: 1.
    **options
        Arguments of `trace`.

    Returns
    -------
    Branch
        Curve of tori in the parameter of the curve, with ``tracked["Omega_2"]``. `Branch.amplitude` has the measures
        "rms", "pp2", "max" and "mean" of the whole torus.

    Raises
    ------
    KeyError
        If the label does not exist.
    ValueError
        If the point is no Neimark-Sacker point, the curve has no harmonic balance, the multipliers are near a root of
        unity of order 1 to 4 (locked second frequency), or the structure is not suitable, see `TorusProblem`.
    NoConvergence
        If no torus is found near the point.

    References
    ----------
    Schilder, Vogt, Schreiber & Osinga (2006), Int. J. Numer. Meth. Eng. 67, https://doi.org/10.1002/nme.1632.

    Examples
    --------
    >>> import hbgear as hb
    >>> import numpy as np
    >>> C, K = [[0.015, -0.013], [-0.013, 0.013]], [[1.0453, -0.0453], [-0.0453, 0.0453]]
    >>> springs = [hb.Element([1.0, 0.0], hb.Cubic(1.0)), hb.Element([1.0, -1.0], hb.Cubic(0.0042))]
    >>> masses = hb.System(np.diag([1.0, 0.05]), C, K, springs, hb.Load(cosine={1: [0.13, 0.0]}))
    >>> curve = hb.trace(hb.HarmonicBalance(masses, 5), "Omega", (1.0, 1.15))
    >>> tori = hb.analysis.torus(curve, "NS1", (1.11, 1.12), harmonics=(5, 4))
    >>> bool(abs(tori.tracked["Omega_2"][-1] / 1.12 - 0.08538) < 1e-3)
    True
    """
    point = branch[label]
    balance = branch.problem
    if not isinstance(point, SpecialPoint) or point.kind != "NS":
        raise ValueError(f"{label} is no Neimark-Sacker point; tori leave at points of the kind NS, such as 'NS1'")
    if not isinstance(balance, HarmonicBalance):
        raise ValueError("tori need a curve of a harmonic balance with its problem; load it with problem=...")
    checked("torus", "modulation", modulation, Range(above=0, below=1))
    H1, H2 = harmonics or (min(balance.H, 9), 12)
    counted("harmonics[0]", H1, 200)
    counted("harmonics[1]", H2, 200)
    counted("dense", dense, 20)
    low, high = sorted(map(float, span or (branch.values.min(), branch.values.max())))
    parameters = dict(point.parameters)
    name, value = branch.parameter, float(parameters[branch.parameter])
    if not low <= value <= high:
        raise ValueError(f"{label} has {name} = {value:.6g}, outside the span ({low:g}, {high:g}); widen it")
    balance = balance.at_resolution_of(point)
    X = balance.from_point(point)
    Omega_2 = _second_frequency(balance, X, parameters)
    require_free_rotation(label, Omega_2 * balance.nu / parameters["Omega"])
    problem, base, direction = _linear_torus(balance, X, Omega_2, parameters, (H1, H2), dense)
    first = base + modulation * norm(base) * direction
    U, start = _first_torus(problem, first, direction, Omega_2, parameters, name)
    ends = (low, high) if U[-1] >= value else (high, low)
    usual = {"cover": False, "accuracy": None}
    return trace(problem, name, ends, Point.without_data(U[:-2], start, problem), **(usual | options))


def _second_frequency(balance: HarmonicBalance, X: Array, parameters: dict[str, float]) -> float:
    """Return the frequency Im s of the pair of multipliers on the unit circle."""
    if balance.compiled(parameters).damped:
        raise ValueError(
            "tori that leave a curve are not computed for contacts with dampers: integrate the motion beyond the point "
            "by hb.time.integrate"
        )
    s = exponent_of_pair(balance.multipliers(X, None, **parameters), balance.nu, parameters["Omega"])
    if s is None:
        raise ValueError("the multipliers of the point are real; no second frequency begins there")
    return s.imag


def require_free_rotation(label: str, turns: float) -> None:
    """Raise ValueError at a strong resonance, where the second frequency is locked to the excitation."""
    resonance = Fraction(turns).limit_denominator(4)
    if abs(turns - resonance) < 1e-3:
        raise ValueError(
            f"{label}: the second frequency is {turns:.5f} of the first one, near "
            f"{resonance.numerator}/{resonance.denominator}: at this strong resonance the frequencies lock, and no "
            "torus leaves; change a parameter of the model"
        )


def _linear_torus(
    balance: HarmonicBalance,
    X: Array,
    Omega_2: float,
    parameters: dict[str, float],
    harmonics: tuple[int, int],
    dense: int,
) -> tuple[TorusProblem, Array, Array]:
    """Return the problem, the periodic motion (n,) as a torus, and the unit vector (n,) of its disturbance.

    The problem has odd harmonics of the first phase only, if both have only these.
    """
    problem = TorusProblem(balance, TorusBasis(*harmonics, dense=dense))
    basis, periodic = problem.basis, to_complex(balance.rows(X))
    c = np.zeros((balance.m, len(basis.k)), dtype=complex)
    positions, orders = basis.periodic(balance.H + 1)
    c[:, positions] = periodic[:, orders]
    base, rotating = basis.to_real(c), np.zeros_like(c)
    rotating[:, basis.k[:, 1] == 1] = 1.0 - 1.0j
    moving = np.flatnonzero(basis.to_real(rotating))
    J = problem.linearise(np.append(base.ravel(), Omega_2), "", **parameters).dR_dX
    direction = np.zeros_like(base)
    direction.flat[moving] = np.linalg.svd(J[np.ix_(moving, moving)])[2][-1]
    even = basis.k[:, 0] % 2 == 0
    if all(_relative_size(x, x[:, even]) < _MAX_EVEN_PART for x in map(basis.to_complex, (base, direction))):
        problem = TorusProblem(balance, TorusBasis(*harmonics, odd=True, dense=dense))
        base, direction = (problem.basis.convert(x, basis) for x in (base, direction))
    return problem, base.ravel(), direction.ravel() / norm(direction.ravel())


def _relative_size(c: ComplexArray, subset: ComplexArray) -> float:
    """Return the largest modulus of a subset of coefficients, over the largest modulus of all."""
    return float(np.abs(subset).max() / np.abs(c).max())


def _first_torus(
    problem: TorusProblem, guess: Array, direction: Array, Omega_2: float, parameters: dict[str, float], name: str
) -> tuple[Array, dict[str, float]]:
    """Return the unknowns (X, Omega_2, parameter) of the first torus, and all parameters there."""
    fixed = {key: x for key, x in parameters.items() if key != name}
    started = problem.with_borders_at(np.append(guess, Omega_2), parameters, renew=True)
    equations = PrescribedAmplitude(started, name, direction, float(direction @ guess))
    U = solve(equations, np.concatenate([guess, [Omega_2, parameters[name]]]), fixed).X
    return U, {**parameters, name: float(U[-1]), SECOND: float(U[-2])}
