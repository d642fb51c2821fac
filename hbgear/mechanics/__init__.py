"""Structures, elements, force laws, loads, Fourier series, reduction."""

from typing import TYPE_CHECKING

from hbgear.common import lazy_names as _lazy

if TYPE_CHECKING:  # imported when they are first used
    from hbgear.common.ranges import Range
    from hbgear.mechanics.function_model import model
    from hbgear.mechanics.laws.compiled_law import CompiledLaw
    from hbgear.mechanics.laws.contact_damping import ClippedKelvinVoigt, HuntCrossley, KelvinVoigt
    from hbgear.mechanics.laws.damped_contact import DampedContact
    from hbgear.mechanics.laws.friction import ContactFriction, Coulomb, Iwan, Jenkins, RigidFriction
    from hbgear.mechanics.laws.laws import Backlash, Cubic, Law, Parallel, PiecewiseLinear, Unilateral
    from hbgear.mechanics.laws.registry import register_law
    from hbgear.mechanics.laws.slider import Slider
    from hbgear.mechanics.laws.vector_laws import Directed, Polynomial, RadialClearance, VectorLaw
    from hbgear.mechanics.models import Model, System
    from hbgear.mechanics.oscillators import Duffing
    from hbgear.mechanics.plausibility import ImplausibleInputWarning
    from hbgear.mechanics.reduction import Reduction, reduce
    from hbgear.mechanics.series.fourier import Series
    from hbgear.mechanics.series.periodic import Periodic
    from hbgear.mechanics.structures.elements import Element, Load, Reaction, VectorElement
    from hbgear.mechanics.structures.modal_damping import modal_damping
    from hbgear.mechanics.structures.receptances import Receptances
    from hbgear.mechanics.structures.speed_terms import MatrixTable, SpeedTerms

__all__ = [
    "Backlash",
    "ClippedKelvinVoigt",
    "CompiledLaw",
    "ContactFriction",
    "Coulomb",
    "Cubic",
    "DampedContact",
    "Directed",
    "Duffing",
    "Element",
    "HuntCrossley",
    "ImplausibleInputWarning",
    "Iwan",
    "Jenkins",
    "KelvinVoigt",
    "Law",
    "Load",
    "MatrixTable",
    "Model",
    "Parallel",
    "Periodic",
    "PiecewiseLinear",
    "Polynomial",
    "RadialClearance",
    "Range",
    "Reaction",
    "Receptances",
    "Reduction",
    "RigidFriction",
    "Series",
    "Slider",
    "SpeedTerms",
    "System",
    "Unilateral",
    "VectorElement",
    "VectorLaw",
    "modal_damping",
    "model",
    "reduce",
    "register_law",
]

if not TYPE_CHECKING:
    __getattr__, __dir__ = _lazy.attached(__name__)
