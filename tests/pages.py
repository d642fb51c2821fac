"""README and pages of the site as tests read them: their blocks, what stands in their comments, and how they run.

In Python what follows "->" in a comment is what the statement gives or prints: numbers to the digits written, "..." for
anything. A block behind "In a file `NAME`:" is that file, there when the other blocks of its page run.
"""

import ast
import contextlib
import io
import re
import shlex
import tokenize
from dataclasses import dataclass
from pathlib import Path

import numpy as np

REPOSITORY = Path(__file__).parents[1]
WRITTEN = ("api", "commands.md", "gallery", "studies", "tutorials", "_site", "scripts")
"""What of docs/ is written when the site is built, or is no page."""
NUMBER = r"(?<![\w.])[-+]?\d+\.?\d*(?:e[-+]?\d+)?"


@dataclass(frozen=True)
class Block:
    """A block of code of a page; ``file`` is its name if it is one."""

    page: str
    number: int
    language: str
    text: str
    file: str

    def __str__(self) -> str:
        """As tests are named."""
        return f"{self.page}-{self.number}"


def paths():
    """README and the pages of the site, without those that are written when it is built."""
    docs = REPOSITORY / "docs"
    pages = [path for path in sorted(docs.rglob("*.md")) if path.relative_to(docs).parts[0] not in WRITTEN]
    return [REPOSITORY / "README.md", *pages]


TEXTS = {str(path.relative_to(REPOSITORY)): path.read_text(encoding="utf-8") for path in paths()}
"""By their paths."""


def blocks_of(page):
    """All blocks of a page, in their order."""
    found = re.finditer(r"(?:In a file\s+`([\w.]+)`:\n\n)?^```(\w+)\n(.*?)^```$", TEXTS[page], re.DOTALL | re.MULTILINE)
    return [Block(page, i, m[2], m[3], m[1] or "") for i, m in enumerate(found, 1)]


BLOCKS = [block for page in TEXTS for block in blocks_of(page)]


def blocks(language):
    """Blocks of all pages in a language."""
    return [block for block in BLOCKS if block.language == language]


def write_files(page, folder, change=lambda text: text):
    """Write the files that a page shows."""
    for block in blocks_of(page):
        if block.file:
            (folder / block.file).write_text(change(block.text), encoding="utf-8")


# ---- Python


def statements(body):
    """Statements at the top, and those of ``if __name__ == "__main__"``."""
    for node in body:
        yield from statements(node.body) if isinstance(node, ast.If) else [node]


def said(text):
    """``(statement, its comments)`` of a block; comments on lines of their own belong to the statement before."""
    nodes = list(statements(ast.parse(text).body))
    comments = [t for t in tokenize.generate_tokens(io.StringIO(text).readline) if t.type == tokenize.COMMENT]
    after = [*(node.lineno for node in nodes[1:]), len(text.splitlines()) + 1]
    return [
        (node, [t.string for t in comments if node.lineno <= t.start[0] < end])
        for node, end in zip(nodes, after, strict=True)
    ]


def outcome(node, names):
    """What an expression is worth, or what another statement prints."""
    out = io.StringIO()
    with contextlib.redirect_stdout(out):
        if isinstance(node, ast.Expr):
            value = eval(compile(ast.Expression(node.value), "page", "eval"), names)
        else:
            exec(compile(ast.Module([node], []), "page", "exec"), names)
            value = None
    if value is None:
        return out.getvalue().strip()
    return str(value) if isinstance(value, np.ndarray) else re.sub(r"np\.\w+\(([^()]*)\)", r"\1", repr(value))


def agrees(text, got):
    """Whether a result is what the text says: numbers to its digits, "..." for anything."""
    places = re.findall(NUMBER, text)
    pattern = re.escape(re.sub(NUMBER, "\0", text)).replace("\0", f"({NUMBER})").replace(r"\.\.\.", ".*?")
    match = re.fullmatch(re.sub(r"(\\[ \n])+", r"\\s+", pattern), got, re.DOTALL)
    return match is not None and all(
        abs(float(place) - float(number)) <= 0.51 * last_digit(place)
        for place, number in zip(places, match.groups(), strict=True)
    )


def last_digit(number):
    """What one in the last digit of a number as written is worth."""
    digits, _, power = number.partition("e")
    return 10.0 ** (int(power or 0) - len(digits.partition(".")[2]))


def run_python(text):
    """Run a block, each statement held against what its comments say of it."""
    names = {"__name__": "__main__"}
    for node, comments in said(text):
        got = outcome(node, names)
        results = [comment.partition("-> ")[2] for comment in comments if "->" in comment]
        if results:
            assert agrees("\n".join(results), got), f"line {node.lineno}: {' '.join(results)} is {got}"


# ---- commands


def commands(text):
    """Arguments of each ``hbgear`` of a block, without comments."""
    lines = [shlex.split(line, comments=True) for line in text.splitlines()]
    return [words[1:] for words in lines if words and words[0] == "hbgear"]


# ---- text


def table_after(text, heading):
    """Rows of cells of the first table after a text."""
    lines = text[text.index(heading) :].splitlines()
    rows = [line.strip().strip("|").split("|") for line in lines if line.strip().startswith("|")]
    return [[cell.strip() for cell in row] for row in rows]


def stated(pattern):
    """The numbers of a sentence of one of the pages, however its lines are broken."""
    for text in TEXTS.values():
        match = re.search(pattern, " ".join(text.split()))
        if match:
            return [float(number) for number in match.groups()]
    raise AssertionError(f"no page has a sentence like {pattern}")
