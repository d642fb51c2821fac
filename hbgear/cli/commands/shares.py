"""The table of derivatives: percent of each quantity per percent of a parameter, the largest first."""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from hbgear.cli.commands.files import outputs
from hbgear.cli.output import print_table

if TYPE_CHECKING:
    from hbgear.analysis.parameter_sensitivity.table import Sensitivity


MaxRows = Annotated[int, typer.Option("--max-rows", min=1, help="Number of parameters in the table and the figure.")]

Saved = Annotated[Path | None, typer.Option("-o", "--output", help="Save all derivatives as .csv.")]

SHARE_ROUNDING = 1e-6
"""Relative derivative that counts as zero: derivatives of a cusp are accurate to about 1e-7."""


def show_shares(
    found: Sensitivity,
    quantity: str,
    max_rows: int,
    output: Path | None,
    plot: Path | None,
    dimensionless: bool = False,
) -> None:  # fmt: skip
    """Write the derivatives and their figure, and print the table of the largest derivatives of a quantity.

    The empty ``quantity`` is the first one of `Sensitivity.shown` that has a derivative.
    """
    names = found.shown(dimensionless)
    quantity = quantity or next((name for name in names if any(found.percent(name).values())), names[0])
    found.size(quantity)  # refuses an unknown quantity
    with outputs() as out:
        out.write(output, found.export)
        out.figure(plot, lambda drawing: drawing.tornado(found, quantity, most=max_rows))
        _print(found, quantity, max_rows, names if quantity in names else (quantity, *names))


def _print(found: Sensitivity, quantity: str, max_rows: int, names: tuple[str, ...]) -> None:
    shares = {name: found.percent(name) for name in names}
    print(f"{found.label}: " + ", ".join(f"{q} = {found.size(q):.6g}" for q in names))
    known = [
        name for name in shares[quantity] if any(not abs(share[name]) < SHARE_ROUNDING for share in shares.values())
    ]
    rows = [
        [name, f"{found.values[found.parameters.index(name)]:.6g}", *(_percent_text(shares[q][name]) for q in names)]
        for name in known[:max_rows]
    ]
    title = f"percent per percent of a parameter, by {quantity}"
    print_table(["", "value", *names], rows, title)
    left = len(known) - len(rows)
    if left:
        print(f"{left} more parameters with smaller derivatives; see --max-rows")
    for name, value in zip(found.parameters, found.values, strict=True):
        if not value and found.of(quantity)[name]:
            print(f"{name} = 0: {quantity} changes by {found.of(quantity)[name]:.4g} per unit of {name}")


def _percent_text(share: float) -> str:
    return "-" if math.isnan(share) else f"{share:+.4f}"
