"""A curve in the words of whoever builds the machine: forces of the teeth, dynamic factor, transmission error, noise.

    dte = w^T q = d + e(tau)          half of its peak-to-peak value
    p(tau)                            force of the law of an element, of the whole gap and without its damper
    K = max p / mean p                dynamic factor; the mean of p is the static force, for dampers have none;
                                      nan where the static force is zero, see `dynamic_factor`
    a = rms of q'',   L = 20 lg(a / 1e-6 m/s^2)        of a coordinate; the level as of ISO 1683
    F = |K q + C q'|                  reaction of a support that the model names (`Model.reactions`)

In SI units where the model knows its scales, else in those of the model.
"""

from __future__ import annotations

import csv
import io
import math
import os
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from hbgear.analysis.mesh_dynamic_factor import force_level, force_samples, is_static
from hbgear.common.argument_checks import checked_arguments
from hbgear.common.arrays import Array
from hbgear.common.atomic_write import atomic_write
from hbgear.common.text.messages import quoted
from hbgear.continuation.results.branch import Branch
from hbgear.continuation.results.point import Point, dof_index
from hbgear.harmonic.equations.layout import derivative, half_peak_to_peak, rms
from hbgear.harmonic.frequency_units import speeds_at
from hbgear.harmonic.harmonic_balance import HarmonicBalance
from hbgear.harmonic.model_registry import rebuild_problem
from hbgear.mechanics.models import Reaction
from hbgear.mechanics.series.fourier import evaluate, to_real

REFERENCE = 1e-6
"""Acceleration of 0 dB [m/s^2]."""

_PHASES = 1024  # of a period, of reactions, which are smooth


@dataclass(frozen=True, eq=False)
class MachineQuantities:
    """Columns of numbers, one for each row of a curve; the unit stands in the name.

    Examples
    --------
    >>> import hbgear as hb
    >>> curve = hb.trace(hb.HarmonicBalance(hb.SpurPair(), 12), "Omega", (1.5, 0.6))
    >>> found = hb.analysis.machine_quantities(curve)
    >>> list(found.columns)[1:-1]
    ['dte, half peak-to-peak [-]', 'force, largest [-]', 'force, static [-]', 'dynamic factor [-]']
    >>> round(float(found["dynamic factor"].max()), 1)
    3.7
    """

    columns: dict[str, Array]

    def __getitem__(self, name: str) -> Array:
        """A column by its name, with the unit or without."""
        return self.columns[self.title(name)]

    def title(self, name: str) -> str:
        """The whole name of a column, with its unit.

        Raises
        ------
        KeyError
            If there is none.
        """
        for full in self.columns:
            if name in (full, full.partition(" [")[0]):
                return full
        known = ", ".join(quoted(full.partition(" [")[0]) for full in self.columns)
        raise KeyError(f"there is no answer {quoted(name)}; there are {known}")

    @checked_arguments()
    def save(self, path: str | os.PathLike[str]) -> None:
        """Write a table (.csv) of all columns, whole or not at all."""
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
    """Forces, dynamic factor, transmission error and acceleration along a curve; equations at the head of this file.

    Parameters
    ----------
    found : a curve of a harmonic balance, loaded ones too, or one point with the problem of its curve.
    element : a mesh, or a bearing that is an element, by number or name.
    dof : a coordinate of the model whose acceleration is wanted, by number or name.
    problem : `HarmonicBalance`; by default that of the curve, or what its file says.

    Raises
    ------
    ValueError, KeyError
        If there is no problem and the file does not say it, or no such element or coordinate.

    Examples
    --------
    >>> import hbgear as hb
    >>> curve = hb.trace(hb.HarmonicBalance(hb.gears.GearRotorBearing(), 8), "Omega", (1.5, 1.4))
    >>> found = hb.analysis.machine_quantities(curve, element="bearing 1", dof="y_1")
    >>> [name for name in found.columns if name.startswith("acc")]
    ['acceleration, rms [-]']
    """
    if isinstance(found, Branch):
        problem = problem_along(found, problem)
        each = [found.parameters_at(i) for i in range(len(found))]
        columns = {} if found.parameter == "Omega" else {f"{found.parameter} [-]": found.values}
        columns |= _columns(problem, np.asarray(found.X), each, element, dof)
        if found.stable is not None:
            columns["stable"] = np.asarray(found.stable)
        return MachineQuantities(columns)
    problem = found.problem if problem is None else problem
    if not isinstance(problem, HarmonicBalance):
        raise ValueError("answers of a point need the problem of its curve; give problem=curve.problem")
    return MachineQuantities(
        _columns(problem.at_resolution_of(found), found.X[None], [dict(found.parameters)], element, dof)
    )


def problem_along(branch: Branch, problem: Any = None) -> HarmonicBalance:
    """The harmonic balance of a curve: given, its own, or what its file says.

    Raises
    ------
    ValueError
        If there is none.
    """
    for one in (problem, branch.problem):
        if isinstance(one, HarmonicBalance):
            return one
    try:
        return rebuild_problem(branch.meta)
    except (KeyError, TypeError, ValueError) as error:
        raise ValueError(
            f"answers need the model; load the branch with hbgear.load(path, problem=...) ({error})"
        ) from None


def forces_along(branch: Branch, elements: Sequence[str] | None = None) -> tuple[list[str], list[list[Array]]]:
    """Names of elements, and of every row the force of each of their laws over the period of its motion.

    By default those that the model says share a load, or all.

    Raises
    ------
    ValueError, KeyError
        If there is no problem, or no such element.
    """
    problem = problem_along(branch)
    layout = problem.layout
    names = [*(elements or problem.model.sharing or layout.elements)]
    each = [layout.index(name) for name in names]
    rows = zip(branch.X, (branch.parameters_at(i) for i in range(len(branch))), strict=True)
    return names, [[_force(problem, X, here, index) for index in each] for X, here in rows]


def _force(problem: HarmonicBalance, X: Array, here: dict[str, float], index: int) -> Array:
    """Samples of the force of the law of an element."""
    compiled = problem.compiled({name: value for name, value in here.items() if name != "Omega"})
    one, kept = compiled.system.elements[index], compiled.corners.kept[:, index]
    return force_samples(one, kept, problem.rows(X)[index], here["Omega"] / problem.nu, problem.nu)


def _columns(
    problem: HarmonicBalance, X: Array, each: list[dict[str, float]], element: int | str, dof: int | str | None
) -> dict[str, Array]:
    """All columns of motions X (P, m (2H + 1))."""
    index = problem.layout.index(element)
    models = [problem.model_at(here) for here in each]  # one and the same where Omega alone changes
    scales: list[Any] = [model.scales for model in models]
    known = all(one is not None for one in scales)
    length, force, rate = (np.array([getattr(one, name, 1.0) for one in scales])
                           for name in ("length", "force", "acceleration"))  # fmt: skip
    micro, newton, metre = ("um", "N", "m/s^2") if known else ("-", "-", "-")
    speeds = [speeds_at(problem.model, here) for here in each]
    columns = {"Omega [-]": np.array([here["Omega"] for here in each])}
    columns |= {f"{name.rpartition(' ')[0]} [{name.rpartition(' ')[2]}]": np.array([one[name] for one in speeds])
                for name in (speeds[0] if speeds else ())}  # fmt: skip
    found = np.array([_of_motion(problem, row, here, index) for row, here in zip(X, each, strict=True)])
    columns |= {
        f"dte, half peak-to-peak [{micro}]": found[:, 0] * length * (1e6 if known else 1.0),
        f"force, largest [{newton}]": found[:, 1] * force,
        f"force, static [{newton}]": found[:, 2] * force,
        "dynamic factor [-]": found[:, 3],
    }  # fmt: skip
    supports = {id(model): model.reactions for model in models}
    if dof is None and not supports[id(models[0])]:
        return columns
    Omega = columns["Omega [-]"] / problem.nu
    q = np.array([problem.motion(row, **here) for row, here in zip(X, each, strict=True)])
    for name in supports[id(models[0])]:
        sizes = np.array(
            [_reaction(supports[id(model)][name], *each) for model, *each in zip(models, q, Omega, strict=True)]
        )
        columns[f"reaction {name}, largest [{newton}]"] = sizes[:, 0] * force
        columns[f"reaction {name}, static [{newton}]"] = sizes[:, 1] * force
    if dof is not None:
        acceleration = rms(derivative(q[:, dof_index(dof, problem.dof_names)], Omega, 2)) * rate
        columns[f"acceleration, rms [{metre}]"] = acceleration
        if known:
            columns["acceleration, level [dB]"] = 20 * np.log10(np.maximum(acceleration, 1e-300) / REFERENCE)
    return columns


def _reaction(support: Reaction, q: Array, rate: float) -> tuple[float, float]:
    """Largest and static size of the force in a support, of motions (n, 2H + 1)."""
    rows = support.stiffness @ q + support.damping @ derivative(q, rate, 1)
    theta = 2 * np.pi * np.arange(_PHASES) / _PHASES
    size = np.linalg.norm([evaluate(row, theta) for row in rows], axis=0)
    return float(size.max()), float(np.linalg.norm(rows[:, 0]))


def _of_motion(
    problem: HarmonicBalance, X: Array, here: dict[str, float], index: int
) -> tuple[float, float, float, float]:
    """dte, the force that is largest in the direction of the mean one, this, and their ratio; in units of the model."""
    compiled = problem.compiled({name: value for name, value in here.items() if name != "Omega"})
    row = problem.rows(X)[index]
    force = _force(problem, X, here, index)
    static = float(force.mean())
    largest = float(force[np.argmax(force if static >= 0 else -force)])
    dte = row + compiled.spread(to_real(compiled.receptance.e.T).ravel()).reshape(problem.m, -1)[index]
    level = force_level(compiled.system.elements, problem.rows(X))
    known = is_static(static, float(np.abs(force).max()), level)
    return float(half_peak_to_peak(dte)), largest, static if known else 0.0, largest / static if known else math.nan
