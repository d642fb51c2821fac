"""``hbgear campbell``: natural frequencies against speed, and critical speeds."""

from __future__ import annotations

from typing import Annotated

import numpy as np
import typer

import hbgear as hb
from hbgear.analysis.campbell_diagram import whirl_word
from hbgear.analysis.quantities.axis_quantities import OmegaAxis
from hbgear.cli.commands.files import FIGURES, check_writable, outputs
from hbgear.cli.options import Changes, Dimensionless, Figure, First, Last, Model
from hbgear.cli.output import print_table
from hbgear.cli.support import assignments, chosen_model, span_of
from hbgear.harmonic.models.frequency_units import MESH


def register(app: typer.Typer) -> None:
    """Add the command of this module."""
    app.command()(campbell)


def campbell(
    model: Model,
    changes: Changes = None,
    first: First = None,
    last: Last = None,
    order: Annotated[
        list[str] | None,
        typer.Option("--order", metavar="NAME=ORDER", help="Order relative to Omega, such as shaft=0.04; repeatable.",
                     show_default="from the model"),
    ] = None,
    points: Annotated[int, typer.Option(min=2, max=10_000, help="Number of speeds.")] = 101,
    modes: Annotated[int | None, typer.Option(min=1, help="Number of lowest modes; all by default.")] = None,
    closed: Annotated[
        list[str] | None, typer.Option("--closed", metavar="NAME", help="An element in contact; repeatable."),
    ] = None,
    opened: Annotated[
        list[str] | None, typer.Option("--open", metavar="NAME", help="An element whose gap is open; repeatable."),
    ] = None,
    plot: Figure = None,
    dimensionless: Dimensionless = False,
) -> None:  # fmt: skip
    """Compute natural frequencies against speed, and critical speeds, where excitation orders cross them.

    Gaps are open or closed as in the static equilibrium under the mean loads; --closed and --open change single
    elements. Rotors with gyroscopic terms have forward and backward whirl.
    """
    check_writable(plot, FIGURES)
    chosen = chosen_model(model, changes)
    orders = {name: _number(name, text) for name, text in assignments("--order", order)} if order else None
    a, b = sorted(span_of(chosen, first, last))
    for name in {*(closed or ())} & {*(opened or ())}:
        raise ValueError(f"--closed {name} and --open {name}: give one of them")
    contacts = {name: True for name in closed or ()} | {name: False for name in opened or ()}
    found = hb.analysis.campbell(chosen, (a, b), orders, points, modes, closed=contacts)
    with outputs() as out:
        out.figure(plot, lambda drawing: drawing.campbell(found, dimensionless=dimensionless))
        print(f"elements in contact: {', '.join(found.closed) or 'none'}; open: {', '.join(found.opened) or 'none'}")
        known, across = dict(found.scales), OmegaAxis(found.scales, dimensionless=dimensionless)
        whirls = bool(np.isfinite(found.whirl).any())
        headers = [
            "order",
            "mode",
            *(["Omega"] if dimensionless or not known else []),
            *known,
            "natural frequency" + (" [Hz]" if MESH in known else ""),
            "damping ratio",
            *(["whirl"] if whirls else []),
        ]
        unit = known.get(MESH, 1.0)
        rows = [
            ["mesh" if one.order == "Omega" and across.is_speed else one.order,
             str(one.mode), *([f"{one.Omega:.6g}"] if dimensionless or not known else []),
             *(f"{one.Omega * known[name]:.6g}" for name in known),
             f"{one.frequency * unit:.6g}", f"{one.damping + 0.0:.4g}",
             *([whirl_word(one.whirl)] if whirls else [])]
            for one in found.critical
        ]  # fmt: skip
        if rows:
            print_table(headers, rows, "critical speeds")
        else:
            end = across.text(b) if across.is_speed else f"{b:g}"
            print(f"no order crosses a natural frequency from {across.text(a)} to {end}")


def _number(name: str, text: str) -> float:
    try:
        return float(text)
    except ValueError:
        raise ValueError(
            f"--order {name}={text}: '{text}' is not a number; give the order relative to Omega, such as 0.04"
        ) from None
