"""Status of a corrected point: accepted, or the reason for its rejection.

Kernels return the status as an integer code.
"""

from __future__ import annotations

ACCEPTED, LANDED_FAR, TURNED_TOO_FAR, PREDICTION_ERROR, NOT_CONVERGED, SINGULAR = range(6)
"""Codes of the status."""

_MESSAGES = {
    ACCEPTED: "",
    LANDED_FAR: "the corrector landed far from the prediction",
    TURNED_TOO_FAR: "the tangent turned by {number:.0f} degrees",
    PREDICTION_ERROR: "the prediction missed the curve by {number:.0%} of the step",
    NOT_CONVERGED: "the corrector stopped at a relative residual of {number:.2e}",
    SINGULAR: "the matrix of the corrector is singular",
}


def status_message(status: int, number: float) -> str:
    """Return the message of a status, empty for an accepted point.

    ``number`` is its quantity: angle [deg], prediction error or residual.
    """
    return _MESSAGES[status].format(number=number)
