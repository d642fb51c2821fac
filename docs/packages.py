"""Draw the packages of docs/architecture.md with their imports.

    python docs/packages.py     writes docs/packages.svg, the same bytes every time

Each line is a package, in the order of the layers; a dot marks an import of the package of that column. If a package
imports a higher one, the script ends with exit code 1.
"""

from __future__ import annotations

import ast
import sys
from pathlib import Path

HERE = Path(__file__).parent
SOURCE = HERE.parent / "hbgear"
PACKAGES = (
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
"""Packages from the lowest layer to the highest."""

CELL, LEFT, TOP = 34, 110, 96
"""Size of a cell, and the left and top margins, in pixels."""


def at_import(body: list[ast.stmt]) -> list[ast.stmt]:
    """Return the statements that run when a module is imported: not in functions, not for type checkers only."""
    found: list[ast.stmt] = []
    for node in body:
        if isinstance(node, ast.If) and "TYPE_CHECKING" in ast.unparse(node.test):
            continue
        found.append(node)
        if not isinstance(node, ast.FunctionDef):
            found += at_import(getattr(node, "body", []))
    return found


def used_by(package: str) -> set[str]:
    """Return the other packages that the modules of a package import."""
    found = set()
    for path in (SOURCE / package).rglob("*.py"):
        for node in at_import(ast.parse(path.read_text(encoding="utf-8")).body):
            if isinstance(node, ast.ImportFrom) and (node.module or "").startswith("hbgear."):
                found.add(str(node.module).split(".")[1])
    return found & set(PACKAGES) - {package}


def picture() -> str:
    """Return the picture as SVG."""
    n = len(PACKAGES)
    width, height = LEFT + n * CELL + 20, TOP + n * CELL + 20
    out = [
        f'<svg xmlns="http://www.w3.org/2000/svg" width="{width}" height="{height}" font-family="sans-serif" '
        'font-size="13">',
        f'<rect width="{width}" height="{height}" fill="white"/>',
    ]
    for j, package in enumerate(PACKAGES):
        x = LEFT + (j + 0.5) * CELL
        out.append(f'<text transform="translate({x + 4:g},{TOP - 8}) rotate(-60)">{package}</text>')
    for i, package in enumerate(reversed(PACKAGES)):
        y, own = TOP + i * CELL, n - 1 - i
        out.append(f'<text x="12" y="{y + 22}">{package}</text>')
        used = used_by(package)
        for j, other in enumerate(PACKAGES[: own + 1]):
            x = LEFT + j * CELL
            fill = "#1f4e8c" if j == own else "#f2f4f8"
            out.append(f'<rect x="{x + 1}" y="{y + 1}" width="{CELL - 2}" height="{CELL - 2}" fill="{fill}"/>')
            if other in used:
                out.append(f'<circle cx="{x + CELL / 2:g}" cy="{y + CELL / 2:g}" r="6" fill="#d9730d"/>')
    return "\n".join([*out, "</svg>", ""])


def upward() -> list[str]:
    """Return the imports of higher packages, in words."""
    return [
        f"{package} imports {other}"
        for i, package in enumerate(PACKAGES)
        for other in used_by(package) & set(PACKAGES[i:])
    ]


if __name__ == "__main__":
    (HERE / "packages.svg").write_text(picture(), encoding="utf-8")
    if wrong := upward():
        sys.exit("; ".join(wrong))
