"""Pages that are written at each build: of public names, of commands, and of the studies.

    api/        every name of `hbgear` and of its documented sub-modules, one page each, and result classes
    commands.md every command of ``hbgear`` with its options
    studies/    studies/README.md, the figures and tables of the studies

Nothing is listed here by hand, so a new name, command or study has its place without a change. Links of pages to files
that the site has elsewhere are turned round as they are read.
"""

from __future__ import annotations

import ast
import importlib
import inspect
import re
import shutil
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING, Any

import typer
from docstrings import escaped

import hbgear as hb
from hbgear import plot
from hbgear.cli.app import app as commands

if TYPE_CHECKING:
    from sphinx.application import Sphinx

DOCS = Path(__file__).parents[1]
STUDIES = DOCS.parent / "studies"
SPACES = ("mechanics", "gears", "continuation", "harmonic", "analysis", "design", "time", "io")
"""Documented sub-modules, in the order of the API reference."""


PUBLIC = {
    id(getattr(module, name))
    for module in (hb, *(importlib.import_module(f"hbgear.{space}") for space in SPACES))
    for name in module.__all__
}
"""Identities of the objects that have a page of their own."""


def forget() -> None:
    """Remove pages of scripts, studies and rooms that are no more."""
    for folder in ("tutorials", "gallery"):
        scripts = {path.stem for path in (DOCS / "scripts" / folder).glob("*.py")} | {"index"}
        for path in (DOCS / folder).glob("*.*"):
            if path.name.partition(".")[0] not in scripts:
                path.unlink()
    for folder in ("api", "studies"):
        shutil.rmtree(DOCS / folder, ignore_errors=True)


def write(path: Path, text: str) -> None:
    """Write a page."""
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(text, encoding="utf-8")


# ---- public names


def returned(function: Any) -> list[str]:
    """Full names of classes of hbgear that a function returns, as its annotation says."""
    plain = inspect.unwrap(function) if inspect.isfunction(function) else function
    names = re.findall(r"\w+", str(getattr(plain, "__annotations__", {}).get("return", "")))
    found = [getattr(plain, "__globals__", {}).get(name) for name in names]
    own = [thing for thing in found if inspect.isclass(thing) and thing.__module__.startswith("hbgear.")]
    return [f"{thing.__module__}.{thing.__qualname__}" for thing in own if id(thing) not in PUBLIC]


def entry(name: str, thing: Any) -> str:
    """The directive that documents a thing under a name."""
    if inspect.isclass(thing):
        return f".. autoclass:: {name}\n   :members:\n"
    return f".. autofunction:: {name}\n" if inspect.isroutine(thing) else f".. autodata:: {name}\n"


def described(name: str) -> str:
    """What stands below a constant of `hbgear.plot` in the file that defines it."""
    for file in sorted(Path(plot.__file__).parent.glob("*.py")):
        for node, below in pairwise([*ast.parse(file.read_text(encoding="utf-8")).body, ast.Pass()]):
            targets = getattr(node, "targets", [getattr(node, "target", None)])
            if name in [getattr(target, "id", "") for target in targets]:
                value = getattr(getattr(below, "value", None), "value", "")
                return value if isinstance(value, str) else ""
    return ""


def plot_entry(name: str) -> str:
    """The directive of a name of `hbgear.plot`."""
    thing = getattr(plot, name)
    if inspect.isclass(thing) or inspect.isroutine(thing):
        return entry(f"hbgear.plot.{name}", thing)
    return f".. py:data:: {name}\n\n   {' '.join(escaped(described(name)).split())}\n"


def page(title: str, text: str, module: str, entries: list[str]) -> str:
    """A page of the reference."""
    return f"{title}\n{'=' * len(title)}\n\n{text}\n\n.. currentmodule:: {module}\n\n" + "\n".join(entries)


def first_line(thing: Any) -> str:
    """First line of a docstring."""
    return (inspect.getdoc(thing) or "").partition("\n")[0]


def object_page(name: str, thing: Any) -> str:
    """Write the page of an object; return its row in the table of its sub-module."""
    write(DOCS / "api" / f"{name}.rst", f":orphan:\n\n{page(name, '', name.rpartition('.')[0], [entry(name, thing)])}")
    return f"   * - :doc:`{name.removeprefix('hbgear.')} <{name}>`\n     - {escaped(first_line(thing))}\n"


def tables(space: str, names: dict[str, Any]) -> str:
    """Tables of the functions and the classes of a sub-module, functions first; one page for each of them."""
    out = ""
    for title, kind in (("Functions", inspect.isroutine), ("Classes", inspect.isclass)):
        rows = "".join(object_page(f"{space}.{name}", thing) for name, thing in sorted(names.items()) if kind(thing))
        if rows:
            out += f"{title}\n{'-' * len(title)}\n\n.. list-table::\n   :widths: 30 70\n\n{rows}\n"
    return out


def api_pages() -> None:
    """One page for each object and one for each sub-module, functions first."""
    made = ["hbgear"]
    core = {name: getattr(hb, name) for name in hb.__all__ if not name.startswith("__")}
    write(DOCS / "api" / "hbgear.rst", page("hbgear", first_line(hb), "hbgear", [tables("hbgear", core)]))
    for space in SPACES:
        module = importlib.import_module(f"hbgear.{space}")
        names = {name: getattr(module, name) for name in module.__all__}
        also = sorted(name for name in names if core.get(name) is names[name])
        own = {name: thing for name, thing in names.items() if name not in also}
        for thing in list(own.values()):
            for result in returned(thing):
                place, _, name = result.rpartition(".")
                own.setdefault(name, getattr(importlib.import_module(place), name))
        text = first_line(module) + (f"\n\nAlso in ``hbgear``: {', '.join(also)}." if also else "")
        shown = {name: thing for name, thing in own.items() if name in names}
        further = [entry(f"{thing.__module__}.{name}", thing) for name, thing in own.items() if name not in names]
        parts = [tables(f"hbgear.{space}", shown), *(["Results\n-------\n", *further] if further else [])]
        write(DOCS / "api" / f"{space}.rst", page(f"hbgear.{space}", text, f"hbgear.{space}", parts))
        made.append(space)
    entries = [plot_entry(name) for name in plot.__all__]
    write(DOCS / "api" / "plot.rst", page("hbgear.plot", first_line(plot), "hbgear.plot", entries))
    listed = "\n".join(f"   {space}" for space in [*made, "plot"])
    head = (
        "API reference\n=============\n\nNames of ``import hbgear as hb`` and of its sub-modules. Every example runs "
        "in a test. Names that are not listed may change without notice.\n\n"
        f".. toctree::\n   :maxdepth: 1\n\n{listed}\n\n"
    )
    write(DOCS / "api" / "index.rst", f"{head}:ref:`All names in alphabetical order <genindex>`.\n")


# ---- commands


def cell(text: str) -> str:
    """Text for a cell of a table."""
    return " ".join(text.replace("|", "\\|").replace("<", "&lt;").split())


def option_row(parameter: Any, context: Any) -> str:
    """A row of the table of options: how it is written, and what it does."""
    record = parameter.get_help_record(context)
    written = ", ".join([*parameter.opts, *parameter.secondary_opts])
    if parameter.param_type_name == "argument":
        written = parameter.name.upper()
    return f"| `{written}` | {cell(record[1] if record else getattr(parameter, 'help', '') or '')} |"


def command_page() -> None:
    """All commands, as their own help says."""
    group: Any = typer.main.get_command(commands)
    parts = ["# Commands\n", "As `hbgear COMMAND --help` prints them.\n"]
    for name, command in sorted(group.commands.items()):
        if command.hidden:
            continue
        context = command.context_class(command, info_name=f"hbgear {name}")
        about = "\n\n".join(" ".join(part.split()) for part in (command.help or "").split("\n\n"))
        rows = [option_row(p, context) for p in command.params if p.name != "help" and not getattr(p, "hidden", False)]
        parts += [f"## hbgear {name}\n", f"{about}\n", "| option | |\n|---|---|", *rows, ""]
    write(DOCS / "commands.md", "\n".join(parts))


# ---- studies


def study_pages() -> None:
    """The gallery of the studies, with its figures and tables."""
    write(DOCS / "studies" / "index.md", (STUDIES / "README.md").read_text(encoding="utf-8"))
    for path in sorted(STUDIES.glob("*/figures/*")):
        target = DOCS / "studies" / path.relative_to(STUDIES)
        if path.suffix == ".md":
            title = f"{path.parts[-3]}: {path.stem}"
            write(target, f"---\norphan: true\n---\n\n# {title}\n\n{path.read_text(encoding='utf-8')}")
        elif path.suffix == ".png":
            target.parent.mkdir(parents=True, exist_ok=True)
            shutil.copyfile(path, target)


# ---- links


def turned(text: str, depth: int) -> str:
    """Links as the site has them: pages are written so that they hold in the repository.

    ``../studies/README.md`` is ``studies/index.md`` here, ``scripts/gallery/x.py`` is ``gallery/x.rst``.
    """
    up = "../" * (depth + 1)
    text = text.replace(f"]({up}studies/README.md", f"]({'../' * depth}studies/index.md")
    text = text.replace(f"]({up}studies/", f"]({'../' * depth}studies/")
    text = text.replace(f"]({up}CHANGELOG.md", f"]({'../' * depth}changelog.md")
    text = text.replace(f"]({up}CONTRIBUTING.md", f"]({'../' * depth}contributing.md")
    text = re.sub(r"\]\(((?:\.\./)*)scripts/(\w+)/(\w+)\.py\)", r"](\1\2/\3.rst)", text)
    return re.sub(r"\]\(((?:\.\./)*)scripts/(\w+)/README\.rst\)", r"](\1\2/index.rst)", text)


def read(app: Sphinx, name: str, source: list[str]) -> None:
    """Turn the links of a page as it is read."""
    source[0] = turned(source[0], name.count("/"))


def all_pages(app: Sphinx) -> None:
    """Write them all."""
    forget()
    api_pages()
    command_page()
    study_pages()


def setup(app: Sphinx) -> dict[str, bool]:
    """What Sphinx asks of an extension."""
    app.connect("builder-inited", all_pages, priority=100)
    app.connect("source-read", read)
    return {"parallel_read_safe": True}
