"""A report in one page: what was computed and with what, curves to look at, tables, validation. It needs no network."""

from __future__ import annotations

import html
import os
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from hbgear.analysis.summary import describe_changes
from hbgear.common.argument_checks import checked_arguments
from hbgear.common.atomic_write import atomic_write, checked_suffix
from hbgear.common.text.messages import shortened
from hbgear.continuation.results.branch import Branch
from hbgear.design.studies.results import read_results
from hbgear.design.studies.study import Cases
from hbgear.time.validation import Report as Validation
from hbgear.web.overlay import dots_of
from hbgear.web.page import page, plotly_script
from hbgear.web.studies import lines_of, told
from hbgear.web.view import views


@dataclass(frozen=True)
class Report:
    """A page of HTML that stands by itself.

    Parameters
    ----------
    title : of the page.
    html : all of it.

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
        """For notebooks: the page in a frame of its own."""
        return (
            f'<iframe srcdoc="{html.escape(self.html)}" title="{html.escape(self.title)}" '
            'style="width:100%;height:780px;border:1px solid #ccc"></iframe>'
        )

    @checked_arguments()
    def save(self, path: str | os.PathLike[str]) -> None:
        """Write to an .html, whole or not at all.

        Raises
        ------
        ValueError
            If the path ends in something else.
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
    """A report on curves: one page that any browser opens, without a network. Needs ``hbgear[report]``.

    It has the response curves (regimes, stability, special points, jumps; axes in Hz and r/min where the model knows
    its units), the time history, phase diagram, spectrum and multipliers of the point that is clicked, and tables of
    special points, jumps and accuracy.

    Parameters
    ----------
    branches : one or several; the others of their spans are shown too.
    title : by default the model.
    names : of the branches; by default their models, or if these are alike "curve 1", ...
    validation : what `validate` found; its table is shown too.
    studies : `Cases`, or where they are: the folder of ``hbgear study``, or a table that `Cases.export` wrote as .npz.
        Their curves, if they were kept, are drawn thin behind the others; tables have the distribution of what was
        found, and all cases.
    measured : tables of measured points, drawn as dots, rising and falling sweeps apart, where the measure of their
        amplitudes is shown; headings state their units, see `read_measurements`.

    Raises
    ------
    ValueError
        If there is no curve, not a name for each, one is not of periodic motions, a file is none of a study, or Plotly
        is not installed.

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
    models = [describe_changes(branch) for branch in branches]
    alike = len(set(models)) < len(models)
    shown = views(branches, names or ([f"curve {i + 1}" for i in range(len(branches))] if alike else models))
    title = title or shortened(models[0], 100)
    checks = [validation] if isinstance(validation, Validation) else list(validation)
    found = [study if isinstance(study, Cases) else read_results(study) for study in studies]
    called = [f"study {i if isinstance(study, Cases) else _name_of(study)}" for i, study in enumerate(studies, 1)]
    behind = [line for study, name in zip(found, called, strict=True) for line in lines_of(study, name)]
    behind += [group for path in measured for group in dots_of(path, branches)]
    data = {"curves": shown, "behind": behind}
    text = page(
        "report.html", data, title=title, shown=shown, checks=[_checked(check) for check in checks],
        studies=[told(study, name) for study, name in zip(found, called, strict=True)], plotly=plotly_script(),
    )  # fmt: skip
    return Report(title, text)


def _checked(check: Validation) -> dict[str, Any]:
    tables = [("harmonic balance against time integration", *check.table())]
    if check.jumps:
        tables.append(("where jumps land by integration", *check.jump_table()))
    return {"summary": check.summary, "ok": check.ok, "tables": tables}


def _name_of(path: str | os.PathLike[str]) -> str:
    """What a study in a file is called: by its folder, unless the table has a name of its own."""
    file = Path(path).resolve()
    return file.name if file.is_dir() else file.parent.name if file.name == "table.npz" else file.stem
