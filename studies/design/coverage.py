"""Coverage of two standard errors of a fit, for samples of noise on synthetic sweeps of two gear pairs.

    python -m studies.design.coverage [--quick] [-o DIR]

60 points of sweeps in both directions with 1 % of noise. Spur pair (H = 8): the data are the largest magnitude of the
gap; damping, half backlash, mean load and the first amplitude of the error are fitted from a start 30 to 60 % away.
Alternating amplitudes do not depend on the backlash: while no tooth makes contact at its back, a wider gap only shifts
the motion. Once more with the frequencies at which the sweeps jump, known to 0.1 %. Of the double-helical pair (H = 8)
half the peak-to-peak value in um over the speed in r/min; damping, half backlash and mesh stiffness are sought, of
which the last two are the units as well.

Standard errors are those of the likelihood, to the side to which it falls more slowly
(`hbgear.design.fitting.profile_likelihood`);
the table also has the coverage of first-order errors. For the first samples the likelihood is evaluated as well: each
parameter is held at its true value and the others are fitted again, by which the sum of squares should rise by less
than 4 in 95 % of the draws.
"""

from __future__ import annotations

import math
import time
from dataclasses import dataclass

import numpy as np
from matplotlib.figure import Figure

import hbgear as hb
from hbgear.common.arrays import Array
from hbgear.design.fitting.sweep_prediction import Prediction
from studies import study

ALONE = True

NOISE, JUMP_NOISE = 0.01, 0.001


@dataclass(frozen=True)
class Case:
    """A pair: truth, start, what is sought, span of the points, and how they are measured."""

    name: str
    truth: hb.mechanics.Model
    start: hb.mechanics.Model
    free: tuple[str, ...]
    span: tuple[float, float]
    measure: str
    unit: str = "Omega"
    length: str = ""
    jumps: bool = False
    held: int = 0
    """Draws in which the likelihood is looked at."""


SPUR = hb.SpurPair()
DOUBLE = hb.gears.DoubleHelicalPair(zeta=0.05)
CASES = (
    Case(
        "spur pair",
        SPUR,
        SPUR.replace(zeta=0.08, F_m=0.13, b=1.3, e=(0.07,)),
        ("zeta", "b", "F_m", "e[0]"),
        (0.5, 1.4),
        "max",
        held=50,
    ),
    Case(
        "spur pair and jumps",
        SPUR,
        SPUR.replace(zeta=0.08, F_m=0.13, b=1.3, e=(0.07,)),
        ("zeta", "b", "F_m", "e[0]"),
        (0.5, 1.4),
        "max",
        jumps=True,
    ),
    Case(
        "double-helical pair",
        DOUBLE,
        DOUBLE.replace(zeta=0.06, b_c=29e-6, k_mean=1.9e9),
        ("zeta", "b_c", "k_mean"),
        (0.7, 1.1),
        "pp2",
        "pinion r/min",
        "um",
    ),
)


@dataclass(frozen=True)
class Results:
    """Of each case: (draws, parameters) differences to the truth in standard errors, draws per minute of the processor.

    ``linear`` are the same in standard errors of first order, ``held`` the roots of the rise of the sum of squares for
    each parameter held at its true value, of some draws.
    """

    off: dict[str, Array]
    linear: dict[str, Array]
    rate: dict[str, float]
    residual: dict[str, Array]
    held: dict[str, Array]


def sweeps(case: Case, harmonics: int) -> tuple[Array, Array, Array, list[tuple[float, int]]]:
    """Frequencies, directions and amplitudes without noise, in the units of the case, and the jumps on the way."""
    rising = np.linspace(*case.span, 30)
    scale = case.truth.scales
    factor = scale.pinion_speed(1.0) if case.unit != "Omega" and scale else 1.0
    frequency, direction = factor * np.concatenate([rising, rising]), np.repeat([1, -1], 30)
    vague = hb.design.Measurements(frequency, np.ones(60), direction, 1e12, (), case.unit, case.length, case.measure)
    span = (1.2 * case.span[1], case.span[0] / 1.2)
    found = Prediction(hb.HarmonicBalance(case.truth, harmonics), vague, {}, span)
    jumps = [(factor * jump.value, jump.direction) for jump in found.jumps] if case.jumps else []
    return frequency, direction, found.amplitudes / vague.metres, jumps


def drawn(case: Case, draw: int, clean: tuple[Array, Array, Array, list[tuple[float, int]]]) -> hb.design.Measurements:
    """Measurements with the noise of a draw."""
    frequency, direction, amplitude, jumps = clean
    rng = np.random.default_rng(draw)
    noisy = amplitude * (1 + NOISE * rng.normal(size=len(amplitude)))
    met = [(at * (1 + JUMP_NOISE * rng.normal()), way, JUMP_NOISE * at) for at, way in jumps]
    return hb.design.Measurements(
        frequency, noisy, direction, NOISE * amplitude, met, case.unit, case.length, case.measure
    )


def held_at_truth(case: Case, data: hb.design.Measurements, found: hb.design.Fit, harmonics: int) -> list[float]:
    """The root of the rise of the sum of squares for each parameter that is held at its true value."""
    truth, numbers = case.truth.parameters | case.truth.entries, len(data) + len(data.jumps)
    least = found.mean_square * (numbers - len(case.free))
    out = []
    for name in case.free:
        problem = hb.HarmonicBalance(found.model.replace(**{name: truth[name]}), harmonics)
        others = [other for other in case.free if other != name]
        again = hb.design.fit(problem, data, others, starts=1)
        out.append(math.sqrt(max(0.0, again.mean_square * (numbers - len(others)) - least)))
    return out


def run(quick: bool = False) -> Results:
    """200 draws of each pair; ``quick``: 2 of the spur pair with H = 5."""
    harmonics, cases, draws = (5, CASES[:1], 2) if quick else (8, CASES, 200)
    off, linear, rate, residual, held = {}, {}, {}, {}, {}
    for case in cases:
        clean = sweeps(case, harmonics)
        problem = hb.HarmonicBalance(case.start, harmonics)
        truth = case.truth.parameters | case.truth.entries
        rows, first, left, ratios, seconds = [], [], [], [], 0.0
        for draw in range(draws):
            data, begin = drawn(case, draw, clean), time.process_time()
            found = hb.design.fit(problem, data, case.free)
            seconds += time.process_time() - begin
            if draw < case.held:
                ratios.append(held_at_truth(case, data, found, harmonics))
            apart = np.array([found.values[name] - truth[name] for name in case.free])
            rows.append(apart / list(found.errors.values()))
            first.append(apart / np.sqrt(np.diag(found.covariance)))
            left.append(found.mean_square)
        off[case.name], linear[case.name], residual[case.name] = np.array(rows), np.array(first), np.array(left)
        rate[case.name], held[case.name] = 60 * draws / seconds, np.array(ratios).reshape(-1, len(case.free))
    return Results(off, linear, rate, residual, held)


def plot(results: Results) -> Figure:
    """Return the distribution of the differences to the truth, in standard errors, and the normal one."""
    import matplotlib.pyplot as plt

    figure, panels = plt.subplots(
        1, len(results.off), figsize=(3.6 * len(results.off), 2.8), squeeze=False, layout="constrained"
    )
    x = np.linspace(-4, 4, 200)
    colours = (study.BLUE, study.ORANGE, study.PURPLE, study.GREEN)
    for ax, (case, off) in zip(
        panels[0], ((one, results.off[one.name]) for one in CASES if one.name in results.off), strict=True
    ):
        for j, name in enumerate(case.free):
            share = (np.arange(len(off)) + 0.5) / len(off)
            ax.step(np.sort(off[:, j]), share, color=colours[j], linewidth=1.0, label=name)
        ax.plot(x, [0.5 * (1 + math.erf(t / math.sqrt(2))) for t in x], color=study.GREY, linewidth=0.8, label="normal")
        ax.set_xlim(-4, 4)
        ax.set_xlabel("(estimate - truth) / standard error")
        ax.set_ylabel("share of the draws")
        ax.set_title(case.name)
        ax.legend(fontsize=7)
    return figure


def report(results: Results) -> str:
    """Share of the draws within two standard errors, and draws per minute of the processor."""
    lines = [
        "| pair | parameter | within 2 standard errors | deviation | mean | to first order | held at the truth |",
        "|---|---|---|---|---|---|---|",
    ]
    for case in CASES:
        if case.name in results.off:
            for j, name in enumerate(case.free):
                off, held = results.off[case.name][:, j], results.held[case.name][:, j]
                inside = f"{np.mean(np.abs(off) < 2):.1%} | {off.std():.2f} | {off.mean():+.2f}"
                plain = f"{np.mean(np.abs(results.linear[case.name][:, j]) < 2):.1%}"
                ratio = f"{np.mean(held < 2):.0%} of {len(held)}" if len(held) else ""
                lines.append(f"| {case.name} | {name} | {inside} | {plain} | {ratio} |")
    lines.append("")
    for name, rate in results.rate.items():
        draws, worst = len(results.off[name]), results.residual[name].max()
        text = f"{draws} draws, {rate:.0f} a minute of the processor"
        lines.append(f"{name}: {text}, largest mean square of the residuals {worst:.2f}.  ")
    return "\n".join(lines)


if __name__ == "__main__":
    study.main()
