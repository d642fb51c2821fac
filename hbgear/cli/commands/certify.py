"""Command ``hbgear certify``: proofs of the points of a saved curve."""

from __future__ import annotations

import dataclasses
from pathlib import Path
from typing import Annotated

import typer

import hbgear as hb
from hbgear.analysis.summary import certified_bounds, certified_header
from hbgear.cli import complete as cli_complete
from hbgear.cli.options import Dimensionless, File, OwnModel, output_option
from hbgear.cli.output import print_message, print_table
from hbgear.cli.output_files import outputs
from hbgear.cli.support import label_on_curve, load_with_problem, numbered, point_of

NOT_PROVED = 1
"""Exit code of a point that is not certified."""


def certify(
    file: File,
    points: Annotated[
        list[str] | None,
        typer.Argument(
            metavar="POINT...",
            help="Labels such as LP1, or values such as 0.9; default: all folds, period doublings and grazing points.",
            autocompletion=cli_complete.labels,
        ),
    ] = None,
    model: OwnModel = None,
    output: Annotated[
        Path | None, output_option(".json: a single proof as a file of its own, for other programs.", ".json")
    ] = None,
    dimensionless: Dimensionless = False,
) -> None:
    """Prove by ball arithmetic that points of a saved curve exist, are unique, and are stable or not.

    Proofs of special points are written into FILE as exact decimals; tables, figures, reports and the explorer then
    show them. Exit codes: 0 all points are certified, 1 a point is not certified (the message states which condition
    fails), 2 bad input.
    """
    branch = load_with_problem(file, model)
    curves = [dataclasses.replace(branch, others=()), *branch.others]
    names = points or [
        label_on_curve(number, point)
        for number, curve in enumerate(curves, 1)
        for point in curve.special
        if point.kind in ("LP", "PD", "GR")
    ]
    if output is not None and len(names) != 1:
        raise ValueError(f"--output {output}: {len(names)} points; give one POINT")
    chosen = [(name, point_of(branch, name, "POINT")) for name in names]
    rows, failed, attached = [], False, False
    quantity = certified_header(branch, dimensionless).removeprefix("certified ")
    with outputs() as out:
        for name, point in chosen:
            try:
                proof = hb.analysis.certify(point)
            except hb.analysis.NotCertifiedError as error:
                failed = True
                print_message("error", f"{name}: {error}")
                continue
            if output is not None:
                out.write(output, proof.save)
            if point.label:
                number, _ = numbered(branch, name)
                curves[number], attached = proof.attached_to(curves[number]), True
            stability = {True: "stable", False: "unstable", None: "undecided"}[proof.stable]
            bounds = certified_bounds(branch, point, proof.Omega, dimensionless)
            rows.append([name, *bounds, stability, f"{proof.uniqueness:.0e}"])
            print(f"{name}: {proof.statement_in(quantity, bounds)}")
        if attached:
            out.write(file, dataclasses.replace(curves[0], others=tuple(curves[1:])).save)
        if rows:
            print(proof.assumptions)
            print_table(["point", f"{quantity} from", "to", "multipliers", "unique within"], rows)
    if failed:
        raise typer.Exit(NOT_PROVED)
