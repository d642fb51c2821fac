"""Gallery page: every figure with one sentence and its command."""

from __future__ import annotations

import importlib
from collections.abc import Sequence

from studies import study

HEAD = """# Studies

Each figure has the command that computes it. All figures are computed by

```sh
python3 -m venv .venv && .venv/bin/pip install . && .venv/bin/python -m studies
```

which runs one study per core and skips studies that are unchanged. `python -m studies --gallery` writes this page. Each
study is a short script that uses the public interface of hbgear: `run(quick=False)` computes, `plot(results)` draws.
`python -m studies.dong_2022.fig04 --pdf` also writes the figure as .pdf.
"""


def gallery(names: Sequence[str]) -> str:
    """Return the page in Markdown.

    Parameters
    ----------
    names : sequence of str
        Studies as dotted names, ``studies.folder.study``.
    """
    parts, last = [HEAD], ""
    for name in names:
        _, group, stem = name.split(".")
        if group != last:
            package = importlib.import_module(f"studies.{group}")
            title, _, rest = (package.__doc__ or group).strip().partition("\n")
            parts.append(f"## {title.rstrip('.')}\n" + (f"\n{rest.strip()}\n" if rest.strip() else ""))
            last = group
        module = importlib.import_module(name)
        sentence = (module.__doc__ or "").strip().split("\n\n")[0].replace("\n", " ")
        drawn = (study.ROOT / group / "figures" / f"{stem}.png").exists()
        image = f"![{stem}]({group}/figures/{stem}.png)\n\n" if drawn else ""
        text = f"{image}**{stem}.** {sentence}"
        if (study.ROOT / group / "figures" / f"{stem}.md").exists():
            text += f" Numbers: [{stem}.md]({group}/figures/{stem}.md)."
        parts.append(f"{text}\n\n```sh\npython -m {name}\n```\n")
    return "\n".join(parts)
