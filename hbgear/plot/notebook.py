"""Display of curves and models in notebooks: tables, and the figure of a curve."""

from __future__ import annotations

import base64
import html
import inspect
import io
from collections.abc import Iterable, Sequence
from typing import Any

from hbgear.analysis.summary import jump_table, reliability_lines, summary_facts
from hbgear.common.text.symbols import in_html, unit_of
from hbgear.continuation.results.branch import Branch
from hbgear.harmonic.equations.layout import layout_of
from hbgear.io.branches.columns import bracketed
from hbgear.mechanics.models import Model
from hbgear.plot.curves import response
from hbgear.plot.style import without_windows


def branch_html(branch: Branch) -> str:
    """Return a summary of a curve, its jumps, and its figure if its points are periodic motions."""
    has_motions = layout_of(branch) is not None and len(branch) > 0
    facts = [(name, text) for name, text in summary_facts(branch) if text] if has_motions else []
    parts = [f"<b>{html.escape(repr(branch))}</b>", _table((), facts)]
    if has_motions and branch.jumps():
        headers, rows, _ = jump_table(branch)
        parts += ["<p>jumps of a slow sweep</p>", _table(headers, rows)]
    parts += [f"<p>{html.escape(line)}</p>" for line in (reliability_lines(branch) if has_motions else ())]
    if has_motions:
        parts.append(f'<img alt="response curve" src="data:image/png;base64,{_figure(branch)}">')
    return f"<div>{''.join(parts)}</div>"


def model_html(model: Model) -> str:
    """Return the parameters of a model with meaning and unit."""
    about = (inspect.getdoc(type(model)) or "").partition("\n")[0]
    head = f"<b>{html.escape(type(model).__name__)}</b><p>{html.escape(about)}</p>"
    rows = []
    for name, value in model.parameters.items():
        label = str(model.labels.get(name, ""))
        unit = bracketed(unit_of(label)).strip()
        meaning = in_html(label)
        if unit and meaning.endswith("]"):
            meaning = meaning[: meaning.rindex("[")]
        rows.append(
            f"<tr><td><code>{name}</code></td><td>{value:.8g}</td><td>{html.escape(unit)}</td><td>{meaning}</td></tr>"
        )
    return f"<div>{head}<table>{''.join(rows)}</table></div>"


def _table(headers: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    head = "".join(f"<th>{html.escape(text)}</th>" for text in headers)
    body = "".join(f"<tr>{''.join(f'<td>{html.escape(text)}</td>' for text in row)}</tr>" for row in rows)
    return f"<table>{f'<tr>{head}</tr>' if head else ''}{body}</table>"


def _figure(branch: Branch) -> str:
    """Return the response curve as a .png in base64."""
    with without_windows():
        figure: Any = response(branch).figure
    file = io.BytesIO()
    figure.savefig(file, format="png", dpi=110)
    return base64.b64encode(file.getvalue()).decode()
