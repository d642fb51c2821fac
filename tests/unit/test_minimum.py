"""The minimum versions that .ci/minimum installs are those that pyproject.toml states."""

import runpy
import tomllib
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

import pytest
from packaging.requirements import Requirement
from packaging.version import Version

ROOT = Path(__file__).parents[2]
PYPROJECT = ROOT / "pyproject.toml"


@pytest.fixture
def pins():
    return runpy.run_path(str(ROOT / ".ci" / "pins.py"))["pins"]


def test_pins_are_the_minimum_versions_of_the_package(pins):
    project = tomllib.loads(PYPROJECT.read_text())["project"]
    lists = [project["dependencies"], *project["optional-dependencies"].values()]
    stated = {(r.name, s.operator, s.version) for part in lists for r in map(Requirement, part) for s in r.specifier}
    stated = {each for each in stated if each[1] != "<"}
    pinned = [line.split("==") for line in pins(PYPROJECT.read_text())]
    assert sorted((name, ">=", lowest) for name, lowest in pinned) == sorted(stated)
    assert {"numpy", "scipy", "typer", "distributed", "pytest"} < {name for name, _ in pinned}


def test_installed_versions_are_not_below(pins):
    """Packages of the site and of mutation testing are not installed where the tests run."""
    extras = tomllib.loads(PYPROJECT.read_text())["project"]["optional-dependencies"]
    for line in pins(PYPROJECT.read_text()):
        name, lowest = line.split("==")
        try:
            assert Version(version(name)) >= Version(lowest)
        except PackageNotFoundError:
            assert line.replace("==", ">=") in [*extras["docs"], *extras["mutation"], *extras["lint"]]


@pytest.mark.parametrize(
    ("changed", "message"),
    [
        ('"scipy"', '"scipy" must be written "name>=version"'),
        ('"scipy>=1.12,!=1.13"', "must be written"),
        ('"scipy>=1.12", "numpy>=1.25"', "numpy has two minimum versions, 1.26 and 1.25"),
    ],
)
def test_a_minimum_that_is_not_stated_is_refused(pins, changed, message):
    text = PYPROJECT.read_text()
    line = next(line for line in text.splitlines() if '"scipy>=' in line)
    with pytest.raises(ValueError, match=message):
        pins(text.replace(line.strip(" ,"), changed))
