"""Order cuts of engineering quantities: root mean square of one harmonic of the excitation, and its level.

    x(tau) = x_0 + sum_k X_k cos(k tau - phi_k)         x_rms,k = X_k / sqrt(2)
    L_k = 20 lg(x_rms,k / x_ref)                         x_ref = 1 um/s^2, 1 uN (ISO 1683), 1 um

The transmission error is d + e, the force that of the law of the element, and the acceleration that of a coordinate, or
the second derivative of d + e in time. Without scales the values are in units of the model and x_ref is one of them.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from hbgear.analysis.quantities.engineering_quantities import element_force, problem_and_motions, total_error
from hbgear.common.argument_checks import checked_arguments
from hbgear.common.arrays import Array
from hbgear.common.ranges import counted
from hbgear.common.text.messages import quoted
from hbgear.continuation.results.branch import Branch
from hbgear.continuation.results.point import Point, dof_index
from hbgear.harmonic.harmonic_balance import HarmonicBalance
from hbgear.harmonic.models.frequency_units import model_of
from hbgear.mechanics.series.measures import derivative, harmonic

LOWEST_LEVEL_RATIO = 1e-15
"""Value over the reference below which the level remains -300 dB: a harmonic that is zero has no level."""


class _Cut(NamedTuple):
    """Unit, reference in this unit, and its text; and the unit of the model in this unit by the attribute of scales."""

    unit: str
    reference: float
    text: str
    scale: str
    factor: float


CUTS = {
    "transmission error": _Cut("um", 1.0, "1 um", "length", 1e6),
    "force": _Cut("N", 1e-6, "1 uN", "force", 1.0),
    "acceleration": _Cut("m/s^2", 1e-6, "1 um/s^2", "acceleration", 1.0),
}
"""Quantities of order cuts by name."""


@checked_arguments()
def order_amplitudes(
    found: Branch | Point, quantity: str, order: int = 1, element: int | str = 0, dof: int | str | None = None
) -> Array:
    """Compute the root mean square of a harmonic of a quantity; see the equations in the module header.

    Parameters
    ----------
    found : Branch or Point
        Branch of a harmonic balance, or one of its points with its problem.
    quantity : {"transmission error", "force", "acceleration"}
        Quantity.
    order : int, optional
        Harmonic of the excitation, 1 or more; default 1.
    element : int or str, optional
        Mesh by number or name; default 0.
    dof : int or str, optional
        Coordinate of the acceleration, by number or name. By default the acceleration is that of the transmission
        error.

    Returns
    -------
    ndarray
        Values at each point in um, N or m/s^2 if the model has `Scales`, else in units of the model.

    Raises
    ------
    ValueError, KeyError
        If the quantity, the harmonic, the element, the coordinate or the problem is unknown.

    Examples
    --------
    >>> import hbgear as hb
    >>> curve = hb.trace(hb.HarmonicBalance(hb.SpurPair(), 8), "Omega", (1.5, 1.4))
    >>> names = ("transmission error", "acceleration")
    >>> error, acceleration = (hb.analysis.order_amplitudes(curve, name, order=1) for name in names)
    >>> bool(abs(acceleration[0] / curve.values[0] ** 2 / error[0] - 1) < 1e-9)
    True
    """
    _check(quantity)
    counted("order", order)
    problem, X, parameter_sets = problem_and_motions(found, "an order cut at a point")
    if order > problem.H // problem.nu:
        raise ValueError(f"order_amplitudes: no harmonic {order} among {problem.H // problem.nu}; use more harmonics")
    index, values = problem.layout.index(element), np.empty(len(X))
    for i, (row, parameters) in enumerate(zip(X, parameter_sets, strict=True)):
        if quantity == "force":
            samples = element_force(problem, row, parameters, index)
            size = 2 * abs(np.fft.rfft(samples)[order * problem.nu]) / len(samples)
        else:
            size = float(harmonic(_row(problem, row, parameters, index, quantity, dof), order * problem.nu))
        scales: Any = problem.model_at(parameters).scales
        unit = 1.0 if scales is None else getattr(scales, CUTS[quantity].scale) * CUTS[quantity].factor
        values[i] = size / np.sqrt(2) * unit
    return values


def order_levels(
    motions: Branch | Point,
    quantity: str,
    order: int = 1,
    element: int | str = 0,
    dof: int | str | None = None,
    dimensionless: bool = False,
) -> Array:
    """Return the levels of `order_amplitudes` [dB]; the reference is in `level_title`.

    With ``dimensionless`` it is one unit of the model although the model has scales.

    Examples
    --------
    >>> import hbgear as hb
    >>> curve = hb.trace(hb.HarmonicBalance(hb.SpurPair(), 8), "Omega", (1.5, 1.4))
    >>> cut = hb.analysis.order_amplitudes(curve, "force", 1)
    >>> bool(np.allclose(order_levels(curve, "force", 1), 20 * np.log10(cut)))
    True
    """
    values = order_amplitudes(motions, quantity, order, element, dof)
    reference, cut = 1.0, CUTS[quantity]
    scales: Any = _scales(motions)
    if scales is not None:
        reference = getattr(scales, cut.scale) * cut.factor if dimensionless else cut.reference
    return 20 * np.log10(np.maximum(values / reference, LOWEST_LEVEL_RATIO))


def level_title(motions: Branch | Point, quantity: str, dimensionless: bool = False) -> str:
    """Return the label of an axis of `order_levels`, with the reference value."""
    _check(quantity)
    has_units = _scales(motions) is not None and not dimensionless
    return f"level of the {quantity} [dB re {CUTS[quantity].text if has_units else '1 unit of the model'}]"


def _check(quantity: str) -> None:
    if quantity not in CUTS:
        raise ValueError(f"no order cut of {quoted(quantity)}; there are {', '.join(CUTS)}")


def _scales(motions: Branch | Point) -> Any:
    model = model_of(motions) if isinstance(motions, Branch) else getattr(motions.problem, "model", None)
    return getattr(model, "scales", None)


def _row(
    problem: HarmonicBalance, X: Array, parameters: dict[str, float], index: int, quantity: str, dof: int | str | None
) -> Array:
    """Return the coefficients of a displacement, or of its second derivative in time."""
    if quantity == "transmission error":
        return total_error(problem, X, parameters, index)
    if dof is None:
        row = total_error(problem, X, parameters, index)
    else:
        row = problem.motion(X, **parameters)[dof_index(dof, problem.dof_names)]
    return derivative(row[None], np.array([parameters["Omega"] / problem.nu]), 2)[0]
