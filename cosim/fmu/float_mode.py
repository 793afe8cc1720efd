"""Keep what an FMU does to the processor's arithmetic inside its calls.

A library may choose another rounding mode, or let tiny numbers count as zero (flush to zero,
denormals are zero), and leave it so: every number computed afterwards in this process would be
another one. Compilers do so too: what some link with -ffast-math does it when it is loaded.

The floating-point environment of C99 (fenv.h) has all of these, with the exception flags: on x86
the words of the x87 and SSE units, on ARM FPCR and FPSR.
"""

from __future__ import annotations

import ctypes
import sys
from typing import Any, Final

_SIZE: Final = 64
"""At least sizeof(fenv_t): 32 with glibc on x86-64, 28 elsewhere on x86, 8 or 16 on ARM."""


def _c_functions() -> Any:
    """Return the library with fegetenv and fesetenv: that of C, or of mathematics."""
    if sys.platform == "win32":
        return ctypes.CDLL("ucrtbase")
    here = ctypes.CDLL(None)  # what the interpreter is linked to
    return here if hasattr(here, "fegetenv") else ctypes.CDLL("libm.so.6")


_library: Final = _c_functions()
_save, _restore = _library.fegetenv, _library.fesetenv
_save.argtypes = _restore.argtypes = [ctypes.c_void_p]
restore_function: Final = int(ctypes.cast(_restore, ctypes.c_void_p).value or 0)
"""Address of fesetenv, for callers by address: int(void *)."""


_Mode = ctypes.c_char * _SIZE


def saved_float_mode() -> ctypes.Array[ctypes.c_char]:
    """Return the present mode, whose address `restore_function` takes."""
    saved = _Mode()
    _save(saved)
    return saved


def call_with_own_float_mode(function: Any, *arguments: Any, **named: Any) -> Any:
    """Call what runs foreign code; what that does to rounding and to tiny numbers ends with it."""
    saved = saved_float_mode()
    try:
        return function(*arguments, **named)
    finally:
        _restore(saved)
