"""Results of the comparison of a curve with time integration: points, jumps and their tables."""

from __future__ import annotations

import os
from dataclasses import dataclass, fields
from typing import NamedTuple

import numpy as np

from hbgear.analysis.quantities.axis_quantities import SPEED_LABEL, Abscissa, Ordinate
from hbgear.common.atomic_write import checked_suffix, csv_table
from hbgear.common.deprecation import renamed_attributes
from hbgear.continuation.results.branch import Branch
from hbgear.continuation.results.point import Jump
from hbgear.harmonic.models.frequency_units import PINION

AGREES = "agrees"
"""Status of a point or a jump that agrees with time integration."""


@renamed_attributes(verdict="status")
@dataclass(frozen=True)
class Check:
    """Comparison of one point of the curve with time integration; differences are relative, see the module.

    Attributes
    ----------
    index : int
        Index of the point.
    reason : str
        Reason for which the point was selected.
    value : float
        Value of the parameter of the branch.
    Omega : float
        Excitation frequency.
    element : str
        Name of the element with the largest difference of rms.
    rms, rms_true : float
        Root mean square of this element by harmonic balance and by integration.
    closure : float
        Closure, the largest of the elements; inf if the motion diverges within its period.
    rms_error, pp2_error, harmonic_error : float
        Largest differences of the elements; nan if shooting finds no periodic motion.
    multiplier_error : float
        Largest difference of the multipliers; nan if shooting finds no periodic motion.
    sensitivity : float
        1 / min |mu - 1|, the factor by which an error is amplified at a given frequency.
    mu, mu_true : complex
        Largest multiplier of the branch and of the integrated variational equation.
    growth : float
        Measured growth of a disturbance per period, to be compared with |mu|; inf if the motion diverges.
    stable : bool or None
        Stability by the branch; None if it has no multipliers.
    status : str
        "agrees", "agrees with H = 32" if more harmonics than those of the curve are required, or the quantities that
        disagree.
    harmonics : int
        Harmonic truncation order H of the motion that agrees; the order of the curve if none agrees.
    refined_error : float
        Largest difference of rms and harmonics of the motion with more harmonics; nan without such a motion.
    curve : int
        Number of the curve in `Branch.curves`, from 1.
    """

    index: int
    reason: str
    value: float
    Omega: float
    element: str
    rms: float
    rms_true: float
    closure: float
    rms_error: float
    pp2_error: float
    harmonic_error: float
    multiplier_error: float
    sensitivity: float
    mu: complex
    mu_true: complex
    growth: float
    stable: bool | None
    status: str
    harmonics: int
    refined_error: float
    curve: int = 1

    @property
    def ok(self) -> bool:
        """True if the point agrees, if necessary with more harmonics."""
        return self.status.startswith(AGREES)

    @property
    def refined(self) -> bool:
        """True if the point agrees only with more harmonics than those of the curve."""
        return self.ok and self.status != AGREES


class Units(NamedTuple):
    """Units of the tables of a `Report`.

    Attributes
    ----------
    name : str
        Header of the parameter, such as "pinion r/min".
    scale : float
        Value for a parameter of one; default 1.
    size : str
        Unit of amplitudes in the header, such as " [um]"; default none.
    length : float
        Value for an amplitude of one; default 1.
    """

    name: str
    scale: float = 1.0
    size: str = ""
    length: float = 1.0

    @classmethod
    def of(cls, branch: Branch, element: int | str = 0) -> Units:
        """Return r/min and um for a branch whose model has scales, else the units of the model."""
        abscissa, length = Abscissa([branch]), Ordinate("rms", element)
        name = PINION if abscissa.label == SPEED_LABEL else branch.parameter
        return cls(name, abscissa.scale, length.header(branch).removeprefix("rms"), length.factor(branch))


@renamed_attributes(verdict="status")
@dataclass(frozen=True)
class JumpCheck:
    """Comparison of a jump of the curve with time integration.

    Attributes
    ----------
    label : str
        Label of the special point at which the jump begins.
    value : float
        Value of the parameter.
    direction : int
        +1 for an increasing, -1 for a decreasing parameter.
    element : str
        Name of the element with the largest change of rms.
    before, after : float
        Root mean square of this element before the jump, and after it by the curve; nan if the curve has no motion.
    rms : float
        Root mean square of this element in the motion on which integration settles.
    period : int
        Period of that motion in excitation periods; 0 if it is not periodic.
    integrated_periods : int
        Number of integrated excitation periods.
    jump : Jump
        Jump by integration. ``jump.after`` is a start for `trace` if ``jump.note`` states that it is on no given curve.
    status : str
        "agrees", or a description of the landing.
    curve : int
        Number of the curve of the jump in `Branch.curves`, from 1.
    """

    label: str
    value: float
    direction: int
    element: str
    before: float
    after: float
    rms: float
    period: int
    integrated_periods: int
    jump: Jump
    status: str
    curve: int = 1

    @property
    def ok(self) -> bool:
        """True if the jump lands on the motion that the curve states."""
        return self.status.startswith(AGREES)


@dataclass(frozen=True)
class Report:
    """Comparison of a branch with time integration.

    Attributes
    ----------
    parameter : str
        Parameter of the branch.
    tolerance : float
        Largest relative difference of rms and harmonics that agrees.
    multiplier_tolerance : float
        Largest difference of multipliers that agrees.
    rows : tuple of Check
        Compared points in the order of the branch.
    complete : bool
        True unless the comparison was interrupted.
    jumps : tuple of JumpCheck
        Compared jumps.
    units : Units or None
        Physical units of the tables; None if the model has no scales.
    note : str
        Number of jumps that are not compared, and the reason; empty without such jumps.
    """

    parameter: str
    tolerance: float
    multiplier_tolerance: float
    rows: tuple[Check, ...]
    complete: bool = True
    jumps: tuple[JumpCheck, ...] = ()
    units: Units | None = None
    note: str = ""

    @property
    def ok(self) -> bool:
        """True if all points, if necessary with more harmonics, and all jumps agree, and none is missing."""
        return self.complete and bool(self.rows) and all(row.ok for row in self.rows) and all(j.ok for j in self.jumps)

    def __repr__(self) -> str:
        return f"<Report: {self.summary}>"

    @property
    def summary(self) -> str:
        """Number of points that agree, and the truncation error where more harmonics are required."""
        agreeing, finer = sum(row.ok for row in self.rows), [row for row in self.rows if row.refined]
        text = f"{agreeing} of {len(self.rows)} points agree within {self.tolerance:g} with time integration"
        if finer:
            truncation_error = max(max(row.rms_error, row.harmonic_error) for row in finer)
            H, rest = max(row.harmonics for row in finer), max(row.refined_error for row in finer)
            text += f", {len(finer)} of them with more harmonics: difference {truncation_error:.1e}"
            text += f", with H = {H} {rest:.1e}"
        if self.jumps:
            text += f"; {sum(jump.ok for jump in self.jumps)} of {len(self.jumps)} jumps agree"
        text += f"; {self.note}" if self.note else ""
        return text + ("" if self.complete else "; interrupted")

    def table(self, dimensionless: bool = False) -> tuple[list[str], list[list[str]]]:
        """Return the headers and rows of a table of the points.

        Parameters
        ----------
        dimensionless : bool, optional
            Whether the units are those of the model instead of `units`; default False.

        Returns
        -------
        tuple
            Headers, and rows of texts.
        """
        name, scale, size, length = self._units(dimensionless)
        headers = [
            "point",
            name,
            f"rms{size}",
            "rms diff.",
            "pp2 diff.",
            "harmonics",
            "closure",
            "|mu|",
            "mu diff.",
            "growth",
            "status",
        ]
        return headers, [_texts(row, scale, length) for row in self.rows]

    def jump_table(self, dimensionless: bool = False) -> tuple[list[str], list[list[str]]]:
        """Return the headers and rows of a table of the jumps.

        Parameters
        ----------
        dimensionless : bool, optional
            Whether the units are those of the model instead of `units`; default False.

        Returns
        -------
        tuple
            Headers, and rows of texts.
        """
        name, scale, size, length = self._units(dimensionless)
        headers = [
            "jump",
            name,
            "sweep",
            f"rms{size} before",
            "rms after",
            "integrated",
            "period",
            "after periods",
            "status",
        ]
        return headers, [
            [
                _on_curve(j, j.label),
                f"{scale * j.value:.6g}",
                "increasing" if j.direction > 0 else "decreasing",
                f"{length * j.before:.5g}",
                f"{length * j.after:.5g}" if np.isfinite(j.after) else "-",
                f"{length * j.rms:.5g}",
                str(j.period or "-"),
                str(j.integrated_periods),
                j.status,
            ]
            for j in self.jumps
        ]

    def _units(self, dimensionless: bool) -> Units:
        return Units(self.parameter) if dimensionless or self.units is None else self.units

    def export(self, path: str | os.PathLike[str]) -> None:
        """Write all numbers (.csv) by an atomic replacement of the file.

        Parameters
        ----------
        path : str or path-like
            Name of the file, which ends in .csv.

        Raises
        ------
        ValueError
            If the name does not end in .csv.
        """
        checked_suffix(path, (".csv",), "tables are .csv files")
        names = [f.name for f in fields(Check)]
        with csv_table(path) as writer:
            writer.writerow(names)
            writer.writerows([getattr(row, name) for name in names] for row in self.rows)


def _on_curve(row: Check | JumpCheck, text: str) -> str:
    """Return the text of a point or jump, after the number of its curve unless it is the first one."""
    return text if row.curve == 1 else f"{row.curve}:{text}"


def _texts(row: Check, scale: float, length: float) -> list[str]:
    """Return the cells of one row of the table; the parameter is multiplied by a scale, the amplitude by a length."""

    def text(x: float, form: str = ".1e") -> str:
        return f"{x:{form}}" if np.isfinite(x) else "-"

    sizes = [text(x, ".5f" if x < 1e4 else ".4g") for x in (abs(row.mu), row.growth)]
    numbers = [text(x) for x in (row.rms_error, row.pp2_error, row.harmonic_error, row.closure)]
    name = _on_curve(row, f"{row.index} {row.reason}")
    return [
        name,
        f"{scale * row.value:.6g}",
        f"{length * row.rms:.6g}",
        *numbers,
        sizes[0],
        text(row.multiplier_error),
        sizes[1],
        f"{row.status} to {row.refined_error:.1e}" if row.refined else row.status,
    ]
