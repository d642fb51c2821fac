"""Domain of Python objects whose members are not entries of the search: they are on the pages of their classes."""

from __future__ import annotations

from typing import TYPE_CHECKING

from sphinx.domains.python import PythonDomain

if TYPE_CHECKING:
    from collections.abc import Iterator

    from sphinx.application import Sphinx


class Python(PythonDomain):
    """Python objects, of which the search finds functions and classes; members are on the pages of their classes."""

    def get_objects(self) -> Iterator[tuple[str, str, str, str, str, int]]:
        """Return all objects, members with the priority of objects that the search leaves out."""
        for name, shown, kind, document, anchor, priority in super().get_objects():
            member = kind in ("method", "attribute", "property")
            yield name, shown, kind, document, anchor, -1 if member else priority


def setup(app: Sphinx) -> dict[str, bool]:
    """Register the extension."""
    app.add_domain(Python, override=True)
    return {"parallel_read_safe": True}
