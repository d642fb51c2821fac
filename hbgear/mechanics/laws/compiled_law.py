"""Laws whose force is a compiled function of the user."""

from __future__ import annotations

import ctypes
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from hbgear.common.argument_checks import check_fields
from hbgear.common.arrays import Array
from hbgear.common.ranges import NOT_NEGATIVE, checked
from hbgear.common.text.messages import article, quoted
from hbgear.mechanics.laws.laws import Forces, Law

_C_FUNCTION: Any = ctypes.CFUNCTYPE(None).__mro__[1]


@dataclass(frozen=True)
class CompiledLaw(Law):  # numpydoc ignore=PR02
    """A law of the user with a compiled force, as fast as the laws of hbgear.

    The force is sampled at N instants per period like a `Law` written in Python, but compiled loops call it directly.
    A law with breakpoints is integrated between their crossings like a `Law` written in Python, and called from there.

    Parameters
    ----------
    function : callable
        Function compiled by ``numba.njit`` that returns p, dp/dd and dp/dv for numbers d, v, tau and an array of
        parameters. Alternatively a C function of Numba, ctypes or cffi, as ``numba.cfunc`` or ``ctypes`` return it::

            void force(double d, double v, double tau, const double *parameters, double *out)

        It stores the three numbers in ``out``. Several threads may call it at the same time. A C function cannot be
        sent to another process.
    parameters : tuple of float, optional
        Numbers that are passed to the function. Default: none.
    reference : float, optional
        Typical stiffness [force / length], >= 0. Default 0: computed from the structure and its loads.
    breakpoints : tuple of float, optional
        Ascending values of d at which dp/dd or dp/dv jumps; p itself must be continuous. Default: none.
    rated : bool, optional
        Whether p may depend on v. Default True.

    Raises
    ------
    TypeError
        If the function is not compiled.
    ValueError
        If it does not return three finite numbers at d = v = tau = 0, or a value is outside its range.

    Examples
    --------
    >>> import hbgear as hb
    >>> import numba
    >>> @numba.njit
    ... def quintic(d, v, tau, k):
    ...     return k[0] * d**5, 5 * k[0] * d**4, 0.0
    ...
    >>> law = hb.mechanics.CompiledLaw(quintic, parameters=(0.3,), rated=False)
    >>> bar = hb.System([[1.0]], [[0.1]], [[1.0]], [hb.Element([1.0], law)], hb.Load(cosine={1: [0.2]}))
    >>> hb.trace(hb.HarmonicBalance(bar, 5), "Omega", (0.5, 0.7)).message
    'Omega = 0.7 reached'
    """

    function: Any
    parameters: tuple[float, ...] = ()
    reference: float = 0.0
    breakpoints: tuple[float, ...] = ()
    rated: bool = True

    def __post_init__(self) -> None:
        check_fields(self)
        for name in ("parameters", "breakpoints"):
            object.__setattr__(self, name, tuple(float(x) for x in getattr(self, name)))
        checked("CompiledLaw", "reference", self.reference, NOT_NEGATIVE)
        if list(self.breakpoints) != sorted(set(self.breakpoints)) or not np.isfinite(self.breakpoints).all():
            raise ValueError(f"CompiledLaw: breakpoints = {quoted(self.breakpoints)} must be finite and ascend")
        if not np.isfinite(self.parameters).all():
            raise ValueError(f"CompiledLaw: parameters = {quoted(self.parameters)} must be finite")
        at_rest = [float(x[0]) for x in self.force(*np.zeros((3, 1)))]
        if not np.isfinite(at_rest).all():
            raise ValueError(f"CompiledLaw: the function returns {at_rest} at d = v = tau = 0; they must be finite")

    @cached_property
    def code(self) -> Any:
        """C function, which must live as long as its address is used."""
        function = self.function
        if hasattr(function, "py_func") and hasattr(function, "signatures"):
            from hbgear.mechanics.laws.c_callback import as_c

            return as_c(function, len(self.parameters))
        if hasattr(function, "address") or isinstance(function, _C_FUNCTION):
            return function
        kind = article(type(function).__name__)
        raise TypeError(f"CompiledLaw(function) needs a compiled function: decorate it by @numba.njit; got {kind}")

    @property
    def is_called_by_kernels(self) -> bool:
        """Whether compiled loops call the function: they sample it, and a law with breakpoints is integrated."""
        return not self.breakpoints

    @property
    def address(self) -> int:
        """Address of the C function."""
        code = self.code
        return int(code.address if hasattr(code, "address") else ctypes.cast(code, ctypes.c_void_p).value or 0)

    def force(self, d: Array, v: Array, tau: Array) -> Forces:
        """Return the force and its derivatives, see `Law.force`."""
        from hbgear.mechanics.laws.c_callback import called

        states = np.array(np.broadcast_arrays(d, v, tau), dtype=float)
        out = np.empty((states[0].size, 3))
        rows = states.reshape(3, -1)
        called(self.address, rows[0], rows[1], rows[2], np.array([*self.parameters, 0.0]), out)
        p, stiffness, damping = out.T.reshape(states.shape)
        return p, stiffness, damping

    def __getstate__(self) -> dict[str, Any]:
        return {name: value for name, value in vars(self).items() if name != "code"}
