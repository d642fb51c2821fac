"""Double-helical gear pair on flexible supports: two nodes per gear, 24 degrees of freedom.

    d_j = w_j^T q - e_j(tau),   force on q:  -w_j [k_mean k_j(tau) f(d_j) + c_m d_j'],   j = L, R (the two helices)
    w_j on pinion j:  [c_b s_psi, c_b c_psi, h_j s_b, h_j r_p s_b s_psi, h_j r_p s_b c_psi, r_p c_b]
    w_j on wheel j:   minus the same with r_g
    c_b = cos(beta), s_b = sin(beta), h_L = +1, h_R = -1, psi = alpha_t - phi

Every mesh term follows from w_j, so that the mesh conserves energy without damping. As published, the axial forces act
where the line of action touches the base circles of both gears; in a `Train` they act at the pitch point. f is the
backlash function with half-gap b = b_c (1 + W), k(tau) = 1 - sum_l eps_l cos(l tau), e(tau) = e_sign b_c sum_l e_l
sin(l (tau - e_phase)), tau = Omega_mesh t. Stiffness and error of the right half lag the left half by the phase
``stagger``.

Each node has x (along the centre line if phi = 0), y, z (along the shaft), and the rotations theta_x, theta_y, theta
about these axes. Uncoupled supports to ground act on all coordinates except theta. The two nodes of a shaft are joined
by a shaft section: 12 E I/l^3 (x, y), E A/l (z), G J/l (theta). The torque T drives each pinion half, -T r_g/r_p holds
each wheel half. One free motion remains, the rotation of the whole train.

Dimensionless form returned by `DoubleHelicalPair.system`: unit of length b_c, of time 1/omega_n = sqrt(m_c/k_mean), of
force k_mean b_c. A rotation enters as r theta/b_c with the base radius r of its gear. With S = diag(1 or 1/r),
q = b_c S qbar and the equations multiplied by S, the matrices remain symmetric:

    Mbar = S M S / m_c,   Cbar = S C S / (m_c omega_n),   Kbar = S K S / k_mean
    wbar = S w,           Fbar = S F / (k_mean b_c)

References
----------
Dong, Bi, Wen, Liu & Wang (2022), J. Low Freq. Noise Vib. Act. Control 41(2), 519-539.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import cos, radians, sin

import numpy as np

from hbgear.common.arrays import Array
from hbgear.gears.pairs.double_helical_geometry import NODES, DoubleHelicalGeometry
from hbgear.gears.pairs.support import AXES, reactions
from hbgear.mechanics.laws.laws import Backlash
from hbgear.mechanics.models import System
from hbgear.mechanics.series.fourier import Series
from hbgear.mechanics.series.periodic import Phased
from hbgear.mechanics.structures.elements import Element, Load, Reaction


@dataclass(frozen=True)
class DoubleHelicalPair(DoubleHelicalGeometry):  # numpydoc ignore=PR02
    """Marine double-helical gear pair of Dong et al. (2022); the module docstring states the equations.

    Element displacements and Omega are in units of b_c and omega_n. The defaults are Tables 1 and 2 of the paper.
    Values that the paper does not state are marked (reading). Their defaults take torque, backlash and error as printed
    and agree with most of its statements. ``torque=700.0, phi_deg=-10.0, mesh_helix="base"``, found by a search for
    agreement, satisfies all statements on its Figures 3 and 4.

    Parameters
    ----------
    teeth_p, teeth_g : int, optional
        Numbers of teeth of pinion and wheel.
    I_p, I_g : float, optional
        Moment of inertia of one half about each of its three axes [kg m^2].
    m_p, m_g : float, optional
        Mass of one half [kg].
    outer_p, inner_p, outer_g, inner_g : float, optional
        Diameters of the shaft section between the halves [m].
    module : float, default 6e-3
        Normal module [m].
    alpha_n_deg, beta_deg : float, optional
        Normal pressure angle and helix angle [degrees].
    phi_deg : float, default 0.0
        Angle from the centre line to the x axis [degrees] (reading: not stated).
    shaft_length : float, default 58e-3
        Length l of the shaft section between the halves [m].
    face_width : float, default 55e-3
        Face width of one half [m]; a value of the table that does not enter the equations.
    k_mean : float, default 1.8456e9
        Mean mesh stiffness of one half [N/m].
    zeta : float, default 0.063
        Damping ratio of the mesh, and of all dampers for which the paper states no value.
    k_px, k_py, k_pz, k_gx, k_gy, k_gz : float, optional
        Support stiffness of each node [N/m]. The pinion floats: k_pz = 0.
    c_px, c_py, c_pz, c_gx, c_gy, c_gz : float, optional
        Support dampers [N s/m]. As published, the y supports are far above critical damping, with damping ratios 17.6
        (pinion) and 10.7 (wheel), and c_y is 32 times c_x; these values are kept.
    k_pthx, k_pthy, k_gthx, k_gthy : float, optional
        Tilt stiffness of each node [N m/rad]; its dampers are 2 zeta sqrt(k I).
    E, poisson : float, optional
        Young's modulus [N/m^2] and Poisson's ratio of the shafts (reading: not stated).
    torque : float, default 1400.0
        Torque T on each half of the pinion [N m] (reading: the load of the paper acts on each half, not on both
        together).
    b_c : float, default 25e-6
        Average half backlash, the unit of length [m] (reading: half the 50 um of the test rig).
    W : float, default 0.0
        Change of the half backlash, b = b_c (1 + W), >= -1.
    eps : tuple of float, shape (L,), optional
        Amplitudes of the mesh stiffness.
    e : tuple of float, shape (L,), optional
        Amplitudes of the transmission error in units of b_c.
    eps_scale, e_scale : float, default 1.0
        Factors of all eps_l and all e_l, for use as continuation parameters.
    e_sign : int, default -1
        Sign of the transmission error, +1 or -1 (reading: -1).
    e_phase : float, default 0.0
        Phase by which the transmission error lags the mesh stiffness [rad], l times as much in harmonic l.
    stagger : float, default 0.0
        Phase by which stiffness and error of the right half lag the left half [rad].
    support_damping : {"tabulated", "zeta"}, default "tabulated"
        Source of the support dampers: the c_ values, or "zeta" for c = 2 zeta sqrt(k m).
    tilt : bool, default True
        Tilts are coupled to the mesh. False removes them from the mesh vector, so that they stay zero.
    mesh_helix : {"pitch", "base"}, default "pitch"
        Circle whose helix angle is beta in the mesh vector.
    stiffness : Phased or None, optional
        Mesh stiffness k_L(tau) of the left half over k_mean, a `Series` or a `Periodic`, instead of eps, which must be
        ().
    error : Phased or None, optional
        Transmission error e(tau) of the left half over b_c instead of e, before its sign and lag; a `Series` or a
        `Periodic`.

    Raises
    ------
    ValueError
        If a value is out of its range or not finite.

    Examples
    --------
    >>> import hbgear as hb
    >>> pair = hb.gears.DoubleHelicalPair(zeta=0.05)
    >>> round(pair.pinion_speed(1.0)), round(pair.mesh_frequency(1.0))
    (12279, 5116)
    """

    # Equations of motion in SI units

    def _node(self, gear: str) -> tuple[Array, Array, Array]:
        """Return inertia, support dampers and support stiffness (6,) of one half of a gear, "p" or "g"."""
        m, inertia = getattr(self, f"m_{gear}"), getattr(self, f"I_{gear}")
        M = np.array([m, m, m, inertia, inertia, inertia])
        K = np.array([getattr(self, f"k_{gear}{axis}") for axis in ("x", "y", "z", "thx", "thy")] + [0.0])
        C = 2 * self.zeta * np.sqrt(K * M)
        if self.support_damping == "tabulated":
            C[:3] = [getattr(self, f"c_{gear}{axis}") for axis in "xyz"]
        return M, C, K

    def structure(self) -> tuple[Array, Array, Array]:
        """Return M, C, K (24, 24) without the mesh, in SI units (force rows N, moment rows N m)."""
        M, C, K = np.zeros((3, 24, 24))
        for first, gear, shaft in ((0, "p", self.shaft_p), (6, "g", self.shaft_g)):
            inertia, c, k = self._node(gear)
            k_shaft = np.array([shaft.bending, shaft.bending, shaft.axial, 0.0, 0.0, shaft.torsional])
            # two halves vibrate against each other: half the mass
            c_shaft = 2 * self.zeta * np.sqrt(k_shaft * inertia / 2)
            for node, opposite in ((first, first + 12), (first + 12, first)):
                rows, columns = np.arange(node, node + 6), np.arange(opposite, opposite + 6)
                M[rows, rows], C[rows, rows], K[rows, rows] = inertia, c + c_shaft, k + k_shaft
                C[rows, columns], K[rows, columns] = -c_shaft, -k_shaft
        return M, C, K

    @property
    def reactions(self) -> dict[str, Reaction]:
        """Radial and axial forces in the supports of the four halves, over k_mean b_c."""
        halves = [self._node(name[0]) for name in NODES]
        C, K = (np.concatenate([half[i] for half in halves]) for i in (1, 2))
        return reactions(NODES, K / self.k_mean, C / (self.m_c * self.omega_n))

    def mesh_vectors(self) -> Array:
        """Return w_L and w_R as columns (24, 2), in SI units."""
        c_b, s_b = cos(self.beta_mesh), sin(self.beta_mesh)
        psi = self.alpha_t - radians(self.phi_deg)
        w = np.zeros((2, 2, 2, 6))  # helix of the element, helix of the node, gear, axis
        for helix, hand in ((0, 1.0), (1, -1.0)):
            for gear, (sign, r) in enumerate(((1.0, self.r_p), (-1.0, self.r_g))):
                tilt = hand * r * s_b if self.tilt else 0.0
                w[helix, helix, gear] = sign * np.array(
                    [c_b * sin(psi), c_b * cos(psi), hand * s_b, tilt * sin(psi), tilt * cos(psi), r * c_b]
                )
        return w.reshape(2, 24).T

    def torques(self) -> Array:
        """Return the constant load (24,) in SI units: T on each pinion half, -T r_g/r_p on each wheel half."""
        load = np.zeros((4, 6))
        load[:, 5] = np.tile([self.torque, -self.torque * self.r_g / self.r_p], 2)
        return load.ravel()

    # The dimensionless system

    @property
    def transmission_error(self) -> Phased:
        """Transmission error e(tau) of the left half, in units of b_c."""
        e = Series(sine=self.e) if self.error is None else self.error
        return e.scaled(self.e_sign * self.e_scale).shifted(self.e_phase)

    @property
    def mesh_names(self) -> tuple[str, str]:
        """Names of the elements that are meshes, of the left and the right half."""
        return "gap L", "gap R"

    def system(self) -> System:
        """Return the dimensionless equations of motion with the elements "gap L" and "gap R".

        The module docstring states the scaling.
        """
        S, m_c, omega_n = self._scale(), self.m_c, self.omega_n
        M, C, K = self.structure()
        stiffness, error = self.mesh_stiffness, self.transmission_error
        gaps = [
            Element(
                direction=S * w,
                law=Backlash(b=1 + self.W, stiffness=stiffness.shifted(lag)),
                displacement=error.shifted(lag),
                damping=2 * self.zeta,
                name=name,
            )
            for w, lag, name in zip(self.mesh_vectors().T, (0.0, self.stagger), self.mesh_names, strict=True)
        ]
        SS = np.outer(S, S)
        return System(
            M=SS * M / m_c,
            C=SS * C / (m_c * omega_n),
            K=SS * K / self.k_mean,
            elements=gaps,
            load=Load(constant=S * self.torques() / (self.k_mean * self.b_c)),
            dof_names=[f"{axis}_{node}" for node in NODES for axis in AXES],
        )
