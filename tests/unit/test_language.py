"""Docstrings, comments, messages and pages use terms of the field instead of banned words."""

import io
import re
import tokenize
from pathlib import Path

import pytest
from pages import paths

ROOT = Path(__file__).parents[2]
BANNED = re.compile(
    r"\b(?:told|tells?|telling|beside|anew|hardly|whatever|nor|so many|is (?-i:none)|such a number)\b", re.IGNORECASE
)
PAGES = [*paths(), *(ROOT / "docs" / "scripts").rglob("*.rst"), ROOT / "CONTRIBUTING.md", ROOT / "CHANGELOG.md"]
FOLDERS = [
    "docs/scripts",
    "docs/_site",
    "examples",
    "studies",
    "tests",
    *sorted(f"hbgear/{path.parent.name}" for path in (ROOT / "hbgear").glob("*/__init__.py")),
]


def prose_of(path: Path) -> str:
    """Return the strings and comments of a module or the text of a page; of the changelog what has no date."""
    text = path.read_text(encoding="utf-8")
    if path.suffix == ".py":
        tokens = tokenize.generate_tokens(io.StringIO(text).readline)
        kinds = {tokenize.COMMENT, tokenize.STRING, getattr(tokenize, "FSTRING_MIDDLE", tokenize.STRING)}
        return "\n".join(token.string for token in tokens if token.type in kinds)
    return re.split(r"\n## \[.*\] - \d", text)[0] if path.name == "CHANGELOG.md" else text


def banned_in(files: list[Path]) -> dict[str, list[str]]:
    """Return the lines with banned words, by file."""
    lines = {str(path.relative_to(ROOT)): prose_of(path).splitlines() for path in files}
    found = {name: [line.strip() for line in some if BANNED.search(line)] for name, some in lines.items()}
    return {name: some for name, some in found.items() if some}


def test_pages_use_plain_technical_words():
    assert banned_in(PAGES) == {}


@pytest.mark.parametrize("folder", FOLDERS)
def test_modules_use_plain_technical_words(folder):
    assert banned_in(sorted(set((ROOT / folder).rglob("*.py")) - {Path(__file__)})) == {}


def test_banned_words_are_found():
    assert BANNED.search("which the message tells") and BANNED.search("Hardly ever")
    assert not BANNED.search("a northern tale of intelligence")
