"""Stated errors of special points against shooting, on machines that differ from those of the campaign.

python -m studies.random.calibration --count 10            # of each kind of `other_machines`
python -m studies.random.calibration stops rotor --first 100
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator

import numpy as np

from studies.random.other_machines import KINDS, machine
from studies.random.truth import KINDS_SHOT, ComparedPoint, NotFound, point_by_shooting, traced

ROUNDING = 2e-9
"""Error of shooting, below which no stated error is compared."""


def compared(kind: str, number: int, harmonics: int = 16) -> Iterator[ComparedPoint]:
    """Yield the located special points of the response curve of a machine with the values by shooting."""
    it = machine(kind, number)
    curve = traced(it, harmonics, cover=False)
    for point in curve.special:
        if point.kind not in KINDS_SHOT or not point.located:
            continue
        try:
            true = point_by_shooting(it, curve, point)
        except NotFound:
            true = np.nan
        yield ComparedPoint(it.name, point.kind, point.parameters["Omega"], true, point.error, "shooting")


def main() -> None:
    """Print each point whose error is larger than stated, and how many lie within three and ten times."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("kinds", nargs="*", default=list(KINDS))
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--count", type=int, default=10)
    given = parser.parse_args()
    ratios = []
    for kind in given.kinds:
        for number in range(given.first, given.first + given.count):
            for p in compared(kind, number):
                ratio = p.error / max(p.stated, ROUNDING)
                if np.isfinite(ratio):
                    ratios.append(ratio)
                if not ratio <= 1.5:
                    print(
                        f"{p.machine} {p.kind} at {p.Omega:.9g}: {p.stated:.1e} stated, {p.error:.1e} true", flush=True
                    )
    found = np.array(ratios)
    print(
        f"{len(found)} points: {np.mean(found < 3):.1%} within three times, {np.mean(found < 10):.1%} within ten times"
    )


if __name__ == "__main__":
    main()
