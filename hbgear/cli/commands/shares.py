"""The table of derivatives: percent of each quantity for one percent of a parameter, the largest first."""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from hbgear.cli.commands.files import outputs
from hbgear.cli.support import print_table

if TYPE_CHECKING:
    from hbgear.analysis.parameter_sensitivity import Sensitivity


Most = Annotated[int, typer.Option(min=1, help="Parameters in the table and the figure, by their effect.")]

Saved = Annotated[Path | None, typer.Option("-o", "--output", help="Save all derivatives as .csv.")]

ROUNDING = 1e-6  # share that is none: derivatives of a cusp hold some 1e-7


def show_shares(found: Sensitivity, quantity: str, most: int, output: Path | None, plot: Path | None) -> None:
    """Write the derivatives and their figure, and print the table, sorted by a quantity, of as many parameters.

    quantity : "" for the first that moves.
    """
    quantity = quantity or _first(found)
    found.size(quantity)  # refuses one that is unknown
    with outputs() as out:
        out.write(output, found.export)
        out.figure(plot, lambda drawing: drawing.tornado(found, quantity, most=most))
        _print(found, quantity, most)


def _print(found: Sensitivity, quantity: str, most: int) -> None:
    shares = {name: found.percent(name) for name in found.quantities}
    print(f"{found.label}: " + ", ".join(f"{q} = {found.size(q):.6g}" for q in found.quantities))
    known = [name for name in shares[quantity] if any(not abs(share[name]) < ROUNDING for share in shares.values())]
    rows = [
        [name, f"{found.values[found.parameters.index(name)]:.6g}", *(_told(shares[q][name]) for q in shares)]
        for name in known[:most]
    ]
    title = f"percent of each for one percent of a parameter, by {quantity}"
    print_table(["", "value", *found.quantities], rows, title)
    left = len(known) - len(rows)
    if left:
        print(f"{left} more with less effect; see --most")
    for name, value in zip(found.parameters, found.values, strict=True):
        if not value and found.of(quantity)[name]:
            print(f"{name} = 0: {quantity} changes by {found.of(quantity)[name]:.4g} for one of its unit")


def _first(found: Sensitivity) -> str:
    """What moves: the frequency, or of a motion whose frequency is held its amplitude."""
    return next((name for name in found.quantities if any(found.percent(name).values())), found.quantities[0])


def _told(share: float) -> str:
    return "-" if math.isnan(share) else f"{share:+.4f}"
