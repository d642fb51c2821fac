"""What is written and checked when the site is built, as far as that needs no Sphinx: .ci/run builds all of it."""

import ast
import inspect
import sys
from itertools import pairwise

import pytest
from pages import REPOSITORY

import hbgear as hb
from hbgear import plot

SITE = REPOSITORY / "docs" / "_site"


@pytest.fixture
def site(monkeypatch):
    """Modules of the site by their names."""
    monkeypatch.syspath_prepend(SITE)
    for name in ("docstrings", "whole", "written"):
        monkeypatch.delitem(sys.modules, name, raising=False)
    return __import__


GOOD = '<h1 id="one">1</h1><a href="b.html#two">2</a><a href="#one">1</a><img src="p.png"><a href="https://doi.org/1">3</a>'


def test_a_whole_site_has_no_faults(site, tmp_path):
    (tmp_path / "a.html").write_text(GOOD)
    (tmp_path / "b.html").write_text('<p id="two"></p><a href="a.html">back</a>')
    (tmp_path / "p.png").write_bytes(b"")
    assert site("whole").faults(tmp_path) == []


@pytest.mark.parametrize(
    ("fault", "message"),
    [
        ('<a href="c.html">', "a.html links to c.html, which is not there"),
        ('<a href="b.html#three">', "a.html links to b.html#three, which has no such place"),
        ('<a href="#nowhere">', "a.html links to #nowhere, which has no such place"),
        ('<img src="q.png">', "a.html links to q.png, which is not there"),
        ('<script src="https://cdn.example/x.js"></script>', "a.html loads https://cdn.example/x.js"),
        ('<link href="//fonts.example/x.css">', "a.html loads //fonts.example/x.css"),
    ],
)
def test_faults_of_a_site_are_reported(site, tmp_path, fault, message):
    (tmp_path / "a.html").write_text(GOOD + fault)
    (tmp_path / "b.html").write_text('<p id="two"></p>')
    (tmp_path / "p.png").write_bytes(b"")
    assert site("whole").faults(tmp_path) == [message]


def test_every_constant_of_the_figures_is_described(site):
    """Constants of sub-packages of hbgear.plot, too."""
    constants = [name for name in plot.__all__ if name.isupper()]
    assert "PERCENTILES" in constants and [name for name in constants if not site("written").described(name)] == []


def test_docstrings_are_converted_for_sphinx(site):
    text = """Return the root of |x|, and c_ of `Wheel`s.

        x = |y|^2

    Parameters
    ----------
    tolerance : float, optional
        Largest |R| of ``a|b``.

    Examples
    --------
    >>> 1 | 2
    3"""
    done = site("docstrings").rewritten(inspect.cleandoc(text).splitlines())
    assert done[0] == r"Return the root of \|x\|, and c\_ of `Wheel`\ s."
    assert done[done.index(".. code-block:: text") + 2] == "    x = |y|^2"
    heading = done.index("Parameters")
    assert done[heading + 2 : heading + 4] == ["tolerance : float, optional", r"    Largest \|R\| of ``a|b``."]
    assert done[-2:] == [">>> 1 | 2", "3"]


@pytest.mark.parametrize(
    ("depth", "text", "turned"),
    [
        (0, "[a](../studies/README.md)", "[a](studies/index.md)"),
        (1, "[a](../../studies/speed/figures/peers.md)", "[a](../studies/speed/figures/peers.md)"),
        (0, "[a](scripts/tutorials/01_first_jump.py)", "[a](tutorials/01_first_jump.rst)"),
        (1, "[a](../scripts/tutorials/README.rst)", "[a](../tutorials/index.rst)"),
        (1, "[a](../labels.md)", "[a](../labels.md)"),
    ],
)
def test_links_are_turned_to_where_the_site_has_the_file(site, depth, text, turned):
    assert site("written").turned(text, depth) == turned


@pytest.mark.slow
def test_every_public_name_has_an_entry(site, tmp_path, monkeypatch):
    written = site("written")
    monkeypatch.setattr(written, "DOCS", tmp_path)
    written.api_pages()
    text = "".join(path.read_text() for path in (tmp_path / "api").glob("*.rst"))
    lines = set(text.splitlines())
    modules = {name for name in hb.__all__ if inspect.ismodule(getattr(hb, name))}
    assert all((tmp_path / "api" / f"{name}.rst").exists() for name in modules)
    for name in set(hb.__all__) - modules - {"__version__"}:
        assert {f".. auto{kind}:: hbgear.{name}" for kind in ("class", "function", "data")} & lines, name
    for name in plot.__all__:
        assert {f".. auto{kind}:: hbgear.plot.{name}" for kind in ("class", "function")} & lines or (
            f".. py:data:: {name}" in lines
        ), name
    assert ".. autoclass:: hbgear.time.validation.report.Report" in lines, "a class that a public function returns"
    alias = (tmp_path / "api" / "hbgear.continuation.ProgressCallback.rst").read_text()
    assert "Type of ``progress=``" in alias, "an alias has its description"
    for page in (tmp_path / "api").glob("*.rst"):
        entries = [line for line in page.read_text().splitlines() if line.startswith(".. auto")]
        assert len(entries) <= 1, "one page for each object"


@pytest.mark.parametrize("members", [hb.Status, hb.time.Verdict])
def test_members_of_enumerations_are_described(members):
    """A page of the reference lists members with a docstring only."""
    body = ast.parse(inspect.getsource(members)).body[0].body
    described = [
        node.targets[0].id for node, below in pairwise(body) if (type(node), type(below)) == (ast.Assign, ast.Expr)
    ]
    assert described == [member.name for member in members]


def test_tutorials_are_in_their_order():
    """The site sorts scripts by the names of their files; the index says that they are read in this order."""
    names = sorted(path.name for path in (SITE.parent / "scripts" / "tutorials").glob("*.py"))
    assert [int(name.partition("_")[0]) for name in names] == list(range(1, len(names) + 1))


def test_every_command_has_its_options(site, tmp_path, monkeypatch):
    written = site("written")
    monkeypatch.setattr(written, "DOCS", tmp_path)
    written.command_page()
    text = (tmp_path / "commands.md").read_text()
    assert text.count("## hbgear ") >= 16
    trace = text.partition("## hbgear trace\n")[2].partition("## ")[0]
    assert all(f"`{option}`" in trace for option in ("MODEL", "--harmonics", "--stability, --no-stability"))


@pytest.mark.slow
def test_the_page_of_constants_lists_each_with_its_reason(site, tmp_path, monkeypatch):
    written = site("written")
    monkeypatch.setattr(written, "DOCS", tmp_path)
    written.constant_page()
    rows = [line for line in (tmp_path / "constants.md").read_text().splitlines() if line.startswith("| `")]
    assert len(rows) > 300 and all(row.split(" | ")[-1].strip(" |") for row in rows)
    assert "| `REFERENCE_SIZE` | 700 | Number of unknowns of a solution that counts as 1. |" in rows
