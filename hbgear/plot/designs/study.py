"""Figures of studies: envelope of response curves, distribution of jumps, results against parameters.

Functions draw `Cases` on matplotlib axes and return the axes, in the style of `plot`.
"""

from __future__ import annotations

import re
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from hbgear.analysis.quantities.axis_quantities import OmegaAxis, axis_scales
from hbgear.analysis.quantities.length_units import factor_of, in_figure, in_micrometres
from hbgear.common.argument_checks import checked_arguments
from hbgear.common.arrays import Array
from hbgear.design.studies.case_results import Cases
from hbgear.design.studies.sweep_statistics import SweepResponses, quantiles_of, sweep_responses
from hbgear.harmonic.models.frequency_units import MESH, PINION
from hbgear.mechanics.series.measures import axis_text, motion_text
from hbgear.plot.branch_sections import HEADROOM
from hbgear.plot.style import (
    COLOURS,
    axes_or_new,
    dress,
    dress_with_speeds,
    heighten,
    legend_handles,
    new_figure,
    scaled_axes,
    styled,
)

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure, SubFigure


JUMPS = {
    "jump_rising": ("^", "-", COLOURS["no_impact"], "jump, sweep up"),
    "jump_falling": ("v", "-.", COLOURS["single_sided"], "jump, sweep down"),
}
"""Marker, line style, colour and name of the jumps of each sweep direction."""


PERCENTILES = (0, 5, 50, 95, 100)
"""Percentiles of a response over the cases [%]."""


_MAX_VECTOR_CASES = 2000
"""Largest number of dots of one panel that is drawn as vectors; larger sets are drawn as pixels."""


@checked_arguments()
def envelope(
    found: Cases, ax: Axes | None = None, *, points: int = 600, legend: bool = True, dimensionless: bool = False
) -> Axes:
    """Draw the response of slow sweeps over Omega in all cases: full range, 5 to 95 percent, and median.

    Each limit is the motion of one of the cases. Where sweeps up and down agree in every case, they are drawn once, in
    grey. Elsewhere each direction has its colour, and there are separate bands for the cases that have jumped, those
    that have not jumped yet and those that never jump, because there may be no motion between them. The median is that
    of the largest of these groups. Narrow axes above show the percentage of cases that have jumped.

    Parameters
    ----------
    found : Cases
        Cases of a study with their curves.
    ax : Axes, optional
        Axes to draw on; new ones by default, with an axis of the mesh frequency above if the models have scales.
    points : int, optional
        Number of frequencies; default 600.
    legend : bool, optional
        Whether to add a legend; default True.
    dimensionless : bool, optional
        Whether Omega and amplitudes keep the unit of the model although the models have scales; default False.

    Returns
    -------
    Axes
        The axes.

    Raises
    ------
    ValueError
        If no curve was kept.

    Examples
    --------
    >>> import hbgear as hb
    >>> from concurrent.futures import ThreadPoolExecutor
    >>> scatter = hb.design.grid(zeta=[0.04, 0.05, 0.06])
    >>> what = ("peak", "jumps", "curve")
    >>> with ThreadPoolExecutor(1) as here:
    ...     found = hb.design.cases(hb.Duffing(), scatter, what, harmonics=1, span=(0.9, 1.4), executor=here)
    ...
    >>> axes = hb.plot.envelope(found)
    """
    abscissa, scales = _axis(found, dimensionless)
    is_new, rows = ax is None, _curve_rows(found)
    scale, factor = scales[rows, None], _lengths(found, dimensionless)[rows, None]
    x = _common_range(scale * np.sort(found.work.span), points)
    swept = {direction: sweep_responses(found, x / scale, direction) for direction in (1, -1)}
    rising, falling = factor * swept[1].amplitude, factor * swept[-1].amplitude
    agrees = np.asarray(np.isclose(rising, falling, rtol=1e-6, atol=0.0, equal_nan=True).all(axis=0))
    with styled():
        ax = axes_or_new(ax, (5.4, 4.2))
        _bands(ax, x, [np.where(agrees, rising, np.nan)], "#444444", "-", ("all cases", "5 to 95 %", "median"))
        if not agrees.all():
            names = {1: "sweep up: 5 to 95 %", -1: "sweep down: 5 to 95 %"}
            for direction, (_, line, colour, _) in zip((1, -1), JUMPS.values(), strict=True):
                responses, widened = swept[direction], _widened(~agrees)
                groups = [
                    np.where(widened & group, factor * responses.amplitude, np.nan)
                    for group in _jump_groups(responses.jumped)
                ]
                _bands(ax, x, groups, colour, line, ("_", names[direction], "_median of most cases"))
        unstable = np.isnan(rising).all(axis=0) & np.isnan(falling).all(axis=0)
        if unstable.any():  # the curve is unstable there in every case, as where its period has doubled
            look: Any = {"facecolor": "none", "edgecolor": "0.6", "hatch": "////", "linewidth": 0}
            height = ax.get_xaxis_transform()  # of the axes
            ax.fill_between(x, 0, 1, unstable.tolist(), transform=height, label="no stable motion", **look)
        ax.set_xlim(x[0], x[-1])
        ax.set_ylim(bottom=0.0, top=_top(found, dimensionless))
        ax.set_xlabel(abscissa.label)
        ax.set_ylabel(f"{_measure(found, dimensionless)},\nslow sweeps")
        dress(ax)
        top = _shares(ax, x, swept) if any(responses.jumped.any() for responses in swept.values()) else ax
        if is_new and scaled_axes(top, abscissa.above):
            heighten(ax)
        if legend:
            ax.legend(loc="best")
    return ax


@checked_arguments()
def percentiles(found: Cases, Omega: Array, direction: int = 1) -> Array:
    """Return the `PERCENTILES` of the response of slow sweeps over the cases.

    Parameters
    ----------
    found : Cases
        Cases of a study with their curves.
    Omega : array_like, shape (n,)
        Frequencies.
    direction : {1, -1}, optional
        Sweep up (default) or down.

    Returns
    -------
    ndarray, shape (5, n)
        Percentiles, each the response of one of the cases.

    Raises
    ------
    ValueError
        If the study has no curves; compute them with "curve".

    Examples
    --------
    >>> import hbgear as hb
    >>> import numpy as np
    >>> from concurrent.futures import ThreadPoolExecutor
    >>> scatter = hb.design.grid(zeta=[0.04, 0.05, 0.06])
    >>> what = ("peak", "jumps", "curve")
    >>> with ThreadPoolExecutor(1) as here:
    ...     found = hb.design.cases(hb.Duffing(), scatter, what, harmonics=1, span=(0.9, 1.4), executor=here)
    ...
    >>> hb.plot.percentiles(found, np.array([0.9, 1.0])).shape
    (5, 2)
    """
    return quantiles_of(sweep_responses(found, Omega, direction).amplitude, np.divide(PERCENTILES, 100))


def _bands(ax: Axes, Omega: Array, groups: list[Array], colour: str, line: str, names: tuple[str, str, str]) -> None:
    """Draw bands of each group of cases, and the median of the largest group at each frequency."""
    counts = np.array([np.isfinite(group).sum(axis=0) for group in groups])
    for i, group in enumerate(groups):
        if not counts[i].any():
            continue
        lowest, low, middle, high, largest = quantiles_of(group, np.divide(PERCENTILES, 100))
        labels = names if i == int(np.argmax(counts.any(axis=1))) else ("_", "_", "_")
        ax.fill_between(Omega, lowest, largest, color=colour, alpha=0.13, linewidth=0, label=labels[0])
        ax.fill_between(Omega, low, high, color=colour, alpha=0.3, linewidth=0, label=labels[1])
        median = np.where(counts.argmax(axis=0) == i, middle, np.nan)
        style: Any = {"color": colour if names[0] == "_" else "black", "linewidth": 1.1}
        ax.plot(*_broken(Omega, median, group), line, **style, label=labels[2], gid="median")


def _broken(Omega: Array, line: Array, group: Array) -> tuple[Array, Array]:
    """Return a line with a gap where it changes to a distant case: where its change exceeds that of any single case."""
    changes = np.where(np.isfinite(np.diff(group, axis=1)), np.abs(np.diff(group, axis=1)), 0.0).max(axis=0)
    jumps = np.flatnonzero(np.abs(np.diff(line)) > changes + 0.02 * np.nanmax(group)) + 1
    return np.insert(Omega, jumps, Omega[jumps - 1]), np.insert(line, jumps, np.nan)


def _top(found: Cases, dimensionless: bool) -> float | None:
    """Return the upper limit of amplitudes if motions of a case grow without bound: above finite peaks and jumps."""
    peaks = found.table.get("peak", np.empty(0))
    if not np.isinf(peaks).any():
        return None
    lengths, row = _lengths(found, dimensionless), {case: i for i, case in enumerate(found.table["case"].tolist())}
    jump_heights = lengths[[row[int(case)] for case in found.jumps[:, 0]], None] * found.jumps[:, 3:]
    finite = _finite(np.concatenate([lengths * peaks, jump_heights.ravel()]))
    return HEADROOM * float(finite.max()) if finite.size else None


def _jump_groups(jumped: Array) -> list[NDArray[np.bool_]]:
    """Return masks of cases with equal total numbers of jumps and equal numbers made so far, at each frequency."""
    total = jumped.max(axis=1)
    totals = np.broadcast_to(total[:, None], jumped.shape)
    pairs = sorted({(float(n), float(k)) for n, k in zip(totals.flat, jumped.flat, strict=True)})
    return [(totals == n) & (jumped == k) for n, k in pairs]


def _widened(mask: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Return the mask with one more frequency on each side, so that neighbouring bands meet."""
    widened = mask.copy()
    widened[1:] |= mask[:-1]
    widened[:-1] |= mask[1:]
    return widened


def _shares(ax: Axes, Omega: Array, swept: dict[int, SweepResponses]) -> Axes:
    """Add narrow axes above with the percentage of cases that have jumped, for each direction."""
    top = ax.inset_axes((0.0, 1.03, 1.0, 0.17), sharex=ax, label="share")
    for responses, (_, line, colour, label) in zip((swept[1], swept[-1]), JUMPS.values(), strict=True):
        top.plot(Omega, 100 * (responses.jumped > 0).mean(axis=0), line, color=colour, linewidth=1.0, label=label)
    top.set_ylim(-8, 108)
    top.set_yticks([0, 50, 100])
    top.set_ylabel("jumped [%]", fontsize=8)
    top.tick_params(labelbottom=False)
    dress(top)
    top.tick_params(axis="y", labelsize=7)
    return top


def _common_range(ends: Array, points: int) -> Array:
    """Return values between ends (n, 2) that all curves cover; that any curve covers if there are none."""
    low, high = (float(end) for end in (ends[:, 0].max(initial=-np.inf), ends[:, 1].min(initial=np.inf)))
    if not -np.inf < low < high:
        low, high = float(ends.min(initial=0.0)), float(ends.max(initial=1.0))
    return np.linspace(low, high, points)


def _curve_rows(found: Cases) -> list[int]:
    """Return the row of the table of each curve."""
    rows = {case: row for row, case in enumerate(found.table["case"].tolist())}
    return [rows[case] for case in found.curves]


def _axis(found: Cases, dimensionless: bool) -> tuple[OmegaAxis, Array]:
    """Return the axis of Omega, the speed of the pinion if the models have scales, and Omega = 1 on it (n,) by case."""
    units, units_by_case = found.units, list[dict[str, float]]()
    if units is not None:
        pairs = np.column_stack([units.mesh, units.speed])[np.isfinite(units.speed)].tolist()
        units_by_case = [{MESH: mesh, PINION: speed} for mesh, speed in pairs]
    abscissa = OmegaAxis(axis_scales(units_by_case, dimensionless), _label(found, "Omega"), dimensionless)
    return abscissa, np.ones(len(found)) if units is None or dimensionless else units.speed


def _length_units(found: Cases, dimensionless: bool) -> Array | None:
    """Return the unit of length [m] by case (n,); None if amplitudes keep the unit of the model."""
    return None if dimensionless or found.units is None else found.units.length


def _lengths(found: Cases, dimensionless: bool) -> Array:
    """Return the unit of amplitudes [um] by case (n,), or 1 if it is unknown."""
    return factor_of(found.work.measure, _length_units(found, dimensionless)) * np.ones(len(found))


@checked_arguments()
def jump_distribution(found: Cases, ax: Axes | None = None, *, bins: int = 30, dimensionless: bool = False) -> Axes:
    """Draw a histogram of the frequency of the largest jump, for each direction of a slow sweep.

    Parameters
    ----------
    found : Cases
        Cases of a study with their jumps.
    ax : Axes, optional
        Axes to draw on; new ones by default, with an axis of the mesh frequency above if the models have scales.
    bins : int, optional
        Largest number of bins; default 30.
    dimensionless : bool, optional
        Whether Omega is kept although the models have scales; default False.

    Returns
    -------
    Axes
        The axes.

    Raises
    ------
    ValueError
        If jumps were not computed.

    Examples
    --------
    >>> import hbgear as hb
    >>> from concurrent.futures import ThreadPoolExecutor
    >>> scatter = hb.design.grid(zeta=[0.04, 0.05, 0.06])
    >>> what = ("peak", "jumps", "curve")
    >>> with ThreadPoolExecutor(1) as here:
    ...     found = hb.design.cases(hb.Duffing(), scatter, what, harmonics=1, span=(0.9, 1.4), executor=here)
    ...
    >>> axes = hb.plot.jump_distribution(found)
    """
    if "jump_rising" not in found.table:
        raise ValueError("there are no jump frequencies; compute them: compute=('jumps',)")
    abscissa, scale = _axis(found, dimensionless)
    columns = {name: _finite(scale * found.table[name]) for name in JUMPS}
    all_jumps = np.concatenate(list(columns.values()))
    is_new = ax is None
    with styled():
        ax = axes_or_new(ax, (5.0, 3.4))
        if len(all_jumps):
            count = max(4, min(bins, int(np.ceil(2 * np.sqrt(len(all_jumps) / 2)))))
            edges = np.histogram_bin_edges(all_jumps, count)
            for name, values in columns.items():
                _, line, colour, label = JUMPS[name]
                label = f"{label}: {len(values)} of {len(found)} cases"
                heights = np.histogram(values, edges)[0]
                ax.stairs(heights, edges, fill=True, color=colour, alpha=0.25, linewidth=0)
                ax.stairs(heights, edges, color=colour, linestyle=line, linewidth=1.2, label=label)
            ax.set_ylim(top=1.3 * ax.get_ylim()[1])  # space for the legend
            ax.legend(loc="upper left")
        else:
            ax.text(0.5, 0.5, "no jump in any case", transform=ax.transAxes, ha="center")
        ax.locator_params(axis="y", integer=True)
        ax.set_xlabel(f"jump, {abscissa.label}")
        ax.set_ylabel("cases")
        dress_with_speeds(ax, abscissa.above if is_new else {})
    return ax


@checked_arguments()
def against_parameters(
    found: Cases, figure: Figure | SubFigure | None = None, *, dimensionless: bool = False
) -> Figure | SubFigure:
    """Draw the largest peak, the jump frequencies and critical values of each case against each varied parameter.

    Parameters
    ----------
    found : Cases
        Cases of a study.
    figure : Figure or SubFigure, optional
        Figure to draw on; a new one by default.
    dimensionless : bool, optional
        Whether Omega and amplitudes keep the unit of the model although the models have scales; default False.

    Returns
    -------
    Figure or SubFigure
        The figure.

    Raises
    ------
    ValueError
        If no varied parameter is a number, or the study has no peaks, jumps or critical values.

    Examples
    --------
    >>> import hbgear as hb
    >>> from concurrent.futures import ThreadPoolExecutor
    >>> scatter = hb.design.grid(zeta=[0.04, 0.05, 0.06])
    >>> what = ("peak", "jumps", "curve")
    >>> with ThreadPoolExecutor(1) as here:
    ...     found = hb.design.cases(hb.Duffing(), scatter, what, harmonics=1, span=(0.9, 1.4), executor=here)
    ...
    >>> figure = hb.plot.against_parameters(found)
    """
    names = [name for name in found.names if np.issubdtype(found.table[name].dtype, np.number)]
    rows = _rows(found, dimensionless)
    if not (names and rows):
        raise ValueError("there is no number to draw against a parameter")
    with styled():
        if figure is None:
            figure = new_figure(1.0 + 1.9 * len(names), 0.6 + 2.1 * len(rows))
        axes: Any = figure.subplots(len(rows), len(names), sharex="col", sharey="row", squeeze=False)
        for line, (label, columns, scale) in zip(axes, rows, strict=True):
            for ax, name in zip(line, names, strict=True):
                for column in columns:
                    _dots(ax, found, name, column, scale)
                dress(ax)
            line[0].set_ylabel(_wrapped(label, 27))
        for ax, name in zip(axes[-1], names, strict=True):
            ax.set_xlabel(_wrapped(_label(found, name)))
            ax.locator_params(axis="x", nbins=4)
        handles = legend_handles(line for ax in axes.flat for line in ax.lines)
        if handles:
            figure.legend(handles.values(), handles.keys(), loc="outside upper center", ncols=len(handles))
    return figure


@checked_arguments()
def figures(found: Cases) -> dict[str, Any]:
    """Draw each figure for which the study has results.

    Parameters
    ----------
    found : Cases
        Cases of a study.

    Returns
    -------
    dict of str to Axes or Figure
        Figures by name: envelope, jump_distribution, against_parameters.

    Examples
    --------
    >>> import hbgear as hb
    >>> from concurrent.futures import ThreadPoolExecutor
    >>> scatter = hb.design.grid(zeta=[0.04, 0.05, 0.06])
    >>> what = ("peak", "jumps", "curve")
    >>> with ThreadPoolExecutor(1) as here:
    ...     found = hb.design.cases(hb.Duffing(), scatter, what, harmonics=1, span=(0.9, 1.4), executor=here)
    ...
    >>> sorted(hb.plot.figures(found))
    ['against_parameters', 'envelope', 'jump_distribution']
    """
    figures_by_name: dict[str, Any] = {}
    for draw in (envelope, jump_distribution, against_parameters):
        try:
            figures_by_name[draw.__name__] = draw(found)
        except ValueError:  # these numbers were not computed
            continue
    return figures_by_name


def _rows(found: Cases, dimensionless: bool) -> list[tuple[str, list[str], Array]]:
    """Return the axis label of each row of panels, the table columns drawn there, and their unit in each case."""
    rows, ones = [], np.ones(len(found))
    if "peak" in found.table:
        rows.append((f"largest {_measure(found, dimensionless)}", ["peak"], _lengths(found, dimensionless)))
    if "jump_rising" in found.table:
        abscissa, scale = _axis(found, dimensionless)
        rows.append((f"jumps, {abscissa.label}", list(JUMPS), scale))
    critical = [(f"critical {_label(found, name)}", [f"critical_{name}"], ones) for name in found.work.critical]
    return rows + critical


def _dots(ax: Axes, found: Cases, name: str, column: str, scale: Array) -> None:
    marker, _, colour, label = JUMPS.get(column, ("o", "", COLOURS["no_impact"], "_"))
    x, y = found.table[name], scale * found.table[column]
    finite = np.isfinite(y)
    look: Any = {"color": colour, "markersize": 3.0 if len(x) < 300 else 1.8, "alpha": 0.75, "markeredgewidth": 0}
    is_large = len(x) > _MAX_VECTOR_CASES
    ax.plot(x[finite], y[finite], marker, **look, label=label, gid=column, rasterized=is_large)


def _wrapped(label: str, width: int = 24) -> str:
    """Return a label in lines of about ``width`` characters; formulas are not broken."""
    lines = [""]
    for word in re.findall(r"(?:\$[^$]*\$|\S)+", label):
        length = len(re.sub(r"\\\w+", "x", f"{lines[-1]} {word}"))  # a command is about one character
        if lines[-1] and length > width:
            lines.append(word)
        else:
            lines[-1] = f"{lines[-1]} {word}".strip()
    return "\n".join(lines)


def _finite(column: Array) -> Array:
    return np.asarray(column[np.isfinite(column)])


def _measure(found: Cases, dimensionless: bool) -> str:
    """Return the name of the measure and of the measured coordinate."""
    motion = motion_text(found.model.labels)
    is_physical = _length_units(found, dimensionless) is not None
    return in_figure(axis_text(found.work.measure, in_micrometres(motion) if is_physical else motion))


def _label(found: Cases, name: str) -> str:
    return found.model.labels.get(name, r"$\Omega$" if name == "Omega" else name)
