"""Dynamic factor of a mesh: how much larger its force becomes than the one it transmits.

    K = max_tau p(d, d', tau) / mean_tau p(d, d', tau)

p is the force of the law, without the damper in parallel. Its mean is the static force, since the mean of the force of
the damper over a period is zero. Where the static force is zero there is no dynamic factor: |mean p| at most 1e-6 max
|p|, the accuracy of a motion, or at most 1e-9 of the forces that the elements of the machine have at its displacements,
which is rounding.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from hbgear.common.argument_checks import checked_arguments
from hbgear.common.arrays import Array, ComplexArray
from hbgear.common.text.messages import quoted
from hbgear.continuation.results.point import Point
from hbgear.harmonic.equations.layout import Layout, layout_of
from hbgear.harmonic.forces.breakpoints import gap_samples
from hbgear.mechanics.models import Element, Model
from hbgear.mechanics.series.fourier import stretch, to_complex

_ACCURACY = 1e-6  # relative accuracy of the forces of a motion

_ROUNDING = 1e-9  # forces over those of the machine, below which they are rounding

_PHASES = 16  # of a period, at which the slope of a law is looked at

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
        If the point does not say how it is to be read, there is no such element, or its static force is zero.

    Examples
    --------
    >>> import hbgear as hb
    >>> pair = hb.SpurPair()
    >>> curve = hb.trace(hb.HarmonicBalance(pair, 16), "Omega", (1.5, 0.3))
    >>> jump = curve.jumps()[0]
    >>> round(hb.analysis.dynamic_factor(pair, jump.before), 2), round(hb.analysis.dynamic_factor(pair, jump.after), 2)
    (3.63, 1.5)
    """
    layout = layout_of(point)
    if layout is None:
        raise ValueError("dynamic_factor: the point does not say how its unknowns are to be read")
    here, index = model.at(point.parameters), layout.index(element)
    force = _forces(here, point, layout, index)
    mean = float(force.mean())
    rows = np.array([point.coefficients(j) for j in range(len(layout.elements))])
    if not is_static(mean, float(np.abs(force).max()), force_level(here.system().elements, rows)):
        raise ValueError(
            f"dynamic_factor: the static force of {quoted(layout.elements[index])} is zero, and a factor over it is "
            "not defined: use the largest force, 'force, largest' of hbgear.answers"
        )
    return float(np.max(force / mean))


def is_static(static: float, largest: float, level: float) -> bool:
    """Whether a static force is not zero; thresholds at the head of this file.

    Parameters
    ----------
    static, largest : mean and largest size of the force of an element.
    level : size of the forces of the machine, of `force_level`.
    """
    return abs(static) > max(_ACCURACY * largest, _ROUNDING * level)


def force_level(elements: Sequence[Element], rows: Array) -> float:
    """Largest of stiffness times displacement of the elements, for displacements with coefficients rows (m, 2H + 1)."""
    sizes = np.abs(rows).sum(axis=1)
    return float(max(_stiffness(one, size) * size for one, size in zip(elements, sizes.tolist(), strict=True)))


def _stiffness(one: Element, size: float) -> float:
    """Largest slope of a law over displacements up to a size, and beyond its corners."""
    far = [2 * abs(corner) or 1.0 for corner in one.law.breakpoints]
    d = np.array([0.0, *(side * each for each in (size, *far) for side in (-1, 1))])
    tau = 2 * np.pi * np.arange(_PHASES) / _PHASES
    slopes = one.law.force(np.repeat(d, _PHASES), np.zeros(_PHASES * len(d)), np.tile(tau, len(d)))[1]
    return float(np.abs(slopes).max())


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
