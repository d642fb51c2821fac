"""Base class of models that are computed from another model and have its parameters."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Self

from hbgear.common.ranges import Range
from hbgear.mechanics.models import Model


class DerivedModel(Model):
    """A model computed from another one, at any of its parameters.

    Parameters
    ----------
    model : Model
        The other model.
    """

    def __init__(self, model: Model) -> None:
        self.model = model

    def __repr__(self) -> str:
        return f"{type(self).__name__}({self.model!r})"

    @property
    def parameters(self) -> dict[str, float]:
        return self.model.parameters

    @property
    def entries(self) -> dict[str, float]:
        return self.model.entries

    @property
    def ranges(self) -> Mapping[str, Range]:  # type: ignore[override]
        """Ranges of the parameters of the model."""
        return self.model.ranges

    @property
    def labels(self) -> Mapping[str, str]:  # type: ignore[override]
        """Labels of the model."""
        return self.model.labels

    def replace(self, /, **changes: float) -> Self:
        return type(self)(self.model.replace(**changes))
