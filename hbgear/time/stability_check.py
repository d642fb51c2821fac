"""A second opinion on the stability of one motion: its multipliers by three ways, side by side."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from hbgear.common.argument_checks import checked_arguments
from hbgear.common.arrays import ComplexArray
from hbgear.continuation.results.branch import Branch
from hbgear.continuation.results.point import Point
from hbgear.continuation.results.stability import STABILITY_TOLERANCE
from hbgear.continuation.solvers.newton import NoConvergence
from hbgear.harmonic.harmonic_balance import HarmonicBalance
from hbgear.harmonic.multipliers.hill import hill_multipliers
from hbgear.time.integration import state_of
from hbgear.time.shooting import Orbit, shoot


@dataclass(frozen=True, eq=False, repr=False)
class StabilityComparison:
    """Multipliers of one motion by three ways, largest first.

    Parameters
    ----------
    point : the motion.
    carried : (r,) disturbances carried along the motion of the harmonic balance: those of the point, which may be of
        more harmonics where fewer left its stability in doubt.
    hill : (r,) exponents of Hill's matrix of the same harmonics; None if there is none.
    shot : (r,) of the periodic motion found by shooting, without harmonics; None if shooting fails.
    orbit : that motion.
    notes : why something is missing.

    Examples
    --------
    >>> import hbgear as hb
    >>> curve = hb.trace(hb.HarmonicBalance(hb.Duffing(), 7), "Omega", (0.8, 1.6))
    >>> opinion = hb.time.compare_multipliers(curve, 20)
    >>> opinion.verdicts
    {'carried': 'stable', 'hill': 'stable', 'shot': 'stable'}
    >>> {name: round(modulus, 3) for name, modulus in opinion.moduli.items()}
    {'carried': 0.715, 'hill': 0.715, 'shot': 0.715}
    """

    point: Point
    carried: ComplexArray
    hill: ComplexArray | None
    shot: ComplexArray | None
    orbit: Orbit | None
    notes: tuple[str, ...] = ()

    @property
    def moduli(self) -> dict[str, float]:
        """The largest modulus by each way that gave multipliers."""
        found = {"carried": self.carried, "hill": self.hill, "shot": self.shot}
        return {name: float(np.abs(mu).max(initial=0.0)) for name, mu in found.items() if mu is not None}

    @property
    def verdicts(self) -> dict[str, str]:
        """Whether each way says stable or unstable."""
        return {
            name: "stable" if modulus <= 1.0 + STABILITY_TOLERANCE else "unstable"
            for name, modulus in self.moduli.items()
        }

    @property
    def agree(self) -> bool:
        """Whether all ways that gave multipliers come to the same verdict."""
        return len(set(self.verdicts.values())) == 1

    def __repr__(self) -> str:
        told = [f"{name} {modulus:.6f} ({self.verdicts[name]})" for name, modulus in self.moduli.items()]
        words = "; ".join(["largest multiplier: " + ", ".join(told), *self.notes])
        return f"<Opinion on {self.point!r}: {words}>"


@checked_arguments(point="a row number, the label of a special point, or a Point of the branch")
def compare_multipliers(branch: Branch, point: int | str | Point) -> StabilityComparison:
    """Multipliers of a motion as hbgear carries them, of Hill's matrix, and of the motion found by shooting.

    The first two are of the motion of the harmonic balance, the third is without harmonics: where it differs, there are
    too few of them. Hill's matrix is of the harmonics of the point and no more. All of it takes seconds at most.

    Parameters
    ----------
    branch : a curve that still knows its problem, a `HarmonicBalance`.
    point : number of a row, label of a special point, or a point.

    Raises
    ------
    KeyError, IndexError
        If there is no such point.
    ValueError
        If the branch has lost its problem, or is not one of periodic motions.

    Examples
    --------
    >>> import hbgear as hb
    >>> curve = hb.trace(hb.HarmonicBalance(hb.SpurPair(), 8), "Omega", (1.0, 0.6))
    >>> hb.time.compare_multipliers(curve, 5).agree
    True
    """
    if not isinstance(branch.problem, HarmonicBalance):
        raise ValueError(
            "a second opinion needs the model: give a branch of a HarmonicBalance; load one with "
            "load(path, problem=HarmonicBalance(...))"
        )
    here = point if isinstance(point, Point) else branch[point]
    problem = branch.problem.at_resolution_of(here)
    X, at, notes = problem.from_point(here), dict(here.parameters), []
    hill = orbit = None
    try:
        hill = hill_multipliers(problem.compiled(at), X, at["Omega"])
    except ValueError as error:
        notes.append(str(error))
    try:
        orbit = shoot(problem.model.at(at), at["Omega"], state_of(problem, X, **at), problem.nu)
    except (ValueError, NoConvergence, ArithmeticError, np.linalg.LinAlgError) as error:
        notes.append(f"shooting: {error}")
    shot = None if orbit is None else orbit.multipliers
    carried = problem.multipliers(X, None, None, **at) if here.multipliers is None else here.multipliers
    return StabilityComparison(here, carried, hill, shot, orbit, tuple(notes))
