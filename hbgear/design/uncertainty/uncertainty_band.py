"""Uncertainty band of a response curve whose parameters scatter: first-order displacement of the curve.

    (Omega, A)(s, a):   d = d(Omega, A)/da,   sigma^2 = g^T C g,   g_a = n . d_a

n is the normal to the curve in the plane of frequency and amplitude, and C is the covariance of the parameters. At a
fold the amplitude has no derivative at constant frequency. The displacement normal to the curve has one, because a
displacement of a point along the curve does not move the curve. Hence

    scatter of the amplitude at constant frequency:  sigma / n_A
    scatter of the frequency at constant amplitude:  sigma / n_Omega

Each point of the curve moves normal to the curve in the space of the unknowns and scatters by S = sum d C d^T in the
plane. The band is the union of these ellipses, k standard deviations large. Its edges are at

    (Omega, A) +- k S n / sigma,   sigma^2 = n^T S n

where the band touches the ellipses.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from hbgear.analysis.parameter_sensitivity.exact_point import neighbouring_families, slopes_of_curve
from hbgear.analysis.parameter_sensitivity.units import LENGTH, measured_along, units_at, units_of
from hbgear.analysis.quantities.length_units import MICROMETRE, dimension_of
from hbgear.common.argument_checks import checked_arguments
from hbgear.common.arrays import Array
from hbgear.common.ranges import POSITIVE, checked
from hbgear.common.text.messages import did_you_mean, quoted
from hbgear.common.units import to_si
from hbgear.continuation.augmented.sensitivity import of_curve
from hbgear.continuation.problem.curve_equations import CurveEquations
from hbgear.continuation.results.branch import Branch
from hbgear.continuation.solvers.newton import NoConvergence
from hbgear.design.bounds import check_scatter
from hbgear.design.fitting.fit import Fit
from hbgear.design.fitting.measurements import FREQUENCIES
from hbgear.harmonic.contact_instants.problem import ContactInstants
from hbgear.harmonic.equations.layout import layout_of
from hbgear.harmonic.harmonic_balance import HarmonicBalance
from hbgear.harmonic.models.frequency_units import PINION


@dataclass(frozen=True, eq=False, repr=False)
class ResponseBand:
    """Response curve and the standard deviation of its displacement.

    Attributes
    ----------
    branch, measure, element : Branch, str and int or str
        Curve, and measure and element of its amplitude.
    unit, length : str
        Units of frequency and amplitude; "" for the unit of length of the model.
    frequency, amplitude : ndarray, shape (P,)
        Frequency and amplitude of the points of the branch, in these units.
    parameters : tuple of str
        Names of the A parameters that scatter.
    normal : ndarray, shape (P, 2)
        Unit normals to the curve, with frequency and amplitude divided by ``size``; nan where two curves intersect.
    size : tuple of float
        Ranges of frequency and amplitude, the units of normals and displacements.
    covariance : ndarray, shape (P, 2, 2)
        Covariance of the points, in the same units.
    effects : ndarray, shape (P, A)
        Displacement along the normal for one standard deviation of each parameter.
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
        return f"<Band of {self.measure} over {self.unit}: {len(self.frequency)} points, {', '.join(self.parameters)}>"

    @property
    def at_frequency(self) -> Array:
        """Standard deviation (P,) of the amplitude at constant frequency; infinite at folds."""
        return self._deviation_along(1)

    @property
    def at_amplitude(self) -> Array:
        """Standard deviation (P,) of the frequency at constant amplitude; infinite at peaks."""
        return self._deviation_along(0)

    def _deviation_along(self, axis: int) -> Array:
        with np.errstate(divide="ignore", invalid="ignore"):
            return self.size[axis] * self.deviation / np.abs(self.normal[:, axis])

    @checked_arguments()
    def edges(self, sigmas: float = 2.0) -> tuple[Array, Array]:
        """Return both edges of the band, (P, 2) frequency and amplitude each, at ``sigmas`` standard deviations."""
        checked("edges", "sigmas", sigmas, POSITIVE)
        middle = np.column_stack([self.frequency, self.amplitude])
        offsets = sigmas * ellipse_contact(self.covariance, self.normal) * self.size
        return middle + offsets, middle - offsets


def ellipse_contact(covariance: Array, normal: Array) -> Array:
    """Return S n / sigma (P, 2), where ellipses of covariances S (P, 2, 2) touch lines with normals n (P, 2)."""
    projected = np.einsum("pxy,py->px", covariance, normal)
    sigma = np.sqrt(np.einsum("px,px->p", projected, normal).clip(0.0))
    return projected / np.where(sigma, sigma, 1.0)[:, None]


@checked_arguments(branch="a response curve", scatter="standard deviations by name, such as {'zeta': 0.002}, or a Fit")
def response_band(
    branch: Branch,
    scatter: Mapping[str, float] | Fit,
    *,
    measure: str = "pp2",
    element: int | str = 0,
    unit: str | None = None,
    length: str | None = None,
) -> ResponseBand:
    """Compute the first-order scatter of a response curve due to scattering parameters.

    Parameters
    ----------
    branch : Branch
        Response curve with its problem.
    scatter : mapping of str to float, or Fit
        Standard deviations of independent parameters, also entries of tuples such as ``e[0]``. A `Fit` supplies the
        covariance of its estimates.
    measure, element : str and int or str, optional
        Measure ("pp2" by default) and element (0 by default) of `Branch.amplitude`.
    unit : {"Omega", "mesh Hz", "pinion r/min"}, optional
        Unit of the frequency; default "pinion r/min" if the model has scales, else "Omega". If a scattering parameter
        changes the unit, this effect is included.
    length : str, optional
        Unit of the amplitude; "" for the unit of the model. Default "um" if the model has scales.

    Raises
    ------
    KeyError
        If the model has no such parameter.
    ValueError
        If a deviation is negative, a fit does not determine its parameters, the curve has no problem, or the model does
        not know its units.

    Notes
    -----
    For small scatter, about 95 of 100 machines have a curve that intersects a normal of this one within two standard
    deviations. The band is not valid if its width is comparable to the radius of curvature of the curve.
    `jump_tolerance` compares the first order with a Monte Carlo sample at the jumps.

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
            "a band needs a response curve with its problem; load it: load(path, problem=HarmonicBalance(...))"
        )
    physical = branch.parameter == "Omega" and bool(units_of(problem.model))
    unit = unit or (PINION if physical else "Omega")
    length = length if length is not None else MICROMETRE if physical and dimension_of(measure) == 1 else ""
    if unit not in FREQUENCIES:
        raise ValueError(f"response_band: unit = {quoted(unit)}{did_you_mean(unit, FREQUENCIES)}")
    if unit != "Omega" and branch.parameter != "Omega":
        raise ValueError(
            f"response_band: the curve is over {branch.parameter}, so unit = {quoted(unit)} has no meaning; "
            "leave it out"
        )
    names, covariance = _covariance(scatter)
    for name in names:
        problem.check_parameter(name)
        if name == branch.parameter:
            raise ValueError(f"{name} is the continuation parameter of the curve; name other parameters that scatter")
    metres = to_si("response_band", "length", f"1 {length}", "m") if length else 1.0
    x, y, direction, shifts = _in_plane(branch, problem, names, measure, element, unit, metres if length else 0.0)
    size = (float(np.ptp(x)) or 1.0, float(np.ptp(y)) or 1.0)
    direction, shifts = direction / size, shifts / size
    with np.errstate(invalid="ignore", divide="ignore"):
        normal = np.column_stack([-direction[:, 1], direction[:, 0]]) / np.linalg.norm(direction, axis=1)[:, None]
    g = np.einsum("pax,px->pa", shifts, normal)
    points = np.einsum("pax,ab,pby->pxy", shifts, covariance, shifts)
    deviation = np.sqrt(np.einsum("px,pxy,py->p", normal, points, normal).clip(0.0))
    effects = g * np.sqrt(np.diag(covariance))
    return ResponseBand(branch, measure, element, unit, length, x, y, names, normal, size, points, effects, deviation)


def _covariance(scatter: Mapping[str, float] | Fit) -> tuple[tuple[str, ...], Array]:
    """Return names and covariance (A, A) of the scattering parameters."""
    if isinstance(scatter, Fit):
        lost = [name for name in scatter.names if math.isnan(scatter.errors[name])]
        if lost:
            raise ValueError(
                f"response_band: the fit does not determine {', '.join(lost)}; fit without these parameters"
            )
        return scatter.names, scatter.covariance
    check_scatter("response_band", scatter)
    return tuple(scatter), np.diag([float(s) ** 2 for s in scatter.values()])


def _in_plane(
    branch: Branch,
    problem: HarmonicBalance,
    names: tuple[str, ...],
    measure: str,
    element: int | str,
    unit: str,
    metres: float,
) -> tuple[Array, Array, Array, Array]:
    """Return frequency and amplitude (P,), the direction of the curve (P, 2) and its displacements (P, A, 2)."""
    layout = layout_of(branch)
    if layout is None:
        raise ValueError("a band needs a curve of periodic motions")
    fixed = problem.at_resolution_of(branch[0]).with_cache_size(2 * len(names) + 2)
    n, entries = branch.X.shape[1], problem.model.entries
    direction, shifts = np.full((len(branch), n + 1), math.nan), np.full((len(branch), len(names), n + 1), math.nan)
    if isinstance(problem, ContactInstants):
        others = {name: x for name, x in branch.parameters_at(0).items() if name != branch.parameter}
        families = neighbouring_families(problem, branch.parameter, others)
    for i, secant in enumerate(_secants(branch)):
        parameters = {**entries, **branch.parameters_at(i)}
        try:
            if isinstance(problem, ContactInstants):
                direction[i], slopes = slopes_of_curve(problem, branch[i], parameters, secant, names, families)
            else:
                U = np.append(branch.X[i], branch.values[i])
                direction[i], slopes = of_curve(CurveEquations(fixed, branch.parameter, parameters), U, secant, names)
        except (np.linalg.LinAlgError, NoConvergence):
            continue  # intersection of two curves, or a motion that is not known exactly: nan
        shifts[i] = np.concatenate([slopes.X, slopes.p[:, None]], axis=1)
    rates_of_unknowns = np.concatenate([direction[:, None], shifts], axis=1)
    rates = measured_along(layout, measure, element, branch.X, rates_of_unknowns[..., :n])
    x, y, dx, dy = branch.values, branch.amplitude(measure, element), rates_of_unknowns[..., n].copy(), rates
    units, unit_slopes = units_at(fixed, {**entries, **branch.parameters_at(0)}, names)
    if unit != "Omega":
        x, dx = _scaled(unit, 1.0, x, dx, units, unit_slopes, problem)
    if metres:
        y, dy = _scaled(LENGTH, 1.0 / metres, y, dy, units, unit_slopes, problem)
    plane = np.stack([dx, dy], axis=-1)
    return x, y, plane[:, 0], plane[:, 1:]


def _scaled(
    unit: str,
    factor: float,
    x: Array,
    dx: Array,
    units: Mapping[str, float],
    unit_slopes: Mapping[str, Array],
    problem: HarmonicBalance,
) -> tuple[Array, Array]:
    """Return values (P,) and derivatives (P, 1 + A) in a unit of the model, including the derivatives of the unit."""
    if unit not in units:
        raise ValueError(f"response_band: {type(problem.model).__name__} does not know its units; leave them out")
    scale = factor * units[unit]
    scale_slopes = np.append(0.0, factor * unit_slopes[unit])
    return scale * x, scale * dx + x[:, None] * scale_slopes


def _secants(branch: Branch) -> Array:
    """Return unit vectors (P, n + 1) from the point before each point to the point after it, with scaled unknowns."""
    U = np.column_stack([branch.X, branch.values])
    U = U / np.append(np.full(branch.X.shape[1], np.abs(branch.X).max() or 1.0), np.ptp(branch.values) or 1.0)
    secant = np.gradient(U, axis=0)
    return secant / np.maximum(np.linalg.norm(secant, axis=1), 1e-300)[:, None]
