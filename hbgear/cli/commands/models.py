"""``hbgear models``: the models with their equations and parameters."""

from __future__ import annotations

import inspect
import re
from typing import Annotated

import typer

import hbgear as hb
from hbgear.analysis.summary import text_of
from hbgear.cli.output import print_message, print_table
from hbgear.common.text.digits import short
from hbgear.harmonic.models import model_registry
from hbgear.io.machines.model_file import read_model
from hbgear.mechanics.fields import defaults_of, kinds_of
from hbgear.mechanics.model_lookup import installed


def models(
    model: Annotated[
        str | None,
        typer.Argument(metavar="[MODEL]", help="Only this model: a name, your own FILE.py:NAME, or FILE.toml."),
    ] = None,
) -> None:
    """List the models, their equations and their parameters with defaults; VALUE marks a required parameter.

    The list includes models of installed packages with entry points hbgear.models.
    """
    if model is not None and model.endswith(".toml"):
        _print_parameters(model)
        return
    rows = []
    for name in [*model_registry.MODELS, *installed()] if model is None else [model]:
        try:
            cls = model_registry.model_class(name)
        except ValueError as error:
            if model is not None:
                raise
            print_message("warning", error)  # a broken package does not hide the others
            continue
        lines = [_summary(cls), _equation(cls), _defaults(cls), _ranges(cls)]
        about = "\n".join(line for line in lines if line or cls.__module__.startswith("hbgear."))
        rows.append([f"{name}\n{cls.__name__}", f"{about}\n"])
    print_table(["model", "equation, parameters with defaults (change them with --set)"], rows)


def _print_parameters(file: str) -> None:
    """Print the parameters of the machine in a file, which --set, --in and other commands can change."""
    machine = read_model(file)
    values = machine.parameters | machine.entries
    rows = [[name, short(value, 6), machine.labels.get(name, "")] for name, value in values.items()]
    print_table(["parameter", "value", "meaning (change it with --set)"], rows, file)


def _summary(cls: type) -> str:
    """Return the first line of the docstring of a class, up to a semicolon."""
    return next(iter((inspect.getdoc(cls) or "").splitlines()), "").partition(";")[0].rstrip(".")


def _defaults(cls: type[hb.mechanics.Model]) -> str:
    """Return the fields in the form of --set, with their defaults; VALUE for a required field."""
    defaults = defaults_of(cls)
    return ", ".join(f"{name}={text_of(defaults[name]) if name in defaults else 'VALUE'}" for name in kinds_of(cls))


def _ranges(cls: type[hb.mechanics.Model]) -> str:
    """Return the ranges of the parameters, the parameters of one range together."""
    names: dict[str, list[str]] = {}
    for name, allowed in cls.ranges.items():
        names.setdefault(str(allowed), []).append(name)
    return "; ".join(f"{', '.join(parameters)} must {need}" for need, parameters in names.items())


def _equation(cls: type) -> str:
    """Return the first indented line of the docstring of the class, or of its module within hbgear."""
    module = inspect.getmodule(cls) if cls.__module__.startswith("hbgear.") else None
    for text in (inspect.getdoc(cls), inspect.getdoc(module) if module else None):
        for line in (text or "").partition("\nParameters\n")[0].splitlines():
            if line.startswith("    "):
                return re.sub(r"\s+", " ", line.strip())
    return ""
