"""One gear pair in space: both gears move in all six directions on their shafts and bearings, 12 degrees of freedom.

    d = w^T q - e(tau),   force on q:  -w [k_mean k(tau) f(d) + c_m d']
    w = (n, r_P x n) on the pinion,   w = -(n, r_G x n) on the wheel
    n = (sin(alpha_wt), cos(alpha_wt), -tan(beta_b)),   rotated by phi about z

n is the normal of the driving flank divided by its component in the transverse plane. Hence d, e, k and the half gap b
are measured along the line of action in that plane, and w has the base radii at both rotations. r_P = (r_wp, 0, 0) and
r_G = (-r_wg, 0, 0), for a ring gear (+r_wg, 0, 0), point from the centres of the gears to the pitch point in the middle
of the face. z is parallel to the shafts and the wheel lies in the direction phi from the pinion. beta_b > 0 is a
right-hand pinion, and the torque T > 0 turns it from x to y; T r_bg / r_bp holds the wheel. f is the backlash function
with half gap b. k(tau) and e(tau) are defined as in `SpurPair`, tau = Omega_mesh t.

Dimensionless form returned by `HelicalPair.system`: unit of length b_c, of time 1/omega_n = sqrt(m_c/k_mean), of force
k_mean b_c. A rotation enters as r_b theta / b_c with the base radius of its gear, as in `DoubleHelicalPair`.

References
----------
Kahraman (1993), J. Mech. Des. 115(1), 33-39 (a helical pair that moves along and across its shafts).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from math import cos, pi, radians, sin, sqrt, tan
from typing import ClassVar

import numpy as np

from hbgear.common.arrays import Array
from hbgear.common.ranges import NOT_NEGATIVE, POSITIVE, Range, counted
from hbgear.gears.mesh.mesh_excitation import SCALE_LABELS, USUAL_AMPLITUDES, MeshExcitation
from hbgear.gears.pairs.support import AXES, reactions
from hbgear.mechanics.laws.mesh_contacts import MeshContacts
from hbgear.mechanics.laws.vector_laws import SlidingTeeth
from hbgear.mechanics.models import System
from hbgear.mechanics.series.fourier import Series
from hbgear.mechanics.series.periodic import Phased
from hbgear.mechanics.structures.elements import Element, Reaction, VectorElement
from hbgear.mechanics.structures.scales import Scales

_POSITIVE = ("r_p", "r_g", "m_p", "m_g", "I_p", "I_g", "D_p", "D_g", "k_mean", "b_c")
_NOT_NEGATIVE = ("zeta", "zeta_p", "zeta_g", "b", "k_p", "k_g", "k_pz", "k_gz", "k_pt", "k_gt")


@dataclass(frozen=True)
class HelicalPair(MeshExcitation):  # numpydoc ignore=PR02
    """Helical or spur gear pair on flexible shafts and bearings in space; the module docstring states the equations.

    Element displacements and Omega are in units of b_c and omega_n. `GearPair.model` builds it from a drawing. The
    defaults are a pair of 25 and 40 teeth, module 3 mm, helix angle 15 degrees, 20 mm wide, with backlash 80 um.

    Parameters
    ----------
    teeth_p, teeth_g : int, optional
        Numbers of teeth of pinion and wheel.
    r_p, r_g : float, optional
        Base radii [m].
    alpha_deg : float, default 20.65
        Working transverse pressure angle [degrees].
    beta_deg : float, default 14.08
        Helix angle at the base circle [degrees], positive for a right-hand pinion.
    phi_deg : float, default 0.0
        Direction from pinion to wheel, from the x axis [degrees].
    internal : bool, default False
        True if the wheel is a ring gear.
    m_p, m_g : float, optional
        Masses [kg].
    I_p, I_g : float, optional
        Moments of inertia about the shafts [kg m^2].
    D_p, D_g : float, optional
        Moments of inertia about a diameter [kg m^2].
    k_p, k_g : float, default 3e8
        Radial stiffness of the supports [N/m].
    k_pz, k_gz : float, default 1e8
        Axial stiffness of the supports [N/m].
    k_pt, k_gt : float, default 5e5
        Tilt stiffness of the supports [N m/rad].
    zeta_p, zeta_g : float, default 0.02
        Damping ratios of the supports, 2 zeta sqrt(k m).
    k_mean : float, default 3.7e8
        Mean mesh stiffness in the transverse plane [N/m].
    zeta : float, default 0.04
        Damping ratio of the mesh, c_m = 2 zeta sqrt(m_c k_mean).
    torque : float, default 200.0
        Torque T on the pinion [N m].
    b_c : float, default 37.4e-6
        Unit of length [m], the half backlash along the line of action in the transverse plane.
    b : float, default 1.0
        Half backlash over b_c.
    eps, eps_lag : tuple of float, shape (L,), optional
        Amplitudes and lags of the mesh stiffness over k_mean.
    e, e_lag : tuple of float, shape (L,), optional
        Amplitudes over b_c and lags of the transmission error.
    eps_scale, e_scale : float, default 1.0
        Factors of all eps_l and all e_l, for use as continuation parameters.
    stiffness, error : Phased or None, optional
        Mesh stiffness k(tau) over k_mean and transmission error e(tau) over b_c instead of eps and e, as in `SpurPair`.
    contacts : MeshContacts or None, optional
        Contacts of a tooth-resolved mesh instead of eps and stiffness: stiffness over k_mean and initial gaps over b_c,
        without backlash. `GearPair.model` computes them from a drawing.
    mesh_order : int, default 1
        Frequency of the mesh over Omega; above 1 if a torque fluctuates more slowly than the mesh.
    fluctuation : Series or None, optional
        Alternating torque T(tau) on the pinion over r_p k_mean b_c, a function of the phase of Omega.
    fluctuation_scale : float, default 1.0
        Factor of the fluctuation, for use as a continuation parameter.
    output : float or None, default None
        Power of the wheel over that of the pinion: the static efficiency of the mesh, or its reciprocal if the wheel
        drives. None without losses. It belongs to the friction of ``contacts`` and is no continuation parameter.

    Raises
    ------
    ValueError
        If a value is out of its range or not finite.

    Examples
    --------
    >>> import hbgear as hb
    >>> pair = hb.gears.HelicalPair(e=(0.05,))
    >>> pair.system().n, round(pair.scales.pinion_speed(1.0))
    (12, 13504)
    """

    teeth_p: int = 25
    teeth_g: int = 40
    r_p: float = 36.3e-3
    r_g: float = 58.1e-3
    alpha_deg: float = 20.65
    beta_deg: float = 14.08
    phi_deg: float = 0.0
    internal: bool = False
    m_p: float = 0.73
    m_g: float = 1.88
    I_p: float = 5.4e-4
    I_g: float = 3.6e-3
    D_p: float = 3.0e-4
    D_g: float = 1.9e-3
    k_p: float = 3e8
    k_g: float = 3e8
    k_pz: float = 1e8
    k_gz: float = 1e8
    k_pt: float = 5e5
    k_gt: float = 5e5
    zeta_p: float = 0.02
    zeta_g: float = 0.02
    k_mean: float = 3.7e8
    zeta: float = 0.04
    torque: float = 200.0
    b_c: float = 37.4e-6
    b: float = 1.0
    eps: tuple[float, ...] = (0.15, 0.04)
    e: tuple[float, ...] = ()
    eps_lag: tuple[float, ...] = ()
    e_lag: tuple[float, ...] = ()
    eps_scale: float = 1.0
    e_scale: float = 1.0
    stiffness: Phased | None = None
    error: Phased | None = None
    contacts: MeshContacts | None = None
    mesh_order: int = 1
    fluctuation: Series | None = None
    fluctuation_scale: float = 1.0
    output: float | None = None

    labels: ClassVar[Mapping[str, str]] = {
        "Omega": r"$\Omega = \omega_\mathrm{mesh}/\omega_n$ [-]",
        "amplitude": r"$d / b_c$ [-]",
        "r_p": r"base radius $r_p$ [m]",
        "r_g": r"base radius $r_g$ [m]",
        "alpha_deg": r"$\alpha_{wt}$ [deg]",
        "beta_deg": r"$\beta_b$ [deg]",
        "phi_deg": r"$\varphi$ [deg]",
        "m_p": r"$m_p$ [kg]",
        "m_g": r"$m_g$ [kg]",
        "I_p": r"$I_p$ [kg m$^2$]",
        "I_g": r"$I_g$ [kg m$^2$]",
        "D_p": r"$D_p$ [kg m$^2$]",
        "D_g": r"$D_g$ [kg m$^2$]",
        "k_p": r"radial $k_p$ [N/m]",
        "k_g": r"radial $k_g$ [N/m]",
        "k_pz": r"axial $k_{pz}$ [N/m]",
        "k_gz": r"axial $k_{gz}$ [N/m]",
        "k_pt": r"tilt $k_{pt}$ [N m/rad]",
        "k_gt": r"tilt $k_{gt}$ [N m/rad]",
        "zeta_p": r"damping ratio of the support $\zeta_p$ [-]",
        "zeta_g": r"damping ratio of the support $\zeta_g$ [-]",
        "k_mean": r"$k_\mathrm{mean}$ [N/m]",
        "zeta": r"damping ratio $\zeta$ [-]",
        "torque": r"torque $T$ [N m]",
        "b_c": r"unit of length $b_c$ [m]",
        "b": r"half backlash $b$ [-]",
        **SCALE_LABELS,
    }
    default_span: ClassVar[tuple[float, float]] = (1.6, 0.3)
    ranges: ClassVar[Mapping[str, Range]] = {
        **dict.fromkeys(_POSITIVE, POSITIVE),
        **dict.fromkeys(_NOT_NEGATIVE, NOT_NEGATIVE),
        "alpha_deg": Range(above=0, below=90),
        "beta_deg": Range(above=-90, below=90),
    }
    usual: ClassVar[Mapping[str, Range]] = {
        **dict.fromkeys(("r_p", "r_g"), Range(1e-3, 10)),
        **dict.fromkeys(("m_p", "m_g"), Range(1e-4, 1e6)),
        **dict.fromkeys(("I_p", "I_g", "D_p", "D_g"), Range(1e-10, 1e7)),
        **dict.fromkeys(("zeta", "zeta_p", "zeta_g"), Range(0, 1)),
        "alpha_deg": Range(5, 45),
        "phi_deg": Range(-360, 360),
        "k_mean": Range(1e5, 1e12),
        "torque": Range(-1e8, 1e8),
        "b_c": Range(1e-8, 5e-3),
        "b": Range(0, 100),
        **USUAL_AMPLITUDES,
    }

    def __post_init__(self) -> None:
        super().__post_init__()
        for name in ("teeth_p", "teeth_g"):
            counted(f"HelicalPair: {name}", getattr(self, name))

    @property
    def m_c(self) -> float:
        """Equivalent mass 1 / (r_p^2/I_p + r_g^2/I_g) [kg]."""
        return 1 / (self.r_p**2 / self.I_p + self.r_g**2 / self.I_g)

    @property
    def omega_n(self) -> float:
        """Reference angular frequency sqrt(k_mean / m_c) [rad/s]."""
        return sqrt(self.k_mean / self.m_c)

    @property
    def scales(self) -> Scales:
        return Scales(self.omega_n, self.b_c, self.k_mean * self.b_c, self.teeth_p, self.mesh_order)

    @property
    def units(self) -> Array:
        """Physical size of a coordinate of value one, shape (12,): b_c [m], for a rotation b_c / r [rad]."""
        return self.b_c * self._scale()

    def _scale(self) -> Array:
        return np.concatenate([np.repeat([1.0, 1 / r], 3) for r in (self.r_p, self.r_g)])

    # Equations of motion in SI units

    def structure(self) -> tuple[Array, Array, Array]:
        """Return M, C, K (12, 12) without the mesh, in SI units (force rows N, moment rows N m)."""
        M, C, K = [], [], []
        for g in "pg":
            m, polar, transverse = (getattr(self, f"{name}_{g}") for name in "mID")
            inertia = np.array([m, m, m, transverse, transverse, polar])
            radial, axial, tilt = (getattr(self, f"k_{g}{end}") for end in ("", "z", "t"))
            stiffness = np.array([radial, radial, axial, tilt, tilt, 0.0])
            M.append(inertia)
            K.append(stiffness)
            C.append(2 * getattr(self, f"zeta_{g}") * np.sqrt(stiffness * inertia))
        return np.diag(np.concatenate(M)), np.diag(np.concatenate(C)), np.diag(np.concatenate(K))

    @property
    def reactions(self) -> dict[str, Reaction]:
        """Radial and axial forces in the supports of both gears, over k_mean b_c."""
        _, C, K = self.structure()
        return reactions(("pinion", "wheel"), np.diag(K) / self.k_mean, np.diag(C) / (self.m_c * self.omega_n))

    def mesh_vector(self) -> Array:
        """Return the direction w (12,) of the gap, in SI units."""
        n = self._tangent(0.5 * pi) - tan(radians(self.beta_deg)) * np.array([0.0, 0.0, 1.0])
        return self._at_pitch_point(n)

    def friction_vectors(self) -> Array:
        """Return the directions (2, 12) of the friction between the teeth, in SI units.

        The first one is across the line of action at the pitch point, the second one a torque on both gears over r_p.
        """
        torque = self.r_p * np.array([0.0, 0.0, 1.0])
        return np.array(
            [self._at_pitch_point(self._tangent(pi)), np.concatenate([0 * torque, torque, 0 * torque, -torque])]
        )

    def _tangent(self, angle: float) -> Array:
        """Return the unit vector at an angle from the normal of the driving flank, minus 90 degrees."""
        phi, turn = radians(self.phi_deg), angle - radians(self.alpha_deg)
        e_phi, e_normal = np.array([cos(phi), sin(phi), 0.0]), np.array([-sin(phi), cos(phi), 0.0])
        return cos(turn) * e_phi + sin(turn) * e_normal

    def _at_pitch_point(self, n: Array) -> Array:
        """Return the displacement of the pinion relative to the wheel at the pitch point along a vector (3,)."""
        alpha, phi = radians(self.alpha_deg), radians(self.phi_deg)
        e_phi = np.array([cos(phi), sin(phi), 0.0])
        to_pinion = self.r_p / cos(alpha) * e_phi
        to_wheel = (1 if self.internal else -1) * self.r_g / cos(alpha) * e_phi
        return np.concatenate([n, np.cross(to_pinion, n), -n, -np.cross(to_wheel, n)])

    def torques(self) -> Array:
        """Return the constant load (12,) in SI units: T on the pinion and the reaction on the wheel."""
        w, load = self.mesh_vector(), np.zeros(12)
        load[5], load[11] = self.torque, (self.output or 1.0) * self.torque * w[11] / w[5]
        return load

    # The dimensionless system

    def system(self) -> System:
        """Return the dimensionless equations of motion with the element "gap".

        The module docstring states the scaling. Friction between the teeth of ``contacts`` adds the elements "friction
        1" to "friction 3".
        """
        S, m_c, omega_n = self._scale(), self.m_c, self.omega_n
        M, C, K = self.structure()
        SS, force = np.outer(S, S), self.k_mean * self.b_c
        gap = Element(
            direction=S * self.mesh_vector(),
            law=self.mesh_law(self.b),
            displacement=self.transmission_error,
            damping=2 * self.zeta,
            name="gap",
        )
        elements, load = [gap], self.torques()
        fluctuating = self.r_p * np.eye(12)[5]
        if isinstance(gap.law, MeshContacts) and gap.law.sliding is not None:
            friction = S * _without_rotation(self.friction_vectors(), self.mesh_vector(), M)
            displacements = (gap.displacement, Series(), Series())
            law = SlidingTeeth(gap.law)
            elements += VectorElement([gap.direction, *friction], law, name="friction", displacements=displacements)
            load, fluctuating = _without_rotation(np.array([load, fluctuating]), self.mesh_vector(), M)
        return System(
            M=SS * M / m_c,
            C=SS * C / (m_c * omega_n),
            K=SS * K / self.k_mean,
            elements=elements,
            load=self.fluctuating_load(S * load / force, S * fluctuating),
            dof_names=[f"{axis}_{gear}" for gear in "pg" for axis in AXES],
        )


def _without_rotation(vectors: Array, w: Array, M: Array) -> Array:
    """Return generalised forces (..., 12) in SI units without the part that turns both gears together.

    With friction, forces do work on this motion. Its mean speed is constant, and no element measures it; the part
    M phi (phi^T F) / (phi^T M phi) is removed, and all other motions stay the same.
    """
    turn = np.zeros(12)
    turn[5], turn[11] = w[11], -w[5]
    inertia = M @ turn
    return vectors - np.multiply.outer(vectors @ turn, inertia / (turn @ inertia))
