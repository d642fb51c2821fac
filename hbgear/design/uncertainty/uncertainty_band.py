"""The band of a response curve whose parameters scatter: how far the curve is displaced, to first order.

    (Omega, A)(s, a):   d = d(Omega, A)/da,   sigma^2 = g^T C g,   g_a = n . d_a

n is the normal to the curve in the plane of frequency and amplitude, C the covariance of the parameters. At a fold the
amplitude at a held frequency has no derivative, for the curve turns back there; its displacement normal to itself has
one, since what moves a point along the curve does not move the curve. So

    at a held frequency the amplitude scatters by sigma / n_A,   at a held amplitude the frequency by sigma / n_Omega

The points of the curve, each moving normal to the curve in the space of the unknowns, scatter by S = sum d C d^T in the
plane. The band is covered by their ellipses, k standard deviations large, which it touches at

    (Omega, A) +- k S n / sigma,   sigma^2 = n^T S n
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from hbgear.analysis.parameter_sensitivity import LENGTH, measured_along, units_at
from hbgear.common.argument_checks import checked_arguments
from hbgear.common.arrays import Array
from hbgear.common.ranges import NOT_NEGATIVE, POSITIVE, checked
from hbgear.common.text.messages import did_you_mean, quoted
from hbgear.common.units import to_si
from hbgear.continuation.augmented.sensitivity import of_curve
from hbgear.continuation.results.branch import Branch
from hbgear.design.fitting.fit import Fit
from hbgear.design.fitting.measurements import FREQUENCIES
from hbgear.harmonic.equations.layout import layout_of
from hbgear.harmonic.harmonic_balance import HarmonicBalance


@dataclass(frozen=True, eq=False, repr=False)
class ResponseBand:
    """A response curve and one standard deviation of its displacement.

    Parameters
    ----------
    branch, measure, element : Branch
        The curve, and which amplitude of it.
    unit, length : str
        Of frequency and amplitude; "" for the model's own unit of length.
    frequency, amplitude : ndarray, shape (P,)
        Of the rows of the branch, in these units.
    parameters : tuple of str, shape (A,)
        Those that scatter.
    normal : ndarray, shape (P, 2)
        Unit normals to the curve, with frequency and amplitude in shares of ``size``; nan where two curves cross.
    size : tuple[float, float]
        Ranges of frequency and amplitude, by which normals and displacements are measured.
    covariance : ndarray, shape (P, 2, 2)
        Of the points, in the same shares.
    effects : ndarray, shape (P, A)
        Displacement along the normal for one standard deviation of each parameter, alone.
    deviation : ndarray, shape (P,)
        Standard deviation of the displacement.

    Examples
    --------
    >>> import hbgear as hb
    >>> curve = hb.trace(hb.HarmonicBalance(hb.Duffing(), 3), "Omega", (0.8, 1.6))
    >>> band = hb.design.response_band(curve, {"zeta": 0.002, "F": 0.005})
    >>> band.parameters, bool(0 < band.deviation.max() < 0.1)
    (('zeta', 'F'), True)
    """

    branch: Branch
    measure: str
    element: int | str
    unit: str
    length: str
    frequency: Array
    amplitude: Array
    parameters: tuple[str, ...]
    normal: Array
    size: tuple[float, float]
    covariance: Array
    effects: Array
    deviation: Array

    def __repr__(self) -> str:
        return f"<Band of {self.measure} over {self.unit}: {len(self.frequency)} rows, {', '.join(self.parameters)}>"

    @property
    def at_frequency(self) -> Array:
        """(P,) standard deviation of the amplitude at a held frequency; infinite at folds."""
        return self._held(1)

    @property
    def at_amplitude(self) -> Array:
        """(P,) standard deviation of the frequency at which the amplitude is reached; infinite at peaks."""
        return self._held(0)

    def _held(self, axis: int) -> Array:
        with np.errstate(divide="ignore", invalid="ignore"):
            out: Array = self.size[axis] * self.deviation / np.abs(self.normal[:, axis])
        return out

    @checked_arguments()
    def edges(self, sigmas: float = 2.0) -> tuple[Array, Array]:
        """Both edges of the band, (P, 2) frequency and amplitude each, so many standard deviations from the curve."""
        checked("edges", "sigmas", sigmas, POSITIVE)
        middle = np.column_stack([self.frequency, self.amplitude])
        away = sigmas * touching(self.covariance, self.normal) * self.size
        return middle + away, middle - away


def touching(covariance: Array, normal: Array) -> Array:
    """S n / sigma (P, 2): where ellipses of covariances S (P, 2, 2) touch their tangents with normals n (P, 2)."""
    reached = np.einsum("pxy,py->px", covariance, normal)
    sigma = np.sqrt(np.einsum("px,px->p", reached, normal).clip(0.0))
    out: Array = reached / np.where(sigma, sigma, 1.0)[:, None]
    return out


@checked_arguments(
    branch="a response curve",
    scatter="standard deviations by name, such as {'zeta': 0.002}, or a Fit",
)
def response_band(
    branch: Branch,
    scatter: Mapping[str, float] | Fit,
    *,
    measure: str = "pp2",
    element: int | str = 0,
    unit: str = "Omega",
    length: str = "",
) -> ResponseBand:
    """How a whole response curve scatters if parameters do, to first order.

    Parameters
    ----------
    branch : Branch
        A response curve that knows its problem.
    scatter : Mapping[str, float] | Fit
        Standard deviations of independent parameters, entries of tuples as ``e[0]``; or a `Fit`, whose estimates
        scatter by their covariance.
    measure, element : str, optional
        Amplitude, as of `Branch.amplitude`.
    unit : str, default "Omega"
        Of the frequency, "Omega", "mesh Hz" or "pinion r/min"; a scale that depends on what scatters moves too.
    length : str, default ""
        Unit of the amplitude, such as "um"; "" for the model's own.

    Raises
    ------
    KeyError
        If the model has no such parameter.
    ValueError
        If a deviation is negative, a fit does not determine its parameters, the curve does not know its problem, or
        the model does not know its units.

    Notes
    -----
    Of 100 machines some 95 have a curve that passes a normal of this one within two standard deviations, as long as
    the scatter is small: a band as wide as the curve is bent says no more than that. `jump_tolerance` tells by Monte
    Carlo how good the first order is at the jumps.

    Examples
    --------
    >>> import hbgear as hb
    >>> curve = hb.trace(hb.HarmonicBalance(hb.SpurPair(), 5), "Omega", (1.0, 0.6))
    >>> band = hb.design.response_band(curve, {"zeta": 0.002})
    >>> upper, lower = band.edges(2)
    >>> upper.shape == (len(curve), 2)
    True
    """
    problem = branch.problem
    if not isinstance(problem, HarmonicBalance):
        raise ValueError(
            "a band needs a response curve that knows its problem; load it: load(path, problem=HarmonicBalance(...))"
        )
    if unit not in FREQUENCIES:
        raise ValueError(f"response_band: unit = {quoted(unit)}{did_you_mean(unit, FREQUENCIES)}")
    names, covariance = _covariance(scatter)
    for name in names:
        problem.check_parameter(name)
        if name == branch.parameter:
            raise ValueError(f"{name} is what the curve is traced in; name parameters that scatter")
    metres = to_si("response_band", "length", f"1 {length}", "m") if length else 1.0
    x, y, along, moved = _in_plane(branch, problem, names, measure, element, unit, metres if length else 0.0)
    size = (float(np.ptp(x)) or 1.0, float(np.ptp(y)) or 1.0)
    along, moved = along / size, moved / size
    with np.errstate(invalid="ignore", divide="ignore"):
        normal = np.column_stack([-along[:, 1], along[:, 0]]) / np.linalg.norm(along, axis=1)[:, None]
    g = np.einsum("pax,px->pa", moved, normal)
    points = np.einsum("pax,ab,pby->pxy", moved, covariance, moved)
    deviation = np.sqrt(np.einsum("px,pxy,py->p", normal, points, normal).clip(0.0))
    effects = g * np.sqrt(np.diag(covariance))
    return ResponseBand(branch, measure, element, unit, length, x, y, names, normal, size, points, effects, deviation)


def _covariance(scatter: Mapping[str, float] | Fit) -> tuple[tuple[str, ...], Array]:
    """Names and covariance (A, A) of what scatters."""
    if isinstance(scatter, Fit):
        lost = [name for name in scatter.names if math.isnan(scatter.errors[name])]
        if lost:
            raise ValueError(f"response_band: the fit does not determine {', '.join(lost)}; fit without")
        return scatter.names, scatter.covariance
    if not scatter:
        raise ValueError("response_band: name at least one parameter that scatters, such as {'zeta': 0.002}")
    for name, deviation in scatter.items():
        checked("response_band", name, deviation, NOT_NEGATIVE)
    return tuple(scatter), np.diag([float(s) ** 2 for s in scatter.values()])


def _in_plane(
    branch: Branch, problem: HarmonicBalance, names: tuple[str, ...], measure: str, element: int | str, unit: str,
    metres: float,
) -> tuple[Array, Array, Array, Array]:  # fmt: skip
    """Frequency and amplitude (P,), the direction of the curve (P, 2), and its displacements (P, A, 2)."""
    layout = layout_of(branch)
    if layout is None:
        raise ValueError("a band needs a curve of periodic motions")
    own = problem.at_resolution_of(branch[0]).with_cache_size(2 * len(names) + 2)
    n, entries = branch.X.shape[1], problem.model.entries
    along, moved = np.full((len(branch), n + 1), math.nan), np.full((len(branch), len(names), n + 1), math.nan)
    for i, ahead in enumerate(_chords(branch)):
        here = {**entries, **branch.parameters_at(i)}
        try:
            U = np.append(branch.X[i], branch.values[i])
            along[i], slopes = of_curve(own, U, here, branch.parameter, ahead, names)
        except np.linalg.LinAlgError:
            continue  # where two curves cross: nan
        moved[i] = np.concatenate([slopes.X, slopes.p[:, None]], axis=1)
    every = np.concatenate([along[:, None], moved], axis=1)
    rates = measured_along(layout, measure, element, branch.X, every[..., :n])
    x, y, dx, dy = branch.values, branch.amplitude(measure, element), every[..., n].copy(), rates
    known, changes = units_at(own, {**entries, **branch.parameters_at(0)}, names)
    if unit != "Omega":
        x, dx = _scaled(unit, 1.0, x, dx, known, changes, problem)
    if metres:
        y, dy = _scaled(LENGTH, 1.0 / metres, y, dy, known, changes, problem)
    plane = np.stack([dx, dy], axis=-1)
    return x, y, plane[:, 0], plane[:, 1:]


def _scaled(
    unit: str, share: float, x: Array, dx: Array, known: Mapping[str, float], changes: Mapping[str, Array],
    problem: HarmonicBalance,
) -> tuple[Array, Array]:  # fmt: skip
    """Values (P,) and their derivatives (P, 1 + A) in a unit of the model, which moves too."""
    if unit not in known:
        raise ValueError(f"response_band: {type(problem.model).__name__} does not know its units; leave them out")
    scale = share * known[unit]
    moved = np.append(0.0, share * changes[unit])
    return scale * x, scale * dx + x[:, None] * moved


def _chords(branch: Branch) -> Array:
    """(P, n + 1) from the row before each to the one behind it, of length 1, with all unknowns of one size."""
    U = np.column_stack([branch.X, branch.values])
    U = U / np.append(np.full(branch.X.shape[1], np.abs(branch.X).max() or 1.0), np.ptp(branch.values) or 1.0)
    chord = np.gradient(U, axis=0)
    out: Array = chord / np.maximum(np.linalg.norm(chord, axis=1), 1e-300)[:, None]
    return out
