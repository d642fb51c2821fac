"""Whether a corrected point is the next row of a curve, or why it is not: codes, for kernels cannot hand over words."""

from __future__ import annotations

ACCEPTED, LANDED_FAR, TURNED_TOO_FAR, PREDICTION_ERROR, NOT_CONVERGED, SINGULAR = range(6)

_REASONS = {
    ACCEPTED: "",
    LANDED_FAR: "the corrector landed far from the prediction",
    TURNED_TOO_FAR: "the tangent turned by {number:.0f} degrees",
    PREDICTION_ERROR: "the prediction missed the curve by {number:.0%} of the step",
    NOT_CONVERGED: "the corrector stopped at a relative residual of {number:.2e}",
    SINGULAR: "the corrector met a singular matrix",
}


def status_message(verdict: int, number: float) -> str:
    """What a verdict means; number: by how much."""
    return _REASONS[verdict].format(number=number)
