"""Figure and tables of a campaign: ends and times of traces, special points, stability and landings."""

from __future__ import annotations

from collections import Counter
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from hbgear.continuation.results.status import Status
from studies import study
from studies.random.collecting import Results
from studies.random.truth import ComparedPoint

TITLES = {
    "spur": "spur pairs",
    "helical": "double-helical pairs",
    "bearings": "pairs on bearings",
    "two": "two masses",
    "stops": "unequal stops",
    "touching": "stops at gap 0",
    "preloaded": "preload",
    "stepped": "stepped stiffness",
    "cubic": "cubic and backlash",
    "python": "laws in Python",
    "compiled": "compiled laws",
    "friction": "tanh friction",
    "impacts": "two contacts",
    "chain": "three masses",
    "gyroscopic": "gyroscopic",
    "engine": "engine chains",
    "train": "trains",
    "planetary": "planetary sets",
    "drawing": "drawings",
}
"""Names of the kinds of machines in figures and tables."""


def plot(results: Results) -> Figure:
    """Draw ends and times of all traces, errors of special points, stability and landings."""
    from matplotlib import pyplot as plt

    figure, axes = plt.subplots(2, 3, figsize=(11.0, 6.8), layout="constrained")
    for ax, draw in zip(axes.flat, (_ends, _times, _errors, _stated, _verdicts, _landings), strict=True):
        draw(ax, results)
        ax.tick_params(which="both", direction="in")
    return figure


COLOURS = (study.BLUE, study.ORANGE, study.PURPLE, study.GREEN, study.GREY)
STYLES = ("-", "--", ":", "-.")
MARKERS = {"LP": "o", "PD": "D", "NS": "s", "GR": "x", "BP": "P"}


def _kinds(results: Results) -> list[str]:
    """Return the kinds of traced machines, in the order of `TITLES`."""
    seen = {one.machine.partition(":")[0] for one in results.ended}
    return [kind for kind in TITLES if kind in seen]


def _of_kind(names: list[Any], kind: str) -> list[Any]:
    return [one for one in names if one.machine.startswith(f"{kind}:")]


def _ends(ax: Axes, results: Results) -> None:
    """Draw the share of machines by status, for each kind."""
    counts = {kind: Counter(one.status for one in _of_kind(results.ended, kind)) for kind in _kinds(results)}
    statuses = sorted({s for c in counts.values() for s in c}, key=lambda s: -sum(c[s] for c in counts.values()))
    shades = ["#1f4e8c", "#7ea6d8", "#d9730d", "#9c1f5c", "#2f7d4f", "#8a8a8a", "#c2a500", "#111111"]
    for i, (_kind, count) in enumerate(counts.items()):
        left, total = 0.0, sum(count.values()) or 1
        for status, shade in zip(statuses, shades, strict=False):
            share = 100 * count[status] / total
            ax.barh(i, share, left=left, color=shade, height=0.6, label=status.replace("_", " ") if i == 0 else None)
            left += share
    ax.set_yticks(range(len(counts)), [f"{TITLES[kind]} ({sum(counts[kind].values())})" for kind in counts])
    ax.invert_yaxis()
    ax.set(xlabel="share of machines [%]", xlim=(0, 100), title="status of traces")
    _below(ax)


def _times(ax: Axes, results: Results) -> None:
    """Draw the cumulative share of machines over the time of their trace."""
    for i, kind in enumerate(_kinds(results)):
        seconds = np.sort([one.seconds for one in _of_kind(results.ended, kind)])
        ax.step(
            seconds,
            100 * np.arange(1, len(seconds) + 1) / max(len(seconds), 1),
            where="post",
            color=COLOURS[i % 5],
            linestyle=STYLES[i // 5],
            label=TITLES[kind],
        )
    ax.set(
        xscale="log",
        xlabel="time of the trace, one core [s]",
        ylabel="share of machines [%]",
        ylim=(0, 101),
        title="time of a default call",
    )
    _below(ax)


def _known(results: Results) -> list[ComparedPoint]:
    return [p for one in results.compared for p in one.points if np.isfinite(p.error)]


def _errors(ax: Axes, results: Results) -> None:
    """Draw the cumulative share of special points over their true error."""
    points = _known(results)
    for kind, colour in zip(MARKERS, COLOURS, strict=True):
        errors = np.sort([max(p.error, 1e-12) for p in points if p.kind == kind])
        if errors.size:
            ax.step(
                errors,
                100 * np.arange(1, len(errors) + 1) / len(errors),
                where="post",
                color=colour,
                label=f"{kind} ({len(errors)})",
            )
    ax.set(
        xscale="log",
        xlabel=r"true error of $\Omega$ [-]",
        ylabel="share of special points [%]",
        ylim=(0, 101),
        title="special points against shooting",
    )
    _below(ax)


def _stated(ax: Axes, results: Results) -> None:
    """Draw the true error of every special point over the stated error."""
    points = [p for p in _known(results) if np.isfinite(p.stated)]
    low, high = 1e-12, 1.0
    for kind, marker in MARKERS.items():
        some = [p for p in points if p.kind == kind]
        x, y = ([max(v, low) for v in values] for values in ([p.stated for p in some], [p.error for p in some]))
        ax.plot(x, y, marker, color=study.BLUE, markersize=3, markerfacecolor="none", label=kind, linestyle="none")
    for times, style in ((1, "-"), (3, "--"), (10, ":")):
        ax.plot(
            [low, high],
            [times * low, times * high],
            style,
            color="black",
            linewidth=0.8,
            label="equal" if times == 1 else f"{times} times",
        )
    ax.set(
        xscale="log",
        yscale="log",
        xlim=(low, high),
        ylim=(low, high),
        xlabel="stated error [-]",
        ylabel=r"true error of $\Omega$ [-]",
        title="stated and true errors",
    )
    ax.legend(loc="upper center", bbox_to_anchor=(0.5, -0.17), ncols=4, handlelength=1.4, columnspacing=1.0)


def _verdicts(ax: Axes, results: Results) -> None:
    """Draw the distance of the largest multiplier from the unit circle; wrong points are in the shaded quadrants."""
    rows = [v for one in results.compared for v in one.verdicts]
    groups = (
        ("right", [v for v in rows if v.stable is not None and not v.wrong], ".", study.BLUE),
        ("undecided", [v for v in rows if v.stable is None], "s", study.ORANGE),
        ("wrong", [v for v in rows if v.wrong], "x", "#c00000"),
    )
    for x in ((-1, 0, 0, 1), (0, 1, -1, 0)):
        ax.fill_between(x[:2], x[2], x[3], color="#eeeeee", linewidth=0)
    for label, some, marker, colour in groups:
        ax.plot(
            [v.reported - 1 for v in some],
            [v.true - 1 for v in some],
            marker,
            color=colour,
            markersize=4,
            markerfacecolor="none",
            linestyle="none",
            label=f"{label} ({len(some)})",
        )
    for set_scale in (ax.set_xscale, ax.set_yscale):
        set_scale("symlog", linthresh=1e-6)
    ax.set(
        xlim=(-1, 1),
        ylim=(-1, 1),
        xlabel=r"$|\mu|_\mathrm{max} - 1$ of the curve",
        title="stability",
        ylabel=r"$|\mu|_\mathrm{max} - 1$ by shooting",
    )
    ticks = [-1e-1, -1e-3, -1e-5, 0, 1e-5, 1e-3, 1e-1]
    ax.set_xticks(ticks)
    ax.set_yticks(ticks)
    _below(ax)


def _landings(ax: Axes, results: Results) -> None:
    """Draw the size of the motion after each jump, of the curve and integrated."""
    jumps = [j for one in results.compared for j in one.jumps]
    sure = [j for j in jumps if j.sure]
    groups = (
        ("equal", [j for j in sure if j.right], "o", study.BLUE),
        ("indeterminate or slow", [j for j in jumps if j not in sure], "s", study.ORANGE),
        ("elsewhere", [j for j in sure if not j.right], "x", "#c00000"),
    )
    for label, some, marker, colour in groups:
        ax.plot(
            [j.reported for j in some],
            [j.true for j in some],
            marker,
            color=colour,
            markersize=4,
            markerfacecolor="none",
            linestyle="none",
            label=f"{label} ({len(some)})",
        )
    ax.axline((1, 1), (2, 2), color="black", linewidth=0.8, zorder=0)
    ax.set(
        xscale="log",
        yscale="log",
        xlabel="rms of the curve [-]",
        ylabel="rms integrated [-]",
        title="landings of jumps",
    )
    _below(ax)


def _below(ax: Axes) -> None:
    """Draw the legend below the axes, where it covers nothing."""
    ax.legend(loc="upper center", bbox_to_anchor=(0.5, -0.17), ncols=3, handlelength=1.0, columnspacing=1.0)


# ---- table


def report(results: Results) -> str:
    """Return counts, errors, and all machines with a deviation."""
    head = [
        "machines",
        "number",
        *_statuses(results),
        "exceptions",
        "contradicted or stopped",
        "median [s]",
        "longest [s]",
    ]
    rows = [head, ["---"] * len(head)]
    for kind in _kinds(results):
        some = _of_kind(results.ended, kind)
        count, seconds = Counter(one.status for one in some), [one.seconds for one in some] or [np.nan]
        failed = sum(one.points == 0 for one in some)
        wrong = sum(bool(one.contradictions) and one.points > 0 for one in some)
        rows.append(
            [
                TITLES[kind],
                len(some),
                *(count[s] for s in _statuses(results)),
                failed,
                wrong,
                f"{np.median(seconds):.2f}",
                f"{np.max(seconds):.1f}",
            ]
        )
    lines = [_row(row) for row in rows]
    lines += ["", f"{len(results.compared)} machines are compared with shooting. Errors refer to Omega.", ""]
    lines += [_row(row) for row in _points(results)]
    verdicts = [v for one in results.compared for v in one.verdicts]
    wrong_ones = [v for v in verdicts if v.wrong]
    jumps = [j for one in results.compared for j in one.jumps]
    sure = [j for j in jumps if j.sure]
    astray = [j for j in sure if not j.right]
    undecided, unsure = sum(v.stable is None for v in verdicts), len(jumps) - len(sure)
    lines += [
        "",
        f"The stability of {len(verdicts)} points is compared: {len(wrong_ones)} are wrong and {undecided} "
        f"undecided. Of {len(jumps)} jumps, {unsure} of them reported as indeterminate or slow, {len(astray)} "
        f"land elsewhere. {results.seconds / 60:.0f} min of one core.",
    ]
    lines += ["", "Deviations by machine (kind:number):", ""]
    lines += [f"* {one.machine}: {one.status}; {one.contradictions}" for one in results.ended if one.contradictions]
    lines += [
        f"* {p.machine}: {p.kind} {_text(p)}"
        for one in results.compared
        for p in one.points
        if not np.isfinite(p.error)
    ]
    lines += [
        f"* {v.machine}: {'stable' if v.stable else 'unstable'} at {v.Omega:.7g}, with |mu| = {v.reported:.6f}; "
        f"it is {v.true:.6f}"
        for v in wrong_ones
    ]
    lines += [
        f"* {j.machine}: {j.label} at {j.Omega:.6g} lands on rms {j.true:.4g}, not {j.reported:.4g}. {j.note}"
        for j in astray
    ]
    return "\n".join([*(line.rstrip() for line in lines), ""])


def _row(cells: list[Any]) -> str:
    return "| " + " | ".join(map(str, cells)) + " |"


def _text(p: ComparedPoint) -> str:
    return f"false at {p.Omega:.7g}" if np.isnan(p.true) else f"missing at {p.true:.7g}"


def _statuses(results: Results) -> list[str]:
    known = [str(s) for s in Status]
    seen = {one.status for one in results.ended}
    return [s for s in known if s in seen]


def _points(results: Results) -> list[list[Any]]:
    """Return the table of special points by their kind."""
    head = [
        "kind",
        "compared",
        "by shooting",
        "false",
        "missing",
        "median error",
        "95 %",
        "largest",
        "below 3 x stated",
        "below 10 x",
    ]
    rows = [head, ["---"] * len(head)]
    every = [p for one in results.compared for p in one.points]
    for kind in MARKERS:
        some = [p for p in every if p.kind == kind]
        known = [p for p in some if np.isfinite(p.error)]
        if not some:
            continue
        errors = [p.error for p in known] or [np.nan]
        ratio = np.array([p.error / max(p.stated, 1e-9) for p in known if np.isfinite(p.stated)] or [np.nan])
        false, missing = sum(bool(np.isnan(p.true)) for p in some), sum(bool(np.isnan(p.Omega)) for p in some)
        rows.append(
            [
                kind,
                len(some),
                sum(p.by == "shooting" for p in some),
                false,
                missing,
                *(f"{x:.0e}" for x in np.percentile(errors, (50, 95, 100))),
                *(f"{100 * np.mean(ratio < times):.1f} %" for times in (3, 10)),
            ]
        )
    return rows
