"""Period doubling of the base case near Omega = 1/3: cause, range and critical damping.

    python -m studies.dong_2022.doublings [--quick] [-o DIR]

Without impact a small disturbance v of a motion satisfies, for any load and error,

    M v'' + C v' + K v + sum_j w_j [k(tau) w_j^T v + c_j w_j^T v'] = 0

Its mode phi in which the helices move against each other (natural frequency omega_a, damping ratio zeta_a) is excited
through the stiffness: u'' + 2 zeta_a omega_a u' + (omega_a^2 - g eps_1 cos tau) u = 0 with g = sum_j (w_j^T phi)^2. To
first order this principal parametric resonance is unstable for

    (Omega / 2 - omega_a)^2 < (g eps_1 / (4 omega_a))^2 - (zeta_a omega_a)^2

Figure: (a) response with the doubled motion and slow sweeps, (b, c) boundaries of period doubling against damping and
stiffness variation, with the formula, (d) the doubled motion of both helices.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib import pyplot as plt
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from scipy import linalg
from scipy.optimize import brentq

import hbgear as hb
from hbgear.common.arrays import Array
from hbgear.plot import response
from hbgear.time.steady_state import SteadyStateSettings
from studies import study
from studies.dong_2022 import base

SPAN = (0.40, 0.28)
DOWN = (0.350, 0.342, 0.338, 0.333, 0.329, 0.325, 0.321, 0.318, 0.314, 0.305)
"""Omega of the sweeps."""
DISTURBANCE = 0.02
"""Disturbance of the sweeps relative to the state: without it two equal helices keep the same motion."""
OTHER = {"zeta": (0.2, 1e-3), "eps_scale": (0.3, 1.7)}
"""Second parameters in which the boundaries are followed: first the end without doubling, then the other."""
TITLES = ("(b) doubling against damping", "(c) doubling against stiffness variation")
LABEL = r"$\Omega = \omega_\mathrm{mesh}/\omega_n$ [-]"
Results = dict[str, Any]


def run(quick: bool = False) -> Results:
    """``curve``, ``doubled``, ``sweeps``, boundaries by parameter, ``motion`` at Omega = 1/3.

    The quick form sweeps one frequency and follows the boundary in zeta only, with long steps and fewer harmonics.
    """
    curve = base.curve(8 if quick else 16, SPAN)
    doubled = hb.switch(curve, "PD1", (0.2, 0.45))
    settling = SteadyStateSettings(1e-4 if quick else 1e-5)
    ways: tuple[tuple[tuple[float, ...], str], ...] = (((1 / 3,), "down"),) if quick else ((DOWN, "down"), (DOWN, "up"))
    sweeps = [
        hb.time.sweep(hb.gears.DoubleHelicalPair(), grid, way, disturbance=DISTURBANCE, settling=settling)
        for grid, way in ways
    ]
    boundaries = (
        {"zeta": boundary(curve, "zeta", 0.055, hb.StepControl(first_step=0.1, max_step=0.3, max_turn_deg=60))}
        if quick
        else {
            name: boundary(curve, name, away, hb.StepControl(first_step=0.005, max_step=0.015))
            for name, (_, away) in OTHER.items()
        }
    )
    return {
        "curve": curve,
        "doubled": doubled,
        "sweeps": sweeps,
        "boundaries": boundaries,
        "motion": base.at(doubled, 1 / 3),
    }


def boundary(curve: hb.Branch, name: str, away: float, steps: hb.StepControl) -> tuple[hb.Branch, ...]:
    """PD1 and PD2 followed in a second parameter: through the apex and back, and away from it on both sides."""
    own = curve.problem.parameters[name]
    ends = ((OTHER[name][0], "PD1"), (away, "PD1"), (away, "PD2"))
    return tuple(
        hb.trace(hb.harmonic.PeriodDoublingProblem(curve.problem), name, (own, end), curve[label], steps=steps)
        for end, label in ends
    )


def apex(branches: tuple[hb.Branch, ...]) -> hb.SpecialPoint:
    """Where both boundaries meet: no period doubling beyond."""
    point = branches[0]["LP1"]
    assert isinstance(point, hb.SpecialPoint)
    return point


def anti_phase(pair: hb.gears.DoubleHelicalPair) -> tuple[float, float, float]:
    """omega_a, zeta_a and g of the anti-phase mode of the pair with its mean mesh closed."""
    system = pair.system()
    W, c = system.W, np.array([element.damping for element in system.elements])
    squares, modes = linalg.eigh(system.K + W @ W.T, system.M)
    coupling = W.T @ modes
    against = np.where(coupling[0] * coupling[1] < 0, np.abs(coupling[0]), 0.0)
    i = int(np.argmin(np.where(against > 0.05, squares, np.inf)))
    omega = float(np.sqrt(squares[i]))
    damping = modes[:, i] @ (system.C + (W * c) @ W.T) @ modes[:, i]
    return omega, float(damping) / (2 * omega), float(coupling[:, i] @ coupling[:, i])


def excess(pair: hb.gears.DoubleHelicalPair) -> float:
    """Excitation less damping of the anti-phase mode, g eps_1 / (4 omega_a) - zeta_a omega_a: positive if unstable."""
    omega, zeta, g = anti_phase(pair)
    return g * pair.eps_scale * pair.eps[0] / (4 * omega) - zeta * omega


def limit(pair: hb.gears.DoubleHelicalPair, name: str) -> float:
    """Value of a parameter at which the excess is zero."""
    return float(brentq(lambda value: excess(pair.replace(**{name: value})), *OTHER[name]))


def first_order(pair: hb.gears.DoubleHelicalPair) -> tuple[float, float]:
    """Omega at both boundaries by the formula at the head of this file; one and the same where there are none."""
    omega, zeta, _ = anti_phase(pair)
    more = max(excess(pair), 0.0)
    half = 2 * np.sqrt(more * (more + 2 * zeta * omega))
    return 2 * omega - half, 2 * omega + half


def plot(results: Results) -> Figure:
    """Response, boundaries and the doubled motion."""
    figure, axes = plt.subplots(2, 2, figsize=(8.0, 6.2), layout="constrained")
    _response(axes[0, 0], results)
    for ax, title, name in zip((axes[0, 1], axes[1, 0]), TITLES, results["boundaries"], strict=False):
        _tongue(ax, results["boundaries"][name], name)
        ax.set_title(title, loc="left")
    _motion(axes[1, 1], results["motion"])
    return figure


def _response(ax: Axes, results: Results) -> None:
    response(results["curve"], ax=ax, special=False, legend=False, dimensionless=True)
    response(results["doubled"], ax=ax, special=False, legend=False, dimensionless=True)
    for swept, marker in zip(results["sweeps"], ("v", "^"), strict=False):
        ax.plot(
            swept.values,
            swept.amplitude("pp2"),
            marker,
            ms=4.5,
            mfc="white",
            mec="black",
            mew=0.8,
            ls="",
            label=f"sweep {'up' if swept.direction > 0 else 'down'}",
        )
    marked = ((results["curve"], "PD1", "D"), (results["curve"], "PD2", "D"), (results["doubled"], "LP1", "o"))
    for branch, label, marker in marked:
        point = branch[label]
        ax.plot(point.parameters["Omega"], point.amplitude("pp2"), marker, ms=4, mfc="white", mec="black", mew=0.9)
    _jumps(ax, results)
    handles = [
        plt.Line2D([], [], color=study.BLUE, label="no impact"),
        plt.Line2D([], [], color=study.ORANGE, label="single-sided"),
        plt.Line2D([], [], color="#555555", ls="--", label="unstable"),
        plt.Line2D([], [], color="black", marker="D", ms=4, mfc="white", ls="", label="period doubling (PD)"),
        plt.Line2D([], [], color="black", marker="o", ms=4, mfc="white", ls="", label="fold (LP)"),
        *[line for line in ax.lines if str(line.get_label()).startswith("sweep")],
    ]
    ax.legend(handles=handles, loc="upper right")
    ax.set(xlim=SPAN[::-1], ylim=(0.1, 0.86), xlabel=LABEL, ylabel="half peak-to-peak of the gap $d/b_c$ [-]")
    ax.set_title(r"(a) response near $\Omega = 1/3$", loc="left")


def _jumps(ax: Axes, results: Results) -> None:
    """Down from the fold of the doubled motion to the curve, up from PD2 to the doubled motion."""
    curve, doubled = results["curve"], results["doubled"]
    fold, lost = doubled["LP1"], curve["PD2"]
    low, high = fold.parameters["Omega"], lost.parameters["Omega"]
    before_fold = slice(fold.index, None, -1)  # it starts at PD1, on the other side
    above = float(np.interp(high, doubled.values[before_fold], doubled.amplitude("pp2")[before_fold]))
    below = base.at(curve, low).amplitude("pp2")
    style = {"arrowstyle": "-|>", "color": "#777777", "lw": 0.8, "shrinkA": 3, "shrinkB": 0}
    ax.annotate("", (low, below), (low, fold.amplitude("pp2")), arrowprops=style, zorder=3)
    ax.annotate("", (high, above), (high, lost.amplitude("pp2")), arrowprops=style, zorder=3)


def _tongue(ax: Axes, branches: tuple[hb.Branch, ...], name: str) -> None:
    pair = hb.gears.DoubleHelicalPair()
    outline = _outline(branches)
    ax.fill_betweenx(*_sides(outline), color=study.ORANGE, alpha=0.18, lw=0, label="mesh period unstable")
    ax.plot(outline[1], outline[0], color=study.BLUE, label="period doubling")
    end, far = limit(pair, name), float(outline[0][0])
    values = end + (far - end) * np.linspace(0, 1, 100) ** 2
    theory = np.array([first_order(pair.replace(**{name: float(v)})) for v in values])
    for side, label in zip(theory.T, ("first order", "_"), strict=True):
        ax.plot(side, values, ":", color="black", lw=1.1, label=label)
    own = pair.parameters[name]
    ax.axhline(own, color=study.GREY, lw=0.7, zorder=0)
    ax.annotate(
        "base case", (0.015, own), (0, 3), xycoords=("axes fraction", "data"), textcoords="offset points", fontsize=8
    )
    top = apex(branches)
    ax.plot(top.parameters["Omega"], top.parameters[name], "o", ms=4.5, mfc="white", mec="black", mew=0.9)
    up = name == "zeta"
    ax.annotate(
        f"{top.parameters[name]:.5f}",
        (top.parameters["Omega"], top.parameters[name]),
        (0, 7 if up else -7),
        textcoords="offset points",
        ha="center",
        va="bottom" if up else "top",
        fontsize=8,
    )
    ends = min(far, top.parameters[name]), max(far, top.parameters[name])
    room = 0.42 * (ends[1] - ends[0])
    ax.set_ylim(ends[0] if up else ends[0] - 0.4 * room, ends[1] + room)  # the legend stands above the tongue
    ax.set_xlim(left=outline[1].min() - 0.22 * np.ptp(outline[1]))
    ax.set(xlabel=LABEL, ylabel=f"{pair.labels[name]} [-]")
    ax.legend(loc="upper left")
    ax.tick_params(which="both", direction="in", top=True, right=True)


def _outline(branches: tuple[hb.Branch, ...]) -> tuple[Array, Array]:
    """Second parameter and Omega along the boundary, from one far end through the apex to the other."""
    through, first, second = branches
    parts = (first, through, second)
    order = (slice(None, None, -1), slice(None), slice(None))
    values = np.concatenate([branch.values[s] for branch, s in zip(parts, order, strict=True)])
    Omega = np.concatenate([branch.tracked["Omega"][s] for branch, s in zip(parts, order, strict=True)])
    return values, Omega


def _sides(outline: tuple[Array, Array]) -> tuple[Array, Array, Array]:
    """A grid of the second parameter and Omega of both sides on it."""
    values, Omega = outline
    top = int(np.argmax(np.abs(values - values[0])))
    grid = np.linspace(values.min(), values.max(), 300)
    one, other = (np.argsort(values[part]) for part in (slice(0, top + 1), slice(top, None)))
    return (
        grid,
        np.interp(grid, values[: top + 1][one], Omega[: top + 1][one]),
        np.interp(grid, values[top:][other], Omega[top:][other]),
    )


def _motion(ax: Axes, point: hb.Point) -> None:
    for element, (name, color) in enumerate((("left helix", study.BLUE), ("right helix", study.ORANGE))):
        theta, d = point.samples(element)
        ax.plot(np.append(theta, 2 * np.pi) / np.pi, np.append(d, d[0]), color=color, label=name)
    ax.axhline(1.0, color=study.GREY, lw=0.7, zorder=0)
    ax.annotate(
        "teeth lose contact below", (0.92, 1.0), (0, -4), textcoords="offset points", ha="center", va="top", fontsize=8
    )
    ax.set_xlim(0, 2)
    ax.set_xlabel("mesh periods [-]")
    ax.set_ylabel("gap $d/b_c$ [-]")
    ax.set_title(r"(d) doubled motion at $\Omega = 1/3$", loc="left")
    ax.legend(loc="upper right", ncols=2)
    ax.margins(y=0.15)
    ax.tick_params(which="both", direction="in", top=True, right=True)


def report(results: Results) -> str:
    """Boundaries, mode and amplitudes."""
    pair, curve = hb.gears.DoubleHelicalPair(), results["curve"]
    omega, zeta, g = anti_phase(pair)
    low, high = first_order(pair)
    found = [curve[label].parameters["Omega"] for label in ("PD2", "PD1")]
    fold = results["doubled"]["LP1"]
    lines = [
        f"Anti-phase mode: omega_a = {omega:.4f}, zeta_a = {zeta:.4f}, g = {g:.5f}. Principal parametric resonance "
        f"between Omega = {low:.4f} and {high:.4f} to first order; computed: {found[0]:.5f} to {found[1]:.5f}. Load, "
        "error and backlash do not matter, as the teeth do not lose contact before.",
        "",
        "| parameter | base case | doubling vanishes at | Omega there | first order |",
        "| --- | --- | --- | --- | --- |",
    ]
    for name, branches in results["boundaries"].items():
        point = apex(branches)
        theory = f"{limit(pair, name):.4f}"
        cells = [name, f"{pair.parameters[name]:g}", f"{point.parameters[name]:.5f}"]
        lines.append("| " + " | ".join([*cells, f"{point.parameters['Omega']:.5f}", theory]) + " |")
    lines += [
        "",
        f"At the boundaries the doubled motion grows at a fixed Omega until the teeth lose contact, as for a "
        f"linear system; "
        f"then it bends to lower Omega, to a fold at {fold.parameters['Omega']:.5f} with half peak-to-peak "
        f"{fold.amplitude('pp2'):.3f} b_c. Between that fold and Omega = {found[0]:.4f} it exists together "
        f"with the stable "
        "symmetric motion: a sweep down leaves it at the fold, a sweep up finds it at the doubling.",
        "",
        "| sweep | Omega | period | half peak-to-peak, left | right | harmonic balance |",
        "| --- | --- | --- | --- | --- | --- |",
    ]
    for swept in results["sweeps"]:
        way = "up" if swept.direction > 0 else "down"
        for i, Omega in enumerate(swept.values):
            branch = results["doubled"] if swept.period[i] == 2 else curve
            cells = [way, f"{Omega:.4f}", f"{swept.period[i]}", *(f"{x:.5f}" for x in swept.pp2[i])]
            lines.append("| " + " | ".join([*cells, f"{base.at(branch, float(Omega)).amplitude('pp2'):.5f}"]) + " |")
    return "\n".join([*lines, ""])


if __name__ == "__main__":
    study.main()
