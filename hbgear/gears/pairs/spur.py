"""Spur gear pair as an oscillator with one degree of freedom.

References
----------
Kahraman & Singh (1990), J. Sound Vib. 142(1), 49-75, https://doi.org/10.1016/0022-460X(90)90582-K.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar, Literal

from hbgear.common.ranges import NOT_NEGATIVE, Range
from hbgear.gears.mesh.mesh_excitation import SCALE_LABELS, USUAL_AMPLITUDES, MeshExcitation
from hbgear.mechanics.laws.mesh_contacts import MeshContacts
from hbgear.mechanics.models import System
from hbgear.mechanics.series.fourier import Series
from hbgear.mechanics.series.periodic import Phased
from hbgear.mechanics.structures.elements import Element


@dataclass(frozen=True)
class SpurPair(MeshExcitation):  # numpydoc ignore=PR02
    """Spur gear pair reduced to its gap x along the line of action, all quantities dimensionless.

        x'' + 2 zeta x' + k(tau) f(x) = F_m + sum_l (l Omega)^2 e_l cos(l tau)      (or sin, by `phase`)
        k(tau) = 1 - sum_l eps_l cos(l tau),   f = backlash function with half-gap b,   tau = Omega t

    The coordinate is q = x + e(tau), e(tau) = sum_l e_l cos(l tau), the motion of the teeth without their error:
    q'' = F_m - 2 zeta x' - k f(x) and q'' = x'' + e'' with -e'' = sum_l (l Omega)^2 e_l cos(l tau). The element
    displacement is d = q - e = x.

    Units, for a pair of mass m_c, mean mesh stiffness k_mean and half backlash b_c:

        x, e_l, b          lengths over b_c: b = 1, drive-side contact for x > 1, back-side contact for x < -1
        Omega              mesh frequency over omega_n = sqrt(k_mean/m_c); time is in 1/omega_n
        F_m                force over k_mean b_c: the static deflection of the mesh in half backlashes
        zeta               mesh damper over 2 m_c omega_n
        eps_l              stiffness over k_mean

    With J the moment of inertia and r the base radius of each gear, m_c = 1/(r_1^2/J_1 + r_2^2/J_2). Another value of b
    changes the backlash alone, since b_c remains the unit of length.

    The defaults are a case of Kahraman & Singh: e_1 Omega^2 is their F_ah omega_eh^2 with F_ah = 0.05.

    Parameters
    ----------
    zeta : float, default 0.05
        Damping ratio of the mesh, >= 0.
    F_m : float, default 0.1
        Mean load, over k_mean b_c.
    eps : tuple of float, shape (L,), optional
        Amplitudes of the mesh stiffness; () for a constant stiffness.
    e : tuple of float, shape (L,), optional
        Amplitudes of the transmission error over b_c.
    phase : {"cos", "sin"}, default "cos"
        Function of the harmonics of the transmission error.
    b : float, default 1.0
        Half backlash over b_c, >= 0.
    eps_scale, e_scale : float, default 1.0
        Factors of all eps_l and all e_l, for use as continuation parameters.
    stiffness : Phased or None, optional
        Mesh stiffness k(tau) over k_mean instead of eps: a `Series` or a `Periodic`, for example
        `Periodic.rectangular`.
    error : Phased or None, optional
        Transmission error e(tau) over b_c instead of e: a `Series` or a `Periodic` without jumps, for example
        `Periodic.table`.
    contacts : MeshContacts or None, optional
        Contacts of a tooth-resolved mesh instead of eps and stiffness: stiffness over k_mean and initial gaps over b_c,
        without backlash. `GearPair.model` computes them from a drawing.
    eps_lag, e_lag : tuple of float, shape (L,), optional
        Phase lags of the harmonics, cos(l tau - lag_l) [rad]; () for no lag.
    reference : tuple of float, optional
        Values (omega_n [rad/s], b_c [m], k_mean b_c [N], teeth of the pinion) that convert to Hz, r/min, um and N
        (`scales`); () if they are unknown. `GearPair.model` sets them.
    mesh_order : int, default 1
        Frequency of the mesh over Omega; above 1 if a torque fluctuates more slowly than the mesh.
    fluctuation : Series or None, optional
        Alternating load F(tau) that is added to F_m, over k_mean b_c, a function of the phase of Omega. It is the load
        on the relative rotation: a torque on one gear times the share of its r^2/J in 1/m_c.
    fluctuation_scale : float, default 1.0
        Factor of the fluctuation, for use as a continuation parameter.

    Raises
    ------
    ValueError
        If a value is out of its range or not finite.

    References
    ----------
    Kahraman & Singh (1990), J. Sound Vib. 142(1), 49-75.

    Examples
    --------
    >>> import hbgear as hb
    >>> pair = hb.SpurPair(e=(0.1, 0.02))
    >>> pair.e_scale, pair.replace(zeta=0.1).zeta
    (1.0, 0.1)
    >>> teeth = hb.SpurPair(stiffness=hb.mechanics.Periodic.rectangular(high=1.16, low=0.76, share=0.6))
    >>> len(hb.HarmonicBalance(teeth, 8).start(Omega=1.2))
    17
    """

    zeta: float = 0.05
    F_m: float = 0.1
    eps: tuple[float, ...] = ()
    e: tuple[float, ...] = (0.05,)
    phase: Literal["cos", "sin"] = "cos"
    b: float = 1.0
    eps_scale: float = 1.0
    e_scale: float = 1.0
    stiffness: Phased | None = None
    error: Phased | None = None
    contacts: MeshContacts | None = None
    eps_lag: tuple[float, ...] = ()
    e_lag: tuple[float, ...] = ()
    reference: tuple[float, ...] = ()
    mesh_order: int = 1
    fluctuation: Series | None = None
    fluctuation_scale: float = 1.0

    labels: ClassVar[Mapping[str, str]] = {
        "Omega": r"$\Omega = \omega_\mathrm{mesh}/\omega_n$ [-]",
        "amplitude": r"$x$ [-]",
        "zeta": r"damping ratio $\zeta$ [-]",
        "F_m": r"mean load $F_m$ [-]",
        "b": r"half backlash $b$ [-]",
        **SCALE_LABELS,
    }
    default_span: ClassVar[tuple[float, float]] = (1.5, 0.3)
    ranges: ClassVar[Mapping[str, Range]] = {"zeta": NOT_NEGATIVE, "b": NOT_NEGATIVE}
    usual: ClassVar[Mapping[str, Range]] = {
        "zeta": Range(0, 1),
        "F_m": Range(-20, 20),
        "b": Range(0, 100),
        **USUAL_AMPLITUDES,
    }

    def system(self) -> System:
        """Return the equation of motion in the coordinate q = x + e(tau); the mesh is the only spring."""
        law = self.mesh_law(self.b)
        gap = Element(
            direction=[1.0],
            law=law.along if isinstance(law, MeshContacts) else law,
            displacement=self.transmission_error,
            damping=2 * self.zeta,
            name="gap",
        )
        return System(
            M=[[1.0]], C=None, K=[[0.0]], elements=[gap], load=self.fluctuating_load([self.F_m], [1.0]), dof_names=["q"]
        )
