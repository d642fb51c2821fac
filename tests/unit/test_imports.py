"""Imports run one way, between rooms (sub-packages) and between the files of a room: the tables are held exactly."""

import ast
import subprocess
import sys
from graphlib import TopologicalSorter
from pathlib import Path

import pytest

import hbgear

ROOT = Path(hbgear.__file__).parent

# Each room may import those above it. Continuation and mechanics know nothing of each other.
ROOMS = (
    "common",
    "continuation",
    "mechanics",
    "gears",
    "instants",
    "harmonic",
    "timedomain",
    "io",
    "design",
    "plot",
    "web",
    "cli",
)
APART = {("continuation", "mechanics"), ("mechanics", "continuation")}

# Imports of higher rooms, all inside of functions: what a branch can be asked to do with files is done by io.
UPWARD = {("continuation.branch", "io.npz"), ("continuation.branch", "io.tables"), ("continuation.branch", "io.frames"),
          ("continuation.branch", "plot.notebook"),
          ("mechanics.model", "plot.notebook"),
          ("continuation.branch", "timedomain.landing")}  # fmt: skip

# Files of each room, lowest first: which others of the room each imports when it is itself imported.
FILES = {
    "common": {
        "__init__": "",
        "arrays": "",
        "messages": "",
        "texts": "",
        "arguments": "messages",
        "command": "",
        "optional": "signals",
        "symbols": "",
        "progress": "",
        "progress_bar": "progress",
        "ranges": "messages",
        "units": "messages ranges",
        "recent": "",
        "signals": "",
        "checksums": "",
        "compiling": "checksums signals",
        "digits": "",
        "threads": "",
        "late": "",
        "replacing": "signals",
    },
    "continuation": {
        "__init__": "",
        "algebra": "",
        "bracketing": "",
        "differences": "algebra",
        "reading": "",
        "stepsize": "",
        "elimination": "",
        "verdicts": "",
        "stepping": "elimination verdicts",
        "consistency": "",
        "branch": "consistency reading",
        "ending": "branch",
        "passing": "branch",
        "work": "",
        "problem": "algebra branch differences reading work",
        "newton": "algebra problem",
        "bordered": "algebra branch differences newton problem reading",
        "crossing": "algebra bordered differences problem",
        "sensitivity": "algebra bordered differences problem",
        "corrector": "algebra newton problem",
        "deflation": "algebra newton problem",
        "bifurcating": "branch corrector events newton problem segment",
        "jumps": "bifurcating branch newton passing problem reading",
        "homotopy": "algebra corrector newton problem",
        "segment": "algebra corrector newton problem",
        "asymptote": "algebra problem segment",
        "nearing": "",
        "touching": "",
        "covering": "branch jumps newton segment",
        "record": "branch problem segment",
        "events": "algebra bordered bracketing branch crossing newton problem record segment touching",
        "hidden": "branch events segment",
        "accuracy": "algebra bordered branch events newton problem record segment work",
        "departing": "corrector newton problem segment stepsize",
        "stride": "algebra corrector newton problem segment stepsize verdicts",
        "tracer": "accuracy algebra asymptote branch consistency covering departing ending events hidden jumps newton "
        "problem record segment stepsize stride work",
        "refining": "algebra branch newton problem",
        "extending": "branch jumps newton problem segment tracer",
        "following": "branch events problem tracer",
        "switching": "branch events tracer",
    },
    "mechanics": {
        "__init__": "",
        "fields": "",
        "summing": "",
        "fourier": "",
        "periodic": "fourier",
        "laws": "fourier periodic",
        "scales": "",
        "matrices": "fourier",
        "speed": "fourier matrices",
        "describing": "periodic",
        "receptances": "fourier",
        "model": "describing fields fourier laws matrices periodic receptances scales speed",
        "calling": "",
        "compiled_law": "laws",
        "doubts": "model",
        "recession": "fourier laws model",
        "functions": "fields model",
        "named": "model",
        "oscillators": "laws model",
        "references": "laws model",
        "lawchecks": "laws model references",
        "reduction": "model references",
    },
    "gears": {
        "geometry": "",
        "backlash": "",
        "excited": "",
        "spur": "excited",
        "support": "",
        "mesh_cycle": "",
        "double_helical": "excited geometry support",
        "rotor_bearing": "excited",
        "helical": "excited support",
        "gear": "geometry",
        "tooth": "gear geometry",
        "pair": "backlash gear geometry",
        "iso_stiffness": "gear pair",
        "iso_dynamics": "gear iso_stiffness pair",
        "loaded_mesh": "gear mesh_cycle pair tooth",
        "forms": "helical mesh_cycle rotor_bearing spur support",
        "train_parts": "excited gear geometry mesh_cycle pair",
        "beam": "train_parts",
        "housing": "support",
        "phasing": "train_parts",
        "train": "beam housing phasing support train_parts",
        "planetary": "excited phasing train_parts",
        "__init__": "",
    },
    "instants": {
        "__init__": "",
        "equations": "",
        "propagation": "equations",
        "pattern": "equations",
        "shooting": "equations pattern propagation",
        "checking": "equations pattern propagation shooting",
        "refine": "checking equations pattern propagation shooting",
    },
    "harmonic": {
        "__init__": "",
        "exact": "",
        "collocation": "",
        "crossings": "",
        "corners": "",
        "pieces": "crossings",
        "numbers": "corners",
        "modes": "",
        "observables": "",
        "phi": "",
        "realbasis": "",
        "receptance": "numbers",
        "spinning": "receptance",
        "measuring": "receptance",
        "nearby": "receptance",
        "landings": "observables",
        "runs": "landings observables",
        "projection": "pieces",
        "sampling": "",
        "assembly": "projection sampling",
        "observing": "assembly pieces projection sampling",
        "pursuit": "assembly",
        "locating": "assembly pieces",
        "carrying": "phi pieces projection",
        "sampled": "realbasis",
        "compiled": "corners modes numbers receptance sampled",
        "peaks": "events observables",
        "floquet": "collocation compiled modes receptance",
        "static_state": "compiled",
        "starts": "compiled realbasis static_state",
        "multiplier_error": "",
        "hill": "compiled receptance",
        "special": "hill",
        "parity": "multiplier_error special",
        "deciding": "exact floquet multiplier_error parity",
        "meeting": "",
        "events": "meeting multiplier_error observables special",
        "orders": "",
        "sampling_error": "",
        "pinned": "events",
        "balance": "compiled deciding events floquet measuring nearby numbers observables orders pinned realbasis "
        "receptance sampling_error spinning starts",
        "catalogue": "balance orders",
        "fold_curves": "balance",
        "sensitivity": "balance critical observables special speeds",
        "survey": "balance",
        "answers": "balance catalogue dynamic_factor observables speeds",
        "sharing": "answers",
        "critical": "balance fold_curves",
        "jump_map": "balance fold_curves",
        "speeds": "catalogue",
        "telling": "catalogue events landings observables speeds",
        "dynamic_factor": "corners observables",
        "campbell": "balance receptance speeds static_state",
    },
    "timedomain": {
        "__init__": "",
        "segments": "",
        "closing": "segments",
        "excitation": "segments",
        "lawtable": "segments",
        "stepping": "segments",
        "steptables": "segments",
        "exponential": "excitation lawtable segments steptables",
        "runge_kutta": "segments",
        "integrate": "exponential runge_kutta segments",
        "settle": "exponential",
        "shooting": "exponential integrate runge_kutta",
        "opinion": "integrate shooting",
        "sweep": "exponential settle",
        "basins": "exponential settle sweep",
        "landing": "exponential integrate settle",
        "validate": "exponential integrate landing runge_kutta shooting",
    },
    "io": {
        "__init__": "",
        "archive": "",
        "forms": "archive",
        "npz": "archive forms",
        "map_file": "npz",
        "toml_file": "archive",
        "machine_file": "mesh_table toml_file",
        "train_file": "matrices toml_file",
        "columns": "",
        "frames": "columns",
        "table_text": "",
        "table_units": "",
        "table_reader": "table_text table_units",
        "mesh_table": "table_reader table_units",
        "tables": "columns npz",
        "matrix_market": "",
        "matlab_hdf5": "matrix_market",
        "matlab_check": "matrix_market",
        "declared": "",
        "matrices": "archive declared matlab_check matlab_hdf5 matrix_market",
        "bridges": "matrices",
        "receptance_table": "table_reader table_units",
        "receptance_files": "receptance_table",
        "structure_file": "matrices receptance_files toml_file",
    },
    "design": {
        "__init__": "",
        "sampling": "",
        "store": "",
        "workers": "",
        "study": "sampling store workers",
        "study_file": "sampling study",
        "results": "",
        "swept": "study",
        "sobol": "study",
        "measured": "",
        "measured_table": "measured",
        "redesign": "bounds sampling",
        "scatter": "",
        "predicted": "measured swept",
        "bounds": "",
        "intervals": "predicted",
        "fit": "bounds intervals measured predicted",
        "band": "fit measured",
    },
    "plot": {
        "labels": "",
        "style": "",
        "stretches": "style",
        "curves": "stretches style",
        "mesh": "curves style",
        "motions": "style",
        "study": "style",
        "runs": "curves style",
        "simulation": "curves style",
        "rotors": "style",
        "trains": "stretches style",
        "bands": "curves stretches style",
        "effects": "style",
        "fits": "curves style",
        "notebook": "curves",
        "__init__": "runs",
    },
    "web": {
        "page": "",
        "view": "",
        "subject": "",
        "studies": "view",
        "overlay": "view",
        "reporting": "overlay page studies view",
        "explorer": "overlay reporting subject view",
        "server": "explorer page",
        "__init__": "",
    },
    "cli": {
        "__init__": "",
        "complete": "",
        "first": "",
        "support": "complete first",
        "files": "support",
        "shares": "files support",
        "design": "complete files shares support",
        "fit": "complete files shares support",
        "gear": "files support",
        "pages": "files support",
        "study": "files support",
        "time": "files support",
        "rotors": "files support",
        "app": "complete design files fit gear pages rotors study support time",
    },
}

# Libraries that only some rooms or files may import, anywhere in them.
ONLY_IN = {
    "matplotlib": {"plot", "cli.files", "cli.study"},
    "pyfftw": {"mechanics.fourier"},
    "typer": {"cli"},
    "rich": {"cli"},
    "pydantic": {
        "harmonic.catalogue",
        "design.study_file",
        "io.toml_file",
        "io.machine_file",
        "io.train_file",
        "io.structure_file",
    },
    "distributed": {"cli.study"},
    "numba": {"common.compiling", "mechanics.calling"},
    "platformdirs": {"common.compiling"},
    "pint": {"common.units"},
    "markupsafe": {"web.page"},
    "pandas": {"continuation.branch", "io.frames"},
    "xarray": {"continuation.branch", "io.frames"},
}

PATHS = {".".join(path.relative_to(ROOT).with_suffix("").parts): path for path in sorted(ROOT.rglob("*.py"))}
INSIDE = [name for name in PATHS if "." in name]


def source(name: str) -> str:
    return PATHS[name].read_text(encoding="utf-8")


def room_of(name: str) -> str:
    return name.split(".")[0]


def names(node: ast.AST, package: tuple[str, ...]) -> list[str]:
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


def file_of(name: str) -> str:
    """The file of hbgear that a dotted name is found in: "hbgear.plot.curves.response" in "plot.curves"."""
    parts = name.split(".")[1:]
    for k in range(len(parts), 0, -1):
        for file in (".".join(parts[:k]), ".".join([*parts[:k], "__init__"])):
            if file in PATHS:
                return file
    return "__init__"


def asked(nodes: list[ast.AST], package: tuple[str, ...]) -> set[str]:
    """Files of hbgear that import statements ask for."""
    return {file_of(name) for node in nodes for name in names(node, package) if name.split(".")[0] == "hbgear"}


def imported(text: str, package: tuple[str, ...] = ("hbgear",)) -> set[str]:
    """Files of hbgear that a source imports when it is imported."""
    return asked(at_import(ast.parse(text).body), package)


def mentioned(text: str, package: tuple[str, ...] = ("hbgear",)) -> set[str]:
    """Files of hbgear that a source imports anywhere, for type checkers too."""
    return asked(list(ast.walk(ast.parse(text))), package)


@pytest.mark.parametrize("name", INSIDE)
def test_files_import_what_the_table_says(name):
    room, _, stem = name.partition(".")
    assert room in FILES and stem in FILES[room], f"'{name}' is not in the import table; add a line for it"
    package = ("hbgear", *name.split(".")[:-1])
    inside = {file for file in imported(source(name), package) if room_of(file) == room}
    assert inside == {f"{room}.{other}" for other in FILES[room][stem].split()}


@pytest.mark.parametrize("name", INSIDE)
def test_rooms_import_downward(name):
    """In functions and for type checkers too; `cli` alone may import hbgear as a whole, as its users do."""
    room = room_of(name)
    below = {"_version", *ROOMS[: ROOMS.index(room) + 1]} | ({"__init__"} if room == "cli" else set())
    up = {
        file
        for file in mentioned(source(name), ("hbgear", *name.split(".")[:-1]))
        if room_of(file) not in below or (room, room_of(file)) in APART
    }
    assert up == {file for here, file in UPWARD if here == name}


def test_what_goes_upward_does_so_late():
    for name, file in UPWARD:
        assert file not in imported(source(name), ("hbgear", room_of(name)))


def test_tables_have_no_circle_and_no_dead_line():
    assert set(FILES) == set(ROOMS) == {room_of(name) for name in INSIDE}
    for room, files in FILES.items():
        graph = {stem: others.split() for stem, others in files.items()}
        order = list(TopologicalSorter(graph).static_order())  # raises CycleError
        assert set(order) == {name.partition(".")[2] for name in INSIDE if room_of(name) == room}
    assert {room for pair in APART for room in pair} <= set(ROOMS)


@pytest.mark.parametrize("library", ONLY_IN)
def test_library_stays_in_its_places(library):
    users = {
        name
        for name in PATHS
        if any(stem.split(".")[0] == library for node in ast.walk(ast.parse(source(name))) for stem in names(node, ()))
    }
    assert users
    assert not [name for name in users if not {name, room_of(name)} & ONLY_IN[library]]
    assert all(any(place in (name, room_of(name)) for name in users) for place in ONLY_IN[library])


def test_no_name_with_an_underscore_is_imported():
    """What two files share has a public name, and a docstring or a comment says what it is."""
    for name in PATHS:
        for node in ast.walk(ast.parse(source(name))):
            if isinstance(node, ast.ImportFrom) and (node.module or "").split(".")[0] == "hbgear":
                private = [a.name for a in node.names if a.name.startswith("_") and not a.name.endswith("__")]
                assert private in ([], ["_version"]), f"{name} imports {', '.join(private)} from {node.module}"


@pytest.mark.parametrize(
    "text, found",
    [
        ("from hbgear.plot.curves import response", {"plot.curves"}),
        ("import hbgear.plot.curves as p", {"plot.curves"}),
        ("from hbgear import plot, trace", {"plot.__init__", "__init__"}),
        ("from hbgear.plot import curves", {"plot.curves"}),
        ("import hbgear", {"__init__"}),
        ("from hbgear import HarmonicBalance", {"__init__"}),
        ("from . import plot", {"plot.__init__"}),
        ("from .plot.labels import labels_of", {"plot.labels"}),
        ("try:\n    import hbgear.plot\nexcept ImportError:\n    import hbgear.cli", {"plot.__init__", "cli.__init__"}),
        ("class A:\n    from hbgear.io import npz", {"io.npz"}),
        ("if TYPE_CHECKING:\n    from hbgear import plot\nelse:\n    from hbgear import cli", {"cli.__init__"}),
        ("def f():\n    from hbgear import plot", set()),
        ("import numpy\nfrom numpy import fft", set()),
    ],
)
def test_imports_are_seen(text, found):
    assert imported(text) == found


def test_imports_in_functions_are_seen():
    assert mentioned("def f():\n    from hbgear.plot.curves import response\nimport numpy") == {"plot.curves"}
    assert mentioned("if TYPE_CHECKING:\n    from hbgear.io import npz") == {"io.npz"}


@pytest.mark.parametrize("package", ["hbgear", "hbgear.gears", "hbgear.plot", "hbgear.web"])
def test_names_of_a_package_are_found_late(package):
    """Every public name, by a program that has imported nothing else, and by one that imports all of them."""
    code = (
        f"import sys, {package} as room\n"
        "early = len([name for name in sys.modules if name.startswith('hbgear')])\n"
        "values = {name: getattr(room, name) for name in room.__all__}\n"
        "assert set(room.__all__) <= set(dir(room)), set(room.__all__) - set(dir(room))\n"
        "late = len([name for name in sys.modules if name.startswith('hbgear')])\n"
        f"from {package} import *\n"
        "assert all(globals()[name] is value for name, value in values.items())\n"
        "modules = [name for name, value in values.items() if type(value) is type(sys) and name != 'plot']\n"
        "print(early < late, modules)"
    )
    out = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True, cwd=ROOT.parent)
    assert out.stdout.strip() == "True []"


def test_a_name_that_is_not_there_is_said_so():
    with pytest.raises(AttributeError, match="module 'hbgear' has no attribute 'nothing'"):
        hbgear.nothing  # noqa: B018
    assert hbgear.timedomain.__name__ == "hbgear.timedomain"  # a room is found without an import of it


def test_import_of_hbgear_leaves_its_rooms_alone():
    code = "import sys, hbgear; print(sorted(name for name in sys.modules if name.startswith('hbgear.')))"
    out = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True, cwd=ROOT.parent)
    assert out.stdout.strip() == "[]"


def test_import_of_hbgear_leaves_what_is_slow_alone():
    slow = ["matplotlib", "pydantic", "distributed", "dask", "pyfftw", "typer", "rich", "PIL", "numba", "pint"]
    slow += ["pandas", "xarray", "plotly", "jinja2", "markupsafe", "flask"]
    slow += [f"scipy.{part}" for part in ("fft", "integrate", "io", "linalg", "optimize", "signal", "sparse", "stats")]
    code = f"import sys, hbgear; print([name for name in {slow} if name in sys.modules])"
    out = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True, cwd=ROOT.parent)
    assert out.stdout.strip() == "[]"
