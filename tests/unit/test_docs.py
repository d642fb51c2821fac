"""The pages of docs/ say what is so: the files they name exist, their picture is that of the code; examples run.

Their blocks are run by `test_readme`.
"""

import ast
import importlib.util
import re
import subprocess
import sys
from pathlib import Path

import pytest
from pages import paths

import hbgear as hb

ROOT = Path(__file__).parents[2]


def module_of(path: Path):
    spec = importlib.util.spec_from_file_location(path.stem, path)
    assert spec and spec.loader
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_picture_of_the_rooms_is_that_of_the_code():
    rooms = module_of(ROOT / "docs" / "rooms.py")
    assert rooms.upward() == []
    assert rooms.picture() == (ROOT / "docs" / "rooms.svg").read_text(encoding="utf-8"), "run python docs/rooms.py"
    folders = {path.parent.name for path in (ROOT / "hbgear").glob("*/__init__.py")}
    assert folders == set(rooms.ROOMS)


@pytest.mark.parametrize("page", [*paths(), ROOT / "CONTRIBUTING.md"], ids=lambda page: str(page.relative_to(ROOT)))
def test_files_that_a_page_names_exist(page):
    text = page.read_text(encoding="utf-8")
    for name in re.findall(r"`((?:\w+/)+\w+\.(?:py|md))`", text) + re.findall(r"\]\((?!\w+:)([^)#\s]+)", text):
        places = (ROOT / name, ROOT / "hbgear" / name, page.parent / name)
        assert any(place.exists() for place in places), f"{page.name} names {name}"


def test_version_is_in_the_changelog_and_the_citation():
    assert f"## [{hb.__version__}]" in (ROOT / "CHANGELOG.md").read_text(encoding="utf-8")
    assert f"version: {hb.__version__}\n" in (ROOT / "CITATION.cff").read_text(encoding="utf-8")


@pytest.mark.parametrize("name", ["first_jump", "own_machine", "own_event"])
def test_example_runs(name):
    done = subprocess.run(
        [sys.executable, str(ROOT / "examples" / f"{name}.py"), "--quick"],
        cwd=ROOT, capture_output=True, text=True, timeout=120,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    expected = re.search(r"^Prints:\n\n((?:    .*\n)+)", ast.get_docstring(ast.parse(
        (ROOT / "examples" / f"{name}.py").read_text(encoding="utf-8"))) + "\n", re.M)  # fmt: skip
    assert expected, "the docstring of an example ends with what it prints"
    assert done.stdout.split() == expected[1].split()
