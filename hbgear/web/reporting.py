"""Report in one HTML file: model and settings, response curves, tables, validation; it needs no network."""

from __future__ import annotations

import html
import os
import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from hbgear.analysis.quantities.axis_quantities import kind_of
from hbgear.analysis.summary import title_of
from hbgear.common.argument_checks import checked_arguments
from hbgear.common.atomic_write import atomic_write, checked_suffix
from hbgear.common.text.messages import shortened
from hbgear.continuation.results.branch import Branch
from hbgear.design.studies.case_results import Cases
from hbgear.design.studies.results import read_results
from hbgear.time.validation.report import Report as Validation
from hbgear.web.overlay import dots_of, facts_of_motions, lines_of_motions
from hbgear.web.page import page, plotly_script
from hbgear.web.studies import lines_of, study_section
from hbgear.web.view import views

_OTHER_SPACES = re.compile(r"[\t\n\v\f\r\u2028\u2029]")
"""Spaces and ends of lines that tools for publishing change."""


@dataclass(frozen=True)
class Report:
    """A self-contained HTML page.

    Attributes
    ----------
    title : str
        Title of the page.
    html : str
        Text of the page.

    Examples
    --------
    >>> import hbgear as hb
    >>> curve = hb.trace(hb.HarmonicBalance(hb.Duffing(), 5), "Omega", (0.5, 1.6))
    >>> hb.report(curve, title="Duffing")  # doctest: +SKIP
    <Report: Duffing, 5.0 MB>
    """

    title: str
    html: str

    def __repr__(self) -> str:
        return f"<Report: {self.title}, {len(self.html.encode()) / 1e6:.1f} MB>"

    def _repr_html_(self) -> str:
        """Return the page in a frame, for notebooks.

        Spaces other than " " are written as numbers: publishing tools expand tabs and strip lines, and the security
        policy of the page refuses changed scripts.
        """
        escaped = _OTHER_SPACES.sub(lambda match: f"&#{ord(match[0])};", html.escape(self.html))
        return (
            f'<iframe srcdoc="{escaped}" title="{html.escape(self.title)}" '
            'style="width:100%;height:780px;border:1px solid #ccc"></iframe>'
        )

    @checked_arguments()
    def save(self, path: str | os.PathLike[str]) -> None:
        """Write the page to an .html file, which is replaced only after the page is complete.

        Parameters
        ----------
        path : path
            File to write.

        Raises
        ------
        ValueError
            If the path has another suffix.
        """
        checked_suffix(path, (".html", ".htm"), "a report is a page")
        with atomic_write(path, "x", encoding="utf-8") as handle:
            handle.write(self.html)


@checked_arguments()
def report(
    branches: Branch | Sequence[Branch],
    *,
    title: str | None = None,
    names: Sequence[str] | None = None,
    validation: Validation | Sequence[Validation] = (),
    studies: Sequence[Cases | str | os.PathLike[str]] = (),
    measured: Sequence[str | os.PathLike[str]] = (),
) -> Report:
    """Return a report on branches: one page for any browser, without a network; it needs ``hbgear[report]``.

    The page has the response curves (regimes, stability, special points, jumps; axes in Hz and r/min if the model has
    scales), the time history, phase diagram, spectrum and multipliers of the selected point, and tables of special
    points, jumps and estimated errors.

    Parameters
    ----------
    branches : Branch or sequence of Branch
        Branches to show, with the other branches of their ranges. Tori and backbones may be among them: their
        amplitudes are drawn as lines on the response curves.
    title : str, optional
        Title of the page; default the model.
    names : sequence of str, optional
        Names of the branches; default their models, or "curve 1", "curve 2", ... if these are equal.
    validation : Report or sequence of Report, optional
        Results of `hbgear.validate`, shown as tables.
    studies : sequence of Cases or path, optional
        Studies: `Cases`, the folder of ``hbgear study``, or a .npz table of `Cases.export`. Their curves are drawn
        as thin lines; tables show the distribution of the results, and all cases.
    measured : sequence of path, optional
        Tables of measured points, see `read_measurements`. They are drawn as dots, separately for sweep up and down,
        when the figure shows the measure of their amplitudes.

    Returns
    -------
    Report
        The page.

    Raises
    ------
    ValueError
        If there are no response curves, the names are not one for each branch, a branch has other motions, a file is
        not a study, or Plotly is not installed.

    Examples
    --------
    >>> import hbgear as hb
    >>> curve = hb.trace(hb.HarmonicBalance(hb.Duffing(), 5), "Omega", (0.5, 1.6))
    >>> hb.report(curve).save("duffing.html")  # doctest: +SKIP
    """
    branches = (branches,) if isinstance(branches, Branch) else tuple(branches)
    if not branches:
        raise ValueError("no curve to report on")
    if names is not None and len(names) != len(branches):
        raise ValueError(f"{len(names)} names for {len(branches)} branches; give one for each")
    lines = [(branch, names[i] if names else "") for i, branch in enumerate(branches) if kind_of(branch) != "periodic"]
    names = names and [name for branch, name in zip(branches, names, strict=True) if kind_of(branch) == "periodic"]
    branches = tuple(branch for branch in branches if kind_of(branch) == "periodic")
    if not branches:
        raise ValueError("a report needs a response curve; tori and backbones are drawn on it")
    models = [title_of(branch) for branch in branches]
    alike = len(set(models)) < len(models)
    curve_views = views(branches, names or ([f"curve {i + 1}" for i in range(len(branches))] if alike else models))
    title = title or shortened(models[0], 100)
    checks = [validation] if isinstance(validation, Validation) else list(validation)
    study_results = [study if isinstance(study, Cases) else read_results(study) for study in studies]
    study_names = [
        f"study {i if isinstance(study, Cases) else _study_name(study)}" for i, study in enumerate(studies, 1)
    ]
    behind = [line for study, name in zip(study_results, study_names, strict=True) for line in lines_of(study, name)]
    behind += [group for path in measured for group in dots_of(path, branches)]
    behind += [line for branch, name in lines for line in lines_of_motions(branch, name)]
    data = {"curves": curve_views, "behind": behind}
    text = page(
        "report.html",
        data,
        title=title,
        shown=curve_views,
        checks=[_checked(check) for check in checks],
        other_motions=[(name, facts_of_motions(branch)) for branch, name in lines],
        studies=[study_section(study, name) for study, name in zip(study_results, study_names, strict=True)],
        plotly=plotly_script(),
    )
    return Report(title, text)


def _checked(check: Validation) -> dict[str, Any]:
    tables = [("harmonic balance against time integration", *check.table())]
    if check.jumps:
        tables.append(("landings of jumps by time integration", *check.jump_table()))
    return {"summary": check.summary, "ok": check.ok, "tables": tables}


def _study_name(path: str | os.PathLike[str]) -> str:
    """Return the name of a study in a file: that of its folder, or of the table unless it is ``table.npz``."""
    file = Path(path).resolve()
    return file.name if file.is_dir() else file.parent.name if file.name == "table.npz" else file.stem
