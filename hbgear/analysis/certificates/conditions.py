"""Conditions of a proof, and the error that names the one that fails."""

from __future__ import annotations


class NotCertifiedError(ValueError):
    """A condition of a proof is not satisfied, or is not proved.

    Attributes
    ----------
    condition : str
        "model", "start", "contact order", "existence", "order of instants", "transversality", "gaps", "grazing", or
        "stated numbers" of a certificate that is verified.

    Examples
    --------
    >>> import hbgear as hb
    >>> curve = hb.trace(hb.HarmonicBalance(hb.Duffing(), 5), "Omega", (0.8, 1.6))
    >>> try:
    ...     hb.analysis.certify(curve["LP1"])
    ... except hb.analysis.NotCertifiedError as error:
    ...     print(error.condition)
    model
    """

    def __init__(self, condition: str, reason: str) -> None:
        super().__init__(f"not certified, {condition}: {reason}")
        self.condition = condition
