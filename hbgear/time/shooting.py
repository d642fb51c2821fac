"""Periodic motions by shooting, the reference for solutions of harmonic balance and their multipliers.

    y(nu T; y0) = y0,   T = 2 pi / Omega,   (Phi - 1) delta = y0 - y(nu T),   y0 <- y0 + delta

Phi = dy(nu T)/dy0 is integrated together with the motion as the solution of the variational equation (DOP853, steps end
at the breakpoints of the laws). There is no truncation of harmonics and no collocation.
Free motions (a rigid-body rotation) drift, so that they are not periodic: the residual is evaluated in the modal
coordinates, which do not contain them, and their multipliers +1 are left out.

References
----------
Krack & Gross, Harmonic Balance for Nonlinear Vibration Problems (2019), https://doi.org/10.1007/978-3-030-14023-6.
Hairer, Norsett & Wanner, Solving Ordinary Differential Equations I (1993), https://doi.org/10.1007/978-3-540-78862-1.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import scipy

from hbgear.common.argument_checks import checked_arguments
from hbgear.common.arrays import Array, ComplexArray
from hbgear.common.ranges import POSITIVE, checked, counted
from hbgear.continuation.solvers.newton import NoConvergence
from hbgear.harmonic.structure.linear_structure import LinearStructure
from hbgear.mechanics.models import Model
from hbgear.mechanics.series.fourier import coefficients_of, resize, stretch, to_real
from hbgear.time.exponential.modal_states import modal_state, physical_state
from hbgear.time.flows.slider_flow import complete_state
from hbgear.time.integration import Motion, integrate
from hbgear.time.runge_kutta import Flow

_SAMPLES_FOR_HARMONICS = 2048  # samples per excitation period [-] of the motion whose harmonics are computed


@dataclass(frozen=True, eq=False)
class Orbit:
    """Periodic motion computed by shooting.

    Attributes
    ----------
    model : Model
        Model of the motion.
    Omega : float
        Excitation frequency.
    nu : int
        Period of the motion in excitation periods.
    state : ndarray, shape (2n,)
        State (q, q') at tau = 0, followed by the positions of friction sliders.
    monodromy : ndarray, shape (2n, 2n)
        Monodromy matrix dy(nu T)/dy0, with free motions.
    reduced : ndarray, shape (r, r)
        Monodromy matrix in modal coordinates, without free motions.
    multipliers : ndarray, shape (r,)
        Eigenvalues of the reduced monodromy matrix, largest modulus first.
    closure : float
        Distance of the states at the start and the end of the period, relative to the size of the state.
    iterations : int
        Number of Newton iterations.
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

    def motion(self, samples: int = _SAMPLES_FOR_HARMONICS) -> Motion:
        """Return the motion over its period, with a number of samples per excitation period."""
        return integrate(self.model, self.state, self.nu, self.Omega, samples=samples)

    @cached_property
    def _own_motion(self) -> Motion:
        """Motion over the period, integrated once for all numbers of harmonics."""
        return self.motion()

    def rows(self, H: int, motion: Motion | None = None) -> Array:
        """Return real Fourier coefficients (m, 2H + 1) of the element coordinates in theta = tau / nu."""
        motion = motion or self._own_motion
        e = [element.displacement for element in self.model.system().elements]
        smooth = motion.d + np.array([f(motion.tau) if f.corners else 0 * motion.tau for f in e])
        rows = to_real(coefficients_of(smooth, H))
        for row, f in zip(rows, e, strict=True):
            if f.corners:  # its harmonics are known exactly, not only at samples
                row -= resize(stretch(f.row(H // self.nu), self.nu), H)
        return rows


def variation(
    flow: Flow, structure: LinearStructure, y: Array, nu: int, tolerance: float
) -> tuple[Array, Array, ComplexArray]:
    """Integrate the motion from y (2n,) at tau = 0 and the variational equation over nu excitation periods.

    The result is the state at the end, its derivative (2n, 2n) with respect to y, and the same derivative (r, r) in
    modal coordinates, without free motions.
    """
    N, T = flow.size, nu * 2 * np.pi / flow.Omega
    start = np.column_stack([flow.states(y), np.eye(N)])
    end = flow.integrate(0.0, start, T, "DOP853", tolerance)[0].reshape(N, -1)
    fixed = flow.order + np.flatnonzero((end[flow.order :, 1:] == np.eye(N)[flow.order :]).all(axis=1))
    end[:, 1 + fixed] = 0.0  # sliders that never slip have prescribed positions, instead of a multiplier +1
    after = flow.coordinates(T, end)
    Phi = after[:, 1:] @ np.apply_along_axis(flow.states, 0, np.eye(len(y)))
    return after[:, 0], Phi, _reduced(structure, Phi)


def _reduced(structure: LinearStructure, Phi: Array) -> ComplexArray:
    """Return L Phi R with z = L y and y = R z; z may be any complex vector."""
    modes = structure.modes
    assert modes is not None
    R = scipy.linalg.block_diag(
        np.concatenate([modes.right, modes.right * modes.poles]), np.eye(len(Phi) - 2 * structure.n)
    )
    return to_modal(structure, (Phi @ R).T).T


def to_modal(structure: LinearStructure, y: Array) -> ComplexArray:
    """Return states (..., 2n + Q) with Q friction sliders in modal coordinates (..., r + Q), without free motions."""
    n = 2 * structure.n
    return np.concatenate([modal_state(structure, y[..., :n]), y[..., n:]], axis=-1)


def from_modal(structure: LinearStructure, z: ComplexArray, sliders: int) -> Array:
    """Return a state (2n + Q,) from modal coordinates and slider positions (r + Q,), the inverse of `to_modal`."""
    r = len(z) - sliders
    return np.concatenate([physical_state(structure, z[:r]), z[r:].real])


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
    """Compute the periodic motion near a guess by Newton's method for the state at the start of its period.

    Parameters
    ----------
    model : Model
        Model with at most `receptance.MODAL_LIMIT` coordinates.
    Omega : float
        Excitation frequency, > 0.
    guess : array_like, shape (2n,)
        State (q, q') at tau = 0, for example `integration.state_of` a point of a branch.
    nu : int, optional
        Period of the motion in excitation periods. Default: 1.
    tolerance : float, optional
        Largest closure relative to the state, at least 1e-13. The tolerance of the integration is a tenth of it.
        Default: 1e-11.
    max_iterations : int, optional
        Largest number of Newton iterations. Default: 20.

    Returns
    -------
    Orbit
        The periodic motion with its multipliers.

    Raises
    ------
    ValueError
        If nu is below 1, the guess does not fit the model, or the tolerance cannot be reached.
    NoConvergence
        If Newton's method does not converge. The error contains the last state and the history of the closure.
    ArithmeticError
        If the motion diverges from the guess or from a later state; see `integrate`.

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
        raise ValueError(f"tolerance = {tolerance} cannot be reached by time integration; give 1e-13 or more")
    system = model.system().at_speed(Omega)
    structure, flow = LinearStructure(system), Flow(system, float(Omega), variational=True)
    y = complete_state(flow, 0.0, np.array(guess, dtype=float))
    if not np.all(np.isfinite(y)):
        raise ValueError(f"the guess {y} has entries that are not finite; give finite numbers")
    history: list[float] = []
    for iteration in range(max_iterations + 1):
        y = flow.coordinates(0.0, flow.states(y))[:, 0]  # coordinates without mass follow the others
        end, Phi, reduced = variation(flow, structure, y, nu, max(0.1 * tolerance, 1e-13))
        z = to_modal(structure, y)
        residual = to_modal(structure, end) - z
        history.append(float(np.linalg.norm(residual) / (np.linalg.norm(z) or 1.0)))
        if not np.isfinite(history[-1]):
            break
        if history[-1] <= tolerance:
            mu = np.linalg.eigvals(reduced)
            mu = mu[np.argsort(-np.abs(mu))]
            return Orbit(model, float(Omega), nu, y, Phi, reduced, mu, history[-1], iteration)
        step = np.linalg.lstsq(reduced - np.eye(len(z)), -residual, rcond=1e-12)[0]
        y = y + from_modal(structure, step, len(flow.sliders))
    raise NoConvergence(
        f"shooting did not converge at Omega = {Omega:.6g}: closure from {history[0]:.1e} to {history[-1]:.1e} in "
        f"{len(history)} integrations; give a guess nearer to the motion, or check nu = {nu}",
        y,
        {"Omega": float(Omega)},
        history,
    )
