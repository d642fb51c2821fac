"""Import rules that import-linter cannot express; its contracts are in pyproject.toml and run here as well."""

import ast
import importlib
import subprocess
import sys
from pathlib import Path

import pytest

import hbgear

ROOT = Path(hbgear.__file__).parent

LIBRARIES = {
    "numba": {"common.process.compiling", "mechanics.laws.c_callback"},
    "platformdirs": {"common.process.compiling"},
    "pint": {"common.units"},
    "pyfftw": {"mechanics.series.fourier"},
    "rich": {"cli"},
    "typer": {"cli"},
    "distributed": {"cli.commands.study"},
    "markupsafe": {"web.page"},
}
"""Libraries that few modules may import: slow imports, and interfaces of which one module takes care."""


def imported(node: ast.AST) -> list[str]:
    if isinstance(node, ast.Import):
        return [alias.name for alias in node.names]
    return [node.module] if isinstance(node, ast.ImportFrom) and node.module else []


def module_imports() -> dict[str, list[ast.Import | ast.ImportFrom]]:
    """The import statements of each module of hbgear, by its name without hbgear."""
    found = {}
    for path in sorted(ROOT.rglob("*.py")):
        nodes = ast.walk(ast.parse(path.read_text(encoding="utf-8")))
        name = ".".join(path.relative_to(ROOT).with_suffix("").parts)
        found[name] = [node for node in nodes if isinstance(node, ast.Import | ast.ImportFrom)]
    return found


MODULE_IMPORTS = module_imports()


def run(code: str) -> str:
    out = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True, cwd=ROOT.parent)
    return out.stdout.strip()


def test_libraries_are_imported_where_they_are_taken_care_of():
    users: dict[str, set[str]] = {library: set() for library in LIBRARIES}
    for name, nodes in MODULE_IMPORTS.items():
        for node in nodes:
            for library in {module.split(".")[0] for module in imported(node)} & users.keys():
                users[library].add(name)
    for library, allowed in LIBRARIES.items():
        places = [{name, name.split(".")[0]} for name in users[library]]
        assert places and all(place & allowed for place in places), (library, users[library])
        assert allowed <= set().union(*places), (library, allowed)


def test_no_private_name_is_imported():
    """A name that two modules share is public."""
    for name, nodes in MODULE_IMPORTS.items():
        for node in nodes:
            if isinstance(node, ast.ImportFrom) and (node.module or "").split(".")[0] == "hbgear":
                private = [a.name for a in node.names if a.name.startswith("_") and not a.name.endswith("__")]
                assert private in ([], ["_version"]), f"{name} imports {', '.join(private)} from {node.module}"


def test_no_package_has_more_than_twelve_entries():
    """Modules and sub-packages of a package; hbgear itself may have two more: __main__ and _version."""
    for init in ROOT.rglob("__init__.py"):
        entries = [p for p in init.parent.iterdir() if p.suffix == ".py" or (p / "__init__.py").exists()]
        names = {p.stem for p in entries} - {"__init__", "__main__", "_version"}
        assert len(names) <= 12, (init.parent, sorted(names))


def test_no_class_has_more_than_300_lines():
    """State, equations, derived quantities and coordination are classes of their own."""
    sizes = {
        f"{path.relative_to(ROOT)}: {node.name}": (node.end_lineno or 0) - node.lineno + 1
        for path in ROOT.rglob("*.py")
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8")))
        if isinstance(node, ast.ClassDef)
    }
    assert len(sizes) > 300
    assert {name: lines for name, lines in sizes.items() if lines > 300} == {}


@pytest.mark.parametrize("package", ["hbgear", "hbgear.gears", "hbgear.plot", "hbgear.web"])
def test_names_of_a_package_are_imported_when_they_are_used(package):
    """Every public name, by a program that has imported nothing else, and by one that imports all of them."""
    code = (
        f"import sys, {package} as room\n"
        "early = len([name for name in sys.modules if name.startswith('hbgear')])\n"
        "values = {name: getattr(room, name) for name in room.__all__}\n"
        "assert set(room.__all__) <= set(dir(room)), set(room.__all__) - set(dir(room))\n"
        "late = len([name for name in sys.modules if name.startswith('hbgear')])\n"
        f"from {package} import *\n"
        "assert all(globals()[name] is value for name, value in values.items())\n"
        "modules = [name for name, value in values.items() if type(value) is type(sys)]\n"
        "modules = [name for name in modules if values[name].__name__.count('.') != 1]  # not the packages of hbgear\n"
        "print(early < late, modules)"
    )
    assert run(code) == "True []"


PACKAGES = [
    "hbgear",
    *(".".join(("hbgear", *path.parent.relative_to(ROOT).parts)) for path in sorted(ROOT.glob("*/**/__init__.py"))),
]


def submodules(package: str) -> set[str]:
    """Modules and packages in a package; of hbgear itself the modules, since its packages are names of it."""
    folder = ROOT.joinpath(*package.split(".")[1:])
    found = {path.stem for path in folder.glob("*.py")}
    return found if package == "hbgear" else found | {path.parent.name for path in folder.glob("*/__init__.py")}


def test_no_exported_name_is_that_of_a_submodule():
    """The import of the submodule would replace the name: "module is not callable"."""
    exported = {package: set(getattr(importlib.import_module(package), "__all__", ())) for package in PACKAGES}
    assert sum(map(len, exported.values())) > 200
    assert {package: both for package, names in exported.items() if (both := names & submodules(package))} == {}


def test_a_missing_name_raises_attribute_error():
    with pytest.raises(AttributeError, match="module 'hbgear' has no attribute 'nothing'"):
        hbgear.nothing  # noqa: B018
    assert hbgear.time.__name__ == "hbgear.time"  # a package needs no import


def test_import_of_hbgear_imports_no_package_of_it():
    names = run("import sys, hbgear; print(sorted(name for name in sys.modules if name.startswith('hbgear.')))")
    assert names == "[]"


def test_import_of_hbgear_imports_no_slow_library():
    slow = ["matplotlib", "pydantic", "distributed", "dask", "pyfftw", "typer", "rich", "PIL", "numba", "pint"]
    slow += ["pandas", "xarray", "plotly", "jinja2", "markupsafe", "flask"]
    slow += [f"scipy.{part}" for part in ("fft", "integrate", "io", "linalg", "optimize", "signal", "sparse", "stats")]
    assert run(f"import sys, hbgear; print([name for name in {slow} if name in sys.modules])") == "[]"


@pytest.mark.parametrize("name", ["hbgear", "hbgear.analysis", "hbgear.time", "hbgear.gears", "hbgear.mechanics"])
def test_completion_shows_the_public_names(name):
    """Editors and notebooks complete what ``dir`` returns; modules that were imported are no public names."""
    package = importlib.import_module(name)
    assert {each for each in dir(package) if not each.startswith("__")} == {
        each for each in package.__all__ if not each.startswith("__")
    }
