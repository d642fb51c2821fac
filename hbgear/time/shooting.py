"""Periodic motions by Newton on the time map, the reference for harmonic balance and for its multipliers.

    y(nu T; y0) = y0,   T = 2 pi / Omega,   (Phi - 1) delta = y0 - y(nu T),   y0 <- y0 + delta

Phi = dy(nu T)/dy0 comes from the variational equation integrated along (DOP853, with the corners of the laws met
exactly): no harmonics, no collocation. The drift of free motions (a rotation that nothing holds) is not closed: y is
compared in the modal coordinates, which leave it out, and its multipliers +1 are left out too.

References
----------
Krack & Gross, Harmonic Balance for Nonlinear Vibration Problems (2019), https://doi.org/10.1007/978-3-030-14023-6.
Hairer, Norsett & Wanner, Solving Ordinary Differential Equations I (1993), https://doi.org/10.1007/978-3-540-78862-1.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from hbgear.common.argument_checks import checked_arguments
from hbgear.common.arrays import Array, ComplexArray
from hbgear.common.ranges import POSITIVE, checked, counted
from hbgear.continuation.solvers.newton import NoConvergence
from hbgear.harmonic.structure.receptance import LinearStructure
from hbgear.mechanics.models import Model
from hbgear.mechanics.series.fourier import resize, stretch, to_real
from hbgear.time.exponential.integrator import modal_state, physical_state
from hbgear.time.integration import Motion, integrate
from hbgear.time.runge_kutta import Flow

_SAMPLES = 2048  # per excitation period, of the motion whose harmonics are asked for


@dataclass(frozen=True, eq=False)
class Orbit:
    """A periodic motion found by shooting.

    Parameters
    ----------
    model, Omega, nu : whose motion, over nu excitation periods.
    state : (2n,) at tau = 0.
    monodromy : (2n, 2n) dy(nu T)/dy0, free motions included.
    reduced : (r, r) the same in the modal coordinates, free motions left out.
    multipliers : (r,) its eigenvalues, largest first.
    closure : how far the period fails to close, relative to the size of the state.
    iterations : Newton steps taken.
    """

    model: Model
    Omega: float
    nu: int
    state: Array
    monodromy: Array
    reduced: ComplexArray
    multipliers: ComplexArray
    closure: float
    iterations: int

    def motion(self, samples: int = _SAMPLES) -> Motion:
        """The motion over its period, with so many samples per excitation period."""
        return integrate(self.model, self.state, self.nu, self.Omega, samples=samples)

    def rows(self, H: int, motion: Motion | None = None) -> Array:
        """Element coordinates as real rows (m, 2H + 1) in the basis phase theta = tau / nu."""
        motion = motion or self.motion()
        e = [element.displacement for element in self.model.system().elements]
        smooth = motion.d + np.array([one(motion.tau) if one.corners else 0 * motion.tau for one in e])
        c = np.fft.rfft(smooth, axis=-1)[:, : H + 1] / smooth.shape[-1]
        c[:, 1:] *= 2
        rows = to_real(c)
        for row, one in zip(rows, e, strict=True):
            if one.corners:  # whose harmonics are known better than its samples tell
                row -= resize(stretch(one.row(H // self.nu), self.nu), H)
        return rows


def variation(
    flow: Flow, structure: LinearStructure, y: Array, nu: int, tolerance: float
) -> tuple[Array, Array, ComplexArray]:
    """End (2n,) of nu periods from y, dy(end)/dy (2n, 2n), and the same in modal coordinates (r, r).

    ``flow`` must be variational.
    """
    n = flow.n
    Y = np.column_stack([y, np.eye(2 * n)])
    end, _, _ = flow.march(0.0, Y, nu * 2 * np.pi / flow.Omega, "DOP853", tolerance)
    end = end.reshape(2 * n, -1)
    Phi = end[:, 1:]
    return end[:, 0], Phi, _reduced(structure, Phi)


def _reduced(structure: LinearStructure, Phi: Array) -> ComplexArray:
    """L Phi R with z = L y and y = R z, on vectors that need not be conjugate pairs."""
    modes = structure.modes
    assert modes is not None
    R = np.concatenate([modes.right, modes.right * modes.poles])
    return modal_state(structure, (Phi @ R).T).T


@checked_arguments()
def shoot(
    model: Model,
    Omega: float,
    guess: Array | Sequence[float],
    nu: int = 1,
    *,
    tolerance: float = 1e-11,
    max_iterations: int = 20,
) -> Orbit:
    """The periodic motion near a guess, by Newton on the state after its period.

    Parameters
    ----------
    model : `Model` with at most `receptance.MODAL_LIMIT` coordinates.
    Omega : excitation frequency.
    guess : (2n,) state (q, q') at tau = 0, for example `timedomain.state_of` a point of a branch.
    nu : excitation periods the motion takes.
    tolerance : of the closure relative to the state, and of the integration (a tenth of it); at least 1e-13.

    Raises
    ------
    ValueError
        If nu is below 1, the guess does not fit, or the tolerance is beyond the integrator.
    NoConvergence
        If Newton does not close the period; it carries the last state and the closures.
    ArithmeticError
        If the motion from the guess, or from a later state, runs away; see `integrate`.

    Examples
    --------
    >>> import hbgear as hb
    >>> orbit = hb.time.shoot(hb.Duffing(), 0.5, [0.2, 0.0])
    >>> orbit.multipliers.shape
    (2,)
    """
    counted("nu", nu, 1000)
    counted("max_iterations", max_iterations)
    checked("shoot", "Omega", Omega, POSITIVE)
    checked("shoot", "tolerance", tolerance)
    if not 1e-13 <= tolerance < 1:
        raise ValueError(
            f"tolerance = {tolerance} cannot be met: time integration reaches about 1e-13; give 1e-13 or more"
        )
    system = model.system().at_speed(Omega)
    structure, flow = LinearStructure(system), Flow(system, float(Omega), variational=True)
    y = np.array(guess, dtype=float)
    if y.shape != (2 * system.n,):
        raise ValueError(f"a guess of shape {y.shape} does not fit {system.n} coordinates; need ({2 * system.n},)")
    if not np.all(np.isfinite(y)):
        raise ValueError(f"the guess {y} has entries that are not finite")
    history: list[float] = []
    for iteration in range(max_iterations + 1):
        end, Phi, reduced = variation(flow, structure, y, nu, max(0.1 * tolerance, 1e-13))
        z = modal_state(structure, y)
        gap = modal_state(structure, end) - z
        history.append(float(np.linalg.norm(gap) / (np.linalg.norm(z) or 1.0)))
        if not np.isfinite(history[-1]):
            break
        if history[-1] <= tolerance:
            mu = np.linalg.eigvals(reduced)
            mu = mu[np.argsort(-np.abs(mu))]
            return Orbit(model, float(Omega), nu, y, Phi, reduced, mu, history[-1], iteration)
        step = np.linalg.lstsq(reduced - np.eye(len(z)), -gap, rcond=1e-12)[0]
        y = y + physical_state(structure, step)
    raise NoConvergence(
        f"shooting did not close the period at Omega = {Omega:.6g}: from {history[0]:.1e} to {history[-1]:.1e} in "
        f"{len(history)} integrations; start nearer to the motion, or check nu = {nu}",
        y,
        {"Omega": float(Omega)},
        history,
    )
