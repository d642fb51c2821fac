"""Whether a corrected point is the next row of a curve, or why it is not: codes, for kernels cannot hand over words."""

from __future__ import annotations

GOOD, FAR, TURNED, MISSED, STOPPED, SINGULAR = range(6)

_REASONS = {
    GOOD: "",
    FAR: "the corrector landed far from the prediction",
    TURNED: "the tangent turned by {number:.0f} degrees",
    MISSED: "the prediction missed the curve by {number:.0%} of the step",
    STOPPED: "the corrector stopped at a relative residual of {number:.2e}",
    SINGULAR: "the corrector met a singular matrix",
}


def reason(verdict: int, number: float) -> str:
    """What a verdict means; number: by how much."""
    return _REASONS[verdict].format(number=number)
