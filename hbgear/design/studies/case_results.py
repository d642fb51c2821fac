"""Results of a study of many cases: what is computed for each case, and the table of all cases."""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from enum import StrEnum
from functools import cached_property
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from hbgear.analysis.quantities.length_units import MICROMETRE, dimension_of, factor_of
from hbgear.common.argument_checks import checked_arguments
from hbgear.common.arrays import Array
from hbgear.common.atomic_write import atomic_write, csv_table
from hbgear.common.text.messages import did_you_mean
from hbgear.common.text.symbols import shown_unit
from hbgear.continuation.results.branch import Branch
from hbgear.design.studies.store import Result
from hbgear.harmonic.harmonic_balance import HarmonicBalance
from hbgear.harmonic.models.frequency_units import MESH, PINION, length_scale, scales
from hbgear.harmonic.models.model_registry import fields_from_plain
from hbgear.io.branches.npz import unpacked
from hbgear.mechanics.models import Model

JUMP_COLUMNS = ("jump_rising", "jump_falling")
"""Columns with the frequencies of the largest jumps, for each direction of a slow sweep."""

KINDS = ("peak", "jumps", "curve", "branch")
"""Results of a case that `Work.compute` may list."""


class PhysicalUnits(NamedTuple):
    """Speed [r/min] and mesh frequency [Hz] at Omega = 1, and length [m] or None, by case (n,); nan if it failed."""

    speed: Array
    mesh: Array
    length: Array | None


class Outcome(StrEnum):
    """Reason for the end of a study."""

    FINISHED = "finished"
    INTERRUPTED = "interrupted"
    CANNOT_STORE = "cannot_store"
    WORKERS_LOST = "workers_lost"


@dataclass(frozen=True)
class Work:  # numpydoc ignore=PR02
    """Results to compute for each case.

    Parameters
    ----------
    compute : tuple of str, default ("peak", "jumps")
        Kinds of results: "peak" (largest peak), "jumps" (of slow sweeps), "curve" (amplitude and stability over Omega)
        and "branch" (complete curve for `Cases.branch`, a few hundred kB for each case).
    critical : tuple of str, default ()
        Parameters whose critical values are computed.
    harmonics : int, default 16
        Harmonic truncation order.
    span : tuple[float, float], default (0.5, 1.5)
        Span of Omega.
    measure, element : str and int or str, optional
        Measure ("pp2" by default) and element (0 by default) of `Branch.amplitude`.

    Raises
    ------
    ValueError
        If a kind is unknown or there is nothing to compute.
    """

    compute: tuple[str, ...] = ("peak", "jumps")
    critical: tuple[str, ...] = ()
    harmonics: int = 16
    span: tuple[float, float] = (0.5, 1.5)
    measure: str = "pp2"
    element: int | str = 0

    def __post_init__(self) -> None:
        for kind in self.compute:
            if kind not in KINDS:
                raise ValueError(f"cannot compute '{kind}'{did_you_mean(kind, KINDS)}")
        if not (self.compute or self.critical):
            raise ValueError(f"nothing to compute; give some of {', '.join(KINDS)}, or a critical parameter")


@dataclass(frozen=True, eq=False)
class Cases:
    """Results of a study.

    Attributes
    ----------
    model : Model
        Model with the values that do not vary.
    work : Work
        Computed results.
    names : tuple of str
        Names of the parameters that vary.
    table : dict of str to ndarray
        Columns by name, with one entry for each computed case: case, parameters, numbers, reason of a failure, and
        computing time in seconds. The peak of a stable motion that grows without bound is inf.
    jumps : ndarray, shape (J, 5)
        Case, Omega, direction (+1 for rising Omega), amplitude before and amplitude after (nan if unknown).
    curves : dict of int to ndarray, shape (3, P)
        Omega, amplitude and stability (1 or 0) by case, with a column of nan between curves; only with "curve".
    total : int
        Number of cases of the study.
    outcome, message : Outcome and str
        Reason for the end of the study.
    values : mapping of int to mapping of str to Any
        Values of the varying parameters by case, in the types of the model.
    packed : callable
        Function that returns the bytes of the branch of a case; see `branch`.

    Examples
    --------
    >>> import hbgear as hb
    >>> from concurrent.futures import ThreadPoolExecutor
    >>> two = hb.design.grid(zeta=[0.05, 0.2])
    >>> with ThreadPoolExecutor(1) as here:
    ...     found = hb.design.cases(hb.Duffing(), two, ("peak",), harmonics=1, span=(0.9, 1.4), executor=here)
    ...
    >>> found.table["zeta"].tolist()
    [0.05, 0.2]
    """

    model: Model
    work: Work
    names: tuple[str, ...]
    table: dict[str, Any]
    jumps: Array
    curves: dict[int, Array]
    total: int
    outcome: Outcome
    message: str
    values: Mapping[int, Mapping[str, Any]]
    packed: Callable[[int], bytes]

    def __len__(self) -> int:
        return len(self.table["case"])

    def __repr__(self) -> str:
        counts = f"{len(self)} of {self.total} done" + (f", {len(self.failed)} failed" if self.failed else "")
        return f"<Cases of {type(self.model).__name__} in {', '.join(self.names)}: {counts}>"

    @property
    def failed(self) -> dict[int, str]:
        """Reason of failure by case."""
        pairs = zip(self.table["case"], self.table["reason"], strict=True)
        return {int(case): str(reason) for case, reason in pairs if reason}

    @cached_property
    def units(self) -> PhysicalUnits | None:
        """Physical units of the computed cases; None if a model has no scales."""
        rows = np.full((len(self), 3), np.nan)
        for row, case in zip(rows, self.table["case"].tolist(), strict=True):
            if case in self.failed:
                continue
            model = self.model_of(case)
            frequency_units, length = scales(model, {}), length_scale(model, {})
            if not frequency_units:
                return None
            row[:] = frequency_units[PINION], frequency_units[MESH], np.nan if length is None else length
        speed, mesh, lengths = rows.T
        if not np.isfinite(speed).any():
            return None
        return PhysicalUnits(speed, mesh, lengths if np.isfinite(lengths[np.isfinite(speed)]).all() else None)

    @property
    def physical_table(self) -> dict[str, Any]:
        """The table with frequencies as speeds of the pinion [r/min] and amplitudes in um, if the models have scales.

        Names of columns state their units, also those of parameters whose labels have a unit.
        """
        units, out = self.units, dict[str, Any]()
        for name, column in self.table.items():
            if name.removeprefix("critical_") in {*self.names, *self.work.critical}:
                unit = shown_unit(self.model.labels.get(name.removeprefix("critical_"), ""))
                out[f"{name} [{unit}]" if unit else name] = column
            elif units is not None and (name.endswith("_Omega") or name in JUMP_COLUMNS):
                out[f"{name.removesuffix('_Omega')} at pinion [r/min]"] = units.speed * column
            elif units is not None and units.length is not None and name == "peak" and dimension_of(self.work.measure):
                out[f"peak [{MICROMETRE}]"] = factor_of(self.work.measure, units.length) * column
            else:
                out[name] = column
        return out

    @checked_arguments()
    def model_of(self, case: int) -> Model:
        """Return the model of a case.

        Raises
        ------
        KeyError
            If the case was not computed.
        """
        if case not in self.values:
            raise KeyError(
                f"case {case} was not computed; table['case'] lists the {len(self)} of {self.total} computed cases"
            )
        return self.model.replace(**self.values[case])

    @checked_arguments()
    def branch(self, case: int) -> Branch:
        """Return the response curve of a case; only with "branch".

        Raises
        ------
        KeyError
            If the case was not computed or failed, or "branch" was not computed.
        ValueError
            If the file of the case is damaged.
        """
        if case in self.failed:
            raise KeyError(f"case {case} failed: {self.failed[case]}")
        if "branch" not in self.work.compute:
            raise KeyError('no branches were stored; compute them: compute=("branch",)')
        problem = HarmonicBalance(self.model_of(case), self.work.harmonics)
        try:
            return unpacked(self.packed(case), problem)
        except (OSError, ValueError) as error:
            raise ValueError(f"the branch of case {case} cannot be read ({error}); run the study again") from error

    @checked_arguments()
    def export(self, path: str | os.PathLike[str], *, dimensionless: bool = False) -> None:
        """Write the table (.csv), or the table, jumps and curves as arrays (.npz), atomically.

        A .csv has the columns of `physical_table`, or of the table with ``dimensionless``; arrays are those of Omega
        and of amplitudes in the unit of the model.
        """
        suffix = Path(path).suffix.lower()
        if suffix == ".csv":
            table = self.table if dimensionless else self.physical_table
            with csv_table(path) as writer:
                writer.writerow(table)
                writer.writerows(zip(*(column.tolist() for column in table.values()), strict=True))
        elif suffix == ".npz":
            rows = [np.vstack([np.full(curve.shape[1], case), curve]).T for case, curve in self.curves.items()]
            curves = np.concatenate(rows) if rows else np.empty((0, 4))
            with atomic_write(path) as handle:
                np.savez(
                    handle,
                    jump_table=self.jumps,
                    curve_table=curves,
                    curve_measure=np.array(self.work.measure),
                    curve_element=np.array(self.work.element),
                    **self.table,
                )
        else:
            raise ValueError(f"'{path}' must end in .csv or .npz")


def collect(
    model: Model,
    work: Work,
    names: tuple[str, ...],
    plan: list[dict[str, Any]],
    keys: list[str],
    results: Mapping[str, Result],
    outcome: Outcome,
    message: str,
    packed: Callable[[int], bytes],
) -> Cases:
    """Return the results of the finished cases, in the order of the plan."""
    rows = [(i, plan[i], results[key]) for i, key in enumerate(keys) if key in results]
    table: dict[str, Any] = {"case": np.array([i for i, *_ in rows], dtype=int)}
    table |= {name: np.array([_cell(values[name]) for _, values, _ in rows]) for name in names}
    columns = dict.fromkeys(name for *_, result in rows for name in result.numbers)
    table |= {name: np.array([result.numbers.get(name, np.nan) for *_, result in rows]) for name in columns}
    table["reason"] = np.array([result.reason for *_, result in rows], dtype=str)
    table["seconds"] = np.array([result.seconds for *_, result in rows], dtype=float)
    jumps = [[i, *row] for i, _, result in rows for row in result.arrays.get("jumps", ())]
    curves = {i: result.arrays["curve"] for i, _, result in rows if "curve" in result.arrays}
    jump_rows = np.array(jumps, dtype=float).reshape(-1, 5)
    values = {i: fields_from_plain(row) for i, row, _ in rows}
    return Cases(model, work, names, table, jump_rows, curves, len(plan), outcome, message, values, packed)


def _cell(value: Any) -> Any:
    return " ".join(map(str, value)) if isinstance(value, list | tuple) else value
