"""Shell completion: models, their parameters, labels of a saved curve.

An error during completion offers nothing: the command itself prints it.
"""

from __future__ import annotations

import os

import hbgear as hb
from hbgear.cli.support import label_on_curve
from hbgear.continuation.events.registry import optional_events
from hbgear.harmonic.models import model_registry
from hbgear.io.branches.npz import read
from hbgear.mechanics.fields import defaults_of, entries_among, kinds_of, parameters_of
from hbgear.mechanics.model_lookup import installed
from hbgear.mechanics.series import measures


def models(incomplete: str) -> list[str]:
    """Return names of models."""
    return [name for name in [*model_registry.MODELS, *installed()] if name.startswith(incomplete)]


def fields(incomplete: str) -> list[str]:
    """Return fields of the given model, each followed by =."""
    model = _model()
    names = kinds_of(model) if model else ()
    return [f"{name}=" for name in names if name.startswith(incomplete)]


def parameters(incomplete: str) -> list[str]:
    """Return parameters of the given model."""
    model = _model()
    names = [*parameters_of(model), *entries_among(model, defaults_of(model))] if model else []
    return [name for name in names if name.startswith(incomplete)]


def assigned(incomplete: str) -> list[str]:
    """Return Omega and the parameters of the given model, each followed by =."""
    return [f"{name}=" for name in ["Omega", *parameters("")] if name.startswith(incomplete)]


def labels(incomplete: str) -> list[str]:
    """Return labels of the special points of the given file; those of its second curve begin with ``2:``."""
    return [label for label, _ in _special() if label.startswith(incomplete)]


def crossings(incomplete: str) -> list[str]:
    """Return labels of its points from which another branch leads."""
    return [label for label, point in _special() if point.kind in ("PD", "BP") and label.startswith(incomplete)]


def events(incomplete: str) -> list[str]:
    """Return names of events that are located on request."""
    return [name for name in optional_events() if name.startswith(incomplete)]


def amplitudes(incomplete: str) -> list[str]:
    """Return measures of amplitude."""
    return [name for name in (*measures.MEASURES, "H1", "H2") if name.startswith(incomplete)]


def _words() -> list[str]:
    """Return the words typed so far; click drops arguments before an option whose value is still missing."""
    return os.environ.get("_TYPER_COMPLETE_ARGS", os.environ.get("COMP_WORDS", "")).split()


def _model() -> type[hb.mechanics.Model] | None:
    """Return the class of the given model of hbgear; completion runs no code of others."""
    return next((model_registry.MODELS[word] for word in _words() if word in model_registry.MODELS), None)


def _special() -> list[tuple[str, hb.SpecialPoint]]:
    """Return the special points of all curves of the given file, with their labels on the command line."""
    file = next((word for word in _words() if word.endswith(".npz")), "")
    try:
        branch = read(file)
    except (OSError, ValueError):
        return []
    return [
        (label_on_curve(number, point), point)
        for number, curve in enumerate(branch.curves, 1)
        for point in curve.special
    ]
