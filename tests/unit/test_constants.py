"""Tuned numbers of the package: each has a reason, and a name has one meaning."""

import ast
from pathlib import Path

import pytest

import hbgear

ROOT = Path(hbgear.__file__).parent


def number_of(node):
    """Return the value of an expression of numbers, or None."""
    try:
        value = eval(compile(ast.Expression(node), "constant", "eval"), {"__builtins__": {}})
    except (NameError, TypeError, AttributeError):
        return None
    return value if isinstance(value, int | float) and not isinstance(value, bool) else None


def constants_of(path):
    """Yield name, value and explanation (docstring or comment) of each number at the top level of a module."""
    source = path.read_text(encoding="utf-8")
    lines, body = source.splitlines(), ast.parse(source).body
    for node, following in zip(body, [*body[1:], None], strict=True):
        target = node.targets[0] if isinstance(node, ast.Assign) else getattr(node, "target", None)
        if not isinstance(node, ast.Assign | ast.AnnAssign) or not isinstance(target, ast.Name) or node.value is None:
            continue
        if target.id.strip("_").isupper() and (value := number_of(node.value)) is not None:
            described = isinstance(following, ast.Expr) and isinstance(following.value, ast.Constant)
            commented = "#" in lines[node.lineno - 1] or lines[node.lineno - 2].lstrip().startswith("#")
            yield target.id.strip("_"), value, described or commented


FOUND = [(path, *each) for path in sorted(ROOT.rglob("*.py")) for each in constants_of(path)]


def test_constants_are_found():
    assert len(FOUND) > 300


def test_every_constant_is_explained():
    assert [f"{path.relative_to(ROOT)}: {name}" for path, name, _, explained in FOUND if not explained] == []


@pytest.mark.parametrize("name", sorted({name for _, name, _, _ in FOUND if sum(f[1] == name for f in FOUND) > 1}))
def test_a_name_has_one_value(name):
    """A second module with the same constant may state it again; another value needs another name."""
    values = {str(path.relative_to(ROOT)): value for path, each, value, _ in FOUND if each == name}
    assert len(set(values.values())) == 1, values
