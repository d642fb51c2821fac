"""Gears, shafts and supports of a `DoubleHelicalPair`: checks, geometry, reference quantities and units."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from math import pi, radians, sqrt
from typing import ClassVar, Literal

import numpy as np

from hbgear.common.argument_checks import checked_arguments
from hbgear.common.arrays import Array
from hbgear.common.ranges import NOT_NEGATIVE, POSITIVE, Range, counted
from hbgear.gears.drawing.geometry import (
    ShaftStiffness,
    base_helix_angle,
    base_radius,
    shaft_stiffness,
    transverse_pressure_angle,
)
from hbgear.gears.mesh.mesh_excitation import USUAL_AMPLITUDES, MeshExcitation
from hbgear.gears.pairs.support import AXES
from hbgear.mechanics.series.periodic import Phased
from hbgear.mechanics.structures.scales import Numbers, Scales

NODES = ("pL", "gL", "pR", "gR")


ROTATIONS = slice(3, 6)


_SIZES = ("outer_p", "outer_g", "module", "shaft_length", "face_width")


_POSITIVE = ("I_p", "I_g", "m_p", "m_g", "k_mean", "E", "b_c", *_SIZES)


_SUPPORTS = ("k_px", "k_py", "k_pz", "k_gx", "k_gy", "k_gz", "c_px", "c_py", "c_pz", "c_gx", "c_gy", "c_gz")


_NOT_NEGATIVE = ("zeta", "inner_p", "inner_g", "k_pthx", "k_pthy", "k_gthx", "k_gthy", *_SUPPORTS)


@dataclass(frozen=True)
class DoubleHelicalGeometry(MeshExcitation):
    """Gears, shafts and supports of a double-helical pair with their units; `DoubleHelicalPair` states the fields."""

    teeth_p: int = 25
    teeth_g: int = 75
    I_p: float = 0.012
    I_g: float = 0.7279
    m_p: float = 7.11
    m_g: float = 64.75
    outer_p: float = 92e-3
    inner_p: float = 55e-3
    outer_g: float = 260e-3
    inner_g: float = 70e-3
    module: float = 6e-3
    alpha_n_deg: float = 20.0
    beta_deg: float = 24.43
    phi_deg: float = 0.0
    shaft_length: float = 58e-3
    face_width: float = 55e-3
    k_mean: float = 1.8456e9
    zeta: float = 0.063
    k_px: float = 1.5424e9
    k_py: float = 1.5746e9
    k_pz: float = 0.0
    k_gx: float = 1.6741e9
    k_gy: float = 4.5124e8
    k_gz: float = 1.3454e8
    c_px: float = 1.1745e5
    c_py: float = 3.7145e6
    c_pz: float = 0.0
    c_gx: float = 1.1500e5
    c_gy: float = 3.6500e6
    c_gz: float = 0.2416e5
    k_pthx: float = 2.3809e9
    k_pthy: float = 3.3607e8
    k_gthx: float = 2.3988e9
    k_gthy: float = 3.3607e8
    E: float = 2.06e11
    poisson: float = 0.3
    torque: float = 1400.0
    b_c: float = 25e-6
    W: float = 0.0
    eps: tuple[float, ...] = (0.16, 0.07, 0.03)
    e: tuple[float, ...] = (0.03, 0.01, 0.01)
    eps_scale: float = 1.0
    e_scale: float = 1.0
    e_sign: int = -1
    e_phase: float = 0.0
    stagger: float = 0.0
    support_damping: Literal["tabulated", "zeta"] = "tabulated"
    tilt: bool = True
    mesh_helix: Literal["pitch", "base"] = "pitch"
    stiffness: Phased | None = None
    error: Phased | None = None

    labels: ClassVar[Mapping[str, str]] = {
        "Omega": r"$\Omega = \omega_\mathrm{mesh}/\omega_n$ [-]",
        "amplitude": r"$d / b_c$ [-]",
        "I_p": r"$I_p$ [kg m$^2$]",
        "I_g": r"$I_g$ [kg m$^2$]",
        "m_p": r"$m_p$ [kg]",
        "m_g": r"$m_g$ [kg]",
        "outer_p": r"pinion shaft $D_p$ [m]",
        "inner_p": r"pinion shaft $d_p$ [m]",
        "outer_g": r"wheel shaft $D_g$ [m]",
        "inner_g": r"wheel shaft $d_g$ [m]",
        "module": r"normal module $m_n$ [m]",
        "alpha_n_deg": r"$\alpha_n$ [deg]",
        "beta_deg": r"helix angle $\beta$ [deg]",
        "phi_deg": r"$\varphi$ [deg]",
        "shaft_length": r"shaft section $l$ [m]",
        "face_width": r"face width [m]",
        "k_mean": r"$k_\mathrm{mean}$ [N/m]",
        "zeta": r"damping ratio $\zeta$ [-]",
        **{name: rf"${name[0]}_{{{name[2:]}}}$ [{'N/m' if name[0] == 'k' else 'N s/m'}]" for name in _SUPPORTS},
        "k_pthx": r"$k_{p\theta x}$ [N m/rad]",
        "k_pthy": r"$k_{p\theta y}$ [N m/rad]",
        "k_gthx": r"$k_{g\theta x}$ [N m/rad]",
        "k_gthy": r"$k_{g\theta y}$ [N m/rad]",
        "E": r"$E$ [N/m$^2$]",
        "poisson": r"Poisson's ratio $\nu$ [-]",
        "torque": r"torque per pinion half $T$ [N m]",
        "b_c": r"average half backlash $b_c$ [m]",
        "W": r"change of backlash $W$ [-]",
        "eps_scale": r"factor of the stiffness amplitudes $\varepsilon_l$ [-]",
        "e_scale": r"factor of the error amplitudes $e_l$ [-]",
        "e_phase": r"lag of the error [rad]",
        "stagger": r"stagger of the halves [rad]",
    }
    default_span: ClassVar[tuple[float, float]] = (1.6, 0.2)
    ranges: ClassVar[Mapping[str, Range]] = {
        **dict.fromkeys(_POSITIVE, POSITIVE),
        **dict.fromkeys(_NOT_NEGATIVE, NOT_NEGATIVE),
        "alpha_n_deg": Range(above=0, below=90),
        "beta_deg": Range(above=-90, below=90),
        "poisson": Range(above=-1, high=0.5),
        "W": Range(low=-1),  # W = -1: the half backlash b_c (1 + W) is zero
    }
    usual: ClassVar[Mapping[str, Range]] = {
        **dict.fromkeys(("I_p", "I_g"), Range(1e-8, 1e6)),
        **dict.fromkeys(("m_p", "m_g"), Range(1e-4, 1e6)),
        **dict.fromkeys(("outer_p", "outer_g", "shaft_length", "face_width"), Range(1e-3, 10)),
        "module": Range(1e-4, 0.1),
        "alpha_n_deg": Range(5, 45),
        "phi_deg": Range(-360, 360),
        "k_mean": Range(1e5, 1e12),
        "zeta": Range(0, 1),
        "E": Range(1e8, 1e12),
        "torque": Range(-1e8, 1e8),
        "b_c": Range(1e-7, 5e-3),
        "W": Range(-1, 100),
        **USUAL_AMPLITUDES,
        "e_phase": Range(-2 * pi, 2 * pi),
        "stagger": Range(-2 * pi, 2 * pi),
    }

    def __post_init__(self) -> None:
        super().__post_init__()
        for gear in "pg":
            inner, outer = getattr(self, f"inner_{gear}"), getattr(self, f"outer_{gear}")
            if not inner < outer:
                raise ValueError(
                    f"DoubleHelicalPair: inner_{gear} = {inner} must be smaller than outer_{gear} = {outer}"
                )
        for name in ("teeth_p", "teeth_g"):
            counted(f"DoubleHelicalPair: {name}", getattr(self, name))
        if self.e_sign not in (-1, 1):
            raise ValueError(f"DoubleHelicalPair: e_sign = {self.e_sign!r} must be -1 or 1")

    # Geometry and reference quantities

    @property
    def alpha_t(self) -> float:
        """Transverse pressure angle [rad]."""
        return transverse_pressure_angle(radians(self.alpha_n_deg), self.beta)

    @property
    def beta(self) -> float:
        """Helix angle at the pitch circle [rad]."""
        return radians(self.beta_deg)

    @property
    def beta_mesh(self) -> float:
        """Helix angle of the mesh vector [rad], by `mesh_helix`."""
        return self.beta if self.mesh_helix == "pitch" else base_helix_angle(radians(self.alpha_n_deg), self.beta)

    @property
    def r_p(self) -> float:
        """Base radius of the pinion [m]."""
        return base_radius(self.teeth_p, self.module, radians(self.alpha_n_deg), self.beta)

    @property
    def r_g(self) -> float:
        """Base radius of the wheel [m]."""
        return base_radius(self.teeth_g, self.module, radians(self.alpha_n_deg), self.beta)

    @property
    def m_c(self) -> float:
        """Equivalent mass of one mesh [kg].

        m_c = I_p I_g / (I_p r_g^2 + I_g r_p^2)
        """
        return self.I_p * self.I_g / (self.I_p * self.r_g**2 + self.I_g * self.r_p**2)

    @property
    def omega_n(self) -> float:
        """Reference angular frequency sqrt(k_mean / m_c) [rad/s]."""
        return sqrt(self.k_mean / self.m_c)

    @property
    def c_m(self) -> float:
        """Mesh damper 2 zeta sqrt(m_c k_mean) of one half [N s/m]."""
        return 2 * self.zeta * sqrt(self.m_c * self.k_mean)

    @property
    def shaft_p(self) -> ShaftStiffness:
        """Shaft section between the two pinion halves."""
        return shaft_stiffness(self.E, self.poisson, self.outer_p, self.inner_p, self.shaft_length)

    @property
    def shaft_g(self) -> ShaftStiffness:
        """Shaft section between the two wheel halves."""
        return shaft_stiffness(self.E, self.poisson, self.outer_g, self.inner_g, self.shaft_length)

    # Units

    @checked_arguments()
    def mesh_frequency(self, Omega: Numbers) -> Numbers:
        """Return the mesh frequency Omega omega_n / (2 pi) [Hz]."""
        return self.scales.mesh_frequency(Omega)

    @checked_arguments()
    def from_mesh_frequency(self, frequency: Numbers) -> Numbers:
        """Return Omega at a mesh frequency [Hz]."""
        return self.scales.from_mesh_frequency(frequency)

    @checked_arguments()
    def pinion_speed(self, Omega: Numbers) -> Numbers:
        """Return the pinion speed 60 mesh_frequency / teeth_p [r/min]."""
        return self.scales.pinion_speed(Omega)

    @checked_arguments()
    def from_pinion_speed(self, speed: Numbers) -> Numbers:
        """Return Omega at a pinion speed [r/min]."""
        return self.scales.from_pinion_speed(speed)

    @property
    def scales(self) -> Scales:
        return Scales(self.omega_n, self.b_c, self.k_mean * self.b_c, self.teeth_p)

    @property
    def units(self) -> Array:
        """Physical size of a coordinate of value one, shape (24,): b_c [m], for a rotation b_c / r [rad].

        ``q = units * qbar``. Velocities have an additional factor omega_n, accelerations omega_n^2. Element
        displacements are in b_c [m], mesh forces in k_mean b_c [N].
        """
        return self.b_c * self._scale()

    def _scale(self) -> Array:
        """Return the diagonal of S: 1 for translations, 1/r for rotations."""
        scale = np.ones((len(NODES), len(AXES)))
        for node, name in enumerate(NODES):
            scale[node, ROTATIONS] = 1 / (self.r_p if name[0] == "p" else self.r_g)
        return scale.ravel()
