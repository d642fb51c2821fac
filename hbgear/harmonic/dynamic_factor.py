"""Dynamic factor of a mesh: how much larger its force becomes than the one it transmits.

    K = max_tau p(d, d', tau) / mean_tau p(d, d', tau)

p is the force of the law, without the damper beside it. Its mean is the force at rest, for the mean of the damper's
force over a period is nothing.
"""

from __future__ import annotations

import numpy as np

from hbgear.common.arguments import checked_arguments
from hbgear.common.arrays import Array, ComplexArray
from hbgear.continuation.branch import Point
from hbgear.harmonic.corners import gap_samples
from hbgear.harmonic.observables import Layout, layout_of
from hbgear.mechanics.fourier import stretch, to_complex
from hbgear.mechanics.model import Element, Model

_SAMPLES = 4096  # a corner of the force between two of them is missed by 1e-6 of the force


@checked_arguments()
def dynamic_factor(model: Model, point: Point, element: int | str = 0) -> float:
    """Largest over mean force of an element; equation at the head of this file.

    Parameters
    ----------
    model : the model the point was traced with.
    point : a `Point` of a curve.
    element : which element, by number or name.

    Raises
    ------
    ValueError
        If the point does not say how it is to be read, there is no such element, or its mean force is nothing.

    Examples
    --------
    >>> import hbgear as hb
    >>> pair = hb.SpurPair()
    >>> curve = hb.trace(hb.HarmonicBalance(pair, 16), "Omega", (1.5, 0.3))
    >>> jump = curve.jumps()[0]
    >>> round(hb.dynamic_factor(pair, jump.before), 2), round(hb.dynamic_factor(pair, jump.after), 2)
    (3.63, 1.5)
    """
    layout = layout_of(point)
    if layout is None:
        raise ValueError("dynamic_factor: the point does not say how its unknowns are to be read")
    force = _forces(model.at(point.parameters), point, layout, layout.index(element))
    mean = float(force.mean())
    if abs(mean) < 1e-12 * float(np.abs(force).max() or 1.0):
        raise ValueError("dynamic_factor: the mean force is nothing, so there is nothing to compare with")
    return float(np.max(force / mean))


def _forces(model: Model, point: Point, layout: Layout, index: int) -> Array:
    """Force of the law of an element at equal steps of its period (N,)."""
    one, row, nu = model.system().elements[index], point.coefficients(index), layout.nu
    kept = to_complex(stretch(one.displacement.row(layout.harmonics // nu), nu))
    return force_samples(one, kept, row, point.parameters["Omega"] / nu, nu)


def force_samples(one: Element, kept: ComplexArray, row: Array, rate: float, nu: int) -> Array:
    """Force of an element whose motion is a row at equal steps of its period (N,).

    kept as of `corners.gap`; rate = dtheta/dt.
    """
    d, slope = (gap_samples(one.displacement, kept, nu, row, _SAMPLES, order) for order in (0, 1))
    theta = 2 * np.pi * np.arange(_SAMPLES) / _SAMPLES
    force: Array = one.law.force(d, rate * slope, nu * theta)[0]
    return force
