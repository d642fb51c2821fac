"""``hbgear campbell``: natural frequencies against speed, and critical speeds."""

from __future__ import annotations

from typing import Annotated

import numpy as np
import typer

import hbgear as hb
from hbgear.analysis.campbell_diagram import Campbell, whirl_word
from hbgear.analysis.quantities.axis_quantities import OmegaAxis
from hbgear.cli import options
from hbgear.cli.output import print_records
from hbgear.cli.output_files import outputs
from hbgear.cli.support import assignments, chosen_model, span_of
from hbgear.harmonic.models.frequency_units import MESH


def campbell(
    model: options.Model,
    changes: options.Changes = None,
    first: options.First = None,
    last: options.Last = None,
    order: Annotated[
        list[str] | None,
        typer.Option(
            "--order",
            metavar="NAME=ORDER",
            help="Order relative to Omega, such as shaft=0.04; repeatable.",
            show_default="from the model",
        ),
    ] = None,
    points: Annotated[int, typer.Option(min=2, max=10_000, help="Number of speeds.")] = 101,
    modes: Annotated[int | None, typer.Option(min=1, help="Number of lowest modes; all by default.")] = None,
    closed: Annotated[
        list[str] | None, typer.Option("--closed", metavar="NAME", help="An element in contact; repeatable.")
    ] = None,
    opened: Annotated[
        list[str] | None, typer.Option("--open", metavar="NAME", help="An element whose gap is open; repeatable.")
    ] = None,
    plot: options.Figure = None,
    dimensionless: options.Dimensionless = False,
) -> None:
    """Compute natural frequencies against speed, and critical speeds, where excitation orders cross them.

    Gaps are open or closed as in the static equilibrium under the mean loads; --closed and --open change single
    elements. Rotors with gyroscopic terms have forward and backward whirl.
    """
    chosen = chosen_model(model, changes)
    orders = {name: _number(name, text) for name, text in assignments("--order", order)} if order else None
    a, b = sorted(span_of(chosen, first, last))
    for name in {*(closed or ())} & {*(opened or ())}:
        raise ValueError(f"--closed {name} and --open {name}: give one of them")
    contacts = {name: True for name in closed or ()} | {name: False for name in opened or ()}
    diagram = hb.analysis.campbell(chosen, (a, b), orders, points, modes, closed=contacts)
    with outputs() as out:
        out.figure(plot, lambda drawing: drawing.campbell(diagram, dimensionless=dimensionless))
        print(
            f"elements in contact: {', '.join(diagram.closed) or 'none'}; open: {', '.join(diagram.opened) or 'none'}"
        )
        _print_critical_speeds(diagram, a, b, dimensionless)


def _print_critical_speeds(diagram: Campbell, a: float, b: float, dimensionless: bool) -> None:
    """Print a table of the critical speeds, or that no order crosses a natural frequency between a and b."""
    units, axis = dict(diagram.scales), OmegaAxis(diagram.scales, dimensionless=dimensionless)
    whirls, unit = bool(np.isfinite(diagram.whirl).any()), units.get(MESH, 1.0)
    frequency = "natural frequency" + (" [Hz]" if MESH in units else "")
    records = []
    for speed in diagram.critical:
        order = "mesh" if speed.order == "Omega" and axis.is_speed else speed.order
        record = {"order": order, "mode": str(speed.mode)}
        if dimensionless or not units:
            record["Omega"] = f"{speed.Omega:.6g}"
        record |= {name: f"{speed.Omega * scale:.6g}" for name, scale in units.items()}
        record |= {frequency: f"{speed.frequency * unit:.6g}", "damping ratio": f"{speed.damping + 0.0:.4g}"}
        if whirls:
            record["whirl"] = whirl_word(speed.whirl)
        records.append(record)
    if records:
        print_records(records, "critical speeds")
    else:
        end = axis.text(b) if axis.is_speed else f"{b:g}"
        print(f"no order crosses a natural frequency from {axis.text(a)} to {end}")


def _number(name: str, text: str) -> float:
    try:
        return float(text)
    except ValueError:
        raise ValueError(
            f"--order {name}={text}: '{text}' is not a number; give the order relative to Omega, such as 0.04"
        ) from None
