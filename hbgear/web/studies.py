"""Content of a page about a study: its curves as thin lines, and tables of the distribution over its cases."""

from __future__ import annotations

from typing import Any, TypeAlias

import numpy as np

from hbgear.common.arrays import Array
from hbgear.common.text.digits import rounded
from hbgear.design.studies.case_results import Cases
from hbgear.design.studies.results import Results
from hbgear.web.view import plain

Study: TypeAlias = Cases | Results

_PERCENTILES = {"smallest": 0, "5 %": 5, "median": 50, "95 %": 95, "largest": 100}
"""Columns of a distribution and their percentiles [%]."""


_MAX_DRAWN_CURVES = 200
"""Largest number of curves drawn; percentiles describe larger studies better."""


_MAX_LISTED_CASES = 500
"""Largest number of cases listed in the table."""


def lines_of(study: Study, name: str) -> list[dict[str, Any]]:
    """Return curves of a study as thin lines, at most `_MAX_DRAWN_CURVES`, after their legend entry."""
    cases = list(study.curves)
    drawn_cases = [
        cases[i] for i in np.unique(np.linspace(0, len(cases) - 1, min(_MAX_DRAWN_CURVES, len(cases))).astype(int))
    ]
    shown = study.work if isinstance(study, Cases) else study
    kind = {"mode": "lines", "measure": shown.measure, "element": shown.element}
    legend = [{"name": name, **kind, "x": [None], "y": [None], "legend": True}] if drawn_cases else []
    return legend + [
        {"name": f"case {case}", **kind, "x": plain(study.curves[case][0]), "y": plain(study.curves[case][1])}
        for case in drawn_cases
    ]


def study_section(study: Study, name: str) -> dict[str, Any]:
    """Return the title, summary and tables of a study."""
    table = study.table
    failed = int(np.sum(table["reason"] != "")) if "reason" in table else 0
    drawn_count = min(_MAX_DRAWN_CURVES, len(study.curves))
    portion = f"{drawn_count} of {len(study.curves)}" if drawn_count < len(study.curves) else "all"
    summary = f"{len(table['case'])} cases" + (f", {failed} of which failed" if failed else "")
    curves = f"; {portion} of their curves are drawn as thin lines" if study.curves else ""
    tables = [("Distribution over the cases", ["", *_PERCENTILES], _distribution(table))]
    if len(study.jumps):
        headers = ["sweep", "cases that jump", "jumps at Omega, 5 %", "median", "95 %", "amplitude before", "after"]
        tables.append(
            ("Jumps of slow sweeps; amplitudes are medians", headers, _jumps(study.jumps, len(table["case"])))
        )
    return {"name": name, "summary": summary + curves, "tables": tables, "cases": _cases(table)}


def _distribution(table: dict[str, Any]) -> list[list[str]]:
    """Return percentiles of each numeric column."""
    rows = []
    for name, column in table.items():
        if name in ("case", "seconds") or column.dtype.kind not in "if":
            continue
        finite = column[np.isfinite(column)]
        if len(finite):
            values = np.percentile(finite, list(_PERCENTILES.values()), method="inverted_cdf")
            rows.append([name, *(_number(float(value)) for value in values)])
    return rows


def _jumps(jumps: Array, count: int) -> list[list[str]]:
    """Return for each sweep direction the number of cases that jump, and percentiles of frequency and amplitudes."""
    rows = []
    for direction, name in ((1, "up"), (-1, "down")):
        rows_of_direction = jumps[jumps[:, 2] == direction]
        if not len(rows_of_direction):
            rows.append([name, f"0 of {count}", *["-"] * 5])
            continue
        frequencies = np.percentile(rows_of_direction[:, 1], (5, 50, 95), method="inverted_cdf")
        sizes = [values[np.isfinite(values)] for values in rows_of_direction[:, 3:].T]
        middle = [rounded(float(np.median(values)), 4) if len(values) else "-" for values in sizes]
        rows.append(
            [
                name,
                f"{len(np.unique(rows_of_direction[:, 0]))} of {count}",
                *(rounded(float(w), 5) for w in frequencies),
                *middle,
            ]
        )
    return rows


def _cases(table: dict[str, Any]) -> tuple[str, list[str], list[list[str]]]:
    """Return title, headers and rows of all cases, or of the first `_MAX_LISTED_CASES`."""
    count = len(table["case"])
    rows = [[_cell(column[i]) for column in table.values()] for i in range(min(count, _MAX_LISTED_CASES))]
    title = "all cases" if count <= _MAX_LISTED_CASES else f"the first {_MAX_LISTED_CASES} of {count} cases"
    return title, list(table), rows


def _number(value: float) -> str:
    return f"{value:.0f}" if value == round(value) and abs(value) < 1e6 else rounded(value, 5)


def _cell(value: Any) -> str:
    if isinstance(value, np.floating):
        return rounded(float(value), 6) if np.isfinite(value) else "-"
    return str(value)
