"""Minimum versions stated in pyproject.toml, as constraints of pip: "numpy>=1.26" is printed as "numpy==1.26"."""

from __future__ import annotations

import re
import tomllib
from pathlib import Path


def pins(pyproject: str) -> list[str]:
    """One constraint for each requirement, those of the extras too.

    Raises
    ------
    ValueError
        If a requirement does not state its minimum as ``name>=version``, with a version it must be below or without,
        or two requirements of one name differ. Extras that an extra consists of are no requirements of their own.
    """
    project = tomllib.loads(pyproject)["project"]
    found: dict[str, str] = {}
    for requirement in sum(project["optional-dependencies"].values(), project["dependencies"]):
        if requirement.startswith(f"{project['name']}["):
            continue
        stated = re.fullmatch(r"([\w.-]+)>=([\w.]+)(?:,<[\w.]+)?", requirement)
        if not stated:
            raise ValueError(f'pyproject.toml: "{requirement}" must be written "name>=version"')
        name, version = stated.groups()
        if found.setdefault(name, version) != version:
            raise ValueError(f"pyproject.toml: {name} has two minimum versions, {found[name]} and {version}")
    return [f"{name}=={version}" for name, version in found.items()]


if __name__ == "__main__":
    print(*pins((Path(__file__).resolve().parents[1] / "pyproject.toml").read_text()), sep="\n")
