"""What Numba does otherwise with kernels: those that others call are parts, and less is done to find one again.

Numba optimises every function that it compiles, and translates it for the processor, before it does so again in each
one that calls it. A part is neither: it becomes code with those that it is linked into. That is a quarter of the time
that all kernels take to compile, and they are as fast.

A kernel that is found again is machine code, which needs nothing of what Numba knows for compiling: to prepare that
would take longer than to load a dozen of them. Numba does so by itself when something is compiled.

This imports Numba.
"""

from __future__ import annotations

from typing import Any

from numba.core.caching import FunctionCache
from numba.core.codegen import JITCodeLibrary
from numba.core.compiler import Compiler
from numba.core.runtime.nrt import rtsys


class Kept(FunctionCache):
    """Files of the machine code of a kernel."""

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        """The kernel for arguments of some types, None if it is not there."""
        rtsys.initialize(target_context)  # the memory of arrays
        with self._guard_against_spurious_io_errors():
            return self._load_overload(sig, target_context)  # type: ignore[no-untyped-call]


class _Part(JITCodeLibrary):
    """Code that is linked into other code, which alone can be called."""

    def _optimize_final_module(self) -> None:
        pass

    def _finalize_final_module(self) -> None:
        self._finalize_dynamic_globals()  # type: ignore[no-untyped-call]  # whether it can be kept
        self._finalized = True

    def get_pointer_to_function(self, name: str) -> int:
        """Null: there is no machine code."""
        return 0

    @property
    def codegen(self) -> _Part:
        """Itself, as of what would be told about the machine code."""
        return self

    def set_env(self, name: str, env: Any) -> None:
        """Do nothing: the code that it is linked into has an environment of its own."""

    def serialize_using_object_code(self) -> Any:
        """As it is kept in a file."""
        return self.serialize_using_bitcode()  # type: ignore[no-untyped-call]


class Parts(Compiler):
    """Numba's compiler, of parts."""

    def compile_extra(self, func: Any) -> Any:
        """What Numba knows of the function when it is compiled."""
        self.state.library = _Part(self.state.targetctx.codegen(), func.__qualname__)  # type: ignore[no-untyped-call]
        return super().compile_extra(func)  # type: ignore[no-untyped-call]
