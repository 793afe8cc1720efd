"""The library of the loops in C: over points, `kernel.c`, and over messages, `delivery.c`."""

from __future__ import annotations

import ctypes
from functools import cache

from cosim.core import InputError
from cosim.fmu.compiled import compiled_library, library_source
from cosim.network import CompiledDelivery


@cache
def load_kernel() -> ctypes.CDLL:
    """Return the library of the kernel; the first call may compile it.

    Raises
    ------
    InputError : no C compiler, or it rejects the source.
    """
    library = compiled_library("kernel", library_source("kernel"))
    address, number = ctypes.c_void_p, ctypes.c_int64
    library.run.argtypes = [address, address, *[number] * 4, address, number]
    library.make_team.argtypes = [number, address, number, address]
    library.make_team.restype = address
    library.end_team.argtypes, library.end_team.restype = [address], None
    return library


@cache
def compiled_delivery() -> CompiledDelivery | None:
    """Return the loop over messages; None where there is no C compiler, and all is Python."""
    try:
        return CompiledDelivery(load_kernel())
    except InputError:
        return None
