"""Stability of the motions of a backbone without dissipation (nonlinear normal modes).

    mu, 1 / mu  ->  a = (mu + 1 / mu) / 2        stable:  all a real and |a| <= 1

The multipliers of a free motion without dissipation are pairs (mu, 1 / mu). One pair is +1, because phase and amplitude
are arbitrary. The others lie on the unit circle if a small disturbance stays small, and leave it in three ways: at +1
(a branch of the same period, or an extremum of the energy), at -1 (a branch of twice the period), or where two pairs
collide. A stable motion attracts nothing: the modulus of its multipliers is one.

The error of a is its change with twice the harmonics, and at least the error of the pair of the arbitrary phase, whose
a differs from one by the truncation.

References
----------
Peeters, Viguie, Serandour, Kerschen and Golinval (2009), Mech. Syst. Signal Process. 23(1), 195-216,
https://doi.org/10.1016/j.ymssp.2008.04.003.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import groupby, pairwise
from typing import NamedTuple

import numpy as np
import scipy  # sub-modules are imported at first use

from hbgear.common.argument_checks import checked_arguments
from hbgear.common.arrays import Array, ComplexArray
from hbgear.continuation.curve.refinement import nearest_solution
from hbgear.continuation.results.branch import Branch
from hbgear.continuation.results.stability import STABILITY_TOLERANCE
from hbgear.continuation.solvers.newton import SOLVER_ERRORS
from hbgear.harmonic.autonomous.backbone import AMPLITUDE, BackboneProblem, model_parameters
from hbgear.harmonic.multipliers.floquet import floquet_multipliers

MAX_MODAL_DAMPING = 1e-8
"""Modal damping ratio up to which a motion counts as free of dissipation: the multipliers change by 2 pi of it."""

_POSITION_TOLERANCE = 1e-10
"""Tolerance of the position of a change, as a fraction of its segment."""


class StabilityChange(NamedTuple):
    """A motion of a backbone at which multipliers leave the unit circle or return to it.

    Attributes
    ----------
    amplitude : float
        Rms of the alternating displacements of all elements, the parameter of the backbone.
    Omega : float
        Modal frequency.
    kind : str
        "+1" or "-1" if a pair of multipliers meets there, "collision" if two pairs meet elsewhere on the circle.
    position : float
        Number of the point before, plus the fraction of the segment to the next one.

    Examples
    --------
    >>> import hbgear as hb
    >>> change = hb.analysis.StabilityChange(amplitude=0.785, Omega=1.21, kind="+1", position=21.4)
    >>> change.kind
    '+1'
    """

    amplitude: float
    Omega: float
    kind: str
    position: float


@dataclass(frozen=True)
class BackboneStability:
    """Stability of the motions of a backbone.

    Attributes
    ----------
    states : tuple of str
        For each point "stable", "unstable", "undecided" (the error reaches the limit of stability) or "undefined" (the
        motion dissipates energy; without its artificial damping it would decay).
    multipliers : ndarray of complex, shape (P, r)
        Floquet multipliers of each point without the pair of the arbitrary phase; nan where they are undefined.
    error : ndarray, shape (P,)
        Estimated error of (mu + 1 / mu) / 2.
    changes : tuple of StabilityChange
        Motions at which the stability changes, in the order of the curve.

    Examples
    --------
    >>> import hbgear as hb
    >>> curve = hb.analysis.backbone(hb.Duffing(zeta=0.0), span=(0.01, 0.1), harmonics=3)
    >>> set(hb.analysis.backbone_stability(curve).states)
    {'stable'}
    """

    states: tuple[str, ...]
    multipliers: ComplexArray
    error: Array
    changes: tuple[StabilityChange, ...]


@checked_arguments()
def backbone_stability(curve: Branch) -> BackboneStability:
    """Return the stability of the motions of a backbone where they dissipate nothing.

        M q'' + K q + W p(d) = F_0,   d/dt dz = A(t) dz,   mu = eig(Phi(2 pi / Omega))

    Stability of the artificially damped motion of a system with dissipation has no meaning for the real machine. It is
    undefined where the modal damping ratio exceeds 1e-8.

    Parameters
    ----------
    curve : Branch
        Curve of `backbone` in the amplitude, also from a file.

    Returns
    -------
    BackboneStability
        State and multipliers of each point, and the motions at which the stability changes.

    Raises
    ------
    ValueError
        If the curve is not a backbone in the amplitude, or its model is unknown.

    Notes
    -----
    Between neighbouring points, a band of unstable motions is searched where a pair comes closest to +1 or -1, or two
    pairs to each other. Two pairs that meet and stay on the circle, as in systems of uncoupled parts, change nothing.

    References
    ----------
    Peeters, Viguie, Serandour, Kerschen and Golinval (2009), Mech. Syst. Signal Process. 23(1), 195-216,
    https://doi.org/10.1016/j.ymssp.2008.04.003.

    Examples
    --------
    Two equal masses vibrate in phase. Vibration in antiphase grows within a band of amplitudes:

    >>> import hbgear as hb
    >>> import numpy as np
    >>> springs = [hb.Element([1, 0], hb.Cubic(1.0)), hb.Element([0, 1], hb.Cubic(1.0))]
    >>> pair = hb.System(np.eye(2), None, [[3.0, -2.0], [-2.0, 3.0]], springs)
    >>> found = hb.analysis.backbone_stability(hb.analysis.backbone(pair, span=(0.5, 1.0)))
    >>> [(round(change.amplitude, 4), change.kind) for change in found.changes]
    [(0.7848, '+1'), (0.805, '+1')]
    """
    problem = curve.require_problem()
    if not isinstance(problem, BackboneProblem) or curve.parameter != AMPLITUDE:
        raise ValueError("the stability is that of a backbone in the amplitude: give hb.analysis.backbone(model)")
    finer = problem.refined_problem
    spectra = [_verified(problem, finer, curve.X[i], curve.parameters_at(i)) for i in range(len(curve))]
    width = max((len(spectrum.multipliers) for spectrum in spectra if spectrum is not None), default=0)
    multipliers, error = np.full((len(spectra), width), np.nan, dtype=complex), np.full(len(spectra), np.nan)
    for i, spectrum in enumerate(spectra):
        if spectrum is not None:
            multipliers[i, : len(spectrum.multipliers)], error[i] = spectrum.multipliers, spectrum.error
    states = tuple("undefined" if spectrum is None else spectrum.state for spectrum in spectra)
    changes, path = list[StabilityChange](), _Path(curve, finer or problem, spectra)
    for is_defined, group in groupby(range(len(spectra)), key=lambda i: spectra[i] is not None):
        numbers = list(group)
        for t, kind in sorted(path.changes(numbers[0], numbers[-1])) if is_defined and len(numbers) > 1 else ():
            parameters = path.parameters_at(t)
            changes.append(StabilityChange(parameters[AMPLITUDE], parameters["Omega"], kind, t))
    return BackboneStability(states, multipliers, error, tuple(changes))


class _Spectrum(NamedTuple):
    """Multipliers of a motion: half traces (r / 2,) of their pairs with their error, without the trivial pair."""

    multipliers: ComplexArray
    half_traces: ComplexArray
    error: float

    @property
    def margins(self) -> Array:
        """Largest a - 1, largest -1 - a, and largest -(a_i - a_j)^2: positive where pairs left the circle that way."""
        a = self.half_traces
        i, j = np.triu_indices(len(a), 1)
        collision = np.max(-((a[i] - a[j]) ** 2).real, initial=-1.0) - STABILITY_TOLERANCE**2
        return np.array([np.max(a.real, initial=-1.0) - 1, np.max(-a.real, initial=-1.0) - 1, collision])

    @property
    def tolerances(self) -> Array:
        """Values of `margins` up to which they may be zero."""
        return np.array([self.error, self.error, self.error**2])

    @property
    def state(self) -> str:
        """Stability: undecided if a pair lies within its error of +1 or -1, and none is certainly outside."""
        if np.any(self.margins > self.tolerances):
            return "unstable"
        return "undecided" if np.any(np.abs(self.margins[:2]) <= self.error) else "stable"


_KINDS = ("+1", "-1", "collision")
"""Kinds of changes, in the order of `_Spectrum.margins`."""


def _spectrum(problem: BackboneProblem, X: Array, parameters: dict[str, float]) -> _Spectrum | None:
    """Return the multipliers of a motion X with its parameters; None if it dissipates energy."""
    if abs(parameters["modal_damping"]) > MAX_MODAL_DAMPING:
        return None
    Omega = np.array([parameters["Omega"]])
    evaluator = problem.balance.compiled(model_parameters(parameters))
    # without the truncated harmonics, which an undamped mode in resonance with one of them would amplify
    pairs = _reciprocal_pairs(floquet_multipliers(evaluator, X[None], Omega)[0])
    half = pairs.mean(axis=1)
    trivial = int(np.argmin(np.abs(half - 1.0)))
    error = max(float(abs(half[trivial] - 1.0)), STABILITY_TOLERANCE)
    return _Spectrum(np.delete(pairs, trivial, axis=0).ravel(), np.delete(half, trivial), error)


def _verified(
    problem: BackboneProblem, finer: BackboneProblem | None, X: Array, parameters: dict[str, float]
) -> _Spectrum | None:
    """Return the multipliers with twice the harmonics, with their difference as the error; undecided without them."""
    coarse = _spectrum(problem, X, parameters)
    if coarse is None or finer is None:
        return coarse
    try:
        fine, _ = _nearest(finer, finer.resized(problem.join(X, parameters)), parameters)
    except SOLVER_ERRORS:
        return coarse._replace(error=np.inf)
    if fine is None or len(fine.half_traces) != len(coarse.half_traces):
        return coarse._replace(error=np.inf)
    distances = np.abs(fine.half_traces[:, None] - coarse.half_traces)
    difference = max(distances.min(axis=k).max(initial=0.0) for k in (0, 1)) if distances.size else 0.0
    return fine._replace(error=max(coarse.error, fine.error, float(difference)))


def _nearest(
    problem: BackboneProblem, U: Array, parameters: dict[str, float]
) -> tuple[_Spectrum | None, dict[str, float]]:
    """Return the multipliers and the parameters of the motion nearest to unknowns U and parameters."""
    U, amplitude = nearest_solution(problem, U, AMPLITUDE, parameters)
    X, unknown = problem.split(U)
    values = {**parameters, **unknown, AMPLITUDE: amplitude}
    return _spectrum(problem, X, values), values


def _reciprocal_pairs(multipliers: ComplexArray) -> ComplexArray:
    """Return multipliers in pairs (mu, 1 / mu), shape (r / 2, 2); the zeros of friction sliders are left out."""
    remaining = [complex(mu) for mu in sorted(multipliers[multipliers != 0], key=abs)]
    pairs = list[tuple[complex, complex]]()
    while len(remaining) > 1:
        mu = remaining.pop()
        partner = min(range(len(remaining)), key=lambda i: abs(remaining[i] * mu - 1.0))
        pairs.append((mu, remaining.pop(partner)))
    return np.array(pairs, dtype=complex).reshape(-1, 2)


class _Path:
    """Motions of a backbone between its points: position t lies on the segment after point floor(t)."""

    def __init__(self, curve: Branch, problem: BackboneProblem, spectra: Sequence[_Spectrum | None]) -> None:
        self.curve, self.problem, self.spectra = curve, problem, spectra
        coarse = curve.require_problem()
        self._unknowns = [problem.resized(coarse.join(curve.X[i], curve.parameters_at(i))) for i in range(len(curve))]

    def at(self, t: float) -> tuple[_Spectrum | None, dict[str, float]]:
        """Return the multipliers of the motion at a position, and its parameters.

        Raises
        ------
        NoConvergence
            If the motion is not found.
        """
        i = min(int(t), len(self.spectra) - 2)
        s, values = t - i, self.curve.values
        guess = {
            **model_parameters(self.curve.parameters_at(i)),
            AMPLITUDE: float((1 - s) * values[i] + s * values[i + 1]),
        }
        return _nearest(self.problem, (1 - s) * self._unknowns[i] + s * self._unknowns[i + 1], guess)

    def parameters_at(self, t: float) -> dict[str, float]:
        """Return the parameters of the motion at a position, or of the nearest point if the motion is not found."""
        try:
            return self.at(t)[1]
        except SOLVER_ERRORS:
            return self.curve.parameters_at(round(t))

    def margin(self, t: float, index: int) -> float:
        """Return one of the margins at a position; negative where stability is undefined."""
        spectrum, _ = self.at(t)
        return -1.0 if spectrum is None else float(spectrum.margins[index])

    def changes(self, first: int, last: int) -> Iterator[tuple[float, str]]:
        """Yield position and kind of the changes between points whose stability is defined, at and between them."""
        spectra = [spectrum for spectrum in self.spectra[first : last + 1] if spectrum is not None]
        margins = np.array([spectrum.margins for spectrum in spectra])
        tolerances = np.array([spectrum.tolerances for spectrum in spectra])
        for index, kind in enumerate(_KINDS):
            m, sure = margins[:, index], np.flatnonzero(np.abs(margins[:, index]) > tolerances[:, index])
            for a, b in pairwise(sure.tolist()):
                if m[a] * m[b] < 0:  # the last change of sign, through uncertain points
                    k = first + a + int(np.flatnonzero(m[a:b] * m[b] < 0)[-1])
                    yield self._root(k, k + 1, index), kind
            for i in range(1, len(m) - 1):
                if self._may_be_positive(m[i - 1 : i + 2]):
                    for t in self._band(first + i - 1, first + i + 1, index):
                        yield t, kind

    @staticmethod
    def _may_be_positive(m: Array) -> bool:
        """Return whether a margin with three neighbouring values below zero may be positive between them."""
        rise = max(m[1] - m[0], m[1] - m[2])
        return bool(m[1] < 0 and m[1] >= max(m[0], m[2]) and -m[1] <= rise)

    def _root(self, low: float, high: float, index: int) -> float:
        """Return the position at which a margin changes sign; the last one if the motions between are not found."""
        try:
            if self.margin(low, index) * self.margin(high, index) > 0:  # a motion is known with few harmonics only
                return high
            return float(scipy.optimize.brentq(self.margin, low, high, (index,), xtol=_POSITION_TOLERANCE))
        except SOLVER_ERRORS:
            return high

    def _band(self, low: int, high: int, index: int) -> list[float]:
        """Return both ends of a band in which a margin is positive although it is negative at points low and high."""
        try:
            highest = scipy.optimize.minimize_scalar(
                lambda t: -self.margin(t, index), bounds=(low, high), method="bounded"
            )
            top = float(highest.x)
            spectrum, _ = self.at(top)
        except SOLVER_ERRORS:
            return []
        if spectrum is None or spectrum.margins[index] <= spectrum.tolerances[index]:
            return []
        return [self._root(low, top, index), self._root(top, high, index)]
