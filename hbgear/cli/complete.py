"""What the shell offers while a command is typed: models, their parameters, labels of a saved curve.

Whatever fails here is nothing to offer: the command itself says what is wrong.
"""

from __future__ import annotations

import os

import hbgear as hb
from hbgear.harmonic import model_registry
from hbgear.harmonic.equations import layout as measures
from hbgear.mechanics.fields import defaults_of, entries_among, kinds_of, parameters_of
from hbgear.mechanics.model_lookup import installed


def models(incomplete: str) -> list[str]:
    """Names of models."""
    return [name for name in [*model_registry.MODELS, *installed()] if name.startswith(incomplete)]


def fields(incomplete: str) -> list[str]:
    """Fields of the model that was named, each with the = that follows."""
    model = _model()
    names = kinds_of(model) if model else ()
    return [f"{name}=" for name in names if name.startswith(incomplete)]


def parameters(incomplete: str) -> list[str]:
    """Parameters of the model that was named."""
    model = _model()
    names = [*parameters_of(model), *entries_among(model, defaults_of(model))] if model else []
    return [name for name in names if name.startswith(incomplete)]


def assigned(incomplete: str) -> list[str]:
    """Omega and the parameters of the model that was named, each with the = that follows."""
    return [f"{name}=" for name in ["Omega", *parameters("")] if name.startswith(incomplete)]


def labels(incomplete: str) -> list[str]:
    """Labels of the special points of the file that was named."""
    return [p.label for p in _special() if p.label.startswith(incomplete)]


def crossings(incomplete: str) -> list[str]:
    """Labels of its points where another branch leaves."""
    return [p.label for p in _special() if p.kind in ("PD", "BP") and p.label.startswith(incomplete)]


def amplitudes(incomplete: str) -> list[str]:
    """Measures of amplitude."""
    return [name for name in (*measures.MEASURES, "H1", "H2") if name.startswith(incomplete)]


def _words() -> list[str]:
    """What has been typed; an option that still lacks its value keeps click from telling the arguments before it."""
    return os.environ.get("_TYPER_COMPLETE_ARGS", os.environ.get("COMP_WORDS", "")).split()


def _model() -> type[hb.mechanics.Model] | None:
    """The class of hbgear that was named; no code of others is run while a command is typed."""
    return next((model_registry.MODELS[word] for word in _words() if word in model_registry.MODELS), None)


def _special() -> tuple[hb.SpecialPoint, ...]:
    file = next((word for word in _words() if word.endswith(".npz")), "")
    try:
        return hb.load(file).special
    except (OSError, ValueError):
        return ()
