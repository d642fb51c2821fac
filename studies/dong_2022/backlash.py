"""The four backlashes and the speeds of Figures 17 and 18: two interpretations of each.

A backlash length B = 2 b enters as

    gap    b_c = 25 um stays, W = B / (2 b_c) - 1: only the gap is wider, the transmission error stays in um
    unit   b_c = B / 2: the unit of length grows, and the transmission error e_l b_c with it

and a speed n of the pinion [r/min] as

    model  Omega = 2 pi teeth_p n / (60 omega_n), from Tables 1 and 2 of the paper
    paper  Omega = n / 1200, as it pairs its tests with its computations
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

import hbgear as hb
from hbgear.common.arrays import Array
from studies import study
from studies.dong_2022 import base

ENTRIES = ("gap", "unit")
MAPPINGS = ("model", "paper")
TITLES = {
    "model": r"$\Omega = \omega_\mathrm{mesh}/\omega_n$ of the model",
    "paper": r"$\Omega = n / (1200\ \mathrm{r/min})$ of the paper",
}
COLORS = (study.BLUE, study.ORANGE, study.PURPLE, study.GREEN)


@dataclass(frozen=True)
class Gap:
    """Motions of the left gap with one backlash, at some speeds.

    pp2, max, mean (S,) in um; stable (S,); orders (S, H) amplitudes of the mesh orders in um.
    """

    pp2: Array
    max: Array
    mean: Array
    stable: Array
    orders: Array


def fields(length: float, entry: str) -> dict[str, float]:
    """Fields of the pair for a backlash length B [m].

    Raises
    ------
    ValueError
        If the entry is not "gap" or "unit".
    """
    if entry == "gap":
        return {"W": length / (2 * hb.gears.DoubleHelicalPair().b_c) - 1}
    if entry == "unit":
        return {"b_c": length / 2}
    raise ValueError(f"a backlash enters as one of {', '.join(ENTRIES)}, got '{entry}'")


def omega(speed: Array, mapping: str) -> Array:
    """Omega at speeds of the pinion [r/min].

    Raises
    ------
    ValueError
        If the mapping is not "model" or "paper".
    """
    if mapping not in MAPPINGS:
        raise ValueError(f"a speed is mapped as one of {', '.join(MAPPINGS)}, got '{mapping}'")
    return hb.gears.DoubleHelicalPair().from_pinion_speed(speed) if mapping == "model" else speed / 1200


def measure(length: float, entry: str, mapping: str, speeds: Sequence[float]) -> Gap:
    """The motions at these speeds, in um."""
    changed = fields(length, entry)
    Omega = omega(np.asarray(speeds, dtype=float), mapping)
    curve = base.curve(span=(1.02 * float(Omega.max()), 0.98 * float(Omega.min())), **changed)
    points = [_at(curve, value) for value in map(float, Omega)]
    um = 1e6 * hb.gears.DoubleHelicalPair(**changed).b_c  # type: ignore[arg-type]
    amplitudes = {name: um * np.array([p.amplitude(name) for p in points]) for name in ("pp2", "max", "mean")}
    rows = np.array([p.coefficients() for p in points])
    return Gap(
        **amplitudes,
        stable=np.array([p.stable for p in points], dtype=bool),
        orders=um * np.hypot(rows[:, 1::2], rows[:, 2::2]),
    )


def _at(curve: hb.Branch, Omega: float) -> hb.Point:
    """The motion of a single-valued curve at Omega: from the nearest row in one step."""
    start = curve[int(np.argmin(np.abs(curve.values - Omega)))]
    one = hb.StepControl(first_step=1.0, max_step=1.0)
    here = hb.trace(curve.problem, "Omega", (start.parameters["Omega"], Omega), start, steps=one, special=False)
    return here[len(here) - 1]


def percent(gap: Array, reference: Array) -> Array:
    """Change against a reference in percent."""
    return 100 * (gap / reference - 1)


def name(length: float) -> str:
    """Legend of a backlash length."""
    return f"${1e6 * length:.2f}$ μm"
