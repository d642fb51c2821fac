"""A curve in the words of whoever builds the machine: forces of the teeth, dynamic factor, transmission error, noise.

    dte = w^T q = d + e(tau)          half of its peak-to-peak value
    p(tau)                            force of the law of an element, of the whole gap and without its damper
    K = max p / mean p                dynamic factor; the mean of p is the static force, for dampers have none
    a = rms of q'',   L = 20 lg(a / 1e-6 m/s^2)        of a coordinate; the level as of ISO 1683

In SI units where the model knows its scales, else in those of the model.
"""

from __future__ import annotations

import csv
import io
import os
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np

from hbgear.common.arguments import checked_arguments
from hbgear.common.arrays import Array
from hbgear.common.messages import did_you_mean, quoted
from hbgear.common.replacing import replacing
from hbgear.continuation.branch import Branch
from hbgear.harmonic.balance import HarmonicBalance
from hbgear.harmonic.dynamic_factor import force_samples
from hbgear.harmonic.observables import half_peak_to_peak
from hbgear.harmonic.speeds import speeds_at
from hbgear.mechanics.fourier import to_real

REFERENCE = 1e-6
"""Acceleration of 0 dB [m/s^2]."""


@dataclass(frozen=True, eq=False)
class Answers:
    """Columns of numbers, one for each row of a curve; the unit stands in the name.

    Examples
    --------
    >>> import hbgear as hb
    >>> curve = hb.trace(hb.HarmonicBalance(hb.SpurPair(), 12), "Omega", (1.5, 0.6))
    >>> found = hb.answers(curve)
    >>> list(found.columns)[2:]
    ['dte, half peak-to-peak [-]', 'force, largest [-]', 'force, static [-]', 'dynamic factor [-]']
    >>> round(float(found["dynamic factor"].max()), 1)
    3.7
    """

    columns: dict[str, Array]

    def __getitem__(self, name: str) -> Array:
        """A column by its name, with the unit or without."""
        for full, column in self.columns.items():
            if name in (full, full.partition(" [")[0]):
                return column
        known = [full.partition(" [")[0] for full in self.columns]
        raise KeyError(f"there is no answer {quoted(name)}{did_you_mean(name, known)}")

    @checked_arguments()
    def save(self, path: str | os.PathLike[str]) -> None:
        """Write a table (.csv) of all columns, whole or not at all."""
        text = io.StringIO(newline="")
        writer = csv.writer(text, lineterminator="\n")
        writer.writerow(self.columns)
        writer.writerows(zip(*(column.tolist() for column in self.columns.values()), strict=True))
        with replacing(path) as handle:
            handle.write(text.getvalue().encode())


@checked_arguments()
def answers(branch: Branch, element: int | str = 0, dof: int | str | None = None) -> Answers:
    """Forces, dynamic factor, transmission error and acceleration along a curve; equations at the head of this file.

    Parameters
    ----------
    branch : a curve of a harmonic balance, with its problem.
    element : a mesh, or a bearing that is an element, by number or name.
    dof : a coordinate of the model whose acceleration is wanted, by number or name.

    Raises
    ------
    ValueError, KeyError
        If the curve has no problem (load it with ``problem=``), or there is no such element or coordinate.

    Examples
    --------
    >>> import hbgear as hb
    >>> curve = hb.trace(hb.HarmonicBalance(hb.GearRotorBearing(), 8), "Omega", (1.5, 1.4))
    >>> found = hb.answers(curve, element="bearing 1", dof="y_1")
    >>> [name for name in found.columns if name.startswith("acc")]
    ['acceleration, rms [-]']
    """
    problem = branch.problem
    if not isinstance(problem, HarmonicBalance):
        raise ValueError("answers need the model; load the branch with hbgear.load(path, problem=...)")
    index = branch.layout.index(element) if branch.layout is not None else 0  # type: ignore[attr-defined]
    each = [branch.parameters_at(i) for i in range(len(branch))]
    found = np.array([_of_motion(problem, X, here, index) for X, here in zip(branch.X, each, strict=True)])
    scales: list[Any] = [_scales_of(problem, here) for here in each]
    length, force, rate = (np.array([getattr(one, name, 1.0) for one in scales])
                           for name in ("length", "force", "acceleration"))  # fmt: skip
    known = all(one is not None for one in scales)
    micro, newton, metre = ("um", "N", "m/s^2") if known else ("-", "-", "-")
    columns = {f"{branch.parameter} [-]": branch.values}
    speeds = [speeds_at(problem.model, here) for here in each]
    columns |= {f"{name.rpartition(' ')[0]} [{name.rpartition(' ')[2]}]": np.array([one[name] for one in speeds])
                for name in (speeds[0] if speeds else ())}  # fmt: skip
    if branch.stable is not None:
        columns["stable"] = np.asarray(branch.stable)
    columns |= {
        f"dte, half peak-to-peak [{micro}]": found[:, 0] * length * (1e6 if known else 1.0),
        f"force, largest [{newton}]": found[:, 1] * force,
        f"force, static [{newton}]": found[:, 2] * force,
        "dynamic factor [-]": np.divide(found[:, 1], found[:, 2], out=np.full(len(found), np.nan),
                                        where=np.abs(found[:, 2]) > 1e-12 * np.abs(found[:, 1])),
    }  # fmt: skip
    if dof is not None:
        acceleration = branch.amplitude("rms", dof=dof, derivative=2) * rate
        columns[f"acceleration, rms [{metre}]"] = acceleration
        if known:
            columns["acceleration, level [dB]"] = 20 * np.log10(np.maximum(acceleration, 1e-300) / REFERENCE)
    return Answers(columns)


def _of_motion(problem: HarmonicBalance, X: Array, here: dict[str, float], index: int) -> tuple[float, float, float]:
    """dte, and the force that is largest in the direction of the mean one, and this, in units of the model."""
    compiled = problem.compiled({name: value for name, value in here.items() if name != "Omega"})
    row = X.reshape(problem.m, -1)[index]
    moved = partial(compiled.gap, index, row)
    force = force_samples(compiled.laws[index], moved, here["Omega"] / problem.nu, problem.nu)
    static = float(force.mean())
    largest = float(force[np.argmax(force if static >= 0 else -force)])
    dte = row + to_real(compiled.receptance.e.T)[index]
    return float(half_peak_to_peak(dte)), largest, static


def _scales_of(problem: HarmonicBalance, here: dict[str, float]) -> Any:
    """Units of the model with these parameters: length, force, acceleration; None if it does not know them."""
    return None if problem.model.scales is None else problem.model.at(here).scales
