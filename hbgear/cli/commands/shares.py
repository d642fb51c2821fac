"""The table of derivatives: percent of each quantity per percent of a parameter, the largest first."""

from __future__ import annotations

import math
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from hbgear.analysis.parameter_sensitivity.units import LENGTH
from hbgear.analysis.quantities.length_units import MICROMETRE
from hbgear.cli.options import output_option
from hbgear.cli.output import print_table
from hbgear.cli.output_files import outputs
from hbgear.common.text.symbols import shown_unit

if TYPE_CHECKING:
    from hbgear.analysis.parameter_sensitivity.table import Sensitivity


MaxRows = Annotated[int, typer.Option("--max-rows", min=1, help="Number of parameters in the table and the figure.")]

Saved = Annotated[Path | None, output_option("Save all derivatives as .csv.", ".csv")]

SHARE_ROUNDING = 1e-6
"""Relative derivative that counts as zero: derivatives of a cusp are accurate to about 1e-7."""


def show_shares(
    result: Sensitivity,
    labels: Mapping[str, str],
    quantity: str,
    max_rows: int,
    output: Path | None,
    plot: Path | None,
    dimensionless: bool = False,
) -> None:
    """Write the derivatives and their figure, and print the table of the largest derivatives of a quantity.

    ``labels`` are the axis labels of the model, whose units are printed. The empty ``quantity`` is the first one of
    `Sensitivity.shown` that has a derivative.
    """
    names = result.shown(dimensionless)
    quantity = quantity or next((name for name in names if any(result.percent(name).values())), names[0])
    result.size(quantity)  # refuses an unknown quantity
    with outputs() as out:
        out.write(output, result.export)
        out.figure(plot, lambda drawing: drawing.tornado(result, quantity, most=max_rows))
        _print(result, labels, quantity, max_rows, names if quantity in names else (quantity, *names))


def _print(
    result: Sensitivity, labels: Mapping[str, str], quantity: str, max_rows: int, names: tuple[str, ...]
) -> None:
    """Print the quantities of a point and its derivatives, the largest of one quantity first."""
    shares = {name: result.percent(name) for name in names}
    printed = {name: _in_micrometres(name) for name in names}
    print(f"{result.label}: " + ", ".join(f"{printed[q][0]} = {printed[q][1] * result.size(q):.6g}" for q in names))
    affecting = [
        name for name in shares[quantity] if any(not abs(share[name]) < SHARE_ROUNDING for share in shares.values())
    ]
    rows = [
        [
            _with_unit(name, labels),
            f"{result.values[result.parameters.index(name)]:.6g}",
            *(_percent_text(shares[q][name]) for q in names),
        ]
        for name in affecting[:max_rows]
    ]
    name, factor = printed[quantity]
    title = f"percent per percent of a parameter, by {name}"
    print_table(["", "value", *(printed[q][0] for q in names)], rows, title)
    omitted = len(affecting) - len(rows)
    if omitted:
        print(f"{omitted} more parameters with smaller derivatives; see --max-rows")
    for parameter, value in zip(result.parameters, result.values, strict=True):
        if not value and result.of(quantity)[parameter]:
            unit = shown_unit(labels.get(parameter, "")) or f"unit of {parameter}"
            print(f"{parameter} = 0: {name} changes by {factor * result.of(quantity)[parameter]:.4g} per {unit}")


def _in_micrometres(quantity: str) -> tuple[str, float]:
    """Return the name of a quantity as it is printed, and its factor: lengths in m are printed in um."""
    if not quantity.endswith(f" {LENGTH}"):
        return quantity, 1.0
    return f"{quantity.removesuffix(LENGTH)}{MICROMETRE}", 1e6


def _with_unit(parameter: str, labels: Mapping[str, str]) -> str:
    """Return the name of a parameter with its unit, if it has one."""
    unit = shown_unit(labels.get(parameter, ""))
    return f"{parameter} [{unit}]" if unit else parameter


def _percent_text(share: float) -> str:
    return "-" if math.isnan(share) else f"{share:+.4f}"
