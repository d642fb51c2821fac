"""The picture of the packages in docs/architecture.md, drawn from the imports as they are.

    python docs/rooms.py        writes docs/rooms.svg, the same bytes every time

A row is a package, in the order in which imports run down; a dot in a column is an import of that package. A dot right
of the diagonal is an upward import: the script then ends with exit code 1.
"""

from __future__ import annotations

import ast
import sys
from pathlib import Path

HERE = Path(__file__).parent
PACKAGE = HERE.parent / "hbgear"
ROOMS = (
    "common",
    "continuation",
    "mechanics",
    "gears",
    "harmonic",
    "analysis",
    "time",
    "io",
    "design",
    "plot",
    "web",
    "cli",
)
"""From the ground up."""

CELL, LEFT, TOP = 34, 110, 96


def at_import(body: list[ast.stmt]) -> list[ast.stmt]:
    """Statements that run when a module is imported: not in functions, not for type checkers only."""
    found: list[ast.stmt] = []
    for node in body:
        if isinstance(node, ast.If) and "TYPE_CHECKING" in ast.unparse(node.test):
            continue
        found.append(node)
        if not isinstance(node, ast.FunctionDef):
            found += at_import(getattr(node, "body", []))
    return found


def used_by(room: str) -> set[str]:
    """Other rooms whose modules the files of a room import."""
    found = set()
    for path in (PACKAGE / room).rglob("*.py"):
        for node in at_import(ast.parse(path.read_text(encoding="utf-8")).body):
            if isinstance(node, ast.ImportFrom) and (node.module or "").startswith("hbgear."):
                found.add(str(node.module).split(".")[1])
    return found & set(ROOMS) - {room}


def picture() -> str:
    """The picture as SVG."""
    n = len(ROOMS)
    width, height = LEFT + n * CELL + 20, TOP + n * CELL + 20
    out = [f'<svg xmlns="http://www.w3.org/2000/svg" width="{width}" height="{height}" font-family="sans-serif" '
           'font-size="13">', f'<rect width="{width}" height="{height}" fill="white"/>']  # fmt: skip
    for j, room in enumerate(ROOMS):
        x = LEFT + (j + 0.5) * CELL
        out.append(f'<text transform="translate({x + 4:g},{TOP - 8}) rotate(-60)">{room}</text>')
    for i, room in enumerate(reversed(ROOMS)):
        y, own = TOP + i * CELL, n - 1 - i
        out.append(f'<text x="12" y="{y + 22}">{room}</text>')
        used = used_by(room)
        for j, other in enumerate(ROOMS[: own + 1]):
            x = LEFT + j * CELL
            fill = "#1f4e8c" if j == own else "#f2f4f8"
            out.append(f'<rect x="{x + 1}" y="{y + 1}" width="{CELL - 2}" height="{CELL - 2}" fill="{fill}"/>')
            if other in used:
                out.append(f'<circle cx="{x + CELL / 2:g}" cy="{y + CELL / 2:g}" r="6" fill="#d9730d"/>')
    return "\n".join([*out, "</svg>", ""])


def upward() -> list[str]:
    """Imports that point up."""
    return [f"{room} imports {other}" for i, room in enumerate(ROOMS) for other in used_by(room) & set(ROOMS[i:])]


if __name__ == "__main__":
    (HERE / "rooms.svg").write_text(picture(), encoding="utf-8")
    if wrong := upward():
        sys.exit("; ".join(wrong))
