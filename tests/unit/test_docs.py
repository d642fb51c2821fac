"""Consistency of docs/ with the code: named files exist, the picture of the packages is current, examples run.

`test_readme` runs the code blocks of the pages.
"""

import ast
import importlib.util
import re
import subprocess
import sys
from pathlib import Path
from urllib.parse import unquote

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


@pytest.mark.slow
def test_picture_of_the_packages_agrees_with_the_code():
    packages = module_of(ROOT / "docs" / "packages.py")
    assert packages.upward() == []
    picture = (ROOT / "docs" / "packages.svg").read_text(encoding="utf-8")
    assert packages.picture() == picture, "run python docs/packages.py"
    folders = {path.parent.name for path in (ROOT / "hbgear").glob("*/__init__.py")}
    assert folders == set(packages.PACKAGES)


def test_files_that_a_page_names_exist():
    missing, count = [], 0
    for page in [*paths(), ROOT / "CONTRIBUTING.md"]:
        text = page.read_text(encoding="utf-8")
        for name in re.findall(r"`((?:\w+/)+\w+\.(?:py|md))`", text) + re.findall(r"\]\((?!\w+:)([^)#\s]+)", text):
            count += 1
            if not any(place.exists() for place in (ROOT / name, ROOT / "hbgear" / name, page.parent / name)):
                missing.append(f"{page.name} names {name}")
    assert missing == [] and count > 100


def defined_in(path: Path) -> set[str]:
    """Return the names that a module defines at its top level."""
    names = set()
    for node in ast.parse(path.read_text(encoding="utf-8")).body:
        targets = getattr(node, "targets", [getattr(node, "target", None)])
        names |= {getattr(node, "name", ""), *(getattr(target, "id", "") for target in targets)}
    return names


def test_table_how_to_add_names_existing_files():
    text = (
        (ROOT / "docs" / "extending.md").read_text(encoding="utf-8").partition("## How to add")[2].partition("\n## ")[0]
    )
    rows = [line.strip("| ").split(" | ") for line in text.splitlines() if line.startswith("| ")][1:]
    added = {row[0] for row in rows}
    kinds = ("law", "model", "gear model", "event", "measure", "command", "study")
    assert all(any(kind in one for one in added) for kind in kinds)
    for row in rows:
        words = re.findall(r"`([^`]+)`", " ".join(row[1:]))
        files = [ROOT / word for word in words if "/" in word]
        assert files and all(path.exists() for path in files), row[0]
        defined = set().union(*(defined_in(path) for path in files if path.suffix == ".py"))
        names = [word for word in re.findall(r"`([^`]+)`", " ".join(row[2:])) if "/" not in word]
        assert set(names) <= defined, f"{row[0]}: {set(names) - defined}"


@pytest.mark.parametrize("page", ["README.md", "docs/architecture.md"])
def test_names_of_the_steps_of_a_period_doubling_exist(page):
    """The page also names the detection (`EventDetector`) and the location (`PeriodDoublingEvent.locate`)."""
    text = (ROOT / page).read_text(encoding="utf-8")
    modules = "\n".join(path.read_text(encoding="utf-8") for path in (ROOT / "hbgear").rglob("*.py"))
    named = set(re.findall(r"`(?!True|None)([A-Z]\w+)(?:\.(\w+))?`", text)) | {
        (name, "") for name in re.findall(r"`([a-z]+_[a-z_]+)`", text)
    }
    defined, words = set(re.findall(r"(?:\b(?:class|def) |^)(\w+)", modules, re.M)), set(re.findall(r"\w+", modules))
    assert {name for name, _ in named} - defined == set()
    assert {method for _, method in named if method} - words == set()
    assert ("PeriodDoublingEvent", "locate") in named and ("EventDetector", "") in named | {(a, "") for a, _ in named}


_DOI = r"10\.\d{4,9}/[\w.()%/-]*[\w)]"
_MADE = {"_site", "api", "gallery", "studies", "tutorials", "sg_execution_times.rst", "commands.md", "constants.md"}
"""Files and folders in docs that building the site generates."""
_SOURCES = [
    path
    for place in ("*", "docs/**/*", "examples/**/*", "hbgear/**/*", "studies/**/*")
    for path in ROOT.glob(place)
    if path.suffix in (".cff", ".md", ".py", ".rst", ".toml")
    and path.is_file()
    and not _MADE.intersection(path.relative_to(ROOT).parts[1:2])
    and "/." not in str(path.relative_to(ROOT))
]


def badly_cited(text: str) -> list[str]:
    """Return the lines with a DOI that is not a link of the form https://doi.org/10.1115/1.1539868.

    In Markdown the link text must be "doi" and the DOI of the address.
    """
    for doi, address in re.findall(rf"\[doi ({_DOI})\]\(https://doi\.org/({_DOI})\)(?!\))", text):
        if doi == unquote(address) and doi.count("(") == doi.count(")"):
            text = text.replace(f"[doi {doi}](https://doi.org/{address})", "")
    links = re.findall(rf"(?<![\[(])https://doi\.org/({_DOI})", text)
    for link in sorted((link for link in links if link.count("(") == link.count(")")), key=len, reverse=True):
        text = text.replace(f"https://doi.org/{link}", "")
    left = re.compile(r"doi\.org|\bdoi\b[ :]|\b10\.\d{4,9}/\w", re.IGNORECASE)
    return [line for line in text.splitlines() if left.search(line)]


def test_sources_are_cited_in_one_form():
    texts = {path: path.read_text(encoding="utf-8") for path in _SOURCES}
    assert sum(text.count("https://doi.org/10.") for text in texts.values()) > 50
    assert {str(path): bad for path, text in texts.items() if (bad := badly_cited(text))} == {}


@pytest.mark.parametrize(
    ("text", "good"),
    [
        ("Cameron (1989), https://doi.org/10.1115/1.3176036.", True),
        ("Moser, https://doi.org/10.1016/0022-247X(74)90112-X", True),
        ("[doi 10.1115/1.3176036](https://doi.org/10.1115/1.3176036): sampled.", True),
        ("[doi 10.1016/0022-247X(74)90112-X](https://doi.org/10.1016/0022-247X%2874%2990112-X)", True),
        ("[doi 10.1115/1.3176036](https://doi.org/10.1115/1.3176037)", False),
        ("Cameron (1989), doi 10.1115/1.3176036", False),
        ("Cameron (1989), doi:10.1115/1.3176036", False),
        ("http://doi.org/10.1115/1.3176036", False),
        ("https://dx.doi.org/10.1115/1.3176036", False),
        ("https://doi.org/1115/1.3176036", False),
        ("https://doi.org/10.1016/0022-247X(74", False),
    ],
)
def test_invalid_citations_are_found(text, good):
    assert (badly_cited(text) == []) is good


def test_version_is_in_the_changelog_and_the_citation():
    assert f"## [{hb.__version__}]" in (ROOT / "CHANGELOG.md").read_text(encoding="utf-8")
    assert f"version: {hb.__version__}\n" in (ROOT / "CITATION.cff").read_text(encoding="utf-8")


@pytest.mark.slow
@pytest.mark.parametrize("name", ["first_jump", "own_machine", "own_event"])
def test_example_runs(name):
    done = subprocess.run(
        [sys.executable, str(ROOT / "examples" / f"{name}.py"), "--quick"],
        cwd=ROOT,
        capture_output=True,
        text=True,
        timeout=120,
    )
    assert done.returncode == 0, done.stderr
    expected = re.search(
        r"^Prints:\n\n((?:    .*\n)+)",
        ast.get_docstring(ast.parse((ROOT / "examples" / f"{name}.py").read_text(encoding="utf-8"))) + "\n",
        re.M,
    )
    assert expected, "the docstring of an example must end with its output"
    assert done.stdout.split() == expected[1].split()
