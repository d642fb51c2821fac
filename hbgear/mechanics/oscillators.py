"""Textbook oscillators."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar

from hbgear.common.ranges import NOT_NEGATIVE, Range
from hbgear.mechanics.laws.laws import Cubic
from hbgear.mechanics.models import Model, System
from hbgear.mechanics.structures.elements import Element, Load


@dataclass(frozen=True)
class Duffing(Model):  # numpydoc ignore=PR02
    """Duffing oscillator.

        x'' + 2 zeta x' + x + k3 x^3 = F cos(tau),   tau = Omega t

    The element is the cubic spring alone; its coordinate is x. Time is in units of 1/omega_n and Omega is over omega_n,
    the natural frequency without the cubic spring. x is a displacement over any length L, k3 is the cubic stiffness
    times L^2 over the linear stiffness, and F is the force over L times the linear stiffness.

    Parameters
    ----------
    zeta : float, optional
        Damping ratio, >= 0. Default 0.05.
    k3 : float, optional
        Cubic coefficient; positive hardens, negative softens. Default 0.1.
    F : float, optional
        Amplitude of the load. Default 0.18.

    Raises
    ------
    ValueError
        If a value is not finite or zeta is negative.

    Examples
    --------
    >>> import hbgear as hb
    >>> curve = hb.trace(hb.HarmonicBalance(hb.Duffing(zeta=0.03), 5), "Omega", (0.8, 1.6))
    >>> len(curve.jumps())
    2
    """

    zeta: float = 0.05
    k3: float = 0.1
    F: float = 0.18

    labels: ClassVar[Mapping[str, str]] = {
        "Omega": r"$\Omega = \omega/\omega_n$ [-]",
        "amplitude": r"$x$ [-]",
        "zeta": r"damping ratio $\zeta$ [-]",
        "k3": r"cubic stiffness $k_3$ [-]",
        "F": r"load $F$ [-]",
    }
    default_span: ClassVar[tuple[float, float]] = (0.5, 1.6)
    ranges: ClassVar[Mapping[str, Range]] = {"zeta": NOT_NEGATIVE}
    usual: ClassVar[Mapping[str, Range]] = {"zeta": Range(0, 1)}

    def system(self) -> System:
        """Return the system with one coordinate x, the linear spring in K and the cubic spring as its element."""
        return System(
            M=[[1.0]],
            C=[[2 * self.zeta]],
            K=[[1.0]],
            elements=[Element(direction=[1.0], law=Cubic(self.k3), name="x")],
            load=Load(cosine={1: [self.F]}),
            dof_names=["x"],
        )
