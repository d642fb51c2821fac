"""Independent check of the stability of one motion: its multipliers by three methods."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from hbgear.common.argument_checks import checked_arguments
from hbgear.common.arrays import ComplexArray
from hbgear.common.deprecation import renamed_attributes
from hbgear.continuation.results.branch import Branch
from hbgear.continuation.results.point import Point
from hbgear.continuation.results.stability import STABILITY_TOLERANCE
from hbgear.continuation.solvers.newton import SEARCH_ERRORS
from hbgear.harmonic.harmonic_balance import HarmonicBalance
from hbgear.harmonic.multipliers.hill import hill_multipliers
from hbgear.time.integration import start_state
from hbgear.time.shooting import Orbit, shoot


@renamed_attributes(verdicts="stability", carried="variational", shot="shooting")
@dataclass(frozen=True, eq=False, repr=False)
class StabilityComparison:
    """Multipliers of one motion by three methods, largest modulus first.

    Attributes
    ----------
    point : Point
        The motion.
    variational : ndarray, shape (r,)
        From the variational equation of the harmonic-balance solution. They are the multipliers of the point, which are
        computed with more harmonics where fewer left its stability uncertain.
    hill : ndarray, shape (r,), or None
        From Hill's matrix with the harmonics of the point; None if it is not available.
    shooting : ndarray, shape (r,), or None
        From the periodic motion computed by shooting, without harmonics; None if shooting does not converge.
    orbit : Orbit or None
        Periodic motion computed by shooting.
    notes : tuple of str
        Reasons for missing multipliers.

    Examples
    --------
    >>> import hbgear as hb
    >>> curve = hb.trace(hb.HarmonicBalance(hb.Duffing(), 7), "Omega", (0.8, 1.6))
    >>> comparison = hb.time.compare_multipliers(curve, 20)
    >>> comparison.stability
    {'variational': 'stable', 'hill': 'stable', 'shooting': 'stable'}
    >>> {name: round(modulus, 3) for name, modulus in comparison.moduli.items()}
    {'variational': 0.715, 'hill': 0.715, 'shooting': 0.715}
    """

    point: Point
    variational: ComplexArray
    hill: ComplexArray | None
    shooting: ComplexArray | None
    orbit: Orbit | None
    notes: tuple[str, ...] = ()

    @property
    def moduli(self) -> dict[str, float]:
        """Largest modulus by each available method."""
        multipliers = {"variational": self.variational, "hill": self.hill, "shooting": self.shooting}
        return {name: float(np.abs(mu).max(initial=0.0)) for name, mu in multipliers.items() if mu is not None}

    @property
    def stability(self) -> dict[str, str]:
        """Stability by each available method: "stable" or "unstable"."""
        return {
            name: "stable" if modulus <= 1.0 + STABILITY_TOLERANCE else "unstable"
            for name, modulus in self.moduli.items()
        }

    @property
    def agree(self) -> bool:
        """True if all available methods result in the same stability."""
        return len(set(self.stability.values())) == 1

    def __repr__(self) -> str:
        moduli = [f"{name} {modulus:.6f} ({self.stability[name]})" for name, modulus in self.moduli.items()]
        words = "; ".join(["largest multiplier: " + ", ".join(moduli), *self.notes])
        return f"<StabilityComparison of {self.point!r}: {words}>"


@checked_arguments(point="the index of a point, the label of a special point, or a Point of the branch")
def compare_multipliers(branch: Branch, point: int | str | Point) -> StabilityComparison:
    """Return the multipliers of a motion from the variational equation, from Hill's matrix, and from shooting.

    The first two are those of the harmonic-balance solution. Shooting uses no harmonics: if its multipliers differ, the
    harmonic truncation order of the solution is too low. Hill's matrix has the harmonics of the point only.

    Parameters
    ----------
    branch : Branch
        Branch with its problem, a `HarmonicBalance`.
    point : int, str or Point
        Index of a point, label of a special point, or a point.

    Returns
    -------
    StabilityComparison
        Multipliers by each method.

    Raises
    ------
    KeyError, IndexError
        If the point does not exist.
    ValueError
        If the branch has no problem, or is not a branch of periodic motions.

    Examples
    --------
    >>> import hbgear as hb
    >>> curve = hb.trace(hb.HarmonicBalance(hb.SpurPair(), 8), "Omega", (1.0, 0.6))
    >>> hb.time.compare_multipliers(curve, 5).agree
    True
    """
    if not isinstance(branch.problem, HarmonicBalance):
        raise ValueError(
            "the comparison needs the model: give a branch of a HarmonicBalance; load one with "
            "load(path, problem=HarmonicBalance(...))"
        )
    motion = point if isinstance(point, Point) else branch[point]
    problem = branch.problem.at_resolution_of(motion)
    X, values, notes = problem.from_point(motion), dict(motion.parameters), []
    hill = orbit = None
    try:
        hill = hill_multipliers(problem.compiled(values), X, values["Omega"])
    except ValueError as error:
        notes.append(str(error))
    try:
        orbit = shoot(problem.model.at(values), values["Omega"], start_state(problem, X, **values), problem.nu)
    except (*SEARCH_ERRORS, ArithmeticError) as error:
        notes.append(f"shooting: {error}")
    shooting = None if orbit is None else orbit.multipliers
    variational = problem.multipliers(X, None, None, **values) if motion.multipliers is None else motion.multipliers
    return StabilityComparison(motion, variational, hill, shooting, orbit, tuple(notes))
