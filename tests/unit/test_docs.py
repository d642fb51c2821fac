"""The pages of docs/ say what is so: their blocks run, their picture is that of the code; examples run."""

import ast
import importlib.util
import re
import subprocess
import sys
from pathlib import Path

import pytest

import hbgear as hb

ROOT = Path(__file__).parents[2]
PAGES = sorted((ROOT / "docs").glob("*.md"))
BLOCKS = [
    pytest.param(block, id=f"{page.stem}-{number}")
    for page in PAGES
    for number, block in enumerate(re.findall(r"```python\n(.*?)```", page.read_text(encoding="utf-8"), re.S), 1)
]


def module_of(path: Path):
    spec = importlib.util.spec_from_file_location(path.stem, path)
    assert spec and spec.loader
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.mark.parametrize("block", BLOCKS)
def test_block_of_a_page_runs(block):
    assert any(isinstance(node, ast.Assert) or "assert" in ast.unparse(node) for node in ast.parse(block).body)
    exec(compile(block, "docs", "exec"), {"__name__": "docs"})


def test_picture_of_the_rooms_is_that_of_the_code():
    rooms = module_of(ROOT / "docs" / "rooms.py")
    assert rooms.upward() == []
    assert rooms.picture() == (ROOT / "docs" / "rooms.svg").read_text(encoding="utf-8"), "run python docs/rooms.py"
    folders = {path.parent.name for path in (ROOT / "hbgear").glob("*/__init__.py")}
    assert folders == set(rooms.ROOMS)


@pytest.mark.parametrize("page", [*PAGES, ROOT / "CONTRIBUTING.md"], ids=lambda page: page.name)
def test_files_that_a_page_names_exist(page):
    text = page.read_text(encoding="utf-8")
    for name in re.findall(r"`((?:\w+/)+\w+\.(?:py|md))`", text) + re.findall(r"\]\(([\w/.]+)\)", text):
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
