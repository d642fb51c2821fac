"""Engineering quantities along a branch: tooth forces, dynamic factor, transmission error, acceleration.

    dte = w^T q = d + e(tau)          half of its peak-to-peak value
    p(tau)                            force of the law of an element with its friction sliders, without its damper
    K = max p / mean p                dynamic factor; the mean of p is the static force, as the mean damper force is 0;
                                      nan where the static force is zero, see `dynamic_factor`
    a = rms of q'',   L = 20 lg(a / 1e-6 m/s^2)        acceleration of a coordinate and its level (ISO 1683)
    F = |K q + C q'|                  reaction of a support that the model names (`Model.reactions`)
    P = relative omega_1 r_b1 mean slide           power loss of a mesh with friction between its teeth (`ToothSliding`)
    P_1 = omega_1 r_b1 mean (p + lever across + slide),   eta = 1 - P / P_1,   or P_1 / (P_1 - P) if the wheel drives

With friction p is the normal force in the transverse plane, and the forces across the line of action are |across|.
Quantities have SI units if the model has `Scales`, otherwise the units of the model.
"""

from __future__ import annotations

import csv
import dataclasses
import io
import math
import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from hbgear.analysis.quantities.mesh_dynamic_factor import (
    FORCE_SAMPLES,
    force_level,
    force_samples,
    is_static,
    static_force,
)
from hbgear.common.argument_checks import checked_arguments
from hbgear.common.arrays import Array
from hbgear.common.atomic_write import atomic_write
from hbgear.common.text.messages import quoted
from hbgear.common.text.symbols import shown_unit, unit_of
from hbgear.continuation.results.branch import Branch
from hbgear.continuation.results.point import Point, dof_index
from hbgear.harmonic.equations.layout import Layout
from hbgear.harmonic.forces.breakpoints import gap_samples
from hbgear.harmonic.harmonic_balance import HarmonicBalance
from hbgear.harmonic.models.frequency_units import length_scale, speeds_at
from hbgear.harmonic.models.model_registry import rebuild_problem
from hbgear.mechanics.laws.mesh_contacts import MeshContacts
from hbgear.mechanics.models import Model
from hbgear.mechanics.series.fourier import evaluate, stretch, to_complex, to_real
from hbgear.mechanics.series.measures import derivative, half_peak_to_peak, rms
from hbgear.mechanics.structures.elements import Reaction

REFERENCE = 1e-6
"""Reference acceleration of 0 dB [m/s^2], as of ISO 1683."""

_UNKNOWN_UNIT = "model units"
"""Unit of quantities of a model that states none."""

OTHER_NAMES = {
    "dte, half peak-to-peak": "displacement, half peak-to-peak",
    "force, static": "force, mean",
    "dynamic factor": "largest / mean force",
}
"""Quantities of a mesh, and their names for an element that is no mesh. Both find the quantity of any element."""

_FRICTION_PHASES = 4096
"""Number of phases of a period at which the friction of a mesh is evaluated."""

_REACTION_PHASES = 1024
"""Number of phases of a period at which a reaction is evaluated; reactions are smooth."""


@dataclass(frozen=True, eq=False)
class MachineQuantities:
    """Quantities at each point of a branch as columns; the unit is part of the name.

    An element that is no mesh has a "displacement" instead of "dte", and its mean force instead of the static one.

    Attributes
    ----------
    columns : dict of str to ndarray, shape (P,)
        Columns by name, such as "force, largest [N]".

    Examples
    --------
    >>> import hbgear as hb
    >>> curve = hb.trace(hb.HarmonicBalance(hb.SpurPair(), 12), "Omega", (1.5, 0.6))
    >>> quantities = hb.analysis.machine_quantities(curve)
    >>> list(quantities.columns)[1:-1]
    ['dte, half peak-to-peak [-]', 'force, largest [-]', 'force, static [-]', 'dynamic factor [-]']
    >>> round(float(quantities["dynamic factor"].max()), 1)
    3.7
    """

    columns: dict[str, Array]

    def __repr__(self) -> str:
        points = len(next(iter(self.columns.values()), ()))
        return f"<MachineQuantities at {points} points: {', '.join(map(quoted, self.columns))}>"

    def __getitem__(self, name: str) -> Array:
        """Return a column by its name, with or without the unit."""
        return self.columns[self.title(name)]

    def title(self, name: str) -> str:
        """Return the name of a column with its unit.

        Parameters
        ----------
        name : str
            Name of the column, with or without the unit.

        Returns
        -------
        str
            Name with the unit.

        Raises
        ------
        KeyError
            If there is no such column.
        """
        for column in self.columns:
            bare = column.partition(" [")[0]
            if name in (column, bare) or bare == OTHER_NAMES.get(name) or name == OTHER_NAMES.get(bare):
                return column
        names = ", ".join(quoted(column.partition(" [")[0]) for column in self.columns)
        raise KeyError(f"there is no quantity {quoted(name)}; choose one of {names}")

    @checked_arguments()
    def save(self, path: str | os.PathLike[str]) -> None:
        """Write all columns to a .csv file; no file is left after an error.

        Parameters
        ----------
        path : str or path-like
            File.
        """
        text = io.StringIO(newline="")
        writer = csv.writer(text, lineterminator="\n")
        writer.writerow(self.columns)
        writer.writerows(zip(*(column.tolist() for column in self.columns.values()), strict=True))
        with atomic_write(path) as handle:
            handle.write(text.getvalue().encode())


@checked_arguments()
def machine_quantities(
    found: Branch | Point, element: int | str = 0, dof: int | str | None = None, problem: Any = None
) -> MachineQuantities:
    """Compute forces, dynamic factor, transmission error and acceleration; see the equations in the module header.

    Parameters
    ----------
    found : Branch or Point
        Branch of a harmonic balance, traced or loaded, or one of its points.
    element : int or str, optional
        Mesh, or bearing that is an element, by number or name. The default is the first element.
    dof : int or str, optional
        Coordinate of the model for the acceleration, by number or name. By default the acceleration is not computed.
    problem : HarmonicBalance, optional
        Equations. By default the problem of the branch, or the one that its file describes.

    Returns
    -------
    MachineQuantities
        Quantities at each point.

    Raises
    ------
    ValueError, KeyError
        If the problem is unknown, or there is no such element or coordinate.

    Examples
    --------
    >>> import hbgear as hb
    >>> curve = hb.trace(hb.HarmonicBalance(hb.gears.GearRotorBearing(), 8), "Omega", (1.5, 1.4))
    >>> quantities = hb.analysis.machine_quantities(curve, element="bearing 1", dof="y_1")
    >>> [name for name in quantities.columns if name.startswith("acc")]
    ['acceleration, rms [-]']
    """
    if isinstance(found, Branch):
        problem = problem_along(found, problem)
        parameters = [found.parameters_at(i) for i in range(len(found))]
        unit = shown_unit(str(problem.model.labels.get(found.parameter, ""))) or "-"
        columns = {} if found.parameter == "Omega" else {f"{found.parameter} [{unit}]": found.values}
        columns |= _columns(problem, np.asarray(found.X), parameters, element, dof)
        if found.stable is not None:
            columns["stable"] = np.asarray(found.stable)
        return MachineQuantities(columns)
    problem = found.problem if problem is None else problem
    if not isinstance(problem, HarmonicBalance):
        raise ValueError("machine_quantities of a point needs the problem of its branch; give problem=branch.problem")
    return MachineQuantities(
        _columns(problem.at_resolution_of(found), found.X[None], [dict(found.parameters)], element, dof)
    )


def transmission_error(motions: Branch | Point, element: int | str = 0) -> Array:
    """Return half the peak-to-peak dynamic transmission error of a mesh at each point, without the other quantities.

    The unit is um if the model has `Scales`, else that of the model.

    Examples
    --------
    >>> import hbgear as hb
    >>> curve = hb.trace(hb.HarmonicBalance(hb.SpurPair(), 8), "Omega", (1.5, 1.4))
    >>> bool(np.allclose(transmission_error(curve), hb.analysis.machine_quantities(curve)["dte, half peak-to-peak"]))
    True
    """
    problem, X, sets = problem_and_motions(motions, "the transmission error of a point")
    index, values, scale = problem.layout.index(element), np.empty(len(X)), None
    before: dict[str, float] | None = None
    for i, (row, parameters) in enumerate(zip(X, sets, strict=True)):
        changed = {name: value for name, value in parameters.items() if name != "Omega"}
        if changed != before:
            before, scale = changed, length_scale(problem.model, changed)
            error = _prescribed(problem, changed, index)
        half_range = float(half_peak_to_peak(problem.rows(row)[index] + error))
        values[i] = half_range * (1.0 if scale is None else 1e6 * scale)
    return values


def are_meshes(model: Model | None, layout: Layout) -> list[bool]:
    """Return whether each element of a model is a mesh of teeth, see `Model.mesh_names`.

    Examples
    --------
    >>> import hbgear as hb
    >>> pair = hb.gears.GearRotorBearing()
    >>> are_meshes(pair, hb.HarmonicBalance(pair, 3).layout)
    [True, False, False]
    """
    names = model.mesh_names if model is not None else ()
    first = model is not None and model.scales is not None
    return [name in names if names else first and number == 0 for number, name in enumerate(layout.elements)]


def problem_along(branch: Branch, problem: Any = None) -> HarmonicBalance:
    """Return the harmonic balance of a branch: the given one, its own, or the one that its file describes.

    ValueError is raised if the problem is unknown.
    """
    for candidate in (problem, branch.problem):
        if isinstance(candidate, HarmonicBalance):
            return candidate
    try:
        return rebuild_problem(branch.meta)
    except (KeyError, TypeError, ValueError) as error:
        reason = error.args[0] if error.args else error  # the text of a KeyError has quotation marks
        raise ValueError(f"the equations of this curve are needed, but {reason}") from None


def problem_and_motions(motions: Branch | Point, name: str) -> tuple[HarmonicBalance, Array, list[dict[str, float]]]:
    """Return the problem, the unknowns (P, n) and the parameters of each motion; errors name the quantity."""
    if isinstance(motions, Branch):
        return problem_along(motions), np.asarray(motions.X), [motions.parameters_at(i) for i in range(len(motions))]
    if not isinstance(motions.problem, HarmonicBalance):
        raise ValueError(f"{name} needs the problem of its branch")
    return motions.problem.at_resolution_of(motions), motions.X[None], [dict(motions.parameters)]


def with_known_problem(branch: Branch) -> Branch:
    """Return a branch with its problem, rebuilt from its file if necessary; unchanged if its model is unknown.

    Special points and jumps of a branch without problem have no physical quantities.
    """
    if branch.problem is not None:
        return branch
    try:
        return dataclasses.replace(branch, problem=problem_along(branch))
    except ValueError:
        return branch


def forces_along(branch: Branch, elements: Sequence[str] | None = None) -> tuple[list[str], list[list[Array]]]:
    """Return names of elements, and samples of the forces of their laws over a period at each point of a branch.

    The elements are by default those of `Model.sharing`, or all. ValueError or KeyError is raised if the problem is
    unknown, or there is no such element.
    """
    problem = problem_along(branch)
    layout = problem.layout
    names = [*(elements or problem.model.sharing or layout.elements)]
    indices = [layout.index(name) for name in names]
    rows = zip(branch.X, (branch.parameters_at(i) for i in range(len(branch))), strict=True)
    return names, [[element_force(problem, X, parameters, index) for index in indices] for X, parameters in rows]


def element_force(
    problem: HarmonicBalance, X: Array, parameters: dict[str, float], index: int, count: int = FORCE_SAMPLES
) -> Array:
    """Return samples of the force of the law of an element over a period."""
    compiled, nu = problem.compiled(parameters), problem.nu
    return force_samples(
        compiled.system.elements,
        index,
        lambda j: compiled.piecewise.retained[:, j],
        problem.rows(X),
        parameters["Omega"] / nu,
        nu,
        count,
    )


def _columns(
    problem: HarmonicBalance, X: Array, sets: list[dict[str, float]], element: int | str, dof: int | str | None
) -> dict[str, Array]:
    """Return all columns of motions X (P, m (2H + 1)) with parameters `sets` (P,)."""
    index = problem.layout.index(element)
    models = [problem.model_at(parameters) for parameters in sets]  # the same object if only Omega changes
    scales: list[Any] = [model.scales for model in models]
    has_units = all(model_units is not None for model_units in scales)
    length, force, rate = (
        np.array([getattr(model_units, name, 1.0) for model_units in scales])
        for name in ("length", "force", "acceleration")
    )
    Omega_unit, length_unit, force_unit, acceleration_unit = _units(problem.model.labels, has_units)
    speeds = [speeds_at(problem.model, parameters) for parameters in sets]
    columns = {f"Omega [{Omega_unit}]": np.array([parameters["Omega"] for parameters in sets])}
    columns |= {
        f"{name.rpartition(' ')[0]} [{name.rpartition(' ')[2]}]": np.array([speed[name] for speed in speeds])
        for name in (speeds[0] if speeds else ())
    }
    values = np.array([_of_motion(problem, row, parameters, index) for row, parameters in zip(X, sets, strict=True)])
    friction = [_friction(problem, row, set_, index, scale) for row, set_, scale in zip(X, sets, scales, strict=True)]
    is_mesh = are_meshes(problem.model, problem.layout)[index]
    error, static, factor = OTHER_NAMES if is_mesh else OTHER_NAMES.values()
    columns |= {
        f"{error} [{length_unit}]": values[:, 0] * length * (1e6 if has_units else 1.0),
        f"force, largest [{force_unit}]": values[:, 1] * force,
        f"{static} [{force_unit}]": values[:, 2] * force,
        f"{factor} [-]": values[:, 3],
    }
    if friction[0] is not None:
        columns[f"friction across, largest [{force_unit}]"] = np.array([row[0] for row in friction if row]) * force
        columns["efficiency [-]"] = np.array([row[1] for row in friction if row])
        if has_units:
            columns["power loss [W]"] = np.array([row[2] for row in friction if row]) * force
    supports = {id(model): model.reactions for model in models}
    if dof is None and not supports[id(models[0])]:
        return columns
    Omega = columns[f"Omega [{Omega_unit}]"] / problem.nu
    q = np.array([problem.motion(row, **parameters) for row, parameters in zip(X, sets, strict=True)])
    for name in supports[id(models[0])]:
        sizes = np.array(
            [_reaction(supports[id(model)][name], *motion) for model, *motion in zip(models, q, Omega, strict=True)]
        )
        columns[f"reaction {name}, largest [{force_unit}]"] = sizes[:, 0] * force
        columns[f"reaction {name}, static [{force_unit}]"] = sizes[:, 1] * force
    if dof is not None:
        acceleration = rms(derivative(q[:, dof_index(dof, problem.dof_names)], Omega, 2)) * rate
        columns[f"acceleration, rms [{acceleration_unit}]"] = acceleration
        if has_units:
            columns["acceleration, level [dB]"] = 20 * np.log10(np.maximum(acceleration, 1e-300) / REFERENCE)
    return columns


def _units(labels: Mapping[str, str], has_scales: bool) -> tuple[str, str, str, str]:
    """Return the units of Omega, displacements, forces and accelerations; only the labels know those of other models.

    Matrices of the user have no labels, so that their units are unknown.
    """
    if has_scales:
        return "-", "um", "N", "m/s^2"
    Omega, length = (unit_of(str(labels.get(name, ""))) or _UNKNOWN_UNIT for name in ("Omega", "amplitude"))
    return (
        ("-", "-", "-", "-")
        if length == "1"
        else ("-" if Omega == "1" else Omega, length, _UNKNOWN_UNIT, _UNKNOWN_UNIT)
    )


def _reaction(support: Reaction, q: Array, rate: float) -> tuple[float, float]:
    """Return the largest and the static size of the force in a support, for a motion q (n, 2H + 1)."""
    rows = support.stiffness @ q + support.damping @ derivative(q, rate, 1)
    theta = 2 * np.pi * np.arange(_REACTION_PHASES) / _REACTION_PHASES
    size = np.linalg.norm([evaluate(row, theta) for row in rows], axis=0)
    return float(size.max()), float(np.linalg.norm(rows[:, 0]))


def _of_motion(
    problem: HarmonicBalance, X: Array, parameters: dict[str, float], index: int
) -> tuple[float, float, float, float]:
    """Return the transmission error, largest force, static force and dynamic factor, in units of the model.

    The largest force is the one in the direction of the static force, without a static force the one of largest size.
    """
    compiled = problem.compiled(parameters)
    force = element_force(problem, X, parameters, index)
    has_static = is_static(force, force_level(compiled.system.elements, problem.rows(X)))
    static = static_force(problem, X, parameters, index, force) if has_static else 0.0
    largest = float(force.max() if static > 0 else force.min()) if has_static else float(np.abs(force).max())
    half_range = float(half_peak_to_peak(total_error(problem, X, parameters, index)))
    return half_range, largest, static, largest / static if has_static else math.nan


def _friction(
    problem: HarmonicBalance, X: Array, parameters: dict[str, float], index: int, scales: Any
) -> tuple[float, float, float] | None:
    """Return the largest friction across the line of action, the efficiency, and the power loss over the unit of force.

    None without friction between teeth.
    """
    compiled = problem.compiled(parameters)
    spring, prescribed = compiled.system.elements[index], compiled.piecewise.retained[:, index]
    if not isinstance(spring.law, MeshContacts) or spring.law.sliding is None:
        return None
    nu, count, sliding = problem.nu, _FRICTION_PHASES * problem.nu, spring.law.sliding
    d = gap_samples(spring.displacement, prescribed, nu, problem.rows(X)[index], count)
    forces = spring.law.sliding_forces(d, 2 * np.pi * nu * (np.arange(count) / count))
    torque = float((sliding.cosine * forces.normal + sliding.lever * forces.across + forces.slide).mean())
    loss = sliding.relative * float(forces.slide.mean())
    efficiency = 1 - loss / torque if torque > 0 else torque / (torque - loss) if loss else math.nan
    speed = sliding.speed * parameters["Omega"] * getattr(scales, "frequency", 1.0)
    return float(np.abs(forces.across).max()), efficiency, loss * sliding.radius * speed


def total_error(problem: HarmonicBalance, X: Array, parameters: dict[str, float], index: int) -> Array:
    """Return the coefficients of the dynamic transmission error d + e of an element."""
    return problem.rows(X)[index] + _prescribed(problem, parameters, index)


def _prescribed(problem: HarmonicBalance, parameters: dict[str, float], index: int) -> Array:
    """Return the coefficients of the prescribed displacement e of an element with these values of parameters."""
    displacement = problem.models.system(parameters).elements[index].displacement
    c = to_complex(stretch(displacement.row(problem.H // problem.nu), problem.nu))
    e = np.zeros(problem.H + 1, dtype=complex)
    e[: len(c)] = c
    e[np.setdiff1d(np.arange(problem.H + 1), problem.orders)] = 0.0  # harmonics that the motion cannot have
    return to_real(e)
