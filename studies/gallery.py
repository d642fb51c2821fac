"""The gallery page: every figure with one sentence and the command that makes it."""

from __future__ import annotations

import importlib
from collections.abc import Sequence

from studies import study

HEAD = """# Studies

Every figure below is made by one command, shown beside it; all of them by

```sh
python3 -m venv .venv && .venv/bin/pip install . && .venv/bin/python -m studies
```

which runs as many at once as there are cores, and skips what is there and unchanged. This page is written by
`python -m studies --gallery`. Each study is a short script on the public interface of hbgear: `run(quick=False)`
computes, `plot(results)` draws. `python -m studies.dong_2022.fig04 --pdf` writes the figure as .pdf too.
"""


def gallery(names: Sequence[str]) -> str:
    """The page in Markdown.

    Parameters
    ----------
    names : studies as dotted names, ``studies.folder.study``.
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
