"""Every public name has a docstring with an example that runs; all public objects of modules have docstrings."""

import doctest
import importlib
import inspect
import operator
import pkgutil
import re

import pytest

import hbgear as hb
from hbgear.plot import curves
from hbgear.plot.designs import bands, effects, fits, study
from hbgear.plot.machines import mesh, rotors, trains
from hbgear.plot.simulations import simulation

SPACES = ("analysis", "continuation", "design", "gears", "harmonic", "io", "mechanics", "time")
PUBLIC = {f"hb.{name}": getattr(hb, name) for name in hb.__all__} | {
    f"hb.{space}.{name}": getattr(getattr(hb, space), name)
    for space in SPACES
    for name in getattr(hb, space).__all__
    if name not in hb.__all__
}
NAMES = sorted(name for name, thing in PUBLIC.items() if isinstance(thing, type) or inspect.isroutine(thing))
FIGURES = {
    "bands": bands,
    "curves": curves,
    "effects": effects,
    "fits": fits,
    "mesh": mesh,
    "rotors": rotors,
    "simulation": simulation,
    "study": study,
    "trains": trains,
}
DRAWN = sorted(
    f"{module.__name__.rpartition('.')[2]}.{name}"
    for module in FIGURES.values()
    for name, value in vars(module).items()
    if inspect.isfunction(value) and value.__module__ == module.__name__ and not name.startswith("_")
)


def example_of(name: str, thing: object) -> doctest.DocTest | None:
    """Return the example of a docstring if it has one in a section Examples."""
    text = inspect.getdoc(thing) or ""
    found = doctest.DocTestParser().get_doctest(text, {"__name__": "example"}, name, None, 0)
    return found if found.examples and "Examples\n--------" in text else None


def run(name: str, thing: object) -> None:
    found = example_of(name, thing)
    assert found, f"the docstring of {name} needs an example, in a section Examples"
    said: list[str] = []
    doctest.DocTestRunner(optionflags=doctest.ELLIPSIS | doctest.NORMALIZE_WHITESPACE).run(found, out=said.append)
    assert not said, "".join(said)


@pytest.mark.parametrize("name", NAMES)
def test_example_of_a_public_name(name):
    run(name, PUBLIC[name])


@pytest.mark.parametrize("name", DRAWN)
def test_example_of_a_figure(name):
    import matplotlib.pyplot as plt

    module, _, function = name.partition(".")
    before = plt.get_backend()
    plt.switch_backend("Agg")
    try:
        run(f"hb.plot.{name}", getattr(FIGURES[module], function))
    finally:
        plt.close("all")
        plt.switch_backend(before)


def test_public_names_that_are_no_functions_or_classes():
    assert PUBLIC.keys() - set(NAMES) == {
        "hb.__version__",
        "hb.plot",
        "hb.continuation.ProgressCallback",
        *(f"hb.{space}" for space in SPACES),
    }


def test_a_first_script_needs_few_names():
    assert len([name for name in hb.__all__ if name not in SPACES]) <= 33


def test_names_of_version_0_2_are_deprecated():
    for old, new in hb._DEPRECATED.items():
        with pytest.warns(DeprecationWarning, match=f"hbgear.{old} is deprecated: use hbgear.{new}$"):
            assert getattr(hb, old) is PUBLIC[f"hb.{new}"]
    assert inspect.getdoc(hb.plot)


@pytest.mark.parametrize("text", ["", "Nothing to see.", "Examples\n--------\nNone yet.", ">>> 1 + 1\n2"])
def test_a_docstring_without_an_example_is_seen(text):
    def undocumented() -> None: ...

    undocumented.__doc__ = text
    with pytest.raises(AssertionError, match="needs an example"):
        run("undocumented", undocumented)


def test_an_example_that_is_wrong_is_seen():
    def wrong() -> None: ...

    wrong.__doc__ = "Examples\n--------\n>>> 1 + 1\n3\n"
    with pytest.raises(AssertionError, match=r"Expected:\s+3\s+Got:\s+2"):
        run("wrong", wrong)


MODULES = [info.name for info in pkgutil.walk_packages(hb.__path__, "hbgear.") if not info.name.endswith("__main__")]


def without_docstring(module: str) -> list[str]:
    """Return the public objects of a module without a docstring; overriding methods inherit docstrings."""
    found = importlib.import_module(module)
    bare = [] if found.__doc__ else [module]
    for name, thing in vars(found).items():
        if name.startswith("_") or getattr(thing, "__module__", None) != module:
            continue
        if inspect.isfunction(thing) or inspect.isclass(thing):
            bare += [] if inspect.getdoc(thing) else [f"{module}.{name}"]
        if inspect.isclass(thing):
            bare += [
                f"{module}.{name}.{part}"
                for part, method in vars(thing).items()
                if not part.startswith("_")
                and (inspect.isfunction(method) or isinstance(method, property | classmethod | staticmethod))
                and not inspect.getdoc(getattr(thing, part))
            ]
    return bare


def test_public_objects_have_docstrings():
    assert [name for module in MODULES for name in without_docstring(module)] == []


@pytest.mark.parametrize("path", ["harmonic.register_measure", "mechanics.register_law", "mechanics.model"])
def test_both_forms_of_a_decorator_have_an_example(path):
    """The overloads have no text of their own: the docstring shows the form with options and the one without."""
    text = operator.attrgetter(path)(hb).__doc__
    name = path.partition(".")[2]
    assert re.search(rf"@hb\.{path}$", text, re.M) and f"@hb.{path}(" in text
    assert all(form in text for form in (f"``@{name}``", f"``@{name}(", f"``{name}("))
