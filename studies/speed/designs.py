"""Many designs: 100 000 spur pairs, 1000 double-helical pairs, and maps of the jumps of the double-helical pair.

    python -m studies.speed.designs [--quick] [-o DIR]

Spur pairs are a latin hypercube about the default in damping, load and amplitude of the error, H = 16. Double-helical
pairs have the scatter of `studies.design.tolerances`, H = 12. Of each design the response curve is traced with
stability, its largest peak and the jumps of slow sweeps, in one process for each core; their start is included. Maps of
jumps, H = 16 and three response curves each, are made in one process: the least of three runs.
"""

from __future__ import annotations

import os
import time
from typing import Any

import hbgear as hb
from studies import study
from studies.design import tolerances

ALONE = True

SPREAD = {"zeta": ("uniform", 0.03, 0.08), "F_m": ("uniform", 0.06, 0.16), "e_scale": ("uniform", 0.7, 1.3)}
"""Distribution of each parameter of the spur pairs."""
MAPS = {"zeta": (0.02, 0.1), "e_scale": (0.5, 1.5), "torque": (700.0, 2100.0)}
"""Spans of the maps of jumps."""


def designs(name: str, model: hb.mechanics.Model, sample: Any, harmonics: int, processes: int) -> dict[str, Any]:
    """Seconds that all designs of a sample take, with the jumps that were found and the designs that failed."""
    start = time.perf_counter()
    found = hb.design.cases(model, sample, harmonics=harmonics, processes=processes)
    seconds = time.perf_counter() - start
    return {
        "name": name,
        "designs": len(found),
        "of": found.total,
        "jumps": len(found.jumps),
        "failed": len(found.failed),
        "seconds": seconds,
        "processes": processes,
    }


def jump_map(parameter: str, span: tuple[float, float], runs: int) -> dict[str, Any]:
    """Seconds of a map of jumps, with its folds and cusps."""
    seconds = []
    for _ in range(runs):
        start = time.perf_counter()
        found = hb.jump_map(hb.gears.DoubleHelicalPair(), parameter, span)
        seconds.append(time.perf_counter() - start)
    return {
        "parameter": parameter,
        "span": span,
        "rows": sum(map(len, found.folds)),
        "arms": len(found.arms),
        "cusps": [point.parameters[parameter] for point in found.cusps],
        "seconds": min(seconds),
    }


def run(quick: bool = False) -> dict[str, list[dict[str, Any]]]:
    """Rows of the designs and of the maps."""
    spur, helical, processes = (6, 2, 1) if quick else (100_000, 1000, os.cpu_count() or 1)
    maps = {"e_scale": (1.1, 1.2)} if quick else MAPS
    spread = hb.design.latin_hypercube(spur, 1, **SPREAD)
    scatter = hb.design.monte_carlo(helical, tolerances.SEED, **tolerances.SCATTER)
    return {
        "designs": [
            designs("spur pair", hb.SpurPair(), spread, 16, processes),
            designs("double-helical pair", tolerances.BASE, scatter, 12, processes),
        ],
        "maps": [jump_map(parameter, span, 1 if quick else 3) for parameter, span in maps.items()],
    }


def report(rows: dict[str, list[dict[str, Any]]]) -> str:
    """Both tables in Markdown."""
    lines = [
        "| done | designs | jumps | failed | processes | all [s] | a design, of one process [ms] |",
        "| --- | --- | --- | --- | --- | --- | --- |",
    ]
    for row in rows["designs"]:
        each = 1e3 * row["seconds"] * row["processes"] / row["designs"]
        cells = [f"{row['designs']} of {row['of']}", row["name"], row["jumps"], row["failed"], row["processes"]]
        lines.append("| " + " | ".join([*map(str, cells), f"{row['seconds']:.1f}", f"{each:.1f}"]) + " |")
    lines += [
        "",
        "| jumps of the double-helical pair over | span | arms | rows | cusps | map [s] |",
        "| --- | --- | --- | --- | --- | --- |",
    ]
    for row in rows["maps"]:
        low, high = row["span"]
        cusps = ", ".join(f"{value:.6g}" for value in row["cusps"]) or "-"
        cells = [row["parameter"], f"{low:g} to {high:g}", row["arms"], row["rows"], cusps, f"{row['seconds']:.2f}"]
        lines.append("| " + " | ".join(map(str, cells)) + " |")
    return "\n".join([*lines, ""])


if __name__ == "__main__":
    study.main()
