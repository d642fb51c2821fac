"""Kernels that do not count references to arrays do not allocate, receive or return arrays."""

import ast
from pathlib import Path

import pytest

import hbgear as hb
from hbgear.common.process.compiling import uncounted

ALLOCATIONS = {"empty", "zeros", "ones", "full", "array", "append", "copy", "ascontiguousarray"}
KINDS = ("kernel", "uncounted", "inlined")


def kernels():
    """Return the kind, the node and the names of every kernel."""
    found = {}
    for path in Path(hb.__file__).parent.rglob("*.py"):
        for node in ast.parse(path.read_text(encoding="utf-8")).body:
            kinds = [d.id for d in getattr(node, "decorator_list", []) if isinstance(d, ast.Name) and d.id in KINDS]
            if kinds:
                names = {x.attr if isinstance(x, ast.Attribute) else getattr(x, "id", "") for x in ast.walk(node)}
                found[node.name] = kinds[0], node, names
    return found


def test_uncounted_kernels_use_arrays_of_their_callers_only():
    found = kernels()

    def allocates(name):
        _, _, names = found[name]
        called = [other for other in names & found.keys() if other != name]
        inlined = [other for other in called if found[other][0] == "inlined"]
        arrays = [other for other in called if "Any" in ast.unparse(found[other][1].returns)]
        return bool(names & ALLOCATIONS or arrays or any(map(allocates, inlined)))

    chosen = [name for name, (kind, _, _) in found.items() if kind == "uncounted"]
    assert len(chosen) > 100 and [name for name in chosen if allocates(name)] == []


def test_results_that_are_arrays_need_references():
    def row(A: list[float]) -> "Any":  # noqa: F821
        return A[0]

    with pytest.raises(TypeError, match="row returns Any, so it must count references"):
        uncounted(row)
