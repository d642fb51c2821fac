"""Models: a linear structure, a few scalar elements, and their loads.

    M q'' + C q' + K q + sum_j w_j [p_j(d_j, d_j', tau) + c_j d_j'] = F(tau),  d_j = w_j^T q - e_j(tau),  tau = Omega t

* ``q`` (n,) coordinates; ``M, C, K`` (n, n), dense or scipy.sparse;
* ``w_j`` (n,) direction of element j, ``d_j`` its element coordinate (the gap of a gear mesh), ``e_j`` a prescribed
  displacement (the transmission error), ``p_j`` a scalar law, ``c_j`` a viscous damper in parallel;
* ``F = Omega^power (F_0 + sum_l F_cl cos(l tau) + F_sl sin(l tau))``;
* C and K may have terms that depend on Omega, see `speed_terms`; a part of the structure may be given by receptances,
  see `receptances`.
"""

from __future__ import annotations

import dataclasses
from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, ClassVar, Self

import numpy as np

from hbgear.common.argument_checks import NamedFields, check, check_fields
from hbgear.common.arrays import Array
from hbgear.common.facade import call
from hbgear.common.ranges import ANY, Range, checked
from hbgear.common.text.messages import did_you_mean, quoted
from hbgear.mechanics.fields import check_names, entries_of, parameters_of, with_entries
from hbgear.mechanics.laws.slider import friction_limits
from hbgear.mechanics.laws.vector_laws import vector_groups
from hbgear.mechanics.serialization import source_of, to_plain
from hbgear.mechanics.series.fourier import is_listed
from hbgear.mechanics.structures.elements import Element, Load, Reaction
from hbgear.mechanics.structures.matrices import coordinate_names, square
from hbgear.mechanics.structures.receptances import Receptances
from hbgear.mechanics.structures.scales import Scales
from hbgear.mechanics.structures.speed_terms import SpeedTerms


class Model(NamedFields, ABC):
    """Frozen dataclass that describes a machine and builds its `System`.

    Its float fields are its parameters: each can be the continuation parameter, can be set on the command line, and
    must be a finite number within its range in `ranges`. A field is a parameter however its type is written, such as
    ``Annotated[float, "damping ratio"]``. A subclass checks conditions on several fields in ``__post_init__``, after
    the call of the method of this class.

    A function that returns a `System` becomes a model by the decorator `hbgear.mechanics.model`. A class is needed if
    the machine has more properties, such as units.

    Examples
    --------
    >>> import hbgear as hb
    >>> from dataclasses import dataclass
    >>> @dataclass(frozen=True)
    ... class Stop(hb.mechanics.Model):
    ...     "A mass on a spring that meets a stop."
    ...     zeta: float = 0.05
    ...     gap: float = 1.0
    ...     ranges = {"zeta": hb.mechanics.Range(low=0)}
    ...
    ...     def system(self):
    ...         element = hb.Element([1.0], hb.Unilateral(k=5.0, gap=self.gap), name="stop")
    ...         return hb.System([[1.0]], [[2 * self.zeta]], [[1.0]], [element], hb.Load(cosine={1: [0.2]}))
    >>> Stop(gap=0.5).replace(zeta=0.1).parameters
    {'zeta': 0.1, 'gap': 0.5}
    """

    labels: ClassVar[Mapping[str, str]] = {}
    """Axis labels ``{"Omega": ..., "amplitude": ...}`` and labels of parameters by name: symbol and unit."""
    default_span: ClassVar[tuple[float, float]] = (0.5, 1.5)
    """Range of Omega over which a response curve is traced by default."""
    ranges: ClassVar[Mapping[str, Range]] = {}
    """Allowed values of parameters by name: ``{"zeta": Range(low=0)}``. Searches and branches end at the limits."""

    usual: ClassVar[Mapping[str, Range]] = {}
    """Usual values of fields by name, of every entry of a tuple. A problem warns of the unit of other values."""

    def __post_init__(self) -> None:
        check_fields(self)
        for name, value in self.parameters.items():
            allowed = self.ranges.get(name, ANY)
            if type(value) is float and 1 / MAX_PARAMETER < abs(value) < MAX_PARAMETER and value in allowed:
                continue  # the usual case, which is fast
            checked(type(self).__name__, name, value, allowed)
            if abs(float(value)) > MAX_PARAMETER:
                raise ValueError(
                    f"{type(self).__name__}: {name} = {value:g} is above {MAX_PARAMETER:g}: check its unit"
                )
            if abs(float(value)) < 1 / MAX_PARAMETER and 0.0 not in allowed:  # models divide by it
                raise ValueError(
                    f"{type(self).__name__}: {name} = {value:g} is below {1 / MAX_PARAMETER:g}: check its unit"
                )
            if not isinstance(value, int | float) or (isinstance(value, int) and abs(value) > 2**53):
                # a fraction, another type of NumPy, or an integer beyond the integers of NumPy
                object.__setattr__(self, name, float(value))

    @abstractmethod
    def system(self) -> System:
        """Return the equations of motion of the model."""

    def _repr_html_(self) -> str:
        """Return the parameters with units, for notebooks."""
        return call("hbgear.plot.notebook.model_html", self)

    @property
    def scales(self) -> Scales | None:
        """Units of a dimensionless model (Hz, r/min, m and N); None if the model has none."""
        return None

    @property
    def title(self) -> str:
        """Machine in words: "Gear pair 25/40, m = 3 mm, 200 N m"; empty for models whose name and numbers suffice."""
        return ""

    @property
    def reactions(self) -> Mapping[str, Reaction]:
        """Forces in linear supports that are reported along a branch, by name. Default: none."""
        return {}

    @property
    def sharing(self) -> Sequence[str]:
        """Names of the elements that share a load, see `hbgear.analysis.loads.planet_loads`; () means all elements."""
        return ()

    @property
    def mesh_names(self) -> Sequence[str]:
        """Names of the elements that are meshes of teeth. Default: those of `sharing`.

        () means the first element of a model with `scales`, and no element of other models.
        """
        return self.sharing

    @property
    def orders(self) -> Mapping[str, float]:
        """Frequencies of rotations and meshes over Omega, by name. Default: ``{"Omega": 1}``."""
        return {"Omega": 1.0}

    @property
    def parameters(self) -> dict[str, float]:
        """Float fields by name, each of which can be a continuation parameter in addition to Omega."""
        if not dataclasses.is_dataclass(self):
            return {}
        return {name: getattr(self, name) for name in parameters_of(type(self))}

    @property
    def entries(self) -> dict[str, float]:
        """Entries of tuples of numbers by name, ``eps[0]``, each of which can be a continuation parameter.

        Examples
        --------
        >>> import hbgear as hb
        >>> hb.SpurPair(e=(0.1, 0.02)).entries
        {'e[0]': 0.1, 'e[1]': 0.02}
        """
        return entries_of(self) if dataclasses.is_dataclass(self) else {}

    def replace(self, /, **changes: Any) -> Self:
        """Return a copy with other field values.

        Parameters
        ----------
        **changes
            New values by field name. ``**{"eps[0]": 0.1}`` changes one entry of a tuple.

        Returns
        -------
        Model
            The copy.

        Raises
        ------
        KeyError
            If a name is not a field of the model or an entry of a field.
        """
        changes = with_entries(self, changes)
        check_names(type(self), changes)
        return dataclasses.replace(self, **changes)  # type: ignore[type-var]

    def at(self, parameters: Mapping[str, float]) -> Self:
        """Return a copy with the given values of parameters, such as the values of a `Point`.

        Parameters
        ----------
        parameters : mapping
            Values by name. Names that are not parameters of the model, such as Omega, are ignored.

        Returns
        -------
        Model
            The copy.

        Examples
        --------
        >>> import hbgear as hb
        >>> hb.Duffing().at({"zeta": 0.1, "Omega": 1.2}).zeta
        0.1
        """
        names = self.parameters | self.entries
        return self.replace(**{name: value for name, value in parameters.items() if name in names})


MAX_PARAMETER = 1e60
"""Largest modulus of a parameter, in its unit; products of several parameters remain finite numbers."""


_TITLE_ELEMENTS = 3
"""Number of elements in the title of a structure."""


@dataclass(frozen=True, eq=False)
class System(Model):  # numpydoc ignore=PR02
    """Equations of motion from matrices. Every model is reduced to this form, which is a model itself.

    Parameters
    ----------
    M, C, K : array_like or sparse matrix, shape (n, n)
        Mass, damping and stiffness; M must be regular. ``C=None`` means no damping.
    elements : sequence of Element
        At least one element.
    load : Load or sequence of Load, optional
        Loads. Default: none.
    dof_names : sequence of str, length n, optional
        Names of the coordinates. Default: ``q1, q2, ...``.
    speed : SpeedTerms, optional
        Terms of C and K that depend on Omega: gyroscopic terms, bearings. Default: none.
    receptances : Receptances, optional
        Measured part of the structure, at coordinates given by name, which need no mass. Branches have no stability
        then, and time integration is not available. Default: none.

    Raises
    ------
    ValueError
        If shapes do not fit or an entry is not finite.

    Examples
    --------
    >>> import hbgear as hb
    >>> import numpy as np
    >>> stop = hb.Element([1, 0], hb.Unilateral(k=1.0, gap=1.0), name="stop")
    >>> M, C, K = np.eye(2), 0.05 * np.eye(2), [[2, -1], [-1, 2]]
    >>> two = hb.System(M, C, K, [stop], hb.Load(cosine={1: [0, 0.2]}), dof_names=["x", "y"])
    >>> hb.HarmonicBalance(two, 8).size
    17
    """

    M: Any
    C: Any
    K: Any
    elements: Sequence[Element] = ()
    load: Load | Sequence[Load] = ()
    dof_names: Sequence[str] = ()
    speed: SpeedTerms | None = None
    receptances: Receptances | None = None

    def __post_init__(self) -> None:
        set_ = object.__setattr__
        set_(self, "M", square("M", self.M))
        n = self.M.shape[0]
        set_(self, "C", square("C", np.zeros((n, n)) if self.C is None else self.C, n))
        set_(self, "K", square("K", self.K, n))
        if not is_listed(self.elements):
            raise ValueError("a System takes its elements in a list: elements=[...]")
        elements = tuple(self.elements)
        for i, element in enumerate(elements):
            if not isinstance(element, Element):
                kind = "None" if element is None else f"a {type(element).__name__}"
                several = " or, for several, a star: *VectorElement(...)" if is_listed(element) else ""
                raise ValueError(f"element {i} is {kind}; need an Element(direction, law){several}")
        is_single = isinstance(self.load, Load)
        if not is_single and not (is_listed(self.load) and all(isinstance(load, Load) for load in self.loads)):
            raise ValueError(f"load = {quoted(self.load)}: need a Load, or a list of them")
        loads = self.loads
        names = coordinate_names("System: dof_names", self.dof_names, n)
        check("System", "speed", self.speed, SpeedTerms | None)
        if self.speed is not None:
            self.speed.check(n)
        if not elements:
            raise ValueError("a System needs at least one element; a linear one can have the law Cubic(k3=0)")
        for i, element in enumerate(elements):
            if np.shape(element.direction) != (n,):
                raise ValueError(f"element {i} has direction of shape {np.shape(element.direction)}; need ({n},)")
        for vector in (v for load in loads for v in load.vectors()):
            if vector.shape != (n,):
                raise ValueError(f"a load vector has shape {vector.shape}; need ({n},)")
        check("System", "receptances", self.receptances, Receptances | None)
        for name in self.receptances.names if self.receptances is not None else ():
            if names.count(name) != 1:
                raise ValueError(f"receptances: there is no coordinate '{name}'{did_you_mean(name, names)}")
        if self.receptances is not None and self.speed is not None:
            raise ValueError("a System has receptances or terms that depend on speed, not both: leave one out")
        with_names = tuple(
            e if e.name else dataclasses.replace(e, name=f"element {i + 1}") for i, e in enumerate(elements)
        )
        vector_groups([e.law for e in elements])
        friction_limits(with_names)
        set_(self, "elements", with_names)
        set_(self, "load", loads)
        set_(self, "dof_names", names)

    @property
    def parameters(self) -> dict[str, float]:
        """Empty, because a System is fixed.

        A function that returns a System is a model with parameters, see `hbgear.mechanics.model`.
        """
        return {}

    def system(self) -> System:
        """Return the system itself."""
        return self

    def at_speed(self, Omega: float) -> System:
        """Return the system whose constant C and K are those at Omega.

        Parameters
        ----------
        Omega : float
            Excitation frequency.

        Returns
        -------
        System
            System without terms that depend on speed; the system itself if it has none.

        Raises
        ------
        ValueError
            If Omega is outside a table, or a part of the structure is given by receptances.
        """
        self.check_matrices()
        if self.speed is None:
            return self
        C, K = self.speed.at(float(Omega), self.n)
        return dataclasses.replace(self, C=self.C + C, K=self.K + K, speed=None)

    def check_matrices(self) -> None:
        """Raise ValueError if a part of the structure is given by receptances, so that M, C and K are incomplete.

        Raises
        ------
        ValueError
            If there are receptances.
        """
        if self.receptances is not None:
            raise ValueError(
                f"{', '.join(self.receptances.names)} are known by receptances only; modes, stability and time "
                "integration need M, C and K of all coordinates"
            )

    @property
    def title(self) -> str:
        """Number of coordinates and names of the elements, up to three of them."""
        names = ", ".join(element.name for element in self.elements[:_TITLE_ELEMENTS])
        count = len(self.elements) - _TITLE_ELEMENTS
        coordinates = f"{self.n} coordinate{'s' * (self.n != 1)}"
        return f"Structure of {coordinates} with {names}{f' and {count} more elements' if count > 0 else ''}"

    @property
    def n(self) -> int:
        """Number of coordinates."""
        return int(self.M.shape[0])

    @property
    def loads(self) -> tuple[Load, ...]:
        """Loads as a tuple."""
        return (self.load,) if isinstance(self.load, Load) else tuple(self.load)

    @cached_property
    def massless(self) -> str:
        """Name of a coordinate without mass, if M is singular; else ""."""
        M = self.M if isinstance(self.M, np.ndarray) else None
        if M is None:  # sparse: a zero row
            rows = np.asarray(abs(self.M).sum(axis=1)).ravel()
            return "" if rows.all() else self.dof_names[int(np.argmin(rows))]
        diagonal = np.diag(M)
        if np.array_equal(M, np.diag(diagonal)) and diagonal.all():
            return ""
        size = np.abs(diagonal)
        s = 1.0 / np.sqrt(np.where(size > 0, size, size.max(initial=1.0) or 1.0))
        _, values, vectors = np.linalg.svd(M * np.outer(s, s))
        singular = values[-1] <= 1e-13 * values[0]
        return self.dof_names[int(np.argmax(np.abs(vectors[-1])))] if singular else ""

    @property
    def W(self) -> Array:
        """Directions of the elements as columns, (n, m)."""
        return np.column_stack([np.asarray(e.direction) for e in self.elements])


def describe(model: Model) -> dict[str, Any]:
    """Return a description of a model by plain data for JSON, ``{"class": name, "fields": {...}}``.

    Fields that are not data (functions, laws that are not registered, very large matrices) are missing: ``"left_out"``
    names them, ``"reasons"`` states why, and such a model cannot be rebuilt. ``"from"`` is the file or module of a
    model that is not of hbgear, for the reader of the file.
    """
    fields: dict[str, Any] = {}
    reasons: dict[str, str] = {}
    for entry in dataclasses.fields(model):  # type: ignore[arg-type]
        try:
            fields[entry.name] = to_plain(getattr(model, entry.name))
        except TypeError as error:
            reasons[entry.name] = str(error)
    out: dict[str, Any] = {"class": type(model).__name__, "fields": fields}
    if reasons:
        out |= {"left_out": list(reasons), "reasons": reasons}
    source = source_of(type(model))
    return out | ({"from": source} if source else {})


def differing_fields(stored: Mapping[str, Any], current: Mapping[str, Any]) -> list[str]:
    """Return the names of the fields that differ between two descriptions by `describe`, in order.

    Fields that one of the descriptions does not hold because they are not data do not differ.
    """
    not_data = {*(stored.get("left_out") or ()), *(current.get("left_out") or ())}
    names = {*stored["fields"], *current["fields"]} - not_data
    return sorted(name for name in names if stored["fields"].get(name) != current["fields"].get(name))
