"""Sensitivities: derivatives of a frequency and an amplitude in each parameter of the model.

    dOmega/da, dA/da          of a special point, a peak or a jump; of a motion at a fixed frequency dA/da alone
    n = s(a) Omega:           dn/da = s dOmega/da + Omega ds/da       in r/min and Hz, L(a) A in metres

They follow from the equations of the point (`hbgear.continuation.augmented.sensitivity`). The scales s and L depend on
parameters as well.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from hbgear.analysis.critical_parameters import CriticalParameter
from hbgear.analysis.parameter_sensitivity.point_sensitivity import (
    PointSensitivity,
    Row,
    differentiable,
    expanded_at,
    parameter_names,
    problem_and_parameters,
)
from hbgear.analysis.parameter_sensitivity.table import Sensitivity
from hbgear.analysis.parameter_sensitivity.units import units_at
from hbgear.common.argument_checks import checked_arguments
from hbgear.common.text.symbols import shown_unit
from hbgear.continuation.results.point import Jump, Point, SpecialPoint

_EXTRA_PARAMETER_SETS = 32
"""Number of cached sets of parameters in addition to two for each derivative."""


@checked_arguments(
    point="a special point, peak, jump, critical parameter or point of a branch, such as curve['LP1']",
    parameters="names of parameters, such as ('zeta', 'e[0]')",
)
def sensitivity(
    point: Point | Jump | CriticalParameter,
    parameters: Sequence[str] | None = None,
    *,
    measure: str | None = None,
    element: int | str = 0,
    multipliers: bool = False,
) -> Sensitivity:
    """Compute derivatives of the frequency and amplitude of a point in the parameters of its model.

    The derivative of a fold is dOmega/da = -(w . R_a) / (w . R_Omega). The derivatives of other special points follow
    from their augmented equations. Of any other point the frequency is fixed and the amplitude has derivatives.

    Parameters
    ----------
    point : Point, Jump or CriticalParameter
        Point of a branch that knows its problem, such as ``curve["LP1"]``, ``curve.jumps()[0]``,
        ``hb.analysis.peaks(curve)[0]`` or ``curve[7]``, or a critical parameter, whose first quantity is its value.
    parameters : sequence of str, optional
        Names of parameters; entries of tuples as ``eps[0]``. By default all parameters of the model.
    measure : str, optional
        Measure of amplitude, see `Branch.amplitude`. By default "rms", for a peak its own measure.
    element : int or str, optional
        Element by number or name. The default is the first element.
    multipliers : bool, optional
        If True, the largest modulus of the multipliers is a further quantity. The default is False.

    Returns
    -------
    Sensitivity
        Quantities and their derivatives.

    Raises
    ------
    KeyError
        If the model has no such parameter.
    ValueError
        If the point does not know its problem or was not located, or its kind has no equations.
    NoConvergence
        If the equations of the point cannot be solved.

    Notes
    -----
    Derivatives in parameters are central differences of the equations, one-sided at the end of a range, with a relative
    error of about 1e-8, and of about 1e-6 for Neimark-Sacker points of contacts with dampers or friction, whose
    multipliers are differentiated. Special points of curves in contact instants are located again with changed
    parameters. If a change of a parameter separates two branches that intersect, the derivatives of their branch point
    are nan.

    References
    ----------
    Govaerts (2000), Numerical Methods for Bifurcations of Dynamical Equilibria, SIAM,
    https://doi.org/10.1137/1.9780898719543.

    Examples
    --------
    >>> import hbgear as hb
    >>> curve = hb.trace(hb.HarmonicBalance(hb.SpurPair(), 8), "Omega", (1.0, 0.6))
    >>> table = hb.analysis.sensitivity(curve["LP1"], ["zeta", "e[0]"])
    >>> round(table.of("Omega")["zeta"], 2) > 0
    True
    """
    if parameters is not None and not len(parameters):
        raise ValueError("sensitivity: name at least one parameter, such as ['zeta'], or give None for all")
    if isinstance(point, CriticalParameter):
        point = point.point
    base_point = differentiable(point.before if isinstance(point, Jump) else point, exact=True)
    problem, values_by_name, parameter = problem_and_parameters(base_point)
    names = parameter_names(problem, values_by_name, parameter, parameters)
    cached = expanded_at(problem, base_point, values_by_name, 2 * len(names) + _EXTRA_PARAMETER_SETS)
    base = PointSensitivity(cached, base_point, values_by_name, parameter, names)
    slopes = base.slopes()
    rows: list[Row] = [(parameter, values_by_name[parameter], slopes.p)]
    rows += [(name, values_by_name[name], X_a) for name, X_a in base.unknown_parameters(slopes)]
    units = units_at(base.problem, values_by_name, names)
    rows += base.speeds(rows, units)
    note = base_point.note if isinstance(base_point, SpecialPoint) and base_point.kind == "PK" else ""
    amplitude = measure or note.removeprefix("peak of ") or "rms"
    motions = [(amplitude, base, slopes.X)]
    if isinstance(point, Jump) and point.after is not None:
        motions[0] = (f"{amplitude} before", base, slopes.X)
        motions.append((f"{amplitude} after", *base.at_landing(point.after, slopes.p)))
    for name, motion, X_a in motions:
        rows += motion.amplitudes(name, amplitude, element, X_a, units)
    if multipliers:
        rows.append(base.largest_multiplier(slopes))
    label = point.label or "a point"
    values = np.array([values_by_name[name] for name in names])
    quantities, sizes, derivatives = zip(*rows, strict=True)
    labels = getattr(getattr(base.problem, "model", None), "labels", {})
    shown_units = {name: unit for name in names if (unit := shown_unit(labels.get(name, "")))}
    return Sensitivity(label, names, values, quantities, np.array(sizes), np.array(derivatives), shown_units)
