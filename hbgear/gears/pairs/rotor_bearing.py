"""Spur gear pair on flexible shafts and rolling bearings with clearance: three degrees of freedom.

References
----------
Kahraman & Singh (1991), J. Sound Vib. 144(3), 469-506.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar, Literal

import numpy as np

from hbgear.common.ranges import NOT_NEGATIVE, POSITIVE, Range
from hbgear.gears.mesh.mesh_excitation import SCALE_LABELS, USUAL_AMPLITUDES, MeshExcitation
from hbgear.mechanics.laws.laws import Backlash
from hbgear.mechanics.laws.mesh_contacts import MeshContacts
from hbgear.mechanics.laws.vector_laws import SlidingTeeth
from hbgear.mechanics.models import System
from hbgear.mechanics.series.fourier import Series
from hbgear.mechanics.series.periodic import Phased
from hbgear.mechanics.structures.elements import Element, VectorElement

_POSITIVE = ("mu_1", "mu_2", "kappa_1", "kappa_2")


_NOT_NEGATIVE = ("zeta", "zeta_1", "zeta_2", "b", "b_1", "b_2")


@dataclass(frozen=True)
class GearRotorBearing(MeshExcitation):  # numpydoc ignore=PR02
    """Spur gear pair whose gears also move along the line of action, on bearings with radial clearance.

        y_1'' + 2 zeta_1 y_1' + kappa_1 f_1(y_1) + mu_1 [2 zeta p' + k(tau) f(p)] = -F_1
        y_2'' + 2 zeta_2 y_2' + kappa_2 f_2(y_2) - mu_2 [2 zeta p' + k(tau) f(p)] = F_2
        p'' - y_1'' + y_2'' + 2 zeta p' + k(tau) f(p) = F_m + sum_l (l Omega)^2 e_l cos(l tau)      (or sin, by `phase`)
        k(tau) = 1 - sum_l eps_l cos(l tau),   f, f_1, f_2 = backlash functions with half-gaps b, b_1, b_2

    y_1, y_2 are the displacements of pinion and gear, p = x + y_1 - y_2 - e(tau) is the mesh gap with x the relative
    rotation r_1 theta_1 - r_2 theta_2. The coordinates are q = (y_1, y_2, x). The first equation is divided by mu_1 and
    the second by mu_2, so that M = diag(1/mu_1, 1/mu_2, 1), the mesh has the direction (1, -1, 1), and all matrices are
    symmetric.

    Units are as for `SpurPair`: all lengths (y_1, y_2, p, e_l, b, b_1, b_2) over the half backlash b_c, Omega the mesh
    frequency over omega_n = sqrt(k_mean/m_c), m_c the mass of the pair, time in 1/omega_n, F_m over k_mean b_c. In the
    usual symbols of this model: zeta_1 = zeta_11, zeta = zeta_33, kappa_1 = kappa_11, mu_1 = kappa_13. zeta_13 = mu_1
    zeta is not an independent number, because the same mesh damper acts on the pinion and on the rotation; the same
    applies to the gear. F_1 and F_2 are F_b1 and F_b2, with signs such that both add to the mesh load.

    From the papers: the three coordinates, the backlash functions in the mesh and in both bearings, the mesh force in
    the equations of the bearings with the mass ratio, the preloads, and (second paper) the variable mesh stiffness.
    Added here: the signs, with y_1 and y_2 positive in the direction in which y_1 closes the mesh and energy conserved
    (the form above is symmetric), and any number of harmonics of stiffness and error. Responses of the papers have not
    been compared. Solutions are verified by time integration of the same equations, the transfer function without
    clearance, the static state and the limit mu_1, mu_2 -> 0, which is `SpurPair`.

    The bearing forces are 1/mu_i times the mesh forces, and the corrector stops at 1e-10 of the largest force. With
    F_i = 0.1 and b_i = 1 the relative error of the mesh gap is 2e-9 down to mu_i = 1e-6, but 2e-5 at 1e-7 and below;
    with ``Settings(tolerance=1e-13)`` it is 1e-9 again. Bearings with clearance but without preload cannot be solved
    below about mu_i = 1e-5 (`NoConvergence`). Gears with such large masses do not move: use `SpurPair`.

    Parameters
    ----------
    zeta : float, default 0.05
        Damping ratio of the mesh, c/(2 m_c omega_n), >= 0.
    zeta_1, zeta_2 : float, default 0.01
        Bearing dampers c_i/(2 m_i omega_n), >= 0.
    kappa_1, kappa_2 : float, default 1.25
        Bearing stiffness k_i/(m_i omega_n^2) including the shaft, > 0.
    mu_1, mu_2 : float, default 0.25
        Mass ratios m_c/m_i, > 0. In the limit of zero the gears do not move sideways and the pair is a `SpurPair`.
    F_m : float, default 0.1
        Mean load of the mesh, over k_mean b_c.
    F_1, F_2 : float, default 0.1
        Preloads of the bearings F_i/(m_i b_c omega_n^2), positive in the direction in which the loaded mesh pushes the
        gears.
    eps : tuple of float, shape (L,), optional
        Amplitudes of the mesh stiffness; () for a constant stiffness.
    e : tuple of float, shape (L,), optional
        Amplitudes of the transmission error over b_c.
    phase : {"cos", "sin"}, default "cos"
        Function of the harmonics of the transmission error.
    b : float, default 1.0
        Half backlash of the mesh, >= 0.
    b_1, b_2 : float, default 1.0
        Half clearances of the bearings over b_c, >= 0; 0 makes a bearing a linear spring.
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
    eps_lag, e_lag, reference : tuple of float, optional
        The same as in `SpurPair`.
    mesh_order : int, default 1
        Frequency of the mesh over Omega; above 1 if a torque fluctuates more slowly than the mesh.
    fluctuation : Series or None, optional
        Alternating load that is added to F_m, as in `SpurPair`.
    fluctuation_scale : float, default 1.0
        Factor of the fluctuation, for use as a continuation parameter.

    Raises
    ------
    ValueError
        If a value is out of its range or not finite.

    References
    ----------
    Kahraman & Singh (1991), J. Sound Vib. 144(3), 469-506, and 146(1), 135-156.

    Examples
    --------
    >>> import hbgear as hb
    >>> import numpy as np
    >>> pair = hb.gears.GearRotorBearing(F_m=0.2)
    >>> system = pair.system()
    >>> np.shape(system.K), [element.name for element in system.elements]
    ((3, 3), ['gap', 'bearing 1', 'bearing 2'])
    """

    zeta: float = 0.05
    zeta_1: float = 0.01
    zeta_2: float = 0.01
    kappa_1: float = 1.25
    kappa_2: float = 1.25
    mu_1: float = 0.25
    mu_2: float = 0.25
    F_m: float = 0.1
    F_1: float = 0.1
    F_2: float = 0.1
    eps: tuple[float, ...] = ()
    e: tuple[float, ...] = (0.05,)
    phase: Literal["cos", "sin"] = "cos"
    b: float = 1.0
    b_1: float = 1.0
    b_2: float = 1.0
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
        "amplitude": r"$d / b_c$ [-]",
        "zeta": r"damping ratio $\zeta$ [-]",
        "zeta_1": r"bearing damper $\zeta_1$ [-]",
        "zeta_2": r"bearing damper $\zeta_2$ [-]",
        "kappa_1": r"bearing stiffness $\kappa_1$ [-]",
        "kappa_2": r"bearing stiffness $\kappa_2$ [-]",
        "mu_1": r"mass ratio $\mu_1 = m_c/m_1$ [-]",
        "mu_2": r"mass ratio $\mu_2 = m_c/m_2$ [-]",
        "F_m": r"mean load $F_m$ [-]",
        "F_1": r"bearing preload $F_1$ [-]",
        "F_2": r"bearing preload $F_2$ [-]",
        "b": r"half backlash $b$ [-]",
        "b_1": r"half bearing clearance $b_1$ [-]",
        "b_2": r"half bearing clearance $b_2$ [-]",
        **SCALE_LABELS,
    }
    default_span: ClassVar[tuple[float, float]] = (2.0, 0.3)
    ranges: ClassVar[Mapping[str, Range]] = dict.fromkeys(_POSITIVE, POSITIVE) | dict.fromkeys(
        _NOT_NEGATIVE, NOT_NEGATIVE
    )

    usual: ClassVar[Mapping[str, Range]] = {
        **dict.fromkeys(("zeta", "zeta_1", "zeta_2"), Range(0, 1)),
        **dict.fromkeys(("F_m", "F_1", "F_2"), Range(-20, 20)),
        **dict.fromkeys(("b", "b_1", "b_2"), Range(0, 100)),
        **USUAL_AMPLITUDES,
    }

    def _friction(self, gap: Element) -> tuple[Element, ...]:
        """Return the elements of the friction between the teeth, if there is any."""
        if not isinstance(gap.law, MeshContacts) or gap.law.sliding is None:
            return ()
        turn, sliding = np.array([0.0, 0.0, 1.0]), gap.law.sliding
        directions = [np.asarray(gap.direction), sliding.lever * turn, sliding.lever_slope * turn]
        displacements = (gap.displacement, Series(), Series())
        return VectorElement(directions, SlidingTeeth(gap.law), name="friction", displacements=displacements)

    def system(self) -> System:
        """Return the equations of motion in y_1, y_2, x; the elements are "gap", "bearing 1" and "bearing 2".

        Friction between the teeth of ``contacts`` adds the elements "friction 1" to "friction 3", which act on x.
        """
        m_1, m_2 = 1 / self.mu_1, 1 / self.mu_2
        law = self.mesh_law(self.b)
        gap = Element(
            direction=[1.0, -1.0, 1.0], law=law, displacement=self.transmission_error, damping=2 * self.zeta, name="gap"
        )
        bearing_1 = Element(
            direction=[1.0, 0.0, 0.0],
            law=Backlash(b=self.b_1, k=m_1 * self.kappa_1),
            damping=2 * m_1 * self.zeta_1,
            name="bearing 1",
        )
        bearing_2 = Element(
            direction=[0.0, 1.0, 0.0],
            law=Backlash(b=self.b_2, k=m_2 * self.kappa_2),
            damping=2 * m_2 * self.zeta_2,
            name="bearing 2",
        )
        return System(
            M=[[m_1, 0.0, 0.0], [0.0, m_2, 0.0], [0.0, 0.0, 1.0]],
            C=None,
            K=[[0.0] * 3] * 3,
            elements=[gap, bearing_1, bearing_2, *self._friction(gap)],
            load=self.fluctuating_load([-m_1 * self.F_1, m_2 * self.F_2, self.F_m], [0.0, 0.0, 1.0]),
            dof_names=["y_1", "y_2", "x"],
        )
