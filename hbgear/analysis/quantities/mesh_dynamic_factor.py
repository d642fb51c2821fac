"""Dynamic factor of a mesh: largest force over static force.

    K = max_tau p(d, d', tau) / mean_tau p(d, d', tau)

p is the force of the law and its friction sliders, without the damper in parallel. Its mean is the static force,
because the mean damper force over a period is zero. The dynamic factor is not defined if the static force is zero: if
|mean p| is at most 1e-6 max |p|, the accuracy of a motion, at most the error of a mean of samples where the stiffness
jumps, or at most 1e-9 of the largest product of stiffness and displacement of the elements of the machine, which is
rounding. The error is estimated from the means of every eighth sample: for one jump their range is 14 times the largest
error of the mean of all.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from hbgear.common.argument_checks import checked_arguments
from hbgear.common.arrays import Array, ComplexArray
from hbgear.common.text.messages import quoted
from hbgear.continuation.results.point import Point
from hbgear.harmonic.equations.layout import Layout, layout_of
from hbgear.harmonic.forces.breakpoints import gap_samples
from hbgear.harmonic.harmonic_balance import HarmonicBalance
from hbgear.mechanics.laws.mesh_contacts import MeshContacts
from hbgear.mechanics.laws.slider import friction_limits, limit_at, steady_force
from hbgear.mechanics.laws.vector_laws import Component
from hbgear.mechanics.models import Model
from hbgear.mechanics.series.fourier import stretch, to_complex
from hbgear.mechanics.structures.elements import Element

_FORCE_ACCURACY = 1e-6
"""Relative accuracy of the forces of a motion."""

_COARSE_MEANS, _SAFE_RANGE = 8, 4.0
"""Number of means of a part of the samples, and their range over the largest error of the mean of all samples; for many
jumps at random phases the range is five times the standard deviation of the error."""

_FORCE_ROUNDING = 1e-9
"""Static force over the largest force level of the elements, below which it is rounding."""

_SLOPE_PHASES = 16
"""Number of phases of a period at which the slope of a law is evaluated."""

FORCE_SAMPLES = 4096
"""Number of samples of the force over a period; a breakpoint between two samples changes it by 1e-6 of the force."""


@checked_arguments()
def dynamic_factor(model: Model, point: Point, element: int | str = 0) -> float:
    """Compute the largest over the static force of an element; see the equation in the module header.

    Parameters
    ----------
    model : Model
        Model of the branch of the point.
    point : Point
        Point of a branch of periodic motions.
    element : int or str, optional
        Element by number or name. The default is the first element.

    Returns
    -------
    float
        Dynamic factor.

    Raises
    ------
    ValueError
        If the point has no layout, there is no such element, or its static force is zero.

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
        raise ValueError("dynamic_factor: the point has no layout; give a point of a branch of a HarmonicBalance")
    elements, index = model.at(point.parameters).system().elements, layout.index(element)
    force = _forces(elements, point, layout, index)
    rows = np.array([point.coefficients(j) for j in range(len(layout.elements))])
    if not is_static(force, force_level(elements, rows)):
        raise ValueError(
            f"dynamic_factor: the static force of {quoted(layout.elements[index])} is zero, so the factor is not "
            "defined; use the column 'force, largest' of hb.analysis.machine_quantities"
        )
    problem = point.problem
    if isinstance(problem, HarmonicBalance):
        problem = problem.at_resolution_of(point)
        return float(np.max(force / static_force(problem, point.X, dict(point.parameters), index, force)))
    return float(np.max(force / force.mean()))


def static_force(problem: HarmonicBalance, X: Array, parameters: dict[str, float], index: int, force: Array) -> float:
    """Return the mean of the force of an element of which the samples `force` are given.

    It is that of the balance, because samples of a stiffness that jumps have a mean with an error up to 1e-3. With
    friction between teeth it is that of the samples: the balance has the moment of the friction in the same force.
    """
    law = problem.compiled(parameters).system.elements[index].law
    if isinstance(law, MeshContacts) and law.sliding is not None:
        return float(force.mean())
    return float(problem.force_rows(X, **parameters)[index, 0])


def is_static(force: Array, level: float) -> bool:
    """Return whether the mean of a force is larger than its accuracy and rounding.

    The thresholds are in the module header. The number of samples over the period of its motion is a multiple of 8;
    ``level`` is the `force_level` of the machine.
    """
    by_jumps = np.ptp(force.reshape(-1, _COARSE_MEANS).mean(axis=0)) / _SAFE_RANGE
    accuracy = max(_FORCE_ACCURACY * np.abs(force).max(), by_jumps)
    return bool(abs(force.mean()) > max(accuracy, _FORCE_ROUNDING * level))


def force_level(elements: Sequence[Element], rows: Array) -> float:
    """Return the largest product of stiffness and displacement of elements with Fourier coefficients (m, 2H + 1)."""
    sizes = np.abs(rows).sum(axis=1)
    return float(max(_max_stiffness(e, size) * size for e, size in zip(elements, sizes.tolist(), strict=True)))


def _max_stiffness(element: Element, size: float) -> float:
    """Return the largest slope of a law at zero, at displacements of this size, and beyond its breakpoints."""
    outside = [2 * abs(breakpoint_) or 1.0 for breakpoint_ in element.law.breakpoints]
    d = np.array([0.0, *(side * x for x in (size, *outside) for side in (-1, 1))])
    n = _SLOPE_PHASES
    tau = 2 * np.pi * np.arange(n) / n
    slopes = element.law.force(np.repeat(d, n), np.zeros(n * len(d)), np.tile(tau, len(d)))[1]
    return float(np.abs(slopes).max())


def _forces(elements: Sequence[Element], point: Point, layout: Layout, index: int) -> Array:
    """Return samples of the force of the law of an element over the period of its motion, shape (N,)."""
    nu = layout.nu
    rows = np.array([point.coefficients(j) for j in range(len(layout.elements))])

    def prescribed(j: int) -> ComplexArray:
        return to_complex(stretch(elements[j].displacement.row(layout.harmonics // nu), nu))

    return force_samples(elements, index, prescribed, rows, point.parameters["Omega"] / nu, nu)


def force_samples(
    elements: Sequence[Element],
    index: int,
    prescribed: Callable[[int], ComplexArray],
    rows: Array,
    rate: float,
    nu: int,
    count: int = FORCE_SAMPLES,
) -> Array:
    """Return samples (N,) of the force of an element at equidistant phases over the period of its motion.

    ``prescribed`` returns the harmonics of the prescribed displacement of an element by its number, as for
    `hbgear.harmonic.forces.breakpoints.gap_samples`. ``rows`` (m, 2H + 1) are the displacements of all elements over nu
    periods of the excitation, ``rate`` is dtheta/dt of the phase, and ``count`` is N.
    """
    tau = nu * (2 * np.pi * np.arange(count) / count)

    def gap(j: int, order: int = 0) -> Array:
        return gap_samples(elements[j].displacement, prescribed(j), nu, rows[j], count, order)

    law = elements[index].law
    if isinstance(law, Component):
        group = range(index - law.index, index - law.index + law.law.size)
        d, v = np.array([gap(j) for j in group]), rate * np.array([gap(j, 1) for j in group])
        return law.law.force(d, v, tau)[0][law.index]
    law = law.normal if isinstance(law, MeshContacts) else law
    d = gap(index)
    force = law.force(d, rate * gap(index, 1), tau)[0]
    for j, slider, limit in friction_limits(elements) if law.sliders else ():
        if j == index:
            normal = gap(limit.normal) if limit.normal >= 0 else None
            force = force + steady_force(slider, d, np.maximum(limit_at(limit, normal, tau), 0.0))
    return force
