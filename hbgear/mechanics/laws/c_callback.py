"""Kernel: compiled functions of the user, called by their addresses.

void force(double d, double v, double tau, const double *parameters, double *out)      out: p, dp/dd, dp/dv
"""

from __future__ import annotations

from functools import lru_cache
from typing import Any

from hbgear.common.process.compiling import kernel
from hbgear.common.process.signals import defer_signals

try:
    with defer_signals():
        import numba
        from llvmlite import ir
        from numba import types
        from numba.extending import intrinsic
except ImportError:  # without Numba, the functions are called by ctypes
    import ctypes

    _DOUBLE_POINTER = ctypes.POINTER(ctypes.c_double)
    _SIGNATURE = ctypes.CFUNCTYPE(
        None, ctypes.c_double, ctypes.c_double, ctypes.c_double, _DOUBLE_POINTER, _DOUBLE_POINTER
    )

    def _call(address: int, d: float, v: float, tau: float, parameters: Any, out: Any) -> None:
        _SIGNATURE(int(address))(d, v, tau, parameters.data_as(_DOUBLE_POINTER), out.data_as(_DOUBLE_POINTER))

else:
    _NUMBA: Any = numba
    _TYPES: Any = types
    _DOUBLE_ARRAY = _TYPES.CPointer(types.float64)
    _FORCE = _TYPES.void(types.float64, types.float64, types.float64, _DOUBLE_ARRAY, _DOUBLE_ARRAY)

    @intrinsic
    def _call(typing: Any, address: Any, d: Any, v: Any, tau: Any, parameters: Any, out: Any) -> Any:
        def code(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
            double = ir.DoubleType()
            pointer = double.as_pointer()
            function = ir.FunctionType(ir.VoidType(), [double, double, double, pointer, pointer])
            builder.call(builder.inttoptr(arguments[0], function.as_pointer()), arguments[1:])
            return context.get_dummy_value()

        return _TYPES.void(types.int64, *_FORCE.args), code


@lru_cache(maxsize=64)
def as_c(function: Any, count: int) -> Any:
    """Return a C function that calls a function compiled by Numba, which takes ``count`` parameters."""
    carray = _NUMBA.carray

    def force(d: float, v: float, tau: float, parameters: Any, out: Any) -> None:
        result, numbers = carray(out, (3,)), carray(parameters, (count,))
        result[0], result[1], result[2] = function(d, v, tau, numbers)

    return _NUMBA.cfunc(_FORCE)(force)


@kernel
def called(address: int, d: Any, v: Any, tau: Any, parameters: Any, out: Any) -> None:
    """Store p, dp/dd and dp/dv at N states d, v, tau (N,) in ``out`` (N, 3), which is contiguous."""
    for i in range(d.shape[0]):
        _call(address, d[i], v[i], tau[i], parameters.ctypes, out[i].ctypes)
