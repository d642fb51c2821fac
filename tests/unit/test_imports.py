"""Imports run one way: the table below is held against the code."""

import ast
import subprocess
import sys
from graphlib import TopologicalSorter
from pathlib import Path

import pytest

import hbgear

ROOT = Path(hbgear.__file__).parent

# One line per module, or package of modules: which others of hbgear it may import when it is itself imported.
TABLE = {
    "_version": "",
    "fourier": "",
    "given": "",
    "ranges": "",
    "recent": "",
    "processes": "",
    "signals": "",
    "archive": "fourier",
    "basis": "fourier",
    "collocation": "fourier",
    "plot_labels": "fourier",
    "start": "fourier",
    "laws": "fourier ranges",
    "measures": "fourier ranges",
    "newton": "fourier ranges",
    "replacing": "signals",
    "contact": "fourier laws",
    "model": "fourier laws ranges",
    "pieces": "fourier laws",
    "arc": "fourier newton",
    "augmented": "fourier given newton ranges",
    "store": "_version archive fourier replacing",
    "stability": "collocation contact fourier",
    "branch": "fourier measures model ranges",
    "doubts": "fourier laws model ranges",
    "gears": "fourier laws model ranges",
    "oscillators": "laws model ranges",
    "receptance": "fourier model",
    "reduction": "fourier given model",
    "sampling": "fourier model ranges",
    "flow": "fourier model pieces",
    "stride": "arc fourier newton ranges",
    "ending": "branch",
    "forms": "archive branch fourier measures",
    "jumps": "branch newton",
    "peaks": "arc augmented branch fourier given measures newton",
    "record": "_version arc branch fourier",
    "special": "arc augmented branch fourier newton",
    "balance": "basis branch contact doubts fourier given laws model newton ranges recent receptance stability start",
    "stepper": "collocation fourier laws model pieces ranges receptance",
    "npz": "archive branch forms measures replacing",
    "landings": "branch jumps newton",
    "trace": "arc branch doubts ending fourier given jumps newton ranges record special stride",
    "catalogue": "balance gears model oscillators",
    "sweep": "branch doubts ending fourier given measures model ranges replacing stepper",
    "timedomain": "flow fourier given model pieces ranges stepper",
    "export": "branch measures npz replacing",
    "extend": "arc branch given jumps newton trace",
    "isolated": "balance branch ending fourier given newton ranges stride trace",
    "maps": "augmented balance branch ending fourier given model newton ranges replacing stride trace",
    "switch": "arc augmented branch given newton trace",
    "speeds": "branch catalogue model",
    "shooting": "flow fourier given model newton ranges receptance stepper timedomain",
    "cases": "balance branch doubts ending fourier given maps model npz peaks processes replacing sampling store trace",
    "plot": "branch fourier landings replacing speeds",
    "validate": "_version branch catalogue flow fourier given measures "
    "model newton receptance replacing shooting stepper timedomain",
    "study_file": "cases catalogue model sampling",
    "swept": "cases fourier",
    "plot_time": "branch model plot speeds sweep validate",
    "plot_cases": "cases fourier plot speeds swept",
}
# may import anything, and none of the above may import them
FREE = {"__init__", "__main__", "cli", "cli_complete", "cli_design", "cli_files", "cli_study", "cli_support"}
FREE |= {"cli_time"}

# Libraries that only some modules may import, anywhere in them.
ONLY_IN = {
    "matplotlib": {"plot", "plot_cases", "plot_time", "cli_study", "cli_files"},
    "pyfftw": {"fourier"},
    "typer": {"cli", "cli_complete", "cli_design", "cli_files", "cli_study", "cli_support", "cli_time"},
    "pydantic": {"catalogue", "study_file"},
    "distributed": {"cli_study"},
    "rich": {"cli_study", "cli_support", "cli_time"},
}

FILES = sorted(ROOT.rglob("*.py"))


def module_of(path: Path) -> str:
    """Line of the table a file belongs to: its own name, or that of its folder."""
    return path.relative_to(ROOT).with_suffix("").parts[0]


def names(node: ast.stmt | ast.AST, package: tuple[str, ...]) -> list[str]:
    """Dotted names an import statement asks for; relative ones from the package of the file."""
    if isinstance(node, ast.Import):
        return [alias.name for alias in node.names]
    if isinstance(node, ast.ImportFrom):
        start = package[: len(package) - node.level + 1] if node.level else ()
        stem = [*start, *([node.module] if node.module else [])]
        return [".".join([*stem, alias.name]) for alias in node.names]
    return []


def at_import(body: list[ast.stmt]) -> list[ast.stmt]:
    """Statements that run when a module is imported: not in functions, not for type checkers only."""
    out: list[ast.stmt] = []
    for node in body:
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
            continue
        if isinstance(node, ast.If) and "TYPE_CHECKING" in ast.unparse(node.test):
            out += at_import(node.orelse)
            continue
        out.append(node)
        for part in ("body", "orelse", "finalbody"):
            out += at_import(getattr(node, part, []))
        for handler in getattr(node, "handlers", []):
            out += at_import(handler.body)
    return out


def imported(text: str, package: tuple[str, ...]) -> set[str]:
    """Modules of hbgear that a source imports when it is imported."""
    found = set()
    for node in at_import(ast.parse(text).body):
        for name in names(node, package):
            parts = name.split(".")
            if parts[0] == "hbgear":
                found.add(parts[1] if len(parts) > 1 and (parts[1] in TABLE or parts[1] in FREE) else "__init__")
    return found


@pytest.mark.parametrize("path", FILES, ids=lambda path: path.relative_to(ROOT).as_posix())
def test_module_imports_only_what_the_table_allows(path):
    module = module_of(path)
    if module in FREE:
        return
    assert module in TABLE, f"'{module}' is not in the import table; add a line for it"
    package = ("hbgear", *path.relative_to(ROOT).parts[:-1])
    extra = imported(path.read_text(encoding="utf-8"), package) - set(TABLE[module].split()) - {module}
    assert not extra, f"{module} imports {', '.join(sorted(extra))}, which the import table does not allow"


def test_table_has_no_circle_and_no_dead_line():
    graph = {module: allowed.split() for module, allowed in TABLE.items()}
    order = list(TopologicalSorter(graph).static_order())  # raises CycleError
    assert set(order) == set(graph), "the table allows imports of modules that have no line"
    assert set(graph) == {module_of(path) for path in FILES} - FREE


@pytest.mark.parametrize("library", ONLY_IN)
def test_library_stays_in_its_modules(library):
    users = set()
    for path in FILES:
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if any(name.split(".")[0] == library for name in names(node, ("hbgear",))):
                users.add(module_of(path))
    assert users <= ONLY_IN[library]


@pytest.mark.parametrize(
    "text, found",
    [
        ("from hbgear.plot import response", {"plot"}),
        ("import hbgear.plot as p", {"plot"}),
        ("from hbgear import plot, trace", {"plot", "trace"}),
        ("import hbgear", {"__init__"}),
        ("from hbgear import HarmonicBalance", {"__init__"}),
        ("from . import plot", {"plot"}),
        ("from .plot import response", {"plot"}),
        ("try:\n    import hbgear.plot\nexcept ImportError:\n    import hbgear.cli", {"plot", "cli"}),
        ("class A:\n    from hbgear import plot", {"plot"}),
        ("if TYPE_CHECKING:\n    from hbgear import plot\nelse:\n    from hbgear import cli", {"cli"}),
        ("def f():\n    from hbgear import plot", set()),
        ("import numpy\nfrom numpy import fft", set()),
    ],
)
def test_imports_are_seen(text, found):
    assert imported(text, ("hbgear",)) == found


def test_import_of_hbgear_leaves_what_is_slow_alone():
    slow = ["matplotlib", "pydantic", "distributed", "dask", "pyfftw", "typer", "rich", "PIL"]
    slow += [f"scipy.{part}" for part in ("fft", "integrate", "io", "linalg", "optimize", "signal", "sparse", "stats")]
    code = f"import sys, hbgear; print([name for name in {slow} if name in sys.modules])"
    out = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True, cwd=ROOT.parent)
    assert out.stdout.strip() == "[]"
