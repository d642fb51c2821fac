"""Friction between the teeth: a coefficient over the path of contact, and its forces on the contacts of a mesh.

Every pair of teeth of a drawing has its own normal force N. Friction acts on the pinion against the velocity with which
its surface slides on that of the wheel, v_s = (omega_1 +- omega_2) (s - s_P) p_b, which changes its sign at the pitch
point. The normal force is the transverse one over cos(beta_b). omega are the mean speeds; vibration does not reverse
the sliding. `ToothSliding` states the forces.

    F_m = T / r_b1 (side + lever a + lever_slope b) / (side + lever a + b),   T_2 omega_2 / (T omega_1) = 1 - relative b
    / (side + lever a + b)

T is the mean torque on the pinion, a and b are the means of ``across`` and ``slide`` over N in the static state without
friction, side = -1 if the wheel drives. The second equation is the static efficiency, or its reciprocal.

Benedict and Kelley fitted the coefficient to tests of rollers in the range between boundary and hydrodynamic
lubrication:

    mu = 0.0127 50 / (50 - S) log10(3.17e8 w / (eta v_s v_r^2))

with the roughness S [microinch, rms], the force per width w [lb/in], the viscosity eta [cP] at the temperature of the
teeth and the sliding and sum velocities v_s and v_r [in/s]. It grows without bound towards the pitch point, where v_s
is replaced by its value at `PITCH_REGION`, and it is negative at high speeds, where it is refused. The constants were
not compared with the text of 1961; its abstract confirms the signs of all dependences.

For a mesh of one stiffness, with factors of the force along the line of action:

    along(tau) = sum over pairs [1 + mu sign(s - s_P) (lever + lever_slope (s - s_P))] / eps
    across(tau) = sum over pairs mu sign(s - s_P) / eps,       s = tau / (2 pi), tau / (2 pi) + 1, ...   with s < eps

s is the position of a pair of teeth on the path of contact, in base pitches from its begin, and s_P the pitch point,
where the sliding velocity changes its sign. Before it (approach) friction assists the pinion that drives; behind it
(recess) it brakes. All pairs have the same stiffness. With the inertias J, base radii r and base pitch p_b

    lever = m_c (r_1 rho_1 / J_1 + r_2 rho_2 / J_2) at the pitch point,   lever_slope = m_c p_b (r_1 / J_1 - r_2 / J_2)

where rho are the radii of curvature of the flanks and 1 / m_c = r_1^2 / J_1 + r_2^2 / J_2. The factor ``along``
multiplies the mesh stiffness in the equation of the relative rotation; the force ``across`` acts along the off-line of
action.

References
----------
Benedict & Kelley (1961), ASLE Trans. 4(1), 59-70, https://doi.org/10.1080/05698196108972420. Vaishya & Singh (2001),
J. Sound Vib. 243(3), https://doi.org/10.1006/jsvi.2000.3247.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np

from hbgear.common.arrays import Array
from hbgear.common.ranges import ANY, NOT_NEGATIVE, POSITIVE, Range, checked
from hbgear.common.text.messages import quoted
from hbgear.common.units import QuantityField
from hbgear.gears.mesh.tooth_contacts import Flank, PathFunction
from hbgear.gears.mesh.tooth_forces import STEPS_PER_MESH, pair_forces, static_displacement
from hbgear.gears.mesh.tooth_mesh import MIN_LOAD_SHARE, ToothMesh, tooth_centre
from hbgear.mechanics.laws.mesh_contacts import MeshContacts, ToothSliding
from hbgear.mechanics.series.periodic import Periodic, Phased

PITCH_REGION = 0.05
"""Distance from the pitch point [base pitches] within which the coefficient of Benedict and Kelley is constant."""

FORCE_FIT_TOLERANCE = 1e-7
"""Largest fit error of the cubics of friction, relative to the largest stiffness."""

SECTION_POINTS = 65
"""Points at which each smooth section of the path is computed before it is fitted by cubics."""

COEFFICIENT = QuantityField("", NOT_NEGATIVE, Range(0, 0.5))
"""Constant coefficient of friction between teeth."""
COEFFICIENT.__set_name__(object, "friction")

_MICROINCH, _INCH, _POUND = 2.54e-8, 0.0254, 4.4482216152605


@dataclass(frozen=True)
class BenedictKelley:  # numpydoc ignore=PR02
    """Coefficient of friction between teeth of Benedict and Kelley at one speed; the module docstring has the formula.

    The force per width is that of the static state. The coefficient follows the position on the path of contact, not
    the frequency along a curve: it changes by 0.038 if the speed changes by a factor of ten.

    Parameters
    ----------
    viscosity : float or str
        Dynamic viscosity of the oil at the temperature of the teeth [Pa s].
    speed : float or str
        Speed of the pinion [rad/s].
    roughness : float or str, default 0.0
        Roughness of the teeth, rms [m], below 0.76 um.

    Raises
    ------
    ValueError
        If a quantity has another unit or is out of range.

    Examples
    --------
    >>> import hbgear as hb
    >>> oil = hb.gears.BenedictKelley(viscosity="0.01 Pa s", speed="3000 r/min")
    >>> round(float(oil.coefficient(load=200e3, sliding=2.0, total=10.0)), 4)
    0.0441
    """

    viscosity: QuantityField = QuantityField("Pa s", POSITIVE, Range(1e-5, 100))
    speed: QuantityField = QuantityField("rad/s", POSITIVE, Range(1e-3, 1e5))
    roughness: QuantityField = QuantityField("m", NOT_NEGATIVE, Range(0, 30 * _MICROINCH), 0.0)

    def coefficient(self, load: Any, sliding: Any, total: Any) -> Any:
        """Return the coefficient of friction.

        Parameters
        ----------
        load : float or ndarray
            Normal force per width [N/m].
        sliding, total : float or ndarray
            Difference and sum of the velocities of both surfaces along the tangent [m/s].
        """
        factor = 50 / (50 - self.roughness / _MICROINCH)
        w, v_s, v_r = load / (_POUND / _INCH), np.abs(sliding) / _INCH, np.abs(total) / _INCH
        return 0.0127 * factor * np.log10(3.17e8 * w / (1e3 * self.viscosity * v_s * v_r**2))


Friction = float | BenedictKelley
"""A constant coefficient of friction, or a formula."""


def checked_friction(owner: str, friction: Any) -> Friction:
    """Return a coefficient of friction.

    Raises
    ------
    ValueError
        If it is no number from 0 to 0.5 and no `BenedictKelley`.
    """
    if isinstance(friction, BenedictKelley):
        return friction
    if friction is None or isinstance(friction, bool):
        raise ValueError(
            f"{owner}: friction = {quoted(friction)} must be a coefficient such as 0.05, or BenedictKelley"
        )
    return COEFFICIENT.read(owner, friction)


class FrictionMesh(NamedTuple):
    """Contacts of a mesh with friction and its static state.

    Attributes
    ----------
    contacts : MeshContacts
        The contacts in units of m and of the stiffness of the mesh, without backlash, with their `ToothSliding`.
    load : float
        Load of the relative rotation over T / r_b1.
    output : float
        Power of the wheel over that of the pinion in the static state: the efficiency, or its reciprocal if the wheel
        drives.
    """

    contacts: MeshContacts
    load: float
    output: float


def friction_mesh(mesh: ToothMesh, friction: Friction, side: int = 1) -> FrictionMesh:
    """Return the contacts of a mesh with friction, and its static state; the module docstring has the equations.

    The loaded ``side`` is -1 if the wheel drives, else 1.

    Raises
    ------
    ValueError
        If the formula of the coefficient is negative on a part of the path.
    """
    return _friction_mesh(mesh, checked_friction("GearPair.model", friction), side)


@lru_cache(maxsize=8)
def _friction_mesh(mesh: ToothMesh, friction: Friction, side: int) -> FrictionMesh:
    """Return the mesh with friction for one loaded side."""
    path, pair = _Path(mesh, friction), mesh.pair
    across: list[Phased] = []
    slide: list[Phased] = []
    for flank in mesh.flanks:
        scaled = flank.scaled(1 / mesh.stiffness, 1.0)
        a, b = path.functions(scaled)
        across += scaled.over_period(a, mesh.meshes)
        slide += scaled.over_period(b, mesh.meshes)
    (r_1, r_2), sign = pair.base_radii, pair.wheel.sign
    slope = r_1 * pair.equivalent_mass * (r_1 / pair.pinion.inertia_used - sign * r_2 / pair.wheel.inertia_used)
    lever = math.tan(pair.working_pressure_angle)
    relative = 1 + sign / pair.ratio
    speed = mesh.meshes / pair.pinion.teeth
    sliding = ToothSliding(tuple(across), tuple(slide), lever, slope, relative, r_1, speed)
    contacts = MeshContacts(mesh.contacts(1.0).contacts, sliding, mesh.meshes)
    mean_a, mean_b = path.static_means()
    torque = side + lever * mean_a + mean_b
    return FrictionMesh(contacts, (side + lever * mean_a + slope * mean_b) / torque, 1 - relative * mean_b / torque)


class _Path:
    """Coefficient of friction and its forces over the path of contact."""

    def __init__(self, mesh: ToothMesh, friction: Friction) -> None:
        self.mesh, self.pair, self.friction = mesh, mesh.pair, friction
        self.normal = 1 / math.cos(self.pair.pinion.base_helix_angle)  # normal over transverse force
        begin = self.pair.path[0]
        self.pitch = (
            self.pair.base_radii[0] * math.tan(self.pair.working_pressure_angle) - begin
        ) / self.pair.base_pitch
        b = self.pair.half_backlash
        phase, x = static_displacement(mesh.flanks, mesh.force, b)
        self.static = pair_forces(mesh.flanks, lambda t: np.interp(t, phase, x, period=1.0), 1, b)
        if isinstance(friction, BenedictKelley):
            self._check(self.coefficient(np.linspace(0.0, self.pair.contact_ratio, 201)), friction)

    def coefficient(self, s: Array) -> Array:
        """Return the friction over the transverse force at positions in base pitches."""
        if not isinstance(self.friction, BenedictKelley):
            return np.full(s.shape, self.friction * self.normal)
        pair, p, omega = self.pair, self.pair.base_pitch, self.friction.speed
        distance = np.maximum(np.abs(s - self.pitch), PITCH_REGION) * p
        # at the pitch point both surfaces move with omega_1 r_b1 tan(alpha)
        rolling = 2 * omega * pair.base_radii[0] * math.tan(pair.working_pressure_angle)
        total = rolling + omega * (1 - pair.wheel.sign / pair.ratio) * (s - self.pitch) * p
        force = np.interp(s, self.static.position, self.static.force[0])
        load = np.maximum(force, MIN_LOAD_SHARE * self.mesh.force) * self.normal / pair.face_width
        return self.normal * self.friction.coefficient(
            load, omega * (1 + pair.wheel.sign / pair.ratio) * distance, total
        )

    def _check(self, mu: Array, friction: BenedictKelley) -> None:
        if mu.min() <= 0:
            raise ValueError(
                f"BenedictKelley: at {friction.speed * 30 / math.pi:.4g} r/min and {friction.viscosity:g} Pa s the "
                f"coefficient falls to {mu.min():.3f} on the path of contact: the film of oil separates the teeth and "
                "the formula does not hold; give a lower speed or viscosity, or a constant coefficient"
            )

    def functions(self, flank: Flank) -> tuple[PathFunction, PathFunction]:
        """Return mu sign(s - s_P) k and mu |s - s_P| p_b k / r_b1 over the path of a flank."""
        k, length = flank.stiffness, self.pair.contact_ratio
        mirror = 2 * tooth_centre(self.pair)

        def position(u: Array) -> Array:
            return np.clip(u if flank.side > 0 else mirror - u, 0.0, length)

        kinks = [self.pitch]
        if isinstance(self.friction, BenedictKelley):
            kinks += [self.pitch - PITCH_REGION, self.pitch + PITCH_REGION]
        inner = [u for u in (kinks if flank.side > 0 else [mirror - s for s in kinks]) if k.nodes[0] < u < k.length]
        nodes = np.unique(np.concatenate([k.nodes, inner]))
        nodes = nodes[np.diff(nodes, prepend=-np.inf) > 1e-9]
        grids, across, slide = [], [], []
        for a, b in pairwise(nodes.tolist()):
            u = np.linspace(a, b, SECTION_POINTS)
            s, sign = position(u), math.copysign(1.0, float(position(np.array(0.5 * (a + b)))) - self.pitch)
            # one-sided values where the stiffness begins or ends
            stiffness = k.at(np.clip(u, a + 1e-12, b - 1e-12))
            force = self.coefficient(s) * stiffness
            grids.append(u)
            across.append(sign * force)
            slide.append(sign * (s - self.pitch) * (self.pair.base_pitch / self.pair.base_radii[0]) * force)
        largest = FORCE_FIT_TOLERANCE * float(np.abs(np.concatenate(across)).max() or 1.0)
        return PathFunction.fitted(grids, across, largest), PathFunction.fitted(grids, slide, largest)

    def static_means(self) -> tuple[float, float]:
        """Return the means of the forces across the line of action and of the torque about the pitch point, over N."""
        sums = np.zeros(2)
        driving = [flank for flank in self.mesh.flanks if flank.side > 0]
        for flank, force in zip(driving, self.static.drive[:, 0], strict=True):
            s = np.clip(self.static.position - flank.lag, 0.0, self.pair.contact_ratio)
            across = self.coefficient(s) * np.sign(s - self.pitch) * force
            sums += [across.sum(), ((s - self.pitch) * across).sum() * self.pair.base_pitch / self.pair.base_radii[0]]
        a, b = (sums / (STEPS_PER_MESH * self.mesh.force)).tolist()
        return a, b


def tooth_friction(
    contact_ratio: float, pitch_point: float, coefficient: float, lever: float = 1.0, lever_slope: float = 0.0
) -> tuple[Periodic, Periodic]:
    """Return the factors of the mesh force along and across the line of action, with jumps where sliding reverses.

    Parameters
    ----------
    contact_ratio : float
        Contact ratio eps, between 1 and 5.
    pitch_point : float
        Position of the pitch point on the path of contact, in base pitches from its begin, between 0 and eps.
    coefficient : float
        Coefficient of friction mu, >= 0.
    lever : float, optional
        Lever of the friction force at the pitch point over that of the mesh force. Default 1.
    lever_slope : float, optional
        Change of the lever in one base pitch. Default 0.

    Returns
    -------
    tuple of Periodic
        Factors ``along`` and ``across`` over the phase of the mesh, which begins where a pair comes into contact.

    Raises
    ------
    ValueError
        If a number is out of its range.

    Examples
    --------
    >>> import hbgear as hb
    >>> along, across = hb.gears.tooth_friction(1.6, 0.8, 0.1)
    >>> pair = hb.SpurPair(stiffness=along, e=())
    >>> round(float(along.mean), 12)
    1.0
    """
    checked("tooth_friction", "contact_ratio", contact_ratio, Range(low=1, high=5))
    checked("tooth_friction", "pitch_point", pitch_point, Range(low=0, high=contact_ratio))
    checked("tooth_friction", "coefficient", coefficient, NOT_NEGATIVE)
    checked("tooth_friction", "lever", lever, ANY)
    checked("tooth_friction", "lever_slope", lever_slope, ANY)
    ends = sorted({0.0, contact_ratio % 1.0, pitch_point % 1.0})
    along, across = [], []
    for begin, end in zip(ends, [*ends[1:], 1.0], strict=True):
        middle, value, slope, side = 0.5 * (begin + end), 0.0, 0.0, 0.0
        for pair in range(math.ceil(contact_ratio)):
            if middle + pair < contact_ratio:
                mu = math.copysign(coefficient, middle + pair - pitch_point)
                value += 1 + mu * (lever + lever_slope * (begin + pair - pitch_point))
                slope += mu * lever_slope / (2 * math.pi)
                side += mu
        along.append((value / contact_ratio, slope / contact_ratio))
        across.append((side / contact_ratio,))
    phases = tuple((2 * np.pi * np.array(ends)).tolist())
    return Periodic(phases, tuple(along)), Periodic(phases, tuple(across))
