"""Pages that each build writes: API reference, commands, constants, studies.

    api/        one page for each object of `hbgear`, its sub-modules and `hbgear.plot`, for each result class, and for
                the protocol of problems
    commands.md every command of ``hbgear`` with its options
    constants.md tuned numbers of the modules with their reasons
    studies/    studies/README.md, the figures and tables of the studies

The pages are generated from the package, so a new name, command or study needs no change here. Links of pages to files
of the repository are adapted to the site when a page is read.
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


OBJECT_PAGE = ":orphan:\n:no-search:\n\n"
"""Head of the page of an object. The search finds its name, and its first line in the table of its sub-module."""

FIRST = ("HarmonicBalance", "trace", "Branch", "System", "Element", "GearPair", "follow", "switch", "validate", "load")
"""Names that the index page of the reference links to directly."""

PUBLIC = {
    id(getattr(module, name))
    for module in (hb, *(importlib.import_module(f"hbgear.{space}") for space in SPACES))
    for name in module.__all__
}
"""Identities of the objects that have a page of their own."""


def forget() -> None:
    """Remove pages of earlier builds whose sources do not exist any more."""
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


def returned_classes(function: Any) -> dict[str, Any]:
    """Return the classes in the return annotation of a function that have no public name, by full name."""
    plain = inspect.unwrap(function) if inspect.isfunction(function) else function
    names = re.findall(r"\w+", str(getattr(plain, "__annotations__", {}).get("return", "")))
    found = [getattr(plain, "__globals__", {}).get(name) for name in names]
    own = [thing for thing in found if inspect.isclass(thing) and thing.__module__.startswith("hbgear.")]
    return {f"{thing.__module__}.{thing.__qualname__}": thing for thing in own if id(thing) not in PUBLIC}


def entry(name: str, thing: Any) -> str:
    """Return the directive that documents an object."""
    if inspect.isclass(thing):
        return f".. autoclass:: {name}\n   :members:\n"
    if inspect.isroutine(thing):
        return f".. autofunction:: {name}\n"
    return f".. autodata:: {name}\n\n   {escaped(first_line(thing, name))}\n"


def described(name: str, package: Path = Path(plot.__file__).parent) -> str:
    """Return the docstring below a constant of `hbgear.plot` or of another package, from the file that defines it."""
    for file in sorted(package.rglob("*.py")):
        for node, below in pairwise([*ast.parse(file.read_text(encoding="utf-8")).body, ast.Pass()]):
            targets = getattr(node, "targets", [getattr(node, "target", None)])
            if name in [getattr(target, "id", "") for target in targets]:
                value = getattr(getattr(below, "value", None), "value", "")
                return value if isinstance(value, str) else ""
    return ""


def constant_entry(name: str) -> str:
    """Return the directive of a constant of `hbgear.plot`."""
    return f".. py:data:: {name}\n\n   {' '.join(escaped(described(name)).split())}\n"


def page(title: str, text: str, module: str, entries: list[str]) -> str:
    """Return the text of a page of the reference."""
    return f"{title}\n{'=' * len(title)}\n\n{text}\n\n.. currentmodule:: {module}\n\n" + "\n".join(entries)


def first_line(thing: Any, name: str = "") -> str:
    """Return the first line of a docstring; an alias of a type has one below its definition."""
    alias = not (inspect.isclass(thing) or inspect.isroutine(thing) or inspect.ismodule(thing))
    text = described(name.rpartition(".")[2], Path(hb.__file__).parent) if alias else inspect.getdoc(thing)
    return (text or "").partition("\n")[0]


def object_page(name: str, thing: Any) -> str:
    """Write the page of an object; return its row in the table of its sub-module."""
    write(DOCS / "api" / f"{name}.rst", f"{OBJECT_PAGE}{page(name, '', name.rpartition('.')[0], [entry(name, thing)])}")
    return f"   * - :doc:`{name.removeprefix('hbgear.')} <{name}>`\n     - {escaped(first_line(thing, name))}\n"


def table(title: str, names: dict[str, Any]) -> str:
    """Write one page for each object; return a table of them with a title, or nothing without objects."""
    rows = "".join(object_page(name, thing) for name, thing in sorted(names.items()))
    return f"{title}\n{'-' * len(title)}\n\n.. list-table::\n   :widths: 30 70\n\n{rows}\n" if rows else ""


def is_type_alias(thing: Any) -> bool:
    """Return whether an object is not a function, a class or a module."""
    return not (inspect.isroutine(thing) or inspect.isclass(thing) or inspect.ismodule(thing))


def tables(space: str, names: dict[str, Any]) -> str:
    """Return tables of the functions and the classes of a sub-module, functions first."""
    kinds = {"Functions": inspect.isroutine, "Classes": inspect.isclass}
    if space != "hbgear.plot":  # its constants are on one page
        kinds["Types"] = is_type_alias
    return "".join(
        table(title, {f"{space}.{name}": thing for name, thing in names.items() if kind(thing)})
        for title, kind in kinds.items()
    )


def api_pages() -> None:
    """Write one page for each object and one for each sub-module, functions first."""
    made = ["hbgear"]
    core = {name: getattr(hb, name) for name in hb.__all__ if not name.startswith("__")}
    write(DOCS / "api" / "hbgear.rst", page("hbgear", first_line(hb), "hbgear", [tables("hbgear", core)]))
    for space in SPACES:
        module = importlib.import_module(f"hbgear.{space}")
        names = {name: getattr(module, name) for name in module.__all__}
        also = sorted(name for name in names if core.get(name) is names[name])
        results = {name: result for thing in names.values() for name, result in returned_classes(thing).items()}
        results = {name: result for name, result in results.items() if not (DOCS / "api" / f"{name}.rst").exists()}
        text = first_line(module) + (f"\n\nAlso in ``hbgear``: {', '.join(also)}." if also else "")
        shown = {name: thing for name, thing in names.items() if name not in also}
        parts = [tables(f"hbgear.{space}", shown), table("Results", results)]
        write(DOCS / "api" / f"{space}.rst", page(f"hbgear.{space}", text, f"hbgear.{space}", parts))
        made.append(space)
    drawn = {name: getattr(plot, name) for name in plot.__all__}
    constants = [name for name, thing in drawn.items() if not (inspect.isclass(thing) or inspect.isroutine(thing))]
    entries = [tables("hbgear.plot", drawn)]
    entries += ["Constants\n---------\n", *map(constant_entry, constants)] if constants else []
    write(DOCS / "api" / "plot.rst", page("hbgear.plot", first_line(plot), "hbgear.plot", entries))
    write(DOCS / "api" / "problem.md", problem_page())
    listed = "\n".join(f"   {space}" for space in [*made, "plot", "problem"])
    first = ", ".join(f":doc:`{name} <hbgear.{name}>`" for name in FIRST)
    head = (
        "API reference\n=============\n\nObjects of ``import hbgear as hb`` and of its sub-modules, with one page for "
        "each object. Every example runs in a test. Names that are not listed may change without notice.\n\n"
        f"Most scripts need: {first}.\n\n.. toctree::\n   :maxdepth: 1\n\n{listed}\n\n"
    )
    write(DOCS / "api" / "index.rst", f"{head}:ref:`All names in alphabetical order <genindex>`.\n")


def problem_page() -> str:
    """Return the page of the protocol of problems, the docstring of its module."""
    text = inspect.getdoc(importlib.import_module("hbgear.continuation.problem.base")) or ""
    return f"# Protocol of problems\n\n{text.replace('``', '`')}\n"


# ---- commands


def cell(text: str) -> str:
    """Return text for a cell of a table."""
    return " ".join(text.replace("|", "\\|").replace("<", "&lt;").split())


def option_row(parameter: Any, context: Any) -> str:
    """Return a row of the table of options: its names, and its help."""
    record = parameter.get_help_record(context)
    written = ", ".join([*parameter.opts, *parameter.secondary_opts])
    if parameter.param_type_name == "argument":
        written = parameter.name.upper()
    return f"| `{written}` | {cell(record[1] if record else getattr(parameter, 'help', '') or '')} |"


def command_page() -> None:
    """Write the page of all commands with their help."""
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


# ---- tuned constants


def constant_rows(path: Path) -> list[str]:
    """Return the rows of the numbers at the top level of a module: name, value and reason."""
    source = path.read_text(encoding="utf-8")
    lines, rows = source.splitlines(), []
    for node, below in pairwise([*ast.parse(source).body, ast.Pass()]):
        target = node.targets[0] if isinstance(node, ast.Assign) else getattr(node, "target", None)
        value = getattr(node, "value", None)
        if not isinstance(target, ast.Name) or not target.id.strip("_").isupper() or not is_number(value):
            continue
        reason = getattr(getattr(below, "value", None), "value", None)
        if not isinstance(reason, str):
            comment = lines[node.lineno - 1].partition("#")[2]
            reason = comment or lines[node.lineno - 2].partition("#")[2]
        name, text = target.id.strip("_"), cell(reason.replace("``", "`").replace("$", "\\$"))
        rows.append(f"| `{name}` | {ast.unparse(value).replace('**', '^').replace('*', 'x')} | {text} |")
    return rows


def is_number(node: ast.expr | None) -> bool:
    """Return whether an expression contains only numbers and operators."""
    allowed = (ast.Constant, ast.BinOp, ast.UnaryOp, ast.operator, ast.unaryop)
    parts = [] if node is None else list(ast.walk(node))
    numbers = [part.value for part in parts if isinstance(part, ast.Constant)]
    plain = all(isinstance(value, int | float) and not isinstance(value, bool) for value in numbers)
    return bool(parts) and plain and all(isinstance(part, allowed) for part in parts)


def constant_page() -> None:
    """Write the table of the tuned constants of all modules, by package."""
    root = Path(hb.__file__).parent
    about = "Limits, thresholds and tolerances of the algorithms with their reasons."
    parts = ["# Tuned constants\n", f"{about}\n"]
    for package in sorted(path.parent for path in root.glob("*/__init__.py")):
        found = {path: constant_rows(path) for path in sorted(package.rglob("*.py"))}
        parts += [f"## {package.name}\n"] if any(found.values()) else []
        for path, rows in found.items():
            module = path.relative_to(root).as_posix()
            parts += [f"### {module}\n", "| constant | value | reason |\n|---|---|---|", *rows, ""] if rows else []
    write(DOCS / "constants.md", "\n".join(parts))


# ---- studies


def study_pages() -> None:
    """Write the gallery of the studies, with its figures and tables."""
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
    """Return a page with its links adapted from the repository to the site.

    ``../studies/README.md`` becomes ``studies/index.md``, ``scripts/gallery/x.py`` becomes ``gallery/x.rst``.
    """
    up = "../" * (depth + 1)
    text = text.replace(f"]({up}studies/README.md", f"]({'../' * depth}studies/index.md")
    text = text.replace(f"]({up}studies/", f"]({'../' * depth}studies/")
    text = text.replace(f"]({up}CHANGELOG.md", f"]({'../' * depth}changelog.md")
    text = text.replace(f"]({up}CONTRIBUTING.md", f"]({'../' * depth}contributing.md")
    text = re.sub(r"\]\(((?:\.\./)*)scripts/(\w+)/(\w+)\.py\)", r"](\1\2/\3.rst)", text)
    return re.sub(r"\]\(((?:\.\./)*)scripts/(\w+)/README\.rst\)", r"](\1\2/index.rst)", text)


def referenced(text: str, depth: int) -> str:
    """Return a page whose code ``hb.trace``, outside of blocks, links and headings, is a link to the reference."""
    up = "../" * depth

    def link(match: re.Match[str]) -> str:
        page = DOCS / "api" / f"hbgear.{match[1]}.rst"
        return f"[{match[0]}]({up}api/{page.name})" if page.exists() else match[0]

    parts = re.split(r"(^```.*?^```$|^#.*?$|\[[^\]]*\]\([^)]*\))", text, flags=re.DOTALL | re.MULTILINE)
    parts[::2] = [re.sub(r"`hb\.([\w.]+)(?:\([^`]*\))?`", link, part) for part in parts[::2]]
    return "".join(parts)


def read(app: Sphinx, name: str, source: list[str]) -> None:
    """Adapt the links of a page when it is read."""
    source[0] = turned(source[0], name.count("/"))
    if not name.startswith(("api/", "gallery/", "tutorials/")):
        source[0] = referenced(source[0], name.count("/"))


def all_pages(app: Sphinx) -> None:
    """Write all generated pages."""
    forget()
    api_pages()
    command_page()
    constant_page()
    study_pages()


def setup(app: Sphinx) -> dict[str, bool]:
    """Register the extension."""
    app.connect("builder-inited", all_pages, priority=100)
    app.connect("source-read", read)
    return {"parallel_read_safe": True}
